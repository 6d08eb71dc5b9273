"""A result folder: the names in it, the claim of a run on it, what it must not replace, and reading its manifest."""

from __future__ import annotations

import errno
import hashlib
import json
import logging
import multiprocessing
import os
import platform
import stat
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from heliosweep.errors import FORCE, HeliosweepError, Problem, StudyError
from heliosweep.files import temporary_name
from heliosweep.store.parts import DESCRIPTION, JOURNAL, VALUES, WORKING

if TYPE_CHECKING:
    from heliosweep.config.study import Study

log = logging.getLogger("heliosweep")

#: Where results go when nobody says: below the working directory. Only there an index is written unasked.
OUTPUTS = "outputs"
#: Names of a result, by format.
FORMATS = {"netcdf": "result.nc", "zarr": "result.zarr"}
RESULTS = tuple(FORMATS.values())
MANIFEST = "manifest.json"
#: The best point of a search, as a study.
BEST = "best.yaml"
#: File by which a Zarr group is known.
CONSOLIDATED = ".zmetadata"
#: The study beside a result: of a run, and of an unpacked archive.
STUDIES = ("study.resolved.yaml", "study.yaml")
#: Files beside a result that describe it, and go when another one takes its place.
DESCRIPTIONS = (MANIFEST, STUDIES[0], "report.html", "comparison.csv", BEST)
#: The claimed file of a folder.
LOCK = ".heliosweep.lock"
#: After how long to say that one waits for another run. [s]
_PATIENCE = 0.5
#: How often to look whether it is done. [s]
_PAUSE = 0.05
#: File systems without locks answer so.
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS)
#: Variable of the environment by which the HDF5 library goes without locks.
_HDF5_LOCKS = "HDF5_USE_FILE_LOCKING"
#: How the claimed file is opened: not through a link, and without waiting for the other end of a pipe.
_NO_LINKS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
#: Nesting that no record has, and that functions which walk through one cannot bear. [levels]
_DEEP = 100
#: Of what stands there instead, so much is told. [characters]
_LONG = 200


def refuse_devices(place: Path) -> None:
    """Refuse a result, or a folder with one, where a pipe, a socket or a device stands for one of its files.

    Reading one may wait for ever, or never end. Of parts, links are refused too: writing would follow them. Raises
    StudyError, which names the first one.
    """
    working = place / WORKING
    parts = [working, *(working / name for name in (DESCRIPTION, VALUES, JOURNAL))]
    if link := next((path for path in parts if path.is_symlink()), None):
        raise StudyError(Problem("is a link, and no file of a run; move it away", file=str(link)))
    for path in (
        place,
        *(place / name for name in (*RESULTS, *DESCRIPTIONS, LOCK)),
        *parts,
        *sorted((place / "figures").glob("*")),
    ):
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise StudyError(Problem("is a pipe, a socket or a device, and no file; move it away", file=str(path)))


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Hold an existing result folder against other runs, and wait while another one holds it.

    The system lets go of the claim when the process ends, so a killed run leaves none. Raises HeliosweepError in a
    worker process that only begins.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        # Waiting would never end: the process that waits for this one to start holds the folder.
        raise HeliosweepError('a script that runs a study must do so below `if __name__ == "__main__":`')
    path, start, told = folder / LOCK, time.monotonic(), False
    while (claim := _take(path)) is None:
        if not told and time.monotonic() - start > _PATIENCE:
            log.warning("%s is at work in %s; waiting for it (Ctrl-C to give up)", _who(path), folder)
            told = True
        time.sleep(_PAUSE)
    try:
        with suppress(OSError):  # a full disk; it is only a courtesy to others
            os.ftruncate(claim, 0)
            os.write(claim, json.dumps({"process": os.getpid(), "host": platform.node()}).encode())
        yield
    finally:
        with suppress(OSError):
            path.unlink()  # while it is held: whoever takes it now holds a file without a name, and notices
        os.close(claim)


def _take(path: Path) -> int | None:
    """Descriptor of the claimed file, locked; None where another run holds it.

    Raises
    ------
    StudyError
        It is a link, which is not followed out of the folder.
    """
    from filelock import lock_descriptor

    try:
        with suppress(FileExistsError):  # it was there, and is gone again
            path.parent.mkdir(parents=True, exist_ok=True)
        claim = os.open(path, os.O_RDWR | os.O_CREAT | _NO_LINKS, 0o666)
    except FileNotFoundError:  # a run that leaves nothing takes its folder with it
        return None
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise StudyError(Problem("is a link, and no file of a run; move it away", file=str(path))) from None
        raise
    if (found := os.fstat(claim)).st_nlink > 1 or not stat.S_ISREG(found.st_mode):
        os.close(claim)
        raise StudyError(Problem("is another file too, or none, and no file of a run; move it away", file=str(path)))
    try:
        if lock_descriptor(claim, blocking=False) and os.path.samestat(os.fstat(claim), path.stat()):
            return claim
    except FileNotFoundError:
        pass
    except OSError as error:
        if error.errno in _NO_LOCKS:
            return claim
        os.close(claim)
        raise
    os.close(claim)
    return None


