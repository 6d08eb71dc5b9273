"""The variables of the mode `mount_errors`: spots of fixed and swept errors, statistics over drawn ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

from heliosweep.families.misalignment.points import instant_sizes, swept_dims
from heliosweep.families.misalignment.spots import NO_HELIOSTAT, spot_variables
from heliosweep.grid.regions import Variable, flags, quantity, with_best
from heliosweep.kernels.spots import receiver

if TYPE_CHECKING:
    from heliosweep.families.misalignment.blocks import MountErrors
    from heliosweep.families.misalignment.study import MisalignmentStudy

#: In-mirror axes of the remaining tolerance.
TOLERANCE_AXES = ("elevation", "azimuth")

_RIGHT = (
    "mean spot to the right of the aim point, positive to the right for someone in the field who looks at the receiver"
)
_UP = "mean spot above the aim point, positive upwards along the receiver's face"
_REAL = "over the draws whose ray reaches the receiver's plane; missing without any, and without sun"
_DRAWS = "realization: {} (over the draws of the mount errors)"
_MEAN = _DRAWS.format("mean")
_DAY_MEAN = f"{_MEAN} time: mean (where the sun is above the horizon)"
_AIMED = {
    NO_HELIOSTAT: "no_heliostat",
    receiver.REACHES: "mount_aims",
    receiver.BEHIND_FACE: "pivot_on_or_behind_the_plane",
    receiver.NO_SUN: "sun_below_the_horizon",
    receiver.BLIND_CONE: "mount_cannot_point_there",
    receiver.TOO_NEAR: "offsets_not_smaller_than_the_distance",
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

    def moment(units: str, long_name: str, method: str) -> Variable:
        return quantity(dims, units, long_name, _REAL, cell_methods=_DRAWS.format(method))

    part = "fraction of the draws whose ray reaches the receiver's plane"
    hits = "fraction of the draws whose spot lies in the aperture"
    found = {
        "spot_y_mean": moment("m", _RIGHT, "mean"),
        "spot_z_mean": moment("m", _UP, "mean"),
        "spot_y_variance": moment("m2", "variance of the spot to the right (n - 1)", "variance"),
        "spot_z_variance": moment("m2", "variance of the spot upwards (n - 1)", "variance"),
        "spot_yz_covariance": moment("m2", "covariance of the spot to the right and upwards (n - 1)", "mean"),
        "hit_fraction": quantity(
            dims, "1", hits, "of all draws, those without a spot among them; missing without sun", cell_methods=_MEAN
        ),
        "real_fraction": quantity(dims, "1", part, "missing without sun", cell_methods=_MEAN),
        "spot_status": flags(
            dims,
            "whether the mount can aim, and why not",
            _AIMED,
            "of the mount without errors; with a value other than 0 no draw has a spot",
        ),
        "remaining_tolerance": quantity(
            (*dims, "percentile", "tolerance_axis"),
            "mrad",
            "angle by which the mirror may still turn about its centre until its spot leaves the aperture",
            "percentile over the draws of the least angle about the in-mirror axis; 0 for a draw whose spot lies "
            "outside or is not real, infinite where no angle takes the spot out",
        ),
    }
    hits = "fraction of the draws, over the hours with sun, in which the spot lies in the aperture"
    found["day_hit_fraction"] = quantity(dims[:-1], "1", hits, cell_methods=_DAY_MEAN)
    hits = "fraction of the draws and heliostats whose spot lies in the aperture"
    comment = "mean over the heliostats, each counting the same; missing without sun"
    found["field_hit_fraction"] = quantity((*swept, day, hour), "1", hits, comment, finished=True, cell_methods=_MEAN)
    largest = ("hit_fraction", "real_fraction", "remaining_tolerance", "day_hit_fraction", "field_hit_fraction")
    return with_best(found, largest, ("spot_y_variance", "spot_z_variance"))
