"""Two-axis mounts with six angular errors in front of a receiver plane: kinds, frames, exact aiming, and spots.

Angles are stored as (cosine, sine) pairs, and matrices as tuples of rows. In the world frame, x points east, y north
and z up. The receiver is a rectangle centred on the aim point T. The axes X, Y, Z of the receiver's face are the rows

    X = (cos b sin g, cos b cos g, sin b),  Y = (-cos g, sin g, 0),  Z = X x Y

where g is the azimuth (from north, clockwise) and b the tilt (up) of the outward normal X. A spot at a point p on the
plane has the coordinates y = Y.(p - T), positive to the right for an observer in the field who faces the receiver, and
z = Z.(p - T), positive upwards.

The axes of the mount's frame are the rows of Q in the world frame: x, y (the bore at zero angles) and z (the primary
axis). The encoder angles are g (azimuth about the primary axis, clockwise seen from its end) and a (elevation). The
errors, in the order of `ERRORS`, are g0 and a0 (encoder references), te and tn (tilt of the primary axis, a rotation
vector about x and y of the frame), eta (non-orthogonality of the axes) and mu (collimation, the angle between normal
and bore). The normal n and the mirror centre P are

    n = Q^T Rtilt(te, tn) Rz(-(g + g0)) Ry(eta) Rx(a + a0) (sin mu, cos mu, 0)
    P = C + Q^T [Rtilt (h u + Rz(-(g + g0)) ((0, q, 0) + Ry(eta) Rx(a + a0) (0, r, 0))) - h u]

where r is the mirror offset along the bore, q the axis offset, and h the height of the pivot above the base that tilts.
The base is vertically below the pivot, u = Q (0, 0, 1), for any direction of the primary axis.

The following vectors are in the frame of the tilted primary axis: s to the sun, d from the tilted pivot to the aim
point, and c from the tilted pivot to the mirror centre. The normal is n = unit(s + unit(d - c)). The normal gives the
angles, and the angles give the centre c' = F(c). Newton's method solves c = F(c). A change dc in the centre changes the
two angles by G dc. A change v in the angles changes the centre by C v. Hence

    c* = F(c) + C v,   (1 - G C) v = G (F(c) - c)

where v solves a 2 x 2 system. Two steps are usually sufficient. More steps are needed if the offsets are not small
compared with the distance.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import Floats, inline, kernel
from heliosweep.kernels.vectors import Vector, cross, dot, minus, mixed, scaled, three, unit

Matrix = tuple[Vector, Vector, Vector]
#: Kinds of mounts. `AZIMUTH_ELEVATION`: Mount with a vertical primary axis.
#: `TARGET_ALIGNED`: Mount with its primary axis along the line from the pivot to the aim point.
#: `POLAR`: Mount with its primary axis along the axis of the Earth.
#: `TILT_ROLL`: Mount with a horizontal primary axis.
AZIMUTH_ELEVATION, TARGET_ALIGNED, POLAR, TILT_ROLL = range(4)
#: Names of the six mount errors [rad], in the order used by all error arrays.
ERRORS = (
    "azimuth_reference",
    "elevation_reference",
    "tilt_about_east",
    "tilt_about_north",
    "non_orthogonality",
    "collimation",
)
#: Sine of the angle to the vertical, or cosine of an elevation, below which a direction is treated as vertical.
_LEVEL = 1e-12


@inline
def mount_frame(kind: int, latitude: float, axis_azimuth: float, to_target: Vector) -> Matrix:
    """Return the axes x, y, z of a mount [1]; z is the primary axis, and the primary angle is zero along y.

    For azimuth-elevation mounts, x points east and z up. For target-aligned mounts, z points along `to_target`, the
    vector from the pivot to the aim point [m], and y is as close to vertical as possible (north if z is vertical). For
    polar mounts, x points east and z to the celestial north pole at `latitude` [rad]. For tilt-roll mounts, z is
    horizontal towards `axis_azimuth` [rad] and y points up.
    """
    x, z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    if kind == TARGET_ALIGNED:
        z = unit(to_target)
        level = math.sqrt(z[0] * z[0] + z[1] * z[1])
        if level >= _LEVEL:
            x = (-z[1] / level, z[0] / level, 0.0)
        else:
            sign = math.copysign(1.0, z[2])
            x, z = (sign, 0.0, 0.0), (0.0, 0.0, sign)
    elif kind == POLAR:
        z = (0.0, math.cos(latitude), math.sin(latitude))
    elif kind == TILT_ROLL:
        sine, cosine = math.sin(axis_azimuth), math.cos(axis_azimuth)
        x, z = (-cosine, sine, 0.0), (sine, cosine, 0.0)
    return x, cross(z, x), z


@inline
def times(m: Matrix, v: Vector) -> Vector:
    """Return the product of a matrix and a vector."""
    return dot(m[0], v), dot(m[1], v), dot(m[2], v)


@inline
def back(m: Matrix, v: Vector) -> Vector:
    """Return the product of a transposed matrix and a vector."""
    return mixed(1.0, mixed(v[0], m[0], v[1], m[1]), v[2], m[2])


@inline
def tilt_axes(east: float, north: float) -> tuple[Vector, Vector]:
    """Return the axes about which a mount rotates when a tilt component changes, in the frame of the tilted axis."""
    square = east * east + north * north
    if square < 1e-4:
        v = 0.5 + square * (-1 / 24 + square * (1 / 720 - square / 40320))
        third = 1 / 6 + square * (-1 / 120 + square * (1 / 5040 - square / 362880))
    else:
        angle = math.sqrt(square)
        v, third = (1.0 - math.cos(angle)) / square, (1.0 - math.sin(angle) / angle) / square
    across = third * east * north
    return (1.0 - third * north * north, across, v * north), (across, 1.0 - third * east * east, -v * east)


@inline
def bore(ca, sa, ce, se, x, y):
    """Return Ry(eta) Rx(a) (x, y, 0) for the cosines and sines of a and eta."""
    up = sa * y
    return ce * x + se * up, ca * y, ce * up - se * x


@inline
def turn(cg, sg, x, y):
    """Return the horizontal components of Rz(-g) (x, y, .), clockwise from above, for the cosine and sine of g."""
    return cg * x + sg * y, cg * y - sg * x


@inline
def point(n, ce, se, cm, sm):
    """Return the angles at which the mirror has the normal `n` in the frame of the tilted primary axis.

    `n` is the normal n' = Rtilt^T Q n [1]. `ce`, `se`, `cm` and `sm` are the cosines and sines of eta and mu. Returns
    the cosine and sine of g + g0 and of a + a0, and a margin that is negative in the blind cone, where the angles are
    undefined. If the normal is along the primary axis, g + g0 is set to 0.
    """
    nx, ny, nz = n
    level = nx * nx + ny * ny
    defined = level > 1e-300
    level = level if defined else 0.0
    each = 1.0 / ce
    x, up = (sm + nz * se) * each, (nz + se * sm) * each
    margin = level - x * x
    y = math.sqrt(max(margin, 0.0))
    inverse, each = 1.0 / level if defined else 0.0, 1.0 / cm
    cg = (x * nx + y * ny) * inverse if defined else 1.0
    return cg, (y * nx - x * ny) * inverse, y * each, up * each, margin


#: Statuses of spots. `REACHES`: The ray reaches the receiver plane. The spot is NaN for all other statuses.
#: `MISSES`: The ray points away from the plane or is parallel to it, or the sun illuminates the back of the mirror.
#: `BEHIND_FACE`: The pivot or the mirror centre lies on the receiver plane or behind it.
#: `NO_SUN`: The sun is not above the horizon, or its position is NaN.
#: `BLIND_CONE`: The mount cannot point in the required direction, although the aim point is far enough away.
#: `TOO_NEAR`: The offsets of the mirror are not smaller than the distance to the aim point.
REACHES, MISSES, BEHIND_FACE, NO_SUN, BLIND_CONE, TOO_NEAR = range(6)


class Setting(NamedTuple):
    """Receiver and mount for P parameter combinations, constant in time; each array has shape (P,)."""

    #: Azimuth of the face's outward normal, from north, clockwise. [rad]
    face_azimuth: NDArray[np.float64]
    #: Tilt of the outward normal above the horizontal. [rad]
    face_tilt: NDArray[np.float64]
    #: Half the width of the aperture, along Y. [m]
    half_width: NDArray[np.float64]
    #: Half the height of the aperture, along Z. [m]
    half_height: NDArray[np.float64]
    #: Height of the aim point above the base of the tower. [m]
    target_height: NDArray[np.float64]
    #: Mount: `AZIMUTH_ELEVATION`, `TARGET_ALIGNED`, `POLAR` or `TILT_ROLL`.
    kind: NDArray[np.int64]
    #: Geographic latitude, north positive. [rad]
    latitude: NDArray[np.float64]
    #: Azimuth of the horizontal axis of a tilt-roll mount, from north, clockwise. [rad]
    axis_azimuth: NDArray[np.float64]
    #: Distance of the mirror centre from the pivot along the bore (the mirror normal). [m]
    mirror_offset: NDArray[np.float64]
    #: Distance of the secondary axis from the primary axis. [m]
    axis_offset: NDArray[np.float64]
    #: Height of the pivot above the base of the pedestal. [m]
    #: The base is vertically below the pivot, and the pedestal tilts about the base.
    pedestal_height: NDArray[np.float64]


def compiled_setting(setting: Setting) -> Setting:
    """Return the setting with contiguous, writable arrays of the types that the kernels require."""
    dtypes = (np.int64 if name == "kind" else np.float64 for name in Setting._fields)
    return Setting(*(np.require(each, dtype, ["C", "W", "O"]) for each, dtype in zip(setting, dtypes, strict=True)))


@inline
def face_vectors(azimuth: float, tilt: float) -> Matrix:
    """Return the face axes X, Y, Z [1] for azimuth (clockwise from north) and tilt (up) of the outward normal [rad]."""
    sine, cosine, up, out = math.sin(azimuth), math.cos(azimuth), math.sin(tilt), math.cos(tilt)
    return (out * sine, out * cosine, up), (-cosine, sine, 0.0), (-up * sine, -up * cosine, out)


@inline
def trace(p: Vector, n: Vector, s: Vector, face: Matrix) -> tuple[float, float, int]:
    """Return the spot p + l R of the sun ray reflected by a mirror at p, with R = 2 (s.n) n - s.

    The unit vector s points to the sun, and n is the unit normal. The mirror centre p is relative to the aim point [m].
    Returns y and z on the receiver plane [m] (NaN if there is no spot) and the status: `REACHES`, `MISSES`,
    `BEHIND_FACE` or `NO_SUN`.
    """
    (px, py, pz), (nx, ny, nz), (sx, sy, sz) = p, n, s
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = face
    lit = sx * nx + sy * ny + sz * nz
    rx, ry, rz = 2.0 * lit * nx - sx, 2.0 * lit * ny - sy, 2.0 * lit * nz - sz
    before = xx * px + xy * py + xz * pz
    towards = -(xx * rx + xy * ry + xz * rz)
    length = before / towards
    y = yx * (px + length * rx) + yy * (py + length * ry) + yz * (pz + length * rz)
    z = zx * (px + length * rx) + zy * (py + length * ry) + zz * (pz + length * rz)
    status = REACHES if (towards > 0.0 and lit > 0.0) else MISSES
    status = status if before > 0.0 else BEHIND_FACE
    status = status if sz > 0.0 and sx == sx and sy == sy else NO_SUN
    y = y if status == REACHES else math.nan
    z = z if status == REACHES else math.nan
    return y, z, status


#: Cosine and sine of an angle.
Pair = tuple[float, float]
_STEPS = 40


class Mount(NamedTuple):
    """Mount with errors, in the frame of its tilted primary axis."""

    #: Rows of Rtilt^T Q: axes of the frame of the tilted primary axis, in the world frame. [1]
    matrix: Matrix
    #: Vector from the tilted pivot to the aim point. [m]
    target: Vector
    #: Vector from the base to the pivot. [m]
    pole: Vector
    #: Cosine and sine of the azimuth reference, elevation reference, non-orthogonality and collimation.
    g0: Pair
    a0: Pair
    eta: Pair
    mu: Pair
    #: Mirror offset along the bore, and axis offset. [m]
    offset: float
    axis_offset: float


class Mirror(NamedTuple):
    """Mirror of a mount at given encoder angles, in the frame of the tilted primary axis."""

    normal: Vector
    #: Elevation axis in the mirror. [1]
    right: Vector
    #: Secondary axis, and axis about which non-orthogonality rotates the mirror. [1]
    secondary: Vector
    askew: Vector
    #: Vectors to the mirror centre from the secondary axis and from the pivot. [m]
    bore: Vector
    arm: Vector


@inline
def six(errors):
    """Return the six errors of a mount as scalars."""
    return errors[0], errors[1], errors[2], errors[3], errors[4], errors[5]


@inline
def mount_of(errors, frame, to_target, offsets) -> Mount:
    """Return a mount from six errors [rad], the rows of its frame, its aim point [m] and its three offsets [m]."""
    east, north = errors[2], errors[3]
    square = east * east + north * north
    half = 0.5 * math.sqrt(square)
    u = math.sin(2.0 * half) / (2.0 * half) if half > 0.0 else 1.0
    v = 0.5 * (math.sin(half) / half) ** 2 if half > 0.0 else 0.5
    xy = v * east * north
    tilt = (  # matrix Rtilt for the rotation vector (east, north, 0), accurate for any length of the vector
        (1.0 - v * north * north, xy, u * north),
        (xy, 1.0 - v * east * east, -u * east),
        (-u * north, u * east, 1.0 - v * square),
    )
    first, second, third = (
        back(tilt, (frame[0][0], frame[1][0], frame[2][0])),
        back(tilt, (frame[0][1], frame[1][1], frame[2][1])),
        back(tilt, (frame[0][2], frame[1][2], frame[2][2])),
    )
    matrix = (
        (first[0], second[0], third[0]), (first[1], second[1], third[1]), (first[2], second[2], third[2])
    )  # fmt: skip
    pole = frame[0][2] * offsets[2], frame[1][2] * offsets[2], frame[2][2] * offsets[2]
    target = mixed(1.0, back(tilt, mixed(1.0, times(frame, to_target), 1.0, pole)), -1.0, pole)
    return Mount(
        matrix,
        target,
        pole,
        (math.cos(errors[0]), math.sin(errors[0])),
        (math.cos(errors[1]), math.sin(errors[1])),
        (math.cos(errors[4]), math.sin(errors[4])),
        (math.cos(errors[5]), math.sin(errors[5])),
        offsets[0],
        offsets[1],
    )


@inline
def added(one: Pair, other: Pair, sign: float) -> Pair:
    """Return the cosine and sine of the sum of two angles, or of their difference if the sign is -1."""
    return one[0] * other[0] - sign * one[1] * other[1], one[1] * other[0] + sign * one[0] * other[1]


@inline
def mirror_at(mount: Mount, g: Pair, a: Pair) -> Mirror:
    """Return the mirror of a mount at the encoder angles g and a."""
    (cg, sg), (ca, sa) = added(g, mount.g0, 1.0), added(a, mount.a0, 1.0)
    (ce, se), (cm, sm) = mount.eta, mount.mu
    askew = sg, cg, 0.0
    along = _swung(cg, sg, bore(ca, sa, ce, se, 0.0, mount.offset))
    return Mirror(
        _swung(cg, sg, bore(ca, sa, ce, se, sm, cm)),
        _swung(cg, sg, bore(ca, sa, ce, se, cm, -sm)),
        _swung(cg, sg, (ce, 0.0, -se)),
        askew,
        along,
        mixed(1.0, along, mount.axis_offset, askew),
    )


@inline
def _swung(cg, sg, v):
    """Return Rz(-g) v."""
    x, y = turn(cg, sg, v[0], v[1])
    return x, y, v[2]


@inline
def aimed(mount: Mount, sun: Vector) -> tuple[Pair, Pair, int]:
    """Aim a mount with known errors so that it reflects the sun to the aim point.

    `sun` is a unit vector in the world frame. Returns the cosine and sine of each encoder angle, g and a, and the
    status: `REACHES`, `NO_SUN`, `TOO_NEAR` (the offsets are not smaller than the distance to the aim point) or
    `BLIND_CONE` (the mount cannot point in the required direction). The angles are defined only for `REACHES`.
    """
    d, offset, axis_offset = mount.target, mount.offset, mount.axis_offset
    (ce, se), (cm, sm) = mount.eta, mount.mu
    s, far, reach = times(mount.matrix, sun), dot(d, d), abs(offset) + abs(axis_offset)
    n, t, inverse = _half_way(s, d, (0.0, 0.0, 0.0))
    cg, sg, ca, sa, margin = point(n, ce, se, cm, sm)
    status = REACHES
    if not (sun[2] > 0.0 and sun[0] + sun[1] == sun[0] + sun[1]):
        status = NO_SUN
    elif not reach * reach < far:
        status = TOO_NEAR
    elif reach > 0.0:
        c, last, steps = (0.0, 0.0, 0.0), False, 0
        while not last and steps < _STEPS:
            c, last = _newton(c, n, t, inverse, (cg, sg, ca, sa), margin, (ce, se, cm, sm), offset, axis_offset, far)
            n, t, inverse = _half_way(s, d, c)
            cg, sg, ca, sa, margin = point(n, ce, se, cm, sm)
            steps += 1
        status = status if last else BLIND_CONE
    if status == REACHES and not margin >= 0.0:
        status = BLIND_CONE
    return added((cg, sg), mount.g0, -1.0), added((ca, sa), mount.a0, -1.0), status


@inline
def _half_way(s, d, c):
    """Return the normal that reflects s along d - c, the unit vector t along d - c, and 1 / (|d - c| |s + t|)."""
    way = minus(d, c)
    distance = math.sqrt(dot(way, way))
    middle = mixed(distance, s, 1.0, way)
    length = math.sqrt(dot(middle, middle))
    return scaled(1.0 / length, middle), scaled(1.0 / distance, way), 1.0 / length


@inline
def _newton(c, n, t, inverse, angles, margin, askew, offset, axis_offset, far):
    """Return the next mirror centre of Newton's method, and True if the iteration has converged."""
    (cg, sg, ca, sa), (ce, se, cm, sm) = angles, askew
    # centre F(c), and the columns of C: derivatives (x, y, z) with respect to a, and (fy, -fx, 0) with respect to g
    fx, fy, fz = bore(ca, sa, ce, se, 0.0, offset)
    fx, fy = turn(cg, sg, fx, fy + axis_offset)
    x, y, z = bore(-sa, ca, ce, se, 0.0, offset)
    x, y = turn(cg, sg, x, y)
    by_a, by_g, move = (x, y, z), (fy, -fx, 0.0), minus((fx, fy, fz), c)
    # rows of G: t changes by -(1 - t t) dc / distance, and n by (1 - n n) dt / length
    level = max(n[0] * n[0] + n[1] * n[1], _LEVEL * _LEVEL)
    by, bx = cm * ca, ce * sm + se * (cm * sa)
    slope = max(ce * by, _LEVEL)
    rise = (-n[0] * n[2], -n[1] * n[2], n[0] * n[0] + n[1] * n[1])
    per_slope, per_level = inverse / slope, 1.0 / level
    a_row = mixed(-per_slope, rise, per_slope * dot(rise, t), t)
    swing = (n[1], -n[0], 0.0)
    lean = cm * (ca * se * by + bx * sa) * per_level
    g_row = minus(scaled(inverse * per_level, mixed(-1.0, swing, dot(swing, t), t)), scaled(lean, a_row))
    aa, ag, ga, gg = 1.0 - dot(a_row, by_a), -dot(a_row, by_g), -dot(g_row, by_a), 1.0 - dot(g_row, by_g)
    fa, fg, inverse = dot(a_row, move), dot(g_row, move), 1.0 / (aa * gg - ag * ga)
    va, vg = inverse * (gg * fa - ag * fg), inverse * (aa * fg - ga * fa)
    # use a fixed-point step far from the solution, or if the mount cannot point along the current normal
    if not (margin >= 0.0 and va * va + vg * vg < 1.0):
        va, vg = 0.0, 0.0
    # The remaining error is of the order of the squared step, which is below rounding errors.
    last = va * va + vg * vg <= 1e-14 and dot(move, move) <= 1e-12 * far
    moved = mixed(va, by_a, vg, by_g)
    return (fx + moved[0], fy + moved[1], fz + moved[2]), last


