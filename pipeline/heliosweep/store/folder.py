"""Result folder: chunks, lock, manifest, status, protection of other files, and the result.

Each chunk is an ``.npz`` file in a folder whose name depends on the study and the code. Chunks are written atomically,
so a killed run leaves only complete chunks. Each array has a CRC-32 checksum. A damaged chunk is therefore detected
when it is read, and is recomputed.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from html import unescape
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, NamedTuple
from zipfile import BadZipFile
from zlib import error as ZlibError

import numpy as np
from filelock import FileLock, Timeout

from heliosweep.config import Study
from heliosweep.errors import FORCE, HeliosweepError, Problem, StudyError, log, reason_of
from heliosweep.files import LIBRARY_LOCK, human_bytes, named_in, user_path, writing
from heliosweep.grid import Cut, human_seconds
from heliosweep.lazy import xr

#: Prefix of chunk folder names, and name of the file that describes the study and its chunks.
CHUNKS, RECORD = "chunks-", "plan.json"


def unfinished(folder: Path) -> ChunkStore | None:
    """Return the store of the most recent chunks in a result folder, or None if there are no chunks."""
    with suppress(OSError):
        found = [place for place in folder.glob(f"{CHUNKS}*") if (place / RECORD).is_file()]
        return ChunkStore(max(found, key=lambda place: place.stat().st_mtime)) if found else None
    return None


class ChunkStore:
    """Folder of computed chunks. The folder does not exist until `create` is called."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def create(self, cuts: Mapping[str, Cut], **about: Any) -> dict[str, Cut]:
        """Create the folder and return `cuts`, or return the stored cuts if the folder exists."""
        with suppress(OSError, ValueError, TypeError, KeyError):
            return {kind: Cut(**lengths) for kind, lengths in self.record["cuts"].items()}
        content = {"cuts": {kind: vars(cut) for kind, cut in cuts.items()}, **about}
        content["chunks"] = sum(cut.chunk_count for cut in cuts.values())
        with writing(self.folder):
            self.remove()
            self.folder.mkdir(parents=True)
            (self.folder / RECORD).write_text(json.dumps(content, indent=1), encoding="utf-8")
        return dict(cuts)

    @property
    def record(self) -> dict[str, Any]:
        """Description of the study and the chunks. Raises OSError or ValueError if the file is damaged."""
        content: dict[str, Any] = json.loads((self.folder / RECORD).read_text(encoding="utf-8"))
        return content

    def done(self) -> set[str]:
        """Return the names of the stored chunks."""
        return {path.stem for path in self.folder.glob("*.npz")}

    def save(self, name: str, values: Mapping[str, np.ndarray]) -> None:
        """Store the arrays of a chunk. Raises HeliosweepError if the arrays cannot be written."""
        temporary = self.folder / f"{name}.tmp"
        with writing(self.folder):
            with temporary.open("wb") as file:
                np.savez(file, **values)  # type: ignore[arg-type]
            temporary.replace(self.folder / f"{name}.npz")

    def load(self, name: str, keys: Iterable[str] | None = None) -> dict[str, np.ndarray] | None:
        """Return the arrays of a chunk (default: all), or None if the chunk is missing or damaged."""
        try:
            with (self.folder / f"{name}.npz").open("rb") as stream, np.load(stream) as file:
                return {key: file[key] for key in keys or file.files}
        except (OSError, ValueError, KeyError, EOFError, BadZipFile, ZlibError, NotImplementedError):
            return None

    def seconds_left(self) -> float | None:
        """Estimate the time for the missing chunks from the last 20 chunks [s]. Returns None if unknown."""
        times = sorted(path.stat().st_mtime for path in self.folder.glob("*.npz"))
        missing = self.record.get("chunks", 0) - len(times)
        last = times[-20:]
        return (last[-1] - last[0]) / (len(last) - 1) * max(missing, 0) if len(last) > 1 else None

    def remove(self) -> None:
        """Remove the folder with all chunks."""
        shutil.rmtree(self.folder, ignore_errors=True)


