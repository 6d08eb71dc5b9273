"""Parts that fail: named with their coordinates, the rest kept, and tried again by the next run alone."""

from __future__ import annotations

from typing import Any

import pytest

from heliosweep.errors import HeliosweepError
from heliosweep.grid.lazy import Work
from heliosweep.runs.executors import TRIES
from heliosweep.runs.run import HOPELESS
from heliosweep.store.parts import PartStore
from tests.faults.kills import content_of
from tests.faults.stopped import PARTS, STUDY, Runs


@pytest.fixture
def failing(runs: Runs, monkeypatch) -> set[str]:
    """Names of parts to fail."""
    names: set[str] = set()
    compute = Work.compute

    def chosen(self: Work, part: Any) -> Any:
        values = compute(self, part)
        return values if part.name not in names else 1 / 0

    monkeypatch.setattr(Work, "compute", chosen)
    return names


def test_one_part_fails(runs: Runs, tmp_path, failing):
    runs.run(STUDY, tmp_path / "peace")
    failing.add(PARTS[1])
    with pytest.raises(HeliosweepError) as error:
        runs.run(STUDY, tmp_path / "out")
    assert error.value.exit_code == 1
    first, second = str(error.value).splitlines()
    assert first.startswith("1 of 4 parts failed, each 3 times (3 are done and kept)")
    said = "latitude 0.0, tracking azimuth_elevation, heliostat 0 to 47: ZeroDivisionError: division by zero"
    assert second.startswith(f"  {PARTS[1]} ({said}")
    store = PartStore.open(tmp_path / "out/working")
    assert store.failed == {PARTS[1]: said}
    assert len(store.done) == 3
    assert not (tmp_path / "out/result.nc").exists()
    failing.clear()
    assert runs.run(STUDY, tmp_path / "out") == [PARTS[1]]
    assert content_of(tmp_path / "out") == content_of(tmp_path / "peace")


def test_all_parts_fail(runs: Runs, tmp_path, failing):
    """After some of them it is clear that the others would fail too; what is known of the failures is kept."""
    failing.update(PARTS)
    with pytest.raises(HeliosweepError, match=r"3 of 4 parts failed, each 3 times \(none is done\)"):
        runs.run(STUDY, tmp_path / "out")
    assert len(runs.begun) <= (HOPELESS + 1) * TRIES
    failing.clear()
    assert len(runs.run(STUDY, tmp_path / "out")) == 4
