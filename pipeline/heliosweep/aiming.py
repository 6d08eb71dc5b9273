"""Aim points for maximum power under a flux limit on the receiver, and an upper bound on this power."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.files import processors
from heliosweep.kernels import aims as kernel
from heliosweep.kernels import rays as tracer
from heliosweep.kernels.compiled import Floats, Integers
from heliosweep.lazy import xr
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
    from scipy.sparse import csr_matrix

#: Default number of rays per image, and default relative gap between the power and its upper bound.
RAYS, GAP = 1024, 2e-3
#: Maximum distance of an aim point from the receiver surface. [m]
SLACK = 0.01
#: Dimensions, unit and description of each result variable.
VARIABLES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "aim": (("heliostat",), "1", "index of the aim point, or -1 if stowed"),
    **{f"aim_{axis}": (("heliostat",), "m", f"{words} of the aim point")
       for axis, words in (("x", "east"), ("y", "north"), ("z", "height"))},
    "aimed_flux_map": (("flux_row", "flux_column"), "kW m-2", "flux with the chosen aim points"),
    "unlimited_flux_map": (("flux_row", "flux_column"), "kW m-2", "flux with the best aim points without a flux limit"),
    "flux_price": (("flux_row", "flux_column"), "m2", "power gained per unit increase of the flux limit in a cell"),
    "aimed_power": ((), "MW", "power on the receiver with the chosen aim points"),
    "unlimited_power": ((), "MW", "power on the receiver with the best aim points without a flux limit"),
    "power_bound": ((), "MW", "upper bound on the power over all choices of aim points within the limit"),
    "aimed_peak_flux": ((), "kW m-2", "maximum flux in a cell"),
    "unlimited_peak_flux": ((), "kW m-2", "maximum flux in a cell without a flux limit"),
    "limit_loss": ((), "1", "fraction of the unlimited power lost due to the flux limit"),
    "aim_gap": ((), "1", "maximum power that other aim points could gain, as a fraction of the bound"),
    "stowed_heliostats": ((), "1", "number of stowed heliostats"),
}  # fmt: skip


class Aims(NamedTuple):
    """Aim points of all heliostats, the resulting power, and an upper bound on the power."""

    #: Index of the aim point of each heliostat, or -1 if the heliostat is stowed.
    choice: Integers
    power: float
    bound: float
    #: Flux in each cell.
    load: Floats
    #: Power gained per unit increase of the flux limit in each cell.
    price: Floats


def choose_aims(
    power: Floats, flux: csr_matrix, limit: Floats, *, gap: float = GAP, threads: int | None = None
) -> Aims:
    """Choose aim points that maximise the power of a field under flux limits.

    Each heliostat i is assigned an aim point a or is stowed. The sum of the powers P_ia is maximised, subject to the
    condition that the flux in each cell c, sum F_iac, is at most L_c.

    Parameters
    ----------
    power : ndarray, shape (A, N)
        Power from each heliostat for each aim point. [any unit]
    flux : csr_matrix, shape (A * N, C)
        Flux in each cell. Row a * N + i contains the flux from heliostat i for aim point a. [any unit]
    limit : ndarray, shape (C,)
        Maximum flux in each cell, above 0. [unit of the flux]
    gap : float
        Difference between the bound and the power, as a fraction of the bound, at which the search stops. The search
        also stops when the bound hardly decreases.
    threads : int, optional
        Number of threads (default: all cores). The results do not depend on this number.

    Returns
    -------
    Aims
        Chosen aim points, the resulting power and flux, an upper bound on the power, and the prices of the limits.

    Raises
    ------
    ValueError
        If the shapes do not match, a limit is not above 0, or a single heliostat exceeds a limit with each of its aim
        points. The message names the heliostat and the cell.

    Notes
    -----
    For prices lambda_c >= 0, the dual function

        D(lambda) = sum_i max(0, max_a (P_ia - sum_c lambda_c F_iac)) + sum_c lambda_c L_c

    is an upper bound on the optimum (Lagrangian relaxation; A. M. Geoffrion, "Lagrangean relaxation for integer
    programming", Mathematical Programming Study 2 (1974) 82-114). L-BFGS-B minimises D in rounds with decreasing
    smoothing. At the end of each round, each heliostat in turn is assigned the aim point that maximises its power minus
    a penalty for overloaded cells. The penalty increases until no cell exceeds its limit. Heliostats then move to
    better aim points within the limits. For small problems, HiGHS finds the best choice by branch and bound.

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
        raise ValueError(
            "`limit`: heliostat {} alone exceeds the limit: flux {:g} in cell {}; increase the limit".format(*problem)
        )
    count, images, mean = power.shape[1], _images(flux), max(float(power.max(axis=0).mean()), 1e-300)
    # The heliostats are summed in up to 8 groups of at least 32.
    unit, parts = mean / limit, np.linspace(0, count, max(1, min(8, count // 32)) + 1).astype(int)
    share, loads = np.empty(power.shape), np.empty((len(parts) - 1, limit.size))
    scaled = price = np.zeros(limit.size)
    best, best_power, bound = np.full(count, -1), 0.0, np.inf

    def smooth(scaled: Floats, width: float) -> tuple[float, Floats]:
        loads[:] = 0.0
        total = sum(pool.map(
            lambda k: kernel.smooth_dual(*parts[k : k + 2], power, images, scaled * unit, width, loads[k], share),
            range(len(loads)),
        ))  # fmt: skip
        return total / mean + scaled.sum(), 1.0 - loads.sum(axis=0) / limit

    with ThreadPoolExecutor(threads or processors()) as pool:
        for smoothing in (3e-3, 3e-4, 3e-5, 3e-6, 3e-7):  # smoothing relative to the mean power of a heliostat
            tolerance = 0.5 * smoothing * gap  # of the dual function
            options = {"maxiter": 1000, "maxcor": 20, "ftol": tolerance, "gtol": 1e-8}
            bounds, last = [(0.0, None)] * limit.size, bound
            scaled = minimize(smooth, scaled, (smoothing * mean,), "L-BFGS-B", True, bounds=bounds, options=options).x
            net = kernel.net_powers(power, images, scaled * unit)
            if (value := float(np.maximum(net.max(axis=0), 0.0).sum() + mean * scaled.sum())) < bound:
                bound, price = value, scaled * unit
            smooth(scaled, smoothing * mean)
            penalty = 2.0 * mean  # per unit of overload
            choice = _rounded(power, net, images, limit, share, loads.sum(axis=0), penalty)
            if (total := _total(power, choice)) > best_power:
                best, best_power = choice, total
            if best_power >= (1.0 - gap) * bound or last - bound < 0.2 * gap * bound:  # the bound hardly decreases
                break
    if power.size <= 200 and best_power < (1.0 - gap) * bound:  # small enough for branch and bound
        choice, value = _exact(power / mean, flux, limit)
        bound = min(bound, value * mean)
        if (total := _total(power, choice)) > best_power:
            best, best_power = choice, total
    return Aims(best, best_power, max(bound, best_power), _load(flux, best), price)


def _images(flux: csr_matrix) -> tuple[Any, ...]:
    return flux.indptr, flux.indices.view(np.uint32), flux.data


def _total(power: Floats, choice: Integers) -> float:
    on = np.flatnonzero(choice >= 0)
    return float(power[choice[on], on].sum())


def _rounded(
    power: Floats, net: Floats, images: tuple[Any, ...], limit: Floats, share: Floats, load: Floats, penalty: float
) -> Integers:
    """Choose aim points within the limits from their shares, flux and net powers."""
    choice = np.full(power.shape[1], -1)
    order = np.argsort(-share.max(axis=0), kind="stable")
    kernel.choose(order, net, images, limit, penalty, share, load, choice)
    while (load > limit * (1.0 + 2.0 * kernel.EXCESS)).any():
        penalty *= 1.5  # until all limits are met
        kernel.choose(order, power, images, limit, penalty, share, load, choice)
    while kernel.choose(order, power, images, limit, np.inf, share, load, choice):
        order = np.argsort((share * power).sum(axis=0) - power.max(axis=0), kind="stable")
    return choice


def _exact(power: Floats, flux: csr_matrix, limit: Floats) -> tuple[Integers, float]:
    """Return the best choice and the upper bound that HiGHS finds in at most 100 branch-and-bound nodes."""
    from scipy.optimize import LinearConstraint, milp
    from scipy.sparse import diags, identity, kron, vstack

    aims, count = power.shape
    rows = vstack((diags(1.0 / limit) @ flux.astype(np.float64).T, kron(np.ones((1, aims)), identity(count))))
    found = milp(-power.ravel(), integrality=1, bounds=(0, 1), constraints=LinearConstraint(rows.tocsr(), ub=1.0),
                 options={"mip_rel_gap": 1e-9, "node_limit": 100})  # fmt: skip
    shares = np.zeros(power.shape) if found.x is None else found.x.reshape(power.shape)
    return np.where(shares.max(axis=0) > 0.5, shares.argmax(axis=0), -1), -float(found.mip_dual_bound)


def overload(flux: csr_matrix, limit: Floats, count: int) -> tuple[int, float, int] | None:
    """Return the index, flux and cell of a heliostat that exceeds a limit with every aim point, or None.

    Parameters
    ----------
    flux, limit
        As in `choose_aims`.
    count : int
        Number of heliostats.
    """
    parts = kernel.brightest(_images(flux), limit).reshape(-1, count)
    over = np.flatnonzero(parts.min(axis=0) > 1.0)
    if not over.size:
        return None
    image = flux[int(parts[:, over[0]].argmin()) * count + int(over[0])].toarray()[0]
    cell = int((image / limit).argmax())
    return int(over[0]), float(image[cell]), cell


def aim_grid(receiver: tracer.Receiver, centre: Floats, rows: int, columns: int, azimuth_span: float) -> Floats:
    """Return a grid of aim points on the receiver, shape (rows * columns, N, 3). [m]

    The aim points are the centres of equal cells, with rows from the bottom up. The cells cover a rectangle, or a strip
    of a cylinder. The strip spans the angle `azimuth_span` [rad] and is centred on the point nearest to the heliostat.
    `centre` contains the mirror centres, shape (N, 3) [m].
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
    """Return the distance of aim points from the receiver surface, shape (..., N). [m]

    The distance is infinite for a heliostat behind the receiver.
    """
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
    return np.where(seen | ~(away <= SLACK), away, np.inf)


def image_bytes(kind: int, heliostats: int, aims: int, cells: tuple[int, int], rays: int) -> int:
    """Return the maximum size of the images of all heliostats. [bytes]

    An image covers at most half of a cylinder.
    """
    lit = cells[0] * (cells[1] // 2 + 2 if kind == tracer.CYLINDER else cells[1])
    return 2 * 8 * min(lit, rays) * heliostats * aims


def aim_images(
    scene: tracer.Scene, sun: Floats, points: Floats, *, cells: tuple[int, int], share: Floats, rays: int = 1024,
    seed: int = 0, threads: int = 1,
) -> csr_matrix:  # fmt: skip
    """Return the flux from each heliostat for each aim point, shape (A * N, cells).

    The field is traced once for each aim point.

    Parameters
    ----------
    scene : Scene
        Scene of the field; `points` override its aim points.
    sun : ndarray, shape (1, 3)
        Unit vector to the sun. [1]
    points : ndarray, shape (A, N, 3)
        Aim points. [m]
    cells : (int, int)
        Numbers of rows and columns of cells on the receiver.
    share : ndarray, shape (N,)
        Power of the light on each mirror at normal incidence, minus reflection and attenuation losses. [kW]
    rays, seed, threads
        As in `kernels.rays.trace`.
    """
    from scipy.sparse import csr_matrix

    given: dict[str, Any] = {"cells": cells, "share": share, "rays": rays, "seed": seed, "threads": threads}
    traces = (tracer.trace(scene._replace(target=aim), sun, images=True, **given).images for aim in points)
    counts, names, light = map(np.concatenate, zip(*traces, strict=True))
    light /= np.float32(cell_area(scene.receiver, cells))
    first = np.concatenate(([0], counts)).cumsum()
    return csr_matrix((light, names, first), shape=(len(counts), cells[0] * cells[1]))


def image_powers(flux: csr_matrix, receiver: tracer.Receiver, cells: tuple[int, int], aims: int) -> Floats:
    """Return the power of each image on the receiver, shape (A, N). [kW]"""
    area = cell_area(receiver, cells)
    return area * (flux @ np.ones(flux.shape[1], np.float32)).reshape(aims, -1).astype(np.float64)


def _load(flux: csr_matrix, choice: Integers) -> Floats:
    on = np.flatnonzero(choice >= 0)
    rows = flux[choice[on] * len(choice) + on]
    return np.bincount(rows.indices, rows.data, flux.shape[1]).astype(np.float64)


def targets(scene: tracer.Scene, place: Floats) -> Floats:
    """Return the aim points of a field for the ray tracer, shape (N, 3). [m]

    A heliostat with NaN in `place` is stowed and aims at a point above the tower, at three times the receiver height.
    """
    above = np.array([*scene.receiver.centre[:2], 3.0 * scene.receiver.centre[2]])
    return np.where(np.isnan(place), above, place)


def limited_aims(
    scene: tracer.Scene, sun: Floats, points: Floats, limit: Floats, share: Floats, *, rays: int = RAYS, seed: int = 0,
    gap: float = GAP, threads: int = 1,
) -> dict[str, Any]:  # fmt: skip
    """Choose aim points, check them with a finer trace, and return the values of `VARIABLES`.

    The images of the heliostats contain noise. Each round replaces the images for the chosen aim points with images
    traced with more rays. In each overloaded cell, the limit is divided by the square root of the ratio of flux to
    limit. Heliostats then change their aim points until the flux meets the reduced limits.

    Parameters
    ----------
    scene, sun, points, share, rays, seed, threads
        As in `aim_images`.
    limit : ndarray, shape (rows, columns)
        Maximum flux in each cell. [kW m-2]
    gap : float
        As in `choose_aims`.

    Raises
    ------
    ValueError
        If a single heliostat exceeds a limit with each of its aim points. The message names the heliostat and the cell.
    """
    from scipy.sparse import csr_matrix, diags

    count, cells, area = len(scene.centre), limit.shape, cell_area(scene.receiver, limit.shape)
    flux = aim_images(scene, sun, points, cells=cells, share=share, rays=rays, seed=seed, threads=threads)
    power, most = image_powers(flux, scene.receiver, cells, len(points)), limit.ravel()
    if (problem := overload(flux, most, count)) is not None:
        words = "heliostat {} alone exceeds the limit with each of its aim points: {:.4g} kW/m2 in row {}, column {}"
        raise ValueError(words.format(*problem[:2], *divmod(problem[2], cells[1])))
    whole, free = float(power.max(axis=0).sum()), _load(flux, power.argmax(axis=0))  # power and flux without a limit
    found = choose_aims(power, flux, most, gap=gap, threads=threads)
    choice, least, reduced = found.choice, np.inf, most
    penalty = 10.0 * power.max(axis=0).mean()  # high, because only a few heliostats change their aim points
    for _ in range(6):  # ends early if no cell exceeds its limit by more than 0.5 % in a trace with 16 times the rays
        place = np.where(choice[:, np.newaxis] < 0, np.nan, points[choice, np.arange(count)])
        fine = aim_images(
            scene, sun, targets(scene, place)[np.newaxis], cells=cells, share=share, rays=16 * rays,
            seed=seed + 1, threads=threads,
        )  # fmt: skip
        checked = np.bincount(fine.indices, fine.data, most.size)
        if (excess := float((checked / most).max())) < least:
            least, kept = excess, (choice, place, checked)
        if excess <= 1.005:
            break
        on = np.flatnonzero(choice >= 0)
        power[choice[on], on] = image_powers(fine, scene.receiver, cells, 1)[0, on]
        rows, ones = choice[on] * count + on, np.ones(power.size, np.float32)
        ones[rows] = 0.0
        flux = diags(ones) @ flux + csr_matrix((1.0 - ones[rows], (rows, on)), (power.size, count), np.float32) @ fine
        shares = (choice == np.arange(len(points))[:, np.newaxis]).astype(float)
        reduced = reduced / np.sqrt(np.maximum(checked / most, 1.0))
        choice = _rounded(power, power, _images(flux), reduced, shares, _load(flux, choice), penalty)
    choice, place, checked = kept
    output, maps = area * float(checked.sum()), (values.reshape(cells) for values in (checked, free, found.price))
    bound = max(found.bound, output)  # the noise of the power differs from the noise of the bound
    values = (
        choice, *place.T, *maps, *(1e-3 * np.array((output, whole, bound))), checked.max(), free.max(),
        *(max(1.0 - output / (best or np.nan), 0.0) for best in (whole, bound)), np.count_nonzero(choice < 0),
    )  # fmt: skip
    return dict(zip(VARIABLES, values, strict=True))


def flux_limited_aims(
    layout: Any, receiver: Cylinder | Rectangle, sun_azimuth: float = 180.0, sun_elevation: float = 45.0,
    limit: ArrayLike = 1000.0, *, rows: int = 7, columns: int = 3, azimuth_span: float = 40.0,
    aims: ArrayLike | None = None, flux_map: tuple[int, int] = (20, 36), dni: float = 1000.0,
    reflectivity: ArrayLike = 1.0, transmittance: ArrayLike = 1.0, rays: int = RAYS, seed: int = 0, gap: float = GAP,
    memory: float = 4e9, threads: int | None = None, **field: Any,
) -> xr.Dataset:  # fmt: skip
    """Choose aim points that maximise the power on the receiver under a flux limit.

    The field is traced once for each aim point to compute the images of all heliostats. The function `choose_aims` then
    selects the aim points.

    Parameters
    ----------
    layout, receiver, **field
        As in `field_scene`.
    sun_azimuth, sun_elevation : float
        Azimuth and elevation of the sun, which must be above the horizon. [deg]
    limit : float or array, shape (rows of cells,) or (rows of cells, columns of cells)
        Maximum flux in each cell, with rows of cells from the bottom up. [kW m-2]
    rows, columns : int
        Numbers of rows and columns of aim points. The aim points are the centres of equal cells of the receiver.
    azimuth_span : float
        Angle spanned by the columns of aim points on a cylinder, centred on the point nearest to the heliostat. [deg]
    aims : array, shape (A, 3) or (A, N, 3), optional
        Aim points, which replace the grid of rows and columns. [m]
    flux_map : (int, int)
        Numbers of rows and columns of the flux map.
    dni : float
        Direct normal irradiance. [W m-2]
    reflectivity, transmittance : float or array, shape (N,)
        Fractions of the light reflected by the mirrors and transmitted by the air. [1]
    rays : int
        Number of rays per image.
    seed : int
        Random seed for the images. The flux for the chosen aim points is traced with the next seed and 16 times as many
        rays. If a cell then exceeds its limit by more than 0.5 %, the limits of overloaded cells are reduced and aim
        points are chosen again, up to five times. The best choice is kept.
    gap : float
        As in `choose_aims`.
    memory : float
        Maximum size of the images. [bytes]
    threads : int, optional
        Number of threads (default: all cores).

    Returns
    -------
    xarray.Dataset
        Variables for each heliostat: `aim`, the index of the aim point (-1 if stowed), and `aim_x`, `aim_y` and
        `aim_z`, the coordinates of the aim point (NaN if stowed) [m]. Maps: `aimed_flux_map` and `unlimited_flux_map`
        [kW m-2], and `flux_price`, the power gained per unit increase of the limit [kW / (kW m-2)]. Scalars:
        `aimed_power`, `unlimited_power` and `power_bound` [MW]; `aimed_peak_flux` and `unlimited_peak_flux` [kW m-2];
        `limit_loss`, a fraction of the unlimited power; `aim_gap`, a fraction of the bound; and `stowed_heliostats`.

    Raises
    ------
    ValueError
        If an aim point is off the receiver, if the flux of a single heliostat exceeds a limit, or if the images exceed
        `memory`. The message names the heliostat and the cell.

    Examples
    --------
    >>> import heliosweep
    >>> field = [(0.0, 60.0, 4.0), (10.0, 60.0, 4.0), (0.0, 70.0, 4.0)]
    >>> receiver = heliosweep.Cylinder(height=50.0, radius=3.0, height_extent=8.0)
    >>> found = heliosweep.flux_limited_aims(field, receiver, 180.0, 50.0, 30.0, width=6.0, height=5.0, slope_error=2.0)
    >>> bool(found.aimed_peak_flux <= 30.0), bool(found.aimed_power <= found.power_bound)
    (True, True)
    """
    scene = field_scene(layout, receiver, **field)
    count, centre = len(scene.centre), scene.centre
    points = aim_grid(scene.receiver, centre, rows, columns, np.radians(azimuth_span))
    if aims is not None:
        given = np.array(aims, np.float64)
        points = np.broadcast_to(given if given.ndim == 3 else given[:, np.newaxis], (len(given), count, 3))
    if (wrong := np.argwhere(off_receiver(scene.receiver, centre, points) > SLACK)).size:
        aim, row = wrong[0]
        words = f"aim {aim} of heliostat {row} is off the receiver or on the side away from the heliostat"
        raise ValueError(f"`aims`: {words}; move it, or reduce `azimuth_span`")
    if (size := image_bytes(scene.receiver.kind, count, len(points), flux_map, rays)) > memory:
        words = f"images of {count:,} heliostats with {len(points)} aim points require up to {size / 1e9:.2g} GB"
        raise ValueError(
            f"`memory`: {words}; reduce the number of aim points or of cells in `flux_map`, or increase `memory`"
        )
    most = np.asarray(limit, np.float64)
    most = np.broadcast_to(most[:, np.newaxis] if most.ndim == 1 else most, flux_map)
    if not (most > 0.0).all():
        raise ValueError(f"`limit` must be above 0 (got {most.min():g})")
    sun, threads = sun_directions(sun_azimuth, sun_elevation)[0], threads or processors()
    share = (
        mirror_area(scene.sides[:, 0], scene.sides[:, 1], scene.facets)
        * np.asarray(reflectivity)
        * np.asarray(transmittance)
        * 1e-3
        * dni
    )
    try:
        found = limited_aims(scene, sun, points, most, share, rays=rays, seed=seed, gap=gap, threads=threads)
    except ValueError as error:
        raise ValueError(f"`limit`: {error}; increase the limit") from None
    return xr.Dataset(
        {name: (dims, found[name], {"units": units, "long_name": words})
         for name, (dims, units, words) in VARIABLES.items()},
        heliostat_coordinates(layout, centre), {"rays": tracer.block_rays(rays), "seed": seed},
    )  # fmt: skip
