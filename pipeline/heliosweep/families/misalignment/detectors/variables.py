"""The variables of the mode `detectors`: names, CF attributes and what each means, in the order of the file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from heliosweep.families.misalignment.blocks import Detectors
from heliosweep.families.misalignment.calibration.variables import EXACT, LEAST_KNOWN, NO_SPOTS, SMALLEST, angles
from heliosweep.families.misalignment.points import instant_sizes, swept_dims
from heliosweep.families.misalignment.spots import NO_HELIOSTAT, SIDES
from heliosweep.grid.regions import Variable, flags, pair, quantity, with_best
from heliosweep.kernels.spots import traces as codes

if TYPE_CHECKING:
    from heliosweep.families.misalignment.study import MisalignmentStudy

STATUS = {
    NO_HELIOSTAT: "no_heliostat",
    codes.ESTIMATED: "estimated",
    codes.TOO_FEW: "fewer_crossings_than_the_errors_need",
    codes.INDISTINCT: "estimated_but_the_condition_number_is_above_the_limit",
    codes.NOT_CONVERGED: "not_converged",
    codes.DEPENDENT: "crossings_cannot_tell_the_errors_apart",
    EXACT: "estimated_but_no_crossing_is_left_for_standard_errors",
    NO_SPOTS: "no_crossings",
}
#: What detectors see of a heliostat at an instant.
SEEN, NO_ELEVATION, NO_AZIMUTH, NEITHER, NO_LIGHT = 0, 1, 2, 3, 4
SIGHT = {
    NO_HELIOSTAT: "no_heliostat",
    SEEN: "each_trace_crosses_an_array",
    NO_ELEVATION: "elevation_trace_crosses_no_array",
    NO_AZIMUTH: "azimuth_trace_crosses_no_array",
    NEITHER: "no_trace_crosses_an_array",
    NO_LIGHT: "no_sun_or_no_way_to_aim_or_mirror_behind_the_plane",
}
#: How the misalignment at an instant was found.
NONE, BY_INVERSION, BY_LEAST_SQUARES = 0, 1, 2
_METHODS = {NONE: "none", BY_INVERSION: "exact_inversion", BY_LEAST_SQUARES: "least_squares"}

_SIDES = {"y": SIDES["y"], "z": f"{SIDES['z']}, along the receiver's face"}
_CROSSED = "rising along the array; missing where there are no more"


def detectors_block(study: MisalignmentStudy) -> Detectors:
    """Block of the study that says where the detectors are."""
    assert study.detectors is not None
    return study.detectors


def draw_count(study: MisalignmentStudy) -> int:
    """Draws of the errors; 0 where none is drawn."""
    return 0 if study.mount_errors is None else study.mount_errors.draws()


def variables(study: MisalignmentStudy) -> dict[str, Variable]:
    """Variables of a study's result."""
    swept, instants, measured = swept_dims(study), tuple(instant_sizes(study)), study.table_of_spots() is not None
    lead = (*swept, *(("sample",) if draw_count(study) else ()), "heliostat")
    each = (*lead, *instants)
    found = _seen(lead, each, "of the aligned heliostat" if measured else "before any correction, without noise")
    if not measured:
        found |= _at_instants(each)
    found |= _estimates(lead)
    if measured:
        meaning = "measured minus predicted crossing, along the array"
        found["crossing_residual"] = quantity((*lead, "spot"), "m", meaning, "in the order of the file")
    else:
        meaning = "error with which the crossings were made"
        found["true_error"] = quantity((*lead, "parameter"), "mrad", meaning)
        found |= _loop(lead, each)
    return with_best(found | angles(swept, each), ("crossed_fraction", "round_hit_fraction"), SMALLEST)


