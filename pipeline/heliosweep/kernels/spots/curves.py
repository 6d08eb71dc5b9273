"""Conic sections that deviation curves are part of, and where the curves cross lines of detectors.

About an axis a in the mirror the reflected rays satisfy a.R = -a.S = k: they form a cone with its apex p in the mirror
centre, and on the plane of the receiver the points x = y Y + z Z (relative to the aim point) of the trace satisfy

    (x - p)^T m (x - p) = 0,  m = a a^T - k^2 I:   A y^2 + B y z + C z^2 + D y + E z + F = 0

    A = m_yy,  B = 2 m_yz,  C = m_zz,  D = -2 (m p)_y,  E = -2 (m p)_z,  F = p^T m p

with B^2 - 4 A C = 4 k^2 (1 - a_x^2 - k^2) and the eccentricity sqrt(1 - a_x^2) / |k|. Rays run along that half of the
cone where a.(x - p) has the sign of k. The sphere inside this half that touches the cone and, from the side of the
apex, the plane (Dandelin's) touches the plane in a focus: inside the branch that rays trace. Its centre is
p + s sign(k) a with s = X.p / (sqrt(1 - k^2) - sign(k) a_x).

A heliostat whose facets carry reflecting cylinders, or that sweeps through an error, draws a whole deviation curve;
detectors along lines l0 y + l1 z = l2 see where it crosses them (Optics Express 27 (8), A257 (2019), Sect. 4.3).
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.spots.deviation import Curve, curve_of, draws_conic, face_vectors, prepared, spot_at
from heliosweep.kernels.spots.receiver import REACHES, Face, Setting
from heliosweep.kernels.spots.tolerances import crossing_cotangent, first_crossing
from heliosweep.kernels.vectors import at_angle, dot

_STRAIGHT = 1e-14
"""Cosine |k| of the half angle of a cone that is taken for a plane: smaller ones are rounding. [1]"""
_ROUNDING = 1e-12
"""Ratio of A to the larger of B and C up to which A is rounding. [1]"""

Floats = NDArray[np.float64]


def conics(setting: Setting, source: ArrayLike, axis: ArrayLike, sun: ArrayLike, pivots: ArrayLike) -> Floats:
    """Conic sections of deviation curves; parameters as in `deviation.deviation_spots`.

    Returns
    -------
    ndarray, shape (9, P, H, T)
        Coefficients A [1], B [1], C [1], D [m], E [m], F [m^2], divided by A (by the one of largest magnitude where A
        is 0 to rounding, beside B and C); eccentricity [1]; focus y and z [m] inside the branch that real rays trace,
        the one nearer to the mirror of the two in an ellipse. A cone that is a plane (the sun perpendicular to the
        axis) gives a straight line: eccentricity infinity, no focus. NaN where the spot of no error does not reach the
        plane, and where the curve is no conic: errors of the encoder or the pedestal with a mirror centre that moves,
        and of the primary axis.
    """
    settings, sources, axes, suns, places = prepared(setting, source, axis, sun, pivots)
    out = np.full((9, len(sources), places.shape[1], suns.shape[1]), np.nan)
    fill_conics(settings, sources, axes, suns, places, out)
    return out


@kernel
def fill_conics(
    setting: Setting,
    source: NDArray[np.int64],
    axis: NDArray[np.int64],
    sun: Floats,
    pivots: Floats,
    out: Floats,
) -> None:
    """Fill `out`, shape (9, P, H, T), see `conics`."""
    for p in range(len(source)):
        if not draws_conic(source[p], axis[p], setting.mirror_offset[p], setting.pedestal_height[p]):
            continue
        face = face_vectors(setting.face_azimuth[p], setting.face_tilt[p])
        for h in range(pivots.shape[1]):
            for t in range(sun.shape[1]):
                curve = curve_of(setting, p, face, source[p], axis[p], sun, pivots, h, t)
                _, _, status = spot_at(curve, face, 1.0, 0.0)
                if curve.status == REACHES and status == REACHES:
                    numbers = _conic(curve, face)
                    for i in range(9):
                        out[i, p, h, t] = numbers[i]


@inline
def _conic(curve: Curve, face: Face) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Coefficients, eccentricity and focus."""
    a, p = curve.axis, curve.centre[0]
    k = -dot(a, curve.sun)
    ax, ay, az = dot(face[0], a), dot(face[1], a), dot(face[2], a)
    px, py, pz = dot(face[0], p), dot(face[1], p), dot(face[2], p)
    along = dot(a, p)
    first, second, third = ay * ay - k * k, 2.0 * ay * az, az * az - k * k
    fourth, fifth = -2.0 * (ay * along - k * k * py), -2.0 * (az * along - k * k * pz)
    sixth = along * along - k * k * dot(p, p)
    scale = first
    if abs(first) <= _ROUNDING * max(abs(second), abs(third)):
        for other in (second, third, fourth, fifth, sixth):
            scale = other if abs(other) > abs(scale) else scale
    eccentricity, focus_y, focus_z = math.inf, math.nan, math.nan
    if abs(k) > _STRAIGHT:
        eccentricity = math.sqrt(max(ay * ay + az * az, 0.0)) / abs(k)
        sign = math.copysign(1.0, k)
        s = sign * px / (math.sqrt(max(1.0 - k * k, 0.0)) - sign * ax)
        focus_y, focus_z = py + s * ay, pz + s * az
    return (
        first / scale,
        second / scale,
        third / scale,
        fourth / scale,
        fifth / scale,
        sixth / scale,
        eccentricity,
        focus_y,
        focus_z,
    )


def crossings(
    setting: Setting, source: ArrayLike, axis: ArrayLike, lines: ArrayLike, sun: ArrayLike, pivots: ArrayLike
) -> Floats:
    """First crossings of detector lines by deviation curves; other parameters as in `deviation.deviation_spots`.

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
    """Fill `out`, shape (3, P, H, T, L), see `crossings`."""
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
