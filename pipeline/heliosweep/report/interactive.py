"""Interactive plots of a page, made by Bokeh: figures here, switches and tables in the templates.

A page fetches nothing and evaluates nothing, so Bokeh's own callbacks in JavaScript, which need ``eval``, cannot run;
``templates/page.js`` moves the models of the figures through Bokeh's client interface instead.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib import resources
from typing import Any
from unittest import mock

import numpy as np
import xarray as xr
from bokeh.core.types import ID
from bokeh.model import Model
from bokeh.resources import Resources
from matplotlib import colormaps
from matplotlib.colors import to_hex

from heliosweep.errors import HeliosweepError
from heliosweep.report.payload import PAGE_VALUES, ROOMS, SIZE, fold, shares, view_payload, wanted
from heliosweep.report.style import COLOURS, DIFFERENCES, NO_VALUE, VALUES
from heliosweep.report.views import View, usable

# A third of the time that Bokeh's models take to import goes into signatures for its manual.
with mock.patch.object(Model, "parameters", classmethod(lambda cls: [])):
    from bokeh import models as bk
    from bokeh.embed import json_item
    from bokeh.models.annotations import ColorBar

#: Colours of a scale.
SHADES = 128

#: Values of a dimension of which each may have a line, and up to which a switch is a list and no slide.
MOST_LINES, MOST_OPTIONS = 26, 12

#: Words, or values that no line joins, along an axis.
MOST_TICKS = 13

#: Rows and columns of a picture in its table: nobody reads ten thousand.
MOST_CELLS = (15, 9)

DASHES = ((), (6, 3), (2, 2), (8, 2, 2, 2), (12, 3), (4, 2))
MARKS = {
    "circle": "M-3 0a3 3 0 1 0 6 0a3 3 0 1 0-6 0z",
    "square": "M-3-3h6v6h-6z",
    "triangle": "M0-3.5L3.5 3h-7z",
    "diamond": "M0-4L3 0L0 4L-3 0z",
    "inverted_triangle": "M0 3.5L3.5-3h-7z",
    "plus": "M-4 0h8M0-4v8",
    "x": "M-3-3L3 3M-3 3L3-3",
}

#: Between light and dark, to be seen on both.
GREY = "#80868c"

#: Where a mirror stands, by coordinate.
SIDES = {"x": "east (m)", "y": "north (m)", "z": "up (m)"}

#: What is said of the edges of a field.
AREAS = "Dashed: boundary of the field; dotted: where no heliostat may stand."

#: Tools by the keys that use them.
KEYS = {
    **{f"Arrow{way.title()}": bk.ClickPanTool(direction=way) for way in ("left", "right", "up", "down")},
    **{"+": bk.ZoomInTool(), "=": bk.ZoomInTool(), "-": bk.ZoomOutTool(), "0": bk.ResetTool()},
}


def explore(result: xr.Dataset, views: Iterable[View]) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Make the interactive plots that a family declares: what the templates set of each, and Bokeh's items by name."""
    chosen = usable(result, views)
    budgets = shares([wanted(result, view) for view in chosen], PAGE_VALUES)
    frames, plots = [], {}
    for number, (view, budget) in enumerate(zip(chosen, budgets, strict=True), 1):
        name, made = f"view-{number}", view_payload(result, view, budget)
        for dim in made["dims"].values():
            dim["looks"] = _looks(dim["texts"], view.colours)
        frames.append(
            {
                "id": name,
                "kind": view.kind,
                "title": made["title"],
                "caption": " ".join(filter(None, [view.caption, AREAS * bool(made["areas"]), made["thinned"]])),
                "switches": _switches(view, made),
                "lines": [(dim, one) for dim, one in made["dims"].items() if one["looks"]] if _is_curved(view) else [],
                "aspect": _aspect(view, made),
            }
        )
        plots[name] = _numbered(json_item(_plot(view, made), ID(f"{name}-plot")), f"{name}-", {})
    return frames, plots


def scripts(plots: bool = True, ranking: bool = False) -> list[str]:
    """Scripts of a page with plots (Bokeh's and our own) and with a ranking; nothing else runs on it."""
    return [*([_bokeh(), _own("page.js")] if plots else ()), *([_own("ranking.js")] if ranking else ())]


def _own(name: str) -> str:
    return _harmless(resources.files("heliosweep.report").joinpath(f"templates/{name}").read_text("utf-8"))


@cache
def _bokeh() -> str:
    script = "\n".join(Resources(mode="inline", components=["bokeh"], log_level="warn").js_raw)
    # A map of the sources would be fetched by the developer tools.
    return _harmless(re.sub(r"^//# sourceMappingURL=.*$", "", script, flags=re.MULTILINE))


