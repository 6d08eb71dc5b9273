"""Studies and files that are edited while a study runs, between its runs, and after them; and code that changed."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
import yaml

from heliosweep import api
from heliosweep.config.study import Study
from heliosweep.errors import HeliosweepError, StudyError
from heliosweep.families.family import Family
from heliosweep.store import manifest
from tests.faults.kills import content_of, leftovers
from tests.faults.stopped import SERIES, STUDY, Runs, after_parts


def write(path: Path, content: Any) -> Path:
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def test_a_study_file_edited_during_the_run(runs: Runs, tmp_path, monkeypatch, caplog):
    """The run goes on with what it read; the edit is another study, and the next run says what changed."""
    monkeypatch.chdir(tmp_path)
    path = write(tmp_path / "study.yaml", STUDY)
    study = api.load(path)
    with monkeypatch.context() as patch:
        after_parts(patch, 1, lambda: write(path, {**STUDY, "receiver": {"height": 61}}))
        first = api.run(study, report=False)
    runs.run(STUDY, tmp_path / "peace")
    assert content_of(first.folder) == content_of(tmp_path / "peace")
    before = content_of(first.folder)
    second = api.run(api.load(path), report=False)
    assert second.folder != first.folder
    assert "changed receiver.height: 60.0 -> 61.0" in caplog.text
    assert content_of(first.folder) == before


@pytest.fixture
def layout(tmp_path) -> Path:
    path = tmp_path / "layout.csv"
    path.write_text("x,y\n0,100\n20,100\n-20,100\n0,130\n")
    return path


def in_layout(folder: Path) -> Path:
    return write(folder / "study.yaml", {**STUDY, "layout": {"file": "layout.csv"}})


def test_a_layout_edited_during_the_run(runs: Runs, tmp_path, layout, monkeypatch):
    """It is read once, at the start: the result is that of the study as it was then, and complete for it alone."""
    study, text = api.load(in_layout(tmp_path)), layout.read_text()
    runs.run(study, tmp_path / "peace")
    with monkeypatch.context() as patch:
        after_parts(patch, 1, lambda: layout.write_text(text.replace("130", "140")))
        assert len(runs.run(study, tmp_path / "out")) == 4
    assert content_of(tmp_path / "out") == content_of(tmp_path / "peace")
    with pytest.raises(StudyError, match="holds the result of another study"):
        runs.run(api.load(tmp_path / "study.yaml"), tmp_path / "out")
    layout.write_text(text)
    os.utime(layout, (1e9, 1e9))  # touched, but it says the same
    assert runs.run(api.load(tmp_path / "study.yaml"), tmp_path / "out") == []


def test_a_layout_edited_while_the_run_starts(runs: Runs, tmp_path, layout, monkeypatch):
    study, text = api.load(in_layout(tmp_path)), layout.read_text()

    def edited(family: Family, of: Study) -> object:
        layout.write_text(text.replace("130", "140"))
        return inputs(family, of)

    inputs = Family.inputs
    with monkeypatch.context() as patch:
        patch.setattr(Family, "inputs", edited)
        with pytest.raises(HeliosweepError, match="the files of the study were edited while it started; run it again"):
            runs.run(study, tmp_path / "out")
    assert runs.begun == []
    assert not (tmp_path / "out").exists()


def test_another_study_in_an_unfinished_folder(runs: Runs, tmp_path):
    runs.stop(STUDY, tmp_path / "out")
    other = {**STUDY, "receiver": {"height": 61}}
    with pytest.raises(HeliosweepError, match=r"another study \(receiver\.height: 60\.0 -> 61\.0\).*--force"):
        runs.run(other, tmp_path / "out")
    assert len(runs.run(STUDY, tmp_path / "out")) == 2
    with pytest.raises(HeliosweepError, match=r"holds the result of another study .*--force .* replaces it"):
        runs.run(other, tmp_path / "out")
    assert len(runs.run(other, tmp_path / "out", force=True)) == 4  # one after the other
    assert not leftovers(tmp_path / "out")


def test_unfinished_parts_of_another_study_outlive_a_look_at_a_finished_one(runs: Runs, tmp_path):
    runs.run(STUDY, tmp_path / "out")
    other = {**STUDY, "receiver": {"height": 61}}
    runs.stop(other, tmp_path / "out", force=True)
    assert runs.run(STUDY, tmp_path / "out") == []
    assert len(runs.run(other, tmp_path / "out")) == 2


@pytest.fixture
def other_code(monkeypatch) -> None:
    known = manifest.code_versions
    monkeypatch.setattr(manifest, "code_versions", lambda module: {**known(module), "numpy": "1.0"})


def test_parts_of_other_code_are_never_mixed(runs: Runs, tmp_path, request):
    runs.stop(STUDY, tmp_path / "out")
    request.getfixturevalue("other_code")
    with pytest.raises(HeliosweepError, match=r"other code \(numpy: .* -> 1\.0\).*--force"):
        runs.run(STUDY, tmp_path / "out")
    assert len(runs.run(STUDY, tmp_path / "out", force=True)) == 4


def test_a_result_of_other_code_is_computed_anew(runs: Runs, tmp_path, request, caplog):
    runs.run(STUDY, tmp_path / "out")
    request.getfixturevalue("other_code")
    assert len(runs.run(STUDY, tmp_path / "out")) == 4
    assert "computed anew, for it was computed with other code: numpy" in caplog.text
    assert runs.run(STUDY, tmp_path / "out") == []


@pytest.mark.parametrize(
    "blocks",
    [
        {"title": "another title"},
        {"output": {"time_series": True, "compression": "none"}},
        {"output": {"time_series": True, "format": "zarr"}},
        {"output": {"time_series": True, "format": "zarr", "compression": "zstd"}},
    ],
)
def test_other_words_and_formats_take_the_numbers_over(runs: Runs, tmp_path, blocks):
    runs.run({**SERIES, **blocks}, tmp_path / "peace")
    runs.run(SERIES, tmp_path / "out")
    assert runs.run({**SERIES, **blocks}, tmp_path / "out") == []
    assert content_of(tmp_path / "out") == content_of(tmp_path / "peace")
    assert runs.run(SERIES, tmp_path / "out") == []  # and back again
    assert not leftovers(tmp_path / "out")
