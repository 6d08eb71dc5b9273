"""The working store: made whole or not at all, parts that are done for good, damage that is noticed."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from heliosweep.errors import HeliosweepError
from heliosweep.store import working
from heliosweep.store.journal import Journal
from heliosweep.store.skeleton import Skeleton
from heliosweep.store.working import WorkingStore, read_identity
from tests.store.samples import ATTRIBUTES, COORDINATES, CUT, SIZES, VARIABLES, digests, parts, values

SKELETON = Skeleton(SIZES, COORDINATES, VARIABLES, ATTRIBUTES)
PARTS = list(parts())


def create(folder: Path, **options: Any) -> WorkingStore:
    return WorkingStore.create(folder / "working", {"study": {"a": 1}}, SKELETON, CUT, **options)


@pytest.fixture(params=["none", "zlib", "zstd"])
def store(request, tmp_path) -> WorkingStore:
    return create(tmp_path, compression=request.param)


def test_parts_come_back_as_they_were_stored(store):
    for part in PARTS:
        store.commit(part, values(part))
    again = WorkingStore(store.folder)
    assert again.journal.done == digests()
    assert again.identity["study"] == {"a": 1}
    for part in reversed(PARTS):
        for name, array in again.read(part).items():
            np.testing.assert_array_equal(array, values(part)[name])
    assert again.drop_damaged(PARTS) == []
    assert not list(store.folder.parent.glob(".*"))


def test_a_part_is_on_the_disk_before_it_is_in_the_journal(tmp_path, monkeypatch):
    """Chunks and their folders first, the journal last."""
    store, synced = create(tmp_path), []
    fsync = os.fsync

    def noted(descriptor: int) -> None:
        synced.append(Path(f"/proc/self/fd/{descriptor}").readlink().relative_to(store.folder).as_posix())
        fsync(descriptor)

    if not Path("/proc/self/fd").exists():
        pytest.skip("looks at /proc")
    monkeypatch.setattr(os, "fsync", noted)
    part = PARTS[0]
    store.commit(part, values(part))
    names = sorted(values(part))
    assert {*synced[:-1]} == {
        *(f"values.zarr/{name}" for name in names),
        *(path.relative_to(store.folder).as_posix() for name in names for path in (store.values / name).glob("[0-9]*")),
    }
    assert synced[-1] == "journal.jsonl"
    for name in names:
        chunk = next(place for place in synced if place.startswith(f"values.zarr/{name}/"))
        assert synced.index(chunk) < synced.index(f"values.zarr/{name}")


def test_parts_share_no_file(store):
    for part in PARTS:
        before = {path: path.read_bytes() for path in store.values.rglob("[0-9]*")}
        store.commit(part, values(part))
        assert all(path.read_bytes() == content for path, content in before.items())
        assert len(list(store.values.rglob("*.partial"))) == 0


def test_failed_parts(tmp_path):
    store = create(tmp_path)
    store.fail(PARTS[0], "ValueError: no")
    assert WorkingStore(store.folder).journal.failed == {PARTS[0].name: "ValueError: no"}
    store.commit(PARTS[0], values(PARTS[0]))
    assert not WorkingStore(store.folder).journal.failed


def test_damage_is_noticed_and_written_down(store):
    for part in PARTS:
        store.commit(part, values(part))
    chunk = next(iter(sorted((store.values / "mean").glob("[0-9]*"))))
    content = chunk.read_bytes()
    chunk.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    again = WorkingStore(store.folder)
    with pytest.raises(HeliosweepError, match="points-00000 was damaged on the disk"):
        again.read(PARTS[0])
    assert again.drop_damaged(PARTS) == [PARTS[0]]
    assert not chunk.exists()
    assert PARTS[0].name not in Journal.read(store.folder / "journal.jsonl").done
    again.commit(PARTS[0], values(PARTS[0]))
    assert WorkingStore(store.folder).drop_damaged(PARTS) == []


def test_a_missing_chunk_of_nothing_but_nan(tmp_path):
    """Zarr reads one that is not there as NaN: the digest alone would not tell."""
    store, part = create(tmp_path), PARTS[0]
    nothing = {**values(part), "mean": np.full_like(values(part)["mean"], np.nan)}
    store.commit(part, nothing)
    chunk = next((store.values / "mean").glob("[0-9]*"))
    assert store.drop_damaged(PARTS) == []
    chunk.unlink()
    assert store.drop_damaged(PARTS) == [part]


def test_made_whole_or_not_at_all(tmp_path, monkeypatch):
    """Wherever the disk is full."""
    fsync, count = os.fsync, 0
    (tmp_path / "try").mkdir()
    create(tmp_path / "try")
    total = len(list((tmp_path / "try/working").rglob("*"))) + 1
    for full_at in (0, 1, total // 2, total - 1):
        count = 0

        def full(descriptor: int, full_at: int = full_at) -> None:
            nonlocal count
            if count == full_at:
                raise OSError(errno.ENOSPC, "No space left on device")
            count += 1
            fsync(descriptor)

        (tmp_path / f"out{full_at}").mkdir()
        with monkeypatch.context() as patch:
            patch.setattr(os, "fsync", full)
            with pytest.raises(HeliosweepError, match="working: cannot be written: No space left on device"):
                create(tmp_path / f"out{full_at}")
        assert not list((tmp_path / f"out{full_at}").iterdir())
        create(tmp_path / f"out{full_at}")


def test_removed(store):
    store.remove()
    store.remove()
    assert not list(store.folder.parent.iterdir())


@pytest.mark.parametrize("content", ["", "{", "[]", "null", "{}", '{"format": 2}', '{"format": []}', "\0"])
def test_a_folder_that_is_no_store(tmp_path, content):
    create(tmp_path)
    (tmp_path / "working/study.json").write_text(content)
    with pytest.raises(HeliosweepError, match=r"is no working store \(.*\); --force .* removes it"):
        read_identity(tmp_path / "working")


@pytest.mark.parametrize("change", [{"variables": ["none"]}, {"variables": 1}, {"metadata": "0"}, {"variables": [[]]}])
def test_a_store_whose_description_does_not_fit(tmp_path, change):
    path = create(tmp_path).folder / "study.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(HeliosweepError, match=r"is damaged \(.*\); --force .* removes it and starts anew"):
        WorkingStore(path.parent)


def test_words_for_what_could_not_be_written(tmp_path, monkeypatch):
    with (
        pytest.raises(HeliosweepError, match=r"x: cannot be written: Permission denied \(.*B free\)"),
        working.writing(tmp_path / "x"),
    ):
        raise PermissionError(errno.EACCES, "Permission denied")
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("", (), {"free": 10})())
    with pytest.raises(HeliosweepError, match=r"disk full \(10 B free\)"), working.writing(tmp_path):
        raise OSError
