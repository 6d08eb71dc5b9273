"""Figures of a finished result, after Figures 4, 5 and 7 to 13 and Tables 2 and 3 of Liu, Peng and Yan (2022).

Each figure takes from the sweep what it can show, and its caption says at which values the rest stands; one that
needs what the result does not have is left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, ClassVar

import numpy as np
import pandas as pd
import xarray as xr

from heliosweep.config.zones import parse_timezone
from heliosweep.report.contents import NamedFigure, one_by_one
from heliosweep.report.labels import DEGREE
from heliosweep.report.panels import Panel, curve_figure, panels_over
from heliosweep.report.pictures import grid_figure
from heliosweep.report.selection import Point, Shown, at, evenly

DIRECTION = "axis_tilt_direction"
OFFSETS = ("home_azimuth_offset", "home_elevation_offset")

#: Figures of one result; panels beside each other where there are more than four.
MOST_FIGURES, COLUMNS = 12, 3

#: Lines and panels of one figure; names along an axis; lines with bands that overlap.
MOST_LINES, MOST_PANELS, MOST_NAMES, MOST_BANDS = 7, 6, 40, 5

#: Directions of which lines are drawn, or the nearest there are. [deg]
LINE_DIRECTIONS = (0.0, 45.0, 90.0, 135.0)

#: Latitudes and directions from which on there is a map.
LEAST_LATITUDES, LEAST_DIRECTIONS = 7, 4

#: Least height of the axes of factors and errors: less is of no interest. [1, mrad]
LEAST_SPAN = 5e-3

_FACTOR, _AVERAGE = "effective_tracking_factor", "average"
_FACTOR_LABEL = "effective tracking factor (1)"
_NOTE = "Direction of the tilt: where the foot of the azimuth axis leans, 0 south, 90 west."
_CLOCK = "time on the clock (h)"
_COMPASS = ("south", "south-west", "west", "north-west", "north", "north-east", "east", "south-east")
_SINGLE = ("site", "model", "latitude", "axis_tilt", DIRECTION, "tracking_tolerance", "tolerance")


class _Dishes(Shown):
    """A result with the mean factor of its dates and the words of the family."""

    titles: ClassVar = {DIRECTION: "direction of the tilt", "model": "model"}
    labels: ClassVar = {DIRECTION: f"direction of the tilt ({DEGREE})", "date": "date (month)"}
    typical: ClassVar = {**dict.fromkeys((DIRECTION, *OFFSETS), 0.0), "axis_tilt": 0.1}
    not_swept = frozenset({"date", "month", "time"})
    told: ClassVar = {**dict.fromkeys(_SINGLE), **dict.fromkeys(OFFSETS, 0.0)}

    def __init__(self, result: xr.Dataset) -> None:
        mean = f"{_FACTOR}_mean_over_dates"
        average = result[mean] if mean in result else result[_FACTOR].isel(date=0, drop=True)
        super().__init__(result.assign({_AVERAGE: average}))
        days = result["date"].to_numpy().astype("datetime64[D]")
        self.period = str(days[0]) if days.size == 1 else f"{days.size} dates from {days.min()} to {days.max()}"
        self.when = f"on {self.period}" if days.size == 1 else f"mean over {self.period}"

    def value(self, dim: str, index: int) -> str:
        """One value with its unit; directions with their name where they have one."""
        text = super().value(dim, index)
        if dim != DIRECTION:
            return text
        eighth = float(np.atleast_1d(self.result[dim])[index]) % 360.0 / 45.0
        return text + (f" {_COMPASS[int(eighth)]}" if eighth == int(eighth) else "")

    def dims(self, quantity: str, *but: str | None) -> list[str]:
        """Swept dimensions of a variable, also those with one value; those of the mount before those of the place."""
        dims = [str(dim) for dim in self.result[quantity].dims if dim not in self.not_swept and dim not in but]
        return sorted(dims, key=self.is_place)

    def is_place(self, dim: str) -> bool:
        """Whether the place changes along a dimension."""
        coords = self.result.coords
        return any(name in coords and dim in coords[name].dims for name in ("latitude", "longitude", "site"))

    def chosen(self, dim: str | None, most: int, known: xr.DataArray | None = None) -> list[dict[str, int]]:
        """Positions along a dimension; of directions those nearest around the circle to some, each once."""
        if dim == DIRECTION:
            angles = self.result[dim].to_numpy()
            away = (np.abs((angles - one + 180.0) % 360.0 - 180.0) for one in LINE_DIRECTIONS)
            return [{dim: index} for index in sorted({int(np.argmin(distances)) for distances in away})]
        # An odd number keeps the middle of a sweep about zero.
        odd = dim in OFFSETS and self.result.sizes[dim] > most and most % 2 == 0
        return super().chosen(dim, most - odd, known)


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Figures of a result, each drawn when it is asked for; values are read as they are needed."""
    shown = _Dishes(result)
    return one_by_one(_FIGURES, shown, MOST_FIGURES)


