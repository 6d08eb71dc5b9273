"""Daily tracking factors of dishes over a region of a grid, their tolerable tilts, and statistics over dates."""

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
from heliosweep.grid.clock import DATE, instant_count
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import BLOCK_BYTES, Workload
from heliosweep.grid.sun import instants_of, sun_attributes
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.dish import pack_windows
from heliosweep.kernels.warm import warm_dish

if TYPE_CHECKING:
    from heliosweep.families.dish_tracking.study import DishTrackingStudy
    from heliosweep.grid.regions import Region

#: Memory of one instant of a site, and of one error of a time series. [bytes]
BYTES_PER_INSTANT, BYTES_PER_ERROR = 120, 40
#: Factors that differ by less are equal except for rounding: a rigid mount leans alike in phi and phi + 180 deg. [1]
TIE = 1e-12
_SITE = ("site.latitude", "site.longitude", "site.altitude")
_MOUNT = ("errors.axis_tilt", "errors.axis_tilt_direction", "tolerance", *(f"errors.{name}" for name in ERRORS))
#: Keys that are coordinates of a result even if they are not swept.
_LABELS = (*_SITE[:2], "mount.model", *_MOUNT)


def workload(study: DishTrackingStudy) -> Workload:
    """Return sizes and memory for the plan."""
    parameters, instants = Parameters(study), instant_count(study.time)
    inner = {"date": len(study.time.date_list())}
    if inner["date"] > 1:
        inner["month"] = len(_months(study)[0])
    if study.statistics is not None:
        inner["required_factor"] = len(study.statistics.required_factor)
    series = instants_of(parameters).size if study.output.time_series else 0
    if series:
        inner["time"] = series
    solved = study.statistics is not None and "axis_tilt" in parameters.sizes
    scanned = len(SCAN) if study.statistics is not None else 0

    def working_bytes(points: int, _: int) -> int:
        errors = BYTES_PER_ERROR * min(points * series, BLOCK_BYTES["series"] // 24)
        return BYTES_PER_INSTANT * instants + 8 * 8 * points * inner["date"] * (1 + scanned) + errors

    return Workload(
        parameters=parameters.sizes,
        inner=inner,
        evaluations=instants + series,
        unit="tracker-instants",
        working_bytes=working_bytes,
        whole=(*["axis_tilt_direction"] * names.directed(study), *["axis_tilt"] * solved),
        coordinate_bytes=8 * sum(inner.values()),
        axes={} if series else {"instants": instants},
    )


def coordinates(study: DishTrackingStudy) -> xr.Dataset:
    """Return the coordinates of the whole result."""
    parameters, dates, sun = Parameters(study), np.array(study.time.date_list(), "datetime64[ns]"), study.ephemeris
    zones, several = parameters.timezones(), "site" in parameters.sizes
    labels: dict[str, Any] = {
        **parameters.coordinates(_LABELS),
        "timezone": (("site",), zones) if several else ((), zones[0]),
        "date": ("date", dates, DATE),
    }
    if dates.size > 1:
        labels["month"] = "month", _months(study)[0], {"long_name": "month"}
    if study.statistics is not None:
        attrs = {"long_name": "required effective tracking factor", "units": "1"}
        labels["required_factor"] = "required_factor", study.statistics.required_factor.values(), attrs
    if study.output.time_series:
        labels |= instants_of(parameters).coordinates()
    air = f"{sun.pressure:g} hPa and {sun.temperature:g} deg C"
    elevation = f"apparent, at {air}" if sun.elevation == "apparent" else f"geometric, {air} without effect"
    found = xr.Dataset(coords=labels, attrs=sun_attributes(study.time, sun.delta_t, elevation))
    found["timezone"].attrs["long_name"] = "time zone of dates and windows"
    return found


def _months(study: DishTrackingStudy) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Return the months of the dates, such as 2021-06, and the position of each date's month among them."""
    months, position = np.unique(np.array(study.time.date_list(), "datetime64[M]"), return_inverse=True)
    return months.astype(str).astype(object), position


def prepare(study: DishTrackingStudy) -> tuple[float, bool]:
    """Load or compile the kernels; return the seconds it took, and True if a kernel was compiled."""
    return warm_dish()


def compute(study: DishTrackingStudy, inputs: None, region: Region) -> xr.Dataset:
    """Compute factors, errors and tolerable tilts, or errors and the sun at each instant if the region has ``time``.

    Factors and errors are NaN if no instant of a date counts, and at instants that do not count.
    """
    parameters, stated = Parameters(study, region), names.variables(study)
    mount = [parameters.values(key) for key in _MOUNT]
    none = np.zeros(tuple(parameters.sizes.values()))
    made: dict[str, tuple[tuple[str, ...], NDArray[Any]]] = {}
    for here, site, model, place, zone in _places(parameters):
        values = [none[here] if each is None else each[here] for each in mount]
        if "time" in region:
            instants = instants_of(parameters).part(region["time"]).at_sites(site)
            found = _series(study, model, place, instants.labels["utc"].values, values)
        else:
            windows = windows_of(study.time, study.ephemeris, zone, *place)
            found = dict(zip(names.DAILY, window_factors(model, windows, study.clip, *values), strict=True))
            found["window_is_empty"] = np.diff(windows.starts) == 0
            if study.statistics is not None:
                untilted = tuple(slice(0, 1) if dim == "axis_tilt" else slice(None) for dim in parameters.sizes)
                others = [each[untilted][..., np.newaxis] for each in values[1:]]
                factors = partial(window_factors, model, windows, study.clip)
                found["tolerable_axis_tilt"] = largest_tilt(
                    lambda *tilted, factors=factors: np.fmin.reduce(factors(*tilted)[0], axis=-1),
                    study.statistics.required_factor.values(), *others,
                )  # fmt: skip
        for name in found.keys() & stated.keys():
            (inner,) = set(stated[name].dims) - set(parameters.sizes)
            empty = np.empty((*none.shape, found[name].shape[-1]), stated[name].dtype)
            made.setdefault(name, ((*parameters.sizes, inner), empty))[1][here] = found[name]
    full = xr.Dataset(made)
    return full.map(lambda one: one.isel({dim: 0 for dim in one.dims if dim not in stated[str(one.name)].dims}))


def _places(parameters: Parameters) -> Iterator[tuple[tuple[slice, ...], int, str, tuple[float, float, float], str]]:
    """Yield each site and model of the mount: index of its mounts, number, model, latitude to altitude, time zone."""
    sizes, zones = parameters.sizes, parameters.timezones()
    apart = {*parameters.site_dims, *parameters.parameter("mount.model").dims}
    columns = [parameters.values(key) for key in ("mount.model", *_SITE)]
    for index in np.ndindex(*(size if dim in apart else 1 for dim, size in sizes.items())):
        here = tuple(slice(i, i + 1) if dim in apart else slice(None) for dim, i in zip(sizes, index, strict=True))
        model, *place = (0.0 if column is None else column[index] for column in columns)
        site, (latitude, longitude, altitude) = dict(zip(sizes, index, strict=True)).get("site", 0), map(float, place)
        yield here, site, str(model), (latitude, longitude, altitude), zones[site]


def _series(
    study: DishTrackingStudy,
    model: str,
    place: tuple[float, float, float],
    utc: NDArray[np.datetime64],
    mount: list[Floats],
) -> dict[str, NDArray[Any]]:
    """Return the tracking error [mrad], and elevation and azimuth of the sun [deg] at each instant."""
    sun = sun_of(study.ephemeris, *place, utc)
    counts = np.isfinite(sun[:, 2]) & ((sun[:, 2] > 0) | (not study.time.daylight_only))
    windows = pack_windows(sun, np.arange(utc.size + 1), counts)
    return {
        "tracking_error": window_factors(model, windows, False, *mount)[1],
        "solar_elevation": np.degrees(np.arctan2(sun[:, 2], np.hypot(sun[:, 0], sun[:, 1]))),
        "solar_azimuth": np.degrees(np.arctan2(sun[:, 0], sun[:, 1])) % 360.0,
    }


def finish(study: DishTrackingStudy, inputs: None, region: Region, computed: xr.Dataset) -> xr.Dataset:
    """Compute statistics over the directions of the tilt and over dates."""
    factor, directed = computed["effective_tracking_factor"], names.directed(study)
    made = _reduced(names.DIRECTIONS, _mean_std, factor, "axis_tilt_direction") if directed else {}
    if computed.sizes["date"] > 1:
        made |= _reduced(names.ALL_DATES, _over_dates, factor, "date")
        made |= _reduced(names.MONTHLY, partial(_over_months, months=_months(study)[1]), factor, "date", "month")
        dates = np.array(study.time.date_list(), dtype="datetime64[ns]")
        made["date_of_min"], made["date_of_max"] = (
            _label_of_least(values, "date", dates) for values in (factor, -factor)
        )
        if directed:
            monthly, mean = (made[name] for name in (next(iter(names.MONTHLY)), next(iter(names.ALL_DATES))))
            made |= _reduced(names.MONTHLY_DIRECTIONS, _mean_std, monthly, "axis_tilt_direction")
            directions = Parameters(study, region).parameter("errors.axis_tilt_direction").to_numpy()
            made["worst_axis_tilt_direction"] = _label_of_least(mean, "axis_tilt_direction", directions)
    return xr.Dataset(made)


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
