"""Reading results, whatever their format: opened with xarray, or as they are stored, piece by piece.

What is read may be damaged or be something else: every fault becomes a `HeliosweepError` that says what is wrong.
xarray is imported where it reads: a finished result is found without it.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.errors import HeliosweepError, Problem, StudyError, reason_of
from heliosweep.files import user_path
from heliosweep.grid.regions import Part, Region
from heliosweep.store.encoding import little_endian
from heliosweep.store.folder import RESULTS, is_zarr, read_manifest, refuse_devices
from heliosweep.store.parts import WORKING

if TYPE_CHECKING:
    import xarray as xr

#: Values read at a time, about. [bytes]
PIECE = 16 * 2**20
#: How NetCDF files begin: those on HDF5, and the older ones.
_SIGNATURES = (b"\x89HDF", b"CDF")
#: Files of a Zarr group besides its chunks.
_METADATA = (".zgroup", ".zattrs", ".zmetadata", ".zarray")
#: What begins the units of every stored time.
_SINCE = "seconds since 1970-01-01"

Index = tuple[slice, ...]


def is_netcdf(path: Path) -> bool:
    """True for a file that begins as NetCDF files do; the library says other things of others, one time or another."""
    if not path.is_file():  # a pipe would be waited for
        return False
    with path.open("rb") as file:
        return file.read(8).startswith(_SIGNATURES)


def locate(path: str | os.PathLike[str]) -> Path:
    """Find the result that a path means: a NetCDF file, a Zarr group, or a folder with one of them.

    Raises StudyError where there is none.
    """
    place = user_path(path)
    if not place.exists():
        raise StudyError(Problem("no such file or folder", file=str(place)))
    refuse_devices(place)
    if not place.is_dir() or is_zarr(place):
        return place
    found = [name for name in RESULTS if (place / name).exists()]
    if not found:
        left = "; its run is unfinished" if (place / WORKING).is_dir() else ""
        raise StudyError(Problem(f"holds no result{left}", file=str(place)))
    if len(found) > 1:  # somebody has put one beside the other
        named = manifest_of(place / found[1])
        return place / found[bool(named)]
    return place / found[0]


def manifest_of(place: Path) -> dict[str, Any]:
    """The manifest that tells of a result; empty where there is none, or of another file."""
    try:
        manifest = read_manifest(place.parent)
    except HeliosweepError:
        return {}
    return manifest if manifest["result"]["file"] == place.name else {}


def import_no_other_arrays() -> None:
    """Keep xarray from importing dask and pint, a third of a second, to see whether an array is one of theirs.

    None is, before someone has imported them. An xarray that keeps what it knows of them elsewhere imports them.
    """
    from xarray.namedarray import pycompat, utils

    known: Any = getattr(pycompat, "_cached_duck_array_modules", None)
    real: Any = getattr(pycompat, "DuckArrayModule", None)
    if known is None or real is None:
        return

    class Late:
        def __init__(self, name: Any, module: str) -> None:
            self._name, self._module = name, module

        def __getattr__(self, of: str) -> Any:
            if of == "type" and self._module not in sys.modules:
                return ()
            known[self._name] = real(self._name)
            return getattr(known[self._name], of)

    for name, module in (("dask", "dask.array"), ("pint", "pint")):
        known.setdefault(name, Late(name, module))
    ask: Any = getattr(utils, "is_dask_collection", None)
    if ask is not None and ask.__module__ == utils.__name__:
        vars(utils)["is_dask_collection"] = lambda x: "dask" in sys.modules and ask(x)


def open_result(path: str | os.PathLike[str]) -> xr.Dataset:
    """Open a result folder, or its ``result.nc`` or ``result.zarr``; safe also while other threads run studies.

    It is read lazily. Raises StudyError for a folder without a result, or a file that is none, and HeliosweepError for
    a Zarr group that is damaged.
    """
    import xarray as xr

    from heliosweep.netcdf import LIBRARY_LOCK
    from heliosweep.store.formats import read_metadata

    import_no_other_arrays()
    place = locate(path)
    if place.is_dir():
        read_metadata(place)
        result = xr.open_zarr(place.absolute(), chunks=None, consolidated=True, zarr_format=2)
    elif is_netcdf(place):
        with LIBRARY_LOCK:
            result = xr.open_dataset(place.absolute(), engine="netcdf4", lock=LIBRARY_LOCK)
    else:
        raise StudyError(Problem("is no result; name a result folder", file=str(place)))
    text = {name: item for name, item in result.coords.items() if item.dtype.kind in "OT"}
    for name, item in text.items():
        text[name] = item.copy(data=item.to_numpy().astype(object).astype(str))
        text[name].encoding.pop("char_dim_name", None)  # of fewer names, the longest may be shorter
    decoded = result.assign_coords(text)
    decoded.set_close(result.close)  # else it would close nothing
    return decoded


class Stored:
    """A result as it is stored.

    `variables` are coordinates and data, undecoded, in the order of the result, as `sizes` are; `attributes` the global
    ones; `record` is what a Zarr group holds besides (see `formats.read_metadata`). `told` is called after every
    reading.
    """

    def __init__(
        self,
        path: Path,
        variables: Mapping[str, xr.Variable],
        sizes: Mapping[str, int],
        attributes: Mapping[str, Any],
        record: Mapping[str, Any],
        told: Callable[[], object],
    ) -> None:
        self.path, self.variables, self.sizes, self.record = path, variables, sizes, record
        self.attributes = plain(attributes)
        self._told = told

    def dims(self, name: str) -> tuple[str, ...]:
        """Dimensions of a variable."""
        return tuple(map(str, self.variables[name].dims))

    def is_text(self, name: str) -> bool:
        """True where the values of a variable are strings."""
        return self.variables[name].dtype.kind in "OTU"

    def read(self, name: str, index: Index) -> np.ndarray:
        """Values of a region, as stored. Raises HeliosweepError where they cannot be read."""
        try:
            values = np.asarray(self.variables[name][index].to_numpy(), dtype=object if self.is_text(name) else None)
        except Exception as error:  # the libraries raise anything for what is damaged
            raise HeliosweepError(f"{self.path}: {name} cannot be read: {reason_of(error)}") from error
        self._told()
        # "<" and "=" mean the same here, but the NetCDF library warns of the one.
        native = np.dtype(values.dtype.newbyteorder("=").str)
        return values.astype(native, copy=False).view(native)

    def slab(self, slab: Part) -> dict[str, np.ndarray]:
        """Values of a slab. Raises HeliosweepError."""
        return {name: self.read(name, self.index(name, slab.region)) for name in self.of_kind(slab.kind)}

    def index(self, name: str, region: Region) -> Index:
        """Region of the whole result as an index of one variable."""
        return tuple(region.get(dim, slice(0, self.sizes[dim])) for dim in self.dims(name))

    def pieces(self, name: str) -> Iterator[Index]:
        """Cut a variable into pieces of bounded size, in the order of its values."""
        variable = self.variables[name]
        chunks = variable.encoding.get("chunksizes") or variable.encoding.get("chunks") or (1,) * variable.ndim
        room = PIECE // 8
        spans: list[list[slice]] = []
        for size, chunk in zip(reversed(variable.shape), reversed(chunks), strict=True):
            # Whole storage chunks, so that each is read once, unless they are much larger than a piece.
            length = min(size, room // chunk * chunk or (chunk if chunk <= 4 * room else max(room, 1)))
            length = max(length, 1)
            room = room // max(1, size) if length >= size else 0
            spans.insert(0, [slice(start, min(start + length, size)) for start in range(0, size, length)])
        return itertools.product(*spans)

    @property
    def coordinates(self) -> list[str]:
        """Names of the variables that are coordinates."""
        named = {label for item in self.variables.values() for label in str(item.attrs.get("coordinates", "")).split()}
        return [name for name in self.variables if name in self.sizes or name in named]

    @property
    def data(self) -> list[str]:
        """Names of the variables that were computed."""
        if known := self.record.get("variables"):
            return [name for name in self.variables if name in known]
        coordinates = {*self.coordinates}
        return [name for name in self.variables if name not in coordinates]

    def of_kind(self, kind: str) -> list[str]:
        """Names of the computed variables in slabs of a kind."""
        return [name for name in self.data if ("time" in self.variables[name].dims) == (kind == "series")]


@contextmanager
def open_stored(path: str | os.PathLike[str], told: Callable[[], object] = lambda: None) -> Iterator[Stored]:
    """Open a result, or that of a folder, as it is stored; `told` is called after every reading of values.

    Raises HeliosweepError where it is no result, or damaged.
    """
    import xarray as xr
    from xarray.conventions import decode_cf_variables

    from heliosweep.netcdf import LIBRARY_LOCK
    from heliosweep.store.formats import read_metadata

    place = locate(path)
    store = None
    try:
        try:
            if place.is_dir():
                entries, record = read_metadata(place)
                store = xr.backends.ZarrStore.open_group(place.absolute(), mode="r", consolidated=True, zarr_format=2)
                names = [name.removesuffix("/.zarray") for name in entries if name.endswith("/.zarray")]
                variables = {name: store.open_store_variable(name) for name in names}
                found = store.get_dimensions()
                sizes = {dim: n for dim, n in record["sizes"] if found.get(dim, n) == n} | found
                attributes = store.get_attrs()
            else:
                with LIBRARY_LOCK:
                    store, record = xr.backends.NetCDF4DataStore.open(place, lock=LIBRARY_LOCK), {}
                    attributes = store.get_attrs()
                    decoded, *_ = decode_cf_variables(  # of text: its characters are put together
                        store.get_variables(), attributes,
                        mask_and_scale=False, decode_times=False, decode_coords=False, decode_timedelta=False,
                    )  # fmt: skip
                    variables = dict(decoded)
                    letters = {item.encoding.get("char_dim_name") for item in variables.values()}
                    sizes = {dim: size for dim, size in store.get_dimensions().items() if dim not in letters}
                    for name, item in variables.items():
                        if item.dtype.kind == "O":
                            item.encoding.pop("chunksizes", None)  # of its characters
                        elif item.encoding.get("chunksizes"):
                            store.ds[name].set_var_chunk_cache(size=0, nelems=1)  # every chunk is read once
            stored = Stored(place, variables, sizes, attributes, record, told)
        except HeliosweepError:
            raise
        except Exception as error:  # the libraries raise anything for what is damaged
            kind = "Zarr group" if place.is_dir() else "NetCDF file"
            raise HeliosweepError(f"{place}: is no {kind}, or damaged: {reason_of(error)}") from error
        yield stored
    finally:
        if store is not None:
            with LIBRARY_LOCK:
                store.close()


def plain(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes as strings, numbers and lists of them."""
    return {name: np.asarray(value).tolist() for name, value in attributes.items()}


