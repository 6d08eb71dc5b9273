"""Daily tracking factors of dishes over a region of a study's grid, the tilts they bear, and statistics over dates."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from heliosweep.families.dish_tracking.variables import (
    ALL_DATES,
    DAILY,
    DIRECTIONS,
    MONTHLY,
    MONTHLY_DIRECTIONS,
    directed,
    variables,
)
from heliosweep.families.dish_tracking.windows import sun_of, windows_of
from heliosweep.grid.clock import DATE, instant_count
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Workload
from heliosweep.grid.regions import SERIES_SLAB_BYTES
from heliosweep.grid.sun import instants_of, sun_attributes
from heliosweep.kernels import dish
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.warm import warm_dish

if TYPE_CHECKING:
    from heliosweep.families.dish_tracking.study import DishTrackingStudy
    from heliosweep.grid.regions import Region

#: Stamps, vectors, weights and packed rows of one instant of a site, and what makes them. [bytes]
BYTES_PER_INSTANT = 120
#: Errors of one instant of a time series and what makes them; most numbers of a time series in a part.
BYTES_PER_ERROR, MOST_ERRORS = 40, SERIES_SLAB_BYTES // 24

#: Tilts that are tried first [deg]; by how much the interval between two of them shrinks; and evaluations that takes.
SCAN, NARROW, EVALUATIONS = np.array([0.0, *np.geomspace(1e-3, 45.0, 48)]), 1e-13, 8

#: Factors that differ by less are equal but for rounding: a rigid mount leans alike in phi and phi + 180 deg. [1]
TIE = 1e-12

_MODELS = {"rigid": dish.RIGID, "untilted_home_axes": dish.UNTILTED_HOME_AXES}
_SITE = ("site.latitude", "site.longitude", "site.altitude")
_ANGLES = ("errors.axis_tilt_direction", "errors.home_azimuth_offset", "errors.home_elevation_offset")
#: Further errors of a mount, which a study may leave out.
_FURTHER = ("errors.azimuth_reference", "errors.non_orthogonality", "errors.collimation")
#: Keys that label a result also where they are not swept.
_LABELS = ("site.latitude", "site.longitude", "mount.model", "errors.axis_tilt", *_ANGLES, "tolerance", *_FURTHER)
_KEYS = (*_SITE, "mount.model", "errors.axis_tilt", *_ANGLES, "tolerance", *_FURTHER)


def workload(study: DishTrackingStudy) -> Workload:
    """Sizes and cost, for the plan."""
    parameters = Parameters(study)
    instants, days = instant_count(study.time), len(study.time.date_list())
    inner = {"date": days}
    if days > 1:
        inner["month"] = len(_months(study)[0])
    if study.statistics is not None:
        inner["required_factor"] = len(study.statistics.required_factor)
    tilts = parameters.sizes.get("axis_tilt", 1)
    required = inner.get("required_factor", 0)
    # per point: the tolerable tilt is solved once for all tilts
    solved, scanned = ((len(SCAN) + EVALUATIONS * required) / tilts, len(SCAN) / tilts) if required else (0.0, 0.0)
    whole = {"axis_tilt_direction": directed(study), "axis_tilt": solved and "axis_tilt" in parameters.sizes}

    series = instants_of(parameters).size if study.output.time_series else 0
    if series:
        inner["time"] = series

    def working_bytes(points: int, _: int) -> int:
        errors = BYTES_PER_ERROR * min(points * series, MOST_ERRORS)
        return BYTES_PER_INSTANT * instants + 8 * 8 * points * days * (1 + math.ceil(scanned)) + errors

    return Workload(
        parameters=parameters.sizes,
        inner=inner,
        evaluations=instants + series,
        unit="tracker-instants",
        working_bytes=working_bytes,
        whole=tuple(dim for dim, wanted in whole.items() if wanted),
        coordinate_bytes=8 * sum(inner.values()),
        axes={} if series else {"instants": instants},
    )


def coordinates(study: DishTrackingStudy) -> xr.Dataset:
    """Coordinates of the whole result, in memory."""
    parameters = Parameters(study)
    labels: dict[str, Any] = {**parameters.coordinates(_LABELS)}
    zones = np.array(parameters.timezones(), dtype=object)
    attrs = {"long_name": "time zone of dates and windows"}
    several = "site" in parameters.sizes
    labels["timezone"] = xr.DataArray(zones if several else zones[0], dims=("site",) if several else (), attrs=attrs)
    dates = np.array(study.time.date_list(), dtype="datetime64[ns]")
    labels["date"] = xr.DataArray(dates, dims="date", attrs=DATE)
    if dates.size > 1:
        labels["month"] = xr.DataArray(_months(study)[0], dims="month", attrs={"long_name": "month"})
    if study.statistics is not None:
        attrs = {"long_name": "required effective tracking factor", "units": "1"}
        required = study.statistics.required_factor.values()
        labels["required_factor"] = xr.DataArray(required, dims="required_factor", attrs=attrs)
    if study.output.time_series:
        labels |= instants_of(parameters).coordinates()
    sun = study.ephemeris
    air = f"{sun.pressure:g} hPa and {sun.temperature:g} deg C"
    elevation = f"apparent, at {air}" if sun.elevation == "apparent" else f"geometric, {air} without effect"
    return xr.Dataset(coords=labels, attrs=sun_attributes(study.time, sun.delta_t, elevation))


def _months(study: DishTrackingStudy) -> tuple[np.ndarray, np.ndarray]:
    """Months of the dates, such as 2021-06, and the position of each date's month among them."""
    months = np.array(study.time.date_list(), dtype="datetime64[M]")
    names, position = np.unique(months, return_inverse=True)
    return names.astype(str).astype(object), position


