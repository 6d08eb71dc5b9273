"""Geometry and images for backward gazing: frames, cameras, modules, pixels, and rays traced back to the sun.

The frames follow [1]_. In R_F, x points south, y points east and z points up, and the origin O' is the target centre.
Azimuths in this module are measured from south towards east. `basis(a, h)` returns the rotation from R_F to a frame
whose x axis has azimuth a and elevation h. The x axis points to the sun for the rotation B_S, along the ideal mirror
normal for B_H, and along R0, the direction from the mirror to the target, for B_R. Seen from the target, the mirror's y
axis points to the right and its z axis points up.

The reconstruction assumes that the ideal mirror is the series expansion of a sphere with focal length f (Eqs. 1 and 2
with D = f). The slopes p = (p_y, p_z) are deviations from the ideal mirror. The mirror normal N is parallel to (1, a,
b), with a = p_y - y (1 + r^2 / 8 f^2) / 2 f and b defined likewise. Seen from the pixel P, camera i at M_i lies in the
direction R = unit(M_i - P). At this pixel, the camera sees the point of the sun's disc in the direction S = 2 (N.R) N -
R. The second and third components of B_S S, v and w, give the angle eps_i from the disc centre: sin eps_i = |(v, w)|
(Eqs. 4 to 6).

The kernels compute values only for pixels on modules, row by row; `maps` arranges these values on the grid.

Images of a heliostat are either rendered directly on the mirror grid, or rendered as pinhole camera images and then
rectified. The rendered surface differs from the ideal mirror of the reconstruction: Each module is part of an exact
sphere, and canting rotates the module about its centre. A pointing error rotates the whole heliostat about its centre,
and waviness adds random slopes. The brightness at a mirror pixel is found by tracing a ray back from the camera to the
pixel and on to the sun's disc.

Pinhole camera i is at M_i and points at the heliostat's centre. A camera with zero roll is upright. Camera pixels are
square. The column u increases to the right, and the row v increases downwards. The first pixel is centred at (0, 0).
The brightness of a pixel is the mean over n x n points. The ray through each point is traced to the first module that
it hits. `Modules` contains the rectangle of each module before rotation.

The pinhole geometry gives the image position (u, v) of each mirror pixel on the ideal surface. If the corners of the
heliostat are marked in the image, a homography maps the predicted corners to the marked corners. The homography
corrects for errors in the pointing, roll and focal length of the camera. The pinhole geometry accounts for the sag of
the mirror, which a planar homography cannot describe. Brightness is interpolated over 4 x 4 image pixels by Keys' cubic
convolution [2]_.

A mirror pixel is used only if its 4 x 4 image pixels lie within the image and on one module. None of the 16 image
pixels may be saturated or NaN. Either all 16 or none must be lit, so that neither the sun's limb nor the edge of a dirt
spot crosses them. Interpolation multiplies the noise by the square root of the sum of the squared weights. This factor
is 1 at the centre of an image pixel and decreases to 0.64 at a corner shared by four image pixels.

References
----------
.. [1] P.-H. Defieux, C. Caliot and F. Henault, "Hybrid optical method for characterizing a heliostat field in a
   concentrated solar power plant", AIP Conf. Proc. 2303 (2020) 100002, doi 10.1063/5.0029270
.. [2] R. Keys, "Cubic convolution interpolation for digital image processing", IEEE Trans. ASSP 29 (1981) 1153-1160
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import Floats, Integers, inline, kernel
from heliosweep.kernels.profiles import Profile, normal_draws, rendered

#: Indices of the referentials in the array that `transfers` returns.
NONE, ROLL, EXACT = 0, 1, 2
#: Names of the referentials, in the order of these indices.
REFERENTIALS = ("none", "roll", "exact")


class Scene(NamedTuple):
    """Sun, mirror, target and K cameras; created by `scene`.

    Attributes
    ----------
    sun_axes, mirror_axes, target_axes : ndarray, shape (3, 3)
        Rotations B_S, B_H and B_R. Their rows are the x, y and z axes in R_F. The x axis points to the sun for B_S,
        along the ideal normal N0 for B_H, and along R0 for B_R. [1]
    cameras : ndarray, shape (K, 3)
        Camera positions M_i in R_F. [m]
    eyes : ndarray, shape (K, 3)
        Camera positions relative to the mirror centre, in the mirror frame. [m]
    gaze : ndarray, shape (K, 2)
        Angular positions m_i = (B_R M_i)_{2,3} / D of the cameras as seen from the mirror. [rad]
    sun_y, sun_z : ndarray, shape (3,)
        Second and third rows of B_S in the mirror frame. [1]
    distance, focal_length : float
        Distance D from the mirror centre to the target centre, and focal length f of the ideal mirror. [m]
    incidence : float
        Angle of incidence i, between the ideal normal and the direction to the sun. [rad]
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
    """Rectangular modules of a heliostat. Row n - 1 contains module n of the study.

    Attributes
    ----------
    centre : ndarray, shape (M, 2)
        Coordinates (y, z) of the module centres in the mirror frame, relative to the heliostat's centre. [m]
    size : ndarray, shape (M, 2)
        Width along y and height along z. [m]
    """

    centre: Floats
    size: Floats