def file_digest(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file, as hexadecimal digits."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def result_digest(path: Path) -> str:
    """SHA-256 of a result: of the file, or over the names and bytes of all files of a Zarr group."""
    if not path.is_dir():
        return file_digest(path)
    digest = hashlib.sha256()
    for name, size in sorted(tree(path).items()):
        digest.update(name.encode("utf-8", "surrogateescape") + b"\0" + size.to_bytes(8, "little"))
        with (path / name).open("rb") as file:
            while piece := file.read(PIECE):
                digest.update(piece)
    return digest.hexdigest()


def result_bytes(path: Path) -> int:
    """Size of a result. [bytes]"""
    return sum(tree(path).values()) if path.is_dir() else path.stat().st_size


def tree(path: Path) -> dict[str, int]:
    """Zarr's own files of a folder and of those in it: relative name with slashes, size. [bytes]."""
    own = (file for file in path.rglob("*") if _is_own(file.name) and file.is_file())
    return {file.relative_to(path).as_posix(): file.stat().st_size for file in own}


def foreign(path: Path) -> list[str]:
    """Names of the other files in a Zarr group: of what browses folders, shares or unpacks them, and leaves its own."""
    others = (file for file in path.rglob("*") if not _is_own(file.name) and file.is_file())
    return sorted(file.relative_to(path).as_posix() for file in others)


def odd(path: Path) -> list[str]:
    """Names of what stands for chunks or metadata of a Zarr group and is no file: a pipe would be waited for."""
    there = (entry for entry in path.rglob("*") if _is_own(entry.name) and not entry.is_file() and not entry.is_dir())
    return sorted(entry.relative_to(path).as_posix() for entry in there)


def _is_own(name: str) -> bool:
    """True for a file that is metadata or a chunk, as ``0.3.0``."""
    return name in _METADATA or (name.isascii() and name.replace(".", "").isdecimal())


def content_digest(path: str | os.PathLike[str], told: Callable[[], object] = lambda: None) -> str:
    """SHA-256 over names, dimensions, types, attributes and values of a NetCDF file or Zarr group.

    Equal for results that say the same, whatever library version, format, storage layout or compression wrote them.
    `told` is called after every piece that was read.
    """
    digest = hashlib.sha256()
    with open_stored(path, told) as stored:
        digest.update(_canonical(dict(stored.sizes)))
        digest.update(_canonical(stored.attributes))
        for name, variable in sorted(stored.variables.items()):
            text = stored.is_text(name)
            dtype = "str" if text else np.dtype(variable.dtype.newbyteorder("=").str).str
            digest.update(_canonical([name, stored.dims(name), dtype]))
            digest.update(_canonical(plain(variable.attrs)))
            for index in stored.pieces(name):
                piece = stored.read(name, index)
                digest.update(_canonical(piece.tolist()) if text else little_endian(piece))
                del piece  # before the next one is read
    return digest.hexdigest()


def _canonical(value: object) -> bytes:
    return json.dumps(value, sort_keys=True, separators=(",", ":")).encode()


class Places:
    """Names places of a stored result; its coordinates are read when they are needed."""

    def __init__(self, stored: Stored) -> None:
        self._stored = stored
        self._labels: dict[str, np.ndarray | None] = {}

    def at(self, dims: tuple[str, ...], position: tuple[int, ...]) -> str:
        """One place, as ``latitude 30 degrees_north, heliostat 17``."""
        return ", ".join(f"{dim} {self._label(dim, number)}" for dim, number in zip(dims, position, strict=True))

    def within(self, region: Region) -> str:
        """A region, as ``latitude 30 to 45 degrees_north``; dimensions that it spans whole are left out."""
        said = []
        for dim, span in region.items():
            if span != slice(0, self._stored.sizes[dim]):
                first, last = self._label(dim, span.start), self._label(dim, span.stop - 1)
                said.append(f"{dim} {first}" if span.stop - span.start == 1 else f"{dim} {first} to {last}")
        return ", ".join(said)

    def _label(self, dim: str, number: int) -> str:
        if dim not in self._labels:
            try:
                index = self._stored.index(dim, {})
                self._labels[dim] = self._stored.read(dim, index) if len(index) == 1 else None
            except (HeliosweepError, KeyError):
                self._labels[dim] = None
        labels = self._labels[dim]
        return f"[{number}]" if labels is None else value_text(labels[number], self.units(dim))

    def units(self, name: str) -> str:
        """Units of a variable as they stand behind a number; empty for those without."""
        units = str(self._stored.variables[name].attrs.get("units", ""))
        return "" if units == "1" else units


def value_text(value: Any, units: str = "") -> str:
    """One stored value with its unit; times as dates."""
    if isinstance(value, str):
        return repr(value)
    number = value.item() if isinstance(value, np.generic) else value
    if units.startswith(_SINCE):
        if not np.isfinite(number) or abs(number) > 9e9:
            return str(np.datetime64("NaT")) if np.isnan(number) else f"{number!r} s"
        time = np.datetime64(round(number * 1e3), "ms")
        return str(time).removesuffix(".000").removesuffix(":00")
    text = repr(number).removesuffix(".0")
    return f"{text} {units}" if units else text
