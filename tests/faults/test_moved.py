"""Clocks that go backwards and files from the future; folders that are copied elsewhere, finished or not."""

from __future__ import annotations

import itertools
import os
import shutil
import time
from pathlib import Path

from tests.faults.kills import content_of, leftovers
from tests.faults.stopped import STUDY, Runs


def everything(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_backwards_within_a_run(runs: Runs, tmp_path, monkeypatch):
    runs.run(STUDY, tmp_path / "peace")
    now = itertools.count(2e9, -3600)
    with monkeypatch.context() as patch:
        patch.setattr(time, "time", lambda: float(next(now)))
        runs.run(STUDY, tmp_path / "out")
    assert content_of(tmp_path / "out") == content_of(tmp_path / "peace")


def test_backwards_between_runs(runs: Runs, tmp_path):
    runs.run(STUDY, tmp_path / "peace")
    runs.stop(STUDY, tmp_path / "out")
    for again in (2, 0):
        for path in (tmp_path / "out").rglob("*"):
            os.utime(path, (4e9, 4e9))
        assert len(runs.run(STUDY, tmp_path / "out")) == again
        assert content_of(tmp_path / "out") == content_of(tmp_path / "peace")


def test_an_unfinished_folder_is_copied(runs: Runs, tmp_path):
    """Also while a run is at work: the copy holds its claim, and files with its name."""
    runs.stop(STUDY, tmp_path / "here")
    before = everything(tmp_path / "here")
    shutil.copytree(tmp_path / "here", tmp_path / "far/away")
    (tmp_path / "far/away/.heliosweep.lock").write_text('{"process": 1, "host": "elsewhere"}')
    (tmp_path / "far/away/working/tmp0123").mkdir()  # of a cluster
    assert len(runs.run(STUDY, tmp_path / "far/away")) == 2
    assert everything(tmp_path / "here") == before
    assert len(runs.run(STUDY, tmp_path / "here")) == 2
    assert content_of(tmp_path / "here") == content_of(tmp_path / "far/away")
    assert not leftovers(tmp_path / "far/away")


def test_a_finished_folder_is_copied(runs: Runs, tmp_path, caplog):
    runs.run(STUDY, tmp_path / "here")
    before = everything(tmp_path / "here")
    shutil.copytree(tmp_path / "here", tmp_path / "there")
    assert runs.run(STUDY, tmp_path / "there") == []
    assert "is complete already" in caplog.text
    assert everything(tmp_path / "here") == everything(tmp_path / "there") == before
