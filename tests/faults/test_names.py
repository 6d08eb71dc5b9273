"""Output folders that cannot be, or not be written, names that are no text, and terminals that cannot show them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
import yaml

from heliosweep import api
from heliosweep.cli import main
from heliosweep.results import open_result
from heliosweep.runs.verify import verify
from tests.faults.kills import TINY


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.yaml").write_text(yaml.safe_dump({**TINY, "title": "h\u00e9liostats [/m] \u2600"}))
    (tmp_path / "taken/result.nc").mkdir(parents=True)
    (tmp_path / "file").write_text("mine")
    (tmp_path / "mine/working").mkdir(parents=True)
    (tmp_path / "mine/working/thesis.txt").write_text("mine")
    return tmp_path


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("", "the name of the result folder is empty"),
        ("n" * 300, "cannot write there: File name too long"),
        ("taken", "taken/result.nc: is a folder"),
        (os.fsdecode(b"\xff"), "is no text"),
        ("a\\b", "the NetCDF library takes a backslash for what parts folders"),
        ("~nobody-of-this-name/x", "there is no such home folder; write ./ before it"),
        ("file", "cannot write there"),
        ("file/below", "cannot write there"),
        ("mine", "mine/working: is none of heliosweep's"),
    ],
    ids=["empty", "long", "folder", "bytes", "backslash", "no home", "file", "below a file", "no store"],
)
def test_output(folder, capsys, output, message):
    before = set(folder.rglob("*"))
    assert main(["run", "study.yaml", "--no-report", "-q", "--output", output]) == 2
    assert message in capsys.readouterr().err
    assert set(folder.rglob("*")) == before
    assert (folder / "file").read_text() == "mine"


def test_the_home_folder(folder, capsys, monkeypatch):
    """``~`` that no shell has expanded, and a folder of that name, are what they are for every command and library."""
    monkeypatch.setenv("HOME", str(folder / "home"))
    (folder / "home").mkdir()
    (folder / "~").mkdir()
    other = {**TINY, "receiver": {"height": 80}}
    (folder / "home/study.yaml").write_text(yaml.safe_dump(other))

    def heights(place: Any) -> Any:
        with open_result(place) as result:
            return yaml.safe_load(result.attrs["study"])["receiver"]["height"]

    for study, place, there in (
        ("study.yaml", "~/result", folder / "home/result"),
        ("~/study.yaml", "./~/result", folder / "~/result"),
    ):
        assert main(["run", study, "--no-report", "-q", "--output", place]) == 0
        assert (there / "result.nc").is_file()
        export = ["export", "--csv", f"{place}.csv", "--variable", "cosine_efficiency"]
        for command in (["verify"], ["report"], ["status"], ["compare", str(there)], export):
            assert main([*command, place]) == 0, capsys.readouterr().err
        assert heights(place) == heights(there)
        assert there.with_suffix(".csv").is_file()
        assert (there / "report.html").is_file()
    assert heights("~/result") == 60
    assert heights("./~/result") == 80


def test_files_that_a_study_names_in_the_home_folder(folder, monkeypatch, capsys):
    monkeypatch.setenv("HOME", str(folder / "home"))
    (folder / "home").mkdir()
    (folder / "elsewhere").mkdir()
    for place, x in (("home/l.csv", 10), ("elsewhere/~l.csv", 20), ("~l.csv", 30)):
        (folder / place).write_text(f"x,y\n{x},50\n")
    for name, found in (("~/l.csv", [10]), ("./~l.csv", [20]), ("~l.csv", [])):
        study = folder / "elsewhere/s.yaml"
        study.write_text(yaml.safe_dump({**TINY, "layout": {"file": name}}))
        if not found:
            assert main(["validate", str(study)]) == 2
            assert "there is no such home folder; write ./ before it" in capsys.readouterr().err
        else:
            assert api.build(api.load(study))["x"].values.tolist() == found


def test_a_working_folder_with_a_backslash_is_told_at_once(folder, capsys, monkeypatch):
    (folder / "a\\b").mkdir()
    (folder / "a\\b/study.yaml").write_text((folder / "study.yaml").read_text())
    monkeypatch.chdir(folder / "a\\b")
    assert main(["run", "study.yaml", "--no-report", "-q", "-o", "out"]) == 2
    assert "the NetCDF library takes a backslash" in capsys.readouterr().err


@pytest.fixture
def read_only(folder) -> Iterator[Path]:
    """A disk that cannot be written, with a finished result and an empty folder."""
    place = folder / "disk"
    (place / "new").mkdir(parents=True)
    assert main(["run", "study.yaml", "--no-report", "-q", "-o", str(place / "finished")]) == 0
    try:
        subprocess.run(["mount", "--bind", place, place], check=True, capture_output=True)
        subprocess.run(["mount", "-o", "remount,ro,bind", place], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        subprocess.run(["umount", place], check=False, capture_output=True)
        pytest.skip("may not mount here")
    yield place
    subprocess.run(["umount", "--lazy", place], check=True)


def test_read_only_folder(read_only, capsys):
    assert main(["run", "study.yaml", "--no-report", "-q", "-o", str(read_only / "finished")]) == 0  # it is there
    capsys.readouterr()
    for name in ("new", "new/er"):
        assert main(["run", "study.yaml", "--no-report", "-q", "-o", str(read_only / name)]) == 2
        said = capsys.readouterr().err
        assert "cannot write there: Read-only file system; name another folder with --output" in said
        assert len(said.splitlines()) == 1
    assert verify(read_only / "finished").ok  # reading is all it takes


ESCAPE = "\x1b]0;mine\x07\u202e"


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", f"{ESCAPE}.yaml"],
        ["run", "study.yaml", f"--{ESCAPE}"],
        ["plan", "study.yaml", "-o", ESCAPE],
        ["verify", ESCAPE],
        ["compare", "foreign.nc", "foreign.nc", "--rtol", ESCAPE],
        ["compare", "foreign.nc", "other.nc"],
        ["validate", "columns.yaml"],
        ["convert", "columns.csv", "out.csv"],
        ["schema", ESCAPE],
        ["table", "study.yaml", "-o", "t.csv", "--select", f"{ESCAPE}=1"],
    ],
)
def test_nothing_is_printed_that_a_terminal_obeys(folder, capsys, arguments):
    for name, value in (("foreign", 1.0), ("other", 2.0)):
        data = xr.Dataset(
            {"value": (("d",), [value], {"units": f"{ESCAPE}{name}"})}, attrs={"title": f"{ESCAPE}{name}"}
        )
        data.to_netcdf(folder / f"{name}.nc", engine="netcdf4")
    (folder / "columns.csv").write_text(f"x,y,{ESCAPE},{ESCAPE}\n1,2,3,{ESCAPE}\n")
    layout = {**TINY, "layout": {"file": "columns.csv"}}
    (folder / "columns.yaml").write_text(yaml.safe_dump(layout))
    with suppress(SystemExit):
        main(arguments)
    said = "".join(capsys.readouterr())
    assert said
    assert not set(ESCAPE) & set(said) - set("0;]mine")


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
