"""One point of the parameter grid: the scene, its images, slopes by all methods, and what is known of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from heliosweep.families.backward_gazing.camera_level import camera_views
from heliosweep.families.backward_gazing.checks import camera_places, modules_of
from heliosweep.families.backward_gazing.profile_file import read_profile
from heliosweep.families.backward_gazing.reconstruct import Found, reconstruct
from heliosweep.families.backward_gazing.variables import NO_PROFILE, NOT_IDENTIFIABLE
from heliosweep.kernels.gazing_geometry import REFERENTIALS, Scene, scene
from heliosweep.kernels.gazing_grid import MirrorGrid, Modules, eroded, mirror_grid
from heliosweep.kernels.gazing_images import expose, image_set, module_spheres, waviness
from heliosweep.kernels.gazing_linear import lit_counts, slope_bound
from heliosweep.kernels.gazing_lm import graduated
from heliosweep.kernels.sun_profiles import Profile, jose, tabulated
from heliosweep.kernels.sun_tables import noisy, normal_draws, scaled

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.config import BackwardGazingStudy
    from heliosweep.grid.axes import Grid

Floats = NDArray[np.float64]
Pairs = tuple[tuple[float, float], ...]

#: Time of a pixel on one core: its images, and each method's share for a tabulated profile. [s]
SECONDS_PER_IMAGE = 0.6e-6
SECONDS_PER_METHOD = {"A": 0.2e-6, "O1": 4.5e-6, "O2": 5e-6, "LM": 1.6e-6}
#: Overhead of a point. [s]
SECONDS_PER_POINT = 3e-3
#: The largest kernels of all families, and what is needed to load them. [bytes]
KERNEL_BYTES = 25 * 2**20
#: Brightness of the highest level of a camera, relative to the disc centre; see `gazing_images.expose`.
FULL_SCALE = 1.25
#: Stream of random numbers of the cameras' gains; `gazing_images` and `camera_images` have others.
_GAIN_STREAM = 4
#: Lit cameras that slopes need.
NEEDED = 3
#: Pixels of mirrors whose results are remembered.
MOST_REMEMBERED = 100_000


class Point(NamedTuple):
    """Values of the study's keys at a point of its grid; see `KEYS`."""

    focal_length: float
    distance: float
    pixel: float
    target_azimuth: float
    target_elevation: float
    tilt: float
    face: float
    sun_azimuth: float
    sun_elevation: float
    arrangement: str
    radius: float
    noise: float
    gain_error: float
    gain_noise: float
    bits: int
    images: str
    supersampling: int
    threshold: float
    camera_seed: int
    canting_scale: float
    waviness: float
    waviness_length: float
    true_focal_length: float
    defect_seed: int
    sun_profile: str
    profile_noise: float
    nodes: int
    profile_seed: int
    profile_error: float
    erosion: int

    @classmethod
    def of(cls, values: Iterable[Any]) -> Point:
        """Values as they come out of arrays, NaN where the study gives none; what has no part in them becomes 0."""
        own = {name: _KINDS.get(name, float)(value) for name, value in zip(cls._fields, values, strict=True)}
        point = cls(**own)
        if math.isnan(point.focal_length):
            point = point._replace(focal_length=point.distance)
        if math.isnan(point.true_focal_length):
            point = point._replace(true_focal_length=point.focal_length)
        if point.noise == point.gain_noise == 0.0:
            point = point._replace(camera_seed=0)
        if point.waviness == 0.0:
            point = point._replace(defect_seed=0, waviness_length=1.0)
        if point.sun_profile != "noisy":
            point = point._replace(profile_noise=0.0, nodes=0, profile_seed=0)
        if point.images != "camera":
            point = point._replace(supersampling=1)
        return point

    @property
    def ideal(self) -> Point:
        """The ideal heliostat, seen by cameras without noise under the profile by which slopes are found."""
        return self._replace(
            noise=0.0, gain_error=0.0, gain_noise=0.0, bits=0, images="mirror_grid", supersampling=1, camera_seed=0,
            canting_scale=0.0,
            waviness=0.0, waviness_length=1.0, true_focal_length=self.focal_length, defect_seed=0, erosion=0,
        )  # fmt: skip

    @property
    def gains(self) -> Floats:
        """Gain of each camera, shape (4,): number i depends on the seed and i alone. [1]"""
        own = 1.0 + self.gain_noise * normal_draws(self.camera_seed, _GAIN_STREAM, 4)
        return (1.0 + self.gain_error) * np.maximum(own, 0.0)

    @property
    def deviation(self) -> float:
        """Standard deviation of a pixel's brightness: noise, and rounding to levels. [1]"""
        step = FULL_SCALE / (2.0**self.bits - 1.0) if self.bits else 0.0
        return math.hypot(self.noise, step / math.sqrt(12.0))


