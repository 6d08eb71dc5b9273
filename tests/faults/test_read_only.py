"""Folders that cannot be written, and things that stand where a folder should."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from heliosweep.cli import main
from heliosweep.runtime.verify import verify
from tests.faults.kills import TINY


@pytest.fixture
def study(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "study.yaml"
    path.write_text(yaml.safe_dump(TINY))
    return path


@pytest.fixture
def read_only(tmp_path) -> Iterator[Path]:
    """A disk that cannot be written, with a finished and an unfinished result."""
    place = tmp_path / "disk"
    for name in ("finished", "new"):
        (place / name).mkdir(parents=True)
    assert main(["run", "study.yaml", "--no-report", "-q", "-o", str(place / "finished")]) == 0
    try:
        subprocess.run(["mount", "--bind", place, place], check=True, capture_output=True)
        subprocess.run(["mount", "-o", "remount,ro,bind", place], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        subprocess.run(["umount", place], check=False, capture_output=True)
        pytest.skip("may not mount here")
    yield place
    subprocess.run(["umount", "--lazy", place], check=True)


def test_read_only_folder(study, read_only, capsys):
    assert main(["run", "study.yaml", "--no-report", "-q", "-o", str(read_only / "finished")]) == 0  # it is there
    capsys.readouterr()
    for name in ("new", "new/er"):
        assert main(["run", "study.yaml", "--no-report", "-q", "-o", str(read_only / name)]) == 2
        said = capsys.readouterr().err
        assert "cannot write there: Read-only file system; name another folder with --output" in said
        assert len(said.splitlines()) == 1
    assert verify(read_only / "finished").ok  # reading is all it takes


def test_a_file_where_the_folder_should_be(study, tmp_path, capsys):
    (tmp_path / "taken").write_text("mine")
    for name in ("taken", "taken/below"):
        assert main(["run", "study.yaml", "--no-report", "-q", "-o", name]) == 2
        assert "cannot write there" in capsys.readouterr().err
    assert (tmp_path / "taken").read_text() == "mine"


def test_a_file_where_the_working_store_should_be(study, tmp_path, capsys):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/working").write_text("mine")
    assert main(["run", "study.yaml", "--no-report", "-q", "-o", "out"]) == 2
    assert "out/working: is none of heliosweep's" in capsys.readouterr().err
    assert (tmp_path / "out/working").read_text() == "mine"
