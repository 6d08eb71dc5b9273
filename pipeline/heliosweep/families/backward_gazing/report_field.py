"""A whole field: where the cameras of one tower tell the slopes, and how well."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr

from heliosweep.families.backward_gazing import report_views as views
from heliosweep.families.backward_gazing import report_words as wording
from heliosweep.families.backward_gazing.report_views import DIRECTIONS, HELIOSTAT, HOUR, METHOD, REFERENTIAL, at, needs
from heliosweep.families.registry import NamedFigure
from heliosweep.report import maps
from heliosweep.report.labels import number_text
from heliosweep.report.planes import plane_figure
from heliosweep.report.shapes import Look, Plane, Scale, Track, Words
from heliosweep.report.style import VALUES

#: Hours of one figure.
MOST_HOURS = 6

#: Side of the squares on maps over the root of the land that each heliostat has.
PACKING = 0.55

#: Least end of a scale of errors. [mrad]
LEAST = 1e-4


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Maps of the field at some hours.

    Parameters
    ----------
    result : xarray.Dataset
        The result.

    Yields
    ------
    NamedFigure
    """
    for draw in (_accuracy_map, _usable_map, _over_distance):
        yield from draw(result)


@needs("slope_rms_x", "slope_rms_y")
def _accuracy_map(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Error of the slopes of each heliostat by the best method, both directions together."""
    if HELIOSTAT not in result["slope_rms_x"].dims:
        return
    stands = views.fixed(result, "slope_rms_x", HELIOSTAT, HOUR)
    hours, drawn = views.chosen(result, HOUR, MOST_HOURS), []
    for one in hours:
        one = one if HOUR in result["slope_rms_x"].dims else {}
        values = _both(result, "slope_rms_%", stands, one)
        drawn.append(_map(result, values, stands, one, _middle(values, "mrad", 4)))
    yield from _figure(
        result,
        "accuracy_map",
        [one for one in drawn if one],
        "rms error of the slopes (mrad)",
        f"Root mean square error of the slopes of each heliostat by {_way(result, stands)}, larger direction, over the "
        "pixels that have slopes.",
        stands,
        hours,
    )


@needs("usable_fraction")
def _usable_map(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Part of each heliostat for which there are slopes."""
    name = "usable_fraction"
    if HELIOSTAT not in result[name].dims:
        return
    stands = views.fixed(result, name, HELIOSTAT, HOUR)
    hours, drawn = views.chosen(result, HOUR, MOST_HOURS), []
    for one in hours:
        one = one if HOUR in result[name].dims else {}
        values = 100 * at(result[name], stands, one).to_numpy().astype(float)
        drawn.append(_map(result, values, stands, one, _middle(values, "%", 0)))
    yield from _figure(
        result,
        "usable_map",
        [one for one in drawn if one],
        "pixels with slopes (%)",
        "Part of the pixels of each heliostat that at least three cameras see lit.",
        stands,
        hours,
        (0.0, 100.0),
    )


@needs("slope_rms_x", "slope_rms_y", "slant_range")
def _over_distance(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Error of each heliostat over its distance, by method, coloured by the hour."""
    array = result["slope_rms_x"]
    if HELIOSTAT not in array.dims or HELIOSTAT not in result["slant_range"].dims:
        return
    stands = views.fixed(result, "slope_rms_x", HELIOSTAT, HOUR, METHOD, REFERENTIAL)
    hours = views.chosen(result, HOUR, MOST_HOURS) if HOUR in array.dims else [{}]
    far = at(result["slant_range"], stands).to_numpy().astype(float)
    planes = []
    for way in views.best_ways(result, "slope_rms_x"):
        tracks = []
        for one in hours:
            values = _both(result, "slope_rms_%", stands, one, way.point)
            number = float(result[HOUR].isel(one)) if one and HOUR in result.coords else 0.0
            if np.isfinite(values).any() and far.shape == values.shape:
                tracks.append(Track(far, values, "", numbers=np.full(values.size, number)))
        if tracks:
            planes.append(Plane(way.name, tracks, square=False))
    if not planes:
        return
    known = [float(track.numbers[0]) for plane in planes for track in plane.tracks if track.numbers is not None]
    scale = Scale("solar time (h)", min(known), max(known)) if max(known) > min(known) else None
    looks = {"": Look("#0072B2", "", "o", size=2.4)}
    words = Words("distance from the target (m)", "rms error (mrad)", silent=("",))
    caption = (
        "Root mean square error of the slopes of each heliostat, larger direction, against its distance from the "
        f"target, by each method.{wording.note(result, stands, (HOUR, hours))}"
    )
    figure = plane_figure(planes, looks, words=words, scale=scale, columns=len(planes) if len(planes) <= 3 else 2)
    yield NamedFigure("accuracy_over_distance", caption, figure)


def _figure(
    result: xr.Dataset,
    name: str,
    drawn: list[maps.FieldMap],
    label: str,
    said: str,
    stands: views.Point,
    hours: list[views.Point],
    ends: tuple[float, float] | None = None,
) -> Iterator[NamedFigure]:
    values = np.concatenate([one.values for one in drawn]) if drawn else np.empty(0)
    finite = values[np.isfinite(values)]
    if not finite.size:
        return
    scale = ends or (0.0, _end(float(np.quantile(finite, 0.98))))
    over = int((finite > scale[1] * (1 + 1e-9)).sum())
    more = f" {over} larger values have the colour of the scale's end." if over else ""
    grey = " Grey: no slopes." if finite.size < values.size else ""
    wide = -(-len(drawn) // -(-len(drawn) // maps.COLUMNS))
    rows = [drawn[start : start + wide] for start in range(0, len(drawn), wide)]
    caption = (
        f"{said} Squares: heliostats, not to scale; triangle: tower.{grey}{more}"
        f"{wording.note(result, stands, (HOUR, hours))}"
    )
    yield NamedFigure(name, caption, maps.map_figure(rows, scale, label, VALUES))


def _end(value: float) -> float:
    """End of a scale of errors, rounded up."""
    step = 10.0 ** np.floor(np.log10(max(value, LEAST))) / 2
    return float(np.ceil(max(value, LEAST) / step) * step)


def _both(result: xr.Dataset, name: str, *points: views.Point) -> np.ndarray:
    """Larger of both directions."""
    parts = [at(result[name.replace("%", end)], *points).to_numpy().astype(float) for end in DIRECTIONS]
    return np.maximum(*parts)


def _middle(values: np.ndarray, unit: str, decimals: int) -> str:
    finite = values[np.isfinite(values)]
    return f"median {number_text(float(np.median(finite)), decimals)} {unit}" if finite.size else "no slopes"


def _way(result: xr.Dataset, stands: views.Point) -> str:
    method = views.short(result, METHOD, stands[METHOD]) if METHOD in stands else "the method"
    referential = views.short(result, REFERENTIAL, stands[REFERENTIAL]) if REFERENTIAL in stands else ""
    return method if method in views.DIRECT or not referential else f"{method}, referential {referential}"


def _map(
    result: xr.Dataset, values: np.ndarray, stands: views.Point, hour: views.Point, title: str
) -> maps.FieldMap | None:
    """Map of one number of each heliostat; none where the result does not tell the places."""
    if not {"x", "y"} <= set(result.coords):
        return None
    x, y = (at(result[name], stands) for name in "xy")
    if x.dims != (HELIOSTAT,) or y.dims != (HELIOSTAT,) or values.shape != x.shape:
        return None
    known = [side[np.isfinite(side)] for side in (x.to_numpy().astype(float), y.to_numpy().astype(float))]
    spans = [float(np.ptp(side)) if side.size else 1.0 for side in known]
    side = max(PACKING * np.sqrt(spans[0] * spans[1] / max(known[0].size, 1)), max(spans) / 60, 1.0)
    sides = np.full(values.size, side)
    words = f"solar time {views.short(result, HOUR, hour[HOUR])}\n{title}" if hour else title
    return maps.FieldMap(words, x.to_numpy().astype(float), y.to_numpy().astype(float), sides, sides, values)
