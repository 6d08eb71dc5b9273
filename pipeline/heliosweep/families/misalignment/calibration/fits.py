"""Calibrations at one parameter point: all heliostats of a region, with all their draws.

Arrays lead with H heliostats and K draws; measured spots have one draw.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.families.misalignment.blocks import ERRORS
from heliosweep.families.misalignment.calibration.variables import (
    DISAGREE,
    DOUBTFUL,
    DOUBTFUL_APERTURES,
    DOUBTFUL_ERROR,
    EXACT,
    KNOWN,
    LARGEST_DEVIATION,
    NO_SPOTS,
)
from heliosweep.families.misalignment.points import Points
from heliosweep.families.misalignment.spots import NO_HELIOSTAT
from heliosweep.families.misalignment.spots_file import MeasuredSpots
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.mounts.aiming import aim, mount_frames
from heliosweep.kernels.spots.calibration import (
    ESTIMATED,
    INDISTINCT,
    NOT_CONVERGED,
    SQUARED,
    TOO_FEW,
    Calibration,
    Spots,
    calibrate,
)
from heliosweep.kernels.spots.mount_spots import mount_spots
from heliosweep.kernels.spots.receiver import Setting, face_axes

Found = dict[str, NDArray[Any]]

_NONE = np.zeros(len(ERRORS))

#: Median length of a vector with two coordinates of standard deviation 1; scale of Huber's weights; number of fits.
_MEDIAN, _HUBER, _ROUNDS = 1.17741, 1.345, 2
#: Distance of a spot from its prediction that is no disagreement, whatever the others have. [m]
LEAST_DISTANCE = 0.005
#: Factor by which another reading reduces the residuals, and degrees of freedom that the comparison needs.
MUCH_BETTER, LEAST_FREEDOM = 2.0, 4


class Mounts(NamedTuple):
    """The mounts of H heliostats at one parameter point, under T suns."""

    setting: Setting
    sun: Floats
    """Unit vectors, shape (T, 3)."""
    pivots: Floats
    """Relative to the tower's base, shape (H, 3). [m]"""
    towards: Floats
    """From the pivots to the aim point, shape (H, 3). [m]"""
    frames: Floats
    """Of the mounts, shape (H, 3, 3)."""
    face: Floats
    """Axes of the receiver's face, shape (3, 3)."""
    offsets: tuple[float, float, float]
    """Mirror offset, axis offset and pedestal height. [m]"""

    @classmethod
    def of(cls, points: Points, point: int) -> Mounts:
        """Mounts at a point of a region, by its number."""
        setting, (sun,), (pivots,) = points.only(np.array([point]))[1:4]
        towards = np.array([0.0, 0.0, setting.target_height[0]]) - pivots
        mount = int(setting.kind[0]), float(setting.latitude[0]), float(setting.axis_azimuth[0])
        return cls(
            setting,
            sun,
            pivots,
            towards,
            mount_frames(*mount, towards),
            face_axes(float(setting.face_azimuth[0]), float(setting.face_tilt[0])),
            (float(setting.mirror_offset[0]), float(setting.axis_offset[0]), float(setting.pedestal_height[0])),
        )

    def commands(self, known: Floats) -> Floats:
        """Encoder angles for known errors of shape (H, ..., 1 or T, 6), shape (H, ..., T, 2). [rad]"""
        wide = (slice(None), *[np.newaxis] * (known.ndim - 2))
        return aim(self.frames[wide], self.sun, self.towards[wide], known, self.offsets)

    def ideal(self) -> Floats:
        """Encoder angles without errors, shape (H, T, 2). [rad]"""
        return self.commands(np.zeros((len(self.pivots), 1, len(ERRORS))))

    def spots(self, actual: Floats, known: Floats) -> Floats:
        """Spots y and z for actual errors (H, K, 6) and known ones (the same, or (1, 1, 6)), shape (H, K, T, 2). [m]"""
        samples = actual.shape[1]
        setting = Setting(*(np.repeat(values, samples) for values in self.setting))  # type: ignore[arg-type]
        each = np.swapaxes(actual, 0, 1), np.swapaxes(known, 0, 1)
        spots = mount_spots(setting, *each, self.sun[np.newaxis], self.pivots[np.newaxis])
        return np.transpose(spots[:2], (2, 1, 3, 0))

    def calibrate(self, spots: Spots, repeats: int, **options: Any) -> Calibration:
        """Estimates for every heliostat, or for so many lists of spots of each."""
        frames, pivots = (np.repeat(array, repeats, axis=0) for array in (self.frames, -self.towards))
        return calibrate(spots, frames, pivots, self.face, np.array(self.offsets), **options)


