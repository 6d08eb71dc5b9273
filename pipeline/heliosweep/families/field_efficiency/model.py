"""From a study to its lazy result: which arrays go to the kernels, and what comes back.

Everything is labelled here and nowhere below; one task evaluates all efficiencies of one block.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

import dask
import numpy as np
import xarray as xr

from heliosweep.families.field_efficiency import variables
from heliosweep.families.field_efficiency.config import FieldEfficiencyStudy
from heliosweep.families.layout_axis import LayoutAxis, longest
from heliosweep.families.sun import instants_of, site_of, sun_attributes, sun_vectors
from heliosweep.grid.axes import Grid
from heliosweep.grid.evaluate import Made, evaluate
from heliosweep.grid.instants import instant_count
from heliosweep.grid.plan import Workload
from heliosweep.kernels import field, mounts, packets
from heliosweep.layouts.resolve import Layouts
from heliosweep.reduce.weighted import weighted_mean

#: Time of one heliostat and instant on one core: with the sun in the zenith, more with the number of mirrors that
#: stand in the way, which grows with 1 / sin^2 of its elevation, up to all of them. Measured on radial staggers. [s]
SECONDS_AT_ZENITH, SECONDS_MORE, MOST_TIMES = 35e-9, 35e-9, 70.0
#: Overhead of a parameter point. [s]
SECONDS_PER_POINT = 100e-6
#: Mirrors around a block that may stand in its way, with a low sun; and what is known of each of the field. [1, bytes]
HALO, BYTES_PER_MIRROR = 5000, 200
#: Sites and instants from which the plan estimates the elevation of the sun.
SAMPLED_SITES, SAMPLED_INSTANTS = 9, 500

#: More instants than this are planned for, but not made, before the plan has agreed.
MAX_INSTANTS = 10**7

TRACKING_CODES = {
    "spinning_elevation": mounts.SPINNING_ELEVATION,
    "azimuth_elevation": mounts.AZIMUTH_ELEVATION,
}


def workload(study: FieldEfficiencyStudy) -> Workload:
    """Sizes and cost, for the plan.

    Parameters
    ----------
    study : FieldEfficiencyStudy
        Checked study.

    Returns
    -------
    Workload
    """
    grid = Grid(study)
    heliostats, instants = longest(grid), instant_count(study.time)
    parameters = tuple(grid.sizes)
    stored = dict.fromkeys(variables.ANNUAL, (*parameters, "heliostat"))
    stored |= dict.fromkeys(variables.FIELD, parameters)
    inner = {"heliostat": heliostats}
    if study.output.time_series:
        instants = instants_of(grid).size if instants <= MAX_INSTANTS else instants
        stored |= dict.fromkeys(variables.SERIES, (*parameters, "time", "heliostat"))
        inner = {"time": instants, "heliostat": heliostats}

    places = math.prod(grid.sizes[dim] for dim in grid.site_dims)
    fields = len(Layouts(study))

    def block_bytes(points: int, length: int) -> int:
        # Frames of the block and of the mirrors around it that may stand in the way, and who these are.
        frames = min(heliostats, length + HALO) * packets.PACKET * 10 * 8
        lists = length * 200 * 16 + heliostats * BYTES_PER_MIRROR
        sunlight = (min(points, places) + 3) * instants * 24
        return frames + lists + sunlight + points * length * 4 * 8

    return Workload(
        parameters=grid.sizes,
        inner=inner,
        evaluations=heliostats * instants,
        unit="heliostat-instants",
        seconds=_seconds(study, grid) * (2 if study.output.time_series else 1),
        splittable="heliostat",
        variables=stored,
        block_bytes=block_bytes,
        seconds_per_point=SECONDS_PER_POINT,
        coordinate_bytes=8 * (6 * fields * heliostats + (instants if study.output.time_series else 0)),
        axes={} if study.output.time_series else {"instants": instants},
    )


def _seconds(study: FieldEfficiencyStudy, grid: Grid) -> float:
    """Estimate of the time of one heliostat and instant, from the sun at a few sites and instants. [s]"""
    if instant_count(study.time) > MAX_INSTANTS:
        return SECONDS_AT_ZENITH + SECONDS_MORE
    thin = {dim: slice(None, None, max(1, size // SAMPLED_SITES)) for dim, size in grid.sizes.items()}
    sampled = Grid(study, thin)
    sun = sun_vectors(site_of(sampled), instants_of(sampled).thinned(SAMPLED_INSTANTS), {})
    sine = sun.isel(xyz=2).compute(scheduler=dask.get).to_numpy()  # by name, or without one, dask imports distributed
    sine = sine[sine > 0]
    if not sine.size:
        return SECONDS_AT_ZENITH
    return float(np.mean(SECONDS_AT_ZENITH + SECONDS_MORE * np.minimum(sine**-2.0 - 1.0, MOST_TIMES)))


def build(
    study: FieldEfficiencyStudy, chunks: Mapping[str, int], select: Mapping[str, slice] | None = None
) -> xr.Dataset:
    """Lazy result over a part of the parameter grid.

    Parameters
    ----------
    study : FieldEfficiencyStudy
        Checked study.
    chunks : mapping of str to int
        Block lengths, from the plan.
    select : mapping of str to slice, optional
        Part of the swept dimensions; all of them where left out. With a part of ``time`` or ``heliostat`` too, there
        are the time series of that part and nothing else.

    Returns
    -------
    xarray.Dataset
        The variables of `variables`, not yet computed.
    """
    grid = Grid(study, select)
    layouts = LayoutAxis(grid)
    inner = {dim: span for dim, span in (select or {}).items() if dim in ("time", "heliostat")}
    if inner:
        series = _series(grid, layouts, inner, chunks)
        return series.assign_coords(coordinates(study, select).isel(inner).coords)
    instants = instants_of(grid)
    sunlight = sun_vectors(site_of(grid), instants, chunks)
    arguments = [*_mirrors(grid, layouts), sunlight, layouts.numbers]
    sizes = {**grid.sizes, "heliostat": layouts.size}
    directions = instants.clock == "sun"

    result = xr.Dataset(
        evaluate(
            _annual_block,
            arguments,
            dims=(*grid.sizes, "heliostat"),
            core=[*_MIRROR_CORE, ("time", "xyz"), ()],
            sizes=sizes,
            chunks=chunks,
            outputs=variables.named(variables.ANNUAL, directions=directions),
            name="annual",
        )
    )
    result = result.assign(_field_means(result, _area(grid, layouts), chunks, directions))
    if study.output.time_series:
        result = result.assign(_series(grid, layouts, {}, chunks))
    return result.assign_coords(coordinates(study, select).coords)


def _series(
    grid: Grid,
    layouts: LayoutAxis,
    inner: Mapping[str, slice],
    chunks: Mapping[str, int],
) -> xr.Dataset:
    """Lazy time series over a part of the instants and heliostats, whose graph is as small as the part."""
    instants = instants_of(grid).part(inner.get("time", slice(None)))
    numbers = layouts.numbers.isel(heliostat=inner.get("heliostat", slice(None)))
    made = evaluate(
        _series_block,
        [*_mirrors(grid, layouts), sun_vectors(site_of(grid), instants, chunks), numbers],
        dims=(*grid.sizes, "time", "heliostat"),
        core=[*_MIRROR_CORE, ("xyz",), ()],
        sizes={**grid.sizes, "time": instants.size, "heliostat": numbers.size},
        chunks=chunks,
        outputs=variables.SERIES,
        name="series",
    )
    return xr.Dataset(made)


def coordinates(study: FieldEfficiencyStudy, select: Mapping[str, slice] | None = None) -> xr.Dataset:
    """Coordinates of the result over a part of the parameter grid, all of it where `select` is left out."""
    grid = Grid(study, select)
    labels = {**grid.coordinates(_LABELS), **LayoutAxis(grid).coordinates()}
    if study.output.time_series:
        labels |= instants_of(grid).coordinates()
    return xr.Dataset(coords=labels, attrs=sun_attributes(study.time))


#: Keys that label a result also where they are not swept.
_LABELS = (
    "site.latitude",
    "site.longitude",
    "time.azimuth",
    "time.elevation",
    "tracking",
    "heliostat.width",
    "heliostat.height",
    "heliostat.pivot_height",
    "receiver.height",
)


def _field_means(
    annual: xr.Dataset, area: xr.DataArray, chunks: Mapping[str, int], directions: bool
) -> dict[str, xr.DataArray]:
    """Means over the heliostats, weighted by mirror area, and the product of three of them."""
    described = variables.named(variables.FIELD, directions=directions)
    means = {
        field_name: weighted_mean(annual[name], area, "heliostat", chunks, described[field_name])
        for field_name, name in variables.FIELD_MEANS.items()
    }
    cosine, shading, blocking = (means[f"field_{name}_efficiency"] for name in ("cosine", "shading", "blocking"))
    name = "field_efficiency_factored"
    return {**means, name: (cosine * shading * blocking).assign_attrs(described[name])}


#: Per input of the kernel faces, the dimensions that a block holds whole: see `_mirrors`.
_MIRROR_CORE = [("mirror",)] * 5 + [()] * 3


def _mirrors(grid: Grid, layouts: LayoutAxis) -> list[xr.DataArray | Made]:
    """What the kernels are told of the field, over any sweep."""
    names = grid.parameter("tracking")
    codes = np.array([TRACKING_CODES[str(name)] for name in names.to_numpy().flat], dtype=np.int64)
    return [
        *(array.rename(heliostat="mirror") for array in layouts.inputs),
        layouts.mirror_size(grid, "width").rename(heliostat="mirror"),
        layouts.mirror_size(grid, "height").rename(heliostat="mirror"),
        grid.parameter("heliostat.pivot_height"),
        grid.parameter("receiver.height"),
        xr.DataArray(codes.reshape(names.shape), dims=names.dims),
    ]


def _area(grid: Grid, layouts: LayoutAxis) -> xr.DataArray:
    """Mirror areas over (swept sizes or layouts, heliostat); zero where a shorter layout is padded. [m2]."""
    area = layouts.mirror_size(grid, "width") * layouts.mirror_size(grid, "height")
    return area.where(layouts.x.notnull(), 0.0)


def _annual_block(*arguments: np.ndarray) -> np.ndarray:
    """Means over the instants for a block of (parameters, heliostats); NaN where the sun is never up."""

    def means(mirrors: _Mirrors, sun: np.ndarray, start: int, stop: int) -> np.ndarray:
        sums, instants = field.field_sums(*mirrors, sun, start, stop)
        return (sums / instants if instants else np.full_like(sums, np.nan)).T

    return _each_point(means, arguments, inner=1)


def _series_block(*arguments: np.ndarray) -> np.ndarray:
    """Instantaneous efficiencies for a block of (parameters, time, heliostats); NaN where the sun is down."""

    def instantaneous(mirrors: _Mirrors, sun: np.ndarray, start: int, stop: int) -> np.ndarray:
        return field.field_series(*mirrors, sun, start, stop)

    return _each_point(instantaneous, arguments, inner=2)


#: x, y, z, half width, half height of all mirrors, height of the receiver, tracking code: as `field.field_sums` takes.
_Mirrors: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, float, int]


def _each_point(
    face: Callable[[_Mirrors, np.ndarray, int, int], np.ndarray], arguments: Sequence[np.ndarray], inner: int
) -> np.ndarray:
    """Call a kernel for each parameter point of a block and stack what it returns.

    Parameters
    ----------
    face : callable
        (mirrors, sun, start, stop) -> array of shape (4, ..., stop - start).
    arguments : sequence of ndarray
        Blocks of the arrays of `_mirrors`, of the sun and of the heliostats' numbers, over the swept dimensions,
        `inner` more (length 1 where they do not vary) and their core dimensions.
    inner : int
        Dimensions of the result besides the swept ones: heliostat, or time and heliostat.

    Returns
    -------
    ndarray, shape (4, *swept dimensions, ..., heliostat)
        NaN where a shorter layout is padded.
    """
    swept = arguments[-1].ndim - inner
    shape = np.broadcast_shapes(*(argument.shape[:swept] for argument in arguments))
    numbers = arguments[-1].ravel()
    instants = arguments[-2].shape[swept : swept + inner - 1]
    result = np.full((len(variables.ANNUAL), *shape, *instants, numbers.size), np.nan)
    for index in np.ndindex(shape):
        x, y, z, width, height, pivot_height, target, tracking, sun = (
            argument[tuple(min(i, size - 1) for i, size in zip(index, argument.shape, strict=False))]
            for argument in arguments[:-1]
        )
        count = int(np.count_nonzero(np.isfinite(x)))
        used = slice(0, count)
        mirrors: _Mirrors = (
            x.ravel()[used],
            y.ravel()[used],
            z.ravel()[used] + pivot_height.item(),
            width.ravel()[used] / 2,
            height.ravel()[used] / 2,
            target.item(),
            tracking.item(),
        )
        start, stop = int(numbers[0]), min(int(numbers[-1]) + 1, count)
        if start < stop:
            result[(slice(None), *index)][..., : stop - start] = face(mirrors, sun.reshape(-1, 3), start, stop)
    return result