class MirrorGrid(NamedTuple):
    """Grid of square pixels over the modules of a heliostat; created by `mirror_grid`.

    Attributes
    ----------
    y, z : ndarray, shape (ny,) and (nz,)
        Pixel centres, in ascending order. [m]
    module : ndarray of int, shape (nz, ny)
        Number of the module at each pixel, counted from 1; 0 between modules.
    place : ndarray of int, shape (N,)
        Indices of the N pixels on modules in the flattened grid, in ascending order.
    pixels : ndarray, shape (2, N)
        Coordinates y and z of the N pixels on modules. [m]
    pixel_module : ndarray of int, shape (N,)
        Index in `Modules` of the module at each of the N pixels.
    """

    y: Floats
    z: Floats
    module: Integers
    place: Integers
    pixels: Floats
    pixel_module: Integers


def basis(azimuth: float, elevation: float) -> Floats:
    """Return the axes of the frame whose x axis has this azimuth and elevation. [rad]

    The azimuth is measured from south towards east. The rows of the result, shape (3, 3), are the axes in R_F [1]:
    x = (ca ch, sa ch, sh), y = (-sa, ca, 0) and z = (-ca sh, -sa sh, ch).
    """
    ca, sa, ch, sh = math.cos(azimuth), math.sin(azimuth), math.cos(elevation), math.sin(elevation)
    return np.array([[ca * ch, sa * ch, sh], [-sa, ca, 0.0], [-ca * sh, -sa * sh, ch]])


