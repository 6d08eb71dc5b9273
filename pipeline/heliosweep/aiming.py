"""Aim points under a limit of the flux on the receiver, with a bound of the best possible power."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels import aims as kernel
from heliosweep.kernels import rays as tracer
from heliosweep.kernels.compiled import Floats, Integers
from heliosweep.light import (
    Cylinder,
    Rectangle,
    cell_area,
    field_scene,
    heliostat_coordinates,
    mirror_area,
    sun_directions,
)

if TYPE_CHECKING:
    import xarray as xr
    from scipy.sparse import csr_matrix

#: Smoothing of the dual function, in mean powers of a heliostat, from the first to the last steps.
_SMOOTHING = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
#: Steps of the minimisation at each smoothing, and relative tolerance of the dual function over the smoothing.
_STEPS, _TOLERANCE = 150, 1e-5
#: Maximum number of stored fluxes for prices by linear programming, of aims for an exact choice, and for exchanges.
_PROGRAM, _EXACT, _PAIRS = 200_000, 100, 2000
#: Rounds of the independent check of the flux, its rays over the rays of an image, and its accepted excess.
_CHECKS, _CHECK_RAYS, _CHECK_EXCESS = 6, 16, 0.005
#: Part of the overload that one round of repairs takes away, at least.
_RELIEF = 0.25
#: Parts of a field that are summed separately, and the minimum number of heliostats of a part.
_PARTS, _FEWEST = 8, 32
#: Distance from the surface of the receiver up to which an aim point counts as on the receiver. [m]
SLACK = 0.01


class Aims(NamedTuple):
    """Aims of heliostats, their power, and a bound that no choice exceeds."""

    #: Number of the aim of each heliostat, -1 for a stowed one.
    choice: Integers
    power: float
    bound: float
    #: Flux in each cell.
    load: Floats
    #: Power that a unit of the limit of each cell is worth.
    price: Floats


def choose_aims(
    power: Floats, flux: csr_matrix, limit: Floats, *, gap: float = 2e-3, threads: int | None = None
) -> Aims:
    """Choose an aim for each heliostat, or stow it, for the maximum power under limits of the flux.

    Maximises the sum of the powers P_ia of the choices, subject to sum F_iac <= L_c for each cell c.

    Parameters
    ----------
    power : ndarray, shape (A, N)
        Power of each heliostat with each aim. [any unit]
    flux : csr_matrix, shape (A * N, C)
        Flux of the heliostats with the first aim in each cell, then with the second aim, and so on. [any unit]
    limit : ndarray, shape (C,)
        Limit of each cell, above 0. [unit of the flux]
    gap : float
        The search ends if the bound exceeds the power by at most this part of the bound.
    threads : int, optional
        Number of threads; all cores without. Results do not depend on it.

    Returns
    -------
    Aims
        Choice, its power and flux, bound and prices.

    Raises
    ------
    ValueError
        If shapes do not fit, a limit is not above 0, or a heliostat alone exceeds the limit with each of its aims. The
        message names the heliostat and the cell.

    Notes
    -----
    For prices lambda_c >= 0 the dual function

        D(lambda) = sum_i max(0, max_a (P_ia - sum_c lambda_c F_iac)) + sum_c lambda_c L_c

    is at least the optimum (Lagrangian relaxation; A. M. Geoffrion, "Lagrangean relaxation for integer programming",
    Mathematical Programming Study 2 (1974) 82-114). L-BFGS-B minimises it, smoothed less and less. At each smoothing
    the shares of the aims are rounded, heliostats leave overloaded cells at the minimum loss per relieved flux, and
    single heliostats move to better aims whose cells have room. In small problems pairs of heliostats
    move, too. For small problems HiGHS computes the prices of the
    linear program, whose value is the minimum of D, and for a few aims the best choice by branch and bound.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.sparse import csr_matrix
    >>> from heliosweep import choose_aims
    >>> flux = csr_matrix([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])  # two aims, two heliostats, two cells
    >>> found = choose_aims(np.array([[1.0, 1.0], [0.9, 0.8]]), flux, np.array([1.0, 1.0]))
    >>> found.choice.tolist(), found.power
    ([1, 0], 1.9)
    """
    from scipy.optimize import minimize

    power, limit = np.array(power, np.float64, order="C"), np.array(limit, np.float64)
    if power.ndim != 2 or flux.shape != (power.size, limit.size):
        shapes = f"{power.shape}, {flux.shape} and {limit.shape}"
        raise ValueError(f"`power`, `flux` and `limit` must have the shapes (A, N), (A * N, C) and (C,) (got {shapes})")
    if not (limit > 0.0).all():
        raise ValueError(f"`limit` must be above 0 in each cell (got {np.min(limit):g})")
    if (problem := overload(flux, limit, power.shape[1])) is not None:
        raise ValueError("`limit`: heliostat {} alone has the flux {:g} in cell {}: increase it".format(*problem))
    count, images = power.shape[1], (flux.indptr, flux.indices.view(np.uint32), flux.data)
    mean = max(float(power.max(axis=0).mean()), 1e-300)
    unit, parts = mean / limit, np.linspace(0, count, max(1, min(_PARTS, count // _FEWEST)) + 1).astype(int)
    share, loads = np.empty(power.shape), np.empty((len(parts) - 1, limit.size))
    scaled, bound, price = np.zeros(limit.size), np.inf, np.zeros(limit.size)
    best, best_power = np.full(count, -1), 0.0
    small = flux.nnz <= _PROGRAM
    with ThreadPoolExecutor(threads or len(os.sched_getaffinity(0))) as pool:

        def smooth(scaled: Floats, width: float) -> tuple[float, Floats]:
            def run(part: int) -> float:
                given = (parts[part], parts[part + 1], power, images, scaled * unit, width, loads[part], share)
                total: float = kernel.smooth_dual(*given)
                return total

            loads[:] = 0.0
            total = sum(pool.map(run, range(len(loads))))
            return total / mean + scaled.sum(), 1.0 - loads.sum(axis=0) / limit

        def complete(choice: Integers) -> None:
            nonlocal best, best_power
            load = _load(flux, choice)
            kernel.relieve(power, images, limit, load, choice, _RELIEF)
            kernel.improve(power, images, limit, load, choice)
            if small and power.size <= _PAIRS:
                kernel.exchange(power, images, limit, load, choice)
                kernel.improve(power, images, limit, load, choice)
            on = np.flatnonzero(choice >= 0)
            if (total := float(power[choice[on], on].sum())) > best_power:
                best, best_power = choice, total

        def lower(scaled: Floats) -> Floats:
            nonlocal bound, price
            net = kernel.net_powers(power, images, scaled * unit)
            value = float(np.maximum(net.max(axis=0), 0.0).sum() + mean * scaled.sum())
            if value < bound:
                bound, price = value, scaled * unit
            return net

        if small:
            lower(_program(power, flux, limit, mean, False)[1])
        for smoothing in _SMOOTHING:
            width = smoothing * mean
            options = {"maxiter": _STEPS, "maxcor": 20, "ftol": smoothing * _TOLERANCE, "gtol": 1e-8}
            bounds = [(0.0, None)] * limit.size
            scaled = minimize(smooth, scaled, (width,), "L-BFGS-B", True, bounds=bounds, options=options).x
            net = lower(scaled)
            smooth(scaled, width)
            choice, load = np.empty(count, np.int64), loads.sum(axis=0)
            order = np.argsort(-share.max(axis=0), kind="stable")
            kernel.round_shares(order, net / mean, images, limit, share, load, choice)
            complete(choice)
            if best_power >= (1.0 - gap) * bound:
                break
    if small and power.size <= _EXACT and best_power < (1.0 - gap) * bound:
        shares, _, value = _program(power, flux, limit, mean, True)
        complete(np.where(shares.max(axis=0) > 0.5, shares.argmax(axis=0), -1))
        bound = min(bound, value)
    return Aims(best, best_power, max(bound, best_power), _load(flux, best), price)


def _program(power: Floats, flux: csr_matrix, limit: Floats, mean: float, whole: bool) -> tuple[Floats, Floats, float]:
    """Return shares of the aims, shape (A, N), scaled prices and a bound by HiGHS; shares of 0 and 1 if `whole`."""
    from scipy.optimize import LinearConstraint, linprog, milp
    from scipy.sparse import diags, identity, kron, vstack

    aims, count = power.shape
    rows = diags(1.0 / limit) @ flux.astype(np.float64).T
    most, one = vstack((rows, kron(np.ones((1, aims)), identity(count)))).tocsr(), np.ones(limit.size + count)
    if whole:
        found = milp(-power.ravel() / mean, integrality=1, bounds=(0, 1), constraints=LinearConstraint(most, ub=one),
                     options={"mip_rel_gap": 1e-9})  # fmt: skip
        return found.x.reshape(power.shape), np.zeros(limit.size), -mean * float(found.mip_dual_bound)
    found = linprog(-power.ravel() / mean, most, one, method="highs")
    return found.x.reshape(power.shape), np.maximum(-found.ineqlin.marginals[: limit.size], 0.0), -mean * found.fun


def overload(flux: csr_matrix, limit: Floats, count: int) -> tuple[int, float, int] | None:
    """Return the first heliostat that exceeds a limit with each aim, from 1, its flux and the cell; None without one.

    Parameters
    ----------
    flux, limit
        As of `choose_aims`.
    count : int
        Number of heliostats.
    """
    parts = kernel.brightest(flux.indptr, flux.indices.view(np.uint32), flux.data, limit).reshape(-1, count)
    over = np.flatnonzero(parts.min(axis=0) > 1.0)
    if not over.size:
        return None
    image = flux[int(parts[:, over[0]].argmin()) * count + int(over[0])].toarray()[0]
    cell = int((image / limit).argmax())
    return int(over[0]) + 1, float(image[cell]), cell


def aim_grid(receiver: tracer.Receiver, centre: Floats, rows: int, columns: int, azimuth_span: float) -> Floats:
    """Return aim points in rows and columns on the receiver, shape (rows * columns, N, 3). [m]

    They are the middles of equal cells, rows from the bottom up: of a rectangle, or of the strip of a cylinder that
    extends over `azimuth_span` [rad] around the point nearest to each heliostat, at `centre`, shape (N, 3) [m].
    """
    up, along = (((np.arange(count) + 0.5) / count - 0.5) for count in (rows, columns))
    height = np.multiply.outer(2.0 * receiver.half_height * np.repeat(up, columns), receiver.upward)[:, np.newaxis]
    if receiver.kind == tracer.CYLINDER:
        azimuth = np.arctan2(centre[:, 0], centre[:, 1]) + azimuth_span * np.tile(along, rows)[:, np.newaxis]
        across = receiver.half_width * np.stack((np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)), axis=2)
    else:
        width = 2.0 * receiver.half_width * np.tile(along, rows)
        across = np.multiply.outer(width, receiver.across)[:, np.newaxis]
    return np.broadcast_to(receiver.centre + height + across, (rows * columns, len(centre), 3))


def off_receiver(receiver: tracer.Receiver, centre: Floats, points: Floats) -> Floats:
    """Return the distance of points from the receiver's surface, shape (..., N); inf if the heliostat is behind. [m]"""
    off, back, upward = points - receiver.centre, centre - points, np.array(receiver.upward)
    beyond = np.abs(off @ upward) - receiver.half_height
    if receiver.kind == tracer.CYLINDER:
        apart = np.abs(np.hypot(off[..., 0], off[..., 1]) - receiver.half_width)
        seen = np.sum(off[..., :2] * back[..., :2], axis=-1) > 0
    else:
        face = np.cross(receiver.across, upward)
        apart, seen = np.abs(off @ face), back @ face > 0
        beyond = np.maximum(beyond, np.abs(off @ np.array(receiver.across)) - receiver.half_width)
    away = np.maximum(apart, beyond)
    return np.where(seen | (away > SLACK), away, np.inf)


