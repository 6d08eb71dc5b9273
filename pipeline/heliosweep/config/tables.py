"""The text of CSV tables that a study names: read whole, or refused in words."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NoReturn

from heliosweep.errors import Problem, StudyError

MAX_BYTES = 64 * 2**20
"""Largest table that is read: 600 bytes for each of 100,000 heliostats."""

_UNTOLD = 2**20
"""Most that is read of a file that does not tell its size. [bytes]"""


def table_text(path: Path, name: str, most_bytes: int | None = None) -> str:
    """Return the text of a table; refuse what cannot be one before reading it whole.

    Parameters
    ----------
    path : Path
        The file.
    name : str
        What messages call it.
    most_bytes : int, optional
        Size beyond which it is refused; `MAX_BYTES` where left out. [bytes]

    Raises
    ------
    StudyError
        Where the file cannot be read, is too large or is no text in UTF-8.
    """

    def fail(message: str, line: int | None = None) -> NoReturn:
        raise StudyError(Problem(message, file=name, line=line))

    most = MAX_BYTES if most_bytes is None else most_bytes
    try:
        if path.is_dir():
            fail("is a folder, not a CSV file")
        if path.exists() and not path.is_file():
            fail("is not a regular file")
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            # Reading takes memory for all that is asked for; files of the system say that they are empty.
            data = b"" if size > most else file.read(min(most, size or _UNTOLD) + 1)
    except FileNotFoundError:
        fail("there is no such file")
    except (OSError, ValueError) as error:
        fail(f"cannot be read: {getattr(error, 'strerror', None) or error}")
    if max(size, len(data)) > most or (len(data) > _UNTOLD and not size):
        fail(f"is larger than {most // 2**20} MiB")
    if data.startswith(b"PK\x03\x04"):
        fail("is a spreadsheet or an archive, not text; save the sheet as CSV (UTF-8)")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        fail("is not UTF-8 text; save it as CSV (UTF-8)", data[: error.start].count(b"\n") + 1)
    if "\0" in text:
        fail("is a binary file, not CSV", text[: text.index("\0")].count("\n") + 1)
    return text


def table_lines(text: str) -> tuple[list[int], list[str]]:
    """Return the lines that hold something and are no comment (``#``), after their numbers in the file."""
    every = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    numbers = [number for number, line in enumerate(every, 1) if line.strip() and line[0] != "#"]
    return numbers, [every[number - 1] for number in numbers]
