"""Tables of the sun's brightness: CSV with the columns ``angle`` [mrad] and ``brightness``."""

from __future__ import annotations

import csv
import math
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.errors import Problem, StudyError

#: Largest table that is read, and problems of one that are listed.
MAX_BYTES, MAX_LISTED = 2**20, 20
#: Brightness relative to the centre above which it is no sun's, and least part by which a sun falls towards its edge.
MAX_BRIGHTNESS, LEAST_FALL = 1.5, 0.05
_COLUMNS = ("angle", "brightness")


class ProfileTable(NamedTuple):
    """A sun profile as it was written."""

    angle: NDArray[np.float64]
    """Angles from the disc centre, rising from 0. [rad]"""
    brightness: NDArray[np.float64]
    """Relative to the disc centre. [1]"""

    @property
    def rises(self) -> int:
        """Steps from the centre to the edge in which the brightness rises."""
        return int(np.count_nonzero(np.diff(self.brightness) > 0.0))


def read_profile(path: Path, name: str = "") -> ProfileTable:
    """Read a sun profile.

    Parameters
    ----------
    path : pathlib.Path
        CSV in UTF-8 with a header, columns ``angle`` [mrad] and ``brightness`` (relative to the disc centre); empty
        lines and lines that start with ``#`` are skipped.
    name : str
        Name of the file in messages; `path` by default.

    Returns
    -------
    ProfileTable

    Raises
    ------
    StudyError
        If the file cannot be read or is no such table; every problem at its line.
    """
    file = name or str(path)
    try:
        stamp = path.stat().st_mtime_ns
        if path.stat().st_size > MAX_BYTES:
            raise StudyError(Problem("is larger than 1 MiB; is this a sun profile?", file=file))
        return _read_cached(path, stamp, file)
    except OSError as error:
        raise StudyError(Problem(f"cannot read the sun profile: {error.strerror}", file=file)) from None
    except UnicodeDecodeError:
        raise StudyError(Problem("cannot read the sun profile: not text in UTF-8", file=file)) from None


@lru_cache(maxsize=4)
def _read_cached(path: Path, stamp: int, file: str) -> ProfileTable:
    """Read a file once while it does not change (`stamp`)."""
    text = path.read_text(encoding="utf-8-sig")
    problems: list[Problem] = []
    rows: list[tuple[int, list[str]]] = []
    for line, content in enumerate(text.splitlines(), start=1):
        if content.strip() and not content.lstrip().startswith("#"):
            try:
                rows.append((line, [cell.strip() for cell in next(csv.reader([content]))]))
            except csv.Error:
                raise StudyError(Problem("is no line of a CSV table", file=file, line=line)) from None
    if not rows or sorted(rows[0][1]) != sorted(_COLUMNS):
        first = rows[0][0] if rows else None
        raise StudyError(Problem("must have a header with the columns angle and brightness", file=file, line=first))
    header = rows[0][1]
    values: list[tuple[float, ...]] = []
    for line, cells in rows[1:]:
        try:
            entry = dict(zip(header, map(_number, cells), strict=True))
        except ValueError:
            problems.append(Problem("must be two numbers, angle and brightness", file=file, line=line))
            continue
        row = tuple(entry[key] for key in _COLUMNS)
        if row[1] < 0.0:
            problems.append(Problem(f"the brightness must not be negative (got {row[1]:g})", file=file, line=line))
        elif row[1] > MAX_BRIGHTNESS:
            message = f"the brightness must be relative to the disc centre, at most {MAX_BRIGHTNESS:g}"
            problems.append(Problem(f"{message} (got {row[1]:g})", file=file, line=line))
        if not values and row[0] != 0.0:
            problems.append(Problem(f"the angles must begin with 0 (got {row[0]:g})", file=file, line=line))
        elif values and row[0] <= values[-1][0]:
            problems.append(Problem(f"the angles must rise (got {row[0]:g})", file=file, line=line))
        values.append(row)
    if not problems and len(values) < 4:
        problems.append(Problem("a sun profile needs 4 rows at least", file=file))
    if not problems:
        problems += _shape_problems(np.array(values), file)
    if problems:
        more = len(problems) - MAX_LISTED
        listed = problems[:MAX_LISTED]
        raise StudyError([*listed, *([Problem(f"and {more} more problems", file=file)] if more > 0 else [])])
    table = np.array(values)
    return ProfileTable(1e-3 * table[:, 0], table[:, 1])


def _shape_problems(table: NDArray[np.float64], file: str) -> list[Problem]:
    few = max(2, len(table) // 20)
    centre, edge = float(table[:few, 1].mean()), float(table[-few:, 1].mean())
    if not edge < centre:
        return [Problem("a sun profile must be darker at its edge than at its centre", file=file)]
    if edge > (1.0 - LEAST_FALL) * centre:
        fall = 100.0 * (1.0 - edge / centre)
        message = f"the brightness falls by only {fall:.2g} % from the centre to the edge: no slopes follow from it"
        return [Problem(f"{message}; {100 * LEAST_FALL:g} % are the least", file=file)]
    if not 0.8 <= centre <= 1.25:
        message = f"the brightness must be relative to the disc centre, where it is {centre:.4g} instead of 1"
        return [Problem(message, file=file)]
    if not 1.0 <= table[-1, 0] <= 20.0:
        return [Problem(f"the last angle must be the disc's radius in mrad (got {table[-1, 0]:g})", file=file)]
    return []


def _number(cell: str) -> float:
    number = float(cell)
    if not math.isfinite(number):
        raise ValueError
    return number
