"""Energy of a field on its receiver: irradiation of each instant, and losses.

The energy of a heliostat is

    E = area * sum of DNI dt * cosine * (1 - shaded or blocked) * reflectivity * cleanliness * transmittance * intercept

over the instants with the sun up and all values within the limits: one product before the sum. The losses are the steps
of this product, each relative to the previous step; their sum is the incident minus the received energy.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.energy import MEGA, monthly_sums
from heliosweep.families.field_efficiency.variables import MONTHS
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.sun import PLACE, Suns
from heliosweep.grid.weather import LIMITS, Weathers, used
from heliosweep.kernels.arrays import Floats

#: Direction to the sun at instants at which a field does not work: below the horizon.
_DOWN = (0.0, 0.0, -1.0)


class Hours(NamedTuple):
    """Irradiation and irradiance of the instants of a place, shape (T,) each."""

    sun: Floats
    """Unit vectors to the sun, shape (T, 3); below the horizon where the field does not work. [1]"""
    dni: Floats
    """Direct normal irradiance with the sun up, also where the field does not work; NaN if padded. [W m-2]"""
    weight: Floats
    """Irradiation over the interval; 0 where the field does not work. [MWh m-2]"""
    month: NDArray[np.int64]
    """From 0."""
    incident: Floats
    """Irradiation of each month with the sun up, shape (12,). [MWh m-2]"""
    stowed: float
    """Irradiation with the sun up where the field does not work. [MWh m-2]"""
    used: float
    """Hours in which the field works, and those lost to each limit, shape (3,). [h]"""
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


def of_field(parameters: Parameters, computed: Any, area: Floats) -> dict[str, Floats]:
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
    for index, place, limits in points(parameters):
        there = np.flatnonzero((area[index] > 0) & bool(made["field_receiver_energy"][index] > 0))
        rank[index][there[np.argsort(-each[index][there], kind="stable")]] = np.arange(1, len(there) + 1)
        hours = days.at(index, place, limits)
        made["monthly_incident_energy"][index] = mirrors[index] * hours.incident
        made["hours_used"][index], made["hours_lost"][index] = hours.used, hours.lost
    return made


def points(parameters: Parameters) -> Iterator[tuple[tuple[int, ...], tuple[Any, ...], tuple[Any, ...]]]:
    """Every point of a region: its index, and the values of `PLACE` and of `LIMITS`."""
    for index, given in parameters.points(*PLACE, *LIMITS):
        yield index, given[: len(PLACE)], given[len(PLACE) :]
