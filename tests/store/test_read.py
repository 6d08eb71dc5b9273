"""Results are read in the order of their values, alike from both formats, by one thread at a time."""

from __future__ import annotations

import json
import math
import pickle
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from xarray.backends.file_manager import FILE_CACHE
from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK

import heliosweep
from heliosweep.errors import HeliosweepError
from heliosweep.layouts.ground import read_heights
from heliosweep.netcdf import LIBRARY_LOCK
from heliosweep.store import read as module
from heliosweep.store.encoding import slab_rows, slabs_of
from heliosweep.store.read import Stored, content_digest, locate, open_result, open_stored, result_digest
from tests.store.samples import (
    CUTS,
    NETCDF,
    SIZES,
    SKELETON,
    SLABS,
    VARIABLES,
    ZARR,
    write,
    write_folder,
    write_netcdf,
    write_zarr,
)

ROOM = 40


@given(
    st.lists(st.tuples(st.integers(1, 25), st.integers(1, 25)), min_size=0, max_size=4).filter(
        lambda axes: math.prod(size for size, _ in axes) < 20_000
    )
)
def test_pieces_follow_the_order_of_values_and_are_small(axes):
    shape, storage = tuple(size for size, _ in axes), tuple(min(axis) for axis in axes)
    values = np.arange(math.prod(shape)).reshape(shape)
    dims = tuple("abcd"[: len(shape)])
    variable = xr.Variable(dims, values, encoding={"chunks": storage})
    stored = Stored(Path(), {"x": variable}, dict(zip(dims, shape, strict=True)), {}, {}, lambda: None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "PIECE", 8 * ROOM)
        pieces = [stored.read("x", index) for index in stored.pieces("x")]
    assert np.array_equal(np.concatenate([piece.ravel() for piece in pieces]), values.ravel())
    assert max(piece.size for piece in pieces) <= 4 * ROOM * max([1, *storage])


def test_slabs_are_those_of_the_run():
    rows = json.loads(json.dumps(slab_rows(CUTS), sort_keys=True))
    assert list(slabs_of(rows, SIZES)) == SLABS


@pytest.mark.parametrize(
    "rows",
    [
        {"points": [["u", 1, 1]]}, {"points": 3}, {"points": [["latitude", 3, 0]]}, {"series": None},
        {"points": [["latitude", 10**12, 1]]}, {"points": [["latitude", 3]]}, {"points": [["latitude", 3, "x"]]}, [],
    ],
)  # fmt: skip
def test_a_cut_that_does_not_fit(rows):
    with pytest.raises(HeliosweepError, match="does not fit the result"):
        list(slabs_of(rows, SIZES))


@pytest.mark.parametrize("result", ["result.nc", "result.zarr"])
def test_data_and_coordinates_are_told_apart(tmp_path, result):
    write(tmp_path, NETCDF if result == "result.nc" else ZARR)
    with open_stored(tmp_path) as stored:
        assert stored.path == locate(tmp_path)
        assert list(stored.sizes.items()) == list(SIZES.items())
        assert stored.data == list(VARIABLES)
        assert stored.of_kind("series") == ["power"]
        assert sorted([*stored.coordinates, *stored.data]) == sorted(stored.variables)


def test_of_two_results_the_one_of_the_manifest(tmp_path, small):
    folder = write_folder(tmp_path / "out", small(), "result.zarr")
    write_netcdf(folder / "result.nc")
    assert locate(folder) == folder / "result.zarr"
    for text in ("", "[" * 10**5, "{}"):
        (folder / "manifest.json").write_text(text)
        assert locate(folder) == folder / "result.nc"


@pytest.mark.parametrize("compression", ["none", "zlib", "zstd"])
def test_a_group_reads_like_the_netcdf_file(tmp_path, compression):
    path = write_zarr(tmp_path / "result.zarr", compression)
    with (
        open_result(write_netcdf(tmp_path / "result.nc")) as netcdf,
        xr.open_zarr(path) as plain,
        open_result(path) as ours,
    ):
        xr.testing.assert_identical(netcdf.load(), ours.load())
        xr.testing.assert_identical(netcdf, plain.load())
        assert list(ours.data_vars) == list(netcdf.data_vars)
        assert {name: ours[name].dtype for name in ours.variables} == {
            name: netcdf[name].dtype for name in netcdf.variables
        }
        assert ours["flag"].dtype == np.int8
        assert ours["noon"].dtype.kind == "M"


@pytest.mark.filterwarnings("error")
def test_a_part_is_written_again_in_silence(tmp_path):
    with open_result(write_netcdf(tmp_path / "result.nc")) as result:
        result.isel(heliostat=slice(0, 3)).to_netcdf(tmp_path / "part.nc")
        with xr.open_dataset(tmp_path / "part.nc") as part:
            assert part["label"].to_numpy().tolist() == [*"abc"]
            assert part["model"].item() == "rotary"


def test_names_may_be_stored_compressed(tmp_path):
    """As by tools that pack files again."""
    path = tmp_path / "packed.nc"
    with xr.open_dataset(write_netcdf(tmp_path / "result.nc")) as data:
        data.to_netcdf(path, encoding={"label": {"dtype": "S1", "zlib": True, "chunksizes": (2, 4)}})
    with netCDF4.Dataset(path) as file:
        assert file["label"].chunking() == [2, 4]
    with open_stored(path) as stored:
        found = [text for index in stored.pieces("label") for text in stored.read("label", index)]
        assert found == SKELETON.coordinates["label"].to_numpy().tolist()