def prepare(study: DishTrackingStudy) -> tuple[float, bool]:
    """Load or compile the kernels; seconds it took, and whether something was compiled."""
    return warm_dish()


def compute(study: DishTrackingStudy, inputs: None, region: Region) -> xr.Dataset:
    """Factors and errors of every date, dates without an instant that counts, and the largest tolerable tilts.

    Where the region has ``time``, the error and the sun at each instant. Factors and errors are NaN where no instant of
    a date counts, and at instants that do not count.
    """
    parameters = Parameters(study, region)
    return _stated(study, _series(study, parameters) if "time" in region else _daily(study, parameters))


def _stated(study: DishTrackingStudy, full: xr.Dataset) -> xr.Dataset:
    """Those variables that the result has; what does not vary along a dimension is the same all along it."""
    stated = variables(study)
    return xr.Dataset(
        {
            name: one.isel({dim: 0 for dim in one.dims if dim not in stated[name].dims})
            for name, one in full.items()
            if name in stated
        }
    )


def _columns(parameters: Parameters) -> list[np.ndarray]:
    """Values of `_KEYS` at every point; errors that the study leaves out are zero."""
    columns = (parameters.values(key) for key in _KEYS)
    return [np.zeros(tuple(parameters.sizes.values())) if column is None else column for column in columns]


def _series(study: DishTrackingStudy, parameters: Parameters) -> xr.Dataset:
    """Tracking error of every mount [mrad], elevation and azimuth of the sun [deg] at each instant."""
    swept, instants = tuple(parameters.sizes.values()), instants_of(parameters).part(parameters.part("time"))
    columns, several = _columns(parameters), "site" in parameters.sizes
    errors, elevation, azimuth = (np.empty((*swept, instants.size)) for _ in range(3))
    for _, here in _places(parameters):
        latitude, longitude, altitude, model, tilt, *others = (column[here] for column in columns)
        place = (float(latitude.flat[0]), float(longitude.flat[0]), float(altitude.flat[0]))
        site = here[list(parameters.sizes).index("site")].start if several else 0
        utc = (instants.at_sites(site) if several else instants).labels["utc"].values
        sun = sun_of(study.ephemeris, *place, utc)
        counts = np.isfinite(sun[:, 2]) & ((sun[:, 2] > 0) | (not study.time.daylight_only))
        windows = dish.pack_windows(sun, np.arange(utc.size + 1), counts)
        errors[here] = _factors(_MODELS[model.flat[0]], windows, False, tilt, *others)[1].mean * 1e3
        elevation[here] = np.degrees(np.arctan2(sun[:, 2], np.hypot(sun[:, 0], sun[:, 1])))
        azimuth[here] = np.degrees(np.arctan2(sun[:, 0], sun[:, 1])) % 360.0
    dims = (*parameters.sizes, "time")
    made = {"tracking_error": errors, "solar_elevation": elevation, "solar_azimuth": azimuth}
    return xr.Dataset({name: (dims, values) for name, values in made.items()})


