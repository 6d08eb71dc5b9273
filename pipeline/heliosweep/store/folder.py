"""Result folder: names of its files, the lock of a run, protection of other files, and its manifest."""

from __future__ import annotations

import hashlib
import json
import logging
import multiprocessing
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from html import unescape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from filelock import FileLock, Timeout

from heliosweep.errors import FORCE, HeliosweepError, Problem, StudyError
from heliosweep.files import temporary_name
from heliosweep.store.chunks import CHUNKS

if TYPE_CHECKING:
    from heliosweep.config.study import Study

log = logging.getLogger("heliosweep")

#: Default folder of result folders, below the working directory; only there an index is written.
OUTPUTS = "outputs"
#: Names of a result, by format.
FORMATS = {"netcdf": "result.nc", "zarr": "result.zarr"}
RESULTS = tuple(FORMATS.values())
MANIFEST = "manifest.json"
#: The best point of a search, as a study.
BEST = "best.yaml"
#: Files by which a Zarr group is recognised, in formats 2 and 3.
GROUPS = (".zmetadata", "zarr.json")
#: The study of a result: of a run, and of an unpacked archive.
STUDIES = ("study.resolved.yaml", "study.yaml")
#: Files that describe a result, and are removed when another result replaces it.
DESCRIPTIONS = (MANIFEST, STUDIES[0], "report.html", "comparison.csv", BEST)
#: Lock file of a folder.
LOCK = ".heliosweep.lock"
#: Time after which a run that waits for another one reports it. [s]
_PATIENCE = 0.5


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock a result folder, waiting for other runs in it. The system releases the lock of a killed process.

    Raises HeliosweepError in a worker process that is being started.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise HeliosweepError('a script that runs a study must do so below `if __name__ == "__main__":`')
    lock = FileLock(folder / LOCK, mode=0o666)
    try:
        lock.acquire(timeout=_PATIENCE)
    except Timeout:
        log.warning("another process is running in %s; waiting for it (Ctrl-C to stop)", folder)
        lock.acquire()
    try:
        yield
    finally:
        lock.release()


def is_locked(folder: Path) -> bool:
    """Return True if a run is active in a folder."""
    path = folder / LOCK
    if not path.is_file():
        return False
    try:
        with FileLock(path, timeout=0, mode=0o666):
            return False
    except Timeout:
        return True
    except OSError:  # somebody else's folder
        return False


def is_zarr(path: Path) -> bool:
    """Return True for a folder that looks like a Zarr group."""
    return any((path / name).is_file() for name in GROUPS)


def manifest_text(content: Mapping[str, Any]) -> str:
    """Return a manifest as sorted, indented JSON, with its digest."""
    sealed = {**content, "digest": manifest_digest(content)}
    return json.dumps(sealed, indent=2, sort_keys=True, ensure_ascii=False) + "\n"


def manifest_digest(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a manifest without the digest in it."""
    body = {key: value for key, value in content.items() if key != "digest"}
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of a result folder. Raises HeliosweepError if it is missing or damaged."""
    try:
        content = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        if content["result"]["file"] not in RESULTS or not isinstance(content["result"]["sha256"], str):
            raise ValueError("it names no result")
    except FileNotFoundError:
        raise HeliosweepError(f"{MANIFEST}: is missing; run the study again to write it") from None
    except OSError as error:
        raise HeliosweepError(f"{MANIFEST}: cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise HeliosweepError(f"{MANIFEST}: is damaged: {error}; run the study again") from None
    return dict(content)


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Make a result folder and check that it can be written; remove it if it stays empty. Raises StudyError."""
    created: list[Path] = []
    try:
        for place in (*reversed(folder.parents), folder):
            if not place.is_dir():
                place.mkdir(exist_ok=True)
                created.append(place)
        probe = temporary_name(folder / RESULTS[0])
        probe.touch()
        probe.unlink()
    except OSError as error:
        _remove_empty(created)
        problem = f"cannot write there: {error.strerror}; name another folder with --output"
        raise StudyError(Problem(problem, file=str(folder))) from None
    try:
        yield
    except BaseException:
        if {entry.name for entry in folder.iterdir()} <= {LOCK}:
            (folder / LOCK).unlink(missing_ok=True)
        _remove_empty(created)
        raise


def _remove_empty(folders: list[Path]) -> None:
    for place in reversed(folders):
        with suppress(OSError):  # it holds something
            place.rmdir()


def check_contents(folder: Path, study: Study, force: bool) -> None:
    """Check that a run replaces no input of the study, and no files that no run has written.

    With `force`, files with the names of a result are replaced. Raises StudyError.
    """
    inputs = {study.resolve(name).resolve() for names in study.files().values() for name in names}
    if study.source.path:
        inputs |= {path.resolve() for path in (study.source.path, *study.source.bases)}
    for name in (*DESCRIPTIONS, *RESULTS):
        target = (folder / name).resolve()
        if any(target == path or target in path.parents for path in inputs):
            _refuse(folder / name, "is an input of the study, and the run would replace it")
        if (folder / name).is_dir() and not is_zarr(folder / name):
            _refuse(folder / name, "is a folder that is no result; move it away")
    if any(folder.glob(f"{CHUNKS}*")) or (folder / MANIFEST).is_file():
        return
    foreign = [name for name in (*RESULTS, *DESCRIPTIONS) if (folder / name).exists()]
    if foreign and not force:
        _refuse(folder, f"contains {', '.join(foreign)} without a manifest; {FORCE} replaces existing files")


def _refuse(path: Path, problem: str) -> None:
    raise StudyError(Problem(f"{problem}, or name another folder with --output", file=str(path)))


def page_head(page: Path) -> tuple[str, str]:
    """Return title and headline of a page, without the report's libraries; empty without a page."""
    head = ""
    with suppress(OSError), page.open(encoding="utf-8", errors="replace") as file:
        head = file.read(8192)
    patterns = r"<title>([^<]*)</title>", r'<meta name="description" content="([^"]*)">'
    found = (re.search(pattern, head) for pattern in patterns)
    title, headline = (unescape(one.group(1)) if one else "" for one in found)
    return title, headline
