"""The measured spots of a study: read once, put under their suns, and checked against the rest of the study."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.sweep import Sweep
from heliosweep.errors import Problem, StudyError
from heliosweep.families.misalignment.spots_file import WHOLE, MeasuredSpots, read_spots
from heliosweep.layouts.resolve import Layouts

if TYPE_CHECKING:
    from heliosweep.families.misalignment.study import MisalignmentStudy

#: Suns, and commands, that differ by less are the same.
SAME = 1e-9


def measured_spots(study: MisalignmentStudy) -> MeasuredSpots | None:
    """The measured spots with their suns; None where spots are synthetic. Raises StudyError."""
    name = None if study.calibration is None else study.calibration.spots
    if name is None:
        return None
    count, names = _heliostats(study)
    path, site = study.resolve(name), study.site
    assert site is not None
    place = tuple(value for value in (site.latitude, site.longitude, site.altitude) if not isinstance(value, Sweep))
    assert len(place) == 3
    try:
        stamp = path.stat().st_mtime_ns
    except OSError:
        stamp = 0
    measured = _read_cached(path, stamp, count, names, *place)
    if measured.timed:
        message = "is missing: the sun at the times of the spots depends on it; or give their sun vectors"
        raise StudyError(study.problem("site.longitude", message))
    return measured


def _heliostats(study: MisalignmentStudy) -> tuple[int, tuple[str, ...]]:
    """Number of heliostats, and their names where they have some."""
    if study.layout is None:
        return len(study.heliostats.positions or ()), ()
    layout = Layouts(study)[()]
    column = layout.columns.get("name")
    return len(layout), tuple(map(str, column)) if column is not None else ()


@lru_cache(maxsize=4)
def _read_cached(
    path: Path,
    stamp: int,
    count: int,
    names: tuple[str, ...],
    latitude: float,
    longitude: float | None,
    altitude: float,
) -> MeasuredSpots:
    """Read a file once while it does not change (`stamp`); spots with times stay without suns without a longitude."""
    measured = read_spots(path, count, names)
    if not measured.timed or longitude is None:
        return measured
    from heliosweep.grid.sun import sun_vectors

    return measured.under(sun_vectors(measured.utc, latitude, longitude, altitude))


def most_spots(measured: MeasuredSpots) -> int:
    """Spots of the heliostat with most of them."""
    return int(np.bincount(measured.heliostat).max(initial=1))


def spot_problems(study: MisalignmentStudy, notes: list[str]) -> Iterator[Problem]:
    """Problems of measured spots: keys that do not go with them, and the file itself.

    Parameters
    ----------
    study : MisalignmentStudy
        Study whose blocks are right by themselves.
    notes : list of str
        Gets what the user should know, but may want.
    """
    block = study.calibration
    if block is None or block.spots is None:
        return
    for key in ("days_used", "noise"):
        if getattr(block, key) not in (None, 0.0):
            yield study.problem(f"calibration.{key}", "is for synthetic spots; remove it, or 'spots'")
    if study.mount_errors is not None:
        yield study.problem("mount_errors", "is the truth of synthetic spots; remove it, or 'calibration.spots'")
    one_place = study.site is not None and not any(key.startswith(("site.", "layout.")) for key in study.sweeps())
    if not one_place:
        yield study.problem("calibration.spots", "belong to one site and one layout; leave out what sweeps them")
        return
    try:
        measured = measured_spots(study)
    except StudyError as error:
        yield from (replace(problem, key=problem.key or "calibration.spots") for problem in error.problems)
        return
    assert measured is not None
    counts = np.bincount(measured.heliostat, measured.weight > 0, _heliostats(study)[0])
    if not counts.any():
        yield study.problem("calibration.spots", "no spot has a weight above 0: nothing can be estimated")
        return
    value = block.parameters
    needed = int(max(value[:]) if isinstance(value, Sweep) else value)
    few = np.flatnonzero((counts > 0) & (2 * counts < needed))
    if few.size and few.size == np.count_nonzero(counts):
        message = f"{needed} errors need {needed // 2} spots of a heliostat, and none has so many"
        yield study.problem("calibration.parameters", message)
    elif few.size:
        notes.append(f"heliostat {_listed(few)}: fewer spots than {needed} errors need; nothing is estimated there")
    none = np.flatnonzero(counts == 0)
    if none.size:
        what = "no spots in the file, or none with a weight above 0"
        notes.append(f"heliostat {_listed(none)}: {what}; nothing is estimated there")
    still = np.flatnonzero((2 * counts >= needed) & (counts > 0) & ~_moved(measured, len(counts)))
    if still.size and needed > 2:
        what = "all spots are of one sun; more than two errors cannot be told apart there"
        notes.append(f"heliostat {_listed(still)}: {what}")
    notes.extend(_names_as_numbers(study))


def _listed(numbers: NDArray[np.int64]) -> str:
    return ", ".join(map(str, numbers[:6])) + (f" and {numbers.size - 6:,} others" if numbers.size > 6 else "")


def _moved(measured: MeasuredSpots, count: int) -> NDArray[np.bool_]:
    """Heliostats whose spots with a weight are of more than one sun, or command."""
    used = np.flatnonzero(measured.weight > 0)
    of, seen = measured.heliostat[used], np.nan_to_num(np.hstack([measured.sun, measured.angles])[used])
    first = np.zeros(count, np.int64)
    first[of[::-1]] = np.arange(of.size)[::-1]
    other = (np.abs(seen - seen[first[of]]) > SAME).any(axis=1)
    moved: NDArray[np.bool_] = np.bincount(of, other, count) > 0
    return moved


def _names_as_numbers(study: MisalignmentStudy) -> Iterator[str]:
    """A name counts before a row: names that are other rows' numbers are easily meant as rows."""
    _, names = _heliostats(study)
    other = [row for row, name in enumerate(names) if WHOLE.fullmatch(name) and int(name) != row]
    if other:
        yield (
            f"{len(other):,} names of heliostats are whole numbers but not their rows, as {names[other[0]]!r} of row "
            f"{other[0]}: the file of the spots is read as if it gave names"
        )
