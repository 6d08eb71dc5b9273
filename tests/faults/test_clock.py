"""Clocks that go backwards, between runs and within one, and files from the future."""

from __future__ import annotations

import itertools
import os
import time

from tests.faults.kills import content_of
from tests.faults.stopped import STUDY, Runs, runs  # noqa: F401


def test_backwards_within_a_run(runs: Runs, tmp_path, monkeypatch):  # noqa: F811
    runs.run(STUDY, tmp_path / "peace")
    now = itertools.count(2e9, -3600)
    with monkeypatch.context() as patch:
        patch.setattr(time, "time", lambda: float(next(now)))
        runs.run(STUDY, tmp_path / "out")
    assert content_of(tmp_path / "out") == content_of(tmp_path / "peace")


def test_backwards_between_runs(runs: Runs, tmp_path):  # noqa: F811
    done = runs.stop(STUDY, tmp_path / "out")
    for path in (tmp_path / "out").rglob("*"):
        os.utime(path, (4e9, 4e9))
    assert len(runs.run(STUDY, tmp_path / "out")) == 4 - len(done)
    runs.run(STUDY, tmp_path / "peace")
    assert content_of(tmp_path / "out") == content_of(tmp_path / "peace")
    for path in (tmp_path / "out").rglob("*"):
        os.utime(path, (4e9, 4e9))
    assert runs.run(STUDY, tmp_path / "out") == []
