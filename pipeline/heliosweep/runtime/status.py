"""What became of studies: complete, running, interrupted; what is done, what failed and how long the rest will take."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from heliosweep.errors import HeliosweepError
from heliosweep.grid.limits import human_bytes, human_seconds
from heliosweep.store import working
from heliosweep.store.claim import holder
from heliosweep.store.finished import Finished
from heliosweep.store.journal import Journal
from heliosweep.store.working import read_identity

#: Failed parts that are listed.
_LISTED = 5


@dataclass(frozen=True)
class Status:
    """What became of the study of one result folder.

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
    """What became of the study of a result folder."""
    running = holder(folder)
    place = folder / working.NAME
    if place.is_dir():
        return _unfinished(folder, place, running)
    finished = Finished.find(folder)
    if finished:
        size = human_bytes(int(finished.manifest["result"].get("bytes", 0)))
        count = len(finished.digests)
        detail = f"{size}, finished {finished.manifest.get('finished', 'some time ago')}"
        return Status(folder, "running" if running else "complete", detail, count, count)
    if running:
        return Status(folder, "running", f"{running} has begun")
    if any((folder / name).exists() for name in ("result.nc", "result.zarr")):
        return Status(folder, "damaged", "a result without its manifest; run the study again, or: heliosweep verify")
    return Status(folder, "not run", "nothing is there yet")


def _unfinished(folder: Path, place: Path, running: str | None) -> Status:
    try:
        total = int(read_identity(place)["parts"])
    except (HeliosweepError, KeyError, TypeError, ValueError) as error:
        return Status(folder, "damaged", str(error))
    journal = Journal.read(place / "journal.jsonl")
    done, failed = len(journal.done), dict(journal.failed)
    left = journal.seconds / (done + len(failed)) * (total - done) if done else None
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
    marks = ("manifest.json", working.NAME, "result.nc", "result.zarr")
    folders = sorted(path for path in outputs.glob("*") if path.is_dir())
    return [folder for folder in folders if any((folder / mark).exists() for mark in marks)]


def status_lines(statuses: Sequence[Status]) -> Iterable[str]:
    """One line for each study, and one for each part that failed."""
    names = [str(status.folder) for status in statuses]
    width, states = max(map(len, names), default=0), max((len(status.state) for status in statuses), default=0)
    for name, status in zip(names, statuses, strict=True):
        yield f"{name:{width}}  {status.state:{states}}  {status.detail}"
        failed = list(status.failed.items())
        for part, why in failed[:_LISTED]:
            yield f"    failed: {part}: {why}"
        if len(failed) > _LISTED:
            yield f"    and {len(failed) - _LISTED:,} more"