def from_synthetic(mounts: Mounts, drawn: Floats, noise: Floats | float, used: int, **options: Any) -> Found:
    """Variables of a calibration from synthetic spots by name, shape (H, K, ...).

    The mounts are under the suns of all instants; spots are taken at so many `used`, the first ones. `drawn` are the
    true errors, shape (H, K, 6) [mrad]; `noise`, shape (H, K, used, 2) or a float, is added to the spots [m]; options
    are those of `heliosweep.kernels.spots.calibration.calibrate`.
    """
    count, samples, _ = drawn.shape
    actual = drawn * 1e-3
    before = mounts.spots(actual, np.zeros((1, 1, len(ERRORS))))
    measured = before[:, :, :used] + noise
    fits = count * samples
    spots = Spots(
        np.arange(fits + 1) * used,
        np.tile(mounts.sun[:used], (fits, 1)),
        np.repeat(mounts.ideal()[:, :used], samples, axis=0).reshape(-1, 2),
        measured.reshape(-1, 2),
        np.ones(fits * used),
    )
    found = mounts.calibrate(spots, samples, **options)
    residual = np.full((count, samples, len(mounts.sun), 2), np.nan)
    residual[:, :, :used] = found.residual.reshape(count, samples, used, 2)
    status = _status(found, spots, options["parameters"])
    known = _known(found, status).reshape(count, samples, -1)
    values = _estimates(found, spots, status, mounts, samples) | _pairs("residual_{}", residual)
    values |= _pairs("spot_{}_before", before) | _pairs("spot_{}_after", mounts.spots(actual, known))
    return values | {"true_error": drawn} | _commands(mounts, known)


def from_measured(mounts: Mounts, numbers: NDArray[np.int64], measured: MeasuredSpots, **options: Any) -> Found:
    """Variables of a calibration from measured spots by name, shape (H, 1, ...).

    The mounts are under the suns at which commands are wanted; `numbers` of the heliostats rise; `measured` are the
    spots of all heliostats, with their suns; options as for `from_synthetic`.
    """
    count, most = numbers.size, measured.most
    order, of, position = measured.of(int(numbers[0]), count)
    sun, angles = measured.sun[order], measured.angles[order]
    ideal = bool(np.isnan(angles).any())
    if ideal:
        angles = aim(mounts.frames[of], sun, mounts.towards[of], _NONE, mounts.offsets)
    spots = Spots(
        np.searchsorted(of, np.arange(count + 1)), sun, angles, measured.position[order], measured.weight[order]
    )
    found = mounts.calibrate(spots, 1, **options)

    def padded(values: Floats) -> Floats:
        table = np.full((count, 1, most, 2), np.nan)
        table[of, 0, position] = values
        return table

    before = spots.position if ideal else found.uncalibrated
    status = _status(found, spots, options["parameters"])
    deviation = _deviations(mounts, spots, found, options["parameters"])
    apart = np.bincount(_lists(spots), deviation > LARGEST_DEVIATION, count) > 0
    if options["loss"] == SQUARED:
        status[(status == ESTIMATED) & apart] = DISAGREE
    status[np.isin(status, KNOWN) & _doubtful(found, spots, before, mounts)] = DOUBTFUL
    values = _estimates(found, spots, status, mounts, 1) | _pairs("residual_{}", padded(found.residual))
    values |= _angular(found, spots, before, mounts)
    values |= _pairs("spot_{}_before", padded(before)) | _pairs("spot_{}_after", padded(found.left_out))
    times = np.full((count, 1, most), np.datetime64("NaT", "ns"))
    times[of, 0, position] = measured.utc[order]
    values |= {"spot_deviation": padded(deviation[:, np.newaxis])[..., 0], "spot_time": times}
    values["better_reading"] = _better_reading(mounts, spots, of, found, ideal, options)[:, np.newaxis]
    return values | _commands(mounts, _known(found, status).reshape(count, 1, -1))


def _status(found: Calibration, spots: Spots, parameters: int) -> NDArray[np.int64]:
    """Status of every fit: the kernel's, but for what has no standard errors, and for what has no spots."""
    status = found.status.copy()
    status[(status == TOO_FEW) & (found.used == 0)] = NO_SPOTS
    lists = _lists(spots)
    seen = np.isfinite(found.residual).all(axis=1) & (spots.weight > 0)
    predicted = np.bincount(lists, seen, len(status)) >= found.used
    whole = np.all(np.isfinite(found.estimate[:, :parameters]), axis=1) & predicted
    spread = np.isfinite(found.covariance[:, :parameters, :parameters]).all(axis=(1, 2))
    fitted = np.isin(status, (ESTIMATED, INDISTINCT))
    status[fitted & ~(whole & spread)] = NOT_CONVERGED
    status[fitted & whole & ~spread & (2 * found.used == parameters)] = EXACT
    return status