def mount_frames(kind: int, latitude: float, axis_azimuth: float, to_target: Floats) -> Floats:
    """Return the axes of mounts.

    Parameters
    ----------
    kind : int
        `AZIMUTH_ELEVATION`, `TARGET_ALIGNED`, `POLAR` or `TILT_ROLL`.
    latitude : float
        Geographic latitude, used by polar mounts. [rad]
    axis_azimuth : float
        Azimuth of the primary axis of tilt-roll mounts, from north, clockwise. [rad]
    to_target : ndarray, shape (N, 3)
        Vectors from the pivots to the aim point. [m]

    Returns
    -------
    ndarray, shape (N, 3, 3)
        Rows of Q: axes x, y (bore at zero angles) and z (primary axis) in the world frame. [1]
    """
    frames = [mount_frame(int(kind), float(latitude), float(axis_azimuth), tuple(each)) for each in to_target.tolist()]
    return np.reshape(frames, (len(to_target), 3, 3))


class Stand(NamedTuple):
    """Mirrors in the world frame: unit vectors [1] and displacements [m], each with shape (..., 3)."""

    normal: Floats
    #: Elevation axis in the mirror.
    right: Floats
    #: Primary axis of the mount.
    primary: Floats
    #: Vector from the pivot to the mirror centre.
    arm: Floats
    #: Vector from the base to the pivot.
    pole: Floats
    #: Mirror centre relative to the aim point.
    centre: Floats

    @property
    def up(self) -> Floats:
        """Axis that points up the slope of the mirror."""
        return np.cross(self.right, self.normal)


