"""Pictures of the mirror: the camera images, slopes by each method, their errors, and which pixels count."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import xarray as xr

from heliosweep.families.backward_gazing import report_views as views
from heliosweep.families.backward_gazing import report_words as wording
from heliosweep.families.backward_gazing.report_views import CAMERA, DIRECTIONS, METHOD, REFERENTIAL, at, needs
from heliosweep.families.registry import NamedFigure
from heliosweep.report.images import Picture, Row, picture_figure
from heliosweep.report.labels import MINUS, number_text
from heliosweep.report.shades import Kinds, about_zero, from_zero, within

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
#: Bits of the quality from the gravest to the least, and what they mean.
_QUALITY = {
    16: ("saturated", "#000000"),
    32: ("not a number", "#0072B2"),
    64: ("out of frame", "#009E73"),
    1: ("not converged", "#CC79A7"),
    4: ("beside the disc", "#E69F00"),
    8: ("at the edge of a module", "#56B4E9"),
    2: ("fewer than three cameras lit", "#D55E00"),
    0: ("nothing doubtful", "#e8e4c9"),
}
_PLANE = ("z", "y")
#: Value of the mask for pixels that too few cameras see, and bits of the quality that nothing else shows.
_UNLIT, _GRAVE = 2, (1, 4, 16, 32, 64)


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Figures of results with maps.

    Parameters
    ----------
    result : xarray.Dataset
        The result.

    Yields
    ------
    NamedFigure
    """
    for draw in (_images, _slopes, _slope_errors, _uncertainty, _residual, _pixels):
        yield from draw(result)


@needs("image")
def _images(result: xr.Dataset) -> Iterator[NamedFigure]:
    """The camera images, after Figure 2."""
    plane = views.ground(result, "image")
    if plane is None or CAMERA not in result["image"].dims:
        return
    stands = views.fixed(result, "image", CAMERA, *_PLANE)
    cameras = views.chosen(result, CAMERA, 4)
    pictures = [Picture(_map(result["image"], stands, one), _camera(result, one[CAMERA])) for one in cameras]
    if not _known(pictures):
        return
    abreast = 2 if len(pictures) > 1 else 1
    rows = [Row(pictures[start : start + abreast]) for start in range(0, len(pictures), abreast)]
    colours = within("brightness relative to the centre of the sun (1)", _maps(pictures), palette=_BRIGHTNESS)
    caption = (
        f"The sun in the mirror as each camera sees it, on the grid of the mirror, {_SEEN}; the numbers are those of "
        f"the modules.{wording.note(result, stands, (CAMERA, cameras))}"
    )
    yield NamedFigure("images", caption, picture_figure(rows, plane, colours))


