"""Result folders that are copied elsewhere, finished or not: recognised there, and the original untouched."""

from __future__ import annotations

import shutil
from pathlib import Path

from tests.faults.kills import content_of, leftovers
from tests.faults.stopped import STUDY, Runs, runs  # noqa: F401


def everything(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_unfinished(runs: Runs, tmp_path):  # noqa: F811
    done = runs.stop(STUDY, tmp_path / "here")
    before = everything(tmp_path / "here")
    shutil.copytree(tmp_path / "here", tmp_path / "far/away")
    assert len(runs.run(STUDY, tmp_path / "far/away")) == 4 - len(done)
    assert everything(tmp_path / "here") == before
    assert len(runs.run(STUDY, tmp_path / "here")) == 4 - len(done)
    assert content_of(tmp_path / "here") == content_of(tmp_path / "far/away")


def test_finished(runs: Runs, tmp_path, caplog):  # noqa: F811
    runs.run(STUDY, tmp_path / "here")
    before = everything(tmp_path / "here")
    shutil.copytree(tmp_path / "here", tmp_path / "there")
    assert runs.run(STUDY, tmp_path / "there") == []
    assert "is complete already" in caplog.text
    assert everything(tmp_path / "here") == everything(tmp_path / "there") == before


def test_copied_while_it_ran_with_what_was_half_written(runs: Runs, tmp_path):  # noqa: F811
    """A copy holds the claim of a process that is not at work in it, and files with its name."""
    runs.stop(STUDY, tmp_path / "here")
    shutil.copytree(tmp_path / "here", tmp_path / "there")
    (tmp_path / "there/.heliosweep.lock").write_text('{"process": 1, "host": "elsewhere"}')
    (tmp_path / "there/working/values.zarr/cosine_efficiency/1.1.0.0123456789abcdef.partial").touch()
    assert len(runs.run(STUDY, tmp_path / "there")) == 2
    runs.run(STUDY, tmp_path / "here")
    assert content_of(tmp_path / "here") == content_of(tmp_path / "there")
    assert not leftovers(tmp_path / "there")


def test_half_written_chunks_stay_out_of_a_zarr_result(runs: Runs, tmp_path):  # noqa: F811
    study = {**STUDY, "output": {"format": "zarr"}}
    runs.stop(study, tmp_path / "out")
    (tmp_path / "out/working/values.zarr/cosine_efficiency/1.1.0.0123456789abcdef.partial").touch()
    runs.run(study, tmp_path / "out")
    runs.run(study, tmp_path / "peace")
    assert content_of(tmp_path / "out") == content_of(tmp_path / "peace")
