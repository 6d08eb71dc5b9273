"""Plans in words, and the progress of a run."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from heliosweep.config.study import Study
from heliosweep.errors import printable
from heliosweep.grid.machine import human_seconds
from heliosweep.grid.plan import Plan
from heliosweep.store.status import status_of

#: Without a terminal: time of the first line of progress, and time between lines. [s]
FIRST_LINE, LINE_SECONDS = 1.0, 10.0


def plan_text(study: Study, plan: Plan, folder: Path) -> str:
    """Return the plan of a study, one quantity a line; `folder` is its result folder."""
    words, status = plan.in_words(), status_of(folder)
    done = {"complete": "; all are done", "not run": ""}.get(status.state, f"; {status.detail}")
    rows = {
        "study": f"{study.title or study.family} ({study.family}, {study.study_id})",
        "dimensions": words["dimensions"],
        "points": words["points"],
        "evaluations": words["evaluations"],
        "chunks": f"{plan.chunk_count:,}, each stored when it is done{done}",
        "workers": f"{plan.workers} ({study.execution.scheduler})",
        "peak memory": words["peak memory"],
        "output": f"{words['output']} in {folder}",
        "time": words["time"],
    }
    width = max(map(len, rows))
    return "\n".join(f"{name:{width}}  {value}" for name, value in rows.items())


@contextmanager
def show_progress(
    title: str, total: int, stream: TextIO | None = None, done: int = 0, *, shown: bool = True
) -> Iterator[Callable[[], object]]:
    """Show the progress of a run on `stream` (standard error): a bar on a terminal, else lines.

    Yields a function to call when a chunk is done. `done` of the `total` chunks were done before.
    """
    stream, title = stream or sys.stderr, printable(title)
    if not shown:
        yield lambda: None
    elif not stream.isatty():
        yield _lines(title, total, done, stream)
    else:
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )

        description = TextColumn("{task.description}", markup=False)
        times = (TextColumn("elapsed"), TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
        with Progress(description, BarColumn(), MofNCompleteColumn(), *times, console=Console(file=stream)) as bar:
            task = bar.add_task(title, total=total, completed=done)
            yield lambda: bar.advance(task)


def _lines(title: str, total: int, before: int, stream: TextIO) -> Callable[[], object]:
    start = time.monotonic()
    following, done = start + FIRST_LINE, before

    def advance() -> None:
        nonlocal done, following
        done, now = done + 1, time.monotonic()
        if now >= following and done < total:
            following, left = now + LINE_SECONDS, (now - start) / (done - before) * (total - done)
            times = f"elapsed {human_seconds(now - start)}, left about {human_seconds(left)}"
            print(f"{title}: {done:,} of {total:,} chunks, {times}", file=stream, flush=True)

    return advance
