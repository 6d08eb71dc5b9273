"""The result: whole or not at all, in the place of one of either format, the same bytes whatever the cut."""

from __future__ import annotations

import errno
import hashlib
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from heliosweep.config.blocks import Output
from heliosweep.errors import HeliosweepError
from heliosweep.files import remove_at_once
from heliosweep.grid.regions import Cut, Part
from heliosweep.store import formats
from heliosweep.store.encoding import slab_digest
from heliosweep.store.result import publish
from tests.store.samples import (
    CUTS,
    NETCDF,
    SKELETON,
    SLABS,
    VALUES,
    VARIABLES,
    ZARR,
    compressed,
    digests,
    values,
    write,
)

OUTPUTS = {
    "netcdf": NETCDF,
    "netcdf-zlib": compressed(NETCDF, "zlib"),
    "zarr": ZARR,
    "zarr-zlib": compressed(ZARR, "zlib"),
    "zarr-zstd": compressed(ZARR, "zstd", 3),
}


@pytest.fixture(params=list(OUTPUTS))
def output(request) -> Output:
    return OUTPUTS[request.param]


def files(path: Path) -> dict[str, str]:
    """Digests of a file, or of all files in a folder."""
    found = [place for place in (path, *path.rglob("*")) if place.is_file()]
    return {str(place.relative_to(path)): hashlib.sha256(place.read_bytes()).hexdigest() for place in found}


def opened(path: Path) -> xr.Dataset:
    return xr.open_zarr(path, chunks=None) if path.is_dir() else xr.open_dataset(path)


def test_values_attributes_and_nothing_else(tmp_path, output):
    given = ((slab, xr.Dataset({n: xr.DataArray(a) for n, a in values(slab).items()})) for slab in SLABS)
    path, found = publish(given, SKELETON, output, tmp_path)
    assert found == digests()
    assert [place.name for place in tmp_path.iterdir()] == [path.name]
    with opened(path) as result:
        for name, array in VALUES.items():
            np.testing.assert_array_equal(result[name], array)
            assert result[name].dtype == array.dtype
        assert list(result.data_vars) == list(VARIABLES)
        assert set(result.coords) == set(SKELETON.coordinates.coords)
        np.testing.assert_array_equal(result["time"], SKELETON.coordinates["time"])
        assert result["label"].values.tolist() == [*"abcdé", "", "none"]
        assert result.attrs["title"] == "test"
    with opened(write(tmp_path / "other")) as netcdf_result, opened(path) as result:
        xr.testing.assert_identical(netcdf_result.load(), result.load().astype(netcdf_result.dtypes))


CUT_ALIKE = [
    {"points": {"latitude": 1}, "series": {"latitude": 1, "time": 4, "heliostat": 4}},
    {"points": {"latitude": 3}, "series": {"latitude": 1, "time": 2, "heliostat": 4}},
    {"points": {"latitude": 2}, "series": {"latitude": 3, "time": 10, "heliostat": 4}},
]


@pytest.mark.parametrize("lengths", CUT_ALIKE)
def test_a_netcdf_file_has_the_same_bytes_for_any_cut(tmp_path, lengths):
    """But that order of storage chunks follows the slabs, and those of all three follow one another in it."""
    cuts = {kind: Cut(CUTS[kind].sizes, slab, slab) for kind, slab in lengths.items()}
    skeleton = replace(SKELETON, cuts=cuts)
    assert files(write(tmp_path / "a")) == files(write(tmp_path / "b", skeleton=skeleton))


def test_a_digest_is_that_of_the_values_as_computed_and_as_stored():
    instants = np.array(["2021-06-21T12:00", "NaT"], dtype="datetime64[ns]")
    seconds = np.array([1624276800.0, np.nan])
    assert slab_digest({"b": instants, "a": np.arange(3.0)}) == slab_digest({"a": np.arange(3.0), "b": seconds})
    assert slab_digest({"a": np.arange(3.0)}) != slab_digest({"b": np.arange(3.0)})
    table = np.arange(12.0).reshape(3, 4)
    assert slab_digest({"a": table.T}) == slab_digest({"a": np.ascontiguousarray(table.T).astype(">f8")})


