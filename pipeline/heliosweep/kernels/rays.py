"""Ray tracing of a heliostat field: shading, blocking, spillage and flux in one loop.

A block of rays is traced for each heliostat and instant. Each ray is defined by a point on the reflecting area, a
point on the sun, and random slope and specularity errors. Points and errors are taken from scrambled Sobol
sequences [1]_. Eight independent sequences are used in parallel, and their spread gives the standard error of each
result. Coordinates are relative to the mirror's centre, in single precision. Rounding errors are about 60 micrometres
at a distance of 1 km.

References
----------
.. [1] S. Joe and F. Y. Kuo, "Constructing Sobol sequences with better two-dimensional projections", SIAM J. Sci.
   Comput. 30 (2008) 2635-2654, doi 10.1137/070709359
"""

import functools
import math
import operator
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import Floats, Integers, inline, inner, kernel
from heliosweep.kernels.device import run_on_device
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, by_cells, cone, search
from heliosweep.kernels.mounts import face_vectors, pointing_turns
from heliosweep.kernels.sunshapes import SunShape, pillbox, quantile

#: Receiver types: a flat rectangle that receives light on one side, and the outside of an upright cylinder.
RECTANGLE, CYLINDER = 0, 1
#: Number of independent estimates of each result.
REPLICATES = 8
#: Indices of the quantities in `Traced.sums`; the last quantity is 0 if there is no tower.
COSINE, UNSHADED, UNBLOCKED, COSINE_UNSHADED, COSINE_UNBLOCKED, OPTICAL, HIT, LIGHT, REFLECTED, RECEIVED = range(10)
COSINE_PAST_TOWER, QUANTITIES = 10, 11

#: Number of rays in a block.
_LANES = 64
_DIMENSIONS, _BITS = 8, 30
#: For each dimension: degree and coefficients of a primitive polynomial, and initial direction numbers [1]_.
_DIRECTIONS = ((0, 0), (1, 0, 1), (2, 1, 1, 3), (3, 1, 1, 3, 1), (3, 2, 1, 1, 1), (4, 1, 1, 1, 3, 3),
               (4, 4, 1, 3, 5, 13), (5, 2, 1, 1, 5, 5, 17))  # fmt: skip
_FAST = {"contract", "nsz", "arcp"}
_ZERO, _QUARTER, _HALF, _ONE, _TWO, _FAR, _TINY = map(np.float32, (0.0, 0.25, 0.5, 1.0, 2.0, 1e9, 1e-30))
#: Coefficients of a polynomial that approximates the inverse tangent. [turn]
_T0, _T1, _T2, _T3, _T4, _T5 = (
    np.float32(c / (2.0 * math.pi)) for c in (0.99997726, -0.33262347, 0.19354346, -0.11643287, 0.05265332, -0.01172120)
)
#: Number of rows in the scratch array, and number of constants common to all rays of a heliostat at an instant.
_ROWS, _CONSTANTS = 20, 56
#: Offsets of rows 10 to 19 in the scratch array.
#: Rows 0 to 9 contain points, directions to the sun, reflected directions (3 rows each) and the sag.
_UNSHADED, _UNBLOCKED, _HITS, _A, _B, _C, _D, _E, _F, _PAST = (_LANES * row for row in range(10, 20))
#: Maximum number of heliostat-instant pairs in a pilot run.
_PILOT = 50_000
#: Maximum number of rays in a study or call, and minimum number of rays traced per second on one core.
MOST_RAYS, RAYS_PER_SECOND = 2e12, 2e7
#: Binary logarithms of the maximum number of points per replicate, heliostat and instant.
#: The first value applies if the user sets the number of rays, the second if the number is computed from a precision.
_MOST_POWER, _PILOT_POWER = 19, 16
#: Maximum number of rays per heliostat and instant if the number is computed from a precision.
MOST = REPLICATES << _PILOT_POWER

#: Lock under which one thread computes the points (130 MB for 4 million rays). All other threads use the same points.
_LOCK = threading.Lock()


class Errors(NamedTuple):
    """Standard deviations of random errors per axis: one number for all heliostats, or an array of shape (N,). [rad]

    Slope and tracking errors rotate the normal towards u (along the width) and v (along the height). Specularity
    errors deflect the reflected ray.
    """

    slope_u: float | Floats
    slope_v: float | Floats
    specularity: float | Floats


class Facets(NamedTuple):
    """Number of facet columns and rows on each mirror (1 for an undivided mirror), and gap between facets [m]."""

    columns: int
    rows: int
    gap: float


class Receiver(NamedTuple):
    """A rectangular or cylindrical receiver, created by `rectangle` or `cylinder`.

    `centre` contains the east, north and up coordinates of the centre [m]. `across` and `upward` are unit vectors along
    the width and height of a rectangle, which faces the direction of their vector product. `half_width` is half the
    width of a rectangle or the radius of a cylinder, and `half_height` is half the height, both in m.
    """

    kind: int
    centre: tuple[float, float, float]
    across: tuple[float, float, float]
    upward: tuple[float, float, float]
    half_width: float
    half_height: float


def rectangle(centre: tuple[float, float, float], azimuth: float, tilt: float, width: float, height: float) -> Receiver:
    """Return a rectangular receiver.

    `azimuth` (clockwise from north) and `tilt` (above the horizontal) specify the direction of its outward normal
    [rad]. `centre`, `width` and `height` are in m.
    """
    _, across, upward = face_vectors(azimuth, tilt)
    return Receiver(RECTANGLE, centre, across, upward, width / 2, height / 2)


def cylinder(centre: tuple[float, float, float], radius: float, height: float) -> Receiver:
    """Return an upright cylindrical receiver; all lengths are in m."""
    return Receiver(CYLINDER, centre, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), radius, height / 2)


class SlopeMap(NamedTuple):
    """Mirror slopes on a uniform grid, interpolated bilinearly between grid points and constant outside the grid.

    Attributes
    ----------
    x, y : ndarray, shape (C,) and (R,)
        Coordinates along width and height, relative to the centre of the mirror or facet. [m]
    slope : ndarray, shape (M, R, C, 2)
        Rotation of the normal towards u and v, for M maps. Missing values (NaN) are replaced by the nearest valid
        values. [rad]
    number : ndarray of int, shape (N,)
        Index of the slope map of each heliostat.
    facet : bool
        True if a map describes one facet, False if it describes a whole mirror.
    """

    x: Floats
    y: Floats
    slope: Floats
    number: Integers
    facet: bool


