"""A result folder: claimed by one run at a time, its manifest, and what its result belongs to."""

from __future__ import annotations

import errno
import json
import multiprocessing
import os
import platform
import threading
import time
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import pytest

from heliosweep.errors import HeliosweepError
from heliosweep.store import folder as module
from heliosweep.store.encoding import slab_digest
from heliosweep.store.folder import claimed, holder
from heliosweep.store.manifest import Finished, changes, identity_of, latest_identity, listed
from tests.store.samples import PLAN, SLABS, values, write_folder

MODULE = "heliosweep.families.field_efficiency.compute"


def test_held_and_given_back(tmp_path):
    assert holder(tmp_path) is None
    with claimed(tmp_path):
        assert holder(tmp_path) == f"process {os.getpid()} on {platform.node()}"
    assert holder(tmp_path) is None
    assert not list(tmp_path.iterdir())


def test_given_back_after_an_error(tmp_path):
    with pytest.raises(ZeroDivisionError), claimed(tmp_path):
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())


def test_a_file_that_was_left_is_no_claim(tmp_path):
    (tmp_path / ".heliosweep.lock").write_text('{"process": 1, "host": "elsewhere"}')
    assert holder(tmp_path) is None
    with claimed(tmp_path):
        assert "elsewhere" not in str(holder(tmp_path))
    assert not list(tmp_path.iterdir())


def test_one_at_a_time(tmp_path, monkeypatch, caplog):
    """Also where the one before takes the file, or the whole folder, with it."""
    monkeypatch.setattr(module, "_PATIENCE", 0.01)
    folder, inside, most = tmp_path / "out", 0, 0
    folder.mkdir()

    def work() -> None:
        nonlocal inside, most
        for _ in range(10):
            with claimed(folder):
                inside += 1
                most = max(most, inside)
                time.sleep(0.001)
                inside -= 1
            with suppress(OSError):
                folder.rmdir()

    threads = [threading.Thread(target=work) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert most == 1
    assert f"process {os.getpid()} on " in caplog.text


def test_a_waiting_run_can_be_interrupted(tmp_path, monkeypatch):
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with claimed(tmp_path):
        monkeypatch.setattr(module, "_PATIENCE", 0.01)
        monkeypatch.setattr(module.log, "warning", stop)
        with pytest.raises(KeyboardInterrupt), claimed(tmp_path):
            pass
        assert holder(tmp_path)


def test_a_full_disk_does_not_keep_from_claiming(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "full")

    monkeypatch.setattr(os, "ftruncate", full)
    with claimed(tmp_path):
        assert holder(tmp_path) == "another process"


def test_a_worker_that_begins_does_not_wait(tmp_path, monkeypatch):
    monkeypatch.setattr(multiprocessing.current_process(), "_inheriting", True, raising=False)
    with pytest.raises(HeliosweepError, match="__main__"), claimed(tmp_path):
        pass


@pytest.fixture
def finished(small, tmp_path) -> Finished:
    found = Finished.find(write_folder(tmp_path / "out", small()))
    assert found
    return found


def test_found(small, finished):
    assert finished.path == finished.folder / "result.nc"
    assert finished.identity["study_id"] == small().study_id
    assert finished.is_whole()
    identity = {"study": small(receiver={"height": 61}).canonical(), "code": {}}
    assert finished.changes(identity, "study") == "receiver.height: 60.0 -> 61.0"
    assert finished.changes(identity, "code") == ""


@pytest.mark.parametrize("result", ["result.nc", "result.zarr"])
def test_its_slabs_are_taken_over(small, tmp_path, result):
    finished = Finished.find(write_folder(tmp_path / "out", small(), result))
    assert finished
    assert finished.holds("points", PLAN)
    assert finished.holds("series", PLAN)
    others: list[Any] = [
        SimpleNamespace(variables={**PLAN.variables, "new": PLAN.variables["power"]}, cuts=PLAN.cuts),
        SimpleNamespace(variables=PLAN.variables, cuts={**PLAN.cuts, "points": PLAN.cuts["series"]}),
    ]
    assert not finished.holds("series", others[0])
    assert not finished.holds("points", others[1])
    for slab in SLABS:
        assert slab_digest(finished.read(slab)) == slab_digest(values(slab))
    finished.manifest["slabs"]["digests"]["points-00001"] = "0" * 64
    with pytest.raises(HeliosweepError, match=r"points-00001 is not what was computed; --force"):
        finished.read(SLABS[1])


@pytest.mark.parametrize(
    ("called", "command"),
    [
        ("/bin/heliosweep", ["heliosweep", "run"]),
        ("/lib/heliosweep/__main__.py", ["python", "-m", "heliosweep", "run"]),
        ("/home/me/plants/__main__.py", ["python", "-m", "plants", "run"]),
    ],
)
def test_the_command_that_wrote_it(small, tmp_path, monkeypatch, called, command):
    monkeypatch.setattr("sys.argv", [called, "run"])
    assert json.loads((write_folder(tmp_path, small()) / "manifest.json").read_text())["command"] == command


def test_not_whole(finished):
    with finished.path.open("r+b") as file:
        file.seek(-1, os.SEEK_END)
        file.write(b"\1")
    assert not finished.is_whole()
    finished.path.unlink()
    assert not finished.is_whole()
    assert Finished.find(finished.folder) is None


def test_the_latest_identity(small, finished, tmp_path):
    write_folder(tmp_path / "later", small(receiver={"height": 61}))
    (tmp_path / "empty").mkdir()
    os.utime(finished.folder, (1e9, 1e9))
    found = latest_identity(tmp_path.iterdir())
    assert found
    assert found[0] == tmp_path / "later"
    assert latest_identity([tmp_path / "empty", tmp_path / "none"]) is None


def test_changes():
    before = {"a": {"b": 1, "c": [1, 2]}, "d": "x", "gone": None}
    assert changes(before, json.loads(json.dumps(before))) == []
    after = {"a": {"b": 2, "c": [1, 2]}, "d": "x", "e": {"f": 1}, "gone": None}
    assert changes(before, after) == ["a.b: 1 -> 2", "e: not given -> f 1"]
    assert changes(after, before) == ["a.b: 2 -> 1", "e: f 1 -> not given"]
    assert changes(1, 2, "a") == ["a: 1 -> 2"]
    assert changes({"a": (1, 2)}, {"a": [1, 2]}) == []
    assert changes({"a": "x" * 100}, {}) == [f"a: {'x' * 57}... -> not given"]


def test_listed():
    after = {str(number): number for number in range(5)}
    assert listed({}, after) == "0: not given -> 0; 1: not given -> 1; 2: not given -> 2, and 2 more"
    assert listed(after, after) == ""


def test_the_identity_is_that_of_the_bytes(small):
    """Execution is none of it; what follows from the study is not told twice."""
    attributes = {"title": "t", "study": "{}", "history": "now", "references": "r"}
    identity = identity_of(small(), attributes, MODULE)
    other = identity_of(small(execution={"workers": 1, "scheduler": "synchronous"}), attributes, MODULE)
    assert identity == other
    assert json.loads(json.dumps(identity)) is not None
    assert identity["attributes"] == {"title": "t", "references": "r"}
    assert identity["study_id"] == small().study_id
    changed = identity_of(small(receiver={"height": 61}), attributes, MODULE)
    assert listed(identity["study"], changed["study"]) == "receiver.height: 60.0 -> 61.0"
