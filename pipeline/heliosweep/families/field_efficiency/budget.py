"""Error budget of a field: energy lost to each cause, computed from field energies with and without the causes.

The energy of a field is computed with all causes, without any cause, with each cause alone, and with all causes but
one. The loss due to a cause is the loss with this cause alone. The difference between the total loss and the sum of
these losses is the interaction of the causes. All energies use the same rays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.config import FileName, Invalid, Parameter, Sweep
from heliosweep.energy import INTERACTION, budget_losses
from heliosweep.errors import Problem
from heliosweep.families.field_efficiency.optics import KEYS
from heliosweep.kernels.compiled import Floats

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy

#: Keys that a cause may contain.
ALLOWED = (*(key for key in KEYS if not key.endswith((".seed", ".rays", ".precision"))), "tracking",
           "availability.fraction")  # fmt: skip


def causes_of(study: FieldEfficiencyStudy) -> dict[str, dict[str, Any]]:
    """Return the causes of a study and the undisturbed values of their keys, in study units. Raises Invalid."""
    declared = {key: parameter for key, parameter, _ in study.parameters()}
    causes = {
        cause: {key: _undisturbed(declared[key], raw) for key, raw in values.items()}
        for cause, values in (study.budget or {}).items()
    }
    for values in causes.values():  # without a slope error in the study, mirrors without a map have none
        if "optics.slope_map" in values and study.optics is not None and study.optics.slope_error is None:
            values.setdefault("optics.slope_error", 0.0)
    return causes


def _undisturbed(parameter: Parameter, raw: Any) -> Any:
    """Return the undisturbed value of a key, or None if the key refers to a file. Raises Invalid."""
    if isinstance(parameter, FileName):
        if raw != "none":
            raise Invalid("must be none: a field without the cause has no such file")
        return None
    value = parameter.read(raw)
    if isinstance(value, Sweep):
        raise Invalid("must be one value")
    return value


def budget_problems(study: FieldEfficiencyStudy) -> Iterator[Problem]:
    """Yield the problems found in a budget: unknown keys, invalid values, and missing blocks."""
    if study.budget is None:
        return
    if study.weather is None:
        yield study.problem("budget", "needs energies: add 'weather'")
    declared, owner = {key: parameter for key, parameter, _ in study.parameters()}, dict[str, str]()
    if not study.budget:
        yield study.problem("budget", "has no cause: give {cause: {key: undisturbed value}}")
    for cause, values in study.budget.items():
        if not values or cause == INTERACTION:
            message = (
                "is reserved for the rest of the loss; use another name" if values else "has no key: give {key: value}"
            )
            yield study.source.problem(("budget", cause), message)
        for key, raw in values.items():
            wrong = _check_key(key, raw, declared.get(key))
            if owner.setdefault(key, cause) != cause:
                wrong = f"also belongs to the cause {owner[key]!r}; remove one of them"
            if wrong:
                yield study.source.problem(("budget", cause, key), wrong)


def _check_key(key: str, raw: Any, parameter: Parameter | None) -> str:
    """Return the problem with a key of a cause or its undisturbed value; empty if there is none."""
    if key not in ALLOWED:
        names = "tracking, availability.fraction, heliostat.focus, and keys of optics and receiver"
        return f"cannot be a key of a cause: use {names}"
    if parameter is None:
        return "is not set in this study: a cause can only contain keys that have a value"
    try:
        _undisturbed(parameter, raw)
    except Invalid as error:
        return str(error)
    return ""


def budget_cases(study: FieldEfficiencyStudy) -> int:
    """Return the number of additional field energies that the budget of one point needs."""
    return 1 + 2 * len(study.budget) if study.budget else 0


def budget_labels(study: FieldEfficiencyStudy) -> dict[str, Any]:
    """Return the labels of the budget parts (causes and interaction) and the attributes of these labels."""
    causes = tuple(study.budget or ())
    words = {"long_name": "cause of a loss of energy"}
    parts = (
        np.array([*causes, INTERACTION], object),
        words | {"comment": f"{INTERACTION}: loss of all causes minus the losses of each cause"},
    )
    return {"budget_part": parts, "budget_cause": (np.array(causes, object), words)} if causes else {}


def budget_values(
    study: FieldEfficiencyStudy, energies: Callable[[Mapping[str, Any]], tuple[Floats, Floats]], actual: float
) -> dict[str, Floats]:
    """Return the values of the budget variables at one point.

    Parameters
    ----------
    study : FieldEfficiencyStudy
        Study with a `budget`.
    energies : callable
        Function that computes the energy on the receiver and the energy lost at each stage for given key values. [MWh]
    actual : float
        Energy on the receiver with all causes. [MWh]
    """
    causes = causes_of(study)
    every = {key: value for values in causes.values() for key, value in values.items()}
    undisturbed, stages = energies(every)
    others = [{key: every[key] for key in every if key not in values} for values in causes.values()]
    alone, without = (np.array([energies(values)[0] for values in cases]) for cases in (others, causes.values()))
    return {
        "budget_energy": np.asarray(undisturbed),
        "budget_stage_loss": stages,
        "budget_loss": budget_losses(undisturbed, actual, alone),
        "budget_gain": without - actual,
    }
