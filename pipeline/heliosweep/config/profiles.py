"""Reader of measured sun profiles: brightness against the angle from the disc centre."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from heliosweep.config.tables import Column, read_table
from heliosweep.files import read_once

#: Maximum number of rows.
MAX_ANGLES = 10_000
_COLUMNS = {
    "angle": Column("from the sun's centre, in mrad, from 0", required=True, least=0, most=100,
                    bounds="between 0 and 100 mrad"),
    "brightness": Column("at the angle, in any unit", required=True, least=0, bounds="at least 0"),
}  # fmt: skip


class SunProfile(NamedTuple):
    """Brightness of the sun as it was written."""

    #: Angles from the disc centre, increasing from 0. [rad]
    angle: tuple[float, ...]
    #: Brightness at these angles, in any unit.
    brightness: tuple[float, ...]

    @property
    def rises(self) -> int:
        """Number of steps from the centre to the edge in which the brightness increases."""
        return int(np.count_nonzero(np.diff(self.brightness) > 0.0))

    def note(self, name: str) -> str:
        """Return a warning if the brightness increases somewhere, else an empty text."""
        steps = f"{self.rises} of {len(self.angle) - 1} steps from the centre to the edge"
        return f"{name}: the brightness rises in {steps}: noise?" if self.rises else ""


@read_once(4)
def read_profile(path: Path, name: str) -> SunProfile:
    """Read a sun profile.

    Parameters
    ----------
    path : pathlib.Path
        CSV table with the columns ``angle`` [mrad], increasing from 0, and ``brightness``, in any unit.
    name : str
        Name of the file in messages.

    Returns
    -------
    SunProfile

    Raises
    ------
    StudyError
        If the file cannot be read or is no such table: every problem at its line.
    """
    table = read_table(path, name, _COLUMNS, rows="angles", most_rows=MAX_ANGLES)
    angle, brightness = (table.column(key) for key in _COLUMNS)
    if len(table) and angle[0] != 0.0:
        table.add(f"the angles must begin with 0 (got {angle[0]:g})", 0)
    for row in np.flatnonzero(np.diff(angle) <= 0.0) + 1:
        table.add(f"the angles must increase (got {angle[row]:g})", int(row))
    if len(table) < 2:
        table.add("a sun profile needs at least 2 rows")
    elif brightness[0] == 0.0:
        table.add("the brightness must be above 0 at the centre", 0)
    table.finish()
    return SunProfile(tuple((1e-3 * angle).tolist()), tuple(brightness.tolist()))
