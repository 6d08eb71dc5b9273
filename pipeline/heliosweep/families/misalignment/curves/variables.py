"""The variables of the mode `curves`: names, CF attributes and what each means, in the order of the file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.families.misalignment.instants import instant_sizes
from heliosweep.families.misalignment.spots import spot_variables, swept_dims
from heliosweep.grid.regions import Variable

if TYPE_CHECKING:
    from heliosweep.families.misalignment.study import MisalignmentStudy

#: Coefficients of a deviation curve.
COEFFICIENTS = ("A", "B", "C", "D", "E", "F")

#: Of each curve: whatever the size of the error.
_CURVES: dict[str, dict[str, Any]] = {
    "tracking_tolerance": {
        "units": "mrad",
        "long_name": "smallest error, of either sign, with which the spot leaves the aperture",
        "comment": "infinite where it never does; missing where the aligned heliostat has no spot",
    },
    "conic": {
        "units": "1",
        "long_name": "coefficients of the deviation curve A Y2 + B Y Z + C Z2 + D Y + E Z + F = 0",
        "comment": (
            "Y = spot_y and Z = spot_z in m, divided by A, or by the coefficient of the largest magnitude where A is "
            "zero; missing where the curve is no conic: with offsets that the error swings, and about the axis of the "
            "encoder"
        ),
    },
    "eccentricity": {
        "units": "1",
        "long_name": "eccentricity of the deviation curve",
        "comment": "below 1 an ellipse, above 1 a hyperbola",
    },
    "focus_y": {
        "units": "m",
        "long_name": "focus of the deviation curve within its real branch, to the right of the aim point",
    },
    "focus_z": {
        "units": "m",
        "long_name": "focus of the deviation curve within its real branch, above the aim point",
    },
}
_LEAST: dict[str, Any] = {
    "units": "mrad",
    "long_name": "least tolerance of all days and hours",
    "comment": "infinite where the spot never leaves the aperture; missing where there never is a spot",
}
_DAY_OF_LEAST: dict[str, dict[str, Any]] = {
    "day": {"units": "1", "long_name": "day of the year of the least tolerance"},
    "declination": {"units": "degree", "long_name": "declination of the sun at the least tolerance"},
    "date": {"long_name": "local date of the least tolerance"},
}
_HOUR_OF_LEAST: dict[str, Any] = {"units": "h", "long_name": "hour of the least tolerance"}
_FIRST = {"comment": "the first of several; missing where the least tolerance is infinite or missing"}

#: Where a curve crosses the detectors.
_CROSSINGS: dict[str, dict[str, Any]] = {
    "crossing_y": {
        "units": "m",
        "long_name": "crossing of the deviation curve and a line of detectors, to the right of the aim point",
        "comment": "of several, that of the smallest error; missing where there is none",
    },
    "crossing_z": {
        "units": "m",
        "long_name": "crossing of the deviation curve and a line of detectors, above the aim point",
        "comment": "of several, that of the smallest error; missing where there is none",
    },
    "crossing_error": {
        "units": "mrad",
        "long_name": "error with which the spot lies on a line of detectors",
        "comment": "the smallest, of either sign; missing where there is none",
    },
}


def size_dims(study: MisalignmentStudy) -> tuple[str, ...]:
    """The swept dimension along which only the size of the error varies; empty where there is none."""
    return tuple(dim.name for dim in study.dimensions() if set(dim.sweeps) == {"error.size"})


def variables(study: MisalignmentStudy) -> dict[str, Variable]:
    """Variables of a study's result; what belongs to a whole curve does not vary with the size of the error."""
    alone = size_dims(study)
    curve = (*(dim for dim in swept_dims(study) if dim not in alone), "heliostat")
    day, hour = instant_sizes(study)
    instants = (*curve, day, hour)
    found = spot_variables(study) | {name: Variable(instants, attrs) for name, attrs in _CURVES.items()}
    found["conic"] = Variable((*instants, "conic_coefficient"), _CURVES["conic"])
    found["least_tolerance"] = Variable(curve, _LEAST)
    if study.time is not None:
        dtype = np.dtype("datetime64[ns]" if day == "date" else np.float64)
        found[f"{day}_of_least_tolerance"] = Variable(curve, _DAY_OF_LEAST[day] | _FIRST, dtype)
        found["hour_of_least_tolerance"] = Variable(curve, _HOUR_OF_LEAST | _FIRST)
    if study.detectors is not None:
        found |= {name: Variable((*instants, "detector"), attrs) for name, attrs in _CROSSINGS.items()}
    return found