def _daily(study: DishTrackingStudy, parameters: Parameters) -> xr.Dataset:
    """Factors and errors of every date and mount, dates without an instant that counts, tolerable tilts."""
    swept, days = tuple(parameters.sizes.values()), len(study.time.date_list())
    required = np.array([] if study.statistics is None else study.statistics.required_factor.values())
    columns = _columns(parameters)
    daily = np.empty((len(DAILY), *swept, days))
    empty = np.empty((*swept, days), np.int8)
    tolerable = np.empty((*swept, required.size))
    for timezone, here in _places(parameters):
        latitude, longitude, altitude, model, tilt, *others = (column[here] for column in columns)
        place = (float(latitude.flat[0]), float(longitude.flat[0]), float(altitude.flat[0]))
        windows = windows_of(study.time, study.ephemeris, timezone, *place)
        factors = partial(_factors, _MODELS[model.flat[0]], windows, study.clip)
        factor, errors = factors(tilt, *others)
        daily[:, *here] = factor, errors.mean * 1e3, errors.largest * 1e3
        empty[here] = np.diff(windows.starts) == 0
        if required.size:
            tolerable[here] = _tolerable(factors, parameters, others, required)
    dims = (*parameters.sizes, "date")
    made = {name: (dims, values) for name, values in zip(DAILY, daily, strict=True)}
    made |= {"window_is_empty": (dims, empty), "tolerable_axis_tilt": ((*dims[:-1], "required_factor"), tolerable)}
    return xr.Dataset(made)


def _places(parameters: Parameters) -> Iterator[tuple[str, tuple[slice, ...]]]:
    """Every combination of a site and a model of the mount: its time zone, and index of its mounts."""
    sizes, zones = parameters.sizes, parameters.timezones()
    apart = {*parameters.site_dims, *parameters.parameter("mount.model").dims}
    for index in np.ndindex(*(size if dim in apart else 1 for dim, size in sizes.items())):
        at = dict(zip(sizes, index, strict=True))
        yield zones[at.get("site", 0)], tuple(slice(i, i + 1) if dim in apart else slice(None) for dim, i in at.items())


def _factors(
    model: int,
    windows: dish.Windows,
    clip: bool,
    tilt: np.ndarray,
    direction: np.ndarray,
    azimuth: np.ndarray,
    elevation: np.ndarray,
    tolerance: np.ndarray,
    *further: np.ndarray,
) -> tuple[np.ndarray, dish.WindowErrors]:
    """Daily factors [1] and errors [rad], dates last, for angles in degrees, those of `_FURTHER` last, and mrad."""
    limit = tolerance * 1e-3
    tilt, direction, azimuth, elevation, reference, askew, collimation = map(
        np.radians, (tilt, direction, azimuth, elevation, *further)
    )
    errors = dish.window_errors(
        model,
        windows,
        tilt,
        direction,
        azimuth,
        elevation,
        limit if clip else None,
        azimuth_reference=reference,
        non_orthogonality=askew,
        collimation=collimation,
    )
    counted = errors.clipped if clip else errors.mean
    return 1.0 - counted / limit[..., np.newaxis], errors


def _tolerable(
    factors: Callable[..., tuple[np.ndarray, dish.WindowErrors]],
    parameters: Parameters,
    others: Sequence[np.ndarray],
    required: np.ndarray,
) -> np.ndarray:
    """Largest tilt of each mount for each required factor, alike for all its tilts; required factors last. [deg]"""
    untilted = tuple(slice(0, 1) if dim == "axis_tilt" else slice(None) for dim in parameters.sizes)
    wide = [values[untilted][..., np.newaxis] for values in others]
    return largest_tilt(lambda tilt: np.fmin.reduce(factors(tilt, *wide)[0], axis=-1), required)


