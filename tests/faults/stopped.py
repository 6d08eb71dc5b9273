"""Runs in this process with small parts, stopped when some are done."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from heliosweep import api
from heliosweep.config.study import Study
from heliosweep.errors import RunInterrupted
from heliosweep.grid.lazy import Work
from heliosweep.grid.regions import Part
from heliosweep.store.parts import PartStore
from tests.faults.kills import SMALL_PARTS, TINY, done_parts

#: Four points, each a part; and time series of a dozen parts.
STUDY: dict[str, Any] = {**TINY, "site": {"latitude": [0, 40]}}
SERIES: dict[str, Any] = {**STUDY, "output": {"time_series": True}}
ZARR: dict[str, Any] = {**STUDY, "output": {"format": "zarr", "compression": "zlib"}}
#: Names of the parts of STUDY.
PARTS = [f"points-{number:05}" for number in range(4)]


class Runs:
    """Runs studies, and knows which parts were begun."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.monkeypatch = monkeypatch
        self.begun: list[str] = []
        compute = Work.compute

        def noted(work: Work, part: Part) -> Any:
            self.begun.append(part.name)
            return compute(work, part)

        for patch in (*SMALL_PARTS, (Work, "compute", noted)):
            monkeypatch.setattr(*patch)

    def run(self, study: Study | Mapping[str, Any], folder: Path, **options: Any) -> list[str]:
        """Run a study; returns the parts that were begun."""
        self.begun.clear()
        loaded = study if isinstance(study, Study) else api.load(study)
        api.run(loaded, folder, report=False, **options)
        return list(self.begun)

    def stop(self, study: Study | Mapping[str, Any], folder: Path, parts: int = 2, **options: Any) -> list[str]:
        """Run a study until so many parts are done; returns their names."""
        with self.monkeypatch.context() as patch:
            after_parts(patch, parts, interrupt)
            with pytest.raises(RunInterrupted):
                self.run(study, folder, **options)
        done = list(done_parts(folder))
        assert len(done) == parts
        return done


def after_parts(patch: pytest.MonkeyPatch, parts: int, then: Callable[[], object]) -> None:
    """Do something when so many parts are stored."""
    commit, count = PartStore.commit, 0

    def counting(store: PartStore, *said: Any) -> None:
        nonlocal count
        commit(store, *said)
        count += 1
        if count == parts:
            then()

    patch.setattr(PartStore, "commit", counting)


def interrupt(*_: object, **__: object) -> None:
    """Stand in for something during which Ctrl-C is hit."""
    raise KeyboardInterrupt