def _over_first(shown: _Dishes) -> Iterator[NamedFigure]:
    """Factor over the direction, or over the first swept number where the direction is not swept."""
    x, others = _axis(shown)
    if x is None:
        return
    lines, panels, *_ = *(dim for dim in others if x != DIRECTION or dim not in OFFSETS), None, None
    caption = f"Effective tracking factor against {shown.title(x)}, {shown.when}."
    yield _curves(shown, f"factor_over_{x}", caption, _AVERAGE, x, lines, panels)
    deviation = f"{_FACTOR}_std_over_dates"
    if deviation in shown.result:
        caption = f"Standard deviation of the effective tracking factor over its dates against {shown.title(x)}."
        label = "standard deviation (1)"
        yield _curves(shown, f"deviation_over_{x}", caption, deviation, x, lines, panels, label=label)


def _offsets(shown: _Dishes) -> Iterator[NamedFigure]:
    """Factor over the direction for offsets of the home position, mean and deviation over the directions."""
    factor = shown.result[_AVERAGE]
    offsets = [dim for dim in OFFSETS if factor.sizes.get(dim, 0) > 1]
    if not offsets or factor.sizes.get(DIRECTION, 0) < LEAST_DIRECTIONS:
        return
    panels = []
    for dim in offsets:
        lines, stands = shown.chosen(dim, MOST_LINES), shown.fixed(_AVERAGE, DIRECTION, dim)
        drawn = {shown.value(dim, line[dim]): at(factor, stands, line) for line in lines}
        panels.append(Panel(_FACTOR_LABEL, drawn, shown.title(dim)))
    stands = shown.fixed(_AVERAGE, DIRECTION, *offsets)
    caption = f"Effective tracking factor with offsets of the home position, the other one zero, {shown.when}."
    name = f"offsets_over_{DIRECTION}"
    yield _figure(shown, name, caption, panels, DIRECTION, stands, [{}], [{}], legend_title="offset")
    both = {dim: at(factor, shown.fixed(_AVERAGE, DIRECTION, dim)) for dim in offsets}
    mean = {shown.title(dim): one.mean(DIRECTION, skipna=False) for dim, one in both.items()}
    spread = {shown.title(dim): one.std(DIRECTION, ddof=1, skipna=False) for dim, one in both.items()}
    panels = [Panel(f"mean {_FACTOR_LABEL}", mean), Panel("standard deviation (1)", spread)]
    caption = f"Mean and standard deviation over the directions of the tilt, {shown.when}."
    figure = curve_figure(panels, f"offset of the home position ({DEGREE})", least_span=LEAST_SPAN)
    yield NamedFigure("directions_over_offsets", f"{caption}{_note(shown, '', stands)}", figure)


def _course(shown: _Dishes) -> Iterator[NamedFigure]:
    """The sun and the tracking errors over one day, on the clocks of the places."""
    if "tracking_error" not in shown.result:
        return
    date = str(shown.result["date"].to_numpy().astype("datetime64[D]")[shown.stand("date")])
    options: dict[str, Any] = {"least_span": LEAST_SPAN}
    azimuth, elevation = shown.result["solar_azimuth"], shown.result["solar_elevation"]
    place = next(iter(shown.dims("solar_elevation")), None)
    lines, stands = shown.chosen(place, MOST_LINES), shown.fixed("solar_elevation", place, "time")
    turns, heights = (
        {shown.values(one): _on_clock(at(each, stands, one), date) for one in lines} for each in (azimuth, elevation)
    )
    south = {name: _from_south(turn, heights[name]) for name, turn in turns.items()}
    panels = [Panel(f"azimuth from south ({DEGREE})", south), Panel(f"elevation ({DEGREE})", heights)]
    caption = f"Path of the sun on {date}; azimuth positive to the west."
    figure = curve_figure(panels, _CLOCK, **options)
    yield NamedFigure("path_of_the_sun", f"{caption}{_note(shown, '', stands, lines)}", figure)
    error = shown.result["tracking_error"]
    line, panel = _calendar(shown)
    lines, others = shown.chosen(line, MOST_LINES), shown.chosen(panel, MOST_PANELS)
    stands = shown.fixed("tracking_error", "time", line, panel)
    panels = []
    for other in others:
        drawn = {shown.values(one): _on_clock(at(error, stands, one, other), date) for one in lines}
        panels.append(Panel("tracking error (mrad)", drawn, shown.fulls(other)))
    options |= {"columns": COLUMNS if len(panels) > 4 else 2, "same_scale": True}
    figure = curve_figure(panels, _CLOCK, legend_title=shown.heading(line), **options)
    caption = f"Tracking error over {date}."
    yield NamedFigure("error_over_day", f"{caption}{_note(shown, '', stands, lines, others)}", figure)


