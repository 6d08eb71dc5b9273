"""Mode `detectors`: mount errors from crossings of traces with detector arrays, and closed-loop correction."""

from __future__ import annotations

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.families.family import Computation
from heliosweep.families.misalignment.calibration import (
    KNOWN,
    MOUNT_AXES,
    Values,
    arranged,
    command_values,
    estimate_variables,
    estimates,
    finished,
    known_errors,
    labels_of,
    observed_of,
    pairs,
    rms,
)
from heliosweep.families.misalignment.points import (
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
from heliosweep.families.points import Point
from heliosweep.grid.regions import Variable, flags, pair, quantity
from heliosweep.kernels import traces
from heliosweep.kernels.calibration import Fit, Observed, fit
from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.mounts import ERRORS, Mounts, Stand

#: Values of `detector_status`, for each heliostat and instant.
SEEN, NO_ELEVATION, NO_AZIMUTH, NEITHER, NO_LIGHT = 0, 1, 2, 3, 4
SIGHT = {
    SEEN: "each_trace_crosses_an_array",
    NO_ELEVATION: "elevation_trace_crosses_no_array",
    NO_AZIMUTH: "azimuth_trace_crosses_no_array",
    NEITHER: "no_trace_crosses_an_array",
    NO_LIGHT: "no_sun_or_no_way_to_aim_or_mirror_behind_the_plane",
}
#: Default values of keys that the study may omit.
DEFAULTS: dict[str, Any] = {"pitch": 0.0, "noise": 0.0, "parameters": 4, "correction": "mount"}
_SIDES = {"y": SIDES["y"], "z": f"{SIDES['z']}, along the receiver's face"}


def computation(study: MisalignmentStudy) -> Computation:
    """Return the variables of a study and the function that computes them."""
    measured, found = study.table_of_spots() is not None, variables(study)
    block: Any = study.detectors
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
        partial(detect, found, segments),
        found,
        tuple(keys),
        dims,
        coordinates=lambda: fixed if block.parameters is None else {},
        attrs={
            "crossings": "measured" if measured else "synthetic",
            "detectors": "; ".join(f"{array}: {one}" for array, one in zip(segments.array, words, strict=True)),
        },
        inputs=study.measured_spots,
        evaluations=count,
        memory=3000 * count,  # bytes
        unit="crossings",
    )


def variables(study: MisalignmentStudy) -> dict[str, Variable]:
    """Return the variables of a study's result."""
    measured = study.table_of_spots() is not None
    lead, each = ("heliostat",), ("heliostat", *instant_sizes(study))
    dims, rounds = (*each, "trace", "detector", "crossing"), (*lead, "round")
    whose = "of the aligned heliostat" if measured else "before any correction, without noise"
    meaning = f"crossing of a trace and a detector array {whose}, %"
    found = pair(
        "crossing_%", _SIDES, dims, "m", meaning, "ascending along the array; missing if there are fewer crossings"
    ) | {
        "crossing_place": quantity(
            dims,
            "m",
            f"position of a crossing {whose} along the array",
            "measured from the first point of the array; for an infinite line, from the foot of the perpendicular "
            "from the aim point",
        ),
        "crossing_angle": quantity(
            dims,
            "mrad",
            f"angle from the mirror normal to the cylinder normal at the ray of a crossing {whose}",
            "positive upwards (elevation trace) or clockwise from above (azimuth trace)",
        ),
        "detector_status": coded(each, "crossings that the arrays detect", SIGHT),
        "crossed_fraction": quantity(
            (*lead, "trace", "detector"),
            "1",
            "fraction of the instants with sunlight at which a trace crosses an array",
            "missing if there is no sunlight at any instant",
        ),
        "misses_array": flags(
            (*lead, "detector"),
            "flag for heliostats whose traces never cross an array",
            {0: "no", 1: "misses"},
        ),
    }
    found |= estimate_variables("crossing", not measured)
    meaning = "measured minus predicted crossing, along the array"
    residual = quantity((*lead, "spot"), "m", meaning, "in the order of the file")
    meaning = "deviation of the mirror from its command about the % axis, from the crossings of one instant"
    over = "round 0: before any correction; over the instants with a spot"
    loop = {
        **pair("instant_%_error", MOUNT_AXES, each, "mrad", meaning, "all other errors are assumed to be zero"),
        **{
            f"instant_{axis}_standard_error": quantity(
                each,
                "mrad",
                f"standard error of instant_{axis}_error",
                "from noise and pitch of the detectors; 0 without",
            )
            for axis in MOUNT_AXES
        },
        "beam_error_rms": quantity(
            rounds, "mrad", "root mean square of the angle between the beam and the direction to the aim point", over
        ),
        "spot_distance_rms": quantity(
            rounds, "m", "root mean square distance of the spot from the aim point", over
        ),
        "round_hit_fraction": quantity(
            rounds, "1", "fraction of the instants with sunlight at which the spot lies in the aperture",
            "round 0: before any correction",
        ),
        **pair("spot_%_before", _SIDES, each, "m", "spot before any correction, %"),
        **pair("spot_%_after", _SIDES, each, "m", "spot after the last round, %"),
    }  # fmt: skip
    return finished(study, found | ({"crossing_residual": residual} if measured else loop))


def detect(variables: dict[str, Variable], segments: Segments, point: Point) -> Values:
    """Compute the crossings, the estimated errors and the commands at one point of the parameter grid."""
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
    if point.inputs is not None:
        return arranged(study, variables, field.from_table(scene.numbers, point.inputs))
    (drawn,) = drawn_errors(point, scene.numbers)
    seeds = (study.mount_errors.seed or 0), tuple(scene.numbers.tolist())
    values = field.run_loop(1e-3 * drawn, settings, study.detectors.rounds or 1, seeds)
    return arranged(study, variables, values | {"true_error": drawn})


