"""Exported Zarr results: the bytes of the NetCDF file that the run would have left."""

from __future__ import annotations

import json
import tracemalloc

import numpy as np
import pytest
import xarray as xr

from heliosweep.errors import HeliosweepError, StudyError
from heliosweep.grid.regions import Cut, Part, Variable
from heliosweep.store.encoding import Skeleton
from heliosweep.store.read import content_digest, file_digest, locate
from heliosweep.store.result import export, publish
from tests.store.samples import ZARR, write_netcdf, write_zarr


@pytest.mark.parametrize("level", [0, 1, 4])
@pytest.mark.parametrize("stored", ["none", "zstd"])
def test_the_bytes_of_a_netcdf_run(tmp_path, level, stored):
    expected = write_netcdf(tmp_path / "expected.nc", level)
    source = write_zarr(tmp_path / "result.zarr", stored)
    done = export(tmp_path, compression="zlib" if level else "none", level=level)
    assert done == tmp_path / "export.nc"
    assert locate(tmp_path) == source
    assert file_digest(done) == file_digest(expected)
    assert content_digest(source) == content_digest(expected)


def test_nothing_is_overwritten_unless_forced(tmp_path):
    source = write_zarr(tmp_path / "result.zarr")
    target = tmp_path / "mine.nc"
    target.write_text("mine")
    with pytest.raises(StudyError, match="exists already"):
        export(source, target)
    assert target.read_text() == "mine"
    assert export(source, target, force=True) == target
    assert content_digest(target) == content_digest(source)


@pytest.mark.parametrize("name", ["result.nc", "empty", "missing"])
def test_only_zarr_results_are_exported(tmp_path, name):
    write_netcdf(tmp_path / "result.nc")
    (tmp_path / "empty").mkdir()
    with pytest.raises(StudyError, match="is no Zarr result"):
        export(tmp_path / name, tmp_path / "out.nc")
    assert not (tmp_path / "out.nc").exists()


def test_a_damaged_result_leaves_nothing(tmp_path):
    source = write_zarr(tmp_path / "result.zarr", "zstd")
    (source / "power" / "1.1.0").write_bytes(b"no zstd")
    with pytest.raises(HeliosweepError, match="power cannot be read"):
        export(source)
    assert [path.name for path in tmp_path.iterdir()] == ["result.zarr"]


def test_without_our_record_the_same_values(tmp_path):
    source = write_zarr(tmp_path / "result.zarr")
    metadata = source / ".zmetadata"
    content = json.loads(metadata.read_text())
    del content["heliosweep"]
    metadata.write_text(json.dumps(content))
    with xr.open_dataset(export(source)) as data, xr.open_dataset(write_netcdf(tmp_path / "expected.nc")) as expected:
        xr.testing.assert_identical(data.load(), expected.load())


def test_memory_is_that_of_some_slabs(tmp_path, monkeypatch):
    sizes = {"latitude": 40, "time": 1000, "heliostat": 250}
    series = {"power": Variable(("latitude", "time", "heliostat"), {"units": "1"})}
    cut = Cut(sizes, {**sizes, "latitude": 1}, sizes)
    slabs = [Part(f"series-{number:05}", "series", region) for number, region in enumerate(cut.slabs())]
    given = ((slab, {"power": np.full((1, 1000, 250), 1.0)}) for slab in slabs)
    publish(given, Skeleton(sizes, xr.Dataset(), series, {}, {}, {"series": cut}), ZARR, tmp_path)
    monkeypatch.setattr("heliosweep.store.read.PIECE", 2**20)
    tracemalloc.start()
    try:
        export(tmp_path)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 8 * 2**20 < 40 * 1000 * 250 * 8


def test_only_files_of_netcdf_are_written(tmp_path):
    write_zarr(tmp_path / "result.zarr")
    (tmp_path / "manifest.json").write_text("{}")
    with pytest.raises(StudyError, match=r"manifest\.json: must end in \.nc"):
        export(tmp_path, tmp_path / "manifest.json", force=True)
    assert (tmp_path / "manifest.json").read_text() == "{}"
