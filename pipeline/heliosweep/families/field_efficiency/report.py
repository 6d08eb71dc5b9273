"""Figures of a finished result: maps of the field after Figures 6 to 8 of Chong and Tan (2012), and curves.

Every figure reads only what it draws; long sweeps are thinned, and the caption says what is shown.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import xarray as xr

from heliosweep.families.field_efficiency.courses import day_courses
from heliosweep.families.registry import NamedFigure
from heliosweep.report import curves, maps
from heliosweep.report.labels import DEGREE, axis_label, is_latitude, number_text, printed, title_of
from heliosweep.report.selection import Selection
from heliosweep.report.style import DIFFERENCES, VALUES

#: Latitudes (or sites, layouts, ...) of which maps are drawn.
MOST_MAPS = 6

#: Latitudes from which on curves say more than the maps.
LEAST_LATITUDES = 4

#: Figures of curves, one for each swept number.
MOST_CURVES = 3

_METHODS = ["spinning_elevation", "azimuth_elevation"]
_MAPPED = "optical_efficiency"
_CURVES = {
    "field_optical_efficiency": "optical efficiency (%)",
    "field_cosine_efficiency": "cosine efficiency (%)",
    "field_shading_efficiency": "shading efficiency (%)",
    "field_blocking_efficiency": "blocking efficiency (%)",
}


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Figures of a result, each drawn when it is asked for.

    Parameters
    ----------
    result : xarray.Dataset
        From `heliosweep.open_result`; values are read as they are needed.

    Yields
    ------
    NamedFigure
    """
    dims = tuple(map(str, result["field_optical_efficiency"].dims))
    shown = Selection(result, dims, rows="tracking", preferred=("latitude", "site"))
    columns = [
        [_field_map(shown, {**row, **column}) for row in shown.row_points()] for column in shown.columns(MOST_MAPS)
    ]
    yield from _curves(shown)
    yield from _field_maps(shown, columns)
    yield from _difference_maps(shown, columns)
    if f"instantaneous_{_MAPPED}" in result:
        yield day_courses(shown)


def _field_map(shown: Selection, point: dict[str, int]) -> maps.FieldMap:
    """Map of one method at one place, titled with the mean of its field."""
    here = shown.result.isel(point)
    place = ", ".join(text for text in (shown.row_text(point), shown.column_text(point)) if text)
    mean = float(printed(here[f"field_{_MAPPED}"]))
    x, y = here["x"].to_numpy(), here["y"].to_numpy()
    words = f"field mean {number_text(mean)} %" if np.isfinite(mean) else "no value"
    return maps.FieldMap(
        title=f"{place}\n{words}" if place else words,
        x=x,
        y=y,
        width=_side(here, "heliostat_width", x),
        height=_side(here, "heliostat_height", x),
        values=printed(here[_MAPPED]),
    )


def _side(here: xr.Dataset, name: str, like: np.ndarray) -> np.ndarray:
    """Width or height of every mirror; zero, which is drawn as small as can be, where the result does not tell."""
    known = here[name].to_numpy() if name in here.coords else 0.0
    return np.broadcast_to(np.asarray(known, dtype=float), like.shape)


def _field_maps(shown: Selection, columns: list[list[maps.FieldMap]]) -> Iterator[NamedFigure]:
    everything = [one for column in columns for one in column]
    scale = maps.value_scale(everything)
    caption = (
        "Mean optical efficiency of each heliostat over the period, on one colour scale for all maps. "
        f"{_how_drawn(everything)}{shown.note('tracking', shown.column, most=MOST_MAPS)}"
    )
    yield from _sheets("field_maps", caption, columns, scale, f"{title_of(shown.result[_MAPPED])} (%)", VALUES)