class Mounts(NamedTuple):
    """N mounts in front of a receiver."""

    #: Rows of each mount's frame, from `mount_frames`, shape (N, 3, 3). [1]
    frames: Floats
    #: Vectors from the pivots to the aim point, shape (N, 3). [m]
    to_target: Floats
    #: Axes of the receiver's face, from `face_vectors`, shape (3, 3). [1]
    face: Floats
    #: Mirror offset, axis offset and pedestal height, shape (3,). [m]
    offsets: Floats

    def of(self, some: NDArray[np.int64] | slice) -> "Mounts":
        """Return the mounts with the indices `some`."""
        return self._replace(frames=self.frames[some], to_target=self.to_target[some])

    def aim(self, sun: Floats, known: Floats | None = None) -> Floats:
        """Return the encoder angles at which the mounts reflect the sun to the aim point, shape (N, ..., T, 2). [rad]

        The angles correct the errors `known` (default: none), shape (N, ..., 1 or T, 6) [rad]. `sun` contains unit
        vectors to the sun, shape (T, 3), or the shape of `known` with a last axis of length 3. The angles are
        between -pi and pi, and apply to the ray reflected at the mirror centre. The angles are NaN if the sun is at or
        below the horizon, if the required direction is in the blind cone, or if the offsets are not smaller than the
        distance to the aim point.
        """
        known = np.zeros((len(self.frames), 1, 6)) if known is None else known
        return self._rowwise(_aim, 2, sun, known)

    def stand(self, angles: Floats, errors: Floats) -> "Stand":
        """Return the mirrors for encoder angles of shape (N, ..., T, 2) and mount errors of shape (..., 6). [rad]"""
        made = self._rowwise(_stand, 18, angles, errors)
        return Stand(*(made[..., 3 * k : 3 * k + 3] for k in range(6)))

    def on_face(self, plane: Floats) -> Floats:
        """Return points (y, z) on the receiver plane as vectors in the world frame. [m]"""
        # BLAS is not used, because its rounding depends on the number of rows.
        return plane[..., :1] * self.face[1] + plane[..., 1:] * self.face[2]

    def _rowwise(self, fill, count: int, *vectors: Floats) -> Floats:
        """Call a kernel with the rows of the broadcast vectors, and return `count` numbers for each row."""
        inner = slice(None), *[np.newaxis] * (max(each.ndim for each in vectors) - 2)
        arrays = [self.frames.reshape(-1, 9)[inner], self.to_target[inner], *vectors]
        shape = np.broadcast_shapes(*(each.shape[:-1] for each in arrays))
        rows = [np.broadcast_to(each, (*shape, each.shape[-1])).reshape(-1, each.shape[-1]) for each in arrays]
        made = np.full((len(rows[0]), count), math.nan)
        fill(*(np.require(each, np.float64, ["C", "W"]) for each in (*rows, self.offsets)), made)
        return made.reshape(*shape, count)


