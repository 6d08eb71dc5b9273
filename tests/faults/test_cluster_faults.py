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

import numpy as np
import pytest

from heliosweep.errors import RunInterrupted
from heliosweep.runtime.work import Work
from tests.runtime.clusters import ROOT, check, engine, outcomes, scheduler_and_workers, wait_until, work

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="signals of POSIX systems")


def slow(block: np.ndarray) -> np.ndarray:
    time.sleep(0.1)
    return block


def test_a_worker_is_killed_and_replaced():
    with engine() as started:
        client = started._client  # type: ignore[attr-defined]
        pids = set(client.run(os.getpid).values())
        killed = 0
        for number, outcome in enumerate(started.run(work(number, slow, blocks=6) for number in range(8))):
            check(outcome, blocks=6)
            if number == 1:
                os.kill(killed := min(pids), signal.SIGKILL)
        wait_until(lambda: len(client.nthreads()) == 2)
        assert killed not in client.run(os.getpid).values()


def test_a_part_that_kills_its_workers():
    def kill(block: np.ndarray) -> np.ndarray:
        if block[0] == 203:
            os.kill(os.getpid(), signal.SIGKILL)
        return block

    with engine() as started:
        done = outcomes(started, (work(number, kill, blocks=4) for number in range(6)))
    assert len(done) == 6
    assert done[2].values is None
    assert str(done[2].error).startswith("its worker died 3 times; there may be too little memory: raise execution.mem")
    for number in (0, 1, 3, 4, 5):
        check(done[number], blocks=4)


def test_a_part_beside_one_that_kills_its_workers_is_tried_alone(tmp_path):
    """Both have failed three times then, and both would succeed at the fourth."""

    def kill(block: np.ndarray) -> np.ndarray:
        if block[0] >= 100:
            time.sleep(0.3)  # in the queue of the worker, or at work in it, when that dies
        elif len(deaths := list(tmp_path.iterdir())) < 3:
            (tmp_path / str(len(deaths))).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return block

    with engine(workers=1) as started:
        done = outcomes(started, (work(number, kill, blocks=1) for number in range(3)))
    for number in range(3):
        check(done[number], blocks=1)


@pytest.mark.parametrize("moment", ["before the first part", "between parts"])
def test_a_lost_scheduler(moment, tmp_path, capfd):
    with scheduler_and_workers(tmp_path) as (address, scheduler), engine(address) as started:
        flow = started.run(work(number, slow, blocks=6) for number in range(50))
        first = moment == "before the first part"
        if not first:
            assert next(flow).error is None
        killer = threading.Timer(0.3 if first else 0.0, scheduler.kill)
        killer.start()
        before = time.monotonic()
        with pytest.raises(RunInterrupted, match=f"the scheduler of {address} is gone; the parts that were done are"):
            for _ in flow:
                pass
        assert time.monotonic() - before < 8
    assert "Traceback" not in capfd.readouterr().err


SCRIPT = """
import os, sys, time
from tests.runtime.clusters import engine, work

def slow(block):
    time.sleep(0.3)
    return block

if __name__ == "__main__":
    from heliosweep.runtime.signals import interruptible
    try:
        with interruptible(), engine() as started:
            for outcome in started.run(work(number, slow) for number in range(1000)):
                print(outcome.part.name, flush=True)
    except KeyboardInterrupt:
        sys.exit(4)
"""


