"""Files that are damaged between two runs or within one: the right parts are computed anew, never a wrong result."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from heliosweep.errors import HeliosweepError, RunInterrupted
from heliosweep.runs import run as runtime
from heliosweep.store.parts import PartStore
from tests.faults.kills import content_of, done_parts, leftovers
from tests.faults.stopped import PARTS, STUDY, ZARR, Runs, interrupt
from tests.store.samples import flip


@pytest.fixture
def expected(runs: Runs, tmp_path) -> dict[str, bytes]:
    runs.run(STUDY, tmp_path / "peace")
    return content_of(tmp_path / "peace")


def flip_part(folder: Path, part: int) -> None:
    """Turn a bit of the values of a part."""
    lines = (json.loads(line) for line in (folder / "working/journal.jsonl").read_text().splitlines())
    flip(folder / "working/values.bin", next(line["offset"] for line in lines if line["part"] == PARTS[part]) + 9)


def test_a_damaged_part_is_computed_anew(runs, expected, tmp_path, caplog):
    assert runs.stop(STUDY, tmp_path / "out", 3) == PARTS[:3]
    flip_part(tmp_path / "out", 1)
    assert runs.run(STUDY, tmp_path / "out") == [PARTS[1], PARTS[3]]
    assert "1 parts were damaged on the disk and are computed anew: points-00001" in caplog.text
    assert content_of(tmp_path / "out") == expected
    assert not leftovers(tmp_path / "out")


@pytest.mark.parametrize(
    ("edit", "again"),
    [
        (lambda text: text[:-1], PARTS[2:]),
        (lambda text: text + text, PARTS[3:]),
        (lambda text: text.replace(b"points-00001", b"points-00003"), PARTS[1::2]),
    ],
    ids=["torn", "twice", "another part"],
)
def test_a_damaged_journal(runs, expected, tmp_path, edit, again):
    runs.stop(STUDY, tmp_path / "out", 3)
    path = tmp_path / "out/working/journal.jsonl"
    path.write_bytes(edit(path.read_bytes()))
    assert runs.run(STUDY, tmp_path / "out") == again
    assert content_of(tmp_path / "out") == expected


@pytest.mark.parametrize("study", [STUDY, ZARR], ids=["netcdf", "zarr"])
def test_a_part_damaged_before_it_is_published(runs, tmp_path, monkeypatch, study):
    """Found when it is read again, for the digest of every part is checked then too."""
    runs.run(study, tmp_path / "peace")

    def damaging(*said: Any) -> Any:
        flip_part(tmp_path / "out", 2)
        return publish(*said)

    publish = runtime.publish
    with monkeypatch.context() as patch:
        patch.setattr(runtime, "publish", damaging)
        with pytest.raises(HeliosweepError, match="points-00002 was damaged on the disk; run again"):
            runs.run(study, tmp_path / "out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["working"]
    assert runs.run(study, tmp_path / "out") == [PARTS[2]]
    assert content_of(tmp_path / "out") == content_of(tmp_path / "peace")


def test_killed_between_the_manifest_and_the_end(runs, expected, tmp_path, monkeypatch):
    """The parts that are still there belong to a result that is complete; they go with the next run."""
    with monkeypatch.context() as patch:
        patch.setattr(PartStore, "remove", interrupt)
        with pytest.raises(RunInterrupted):
            runs.run(STUDY, tmp_path / "out")
    assert len(done_parts(tmp_path / "out")) == 4
    assert runs.run(STUDY, tmp_path / "out") == []
    assert not leftovers(tmp_path / "out")
    assert content_of(tmp_path / "out") == expected
