"""The field's mean efficiency over chosen days of a time series, read a few instants at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from heliosweep.families.registry import NamedFigure
from heliosweep.report import curves
from heliosweep.report.labels import DEGREE, is_fraction, number_text
from heliosweep.report.selection import Selection, evenly

SERIES = "instantaneous_optical_efficiency"

#: Equinoxes and solstices by day of the year, and how far the nearest day may be away. [d]
SEASONS = {80: "March equinox", 172: "June solstice", 266: "September equinox", 355: "December solstice"}
NEAR = 10

#: Days and places that are drawn.
MOST_DAYS = 4
MOST_PLACES = 3

#: So much of a series is held at a time. [bytes]
PIECE = 16 * 2**20


def day_courses(shown: Selection) -> NamedFigure:
    """Mean instantaneous optical efficiency of the field over at most four days.

    Parameters
    ----------
    shown : Selection
        Points of a result with the time series `SERIES`.

    Returns
    -------
    NamedFigure
        A panel for each method and place, a line for each day.
    """
    panels = []
    rows, columns = shown.row_points(), shown.columns(MOST_PLACES)
    for row in rows:
        for column in columns:
            point = {**row, **column}
            here = shown.result.isel(point)
            lines = {}
            kind, days, hours = _clock(here)
            for name, instants in _chosen(kind, days).items():
                start, stop = int(instants[0]), int(instants[-1]) + 1
                means = field_means(here, slice(start, stop))[instants - start]
                lines[name] = (hours[instants], means)
            title = ", ".join(text for text in (shown.row_text(point), shown.column_text(point)) if text)
            panels.append(curves.Panel("optical efficiency (%)", lines, title))
    count = len({name for panel in panels for name in panel.lines})
    clock = "universal time of day" if kind == "date" else "solar time of day"
    figure = curves.curve_figure(panels, f"{clock} (h)", columns=len(columns), same_scale=True)
    caption = (
        "Optical efficiency of the field at each instant (mean over the heliostats, weighted by mirror area) on "
        f"{count} of the days computed.{shown.note('tracking', shown.column, most=MOST_PLACES)}"
    )
    return NamedFigure("day_courses", caption, figure)


def field_means(here: xr.Dataset, part: slice) -> np.ndarray:
    """Mean over the heliostats at some instants of one parameter point, in percent; NaN with the sun down.

    Parameters
    ----------
    here : xarray.Dataset
        The point; its series has the dimensions ``time`` and ``heliostat``.
    part : slice
        Instants; read in pieces of bounded size.

    Returns
    -------
    ndarray, shape (instants,)
    """
    series = here[SERIES]
    area = np.ones(series.sizes["heliostat"])
    for side in ("heliostat_width", "heliostat_height"):
        area = area * (here[side].to_numpy() if side in here.coords else 1.0)
    length = max(1, PIECE // (8 * area.size))
    scale = 100.0 if is_fraction(series) else 1.0
    means = []
    for start in range(part.start, part.stop, length):
        piece = series.isel(time=slice(start, min(start + length, part.stop)))
        values = piece.transpose("time", "heliostat").to_numpy()
        weights = np.where(np.isfinite(values), area, 0.0)
        total = weights.sum(axis=1)
        power = np.where(weights > 0, values * weights, 0.0).sum(axis=1)
        means.append(np.divide(scale * power, total, out=np.full(total.size, np.nan), where=total > 0))
    return np.concatenate(means)


def _clock(here: xr.Dataset) -> tuple[str, np.ndarray, np.ndarray]:
    """What days are told by (day of the year, declination in degrees, or date), day and hour [h] of all instants."""
    for name in ("day", "declination"):
        if name in here.coords:
            return name, here[name].to_numpy(), here["solar_hour"].to_numpy()
    stamps = here["utc" if "utc" in here.coords else "time"].to_numpy()
    dates = stamps.astype("datetime64[D]")
    return "date", dates, (stamps - dates) / np.timedelta64(1, "h")


def _chosen(kind: str, days: np.ndarray) -> dict[str, np.ndarray]:
    """Instants of the days that are drawn, by name: equinoxes and solstices where near, else evenly chosen ones."""
    known = np.unique(days[~np.isnat(days)] if kind == "date" else days)
    named: dict[int, str] = {}
    if kind != "declination":
        numbers = known if kind == "day" else (known - known.astype("datetime64[Y]")).astype(float) + 1
        for season, name in SEASONS.items():
            index = int(np.argmin(np.abs(numbers - season)))
            if abs(numbers[index] - season) <= NEAR:
                named.setdefault(index, name)
    chosen = list(named) or evenly(known.size, MOST_DAYS)
    return {_name(kind, known[index], named.get(index)): np.flatnonzero(days == known[index]) for index in chosen}


def _name(kind: str, day: Any, season: str | None) -> str:
    if kind == "declination":
        return f"declination {number_text(float(day), 1)}{DEGREE}"
    text = str(day) if kind == "date" else f"day {day:g}"
    return f"{text} ({season})" if season else text
