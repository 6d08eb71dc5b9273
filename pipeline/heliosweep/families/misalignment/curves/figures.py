"""Figures of the mode `curves`: spots on the receiver plane, how much error an aperture tolerates, whole conics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.blocks import ERRORS
from heliosweep.families.misalignment.figures import (
    AXES,
    AXIS,
    FIELD,
    HELIOSTAT,
    HOUR,
    MOST_PANELS,
    Spots,
    aperture,
    mean,
)
from heliosweep.report.contents import NamedFigure
from heliosweep.report.labels import MINUS, number_text
from heliosweep.report.panels import curve_figure
from heliosweep.report.pictures import FieldMap, Shades, from_zero, picture_figure, symbols, within
from heliosweep.report.selection import Point, at, evenly
from heliosweep.report.tracks import Look, Plane, Track, cut, origin, plane_figure

SIZE = "error_size"

#: Hours of which curves are drawn; sizes of error of which drifts are drawn.
MOST_HOURS, MOST_SIZES = 3, 7

#: Sizes of error from which on there are curves; hours from which on there is a drift.
LEAST_SIZES, LEAST_HOURS = 3, 3

#: Range of errors from which on a curve is more than a line. [mrad]
CURVED = 200.0

#: Points of each branch of a conic, and how far hyperbolas are followed, as the exponent of their distance.
POINTS, REACH = 400, 8.0

_DETECTOR: Look = {"color": "#777777", "linestyle": (0, (6, 1.5, 1, 1.5)), "linewidth": 0.9}
_CROSSING: Look = {"color": "black", "linestyle": "", "marker": "x", "markersize": 3.6}
_MEASURED: Look = {"color": "black", "linestyle": "", "marker": "+", "markersize": 5, "markeredgewidth": 0.9}
_PATH: Look = {"color": "#666666", "linewidth": 0.7, "marker": "o", "markersize": 3.4}


def deviation_curves(shown: Spots) -> Iterator[NamedFigure]:
    """Curves on the receiver plane over the error, a panel for each heliostat, a line for each hour."""
    result, error = shown.result, shown.error()
    if not shown.of_heliostats("spot_y") or not shown.has("spot_z"):
        return
    if error is None or result.sizes[error] < LEAST_SIZES:
        return
    others = shown.numbers("spot_y", AXIS, error, *(() if error == SIZE else ERRORS))
    line = next((dim for dim in (HOUR, shown.day, *others) if shown.several(dim)), None)
    stands = shown.fixed("spot_y", error, line, AXIS, HELIOSTAT)
    heliostats = shown.heliostats("spot_y", stands)
    lines = shown.chosen(line, MOST_HOURS, at(result["spot_y"], stands))
    planes = []
    for one in heliostats:
        tracks = [_aim(shown), *_detectors(result)]
        for name, axis in shown.axes("spot_y"):
            look = AXES.get(name, {"color": "#333333" if name else "#0072B2"})
            for moment in lines:
                y, z = _spots(shown, error, stands, one, axis, moment)
                text = shown.values(moment) if shown.several(line) else ""
                tracks += [Track(y, z, look, name, text=text), *_crossings(result, stands, one, axis, moment)]
                tracks += _beams(shown, error, look, stands, one, axis, moment)
        tracks += _measured(result, one)
        planes.append(Plane(shown.heliostat({**stands, **one}), tracks, (), aperture(result, stands)))
    if not _any(planes):
        return
    values = result[error].to_numpy()
    ends = " to ".join(number_text(float(value), 1).removesuffix(".0") for value in (values.min(), values.max()))
    what = f"each line for the {shown.title(line)} at its positive end" if line else "each line one instant"
    held = {dim: index for dim, index in stands.items() if dim != SIZE}
    beam = " Dotted: edges of the trace of the beam; rings: outlines of its spots." if "edge_y" in result else ""
    beam += " Crosses: measured spots." if "measured_y" in result.coords else ""
    caption = (
        f"Where the beam meets the receiver plane while the {shown.label(error)} runs from {ends}: {what}; "
        f"{shown.seen}.{beam}{_far(planes)}{shown.note(held, heliostats, lines)}"
    )
    heading = "axis of the error" if AXIS in result["spot_y"].dims else ""
    yield NamedFigure("deviation_curves", caption, plane_figure(planes, shown.plane, legend_title=heading))


def spot_drift(shown: Spots) -> Iterator[NamedFigure]:
    """Spots over the day, coloured by the hour, for some sizes of the error; a figure for each axis of it."""
    result = shown.result
    if not shown.of_heliostats("spot_y") or not shown.has("spot_z") or result.sizes.get(HOUR, 1) < LEAST_HOURS:
        return
    error = shown.error()
    stands = shown.fixed("spot_y", error, HOUR, AXIS, HELIOSTAT)
    heliostats, sizes = shown.heliostats("spot_y", stands), shown.chosen(error, MOST_SIZES)
    if error == SIZE:
        sizes = [size for size in sizes if float(result[SIZE].isel(size))] or sizes  # without error: the aim
    hours = np.sort(result[HOUR].to_numpy()) if HOUR in result.coords else np.arange(result.sizes[HOUR])
    swept = AXIS in result["spot_y"].dims
    for name, axis in shown.axes("spot_y"):
        planes, seen = [], []
        for one in heliostats:
            tracks = [_aim(shown)]
            for size in sizes:
                y, z = _spots(shown, HOUR, stands, one, axis, size)
                value = float(result[error].isel(size)) if error and shown.several(error) else None
                text = "" if value is None else f"{value:+g}".replace("-", MINUS) if value else "0"
                tracks.append(Track(y, z, _PATH, numbers=hours.astype(float), text=text))
                seen.append(hours[np.isfinite(y)])
            planes.append(Plane(shown.heliostat({**stands, **one}), tracks, (), aperture(result, stands)))
        if not _any(planes):
            continue
        of = f"an error about the {name} axis" if swept else "the errors"
        written = f", each line for the {shown.label(error)} at its end" if error else ""
        caption = (
            f"Drift of the spot with {of} over the day{written}; {shown.seen}.{_far(planes)}"
            f"{shown.note({**stands, **axis}, heliostats, sizes)}"
        )
        known = np.concatenate(seen)
        scale = Shades(shown.label(HOUR) if HOUR in result.coords else "hour (1)", known.min(), known.max())
        suffix = f"_{name.replace('-', '_')}" if swept and result.sizes[AXIS] > 1 else ""
        yield NamedFigure(f"spot_drift{suffix}", caption, plane_figure(planes, shown.plane, scale=scale))


def conics(shown: Spots) -> Iterator[NamedFigure]:
    """Whole conics with their foci, and the part that was traced; a panel for each heliostat and sun."""
    result = shown.result
    if not shown.of_heliostats("conic") or not shown.has("eccentricity", "focus_y", "focus_z"):
        return
    if result.sizes[HELIOSTAT] > MOST_PANELS:
        return
    if SIZE in result.coords and result[SIZE].ndim and np.ptp(result[SIZE].to_numpy()) < CURVED:
        return
    spots = shown.has("spot_y", "spot_z") and SIZE in result["spot_y"].dims
    suns = [str(dim) for dim in result["conic"].dims if str(dim).startswith("sun_")]
    run = next((dim for dim in suns if shown.several(dim)), None)
    stands = shown.fixed("conic", run, AXIS, HELIOSTAT, "conic_coefficient")
    heliostats = shown.heliostats("conic", stands)
    moments = shown.chosen(run, max(1, MOST_PANELS // len(heliostats))) if heliostats else []
    planes, named = [], {}
    for one, moment in ((one, moment) for one in heliostats for moment in moments):
        tracks, shapes = [], []
        for name, axis in shown.axes("conic"):
            points = (stands, one, moment, axis)
            coefficients = at(result["conic"], *points).to_numpy()
            if coefficients.shape != (6,) or not np.isfinite(coefficients).all():
                continue
            colour = AXES.get(name, {"color": "#333333" if name else "#0072B2"})["color"]
            label = f"{name} axis" if name else "curve"
            named[label] = {"color": colour, "linewidth": 2.0 if spots else 0.9}
            focus = np.array([float(at(result[which], *points)) for which in ("focus_y", "focus_z")])
            other = other_focus(coefficients, focus)
            dotted = {"color": colour, "linewidth": 0.9, "linestyle": (0, (1, 1.4))}
            tracks.append(Track(*conic_curve(coefficients), dotted, framed=False))
            if spots:
                tracks.append(Track(*_spots(shown, SIZE, *points), named[label]))
            diamond = {"color": colour, "linestyle": "", "marker": "D", "markersize": 4.2, "markeredgewidth": 0.8}
            tracks.append(Track(focus[:1], focus[1:], diamond))
            tracks.append(Track(other[:1], other[1:], {**diamond, "markerfacecolor": "none"}, framed=False))
            about = f" ({name})" if name else ""
            shapes.append(f"{float(at(result['eccentricity'], *points)):.5g}{about}")
        if tracks:
            sun = f"{run.replace('_', ' ')} {shown.values(moment)}" if run else ""
            lines = [shown.heliostat({**stands, **one}), sun, f"e = {', '.join(shapes)}"]
            title = "\n".join(filter(None, lines))
            planes.append(Plane(title, [*tracks, _aim(shown)], (), aperture(result, stands)))
    if not planes:
        return
    caption = (
        "Conics that a mirror's rays trace on the receiver plane as it turns about each axis: thick where the errors "
        "of the study are, dotted beyond, on both branches; full diamonds: focus of the branch of the rays; "
        f"e: eccentricity. {shown.seen.capitalize()}.{_far(planes)}{shown.note(stands, moments)}"
    )
    yield NamedFigure("conics", caption, plane_figure(planes, shown.plane, entries=named))


def tolerance_over_day(shown: Spots) -> Iterator[NamedFigure]:
    """Least error that drives the spot out, over the hours: of each heliostat, or the spread over a field."""
    result, name = shown.result, "tracking_tolerance"
    if not shown.of_heliostats(name) or not shown.several(HOUR):
        return
    stands = shown.fixed(name, HOUR, AXIS, HELIOSTAT)
    field = result.sizes[HELIOSTAT] >= FIELD

    def lines(values: xr.DataArray) -> dict[str, xr.DataArray]:
        values = values.where(np.isfinite(values))
        if not field:
            return _each(shown, stands, values)
        known = values.notnull().any(HELIOSTAT)
        filled = values.where(known, 0.0)  # NumPy warns of quantiles of nothing
        parts = {"least": 0.0, "5 % point": 0.05, "median": 0.5}
        return {word: filled.quantile(part, HELIOSTAT).where(known) for word, part in parts.items()}

    panels = shown.panels_of_axes(name, "tolerance (mrad)", stands, lines)
    if not panels:
        return
    caption = "Tolerance: smallest error, of either sign, with which the centre of the beam leaves the aperture."
    if field:
        caption += f" Least, 5 % point and median of {result.sizes[HELIOSTAT]} heliostats."
    columns = 3 if len(panels) == 3 else 2
    figure = curve_figure(panels, shown.label(HOUR), same_scale=True, columns=columns)
    yield NamedFigure("tolerance_over_day", caption + shown.note(stands), figure)


def tolerance_map(shown: Spots) -> Iterator[NamedFigure]:
    """Least tolerance over all instants on the map of a field, and the hour in which it falls."""
    result, name, when = shown.result, "least_tolerance", "hour_of_least_tolerance"
    if not shown.of_heliostats(name, FIELD):
        return
    stands = shown.fixed(name, AXIS, HELIOSTAT)
    least: list[FieldMap] = []
    hours: list[FieldMap] = []
    for axis, point in shown.axes(name):
        values = at(result[name], stands, point).to_numpy()
        finite = values[np.isfinite(values)]
        if not finite.size:
            continue
        about = f"{axis} axis" if point else ""
        said = f"least {number_text(float(finite.min()))}, median {number_text(float(np.median(finite)))} mrad"
        one = shown.map(values, stands, "\n".join(filter(None, [about, said])))
        if one is None:
            return
        least.append(one)
        if shown.has(when) and shown.several(HOUR):
            known = at(result[when], stands, point).where(np.isfinite(values)).to_numpy()
            hours += filter(None, [shown.map(known, stands, about)])
    if not least:
        return
    missing, note = "no value, or none is large enough", shown.note(stands)
    shades = from_zero("least tolerance (mrad)", [one.values for one in least], 1e-2, held=0.95)
    caption = (
        "Least tolerance of each heliostat over all days and hours: the smallest error, of either sign, with which the "
        f"centre of its beam leaves the aperture. {symbols(least, high=shades.high, missing=missing)}{note}"
    )
    yield NamedFigure("tolerance_map", caption, picture_figure(least, shades))
    if hours:
        caption = (
            "Hour in which the tolerance of each heliostat is least, of all days and hours. "
            f"{symbols(hours, missing=missing)}{note}"
        )
        shades = within(shown.label(HOUR), [one.values for one in hours], held=1.0)
        yield NamedFigure("tolerance_hour_map", caption, picture_figure(hours, shades))


def hits_over_error(shown: Spots) -> Iterator[NamedFigure]:
    """Part of the hours in which the spot is inside, over the size of the error."""
    result, name, error = shown.result, "hit_fraction", shown.error()
    if error is None or not shown.of_heliostats(name) or not shown.several(HOUR) or result.sizes[error] < LEAST_SIZES:
        return
    if error not in result[name].dims or HOUR in result[name].dims:
        return
    stands, field = shown.fixed(name, error, AXIS, HELIOSTAT), result.sizes[HELIOSTAT] >= FIELD

    def lines(values: xr.DataArray) -> dict[str, xr.DataArray]:
        return {"": mean(100 * values)} if field else _each(shown, stands, 100 * values)

    panels = shown.panels_of_axes(name, "hours inside (%)", stands, lines)
    if not panels:
        return
    of = f", mean of {result.sizes[HELIOSTAT]} heliostats" if field else ""
    caption = f"Part of the hours with sun in which the centre of the beam is inside the aperture{of}."
    columns = 3 if len(panels) == 3 else 2
    figure = curve_figure(panels, shown.label(error), same_scale=True, columns=columns, least_span=5.0)
    yield NamedFigure("hits_over_error", caption + shown.note(stands), figure)


#: Figures of the spots, and of the tolerances, which come first for a field.
SPOTS = (deviation_curves, spot_drift, conics)
TOLERANCES = (tolerance_map, tolerance_over_day, hits_over_error)


def _each(shown: Spots, stands: Point, values: xr.DataArray) -> dict[str, xr.DataArray]:
    """A line for each heliostat."""
    indices = range(values.sizes[HELIOSTAT])
    return {shown.heliostat({**stands, HELIOSTAT: i}): values.isel({HELIOSTAT: i}) for i in indices}


def _spots(shown: Spots, along: str, *points: Point) -> tuple[np.ndarray, np.ndarray]:
    """Spots along the one dimension that the points leave, in its order. [m]"""
    y, z = (at(shown.result[f"spot_{side}"], *points).to_numpy().astype(float) for side in "yz")
    return (y[shown.order(along)], z[shown.order(along)]) if y.ndim else (y[np.newaxis], z[np.newaxis])


def _aim(shown: Spots) -> Track:
    known = "tracking_tolerance" in shown.result or SIZE in shown.result.coords
    known &= not set(ERRORS) & set(shown.result.coords)
    return origin("no error" if known else "aim")


def _detectors(result: xr.Dataset) -> Iterator[Track]:
    """Lines of detectors, longer than any panel."""
    if {"l0", "l1", "l2"} <= set(result.coords):
        for across, up, offset in zip(*(np.atleast_1d(result[name]) for name in ("l0", "l1", "l2")), strict=True):
            normal = np.array([across, up]) / np.hypot(across, up)
            foot, along = normal * offset / np.hypot(across, up), normal[::-1] * [-1e3, 1e3]
            ends = np.stack([foot - along, foot + along])
            yield Track(ends[:, 0], ends[:, 1], _DETECTOR, "line of detectors", framed=False)


def _crossings(result: xr.Dataset, *points: Point) -> Iterator[Track]:
    if {"crossing_y", "crossing_z"} <= set(result.data_vars):
        y, z = (at(result[f"crossing_{side}"], *points) for side in "yz")
        if y.ndim == 1:
            yield Track(y.to_numpy(), z.to_numpy(), _CROSSING, "crossing", framed=False)


def _beams(shown: Spots, error: str, look: Look, *points: Point) -> Iterator[Track]:
    """Edges of the trace of the beam, and outlines of some of its spots."""
    result = shown.result
    if "edge_y" not in result or not {error} <= set(result["edge_y"].dims):
        return
    thin = {"color": look["color"], "linewidth": 0.6}
    edges = [at(result[f"edge_{side}"], *points).transpose("edge", error).to_numpy() for side in "yz"]
    outlines = [at(result[f"outline_{side}"], *points).transpose(error, "outline").to_numpy() for side in "yz"]
    order = shown.order(error)
    for y, z in zip(*edges, strict=True):
        yield Track(y[order], z[order], {**thin, "linestyle": (0, (1, 1.4))}, framed=False)
    for index in order[evenly(order.size, MOST_SIZES)]:
        y, z = (np.append(side[index], side[index, :1]) for side in outlines)
        yield Track(y, z, thin, framed=False)


def _measured(result: xr.Dataset, one: Point) -> Iterator[Track]:
    if "measured_y" in result.coords:
        y, z = (at(result[f"measured_{side}"], one).to_numpy() for side in "yz")
        yield Track(y, z, _MEASURED, "measured")


def _any(planes: Sequence[Plane]) -> bool:
    """Whether there is anything but the aim."""
    return any(track.points().size for plane in planes for track in islice(plane.tracks, 1, None) if track.framed)


def _far(planes: Sequence[Plane]) -> str:
    out = cut(planes)
    return f" {out} far points lie outside of the panels." if out else ""


def principal(coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centre, eigenvalues over minus the rest, and eigenvectors of ``A y2 + B y z + C z2 + D y + E z + F``.

    In the frame of the eigenvectors, in columns, ``inverse[0] u2 + inverse[1] v2 = 1``; centre and inverse are NaN for
    a parabola.
    """
    a, b, c, d, e, f = coefficients
    matrix = np.array([[a, b / 2], [b / 2, c]])
    values, vectors = np.linalg.eigh(matrix)
    if np.abs(values).min() <= 1e-12 * np.abs(values).max():
        return np.full(2, np.nan), np.full(2, np.nan), vectors
    centre = -0.5 * np.linalg.solve(matrix, np.array([d, e]))
    rest = f + 0.5 * float(np.array([d, e]) @ centre)
    return centre, values / -rest if rest else np.full(2, np.nan), vectors


def conic_curve(coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both coordinates of points of a conic A to F, its branches apart by a missing point.

    There are none for a parabola or a pair of lines.
    """
    centre, inverse, vectors = principal(coefficients)
    nothing = np.full((1, 2), np.nan)
    if not np.isfinite(inverse).all() or (inverse <= 0).all():
        return nothing[:, 0], nothing[:, 1]
    sides = 1 / np.sqrt(np.abs(inverse))
    if (inverse > 0).all():
        turn = np.linspace(-np.pi, np.pi, POINTS)
        points = np.stack([np.cos(turn), np.sin(turn)], axis=-1) * sides
    else:
        way = np.linspace(-REACH, REACH, POINTS)
        first = int(np.argmax(inverse))
        branch = np.empty((POINTS, 2))
        branch[:, first], branch[:, 1 - first] = np.cosh(way), np.sinh(way)
        points = np.concatenate([branch * sides, nothing, -branch * sides])
    curve = centre + points @ vectors.T
    return curve[:, 0], curve[:, 1]


def other_focus(coefficients: np.ndarray, focus: np.ndarray) -> np.ndarray:
    """Focus on the other side of the centre, shape (2,)."""
    return 2 * principal(coefficients)[0] - focus