#: Default parent folder of result folders, in the working directory. Only this folder has an index page.
OUTPUTS = "outputs"
#: Files in a result folder: data set, manifest, study file of the best point of a search, and lock.
RESULT, MANIFEST, BEST, LOCK = "result.nc", "manifest.json", "best.yaml", ".heliosweep.lock"
#: Names of the study file in a result folder and in an unpacked archive.
STUDIES = ("study.resolved.yaml", "study.yaml")
#: Files that describe a result and are removed when another result replaces it.
DESCRIPTIONS = (MANIFEST, STUDIES[0], "report.html", "comparison.csv", BEST)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock a result folder and wait while another run holds the lock.

    The operating system releases the locks of killed processes. Raises HeliosweepError if the process is a worker
    process that is still starting.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise HeliosweepError(
            'a script must call functions that run studies inside an `if __name__ == "__main__":` block'
        )
    lock = FileLock(folder / LOCK, mode=0o666)
    try:
        lock.acquire(timeout=0.5)
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
        with FileLock(path, timeout=0.1, mode=0o666):  # another process may check the lock at the same time
            return False
    except Timeout:
        return True
    except OSError:  # the folder may belong to another user
        return False


def manifest_text(content: Mapping[str, Any]) -> str:
    """Return a manifest as sorted, indented JSON text with its digest."""
    sealed = {**content, "digest": manifest_digest(content)}
    return json.dumps(sealed, indent=2, sort_keys=True, ensure_ascii=False) + "\n"


