"""Mode `detectors`: crossings of traces and arrays of detectors, the misalignment from them, and a closed loop."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from heliosweep.families.family import Computation
from heliosweep.families.misalignment import estimates
from heliosweep.families.misalignment.blocks import ERRORS, Detectors
from heliosweep.families.misalignment.draws import drawn_errors, noise_of_draws
from heliosweep.families.misalignment.estimates import KNOWN, Values, draw_count, pairs
from heliosweep.families.misalignment.points import SIDES, Scene, coded, instant_sizes
from heliosweep.families.misalignment.segments import Segments, segments_of
from heliosweep.families.misalignment.spots_file import TRACES
from heliosweep.grid.regions import Variable, flags, pair, quantity
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.mounts.aiming import Stand, stand
from heliosweep.kernels.spots import traces
from heliosweep.kernels.spots.calibration import Fit, Mounts, Observed, fit
from heliosweep.mounts import commands

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.spots_file import MeasuredSpots
    from heliosweep.families.misalignment.study import MisalignmentStudy
    from heliosweep.families.points import Point

#: Crossings that detectors see of a heliostat at an instant.
SEEN, NO_ELEVATION, NO_AZIMUTH, NEITHER, NO_LIGHT = 0, 1, 2, 3, 4
SIGHT = {
    SEEN: "each_trace_crosses_an_array",
    NO_ELEVATION: "elevation_trace_crosses_no_array",
    NO_AZIMUTH: "azimuth_trace_crosses_no_array",
    NEITHER: "no_trace_crosses_an_array",
    NO_LIGHT: "no_sun_or_no_way_to_aim_or_mirror_behind_the_plane",
}
#: Values of keys that are not specified.
DEFAULTS: dict[str, Any] = {"pitch": 0.0, "noise": 0.0, "parameters": 4, "correction": "mount"}
#: Stream of the noise of the first round, after the streams of spots.
NOISE_STREAM = 200
#: Memory of the crossings of both traces and one segment of an array at an instant. [bytes]
_CROSSING_BYTES = 3000
_SIDES = {"y": SIDES["y"], "z": f"{SIDES['z']}, along the receiver's face"}


def computation(study: MisalignmentStudy) -> Computation:
    """Return the variables of a study and the function that computes them."""
    block, measured, found = detectors_block(study), study.table_of_spots() is not None, variables(study)
    segments, rounds = segments_of(block), block.rounds or 1
    dims = estimates.labels_of(study, "crossing") | {
        "trace": (np.array(TRACES, object), {"long_name": "trace, by the axis of the cylinder that makes it"}),
        "detector": estimates.numbered(segments.arrays, "number of the array of detectors, from 0, lines first"),
        "crossing": estimates.numbered(segments.most, "number of the crossing of a trace and an array, from 0"),
    }
    keys = [f"detectors.{key}" for key in ("parameters", "pitch", "noise")]
    count = math.prod(instant_sizes(study).values()) * len(segments.array) * max(1, draw_count(study)) * rounds
    if not measured:
        keys += ["detectors.correction", *estimates.error_keys(study)]
        dims["round"] = estimates.numbered(rounds + 1, "number of rounds of the closed loop that are done")
    fixed = {"parameters": ((), DEFAULTS["parameters"], {"long_name": "number of estimated errors", "units": "1"})}
    return Computation(
        partial(detect, found, segments),
        found,
        tuple(keys),
        dims,
        coordinates=lambda: fixed if block.parameters is None else {},
        attrs={"crossings": "measured" if measured else "synthetic", "detectors": _described(segments)},
        inputs=study.measured_spots,
        evaluations=count,
        memory=_CROSSING_BYTES * count,
        unit="crossings",
    )


def detectors_block(study: MisalignmentStudy) -> Detectors:
    """Return the block with the arrays of detectors."""
    assert study.detectors is not None
    return study.detectors


def _described(segments: Segments) -> str:
    """Return the segments in numbers: array, start y and z, direction y and z, length."""
    numbers = zip(segments.array, segments.start, segments.along, segments.last - segments.first, strict=True)
    return "; ".join(
        f"{array}: {start[0]:.12g} {start[1]:.12g} {along[0]:.12g} {along[1]:.12g} {length:.12g}"
        for array, start, along, length in numbers
    )


def variables(study: MisalignmentStudy) -> dict[str, Variable]:
    """Variables of a study's result."""
    measured = study.table_of_spots() is not None
    lead, each = ("heliostat",), ("heliostat", *instant_sizes(study))
    dims = (*each, "trace", "detector", "crossing")
    whose = "of the aligned heliostat" if measured else "before any correction, without noise"
    meaning = f"crossing of a trace and an array of detectors {whose}, %"
    found = pair("crossing_%", _SIDES, dims, "m", meaning, "rising along the array; missing if there are fewer") | {
        "crossing_place": quantity(
            dims,
            "m",
            f"place of a crossing {whose} along the array",
            "from its first point; of a line without ends from the foot of the perpendicular of the aim point",
        ),
        "crossing_angle": quantity(
            dims,
            "mrad",
            f"angle from the normal of the mirror to the normal of the cylinder whose ray makes a crossing {whose}",
            "positive raises it (elevation trace) or rotates it clockwise from above (azimuth trace)",
        ),
        "detector_status": coded(each, "crossings that the arrays detect", SIGHT),
        "crossed_fraction": quantity(
            (*lead, "trace", "detector"),
            "1",
            "fraction of the instants with light at which a trace crosses an array",
            "missing without light at any instant",
        ),
        "misses_array": flags(
            (*lead, "detector"),
            "flag for heliostats of which no trace crosses an array at any instant",
            {0: "no", 1: "misses"},
        ),
    }
    found |= estimates.estimate_variables("crossing")
    if measured:
        del found["true_error"]
        meaning = "measured minus predicted crossing, along the array"
        found["crossing_residual"] = quantity((*lead, "spot"), "m", meaning, "in the order of the file")
    else:
        found |= _loop_variables(lead, each)
    return estimates.finished(study, found | estimates.command_variables(study))


