"""Swept values for studies that are built in Python: the forms of a study file, as plain data."""

from __future__ import annotations

from typing import TypeAlias

Number: TypeAlias = float | str
"""A number in the canonical unit of its key, or text with a unit such as ``"1.2 mrad"``."""

Swept: TypeAlias = "dict[str, Number | dict[str, Number]]"
"""What stands for swept values in a study, as in a study file; a list is one as it is."""


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
