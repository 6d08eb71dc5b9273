"""Modes `calibration` and `detectors`: estimate mount errors, and compute corrected commands.

Mode `calibration` uses measured or synthetic spots. Mode `detectors` uses crossings of traces with detector arrays, and
corrects the commands of synthetic mounts in a closed loop. The first two axes of each array are the heliostats (H) and
the draws (K). For measured spots and measured crossings, K is 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import PurePath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.families.family import Computation, Point, by_axis
from heliosweep.families.misalignment.spots import (
    NOISE_STREAMS,
    SIDES,
    Scene,
    coded,
    draw_count,
    drawn_errors,
    error_keys,
    instant_sizes,
    noise_of_draws,
    numbered,
)
from heliosweep.families.misalignment.spots_file import TRACES, MeasuredSpots, Segments, segments_of
from heliosweep.families.misalignment.study import MisalignmentStudy
from heliosweep.grid import Variable, flags, pair, quantity, with_best
from heliosweep.kernels import calibration as codes
from heliosweep.kernels import traces
from heliosweep.kernels.calibration import ESTIMATED, INDISTINCT, SQUARED, Fit, Mounts, Observed, fit
from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.mounts import ERRORS, Setting, Stand
from heliosweep.kernels.spots import mount_spots
from heliosweep.mounts import CALIBRATION_STATUS, LOSSES, error_changes

Values = dict[str, NDArray[Any]]

#: Status codes that the kernel does not set: the estimate is doubtful, or the spots disagree.
DOUBTFUL, DISAGREE = 7, 8
#: Status codes of estimates that can be used for commands.
KNOWN = (ESTIMATED, INDISTINCT, codes.EXACT, DOUBTFUL, DISAGREE)
#: Meanings of `calibration_status`; % is replaced by "spot" or "crossing".
STATUS = {
    **CALIBRATION_STATUS,
    DOUBTFUL: "estimated_but_errors_or_spots_are_too_large_to_be_believed",
    DISAGREE: "estimated_but_spots_disagree",
}
#: Limits above which an estimate is doubtful: magnitude of a mount error [mrad], and distance between a measured spot
#: and the spot of a mount without errors [widths or heights of the aperture].
DOUBTFUL_ERROR, DOUBTFUL_APERTURES = 50.0, 3.0
#: Maximum distance of a consistent spot from its robust prediction. [robust standard deviations]
LARGEST_DEVIATION = 5.0
#: Codes for alternative interpretations of a spot table.
MIRRORED, EARLIER, LATER = 1, 2, 3
READINGS = {0: "as_given", MIRRORED: "mirrored", EARLIER: "an_hour_earlier", LATER: "an_hour_later"}
#: Median length of a vector with two standard normal coordinates. Tuning constant of Huber's weights. Number of fits
#: with these weights.
_MEDIAN, _HUBER, _ROUNDS = 1.17741, 1.345, 2
#: Distance between a spot and its prediction below which the spot never counts as an outlier. [m]
LEAST_DISTANCE = 0.005
#: Minimum factor by which an alternative interpretation of the table must reduce the residuals, and minimum number of
#: degrees of freedom for the comparison.
MUCH_BETTER, LEAST_FREEDOM = 2.0, 4
#: Long names of residuals and of spots before and after calibration. Each long name is followed by a comment for
#: synthetic spots and a comment for measured spots.
_SPOTS = {
    "residual_{}": (
        "measured minus predicted spot",
        "missing on days that the calibration does not use",
        "in the order of the file",
    ),
    "spot_{}_before": (
        "spot before the calibration",
        "position with the true errors; without noise",
        "as measured; if commanded angles are given, relative to the spot of a mount without errors; in the order of "
        "the file",
    ),
    "spot_{}_after": (
        "spot after the calibration",
        "position with corrected commands; without noise",
        "leave-one-out residual of the spot; in the order of the file",
    ),
}
#: Descriptions of the positive directions of spot positions and residuals.
_WHERE = {
    "y": f"{SIDES['y']} for an observer in the field who faces the receiver",
    "z": f"{SIDES['z']}, along the receiver's face",
}
#: Mount axis for each encoder angle.
MOUNT_AXES = {"azimuth": "primary", "elevation": "secondary"}
#: Variables whose best value is the minimum.
_SMALLEST = (
    *("standard_error", "condition_number", "residual_rms", "leave_one_out_rms", "instants_without_command"),
    *("beam_residual_rms", "uncalibrated_beam_residual_rms", "beam_error_rms", "spot_distance_rms"),
    *("held_out_residual_rms", "uncalibrated_held_out_residual_rms", "period_standard_error"),
)


#: Values of `detector_status`, for each heliostat and instant.
SEEN, NO_ELEVATION, NO_AZIMUTH, NEITHER, NO_LIGHT = 0, 1, 2, 3, 4
SIGHT = {
    SEEN: "each_trace_crosses_an_array",
    NO_ELEVATION: "elevation_trace_crosses_no_array",
    NO_AZIMUTH: "azimuth_trace_crosses_no_array",
    NEITHER: "no_trace_crosses_an_array",
    NO_LIGHT: "no_sun_or_no_way_to_aim_or_mirror_behind_the_plane",
}
#: Default values of the keys of `detectors` that a study may omit.
DEFAULTS: dict[str, Any] = {"pitch": 0.0, "noise": 0.0, "parameters": 4, "correction": "mount"}
_SIDES = SIDES | {"z": _WHERE["z"]}


def calibration_work(study: MisalignmentStudy) -> Computation:
    """Return the computation for mode `calibration`."""
    lead, each, measured = ("heliostat",), ("heliostat", *instant_sizes(study)), study.table_of_spots() is not None
    block: Any = study.calibration
    found = estimate_variables("spot", not measured, block.condition_limit) | {
        "leave_one_out_rms": quantity(
            lead,
            "m",
            "root mean square of the leave-one-out residuals of spots, per coordinate",
            "computed to first order from the spot's block of the hat matrix; missing if only one spot determines an "
            "error",
        ),
        "instants_without_command": quantity(
            lead,
            "1",
            "number of instants with sun at which no corrected command directs the beam to the aim point",
            "because of the mount's blind cone, or because the heliostat is closer to the aim point than the mirror "
            "offsets; 0 without an estimate",
            dtype="int32",
        ),
    }
    angle = "root mean square of the angle between measured and predicted spots, seen from the pivot"
    comment = "angle of the beam, twice the angle of the mirror; over the spots used"
    if measured:
        found |= {
            "beam_residual_rms": quantity(lead, "mrad", angle, f"{comment}, with the estimated errors"),
            "uncalibrated_beam_residual_rms": quantity(lead, "mrad", f"{angle}, without calibration", comment),
            "spot_deviation": quantity(
                (*lead, "spot"),
                "1",
                "distance of the spot from its prediction, in robust standard deviations of a coordinate",
                "the prediction is a fit with Huber's weights; the standard deviation follows from the median "
                f"distance of the heliostat's spots; a spot with a value above {LARGEST_DEVIATION:g} disagrees with "
                "the other spots",
            ),
            "better_reading": coded(
                lead, "alternative interpretation of the table that more than halves the residuals", READINGS
            ),
            "spot_time": Variable(
                (*lead, "spot"),
                {"long_name": "universal time of the spot", "comment": "missing if the table has sun vectors"},
                np.dtype("datetime64[ns]"),
            ),
        }
    if block.held_out is not None:
        rms_of = "root mean square residual of the held-out spots"
        found |= {
            "held_out": flags((*lead, "spot"), "flag for spots that test the calibration", {0: "used", 1: "held_out"}),
            "held_out_spots": quantity(lead, "1", "number of held-out spots", dtype="int32"),
            "held_out_residual_rms": quantity(lead, "mrad", f"{rms_of}, with the estimated errors", comment),
            "uncalibrated_held_out_residual_rms": quantity(lead, "mrad", f"{rms_of}, without calibration", comment),
        }
    if block.window is not None:
        windows, errors = (*lead, "period"), (*lead, "period", "parameter")
        words, since = {-1: "no_change", 0: "unchanged", 1: "changed"}, "since the first window with an estimate"
        found |= {
            "period_error": quantity(errors, "mrad", "estimate of the mount error from the spots in a window"),
            "period_standard_error": quantity(errors, "mrad", "standard error of the estimate from a window"),
            "period_spots": quantity(windows, "1", "number of spots used in a window", dtype="int32"),
            "period_change": quantity(errors, "mrad", f"change in the mount error {since}"),
            "period_change_error": quantity(errors, "mrad", f"standard error of the change in the mount error {since}"),
            "drift": replace(flags(errors, f"flag for mount errors that have changed {since}", words,
                                   "a change is outside the 99.9 % confidence interval for no change (t distribution)"),
                             missing=-1),
        }  # fmt: skip
    for name, (meaning, *comments) in _SPOTS.items():
        dims = (*lead, "spot") if measured else each
        found |= {
            name.format(side): quantity(dims, "m", f"{meaning}, {towards}", f"{_WHERE[side]}; {comments[measured]}")
            for side, towards in (("y", "to the right"), ("z", "upwards"))
        }
    variables = finished(study, found)
    keys = ["calibration.noise", "calibration.days_used", *error_keys(study)] * (not measured)

    def count() -> int:
        return (math.prod(instant_sizes(study).values()) * max(1, draw_count(study))) + most_spots(study.campaigns())

    return Computation(
        partial(calibrate, variables),
        variables,
        ("calibration.parameters", "calibration.loss", "calibration.loss_scale", *keys),
        labels_of(study, "spot"),
        attrs={"spots": "measured" if measured else "synthetic"},
        inputs=study.campaigns,
        evaluations=count,
        memory=lambda: 1000 * count(),  # bytes for each spot in a fit
        unit="spots",
    )


def labels_of(study: MisalignmentStudy, what: str) -> dict[str, Any]:
    """Return the labels of the estimates' inner dimensions. `what` is "spot" or "crossing"."""
    error, draws = (np.array(ERRORS, dtype=object), {"long_name": "mount error"}), draw_count(study)
    labels: dict[str, Any] = {"parameter": error, "parameter_2": error}
    if draws:
        labels["sample"] = numbered(draws, "number of the draw, counted from 0")
    if study.table_of_spots() is not None:
        meaning = f"number of the {what} of a heliostat, counted from 0, in the order of the file"
        labels["spot"] = lambda campaigns: numbered(most_spots(campaigns), meaning)
    if study.calibration and study.calibration.window is not None:
        labels["period"] = lambda campaigns: (periods(study, campaigns), {"long_name": "start of the window"})
    return labels


