"""Pipes, devices and links where files belong, and file systems without locks or hard links."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from heliosweep import api
from heliosweep.cli import main
from heliosweep.errors import RunInterrupted, StudyError
from heliosweep.runs.status import status_of
from tests.faults.kills import TINY
from tests.faults.stopped import after_parts, interrupt

STUDY = {**TINY, "receiver": {"height": [60, 70]}}
#: Answers of a file system without locks, with and without hard links: what the libraries call, replaced.
NO_LOCKS = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
int flock(int descriptor, int operation) { errno = ENOLCK; return -1; }
int link(const char *from, const char *to) { errno = EPERM; return -1; }
int linkat(int a, const char *from, int b, const char *to, int flags) { errno = EPERM; return -1; }
int answer(const char *name, int descriptor, int command, void *argument) {
    if (command == F_SETLK || command == F_SETLKW) { errno = ENOLCK; return -1; }
    return ((int (*)(int, int, void *))dlsym(RTLD_NEXT, name))(descriptor, command, argument);
}
int fcntl(int descriptor, int command, ...) {
    va_list list; va_start(list, command); void *argument = va_arg(list, void *); va_end(list);
    return answer("fcntl", descriptor, command, argument);
}
int fcntl64(int descriptor, int command, ...) {
    va_list list; va_start(list, command); void *argument = va_arg(list, void *); va_end(list);
    return answer("fcntl64", descriptor, command, argument);
}
"""


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    place: Path = tmp_path_factory.mktemp("whole")
    (place / "study.yaml").write_text(yaml.safe_dump(STUDY))
    api.run(place / "study.yaml", place / "out")
    return place


@pytest.fixture
def folder(whole, tmp_path, monkeypatch) -> Path:
    """A folder with a study and its finished result, of its own."""
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


RUN = ["run", "study.yaml", "-o", "out"]
OTHERS = [
    ["verify", "out"],
    ["report", "out"],
    ["compare", "out", "out"],
    ["export", "out", "--csv", "t.csv", "--variable", "cosine_efficiency"],
    ["pack", "out", "--draft"],
]


@pytest.mark.parametrize("device", ["pipe", "zero"])
@pytest.mark.parametrize("name", ["result.nc", "manifest.json", "study.resolved.yaml", "report.html", "figures/a.png"])
def test_what_is_no_file_is_refused_and_never_waited_for(folder, capsys, name, device):
    place = folder / "out" / name
    place.unlink(missing_ok=True)
    if device == "pipe":
        os.mkfifo(place)
    else:
        place.symlink_to("/dev/zero")
    for command in (RUN, *OTHERS):
        assert main(command) in (1, 2), command
        said = capsys.readouterr()
        assert f"{name}: is a pipe, a socket or a device, and no file" in said.out + said.err, command
    assert status_of(folder / "out").state == "damaged"


@pytest.mark.parametrize("name", ["values.bin", "journal.jsonl", "study.json"])
def test_nor_in_an_unfinished_run(folder, monkeypatch, capsys, name):
    with monkeypatch.context() as patch:
        after_parts(patch, 1, interrupt)
        with pytest.raises(RunInterrupted):
            api.run("study.yaml", "half")
    (folder / "half/working" / name).unlink()
    os.mkfifo(folder / "half/working" / name)
    for command in ([*RUN[:-1], "half"], [*RUN[:-1], "half", "--force"], ["verify", "half"]):
        assert main(command) in (1, 2)
        said = capsys.readouterr()
        assert f"{name}: is a pipe" in said.out + said.err
    assert status_of(folder / "half").state == "damaged"