@needs("slope_x", "slope_y")
def _slopes(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Slopes by each method on one scale, after Figures 7 and 8."""
    if "true_slope_x" in result and result.sizes.get(METHOD, 1) < COLUMNS:
        truth = [("true", lambda name, *points: at(result[f"true_{name}"], *points))]
    else:
        truth = []
    yield from _by_method(
        result,
        "slope_maps",
        "slope relative to the ideal heliostat (mrad)",
        f"Slopes of the mirror relative to the ideal heliostat, by each method, {_SEEN}.",
        lambda name, *points: at(result[name], *points),
        truth,
    )


@needs("slope_x", "slope_y", "true_slope_x", "true_slope_y")
def _slope_errors(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Slopes found less the true ones."""
    yield from _by_method(
        result,
        "slope_errors",
        "error of the slope (mrad)",
        f"Slopes that each method finds less the true ones, {_SEEN}.",
        lambda name, *points: at(result[name], *points) - at(result[f"true_{name}"], *points),
    )


@needs("slope_uncertainty_x", "slope_uncertainty_y")
def _uncertainty(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Standard uncertainty of the slope of each pixel."""
    rows = _rows(result, "slope_uncertainty_%")
    yield from _single(result, rows, "slope_uncertainty", "standard uncertainty of the slope (mrad)",
                       "Standard uncertainty of the slopes of each pixel", "slope_uncertainty_x")  # fmt: skip


@needs("residual_rms")
def _residual(result: xr.Dataset) -> Iterator[NamedFigure]:
    """What the slopes by each method leave of the images."""
    plane, ways = views.ground(result, "residual_rms"), views.best_ways(result, "residual_rms")
    if plane is None:
        return
    stands = views.fixed(result, "residual_rms", METHOD, REFERENTIAL, *_PLANE)
    pictures = [Picture(100 * _map(result["residual_rms"], stands, way.point), way.name) for way in ways]
    if not _known(pictures):
        return
    colours = from_zero("residual (% of the brightness of the sun's centre)", _maps(pictures))
    caption = (
        "Root mean square over the lit cameras of the brightness seen less that of the slopes found, by each method, "
        f"{_SEEN}.{_grey([Row(pictures)])}{wording.note(result, stands)}"
    )
    rows = [Row(pictures[start : start + COLUMNS]) for start in range(0, len(pictures), COLUMNS)]
    yield NamedFigure("residuals", caption, picture_figure(rows, plane, colours))


@needs("mask")
def _pixels(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Which pixels count, and what is doubtful about their slopes."""
    plane = views.ground(result, "mask")
    if plane is None:
        return
    stands = views.fixed(result, "mask", *_PLANE)
    mask = _map(result["mask"], stands)
    measured = views.study(result).get("mode") == "measured"
    drawn = []
    if measured or (mask == _UNLIT).any():
        drawn.append(("which_pixels_count", Kinds(_MASK), [Picture(mask)], "Which pixels count for the modules"))
    if "quality" in result:
        stands = {**views.fixed(result, "quality", *_PLANE, METHOD), **stands}
        methods = views.chosen(result, METHOD, COLUMNS) if METHOD in result["quality"].dims else [{}]
        kinds = Kinds(dict(enumerate(_QUALITY.values())))
        pictures, grave = [], measured
        for one in methods:
            bits = _map(result["quality"], stands, one)
            name = views.short(result, METHOD, one[METHOD]) if one else ""
            pictures.append(Picture(np.where(mask > 0, _gravest(bits), np.nan), name))
            grave |= bool(np.isin(pictures[-1].values, [list(_QUALITY).index(bit) for bit in _GRAVE]).any())
        if grave:
            drawn.append(
                ("quality", kinds, pictures, "What is doubtful about the slope of each pixel, the gravest first")
            )
    for name, kinds, pictures, said in drawn:
        if _known(pictures):
            caption = f"{said}, {_SEEN}.{wording.note(result, stands)}"
            yield NamedFigure(name, caption, picture_figure([Row(pictures)], plane, kinds))


def _by_method(
    result: xr.Dataset,
    name: str,
    label: str,
    said: str,
    values: Callable[..., xr.DataArray],
    before: Sequence[tuple[str, Callable[..., xr.DataArray]]] = (),
) -> Iterator[NamedFigure]:
    """A column for each method, a row for each direction and profile of the sun."""
    plane = views.ground(result, "slope_x")
    if plane is None:
        return
    ways = views.ways(result, "slope_x", every=False)
    single = len(ways) == 1
    stands = views.fixed(result, "slope_x", METHOD, REFERENTIAL, views.sort_of(result, "slope_x"), *_PLANE)
    profiles = views.sorts(result, "slope_x")
    rows: list[tuple[str, list[Picture]]] = []
    for profile, where in profiles:
        for end, direction in DIRECTIONS.items():
            pictures = [
                Picture(_plane(read(f"slope_{end}", stands, where)), "" if rows else text) for text, read in before
            ]
            pictures += [
                Picture(_plane(values(f"slope_{end}", stands, where, way.point)), "" if rows else way.name)
                for way in ways
            ]
            rows.append((f"{profile}\n{direction}" if profile else direction, pictures))
    if not _known([one for _, pictures in rows for one in pictures]):
        return
    drawn = [Row(pictures, text) for text, pictures in rows]
    if single and not before:
        # A single method has room for both directions beside each other.
        firsts = [row.pictures[0].values for row in drawn]
        words = list(DIRECTIONS.values())
        drawn = [
            Row([Picture(*one) for one in zip(firsts[i : i + 2], words, strict=True)], profiles[i // 2][0])
            for i in range(0, len(firsts), 2)
        ]
    colours = about_zero(label, [one.values for row in drawn for one in row.pictures])
    referential = _referential(result, ways)
    method = f" Method {ways[0].name}." if single and ways[0].name else ""
    note = wording.note(result, stands, (views.sort_of(result, "slope_x"), profiles))
    caption = f"{said}{method}{referential}{_grey(drawn)}{note}"
    yield NamedFigure(name, caption, picture_figure(drawn, plane, colours))


def _rows(result: xr.Dataset, quantity: str) -> tuple[list[Row], dict[str, int]]:
    """A row with both directions of a quantity, at where the rest stands."""
    names = {quantity.replace("%", end): word for end, word in DIRECTIONS.items()}
    stands = views.fixed(result, next(iter(names)), *_PLANE)
    return [Row([Picture(_map(result[name], stands), word) for name, word in names.items()])], stands


def _single(
    result: xr.Dataset, rows: tuple[list[Row], dict[str, int]], name: str, label: str, said: str, quantity: str
) -> Iterator[NamedFigure]:
    plane = views.ground(result, quantity)
    drawn, stands = rows
    pictures = [one for row in drawn for one in row.pictures]
    if plane is None or not _known(pictures):
        return
    caption = f"{said}, {_SEEN}.{_grey(drawn)}{wording.note(result, stands)}"
    yield NamedFigure(name, caption, picture_figure(drawn, plane, from_zero(label, _maps(pictures))))


def _referential(result: xr.Dataset, ways: Sequence[views.Way]) -> str:
    """Which of several referentials is shown."""
    used = next((way.referential for way in ways if way.referential), "")
    count = result.sizes.get(REFERENTIAL, 1)
    return f" Referential of A and O1: {used}{f' (one of {count})' if count > 1 else ''}." if used else ""


def _grey(rows: Sequence[Row]) -> str:
    return " Grey: no slope." if any(np.isnan(one.values).any() for row in rows for one in row.pictures) else ""


def _gravest(bits: np.ndarray) -> np.ndarray:
    """Rank in `_QUALITY` of the first bit that is set."""
    known = np.isfinite(bits)
    whole = np.where(known, bits, 0).astype(int)
    ranks = np.select([(whole & bit) > 0 for bit in _QUALITY if bit], list(range(len(_QUALITY) - 1)), len(_QUALITY) - 1)
    return np.where(known, ranks, np.nan)


def _map(array: xr.DataArray, *points: dict[str, int]) -> np.ndarray:
    return _plane(at(array, *points))


def _plane(array: xr.DataArray) -> np.ndarray:
    return np.asarray(array.transpose(*_PLANE).to_numpy(), dtype=float)


def _maps(pictures: Sequence[Picture]) -> list[np.ndarray]:
    return [one.values for one in pictures]


def _known(pictures: Sequence[Picture]) -> bool:
    return any(np.isfinite(one.values).any() for one in pictures)


def _camera(result: xr.Dataset, index: int) -> str:
    """A camera by its number and place in the plane of the target."""
    name = f"camera {index + 1}"
    parts = [result[f"camera_{side}"] for side in "yz" if f"camera_{side}" in result.coords]
    if len(parts) == 2 and all(part.dims == (CAMERA,) for part in parts):
        y, z = (number_text(float(part[index]), 2) for part in parts)
        return f"{name}: ({y}, {z}) m".replace("-", MINUS)
    return name
