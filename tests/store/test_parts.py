"""The working store: made whole or not at all, parts that outlive their process, damage that costs what it hits."""

from __future__ import annotations

import errno
import json
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from heliosweep.errors import HeliosweepError
from heliosweep.files import remove_at_once
from heliosweep.grid.regions import Cut, Part, Variable
from heliosweep.store import parts as module
from heliosweep.store.parts import PartStore
from tests.store.samples import CUTS, PARTS, SIZES, VALUES, VARIABLES, values

IDENTITY = {"study": {"a": 1, "b": (1.5, None, "é\ud800")}}


def create(folder: Path) -> PartStore:
    return PartStore.create(folder / "working", IDENTITY, CUTS, VARIABLES, SIZES)


@pytest.fixture
def store(tmp_path) -> Iterator[PartStore]:
    with create(tmp_path) as made:
        yield made


@pytest.fixture
def full(store) -> Path:
    """Folder of a store with all parts."""
    for part in PARTS:
        store.commit(part, values(part))
    store.close()
    return store.folder


def done(folder: Path) -> dict[str, dict[str, np.ndarray]]:
    """Parts that can be read, with their values."""
    with PartStore.open(folder) as again:
        damaged = again.drop_damaged()
        return {part.name: again.read(part) for part in PARTS if part.name in again.done and part not in damaged}


def assert_right(found: dict[str, dict[str, np.ndarray]]) -> None:
    for part in PARTS:
        if part.name in found:
            expected = {name: array for name, array in values(part).items() if not VARIABLES[name].finished}
            assert list(found[part.name]) == list(expected)
            for name, array in expected.items():
                assert found[part.name][name].dtype == array.dtype
                np.testing.assert_array_equal(found[part.name][name], array)


def test_parts_come_back_as_they_were_committed(store):
    assert not store.done
    for part in reversed(PARTS):
        store.commit(part, xr.Dataset({name: xr.DataArray(array) for name, array in values(part).items()}))
        assert part.name in store.done
    assert_right({part.name: store.read(part) for part in PARTS})
    store.close()
    again = PartStore.open(store.folder)
    assert len(again.done) == again.part_count == len(PARTS)
    assert sorted(again.done) == sorted(part.name for part in PARTS)
    assert "points-1" not in again.done
    assert "points-00099" not in again.done
    assert again.identity == json.loads(json.dumps(IDENTITY))
    assert again.cuts == CUTS
    assert again.drop_damaged() == []
    assert again.seconds >= 0
    assert_right(done(store.folder))
    assert {path.name for path in store.folder.iterdir()} == {"study.json", "values.bin", "journal.jsonl"}


def test_times_are_stored_too(tmp_path):
    noon = {"noon": Variable(("latitude",), {}, np.dtype("datetime64[ns]"))}
    part = Part("points-00001", "points", {"latitude": slice(1, 3)})
    cut = Cut({"latitude": 3}, {"latitude": 3}, {"latitude": 2})
    with PartStore.create(tmp_path / "working", {}, {"points": cut}, noon, SIZES) as store:
        store.commit(part, {"noon": VALUES["noon"][1:]})
        np.testing.assert_array_equal(store.read(part)["noon"], VALUES["noon"][1:])


@pytest.mark.parametrize("wrong", [{"mean": np.zeros((2, 7))}, {"mean": np.zeros((1, 7), np.float32)}])
def test_values_of_another_shape_or_type_are_refused(store, wrong):
    with pytest.raises(ValueError, match=r"mean: float.* not float64 of shape \(1, 7\)"):
        store.commit(PARTS[0], {**values(PARTS[0]), **wrong})
    assert not store.done


def test_failed_and_dropped_parts(store):
    store.fail(PARTS[0], "ValueError: é")
    store.fail(PARTS[1], "once")
    store.commit(PARTS[1], values(PARTS[1]))
    store.commit(PARTS[2], values(PARTS[2]))
    store.fail(PARTS[2], "again")
    for known in (store, PartStore.open(store.folder)):
        assert known.failed == {PARTS[0].name: "ValueError: é", PARTS[2].name: "again"}
        assert list(known.done) == [PARTS[1].name]


