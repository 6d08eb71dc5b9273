"""A disk that fills up, or a quota, in the middle of a run: a message, exit code 1, what is done kept."""

from __future__ import annotations

import errno
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from heliosweep import api
from heliosweep.errors import HeliosweepError
from heliosweep.files import why_not_written
from heliosweep.kernels.warm import warm_field
from tests.conftest import SMALL
from tests.faults.kills import SMALL_PARTS, content_of, done_parts

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


def remount(place: Path, size: int) -> None:
    subprocess.run(["mount", "-o", f"remount,size={size}", str(place)], check=True)


def test_full_disk(small, small_disk, monkeypatch):
    monkeypatch.setattr("heliosweep.grid.machine._free_disk", lambda _: 2**40)  # it fills up after the plan
    with pytest.raises(HeliosweepError, match=r"new/out/working: cannot be written: disk full \(.*B free\)"):
        api.run(small(**BLOCKS), small_disk / "new/out", report=False)
    assert [path.name for path in (small_disk / "new/out").iterdir()] == ["working"]
    assert done_parts(small_disk / "new/out")


@pytest.mark.attempts("disks", 20)
def test_full_disk_and_room_again(small, small_disk, tmp_path, monkeypatch, attempts):
    """In the store or in the result: once there is room again, the run goes on."""
    monkeypatch.setattr("heliosweep.grid.machine._free_disk", lambda _: 2**40)
    for patch in SMALL_PARTS[:2]:
        monkeypatch.setattr(*patch)
    api.run(small(**BLOCKS), tmp_path / "peace", report=False)
    for number in attempts.numbers:
        size = round(40e3 * 75 ** (number / attempts.whole))  # up to 3 MB
        with attempts.at(f"a disk of {size} bytes"):
            remount(small_disk, size)
            with pytest.raises(HeliosweepError, match=r"cannot be written: "):
                api.run(small(**BLOCKS), small_disk / "out", report=False)
            assert not list(small_disk.glob("out/result*"))
            assert not list(small_disk.glob("out/.*"))
            assert bool(done_parts(small_disk / "out")) == (small_disk / "out").exists()
            remount(small_disk, 2**25)
            api.run(small(**BLOCKS), small_disk / "out", report=False)
            assert content_of(small_disk / "out") == content_of(tmp_path / "peace")
        shutil.rmtree(small_disk / "out", ignore_errors=True)


@pytest.mark.parametrize(("scheduler", "needed"), [("threads", 32), ("processes", 64), ("distributed", 64)])
def test_too_few_open_files(tmp_path, scheduler, needed):
    resource = pytest.importorskip("resource")
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(SMALL))
    command = [sys.executable, "-m", "heliosweep", "run", "study.yaml", "--scheduler", scheduler, "--output", "out"]
    done = subprocess.run(
        command,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (20, 20)),
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("a process may have 20 files open here, ")
    assert done.stderr.endswith(f"{needed}; allow more (ulimit -n 1024) and run it again: nothing is lost\n")
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_no_file_left_while_it_writes(tmp_path):
    said = why_not_written(tmp_path / "result.nc", OSError(errno.EMFILE, "Too many open files"))
    assert "Too many open files" in said
    assert said.endswith("open files at most by ulimit -n: allow more)")


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
    (said,) = (line for line in done.stderr.splitlines() if not line.startswith("compil"))  # on a slow machine
    assert said.startswith("new/out/working: cannot be written: File too large")
    assert done_parts(tmp_path / "new/out")
