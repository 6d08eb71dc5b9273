"""What points of a result share: efficiencies of the same mirrors under the same sun, and intercepts of the same light.

Draws and sweeps of reflectivity, dirt, irradiance, limits and errors of the mirrors leave shading and blocking as they
are; all but the last leave the intercept. What is known of a field is kept for the points that follow.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.field import efficiency
from heliosweep.layouts.layout import Layout

Mirrors = tuple[Floats, Floats, Floats, Floats, Floats, float | Floats, int]
"""Arguments of `efficiency.sorted_field`, and code of the tracking method."""
SortedMirrors = tuple[efficiency.SortedField, int]
"""First arguments of `efficiency.field_sums`."""

#: Points whose intercepts are kept.
_LIGHTS = 2
#: What is kept of a heliostat and instant, half of these lit; and of a field at the most. [bytes]
BYTES, MOST_BYTES = 8 * (4 // 2 + _LIGHTS), 128 * 2**20


class _Held(NamedTuple):
    """Efficiencies of some heliostats at the instants that were looked at."""

    sun: Floats
    """Unit vectors to the sun, shape (T, 3); NaN where nothing is known."""
    row: NDArray[np.int64]
    """Row of each instant in `values`."""
    values: Floats
    """As `efficiency.known_energies` takes them, shape (N, R, 4)."""


class SharedField(NamedTuple):
    """A field, and what is kept of it by the first of some heliostats and the one after the last."""

    layout: Layout
    mirrors: bytes
    energies: dict[tuple[int, int], _Held]
    lights: dict[tuple[int, int, int], list[tuple[Floats, tuple[Any, ...], Any]]]


def energies(
    field: SharedField,
    mirrors: SortedMirrors,
    sun: Floats,
    start: int,
    stop: int,
    weight: Floats,
    period: NDArray[np.int64],
    periods: int,
    part: Floats | None,
) -> Floats:
    """`efficiency.field_energies`, of which efficiencies that are known are not computed again."""
    up = sun[:, 2] > 0.0
    held = field.energies.get((start, stop))
    if held is None or len(held.sun) != len(sun) or not _same(held.sun, sun, up):
        nowhere = np.full(sun.shape, np.nan)
        held = _Held(nowhere, np.zeros(len(sun), np.int64), np.empty((stop - start, 0, 4)))
    missing = np.flatnonzero(up & np.isnan(held.sun[:, 2]))
    if missing.size:
        found = efficiency.field_series(*mirrors, sun[missing], start, stop)
        there, row, count = held.sun.copy(), held.row.copy(), held.values.shape[1]
        there[missing], row[missing] = sun[missing], np.arange(count, count + missing.size)
        values = np.concatenate([held.values, found.transpose(2, 1, 0)], axis=1)
        field.energies[start, stop] = held = _Held(there, row, np.ascontiguousarray(values))
    return efficiency.known_energies(held.values, held.row, sun, weight, period, periods, part)


def intercept(
    field: SharedField, sun: Floats, start: int, stop: int, values: tuple[Any, ...], compute: Callable[[], Any]
) -> Any:
    """What `compute` returns, kept for points with the same sun and `values`."""
    key = (start, stop, len(sun))
    last = field.lights.get(key, [])
    for there, given, found in last:
        if given == values and np.array_equal(there, sun, equal_nan=True):
            return found
    found = compute()
    field.lights[key] = [(sun, values, found), *last][:_LIGHTS]
    return found


def _same(known: Floats, sun: Floats, up: NDArray[np.bool_]) -> bool:
    """Whether the sun is where it was at all instants that are known."""
    both = up & ~np.isnan(known[:, 2])
    return np.array_equal(known[both], sun[both])