def most_spots(campaigns: Mapping[str, MeasuredSpots]) -> int:
    """Return the maximum number of spots per heliostat over all campaigns; 0 without campaigns."""
    return max((measured.most for measured in campaigns.values()), default=0)


def periods(study: MisalignmentStudy, campaigns: Mapping[str, MeasuredSpots]) -> NDArray[np.datetime64]:
    """Return the start times of the moving windows. The windows cover the days from the first to the last spot."""
    block: Any = study.calibration
    times = np.concatenate([measured.utc for measured in campaigns.values()])
    first, day = times.min().astype("datetime64[D]").astype("datetime64[ns]"), np.timedelta64(1, "D")
    step = block.window_step or block.window
    count = max(0, math.floor(((times.max() - first) / day - block.window) / step) + 1)
    return np.asarray(first + np.arange(count + 1) * np.timedelta64(round(step * 86400e9), "ns"))


def finished(study: MisalignmentStudy, found: Mapping[str, Variable]) -> dict[str, Variable]:
    """Add the variables for commands and, if errors are drawn, the `sample` dimension.

    An attribute marks the variables whose best value is the minimum or the maximum.
    """
    lead, each = ("sample",) if draw_count(study) else (), ("heliostat", *instant_sizes(study))
    nominal = pair("nominal_%", MOUNT_AXES, each, "degree", "commanded angle of the % axis without calibration")
    meaning = "corrected command of the % axis with the estimated errors"
    comment = "missing without sun, in the blind cone, and without a usable estimate"
    drawn = {**found, **pair("corrected_%", MOUNT_AXES, each, "degree", meaning, comment)}
    made = {name: replace(one, dims=(*lead, *one.dims)) for name, one in drawn.items()}
    return with_best(made | nominal, ("crossed_fraction", "round_hit_fraction"), _SMALLEST)


