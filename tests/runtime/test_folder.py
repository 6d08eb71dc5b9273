"""Result folders with something in them: what no run has left is not replaced, removed or read as if one had."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from heliosweep import workflow
from heliosweep.errors import RunInterrupted, StudyError
from heliosweep.runtime import execute
from heliosweep.store.working import WorkingStore

OURS = ["result.nc", "manifest.json", "study.resolved.yaml", "report.html", "comparison.csv"]


def run(study: Any, folder: Path, **options: Any) -> bytes:
    return workflow.run(study, folder, report=False, **options).path.read_bytes()


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
    resolved = workflow.load(tmp_path / "first/study.resolved.yaml")
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


def interrupted(study: Any, folder: Path, monkeypatch: pytest.MonkeyPatch, parts: int, **options: Any) -> str:
    """Run a study in small parts and stop after some of them; returns the message."""
    monkeypatch.setattr("heliosweep.grid.plan.PART_BYTES", 1)
    works = execute._works

    def few(*given: Any) -> Any:
        for number, work in enumerate(works(*given)):
            if number == parts + 2:  # two are in flight
                raise KeyboardInterrupt
            yield work

    with monkeypatch.context() as patch:
        patch.setattr(execute, "_works", few)
        with pytest.raises(RunInterrupted) as stop:
            run(study, folder, **options)
    return str(stop.value)


COUNTS: dict[str, Any] = {"site": {"latitude": {"start": 0, "stop": 60, "num": 7}}, "tracking": "azimuth_elevation"}


def test_a_forced_run_that_was_interrupted_goes_on(small, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr("heliosweep.grid.plan.PART_BYTES", 1)
    first = run(small(**COUNTS), tmp_path)
    said = interrupted(small(**COUNTS), tmp_path, monkeypatch, 3, force=True)
    assert "parts are done and kept" in said
    assert said.endswith("run the same command again to go on, without --force (force=True in Python)")
    assert (tmp_path / "result.nc").read_bytes() == first
    caplog.set_level("INFO", "heliosweep")
    assert run(small(**COUNTS), tmp_path) == first
    assert "goes on:" in caplog.text
    assert "complete already" not in caplog.text
    assert not (tmp_path / "working").exists()


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ({}, {"format": "zarr", "compression": "zstd"}),
        ({"format": "zarr", "compression": "zstd"}, {}),
        ({"format": "zarr", "compression": "zlib"}, {"format": "zarr", "compression": "zlib", "compression_level": 9}),
        ({}, {"compression": "zlib"}),
    ],
)
def test_an_interrupted_run_goes_on_with_another_format(small, tmp_path, monkeypatch, before, after):
    interrupted(small(**COUNTS, output=before), tmp_path / "a", monkeypatch, 3)
    done = workflow.status(tmp_path / "a")[0].done
    assert done >= 2
    computed: list[str] = []
    keep = WorkingStore.commit

    def count(self: Any, part: Any, values: Any) -> None:
        computed.append(part.name)
        keep(self, part, values)

    monkeypatch.setattr(WorkingStore, "commit", count)
    again = workflow.run(small(**COUNTS, output=after), tmp_path / "a", report=False)
    assert len(computed) == 7 - done
    fresh = workflow.run(small(**COUNTS, output=after), tmp_path / "b", report=False)
    files = [sorted(p for p in r.path.rglob("*") if p.is_file()) or [r.path] for r in (again, fresh)]
    assert [p.read_bytes() for p in files[0]] == [p.read_bytes() for p in files[1]]


def test_a_finished_study_is_found_whatever_the_machine(small, tmp_path):
    first = run(small(), tmp_path)
    for execution in ({"memory": "1 MB"}, {"scheduler": "tcp://127.0.0.1:1"}):
        assert run(small(execution=execution), tmp_path) == first
