"""Files written whole: names of their own until then, none left of dead processes, and why one was not written."""

import errno
import os
import platform
import re
import subprocess
import sys
from types import SimpleNamespace

import pytest

from heliosweep import files
from heliosweep.errors import HeliosweepError
from heliosweep.files import remove_leftovers, why_not_written, write_rows, write_whole, written_whole


def test_only_what_a_dead_process_of_this_machine_left_is_removed(tmp_path):
    program = (
        "import sys; from pathlib import Path; from heliosweep.files import temporary_name\n"
        "print(temporary_name(Path(sys.argv[1])))"
    )
    dead = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "result.nc")], capture_output=True, text=True, check=True
    ).stdout.strip()
    host = platform.node()
    kept = {
        f".result.nc.{host}.{os.getppid()}-0.part",
        f".result.nc.another-{host}.999999999-0.part",
        f".result.nc.{host}.word-0.part",
        "result.nc",
    }
    for name in (*kept, dead):
        (tmp_path / name).touch()
    remove_leftovers(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == kept


@pytest.fixture
def free(monkeypatch):
    """Set the room on the disk."""
    return lambda size: monkeypatch.setattr(files.shutil, "disk_usage", lambda _: SimpleNamespace(free=size))


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), RuntimeError("NetCDF: HDF error")])
def test_a_full_disk(tmp_path, free, error):
    free(4096)
    assert why_not_written(tmp_path / "a", error) == f"{tmp_path / 'a'}: cannot be written: disk full (4.1 kB free)"


def test_what_the_system_says(tmp_path, free):
    path = tmp_path / "missing" / "a.txt"
    with pytest.raises(HeliosweepError, match=r"a\.txt: cannot be written: No such file or directory"):
        write_whole(path, "")
    free(10**10)
    said = why_not_written(path, OSError(errno.EACCES, "Permission denied"))
    assert said == f"{path}: cannot be written: Permission denied (10.0 GB free)"


def test_a_file_takes_the_place_of_another_when_it_is_complete(tmp_path):
    path = tmp_path / "a.txt"
    write_whole(path, "one \udc80")
    assert path.read_bytes() == b"one \\udc80"
    with written_whole(path) as temporary:
        temporary.write_bytes(b"two")
        assert path.read_bytes() == b"one \\udc80"
    assert path.read_bytes() == b"two"
    write_rows([("a", "b,c"), (1, 0.1)], path)
    assert path.read_bytes() == b'a,"b,c"\n1,0.1\n'
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("error", "raised", "said"),
    [
        (OSError(errno.EIO, "Input/output error"), HeliosweepError, "a.txt: cannot be written: Input/output error ("),
        (KeyboardInterrupt("now"), KeyboardInterrupt, "now"),
    ],
)
def test_nothing_is_left_of_a_file_that_failed(tmp_path, error, raised, said):
    path = tmp_path / "a.txt"
    write_whole(path, b"before")

    def fail():
        with written_whole(path) as temporary:
            temporary.write_bytes(b"half")
            raise error

    with pytest.raises(raised, match=re.escape(said)):
        fail()
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]