def arranged(study: MisalignmentStudy, variables: Mapping[str, Variable], values: Values) -> Values:
    """Reshape each array to the dimensions of its variable."""
    instants, made = tuple(instant_sizes(study).values()), {}
    for name in values.keys() & variables.keys():
        dims, array = variables[name].dims, values[name]
        if not name.startswith("nominal"):
            array = array.swapaxes(0, 1) if "sample" in dims else array[:, 0]
        at = dims.index("hour") - 1 if "hour" in dims else array.ndim
        made[name] = array.reshape(*array.shape[:at], *instants[: len(dims) - at], *array.shape[at + 1 :])
    return made


def estimate_variables(what: str, synthetic: bool, limit: float | None = None) -> dict[str, Variable]:
    """Return the variables of estimates from spots or crossings.

    `limit` is the condition number above which a warning is given; None for the default limit.
    """
    lead, of_errors, spots = ("heliostat",), ("heliostat", "parameter"), what == "spot"
    more: dict[str, Any] = {} if limit is None else {"condition_limit": float(limit)}
    meanings = {code: words.replace("%", what) for code, words in STATUS.items() if spots or code < DOUBTFUL}
    truth = {"true_error": quantity(of_errors, "mrad", f"true mount error of the synthetic {what}s")}
    interval = (
        "95 % confidence intervals follow from the t distribution with 2 spots_used - parameters degrees of freedom; "
        "they contain the true error in 95 % of the cases if the spots are from at least two days, but only in 85 to "
        "90 % if six errors are estimated from spots of one day; missing if the numbers of equations and errors are "
        "equal"
        if spots
        else (
            "computed from the noise and pitch of the detectors (pitch / sqrt(12) without noise), or from the "
            "residuals if both are 0; 95 % confidence intervals extend 1.96 standard errors on either side"
        )
    )
    return {
        "estimated_error": quantity(
            of_errors,
            "mrad",
            "estimate of the mount error",
            "missing for errors that are not estimated, and if calibration_status is not an estimate; for a fit that "
            "did not converge, the last iterate",
        ),
        "standard_error": quantity(of_errors, "mrad", "standard error of the estimate", interval),
        "covariance": quantity(
            (*of_errors, "parameter_2"),
            "mrad2",
            "covariance of the estimates",
            "scaled by the variance of the residuals; with a robust loss, the covariance of an M-estimator (Huber and "
            "Ronchetti 2009, section 7.6)" * spots,
        ),
        "condition_number": quantity(
            lead,
            "1",
            "condition number of the Jacobian at the estimate",
            "ratio of the largest to the smallest singular value, with all errors in the same unit",
            **more,
        ),
        "residual_rms": quantity(lead, "m", f"root mean square of the residuals of the {what}s used, per coordinate"),
        f"{what}s_used": quantity(lead, "1", f"number of {what}s used", dtype="int32"),
        "calibration_status": coded(lead, "status of the estimate", meanings),
        "least_known_direction": replace(
            flags(
                lead,
                f"error with the largest component in the combination of errors that the {what}s determine "
                "least accurately",
                dict(enumerate(("nothing_estimated", *ERRORS), -1)),
            ),
            missing=-1,
        ),
    } | (truth if synthetic else {})


def fit_draws(mounts: Mounts, observed: Observed, **options: Any) -> Fit:
    """Fit the mount errors to the observations of each heliostat and draw, shape (H K, M, ...)."""
    count = len(mounts.frames)
    return fit(mounts.of(np.repeat(np.arange(count), len(observed.sun) // max(1, count))), observed, **options)


def estimates(found: Fit, samples: int, what: str) -> tuple[Values, Floats]:
    """Return the values of `estimate_variables`, and the mount errors that corrected commands assume.

    The errors have the shape (H, K, 6) [rad]; they are NaN without a usable estimate.
    """
    known = np.where(np.isin(found.status, KNOWN)[:, np.newaxis], np.nan_to_num(found.estimate), np.nan)
    made = {
        "estimated_error": found.estimate * 1e3,
        "standard_error": np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)) * 1e3,
        "covariance": found.covariance * 1e6,
        "condition_number": found.condition,
        **{
            f"{name}_rms": rms(np.sum(residual**2, axis=-1), found.counted, residual.shape[-1])
            for name, residual in (("residual", found.residual), ("leave_one_out", found.left_out))
        },
        f"{what}s_used": found.used,
        "calibration_status": found.status,
        "least_known_direction": found.least_known,
    }
    values = {name: array.reshape(-1, samples, *array.shape[1:]) for name, array in made.items()}
    return values, known.reshape(-1, samples, len(ERRORS))


def rms(squares: Floats, counted: NDArray[np.bool_], coordinates: int = 1) -> Floats:
    """Return the root mean square per coordinate along the last axis.

    Each entry of `squares` is a sum over `coordinates` coordinates. Only the entries flagged in `counted` are included;
    the result is NaN if no entry is flagged.
    """
    count = coordinates * np.count_nonzero(counted, axis=-1)
    total = np.sum(np.where(counted, squares, 0.0), axis=-1)
    return np.sqrt(np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0))


