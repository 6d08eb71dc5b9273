"""Mode `calibration`: the errors of mounts from measured or synthetic spots, and commands that correct them."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.families.family import Computation
from heliosweep.families.misalignment import estimates
from heliosweep.families.misalignment.blocks import ERRORS, LOSSES, Calibration
from heliosweep.families.misalignment.draws import NOISE_STREAMS, drawn_errors, noise_of_draws
from heliosweep.families.misalignment.estimates import DISAGREE, DOUBTFUL, KNOWN, Values, draw_count, pairs, rms
from heliosweep.families.misalignment.points import Scene, coded, instant_sizes
from heliosweep.grid.regions import Variable, quantity
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.mounts.aiming import aim
from heliosweep.kernels.spots.calibration import ESTIMATED, INDISTINCT, SQUARED, Fit, Mounts, Observed, fit
from heliosweep.kernels.spots.mount_spots import mount_spots
from heliosweep.kernels.spots.receiver import Setting
from heliosweep.mounts import commands

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.spots_file import MeasuredSpots
    from heliosweep.families.misalignment.study import MisalignmentStudy
    from heliosweep.families.points import Point

#: Errors of a mount [mrad], and distances of a measured spot from the prediction of a mount without errors [widths and
#: heights of the aperture], above which an estimate is doubtful.
DOUBTFUL_ERROR, DOUBTFUL_APERTURES = 50.0, 3.0
#: Deviation of a spot from the prediction of the others, in robust standard deviations, above which it disagrees.
LARGEST_DEVIATION = 5.0
#: Other readings of a table of measured spots, and the words for each in a warning.
MIRRORED, EARLIER, LATER = 1, 2, 3
READINGS = {0: "as_given", MIRRORED: "mirrored", EARLIER: "an_hour_earlier", LATER: "an_hour_later"}
#: Median length of a vector with two coordinates of standard deviation 1; scale of Huber's weights; number of fits.
_MEDIAN, _HUBER, _ROUNDS = 1.17741, 1.345, 2
#: Distance of a spot from its prediction that is no disagreement. [m]
LEAST_DISTANCE = 0.005
#: Factor by which another reading reduces the residuals, and degrees of freedom that the comparison needs.
MUCH_BETTER, LEAST_FREEDOM = 2.0, 4
#: Residuals, and spots before and after: long name, comment of synthetic and of measured spots.
_SPOTS = {
    "residual_{}": ("measured minus predicted spot", "missing on days that are not used", "in the order of the file"),
    "spot_{}_before": (
        "spot before the calibration",
        "position with the true errors; without noise",
        "as measured; with commanded angles relative to the spot of a mount without errors; in the order of the file",
    ),
    "spot_{}_after": (
        "spot after the calibration",
        "position with corrected commands; without noise",
        "residual of the prediction that leaves out the spot itself; in the order of the file",
    ),
}
#: Memory of the fit of one spot. [bytes]
_SPOT_BYTES = 1000


def computation(study: MisalignmentStudy) -> Computation:
    """Return the variables of a study and the function that computes them."""
    block, measured, found = calibration_block(study), study.table_of_spots() is not None, variables(study)
    keys = [f"calibration.{key}" for key in ("parameters", "loss", "loss_scale")]
    if not measured:
        keys += ["calibration.noise", "calibration.days_used", *estimates.error_keys(study)]

    def count() -> int:
        table = study.measured_spots()
        synthetic = math.prod(instant_sizes(study).values()) * max(1, draw_count(study))
        return synthetic + (0 if table is None else table.most)

    return Computation(
        partial(calibrate, found),
        found,
        tuple(keys),
        estimates.labels_of(study, "spot"),
        attrs={"spots": "measured" if block.spots else "synthetic"},
        inputs=study.measured_spots,
        evaluations=count,
        memory=lambda: _SPOT_BYTES * count(),
        unit="spots",
    )


def calibration_block(study: MisalignmentStudy) -> Calibration:
    """Return the block with the spots and the errors to estimate."""
    assert study.calibration is not None
    return study.calibration


def variables(study: MisalignmentStudy) -> dict[str, Variable]:
    """Variables of a study's result."""
    lead, each = ("heliostat",), ("heliostat", *instant_sizes(study))
    found, synthetic = (
        estimates.estimate_variables("spot", calibration_block(study).condition_limit),
        study.table_of_spots() is None,
    )
    meaning = "root mean square, per coordinate, of the residuals of predictions that leave out the spot"
    comment = (
        "to first order, by the block of the hat matrix of each spot; missing if a spot alone determines some errors"
    )
    found["leave_one_out_rms"] = quantity(lead, "m", meaning, comment)
    found["instants_without_command"] = quantity(
        lead,
        "1",
        "instants with sun and an estimate at which no command brings the beam to the aim point",
        "in the blind cone of the mount, or nearer to the aim point than the offsets of the mirror",
        dtype="int32",
    )
    if not synthetic:
        del found["true_error"]
        meaning = "root mean square of the angle between measured and predicted spot, seen from the pivot"
        comment = "of the beam, which rotates by twice the angle of the mirror; over the spots used"
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
            "better_reading": coded(lead, "reading of the spots that halves the residuals at least", READINGS),
            "spot_time": Variable(
                (*lead, "spot"),
                {"long_name": "universal time of the spot", "comment": "missing if the table has sun vectors"},
                np.dtype("datetime64[ns]"),
            ),
        }
    for name, (meaning, *comments) in _SPOTS.items():
        found |= estimates.spot_pairs(name, each if synthetic else (*lead, "spot"), meaning, comments[not synthetic])
    return estimates.finished(study, found | estimates.command_variables(study))


