"""What a study looked at, in words: dates, hours, heliostats and the mean elevation of the sun."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.config.study import Study
from heliosweep.config.times import CivilTime, DateRange, SolarTime, WeatherTime
from heliosweep.grid.clock import window_count
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.sun import PLACE, Suns
from heliosweep.report.labels import DEGREE, number_text

#: Suns up to which all are averaged; of more, so many evenly picked instants of each place. [1]
MOST_SUNS, PICKED = 2_000_000, 5_000

#: Said of a sun that is always below the horizon.
NEVER = "never above the horizon"

#: Dates that are listed one by one.
FEW = 4


def sampled(result: xr.Dataset, study: Study | None) -> list[tuple[str, str]]:
    """Pairs of a name and what a result covers; without the study, what the result alone tells."""
    time = getattr(study, "time", None)
    found = []
    if isinstance(time, SolarTime | CivilTime):
        found = [("dates", _dates(time)), ("hours", _hours(time))]
    elif isinstance(time, WeatherTime):
        months = "all" if time.months is None else ", ".join(f"{month:g}" for month in time.months.values())
        found = [("months", months), ("hours", "those of the weather file, the sun at the middle of each lit part")]
    if "heliostat" in result.sizes and "evaluation" not in result.sizes:  # of a search, each evaluation may have others
        count = result.sizes["heliostat"]
        found.append(("heliostats", f"{'up to ' * ('layout' in result.dims)}{count:,}"))
    if isinstance(time, SolarTime | CivilTime) and study is not None:
        found.append(("mean elevation of the sun", _elevation(study)))
    elif "sun_elevation" in result.coords:
        found.append(("mean elevation of the sun", _ends(np.atleast_1d(result["sun_elevation"].to_numpy()))))
    return found


def _dates(time: SolarTime | CivilTime) -> str:
    if isinstance(time, CivilTime):
        dates = list(map(str, time.date_list()))
        if len(dates) <= FEW:
            return ", ".join(dates)
        step = time.dates.step if isinstance(time.dates, DateRange) else 0
        each = {0: "", 1: ", every day"}.get(step, f", every {step} days")
        return f"{dates[0]} to {dates[-1]}{each}: {len(dates)} dates"
    declinations = time.declinations()
    values = time.day_numbers() if declinations is None else declinations
    end = "" if len(values) == 1 else "s"
    what = f"day{end} of the year" if declinations is None else f"declination{end} of the sun ({DEGREE})"
    texts = [number_text(float(value), 0 if float(value).is_integer() else 2) for value in values]
    return f"{what} {', '.join(texts) if len(texts) <= FEW else f'{texts[0]} to {texts[-1]}: {len(texts)}'}"


def _hours(time: SolarTime | CivilTime) -> str:
    if isinstance(time, SolarTime):
        hours = time.solar_hours()
        span = " to ".join(dict.fromkeys(f"{hour:g}" for hour in (hours[0], hours[-1]))) if hours.size else ""
        return f"{span} h on the solar clock, {hours.size} {_each(hours.size)}, sampling {time.sampling}"
    window: Any = time.window
    every = f"every {window.step * 60:g} min"
    if getattr(window, "sunlit", False):
        return f"sunrise to sunset, about {every}, sampling {time.sampling}"
    start, stop, step = time.window_seconds()
    count = window_count((stop - start) / step, time.sampling)
    zone = f" ({time.timezone})" if time.timezone else ""
    return f"{window.start} to {window.stop}{zone}, {every}, {count} {_each(count)}, sampling {time.sampling}"


def _each(count: int) -> str:
    return "instant a day" if count == 1 else "instants a day"


def _elevation(study: Study) -> str:
    """Mean over the instants with the sun above the horizon, and over places its range."""
    parameters = Parameters(study)
    one = Parameters(study, {dim: slice(0, 1) for dim in parameters.sizes if dim not in parameters.site_dims})
    suns = Suns(one)
    if suns.size * math.prod(one.sizes.values()) > MOST_SUNS:
        suns = Suns(one, PICKED)
    means = []
    for index, place in one.points(*PLACE):
        up = suns.at(index, place)[:, 2]
        up = up[up > 0]
        means.append(float(np.degrees(np.arcsin(np.minimum(up, 1.0))).mean()) if up.size else math.nan)
    found = _ends(np.array(means))
    return f"{found}, while it is above the horizon" if found != NEVER else found


def _ends(values: np.ndarray) -> str:
    known = values[np.isfinite(values)]
    if not known.size:
        return NEVER
    ends = dict.fromkeys(number_text(float(end), 1) for end in (known.min(), known.max()))
    return " to ".join(f"{end}{DEGREE}" for end in ends)
