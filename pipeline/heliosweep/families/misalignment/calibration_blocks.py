"""What is computed in one block of the mode calibration: NumPy arrays over (swept dimensions, heliostat).

All that is found of a heliostat (and draw) stands in one row of numbers; `Row` says where.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.distribution import Distribution
from heliosweep.families.misalignment.blocks import CONDITION_LIMITS, ERRORS, LOSSES
from heliosweep.families.misalignment.calibration_variables import EXACT, KNOWN, NO_SPOTS
from heliosweep.families.misalignment.draws import NOISE_STREAMS, means_and_widths, standard_deviates, standard_normals
from heliosweep.families.misalignment.scene import Block, points
from heliosweep.families.misalignment.spots_file import MeasuredSpots
from heliosweep.families.misalignment.variables import NO_HELIOSTAT
from heliosweep.kernels.calibration import (
    ESTIMATED,
    INDISTINCT,
    NOT_CONVERGED,
    TOO_FEW,
    Calibration,
    Spots,
    calibrate,
)
from heliosweep.kernels.mount_spots import mount_spots
from heliosweep.kernels.receiver import Setting, face_axes
from heliosweep.kernels.two_axis import aim, mount_frames

Floats = NDArray[np.float64]

#: Instants of one draw whose noise has room among the counts of the generator.
MOST_INSTANTS = 2**24
_CODES = {name: code for code, name in enumerate(LOSSES)}
_NONE = np.zeros(len(ERRORS))


class Row(NamedTuple):
    """Where each variable stands in a row.

    Parameters
    ----------
    places : mapping of str to tuple
        First number, and shape, of each variable.
    length : int
        Numbers of a row.
    """

    places: Mapping[str, tuple[int, tuple[int, ...]]]
    length: int

    @classmethod
    def of(cls, shapes: Mapping[str, tuple[int, ...]]) -> Row:
        """Row of variables of these shapes, one after the other."""
        places, length = {}, 0
        for name, shape in shapes.items():
            places[name] = (length, shape)
            length += math.prod(shape)
        return cls(places, length)

    def span(self, name: str) -> slice:
        """The part of the row that a variable takes."""
        first, shape = self.places[name]
        return slice(first, first + math.prod(shape))

    def write(self, rows: Floats, values: Mapping[str, NDArray[Any]]) -> None:
        """Fill rows of shape (heliostats, draws, length)."""
        for name, array in values.items():
            rows[..., self.span(name)] = np.reshape(array, (*rows.shape[:-1], -1))


class Point(NamedTuple):
    """One parameter point of a block: setting and sun alone, and what follows from them."""

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
    offsets: tuple[float, float, float]

    @classmethod
    def of(cls, block: Block, point: int) -> Point:
        """Parameter point of a block, by its number."""
        setting = Setting(*(values[point : point + 1] for values in block.setting))  # type: ignore[arg-type]
        pivots, sun = (array[point if len(array) > 1 else 0] for array in (block.pivots, block.sun))
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
        """Encoder angles for known errors of shape (H, ..., 6), shape (H, ..., T, 2). [rad]"""
        wide = (slice(None), *[np.newaxis] * (known.ndim - 1))
        return aim(self.frames[wide], self.sun, self.towards[wide], known[..., np.newaxis, :], self.offsets)

    def calibrate(self, spots: Spots, repeats: int, **options: Any) -> Calibration:
        """Estimates for every heliostat, or for so many lists of spots of each."""
        frames, pivots = (np.repeat(array, repeats, axis=0) for array in (self.frames, -self.towards))
        return calibrate(spots, frames, pivots, self.face, np.array(self.offsets), **options)


def nominal_block(*arrays: np.ndarray, sizes: Mapping[str, int]) -> np.ndarray:
    """Angles commanded without calibration, shape (2, *swept dimensions, heliostat, day, hour). [deg]"""
    block = Block.of(*arrays)
    made = [Point.of(block, point) for point in range(math.prod(block.lead))]
    angles = np.stack([one.commands(np.zeros((len(one.pivots), len(ERRORS)))) for one in made])
    return np.degrees(np.moveaxis(angles, -1, 0)).reshape(2, *block.lead, block.numbers.size, *sizes.values())


def synthetic_block(
    *arrays: np.ndarray, row: Row, errors: tuple[Any, ...], samples: int, seed: int, hours: int, limit: float | None
) -> np.ndarray:
    """Calibration from synthetic spots, shape (1, *swept dimensions, heliostat, draws, row).

    Parameters
    ----------
    *arrays : ndarray
        Of the scene; scale and mean of the errors; parameters, days used, noise, loss and its scale.
    row : Row
        Where results stand.
    errors : tuple of float, Sweep or Distribution
        The six errors.
    samples, seed : int
        Draws per heliostat, and the seed of the noise and of distributions that give none.
    hours : int
        Instants of a day.
    limit : float or None
        Of the condition number; None for that of the number of parameters.
    """
    block = Block.of(*arrays)
    scale, *means, parameters, days, noise, loss, loss_scale = (points(array, block.lead) for array in block.others)
    _, width = means_and_widths([error if isinstance(error, Distribution) else 0.0 for error in errors])
    deviates = standard_deviates(errors, block.numbers, samples, seed)
    noises = _noise(block.numbers, samples, block.sun.shape[1], seed) if np.any(noise > 0) else np.zeros(())
    rows = np.empty((scale.size, block.numbers.size, samples, row.length))
    for i in range(scale.size):
        point, count = Point.of(block, i), block.numbers.size
        mean = np.array([values[i] for values in means])
        drawn = mean + (scale[i] * width) * deviates
        actual = drawn * 1e-3
        true = mount_spots(point.setting, actual[np.newaxis], _NONE[np.newaxis, np.newaxis], *_sky(point))[:2, 0]
        before = np.transpose(true, (1, 3, 2, 0))
        taken = slice(0, int(days[i]) * hours)
        measured = before[:, :, taken] + noise[i] * (noises[:, :, taken] if noises.ndim else 0.0)
        angles = point.commands(np.zeros((count, len(ERRORS))))[:, taken]
        fits, each = count * samples, measured.shape[2]
        spots = Spots(
            np.arange(fits + 1) * each,
            np.tile(point.sun[taken], (fits, 1)),
            np.repeat(angles, samples, axis=0).reshape(-1, 2),
            measured.reshape(-1, 2),
            np.ones(fits * each),
        )
        found = point.calibrate(spots, samples, **_options(parameters[i], loss[i], loss_scale[i], limit))
        residual = np.full((count, samples, len(point.sun), 2), np.nan)
        residual[:, :, taken] = found.residual.reshape(count, samples, each, 2)
        status = _status(found, spots, int(parameters[i]))
        known = _known(found, status).reshape(count, samples, -1)
        after = _after(point, actual, known)
        values = _estimates(found, spots, status, point, samples) | _pairs("residual_{}", residual)
        values |= _pairs("spot_{}_before", before) | _pairs("spot_{}_after", after)
        values |= {"true_error": drawn} | _commands(point, known)
        row.write(rows[i], values)
    return rows.reshape(1, *block.lead, *rows.shape[1:])


def measured_block(*arrays: np.ndarray, row: Row, measured: MeasuredSpots, limit: float | None) -> np.ndarray:
    """Calibration from measured spots, shape (1, *swept dimensions, heliostat, 1, row).

    Parameters
    ----------
    *arrays : ndarray
        Of the scene; parameters, loss and its scale.
    row : Row
        Where results stand.
    measured : MeasuredSpots
        The spots, with their suns.
    limit : float or None
        Of the condition number; None for that of the number of parameters.
    """
    block = Block.of(*arrays)
    parameters, loss, loss_scale = (points(array, block.lead) for array in block.others)
    count = block.numbers.size
    place = np.full(max(int(block.numbers.max(initial=-1)), int(measured.heliostat.max(initial=-1))) + 1, -1)
    place[block.numbers] = np.arange(count)
    order = np.argsort(measured.heliostat, kind="stable")
    order = order[place[measured.heliostat[order]] >= 0]
    of = place[measured.heliostat[order]]
    order, of = (array[np.argsort(of, kind="stable")] for array in (order, of))
    first = np.searchsorted(of, np.arange(count + 1))
    position = np.arange(of.size) - first[of]
    rows = np.empty((parameters.size, count, 1, row.length))
    most = row.places["residual_y"][1][0]
    for i in range(parameters.size):
        point = Point.of(block, i)
        sun, angles = measured.sun[order], measured.angles[order]
        if np.isnan(angles).any():
            angles = aim(point.frames[of], sun, point.towards[of], _NONE, point.offsets)
        spots = Spots(first, sun, angles, measured.position[order], measured.weight[order])
        found = point.calibrate(spots, 1, **_options(parameters[i], loss[i], loss_scale[i], limit))

        def padded(values: Floats) -> Floats:
            table = np.full((count, 1, most, 2), np.nan)
            table[of, 0, position] = values
            return table

        status = _status(found, spots, int(parameters[i]))
        values = _estimates(found, spots, status, point, 1) | _pairs("residual_{}", padded(found.residual))
        values |= _pairs("spot_{}_before", padded(spots.position)) | _pairs("spot_{}_after", padded(found.left_out))
        values |= _commands(point, _known(found, status).reshape(count, 1, -1))
        row.write(rows[i], values)
    return rows.reshape(1, *block.lead, *rows.shape[1:])


def _noise(numbers: NDArray[np.int64], samples: int, instants: int, seed: int) -> Floats:
    """Standard normal noise of y and z over (heliostat, draw, instant, 2); of one draw whatever the others."""
    noise = np.empty((numbers.size, samples, instants, 2))
    for side, stream in enumerate(NOISE_STREAMS):
        for sample in range(samples):
            first = sample * MOST_INSTANTS
            noise[:, sample, :, side] = standard_normals(seed, stream, numbers, instants, first)
    return noise


def _sky(point: Point) -> tuple[Floats, Floats]:
    return point.sun[np.newaxis], point.pivots[np.newaxis]


def _options(parameters: float, loss: str, loss_scale: float, limit: float | None) -> dict[str, Any]:
    if limit is None:
        limit = CONDITION_LIMITS[int(parameters)]
    return {
        "parameters": int(parameters),
        "loss": _CODES[str(loss)],
        "loss_scale": float(loss_scale),
        "condition_limit": limit,
    }


def _status(found: Calibration, spots: Spots, parameters: int) -> NDArray[np.int64]:
    """Status of every fit: the kernel's, but for what has no standard errors, and for what has no spots."""
    status = found.status.copy()
    status[(status == TOO_FEW) & (found.used == 0)] = NO_SPOTS
    lists = np.repeat(np.arange(len(spots.first) - 1), np.diff(spots.first))
    seen = np.isfinite(found.residual).all(axis=1) & (spots.weight > 0)
    predicted = np.bincount(lists, seen, len(status)) >= found.used
    whole = np.all(np.isfinite(found.estimate[:, :parameters]), axis=1) & predicted
    spread = np.isfinite(found.covariance[:, :parameters, :parameters]).all(axis=(1, 2))
    fitted = np.isin(status, (ESTIMATED, INDISTINCT))
    status[fitted & ~(whole & spread)] = NOT_CONVERGED
    status[fitted & whole & ~spread & (2 * found.used == parameters)] = EXACT
    return status