def camera_square(radius: float, arrangement: str = "square") -> Floats:
    """Return the positions (y'', z'') of four cameras in the target plane, shape (4, 2). [m]

    The distance of each camera from the target centre is r = `radius` [m]. For a target that faces north, y'' points
    east and z'' points up. The positions are (-a, a), (a, a), (-a, -a) and (a, -a) with a = r / sqrt 2 for `square`,
    and (0, r), (-r, 0), (r, 0) and (0, -r) for `cross`. Raises ValueError for any other arrangement.
    """
    if arrangement == "square":
        return radius / math.sqrt(2.0) * np.array([[-1.0, 1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    if arrangement == "cross":
        return radius * np.array([[0.0, 1.0], [-1.0, 0.0], [1.0, 0.0], [0.0, -1.0]])
    raise ValueError(f"unknown camera arrangement {arrangement!r}")


def in_space(places: Floats, tilt: float, face: float) -> Floats:
    """Convert positions (y'', z'') in the target plane, shape (K, 2), to R_F, shape (K, 3). [m]

    `tilt` is the angle of the target from the vertical (Eq. 3) [rad]; a target with a positive tilt faces down towards
    the mirrors. `face` is the rotation of the target about the vertical, from south towards east [rad].
    """
    leaning = np.stack((-math.sin(tilt) * places[:, 1], places[:, 0], math.cos(tilt) * places[:, 1]), axis=1)
    turn = np.array([[math.cos(face), -math.sin(face), 0.0], [math.sin(face), math.cos(face), 0.0], [0.0, 0.0, 1.0]])
    return product(turn, leaning)


def in_line(places: Floats) -> bool:
    """Return True if points in a plane, shape (K, 2), are collinear to within 1e-6 of their spread."""
    widest, narrowest = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return not narrowest > 1e-6 * widest


def scene(
    sun: tuple[float, float],
    target: tuple[float, float],
    cameras: ArrayLike,
    distance: float = 120.0,
    focal_length: float = 120.0,
    tilt: float = math.radians(30.0),
    face: float = 0.0,
) -> Scene:
    """Return the geometry of the sun, mirror, target and cameras.

    Parameters
    ----------
    sun : tuple of float
        Azimuth (from south towards east) and elevation of the sun. [rad]
    target : tuple of float
        Azimuth and elevation of R0, the direction from the mirror to the target; the mirror centre is at -D R0. [rad]
    cameras : array_like, shape (K, 2)
        Camera positions (y'', z'') in the target plane. [m]
    distance, focal_length : float
        Distance D from the mirror to the target, and focal length f of the ideal mirror. [m]
    tilt, face : float
        Tilt and rotation of the target; see `in_space`. In Defieux et al. (2020), the target is not rotated and faces
        north. [rad]

    Raises
    ------
    ValueError
        If a length is not positive, if a number is not finite, if the sun and the target are in opposite directions, if
        there are fewer than 3 cameras, or if all cameras are collinear as seen from the mirror.
    """
    places = np.asarray(cameras, np.float64)
    if not (distance > 0.0 and focal_length > 0.0):
        raise ValueError("distance and focal length must be positive")
    if places.ndim != 2 or places.shape[1] != 2 or len(places) < 3:
        raise ValueError("at least 3 cameras are required to determine two slopes")
    b_sun, b_target = basis(*sun), basis(*target)
    ideal = b_sun[0] + b_target[0]
    length = math.sqrt(float(np.sum(ideal**2)))
    if length < 1e-9:
        raise ValueError("no mirror can reflect the sun to a target in the opposite direction")
    b_mirror = basis(math.atan2(ideal[1], ideal[0]), math.atan2(ideal[2], math.hypot(ideal[0], ideal[1])))
    standing = in_space(places, tilt, face)
    gaze = product(b_target[1:], standing) / distance
    if not np.isfinite(gaze).all():
        raise ValueError("camera positions, angles and distances must be finite")
    if in_line(gaze):
        raise ValueError("the cameras are collinear as seen from the mirror and cannot determine two slopes")
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
    """Return matrices that convert wavefront slopes to mirror slopes, shape (3, 2, 2). [1]

    `NONE` is I / 2, which neglects the field rotation. `ROLL` is [2 cos i E T'^T]^-1, which accounts only for the
    rotation of the axes. `EXACT` is J^-1, where J is the derivative of the wavefront slopes w with respect to the
    mirror slopes p at the mirror centre: J = dw / dp = 2 [(E N0) (T' S0)^T + cos i E T'^T], with det J = 4 cos i. E
    contains the second and third rows of B_R, and T' the second and third rows of B_H. If an inverse does not exist,
    the matrix is NaN.
    """
    e, t = layout.target_axes[1:], layout.mirror_axes[1:]
    roll = 2.0 * math.cos(layout.incidence) * product(e, t).T
    along = 2.0 * product(e, layout.mirror_axes[0])[:, np.newaxis] * product(t, layout.sun_axes[0])
    return np.stack((0.5 * np.eye(2), *map(_inverted, (roll, along + roll))))


def themis_8() -> Modules:
    """Return the eight modules of a THEMIS-like heliostat.

    Each module is 3.6 m wide and 1.8 m high. The modules form two columns of four, with gaps of 5 cm. Seen from the
    target, modules 1 to 4 are the left column (y < 0) from top to bottom, and modules 5 to 8 are the right column. The
    positions of the modules are assumptions, because they have not been published.
    """
    size = 3.6, 1.8
    across, down = size[0] + 0.05, size[1] + 0.05
    centre = [(side * 0.5 * across, (1.5 - row) * down) for side in (-1, 1) for row in range(4)]
    return Modules(np.array(centre), np.tile(size, (8, 1)))


def outline(modules: Modules) -> Floats:
    """Return the corners of the bounding rectangle of all modules, shape (4, 2). [m]

    The order of the corners (y, z), as seen by the cameras, is top left, top right, bottom right, bottom left.
    """
    low = (modules.centre - 0.5 * modules.size).min(axis=0)
    high = (modules.centre + 0.5 * modules.size).max(axis=0)
    return np.array([[low[0], high[1]], [high[0], high[1]], [high[0], low[1]], [low[0], low[1]]])


def mirror_grid(modules: Modules, pixel: float) -> MirrorGrid:
    """Return a grid of square pixels over the modules of a heliostat.

    `pixel` is the side length of a pixel [m]. The grid is centred on the bounding rectangle of the modules. Each pixel
    belongs to the module that contains its centre. Modules must not overlap or be narrower than a pixel.
    """
    half = 0.5 * modules.size
    low, high = (modules.centre - half).min(axis=0), (modules.centre + half).max(axis=0)
    count = np.maximum(np.ceil((high - low) / pixel - 1e-6), 1.0)
    y, z = (
        0.5 * (low[axis] + high[axis]) + pixel * (np.arange(int(count[axis])) - 0.5 * (count[axis] - 1.0))
        for axis in (0, 1)
    )
    module = np.zeros((len(z), len(y)), np.int64)
    for row in reversed(range(len(half))):  # a pixel on a shared edge belongs to the first module
        on_y, on_z = (
            np.abs(line - modules.centre[row, axis]) <= half[row, axis] + 1e-9 * pixel
            for axis, line in enumerate((y, z))
        )
        module[np.ix_(on_z, on_y)] = row + 1
    place = np.flatnonzero(module)
    rows, columns = np.divmod(place, len(y))
    return MirrorGrid(y, z, module, place, np.array([y[columns], z[rows]]), module.ravel()[place] - 1)


def eroded(grid: MirrorGrid, cells: int) -> NDArray[np.bool_]:
    """Return True for pixels whose neighbours within `cells` rows and columns are all on the same module."""
    from scipy.ndimage import maximum_filter, minimum_filter

    low, high = (ranked(grid.module, 2 * cells + 1, mode="constant") for ranked in (minimum_filter, maximum_filter))
    return (low == high).ravel()[grid.place]


def maps(grid: MirrorGrid, values: ArrayLike) -> Floats:
    """Arrange the values of N pixels, shape (..., N), on the grid, shape (..., nz, ny), with NaN between modules."""
    packed = np.asarray(values, np.float64)
    full = np.full((*packed.shape[:-1], grid.module.size), math.nan)
    full[..., grid.place] = packed
    return full.reshape(*packed.shape[:-1], *grid.module.shape)


def product(matrix: Floats, vectors: Floats) -> Floats:
    """Return the product of a matrix with each vector; the rounding does not depend on the number of vectors."""
    return np.sum(vectors[..., np.newaxis, :] * matrix, axis=-1)


def _inverted(m: Floats) -> Floats:
    determinant = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    with np.errstate(all="ignore"):
        return np.array([[m[1, 1], -m[0, 1]], [-m[1, 0], m[0, 0]]]) / (determinant if determinant != 0.0 else np.nan)


Row = Floats | tuple[float, float, float]


@inline
def ideal_mirror(focal_length: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the height x [m] and the slopes a and b [rad] of the ideal mirror at a pixel (y, z) [m].

    For a focal length f, the height is x = r^2 / 4 f + r^4 / 64 f^3 (Eqs. 1 and 2). The normal is parallel to
    (1, a, b), with a = -y (1 + r^2 / 8 f^2) / 2 f and b defined likewise.
    """
    curved = (y * y + z * z) / (8.0 * focal_length * focal_length)
    bend = -(1.0 + curved) / (2.0 * focal_length)
    return 2.0 * focal_length * curved * (1.0 + 0.5 * curved), bend * y, bend * z


@inline
def unit(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a vector divided by its length; the components are numbers or arrays."""
    scale = 1.0 / np.sqrt(x * x + y * y + z * z)
    return x * scale, y * scale, z * scale


@inline
def mirror_offsets(
    a: float, b: float, rx: float, ry: float, rz: float, sun_y: Row, sun_z: Row
) -> tuple[float, float, float, float, float, float]:
    """Return the point on the sun's disc that a camera sees in a mirror with the normal N ~ (1, a, b).

    `a` and `b` are the slopes of the ideal mirror plus p [rad]. `rx`, `ry` and `rz` are the components of the unit
    vector R to a camera in the mirror frame. `sun_y` and `sun_z` are attributes of `Scene`. Returns the second and
    third components of B_S S, v and w [1], and their derivatives with respect to the slopes, dv/da, dv/db, dw/da and
    dw/db [1/rad].
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
    """Return `mirror_offsets` for K cameras at N mirror points, as arrays of shape (K, N).

    `points` contains the coordinates (x, y, z) of the points, shape (3, N) [m]. `a` and `b` are the slopes [rad].
    """
    rays: Any = unit(*(layout.eyes.T[:, :, np.newaxis] - points[:, np.newaxis]))
    return mirror_offsets(a, b, *rays, layout.sun_y, layout.sun_z)


#: Brightness at the highest grey level of a camera, relative to the brightness of the disc centre.
FULL_SCALE = 1.25
#: Number of plane waves in a wavy surface.
WAVES = 48
#: Bit flags that give the reason for excluding a camera at a mirror pixel. They can be combined with the flags in
#: `slopes`.
OUT_OF_FRAME, AT_EDGE, SATURATED, NOT_A_NUMBER, AT_LIMB = 64, 8, 16, 32, 4


class Pinholes(NamedTuple):
    """K pinhole cameras; created by `pinholes`.

    Attributes
    ----------
    eyes : ndarray, shape (K, 3)
        Camera positions in the mirror frame. [m]
    axes : ndarray, shape (K, 3, 3)
        Axes of each camera in the mirror frame. The rows point right, down and forward. [1]
    focal : ndarray, shape (K,)
        Focal length. [pixels]
    centre : ndarray, shape (K, 2)
        Principal point (u, v). [pixels]
    """

    eyes: Floats
    axes: Floats
    focal: Floats
    centre: Floats


class Heliostat(NamedTuple):
    """True surface of a heliostat with M modules; created by `heliostat`.

    Attributes
    ----------
    spheres : ndarray, shape (M, 4)
        Centre (x, y, z) of each module's sphere in the mirror frame, and radius of the sphere. [m]
    turns : ndarray, shape (M, 3, 3)
        Rotation of each module; the columns are its x, y and z axes in the mirror frame. [1]
    pivots : ndarray, shape (M, 2, 3)
        Centre of each module, before and after the rotation of the heliostat. [m]
    half : ndarray, shape (M, 2)
        Half the width along y and half the height along z of each module. [m]
    waves : list of (ndarray, ndarray)
        Waviness slopes of each module, shape (2, rows, columns) [rad], followed by z and y of the first pixel and the
        pixel size [m]. The list is empty if the surface has no waviness.
    """

    spheres: Floats
    turns: Floats
    pivots: Floats
    half: Floats
    waves: list[tuple[Floats, tuple[float, float, float]]]


def module_spheres(
    modules: Modules, focal_length: float, canting: ArrayLike, pointing: ArrayLike = (0.0, 0.0)
) -> Floats:
    """Return the sphere on which the surface of each module lies.

    Parameters
    ----------
    modules : Modules
        M modules.
    focal_length : float
        Focal length, which is half the radius of each sphere. [m]
    canting : array_like, shape (M, 2)
        Canting slopes (horizontal, vertical) of each module, which rotate a normal along x to (1, c_y, c_z). [rad]
    pointing : array_like, shape (2,)
        Pointing slopes (horizontal, vertical), which rotate the whole heliostat. [rad]

    Returns
    -------
    ndarray, shape (M, 4)
        Centre (x, y, z) of each sphere in the mirror frame, and radius of the sphere. [m]
    """
    radius, spheres = 2.0 * focal_length, []
    for (y, z), turn in zip(modules.centre, np.asarray(canting, np.float64), strict=True):
        square = y**2 + z**2
        rim = math.sqrt(radius**2 - square)
        place = np.array([square / (radius + rim), y, z])  # centre of the module on the ideal sphere
        spheres.append([*turned(place + turned(np.array([rim, -y, -z]), turn), pointing), radius])
    return np.array(spheres)


def waviness(grid: MirrorGrid, rms: float, length: float, seed: int) -> Floats:
    """Return the slopes of a random wavy surface at the grid pixels, shape (2, N). [rad]

    The horizontal and vertical slopes are the gradient of a sum of plane waves. The mean slope of each module is
    subtracted, because a mean slope would act as canting. `rms` is the root mean square of the slopes over both
    directions and all pixels [rad]. The wavelengths are log-normally distributed with median `length` [m] and a
    logarithmic standard deviation of 1/3. For a given seed, the waves do not depend on the grid.
    """
    slopes, way = np.zeros(grid.pixels.shape), math.pi * (np.arange(WAVES) + 0.5) / WAVES
    draws = normal_draws(seed, 2, 3 * WAVES).reshape(WAVES, 3)
    for (size, phase, spread), angle in zip(draws, way, strict=True):
        wave = 2.0 * math.pi / (length * math.exp(spread / 3.0))
        c, s = math.cos(angle), math.sin(angle)
        # The slope amplitude of a wave does not depend on its wavelength. A normally distributed phase with a standard
        # deviation of 100 rad is practically uniform.
        slope = size * np.cos(wave * c * grid.pixels[0] + wave * s * grid.pixels[1] + 100.0 * phase)
        slopes += np.stack((c * slope, s * slope))
    for row in range(int(grid.pixel_module.max()) + 1):
        here = grid.pixel_module == row
        slopes[:, here] -= slopes[:, here].mean(axis=1, keepdims=True)
    return slopes * (rms / math.sqrt(float(np.mean(slopes**2))))


def image_set(
    layout: Scene, grid: MirrorGrid, profile: Profile, spheres: Floats, wavy: Floats | None = None
) -> tuple[Floats, Floats]:
    """Render the images seen by K cameras at the N pixels of a grid.

    The height variations of a wavy surface are neglected. For slopes of 0.3 mrad at a wavelength of 1 m, these
    variations would deflect a ray by at most 1e-4 mrad.

    Parameters
    ----------
    layout, grid, profile
        Scene, pixel grid and sun profile.
    spheres : ndarray, shape (M, 4)
        Spheres of the modules, from `module_spheres`. [m]
    wavy : ndarray, shape (2, N), optional
        Additional slopes from `waviness`. [rad]

    Returns
    -------
    images : ndarray, shape (K, N)
        Brightness relative to the disc centre, 0 outside the disc. [1]
    slopes : ndarray, shape (2, N)
        True slopes p relative to the ideal mirror of the scene. [rad]
    """
    ball_x, ball_y, ball_z, radius = spheres[grid.pixel_module].T
    away = np.stack((ball_y, ball_z)) - grid.pixels
    depth = np.sqrt(radius * radius - away[0] * away[0] - away[1] * away[1])
    normals = away / depth + (0.0 if wavy is None else wavy)
    v, w, *_ = offsets(layout, np.stack((ball_x - depth, *grid.pixels)), *normals)
    return _render(profile, v * v + w * w), normals - ideal_mirror(layout.focal_length, *grid.pixels)[1:]


@kernel
def _render(profile: Profile, squares: Floats) -> Floats:
    """Return the brightness of the disc at squared angles from its centre [rad^2], with the shape of `squares`. [1]"""
    out = np.empty(squares.size)
    for k, square in enumerate(squares.flat):
        out[k] = rendered(profile, square)
    return out.reshape(squares.shape)


def expose(images: Floats, noise: float = 0.0, bits: int = 0, seed: int = 0, *, pinhole: bool = False) -> Floats:
    """Add camera noise to images, then round the brightness to grey levels.

    Parameters
    ----------
    images : ndarray, shape (K, N) or (K, rows, columns)
        Brightness relative to the disc centre. [1]
    noise : float
        Standard deviation of the normally distributed noise, relative to the brightness of the disc centre. If the
        brightness is not rounded, it may become negative. [1]
    bits : int
        Number of bits per pixel. Brightness is rounded to 2^bits levels from 0 to `FULL_SCALE`. It is not rounded if
        `bits` is 0.
    seed : int
        Seed of the noise.
    pinhole : bool
        If True, each camera has its own stream of random numbers, so that the noise of a pixel does not depend on the
        number of cameras.

    Returns
    -------
    ndarray
        Brightness, same shape as `images`. [1]
    """
    out = images
    if noise > 0.0:
        # Random streams 1 and 2 are reserved for noise in the sun profile and for waviness.
        first, parts = (8, len(images)) if pinhole else (3, 1)
        draws = [normal_draws(seed, first + part, images.size // parts) for part in range(parts)]
        out = out + noise * np.reshape(draws, images.shape)
    if bits > 0:
        top = 2.0**bits - 1.0
        out = np.rint(np.clip(out / FULL_SCALE, 0.0, 1.0) * top) * (FULL_SCALE / top)
    return out


def heliostat(
    modules: Modules,
    focal_length: float,
    canting: ArrayLike,
    pointing: ArrayLike = (0.0, 0.0),
    wavy: tuple[MirrorGrid, Floats] | None = None,
) -> Heliostat:
    """Return the true surface of a heliostat.

    The first four parameters are described in `module_spheres`. `wavy` contains a pixel grid over the modules, and the
    slopes from `waviness` at the grid pixels [rad]. The slopes are interpolated linearly between pixels, so the pixels
    should be small compared with the wavelengths.
    """
    rim = 2.0 * focal_length - np.sqrt(4.0 * focal_length**2 - np.sum(modules.centre**2, axis=1))
    before = np.column_stack((rim, modules.centre))
    pivots = np.stack((before, turned(before, pointing)), axis=1)
    turns = np.array([turned(turned(np.eye(3), cant), pointing).T for cant in np.asarray(canting, np.float64)])
    waves = []
    if wavy is not None:
        grid, slopes = wavy
        longest = max(grid.y, grid.z, key=len)
        field = maps(grid, slopes)
        for row in range(len(before)):
            z, y = (np.unique(each) for each in np.nonzero(grid.module == row + 1))
            corner = grid.z[z[0]], grid.y[y[0]], longest[1] - longest[0] if len(longest) > 1 else 1.0
            waves.append((field[:, z[0] : z[-1] + 1, y[0] : y[-1] + 1], corner))
    spheres = module_spheres(modules, focal_length, canting, pointing)
    return Heliostat(spheres, turns, pivots, 0.5 * modules.size, waves)


def camera_set(
    layout: Scene, cameras: Pinholes, shape: tuple[int, int], profile: Profile, mirror: Heliostat, supersampling: int
) -> Floats:
    """Render the images of K pinhole cameras, shape (K, rows, columns). [1]

    The brightness is relative to the disc centre. It is 0 outside the disc and outside the modules. The brightness of a
    pixel is the mean over `supersampling` x `supersampling` points. The camera positions come from `cameras`, and the
    sun direction from `layout`.
    """
    fine = np.array(shape) * supersampling
    images = np.zeros((len(cameras.eyes), *fine))
    for image, eye, axes, focal, centre in zip(images, *cameras, strict=False):
        nearest = np.full(fine, math.inf)
        for m, (ball, turn, (before, after), half) in enumerate(zip(*mirror[:4], strict=True)):
            pivot = after - eye
            right, below, depth = axes @ pivot
            if depth <= 0.0:
                continue
            # Half the width and height of the module in the image, with a margin for sag and perspective.
            size = np.abs(axes[:2] @ turn[:, 1:]) @ half + 0.5 * half @ half / ball[3]
            reach = focal * size[::-1] / depth * (1.0 + 2.0 * math.hypot(*half) / depth) + 1.0
            middle = centre[::-1] + focal / depth * np.array([below, right])
            ends = np.clip((np.array([middle - reach, middle + reach]) + 0.5) * supersampling, 0, fine).astype(int)
            here = tuple(slice(low, high) for low, high in zip(*ends, strict=True))
            v, u = (((np.arange(*each) + 0.5) / supersampling - 0.5 - at) / focal
                    for each, at in zip(ends.T, centre[::-1], strict=True))  # fmt: skip
            ray = np.tensordot(axes.T, np.stack(np.broadcast_arrays(u, v[:, np.newaxis], 1.0)), 1)
            ray /= np.sqrt(np.sum(ray**2, axis=0))
            # The path length to the concave side of the sphere is NaN if a ray misses the sphere.
            off, radius = eye - ball[:3], ball[3]
            middle = np.tensordot(off, ray, 1)
            with np.errstate(invalid="ignore"):
                path = np.sqrt(middle * middle - off @ off + radius * radius) - middle
                own = np.tensordot(turn.T[1:], path * ray - pivot[:, np.newaxis, np.newaxis], 1)
                inside = (path < nearest[here]) & (np.abs(own) <= half[:, np.newaxis, np.newaxis]).all(axis=0)
            ray, path, own = ray[:, inside], path[inside], own[:, inside] + before[1:, np.newaxis]
            normal = ball[:3, np.newaxis] - eye[:, np.newaxis] - path * ray
            slopes = normal[1:] / normal[0]
            if mirror.waves:
                slopes = slopes + _between(*mirror.waves[m], own)
            y, z, *_ = mirror_offsets(*slopes, *-ray, layout.sun_y, layout.sun_z)
            image[here][inside], nearest[here][inside] = _render(profile, y * y + z * z), path
    return images.reshape(len(images), shape[0], supersampling, shape[1], supersampling).mean(axis=(2, 4))


def _between(slopes: Floats, corner: tuple[float, float, float], places: Floats) -> Floats:
    """Interpolate waviness slopes linearly at positions (y, z), shape (2, n). The slopes are constant outside the
    grid.
    """
    from scipy.ndimage import map_coordinates

    at = [(places[1] - corner[0]) / corner[2], (places[0] - corner[1]) / corner[2]]
    return np.array([map_coordinates(each, at, order=1, mode="nearest") for each in slopes])


def turned(vectors: Floats, slopes: ArrayLike) -> Floats:
    """Rotate vectors, shape (..., 3), by the smallest rotation that takes the x axis to (1, c_y, c_z)."""
    from scipy.spatial.transform import Rotation

    y, z = np.asarray(slopes, np.float64)
    length = math.hypot(y, z)
    if not length:
        return vectors
    return Rotation.from_rotvec(math.atan(length) / length * np.array([0.0, -z, y])).apply(vectors)


def pinholes(
    layout: Scene,
    shape: tuple[int, int],
    focal: ArrayLike,
    centre: ArrayLike | None = None,
    roll: ArrayLike = 0.0,
) -> Pinholes:
    """Return pinhole cameras that point from the scene's camera positions at the heliostat's centre.

    Parameters
    ----------
    layout : Scene
        Scene with K cameras.
    shape : (int, int)
        Number of rows and columns in an image.
    focal : array_like, shape () or (K,)
        Focal length divided by the pixel size. [1]
    centre : array_like, shape (2,) or (K, 2), optional
        Principal point (u, v), where the heliostat's centre appears (default: the image centre). [pixels]
    roll : array_like, shape () or (K,)
        Rotation about the line of sight, clockwise for an observer behind the camera. Images rotate in the opposite
        direction. [rad]

    Raises
    ------
    ValueError
        If a camera looks straight up or down.
    """
    count = len(layout.eyes)
    turn = np.broadcast_to(np.asarray(roll, np.float64), (count,))[:, np.newaxis]
    forward = -layout.eyes / np.sqrt(np.sum(layout.eyes**2, axis=1, keepdims=True))
    right = np.cross(forward, layout.mirror_axes[:, 2])  # vertical axis of R_F in the mirror frame
    length = np.sqrt(np.sum(right**2, axis=1, keepdims=True))
    if np.any(length < 1e-9):
        raise ValueError("a camera that looks straight up or down has no upright image")
    right = right / length
    down, c, s = np.cross(forward, right), np.cos(turn), np.sin(turn)
    middle = (0.5 * (shape[1] - 1), 0.5 * (shape[0] - 1)) if centre is None else centre
    return Pinholes(
        layout.eyes,
        np.stack((c * right + s * down, c * down - s * right, forward), axis=1),
        np.array(np.broadcast_to(np.asarray(focal, np.float64), (count,))),
        np.array(np.broadcast_to(np.asarray(middle, np.float64), (count, 2))),
    )


def places_of(cameras: Pinholes, focal_length: float, pixels: Floats) -> Floats:
    """Return the image positions (u, v), shape (K, 2, N), of points (y, z) on the ideal mirror, shape (2, N) [m]."""
    x, _, _ = ideal_mirror(focal_length, *pixels)
    way = np.stack((x, *pixels)) - cameras.eyes[:, :, np.newaxis]
    right, below, depth = np.moveaxis(np.sum(cameras.axes[..., np.newaxis] * way[:, np.newaxis], axis=2), 1, 0)
    focal = cameras.focal[:, np.newaxis]
    return cameras.centre[:, :, np.newaxis] + np.stack((focal * right / depth, focal * below / depth), axis=1)


def homography(here: Floats, there: Floats) -> Floats:
    """Return the homography that maps four points in a plane to four other points, shape (3, 3).

    The points `here` and `there` have shape (4, 2). The homography H satisfies (there, 1) ~ H (here, 1). Raises
    ValueError if three points are collinear, or if the mapping reverses the order of the points.
    """
    (x, y), (u, v), one, none = here.T, there.T, np.ones(4), np.zeros(4)
    rows = np.concatenate(
        (
            np.stack((x, y, one, none, none, none, -u * x, -u * y), axis=1),
            np.stack((none, none, none, x, y, one, -v * x, -v * y), axis=1),
        )
    )
    if not np.linalg.cond(rows / np.abs(rows).max(axis=0)) < 1e8:
        raise ValueError("collinear points do not determine a homography")
    found = np.append(np.linalg.solve(rows, np.concatenate((u, v))), 1.0).reshape(3, 3)
    depth = found[2, 0] * x + found[2, 1] * y + 1.0
    if np.any(depth * depth[0] <= 0.0) or np.linalg.det(found) <= 0.0:
        raise ValueError("the two sets of points are not in the same order")
    return found


def moved(matrix: Floats, points: Floats) -> Floats:
    """Apply a homography to points, shape (2, N)."""
    x, y, depth = matrix @ np.stack((*points, np.ones_like(points[0])))
    return np.stack((x / depth, y / depth))


def rectify(
    images: Floats,
    cameras: Pinholes,
    focal_length: float,
    modules: Modules,
    grid: MirrorGrid,
    *,
    corners: ArrayLike | None = None,
    saturation: ArrayLike = math.inf,
    threshold: float = -math.inf,
) -> tuple[Floats, Integers, Floats]:
    """Interpolate images at the mirror pixels.

    Parameters
    ----------
    images : ndarray, shape (K, rows, columns)
        Brightness in any unit.
    cameras : Pinholes
        K cameras.
    focal_length : float
        Focal length of the ideal mirror. [m]
    modules : Modules
    grid : MirrorGrid
        Grid with N pixels on modules.
    corners : array_like, shape (K, 4, 2), optional
        Positions of the corners in each image, in the order of `outline`; NaN for an image whose pinhole geometry is
        exact. [pixels]
    saturation : array_like, shape () or (K,)
        Minimum value of a saturated pixel.
    threshold : float
        Minimum value of a lit pixel.

    Returns
    -------
    values : ndarray, shape (K, N)
        Interpolated brightness; NaN if `flags` is not 0.
    flags : ndarray of int, shape (K, N)
        Sum of the flags that apply: `OUT_OF_FRAME`, `AT_EDGE`, `SATURATED`, `NOT_A_NUMBER` and `AT_LIMB`.
    noise : ndarray, shape (K, N)
        Standard deviation of the interpolated brightness if the standard deviation of each image pixel is 1. This is
        the square root of the sum of the squared weights.

    Raises
    ------
    ValueError
        If the corners do not determine a homography.
    """
    count, rows, columns = images.shape
    signs = np.array([[-1.0, 1.0, 1.0, -1.0], [1.0, 1.0, -1.0, -1.0]])
    edges = modules.centre.T[:, :, np.newaxis] + 0.5 * modules.size.T[:, :, np.newaxis] * signs[:, np.newaxis]
    limits = np.broadcast_to(np.asarray(saturation, np.float64), (count,))
    values, noise = np.empty((2, count, grid.place.size))
    flags = np.zeros(values.shape, np.int64)
    every = (
        places_of(cameras, focal_length, points) for points in (grid.pixels, edges.reshape(2, -1), outline(modules).T)
    )
    for i, (places, quads, ends) in enumerate(zip(*every, strict=True)):
        if corners is not None and not np.any(np.isnan(marked := np.asarray(corners, np.float64)[i])):
            found = homography(ends.T, marked)
            places, quads = moved(found, places), moved(found, quads)
        u, v = places
        inside = (u >= 1.0) & (u < columns - 2.0) & (v >= 1.0) & (v < rows - 2.0)  # False for NaN
        column, row = (np.where(inside, at, 1.0).astype(np.int64) for at in (u, v))
        # The block of 4 x 4 pixels and the module are both convex, so testing the corners of the block is sufficient.
        ahead = np.roll(quads.reshape(2, -1, 4), -1, axis=-1) - quads.reshape(2, -1, 4)
        # inward normals of the edges; the corners are in clockwise order in the image
        n_u, n_v = np.array([-ahead[1], ahead[0]]) / np.hypot(*ahead)
        shift = -(n_u * quads[0].reshape(-1, 4) + n_v * quads[1].reshape(-1, 4))
        n_u, n_v, shift = (each[grid.pixel_module].T for each in (n_u, n_v, shift))
        far = n_u * (column + 0.5) + n_v * (row + 0.5) + shift - 2.0 * (np.abs(n_u) + np.abs(n_v))
        total, square, dark = np.zeros((3, u.size))
        for n in range(16):
            here_u, here_v = column - 1 + n % 4, row - 1 + n // 4
            weight, value = _weight(u - here_u) * _weight(v - here_v), images[i, here_v, here_u]
            flags[i] |= NOT_A_NUMBER * np.isnan(value) | SATURATED * (value >= limits[i])
            total, square, dark = total + weight * value, square + weight * weight, dark + (value < threshold)
        # a margin of 0.1 pixels allows for registration errors
        flags[i] |= AT_EDGE * ~np.all(far >= 0.1, axis=0) | AT_LIMB * ((dark > 0) & (dark < 16))
        flags[i] = np.where(inside, flags[i], OUT_OF_FRAME)
        values[i], noise[i] = np.where(flags[i] == 0, (total, np.sqrt(square)), np.nan)
    return values, flags, noise


def rotate(image: Floats, angle: float) -> Floats:
    """Rotate an image about its centre by three shears.

    Each shear shifts the lines of the image with Fourier transforms.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Image that is zero near all edges, because the shears wrap around.
    angle : float
        Angle from the u axis (columns) towards the v axis (rows). A point (u, v) moves to (u cos - v sin, u sin + v
        cos). [rad]

    References
    ----------
    Unser, Thevenaz and Yaroslavsky (1995), IEEE Trans. Image Process. 4, 1371-1381.
    """
    quarters = round(angle / (0.5 * math.pi))
    out, rest = np.rot90(image, -quarters), angle - 0.5 * math.pi * quarters
    for axis, factor in ((1, -math.tan(0.5 * rest)), (0, math.sin(rest)), (1, -math.tan(0.5 * rest))):
        lines = np.moveaxis(out, axis, 1)
        shift = factor * (np.arange(len(lines)) - 0.5 * (len(lines) - 1))
        phase = np.exp(-2j * math.pi * shift[:, np.newaxis] * np.fft.rfftfreq(lines.shape[1]))
        out = np.moveaxis(np.fft.irfft(np.fft.rfft(lines, axis=1) * phase, lines.shape[1], axis=1), 1, axis)
    return out


def align(images: Floats, cameras: Pinholes, focal_length: float, modules: Modules, grid: MirrorGrid) -> Floats:
    """Rotate, centre and stretch square images to the mirror pixels.

    Defieux et al. (2020) process images in this way before applying methods A and O1. A rotation by Fourier transforms
    aligns the rows of each image with the y axis of the mirror. The maximum of the cross-correlation with a mask of the
    modules gives the shift in whole pixels. A linear map then stretches each image to the shape of the mirror.

    Parameters
    ----------
    images : ndarray, shape (K, side, side)
        Brightness in any unit, 0 outside the heliostat.
    cameras, focal_length, modules, grid
        As in `rectify`.

    Returns
    -------
    ndarray, shape (K, N)
        Brightness at the mirror pixels.
    """
    from scipy.ndimage import map_coordinates

    margin = images.shape[1] // 4
    padded = np.pad(images, ((0, 0), (margin, margin), (margin, margin)))
    middle, steps = 0.5 * (padded.shape[1] - 1), np.indices(padded.shape[1:])[::-1]
    corners, values = outline(modules).T, np.empty((len(images), grid.place.size))
    ends = places_of(cameras, focal_length, corners) - cameras.centre[:, :, np.newaxis]
    for i, end in enumerate(ends):
        linear = np.linalg.lstsq(np.vstack((corners, np.ones(4))).T, end.T, rcond=None)[0][:2].T
        angle = math.atan2(linear[1, 0], linear[0, 0])
        c, s = math.cos(angle), math.sin(angle)
        stretch = np.array([[c, s], [-s, c]]) @ linear  # [pixels/m]; the first column is along the image rows
        upright = rotate(padded[i], -angle)
        y, z = np.tensordot(np.linalg.inv(stretch), steps - middle, 1)
        inside = np.zeros(upright.shape)
        for centre, size in zip(*modules, strict=True):
            inside[(abs(y - centre[0]) <= 0.5 * size[0]) & (abs(z - centre[1]) <= 0.5 * size[1])] = 1.0
        match = np.fft.irfft2(np.fft.rfft2(upright) * np.conj(np.fft.rfft2(inside)), upright.shape)
        peak = np.unravel_index(np.argmax(match), match.shape)
        row, column = ((at + len(match) // 2) % len(match) - len(match) // 2 for at in peak)
        u, v = stretch @ grid.pixels + middle
        values[i] = map_coordinates(upright, (v + row, u + column), order=1)
    return values


def _weight(distance: Floats) -> Floats:
    """Return the weights of Keys' cubic convolution kernel (a = -1/2) for distances below 2 pixels."""
    d = np.abs(distance)
    return np.where(d <= 1.0, 1.0 + d * d * (1.5 * d - 2.5), 2.0 + d * (-4.0 + d * (2.5 - 0.5 * d)))
