"""Folders of clusters: none is left, also of a run that was killed."""

from __future__ import annotations

import os
import platform
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from heliosweep.runtime.scratch import scratch, sweep


@pytest.fixture
def temporary(tmp_path, monkeypatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_gone_at_the_end(temporary):
    with scratch() as first, scratch() as second:
        sweep()
        assert sorted(path.name for path in temporary.iterdir()) == sorted(map(os.path.basename, (first, second)))
    assert not list(temporary.iterdir())


@pytest.mark.skipif(os.name != "posix", reason="no such signal")
def test_a_killed_process_leaves_none_for_long(temporary):
    program = (
        "import os, signal\nfrom pathlib import Path\nfrom heliosweep.runtime.scratch import scratch\n"
        "with scratch() as folder:\n    Path(folder, 'a').mkdir()\n    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    environment = {**os.environ, "TMPDIR": str(temporary)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, check=False)
    assert done.returncode == -signal.SIGKILL
    assert len(list(temporary.iterdir())) == 1
    with scratch() as folder:
        assert [str(path) for path in temporary.iterdir()] == [folder]


def test_what_is_of_others_stays(temporary):
    host = platform.node()
    (temporary / "elsewhere").mkdir()
    (temporary / "elsewhere" / "a").touch()
    kept = [
        f"heliosweep-{host}-{os.getppid()}-abc",
        f"heliosweep-other{host}-999999999-abc",
        "heliosweep-abc",
        "elsewhere",
    ]
    for name in kept[:-1]:
        (temporary / name).mkdir()
    (temporary / f"heliosweep-{host}-999999999-link").symlink_to("elsewhere")
    (temporary / f"heliosweep-{host}-999999999-file").touch()
    (temporary / f"heliosweep-{host}-999999999-gone").mkdir()
    (temporary / f"heliosweep-{host}-{os.getpid()}-earlier").mkdir()  # of another process that had this number
    sweep()
    left = {path.name for path in temporary.iterdir()}
    assert left == {*kept, f"heliosweep-{host}-999999999-link", f"heliosweep-{host}-999999999-file"}
    assert (temporary / "elsewhere" / "a").exists()
