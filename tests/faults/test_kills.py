"""Killed runs, full disks and other users: nothing is lost, and the bytes are those of an undisturbed run."""

import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest

from heliosweep import api
from heliosweep.errors import HeliosweepError
from tests.conftest import SMALL

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals")

#: 48 parts of some 30 ms each.
_HOURS = {"start": 7, "stop": 17, "step": 0.02}
STUDY: dict[str, Any] = {
    **SMALL,
    "site": {"latitude": [0, 10, 20, 30]},
    "time": {**SMALL["time"], "days": {"start": 1, "stop": 365, "step": 60}, "hours": _HOURS},
}
CHUNKS = {"latitude": 1, "tracking": 1, "heliostat": 7}


@pytest.fixture(scope="module")
def expected(tmp_path_factory) -> bytes:
    return api.run(STUDY, tmp_path_factory.mktemp("peace") / "out", report=False).path.read_bytes()


def write_study(folder: Path, scheduler: str) -> Path:
    execution = {"scheduler": scheduler, "workers": 2, "chunks": CHUNKS}
    path = folder / "study.yaml"
    path.write_text(api.load({**STUDY, "execution": execution}).to_yaml(folder), encoding="utf-8")
    return path


def start(study: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "heliosweep", "run", str(study), "-o", str(study.parent / "out"), "--no-report"]
    return subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL, process_group=0)


def stored(folder: Path) -> set[str]:
    return {path.name for path in folder.glob("out/chunks-*/*.npz")}


def wait_for_parts(process: subprocess.Popen[bytes], folder: Path, count: int) -> None:
    last = time.monotonic() + 900
    while process.poll() is None and len(stored(folder)) < count:
        assert time.monotonic() < last
        time.sleep(0.003)


@pytest.mark.parametrize(
    ("scheduler", "target", "kills"),
    [
        ("threads", "process", 1),
        ("processes", "worker", 1),
        pytest.param("threads", "group", 2, marks=pytest.mark.long),
        pytest.param("processes", "process", 2, marks=pytest.mark.long),
        pytest.param("processes", "group", 2, marks=pytest.mark.long),
    ],
)
def test_killed_runs_lose_nothing(tmp_path, expected, scheduler, target, kills):
    study, draw = write_study(tmp_path, scheduler), random.Random(f"{scheduler} {target}")
    for _ in range(kills):
        process, before = start(study), stored(tmp_path)
        wait_for_parts(process, tmp_path, len(before) + draw.randint(1, 10))
        time.sleep(draw.random() / 50)
        workers = list[psutil.Process]()
        with suppress(psutil.NoSuchProcess):  # the run is over
            children = psutil.Process(process.pid).children(recursive=True)
            workers += [worker for worker in children if "spawn_main" in " ".join(worker.cmdline())]
            for worker in workers[: target == "worker"]:
                worker.kill()
        if target == "worker":
            break  # the run goes on with new workers
        if process.poll() is None:
            (os.killpg if target == "group" else os.kill)(process.pid, signal.SIGKILL)
        process.wait(900)
        assert before <= stored(tmp_path) or (tmp_path / "out" / "result.nc").exists()
        _, alive = psutil.wait_procs(workers, timeout=900)
        assert not alive
    else:
        process = start(study)
    assert process.wait(900) == 0
    assert (tmp_path / "out" / "result.nc").read_bytes() == expected
    assert not [*(tmp_path / "out").glob(".*.part")]


#: Runs a study up to the writing of its result, so that a signal is never too late.
_UNFINISHED = """
import sys, time
from heliosweep.cli import main
from heliosweep.store import writer
writer.write_result = lambda *_: time.sleep(900)
sys.exit(main())
"""


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
def test_interrupted_runs_say_how_to_resume(tmp_path, expected, number):
    study = write_study(tmp_path, "threads")
    arguments = ["run", str(study), "-o", str(tmp_path / "out"), "--no-report", "-q"]
    process = subprocess.Popen([sys.executable, "-c", _UNFINISHED, *arguments], stderr=subprocess.PIPE, text=True)
    wait_for_parts(process, tmp_path, 2)  # type: ignore[arg-type]
    process.send_signal(number)
    _, messages = process.communicate(timeout=900)
    assert process.returncode == 4
    assert "chunks are complete and stored in" in messages
    assert "run the same command again to resume" in messages
    assert subprocess.run([sys.executable, "-m", "heliosweep", *arguments], check=False).returncode == 0
    assert (tmp_path / "out" / "result.nc").read_bytes() == expected


@pytest.fixture
def small_disk(tmp_path) -> Iterator[Path]:
    """A disk of 100 kB."""
    place = tmp_path / "disk"
    place.mkdir()
    try:
        mount = ["mount", "-t", "tmpfs", "-o", "size=100k", "none", str(place)]
        subprocess.run(mount, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("may not mount here")
    yield place
    subprocess.run(["umount", "--lazy", str(place)], check=True)


def test_a_full_disk_is_one_line_and_the_run_resumes(small_disk, tmp_path, monkeypatch, expected):
    monkeypatch.setattr("heliosweep.grid.plan._free_disk", lambda _: 2**40)  # it fills up after the plan
    study = api.load({**STUDY, "execution": {"chunks": CHUNKS}})
    messages: list[str] = []
    for size in (100, 150, 200, 250):
        subprocess.run(["mount", "-o", f"remount,size={size}k", str(small_disk)], check=True)
        try:
            api.run(study, small_disk / "out", report=False)
        except HeliosweepError as error:
            messages.append(str(error))
            assert not (small_disk / "out" / "result.nc").exists()
            assert not [*(small_disk / "out").glob(".*.part")]
    subprocess.run(["mount", "-o", "remount,size=9m", str(small_disk)], check=True)
    assert len(messages) >= 2
    assert all(re.fullmatch(r".*: cannot be written: .* \(.* free\)", message) for message in messages)
    assert api.run(study, small_disk / "out", report=False).path.read_bytes() == expected


#: A second user, with the certificates of a cluster of their own, or none.
_STRANGER = """
import os, sys
from distributed import Client, Security
address, security = sys.argv[1], Security.temporary()
os.setgid(65534); os.setuid(65534)
for place, how in ((address, security), (address.replace("tls", "tcp"), None)):
    try:
        with Client(place, security=how, timeout=3) as client:
            print("submitted", client.submit(os.getuid).result(timeout=3))
    except Exception as error:
        print(type(error).__name__)
"""


@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="needs a second user")
def test_a_second_user_cannot_submit_to_a_local_cluster():
    from heliosweep.config.blocks import Execution
    from heliosweep.runs.run import connected

    with connected(Execution(scheduler="distributed"), 1) as client:
        address = client.scheduler_info()["address"]
        assert address.startswith("tls://127.0.0.1")
        done = subprocess.run(
            [sys.executable, "-c", _STRANGER, address], capture_output=True, text=True, timeout=900, check=True
        )
    assert len(done.stdout.splitlines()) == 2
    assert "submitted" not in done.stdout