def _from_south(azimuth: xr.DataArray, elevation: xr.DataArray) -> xr.DataArray:
    """Azimuth of the sun from south, positive to the west, without a jump at midnight or in the north. [deg]"""
    angle = np.unwrap(azimuth.to_numpy() - 180.0, period=360.0)
    highest = int(np.argmax(elevation.to_numpy()))
    return azimuth.copy(data=angle - 360.0 * np.round(angle[highest] / 360.0))


def _on_clock(here: xr.DataArray, date: str) -> xr.DataArray:
    """Time series of one place on one date, against the hour on its clock."""
    stamps = pd.DatetimeIndex(here["utc" if "utc" in here.coords else "time"].to_numpy(), tz="UTC")
    clock = stamps.tz_convert(parse_timezone(str(here["timezone"].item()))).tz_localize(None)
    hours = (clock - pd.Timestamp(date)) / pd.Timedelta(hours=1)
    of_date = np.flatnonzero((hours >= 0) & (hours <= 24))
    return here.drop_vars(["time", "utc"], errors="ignore").assign_coords(time=hours).isel(time=of_date)


def _directions_together(shown: _Dishes) -> Iterator[NamedFigure]:
    """Mean and standard deviation over the directions, against up to two of what is swept, sites first."""
    result, factor = shown.result, shown.result[_AVERAGE]
    directed = factor.sizes.get(DIRECTION, 0) > 1
    dims = shown.dims(_AVERAGE, DIRECTION)
    named = [dim for dim in dims if dim in result.coords and result[dim].dtype.kind in "OU"]
    numbers = [dim for dim in dims if directed and shown.is_number(dim) and shown.several(dim) and dim not in OFFSETS]
    for x in sorted([*named, *numbers], key=lambda dim: not shown.is_place(dim))[:2]:
        line = next((dim for dim in dims if dim != x), None)
        lines, stands = shown.chosen(line, MOST_BANDS), shown.fixed(_AVERAGE, x, line, DIRECTION if directed else None)
        few = evenly(result.sizes[x], MOST_NAMES if x in named else result.sizes[x])
        drawn, band = factor.isel({x: few}), None
        caption = f"Effective tracking factor against {shown.title(x)}, {shown.when}."
        if directed:
            half = drawn.std(DIRECTION, ddof=1, skipna=False)
            drawn = drawn.mean(DIRECTION, skipna=False)
            band = (drawn - half, drawn + half)
            shape = "bars" if x in named else "bands"
            caption += f" Mean over the directions of the tilt; {shape}: sample standard deviation over them."
        if len(few) < result.sizes[x]:
            caption += f" The axis has {len(few)} of {result.sizes[x]} values."
        panels = panels_over(shown, drawn, _FACTOR_LABEL, stands, lines, band=band)
        yield _figure(shown, f"directions_over_{x}", caption, panels, x, stands, lines, [{}])


def _over_year(shown: _Dishes) -> Iterator[NamedFigure]:
    """Factor of each date."""
    if shown.several("date"):
        said = "Effective tracking factor of each date."
        yield _curves(shown, "factor_over_year", said, _FACTOR, "date", *_calendar(shown))


def _by_month(shown: _Dishes) -> Iterator[NamedFigure]:
    """Monthly mean with the standard deviation over its dates."""
    if not shown.several("month"):
        return
    lines, panels = _calendar(shown)
    middles = _middles(shown)
    mean, half = (shown.result[f"monthly_{_FACTOR}_{name}"].assign_coords(middles) for name in ("mean", "std"))
    caption = "Effective tracking factor: mean of each month; bands: sample standard deviation over its dates."
    band = (mean - half, mean + half)
    yield _curves(shown, "factor_by_month", caption, _FACTOR, "date", lines, panels, drawn=mean, band=band)


def _middles(shown: _Dishes) -> dict[str, np.ndarray]:
    """Middles of the months, as coordinates."""
    months = shown.result["month"].to_numpy().astype("datetime64[M]").astype("datetime64[D]")
    return {"month": (months + np.timedelta64(14, "D")).astype("datetime64[ns]")}