def _loop_variables(lead: tuple[str, ...], each: tuple[str, ...]) -> dict[str, Variable]:
    """Misalignment from single instants, and the remaining error after each round of the closed loop."""
    found, rounds, over = {}, (*lead, "round"), "round 0: before any correction; over the instants with a spot"
    for name, axis in (("azimuth", "primary"), ("elevation", "secondary")):
        meaning = f"difference of mirror and command about the {axis} axis, from one instant's crossings"
        found[f"instant_{name}_error"] = quantity(each, "mrad", meaning, "all other errors are assumed to be zero")
        comment = "from noise and pitch of the detectors; 0 without"
        found[f"instant_{name}_standard_error"] = quantity(
            each, "mrad", f"standard error of instant_{name}_error", comment
        )
    aim = "root mean square of the angle between the beam and the direction to the aim point"
    hits = "fraction of the instants with light in which the spot lies in the aperture"
    found["beam_error_rms"] = quantity(rounds, "mrad", aim, over)
    found["spot_distance_rms"] = quantity(rounds, "m", "root mean square distance of the spot from the aim point", over)
    found["round_hit_fraction"] = quantity(rounds, "1", hits, "round 0: before any")
    before = pair("spot_%_before", _SIDES, each, "m", "spot before any correction, %")
    return found | before | pair("spot_%_after", _SIDES, each, "m", "spot after the last round, %")


def detect(variables: dict[str, Variable], segments: Segments, point: Point) -> Values:
    """Compute crossings, estimates and commands at a point."""
    study, scene, samples = point.study, Scene.of(point), max(1, draw_count(point.study))
    given = {key: point[f"detectors.{key}"] for key in DEFAULTS}
    settings = {key: default if given[key] is None else given[key] for key, default in DEFAULTS.items()}
    parameters = int(settings["parameters"])
    field = _Field(
        scene.mounts(),
        np.array([scene.setting.half_width[0], scene.setting.half_height[0]]),
        scene.sun,
        segments,
        float(np.hypot(settings["noise"], settings["pitch"] / np.sqrt(12.0))),
        {
            "parameters": parameters,
            "condition_limit": estimates.condition_limit(parameters, detectors_block(study).condition_limit),
        },
    )
    if point.inputs is not None:
        values = field.from_table(scene.numbers, point.inputs)
    else:
        (drawn,) = drawn_errors(point, scene.numbers, samples)
        values = field.run_loop(point, scene.numbers, 1e-3 * drawn, settings) | {"true_error": drawn}
    return estimates.arranged(study, variables, values)


