"""Compute daily tracking factors and tolerable tilts of dishes, and statistics over directions and dates."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, partial
from typing import Any, TypeAlias

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from heliosweep.config import CivilTime, read_weather
from heliosweep.dish import ERRORS, SCAN, dish_intercept, largest_tilt, window_factors
from heliosweep.energy import MEGA
from heliosweep.families.dish_tracking.study import DishTime, DishTrackingStudy, Ephemeris
from heliosweep.families.family import Computation, Point, Points
from heliosweep.grid import (
    BEST_VALUE,
    DATE,
    LARGEST,
    SMALLEST,
    Parameters,
    Variable,
    daily_windows,
    sun_attributes,
    window_positions,
)
from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.dish import Windows, pack_windows
from heliosweep.kernels.sun import refracted
from heliosweep.sun import sun_vectors

Stamps: TypeAlias = NDArray[np.datetime64]
Sun: TypeAlias = Callable[[Stamps], Floats]

_SITE = ("site.latitude", "site.longitude", "site.altitude")
_MOUNT = ("errors.axis_tilt", "errors.axis_tilt_direction", "tolerance", *(f"errors.{name}" for name in ERRORS))
_CONCENTRATOR = tuple(f"concentrator.{key}" for key in ("focal_length", "diameter", "aperture_radius", "spread"))
_FACTOR, _MONTHLY = "effective_tracking_factor", "monthly_effective_tracking_factor"
_ANGLE = "angle between the direction to the sun and the focal axis"
_INSTANTS = "{}: {} (over the evaluated instants of the window)"
# In variables without a dimension for dates, cell methods name the dates by their standard name ``time`` (CF rules).
_DAILY, _DATES = _INSTANTS.format("date", "mean"), f"{_INSTANTS.format('time', 'mean')} time: "
_MEAN, _STD = "mean over the {} of the {}", "sample standard deviation over the {} of the {}"


def _factors(**words: tuple[str, str]) -> dict[str, dict[str, Any]]:
    definition = (
        "one minus the ratio of the mean tracking error to the tolerance; 1 for perfect tracking, negative if "
        "the mean error exceeds the tolerance (unless the study limits each error to the tolerance)"
    )
    return {
        name: {"units": "1", "long_name": long_name, "comment": definition, "cell_methods": methods,
               BEST_VALUE: SMALLEST if "standard deviation" in long_name else LARGEST}
        for name, (long_name, methods) in words.items()
    }  # fmt: skip


def _directed(study: DishTrackingStudy) -> bool:
    """Return True if the tilt direction is swept independently, as statistics over the directions require."""
    return any(set(dim.sweeps) == {"errors.axis_tilt_direction"} for dim in study.dimensions())


def computation(study: DishTrackingStudy) -> Computation:
    """Return the variables of a study and the function that computes them.

    The variables include statistics if the study sweeps the tilt direction or has several dates.
    """
    parameters, day, month = Parameters(study), f"daily {_FACTOR.replace('_', ' ')}", f"{_DATES}mean (within months)"
    of, monthly = _FACTOR.replace("_", " "), f"monthly mean of the {_FACTOR.replace('_', ' ')}"
    mount = tuple(dim for dim in parameters.sizes if dim not in parameters.site_dims)
    direction, several, directed = ("axis_tilt_direction",), len(study.time.date_list()) > 1, _directed(study)
    series, deviation = study.output.time_series, "standard_deviation ({}, n - 1)"
    #: Columns: condition, dimension, data type, True for statistics, swept dimensions along which values do not vary,
    #: and attributes by variable name.
    table: list[tuple[bool, str, str, bool, tuple[str, ...], dict[str, dict[str, Any]]]] = [
        (True, "date", "float64", False, (), {
            **_factors(effective_tracking_factor=(day, _DAILY)),
            **{
                f"{name}_tracking_error": {
                    "units": "mrad", "long_name": f"daily {words} of the tracking error", "comment": _ANGLE,
                    "cell_methods": _INSTANTS.format("date", method), BEST_VALUE: SMALLEST,
                }
                for name, words, method in (("mean", "mean", "mean"), ("max", "maximum", "maximum"))
            },
        }),
        (True, "date", "int8", False, mount, {"window_is_empty": {
            "long_name": "flag for dates without an evaluated instant, such as polar nights with daylight_only",
            "units": "1",
            "flag_values": np.array([0, 1], dtype=np.int8),
            "flag_meanings": "window_has_instants window_is_empty",
            "comment": "tracking factors of empty windows are missing",
        }}),
        (directed, "date", "float64", True, direction, _factors(
            effective_tracking_factor_mean_over_directions=(_MEAN.format("directions", day), _DAILY),
            effective_tracking_factor_std_over_directions=(_STD.format("directions", day), _DAILY),
        )),
        (several, "", "float64", True, (), _factors(
            effective_tracking_factor_mean_over_dates=(_MEAN.format("dates", of), f"{_DATES}mean (over the dates)"),
            effective_tracking_factor_std_over_dates=(
                _STD.format("dates", of), _DATES + deviation.format("over the dates")),
            effective_tracking_factor_min=(f"minimum {of} over all dates", f"{_DATES}minimum (over the dates)"),
            effective_tracking_factor_max=(f"maximum {of} over all dates", f"{_DATES}maximum (over the dates)"),
        )),
        (several, "", "datetime64[ns]", True, (), {
            "date_of_min": {"long_name": f"date of the minimum {of}"},
            "date_of_max": {"long_name": f"date of the maximum {of}"},
        }),
        (several, "month", "float64", True, (), _factors(
            monthly_effective_tracking_factor_mean=(_MEAN.format("dates of a month", of), month),
            monthly_effective_tracking_factor_std=(
                _STD.format("dates of a month", of), _DATES + deviation.format("within months")),
        )),
        (several and directed, "month", "float64", True, direction, _factors(
            monthly_effective_tracking_factor_mean_over_directions=(_MEAN.format("directions", monthly), month),
            monthly_effective_tracking_factor_std_over_directions=(_STD.format("directions", monthly), month),
        )),
        (several and directed, "", "float64", True, direction, {"worst_axis_tilt_direction": {
            "units": "degree",
            "long_name": f"tilt direction with the minimum mean {of} over the dates",
            "comment": "direction in which the foot of the azimuth axis leans (0 south, 90 west)",
        }}),
        (study.statistics is not None, "required_factor", "float64", False, ("axis_tilt",), {"tolerable_axis_tilt": {
            "units": "degree",
            "long_name": "maximum tilt of the azimuth axis at which the minimum daily tracking factor reaches the "
                         "required factor",
            "comment": "zero if no tilt is tolerable; missing if a tilt of 45 degrees is tolerable, or if no date has "
                       "a factor",
            BEST_VALUE: LARGEST,
        }}),
        (study.concentrator is not None, "", "float64", False, (), {
            "energy_loss": {
                "units": "1", "long_name": "annual energy lost to tracking errors",
                "comment": "relative to the energy that enters the aperture with perfect tracking",
                BEST_VALUE: SMALLEST,
            },
            "intercept_efficiency": {
                "units": "1", "long_name": "annual intercept efficiency of the dish", "valid_range": [0.0, 1.0],
                "comment": "fraction of the reflected light that passes through the aperture, weighted by direct "
                           "irradiance",
                BEST_VALUE: LARGEST,
            },
            "aperture_energy": {
                "units": "MWh", "long_name": "annual energy that enters the aperture", "cell_methods": "time: sum",
                "comment": "for a mirror with a reflectivity of 1", BEST_VALUE: LARGEST,
            },
        }),
        (series, "time", "float64", False, (), {"tracking_error": {
            "units": "mrad", "long_name": "tracking error at each instant",
            "comment": f"{_ANGLE}; missing at instants that are not evaluated", BEST_VALUE: SMALLEST,
        }}),
        (series, "time", "float64", False, mount, {
            "solar_elevation": {"units": "degree", "standard_name": "solar_elevation_angle",
                                "long_name": "elevation of the sun at each instant"},
            "solar_azimuth": {"units": "degree", "standard_name": "solar_azimuth_angle",
                              "long_name": "azimuth of the sun at each instant", "comment": "from north, clockwise"},
        }),
    ]  # fmt: skip
    variables = {
        name: Variable((dim,) if dim else (), attrs, np.dtype(dtype), finished, without=without)
        for wanted, dim, dtype, finished, without, named in table
        if wanted
        for name, attrs in named.items()
    }
    dates, sun = np.array(study.time.date_list(), "datetime64[ns]"), study.ephemeris
    dims: dict[str, Any] = {"date": (dates, DATE)}
    if several:
        dims["month"] = _months(study)[0], {"long_name": "month"}
    if study.statistics is not None:
        attrs = {"long_name": "required effective tracking factor", "units": "1"}
        dims["required_factor"] = study.statistics.required_factor.values(), attrs
    solved, swept = study.statistics is not None, {dim.name for dim in study.dimensions()}
    concentrator = study.concentrator
    air = f"{sun.pressure:g} hPa and {sun.temperature:g} deg C"
    elevation = f"apparent, at {air}" if sun.elevation == "apparent" else f"geometric; {air} have no effect"
    return Computation(
        function=factors,
        variables=variables,
        labels=(*_SITE[:2], "mount.model", *_MOUNT, *_CONCENTRATOR),
        dims=dims,
        coordinates=partial(_timezones, study),
        attrs=sun_attributes(study.time, sun.delta_t, elevation),
        inputs=(lambda: read_weather(study.resolve(concentrator.weather))) if concentrator else None,
        finish=finish,
        arrays=("mount.model", *_CONCENTRATOR),
        whole=(*["axis_tilt_direction"] * directed, *["axis_tilt"] * (solved and "axis_tilt" in swept)),
        unit="tracker-instants",
        memory=8 * 8 * dates.size * (1 + len(SCAN) * solved) + 9000 * 8 * 6 * (concentrator is not None),
    )


def _timezones(study: DishTrackingStudy) -> dict[str, Any]:
    parameters = Parameters(study)
    zones, attrs = parameters.timezones(), {"long_name": "time zone of dates and windows"}
    return {"timezone": ("site", zones, attrs) if "site" in parameters.sizes else ((), zones[0], attrs)}


def _months(study: DishTrackingStudy) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Return the months of the dates, such as 2021-06, and the month index of each date."""
    months, position = np.unique(np.array(study.time.date_list(), "datetime64[M]"), return_inverse=True)
    return months.astype(str).astype(object), position


