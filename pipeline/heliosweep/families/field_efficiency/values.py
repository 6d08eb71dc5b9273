"""Irradiation and energies of a field, its size, and the values of its heliostats without optics.

The energy of a heliostat is

    E = area * sum of DNI dt * cosine * (1 - shaded or blocked) * reflectivity * cleanliness * transmittance * intercept

over the instants with the sun up and all values within the limits: one product before the sum. The losses are the steps
of this product, each relative to the previous step; their sum is the incident minus the received energy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.energy import MEGA, energy_losses, monthly_sums
from heliosweep.families.field_efficiency.variables import (
    DESIGN,
    EFFICIENCIES,
    MONTHS,
    SERIES,
)
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.sun import PLACE, Suns
from heliosweep.grid.weather import LIMITS, Weathers, used
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.field import efficiency

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.chain import Geometry
    from heliosweep.families.field_efficiency.optics import FacetGrid
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy


#: Direction to the sun at instants at which a field does not work: below the horizon.
_DOWN = (0.0, 0.0, -1.0)


class Hours(NamedTuple):
    """Irradiation and irradiance of the instants of a place, shape (T,) each."""

    #: Unit vectors to the sun, shape (T, 3); below the horizon where the field does not work. [1]
    sun: Floats
    #: Direct normal irradiance with the sun up, also where the field does not work; NaN if padded. [W m-2]
    dni: Floats
    #: Irradiation over the interval; 0 where the field does not work. [MWh m-2]
    weight: Floats
    #: From 0.
    month: NDArray[np.int64]
    #: Irradiation of each month with the sun up, shape (12,). [MWh m-2]
    incident: Floats
    #: Irradiation with the sun up where the field does not work. [MWh m-2]
    stowed: float
    #: Hours in which the field works, and those lost to each limit, shape (3,). [h]
    used: float
    lost: Floats


class Days:
    """Sun and irradiance at the points of a region, as `grid.sun.Suns` has the sun."""

    def __init__(self, parameters: Parameters, suns: Suns) -> None:
        self._suns, self._weathers = suns, Weathers(parameters)

    def at(self, index: tuple[int, ...], place: Sequence[float | None], limits: Sequence[float | None]) -> Hours:
        """What the instants bring at a point, from its index and the values of `PLACE` and `LIMITS`."""
        sun, air = self._suns.at(index, place), self._weathers.at(index, place)
        works, cause = used(air, sun, limits)
        dni = np.where(sun[:, 2] > 0, air.dni, 0.0)
        energy, month = dni * air.hours * MEGA, air.month - 1
        incident = monthly_sums(energy, month, MONTHS)
        lost = monthly_sums(air.hours[cause >= 0], cause[cause >= 0], len(LIMITS))
        there, hours = np.where(works[:, np.newaxis], sun, _DOWN), float(air.hours[works].sum())
        weight, stowed = np.where(works, energy, 0.0), float(energy[~works].sum())
        dni[np.isnan(sun[:, 2])] = np.nan  # a site with fewer instants than another one
        return Hours(there, dni, weight, month, incident, stowed, hours, lost)


def totals(values: Floats, area: Floats) -> Floats:
    """Return sums over the heliostats, the last dimension; padding (area 0) does not affect their bits.

    Values with further dimensions, such as months, are summed along the heliostats only.
    """
    inner = values.shape[area.ndim - 1 : -1]
    found = np.zeros((*area.shape[:-1], *inner))
    for index in np.ndindex(area.shape[:-1]):
        found[index] = np.ascontiguousarray(values[index][..., area[index] > 0]).sum(axis=-1)
    return found


def energies_of_field(parameters: Parameters, computed: Any, area: Floats) -> dict[str, Floats]:
    """Return energies of whole fields and the ranks of their heliostats."""
    made: dict[str, Any] = {
        f"field_{name}_energy": totals(computed[f"{name}_energy"].to_numpy(), area) for name in ("receiver", "incident")
    }
    made["monthly_receiver_energy"] = totals(computed["heliostat_monthly_receiver_energy"].to_numpy(), area)
    made["loss"] = totals(computed["heliostat_loss"].to_numpy(), area)
    mirrors = area.sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        each = np.where(area > 0, computed["receiver_energy"].to_numpy() / area, np.nan)
        made["field_energy_per_mirror_area"] = made["field_receiver_energy"] / mirrors
    rank = np.full(area.shape, np.nan)
    shape, days = area.shape[:-1], Days(parameters, Suns(parameters))
    made |= {"energy_per_mirror_area": each, "rank": rank, "hours_used": np.zeros(shape)}
    made |= {"monthly_incident_energy": np.zeros((*shape, MONTHS)), "hours_lost": np.zeros((*shape, len(LIMITS)))}
    for index, place, limits in _points(parameters):
        there = np.flatnonzero((area[index] > 0) & bool(made["field_receiver_energy"][index] > 0))
        rank[index][there[np.argsort(-each[index][there], kind="stable")]] = np.arange(1, len(there) + 1)
        hours = days.at(index, place, limits)
        made["monthly_incident_energy"][index] = mirrors[index] * hours.incident
        made["hours_used"][index], made["hours_lost"][index] = hours.used, hours.lost
    return made


def _points(parameters: Parameters) -> Iterator[tuple[tuple[int, ...], tuple[Any, ...], tuple[Any, ...]]]:
    """Every point of a region: its index, and the values of `PLACE` and of `LIMITS`."""
    for index, given in parameters.points(*PLACE, *LIMITS):
        yield index, given[: len(PLACE)], given[len(PLACE) :]


Values = dict[str, Floats]


class Field(NamedTuple):
    """A field without optics at a point of the result, by exact polygons.

    Its methods return values by the names of variables, heliostats last. They are values of heliostats start..stop,
    shaded and blocked by all.
    """

    study: FieldEfficiencyStudy
    #: Centres x, y, z, half width and height, points that the mirrors aim at [m], and code of the tracking.
    mirrors: Geometry
    #: Mirrors and code of the tracking method, as the kernels of shading take them.
    sorted: tuple[efficiency.SortedField, int]
    #: Of each mirror. [m2]
    area: Floats
    #: Values of `grid.sun.PLACE`.
    place: Sequence[float | None]

    def means(self, sun: Floats, start: int, stop: int) -> Values:
        """Means over the instants with the sun up, all of the same weight."""
        sums, count = efficiency.field_sums(*self.sorted, sun, start, stop)
        means = (sums / count if count else np.full_like(sums, np.nan)).T
        return dict(zip(EFFICIENCIES, means, strict=True))

    def energies(self, hours: Hours, start: int, stop: int) -> Values:
        """Means weighted by the irradiation, and energies. [1, MWh]"""
        months = efficiency.field_energies(*self.sorted, hours.sun, start, stop, hours.weight, hours.month, MONTHS)
        year = np.zeros((5, stop - start))
        for month in range(MONTHS):  # in this order, however heliostats are split
            year += months[:, month].T
        cosine, _, _, optical, unshaded = year
        divisor = hours.weight.sum() or np.nan
        left = (cosine, unshaded, optical, optical, optical, optical)
        return dict(zip(EFFICIENCIES, year[:4] / divisor, strict=True)) | chain_of_energies(
            hours, self.area[start:stop], left, months[:, :, 3].T
        )

    def series(self, sun: Floats, part: slice, hours: Hours | None, start: int, stop: int) -> Values:
        """Values at a part of the instants along `sun`; with `hours` also the power. [1, kW]"""
        values = efficiency.field_series(*self.sorted, sun[part], start, stop)
        return dict(zip(SERIES, values, strict=True)) | powers(values[-1], hours, part, self.area[start:stop])

    def design(self, start: int, stop: int) -> Values:
        """Values at the design point. [1]"""
        assert self.study.design_point is not None
        assert self.place[0] is not None
        values = efficiency.field_series(*self.sorted, self.study.design_point.sun(self.place[0]), start, stop)
        return dict(zip(DESIGN, values[:, 0], strict=False))


def chain_of_energies(hours: Hours, area: Floats, left: Sequence[Floats], monthly: Floats) -> Values:
    """Energies of heliostats: incident, received, received in each month, and lost at each stage. [MWh]

    Parameters
    ----------
    hours : Hours
        Irradiation of the instants.
    area : ndarray, shape (n,)
        Area of each mirror. [m2]
    left : sequence of ndarray, shape (n,)
        Energy per mirror area that is left after each stage from cosine to spillage. [MWh m-2]
    monthly : ndarray, shape (months, n)
        Received energy per mirror area in each month. [MWh m-2]
    """
    used = hours.weight.sum()
    return {
        "incident_energy": area * (used + hours.stowed),
        "receiver_energy": area * left[-1],
        "heliostat_monthly_receiver_energy": area * monthly,
        "heliostat_loss": area * energy_losses(used + hours.stowed, (used, *left)),
    }


def powers(efficiency: Floats, hours: Hours | None, part: slice, area: Floats) -> Values:
    """Power of heliostats at a part of the instants, by an efficiency of shape (T, n); without `hours` none. [kW]"""
    if hours is None:
        return {}
    return {"instantaneous_power": np.nan_to_num(efficiency) * (hours.dni[part, np.newaxis] * 1e-3) * area}


def means_of_field(pieces: Sequence[Values], areas: Sequence[Floats]) -> Values:
    """Return means of a field weighted by mirror area, from the series of blocks of heliostats; of powers the sum."""
    whole, found = sum(float(area.sum()) for area in areas), {}
    for name in pieces[0] if pieces else ():
        power = name == "instantaneous_power"
        weighted = (piece[name] * (1.0 if power else area) for piece, area in zip(pieces, areas, strict=True))
        total = sum(np.ascontiguousarray(each).sum(axis=-1) for each in weighted)
        found["field_power" if power else f"field_{name}"] = 1e-3 * total if power else total / whole
    return found


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
