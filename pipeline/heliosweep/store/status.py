"""Status of result folders."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from heliosweep.errors import HeliosweepError
from heliosweep.files import human_bytes
from heliosweep.grid.machine import human_seconds
from heliosweep.store.chunks import CHUNKS, unfinished
from heliosweep.store.folder import MANIFEST, RESULTS, is_locked, read_manifest


@dataclass(frozen=True)
class Status:
    """Status of the study of one result folder.

    Parameters
    ----------
    folder : pathlib.Path
        The folder.
    state : str
        ``complete``, ``running``, ``interrupted``, ``damaged`` or ``not run``.
    detail : str
        Description in words.
    done, total : int
        Number of stored chunks, and of all chunks.
    seconds_left : float, optional
        Time for the missing chunks at the speed of the last ones; None if unknown. [s]
    """

    folder: Path
    state: str
    detail: str
    done: int = 0
    total: int = 0
    seconds_left: float | None = None


def status_of(folder: Path) -> Status:
    """Return the status of a result folder. Damage is a status, never an exception."""
    try:
        running = is_locked(folder)
        store = unfinished(folder)
        if (folder / MANIFEST).exists() and not (running and store):
            manifest = read_manifest(folder)
            result = manifest["result"]
            if not (folder / result["file"]).exists():
                return Status(folder, "damaged", f"{result['file']} is missing; run the study again")
            count = manifest.get("plan", {}).get("chunks", 0)
            detail = (
                f"{human_bytes(result.get('bytes', 0))}, finished {manifest.get('finished') or 'at an unknown time'}"
            )
            return Status(folder, "running" if running else "complete", detail, count, count)
        if store:
            done, total, left = len(store.done()), store.record["chunks"], store.seconds_left()
            words = [f"{done:,} of {total:,} chunks done"]
            if left is not None:
                words.append(f"about {human_seconds(left)} left")
            return Status(folder, "running" if running else "interrupted", ", ".join(words), done, total, left)
        if running:
            return Status(folder, "running", "started")
        if any((folder / name).exists() for name in RESULTS):
            return Status(folder, "damaged", "a result without its manifest; run the study again")
        return Status(folder, "not run", "no result")
    except (HeliosweepError, OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        return Status(folder, "damaged", str(error).removeprefix(f"{folder}/"))


def result_folders(outputs: Path) -> list[Path]:
    """Return the folders below `outputs` in which a study was run or is being run."""
    marks = (MANIFEST, *RESULTS, f"{CHUNKS}*")
    return [folder for folder in sorted(outputs.glob("*/")) if any(next(folder.glob(mark), None) for mark in marks)]


def status_lines(statuses: Sequence[Status]) -> Iterable[str]:
    """Yield one line for each study."""
    width = max((len(str(status.folder)) for status in statuses), default=0)
    states = max((len(status.state) for status in statuses), default=0)
    return (f"{status.folder!s:{width}}  {status.state:{states}}  {status.detail}" for status in statuses)
