"""Geometry of backward gazing: frames, cameras, modules, pixels on the mirror, and rays traced back to the sun.

Frames [1]_. R_F has x south, y east, z up and its origin O' at the target centre; azimuths here are from south towards
east. `basis(a, h)` turns R_F into a frame whose x axis has azimuth a and elevation h: B_S for the sun, B_H for the
mirror (x along the ideal normal), B_R for the direction R0 from the mirror to the target. The mirror's y axis points to
the right for someone at the target who looks at the mirror, its z axis up.

The mirror of the reconstruction is the series of a sphere of focal length f (Eqs. 1 and 2 with D = f), and its slopes
p = (p_y, p_z) are departures from it: N ~ (1, a, b) with a = p_y - y (1 + r^2 / 8 f^2) / 2 f, likewise b.
A camera i at M_i sees the pixel P along R = unit(M_i - P) and in it the sun's disc at S = 2 (N.R) N - R; v and w,
the 2nd and 3rd components of B_S S, are the sine of the angle eps_i from the disc centre (Eqs. 4 to 6).

Kernels work on the pixels that lie on a module, one row after another; `maps` puts their values back on the grid.

References
----------
.. [1] P.-H. Defieux, C. Caliot and F. Henault, "Hybrid optical method for characterizing a heliostat field in a
   concentrated solar power plant", AIP Conf. Proc. 2303 (2020) 100002, doi 10.1063/5.0029270
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline

#: Referentials: rows of `transfers`.
NONE, ROLL, EXACT = 0, 1, 2
#: Their names in the order of `transfers`.
REFERENTIALS = ("none", "roll", "exact")
#: Rounding that a pixel centre on a module's edge is allowed, in pixels.
_SLACK = 1e-9


class Scene(NamedTuple):
    """Sun, mirror, target and K cameras; made by `scene`. Kernels take it whole.

    Attributes
    ----------
    sun_axes, mirror_axes, target_axes : ndarray, shape (3, 3)
        B_S, B_H and B_R: rows x (to the sun, along the ideal normal N0, along R0), y and z in R_F. [1]
    cameras : ndarray, shape (K, 3)
        M_i in R_F. [m]
    eyes : ndarray, shape (K, 3)
        Cameras from the mirror centre, in the mirror frame. [m]
    gaze : ndarray, shape (K, 2)
        m_i = (B_R M_i)_{2,3} / D. [rad]
    sun_y, sun_z : ndarray, shape (3,)
        2nd and 3rd rows of B_S in the mirror frame. [1]
    distance, focal_length : float
        D from the mirror centre to the target centre, and f of the ideal mirror. [m]
    incidence : float
        Angle i of the sun and of the target from the ideal normal. [rad]
    """

    sun_axes: Floats
    mirror_axes: Floats
    target_axes: Floats
    cameras: Floats
    eyes: Floats
    gaze: Floats
    sun_y: Floats
    sun_z: Floats
    distance: float
    focal_length: float
    incidence: float


class Modules(NamedTuple):
    """Rectangular modules of a heliostat; module number n of a study is row n - 1.

    Attributes
    ----------
    centre : ndarray, shape (M, 2)
        (y, z) in the mirror frame, from the heliostat's centre. [m]
    size : ndarray, shape (M, 2)
        Width along y and height along z. [m]
    """

    centre: Floats
    size: Floats


class MirrorGrid(NamedTuple):
    """Square pixels over the modules; made by `mirror_grid`.

    Attributes
    ----------
    y, z : ndarray, shape (ny,) and (nz,)
        Pixel centres, ascending. [m]
    module : ndarray of int, shape (nz, ny)
        Number of the module at each pixel, from 1; 0 between modules.
    place : ndarray of int, shape (N,)
        Position of the N pixels on modules in the flattened grid, ascending.
    pixels : ndarray, shape (2, N)
        Their y and z. [m]
    pixel_module : ndarray of int, shape (N,)
        Row of their module, from 0.
    """

    y: Floats
    z: Floats
    module: Integers
    place: Integers
    pixels: Floats
    pixel_module: Integers


def basis(azimuth: float, elevation: float) -> Floats:
    """Axes of a frame whose x axis has an azimuth, from south towards east, and an elevation [rad].

    Rows x = (ca ch, sa ch, sh), y = (-sa, ca, 0) and z = (-ca sh, -sa sh, ch) in R_F, shape (3, 3). [1]
    """
    ca, sa, ch, sh = math.cos(azimuth), math.sin(azimuth), math.cos(elevation), math.sin(elevation)
    return np.array([[ca * ch, sa * ch, sh], [-sa, ca, 0.0], [-ca * sh, -sa * sh, ch]])


def camera_square(radius: float, arrangement: str = "square") -> Floats:
    """Four cameras at a distance [m] from the target centre: (y'', z'') in its plane, shape (4, 2). [m]

    y'' is to the east for a target that faces north, z'' upwards. `square`: (-a, a), (a, a), (-a, -a), (a, -a) with
    a = radius / sqrt 2; `cross`: (0, r), (-r, 0), (r, 0), (0, -r). Raises ValueError for any other arrangement.
    """
    if arrangement == "square":
        return radius / math.sqrt(2.0) * np.array([[-1.0, 1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    if arrangement == "cross":
        return radius * np.array([[0.0, 1.0], [-1.0, 0.0], [1.0, 0.0], [0.0, -1.0]])
    raise ValueError(f"unknown arrangement of cameras {arrangement!r}")


def in_space(places: Floats, tilt: float, face: float) -> Floats:
    """Places (y'', z'') in the plane of the target, shape (K, 2), in R_F: shape (K, 3). [m]

    The target leans by `tilt` (Eq. 3): its back rises with the angle, so that it faces down to the mirrors; `face`
    turns it about the vertical, from south towards east. [rad]
    """
    leaning = np.stack((-math.sin(tilt) * places[:, 1], places[:, 0], math.cos(tilt) * places[:, 1]), axis=1)
    turn = np.array([[math.cos(face), -math.sin(face), 0.0], [math.sin(face), math.cos(face), 0.0], [0.0, 0.0, 1.0]])
    return product(turn, leaning)


def in_line(places: Floats) -> bool:
    """Return True if points of a plane, shape (K, 2), are in one line, or within a millionth of their spread of it."""
    spread = places - places.mean(axis=0)
    spread /= np.abs(spread).max() or 1.0  # squares of far places overflow
    yy, yz, zz = np.sum(spread[:, 0] ** 2), np.sum(spread[:, 0] * spread[:, 1]), np.sum(spread[:, 1] ** 2)
    return not yy * zz - yz * yz > 1e-12 * (yy + zz) ** 2


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
    distance, focal_length : float
        D, and f of the ideal mirror. [m]
    tilt, face : float
        As in `in_space`; the paper's target has no turn and faces north. [rad]

    Raises
    ------
    ValueError
        If a length is not positive, sun and target are opposite each other, or the cameras seen from the mirror are
        fewer than 3 or in one line: two slopes cannot be found then.
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
    standing = in_space(places, tilt, face)
    gaze = product(b_target[1:], standing) / distance
    if in_line(gaze):
        raise ValueError("cameras in one line as seen from the mirror: two slopes cannot be found")
    half = 0.5 * float(np.sqrt(np.sum((b_sun[0] - b_target[0]) ** 2)))
    return Scene(
        b_sun,
        b_mirror,
        b_target,
        standing,
        product(b_mirror, standing + distance * b_target[0]),
        gaze,
        product(b_mirror, b_sun[1]),
        product(b_mirror, b_sun[2]),
        float(distance),
        float(focal_length),
        math.atan2(half, 0.5 * length),
    )


def transfers(layout: Scene) -> Floats:
    """Matrices that turn wavefront slopes into mirror slopes, shape (3, 2, 2). [1]

    `NONE`: I / 2, without the field rotation. `ROLL`: [2 cos i E T'^T]^-1, the rotation of the axes alone. `EXACT`:
    J^-1, with the change of the wavefront slopes w with the mirror slopes p at the mirror centre,
    J = dw / dp = 2 [(E N0) (T' S0)^T + cos i E T'^T]. E and T' are the 2nd and 3rd rows of B_R and B_H, det J is
    4 cos i. NaN if a matrix has no inverse.
    """
    e, t = layout.target_axes[1:], layout.mirror_axes[1:]
    roll = 2.0 * math.cos(layout.incidence) * product(e, t).T
    along = 2.0 * product(e, layout.mirror_axes[0])[:, np.newaxis] * product(t, layout.sun_axes[0])
    return np.stack((0.5 * np.eye(2), *map(_inverted, (roll, along + roll))))


def themis_8() -> Modules:
    """Modules of a heliostat similar to THEMIS: 2 columns of 4, each 3.6 m x 1.8 m, with gaps of 5 cm.

    Numbers 1 to 4 are the left column from the top, 5 to 8 the right one, left as the cameras at the target see it
    (y < 0). The positions are an assumption: none are published.
    """
    size = 3.6, 1.8
    across, down = size[0] + 0.05, size[1] + 0.05
    centre = [(side * 0.5 * across, (1.5 - row) * down) for side in (-1, 1) for row in range(4)]
    return Modules(np.array(centre), np.tile(size, (8, 1)))


def outline(modules: Modules) -> Floats:
    """Corners of the smallest rectangle that holds all modules: (y, z) of top left, top right, bottom right and bottom
    left as the cameras see it, shape (4, 2). [m]
    """
    low = (modules.centre - 0.5 * modules.size).min(axis=0)
    high = (modules.centre + 0.5 * modules.size).max(axis=0)
    return np.array([[low[0], high[1]], [high[0], high[1]], [high[0], low[1]], [low[0], low[1]]])


def mirror_grid(modules: Modules, pixel: float) -> MirrorGrid:
    """Pixels of a side [m] over the smallest rectangle that holds all modules, centred on it.

    A pixel belongs to the module that holds its centre. Modules must not overlap, nor be narrower than a pixel.
    """
    half = 0.5 * modules.size
    low, high = (modules.centre - half).min(axis=0), (modules.centre + half).max(axis=0)
    count = np.maximum(np.ceil((high - low) / pixel - 1e-6), 1.0)
    y, z = (
        0.5 * (low[axis] + high[axis]) + pixel * (np.arange(int(count[axis])) - 0.5 * (count[axis] - 1.0))
        for axis in (0, 1)
    )
    module = np.zeros((len(z), len(y)), np.int64)
    for row in reversed(range(len(half))):  # on an edge that two share the first counts
        on_y, on_z = (
            np.abs(line - modules.centre[row, axis]) <= half[row, axis] + _SLACK * pixel
            for axis, line in enumerate((y, z))
        )
        module[np.ix_(on_z, on_y)] = row + 1
    place = np.flatnonzero(module)
    rows, columns = np.divmod(place, len(y))
    return MirrorGrid(y, z, module, place, np.array([y[columns], z[rows]]), module.ravel()[place] - 1)


def eroded(grid: MirrorGrid, cells: int) -> NDArray[np.bool_]:
    """Return True for pixels of which all within `cells` rows and columns belong to the same module, shape (N,)."""
    from scipy.ndimage import maximum_filter, minimum_filter

    low, high = (ranked(grid.module, 2 * cells + 1, mode="constant") for ranked in (minimum_filter, maximum_filter))
    keep: NDArray[np.bool_] = (low == high).ravel()[grid.place]
    return keep


def maps(grid: MirrorGrid, values: ArrayLike) -> Floats:
    """Values of the N pixels on modules, shape (..., N), on the grid: shape (..., nz, ny), NaN between modules."""
    packed = np.asarray(values, np.float64)
    full = np.full((*packed.shape[:-1], grid.module.size), math.nan)
    full[..., grid.place] = packed
    return full.reshape(*packed.shape[:-1], *grid.module.shape)


def product(matrix: Floats, vectors: Floats) -> Floats:
    """Product of a matrix with each of some vectors, summed in one order whatever their number and on every machine."""
    return np.sum(vectors[..., np.newaxis, :] * matrix, axis=-1)


def _inverted(m: Floats) -> Floats:
    determinant = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    with np.errstate(all="ignore"):
        return np.array([[m[1, 1], -m[0, 1]], [-m[1, 0], m[0, 0]]]) / (determinant if determinant != 0.0 else np.nan)


Row = Floats | tuple[float, float, float]


@inline
def ideal_mirror(focal_length: float, y: float, z: float) -> tuple[float, float, float]:
    """Height x [m] of the ideal mirror of focal length f at a pixel (y, z) [m], and its slopes a, b (Eqs. 1 and 2).

    x = r^2 / 4 f + r^4 / 64 f^3 along the normal; a = -y (1 + r^2 / 8 f^2) / 2 f and likewise b [rad]: N ~ (1, a, b).
    """
    curved = (y * y + z * z) / (8.0 * focal_length * focal_length)
    bend = -(1.0 + curved) / (2.0 * focal_length)
    return 2.0 * focal_length * curved * (1.0 + 0.5 * curved), bend * y, bend * z


@inline
def unit(x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector over its length; numbers or arrays."""
    scale = 1.0 / np.sqrt(x * x + y * y + z * z)
    return x * scale, y * scale, z * scale


@inline
def row_of(vector: Floats) -> tuple[float, float, float]:
    """A row of a scene as numbers: loops that load it at each pixel do not become vector code."""
    return vector[0], vector[1], vector[2]


@inline
def mirror_offsets(
    a: float, b: float, rx: float, ry: float, rz: float, sun_y: Row, sun_z: Row
) -> tuple[float, float, float, float, float, float]:
    """Point of the disc that the ray to a camera comes from, for a mirror with the normal N ~ (1, a, b).

    Of a and b, the slopes of the ideal mirror and p together [rad], the unit vector R to a camera in the mirror frame,
    and the rows of the scene: v and w, the 2nd and 3rd components of B_S S [1], and dv/da, dv/db, dw/da, dw/db, their
    derivatives by p_y and p_z [1/rad].
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


def offsets(layout: Scene, points: Floats, a: Floats, b: Floats) -> tuple[Floats, ...]:
    """Return `mirror_offsets` of all cameras, shape (K, N), at points (x, y, z) of a mirror, shape (3, N) [m]."""
    rays: Any = unit(*(layout.eyes.T[:, :, np.newaxis] - points[:, np.newaxis]))
    return mirror_offsets(a, b, *rays, layout.sun_y, layout.sun_z)