def _months_over_directions(shown: _Dishes) -> Iterator[NamedFigure]:
    """Mean and standard deviation over the directions of the monthly means."""
    name = f"monthly_{_FACTOR}"
    if f"{name}_mean_over_directions" not in shown.result or not shown.several("month"):
        return
    dims = shown.dims(f"{name}_mean_over_directions")
    line = next(iter(sorted(dims, key=lambda dim: not shown.is_place(dim))), None)
    lines, stands = shown.chosen(line, MOST_LINES), shown.fixed(f"{name}_mean_over_directions", "month", line)
    labels = {"mean": f"mean {_FACTOR_LABEL}", "std": "standard deviation (1)"}
    drawn = [
        panel
        for word, label in labels.items()
        for panel in panels_over(
            shown, shown.result[f"{name}_{word}_over_directions"].assign_coords(_middles(shown)), label, stands, lines
        )
    ]
    caption = (
        "Monthly mean of the effective tracking factor: mean and standard deviation over the directions of the tilt."
    )
    yield _figure(shown, "months_over_directions", caption, drawn, "date", stands, lines, [{}], same_scale=False)


def _calendar(shown: _Dishes) -> tuple[str | None, str | None]:
    """Lines for some directions, a panel for each place."""
    dims = shown.dims(_FACTOR)
    lines = DIRECTION if DIRECTION in dims else next(iter(dims), None)
    places = sorted(dims, key=lambda dim: not shown.is_place(dim))
    return lines, next((dim for dim in places if dim != lines), None)


def _extremes(shown: _Dishes) -> Iterator[NamedFigure]:
    """Least and largest daily factor, and on which date each falls."""
    names = {"least": (f"{_FACTOR}_min", "date_of_min"), "largest": (f"{_FACTOR}_max", "date_of_max")}
    x, others = _axis(shown)
    if x is None or f"{_FACTOR}_min" not in shown.result:
        return
    panel = next(iter(sorted(others, key=lambda dim: not shown.is_place(dim))), None)
    panels, stands = shown.chosen(panel, COLUMNS), shown.fixed(_AVERAGE, x, panel)
    drawn = [
        Panel(label, {word: at(shown.result[pair[row]], stands, one) for word, pair in names.items()}, title)
        for row, label in enumerate((_FACTOR_LABEL, "date (month)"))
        for one in panels
        for title in ["" if row else shown.fulls(one)]
    ]
    caption = f"Least and largest effective tracking factor of {shown.period}, and when they occur."
    options: dict[str, Any] = {"columns": len(panels), "same_scale": "row"}
    yield _figure(shown, "extremes", caption, drawn, x, stands, [{}], panels, **options)


def _map(shown: _Dishes) -> Iterator[NamedFigure]:
    """Factor over latitude and direction."""
    sizes = shown.result[_AVERAGE].sizes
    if sizes.get("latitude", 0) < LEAST_LATITUDES or sizes.get(DIRECTION, 0) < LEAST_DIRECTIONS:
        return
    labels = {_AVERAGE: _FACTOR_LABEL}
    if f"{_FACTOR}_min" in shown.result:
        labels = {_AVERAGE: f"mean {_FACTOR_LABEL}", f"{_FACTOR}_min": f"least daily {_FACTOR_LABEL}"}
    stands = shown.fixed(_AVERAGE, DIRECTION, "latitude")
    caption = f"Effective tracking factor against latitude and direction of the tilt, {shown.when}."
    drawn = {label: at(shown.result[name], stands) for name, label in labels.items()}
    yield _grids(shown, "latitude_map", caption, stands, DIRECTION, "latitude", drawn)


def _tolerable(shown: _Dishes) -> Iterator[NamedFigure]:
    """Largest tilt that keeps every date above the required factors."""
    name, required = "tolerable_axis_tilt", "required_factor"
    if name not in shown.result:
        return
    others = shown.dims(name, required)
    first = sorted(others, key=lambda dim: dim != DIRECTION)
    if "latitude" in others and shown.result.sizes["latitude"] >= LEAST_DIRECTIONS:
        x: str | None = "latitude"
    else:
        x = next((dim for dim in first if shown.is_number(dim) and shown.several(dim)), None)
    if x is None:
        return
    line = next((dim for dim in first if dim != x), None)
    caption = (
        "Largest tilt of the azimuth axis with which the effective tracking factor of every date reaches the required "
        f"one, over {shown.period}."
    )
    labelled: dict[str, Any] = {"label": f"tolerable tilt ({DEGREE})", "same_scale": False}
    lines, panels = (line, required) if line else (required, None)
    yield _curves(shown, name, caption, name, x, lines, panels, **labelled)


