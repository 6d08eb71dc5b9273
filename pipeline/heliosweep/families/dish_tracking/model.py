"""From a study to its lazy result: the daily factors by one kernel call per site, statistics on top.

The sun of a site is computed once in a block and shared by every parameter combination of the block.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from heliosweep.families.dish_tracking import blocks, statistics, variables
from heliosweep.families.dish_tracking.config import DishTrackingStudy
from heliosweep.families.sun import site_of, sun_attributes
from heliosweep.grid.axes import Grid
from heliosweep.grid.evaluate import evaluate
from heliosweep.grid.instants import DATE, instant_count
from heliosweep.grid.plan import Workload

#: Time of one tilt, direction and instant on one core: where tilts share powers of one sine, with one tilt and with the
#: other model, and with home offsets; and of one sun position, packed. [s]
SECONDS_SHARED, SECONDS_PER_ERROR, SECONDS_OF_CHAIN, SECONDS_PER_SUN = 0.3e-9, 1.4e-9, 3e-9, 40e-9
#: Stamps, vectors, weights and packed rows of one instant of a site, and what makes them. [bytes]
BYTES_PER_INSTANT = 120

#: Keys that label a result also where they are not swept.
_LABELS = (
    "site.latitude",
    "site.longitude",
    "mount.model",
    "errors.axis_tilt",
    "errors.axis_tilt_direction",
    "errors.home_azimuth_offset",
    "errors.home_elevation_offset",
    "tolerance",
)
_DIRECTION, _TILT = "axis_tilt_direction", "axis_tilt"


class Axes(NamedTuple):
    """What is swept, sorted by its part in the computation."""

    swept: tuple[str, ...]
    """All swept dimensions in the order of the study."""
    site: tuple[str, ...]
    """Those that the sun depends on."""
    directed: bool
    """Whether the direction of the tilt is swept by itself, so that statistics over it have a meaning."""


def axes_of(grid: Grid) -> Axes:
    """Sort the swept dimensions of a study."""
    directed = any(set(dim.sweeps) == {"errors.axis_tilt_direction"} for dim in grid.study.dimensions())
    return Axes(tuple(grid.sizes), grid.site_dims, directed)


def workload(study: DishTrackingStudy) -> Workload:
    """Sizes and cost, for the plan.

    Parameters
    ----------
    study : DishTrackingStudy
        Checked study.

    Returns
    -------
    Workload
    """
    grid = Grid(study)
    instants = instant_count(study.time)
    inner = _inner_sizes(study)
    days = inner["date"]
    axes = axes_of(grid)
    lead = math.prod(size for dim, size in grid.sizes.items() if dim not in axes.site)
    tilts = grid.sizes.get(_TILT, 1)
    solved = inner.get("required_factor", 0) / tilts  # per point: the tolerable tilt is solved once for all tilts

    def block_bytes(points: int, _: int) -> int:
        return BYTES_PER_INSTANT * instants + 8 * 8 * points * days * (1 + math.ceil(solved))

    return Workload(
        parameters=grid.sizes,
        inner=inner,
        evaluations=instants,
        unit="tracker-instants",
        seconds=_seconds_per_error(study, tilts) * (1 + solved * blocks.EVALUATIONS) + SECONDS_PER_SUN / lead,
        splittable="",
        whole=(_DIRECTION,) if axes_of(grid).directed else (),
        variables=_dims_of(study, axes),
        itemsize={"window_is_empty": 1},
        block_bytes=block_bytes,
        coordinate_bytes=8 * sum(inner.values()),
        axes={"instants": instants},
    )


def _seconds_per_error(study: DishTrackingStudy, tilts: int) -> float:
    errors = study.errors
    if any(offset != 0 for offset in (errors.home_azimuth_offset, errors.home_elevation_offset)):
        return SECONDS_OF_CHAIN
    shared = study.mount.model == "rigid" and tilts > 2 and not study.clip
    return SECONDS_SHARED if shared else SECONDS_PER_ERROR


def _inner_sizes(study: DishTrackingStudy) -> dict[str, int]:
    dates = study.time.date_list()
    sizes = {"date": len(dates)}
    if len(dates) > 1:
        sizes["month"] = len(_months(study)[0])
    if study.statistics is not None:
        sizes["required_factor"] = len(study.statistics.required_factor)
    return sizes


def _dims_of(study: DishTrackingStudy, axes: Axes) -> dict[str, tuple[str, ...]]:
    """Dimensions of every variable of the result."""
    others = tuple(dim for dim in axes.swept if dim not in axes.site)
    undirected = tuple(dim for dim in others if dim != _DIRECTION)
    dims = dict.fromkeys(variables.DAILY, (*axes.site, "date", *others))
    dims |= dict.fromkeys(variables.WINDOW, (*axes.site, "date"))
    if axes.directed:
        dims |= dict.fromkeys(variables.DIRECTIONS, (*axes.site, "date", *undirected))
    if len(study.time.date_list()) > 1:
        dims |= dict.fromkeys((*variables.ANNUAL, *variables.EXTREMES), (*axes.site, *others))
        dims |= dict.fromkeys(variables.MONTHLY, (*axes.site, "month", *others))
        if axes.directed:
            dims |= dict.fromkeys(variables.WORST, (*axes.site, *undirected))
    if study.statistics is not None:
        untilted = tuple(dim for dim in others if dim != _TILT)
        dims |= dict.fromkeys(variables.TOLERABLE, (*axes.site, "required_factor", *untilted))
    return dims


def coordinates(study: DishTrackingStudy, select: Mapping[str, slice] | None = None) -> xr.Dataset:
    """Coordinates of the result over a part of the parameter grid, all of it where `select` is left out."""
    grid = Grid(study, select)
    labels = grid.coordinates(_LABELS)
    dates = np.array(study.time.date_list(), dtype="datetime64[ns]")
    zones = np.array(grid.timezones(), dtype=object)
    labels["timezone"] = xr.DataArray(
        zones if "site" in grid.sizes else zones[0],
        dims=("site",) if "site" in grid.sizes else (),
        attrs={"long_name": "time zone of dates and windows"},
    )
    labels["date"] = xr.DataArray(dates, dims="date", attrs=DATE)
    if dates.size > 1:
        names, _ = _months(study)
        labels["month"] = xr.DataArray(names, dims="month", attrs={"long_name": "month"})
    if study.statistics is not None:
        labels["required_factor"] = xr.DataArray(
            study.statistics.required_factor.values(),
            dims="required_factor",
            attrs={"long_name": "required effective tracking factor", "units": "1"},
        )
    return xr.Dataset(coords=labels, attrs=_sun_attributes(study))


def _sun_attributes(study: DishTrackingStudy) -> dict[str, str]:
    sun = study.ephemeris
    air = f"{sun.pressure:g} hPa and {sun.temperature:g} deg C"
    elevation = f"apparent, at {air}" if sun.elevation == "apparent" else f"geometric, {air} without effect"
    return sun_attributes(study.time, sun.delta_t, elevation)


def _months(study: DishTrackingStudy) -> tuple[np.ndarray, np.ndarray]:
    """Months of the dates, such as 2021-06, and the position of each date's month among them."""
    months = np.array(study.time.date_list(), dtype="datetime64[M]")
    names, position = np.unique(months, return_inverse=True)
    return names.astype(str).astype(object), position