#: Types of what is not a float.
_KINDS: dict[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("arrangement", "images", "sun_profile"), str),
    **dict.fromkeys(("bits", "supersampling", "camera_seed", "defect_seed", "nodes", "profile_seed", "erosion"), int),
}
#: Keys of the study in the order of `Point`.
KEYS = (
    "heliostat.focal_length", "heliostat.distance", "heliostat.pixel", "target.azimuth", "target.elevation",
    "target.tilt", "target.face", "sun.azimuth", "sun.elevation", "cameras.arrangement", "cameras.radius",
    "cameras.noise", "cameras.gain_error", "cameras.gain_noise", "cameras.bits", "cameras.images",
    "cameras.supersampling",
    "cameras.threshold", "cameras.seed", "defects.canting_scale", "defects.waviness", "defects.waviness_length",
    "defects.focal_length", "defects.seed", "sun_profile", "profile_noise.noise", "profile_noise.nodes",
    "profile_noise.seed", "profile_error", "erosion",
)  # fmt: skip


class Given(NamedTuple):
    """What the study says once for all points."""

    centres: Pairs
    sizes: Pairs
    canting: Pairs
    """Of every module, [rad]."""
    pointing: tuple[float, float]
    """[rad]"""
    positions: Pairs | None
    """Cameras in the target's plane instead of an arrangement. [m]"""
    table: tuple[tuple[float, ...], tuple[float, ...]] | None
    """Angles [rad] and brightness of the study's sun profile."""
    methods: tuple[str, ...]
    referentials: tuple[int, ...]
    fit_gain: bool
    smooth: bool
    """Whether LM ends at the smooth fit of a table."""

    @property
    def modules(self) -> Modules:
        """The modules as kernels take them."""
        return Modules(np.array(self.centres), np.array(self.sizes))


class Failure(Exception):
    """There are no slopes at a point; the argument is its scene_status."""

    @property
    def status(self) -> int:
        """The scene_status."""
        return int(self.args[0])


class Observation(NamedTuple):
    """A point as it was seen and reconstructed."""

    mirror: MirrorGrid
    keep: NDArray[np.bool_]
    """Pixels that erosion leaves, shape (N,)."""
    layout: Scene
    profile: Profile
    """By which slopes are found."""
    images: Floats
    """As the reconstruction gets them, shape (4, N). [1]"""
    true: Floats
    """True slopes relative to the ideal heliostat, shape (2, N). [rad]"""
    found: Found
    net: Floats
    """Slopes found, less those found of the ideal heliostat, shape (M, T, 2, N). [rad]"""
    share: Floats
    """Standard deviation of the images' values for camera pixels of standard deviation 1, (4, N) or (1, 1). [1]"""

    @property
    def lit(self) -> NDArray[np.int64]:
        """Number of lit cameras, shape (N,)."""
        return lit_counts(self.found.lit)


def given(study: BackwardGazingStudy) -> Given:
    """What the study says once for all points."""
    modules = modules_of(study)
    canting = np.zeros((len(modules.size), 2))
    for key, pair in study.defects.canting.items():
        canting[int(key) - 1] = pair
    table = None
    if study.sun.profile is not None:
        read = read_profile(study.resolve(study.sun.profile), study.sun.profile)
        table = tuple(read.angle.tolist()), tuple(read.brightness.tolist())
    horizontal, vertical = study.defects.pointing
    return Given(
        tuple(map(tuple, modules.centre.tolist())),
        tuple(map(tuple, modules.size.tolist())),
        tuple(map(tuple, (1e-3 * canting).tolist())),
        (1e-3 * horizontal, 1e-3 * vertical),
        study.cameras.positions,
        table,
        study.method,
        tuple(REFERENTIALS.index(name) for name in study.referential),
        study.fit_gain,
        study.smooth,
    )


def inputs(grid: Grid) -> list[xr.DataArray]:
    """Values of `KEYS` over the swept dimensions, NaN where the study gives none."""
    return [grid.parameter(key) if grid.has(key) else xr.DataArray(math.nan) for key in KEYS]


def seconds_per_pixel(study: BackwardGazingStudy) -> float:
    """Time of a pixel on one core: of the heliostat and of the ideal one. [s]"""
    return 2.0 * (SECONDS_PER_IMAGE + sum(SECONDS_PER_METHOD[name] for name in study.method))


def bytes_per_pixel(study: BackwardGazingStudy) -> int:
    """Working memory of a block for each pixel, what is remembered included. [bytes]"""
    return 8 * (4 * 2 * len(study.method) * len(study.referential) + 45)


