"""Crossings, the misalignment from them and the closed loop at one parameter point, for all heliostats of a region.

Arrays lead with H heliostats and K draws; measured crossings have one draw.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.families.misalignment.blocks import ERRORS
from heliosweep.families.misalignment.calibration.fits import Mounts
from heliosweep.families.misalignment.calibration.variables import EXACT, KNOWN, NO_SPOTS
from heliosweep.families.misalignment.detectors.arrays import Pieces
from heliosweep.families.misalignment.detectors.variables import (
    BY_INVERSION,
    BY_LEAST_SQUARES,
    NO_AZIMUTH,
    NO_ELEVATION,
    NO_LIGHT,
    NONE,
    SEEN,
)
from heliosweep.families.misalignment.spots import NO_HELIOSTAT
from heliosweep.families.misalignment.spots_file import TRACES, MeasuredSpots
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.mounts.aiming import aim
from heliosweep.kernels.spots import traces
from heliosweep.kernels.spots.traces import AZIMUTH, ELEVATION, ESTIMATED, INDISTINCT, TOO_FEW, Seen, Stand

Found = dict[str, NDArray[Any]]


class Options(NamedTuple):
    """What a study says of its detectors at a point."""

    pitch: float
    """Distance of the detectors. [m]"""
    noise: float
    """Standard deviation of the places. [m]"""
    parameters: int
    condition_limit: float
    correction: str
    rounds: int

    @property
    def spread(self) -> float:
        """Standard deviation of what an array tells: of the noise, and of rounding to a detector. [m]"""
        return float(np.hypot(self.noise, self.pitch / np.sqrt(12.0)))


class Site(NamedTuple):
    """Mounts with true errors before arrays of detectors."""

    mounts: Mounts
    pieces: Pieces
    actual: Floats
    """True errors, shape (H, K, 6). [rad]"""

    def stand(self, angles: Floats) -> Stand:
        """Mirrors at commanded angles of shape (H, K, T, 2)."""
        frames, towards = self.mounts.frames[:, np.newaxis, np.newaxis], self.mounts.towards[:, np.newaxis, np.newaxis]
        return traces.stand(frames, angles, self.actual[:, :, np.newaxis], towards, self.mounts.offsets)

    def world(self, plane: Floats) -> Floats:
        """Vectors y, z of the receiver's plane in the world, the last axis of three. [m]"""
        return plane[..., :1] * self.mounts.face[1] + plane[..., 1:] * self.mounts.face[2]

    def crossings(self, mirror: Stand) -> tuple[Floats, Floats]:
        """Places along the arrays, shape (H, K, T, 2, A, C) [m], and the cylinders' angles there [rad]."""
        pieces = self.pieces
        places, angles = traces.crossings(
            mirror, self.mounts.sun, self.world(pieces.start), self.world(pieces.along), pieces.ends
        )
        behind = ~(traces.dot(mirror.centre, self.mounts.face[0]) > 0)
        places[behind] = np.nan
        along, source = pieces.by_array(places)
        joined = angles.reshape(*angles.shape[:-2], 1, -1)
        angles = np.take_along_axis(
            np.broadcast_to(joined, (*joined.shape[:-2], pieces.arrays, joined.shape[-1])), source, -1
        )
        return along, np.where(np.isnan(along), np.nan, angles)

    def seen(self, angles: Floats, readings: Floats) -> Seen:
        """What the arrays tell at commanded angles (H, K, T, 2), shape (H K T, M, ...)."""
        shape = readings.shape
        plane, along = self.pieces.points(readings)
        lists = int(np.prod(shape[:3])), int(np.prod(shape[3:]))

        def spread(values: Floats) -> Floats:
            whole = np.broadcast_to(
                values.reshape(*values.shape[:-1], 1, 1, 1, values.shape[-1]), (*shape, values.shape[-1])
            )
            return whole.reshape(*lists, values.shape[-1])

        trace = np.broadcast_to(np.arange(len(TRACES))[:, np.newaxis, np.newaxis], shape).reshape(lists)
        points, ways = (self.world(vectors).reshape(*lists, 3) for vectors in (plane, along))
        weight = np.isfinite(readings).reshape(lists).astype(float)
        return Seen(spread(self.mounts.sun), spread(angles), trace, points, ways, weight)

    def left(self, mirror: Stand) -> tuple[Floats, Found]:
        """Spots (H, K, T, 2) [m], and how far beams are off over all instants, shape (H, K)."""
        mounts = self.mounts
        rays = traces.reflected(mirror.normal, mounts.sun)
        places = traces.spots(mirror.centre, rays, mounts.face)
        places[~(traces.dot(mirror.normal, mounts.sun) > 0)] = np.nan
        distance = np.sqrt(traces.dot(mirror.centre, mirror.centre))
        turn = rays + mirror.centre / distance[..., np.newaxis]
        angle = 2.0 * np.arcsin(np.minimum(0.5 * np.sqrt(traces.dot(turn, turn)), 1.0))
        real = np.isfinite(places).all(axis=-1)
        half = np.array([mounts.setting.half_width[0], mounts.setting.half_height[0]])
        inside = np.count_nonzero(real & (np.abs(places) <= half).all(axis=-1), axis=-1)
        lit = np.count_nonzero(np.isfinite(mirror.normal[..., 0]), axis=-1)
        return places, {
            "beam_error_rms": 1e3 * _rms(np.where(real, angle, np.nan)),
            "spot_distance_rms": _rms(np.hypot(places[..., 0], places[..., 1])),
            "round_hit_fraction": np.divide(inside, lit, out=np.full(lit.shape, np.nan), where=lit > 0),
        }