def largest_tilt(least: Callable[[np.ndarray], np.ndarray], required: np.ndarray) -> np.ndarray:
    """Largest tilt whose least daily factor is at least the required one.

    With home offsets a tilt can make up for an offset, so that the factor rises before it falls: the tilts of `SCAN`
    are tried first, and the root is sought after the last that suffices. A range of good tilts narrower than a step
    of the scan, beyond all others, is not seen.

    Parameters
    ----------
    least : callable
        Tilts of shape (R,) or (..., R), or other ones in place of R [deg] -> least daily factors of all dates, of the
        same shape after broadcasting.
    required : ndarray, shape (R,)
        Required factors. [1]

    Returns
    -------
    ndarray, shape (..., R)
        0 where no tilt suffices; NaN where the largest of the scan still does, or where no date has a factor. [deg]
    """
    tried = least(SCAN)[..., np.newaxis, :] - required[:, np.newaxis]
    enough, last = tried >= 0.0, len(SCAN) - 1
    place = np.where(enough.any(axis=-1), last - np.argmax(enough[..., ::-1], axis=-1), -1)
    low, high = np.maximum(place, 0), np.clip(place + 1, 0, last)
    ends = (np.take_along_axis(tried, index[..., np.newaxis], -1)[..., 0] for index in (low, high))
    found = _root(lambda tilt: least(tilt) - required, SCAN[low], SCAN[high], *ends)
    return np.where(np.isnan(tried[..., 0]) | (place == last), np.nan, np.where(place < 0, 0.0, found))


def _root(excess: Callable[[Floats], Floats], low: Floats, high: Floats, at_low: Floats, at_high: Floats) -> Floats:
    """Tilts at which an excess that is not negative at `low` and negative at `high` ends, to `NARROW` of the interval.

    Chandrupatla's method: quadratic interpolation of the inverse where it can be trusted, else half the interval. Every
    root takes its own steps, whatever others are sought with it.
    """
    close = NARROW * (high - low)
    # x, the last tilt tried, and y stand on both sides of the root; z is the one before, beyond x or y
    x, y, fx, fy = low, high, at_low, at_high
    share = np.full(x.shape, 0.5)
    with np.errstate(divide="ignore", invalid="ignore"):
        while np.any(open_ := np.abs(y - x) > close):
            tilt = np.where(open_, x + share * (y - x), x)
            value = np.where(open_, excess(tilt), fx)
            same = (value >= 0.0) == (fx >= 0.0)
            z, fz = np.where(same, x, y), np.where(same, fx, fy)
            y, fy = np.where(same | ~open_, y, x), np.where(same | ~open_, fy, fx)
            x, fx = tilt, value
            place, rise = (x - y) / (z - y), (fx - fy) / (fz - fy)
            smooth = (rise * rise < place) & ((1.0 - rise) ** 2 < 1.0 - place)
            curved = fx / (fy - fx) * fz / (fy - fz) + (z - x) / (y - x) * fx / (fz - fx) * fy / (fz - fy)
            least = 0.5 * close / np.abs(y - x)
            share = np.clip(np.where(smooth, curved, 0.5), least, 1.0 - least)
    return np.where(fx >= 0.0, x, y)


