"""Figures of mirrors and of the receiver's surface.

How far the axes of the mirrors turn; outlines of shadows, after Figure 4 of Chong and Tan (2012); the flux on the
receiver, of a cylinder unrolled by azimuth, and the peak flux over what is swept.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Polygon, Rectangle
from matplotlib.patheffects import withStroke

from heliosweep.report.colours import COLOURS
from heliosweep.report.contents import NamedFigure
from heliosweep.report.labels import axis_label, number_text, unit_of
from heliosweep.report.layout import colour_bar, fit, label_outside, legend, sheet
from heliosweep.report.panels import Panel, curve_figure
from heliosweep.report.pictures import COLUMNS, Shades, edges, field_map, from_zero, picture_figure, symbols
from heliosweep.report.selection import Point, Shown, at, is_geometric
from heliosweep.report.style import styled

#: Places (directions of the sun) of which outlines are drawn.
MOST_PLACES = 3
#: Share of the largest outline below which no number is written. [1]
LEAST_NAMED = 0.05
#: Of each effect: words, colour and hatching.
_LOOKS = {
    "shading": ("shadow of the heliostat with this number", COLOURS[0], ""),
    "blocking": ("hidden from the receiver by the one with this number", COLOURS[1], "///"),
}
#: Maps of one figure.
MOST_MAPS = 6
#: Height over width of a map, at the least and at the most.
ASPECTS = (0.35, 1.4)
_CELLS = ("flux_row", "flux_column")
_SAID = {
    "flux_map": "Flux on the receiver, mean over each cell",
    "energy_flux_map": "Energy on the receiver over the period, mean over each cell",
}


def motion_maps(shown: Shown, methods: Sequence[Point], stands: Point, along: str | None) -> Iterator[NamedFigure]:
    """Maps of the range of motion of both axes."""
    places = shown.chosen(along, COLUMNS)
    for axis in ("primary", "secondary"):
        name = f"{axis}_angle_range"
        maps = []
        for method in methods:
            for place in places:
                values = at(shown.result[name], stands, method, place).to_numpy()
                known = values[np.isfinite(values)]
                ends = (
                    f"{known.min():.0f} to {known.max():.0f}, median {np.median(known):.0f} deg" if known.size else ""
                )
                title = ", ".join(filter(None, [shown.values(method), shown.fulls(place)]))
                one = field_map(shown.result.isel({**stands, **method, **place}), values, f"{title}\n{ends}")
                if one is not None:
                    maps.append(one)
        if maps:
            shades = from_zero(f"range of motion of the {axis} axis (deg)", [one.values for one in maps], held=1.0)
            figure = picture_figure(maps, shades, len(maps) // len(methods) if len(methods) > 1 else 0)
            words = "vertical, or along the line to the receiver" if axis == "primary" else "the one in the mirror"
            caption = f"Largest minus least angle of the {axis} axis ({words}) over the period."
            yield NamedFigure(
                f"{axis}_motion_maps", f"{caption} {symbols(maps, sized=True)}{shown.note(stands, places)}", figure
            )


def outline_figures(shown: Shown, methods: Sequence[Point], stands: Point, along: str | None) -> Iterator[NamedFigure]:
    """Shadows and blocked parts on the mirror that loses most."""
    places = shown.chosen(along, MOST_PLACES)
    names = [name for name in shown.result.data_vars if str(name).startswith("outline_")]
    panels = []
    for method in methods:
        for place in places:
            here = shown.result[[*names, "shading_efficiency", "blocking_efficiency"]].isel(
                {**stands, **method, **place}
            )
            title = ", ".join(filter(None, [shown.values(method), shown.fulls(place)]))
            lost = {effect: 1 - here[f"{effect}_efficiency"].to_numpy() for effect in _LOOKS}
            if np.isfinite(lost["shading"]).any():
                # The mirror that loses most by the effect of which it has less.
                index = int(np.nanargmax(np.minimum(*lost.values()) + 1e-3 * np.maximum(*lost.values())))
                panels.append((title, here.isel(heliostat=index).load()))
    if panels:
        columns = len(panels) // len(methods) if len(methods) > 1 and len(panels) % len(methods) == 0 else 0
        caption = (
            "The mirror on which both shadows and blocked parts are largest, in its own plane, seen from its front: "
            "outlines of what each other heliostat, named by its number, takes from it."
        )
        yield NamedFigure("mirror_outlines", caption + shown.note(stands, places), _outlines(panels, columns))


@styled
def _outlines(panels: Sequence[tuple[str, xr.Dataset]], columns: int) -> Figure:
    """Draw mirrors with their outlines, all on one scale."""
    columns = columns or min(len(panels), 2)
    figure, grid = sheet(len(panels), columns)
    sides = [[float(one[f"heliostat_{side}"]) / 2 for side in ("width", "height")] for _, one in panels]
    right, up = (1.06 * float(end) for end in np.max(sides, axis=0))
    for axes, (title, one), (half_width, half_height) in zip(grid, panels, sides, strict=True):
        axes.add_patch(
            Rectangle(
                (-half_width, -half_height), 2 * half_width, 2 * half_height, facecolor="#f2f2f2", edgecolor="black"
            )
        )
        for effect in _LOOKS:
            _draw(axes, one.sel(effect=effect), effect)
        lost = " and ".join(
            f"{number_text(100 * (1 - float(one[f'{effect}_efficiency'])), 1)} % {word}"
            for effect, word in (("shading", "shaded"), ("blocking", "blocked"))
        )
        axes.set(title=f"{title}\nheliostat {int(one['heliostat'])}: {lost}", xlim=(-right, right), ylim=(-up, up))
    label_outside(grid, columns, "along the width (m)", ["along the height (m)"] * len(grid))
    entries = {
        words: Patch(facecolor=f"{colour}40", edgecolor=colour, hatch=hatch) for words, colour, hatch in _LOOKS.values()
    }
    legend(figure, entries, loc="lower center")
    return fit(figure, up / right)


def _draw(axes: Axes, one: xr.Dataset, effect: str) -> None:
    _, colour, hatch = _LOOKS[effect]
    for image in range(one.sizes["image"]):
        corners = np.stack([one[f"outline_{side}"].to_numpy()[image] for side in "uv"], axis=-1)
        corners = corners[np.isfinite(corners[:, 0])]
        if not len(corners):
            return
        axes.add_patch(Polygon(corners, facecolor=f"{colour}40", edgecolor=colour, hatch=hatch, linewidth=0.8))
        number = f"{one['outline_heliostat'].to_numpy()[image]:.0f}"
        if float(one["outline_area"][image]) > LEAST_NAMED * float(one["outline_area"].max()):
            x, y = corners.mean(axis=0)
            halo = [withStroke(linewidth=2, foreground="white")]
            axes.text(x, y, number, ha="center", va="center", color=colour, path_effects=halo)


def flux_figures(shown: Shown, methods: Sequence[Point], stands: Point, along: str | None) -> Iterator[NamedFigure]:
    """Maps of the flux and of the energy, and curves of peak flux and intercept over each swept number."""
    for name in (name for name in _SAID if shown.has(name)):
        dims = [str(dim) for dim in shown.result[name].dims if dim not in _CELLS]
        over = next((dim for dim in ("aim_levels", along) if dim in dims), None)
        fixed = shown.fixed(name, *_CELLS, over, *(dim for method in methods for dim in method))
        places = shown.chosen(over, max(1, MOST_MAPS // len(methods)))
        points = [{**method, **place} for method in methods for place in places]
        maps = [at(shown.result[name], fixed, point).transpose(*_CELLS).load() for point in points]
        titles = []
        for one, point in zip(maps, points, strict=True):
            told = f"peak {float(one.max()):.4g}, mean {float(one.mean(skipna=False)):.4g} {unit_of(one)}"
            titles.append("\n".join(filter(None, [shown.fulls(point), told if one.notnull().all() else "no value"])))
        shades = from_zero(axis_label(shown.result[name]), [one.to_numpy() for one in maps], held=1.0)
        turned = maps[0]["flux_column"].attrs["units"] == "degree"
        more = "; the cylinder is unrolled by the azimuth of its surface, clockwise from north" if turned else ""
        comment = shown.result[name].attrs["comment"].partition(", of all heliostats together, ")[2]
        words = f"{_SAID[name]}{f', {comment}' if comment else ''}{more}."
        yield NamedFigure(f"{name}s", words + shown.note(fixed, places), _flux_maps(maps, titles, shades))
    if shown.has("peak_flux"):
        yield from _curves(shown, methods)


@styled
def _flux_maps(maps: Sequence[xr.DataArray], titles: Sequence[str], shades: Shades) -> Figure:
    """Draw maps on one colour scale."""
    columns = min(len(maps), 2)
    figure, grid = sheet(len(maps), columns)
    for axes, one, title in zip(grid, maps, titles, strict=True):
        # A single cell is all around a cylinder, or has a length of its own where its size is not told.
        alone = 360.0 if one["flux_column"].attrs["units"] == "degree" else 1.0
        up = edges(one["flux_row"].to_numpy())
        right = edges(one["flux_column"].to_numpy(), alone=alone)
        values = np.ma.masked_invalid(one.to_numpy())
        axes.pcolormesh(right, up, values, cmap=shades.colours, norm=shades.norm, rasterized=True)
        axes.set(title=title)
        if one["flux_column"].attrs["units"] == "degree":
            axes.set_xticks(range(0, 361, 90))
    upwards = f"height ({unit_of(maps[0]['flux_row']) or '1'})"
    label_outside(grid, columns, axis_label(maps[0]["flux_column"]), [upwards] * len(grid))
    colour_bar(figure, ScalarMappable(shades.norm, shades.colours), grid, shades.label, "neither")
    same = maps[0]["flux_column"].attrs["units"] == maps[0]["flux_row"].attrs["units"]
    return fit(figure, float(np.clip(np.ptp(up) / np.ptp(right), *ASPECTS)) if same else ASPECTS[0])


def _curves(shown: Shown, methods: Sequence[Point]) -> Iterator[NamedFigure]:
    """Peak flux and intercept over each swept number."""
    dims = [str(dim) for dim in shown.result["peak_flux"].dims if dim not in methods[0] and shown.is_number(str(dim))]
    for dim in dims[:2]:
        fixed = shown.fixed("peak_flux", dim, *methods[0])
        panels = [
            Panel(label, {shown.values(one): scale * at(shown.result[name], fixed, one) for one in methods})
            for name, label, scale in (
                ("peak_flux", "peak flux (kW/m\N{SUPERSCRIPT TWO})", 1.0),
                ("field_intercept_efficiency", "intercept efficiency (%)", 100.0),
            )
        ]
        figure = curve_figure(panels, shown.label(dim), logarithmic=is_geometric(shown.result[dim].to_numpy()))
        caption = f"Largest flux of a cell, and intercept of the field, against {shown.title(dim)}."
        yield NamedFigure(f"peak_flux_over_{dim}", caption + shown.note(fixed), figure)