@kernel
def _aim(frames: Floats, to_target: Floats, sun: Floats, errors: Floats, offsets: Floats, angles: Floats) -> None:
    """Write the encoder angles of N mounts; `frames` has shape (N, 9)."""
    for i in range(len(angles)):
        frame = three(frames[i, 0:3]), three(frames[i, 3:6]), three(frames[i, 6:9])
        g, a, status = aimed(mount_of(six(errors[i]), frame, three(to_target[i]), three(offsets)), three(sun[i]))
        if status == REACHES:
            angles[i, 0], angles[i, 1] = math.atan2(g[1], g[0]), math.atan2(a[1], a[0])


@kernel
def _stand(frames: Floats, to_target: Floats, angles: Floats, errors: Floats, offsets: Floats, made: Floats) -> None:
    """Compute the `Stand` vectors of N mounts and store them in `made`; `frames` has shape (N, 9)."""
    for i in range(len(made)):
        frame = three(frames[i, 0:3]), three(frames[i, 3:6]), three(frames[i, 6:9])
        mount, g, a = mount_of(six(errors[i]), frame, three(to_target[i]), three(offsets)), angles[i, 0], angles[i, 1]
        mirror = mirror_at(mount, (math.cos(g), math.sin(g)), (math.cos(a), math.sin(a)))
        vectors = (
            mirror.normal, mirror.right, (0.0, 0.0, 1.0), mirror.arm, mount.pole, minus(mirror.arm, mount.target)
        )  # fmt: skip
        for k in range(6):
            made[i, 3 * k], made[i, 3 * k + 1], made[i, 3 * k + 2] = back(mount.matrix, vectors[k])


