"""Vectors: of one ray as tuples of three numbers, of which the compiler makes scalars; of a packet as rows of lanes."""

import math

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel

Vector = tuple[float, float, float]

PACKET = 64
"""Most instants (lanes) in a packet."""

GROUP = 8
"""Packets are filled up to a multiple of so many lanes, the vector of the widest processors: no loop leaves a rest."""

LANES = (1 << GROUP) - 1
"""The lanes of the first group, a bit for each."""

ROW = PACKET + GROUP
"""Numbers from the start of a row of lanes to that of the next. With as many as a packet has lanes, a power of two, the
rows of short packets, as a low sun makes them, would crowd into an eighth of the places of the processor's cache."""


@inline
def whole(count: int, unit: int = GROUP) -> int:
    """Smallest multiple of a unit that is not below a count."""
    return -(-count // unit) * unit


@kernel
def rows(count: int) -> NDArray[np.float64]:
    """Room for rows of lanes, one after the other."""
    return aligned(count * ROW)


@kernel
def aligned(count: int) -> NDArray[np.float64]:
    """Room for so many numbers, from the start of a cache line: a load across two costs double."""
    room = np.empty(count + 8)
    skip = -(room.ctypes.data >> 3) & 7
    return room[skip : skip + count]


@inline
def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline
def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inline
def scaled(f: float, a: Vector) -> Vector:
    """Product f a."""
    return f * a[0], f * a[1], f * a[2]


@inline
def minus(a: Vector, b: Vector) -> Vector:
    """Difference a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inline
def mixed(f: float, a: Vector, g: float, b: Vector) -> Vector:
    """Linear combination f a + g b."""
    return f * a[0] + g * b[0], f * a[1] + g * b[1], f * a[2] + g * b[2]


@inline
def unit(a: Vector) -> Vector:
    """Direction of a vector, NaN for the vector nothing."""
    length = math.sqrt(dot(a, a))
    return a[0] / length, a[1] / length, a[2] / length


@inline
def turned(v: Vector, axis: Vector, cosine: float, sine: float) -> Vector:
    """Rotate a vector about a unit axis, right-handed, by Rodrigues' formula."""
    along, across = dot(axis, v) * (1.0 - cosine), cross(axis, v)
    return (
        v[0] * cosine + across[0] * sine + axis[0] * along,
        v[1] * cosine + across[1] * sine + axis[1] * along,
        v[2] * cosine + across[2] * sine + axis[2] * along,
    )


@inline
def turning(axis: Vector, v: Vector) -> tuple[Vector, Vector, Vector]:
    """Parts v0, v1, v2 of a vector that turns about a unit axis: Rot(axis, e) v = v0 + v1 cos e + v2 sin e."""
    along = dot(axis, v)
    still = (along * axis[0], along * axis[1], along * axis[2])
    return still, mixed(1.0, v, -1.0, still), cross(axis, v)


@inline
def at_angle(parts: tuple[Vector, Vector, Vector], cosine: float, sine: float) -> Vector:
    """Turning vector v0 + v1 cos e + v2 sin e."""
    a, b, c = parts
    return (
        a[0] + b[0] * cosine + c[0] * sine,
        a[1] + b[1] * cosine + c[1] * sine,
        a[2] + b[2] * cosine + c[2] * sine,
    )
