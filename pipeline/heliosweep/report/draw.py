"""Draw declared figures (curves, maps, pictures, heat maps and planes) with matplotlib."""

from __future__ import annotations

import io
import itertools
import os
import textwrap
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import matplotlib
import numpy as np
import xarray as xr
from matplotlib import cm, collections, colormaps, dates, patches, patheffects, ticker
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, Normalize
from matplotlib.figure import Figure as Drawing
from PIL import Image, ImageChops

from heliosweep.files import write_whole
from heliosweep.report.figures import (
    COLOURS,
    DASHES,
    DIFFERENCES,
    HELIOSTAT,
    LETTERS,
    MARKERS,
    MOST_FIGURES,
    NO_VALUE,
    VALUES,
    Coloured,
    Context,
    Curves,
    Figure,
    Grids,
    Maps,
    Planes,
    Point,
    Rasters,
    Special,
    aperture,
    areas,
    at,
    axes_of,
    axis_label,
    capital,
    fold,
    is_geometric,
    is_joined,
    is_latitude,
    is_ordered,
    is_signed,
    latitude_text,
    mirrors,
    preferred,
    prepared,
    printed,
    title_of,
    unit_of,
)
from heliosweep.report.tables import number_texts
from heliosweep.store.folder import target_file

#: Maximum number of lines in a panel, panels in a figure, and panels in a row.
MOST_LINES, MOST_PANELS, COLUMNS = 7, 6, 3
#: Widths of figures with several panels and with one panel. [inch]
WIDE, SINGLE = 7.2, 4.8
#: Maximum number of points in a line that is drawn with markers.
MARKED = 40
#: Number of characters per inch in panel titles.
TITLE_LETTERS = 15
_AREAS: dict[str, dict[str, Any]] = {
    "boundary": {"facecolor": "none", "edgecolor": "#222222", "linewidth": 0.9, "linestyle": (0, (5, 2))},
    "no heliostats": {"facecolor": "none", "edgecolor": "#888888", "linewidth": 0.7, "hatch": "////"},
}


@dataclass(frozen=True, repr=False)
class NamedFigure:
    """Drawn figure with its file name and caption. Notebooks show the figure as an image.

    Parameters
    ----------
    name : str
        Name of the image file without suffix.
    caption : str
        Caption of the figure.
    figure : matplotlib.figure.Figure
        Matplotlib figure. It can be modified before it is saved.
    """

    name: str
    caption: str
    figure: Drawing

    def __repr__(self) -> str:
        return f"<figure {self.name}: {self.caption}>"

    def _repr_png_(self) -> bytes:
        return image(self.figure, "png")

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> Path:
        """Save the figure as a PNG, SVG or PDF file, depending on the suffix of the path.

        Parameters
        ----------
        path : path
            Output file, written atomically.
        force : bool
            If True, replace an existing file.

        Returns
        -------
        pathlib.Path
            Path of the file.

        Raises
        ------
        StudyError
            If the file exists, if the suffix is invalid, or if the folder does not exist.
        HeliosweepError
            If the file cannot be written.
        """
        file = target_file(path, force, endings=(".png", ".svg", ".pdf"))
        write_whole(file, image(self.figure, file.suffix[1:].lower()))
        return file


def draw(result: xr.Dataset, figures: Iterable[Figure], most: int = MOST_FIGURES) -> Iterator[NamedFigure]:
    """Draw declared figures one at a time.

    Parameters
    ----------
    result : Dataset
        Result. Only the values that a figure shows are read.
    figures : iterable of Figure
        Declarations of the figures.
    most : int
        Maximum number of figures.

    Yields
    ------
    NamedFigure
    """
    return itertools.islice(itertools.chain.from_iterable(drawn(result, figure) for figure in figures), most)


def drawn(result: xr.Dataset, figure: Figure) -> list[NamedFigure]:
    """Draw one declared figure. Returns an empty list if the result has no values for the figure."""
    result, shown = prepared(result, figure)
    if shown is None or not shown.image:
        return []
    with _lock, matplotlib.rc_context(_RC):
        if isinstance(shown, Special):
            made = shown.draw(result)
            drawing, more = made if isinstance(made, tuple) else (made, "")
            return [] if drawing is None else [NamedFigure(shown.name, _caption(shown, more), drawing)]
        form: Any = {Curves: _curves, Planes: _planes}.get(type(shown), _coloured)
        return list(form(Context(result, shown.at), shown, axes_of(result, shown, shown.variables[0])))


