"""Daily tracking factors of dishes, their tolerable tilts, and statistics over dates."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from heliosweep.dish import ERRORS, SCAN, largest_tilt, window_factors
from heliosweep.families.dish_tracking import variables as names
from heliosweep.families.dish_tracking.windows import sun_of, windows_of
from heliosweep.families.family import Computation
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.sun import DATE, sun_attributes
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.dish import pack_windows

if TYPE_CHECKING:
    from heliosweep.families.dish_tracking.study import DishTrackingStudy
    from heliosweep.families.points import Point, Points

#: Factors that differ by less are equal except for rounding: a rigid mount leans alike in phi and phi + 180 deg. [1]
TIE = 1e-12
_SITE = ("site.latitude", "site.longitude", "site.altitude")
_MOUNT = ("errors.axis_tilt", "errors.axis_tilt_direction", "tolerance", *(f"errors.{name}" for name in ERRORS))


def computation(study: DishTrackingStudy) -> Computation:
    """Return the variables of a study and the function that computes them."""
    dates, sun = np.array(study.time.date_list(), "datetime64[ns]"), study.ephemeris
    dims: dict[str, Any] = {"date": (dates, DATE)}
    if dates.size > 1:
        dims["month"] = _months(study)[0], {"long_name": "month"}
    if study.statistics is not None:
        attrs = {"long_name": "required effective tracking factor", "units": "1"}
        dims["required_factor"] = study.statistics.required_factor.values(), attrs
    solved, swept = study.statistics is not None, {dim.name for dim in study.dimensions()}
    air = f"{sun.pressure:g} hPa and {sun.temperature:g} deg C"
    elevation = f"apparent, at {air}" if sun.elevation == "apparent" else f"geometric, {air} without effect"
    return Computation(
        function=factors,
        variables=names.variables(study),
        labels=(*_SITE[:2], "mount.model", *_MOUNT),
        dims=dims,
        coordinates=partial(_timezones, study),
        attrs=sun_attributes(study.time, sun.delta_t, elevation),
        finish=finish,
        arrays=("mount.model",),
        whole=(*["axis_tilt_direction"] * names.directed(study), *["axis_tilt"] * (solved and "axis_tilt" in swept)),
        unit="tracker-instants",
        memory=8 * 8 * dates.size * (1 + len(SCAN) * solved),
    )


def _timezones(study: DishTrackingStudy) -> dict[str, Any]:
    """Return the time zones of the sites."""
    parameters = Parameters(study)
    zones, attrs = parameters.timezones(), {"long_name": "time zone of dates and windows"}
    return {"timezone": ("site", zones, attrs) if "site" in parameters.sizes else ((), zones[0], attrs)}


def _months(study: DishTrackingStudy) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Return the months of the dates, such as 2021-06, and the position of each date's month among them."""
    months, position = np.unique(np.array(study.time.date_list(), "datetime64[M]"), return_inverse=True)
    return months.astype(str).astype(object), position


def factors(point: Point) -> dict[str, Any]:
    """Compute factors, errors and tolerable tilts, or errors and the sun at each instant if these are stored.

    Factors and errors are NaN if no instant of a date counts, and at instants that do not count.
    """
    study, model = point.study, str(point["mount.model"])
    latitude, longitude, altitude = (float(point[key] or 0.0) for key in _SITE)
    mount = [np.asarray(0.0 if point[key] is None else point[key], np.float64) for key in _MOUNT]
    if "time" in point.points.region:
        sun = sun_of(study.ephemeris, latitude, longitude, altitude, point.instants.labels["utc"].values)
        counts = np.isfinite(sun[:, 2]) & ((sun[:, 2] > 0) | (not study.time.daylight_only))
        windows = pack_windows(sun, np.arange(len(sun) + 1), counts)
        return {
            "tracking_error": window_factors(model, windows, False, *mount)[1],
            "solar_elevation": np.degrees(np.arctan2(sun[:, 2], np.hypot(sun[:, 0], sun[:, 1]))),
            "solar_azimuth": np.degrees(np.arctan2(sun[:, 0], sun[:, 1])) % 360.0,
        }
    windows = windows_of(study.time, study.ephemeris, point.timezone, latitude, longitude, altitude)
    made: dict[str, Any] = dict(zip(names.DAILY, window_factors(model, windows, study.clip, *mount), strict=True))
    made["window_is_empty"] = np.diff(windows.starts) == 0
    if study.statistics is not None:
        untilted = tuple(slice(0, 1) if dim == "axis_tilt" else slice(None) for dim in point.points.sizes)
        others = [values[untilted] if values.ndim else values for values in mount[1:]]
        made["tolerable_axis_tilt"] = largest_tilt(
            lambda *tilted: np.fmin.reduce(window_factors(model, windows, study.clip, *tilted)[0], axis=-1),
            study.statistics.required_factor.values(),
            *(values[..., np.newaxis] for values in others),
        )
    return made


