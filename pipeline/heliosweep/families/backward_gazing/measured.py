"""Slopes of a heliostat from four images of it, with masks, flags, uncertainties and estimates of its modules.

Images are put on the grid of the mirror first (`gazing.rectification`), and then treated as simulated ones are. The
noise that uncertainties stand on is the one the study states, or what the images themselves say: the median of the
squared residuals that Levenberg-Marquardt leaves, in which edges and dirt count little.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from hashlib import sha256
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from heliosweep.families.backward_gazing import variables as told
from heliosweep.families.backward_gazing.points import (
    KEYS,
    Failure,
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
from heliosweep.families.backward_gazing.registration import Registered, register
from heliosweep.families.backward_gazing.shots import (
    ANY_FOCAL,
    BRIGHTEST,
    GEOMETRY,
    SUN_IMAGE,
    Shots,
    read_shots,
    read_sun,
)
from heliosweep.families.backward_gazing.variables import NEEDED, NOT_CONVERGED, NOT_IDENTIFIABLE, NOT_SEEN, SEEN
from heliosweep.grid.parameters import Parameters, coordinate_attributes
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.gazing import rectification as why
from heliosweep.kernels.gazing.geometry import MirrorGrid, Modules, Scene, eroded, maps, mirror_grid
from heliosweep.kernels.gazing.slopes import SlopeFit, merits

if TYPE_CHECKING:
    from heliosweep.config.profiles import SunProfile
    from heliosweep.families.backward_gazing.study import BackwardGazingStudy
    from heliosweep.grid.plan import Workload
    from heliosweep.grid.regions import Region

#: Fewest pixels that tell the noise of the images.
LEAST_PIXELS = 20
#: Medians of chi squared, by degrees of freedom from 1.
_CHI_SQUARED = (0.454936, 1.386294, 2.365974, 3.356694, 4.351460, 5.348121)
#: What keeps a camera's pixel from being used, and its bit of `quality`.
_REASONS = {
    why.AT_EDGE: told.EDGE,
    why.SATURATED: told.SATURATED,
    why.NOT_A_NUMBER: told.NOT_A_NUMBER,
    why.OUT_OF_FRAME: told.OUT_OF_FRAME,
    why.AT_LIMB: told.OUTSIDE,
}
#: Parts below which a camera counts as dark and a module as hardly seen; residuals over the noise stated, of which they
#: are about 0.6 where all is right.
DARK, HARDLY, MUCH = 0.05, 0.5, 1.0


class Inputs(NamedTuple):
    """Images, sun and methods, the same for all points of a study."""

    shots: Shots
    modules: Modules
    table: SunProfile | None
    methods: int
    """Methods that the study asks for."""
    solver: Solver
    """With LM in any case, whose the uncertainties are."""


class Seen(NamedTuple):
    """Four images on the N pixels of the mirror."""

    images: Floats
    """NaN where a pixel cannot be used, shape (4, N). [1]"""
    flags: NDArray[np.int64]
    """Bits of `rectification`, shape (4, N)."""
    noise: Floats
    """Standard deviation for pixels of standard deviation 1, NaN where there is no value, shape (4, N)."""


def workload(study: BackwardGazingStudy) -> Workload:
    """Sizes and cost, for the plan. Raises StudyError where the images cannot be read."""
    return workload_of_points(study, told.sizes_of(study, True), 2 * read_shots(study).images.nbytes)


def coordinates(study: BackwardGazingStudy) -> xr.Dataset:
    """Coordinates of the whole result, in memory, those that metadata give too."""
    found, shots, said = told.coordinates(study, True, told.LABELS), read_shots(study), {}
    for key, name in GEOMETRY.values():
        if name in shots.geometry:
            block, field = key.split(".")
            attrs = coordinate_attributes(type(getattr(study, block)).parameter(field), key)
            attrs.pop("comment", None)  # it is about the key
            said[name] = xr.DataArray(shots.geometry[name], attrs=attrs)
    for name in ("sun_azimuth", "target_azimuth"):
        if name in said:
            world = name.replace("_", "_world_")
            said[world] = told.label(world, (180.0 - shots.geometry[name]) % 360.0)
    corners = np.isfinite(shots.corners).any()
    return found.assign_coords(said).assign_attrs(
        image_files=", ".join(PurePath(entry.file).name for entry in study.images or ()),
        white_levels=" ".join(shots.white_from),
        pixel_noise_from="residuals" if np.isnan(shots.noise) else "study",
        gain_of_each_pixel="fitted" if study.fit_gain or shots.needs_gain else "1",
        rectification="none"
        if shots.rectified
        else "registered"
        if shots.register.any()
        else "corners"
        if corners
        else "pinhole",
    )


def inputs(study: BackwardGazingStudy) -> Inputs:
    """Images and sun of the study. Raises StudyError."""
    shots, (table, _), solver = read_shots(study), read_sun(study), Solver.of(study)
    methods = solver.methods if "LM" in solver.methods else (*solver.methods, "LM")
    solver = solver._replace(methods=methods, fit_gain=study.fit_gain or shots.needs_gain)
    return Inputs(shots, study.heliostat.rectangles, table, len(study.method), solver)


def compute(study: BackwardGazingStudy, inputs: Inputs, region: Region) -> xr.Dataset:
    """Values of every point of a region."""
    parameters = Parameters(study, region)

    def points() -> Iterator[tuple[tuple[int, ...], dict[str, Any]]]:
        for index, values in parameters.points(*KEYS):
            try:
                yield index, _solved(Point.of(values, **inputs.shots.geometry), inputs)
            except Failure as failure:
                yield index, {"scene_status": failure.status}

    return gathered(told.variables(study), {**parameters.sizes, **told.sizes_of(study, True)}, points())


def _solved(point: Point, inputs: Inputs) -> dict[str, Any]:
    """Values of the variables at a point of the grid. Raises Failure."""
    solver, shots = inputs.solver, inputs.shots
    layout, profile = point.layout(shots.positions), point.known(point.profile(inputs.table))
    mirror = mirror_grid(inputs.modules, point.pixel)
    keep, seen = eroded(mirror, point.erosion), _on_mirror(layout, mirror, point, inputs)
    found = reconstruct(layout, profile, seen.images, mirror, point.threshold, solver)
    fit, slopes, quality = found.fit, found.slopes[: inputs.methods], found.quality[: inputs.methods]
    assert fit is not None
    lit = (found.lit >> np.arange(4)[:, np.newaxis]) & 1 == 1
    usable, cameras = np.isfinite(fit.slopes[0]), lit.sum(axis=0)

    def residual(method: str, slopes: Floats) -> Floats:
        if method == "LM":
            return fit.merit
        place, gain = np.array([mirror.pixel_y, mirror.pixel_z]), solver.fit_gain and method != "A"
        return merits(False, layout, profile, seen.images, place, point.threshold, gain, np.ascontiguousarray(slopes))

    with np.errstate(all="ignore"):
        share = np.nansum(np.where(lit, seen.noise**2, np.nan), axis=0) / cameras
        noise = shots.noise if math.isfinite(shots.noise) else _noise(fit, share, cameras - 2 - solver.fit_gain, keep)
        deviation = np.where(np.isfinite(fit.slopes), fit.deviation * noise * np.sqrt(share), np.nan)
        left = np.array([
            [residual(method, one) for one in frames] for method, frames in zip(solver.methods, slopes, strict=False)
        ])  # fmt: skip
        rms = np.where(np.isfinite(slopes[:, :, 0]), np.sqrt(left / cameras), np.nan)
        values = _of_modules(slopes, quality, deviation, lit, keep, mirror, point, inputs)
        at_edge = (seen.flags & (why.AT_EDGE | why.OUT_OF_FRAME)) > 0
        values["lit_fraction"] = np.where(at_edge, False, lit).sum(axis=1) / (~at_edge).sum(axis=1)
    reasons = np.zeros(len(keep), np.int64)
    for reason, bit in _REASONS.items():
        reasons |= bit * np.any(seen.flags & reason, axis=0)
    return values | {
        **sun_of(point.profile(inputs.table)),
        "evaluations": found.evaluations[: inputs.methods],
        **by_axis("slope_%", maps(mirror, 1e3 * slopes)),
        **by_axis("slope_uncertainty_%", maps(mirror, 1e3 * deviation), 0),
        "image": maps(mirror, seen.images),
        "residual_rms": maps(mirror, rms),
        "mask": np.nan_to_num(maps(mirror, np.where(~keep, 1, np.where(cameras < NEEDED, 2, 3)))),
        "quality": np.nan_to_num(maps(mirror, quality | reasons)),
        **registered(layout, point.focal_length, shots, inputs.modules)[1],
        "saturated_fraction": np.mean(seen.flags & why.SATURATED > 0, axis=1),
        "white_level": shots.white,
        "pixel_noise": noise,
        "gain": float(np.median(fit.gain[usable & keep])) if np.any(usable & keep) else math.nan,
        "scene_status": SEEN if np.any(usable) else NOT_SEEN,
        "incidence": math.degrees(layout.incidence),
    }


#: What is known of images: they are registered once for all points that see them alike.
_KNOWN: dict[bytes, Registered] = {}


def registered(layout: Scene, focal_length: float, shots: Shots, modules: Modules) -> tuple[Floats, dict[str, Floats]]:
    """Corners of the heliostat in all images, NaN where pinholes tell them, shape (4, 4, 2), and variables about them.

    Raises ValueError, whose first argument is the number of the image from 0, where it is found in none.
    """
    corners, found = shots.corners.copy(), {name: np.full(4, math.nan) for name in told.REGISTERED}
    rows, columns = shots.images.shape[1:]
    upright = why.pinholes(layout, (rows, columns), ANY_FOCAL) if np.any(shots.register) else None
    for number in np.flatnonzero(shots.register).tolist():
        image = np.ascontiguousarray(shots.images[number])
        digest = sha256(image.tobytes() + layout.eyes.tobytes() + modules.centre.tobytes() + modules.size.tobytes())
        digest.update(np.array([number, focal_length]).tobytes() + layout.mirror_axes.tobytes())
        if (key := digest.digest()) not in _KNOWN:
            if len(_KNOWN) >= 64:
                _KNOWN.clear()

            def see(points: Floats, number: int = number) -> Floats:
                assert upright is not None
                return why.places_of(upright, focal_length, points[:, 0], points[:, 1])[number].T

            try:
                _KNOWN[key] = register(image, see, modules)
            except ValueError as error:
                raise ValueError(number, str(error)) from None
        one = _KNOWN[key]
        corners[number] = one.corners
        values = (-math.degrees(one.turn), *one.centre, ANY_FOCAL * one.scale, one.residual)
        for name, value in zip(found, values, strict=True):
            found[name][number] = value
    return corners, found


def _on_mirror(layout: Scene, mirror: MirrorGrid, point: Point, inputs: Inputs) -> Seen:
    """The images on the grid of the mirror. Raises Failure."""
    shots = inputs.shots
    if shots.rectified:
        images = shots.images[:, ::-1].reshape(4, -1)[:, mirror.place]  # rows of the grid rise
        flags = why.SATURATED * (images >= shots.saturation[:, np.newaxis]) + why.NOT_A_NUMBER * ~np.isfinite(images)
        return Seen(np.where(flags == 0, images, np.nan), flags.astype(np.int64), np.where(flags == 0, 1.0, np.nan))
    rows, columns = shots.images.shape[1:]
    try:
        cameras = why.pinholes(layout, (rows, columns), shots.focal, shots.centre, shots.roll)
        corners, _ = registered(layout, point.focal_length, inputs.shots, inputs.modules)
        return Seen(
            *why.rectify(
                shots.images,
                cameras,
                point.focal_length,
                inputs.modules,
                mirror,
                corners=corners if np.any(np.isfinite(corners)) else None,
                saturation=shots.saturation,
                threshold=point.threshold,
            )
        )
    except ValueError:  # a camera that looks straight up or down, or corners that no view of this scene has
        raise Failure(NOT_IDENTIFIABLE) from None


def _noise(fit: SlopeFit, share: Floats, freedom: NDArray[np.int64], keep: NDArray[np.bool_]) -> float:
    """Standard deviation of a pixel of the images, from residuals. [1]"""
    use = keep & (freedom > 0) & np.isfinite(fit.merit) & (fit.flags == 0)
    if np.count_nonzero(use) < LEAST_PIXELS:
        return math.nan
    ratio = fit.merit[use] / (share[use] * np.array(_CHI_SQUARED)[freedom[use] - 1])
    return math.sqrt(float(np.median(ratio)))


def _of_modules(
    slopes: Floats,
    quality: NDArray[np.int64],
    deviation: Floats,
    lit: NDArray[np.bool_],
    keep: NDArray[np.bool_],
    mirror: MirrorGrid,
    point: Point,
    inputs: Inputs,
) -> dict[str, Any]:
    """Estimates of the modules and of the heliostat, and how well the modules are seen; angles in mrad."""
    lost = quality & NOT_CONVERGED > 0  # these are shown, and count for nothing
    counted = np.where(lost[:, np.newaxis, np.newaxis], np.nan, slopes)
    known = [np.where(np.isfinite(deviation), deviation, 0.0)] * len(slopes)
    values: dict[str, Any] = dict(estimates(counted, known, mirror, inputs.modules, keep, point.focal_length))
    inside = [keep & (mirror.pixel_module == row) for row in range(len(inputs.modules.size))]
    usable = np.isfinite(slopes[:, 0, 0])
    values["usable_fraction"] = np.array([[np.mean(one[here]) for here in inside] for one in usable])
    values["lit_cameras"] = np.array([np.mean(lit[:, here]) for here in inside])
    for end, one in zip("xy", deviation, strict=True):
        squares = [one[here & np.isfinite(one)] ** 2 for here in inside]
        values[f"cramer_rao_bound_{end}"] = [1e3 * math.sqrt(few.mean()) if few.size else math.nan for few in squares]
    return values


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Saturated and dark images, masked modules, levels that were guessed, residuals that are too large.

    Parameters
    ----------
    result : xarray.Dataset
        Of mode measured.
    """
    status = result["scene_status"].to_numpy()
    if unseen := int(np.count_nonzero(status == NOT_SEEN)):
        which = "" if status.size == 1 else f" at {unseen:,} of {status.size:,} points"
        yield (
            f"no slopes{which}: nowhere do three cameras see the reflected sun, and all pixels are masked; is the "
            "heliostat aimed at the target, and are geometry and levels right?"
        )
    if failed := int(np.count_nonzero((status != SEEN) & (status != NOT_SEEN))):
        yield f"no slopes at {failed:,} of {status.size:,} points: the cameras are in one line (scene_status)"
    files = [name for name in str(result.attrs.get("image_files", "")).split(", ") if name]
    yield from _of_cameras(result, files)
    yield from _of_levels(result)
    usable = result["usable_fraction"].where(result["scene_status"] == SEEN)
    least = usable.min([dim for dim in usable.dims if dim != "module"]).to_numpy()
    few = np.flatnonzero(least < HARDLY)
    if few.size:
        names = ", ".join(f"{result['module'].to_numpy()[row]} ({100 * least[row]:.0f} %)" for row in few)
        yield f"less than half of a module has slopes: module {names}; its estimates rest on few pixels"
    found = result["slope_x"].notnull().any(dim="referential")
    flagged = ((result["quality"] & NOT_CONVERGED) > 0) & found
    for method in result["slope_method"].to_numpy():
        lost, known = (int(one.sel(slope_method=method).sum()) for one in (flagged, found))
        part = lost / max(1, known)
        if part > 0.01:
            yield f"{100 * part:.3g} % of the slopes of {method} did not converge (quality {NOT_CONVERGED})"
    yield from shape_remarks(result)