def manifest_digest(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 digest of a manifest, excluding the stored digest."""
    body = {key: value for key, value in content.items() if key != "digest"}
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of a result folder. Raises HeliosweepError if the manifest is missing or damaged."""
    try:
        content: dict[str, Any] = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        if content["result"]["file"] != RESULT or not isinstance(content["result"]["sha256"], str):
            raise ValueError("it contains no result")
    except FileNotFoundError:
        raise HeliosweepError(f"{MANIFEST}: is missing: run the study again to write it") from None
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise HeliosweepError(f"{MANIFEST}: is damaged: {error}; run the study again") from None
    return content


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Create a result folder and remove it if it is empty after an error. Raises StudyError if it is not writable."""
    created: list[Path] = []
    try:
        try:
            created += [place for place in (folder, *folder.parents) if not place.exists()]
            folder.mkdir(parents=True, exist_ok=True)
            with TemporaryFile(dir=folder):
                pass
        except OSError as error:
            problem = f"cannot be written: {error.strerror}; specify another folder with --output"
            raise StudyError(Problem(problem, file=str(folder))) from None
        yield
    except BaseException:
        with suppress(OSError):  # the folder is missing, or belongs to another user
            if {entry.name for entry in folder.iterdir()} <= {LOCK}:
                (folder / LOCK).unlink(missing_ok=True)
        for place in created:
            with suppress(OSError):  # the folder is not empty
                place.rmdir()
        raise


def check_contents(folder: Path, study: Study, force: bool) -> None:
    """Raise StudyError if a run would replace inputs of the study, or files that do not belong to a result.

    If `force` is True, the run may replace existing files with the names of result files.
    """
    inputs = {study.resolve(name).resolve() for names in study.files().values() for name in names}
    if study.source.path:
        inputs |= {path.resolve() for path in (study.source.path, *study.source.bases)}
    remedy = "specify another folder with --output"
    for place in (folder / name for name in (*DESCRIPTIONS, RESULT)):
        if any(place.resolve() in (path, *path.parents) for path in inputs):
            raise StudyError(Problem(f"is an input of the study that the run would replace: {remedy}", file=str(place)))
        if place.is_dir():
            raise StudyError(Problem(f"is a folder, not a result file: move it away, or {remedy}", file=str(place)))
    if force or any(folder.glob(f"{CHUNKS}*")) or (folder / MANIFEST).is_file():
        return
    if foreign := [name for name in (RESULT, *DESCRIPTIONS) if (folder / name).exists()]:
        problem = f"contains {', '.join(foreign)} without a manifest: use {FORCE} to replace them, or {remedy}"
        raise StudyError(Problem(problem, file=str(folder)))


def page_head(page: Path) -> tuple[str, str]:
    """Return the title and headline of a page, or empty strings if the page cannot be read."""
    head = ""
    with suppress(OSError), page.open(encoding="utf-8", errors="replace") as file:
        head = file.read(8192)
    title = re.search(r"<title>([^<]*)</title>", head)
    headline = re.search(r'<meta name="description" content="([^"]*)">', head)
    return unescape(title[1] if title else ""), unescape(headline[1] if headline else "")


@dataclass(frozen=True)
class Status:
    """Status of the study in a result folder.

    Parameters
    ----------
    folder : pathlib.Path
        Result folder.
    state : str
        ``complete``, ``running``, ``interrupted``, ``damaged`` or ``not run``.
    detail : str
        Description of the status.
    done, total : int
        Number of stored chunks and total number of chunks.
    seconds_left : float, optional
        Estimated time for the missing chunks, or None if unknown. [s]
    """

    folder: Path
    state: str
    detail: str
    done: int = 0
    total: int = 0
    seconds_left: float | None = None


def status_of(folder: Path) -> Status:
    """Return the status of a result folder. A damaged folder does not raise an exception."""
    try:
        running, store = is_locked(folder), unfinished(folder)
        if (folder / MANIFEST).exists() and not (running and store):
            manifest = read_manifest(folder)
            result, count = manifest["result"], manifest.get("plan", {}).get("chunks", 0)
            if not (folder / result["file"]).exists():
                return Status(folder, "damaged", f"{result['file']} is missing: run the study again")
            finished = manifest.get("finished") or "at an unknown time"
            detail = f"{human_bytes(result.get('bytes', 0))}, finished {finished}"
            return Status(folder, "running" if running else "complete", detail, count, count)
        if store:
            done, total, left = len(store.done()), store.record["chunks"], store.seconds_left()
            detail = f"{done:,} of {total:,} chunks done"
            detail += f", about {human_seconds(left)} left" if left is not None else ""
            return Status(folder, "running" if running else "interrupted", detail, done, total, left)
        if (folder / RESULT).exists():
            return Status(folder, "damaged", "a result without a manifest: run the study again")
        return Status(folder, "running", "started") if running else Status(folder, "not run", "no result")
    except (HeliosweepError, OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        return Status(folder, "damaged", str(error).removeprefix(f"{folder}/"))


def status_lines(statuses: Sequence[Status]) -> Iterable[str]:
    """Yield one line of text for each study."""
    width = max((len(str(status.folder)) for status in statuses), default=0)
    states = max((len(status.state) for status in statuses), default=0)
    return (f"{status.folder!s:{width}}  {status.state:{states}}  {status.detail}" for status in statuses)


def target_file(
    target: str | os.PathLike[str],
    force: bool,
    *,
    endings: Sequence[str] = (".csv",),
    sources: Iterable[str | os.PathLike[str]] = (),
) -> Path:
    """Check and return the path of a file to write.

    Parameters
    ----------
    target : path
        File to write.
    force : bool
        If True, replace an existing file, but never an input file or a file of a run.
    endings : sequence of str
        Allowed suffixes of the name, in upper or lower case. If the sequence is empty, all suffixes are allowed.
    sources : iterable of path
        Input files, which must not be replaced.

    Raises
    ------
    StudyError
        If the file exists and `force` is False, or if the path is a folder, an input file or a file of a result. The
        error is also raised if the suffix is not allowed, or if the folder of the file does not exist.
    """
    file = user_path(target)
    place, ends = file.parent.resolve() / file.name, [*endings[:-2], " or ".join(endings[-2:])]
    owned = {*DESCRIPTIONS, RESULT, LOCK, "figures"}

    def of_a_result(path: Path) -> bool:
        of_run = path.name.lower() in owned or path.name.startswith(CHUNKS)
        return of_run and any((path.parent / mark).exists() for mark in (MANIFEST, RESULT, f"{path.name}/{RECORD}"))

    def is_source(source: str | os.PathLike[str]) -> bool:
        with suppress(OSError):
            return place.resolve() == Path(source).resolve() or place.samefile(source)  # some file systems ignore case
        return False

    for wrong, problem in (
        (file.is_dir(), "is a folder: specify a file"),
        (endings and file.suffix.lower() not in endings, f"must end in {', '.join(ends)}"),
        (any(map(is_source, sources)), "is an input and would be replaced: specify another file"),
        (any(map(of_a_result, (place, *place.parents))), "belongs to a result: specify another file"),
        (file.exists() and not force, f"exists already; {FORCE} replaces it"),
        (not file.parent.is_dir(), "cannot be written: its folder does not exist"),
    ):
        if wrong:
            raise StudyError(Problem(problem, file=str(file)))
    return file


def sources_of(study: Study) -> set[Path]:
    """Return the paths of the study file, its included studies and all their input files."""
    paths = {study.resolve(name) for names in study.files().values() for name in names}
    from heliosweep.config.load import file_names
    from heliosweep.config.source import read

    for path in (study.source.path, *study.source.bases) if study.source.path else ():
        written = read(path).data  # the loaded study contains sites in place of weather files
        paths |= {path, *(named_in(path.parent, name) for _, name in file_names(type(study), written))}
    return paths


def is_netcdf(path: Path) -> bool:
    """Return True if a file starts with a NetCDF signature."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(8).startswith((b"\x89HDF", b"CDF"))  # signatures of HDF5-based and classic files


def locate(path: str | os.PathLike[str]) -> Path:
    """Return the path of a NetCDF file, or of the result file in a folder. Raises StudyError if there is no result."""
    place = user_path(path)
    if not place.exists():
        raise StudyError(Problem("no such file or folder", file=str(place)))
    if place.is_dir() and not (place / RESULT).is_file():
        left = "; its run is not finished" if unfinished(place) else ""
        if (place / "result.zarr").exists():
            left = " in NetCDF; open result.zarr of version 0.1 with xarray.open_zarr, or run the study again"
        raise StudyError(Problem(f"contains no result{left}", file=str(place)))
    return place / RESULT if place.is_dir() else place


def open_result(path: str | os.PathLike[str], chunks: Any = None) -> xr.Dataset:
    """Open a result folder, or a file ``result.nc``, as a lazy data set.

    Parameters
    ----------
    path : path
        Result folder or file.
    chunks : optional
        As in `xarray.open_dataset`.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    StudyError
        If the path contains no result.
    HeliosweepError
        If the result is damaged.
    """
    place = locate(path)
    if not is_netcdf(place):
        raise StudyError(Problem("is not a result: specify a result folder", file=str(place)))
    try:
        with LIBRARY_LOCK:
            result = stored = xr.open_dataset(place.absolute(), engine="netcdf4", lock=LIBRARY_LOCK, chunks=chunks)
    except Exception as error:  # the libraries may raise any exception if a file is damaged
        raise HeliosweepError(f"{place}: is damaged: {reason_of(error)}; run the study again") from error
    old = [str(name) for name in result.variables if "least_tolerance" in str(name)]  # names used by version 0.1
    result = result.rename({name: name.replace("least_tolerance", "minimum_tolerance") for name in old})
    texts = {name: item for name, item in result.coords.items() if item.dtype.kind in "OT"}
    decoded = result.assign_coords(
        {name: (item.dims, item.values.astype(object).astype(str), item.attrs) for name, item in texts.items()}
    )
    decoded.set_close(stored.close)
    return decoded


def result_digest(path: Path) -> str:
    """Return the SHA-256 digest of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_digest(place: Path) -> None:
    """Raise HeliosweepError if the digests of a result and its manifest differ."""
    try:
        recorded = read_manifest(place.parent)["result"]
    except HeliosweepError:
        return
    if recorded["file"] == place.name and recorded["sha256"] != result_digest(place):
        raise HeliosweepError(f"{place}: is damaged: its SHA-256 differs from the manifest; run the study again")


class Verification(NamedTuple):
    """Findings of `verify`. The field `ok` is False if a file is damaged or missing."""

    folder: Path
    finished: bool
    ok: bool
    lines: list[str]

    def __str__(self) -> str:
        verdict = ("intact" if self.finished else "unfinished, no damage so far") if self.ok else "NOT intact"
        return "\n".join([f"{self.folder}: {verdict}", *(f"  {line}" for line in self.lines)])


def verify(folder: str | os.PathLike[str]) -> Verification:
    """Check a finished or unfinished result folder without changing it. Damage is reported without an exception."""
    place = user_path(folder)
    store = None if (place / MANIFEST).exists() else unfinished(place)
    damage, lines, path = list[str](), list[str](), place / RESULT
    try:
        if store:
            done = sorted(store.done())
            damaged = [name for name in done if store.load(name) is None]
            lines.append(f"{len(done) - len(damaged):,} of {store.record['chunks']:,} chunks are done")
            damage += [f"chunk {name}: is damaged; the next run computes it again" for name in damaged]
            lines += damage
            if is_locked(place):
                lines.append("note: a run is active in this folder")
            return Verification(place, False, not damage, lines)
        if not place.is_dir():
            raise HeliosweepError("is not a folder: specify a result folder, or run the study")
        manifest = read_manifest(place)
        if not path.exists():
            damage.append(f"{RESULT}: is missing")
        elif result_digest(path) != manifest["result"]["sha256"]:
            damage.append(f"{RESULT}: differs from the manifest (SHA-256); run the study again")
        else:
            lines.append(f"{RESULT}: {human_bytes(path.stat().st_size)}, agrees with the manifest (SHA-256)")
        if manifest.get("digest", manifest_digest(manifest)) != manifest_digest(manifest):
            damage.append(f"{MANIFEST}: was changed after it was written (SHA-256)")
        if not (place / "report.html").is_file():
            lines.append(f"note: there is no report.html; write it with: heliosweep report {place}")
    except (HeliosweepError, OSError, ValueError) as error:
        damage.append(str(error).removeprefix(f"{place}/"))
    return Verification(place, not store, not damage, [*damage, *lines])
