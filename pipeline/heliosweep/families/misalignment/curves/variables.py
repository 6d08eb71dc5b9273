"""The variables of the mode `curves`: names, CF attributes and what each means, in the order of the file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from heliosweep.families.misalignment.points import instant_sizes, swept_dims
from heliosweep.families.misalignment.spots import SIDES, spot_variables
from heliosweep.grid.regions import Variable, pair, quantity, with_best

if TYPE_CHECKING:
    from heliosweep.families.misalignment.study import MisalignmentStudy

#: Coefficients of a deviation curve.
COEFFICIENTS = ("A", "B", "C", "D", "E", "F")

_INFINITE = "infinite where the spot never leaves the aperture; missing where there never is a spot"
_FIRST = "the first of several; missing where the least tolerance is infinite or missing"
_CROSSED = "of several, that of the smallest error; missing where there is none"


def size_dims(study: MisalignmentStudy) -> tuple[str, ...]:
    """The swept dimension along which only the size of the error varies; empty where there is none."""
    return tuple(dim.name for dim in study.dimensions() if set(dim.sweeps) == {"error.size"})


def variables(study: MisalignmentStudy) -> dict[str, Variable]:
    """Variables of a study's result; what belongs to a whole curve does not vary with the size of the error."""
    alone = size_dims(study)
    curve = (*(dim for dim in swept_dims(study) if dim not in alone), "heliostat")
    day, hour = instant_sizes(study)
    instants = (*curve, day, hour)
    found = spot_variables(study) | {
        "tracking_tolerance": quantity(
            instants,
            "mrad",
            "smallest error, of either sign, with which the spot leaves the aperture",
            "infinite where it never does; 0 where errors of the mount have it outside without; missing where the "
            "heliostat has no spot without the error",
        ),
        "conic": quantity(
            (*instants, "conic_coefficient"),
            "1",
            "coefficients of the deviation curve A Y2 + B Y Z + C Z2 + D Y + E Z + F = 0",
            "Y = spot_y and Z = spot_z in m, divided by A, or by the coefficient of the largest magnitude where A is "
            "zero; missing where the curve is no conic: with offsets that the error swings, and about the axis of the "
            "encoder",
        ),
        "eccentricity": quantity(
            instants, "1", "eccentricity of the deviation curve", "below 1 an ellipse, above 1 a hyperbola"
        ),
    }
    found |= pair("focus_%", SIDES, instants, "m", "focus of the deviation curve within its real branch, %")
    if study.beam is not None:
        dims = (*swept_dims(study), "heliostat", day, hour)
        comment = "of a beam from the mirror's centre"
        found |= pair("outline_%", SIDES, (*dims, "outline"), "m", "outline of the spot of the beam, %", comment)
        meaning = "edge of the trace that the beam draws while the error changes, %"
        found |= pair("edge_%", SIDES, (*dims, "edge"), "m", meaning)
    found["least_tolerance"] = quantity(curve, "mrad", "least tolerance of all days and hours", _INFINITE)
    if study.time is not None:
        of_least = {
            "day": quantity(curve, "1", "day of the year of the least tolerance", _FIRST),
            "declination": quantity(curve, "degree", "declination of the sun at the least tolerance", _FIRST),
            "date": Variable(
                curve, {"long_name": "local date of the least tolerance", "comment": _FIRST}, np.dtype("datetime64[ns]")
            ),
        }
        found[f"{day}_of_least_tolerance"] = of_least[day]
        found["hour_of_least_tolerance"] = quantity(curve, "h", "hour of the least tolerance", _FIRST)
    if study.detectors is not None:
        lines = (*instants, "detector")
        meaning = "crossing of the deviation curve and a line of detectors, %"
        found |= pair("crossing_%", SIDES, lines, "m", meaning, _CROSSED)
        meaning = "error with which the spot lies on a line of detectors"
        comment = "the smallest, of either sign; missing where there is none"
        found["crossing_error"] = quantity(lines, "mrad", meaning, comment)
    return with_best(found, ("tracking_tolerance", "least_tolerance"))
