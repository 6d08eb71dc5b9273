"""Figures of a calibration: spots before and after, errors found against true ones, and how well they are known."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr
from scipy.special import ndtri, stdtrit

from heliosweep.families.misalignment import report_views as views
from heliosweep.families.misalignment import report_words as wording
from heliosweep.families.misalignment.report_tolerances import symbols
from heliosweep.families.misalignment.report_views import FIELD, HELIOSTAT, Point, at, needs
from heliosweep.families.registry import NamedFigure
from heliosweep.report import maps
from heliosweep.report.curves import Panel, curve_figure
from heliosweep.report.labels import number_text
from heliosweep.report.planes import plane_figure
from heliosweep.report.shapes import Ellipse, Look, Plane, Track, Words
from heliosweep.report.style import COLOURS, MARKERS, VALUES

#: Quantile at the upper end of a two-sided 95 % interval.
UPPER = 0.975

#: Heliostats whose spots are drawn; series of recovered errors.
MOST_HELIOSTATS, MOST_SERIES = 3, 3

#: Least side of a panel of errors. [mrad]
LEAST_SPAN = 0.2

#: Standard errors below this part of the largest are none.
LEAST_PART = 1e-6

#: Points of one series.
MOST_POINTS = 60

#: Spots from which on there is an ellipse.
LEAST_SPOTS = 3

PARAMETER = "parameter"

_SPOTS = {"before": Look("#D55E00", "", "s", size=3, open=True), "after": Look("#0072B2", "", "o", size=3)}
_ELLIPSES = {
    "before: 95 % ellipse": Look("#D55E00", (0, (4, 1.4)), width=1.1),
    "after: 95 % ellipse": Look("#0072B2", "-", width=1.1),
}
#: What the spots are.
_MEASURED = (
    "Before: spots as measured, about the aim point. After: residuals, measured minus the spot that the calibration "
    "without this spot predicts (leave-one-out), drawn about the aim point; no corrected command was given."
)
_SYNTHETIC = "Centres of the beams on the receiver plane before the calibration and with the commands that it corrects."
_AIM, _EQUAL, _ROOM = "aim", "equal", "room"


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Figures of the mode `calibration`.

    Parameters
    ----------
    result : xarray.Dataset
        The result.

    Yields
    ------
    NamedFigure
    """
    for draw in (_before_after, _recovered, _knowledge, _residual_map):
        yield from draw(result)