def _of_cameras(result: xr.Dataset, files: list[str]) -> Iterator[str]:
    """Images that are saturated or dark where they show the mirror."""
    for row, number in enumerate(result["camera"].to_numpy()):
        name = f"image {number}" + (f" ({files[row]})" if row < len(files) else "")
        saturated = float(result["saturated_fraction"].isel(camera=row).max())
        lit = float(result["lit_fraction"].isel(camera=row).min())
        if saturated > 0.0:
            yield f"{name}: {100 * saturated:.3g} % of the mirror is saturated and not used; expose it shorter"
        if lit < DARK:
            yield f"{name} is dark: it sees the sun in {100 * lit:.3g} % of the mirror; the others must do"
        elif lit < HARDLY:
            yield f"{name} sees the sun in only {100 * lit:.3g} % of the mirror"


def _of_levels(result: xr.Dataset) -> Iterator[str]:
    """Levels of white that were not measured through the mirror, and what the residuals say."""
    source = set(str(result.attrs.get("white_levels", "")).split())
    how = {
        SUN_IMAGE: "is that of the sun's image, without the mirror",
        BRIGHTEST: "is unknown, and the brightest pixels of all images stand for it",
    }
    for origin, what in how.items():
        if origin in source:
            yield (
                f"the level of white {what}: a gain is fitted at each pixel for O1, O2 and LM, but A has none, and one "
                "camera's level against another's is not known: at the paper's geometry 1 % of it shifts all slopes "
                "by 0.06 mrad, like a pointing error; give 'white', or WHITE in the metadata of each image"
            )
    gain = result["gain"].to_numpy()
    if np.any(np.abs(gain[np.isfinite(gain)] - 1.0) > 0.05) and not source & set(how):
        yield f"the gain that is fitted is {np.nanmedian(gain):.3f}: is the level of white right?"
    stated = result.attrs.get("pixel_noise_from")
    residual = float(result["residual_rms"].isel(slope_method=-1).median())
    noise = float(result["pixel_noise"].median())
    if stated == "study" and residual > MUCH * noise:
        yield (
            f"the residuals, {residual:.2g} of the sun's centre, are well above the noise that the study states, "
            f"{noise:.2g}: the sun's profile, the geometry or a camera's gain are off, and uncertainties too small"
        )
