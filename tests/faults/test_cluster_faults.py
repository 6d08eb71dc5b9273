"""Faults of clusters: workers that die, a scheduler that is lost, Ctrl-C on a terminal."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml

from heliosweep.errors import RunInterrupted
from heliosweep.runs.executors import compute_parts
from tests.faults.kills import TINY
from tests.runs.clusters import ROOT, FakeWork, check, outcomes, parts, pool, scheduler_and_workers, wait_until

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="signals of POSIX systems")


def slow(number: int) -> None:
    time.sleep(0.1)


def test_a_worker_is_killed_and_replaced():
    with pool() as started, started.computing(FakeWork(slow)) as one:
        client, done = started.client, {}
        killed = min(client.run(os.getpid).values())
        for outcome in compute_parts(one, parts(40)):
            done[outcome.part.name] = outcome
            if len(done) == 2:
                os.kill(killed, signal.SIGKILL)
        wait_until(lambda: len(client.nthreads()) == 2)
        assert killed not in client.run(os.getpid).values()
    assert len(done) == 40
    check(done)


def test_a_part_beside_one_that_kills_its_workers_is_tried_alone(tmp_path):
    """The one kills its worker twice; those that were in the queue of the worker then are not to blame."""

    def kill(number: int) -> None:
        if number:
            time.sleep(0.3)  # in the queue of the worker, or at work in it, when that dies
        elif len(deaths := list(tmp_path.iterdir())) < 2:
            (tmp_path / str(len(deaths))).touch()
            os.kill(os.getpid(), signal.SIGKILL)

    with pool(workers=1) as started:
        done = outcomes(started, parts(3), FakeWork(kill))
    assert len(done) == 3
    check(done)


@pytest.mark.parametrize("moment", ["before the first part", "between parts"])
def test_a_lost_scheduler(moment, tmp_path, capfd):
    with (
        scheduler_and_workers(tmp_path) as (address, scheduler),
        pool(address) as started,
        started.computing(FakeWork(slow)) as one,
    ):
        flow = compute_parts(one, parts(300))
        first = moment == "before the first part"
        if not first:
            assert next(flow).error is None
        threading.Timer(0.3 if first else 0.0, scheduler.kill).start()
        before = time.monotonic()
        with pytest.raises(RunInterrupted, match=f"the scheduler of {address} is gone; the parts that were done are"):
            for _ in flow:
                pass
        assert time.monotonic() - before < 8
    assert "Traceback" not in capfd.readouterr().err


LOCAL = {"execution": {"scheduler": "distributed", "workers": 2}}
SCRIPT = """
import sys, time
from tests.faults.kills import TINY
from tests.runs.clusters import FakeWork, compute_parts, parts, pool

if __name__ == "__main__":
    from heliosweep.runs.signals import interruptible
    try:
        with interruptible(), pool() as started, started.computing(FakeWork(lambda number: time.sleep(0.3))) as one:
            for outcome in compute_parts(one, parts(1000)):
                print(outcome.part.name, flush=True)
    except KeyboardInterrupt:
        sys.exit(4)
"""


@contextmanager
def script_that_computes(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """A script with a local cluster, in a session of its own, when its first part is done."""
    (folder / "script.py").write_text(SCRIPT)
    (folder / "scratch").mkdir()
    path = os.pathsep.join([str(ROOT), *filter(None, sys.path)])
    environment = {**os.environ, "PYTHONPATH": path, "TMPDIR": str(folder / "scratch")}
    pipes: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    command = [sys.executable, "script.py"]
    with subprocess.Popen(command, cwd=folder, env=environment, start_new_session=True, **pipes) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith("points-")
            yield process
        finally:
            process.kill()


def test_a_folder_for_temporary_files_too_long_for_sockets(tmp_path):
    folder = tmp_path / ("x" * 90)
    folder.mkdir()
    with script_that_computes(folder):
        pass


def alive(group: int) -> bool:
    """Whether a group of processes has any left."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@contextmanager
def running(folder: Path, *arguments: str, stdin: int | None = None, **blocks: Any) -> Iterator[subprocess.Popen[str]]:
    """A run with a local cluster, in a session of its own, of which nothing is left afterwards."""
    (folder / "study.yaml").write_text(yaml.safe_dump({**TINY, **LOCAL, **blocks}))
    words = ["-m", "heliosweep", "run", *arguments, "--output", str(folder / "out"), "--no-report", "-q"]
    with subprocess.Popen(
        [sys.executable, *words], cwd=folder, stdin=stdin, stderr=subprocess.PIPE, start_new_session=True, text=True
    ) as process:
        yield process
    wait_until(lambda: not alive(process.pid), 5)


def test_a_study_that_is_refused_leaves_no_process(tmp_path):
    with running(tmp_path, "study.yaml", site={"latitude": 400}) as process:
        assert "study.yaml:" in process.communicate(timeout=30)[1]
    assert process.returncode == 2


def test_a_study_from_a_pipe(tmp_path):
    with running(tmp_path, "/dev/stdin", stdin=subprocess.PIPE) as process:
        _, errors = process.communicate(yaml.safe_dump({**TINY, **LOCAL}), timeout=60)
    assert process.returncode == 0, errors
    assert (tmp_path / "out" / "result.nc").is_file()
