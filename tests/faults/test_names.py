"""Output folders and file names that cannot be, and terminals that cannot show them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from heliosweep.cli import main
from tests.conftest import SMALL


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.yaml").write_text(yaml.safe_dump({**SMALL, "title": "h\u00e9liostats [/m] \u2600"}))
    (tmp_path / "taken/result.nc").mkdir(parents=True)
    return tmp_path


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("", "the name of the result folder is empty"),
        ("n" * 300, "cannot write there: File name too long"),
        ("taken", "taken/result.nc: is a folder"),
        (os.fsdecode(b"\xff"), "is no text"),
    ],
    ids=["empty", "long", "folder", "bytes"],
)
def test_output(folder, capsys, output, message):
    before = set(folder.rglob("*"))
    assert main(["run", "study.yaml", "--output", output]) == 2
    assert message in capsys.readouterr().err
    assert set(folder.rglob("*")) == before


def test_names_that_are_no_text_on_a_terminal_that_shows_ascii(folder):
    name = os.fsdecode(b"st\xffdy.yaml")
    try:
        (folder / "study.yaml").rename(folder / name)
    except OSError:
        pytest.skip("the disk takes names of text only")
    environment = {**os.environ, "LC_ALL": "C", "PYTHONIOENCODING": "ascii", "PYTHONPATH": os.pathsep.join(sys.path)}
    commands = [["validate", name], ["plan", name], ["run", "--no-report", name], ["run", "nowhere\u2600.yaml"]]
    for arguments, code in zip(commands, (0, 0, 0, 2), strict=True):
        command = [sys.executable, "-m", "heliosweep", *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        assert "Traceback" not in done.stderr, done.stderr
        assert done.returncode == code, done.stderr
    manifest = json.loads(next(folder.glob("outputs/*/manifest.json")).read_text(encoding="utf-8"))
    assert manifest["study_file"] == name