class _Field(NamedTuple):
    """Mounts, aperture, sun and detector arrays.

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
        """Return the positions of crossings along arrays [m] and cylinder angles [rad], shape (H, K, T, 2, A, C)."""
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
        """Return the crossings of each trace with each array, with a status that explains missing crossings."""
        places, turned = self.crossings(mirror)
        lit = np.isfinite(mirror.normal[..., 0]) & (traces.dot(mirror.centre, self.mounts.face[0]) > 0)
        crossed: NDArray[Any] = np.any(np.isfinite(places), axis=-1)  # (H, K, T, 2, A)
        status = SEEN + np.sum(np.where(crossed.any(axis=-1), 0, [NO_ELEVATION, NO_AZIMUTH]), axis=-1)
        count = np.count_nonzero(lit, axis=-1)[..., np.newaxis, np.newaxis]
        return pairs("crossing_{}", self.segments.points(places)[0]) | {
            "crossing_place": places,
            "crossing_angle": 1e3 * turned,
            "detector_status": np.where(lit, status, NO_LIGHT),
            "crossed_fraction": np.count_nonzero(crossed, axis=2) / np.where(count > 0, count, np.nan),
            "misses_array": ~crossed.any(axis=(2, 3)),
        }

    def remaining(self, mirror: Stand) -> tuple[Floats, Values]:
        """Return the spots, shape (H, K, T, 2) [m], and statistics of beam errors over all instants, shape (H, K)."""
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

    def estimate(self, observed: Observed) -> tuple[Fit, Values]:
        """Fit the mount errors to all crossings of each heliostat and draw.

        Return the fit, and the variables of the estimates, shape (H, K, ...).
        """
        draws = len(observed.sun) // max(1, len(self.mounts.frames))
        every = np.repeat(np.arange(len(self.mounts.frames)), draws)
        found = fit(self.mounts.of(every), observed, spread=self.spread, **self.options)
        return found, estimates(found, draws, "crossing")

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
        estimated: Any = True
        for number in range(rounds):
            noise: Floats | float = 0.0
            if settings["noise"] > 0 and count:
                drawn = noise_of_draws(
                    seeds[0], 200 + number, seeds[1], draws, math.prod(places.shape[2:])
                )  # after the streams for spots
                noise = settings["noise"] * drawn.reshape(places.shape)
            here = self.observed(angles, self.segments.readings(places, noise, settings["pitch"]))
            lists.append([each.reshape(count * draws, -1, *each.shape[3:]) for each in here if each is not None])
            _, found = self.estimate(Observed._make(np.concatenate(each, axis=1) for each in zip(*lists, strict=True)))
            instant = self.instants(here, angles.shape[:3]) if number == 0 or by_instant else {}
            values |= instant if number == 0 else {}
            better = np.nan_to_num(found["estimated_error"])[:, :, np.newaxis] * 1e-3
            estimated = np.isin(found["calibration_status"], KNOWN)[:, :, np.newaxis, np.newaxis]
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
        values |= pairs("spot_{}_before", before) | pairs("spot_{}_after", after)
        corrected = angles if by_instant else np.where(estimated, angles, np.nan)
        return values | command_values(self.mounts, self.sun, corrected)

    def instants(self, observed: Observed, shape: tuple[int, ...]) -> Values:
        """Estimate the offsets of both encoders from the crossings at each instant, shape (H, K, T)."""
        count = math.prod(shape)
        lists = Observed._make(None if each is None else each.reshape(count, *each.shape[2:]) for each in observed)
        every = np.repeat(np.arange(shape[0]), count // max(1, shape[0]))
        found = fit(self.mounts.of(every), lists, parameters=2, condition_limit=np.inf)
        spread = self.spread * np.sqrt(np.diagonal(found.inverse, axis1=1, axis2=2))
        spread = np.where(np.isfinite(found.estimate[:, :1]), spread, np.nan)
        return {
            f"instant_{axis}_{name}": 1e3 * array[:, column].reshape(shape)
            for name, array in (("error", found.estimate), ("standard_error", spread))
            for column, axis in enumerate(MOUNT_AXES)
        }

    def from_table(self, numbers: NDArray[np.int64], measured: MeasuredSpots) -> Values:
        """Return estimates from measured crossings, and the crossings of mounts without errors, shape (H, 1, ...)."""
        none = np.zeros((len(numbers), 1, 1, len(ERRORS)))
        values = self.sights(self.mounts.stand(self.mounts.aim(self.sun, none), none))
        _, which = self.segments.nearest(measured.position)
        observed = observed_of(measured, self.mounts, numbers)._replace(
            position=measured.lists(numbers, self.mounts.on_face(measured.position)),
            trace=measured.lists(numbers, np.asarray(measured.trace), 0),
            along=measured.lists(numbers, self.mounts.on_face(self.segments.along[which])),
        )
        fitted, found = self.estimate(observed)
        known = known_errors(found["calibration_status"], 1e-3 * found["estimated_error"])
        residual = np.where(fitted.counted, fitted.residual[..., 0], np.nan)[:, np.newaxis]
        commanded = command_values(self.mounts, self.sun, self.mounts.aim(self.sun, known[:, :, np.newaxis]))
        return values | found | commanded | {"crossing_residual": residual}