@pytest.mark.parametrize("label", ["label", "name"])  # by names, heliostats can be selected
def test_a_closed_result_is_closed(tmp_path, label):
    coordinates = SKELETON.coordinates.rename({"label": label})
    path = write(tmp_path / "out", skeleton=replace(SKELETON, coordinates=coordinates))
    with heliosweep.open_result(path) as result:
        assert any(str(path) in str(key) for key in FILE_CACHE)
        assert (label in result.xindexes) == (label == "name")
    assert not any(str(path) in str(key) for key in FILE_CACHE)


def test_no_pickle_is_read(tmp_path):
    path = write_zarr(tmp_path / "result.zarr")
    metadata = path / ".zmetadata"
    content = json.loads(metadata.read_text())
    content["metadata"]["label/.zarray"]["filters"] = [{"id": "pickle", "protocol": 5}]
    metadata.write_text(json.dumps(content))
    for opener in (open_result, content_digest):
        with pytest.raises(HeliosweepError, match="pickle"):
            opener(path)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"metadata": {"a/.zarray": {}}}', "[" * 100_000])
def test_damaged_metadata_are_told(tmp_path, text):
    path = write_zarr(tmp_path / "result.zarr")
    (path / ".zmetadata").write_text(text)
    with pytest.raises(HeliosweepError, match="damaged"):
        open_result(path)


def test_the_digest_of_a_group_sees_names_and_bytes(tmp_path):
    path = write_zarr(tmp_path / "a.zarr")
    before = result_digest(path)
    chunk = path / "mean" / "0.0"
    chunk.rename(path / "mean" / "0.1")
    assert result_digest(path) != before
    (path / "mean" / "0.1").rename(chunk)
    assert result_digest(path) == before
    chunk.write_bytes(chunk.read_bytes()[:-1] + b"\x01")
    assert result_digest(path) != before


def test_the_digest_of_the_content_sees_values_names_and_attributes_but_not_storage(tmp_path):
    expected = content_digest(write_netcdf(tmp_path / "a.nc"))
    assert content_digest(write_netcdf(tmp_path / "zlib.nc", 4)) == expected
    for compression in ("none", "zlib", "zstd"):
        assert content_digest(write_zarr(tmp_path / f"{compression}.zarr", compression)) == expected
    assert content_digest(write_netcdf(tmp_path / "other.nc", title="other")) != expected
    for edit in (
        lambda file: file["power"].__setitem__((1, 3, 4), 0.5),
        lambda file: file["power"].setncattr("units", "k"),
        lambda file: file.renameVariable("mean", "average"),
    ):
        path = write_netcdf(tmp_path / "edited.nc")
        with netCDF4.Dataset(path, "r+") as file:
            edit(file)
        assert content_digest(path) != expected


def from_another_thread() -> bool:
    got = []

    def attempt() -> None:
        got.append(LIBRARY_LOCK.acquire(blocking=False))
        if got[0]:
            LIBRARY_LOCK.release()

    thread = threading.Thread(target=attempt)
    thread.start()
    thread.join()
    return got[0]


def test_one_thread_at_a_time_as_often_as_it_likes():
    with LIBRARY_LOCK:
        with LIBRARY_LOCK:
            assert not from_another_thread()
        assert not from_another_thread()
        assert not NETCDF4_PYTHON_LOCK.acquire(blocking=False)
    assert from_another_thread()


def test_waits_for_xarray():
    with NETCDF4_PYTHON_LOCK:
        assert not from_another_thread()
    assert from_another_thread()


def test_files_are_opened_under_it(tmp_path, monkeypatch):
    found = []

    def opened(*given, **how):
        found.append(from_another_thread())
        return plain(*given, **how)

    plain, path = xr.open_dataset, tmp_path / "heights.nc"
    xr.Dataset({"z": (("x", "y"), np.zeros((2, 2)))}, {"x": [0.0, 9], "y": [0.0, 9]}).to_netcdf(path)
    monkeypatch.setattr(xr, "open_dataset", opened)
    open_result(write_netcdf(tmp_path / "result.nc")).close()
    read_heights(path)
    assert found == [False, False]


def test_an_interruption_while_waiting_leaves_it_free(monkeypatch):
    class Interrupted:
        def acquire(self, blocking: bool) -> bool:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("heliosweep.netcdf.NETCDF4_PYTHON_LOCK", Interrupted())
        with pytest.raises(KeyboardInterrupt):
            LIBRARY_LOCK.acquire()
    assert from_another_thread()


def test_pickled_it_is_the_lock_of_the_process():
    assert pickle.loads(pickle.dumps(LIBRARY_LOCK)) is LIBRARY_LOCK


def test_a_file_may_be_open_as_often_as_one_likes(tmp_path):
    """With strings in it, HDF5 reads what it has freed when the first of two that are open is closed."""
    path = write_netcdf(tmp_path / "result.nc")
    program = """
import random, sys
import xarray as xr
draw, opened = random.Random(1), []
for _ in range(200):
    if opened and draw.random() < 0.5:
        opened.pop(draw.randrange(len(opened))).close()
    else:
        opened.append(xr.open_dataset(sys.argv[1]))
    if opened:
        draw.choice(opened).copy().label.load()
"""
    subprocess.run([sys.executable, "-c", program, str(path)], check=True)