def _deviations(mounts: Mounts, spots: Spots, found: Calibration, parameters: int) -> Floats:
    """Distance of each spot from a robust prediction, in robust standard deviations of a coordinate, shape (S,).

    Two fits with Huber's weights reduce the influence of spots that are far from the others. Distances below
    `LEAST_DISTANCE` count as 0. The result is NaN for spots without weight.
    """
    lists, weight = _lists(spots), spots.weight / np.maximum(_medians(spots.weight, spots.first)[_lists(spots)], 1e-300)
    for remaining in reversed(range(_ROUNDS + 1)):
        distance = np.hypot(*found.residual.T)
        distance = np.where(weight > 0, distance * np.sqrt(weight), np.nan)
        used = np.bincount(lists, np.isfinite(distance), len(spots.first) - 1)
        sigma = _medians(distance, spots.first) / _MEDIAN * np.sqrt(used / np.maximum(used - parameters / 2, 0.5))
        with np.errstate(invalid="ignore", divide="ignore"):
            deviation: Floats = distance / sigma[lists]
        if remaining:
            shares = np.minimum(1.0, 2 * _HUBER / np.fmax(deviation, _HUBER))
            found = mounts.calibrate(spots._replace(weight=spots.weight * shares), 1, parameters=parameters)
    return np.where(distance < LEAST_DISTANCE, 0.0, deviation)


