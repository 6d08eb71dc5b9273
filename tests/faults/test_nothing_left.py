"""Runs with worker processes that end suddenly: nothing waits for ever, and nothing is left for temporary files."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from tests.conftest import SMALL
from tests.faults.kills import done_parts, wait_for

COMMAND = Path(sys.executable).with_name("heliosweep")
#: Some minutes of work in parts of a second or two.
LONG = {
    **SMALL,
    "site": {"latitude": {"start": -60, "stop": 60, "step": 5}},
    "time": {**SMALL["time"], "days": {"start": 1, "stop": 365, "step": 1}},
    "layout": {"radial_stagger": {"clearance": 16, "inner_radius": 61.3, "heliostats": 1000}},
}


@pytest.fixture
def short() -> Iterator[Path]:
    """A folder with a name that leaves room for that of a socket."""
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


@pytest.mark.parametrize("scheduler", ["processes", "distributed"])
@pytest.mark.parametrize(("number", "send"), [(signal.SIGKILL, os.kill), (signal.SIGHUP, os.killpg)])
def test_nothing_is_left_of_a_run_that_ends_suddenly(scheduler, number, send, tmp_path, short):
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(LONG))
    command = [COMMAND, "run", "study.yaml", "-q", "--no-report", "-o", "out", "--scheduler", scheduler]
    process = subprocess.Popen(
        [*command, "--workers", "2"],
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(short)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    wait_for(lambda: process.poll() is not None or done_parts(tmp_path / "out"))
    begin = time.monotonic()
    send(process.pid, number)
    said, _ = process.communicate(timeout=60)  # whoever reads the pipe is not left waiting by a worker
    assert process.returncode == (-number if number == signal.SIGKILL else 4)
    assert time.monotonic() - begin < 30
    assert "Traceback" not in said
    wait_for(lambda: not list(short.iterdir()))
