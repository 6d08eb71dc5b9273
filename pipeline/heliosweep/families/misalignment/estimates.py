"""Errors of mounts estimated from spots or from crossings of detectors: variables and values that modes share.

Values lead with H heliostats and K draws; measured spots and crossings have one draw.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.families.misalignment.blocks import ERRORS
from heliosweep.families.misalignment.points import SIDES, coded, instant_sizes
from heliosweep.grid.regions import Variable, flags, pair, quantity, with_best
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.mounts.aiming import aim
from heliosweep.kernels.spots import calibration as codes
from heliosweep.mounts import CALIBRATION_STATUS, CONDITION_LIMITS, commands

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.spots_file import MeasuredSpots
    from heliosweep.families.misalignment.study import MisalignmentStudy

Values = dict[str, "NDArray[Any]"]

#: Codes in addition to the kernel's: doubtful values, spots that disagree.
DOUBTFUL, DISAGREE = 7, 8
#: Statuses with an estimate that commands may use.
KNOWN = (codes.ESTIMATED, codes.INDISTINCT, codes.EXACT, DOUBTFUL, DISAGREE)
#: Meanings of `calibration_status`; % is a spot or a crossing.
STATUS = {
    **CALIBRATION_STATUS,
    DOUBTFUL: "estimated_but_errors_or_spots_are_too_large_to_be_believed",
    DISAGREE: "estimated_but_spots_disagree",
}
_WHERE = {
    "y": f"{SIDES['y']} for someone in the field who looks at the receiver",
    "z": f"{SIDES['z']}, along the receiver's face",
}
_TOWARDS = {"y": "to the right", "z": "upwards"}
_AXES = {"azimuth": "primary", "elevation": "secondary"}
#: Variables of which the smallest value is the best.
_SMALLEST = (
    *("standard_error", "condition_number", "residual_rms", "leave_one_out_rms", "instants_without_command"),
    *("beam_residual_rms", "uncalibrated_beam_residual_rms", "beam_error_rms", "spot_distance_rms"),
)


def draw_count(study: MisalignmentStudy) -> int:
    """Number of draws of the errors; 0 if none is drawn, and for measured spots."""
    return 0 if study.mount_errors is None else study.mount_errors.draws()


def error_keys(study: MisalignmentStudy) -> list[str]:
    """Keys of the errors of mounts that label a result: errors that are not drawn, and the scale of drawn ones."""
    if study.mount_errors is None:
        return []
    drawn = study.mount_errors.drawn()
    names = (*(name for name in ERRORS if name not in drawn), *(["scale"] if drawn else []))
    return [f"mount_errors.{name}" for name in names]


def labels_of(study: MisalignmentStudy, what: str) -> dict[str, Any]:
    """Dimensions of estimates; `what` is measured, a spot or a crossing."""
    error = np.array(ERRORS, dtype=object), {"long_name": "error of the mount"}
    labels: dict[str, Any] = {"parameter": error, "parameter_2": error}
    if draws := draw_count(study):
        labels["sample"] = numbered(draws, "number of the draw, from 0")
    if study.table_of_spots() is not None:
        meaning = f"number of the {what} of a heliostat, from 0, in the order of the file"
        labels["spot"] = lambda measured: numbered(measured.most, meaning)
    return labels


def numbered(count: int, meaning: str) -> tuple[NDArray[np.int64], dict[str, str]]:
    """Labels 0, 1, ... of a dimension."""
    return np.arange(count), {"long_name": meaning, "units": "1"}


def finished(study: MisalignmentStudy, found: Mapping[str, Variable]) -> dict[str, Variable]:
    """Return variables with the dimension of the draws in front, and their best values."""
    lead = ("sample",) if draw_count(study) else ()
    made = {
        name: one if name.startswith("nominal") else replace(one, dims=(*lead, *one.dims))
        for name, one in found.items()
    }
    return with_best(made, ("crossed_fraction", "round_hit_fraction"), _SMALLEST)


def arranged(study: MisalignmentStudy, variables: Mapping[str, Variable], values: Values) -> Values:
    """Return values with the dimensions of their variables."""
    instants, made = tuple(instant_sizes(study).values()), {}
    for name in values.keys() & variables.keys():
        dims, array = variables[name].dims, values[name]
        if not name.startswith("nominal"):
            array = array.swapaxes(0, 1) if "sample" in dims else array[:, 0]
        if "hour" in dims:
            at = dims.index("hour") - 1
            array = array.reshape(*array.shape[:at], *instants, *array.shape[at + 1 :])
        made[name] = array
    return made


def estimate_variables(what: str, limit: float | None = None) -> dict[str, Variable]:
    """Estimates for each heliostat from spots or crossings; `limit` is the condition number of the study."""
    lead, of_errors = ("heliostat",), ("heliostat", "parameter")
    more: dict[str, Any] = {} if limit is None else {"condition_limit": float(limit)}
    spots = what == "spot"
    meanings = {code: words.replace("%", what) for code, words in STATUS.items() if spots or code < DOUBTFUL}
    freedom = (
        "95 % intervals from the t distribution with 2 spots_used - parameters degrees of freedom contain the true "
        "value in 95 % of the cases for spots of two days or more, but in 85 to 90 % for six errors from one day; "
        "missing with as many equations as errors"
    )
    stated = (
        "from noise and pitch of the detectors (pitch / sqrt(12) without noise); if both are 0 from the residuals; "
        "95 % intervals are 1.96 standard errors to both sides"
    )
    found = {
        "estimated_error": quantity(
            of_errors,
            "mrad",
            "estimate of the mount error",
            "missing for errors that are not estimated, and if calibration_status has no estimate; the last point "
            "of a fit that did not converge",
        ),
        "standard_error": quantity(of_errors, "mrad", "standard error of the estimate", freedom if spots else stated),
        "covariance": quantity(
            (*of_errors, "parameter_2"),
            "mrad2",
            "covariance of the estimates",
            "scaled by the variance of the residuals; with a robust loss the covariance of an M-estimator (Huber and "
            "Ronchetti 2009, section 7.6)" * spots,
        ),
        "condition_number": quantity(
            lead,
            "1",
            "condition number of the Jacobian at the estimate",
            "largest over smallest singular value, all errors in the same unit",
            **more,
        ),
        "residual_rms": quantity(lead, "m", f"root mean square of the residuals of the {what}s used, per coordinate"),
        f"{what}s_used": quantity(lead, "1", f"number of {what}s used", dtype="int32"),
        "calibration_status": coded(lead, "status of the estimate", meanings),
        "least_known_direction": flags(
            lead,
            f"error with the largest part in the combination of errors that the {what}s determine least",
            dict(enumerate(("nothing_estimated", *ERRORS), -1)),
        ),
        "true_error": quantity(of_errors, "mrad", f"error of the synthetic {what}s"),
    }
    found["least_known_direction"] = replace(found["least_known_direction"], missing=-1)
    return found


def estimates(found: codes.Fit, samples: int, what: str) -> Values:
    """Values of `estimate_variables` of fits of heliostats and draws."""
    made = {
        "estimated_error": found.estimate * 1e3,
        "standard_error": np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)) * 1e3,
        "covariance": found.covariance * 1e6,
        "condition_number": found.condition,
        "residual_rms": rms(found.residual, found.counted),
        "leave_one_out_rms": rms(found.left_out, found.counted),
        f"{what}s_used": found.used,
        "calibration_status": found.status,
        "least_known_direction": found.least_known,
    }
    return {name: array.reshape(-1, samples, *array.shape[1:]) for name, array in made.items()}


def rms(residual: Floats, counted: NDArray[np.bool_]) -> Floats:
    """Root mean square per coordinate of counted residuals of each list, shape (N, M, D); NaN without any."""
    total = np.sum(np.where(counted, np.sum(residual**2, axis=-1), 0.0), axis=1)
    count = residual.shape[-1] * np.count_nonzero(counted, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.sqrt(total / np.where(count > 0, count, np.nan))


def known_errors(status: NDArray[np.int64], estimate: Floats) -> Floats:
    """Errors that corrected commands use: the estimated ones; NaN if nothing is estimated."""
    known: Floats = np.where(np.isin(status, KNOWN)[..., np.newaxis], np.nan_to_num(estimate), np.nan)
    return known


def observed_of(measured: MeasuredSpots, mounts: codes.Mounts, numbers: NDArray[np.int64]) -> codes.Observed:
    """Measured spots of following heliostats, with the commands of mounts without errors if none are measured."""
    sun, angles = measured.lists(numbers, measured.sun), measured.lists(numbers, measured.angles)
    ideal = aim(mounts.frames[:, None], sun, mounts.to_target[:, None], np.zeros(6), tuple(mounts.offsets))
    angles = np.where(np.isnan(angles).any(axis=-1, keepdims=True), ideal, angles)
    weight = measured.lists(numbers, measured.weight, 0.0)
    return codes.Observed(sun, angles, measured.lists(numbers, measured.position), weight)


def command_variables(study: MisalignmentStudy) -> dict[str, Variable]:
    """Commanded angles with and without correction, the latter without a dimension of draws."""
    each = ("heliostat", *instant_sizes(study))
    meaning = "angle to command of the % axis with the estimated errors"
    comment = "missing without sun, in the blind cone and without a usable estimate"
    corrected = pair("corrected_%", _AXES, each, "degree", meaning, comment)
    return corrected | pair("nominal_%", _AXES, each, "degree", "angle commanded of the % axis without calibration")


def command_values(mounts: codes.Mounts, sun: Floats, corrected: Floats) -> Values:
    """Values of `command_variables` for corrected angles of shape (H, K, T, 2). [rad]"""
    ideal = commands(mounts, sun, np.zeros((len(mounts.frames), 1, len(ERRORS))))
    named = {"nominal": np.degrees(ideal), "corrected": np.degrees(corrected)}
    return {f"{name}_{axis}": array[..., i] for name, array in named.items() for i, axis in enumerate(_AXES)}


def spot_pairs(name: str, dims: tuple[str, ...], meaning: str, comment: str) -> dict[str, Variable]:
    """Variables y and z of residuals, or of spots before and after a calibration."""
    return {
        name.format(side): quantity(dims, "m", f"{meaning}, {_TOWARDS[side]}", f"{where}; {comment}")
        for side, where in _WHERE.items()
    }


def pairs(name: str, values: Floats) -> Values:
    """Values y and z of an array whose last axis has both."""
    return {name.format(side): values[..., index] for index, side in enumerate("yz")}


def condition_limit(parameters: int, limit: float | None) -> float:
    """Condition number above which a warning is given."""
    return CONDITION_LIMITS[parameters] if limit is None else limit
