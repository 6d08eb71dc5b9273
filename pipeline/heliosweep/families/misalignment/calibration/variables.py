"""The variables of the mode `calibration`: names, CF attributes and what each means, in the order of the file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.families.misalignment.blocks import ERRORS, Calibration
from heliosweep.families.misalignment.points import instant_sizes, swept_dims
from heliosweep.families.misalignment.spots import NO_HELIOSTAT, SIDES
from heliosweep.grid.regions import Variable, flags, pair, quantity, with_best
from heliosweep.kernels.spots import calibration as codes

if TYPE_CHECKING:
    from heliosweep.families.misalignment.study import MisalignmentStudy

#: Codes in addition to the kernel's: as many equations as errors, no spots, doubtful values, spots that disagree.
EXACT, NO_SPOTS, DOUBTFUL, DISAGREE = 5, 6, 7, 8
#: Errors of a mount, and distances of a measured spot from where a mount without errors sends it, from which on an
#: estimate is doubtful. [mrad, widths and heights of the aperture]
DOUBTFUL_ERROR, DOUBTFUL_APERTURES = 50.0, 3.0
STATUS = {
    NO_HELIOSTAT: "no_heliostat",
    codes.ESTIMATED: "estimated",
    codes.TOO_FEW: "fewer_spots_than_the_errors_need",
    codes.INDISTINCT: "estimated_but_the_condition_number_is_above_the_limit",
    codes.NOT_CONVERGED: "not_converged",
    codes.DEPENDENT: "spots_cannot_tell_the_errors_apart",
    EXACT: "estimated_but_no_spot_is_left_for_standard_errors",
    NO_SPOTS: "no_spots",
    DOUBTFUL: "estimated_but_errors_or_spots_are_too_large_to_be_believed",
    DISAGREE: "estimated_but_spots_disagree",
}
#: Deviation of a spot from the prediction of the others, in robust standard deviations, above which it disagrees.
LARGEST_DEVIATION = 5.0
#: Other readings of a table of measured spots, and the words for each in a warning.
MIRRORED, EARLIER, LATER = 1, 2, 3
READINGS = {
    0: "as_given",
    MIRRORED: "mirrored",
    EARLIER: "an_hour_earlier",
    LATER: "an_hour_later",
}
#: What has an estimate that commands may take.
KNOWN = (codes.ESTIMATED, codes.INDISTINCT, EXACT, DOUBTFUL, DISAGREE)

#: Errors, the one that is known least among them.
LEAST_KNOWN = dict(enumerate(("nothing_estimated", *ERRORS), -1))
_TOWARDS = {"y": "to the right", "z": "upwards"}
_WHERE = {
    "y": f"{SIDES['y']} for someone in the field who looks at the receiver",
    "z": f"{SIDES['z']}, along the receiver's face",
}
_AXES = {"azimuth": "primary", "elevation": "secondary"}
#: Of which the smallest value is the best.
SMALLEST = (
    *("standard_error", "condition_number", "residual_rms", "leave_one_out_rms", "instants_without_command"),
    *("beam_residual_rms", "uncalibrated_beam_residual_rms", "beam_error_rms", "spot_distance_rms"),
)

#: Residuals, and spots before and after the calibration: what is said of synthetic ones, at each instant, and of
#: measured ones, each.
_SPOTS = {
    "residual_{}": ("measured minus predicted spot", "missing on days that are not used", "in the order of the file"),
    "spot_{}_before": (
        "spot before the calibration",
        "where the true errors send the beam; without noise",
        "as measured; with commanded angles counted from where a mount without errors sends the beam; in the order of "
        "the file",
    ),
    "spot_{}_after": (
        "spot after the calibration",
        "where the beam goes with corrected commands; without noise",
        "residual of the prediction that leaves out the spot itself; in the order of the file",
    ),
}


def calibration_block(study: MisalignmentStudy) -> Calibration:
    """Block of the study that says what is estimated, and from which spots."""
    assert study.calibration is not None
    return study.calibration


def draw_count(study: MisalignmentStudy) -> int:
    """Draws of the errors of synthetic spots; 0 where none is drawn, and of measured spots."""
    if calibration_block(study).spots is not None or study.mount_errors is None:
        return 0
    return study.mount_errors.draws()


def variables(study: MisalignmentStudy) -> dict[str, Variable]:
    """Variables of a study's result."""
    block, swept, instants = calibration_block(study), swept_dims(study), tuple(instant_sizes(study))
    lead = (*swept, *(("sample",) if draw_count(study) else ()), "heliostat")
    each, synthetic = (*lead, *instants), block.spots is None
    limit: dict[str, Any] = {} if block.condition_limit is None else {"condition_limit": float(block.condition_limit)}
    found = _estimates(lead, limit)
    if synthetic:
        meaning = "error with which the synthetic spots were made"
        found["true_error"] = quantity((*lead, "parameter"), "mrad", meaning)
    else:
        meaning = "root mean square of the angle between measured and predicted spot, seen from the pivot"
        comment = "of the beam, which turns by twice the angle of the mirror; over the spots used"
        found |= {
            "beam_residual_rms": quantity(lead, "mrad", meaning, f"{comment}, with the estimated errors"),
            "uncalibrated_beam_residual_rms": quantity(lead, "mrad", f"{meaning}, without calibration", comment),
            "spot_deviation": quantity(
                (*lead, "spot"),
                "1",
                "distance of the spot from its prediction, in robust standard deviations of a coordinate",
                f"prediction of a fit with Huber's weights, standard deviation from the median distance of the "
                f"heliostat's spots; a spot above {LARGEST_DEVIATION:g} disagrees with the others",
            ),
            "better_reading": flags(lead, "reading of the spots that halves the residuals at least", READINGS),
            "spot_time": Variable(
                (*lead, "spot"),
                {"long_name": "universal time of the spot", "comment": "missing if the table has sun vectors"},
                np.dtype("datetime64[ns]"),
            ),
        }
    for name, (meaning, *said) in _SPOTS.items():
        for side, where in _WHERE.items():
            comment = f"{where}; {said[0] if synthetic else said[1]}"
            dims = each if synthetic else (*lead, "spot")
            found[name.format(side)] = quantity(dims, "m", f"{meaning}, {_TOWARDS[side]}", comment)
    return with_best(found | angles(swept, each), (), SMALLEST)


