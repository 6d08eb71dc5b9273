"""Mode `mount_errors`: spots of the six errors of a mount, fixed, swept or drawn, and statistics over the draws.

Draws are not stored: each call has the draws of its heliostats, which all instants and parameters share.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.sweep import NORMAL
from heliosweep.families.family import Computation
from heliosweep.families.misalignment.curves import spot_values, spot_variables
from heliosweep.families.misalignment.points import (
    APART,
    Scene,
    coded,
    drawn_errors,
    error_keys,
    instant_sizes,
    mean_errors,
)
from heliosweep.families.misalignment.study import MisalignmentStudy, MountErrors
from heliosweep.families.points import Point
from heliosweep.grid.regions import Variable, quantity, with_best
from heliosweep.kernels.mounts.kinematics import ERRORS
from heliosweep.kernels.spots import receiver
from heliosweep.kernels.spots.mount_spots import mount_spots, spot_statistics

#: In-mirror axes of the remaining tolerance.
TOLERANCE_AXES = ("elevation", "azimuth")
#: Percentiles of the remaining tolerance if the study specifies none.
PERCENTILES = (5.0, 50.0, 95.0)
#: Variables that the kernel computes, by their names there.
_MOMENTS = {
    "mean_y": "spot_y_mean",
    "mean_z": "spot_z_mean",
    "variance_y": "spot_y_variance",
    "variance_z": "spot_z_variance",
    "covariance": "spot_yz_covariance",
    "hit_fraction": "hit_fraction",
    "real_fraction": "real_fraction",
    "status": "spot_status",
}
#: Errors that the tracking corrects, shape (1, 1, 6): none.
_UNKNOWN = np.zeros((1, 1, len(ERRORS)))
_DRAWS = "realization: {} (over the draws of the mount errors)"
_AIMED = {
    receiver.REACHES: "mount_aims",
    receiver.BEHIND_FACE: "pivot_on_or_behind_the_plane",
    receiver.NO_SUN: "sun_below_the_horizon",
    receiver.BLIND_CONE: "mount_cannot_point_there",
    receiver.TOO_NEAR: "offsets_not_smaller_than_the_distance",
}


def computation(study: MisalignmentStudy) -> Computation:
    """Return the variables of a study and the function that computes them."""
    block = study.mount_errors
    assert block is not None
    common: dict[str, Any] = {"labels": tuple(error_keys(study)), "arrays": APART, "unit": "spots"}
    if not block.draws():
        return Computation(fixed_errors, spot_variables(study), **common)
    percentile = {"long_name": "percentile over the draws", "units": "1"}
    axis = {"long_name": "in-mirror axis about which the mirror rotates"}
    percentiles = np.array(PERCENTILES if study.statistics is None else study.statistics.percentiles.values(), float)
    return Computation(
        partial(drawn, percentiles),
        variables(study),
        dims={"percentile": (percentiles, percentile), "tolerance_axis": (np.array(TOLERANCE_AXES, object), axis)},
        attrs={"mount_errors": _described(block)},
        finish=lambda points, computed: {
            "field_hit_fraction": _mean(computed["hit_fraction"].transpose(..., "heliostat").to_numpy())
        },
        **common,
    )


def variables(study: MisalignmentStudy) -> dict[str, Variable]:
    """Statistics over the draws."""
    dims, mean = ("heliostat", *instant_sizes(study)), _DRAWS.format("mean")
    moments = {
        "spot_y_mean": (
            "m", "mean spot to the right of the aim point, for someone in the field who looks at the receiver", "mean"
        ),
        "spot_z_mean": ("m", "mean spot above the aim point, positive upwards along the receiver's face", "mean"),
        "spot_y_variance": ("m2", "variance of the spot to the right (n - 1)", "variance"),
        "spot_z_variance": ("m2", "variance of the spot upwards (n - 1)", "variance"),
        "spot_yz_covariance": ("m2", "covariance of the spot to the right and upwards (n - 1)", "mean"),
    }  # fmt: skip
    real = "over the draws whose ray reaches the receiver's plane; missing without any, and without sun"
    found = {
        name: quantity(dims, units, words, real, cell_methods=_DRAWS.format(method))
        for name, (units, words, method) in moments.items()
    } | {
        "hit_fraction": quantity(
            dims,
            "1",
            "fraction of the draws whose spot lies in the aperture",
            "of all draws, including draws without a spot; missing without sun",
            cell_methods=mean,
        ),
        "real_fraction": quantity(
            dims,
            "1",
            "fraction of the draws whose ray reaches the receiver's plane",
            "missing without sun",
            cell_methods=mean,
        ),
        "spot_status": coded(
            dims,
            "reason for missing spots",
            _AIMED,
            "of the mount without errors; with a value other than 0 no draw has a spot",
        ),
        "remaining_tolerance": quantity(
            (*dims, "percentile", "tolerance_axis"),
            "mrad",
            "angle by which the mirror may still rotate about its centre until its spot leaves the aperture",
            "percentile over the draws of the minimum angle about the in-mirror axis; 0 for a draw whose spot is "
            "outside or not real, infinite if no angle moves the spot out",
        ),
        "day_hit_fraction": quantity(
            dims[:-1],
            "1",
            "fraction of the draws, over the hours with sun, in which the spot lies in the aperture",
            cell_methods=f"{mean} time: mean (over the hours with the sun above the horizon)",
        ),
        "field_hit_fraction": quantity(
            dims[1:],
            "1",
            "fraction of the draws and heliostats whose spot lies in the aperture",
            "mean over the heliostats with equal weights; missing without sun",
            finished=True,
            cell_methods=mean,
        ),
    }
    largest = ("hit_fraction", "real_fraction", "remaining_tolerance", "day_hit_fraction", "field_hit_fraction")
    return with_best(found, largest, ("spot_y_variance", "spot_z_variance"))


def fixed_errors(point: Point) -> dict[str, NDArray[Any]]:
    """Compute the spots of a group of points with fixed or swept errors."""
    scene, actual = Scene.of(point), mean_errors(point)[:, np.newaxis] * 1e-3
    spots = mount_spots(scene.setting, actual, _UNKNOWN, scene.sun[np.newaxis], scene.pivots[np.newaxis])
    shape = *point.group, len(scene.numbers), *instant_sizes(point.study).values()
    return spot_values(point, *(each.reshape(shape) for each in spots))


def drawn(percentiles: NDArray[np.float64], point: Point) -> dict[str, NDArray[Any]]:
    """Compute statistics over the draws at a group of points, and the mean hit fraction of each day."""
    scene = Scene.of(point)
    sky, made = (scene.sun[np.newaxis], scene.pivots[np.newaxis]), []
    for number, errors in enumerate(drawn_errors(point, scene.numbers)):
        one = receiver.Setting._make(values[number : number + 1] for values in scene.setting)
        made.append(spot_statistics(one, 1e-3 * errors[np.newaxis], _UNKNOWN, *sky, percentiles))
    shape = *point.group, len(scene.numbers), *instant_sizes(point.study).values()
    arrays = {name: np.concatenate([each[name] for each in made]) for name in made[0]}
    values = {ours: arrays[name].reshape(shape) for name, ours in _MOMENTS.items()}
    values["remaining_tolerance"] = 1e3 * arrays["tolerance"].reshape(*shape, percentiles.size, len(TOLERANCE_AXES))
    return values | {"day_hit_fraction": _mean(values["hit_fraction"])}


def _mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean of the values that are not NaN along the last dimension; NaN without any."""
    count = np.count_nonzero(~np.isnan(values), axis=-1)
    # Added one after the other: padding at the end must not change the order of the sum.
    total = np.cumsum(np.nan_to_num(values), axis=-1)[..., -1]
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _described(block: MountErrors) -> str:
    """Return the distributions in words."""
    parts = []
    for name, error in block.drawn().items():
        words = "mean {:g}, standard deviation {:g}" if error.kind == NORMAL else "{:g} to {:g}"
        seed = "" if error.seed is None else f", seed {error.seed}"
        parts.append(f"{name} {error.kind} ({words.format(*error.parts)} mrad{seed})")
    drawn = f"{block.draws()} draws of Philox 4x64, seed {block.seed or 0}, keyed by error and heliostat"
    return f"{'; '.join(parts)}; {drawn}"
