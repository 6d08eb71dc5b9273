"""The variables of a result: names, CF attributes and what each means, in the order of the file."""

from __future__ import annotations

from typing import Any

import numpy as np

from heliosweep.kernels import receiver

#: Status of heliostats that there are not, where a shorter layout is padded.
NO_HELIOSTAT = -1

_STATUS = {
    NO_HELIOSTAT: "no_heliostat",
    receiver.REACHES: "reaches_the_plane",
    receiver.MISSES: "ray_misses_the_plane_or_back_of_the_mirror_is_lit",
    receiver.BEHIND_FACE: "mirror_on_or_behind_the_plane",
    receiver.NO_SUN: "sun_below_the_horizon",
    receiver.BLIND_CONE: "mount_cannot_point_there",
    receiver.TOO_NEAR: "offsets_not_smaller_than_the_distance",
}
_SEEN = "for someone in the field who looks at the receiver; missing where spot_status is not 0"


def flag(long_name: str, no: str, yes: str, comment: str = "") -> dict[str, Any]:
    """Attributes of a variable that is 0 or 1."""
    return {
        "units": "1",
        "long_name": long_name,
        "flag_values": np.array([0, 1], dtype=np.int8),
        "flag_meanings": f"{no} {yes}",
    } | ({"comment": comment} if comment else {})


#: The spot on the plane of the receiver, at each instant.
SPOTS: dict[str, dict[str, Any]] = {
    "spot_y": {
        "units": "m",
        "long_name": "spot on the receiver's plane, to the right of the aim point",
        "comment": f"to the right {_SEEN}",
    },
    "spot_z": {
        "units": "m",
        "long_name": "spot on the receiver's plane, above the aim point",
        "comment": f"up along the face {_SEEN}",
    },
}

#: What becomes of the ray, at each instant; int8.
FLAGS: dict[str, dict[str, Any]] = {
    "spot_status": {
        "units": "1",
        "long_name": "whether there is a spot, and why not",
        "flag_values": np.array(list(_STATUS), dtype=np.int8),
        "flag_meanings": " ".join(_STATUS.values()),
    },
    "is_real": flag("whether the reflected ray reaches the receiver's plane", "no_spot", "spot"),
    "inside": flag("whether the spot lies in the aperture", "outside_or_no_spot", "inside"),
}

#: Over the hours of a day.
HITS: dict[str, dict[str, Any]] = {
    "hit_fraction": {
        "units": "1",
        "long_name": "part of the hours with sun in which the spot lies in the aperture",
        "comment": "missing on days without sun and where there is no heliostat",
        "cell_methods": "time: mean (over the hours with sun)",
        "valid_range": [0.0, 1.0],
    }
}

#: Of each curve: whatever the size of the error.
TOLERANCES: dict[str, dict[str, Any]] = {
    "tolerance": {
        "units": "mrad",
        "long_name": "smallest error, of either sign, with which the spot leaves the aperture",
        "comment": "infinite where it never does; missing where the aligned heliostat has no spot",
    }
}
CONICS: dict[str, dict[str, Any]] = {
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
LEAST: dict[str, dict[str, Any]] = {
    "least_tolerance": {
        "units": "mrad",
        "long_name": "least tolerance of all days and hours",
        "comment": "infinite where the spot never leaves the aperture; missing where there never is a spot",
    }
}


def least_at(day: str) -> dict[str, dict[str, Any]]:
    """When the tolerance is least: variables by name for a result whose days are along the dimension `day`."""
    what = {
        "day": {"units": "1", "long_name": "day of the year of the least tolerance"},
        "declination": {"units": "degree", "long_name": "declination of the sun at the least tolerance"},
        "date": {"long_name": "local date of the least tolerance"},
    }[day]
    comment = {"comment": "the first of several; missing where the least tolerance is infinite or missing"}
    return {
        f"{day}_of_least_tolerance": what | comment,
        "hour_of_least_tolerance": {"units": "h", "long_name": "hour of the least tolerance"} | comment,
    }


#: Where a curve crosses the detectors.
CROSSINGS: dict[str, dict[str, Any]] = {
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

#: Coordinates of the mode `curves`.
COEFFICIENTS = ("A", "B", "C", "D", "E", "F")
DETECTOR = {"long_name": "number of the line of detectors, from 0", "units": "1"}
DETECTOR_COEFFICIENTS = {
    name: {"long_name": f"{name} of the line of detectors l0 Y + l1 Z = l2", "units": unit}
    for name, unit in (("l0", "1"), ("l1", "1"), ("l2", "m"))
}
