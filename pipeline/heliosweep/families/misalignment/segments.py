"""Arrays of detectors as straight segments of the receiver's plane, and places along them."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.families.misalignment.blocks import Detectors
from heliosweep.kernels.arrays import Floats

#: Maximum distance of places along an array at which crossings of two segments, at their corner, are one. [m]
CORNER = 1e-9


class Segments(NamedTuple):
    """The S line segments of all arrays, array after array.

    Places along an array are counted from its first point, along a line without ends from the foot of the
    perpendicular of the aim point. [m]

    Attributes
    ----------
    array : ndarray of int64, shape (S,)
        Number of the array of each segment, lines first.
    start : ndarray, shape (S, 2)
        First point y, z; of a line the foot. [m]
    along : ndarray, shape (S, 2)
        Direction. [1]
    first, last : ndarray, shape (S,)
        Places of both ends along the array; infinite for lines. [m]
    """

    array: NDArray[np.int64]
    start: Floats
    along: Floats
    first: Floats
    last: Floats

    @property
    def arrays(self) -> int:
        """Number of arrays."""
        return int(self.array[-1]) + 1

    @property
    def most(self) -> int:
        """Maximum number of crossings of a trace and an array: two of each segment."""
        return 2 * int(np.bincount(self.array).max())

    @property
    def origin(self) -> Floats:
        """Place along the array of the point of each segment, shape (S,). [m]"""
        return np.where(np.isfinite(self.first), self.first, 0.0)

    @property
    def ends(self) -> Floats:
        """First and last place of each segment from its own point, shape (S, 2). [m]"""
        return np.stack([self.first - self.origin, self.last - self.origin], axis=1)

    def by_array(self, places: Floats, angles: Floats) -> tuple[Floats, Floats]:
        """Places and angles on the segments (..., S, 2) as places along the arrays, rising, shape (..., A, C)."""
        found = np.full((2, *places.shape[:-2], self.arrays, self.most), np.nan)
        for number in range(self.arrays):
            own = np.flatnonzero(self.array == number)
            values, turns = (
                each[..., own, :].reshape(*places.shape[:-2], -1)
                for each in (places + self.origin[:, np.newaxis], angles)
            )
            for again in (False, True):
                order = np.argsort(values, axis=-1)
                values, turns = (np.take_along_axis(each, order, -1) for each in (values, turns))
                if not again:
                    values[..., 1:][np.diff(values, axis=-1) < CORNER] = np.nan
            found[0, ..., number, : values.shape[-1]] = values
            found[1, ..., number, : values.shape[-1]] = np.where(np.isnan(values), np.nan, turns)
        return found[0], found[1]

    def readings(self, places: Floats, noise: Floats | float, pitch: float) -> Floats:
        """Readings of arrays at places along them, shape (..., A, C): with noise, of the nearest detector. [m]"""
        read = places + noise
        longest, least = (
            np.array([kind(side[self.array == number]) for number in range(self.arrays)])
            for kind, side in ((np.max, self.last), (np.min, self.first))
        )
        if pitch > 0:
            read = np.round(read / pitch) * pitch
            longest = np.where(np.isfinite(longest), np.floor(longest / pitch * (1 + 1e-12)) * pitch, longest)
        return np.clip(read, least[:, np.newaxis], longest[:, np.newaxis])

    def points(self, places: Floats) -> tuple[Floats, Floats]:
        """Points y, z of places along the arrays, shape (..., A, C, 2), and directions of the arrays there."""
        which = np.zeros(places.shape, np.int64)
        for number in range(self.arrays):
            own = np.flatnonzero(self.array == number)
            after = np.searchsorted(self.first[own], places[..., number, :], side="right")
            which[..., number, :] = own[np.clip(after - 1, 0, own.size - 1)]
        along = self.along[which]
        return self.start[which] + (places - self.origin[which])[..., np.newaxis] * along, along

    def nearest(self, points: Floats) -> tuple[Floats, NDArray[np.int64]]:
        """Distances of points, shape (M, 2), from the nearest segment, and the number of that segment. [m]"""
        way = points[:, np.newaxis] - self.start
        place = np.clip(np.sum(way * self.along, axis=-1), *self.ends.T)
        distance = np.linalg.norm(way - place[..., np.newaxis] * self.along, axis=-1)
        which = np.argmin(distance, axis=1)
        return np.take_along_axis(distance, which[:, np.newaxis], axis=1)[:, 0], which


def segments_of(block: Detectors) -> Segments:
    """Segments of the lines and the arrays of a study."""
    rows: list[tuple[int, Floats, Floats, float, float]] = []
    for l0, l1, l2 in block.lines or ():
        across = np.array([l0, l1]) / np.hypot(l0, l1)
        along = np.array([-across[1], across[0]])
        along = along if (along[0], along[1]) > (0.0, 0.0) else -along
        rows.append((len(rows), across * l2 / np.hypot(l0, l1), along, -np.inf, np.inf))
    for number, array in enumerate(block.arrays or (), len(rows)):
        place, points = 0.0, np.array(array.points, np.float64)
        for start, stop in pairwise(points):
            length = float(np.hypot(*(stop - start)))
            rows.append((number, start, (stop - start) / length, place, place + length))
            place += length
    numbers, *columns = zip(*rows, strict=True)
    return Segments(np.array(numbers, np.int64), *(np.array(column, np.float64) for column in columns))
