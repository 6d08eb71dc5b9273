"""The result folder before a run: made, tried out, and held against what is in it that is not ours."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from heliosweep.config.study import Study
from heliosweep.errors import FORCE, Problem, StudyError
from heliosweep.files import temporary_name
from heliosweep.store.folder import DESCRIPTIONS, LOCK, RESULTS, read_json
from heliosweep.store.parts import WORKING
from heliosweep.store.read import is_zarr

#: Variable of the environment by which the HDF5 library goes without locks.
_HDF5_LOCKS = "HDF5_USE_FILE_LOCKING"


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Make the result folder and try it out; where nothing comes into it, remove what was made.

    Raises
    ------
    StudyError
        Where it cannot be written.
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
    try:
        _check_locks(probe)
    finally:
        probe.unlink()


def _check_locks(probe: Path) -> None:
    """Check that the HDF5 library, which wants to lock what it writes, finds locks or is told to go without."""
    from filelock import lock_descriptor

    if os.environ.get(_HDF5_LOCKS, "").upper() in ("FALSE", "0"):
        return
    with probe.open("a") as file:
        try:
            lock_descriptor(file.fileno(), blocking=False)
        except OSError as error:
            problem = (
                f"has no locks ({error.strerror}), which the HDF5 library wants: set {_HDF5_LOCKS}=FALSE in the "
                "environment before Python starts, or name another folder with --output"
            )
            raise StudyError(Problem(problem, file=str(probe.parent))) from None


def is_tidy(folder: Path) -> bool:
    """Whether no run is at work in a folder, and none that was killed has left anything but its result."""
    names = (WORKING, LOCK)
    return not any((folder / name).exists() for name in names) and not any(folder.glob(".*.part"))


def check_contents(folder: Path, study: Study, force: bool) -> None:
    """Make sure that a run replaces nothing in its folder that no run has left.

    Parameters
    ----------
    folder : pathlib.Path
        Result folder; it may be missing.
    study : Study
        The study, whose own files must not be replaced either.
    force : bool
        Whether the user agrees to lose single files of the names that a run writes.

    Raises
    ------
    StudyError
        Where something would be lost.
    """
    place = WORKING
    for name in (*DESCRIPTIONS, RESULTS[0], LOCK):
        if (folder / name).is_dir():
            raise StudyError(Problem(f"is a folder, where {name} shall stand", file=str(folder / name)))
    if (folder / place).exists() and not _is_working_store(folder / place):
        _refuse(folder / place, "is none of heliosweep's, and parts of the run would stand there; move it away")
    for path in _inputs(study):
        for name in (*DESCRIPTIONS, *RESULTS, place, LOCK):
            if path == (target := (folder / name).resolve()) or target in path.parents:
                _refuse(folder / name, "is read by the study, and the run would replace it")
    if (folder / place).exists() or _is_manifest(folder / "manifest.json"):
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
        paths.add(Path(study.source.path))
    return {path.resolve() for path in paths}


def _is_working_store(path: Path) -> bool:
    """Whether a folder holds what a run has left, damaged or not."""
    return path.is_dir() and any((path / name).exists() for name in ("study.json", "journal.jsonl", "values.bin"))


def _is_manifest(path: Path) -> bool:
    """Whether a file is a manifest that a run has left."""
    try:
        found = read_json(path)
        return "study_id" in found and "result" in found
    except (OSError, ValueError, TypeError):
        return False
