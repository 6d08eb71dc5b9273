"""Parts that fail: named with their coordinates, the rest kept, and tried again by the next run alone."""

from __future__ import annotations

from typing import Any

import pytest

from heliosweep.errors import HeliosweepError
from heliosweep.runtime import engines, execute
from heliosweep.store.journal import Journal
from tests.faults.kills import content_of
from tests.faults.stopped import STUDY, Runs, runs  # noqa: F401


@pytest.fixture
def failing(monkeypatch) -> set[str]:
    """Parts to fail, by name."""
    names: set[str] = set()
    attempt = engines._InTurn._attempt

    def chosen(self: Any, work: Any) -> Any:
        if work.part.name in names:
            lazy = work.lazy
            work = type(work)(work.part, lazy.map(lambda array: array.data.map_blocks(_fail, dtype=array.dtype)))
        return attempt(self, work)

    monkeypatch.setattr(engines._InTurn, "_attempt", chosen)
    return names


def _fail(_: Any) -> Any:
    raise ZeroDivisionError("no such sun")


def test_one_part_fails(runs: Runs, tmp_path, failing):  # noqa: F811
    runs.run(STUDY, tmp_path / "peace")
    failing.add("points-00001")
    with pytest.raises(HeliosweepError) as error:
        runs.run(STUDY, tmp_path / "out")
    assert error.value.exit_code == 1
    first, second = str(error.value).splitlines()
    assert first.startswith("1 of 4 parts failed, each 3 times (3 are done and kept)")
    assert second.startswith("  points-00001 (latitude 0.0, tracking azimuth_elevation: ZeroDivisionError: no such sun")
    journal = Journal.read(tmp_path / "out/working/journal.jsonl")
    assert list(journal.failed) == ["points-00001"]
    assert len(journal.done) == 3
    assert not (tmp_path / "out/result.nc").exists()
    failing.clear()
    assert runs.run(STUDY, tmp_path / "out") == ["points-00001"]
    assert content_of(tmp_path / "out") == content_of(tmp_path / "peace")


def test_all_parts_fail(runs: Runs, tmp_path, failing):  # noqa: F811
    """After some of them it is clear that the others would fail too; what is known of the failures is kept."""
    failing.update(f"points-{number:05}" for number in range(4))
    with pytest.raises(HeliosweepError, match=r"3 of 4 parts failed, each 3 times \(none is done\)"):
        runs.run(STUDY, tmp_path / "out")
    assert len(runs.begun) <= execute.HOPELESS + 1
    failing.clear()
    assert len(runs.run(STUDY, tmp_path / "out")) == 4