class Scene(NamedTuple):
    """Field, receiver and optical errors.

    Attributes
    ----------
    centre, target : ndarray, shape (N, 3)
        Centres of the mirrors and their aim points: east, north, up. [m]
    sides : ndarray, shape (N, 2)
        Width and height of each mirror. [m]
    curve : ndarray, shape (N,), or (N, 2) along u and v
        1 / (2 focal length) of a mirror or facet, 0 if flat. [1/m]
    cant : ndarray, shape (N,)
        1 / (2 focal length) of the canting, 0 for facets in one plane. [1/m]
    turn : ndarray, shape (N, 2)
        Fixed pointing errors: the normal is n + turn_u u + turn_v v. [rad]
    tracking : int
        `packets.SPINNING_ELEVATION` or `packets.AZIMUTH_ELEVATION`.
    mounts : ndarray, shape (N, 6), or (0, 6) without errors
        Mount errors, in the order of `mounts.ERRORS`. [rad]
    tower : (float, float) or None
        Radius and top height of an upright cylinder at x = y = 0 that shades the mirrors. [m]
    """

    centre: Floats
    target: Floats
    sides: Floats
    curve: Floats
    cant: Floats
    turn: Floats
    facets: Facets
    tracking: int
    errors: Errors
    sun: SunShape
    receiver: Receiver
    mounts: Floats = np.empty((0, 6))
    slopes: SlopeMap | None = None
    tower: tuple[float, float] | None = None


class Traced(NamedTuple):
    """Sums over rays.

    All values are integer multiples of a power of two. The sums of several parts of a field or period can therefore be
    added without rounding errors.

    `sums` has shape (`REPLICATES`, heliostats, groups, `QUANTITIES`). `flux` is the light on each cell, in units of
    `unit`, shape (`REPLICATES`, rows, columns). `field` contains the sums over the heliostats at each instant, shape
    (`REPLICATES`, instants, `QUANTITIES`). The sums at each instant are not weighted, but multiplied by `share`
    (`REFLECTED` and `RECEIVED`) or `area` (other quantities).

    If requested, `images` contains the number of lit cells of each heliostat, the indices of these cells, and the light
    on each cell, sorted by heliostat.
    """

    sums: Floats
    flux: NDArray[np.int64]
    unit: float
    field: Floats
    images: tuple[NDArray[Any], ...] = ()


@inline
def lane():
    """Return the index of this thread among the threads that share a block of rays (always 0 on a CPU)."""
    return 0


@inline
def lanes():
    """Return the number of threads that share a block of rays (always 1 on a CPU)."""
    return 1


@inline
def barrier():
    """Wait for all threads that share a block of rays."""


@inline
def add(array, index, value):
    """Add a value to an array element; on a device, the addition is atomic."""
    array[index] += value


@kernel
def _blockers(start, stop, beams, field, spheres, cells, names, rank, found, limits, firsts, out):
    """List the heliostats that may block each heliostat. If `out` is too short, only the offsets `firsts` are valid."""
    for i in range(start, stop):
        dx, dy, dz = field[i, 4] - field[i, 0], field[i, 5] - field[i, 1], field[i, 6] - field[i, 2]
        far = limits[i - start] = math.sqrt(dx * dx + dy * dy + dz * dz)
        count = search(rank[i], cone(dx / far, dy / far, dz / far, beams[i]), far, spheres, cells, found, 0)
        at = firsts[i - start]
        firsts[i - start + 1] = at + count
        for c in range(count if at + count <= out.shape[0] else 0):
            out[at + c] = names[found[c]]


@inner(fastmath=_FAST)
def _frame(j, t, sx, sy, sz, spinning, field, frames, stamp):
    """Write the normal, the axes u and v, and the direction to the aim point of a mirror, once per instant."""
    if stamp[j] == t:
        return
    stamp[j] = t
    rx, ry, rz = field[j, 4] - field[j, 0], field[j, 5] - field[j, 1], field[j, 6] - field[j, 2]
    k = 1.0 / math.sqrt(rx * rx + ry * ry + rz * rz)
    rx, ry, rz = k * rx, k * ry, k * rz
    nx, ny, nz = rx + sx, ry + sy, rz + sz
    k = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = k * nx, k * ny, k * nz
    ux, uy, uz = -ny, nx, 0.0
    if spinning:
        ux, uy, uz = ry * sz - rz * sy, rz * sx - rx * sz, rx * sy - ry * sx
    square = ux * ux + uy * uy + uz * uz
    if square < 1e-30:
        ux, uy, uz = (-ry, rx, 0.0) if spinning and rx * rx + ry * ry > 1e-30 else (1.0, 0.0, 0.0)
        square = ux * ux + uy * uy
    k = 1.0 / math.sqrt(square)
    ux, uy, uz = k * ux, k * uy, k * uz
    vectors = (nx, ny, nz, ux, uy, uz, ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux, rx, ry, rz)
    for c, value in enumerate(vectors):
        frames[j, c] = value


@inner(fastmath=_FAST)
def _place(r, count, points, block, f):
    """Write each ray's point relative to its facet (rows `_A` and `_B`) and the facet centre (rows `_C` and `_D`)."""
    width, height, step_u, step_v, columns, rows, shift_a, shift_b = (
        f[28],
        f[29],
        f[30],
        f[31],
        f[32],
        f[33],
        f[34],
        f[35],
    )
    middle_u, middle_v = _HALF * (columns - _ONE), _HALF * (rows - _ONE)
    for k in range(lane(), count, lanes()):
        a, b = points[block, 0, k] + shift_a, points[block, 1, k] + shift_b
        a, b = (a - np.float32(np.int32(a))) * columns, (b - np.float32(np.int32(b))) * rows
        c, d = np.float32(np.int32(a)), np.float32(np.int32(b))
        r[_A + k], r[_B + k] = (a - c - _HALF) * width, (b - d - _HALF) * height
        r[_C + k], r[_D + k] = (c - middle_u) * step_u, (d - middle_v) * step_v


