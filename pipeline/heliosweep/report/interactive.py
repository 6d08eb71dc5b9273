"""Interactive Bokeh plots of declared figures."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache, partial
from importlib import resources
from typing import Any

import numpy as np
import xarray as xr
from bokeh.document import Document
from bokeh.embed import components
from bokeh.events import DocumentReady
from bokeh.layouts import column, row
from bokeh.models import (
    ColumnDataSource,
    CustomJS,
    DatetimeTickFormatter,
    FixedTicker,
    HoverTool,
    LinearColorMapper,
)
from bokeh.models.annotations import ColorBar, Legend, LegendItem
from bokeh.models.glyphs import Line, Scatter
from bokeh.models.widgets import Div, Select
from bokeh.palettes import RdBu11, Viridis256, interp_palette
from bokeh.plotting import figure as bokeh_figure
from bokeh.resources import Resources
from bokeh.themes import Theme

from heliosweep.report.figures import (
    COLOURS,
    HELIOSTAT,
    NO_VALUE,
    Context,
    Curves,
    Figure,
    Maps,
    Planes,
    Rasters,
    aperture,
    areas,
    axes_of,
    axis_label,
    capital,
    fold,
    is_geometric,
    is_joined,
    is_ordered,
    is_signed,
    mirrors,
    preferred,
    prepared,
    printed,
    title_of,
    unit_of,
)

#: Maximum number of plots on a page, and maximum number of values, variables and lines in a plot.
MOST_PLOTS, MOST_NUMBERS, MOST_VARIABLES, MOST_LINES = 4, 300_000, 16, 12
#: Grey that is legible on white and black backgrounds.
_GREY = "#80868c"
_CLEAR = {"background_fill_color": None, "border_line_color": None, "title_text_color": _GREY}
_THEME = Theme(
    json={
        "attrs": {
            "Plot": {"background_fill_color": None, "border_fill_color": None, "outline_line_color": _GREY},
            "Toolbar": {"logo": None, "active_scroll": None},
            "Grid": {"grid_line_alpha": 0.3},
            "Axis": {
                **dict.fromkeys(
                    ("axis_label_text_color", "major_label_text_color", "axis_line_color", "major_tick_line_color"),
                    _GREY,
                ),
                "axis_label_text_font_style": "normal",
                "minor_tick_line_color": None,
            },
            "Legend": {**_CLEAR, "label_text_color": _GREY, "click_policy": "hide"},
            "ColorBar": {**_CLEAR, "major_label_text_color": _GREY, "title_text_font_style": "normal", "height": 10},
        }
    }
)
_FORMS = (Curves, Maps, Rasters, Planes)


def explore(result: xr.Dataset, figures: Iterable[Figure]) -> tuple[str, list[dict[str, str]]]:
    """Return the script of all interactive plots, and the title, caption and HTML of each plot."""
    plots: dict[str, Any] = {}
    texts, document = list[dict[str, str]](), Document(theme=_THEME)
    for declared in figures:
        if declared.interactive and isinstance(declared, _FORMS) and len(plots) < MOST_PLOTS:
            here, shown = prepared(result, declared)
            if shown and (made := _plot(here, shown)):
                plots[declared.name] = made[0]
                document.add_root(made[0])
                document.js_on_event(DocumentReady, made[1])
                texts.append({"title": declared.title, "caption": declared.notes})
    if not plots:
        return "", []
    script, places = components(plots, wrap_script=False)
    # Consecutive numbers replace random identifiers, so that equal results give equal pages.
    pattern, numbers = r'(?<=")(p\d{4,}|[0-9a-f]{8}-[0-9a-f-]{27})(?=")', dict[str, str]()
    numbered = partial(re.sub, pattern, lambda found: numbers.setdefault(found[1], f"bokeh-{len(numbers)}"))
    script = numbered(script)
    return script, [{**text, "html": numbered(places[name])} for text, name in zip(texts, plots, strict=True)]


@cache
def client() -> str:
    """Return the scripts of the Bokeh client and its widgets."""
    return "\n".join(Resources(mode="inline", components=["bokeh", "bokeh-widgets"], log_level="warn").js_raw)


def _select(dim: dict[str, Any], position: int) -> Select:
    options: list[Any] = [(str(i), text) for i, text in enumerate(dim["texts"])]
    nearest = int(np.argmin(np.abs(dim["kept"] - position)))
    return Select(title=dim["title"], value=str(nearest), options=options)


def _plot(result: xr.Dataset, figure: Figure) -> tuple[Any, CustomJS] | None:
    context = Context(result, figure.at)
    axes, sizes = axes_of(result, figure, figure.variables[0]) or [], result[figure.variables[0]].sizes
    dims_of_lines = [str(dim) for dim, size in sizes.items() if dim not in axes and 1 < size <= MOST_LINES]
    line = preferred(result, dims_of_lines, figure.lines) if isinstance(figure, Curves | Planes) else None
    keep = {dim for dim in (*axes, line) if dim}
    names = [name for name in figure.variables if axes_of(result, figure, name) == axes]
    quantities, dims = _quantities(context, figure, [name for name in names if result[name].dtype.kind != "M"], keep)
    if not quantities:
        return None
    titles: list[Any] = [(name, quantity["title"]) for name, quantity in quantities.items()]
    choose = Select(title="Quantity", value=titles[0][0], options=titles, visible=len(titles) > 1)
    chosen = [dim for dim, one in dims.items() if dim not in keep and len(one["texts"]) > 1]
    selects = {dim: _select(dims[dim], context.position(dim)) for dim in chosen}
    told = Div(text="", styles={"font-size": "14px"})
    drawing, arguments = {Maps: _map, Rasters: _picture}.get(type(figure), _lines)(context, figure, dims, axes, line)
    arguments |= {
        "quantities": quantities,
        "dims": {dim: {"texts": one["texts"], "at": one["at"]} for dim, one in dims.items()},
        "axes": axes,
        "line": line,
        "xaxis": drawing.xaxis[0],
        "yaxis": drawing.yaxis[0],
        "choose": choose,
        "selects": selects,
        "told": told,
    }
    script = resources.files("heliosweep.report").joinpath("templates/plot.js").read_text("utf-8")
    callback = CustomJS(args=arguments, code=script)
    look = ".bk-input { background-color: var(--paper); color: var(--ink); border-color: var(--quiet); }"
    # The arrow of the browser is visible in dark mode, unlike Bokeh's black arrow.
    look += " select.bk-input:not([multiple]):not([size]) { appearance: auto; background-image: none; padding: 0 4px; }"
    for widget in (choose, *selects.values()):
        widget.js_on_change("value", callback)
        widget.update(width=165, stylesheets=[look])
    switches = row(choose, *selects.values(), sizing_mode="stretch_width", styles={"flex-wrap": "wrap", "gap": "6px"})
    return column(switches, told, drawing, sizing_mode="stretch_width"), callback


def _quantities(
    context: Context, figure: Figure, names: Sequence[str], keep: set[str]
) -> tuple[dict[str, dict[str, Any]], dict[str, dict[str, Any]]]:
    across = figure.against if isinstance(figure, Planes) else {}
    quantities, dims = dict[str, dict[str, Any]](), dict[str, dict[str, Any]]()
    for name in names[:MOST_VARIABLES]:
        quantity, kept = _quantity(context.result[name], keep)
        if np.isfinite(quantity["values"]).any():
            quantities[name] = quantity
            if name in across:
                quantity["across"], more = _quantity(context.result[across[name]], keep)
                kept = {**more, **kept}
            for dim in (dim for dim in kept if dim not in dims):
                values = context.coordinate(dim).to_numpy()[kept[dim]]
                dates, words = values.dtype.kind == "M", not is_joined(context.result, dim) or values.dtype.kind in "OU"
                at = np.arange(values.size) if words else values.astype("datetime64[ms]") if dates else values
                texts = [context.value(dim, int(i)) for i in kept[dim]]
                about = {"title": context.title(dim), "texts": texts, "kept": kept[dim], "dates": dates}
                dims[dim] = {**about, "at": at.astype(float)}
    return quantities, dims


def _quantity(array: xr.DataArray, keep: Iterable[str]) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return the values, labels and range of a variable, and the kept indices along each dimension.

    Large arrays are thinned along their longest dimensions.
    """
    kept = {str(dim): np.arange(size) for dim, size in array.sizes.items()}
    while math.prod(map(len, kept.values())) > MOST_NUMBERS:
        loose = [dim for dim in kept if dim not in keep and len(kept[dim]) > 3] or list(kept)
        longest = max(loose, key=lambda dim: len(kept[dim]) * (dim != HELIOSTAT))
        kept[longest] = kept[longest][::2]
    for dim, places in kept.items():
        if dim in array.coords and array[dim].ndim == 1 and array[dim].dtype.kind in "fiuM":
            kept[dim] = places[np.argsort(array[dim].to_numpy()[places], kind="stable")]
    values = np.asarray(printed(array.isel(kept)), dtype=float)
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    quantity = {
        "dims": list(kept),
        "strides": {dim: math.prod(values.shape[i + 1 :]) for i, dim in enumerate(kept)},
        "values": np.where(np.isfinite(values), values, np.nan).astype("<f4").ravel(),
        "title": capital(title_of(array)),
        "label": fold(axis_label(array)),
        "unit": unit_of(array),
        "low": low,
        "high": high,
        "signed": is_signed(low, high),
    }
    return quantity, kept


