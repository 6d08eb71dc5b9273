"""Images of declared figures with matplotlib: curves, coloured maps and pictures, and planes."""

from __future__ import annotations

import io
import itertools
import os
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, Normalize
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure as Drawing
from matplotlib.patches import Patch, Polygon, Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, MaxNLocator
from PIL import Image, ImageChops

from heliosweep.files import write_whole
from heliosweep.report.context import Context, Point, aperture, areas, at, is_geometric, mirrors
from heliosweep.report.figures import (
    COLOURS,
    DASHES,
    DIFFERENCES,
    HELIOSTAT,
    MARKERS,
    MOST_FIGURES,
    NO_VALUE,
    STATISTICS,
    VALUES,
    Curves,
    Figure,
    Grids,
    Maps,
    Planes,
    Rasters,
    Special,
    axis_of,
    is_joined,
    is_ordered,
    preferred,
    reduced,
    usable,
)
from heliosweep.report.labels import (
    LETTERS,
    axis_label,
    capital,
    fold,
    is_latitude,
    is_signed,
    latitude_text,
    printed,
    title_of,
    unit_of,
)
from heliosweep.report.tables import number_texts
from heliosweep.store.folder import target_file

#: Maximum number of lines of a panel, of panels, and of panels in a row.
MOST_LINES, MOST_PANELS, COLUMNS = 7, 6, 3
#: Width of a figure with several panels and with one. [inch]
WIDE, SINGLE = 7.2, 4.8
#: Number of points above which lines have no markers.
MARKED = 40
#: Letters of the title of a panel over its width. [1/inch]
TITLE_LETTERS = 15
#: Share of the values inside a colour scale; more extreme values have the colour of its end.
INSIDE = 0.995
#: Size of the spots over half the aperture below which the panel shows the spots only.
SMALL_SPOT = 0.05
#: Range of heights above which contour lines are drawn. [m]
HILLY = 1.0
_AREAS: dict[str, dict[str, Any]] = {
    "boundary": {"facecolor": "none", "edgecolor": "#222222", "linewidth": 0.9, "linestyle": (0, (5, 2))},
    "no heliostats": {"facecolor": "none", "edgecolor": "#888888", "linewidth": 0.7, "hatch": "////"},
}
_SYMBOLS = "Each square is a mirror with a side towards the tower (triangle)."


@dataclass(frozen=True, repr=False)
class NamedFigure:
    """A drawn figure with its file name and caption; a notebook shows it as an image.

    Parameters
    ----------
    name : str
        Name of the file.
    caption : str
        Caption.
    figure : matplotlib.figure.Figure
        Figure to change or to save.
    """

    name: str
    caption: str
    figure: Drawing

    def __repr__(self) -> str:
        return f"<figure {self.name}: {self.caption}>"

    def _repr_png_(self) -> bytes:
        return image(self.figure, "png")

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> Path:
        """Save as PNG, SVG or PDF, by the ending of the path.

        Parameters
        ----------
        path : path
            File to write. The file appears under its name when it is complete.
        force : bool
            Whether to replace an existing file.

        Returns
        -------
        pathlib.Path
            The file.

        Raises
        ------
        StudyError
            If the file exists, has another ending, or its folder does not exist.
        HeliosweepError
            If the file cannot be written.
        """
        file = target_file(path, force, endings=(".png", ".svg", ".pdf"))
        write_whole(file, image(self.figure, file.suffix[1:].lower()))
        return file


def draw(result: xr.Dataset, figures: Iterable[Figure], most: int = MOST_FIGURES) -> Iterator[NamedFigure]:
    """Draw declared figures, one at a time.

    Parameters
    ----------
    result : Dataset
        Result; only the values that a figure shows are read.
    figures : iterable of Figure
        Declarations.
    most : int
        Maximum number of figures.

    Yields
    ------
    NamedFigure
    """
    return itertools.islice(itertools.chain.from_iterable(drawn(result, figure) for figure in figures), most)


def drawn(result: xr.Dataset, figure: Figure) -> list[NamedFigure]:
    """Draw one declared figure; an empty list if the result has no values for it."""
    result = reduced(result, figure)
    shown = usable(result, figure)
    if shown is None or not shown.image:
        return []
    with matplotlib.rc_context(_RC):
        return list(_FORMS[type(shown)](Context(result, shown.at), shown))


def _special(context: Context, figure: Special) -> Iterator[NamedFigure]:
    """Draw a figure with its own function."""
    assert figure.draw is not None
    drawing = figure.draw(context.result)
    drawing, more = drawing if isinstance(drawing, tuple) else (drawing, "")
    if drawing is not None:
        yield NamedFigure(figure.name, _caption(figure, more), drawing)


