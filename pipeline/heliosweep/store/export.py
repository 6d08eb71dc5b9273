"""From a Zarr result to the NetCDF file that the study would have left with ``format: netcdf``, part by part."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr

from heliosweep.errors import FORCE, HeliosweepError, Problem, StudyError
from heliosweep.store import raw as raw_results
from heliosweep.store.encoding import Variable
from heliosweep.store.netcdf import ResultWriter
from heliosweep.store.sound import sound, with_remedy

#: Attributes that the writer makes anew.
_MADE = {"_FillValue", "coordinates"}
#: Name of the file: not that of a result, for the folder holds one, and its manifest names it.
DEFAULT = "export.nc"


def export(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str] | None = None,
    *,
    compression: Literal["none", "zlib"] = "none",
    level: int = 1,
    force: bool = False,
) -> Path:
    """Write a Zarr result as NetCDF, part by part.

    Parameters
    ----------
    source : path
        Result folder or its ``result.zarr``.
    target : path, optional
        NetCDF file to write; ``export.nc`` beside the Zarr group where left out. Appears whole or not at all.
    compression : {"none", "zlib"}
        Of time series, as in a study's ``output:`` block.
    level : int
        Of the compression.
    force : bool
        Whether an existing file is replaced.

    Returns
    -------
    pathlib.Path
        The file. Its bytes are those of a run of the same study with ``format: netcdf`` and this compression.

    Raises
    ------
    StudyError
        There is no Zarr result, or the target exists.
    HeliosweepError
        The result is damaged, or is not what its manifest tells of, or the file cannot be written.
    """
    place = Path(source)
    if place.is_dir() and (place / "result.zarr").is_dir():
        place = place / "result.zarr"
    if not raw_results.is_zarr(place):
        raise StudyError(Problem("is no Zarr result, nor a folder with one; nothing to export", file=str(source)))
    file = Path(target) if target is not None else place.with_name(DEFAULT)
    if file.is_dir():
        raise StudyError(Problem("is a folder; name a file", file=str(file)))
    if file.suffix != ".nc":
        raise StudyError(Problem("must end in .nc, as NetCDF files do", file=str(file)))
    if file.exists() and not force:
        raise StudyError(Problem(f"exists already; {FORCE} replaces it", file=str(file)))
    if not file.parent.is_dir():
        raise StudyError(Problem("cannot be written: its folder does not exist", file=str(file)))
    sound(place, as_written=True)
    with with_remedy(place), raw_results.open_raw(place) as raw:
        cut = {kind: dict(lengths) for kind, lengths in raw.record.get("cut", {}).items()}
        storage = cut.get("storage", {}) if compression != "none" and level else {}
        variables = {
            name: Variable(
                (item := raw.variables[name]).dims,
                _attributes(raw, name),
                item.dtype,
                storage if "time" in item.dims else {},
            )
            for name in raw.data
        }
        attributes = _typed(raw.attributes, raw.record["types"].get("", {}))
        with ResultWriter(file, raw.sizes, _coordinates(raw), variables, attributes, level) as writer:
            for names, region in _regions(raw, cut):
                writer.write({name: raw.read(name, raw.index(name, region)) for name in names}, region)
    return file


def _regions(raw: raw_results.Raw, cut: Mapping[str, Any]) -> Iterator[tuple[list[str], Mapping[str, slice]]]:
    """In the order in which a run writes them, for HDF5 lays storage out in the order of writing."""
    if cut:
        for part in raw_results.stored_parts(cut, raw.sizes):
            yield raw.of_kind(part.kind), part.region
        return
    # Another program wrote the metadata anew, and lost our record: the same values, perhaps in another order.
    for kind in ("points", "series"):
        for name in raw.of_kind(kind):
            for index in raw.pieces(name):
                yield [name], dict(zip(raw.variables[name].dims, index, strict=True))


def _coordinates(raw: raw_results.Raw) -> xr.Dataset:
    """Coordinates undecoded: what is stored is written."""
    return xr.Dataset(
        coords={
            name: xr.Variable(
                raw.variables[name].dims, raw.read(name, raw.index(name, {})), _attributes(raw, name), fastpath=True
            )
            for name in raw.coordinates
        }
    )


def _attributes(raw: raw_results.Raw, name: str) -> dict[str, Any]:
    attributes = {key: value for key, value in raw.variables[name].attributes.items() if key not in _MADE}
    return _typed(attributes, raw.record["types"].get(name, {}))


def _typed(attributes: Mapping[str, Any], types: Mapping[str, str]) -> dict[str, Any]:
    """Attributes as numbers of the types that they were given with."""
    try:
        return {name: np.asarray(value, types[name]) if name in types else value for name, value in attributes.items()}
    except (TypeError, ValueError) as error:
        raise HeliosweepError(f"the attributes are damaged: {error}") from None