def _harmless(script: str) -> str:
    if re.search(r"</script|<!--", script, re.IGNORECASE):
        raise HeliosweepError("a script cannot be part of a page: it holds the end of a script")
    return script


def _is_curved(view: View) -> bool:
    return view.kind in ("curves", "plane")


def _to_scale(view: View, made: Mapping[str, Any]) -> bool:
    """Whether both axes are lengths of one unit, as those of a picture may not be."""
    units = {made["dims"][dim]["label"].rpartition("(")[2] for dim in view.along} if view.kind == "raster" else ()
    return view.kind != "curves" and len(units) < 2


def _numbered(value: Any, prefix: str, names: dict[str, str]) -> Any:
    """The same models, numbered from one: Bokeh counts on through all that a process makes."""
    if isinstance(value, Mapping):
        return {
            key: names.setdefault(one, f"{prefix}{len(names) + 1}")
            if key in ("id", "root_id")
            else _numbered(one, prefix, names)
            for key, one in value.items()
        }
    return [_numbered(one, prefix, names) for one in value] if isinstance(value, list) else value


def _switches(view: View, made: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Native controls: what each chooses, its words, and where it stands at first."""
    dims, curved = made["dims"], _is_curved(view)
    switches = [
        _switch("quantity", "Quantity", [(i, one["shown"][0]["label"]) for i, one in enumerate(made["quantities"])])
    ]
    if curved:
        over = [(dim, dims[dim]["title"] if dim in dims else dim) for dim in view.along]
        lines = [(dim, one["title"]) for dim, one in dims.items() if one["looks"]]
        switches.append(_switch("along", "Along" if view.kind == "plane" else "Over", over))
        switches.append(_switch("lines", "A line for each", [("", "one line only"), *lines]))
    for dim, one in dims.items():
        if len(one["texts"]) > 1 and (curved or dim not in view.along):
            options = list(enumerate(one["texts"]))
            switches.append(_switch(f"dim-{dim}", one["title"], options, made["start"].get(dim, 0), dim))
    if not curved:
        if view.less in dims:
            others = [*enumerate(dims[view.less]["texts"], 1)]
            switches.append(_switch("less", "Difference from", [(0, "nothing"), *others], dim=view.less))
        switches.append(_switch("scale", "Colours", [("all", "one scale for all"), ("one", "scale of this one")]))
    return switches


def _switch(
    name: str, label: str, options: Sequence[tuple[Any, str]], start: Any = None, dim: str | None = None
) -> dict[str, Any]:
    is_range = name == f"dim-{dim}" and len(options) > MOST_OPTIONS
    return {"name": name, "label": label, "options": options, "start": start, "dim": dim, "range": is_range}


def _looks(texts: Sequence[str], known: Mapping[str, str]) -> list[dict[str, Any]] | None:
    """Colours, dashes and marks of lines: those of the figures for a few, a scale for many; none for too many."""
    count, few = len(texts), [*COLOURS[:-1], GREY]
    if not 1 < count <= MOST_LINES:
        return None
    looks = []
    for i, text in enumerate(texts):
        mark = list(MARKS)[i % len(MARKS)] if text in known or count <= len(few) else "circle"
        dash = DASHES[i % len(DASHES)] if text in known or count <= len(few) else ()
        scale = to_hex(colormaps[VALUES](0.25 + 0.63 * i / (count - 1)))
        color = known.get(text, few[i] if count <= len(few) else scale)
        looks.append({"color": color, "dash": list(dash), "mark": mark, "outline": MARKS[mark]})
    return looks


def _plot(view: View, made: Mapping[str, Any]) -> bk.Plot:
    """Figure of a view: all that can be drawn, and in its tag the numbers from which that is chosen."""
    spec = {
        **{part: made[part] for part in ("quantities", "dims", "places")},
        "along": list(view.along),
        "less": view.less,
        "named": not view.title,
        "sides": [(name, words) for name, words in SIDES.items() if name in made["places"]],
        "steps": [1, 1],
    }
    box = bk.BoxZoomTool(name="zoom", match_aspect=not _is_curved(view) and _to_scale(view, made))
    hover = bk.HoverTool(name="hover")
    save = bk.SaveTool(filename=made["title"])
    keys = [tool.clone(name=key, visible=False) for key, tool in KEYS.items()]
    tools: list[Any] = [box, bk.PanTool(), bk.WheelZoomTool(), bk.ResetTool(), save, hover, *keys]
    plot = bk.Plot(
        x_range=bk.DataRange1d(),
        y_range=bk.DataRange1d(),
        toolbar=bk.Toolbar(tools=tools, active_drag=box, active_scroll=None, logo=None),
        toolbar_location="above",
        sizing_mode="stretch_both",
        min_border_right=12,
        match_aspect=_to_scale(view, made),
        tags=[spec],
    )
    if _is_curved(view):
        _curves(plot, hover, view, made, spec)
    else:
        _coloured(plot, hover, view, made, spec)
    return plot


def _fonts(title: str) -> dict[str, Any]:
    """Letters of an axis or a bar, of its title and at its ticks."""
    look = {"text_font": "system-ui, sans-serif", "text_font_size": f"{SIZE}px", "text_font_style": "normal"}
    ticks = {**look, "text_font_size": "12px"}
    return {f"{of}_{key}": value for of, one in ((title, look), ("major_label", ticks)) for key, value in one.items()}


def _axis(plot: bk.Plot, place: Any, label: str, name: str | None = None, **look: Any) -> None:
    axis = look.pop("kind", bk.LinearAxis)(
        axis_label=fold(label, ROOMS[0]),
        name=name,
        visible=name is None,
        minor_tick_line_color=None,
        **_fonts("axis_label"),
        **look,
    )
    plot.add_layout(axis, place)
    plot.add_layout(bk.Grid(axis=axis, dimension=1 if place == "left" else 0, name=name, visible=name is None))


def _tip(**rows: str) -> str:
    """Rows of what a hovering pointer tells; Bokeh escapes the values that it fills in."""
    return "".join(
        f'<div><span style="color: var(--quiet)">{name.replace("_", ", ").strip(", ")}</span> {value}</div>'
        for name, value in rows.items()
    )


def _coloured(plot: bk.Plot, hover: bk.HoverTool, view: View, made: Mapping[str, Any], spec: dict[str, Any]) -> None:
    """Mirrors of a field, or pixels, coloured by a value."""
    palettes = [[to_hex(colormaps[name](i / (SHADES - 1))) for i in range(SHADES)] for name in (VALUES, DIFFERENCES)]
    mapper = bk.LinearColorMapper(name="mapper", palette=palettes[0], nan_color=NO_VALUE, tags=palettes)
    dims = [made["dims"][dim] for dim in view.along]
    if view.kind == "field":
        spec |= {"what": "heliostats"}
        sides: dict[str, Any] = {name: name for name in ("x", "y", "width", "height", "angle")}
        source = bk.ColumnDataSource(
            {name: [0, 1] for name in (*made["places"], "value", "text", "name")}, name="source"
        )
        at = [side for side in SIDES if side in made["places"]]
        fill: Any = {"field": "value", "transform": mapper}
        mirrors = bk.Rect(**sides, fill_color=fill, line_color=f"{GREY}88", line_width=0.4)
        hover.update(
            renderers=[plot.add_glyph(source, mirrors)],
            tooltips=_tip(
                heliostat="@name",
                value="@text",
                **{"_".join(SIDES[side].split()[0] for side in at): f"{', '.join(f'@{side}{{0.0}}' for side in at)} m"},
            ),
        )
        for edges, dash in zip(made["areas"].values(), ("dashed", "dotted"), strict=False):
            lines = bk.ColumnDataSource({axis: [ring[:, i] for ring in edges] for i, axis in enumerate(("xs", "ys"))})
            plot.add_glyph(lines, bk.MultiLine(xs="xs", ys="ys", line_color=GREY, line_width=1.5, line_dash=dash))
        tower = bk.Scatter(x=0, y=0, marker="triangle", size=11, fill_color="#1c2126", line_color="#ffffff")
        plot.add_glyph(bk.ColumnDataSource({"x": [0]}), tower)
        titles = ["north (m)", "east (m)"]
    else:
        steps = [-(-len(one["texts"]) // most) for one, most in zip(dims, MOST_CELLS, strict=True)]
        spec |= {"what": "pixels", "steps": steps}
        source = bk.ColumnDataSource({"image": [np.zeros([len(one["texts"]) for one in dims])]}, name="source")
        (y, height), (x, width) = (_side(one["at"]) for one in dims)
        pixels = bk.Image(image="image", x=x, y=y, dw=width, dh=height, color_mapper=mapper)
        hover.update(renderers=[plot.add_glyph(source, pixels)], tooltips=_tip(value="@image", at="$x, $y"))
        titles = [one["label"] for one in dims]
    tickers = [_ticker(one) for one in dims] if view.kind == "raster" else [bk.BasicTicker(), bk.BasicTicker()]
    for place, title, ticker in zip(("left", "below"), titles, tickers, strict=True):
        _axis(plot, place, title, ticker=ticker)
    bar = ColorBar(
        name="bar",
        color_mapper=mapper,
        height=10,
        width="auto",
        padding=8,
        margin=0,
        title_standoff=6,
        bar_line_color=None,
        **_fonts("title"),
    )
    plot.add_layout(bar, "below")


def _ticker(dim: Mapping[str, Any]) -> bk.Ticker:
    """Ticks along a dimension of numbers, at its own steps."""
    return bk.AdaptiveTicker(mantissas=dim["steps"], base=10) if dim["steps"] else bk.BasicTicker()


def _side(at: np.ndarray) -> tuple[float, float]:
    """Beginning and length of a side of a picture, from the middles of its pixels."""
    step = abs(at[1] - at[0]) if at.size > 1 else 1.0
    return float(at.min() - step / 2), float(np.ptp(at) + step)


def _curves(plot: bk.Plot, hover: bk.HoverTool, view: View, made: Mapping[str, Any], spec: dict[str, Any]) -> None:
    """Curves over a dimension, or points in a plane: a line for each value of another dimension."""
    most = max([1, *(len(one["looks"]) for one in made["dims"].values() if one["looks"])])
    look = {"color": COLOURS[0], "dash": [], "mark": "circle"}
    spec |= {"lines": [dim for dim in view.lines if dim], "most": most, "look": look}
    marks = []
    for i in range(most):
        source = bk.ColumnDataSource({name: [] for name in ("x", "y", "text", "line", "along")})
        plot.add_glyph(source, bk.Line(x="x", y="y", line_width=1.8), name=f"path-{i}")
        marks.append(plot.add_glyph(source, bk.Scatter(x="x", y="y"), name=f"marks-{i}"))
    hover.update(renderers=marks, tooltips=_tip(_="@line", __="@along", ___="@text"))
    nothing = bk.ColumnDataSource({"x": [0, 1], "y": [0, 1]})
    plot.add_glyph(nothing, bk.Scatter(x="x", y="y", fill_color=None, line_color=None), name="nothing")
    _axis(plot, "left", "")
    if view.kind == "plane":
        _axis(plot, "below", "")
        if view.outline:
            _outline(plot, *view.outline, made)
        return
    for dim in view.along:
        one = made["dims"][dim]
        if one["kind"] == "date":
            _axis(plot, "below", "", dim, kind=bk.DatetimeAxis)
        elif one["joined"] and one["kind"] == "number":
            _axis(plot, "below", "", dim, ticker=_ticker(one))
        else:
            chosen = range(0, len(one["texts"]), -(-len(one["texts"]) // MOST_TICKS))
            slanted = one["kind"] == "word" and len(one["texts"]) > 5
            _axis(
                plot,
                "below",
                "",
                dim,
                ticker=bk.FixedTicker(ticks=[float(one["at"][i]) for i in chosen]),
                major_label_overrides={float(one["at"][i]): one["texts"][i] for i in chosen},
                major_label_orientation=0.7 if slanted else "horizontal",
            )


def _outline(plot: bk.Plot, width: float, height: float, made: Mapping[str, Any]) -> None:
    """A rectangle about the origin, of which the surroundings are seen at first: points far off must not hide it."""
    line: Any = {"line_color": GREY, "line_width": 1.5, "line_dash": "dashed"}
    frame = bk.Rect(x=0, y=0, width=width, height=height, fill_color=None, **line)
    numbers = [array["values"] for one in made["quantities"] for array in (one, one["across"])]
    far = np.abs(np.concatenate(numbers))
    far = far[np.isfinite(far)]
    side = max(width, height)
    side = min(3 * side, max(1.3 * side, 2.2 * float(np.quantile(far, 0.9)) if far.size else 0.0))
    around = bk.Rect(x=0, y=0, width=side, height=side, fill_color=None, line_color=None)
    plot.add_glyph(bk.ColumnDataSource({"x": [0]}), frame)
    seen: list[bk.Model] = [plot.add_glyph(bk.ColumnDataSource({"x": [0]}), around)]
    plot.update(x_range=bk.DataRange1d(renderers=seen), y_range=bk.DataRange1d(renderers=seen))


def _aspect(view: View, made: Mapping[str, Any]) -> float:
    """Height of what is drawn as part of its width."""
    if view.kind == "raster":
        (_, height), (_, width) = (_side(made["dims"][dim]["at"]) for dim in view.along)
        return round(height / width, 3) if _to_scale(view, made) else 0.4
    if view.kind == "field":
        x, y = (np.append(made["places"][name]["values"], 0.0) for name in "xy")
        return round(float(np.clip((np.nanmax(y) - np.nanmin(y)) / (np.nanmax(x) - np.nanmin(x) or 1.0), 0.4, 1.2)), 3)
    return 1.0
