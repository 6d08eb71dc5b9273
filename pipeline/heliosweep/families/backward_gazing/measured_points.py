"""Measured images at one point of a study's grid: put on the mirror, reconstructed, and what is known of the result.

The noise that uncertainties stand on is the one the study states, or what the images themselves say: the median of the
squared residuals that Levenberg-Marquardt leaves, in which edges and dirt count little.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.families.backward_gazing import measured_variables as named
from heliosweep.families.backward_gazing import points
from heliosweep.families.backward_gazing import variables as common
from heliosweep.families.backward_gazing.checks import camera_places, modules_of
from heliosweep.families.backward_gazing.measured_images import Views, views
from heliosweep.families.backward_gazing.measured_sun import Table, sun_table
from heliosweep.families.backward_gazing.reconstruct import Found, reconstruct
from heliosweep.families.backward_gazing.rows import Row
from heliosweep.kernels import rectification as bits
from heliosweep.kernels.gazing_geometry import REFERENTIALS, Scene, scene
from heliosweep.kernels.gazing_grid import MirrorGrid, Modules, eroded, maps, mirror_grid
from heliosweep.kernels.gazing_lm import SlopeFit
from heliosweep.kernels.gazing_modules import module_estimates
from heliosweep.kernels.gazing_search import merits
from heliosweep.kernels.pinholes import pinholes
from heliosweep.kernels.sun_profiles import Profile, jose, tabulated
from heliosweep.kernels.sun_tables import noisy, scaled

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.config import BackwardGazingStudy

__all__ = ["Given", "block", "given"]

Floats = NDArray[np.float64]

#: Medians of chi squared, by degrees of freedom from 1.
_CHI_SQUARED = (0.454936, 1.386294, 2.365974, 3.356694, 4.351460, 5.348121)
#: What keeps a camera's pixel from being used, and its bit of `quality`.
_REASONS = {
    bits.AT_EDGE: common.EDGE,
    bits.SATURATED: common.SATURATED,
    bits.NOT_A_NUMBER: named.NOT_A_NUMBER,
    bits.OUT_OF_FRAME: named.OUT_OF_FRAME,
    bits.AT_LIMB: common.OUTSIDE,
}


class Given(NamedTuple):
    """What the study says once for all points of its grid."""

    views: Views
    modules: Modules
    table: Table | None
    methods: tuple[str, ...]
    referentials: tuple[int, ...]
    fit_gain: bool
    smooth: bool
    """Whether LM ends at the smooth fit of a table."""


class Seen(NamedTuple):
    """Four images on the N pixels of the mirror."""

    images: Floats
    """NaN where a pixel cannot be used, shape (4, N). [1]"""
    flags: NDArray[np.int64]
    """Bits of `rectification`, shape (4, N)."""
    noise: Floats
    """Standard deviation for pixels of standard deviation 1, NaN where there is no value, shape (4, N)."""


def given(study: BackwardGazingStudy) -> Given:
    """What a study says once for all points of its grid. Raises StudyError."""
    seen = views(study)
    referentials = tuple(REFERENTIALS.index(name) for name in study.referential)
    table, _ = sun_table(study)
    fit_gain = study.fit_gain or seen.needs_gain
    return Given(seen, modules_of(study), table, study.method, referentials, fit_gain, study.smooth)


def block(*arrays: np.ndarray, row: Row, given: Given) -> np.ndarray:
    """Rows of a block, shape (1, swept dimensions, row)."""
    lead = np.broadcast_shapes(*(array.shape for array in arrays))
    every = [np.broadcast_to(array, lead).ravel() for array in arrays]
    out = np.empty((math.prod(lead), row.length))
    names = tuple(points.Point.__annotations__)
    for number, values in enumerate(zip(*every, strict=True)):
        said = {**dict(zip(names, values, strict=True)), **given.views.geometry}
        out[number] = row.packed(_solved(points.Point.of(said.values()), given))
    return out.reshape(1, *lead, row.length)


def _solved(point: points.Point, given: Given) -> dict[str, Any]:
    """Values of the variables at a point of the grid."""
    cameras = given.views.positions or camera_places(point.arrangement, point.radius)
    sun = math.radians(point.sun_azimuth), math.radians(point.sun_elevation)
    target = math.radians(point.target_azimuth), math.radians(point.target_elevation)
    tilt, face = math.radians(point.tilt), math.radians(point.face)
    try:
        layout = scene(sun, target, cameras, point.distance, point.focal_length, tilt, face)
    except ValueError:
        return {"scene_status": common.NOT_IDENTIFIABLE}
    grid = mirror_grid(given.modules, point.pixel)
    keep = eroded(grid, point.erosion)
    profile = _profile(point, given)
    try:
        seen = _on_mirror(layout, grid, point, given)
    except ValueError:  # a camera that looks straight up or down, or corners that no view of this scene has
        return {"scene_status": common.NOT_IDENTIFIABLE}
    place = grid.pixel_y, grid.pixel_z
    methods = given.methods if "LM" in given.methods else (*given.methods, "LM")  # uncertainties are LM's
    found = reconstruct(
        layout, profile, seen.images, place, methods, given.referentials, point.threshold, given.fit_gain, given.smooth
    )
    fit, asked = found.fit, len(given.methods)
    assert fit is not None
    found = found._replace(slopes=found.slopes[:asked], quality=found.quality[:asked])
    lit = (found.lit >> np.arange(4)[:, np.newaxis]) & 1 == 1
    noise = _pixel_noise(fit, seen, lit, keep, given)
    with np.errstate(all="ignore"):
        share = np.sqrt(np.nansum(np.where(lit, seen.noise**2, np.nan), axis=0) / lit.sum(axis=0))
    deviation = np.where(np.isfinite(fit.slopes), fit.deviation * noise * share, np.nan)
    values = _maps(found, fit, seen, lit, keep, grid, given, deviation)
    values |= _residuals(found, fit, layout, profile, seen, lit, grid, point, given)
    values |= _of_modules(found, deviation, lit, keep, grid, point, given)
    usable = np.isfinite(fit.slopes[0])
    at_edge = (seen.flags & (bits.AT_EDGE | bits.OUT_OF_FRAME)) > 0
    with np.errstate(all="ignore"):
        values |= {
            "lit_fraction": np.where(at_edge, False, lit).sum(axis=1) / (~at_edge).sum(axis=1),
            "saturated_fraction": np.mean(seen.flags & bits.SATURATED > 0, axis=1),
        }
    return values | {
        "white_level": given.views.white,
        "pixel_noise": noise,
        "gain": float(np.median(fit.gain[usable & keep])) if np.any(usable & keep) else math.nan,
        "scene_status": common.SEEN if np.any(usable) else common.NOT_SEEN,
        "incidence": math.degrees(layout.incidence),
    }


def _profile(point: points.Point, given: Given) -> Profile:
    if point.sun_profile == "table" and given.table is not None:
        angle, brightness = given.table
        profile = tabulated(brightness, angle=angle)
    elif point.sun_profile == "noisy":
        profile = noisy(jose(), point.profile_noise, point.nodes, point.profile_seed)
    else:
        profile = jose()
    return scaled(profile, point.profile_error) if point.profile_error else profile


def _on_mirror(layout: Scene, grid: MirrorGrid, point: points.Point, given: Given) -> Seen:
    """The images on the grid of the mirror."""
    shots = given.views
    if not shots.rectified:
        cameras = pinholes(
            layout, (shots.images.shape[1], shots.images.shape[2]), shots.focal, shots.centre, shots.roll
        )
        corners = shots.corners if np.any(np.isfinite(shots.corners)) else None
        return Seen(
            *bits.rectify(
                shots.images,
                cameras,
                point.focal_length,
                given.modules,
                grid,
                corners=corners,
                saturation=shots.saturation,
                threshold=point.threshold,
            )
        )
    images = shots.images[:, ::-1].reshape(4, -1)[:, grid.place]  # rows of the grid rise
    flags = bits.SATURATED * (images >= shots.saturation[:, np.newaxis]) + bits.NOT_A_NUMBER * ~np.isfinite(images)
    return Seen(np.where(flags == 0, images, np.nan), flags.astype(np.int64), np.where(flags == 0, 1.0, np.nan))


def _pixel_noise(fit: SlopeFit, seen: Seen, lit: NDArray[np.bool_], keep: NDArray[np.bool_], given: Given) -> float:
    """Standard deviation of a pixel of the images, stated or from residuals. [1]"""
    if math.isfinite(given.views.noise):
        return given.views.noise
    freedom = lit.sum(axis=0) - 2 - given.fit_gain
    use = keep & (freedom > 0) & np.isfinite(fit.merit) & (fit.flags == 0)
    if np.count_nonzero(use) < 20:
        return math.nan
    with np.errstate(all="ignore"):
        share = np.nansum(np.where(lit, seen.noise**2, np.nan), axis=0) / lit.sum(axis=0)
    ratio = fit.merit[use] / (share[use] * np.array(_CHI_SQUARED)[freedom[use] - 1])
    return math.sqrt(float(np.median(ratio)))


def _maps(
    found: Found,
    fit: SlopeFit,
    seen: Seen,
    lit: NDArray[np.bool_],
    keep: NDArray[np.bool_],
    grid: MirrorGrid,
    given: Given,
    deviation: Floats,
) -> dict[str, Any]:
    """Variables over the mirror; slopes in mrad."""
    reasons = np.zeros(len(keep), np.int64)
    for reason, bit in _REASONS.items():
        reasons |= bit * np.any(seen.flags & reason, axis=0)
    mask = np.where(~keep, 1, np.where(lit.sum(axis=0) < points.NEEDED, 2, 3))
    slopes = 1e3 * maps(grid, found.slopes)
    return {
        "image": maps(grid, seen.images),
        "slope_x": slopes[:, :, 0],
        "slope_y": slopes[:, :, 1],
        "slope_uncertainty_x": maps(grid, 1e3 * deviation[0]),
        "slope_uncertainty_y": maps(grid, 1e3 * deviation[1]),
        "mask": np.nan_to_num(maps(grid, mask)),
        "quality": np.nan_to_num(maps(grid, found.quality | reasons)),
    }


def _residuals(
    found: Found,
    fit: SlopeFit,
    layout: Scene,
    profile: Profile,
    seen: Seen,
    lit: NDArray[np.bool_],
    grid: MirrorGrid,
    point: points.Point,
    given: Given,
) -> dict[str, Any]:
    """Root mean squares of what all slopes leave of the brightness. [1]"""
    place = np.array([grid.pixel_y, grid.pixel_z])
    left = np.empty((*found.slopes.shape[:2], place.shape[1]))
    for index in np.ndindex(left.shape[:2]):
        if given.methods[index[0]] == "LM":
            left[index] = fit.merit
            continue
        slopes = np.ascontiguousarray(found.slopes[index])
        gain = given.fit_gain and given.methods[index[0]] != "A"
        left[index] = merits(False, layout, profile, seen.images, place, point.threshold, gain, slopes)
    with np.errstate(all="ignore"):
        rms = np.sqrt(left / lit.sum(axis=0))
    return {"residual_rms": maps(grid, np.where(np.isfinite(found.slopes[:, :, 0]), rms, np.nan))}


def _of_modules(
    found: Found,
    deviation: Floats,
    lit: NDArray[np.bool_],
    keep: NDArray[np.bool_],
    grid: MirrorGrid,
    point: points.Point,
    given: Given,
) -> dict[str, Any]:
    """Estimates of the modules and of the heliostat; angles in mrad."""
    methods, referentials, modules = *found.slopes.shape[:2], len(given.modules.size)
    shape = {name: tuple({"method": methods, "referential": referentials, "module": modules}[dim] for dim in dims)
             for name, (dims, _) in named.MEASURED.items() if name in common.ESTIMATES}  # fmt: skip
    values: dict[str, Any] = {name: np.full(size, np.nan) for name, size in shape.items()}
    for index in np.ndindex(methods, referentials):
        lost = found.quality[index[0]] & common.NOT_CONVERGED > 0  # these are shown, and count for nothing
        slopes = np.ascontiguousarray(np.where(lost, np.nan, found.slopes[index]))
        known = np.where(np.isfinite(deviation), deviation, 0.0)
        made = module_estimates(slopes, grid, given.modules, keep, point.focal_length, None, known)
        for axis, name in enumerate("xy"):
            values[f"canting_{name}"][index] = 1e3 * made.canting[axis]
            values[f"canting_{name}_standard_error"][index] = 1e3 * made.canting_error[axis]
            values[f"waviness_{name}"][index] = 1e3 * made.waviness[axis]
            values[f"pointing_{name}"][index] = 1e3 * made.pointing[axis]
            values[f"pointing_{name}_standard_error"][index] = 1e3 * made.pointing_error[axis]
        values["focal_length_estimate"][index] = made.focal_length
        values["focal_length_standard_error"][index] = made.focal_length_error
    inside = [keep & (grid.pixel_module == row) for row in range(modules)]
    with np.errstate(all="ignore"):
        values["usable_fraction"] = np.array(
            [[np.mean(np.isfinite(found.slopes[method, 0, 0, here])) for here in inside] for method in range(methods)]
        )
        values["lit_cameras"] = np.array([np.mean(lit[:, here]) for here in inside])
        for axis, name in enumerate("xy"):
            square = [deviation[axis, here][np.isfinite(deviation[axis, here])] ** 2 for here in inside]
            values[f"cramer_rao_bound_{name}"] = np.array(
                [1e3 * math.sqrt(one.mean()) if one.size else math.nan for one in square]
            )
    return values