def _medians(values: Floats, first: NDArray[np.int64]) -> Floats:
    """Median of the values of each list that are not NaN; NaN without any."""
    lists = np.repeat(np.arange(len(first) - 1), np.diff(first))
    ordered = np.append(values[np.lexsort((values, lists))], np.nan)
    count = np.bincount(lists, np.isfinite(values), len(first) - 1).astype(int)
    low, high = (np.where(count > 0, first[:-1] + middle, -1) for middle in ((count - 1) // 2, count // 2))
    return (ordered[low] + ordered[high]) / 2


def _better_reading(
    mounts: Mounts, spots: Spots, of: NDArray[np.int64], found: Calibration, ideal: bool, options: dict[str, Any]
) -> NDArray[np.int64]:
    """Reading of the table (a code of `READINGS`) that reduces the residuals of each heliostat most, shape (F,).

    As given, unless another reading, with errors that a mount may have, halves their root mean square at least. In a
    mirrored table the sign of y or of z is reversed. For other times the sun is rotated about the axis of the Earth;
    without commanded angles the mount is taken to aim from that sun.
    """
    latitude = float(mounts.setting.latitude[0])
    pole = np.array([0.0, np.cos(latitude), np.sin(latitude)])

    def residuals(fit: Calibration) -> Floats:
        rms = _rms(fit.residual, spots, np.all(np.isfinite(fit.residual), axis=1))
        good = np.isin(fit.status, (ESTIMATED, INDISTINCT)) & np.isfinite(rms) & ~_large(fit)
        return np.where(good, rms, np.inf)

    def residuals_of(other: Spots) -> Floats:
        return residuals(mounts.calibrate(other, 1, **options))

    def at_hour(hours: float) -> Floats:
        turn, along = math.radians(-15.0 * hours), (spots.sun @ pole)[:, np.newaxis] * pole
        sun = along + np.cos(turn) * (spots.sun - along) + np.sin(turn) * np.cross(pole, spots.sun)
        aimed = aim(mounts.frames[of], sun, mounts.towards[of], _NONE, mounts.offsets) if ideal else spots.angles
        return residuals_of(spots._replace(sun=sun, angles=aimed))

    mirrored = [residuals_of(spots._replace(position=spots.position * signs)) for signs in ([-1.0, 1.0], [1.0, -1.0])]
    readings = np.array([residuals(found), np.minimum(*mirrored), at_hour(-1.0), at_hour(1.0)])
    best = np.argmin(readings, axis=0)
    enough = 2 * np.bincount(_lists(spots), spots.weight > 0, len(best)) >= options["parameters"] + LEAST_FREEDOM
    better = enough & (MUCH_BETTER * readings.min(axis=0) < readings[0]) & (readings[0] > LEAST_DISTANCE)
    return np.where(better, best, 0)


def _doubtful(found: Calibration, spots: Spots, before: Floats, mounts: Mounts) -> NDArray[np.bool_]:
    """Fits with an error, or with a measured spot, that no mount would have, shape (F,)."""
    half = np.array([mounts.setting.half_width[0], mounts.setting.half_height[0]])
    far = (np.abs(before) > 2 * DOUBTFUL_APERTURES * half).any(axis=1) & (spots.weight > 0)
    doubtful: NDArray[np.bool_] = _large(found) | (np.bincount(_lists(spots), far, len(found.used)) > 0)
    return doubtful


def _large(found: Calibration) -> NDArray[np.bool_]:
    """Fits with an error that no mount would have, shape (F,)."""
    large: NDArray[np.bool_] = np.nanmax(np.abs(found.estimate), axis=1, initial=0.0) > DOUBTFUL_ERROR * 1e-3
    return large


def _angular(found: Calibration, spots: Spots, before: Floats, mounts: Mounts) -> Found:
    """Residuals as angles seen from the pivots, with the estimated errors and without any, shape (H, 1). [mrad]"""
    pivots = -mounts.towards[_lists(spots)]
    seen = _on_face(spots.position, mounts) - pivots
    made = {}
    for name, residual in (("beam_residual_rms", found.residual), ("uncalibrated_beam_residual_rms", before)):
        predicted = seen - _on_face(residual, mounts)
        across = np.cross(seen, predicted)
        angle = np.arctan2(np.sqrt(np.sum(across**2, axis=1)), np.sum(seen * predicted, axis=1))
        used = np.all(np.isfinite(found.residual), axis=1)
        made[name] = 1e3 * _rms(angle[:, np.newaxis], spots, used)[:, np.newaxis]
    return made


def _on_face(places: Floats, mounts: Mounts) -> Floats:
    """Vectors along the receiver's face, shape (S, 3), without BLAS, whose bits depend on the number of rows."""
    across, up = mounts.face[1:]
    return places[:, :1] * across + places[:, 1:] * up


def _lists(spots: Spots) -> NDArray[np.int64]:
    """Number of the list that each spot is in."""
    return np.repeat(np.arange(len(spots.first) - 1), np.diff(spots.first))


def _known(found: Calibration, status: NDArray[np.int64]) -> Floats:
    """Errors that corrected commands take as known: those estimated; NaN where nothing is."""
    some = np.isin(status, KNOWN)[:, np.newaxis]
    known: Floats = np.where(some, np.nan_to_num(found.estimate), np.nan)
    return known


def _estimates(found: Calibration, spots: Spots, status: NDArray[np.int64], mounts: Mounts, samples: int) -> Found:
    """Estimates and what is said of them, shape (H, K, ...)."""
    real = np.repeat(np.isfinite(mounts.pivots).all(axis=1), samples)
    # A mirror whose beam does not come to the plane predicts no spot, and the kernel leaves out what is measured there.
    predicted = np.all(np.isfinite(found.residual), axis=1)
    made = {
        "estimated_error": found.estimate * 1e3,
        "standard_error": np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)) * 1e3,
        "covariance": found.covariance * 1e6,
        "condition_number": found.condition,
        "residual_rms": _rms(found.residual, spots, predicted),
        "leave_one_out_rms": _rms(found.left_out, spots, predicted),
        "spots_used": found.used,
        "calibration_status": np.where(real, status, NO_HELIOSTAT),
        "least_known_direction": found.least_known,
    }
    return {name: array.reshape(-1, samples, *array.shape[1:]) for name, array in made.items()}


def _rms(residual: Floats, spots: Spots, used: NDArray[np.bool_]) -> Floats:
    """Root mean square per column of the residuals of spots used, of each heliostat; NaN if one of these is."""
    square = np.sum(residual**2, axis=1)
    counted = (spots.weight > 0) & used
    # Sums of each heliostat alone, in its own order: as `np.add.reduceat`, but right for empty lists.
    lists = _lists(spots)
    total = np.bincount(lists, np.where(counted, square, 0.0), len(spots.first) - 1)
    count = np.bincount(lists, counted, len(spots.first) - 1)
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.where(count > 0, total / np.maximum(residual.shape[1] * count, 1), np.nan))


def _pairs(name: str, values: Floats) -> dict[str, Floats]:
    return {name.format(side): values[..., index] for index, side in enumerate("yz")}


def _commands(mounts: Mounts, known: Floats) -> Found:
    """Commands for known errors of shape (H, K, 6), and at how many instants with sun there is none."""
    degrees: Floats = np.degrees(mounts.commands(known[..., np.newaxis, :]))
    some = np.all(np.isfinite(known), axis=-1)[..., np.newaxis]
    none = np.any(np.isnan(degrees), axis=-1) & some & (mounts.sun[:, 2] > 0.0)
    return {
        "corrected_azimuth": degrees[..., 0],
        "corrected_elevation": degrees[..., 1],
        "instants_without_command": np.count_nonzero(none, axis=-1),
    }
