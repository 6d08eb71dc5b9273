"""One simulated heliostat: images, slopes by all methods, and what they say of its modules, over a region of a grid."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from heliosweep.config.profiles import SunProfile
from heliosweep.families.backward_gazing import variables as told
from heliosweep.families.backward_gazing.files import read_disc
from heliosweep.families.backward_gazing.points import (
    KEYS,
    Failure,
    Found,
    Point,
    Solver,
    by_axis,
    estimates,
    gathered,
    reconstruct,
    shape_remarks,
    sun_of,
    workload_of_points,
)
from heliosweep.families.backward_gazing.variables import CAMERAS, EDGE, NEEDED, NO_PROFILE, NOT_SEEN, SEEN
from heliosweep.grid.parameters import Parameters
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.gazing.geometry import MirrorGrid, Modules, Scene, eroded, maps, mirror_grid
from heliosweep.kernels.gazing.linear import slope_bound
from heliosweep.kernels.gazing.modules import module_statistics
from heliosweep.kernels.gazing.rectification import pinholes, rectify
from heliosweep.kernels.gazing.rendering import (
    FULL_SCALE,
    Heliostat,
    camera_set,
    expose,
    heliostat,
    image_set,
    levels,
    module_spheres,
    waviness,
)
from heliosweep.kernels.gazing.slopes import graduated
from heliosweep.kernels.sun.profiles import Profile
from heliosweep.kernels.sun.tables import normal_draws

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.study import BackwardGazingStudy
    from heliosweep.grid.plan import Workload
    from heliosweep.grid.regions import Region

Pairs = tuple[tuple[float, float], ...]

#: Stream of random numbers of the cameras' gains; `rendering` has others.
_GAIN_STREAM = 4
#: Pixels of a camera around the picture of the heliostat.
_ROOM = 4
#: What relative errors of modules are relative to where no canting is entered. [mrad]
NOT_CANTED = 1.0
#: Pixels of mirrors whose results are remembered.
MOST_REMEMBERED = 100_000


class Given(NamedTuple):
    """The same for all points of a study; hashable, as what points share is remembered by it."""

    centres: Pairs
    sizes: Pairs
    canting: Pairs
    """Of every module, [rad]."""
    curvature: tuple[tuple[int, float, float, float], ...]
    """Row of each module with a curvature of its own, and of that yy, yz and zz. [1/m]"""
    pointing: tuple[float, float]
    """[rad]"""
    positions: Pairs | None
    """Cameras in the target's plane instead of an arrangement. [m]"""
    table: SunProfile | None
    solver: Solver

    @property
    def modules(self) -> Modules:
        """The modules as kernels take them."""
        return Modules(np.array(self.centres), np.array(self.sizes))


class Observation(NamedTuple):
    """A point as it was seen and reconstructed."""

    modules: Modules
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
    ideal: Floats
    """Slopes found of the ideal heliostat, shape (M, T, 2, N). [rad]"""
    share: Floats
    """Standard deviation of the images' values for camera pixels of standard deviation 1, (4, N) or (1, 1). [1]"""

    @property
    def net(self) -> Floats:
        """Slopes found, less those found of the ideal heliostat, shape (M, T, 2, N). [rad]"""
        return self.found.slopes - self.ideal

    @property
    def lit(self) -> NDArray[np.uint8]:
        """Number of lit cameras, shape (N,)."""
        return np.bitwise_count(self.found.lit)

    def over_modules(self, values: Floats) -> tuple[Floats, Floats, NDArray[np.int64]]:
        """Mean, root mean square and number of values (..., N) over the eroded modules; each (..., modules)."""
        lead, count = values.shape[:-1], len(self.modules.size)
        flat = np.ascontiguousarray(values, np.float64).reshape(-1, values.shape[-1])
        mean, rms, number = module_statistics(flat, self.mirror.pixel_module, self.keep, count)
        return mean.reshape(*lead, count), rms.reshape(*lead, count), number.reshape(*lead, count)


def workload(study: BackwardGazingStudy) -> Workload:
    """Sizes and cost, for the plan."""
    sizes = told.sizes_of(study, study.output.maps)
    return workload_of_points(study, sizes, whole=told.seed_dims(study))


def coordinates(study: BackwardGazingStudy) -> xr.Dataset:
    """Coordinates of the whole result, in memory."""
    return told.coordinates(study, study.output.maps, told.OF_SIMULATIONS)


