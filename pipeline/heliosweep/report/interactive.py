"""Interactive plots of declared figures with Bokeh: selects choose the variable and the values that are not drawn."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
import xarray as xr
from bokeh.document import Document
from bokeh.embed import components
from bokeh.events import DocumentReady
from bokeh.layouts import column, row
from bokeh.models.annotations import ColorBar, Legend, LegendItem
from bokeh.models.callbacks import CustomJS
from bokeh.models.formatters import DatetimeTickFormatter
from bokeh.models.mappers import LinearColorMapper
from bokeh.models.ranges import DataRange1d
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tickers import FixedTicker
from bokeh.models.tools import HoverTool
from bokeh.models.widgets import Div, Select
from bokeh.palettes import Viridis256
from bokeh.plotting import figure as bokeh_figure
from bokeh.resources import Resources

from heliosweep.report.colours import COLOURS, NO_VALUE
from heliosweep.report.context import Context, is_geometric
from heliosweep.report.figures import (
    HELIOSTAT,
    Curves,
    Figure,
    Maps,
    Planes,
    Rasters,
    axis_of,
    is_joined,
    is_ordered,
    reduced,
    usable,
)
from heliosweep.report.labels import axis_label, fold, is_signed, printed, title_of, unit_of
from heliosweep.report.shapes import aperture, areas, mirrors

#: Number of plots of a page, numbers of a plot, variables of a plot, and lines.
MOST_PLOTS, MOST_NUMBERS, MOST_VARIABLES, MOST_LINES = 6, 300_000, 16, 12
#: Dash patterns of lines.
_DASHES = ("solid", "dashed", "dotted", "dotdash", "dashdot")
#: Colour that is legible on white and on black.
_GREY = "#80868c"
#: Style of inputs, with the colours of the page.
_INPUT = ".bk-input { background-color: var(--paper); color: var(--ink); border-color: var(--quiet); }"
_FORMS = (Curves, Maps, Rasters, Planes)


def explore(result: xr.Dataset, figures: Iterable[Figure]) -> tuple[str, list[dict[str, str]]]:
    """Return the script of all interactive plots, and title, caption and HTML of each."""
    plots: dict[str, Any] = {}
    texts: list[dict[str, str]] = []
    for declared in figures:
        if not declared.interactive or not isinstance(declared, _FORMS) or len(plots) == MOST_PLOTS:
            continue
        here = reduced(result, declared)
        known = usable(here, declared)
        made = _plot(here, known) if known else None
        if made:
            plots[declared.name] = made
            texts.append({"title": declared.title, "caption": declared.notes})
    if not plots:
        return "", []
    document = Document()
    for plot, callback in plots.values():
        document.add_root(plot)
        document.js_on_event(DocumentReady, callback)
    script, places = components({name: plot for name, (plot, _) in plots.items()}, wrap_script=False)
    found = re.findall(r'"(p\d{4,}|[0-9a-f]{8}-[0-9a-f-]{27})"', script)
    numbers = {name: f"bokeh-{number}" for number, name in enumerate(dict.fromkeys(found))}  # the same every time
    script = _renamed(script, numbers)
    return script, [{**text, "html": _renamed(places[name], numbers)} for text, name in zip(texts, plots, strict=True)]


def _renamed(text: str, names: Mapping[str, str]) -> str:
    """Replace quoted names."""
    return re.sub(r'"(p\d{4,}|[0-9a-f]{8}-[0-9a-f-]{27})"', lambda match: f'"{names.get(match[1], match[1])}"', text)


@cache
def client() -> str:
    """Return the scripts of Bokeh's client, with its widgets."""
    return "\n".join(Resources(mode="inline", components=["bokeh", "bokeh-widgets"], log_level="warn").js_raw)


@cache
def _script() -> str:
    return resources.files("heliosweep.report").joinpath("templates/plot.js").read_text("utf-8")


