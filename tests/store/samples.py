"""A small result in both formats, as a run leaves it."""

from __future__ import annotations

import os
import tempfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.config.blocks import Output
from heliosweep.config.study import Study
from heliosweep.grid.regions import Cut, Part, Variable, parts_of, slabs
from heliosweep.store.encoding import Skeleton, slab_digest, slab_rows
from heliosweep.store.manifest import write_manifest
from heliosweep.store.result import publish

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
    "noon": Variable(("latitude",), {"long_name": "noon"}, np.dtype("datetime64[ns]"), finished=True),
}
VALUES: dict[str, np.ndarray] = {
    "mean": np.linspace(0, 1, 21).reshape(3, 7),
    "power": np.linspace(0, 1, 210).reshape(3, 10, 7),
    "flag": np.array([0, 1, 1], dtype=np.int8),
    "noon": np.array(["2017-07-14T02:40", "NaT", "2020-09-13T12:26:40"], dtype="datetime64[ns]"),
}
VALUES["mean"][1] = np.nan
ATTRIBUTES = {"title": "test", "study_id": "0123456789ab", "study": '{"a": 1, "b": {"c": 2}}', "version": np.int32(1)}
CUTS = {
    "points": Cut({"latitude": 3}, {"latitude": 2}, {"latitude": 1}),
    "series": Cut(SIZES, {"latitude": 1, "time": 4, "heliostat": 4}, {"latitude": 1, "time": 4, "heliostat": 2}),
}
SKELETON = Skeleton(SIZES, COORDINATES, VARIABLES, ATTRIBUTES, {"time": 2, "heliostat": 4}, CUTS)
SLABS, PARTS = list(slabs(CUTS)), list(parts_of(CUTS))
#: Of a plan, what a finished result is held against.
PLAN: Any = SimpleNamespace(variables=VARIABLES, cuts=CUTS)
NETCDF, ZARR = Output(), Output.model_validate({"format": "zarr"})


def values(part: Part) -> dict[str, np.ndarray]:
    return {
        name: VALUES[name][tuple(part.region.get(dim, slice(None)) for dim in item.dims)]
        for name, item in VARIABLES.items()
        if item.kind == part.kind
    }


def digests() -> dict[str, str]:
    return {slab.name: slab_digest(values(slab)) for slab in SLABS}


def write(folder: Path, output: Output = NETCDF, skeleton: Skeleton = SKELETON, **attributes: Any) -> Path:
    """The result in a folder, which is made."""
    folder.mkdir(exist_ok=True)
    skeleton = replace(skeleton, attributes={**skeleton.attributes, **attributes})
    return publish(((slab, values(slab)) for slab in slabs(skeleton.cuts)), skeleton, output, folder)[0]


def compressed(output: Output, compression: str, level: int = 1) -> Output:
    return output.model_copy(update={"compression": compression, "compression_level": level})


def write_netcdf(path: Path, level: int = 0, **attributes: Any) -> Path:
    """The result as a NetCDF file of any name."""
    return _alone(path, compressed(NETCDF, "zlib" if level else "none", level or 1), **attributes)


def write_zarr(path: Path, compression: str = "none", **attributes: Any) -> Path:
    """The result as a Zarr group of any name."""
    return _alone(path, compressed(ZARR, compression), **attributes)


def _alone(path: Path, output: Output, **attributes: Any) -> Path:
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        return write(Path(folder), output, **attributes).rename(path)


def write_folder(folder: Path, study: Study, result: str = "result.nc", compression: str = "none") -> Path:
    """Leave what a run leaves, but for the report."""
    path = write(folder, compressed(NETCDF if result == "result.nc" else ZARR, compression), study_id=study.study_id)
    slabs = {"cut": slab_rows(CUTS), "digests": digests(), "variables": list(VARIABLES)}
    identity = {"study_id": study.study_id, "study": study.canonical(), "code": {}, "output": {}, "attributes": {}}
    write_manifest(folder, study, path, {"study_id": study.study_id, "slabs": slabs, "identity": identity})
    return folder


def flip(path: Path, offset: int = -1, bit: int = 3) -> None:
    """Change one bit of a file."""
    content = bytearray(path.read_bytes())
    content[offset] ^= 1 << bit
    path.write_bytes(content)


def truncate(path: Path) -> None:
    """Cut a file in half."""
    os.truncate(path, path.stat().st_size // 2)
