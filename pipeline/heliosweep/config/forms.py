"""The forms in which swept values are written, and functions that write them for studies built in Python.

A list ``[0, 15, 30]``, a range ``{start, stop, step}`` or ``{start, stop, num}``, a geometric range
``{logspace: {start, stop, num}}``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from typing import Any, TypeAlias

from heliosweep.config.faults import Fault, Invalid, nearest
from heliosweep.config.sweep import Geometric, Listed, Range, Sweep

MAX_POINTS = 10**15
MAX_FAULTS = 100  # of one list; nobody reads more
_FORMS = "a range is {start, stop, step}, {start, stop, num} or {logspace: {start, stop, num}}"
_TOO_FINE = "the steps are finer than the precision of numbers"
_PRECISION = 2.0**-52
_ON_STEP = Decimal("1e-9")  # a stop this near to the last step, in steps, falls on it

ReadNumber = Callable[[Any], float]


def read_sweep(raw: Sequence[Any] | Mapping[str, Any], number: ReadNumber) -> Sweep:
    """Read swept numbers from any of their forms.

    Parameters
    ----------
    raw : list or mapping
        What stands in the study file.
    number : callable
        Reads one number or raises Invalid.

    Raises
    ------
    Invalid
        With every fault, each at its inner key.
    """
    if not isinstance(raw, Mapping):
        return Listed(read_items(raw, number))
    if "logspace" in raw:
        if len(raw) > 1:
            raise Invalid(Fault("'logspace' cannot be mixed with other keys", show_value=False))
        try:
            return _read_logspace(raw["logspace"], number)
        except Invalid as error:
            raise Invalid(error.under("logspace")) from None
    return _read_range(raw, number)


def read_items(raw: Sequence[Any], read: Callable[[Any], Any]) -> tuple[Any, ...]:
    """Read the entries of a list, which must not be empty nor hold a value twice. Raises Invalid."""
    if not raw:
        raise Invalid(Fault("the list is empty: give at least one value", show_value=False))
    items: dict[Any, int] = {}
    faults: list[Fault] = []
    for position, entry in enumerate(raw):
        if len(faults) > MAX_FAULTS:
            break
        try:
            value = read(entry)
        except Invalid as error:
            faults += error.under(position)
            continue
        if items.setdefault(value, position) != position:
            faults.append(Fault("the same value stands in the list twice", (position,)))
    if faults:
        raise Invalid(faults)
    return tuple(items)


def _read_range(raw: Mapping[str, Any], number: ReadNumber) -> Range:
    faults = key_faults(raw, ("start", "stop", "step", "num"), ("start", "stop"), _FORMS)
    if "step" in raw and "num" in raw:
        faults.append(Fault("give 'step' or 'num', not both", ("num",), show_value=False))
    elif not faults and "step" not in raw and "num" not in raw:
        faults.append(Fault("a range needs 'step' or 'num' beside 'start' and 'stop'", show_value=False))
    values = read_parts(raw, {"start": number, "stop": number, "step": number, "num": _count}, faults)
    start, stop = values["start"], values["stop"]
    if "num" in values:
        num = int(values["num"])
        if num == 1 and start != stop:
            raise Invalid(Fault("must be at least 2 where start and stop differ", ("num",)))
        limit, part = None, "num"
    else:
        num, stop, limit = _stepped(start, stop, values["step"])
        part = "step"
    if num > 1 and start == stop:
        raise Invalid(Fault("must differ from start where there is more than one value", ("stop",)))
    if num > 1 and abs(stop - start) / (num - 1) < math.ulp(max(abs(start), abs(stop))):
        raise Invalid(Fault(_TOO_FINE, (part,)))
    return Range(start, stop, num, limit)


def _stepped(start: float, stop: float, step: float) -> tuple[int, float, float | None]:
    """Return the number of values, the last one, and the stop as written where it is not the last one."""
    if step == 0:
        raise Invalid(Fault("must not be zero", ("step",)))
    exact_start, exact_step = Decimal(repr(start)), Decimal(repr(step))
    steps = (Decimal(repr(stop)) - exact_start) / exact_step
    if steps < 0:
        sign = "positive" if stop > start else "negative"
        raise Invalid(Fault(f"has the wrong sign: from {start:.12g} to {stop:.12g} it must be {sign}", ("step",)))
    if steps >= MAX_POINTS:
        raise Invalid(Fault(f"gives more than {MAX_POINTS:.0e} values; is the step too small?", ("step",)))
    whole = int(steps + _ON_STEP)
    if abs(steps - whole) <= _ON_STEP:
        return whole + 1, stop, None
    return whole + 1, float(exact_start + whole * exact_step), stop


def _read_logspace(raw: Any, number: ReadNumber) -> Geometric:
    if not isinstance(raw, Mapping):
        raise Invalid("must be a mapping {start, stop, num}")
    keys = ("start", "stop", "num")
    values = read_parts(
        raw, {"start": number, "stop": number, "num": _count}, key_faults(raw, keys, keys, "it is {start, stop, num}")
    )
    start, stop, num = values["start"], values["stop"], int(values["num"])
    faults = [Fault("must not be zero", (key,)) for key in ("start", "stop") if values[key] == 0]
    if not faults and (start < 0) != (stop < 0):
        faults.append(Fault("must have the sign of start", ("stop",)))
    if (num == 1) != (start == stop):
        needed = "at least 2 where start and stop differ" if num == 1 else "1 where they are equal"
        faults.append(Fault(f"must be {needed}", ("num",)))
    if not faults and num > 1 and abs(math.log(stop / start)) / (num - 1) < 2 * _PRECISION:
        faults.append(Fault(_TOO_FINE, ("num",)))
    if faults:
        raise Invalid(faults)
    return Geometric(start, stop, num)


def key_faults(raw: Mapping[str, Any], known: Sequence[str], required: Sequence[str], form: str) -> list[Fault]:
    """Return what is wrong with the keys of a mapping: unknown ones, and required ones that are missing.

    Parameters
    ----------
    form : str
        How the mapping is written, for the message.
    """
    unknown = [str(key) for key in raw if key not in known][:MAX_FAULTS]
    meant = [nearest(key, known) for key in unknown]
    faults = [
        Fault("unknown key" + (f"; did you mean '{right}'?" if right else ""), (key,), show_value=False)
        for key, right in zip(unknown, meant, strict=True)
    ]
    missing = [f"'{key}'" for key in required if key not in raw and key not in meant]
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        faults.append(Fault(f"{' and '.join(missing)} {verb} missing: {form}", show_value=False))
    return faults


def read_parts(
    raw: Mapping[str, Any], readers: Mapping[str, Callable[[Any], Any]], faults: list[Fault]
) -> dict[str, Any]:
    """Read the parts of a mapping that are there; raise Invalid with `faults` and all that are found on the way."""
    values: dict[str, Any] = {}
    for key in (key for key in readers if key in raw):
        try:
            values[key] = readers[key](raw[key])
        except Invalid as error:
            faults += error.under(key)
    if faults:
        raise Invalid(faults)
    return values


def _count(raw: Any) -> float:
    if isinstance(raw, bool) or not isinstance(raw, int | float) or raw % 1 != 0:
        raise Invalid("must be a whole number")
    if not 1 <= raw <= MAX_POINTS:
        raise Invalid(f"must be between 1 and {MAX_POINTS:.0e}")
    return raw


Number: TypeAlias = float | str
"""A number in the canonical unit of its key, or text with a unit such as ``"1.2 mrad"``."""

Swept: TypeAlias = "dict[str, Number | dict[str, Number]]"
"""Swept values as plain data, as in a study file; a list is one as it is."""


def sweep(start: Number, stop: Number, *, step: Number | None = None, num: int | None = None) -> Swept:
    """Evenly spaced values of a swept key, both ends included where they fall on the step.

    Parameters
    ----------
    start, stop : float or str
        First and last value, in the unit of the key, or with a unit (``"38 ft"``).
    step : float or str, optional
        Distance between values.
    num : int, optional
        Number of values, instead of `step`.

    Returns
    -------
    dict
        ``{start, stop, step}`` or ``{start, stop, num}``, which `study` checks where it stands.

    Examples
    --------
    >>> sweep(0, 60, step=15)
    {'start': 0, 'stop': 60, 'step': 15}
    """
    parts = {"start": start, "stop": stop, "step": step, "num": num}
    return {key: value for key, value in parts.items() if value is not None}


def logspace(start: Number, stop: Number, num: int) -> Swept:
    """Values of a swept key, each in the same ratio to the one before, both ends included.

    Parameters
    ----------
    start, stop : float or str
        First and last value, of one sign, in the unit of the key or with a unit; not exponents: as numpy.geomspace.
    num : int
        Number of values.

    Returns
    -------
    dict
        ``{logspace: {start, stop, num}}``, which `study` checks where it stands.
    """
    return {"logspace": {"start": start, "stop": stop, "num": num}}
