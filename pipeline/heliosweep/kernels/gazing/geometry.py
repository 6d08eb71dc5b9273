"""Geometry of backward gazing: frames, cameras, the ideal mirror, and rays traced back from a camera to the sun.

Frames [1]_. R_F has x south, y east, z up and its origin O' at the target centre; azimuths here are from south towards
east, `world_azimuth` converts. `basis(a, h)` turns R_F into a frame whose x axis has azimuth a and elevation h: B_S for
the sun, B_H for the mirror (x along the ideal normal), B_R for the direction R0 from the mirror to the target. The
mirror's y axis points to the right for someone at the target who looks at the mirror, its z axis up.

The mirror of the reconstruction is the series of a sphere of focal length f (Eqs. 1 and 2 with D = f), and its slopes
p = (p_y, p_z) are departures from it: N ~ (1, a, b) with a = p_y - y (1 + r^2 / 8 f^2) / 2 f, likewise b.
A camera i at M_i sees the pixel P along R = unit(M_i - P) and in it the sun's disc at S = 2 (N.R) N - R; v and w,
the 2nd and 3rd components of B_S S, are the sine of the angle eps_i from the disc centre (Eqs. 4 to 6).

References
----------
.. [1] P.-H. Defieux, C. Caliot and F. Henault, "Hybrid optical method for characterizing a heliostat field in a
   concentrated solar power plant", AIP Conf. Proc. 2303 (2020) 100002, doi 10.1063/5.0029270
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import inline

Floats = NDArray[np.float64]

NONE, ROLL, EXACT = 0, 1, 2
"""Referentials: rows of `transfers`."""
REFERENTIALS = ("none", "roll", "exact")
"""Their names in the order of `transfers`."""


class Scene(NamedTuple):
    """Sun, mirror, target and K cameras; made by `scene`. Kernels take it whole."""

    sun_axes: Floats
    """B_S: rows x (to the sun), y, z in R_F, shape (3, 3). [1]"""
    mirror_axes: Floats
    """B_H: rows x (ideal normal N0), y, z in R_F, shape (3, 3). [1]"""
    target_axes: Floats
    """B_R: rows x (direction R0 from the mirror to the target), y, z in R_F, shape (3, 3). [1]"""
    cameras: Floats
    """M_i in R_F, shape (K, 3). [m]"""
    eyes: Floats
    """Cameras from the mirror centre, in the mirror frame, shape (K, 3). [m]"""
    gaze: Floats
    """m_i = (B_R M_i)_{2,3} / D, shape (K, 2). [rad]"""
    sun_y: Floats
    """2nd row of B_S in the mirror frame, shape (3,). [1]"""
    sun_z: Floats
    """3rd row of B_S in the mirror frame, shape (3,). [1]"""
    distance: float
    """D from the mirror centre to the target centre. [m]"""
    focal_length: float
    """f of the ideal mirror. [m]"""
    incidence: float
    """Angle i of the sun and of the target from the ideal normal. [rad]"""


def basis(azimuth: float, elevation: float) -> Floats:
    """Axes of a frame whose x axis points to an azimuth and elevation.

    Parameters
    ----------
    azimuth : float
        From south, positive towards east. [rad]
    elevation : float
        Above the horizon. [rad]

    Returns
    -------
    ndarray, shape (3, 3)
        Rows x = (ca ch, sa ch, sh), y = (-sa, ca, 0) and z = (-ca sh, -sa sh, ch) in R_F. [1]
    """
    ca, sa, ch, sh = math.cos(azimuth), math.sin(azimuth), math.cos(elevation), math.sin(elevation)
    return np.array([[ca * ch, sa * ch, sh], [-sa, ca, 0.0], [-ca * sh, -sa * sh, ch]])


def camera_square(radius: float, arrangement: str = "square") -> Floats:
    """Four cameras about the target centre.

    Parameters
    ----------
    radius : float
        Distance of each from the centre. [m]
    arrangement : str
        `square`: (-a, a), (a, a), (-a, -a), (a, -a) with a = radius / sqrt 2; `cross`: (0, r), (-r, 0), (r, 0),
        (0, -r).

    Returns
    -------
    ndarray, shape (4, 2)
        (y'', z'') in the plane of the target: y'' to the east for a target that faces north, z'' upwards. [m]
    """
    if arrangement == "square":
        return radius / math.sqrt(2.0) * np.array([[-1.0, 1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    if arrangement == "cross":
        return radius * np.array([[0.0, 1.0], [-1.0, 0.0], [1.0, 0.0], [0.0, -1.0]])
    raise ValueError(f"unknown arrangement of cameras {arrangement!r}")


def scene(
    sun: tuple[float, float],
    target: tuple[float, float],
    cameras: ArrayLike,
    distance: float = 120.0,
    focal_length: float = 120.0,
    tilt: float = math.radians(30.0),
    face: float = 0.0,
) -> Scene:
    """Scene of a mirror, its target and cameras under the sun: all that does not change from pixel to pixel.

    Parameters
    ----------
    sun : tuple of float
        Azimuth from south towards east, and elevation. [rad]
    target : tuple of float
        Azimuth and elevation of R0, the direction from the mirror to the target; the mirror centre is at -D R0. [rad]
    cameras : array_like, shape (K, 2)
        (y'', z'') in the plane of the target. [m]
    distance : float
        D. [m]
    focal_length : float
        f of the ideal mirror. [m]
    tilt : float
        Angle between the target plane and the vertical (Eq. 3): its back rises with the angle, so that it faces down
        to the mirrors. [rad]
    face : float
        Turn of the target about the vertical, from south towards east; 0 in the paper, where it faces north. [rad]

    Returns
    -------
    Scene

    Raises
    ------
    ValueError
        If a length is not positive, sun and target stand opposite each other, or the cameras seen from the mirror are
        fewer than 3, in one line or nearer to it than a millionth of their spread: two slopes cannot be found then.
    """
    places = np.asarray(cameras, np.float64)
    if not (distance > 0.0 and focal_length > 0.0):
        raise ValueError("distance and focal length must be positive")
    if places.ndim != 2 or places.shape[1] != 2 or len(places) < 3:
        raise ValueError("two slopes need at least 3 cameras")
    b_sun, b_target = basis(*sun), basis(*target)
    ideal = b_sun[0] + b_target[0]
    length = math.sqrt(float(np.sum(ideal**2)))
    if length < 1e-9:
        raise ValueError("no mirror can send the sun to a target opposite it")
    b_mirror = basis(math.atan2(ideal[1], ideal[0]), math.atan2(ideal[2], math.hypot(ideal[0], ideal[1])))
    leaning = np.stack((-math.sin(tilt) * places[:, 1], places[:, 0], math.cos(tilt) * places[:, 1]), axis=1)
    turn = np.array([[math.cos(face), -math.sin(face), 0.0], [math.sin(face), math.cos(face), 0.0], [0.0, 0.0, 1.0]])
    in_space = _rows(turn, leaning)
    gaze = _rows(b_target[1:], in_space) / distance
    spread = gaze - gaze.mean(axis=0)
    yy, yz, zz = np.sum(spread[:, 0] ** 2), np.sum(spread[:, 0] * spread[:, 1]), np.sum(spread[:, 1] ** 2)
    if not yy * zz - yz * yz > 1e-12 * (yy + zz) ** 2:
        raise ValueError("cameras in one line as seen from the mirror: two slopes cannot be found")
    half = 0.5 * float(np.sqrt(np.sum((b_sun[0] - b_target[0]) ** 2)))
    return Scene(
        b_sun,
        b_mirror,
        b_target,
        in_space,
        _rows(b_mirror, in_space + distance * b_target[0]),
        gaze,
        _rows(b_mirror, b_sun[1]),
        _rows(b_mirror, b_sun[2]),
        float(distance),
        float(focal_length),
        math.atan2(half, 0.5 * length),
    )


def jacobian(layout: Scene) -> Floats:
    """Change of the wavefront slopes w with the mirror slopes p at the mirror centre.

    Parameters
    ----------
    layout : Scene

    Returns
    -------
    ndarray, shape (2, 2)
        J = dw / dp = 2 [(E N0) (T' S0)^T + cos i E T'^T] with E and T' the 2nd and 3rd rows of B_R and B_H. Its
        determinant is 4 cos i. [1]
    """
    e, t = layout.target_axes[1:], layout.mirror_axes[1:]
    along = _rows(e, layout.mirror_axes[0])[:, np.newaxis] * _rows(t, layout.sun_axes[0])
    return 2.0 * (along + math.cos(layout.incidence) * _rows(e, t).T)


def transfers(layout: Scene) -> Floats:
    """Matrices that turn wavefront slopes into mirror slopes.

    Parameters
    ----------
    layout : Scene

    Returns
    -------
    ndarray, shape (3, 2, 2)
        `NONE`: I / 2, without the field rotation. `ROLL`: [2 cos i E T'^T]^-1, the rotation of the axes alone.
        `EXACT`: J^-1. [1]
    """
    roll = 2.0 * math.cos(layout.incidence) * _rows(layout.target_axes[1:], layout.mirror_axes[1:]).T
    return np.stack((0.5 * np.eye(2), _inverted(roll), _inverted(jacobian(layout))))


@inline
def ideal_mirror(focal_length: float, y: float, z: float) -> tuple[float, float, float]:
    """Height of the ideal mirror and its slopes (Eqs. 1 and 2).

    Parameters
    ----------
    focal_length : float
        f. [m]
    y, z : float
        Pixel, from the mirror centre. [m]

    Returns
    -------
    x : float
        r^2 / 4 f + r^4 / 64 f^3 along the normal. [m]
    a, b : float
        -y (1 + r^2 / 8 f^2) / 2 f and -z (...) / 2 f: N ~ (1, a, b). [rad]
    """
    curved = (y * y + z * z) / (8.0 * focal_length * focal_length)
    bend = -(1.0 + curved) / (2.0 * focal_length)
    return 2.0 * focal_length * curved * (1.0 + 0.5 * curved), bend * y, bend * z


@inline
def camera_ray(eyes: Floats, camera: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Unit vector R in the mirror frame from the point (x, y, z) of the mirror to a camera; `eyes` of the scene."""
    rx, ry, rz = eyes[camera, 0] - x, eyes[camera, 1] - y, eyes[camera, 2] - z
    scale = 1.0 / math.sqrt(rx * rx + ry * ry + rz * rz)
    return rx * scale, ry * scale, rz * scale


@inline
def mirror_offsets(
    a: float, b: float, rx: float, ry: float, rz: float, sun_y: Floats, sun_z: Floats
) -> tuple[float, float, float, float, float, float]:
    """Point of the disc that the ray to a camera comes from, for a mirror with the normal N ~ (1, a, b).

    Parameters
    ----------
    a, b : float
        Slopes of the normal, those of the ideal mirror and p together. [rad]
    rx, ry, rz : float
        R of `camera_ray`. [1]
    sun_y, sun_z : ndarray, shape (3,)
        Of the scene.

    Returns
    -------
    v, w : float
        2nd and 3rd components of B_S S. [1]
    dv/da, dv/db, dw/da, dw/db : float
        Derivatives by the slopes, that is by p_y and p_z. [1/rad]
    """
    scale = 2.0 / (1.0 + a * a + b * b)
    along = rx + a * ry + b * rz
    ny = sun_y[0] + a * sun_y[1] + b * sun_y[2]
    nz = sun_z[0] + a * sun_z[1] + b * sun_z[2]
    v, w = scale * along * ny, scale * along * nz
    return (
        v - (rx * sun_y[0] + ry * sun_y[1] + rz * sun_y[2]),
        w - (rx * sun_z[0] + ry * sun_z[1] + rz * sun_z[2]),
        scale * (ry * ny + along * sun_y[1] - a * v),
        scale * (rz * ny + along * sun_y[2] - b * v),
        scale * (ry * nz + along * sun_z[1] - a * w),
        scale * (rz * nz + along * sun_z[2] - b * w),
    )


def _rows(matrix: Floats, vectors: Floats) -> Floats:
    """Product of a matrix with each of some vectors, summed in one order whatever their number."""
    return np.sum(vectors[..., np.newaxis, :] * matrix, axis=-1)


def _inverted(m: Floats) -> Floats:
    """Inverse of a 2 x 2 matrix; NaN where it has none."""
    determinant = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    with np.errstate(all="ignore"):
        return np.array([[m[1, 1], -m[0, 1]], [-m[1, 0], m[0, 0]]]) / (determinant if determinant != 0.0 else np.nan)
