"""Packets of instants with nearly the same sun direction, 64 at most, and the frames of mirrors in them.

A packet culls mirrors and chooses branches for all of its lanes at once, so the sort pays if its lanes are alike.

A mirror at C with the target at unit vector r has the normal n = unit(r + s) and the frame (u, v, n), v = n x u, with
its width along u and its height along v. Vectors are kept for all lanes (instants) of a packet: see `vectors.load`.
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inner
from heliosweep.kernels.mounts.kinematics import AZIMUTH_ELEVATION as AZIMUTH_ELEVATION
from heliosweep.kernels.mounts.kinematics import TARGET_ALIGNED
from heliosweep.kernels.vectors import GROUP, PACKET, ROW, cross, dot, load, mixed, put, scaled, store

#: Largest product of the lanes and the width of a packet, over the sine of its lowest elevation. By measurement, and
#: flat: with half or twice of it low suns cost some hundredths more. Smaller packets repeat the search too often, wider
#: ones have too many candidates. Thousands of instants fill theirs within it, except for the lowest suns.
_LIMIT = 480.0


def packet_order(sun: Floats) -> tuple[Integers, Integers]:
    """Return the permutation that puts similar sun directions next to each other, and the packets that it is cut into.

    A k-d tree: cut at the median of the component with the largest range until a packet is left. A packet has at most
    64 lanes, and fewer if they would spread over much of the sky: every lane pays for the candidates of all, whose
    number grows with the spread over the sine of the elevation. Equal values keep their order.

    Parameters
    ----------
    sun : ndarray, shape (T, 3)
        Unit vectors with the sun up. [1]

    Returns
    -------
    order : ndarray, shape (T,)
        Indices in packet order, within a packet cut further into groups of 8 similar ones in rising index.
    first : ndarray, shape (P + 1,)
        Packet p, never empty, is ``order[first[p] : first[p + 1]]``.
    """
    order, ends = [np.empty(0, np.int64)], [0]
    waiting = [(np.arange(len(sun)), False)] if len(sun) else []
    while waiting:
        some, within = waiting.pop()
        here, count = sun[some], len(some)
        spread = np.ptp(here, axis=0)
        if not within and (count == 1 or (count <= PACKET and count * spread.max() <= _LIMIT * here[:, 2].min())):
            ends.append(ends[-1] + count)
            within = True
        if within and count <= GROUP:
            order.append(np.sort(some))
            continue
        rising = some[np.argsort(here[:, spread.argmax()], kind="stable")]
        unit = GROUP if within else PACKET if count > PACKET else 1  # full packets while there are several
        middle = (-(-count // unit) + 1) // 2 * unit
        waiting += [(rising[middle:], within), (rising[:middle], within)]
    return np.concatenate(order), np.array(ends)


#: Target-aligned mount: first axis along r, the width axis u = unit(r x s) normal to the plane of incidence.
SPINNING_ELEVATION = TARGET_ALIGNED
#: Numbers of a frame: rows of the half sides (w/2) u and (h/2) v, and of the cosine of incidence.
FRAME = 7 * ROW
#: Start of the row of the cosine of the angle of incidence, n.s = n.r = |r + s| / 2.
COSINE = 6 * ROW

#: Squared sine below which two directions are parallel: the cross product is rounding noise.
_PARALLEL = 1e-30


class Mirrors(NamedTuple):
    """The heliostats of a field."""

    #: East, north, up, shape (N, 3). [m]
    centre: Floats
    #: Half sides along u and along v, shape (N, 2). [m]
    half: Floats
    #: Radius of the bounding sphere, shape (N,). [m]
    radius: Floats
    #: Unit vectors r from the centres to the target, shape (N, 3). [1]
    aim: Floats
    #: Distances to the target, shape (N,). [m]
    throw: Floats


@inner
def write_frame(frames: Floats, f: int, sun: Floats, mirrors: Mirrors, i: int, tracking: int, lanes: int) -> None:
    """Write the frame of mirror i, rows from `f` on, for the lanes of a packet. [m]

    Degenerate cases: s parallel to r (spinning-elevation) takes u = unit(-r_y, r_x, 0); a vertical normal
    (azimuth-elevation), or r vertical as well, takes u = east. A sun exactly opposite to r has no normal: sides and
    cosine are 0.

    `sun` are rows x, y, z of the unit vectors to the sun [1]; `tracking` is `SPINNING_ELEVATION` or
    `AZIMUTH_ELEVATION`.
    """
    r = mirrors.aim[i, 0], mirrors.aim[i, 1], mirrors.aim[i, 2]
    half_width, half_height = mirrors.half[i, 0], mirrors.half[i, 1]
    # A fallback for every lane whose u is undefined, so that the loop needs no branch.
    level = np.sqrt(r[0] * r[0] + r[1] * r[1])
    east, north = 1.0, 0.0
    if tracking == SPINNING_ELEVATION and level * level > _PARALLEL:
        east, north = -r[1] / level, r[0] / level
    for k in range(lanes):
        s = load(sun, 0, k)
        n = mixed(1.0, r, 1.0, s)
        u = cross(r, s) if tracking == SPINNING_ELEVATION else (-n[1], n[0], 0.0)
        across = dot(u, u)
        undefined = across < _PARALLEL
        u = east if undefined else u[0], north if undefined else u[1], 0.0 if undefined else u[2]
        length, width = np.sqrt(dot(n, n)), np.sqrt(1.0 if undefined else across)
        inverse = 1.0 / (length * width) if length > 0.0 else 0.0
        put(frames, f + COSINE, k, min(1.0, 0.5 * length))
        store(frames, f, k, scaled(half_width * (inverse * length), u))
        store(frames, f + 3 * ROW, k, scaled(half_height * inverse, cross(n, u)))