def _seen(lead: tuple[str, ...], each: tuple[str, ...], whose: str) -> dict[str, Variable]:
    """Crossings of traces and arrays."""
    dims = (*each, "trace", "detector", "crossing")
    meaning = f"crossing of a trace and an array of detectors {whose}, %"
    return pair("crossing_%", _SIDES, dims, "m", meaning, _CROSSED) | {
        "crossing_place": quantity(
            dims,
            "m",
            f"place of a crossing {whose} along the array",
            "from its first point; of a line without ends from the foot of the perpendicular of the aim point",
        ),
        "crossing_angle": quantity(
            dims,
            "mrad",
            f"angle from the normal of the mirror to that of the cylinder whose ray makes a crossing {whose}",
            "positive raises it (elevation trace) or turns it clockwise from above (azimuth trace)",
        ),
        "detector_status": flags(each, "what the arrays see of a heliostat", SIGHT),
        "crossed_fraction": quantity(
            (*lead, "trace", "detector"),
            "1",
            "part of the instants with light at which a trace crosses an array",
            "missing where there is no light at any instant",
        ),
        "misses_array": flags(
            (*lead, "detector"),
            "whether no trace of a heliostat crosses an array at any instant",
            {0: "no", 1: "misses"},
        ),
    }


def _at_instants(each: tuple[str, ...]) -> dict[str, Variable]:
    """The misalignment from the crossings of one instant."""
    found = {}
    for name, axis in (("azimuth", "primary"), ("elevation", "secondary")):
        meaning = (
            f"angle by which the mirror stands off the command about the {axis} axis, from one instant's crossings"
        )
        found[f"instant_{name}_error"] = quantity(each, "mrad", meaning, "all other errors are taken to be zero")
        comment = "from noise and pitch of the detectors; 0 without"
        meaning = f"standard error of instant_{name}_error"
        found[f"instant_{name}_standard_error"] = quantity(each, "mrad", meaning, comment)
    return found | {"inversion": flags(each, "how the misalignment at an instant was found", _METHODS)}


def _estimates(lead: tuple[str, ...]) -> dict[str, Variable]:
    """What is estimated of each heliostat and draw from all crossings."""
    return {
        "estimated_error": quantity(
            (*lead, "parameter"),
            "mrad",
            "estimate of the mount error from all crossings",
            "missing for errors that are not estimated, and where calibration_status says that nothing is",
        ),
        "standard_error": quantity(
            (*lead, "parameter"),
            "mrad",
            "standard error of the estimate",
            "from noise and pitch of the detectors (pitch / sqrt(12) where there is no noise); where both are 0 from "
            "the residuals; 95 % intervals are 1.96 standard errors to both sides",
        ),
        "covariance": quantity((*lead, "parameter", "parameter_2"), "mrad2", "covariance of the estimates"),
        "condition_number": quantity(
            lead,
            "1",
            "condition number of the Jacobian at the estimate",
            "largest over smallest singular value, all errors in the same unit",
        ),
        "residual_rms": quantity(lead, "m", "root mean square of measured minus predicted crossings, along the arrays"),
        "crossings_used": quantity(
            lead,
            "1",
            "number of crossings used",
            "without those where a trace all but runs along an array",
            dtype="int32",
        ),
        "calibration_status": flags(lead, "whether the errors are estimated, and why not", STATUS),
        "least_known_direction": flags(
            lead,
            "error with the largest part in the combination of errors that the crossings know least",
            LEAST_KNOWN,
        ),
    }


def _loop(lead: tuple[str, ...], each: tuple[str, ...]) -> dict[str, Variable]:
    """What is left after each round of the closed loop."""
    rounds, over = (*lead, "round"), "round 0: before any correction; over the instants with a spot"
    found = {
        "beam_error_rms": quantity(
            rounds, "mrad", "root mean square of the angle between the beam and the way to the aim point", over
        ),
        "spot_distance_rms": quantity(rounds, "m", "root mean square distance of the spot from the aim point", over),
        "round_hit_fraction": quantity(
            rounds, "1", "part of the instants with light in which the spot lies in the aperture", "round 0: before any"
        ),
    }
    before = pair("spot_%_before", _SIDES, each, "m", "spot before any correction, %")
    return found | before | pair("spot_%_after", _SIDES, each, "m", "spot after the last round, %")
