"""Vectors of one ray (tuples of three numbers, compiled to scalars) and of a packet of rays (rows of lanes)."""

import math

import numpy as np

from heliosweep.kernels.compiled import Floats, inline, inner

Vector = tuple[float, float, float]

#: Maximum number of instants (lanes) in a packet.
PACKET = 64

#: Packets are padded to a multiple of this number of lanes, which is the vector length of the widest processors.
GROUP = 8

#: Distance between the starts of successive rows, in floats. The distance is larger than `PACKET`.
#: At a distance of `PACKET`, a power of two, the rows of short packets would share one eighth of the cache sets.
ROW = PACKET + GROUP


def rows(count: int) -> Floats:
    """Allocate `count` rows of lanes, aligned to a cache line, because a load across two lines takes twice as long."""
    numbers = np.empty(count * ROW + 8)
    skip = -(numbers.ctypes.data >> 3) & 7
    return numbers[skip : skip + count * ROW]


@inline
def larger(a: float, b: float) -> float:
    """Return the larger of two numbers, in a form that compiles to one vector instruction."""
    return a if a > b else b


@inline
def smaller(a: float, b: float) -> float:
    """Return the smaller of two numbers, in a form that compiles to one vector instruction."""
    return a if a < b else b


@inline
def get(numbers, at, k):
    """Return the number in lane k of the row that starts at index `at`.

    Indices are unsigned, because numba would test signed indices for negative values.
    """
    return numbers[np.uint64(at + k)]


@inline
def put(numbers, at, k, value):
    """Write the number in lane k of the row that starts at index `at`."""
    numbers[np.uint64(at + k)] = value


@inline
def load2(numbers, at, k):
    """Return the numbers in lane k of two successive rows."""
    i = np.uint64(at + k)
    return numbers[i], numbers[i + np.uint64(ROW)]


@inline
def load(numbers, at, k):
    """Return the vector in lane k of three successive rows."""
    i = np.uint64(at + k)
    return numbers[i], numbers[i + np.uint64(ROW)], numbers[i + np.uint64(2 * ROW)]


@inline
def store(numbers, at, k, v):
    """Write a vector to lane k of three successive rows."""
    i = np.uint64(at + k)
    numbers[i], numbers[i + np.uint64(ROW)], numbers[i + np.uint64(2 * ROW)] = v[0], v[1], v[2]


@inner
def next_run(start, some, lanes):
    """Return the start and end of the next run of lane groups with marked lanes; both are equal if there is no run."""
    while start < lanes and some >> start & (1 << GROUP) - 1 == 0:
        start += GROUP
    stop = start
    while stop < lanes and some >> stop & (1 << GROUP) - 1 != 0:
        stop += GROUP
    return start, stop


@inline
def three(row) -> Vector:
    """Return three numbers of an array as scalars, because loops that load them at each step are not vectorised."""
    return row[0], row[1], row[2]


@inline
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inline
def scaled(f: float, a: Vector) -> Vector:
    """Return the product f a."""
    return f * a[0], f * a[1], f * a[2]


@inline
def minus(a: Vector, b: Vector) -> Vector:
    """Return the difference a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inline
def mixed(f: float, a: Vector, g: float, b: Vector) -> Vector:
    """Return the linear combination f a + g b."""
    return f * a[0] + g * b[0], f * a[1] + g * b[1], f * a[2] + g * b[2]


@inline
def unit(a: Vector) -> Vector:
    """Return the unit vector in the direction of a vector, NaN for a zero vector."""
    length = math.sqrt(dot(a, a))
    return a[0] / length, a[1] / length, a[2] / length


@inline
def turning(axis: Vector, v: Vector) -> tuple[Vector, Vector, Vector]:
    """Return v0, v1, v2 of a vector that rotates about a unit axis: Rot(axis, e) v = v0 + v1 cos e + v2 sin e."""
    along = dot(axis, v)
    still = (along * axis[0], along * axis[1], along * axis[2])
    return still, mixed(1.0, v, -1.0, still), cross(axis, v)


@inline
def at_angle(parts: tuple[Vector, Vector, Vector], cosine: float, sine: float) -> Vector:
    """Return the rotated vector v0 + v1 cos e + v2 sin e."""
    a, b, c = parts
    return (
        a[0] + b[0] * cosine + c[0] * sine,
        a[1] + b[1] * cosine + c[1] * sine,
        a[2] + b[2] * cosine + c[2] * sine,
    )
