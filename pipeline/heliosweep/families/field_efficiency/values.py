"""Values of some heliostats of a field: means and energies over the instants, at each instant, at a design point.

And the size of a field: mirrors, and the land that they take; Chong and Tan (2012), Table 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.families.field_efficiency import known
from heliosweep.families.field_efficiency.chain import Light, Way, light
from heliosweep.families.field_efficiency.energy import Hours
from heliosweep.families.field_efficiency.variables import (
    CHECKED,
    DESIGN,
    EFFICIENCIES,
    LIGHT,
    LIGHT_SERIES,
    MONTHS,
    SERIES,
)
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.field import efficiency

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.optics import FacetGrid
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy

Values = dict[str, Floats]


class Field(NamedTuple):
    """The field at a point of the result; its methods give values by the names of variables, heliostats last.

    They are of heliostats start..stop, shaded and blocked by all.
    """

    study: FieldEfficiencyStudy
    mirrors: known.Mirrors
    """With `optics` with the aim of each in place of the target's height."""
    sorted: known.SortedMirrors
    """The same as the kernels of shading take them."""
    area: Floats
    """Of each mirror. [m2]"""
    place: Sequence[float | None]
    """Values of `grid.sun.PLACE`."""
    months: NDArray[np.int64] | None
    """Month of each instant, from 0, where cleanliness depends on it."""
    way: Way | None
    """Way of the light, where the study follows it."""
    shared: known.SharedField | None = None
    """What is known of it from other points."""

    def light(self, sun: Floats, start: int, stop: int, months: NDArray[np.int64] | None) -> Light | None:
        """What is left of the light on its way to the receiver; None where a study does not follow it."""
        if self.way is None:
            return None
        lit = light(self.way, self.mirrors, sun, self.place, months, start, stop, self.shared)
        return lit._replace(reflected=np.broadcast_to(lit.reflected, len(sun)))

    def means(self, sun: Floats, start: int, stop: int) -> Values:
        """Means over the instants with the sun up, all of the same weight."""
        lit = self.light(sun, start, stop, self.months)
        part = None
        if lit is not None:
            part = np.outer(lit.transmitted, lit.reflected)
            part *= lit.intercept
        sums, count = efficiency.field_sums(*self.sorted, sun, start, stop, part)
        means = (sums / count if count else np.full_like(sums, np.nan)).T
        values = dict(zip(EFFICIENCIES, means[:4], strict=True))
        if lit is not None:
            intercept = np.nansum(lit.intercept, axis=1) / (count or np.nan)
            reflected = _mean(lit.reflected, (sun[:, 2] > 0).astype(float), stop - start)
            values |= zip(LIGHT, (intercept, lit.transmitted, reflected, means[4]), strict=True)
            values[CHECKED] = lit.error
        return values

    def energies(self, hours: Hours, lit: Light | None, start: int, stop: int) -> Values:
        """Means weighted by the irradiation, and energies, with what `light` gives for these hours. [1, MWh]"""
        passed = np.ones(stop - start) if lit is None else lit.transmitted
        weights = np.stack((hours.weight, hours.weight if lit is None else hours.weight * lit.reflected))
        part = None if lit is None else lit.intercept
        given = (hours.sun, start, stop, weights, hours.month, MONTHS, part)
        if self.shared is None:
            mirrors, tracking = self.sorted
            months = efficiency.field_energies(mirrors, tracking, *given)
        else:
            months = known.energies(self.shared, self.sorted, *given)
        year = np.zeros((7, stop - start))
        for month in range(MONTHS):  # in this order, however heliostats are split
            year += months[:, month].T
        cosine, _, _, optical, unshaded, reflected, received = year
        used = hours.weight.sum()
        incident = used + hours.stowed
        divisor = used or np.nan
        values = dict(zip(EFFICIENCIES, year[:4] / divisor, strict=True))
        if lit is not None:
            intercept = np.nansum(lit.intercept * hours.weight, axis=1) / divisor
            means = (intercept, passed, _mean(lit.reflected, hours.weight, stop - start), passed * received / divisor)
            values |= zip(LIGHT, means, strict=True)
            values[CHECKED] = lit.error
        # Left after each stage, of the incident energy; what it takes is the difference to the one before.
        left = (incident, used, cosine, unshaded, optical, reflected, passed * reflected, passed * received)
        area, steps = self.area[start:stop], np.stack(np.broadcast_arrays(*left))
        return values | {
            "incident_energy": area * incident,
            "receiver_energy": area * steps[-1],
            "heliostat_monthly_receiver_energy": area * passed * months[:, :, 6].T,
            "heliostat_loss": area * (steps[:-1] - steps[1:]),
        }

    def series(self, sun: Floats, part: slice, hours: Hours | None, start: int, stop: int) -> Values:
        """Values at a part of the instants along `sun`, which are all; with `hours` also the power. [1, kW]"""
        lit = self.light(sun, start, stop, self.months)
        values = list(efficiency.field_series(*self.sorted, sun[part], start, stop))
        if lit is not None:
            kept = lit.intercept[:, part] * np.outer(lit.transmitted, lit.reflected[part])
            values += [lit.intercept[:, part].T, values[3] * kept.T]
        found = dict(zip((*SERIES, *LIGHT_SERIES), values, strict=lit is not None))
        if hours is not None:
            irradiance = hours.dni[part, np.newaxis] * 1e-3
            found["instantaneous_power"] = np.nan_to_num(values[-1]) * irradiance * self.area[start:stop]
        return found

    def design(self, start: int, stop: int) -> Values:
        """Values at the design point. [1]"""
        assert self.study.design_point is not None
        assert self.place[0] is not None
        point = self.study.design_point
        sun = point.sun(self.place[0])
        values = efficiency.field_series(*self.sorted, sun, start, stop)[:, 0]
        lit = self.light(sun, start, stop, np.array([point.month()]))
        if lit is None:
            return dict(zip(DESIGN, values, strict=False))
        reflected = np.full(stop - start, lit.reflected[0])
        total = values[3] * (lit.intercept[:, 0] * (lit.transmitted * reflected))
        return dict(zip(DESIGN, (*values, lit.intercept[:, 0], lit.transmitted, reflected, total), strict=True))


