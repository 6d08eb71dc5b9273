"""The file that a user names to be written: never over others unasked."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from heliosweep.errors import FORCE, Problem, StudyError
from heliosweep.files import named_in, user_path
from heliosweep.store.chunks import CHUNKS, RECORD
from heliosweep.store.folder import DESCRIPTIONS, LOCK, MANIFEST, RESULTS

if TYPE_CHECKING:
    from heliosweep.config.study import Study


#: Endings of tables, in any case of letters.
TABLES = (".csv",)


def target_file(
    target: str | os.PathLike[str],
    force: bool,
    *,
    endings: Sequence[str] = TABLES,
    sources: Iterable[str | os.PathLike[str]] = (),
) -> Path:
    """Return the path of a file to write.

    Parameters
    ----------
    target : path
        The file.
    force : bool
        Replace an existing file, but never a source or a file of a run.
    endings : sequence of str
        Allowed endings of the name (default: all).
    sources : iterable of path
        Files that are read.

    Raises
    ------
    StudyError
        If the file exists, is a folder, is a source, belongs to a result or has another ending, or its folder does not
        exist.
    """
    file = user_path(target)
    if file.is_dir():
        raise StudyError(Problem("is a folder; name a file", file=str(file)))
    if endings and file.suffix.lower() not in endings:
        raise StudyError(
            Problem(f"must end in {', '.join(endings[:-1])}{' or ' * (len(endings) > 1)}{endings[-1]}", file=str(file))
        )
    place = file.resolve()
    if any(place == Path(source).resolve() or _is_same(file, source) for source in sources):
        raise StudyError(Problem("is an input and would be replaced; name another file", file=str(file)))
    if _is_of_a_result(file.parent.resolve() / file.name):
        raise StudyError(Problem("belongs to a result; name another file", file=str(file)))
    if file.exists() and not force:
        raise StudyError(Problem(f"exists already; {FORCE} replaces it", file=str(file)))
    if not file.parent.is_dir():
        raise StudyError(Problem("cannot be written: its folder does not exist", file=str(file)))
    return file


def sources_of(study: Study) -> set[Path]:
    """Return the study file, included studies, and all files named by them, including files of sites."""
    paths = {study.resolve(name) for names in study.files().values() for name in names}
    from heliosweep.config.layers import file_names
    from heliosweep.config.source import read

    for path in (study.source.path, *study.source.bases) if study.source.path else ():
        written = read(path).data  # the study contains the sites of weather files
        paths |= {path, *(named_in(path.parent, name) for _, name in file_names(type(study), written))}
    return paths


def _is_same(file: Path, source: str | os.PathLike[str]) -> bool:
    """Return True for two names of one file, for instance on file systems that ignore case."""
    try:
        return file.samefile(source)
    except OSError:
        return False


def _is_of_a_result(path: Path) -> bool:
    """True for a path that is, or lies in, something in a result folder that a run writes."""
    owned = {*DESCRIPTIONS, *RESULTS, LOCK, "figures"}
    for place in (path, *path.parents):
        name = place.name.lower()
        ours = name in owned or name.startswith(CHUNKS)
        if ours and any((place.parent / mark).exists() for mark in (MANIFEST, *RESULTS)):
            return True
    return path.parent.name.startswith(CHUNKS) and (path.parent / RECORD).exists()
