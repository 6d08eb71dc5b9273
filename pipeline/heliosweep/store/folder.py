"""A result folder: the names in it, the claim of a run on it, and the manifest that tells of its result."""

from __future__ import annotations

import errno
import json
import logging
import multiprocessing
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from heliosweep.errors import FORCE, HeliosweepError, Problem, StudyError
from heliosweep.files import sync, write_whole
from heliosweep.store.encoding import slab_digest, slab_rows
from heliosweep.store.parts import WORKING, PartStore

if TYPE_CHECKING:
    import numpy as np

    from heliosweep.config.study import Study
    from heliosweep.grid.plan import Plan
    from heliosweep.grid.regions import Part

log = logging.getLogger("heliosweep")

#: Names of a result, by format.
FORMATS = {"netcdf": "result.nc", "zarr": "result.zarr"}
RESULTS = tuple(FORMATS.values())
MANIFEST = "manifest.json"
#: Files beside a result that describe it, and go when another one takes its place.
DESCRIPTIONS = (MANIFEST, "study.resolved.yaml", "report.html", "comparison.csv")
#: The claimed file of a folder.
LOCK = ".heliosweep.lock"
#: After how long to say that one waits for another run. [s]
_PATIENCE = 0.5
#: How often to look whether it is done. [s]
_PAUSE = 0.05
#: File systems without locks answer so.
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS)
#: How the claimed file is opened: not through a link, and without waiting for the other end of a pipe.
_NO_LINKS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
#: Nesting that no record has, and that functions which walk through one cannot bear. [levels]
_DEEP = 100
#: Of what stands there instead, so much is told. [characters]
_LONG = 200
#: Packages whose versions can touch the numbers or the bytes.
_PACKAGES = ("heliosweep", "numpy", "numba", "llvmlite", "xarray", "dask", "pandas", "netCDF4", "pvlib", "matplotlib")
#: Global attributes that follow from the study and the code, which are compared by themselves.
_FOLLOWING = ("study", "study_id", "id", "history", "source")


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Hold a result folder against other runs, and wait while another one holds it.

    The system lets go of the claim when the process ends, so a killed run leaves none.

    Parameters
    ----------
    folder : pathlib.Path
        Existing folder.

    Raises
    ------
    HeliosweepError
        In a worker process that only begins.
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


class Record(BaseModel):
    """Keys of a JSON file that are relied on; others are let through."""

    model_config = ConfigDict(strict=True, extra="allow")


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


class Manifest(Record):
    """A ``manifest.json``."""

    result: ResultFile
    study_id: Word = ""
    identity: Identity | None = None
    slabs: Slabs | None = None
    plan: Planned = Planned()
    finished: Word = ""


def read_json(path: Path) -> Any:
    """Content of a file.

    Raises
    ------
    OSError
        It cannot be read.
    ValueError
        It is no JSON, or nested deeper than anything that a run writes.
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


def check(content: Any, shape: type[Record]) -> dict[str, Any]:
    """Return what was read if it has a shape.

    Raises
    ------
    ValueError
        It has not; says what is wrong first.
    """
    try:
        shape.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        said = first["msg"][:1].lower() + first["msg"][1:]
        place = ".".join(map(str, first["loc"]))[:_LONG]
        raise ValueError(f"{place}: {said[:_LONG]}" if place else said[:_LONG]) from None
    return dict(content)


def read_manifest(folder: Path, shape: type[Record] = Manifest) -> dict[str, Any]:
    """The manifest of a result folder.

    Raises
    ------
    HeliosweepError
        There is none, or it is damaged; says what is wrong.
    """
    try:
        return check(read_json(folder / MANIFEST), shape)
    except FileNotFoundError:
        raise HeliosweepError(f"{MANIFEST}: is missing; run the study again to write it") from None
    except OSError as error:
        raise HeliosweepError(f"{MANIFEST}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise HeliosweepError(f"{MANIFEST}: is damaged: {error}") from None


def write_manifest(folder: Path, study: Study, result: Path, content: Mapping[str, Any]) -> None:
    """Write ``manifest.json``, as sorted, indented JSON, and the resolved study, for good.

    Parameters
    ----------
    folder : pathlib.Path
        Result folder.
    study : Study
        The study.
    result : pathlib.Path
        Its result.
    content : mapping
        What the manifest says besides the result and the environment.

    Raises
    ------
    HeliosweepError
        They cannot be written.
    """
    from heliosweep.store.read import content_digest, result_bytes, result_digest

    said = {
        "file": result.name,
        "bytes": result_bytes(result),
        "sha256": result_digest(result),
        "content_digest": content_digest(result),
    }
    command = [Path(sys.argv[0]).name, *sys.argv[1:]]
    record = {"command": command, "environment": _environment(), "result": said, **content}
    write_whole(folder / "study.resolved.yaml", study.to_yaml(folder))
    write_whole(folder / MANIFEST, json.dumps(record, indent=2, sort_keys=True, ensure_ascii=False) + "\n")
    sync(folder)


def _environment() -> dict[str, Any]:
    """Versions and machine of this process."""
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processors": os.cpu_count(),
        "packages": {name: _version(name) for name in _PACKAGES},
        "commit": _commit(),
    }


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _commit() -> str | None:
    """Commit of the source tree that heliosweep was imported from, with ``-dirty`` where it was changed since."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=5, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() or None if done.returncode == 0 else None


