"""How often the stages of the field kernel run for a heliostat and an instant: recounted by its own stages."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels import field as stages
from heliosweep.kernels import unions
from heliosweep.kernels.images import AXES_ROWS, IMAGE_ROWS, axes, image
from heliosweep.kernels.mounts import FRAME_ROWS, Mirrors, half_sides
from heliosweep.kernels.neighbours import beam, bin_field, search
from heliosweep.kernels.packets import PACKET, rows
from tests.kernels.fields import Field

Floats = NDArray[np.float64]

EVENTS = ("candidates", "images", "tests of pairs", "pairs", "triples")
#: Every few packets and heliostats are counted.
PACKETS, HELIOSTATS = 2, 3


def events(field: Field, tracking: int, sun: Floats) -> dict[str, float]:
    """Mean numbers for each heliostat-instant, by the names of `EVENTS`.

    Candidates for shade and block, images whose area is computed, tests of two images: of all lanes of a packet, if one
    of them has the image, or two. Areas that two images share, and three: of the lanes where they overlap.
    """
    mirrors = stages.aimed(*field)
    sun, order, first = stages._sorted(sun)
    grid, count = bin_field(mirrors), len(mirrors.x)
    blockers, first_blocker = stages._blockers(mirrors, grid, 0, count)
    found: Counter[str] = Counter()
    for p in range(0, len(first) - 1, PACKETS):
        to_sun, to_target = rows(3), rows(3)
        lanes, instants = stages._directions(sun, order[first[p] : first[p + 1]], to_sun), first[p + 1] - first[p]
        bundle = beam(to_sun, PACKET, instants)
        for i in range(p % HELIOSTATS, count, HELIOSTATS):
            shaders, some = search(i, bundle, np.inf, mirrors, grid, np.empty(16, np.int64), 0)
            others = [*shaders[:some], *blockers[first_blocker[i] : first_blocker[i + 1]]]
            for c in range(3):
                to_target[c * PACKET : (c + 1) * PACKET] = mirrors.aim[i, c]
            images, apart, present = _images(i, others, some, mirrors, tracking, to_sun, to_target, lanes)
            real = -1 if instants == PACKET else (1 << int(instants)) - 1  # the lanes that are not copies of the last
            found["heliostat-instants"] += int(instants)
            found["candidates"] += len(others) * int(instants)
            found["images"] += len(present) * int(instants)
            _overlaps(images, apart, present, real, lanes, found)
    return {name: found[name] / found["heliostat-instants"] for name in EVENTS}


def _images(
    i: int,
    others: list[int],
    shading: int,
    mirrors: Mirrors,
    tracking: int,
    to_sun: Floats,
    to_target: Floats,
    lanes: int,
) -> tuple[Floats, NDArray[np.bool_], list[int]]:
    """Images of other mirrors on mirror i, whether each was made of disjoint spheres, and the lanes that have it."""
    frames, views = rows(2 * FRAME_ROWS), rows(AXES_ROWS)
    images, apart = rows((len(others) + 1) * IMAGE_ROWS), np.empty(len(others) + 1, np.bool_)
    present: list[int] = []
    half_sides(frames, 0, to_sun, mirrors, i, tracking, lanes)
    for number, j in enumerate(others):
        directions = to_sun if number < shading else to_target
        axes(views, frames, 0, directions, lanes)
        half_sides(frames, FRAME_ROWS * PACKET, to_sun, mirrors, j, tracking, lanes)
        d = mirrors.x[j] - mirrors.x[i], mirrors.y[j] - mirrors.y[i], mirrors.z[j] - mirrors.z[i]
        made = len(present)
        apart[made] = bool(np.dot(d, d) > (mirrors.radius[i] + mirrors.radius[j]) ** 2 * (1.0 + 1e-12))
        place = made * IMAGE_ROWS * PACKET
        here = int(image(images, place, views, frames, FRAME_ROWS * PACKET, 0, directions, *d, apart[made], lanes))
        present += [here] if here else []
    return images, apart, present


def _overlaps(
    images: Floats, apart: NDArray[np.bool_], present: list[int], real: int, lanes: int, found: Counter[str]
) -> None:
    """Count tests of pairs, pairs and triples as `unions.unions` goes through them."""
    once, several = 0, 0
    for name in present:
        once, several = once | name, several | once & name
    names = np.array(present, np.int64)
    general = int(unions._crowded(names, len(names)))
    general |= int(unions._straddling(images, apart, names, len(names), several, lanes))
    meeting: dict[tuple[int, int], int] = {}
    lane_names, room = np.empty(PACKET, np.int64), rows(unions.ROOM_ROWS)
    for m in range(len(present)):
        for n in range(m):
            both = present[n] & present[m] & several & ~general & real
            found["tests of pairs"] += _count(real) if both else 0
            both = both and both & int(unions._overlapping(images, n, m, lanes))
            found["pairs"] += _count(both)
            meeting[n, m] = both and int(unions._shared(images, -1, n, m, both, lane_names, room, lanes))
            for o in range(n):
                three = meeting[n, m] & meeting[o, n] & meeting[o, m] & ~general
                for q in range(o):  # a fourth that they all meet: such lanes leave for the general way
                    general |= three & meeting[q, n] & meeting[q, m] & meeting[q, o]
                found["triples"] += _count(three & ~general)


def _count(lanes: int) -> int:
    """Lanes of a set, an integer of 64 bits with a sign."""
    return (lanes & 0xFFFF_FFFF_FFFF_FFFF).bit_count()
