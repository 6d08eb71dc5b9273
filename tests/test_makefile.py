"""The Makefile hands over any name of a study."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.conftest import ROOT


@pytest.fixture
def project(tmp_path) -> Path:
    """A ready project whose command only prints its arguments."""
    shutil.copy(ROOT / "Makefile", tmp_path)
    names = ("pyproject.toml", "constraints.txt", ".venv/.ready", ".venv/.tools")
    for name in (*names, "studies/a b.yaml", "studies/c_table1.yaml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    command = tmp_path / ".venv/bin/heliosweep"
    command.parent.mkdir()
    command.write_text('#!/bin/sh\nprintf "<%s>" "$@"; echo\n')
    command.chmod(0o755)
    return tmp_path


def make(folder: Path, *arguments: str) -> list[str]:
    # As a user types it, also when these tests are themselves run by make.
    outside = {name: value for name, value in os.environ.items() if name not in ("MAKEFLAGS", "MAKELEVEL", "MFLAGS")}
    done = subprocess.run(["make", *arguments], cwd=folder, env=outside, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_every_study_whatever_its_name(project):
    assert make(project) == ["<run><studies/c_table1.yaml><studies/a b.yaml>"]


def test_a_study_that_fails_fails_make(project):
    command = project / ".venv/bin/heliosweep"
    command.write_text("#!/bin/sh\nexit 1\n")
    assert subprocess.run(["make"], cwd=project, capture_output=True, check=False).returncode


@pytest.mark.parametrize("name", ["studies/a b.yaml", 'it\'s "one".yaml', "a;b.yaml"])
def test_one_study_whatever_its_name(project, name):
    assert make(project, f"STUDY={name}", "run") == [f"<run><{name}>"]
