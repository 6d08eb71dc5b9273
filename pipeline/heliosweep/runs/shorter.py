"""Draws that an earlier run of a shorter sample has computed: they are those of a longer one, bit for bit."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.config.design import LATIN, LOCAL
from heliosweep.config.sample import SAMPLE
from heliosweep.grid.regions import of_kind
from heliosweep.store.manifest import Finished, as_json
from heliosweep.store.read import open_stored

if TYPE_CHECKING:
    from heliosweep.config.study import Study
    from heliosweep.grid.plan import Plan
    from heliosweep.store.parts import PartStore

log = logging.getLogger("heliosweep")


def take_draws(folder: Path, study: Study, identity: dict[str, Any], plan: Plan, store: PartStore) -> None:
    """Store the missing parts whose draws a finished result of the same study with a smaller sample holds.

    Looked at are results beside `folder` of the same name but for the study id, as runs leave them. Results that hold
    no draws of some variable, as by default those of heliostats, cannot serve.
    """
    if study.sample is None or study.sample.design == LATIN or study.sample.sensitivity == LOCAL:
        return
    wanted = of_kind(plan.variables, "points")
    missing = [part for part in plan.parts() if part.name not in store.done]
    for found in _shorter(folder, identity):
        draws = found.manifest["plan"]["dimensions"][SAMPLE]
        held = [part for part in missing if part.region[SAMPLE].stop <= draws]
        if not held or not set(wanted) <= {*found.manifest["slabs"]["variables"]} or not found.is_whole():
            continue
        with open_stored(found.path) as stored:
            for part in held:
                read = {name: stored.read(name, stored.index(name, part.region)) for name in wanted}
                store.commit(part, {name: _typed(values, wanted[name].dtype) for name, values in read.items()})
        log.info("%s has the first %d draws: %d parts are not computed again", found.folder, draws, len(held))
        return


def _shorter(folder: Path, identity: dict[str, Any]) -> Iterator[Finished]:
    """Finished results of the same study and code with fewer draws, those with the most first."""
    name = folder.name.rpartition("-")[0]
    beside = [each for each in folder.parent.glob("*") if name and each.name.startswith(f"{name}-") and each != folder]
    found = [result for each in beside if (result := Finished.find(each))]
    alike = [one for one in found if _others(one.identity) == _others(identity) and one.identity["study"].get(SAMPLE)]
    mine = identity["study"][SAMPLE]["size"]
    shorter = [one for one in alike if one.identity["study"][SAMPLE]["size"] < mine]
    yield from sorted(shorter, key=lambda one: -one.identity["study"][SAMPLE]["size"])


def _others(identity: dict[str, Any]) -> tuple[Any, Any]:
    """What the numbers of a draw depend on: the study without the number of draws and their statistics; the code."""
    study = identity["study"]
    sample = {key: value for key, value in (study.get(SAMPLE) or {}).items() if key not in ("size", "statistics")}
    return as_json({**study, SAMPLE: sample}), dict(identity["code"])


def _typed(values: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Stored values as they were computed: dates are stored as seconds."""
    if dtype.kind != "M":
        return values.astype(dtype)
    known = ~np.isnan(values)
    stamps = (np.where(known, values, 0) * 1e9).astype(np.int64).astype("datetime64[ns]")
    return np.where(known, stamps, np.datetime64("NaT")).astype(dtype)
