"""Variables of a result: names, CF attributes and definitions, in the order of the file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.grid.parameters import Parameters
from heliosweep.grid.regions import BEST_VALUE, LARGEST, SMALLEST, Variable

if TYPE_CHECKING:
    from heliosweep.families.dish_tracking.study import DishTrackingStudy

_INSTANTS = "{}: {} (over the instants of the window that count)"
_FACTOR = (
    "one minus the mean tracking error over the tolerance; 1 for perfect tracking, negative where the mean error "
    "is larger than the tolerance (unless the study clips each error at it)"
)


def _factor(long_name: str, cell_methods: str) -> dict[str, Any]:
    best = SMALLEST if "standard deviation" in long_name else LARGEST
    return {"units": "1", "long_name": long_name, "comment": _FACTOR, "cell_methods": cell_methods, BEST_VALUE: best}


def _error(long_name: str, method: str) -> dict[str, Any]:
    return {
        "units": "mrad",
        "long_name": long_name,
        "comment": "angle between the directions to the sun and of the focal axis",
        "cell_methods": _INSTANTS.format("date", method),
        BEST_VALUE: SMALLEST,
    }


_DAILY = _INSTANTS.format("date", "mean")
# Without the dimension, CF knows the dates by the standard name of their axis.
_OVER_DATES = f"{_INSTANTS.format('time', 'mean')} time: "

#: Per date.
DAILY: dict[str, dict[str, Any]] = {
    "effective_tracking_factor": _factor("effective tracking factor of a day", _DAILY),
    "mean_tracking_error": _error("mean tracking error of a day", "mean"),
    "max_tracking_error": _error("largest tracking error of a day", "maximum"),
}

#: Per site and date.
WINDOW: dict[str, dict[str, Any]] = {
    "window_is_empty": {
        "long_name": "whether no instant of the date counts, as in the polar night with daylight only",
        "units": "1",
        "flag_values": np.array([0, 1], dtype=np.int8),
        "flag_meanings": "window_has_instants window_is_empty",
        "comment": "tracking factors of empty windows are missing",
    }
}

#: Over the directions of the tilt, per date.
DIRECTIONS: dict[str, dict[str, Any]] = {
    "effective_tracking_factor_mean_over_directions": _factor(
        "mean over the directions of the effective tracking factor of a day", _DAILY
    ),
    "effective_tracking_factor_std_over_directions": _factor(
        "sample standard deviation over the directions of the effective tracking factor of a day",
        _DAILY,
    ),
}

#: Over all dates.
ALL_DATES: dict[str, dict[str, Any]] = {
    "effective_tracking_factor_mean_over_dates": _factor(
        "mean over the dates of the effective tracking factor", f"{_OVER_DATES}mean (over the dates)"
    ),
    "effective_tracking_factor_std_over_dates": _factor(
        "sample standard deviation over the dates of the effective tracking factor",
        f"{_OVER_DATES}standard_deviation (over the dates, n - 1)",
    ),
    "effective_tracking_factor_min": _factor(
        "least effective tracking factor of all dates", f"{_OVER_DATES}minimum (over the dates)"
    ),
    "effective_tracking_factor_max": _factor(
        "largest effective tracking factor of all dates", f"{_OVER_DATES}maximum (over the dates)"
    ),
}

#: The dates on which the extremes fall, the first one where several tie.
EXTREMES: dict[str, dict[str, Any]] = {
    "date_of_min": {"long_name": "date of the least effective tracking factor"},
    "date_of_max": {"long_name": "date of the largest effective tracking factor"},
}

#: Per month.
MONTHLY: dict[str, dict[str, Any]] = {
    "monthly_effective_tracking_factor_mean": _factor(
        "mean over the dates of a month of the effective tracking factor", f"{_OVER_DATES}mean (within months)"
    ),
    "monthly_effective_tracking_factor_std": _factor(
        "sample standard deviation over the dates of a month of the effective tracking factor",
        f"{_OVER_DATES}standard_deviation (within months, n - 1)",
    ),
}

#: Per month, over the directions of the tilt.
MONTHLY_DIRECTIONS: dict[str, dict[str, Any]] = {
    "monthly_effective_tracking_factor_mean_over_directions": _factor(
        "mean over the directions of the monthly mean of the effective tracking factor",
        f"{_OVER_DATES}mean (within months)",
    ),
    "monthly_effective_tracking_factor_std_over_directions": _factor(
        "sample standard deviation over the directions of the monthly mean of the effective tracking factor",
        f"{_OVER_DATES}mean (within months)",
    ),
}

#: Per instant: of each mount, and of the sun alone.
ERRORS: dict[str, dict[str, Any]] = {
    "tracking_error": {
        "units": "mrad",
        "long_name": "tracking error at each instant",
        "comment": "angle between the directions to the sun and of the focal axis; missing at instants left out",
        BEST_VALUE: SMALLEST,
    },
}
SUN: dict[str, dict[str, Any]] = {
    "solar_elevation": {
        "units": "degree",
        "standard_name": "solar_elevation_angle",
        "long_name": "elevation of the sun at each instant",
    },
    "solar_azimuth": {
        "units": "degree",
        "standard_name": "solar_azimuth_angle",
        "long_name": "azimuth of the sun at each instant",
        "comment": "from north, clockwise",
    },
}

#: Over directions and dates: which direction to fear.
WORST: dict[str, dict[str, Any]] = {
    "worst_axis_tilt_direction": {
        "units": "degree",
        "long_name": "direction of the tilt with the least mean effective tracking factor over the dates",
        "comment": "direction in which the foot of the azimuth axis leans: 0 south, 90 west",
    },
}

#: Solved for, not read off the grid.
TOLERABLE: dict[str, dict[str, Any]] = {
    "tolerable_axis_tilt": {
        "units": "degree",
        "long_name": "largest tilt of the azimuth axis whose least daily tracking factor is at least the required one",
        "comment": ("zero if no tilt is tolerable; missing if 45 degrees are tolerable, or if no date has a factor"),
        BEST_VALUE: LARGEST,
    },
}


def directed(study: DishTrackingStudy) -> bool:
    """Return True if the direction of the tilt is swept separately, so that statistics over it have a meaning."""
    return any(set(dim.sweeps) == {"errors.axis_tilt_direction"} for dim in study.dimensions())


def variables(study: DishTrackingStudy) -> dict[str, Variable]:
    """Return the variables of a study, with statistics over several directions and dates."""
    parameters = Parameters(study)
    mount = tuple(dim for dim in parameters.sizes if dim not in parameters.site_dims)
    direction, dates = ("axis_tilt_direction",), len(study.time.date_list()) > 1
    both = dates and directed(study)
    tables: list[tuple[bool, dict[str, dict[str, Any]], str, str, bool, tuple[str, ...]]] = [
        (True, DAILY, "date", "float64", False, ()),
        (True, WINDOW, "date", "int8", False, mount),
        (directed(study), DIRECTIONS, "date", "float64", True, direction),
        (dates, ALL_DATES, "", "float64", True, ()),
        (dates, EXTREMES, "", "datetime64[ns]", True, ()),
        (dates, MONTHLY, "month", "float64", True, ()),
        (both, MONTHLY_DIRECTIONS, "month", "float64", True, direction),
        (both, WORST, "", "float64", True, direction),
        (study.statistics is not None, TOLERABLE, "required_factor", "float64", False, ("axis_tilt",)),
        (study.output.time_series, ERRORS, "time", "float64", False, ()),
        (study.output.time_series, SUN, "time", "float64", False, mount),
    ]
    return {
        name: Variable((dim,) if dim else (), attrs, np.dtype(dtype), finished, without=without)
        for wanted, table, dim, dtype, finished, without in tables
        if wanted
        for name, attrs in table.items()
    }
