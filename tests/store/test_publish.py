"""From the working store to the result: whole or not at all, in the place of one of either format."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from heliosweep.config.blocks import Output
from heliosweep.errors import HeliosweepError
from heliosweep.store import publish as module
from heliosweep.store.digest import file_digest
from heliosweep.store.open_result import open_result
from heliosweep.store.publish import publish, remove_result
from heliosweep.store.skeleton import Skeleton
from heliosweep.store.working import WorkingStore
from tests.store.samples import ATTRIBUTES, COORDINATES, CUT, SIZES, VALUES, VARIABLES, parts, values, write_netcdf

SKELETON = Skeleton(SIZES, COORDINATES, VARIABLES, ATTRIBUTES)
PLAN: Any = SimpleNamespace(parts=parts, cut=CUT)
FORMATS = {
    "netcdf": Output.model_validate({"compression": "none"}),
    "zarr": Output.model_validate({"format": "zarr", "compression": "zlib"}),
}


def stored(folder: Path, output: Output) -> WorkingStore:
    compression: Any = output.compression if output.format == "zarr" else "none"
    store = WorkingStore.create(folder / "working", {}, SKELETON, CUT, compression, output.compression_level)
    for part in parts():
        store.commit(part, values(part))
    return store


@pytest.mark.parametrize("name", list(FORMATS))
def test_values_and_nothing_else(tmp_path, name):
    output = FORMATS[name]
    path = publish(stored(tmp_path, output), SKELETON, PLAN, output, tmp_path)
    with open_result(path) as result:
        np.testing.assert_array_equal(result["power"], VALUES["power"])
        assert result.attrs["title"] == "test"
    assert {place.name for place in tmp_path.iterdir()} == {"working", path.name}
    if name == "netcdf":
        assert file_digest(path) == file_digest(write_netcdf(tmp_path / "direct.nc"))


@pytest.mark.parametrize("first", list(FORMATS))
@pytest.mark.parametrize("second", list(FORMATS))
def test_one_result_takes_the_place_of_the_other(tmp_path, first, second):
    store = stored(tmp_path, FORMATS[first])
    publish(store, SKELETON, PLAN, FORMATS[first], tmp_path)
    store.remove()
    (tmp_path / "manifest.json").write_text("of the first")
    path = publish(stored(tmp_path, FORMATS[second]), SKELETON, PLAN, FORMATS[second], tmp_path)
    assert {place.name for place in tmp_path.iterdir()} == {"working", path.name}


def test_a_zarr_result_without_hard_links(tmp_path, monkeypatch):
    link = module._link

    def without(source: Path, target: Path) -> None:
        with monkeypatch.context() as patch:
            patch.setattr(os, "link", no_links)  # for this alone: zarr cannot do without
            link(source, target)

    def no_links(*_: object) -> None:
        raise PermissionError

    output = FORMATS["zarr"]
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    linked = publish(stored(tmp_path / "a", output), SKELETON, PLAN, output, tmp_path / "a")
    store = stored(tmp_path / "b", output)
    monkeypatch.setattr(module, "_link", without)
    copied = publish(store, SKELETON, PLAN, output, tmp_path / "b")
    files = {path.relative_to(linked) for path in linked.rglob("*")}
    assert files == {path.relative_to(copied) for path in copied.rglob("*")}
    for name in files:
        if (linked / name).is_file():
            assert (linked / name).read_bytes() == (copied / name).read_bytes()


@pytest.mark.parametrize("name", list(FORMATS))
def test_a_damaged_part_is_not_published(tmp_path, name):
    output = FORMATS[name]
    store = stored(tmp_path, output)
    earlier = write_netcdf(tmp_path / "result.nc").read_bytes()
    (tmp_path / "manifest.json").write_text("of the earlier one")
    chunk = min((store.values / "power").glob("[0-9]*"))
    chunk.write_bytes(bytes([chunk.read_bytes()[0] ^ 1]) + chunk.read_bytes()[1:])
    with pytest.raises(HeliosweepError, match="series-00000 was damaged on the disk"):
        publish(store, SKELETON, PLAN, output, tmp_path)
    assert {place.name for place in tmp_path.iterdir()} == {"working", "result.nc", "manifest.json"}
    assert (tmp_path / "result.nc").read_bytes() == earlier


def test_remove_result(tmp_path):
    remove_result(tmp_path / "result.nc")
    (tmp_path / "result.zarr/power").mkdir(parents=True)
    remove_result(tmp_path / "result.zarr")
    assert not list(tmp_path.iterdir())
