"""Selection of heliostats: ranked in the whole field, then the best are kept."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.families.field_efficiency.energy import Hours
from heliosweep.families.field_efficiency.traced import RANKING, TracedField
from heliosweep.families.field_efficiency.values import Field
from heliosweep.families.field_efficiency.variables import DESIGN, EFFICIENCIES
from heliosweep.kernels.arrays import Floats
from heliosweep.layouts.layout import Layout


class Kept(NamedTuple):
    """Selected heliostats of a layout."""

    rows: NDArray[np.int64]
    """Their rows in the layout, rising."""
    rank: NDArray[np.int64]
    """Rank of each heliostat of the layout, from 1."""


def ranked_values(
    by: str, field: Field | TracedField, sun: Floats, hours: Hours | None, blocks: Iterable[tuple[int, int]]
) -> Floats:
    """Return the result by which heliostats of a whole field are ranked, one of `BY`, shape (heliostat,)."""
    found = []
    for start, stop in blocks:
        if by in DESIGN:
            values = field.design(start, stop)
        elif hours is None:
            values = field.means(sun, start, stop)
        else:
            values = field.energies(hours, start, stop)
            values["energy_per_mirror_area"] = values["receiver_energy"] / field.area[start:stop]
        found.append(values[by])
    return np.concatenate(found)


def design_power(field: Field | TracedField) -> float:
    """Power of a whole field at the design point. [MW]"""
    assert field.study.design_point is not None
    values = field.design(0, field.area.size)
    total = values[DESIGN[-1] if isinstance(field, TracedField) else DESIGN[len(EFFICIENCIES) - 1]]
    return float(np.sum(total * field.area)) * field.study.design_point.dni * 1e-6


def best(
    values: Floats, number: float | None, power: float | None, power_of: Callable[[NDArray[np.int64]], float]
) -> Kept:
    """The best heliostats of a field.

    Parameters
    ----------
    values : ndarray, shape (heliostat,)
        By which they are ranked, the largest first and, of equal ones, the first; NaN comes last.
    number, power : float, optional
        How many are kept; or the power that is wanted, in the unit of `power_of`.
    power_of : callable
        Power of the heliostats with some rows, without the others.

    Returns
    -------
    Kept
        All where the whole field has less power. For a power the best k, which have it, where the best k - 1 have not;
        k follows from halving the number of heliostats again and again.
    """
    order = np.argsort(-values, kind="stable")
    rank = np.empty(order.size, np.int64)
    rank[order] = np.arange(1, order.size + 1)
    low, high = 0, order.size if power is not None else min(int(number or 0), order.size)
    while power is not None and high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if power_of(np.sort(order[:middle])) >= power else (middle, high)
    return Kept(np.sort(order[:high]), rank)


def select(
    wanted: Sequence[Any],
    layout: Layout,
    field_of: Callable[[Layout], Field | TracedField],
    sun: Floats,
    hours: Hours | None,
    blocks: Iterable[tuple[int, int]],
) -> Kept:
    """Heliostats of a layout that are kept at a point of the result.

    `wanted` are the values of `keep.heliostats`, `keep.field_power` and `keep.by`; `field_of` makes the field of a
    layout, and the others are parameters of `ranked_values`. Heliostats are ranked with fewer rays than the result has.
    """
    number, power, by = wanted
    whole = field_of(layout)
    if isinstance(whole, TracedField):
        whole = whole._replace(coarse=RANKING)
    values = ranked_values(by, whole, sun, hours, blocks)
    return best(values, number, power, lambda rows: design_power(field_of(layout.part(rows))))