class _Field(NamedTuple):
    """Mounts before arrays of detectors: half sides of the aperture [m], suns (T, 3), spread of readings [m]."""

    mounts: Mounts
    half: Floats
    sun: Floats
    segments: Segments
    spread: float
    options: dict[str, Any]

    def aimed(self, known: Floats) -> Floats:
        """Commands for known errors, shape (H, K, T, 2). [rad]"""
        return commands(self.mounts, self.sun, known)

    def mirror(self, angles: Floats, actual: Floats) -> Stand:
        """Mirrors with actual errors (H, K, 6) at commanded angles (H, K, T, 2)."""
        wide = slice(None), np.newaxis, np.newaxis
        mounts = self.mounts
        return stand(
            mounts.frames[wide], angles, actual[:, :, np.newaxis], mounts.to_target[wide], tuple(mounts.offsets)
        )

    def world(self, plane: Floats) -> Floats:
        """Vectors y, z of the receiver's plane in the world frame, three numbers each. [m]"""
        return plane[..., :1] * self.mounts.face[1] + plane[..., 1:] * self.mounts.face[2]

    def crossings(self, mirror: Stand) -> tuple[Floats, Floats]:
        """Places along the arrays, shape (H, K, T, 2, A, C) [m], and the angles of the cylinders there [rad]."""
        start, along = self.world(self.segments.start), self.world(self.segments.along)
        places, angles = traces.crossings(mirror, self.sun, start, along, self.segments.ends)
        places[~(traces.dot(mirror.centre, self.mounts.face[0]) > 0)] = np.nan
        return self.segments.by_array(places, angles)

    def observed(self, angles: Floats, readings: Floats) -> Observed:
        """Readings (H, K, T, 2, A, C) at commanded angles (H, K, T, 2) as observations, shape (H K, T, M, ...)."""
        shape = readings.shape
        plane, along = self.segments.points(readings)

        def listed(values: NDArray[Any]) -> NDArray[Any]:
            whole = np.broadcast_to(values, (*shape, values.shape[-1]))
            return whole.reshape(shape[0] * shape[1], shape[2], -1, values.shape[-1])

        per_instant = (slice(None), *[np.newaxis] * 3)
        trace = np.broadcast_to(np.arange(len(TRACES))[:, None, None, None], (*shape, 1))
        return Observed(
            listed(self.sun[per_instant]),
            listed(angles[:, :, *per_instant]),
            listed(self.world(plane)),
            listed(np.isfinite(readings)[..., np.newaxis].astype(float))[..., 0],
            listed(trace)[..., 0],
            listed(self.world(along)),
        )

    def sights(self, mirror: Stand) -> Values:
        """Crossings of every trace with every array, and a status without one."""
        places, turned = self.crossings(mirror)
        lit = np.isfinite(mirror.normal[..., 0]) & (traces.dot(mirror.centre, self.mounts.face[0]) > 0)
        crossed: NDArray[Any] = np.any(np.isfinite(places), axis=-1)  # (H, K, T, 2, A)
        some: Any = crossed.any(axis=-1)
        status = SEEN + NO_ELEVATION * ~some[..., 0] + NO_AZIMUTH * ~some[..., 1]
        count = np.count_nonzero(lit, axis=-1)[..., np.newaxis, np.newaxis]
        return pairs("crossing_{}", self.segments.points(places)[0]) | {
            "crossing_place": places,
            "crossing_angle": 1e3 * turned,
            "detector_status": np.where(lit, status, NO_LIGHT),
            "crossed_fraction": np.count_nonzero(crossed, axis=2) / np.where(count > 0, count, np.nan),
            "misses_array": ~crossed.any(axis=(2, 3)),
        }

    def remaining(self, mirror: Stand) -> tuple[Floats, Values]:
        """Spots (H, K, T, 2) [m], and the errors of the beams over all instants, shape (H, K)."""
        rays = traces.reflected(mirror.normal, self.sun)
        places = traces.spots(mirror.centre, rays, self.mounts.face)
        places[~(traces.dot(mirror.normal, self.sun) > 0)] = np.nan
        turn = rays + mirror.centre / np.sqrt(traces.dot(mirror.centre, mirror.centre))[..., np.newaxis]
        angle = 2.0 * np.arcsin(np.minimum(0.5 * np.sqrt(traces.dot(turn, turn)), 1.0))
        real = np.isfinite(places).all(axis=-1)
        inside = np.count_nonzero(real & (np.abs(places) <= self.half).all(axis=-1), axis=-1)
        lit = np.count_nonzero(np.isfinite(mirror.normal[..., 0]), axis=-1)
        return places, {
            "beam_error_rms": 1e3 * _rms(np.where(real, angle, np.nan)),
            "spot_distance_rms": _rms(np.hypot(places[..., 0], places[..., 1])),
            "round_hit_fraction": np.divide(inside, lit, out=np.full(lit.shape, np.nan), where=lit > 0),
        }

    def estimate(self, observed: Observed, draws: int) -> tuple[Fit, Values]:
        """Fit all crossings of each heliostat and draw; the fit, and its values of shape (H, K, ...)."""
        found = fit(
            self.mounts.of(np.repeat(np.arange(len(self.mounts.frames)), draws)),
            observed,
            spread=self.spread,
            **self.options,
        )
        return found, estimates.estimates(found, draws, "crossing")

    def run_loop(self, point: Point, numbers: NDArray[np.int64], actual: Floats, settings: dict[str, Any]) -> Values:
        """Values of the closed loop, shape (H, K, ...), for mounts with actual errors (H, K, 6)."""
        block, (count, draws, _) = point.study.mount_errors, actual.shape
        by_instant, rounds = settings["correction"] == "instant", detectors_block(point.study).rounds or 1
        known = np.zeros((count, draws, 1, len(ERRORS)))
        angles = self.aimed(known)
        mirror = self.mirror(angles, actual)
        values, (before, first) = self.sights(mirror), self.remaining(mirror)
        places, done, lists = values["crossing_place"], [first], []
        for number in range(rounds):
            noise: Floats | float = 0.0
            if settings["noise"] > 0 and count:
                drawn = noise_of_draws(
                    block.seed or 0, NOISE_STREAM + number, int(numbers[0]), count, draws, math.prod(places.shape[2:])
                )
                noise = settings["noise"] * drawn.reshape(places.shape)
            here = self.observed(angles, self.segments.readings(places, noise, settings["pitch"]))
            instant = self.instants(here, angles.shape[:3]) if number == 0 or by_instant else {}
            if number == 0:
                values |= instant
            lists.append([each.reshape(count * draws, -1, *each.shape[3:]) for each in here if each is not None])
            _, found = self.estimate(
                Observed._make(np.concatenate(each, axis=1) for each in zip(*lists, strict=True)), draws
            )
            estimated: Any = np.isin(found["calibration_status"], KNOWN)[:, :, np.newaxis, np.newaxis]
            better = np.nan_to_num(found["estimated_error"])[:, :, np.newaxis] * 1e-3
            if by_instant:
                better = np.zeros((*angles.shape[:3], len(ERRORS)))
                better[..., 0], better[..., 1] = (
                    1e-3 * instant[f"instant_{name}_error"] for name in ("azimuth", "elevation")
                )
                estimated = np.isfinite(better).all(axis=-1, keepdims=True)
            known = np.where(estimated, better, known)
            angles = self.aimed(known)
            mirror = self.mirror(angles, actual)
            places, _ = self.crossings(mirror)
            after, left = self.remaining(mirror)
            done.append(left)
        values |= found | {name: np.stack([each[name] for each in done], axis=-1) for name in first}
        values |= pairs("spot_{}_before", before) | pairs("spot_{}_after", after)
        corrected = angles if by_instant else np.where(estimated, angles, np.nan)
        return values | estimates.command_values(self.mounts, self.sun, corrected)

    def instants(self, observed: Observed, shape: tuple[int, ...]) -> Values:
        """Offsets of both encoders from the crossings of each instant, shape (H, K, T): a window of one instant."""
        count = math.prod(shape)
        lists = Observed._make(None if each is None else each.reshape(count, *each.shape[2:]) for each in observed)
        every = np.repeat(np.arange(shape[0]), count // max(1, shape[0]))
        found = fit(self.mounts.of(every), lists, parameters=2, condition_limit=np.inf)
        estimated = np.isfinite(found.estimate[:, 0])
        spread = self.spread * np.sqrt(np.diagonal(found.inverse, axis1=1, axis2=2))
        made = {}
        for column, name in enumerate(("azimuth", "elevation")):
            made[f"instant_{name}_error"] = 1e3 * found.estimate[:, column].reshape(shape)
            made[f"instant_{name}_standard_error"] = 1e3 * np.where(estimated, spread[:, column], np.nan).reshape(shape)
        return made

    def from_table(self, numbers: NDArray[np.int64], measured: MeasuredSpots) -> Values:
        """Values from measured crossings, shape (H, 1, ...), with the crossings of mounts without errors."""
        none = np.zeros((len(numbers), 1, len(ERRORS)))
        values = self.sights(self.mirror(self.aimed(none[:, :, np.newaxis]), none))
        _, which = self.segments.nearest(measured.position)
        assert measured.trace is not None
        observed = estimates.observed_of(measured, self.mounts, numbers)._replace(
            position=measured.lists(numbers, self.world(measured.position)),
            trace=measured.lists(numbers, measured.trace, 0),
            along=measured.lists(numbers, self.world(self.segments.along[which])),
        )
        fitted, found = self.estimate(observed, 1)
        known = estimates.known_errors(found["calibration_status"], 1e-3 * found["estimated_error"])
        residual = np.where(fitted.counted, fitted.residual[..., 0], np.nan)[:, np.newaxis]
        corrected = self.aimed(known[:, :, np.newaxis])
        commanded = estimates.command_values(self.mounts, self.sun, corrected)
        return values | found | commanded | {"crossing_residual": residual}


def _rms(values: Floats) -> Floats:
    """Root mean square over the last axis of finite values; NaN without any."""
    known = np.isfinite(values)
    count = np.count_nonzero(known, axis=-1)
    total = np.sum(np.where(known, values, 0.0) ** 2, axis=-1)
    return np.sqrt(np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0))