def holder(folder: Path) -> str | None:
    """Process that runs a study in a folder now, in words; None where there is none."""
    from filelock import lock_descriptor

    path = folder / LOCK
    try:
        descriptor = os.open(path, os.O_RDONLY | _NO_LINKS)
    except OSError:
        return None
    try:
        return None if lock_descriptor(descriptor, blocking=False) else _who(path)
    except OSError:  # no locks here
        return None
    finally:
        os.close(descriptor)


def _who(path: Path) -> str:
    try:
        said = json.loads(path.read_text())
        return f"process {said['process']} on {said['host']}"
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return "another process"


def is_zarr(path: Path) -> bool:
    """True for what looks like a Zarr group with consolidated metadata."""
    return (path / CONSOLIDATED).is_file()


class Record(BaseModel):
    """Keys of a JSON file that are relied on; others are let through."""

    model_config = ConfigDict(strict=True, extra="allow", defer_build=True)


#: Identifiers and dates: printed as they are.
Word = Annotated[str, Field(pattern="^[ -~]{0,64}$")]


class Identity(Record):
    """What a result belongs to, as `identity_of` says it."""

    study_id: Word = ""
    study: dict[str, Any] = {}
    code: dict[str, Any] = {}
    output: dict[str, Any] = {}
    attributes: dict[str, Any] = {}


class ResultFile(Record):
    """The result that a manifest is of."""

    file: Literal["result.nc", "result.zarr"]
    sha256: str
    bytes: Annotated[int, Field(ge=0, le=2**63)] = 0
    content_digest: str = ""


class Slabs(Record):
    """Its slabs: how it is cut, as `encoding.slab_rows` says it, SHA-256 of each, and names of the variables."""

    cut: dict[str, list[list[Any]]]
    digests: dict[str, str]
    variables: list[str] = []


class Planned(Record):
    """What the plan said."""

    parts: Annotated[int, Field(ge=0, le=2**63)] = 0
    evaluations: int | None = None


class Environment(Record):
    """Where it was computed."""

    python: str | None = None
    platform: str | None = None
    packages: dict[str, str | None] = {}
    commit: str | None = None


class Manifest(Record):
    """A ``manifest.json``."""

    result: ResultFile
    study_id: Word = ""
    identity: Identity | None = None
    slabs: Slabs | None = None
    plan: Planned = Planned()
    finished: Word = ""
    environment: Environment = Environment()
    command: list[str] = []
    study_file: str = ""
    remarks: list[str] = []
    scheduler: str | None = None
    seconds: dict[str, float] = {}
    workers: int | None = None


def read_json(path: Path) -> Any:
    """Content of a file.

    Raises OSError where it cannot be read, ValueError where it is no JSON, or nested deeper than any run writes.
    """
    if path.exists() and not path.is_file():  # a pipe would be waited for
        raise ValueError("it is no file")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    level = [content]
    for _ in range(_DEEP):
        level = [entry for item in level for entry in _entries(item)]
        if not level:
            return content
    raise ValueError("it is nested too deeply")


def _entries(item: Any) -> Any:
    return item.values() if isinstance(item, dict) else item if isinstance(item, list) else ()


def manifest_text(content: Mapping[str, Any]) -> str:
    """Text of a manifest: sorted, indented JSON, with a digest of all that it says."""
    sealed = {**content, "digest": manifest_digest(content)}
    return json.dumps(sealed, indent=2, sort_keys=True, ensure_ascii=False) + "\n"


