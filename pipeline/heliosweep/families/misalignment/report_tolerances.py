"""Figures of how much error an aperture tolerates: over the day, over the error, and maps of a field."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr

from heliosweep.families.misalignment import report_views as views
from heliosweep.families.misalignment import report_words as wording
from heliosweep.families.misalignment.report_curves import AXIS, LEAST_SIZES, axes_of, error_dim
from heliosweep.families.misalignment.report_views import FIELD, HELIOSTAT, HOUR, Point, at, needs
from heliosweep.families.registry import NamedFigure
from heliosweep.report import maps
from heliosweep.report.curves import Panel, curve_figure
from heliosweep.report.labels import number_text
from heliosweep.report.style import VALUES


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Figures of the tolerances of the mode `curves`.

    Parameters
    ----------
    result : xarray.Dataset
        The result.

    Yields
    ------
    NamedFigure
    """
    for draw in (_tolerance_map, _tolerance_over_day, hits_over_error):
        yield from draw(result)


@needs("tolerance")
def _tolerance_over_day(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Least error that drives the spot out, over the hours: of each heliostat, or the spread over a field."""
    if result.sizes.get(HOUR, 1) < 2 or HELIOSTAT not in result["tolerance"].dims:
        return
    axis, order = AXIS if AXIS in result["tolerance"].dims else None, views.ordered(result, HOUR)
    x = result[HOUR].to_numpy()[order]
    stands = views.fixed(result, "tolerance", HOUR, axis, HELIOSTAT)
    field = result.sizes[HELIOSTAT] >= FIELD
    panels = []
    for name, axis_point in axes_of(result, axis):
        values = at(result["tolerance"], stands, axis_point).transpose(HELIOSTAT, HOUR).to_numpy()[:, order]
        values = np.where(np.isfinite(values), values, np.nan)
        lines = _spread(values) if field else _each(result, stands, values)
        if any(np.isfinite(line).any() for line in lines.values()):
            title = f"{name} axis" if axis else ""
            panels.append(Panel("tolerance (mrad)", {name: (x, line) for name, line in lines.items()}, title))
    if not panels:
        return
    caption = "Tolerance: smallest error, of either sign, with which the centre of the beam leaves the aperture."
    if field:
        caption += f" Least, 5 % point and median of {result.sizes[HELIOSTAT]} heliostats."
    caption += wording.note(result, stands)
    figure = curve_figure(
        panels,
        wording.label(result, HOUR),
        same_scale=True,
        step=wording.hour_step(result),
        columns=3 if len(panels) == 3 else 2,
        ordered=False,
    )
    yield NamedFigure("tolerance_over_day", caption, figure)


@needs("least_tolerance")
def _tolerance_map(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Least tolerance over all instants on the map of a field, and the hour in which it falls."""
    name = "least_tolerance"
    if result.sizes.get(HELIOSTAT, 0) < FIELD:
        return
    axis = AXIS if AXIS in result[name].dims else None
    stands = views.fixed(result, name, axis, HELIOSTAT)
    drawn: dict[str, list[maps.FieldMap]] = {"tolerance_map": [], "tolerance_hour_map": []}
    for axis_name, point in axes_of(result, axis):
        values = at(result[name], stands, point).to_numpy()
        finite = values[np.isfinite(values)]
        if not finite.size:
            continue
        about = f"{axis_name} axis\n" if axis else ""
        title = f"{about}least {number_text(float(finite.min()))}, median {number_text(float(np.median(finite)))} mrad"
        one = views.field_map(result, values, stands, title)
        if one is None:
            return
        drawn["tolerance_map"].append(one)
        if "hour_of_least_tolerance" in result and views.several(result, HOUR):
            hours = at(result["hour_of_least_tolerance"], stands, point).to_numpy().astype(float)
            known = np.where(np.isfinite(values), hours, np.nan)
            drawn["tolerance_hour_map"] += [
                one for one in [views.field_map(result, known, stands, about.strip())] if one
            ]
    if not drawn["tolerance_map"]:
        return
    low, high = capped(drawn["tolerance_map"])
    caption = (
        "Least tolerance of each heliostat over all days and hours: the smallest error, of either sign, with which the "
        f"centre of its beam leaves the aperture. {symbols(drawn['tolerance_map'], high)}{wording.note(result, stands)}"
    )
    figure = maps.map_figure([drawn["tolerance_map"]], (low, high), "least tolerance (mrad)", VALUES)
    yield NamedFigure("tolerance_map", caption, figure)
    if drawn["tolerance_hour_map"]:
        when = drawn["tolerance_hour_map"]
        caption = (
            "Hour in which the tolerance of each heliostat is least, of all days and hours. "
            f"{symbols(when)}{wording.note(result, stands)}"
        )
        figure = maps.map_figure([when], maps.value_scale(when), wording.label(result, HOUR), VALUES)
        yield NamedFigure("tolerance_hour_map", caption, figure)


@needs("hit_fraction")
def hits_over_error(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Part of the hours in which the spot is inside, over the size of the error."""
    error = error_dim(result) if "spot_y" in result else None
    if error is None or error not in result["hit_fraction"].dims or HOUR in result["hit_fraction"].dims:
        return
    if (
        HELIOSTAT not in result["hit_fraction"].dims
        or result.sizes[error] < LEAST_SIZES
        or not views.several(result, HOUR)
    ):
        return
    axis, order = AXIS if AXIS in result["hit_fraction"].dims else None, views.ordered(result, error)
    stands = views.fixed(result, "hit_fraction", error, axis, HELIOSTAT)
    x = result[error].to_numpy()[order]
    field = result.sizes[HELIOSTAT] >= FIELD
    panels = []
    for name, point in axes_of(result, axis):
        values = 100 * at(result["hit_fraction"], stands, point).transpose(HELIOSTAT, error).to_numpy()[:, order]
        lines = {"": _mean(values)} if field else _each(result, stands, values)
        title = f"{name} axis" if axis else ""
        panels.append(Panel("hours inside (%)", {line: (x, y) for line, y in lines.items()}, title))
    if not any(np.isfinite(y).any() for panel in panels for _, y in panel.lines.values()):
        return
    mean = f", mean of {result.sizes[HELIOSTAT]} heliostats" if field else ""
    caption = f"Part of the hours with sun in which the centre of the beam is inside the aperture{mean}."
    caption += wording.note(result, stands)
    figure = curve_figure(
        panels, wording.label(result, error), same_scale=True, columns=3 if len(panels) == 3 else 2, least_span=5.0
    )
    yield NamedFigure("hits_over_error", caption, figure)


def capped(drawn: Sequence[maps.FieldMap]) -> tuple[float, float]:
    """Ends of a colour scale from zero to what all but a few mirrors do not exceed."""
    values = np.concatenate([one.values[np.isfinite(one.values)] for one in drawn])
    top = float(np.quantile(values, 0.95))
    step = 10.0 ** np.floor(np.log10(max(top, 1e-2))) / 2
    return 0.0, float(np.ceil(max(top, 1e-2) / step) * step)


def symbols(drawn: Sequence[maps.FieldMap], high: float = np.inf) -> str:
    """What the symbols of maps mean, whose scale ends at `high`."""
    values = np.concatenate([one.values[np.isfinite(one.x)] for one in drawn])
    grey = " Grey: no value, or none is large enough." if not np.isfinite(values).all() else ""
    more = f" {int((values[np.isfinite(values)] > high).sum())} larger values have the colour of the scale's end."
    return f"Squares: heliostats, not to scale; triangle: tower.{grey}{more if (values > high).any() else ''}"


def _spread(values: np.ndarray) -> dict[str, np.ndarray]:
    """Least, 5 % point and median over the heliostats, missing where all are."""
    known = np.isfinite(values).any(axis=0)
    lines = {name: np.full(values.shape[1], np.nan) for name in ("least", "5 % point", "median")}
    for name, part in zip(lines, (0.0, 0.05, 0.5), strict=True):
        lines[name][known] = np.nanquantile(values[:, known], part, axis=0)
    return lines


def _mean(values: np.ndarray) -> np.ndarray:
    count = np.isfinite(values).sum(axis=0)
    total = np.nansum(values, axis=0)
    return np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)


def _each(result: xr.Dataset, stands: Point, values: np.ndarray) -> dict[str, np.ndarray]:
    return {wording.heliostat_text(result, {**stands, HELIOSTAT: i}): line for i, line in enumerate(values)}
