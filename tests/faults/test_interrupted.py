"""Runs that are stopped: exit code 4, one line, nothing half written, no empty folder."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from typing import Any

import pytest
import yaml

from heliosweep import workflow
from heliosweep.errors import RunInterrupted
from tests.conftest import SMALL

#: Computed in a second, and written for much longer.
LONG: dict[str, Any] = {
    **SMALL,
    "time": {**SMALL["time"], "hours": {"start": 8, "stop": 16, "step": 0.005}},
    "layout": {"radial_stagger": {"clearance": 13, "inner_radius": 50, "heliostats": 300}},
    "output": {"time_series": True, "compression": "zlib", "compression_level": 9},
}


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="signals of POSIX systems")
@pytest.mark.parametrize(
    ("number", "pauses"), [("SIGTERM", [0]), ("SIGHUP", [0]), ("SIGINT", [0, 0.05]), ("SIGINT", [0, 0.1, 0.1, 0.1])]
)
def test_signals(tmp_path, number, pauses):
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(LONG))
    command = [sys.executable, "-m", "heliosweep", "run", "study.yaml", "--output", "new/out"]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    part, deadline = (lambda: next(tmp_path.glob("new/out/.result.nc.*"), None)), time.monotonic() + 120
    while ((found := part()) is None or found.stat().st_size < 10**6) and time.monotonic() < deadline:
        time.sleep(0.05)  # until it writes
    assert process.poll() is None
    for pause in pauses:
        time.sleep(pause)
        process.send_signal(getattr(signal, number))
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 4, errors
    assert errors.splitlines()[-1].startswith("interrupted: nothing half written was left")
    assert "Traceback" not in errors
    assert {path.name for path in tmp_path.iterdir()} == {"study.yaml"}


def stop(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("where", "message", "left"),
    [
        ("_prepare_kernels", "nothing was computed", set()),
        ("_record", "its manifest is missing", {"result.nc"}),
    ],
)
def test_the_message_says_what_was_left(small, tmp_path, monkeypatch, where, message, left):
    monkeypatch.setattr(workflow, where, stop)
    with pytest.raises(RunInterrupted, match=message):
        workflow.run(small(), tmp_path / "out", report=False)
    assert {path.name for path in tmp_path.glob("out/*")} == left
    assert (tmp_path / "out").exists() == bool(left)


def test_a_manifest_never_stands_beside_another_result(small, tmp_path, monkeypatch):
    workflow.run(small(), tmp_path)
    monkeypatch.setattr(workflow, "_record", stop)
    with pytest.raises(RunInterrupted):
        workflow.run(small(receiver={"height": 70}), tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"result.nc", "figures"}


def test_folders_that_were_there_stay(small, tmp_path, monkeypatch):
    (tmp_path / "there").mkdir()
    monkeypatch.setattr(workflow, "_prepare_kernels", stop)
    with pytest.raises(RunInterrupted):
        workflow.run(small(), tmp_path / "there/new/out")
    assert [path.name for path in tmp_path.rglob("*")] == ["there"]


def test_a_killed_run_is_tidied_up_by_the_next(small, tmp_path):
    program = (
        "import os, sys; from pathlib import Path; from heliosweep.store.temporary import temporary_name\n"
        "temporary_name(Path(sys.argv[1]) / 'result.nc').touch(); os.kill(os.getpid(), 9)"
    )
    assert subprocess.run([sys.executable, "-c", program, str(tmp_path)], check=False).returncode != 0
    assert list(tmp_path.glob(".*.part"))
    workflow.run(small(), tmp_path, report=False)
    assert not list(tmp_path.glob(".*"))