def _plot(result: xr.Dataset, figure: Figure) -> Any:
    """Return the plot of a figure with its selects, and its callback; None without a value."""
    context = Context(result, figure.at)
    axes = _axes(result, figure)
    line = _line_dimension(result, figure, axes)
    names = [name for name in figure.variables if _axes(result, figure, name) == axes][:MOST_VARIABLES]
    others = [figure.against[name] for name in names] if isinstance(figure, Planes) else []
    keep = {dim for dim in (*axes, line) if dim}
    arrays = {name: _thinned(result[name], keep) for name in (*names, *others)}
    names = [name for name in names if result[name].dtype.kind != "M" and np.isfinite(arrays[name]["values"]).any()]
    if not names:
        return None
    dims = {
        dim: _dimension(context, dim, kept)
        for array in arrays.values()
        for dim, kept in array["kept"].items()
    }  # fmt: skip
    quantities = {name: _quantity(result[name], arrays[name]) for name in names}
    for name, other in zip(figure.variables, others, strict=False):
        if name in quantities:
            quantities[name]["across"] = {key: arrays[other][key] for key in ("dims", "strides", "values")}
    titles: list[Any] = [(name, quantities[name]["title"]) for name in names]
    choose = Select(title="Quantity", value=names[0], options=titles)
    choose.visible = len(names) > 1
    selects: dict[str, Select] = {}
    for dim, one in dims.items():
        if dim not in keep and len(one["texts"]) > 1:
            start = str(int(np.argmin(np.abs(one["kept"] - context.position(dim)))))
            options: list[Any] = [(str(i), text) for i, text in enumerate(one["texts"])]
            selects[dim] = Select(title=one["title"], value=start, options=options)
    told = Div(text="", styles={"font-size": "14px"})
    drawing, arguments = (_curved if isinstance(figure, Curves | Planes) else _coloured)(
        context, figure, dims, axes, line, arrays
    )
    arguments |= {
        "quantities": quantities,
        "dims": {dim: {"texts": one["texts"], "at": one["at"]} for dim, one in dims.items()},
        "axes": list(axes),
        "line": line or "",
        "xaxis": drawing.xaxis[0],
        "yaxis": drawing.yaxis[0],
        "choose": choose,
        "selects": selects,
        "told": told,
    }
    callback = CustomJS(args=arguments, code=_script())
    for widget in (choose, *selects.values()):
        widget.js_on_change("value", callback)
        widget.width, widget.min_width = 290, 120
        widget.stylesheets = [_INPUT]
    switches = row(choose, *selects.values(), sizing_mode="stretch_width", styles={"flex-wrap": "wrap", "gap": "8px"})
    return column(switches, told, drawing, sizing_mode="stretch_width"), callback


def _axes(result: xr.Dataset, figure: Figure, name: str = "") -> tuple[str, ...]:
    """Return the dimensions that a plot draws along."""
    array = result[name or figure.variables[0]]
    if isinstance(figure, Maps):
        return (HELIOSTAT,)
    if isinstance(figure, Rasters):
        return tuple(figure.over)
    if isinstance(figure, Planes):
        return tuple(dim for dim in figure.over if array.sizes.get(dim, 1) > 1)[: None if figure.dots else 1]
    return tuple(dim for dim in [axis_of(result, array, figure)] if dim)


def _line_dimension(result: xr.Dataset, figure: Figure, axes: Sequence[str]) -> str | None:
    """Return the dimension with a line for each value."""
    if not isinstance(figure, Curves | Planes):
        return None
    sizes = result[figure.variables[0]].sizes
    dims = [str(dim) for dim, size in sizes.items() if dim not in axes and 1 < size <= MOST_LINES]
    wanted = [dim for dim in (*figure.lines, "statistic") if dim in dims]
    words = [dim for dim in dims if not is_ordered(result, dim)]
    return next(iter((*wanted, *words, *dims)), None)


def _thinned(array: xr.DataArray, keep: Iterable[str]) -> dict[str, Any]:
    """Return the values of an array, of a large one every n-th along its longest dimensions."""
    kept = {str(dim): np.arange(size) for dim, size in array.sizes.items()}
    while math.prod(len(one) for one in kept.values()) > MOST_NUMBERS:
        loose = [dim for dim in kept if dim not in keep and len(kept[dim]) > 3] or [
            dim for dim in kept if dim != HELIOSTAT and len(kept[dim]) > 3
        ]
        longest = max(loose or kept, key=lambda dim: len(kept[dim]))
        kept[longest] = kept[longest][::2]
    for dim, one in kept.items():
        if dim in array.coords and array[dim].ndim == 1 and array[dim].dtype.kind in "fiuM":
            kept[dim] = one[np.argsort(array[dim].to_numpy()[one], kind="stable")]
    part = array.isel(kept)
    values = np.asarray(printed(part), dtype=float)
    dims = [str(dim) for dim in part.dims]
    strides = {dim: math.prod(values.shape[i + 1 :]) for i, dim in enumerate(dims)}
    numbers = np.where(np.isfinite(values), values, np.nan).astype("<f4").ravel()
    return {"dims": dims, "strides": strides, "values": numbers, "kept": kept}