@inner(fastmath=_FAST)
def _map_slopes(r, count, place, slope, facet):
    """Interpolate a slope map at the starting points of rays, and write the slopes to rows `_E` and `_F`.

    `place` contains the first x and y of the grid, and the inverses of its steps.
    """
    rows, columns = slope.shape[0], slope.shape[1]
    for k in range(lane(), count, lanes()):
        a, b = r[_A + k], r[_B + k]
        if not facet:
            a, b = a + r[_C + k], b + r[_D + k]
        a = min(max((a - place[0]) * place[2], 0.0), columns - 1.0)
        b = min(max((b - place[1]) * place[3], 0.0), rows - 1.0)
        m, n = min(int(a), columns - 2), min(int(b), rows - 2)
        a, b = a - m, b - n
        for c, row in ((0, _E), (1, _F)):
            low = (1.0 - a) * slope[n, m, c] + a * slope[n, m + 1, c]
            high = (1.0 - a) * slope[n + 1, m, c] + a * slope[n + 1, m + 1, c]
            r[row + k] = (1.0 - b) * low + b * high


@inner(fastmath=_FAST)
def _reflect(r, count, points, block, f):
    """Write the rays' points (rows 0 to 2), sun directions (3 to 5), reflected directions (6 to 8) and sag (9).

    Mirrors that shade or block are treated as planes. Rays start on the plane of their mirror or, if its facets are
    canted, on the planes of the facets. Reflected light starts on the curved surface. The sag is the height of this
    surface above the starting point of a ray.
    """
    n0, n1, n2, u0, u1, u2, v0, v1, v2 = f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7], f[8]
    s0, s1, s2, p0, p1, p2, q0, q1, q2 = f[9], f[10], f[11], f[12], f[13], f[14], f[15], f[16], f[17]
    e0, e1, e2, g0, g1, g2 = f[18], f[19], f[20], f[21], f[22], f[23]
    uu, uv, vu, vv = f[24], f[25], f[26], f[27]
    bend_u, bend_v, cant, turn_u, turn_v, lift = f[36], f[37], f[38], f[39], f[54], f[55]
    for k in range(lane(), count, lanes()):
        a, b, c, d = r[_A + k], r[_B + k], r[_C + k], r[_D + k]
        sag = cant * (c * a + d * b) + _HALF * (bend_u * a * a + bend_v * b * b)
        h = lift * sag
        r[9 * _LANES + k] = sag - h
        x, y = points[block, 4, k], points[block, 5, k]
        gu = turn_u + uu * x + uv * y - bend_u * a - cant * c + r[_E + k]
        gv = turn_v + vu * x + vv * y - bend_v * b - cant * d + r[_F + k]
        a, b = a + c, b + d
        r[k], r[_LANES + k] = a * u0 + b * v0 + h * n0, a * u1 + b * v1 + h * n1
        r[2 * _LANES + k] = a * u2 + b * v2 + h * n2
        mx, my, mz = n0 + gu * u0 + gv * v0, n1 + gu * u1 + gv * v1, n2 + gu * u2 + gv * v2
        x, y = points[block, 2, k], points[block, 3, k]
        w = math.sqrt(_ONE - x * x - y * y)
        dx, dy, dz = w * s0 + x * p0 + y * q0, w * s1 + x * p1 + y * q1, w * s2 + x * p2 + y * q2
        m = _TWO * (mx * dx + my * dy + mz * dz) / (mx * mx + my * my + mz * mz)
        x, y = points[block, 6, k], points[block, 7, k]
        r[3 * _LANES + k], r[4 * _LANES + k], r[5 * _LANES + k] = dx, dy, dz
        r[6 * _LANES + k] = m * mx - dx + x * e0 + y * g0
        r[7 * _LANES + k] = m * my - dy + x * e1 + y * g1
        r[8 * _LANES + k] = m * mz - dz + x * e2 + y * g2


@inner(fastmath=_FAST)
def _cover(r, count, way, lit, limit, j, i, field, frames):
    """Set row `lit` to 0 for rays that hit mirror j closer than `limit`. Rows `way` contain the ray directions."""
    single, e = np.float32, frames[j]
    n0, n1, n2, u0, u1 = single(e[0]), single(e[1]), single(e[2]), single(e[3]), single(e[4])
    u2, v0, v1, v2, limit = single(e[5]), single(e[6]), single(e[7]), single(e[8]), single(limit)
    cx, cy, cz = single(field[j, 0] - field[i, 0]), single(field[j, 1] - field[i, 1]), single(field[j, 2] - field[i, 2])
    half_width, half_height = single(field[j, 7]), single(field[j, 8])
    for k in range(lane(), count, lanes()):
        qx, qy, qz = cx - r[k], cy - r[_LANES + k], cz - r[2 * _LANES + k]
        dx, dy, dz = r[way + k], r[way + _LANES + k], r[way + 2 * _LANES + k]
        t = (qx * n0 + qy * n1 + qz * n2) / (dx * n0 + dy * n1 + dz * n2)
        ax, ay, az = t * dx - qx, t * dy - qy, t * dz - qz
        a, b = abs(ax * u0 + ay * u1 + az * u2), abs(ax * v0 + ay * v1 + az * v2)
        hit = (t > _ZERO) & (t < limit) & (a < half_width) & (b < half_height)
        r[lit + k] = _ZERO if hit else r[lit + k]


@inner(fastmath=_FAST)
def _tower(r, count, i, field, tower):
    """Mark rays as dark if the tower intercepts them on their way from the sun; `tower` is (radius, top height) [m]."""
    x, y, top = np.float32(-field[i, 0]), np.float32(-field[i, 1]), np.float32(tower[1] - field[i, 2])
    radius = np.float32(tower[0])
    for k in range(lane(), count, lanes()):
        px, py, dx, dy = r[k] - x, r[_LANES + k] - y, r[3 * _LANES + k], r[4 * _LANES + k]
        a, b, h = dx * dx + dy * dy, px * dx + py * dy, px * dy - py * dx
        c = a * radius * radius - h * h
        t = (-b - math.sqrt(max(c, _ZERO))) / a
        hit = (c > _ZERO) & (t > _ZERO) & (r[2 * _LANES + k] + t * r[5 * _LANES + k] < top)
        r[_PAST + k] = _ZERO if hit else _ONE
        r[_UNSHADED + k] *= r[_PAST + k]