def _errors(shown: _Dishes) -> Iterator[NamedFigure]:
    """Mean and largest tracking error over the offsets of the home position."""
    offsets = [name for name in OFFSETS if name in shown.result[_FACTOR].dims and shown.several(name)]
    if not offsets:
        return
    largest = shown.result["max_tracking_error"].reduce(np.fmax.reduce, "date", keep_attrs=True)
    drawn = {
        "mean tracking error (mrad)": shown.result["mean_tracking_error"].mean("date"),
        "largest tracking error (mrad)": largest,
    }
    span = f"over {shown.period}" if shown.several("date") else shown.when
    caption = f"Mean and largest tracking error against the offset of the home position, {span}."
    if len(offsets) > 1:
        stands = shown.fixed(_AVERAGE, *offsets)
        arrays = {label: at(array, stands) for label, array in drawn.items()}
        yield _grids(shown, "tracking_errors", caption, stands, offsets[0], offsets[1], arrays)
        return
    others = shown.dims(_FACTOR, *offsets)
    line = DIRECTION if DIRECTION in others else next(iter(others), None)
    lines, stands = shown.chosen(line, MOST_LINES), shown.fixed(_AVERAGE, offsets[0], line)
    panels = [one for label, array in drawn.items() for one in panels_over(shown, array, label, stands, lines)]
    yield _figure(shown, "tracking_errors", caption, panels, offsets[0], stands, lines, [{}], same_scale=False)


_FIGURES = (
    _over_first,
    _offsets,
    _directions_together,
    _course,
    _over_year,
    _by_month,
    _months_over_directions,
    _extremes,
    _map,
    _tolerable,
    _errors,
)


def _axis(shown: _Dishes) -> tuple[str | None, list[str]]:
    """Dimension for the horizontal axis, the direction if it is swept, and the other ones."""
    dims = shown.dims(_AVERAGE)
    numbers = [dim for dim in dims if shown.is_number(dim) and shown.several(dim)]
    x = next(iter(sorted(numbers, key=lambda dim: dim != DIRECTION)), None)
    return x, [dim for dim in dims if dim != x]


def _curves(
    shown: _Dishes,
    name: str,
    caption: str,
    quantity: str,
    x: str,
    line: str | None,
    panel: str | None,
    *,
    drawn: xr.DataArray | None = None,
    band: tuple[xr.DataArray, xr.DataArray] | None = None,
    label: str = _FACTOR_LABEL,
    **options: Any,
) -> NamedFigure:
    """Curves of a variable, or of what is drawn instead, with lines and panels along two more dimensions."""
    lines, panels = shown.chosen(line, MOST_LINES), shown.chosen(panel, MOST_PANELS)
    stands = shown.fixed(quantity, x, line, panel)
    array = shown.result[quantity] if drawn is None else drawn
    made = panels_over(shown, array, label, stands, lines, panels, band)
    return _figure(shown, name, caption, made, x, stands, lines, panels, **options)


def _figure(
    shown: _Dishes,
    name: str,
    caption: str,
    drawn: list[Panel],
    x: str,
    stands: Point,
    lines: Sequence[Point],
    panels: Sequence[Point],
    **options: Any,
) -> NamedFigure:
    line = next(iter(lines[0]), None)
    columns = COLUMNS if len(drawn) > 4 else 2
    usual = {"columns": columns, "same_scale": True, "legend_title": shown.heading(line), "least_span": LEAST_SPAN}
    ordered = bool(line != DIRECTION and shown.heading(line))
    figure = curve_figure(drawn, shown.label(x), ordered=ordered, **{**usual, **options})
    return NamedFigure(name, f"{caption}{_compass(x)}{_note(shown, name, stands, lines, panels)}", figure)


def _grids(
    shown: _Dishes, name: str, caption: str, stands: Point, x: str, y: str, drawn: dict[str, xr.DataArray]
) -> NamedFigure:
    arrays = {label: array.transpose(y, x) for label, array in drawn.items()}
    figure = grid_figure(arrays, (shown.label(x), shown.label(y)))
    return NamedFigure(name, f"{caption}{_compass(x)}{_note(shown, name, stands)}", figure)


def _note(shown: _Dishes, name: str, stands: Point, *points: Iterable[Point]) -> str:
    """What else stands where; the figure of tolerable tilts has no tilt."""
    return shown.note(stands, *points, unsaid="axis_tilt" if name.startswith("tolerable") else "")


def _compass(x: str) -> str:
    """What the directions mean, where they are on an axis."""
    return f" {_NOTE}" if x == DIRECTION else ""
