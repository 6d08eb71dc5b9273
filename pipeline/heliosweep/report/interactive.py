"""Interactive plots of a page, made by Bokeh: figures here, switches and tables in the templates.

A page fetches nothing and evaluates nothing, so Bokeh's own callbacks in JavaScript, which need ``eval``, cannot run;
``templates/page.js`` moves the models of the figures through Bokeh's client interface instead.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.errors import HeliosweepError
from heliosweep.report.client import Model, field, item, script
from heliosweep.report.colours import COLOURS, DIFFERENCES, NO_VALUE, VALUES, shade
from heliosweep.report.payload import PAGE_VALUES, ROOMS, SIZE, fold, shares, view_payload, wanted
from heliosweep.report.views import View, usable

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
KEYS: dict[str, tuple[str, dict[str, str]]] = {
    **{f"Arrow{way.title()}": ("ClickPanTool", {"direction": way}) for way in ("left", "right", "up", "down")},
    **{"+": ("ZoomInTool", {}), "=": ("ZoomInTool", {}), "-": ("ZoomOutTool", {}), "0": ("ResetTool", {})},
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
        plots[name] = item(_plot(view, made), f"{name}-plot")
    return frames, plots


def scripts(plots: bool = True, ranking: bool = False) -> list[str]:
    """Scripts of a page with plots (Bokeh's and our own) and with a ranking; nothing else runs on it."""
    return [*([_harmless(script()), _own("page.js")] if plots else ()), *([_own("ranking.js")] if ranking else ())]


def _own(name: str) -> str:
    return _harmless(resources.files("heliosweep.report").joinpath(f"templates/{name}").read_text("utf-8"))


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
        scale = shade(VALUES, 0.25 + 0.63 * i / (count - 1))
        color = known.get(text, few[i] if count <= len(few) else scale)
        looks.append({"color": color, "dash": list(dash), "mark": mark, "outline": MARKS[mark]})
    return looks


def _plot(view: View, made: Mapping[str, Any]) -> Model:
    """Figure of a view: all that can be drawn, and in its tag the numbers from which that is chosen."""
    spec = {
        **{part: made[part] for part in ("quantities", "dims", "places")},
        "along": list(view.along),
        "less": view.less,
        "named": not view.title,
        "sides": [(name, words) for name, words in SIDES.items() if name in made["places"]],
        "steps": [1, 1],
    }
    parts = (_curves if _is_curved(view) else _coloured)(view, made, spec)
    box = Model("BoxZoomTool", name="zoom", match_aspect=not _is_curved(view) and _to_scale(view, made))
    tools = [Model(f"{name}Tool") for name in ("Pan", "WheelZoom", "Reset")]
    hover = Model("HoverTool", name="hover", renderers=parts.pop("hovered"), tooltips=parts.pop("tooltips"))
    keys = [Model(tool, name=key, visible=False, **more) for key, (tool, more) in KEYS.items()]
    tools = [box, *tools, Model("SaveTool", filename=made["title"]), hover, *keys]
    axes = parts["left"] + [one for one in parts["below"] if one.kind != "ColorBar"]
    parts["center"] = [_grid(axis, axis in parts["left"]) for axis in axes]
    parts.setdefault("x_range", Model("DataRange1d"))
    parts.setdefault("y_range", Model("DataRange1d"))
    return Model(
        "Plot",
        **parts,
        toolbar=Model("Toolbar", tools=tools, active_drag=box, active_scroll=None, logo=None),
        toolbar_location="above",
        sizing_mode="stretch_both",
        min_border_right=12,
        match_aspect=_to_scale(view, made),
        tags=[spec],
    )


def _fonts(title: str) -> dict[str, Any]:
    """Letters of an axis or a bar, of its title and at its ticks."""
    look = {"text_font": "system-ui, sans-serif", "text_font_size": f"{SIZE}px", "text_font_style": "normal"}
    ticks = {**look, "text_font_size": "12px"}
    return {f"{of}_{key}": value for of, one in ((title, look), ("major_label", ticks)) for key, value in one.items()}


def _axis(label: str, ticker: Model, name: str | None = None, kind: str = "LinearAxis", **look: Any) -> Model:
    return Model(
        kind,
        ticker=ticker,
        axis_label=fold(label, ROOMS[0]),
        name=name,
        visible=name is None,
        minor_tick_line_color=None,
        **_fonts("axis_label"),
        **look,
    )


def _grid(axis: Model, across: bool) -> Model:
    return Model("Grid", axis=axis, dimension=int(across), **{key: axis.attributes[key] for key in ("name", "visible")})


def _drawn(data: Mapping[str, Any] | Model, kind: str, name: str | None = None, /, **glyph: Any) -> Model:
    """What is drawn of data, which may be those of another glyph."""
    source = data if isinstance(data, Model) else Model("ColumnDataSource", data=data)
    return Model("GlyphRenderer", name=name, data_source=source, glyph=Model(kind, **glyph))


def _tip(**rows: str) -> str:
    """Rows of what a hovering pointer tells; Bokeh escapes the values that it fills in."""
    return "".join(
        f'<div><span style="color: var(--quiet)">{name.replace("_", ", ").strip(", ")}</span> {value}</div>'
        for name, value in rows.items()
    )


def _coloured(view: View, made: Mapping[str, Any], spec: dict[str, Any]) -> dict[str, Any]:
    """Mirrors of a field, or pixels, coloured by a value: the parts of its figure."""
    palettes = [[shade(name, i / (SHADES - 1)) for i in range(SHADES)] for name in (VALUES, DIFFERENCES)]
    mapper = Model("LinearColorMapper", name="mapper", palette=palettes[0], nan_color=NO_VALUE, tags=palettes)
    dims = [made["dims"][dim] for dim in view.along]
    if view.kind == "field":
        spec |= {"what": "heliostats"}
        data: dict[str, Any] = {name: [0, 1] for name in (*made["places"], "value", "text", "name")}
        sides = {name: field(name) for name in ("x", "y", "width", "height", "angle")}
        fill = field("value", transform=mapper)
        source = Model("ColumnDataSource", data=data, name="source")
        mirrors = _drawn(source, "Rect", **sides, fill_color=fill, line_color=f"{GREY}88", line_width=0.4)
        at = [side for side in SIDES if side in made["places"]]
        tip = _tip(
            heliostat="@name",
            value="@text",
            **{"_".join(SIDES[side].split()[0] for side in at): f"{', '.join(f'@{side}{{0.0}}' for side in at)} m"},
        )
        drawn = [mirrors]
        for edges, dash in zip(made["areas"].values(), ("dashed", "dotted"), strict=False):
            rings = {axis: [ring[:, i] for ring in edges] for i, axis in enumerate(("xs", "ys"))}
            drawn.append(_drawn(rings, "MultiLine", line_color=GREY, line_width=1.5, line_dash=dash))
        tower = {"marker": "triangle", "size": 11, "fill_color": "#1c2126", "line_color": "#ffffff"}
        drawn.append(_drawn({"x": [0], "y": [0]}, "Scatter", **tower))
        titles, tickers = ["north (m)", "east (m)"], [Model("BasicTicker"), Model("BasicTicker")]
    else:
        steps = [-(-len(one["texts"]) // most) for one, most in zip(dims, MOST_CELLS, strict=True)]
        spec |= {"what": "pixels", "steps": steps}
        data = {"image": [np.zeros([len(one["texts"]) for one in dims])]}
        (y, height), (x, width) = (_side(one["at"]) for one in dims)
        source = Model("ColumnDataSource", data=data, name="source")
        pixels = _drawn(source, "Image", image=field("image"), x=x, y=y, dw=width, dh=height, color_mapper=mapper)
        tip, drawn = _tip(value="@image", at="$x, $y"), [pixels]
        titles, tickers = [one["label"] for one in dims], [_ticker(one) for one in dims]
    up, right = (_axis(title, ticker) for title, ticker in zip(titles, tickers, strict=True))
    bar = Model(
        "ColorBar",
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
    return {"renderers": drawn, "hovered": drawn[:1], "tooltips": tip, "left": [up], "below": [right, bar]}


def _ticker(dim: Mapping[str, Any]) -> Model:
    """Ticks along a dimension of numbers, at its own steps."""
    return Model("AdaptiveTicker", mantissas=dim["steps"], base=10) if dim["steps"] else Model("BasicTicker")


def _side(at: np.ndarray) -> tuple[float, float]:
    """Beginning and length of a side of a picture, from the middles of its pixels."""
    step = abs(at[1] - at[0]) if at.size > 1 else 1.0
    return float(at.min() - step / 2), float(np.ptp(at) + step)


def _curves(view: View, made: Mapping[str, Any], spec: dict[str, Any]) -> dict[str, Any]:
    """Curves over a dimension, or points in a plane, a line for each value of another dimension: parts of a figure."""
    most = max([1, *(len(one["looks"]) for one in made["dims"].values() if one["looks"])])
    look = {"color": COLOURS[0], "dash": [], "mark": "circle"}
    spec |= {"lines": [dim for dim in view.lines if dim], "most": most, "look": look}
    paths, marks, at = [], [], {"x": field("x"), "y": field("y")}
    for i in range(most):
        source = Model("ColumnDataSource", data={name: [] for name in ("x", "y", "text", "line", "along")})
        paths.append(_drawn(source, "Line", f"path-{i}", **at, line_width=1.8))
        marks.append(_drawn(source, "Scatter", f"marks-{i}", **at))
    nothing = _drawn({"x": [0, 1], "y": [0, 1]}, "Scatter", "nothing", **at, fill_color=None, line_color=None)
    parts = {
        "renderers": [*(one for pair in zip(paths, marks, strict=True) for one in pair), nothing],
        "hovered": marks,
        "tooltips": _tip(_="@line", __="@along", ___="@text"),
        "left": [_axis("", Model("BasicTicker"))],
    }
    if view.kind == "plane":
        outline = _outline(*view.outline, made) if view.outline else {"renderers": []}
        more = parts["renderers"] + outline.pop("renderers")
        return {**parts, **outline, "renderers": more, "below": [_axis("", Model("BasicTicker"))]}
    return {**parts, "below": [_axis_along(dim, made["dims"][dim]) for dim in view.along]}


def _axis_along(dim: str, one: Mapping[str, Any]) -> Model:
    """Axis of a dimension: of dates, of numbers, or of words and powers at their places."""
    if one["kind"] == "date":
        year = Model("DatetimeTickFormatter", days="%Y", months="", years="", hide_repeats=True)
        words = Model("DatetimeTickFormatter", hours="%H:%M", days="%b %d", months="%b %Y", context=year)
        return _axis("", Model("DatetimeTicker"), dim, "DatetimeAxis", formatter=words)
    if one["joined"] and one["kind"] == "number":
        return _axis("", _ticker(one), dim)
    chosen = range(0, len(one["texts"]), -(-len(one["texts"]) // MOST_TICKS))
    slanted = one["kind"] == "word" and len(one["texts"]) > 5
    return _axis(
        "",
        Model("FixedTicker", ticks=[float(one["at"][i]) for i in chosen]),
        dim,
        major_label_overrides={float(one["at"][i]): one["texts"][i] for i in chosen},
        major_label_orientation=0.7 if slanted else "horizontal",
    )


def _outline(width: float, height: float, made: Mapping[str, Any]) -> dict[str, Any]:
    """A rectangle about the origin, of which the surroundings are seen at first: points far off must not hide it."""
    numbers = [array["values"] for one in made["quantities"] for array in (one, one["across"])]
    far = np.abs(np.concatenate(numbers))
    far = far[np.isfinite(far)]
    side = max(width, height)
    side = min(3 * side, max(1.3 * side, 2.2 * float(np.quantile(far, 0.9)) if far.size else 0.0))
    line = {"line_color": GREY, "line_width": 1.5, "line_dash": "dashed"}
    frame, around = (
        _drawn({"x": [0], "y": [0]}, "Rect", width=sides[0], height=sides[1], fill_color=None, **look)
        for sides, look in (((width, height), line), ((side, side), {"line_color": None}))
    )
    seen = {f"{axis}_range": Model("DataRange1d", renderers=[around]) for axis in "xy"}
    return {"renderers": [frame, around], **seen}


def _aspect(view: View, made: Mapping[str, Any]) -> float:
    """Height of what is drawn as part of its width."""
    if view.kind == "raster":
        (_, height), (_, width) = (_side(made["dims"][dim]["at"]) for dim in view.along)
        return round(height / width, 3) if _to_scale(view, made) else 0.4
    if view.kind == "field":
        x, y = (np.append(made["places"][name]["values"], 0.0) for name in "xy")
        return round(float(np.clip((np.nanmax(y) - np.nanmin(y)) / (np.nanmax(x) - np.nanmin(x) or 1.0), 0.4, 1.2)), 3)
    return 1.0