def factors(point: Point) -> dict[str, Any]:
    """Compute tracking factors, tracking errors and tolerable tilts at a point.

    For stored time series, the tracking error and the solar position at each instant are returned instead. Tracking
    errors are NaN at instants that are not evaluated. Daily values are NaN on dates without an evaluated instant.
    """
    study, model = point.study, str(point["mount.model"])
    place = tuple(float(point[key] or 0.0) for key in _SITE)
    mount = [np.asarray(0.0 if point[key] is None else point[key], np.float64) for key in _MOUNT]
    if "time" in point.points.region:
        sun = sun_of(study.ephemeris, place, point.all_instants.labels["utc"].values[point.part("time")])
        counts = np.isfinite(sun[:, 2]) & ((sun[:, 2] > 0) | (not study.time.daylight_only))
        windows = pack_windows(sun, np.arange(len(sun) + 1), counts)
        return {
            "tracking_error": window_factors(model, windows, False, *mount)[1],
            "solar_elevation": np.degrees(np.arctan2(sun[:, 2], np.hypot(sun[:, 0], sun[:, 1]))),
            "solar_azimuth": np.degrees(np.arctan2(sun[:, 0], sun[:, 1])) % 360.0,
        }
    windows = windows_of(study.time, study.ephemeris, point.timezone, place)
    names = (_FACTOR, "mean_tracking_error", "max_tracking_error")
    made: dict[str, Any] = dict(zip(names, window_factors(model, windows, study.clip, *mount), strict=True))
    made["window_is_empty"] = np.diff(windows.starts) == 0
    if study.concentrator is not None:
        made |= _energy(point, model, place, mount)
    if study.statistics is not None:
        untilted = tuple(slice(0, 1) if dim == "axis_tilt" else slice(None) for dim in point.points.sizes)
        others = [values[untilted] if values.ndim else values for values in mount[1:]]
        made["tolerable_axis_tilt"] = largest_tilt(
            lambda *tilted: np.fmin.reduce(window_factors(model, windows, study.clip, *tilted)[0], axis=-1),
            study.statistics.required_factor.values(),
            *(values[..., np.newaxis] for values in others),
        )
    return made


