"""Tracking error, effective tracking factor and tolerable tilt of dishes on tilted mounts, without a study file.

Sun azimuths run clockwise from north. The tilt direction is the direction in which the foot of the azimuth axis leans,
measured from south and positive towards west. Angles are in degrees; tracking errors and tolerances are in
milliradians.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels import dish as kernel
from heliosweep.kernels.compiled import Floats
from heliosweep.lazy import xr
from heliosweep.sun import direction

#: Models of a tilted mount and their codes in the kernel.
MODELS = {"rigid": kernel.RIGID, "untilted_home_axes": kernel.UNTILTED_HOME_AXES}
#: Mount errors other than the tilt, in the order that `window_factors` expects. [deg]
ERRORS = (
    "home_azimuth_offset", "home_elevation_offset", "azimuth_reference", "non_orthogonality", "collimation"
)  # fmt: skip
#: Tilts at which the factor is computed to bracket the root in `largest_tilt`. [deg]
SCAN = np.array([0.0, *np.geomspace(1e-3, 45.0, 48)])


def tracking_error(
    sun_azimuth: ArrayLike, sun_elevation: ArrayLike, axis_tilt: ArrayLike, axis_tilt_direction: ArrayLike = 0.0, *,
    model: str = "rigid", **errors: ArrayLike,
) -> Any:  # fmt: skip
    """Compute the angle between the sun and the focal axis of a dish.

    Parameters
    ----------
    sun_azimuth, sun_elevation : float, array or DataArray, shape (T,)
        Azimuth and elevation of the sun. [deg]
    axis_tilt : float, array or DataArray
        Tilt of the azimuth axis from the vertical, from 0 to 90. [deg]
    axis_tilt_direction : float, array or DataArray
        Direction in which the foot of the axis leans: 0 south, 90 west. [deg]
    model : {'rigid', 'untilted_home_axes'}
        Tilt model: the whole mount leans ('rigid'), or only the azimuth axis leans and the home positions of the other
        axes do not change ('untilted_home_axes').
    **errors : float, array or DataArray
        Other mount errors: ``home_azimuth_offset`` and ``home_elevation_offset``; ``azimuth_reference``, the excess
        rotation of the mount, clockwise as seen from above; ``non_orthogonality`` of the elevation axis, positive if
        the end to the right of the focal axis is lower; and ``collimation`` of the focal axis, positive to the right.
        All errors are broadcast against the tilt. [deg]

    Returns
    -------
    float, array or DataArray, shape (..., T)
        Tracking error of each mount at each instant. [mrad]

    Raises
    ------
    ValueError
        If the model or an error is unknown, or if a tilt is outside its range.

    References
    ----------
    Liu, Peng and Yan (2022), Energies 15, 3261, doi 10.3390/en15093261.

    Examples
    --------
    >>> import heliosweep
    >>> heliosweep.tracking_error([90.0, 180.0], 30.0, axis_tilt=0.1).round(3).tolist()
    [0.873, 1.745]
    """

    def each_instant(sun: Floats, *mount: Floats) -> Floats:
        windows = kernel.pack_windows(sun, np.arange(len(sun) + 1))
        return window_factors(model, windows, False, mount[0], mount[1], np.array(1.0), *mount[2:])[1]

    words = {"units": "mrad", "long_name": "tracking error"}
    return _of_mounts(each_instant, sun_azimuth, sun_elevation, (axis_tilt, axis_tilt_direction), errors, words, True)


def tracking_factor(
    sun_azimuth: ArrayLike, sun_elevation: ArrayLike, axis_tilt: ArrayLike, axis_tilt_direction: ArrayLike = 0.0,
    tolerance: ArrayLike = 4.0, *, model: str = "rigid", clip: bool = False, **errors: ArrayLike,
) -> Any:  # fmt: skip
    """Compute the effective tracking factor.

    The factor is 1 minus the ratio of the mean tracking error to the tolerance.

    Parameters
    ----------
    sun_azimuth, sun_elevation, axis_tilt, axis_tilt_direction, model, **errors
        As in `tracking_error`. The mean error is computed over all instants.
    tolerance : float, array or DataArray
        Tracking error at which the factor is zero. [mrad]
    clip : bool
        If True, tracking errors are clipped to `tolerance`.

    Returns
    -------
    float, array or DataArray
        Tracking factor of each mount; 1 for perfect tracking, negative if the mean error exceeds the tolerance. [1]

    Raises
    ------
    ValueError
        As in `tracking_error`, or if a tolerance is not positive.

    References
    ----------
    Liu, Peng and Yan (2022), Energies 15, 3261, doi 10.3390/en15093261, Eqs. 14 to 16.

    Examples
    --------
    >>> import heliosweep
    >>> round(heliosweep.tracking_factor([90.0, 180.0], 30.0, axis_tilt=0.1), 3)
    0.673
    """

    def all_instants(sun: Floats, *mount: Floats) -> Floats:
        return window_factors(model, kernel.pack_windows(sun, [0, len(sun)]), clip, *mount)[0]

    words = {"units": "1", "long_name": "effective tracking factor"}
    mount = axis_tilt, axis_tilt_direction, tolerance
    return _of_mounts(all_instants, sun_azimuth, sun_elevation, mount, errors, words)


def tolerable_tilt(
    sun_azimuth: ArrayLike, sun_elevation: ArrayLike, required_factor: ArrayLike, axis_tilt_direction: ArrayLike = 0.0,
    tolerance: ArrayLike = 4.0, *, model: str = "rigid", clip: bool = False, **errors: ArrayLike,
) -> Any:  # fmt: skip
    """Compute the maximum tilt of the azimuth axis for a required tracking factor.

    Parameters
    ----------
    sun_azimuth, sun_elevation, axis_tilt_direction, tolerance, model, clip, **errors
        As in `tracking_factor`.
    required_factor : float, array or DataArray
        Required effective tracking factor. [1]

    Returns
    -------
    float, array or DataArray
        Maximum tilt; 0 if no tilt meets the requirement, NaN if a tilt of 45 deg meets the requirement. [deg]

    Raises
    ------
    ValueError
        As in `tracking_factor`.

    Examples
    --------
    >>> import heliosweep
    >>> round(heliosweep.tolerable_tilt([90.0, 180.0], 30.0, required_factor=0.673), 2)
    0.1
    """

    def search(sun: Floats, required: Floats, *mount: Floats) -> Floats:
        windows = kernel.pack_windows(sun, [0, len(sun)])
        factor = partial(window_factors, model, windows, clip)
        return largest_tilt(lambda *tilted: factor(*tilted)[0][..., 0], required, *mount)[..., np.newaxis]

    words = {"units": "degree", "long_name": "tolerable tilt of the azimuth axis"}
    mount = required_factor, axis_tilt_direction, tolerance
    return _of_mounts(search, sun_azimuth, sun_elevation, mount, errors, words)


def dish_intercept(
    tracking_error: ArrayLike, *, focal_length: float, diameter: float, aperture_radius: float, spread: float
) -> Any:
    """Compute the fraction of light from a paraboloid that enters a circular aperture at the focus.

    The light from each mirror point has a Gaussian distribution about the direction of the reflected ray. The distance
    from the mirror point to the focus is rho = 2 f / (1 + cos theta), where f is the focal length and theta is the
    angle between the mirror point and the axis as seen from the focus. A deviation of the ray shifts the light in the
    focal plane by rho times the tangential deviation and by rho / cos theta times the radial deviation. The tracking
    error deviates the light from all mirror points.

    Parameters
    ----------
    tracking_error : float, array or DataArray
        Angle between the sun and the focal axis of the dish. [mrad]
    focal_length, diameter : float
        Focal length and diameter of the dish, with a rim angle below 90 deg. [m]
    aperture_radius : float
        Radius of the aperture, which is perpendicular to the axis and centred at the focus. [m]
    spread : float
        Standard deviation per axis of the direction of a reflected ray, due to the sun shape, twice the slope error,
        and specularity. [mrad]

    Returns
    -------
    float, array or DataArray
        Fraction of the light that enters the aperture, weighted by the projected mirror area. [1]

    Raises
    ------
    ValueError
        If a length or the spread is not positive, or the rim angle is 90 deg or more.

    Notes
    -----
    The angle between a deviation and the meridian of a mirror point is uniformly distributed, because the dish and the
    light are symmetric. The deviation is Gaussian about the tracking error, so its magnitude has a Rice distribution.
    For each mirror point, light enters the aperture up to a maximum deviation. The result is the mean of the Rice
    distribution function at these maxima. The result is accurate to 1e-5 for rim angles up to 80 deg, and to 1e-4 for
    larger rim angles.

    Examples
    --------
    >>> import heliosweep
    >>> dish = {"focal_length": 5.0, "diameter": 10.0, "aperture_radius": 0.07, "spread": 4.0}
    >>> heliosweep.dish_intercept([0.0, 4.0, 8.0], **dish).round(3).tolist()
    [0.959, 0.9, 0.687]
    """
    from scipy.interpolate import CubicSpline
    from scipy.special import i0e

    sizes = np.array([focal_length, diameter, aperture_radius, spread])
    if not (sizes > 0.0).all() or not np.isfinite(sizes).all() or diameter >= 4.0 * focal_length:
        raise ValueError(
            "lengths and `spread` must be above 0, and `diameter` must be below four times the focal length"
        )
    # Mirror points are evenly spaced in area. Deviations are evenly spaced in the angle from the meridian.
    radius = 0.5 * diameter * np.sqrt(_middles(1000))[:, np.newaxis]
    angle = 0.5 * np.pi * _middles(200)
    theta = 2.0 * np.arctan(0.5 * radius / focal_length)
    along = 2.0 * focal_length / (1.0 + np.cos(theta))
    limit = np.sort(aperture_radius / np.hypot(along / np.cos(theta) * np.cos(angle), along * np.sin(angle)), axis=None)
    width, wanted = 1e-3 * spread, np.abs(np.asarray(tracking_error, np.float64)) * 1e-3
    tail = 6.0  # cut-off of the Gaussian, in standard deviations
    # All light passes for errors below `low`, and no light passes for errors above `high`.
    low, high = max(0.0, limit[0] - tail * width), limit[-1] + tail * width
    error = np.clip(wanted, low, high)
    high = min(high, max(float(np.nanmax(error, initial=low)), low + width))
    known = np.linspace(low, high, min(max(math.ceil(8.0 * (high - low) / width), 8), 2048) + 1)
    # Fraction of the mirror whose light passes at each deviation, averaged over cells with a width of 1/128 of the
    # spread.
    cell = width / 128.0
    first = np.floor(known / cell)[:, np.newaxis] + np.arange(-128.0 * tail, 128.0 * tail + 1.0)
    edges = np.maximum(first * cell, 0.0)
    below, total = np.searchsorted(limit, edges), np.append(0.0, np.cumsum(limit))
    passing = np.diff(total[below] + edges * (limit.size - below)) / limit.size
    deviation = 0.5 * (edges[:, 1:] + edges[:, :-1]) / width
    apart = known[:, np.newaxis] / width
    light = deviation * np.exp(-0.5 * (deviation - apart) ** 2) * i0e(deviation * apart)
    share = np.sum(light * passing, axis=1) / np.sum(light * np.diff(edges), axis=1)
    found = np.clip(CubicSpline(known, share)(error), 0.0, 1.0)
    labelled: Any = tracking_error
    if hasattr(labelled, "coords"):
        return labelled.copy(data=found).assign_attrs(units="1", long_name="intercept of the dish")
    return found if np.ndim(tracking_error) else float(found)


def _middles(count: int) -> Floats:
    return (np.arange(count) + 0.5) / count


def window_factors(
    model: str, windows: kernel.Windows, clip: bool, tilt: Floats, direction: Floats, tolerance: Floats, *errors: Floats
) -> tuple[Floats, Floats, Floats]:
    """Compute the tracking factors and tracking errors of mounts in time windows.

    Parameters
    ----------
    model, tilt, direction, tolerance, clip
        As in `tracking_factor`. Arrays are broadcast against each other. [deg, mrad]
    windows : kernels.dish.Windows
        Instants in W time windows.
    *errors : ndarray
        Mount errors in the order of `ERRORS`. [deg]

    Returns
    -------
    tuple of ndarray, each of shape (..., W)
        Tracking factor [1], mean tracking error [mrad] and maximum tracking error [mrad]; NaN for a window without
        instants.
    """
    if model not in MODELS:
        raise ValueError(f"unknown `model` {model!r}: use one of {', '.join(MODELS)}")
    if not (np.all((tilt >= 0.0) & (tilt <= 90.0)) and np.all(tolerance > 0.0)):
        raise ValueError("`axis_tilt` must be between 0 and 90 deg, and `tolerance` must be positive")
    limit = tolerance * 1e-3
    further = dict(zip(("home_azimuth", "home_elevation", *ERRORS[2:]), map(np.radians, errors), strict=True))
    mean, largest, clipped = kernel.window_errors(
        MODELS[model],
        windows,
        np.radians(tilt),
        np.radians(direction),
        tolerance=limit if clip else math.inf,
        **further,
    )
    return 1.0 - (clipped if clip else mean) / limit[..., np.newaxis], mean * 1e3, largest * 1e3


def largest_tilt(least: Callable[..., Floats], required: Floats, *mount: Floats) -> Floats:
    """Return the maximum tilt at which the minimum factor of a mount meets the requirement.

    A tilt can compensate for a home offset, so the factor may increase with the tilt before it decreases. Therefore,
    the factor is first computed at the tilts in `SCAN`. The root is then found between the last of these tilts that
    meets the requirement and the next tilt. A separate range of larger tilts that also meets the requirement is missed
    if it is narrower than a step of the scan.

    Parameters
    ----------
    least : callable
        Function that returns minimum factors for tilts [deg] and the arrays in `mount`.
    required, *mount : ndarray
        Required factors [1] and other properties of the mounts. All arrays are broadcast against each other.

    Returns
    -------
    ndarray
        Maximum tilts; 0 if no tilt meets the requirement, NaN if the largest tilt in `SCAN` meets the requirement or if
        the factor of the mount is NaN. [deg]
    """
    from scipy.optimize.elementwise import find_root

    ndim = max(map(np.ndim, (required, *mount)))
    tried, last = least(SCAN.reshape(-1, *[1] * ndim), *mount), len(SCAN) - 1
    enough = tried >= required
    place = np.where(enough.any(axis=0), last - np.argmax(enough[::-1], axis=0), -1)
    low, high = SCAN[np.maximum(place, 0)], SCAN[np.clip(place + 1, 0, last)]
    found = find_root(
        lambda tilt, wanted, *other: least(tilt, *other) - wanted, (low, high), args=(required, *mount),
        tolerances={"xatol": 0.0, "xrtol": 1e-13},
    )  # fmt: skip
    root = np.where(found.f_x >= 0.0, found.x, found.bracket[0])
    return np.where(np.isnan(tried[0]) | (place == last), np.nan, np.where(place < 0, 0.0, root))


def _of_mounts(
    function: Callable[..., Floats], azimuth: ArrayLike, elevation: ArrayLike, mount: tuple[ArrayLike, ...],
    errors: Mapping[str, ArrayLike], words: Mapping[str, str], series: bool = False,
) -> Any:  # fmt: skip
    """Call a function with unit vectors to the sun, shape (T, 3), and the properties and errors of the mounts.

    The function must return an array of shape (..., T), or (..., 1) if `series` is False. The result is a DataArray if
    any argument is a DataArray.
    """
    if unknown := sorted(set(errors) - set(ERRORS)):
        raise ValueError(f"unknown mount error {unknown[0]!r}: use {', '.join(ERRORS)}")
    labelled = [each for each in (azimuth, elevation) if isinstance(each, xr.DataArray)]
    dim = next((str(each.dims[0]) for each in labelled if each.ndim), "time")
    sun = direction(*np.atleast_1d(azimuth, elevation))
    series = series and np.ndim(azimuth) + np.ndim(elevation) > 0

    def called(*values: ArrayLike) -> Floats:
        found = function(sun, *(np.asarray(each, np.float64) for each in values))
        return found if series else found[..., 0]

    given = [*mount, *(errors.get(name, 0.0) for name in ERRORS)]
    if labelled and np.ndim(given[0]) == 0:
        given[0] = xr.DataArray(given[0])
    found = xr.apply_ufunc(called, *given, output_core_dims=[[dim] if series else []])
    if not isinstance(found, xr.DataArray):
        return found if found.ndim else float(found)
    return found.assign_coords(labelled[0].coords if series and labelled else {}).assign_attrs(words)