@contextmanager
def script_that_computes(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """A script with a local cluster, in a session of its own, when its first part is done."""
    (folder / "script.py").write_text(SCRIPT)
    (folder / "scratch").mkdir()
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(folder / "scratch")}
    command, pipe = [sys.executable, "script.py"], subprocess.PIPE
    with subprocess.Popen(
        command, cwd=folder, env=environment, start_new_session=True, text=True, stdout=pipe, stderr=pipe
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith("points-")
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("number", ["SIGINT", pytest.param("SIGHUP", marks=pytest.mark.long)])
def test_interrupted_on_a_terminal(number, tmp_path):
    """Every process of the terminal gets the signal: the client alone acts on it."""
    with script_that_computes(tmp_path) as process:
        os.killpg(process.pid, getattr(signal, number))
        before = time.monotonic()
        _, errors = process.communicate(timeout=30)
    assert time.monotonic() - before < 5
    assert process.returncode == 4
    assert errors == ""
    wait_until(lambda: not alive(process.pid), 5)
    assert not list((tmp_path / "scratch").iterdir())
    assert {path.name for path in tmp_path.iterdir()} == {"script.py", "scratch"}


def test_a_folder_for_temporary_files_too_long_for_sockets(tmp_path):
    folder = tmp_path / ("x" * 90)
    folder.mkdir()
    with script_that_computes(folder):
        pass


@pytest.mark.long
def test_the_client_is_killed(tmp_path):
    """Nothing of a local cluster outlives its client."""
    with script_that_computes(tmp_path) as process:
        process.kill()
    wait_until(lambda: not alive(process.pid), 15)


def alive(group: int) -> bool:
    """Whether a group of processes has any left."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.long
def test_many_workers_are_killed():
    """A worker dies now and then: all parts come through, for none is to blame."""
    stop = threading.Event()

    def works() -> Iterator[Work]:
        yield from (work(number, slow, blocks=10) for number in range(20))

    with engine() as started:
        client = started._client  # type: ignore[attr-defined]

        def kill() -> None:
            for _ in range(5):
                if stop.wait(4.0):
                    return
                for pid in list(client.run(os.getpid, on_error="ignore").values())[:1]:
                    os.kill(pid, signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        done = outcomes(started, works())
        stop.set()
        killer.join()
    assert all(outcome.error is None for outcome in done.values())
    assert len(done) == 20


STUDY = """
family: dish_tracking
site: {latitude: 40, longitude: 0}
time:
  {clock: civil, timezone: "+00:00", dates: [2021-03-20], window: {start: "07:00", stop: "17:00", step: 30 min}}
mount: {model: rigid}
errors: {axis_tilt: [0.05, 0.1], axis_tilt_direction: [0, 90]}
tolerance: 4 mrad
execution: {scheduler: distributed, workers: 2}
"""


def command(folder: Path, *arguments: str, **options: Any) -> subprocess.Popen[str]:
    """A run of the study, in a session of its own."""
    words = [
        sys.executable,
        "-m",
        "heliosweep",
        "run",
        *arguments,
        "--output",
        str(folder / "out"),
        "--no-report",
        "-q",
    ]
    pipe = subprocess.PIPE
    return subprocess.Popen(words, cwd=folder, text=True, stdout=pipe, stderr=pipe, start_new_session=True, **options)


@pytest.mark.parametrize("delay", [0.4, 0.8, 1.2, 1.6])
def test_interrupted_while_workers_are_got_ready(delay, tmp_path):
    (tmp_path / "study.yaml").write_text(STUDY)
    with command(tmp_path, "study.yaml") as process:
        time.sleep(delay)
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=30)
    assert "Traceback" not in errors
    wait_until(lambda: not alive(process.pid), 5)


def test_a_study_that_is_refused_leaves_no_process(tmp_path):
    (tmp_path / "study.yaml").write_text(STUDY.replace("latitude: 40", "latitude: 400"))
    with command(tmp_path, "study.yaml") as process:
        _, errors = process.communicate(timeout=30)
        assert process.returncode == 2
        assert "study.yaml:3:" in errors
    wait_until(lambda: not alive(process.pid), 5)


def test_a_study_from_a_pipe(tmp_path):
    with command(tmp_path, "/dev/stdin", "--scheduler", "distributed", stdin=subprocess.PIPE) as process:
        _, errors = process.communicate(STUDY, timeout=60)
    assert process.returncode == 0, errors
    assert (tmp_path / "out" / "result.nc").is_file()
