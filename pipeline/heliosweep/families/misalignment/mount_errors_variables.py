"""The variables of the mode mount_errors with drawn errors, in the order of the file; those without are the curves'."""

from __future__ import annotations

from typing import Any

import numpy as np

from heliosweep.families.misalignment.variables import NO_HELIOSTAT
from heliosweep.kernels import receiver

_RIGHT = "positive to the right for someone in the field who looks at the receiver"
_UP = "positive upwards along the receiver's face"
_REAL = "over the draws whose ray reaches the receiver's plane; missing without any, and without sun"
_DRAWS = "realization: {} (over the draws of the mount errors)"


def _moment(long_name: str, units: str, method: str) -> dict[str, Any]:
    return {"long_name": long_name, "units": units, "comment": _REAL, "cell_methods": _DRAWS.format(method)}


#: In-mirror axes of the remaining tolerance.
TOLERANCE_AXES = ("elevation", "azimuth")

#: Of drawn errors, per heliostat and instant, in the order of the kernel's.
STATISTICS: dict[str, dict[str, Any]] = {
    "spot_y_mean": _moment(f"mean spot to the right of the aim point, {_RIGHT}", "m", "mean"),
    "spot_z_mean": _moment(f"mean spot above the aim point, {_UP}", "m", "mean"),
    "spot_y_variance": _moment("variance of the spot to the right (n - 1)", "m2", "variance"),
    "spot_z_variance": _moment("variance of the spot upwards (n - 1)", "m2", "variance"),
    "spot_yz_covariance": _moment("covariance of the spot to the right and upwards (n - 1)", "m2", "mean"),
    "hit_fraction": {
        "long_name": "part of the draws whose spot lies in the aperture",
        "units": "1",
        "comment": "of all draws, those without a spot among them; missing without sun",
        "cell_methods": _DRAWS.format("mean"),
    },
    "real_fraction": {
        "long_name": "part of the draws whose ray reaches the receiver's plane",
        "units": "1",
        "comment": "missing without sun",
        "cell_methods": _DRAWS.format("mean"),
    },
}

_AIMED = {
    NO_HELIOSTAT: "no_heliostat",
    receiver.REACHES: "mount_aims",
    receiver.BEHIND_FACE: "pivot_on_or_behind_the_plane",
    receiver.NO_SUN: "sun_below_the_horizon",
    receiver.BLIND_CONE: "mount_cannot_point_there",
    receiver.TOO_NEAR: "offsets_not_smaller_than_the_distance",
}
#: Of drawn errors, per heliostat and instant, the same for all draws; int8.
STATUS: dict[str, dict[str, Any]] = {
    "spot_status": {
        "long_name": "whether the mount can aim, and why not",
        "units": "1",
        "flag_values": np.array(list(_AIMED), dtype=np.int8),
        "flag_meanings": " ".join(_AIMED.values()),
        "comment": "of the mount without errors; with a value other than 0 no draw has a spot",
    },
}

#: Of drawn errors, per heliostat, instant, percentile and axis.
TOLERANCE: dict[str, dict[str, Any]] = {
    "remaining_tolerance": {
        "long_name": "angle by which the mirror may still turn about its centre until its spot leaves the aperture",
        "units": "mrad",
        "comment": (
            "percentile over the draws of the least angle about the in-mirror axis; 0 for a draw whose spot lies "
            "outside or is not real, infinite where no angle takes the spot out"
        ),
    },
}

#: Of drawn errors, means of the hit fraction.
MEANS: dict[str, dict[str, Any]] = {
    "day_hit_fraction": {
        "long_name": "part of the draws and of the hours with sun in which the spot lies in the aperture",
        "units": "1",
        "cell_methods": f"{_DRAWS.format('mean')} time: mean (where the sun is above the horizon)",
    },
    "field_hit_fraction": {
        "long_name": "part of the draws and of the heliostats whose spot lies in the aperture",
        "units": "1",
        "comment": "mean over the heliostats, each counting the same; missing without sun",
        "cell_methods": _DRAWS.format("mean"),
    },
}