@inner(fastmath=_FAST)
def _meet_cylinder(r, count, cell, f, rows, columns):
    """Set row `_HITS` to 1 for rays that hit the outside of the cylinder, and write the cell index of each ray."""
    n0, n1, n2, cx, cy, cz, radius, extent = f[0], f[1], f[2], f[40], f[41], f[42], f[43], f[44]
    tall, around = np.float32(rows) / extent, np.float32(columns)
    for k in range(lane(), count, lanes()):
        sag, ox, oy = r[9 * _LANES + k], r[6 * _LANES + k], r[7 * _LANES + k]
        px, py, pz = r[k] + sag * n0 - cx, r[_LANES + k] + sag * n1 - cy, r[2 * _LANES + k] + sag * n2 - cz
        a, h = ox * ox + oy * oy, px * oy - py * ox
        c = a * radius * radius - h * h
        t = (-(px * ox + py * oy) - math.sqrt(max(c, _ZERO))) / a
        x, y, z = px + t * ox, py + t * oy, pz + t * r[8 * _LANES + k]
        r[_HITS + k] = _ONE if (c > _ZERO) & (t > _ZERO) & (abs(z) <= _HALF * extent) else _ZERO
        ax, ay = abs(x), abs(y)
        q = min(ax, ay) / (max(ax, ay) + _TINY)
        p = q * q
        way = q * (_T0 + p * (_T1 + p * (_T2 + p * (_T3 + p * (_T4 + p * _T5)))))
        way = way if ax <= ay else _QUARTER - way
        way = way if y >= _ZERO else _HALF - way
        way = way if x >= _ZERO else _ONE - way
        column, row = np.int32(way * around), np.int32(min(max((z + _HALF * extent) * tall, _ZERO), _FAR))
        cell[k] = min(row, rows - 1) * columns + min(max(column, 0), columns - 1)


@inner(fastmath=_FAST)
def _meet_rectangle(r, count, cell, f, rows, columns):
    """Set row `_HITS` to 1 for rays that hit the face of the rectangle, and write the cell index of each ray."""
    n0, n1, n2, x, y, z, half_width, half_height = f[0], f[1], f[2], f[40], f[41], f[42], f[43], f[44]
    a0, a1, a2, b0, b1, b2, c0, c1, c2 = f[45], f[46], f[47], f[48], f[49], f[50], f[51], f[52], f[53]
    wide, tall = _HALF * np.float32(columns) / half_width, _HALF * np.float32(rows) / half_height
    for k in range(lane(), count, lanes()):
        sag, ox, oy, oz = r[9 * _LANES + k], r[6 * _LANES + k], r[7 * _LANES + k], r[8 * _LANES + k]
        px, py, pz = r[k] + sag * n0 - x, r[_LANES + k] + sag * n1 - y, r[2 * _LANES + k] + sag * n2 - z
        down = ox * c0 + oy * c1 + oz * c2
        t = -(px * c0 + py * c1 + pz * c2) / down
        px, py, pz = px + t * ox, py + t * oy, pz + t * oz
        a, b = px * a0 + py * a1 + pz * a2, px * b0 + py * b1 + pz * b2
        hit = (down < _ZERO) & (t > _ZERO) & (abs(a) <= half_width) & (abs(b) <= half_height)
        r[_HITS + k] = _ONE if hit else _ZERO
        column = np.int32(min(max((a + half_width) * wide, _ZERO), _FAR))
        row = np.int32(min(max((b + half_height) * tall, _ZERO), _FAR))
        cell[k] = min(row, rows - 1) * columns + min(column, columns - 1)


@inner(fastmath=_FAST)
def _count(r, count, counts, tower):
    """Count the rays in each replicate.

    The counts are: unshaded rays; unblocked rays; rays that are unshaded and unblocked; rays that hit the receiver;
    rays that meet all three conditions; and rays that the tower does not shade.
    """
    for m in range(0, count, REPLICATES):
        for c in range(lane(), REPLICATES, lanes()):
            unshaded, unblocked, hits = r[_UNSHADED + m + c], r[_UNBLOCKED + m + c], r[_HITS + m + c]
            both = unshaded * unblocked
            counts[c] += unshaded
            counts[REPLICATES + c] += unblocked
            counts[2 * REPLICATES + c] += both
            counts[3 * REPLICATES + c] += hits
            counts[4 * REPLICATES + c] += both * hits
            if tower:
                counts[5 * REPLICATES + c] += r[_PAST + m + c]


@inner
def _rotated(f, to, x, y, z, c, s):
    """Write two axes perpendicular to a direction, rotated about the direction by an angle with cosine c and sine s."""
    level = math.sqrt(x * x + y * y)
    px, py = (-y / level, x / level) if level > 1e-9 else (1.0, 0.0)
    qx, qy, qz = -z * py, z * px, x * py - y * px
    f[to], f[to + 1], f[to + 2] = c * px + s * qx, c * py + s * qy, s * qz
    f[to + 3], f[to + 4], f[to + 5] = c * qx - s * px, c * qy - s * py, c * qz


@inner
def _constants(f, i, sx, sy, sz, turn_u, turn_v, frames, field, optics, receiver):
    """Write the constants common to all rays of a heliostat at an instant; see `_place` and `_reflect`."""
    for c in range(9):
        f[c] = frames[i, c]
    f[9], f[10], f[11] = sx, sy, sz
    _rotated(f, 12, sx, sy, sz, field[i, 17], field[i, 18])
    _rotated(
        f, 18, frames[i, 9], frames[i, 10], frames[i, 11], field[i, 14] * field[i, 19], field[i, 14] * field[i, 20]
    )
    c, s = field[i, 21], field[i, 22]
    f[24], f[25], f[26], f[27] = field[i, 12] * c, -field[i, 12] * s, field[i, 13] * s, field[i, 13] * c
    columns, rows, gap = optics[0], optics[1], optics[2]
    f[28], f[29] = (2.0 * field[i, 7] + gap) / columns - gap, (2.0 * field[i, 8] + gap) / rows - gap
    f[30], f[31], f[32], f[33] = f[28] + gap, f[29] + gap, columns, rows
    f[34], f[35], f[36], f[37], f[38] = field[i, 23], field[i, 24], field[i, 9], field[i, 10], field[i, 11]
    f[39], f[54], f[55] = field[i, 15] + turn_u, field[i, 16] + turn_v, 1.0 if field[i, 11] > 0.0 else 0.0
    for c in range(3):
        f[40 + c] = receiver[c] - field[i, c]
    for c in range(11):
        f[43 + c] = receiver[3 + c]


