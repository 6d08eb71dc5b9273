"""What one task is given of an input: a piece of an array that costs little to send.

A graph travels to other processes, so nothing large may stand in it for every block. Each block gets its own piece of
an array and no more; what is repeated along a dimension is sent once; a large piece that blocks share has a key of its
own; and what follows from a few numbers, as a generated layout does, is made anew where it is needed.
"""

from __future__ import annotations

import pickle
import zlib
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

__all__ = ["Constant", "Embedded", "Given", "Joined", "Made", "Remade", "View", "Widened", "compact_bytes"]

#: What is larger than this is compressed before it is sent. [bytes]
COMPRESSED = 2048


class Made(NamedTuple):
    """An input that every process can make for itself, so that its values need not be sent.

    Parameters
    ----------
    array : xarray.DataArray
        The input, in this process.
    make : callable
        Makes the values of `array`, the same bits everywhere; a function of a module.
    arguments : tuple
        Of `make`; hashable and small.
    """

    array: xr.DataArray
    make: Callable[..., NDArray[Any]]
    arguments: tuple[Hashable, ...]

    def rename(self, **names: str) -> Made:
        """The same input with other names of dimensions."""
        return self._replace(array=self.array.rename(names))


@lru_cache(maxsize=8)
def _remade(make: Callable[..., NDArray[Any]], arguments: tuple[Hashable, ...]) -> NDArray[Any]:
    """Values of an input that is made in this process, once for all blocks that follow each other."""
    return make(*arguments)


class View(NamedTuple):
    """How a part of an array becomes an argument: dimensions in order, of length 1 where it does not vary."""

    axes: tuple[int, ...]
    place: tuple[Any, ...]

    def of(self, array: NDArray[Any]) -> NDArray[Any]:
        """The argument as a view."""
        return array.transpose(self.axes)[self.place]

    def __call__(self, array: NDArray[Any]) -> NDArray[Any]:
        """The argument, contiguous: the order of a sum must not depend on how the array came here."""
        return np.asarray(self.of(array), order="C")


def _compact(array: NDArray[Any]) -> NDArray[Any]:
    """The array without what is repeated in memory."""
    repeated = tuple(
        slice(0, 1) if stride == 0 and size > 1 else slice(None)
        for stride, size in zip(array.strides, array.shape, strict=True)
    )
    return array[(*repeated, ...)]


def compact_bytes(array: NDArray[Any]) -> int:
    """Size of an array without what is repeated in memory. [bytes]."""
    return _compact(array).nbytes


def _is_range(array: NDArray[Any]) -> bool:
    return (
        array.dtype == np.int64
        and array.size > 4
        and bool(np.array_equal(array.ravel(), np.arange(array.flat[0], array.flat[0] + array.size)))
    )


def _range(start: int, shape: tuple[int, ...]) -> NDArray[np.int64]:
    return np.arange(start, start + int(np.prod(shape)), dtype=np.int64).reshape(shape)


def _unpacked(data: bytes, dtype: str, least: tuple[int, ...], shape: tuple[int, ...]) -> NDArray[Any]:
    kind = np.dtype(dtype)
    planes = np.frombuffer(zlib.decompress(data), np.uint8).reshape(kind.itemsize, -1)
    # A copy, and so writable: kernels would be compiled anew for arrays that are not.
    array = np.ascontiguousarray(planes.T).reshape(-1).view(kind).reshape(least)
    return array if least == shape else np.broadcast_to(array, shape)


def _widened(array: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    return np.broadcast_to(array, shape)


def _unzipped(data: bytes) -> Any:
    return pickle.loads(zlib.decompress(data))


def _sent(value: Any) -> tuple[Any, ...]:
    """A callable and its arguments that make the value again: what is sent in its place."""
    if not isinstance(value, np.ndarray) or value.dtype.hasobject:
        data = pickle.dumps(value, protocol=5)
        return (_unzipped, zlib.compress(data, 1)) if len(data) > COMPRESSED else (pickle.loads, data)
    least = _compact(value)
    if least.shape == value.shape and _is_range(least):
        return _range, int(least.flat[0]), value.shape
    if least.nbytes > COMPRESSED:
        # Byte by byte: the leading bytes of neighbouring numbers are alike.
        planes = np.ascontiguousarray(least).reshape(-1).view(np.uint8).reshape(-1, least.itemsize).T
        return _unpacked, zlib.compress(planes.tobytes(), 1), least.dtype.str, least.shape, value.shape
    return (_widened, least.copy(), value.shape) if least.shape != value.shape else (np.array, least)


class Constant:
    """A value that a task gives back; sent in as few bytes as can be had without losing one of them."""

    __slots__ = ("value",)

    def __init__(self, value: Any) -> None:
        self.value = value

    def __call__(self) -> Any:
        """The value."""
        return self.value

    def __reduce__(self) -> tuple[Any, ...]:
        return _constant, _sent(self.value)


def _constant(make: Callable[..., Any], *arguments: Any) -> Constant:
    return Constant(make(*arguments))


class Embedded(Constant):
    """A piece that stands in the task itself."""

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        return _embedded, _sent(self.value)


def _embedded(make: Callable[..., Any], *arguments: Any) -> Embedded:
    return Embedded(make(*arguments))


class Remade:
    """A piece of an input that each process makes for itself.

    Parameters
    ----------
    made : Made
        The input.
    region : tuple
        The part of it that the piece is.
    view : View
        How it becomes an argument.
    """

    __slots__ = ("arguments", "array", "make", "region", "view")

    def __init__(self, made: Made, region: tuple[Any, ...], view: View) -> None:
        self.array: NDArray[Any] | None = made.array.to_numpy()
        self.make, self.arguments = made.make, made.arguments
        self.region, self.view = region, view

    def __call__(self) -> NDArray[Any]:
        """The piece."""
        array = _remade(self.make, self.arguments) if self.array is None else self.array
        return self.view(array[self.region])

    def __getstate__(self) -> tuple[Any, ...]:
        return self.make, self.arguments, self.region, self.view

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self.array = None
        self.make, self.arguments, self.region, self.view = state


class Given:
    """A piece that comes as it is from a task of its own."""

    __slots__ = ()

    def __call__(self, value: NDArray[Any]) -> NDArray[Any]:
        """The piece."""
        return value


@dataclass(frozen=True, slots=True)
class Joined:
    """A piece of a lazy input: blocks of it, put together where a dimension that is held whole has several."""

    grid: tuple[int, ...]
    view: View

    def __call__(self, blocks: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """The piece."""
        parts = list(blocks)
        for axis in reversed(range(len(self.grid))):
            count = self.grid[axis]
            if count > 1:
                parts = [np.concatenate(parts[i : i + count], axis) for i in range(0, len(parts), count)]
        (whole,) = parts
        return self.view(whole)


@dataclass(frozen=True, slots=True)
class Widened:
    """A piece as long as the block along dimensions that no input has."""

    piece: Callable[..., NDArray[Any]]
    lengths: tuple[tuple[int, int], ...]

    def __call__(self, *given: Any) -> NDArray[Any]:
        """The piece."""
        array = self.piece(*given)
        shape = list(array.shape)
        for axis, length in self.lengths:
            shape[axis] = length
        return np.broadcast_to(array, tuple(shape))
