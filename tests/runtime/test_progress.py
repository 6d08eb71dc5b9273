"""Progress: lines without a terminal, a bar on one, blocks counted as dask finishes them."""

from __future__ import annotations

import io

import numpy as np
import xarray as xr

from heliosweep.grid.evaluate import evaluate
from heliosweep.runtime import progress
from heliosweep.runtime.scheduler import compute, scheduler


class Count:
    def __init__(self) -> None:
        self.blocks = 0

    def advance(self, blocks: int = 1) -> None:
        self.blocks += blocks


def test_blocks_are_counted_on_local_schedulers():
    lazy = evaluate(
        lambda a: a[np.newaxis],
        [xr.DataArray(np.arange(12.0), dims="a")],
        dims=("a",),
        core=[()],
        sizes={"a": 12},
        chunks={"a": 3},
        outputs={"same": {}},
        name="test",
    )
    for name in ("threads", "synchronous"):
        count = Count()
        with scheduler(name, 2):
            compute(xr.Dataset(lazy), count)
        assert count.blocks == 4


def test_lines_without_a_terminal(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(progress, "LINE_SECONDS", -1.0)
    with progress.show_progress("study", 4, stream) as shown:
        for _ in range(4):
            shown.advance()
    lines = stream.getvalue().splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("study: 25 %, about ")


def test_bar_on_a_terminal():
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    stream = Terminal()
    with progress.show_progress("study", 4, stream) as shown:
        shown.advance(2)
    assert "study" in stream.getvalue()