def run_loop(site: Site, options: Options, noise: Callable[[int], Floats | float]) -> Found:
    """Variables of the closed loop by name, shape (H, K, ...).

    `noise` gives that of a round, standard normal numbers of the shape of the crossings.
    """
    heliostats, draws, _ = site.actual.shape
    known = np.zeros((heliostats, draws, 1, len(ERRORS)))
    angles = site.mounts.commands(known)
    mirror = site.stand(angles)
    places, turned = site.crossings(mirror)
    before, left = site.left(mirror)
    values = sights(site, places, turned, mirror)
    rounds: list[Found] = [left]
    pooled: list[Seen] = []
    for number in range(options.rounds):
        readings = site.pieces.readings(
            places, options.noise * noise(number) if options.noise > 0 else 0.0, options.pitch
        )
        here = site.seen(angles, readings)
        pooled.append(here.of_each(heliostats * draws))
        instant = at_instants(site, angles, here, options) if number == 0 or options.correction == "instant" else {}
        if number == 0:
            values |= {name: array for name, array in instant.items() if name != "known"}
        arrays: list[NDArray[Any]] = [np.concatenate(each, axis=1) for each in zip(*pooled, strict=True)]
        seen = Seen(*arrays)
        found = _fit(site, seen, options)
        status = np.reshape(found["calibration_status"], (heliostats, draws, 1, 1))
        if options.correction == "instant":
            known = np.where(np.isfinite(instant["known"]), instant["known"], known)
        else:
            estimate = np.nan_to_num(found["estimated_error"])[:, :, np.newaxis] * 1e-3
            known = np.where(np.isin(status, KNOWN), estimate, known)
        angles = site.mounts.commands(known)
        mirror = site.stand(angles)
        places, _ = site.crossings(mirror)
        after, left = site.left(mirror)
        rounds.append(left)
    values |= found | {name: np.stack([each[name] for each in rounds], axis=-1) for name in rounds[0]}
    values |= {f"spot_{side}_before": before[..., i] for i, side in enumerate("yz")}
    values |= {f"spot_{side}_after": after[..., i] for i, side in enumerate("yz")}
    degrees = np.where(np.isin(status, KNOWN) | (options.correction == "instant"), np.degrees(angles), np.nan)
    return values | {"corrected_azimuth": degrees[..., 0], "corrected_elevation": degrees[..., 1]}


