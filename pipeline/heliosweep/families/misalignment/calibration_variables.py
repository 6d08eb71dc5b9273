"""The variables of the mode calibration: names, CF attributes and what each means, in the order of the file."""

from __future__ import annotations

from typing import Any

import numpy as np

from heliosweep.families.misalignment.blocks import ERRORS
from heliosweep.families.misalignment.variables import NO_HELIOSTAT
from heliosweep.kernels import calibration as codes

_RIGHT = "to the right of the aim point for someone in the field who looks at the receiver"
_UP = "above the aim point, along the receiver's face"

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

#: Of each heliostat (and draw): attributes, and the dimensions beyond those.
ESTIMATES: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
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
    "spots_used": ({"units": "1", "long_name": "number of spots used"}, ()),
    "instants_without_command": (
        {
            "units": "1",
            "long_name": "instants with sun and an estimate at which no command brings the beam to the aim point",
            "comment": "in the blind cone of the mount, or nearer to the aim point than the offsets of the mirror",
        },
        (),
    ),
    "calibration_status": (
        {
            "units": "1",
            "long_name": "whether the errors are estimated, and why not",
            "flag_values": np.array(list(STATUS), dtype=np.int8),
            "flag_meanings": " ".join(STATUS.values()),
        },
        (),
    ),
    "least_known_direction": (
        {
            "units": "1",
            "long_name": "error with the largest part in the combination of errors that the spots know least",
            "flag_values": np.arange(-1, len(ERRORS), dtype=np.int8),
            "flag_meanings": " ".join(("nothing_estimated", *ERRORS)),
        },
        (),
    ),
}

#: Of synthetic spots.
TRUE_ERROR: tuple[dict[str, Any], tuple[str, ...]] = (
    {"units": "mrad", "long_name": "error with which the synthetic spots were made"},
    ("parameter",),
)

#: Variables that are not of 8 bytes.
DTYPES: dict[str, type] = {
    "spots_used": np.int32,
    "instants_without_command": np.int32,
    "calibration_status": np.int8,
    "least_known_direction": np.int8,
}


def _spot(when: str, comment: str) -> dict[str, dict[str, Any]]:
    return {
        f"spot_{side}_{when}": {
            "units": "m",
            "long_name": f"spot {when} the calibration, {'to the right' if side == 'y' else 'upwards'}",
            "comment": f"{where}; {comment}",
        }
        for side, where in (("y", _RIGHT), ("z", _UP))
    }


def _residual(comment: str) -> dict[str, dict[str, Any]]:
    return {
        f"residual_{side}": {
            "units": "m",
            "long_name": f"measured minus predicted spot, {'to the right' if side == 'y' else 'upwards'}",
            "comment": f"{where}; {comment}",
        }
        for side, where in (("y", _RIGHT), ("z", _UP))
    }


#: Of synthetic spots, at each instant.
SYNTHETIC: dict[str, dict[str, Any]] = {
    **_residual("missing on days that are not used"),
    **_spot("before", "where the true errors send the beam; without noise"),
    **_spot("after", "where the beam goes with corrected commands; without noise"),
}
#: Of measured ones, each.
MEASURED: dict[str, dict[str, Any]] = {
    **_residual("in the order of the file"),
    **_spot("before", "as measured; in the order of the file"),
    **_spot("after", "residual of the prediction that leaves out the spot itself; in the order of the file"),
}
_DEGREES = {"units": "degree"}
#: Commands, at each instant.
NOMINAL: dict[str, dict[str, Any]] = {
    "nominal_azimuth": _DEGREES | {"long_name": "angle commanded of the primary axis without calibration"},
    "nominal_elevation": _DEGREES | {"long_name": "angle commanded of the secondary axis without calibration"},
}
CORRECTED: dict[str, dict[str, Any]] = {
    "corrected_azimuth": _DEGREES
    | {
        "long_name": "angle to command of the primary axis with the estimated errors",
        "comment": "missing without sun, in the blind cone and where no estimate is to be trusted",
    },
    "corrected_elevation": _DEGREES
    | {
        "long_name": "angle to command of the secondary axis with the estimated errors",
        "comment": "missing without sun, in the blind cone and where no estimate is to be trusted",
    },
}