def inputs(study: BackwardGazingStudy) -> Given:
    """Heliostat, cameras, methods and table of the sun, the same for all points. Raises StudyError."""
    modules = study.heliostat.rectangles
    canting = np.zeros((len(modules.size), 2))
    for key, pair in study.defects.canting.items():
        canting[int(key) - 1] = pair
    name = study.sun.profile
    table = None if name is None else read_disc(study.resolve(name), name)
    curved = []
    for key, (first, second, axis) in (study.defects.curvature or {}).items():
        c, s = math.cos(math.radians(axis)), math.sin(math.radians(axis))
        one, other = 0.5 / first, 0.5 / second
        curved.append((int(key) - 1, c * c * one + s * s * other, c * s * (one - other), s * s * one + c * c * other))
    centres, sizes, turns, (pointing,) = (
        tuple(map(tuple, values.tolist()))
        for values in (modules.centre, modules.size, 1e-3 * canting, 1e-3 * np.array([study.defects.pointing]))
    )
    return Given(centres, sizes, turns, tuple(curved), pointing, study.cameras.positions, table, Solver.of(study))


def compute(study: BackwardGazingStudy, given: Given, region: Region) -> xr.Dataset:
    """Values of every point of a region.

    The images of a point are rendered once and shared by its methods and referentials; of small mirrors the last few
    points are remembered, as those that differ by a seed that has no part in them are the same.
    """
    parameters = Parameters(study, region)
    made = {name: one for name, one in told.variables(study).items() if not one.finished}
    area = float(np.prod(given.sizes, axis=1).sum())

    def points() -> Iterator[tuple[tuple[int, ...], dict[str, Any]]]:
        for index, values in parameters.points(*KEYS):
            point = Point.of(values)
            result = _remembered if area / point.pixel**2 <= MOST_REMEMBERED else of_point
            yield index, result(point, given, study.output.maps, study.output.raw_slopes)

    return gathered(made, {**parameters.sizes, **told.sizes_of(study, study.output.maps)}, points())