def observed_of(
    measured: MeasuredSpots, mounts: Mounts, numbers: NDArray[np.int64], held: NDArray[np.bool_] | None = None
) -> Observed:
    """Return the observed spots of each heliostat. Spots flagged in `held` have the weight 0.

    Missing commanded angles are computed for mounts without errors.
    """
    sun, angles = measured.lists(numbers, measured.sun), measured.lists(numbers, measured.angles)
    angles = np.where(np.isnan(angles).any(axis=-1, keepdims=True), mounts.aim(sun), angles)
    weight = measured.lists(numbers, measured.weight if held is None else measured.weight * ~held, 0.0)
    return Observed(sun, angles, measured.lists(numbers, measured.position), weight)


def command_values(mounts: Mounts, sun: Floats, corrected: Floats) -> Values:
    """Return the nominal and corrected commands by variable name. [deg]

    `corrected` contains the corrected angles, shape (H, K, T, 2). [rad]
    """
    return by_axis("nominal_%", np.degrees(mounts.aim(sun)), -1, MOUNT_AXES) | by_axis(
        "corrected_%", np.degrees(corrected), -1, MOUNT_AXES
    )


def calibrate(variables: dict[str, Variable], point: Point) -> Values:
    """Estimate mount errors and compute corrected commands at one point of the parameter grid."""
    study, scene, block = point.study, Scene.of(point), point.study.calibration
    options = {
        "parameters": int(point["calibration.parameters"]),
        "loss": LOSSES.index(point["calibration.loss"]),
        "loss_scale": float(point["calibration.loss_scale"]),
        "condition_limit": block.condition_limit,
    }
    values, known = (_measured if point.inputs else _synthetic)(point, scene, options)
    mounts, sun = scene.mounts(), scene.sun
    corrected = mounts.aim(sun, known[:, :, np.newaxis])
    some = np.all(np.isfinite(known), axis=-1)[..., np.newaxis]
    none = np.any(np.isnan(corrected), axis=-1) & some & (sun[:, 2] > 0.0)
    values |= {"instants_without_command": np.count_nonzero(none, axis=-1)} | command_values(mounts, sun, corrected)
    return arranged(study, variables, values)


def _synthetic(point: Point, scene: Scene, options: dict[str, Any]) -> tuple[Values, Floats]:
    """Estimate the mount errors from synthetic spots.

    Return the variables, and the mount errors that the corrected commands assume, shape (H, K, 6). [rad]
    """
    seed, noise, mounts = point.study.mount_errors.seed or 0, point["calibration.noise"], scene.mounts()
    days, hours = instant_sizes(point.study).values()
    used = hours * int(point["calibration.days_used"] or days)
    (drawn,) = drawn_errors(point, scene.numbers)
    count, samples, _ = drawn.shape
    before = _spots(scene, 1e-3 * drawn, np.zeros((1, 1, len(ERRORS))))
    measured = before[:, :, :used]
    if noise > 0 and count:
        drawing = tuple(scene.numbers.tolist()), samples, days * hours
        sides = [noise_of_draws(seed, stream, *drawing)[:, :, :used] for stream in NOISE_STREAMS]
        measured = measured + noise * np.stack(sides, axis=-1)
    shape, sun = (count * samples, used), scene.sun[:used]
    ideal = np.repeat(mounts.aim(sun), samples, axis=0)
    observed = Observed(np.broadcast_to(sun, (*shape, 3)), ideal, measured.reshape(*shape, 2), np.ones(shape))
    found = fit_draws(mounts, observed, **options)
    values, known = estimates(found, samples, "spot")
    residual = np.full(before.shape, np.nan)
    residual[:, :, :used] = found.residual.reshape(measured.shape)
    values |= (
        by_axis("residual_%", residual, -1, "yz") | by_axis("spot_%_before", before, -1, "yz") | {"true_error": drawn}
    )
    return values | by_axis("spot_%_after", _spots(scene, 1e-3 * drawn, known), -1, "yz"), known


def _spots(scene: Scene, actual: Floats, known: Floats) -> Floats:
    """Return the spots (y, z) of mounts with the errors `actual` if the commands correct the errors `known`.

    Both arrays of errors have the shape (H, K, 6) [rad]; `known` may also have the shape (1, 1, 6). The spots have the
    shape (H, K, T, 2) [m].
    """
    setting = Setting._make(np.repeat(values, actual.shape[1]) for values in scene.setting)
    each = np.swapaxes(actual, 0, 1), np.swapaxes(known, 0, 1)
    return np.transpose(mount_spots(setting, *each, scene.sun[np.newaxis], scene.pivots[np.newaxis])[:2], (2, 1, 3, 0))