@needs("spot_y_before", "spot_z_before", "spot_y_after", "spot_z_after")
def _before_after(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Spots before and after the calibration with the ellipses of their spread; below, those after it enlarged."""
    name = "spot_y_after"
    if HELIOSTAT not in result[name].dims:
        return
    spots = [dim for dim in (*views.DAYS, views.HOUR, "spot") if dim in result[name].dims]
    stands = {**views.fixed(result, name, HELIOSTAT, *spots), **best(result, name)}
    above, below = [], []
    shown = views.heliostats(result, name, stands, MOST_HELIOSTATS)
    for one in shown:
        title = wording.heliostat_text(result, {**stands, **one})
        tracks, ellipses = {}, {}
        for when in _SPOTS:
            y, z = (at(result[f"spot_{side}_{when}"], stands, one).to_numpy().ravel() for side in "yz")
            tracks[when] = Track(y, z, when)
            ellipses[when] = [
                Ellipse(*mean, covariance, f"{when}: 95 % ellipse") for mean, covariance in _scatter(y, z)
            ]
        aim = Track(np.zeros(1), np.zeros(1), _AIM)
        aperture = views.aperture(result, stands)
        if not any(np.isfinite(track.x).any() for track in tracks.values()):
            continue
        above.append(Plane(title, [aim, *tracks.values()], [*ellipses["before"], *ellipses["after"]], aperture))
        below.append(Plane("after, enlarged", [aim, tracks["after"]], ellipses["after"], alone=True))
    if not above:
        return
    caption = (
        f"{_MEASURED if 'spot' in spots else _SYNTHETIC} Ellipses: normal distributions with the mean and covariance "
        "of all spots, outliers among them, hold 95 %. Below: after the calibration, enlarged. "
        f"{wording.seen(result).capitalize()}.{wording.note(result, stands, (HELIOSTAT, shown))}"
    )
    looks = {**_SPOTS, **_ELLIPSES, _AIM: Look("#000000", "", "+", size=6)}
    figure = plane_figure([*above, *below], looks, words=wording.around(result), columns=len(above))
    yield NamedFigure("before_after", caption, figure)


@needs("estimated_error", "true_error")
def _recovered(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Errors found against the true ones, with 95 % intervals; a panel for each parameter."""
    array = result["estimated_error"]
    if PARAMETER not in array.dims:
        return
    run = _run(result)
    many = [dim for dim in (HELIOSTAT, "sample") if dim in array.dims]
    stands = {**views.fixed(result, "estimated_error", run, PARAMETER, *many), **best(result, "estimated_error", run)}
    series = views.chosen(result, run, MOST_SERIES)
    names = [wording.full(result, run, one[run]) if run else "estimate" for one in series]
    looks = {
        name: Look(colour, "", marker, size=3) for name, colour, marker in zip(names, COLOURS, MARKERS, strict=False)
    }
    planes = []
    for index in range(result.sizes[PARAMETER]):
        tracks = []
        for name, one in zip(names, series, strict=True):
            points = (stands, one, {PARAMETER: index})
            found = at(array, *points)
            true = _like(found, result["true_error"], *points)
            half = np.full(found.size, np.nan)
            if "standard_error" in result:
                half = _like(found, result["standard_error"], *points) * _quantile(result, found, stands, one)
            values = found.to_numpy().ravel()
            thin = np.unique(np.linspace(0, values.size - 1, min(values.size, MOST_POINTS)).astype(int))
            tracks.append(Track(true[thin], values[thin], name, half=half[thin]))
        plane = _against(parameter_name(result, index), tracks)
        planes += [plane] if plane else []
    if not planes:
        return
    caption = (
        "Errors that the calibration finds against those with which the spots were made; bars: 95 % intervals from its "
        f"standard errors; line: both equal.{wording.note(result, stands, (run, series))}"
    )
    words = Words(
        "true error (mrad)", "error found (mrad)", silent=(_EQUAL, _ROOM, *(names if len(names) == 1 else ()))
    )
    figure = plane_figure(
        planes, {_ROOM: Look("none", ""), _EQUAL: Look("#888888", "-", width=0.7), **looks}, words=words
    )
    yield NamedFigure("recovered_errors", caption, figure)


@needs("standard_error", "condition_number")
def _knowledge(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Standard errors and condition number over the days used, or over another swept number."""
    array = result["standard_error"]
    run = _run(result)
    if run is None or PARAMETER not in array.dims or run not in result["condition_number"].dims:
        return
    order = views.ordered(result, run)
    x = result[run].to_numpy()[order].astype(float)
    many = [dim for dim in (HELIOSTAT, "sample") if dim in array.dims]
    stands = {**views.fixed(result, "standard_error", run, PARAMETER, *many), **best(result, "standard_error", run)}
    errors = at(array, stands)
    errors = errors.transpose(run, PARAMETER, ...).to_numpy()[order].reshape(x.size, result.sizes[PARAMETER], -1)
    conditions = {}
    each = "parameters" if "parameters" in stands and run != "parameters" else None
    for one in views.chosen(result, each, views.MOST_LINES):
        values = at(result["condition_number"], {**stands, **one}).transpose(run, ...).to_numpy()[order]
        condition = _median(values.reshape(x.size, -1))
        if (condition > 0).any():
            of = f" of {wording.short(result, each, one[each])} parameters" if each else ""
            conditions[f"condition{of}"] = (x, condition)
    lines = {parameter_name(result, i): (x, _median(errors[:, i])) for i in range(errors.shape[1])}
    # Without noise standard errors are nothing but rounding, far below all others.
    least = LEAST_PART * max((np.nanmax(y) for _, y in lines.values() if np.isfinite(y).any()), default=0.0)
    lines = {name: (x, np.where(y > least, y, np.nan)) for name, (x, y) in lines.items() if (y > least).any()}
    if not lines or not conditions:
        return
    panels = [
        Panel("standard error (mrad)", lines),
        Panel("condition number (1)", conditions),
    ]
    over = " and ".join(
        filter(None, ["heliostats" if result.sizes.get(HELIOSTAT, 1) > 1 else "", "draws" if "sample" in many else ""])
    )
    title = wording.label(result, run).rsplit(" (", 1)[0]
    caption = (
        f"Standard errors of the parameters, and condition number of the least-squares problem, against the {title}"
        f"{f'; medians over the {over}' if over else ''}.{wording.note(result, stands)}"
    )
    step = 1.0 if not np.any(x % 1) and np.ptp(x) <= 10 else None
    figure = curve_figure(panels, wording.label(result, run), step=step, logarithmic_values=True)
    yield NamedFigure(f"knowledge_over_{run}", caption, figure)


@needs("residual_rms")
def _residual_map(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Residual of each heliostat of a field."""
    name = "residual_rms"
    if result.sizes.get(HELIOSTAT, 0) < FIELD or HELIOSTAT not in result[name].dims:
        return
    stands = {**views.fixed(result, name, HELIOSTAT), **best(result, name)}
    values = at(result[name], stands).to_numpy()
    finite = values[np.isfinite(values)]
    if not finite.size:
        return
    one = views.field_map(result, values, stands, f"median {number_text(float(np.median(finite)), 3)} m")
    if one is None:
        return
    caption = (
        "Root mean square residual of the spots of each heliostat after the calibration. "
        f"{symbols([one])}{wording.note(result, stands)}"
    )
    figure = maps.map_figure([[one]], maps.value_scale([one]), "residual (m)", VALUES)
    yield NamedFigure("residual_map", caption, figure)


def _against(title: str, tracks: list[Track]) -> Plane | None:
    """Errors found against true ones, with the line on which both are equal; none where nothing is known."""
    bare = Plane("", tracks).points()
    if not bare.size:
        return None
    low, high = bare.min(axis=0), bare.max(axis=0)
    middle, spans = (low + high) / 2, high - low
    # Of a single true value the panel would have no width.
    least = np.maximum(spans, [max(LEAST_SPAN, 0.05 * spans[1]), LEAST_SPAN]) / 2
    across, upwards = np.stack([middle - least, middle + least], axis=1)
    room = Track(across, upwards, _ROOM)
    ends = np.array([low.min() - np.ptp(bare) - 1, high.max() + np.ptp(bare) + 1])
    return Plane(title, [room, Track(ends, ends, _EQUAL, framed=False), *tracks], square=False)


def _like(found: xr.DataArray, array: xr.DataArray, *points: Point) -> np.ndarray:
    """Values of another variable beside those of one, in one row."""
    return at(array, *points).broadcast_like(found).transpose(*found.dims).to_numpy().astype(float).ravel()


def _quantile(result: xr.Dataset, found: xr.DataArray, *points: Point) -> np.ndarray:
    """Half-width of 95 % intervals over the standard error, by the t distribution where the spots are counted."""
    if "spots_used" not in result:
        return np.full(found.size, float(ndtri(UPPER)))
    estimated = at(result["estimated_error"], *points).notnull().sum(PARAMETER)
    freedom = 2 * _like(found, result["spots_used"], *points) - _like(found, estimated)
    return np.asarray(stdtrit(np.where(freedom > 0, freedom, np.nan), UPPER))


def _run(result: xr.Dataset) -> str | None:
    """Swept number that figures run along, days used first."""
    dims = views.numbers(result, views.swept(result, "estimated_error"))
    dims.sort(key=lambda dim: (dim != "days_used", dim == "parameters"))
    return dims[0] if dims else None


def best(result: xr.Dataset, quantity: str, *shown: str | None) -> Point:
    """The most days and the most parameters, where they are swept and not shown."""
    return {
        dim: int(np.argmax(result[dim].to_numpy()))
        for dim in ("days_used", "parameters")
        if dim in result[quantity].dims and dim in result.coords and dim not in shown
    }


def parameter_name(result: xr.Dataset, index: int) -> str:
    """What an error is called."""
    if PARAMETER in result.coords:
        name = str(result[PARAMETER].to_numpy()[index])
    elif index < len(views.MOUNT_ERRORS):
        name = views.MOUNT_ERRORS[index]
    else:
        name = f"parameter {index + 1}"
    return name.replace("non_", "non-").replace("_", " ")


def _scatter(y: np.ndarray, z: np.ndarray) -> Iterator[tuple[tuple[float, float], np.ndarray]]:
    """Mean and covariance of spots, where there are enough of them."""
    points = np.stack([y, z])
    points = points[:, np.isfinite(points).all(axis=0)]
    if points.shape[1] >= LEAST_SPOTS:
        mean = points.mean(axis=1)
        yield (float(mean[0]), float(mean[1])), np.cov(points)


def _median(values: np.ndarray) -> np.ndarray:
    """Median of each row over what is finite."""
    medians = np.full(len(values), np.nan)
    for i, row in enumerate(values):
        known = row[np.isfinite(row)]
        if known.size:
            medians[i] = np.median(known)
    return medians