def build(study: DishTrackingStudy, chunks: Mapping[str, int], select: Mapping[str, slice] | None = None) -> xr.Dataset:
    """Lazy result over a part of the parameter grid.

    Parameters
    ----------
    study : DishTrackingStudy
        Checked study.
    chunks : mapping of str to int
        Block lengths, from the plan.
    select : mapping of str to slice, optional
        Part of the swept dimensions; all of them where left out.

    Returns
    -------
    xarray.Dataset
        The variables of `variables`, not yet computed.
    """
    grid = Grid(study, select)
    axes, labels = axes_of(grid), coordinates(study, select)
    made = _Evaluation(study, grid, axes, labels, chunks)
    result = made.daily()
    factor = result["effective_tracking_factor"]
    if axes.directed:
        result |= made.reduce(statistics.mean_and_deviation, factor, _DIRECTION, variables.DIRECTIONS)
    if labels.sizes["date"] > 1:
        result |= made.reduce(statistics.over_dates, factor, "date", variables.ANNUAL)
        result |= made.extremes(factor)
        result |= made.monthly(factor)
        if axes.directed:
            mean = result["annual_effective_tracking_factor_mean"]
            result |= made.reduce(
                statistics.worst_direction, mean, _DIRECTION, variables.WORST, labels[_DIRECTION].rename("direction")
            )
    if study.statistics is not None:
        result |= made.tolerable()
    order = _dims_of(study, axes)
    return xr.Dataset({name: result[name].transpose(*dims) for name, dims in order.items()}).assign_coords(
        labels.coords
    )


