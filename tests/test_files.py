"""Files written whole: names of their own until then, none left of dead processes, and why one was not written."""

import errno
import os
import platform
import re
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

from heliosweep import files
from heliosweep.errors import HeliosweepError
from heliosweep.files import (
    read_once,
    remove_leftovers,
    temporary_name,
    why_not_written,
    write_rows,
    write_whole,
    written_whole,
)


def test_only_what_a_dead_process_of_this_machine_left_is_removed(tmp_path, monkeypatch):
    alive, dead = 10**9, 10**9 + 1  # larger than any number of a process
    monkeypatch.setattr(psutil, "pid_exists", lambda number: number == alive)
    own, host = temporary_name(tmp_path / "result.nc").name, platform.node()
    kept = {own.replace(f".{os.getpid()}-", f".{alive}-"), f".result.nc.another-{host}.{dead}-0.part",
            f".result.nc.{host}.word-0.part", "result.nc"}  # fmt: skip
    for name in (*kept, own, own.replace(f".{os.getpid()}-", f".{dead}-")):
        (tmp_path / name).touch()
    (tmp_path / f".result.zarr.{host}.{dead}-0.part" / "utc").mkdir(parents=True)  # of version 0.1
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


def test_outdated_files_stay_if_the_new_file_cannot_be_flushed(tmp_path, monkeypatch):
    old, path = tmp_path / "manifest.json", tmp_path / "result.nc"
    write_whole(old, "old")
    with monkeypatch.context() as patched:
        patched.setattr(files.os, "fsync", lambda _: os.open(tmp_path / "missing", os.O_RDONLY))
        with pytest.raises(HeliosweepError), written_whole(path, [old]) as temporary:
            temporary.touch()
    assert old.exists()
    with written_whole(path, [old]) as temporary:
        temporary.touch()
    assert [place.name for place in tmp_path.iterdir()] == ["result.nc"]


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


@pytest.mark.parametrize(("seconds", "texts"), [(0, ["a", "b"]), (1, ["a", "a"])])
def test_a_file_is_read_again_if_it_could_have_changed_twice_at_one_time(tmp_path, monkeypatch, seconds, texts):
    path, read, found = tmp_path / "a.txt", read_once(1)(Path.read_text), []
    monkeypatch.setattr(files.time, "time_ns", lambda: seconds * 10**9)
    for text in "ab":
        path.write_text(text)
        os.utime(path, ns=(0, 0))
        found.append(read(path))
    assert found == texts
