"""Runs that end at chosen places: before every touch of a file, by a kill or for want of room."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Mapping
from typing import Any

import pytest

from heliosweep.store.manifest import Finished
from tests.faults.kills import TINY, Nursery, content_of, done_parts, leftovers, write_study

pytestmark = pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="looks at /proc")  # noqa: PTH112

OUTPUTS: dict[str, dict[str, Any]] = {
    "netcdf": {"time_series": True, "compression": "zlib"},
    "zarr": {"format": "zarr"},
}

#: Kinds of touches for the quick tests: the moments between the stages of a run.
SOME = (
    "rename working", "write values.bin", "write journal.jsonl", "fsync values.bin", "fsync journal.jsonl",
    "rename result.nc", "rename result.zarr", "open 0.0.0", "rename manifest.json", "rmdir working.part",
)  # fmt: skip


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

    def points(self, every: bool) -> list[int]:
        """Number of every touch, or of the last of some kinds."""
        last = {kind: number for number, kind in enumerate(self.touched, 1)}
        if every:
            return list(range(1, len(self.touched) + 1))
        return sorted(last[kind] for kind in SOME if kind in last)

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


def check_kills(crashes: Crashes, every: bool) -> None:
    for number in crashes.points(every):
        what = f"killed before touch {number}, {crashes.touched[number - 1]}"
        shutil.rmtree(crashes.place)
        outcome = crashes.nursery.run(crashes.command, watch=str(crashes.place), kill_at=number)
        assert outcome.code == -signal.SIGKILL, what
        before = dict.fromkeys(outcome.begun, b"") if Finished.find(crashes.place) else done_parts(crashes.place)
        assert len(set(outcome.begun) - before.keys()) <= 3, what  # one at work, one handed over, one stored
        crashes.resume(before, what)


def check_full_disk(crashes: Crashes, every: bool) -> None:
    for number in crashes.points(every):
        what = f"disk full at touch {number}, {crashes.touched[number - 1]}"
        shutil.rmtree(crashes.place, ignore_errors=True)
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
            assert left <= {"working", "manifest.json", "study.resolved.yaml", "result.nc", "result.zarr"}, (what, left)
        crashes.resume(before, what)


@pytest.mark.parametrize("crashes", ["netcdf"], indirect=True)
def test_killed_at_some_touches(crashes):
    check_kills(crashes, every=False)


@pytest.mark.parametrize("crashes", ["zarr"], indirect=True)
def test_disk_full_at_some_touches(crashes):
    check_full_disk(crashes, every=False)


@pytest.mark.long
def test_killed_at_every_touch(crashes):
    check_kills(crashes, every=True)


@pytest.mark.long
def test_disk_full_at_every_touch(crashes):
    check_full_disk(crashes, every=True)