def _difference_maps(shown: Selection, columns: list[list[maps.FieldMap]]) -> Iterator[NamedFigure]:
    """Spinning-elevation minus azimuth-elevation, where both were computed."""
    if "tracking" not in shown.dims:
        return
    order = list(shown.result["tracking"].to_numpy())
    if not set(_METHODS) <= set(order):
        return
    first, second = (order.index(method) for method in _METHODS)
    differences = [_difference(column[first], column[second]) for column in columns]
    # The first line of a map's title names the method, which both share here, and the place.
    places = [shown.column_text(point) for point in shown.columns(MOST_MAPS)]
    single = [
        [replace(one, title=f"{place}\n{one.title}" if place else one.title)]
        for one, place in zip(differences, places, strict=True)
    ]
    caption = (
        "Mean optical efficiency of each heliostat over the period, spinning-elevation minus azimuth-elevation: "
        "red where spinning-elevation is better. "
        f"{_how_drawn(differences)}{shown.note('tracking', shown.column, most=MOST_MAPS)}"
    )
    label = "spinning-elevation minus azimuth-elevation (percentage points)"
    yield from _sheets("difference_maps", caption, single, maps.difference_scale(differences), label, DIFFERENCES)


def _difference(one: maps.FieldMap, other: maps.FieldMap) -> maps.FieldMap:
    values = one.values - other.values
    finite = values[np.isfinite(values)]
    ends = [number_text(float(end), signed=True) for end in (finite.min(), finite.max())] if finite.size else []
    title = f"{' to '.join(dict.fromkeys(ends))} points" if ends else "no value"
    return replace(one, values=values, title=title)


def _sheets(
    name: str,
    caption: str,
    columns: list[list[maps.FieldMap]],
    scale: tuple[float, float],
    label: str,
    colours: str,
) -> Iterator[NamedFigure]:
    """Share columns of maps among figures of a size that can be read."""
    sheets = maps.pages(len(columns), len(columns[0]))
    for number, part in enumerate(sheets, start=1):
        chosen = columns[part]
        if len(chosen[0]) > 1:
            rows = [list(row) for row in zip(*chosen, strict=True)]
        else:
            wide = -(-len(chosen) // -(-len(chosen) // maps.COLUMNS))
            row = [column[0] for column in chosen]
            rows = [row[start : start + wide] for start in range(0, len(row), wide)]
        which = f" (Part {number} of {len(sheets)}.)" if len(sheets) > 1 else ""
        figure = maps.map_figure(rows, scale, label, colours)
        yield NamedFigure(name if number == 1 else f"{name}_{number}", caption + which, figure)


def _how_drawn(drawn: list[maps.FieldMap]) -> str:
    larger = maps.magnification(drawn)
    size = "to scale" if larger == 1.0 else "larger than to scale"
    grey = any(np.isnan(one.values[np.isfinite(one.x)]).any() for one in drawn)
    return (
        f"Each square is a mirror, {size}, laid flat with a side towards the tower (triangle)."
        f"{' Grey: no value.' if grey else ''}"
    )


def _curves(shown: Selection) -> Iterator[NamedFigure]:
    """Efficiencies of the field over each swept number."""
    swept = [dim for dim in shown.dims if dim != "tracking" and _is_number(shown.result, dim)]
    swept = [dim for dim in swept if shown.result.sizes[dim] >= (LEAST_LATITUDES if dim == "latitude" else 2)]
    swept.sort(key=lambda dim: dim != "latitude")
    for dim in swept[:MOST_CURVES]:
        axis = shown.result[dim]
        x = axis.to_numpy()
        fixed = shown.fixed("tracking", dim)
        panels = [
            curves.Panel(
                label,
                {
                    shown.row_text(row): (x, printed(shown.result[name].isel({**fixed, **row})))
                    for row in shown.row_points()
                },
            )
            for name, label in _CURVES.items()
        ]
        latitude = is_latitude(axis)
        figure = curves.curve_figure(
            panels,
            f"{title_of(axis)} ({DEGREE})" if latitude else axis_label(axis),
            latitude=latitude,
            logarithmic=_is_geometric(x),
        )
        caption = (
            f"Mean efficiencies of the field over the period against {title_of(axis)}.{shown.note('tracking', dim)}"
        )
        yield NamedFigure(f"efficiency_over_{dim}", caption, figure)


def _is_number(result: xr.Dataset, dim: str) -> bool:
    return dim in result.coords and result[dim].dtype.kind in "fiu"


def _is_geometric(values: np.ndarray) -> bool:
    """Whether values are evenly spaced on a logarithmic axis, over more than a decade."""
    if values.size < 3 or values.min() <= 0 or values.max() < 10 * values.min():
        return False
    ratios = np.diff(np.log(values))
    return bool(np.allclose(ratios, ratios[0], rtol=1e-6))
