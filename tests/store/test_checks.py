"""Damaged results are told by name, with a remedy, by whatever reads a result that a user names; none hangs it."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import netCDF4
import pytest

from heliosweep.cli import main
from heliosweep.errors import HeliosweepError, StudyError
from heliosweep.store import checks
from tests.store.samples import digests, flip, truncate, write_folder

#: What reads results, as commands; B is what is damaged.
READERS = ["compare A B", "compare B A", "report B", "export B --csv out.csv", "table B -o out.csv"]


def empty(path: Path) -> None:
    path.write_bytes(b"")


def text(path: Path) -> None:
    path.write_text("This is no NetCDF file.")


def pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def metadata(path: Path) -> None:
    truncate(path / ".zmetadata")


def chunks(path: Path) -> None:
    for chunk in path.glob("*/[0-9]*"):
        truncate(chunk)


def superblock(path: Path) -> None:
    flip(path, 40, 6)  # the address of the root group


@pytest.fixture
def pair(tmp_path, small, monkeypatch) -> Callable[[str], Path]:
    """Two results in the working folder, named as in `READERS`; returns the second."""

    def make(result: str = "result.nc") -> Path:
        monkeypatch.chdir(tmp_path)
        write_folder(tmp_path / "A", small(), result)
        shutil.copytree(tmp_path / "A", tmp_path / "B")
        return tmp_path / "B" / result

    return make


def assert_told(capsys: pytest.CaptureFixture[str], reader: str, result: str) -> None:
    assert main(reader.split()) in (1, 2)
    said = capsys.readouterr().err
    assert f"B/{result}: is " in said
    assert "heliosweep verify B" in said
    assert "heliosweep run B/study.resolved.yaml --output B" in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("reader", "damage"),
    [
        *((READERS[number % len(READERS)], damage) for number, damage in enumerate((empty, text, folder))),
        *((reader, truncate) for reader in READERS),
    ],
)
@pytest.mark.usefixtures("_readable")
def test_damage_is_told_with_a_remedy(pair, capsys, reader, damage):
    damage(pair())
    assert_told(capsys, reader, "result.nc")


@pytest.mark.parametrize("reader", ["compare A B", "compare B A", "report B", "export B -o out.nc"])
@pytest.mark.parametrize("damage", [metadata, chunks])
def test_so_is_damage_of_groups(pair, capsys, reader, damage):
    damage(pair("result.zarr"))
    assert_told(capsys, reader, "result.zarr")


PUBLISHERS = ["report B", "export B -o out.nc", "export B --csv out.csv", "table B -o out.csv"]


@pytest.mark.parametrize("reader", [*PUBLISHERS, "compare A B --page out.html"])
def test_a_group_without_a_chunk_is_not_published(pair, capsys, reader):
    (pair("result.zarr") / "power" / "1.1.0").unlink()
    assert main(reader.split()) == 1
    said = capsys.readouterr().err
    assert re.search(r"B/result\.zarr: is damaged: slab series-\d+ .*is not what was computed", said)
    assert "heliosweep run B/study.resolved.yaml --output B" in said
    assert [*Path().glob("out.*"), *Path("B").glob("report.html")] == []


def test_a_group_of_other_bytes_and_the_same_content_is_published(pair):
    attributes = pair("result.zarr") / "power" / ".zattrs"
    attributes.write_text(attributes.read_text() + " ")
    assert main(["export", "B", "-o", "out.nc"]) == 0


@pytest.mark.parametrize("reader", ["compare A B", *PUBLISHERS, "verify B"])
@pytest.mark.parametrize("alone", [True, False])
def test_a_pipe_in_a_group_is_not_waited_for(pair, capsys, reader, alone):
    path = pair("result.zarr")
    pipe(path / "power" / "1.1.0")
    if alone:
        (path.parent / "manifest.json").unlink()
    assert main(reader.split()) in (1, 2)
    out, err = capsys.readouterr()
    assert re.search(r"power/1\.1\.0(: is a pipe.*and| is) no file", out + err)


@pytest.fixture
def _readable(monkeypatch) -> None:
    """The files of these tests can be read to their end: no process of its own is needed."""
    for module in ("heliosweep.store.checks", "heliosweep.runs.verify"):
        monkeypatch.setattr(f"{module}.check_apart", checks.check)


@pytest.mark.parametrize("damage", [truncate, empty, text, superblock])
def test_a_file_alone(pair, damage):
    path = pair()
    (path.parent / "manifest.json").unlink()
    damage(path)
    with pytest.raises(HeliosweepError, match=r"B/result\.nc: (is damaged: .*get the file anew|is no result; name)"):
        checks.sound("A", path)


def test_what_is_whole_is_read_at_once(pair, monkeypatch):
    path = pair()
    monkeypatch.setattr(checks, "check_apart", pytest.fail)
    first, second = checks.sound("A", path, as_written=True)
    assert (first, second) == (Path("A/result.nc"), path)


@pytest.mark.usefixtures("_readable")
def test_other_values_are_compared_and_not_drawn(pair):
    path = pair()
    with netCDF4.Dataset(path, "r+") as file:
        file["power"][1, 2, 3] = 7.0
    checks.sound(path)
    with pytest.raises(HeliosweepError, match=r"slab series-\d+ .*is not what was computed.*heliosweep verify"):
        checks.sound(path, as_written=True)


@pytest.mark.usefixtures("_readable")
def test_other_bytes_of_the_same_content_are_read(pair):
    path = pair()
    manifest = json.loads((path.parent / "manifest.json").read_text())
    manifest["result"]["sha256"] = "0" * 64
    (path.parent / "manifest.json").write_text(json.dumps(manifest))
    assert checks.sound(path, as_written=True) == (path,)


HANG = """
import os, pathlib, sys, threading, time

