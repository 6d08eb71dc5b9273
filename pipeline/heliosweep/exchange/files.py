"""Files that are written whole or not at all, and never over others unasked."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from heliosweep.errors import HeliosweepError, Problem, StudyError


def target_file(target: str | os.PathLike[str], force: bool) -> Path:
    """Return the path of a file to write.

    Parameters
    ----------
    target : path
        The file.
    force : bool
        Whether one that is there is replaced.

    Raises
    ------
    StudyError
        The file is there, is a folder, or its folder is not there.
    """
    file = Path(target)
    if file.is_dir():
        raise StudyError(Problem("is a folder; name a file", file=str(file)))
    if file.exists() and not force:
        raise StudyError(Problem("exists already; --force replaces it", file=str(file)))
    if not file.parent.is_dir():
        raise StudyError(Problem("cannot be written: its folder does not exist", file=str(file)))
    return file


@contextmanager
def written_whole(file: Path) -> Iterator[TextIO]:
    """Write a text file that appears under its name when it is complete.

    Raises
    ------
    HeliosweepError
        The file cannot be written; nothing is left behind.
    """
    unfinished = file.with_name(f".{file.name}.{os.getpid()}.tmp")
    try:
        with unfinished.open("w", encoding="utf-8", newline="") as stream:
            yield stream
        unfinished.replace(file)
    except OSError as error:
        raise HeliosweepError(f"{file}: cannot be written: {error.strerror or error}") from error
    finally:
        unfinished.unlink(missing_ok=True)