@dataclass(frozen=True)
class Finished:
    """A finished result as its manifest describes it.

    Parameters
    ----------
    folder : pathlib.Path
        Result folder.
    manifest : mapping
        Content of ``manifest.json``.
    """

    folder: Path
    manifest: Mapping[str, Any]

    @classmethod
    def find(cls, folder: Path) -> Finished | None:
        """The finished result of a folder; None where there is none, or one that no manifest describes."""
        with suppress(HeliosweepError):
            manifest = read_manifest(folder)
            found = cls(folder, manifest)
            if manifest.get("identity") and manifest.get("slabs") and found.path.exists():
                return found
        return None

    @property
    def path(self) -> Path:
        """The result."""
        return self.folder / self.manifest["result"]["file"]

    @property
    def identity(self) -> dict[str, Any]:
        """What it belongs to, as `identity_of` says it."""
        return self.manifest["identity"]

    def holds(self, kind: str, plan: Plan) -> bool:
        """True where it has the variables of one kind, in slabs that are cut as those of a plan."""
        slabs, names = self.manifest["slabs"], {name for name, one in plan.variables.items() if one.kind == kind}
        return slabs["cut"].get(kind) == slab_rows(plan.cuts)[kind] and names <= {*slabs["variables"]}

    def read(self, slab: Part) -> dict[str, np.ndarray]:
        """Values of a slab as they are stored, with times as seconds.

        Raises
        ------
        HeliosweepError
            They are not what was computed.
        """
        from heliosweep.store.read import open_stored

        with open_stored(self.path) as stored:
            values = stored.slab(slab)
        if slab_digest(values) != self.manifest["slabs"]["digests"].get(slab.name):
            raise HeliosweepError(f"{self.path}: {slab.name} is not what was computed; {FORCE} computes it anew")
        return values

    def is_whole(self) -> bool:
        """Whether its bytes are those that the manifest tells of."""
        from heliosweep.store.read import result_digest

        try:
            return result_digest(self.path) == self.manifest["result"]["sha256"]
        except OSError:
            return False

    def changes(self, identity: Mapping[str, Any], key: str) -> str:
        """What of one aspect (``study``, ``code``, ``output``, ``attributes``) is different in another identity."""
        return listed(self.identity.get(key), identity[key])


def identity_of(study: Study, attributes: Mapping[str, Any], module: str) -> dict[str, Any]:
    """What the bytes of a study's result depend on.

    Parameters
    ----------
    study : Study
        The study.
    attributes : mapping
        Global attributes of its result.
    module : str
        Module that its numbers come from.

    Returns
    -------
    dict
        ``study_id`` and ``study``: its meaning; ``code``: versions of what computes it; ``output``: what is stored
        and how; ``attributes``: the words that go with it.
    """
    from heliosweep.store.code_versions import code_versions

    return {
        "study_id": study.study_id,
        "study": study.canonical(),
        "code": code_versions(module),
        "output": study.output.model_dump(),
        "attributes": {name: value for name, value in attributes.items() if name not in _FOLLOWING},
    }


def latest_identity(folders: Iterable[Path]) -> tuple[Path, dict[str, Any]] | None:
    """Of several result folders the one that was written last, finished or not, and what it belongs to."""
    found: list[tuple[float, Path, dict[str, Any]]] = []
    for folder in folders:
        with suppress(OSError, HeliosweepError):
            finished = Finished.find(folder)
            identity = finished.identity if finished else PartStore.open(folder / WORKING).identity
            found.append((folder.stat().st_mtime, folder, identity))
    return max(found, key=lambda entry: entry[0])[1:] if found else None


def changes(before: Any, after: Any, key: str = "") -> list[str]:
    """What is different between two pieces of plain data, one line for each key.

    Parameters
    ----------
    before, after : mapping, list or scalar
        As from JSON.
    key : str
        Dotted key of what is compared.

    Returns
    -------
    list of str
        As ``receiver.height: 60 -> 70``; empty where nothing is different.
    """
    if isinstance(before, Mapping) and isinstance(after, Mapping):
        keys = [*after, *(name for name in before if name not in after)]
        return [
            line
            for name in keys
            for line in changes(before.get(name), after.get(name), f"{key}.{name}" if key else str(name))
        ]
    if _plain(before) == _plain(after):
        return []
    return [f"{key}: {_words(before)} -> {_words(after)}"]


def listed(before: Any, after: Any, most: int = 3) -> str:
    """The first `changes`, in one line."""
    lines = changes(before, after)
    more = f", and {len(lines) - most} more" if len(lines) > most else ""
    return "; ".join(lines[:most]) + more


def _plain(value: Any) -> Any:
    """Tuples as lists, as JSON has them."""
    if isinstance(value, Mapping):
        return {str(name): _plain(entry) for name, entry in value.items()}
    return [_plain(entry) for entry in value] if isinstance(value, list | tuple) else value


def _words(value: Any) -> str:
    if value is None:
        return "not given"
    text = ", ".join(f"{n} {_words(e)}" for n, e in value.items()) if isinstance(value, Mapping) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