def _caption(figure: Figure, *more: str) -> str:
    title = figure.title if figure.title.endswith(".") else f"{figure.title}."
    return " ".join(filter(None, [title, figure.notes, *more]))


def panels(
    count: int, columns: int, height: float, *, wide: bool = False, **options: Any
) -> tuple[Drawing, list[Axes]]:
    """Return a figure with `count` panels in rows, and the axes in reading order.

    Parameters
    ----------
    count, columns : int
        Number of panels, and of panels in a row.
    height : float
        Height over width of a panel.
    wide : bool
        Whether a single panel has the width of a page.
    **options
        Of `matplotlib.figure.Figure.subplots`, and `layout`.
    """
    columns = min(columns, count)
    rows = -(-count // columns)
    width = WIDE if columns > 1 or wide else SINGLE
    size = (width, min(rows * (height * width / columns + 0.55) + 0.5, 9.6))
    drawing = Drawing(figsize=size, layout=options.pop("layout", "constrained"))
    grid = drawing.subplots(rows, columns, squeeze=False, **options).ravel()
    for axes in grid[count:]:
        axes.remove()
    return drawing, list(grid[:count])


def abreast(count: int, most: int = COLUMNS) -> int:
    """Return the number of panels in a row with which rows are as even as possible."""
    return -(-count // -(-count // most)) if count else 1


def legend(drawing: Drawing, entries: Mapping[str, Any], title: str = "") -> None:
    """Write a legend above all panels."""
    if any(entries):
        names = [textwrap.fill(name, LETTERS) for name in entries]
        longest = max(len(line) for name in names for line in name.split("\n"))
        columns = max(1, min(len(names), int(drawing.get_figwidth() * 15 / (longest + 6))))
        drawing.legend(list(entries.values()), names, loc="outside upper center", ncols=columns, title=title or None)


def label_outside(grid: Sequence[Axes], columns: int, x: str, y: str) -> None:
    """Label the first panels of each row and the last ones of each column."""
    for index, axes in enumerate(grid):
        last, first = index + columns >= len(grid), index % columns == 0
        axes.set(xlabel=x if last else "", ylabel=y if first else "")
        axes.tick_params(labelbottom=last, labelleft=first)


def set_ticks(axis: Axis, context: Context, dim: str, most: int = 6) -> None:
    """Set scale and ticks of an axis along a dimension."""
    coordinate, (values, words) = context.coordinate(dim), context.along(dim)
    if words:
        step = -(-len(words) // 24)
        turned = isinstance(axis, XAxis) and sum(min(len(word), 24) for word in words[::step]) > 60 * (7 - most) + 30
        axis.set_ticks(values[::step], [fold(word, 24) for word in words[::step]], rotation=90 if turned else 0)
    elif values.dtype.kind == "M":
        _tick_dates(axis, most)
    elif is_geometric(values):
        axis._set_axes_scale("log")  # type: ignore[attr-defined]
        _tick_plain(axis)
    else:
        turn = str(coordinate.attrs.get("units", "")).startswith("degree") and np.ptp(values) > 60
        if is_latitude(coordinate):
            axis.set_major_formatter(FuncFormatter(lambda value, _: latitude_text(round(value, 6))))
        whole = bool(np.ptp(values) <= most and not np.any(values % 1))
        axis.set_major_locator(MaxNLocator(most, steps=[1, 1.5, 3, 4.5, 9, 10] if turn else None, integer=whole))


def _tick_dates(axis: Axis, most: int = 6) -> None:
    locator = AutoDateLocator(minticks=3, maxticks=most)
    axis.set_major_locator(locator)
    axis.set_major_formatter(ConciseDateFormatter(locator, show_offset=False))


def _tick_plain(axis: Axis) -> None:
    """Write the numbers of a logarithmic axis without exponents."""
    plain = FuncFormatter(lambda value, _: f"{value:g}")
    axis.set_major_formatter(plain)
    low, high = sorted(axis.get_view_interval())
    axis.set_minor_formatter(plain if 0 < high < 10 * low else FuncFormatter(lambda *_: ""))


def _curves(context: Context, figure: Curves) -> Iterator[NamedFigure]:
    """Draw curves: variables with the same axis share a figure."""
    result = context.result
    axis = axis_of(result, result[figure.variables[0]], figure)
    assert axis is not None
    names = [name for name in figure.variables if axis_of(result, result[name], figure) == axis]
    names = ([name for name in names if _varies(result[name], axis)] or names)[: figure.most]
    rest = [str(dim) for dim, size in result[names[0]].sizes.items() if dim != axis and size > 1]
    line = preferred(result, rest, figure.lines)
    others = [dim for dim in rest if dim != line and dim in (figure.panels or rest)]
    panel = preferred(result, others, figure.panels) if len(names) < 3 else None
    fixed = {dim: i for name in reversed(names) for dim, i in context.fixed(result[name], axis, line, panel).items()}
    lines = context.chosen(line, len(STATISTICS) if line == "statistic" else MOST_LINES)
    places = context.chosen(panel, max(1, figure.most // len(names)))
    shown = [(name, place) for name in names for place in places]
    x, words = context.along(axis)
    crowded, ordered = sum(map(len, words)) > 60, bool(line and is_ordered(result, line))
    columns = len(places) if len(names) > 1 and 1 < len(places) <= COLUMNS else 3 if len(shown) == 3 else 2
    columns = 1 if crowded else columns
    drawing, grid = panels(len(shown), columns, 0.45 if crowded else 0.62, wide=crowded, sharex=crowded or not words)
    looks = _looks([context.values(point) for point in lines], figure.looks, ordered)
    entries: dict[str, Any] = {}
    for axes, (name, place) in zip(grid, shown, strict=True):
        array = result[name]
        for number, point in enumerate(lines if line in array.dims else lines[:1]):
            label = context.values(point) if line in array.dims else ""
            values = at(array, fixed, place, point)
            known = values.notnull().to_numpy()
            if values.dims == (axis,) and known.any():
                joined = figure.styled or (is_joined(result, axis) and values.dtype.kind != "M")
                shift = 0.0 if joined or not label or not words else 0.12 * (number - (len(lines) - 1) / 2)
                ends = [at(result[end], fixed, place, point) for end in _band(result, figure, name)]
                look = {**(looks[label] if label else {"color": "#333333", "marker": "o"}), **figure.looks.get("", {})}
                look = {**look, "marker": ""} if joined and values.size > MARKED and not figure.styled else look
                entries[label] = _line(axes, context.order(axis), x + shift if words else x, values, ends, look, joined)
        if len(names) > 1 or axes in grid[::columns]:
            axes.set_ylabel(fold(axis_label(array), 30 if len(grid) > 1 else LETTERS))
        axes.set_title(fold(context.fulls(place), int(TITLE_LETTERS * WIDE / columns)))
        axes.grid(True, axis="y" if words else "both")
        _scale(axes, array, figure.logarithmic)
        set_ticks(axes.xaxis, context, axis, 6 if columns < 3 else 4)
    if entries:
        for axes in grid if words and not crowded else grid[-columns:]:
            axes.set_xlabel(fold(context.label(axis), 78 // max(columns, 2)))
        entries.pop("", None)
        legend(drawing, entries, context.title(line) if line and ordered else "")
        yield NamedFigure(figure.name, _caption(figure, context.note(fixed, lines, places)), drawing)


def _varies(array: xr.DataArray, axis: str) -> bool:
    """Return False if a small array is nearly constant along an axis."""
    if array.size > 200_000 or array.dtype.kind == "M":
        return True
    low, high = array.min(axis), array.max(axis)
    return bool((np.abs(high - low) > 3e-4 * np.abs(high)).any()) or not bool(array.notnull().any())


def _band(result: xr.Dataset, figure: Curves, name: str) -> Sequence[str]:
    """Return the variables with the ends of a band about a variable, or its standard error."""
    for pair in (figure.bands.get(name, ()), (f"{name}_error",), (f"{name}_standard_error",)):
        if pair and all(end in result and set(result[end].dims) <= set(result[name].dims) for end in pair):
            return pair
    return ()


def _looks(names: Sequence[str], special: Mapping[str, Mapping[str, Any]], ordered: bool) -> dict[str, dict[str, Any]]:
    """Return colour, dashes and marker of each line; lines along numbers range from dark to light."""
    scale = colormaps[VALUES](np.linspace(0.0, 0.85, len(names)))
    colours, dashes = scale if ordered and len(names) > 2 else COLOURS, ("-",) if ordered else DASHES
    return {
        name: {"color": colour, "linestyle": dash, "marker": marker, **special.get(name, {})}
        for name, colour, dash, marker in zip(
            names, itertools.cycle(colours), itertools.cycle(dashes), itertools.cycle(MARKERS), strict=False
        )
    }


def _line(
    axes: Axes,
    order: np.ndarray,
    x: np.ndarray,
    values: xr.DataArray,
    ends: Sequence[xr.DataArray],
    look: Mapping[str, Any],
    joined: bool,
) -> Any:
    """Draw a line, or points, with a band; return the line."""
    y = np.asarray(printed(values))[order]
    look = {**look, "linestyle": look.get("linestyle", "-") if joined else ""}
    if ends:
        low, high = (np.asarray(printed(end, values), dtype=float)[order] for end in (ends[0], ends[-1]))
        low, high = (y - low, y + high) if len(ends) == 1 else (low, high)
        if joined:
            axes.fill_between(x, low, high, color=look["color"], alpha=0.2, linewidth=0)
        else:
            axes.errorbar(x, y, np.abs([y - low, high - y]), fmt="none", ecolor=look["color"], elinewidth=1, capsize=2)
    (line,) = axes.plot(x, y, **look)
    return line


def _scale(axes: Axes, array: xr.DataArray, logarithmic: bool) -> None:
    """Set a vertical axis: logarithmic on request, else with a minimum height above rounding errors."""
    low, high = axes.dataLim.y0, axes.dataLim.y1
    if array.dtype.kind == "M":
        _tick_dates(axes.yaxis)
    elif logarithmic and low > 0:
        axes.set_yscale("log")
        _tick_plain(axes.yaxis)
    elif np.isfinite([low, high]).all() and high - low < 1e-3 * max(abs(low), abs(high)):
        half = max(abs(low), abs(high), 1e-9) / 1000
        axes.set_ylim((low + high) / 2 - half, (low + high) / 2 + half)


def shades(maps: Sequence[np.ndarray], palette: str = "", about_zero: bool = False) -> tuple[Normalize, Colormap, str]:
    """Return scale, colours and open ends of a colour bar for the values of some maps.

    Values of both signs have colours that differ about zero.
    """
    every = np.concatenate([values[np.isfinite(values)] for values in maps])
    every = every if every.size else np.array([0.0, 1.0])
    low, high = (float(end) for end in np.quantile(every, [1 - INSIDE, INSIDE]))
    if high - low < 1e-6 * max(abs(low), abs(high), 1e-12):
        low, high = low - max(abs(low), 1e-6) / 1000, high + max(abs(high), 1e-6) / 1000
    if about_zero or (not palette and is_signed(low, high)):
        low, high, palette = -max(-low, high), max(-low, high), DIFFERENCES
    beyond = (every.min() < low - 0.02 * (high - low), every.max() > high + 0.02 * (high - low))
    extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get(beyond, "neither")
    return Normalize(low, high), colormaps[palette or VALUES].with_extremes(bad=NO_VALUE), extend


def colour_bar(
    drawing: Drawing, axes: Sequence[Axes], norm: Normalize, colours: Colormap, label: str, extend: str = "neither"
) -> None:
    """Draw a colour bar below axes."""
    options: Any = {"ax": list(axes), "location": "bottom", "extend": extend, "aspect": 40, "shrink": 0.8, "pad": 0.03}
    letters = 70 if len(axes) > 1 else 78 // max(2, len(drawing.axes[:COLUMNS]))
    bar = drawing.colorbar(ScalarMappable(norm, colours), label=fold(label, letters), **options)
    bar.outline.set_linewidth(0.5)
    bar.locator = MaxNLocator(6 if len(axes) > 1 else 4)
    bar.update_ticks()


def _coloured(context: Context, figure: Maps | Rasters | Grids) -> Iterator[NamedFigure]:
    """Draw maps of a field or pictures over two dimensions: of the points of the sweep, or of each variable."""
    result, array = context.result, context.result[figure.variables[0]]
    is_map, kinds = isinstance(figure, Maps), getattr(figure, "kinds", {})
    separate = isinstance(figure, Grids) or getattr(figure, "each", False)
    over = (
        [HELIOSTAT]
        if is_map
        else [dim for dim in figure.over if isinstance(figure, Rasters) or array.sizes.get(dim, 0) > 1]
    )
    over = sorted(over[:2], key=lambda dim: result.sizes[dim]) if isinstance(figure, Grids) else over[:2]
    points, fixed, columns, note = _points(context, figure, array, *over)
    if separate:
        names = [name for name in figure.variables if set(over) <= set(result[name].dims)]
        points, fixed = [{}], context.fixed(array, *over)
        note = context.note(fixed)
    else:
        names = [name for name in figure.variables if result[name].dims == array.dims]
        names = names[: 1 if is_map or kinds else max(1, 8 // len(points))]
    shown = [(name, point, _values(context, name, over, fixed, point)) for name in names for point in points]
    if separate:
        shown = [one for one in shown if np.unique(one[2][np.isfinite(one[2])]).size > 1]
        shown = shown[: MOST_PANELS if is_map else COLUMNS]
        columns = abreast(len(shown))
    elif len(names) > 1:
        columns = len(points) if len(points) > 1 else abreast(len(names), 2)
    elif is_map and len({one[2].tobytes() for one in shown}) < min(len(shown), 2) and result["x"].ndim == 1:
        shown, columns, note = shown[:1], 1, f"{note} All {len(shown)} maps are equal: the first is shown.".strip()
    if not any(np.isfinite(values).any() for *_, values in shown):
        return
    equal = is_map or (isinstance(figure, Rasters) and len({unit_of(context.coordinate(dim)) for dim in over}) == 1)
    height = 0.9 if is_map else 0.85 if isinstance(figure, Grids) else 0.6
    if equal and not is_map:
        up, right = (np.ptp(context.along(dim)[0]) for dim in over)
        height = float(np.clip(up / right, 0.3, 1.5)) if right else 1.0
    layout = "compressed" if equal else "constrained"
    drawing, grid = panels(len(shown), columns, height, layout=layout, sharex=True, sharey=True)
    about_zero = array.attrs.get(_ABOUT_ZERO, False)
    norm, colours, extend = _kind_colours(kinds) or shades(
        [one[2] for one in shown], getattr(figure, "palette", ""), about_zero
    )
    for axes, (name, point, values) in zip(grid, shown, strict=True):
        if separate:
            norm, colours, extend = shades([values], getattr(figure, "palette", ""))
            colour_bar(drawing, [axes], norm, colours, axis_label(result[name]), extend)
        title = [capital(title_of(result[name])) if len(names) > 1 and not separate else "", context.fulls(point)]
        if is_map:
            field_map(axes, result.isel({**fixed, **point}, missing_dims="ignore"), values, norm, colours)
            mean = number_texts(
                np.atleast_1d(np.nanmean(values)) if np.isfinite(values).any() else np.array([np.nan]), 3
            )
            title.append(f"mean {mean[0]} {unit_of(result[name])}".rstrip())
        else:
            _mesh(axes, context, over, values, norm, colours)
        axes.set_title(fold("\n".join(filter(None, title)), int(TITLE_LETTERS * WIDE / max(columns, 2))))
        if equal and not is_map:
            axes.set_aspect("equal")
            _outline_modules(axes, result, first=axes is grid[0])
    labels = ["north (m)", "east (m)"] if is_map else [fold(context.label(dim), 28) for dim in over]
    label_outside(grid, min(columns, len(grid)), labels[1], labels[0])
    if kinds:
        there = {int(code) for *_, values in shown for code in np.unique(values[np.isfinite(values)])}
        patches = {
            word: Patch(facecolor=colour, edgecolor="#666666")
            for code, (word, colour) in kinds.items()
            if code in there
        }
        legend(drawing, patches)
    elif not separate:
        colour_bar(drawing, grid, norm, colours, axis_label(array), extend)
    missing = "Grey: no value." if is_map and not all(np.isfinite(values).all() for *_, values in shown) else ""
    yield NamedFigure(figure.name, _caption(figure, _SYMBOLS if is_map else "", missing, note), drawing)
    if isinstance(figure, Maps) and any(figure.less in point for point in points):
        yield from _coloured(*_differences(context, figure))


#: Attribute of an array of differences.
_ABOUT_ZERO = "differences"


def _differences(context: Context, figure: Maps) -> tuple[Context, Maps]:
    """Return a result and a figure with the first value of `figure.less` minus each further one."""
    dim, array = figure.less, context.result[figure.variables[0]]
    first, others = array.isel({dim: 0}, drop=True), array.isel({dim: slice(1, None)})
    unit, words = (
        unit_of(array).replace("%", "percentage points"),
        [context.value(dim, i) for i in range(array.sizes[dim])],
    )
    second = words[1] if len(words) == 2 else "each other one"
    difference = (first - others).transpose(*array.dims)
    difference = difference.copy(data=printed(difference.assign_attrs(array.attrs)))
    attrs = {"units": unit, "long_name": f"{words[0]} minus {second}", _ABOUT_ZERO: True}
    title = f"Difference of the {title_of(array)}: red if {words[0]} is higher"
    result = context.result.isel({dim: slice(1, None)}).assign(differences=difference.assign_attrs(attrs))
    result = result.isel({dim: 0}) if len(words) == 2 else result
    return Context(result, context.held), replace(
        figure, name=f"{figure.name}_differences", title=title, variables=["differences"], less=""
    )


def _points(
    context: Context, figure: Figure, array: xr.DataArray, *inner: str
) -> tuple[list[dict[str, int]], dict[str, int], int, str]:
    """Return the points of panels, the fixed positions, the number of columns, and the sentence for the caption."""
    dims = [str(dim) for dim in array.dims if dim not in inner and array.sizes[dim] > 1]
    across = preferred(context.result, dims, figure.panels)
    several = len(figure.variables) > 1 and HELIOSTAT not in inner  # variables are rows
    down = None if several else preferred(context.result, [dim for dim in dims if dim != across], figure.lines)
    fixed = context.fixed(array, *inner, across, down)
    rows = context.chosen(down, 3)
    columns = context.chosen(across, 4 if down else 6, at(array, fixed) if HELIOSTAT not in inner else None)
    points = [{**row, **column} for row in rows for column in columns]
    return points, fixed, len(columns) if down else abreast(len(columns)), context.note(fixed, rows, columns)


def _values(context: Context, name: str, over: Sequence[str], *points: Point) -> np.ndarray:
    """Return the printed values of a variable over some dimensions; over two, sorted along both."""
    array = context.result[name]
    part = at(array, context.fixed(array, *over), *points).transpose(*over)
    values = np.asarray(printed(part), dtype=float)
    return values[np.ix_(*map(context.order, over))] if len(over) > 1 else values


def _kind_colours(kinds: Mapping[int, tuple[str, str]]) -> tuple[Normalize, Colormap, str] | None:
    """Return scale and colours of values that represent words, or None."""
    if not kinds:
        return None
    codes = sorted(kinds)
    colours = ListedColormap([kinds[code][1] for code in codes]).with_extremes(bad=NO_VALUE)
    return BoundaryNorm([codes[0] - 0.5, *(code + 0.5 for code in codes)], len(codes)), colours, "neither"


def field_map(axes: Axes, here: xr.Dataset, values: np.ndarray, norm: Normalize, colours: Colormap) -> None:
    """Draw every mirror of a field, laid flat with one side towards the tower.

    Parameters
    ----------
    axes : Axes
        Axes; get equal scales.
    here : Dataset
        Result at one point, with coordinates ``x`` and ``y``. Mirrors of unknown size are drawn apart from each other.
    values : ndarray, shape (n,)
        Values of the heliostats; NaN is grey.
    norm, colours
        Colour scale.
    """
    x, y, width, height = mirrors(here)
    placed = np.isfinite(x) & np.isfinite(y)
    centre = np.stack([x, y], axis=-1)[placed]
    far = np.hypot(*centre.T)[:, np.newaxis]
    outwards = np.divide(centre, far, out=np.tile([0.0, 1.0], (len(centre), 1)), where=far > 0)
    along = np.stack([outwards[:, 1], -outwards[:, 0]], axis=-1)
    half, deep = (side[placed, np.newaxis] / 2 for side in (width, height))
    corners = [centre + i * half * along + j * deep * outwards for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    shapes: Any = np.stack(corners, axis=1)
    squares = PolyCollection(
        shapes, array=np.ma.masked_invalid(values[placed]), cmap=colours, norm=norm, rasterized=True,
        linewidths=0.2 if len(centre) < 3000 else 0.0, edgecolors=(0.0, 0.0, 0.0, 0.35),
    )  # fmt: skip
    axes.add_collection(squares)
    for name, rings in areas(here).items():
        for ring in rings:
            axes.add_patch(Polygon(ring, **_AREAS[name]))
    z = here["z"].to_numpy() if "z" in here.coords and here["z"].dims == (HELIOSTAT,) else np.zeros(x.size)
    if placed.any() and np.ptp(z[placed]) >= HILLY:
        with suppress(RuntimeError, ValueError):  # mirrors in one line have no triangles
            lines = axes.tricontour(x[placed], y[placed], z[placed], 5, colors="#333333", linewidths=0.5)
            axes.clabel(lines, fontsize=5.5, fmt=lambda level: f"{level:g} m")
    axes.plot(0, 0, "^", color="black", markersize=5, markeredgecolor="white", markeredgewidth=0.6)
    axes.set_aspect("equal", "datalim" if axes.get_shared_x_axes().get_siblings(axes) == [axes] else "box")
    axes.autoscale_view()


def _mesh(
    axes: Axes, context: Context, over: Sequence[str], values: np.ndarray, norm: Normalize, colours: Colormap
) -> None:
    """Draw cells over two dimensions, the first one upwards."""
    sides = [
        edges(np.asarray(places, dtype=float), is_geometric(places))
        for places in (context.along(dim)[0] for dim in over)
    ]
    axes.pcolormesh(sides[1], sides[0], np.ma.masked_invalid(values), cmap=colours, norm=norm, rasterized=True)
    axes.set_facecolor(NO_VALUE)
    for axis, dim in zip((axes.yaxis, axes.xaxis), over, strict=True):
        set_ticks(axis, context, dim, 5)


def edges(values: np.ndarray, logarithmic: bool = False) -> np.ndarray:
    """Return the edges of cells with the given rising middles."""
    values = np.log(values) if logarithmic else np.asarray(values, dtype=float)
    half = np.diff(values) / 2 if values.size > 1 else np.array([0.5])
    ends = np.concatenate([[values[0] - half[0]], values[:-1] + half[: values.size - 1], [values[-1] + half[-1]]])
    return np.exp(ends) if logarithmic else ends


def _outline_modules(axes: Axes, result: xr.Dataset, first: bool) -> None:
    """Draw the modules of a mirror, in the first panel with their numbers, if the result has them."""
    names = ["module", *(f"module_{side}" for side in ("y", "z", "width", "height"))]
    if all(name in result.coords and result[name].dims == ("module",) for name in names):
        for number, y, z, wide, high in zip(*(result[name].to_numpy() for name in names), strict=True):
            corner = (y - wide / 2, z - high / 2)
            axes.add_patch(Rectangle(corner, wide, high, fill=False, edgecolor="#333333", linewidth=0.5))
            if first:
                halo = [withStroke(linewidth=1.6, foreground="white")]
                axes.text(y, z, f"{number:g}", ha="center", va="center", fontsize=6.5, path_effects=halo)


def _planes(context: Context, figure: Planes) -> Iterator[NamedFigure]:
    """Draw paths of points in planes with equal axes, a panel for each value of a dimension."""
    result, name = context.result, figure.variables[0]
    up, right = result[name], result[figure.against[name]]
    dims = [str(dim) for dim in up.dims if up.sizes[dim] > 1]
    paths = [dim for dim in figure.over if dim in dims][: None if figure.dots else 1]
    line, *inner = [*(dim for dim in figure.lines if dim in dims and dim not in paths), None]
    taken = (*paths, line, *inner[:1])
    panel = next((dim for dim in (*figure.panels, HELIOSTAT) if dim in dims and dim not in taken), None)
    colour = figure.colour if figure.colour in dims else None
    fixed = context.fixed(up, *taken, panel, colour)
    places = context.chosen(panel, MOST_PANELS, at(up, fixed))
    if panel == HELIOSTAT and figure.worst in result:
        order = np.argsort(-at(result[figure.worst], fixed).fillna(-np.inf).to_numpy(), kind="stable")
        places = [{HELIOSTAT: int(i)} for i in order[:MOST_PANELS]]
    lines, more = context.chosen(line, MOST_LINES), context.chosen(next(iter(inner), None), 3)
    if not places:
        return
    columns = abreast(len(places))
    drawing, grid = panels(len(places), columns, 0.82, layout="compressed")
    looks = _looks([context.values(point) for point in lines], figure.looks, bool(line and is_ordered(result, line)))
    hues = context.coordinate(colour).astype(float) if colour else xr.DataArray(0.0)
    norm, entries, any_drawn = Normalize(float(hues.min()), float(hues.max())), dict[str, Any](), False
    for axes, place in zip(grid, places, strict=True):
        tracks = [np.zeros((0, 2))]
        for point, other in itertools.product(lines, more):
            pair = xr.broadcast(*(at(one, fixed, place, point, other).astype(float) for one in (right, up, hues)))
            if not figure.dots and paths:
                pair = tuple(one.isel({paths[0]: context.order(paths[0])}) for one in pair)
            x, y, hue = (one.to_numpy().ravel() for one in pair)
            known = np.isfinite(x) & np.isfinite(y)
            if known.any():
                label, text, any_drawn = context.values(point), context.values(other), True
                look = {**looks[label], **({"linestyle": ""} if figure.dots or not paths else {})}
                look["marker"] = look["marker"] if x.size <= MARKED else "." if figure.dots else ""
                tracks.append(np.stack([x, y], axis=-1)[known])
                if colour:
                    axes.plot(
                        x, y, color="#666666", linewidth=0.6, linestyle=look["linestyle"] if colour in paths[:1] else ""
                    )
                    spots = axes.scatter(
                        x, y, 10, hue, norm=norm, cmap=VALUES, linewidths=0, marker=look["marker"] or "o", zorder=3
                    )
                    entries |= {label: spots} if colour not in paths[:1] else {}
                    text = label if colour in paths[:1] else text
                else:
                    (entries[label],) = axes.plot(x, y, **look)
                place_of_text: Any = {"xytext": (3, 3), "textcoords": "offset points", "fontsize": 6}
                axes.annotate(text, tracks[-1][-1], **place_of_text)
        axes.plot(0, 0, "+", color="black", markersize=6, markeredgewidth=0.8)
        size = aperture(result, {**fixed, **place})
        if size:
            rest: Any = {"facecolor": "#ededed", "edgecolor": "#333333", "linewidth": 0.9, "zorder": 0.6}
            axes.add_patch(Rectangle((-size[0] / 2, -size[1] / 2), *size, **rest))
        frame_square(axes, tracks, size)
        if figure.extra is not None:
            figure.extra(axes, result, {**fixed, **place})
        axes.set_title(fold(context.fulls(place), int(TITLE_LETTERS * WIDE / max(columns, 2))))
        axes.grid(True)
        axes.set(xlabel=f"to the right ({unit_of(right)})", ylabel=f"up ({unit_of(up)})")
    if not any_drawn:
        return
    legend(drawing, entries, context.title(line) if line and is_ordered(result, line) else "")
    if colour:
        colour_bar(drawing, grid, norm, colormaps[VALUES], context.label(colour))
    yield NamedFigure(figure.name, _caption(figure, context.note(fixed, places, lines)), drawing)


def frame_square(axes: Axes, tracks: Sequence[np.ndarray], size: tuple[float, float] | None = None) -> None:
    """Make axes square about the origin, an aperture and all points except a few distant ones."""
    points = np.concatenate([np.zeros((1, 2)), *tracks])
    corner = np.array(size or (0.0, 0.0)) / 2
    far = np.hypot(*points.T)
    near = points[far <= max(3.0 * float(np.quantile(far, 0.9)), 8.0 * float(np.hypot(*corner)), 1e-9)]
    if np.ptp(near, axis=0).max() > SMALL_SPOT * corner.max():
        near = np.concatenate([near, [-corner, corner]])
    low, high = near.min(axis=0), near.max(axis=0)
    half, middle = max(float((high - low).max()) / 2 * 1.14, 1e-6), (low + high) / 2
    axes.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half), aspect="equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(4))


_FORMS: dict[type, Any] = {
    Curves: _curves,
    Maps: _coloured,
    Rasters: _coloured,
    Grids: _coloured,
    Planes: _planes,
    Special: _special,
}

#: Resolution of images [1/inch], and white rim around a figure [pixel].
DPI, RIM = 180, 8

_RC: Any = {
    "text.parse_math": False,  # titles and names of sites are words, whatever dollars they hold
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8,
    "axes.titlesize": 7.5,
    "axes.labelsize": 8,
    "axes.linewidth": 0.6,
    "axes.edgecolor": "#444444",
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "xtick.labelcolor": "black",
    "ytick.labelcolor": "black",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "grid.color": "#e2e2e2",
    "grid.linewidth": 0.5,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "lines.markersize": 3.2,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.fonttype": "none",
    "svg.hashsalt": "heliosweep",
    "pdf.fonttype": 42,
}


def pixels(figure: Drawing) -> Image.Image:
    """Return a figure as pixels, without white margins."""
    with matplotlib.rc_context(_RC):
        figure.set_dpi(DPI)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    figure.set_canvas(FigureCanvasBase(figure))  # frees the buffer of the other canvas
    left, top, right, bottom = ImageChops.invert(picture).getbbox() or (0, 0, *picture.size)
    size = picture.size
    rim = (max(left - RIM, 0), max(top - RIM, 0), min(right + RIM, size[0]), min(bottom + RIM, size[1]))
    return picture.crop(rim)


def png(picture: Image.Image) -> bytes:
    """The bytes of a PNG file of some pixels."""
    buffer = io.BytesIO()
    picture.save(buffer, "PNG", dpi=(DPI, DPI))
    return buffer.getvalue()


def image(figure: Drawing, kind: str = "png") -> bytes:
    """Return a figure as the bytes of an image file; the same figure gives the same bytes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Figure.
    kind : {"png", "svg", "pdf"}
        File format. In the vector formats, only maps with many small shapes are pixels.
    """
    if kind == "png":
        return png(pixels(figure))
    buffer = io.BytesIO()
    date = {"svg": "Date", "pdf": "CreationDate"}[kind]
    with matplotlib.rc_context(_RC):
        figure.savefig(buffer, format=kind, dpi=DPI, bbox_inches="tight", metadata={date: None})
    return buffer.getvalue()
