"""Why something could not be written."""

from __future__ import annotations

import errno
import os
import re
import subprocess
import sys
from types import SimpleNamespace

import pytest

from heliosweep.store import full
from heliosweep.store.full import why_not_written

#: A result that is larger than files may be.
_SCRIPT = """
import resource, sys
from pathlib import Path
from tests.store.samples import write_netcdf
import tests.store.samples as samples
resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, resource.RLIM_INFINITY))
try:
    write_netcdf(Path(sys.argv[1]) / "result.nc")
except Exception as error:
    print(type(error).__name__, error)
"""


@pytest.fixture
def free(monkeypatch):
    """Set the room on the disk."""
    return lambda size: monkeypatch.setattr(full.shutil, "disk_usage", lambda _: SimpleNamespace(free=size))


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), RuntimeError("NetCDF: HDF error")])
def test_a_full_disk(tmp_path, free, error):
    free(4096)
    assert why_not_written(tmp_path / "a", error) == f"{tmp_path / 'a'}: cannot be written: disk full (4.1 kB free)"


def test_what_the_system_says(tmp_path, free):
    free(10**10)
    path = tmp_path / "missing" / "a"
    said = why_not_written(path, OSError(errno.EACCES, "Permission denied"))
    assert said == f"{path}: cannot be written: Permission denied (10.0 GB free)"


def test_a_limit_on_files_that_can_be_the_cause(tmp_path, free, monkeypatch):
    resource = pytest.importorskip("resource")
    free(10**10)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (512_000, 512_000))
    for error in (OSError(errno.EFBIG, "File too large"), RuntimeError("NetCDF: HDF error"), OSError(-101, "HDF")):
        assert "(10.0 GB free, files of at most 512 kB by ulimit -f)" in why_not_written(tmp_path, error)
    assert "ulimit" not in why_not_written(tmp_path, OSError(errno.EACCES, "Permission denied"))


def test_a_result_larger_than_files_may_be(tmp_path):
    pytest.importorskip("resource")
    done = subprocess.run(
        [sys.executable, "-c", _SCRIPT, str(tmp_path)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in ("", *sys.path) if path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert re.match(r"HeliosweepError .*result\.nc: cannot be written: .*at most 10\.0 kB by ulimit -f\)", done.stdout)
    assert not list(tmp_path.iterdir())