reads = threading.Event()

def tell():  # as slow as the machine may be to begin
    while not reads.wait(0.2):
        print(flush=True)

threading.Thread(target=tell, daemon=True).start()
from heliosweep.store import checks, read as module

def read(*_):
    pathlib.Path("reads").write_text(str(os.getpid()))
    reads.set()
    time.sleep(1e6)

module.Stored.read = read
sys.exit(checks.main())
"""


def test_a_reader_that_hangs_is_ended(pair, monkeypatch):
    path = pair()
    flip(path)
    monkeypatch.setattr(checks, "_READER", [sys.executable, "-c", HANG])
    monkeypatch.setattr(checks, "_PATIENCE", 3.0)
    with pytest.raises(HeliosweepError, match="cannot be read to its end: its structure is damaged"):
        checks.sound(path)
    with pytest.raises(ProcessLookupError):  # it did read, and is there no more
        os.kill(int(Path("reads").read_text()), 0)


SAY = "import sys, time\nfor _ in range(int(sys.argv[1])): print(flush=True); time.sleep(0.1)\nprint('[]')"


def test_a_reader_that_is_slow_is_waited_for(tmp_path, monkeypatch):
    """A hundred times longer than its file has bytes for, and twice as long as silence is borne."""
    (tmp_path / "20").write_bytes(b"packed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(checks, "_READER", [sys.executable, "-I", "-c", SAY])
    monkeypatch.setattr(checks, "_PATIENCE", 1.0)
    monkeypatch.setattr(checks, "_SLOWEST", 1e3)
    assert checks.check_apart(Path("20"), None) == []


def test_a_reader_of_values_without_end_is_ended(tmp_path, monkeypatch):
    (tmp_path / "1000000").write_bytes(b"damaged")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(checks, "_READER", [sys.executable, "-I", "-c", SAY])
    monkeypatch.setattr(checks, "_PATIENCE", 1.0)
    assert checks.check_apart(Path("1000000"), None) == ["cannot be read to its end: its structure is damaged"]


@pytest.mark.parametrize("known", [True, False])
def test_it_tells_of_every_piece(pair, known):
    path = pair()
    manifest = json.loads((path.parent / "manifest.json").read_text()) if known else None
    done = subprocess.run(
        [*checks._READER, str(path)], input=json.dumps(manifest), capture_output=True, text=True, check=True
    )
    *told, wrong = done.stdout.splitlines()
    assert json.loads(wrong) == []
    assert told == [""] * len(told)
    with netCDF4.Dataset(path) as file:
        least = len(file.variables)
    assert len(told) >= least + (len(digests()) if known else 0)


@pytest.mark.parametrize("result", ["result.nc", "result.zarr"])
def test_nonsense_in_attributes_is_no_traceback(pair, result):
    path = pair(result)
    (path.parent / "manifest.json").unlink()
    with pytest.raises(HeliosweepError, match="is damaged: cannot be understood"), checks.blaming_damage(path):
        raise KeyError("family")


def test_a_fault_of_the_program_is_not_blamed_on_the_result(pair):
    with pytest.raises(KeyError), checks.blaming_damage(pair()):
        raise KeyError("family")


def test_nothing_there():
    with pytest.raises(StudyError, match="no such file"):
        checks.sound("nowhere")
