"""What a study looked at, in words: dates, hours, heliostats and the mean elevation of the sun."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr

from heliosweep.config.study import Study
from heliosweep.config.times import CivilTime, SolarTime, WeatherTime
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.sun import PLACE, Suns
from heliosweep.report.labels import DEGREE, number_text
from heliosweep.store.coverage import FEW, dates, hours, months

#: Suns up to which all are averaged; of more, so many evenly picked instants of each place. [1]
MOST_SUNS, PICKED = 2_000_000, 5_000

#: Said of a sun that is always below the horizon.
NEVER = "never above the horizon"


def coverage(result: xr.Dataset, study: Study | None) -> list[tuple[str, str]]:
    """Pairs of a name and what a result covers; without the study, what the result alone tells."""
    time = getattr(study, "time", None)
    found = []
    if "site" in result.coords and result["site"].ndim:
        names = [str(name) for name in result["site"].to_numpy()]
        found.append(("sites", ", ".join(names) if len(names) <= FEW else f"{len(names):,}, {names[0]} to {names[-1]}"))
    if isinstance(time, SolarTime | CivilTime):
        found += [("dates", dates(time)), ("hours", hours(time))]
    elif isinstance(time, WeatherTime):
        found += [
            ("months", months(time)),
            ("hours", "those of the weather file, the sun at the middle of each lit part"),
        ]
    if "heliostat" in result.sizes and "evaluation" not in result.sizes:  # of a search, each evaluation may have others
        count = result.sizes["heliostat"]
        found.append(("heliostats", f"{'up to ' * ('layout' in result.dims)}{count:,}"))
    if isinstance(time, SolarTime | CivilTime) and study is not None:
        found.append(("mean elevation of the sun", _elevation(study)))
    elif "sun_elevation" in result.coords:
        found.append(("mean elevation of the sun", _ends(np.atleast_1d(result["sun_elevation"].to_numpy()))))
    return found


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