def _caption(figure: Figure, *more: str) -> str:
    title = figure.title if figure.title.endswith(".") else f"{figure.title}."
    return " ".join(filter(None, [title, figure.notes, *more]))


def panels(
    count: int, columns: int, height: float, *, wide: bool = False, **options: Any
) -> tuple[Drawing, list[Axes]]:
    """Return a figure with `count` panels and the axes of the panels, row by row.

    Parameters
    ----------
    count, columns : int
        Number of panels and maximum number of panels in a row.
    height : float
        Height of a panel divided by its width.
    wide : bool
        If True, a figure with one panel is as wide as the page.
    **options
        Options of `matplotlib.figure.Figure.subplots`. The additional option `layout` selects the layout engine of the
        figure.
    """
    columns = min(columns, count)
    rows = -(-count // columns)
    width = WIDE if columns > 1 or wide else SINGLE
    size = (width, min(rows * (height * width / columns + 0.55) + 0.5, 9.6))
    drawing = Drawing(figsize=size, layout=options.pop("layout", "constrained"))
    grid = drawing.subplots(rows, columns, squeeze=False, **options).ravel()
    for axes in grid[count:]:
        axes.remove()
    for axes in grid[:count]:
        axes.spines[:].set_in_layout(False)  # spines lie within the panel, and computing their extent is slow
    return drawing, list(grid[:count])


def abreast(count: int, most: int = COLUMNS) -> int:
    """Return the number of panels per row for rows of nearly equal length."""
    return -(-count // -(-count // most)) if count else 1


def legend(drawing: Drawing, entries: Mapping[str, Any], title: str = "") -> None:
    """Draw a legend above all panels."""
    if any(entries):
        names = [textwrap.fill(name, LETTERS) for name in entries]
        longest = max(len(line) for name in names for line in name.split("\n"))
        columns = max(1, min(len(names), int(drawing.get_figwidth() * 15 / (longest + 6))))
        drawing.legend(list(entries.values()), names, loc="outside upper center", ncols=columns, title=title or None)


def label_outside(grid: Sequence[Axes], columns: int) -> None:
    """Remove the inner axis labels from a grid of panels."""
    for index, axes in enumerate(grid):
        last, first = index + columns >= len(grid), index % columns == 0
        axes.set(**{} if last else {"xlabel": ""}, **{} if first else {"ylabel": ""})
        axes.tick_params(labelbottom=last, labelleft=first)


def set_ticks(axis: Axis, context: Context, dim: str, most: int = 6) -> None:
    """Set the scale and ticks of an axis that represents a dimension."""
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
            axis.set_major_formatter(ticker.FuncFormatter(lambda value, _: latitude_text(round(value, 6))))
        whole = bool(np.ptp(values) <= most and not np.any(values % 1))
        axis.set_major_locator(ticker.MaxNLocator(most, steps=[1, 1.5, 3, 4.5, 9, 10] if turn else None, integer=whole))


def _tick_dates(axis: Axis, most: int = 6) -> None:
    locator = dates.AutoDateLocator(minticks=3, maxticks=most)
    axis.set_major_locator(locator)
    axis.set_major_formatter(dates.ConciseDateFormatter(locator, show_offset=False))


def _tick_plain(axis: Axis) -> None:
    plain = ticker.FuncFormatter(lambda value, _: f"{value:g}")
    axis.set_major_formatter(plain)
    low, high = sorted(axis.get_view_interval())
    axis.set_minor_formatter(plain if 0 < high < 10 * low else ticker.FuncFormatter(lambda *_: ""))


def _curves(context: Context, figure: Curves, over: Sequence[str]) -> Iterator[NamedFigure]:
    result, (axis,) = context.result, over
    names, line, lines, places, fixed = _curves_chosen(context, figure, axis)
    shown, words = list(itertools.product(names, places)), context.along(axis)[1]
    crowded, ordered = sum(map(len, words)) > 60, bool(line and is_ordered(result, line))
    columns = len(places) if len(names) > 1 and 1 < len(places) <= COLUMNS else 3 if len(shown) == 3 else 2
    columns, height = (1, 0.45) if crowded else (columns, 0.62)
    drawing, grid = panels(len(shown), columns, height, wide=crowded, sharex=crowded or not words)
    looks = _looks([context.values(point) for point in lines], figure.looks, ordered)
    looks[""] = {"color": "#333333", "linestyle": "-", "marker": "o"}
    entries: dict[str, Any] = {}
    for axes, (name, place) in zip(grid, shown, strict=True):
        entries |= _lines(axes, context, figure, axis, name, {**fixed, **place}, lines, looks)
        if len(names) > 1 or axes in grid[::columns]:
            axes.set_ylabel(fold(axis_label(result[name]), 30))
        axes.set_title(fold(context.fulls(place), int(TITLE_LETTERS * WIDE / columns)))
        axes.grid(True)
        _scale(axes, result[name], figure.logarithmic)
        set_ticks(axes.xaxis, context, axis, 12 // max(columns, 2))
    if entries:
        for axes in grid[-columns:]:
            axes.set_xlabel(fold(context.label(axis), 78 // max(columns, 2)))
        entries.pop("", None)
        legend(drawing, entries, context.title(str(line)) if ordered else "")
        yield NamedFigure(figure.name, _caption(figure, context.note(fixed, lines, places)), drawing)


def _curves_chosen(
    context: Context, figure: Curves, axis: str
) -> tuple[list[str], str | None, list[dict[str, int]], list[dict[str, int]], dict[str, int]]:
    result = context.result
    names = [name for name in figure.variables if axes_of(result, figure, name) == [axis]]
    names = ([name for name in names if _varies(result[name], axis)] or names)[: figure.most]
    rest = [str(dim) for dim, size in result[names[0]].sizes.items() if dim != axis and size > 1]
    line = preferred(result, rest, figure.lines)
    others = [dim for dim in rest if dim != line and dim in (figure.panels or rest)]
    panel = preferred(result, others, figure.panels) if len(names) < 3 else None
    fixed = {dim: i for name in reversed(names) for dim, i in context.fixed(result[name], axis, line, panel).items()}
    places = context.chosen(panel, max(1, figure.most // len(names)))
    return names, line, context.chosen(line, MOST_LINES), places, fixed


def _lines(
    axes: Axes, context: Context, figure: Curves, axis: str, name: str, place: Point,
    lines: Sequence[Point], looks: Mapping[str, Mapping[str, Any]],
) -> dict[str, Any]:  # fmt: skip
    result, entries, order, (x, words) = context.result, dict[str, Any](), context.order(axis), context.along(axis)
    for number, point in enumerate(lines if set(lines[0]) <= set(result[name].dims) else [{}]):
        values, label = at(result[name], place, point), context.values(point)
        if values.dims != (axis,) or not values.notnull().any():
            continue
        joined = figure.styled or (is_joined(result, axis) and values.dtype.kind != "M")
        look = {**looks[label], **figure.looks.get("", {})}
        if not joined:
            look["linestyle"] = ""
        elif values.size > MARKED and not figure.styled:
            look["marker"] = ""
        along: Any = x + 0.12 * (number - (len(lines) - 1) / 2) if words and label and not joined else x
        ends = [at(result[end], place, point) for end in _band(result, figure, name)]
        y, *sides = (np.asarray(printed(one, values))[order] for one in (values, *ends))
        _draw_band(axes, along, y, sides, look["color"], joined)
        (entries[label],) = axes.plot(along, y, **look)
    return entries


def _varies(array: xr.DataArray, axis: str) -> bool:
    """Return False if an array is nearly constant along an axis. Large arrays are assumed to vary."""
    if array.size > 200_000 or array.dtype.kind == "M":
        return True
    values = np.ma.masked_invalid(np.moveaxis(array.to_numpy(), array.dims.index(axis), 0))
    low, high = values.min(0), values.max(0)
    return bool(np.ma.any(np.abs(high - low) > 3e-4 * np.abs(high))) or not values.count()


def _band(result: xr.Dataset, figure: Curves, name: str) -> Sequence[str]:
    dims, pairs = set(result[name].dims), (figure.bands.get(name, ()), (f"{name}_error",), (f"{name}_standard_error",))
    known = {name for name, one in result.data_vars.items() if set(one.dims) <= dims}
    return next((pair for pair in pairs if pair and set(pair) <= known), ())


def _looks(names: Sequence[str], special: Mapping[str, Mapping[str, Any]], ordered: bool) -> dict[str, dict[str, Any]]:
    """Return the colour, dash and marker of each line. Colours of ordered lines range from dark to light."""
    scale = colormaps[VALUES](np.linspace(0.0, 0.85, len(names)))
    colours, dashes = scale if ordered and len(names) > 2 else COLOURS, ("-",) if ordered else DASHES
    return {
        name: {"color": colour, "linestyle": dash, "marker": marker, **special.get(name, {})}
        for name, colour, dash, marker in zip(
            names, itertools.cycle(colours), itertools.cycle(dashes), itertools.cycle(MARKERS), strict=False
        )
    }


def _draw_band(axes: Axes, x: Any, y: np.ndarray, sides: Sequence[np.ndarray], colour: Any, joined: bool) -> None:
    """Draw a band along a line, or error bars at points.

    `sides` contains the lower and upper limits of the band, or its half-width. If `sides` is empty, no band is drawn.
    """
    low, high = sides if len(sides) == 2 else (y - sides[0], y + sides[0]) if sides else (y, y)
    if sides and joined:
        axes.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0)
    elif sides:
        axes.errorbar(x, y, np.abs([y - low, high - y]), fmt="none", ecolor=colour, elinewidth=1, capsize=2)


def _scale(axes: Axes, array: xr.DataArray, logarithmic: bool) -> None:
    """Set the scale of the vertical axis. The range of a linear scale always exceeds rounding errors."""
    low, high = axes.dataLim.y0, axes.dataLim.y1
    if array.dtype.kind == "M":
        _tick_dates(axes.yaxis)
    elif logarithmic and low > 0:
        axes.set_yscale("log")
        _tick_plain(axes.yaxis)
    elif np.isfinite([low, high]).all() and high - low < 1e-3 * max(abs(low), abs(high)):
        half = max(abs(low), abs(high), 1e-9) / 1000
        axes.set_ylim((low + high) / 2 - half, (low + high) / 2 + half)


def shades(
    maps: Sequence[np.ndarray], palette: str = "", kinds: Mapping[int, tuple[str, str]] | None = None
) -> tuple[Normalize, Colormap, str]:
    """Return the norm, colour map and pointed ends of a colour bar for maps.

    If the values have both signs, or if the palette is `DIFFERENCES`, the colours diverge from zero. If the values are
    codes, `kinds` contains the meaning and colour of each code.
    """
    if kinds:
        codes = sorted(kinds)
        listed = ListedColormap([kinds[code][1] for code in codes]).with_extremes(bad=NO_VALUE)
        return BoundaryNorm([codes[0] - 0.5, *(code + 0.5 for code in codes)], len(codes)), listed, "neither"
    every = np.concatenate([values[np.isfinite(values)] for values in maps])
    every = every if every.size else np.array([0.0, 1.0])
    low, high = (float(end) for end in np.quantile(every, [1 - 0.995, 0.995]))
    if high - low < 1e-6 * max(abs(low), abs(high), 1e-12):
        low, high = low - max(abs(low), 1e-6) / 1000, high + max(abs(high), 1e-6) / 1000
    if palette == DIFFERENCES or (not palette and is_signed(low, high)):
        low, high, palette = -max(-low, high), max(-low, high), DIFFERENCES
    beyond = (every.min() < low - 0.02 * (high - low), every.max() > high + 0.02 * (high - low))
    extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get(beyond, "neither")
    return Normalize(low, high), colormaps[palette or VALUES].with_extremes(bad=NO_VALUE), extend


def colour_bar(
    drawing: Drawing, axes: Sequence[Axes], norm: Normalize, colours: Colormap, extend: str, label: str
) -> None:
    """Draw a colour bar below the given axes."""
    letters = 70 if len(axes) > 1 else 78 // max(2, len(drawing.axes[:COLUMNS]))
    bar = drawing.colorbar(
        cm.ScalarMappable(norm, colours), ax=list(axes), label=fold(label, letters), location="bottom", extend=extend,
        aspect=40, shrink=0.8, pad=0.03,
    )  # fmt: skip
    bar.outline.set_linewidth(0.5)
    bar.locator = ticker.MaxNLocator(6 if len(axes) > 1 else 4)
    bar.update_ticks()


def _coloured(context: Context, figure: Coloured, over: Sequence[str]) -> Iterator[NamedFigure]:
    shown, fixed, columns, note = (_each_variable if figure.each else _each_point)(context, figure, over)
    if not any(np.isfinite(values).any() for *_, values in shown):
        return
    height, equal = _shape(context, figure, over)
    layout = ("constrained", "compressed")[equal]
    drawing, grid = panels(len(shown), columns, height, layout=layout, sharex=True, sharey=True)
    maps = [values for *_, values in shown]
    for axes, (name, point, values) in zip(grid, shown, strict=True):
        array = context.result[name]
        look = shades([values] if figure.each else maps, figure.palette, figure.kinds)
        _panel(axes, context, figure, over, {**fixed, **point}, values, look)
        axes.set_title(fold(_title(context, figure, array, point, values), int(TITLE_LETTERS * WIDE / max(columns, 2))))
        if figure.each or (axes is grid[0] and not figure.kinds):
            colour_bar(drawing, [axes] if figure.each else grid, *look, axis_label(context.result[name]))
    label_outside(grid, columns)
    legend(
        drawing, {word: patches.Patch(facecolor=colour, edgecolor="#666666") for word, colour in figure.kinds.values()}
    )
    symbols = "Each rectangle is a mirror facing the tower (triangle). Grey mirrors have no value."
    yield NamedFigure(figure.name, _caption(figure, symbols * isinstance(figure, Maps), note), drawing)
    if getattr(figure, "less", "") in {dim for _, point, _ in shown for dim in point}:
        yield from _coloured(*_differences(context, figure), over)


def _shape(context: Context, figure: Coloured, over: Sequence[str]) -> tuple[float, bool]:
    """Return the height-to-width ratio of coloured panels, and True if both axes have equal scales."""
    if isinstance(figure, Rasters) and len({unit_of(context.coordinate(dim)) for dim in over}) == 1:
        up, right = (np.ptp(context.along(dim)[0]) for dim in over)
        return float(np.clip(up / max(right, 1e-9), 0.3, 1.5)), True
    return {Maps: 0.9, Grids: 0.85}.get(type(figure), 0.6), isinstance(figure, Maps)


def _panel(
    axes: Axes, context: Context, figure: Coloured, over: Sequence[str], place: Point, values: np.ndarray,
    look: Sequence[Any],
) -> None:  # fmt: skip
    """Draw a map of mirrors, or a grid of cells whose first dimension is vertical."""
    if isinstance(figure, Maps):
        field_map(axes, context.result.isel(place, missing_dims="ignore"), values, *look[:2])
        axes.set(xlabel="east (m)", ylabel="north (m)")
        return
    up, right = (edges(places, is_geometric(places)) for places in (context.along(dim)[0] for dim in over))
    axes.pcolormesh(right, up, np.ma.masked_invalid(values), norm=look[0], cmap=look[1], rasterized=True)
    axes.set_facecolor(NO_VALUE)
    for axis, dim in zip((axes.yaxis, axes.xaxis), over, strict=True):
        set_ticks(axis, context, dim, 5)
        axis.set_label_text(fold(context.label(dim), 28))
    if isinstance(figure, Rasters) and _shape(context, figure, over)[1]:
        axes.set_aspect("equal")
        _outline_modules(axes, context.result)


def _title(context: Context, figure: Coloured, array: xr.DataArray, point: Point, values: np.ndarray) -> str:
    if isinstance(figure, Maps):
        mean = number_texts(np.ma.masked_invalid(values).mean(keepdims=True).filled(np.nan))[0]
        return f"{context.fulls(point)}\nmean {mean} {unit_of(array)}".strip()
    name = capital(title_of(array)) if len(figure.variables) > 1 and not figure.each else ""
    return f"{name}\n{context.fulls(point)}".strip()


#: Panels (variable, point and values), fixed indices, number of columns and caption sentences of a figure.
Chosen: TypeAlias = tuple[list[tuple[str, Point, np.ndarray]], dict[str, int], int, str]


def _each_variable(context: Context, figure: Coloured, over: Sequence[str]) -> Chosen:
    names = [name for name in figure.variables if set(over) <= set(context.result[name].dims)]
    every = [(name, dict[str, int](), _values(context, name, over)) for name in names]
    shown = [one for one in every if np.unique(one[2][np.isfinite(one[2])]).size > 1][:MOST_PANELS]
    fixed = context.fixed(context.result[figure.variables[0]], *over)
    return [*shown], fixed, abreast(len(shown)), context.note(fixed)


def _each_point(context: Context, figure: Coloured, over: Sequence[str]) -> Chosen:
    result, array, is_map = context.result, context.result[figure.variables[0]], isinstance(figure, Maps)
    dims = [str(dim) for dim in array.dims if dim not in over and array.sizes[dim] > 1]
    across, rest = preferred(result, dims, figure.panels), dims * (is_map or len(figure.variables) == 1)
    rest = [dim for dim in rest if dim != across]  # no dimension is left if the rows are variables
    down = preferred(result, rest, figure.lines)
    fixed, rows = context.fixed(array, *over, across, down), context.chosen(down, 3)
    places = context.chosen(across, (6, 4)[down is not None], None if is_map else at(array, fixed))
    points = [{**row, **place} for row, place in itertools.product(rows, places)]
    names = [name for name in figure.variables if result[name].dims == array.dims]
    names = names[: 1 if is_map else max(1, 8 // max(len(points), 1))]
    panels = itertools.product(names, points)
    shown = [(name, point, _values(context, name, over, fixed, point)) for name, point in panels]
    is_table = down is not None or min(len(points), len(names)) > 1
    columns = len(places) if is_table else abreast(len(shown), COLUMNS - (len(names) > 1))
    note, maps = context.note(fixed, rows, places), {values.tobytes() for *_, values in shown}
    if is_map and len(maps) < min(len(shown), 2) and result["x"].ndim == 1:
        shown, columns, note = shown[:1], 1, f"{note} All {len(shown)} maps are equal. Only the first is shown.".strip()
    return [*shown], fixed, columns, note


def _differences(context: Context, figure: Any) -> tuple[Context, Maps]:
    """Return a result and a figure that shows differences along `figure.less`.

    Each difference is the first value minus another value.
    """
    dim, array = figure.less, context.result[figure.variables[0]]
    first, others = array.isel({dim: 0}, drop=True), array.isel({dim: slice(1, None)})
    unit, words = (
        unit_of(array).replace("%", "percentage points"),
        [context.value(dim, i) for i in range(array.sizes[dim])],
    )
    second = words[1] if len(words) == 2 else "each other value"
    difference = (first - others).transpose(*array.dims)
    difference = difference.copy(data=printed(difference.assign_attrs(array.attrs)))
    attrs = {"units": unit, "long_name": f"{words[0]} minus {second}"}
    title = f"Difference of the {title_of(array)}: red if {words[0]} is higher"
    result = context.result.isel({dim: slice(1, None)}).assign(differences=difference.assign_attrs(attrs))
    result = result.isel({dim: 0}) if len(words) == 2 else result
    return Context(result, context.held), replace(
        figure, name=f"{figure.name}_differences", title=title, variables=["differences"], less="", palette=DIFFERENCES
    )


def _values(context: Context, name: str, over: Sequence[str], *points: Point) -> np.ndarray:
    array = context.result[name]
    values = np.asarray(printed(at(array, context.fixed(array, *over), *points).transpose(*over)), dtype=float)
    return values[np.ix_(*map(context.order, over))] if len(over) > 1 else values


def field_map(axes: Axes, here: xr.Dataset, values: np.ndarray, norm: Normalize, colours: Colormap) -> None:
    """Draw each mirror of a field as a rectangle facing the tower.

    Parameters
    ----------
    axes : Axes
        Axes of the map. Their scales are set equal.
    here : Dataset
        Result at one point, with coordinates ``x`` and ``y``. If the mirror size is unknown, it is estimated from the
        land area per mirror.
    values : ndarray, shape (n,)
        Values of the heliostats. Mirrors with NaN are grey.
    norm, colours
        Colour scale and colour map of the values.
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
    squares = collections.PolyCollection(
        shapes, array=np.ma.masked_invalid(values[placed]), cmap=colours, norm=norm, rasterized=True,
        linewidths=0.2 if len(centre) < 3000 else 0.0, edgecolors=(0.0, 0.0, 0.0, 0.35),
    )  # fmt: skip
    axes.add_collection(squares)
    for name, ring in ((name, ring) for name, rings in areas(here).items() for ring in rings):
        axes.add_patch(patches.Polygon(ring, **_AREAS[name]))
    z = here["z"].to_numpy() if "z" in here.coords and here["z"].dims == (HELIOSTAT,) else np.zeros(x.size)
    if placed.any() and np.ptp(z[placed]) >= 1.0:  # m
        with suppress(RuntimeError, ValueError):  # mirrors in a straight line cannot be triangulated
            lines = axes.tricontour(x[placed], y[placed], z[placed], 5, colors="#333333", linewidths=0.5)
            axes.clabel(lines, fontsize=5.5, fmt=lambda level: f"{level:g} m")
    axes.plot(0, 0, "^", color="black", markersize=5, markeredgecolor="white", markeredgewidth=0.6)
    axes.set_aspect("equal", "datalim" if axes.get_shared_x_axes().get_siblings(axes) == [axes] else "box")
    axes.autoscale_view()


def edges(values: np.ndarray, logarithmic: bool = False) -> np.ndarray:
    """Return the edges of cells from their ascending centres."""
    values = np.log(values) if logarithmic else np.asarray(values, dtype=float)
    half = np.diff(values) / 2 if values.size > 1 else np.array([0.5])
    ends = np.concatenate([[values[0] - half[0]], values[:-1] + half[: values.size - 1], [values[-1] + half[-1]]])
    return np.exp(ends) if logarithmic else ends


def _outline_modules(axes: Axes, result: xr.Dataset) -> None:
    names = ["module", *(f"module_{side}" for side in ("y", "z", "width", "height"))]
    if all(name in result.coords and result[name].dims == ("module",) for name in names):
        for number, y, z, wide, high in zip(*(result[name].to_numpy() for name in names), strict=True):
            frame: Any = {"fill": False, "edgecolor": "#333333", "linewidth": 0.5}
            axes.add_patch(patches.Rectangle((y - wide / 2, z - high / 2), wide, high, **frame))
            halo = [patheffects.withStroke(linewidth=1.6, foreground="white")]
            axes.text(y, z, f"{number:g}", ha="center", va="center", fontsize=6.5, path_effects=halo)


def _planes(context: Context, figure: Planes, paths: Sequence[str]) -> Iterator[NamedFigure]:
    result, name = context.result, figure.variables[0]
    up = result[name]
    dims = [str(dim) for dim in up.dims if up.sizes[dim] > 1]
    line, other, *_ = [*(dim for dim in figure.lines if dim in {*dims} - {*paths}), None, None]
    panel = next((dim for dim in (*figure.panels, HELIOSTAT) if dim in {*dims} - {*paths, line, other}), None)
    colour = figure.colour if figure.colour in dims else None
    fixed = context.fixed(up, *paths, line, other, panel, colour)
    worst = at(result[figure.worst], fixed) if panel == HELIOSTAT and figure.worst in result else None
    places = context.chosen(panel, MOST_PANELS, at(up, fixed), worst)
    lines, columns = context.chosen(line, MOST_LINES), abreast(len(places))
    looks = _looks([context.values(point) for point in lines], figure.looks, is_ordered(result, str(line)))
    pairs = [(looks[context.values(point)], point, one) for point in lines for one in context.chosen(other, 3)]
    drawing, grid = panels(max(1, len(places)), columns, 0.82, layout="compressed")
    entries: dict[str, Any] = {}
    for axes, place in zip(grid, places, strict=False):
        entries |= _plane(axes, context, figure, {**fixed, **place}, paths, colour, pairs)
        axes.set_title(fold(context.fulls(place), int(TITLE_LETTERS * WIDE / max(columns, 2))))
    if entries:
        if colour:
            hues = context.coordinate(colour).astype(float)
            norm = Normalize(float(hues.min()), float(hues.max()))
            colour_bar(drawing, grid, norm, colormaps[VALUES], "neither", context.label(colour))
        entries = {} if colour in paths[:1] else entries  # the colour bar shows the values along a path
        legend(drawing, entries, context.title(str(line)) if is_ordered(result, str(line)) else "")
        yield NamedFigure(figure.name, _caption(figure, context.note(fixed, places, lines)), drawing)


def _plane(
    axes: Axes, context: Context, figure: Planes, place: Point, paths: Sequence[str], colour: str | None,
    pairs: Sequence[tuple[Mapping[str, Any], Point, Point]],
) -> dict[str, Any]:  # fmt: skip
    result, up, entries, tracks = context.result, figure.variables[0], dict[str, Any](), list[np.ndarray]()
    hues = context.coordinate(colour).astype(float) if colour else xr.DataArray(0.0)
    order = {} if figure.dots else {dim: context.order(dim) for dim in paths}
    names = (figure.against[up], up)
    for look, point, other in pairs:
        arrays = xr.broadcast(
            *(at(one, place, point, other).astype(float) for one in (*(result[name] for name in names), hues))
        )
        x, y, hue = (one.isel(order).to_numpy().ravel() for one in arrays)
        known = np.isfinite(x) & np.isfinite(y)
        if not known.any():
            continue
        look = {**look, **({} if order else {"linestyle": ""})}
        look["marker"] = look["marker"] if len(x) <= MARKED else ("", ".")[figure.dots]
        label, text = context.values(point), context.values(other)
        if colour is None:
            (entries[label],) = axes.plot(x, y, **look)
        else:
            line, text = (look["linestyle"], label) if colour in paths[:1] else ("", text)
            axes.plot(x, y, color="#666666", linewidth=0.6, linestyle=line)
            spots: Any = {"cmap": VALUES, "vmin": hues.min(), "vmax": hues.max(), "linewidths": 0, "zorder": 3}
            entries[label] = axes.scatter(x, y, 10, hue, marker=look["marker"] or "o", **spots)
        tracks.append(np.stack([x, y], axis=-1)[known])
        axes.annotate(text, tracks[-1][-1], xytext=(3, 3), textcoords="offset points", fontsize=6)
    axes.plot(0, 0, "+", color="black", markersize=6, markeredgewidth=0.8)
    if size := aperture(result, place):
        corner, look = (-size[0] / 2, -size[1] / 2), {"facecolor": "#ededed", "edgecolor": "#333333"}
        axes.add_patch(patches.Rectangle(corner, *size, **look, linewidth=0.9, zorder=0.6))
    frame_square(axes, tracks, size)
    figure.extra(axes, result, place)
    axes.grid(True)
    axes.set(xlabel=f"to the right ({unit_of(result[names[0]])})", ylabel=f"up ({unit_of(result[up])})")
    return entries


def frame_square(axes: Axes, tracks: Sequence[np.ndarray], size: tuple[float, float] | None = None) -> None:
    """Set square axis limits that include the origin and all but a few distant points.

    The limits also include the aperture, unless all points are close together.
    """
    points = np.concatenate([np.zeros((1, 2)), *tracks])
    corner = np.array(size or (0.0, 0.0)) / 2
    far = np.hypot(*points.T)
    near = points[far <= max(3.0 * float(np.quantile(far, 0.9)), 8.0 * float(np.hypot(*corner)), 1e-9)]
    if np.ptp(near, axis=0).max() > 0.05 * corner.max():
        near = np.concatenate([near, [-corner, corner]])
    low, high = near.min(axis=0), near.max(axis=0)
    half, middle = max(float((high - low).max()) / 2 * 1.14, 1e-6), (low + high) / 2
    axes.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half), aspect="equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(ticker.MaxNLocator(4))


#: Image resolution [pixels per inch], and width of the white margin around a figure [pixel].
DPI, RIM = 180, 8

_lock = threading.RLock()  # threads share the style
_RC: Any = {
    "text.parse_math": False,  # dollar signs in titles are printed as text
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8,
    "axes.titlesize": 7.5,
    "axes.titley": 1.0,  # panels have no top ticks, so a fixed title position is possible and saves 10 % of the time
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
    """Convert a figure to a raster image with a narrow white margin."""
    with _lock, matplotlib.rc_context(_RC):
        figure.set_dpi(DPI)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    figure.set_canvas(FigureCanvasBase(figure))  # frees the buffer of the previous canvas
    left, top, right, bottom = ImageChops.invert(picture).getbbox() or (0, 0, *picture.size)
    ends = min(right + RIM, picture.width), min(bottom + RIM, picture.height)
    return picture.crop((max(left - RIM, 0), max(top - RIM, 0), *ends))


def png(picture: Image.Image) -> bytes:
    """Return an image as the bytes of a PNG file."""
    buffer = io.BytesIO()
    # compression level 4 takes half the time of level 6 and gives files that are 2 % larger
    picture.save(buffer, "PNG", dpi=(DPI, DPI), compress_level=4)
    return buffer.getvalue()


def image(figure: Drawing, kind: str = "png") -> bytes:
    """Convert a figure to the bytes of an image file. Equal figures give equal bytes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Figure to convert.
    kind : {"png", "svg", "pdf"}
        File format. Maps and pictures are embedded in SVG and PDF files as raster images.
    """
    if kind == "png":
        return png(pixels(figure))
    buffer, dateless = io.BytesIO(), {{"svg": "Date", "pdf": "CreationDate"}[kind]: None}
    with _lock, matplotlib.rc_context(_RC):
        figure.savefig(buffer, format=kind, dpi=DPI, bbox_inches="tight", metadata=dateless)
    return buffer.getvalue()
