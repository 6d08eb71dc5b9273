"""The command line: answers, exit codes, bad input, interruption."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
import yaml

from heliosweep import api
from heliosweep.cli import main
from heliosweep.errors import HeliosweepError
from tests.conftest import SMALL, STUDIES
from tests.test_imports import HEAVY

FIELD = "x,y\n0,50\n15,50\n-15,50\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Empty working directory with a layout of three heliostats."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "field.csv").write_text(FIELD)
    return tmp_path


def study(folder: Path, text: str = "", **blocks: Any) -> str:
    """Write a small study file, in which `blocks` replace whole blocks; returns its name."""
    content = {**SMALL, "layout": {"file": "field.csv"}, **blocks}
    (folder / "study.yaml").write_text(text or yaml.safe_dump(content, sort_keys=False, default_flow_style=None))
    return "study.yaml"


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "heliosweep", *arguments]


def contents(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def test_run_leaves_the_whole_folder_and_prints_the_path_last(folder, capsys):
    assert main(["run", study(folder), "--quiet"]) == 0
    path = Path(capsys.readouterr().out.splitlines()[-1])
    assert re.fullmatch(r"outputs/study-[0-9a-f]{12}/result\.nc", path.as_posix())
    left = {file.name for file in path.parent.iterdir()} - {".heliosweep.lock"}
    assert left == {"result.nc", "manifest.json", "study.resolved.yaml", "report.html", "figures"}
    with xr.open_dataset(path) as result:
        assert result["optical_efficiency"].dims == ("latitude", "tracking", "heliostat")
    manifest = json.loads((path.parent / "manifest.json").read_text())
    assert manifest["result"]["bytes"] == path.stat().st_size
    assert len(manifest["result"]["sha256"]) == 64


def test_run_ends_with_headline_numbers_and_the_page_and_takes_other_values(folder, capsys):
    path = study(folder)
    assert main(["run", path, "--set", "receiver.height=77", "--set", "site.latitude=[0, 20]", "-o", "out"]) == 0
    told = capsys.readouterr()
    assert told.out.splitlines()[-1] == str(Path("out/result.nc"))
    headline, page = told.err.splitlines()[-2:]
    assert "mean optical efficiency of the field over the period: " in headline
    assert page == f"page: {Path('out/report.html')}"
    with xr.open_dataset("out/result.nc") as result:
        assert result.receiver_height == 77
        assert result.latitude.values.tolist() == [0, 20]
        field = result.field_optical_efficiency.values
        low, high = (f"{100 * end:.2f}" for end in (field.min(), field.max()))
        latitude = int(result.field_optical_efficiency.max("tracking").idxmax("latitude"))
        assert f": {high} %; maximum of 4 points, at latitude {latitude}°" in headline
        assert headline.endswith(f"; minimum {low}\N{NO-BREAK SPACE}%")
    assert main(["run", path, "--set", "receiver.height=77", "--set", "site.latitude=[0, 20]", "-o", "out"]) == 0
    assert f"page: {Path('out/report.html')}" in capsys.readouterr().err
    assert main(["run", path, "--set", "receiver.hight=77"]) == 2
    assert capsys.readouterr().err == "--set: receiver.hight: unknown key; did you mean 'height'?\n"
    assert main(["verify", path]) == 2
    assert "study.yaml: has not been run; run: heliosweep run study.yaml" in capsys.readouterr().err
    assert main(["run", path, "--no-report", "-q"]) == 0
    assert capsys.readouterr().err == ""
    assert main(["verify", path]) == 0


def test_no_path_of_this_machine_in_the_result(folder, capsys):
    path = study(folder, layout={"file": str(folder / "field.csv")})
    assert main(["run", path, "--quiet", "--no-report", "--output", "out"]) == 0
    assert str(folder).encode() not in (folder / "out/result.nc").read_bytes()
    with xr.open_dataset(folder / "out/result.nc") as result:
        assert str(folder) not in str(result.attrs)


def test_plan_writes_nothing(folder, capsys):
    before = contents(folder) | {"study.yaml"}
    assert main(["plan", study(folder)]) == 0
    text = capsys.readouterr().out
    for word in ("dimensions", "latitude 2", "chunks", "peak memory", "output", "time"):
        assert word in text
    assert contents(folder) == before


@pytest.mark.parametrize("verb", ["plan", "run"])
def test_a_sweep_beyond_all_bounds_is_refused_with_code_3(folder, capsys, verb):
    heights = {"height": {"start": 50, "stop": 60, "num": 10**3}}
    path = study(folder, site={"latitude": {"start": 0, "stop": 60, "num": 10**6}}, receiver=heights)
    before = contents(folder)
    assert main([verb, path]) == 3
    assert "shrink" in capsys.readouterr().err
    assert contents(folder) == before


def test_usage_errors(folder, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["run"])
    assert stop.value.code == 2
    for option, text, message in [
        ("--workers", "0", "must be between 1 and 65536 (got 0)"),
        ("--workers", "1.5", "must be a whole number"),
        ("--workers", "null", "must be a number (got 'null')"),
        ("--memory", "~", "must be an amount of memory in B"),
        ("--scheduler", "null", "unknown choice; use 'threads'"),
        ("--memory", "2 parsec", "unknown unit 'parsec'"),
        ("--scheduler", "thread", "unknown choice; did you mean 'threads'?"),
        ("--scheduler", "tcp://host", "must be tcp://HOST:PORT"),
    ]:
        assert main(["run", study(folder), option, text]) == 2
        error = capsys.readouterr().err
        assert message in error
        assert option in error
    assert main(["run", "nowhere.yaml"]) == 2
    assert main(["schema", "nothing"]) == 2
    assert main(["report", "nowhere"]) == 2


def loaded_by(*arguments: str) -> set[str]:
    """Packages that a process has imported when it has carried out a command."""
    code = (
        "import sys\nfrom heliosweep.cli import main\ntry:\n    main(sys.argv[1:])\nexcept SystemExit:\n    pass\n"
        "print(*{name.partition('.')[0] for name in sys.modules}, *{'dask.array', 'scipy.special'} & {*sys.modules})"
    )
    done = subprocess.run([sys.executable, "-c", code, *arguments], check=True, capture_output=True, text=True)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize("arguments", [("validate",), ("plan",), ("--help",)])
def test_quick_answers_load_nothing_heavy(arguments):
    assert not HEAVY & loaded_by(*arguments, str(STUDIES / "chong2012_table2.yaml"))


def test_a_finished_result_is_found_without_anything_heavy(folder):
    first = loaded_by("run", study(folder), "--quiet")
    assert {"numba", "xarray"} <= first
    assert not HEAVY & loaded_by("run", "study.yaml")


def test_several_studies_in_one_command(folder, capsys):
    """One line with headline and time for each, or its path with --quiet; a failure does not stop the others."""
    names = ["a.yaml", "b.yaml", "c.yaml", "d.yaml"]
    for name, latitude in zip(names, (0, 200, 20, 40), strict=True):
        Path(study(folder, site={"latitude": latitude})).rename(folder / name)
    Path("c.yaml").write_text(Path("c.yaml").read_text() + "title: [1, 2]\n")
    assert main(["run", *names, "-q", "--no-report"]) == 2
    shown = capsys.readouterr()
    assert [line.split("-")[0] for line in shown.out.splitlines()] == ["outputs/a", "outputs/d"]
    assert re.search(r"^b\.yaml:\d+:\d+: site\.latitude: ", shown.err, re.MULTILINE)
    assert re.search(r"^c\.yaml:\d+:\d+: title: ", shown.err, re.MULTILINE)
    assert shown.err.splitlines()[-1] == "2 of 4 studies failed: b.yaml, c.yaml"
    for more in ([], ["--force"]):  # finished, and computed again
        done = subprocess.run(command("run", "a.yaml", "d.yaml", *more), capture_output=True, text=True, check=True)
        lines = done.stdout.splitlines()
        assert len(lines) == 2
        assert done.stderr == ""
        for name, line in zip(("a.yaml", "d.yaml"), lines, strict=True):
            assert re.fullmatch(rf"{name}: mean optical efficiency of the field.* \([0-9.]+ s\)", line)
    assert main(["run", "a.yaml", "d.yaml", "--output", "one"]) == 2
    assert "--output: names the result folder of a single study" in capsys.readouterr().err


def test_whatever_befalls_one_study_the_others_go_on(folder, capsys, monkeypatch):
    real, faults = api.run, {"a.yaml": FloatingPointError("a fault"), "b.yaml": HeliosweepError("the disk is full")}

    def failing(given: Any, *arguments: Any, **named: Any) -> Any:
        if fault := faults.get(given.source.path.name):
            raise fault
        return real(given, *arguments, **named)

    for name in (*faults, "c.yaml"):
        Path(study(folder)).rename(folder / name)
    monkeypatch.setattr(api, "run", failing)
    assert main(["run", "a.yaml", "b.yaml", "c.yaml", "-q", "--no-report"]) == 1
    said = capsys.readouterr()
    assert [line.split("-")[0] for line in said.out.splitlines()] == ["outputs/c"]
    assert "b.yaml: the disk is full\n2 of 3 studies failed: a.yaml, b.yaml\n" in said.err


def test_output_cut_by_the_reader_is_no_error(folder):
    done = subprocess.run(
        f"{shlex.quote(sys.executable)} -m heliosweep schema field_efficiency | head -1",
        shell=True, capture_output=True, text=True, check=True, env={**os.environ},
    )  # fmt: skip
    assert done.stdout.startswith("{")
    assert done.stderr == ""


def test_from_run_to_status_verify_compare_and_export(folder, capsys, caplog):
    path = study(folder)
    assert main(["status"]) == 0
    assert "no study has been run" in capsys.readouterr().out
    assert main(["run", path, "--no-report", "-q"]) == 0
    result = Path(capsys.readouterr().out.strip())
    assert main(["run", path, "--no-report", "-q"]) == 0  # found, not computed again
    assert Path(capsys.readouterr().out.strip()) == result
    assert main(["status"]) == main(["status", path]) == main(["status", str(result.parent)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    assert len(set(lines)) == 1
    assert re.match(rf"{result.parent}  complete  [\d.]+ kB, finished 20", lines[0])
    assert main(["verify", str(result.parent)]) == 0
    assert "intact" in capsys.readouterr().out

    path = study(folder, output={"compression": "zlib"})
    assert main(["run", path, "--no-report", "-q", "--output", "other"]) == 0
    assert Path(capsys.readouterr().out.strip()) == Path("other/result.nc")
    assert main(["compare", str(result.parent), "other"]) == 0
    assert "same " in capsys.readouterr().out
    assert main(["export", "other", "-o", "again.nc"]) == 2
    assert "again.nc: must end in .csv or .xlsx" in capsys.readouterr().err
    assert main(["validate", study(folder, output={"format": "zarr", "compression": "zstd"})]) == 0
    assert ".to_zarr('result.zarr')" in caplog.text

    path = study(folder, receiver={"height": 70})
    assert main(["plan", path]) == 0
    assert re.search(r"chunks +1[^\n]*\n", capsys.readouterr().out)
    assert main(["run", path, "--no-report", "-q", "--output", "third"]) == 0
    capsys.readouterr()
    assert main(["compare", str(result), "third"]) == 1
    assert "receiver.height: 60" in capsys.readouterr().out
    with result.open("r+b") as file:
        file.seek(-100, os.SEEK_END)
        file.write(b"\xff" * 8)
    assert main(["verify", str(result.parent), "third"]) == 1
    assert "NOT intact" in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "STUDY", "-o", "s3://bucket/x"],
        ["plan", "STUDY", "-o", "s3://bucket/x"],
        ["table", "STUDY", "-o", "s3://bucket/x.csv"],
        ["convert", "field.csv", "s3://bucket/x.csv"],
        ["new", "field_efficiency", "s3://bucket/x.yaml"],
        ["examples", "chong2012_table1", "--to", "s3://bucket/x"],
    ],
    ids=lambda arguments: " ".join(arguments),
)
def test_every_command_refuses_to_write_to_an_address(folder, capsys, arguments):
    path = study(folder)
    before = contents(folder)
    assert main([path if word == "STUDY" else word for word in arguments]) == 2
    assert "is a URL, not a path on this machine; specify a local file or folder" in capsys.readouterr().err
    assert contents(folder) == before