def finish(study: BackwardGazingStudy, given: Given, region: Region, computed: xr.Dataset) -> xr.Dataset:
    """Median and percentiles of the relative errors over the seeds, NaN left out; linear between values."""
    seeds = told.seed_dims(study)
    made: dict[str, Any] = {}
    for name in ("relative_error_x", "relative_error_y"):
        array = computed[name].transpose(..., *seeds)
        dims = array.dims[: array.ndim - len(seeds)]
        ordered = np.sort(array.to_numpy().reshape(*array.shape[: len(dims)], -1), axis=-1)  # NaN last
        last = np.maximum(np.count_nonzero(np.isfinite(ordered), axis=-1) - 1, 0)
        for ending, (percent, _) in told.PERCENTILES.items():
            place = 0.01 * percent * last
            below = np.floor(place).astype(np.int64)
            low, high = (
                np.take_along_axis(ordered, at[..., np.newaxis], -1)[..., 0]
                for at in (below, np.minimum(below + 1, last))
            )
            made[f"{name}_{ending}"] = dims, low + (place - below) * (high - low)
    return xr.Dataset(made)


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Heliostats without slopes, modules that the cameras do not see whole."""
    status = result["scene_status"].to_numpy()
    if unseen := int(np.count_nonzero(status == NOT_SEEN)):
        which = "the heliostat" if status.size == 1 else f"{unseen:,} of {status.size:,} heliostats"
        yield (
            f"no slopes of {which}: nowhere do three cameras see the reflected sun, and all of its pixels are masked; "
            "is it aimed at the target?"
        )
    for code, count in zip(*np.unique(status, return_counts=True), strict=True):
        if code not in (SEEN, NOT_SEEN):
            words = told.STATUS[int(code)].replace("_", " ")
            yield f"no slopes at {count:,} of {status.size:,} points: {words} (scene_status {code})"
    usable = result["usable_fraction"].where(result["scene_status"] == SEEN)
    partly = usable.where(usable < 1.0)
    if bool(partly.notnull().any()):
        least, at = float(partly.min()), int(partly.notnull().sum())
        yield (
            f"{at:,} of {int(usable.notnull().sum()):,} modules, counted for each method, are not seen whole by three "
            f"cameras; the least has slopes for {math.floor(1000.0 * least) / 10.0:g} % of its pixels"
        )
    yield from shape_remarks(result)


def of_point(point: Point, given: Given, with_maps: bool, raw: bool) -> dict[str, Any]:
    """Values of the variables of a point, by name; ``scene_status`` alone where no slopes can be found."""
    try:
        seen = observed(point, given)
    except Failure as failure:
        return {"scene_status": failure.status}
    least = bound(seen, point, given)
    mean, rms, _ = seen.over_modules(1e3 * (seen.net - seen.true))
    entered = 1e3 * np.hypot(*np.transpose(point.canting_scale * np.array(given.canting)))
    relative = 100.0 * np.abs(mean) / np.where(entered > 0.0, entered, NOT_CANTED)
    values: dict[str, Any] = (
        by_axis("slope_bias_%", mean) | by_axis("slope_rms_%", rms) | by_axis("relative_error_%", relative)
    )
    values |= _sight(seen, least)
    deviations = []
    for method in given.solver.methods:
        own = bound(seen, point, given, "A") if given.solver.fit_gain and method == "A" else least
        deviations.append(np.nan_to_num(own) if np.any(own > 0.0) else None)
    values |= estimates(seen.net, deviations, seen.mirror, seen.modules, seen.keep, point.focal_length)
    values["scene_status"] = SEEN if np.any(seen.keep & np.isfinite(seen.net[:, 0, 0]).any(axis=0)) else NOT_SEEN
    values["incidence"] = float(np.degrees(1.0)) * seen.layout.incidence
    values["evaluations"] = seen.found.evaluations
    return values | (_maps(seen, point, given, raw) if with_maps else {})


_remembered = lru_cache(maxsize=4)(of_point)


def _sight(seen: Observation, least: Floats) -> dict[str, Any]:
    """Usable pixels, lit cameras and the bound. [1], [mrad]"""
    kept = np.bincount(seen.mirror.pixel_module[seen.keep], minlength=len(seen.modules.size))
    _, _, usable = seen.over_modules(seen.net[:, 0, 0])
    lit, _, _ = seen.over_modules(seen.lit / CAMERAS)
    _, square, _ = seen.over_modules(1e3 * least)
    with np.errstate(invalid="ignore"):
        made = {"usable_fraction": usable / kept, "lit_cameras": lit}
    return made | by_axis("cramer_rao_bound_%", square, 0)


def _maps(seen: Observation, point: Point, given: Given, raw: bool) -> dict[str, Any]:
    """Images, slopes and what is known of each pixel, on the grid. [1], [mrad]"""
    mirror = seen.mirror
    mask = np.where(seen.keep, np.where(seen.lit >= NEEDED, 3, 2), 1)
    found = {"raw_slope_%": seen.found.slopes, "raw_ideal_slope_%": seen.ideal} if raw else {}
    return {
        **{
            end: one for name, all_of in found.items() for end, one in by_axis(name, maps(mirror, 1e3 * all_of)).items()
        },
        **sun_of(point.profile(given.table)),
        "image": maps(mirror, seen.images),
        **by_axis("slope_%", maps(mirror, 1e3 * seen.net)),
        **by_axis("true_slope_%", maps(mirror, 1e3 * seen.true), 0),
        "mask": np.nan_to_num(maps(mirror, mask)),
        "quality": np.nan_to_num(maps(mirror, seen.found.quality | EDGE * ~seen.keep)),
    }


def observed(point: Point, given: Given) -> Observation:
    """Render, expose and reconstruct a point. Raises Failure where no slopes can be found whatever the images."""
    layout, profile = point.layout(given.positions), _profile(point, given)
    known = point.known(profile)
    mirror, keep = _mirror(given, point.pixel, point.erosion)
    wavy = None
    if point.waviness:
        wavy = waviness(mirror, 1e-3 * point.waviness, point.waviness_length, point.defect_seed)
    for row, yy, yz, zz in given.curvature:  # slopes about the module's centre, against its sphere's
        here = mirror.pixel_module == row
        y, z = mirror.pixel_y[here] - given.centres[row][0], mirror.pixel_z[here] - given.centres[row][1]
        sphere = 0.5 / point.true_focal_length
        wavy = np.zeros((2, len(mirror.place))) if wavy is None else wavy
        wavy[:, here] += (sphere - yy) * y - yz * z, (sphere - zz) * z - yz * y
    canting = point.canting_scale * np.array(given.canting)
    spheres = module_spheres(given.modules, point.true_focal_length, canting, given.pointing)
    images, true = image_set(layout, mirror, profile, spheres, wavy)
    own = 1.0 + point.gain_noise * normal_draws(point.camera_seed, _GAIN_STREAM, 4)  # by the seed and number alone
    gains = (1.0 + point.gain_error) * np.maximum(own, 0.0)
    share = np.ones((1, 1))
    if point.images == "camera":
        truth = heliostat(
            given.modules, point.true_focal_length, canting, given.pointing, None if wavy is None else (mirror, wavy)
        )
        images, share = _camera_views(layout, profile, given.modules, mirror, truth, point, gains - 1.0)
    else:
        images = expose(images * gains[:, np.newaxis], point.noise, point.bits, point.camera_seed)
    found = reconstruct(layout, known, images, mirror, point.threshold, given.solver)
    ideal_found, ideal_true = _ideal(point.ideal, given)
    ideal = ideal_found.slopes
    return Observation(given.modules, mirror, keep, layout, known, images, true - ideal_true, found, ideal, share)


def bound(seen: Observation, point: Point, given: Given, method: str | None = None) -> Floats:
    """Cramer-Rao bound of both slopes, shape (2, N); NaN where fewer than 3 cameras are lit. [rad]

    Of the cameras that the reconstruction uses. It is that of methods that find a gain where the study asks for one;
    `method` A never does.
    """
    step = FULL_SCALE / (2.0**point.bits - 1.0) if point.bits else 0.0
    deviation = math.hypot(point.noise, step / math.sqrt(12.0))  # noise of a pixel, and rounding to levels
    if deviation == 0.0:
        least = np.zeros_like(seen.true)
    else:
        place = seen.mirror.pixel_y, seen.mirror.pixel_z
        noise = deviation * seen.share / (1.0 + point.gain_error)  # brighter images tell more
        gain = given.solver.fit_gain and method != "A"
        least = slope_bound(seen.layout, seen.profile, *place, seen.true, noise, gain, seen.found.lit)
    return np.where(seen.lit >= NEEDED, least, np.nan)


@lru_cache(maxsize=2)
def _ideal(point: Point, given: Given) -> tuple[Found, Floats]:
    """Slopes that all methods find on the ideal heliostat, and its true ones; arrays that nobody may change."""
    layout, known = point.layout(given.positions), point.known(_profile(point, given))
    mirror, _ = _mirror(given, point.pixel, 0)
    spheres = module_spheres(given.modules, point.focal_length, np.zeros((len(given.sizes), 2)))
    images, true = image_set(layout, mirror, known, spheres)
    return reconstruct(layout, known, images, mirror, point.threshold, given.solver), true


@lru_cache(maxsize=4)
def _mirror(given: Given, pixel: float, erosion: int) -> tuple[MirrorGrid, NDArray[np.bool_]]:
    mirror = mirror_grid(given.modules, pixel)
    return mirror, eroded(mirror, erosion)


def _profile(point: Point, given: Given) -> Profile:
    if point.sun_profile != "noisy":
        return point.profile(given.table)
    try:
        table = point.profile(None)
        graduated(table)  # noise may make a smoothed table useless where the table itself is not
        return table
    except ValueError:
        raise Failure(NO_PROFILE) from None


def _camera_views(
    layout: Scene,
    profile: Profile,
    modules: Modules,
    mirror: MirrorGrid,
    truth: Heliostat,
    point: Point,
    errors: Floats,
) -> tuple[Floats, Floats]:
    """Images of pinhole cameras whose pixels are as large as those of the mirror, put back on its grid.

    The images, NaN within two pixels of a module's edge, and the standard deviation of a value for camera
    pixels of standard deviation 1; both of shape (4, N). [1]
    """
    reach = np.abs(modules.centre) + 0.5 * modules.size
    # A tilted mirror is seen foreshortened, and turned: its larger side fits in any direction.
    side = max(2 * math.ceil(float(side) / point.pixel) + 2 * _ROOM for side in reach.max(axis=0))
    shape = side, side
    cameras = pinholes(layout, shape, layout.distance / point.pixel)
    pictures = camera_set(layout, cameras, shape, profile, truth, point.supersampling)
    white = (2.0**point.bits - 1.0) / FULL_SCALE if point.bits else 1.0
    taken = levels(pictures, white, noise=point.noise, gain_error=errors, bits=point.bits, seed=point.camera_seed)
    images, _, share = rectify(taken / white, cameras, layout.focal_length, modules, mirror)
    return images, share
