"""Images of declared figures with matplotlib: curves, maps, pictures, heat maps and planes."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import cycle
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, Normalize
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure as Drawing
from matplotlib.patches import Patch, Polygon, Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, MaxNLocator

from heliosweep.report.colours import COLOURS, DASHES, DIFFERENCES, MARKERS, NO_VALUE, VALUES
from heliosweep.report.context import Context, Point, at, heading, is_geometric
from heliosweep.report.figures import (
    FIELD,
    HELIOSTAT,
    STATISTICS,
    Curves,
    Figure,
    Grids,
    Maps,
    NamedFigure,
    Planes,
    Rasters,
    Special,
    axis_of,
    is_joined,
    is_ordered,
    reduced,
    usable,
)
from heliosweep.report.labels import (
    LETTERS,
    axis_label,
    fold,
    is_latitude,
    is_signed,
    latitude_text,
    number_text,
    printed,
    title_of,
    unit_of,
)
from heliosweep.report.shapes import aperture, areas, mirrors
from heliosweep.report.style import style

#: Number of figures of one result, of lines of a panel, of panels, and of pictures in a row.
MOST_FIGURES, MOST_LINES, MOST_PANELS, COLUMNS = 12, 7, 6, 3
#: Width of a figure with several panels and with one. [inch]
WIDE, SINGLE = 7.2, 4.8
#: Number of points from which on lines have no markers.
MARKED = 40
#: Letters of the title of a panel over its width in inches.
TITLE_LETTERS = 14
#: Share of the values inside a colour scale; a few extreme values have the colour of its end.
INSIDE = 0.995
#: Size of the spots over half the aperture below which the panel shows the spots alone.
SMALL_SPOT = 0.05
#: Range of heights from which on contour lines are drawn. [m]
HILLY = 1.0
_AREAS: dict[str, dict[str, Any]] = {
    "boundary": {"facecolor": "none", "edgecolor": "#222222", "linewidth": 0.9, "linestyle": (0, (5, 2))},
    "no heliostats": {"facecolor": "none", "edgecolor": "#888888", "linewidth": 0.7, "hatch": "////"},
}


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

    Notes
    -----
    An error while drawing has a note with the name of the figure. The next figure can be drawn after an error.
    """
    return _Drawing(result, figures, most)


class _Drawing(Iterator[NamedFigure]):
    """Iterator that survives an error of one figure, which a generator does not."""

    def __init__(self, result: xr.Dataset, figures: Iterable[Figure], most: int) -> None:
        self.result, self.figures, self.left = result, iter(figures), most
        self.waiting: list[NamedFigure] = []

    def __next__(self) -> NamedFigure:
        while not self.waiting:
            figure = next(self.figures)
            if figure.image and self.left > 0:
                try:
                    self.waiting = _drawn(self.result, figure)[: self.left]
                except Exception as error:
                    error.add_note(f"The figure {figure.name}")
                    raise
        self.left -= 1
        return self.waiting.pop(0)


def _drawn(result: xr.Dataset, figure: Figure) -> list[NamedFigure]:
    result = reduced(result, figure)
    known = usable(result, figure)
    if known is None:
        return []
    with style():
        if isinstance(known, Special):
            assert known.draw is not None
            made = known.draw(result)
            if made is None:
                return []
            drawing, more = made if isinstance(made, tuple) else (made, "")
            return [NamedFigure(known.name, _caption(known, more), drawing)]
        forms: dict[type, Any] = {Curves: _curves, Maps: _maps, Rasters: _rasters, Grids: _grids, Planes: _planes}
        return list(forms[type(known)](Context(result, known.at), known))


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
        Whether a single panel takes the width of a page.
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


def legend(drawing: Drawing, entries: Mapping[str, Any], title: str = "") -> None:
    """Write a legend above all panels."""
    if len(entries) > 1 or any(entries):
        names = [textwrap.fill(name, LETTERS) for name in entries]
        longest = max(len(line) for name in names for line in name.split("\n"))
        columns = max(1, min(len(names), int(drawing.get_figwidth() * 15 / (longest + 6))))
        drawing.legend(list(entries.values()), names, loc="outside upper center", ncols=columns, title=title or None)


