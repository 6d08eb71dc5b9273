"""Simulated heliostats, single or in a field: images, slopes by all methods, and estimates of the modules.

In a field, sun and target follow from the position of the heliostat; its distance is the slant range, and its ideal
focal length too if the study gives none. With ``facing: heliostat`` the target with its cameras is rotated about the
vertical to face each heliostat, as four cameras on a ring around a tower could be; with ``fixed`` it keeps
`target.face`. Noise and waviness are drawn separately for each heliostat, noise also for each hour.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from heliosweep.config.tables import SunProfile
from heliosweep.families.backward_gazing import variables as names
from heliosweep.families.backward_gazing.common import (
    Failure,
    Values,
    assumed,
    by_axis,
    estimates,
    profile_of,
    scene_of,
    shape_remarks,
    sun_of,
    values_of,
)
from heliosweep.families.backward_gazing.images import read_disc
from heliosweep.families.backward_gazing.variables import (
    BEHIND,
    CAMERAS,
    EDGE,
    NEEDED,
    NO_PROFILE,
    NO_SUN,
    NOT_SEEN,
    SEEN,
)
from heliosweep.families.family import Computation
from heliosweep.gazing import Found, find_slopes
from heliosweep.grid.layout_axis import LayoutAxis
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.gazing.geometry import REFERENTIALS, MirrorGrid, Scene, eroded, maps, mirror_grid
from heliosweep.kernels.gazing.images import (
    FULL_SCALE,
    camera_set,
    expose,
    heliostat,
    image_set,
    module_spheres,
    pinholes,
    rectify,
    waviness,
)
from heliosweep.kernels.gazing.modules import module_statistics
from heliosweep.kernels.gazing.slopes import graduated, slope_bound
from heliosweep.kernels.sun.clock import declination_cooper, solar_clock
from heliosweep.kernels.sun.profiles import Profile
from heliosweep.kernels.sun.tables import normal_draws

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.study import BackwardGazingStudy
    from heliosweep.families.points import Point, Points

#: Stream of random numbers of the cameras' gains; `rendering` has others.
_GAIN_STREAM = 4
#: Margin around the picture of the heliostat. [pixels]
_MARGIN = 4
#: Reference of relative errors of modules without canting. [mrad]
NOT_CANTED = 1.0


class Observation(NamedTuple):
    """Images and slopes of a point.

    Attributes
    ----------
    mirror, keep : MirrorGrid and ndarray of bool, shape (N,)
        Pixels, and True for pixels that erosion leaves.
    layout, profile : Scene and Profile
        Scene, and profile of the reconstruction.
    images : ndarray, shape (4, N)
        Images that are reconstructed. [1]
    true : ndarray, shape (2, N)
        True slopes relative to the ideal heliostat. [rad]
    found, net : Found and ndarray, shape (M, T, 2, N)
        Slopes, and slopes less those found of the ideal heliostat. [rad]
    ideal : ndarray, shape (M, T, 2, N)
        Slopes found of the ideal heliostat. [rad]
    share : ndarray, shape (4, N) or (1, 1)
        Standard deviation of the values of the images for camera pixels of standard deviation 1. [1]
    """

    mirror: MirrorGrid
    keep: NDArray[np.bool_]
    layout: Scene
    profile: Profile
    images: Floats
    true: Floats
    found: Found
    net: Floats
    ideal: Floats
    share: Floats


class Simulation:
    """Simulation of a study; results that successive points share are kept."""

    def __init__(self, study: BackwardGazingStudy, table: SunProfile | None) -> None:
        self.study, self.table = study, table
        self.modules, self.canting = study.heliostat.rectangles, np.zeros((len(study.heliostat.rectangles.size), 2))
        for number, pair in study.defects.canting.items():
            self.canting[int(number) - 1] = 1e-3 * np.array(pair)
        self.pointing = 1e-3 * np.array(study.defects.pointing)
        self.of_point, self.ideal = lru_cache(2)(self._of_point), lru_cache(2)(self._ideal)
        self.mirror = lru_cache(4)(lambda pixel: mirror_grid(self.modules, pixel))

    def observe(self, values: Values) -> Observation:
        """Render, expose and reconstruct a point. Raises Failure if no slopes can be found with any images."""
        layout, profile = scene_of(values, self.study.cameras.positions), self._profile(values)
        known, mirror = assumed(values, profile), self.mirror(values["heliostat.pixel"])
        wavy = self._wavy(mirror, values)
        truth = self.modules, values["defects.focal_length"], values["defects.canting_scale"] * self.canting
        images, true = image_set(layout, mirror, profile, module_spheres(*truth, self.pointing), wavy)
        seed, noise, bits = (values[f"cameras.{key}"] for key in ("seed", "noise", "bits"))
        own = 1.0 + values["cameras.gain_noise"] * normal_draws(int(seed), _GAIN_STREAM, CAMERAS)
        gains = (1.0 + values["cameras.gain_error"]) * np.maximum(own, 0.0)
        share = np.ones((1, 1))
        if values["cameras.images"] == "camera":
            reach = np.abs(self.modules.centre) + 0.5 * self.modules.size
            # A tilted mirror is seen foreshortened and rotated: its larger side fits in any direction.
            side = 2 * math.ceil(float(reach.max()) / values["heliostat.pixel"]) + 2 * _MARGIN
            cameras = pinholes(layout, (side, side), layout.distance / values["heliostat.pixel"])
            surface = heliostat(*truth, self.pointing, None if wavy is None else (mirror, wavy))
            rays = int(values["cameras.supersampling"])
            pictures = camera_set(layout, cameras, (side, side), profile, surface, rays) * gains[:, None, None]
            taken = expose(pictures, noise, int(bits), int(seed), pinhole=True)
            images, _, share = rectify(taken, cameras, layout.focal_length, self.modules, mirror)
        else:
            images = expose(images * gains[:, np.newaxis], noise, int(bits), int(seed))
        found = self._find(layout, known, images, mirror, values)
        ideal_keys = ("heliostat.", "target.", "sun", "cameras.arr", "cameras.rad", "cameras.thr", "profile_")
        ideal, ideal_true = self.ideal(tuple(item for item in values.items() if item[0].startswith(ideal_keys)))
        keep = eroded(mirror, int(values["erosion"]))
        return Observation(
            mirror, keep, layout, known, images, true - ideal_true, found, found.slopes - ideal, ideal, share
        )

    def bound(self, seen: Observation, values: Values, method: str | None = None) -> Floats:
        """Return the Cramer-Rao bound of the slopes, shape (2, N); NaN if fewer than 3 cameras are lit. [rad]

        With `fit_gain` it is the bound of methods that find a gain, except for method A.
        """
        step = FULL_SCALE / (2.0 ** values["cameras.bits"] - 1.0) if values["cameras.bits"] else 0.0
        deviation = math.hypot(values["cameras.noise"], step / math.sqrt(12.0))  # noise, and rounding to levels
        least = np.zeros_like(seen.true)
        if deviation > 0.0:
            noise = deviation * seen.share / (1.0 + values["cameras.gain_error"])
            gain = self.study.fit_gain and method != "A"
            least = slope_bound(seen.layout, seen.profile, seen.mirror.pixels, seen.true, noise, gain, seen.found.lit)
        return np.where(np.bitwise_count(seen.found.lit) >= NEEDED, least, np.nan)

    def over_modules(self, seen: Observation, values: Floats) -> tuple[Floats, Floats, NDArray[np.int64]]:
        """Return mean, root mean square and number of values (..., N) over the eroded modules, each (..., modules)."""
        return module_statistics(values, seen.mirror.pixel_module, seen.keep, len(self.modules.size))

    def one(self, point: Point) -> dict[str, Any]:
        """Return the values of the variables of one heliostat."""
        return self.of_point(tuple(values_of(point, {}).items()))

    def _of_point(self, items: tuple[tuple[str, Any], ...]) -> dict[str, Any]:
        values = dict(items)
        try:
            seen = self.observe(values)
        except Failure as failure:
            return {"scene_status": failure.args[0]}
        least, study = self.bound(seen, values), self.study
        mean, rms, _ = self.over_modules(seen, 1e3 * (seen.net - seen.true))
        entered = 1e3 * np.hypot(*np.transpose(values["defects.canting_scale"] * self.canting))
        relative = 100.0 * np.abs(mean) / np.where(entered > 0.0, entered, NOT_CANTED)
        kept = np.bincount(seen.mirror.pixel_module[seen.keep], minlength=len(entered))
        lit = np.bitwise_count(seen.found.lit)
        deviations = []
        for method in study.method:
            own = self.bound(seen, values, "A") if study.fit_gain and method == "A" else least
            deviations.append(np.nan_to_num(own) if np.any(own > 0.0) else None)
        made = {
            **by_axis("slope_bias_%", mean),
            **by_axis("slope_rms_%", rms),
            **by_axis("relative_error_%", relative),
            "lit_cameras": self.over_modules(seen, lit / CAMERAS)[0],
            **by_axis("cramer_rao_bound_%", self.over_modules(seen, 1e3 * least)[1], 0),
            **estimates(seen.net, deviations, seen.mirror, self.modules, seen.keep, values["heliostat.focal_length"]),
            "scene_status": SEEN if np.isfinite(seen.net[:, 0, 0, seen.keep]).any() else NOT_SEEN,
            "incidence": math.degrees(seen.layout.incidence),
            "evaluations": seen.found.evaluations,
        }
        with np.errstate(invalid="ignore"):
            made["usable_fraction"] = self.over_modules(seen, seen.net[:, 0, 0])[2] / kept
        if study.output.maps:
            mirror, mask = seen.mirror, np.where(seen.keep, np.where(lit >= NEEDED, 3, 2), 1)
            made |= sun_of(self._profile(values))
            made |= by_axis("raw_slope_%", maps(mirror, 1e3 * seen.found.slopes))
            made |= by_axis("raw_ideal_slope_%", maps(mirror, 1e3 * seen.ideal))
            made |= by_axis("slope_%", maps(mirror, 1e3 * seen.net))
            made |= by_axis("true_slope_%", maps(mirror, 1e3 * seen.true), 0)
            made |= {"image": maps(mirror, seen.images), "mask": np.nan_to_num(maps(mirror, mask))}
            made["quality"] = np.nan_to_num(maps(mirror, seen.found.quality | EDGE * ~seen.keep))
        return made

    def field(self, point: Point) -> dict[str, Any]:
        """Return the values of the variables of the heliostats of a field at all hours."""
        assert self.study.field is not None
        layout, span, hours = point.layout, point.part("heliostat"), self.study.field.hours.values()
        suns = solar_clock(np.radians(point["field.latitude"]), declination_cooper(point["field.day"]), hours)
        up = point["field.receiver_height"] - layout.z - point["field.pivot_height"]
        ways = np.stack((-layout.x, -layout.y, up), axis=1)
        scenes = [
            [self._scene(point, ways[row], sun, (row, hour)) for hour, sun in enumerate(suns)]
            for row in range(len(ways))[span]
        ]
        made = {"slant_range": np.sqrt(layout.x**2 + layout.y**2 + up**2)[span]}
        for name, one in names.FIELD.items():
            if name in made:
                continue
            none = 0.0 if name in ("usable_fraction", "lit_cameras") else np.nan
            size = [len(getattr(self.study, {"slope_method": "method"}.get(dim, dim))) for dim in one.dims[2:]]
            made[name] = np.array([[scene.get(name, np.full(size, none)) for scene in row] for row in scenes])
        return made

    def _scene(self, point: Point, way: Floats, sun: Floats, number: tuple[int, int]) -> dict[str, Any]:
        """Return the values of the variables of one heliostat at one hour; its numbers modify the seeds."""
        if not sun[2] > 0.0:
            return {"scene_status": NO_SUN}
        (sun_azimuth, sun_elevation), (azimuth, elevation) = _direction(sun), _direction(way)
        known = {
            "heliostat.distance": math.sqrt(float(np.sum(way**2))), "target.azimuth": azimuth,
            "target.elevation": elevation, "sun.azimuth": sun_azimuth, "sun.elevation": sun_elevation,
        }  # fmt: skip
        if point["field.facing"] == "heliostat":
            known["target.face"] = azimuth
        else:
            tilt, up, turn = np.radians((point["target.tilt"], elevation, azimuth - point["target.face"]))
            if not math.cos(tilt) * math.cos(up) * math.cos(turn) + math.sin(tilt) * math.sin(up) > 0.0:
                return {"scene_status": BEHIND}
        values = values_of(point, known)
        if values["cameras.noise"]:
            values["cameras.seed"] = mixed_seed(int(values["cameras.seed"]), *number)
        if values["defects.waviness"]:
            values["defects.seed"] = mixed_seed(int(values["defects.seed"]), number[0])
        try:
            seen = self.observe(values)
        except Failure as failure:
            return {"scene_status": failure.args[0]}
        mean, rms, count = self.over_modules(seen, 1e3 * (seen.net - seen.true))
        usable = count[:, 0, 0].sum(axis=-1) / int(np.count_nonzero(seen.keep))
        found: dict[str, Any] = {
            "scene_status": SEEN if usable.any() else NOT_SEEN,
            "incidence": math.degrees(seen.layout.incidence),
            "usable_fraction": usable,
            "lit_cameras": float(np.mean(np.bitwise_count(seen.found.lit)[seen.keep])) / CAMERAS,
        }
        if not usable.any():
            return found
        with np.errstate(invalid="ignore", divide="ignore"):
            total = np.sqrt(np.sum(np.where(count > 0, rms**2 * count, 0.0), axis=-1) / count.sum(axis=-1))
            some = np.count_nonzero(count, axis=-1)
            canting = np.sqrt(np.sum(np.where(count > 0, mean**2, 0.0), axis=-1) / some)
            bounds = np.sqrt(np.nanmean((1e3 * self.bound(seen, values)[:, seen.keep]) ** 2, axis=-1))
        found |= by_axis("slope_rms_%", total) | by_axis("canting_rms_%", canting)
        return found | by_axis("cramer_rao_bound_%", bounds, 0)

    def _profile(self, values: Values) -> Profile:
        try:
            profile = profile_of(values, self.table)
            if values["sun_profile"] == "noisy":
                graduated(profile)  # noise may make a smoothed table useless even if the table is not
        except ValueError:
            raise Failure(NO_PROFILE) from None
        return profile

    def _wavy(self, mirror: MirrorGrid, values: Values) -> Floats | None:
        """Return slopes of waviness and of the curvature of single modules, shape (2, N) [rad]; None without any."""
        rms, length, seed = (values[f"defects.{key}"] for key in ("waviness", "waviness_length", "seed"))
        wavy = waviness(mirror, 1e-3 * rms, length, int(seed)) if rms else None
        sphere = 0.5 / values["defects.focal_length"]
        for number, (first, second, axis) in (self.study.defects.curvature or {}).items():
            c, s, one, other = math.cos(math.radians(axis)), math.sin(math.radians(axis)), 0.5 / first, 0.5 / second
            yy, yz, zz = c * c * one + s * s * other, c * s * (one - other), s * s * one + c * c * other
            here = mirror.pixel_module == int(number) - 1
            y, z = mirror.pixels[:, here] - self.modules.centre[int(number) - 1][:, np.newaxis]
            wavy = np.zeros(mirror.pixels.shape) if wavy is None else wavy
            wavy[:, here] += (sphere - yy) * y - yz * z, (sphere - zz) * z - yz * y
        return wavy

    def _find(self, layout: Scene, known: Profile, images: Floats, mirror: MirrorGrid, values: Values) -> Found:
        study, rows = self.study, tuple(map(REFERENTIALS.index, self.study.referential))
        threshold = values["cameras.threshold"]
        return find_slopes(
            layout, known, images, mirror.pixels, threshold, study.method, rows, study.fit_gain, study.smooth
        )

    def _ideal(self, items: tuple[tuple[str, Any], ...]) -> tuple[Floats, Floats]:
        """Return the slopes found of the ideal heliostat by cameras without noise, and its true slopes."""
        values = dict(items)
        layout, known = scene_of(values, self.study.cameras.positions), assumed(values, self._profile(values))
        mirror, flat = self.mirror(values["heliostat.pixel"]), np.zeros_like(self.canting)
        spheres = module_spheres(self.modules, values["heliostat.focal_length"], flat)
        images, true = image_set(layout, mirror, known, spheres)
        return self._find(layout, known, images, mirror, values).slopes, true


def computation(study: BackwardGazingStudy) -> Computation:
    """Return the variables of simulated heliostats and the functions that compute them."""
    simulation = lru_cache(1)(partial(Simulation, study))
    pixels = names.most_pixels(study)
    shared: dict[str, Any] = {
        "variables": names.variables(study),
        "labels": names.OF_SIMULATIONS,
        "attrs": names.attributes(study),
        "inputs": partial(_table, study),
        "unit": "pixels",
        "memory": pixels * names.bytes_per_pixel(study),
    }
    if study.field is None:
        return Computation(
            function=lambda point: simulation(point.inputs).one(point),
            dims=names.dims(study, study.output.maps),
            coordinates=partial(names.coordinates, study, study.output.maps),
            finish=partial(percentiles, study),
            whole=names.seed_dims(study),
            evaluations=pixels,
            mode="simulated",
            **shared,
        )
    hours, layouts = len(study.field.hours), partial(LayoutAxis, key="field.layout")
    return Computation(
        function=lambda point: simulation(point.inputs).field(point),
        dims=names.dims(study, False),
        layouts=layouts,
        split="heliostat",
        evaluations=lambda: hours * pixels * layouts(study).size,
        mode="field",
        **(shared | {"labels": (*names.FIELD_KEYS, *names.OF_SIMULATIONS)}),
    )


def _table(study: BackwardGazingStudy) -> SunProfile | None:
    """Read the profile of the sun. Raises StudyError."""
    name = study.sun.profile
    return None if name is None else read_disc(study.resolve(name), name)


def percentiles(study: BackwardGazingStudy, points: Points, computed: xr.Dataset) -> dict[str, Any]:
    """Return percentiles of the relative errors over the seeds, without NaN."""
    seeds, percents = names.seed_dims(study), [percent for percent, _ in names.PERCENTILES.values()]
    made: dict[str, Any] = {}
    for name in ("relative_error_x", "relative_error_y"):
        array = computed[name].transpose(..., *seeds).to_numpy()
        flat = array.reshape(*array.shape[: array.ndim - len(seeds)], -1)
        empty = np.isnan(flat).all(axis=-1, keepdims=True)  # points without slopes
        found = np.where(empty[..., 0], np.nan, np.nanpercentile(np.where(empty, 0.0, flat), percents, axis=-1))
        made |= {f"{name}_{ending}": one for ending, one in zip(names.PERCENTILES, found, strict=True)}
    return made


def mixed_seed(seed: int, *numbers: int) -> int:
    """Return a separate seed for some numbers, by the finaliser of SplitMix64."""
    state = seed
    for number in numbers:
        state = (state + (number + 1) * 0x9E3779B97F4A7C15) % 2**64
        state = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) % 2**64
        state = ((state ^ (state >> 27)) * 0x94D049BB133111EB) % 2**64
        state ^= state >> 31
    return state % 2**63


def _direction(vector: Floats) -> tuple[float, float]:
    """Return azimuth from south towards east, and elevation, of a vector east, north, up. [deg]"""
    east, north, up = map(float, vector)
    return math.degrees(math.atan2(east, -north)), math.degrees(math.atan2(up, math.hypot(east, north)))


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Yield warnings about scenes without slopes and modules that are seen in part."""
    status, heliostats = result["scene_status"], result.attrs["mode"] == "field"
    what = "scenes" if heliostats else "points"
    for code, count in zip(*np.unique(status, return_counts=True), strict=True):
        words = names.STATUS[int(code)].replace("_", " ")
        if code == NOT_SEEN and not heliostats:
            which = "the heliostat" if status.size == 1 else f"{count:,} of {status.size:,} heliostats"
            yield (
                f"no slopes of {which}: nowhere do three cameras see the reflected sun, and all pixels are masked; "
                "is it aimed at the target?"
            )
        elif code != SEEN:
            yield f"no slopes in {count:,} of {status.size:,} {what}: {words} (scene_status {code})"
    if heliostats:
        never = (status == NOT_SEEN).all("hour")
        if bool(never.any()):
            count = f"{int(never.sum()):,} of {never.size:,}"
            yield f"{count} heliostats are all masked: no three cameras see them at any hour"
        return
    usable = result["usable_fraction"].where(status == SEEN)
    partly = usable.where(usable < 1.0)
    if bool(partly.notnull().any()):
        least, at = float(partly.min()), int(partly.notnull().sum())
        yield (
            f"{at:,} of {int(usable.notnull().sum()):,} modules, counted for each method, are seen by three cameras in "
            f"part only; the minimum is {math.floor(1000.0 * least) / 10.0:g} % of the pixels"
        )
    yield from shape_remarks(result)