def finish(study: DishTrackingStudy, inputs: None, region: Region, computed: xr.Dataset) -> xr.Dataset:
    """Statistics over the directions of the tilt and over dates."""
    parameters, factor = Parameters(study, region), computed["effective_tracking_factor"]
    made: dict[str, xr.DataArray] = {}
    if directed(study):
        made |= _reduced(DIRECTIONS, mean_and_deviation, factor, "axis_tilt_direction")
    if computed.sizes["date"] > 1:
        made |= _reduced(ALL_DATES, over_dates, factor, "date")
        # Published results of one place were summed in another order than those of several.
        total = one_by_one if parameters.site_dims else pairwise
        monthly = partial(over_months, month=_months(study)[1], total=total)
        made |= _reduced(MONTHLY, monthly, factor, "date", "month")
        if directed(study):
            of_months = made["monthly_effective_tracking_factor_mean"]
            made |= _reduced(MONTHLY_DIRECTIONS, mean_and_deviation, of_months, "axis_tilt_direction")
        dates = np.array(study.time.date_list(), dtype="datetime64[ns]")
        made["date_of_min"] = _label_of_least(factor, "date", dates)
        made["date_of_max"] = _label_of_least(-factor, "date", dates)
        if directed(study):
            directions = parameters.parameter("errors.axis_tilt_direction").to_numpy()
            mean = made["effective_tracking_factor_mean_over_dates"]
            made["worst_axis_tilt_direction"] = _label_of_least(mean, "axis_tilt_direction", directions)
    return xr.Dataset(made)


def _reduced(
    names: Collection[str], function: Callable[..., tuple[np.ndarray, ...]], values: xr.DataArray, dim: str, *new: str
) -> dict[str, xr.DataArray]:
    """Several statistics along a dimension, by name; `new` is the dimension that they have instead, if any."""
    made = xr.apply_ufunc(function, values, input_core_dims=[[dim]], output_core_dims=[list(new)] * len(names))
    return dict(zip(names, made, strict=True))


def _label_of_least(values: xr.DataArray, dim: str, labels: NDArray[Any]) -> xr.DataArray:
    """Label, a date or a direction, of the least value; the first of several, missing without a value."""

    def label(along: Floats) -> NDArray[Any]:
        known, missing = np.isfinite(along), labels.dtype.type("NaT" if labels.dtype.kind == "M" else "nan")
        heights = np.where(known, along, np.inf)
        first = np.argmax(heights <= heights.min(axis=-1, keepdims=True) + TIE, axis=-1)
        return np.where(known.any(axis=-1), labels[first], missing)

    return xr.apply_ufunc(label, values, input_core_dims=[[dim]])


# Statistics along the last axis: over the dates, or over the directions of a tilt. Missing values (NaN) are left out; a
# statistic of none is missing.


def pairwise(values: Floats) -> Floats:
    """Sum along the last axis in NumPy's order for contiguous values."""
    return np.sum(np.ascontiguousarray(values), axis=-1)


def one_by_one(values: Floats) -> Floats:
    """Sum along the last axis from its first value to its last."""
    return np.cumsum(values, axis=-1)[..., -1]


def mean_and_deviation(values: Floats, total: Callable[[Floats], Floats] = pairwise) -> tuple[Floats, Floats]:
    """Mean and sample standard deviation (n - 1), summed by `total`; NaN of fewer than 1 and 2 values."""
    known = np.isfinite(values)
    count = np.count_nonzero(known, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total(np.where(known, values, 0.0)) / count
        squares = total(np.where(known, values - mean[..., np.newaxis], 0.0) ** 2)
        deviation = np.sqrt(squares / np.maximum(count - 1, 0))
    return mean, np.where(count > 1, deviation, np.nan)


def over_dates(values: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Mean, sample standard deviation, minimum and maximum."""
    return *mean_and_deviation(values), np.fmin.reduce(values, axis=-1), np.fmax.reduce(values, axis=-1)


def over_months(values: Floats, month: NDArray[np.int64], total: Callable[[Floats], Floats]) -> tuple[Floats, Floats]:
    """Mean and sample standard deviation of each month, along a new last axis, from the month of each value."""
    parts = [mean_and_deviation(values[..., month == number], total) for number in range(month.max() + 1)]
    mean, deviation = (np.stack(column, axis=-1) for column in zip(*parts, strict=True))
    return mean, deviation


def remarks(result: xr.Dataset) -> Iterator[str]:
    """How many dates have no instant that counts, and so no factor."""
    empty = int(result["window_is_empty"].sum())
    if empty:
        yield f"{empty} of {result['window_is_empty'].size} days have no instant that counts: no factor (NaN) there"
