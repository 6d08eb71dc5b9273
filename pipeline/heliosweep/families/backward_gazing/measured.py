"""Slopes of a heliostat from four images of it, with masks, flags, uncertainties and estimates of its modules.

Images are put on the grid of the mirror first (`gazing.rectification`), and then treated as simulated ones. The noise
behind the uncertainties is stated in the study, or estimated from the images: the median of the squared residuals of
Levenberg-Marquardt, which edges and dirt affect little.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache, partial
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from heliosweep.config.tables import SunProfile
from heliosweep.families.backward_gazing import variables as names
from heliosweep.families.backward_gazing.common import (
    Failure,
    assumed,
    by_axis,
    estimates,
    profile_of,
    scene_of,
    shape_remarks,
    sun_of,
    values_of,
)
from heliosweep.families.backward_gazing.images import ANY_FOCAL, BRIGHTEST, SUN_IMAGE, Shots, read_shots, read_sun
from heliosweep.families.backward_gazing.registration import register
from heliosweep.families.backward_gazing.variables import (
    CAMERAS,
    NEEDED,
    NOT_CONVERGED,
    NOT_IDENTIFIABLE,
    NOT_SEEN,
    SEEN,
)
from heliosweep.families.family import Computation
from heliosweep.gazing import find_slopes
from heliosweep.grid.parameters import coordinate_attributes, coordinate_name
from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.gazing import images as why
from heliosweep.kernels.gazing.geometry import REFERENTIALS, MirrorGrid, Modules, Scene, eroded, maps, mirror_grid
from heliosweep.kernels.gazing.modules import module_statistics
from heliosweep.kernels.gazing.slopes import SlopeFit, look_back, residual_squares

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.study import BackwardGazingStudy
    from heliosweep.families.points import Point

#: Minimum number of pixels for an estimate of the noise.
LEAST_PIXELS = 20
#: Medians of chi squared, by degrees of freedom from 1.
_CHI_SQUARED = (0.454936, 1.386294, 2.365974, 3.356694, 4.351460, 5.348121)
#: Bit of `quality` of each reason that excludes a camera's pixel.
_REASONS = {
    why.AT_EDGE: names.EDGE,
    why.SATURATED: names.SATURATED,
    why.NOT_A_NUMBER: names.NOT_A_NUMBER,
    why.OUT_OF_FRAME: names.OUT_OF_FRAME,
    why.AT_LIMB: names.OUTSIDE,
}
#: Parts below which a camera counts as dark and a module as hardly seen; residuals over the noise stated, of which they
#: are about 0.6 in a right result.
DARK, HARDLY, MUCH = 0.05, 0.5, 1.0


class Inputs(NamedTuple):
    """Images and sun of a study."""

    shots: Shots
    table: SunProfile | None


def computation(study: BackwardGazingStudy) -> Computation:
    """Return the variables of measured images and the function that computes them."""
    pixels = names.most_pixels(study)
    return Computation(
        function=of_point,
        variables=names.variables(study),
        labels=names.LABELS,
        dims=names.dims(study, True),
        coordinates=partial(coordinates, study),
        attrs=partial(attributes, study),
        inputs=partial(inputs, study),
        evaluations=pixels,
        unit="pixels",
        memory=lambda: pixels * names.bytes_per_pixel(study) + 2 * read_shots(study).images.nbytes,
        mode="measured",
    )


def coordinates(study: BackwardGazingStudy) -> dict[str, Any]:
    """Return further coordinates, with those from metadata."""
    found, geometry = names.coordinates(study, True), read_shots(study).geometry
    for key, value in geometry.items():
        block, field = key.split(".")
        parameter = type(getattr(study, block)).parameter(field)
        name, attrs = coordinate_name(parameter, key), coordinate_attributes(parameter, key)
        attrs.pop("comment", None)  # it is about the key
        found[name] = ((), value, attrs)
        if field == "azimuth":
            found[f"{block}_world_azimuth"] = ((), *names.label(f"{block}_world_azimuth", (180.0 - value) % 360.0))
    return found


def attributes(study: BackwardGazingStudy) -> dict[str, str]:
    """Return global attributes about the images."""
    shots = read_shots(study)
    ways = {"none": shots.rectified, "registered": shots.register.any(), "corners": np.isfinite(shots.corners).any()}
    return names.attributes(study) | {
        "image_files": ", ".join(PurePath(entry.file).name for entry in study.images or ()),
        "white_levels": " ".join(shots.white_from),
        "pixel_noise_from": "residuals" if np.isnan(shots.noise) else "study",
        "gain_of_each_pixel": "fitted" if study.fit_gain or shots.needs_gain else "1",
        "rectification": next((name for name, holds in ways.items() if holds), "pinhole"),
    }


def inputs(study: BackwardGazingStudy) -> Inputs:
    """Read the images and the sun. Raises StudyError."""
    return Inputs(read_shots(study), read_sun(study)[0])


def of_point(point: Point) -> dict[str, Any]:
    """Return the values of the variables at a point of the grid."""
    try:
        return _of_point(point, *point.inputs)
    except Failure as failure:
        return {"scene_status": failure.args[0]}


def _of_point(point: Point, shots: Shots, table: SunProfile | None) -> dict[str, Any]:
    study, values = point.study, values_of(point, shots.geometry)
    count, fit_gain, modules = len(study.method), study.fit_gain or shots.needs_gain, study.heliostat.rectangles
    methods = study.method if "LM" in study.method else (*study.method, "LM")  # LM gives the uncertainties
    layout, profile = scene_of(values, shots.positions), assumed(values, profile_of(values, table))
    mirror, focal_length = mirror_grid(modules, values["heliostat.pixel"]), values["heliostat.focal_length"]
    keep, threshold = eroded(mirror, int(values["erosion"])), values["cameras.threshold"]
    images, flags, noises, placed = _on_mirror(layout, mirror, modules, focal_length, threshold, shots)
    rows = tuple(map(REFERENTIALS.index, study.referential))
    found = find_slopes(layout, profile, images, mirror.pixels, threshold, methods, rows, fit_gain, study.smooth)
    fit, slopes, quality = found.fit, found.slopes[:count], found.quality[:count]
    assert fit is not None
    lit = (found.lit >> np.arange(CAMERAS)[:, np.newaxis]) & 1 == 1
    usable, cameras = np.isfinite(fit.slopes[0]), lit.sum(axis=0)

    def residual(method: str, slopes: Floats) -> Floats:
        if method == "LM":
            return fit.merit
        seen = look_back(layout, profile, mirror.pixels, np.ascontiguousarray(slopes))[1]
        return residual_squares(seen, images, threshold, fit_gain and method != "A")

    with np.errstate(all="ignore"):
        share = np.nansum(np.where(lit, noises**2, np.nan), axis=0) / cameras
        noise = shots.noise if math.isfinite(shots.noise) else _noise(fit, share, cameras - 2 - fit_gain, keep)
        deviation = np.where(np.isfinite(fit.slopes), fit.deviation * noise * np.sqrt(share), np.nan)
        left = [[residual(method, one) for one in frames] for method, frames in zip(methods, slopes, strict=False)]
        rms = np.where(np.isfinite(slopes[:, :, 0]), np.sqrt(np.array(left) / cameras), np.nan)
        inner = (flags & (why.AT_EDGE | why.OUT_OF_FRAME)) == 0
        lit_fraction = (lit & inner).sum(axis=1) / inner.sum(axis=1)
    reasons = sum(bit * np.any(flags & reason, axis=0) for reason, bit in _REASONS.items())
    counted = np.where((quality & NOT_CONVERGED > 0)[:, np.newaxis, np.newaxis], np.nan, slopes)  # the others count
    known = [np.where(np.isfinite(deviation), deviation, 0.0)] * count
    over_modules = partial(module_statistics, module=mirror.pixel_module, use=keep, count=len(modules.size))
    inside = np.bincount(mirror.pixel_module[keep], minlength=len(modules.size))
    used = keep & usable
    return {
        **estimates(counted, known, mirror, modules, keep, focal_length),
        "usable_fraction": over_modules(slopes[:, 0, 0])[2] / inside,
        "lit_cameras": over_modules(cameras / CAMERAS)[0],
        **by_axis("cramer_rao_bound_%", over_modules(1e3 * deviation)[1], 0),
        "lit_fraction": lit_fraction,
        **sun_of(profile_of(values, table)),
        "evaluations": found.evaluations[:count],
        **by_axis("slope_%", maps(mirror, 1e3 * slopes)),
        **by_axis("slope_uncertainty_%", maps(mirror, 1e3 * deviation), 0),
        "image": maps(mirror, images),
        "residual_rms": maps(mirror, rms),
        "mask": np.nan_to_num(maps(mirror, np.where(~keep, 1, np.where(cameras < NEEDED, 2, 3)))),
        "quality": np.nan_to_num(maps(mirror, quality | reasons)),
        **placed,
        "saturated_fraction": np.mean(flags & why.SATURATED > 0, axis=1),
        "white_level": shots.white,
        "pixel_noise": noise,
        "gain": float(np.median(fit.gain[used])) if np.any(used) else math.nan,
        "scene_status": SEEN if np.any(usable) else NOT_SEEN,
        "incidence": math.degrees(layout.incidence),
    }


def registered(layout: Scene, focal_length: float, shots: Shots, modules: Modules) -> tuple[Floats, dict[str, Floats]]:
    """Return the corners in all images, shape (4, 4, 2), NaN if the pinhole is known, and variables about them.

    Raises ValueError with the number of the image, from 0, and the reason if the heliostat is not found in it.
    """
    corners, found = shots.corners.copy(), np.full((len(names.REGISTERED), CAMERAS), math.nan)
    for number in np.flatnonzero(shots.register).tolist():
        upright = why.pinholes(layout, shots.images.shape[1:], ANY_FOCAL)
        image, arrays = shots.images[number], [(each.tobytes(), each.shape) for each in (*upright, *modules)]
        try:
            place = _register(image.tobytes(), image.shape, number, focal_length, *arrays)
        except ValueError as error:
            raise ValueError(number, str(error)) from None
        corners[number], turn, scale, centre, residual = place
        found[:, number] = -math.degrees(turn), *centre, ANY_FOCAL * scale, residual
    return corners, dict(zip(names.REGISTERED, found, strict=True))


@lru_cache(64)
def _register(
    image: bytes, shape: tuple[int, int], number: int, focal_length: float, *arrays: tuple[bytes, tuple[int, ...]]
) -> tuple[Floats, float, float, Floats, float]:
    """Register an image once for all points that see it alike."""
    eyes, axes, focal, centre, *modules = (np.frombuffer(data).reshape(size) for data, size in arrays)
    upright = why.Pinholes(eyes, axes, focal, centre)

    def see(points: Floats) -> Floats:
        return why.places_of(upright, focal_length, points)[number]

    return register(np.frombuffer(image).reshape(shape), see, Modules(*modules))


def _on_mirror(
    layout: Scene, mirror: MirrorGrid, modules: Modules, focal_length: float, threshold: float, shots: Shots
) -> tuple[Floats, Integers, Floats, dict[str, Floats]]:
    """Return images on the grid of the mirror as `rectify`, and variables about registration. Raises Failure."""
    if shots.rectified:
        images = shots.images[:, ::-1].reshape(CAMERAS, -1)[:, mirror.place]  # rows of the grid ascend
        flags = why.SATURATED * (images >= shots.saturation[:, np.newaxis]) + why.NOT_A_NUMBER * ~np.isfinite(images)
        return np.where(flags == 0, images, np.nan), flags, np.where(flags == 0, 1.0, np.nan), {}
    try:
        cameras = why.pinholes(layout, shots.images.shape[1:], shots.focal, shots.centre, shots.roll)
        corners, placed = registered(layout, focal_length, shots, modules)
        return *why.rectify(
            shots.images, cameras, focal_length, modules, mirror, corners=corners, saturation=shots.saturation,
            threshold=threshold,
        ), placed  # fmt: skip
    except ValueError:  # a camera that looks straight up or down, or corners that no view of this scene has
        raise Failure(NOT_IDENTIFIABLE) from None


def _noise(fit: SlopeFit, share: Floats, freedom: Integers, keep: NDArray[np.bool_]) -> float:
    """Return the standard deviation of a pixel of the images, from residuals. [1]"""
    use = keep & (freedom > 0) & np.isfinite(fit.merit) & (fit.flags == 0)
    if np.count_nonzero(use) < LEAST_PIXELS:
        return math.nan
    ratio = fit.merit[use] / (share[use] * np.array(_CHI_SQUARED)[freedom[use] - 1])
    return math.sqrt(float(np.median(ratio)))


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
    """Yield warnings about images that are saturated or dark on the mirror."""
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
    """Yield warnings about levels of white not measured through the mirror, and about large residuals."""
    source = set(str(result.attrs.get("white_levels", "")).split())
    how = {
        SUN_IMAGE: "is from the sun's image, without the mirror",
        BRIGHTEST: "is unknown, and the brightest pixels of all images replace it",
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
