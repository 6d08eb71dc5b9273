"""Angles of the two axes of a heliostat's mount that follow the sun, their ranges and rates.

Both mounts orient the normal n = unit(s + r), with the directions r to the receiver and s to the sun:

- azimuth-elevation: the primary angle is the azimuth of n, from north, clockwise; the secondary its elevation;
- spinning-elevation: the primary angle is the spin about r, 0 with the sun above r in the vertical plane of r,
  positive with the sun to the right of it, seen from the heliostat; the secondary is the tilt of n from r, which is
  the angle of incidence. Chong and Tan (2012), Section 2.1.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.times import CivilTime
from heliosweep.grid.sun import Instants
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION

#: Squared sine below which a direction is along the primary axis, as in the kernel: the primary angle is then any.
_ALONG = 1e-30


def courses(hours: Floats, longest: float, sun: Floats) -> NDArray[np.int64]:
    """Number the courses of instants: the successive instants of one day with the sun above the horizon.

    The instants are at `hours` [h], shape (T,), with the sun along `sun`, shape (T, 3). A course ends if time steps
    back, as from one solar day to the next, or by more than `longest` [h], or if the sun is down; an instant with the
    sun down begins one.
    """
    up, step = sun[:, 2] > 0, np.diff(hours)
    begins = ~((step > 0) & (step <= longest * (1 + 1e-6)) & up[:-1] & up[1:])
    return np.concatenate([[0], np.cumsum(begins)])


def tracking_angles(to_target: Floats, sun: Floats, tracking: int) -> Floats:
    """Primary and secondary angle of one mount, within one turn.

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
        Azimuth (0 to 360) and elevation of the normal, or spin (-180 to 180) and tilt. NaN with the sun at or below the
        horizon; of the primary angle also where the normal is along the primary axis. [deg]
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
    primary[across**2 < _ALONG] = np.nan
    return np.stack([primary, secondary])


def motion(angle: Floats, course: NDArray[np.int64], hours: Floats) -> tuple[float, float, float, float]:
    """Range of motion of an axis, and its maximum rate.

    Within a course the angle takes the shorter way between instants, and may exceed a full turn. Between two courses,
    overnight, the axis may rotate by whole turns: the range is the smallest range that contains all courses. The rate
    is the change between two successive instants of a course over the time between them: a mean over this step.

    Parameters
    ----------
    angle : ndarray, shape (T,)
        From `tracking_angles`; NaN is omitted. [deg]
    course : ndarray of int, shape (T,)
        From `courses`.
    hours : ndarray, shape (T,)
        Time of each instant, rising within a course. [h]

    Returns
    -------
    low, high, span : float
        Ends of the range, the lower one from -180 on and below 180, and their difference; NaN without any angle. [deg]
    rate : float
        Maximum absolute value; NaN if no course has two instants. [deg/h]
    """
    known = np.flatnonzero(np.isfinite(angle))
    if not known.size:
        return np.nan, np.nan, np.nan, np.nan
    angle, course, hours = angle[known], course[known], hours[known]
    moves = np.concatenate([[False], np.diff(course) == 0])
    steps = np.where(moves, (np.diff(angle, prepend=0.0) + 180.0) % 360.0 - 180.0, 0.0)
    first = np.flatnonzero(~moves)
    way = np.cumsum(steps)
    way += np.repeat(angle[first] - way[first], np.diff(first, append=angle.size))
    lows, highs = np.minimum.reduceat(way, first), np.maximum.reduceat(way, first)
    # Each course begins its range within a turn of the lowest one; the lowest may be any of them.
    turns = np.floor((lows + 180.0) / 360.0) * 360.0
    order = np.argsort(lows - turns, kind="stable")
    lows, highs = (lows - turns)[order], (highs - turns)[order]
    after = np.maximum.accumulate(highs[::-1])[::-1]
    before = np.concatenate([[-np.inf], np.maximum.accumulate(highs)[:-1] + 360.0])
    spans = np.maximum(after, before) - lows
    best = int(np.argmin(spans))
    rates = np.abs(steps[moves]) / np.diff(hours, prepend=0.0)[moves]
    low, span = float(lows[best]), float(spans[best])
    return low, low + span, span, float(rates.max()) if rates.size else np.nan


def hours_of(instants: Instants, time: Any) -> tuple[Floats, float]:
    """Return times of the instants at a site, and the longest step between two that follow each other in a day. [h]"""
    if "utc" not in instants.labels:
        return instants.labels["solar_hour"].values, np.inf
    stamps = instants.labels["utc"].values
    longest = time.window_seconds()[2] / 3600 if isinstance(time, CivilTime) else instants.labels["hours"].values.max()
    return (stamps - stamps[0]) / np.timedelta64(1, "h"), float(longest)


def angles_of(aims: Floats, sun: Floats, tracking: int, hours: tuple[Floats, float] | None, series: bool) -> Floats:
    """Angles of mounts, the last axis: at each instant, over the period where `hours` are given, or at the only one."""
    course = None if hours is None else courses(*hours, sun)
    pairs = [tracking_angles(aim, sun, tracking) for aim in aims]
    if hours is not None and course is not None:
        return np.stack([np.concatenate([motion(each, course, hours[0]) for each in pair]) for pair in pairs], axis=-1)
    return np.stack([pair if series else pair[:, 0] for pair in pairs], axis=-1)
