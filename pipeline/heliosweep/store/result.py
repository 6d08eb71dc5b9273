"""Leaving a result, whole or not at all: `result.nc` or `result.zarr` of a run, and NetCDF files of Zarr results."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from heliosweep.errors import HeliosweepError, Problem, StudyError
from heliosweep.files import discard, remove_at_once, sync, temporary_name, user_path, writing, written_whole
from heliosweep.grid.regions import Cut, Part, Variable
from heliosweep.store.checks import sound
from heliosweep.store.encoding import Skeleton, numbers, slab_digest, slab_rows, slabs_of
from heliosweep.store.folder import DESCRIPTIONS, FORMATS, RESULTS, is_zarr
from heliosweep.store.read import Stored, open_stored, plain
from heliosweep.store.targets import target_file

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.config.blocks import Output
    from heliosweep.store.formats import Write

#: Attributes that the writer makes anew.
_MADE = {"_FillValue", "coordinates"}
#: Name of an exported file: not that of a result, for the folder holds one, and its manifest names it.
EXPORT = "export.nc"


def publish(
    slabs: Iterable[tuple[Part, Mapping[str, Any] | xr.Dataset]], skeleton: Skeleton, output: Output, folder: Path
) -> tuple[Path, dict[str, str]]:
    """Write the result of a study; it takes the place of one of either format.

    `slabs` are all slabs in the order of the file, with the values of their variables; `output` says format and
    compression. Returned are the path of the result and the SHA-256 of each slab, as `encoding.slab_digest` has it.
    Raises HeliosweepError where it cannot be written. What stood there before is left as it was then, as after any
    other error.
    """
    path, digests = folder / FORMATS[output.format], {}
    with _in_place_of_others(path) as temporary:
        with _writer(temporary, skeleton, output, path) as write:
            for slab, given in slabs:
                values = {name: numbers(np.asarray(given[name])) for name in skeleton.of_kind(slab.kind)}
                write(slab, values)
                digests[slab.name] = slab_digest(values)
        if len(digests) != sum(cut.slab_count for cut in skeleton.cuts.values()):
            raise ValueError(f"{len(digests)} slabs are not the whole result")
    return path, digests


@contextmanager
def _writer(path: Path, skeleton: Skeleton, output: Output, named: Path) -> Iterator[Write]:
    from heliosweep.store.formats import netcdf_file, zarr_group

    level = output.compression_level
    if output.format == "zarr":
        with zarr_group(path, skeleton, output.compression, level, named) as write:
            yield write
    else:
        with netcdf_file(path, skeleton, level if output.compression != "none" else 0, named) as write:
            yield write


@contextmanager
def _in_place_of_others(path: Path) -> Iterator[Path]:
    """Name to write a result under; it takes its place when it is complete, and those of others are removed."""
    temporary = temporary_name(path)
    try:
        yield temporary
        with writing(path):
            for place in (*temporary.rglob("*"), temporary):
                sync(place)
            for name in DESCRIPTIONS:
                path.with_name(name).unlink(missing_ok=True)
            if temporary.is_dir():  # which replaces nothing
                remove_at_once(path)
            temporary.replace(path)
            for other in RESULTS:
                if other != path.name:
                    remove_at_once(path.with_name(other))
            sync(path.parent)
    finally:
        discard(temporary)


def export(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str] | None = None,
    *,
    compression: Literal["none", "zlib"] = "none",
    level: int = 1,
    force: bool = False,
) -> Path:
    """Write a Zarr result, or that of a folder, as NetCDF, slab by slab; return the file.

    It is ``export.nc`` beside the Zarr group where no `target` is named, appears whole or not at all, and replaces
    another one with `force` only. Compressed are time series, as in a study's ``output:`` block. The bytes are those of
    a run of the same study with ``format: netcdf`` and this compression.

    Raises StudyError where there is no Zarr result, or the target exists, and HeliosweepError where the result is
    damaged, or is not what its manifest tells of, or the file cannot be written.
    """
    place = user_path(source)
    if target is not None:
        target_file(target, force, endings=(".nc", ".csv", ".xlsx"))
    if place.is_dir() and (place / FORMATS["zarr"]).is_dir():
        place = place / FORMATS["zarr"]
    if not is_zarr(place):
        raise StudyError(
            Problem("is no Zarr result, nor a folder with one: its NetCDF file is there already", file=str(source))
        )
    file = target_file(place.with_name(EXPORT) if target is None else target, force, endings=(".nc",))
    sound(place, as_written=True)
    from heliosweep.store.formats import netcdf_file

    with open_stored(place) as stored:
        skeleton = _skeleton(stored)
        level = level if compression != "none" else 0
        with written_whole(file) as temporary, netcdf_file(temporary, skeleton, level, file) as write:
            for slab in slabs_of(stored.record["slabs"] or slab_rows(skeleton.cuts), stored.sizes):
                write(slab, stored.slab(slab))
    return file


def _skeleton(stored: Stored) -> Skeleton:
    """Everything of a Zarr result but its values, undecoded: what is stored is written."""
    import xarray as xr

    types, record = stored.record["types"], stored.record

    def typed(name: str, attributes: Mapping[str, Any]) -> dict[str, Any]:
        """Attributes as numbers of the types that they were given with."""
        known = types.get(name, {})
        return {key: np.asarray(value, known[key]) if key in known else value for key, value in attributes.items()}

    def own(name: str) -> dict[str, Any]:
        attributes = plain(stored.variables[name].attrs)
        return typed(name, {key: value for key, value in attributes.items() if key not in _MADE})

    try:
        coordinates = xr.Dataset(
            coords={
                name: xr.Variable(
                    stored.variables[name].dims, stored.read(name, stored.index(name, {})), own(name), fastpath=True
                )
                for name in stored.coordinates
            }
        )
        dtypes = {name: stored.variables[name].dtype.newbyteorder("=") for name in stored.data}
        variables = {name: Variable(stored.dims(name), own(name), dtypes[name]) for name in stored.data}
        attributes = typed("", stored.attributes)
    except (TypeError, ValueError) as error:
        raise HeliosweepError(f"the attributes are damaged: {error}") from None
    # Another program wrote the metadata anew, and lost our record: the same values, perhaps in another order.
    kinds = {one.kind: one for one in variables.values()}
    cuts: dict[str, Cut] = {kind: _rows_of(stored, kinds[kind].dims) for kind in sorted(kinds)}
    return Skeleton(stored.sizes, coordinates, variables, attributes, dict(record["storage"]), cuts)


def _rows_of(stored: Stored, dims: tuple[str, ...]) -> Cut:
    """Slabs of one row along the first dimension."""
    sizes = {dim: stored.sizes[dim] for dim in dims[:1]}
    return Cut(sizes, dict.fromkeys(sizes, 1), dict.fromkeys(sizes, 1))
