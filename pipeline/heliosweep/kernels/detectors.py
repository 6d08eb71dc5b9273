"""Detector lines on the receiver plane: where deviation curves cross them, and what the crossings say of the mirror.

A heliostat whose facets carry reflecting cylinders, or that sweeps through an error, draws a whole deviation curve;
detectors along lines l0 y + l1 z = l2 see where it crosses them (Optics Express 27 (8), A257 (2019), Sect. 4.3).

From one point of each of the two curves of a mirror (vertical primary axis, mirror centre fixed) its normal follows
exactly. With the vectors v from the mirror centre to the points, k = S + v / |v| is along the normal that sent the ray
there. About the elevation axis this normal keeps the mirror's azimuth; about the azimuth axis its angle to
h = (sin az, cos az, 0) and z keeps the ratio of the mirror's own:

    azimuth = azimuth of S + v_el / |v_el|,   tan(elevation) = k_z / (k.h),  k = S + v_az / |v_az|
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.deviation import curve_of, draws_conic, face_vectors, prepared, spot_at
from heliosweep.kernels.receiver import REACHES, Setting
from heliosweep.kernels.tolerances import crossing_cotangent, first_crossing
from heliosweep.kernels.vectors import at_angle

__all__ = ["crossings", "detector_inversion"]

Floats = NDArray[np.float64]


def crossings(
    setting: Setting, source: ArrayLike, axis: ArrayLike, lines: ArrayLike, sun: ArrayLike, pivots: ArrayLike
) -> Floats:
    """Where deviation curves first cross detector lines; other parameters as in `deviation.deviation_spots`.

    Parameters
    ----------
    lines : array_like, shape (L, 3)
        Coefficients l0, l1 [1] and l2 [m] of the lines l0 y + l1 z = l2; l0 and l1 not both 0.

    Returns
    -------
    ndarray, shape (3, P, H, T, L)
        y and z [m] of the crossing and the error [rad] with its sign: of all crossings by real rays the one of
        smallest |error|. NaN where there is none, or the spot of no error does not reach the plane.

    Raises
    ------
    ValueError
        As `deviation.prepared`, and for lines of another shape or without a direction.
    """
    settings, sources, axes, suns, places = prepared(setting, source, axis, sun, pivots)
    detectors = np.require(lines, np.float64, ["C", "W", "O"])
    if detectors.ndim != 2 or detectors.shape[1] != 3 or not np.all(np.any(detectors[:, :2] != 0.0, axis=1)):
        raise ValueError("lines must have the shape (number, 3), with l0 and l1 not both 0")
    out = np.full((3, len(sources), places.shape[1], suns.shape[1], len(detectors)), np.nan)
    fill_crossings(settings, sources, axes, detectors, suns, places, out)
    return out


@kernel
def fill_crossings(
    setting: Setting,
    source: NDArray[np.int64],
    axis: NDArray[np.int64],
    lines: Floats,
    sun: Floats,
    pivots: Floats,
    out: Floats,
) -> None:
    for p in range(len(source)):
        closed = draws_conic(source[p], axis[p], setting.mirror_offset[p], setting.pedestal_height[p])
        face = face_vectors(setting.face_azimuth[p], setting.face_tilt[p])
        for h in range(pivots.shape[1]):
            for t in range(sun.shape[1]):
                curve = curve_of(setting, p, face, source[p], axis[p], sun, pivots, h, t)
                _, _, status = spot_at(curve, face, 1.0, 0.0)
                if curve.status != REACHES or status != REACHES:
                    continue
                n = at_angle(curve.normal, 1.0, 0.0)
                for i in range(len(lines)):
                    line = (lines[i, 0], lines[i, 1], lines[i, 2])
                    if line[2] == 0.0:
                        # through the aim point: crossed by the spot of no error
                        error = 0.0
                    elif closed:
                        cotangent, side = crossing_cotangent(curve.sun, n, curve.axis, curve.centre[0], face, line)
                        error = side * math.atan2(1.0, cotangent) if cotangent > -math.inf else math.nan
                    else:
                        up = first_crossing(curve, face, (line,), 1.0, math.pi)
                        down = first_crossing(curve, face, (line,), -1.0, min(up, math.pi))
                        error = -down if down < up else up
                    if not abs(error) < math.inf:
                        continue
                    y, z, status = spot_at(curve, face, math.cos(error), math.sin(error))
                    if status == REACHES:
                        out[0, p, h, t, i], out[1, p, h, t, i], out[2, p, h, t, i] = y, z, error


def detector_inversion(
    sun: ArrayLike, centre: ArrayLike, face: ArrayLike, elevation_point: ArrayLike, azimuth_point: ArrayLike
) -> tuple[Floats, Floats]:
    """Azimuth and elevation of a mirror from one point of each of its two deviation curves; arguments broadcast.

    For a vertical primary axis, and a mirror centre that stays where it is.

    Parameters
    ----------
    sun : array_like, shape (..., 3)
        Unit vectors to the sun: east, north, up. [1]
    centre : array_like, shape (..., 3)
        Mirror centre relative to the aim point. [m]
    face : array_like, shape (3, 3)
        Axes of the face, from `receiver.face_axes`. [1]
    elevation_point, azimuth_point : array_like, shape (..., 2)
        y and z of a point on the curve of elevation errors and on that of azimuth errors. [m]

    Returns
    -------
    azimuth, elevation : ndarray
        Of the mirror normal: azimuth from north, clockwise; elevation above the horizon. [rad]
    """
    s, c, axes = np.asarray(sun, np.float64), np.asarray(centre, np.float64), np.asarray(face, np.float64)

    def bisector(point: ArrayLike) -> Floats:
        spot = np.asarray(point, np.float64)
        v = spot[..., :1] * axes[1] + spot[..., 1:] * axes[2] - c
        return s + v / np.sqrt(np.sum(v * v, axis=-1, keepdims=True))

    k = bisector(elevation_point)
    azimuth = np.arctan2(k[..., 0], k[..., 1])
    k = bisector(azimuth_point)
    return azimuth, np.arctan2(k[..., 2], k[..., 0] * np.sin(azimuth) + k[..., 1] * np.cos(azimuth))
