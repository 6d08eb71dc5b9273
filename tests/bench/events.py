"""How often the stages of the field kernel run for a heliostat and an instant: recounted by its own stages."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.field import sweep as stages
from heliosweep.kernels.field import unions
from heliosweep.kernels.field.cover import COVER_ROWS
from heliosweep.kernels.field.efficiency import _sorted, sorted_field
from heliosweep.kernels.field.frames import Halo
from heliosweep.kernels.field.images import AXES_ROWS, IMAGE_ROWS, Images, _project_along_v, axes, images_of
from heliosweep.kernels.field.neighbours import beam, no_candidates, search_all
from heliosweep.kernels.field.packets import FRAME_ROWS, half_sides
from heliosweep.kernels.vectors import GROUP, LANES, PACKET, ROW, rows
from tests.kernels.field.fields import Field

Floats = NDArray[np.float64]

EVENTS = ("candidates", "level", "images", "tests of pairs", "pairs", "covers", "outlines")
#: Every few packets and heliostats are counted.
PACKETS, HELIOSTATS = 2, 3


def events(field: Field, tracking: int, sun: Floats) -> dict[str, float]:
    """Mean numbers for each heliostat-instant, by the names of `EVENTS`.

    Candidates for shade and block, those of them neither above nor below the test mirror; images whose area is computed
    and tests of two images, of all lanes of a group if one of them has both. Areas that two images share:
    of the lanes where no three overlap; of others, pairs of images that may cover one another's edges, and images.
    """
    mirrors, grid = all_mirrors = sorted_field(*field)
    count = len(grid.names)
    sun, order, first = _sorted(all_mirrors, sun, tracking, 0, count)
    blockers, shaders = stages.blockers_of(np.arange(count), mirrors, grid), no_candidates(count)
    lines = stages.Lines(rows(3), rows(3), rows(AXES_ROWS), rows(COVER_ROWS), rows(3), rows(4))
    images, room, frames = images_of(count), unions.room_for(count), rows(count * FRAME_ROWS)
    everyone = Halo(frames, FRAME_ROWS * ROW * np.arange(count), np.full(count, -1), np.arange(count))
    spare = (count - 1) * IMAGE_ROWS * ROW
    found: Counter[str] = Counter()
    for p in range(0, len(first) - 1, PACKETS):
        lanes, instants = stages._directions(sun, order[first[p] : first[p + 1]], lines.to_sun), first[p + 1] - first[p]
        shaders = search_all(np.arange(count), beam(lines.to_sun, ROW, instants), mirrors, grid, shaders)
        for i in range(count):
            half_sides(frames, i * FRAME_ROWS * ROW, lines.to_sun, 0, mirrors, i, tracking, lanes)
        for i in range(p % HELIOSTATS, count, HELIOSTATS):
            made = candidates = 0
            real = -1 if instants == PACKET else (1 << int(instants)) - 1  # the lanes that are not copies of the last
            for some, directions in ((shaders, lines.to_sun), (blockers, lines.to_target)):
                for c in range(3):
                    lines.to_target[c * ROW : (c + 1) * ROW] = mirrors.aim[i, c]
                axes(lines.views, frames, i * FRAME_ROWS * ROW, directions, lanes)
                scene = mirrors, tracking, everyone, count, lines, directions
                named = some.names[some.first[i] : some.first[i + 1]]
                for j in named:
                    to = mirrors.x[j] - mirrors.x[i], mirrors.y[j] - mirrors.y[i], mirrors.z[j] - mirrors.z[i]
                    place = everyone.place[j]
                    level = _project_along_v(images.rows, spare, lines.views, 0, frames, place, *to, lanes)
                    found["level"] += _count(int(level) & real)
                candidates += len(named)
                made = int(stages._make_images(i, i, some, *scene, images, made, lanes)[0])
            found["heliostat-instants"] += int(instants)
            found["candidates"] += candidates * int(instants)
            found["images"] += made * int(instants)
            _overlaps(images, made, room, real, lanes, found)
    return {name: found[name] / found["heliostat-instants"] for name in EVENTS}


def _overlaps(
    images: Images,
    count: int,
    room: unions.Room,
    real: int,
    lanes: int,
    found: Counter[str],
) -> None:
    """Count what is done with images that overlap as `unions.unions` goes through them."""
    several = int(unions._several(images.present, count))
    some = several & ~int(unions._straddling(images, count, several, lanes))
    present = [int(each) & some & real for each in images.present[:count]]
    found["tests of pairs"] += sum(_groups(present[n] & present[m], lanes) for m in range(count) for n in range(m))
    meeting = int(unions._meetings(images, some, count, room, lanes)) & real
    many = int(unions._more_than_two(room.several, count)) & meeting
    listed = [int(each) & many for each in room.meeting[:count]]
    for m in range(count):
        for n in range(m):
            both = int(room.meeting[n] & room.meeting[m]) & meeting & ~many
            found["pairs"] += _count(int(unions._overlapping(images.rows, n, m, both, lanes))) if both else 0
    found["covers"] += sum(_count(listed[n] & listed[m]) for m in range(count) for n in range(m))
    found["outlines"] += sum(_count(each) for each in listed)


def _count(lanes: int) -> int:
    """Lanes of a set, an integer of 64 bits with a sign."""
    return (lanes & 0xFFFF_FFFF_FFFF_FFFF).bit_count()


def _groups(lanes: int, count: int) -> int:
    """Lanes of the groups that have some of a set."""
    return sum(GROUP for start in range(0, count, GROUP) if lanes >> start & LANES)
