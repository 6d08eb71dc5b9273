"""Runs that are stopped: exit code 4, one line, parts kept, nothing half written, no empty folder."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

from heliosweep import api
from heliosweep.errors import RunInterrupted
from heliosweep.runs import run as runtime
from heliosweep.store.parts import PartStore
from tests.faults.kills import STUDIES, done_parts, leftovers, wait_for, write_study
from tests.faults.stopped import STUDY, Runs, interrupt

#: Slows a run down where it shall be stopped.
SLOW_WRITING = """
import time
from heliosweep.runs.run import Run
slabs = Run._slabs
Run._slabs = lambda *said: (time.sleep(0.3) or slab for slab in slabs(*said))
"""
SLOW_KERNELS = """
import time
from heliosweep.runs import run
run.prepare_kernels = lambda *_: time.sleep(30)
"""


@pytest.fixture
def command(nursery) -> list[str]:
    """Runs a study of many parts, into the folder that is named next."""
    study = write_study(nursery.folder, STUDIES["field"])
    return ["run", str(study), "-q", "--no-report", "--output"]


@pytest.mark.parametrize(("number", "pauses"), [("SIGHUP", [0.5]), ("SIGINT", [0.5, 0.05])])
def test_signals_when_all_parts_are_done(nursery, command, tmp_path, number, pauses):
    place = tmp_path / "new/out"
    nursery.start([*command, str(place)], setup=SLOW_WRITING)
    wait_for(lambda: list(place.glob(".result.nc.*")))
    for pause in pauses:
        time.sleep(pause)
        nursery.signal(getattr(signal, number), "process")
    outcome = nursery.end()
    assert outcome.code == 4, outcome.errors
    total = PartStore.open(place / "working").part_count
    said = f"interrupted: {total} of {total} parts are done and kept in {place}; run the same command again"
    assert outcome.errors.startswith(said)
    assert len(outcome.errors.splitlines()) == 1
    assert [path.name for path in place.iterdir()] == ["working"]
    assert nursery.run([*command, str(place)]).begun == []
    assert not leftovers(place)


def test_signal_before_anything_is_done(nursery, command, tmp_path):
    nursery.start([*command, str(tmp_path / "new/out")], setup=SLOW_KERNELS)
    wait_for(lambda: (tmp_path / "new/out/working").exists())
    time.sleep(0.2)
    nursery.signal(signal.SIGTERM, "process")
    outcome = nursery.end()
    assert outcome.code == 4
    assert outcome.errors == "interrupted: nothing was computed yet; run the same command again to go on\n"
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("where", "message", "left"),
    [
        ("prepare_kernels", "nothing was computed yet", set()),
        ("publish", "4 of 4 parts are done and kept", {"working"}),
        ("write_manifest", "4 of 4 parts are done and kept", {"working", "result.nc"}),
    ],
)
def test_the_message_says_what_was_left(runs: Runs, tmp_path, monkeypatch, where, message, left):
    with monkeypatch.context() as patch:
        patch.setattr(runtime, where, interrupt)
        with pytest.raises(RunInterrupted, match=message):
            runs.run(STUDY, tmp_path / "out")
    assert {path.name for path in tmp_path.glob("out/*")} == left
    assert (tmp_path / "out").exists() == bool(left)
    runs.run(STUDY, tmp_path / "out")
    assert not leftovers(tmp_path / "out")


def test_interrupted_before_the_parts_were_looked_at(small, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(runtime, "publish", interrupt)
        with pytest.raises(RunInterrupted):
            api.run(small(), tmp_path, report=False)
    with monkeypatch.context() as patch:
        patch.setattr(runtime.Run, "_earlier", interrupt)
        with pytest.raises(RunInterrupted, match="the parts that were done are kept"):
            api.run(small(), tmp_path, report=False)
    assert done_parts(tmp_path)


def test_a_manifest_never_stands_beside_another_result(small, tmp_path, monkeypatch):
    api.run(small(), tmp_path)
    monkeypatch.setattr(runtime.Run, "_record", interrupt)
    with pytest.raises(RunInterrupted):
        api.run(small(receiver={"height": 70}), tmp_path, force=True)
    assert {path.name for path in tmp_path.iterdir()} == {"result.nc", "figures", "working"}


def test_folders_that_were_there_stay(small, tmp_path, monkeypatch):
    (tmp_path / "there").mkdir()
    monkeypatch.setattr(runtime, "prepare_kernels", interrupt)
    with pytest.raises(RunInterrupted):
        api.run(small(), tmp_path / "there/new/out")
    assert [path.name for path in tmp_path.rglob("*")] == ["there"]


def test_a_killed_run_is_tidied_up_by_the_next(small, tmp_path):
    program = (
        "import os, sys; from pathlib import Path; from heliosweep.files import temporary_name\n"
        "temporary_name(Path(sys.argv[1]) / 'result.nc').touch(); os.kill(os.getpid(), 9)"
    )
    assert subprocess.run([sys.executable, "-c", program, str(tmp_path)], check=False).returncode != 0
    assert list(tmp_path.glob(".*.part"))
    api.run(small(), tmp_path, report=False)
    assert not list(tmp_path.glob(".*"))