def finish(points: Points, computed: xr.Dataset) -> dict[str, Any]:
    """Compute statistics over the directions of the tilt and over dates."""
    study, factor = points.study, computed["effective_tracking_factor"]
    directed, months = names.directed(study), partial(_over_months, months=_months(study)[1])
    made = _reduced(names.DIRECTIONS, _mean_std, factor, "axis_tilt_direction") if directed else {}
    if computed.sizes["date"] > 1:
        made |= _reduced(names.ALL_DATES, _over_dates, factor, "date")
        made |= _reduced(names.MONTHLY, months, factor, "date", "month")
        dates = np.array(study.time.date_list(), dtype="datetime64[ns]")
        for name, values in zip(names.EXTREMES, (factor, -factor), strict=True):
            made[name] = _label_of_least(values, "date", dates)
        if directed:
            monthly, mean = (made[name] for name in (next(iter(names.MONTHLY)), next(iter(names.ALL_DATES))))
            made |= _reduced(names.MONTHLY_DIRECTIONS, _mean_std, monthly, "axis_tilt_direction")
            directions = points.parameters.parameter("errors.axis_tilt_direction").to_numpy()
            made["worst_axis_tilt_direction"] = _label_of_least(mean, "axis_tilt_direction", directions)
    return {name: one.to_numpy() for name, one in made.items()}


def _reduced(
    made: Collection[str], function: Callable[..., tuple[Floats, ...]], values: xr.DataArray, dim: str, *new: str
) -> dict[str, xr.DataArray]:
    """Return several statistics along a dimension by name; `new` is a dimension that they have instead."""
    found = xr.apply_ufunc(
        lambda array: function(np.ascontiguousarray(array)), values, input_core_dims=[[dim]],
        output_core_dims=[list(new)] * len(made),
    )  # fmt: skip
    return dict(zip(made, found, strict=True))


def _label_of_least(values: xr.DataArray, dim: str, labels: NDArray[Any]) -> xr.DataArray:
    """Return the label of the minimum, the first of several; missing without a value."""
    known = values.notnull()
    place = (values.where(known, np.inf) <= values.min(dim) + TIE).argmax(dim)
    return xr.DataArray(labels[place], place.coords, place.dims).where(known.any(dim))


def _mean_std(values: Floats) -> tuple[Floats, Floats]:
    """Return mean and sample standard deviation (n - 1) along the last axis without NaN, NaN of too few values."""
    known = np.isfinite(values)
    count = np.count_nonzero(known, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.sum(np.where(known, values, 0.0), axis=-1) / count
        squares = np.sum(np.where(known, values - mean[..., np.newaxis], 0.0) ** 2, axis=-1)
        return mean, np.sqrt(np.where(count > 1, squares, np.nan) / (count - 1))


def _over_dates(values: Floats) -> tuple[Floats, ...]:
    """Return mean, sample standard deviation, minimum and maximum."""
    return *_mean_std(values), np.fmin.reduce(values, axis=-1), np.fmax.reduce(values, axis=-1)


def _over_months(values: Floats, months: NDArray[np.int64]) -> tuple[Floats, ...]:
    """Return mean and sample standard deviation of each month along a new last axis."""
    pairs = [_mean_std(np.ascontiguousarray(values[..., months == month])) for month in range(months.max() + 1)]
    return tuple(np.moveaxis(np.array(pairs), 0, -1))


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Yield the number of dates without an instant that counts."""
    empty = int(result["window_is_empty"].sum())
    if empty:
        yield f"{empty} of {result['window_is_empty'].size} days have no instant that counts: no factor (NaN) there"
