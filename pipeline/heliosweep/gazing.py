"""Backward gazing without a study file: mirror slopes from camera images of the reflected sun.

Azimuths are measured from south and are positive towards east. On the mirror, y points to the right and z points up, as
seen from the cameras at the target. Slopes are the horizontal and vertical components of the normal relative to an
ideal spherical mirror. Angles are in degrees, and slopes are in milliradians. Brightness is relative to the centre of
the solar disc.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.compiled import Floats, Integers
from heliosweep.kernels.gazing import geometry
from heliosweep.kernels.gazing import slopes as linear
from heliosweep.kernels.gazing.slopes import UNLIT, SlopeFit, fit_slopes, graduated, look_back
from heliosweep.kernels.profiles import Profile, jose, render, smooth_fit, tabulated
from heliosweep.lazy import xr

METHODS = ("A", "O1", "O2", "LM")
#: Maximum number of cells in a map.
MAX_CELLS = 1_000_000


def gazing_scene(
    sun_azimuth: float, sun_elevation: float, target_azimuth: float, target_elevation: float, *,
    distance: float = 120.0, focal_length: float | None = None, cameras: str | ArrayLike = "square",
    radius: float = 0.24, tilt: float = 30.0, face: float = 0.0,
) -> geometry.Scene:  # fmt: skip
    """Create a scene with the sun, the mirror, the target and the cameras.

    Parameters
    ----------
    sun_azimuth, sun_elevation : float
        Azimuth and elevation of the sun. [deg]
    target_azimuth, target_elevation : float
        Azimuth and elevation of the target as seen from the mirror. [deg]
    distance : float
        Distance between the centres of the mirror and the target. [m]
    focal_length : float, optional
        Focal length of the ideal mirror (default: the distance). [m]
    cameras : {'square', 'cross'} or array, shape (K, 2)
        Arrangement of four cameras, or positions of K cameras in the target plane. If the target faces north, the first
        coordinate points east. The second coordinate points up. [m]
    radius : float
        Distance of each of the four cameras from the target centre. [m]
    tilt : float
        Tilt of the target from the vertical, positive if the target faces down. [deg]
    face : float
        Rotation of the target about the vertical, 0 if the mirror is to the north. [deg]

    Returns
    -------
    Scene
        Scene for `render_images` and `reconstruct_slopes`.

    Raises
    ------
    ValueError
        If the sun is opposite the target, if there are fewer than three cameras, or if all cameras lie on one line as
        seen from the mirror.

    Examples
    --------
    >>> import heliosweep
    >>> round(heliosweep.gazing_scene(30.0, 60.0, 0.0, 44.0).incidence, 3)
    0.21
    """
    (sun, up), (target, above), (leaning, turn) = np.radians(
        ((sun_azimuth, sun_elevation), (target_azimuth, target_elevation), (tilt, face))
    ).tolist()
    places = geometry.camera_square(radius, cameras) if isinstance(cameras, str) else cameras
    ideal = distance if focal_length is None else focal_length
    return geometry.scene((sun, up), (target, above), places, distance, ideal, leaning, turn)


def render_images(scene: geometry.Scene, slope_x: Any, slope_y: Any, y: ArrayLike | None = None,
                  z: ArrayLike | None = None, *, sun_profile: Any = None) -> Any:  # fmt: skip
    """Render camera images of a mirror with given slopes.

    Parameters
    ----------
    scene : Scene
        Scene with K cameras, from `gazing_scene`.
    slope_x, slope_y : array or DataArray, shape (nz, ny)
        Horizontal and vertical slopes relative to the ideal mirror; NaN outside the mirror. [mrad]
    y, z : array, shape (ny,) and (nz,), optional
        Positions on the mirror (default: coordinates of `slope_x`). [m]
    sun_profile : (array, array), optional
        Angles from the centre of the solar disc in ascending order from 0 [mrad], and brightness at these angles [1]
        (default: Jose's formula).

    Returns
    -------
    DataArray, dimensions camera, z and y
        Brightness relative to the centre of the solar disc; 0 outside the disc and NaN outside the mirror. [1]

    Raises
    ------
    ValueError
        If the shapes do not match, or if the sun profile is not darker at the edge than at the centre.

    References
    ----------
    Defieux, Caliot and Henault (2020), AIP Conf. Proc. 2303, 100002, doi 10.1063/5.0029270, Eqs. 1 to 7.

    Examples
    --------
    >>> import heliosweep, numpy
    >>> scene = heliosweep.gazing_scene(30.0, 60.0, 0.0, 44.0)
    >>> flat = numpy.zeros((1, 2))
    >>> heliosweep.render_images(scene, flat, flat, y=[0.0, 3.0], z=[0.0]).round(2).values[0].tolist()
    [[0.97, 0.95]]
    """
    y, z, slopes = _on_grid(slope_x, y, z, slope_x, slope_y)
    profile, pixels = _profile(sun_profile), _pixels(y, z)
    square = look_back(scene, profile, pixels, 1e-3 * slopes.reshape(2, -1))[0]
    images = np.where(np.isnan(square), np.nan, render(profile, np.sqrt(square)))
    words = {"units": "1", "long_name": "brightness relative to the centre of the sun"}
    return _labelled(images.reshape(-1, z.size, y.size), ("camera",), y, z, words)


def reconstruct_slopes(scene: geometry.Scene, images: Any, y: ArrayLike | None = None, z: ArrayLike | None = None, *,
                       method: str = "LM", referential: str = "exact", threshold: float = 0.3, fit_gain: bool = False,
                       sun_profile: Any = None) -> Any:  # fmt: skip
    """Reconstruct mirror slopes from camera images of the reflected sun.

    Parameters
    ----------
    scene : Scene
        Scene with K cameras, from `gazing_scene`.
    images : array or DataArray, shape (K, nz, ny)
        Brightness of points on the mirror, relative to the centre of the solar disc; NaN for pixels to ignore. [1]
    y, z : array, shape (ny,) and (nz,), optional
        Positions on the mirror (default: coordinates of `images`). [m]
    method : {'LM', 'A', 'O1', 'O2'}
        Levenberg-Marquardt fit with backward ray tracing ('LM'), linear least squares ('A'), Nelder-Mead fit of the
        wavefront ('O1'), or Nelder-Mead fit with backward ray tracing ('O2').
    referential : {'exact', 'roll', 'none'}
        Conversion from the wavefront frame to the mirror frame, used by the methods A and O1.
    threshold : float
        Minimum brightness at which a camera counts as lit. [1]
    fit_gain : bool
        If True, fit a gain for each pixel that is common to all cameras. Method A ignores this option.
    sun_profile : (array, array), optional
        As in `render_images`.

    Returns
    -------
    Dataset, dimensions z and y
        The variables `slope_x` and `slope_y` are the horizontal and vertical slopes relative to the ideal mirror; NaN
        if fewer than three cameras are lit [mrad]. The variable `lit_cameras` is the number of lit cameras. The
        variable `quality` is a sum of flags: 1 if the fit did not converge, 2 if fewer than three cameras are lit, and
        4 if a camera looks outside the solar disc.

    Raises
    ------
    ValueError
        If the shapes do not match, or if the method or referential is unknown.

    References
    ----------
    Defieux, Caliot and Henault (2020), AIP Conf. Proc. 2303, 100002, doi 10.1063/5.0029270.

    Examples
    --------
    >>> import heliosweep, numpy
    >>> scene = heliosweep.gazing_scene(30.0, 60.0, 0.0, 44.0)
    >>> images = heliosweep.render_images(scene, numpy.full((1, 2), 0.3), numpy.zeros((1, 2)), y=[0.0, 3.0], z=[0.0])
    >>> heliosweep.reconstruct_slopes(scene, images).slope_x.round(3).values.tolist()
    [[0.3, 0.3]]
    """
    if method not in METHODS or referential not in geometry.REFERENTIALS:
        raise ValueError(f"unknown `method` {method!r} or `referential` {referential!r}")
    y, z, values = _on_grid(images, y, z, *images)
    rows = geometry.REFERENTIALS.index(referential)
    if len(values) != len(scene.eyes):
        raise ValueError(f"`images` must contain images from {len(scene.eyes)} cameras (got {len(values)})")
    found = find_slopes(scene, _profile(sun_profile), values.reshape(len(values), -1), _pixels(y, z),
                        threshold, (method,), (rows,), fit_gain)  # fmt: skip
    words: dict[str, dict[str, Any]] = {
        f"slope_{axis}": {"units": "mrad", "long_name": f"{way} slope relative to the ideal mirror"}
        for axis, way in (("x", "horizontal"), ("y", "vertical"))
    }
    words |= {"lit_cameras": {"units": "1"}, "quality": {"flag_masks": np.array([1, 2, 4], np.int8),
              "flag_meanings": "not_converged fewer_than_three_cameras_lit beside_the_disc"}}  # fmt: skip
    made = (*1e3 * found.slopes[0, 0], np.bitwise_count(found.lit), found.quality[0])
    return xr.Dataset({
        name: _labelled(np.reshape(each, (z.size, y.size)), (), y, z, attrs)
        for (name, attrs), each in zip(words.items(), made, strict=True)
    })  # fmt: skip


def grid_slopes(points: ArrayLike, normals: ArrayLike, *, step: float = 0.05) -> Any:
    """Average the slopes of a measured surface on a regular grid.

    Parameters
    ----------
    points : array, shape (n, 2) or (n, 3)
        Points on the mirror relative to its centre. The first two components point to the right and up as seen from the
        target. [m]
    normals : array, shape (n, 3)
        Surface normals of any length, with components to the right, up and towards the target.
    step : float
        Side length of a grid cell. [m]

    Returns
    -------
    xarray.Dataset
        Slopes `slope_x` and `slope_y` relative to the mirror plane, with the dimensions ``z`` (up) and ``y`` (right).
        Slopes are positive to the right and upwards, and NaN in cells without points [mrad]. A NetCDF file with these
        slopes can be used as `optics.slope_map`; the slopes then replace focus and canting.

    Raises
    ------
    ValueError
        If the shapes do not match, the step is not above 0, the grid has more than one million cells, or a normal
        points away from the target.

    Examples
    --------
    >>> import heliosweep
    >>> points = [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)]
    >>> heliosweep.grid_slopes(points, [(0.001, 0.0, 1.0)] * 4, step=1.0).slope_x.values.tolist()
    [[1.0, 1.0], [1.0, 1.0]]
    """
    place, normal = np.asarray(points, np.float64), np.asarray(normals, np.float64)
    if place.ndim != 2 or normal.shape != (len(place), 3) or not len(place) or not (normal[:, 2] > 0.0).all():
        raise ValueError(f"`points` and `normals` must have the shapes (n, 2) and (n, 3), and normals must point to "
                         f"the target (got {place.shape} and {normal.shape})")  # fmt: skip
    half = np.ceil(np.abs(place[:, :2]).max(axis=0) / step - 1e-9) if step > 0.0 else np.full(2, np.inf)
    if not 4.0 * np.prod(half) <= MAX_CELLS:
        raise ValueError(f"`step` must be above 0 m and give at most {MAX_CELLS:,} cells (got {step:g})")
    columns, rows = (2 * np.maximum(half, 1.0)).astype(int).tolist()
    row, column = (
        np.clip(np.floor(place[:, k] / step).astype(int) + size // 2, 0, size - 1)
        for k, size in ((1, rows), (0, columns))
    )
    cell, size = row * columns + column, rows * columns
    with np.errstate(invalid="ignore"):
        means = [
            np.bincount(cell, 1e3 * normal[:, k] / normal[:, 2], size) / np.bincount(cell, minlength=size)
            for k in (0, 1)
        ]
    y, z = ((np.arange(count) - (count - 1) / 2) * step for count in (columns, rows))
    return xr.Dataset({
        f"slope_{axis}": _labelled(mean.reshape(rows, columns), (), y, z, {
            "units": "mrad", "long_name": f"{way} slope relative to the plane of the mirror", "reference": "plane",
        })
        for axis, way, mean in zip("xy", ("horizontal", "vertical"), means, strict=True)
    })  # fmt: skip


class Found(NamedTuple):
    """Slopes reconstructed with M methods and T referentials.

    Attributes
    ----------
    slopes : ndarray, shape (M, T, 2, N)
        Slopes relative to the ideal mirror; NaN if fewer than 3 cameras are lit. [rad]
    lit : ndarray of int, shape (N,)
        Bit field for each pixel, in which bit i is set if camera i is lit.
    quality : ndarray of int, shape (M, N)
        Bit field of the flags NOT_CONVERGED, UNLIT and OUTSIDE, which are defined in `kernels.gazing.slopes`.
    fit : SlopeFit or None
        Result of method LM, or None if LM is not among the methods.
    evaluations : ndarray, shape (M,)
        Mean number of merit function evaluations over all fitted pixels; 0 for method A.
    """

    slopes: Floats
    lit: Integers
    quality: Integers
    fit: SlopeFit | None
    evaluations: Floats


def find_slopes(
    layout: geometry.Scene, profile: Profile, images: Floats, pixels: Floats, threshold: float,
    methods: Sequence[str], referentials: Sequence[int], fit_gain: bool = False, smooth: bool = False,
) -> Found:  # fmt: skip
    """Reconstruct slopes with several methods from images of shape (K, N) at pixel positions of shape (2, N) [m].

    Each referential is a row index into `geometry.transfers`. If `smooth` is True, method LM uses only the smooth fit
    of a tabulated sun profile.
    """
    every = geometry.transfers(layout)
    matrices = np.ascontiguousarray(every[list(referentials)])
    ideal = look_back(layout, profile, pixels, np.zeros_like(pixels))[0]
    departures, lit = linear.wavefront_departures(images, ideal, linear.solutions(layout.gaze), profile, threshold)
    start = linear.transferred(departures, every[geometry.EXACT :])[0]
    slopes = np.empty((len(methods), len(matrices), *pixels.shape))
    quality = np.zeros((len(methods), pixels.shape[1]), np.int64)
    evaluations, fit = np.zeros(len(methods)), None
    for row, method in enumerate(methods):
        if method == "A":
            slopes[row], quality[row] = linear.transferred(departures, matrices), UNLIT * ~np.isfinite(departures[0])
            continue
        wavefront = linear.ideal_wavefront(layout, ideal)
        stages = [smooth_fit(profile)] if smooth and profile.table.size > 3 else graduated(profile)
        found = fit_slopes(
            method, layout, stages if method == "LM" else profile, images,
            wavefront + departures if method == "O1" else start, pixels, threshold=threshold, fit_gain=fit_gain,
        )  # fmt: skip
        o1 = method == "O1"
        slopes[row] = linear.transferred(found.slopes - wavefront, matrices) if o1 else found.slopes
        quality[row], fit = found.flags, found if method == "LM" else fit
        spent = found.evaluations[found.evaluations > 0]
        evaluations[row] = spent.mean() if spent.size else 0.0
    return Found(slopes, lit, quality, fit, evaluations)


def _profile(given: Any) -> Profile:
    return jose() if given is None else tabulated(given[1], angle=1e-3 * np.asarray(given[0], np.float64))


def _on_grid(first: Any, y: ArrayLike | None, z: ArrayLike | None, *maps: Any) -> tuple[Floats, Floats, Floats]:
    """Return the positions along y and z, and all maps as one array of shape (maps, nz, ny)."""
    labels = getattr(first, "coords", {})
    places = [labels.get(name) if given is None else given for name, given in (("y", y), ("z", z))]
    if any(each is None for each in places):
        raise ValueError("give `y` and `z`, or a DataArray with these coordinates")
    y, z = (np.asarray(each, np.float64) for each in places)
    values = np.array([each.transpose("z", "y") if hasattr(each, "dims") else each for each in maps], np.float64)
    if values.shape[1:] != (z.size, y.size):
        raise ValueError(f"maps must have {z.size} x {y.size} values along z and y (got {values.shape[1:]})")
    return y, z, values


def _pixels(y: Floats, z: Floats) -> Floats:
    """Return the positions y and z of all pixels in a grid, shape (2, N)."""
    return np.array([np.tile(y, z.size), np.repeat(z, y.size)])


def _labelled(values: Floats, dims: tuple[str, ...], y: Floats, z: Floats, attrs: dict[str, Any]) -> Any:
    """Return a DataArray with the dimensions `dims`, z and y. Cameras are numbered from 1."""
    labels = {"z": ("z", z, {"units": "m"}), "y": ("y", y, {"units": "m"})}
    numbers: Any = {"camera": np.arange(1, len(values) + 1)} if dims else {}
    return xr.DataArray(values, {**numbers, **labels}, (*dims, "z", "y"), attrs=attrs)
