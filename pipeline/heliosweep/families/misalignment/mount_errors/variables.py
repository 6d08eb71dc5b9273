"""The variables of the mode `mount_errors`: spots of fixed and swept errors, statistics over drawn ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.families.misalignment.instants import instant_sizes
from heliosweep.families.misalignment.spots import NO_HELIOSTAT, flag_attributes, spot_variables, swept_dims
from heliosweep.grid.regions import Variable
from heliosweep.kernels.spots import receiver

if TYPE_CHECKING:
    from heliosweep.families.misalignment.blocks import MountErrors
    from heliosweep.families.misalignment.study import MisalignmentStudy

_RIGHT = "positive to the right for someone in the field who looks at the receiver"
_UP = "positive upwards along the receiver's face"
_REAL = "over the draws whose ray reaches the receiver's plane; missing without any, and without sun"
_DRAWS = "realization: {} (over the draws of the mount errors)"


def _moment(long_name: str, units: str, method: str) -> dict[str, Any]:
    return {"long_name": long_name, "units": units, "comment": _REAL, "cell_methods": _DRAWS.format(method)}


#: In-mirror axes of the remaining tolerance.
TOLERANCE_AXES = ("elevation", "azimuth")

#: Statistics over the draws, per heliostat and instant.
_STATISTICS: dict[str, dict[str, Any]] = {
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
_STATUS = flag_attributes(
    "whether the mount can aim, and why not",
    _AIMED,
    "of the mount without errors; with a value other than 0 no draw has a spot",
)
_TOLERANCE: dict[str, Any] = {
    "long_name": "angle by which the mirror may still turn about its centre until its spot leaves the aperture",
    "units": "mrad",
    "comment": (
        "percentile over the draws of the least angle about the in-mirror axis; 0 for a draw whose spot lies outside "
        "or is not real, infinite where no angle takes the spot out"
    ),
}
_DAY_HITS: dict[str, Any] = {
    "long_name": "part of the draws and of the hours with sun in which the spot lies in the aperture",
    "units": "1",
    "cell_methods": f"{_DRAWS.format('mean')} time: mean (where the sun is above the horizon)",
}
_FIELD_HITS: dict[str, Any] = {
    "long_name": "part of the draws and of the heliostats whose spot lies in the aperture",
    "units": "1",
    "comment": "mean over the heliostats, each counting the same; missing without sun",
    "cell_methods": _DRAWS.format("mean"),
}


def errors_block(study: MisalignmentStudy) -> MountErrors:
    """Errors of the mounts."""
    assert study.mount_errors is not None
    return study.mount_errors


def is_drawn(study: MisalignmentStudy) -> bool:
    """True where an error of the mounts is drawn."""
    return errors_block(study).draws() > 0


def variables(study: MisalignmentStudy) -> dict[str, Variable]:
    """Variables of a study's result."""
    if not is_drawn(study):
        return spot_variables(study)
    swept, (day, hour) = swept_dims(study), instant_sizes(study)
    dims = (*swept, "heliostat", day, hour)
    found = {name: Variable(dims, attrs) for name, attrs in _STATISTICS.items()}
    found["spot_status"] = Variable(dims, _STATUS, np.dtype(np.int8))
    found["remaining_tolerance"] = Variable((*dims, "percentile", "tolerance_axis"), _TOLERANCE)
    found["day_hit_fraction"] = Variable(dims[:-1], _DAY_HITS)
    found["field_hit_fraction"] = Variable((*swept, day, hour), _FIELD_HITS, finished=True)
    return found