def _quantity(array: xr.DataArray, numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Return label, unit, range and values of a variable."""
    known = numbers["values"][np.isfinite(numbers["values"])]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    title = title_of(array)
    return {
        **{key: numbers[key] for key in ("dims", "strides", "values")},
        "title": title[:1].upper() + title[1:],
        "label": fold(axis_label(array)),
        "unit": unit_of(array),
        "low": low,
        "high": high,
        "signed": is_signed(low, high),
    }


def _dimension(context: Context, dim: str, kept: np.ndarray) -> dict[str, Any]:
    """Return title, words and positions of the kept values of a dimension."""
    values = context.coordinate(dim).to_numpy()[kept]
    if values.dtype.kind == "M":
        at = values.astype("datetime64[ms]").astype(float)
    elif is_joined(context.result, dim) and values.dtype.kind in "fiu":
        at = values.astype(float)
    else:
        at = np.arange(kept.size, dtype=float)
    texts = [context.value(dim, int(i)) for i in kept]
    return {"title": context.title(dim), "texts": texts, "at": at, "kept": kept, "dates": values.dtype.kind == "M"}


def _figure(**options: Any) -> Any:
    """Return an empty plot; its colours come from the style sheet of the page."""
    drawing: Any = bokeh_figure(
        sizing_mode="stretch_width",
        toolbar_location="above",
        **{"tools": "pan,box_zoom,wheel_zoom,reset,save", **options},
    )
    drawing.toolbar.logo = None
    drawing.toolbar.active_scroll = None
    drawing.background_fill_color = drawing.border_fill_color = None
    drawing.outline_line_color = _GREY
    drawing.grid.grid_line_alpha = 0.3
    for axis in drawing.axis:
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_color = axis.major_label_text_color = _GREY
        axis.axis_line_color = axis.major_tick_line_color = _GREY
        axis.minor_tick_line_color = None
    return drawing


def _curved(
    context: Context,
    figure: Any,
    dims: Mapping[str, Any],
    axes: Sequence[str],
    line: str | None,
    arrays: Mapping[str, Any],
) -> tuple[Any, dict[str, Any]]:
    """Return a plot of curves, or of points in a plane, a line for each value of a dimension."""
    plane = isinstance(figure, Planes)
    one: Any = dims[axes[0]] if axes else {"at": np.zeros(1), "dates": False, "texts": [""], "title": ""}
    options: dict[str, Any] = {"height": 480 if plane else 360}
    if plane:
        options |= {"match_aspect": True}
    elif one["dates"]:
        options |= {"x_axis_type": "datetime"}
    elif axes and is_geometric(one["at"]):
        options |= {"x_axis_type": "log"}
    drawing = _figure(**options)
    if not plane:
        drawing.xaxis.axis_label = context.label(axes[0])
        words = not one["dates"] and not is_joined(context.result, axes[0])
        if words:
            step = -(-len(one["texts"]) // 16)
            drawing.xaxis.ticker = FixedTicker(ticks=one["at"][::step].tolist())
            drawing.xaxis.major_label_overrides = {
                float(at): text for at, text in zip(one["at"], one["texts"], strict=True)
            }
            drawing.xaxis.major_label_orientation = 0.7 if sum(map(len, one["texts"][::step])) > 60 else "horizontal"
        if one["dates"]:
            drawing.xaxis.formatter = DatetimeTickFormatter(hours="%H:%M", days="%b %d", months="%b %Y")
    names = dims[line]["texts"] if line else [""]
    joined = (
        bool(axes) and not (plane and figure.dots) and (plane or one["dates"] or is_joined(context.result, axes[0]))
    )
    sources, items = [], []
    for number, name in enumerate(names):
        ordered = bool(line and is_ordered(context.result, line) and len(names) > 2)
        colour = Viridis256[int(235 * number / max(len(names) - 1, 1))] if ordered else COLOURS[number % 6]
        colour = figure.looks.get(name, {}).get("color", colour)
        source = ColumnDataSource({"x": [0.0, 1.0], "y": [0.0, 1.0], "text": ["", ""]}, name=name)
        shapes = [drawing.scatter("x", "y", source=source, size=4 if joined else 7, color=colour)]
        if joined:
            dash = "solid" if ordered else _DASHES[number % len(_DASHES)]
            shapes.insert(0, drawing.line("x", "y", source=source, color=colour, line_dash=dash, line_width=1.8))
        sources.append(source)
        items.append(LegendItem(label=name, renderers=shapes))
    hover = HoverTool(tooltips=[("", "@text")], renderers=[shape for item in items for shape in item.renderers[-1:]])
    drawing.add_tools(hover)
    if len(names) > 1:
        legend = Legend(
            items=items, title=dims[line]["title"] if line else None, click_policy="hide", ncols=min(len(names), 4)
        )
        legend.background_fill_color, legend.border_line_color, legend.label_text_color = None, None, _GREY
        legend.title_text_color = _GREY
        drawing.add_layout(legend, "above")
    if plane:
        size = aperture(context.result, {str(dim): 0 for dim in context.result.dims})
        if size:
            drawing.rect([0], [0], [size[0]], [size[1]], fill_color=None, line_color=_GREY, line_dash="dashed")
    return drawing, {"sources": sources, "kind": "plane" if plane else "curves"}


def _coloured(
    context: Context,
    figure: Any,
    dims: Mapping[str, Any],
    axes: Sequence[str],
    line: str | None,
    arrays: Mapping[str, Any],
) -> tuple[Any, dict[str, Any]]:
    """Return a plot of mirrors or pixels coloured by a value."""
    result = context.result
    mapper = LinearColorMapper(palette=Viridis256, low=0, high=1, nan_color=NO_VALUE)
    if isinstance(figure, Maps):
        here = result[list(result.coords)]
        loose = {dim: 0 for dim in here["x"].dims if dim != HELIOSTAT}
        x, y, width, height = mirrors(here.isel({dim: 0 for dim in here.dims if dim != HELIOSTAT} | loose))
        data = {
            "x": x,
            "y": y,
            "width": width,
            "height": height,
            "angle": np.arctan2(-x, y),
            "value": np.full(x.size, np.nan),
        }
        data["text"] = [context.value(HELIOSTAT, i) for i in range(x.size)]
        source = ColumnDataSource(data)
        span = max(float(np.nanmax(x) - np.nanmin(x)), 1.0)
        aspect = float(np.clip((np.nanmax(y) - min(np.nanmin(y), 0)) / span, 0.5, 1.1))
        drawing = _figure(height=int(420 * aspect + 120), match_aspect=True)
        shapes = drawing.rect("x", "y", "width", "height", "angle", source=source, line_color=None,
                              fill_color={"field": "value", "transform": mapper})  # fmt: skip
        for rings in areas(result).values():
            lines = [[ring[:, i].tolist() for ring in rings] for i in (0, 1)]
            drawing.multi_line(*lines, line_color=_GREY, line_dash="dashed")
        drawing.scatter([0], [0], marker="triangle", size=11, color=_GREY)
        drawing.xaxis.axis_label, drawing.yaxis.axis_label = "east (m)", "north (m)"
        drawing.add_tools(HoverTool(renderers=[shapes], tooltips=[("heliostat", "@text"), ("value", "@value")]))
        kind = "map"
    else:
        up, right = (dims[dim]["at"] for dim in axes)
        steps = [abs(float(side[1] - side[0])) if side.size > 1 else 1.0 for side in (up, right)]
        source = ColumnDataSource({"image": [np.zeros((up.size, right.size))]})
        equal = unit_of(context.coordinate(axes[0])) == unit_of(context.coordinate(axes[1]))
        aspect = float(np.clip(np.ptp(up) / max(np.ptp(right), 1e-9), 0.4, 1.1)) if equal else 0.6
        drawing = _figure(height=int(420 * aspect + 120), match_aspect=equal, x_range=DataRange1d(range_padding=0))
        shapes = drawing.image(
            "image", float(right.min() - steps[1] / 2), float(up.min() - steps[0] / 2), float(np.ptp(right) + steps[1]),
            float(np.ptp(up) + steps[0]), source=source, color_mapper=mapper,
        )  # fmt: skip
        drawing.xaxis.axis_label, drawing.yaxis.axis_label = context.label(axes[1]), context.label(axes[0])
        drawing.add_tools(HoverTool(renderers=[shapes], tooltips=[("value", "@image"), ("at", "$x, $y")]))
        kind = "raster"
    bar = ColorBar(color_mapper=mapper, height=10, title_text_color=_GREY, major_label_text_color=_GREY,
                   title_text_font_style="normal", background_fill_color=None)  # fmt: skip
    drawing.add_layout(bar, "below")
    palettes = [list(Viridis256), _differences()]
    return drawing, {"source": source, "mapper": mapper, "bar": bar, "palettes": palettes, "kind": kind}


@cache
def _differences() -> list[str]:
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return [to_hex(colour) for colour in colormaps["RdBu_r"](np.linspace(0, 1, 256))]