def manifest_digest(content: Mapping[str, Any]) -> str:
    """SHA-256 of what a manifest says, but for this digest."""
    said = {key: value for key, value in content.items() if key != "digest"}
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a result folder.

    Raises HeliosweepError where there is none, or it is damaged; says what is wrong.
    """
    try:
        content = read_json(folder / MANIFEST)
        Manifest.model_validate(content)
        return dict(content)
    except FileNotFoundError:
        raise HeliosweepError(f"{MANIFEST}: is missing; run the study again to write it") from None
    except OSError as error:
        raise HeliosweepError(f"{MANIFEST}: cannot be read: {error.strerror}") from None
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        said = first["msg"][:1].lower() + first["msg"][1:]
        place = ".".join(map(str, first["loc"]))[:_LONG]
        said = f"{place}: {said[:_LONG]}" if place else said[:_LONG]
        raise HeliosweepError(f"{MANIFEST}: is damaged: {said}") from None
    except ValueError as error:
        raise HeliosweepError(f"{MANIFEST}: is damaged: {error}") from None


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Make the result folder and try it out; where nothing comes into it, remove what was made.

    Raises StudyError where it cannot be written.
    """
    created: list[Path] = []
    try:
        try:
            try:
                _make(folder, created)
            except (FileExistsError, FileNotFoundError):  # another run left nothing, and took the folder with it
                _make(folder, created)
        except OSError as error:
            problem = f"cannot write there: {error.strerror}; name another folder with --output"
            raise StudyError(Problem(problem, file=str(folder))) from None
        yield
    except BaseException:
        for place in reversed(created):
            with suppress(OSError):  # something is in it
                place.rmdir()
        raise


def _make(folder: Path, created: list[Path]) -> None:
    for place in (*reversed(folder.parents), folder):
        if not place.is_dir():
            place.mkdir(exist_ok=True)
            created.append(place)
    probe = temporary_name(folder / "result.nc")
    probe.touch()
    probe.unlink()


def check_locks(folder: Path) -> None:
    """Check that the HDF5 library, which wants to lock what it writes, finds locks or is told to go without.

    Raises StudyError.
    """
    from filelock import lock_descriptor

    if os.environ.get(_HDF5_LOCKS, "").upper() in ("FALSE", "0"):
        return
    probe = temporary_name(folder / "result.nc")
    try:
        with probe.open("w") as file:
            lock_descriptor(file.fileno(), blocking=False)
    except OSError as error:
        problem = (
            f"has no locks ({error.strerror}), which the HDF5 library wants: set {_HDF5_LOCKS}=FALSE in the "
            "environment before Python starts, or name another folder with --output"
        )
        raise StudyError(Problem(problem, file=str(folder))) from None
    finally:
        probe.unlink(missing_ok=True)


def is_tidy(folder: Path) -> bool:
    """True where no run is at work in a folder, and none that was killed has left anything but its result."""
    names = (WORKING, LOCK)
    return not any((folder / name).exists() for name in names) and not any(folder.glob(".*.part"))


def check_contents(folder: Path, study: Study, force: bool) -> None:
    """Make sure that a run replaces nothing in its folder that no run has left, nor files that the study reads.

    With `force` the user agrees to lose single files of the names that a run writes. Raises StudyError where something
    would be lost.
    """
    for name in (*DESCRIPTIONS, RESULTS[0], LOCK):
        if (folder / name).is_dir():
            raise StudyError(Problem(f"is a folder, where {name} shall stand; move it away", file=str(folder / name)))
    if (folder / WORKING).exists() and not _is_working_store(folder / WORKING):
        _refuse(folder / WORKING, "is none of heliosweep's, and parts of the run would stand there; move it away")
    for path in _inputs(study):
        for name in (*DESCRIPTIONS, *RESULTS, WORKING, LOCK):
            if path == (target := (folder / name).resolve()) or target in path.parents:
                _refuse(folder / name, "is read by the study, and the run would replace it")
    if (folder / WORKING).exists() or _is_manifest(folder / MANIFEST):
        return
    foreign = [name for name in (*RESULTS, *DESCRIPTIONS) if (folder / name).exists()]
    for name in foreign:
        if (folder / name).is_dir() and not is_zarr(folder / name):
            _refuse(folder / name, "is none of heliosweep's, and the run would replace it; move it away")
    if foreign and not force:
        _refuse(folder, f"holds {', '.join(foreign)} without a manifest of heliosweep; {FORCE} replaces what is there")


def _refuse(path: Path, why: str) -> None:
    raise StudyError(Problem(f"{why}, or name another folder with --output", file=str(path)))


def _inputs(study: Study) -> set[Path]:
    """The study file and all files that it names, links followed."""
    paths = {study.resolve(name) for names in study.files().values() for name in names}
    if study.source.path:
        paths |= {study.source.path, *study.source.bases}
    return {path.resolve() for path in paths}


def _is_working_store(path: Path) -> bool:
    """True for a folder that holds what a run has left, damaged or not."""
    return path.is_dir() and any((path / name).exists() for name in (DESCRIPTION, JOURNAL, VALUES))


def _is_manifest(path: Path) -> bool:
    """True for a manifest that a run has left."""
    try:
        found = read_json(path)
        return "study_id" in found and "result" in found
    except (OSError, ValueError, TypeError):
        return False
