"""Several runs in one process, and runs from scripts of all kinds."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from heliosweep import workflow
from heliosweep.cli import main
from tests.faults.kills import STUDIES, Nursery, content_of, done_parts, leftovers, write_study

STUDY = "from tests.conftest import SMALL as study\nimport heliosweep\n"


def script(folder: Path, text: str) -> subprocess.CompletedProcess[str]:
    (folder / "script.py").write_text(f"import sys; sys.path[:0] = {sys.path!r}\n{STUDY}{text}")
    return subprocess.run(
        [sys.executable, "script.py"], cwd=folder, capture_output=True, text=True, check=False, timeout=120
    )


def test_runs_in_threads_of_one_process(tmp_path):
    done = script(
        tmp_path,
        """
from concurrent.futures import ThreadPoolExecutor

def work(number):
    series = {"time_series": True, "compression": "zlib"}
    for _ in range(3):
        study_ = heliosweep.load({**study, "receiver": {"height": 60 + number}, "output": series})
        result = heliosweep.run(study_, f"out{number}", report=False)
        with result.open() as data:
            assert data.load().sizes["latitude"] == 2

with ThreadPoolExecutor(4) as pool:
    list(pool.map(work, range(4)))
""",
    )
    assert done.returncode == 0, done.stderr
    left = sorted(path.name for path in tmp_path.glob("out*/.*"))
    assert left == []


def test_two_runs_at_once_into_one_folder(tmp_path):
    done = script(
        tmp_path,
        """
from concurrent.futures import ThreadPoolExecutor

with ThreadPoolExecutor(2) as pool:
    list(pool.map(lambda _: heliosweep.run(heliosweep.load(study), "out", report=False), range(6)))
""",
    )
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.glob("out/*")} == {"result.nc", "manifest.json", "study.resolved.yaml"}


def test_processes_without_a_guard_are_told_of_it(tmp_path):
    done = script(
        tmp_path,
        """
study["execution"] = {"scheduler": "processes", "workers": 1}
heliosweep.run(heliosweep.load(study), "out", report=False)
""",
    )
    assert done.returncode != 0
    assert 'if __name__ == "__main__":' in done.stderr.splitlines()[-1]
    assert not (tmp_path / "out/result.nc").exists()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")
def test_two_processes(tmp_path):
    """The second says whom it waits for, then finds the result, or takes over what a killed one has done."""
    study = write_study(tmp_path, STUDIES["field"])
    command = ["run", str(study), "-q", "--no-report", "--output", str(tmp_path / "out")]
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    slow = "import time\nfrom heliosweep.store import working\nc = working.WorkingStore.commit\n"
    slow += "working.WorkingStore.commit = lambda *said: (time.sleep(0.02), c(*said))"
    with Nursery(tmp_path / "a") as first, Nursery(tmp_path / "b") as second:
        pid = first.start(command, setup=slow)
        _wait_for(lambda: len(done_parts(tmp_path / "out")) > 3)
        assert json.loads((tmp_path / "out/.heliosweep.lock").read_text())["process"] == pid
        second.start(command)
        _wait_for(lambda: "is at work in" in second.log())
        assert second.log().startswith(f"process {pid} on ")
        second.signal(signal.SIGTERM)  # who waits can give up
        assert second.end().code == 4
        assert (tmp_path / "out/.heliosweep.lock").exists()
        second.start(command)
        _wait_for(lambda: "is at work in" in second.log())
        first.signal()
        killed = first.end()
        done = done_parts(tmp_path / "out")
        again = second.end()
        assert killed.code == -signal.SIGKILL
        assert again.code == 0, again.errors
        assert not set(again.begun) & set(done)
        peace = first.run([*command[:-1], str(tmp_path / "peace")], setup=slow)
        third = second.run(command)
        assert (peace.code, third.code, third.begun) == (0, 0, [])
        assert "is complete already" in third.errors
    assert content_of(tmp_path / "out") == content_of(tmp_path / "peace")
    assert not leftovers(tmp_path / "out")


def test_a_claim_of_a_dead_process_stops_nobody(small, tmp_path):
    (tmp_path / ".heliosweep.lock").write_text(json.dumps({"process": 1, "host": "here"}))
    workflow.run(small(), tmp_path, report=False)
    assert not leftovers(tmp_path)


def test_different_studies_into_one_folder(tmp_path, capsys):
    for latitude in (10, 20, 10):
        study = write_study(tmp_path, {**STUDIES["field"], "site": {"latitude": latitude}, "output": {}})
        command = ["run", str(study), "-q", "--no-report", "--output", str(tmp_path / "out")]
        if (tmp_path / "out").exists():
            assert main(command) == 2
            assert "holds the result of another study (site.latitude" in capsys.readouterr().err
            command.append("--force")
        assert main(command) == 0
    assert not leftovers(tmp_path / "out")


def _wait_for(sight) -> None:
    deadline = time.monotonic() + 60
    while not sight():
        assert time.monotonic() < deadline
        time.sleep(0.005)
