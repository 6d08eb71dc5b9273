"""Several runs in one process, and runs from scripts of all kinds."""

from __future__ import annotations

import json
import platform
import signal
import subprocess
import sys
from pathlib import Path

from tests.faults.kills import STUDIES, Nursery, content_of, done_parts, leftovers, wait_for, write_study

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
    for height in (60 + number, 50):  # into a folder of its own, and into that of all
        study_ = heliosweep.load({**study, "receiver": {"height": height}, "output": series})
        result = heliosweep.run(study_, f"out{height}", report=False)
        with result.open() as data:
            assert data.load().sizes["latitude"] == 2

with ThreadPoolExecutor(4) as pool:
    list(pool.map(work, range(4)))
""",
    )
    assert done.returncode == 0, done.stderr
    assert [folder.name for folder in sorted(tmp_path.glob("out*"))] == ["out50", "out60", "out61", "out62", "out63"]
    assert not any(leftovers(folder) for folder in tmp_path.glob("out*"))


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


def test_two_processes(nursery, tmp_path):
    """The second says whom it waits for, then finds the result, or takes over what a killed one has done."""
    study = write_study(tmp_path, STUDIES["field"])
    command = ["run", str(study), "-q", "--no-report", "--output", str(tmp_path / "out")]
    (tmp_path / "b").mkdir()
    first = nursery
    slow = "import time\nfrom heliosweep.store.parts import PartStore\nc = PartStore.commit\n"
    slow += "PartStore.commit = lambda *said: (time.sleep(0.02), c(*said))"
    with Nursery(tmp_path / "b") as second:
        peace = second.run([*command[:-1], str(tmp_path / "peace")])  # which also loads what is loaded late
        pid = first.start(command, setup=slow)
        wait_for(lambda: len(done_parts(tmp_path / "out")) > 3)
        assert json.loads((tmp_path / "out/.heliosweep.lock").read_text())["process"] == pid
        # As of a run in another namespace of processes, whose numbers say nothing here.
        unfinished = tmp_path / "out" / f".result.nc.{platform.node()}.999999999-abcdef-0.part"
        unfinished.touch()
        second.start(command)
        wait_for(lambda: "is at work in" in second.log())
        assert unfinished.exists()
        assert second.log().startswith(f"process {pid} on ")
        second.signal(signal.SIGTERM, "process")  # who waits can give up
        assert second.end().code == 4
        assert (tmp_path / "out/.heliosweep.lock").exists()
        second.start(command)
        wait_for(lambda: "is at work in" in second.log())
        first.signal()
        killed = first.end()
        done = done_parts(tmp_path / "out")
        again = second.end()
        assert killed.code == -signal.SIGKILL
        assert again.code == 0, again.errors
        assert not set(again.begun) & set(done)
        third = second.run(command)
        assert (peace.code, third.code, third.begun) == (0, 0, [])
        assert "is complete already" in third.errors
    assert content_of(tmp_path / "out") == content_of(tmp_path / "peace")
    assert not leftovers(tmp_path / "out")
