"""Runs in this process with small parts, stopped when some are done."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from heliosweep import workflow
from heliosweep.config.study import Study
from heliosweep.errors import RunInterrupted
from heliosweep.grid import plan, slabs
from heliosweep.grid.slabs import Part
from heliosweep.runtime import execute
from heliosweep.store.journal import Journal
from heliosweep.store.working import WorkingStore
from tests.faults.kills import TINY

#: Four points, each a part; and time series of a dozen parts.
STUDY: dict[str, Any] = {**TINY, "site": {"latitude": [0, 40]}}
SERIES: dict[str, Any] = {**STUDY, "output": {"time_series": True}}


class Runs:
    """Runs studies, and knows which parts were begun."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.monkeypatch = monkeypatch
        self.begun: list[str] = []
        monkeypatch.setattr(plan, "PART_SECONDS", 0.0)
        monkeypatch.setattr(slabs, "SERIES_PART_BYTES", 8 * 2**10)
        works = execute._works

        def noted(*said: Any) -> Iterator[Any]:
            for work in works(*said):
                self.begun.append(work.part.name)
                yield work

        monkeypatch.setattr(execute, "_works", noted)

    def run(self, study: Study | Mapping[str, Any], folder: Path, **options: Any) -> list[str]:
        """Run a study; returns the parts that were begun."""
        self.begun.clear()
        loaded = study if isinstance(study, Study) else workflow.load(study)
        workflow.run(loaded, folder, report=False, **options)
        return list(self.begun)

    def stop(self, study: Study | Mapping[str, Any], folder: Path, parts: int = 2, **options: Any) -> list[str]:
        """Run a study until so many parts are done; returns their names."""
        commit, count = WorkingStore.commit, 0

        def stopping(self: WorkingStore, part: Part, values: Any) -> None:
            nonlocal count
            if count == parts:
                raise KeyboardInterrupt
            count += 1
            commit(self, part, values)

        with self.monkeypatch.context() as patch:
            patch.setattr(WorkingStore, "commit", stopping)
            with pytest.raises(RunInterrupted):
                self.run(study, folder, **options)
        done = list(Journal.read(folder / "working/journal.jsonl").done)
        assert len(done) == parts
        return done


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> Runs:
    caplog.set_level(logging.INFO, "heliosweep")
    return Runs(monkeypatch)


def flip(path: Path, position: int = -1, bit: int = 0) -> None:
    """Turn one bit of a file."""
    content = bytearray(path.read_bytes())
    content[position] ^= 1 << bit
    path.write_bytes(content)


def truncate(path: Path) -> None:
    """Leave half of a file."""
    os.truncate(path, path.stat().st_size // 2)


def replace_by_folder(path: Path) -> None:
    """Put a folder in the place of a file."""
    path.unlink()
    path.mkdir()


Damage = Callable[[Path], None]
#: What bad disks and good intentions do to a file.
DAMAGES: dict[str, Damage] = {
    "truncated": truncate,
    "empty": lambda path: os.truncate(path, 0),
    "flipped": flip,
    "deleted": Path.unlink,
    "folder": replace_by_folder,
}