def _energy(point: Point, model: str, place: tuple[float, ...], mount: Sequence[Floats]) -> dict[str, Any]:
    """Return the annual intercept efficiency, aperture energy and energy loss of each mount."""
    weather, sizes = point.inputs, [float(np.ravel(point[key])[0]) for key in _CONCENTRATOR]
    sun = sun_of(point.study.ephemeris, place, weather.utc)
    lit = np.flatnonzero((sun[:, 2] > 0) & (weather.dni > 0))
    error = window_factors(model, pack_windows(sun[lit], np.arange(lit.size + 1)), False, *mount)[1]
    dish = dict(zip((key.rpartition(".")[2] for key in _CONCENTRATOR), sizes, strict=True))
    irradiation = weather.dni[lit] * weather.hours * MEGA
    passed = dish_intercept(np.append(error, 0.0), **dish)
    perfect, found = passed[-1], passed[:-1].reshape(error.shape)
    total, area = irradiation.sum() or np.nan, 0.25 * np.pi * dish["diameter"] ** 2
    return {
        "energy_loss": (perfect - found) @ irradiation / (perfect * total),
        "intercept_efficiency": found @ irradiation / total,
        "aperture_energy": found @ irradiation * area,
    }


def finish(points: Points, computed: xr.Dataset) -> dict[str, Any]:
    """Compute statistics over tilt directions and over dates."""
    study, factor, ends = points.study, computed[_FACTOR], ("mean", "std")
    directed, months = _directed(study), _months(study)[1]
    made: dict[str, xr.DataArray] = {}

    def add(name: str, endings: tuple[str, ...], values: xr.DataArray, dim: str, *new: str) -> None:
        """Add statistics of the values along `dim`. The dimensions `new` replace `dim`."""
        found = xr.apply_ufunc(
            partial(_statistics, groups=months if new else None), values,
            input_core_dims=[[dim]], output_core_dims=[list(new)] * 4,
        )  # fmt: skip
        made.update({f"{name}_{ending}": each for ending, each in zip(endings, found, strict=False)})

    if directed:
        add(_FACTOR, tuple(f"{end}_over_directions" for end in ends), factor, "axis_tilt_direction")
    if computed.sizes["date"] > 1:
        add(_FACTOR, ("mean_over_dates", "std_over_dates", "min", "max"), factor, "date")
        add(_MONTHLY, ends, factor, "date", "month")
        dates = np.array(study.time.date_list(), dtype="datetime64[ns]")
        made["date_of_min"], made["date_of_max"] = (_label_of_least(one, "date", dates) for one in (factor, -factor))
        if directed:
            directions = points.parameters.parameter("errors.axis_tilt_direction").to_numpy()
            add(_MONTHLY, tuple(f"{end}_over_directions" for end in ends), made[f"{_MONTHLY}_mean"],
                "axis_tilt_direction")  # fmt: skip
            mean = made[f"{_FACTOR}_mean_over_dates"]
            made["worst_axis_tilt_direction"] = _label_of_least(mean, "axis_tilt_direction", directions)
    return {name: one.to_numpy() for name, one in made.items()}


