"""The period that a result covers: in words, and as attributes by ACDD."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from heliosweep.config.study import Study
from heliosweep.config.times import CivilTime, SolarTime, WeatherTime
from heliosweep.grid.clock import window_count

#: Dates that are listed one by one.
FEW = 4


def attributes(study: Study) -> Iterator[tuple[str, str]]:
    """Attributes of the dates that are looked at, of a study on the civil clock; the solar clock has none.

    The resolution is the step of the instants of each day, as they are sampled.
    """
    time: Any = getattr(study, "time", None)
    if not isinstance(time, CivilTime):
        return
    found = sorted(time.date_list())
    yield "time_coverage_start", found[0].isoformat()
    yield "time_coverage_end", found[-1].isoformat()
    yield "time_coverage_duration", f"P{(found[-1] - found[0]).days + 1}D"
    window: Any = time.window
    seconds = round(3600 * window.step)
    yield "time_coverage_resolution", f"PT{seconds}S" if seconds % 60 else f"PT{seconds // 60}M"


def summary(about: str, study: Study) -> str:
    """Return subject and period of a study on one line; no period without a clock."""
    said, time = " ".join(about.split()), getattr(study, "time", None)
    if isinstance(time, SolarTime | CivilTime):
        period = dates(time)
    elif isinstance(time, WeatherTime):
        period = f"{'all months' if time.months is None else f'months {months(time)}'} of the weather file"
    else:
        return said
    return f"{said.rstrip('.')}. Period: {period}."


def months(time: WeatherTime) -> str:
    """Months that a study with a weather file looks at."""
    return "all" if time.months is None else ", ".join(f"{month:g}" for month in time.months.values())


def dates(time: SolarTime | CivilTime) -> str:
    """Dates, days of the year or declinations of the sun that a study looks at."""
    if isinstance(time, CivilTime):
        listed = list(map(str, time.date_list()))
        if len(listed) <= FEW:
            return ", ".join(listed)
        each = {0: "", 1: ", every day"}.get(time.dates.step, f", every {time.dates.step} days")
        return f"{listed[0]} to {listed[-1]}{each}: {len(listed)} dates"
    declinations = time.declinations()
    values = time.day_numbers() if declinations is None else declinations
    end = "" if len(values) == 1 else "s"
    what = f"day{end} of the year" if declinations is None else f"declination{end} of the sun (\N{DEGREE SIGN})"
    texts = [f"{float(value):.6g}".replace("-", "\N{MINUS SIGN}") for value in values]
    return f"{what} {', '.join(texts)}" if len(texts) <= FEW else f"{len(texts)} {what}, {texts[0]} to {texts[-1]}"


def hours(time: SolarTime | CivilTime) -> str:
    """Hours of each day, and how they are sampled."""
    if isinstance(time, SolarTime):
        found = time.solar_hours()
        span = " to ".join(dict.fromkeys(f"{hour:g}" for hour in (found[0], found[-1]))) if found.size else ""
        return f"{span} h on the solar clock, {found.size} {_each(found.size)}, sampling {time.sampling}"
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
