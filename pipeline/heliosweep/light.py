"""Ray tracing of a heliostat field without a study file, for shading, blocking, intercept and flux.

Coordinates are x east, y north and z up [m]. Azimuths run clockwise from north [deg].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.files import processors
from heliosweep.kernels import rays as kernel
from heliosweep.kernels import sunshapes
from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.device import device_problem
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION
from heliosweep.lazy import xr
from heliosweep.sun import direction

#: Dimensions of flux maps.
_CELLS = ("flux_row", "flux_column")
TRACKING = {"azimuth_elevation": AZIMUTH_ELEVATION, "spinning_elevation": SPINNING_ELEVATION}
#: Maximum number of rows or columns in a flux map, and maximum angle from the sun's centre in a sun shape [mrad].
_MOST_CELLS, WIDEST = 1000, 100.0
#: Number of arguments for each sun shape.
_SUN_SHAPES = {"pillbox": 0, "gaussian": 0, "limb_darkened": 0, "jose": 0, "buie": 1, "table": 2}
_PARTS = {
    "cosine_efficiency": "cosine of the angle of incidence",
    "shading_efficiency": "fraction of the mirror that is not shaded",
    "blocking_efficiency": "fraction of the mirror whose light is not blocked",
    "optical_efficiency": "cosine times the fraction that is neither shaded nor blocked",
    "intercept_efficiency": "fraction of the light leaving the field that hits the receiver",
    "receiver_efficiency": "light on the receiver relative to the light on the mirror area at normal incidence",
}


class Cylinder(NamedTuple):
    """Cylindrical receiver with a vertical axis at x = y = 0, lit from outside.

    The attributes are the height of the centre, the radius, and the height from the lower to the upper edge, all in m.
    """

    height: float
    radius: float
    height_extent: float


class Rectangle(NamedTuple):
    """Flat rectangular receiver, or rectangular aperture of a cavity, at x = y = 0.

    The attributes are the height of the centre, the width, and the height along the face, all in m, followed by the
    azimuth of the normal and the tilt of the normal above the horizontal, both in deg. The azimuth is 0 for a field to
    the north. The tilt is negative if the receiver faces down.
    """

    height: float
    width: float
    height_extent: float
    azimuth: float = 0.0
    tilt: float = 0.0


def field_scene(
    layout: Any,
    receiver: Cylinder | Rectangle,
    *,
    width: ArrayLike,
    height: ArrayLike,
    aim: ArrayLike | None = None,
    tracking: str = "azimuth_elevation",
    focus: ArrayLike | str = "slant",
    facets: tuple[int, int, float] = (1, 1, 0.0),
    canting: ArrayLike | str = "none",
    slope_error: ArrayLike = 0.0,
    specularity_error: ArrayLike = 0.0,
    tracking_error: ArrayLike = 0.0,
    pointing_error: ArrayLike = (0.0, 0.0),
    slope_map: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
    sun_shape: str | tuple[Any, ...] = "pillbox",
    tower: tuple[float, float] | None = None,
) -> kernel.Scene:
    """Return the scene of a heliostat field for the ray tracer.

    Parameters
    ----------
    layout : array, DataFrame, Dataset or mapping
        Mirror centres, as an array of shape (N, 3) or a table with columns x, y and z. [m]
    receiver : Cylinder or Rectangle
        Receiver of the field.
    width, height : float or array, shape (N,)
        Width and height of the mirrors. [m]
    aim : array, shape (3,) or (N, 3), optional
        Aim points, which must not be behind the receiver (default: the centre of a rectangle, or the nearest point at
        half the height of a cylinder). [m]
    tracking : {'azimuth_elevation', 'spinning_elevation'}
        Tracking method. The width of each mirror is horizontal ('azimuth_elevation'), or perpendicular to the plane
        through the mirror centre, the sun and the aim point ('spinning_elevation').
    focus : 'flat', 'slant', float or array, shape (N,) or (N, 2)
        Focal length of the mirror or of its facets; 'slant' means the distance to the aim point. Two values per mirror
        are the focal lengths along the width and along the height. [m]
    facets : (int, int, float)
        Numbers of columns and rows of facets, and gap between facets [m].
    canting : 'none', 'on_axis', float or array, shape (N,)
        Focal length of the canting; 'on_axis' means the distance to the aim point. [m]
    slope_error : float or array, shape (2,), (N,) or (N, 2)
        Standard deviation of the slope of the mirror surface along the width and along the height. [mrad]
    specularity_error : float or array, shape (N,)
        Standard deviation per axis of the direction of the reflected ray, due to specularity. [mrad]
    tracking_error : float or array, shape (N,)
        Standard deviation per axis of the direction of the mirror normal, due to random tracking errors. [mrad]
    pointing_error : array, shape (2,) or (N, 2)
        Fixed rotation of the mirror normal along the width and along the height. [mrad]
    slope_map : (x, y, slope), optional
        Evenly spaced positions on a mirror, `x` of shape (C,) and `y` of shape (R,) [m], and the slopes at these
        positions, of shape (R, C, 2), or (N, R, C, 2) if each mirror has a separate map [mrad]. Missing slopes (NaN)
        are replaced by the nearest slopes.
    sun_shape : str or tuple
        Sun shape: 'pillbox', 'gaussian', 'limb_darkened', 'jose', ('buie', circumsolar ratio), or ('table', angles
        [mrad], brightness). The angles in a table range from 0 to at most 100 mrad.
    tower : (float, float), optional
        Radius and top height of a tower that stands below the receiver at x = y = 0 and casts a shadow. [m]

    Returns
    -------
    Scene
        Scene for `trace_field`, `trace_year` and `hflcal`. These functions also accept the arguments of `field_scene`.

    Raises
    ------
    ValueError
        If the shapes do not match, if a name is unknown, or if the position of a mirror, an aim point or the receiver
        is invalid. The message names the argument and the heliostat.

    Examples
    --------
    >>> import heliosweep
    >>> receiver = heliosweep.Cylinder(height=50.0, radius=3.0, height_extent=5.0)
    >>> scene = heliosweep.field_scene([(0.0, 60.0, 4.0), (10.0, 60.0, 4.0)], receiver, width=6.0, height=5.0)
    >>> scene.target.round(1).tolist()
    [[0.0, 3.0, 50.0], [0.5, 3.0, 50.0]]
    """
    centre = mirror_centres(layout)
    count = len(centre)

    def each(name: str, value: ArrayLike, shape: tuple[int, ...] = (), least: float = 0.0) -> Floats:
        array = np.asarray(value, np.float64)
        if shape == (2,) and array.ndim == 1 and len(array) == count and count != 2:
            array = array[:, np.newaxis]
        found = per_item(name, array, shape, count)
        wrong = ~(np.isfinite(found) & (found >= least)).reshape(count, -1).all(axis=1)
        _refuse(name, wrong, f"is below {least:g} or not finite" if np.isfinite(least) else "is not finite")
        return found

    if tracking not in TRACKING:
        raise ValueError(f"`tracking` must be one of {', '.join(TRACKING)} (got {tracking!r})")
    sides = np.stack((each("width", width, least=1e-9), each("height", height, least=1e-9)), axis=1)
    _facets(facets, sides)
    made, level, reach = _receiver(receiver), np.hypot(centre[:, 0], centre[:, 1]), 0.5 * np.hypot(*sides.T)
    face, off = np.cross(made.across, made.upward), centre - made.centre
    nearest = centre[:, :2] / np.maximum(level, 1e-9)[:, np.newaxis] * (made.kind == kernel.CYLINDER)
    target = np.column_stack((made.half_width * nearest, np.full(count, receiver.height)))
    beside = [np.abs(off @ made.across) - made.half_width, np.abs(off @ face)]
    if made.kind == kernel.CYLINDER:
        beside = [level - made.half_width]
    beside.append(np.abs(off @ made.upward) - made.half_height)
    within = np.linalg.norm(np.maximum(beside, 0.0), axis=0) < reach
    _refuse(
        "layout",
        within,
        "is within the receiver, or closer to it than half the mirror diagonal; move or remove the heliostat",
    )
    if aim is not None:
        target = each("aim", aim, (3,), -np.inf)
        before = (
            np.sum(target[:, :2] * nearest, axis=1) if made.kind == kernel.CYLINDER else (target - made.centre) @ face
        )
        _refuse(
            "aim", before < -1e-6, "aims behind the receiver; choose an aim point on the side that faces the heliostat"
        )
    slant = np.linalg.norm(target - centre, axis=1)
    _refuse("layout", slant < reach, "is closer to its aim point than half the mirror diagonal")
    if tower is not None:
        bottom = receiver.height - made.half_height * made.upward[2]
        check_tower(tower, centre)
        if tower[0] > made.half_width and tower[1] > bottom:
            raise ValueError(f"`tower` covers the receiver: its top must be at most {bottom:g} m (got {tower[1]:g})")
    slope = np.hypot(each("slope_error", slope_error, (2,)), each("tracking_error", tracking_error)[:, np.newaxis])
    errors = kernel.Errors(1e-3 * slope[:, 0], 1e-3 * slope[:, 1], 1e-3 * each("specularity_error", specularity_error))
    slopes = None
    if slope_map is not None:
        x, y, lean = (np.asarray(part, np.float64) for part in slope_map)
        lean = lean if lean.ndim == 4 else lean[np.newaxis]
        if lean.shape[1:] != (len(y), len(x), 2) or len(lean) not in (1, count):
            raise ValueError(
                f"`slope_map` must contain slopes of the shape {(len(y), len(x), 2)} (got {lean.shape[1:]})"
            )
        if not all(len(at) > 1 and at[1] > at[0] and np.allclose(np.diff(at), at[1] - at[0]) for at in (x, y)):
            raise ValueError(
                "`slope_map` must have at least 2 positions along x and y, in ascending order and evenly spaced"
            )
        if not np.isfinite(lean).any(axis=(1, 2)).all():
            raise ValueError("each map in `slope_map` must contain at least one finite slope")
        slopes = kernel.SlopeMap(x, y, 1e-3 * lean, np.arange(count) % len(lean), False)
    curve, cant = _curve("focus", focus, "flat", "slant", slant), _curve("canting", canting, "none", "on_axis", slant)
    turn = 1e-3 * each("pointing_error", pointing_error, (2,), -np.inf)
    return kernel.Scene(
        centre, target, sides, curve, cant[:, 0], turn, kernel.Facets(*facets), TRACKING[tracking], errors,
        _sun_shape(sun_shape), made, slopes=slopes, tower=tower,
    )  # fmt: skip


def trace_field(
    layout: Any, receiver: Cylinder | Rectangle | None = None, sun_azimuth: ArrayLike = 180.0,
    sun_elevation: ArrayLike = 45.0, *, rays: int | None = None, precision: float = 1e-4, seed: int = 0,
    flux_map: tuple[int, int] | None = None, dni: ArrayLike = 1000.0, threads: int | None = None, device: str = "cpu",
    **field: Any,
) -> xr.Dataset:  # fmt: skip
    """Trace light from a heliostat field at one or more instants.

    Each ray starts at a point on the reflecting area. Other mirrors can shade the ray on its way from the sun and block
    the ray on its way to the receiver. Shading and blocking mirrors are treated as planes. The curvature of the
    reflecting mirror is taken into account when the ray is intersected with the receiver.

    Parameters
    ----------
    layout : array, DataFrame, Dataset, mapping or Scene
        Mirror centres as in `field_scene`, or a scene from `field_scene`.
    receiver : Cylinder or Rectangle
        Receiver; None if `layout` is a scene.
    sun_azimuth, sun_elevation : float, array or DataArray, shape (T,)
        Azimuth and elevation of the sun. [deg]
    rays : int, optional
        Number of rays for each heliostat and instant, rounded up to 16, 32 or a power of two (default: the number
        required to reach `precision` at the quartiles of the sun's elevation).
    precision : float
        Required relative standard error of the light from the whole field, at least 1e-6. The standard error of a
        receiver cell relative to the peak is at most 40 times this value. The standard error of a heliostat relative to
        the light on its area is at most 6 times this value.
    seed : int
        Seed of the random number generator. Rays depend only on the seed and on the indices of the heliostat and the
        instant.
    flux_map : (int, int), optional
        Numbers of rows and columns of cells on the receiver, each at most 1000. Rows are ordered from bottom to top.
        Columns are ordered from left to right as seen from the field, or clockwise from north on a cylinder.
    dni : float or array, shape (T,)
        Direct normal irradiance for the flux map, at most 2000. [W m-2]
    threads : int, optional
        Number of threads (default: all cores). The results do not depend on this number.
    device : {'cpu', 'cuda'}
        Processor that traces the rays; 'cuda' selects an NVIDIA GPU and requires ``heliosweep[gpu]``.
    **field
        Arguments of `field_scene`.

    Returns
    -------
    xarray.Dataset
        Variables `cosine_efficiency`, `shading_efficiency`, `blocking_efficiency`, `optical_efficiency`,
        `intercept_efficiency` and `receiver_efficiency` (the product of the optical and intercept efficiencies) with
        the dimensions ``time`` (omitted for a single instant) and ``heliostat``; NaN if the sun is below the horizon
        [1]. The variables ``*_error`` are the standard errors. If `flux_map` is given, the data set also contains
        `flux_map` and `peak_flux` with their standard errors [kW m-2]. The flux is computed for a reflectivity of 1 and
        no attenuation.

    Raises
    ------
    ValueError
        If an argument is invalid (see `field_scene`), or if there are more than 2e12 rays. The message names the
        argument.

    Notes
    -----
    Each result is the mean over 8 independently scrambled Sobol sequences. Standard errors are scaled with Student's t
    distribution, so that about 95 % of all results are within two standard errors of the true value. The page
    docs/light.md lists the references.

    Examples
    --------
    >>> import heliosweep
    >>> field = [(0.0, 60.0, 4.0), (10.0, 60.0, 4.0), (0.0, 70.0, 4.0)]
    >>> receiver = heliosweep.Cylinder(height=50.0, radius=3.0, height_extent=5.0)
    >>> light = heliosweep.trace_field(field, receiver, 120.0, 30.0, width=6.0, height=5.0, slope_error=2.0, rays=4096)
    >>> light.optical_efficiency.round(2).values.tolist()
    [0.91, 0.88, 0.91]
    """
    scene = _scene(layout, receiver, field)
    sun, dims, coordinates = sun_directions(sun_azimuth, sun_elevation)
    up, instants = sun[:, 2] > 0.0, len(sun)
    cells, irradiance = _cells(flux_map), per_item("dni", dni, (), instants, 2000.0)
    threads, area = threads or processors(), mirror_area(scene.sides[:, 0], scene.sides[:, 1], scene.facets)
    lit = np.flatnonzero(up)[np.argsort(sun[up, 2])]
    some = [np.array([lit[len(lit) * quarter // 4]]) for quarter in (1, 2, 3) if len(lit)]
    each = _rays_for(scene, [sun[one] for one in some], None, rays, precision, cells, area, seed, instants)
    given: dict[str, Any] = {"rays": each, "seed": seed, "cells": cells, "threads": threads, "share": area}
    given["cuda"] = _on_device(device)
    length = 1 if cells is not None else max(1, 20_000 // len(area))  # number of instants traced at once
    variables, shape, efficiency, maps = dict[str, Any](), (*dims, "heliostat"), [], []
    for first in range(0, instants, length):
        last = min(first + length, instants)
        group = np.maximum(np.arange(instants) - first, 0)
        found = kernel.trace(scene, sun, first=first, last=last, group=group, groups=last - first, **given)
        efficiency.append(_efficiencies(found.sums, 1.0))
        if cells is not None:
            maps.append(found.flux * (found.unit * 1e-3 * irradiance[first] / cell_area(scene.receiver, cells)))
    for name, words in _PARTS.items():
        pair = (
            np.where(up, np.concatenate(each, axis=1), np.nan).T
            for each in zip(*(one[name] for one in efficiency), strict=True)
        )
        variables |= _with_error(name, shape, [value if dims else value[0] for value in pair], "1", words)
    if cells is not None:
        variables |= _map_variables(maps, dims, "kW m-2", "flux on the receiver")
    return _dataset(variables, coordinates, scene, layout, each, seed)


def trace_year(
    layout: Any, receiver: Cylinder | Rectangle | None = None, sun_azimuth: ArrayLike = 180.0,
    sun_elevation: ArrayLike = 45.0, irradiation: ArrayLike = 1.0, *, reflectivity: ArrayLike = 1.0,
    transmittance: ArrayLike = 1.0, rays: int | None = None, precision: float = 1e-4, seed: int = 0,
    flux_map: tuple[int, int] | None = None, threads: int | None = None, device: str = "cpu", **field: Any,
) -> xr.Dataset:  # fmt: skip
    """Trace light from a heliostat field over a period.

    The energy that a heliostat delivers to the receiver is

        E = area * transmittance * sum of irradiation * reflectivity * cosine * fraction of rays that hit the receiver.

    Parameters
    ----------
    layout, receiver, sun_azimuth, sun_elevation, rays, precision, seed, threads, device, **field
        As in `trace_field`, with T instants.
    irradiation : float, array or DataArray, shape (T,)
        Direct normal irradiation in the time interval of each instant; 0 if the field does not operate. [MWh m-2]
    reflectivity : float or array, shape (T,)
        Fraction of the light that the mirrors reflect, including the effect of cleanliness. [1]
    transmittance : float or array, shape (N,)
        Fraction of the light that the air transmits on the way to the receiver. [1]
    flux_map : (int, int), optional
        Numbers of rows and columns of cells on the receiver, as in `trace_field`.

    Returns
    -------
    xarray.Dataset
        Means of the efficiencies in `trace_field` weighted by irradiation [1], and `receiver_energy` [MWh], for each
        heliostat. The variable `field_energy` is the sum of the energies of all heliostats [MWh]. If `flux_map` is
        given, the data set also contains `flux_map` and `peak_flux` [MWh m-2]. The variables ``*_error`` are the
        standard errors.

    Raises
    ------
    ValueError
        If an argument is invalid (see `field_scene`), or if there are more than 2e12 rays. The message names the
        argument.

    Examples
    --------
    >>> import heliosweep
    >>> receiver = heliosweep.Cylinder(height=50.0, radius=3.0, height_extent=5.0)
    >>> field = [(0.0, 60.0, 4.0), (10.0, 60.0, 4.0), (0.0, 70.0, 4.0)]
    >>> day = heliosweep.trace_year(
    ...     field, receiver, [120.0, 180.0, 240.0], [30.0, 50.0, 30.0], 1e-3, width=6.0, height=5.0, rays=4096
    ... )
    >>> round(float(day.field_energy), 2)
    0.25
    """
    scene = _scene(layout, receiver, field)
    sun, _, _ = sun_directions(sun_azimuth, sun_elevation)
    cells, weight = _cells(flux_map), per_item("irradiation", irradiation, (), len(sun), np.inf)
    weights = np.stack((weight, weight * per_item("reflectivity", reflectivity, (), len(sun), 1.0)))
    area = mirror_area(scene.sides[:, 0], scene.sides[:, 1], scene.facets)
    share = area * per_item("transmittance", transmittance, (), len(area), 1.0)
    each = _rays_for(scene, [sun], weights, rays, precision, cells, share, seed, len(sun))
    threads = threads or processors()
    found = kernel.trace(
        scene, sun, weights=weights, rays=each, seed=seed, cells=cells, share=share, threads=threads,
        cuda=_on_device(device),
    )  # fmt: skip
    sums = found.sums[:, :, 0]
    total = float(weight[sun[:, 2] > 0.0].sum()) or np.nan
    energy, variables = sums[:, :, kernel.RECEIVED] * share, dict[str, Any]()
    for name, pair in _efficiencies(sums, total).items():
        variables |= _with_error(name, ("heliostat",), pair, "1", _PARTS[name])
    for name, dims, values in (("receiver", ("heliostat",), energy), ("field", (), energy.sum(axis=1))):
        words = f"energy from the {'heliostat' if dims else 'field'} on the receiver"
        variables |= _with_error(f"{name}_energy", dims, kernel.mean_error(values), "MWh", words)
    if cells is not None:
        flux = found.flux * (found.unit / cell_area(scene.receiver, cells))
        variables |= _map_variables([flux], (), "MWh m-2", "energy on the receiver")
    return _dataset(variables, {}, scene, layout, each, seed)


def hflcal(
    layout: Any, receiver: Cylinder | Rectangle | None = None, sun_azimuth: ArrayLike = 180.0,
    sun_elevation: ArrayLike = 45.0, **field: Any,
) -> Floats:  # fmt: skip
    """Compute the intercept of each heliostat with the HFLCAL model.

    HFLCAL models each image as a circular Gaussian. Results are accurate to a few percent. The variance of the image
    has two parts. The first part is due to the sun shape, the slope errors and the specularity, and is proportional to
    the square of the slant range D. The second part is due to astigmatism and is equal to

        d^2 / 32 * ((D / f - cos i)^2 + (D / f * cos i - 1)^2),

    where d is the square root of the mirror area, f is the focal length and i is the angle of incidence. The variance
    is divided by the cosine of the angle of incidence on the receiver.

    Parameters
    ----------
    layout, receiver, sun_azimuth, sun_elevation, **field
        As in `trace_field`. A cylinder is treated as a rectangle of equal width that faces the heliostat.

    Returns
    -------
    ndarray, shape (T, N)
        Intercept of each heliostat; NaN if the sun is below the horizon. [1]

    References
    ----------
    P. Schwarzboezl, R. Pitz-Paal and M. Schmitz, "Visual HFLCAL - a software tool for layout and optimisation of
    heliostat fields", SolarPACES 2009.

    Examples
    --------
    >>> import heliosweep
    >>> receiver = heliosweep.Rectangle(height=50.0, width=4.0, height_extent=4.0)
    >>> place = [(0.0, 200.0, 4.0)]
    >>> heliosweep.hflcal(place, receiver, 180.0, 40.0, width=6.0, height=5.0, slope_error=2.0).round(3).tolist()
    [[0.93]]
    """
    from scipy.special import erf

    scene = _scene(layout, receiver, field)
    sun, made = sun_directions(sun_azimuth, sun_elevation)[0], scene.receiver
    way = scene.target - scene.centre
    slant = np.linalg.norm(way, axis=1)
    to_aim = way / slant[:, np.newaxis]
    face = np.broadcast_to(np.cross(made.across, made.upward), way.shape)
    x, y = np.stack((made.across, made.upward)) @ (scene.target - made.centre).T
    if made.kind == kernel.CYLINDER:
        face, x = -way * (1.0, 1.0, 0.0) / np.hypot(way[:, 0], way[:, 1])[:, np.newaxis], np.zeros(len(way))
    cosine = -np.sum(to_aim * face, axis=1)
    incidence = np.sqrt(np.maximum(0.0, 0.5 + 0.5 * sun @ to_aim.T))
    relative = 2.0 * slant * np.reshape(scene.curve, (len(slant), -1))[:, 0]
    slopes = np.mean(np.square([np.broadcast_to(each, len(slant)) for each in scene.errors[:2]]), axis=0)
    variance = slant**2 * (scene.sun.spread + scene.errors.specularity**2 + 2.0 * (1.0 + incidence**2) * slopes)
    blur = (relative - incidence) ** 2 + (relative * incidence - 1.0) ** 2
    scale = 1.0 / np.sqrt(2.0 * (variance + scene.sides.prod(axis=1) * blur / 32.0) / np.maximum(cosine, 1e-12))
    parts = [
        0.5 * (erf((half + at) * scale) + erf((half - at) * scale))
        for half, at in ((made.half_width, x), (made.half_height, y))
    ]
    return np.where(sun[:, 2:] > 0.0, parts[0] * parts[1] * (cosine > 0.0), np.nan)


def image_radius(flux: xr.DataArray) -> xr.DataArray:
    """Compute the root mean square radius of a flux map about its centroid.

    Parameters
    ----------
    flux : DataArray, shape (..., flux_row, flux_column)
        Flux or energy in the cells of a flat receiver. The coordinates are the centres of the cells, as in study
        results [m]. Without coordinates, the unit of length is the side of a cell.

    Returns
    -------
    DataArray, shape (...)
        Radius about the centroid, in the unit of the coordinates; NaN if there is no light.

    Examples
    --------
    >>> import heliosweep, xarray as xr
    >>> cells = {"flux_row": [-1.0, 1.0], "flux_column": [0.0, 3.0]}
    >>> heliosweep.image_radius(xr.DataArray([[5.0, 0.0], [5.0, 0.0]], cells)).item()
    1.0
    """
    total = flux.sum(_CELLS)
    centres = [(flux * flux[dim]).sum(_CELLS) / total for dim in _CELLS]
    square = sum((flux[dim] - centre) ** 2 for dim, centre in zip(_CELLS, centres, strict=True))
    found: xr.DataArray = ((flux * square).sum(_CELLS) / total) ** 0.5
    return found.assign_attrs(units="m", long_name="root mean square radius of the image")


def mirror_area(width: Floats, height: Floats, facets: Any = None) -> Floats:
    """Return the reflecting area of mirrors, excluding the gaps between facets. [m2]"""
    if facets is None:
        return width * height
    return (width - (facets.columns - 1) * facets.gap) * (height - (facets.rows - 1) * facets.gap)


def _scene(layout: Any, receiver: Cylinder | Rectangle | None, field: Mapping[str, Any]) -> kernel.Scene:
    if isinstance(layout, kernel.Scene):
        return layout
    if receiver is None:
        raise ValueError("`receiver` is missing: give a Cylinder or a Rectangle")
    return field_scene(layout, receiver, **field)


def per_item(name: str, value: ArrayLike, shape: tuple[int, ...], count: int, most: float | None = None) -> Floats:
    """Broadcast a value to each heliostat or instant, shape (count, *shape).

    If `most` is given, the values must be between 0 and `most`.
    """
    array = np.asarray(value, np.float64)
    try:
        found = np.array(np.broadcast_to(array, (count, *shape)))
    except ValueError:
        wanted = " or ".join(str(each) for each in (shape, (count, *shape)))
        raise ValueError(f"`{name}` must have the shape {wanted} (got {array.shape})") from None
    if most is not None and not (np.isfinite(found) & (found >= 0.0) & (found <= most)).all():
        limits = "at least 0; set missing hours to 0" if np.isinf(most) else f"from 0 to {most:g}"
        raise ValueError(f"`{name}` must be finite and {limits}")
    return found


def _on_device(device: str) -> bool:
    """Return True if the device is a GPU. Raises ValueError if the GPU is not available."""
    if device not in ("cpu", "cuda"):
        raise ValueError(f"`device` must be 'cpu' or 'cuda' (got {device!r})")
    if device == "cuda" and (problem := device_problem()):
        raise ValueError(f"`device` 'cuda' {problem}")
    return device == "cuda"


def _cells(flux_map: tuple[int, int] | None) -> tuple[int, int] | None:
    if flux_map is None:
        return None
    rows, columns = map(int, flux_map)
    if not (1 <= rows <= _MOST_CELLS and 1 <= columns <= _MOST_CELLS):
        raise ValueError(f"`flux_map` must have 1 to {_MOST_CELLS} rows and columns (got {flux_map})")
    return rows, columns


def _facets(facets: tuple[int, int, float], sides: Floats) -> None:
    columns, rows, gap = facets
    if not (columns >= 1 and rows >= 1 and columns % 1 == rows % 1 == 0 and 0.0 <= gap < np.inf):
        raise ValueError(f"`facets` must have at least 1 column, 1 row and a gap of at least 0 m (got {facets})")
    covered = (sides <= gap * (np.array((columns, rows)) - 1)).any(axis=1)
    _refuse("facets", covered, "is not larger than its gaps; reduce the gap")


def _receiver(receiver: Cylinder | Rectangle) -> kernel.Receiver:
    if not isinstance(receiver, Cylinder | Rectangle):
        raise ValueError(f"`receiver` must be a Cylinder or a Rectangle (got {receiver!r})")
    if not (np.isfinite(receiver).all() and min(receiver[:3]) > 0.0):
        raise ValueError(f"the height and the dimensions of `receiver` must be above 0 (got {receiver})")
    centre = (0.0, 0.0, float(receiver.height))
    if isinstance(receiver, Cylinder):
        return kernel.cylinder(centre, receiver.radius, receiver.height_extent)
    azimuth, tilt = np.radians((receiver.azimuth, receiver.tilt))
    return kernel.rectangle(centre, azimuth, tilt, receiver.width, receiver.height_extent)


def mirror_centres(layout: Any, argument: str = "layout") -> Floats:
    """Return mirror centres, or other points, as an array of shape (N, 3)."""
    if hasattr(layout, "keys"):
        missing = [axis for axis in "xyz" if axis not in layout]
        if missing:
            raise ValueError(f"`{argument}` must have columns x, y and z (lacks {', '.join(missing)})")
        layout = np.stack([np.asarray(layout[axis], np.float64) for axis in "xyz"], axis=1)
    elif hasattr(layout, "x"):
        remedy = "give {'x': layout.x, 'y': layout.y, 'z': layout.z + height of the mirror centres above the bases}"
        raise ValueError(f"`{argument}` must be an array of shape (N, 3) or a table of mirror centres: {remedy}")
    places = np.array(layout, np.float64, ndmin=2)
    if places.ndim != 2 or places.shape[1] != 3 or not len(places):
        raise ValueError(f"`{argument}` must have the shape (N, 3) (got {places.shape})")
    _refuse(argument, ~np.isfinite(places).all(axis=1), "has no finite centre")
    return places


def check_tower(tower: tuple[float, float], centre: Floats) -> None:
    """Raise ValueError if the radius or height of the tower is not above 0, or if a mirror is within the tower."""
    if not (np.isfinite(tower).all() and min(tower) > 0.0):
        raise ValueError(f"`tower` must be a radius and a top above 0 m (got {tower})")
    within = (np.hypot(centre[:, 0], centre[:, 1]) < tower[0]) & (centre[:, 2] < tower[1])
    _refuse("layout", within, "is within the tower; move it or reduce the radius of `tower`")


def _refuse(name: str, wrong: Any, words: str) -> None:
    """Raise a ValueError that lists up to five heliostats with invalid values."""
    if np.any(wrong):
        which = ", ".join(str(each + 1) for each in np.flatnonzero(wrong)[:5])
        raise ValueError(f"`{name}`: heliostat {which} {words} ({int(np.sum(wrong))} of {len(wrong)})")


def _curve(name: str, given: ArrayLike | str, none: str, own: str, slant: Floats) -> Floats:
    """Return the curvature parameters 1 / (2 * focal length) of mirrors, shape (N, 2). [m-1]"""
    if isinstance(given, str):
        if given not in (none, own):
            raise ValueError(f"`{name}` must be '{none}', '{own}' or focal lengths in m (got {given!r})")
        return np.repeat((0.5 / slant * (given == own))[:, np.newaxis], 2, axis=1)
    focal = np.asarray(given, np.float64)
    focal = focal[:, np.newaxis] if focal.ndim == 1 else focal
    if not (focal > 0.0).all():
        raise ValueError(f"`{name}` must be above 0 m; for a flat mirror, give '{none}'")
    return 0.5 / per_item(name, focal, (2,), len(slant))


def _sun_shape(given: str | tuple[Any, ...]) -> sunshapes.SunShape:
    name, *numbers = (given,) if isinstance(given, str) else given
    if _SUN_SHAPES.get(name) != len(numbers):
        words = "pillbox, gaussian, limb_darkened, jose, ('buie', ratio) or ('table', angles, brightness)"
        raise ValueError(f"`sun_shape` must be {words} (got {given!r})")
    if name == "table":
        angle, brightness = (np.asarray(each, np.float64) for each in numbers)
        if not (angle.ndim == 1 and len(angle) > 1 and angle[0] == 0.0 and (np.diff(angle) > 0.0).all()):
            raise ValueError("`sun_shape` must have at least 2 angles that increase from 0 mrad")
        if not angle[-1] <= WIDEST:
            raise ValueError(
                f"`sun_shape` must end at most {WIDEST:g} mrad from the centre of the sun (got {angle[-1]:g})"
            )
        if (
            brightness.shape != angle.shape
            or not (np.isfinite(brightness) & (brightness >= 0.0)).all()
            or not brightness[0]
        ):
            raise ValueError(
                "`sun_shape` must have one brightness for each angle, at least 0 and above 0 at the centre"
            )
        return sunshapes.table(1e-3 * angle, brightness)
    return getattr(sunshapes, name)(*numbers)


def sun_directions(azimuth: ArrayLike, elevation: ArrayLike) -> tuple[Floats, tuple[str, ...], dict[str, Any]]:
    """Return unit vectors to the sun, shape (T, 3), the name of the time dimension, and its coordinates."""
    labels = getattr(azimuth, "coords", None)
    angles = np.broadcast_arrays(*(np.asarray(each, np.float64) for each in (azimuth, elevation)))
    if angles[0].ndim > 1 or not angles[0].size:
        raise ValueError(f"`sun_azimuth` and `sun_elevation` must have one dimension (got the shape {angles[0].shape})")
    dim = str(getattr(azimuth, "dims", ("time",))[0]) if angles[0].ndim else "time"
    coordinates = {} if labels is None else {name: labels[name] for name in labels}
    index = getattr(azimuth, "index", None)
    if index is not None and not callable(index):  # for example, the index of a pandas.Series
        coordinates[dim] = index
    return direction(*map(np.atleast_1d, angles)), (dim,) if angles[0].ndim else (), coordinates


def _rays_for(
    scene: kernel.Scene, suns: list[Floats], weights: Floats | None, rays: int | None, precision: float, cells: Any,
    share: Floats, seed: int, instants: int,
) -> int:  # fmt: skip
    """Return `rays`, or the number of rays per heliostat and instant that is required to reach `precision`."""
    if not 1e-6 <= precision < 1.0:
        raise ValueError(f"`precision` must be at least 1e-6 and below 1 (got {precision:g})")
    if seed < 0:
        raise ValueError(f"`seed` must be at least 0 (got {seed})")
    given: dict[str, Any] = {"precision": precision, "cells": cells, "share": share, "seed": seed}
    if rays is None:
        rays = max((kernel.rays_for(scene, sun, weights, **given) for sun in suns if len(sun)), default=16)
    total = kernel.block_rays(rays) * float(len(share)) * instants
    if total > kernel.MOST_RAYS:
        hours = total / kernel.RAYS_PER_SECOND / 3600.0
        raise ValueError(
            f"{total:.2g} rays would take {hours:,.0f} h on one core: reduce `rays` or increase `precision`"
        )
    return rays


def _efficiencies(sums: Floats, total: float) -> dict[str, tuple[Floats, Floats]]:
    """Return means and standard errors of the efficiencies from sums of shape (replicates, ..., quantities)."""
    index = (kernel.COSINE, kernel.UNSHADED, kernel.UNBLOCKED, kernel.OPTICAL, kernel.LIGHT)
    names = [name for name in _PARTS if name != "intercept_efficiency"]
    found = {name: kernel.mean_error(sums[..., k] / total) for name, k in zip(names, index, strict=True)}
    parts = kernel.intercept(sums[..., kernel.OPTICAL], sums[..., kernel.LIGHT])
    return found | {"intercept_efficiency": kernel.mean_error(parts)}


def _with_error(name: str, dims: tuple[str, ...], pair: Sequence[Any], units: str, words: str) -> dict[str, Any]:
    return {
        f"{name}{label}": (dims, values, {"units": units, "long_name": f"{of}{words}"})
        for (label, of), values in zip((("", ""), ("_error", "standard error: ")), pair, strict=True)
    }


def cell_area(receiver: kernel.Receiver, cells: Any) -> float:
    """Return the area of a receiver cell. [m2]"""
    around = 2.0 * np.pi if receiver.kind == kernel.CYLINDER else 2.0
    return float(around * receiver.half_width * 2.0 * receiver.half_height / (cells[0] * cells[1]))


def _map_variables(maps: Sequence[NDArray[Any]], dims: tuple[str, ...], units: str, words: str) -> dict[str, Any]:
    """Return flux maps, peak fluxes and their standard errors, computed from the maps of all replicates."""
    found = dict[str, Any]()
    for name, cells, of, way in (
        ("flux_map", _CELLS, kernel.mean_error, "mean of each cell"),
        ("peak_flux", (), kernel.peak, "maximum over the cells"),
    ):
        pair = [np.array(values) for values in zip(*map(of, maps), strict=True)]
        pair = pair if dims else [values[0] for values in pair]
        found |= _with_error(name, (*dims, *cells), pair, units, f"{words}, {way}")
    return found


def _dataset(
    variables: dict[str, Any], coordinates: dict[str, Any], scene: kernel.Scene, layout: Any, rays: int, seed: int
) -> xr.Dataset:
    """Return a data set with heliostats labelled by the index of the layout or by numbers from 1."""
    attributes = {"rays": kernel.block_rays(rays), "seed": seed}
    return xr.Dataset(variables, {**heliostat_coordinates(layout, scene.centre), **coordinates}, attributes)


def heliostat_coordinates(layout: Any, centre: Floats, point: str = "mirror's centre") -> dict[str, Any]:
    """Return the labels and positions of heliostats as coordinates.

    The labels are the index of the layout, or numbers from 1 if the layout has no index.
    """
    index = getattr(layout, "index", None)
    places = {
        axis: ("heliostat", centre[:, k], {"units": "m", "long_name": f"{words} of the {point}"})
        for k, (axis, words) in enumerate((("x", "east"), ("y", "north"), ("z", "height")))
    }
    return {"heliostat": np.arange(1, len(centre) + 1) if index is None or callable(index) else index, **places}