@kernel(fastmath=_FAST)
def trace_pairs(
    block, blocks, problem, sums, flux, whole, r, cell, counts, f, found, frames, stamp
):  # fmt: skip
    """Trace every `blocks`-th heliostat-instant pair, and add the results to `sums`, `flux` and `whole`.

    The pairs combine heliostats start..stop with instants begin..end. The threads that share a block of rays run this
    function together. Each thread traces its own rays, and all threads write identical constants for a pair.
    """
    (
        start,
        stop,
        sun,
        begin,
        end,
        weights,
        group,
        points,
        count,
        passes,
        spinning,
        field,
        spheres,
        grid,
        names,
        rank,
        blockers,
        blocker_first,
        limits,
        turn,
        optics,
        receiver,
        place,
        slope,
        number,
        facet,
        tower,
        scale,
        share,
        area,
        stride,
    ) = problem
    each, many = REPLICATES / (count * passes), stop - start
    rows, columns, light, cells = flux.shape[2], flux.shape[3], flux.reshape(-1), flux.shape[2] * flux.shape[3]
    by_group = sums.reshape(REPLICATES, -1, QUANTITIES)
    for k in range(lane(), _LANES, lanes()):
        r[_E + k] = r[_F + k] = _ZERO
    for pair in range(block, many * (end - begin), blocks):
        t, i = begin + pair // many, start + pair % many
        sx, sy, sz = sun[t, 0], sun[t, 1], sun[t, 2]
        if not sz > 0.0 or (i + t) % stride != 0:
            continue
        shaders = search(rank[i], cone(sx, sy, sz, optics[3]), 1e300, spheres, grid, found, 0)
        low, high = blocker_first[i - start], blocker_first[i - start + 1]
        _frame(i, t, sx, sy, sz, spinning, field, frames, stamp)
        for c in range(lane(), shaders, lanes()):
            _frame(names[found[c]], t, sx, sy, sz, spinning, field, frames, stamp)
        for c in range(low + lane(), high, lanes()):
            _frame(blockers[c], t, sx, sy, sz, spinning, field, frames, stamp)
        barrier()
        turn_u, turn_v = (turn[i - start, t - begin, 0], turn[i - start, t - begin, 1]) if turn.size else (0.0, 0.0)
        _constants(f, i, sx, sy, sz, turn_u, turn_v, frames, field, optics, receiver)
        for c in range(lane(), REPLICATES, lanes()):
            for m in range(c, 6 * REPLICATES, REPLICATES):
                counts[m] = 0.0
        barrier()
        cosine = frames[i, 0] * sx + frames[i, 1] * sy + frames[i, 2] * sz
        power = np.int64(math.floor(weights[1, t] * cosine * share[i] * scale[1] * each + 0.5))
        image = (i - start) % flux.shape[0] * REPLICATES * cells
        for b in range(passes):
            at = ((i * 7919 + t * 104729) * passes + b) % points.shape[0]
            _place(r, count, points, at, f)
            if slope.shape[1] > 0:
                _map_slopes(r, count, place, slope[number[i]], facet)
            _reflect(r, count, points, at, f)
            for k in range(lane(), _LANES, lanes()):
                r[_UNSHADED + k] = r[_UNBLOCKED + k] = _ONE
            for c in range(shaders):
                _cover(r, count, 3 * _LANES, _UNSHADED, 1e9, names[found[c]], i, field, frames)
            for c in range(low, high):
                _cover(r, count, 6 * _LANES, _UNBLOCKED, limits[i - start], blockers[c], i, field, frames)
            if tower[0] > 0.0:
                _tower(r, count, i, field, tower)
            if receiver[14] == CYLINDER:
                _meet_cylinder(r, count, cell, f, rows, columns)
            else:
                _meet_rectangle(r, count, cell, f, rows, columns)
            for k in range(lane(), count if cells > 0 else 0, lanes()):
                both = r[_UNSHADED + k] * r[_UNBLOCKED + k] * r[_HITS + k]
                add(light, image + k % REPLICATES * cells + cell[k], power * np.int64(both))
            barrier()
            _count(r, count, counts, tower[0] > 0.0)
            barrier()
        _add(
            by_group, (i - start) * sums.shape[2] + group[t], counts, weights[0, t] * scale[0],
            weights[1, t] * scale[0], cosine, each, 1.0 / scale[0],
        )  # fmt: skip
        if whole.shape[1] > 0:
            _add(
                whole, t - begin, counts, area[i] * scale[2], share[i] * scale[2], cosine, each, 1.0 / scale[2]
            )  # fmt: skip


@inner
def _add(sums, m, counts, w0, w1, cosine, each, unit):
    """Add the quantities of one heliostat and instant, rounded to integer multiples of `unit`."""
    v0, v1 = w0 * cosine, w1 * cosine
    for c in range(lane(), REPLICATES, lanes()):
        a, b, both = counts[c] * each, counts[REPLICATES + c] * each, counts[2 * REPLICATES + c] * each
        hit, light = counts[3 * REPLICATES + c] * each, counts[4 * REPLICATES + c] * each
        past = counts[5 * REPLICATES + c] * each
        parts = (v0, w0 * a, w0 * b, v0 * a, v0 * b, v0 * both, v0 * hit, v0 * light, v1 * both, v1 * light, v0 * past)
        for k, part in enumerate(parts):
            add(sums, (c, m, k), math.floor(part + 0.5) * unit)


