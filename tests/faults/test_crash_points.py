"""Runs that end at chosen places: before every touch of a file, by a kill or for want of room."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from heliosweep.store.manifest import Finished
from tests.faults.attempts import Attempts
from tests.faults.kills import TINY, Nursery, content_of, done_parts, leftovers, write_study

pytestmark = pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="looks at /proc")  # noqa: PTH112

OUTPUTS: dict[str, dict[str, Any]] = {
    "netcdf": {"time_series": True, "compression": "zlib"},
    "zarr": {"format": "zarr"},
}


class Crashes:
    """One study, run again and again, and the touches of a run in peace."""

    def __init__(self, nursery: Nursery, output: str) -> None:
        self.nursery, self.place = nursery, nursery.folder / "out"
        study = write_study(nursery.folder, {**TINY, "output": OUTPUTS[output]})
        self.command = ["run", str(study), "--quiet", "--no-report", "--output", str(self.place)]
        peace = nursery.run(self.command, watch=str(self.place))
        assert peace.code == 0, peace.errors
        self.touched, self.begun = peace.touched, peace.begun
        self.expected = content_of(self.place)

    def points(self, attempts: Attempts) -> Iterator[tuple[int, str]]:
        """Number and kind of a touch for each attempt, spread over all of them."""
        for number in attempts.numbers:
            at = number * len(self.touched) // attempts.whole
            yield at + 1, self.touched[at]

    def resume(self, before: Mapping[str, bytes], what: str) -> None:
        """Run on in peace."""
        outcome = self.nursery.run(self.command)
        assert outcome.code == 0, f"{what}: {outcome.errors}"
        assert not before.keys() & set(outcome.begun), what
        assert content_of(self.place) == self.expected, what
        assert leftovers(self.place) == [], what


@pytest.fixture(params=list(OUTPUTS))
def crashes(request, nursery) -> Crashes:
    return Crashes(nursery, request.param)


@pytest.mark.attempts("kills", 50)
def test_killed_before_a_touch(crashes, attempts):
    for number, kind in crashes.points(attempts):
        what = f"killed before touch {number}, {kind}"
        shutil.rmtree(crashes.place)
        with attempts.at(what):
            outcome = crashes.nursery.run(crashes.command, watch=str(crashes.place), kill_at=number)
            assert outcome.code == -signal.SIGKILL, what
            before = dict.fromkeys(outcome.begun, b"") if Finished.find(crashes.place) else done_parts(crashes.place)
            assert len(set(outcome.begun) - before.keys()) <= 3, what  # one at work, one handed over, one stored
            crashes.resume(before, what)


@pytest.mark.attempts("disks", 50)
def test_disk_full_from_a_touch_on(crashes, attempts):
    for number, kind in crashes.points(attempts):
        what = f"disk full at touch {number}, {kind}"
        shutil.rmtree(crashes.place, ignore_errors=True)
        with attempts.at(what):
            outcome = crashes.nursery.run(crashes.command, watch=str(crashes.place), full_at=number)
            before = done_parts(crashes.place)
            if outcome.code == 0:  # all that came after was removing
                assert all("remove" in kind or "rmdir" in kind or "rename" in kind for kind in outcome.touched[number:])
            else:
                assert outcome.code in (1, 2), what
                assert "Traceback" not in outcome.errors, what
                assert "No space left on device" in outcome.errors, what
                assert len(outcome.errors.splitlines()) == 1, f"{what}: {outcome.errors}"
                assert before or not crashes.place.exists(), f"{what}: {list(crashes.place.rglob('*'))}"
                left = {path.name for path in crashes.place.glob("*")}
                assert left <= {"working", "manifest.json", "study.resolved.yaml", "result.nc", "result.zarr"}, left
            crashes.resume(before, what)
