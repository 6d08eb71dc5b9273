"""Zarr results: the same bytes in any order of writing, and the same data set as the NetCDF file."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr

from heliosweep.errors import HeliosweepError
from heliosweep.store import zarr_result
from heliosweep.store.digest import part_digest, tree_digest
from tests.store.samples import write_netcdf
from tests.store.samples import write_zarr as write


@pytest.mark.parametrize("compression", ["none", "zlib", "zstd"])
def test_same_bytes_in_any_order_of_writing(tmp_path, compression):
    first, second = (write(tmp_path / f"{i}.zarr", compression, backwards=bool(i)) for i in range(2))
    assert tree_digest(first) == tree_digest(second)


def test_the_tree_digest_sees_names_and_bytes(tmp_path):
    path = write(tmp_path / "a.zarr")
    before = tree_digest(path)
    chunk = path / "mean" / "0.0"
    chunk.rename(path / "mean" / "0.1")
    assert tree_digest(path) != before
    (path / "mean" / "0.1").rename(chunk)
    assert tree_digest(path) == before
    chunk.write_bytes(chunk.read_bytes()[:-1] + b"\x01")
    assert tree_digest(path) != before


@pytest.mark.parametrize("compression", ["none", "zlib", "zstd"])
def test_reads_like_the_netcdf_file(tmp_path, compression):
    path = write(tmp_path / "result.zarr", compression)
    with (
        xr.open_dataset(write_netcdf(tmp_path / "result.nc")) as netcdf,
        xr.open_zarr(path) as plain,
        zarr_result.open_zarr(path) as ours,
    ):
        xr.testing.assert_identical(netcdf.load(), ours.load())
        xr.testing.assert_identical(netcdf, plain.load())
        assert list(ours.data_vars) == list(netcdf.data_vars)
        assert {name: ours[name].dtype for name in ours.variables} == {
            name: netcdf[name].dtype for name in netcdf.variables
        }
        assert ours["flag"].dtype == np.int8
        assert ours["noon"].dtype.kind == "M"


def test_every_chunk_is_there_also_those_of_nothing_but_nan(tmp_path):
    path = write(tmp_path / "result.zarr")
    assert {file.name for file in (path / "mean").iterdir()} == {".zarray", ".zattrs", "0.0", "1.0"}
    (path / "power" / "1.2.0").unlink()
    with pytest.raises(HeliosweepError, match=r"1 chunks are missing: power/1\.2\.0"):
        zarr_result.finish(path)
    again = zarr_result.arrays(path)
    again["power"][1:2, 8:10] = np.nan
    zarr_result.finish(path)


def test_what_zarr_cannot_hold_is_beside_the_metadata(tmp_path):
    record = zarr_result.read_metadata(write(tmp_path / "result.zarr"))["heliosweep"]
    assert record["sizes"] == [["latitude", 3], ["time", 10], ["heliostat", 7]]
    assert record["types"] == {"flag": {"flag_values": "|i1"}, "": {"version": "<i4"}}
    assert record["cut"]["series"] == [["latitude", 1], ["time", 4], ["heliostat", 4]]


def test_no_pickle_is_read(tmp_path):
    path = write(tmp_path / "result.zarr")
    metadata = path / ".zmetadata"
    content = json.loads(metadata.read_text())
    content["metadata"]["label/.zarray"]["filters"] = [{"id": "pickle", "protocol": 5}]
    metadata.write_text(json.dumps(content))
    for opener in (zarr_result.open_zarr, zarr_result.arrays):
        with pytest.raises(HeliosweepError, match="pickle"):
            opener(path)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"metadata": {"a/.zarray": {}}}', "[" * 100_000])
def test_damaged_metadata_are_told(tmp_path, text):
    path = write(tmp_path / "result.zarr")
    (path / ".zmetadata").write_text(text)
    with pytest.raises(HeliosweepError, match="damaged"):
        zarr_result.open_zarr(path)
    (path / ".zmetadata").unlink()
    with pytest.raises(HeliosweepError, match="no Zarr result"):
        zarr_result.open_zarr(path)


def test_a_part_has_one_digest_as_computed_and_as_stored():
    instants = np.array(["2021-06-21T12:00", "NaT"], dtype="datetime64[ns]")
    seconds = np.array([1624276800.0, np.nan])
    assert part_digest({"b": instants, "a": np.arange(3.0)}) == part_digest({"a": np.arange(3.0), "b": seconds})
    assert part_digest({"a": np.arange(3.0)}) != part_digest({"b": np.arange(3.0)})
    table = np.arange(12.0).reshape(3, 4)
    assert part_digest({"a": table.T}) == part_digest({"a": np.ascontiguousarray(table.T).astype(">f8")})