def _sobol(rng: np.random.Generator, power: int) -> Floats:
    """Return 2**power points of a scrambled Sobol sequence in eight dimensions, like `scipy.stats.qmc.Sobol`.

    This function replaces SciPy's sampler, which takes 0.6 s to import.
    """
    shift = rng.integers(2, size=(_DIMENSIONS, _BITS), dtype=np.uint32).astype(np.int64)
    matrix = np.tril(rng.integers(2, size=(_DIMENSIONS, _BITS, _BITS), dtype=np.uint32)).astype(np.int64)
    matrix[:, range(_BITS), range(_BITS)] = 1
    bits, points = np.arange(_BITS), []
    for dimension, (degree, polynomial, *first) in enumerate(_DIRECTIONS):
        m = list(first)
        for k in range(degree, _BITS):
            taps = (m[k - j] << j for j in range(1, degree + 1) if j == degree or polynomial >> (degree - 1 - j) & 1)
            m.append(functools.reduce(operator.xor, taps, m[k - degree]) if degree else 1)
        digits = (np.array(m) << bits[::-1])[:, np.newaxis] >> bits[::-1] & 1
        direction = (digits @ matrix[dimension].T % 2) @ (1 << bits[::-1])
        x = np.array([shift[dimension] @ (1 << bits)])
        for k in range(power):
            x = np.concatenate((x, x[::-1] ^ direction[k]))
        points.append(x * 2.0**-_BITS)
    return np.stack(points, axis=1)


