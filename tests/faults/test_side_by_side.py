"""Several runs in one process, and runs from scripts of all kinds."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

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
try:
    heliosweep.run(heliosweep.load(study), "out", report=False)
except heliosweep.HeliosweepError as error:
    print("told:", error)
""",
    )
    assert done.returncode == 0
    assert 'if __name__ == "__main__":' in done.stdout
    assert not (tmp_path / "out").exists()