def calibrate(variables: dict[str, Variable], point: Point) -> Values:
    """Estimate the errors of the mounts at a point, and the commands that correct them."""
    study, scene = point.study, Scene.of(point)
    parameters = int(point["calibration.parameters"])
    options = {
        "parameters": parameters,
        "loss": list(LOSSES).index(point["calibration.loss"]),
        "loss_scale": float(point["calibration.loss_scale"]),
        "condition_limit": estimates.condition_limit(parameters, calibration_block(study).condition_limit),
    }
    values = _measured(scene, point.inputs, options) if point.inputs else _synthetic(point, scene, options)
    return estimates.arranged(study, variables, values)


def _synthetic(point: Point, scene: Scene, options: dict[str, Any]) -> Values:
    """Calibrate from synthetic spots, those of the days used."""
    block, samples, noise = point.study.mount_errors, max(1, draw_count(point.study)), point["calibration.noise"]
    count, (days, hours) = len(scene.numbers), instant_sizes(point.study).values()
    used, mounts = hours * int(point["calibration.days_used"] or days), scene.mounts()
    (drawn,) = drawn_errors(point, scene.numbers, samples)
    actual = 1e-3 * drawn
    before = _spots(scene, actual, np.zeros((1, 1, len(ERRORS))))
    measured = before[:, :, :used]
    if noise > 0 and count:
        shape = int(scene.numbers[0]), count, samples, days * hours
        sides = [noise_of_draws(block.seed or 0, stream, *shape)[:, :, :used] for stream in NOISE_STREAMS]
        measured = measured + noise * np.stack(sides, axis=-1)
    ideal = commands(mounts, scene.sun[:used], np.zeros((count, 1, len(ERRORS))))
    every = np.repeat(np.arange(count), samples)
    suns = np.broadcast_to(scene.sun[:used], (len(every), used, 3))
    observed = Observed(suns, ideal[every], measured.reshape(-1, used, 2), np.ones((len(every), used)))
    found = fit(mounts.of(every), observed, **options)
    values = estimates.estimates(found, samples, "spot")
    residual = np.full(before.shape, np.nan)
    residual[:, :, :used] = found.residual.reshape(measured.shape)
    known = estimates.known_errors(values["calibration_status"], found.estimate.reshape(drawn.shape))
    values |= pairs("residual_{}", residual) | pairs("spot_{}_before", before)
    values |= pairs("spot_{}_after", _spots(scene, actual, known)) | {"true_error": drawn}
    return values | _commands(mounts, scene.sun, known)


