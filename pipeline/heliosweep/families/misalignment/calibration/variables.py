"""The variables of the mode `calibration`: names, CF attributes and what each means, in the order of the file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.families.misalignment.blocks import ERRORS, Calibration
from heliosweep.families.misalignment.instants import instant_sizes
from heliosweep.families.misalignment.spots import NO_HELIOSTAT, flag_attributes, swept_dims
from heliosweep.grid.regions import Variable
from heliosweep.kernels.spots import fit as codes

if TYPE_CHECKING:
    from heliosweep.families.misalignment.study import MisalignmentStudy

_RIGHT = "to the right of the aim point for someone in the field who looks at the receiver"
_UP = "above the aim point, along the receiver's face"
_ANGLES = {"azimuth": "primary", "elevation": "secondary"}

#: Codes beside those of the kernel: as many equations as errors, and no spot at all.
EXACT, NO_SPOTS = 5, 6
STATUS = {
    NO_HELIOSTAT: "no_heliostat",
    codes.ESTIMATED: "estimated",
    codes.TOO_FEW: "fewer_spots_than_the_errors_need",
    codes.INDISTINCT: "estimated_but_the_condition_number_is_above_the_limit",
    codes.NOT_CONVERGED: "not_converged",
    codes.DEPENDENT: "spots_cannot_tell_the_errors_apart",
    EXACT: "estimated_but_no_spot_is_left_for_standard_errors",
    NO_SPOTS: "no_spots",
}
#: What has an estimate that commands may take.
KNOWN = (codes.ESTIMATED, codes.INDISTINCT, EXACT)

_FIT = (
    "missing for errors that are not estimated, and where calibration_status says that nothing is; of a fit that did "
    "not converge its last point"
)

#: Of each heliostat and draw: attributes, the dimensions beyond those, and the type where it is not float64.
_ESTIMATES: dict[str, tuple[Any, ...]] = {
    "estimated_error": ({"units": "mrad", "long_name": "estimate of the mount error", "comment": _FIT}, ("parameter",)),
    "standard_error": (
        {
            "units": "mrad",
            "long_name": "standard error of the estimate",
            "comment": "root of the diagonal of the covariance; 95 % intervals take the t distribution with "
            "2 spots_used - parameters degrees of freedom: they hold the truth in 95 % of the cases where the spots "
            "are of two days or more, but in 85 to 90 % where six errors are estimated from the spots of one day; "
            "missing where there are as many equations as errors",
        },
        ("parameter",),
    ),
    "covariance": (
        {
            "units": "mrad2",
            "long_name": "covariance of the estimates",
            "comment": "scaled by the variance of the residuals; with a robust loss that of an M-estimator (Huber and "
            "Ronchetti 2009, section 7.6)",
        },
        ("parameter", "parameter_2"),
    ),
    "condition_number": (
        {
            "units": "1",
            "long_name": "condition number of the Jacobian at the estimate",
            "comment": "largest over smallest singular value, all errors in the same unit",
        },
        (),
    ),
    "residual_rms": (
        {
            "units": "m",
            "long_name": "root mean square of the residuals, per coordinate",
            "comment": "over the spots used, outliers among them",
        },
        (),
    ),
    "leave_one_out_rms": (
        {
            "units": "m",
            "long_name": "root mean square, per coordinate, of the residuals of predictions that leave out the spot",
            "comment": "to first order, by the block of the hat matrix of each spot; missing where a spot alone "
            "determines some combination of the errors",
        },
        (),
    ),
    "spots_used": ({"units": "1", "long_name": "number of spots used"}, (), np.int32),
    "instants_without_command": (
        {
            "units": "1",
            "long_name": "instants with sun and an estimate at which no command brings the beam to the aim point",
            "comment": "in the blind cone of the mount, or nearer to the aim point than the offsets of the mirror",
        },
        (),
        np.int32,
    ),
    "calibration_status": (flag_attributes("whether the errors are estimated, and why not", STATUS), (), np.int8),
    "least_known_direction": (
        flag_attributes(
            "error with the largest part in the combination of errors that the spots know least",
            dict(enumerate(("nothing_estimated", *ERRORS), -1)),
        ),
        (),
        np.int8,
    ),
}
_TRUE_ERROR = {"units": "mrad", "long_name": "error with which the synthetic spots were made"}


def _sides(name: str, long_name: str, comment: str) -> dict[str, dict[str, Any]]:
    """Attributes of the coordinates y and z of spots or of residuals."""
    sides = (("y", "to the right", _RIGHT), ("z", "upwards", _UP))
    return {
        name.format(side): {"units": "m", "long_name": f"{long_name}, {towards}", "comment": f"{where}; {comment}"}
        for side, towards, where in sides
    }


def _spots(residual: str, before: str, after: str) -> dict[str, dict[str, Any]]:
    """Attributes of residuals, and of spots before and after the calibration, from what is said of each."""
    return {
        **_sides("residual_{}", "measured minus predicted spot", residual),
        **_sides("spot_{}_before", "spot before the calibration", before),
        **_sides("spot_{}_after", "spot after the calibration", after),
    }


#: Of synthetic spots, at each instant.
_SYNTHETIC = _spots(
    "missing on days that are not used",
    "where the true errors send the beam; without noise",
    "where the beam goes with corrected commands; without noise",
)
#: Of measured ones, each.
_MEASURED = _spots(
    "in the order of the file",
    "as measured; in the order of the file",
    "residual of the prediction that leaves out the spot itself; in the order of the file",
)
#: Commands, at each instant, without and with the estimated errors.
_NOMINAL: dict[str, dict[str, Any]] = {
    f"nominal_{name}": {"units": "degree", "long_name": f"angle commanded of the {axis} axis without calibration"}
    for name, axis in _ANGLES.items()
}
_CORRECTED: dict[str, dict[str, Any]] = {
    f"corrected_{name}": {
        "units": "degree",
        "long_name": f"angle to command of the {axis} axis with the estimated errors",
        "comment": "missing without sun, in the blind cone and where no estimate is to be trusted",
    }
    for name, axis in _ANGLES.items()
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
    found = {
        name: Variable((*lead, *inner), attrs, np.dtype(*dtype or [np.float64]))
        for name, (attrs, inner, *dtype) in _ESTIMATES.items()
    }
    if block.condition_limit is not None:
        given = found["condition_number"]
        limit = {"condition_limit": float(block.condition_limit)}
        found["condition_number"] = Variable(given.dims, {**given.attrs, **limit})
    if block.spots is None:
        found["true_error"] = Variable((*lead, "parameter"), _TRUE_ERROR)
        spots = {name: Variable((*lead, *instants), attrs) for name, attrs in _SYNTHETIC.items()}
    else:
        spots = {name: Variable((*lead, "spot"), attrs) for name, attrs in _MEASURED.items()}
    corrected = {name: Variable((*lead, *instants), attrs) for name, attrs in _CORRECTED.items()}
    nominal = {name: Variable((*swept, "heliostat", *instants), attrs) for name, attrs in _NOMINAL.items()}
    return found | spots | corrected | nominal