def test_a_killed_process_loses_nothing(tmp_path):
    """What `commit` came back from is in the files, synced or not."""
    store = create(tmp_path)
    for part in PARTS[:3]:
        store.commit(part, values(part))
    shutil.copytree(store.folder, tmp_path / "copy")
    assert list(done(tmp_path / "copy")) == [part.name for part in PARTS[:3]]
    store.close()


def test_the_disk_is_waited_for_in_groups(store, monkeypatch):
    synced: list[int] = []
    fsync = os.fsync

    def noted(descriptor: int) -> None:
        synced.append(descriptor)
        fsync(descriptor)

    monkeypatch.setattr(module.os, "fsync", noted)
    for part in PARTS[:5]:
        store.commit(part, values(part))
    assert synced == []
    end = time.monotonic() + 20
    while not synced and time.monotonic() < end:  # though nothing is committed any more
        time.sleep(0.05)
    store.sync()
    assert synced == [store._values, store._journal]  # the values first
    monkeypatch.setattr(module, "SYNC_BYTES", 100)
    for part in PARTS[5:8]:
        store.commit(part, values(part))
    assert len(synced) >= 4
    store.close()
    store.close()


def test_a_disk_that_fails_while_nobody_waits_is_told_to_the_next(store, monkeypatch):
    def fail(_: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    store.commit(PARTS[0], values(PARTS[0]))
    with monkeypatch.context() as patch:
        patch.setattr(module.os, "fsync", fail)
        store._sync_later()
    with pytest.raises(HeliosweepError, match="working: cannot be written: Input/output error"):
        store.commit(PARTS[1], values(PARTS[1]))
    store.commit(PARTS[1], values(PARTS[1]))
    assert len(store.done) == 2


class Stop(BaseException):
    """A process that ends."""


class Writes:
    """Stands in for os.write: the write of a number goes wrong, after a part of its bytes."""

    def __init__(self, number: int, share: float, error: BaseException) -> None:
        self.left, self.share, self.error, self.write = number, share, error, os.write

    def __call__(self, descriptor: int, content: Any) -> int:
        if self.left < 0:
            raise self.error
        self.left -= 1
        if self.left >= 0:
            return self.write(descriptor, content)
        return self.write(descriptor, content[: int(len(content) * self.share)])


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("cut_off", [True, False])
def test_a_crash_at_any_write(tmp_path, monkeypatch, share, cut_off):
    """Whatever was written of a part, it is there whole or not at all, and the next run goes on."""
    for number in range(2 * 4):
        store = create(tmp_path)
        with monkeypatch.context() as patch:
            patch.setattr(module.os, "write", Writes(number, share, Stop()))
            if not cut_off:  # the process is gone before it can
                patch.setattr(PartStore, "_cut_off", lambda _: None)
            with suppress(Stop):
                for part in PARTS:
                    stored = [*store.done]
                    store.commit(part, values(part))
        found = done(store.folder)
        assert list(found) == stored
        assert_right(found)
        with PartStore.open(store.folder) as again:
            for part in PARTS:
                if part.name not in again.done:
                    again.commit(part, values(part))
        assert len(done(store.folder)) == len(PARTS)
        assert_right(done(store.folder))
        remove_at_once(store.folder)


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_a_full_disk(store, monkeypatch, share):
    """It is told, the files end with the last whole part, and when there is room it goes on."""
    store.commit(PARTS[0], values(PARTS[0]))
    sizes = {path: path.stat().st_size for path in store.folder.iterdir()}
    for number in (0, 1):
        with monkeypatch.context() as patch:
            patch.setattr(module.os, "write", Writes(number, share, OSError(errno.ENOSPC, "No space left on device")))
            with pytest.raises(HeliosweepError, match="working: cannot be written: No space left on device"):
                store.commit(PARTS[1], values(PARTS[1]))
        assert {path: path.stat().st_size for path in store.folder.iterdir()} == sizes
        assert list(store.done) == [PARTS[0].name]
    for part in PARTS[1:]:
        store.commit(part, values(part))
    assert len(done(store.folder)) == len(PARTS)


@pytest.mark.parametrize("name", ["mkdir", "write_text", "rename", "fsync"])
def test_made_whole_or_not_at_all(tmp_path, monkeypatch, name):
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(*((os, name) if name == "fsync" else (Path, name)), full)
        with pytest.raises(HeliosweepError, match="working: cannot be written: No space left on device"):
            create(tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["values.bin", "journal.jsonl"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 0.999])
def test_a_truncated_file_costs_the_parts_at_its_end(full, name, share):
    size = int((full / name).stat().st_size * share)
    os.truncate(full / name, size)
    found = done(full)
    if name == "values.bin":
        lines = (json.loads(line) for line in (full / "journal.jsonl").read_text().splitlines())
        whole = {line["part"] for line in lines if "sha256" in line and line["offset"] + line["bytes"] <= size}
        assert {*found} == whole
    else:
        assert int(len(PARTS) * share) - 1 <= len(found) <= len(PARTS) * share
    assert_right(found)
    with PartStore.open(full) as store:
        for part in PARTS:
            if part.name not in store.done:
                store.commit(part, values(part))
    assert len(done(full)) == len(PARTS)


BAD_LINES = [
    b"", b"[]", b"null", b'"a"', b'{"sha256": "1"}', b"\xff", b"[" * 10**5, b"\r", b"\0" * 50, b'{"part": []}',
    *(json.dumps(line).encode() for line in (
        {"part": "points-00001", "sha256": "0" * 64}, {"part": "points-00001", "seconds": "long"},
        {"part": "points-00001", "sha256": "0" * 64, "offset": -8, "bytes": 8},
        {"part": "points-00001", "sha256": "0" * 64, "offset": 0, "bytes": 10**15},
        {"part": "points-00001", "sha256": "0" * 64, "offset": 0.5, "bytes": 2},
        {"part": "points-00001", "sha256": "0" * 64, "offset": 10**30, "bytes": 8},
        {"part": "points-00001", "sha256": 64 * "x", "offset": 0, "bytes": 8},
        {"part": "points-1", "failed": "x"}, {"part": "points--0001", "failed": "x"},
        {"part": "points-" + "9" * 5000, "failed": "x"}, {"part": "points-\u0660000\u0661", "failed": "x"},
        {"part": "points-00003", "failed": "x"}, {"part": "x", "failed": "x"}, {"part": "", "failed": "x"},
    )),
    b'{"part": "points-00001", "failed": "x", "seconds": 1' + b"0" * 400 + b"}",
]  # fmt: skip


def test_lines_of_the_journal_that_are_none(store):
    store.commit(PARTS[0], values(PARTS[0]))
    store.close()
    with (store.folder / "journal.jsonl").open("ab") as file:
        file.write(b"\n".join([*BAD_LINES, b""]) + b'{"part": "points-00002", "failed": "t')
    again = PartStore.open(store.folder)
    assert list(again.done) == ["points-00000"]
    assert set(again.failed) <= {"points-00001"}
    again.commit(PARTS[4], values(PARTS[4]))
    again.close()
    assert_right(found := done(store.folder))
    assert list(found) == ["points-00000", PARTS[4].name]


def test_nothing_is_changed_before_something_is_committed(full):
    places = [full, *full.iterdir()]
    with (full / "journal.jsonl").open("a") as file:
        file.write("torn")
    before = {path: path.stat().st_mtime_ns for path in places}
    for place in places:
        place.chmod(0o555 if place.is_dir() else 0o444)
    try:
        assert len(done(full)) == len(PARTS)
    finally:
        full.chmod(0o755)
    assert {path: path.stat().st_mtime_ns for path in places} == before


def test_removed(store):
    store.commit(PARTS[0], values(PARTS[0]))
    store.remove()
    store.remove()
    assert not list(store.folder.parent.iterdir())