def image_bytes(receiver: tracer.Receiver, heliostats: int, aims: int, cells: tuple[int, int], rays: int) -> int:
    """Return the maximum size of the images of heliostats, of which a cylinder has light on one half. [bytes]"""
    lit = cells[0] * (cells[1] // 2 + 2 if receiver.kind == tracer.CYLINDER else cells[1])
    return 2 * 8 * min(lit, rays) * heliostats * aims


def aim_images(
    scene: tracer.Scene, sun: Floats, points: Floats, *, cells: tuple[int, int], share: Floats, rays: int = 1024,
    seed: int = 0, threads: int = 1, cuda: bool = False,
) -> csr_matrix:  # fmt: skip
    """Return the flux of each heliostat with each aim, shape (A * N, cells), by one trace of the field for each aim.

    Parameters
    ----------
    scene : Scene
        Field whose heliostats aim anywhere.
    sun : ndarray, shape (1, 3)
        Unit vector to the sun. [1]
    points : ndarray, shape (A, N, 3)
        Aim points. [m]
    cells : (int, int)
        Rows and columns of cells on the receiver.
    share : ndarray, shape (N,)
        Power of the light of each mirror, normal to the sun, that is not lost in mirror and air. [kW]
    rays, seed, threads, cuda
        As of `kernels.rays.trace`.
    """
    from scipy.sparse import csr_matrix

    given: dict[str, Any] = {"cells": cells, "share": share, "rays": rays, "seed": seed, "images": True}
    traces = (
        tracer.trace(scene._replace(target=aim), sun, threads=threads, cuda=cuda, **given).images for aim in points
    )
    counts, names, light = map(np.concatenate, zip(*traces, strict=True))
    light /= np.float32(cell_area(scene.receiver, cells))
    first = np.concatenate(([0], counts)).cumsum()
    return csr_matrix((light, names, first), shape=(len(counts), cells[0] * cells[1]))


def image_powers(flux: csr_matrix, receiver: tracer.Receiver, cells: tuple[int, int], aims: int) -> Floats:
    """Return the power of images on the receiver, shape (A, N). [kW]"""
    area = cell_area(receiver, cells)
    return area * (flux @ np.ones(flux.shape[1], np.float32)).reshape(aims, -1).astype(np.float64)


def unlimited(power: Floats, flux: csr_matrix) -> tuple[float, Floats]:
    """Return power and flux if each heliostat takes the aim with its maximum power."""
    return float(power.max(axis=0).sum()), _load(flux, power.argmax(axis=0))


def _load(flux: csr_matrix, choice: Integers) -> Floats:
    """Return the flux of a choice in each cell."""
    on = np.flatnonzero(choice >= 0)
    rows = flux[choice[on] * len(choice) + on]
    return np.bincount(rows.indices, rows.data, flux.shape[1]).astype(np.float64)


def _checked_aims(
    scene: tracer.Scene, sun: Floats, points: Floats, flux: csr_matrix, power: Floats, limit: Floats, share: Floats,
    cells: tuple[int, int], rays: int, seed: int, gap: float, threads: int,
) -> tuple[Aims, Floats, float]:  # fmt: skip
    """Choose aims whose flux by an independent trace keeps the limits; return them, this flux, and the bound.

    A choice suits the noise of its images. Each round lowers the limits of cells by their excess in the trace, and all
    limits by the square root of the maximum excess.
    """
    heliostats, reduced, bound, least = np.arange(len(scene.centre)), limit.copy(), np.inf, np.inf
    kept: list[tuple[Aims, Floats]] = []
    for _ in range(_CHECKS):
        found = choose_aims(power, flux, reduced, gap=gap, threads=threads)
        bound = min(bound, found.bound) if not kept else bound
        aimed = scene._replace(target=np.ascontiguousarray(points[np.maximum(found.choice, 0), heliostats]))
        light = tracer.trace(
            aimed, sun, cells=cells, share=np.where(found.choice < 0, 0.0, share), rays=_CHECK_RAYS * rays,
            seed=seed, threads=threads,
        )  # fmt: skip
        checked = light.flux.mean(axis=0).ravel() * (light.unit / cell_area(scene.receiver, cells))
        excess = float((checked / limit).max())
        if excess < least:
            output = float(checked.sum()) * cell_area(scene.receiver, cells)
            least, kept = excess, [(found._replace(power=output), checked)]
        lowered = reduced / np.maximum(checked / limit, 1.0) / np.sqrt(max(excess, 1.0))
        if excess <= 1.0 + _CHECK_EXCESS or overload(flux, lowered, len(heliostats)) is not None:
            break
        reduced = lowered
    return *kept[0], bound


def flux_limited_aims(
    layout: Any, receiver: Cylinder | Rectangle, sun_azimuth: float = 180.0, sun_elevation: float = 45.0,
    limit: ArrayLike = 1000.0, *, rows: int = 7, columns: int = 3, azimuth_span: float = 40.0,
    aims: ArrayLike | None = None, flux_map: tuple[int, int] = (20, 36), dni: float = 1000.0,
    reflectivity: ArrayLike = 1.0, transmittance: ArrayLike = 1.0, rays: int = 1024, seed: int = 0, gap: float = 2e-3,
    memory: float = 4e9, threads: int | None = None, **field: Any,
) -> xr.Dataset:  # fmt: skip
    """Aim each heliostat for the maximum power on the receiver under a limit of the flux, or stow it.

    One trace of the field for each aim gives the image of each heliostat. `choose_aims` selects the aims.

    Parameters
    ----------
    layout, receiver, **field
        As of `field_scene`.
    sun_azimuth, sun_elevation : float
        Direction to the sun, above the horizon. [deg]
    limit : float or array, shape (rows of cells,) or (rows of cells, columns of cells)
        Maximum flux of each cell; rows from the bottom up. [kW m-2]
    rows, columns : int
        Rows and columns of aim points: the middles of equal cells of the receiver.
    azimuth_span : float
        Range of the columns on a cylinder, around the point nearest to the heliostat. [deg]
    aims : array, shape (A, 3) or (A, N, 3), optional
        Aim points in place of rows and columns. [m]
    flux_map : (int, int)
        Rows and columns of the cells of the flux.
    dni : float
        Direct normal irradiance. [W m-2]
    reflectivity, transmittance : float or array, shape (N,)
        Parts of the light that mirrors reflect and air transmits. [1]
    rays : int
        Rays of each image.
    seed : int
        Seed of the rays of images. The flux of the chosen aims is traced with the next seed and 16 times the rays.
        Cells that exceed the limit there by over 0.5 % get a lower limit, and the aims are chosen again.
    gap : float
        As of `choose_aims`.
    memory : float
        Maximum size of the images. [bytes]
    threads : int, optional
        Number of threads; all cores without.

    Returns
    -------
    xarray.Dataset
        With the dimension heliostat: `aim`, the number of the aim, -1 if stowed, and `aim_x`, `aim_y`, `aim_z` [m],
        NaN if stowed. Maps by cell: `flux_map` and `flux_map_unlimited` [kW m-2], and `price`, the
        power that a unit of the limit is worth [kW / (kW m-2)]. `power`, `power_unlimited`, `bound` [MW]; `peak_flux`,
        `peak_flux_unlimited` [kW m-2]; `loss`, part of the power without limit; `gap`, part of the bound; `stowed`, the
        number of stowed heliostats.

    Raises
    ------
    ValueError
        If an aim is off the receiver, a limit is below the flux of one heliostat, or the images exceed `memory`. The
        message names the heliostat and the cell.

    Examples
    --------
    >>> import heliosweep
    >>> field = [(0.0, 60.0, 4.0), (10.0, 60.0, 4.0), (0.0, 70.0, 4.0)]
    >>> receiver = heliosweep.Cylinder(height=50.0, radius=3.0, height_extent=8.0)
    >>> found = heliosweep.flux_limited_aims(field, receiver, 180.0, 50.0, 30.0, width=6.0, height=5.0, slope_error=2.0)
    >>> bool(found.peak_flux <= 30.0), bool(found.power <= found.bound)
    (True, True)
    """
    import xarray as xr

    scene = field_scene(layout, receiver, **field)
    count, centre = len(scene.centre), scene.centre
    points = aim_grid(scene.receiver, centre, rows, columns, np.radians(azimuth_span))
    if aims is not None:
        given = np.array(aims, np.float64)
        points = np.broadcast_to(given if given.ndim == 3 else given[:, np.newaxis], (len(given), count, 3))
    if (wrong := np.argwhere(off_receiver(scene.receiver, centre, points) > SLACK)).size:
        aim, row = wrong[0]
        words = f"aim {aim} of heliostat {row + 1} is off the receiver or on a side that the heliostat does not see"
        raise ValueError(f"`aims`: {words}; move it, or reduce `azimuth_span`")
    if (size := image_bytes(scene.receiver, count, len(points), flux_map, rays)) > memory:
        words = f"images of {count:,} heliostats with {len(points)} aims need up to {size / 1e9:.2g} GB"
        raise ValueError(f"`memory`: {words}; reduce the aims or the cells of `flux_map`, or increase `memory`")
    sun = sun_directions(sun_azimuth, sun_elevation)[0]
    threads = threads or len(os.sched_getaffinity(0))
    share = mirror_area(scene) * np.asarray(reflectivity) * np.asarray(transmittance) * 1e-3 * dni
    flux = aim_images(scene, sun, points, cells=flux_map, share=share, rays=rays, seed=seed, threads=threads)
    power = image_powers(flux, scene.receiver, flux_map, len(points))
    most = np.asarray(limit, np.float64)
    most = np.broadcast_to(most[:, np.newaxis] if most.ndim == 1 else most, flux_map)
    if most.min() > 0.0 and (problem := overload(flux, most.ravel(), count)) is not None:
        heliostat, value, cell = problem
        words = f"heliostat {heliostat} alone has {value:.4g} kW/m2 in row {cell // flux_map[1]}, column "
        raise ValueError(f"`limit`: {words}{cell % flux_map[1]}, above the limit with each of its aims; increase it")
    found, checked, bound = _checked_aims(
        scene, sun, points, flux, power, most.ravel(), share, flux_map, rays, seed + 1, gap, threads
    )
    whole, free = unlimited(power, flux)
    place = np.where(found.choice[:, np.newaxis] < 0, np.nan, points[found.choice, np.arange(count)])
    cells, maps = ("flux_row", "flux_column"), {
        "flux_map": (checked, "kW m-2", "flux on the receiver"),
        "flux_map_unlimited": (free, "kW m-2", "flux on the receiver without a limit"),
        "price": (found.price, "m2", "power that a unit of the limit of the flux is worth"),
    }  # fmt: skip
    numbers = {
        "power": (1e-3 * found.power, "MW", "power on the receiver"),
        "power_unlimited": (1e-3 * whole, "MW", "power on the receiver without a limit"),
        "bound": (1e-3 * bound, "MW", "bound of the power of all choices of aims"),
        "peak_flux": (checked.max(), "kW m-2", "maximum flux of a cell"),
        "peak_flux_unlimited": (free.max(), "kW m-2", "maximum flux of a cell without a limit"),
        "loss": (1.0 - found.power / (whole or np.nan), "1", "part of the power without a limit that is lost"),
        "gap": (1.0 - found.power / (bound or np.nan), "1", "maximum distance from the best choice"),
        "stowed": (float((found.choice < 0).sum()), "1", "number of stowed heliostats"),
    }
    points_of = {f"aim_{axis}": ("heliostat", place[:, k], {"units": "m", "long_name": f"{words} of the aim point"})
                 for k, (axis, words) in enumerate((("x", "east"), ("y", "north"), ("z", "height")))}  # fmt: skip
    return xr.Dataset(
        {"aim": ("heliostat", found.choice, {"units": "1", "long_name": "number of the aim, -1 if stowed"}),
         **points_of,
         **{name: (cells, values.reshape(flux_map), {"units": units, "long_name": words})
            for name, (values, units, words) in maps.items()},
         **{name: ((), value, {"units": units, "long_name": words})
            for name, (value, units, words) in numbers.items()}},
        heliostat_coordinates(layout, centre), {"rays": tracer.block_rays(rays), "seed": seed},
    )  # fmt: skip
