"""States of studies and plans in words, and the progress of a run: a bar, or lines where there is no terminal."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TextIO

from heliosweep.config.study import Study
from heliosweep.errors import HeliosweepError, printable
from heliosweep.files import human_bytes
from heliosweep.grid.machine import human_seconds
from heliosweep.grid.plan import Plan
from heliosweep.store import parts
from heliosweep.store.folder import MANIFEST, RESULTS, holder, read_manifest, refuse_devices

#: Without a terminal: a line of progress at most so often. [s]
LINE_SECONDS = 10.0
#: Failed parts that are listed.
_LISTED = 5
#: Of why one failed, so much is told. [characters]
_LONG = 500


@dataclass(frozen=True)
class Status:
    """State of the study of one result folder.

    Parameters
    ----------
    folder : pathlib.Path
        The folder.
    state : str
        ``complete``, ``running``, ``interrupted``, ``damaged`` or ``not run``.
    detail : str
        In words: what is done and what is left.
    done, total : int
        Parts that are stored, and all of them.
    failed : dict of str to str
        Why parts failed.
    seconds_left : float, optional
        About how long the rest will take, as fast as before; None where nothing tells. [s]
    """

    folder: Path
    state: str
    detail: str
    done: int = 0
    total: int = 0
    failed: dict[str, str] = field(default_factory=dict)
    seconds_left: float | None = None


def status_of(folder: Path) -> Status:
    """State of the study of a result folder; damage of any kind is a state, and never raised."""
    try:
        running = holder(folder)
        try:
            refuse_devices(folder)
            return _status(folder, running)
        except HeliosweepError as error:
            if running:  # which takes away or puts there what was looked for
                return Status(folder, "running", f"{running} is at work")
            return Status(folder, "damaged", str(error).removeprefix(f"{folder}{os.sep}"))
    except Exception as error:  # one bad folder must not hide the others
        return Status(folder, "damaged", f"cannot be read: {type(error).__name__}: {error}")


def _status(folder: Path, running: str | None) -> Status:
    if (folder / parts.WORKING).is_dir():
        return _unfinished(folder, folder / parts.WORKING, running)
    if (folder / MANIFEST).exists():
        manifest = read_manifest(folder)
        if not (folder / manifest["result"]["file"]).exists():
            raise HeliosweepError(f"{manifest['result']['file']}: is missing; run the study again")
        size = human_bytes(manifest["result"].get("bytes", 0))
        count = manifest.get("plan", {}).get("parts", 0)
        detail = f"{size}, finished {manifest.get('finished') or 'some time ago'}"
        return Status(folder, "running" if running else "complete", detail, count, count)
    if running:
        return Status(folder, "running", f"{running} has begun")
    if any((folder / name).exists() for name in RESULTS):
        return Status(folder, "damaged", "a result without its manifest; run the study again, or: heliosweep verify")
    return Status(folder, "not run", "nothing is there yet")


def _unfinished(folder: Path, place: Path, running: str | None) -> Status:
    store = parts.PartStore.open(place)
    total, done, failed = store.part_count, len(store.done), dict(store.failed)
    left = store.seconds / (done + len(failed)) * (total - done) if done else None
    words = [f"{done:,} of {total:,} parts done"]
    if failed:
        words.append(f"{len(failed):,} failed")
    if left is not None:
        words.append(f"about {human_seconds(left)} left")
    if running:
        words.append(running)
    return Status(folder, "running" if running else "interrupted", ", ".join(words), done, total, failed, left)


def result_folders(outputs: Path) -> list[Path]:
    """Folders below `outputs` in which a study was run, or is being run."""
    return [folder for folder in sorted(outputs.glob("*")) if _is_result_folder(folder)]


def _is_result_folder(folder: Path) -> bool:
    try:
        return folder.is_dir() and any((folder / mark).exists() for mark in (MANIFEST, parts.WORKING, *RESULTS))
    except OSError:  # what may not be looked into is told of by `status_of`
        return True


def status_lines(statuses: Sequence[Status]) -> Iterable[str]:
    """One line for each study, and one for each part that failed."""
    names = [str(status.folder) for status in statuses]
    width, states = max(map(len, names), default=0), max((len(status.state) for status in statuses), default=0)
    for name, status in zip(names, statuses, strict=True):
        yield f"{name:{width}}  {status.state:{states}}  {status.detail}"
        failed = list(status.failed.items())
        for part, why in failed[:_LISTED]:
            yield f"    failed: {part}: {why if len(why) <= _LONG else f'{why[:_LONG]}...'}"
        if len(failed) > _LISTED:
            yield f"    and {len(failed) - _LISTED:,} more"


def plan_text(study: Study, plan: Plan, folder: Path) -> str:
    """What a study will cost, one quantity a line; `folder` is where its result will go."""
    words, status = plan.in_words(), status_of(folder)
    done = {"complete": "; all are done", "not run": ""}.get(status.state, f"; {status.detail}")
    rows = {
        "study": f"{study.title or study.family} ({study.family}, {study.study_id})",
        "dimensions": words["dimensions"],
        "points": words["points"],
        "evaluations": words["evaluations"],
        "parts": f"{plan.part_count:,}, each of which is kept once it is done{done}",
        "workers": f"{plan.workers} ({study.execution.scheduler})",
        "peak memory": words["peak memory"],
        "output": f"{words['output']} in {folder}",
        "time": words["time"],
    }
    width = max(map(len, rows))
    return "\n".join(f"{name:{width}}  {value}" for name, value in rows.items())


@contextmanager
def show_progress(
    title: str, total: int, stream: TextIO | None = None, done: int = 0
) -> Iterator[Callable[[], object]]:
    """Show the progress of `total` parts, of which `done` are there, on `stream` (standard error).

    Yields what is to be called when one is done. On a terminal there is a bar, elsewhere a line now and then.
    """
    stream, title = stream or sys.stderr, printable(title)
    if not stream.isatty():
        yield _lines(title, total, done, stream)
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
        yield partial(bar.advance, bar.add_task(title, total=total, completed=done))


def _lines(title: str, total: int, before: int, stream: TextIO) -> Callable[[], object]:
    start = last = time.monotonic()
    done = before

    def advance() -> None:
        nonlocal done, last
        done, now = done + 1, time.monotonic()
        if now >= last + LINE_SECONDS and done < total:
            last, left = now, (now - start) / (done - before) * (total - done)
            share = 100 * done / total
            print(f"{title}: {share:.0f} %, about {human_seconds(left)} left", file=stream, flush=True)

    return advance
