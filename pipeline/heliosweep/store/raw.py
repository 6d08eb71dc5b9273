"""Results as they are stored, whatever their format: dimensions, attributes and undecoded values, read piece by piece.

What is read may be damaged or be something else: every fault becomes a `HeliosweepError` that says what is wrong.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

from heliosweep.errors import HeliosweepError, Problem, StudyError
from heliosweep.grid.slabs import Part, slabs
from heliosweep.store import records, zarr_result
from heliosweep.store.lock import LIBRARY_LOCK

#: Values read at a time, about. [bytes]
PIECE = 16 * 2**20
#: Names of a result in its folder.
RESULTS = ("result.nc", "result.zarr")
#: How NetCDF files begin: those on HDF5, and the older ones.
_SIGNATURES = (b"\x89HDF", b"CDF")
#: Folder of an unfinished study beside them.
WORKING = "working"

Index = tuple[slice, ...]


@dataclass(frozen=True)
class RawVariable:
    """What is stored of a variable besides its values.

    Parameters
    ----------
    dims : tuple of str
        Dimensions.
    shape : tuple of int
        Their lengths.
    dtype : numpy.dtype
        Of the numbers; object for text.
    attributes : dict
        Numbers, strings and lists of them.
    storage : tuple of int
        Lengths of a storage chunk; ones where there are none.
    """

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: np.dtype
    attributes: dict[str, Any]
    storage: tuple[int, ...]

    @property
    def text(self) -> bool:
        """Whether the values are strings."""
        return self.dtype.kind == "O"


@dataclass(frozen=True)
class Raw:
    """A result as it is stored.

    Parameters
    ----------
    path : pathlib.Path
        The file or Zarr group.
    sizes : dict of str to int
        Dimensions, in the order of the result.
    attributes : dict
        Global attributes.
    variables : dict of str to RawVariable
        Coordinates and data, in the order of the result.
    reader : callable
        Reads a region of a variable.
    record : mapping
        What a Zarr group holds besides (see `zarr_result.read_metadata`).
    told : callable
        Called after every reading.
    """

    path: Path
    sizes: dict[str, int]
    attributes: dict[str, Any]
    variables: dict[str, RawVariable]
    reader: Callable[[str, Index], Any]
    record: Mapping[str, Any] = field(default_factory=dict)
    told: Callable[[], object] = lambda: None

    def read(self, name: str, index: Index) -> np.ndarray:
        """Values of a region, as stored.

        Raises
        ------
        HeliosweepError
            They cannot be read.
        """
        variable = self.variables[name]
        try:
            values = np.asarray(self.reader(name, index), dtype=object if variable.text else None)
        except Exception as error:
            raise HeliosweepError(f"{self.path}: {name} cannot be read: {_said(error)}") from error
        self.told()
        # "<" and "=" mean the same here, but the NetCDF library warns of the one.
        native = np.dtype(values.dtype.newbyteorder("=").str)
        return values if variable.text else values.astype(native, copy=False).view(native)

    def index(self, name: str, region: Mapping[str, slice]) -> Index:
        """Region of the whole result as an index of one variable."""
        variable = self.variables[name]
        return tuple(region.get(dim, slice(0, n)) for dim, n in zip(variable.dims, variable.shape, strict=True))

    def pieces(self, name: str) -> Iterator[Index]:
        """Cut a variable into pieces of bounded size, in the order of its values."""
        variable = self.variables[name]
        room = PIECE // 8
        lengths: list[int] = []
        for size, chunk in zip(reversed(variable.shape), reversed(variable.storage), strict=True):
            # Whole storage chunks, so that each is read once, unless they are much larger than a piece.
            length = min(size, room // chunk * chunk or (chunk if chunk <= 4 * room else max(room, 1)))
            lengths.append(max(length, 1))
            room = room // max(1, size) if length >= size else 0
        lengths.reverse()
        starts = [range(0, size, length) for size, length in zip(variable.shape, lengths, strict=True)]
        for corner in itertools.product(*starts):
            ends = zip(corner, lengths, variable.shape, strict=True)
            yield tuple(slice(start, min(start + length, size)) for start, length, size in ends)

    @property
    def coordinates(self) -> list[str]:
        """Names of the variables that are coordinates."""
        named = {
            label for item in self.variables.values() for label in str(item.attributes.get("coordinates", "")).split()
        }
        return [name for name in self.variables if name in self.sizes or name in named]

    @property
    def data(self) -> list[str]:
        """Names of the variables that were computed."""
        if known := self.record.get("variables"):
            return [name for name in self.variables if name in known]
        coordinates = {*self.coordinates}
        return [name for name in self.variables if name not in coordinates]

    def of_kind(self, kind: str) -> list[str]:
        """Names of the computed variables in parts of a kind: ``series`` those over ``time``, ``points`` the others."""
        return [name for name in self.data if ("time" in self.variables[name].dims) == (kind == "series")]


def is_zarr(path: Path) -> bool:
    """Whether a path looks like a Zarr group with consolidated metadata."""
    return (path / zarr_result.CONSOLIDATED).is_file()


def is_netcdf(path: Path) -> bool:
    """Whether a file begins as NetCDF files do; the library says other things of others, one time or another."""
    if not path.is_file():  # a pipe would be waited for
        return False
    with path.open("rb") as file:
        return file.read(8).startswith(_SIGNATURES)


def locate(path: str | os.PathLike[str]) -> Path:
    """Find the result that a path means: a NetCDF file, a Zarr group, or a folder with one of them.

    Raises
    ------
    StudyError
        There is none.
    """
    place = Path(path)
    if not place.exists():
        raise StudyError(Problem("no such file or folder", file=str(place)))
    if not place.is_dir() or is_zarr(place):
        return place
    found = [name for name in RESULTS if (place / name).exists()]
    if not found:
        left = "; its run is unfinished" if (place / WORKING).is_dir() else ""
        raise StudyError(Problem(f"holds no result{left}", file=str(place)))
    if len(found) > 1:  # somebody has put one beside the other
        with suppress(OSError, ValueError):
            manifest = records.check(records.read_json(place / "manifest.json"), records.Manifest)
            found.sort(key=lambda name: name != manifest["result"]["file"])
    return place / found[0]


@contextmanager
def open_raw(path: str | os.PathLike[str], told: Callable[[], object] = lambda: None) -> Iterator[Raw]:
    """Open a result, of either format.

    Parameters
    ----------
    path : path
        The result.
    told : callable
        Called after every reading of values.

    Raises
    ------
    HeliosweepError
        It is no result, or damaged.
    """
    place = locate(path)
    with ExitStack() as stack:
        try:
            raw = _open_zarr(place) if place.is_dir() else stack.enter_context(_open_netcdf(place))
        except HeliosweepError:
            raise
        except Exception as error:  # the libraries raise anything for what is damaged
            kind = "Zarr group" if place.is_dir() else "NetCDF file"
            raise HeliosweepError(f"{place}: is no {kind}, or damaged: {_said(error)}") from error
        yield replace(raw, told=told)


def stored_parts(cut: Mapping[str, Any], sizes: Mapping[str, int]) -> Iterator[Part]:
    """Parts of a run in the order of the result, from a cut read from a file.

    Parameters
    ----------
    cut : mapping
        ``points`` and ``series``, each the lengths of a part by dimension, in any order.
    sizes : mapping of str to int
        Dimensions, in the order of the result.

    Raises
    ------
    HeliosweepError
        It does not fit the dimensions.
    """
    try:
        kinds = {kind: dict(cut[kind]) for kind in ("points", "series") if kind in cut}
        swept = [dim for dim in sizes if dim in kinds.get("points", kinds.get("series", {}))]
        for kind, lengths in kinds.items():
            # Files sort their keys; the order is that of the result, but the field after the time.
            order = [dim for dim in swept if dim in lengths and dim != "time"]
            order += sorted((dim for dim in lengths if dim not in order), key=lambda dim: dim != "time")
            whole = {dim: sizes[dim] for dim in order}
            for number, region in enumerate(slabs(whole, {dim: int(lengths[dim]) for dim in order})):
                yield Part(f"{kind}-{number:05}", kind, region)
    except (KeyError, TypeError, ValueError, AttributeError, ZeroDivisionError) as error:
        raise HeliosweepError(f"the cut into parts does not fit the result: {_said(error)}") from None


def part_counts(cut: Mapping[str, Any], sizes: Mapping[str, int]) -> dict[str, int]:
    """Number of parts of each kind, from a cut as of `stored_parts`.

    Raises
    ------
    KeyError
        It does not fit the dimensions.
    """
    kinds = (kind for kind in ("points", "series") if kind in cut)
    return {kind: math.prod(-(-sizes[dim] // length) for dim, length in cut[kind].items()) for kind in kinds}


def is_part(name: str, counts: Mapping[str, int]) -> bool:
    """Whether a part has this name, where there are so many of each kind."""
    kind, _, number = name.partition("-")
    known = number.isascii() and number.isdecimal() and len(number) < 20
    return known and name == f"{kind}-{int(number):05}" and int(number) < counts.get(kind, 0)


def _said(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".rstrip(": ")


@contextmanager
def _open_netcdf(place: Path) -> Iterator[Raw]:
    with LIBRARY_LOCK:
        file = netCDF4.Dataset(place)
    try:
        with LIBRARY_LOCK:
            file.set_auto_maskandscale(False)
            variables = {name: _netcdf_variable(variable) for name, variable in file.variables.items()}
            sizes = {name: len(dim) for name, dim in file.dimensions.items()}
            attributes = _netcdf_attributes(file)

        def read(name: str, index: Index) -> Any:
            with LIBRARY_LOCK:
                return file[name][index or ...]

        yield Raw(place, sizes, attributes, variables, read)
    finally:
        with LIBRARY_LOCK:
            file.close()


def _netcdf_variable(variable: netCDF4.Variable) -> RawVariable:
    text = variable.dtype is str
    storage = variable.chunking()
    if storage == "contiguous" or text or not variable.ndim:
        storage = [1] * variable.ndim
    else:
        variable.set_var_chunk_cache(size=0, nelems=1)  # every chunk is read once
    dtype = np.dtype(object) if text else np.dtype(variable.dtype)
    return RawVariable(variable.dimensions, variable.shape, dtype, _netcdf_attributes(variable), tuple(storage))


def _netcdf_attributes(item: netCDF4.Dataset | netCDF4.Variable) -> dict[str, Any]:
    return {name: np.asarray(item.getncattr(name)).tolist() for name in item.ncattrs()}


def _open_zarr(place: Path) -> Raw:
    metadata = zarr_result.read_metadata(place)
    arrays = zarr_result.arrays(place, "r")
    entries, record = metadata["metadata"], metadata["heliosweep"]
    variables = {}
    for name, array in arrays.items():
        attributes = dict(entries[f"{name}/.zattrs"])
        dims = tuple(attributes.pop("_ARRAY_DIMENSIONS"))
        fill = entries[f"{name}/.zarray"]["fill_value"]
        filled = {} if fill is None else {"_FillValue": float(fill)}
        dtype = np.dtype(entries[f"{name}/.zarray"]["dtype"]).newbyteorder("=")
        text = dtype.kind == "O"
        storage = (1,) * array.ndim if text else tuple(max(1, length) for length in array.chunks)
        variables[name] = RawVariable(dims, array.shape, dtype, {**filled, **attributes}, storage)
        if len(dims) != array.ndim:
            raise HeliosweepError(f"{place}: {name} has other dimensions than it says")
    lengths = {dim: n for item in variables.values() for dim, n in zip(item.dims, item.shape, strict=True)}
    sizes = {dim: n for dim, n in record["sizes"] if lengths.get(dim, n) == n} | lengths
    return Raw(place, sizes, dict(entries.get(".zattrs", {})), variables, lambda n, i: arrays[n][i or ...], record)
