"""Tables of the sun's brightness: CSV with the columns ``angle`` [mrad] and ``brightness``."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.tables import Column, read_table

#: Largest table that is read. [bytes]
MAX_BYTES = 2**20
#: Brightness relative to the centre above which it is no sun's, and least part by which a sun falls towards its edge.
MAX_BRIGHTNESS, LEAST_FALL = 1.5, 0.05
COLUMNS = {
    "angle": Column("angle from the disc centre, in mrad, from 0 to its edge", required=True),
    "brightness": Column("relative to the disc centre", required=True),
}


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
    try:
        stamp = path.stat().st_mtime_ns
    except OSError:
        stamp = None
    return _read_cached(path, stamp, name or str(path))


@lru_cache(maxsize=4)
def _read_cached(path: Path, stamp: int | None, name: str) -> ProfileTable:
    """Read a file once while it does not change (`stamp`)."""
    table = read_table(path, name, COLUMNS, rows="angles", most_bytes=MAX_BYTES)
    angles, brightness = (table.column(key) for key in COLUMNS)
    before = None
    for row in np.flatnonzero(np.isfinite(angles) & np.isfinite(brightness)).tolist():
        angle, value = angles[row], brightness[row]
        if value < 0.0:
            table.add(f"the brightness must not be negative (got {value:g})", row)
        elif value > MAX_BRIGHTNESS:
            most = f"must be relative to the disc centre, at most {MAX_BRIGHTNESS:g}"
            table.add(f"the brightness {most} (got {value:g})", row)
        if before is None and angle != 0.0:
            table.add(f"the angles must begin with 0 (got {angle:g})", row)
        elif before is not None and angle <= before:
            table.add(f"the angles must rise (got {angle:g})", row)
        before = angle
    table.finish()
    if len(table) < 4:
        table.add("a sun profile needs 4 rows at least")
    elif fault := _shape_fault(angles, brightness):
        table.add(fault)
    table.finish()
    return ProfileTable(1e-3 * angles, brightness)


def _shape_fault(angles: NDArray[np.float64], brightness: NDArray[np.float64]) -> str:
    """Fault of a profile as a whole, in words; empty where there is none."""
    few = max(2, brightness.size // 20)
    centre, edge = float(brightness[:few].mean()), float(brightness[-few:].mean())
    if not edge < centre:
        return "a sun profile must be darker at its edge than at its centre"
    if edge > (1.0 - LEAST_FALL) * centre:
        fall = 100.0 * (1.0 - edge / centre)
        message = f"the brightness falls by only {fall:.2g} % from the centre to the edge: no slopes follow from it"
        return f"{message}; {100 * LEAST_FALL:g} % are the least"
    if not 0.8 <= centre <= 1.25:
        return f"the brightness must be relative to the disc centre, where it is {centre:.4g} instead of 1"
    if not 1.0 <= angles[-1] <= 20.0:
        return f"the last angle must be the disc's radius in mrad (got {angles[-1]:g})"
    return ""
