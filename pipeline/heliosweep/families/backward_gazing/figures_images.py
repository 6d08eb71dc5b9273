"""Pictures of the mirror: the camera images, slopes by each method, their errors, and which pixels count."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr

from heliosweep.families.backward_gazing.shown import CAMERA, DIRECTIONS, METHOD, REFERENTIAL, Gazing, study
from heliosweep.families.backward_gazing.variables import PLANE, QUALITY
from heliosweep.report.contents import NamedFigure
from heliosweep.report.labels import MINUS, number_text
from heliosweep.report.layout import abreast
from heliosweep.report.pictures import Kinds, Raster, about_zero, from_zero, picture_figure, within
from heliosweep.report.selection import at

#: Pictures beside each other.
COLUMNS = 4
#: Colours of brightness, from black over red to yellow.
_BRIGHTNESS = "inferno"
_SEEN = "seen from the target"
_MASK = {
    0: ("between the modules", "#ffffff"),
    1: ("at the edge of a module", "#56B4E9"),
    2: ("fewer than three cameras lit", "#D55E00"),
    3: ("counts", "#e8e4c9"),
}
#: Bits of the quality from the gravest to the least, what they mean, and their colours.
_COLOURS = {16: "#000000", 32: "#0072B2", 64: "#009E73", 1: "#CC79A7", 4: "#E69F00", 8: "#56B4E9", 2: "#D55E00"}
_QUALITY = {bit: (QUALITY[bit].replace("_", " "), colour) for bit, colour in _COLOURS.items()}
_QUALITY[0] = ("nothing doubtful", "#e8e4c9")
#: Value of the mask for pixels that too few cameras see, and bits of the quality that nothing else shows.
_UNLIT, _GRAVE = 2, (1, 4, 16, 32, 64)


def images(shown: Gazing) -> Iterator[NamedFigure]:
    """The camera images, after Figure 2."""
    result = shown.result
    if not shown.has("image") or not shown.has_plane("image") or CAMERA not in result["image"].dims:
        return
    stands, cameras = shown.fixed("image", CAMERA, *PLANE), shown.chosen(CAMERA, 4)
    pictures = [shown.raster(at(result["image"], stands, one), _camera(result, one[CAMERA])) for one in cameras]
    if _known(pictures):
        label = "brightness relative to the centre of the sun (1)"
        shades = within(label, [one.values for one in pictures], palette=_BRIGHTNESS)
        caption = (
            f"The sun in the mirror as each camera sees it, on the grid of the mirror, {_SEEN}; the numbers are those "
            f"of the modules.{shown.note(stands, cameras)}"
        )
        yield NamedFigure("images", caption, picture_figure(pictures, shades, min(2, len(pictures))))


def slopes(shown: Gazing) -> Iterator[NamedFigure]:
    """Slopes by each method on one scale, after Figures 7 and 8; slopes found less the true ones."""
    result = shown.result
    if not shown.has("slope_x", "slope_y") or not shown.has_plane("slope_x"):
        return
    label = "slope relative to the ideal heliostat (mrad)"
    said = f"Slopes of the mirror relative to the ideal heliostat, by each method, {_SEEN}."
    true = shown.has("true_slope_x", "true_slope_y")
    yield from _by_method(shown, "slope_maps", label, said, beside=true and result.sizes.get(METHOD, 1) < COLUMNS)
    if true:
        said = f"Slopes that each method finds less the true ones, {_SEEN}."
        yield from _by_method(shown, "slope_errors", "error of the slope (mrad)", said, less=True)


def uncertainty(shown: Gazing) -> Iterator[NamedFigure]:
    """Standard uncertainty of the slope of each pixel."""
    names = {f"slope_uncertainty_{end}": word for end, word in DIRECTIONS.items()}
    if not shown.has(*names) or not shown.has_plane(next(iter(names))):
        return
    stands = shown.fixed(next(iter(names)), *PLANE)
    pictures = [shown.raster(at(shown.result[name], stands), word) for name, word in names.items()]
    if _known(pictures):
        shades = from_zero("standard uncertainty of the slope (mrad)", [one.values for one in pictures])
        caption = f"Standard uncertainty of the slopes of each pixel, {_SEEN}.{_grey(pictures)}{shown.note(stands)}"
        yield NamedFigure("slope_uncertainty", caption, picture_figure(pictures, shades))


def residuals(shown: Gazing) -> Iterator[NamedFigure]:
    """What the slopes by each method leave of the images."""
    name = "residual_rms"
    if not shown.has(name) or not shown.has_plane(name):
        return
    stands = shown.fixed(name, METHOD, REFERENTIAL, *PLANE)
    array = 100 * shown.result[name]
    pictures = [shown.raster(at(array, stands, way.point), way.name) for way in shown.best_ways(name)]
    if _known(pictures):
        shades = from_zero("residual (% of the brightness of the sun's centre)", [one.values for one in pictures])
        caption = (
            "Root mean square over the lit cameras of the brightness seen less that of the slopes found, by each "
            f"method, {_SEEN}.{_grey(pictures)}{shown.note(stands)}"
        )
        yield NamedFigure("residuals", caption, picture_figure(pictures, shades, abreast(len(pictures), COLUMNS)))


def pixels(shown: Gazing) -> Iterator[NamedFigure]:
    """Which pixels count, and what is doubtful about their slopes."""
    result = shown.result
    if not shown.has("mask") or not shown.has_plane("mask"):
        return
    stands = shown.fixed("mask", *PLANE)
    mask = at(result["mask"], stands)
    measured = study(result).get("mode") == "measured"
    picture = shown.raster(mask)
    if (measured or (mask == _UNLIT).any()) and _known([picture]):
        caption = f"Which pixels count for the modules, {_SEEN}.{shown.note(stands)}"
        yield NamedFigure(
            "which_pixels_count",
            caption,
            picture_figure([picture], Kinds(_MASK)),
        )
    if "quality" not in result:
        return
    stands = {**shown.fixed("quality", *PLANE, METHOD), **stands}
    pictures, grave = [], measured
    for one in shown.chosen(METHOD if METHOD in result["quality"].dims else None, COLUMNS):
        ranks = xr.apply_ufunc(_gravest, at(result["quality"], stands, one).astype(float).compute())
        pictures.append(shown.raster(ranks.where(mask > 0), shown.values(one)))
        grave |= bool(np.isin(pictures[-1].values, [list(_QUALITY).index(bit) for bit in _GRAVE]).any())
    if grave and _known(pictures):
        caption = f"What is doubtful about the slope of each pixel, the gravest first, {_SEEN}.{shown.note(stands)}"
        figure = picture_figure(pictures, Kinds(dict(enumerate(_QUALITY.values()))), len(pictures))
        yield NamedFigure("quality", caption, figure)


FIGURES = (images, slopes, uncertainty, residuals, pixels)


def _by_method(
    shown: Gazing, name: str, label: str, said: str, beside: bool = False, less: bool = False
) -> Iterator[NamedFigure]:
    """A column for each method, a row for each direction and profile of the sun; beside or less the true slopes."""
    result = shown.result
    ways, sorts = shown.ways("slope_x", every=False), shown.sorts("slope_x")
    stands = shown.fixed("slope_x", METHOD, REFERENTIAL, shown.sort_dim("slope_x"), *PLANE)
    single = len(ways) == 1 and not beside
    pictures: list[Raster] = []
    names: list[str] = []
    for where in sorts:
        for end, direction in DIRECTIONS.items():
            first = not names
            true = f"true_slope_{end}"
            if beside:
                pictures.append(shown.raster(at(result[true], stands, where), "true" if first else ""))
            for way in ways:
                # A single method has room for both directions beside each other.
                title = direction if single and where == sorts[0] else way.name if first and not single else ""
                found = at(result[f"slope_{end}"], stands, where, way.point)
                found = found - at(result[true], stands, where) if less else found
                pictures.append(shown.raster(found, title))
            names.append("\n".join(filter(None, [shown.values(where), direction])))
    if not _known(pictures):
        return
    if single:
        names = [shown.values(where) for where in sorts]
    shades = about_zero(label, [one.values for one in pictures])
    method = f" Method {ways[0].name}." if len(ways) == 1 and ways[0].name else ""
    used, count = next((way.referential for way in ways if way.referential), ""), result.sizes.get(REFERENTIAL, 1)
    referential = f" Referential of A and O1: {used}{f' (one of {count})' if count > 1 else ''}." if used else ""
    caption = f"{said}{method}{referential}{_grey(pictures)}{shown.note(stands, sorts)}"
    columns = 2 if single else len(ways) + beside
    yield NamedFigure(name, caption, picture_figure(pictures, shades, columns, names))


def _grey(pictures: Sequence[Raster]) -> str:
    return " Grey: no slope." if any(np.isnan(one.values).any() for one in pictures) else ""


def _gravest(bits: np.ndarray) -> np.ndarray:
    """Rank in `_QUALITY` of the first bit that is set."""
    known = np.isfinite(bits)
    whole = np.where(known, bits, 0).astype(int)
    ranks = np.select([(whole & bit) > 0 for bit in _COLOURS], list(range(len(_COLOURS))), len(_COLOURS))
    return np.where(known, ranks, np.nan)


def _known(pictures: Sequence[Raster]) -> bool:
    return any(np.isfinite(one.values).any() for one in pictures)


def _camera(result: xr.Dataset, index: int) -> str:
    """A camera by its number and place in the plane of the target."""
    parts = [result[f"camera_{side}"] for side in "yz" if f"camera_{side}" in result.coords]
    if len(parts) == 2 and all(part.dims == (CAMERA,) for part in parts):
        y, z = (number_text(float(part[index]), 2) for part in parts)
        return f"camera {index + 1}: ({y}, {z}) m".replace("-", MINUS)
    return f"camera {index + 1}"
