"""Damaged results are told by name, with a remedy, by whatever reads a result that a user names; none hangs it."""

from __future__ import annotations

import json
import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path

import netCDF4
import pytest

from heliosweep.cli import main
from heliosweep.errors import HeliosweepError, StudyError
from heliosweep.store import contents, sound
from tests.faults.stopped import flip, truncate
from tests.store.samples import write_folder

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


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("damage", [truncate, empty, text, pipe, superblock, folder])
def test_damage_is_told_with_a_remedy(pair, capsys, reader, damage):
    damage(pair())
    assert main(reader.split()) in (1, 2)
    said = capsys.readouterr().err
    assert "B/result.nc: " in said
    assert "heliosweep verify B" in said
    assert "heliosweep run B/study.resolved.yaml --output B" in said
    assert "Traceback" not in said


@pytest.mark.parametrize("reader", ["compare A B", "compare B A", "report B", "export B -o out.nc"])
@pytest.mark.parametrize("damage", [metadata, chunks])
def test_so_is_damage_of_groups(pair, capsys, reader, damage):
    damage(pair("result.zarr"))
    assert main(reader.split()) == 1
    said = capsys.readouterr().err
    assert "B/result.zarr: is damaged: " in said
    assert "heliosweep run B/study.resolved.yaml --output B" in said


@pytest.mark.parametrize("damage", [truncate, empty, text, pipe, superblock])
def test_a_file_alone(pair, damage):
    path = pair()
    (path.parent / "manifest.json").unlink()
    damage(path)
    with pytest.raises(HeliosweepError, match=r"B/result\.nc: (is damaged: .*get the file anew|is no result; name)"):
        sound.sound("A", path)


def test_what_is_whole_is_read_at_once(pair, monkeypatch):
    path = pair()
    monkeypatch.setattr(sound, "check_apart", pytest.fail)
    first, second = sound.sound("A", path, as_written=True)
    assert (first.path, second.path) == (Path("A/result.nc"), path)
    assert first.digest == second.digest != ""


def test_other_values_are_compared_and_not_drawn(pair):
    path = pair()
    with netCDF4.Dataset(path, "r+") as file:
        file["power"][1, 2, 3] = 7.0
    sound.sound(path)
    with pytest.raises(HeliosweepError, match=r"part series-\d+ .*is not what was computed.*heliosweep verify"):
        sound.sound(path, as_written=True)


def test_other_bytes_of_the_same_content_are_read(pair):
    path = pair()
    manifest = json.loads((path.parent / "manifest.json").read_text())
    manifest["result"]["sha256"] = "0" * 64
    (path.parent / "manifest.json").write_text(json.dumps(manifest))
    assert sound.sound(path, as_written=True)[0].path == path


def test_a_reader_that_hangs_is_ended(pair, monkeypatch):
    path = pair()
    flip(path)
    monkeypatch.setattr(contents, "_PATIENCE", 0.01)
    monkeypatch.setattr(contents, "_BYTES_PER_SECOND", 1e12)
    with pytest.raises(HeliosweepError, match="cannot be read to its end: its structure is damaged"):
        sound.sound(path)


@pytest.mark.parametrize("result", ["result.nc", "result.zarr"])
def test_nonsense_in_attributes_is_no_traceback(pair, result):
    path = pair(result)
    if path.is_file():
        (path.parent / "manifest.json").unlink()
    else:
        metadata = path / ".zmetadata"
        metadata.write_text(metadata.read_text().replace('"units": "W"', '"units": "V"'))
    with pytest.raises(HeliosweepError, match="is damaged"), sound.blaming_damage(path):
        raise KeyError("family")


def test_a_fault_of_the_program_is_not_blamed_on_the_result(pair):
    with pytest.raises(KeyError), sound.blaming_damage(pair()):
        raise KeyError("family")


@pytest.mark.long
def test_any_bit_of_a_file(pair, capsys):
    """Compared, or refused with a message; never a traceback."""
    path, chance = pair(), random.Random(3)
    whole = path.read_bytes()
    for _ in range(40):
        path.write_bytes(whole)
        flip(path, chance.randrange(len(whole)), chance.randrange(8))
        assert main(["compare", "A", "B"]) in (0, 1)
        assert "Traceback" not in capsys.readouterr().err


def test_nothing_there():
    with pytest.raises(StudyError, match="no such file"):
        sound.sound("nowhere")
