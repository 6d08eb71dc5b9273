"""A disk that fills up, or a quota, in the middle of a run: a message, exit code 1 and nothing left."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from heliosweep import workflow
from heliosweep.errors import HeliosweepError
from heliosweep.kernels.warm import warm_field
from tests.conftest import SMALL

HOURS = {"start": 7, "stop": 17, "step": 0.05}
BLOCKS = {"time": {**SMALL["time"], "hours": HOURS}, "output": {"time_series": True}}


@pytest.fixture
def small_disk(tmp_path) -> Iterator[Path]:
    """A disk of 1 MB."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "none", str(place)]
    try:
        subprocess.run(mount, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("may not mount here")
    yield place
    subprocess.run(["umount", "--lazy", str(place)], check=True)  # the library keeps open what it could not close


def test_full_disk(small, small_disk, monkeypatch):
    monkeypatch.setattr("heliosweep.grid.limits._free_disk", lambda _: 2**40)  # it fills up after the plan
    with pytest.raises(HeliosweepError, match=r"new/out/result\.nc: cannot be written: disk full \(.*B free\)"):
        workflow.run(small(**BLOCKS), small_disk / "new/out", report=False)
    assert list(small_disk.iterdir()) == []


def test_largest_file_size(tmp_path):
    resource = pytest.importorskip("resource")
    study = tmp_path / "study.yaml"
    study.write_text(yaml.safe_dump({**SMALL, **BLOCKS}))
    warm_field()  # or the compiler's cache is what grows too large
    done = subprocess.run(
        [sys.executable, "-m", "heliosweep", "run", "study.yaml", "--no-report", "--output", "new/out"],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (500_000, 500_000)),
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("new/out/result.nc: cannot be written: ")
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == [study]