def angles(swept: tuple[str, ...], each: tuple[str, ...]) -> dict[str, Variable]:
    """Commanded angles with and without correction, the latter without a dimension of draws."""
    meaning = "angle to command of the % axis with the estimated errors"
    comment = "missing without sun, in the blind cone and where no estimate is to be trusted"
    shared = (*swept, *(dim for dim in each[len(swept) :] if dim != "sample"))
    corrected = pair("corrected_%", _AXES, each, "degree", meaning, comment)
    return corrected | pair("nominal_%", _AXES, shared, "degree", "angle commanded of the % axis without calibration")


def _estimates(lead: tuple[str, ...], limit: dict[str, Any]) -> dict[str, Variable]:
    """What is estimated of each heliostat and draw."""
    return {
        "estimated_error": quantity(
            (*lead, "parameter"),
            "mrad",
            "estimate of the mount error",
            "missing for errors that are not estimated, and where calibration_status says that nothing is; of a fit "
            "that did not converge its last point",
        ),
        "standard_error": quantity(
            (*lead, "parameter"),
            "mrad",
            "standard error of the estimate",
            "root of the diagonal of the covariance; 95 % intervals take the t distribution with "
            "2 spots_used - parameters degrees of freedom: they hold the truth in 95 % of the cases where the spots "
            "are of two days or more, but in 85 to 90 % where six errors are estimated from the spots of one day; "
            "missing where there are as many equations as errors",
        ),
        "covariance": quantity(
            (*lead, "parameter", "parameter_2"),
            "mrad2",
            "covariance of the estimates",
            "scaled by the variance of the residuals; with a robust loss that of an M-estimator (Huber and "
            "Ronchetti 2009, section 7.6)",
        ),
        "condition_number": quantity(
            lead,
            "1",
            "condition number of the Jacobian at the estimate",
            "largest over smallest singular value, all errors in the same unit",
            **limit,
        ),
        "residual_rms": quantity(
            lead, "m", "root mean square of the residuals, per coordinate", "over the spots used, outliers among them"
        ),
        "leave_one_out_rms": quantity(
            lead,
            "m",
            "root mean square, per coordinate, of the residuals of predictions that leave out the spot",
            "to first order, by the block of the hat matrix of each spot; missing where a spot alone determines some "
            "combination of the errors",
        ),
        "spots_used": quantity(lead, "1", "number of spots used", dtype="int32"),
        "instants_without_command": quantity(
            lead,
            "1",
            "instants with sun and an estimate at which no command brings the beam to the aim point",
            "in the blind cone of the mount, or nearer to the aim point than the offsets of the mirror",
            dtype="int32",
        ),
        "calibration_status": flags(lead, "whether the errors are estimated, and why not", STATUS),
        "least_known_direction": flags(
            lead,
            "error with the largest part in the combination of errors that the spots know least",
            LEAST_KNOWN,
        ),
    }
