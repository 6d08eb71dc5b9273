"""Claims on a result folder: one at a time, seen by others, gone with the process."""

from __future__ import annotations

import errno
import multiprocessing
import os
import platform
import threading
import time
from contextlib import suppress

import pytest

from heliosweep.errors import HeliosweepError
from heliosweep.store import claim
from heliosweep.store.claim import claimed, holder


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
    monkeypatch.setattr(claim, "_PATIENCE", 0.0)
    monkeypatch.setattr(claim, "_LOOK", 0.002)
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
    def stop(_: float) -> None:
        raise KeyboardInterrupt

    with claimed(tmp_path):
        monkeypatch.setattr(claim.time, "sleep", stop)
        with pytest.raises(KeyboardInterrupt), claimed(tmp_path):
            pass
        assert holder(tmp_path)


def test_a_file_system_without_locks(tmp_path, monkeypatch):
    def no_locks(*_: object) -> None:
        raise OSError(errno.ENOLCK, "no locks")

    monkeypatch.setattr(claim.fcntl, "flock", no_locks)
    with claimed(tmp_path):
        pass
    assert not list(tmp_path.iterdir())


def test_a_full_disk_does_not_keep_from_claiming(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "full")

    monkeypatch.setattr(claim.os, "ftruncate", full)
    with claimed(tmp_path):
        assert holder(tmp_path) == "another process"


def test_a_worker_that_begins_does_not_wait(tmp_path, monkeypatch):
    monkeypatch.setattr(multiprocessing.current_process(), "_inheriting", True, raising=False)
    with pytest.raises(HeliosweepError, match="__main__"), claimed(tmp_path):
        pass
