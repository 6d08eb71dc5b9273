"""Sun vectors in the daily windows of a study at one site."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.times import CivilTime
from heliosweep.families.dish_tracking.study import DishTime, Ephemeris
from heliosweep.grid.sun import daily_windows
from heliosweep.kernels.dish import Windows, pack_windows
from heliosweep.kernels.sun.clock import refracted
from heliosweep.sun import sun_vectors

Stamps: TypeAlias = NDArray[np.datetime64]
Sun: TypeAlias = Callable[[Stamps], NDArray[np.float64]]

#: Days are searched for sunrise and sunset in such steps.
SEARCH_STEP = "10 min"


@lru_cache(maxsize=4)  # parts of a site follow each other
def windows_of(
    time: DishTime, ephemeris: Ephemeris, timezone: str, latitude: float, longitude: float, altitude: float
) -> Windows:
    """Sun vectors of the instants that count at a site, window by window; a date without any has no weight.

    Latitude and longitude are positive north and east [deg], the altitude is above sea level [m]; the dates and windows
    are on the clock of the time zone.
    """

    sun = partial(sun_of, ephemeris, latitude, longitude, altitude)
    dates = _sunlit_windows(time, timezone, sun) if time.window.sunlit else daily_windows(time, timezone)
    vectors = sun(np.concatenate(dates))
    starts = np.concatenate([[0], np.cumsum([stamps.size for stamps in dates])])
    return pack_windows(vectors, starts, (vectors[:, 2] > 0).astype(float) if time.daylight_only else None)


def sun_of(
    ephemeris: Ephemeris, latitude: float, longitude: float, altitude: float, utc: Stamps
) -> NDArray[np.float64]:
    """Return unit vectors towards the sun used by the controller: east, north, up; NaN for NaT. [1]"""
    geometric = sun_vectors(utc, latitude, longitude, altitude, ephemeris.delta_t)
    if ephemeris.elevation == "geometric":
        return geometric
    return refracted(geometric, 100 * ephemeris.pressure, ephemeris.temperature)


def _sunlit_windows(time: DishTime, timezone: str, sun: Sun) -> list[Stamps]:
    """Instants between sunrise and sunset of each date, in steps that divide the time evenly.

    On a clock far from the sun's a date may begin and end with the sun up: then both parts are sampled.
    """
    window = {"start": "00:00", "stop": "24:00", "step": SEARCH_STEP}
    search = CivilTime.model_validate({"clock": "civil", "dates": time.dates, "window": window})
    dates = daily_windows(search, timezone)
    bounds = np.cumsum([0, *(stamps.size for stamps in dates)])
    day, stamps = np.repeat(np.arange(len(dates)), np.diff(bounds)), np.concatenate(dates)
    up = sun(stamps)[:, 2] > 0
    change = np.flatnonzero((up[1:] != up[:-1]) & (day[1:] == day[:-1]))
    edges = np.split(_crossings(stamps[change], stamps[change + 1], sun), np.searchsorted(change, bounds[1:-1]))
    found = []
    for own, first, last, inner in zip(dates, bounds, bounds[1:] - 1, edges, strict=False):
        ends = np.concatenate([own[:1][up[first : first + 1]], inner, own[-1:][up[last : last + 1]]]).reshape(-1, 2)
        parts = [_sampled(rise, set_, time) for rise, set_ in ends]
        found.append(np.concatenate(parts) if parts else own[:0])
    return found


def _crossings(before: Stamps, after: Stamps, sun: Sun) -> Stamps:
    """Return the instants at which the sun crosses the geometric horizon, between two instants on either side of it."""
    from scipy.optimize.elementwise import find_root

    span = (after - before).astype(np.float64)

    def height(share: NDArray[np.float64], before: NDArray[np.float64], span: NDArray[np.float64]) -> Any:
        stamps = before.astype("datetime64[ns]") + np.round(share * span).astype("timedelta64[ns]")
        return sun(stamps)[:, 2]

    shares = find_root(height, (np.zeros(span.size), np.ones(span.size)), args=(before.astype(np.int64), span)).x
    return before + np.round(shares * span).astype("timedelta64[ns]")


def _sampled(start: np.datetime64, stop: np.datetime64, time: DishTime) -> Stamps:
    span = (stop - start).astype(np.int64)
    steps = max(1, round(span / (time.window.step * 3600e9)))
    positions = np.arange(steps + 1.0) if time.sampling == "inclusive" else np.arange(float(steps))
    if time.sampling == "midpoint":
        positions += 0.5
    return start + np.round(positions * (span / steps)).astype("timedelta64[ns]")