class _Evaluation:
    """Hands the kernel and the statistics to dask, over one part of the grid."""

    def __init__(
        self, study: DishTrackingStudy, grid: Grid, axes: Axes, labels: xr.Dataset, chunks: Mapping[str, int]
    ) -> None:
        self._study, self._axes, self._labels, self._chunks = study, axes, labels, chunks
        self._order = _dims_of(study, axes)
        self._sizes = {**grid.sizes, **{str(dim): size for dim, size in labels.sizes.items()}}
        site = site_of(grid)
        zones = np.array(grid.timezones(), dtype=object)
        timezone = xr.DataArray(zones, dims="site") if "site" in grid.sizes else xr.DataArray(zones[0])
        self._place = [site["latitude"], site["longitude"], site["altitude"], timezone]
        errors = ("axis_tilt", _DIRECTION, "home_azimuth_offset", "home_elevation_offset")
        self._mount = [grid.parameter("mount.model"), *(grid.parameter(f"errors.{key}") for key in errors)]
        self._tolerance = grid.parameter("tolerance")

    def daily(self) -> dict[str, xr.DataArray]:
        """Factor and errors of every date, and whether its window is empty."""
        settings: dict[str, Any] = {"time": self._study.time, "ephemeris": self._study.ephemeris}
        days = {"date": self._sizes["date"]}
        result = evaluate(
            partial(blocks.daily, clip=self._study.clip, **settings),
            [*self._place, *self._mount, self._tolerance],
            dims=self._axes.swept,
            core=[()] * 10,
            sizes=self._sizes,
            chunks=self._chunks,
            outputs=variables.DAILY,
            name="daily",
            output_core=days,
            order=self._order,
        )
        return result | evaluate(
            partial(blocks.empty_windows, **settings),
            self._place,
            dims=self._axes.site,
            core=[()] * 4,
            sizes=self._sizes,
            chunks=self._chunks,
            outputs=variables.WINDOW,
            name="windows",
            output_core=days,
            work=False,
            dtype=np.int8,
        )

    def tolerable(self) -> dict[str, xr.DataArray]:
        """The largest tilt for each required factor, solved."""
        dims = tuple(dim for dim in self._axes.swept if dim != _TILT)
        return evaluate(
            partial(blocks.tolerable, time=self._study.time, ephemeris=self._study.ephemeris, clip=self._study.clip),
            [*self._place, self._mount[0], *self._mount[2:], self._tolerance, self._labels["required_factor"]],
            dims=dims,
            core=[()] * 9 + [("required_factor",)],
            sizes=self._sizes,
            chunks=self._chunks,
            outputs=variables.TOLERABLE,
            name="tolerable",
            output_core={"required_factor": self._sizes["required_factor"]},
            order=self._order,
            work=False,
        )

    def reduce(
        self,
        function: Callable[..., np.ndarray],
        values: xr.DataArray,
        dim: str,
        outputs: Mapping[str, Mapping[str, Any]],
        *others: xr.DataArray,
        output_core: Mapping[str, int] | None = None,
        dtype: Any = np.float64,
    ) -> dict[str, xr.DataArray]:
        """Statistic over one dimension of a daily or annual quantity."""
        dims = tuple(str(name) for name in values.dims if name != dim)
        return evaluate(
            function,
            [values, *others],
            dims=dims,
            core=[(dim,)] * (1 + len(others)),
            sizes=self._sizes,
            chunks=self._chunks,
            outputs=outputs,
            name="statistics",
            output_core=output_core,
            order=self._order,
            work=False,
            dtype=dtype,
        )

    def extremes(self, factor: xr.DataArray) -> dict[str, xr.DataArray]:
        """Dates of the extremes."""
        dates = xr.DataArray(self._labels["date"].to_numpy(), dims="date")
        dtype = np.dtype("datetime64[ns]")
        return self.reduce(statistics.dates_of_extremes, factor, "date", variables.EXTREMES, dates, dtype=dtype)

    def monthly(self, factor: xr.DataArray) -> dict[str, xr.DataArray]:
        """Statistics over the dates of each month."""
        months = xr.DataArray(_months(self._study)[1], dims="date")
        core = {"month": self._sizes["month"]}
        return self.reduce(statistics.over_months, factor, "date", variables.MONTHLY, months, output_core=core)
