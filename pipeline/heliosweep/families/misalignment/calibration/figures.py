"""Figures of a calibration: spots before and after, errors found against true ones, how well known."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr
from scipy.special import ndtri, stdtrit

from heliosweep.families.misalignment.figures import (
    DAYS,
    FIELD,
    HELIOSTAT,
    HOUR,
    MOST_LINES,
    PARAMETER,
    Spots,
    aperture,
)
from heliosweep.report.colours import COLOURS, MARKERS
from heliosweep.report.contents import NamedFigure
from heliosweep.report.panels import Panel, curve_figure
from heliosweep.report.pictures import picture_figure, symbols, within
from heliosweep.report.selection import Point, at, evenly
from heliosweep.report.tracks import Ellipse, Plane, Track, origin, plane_figure

#: Quantile at the upper end of a two-sided 95 % interval.
UPPER = 0.975

#: Heliostats whose spots are drawn; series of recovered errors, and points of each.
MOST_HELIOSTATS, MOST_SERIES, MOST_POINTS = 3, 3, 60

#: Least side of a panel of errors. [mrad]
LEAST_SPAN = 0.2

#: Standard errors below this part of the largest are none; spots from which on there is an ellipse.
LEAST_PART, LEAST_SPOTS = 1e-6, 3

_ERRORS, _SPREAD = "estimated_error", "standard_error"
_BEFORE = {"color": "#D55E00", "linestyle": "", "marker": "s", "markersize": 3, "markerfacecolor": "none"}
_AFTER = {"color": "#0072B2", "linestyle": "", "marker": "o", "markersize": 3, "markeredgewidth": 0}
_EDGES = {"before": (0, (4, 1.4)), "after": "-"}
#: What the spots are.
_MEASURED = (
    "Before: spots as measured, about the aim point, or where angles were commanded about the spot of a mount without "
    "errors. After: residuals, measured minus the spot that the calibration "
    "without this spot predicts (leave-one-out), drawn about the aim point; no corrected command was given. "
    "Heliostats with the largest residuals first."
)
_SYNTHETIC = "Centres of the beams on the receiver plane before the calibration and with the commands that it corrects."


def before_after(shown: Spots) -> Iterator[NamedFigure]:
    """Spots before and after the calibration with the ellipses of their spread; below, those after it enlarged."""
    result, name = shown.result, "spot_y_after"
    names = [f"spot_{side}_{when}" for side in "yz" for when in ("before", "after")]
    if not shown.has(*names) or HELIOSTAT not in result[name].dims:
        return
    spots = [dim for dim in (*DAYS, HOUR, "spot") if dim in result[name].dims]
    stands = {**shown.fixed(name, HELIOSTAT, *spots), **shown.best(name)}
    heliostats = shown.heliostats(name, stands, MOST_HELIOSTATS, "residual_rms" if "spot" in spots else "")
    above, below = [], []
    for one in heliostats:
        tracks, ellipses = {}, {}
        for when, look in (("before", _BEFORE), ("after", _AFTER)):
            y, z = (at(result[f"spot_{side}_{when}"], stands, one).to_numpy().ravel() for side in "yz")
            tracks[when] = Track(y, z, look, when)
            points, edge = tracks[when].points(), {"color": look["color"], "linewidth": 1.1, "linestyle": _EDGES[when]}
            ellipses[when] = (
                [Ellipse(points[:, 0].mean(), points[:, 1].mean(), np.cov(points.T), edge, f"{when}: 95 % ellipse")]
                if len(points) >= LEAST_SPOTS
                else []
            )
        if any(track.points().size for track in tracks.values()):
            title, both = shown.heliostat({**stands, **one}), [*ellipses["before"], *ellipses["after"]]
            above.append(Plane(title, [*tracks.values(), origin("aim")], both, aperture(result, stands)))
            below.append(Plane("after, enlarged", [tracks["after"], origin("aim")], ellipses["after"], alone=True))
    if not above:
        return
    caption = (
        f"{_MEASURED if 'spot' in spots else _SYNTHETIC} Ellipses: normal distributions with the mean and covariance "
        "of all spots, outliers among them, hold 95 %. Below: after the calibration, enlarged. "
        f"{shown.seen.capitalize()}.{shown.note(stands, heliostats)}"
    )
    figure = plane_figure([*above, *below], shown.plane, columns=len(above))
    yield NamedFigure("before_after", caption, figure)


def recovered(shown: Spots) -> Iterator[NamedFigure]:
    """Errors found against the true ones, with 95 % intervals; a panel for each parameter."""
    result = shown.result
    if not shown.has(_ERRORS, "true_error") or PARAMETER not in result[_ERRORS].dims:
        return
    run = _run(shown)
    stands = {**shown.fixed(_ERRORS, run, PARAMETER, HELIOSTAT, "sample"), **shown.best(_ERRORS, run)}
    series = shown.chosen(run, MOST_SERIES)
    planes = []
    for index in range(result.sizes[PARAMETER]):
        tracks = []
        for one, colour, marker in zip(series, COLOURS, MARKERS, strict=False):
            points = (stands, one, {PARAMETER: index})
            found = at(result[_ERRORS], *points)
            true = _like(found, result["true_error"], *points)
            half = np.full(found.size, np.nan)
            if _SPREAD in result:
                half = _like(found, result[_SPREAD], *points) * _quantile(result, found, stands, one)
            thin = evenly(found.size, MOST_POINTS)
            look = {"color": colour, "linestyle": "", "marker": marker, "markersize": 3, "markeredgewidth": 0}
            tracks.append(Track(true[thin], found.to_numpy().ravel()[thin], look, shown.fulls(one), half=half[thin]))
        bare = Plane("", tracks).points()
        if bare.size:
            planes.append(Plane(shown.parameter(index), [*_equal(bare), *tracks], square=False))
    if not planes:
        return
    caption = (
        "Errors that the calibration finds against those with which the spots were made; bars: 95 % intervals from its "
        f"standard errors; line: both equal.{shown.note(stands, series)}"
    )
    yield NamedFigure("recovered_errors", caption, plane_figure(planes, ("true error (mrad)", "error found (mrad)")))


def _equal(points: np.ndarray) -> Iterator[Track]:
    """Line on which errors found equal the true ones, and room about the points, which may have no width."""
    low, high = points.min(axis=0), points.max(axis=0)
    spans = high - low
    half = np.maximum(spans, [max(LEAST_SPAN, 0.05 * spans[1]), LEAST_SPAN]) / 2
    middle = (low + high) / 2
    room = np.stack([middle - half, middle + half])
    yield Track(room[:, 0], room[:, 1], {"linestyle": ""})
    ends = np.array([low.min() - np.ptp(points) - 1, high.max() + np.ptp(points) + 1])
    yield Track(ends, ends, {"color": "#888888", "linewidth": 0.7}, framed=False)


def knowledge(shown: Spots) -> Iterator[NamedFigure]:
    """Standard errors and condition number over the days used, or over another swept number."""
    result, run, name = shown.result, _run(shown), "condition_number"
    if run is None or not shown.has(_SPREAD, name):
        return
    if PARAMETER not in result[_SPREAD].dims or run not in result[name].dims:
        return
    many = [dim for dim in (HELIOSTAT, "sample") if dim in result[_SPREAD].dims]
    stands = {**shown.fixed(_SPREAD, run, PARAMETER, *many), **shown.best(_SPREAD, run)}
    medians = _medians(at(result[_SPREAD], stands), run, PARAMETER).compute()
    # Without noise standard errors are nothing but rounding, far below all others.
    medians = medians.where(medians > LEAST_PART * medians.max())
    lines = {shown.parameter(i): medians.isel({PARAMETER: i}) for i in range(result.sizes[PARAMETER])}
    lines = {word: line for word, line in lines.items() if line.notnull().any()}
    each = "parameters" if "parameters" in stands and run != "parameters" else None
    conditions = {}
    for one in shown.chosen(each, MOST_LINES):
        line = _medians(at(result[name], {**stands, **one}), run)
        if (line > 0).any():
            conditions[f"condition of {shown.values(one)} parameters" if one else "condition"] = line
    if not lines or not conditions:
        return
    over = [
        word for word, dim in (("heliostats", HELIOSTAT), ("draws", "sample")) if dim in many and shown.several(dim)
    ]
    title = shown.label(run).rsplit(" (", 1)[0]
    caption = (
        f"Standard errors of the parameters, and condition number of the least-squares problem, against the {title}"
        f"{'; medians over the ' if over else ''}{' and '.join(over)}.{shown.note(stands)}"
    )
    panels = [Panel("standard error (mrad)", lines), Panel("condition number (1)", conditions)]
    yield NamedFigure(f"knowledge_over_{run}", caption, curve_figure(panels, shown.label(run), logarithmic_values=True))


def residual_map(shown: Spots) -> Iterator[NamedFigure]:
    """Residual of each heliostat of a field."""
    name = "residual_rms"
    if not shown.of_heliostats(name, FIELD):
        return
    stands = {**shown.fixed(name, HELIOSTAT), **shown.best(name)}
    one = shown.median_map(name, stands, "m")
    if one is None:
        return
    caption = (
        "Root mean square residual of the spots of each heliostat after the calibration. "
        f"{symbols([one])}{shown.note(stands)}"
    )
    figure = picture_figure([one], within("residual (m)", [one.values], held=1.0))
    yield NamedFigure("residual_map", caption, figure)


FIGURES = (before_after, recovered, knowledge, residual_map)


def _run(shown: Spots) -> str | None:
    """Swept number that figures run along, days used first."""
    dims = shown.numbers(_ERRORS) if _ERRORS in shown.result else []
    return next(iter(sorted(dims, key=lambda dim: (dim != "days_used", dim == "parameters"))), None)


def _like(found: xr.DataArray, array: xr.DataArray, *points: Point) -> np.ndarray:
    """Values of another variable beside those of one, in one row."""
    return at(array, *points).broadcast_like(found).transpose(*found.dims).to_numpy().astype(float).ravel()


def _quantile(result: xr.Dataset, found: xr.DataArray, *points: Point) -> np.ndarray:
    """Half-width of 95 % intervals over the standard error, by the t distribution where the spots are counted."""
    if "spots_used" not in result:
        return np.full(found.size, float(ndtri(UPPER)))
    estimated = at(result[_ERRORS], *points).notnull().sum(PARAMETER)
    freedom = 2 * _like(found, result["spots_used"], *points) - _like(found, estimated)
    return np.asarray(stdtrit(np.where(freedom > 0, freedom, np.nan), UPPER))


def _medians(array: xr.DataArray, *kept: str) -> xr.DataArray:
    """Medians over all but some dimensions of what is finite."""
    return array.where(np.isfinite(array)).median([dim for dim in array.dims if dim not in kept])
