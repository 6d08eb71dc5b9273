"""Result folders with something in them: what no run has left is not replaced, removed or read as if one had."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from heliosweep import api
from heliosweep.errors import RunInterrupted, StudyError
from tests.faults.kills import content_of
from tests.faults.stopped import PARTS, STUDY, Runs, after_parts, interrupt

OURS = ["result.nc", "manifest.json", "study.resolved.yaml", "report.html", "comparison.csv"]


def run(study: Any, folder: Path, **options: Any) -> bytes:
    return api.run(study, folder, report=False, **options).path.read_bytes()


@pytest.mark.parametrize("name", OURS)
@pytest.mark.parametrize("force", [False, True])
def test_files_of_the_user(small, tmp_path, name, force):
    (tmp_path / name).write_text("a thesis")
    if force:
        run(small(), tmp_path, force=True)
        assert (tmp_path / "manifest.json").read_text().startswith("{")
        return
    with pytest.raises(StudyError, match=rf"holds {name} without a manifest of heliosweep; --force .* replaces"):
        run(small(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "a thesis"


@pytest.mark.parametrize("name", ["working", "result.zarr", *OURS, ".heliosweep.lock"])
@pytest.mark.parametrize("force", [False, True])
def test_folders_of_the_user(small, tmp_path, name, force):
    (tmp_path / name / "deep").mkdir(parents=True)
    (tmp_path / name / "deep/thesis.txt").write_text("a thesis")
    with pytest.raises(StudyError, match=rf"{name}: is (none of heliosweep's|a folder, where)"):
        run(small(), tmp_path, force=force)
    assert (tmp_path / name / "deep/thesis.txt").read_text() == "a thesis"


@pytest.mark.parametrize("force", [False, True])
def test_files_that_the_study_reads(small, tmp_path, monkeypatch, force):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "comparison.csv").write_text("x,y\n0,100\n20,100\n")
    with pytest.raises(StudyError, match=r"comparison\.csv: is read by the study, and the run would replace it"):
        run(small(layout={"file": "comparison.csv"}), tmp_path, force=force)
    run(small(), tmp_path / "first")
    resolved = api.load(tmp_path / "first/study.resolved.yaml")
    shutil.rmtree(tmp_path / "first/figures", ignore_errors=True)
    assert run(resolved, tmp_path / "first") == run(small(), tmp_path / "second")  # there already
    with pytest.raises(StudyError, match=r"study\.resolved\.yaml: is read by the study"):
        run(resolved, tmp_path / "first", force=True)


def test_other_files_stay(small, tmp_path):
    (tmp_path / "notes.txt").write_text("a thesis")
    (tmp_path / ".lock").write_text("my lock")
    run(small(), tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "a thesis"
    assert (tmp_path / ".lock").read_text() == "my lock"


def test_the_result_of_another_study_is_replaced_when_asked(small, tmp_path):
    first = run(small(), tmp_path)
    other = small(receiver={"height": 70})
    with pytest.raises(StudyError, match=r"another study \(receiver\.height: 60\.0 -> 70\.0\); --force .* replaces it"):
        run(other, tmp_path)
    assert (tmp_path / "result.nc").read_bytes() == first
    assert run(other, tmp_path, force=True) != first


def test_a_forced_run_that_was_interrupted_goes_on(runs: Runs, tmp_path, caplog):
    runs.run(STUDY, tmp_path)
    first = content_of(tmp_path)
    with runs.monkeypatch.context() as patch:
        after_parts(patch, 3, interrupt)
        with pytest.raises(RunInterrupted) as stop:
            runs.run(STUDY, tmp_path, force=True)
    assert "3 of 4 parts are done and kept" in str(stop.value)
    assert str(stop.value).endswith("run the same command again to go on, without --force (force=True in Python)")
    assert content_of(tmp_path) == first
    assert runs.run(STUDY, tmp_path) == PARTS[3:]
    assert content_of(tmp_path) == first
    assert "goes on:" in caplog.text
    assert "complete already" not in caplog.text
    assert not (tmp_path / "working").exists()


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ({}, {"output": {"format": "zarr", "compression": "zstd"}}),
        ({"output": {"format": "zarr", "compression": "zstd"}}, {}),
        ({}, {"output": {"compression": "zlib"}}),
        ({}, {"execution": {"scheduler": "threads", "workers": 1, "chunks": {"heliostat": 20}}}),
        ({"execution": {"scheduler": "synchronous", "chunks": {"heliostat": 20, "latitude": 1}}}, {}),
    ],
)
def test_an_interrupted_run_goes_on_with_another_format_or_cut(runs: Runs, tmp_path, before, after):
    runs.run({**STUDY, **after}, tmp_path / "peace")
    total = 4 if "chunks" not in str(before) else 12
    done = runs.stop(
        {**STUDY, **before, "execution": {**STUDY["execution"], **before.get("execution", {})}}, tmp_path / "out", 3
    )
    again = runs.run({**STUDY, **after}, tmp_path / "out")
    assert len(again) == total - 3
    assert not {*again} & {*done}
    assert content_of(tmp_path / "out") == content_of(tmp_path / "peace")


def test_a_finished_study_is_found_whatever_the_machine(small, tmp_path):
    first = run(small(), tmp_path)
    for execution in ({"memory": "1 MB"}, {"scheduler": "tcp://127.0.0.1:1"}):
        assert run(small(execution=execution), tmp_path) == first
