"""Figures of a finished result, after Figures 2 and 5 to 8 and Table 1 of Defieux et al. (2020), by what it holds.

Each figure takes from the sweep what it can show, and its caption says at which values the rest stands; one that needs
what the result does not have is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr

from heliosweep.families.backward_gazing import figures_errors, figures_images, figures_sun
from heliosweep.families.backward_gazing.shown import DIRECT, DIRECTIONS, HELIOSTAT, HOUR, METHOD, REFERENTIAL, Gazing
from heliosweep.report.contents import NamedFigure, one_by_one
from heliosweep.report.labels import number_text
from heliosweep.report.pictures import FieldMap, Shades, field_map, from_zero, picture_figure, symbols
from heliosweep.report.selection import Point, at
from heliosweep.report.tracks import Plane, Track, plane_figure

#: Figures of one result.
MOST_FIGURES = 12
#: Hours of one figure.
MOST_HOURS = 6
#: Least end of a scale of errors. [mrad]
LEAST = 1e-4

_ERRORS = ("slope_rms_x", "slope_rms_y")


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Figures of a result, each drawn when it is asked for; values are read as they are needed."""
    shown = Gazing(result)
    pictures = (*figures_images.FIGURES, *figures_errors.FIGURES, *figures_sun.FIGURES)
    return one_by_one((*pictures, accuracy_map, usable_map, over_distance), shown, MOST_FIGURES)


def accuracy_map(shown: Gazing) -> Iterator[NamedFigure]:
    """Error of the slopes of each heliostat by the best method, both directions together."""
    if not shown.has(*_ERRORS) or HELIOSTAT not in shown.result[_ERRORS[0]].dims:
        return
    stands = shown.fixed(_ERRORS[0], HELIOSTAT, HOUR)
    hours = shown.chosen(HOUR if HOUR in shown.result[_ERRORS[0]].dims else None, MOST_HOURS)
    values = [_both(shown, stands, one) for one in hours]
    method = shown.value(METHOD, stands[METHOD]) if METHOD in stands else "the method"
    if REFERENTIAL in stands and method not in DIRECT:
        method += f", referential {shown.value(REFERENTIAL, stands[REFERENTIAL])}"
    said = (
        f"Root mean square error of the slopes of each heliostat by {method}, larger direction, over the pixels that "
        "have slopes."
    )
    shades = from_zero("rms error of the slopes (mrad)", values, LEAST, held=0.98)
    yield from _maps(shown, "accuracy_map", said, stands, hours, values, shades, "mrad")


def usable_map(shown: Gazing) -> Iterator[NamedFigure]:
    """Part of each heliostat for which there are slopes."""
    name = "usable_fraction"
    if not shown.has(name) or HELIOSTAT not in shown.result[name].dims:
        return
    stands = shown.fixed(name, HELIOSTAT, HOUR)
    hours = shown.chosen(HOUR if HOUR in shown.result[name].dims else None, MOST_HOURS)
    values = [100 * at(shown.result[name], stands, one).to_numpy().astype(float) for one in hours]
    said = "Part of the pixels of each heliostat that at least three cameras see lit."
    shades = Shades("pixels with slopes (%)", 0.0, 100.0)
    yield from _maps(shown, "usable_map", said, stands, hours, values, shades, "%")


def over_distance(shown: Gazing) -> Iterator[NamedFigure]:
    """Error of each heliostat over its distance, by method, coloured by the hour."""
    result = shown.result
    if not shown.has(*_ERRORS, "slant_range"):
        return
    if HELIOSTAT not in result[_ERRORS[0]].dims or HELIOSTAT not in result["slant_range"].dims:
        return
    stands = shown.fixed(_ERRORS[0], HELIOSTAT, HOUR, METHOD, REFERENTIAL)
    hours = shown.chosen(HOUR if HOUR in result[_ERRORS[0]].dims else None, MOST_HOURS)
    far = at(result["slant_range"], stands).to_numpy().astype(float)
    look = {"color": "#0072B2", "linestyle": "", "marker": "o", "markersize": 2.4, "markeredgewidth": 0}
    planes, known = [], []
    for way in shown.best_ways(_ERRORS[0]):
        tracks = []
        for one in hours:
            values = _both(shown, stands, one, way.point)
            number = float(shown.coordinate(HOUR).isel(one)) if one else 0.0
            if np.isfinite(values).any() and far.shape == values.shape:
                tracks.append(Track(far, values, look, numbers=np.full(values.size, number)))
                known.append(number)
        if tracks:
            planes.append(Plane(way.name, tracks, square=False))
    if not planes:
        return
    scale = Shades("solar time (h)", min(known), max(known)) if max(known) > min(known) else None
    caption = (
        "Root mean square error of the slopes of each heliostat, larger direction, against its distance from the "
        f"target, by each method.{shown.note(stands, hours)}"
    )
    labels = ("distance from the target (m)", "rms error (mrad)")
    yield NamedFigure("accuracy_over_distance", caption, plane_figure(planes, labels, scale=scale))


def _maps(
    shown: Gazing,
    name: str,
    said: str,
    stands: Point,
    hours: Sequence[Point],
    values: Sequence[np.ndarray],
    shades: Shades,
    unit: str,
) -> Iterator[NamedFigure]:
    """Maps of the field at some hours; none where the result does not tell the places or has no value."""
    names = [one for one in ("x", "y") if one in shown.result.coords]
    here = shown.result[names].isel({dim: i for dim, i in stands.items() if dim in shown.result[names].dims})
    maps: list[FieldMap] = []
    for one, numbers in zip(hours, values, strict=True):
        finite = numbers[np.isfinite(numbers)]
        decimals = 0 if unit == "%" else 4
        middle = f"median {number_text(float(np.median(finite)), decimals)} {unit}" if finite.size else "no slopes"
        title = "\n".join(filter(None, [shown.fulls(one), middle]))
        found = field_map(here, numbers, title)
        maps += [found] if found else []
    if any(np.isfinite(one.values).any() for one in maps):
        words = symbols(maps, high=shades.high, missing="no slopes")
        yield NamedFigure(name, f"{said} {words}{shown.note(stands, hours)}", picture_figure(maps, shades))


def _both(shown: Gazing, *points: Point) -> np.ndarray:
    """Larger of the errors of both directions."""
    return np.maximum(*(at(shown.result[f"slope_rms_{end}"], *points).to_numpy().astype(float) for end in DIRECTIONS))
