"""Figures of the flux on the receiver: maps, of a cylinder unrolled by azimuth, and peak flux over what is swept."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from heliosweep.report.contents import NamedFigure
from heliosweep.report.labels import axis_label, unit_of
from heliosweep.report.layout import colour_bar, fit, label_outside, sheet
from heliosweep.report.panels import Panel, curve_figure
from heliosweep.report.pictures import Shades, edges, from_zero
from heliosweep.report.selection import Point, Shown, at, is_geometric
from heliosweep.report.style import styled

#: Maps of one figure.
MOST_MAPS = 6
#: Height over width of a map, at the least and at the most.
ASPECTS = (0.35, 1.4)
_CELLS = ("flux_row", "flux_column")
_SAID = {
    "flux_map": "Flux on the receiver, mean over each cell",
    "energy_flux_map": "Energy on the receiver over the period, mean over each cell",
}


def flux_figures(shown: Shown, methods: Sequence[Point], stands: Point, along: str | None) -> Iterator[NamedFigure]:
    """Maps of the flux and of the energy, and curves of peak flux and intercept over each swept number."""
    for name in (name for name in _SAID if shown.has(name)):
        dims = [str(dim) for dim in shown.result[name].dims if dim not in _CELLS]
        over = next((dim for dim in ("aim_levels", along) if dim in dims), None)
        fixed = shown.fixed(name, *_CELLS, over, *(dim for method in methods for dim in method))
        places = shown.chosen(over, max(1, MOST_MAPS // len(methods)))
        points = [{**method, **place} for method in methods for place in places]
        maps = [at(shown.result[name], fixed, point).transpose(*_CELLS).load() for point in points]
        titles = [_title(shown, one, point) for one, point in zip(maps, points, strict=True)]
        shades = from_zero(axis_label(shown.result[name]), [one.to_numpy() for one in maps], held=1.0)
        turned = maps[0]["flux_column"].attrs["units"] == "degree"
        more = "; the cylinder is unrolled by the azimuth of its surface, clockwise from north" if turned else ""
        comment = shown.result[name].attrs["comment"].partition(", of all heliostats together, ")[2]
        words = f"{_SAID[name]}{f', {comment}' if comment else ''}{more}."
        yield NamedFigure(f"{name}s", words + shown.note(fixed, places), _maps(maps, titles, shades))
    if shown.has("peak_flux"):
        yield from _curves(shown, methods)


def _title(shown: Shown, one: xr.DataArray, point: Point) -> str:
    values = one.to_numpy()
    told = f"peak {values.max():.4g}, mean {values.mean():.4g} {unit_of(one)}"
    return "\n".join(filter(None, [shown.fulls(point), told if np.isfinite(values).all() else "no value"]))


@styled
def _maps(maps: Sequence[xr.DataArray], titles: Sequence[str], shades: Shades) -> Figure:
    """Draw maps on one colour scale."""
    columns = min(len(maps), 2)
    figure, grid = sheet(len(maps), columns)
    for axes, one, title in zip(grid, maps, titles, strict=True):
        up, right = (edges(one[dim].to_numpy(), alone=_alone(one[dim])) for dim in _CELLS)
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


def _alone(side: xr.DataArray) -> float:
    """Length of a single cell: all around, or about the middle where its size is not told."""
    return 360.0 if side.attrs["units"] == "degree" else 1.0


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