def _measured(point: Point, scene: Scene, options: dict[str, Any]) -> tuple[Values, Floats]:
    """Estimate the mount errors from measured spots, and check whether the spots are consistent.

    Return the variables, and the mount errors that the corrected commands assume, shape (H, 1, 6). [rad]
    """
    block, measured = point.study.calibration, point.inputs[PurePath(point["calibration.spots"]).name]
    mounts, numbers, all_held = scene.mounts(), scene.numbers, measured.held_out(block.held_out)
    observed, held = observed_of(measured, mounts, numbers, all_held), measured.lists(numbers, all_held, False)
    utc = measured.lists(numbers, measured.utc, np.datetime64("NaT", "ns"))
    given = ~np.isnan(measured.lists(numbers, measured.angles)).any(axis=-1)
    found = fit(mounts, observed, **options)
    before = np.where(given[..., np.newaxis], found.uncalibrated, observed.position)
    deviation, status = _deviations(mounts, observed, found, options["parameters"]), found.status.copy()
    if options["loss"] == SQUARED:
        status[(status == ESTIMATED) & (deviation > LARGEST_DEVIATION).any(axis=1)] = DISAGREE
    half = np.array([scene.setting.half_width[0], scene.setting.half_height[0]])
    far = (np.abs(before) > 2 * DOUBTFUL_APERTURES * half).any(axis=-1) & (observed.weight > 0)
    status[np.isin(status, KNOWN) & (_large(found) | far.any(axis=1))] = DOUBTFUL
    single = {
        "spot_deviation": deviation,
        "spot_time": utc,
        "held_out": held,
        "held_out_spots": np.count_nonzero(held, axis=1),
        "better_reading": _better_reading(mounts, observed, given, found, float(scene.setting.latitude[0]), options),
    }
    for name, residual in (("beam_residual_rms", found.residual), ("uncalibrated_beam_residual_rms", before)):
        squares = _angles(mounts, observed.position, residual) ** 2
        single[name] = 1e3 * rms(squares, found.counted)
        single[name.replace("beam", "held_out")] = 1e3 * rms(squares, held & np.isfinite(squares))
    if block.window is not None:
        single |= _in_windows(mounts, observed, utc, periods(point.study, point.inputs), block.window, options)
    single |= by_axis("residual_%", found.residual, -1, "yz") | by_axis("spot_%_before", before, -1, "yz")
    single |= by_axis("spot_%_after", found.left_out, -1, "yz")
    values, known = estimates(found._replace(status=status), 1, "spot")
    return values | {name: array[:, None] for name, array in single.items()}, known


def _in_windows(
    mounts: Mounts, observed: Observed, utc: NDArray[np.datetime64], starts: NDArray[np.datetime64], days: float,
    options: dict[str, Any],
) -> Values:  # fmt: skip
    """Estimate the mount errors from the spots in each time window, and their changes since the first estimate.

    The arrays have the shape (H, periods, ...).
    """
    length, windows = np.timedelta64(round(days * 86400e9), "ns"), []
    for start in starts:
        inside = (utc >= start) & (utc < start + length)
        fitted = fit(mounts, observed._replace(weight=np.where(inside, observed.weight, 0.0)), **options)
        usable = np.isin(fitted.status, KNOWN)[:, np.newaxis]
        each = fitted.estimate, np.sqrt(np.diagonal(fitted.covariance, axis1=1, axis2=2))
        windows.append((*(np.where(usable, 1e3 * values, np.nan) for values in each), fitted.used))
    error, spread, used = (np.stack(each) for each in zip(*windows, strict=True))
    changes = error_changes(error, spread, 2 * used - options["parameters"])
    found = {
        "period_error": error,
        "period_standard_error": spread,
        "period_spots": used,
        "period_change": changes["change"],
        "period_change_error": changes["change_error"],
        "drift": changes["changed"],
    }
    return {name: np.swapaxes(np.asarray(each), 0, 1) for name, each in found.items()}


def _angles(mounts: Mounts, position: Floats, residual: Floats) -> Floats:
    """Return the angles that the residuals subtend at the pivots, shape (H, M). [rad]"""
    seen = mounts.on_face(position) + mounts.to_target[:, np.newaxis]
    predicted = seen - mounts.on_face(residual)
    return np.arctan2(np.sqrt(np.sum(np.cross(seen, predicted) ** 2, axis=-1)), np.sum(seen * predicted, axis=-1))


def _deviations(mounts: Mounts, observed: Observed, found: Fit, parameters: int) -> Floats:
    """Return the distance of each spot from a robust prediction, shape (H, M).

    The unit is the robust standard deviation of a coordinate. Two fits with Huber's weights reduce the influence of
    outliers. Distances below `LEAST_DISTANCE` count as 0. The result is NaN for spots with weight 0.
    """
    weight = observed.weight / _medians(np.where(observed.weight > 0, observed.weight, np.nan))
    for remaining in reversed(range(_ROUNDS + 1)):
        distance = np.hypot(found.residual[..., 0], found.residual[..., 1])
        distance = np.where(weight > 0, distance * np.sqrt(weight), np.nan)
        used = np.count_nonzero(np.isfinite(distance), axis=1)[:, np.newaxis]
        sigma = _medians(distance) / _MEDIAN * np.sqrt(used / np.maximum(used - parameters / 2, 0.5))
        with np.errstate(invalid="ignore", divide="ignore"):
            deviation: Floats = distance / sigma
        if remaining:
            shares = np.minimum(1.0, 2 * _HUBER / np.fmax(deviation, _HUBER))
            found = fit(mounts, observed._replace(weight=observed.weight * shares), parameters=parameters)
    return np.where(distance < LEAST_DISTANCE, 0.0, deviation)