def from_table(site: Site, options: Options, numbers: NDArray[np.int64], measured: MeasuredSpots) -> Found:
    """Variables from measured crossings by name, shape (H, 1, ...); the site's mounts have no errors.

    `numbers` of the heliostats rise; `measured` are the crossings of all heliostats, with their suns.
    """
    count, most = numbers.size, measured.most
    angles = site.mounts.commands(np.zeros((count, 1, 1, len(ERRORS))))
    mirror = site.stand(angles)
    values = sights(site, *site.crossings(mirror), mirror)
    order, of, position = measured.of(int(numbers[0]), count)
    sun, commanded = measured.sun[order], measured.angles[order]
    if np.isnan(commanded).any():
        mounts = site.mounts
        commanded = aim(mounts.frames[of], sun, mounts.towards[of], np.zeros(len(ERRORS)), mounts.offsets)
    plane = measured.position[order]
    _, which = site.pieces.nearest(plane)
    along = site.world(site.pieces.along[which])
    assert measured.trace is not None

    def padded(rows: NDArray[Any], missing: float = np.nan) -> NDArray[Any]:
        table = np.full((count, most, *rows.shape[1:]), missing, rows.dtype)
        table[of, position] = rows
        return table

    seen = Seen(
        padded(sun), padded(commanded), padded(measured.trace[order], 0), padded(site.world(plane)), padded(along),
        padded(measured.weight[order], 0.0),
    )  # fmt: skip
    found = _fit(site, seen, options)
    known = np.isin(found["calibration_status"], KNOWN)[..., np.newaxis]
    known_errors = np.where(known, np.nan_to_num(found["estimated_error"]) * 1e-3, np.nan)
    degrees = np.degrees(site.mounts.commands(known_errors[:, :, np.newaxis]))
    return values | found | {"corrected_azimuth": degrees[..., 0], "corrected_elevation": degrees[..., 1]}


def sights(site: Site, places: Floats, turned: Floats, mirror: Stand) -> Found:
    """Crossings of all traces and arrays, and what is not crossed."""
    plane, _ = site.pieces.points(places)
    lit = np.isfinite(mirror.normal[..., 0]) & (traces.dot(mirror.centre, site.mounts.face[0]) > 0)
    crossed: NDArray[Any] = np.any(np.isfinite(places), axis=-1)  # (H, K, T, 2, A)
    some: NDArray[Any] = np.any(crossed, axis=-1)
    status = SEEN + NO_ELEVATION * ~some[..., ELEVATION] + NO_AZIMUTH * ~some[..., AZIMUTH]
    real: NDArray[Any] = np.all(np.isfinite(site.mounts.pivots), axis=1)[:, np.newaxis]
    status = np.where(real[..., np.newaxis], np.where(lit, status, NO_LIGHT), NO_HELIOSTAT)
    count = np.count_nonzero(lit, axis=-1)[..., np.newaxis, np.newaxis]
    fraction = np.count_nonzero(crossed, axis=2) / np.where(count > 0, count, np.nan)
    return {
        "crossing_y": plane[..., 0],
        "crossing_z": plane[..., 1],
        "crossing_place": places,
        "crossing_angle": 1e3 * turned,
        "detector_status": status,
        "crossed_fraction": fraction,
        "misses_array": ~crossed.any(axis=(2, 3)) & real[..., np.newaxis],
    }