def test_every_chunk_of_a_group_is_there_also_those_of_nothing_but_nan(tmp_path):
    path = write(tmp_path / "out", ZARR)
    assert {file.name for file in (path / "mean").iterdir()} == {".zarray", ".zattrs", "0.0", "1.0"}
    assert len(list((path / "power").glob("[0-9]*"))) == 3 * 3 * 2


@pytest.mark.parametrize("first", ["netcdf", "zarr"])
@pytest.mark.parametrize("second", ["netcdf", "zarr"])
def test_one_result_takes_the_place_of_the_other(tmp_path, first, second):
    write(tmp_path, OUTPUTS[first])
    (tmp_path / "manifest.json").write_text("of the first")
    (tmp_path / "notes.txt").touch()
    path = write(tmp_path, OUTPUTS[second])
    assert {place.name for place in tmp_path.iterdir()} == {path.name, "notes.txt"}
    assert files(path) == files(write(tmp_path / "new", OUTPUTS[second]))


class Stop(BaseException):
    """An interruption."""


@pytest.mark.parametrize("error", [Stop(), HeliosweepError("damaged"), ValueError("wrong")])
@pytest.mark.parametrize(("earlier", "kind"), [("netcdf", "zarr-zstd"), ("zarr", "netcdf"), ("zarr", "zarr")])
def test_what_goes_wrong_leaves_nothing_and_keeps_what_was_there(tmp_path, kind, earlier, error):
    output = OUTPUTS[kind]
    before = files(write(tmp_path, OUTPUTS[earlier]))
    (tmp_path / "manifest.json").write_text("of the earlier one")

    def wrong() -> Iterator[tuple[Part, dict[str, np.ndarray]]]:
        for number, slab in enumerate(SLABS):
            if number == 3:
                raise error
            yield slab, values(slab)

    with pytest.raises(type(error)):
        publish(wrong(), SKELETON, output, tmp_path)
    with pytest.raises(ValueError, match="1 slabs are not the whole result"):
        publish([(slab, values(slab)) for slab in SLABS][:1], SKELETON, output, tmp_path)
    assert {place.name for place in tmp_path.iterdir()} == {
        "manifest.json",
        f"result.{'nc' if earlier == 'netcdf' else 'zarr'}",
    }
    assert files(next(tmp_path.glob("result.*"))) == before


def test_a_bad_definition_leaves_nothing(tmp_path, output):
    with pytest.raises(TypeError):
        write(tmp_path, output, bad=object())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("at", [0, 5, 20])
def test_a_full_disk_leaves_what_was_there(tmp_path, monkeypatch, at):
    before, count, fsync = files(write(tmp_path)), 0, os.fsync

    def full(descriptor: int) -> None:
        nonlocal count
        count += 1
        if count > at:
            raise OSError(errno.ENOSPC, "No space left on device")
        fsync(descriptor)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(HeliosweepError, match=r"result\.zarr: cannot be written: No space left on device"):
            write(tmp_path, ZARR)
    assert [place.name for place in tmp_path.iterdir()] == ["result.nc"]
    assert files(tmp_path / "result.nc") == before


@pytest.mark.parametrize(
    ("free", "cause"), [(4096, r"disk full \(4\.1 kB free\)"), (2**30, r"NetCDF: HDF error \(1\.1 GB free\)")]
)
def test_a_write_that_fails_in_the_library_says_why(tmp_path, monkeypatch, free, cause):
    def fail(*_: object) -> None:
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr(formats, "_write_chunks", fail)
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": free}))
    with pytest.raises(HeliosweepError, match=rf"{tmp_path}/result\.nc: cannot be written: {cause}"):
        write(tmp_path, compressed(NETCDF, "zlib"))
    assert list(tmp_path.iterdir()) == []


def test_a_folder_where_the_file_shall_stand_is_left(tmp_path):
    (tmp_path / "result.nc").mkdir()
    with pytest.raises(HeliosweepError, match="Is a directory"):
        write(tmp_path)
    assert [place.name for place in tmp_path.iterdir()] == ["result.nc"]


def test_remove_result(tmp_path):
    remove_at_once(tmp_path / "result.nc")
    (tmp_path / "result.zarr/power").mkdir(parents=True)
    remove_at_once(tmp_path / "result.zarr")
    assert not list(tmp_path.iterdir())