def _spots(scene: Scene, actual: Floats, known: Floats) -> Floats:
    """Spots y, z for actual errors (H, K, 6) and known ones (or (1, 1, 6)), shape (H, K, T, 2). [m]"""
    setting = Setting._make(np.repeat(values, actual.shape[1]) for values in scene.setting)
    each = np.swapaxes(actual, 0, 1), np.swapaxes(known, 0, 1)
    return np.transpose(mount_spots(setting, *each, scene.sun[np.newaxis], scene.pivots[np.newaxis])[:2], (2, 1, 3, 0))


def _commands(mounts: Mounts, sun: Floats, known: Floats) -> Values:
    """Commands for known errors of shape (H, K, 6), and the number of instants with sun without one."""
    corrected = commands(mounts, sun, known[:, :, np.newaxis])
    some = np.all(np.isfinite(known), axis=-1)[..., np.newaxis]
    none = np.any(np.isnan(corrected), axis=-1) & some & (sun[:, 2] > 0.0)
    return estimates.command_values(mounts, sun, corrected) | {
        "instants_without_command": np.count_nonzero(none, axis=-1)
    }


def _measured(scene: Scene, measured: MeasuredSpots, options: dict[str, Any]) -> Values:
    """Calibrate from measured spots, and check them against each other."""
    mounts, numbers = scene.mounts(), scene.numbers
    observed, given = (
        estimates.observed_of(measured, mounts, numbers),
        ~np.isnan(measured.lists(numbers, measured.angles)).any(axis=-1),
    )
    found = fit(mounts, observed, **options)
    before = np.where(given[..., np.newaxis], found.uncalibrated, observed.position)
    deviation, status = _deviations(mounts, observed, found, options["parameters"]), found.status.copy()
    if options["loss"] == SQUARED:
        status[(status == ESTIMATED) & (deviation > LARGEST_DEVIATION).any(axis=1)] = DISAGREE
    half = np.array([scene.setting.half_width[0], scene.setting.half_height[0]])
    far = (np.abs(before) > 2 * DOUBTFUL_APERTURES * half).any(axis=-1) & (observed.weight > 0)
    status[np.isin(status, KNOWN) & (_large(found) | far.any(axis=1))] = DOUBTFUL
    latitude = float(scene.setting.latitude[0])
    single = {
        "spot_deviation": deviation,
        "spot_time": measured.lists(numbers, measured.utc, np.datetime64("NaT", "ns")),
        "better_reading": _better_reading(mounts, observed, given, found, latitude, options),
    }
    for name, residual in (("beam_residual_rms", found.residual), ("uncalibrated_beam_residual_rms", before)):
        single[name] = 1e3 * rms(_angles(mounts, observed.position, residual)[..., np.newaxis], found.counted)
    spots = {"residual_{}": found.residual, "spot_{}_before": before, "spot_{}_after": found.left_out}
    for name, array in spots.items():
        single |= pairs(name, array)
    values = estimates.estimates(found._replace(status=status), 1, "spot") | {
        name: array[:, None] for name, array in single.items()
    }
    known = estimates.known_errors(status, found.estimate)
    return values | _commands(mounts, scene.sun, known[:, np.newaxis])


