"""Conic section that a deviation curve is part of.

About an axis a in the mirror the reflected rays satisfy a.R = -a.S = k: they form a cone with its apex p in the mirror
centre, and on the plane of the receiver the points x = y Y + z Z (relative to the aim point) of the trace satisfy

    (x - p)^T m (x - p) = 0,  m = a a^T - k^2 I:   A y^2 + B y z + C z^2 + D y + E z + F = 0

    A = m_yy,  B = 2 m_yz,  C = m_zz,  D = -2 (m p)_y,  E = -2 (m p)_z,  F = p^T m p

with B^2 - 4 A C = 4 k^2 (1 - a_x^2 - k^2) and the eccentricity sqrt(1 - a_x^2) / |k|. Rays run along that half of the
cone where a.(x - p) has the sign of k. The sphere inside this half that touches the cone and, from the side of the
apex, the plane (Dandelin's) touches the plane in a focus: inside the branch that rays trace. Its centre is
p + s sign(k) a with s = X.p / (sqrt(1 - k^2) - sign(k) a_x).
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.deviation import Curve, Face, curve_of, draws_conic, face_vectors, prepared, spot_at
from heliosweep.kernels.receiver import REACHES, Setting
from heliosweep.kernels.vectors import dot

__all__ = ["conics"]

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