def observed(point: Point, given: Given) -> Observation:
    """Render, expose and reconstruct a point.

    Raises
    ------
    Failure
        Where no slopes can be found whatever the images.
    """
    layout, profile = _layout(point, given), _profile(point, given)
    known = scaled(profile, point.profile_error) if point.profile_error else profile
    mirror, keep = _mirror(given, point.pixel, point.erosion)
    wavy = None
    if point.waviness:
        wavy = waviness(mirror, 1e-3 * point.waviness, point.waviness_length, point.defect_seed)
    canting = point.canting_scale * np.array(given.canting)
    spheres = module_spheres(given.modules, point.true_focal_length, canting, given.pointing)
    images, true = image_set(layout, mirror, profile, spheres, wavy)
    shot: dict[str, Any] = {
        "noise": point.noise,
        "bits": point.bits,
        "seed": point.camera_seed,
    }
    share = np.ones((1, 1))
    if point.images == "camera":
        images, share = camera_views(
            layout, profile, given.modules, mirror, (point.true_focal_length, canting, given.pointing, wavy),
            gain_error=point.gains - 1.0, pixel=point.pixel, supersampling=point.supersampling, full_scale=FULL_SCALE,
            **shot,
        )  # fmt: skip
    else:
        images = expose(images * point.gains[:, np.newaxis], full_scale=FULL_SCALE, **shot)
    found = _found(layout, known, images, mirror, point, given)
    ideal_found, ideal_true = _ideal(point.ideal, given)
    net = found.slopes - ideal_found.slopes
    return Observation(mirror, keep, layout, known, images, true - ideal_true, found, net, share)


def bound(seen: Observation, point: Point, given: Given, method: str | None = None) -> Floats:
    """Cramer-Rao bound of both slopes, shape (2, N); NaN where fewer than 3 cameras are lit. [rad]

    Of the cameras that the reconstruction uses. It is that of methods that find a gain where the study asks for one;
    `method` A never does.
    """
    if point.deviation == 0.0:
        least = np.zeros_like(seen.true)
    else:
        place = seen.mirror.pixel_y, seen.mirror.pixel_z
        noise = point.deviation * seen.share / (1.0 + point.gain_error)  # brighter images tell more
        gain = given.fit_gain and method != "A"
        least = slope_bound(seen.layout, seen.profile, *place, seen.true, noise, gain, seen.found.lit)
    return np.where(seen.lit >= NEEDED, least, np.nan)


def _found(layout: Scene, profile: Profile, images: Floats, mirror: MirrorGrid, point: Point, given: Given) -> Found:
    place = mirror.pixel_y, mirror.pixel_z
    return reconstruct(
        layout, profile, images, place, given.methods, given.referentials, point.threshold, given.fit_gain, given.smooth
    )


@lru_cache(maxsize=2)
def _ideal(point: Point, given: Given) -> tuple[Found, Floats]:
    """What all methods find on the ideal heliostat, and its true slopes; arrays that nobody may change."""
    layout, profile = _layout(point, given), _profile(point, given)
    known = scaled(profile, point.profile_error) if point.profile_error else profile
    mirror, _ = _mirror(given, point.pixel, 0)
    spheres = module_spheres(given.modules, point.focal_length, np.zeros((len(given.sizes), 2)))
    images, true = image_set(layout, mirror, known, spheres)
    return _found(layout, known, images, mirror, point, given), true


@lru_cache(maxsize=4)
def _mirror(given: Given, pixel: float, erosion: int) -> tuple[MirrorGrid, NDArray[np.bool_]]:
    mirror = mirror_grid(given.modules, pixel)
    return mirror, eroded(mirror, erosion)


def _layout(point: Point, given: Given) -> Scene:
    cameras = camera_places(point.arrangement, point.radius) if given.positions is None else given.positions
    sun = math.radians(point.sun_azimuth), math.radians(point.sun_elevation)
    target = math.radians(point.target_azimuth), math.radians(point.target_elevation)
    try:
        return scene(
            sun, target, cameras, point.distance, point.focal_length, math.radians(point.tilt), math.radians(point.face)
        )
    except ValueError:
        raise Failure(NOT_IDENTIFIABLE) from None


def _profile(point: Point, given: Given) -> Profile:
    if point.sun_profile == "table":
        assert given.table is not None
        angle, brightness = given.table
        return tabulated(brightness, angle=angle)
    if point.sun_profile == "jose":
        return jose()
    try:
        table = noisy(jose(), point.profile_noise, point.nodes, point.profile_seed)
        graduated(table)  # noise may make a smoothed table useless where the table itself is not
        return table
    except ValueError:
        raise Failure(NO_PROFILE) from None