def _label_of_least(values: xr.DataArray, dim: str, labels: NDArray[Any]) -> xr.DataArray:
    """Return the label of the first minimum along `dim`; missing if there are no values."""
    known = values.notnull()
    filled = values.where(known, np.inf)
    place = (filled <= filled.min(dim) + 1e-12).argmax(dim)  # despite rounding
    return xr.DataArray(labels[place], place.coords, place.dims).where(known.any(dim))


def _statistics(values: Floats, groups: NDArray[np.int64] | None = None) -> tuple[Floats, ...]:
    """Return the mean, sample standard deviation, minimum and maximum along the last axis, ignoring NaN.

    `groups` contains the group number of each value. If `groups` is given, statistics are computed for each group, and
    the groups are the last axis of the results.
    """
    if groups is not None:
        each = [_statistics(values[..., groups == group]) for group in range(groups.max() + 1)]
        return tuple(np.moveaxis(np.array(each), 0, -1))
    values = np.ascontiguousarray(values)
    known = np.isfinite(values)
    count = np.count_nonzero(known, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.sum(np.where(known, values, 0.0), axis=-1) / count
        squares = np.sum(np.where(known, values - mean[..., np.newaxis], 0.0) ** 2, axis=-1)
        std = np.sqrt(np.where(count > 1, squares, np.nan) / (count - 1))
    return mean, std, np.fmin.reduce(values, axis=-1), np.fmax.reduce(values, axis=-1)


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Yield a warning with the number of dates without an evaluated instant."""
    empty = int(result["window_is_empty"].sum())
    if empty:
        yield (
            f"{empty} of {result['window_is_empty'].size} days have no evaluated instant and therefore no factor (NaN)"
        )


@lru_cache(maxsize=4)  # the chunks of a site are computed one after another
def windows_of(time: DishTime, ephemeris: Ephemeris, timezone: str, place: tuple[float, ...]) -> Windows:
    """Return the sun vectors at the evaluated instants of each daily window at a site.

    A date without an evaluated instant has an empty window. `place` contains latitude and longitude [deg], positive
    north and east, and altitude [m]. Dates and windows refer to local time in `timezone`.
    """
    sun = partial(sun_of, ephemeris, place)
    dates = _sunlit_windows(time, timezone, sun) if time.window.sunlit else daily_windows(time, timezone)
    vectors = sun(np.concatenate(dates))
    starts = np.concatenate([[0], np.cumsum([stamps.size for stamps in dates])])
    return pack_windows(vectors, starts, (vectors[:, 2] > 0).astype(float) if time.daylight_only else None)


def sun_of(ephemeris: Ephemeris, place: tuple[float, ...], utc: Stamps) -> Floats:
    """Return the unit vectors to the sun (east, north, up) that the controller uses; NaN for NaT. [1]"""
    latitude, longitude, altitude = place
    sun = sun_vectors(utc, latitude, longitude, altitude, ephemeris.delta_t)
    return sun if ephemeris.elevation == "geometric" else refracted(sun, 100 * ephemeris.pressure,
                                                                    ephemeris.temperature)  # fmt: skip


def _sunlit_windows(time: DishTime, timezone: str, sun: Sun) -> list[Stamps]:
    """Return equally spaced instants between sunrise and sunset on each date.

    If the clock differs greatly from solar time, the sun may be up at both the start and the end of a date. Both
    periods are then sampled. Sunrise and sunset are bracketed in steps of 10 minutes.
    """
    from scipy.optimize.elementwise import find_root

    window = {"start": "00:00", "stop": "24:00", "step": "10 min"}
    search = CivilTime.model_validate({"clock": "civil", "dates": time.date_list(), "window": window})
    dates = daily_windows(search, timezone)
    bounds = np.cumsum([0, *(stamps.size for stamps in dates)])
    day, stamps = np.repeat(np.arange(len(dates)), np.diff(bounds)), np.concatenate(dates)
    up = sun(stamps)[:, 2] > 0
    change = np.flatnonzero((up[1:] != up[:-1]) & (day[1:] == day[:-1]))
    before, length = stamps[change], (stamps[change + 1] - stamps[change]).astype(np.float64)

    def height(share: Floats, before: Floats, length: Floats) -> Any:
        return sun(before.astype("datetime64[ns]") + np.round(share * length).astype("timedelta64[ns]"))[:, 2]

    limits = np.zeros(length.size), np.ones(length.size)
    shares = find_root(height, limits, args=(before.astype(np.int64), length)).x
    crossings = before + np.round(shares * length).astype("timedelta64[ns]")
    edges, found = np.split(crossings, np.searchsorted(change, bounds[1:-1])), []
    for own, first, last, inner in zip(dates, bounds, bounds[1:] - 1, edges, strict=False):
        ends = np.concatenate([own[:1][up[first : first + 1]], inner, own[-1:][up[last : last + 1]]]).reshape(-1, 2)
        found.append(own[:0])
        for rise, span in zip(ends[:, 0], np.diff(ends)[:, 0].astype(np.int64), strict=True):
            steps = max(1, round(span / (time.window.step * 3600e9)))
            positions = window_positions(steps, time.sampling)
            stamps = rise + np.round(positions * (span / steps)).astype("timedelta64[ns]")
            found[-1] = np.concatenate([found[-1], stamps])
    return found