def _known(found: Calibration, status: NDArray[np.int64]) -> Floats:
    """Errors that corrected commands take as known: those estimated; NaN where nothing is."""
    some = np.isin(status, KNOWN)[:, np.newaxis]
    known: Floats = np.where(some, np.nan_to_num(found.estimate), np.nan)
    return known


def _after(point: Point, actual: Floats, known: Floats) -> Floats:
    """Spots with corrected commands, shape (H, K, T, 2), for actual and known errors of shape (H, K, 6)."""
    samples = actual.shape[1]
    setting = Setting(*(np.repeat(values, samples) for values in point.setting))  # type: ignore[arg-type]
    each = np.ascontiguousarray(np.swapaxes(actual, 0, 1))[:, :, np.newaxis]
    spots = mount_spots(setting, each, np.swapaxes(known, 0, 1), *_sky(point))
    return np.transpose(spots[:2, ..., 0], (2, 1, 3, 0))


def _estimates(
    found: Calibration, spots: Spots, status: NDArray[np.int64], point: Point, samples: int
) -> dict[str, NDArray[Any]]:
    """Variables of `calibration_variables.ESTIMATES`, each over heliostats and draws."""
    real = np.repeat(np.isfinite(point.pivots).all(axis=1), samples)
    # A mirror whose beam does not come to the plane predicts no spot, and the kernel leaves out what is measured there.
    predicted = np.all(np.isfinite(found.residual), axis=1)
    return {
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


def _rms(residual: Floats, spots: Spots, used: NDArray[np.bool_]) -> Floats:
    """Root mean square per coordinate of the residuals of spots used, of each heliostat; NaN if one of these is."""
    square = np.sum(residual**2, axis=1)
    counted = (spots.weight > 0) & used
    # Sums of each heliostat alone, in its own order: as `np.add.reduceat`, but right for empty lists.
    lists = np.repeat(np.arange(len(spots.first) - 1), np.diff(spots.first))
    total = np.bincount(lists, np.where(counted, square, 0.0), len(spots.first) - 1)
    count = np.bincount(lists, counted, len(spots.first) - 1)
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.where(count > 0, total / np.maximum(2 * count, 1), np.nan))


def _pairs(name: str, values: Floats) -> dict[str, Floats]:
    return {name.format(side): values[..., index] for index, side in enumerate("yz")}


def _commands(point: Point, known: Floats) -> dict[str, NDArray[Any]]:
    """Commands for known errors of shape (H, K, 6), and at how many instants with sun there is none."""
    degrees: Floats = np.degrees(point.commands(known))
    some = np.all(np.isfinite(known), axis=-1)[..., np.newaxis]
    none = np.any(np.isnan(degrees), axis=-1) & some & (point.sun[:, 2] > 0.0)
    return {
        "corrected_azimuth": degrees[..., 0],
        "corrected_elevation": degrees[..., 1],
        "instants_without_command": np.count_nonzero(none, axis=-1),
    }