def at_instants(site: Site, angles: Floats, seen: Seen, options: Options) -> Found:
    """The offsets of both encoders from the crossings of each instant, shape (H, K, T)."""
    shape = angles.shape[:3]
    number = int(np.prod(shape))
    mounts = site.mounts
    frames = np.broadcast_to(mounts.frames[:, np.newaxis, np.newaxis], (*shape, 3, 3)).reshape(number, 3, 3)
    towards = np.broadcast_to(mounts.towards[:, np.newaxis, np.newaxis], (*shape, 3)).reshape(number, 3)
    valid = seen.weight > 0
    rows = np.arange(number)
    ways = []
    for trace in (ELEVATION, AZIMUTH):
        first = np.argmax(valid & (seen.trace == trace), axis=1)
        known = (valid & (seen.trace == trace)).any(axis=1)
        ways.append(np.where(known[:, np.newaxis], seen.point[rows, first] + towards, np.nan))
    off = traces.mirror_angles(frames, seen.sun[:, 0], *ways) - angles.reshape(number, 2)
    off = np.arctan2(np.sin(off), np.cos(off))
    start = np.zeros((number, len(ERRORS)))
    start[:, :2] = np.where(np.isfinite(off), off, 0.0)
    found = traces.fit(frames, towards, mounts.offsets, seen, 2, start)
    only = [np.count_nonzero(valid & (seen.trace == trace), axis=1) == 1 for trace in (ELEVATION, AZIMUTH)]
    exact = only[0] & only[1] & (found.status == ESTIMATED) & (mounts.offsets[:2] == (0.0, 0.0))
    errors = np.where(exact[:, np.newaxis], off, found.estimate[:, :2])
    estimated = np.isin(found.status, (ESTIMATED, INDISTINCT))
    errors = np.where(estimated[:, np.newaxis], errors, np.nan)
    spread = np.sqrt(np.diagonal(found.inverse, axis1=1, axis2=2)[:, :2]) * options.spread
    known = np.zeros((number, len(ERRORS)))
    known[:, :2] = errors
    known[~estimated] = np.nan
    made = {"known": known.reshape(*shape, -1)}
    for column, name in enumerate(("azimuth", "elevation")):
        made[f"instant_{name}_error"] = 1e3 * errors[:, column].reshape(shape)
        made[f"instant_{name}_standard_error"] = 1e3 * np.where(estimated, spread[:, column], np.nan).reshape(shape)
    method = np.where(exact, BY_INVERSION, np.where(estimated, BY_LEAST_SQUARES, NONE))
    return made | {"inversion": method.reshape(shape)}


def _fit(site: Site, seen: Seen, options: Options) -> Found:
    """Estimates from all crossings of each heliostat and draw, shape (H, K, ...)."""
    heliostats, draws, _ = site.actual.shape
    frames, towards = (np.repeat(array, draws, axis=0) for array in (site.mounts.frames, site.mounts.towards))
    found = traces.fit(
        frames, towards, site.mounts.offsets, seen, options.parameters, condition_limit=options.condition_limit
    )
    known = np.isfinite(found.residual)
    weight = np.where(known, seen.weight, 0.0)
    square = np.where(known, found.residual, 0.0) ** 2
    mean = np.sum(weight, axis=1) / np.maximum(found.used, 1)
    freedom = found.used - options.parameters
    variance = np.full(len(frames), options.spread**2)
    if options.spread == 0:
        with np.errstate(divide="ignore", invalid="ignore"):
            variance = np.where(freedom > 0, np.sum(weight * square, axis=1) / mean / freedom, np.nan)
    covariance = found.inverse * variance[:, np.newaxis, np.newaxis]
    status = found.status.copy()
    status[(status == TOO_FEW) & (found.used == 0)] = NO_SPOTS
    status[(status == ESTIMATED) & np.isnan(variance)] = EXACT
    real = np.repeat(np.isfinite(site.mounts.pivots).all(axis=1), draws)
    made = {
        "estimated_error": 1e3 * found.estimate,
        "standard_error": 1e3 * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)),
        "covariance": 1e6 * covariance,
        "condition_number": found.condition,
        "residual_rms": np.sqrt(
            np.where(known.any(axis=1), np.sum(square, axis=1) / np.maximum(found.used, 1), np.nan)
        ),
        "crossings_used": found.used,
        "calibration_status": np.where(real, status, NO_HELIOSTAT),
        "least_known_direction": found.least_known,
        "crossing_residual": found.residual,
    }
    return {name: array.reshape(heliostats, draws, *array.shape[1:]) for name, array in made.items()}


def _rms(values: Floats) -> Floats:
    """Root mean square over the last axis of what is known; NaN of nothing."""
    known = np.isfinite(values)
    count = np.count_nonzero(known, axis=-1)
    total = np.sum(np.where(known, values, 0.0) ** 2, axis=-1)
    return np.sqrt(np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0))