@functools.lru_cache(8)
def _points(sun: bytes, variance: float, seed: int, power: int, lanes: int) -> tuple[NDArray[np.float32], Floats]:
    """Return the points of all replicates, and the maximum deviations of sun position, slopes and specularity.

    The points, shape (blocks, 8, 64), contain positions on the mirror, positions on the sun, and standard normal
    deviates for the errors.
    """
    from scipy.special import ndtri

    radius, share = np.frombuffer(sun).reshape(2, -1)
    each, shape = lanes // REPLICATES, SunShape(radius, share, variance)
    out = np.zeros((2**power // each, _DIMENSIONS, _LANES // REPLICATES, REPLICATES), np.float32)
    for c in range(REPLICATES):
        x = np.clip(_sobol(np.random.default_rng((seed, c)).spawn(1)[0], power), 2.0**-40, 1.0 - 2.0**-40)
        r, psi = np.sin(quantile(shape, x[:, 2])), 2.0 * math.pi * x[:, 3]
        y = np.column_stack((x[:, :2], r * np.cos(psi), r * np.sin(psi), ndtri(x[:, 4:])))
        out[:, :, :each, c] = y.reshape(-1, each, _DIMENSIONS).transpose(0, 2, 1)
    farthest = np.array([np.hypot(out[:, k], out[:, k + 1]).max() for k in (2, 4, 6)], np.float64)
    return out.reshape(len(out), _DIMENSIONS, _LANES), farthest


def trace(
    scene: Scene,
    sun: Floats,
    *,
    weights: Floats | None = None,
    group: Integers | None = None,
    groups: int = 1,
    start: int = 0,
    stop: int | None = None,
    first: int = 0,
    last: int | None = None,
    rays: int = 64,
    seed: int = 0,
    cells: tuple[int, int] | None = None,
    share: Floats | None = None,
    area: Floats | None = None,
    stride: int = 1,
    threads: int = 1,
    cuda: bool = False,
    images: bool = False,
) -> Traced:
    """Trace rays of heliostats start..stop at instants first..last.

    Parameters
    ----------
    scene : Scene
        Field, receiver and optical errors. Each heliostat may shade and block any other heliostat.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun at all instants: east, north, up. Instants with the sun below the horizon are ignored.
        [1]
    weights : ndarray, shape (2, T), optional
        Weight of each instant, for example its irradiation. Row 1 includes the reflectivity, row 0 does not.
    group : ndarray of int, shape (T,), optional
        Group of each instant, 0 to groups - 1, for example the month.
    groups : int
        Number of groups.
    start, stop, first, last : int
        Ranges of heliostats and instants to trace. Rays depend only on the heliostat and instant indices, so the sums
        of several calls can be added exactly.
    rays : int
        Number of rays per heliostat and instant, rounded up to 16, 32 or a power of two times 64.
    seed : int
        Seed of the Sobol sequences.
    cells : (int, int), optional
        Number of rows and columns of a flux map.
    share : ndarray, shape (N,), optional
        Factor applied to each heliostat in the flux map, for example area times transmittance.
    area : ndarray, shape (N,), optional
        Factor applied to each heliostat in the sums over the heliostats. These sums are omitted if `area` is not given.
    stride : int
        Only heliostat-instant pairs whose indices add up to a multiple of `stride` are traced.
    threads : int
        Number of threads.
    cuda : bool
        If True, trace on a GPU, controlled by one CPU thread.
    images : bool
        If True, also return the image of each heliostat on the cells of the flux map.
    """
    count = len(scene.centre)
    stop, last, rays = count if stop is None else stop, len(sun) if last is None else last, block_rays(rays)
    sun = np.array(sun, np.float64, order="C")
    weights = np.ones((2, len(sun))) if weights is None else np.array(weights, np.float64, order="C")
    group = np.zeros(len(sun), np.int64) if group is None else np.array(group, np.int64)
    share = np.ones(count) if share is None else np.array(share, np.float64)
    instants, area = (0, np.ones(count)) if area is None else (last - first, np.array(area, np.float64))
    total, largest = max(float(weights.sum(axis=1).max()), 1e-9), max(share.sum(), area.sum(), 1e-9)
    scale = 2.0 ** np.floor(
        [51 - math.log2(total), 60 - math.log2(total * max(share.sum(), 1e-9)), 51 - math.log2(largest)]
    )
    field = _parameters(scene, seed)
    grid, names = by_cells(field[:, :4])
    spheres = np.ascontiguousarray(field[names, :4])
    rank = np.argsort(names)
    power = min(_MOST_POWER, max(13, (rays // REPLICATES - 1).bit_length()))
    with _LOCK:
        table, farthest = _points(np.stack(scene.sun[:2]).tobytes(), scene.sun.variance, seed, power, min(rays, _LANES))
    passes = max(1, rays // _LANES)
    # With a prime number of blocks, the daylight hours of a year use all blocks equally.
    primes, blocks = {1024: 1021, 512: 509, 256: 251, 128: 127}, len(table) // passes
    table = table[: passes * primes.get(blocks, blocks)]
    radius, beams = _spreads(scene, field, farthest)
    maps = scene.slopes or SlopeMap(
        np.arange(2.0), np.arange(2.0), np.zeros((1, 0, 0, 2)), np.zeros(0, np.int64), False
    )
    place = np.array([maps.x[0], maps.y[0], 1.0 / (maps.x[1] - maps.x[0]), 1.0 / (maps.y[1] - maps.y[0])])
    slope, number = np.array(filled(maps.slope), np.float32, order="C"), np.array(maps.number, np.int64)
    optics, r = np.array([*scene.facets, radius], np.float64), scene.receiver
    size = (r.half_width, 2.0 * r.half_height if r.kind == CYLINDER else r.half_height)
    receiver = np.array([*r.centre, *size, *r.across, *r.upward, *np.cross(r.across, r.upward), r.kind], np.float64)
    tower = np.array(scene.tower or (0.0, 0.0), np.float64)
    sums = np.zeros((REPLICATES, stop - start, groups, QUANTITIES))

    def run(begin: int, end: int) -> tuple[NDArray[np.int64], Floats, tuple[NDArray[Any], ...]]:
        found, limits, firsts = np.empty(count, np.int64), np.empty(end - begin), np.zeros(end - begin + 1, np.int64)
        blockers = np.empty(0, np.int64)
        for _ in range(2):
            blockers = np.empty(firsts[-1], np.int64)
            _blockers(begin, end, beams, field, spheres, grid, names, rank, found, limits, firsts, blockers)
        turn = np.empty((0, 0, 2))
        if len(scene.mounts):
            vectors = scene.centre, scene.target, scene.mounts
            turn = pointing_turns(
                *(np.array(each[begin:end], np.float64, order="C") for each in vectors),
                scene.tracking, sun[first:last], begin + first, stride,
            )  # fmt: skip
        flux = np.zeros((end - begin if images else 1, REPLICATES, *(cells or (0, 0))), np.int64)
        part = np.zeros((REPLICATES, end - begin, groups, QUANTITIES))
        whole = np.zeros((REPLICATES, instants, QUANTITIES))
        problem = (
            begin, end, sun, first, last, weights, group, table, min(rays, _LANES), passes,
            scene.tracking != AZIMUTH_ELEVATION, field, spheres, grid, names, rank, blockers, firsts, limits, turn,
            optics, receiver, place, slope, number, maps.facet, tower, scale, share, area, stride,
        )  # fmt: skip
        if cuda:
            run_on_device(
                trace_pairs, (_ROWS * _LANES, _CONSTANTS, 6 * REPLICATES), _LANES, problem, count,
                (end - begin) * (last - first), part, flux, whole,
            )  # fmt: skip
        else:
            trace_pairs(
                0, 1, problem, part, flux, whole, np.zeros(_ROWS * _LANES, np.float32), np.zeros(_LANES, np.int32),
                np.zeros(6 * REPLICATES), np.zeros(_CONSTANTS, np.float32), found, np.empty((count, 12)),
                np.full(count, -1),
            )  # fmt: skip
        sums[:, begin - start : end - start] = part
        if not images:
            return flux[0], whole, ()
        light = flux.sum(axis=1).reshape(end - begin, -1)
        lit = light.nonzero()
        amount = (light[lit] / (REPLICATES * scale[1])).astype(np.float32)
        return flux.sum(axis=0), whole, (np.bincount(lit[0], minlength=end - begin), lit[1].astype(np.int32), amount)

    # With more parts than threads, all threads finish at nearly the same time.
    threads = 1 if cuda else threads
    parts = min(threads if threads == 1 else 4 * threads, -(-(stop - start) // 16), stop - start)
    parts = max(parts, (stop - start) // 64) if images else parts  # limit the memory for the images
    edges = np.linspace(start, stop, max(parts, 1) + 1).astype(int)
    with ThreadPoolExecutor(max(threads, 1)) as pool:
        flux, whole = np.zeros((REPLICATES, *(cells or (0, 0))), np.int64), np.zeros((REPLICATES, instants, QUANTITIES))
        sparse = []
        for light, field_sums, image in (map if threads == 1 else pool.map)(run, edges[:-1], edges[1:]):
            flux += light
            whole += field_sums
            sparse.append(image)
    joined = tuple(np.concatenate(each) for each in zip(*sparse, strict=True))
    return Traced(sums, flux, float(1.0 / scale[1]), whole, joined)


def block_rays(rays: int) -> int:
    """Return the number of rays per heliostat and instant after rounding up to 16, 32, or a power of two times 64."""
    if not 1 <= rays <= REPLICATES << _MOST_POWER or rays % 1:
        raise ValueError(
            f"the number of rays must be a whole number from 1 to {REPLICATES << _MOST_POWER} (got {rays})"
        )
    return max(16, 1 << (int(rays) - 1).bit_length())


def mean_error(values: NDArray[Any]) -> tuple[Floats, Floats]:
    """Return the mean and standard error over the replicates on the first axis.

    The standard error is scaled by Student's t, so that 95 % of means deviate by at most two standard errors.
    """
    mean: Floats = values.mean(axis=0)
    # In Student's distribution with 7 degrees of freedom, 95 % of deviations are at most 2.364624.
    return mean, values.std(axis=0, ddof=1) * (2.364624 / 2.0 / math.sqrt(REPLICATES))


def intercept(optical: Floats, light: Floats) -> Floats:
    """Return the fraction of the light leaving the mirrors that hits the receiver; NaN if there is no light.

    The first axis contains the replicates. The ratio of each replicate is linearised about the ratio of the means.
    """
    sent = optical.mean(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = light.mean(axis=0) / sent
        found: Floats = ratio + (light - ratio * optical) / sent
    return found


def peak(flux: NDArray[Any]) -> tuple[float, float]:
    """Return the peak of a flux map, shape (`REPLICATES`, rows, columns), and the standard error of the peak.

    The maximum of noisy cells is biased upwards. The cell that is brightest in seven replicates gives a downward-biased
    estimate in the eighth replicate. The result is the mean of the two estimates, and the error includes half their
    difference.
    """
    cells = flux.reshape(REPLICATES, -1)
    highest = cells.sum(axis=0).argmax()
    mean, error = mean_error(cells[:, highest])
    lower = cells[np.arange(REPLICATES), (cells.sum(axis=0) - cells).argmax(axis=1)].mean()
    return float(mean + lower) / 2.0, float(np.hypot(error, (mean - lower) / 2.0))


def rays_for(
    scene: Scene,
    sun: Floats,
    weights: Floats | None = None,
    *,
    precision: float = 1e-4,
    cells: tuple[int, int] | None = None,
    share: Floats | None = None,
    seed: int = 0,
) -> int:
    """Return the number of rays per heliostat and instant needed to reach a precision, at most `MOST`.

    Standard errors are estimated in a pilot run of at most `_PILOT` heliostat-instant pairs, each with 64 rays.
    Relative standard errors must be at most 0.75 times `precision` for the light from the whole field, and 6 times
    `precision` for the light from a heliostat (root mean square). For cells with at least half the peak flux, the
    standard error must be at most 40 times `precision`, relative to the peak flux. The maximum error is then about 20
    times `precision` for 300 heliostats, and about 150 times `precision` for 700 cells.
    """
    lit = np.asarray(sun)[:, 2] > 0.0
    # The stride is odd, because an even stride would use only half of the points.
    stride = -(-len(scene.centre) * int(lit.sum()) // _PILOT) | 1
    found = trace(scene, sun, weights=weights, rays=_LANES, seed=seed, cells=cells, share=share, stride=stride)
    light, precision = found.sums[:, :, 0, LIGHT], precision * math.sqrt(stride)
    field, error = mean_error(light @ scene.sides.prod(axis=1))
    each, total = math.sqrt(np.mean(mean_error(light)[1] ** 2)), (lit if weights is None else lit * weights[0]).sum()
    wrong = max(float(error) / max(float(field), 1e-300) / 0.75, each * stride / max(total, 1e-300) / 6.0) / precision
    # Errors of energies are proportional to rays**-0.7, and errors of cells to rays**-0.45.
    rays = min(_LANES * wrong ** (1 / 0.7), MOST)
    if cells is not None:
        mean, errors = mean_error(found.flux.astype(np.float64))
        bright = errors[mean >= 0.5 * mean.max()] / (max(mean.max(), 1.0) * 40.0 * precision)
        rays = max(rays, min(_LANES * math.sqrt(np.mean(bright**2)) ** (1 / 0.45), MOST))
    return block_rays(max(1, int(rays)))


def filled(slope: Floats) -> Floats:
    """Replace missing values (NaN) in slope maps by the nearest valid values."""
    holes = np.asarray(np.isnan(slope).any(axis=-1))
    if not holes.any():
        return slope
    from scipy.ndimage import distance_transform_edt

    nearest = (distance_transform_edt(hole, return_distances=False, return_indices=True) for hole in holes)
    return np.stack([each[tuple(at)] for each, at in zip(slope, nearest, strict=True)])


def _parameters(scene: Scene, seed: int) -> Floats:
    """Return mirror parameters, shape (N, 25). The first four columns are those of `packets.Mirrors.spheres`."""
    count, half = len(scene.centre), 0.5 * scene.sides
    radius = np.hypot(*half.T)
    curve = np.broadcast_to(scene.curve.reshape(count, -1), (count, 2))
    errors = np.stack([np.broadcast_to(error, count) for error in scene.errors], axis=1)
    # Each mirror rotates the samples of the sun, specularity and slopes and shifts the points.
    # Therefore, no two mirrors use the same rays.
    # Steps of the additive recurrence: powers of 1 / 1.2207.
    steps = (0.8191725133961645, 0.6710436067037893, 0.5497004779019703, 0.4503003465537895, 0.3688742614037486)
    shift = (np.arange(1, count + 1)[:, np.newaxis] * steps + 0.5698402909980532 * seed) % 1.0
    angle = 2.0 * math.pi * shift[:, :3]
    spin = np.stack((np.cos(angle), np.sin(angle)), axis=2).reshape(count, 6)
    return np.column_stack(
        (scene.centre, radius, scene.target, half, curve, scene.cant, errors, scene.turn, spin, shift[:, 3:])
    )


def _spreads(scene: Scene, field: Floats, farthest: Floats) -> tuple[float, Floats]:
    """Return the maximum angles of sun rays to the sun's centre, and of reflected rays to the beam axis. [rad]"""
    sun, slope, rest = farthest
    radius = 1.001 * math.tan(math.asin(sun)) + 1e-6
    lean = slope * field[:, 12:14].max(axis=1) + np.hypot(*scene.turn.T)
    if scene.slopes is not None:
        lean = lean + np.nanmax(np.hypot(*scene.slopes.slope.reshape(-1, 2).T))
    if len(scene.mounts):
        lean = lean + 2.0 * np.abs(scene.mounts).sum(axis=1)
    far = np.linalg.norm(scene.target - scene.centre, axis=1)
    rate = np.maximum(0.0, 2.0 * field[:, 9:12].max(axis=1) - 1.0 / far)
    beams: Floats = 1.1 * (radius + 2.0 * lean + rest * field[:, 14] + field[:, 3] * rate) + 1e-3
    return radius, beams


def warm_rays() -> None:
    """Compile the ray tracer of a field with optics, or load it from the cache."""
    place, aim, none = np.array([[0.0, 100.0, 5.0]]), np.array([[0.0, 0.0, 60.0]]), np.zeros(1)
    errors, receiver = Errors(1e-3, 1e-3, 0.0), rectangle((0.0, 0.0, 60.0), 0.0, 0.0, 5.0, 5.0)
    facets, turn = Facets(1, 1, 0.0), np.zeros((1, 2))
    scene = Scene(place, aim, np.ones((1, 2)), none, none, turn, facets, 0, errors, pillbox(), receiver)
    trace(scene, np.array([[0.0, -0.6, 0.8]]))
