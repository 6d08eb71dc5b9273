"""A small result in both formats, as a run would write it, part by part."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.config.identity import resolved_yaml
from heliosweep.config.study import Study
from heliosweep.grid.slabs import Part, slabs
from heliosweep.store import zarr_result
from heliosweep.store.digest import content_digest, file_digest, part_digest, tree, tree_digest
from heliosweep.store.encoding import Variable
from heliosweep.store.netcdf import ResultWriter

SIZES = {"latitude": 3, "time": 10, "heliostat": 7}
COORDINATES = xr.Dataset(
    coords={
        "latitude": ("latitude", [0.0, 30.0, 45.0], {"units": "degrees_north"}),
        "time": ("time", np.datetime64("2021-06-21T00:00", "ns") + np.arange(10) * np.timedelta64(1, "h")),
        "ring": ("heliostat", np.arange(7)),
        "label": ("heliostat", np.array([*"abcdé", "", "none"], dtype=object), {"long_name": "name"}),
        "model": "rotary",
        "height": 95.0,
    }
)
VARIABLES = {
    "mean": Variable(("latitude", "heliostat"), {"units": "1", "valid_range": np.array([0.0, 1.0])}),
    "power": Variable(("latitude", "time", "heliostat"), {"units": "W"}),
    "flag": Variable(("latitude",), {"flag_values": np.array([0, 1], dtype=np.int8)}, np.dtype(np.int8)),
    "noon": Variable(("latitude",), {"long_name": "noon"}, np.dtype("datetime64[ns]")),
}
VALUES: dict[str, np.ndarray] = {
    "mean": np.linspace(0, 1, 21).reshape(3, 7),
    "power": np.linspace(0, 1, 210).reshape(3, 10, 7),
    "flag": np.array([0, 1, 1], dtype=np.int8),
    "noon": np.array([1.5e9, np.nan, 1.6e9]),
}
VALUES["mean"][1] = np.nan
ATTRIBUTES = {"title": "test", "study_id": "0123456789ab", "study": '{"a": 1, "b": {"c": 2}}', "version": np.int32(1)}
CUT = {
    "points": {"latitude": 2},
    "series": {"latitude": 1, "time": 4, "heliostat": 4},
    "storage": {"time": 2, "heliostat": 4},
}


def parts() -> Iterator[Part]:
    for kind, lengths in itertools.islice(CUT.items(), 2):
        for number, region in enumerate(slabs({dim: SIZES[dim] for dim in lengths}, lengths)):
            yield Part(f"{kind}-{number:05}", kind, region)


def values(part: Part) -> dict[str, np.ndarray]:
    return {
        name: VALUES[name][tuple(part.region.get(dim, slice(None)) for dim in item.dims)]
        for name, item in VARIABLES.items()
        if ("time" in item.dims) == (part.kind == "series")
    }


def digests() -> dict[str, str]:
    return {part.name: part_digest(values(part)) for part in parts()}


def write_netcdf(path: Path, level: int = 0, attributes: Mapping[str, Any] = ATTRIBUTES) -> Path:
    storage = CUT["storage"] if level else {}
    variables = {
        name: Variable(item.dims, item.attrs, item.dtype, storage if "time" in item.dims else {})
        for name, item in VARIABLES.items()
    }
    with ResultWriter(path, SIZES, COORDINATES, variables, attributes, level) as writer:
        for part in parts():
            writer.write(values(part), part.region)
    return path


def write_zarr(
    path: Path,
    compression: zarr_result.Compression = "none",
    *,
    backwards: bool = False,
    attributes: Mapping[str, Any] = ATTRIBUTES,
) -> Path:
    chunks = {name: CUT["series" if "time" in item.dims else "points"] for name, item in VARIABLES.items()}
    arrays = zarr_result.create(path, SIZES, COORDINATES, VARIABLES, attributes, chunks, compression, 1, CUT)
    for part in reversed([*parts()]) if backwards else parts():
        for name, array in values(part).items():
            index = tuple(part.region.get(dim, slice(None)) for dim in VARIABLES[name].dims)
            arrays[name][index] = array
    zarr_result.finish(path)
    return path


def write_folder(folder: Path, study: Study, result: str = "result.nc", compression: str = "none") -> Path:
    """Leave what a run leaves, but for the report; `compression` is zlib for a NetCDF file that is compressed."""
    folder.mkdir()
    attributes = {**ATTRIBUTES, "study_id": study.study_id}
    if result == "result.nc":
        path = write_netcdf(folder / result, int(compression == "zlib"), attributes)
    else:
        path = write_zarr(folder / result, compression, attributes=attributes)  # type: ignore[arg-type]
    (folder / "study.resolved.yaml").write_text(resolved_yaml(study, relative_to=folder))
    said = {
        "study_id": study.study_id,
        "result": {
            "file": result,
            "bytes": sum(tree(path).values()) if path.is_dir() else path.stat().st_size,
            "sha256": tree_digest(path) if path.is_dir() else file_digest(path),
            "content_digest": content_digest(path),
        },
        "parts": {"cut": CUT, "digests": digests()},
    }
    (folder / "manifest.json").write_text(json.dumps(said, sort_keys=True))
    return folder