@pytest.mark.parametrize(
    ("link", "said"), [("symlink_to", "is a link, and no file of a run"), ("hardlink_to", "is another file too")]
)
def test_the_claim_follows_no_link_nor_takes_a_file_with_another_name(folder, capsys, link, said):
    (folder / "precious").write_text("mine")
    (folder / "new").mkdir()
    getattr(folder / "new/.heliosweep.lock", link)(folder / "precious")
    assert main(["run", "study.yaml", "-o", "new"]) == 2
    assert f"new/.heliosweep.lock: {said}" in capsys.readouterr().err
    assert (folder / "precious").read_text() == "mine"


@pytest.mark.parametrize("name", ["values.bin", "journal.jsonl", "study.json", ""])
def test_parts_are_not_written_through_a_link(folder, monkeypatch, capsys, name):
    with monkeypatch.context() as patch:
        after_parts(patch, 1, interrupt)
        with pytest.raises(RunInterrupted):
            api.run("study.yaml", "half")
    place = folder / "half/working" / name
    place.rename(folder / "precious")
    before = (folder / "precious").read_bytes() if name else b""
    place.symlink_to(folder / "precious")
    assert main([*RUN[:-1], "half"]) == 2
    assert f"half/working{name and '/' + name}: is a link, and no file of a run" in capsys.readouterr().err
    assert not name or (folder / "precious").read_bytes() == before


def test_what_else_lies_in_the_folder_is_nobodys_business(folder):
    (folder / "new/.gnupg").mkdir(parents=True)
    os.mkfifo(folder / "new/.gnupg/pipe")
    os.mkfifo(folder / "new/pipe")
    assert main(["run", "study.yaml", "-o", "new"]) == 0


def test_figures_do_not_follow_a_link(folder, capsys):
    (folder / "mine").mkdir()
    (folder / "mine/precious.png").write_text("mine")
    shutil.rmtree(folder / "out/figures")
    (folder / "out/figures").symlink_to(folder / "mine")
    assert main(["report", "out"]) == 2
    assert "figures: is a link, and no folder of a run" in capsys.readouterr().err
    assert [path.name for path in (folder / "mine").iterdir()] == ["precious.png"]


def no_locks(*_: object, **__: object) -> bool:
    raise OSError(errno.ENOLCK, "No locks available")


def test_without_locks_or_hard_links(folder, monkeypatch):
    """In Python, HDF5 must be told before it starts; the command does so."""
    monkeypatch.setattr("filelock.lock_descriptor", no_locks)
    monkeypatch.setattr(os, "link", no_locks)
    monkeypatch.delenv("HDF5_USE_FILE_LOCKING", raising=False)
    assert api.run({**STUDY, "output": {"format": "zarr"}}, "zarr", report=False).path.exists()  # needs none
    with pytest.raises(StudyError, match=r"new: has no locks .*: set HDF5_USE_FILE_LOCKING=FALSE in the environment"):
        api.run("study.yaml", "new")
    assert not (folder / "new").exists()
    monkeypatch.setenv("HDF5_USE_FILE_LOCKING", "FALSE")
    assert api.run(STUDY, "netcdf", report=False).path.exists()


@pytest.mark.parametrize("form", ["netcdf", "zarr"])
def test_a_file_system_without_locks_and_hard_links(folder, form):
    (folder / "locks.c").write_text(NO_LOCKS)
    compiler = shutil.which("cc") or pytest.skip("no compiler")
    subprocess.run([compiler, "-shared", "-fPIC", "-o", "locks.so", "locks.c", "-ldl"], cwd=folder, check=True)
    (folder / "study.yaml").write_text(yaml.safe_dump({**STUDY, "output": {"format": form}}))
    command = Path(sys.executable).with_name("heliosweep")
    for arguments in (["run", "study.yaml", "-o", "new", "-q"], ["verify", "new"], ["report", "new"]):
        environment = {**os.environ, "LD_PRELOAD": str(folder / "locks.so")}
        environment.pop("HDF5_USE_FILE_LOCKING", None)
        done = subprocess.run([command, *arguments], capture_output=True, text=True, env=environment, check=False)
        assert done.returncode == 0, done.stderr