def _angles(mounts: Mounts, position: Floats, residual: Floats) -> Floats:
    """Angles of residuals seen from the pivots, shape (H, M). [rad]"""

    def on_face(places: Floats) -> Floats:
        # Without BLAS, whose bits depend on the number of rows.
        return places[..., :1] * mounts.face[1] + places[..., 1:] * mounts.face[2]

    seen = on_face(position) + mounts.to_target[:, np.newaxis]
    predicted = seen - on_face(residual)
    across = np.cross(seen, predicted)
    return np.arctan2(np.sqrt(np.sum(across**2, axis=-1)), np.sum(seen * predicted, axis=-1))


def _deviations(mounts: Mounts, observed: Observed, found: Fit, parameters: int) -> Floats:
    """Distance of each spot from a robust prediction, in robust standard deviations of a coordinate, shape (H, M).

    Two fits with Huber's weights reduce the influence of spots that are far from the others. Distances below
    `LEAST_DISTANCE` count as 0. The result is NaN for spots without weight.
    """
    listed = np.isfinite(observed.position).all(axis=-1)
    weight = observed.weight / np.maximum(_medians(np.where(listed, observed.weight, np.nan)), 1e-300)
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
    """Median of the values of each list that are not NaN, shape (H, 1); NaN without any."""
    ordered, count = np.sort(values, axis=1), np.count_nonzero(~np.isnan(values), axis=1)[:, np.newaxis]
    middles = [np.take_along_axis(ordered, np.maximum(at, 0), axis=1) for at in ((count - 1) // 2, count // 2)]
    return 0.5 * (middles[0] + middles[1])


def _better_reading(
    mounts: Mounts, observed: Observed, given: NDArray[np.bool_], found: Fit, latitude: float, options: dict[str, Any]
) -> NDArray[np.int64]:
    """Reading of the table (a code of `READINGS`) that reduces the residuals of each heliostat most, shape (H,).

    As given, unless another reading, with errors that a mount may have, halves their root mean square at least. In a
    mirrored table the sign of y or of z is reversed. For other times the sun is rotated about the axis of the Earth;
    without commanded angles the mount aims from that sun.
    """
    pole = np.array([0.0, np.cos(latitude), np.sin(latitude)])

    def residuals(fitted: Fit) -> Floats:
        spread = rms(fitted.residual, np.isfinite(fitted.residual).all(axis=-1) & (observed.weight > 0))
        good = np.isin(fitted.status, (ESTIMATED, INDISTINCT)) & np.isfinite(spread) & ~_large(fitted)
        return np.where(good, spread, np.inf)

    def at_hour(hours: float) -> Floats:
        turn, along = math.radians(-15.0 * hours), (observed.sun @ pole)[..., np.newaxis] * pole
        sun = along + np.cos(turn) * (observed.sun - along) + np.sin(turn) * np.cross(pole, observed.sun)
        ideal = aim(mounts.frames[:, None], sun, mounts.to_target[:, None], np.zeros(6), tuple(mounts.offsets))
        angles = np.where(given[..., np.newaxis], observed.angles, ideal)
        return residuals(fit(mounts, observed._replace(sun=sun, angles=angles), **options))

    mirrored = [
        residuals(fit(mounts, observed._replace(position=observed.position * signs), **options))
        for signs in ([-1.0, 1.0], [1.0, -1.0])
    ]
    readings = np.array([residuals(found), np.minimum(*mirrored), at_hour(-1.0), at_hour(1.0)])
    best = np.argmin(readings, axis=0)
    enough = 2 * np.count_nonzero(observed.weight > 0, axis=1) >= options["parameters"] + LEAST_FREEDOM
    better = enough & (MUCH_BETTER * readings.min(axis=0) < readings[0]) & (readings[0] > LEAST_DISTANCE)
    return np.where(better, best, 0)


def _large(found: Fit) -> NDArray[np.bool_]:
    """Fits with an error that no mount would have, shape (H,)."""
    large: NDArray[np.bool_] = np.nanmax(np.abs(found.estimate), axis=1, initial=0.0) > DOUBTFUL_ERROR * 1e-3
    return large