def _figure(**options: Any) -> Any:
    look: Any = {"sizing_mode": "stretch_width", "tools": "pan,box_zoom,wheel_zoom,reset,save"}
    return bokeh_figure(toolbar_location="above", **look, **options)


def _line_axes(context: Context, dim: str, one: Mapping[str, Any]) -> Any:
    kind = "datetime" if one["dates"] else "log" if is_geometric(one["at"]) else "linear"
    drawing = _figure(height=360, x_axis_type=kind)
    drawing.xaxis.axis_label = context.label(dim)
    if one["dates"]:
        drawing.xaxis.formatter = DatetimeTickFormatter(hours="%H:%M", days="%b %d", months="%b %Y")
    elif context.along(dim)[1]:
        places, texts = one["at"].tolist(), one["texts"]
        drawing.xaxis.ticker = FixedTicker(ticks=places[:: -(-len(texts) // 16)])
        drawing.xaxis.major_label_overrides = dict(zip(places, texts, strict=True))
        drawing.xaxis.major_label_orientation = 0.7 if sum(map(len, texts)) > 60 else "horizontal"
    return drawing


def _lines(
    context: Context, figure: Any, dims: Mapping[str, Any], axes: Sequence[str], line: str | None
) -> tuple[Any, dict[str, Any]]:
    plane = isinstance(figure, Planes)
    if plane:
        drawing = _figure(height=480, match_aspect=True)
        joined = bool(axes) and not figure.dots
        if size := aperture(context.result, {str(dim): 0 for dim in context.result.dims}):
            drawing.rect([0], [0], [size[0]], [size[1]], fill_color=None, line_color=_GREY, line_dash="dashed")
    else:
        drawing = _line_axes(context, axes[0], dims[axes[0]])
        joined = is_joined(context.result, axes[0])
    names = dims[line]["texts"] if line else [""]
    ordered = bool(line and is_ordered(context.result, line) and len(names) > 2)
    sources, items, spots = [], [], []
    for number, name in enumerate(names):
        colour = Viridis256[int(235 * number / max(len(names) - 1, 1))] if ordered else COLOURS[number % 6]
        colour = figure.looks.get(name, {}).get("color", colour)
        source = ColumnDataSource({"x": [0.0, 1.0], "y": [0.0, 1.0], "text": ["", ""]}, name=name)
        marker: Any = Scatter(x="x", y="y", size=4 if joined else 7, line_color=colour, fill_color=colour)
        shapes = [drawing.add_glyph(source, marker)]  # `scatter` adds four glyphs and takes three times as long
        spots += shapes
        if joined:
            dash: Any = "solid" if ordered else ("solid", "dashed", "dotted", "dotdash", "dashdot")[number % 5]
            shapes.insert(
                0, drawing.add_glyph(source, Line(x="x", y="y", line_color=colour, line_dash=dash, line_width=1.8))
            )
        sources.append(source)
        items.append(LegendItem(label=name, renderers=shapes))
    drawing.add_tools(HoverTool(tooltips=[("", "@text")], renderers=spots, visible=False))
    if line and len(names) > 1:
        drawing.add_layout(Legend(items=items, title=dims[line]["title"], ncols=min(len(names), 4)), "above")
    return drawing, {"sources": sources, "kind": "plane" if plane else "curves"}


def _map(context: Context, *_: Any) -> tuple[Any, dict[str, Any]]:
    result = context.result
    x, y, width, height = mirrors(result[list(result.coords)].isel({dim: 0 for dim in result.dims if dim != HELIOSTAT}))
    data = {
        "x": x,
        "y": y,
        "width": width,
        "height": height,
        "angle": np.arctan2(-x, y),
        "value": np.full(x.size, np.nan),
    }
    source = ColumnDataSource({**data, "text": [context.value(HELIOSTAT, i) for i in range(x.size)]})
    aspect = (np.nanmax(y) - min(np.nanmin(y), 0)) / max(float(np.nanmax(x) - np.nanmin(x)), 1.0)
    drawing, colours = _coloured(float(np.clip(aspect, 0.5, 1.1)), match_aspect=True)
    fill = {"field": "value", "transform": colours["mapper"]}
    shapes = drawing.rect("x", "y", "width", "height", "angle", source=source, line_color=None, fill_color=fill)
    for rings in areas(result).values():
        lines = [[ring[:, i].tolist() for ring in rings] for i in (0, 1)]
        drawing.multi_line(*lines, line_color=_GREY, line_dash="dashed")
    drawing.scatter([0], [0], marker="triangle", size=11, color=_GREY)
    drawing.xaxis.axis_label, drawing.yaxis.axis_label = "east (m)", "north (m)"
    drawing.add_tools(HoverTool(renderers=[shapes], tooltips=[("heliostat", "@text"), ("value", "@value")]))
    return drawing, {"source": source, "kind": "map", **colours}


def _picture(
    context: Context, figure: Figure, dims: Mapping[str, Any], axes: Sequence[str], line: str | None
) -> tuple[Any, dict[str, Any]]:
    up, right = (dims[dim]["at"] for dim in axes)
    below, beside = (abs(float(side[1] - side[0])) if side.size > 1 else 1.0 for side in (up, right))
    source = ColumnDataSource({"image": [np.zeros((up.size, right.size))]})
    equal = unit_of(context.coordinate(axes[0])) == unit_of(context.coordinate(axes[1]))
    aspect = float(np.clip(np.ptp(up) / max(np.ptp(right), 1e-9), 0.4, 1.1)) if equal else 0.6
    drawing, colours = _coloured(aspect, match_aspect=equal)
    drawing.x_range.range_padding = 0
    corner = float(right.min() - beside / 2), float(up.min() - below / 2)
    size = float(np.ptp(right) + beside), float(np.ptp(up) + below)
    shapes = drawing.image("image", *corner, *size, source=source, color_mapper=colours["mapper"])
    drawing.xaxis.axis_label, drawing.yaxis.axis_label = context.label(axes[1]), context.label(axes[0])
    drawing.add_tools(HoverTool(renderers=[shapes], tooltips=[("value", "@image"), ("at", "$x, $y")]))
    return drawing, {"source": source, "kind": "raster", **colours}


def _coloured(aspect: float, **options: Any) -> tuple[Any, dict[str, Any]]:
    mapper = LinearColorMapper(palette=Viridis256, low=0, high=1, nan_color=NO_VALUE)
    drawing, bar = _figure(height=int(420 * aspect + 120), **options), ColorBar(color_mapper=mapper)
    drawing.add_layout(bar, "above")
    return drawing, {"mapper": mapper, "bar": bar, "palettes": [list(Viridis256), list(interp_palette(RdBu11, 256))]}