def _medians(values: Floats) -> Floats:
    """Return the median of each row, ignoring NaN, shape (H, 1). The result is NaN if a row has no values."""
    row, number = np.arange(len(values)), np.count_nonzero(~np.isnan(values), axis=1)
    ordered = np.sort(values, axis=1)  # NaN last
    return (0.5 * (ordered[row, (number - 1) // 2] + ordered[row, number // 2]))[:, np.newaxis]


def _better_reading(
    mounts: Mounts, observed: Observed, given: NDArray[np.bool_], found: Fit, latitude: float, options: dict[str, Any]
) -> NDArray[np.int64]:
    """Return the code in `READINGS` of the best interpretation of each heliostat's spots, shape (H,).

    An alternative interpretation is chosen if its mount errors are plausible and it more than halves the root mean
    square residual. In a mirrored table, the sign of y or z is reversed. For times that are an hour early or late, the
    sun is rotated by 15 deg about the Earth's axis, and missing commanded angles are computed for the rotated sun.
    """
    pole = np.array([0.0, np.cos(latitude), np.sin(latitude)])

    def residuals(**changes: Any) -> Floats:
        fitted = fit(mounts, observed._replace(**changes), **options) if changes else found
        counted = np.isfinite(fitted.residual).all(axis=-1) & (observed.weight > 0)
        spread = rms(np.sum(fitted.residual**2, axis=-1), counted, 2)
        good = np.isin(fitted.status, (ESTIMATED, INDISTINCT)) & np.isfinite(spread) & ~_large(fitted)
        return np.where(good, spread, np.inf)

    def at_hour(hours: float) -> Floats:
        sun = traces.turned(pole, observed.sun, math.radians(-15.0 * hours))
        return residuals(sun=sun, angles=np.where(given[..., np.newaxis], observed.angles, mounts.aim(sun)))

    mirrored = [residuals(position=observed.position * signs) for signs in ([-1.0, 1.0], [1.0, -1.0])]
    readings = np.array([residuals(), np.minimum(*mirrored), at_hour(-1.0), at_hour(1.0)])
    enough = 2 * np.count_nonzero(observed.weight > 0, axis=1) >= options["parameters"] + LEAST_FREEDOM
    better = enough & (MUCH_BETTER * readings.min(axis=0) < readings[0]) & (readings[0] > LEAST_DISTANCE)
    return np.where(better, np.argmin(readings, axis=0), 0)


def _large(found: Fit) -> NDArray[np.bool_]:
    return np.asarray(np.nanmax(np.abs(found.estimate), axis=1, initial=0.0) > DOUBTFUL_ERROR * 1e-3)


def detectors_work(study: MisalignmentStudy) -> Computation:
    """Return the computation for mode `detectors`."""
    lead, each, measured = ("heliostat",), ("heliostat", *instant_sizes(study)), study.table_of_spots() is not None
    block: Any = study.detectors
    of_array, of_rounds = (*each, "trace", "detector", "crossing"), (*lead, "round")
    whose = "of the aligned heliostat" if measured else "before any correction, without noise"
    meaning = f"crossing of a trace and a detector array {whose}, %"
    found = pair(
        "crossing_%", _SIDES, of_array, "m", meaning, "ascending along the array; missing if there are fewer crossings"
    ) | {
        "crossing_place": quantity(
            of_array,
            "m",
            f"position of a crossing {whose} along the array",
            "measured from the first point of the array; for an infinite line, from the foot of the perpendicular "
            "from the aim point",
        ),
        "crossing_angle": quantity(
            of_array,
            "mrad",
            f"angle from the mirror normal to the cylinder normal at the ray of a crossing {whose}",
            "positive upwards (elevation trace) or clockwise from above (azimuth trace)",
        ),
        "detector_status": coded(each, "crossings that the arrays detect", SIGHT),
        "crossed_fraction": quantity(
            (*lead, "trace", "detector"),
            "1",
            "fraction of the instants with sunlight at which a trace crosses an array",
            "missing if no instant has sunlight",
        ),
        "misses_array": flags(
            (*lead, "detector"),
            "flag for heliostats whose traces never cross an array",
            {0: "no", 1: "misses"},
        ),
    }
    found |= estimate_variables("crossing", not measured, block.condition_limit)
    meaning = "measured minus predicted crossing, along the array"
    residual = quantity((*lead, "spot"), "m", meaning, "in the order of the file")
    meaning = "deviation of the mirror from its command about the % axis, estimated from the crossings at one instant"
    over = "round 0: before any correction; over the instants with a spot"
    loop = {
        **pair("instant_%_error", MOUNT_AXES, each, "mrad", meaning, "all other errors are assumed to be zero"),
        **{
            f"instant_{axis}_standard_error": quantity(
                each,
                "mrad",
                f"standard error of instant_{axis}_error",
                "computed from the noise and pitch of the detectors; 0 if both are 0",
            )
            for axis in MOUNT_AXES
        },
        "beam_error_rms": quantity(
            of_rounds, "mrad", "root mean square of the angle between the beam and the direction to the aim point", over
        ),
        "spot_distance_rms": quantity(
            of_rounds, "m", "root mean square distance of the spot from the aim point", over
        ),
        "round_hit_fraction": quantity(
            of_rounds, "1", "fraction of the instants with sunlight at which the spot lies in the aperture",
            "round 0: before any correction",
        ),
        **pair("spot_%_before", _SIDES, each, "m", "spot before any correction, %"),
        **pair("spot_%_after", _SIDES, each, "m", "spot after the last round, %"),
    }  # fmt: skip
    variables = finished(study, found | ({"crossing_residual": residual} if measured else loop))
    segments, rounds = segments_of(block), block.rounds or 1
    dims = labels_of(study, "crossing") | {
        "trace": (np.array(TRACES, object), {"long_name": "trace, named after the axis of its cylinder"}),
        "detector": numbered(segments.starts.size, "number of the detector array, counted from 0, lines first"),
        "crossing": numbered(segments.most, "number of the crossing of a trace with an array, counted from 0"),
    }
    keys = [f"detectors.{key}" for key in ("parameters", "pitch", "noise")]
    if not measured:
        keys += ["detectors.correction", *error_keys(study)]
        dims["round"] = numbered(rounds + 1, "number of completed rounds of the closed loop")
    count = math.prod(instant_sizes(study).values()) * len(segments.array) * max(1, draw_count(study)) * rounds
    fixed = {"parameters": ((), DEFAULTS["parameters"], {"long_name": "number of estimated errors", "units": "1"})}
    described = zip(segments.array, segments.start, segments.along, np.ptp(segments.ends, axis=1), strict=True)
    words = (" ".join(f"{number:.12g}" for number in (*start, *along, length)) for _, start, along, length in described)
    return Computation(
        partial(detect, variables, segments),
        variables,
        tuple(keys),
        dims,
        coordinates=lambda: fixed if block.parameters is None else {},
        attrs={
            "crossings": "measured" if measured else "synthetic",
            "detectors": "; ".join(f"{array}: {one}" for array, one in zip(segments.array, words, strict=True)),
        },
        inputs=study.campaigns,
        evaluations=count,
        memory=3000 * count,  # bytes
        unit="crossings",
    )


def detect(variables: dict[str, Variable], segments: Segments, point: Point) -> Values:
    """Compute crossings, estimated errors and commands at one point of the parameter grid."""
    study, scene = point.study, Scene.of(point)
    given = {key: point[f"detectors.{key}"] for key in DEFAULTS}
    settings = DEFAULTS | {key: value for key, value in given.items() if value is not None}
    field = _Field(
        scene.mounts(),
        np.array([scene.setting.half_width[0], scene.setting.half_height[0]]),
        scene.sun,
        segments,
        float(np.hypot(settings["noise"], settings["pitch"] / np.sqrt(12.0))),
        {"parameters": int(settings["parameters"]), "condition_limit": study.detectors.condition_limit},
    )
    if point.inputs:  # measured crossings: estimate the errors, and compute the crossings of mounts without errors
        (measured,) = point.inputs.values()
        none = np.zeros((len(scene.numbers), 1, 1, len(ERRORS)))
        values = field.sights(field.mounts.stand(field.mounts.aim(field.sun, none), none))
        _, which = field.segments.nearest(measured.position)
        observed = observed_of(measured, field.mounts, scene.numbers)._replace(
            position=measured.lists(scene.numbers, field.mounts.on_face(measured.position)),
            trace=measured.lists(scene.numbers, np.asarray(measured.trace), 0),
            along=measured.lists(scene.numbers, field.mounts.on_face(field.segments.along[which])),
        )
        fitted = fit(field.mounts, observed, spread=field.spread, **field.options)
        found, known = estimates(fitted, 1, "crossing")
        residual = np.where(fitted.counted, fitted.residual[..., 0], np.nan)[:, np.newaxis]
        commanded = command_values(field.mounts, field.sun, field.mounts.aim(field.sun, known[:, :, np.newaxis]))
        return arranged(study, variables, values | found | commanded | {"crossing_residual": residual})
    (drawn,) = drawn_errors(point, scene.numbers)
    seeds = (study.mount_errors.seed or 0), tuple(scene.numbers.tolist())
    values = field.run_loop(1e-3 * drawn, settings, study.detectors.rounds or 1, seeds)
    return arranged(study, variables, values | {"true_error": drawn})


class _Field(NamedTuple):
    """Mounts, aperture, sun and detector arrays of a study at one point.

    `half` contains half the width and half the height of the aperture [m], and `sun` contains the unit vectors to the
    sun, shape (T, 3). `spread` is the standard deviation of a detector reading [m].
    """

    mounts: Mounts
    half: Floats
    sun: Floats
    segments: Segments
    spread: float
    options: dict[str, Any]

    def crossings(self, mirror: Stand) -> tuple[Floats, Floats]:
        """Return the positions of crossings along the arrays [m] and the cylinder angles at the crossings [rad].

        Both arrays have the shape (H, K, T, 2, A, C).
        """
        start, along = self.mounts.on_face(self.segments.start), self.mounts.on_face(self.segments.along)
        places, angles = traces.crossings(mirror, self.sun, start, along, self.segments.ends)
        places[~(traces.dot(mirror.centre, self.mounts.face[0]) > 0)] = np.nan
        return self.segments.by_array(places, angles)

    def observed(self, angles: Floats, readings: Floats) -> Observed:
        """Convert detector readings to observations, shape (H K, T, M, ...).

        Readings have the shape (H, K, T, 2, A, C) [m]. The commanded `angles` have the shape (H, K, T, 2) [rad].
        """
        shape = readings.shape
        plane, along = self.segments.points(readings)

        def listed(values: NDArray[Any]) -> NDArray[Any]:
            size = values.shape[-1]
            return np.broadcast_to(values, (*shape, size)).reshape(shape[0] * shape[1], shape[2], -1, size)

        per_instant = (slice(None), *[np.newaxis] * 3)
        return Observed(
            listed(self.sun[per_instant]),
            listed(angles[:, :, *per_instant]),
            listed(self.mounts.on_face(plane)),
            listed(np.isfinite(readings)[..., np.newaxis].astype(float))[..., 0],
            listed(np.arange(len(TRACES)).reshape(-1, 1, 1, 1))[..., 0],
            listed(self.mounts.on_face(along)),
        )

    def sights(self, mirror: Stand) -> Values:
        """Return the crossings of each trace with each array, and the reason for missing crossings."""
        places, turned = self.crossings(mirror)
        lit = np.isfinite(mirror.normal[..., 0]) & (traces.dot(mirror.centre, self.mounts.face[0]) > 0)
        crossed: NDArray[Any] = np.any(np.isfinite(places), axis=-1)  # (H, K, T, 2, A)
        status = SEEN + np.sum(np.where(crossed.any(axis=-1), 0, [NO_ELEVATION, NO_AZIMUTH]), axis=-1)
        count = np.count_nonzero(lit, axis=-1)[..., np.newaxis, np.newaxis]
        return by_axis("crossing_%", self.segments.points(places)[0], -1, "yz") | {
            "crossing_place": places,
            "crossing_angle": 1e3 * turned,
            "detector_status": np.where(lit, status, NO_LIGHT),
            "crossed_fraction": np.count_nonzero(crossed, axis=2) / np.where(count > 0, count, np.nan),
            "misses_array": ~crossed.any(axis=(2, 3)),
        }

    def remaining(self, mirror: Stand) -> tuple[Floats, Values]:
        """Return the spots, shape (H, K, T, 2) [m], and statistics of the beam errors, shape (H, K)."""
        rays = traces.reflected(mirror.normal, self.sun)
        places = traces.spots(mirror.centre, rays, self.mounts.face)
        places[~(traces.dot(mirror.normal, self.sun) > 0)] = np.nan
        turn = rays + mirror.centre / np.sqrt(traces.dot(mirror.centre, mirror.centre))[..., np.newaxis]
        angle = 2.0 * np.arcsin(np.minimum(0.5 * np.sqrt(traces.dot(turn, turn)), 1.0))
        real: NDArray[np.bool_] = np.isfinite(places).all(axis=-1)  # type: ignore[assignment]
        inside = np.count_nonzero(real & (np.abs(places) <= self.half).all(axis=-1), axis=-1)
        lit = np.count_nonzero(np.isfinite(mirror.normal[..., 0]), axis=-1)
        return places, {
            "beam_error_rms": 1e3 * rms(angle**2, real),
            "spot_distance_rms": rms(np.hypot(places[..., 0], places[..., 1]) ** 2, real),
            "round_hit_fraction": np.divide(inside, lit, out=np.full(lit.shape, np.nan), where=lit > 0),
        }

    def run_loop(
        self, actual: Floats, settings: dict[str, Any], rounds: int, seeds: tuple[int, tuple[int, ...]]
    ) -> Values:
        """Run the closed loop for mounts with the errors `actual`, shape (H, K, 6). [rad]

        The returned variables have the shape (H, K, ...).
        """
        count, draws, _ = actual.shape
        by_instant, actual = settings["correction"] == "instant", actual[:, :, np.newaxis]
        known: Floats = np.zeros((count, draws, 1, len(ERRORS)))
        angles = self.mounts.aim(self.sun, known)
        mirror = self.mounts.stand(angles, actual)
        values, (before, first) = self.sights(mirror), self.remaining(mirror)
        places, done, lists = values["crossing_place"], [first], []
        for number in range(rounds):
            noise: Floats | float = 0.0
            if settings["noise"] > 0 and count:
                drawn = noise_of_draws(
                    seeds[0], 200 + number, seeds[1], draws, math.prod(places.shape[2:])
                )  # other streams than for the noise of spots
                noise = settings["noise"] * drawn.reshape(places.shape)
            here = self.observed(angles, self.segments.readings(places, noise, settings["pitch"]))
            lists.append([each.reshape(count * draws, -1, *each.shape[3:]) for each in here if each is not None])
            every = Observed._make(np.concatenate(each, axis=1) for each in zip(*lists, strict=True))
            fitted = fit_draws(self.mounts, every, spread=self.spread, **self.options)
            found, better = estimates(fitted, draws, "crossing")
            instant = self.instants(here, angles.shape[:3]) if number == 0 or by_instant else {}
            values |= instant if number == 0 else {}
            better = better[:, :, np.newaxis]
            if by_instant:
                pair_of = [1e-3 * instant[f"instant_{axis}_error"] for axis in MOUNT_AXES]
                better = np.stack([*pair_of, *np.zeros((4, *pair_of[0].shape))], axis=-1)
            estimated = np.isfinite(better).all(axis=-1, keepdims=True)
            known = np.where(estimated, better, known)
            angles = self.mounts.aim(self.sun, known)
            mirror = self.mounts.stand(angles, actual)
            places, _ = self.crossings(mirror)
            after, left = self.remaining(mirror)
            done.append(left)
        values |= found | {name: np.stack([each[name] for each in done], axis=-1) for name in first}
        values |= by_axis("spot_%_before", before, -1, "yz") | by_axis("spot_%_after", after, -1, "yz")
        corrected = angles if by_instant else np.where(estimated, angles, np.nan)
        return values | command_values(self.mounts, self.sun, corrected)

    def instants(self, observed: Observed, shape: tuple[int, ...]) -> Values:
        """Estimate the offsets of both encoders from the crossings at each instant, shape (H, K, T)."""
        count = math.prod(shape)
        lists = Observed._make(None if each is None else each.reshape(count, *each.shape[2:]) for each in observed)
        found = fit_draws(self.mounts, lists, parameters=2, condition_limit=np.inf)
        spread = self.spread * np.sqrt(np.diagonal(found.inverse, axis1=1, axis2=2))
        spread = np.where(np.isfinite(found.estimate[:, :1]), spread, np.nan)
        return {
            f"instant_{axis}_{name}": 1e3 * array[:, column].reshape(shape)
            for name, array in (("error", found.estimate), ("standard_error", spread))
            for column, axis in enumerate(MOUNT_AXES)
        }