def _mean(values: Floats, weights: Floats, count: int) -> Floats:
    """Weighted mean over the instants, for each of some heliostats; of equal values their value, to the last bit."""
    same = not values.size or np.all(values == values[0])
    mean = values[0] if same else np.sum(values * weights) / (np.sum(weights) or np.nan)
    return np.full(count, mean)


class FieldSums:
    """Values of the whole field at some instants, from those of its heliostats, block by block."""

    def __init__(self) -> None:
        self._sums: Values = {}
        self._area = 0.0

    def add(self, values: Values, area: Floats) -> None:
        """Add the heliostats of a block, with their series and areas."""
        for name, each in values.items():
            weighted = np.ascontiguousarray(each if name == "instantaneous_power" else each * area)
            self._sums[name] = self._sums.get(name, 0.0) + weighted.sum(axis=-1)
        self._area += float(area.sum())

    def means(self) -> Values:
        """Means weighted by mirror area, with the names of the field's variables; of powers the sum. [1, MW]"""
        sums = dict(self._sums)
        power = sums.pop("instantaneous_power", None)
        found = {f"field_{name}": each / self._area for name, each in sums.items()}
        return found if power is None else {**found, "field_power": power * 1e-3}


def at_instants(sun: Floats, hours: Hours | None, part: slice) -> Values:
    """Direction of the sun at instants [deg], NaN where it is down; the irradiance, at a part of all. [W m-2]"""
    x, y, z = np.where(sun[:, 2:] > 0, sun, np.nan).T
    elevation = np.degrees(np.arctan2(z, np.hypot(x, y)))
    found = {"sun_azimuth": np.degrees(np.arctan2(x, y)) % 360.0, "sun_elevation": elevation}
    return found if hours is None else {**found, "dni": hours.dni[part]}


def mirror_area(width: Floats, height: Floats, facets: FacetGrid | None) -> Floats:
    """Area of mirrors of some width and height, without the gaps between their facets. [m2]"""
    if facets is None:
        return width * height
    return (width - (facets.columns - 1) * facets.gap) * (height - (facets.rows - 1) * facets.gap)


def land_area(x: Floats, y: Floats, radius: float) -> float:
    """Area within the line that runs `radius` [m] outside the convex hull of the centres, at x and y [m]. [m2]"""
    from shapely import convex_hull, get_coordinates, multipoints

    hull = convex_hull(multipoints(np.stack((x, y), axis=1)))
    corners = get_coordinates(hull)
    around = np.hypot(*(corners - np.roll(corners, 1, axis=0)).T).sum()  # of a line there and back
    return float(hull.area + radius * around + math.pi * radius**2)