def abreast(count: int, most: int = COLUMNS) -> int:
    """Return the number of panels in a row with which rows are as even as possible."""
    return -(-count // -(-count // most)) if count else 1


def tick(axis: Axis, coordinate: xr.DataArray, logarithmic: bool = False, most: int = 6) -> None:
    """Set the ticks of an axis along a coordinate."""
    if coordinate.dtype.kind == "M":
        locator = AutoDateLocator(minticks=3, maxticks=most)
        axis.set_major_locator(locator)
        axis.set_major_formatter(ConciseDateFormatter(locator, show_offset=False))
    elif logarithmic:
        plain = FuncFormatter(lambda value, _: f"{value:g}")
        axis.set_major_formatter(plain)
        low, high = sorted(axis.get_view_interval())
        axis.set_minor_formatter(plain if 0 < high < 10 * low else FuncFormatter(lambda *_: ""))
    else:
        values = coordinate.to_numpy()
        turn = str(coordinate.attrs.get("units", "")).startswith("degree") and np.ptp(values) > 60
        if is_latitude(coordinate):
            axis.set_major_formatter(FuncFormatter(lambda value, _: latitude_text(round(value, 6))))
        whole = bool(np.ptp(values) <= most and not np.any(values % 1))
        axis.set_major_locator(MaxNLocator(most, steps=[1, 1.5, 3, 4.5, 9, 10] if turn else None, integer=whole))


def _curves(context: Context, figure: Curves) -> Iterator[NamedFigure]:
    """Draw curves: variables with the same axis share a figure."""
    result = context.result
    first = result[figure.variables[0]]
    axis = axis_of(result, first, figure)
    assert axis is not None
    names = [name for name in figure.variables if axis_of(result, result[name], figure) == axis]
    names = ([name for name in names if _varies(result[name], axis)] or names)[: figure.most]
    first = result[names[0]]
    rest = [str(dim) for dim in first.dims if dim != axis and first.sizes[dim] > 1]
    line = _preferred(result, rest, figure.lines)
    panel = (
        _preferred(result, [dim for dim in rest if dim != line], figure.panels, figure.panels)
        if len(names) < 3
        else None
    )
    fixed: dict[str, int] = {}
    for name in reversed(names):
        fixed |= context.fixed(result[name], axis, line, panel)
    most = len(STATISTICS) if line == "statistic" else MOST_LINES
    lines, places = context.chosen(line, most), context.chosen(panel, max(1, figure.most // len(names)))
    if not lines or not places:
        return
    shown = [(name, place) for name in names for place in places]
    columns = len(places) if len(names) > 1 and 1 < len(places) <= COLUMNS else 2 if len(shown) != 3 else 3
    coordinate = context.coordinate(axis)
    words = (
        []
        if is_ordered(result, axis) and axis not in ("month",)
        else [context.value(axis, i) for i in range(coordinate.size)]
    )
    entries: dict[str, Any] = {}
    wide = sum(map(len, words)) > 60
    drawing, grid = panels(
        len(shown), 1 if wide and words else columns, 0.45 if wide else 0.62, wide=wide, sharex=not words
    )
    looks = _looks([context.values(point) for point in lines], figure.looks, bool(line and is_ordered(result, line)))
    any_value = False
    for axes, (name, place) in zip(grid, shown, strict=True):
        array = result[name]
        for point in lines:
            values = at(array, fixed, place, point)
            if values.dims != (axis,):
                continue
            label = context.values(point)
            band = [at(result[end], fixed, place, point) for end in _band(result, figure, name)]
            any_value |= _line(axes, context, values, band, looks[label], words, axis, entries, label)
        axes.set_ylabel(fold(axis_label(array), 30 if len(grid) > 1 else LETTERS))
        axes.set_title(fold(context.fulls(place), int(TITLE_LETTERS * WIDE / columns)))
        axes.grid(True, axis="y" if words else "both")
        _scale(axes, array, figure.logarithmic)
        if words:
            turned = columns * sum(map(len, words)) > 60
            axes.set_xticks(range(len(words)), [fold(word, 24) for word in words], rotation=90 if turned else 0)
        else:
            logarithmic = is_geometric(coordinate.to_numpy())
            axes.set_xscale("log" if logarithmic else "linear")
            tick(axes.xaxis, coordinate, logarithmic, 6 if columns < 3 else 4)
    for axes in grid[-columns:] if not words else grid:
        axes.set_xlabel(fold(context.label(axis), 78 // max(columns, 2)))
    if not any_value:
        return
    legend(drawing, entries, context.title(line) if line and is_ordered(result, line) else "")
    yield NamedFigure(figure.name, _caption(figure, context.note(fixed, lines, places)), drawing)


def _varies(array: xr.DataArray, axis: str) -> bool:
    """Return False if a small array is the same all along an axis, but for rounding."""
    if array.size > 200_000 or array.dtype.kind == "M":
        return True
    low, high = array.min(axis), array.max(axis)
    return bool((np.abs(high - low) > 1e-6 * np.abs(high)).any()) or not bool(array.notnull().any())


def _preferred(result: xr.Dataset, dims: Sequence[str], wanted: Sequence[str], only: Sequence[str] = ()) -> str | None:
    """Return the first of the wanted dimensions, else the first of words, else the first."""
    dims = [dim for dim in dims if dim in only] if only else [
        dim for dim in dims if dim != HELIOSTAT or result.sizes[dim] < FIELD
    ]  # fmt: skip
    for dim in (*wanted, "statistic", *(dim for dim in dims if not is_ordered(result, dim)), *dims):
        if dim in dims:
            return dim
    return None


def _band(result: xr.Dataset, figure: Curves, name: str) -> Sequence[str]:
    """Return the variables with the ends of a band about a variable, or its standard error."""
    for pair in (figure.bands.get(name, ()), (f"{name}_error",), (f"{name}_standard_error",)):
        if pair and all(end in result and set(result[end].dims) <= set(result[name].dims) for end in pair):
            return pair
    return ()


def _looks(names: Sequence[str], special: Mapping[str, Mapping[str, Any]], ordered: bool) -> dict[str, dict[str, Any]]:
    """Return colour, dashes and marker of each line; lines along numbers go from dark to light."""
    scale = colormaps[VALUES](np.linspace(0.0, 0.85, len(names)))
    colours = scale if ordered and len(names) > 2 else COLOURS
    dashes = ("-",) if ordered else DASHES
    return {
        name: {"color": colour, "linestyle": dash, "marker": marker, **special.get(name, {})}
        for name, colour, dash, marker in zip(names, cycle(colours), cycle(dashes), cycle(MARKERS), strict=False)
    }


def _line(
    axes: Axes,
    context: Context,
    values: xr.DataArray,
    band: Sequence[xr.DataArray],
    look: dict[str, Any],
    words: Sequence[str],
    axis: str,
    entries: dict[str, Any],
    label: str,
) -> bool:
    """Draw a line, or points over words, with its band; return True if it has a value."""
    order = context.order(axis)
    y = np.asarray(printed(values))[order]
    known = ~np.isnat(y) if y.dtype.kind == "M" else np.isfinite(y)
    if not known.any():
        return False
    joined = not words and is_joined(context.result, axis) and y.dtype.kind != "M"
    x = np.arange(y.size) if words else context.coordinate(axis).to_numpy()[order]
    if words:
        x = x + 0.12 * (
            len(entries if label not in entries else list(entries)[: list(entries).index(label)]) % 5 - 2
        ) * bool(label)
    look = dict(look) if joined or (words and axis == "month") else {**look, "linestyle": ""}
    if joined and y.size > MARKED:
        look["marker"] = ""
    if band:
        ends = [np.asarray(printed(end, values), dtype=float)[order] for end in band]
        low, high = (y - ends[0], y + ends[0]) if len(ends) == 1 else ends
        if joined:
            axes.fill_between(x, low, high, color=look["color"], alpha=0.2, linewidth=0)
        else:
            axes.errorbar(x, y, np.abs([y - low, high - y]), fmt="none", ecolor=look["color"], elinewidth=1, capsize=2)
    (entries[label],) = axes.plot(x, y, **look)
    if y.dtype.kind == "M":
        tick(axes.yaxis, values)
    return True


def _scale(axes: Axes, array: xr.DataArray, logarithmic: bool) -> None:
    """Set a vertical axis: logarithmic on request, else with a minimum height above rounding errors."""
    if array.dtype.kind == "M":
        return
    low, high = axes.dataLim.y0, axes.dataLim.y1
    if logarithmic and low > 0:
        axes.set_yscale("log")
        tick(axes.yaxis, array, True)
    elif np.isfinite([low, high]).all() and high - low < 1e-3 * max(abs(low), abs(high)):
        middle, half = (low + high) / 2, max(abs(low), abs(high), 1e-9) / 1000
        axes.set_ylim(middle - half, middle + half)


def shades(maps: Sequence[np.ndarray], palette: str = "", about_zero: bool = False) -> tuple[Normalize, Colormap, str]:
    """Return scale, colours and open ends of a colour bar for the values of some maps.

    Values of both signs have colours that differ about zero.
    """
    every = np.concatenate([one[np.isfinite(one)] for one in maps] or [np.empty(0)])
    if not every.size:
        every = np.array([0.0, 1.0])
    low, high = (float(end) for end in np.quantile(every, [1 - INSIDE, INSIDE]))
    if high - low < 1e-6 * max(abs(low), abs(high), 1e-12):
        low, high = low - max(abs(low), 1e-6) / 1000, high + max(abs(high), 1e-6) / 1000
    if about_zero or (not palette and is_signed(low, high)):
        high = max(-low, high)
        low, palette = -high, DIFFERENCES
    beyond = (every.min() < low - 0.02 * (high - low), every.max() > high + 0.02 * (high - low))
    extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get(beyond, "neither")
    return Normalize(low, high), colormaps[palette or VALUES].with_extremes(bad=NO_VALUE), extend


def colour_bar(
    drawing: Drawing, axes: Sequence[Axes], norm: Normalize, colours: Colormap, label: str, extend: str = "neither"
) -> None:
    """Draw a colour bar below axes."""
    options: Any = {"ax": list(axes), "location": "bottom", "extend": extend, "aspect": 40, "shrink": 0.8, "pad": 0.03}
    bar = drawing.colorbar(
        ScalarMappable(norm, colours),
        label=fold(label, 70 if len(axes) > 1 else 70 // len(drawing.axes[:COLUMNS])),
        **options,
    )
    bar.outline.set_linewidth(0.5)
    bar.locator = MaxNLocator(6 if len(axes) > 1 else 4)
    bar.update_ticks()


def _points(
    context: Context, figure: Figure, array: xr.DataArray, *inner: str
) -> tuple[list[dict[str, int]], dict[str, int], int, str]:
    """Return the points of pictures, the fixed positions, the number of columns, and the sentence for the caption."""
    dims = [str(dim) for dim in array.dims if dim not in inner and array.sizes[dim] > 1]
    across = _preferred(context.result, dims, figure.panels)
    rest = [dim for dim in dims if dim != across]
    several = len(figure.variables) > 1 and HELIOSTAT not in inner  # variables are rows
    down = None if several else _preferred(context.result, rest, figure.lines)
    fixed = context.fixed(array, *inner, across, down)
    rows = context.chosen(down, 3)
    columns = context.chosen(across, 4 if down else 6, at(array, fixed) if HELIOSTAT not in inner else None)
    points = [{**row, **column} for row in rows for column in columns]
    note = context.note(fixed, rows, columns)
    return points, fixed, len(columns) if down else abreast(len(columns)), note


def _maps(context: Context, figure: Maps) -> Iterator[NamedFigure]:
    """Draw maps of the first variable at the points of the sweep, or of each variable at one point."""
    result, array = context.result, context.result[figure.variables[0]]
    if figure.each:
        names = [name for name in figure.variables if result[name].dims == array.dims][:MOST_PANELS]
        fixed = context.fixed(array, HELIOSTAT)
        arrays = {name: _map_values(result[name], fixed) for name in names}
        arrays = {
            name: values
            for name, values in arrays.items()
            if np.nanmax(values, initial=-np.inf) > np.nanmin(values, initial=np.inf)
        }
        if not arrays:
            return
        drawing, grid = panels(len(arrays), abreast(len(arrays)), 0.9, layout="compressed", sharex=True, sharey=True)
        for axes, (name, shown) in zip(grid, arrays.items(), strict=True):
            norm, colours, extend = shades([shown], figure.palette)
            field_map(axes, result.isel(_within(result, fixed)), shown, norm, colours)
            axes.set_title(_mean(shown, unit_of(result[name])))
            colour_bar(drawing, [axes], norm, colours, axis_label(result[name]), extend)
        yield NamedFigure(figure.name, _caption(figure, _SYMBOLS, context.note(fixed)), drawing)
        return
    points, fixed, columns, note = _points(context, figure, array, HELIOSTAT)
    values = [_map_values(array, {**fixed, **point}) for point in points]
    if not any(np.isfinite(one).any() for one in values):
        return
    same_places = HELIOSTAT not in result.sizes or all(result[side].ndim == 1 for side in "xy")
    if same_places and len(values) > 1 and all(np.array_equal(one, values[0], equal_nan=True) for one in values):
        values, points, columns = values[:1], [{}], 1
    label = axis_label(array)
    yield _map_sheet(context, figure, figure.name, values, points, fixed, columns, label, note)
    dim = figure.less
    if array.sizes.get(dim, 0) > 1 and any(dim in point for point in points):
        first = [(one, point) for one, point in zip(values, points, strict=True) if point.get(dim) == 0]
        others = [(one, point) for one, point in zip(values, points, strict=True) if point.get(dim, 0) > 0]
        bare = [{key: i for key, i in point.items() if key != dim} for _, point in first]
        pairs = [
            (first[bare.index({k: i for k, i in point.items() if k != dim})][0] - one, point) for one, point in others
        ]
        unit, word = unit_of(array).replace("%", "percentage points"), context.value(dim, 0)
        label = f"{word} minus {context.value(dim, others[0][1][dim])} ({unit})"
        more = replace(figure, title=f"Difference of the {title_of(array)}: red if {word} is higher")
        values = [one for one, _ in pairs]
        points = [{k: i for k, i in point.items() if k != dim or len(others) > len(first)} for _, point in pairs]
        name, columns = f"{figure.name}_differences", abreast(len(pairs))
        yield _map_sheet(context, more, name, values, points, fixed, columns, label, note, True)


_SYMBOLS = "Each square is a mirror with a side towards the tower (triangle)."


def _map_values(array: xr.DataArray, point: Point) -> np.ndarray:
    return np.asarray(printed(at(array, point)), dtype=float)


def _within(result: xr.Dataset, point: Point) -> dict[str, int]:
    return {dim: index for dim, index in point.items() if dim in result.dims}


def _map_sheet(
    context: Context,
    figure: Maps,
    name: str,
    values: Sequence[np.ndarray],
    points: Sequence[Point],
    fixed: Point,
    columns: int,
    label: str,
    note: str,
    about_zero: bool = False,
) -> NamedFigure:
    """Draw maps on one colour scale."""
    norm, colours, extend = shades(values, figure.palette, about_zero)
    drawing, grid = panels(len(values), columns, 0.9, layout="compressed", sharex=True, sharey=True)
    unit = unit_of(context.result[figure.variables[0]])
    for axes, one, point in zip(grid, values, points, strict=True):
        field_map(axes, context.result.isel(_within(context.result, {**fixed, **point})), one, norm, colours)
        words = fold(context.fulls(point), int(TITLE_LETTERS * WIDE / max(columns, 2)))
        axes.set_title("\n".join(filter(None, [words, _mean(one, unit)])))
    label_outside(grid, columns, "east (m)", "north (m)")
    colour_bar(drawing, grid, norm, colours, label, extend)
    missing = "" if all(np.isfinite(one).all() for one in values) else "Grey: no value."
    return NamedFigure(name, _caption(figure, _SYMBOLS, missing, note), drawing)


def label_outside(grid: Sequence[Axes], columns: int, x: str, y: str) -> None:
    """Label the first panels of each row and the last ones of each column."""
    for index, axes in enumerate(grid):
        axes.set(xlabel=x if index + columns >= len(grid) else "", ylabel=y if index % columns == 0 else "")
        axes.tick_params(labelbottom=index + columns >= len(grid), labelleft=index % columns == 0)


def _mean(values: np.ndarray, unit: str) -> str:
    known = values[np.isfinite(values)]
    if not known.size:
        return "no value"
    mean = float(known.mean())
    digits = max(0, 3 - (math.floor(math.log10(abs(mean))) if mean else 0) - 1)
    return f"mean {number_text(mean, min(digits, 6))} {unit}".rstrip()


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
        for number, ring in enumerate(rings):
            axes.add_patch(Polygon(ring, label="" if number else name, **_AREAS[name]))
    z = here["z"].to_numpy() if "z" in here.coords and here["z"].dims == (HELIOSTAT,) else np.zeros(x.size)
    if placed.any() and np.ptp(z[placed]) >= HILLY:
        with suppress(RuntimeError, ValueError):  # mirrors in one line have no ground between them
            lines = axes.tricontour(x[placed], y[placed], z[placed], 5, colors="#333333", linewidths=0.5)
            axes.clabel(lines, fontsize=5.5, fmt=lambda level: f"{level:g} m")
    axes.plot(0, 0, "^", color="black", markersize=5, markeredgecolor="white", markeredgewidth=0.6)
    axes.set_aspect("equal", "datalim" if axes.get_shared_x_axes().get_siblings(axes) == [axes] else "box")
    axes.autoscale_view()


def _rasters(context: Context, figure: Rasters) -> Iterator[NamedFigure]:
    """Draw pictures on one colour scale; variables of the same dimensions are rows."""
    result, array = context.result, context.result[figure.variables[0]]
    points, fixed, columns, note = _points(context, figure, array, *figure.over)
    same = [name for name in figure.variables if result[name].dims == array.dims]
    names = same[: max(1, 8 // len(points))] if not figure.kinds else same[:1]
    shown = [(name, point) for name in names for point in points]
    if len(names) > 1:
        columns = len(points) if len(points) > 1 else abreast(len(names), 2)
    pictures = [
        at(result[name], fixed, point).transpose(*figure.over).sortby(list(figure.over)) for name, point in shown
    ]
    values = [np.asarray(printed(one), dtype=float) for one in pictures]
    if not any(np.isfinite(one).any() for one in values):
        return
    norm: Normalize
    if figure.kinds:
        codes = sorted(figure.kinds)
        norm = BoundaryNorm([codes[0] - 0.5, *(code + 0.5 for code in codes)], len(codes))
        colours: Colormap = ListedColormap([figure.kinds[code][1] for code in codes]).with_extremes(bad=NO_VALUE)
        extend = "neither"
    else:
        norm, colours, extend = shades(values, figure.palette)
    up, right = (context.coordinate(dim) for dim in figure.over)
    equal = unit_of(up) == unit_of(right)
    sides = [edges(np.sort(side.to_numpy())) for side in (right, up)]
    height = float(np.clip(np.ptp(sides[1]) / np.ptp(sides[0]), 0.3, 1.5)) if equal else 0.6
    drawing, grid = panels(len(shown), columns, height, layout="compressed", sharex=True, sharey=True)
    for axes, one, (name, point) in zip(grid, values, shown, strict=True):
        axes.pcolormesh(*sides, np.ma.masked_invalid(one), cmap=colours, norm=norm, rasterized=True)
        _outline_modules(axes, result, first=axes is grid[0])
        words = [heading(result[name]) if len(names) > 1 else "", context.fulls(point)]
        axes.set_title(fold("\n".join(filter(None, words)), int(TITLE_LETTERS * WIDE / max(columns, 2))))
        axes.set_facecolor(NO_VALUE)
        if equal:
            axes.set_aspect("equal")
    label_outside(
        grid, min(columns, len(grid)), fold(context.label(figure.over[1]), 26), fold(context.label(figure.over[0]), 26)
    )
    if figure.kinds:
        there = {int(code) for one in values for code in np.unique(one[np.isfinite(one)])}
        entries = {
            word: Patch(facecolor=colour, edgecolor="#666666")
            for code, (word, colour) in figure.kinds.items()
            if code in there
        }
        legend(drawing, entries)
    else:
        colour_bar(drawing, grid, norm, colours, axis_label(array), extend)
    yield NamedFigure(figure.name, _caption(figure, note), drawing)


def _outline_modules(axes: Axes, result: xr.Dataset, first: bool) -> None:
    """Draw the modules of a mirror with their numbers, if the result has them."""
    names = [f"module_{side}" for side in ("y", "z", "width", "height")]
    if (
        not all(name in result.coords and result[name].dims == ("module",) for name in names)
        or "module" not in result.coords
    ):
        return
    rows = np.stack([result[name].to_numpy() for name in names], axis=-1)
    for number, (y, z, wide, high) in zip(result["module"].to_numpy(), rows, strict=True):
        axes.add_patch(
            Rectangle((y - wide / 2, z - high / 2), wide, high, fill=False, edgecolor="#333333", linewidth=0.5)
        )
        if first:
            halo = [withStroke(linewidth=1.6, foreground="white")]
            axes.text(y, z, f"{number:g}", ha="center", va="center", fontsize=6.5, path_effects=halo)


def edges(values: np.ndarray, logarithmic: bool = False) -> np.ndarray:
    """Return the edges of cells with the given rising middles."""
    values = np.log(values) if logarithmic else np.asarray(values, dtype=float)
    half = np.diff(values) / 2 if values.size > 1 else np.array([0.5])
    ends = np.concatenate([[values[0] - half[0]], values[:-1] + half[: values.size - 1], [values[-1] + half[-1]]])
    return np.exp(ends) if logarithmic else ends


def _grids(context: Context, figure: Grids) -> Iterator[NamedFigure]:
    """Draw heat maps over two dimensions, each with its own colours."""
    result, first = context.result, context.result[figure.variables[0]]
    down, across = [dim for dim in figure.over if first.sizes.get(dim, 0) > 1][:2]
    if first.sizes[down] > first.sizes[across]:
        down, across = across, down
    names = [name for name in figure.variables if {down, across} <= set(result[name].dims)][:3]
    fixed = context.fixed(first, down, across)
    drawing, grid = panels(len(names), len(names), 0.85)
    places, words = {}, {}
    for dim in (down, across):
        coordinate = context.coordinate(dim).to_numpy()[context.order(dim)]
        numbers = is_ordered(result, dim) and coordinate.dtype.kind in "fiu"
        words[dim] = [] if numbers else [context.value(dim, i) for i in context.order(dim)]
        logarithmic = bool(numbers and is_geometric(coordinate))
        places[dim] = edges(coordinate if numbers else np.arange(coordinate.size), logarithmic), logarithmic
    for axes, name in zip(grid, names, strict=True):
        part = at(result[name], context.fixed(result[name], down, across)).transpose(down, across)
        values = np.asarray(printed(part), dtype=float)[np.ix_(context.order(down), context.order(across))]
        norm, colours, extend = shades([values])
        axes.pcolormesh(
            places[across][0], places[down][0], np.ma.masked_invalid(values), cmap=colours, norm=norm, rasterized=True
        )
        axes.set_facecolor(NO_VALUE)
        for axis, dim in ((axes.xaxis, across), (axes.yaxis, down)):
            if words[dim]:
                step = -(-len(words[dim]) // 20)
                axis.set_ticks(range(0, len(words[dim]), step), words[dim][::step], rotation=90 if dim == across else 0)
            else:
                axes.set(**{f"{axis.axis_name}scale": "log" if places[dim][1] else "linear"})
                tick(axis, context.coordinate(dim), places[dim][1], 5)
        colour_bar(drawing, [axes], norm, colours, axis_label(result[name]), extend)
    label_outside(grid, len(grid), fold(context.label(across)), fold(context.label(down)))
    yield NamedFigure(figure.name, _caption(figure, context.note(fixed)), drawing)


def _planes(context: Context, figure: Planes) -> Iterator[NamedFigure]:
    """Draw paths of points in planes with equal axes, a panel for each value of a dimension."""
    result, name = context.result, figure.variables[0]
    up, right = result[name], result[figure.against[name]]
    dims = [str(dim) for dim in up.dims if up.sizes[dim] > 1]
    paths = [dim for dim in figure.over if dim in dims][: None if figure.dots else 1]
    path = paths[0] if paths else None
    line = next((dim for dim in figure.lines if dim in dims and dim not in paths), None)
    inner = [dim for dim in figure.lines if dim in dims and dim not in (*paths, line)][:1]
    taken = (*paths, line, *inner)
    panel = next((dim for dim in (*figure.panels, HELIOSTAT) if dim in dims and dim not in taken), None)
    colour = figure.colour if figure.colour in dims else None
    fixed = context.fixed(up, line, panel, colour, *paths, *inner)
    places, lines = context.chosen(panel, MOST_PANELS, at(up, fixed)), context.chosen(line, MOST_LINES)
    if panel == HELIOSTAT and figure.worst in result:
        order = np.argsort(-at(result[figure.worst], fixed).fillna(-np.inf).to_numpy(), kind="stable")
        places = [{HELIOSTAT: int(i)} for i in order[:MOST_PANELS]]
    more = context.chosen(inner[0], 3) if inner else [{}]
    if not places or not lines:
        return
    columns = abreast(len(places))
    drawing, grid = panels(len(places), columns, 1.0, layout="compressed")
    looks = _looks([context.values(point) for point in lines], figure.looks, bool(line and is_ordered(result, line)))
    norm, colours = None, None
    if colour:
        hues = context.coordinate(colour)
        norm, colours = Normalize(float(hues.min()), float(hues.max())), colormaps[VALUES]
    entries: dict[str, Any] = {}
    drawn = False
    for axes, place in zip(grid, places, strict=True):
        frame: list[np.ndarray] = []
        for point, other in ((point, other) for point in lines for other in more):
            pair = [at(one, fixed, place, point, other).astype(float) for one in (right, up)]
            label, look = context.values(point), dict(looks[context.values(point)])
            if path is not None:
                pair = [one.isel({path: context.order(path)}) for one in pair]
            pair[1] = pair[1].transpose(*pair[0].dims)
            x, y = map(np.ravel, pair)
            known = np.isfinite(x) & np.isfinite(y)
            if not known.any():
                continue
            drawn = True
            frame.append(np.stack([x, y], axis=-1)[known])
            if figure.dots or path is None or x.size == 1:
                look["linestyle"] = ""
            if x.size > MARKED:
                look["marker"] = "." if figure.dots else ""
            if colour and norm is not None:
                hue = context.coordinate(colour).broadcast_like(pair[0]).transpose(*pair[0].dims).to_numpy().ravel()
                axes.plot(x, y, color="#666666", linewidth=0.6, linestyle=look["linestyle"] if colour == path else "")
                entries_of = axes.scatter(
                    x, y, 10, hue, norm=norm, cmap=colours, linewidths=0, marker=look["marker"] or "o", zorder=3
                )
                if label and colour != path:
                    entries[label] = entries_of
                elif label:
                    axes.annotate(label, (x[known][-1], y[known][-1]), (3, 3), textcoords="offset points", fontsize=6)
            else:
                (entries[label],) = axes.plot(x, y, **look)
                if more != [{}] and label:
                    axes.annotate(
                        context.values(other),
                        (x[known][-1], y[known][-1]),
                        (3, 3),
                        textcoords="offset points",
                        fontsize=6,
                    )
        axes.plot(0, 0, "+", color="black", markersize=6, markeredgewidth=0.8)
        size = aperture(result, {**fixed, **place})
        if size:
            rest: Any = {"facecolor": "#ededed", "edgecolor": "#333333", "linewidth": 0.9, "zorder": 0.6}
            axes.add_patch(Rectangle((-size[0] / 2, -size[1] / 2), *size, **rest))
        frame_square(axes, frame, size)
        if figure.extra is not None:
            figure.extra(axes, result, {**fixed, **place})
        axes.set_title(fold(context.fulls(place), int(TITLE_LETTERS * WIDE / max(columns, 2))))
        axes.grid(True)
    if not drawn:
        return
    for index, axes in enumerate(grid):
        axes.set_xlabel(_side(right) if index + columns >= len(grid) else "")
        axes.set_ylabel(_side(up) if index % columns == 0 else "")
    legend(drawing, entries, context.title(line) if line and is_ordered(result, line) else "")
    if colour and norm is not None and colours is not None:
        colour_bar(drawing, grid, norm, colours, context.label(colour))
    yield NamedFigure(figure.name, _caption(figure, context.note(fixed, places, lines)), drawing)


def _side(array: xr.DataArray) -> str:
    unit = unit_of(array)
    return f"{'to the right' if '_y' in str(array.name) else 'up'}{f' ({unit})' if unit else ''}"


def frame_square(axes: Axes, tracks: Sequence[np.ndarray], size: tuple[float, float] | None = None) -> None:
    """Make axes square about the origin, an aperture and all points but a few distant ones."""
    points = np.concatenate([np.zeros((1, 2)), *tracks])
    far = np.hypot(*points.T)
    corner = np.array(size or (0.0, 0.0)) / 2
    limit = max(3.0 * float(np.quantile(far, 0.9)), 8.0 * float(np.hypot(*corner)), 1e-9)
    near = points[far <= limit]
    if np.ptp(near, axis=0).max() > SMALL_SPOT * corner.max():
        near = np.concatenate([near, [-corner, corner]])
    low, high = near.min(axis=0), near.max(axis=0)
    half = max(float((high - low).max()) / 2 * 1.14, 1e-6)
    middle = (low + high) / 2
    axes.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half), aspect="equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(4))
