"""Irradiation, energy and size of a field, and heliostat results without ray tracing.

The energy of a heliostat is

    E = area * sum of DNI dt * cosine * (1 - shaded or blocked) * reflectivity * cleanliness * transmittance * intercept

summed over the instants with the sun up and all operating limits met. Factors are multiplied at each instant before
summation. Each loss is the decrease from one partial product to the next. The losses therefore add up to the incident
energy minus the received energy.

Both mounts point the normal along n = unit(s + r), where r and s are the directions to the receiver and to the sun:

- azimuth-elevation: the primary angle is the azimuth of n, clockwise from north, and the secondary angle is the
  elevation of n;
- spinning-elevation: the primary angle is the spin about r. The spin is 0 if the sun is above r in the vertical plane
  containing r, and positive if the sun is to the right of this plane, seen from the heliostat. The secondary angle is
  the tilt of n from r, which is the angle of incidence (Chong and Tan 2012, Section 2.1).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config import CivilTime
from heliosweep.energy import MEGA, energy_losses, monthly_sums
from heliosweep.families.field_efficiency.losses import Available
from heliosweep.families.field_efficiency.variables import (
    EFFICIENCIES,
    MONTHS,
    PRODUCT,
    SERIES,
)
from heliosweep.grid import CAUSES, Instants, used
from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.field import efficiency
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.traced import Geometry
    from heliosweep.grid.weather import Irradiance


#: Sun direction below the horizon, used at instants when the field does not operate.
DOWN = (0.0, 0.0, -1.0)


class Hours(NamedTuple):
    """Irradiation and irradiance at a site. Values for each instant have the shape (T,)."""

    #: Unit vectors to the sun, shape (T, 3); below the horizon if the field does not operate. [1]
    sun: Floats
    #: Direct normal irradiance with the sun up, even if the field does not operate; NaN for padding. [W m-2]
    dni: Floats
    #: Irradiation over the interval; 0 if the field does not operate. [MWh m-2]
    weight: Floats
    #: Month of each instant, counted from 0.
    month: NDArray[np.int64]
    #: Irradiation with the sun up in each month, shape (12,). [MWh m-2]
    incident: Floats
    #: Irradiation while the sun is up but the field does not operate. [MWh m-2]
    stowed: float
    #: Irradiation while the sun is below the site's horizon; None without a horizon. [MWh m-2]
    hidden: float | None
    #: Hours during which the field operates, and hours lost to each cause, shape (causes,). [h]
    used: float
    lost: Floats

    @classmethod
    def of(cls, sun: Floats, air: Irradiance, limits: Sequence[float | None], below: NDArray[np.bool_] | None) -> Hours:
        """Return the irradiation at a site.

        `limits` contains the values of `LIMITS`. `below` is True at instants with the sun below the site's horizon.
        """
        works, cause = used(air, sun, limits)
        if below is not None:
            works, cause = works & ~below, np.where(below, len(CAUSES), cause)
        dni = np.where(sun[:, 2] > 0, air.dni, 0.0)
        energy, month, out, causes = (
            dni * air.hours * MEGA,
            air.month - 1,
            cause >= 0,
            len(CAUSES) + (below is not None),
        )
        stowed, behind = (~works, None) if below is None else (~works & ~below, float(energy[below].sum()))
        lost = monthly_sums(air.hours[out], cause[out], causes)
        there, hours = np.where(works[:, np.newaxis], sun, DOWN), float(air.hours[works].sum())
        dni[np.isnan(sun[:, 2])] = np.nan  # padded instants of a site with fewer instants than other sites
        return cls(there, dni, np.where(works, energy, 0.0), month, monthly_sums(energy, month, MONTHS),
                   float(energy[stowed].sum()), behind, hours, lost)  # fmt: skip

    @property
    def length(self) -> Floats:
        """Lengths of the intervals; 0 if the field does not operate. [h]"""
        return np.divide(self.weight, self.dni * MEGA, out=np.zeros_like(self.weight), where=self.weight > 0.0)


Values = dict[str, Floats]


class Field(NamedTuple):
    """Field without optics at a result point, computed with exact polygons.

    Each method returns a mapping from variable names to values, with heliostats on the last axis. The values are for
    heliostats `start` to `stop` - 1, which any heliostat of the field can shade or block.
    """

    study: Any
    #: Mirror centres (x, y, z), half widths, half heights and aim points, all in m, and the code of the tracking
    #: method.
    mirrors: Geometry
    #: Mirrors sorted for the shading kernels, and the code of the tracking method.
    sorted: tuple[efficiency.SortedField, int]
    #: Area of each mirror. [m2]
    area: Floats
    #: Values of `grid.sun.PLACE`.
    place: Sequence[Any]
    #: Availability of the heliostats; None if they always operate.
    available: Available | None = None
    #: Values of `aiming.VARIABLES`; empty without optics.
    aims: Mapping[str, Any] = {}

    def means(self, sun: Floats, start: int, stop: int, point: object = None) -> Values:
        """Return unweighted means over the instants with the sun up."""
        sums, count = efficiency.field_sums(*self.sorted, sun, start, stop)
        means = (sums / count if count else np.full_like(sums, np.nan)).T
        return dict(zip((*EFFICIENCIES, PRODUCT), means, strict=True))

    def energies(self, hours: Hours, start: int, stop: int) -> Values:
        """Return irradiation-weighted means [1] and energies [MWh]."""
        months = efficiency.field_energies(*self.sorted, hours.sun, start, stop, hours.weight, hours.month, MONTHS)
        year = np.zeros((7, stop - start))
        for month in range(MONTHS):  # the summation order is independent of the split into heliostat blocks
            year += months[:, month].T
        cosine, _, _, optical, unshaded, product, past = year
        divisor = hours.weight.sum() or np.nan
        tower = [] if self.study.tower is None else [past]
        left = (cosine, *tower, unshaded, optical, optical, optical, optical)
        means = dict(zip(EFFICIENCIES, year[:4] / divisor, strict=True)) | {PRODUCT: product / divisor}
        found = means | chain_of_energies(hours, self.area[start:stop], left, months[:, :, 3].T)
        if self.available is None:
            return found
        return self.available.apply(self._replace(available=None), hours, found, start, stop)

    def series(self, sun: Floats, part: slice, hours: Hours | None, start: int, stop: int) -> Values:
        """Return the values at the instants in `part`, including power if `hours` is given. [1, kW]"""
        values = efficiency.field_series(*self.sorted, sun[part], start, stop)
        found = dict(zip(SERIES, values, strict=True))
        if hours is not None:
            power = hours.dni[part, np.newaxis] * 1e-3
            found["instantaneous_power"] = np.nan_to_num(values[-1]) * power * self.area[start:stop]
        return found


def chain_of_energies(hours: Hours, area: Floats, left: Sequence[Floats], monthly: Floats) -> Values:
    """Return heliostat energies: incident, received, received in each month, and lost at each stage. [MWh]

    Parameters
    ----------
    hours : Hours
        Irradiation at the instants.
    area : ndarray, shape (n,)
        Area of each mirror. [m2]
    left : sequence of ndarray, shape (n,)
        Remaining energy per mirror area after each stage from cosine to spillage, with the tower as a stage if the
        study has a tower. [MWh m-2]
    monthly : ndarray, shape (months, n)
        Received energy per mirror area in each month. [MWh m-2]
    """
    used = hours.weight.sum()
    seen = used + hours.stowed
    incident, left = (seen, (used, *left)) if hours.hidden is None else (seen + hours.hidden, (seen, used, *left))
    return {
        "incident_energy": area * incident,
        "receiver_energy": area * left[-1],
        "heliostat_monthly_receiver_energy": area * monthly,
        "heliostat_loss": area * energy_losses(incident, left),
    }


def land_area(x: Floats, y: Floats, radius: float) -> float:
    """Return the area [m2] of the convex hull of the centres x, y [m], enlarged on all sides by `radius` [m]."""
    from shapely import convex_hull, multipoints

    hull = convex_hull(multipoints(np.stack((x, y), axis=1)))
    around = hull.length * (1 if hull.area else 2)  # the hull of collinear centres is a line with two sides
    return float(hull.area + radius * around + math.pi * radius**2)


def tracking_angles(to_target: Floats, sun: Floats, tracking: int) -> Floats:
    """Return the primary and secondary angles of one mount, each within one turn.

    Parameters
    ----------
    to_target : ndarray, shape (3,)
        Unit vector from the mirror's centre to the receiver: east, north, up. [1]
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun. [1]
    tracking : int
        `packets.SPINNING_ELEVATION` or `packets.AZIMUTH_ELEVATION`.

    Returns
    -------
    ndarray, shape (2, T)
        Azimuth (0 to 360) and elevation of the normal, or spin (-180 to 180) and tilt. NaN if the sun is at or below
        the horizon. The primary angle is also NaN if the normal is along the primary axis. [deg]
    """
    s = np.where(sun[:, 2:] > 0, sun, np.nan).T
    rx, ry, rz = to_target
    if tracking == AZIMUTH_ELEVATION:
        x, y, z = s + to_target[:, np.newaxis]
        across = np.hypot(x, y)
        primary, secondary = np.degrees(np.arctan2(x, y)) % 360.0 % 360.0, np.degrees(np.arctan2(z, across))
        across = across / np.sqrt(across**2 + z**2)
    else:
        level = np.hypot(rx, ry)
        east, north = (rx / level, ry / level) if level > 0 else (0.0, 1.0)
        right = north * s[0] - east * s[1]
        above = level * s[2] - rz * (east * s[0] + north * s[1])
        across = np.hypot(right, above)
        primary = np.degrees(np.arctan2(right, above))
        secondary = np.degrees(np.arctan2(across, to_target @ s)) / 2
    primary[across**2 < 1e-30] = np.nan
    return np.stack([primary, secondary])


def motion(angle: Floats, course: NDArray[np.int64], hours: Floats) -> tuple[float, float, float, float, float]:
    """Return the range of motion of an axis, its maximum rate, and its travel.

    Within a course, the axis rotates by the smaller angle between successive instants, and its angle may exceed a full
    turn. Between two courses (overnight), the axis may rotate by whole turns. The range is therefore the smallest range
    that contains all courses. The rate between two successive instants of a course is the change of the angle divided
    by the time between these instants.

    Parameters
    ----------
    angle : ndarray, shape (T,)
        Angles from `tracking_angles`; NaN is ignored. [deg]
    course : ndarray of int, shape (T,)
        Number of the course that contains each instant; see `angles_of`.
    hours : ndarray, shape (T,)
        Time of each instant, ascending within a course. [h]

    Returns
    -------
    low, high, span : float
        Ends of the range and their difference. The lower end is at least -180 and below 180. All three values are NaN
        if there are no angles. [deg]
    rate : float
        Maximum absolute rate; NaN if no course contains two instants. [deg/h]
    travel : float
        Sum of the absolute changes within the courses, excluding the overnight return. [deg]
    """
    known = np.flatnonzero(np.isfinite(angle))
    if not known.size:
        return np.nan, np.nan, np.nan, np.nan, np.nan
    angle, course, hours = angle[known], course[known], hours[known]
    moves = np.concatenate([[False], np.diff(course) == 0])
    steps = np.where(moves, (np.diff(angle, prepend=0.0) + 180.0) % 360.0 - 180.0, 0.0)
    first = np.flatnonzero(~moves)
    way = np.cumsum(steps)
    way += np.repeat(angle[first] - way[first], np.diff(first, append=angle.size))
    lows, highs = np.minimum.reduceat(way, first), np.maximum.reduceat(way, first)
    # Each course is tried as the course with the lowest range. The ranges of all other courses then begin within one
    # turn above this range.
    turns = np.floor((lows + 180.0) / 360.0) * 360.0
    order = np.argsort(lows - turns, kind="stable")
    lows, highs = (lows - turns)[order], (highs - turns)[order]
    after = np.maximum.accumulate(highs[::-1])[::-1]
    before = np.concatenate([[-np.inf], np.maximum.accumulate(highs)[:-1] + 360.0])
    spans = np.maximum(after, before) - lows
    best = int(np.argmin(spans))
    rates = np.abs(steps[moves]) / np.diff(hours, prepend=0.0)[moves]
    low, span = float(lows[best]), float(spans[best])
    return low, low + span, span, float(rates.max()) if rates.size else np.nan, float(np.abs(steps).sum())


def angles_of(aims: Floats, sun: Floats, tracking: int, instants: Instants | None, series: bool, time: Any) -> Floats:
    """Return the motion of the mounts over `instants`, or the mount angles if `instants` is None.

    Mounts are on the last axis. The angles are for all instants if `series` is True, otherwise for the first instant. A
    course is a run of successive instants on one day with the sun above the horizon. It ends if the time decreases (as
    from one solar day to the next) or increases by more than the maximum step of the block `time`.
    """
    pairs = [tracking_angles(aim, sun, tracking) for aim in aims]
    if instants is None:
        return np.stack([pair if series else pair[:, 0] for pair in pairs], axis=-1)
    labels, longest = {name: label.values for name, label in instants.labels.items()}, np.inf
    if "utc" in labels:
        hours = (labels["utc"] - labels["utc"][0]) / np.timedelta64(1, "h")
        longest = float(time.window_seconds()[2] / 3600 if isinstance(time, CivilTime) else labels["hours"].max())
    else:
        hours = labels["solar_hour"]
    up, step = sun[:, 2] > 0, np.diff(hours)
    begins = ~((step > 0) & (step <= longest * (1 + 1e-6)) & up[:-1] & up[1:])
    course = np.concatenate([[0], np.cumsum(begins)])
    return np.stack([np.concatenate([motion(each, course, hours) for each in pair]) for pair in pairs], axis=-1)
