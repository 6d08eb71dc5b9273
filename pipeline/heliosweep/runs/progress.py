"""One progress display: a bar where there is a terminal, a line now and then where there is none."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol, TextIO

from heliosweep.errors import printable
from heliosweep.grid.machine import human_seconds

#: Without a terminal: a line at most so often. [s]
LINE_SECONDS = 10.0


class Progress(Protocol):
    """Counts blocks done."""

    def advance(self, blocks: int = 1) -> None:
        """Say that `blocks` more are done."""


class Silent:
    """Shows nothing."""

    def advance(self, blocks: int = 1) -> None:
        """Do nothing."""


class _Lines:
    def __init__(self, title: str, total: int, stream: TextIO) -> None:
        self._title, self._total, self._stream = title, total, stream
        self._done, self._start = 0, time.monotonic()
        self._next = self._start + LINE_SECONDS

    def advance(self, blocks: int = 1) -> None:
        self._done += blocks
        now = time.monotonic()
        if now < self._next or self._done >= self._total:
            return
        self._next = now + LINE_SECONDS
        left = (now - self._start) / self._done * (self._total - self._done)
        share = 100 * self._done / self._total
        print(f"{self._title}: {share:.0f} %, about {human_seconds(left)} left", file=self._stream, flush=True)


class _Bar:
    def __init__(self, bar: Any, task: Any) -> None:
        self._bar, self._task = bar, task

    def advance(self, blocks: int = 1) -> None:
        self._bar.advance(self._task, blocks)


@contextmanager
def show_progress(title: str, total: int, stream: TextIO | None = None) -> Iterator[Progress]:
    """Show the progress of `total` blocks on `stream` (standard error) while the context lasts."""
    stream, title = stream or sys.stderr, printable(title)
    if not stream.isatty():
        yield _Lines(title, total, stream)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(file=stream), transient=True) as bar:
        yield _Bar(bar, bar.add_task(title, total=total))