@kernel
def pointing_turns(
    centre: Floats, target: Floats, mounts: Floats, tracking: int, suns: Floats, start: int, stride: int
) -> Floats:
    """Return the pointing errors of N mirrors towards the axes u and v at T instants, shape (N, T, 2). [rad]

    The encoder angles are computed for a mount without errors. The rotation of a mirror about its normal is neglected.
    The pointing errors are zero while the sun is below the horizon.

    Parameters
    ----------
    centre, target : ndarray, shape (N, 3)
        Centres of the mirrors and their aim points: east, north, up. [m]
    mounts : ndarray, shape (N, 6)
        Mount errors, in the order of `ERRORS`. [rad]
    tracking : int
        `TARGET_ALIGNED` or `AZIMUTH_ELEVATION`.
    suns : ndarray, shape (T, 3)
        Unit vectors to the sun. [1]
    start, stride : int
        `start` is the sum of the indices of the first mirror and the first instant. A pointing error is computed only
        if the sum of its mirror and instant indices is a multiple of `stride`, and is 0 otherwise.
    """
    out = np.zeros((len(centre), len(suns), 2))
    for i in range(out.shape[0]):
        way = minus(three(target[i]), three(centre[i]))
        frame, offsets = mount_frame(tracking, 0.0, 0.0, way), (0.0, 0.0, 0.0)
        ideal = mount_of((0.0, 0.0, 0.0, 0.0, 0.0, 0.0), frame, way, offsets)
        mount = mount_of(six(mounts[i]), frame, way, offsets)
        for t in range(out.shape[1]):
            sun = three(suns[t])
            if not sun[2] > 0.0 or (start + i + t) % stride != 0:
                continue
            g, a, status = aimed(ideal, sun)
            if status == REACHES:
                n = unit(mixed(1.0, sun, 1.0, unit(way)))
                u = cross(way, sun) if tracking == TARGET_ALIGNED else (-n[1], n[0], 0.0)
                u = unit(u) if dot(u, u) > 1e-30 else (1.0, 0.0, 0.0)
                moved = back(mount.matrix, mirror_at(mount, g, a).normal)
                along = dot(moved, n)
                out[i, t, 0], out[i, t, 1] = dot(moved, u) / along, dot(moved, cross(n, u)) / along
    return out
