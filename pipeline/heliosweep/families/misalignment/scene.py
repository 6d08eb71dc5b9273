"""What every mode hands to its kernels: receiver, mount, pivots and sun, labelled and then block by block.

A block of the grid comes as one array per argument over (swept dimensions, heliostat), of length 1 where it does not
vary, then its core dimensions. `Block` turns it into what kernels take: P parameter points, H heliostats, T instants.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.blocks import MOUNTS
from heliosweep.families.misalignment.instants import DayHours, day_hours, instant_attributes, sun_of
from heliosweep.families.misalignment.places import Places
from heliosweep.families.sun import site_of
from heliosweep.grid.axes import Grid
from heliosweep.grid.evaluate import Made
from heliosweep.kernels.receiver import Setting

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.config import MisalignmentStudy

#: Keys of the study that the kernels' setting is made of.
_RECEIVER = tuple(f"receiver.{key}" for key in ("azimuth", "tilt", "width", "height_extent", "height"))
_MOUNT = tuple(f"mount.{key}" for key in ("kind", "axis_azimuth", "mirror_offset", "axis_offset", "pedestal_height"))
#: Keys that label a result also where they are not swept.
LABELS = (
    "site.latitude",
    "site.longitude",
    "sun.azimuth",
    "sun.elevation",
    *_RECEIVER,
    *_MOUNT,
    "heliostats.pivot_height",
)
#: Arguments of a scene, before what a mode adds.
ARGUMENTS = len(_RECEIVER) + len(_MOUNT) + 7


class Scene:
    """A study over a slab of its grid, labelled.

    Parameters
    ----------
    study : MisalignmentStudy
        Checked study.
    chunks : mapping of str to int
        Block lengths, from the plan.
    select : mapping of str to slice, optional
        Part of the swept dimensions; all of them where left out.

    Attributes
    ----------
    grid : Grid
    places : Places
    instants : DayHours
    dims : tuple of str
        Dimensions of a block: the swept ones, then ``heliostat``.
    sizes : dict of str to int
        Lengths of `dims`.
    arguments : list of xarray.DataArray or Made
        What `Block` takes first.
    core : list of tuple of str
        Core dimensions of the arguments.
    """

    def __init__(
        self, study: MisalignmentStudy, chunks: Mapping[str, int], select: Mapping[str, slice] | None = None
    ) -> None:
        self.study, self.chunks = study, chunks
        self.grid = Grid(study, select)
        self.places = Places(self.grid)
        self.instants = day_hours(self.grid)
        self.dims = (*self.grid.sizes, "heliostat")
        self.sizes = {**self.grid.sizes, "heliostat": self.places.size}
        latitude = site_of(self.grid).get("latitude", xr.DataArray(0.0))
        places = self.places
        self.arguments: list[xr.DataArray | Made] = [
            *places.inputs,
            places.pivot_height,
            places.numbers,
            *(self.grid.parameter(key) for key in (*_RECEIVER, *_MOUNT)),
            latitude,
            sun_of(self.grid, self.instants, chunks),
        ]
        self.core: list[tuple[str, ...]] = [()] * (ARGUMENTS - 1) + [("time", "xyz")]

    def coordinates(self, keys: Sequence[str] = ()) -> xr.Dataset:
        """Coordinates of the result, and what it says of its sun and its mode, as attributes.

        Parameters
        ----------
        keys : sequence of str
            Dotted keys that label the result besides those of every mode.
        """
        labels = self.grid.coordinates((*LABELS, *keys))
        labels |= self.places.coordinates | self.instants.labels
        return xr.Dataset(coords=labels, attrs={"mode": self.study.mode, **instant_attributes(self.study)})


def coordinates_of(
    study: MisalignmentStudy, select: Mapping[str, slice] | None = None, keys: Sequence[str] = ()
) -> xr.Dataset:
    """Coordinates of the result over a part of the parameter grid: see `Scene.coordinates`."""
    return Scene(study, {}, select).coordinates(keys)


class Block(NamedTuple):
    """One block of the grid as kernels take it."""

    lead: tuple[int, ...]
    """Lengths of the swept dimensions; their product is P."""
    setting: Setting
    """Receiver and mount, shape (P,)."""
    sun: NDArray[np.float64]
    """Unit vectors towards the sun, shape (P or 1, T, 3)."""
    pivots: NDArray[np.float64]
    """Pivots relative to the tower's base, shape (P or 1, H, 3); NaN where a shorter layout is padded. [m]"""
    numbers: NDArray[np.int64]
    """Numbers of the heliostats, shape (H,)."""
    others: tuple[NDArray[Any], ...]
    """What a mode adds, as it came."""

    @classmethod
    def of(cls, *arrays: NDArray[Any]) -> Block:
        """Sort the arguments of a scene and what a mode adds."""
        x, y, z, pivot_height, numbers, *values, latitude, sun = arrays[:ARGUMENTS]
        others = arrays[ARGUMENTS:]
        swept = x.ndim - 1
        lead = np.broadcast_shapes(*(array.shape[:swept] for array in arrays))
        azimuth, tilt, width, extent, height, kind, axis_azimuth, *offsets = values

        def each(array: NDArray[Any]) -> NDArray[np.float64]:
            return points(array, lead)

        codes = np.array([_CODES[str(name)] for name in kind.flat], np.int64).reshape(kind.shape)
        setting = Setting(
            np.radians(each(azimuth)),
            np.radians(each(tilt)),
            0.5 * each(width),
            0.5 * each(extent),
            each(height),
            points(codes, lead),
            np.radians(each(latitude)),
            np.radians(each(axis_azimuth)),
            *(each(offset) for offset in offsets),
        )
        pivots = np.stack(np.broadcast_arrays(x, y, z + pivot_height), axis=-1)
        return cls(
            lead,
            setting,
            _rows(sun[..., 0, :, :], lead),
            _rows(pivots, lead),
            numbers.ravel().astype(np.int64),
            others,
        )


def points(array: NDArray[Any], lead: tuple[int, ...]) -> NDArray[Any]:
    """Values of a parameter of the study, which does not vary along ``heliostat``, over P points; contiguous."""
    return np.array(np.broadcast_to(array[..., 0], lead)).reshape(-1)


def _rows(array: NDArray[np.float64], lead: tuple[int, ...]) -> NDArray[np.float64]:
    """An array over (swept dimensions, a, b) over (P, a, b), or (1, a, b) where it does not vary; contiguous."""
    swept, inner = array.shape[: len(lead)], array.shape[len(lead) :]
    if math.prod(swept) > 1:
        array = np.broadcast_to(array, (*lead, *inner))
    return np.array(array, np.float64, order="C").reshape(-1, *inner)


_CODES = {name: code for code, name in enumerate(MOUNTS)}


def block_result(values: NDArray[Any], block: Block, sizes: Mapping[str, int]) -> NDArray[Any]:
    """A kernel's result over (outputs, P, H, T, ...) over (outputs, swept dimensions, heliostat, day, hour, ...)."""
    outputs, _, heliostats, _, *inner = values.shape
    return values.reshape(outputs, *block.lead, heliostats, *sizes.values(), *inner)


__all__ = ["ARGUMENTS", "LABELS", "Block", "DayHours", "Scene", "block_result", "coordinates_of", "points"]
