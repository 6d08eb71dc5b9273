"""Arrays of detectors as straight pieces of the receiver's plane, and places along them."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.families.misalignment.blocks import Detectors
from heliosweep.kernels.arrays import Floats

#: Crossings of two pieces at their corner are one: places along an array that are no farther apart. [m]
CORNER = 1e-9


class Pieces(NamedTuple):
    """The S straight pieces of all arrays, those of each array one after the other.

    Places along an array are counted from its first point, along a line without ends from the foot of the
    perpendicular of the aim point. [m]
    """

    array: NDArray[np.int64]
    """Number of the array that each belongs to, lines first, shape (S,)."""
    start: Floats
    """First point y, z, shape (S, 2); of a line the foot. [m]"""
    along: Floats
    """Direction, shape (S, 2). [1]"""
    first: Floats
    last: Floats
    """Places of both ends along the array, shape (S,); infinite ones of lines. [m]"""

    @property
    def arrays(self) -> int:
        """Number of arrays."""
        return int(self.array[-1]) + 1

    @property
    def most(self) -> int:
        """Most crossings of a trace and an array: two of each piece."""
        return 2 * int(np.bincount(self.array).max())

    @property
    def ends(self) -> Floats:
        """First and last place of each piece from its own point, shape (S, 2). [m]"""
        origin = np.where(np.isfinite(self.first), self.first, 0.0)
        return np.stack([self.first - origin, self.last - origin], axis=1)

    def by_array(self, places: Floats) -> tuple[Floats, NDArray[np.int64]]:
        """Places on the pieces, shape (..., S, 2), as places along the arrays, shape (..., A, `most`), rising.

        Also from where in the last two axes, joined, each comes.
        """
        found = np.full((*places.shape[:-2], self.arrays, self.most), np.nan)
        source = np.zeros(found.shape, np.int64)
        origin = np.where(np.isfinite(self.first), self.first, 0.0)[:, np.newaxis]
        for number in range(self.arrays):
            own = np.flatnonzero(self.array == number)
            values = (places + origin)[..., own, :].reshape(*places.shape[:-2], -1)
            order = np.argsort(values, axis=-1)
            values = np.take_along_axis(values, order, -1)
            values[..., 1:][np.diff(values, axis=-1) < CORNER] = np.nan
            again, width = np.argsort(values, axis=-1), values.shape[-1]
            found[..., number, :width] = np.take_along_axis(values, again, -1)
            source[..., number, :width] = np.take_along_axis(order, again, -1) + 2 * own[0]
        return found, source

    def readings(self, places: Floats, noise: Floats | float, pitch: float) -> Floats:
        """What arrays tell of places along them, shape (..., A, C): with noise, of the nearest detector. [m]"""
        told = places + noise
        if pitch > 0:
            told = np.round(told / pitch) * pitch
        longest = np.array([self.last[self.array == number].max() for number in range(self.arrays)])
        least = np.array([self.first[self.array == number].min() for number in range(self.arrays)])
        if pitch > 0:
            longest = np.where(np.isfinite(longest), np.floor(longest / pitch * (1 + 1e-12)) * pitch, longest)
        return np.clip(told, least[:, np.newaxis], longest[:, np.newaxis])

    def points(self, places: Floats) -> tuple[Floats, Floats]:
        """Points y, z of places along the arrays, shape (..., A, C, 2), and directions of the arrays there."""
        point, along = np.full((2, *places.shape, 2), np.nan)
        for number in range(self.arrays):
            own = np.flatnonzero(self.array == number)
            here = places[..., number, :]
            which = own[np.clip(np.searchsorted(self.first[own], here, side="right") - 1, 0, own.size - 1)]
            origin = np.where(np.isfinite(self.first[which]), self.first[which], 0.0)
            along[..., number, :, :] = self.along[which]
            point[..., number, :, :] = self.start[which] + (here - origin)[..., np.newaxis] * self.along[which]
        return point, along

    def nearest(self, points: Floats) -> tuple[Floats, NDArray[np.int64]]:
        """Distances of points, shape (M, 2), from the nearest piece, and which that is. [m]"""
        least, which = np.full(len(points), np.inf), np.zeros(len(points), np.int64)
        for number, (start, along, ends) in enumerate(zip(self.start, self.along, self.ends, strict=True)):
            way = points - start
            place = np.clip(way @ along, *ends)
            distance = np.linalg.norm(way - place[:, np.newaxis] * along, axis=1)
            nearer = distance < least
            least[nearer], which[nearer] = distance[nearer], number
        return least, which


def pieces_of(block: Detectors) -> Pieces:
    """Straight pieces of the lines and the arrays of a study."""
    rows: list[tuple[int, Floats, Floats, float, float]] = []
    for l0, l1, l2 in block.lines or ():
        across = np.array([l0, l1]) / np.hypot(l0, l1)
        along = np.array([-across[1], across[0]])
        along = along if (along[0], along[1]) > (0.0, 0.0) else -along
        number = rows[-1][0] + 1 if rows else 0
        rows.append((number, across * l2 / np.hypot(l0, l1), along, -np.inf, np.inf))
    for array in block.arrays or ():
        number, place = (rows[-1][0] + 1 if rows else 0), 0.0
        points = np.array(array.points, np.float64)
        for start, stop in pairwise(points):
            length = float(np.hypot(*(stop - start)))
            rows.append((number, start, (stop - start) / length, place, place + length))
            place += length
    numbers, *columns = zip(*rows, strict=True)
    return Pieces(np.array(numbers, np.int64), *(np.array(column, np.float64) for column in columns))
