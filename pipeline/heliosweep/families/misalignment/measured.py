"""The measured spots of a study: read once, put under their suns, and checked against the rest of the study."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from heliosweep.config.sweep import Sweep
from heliosweep.errors import Problem, StudyError
from heliosweep.families.misalignment.spots_file import MeasuredSpots, read_spots
from heliosweep.layouts.resolve import Layouts

if TYPE_CHECKING:
    from heliosweep.families.misalignment.config import MisalignmentStudy

__all__ = ["measured_spots", "most_spots", "spot_problems"]


def measured_spots(study: MisalignmentStudy) -> MeasuredSpots | None:
    """The measured spots with their suns; None where spots are synthetic. Raises StudyError."""
    name = None if study.calibration is None else study.calibration.spots
    if name is None:
        return None
    names: tuple[str, ...] = ()
    if study.layout is None:
        count = len(study.heliostats.positions or ())
    else:
        layout = Layouts(study)[()]
        count, column = len(layout), layout.columns.get("name")
        names = tuple(map(str, column)) if column is not None else ()
    path, site = study.resolve(name), study.site
    assert site is not None
    place = tuple(value for value in (site.latitude, site.longitude, site.altitude) if not isinstance(value, Sweep))
    assert len(place) == 3
    try:
        stamp = path.stat().st_mtime_ns
    except OSError:
        stamp = 0
    try:
        return _read_cached(path, stamp, count, names, *place)
    except _NoLongitude:
        message = "is missing: the sun at the times of the spots depends on it; or give their sun vectors"
        raise StudyError(study.problem("site.longitude", message)) from None


class _NoLongitude(Exception):
    """Spots have times, and the site no longitude."""


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
    """Read a file once while it does not change (`stamp`)."""
    measured = read_spots(path, count, names)
    if not measured.timed:
        return measured
    if longitude is None:
        raise _NoLongitude
    from heliosweep.families import fast_sun

    return measured.under(fast_sun.sun_vectors(measured.utc, latitude, longitude, altitude))


def most_spots(measured: MeasuredSpots) -> int:
    """Spots of the heliostat with most of them."""
    return int(np.bincount(measured.heliostat).max(initial=1))


def spot_problems(study: MisalignmentStudy, notes: list[str]) -> Iterator[Problem]:
    """What is wrong with measured spots: keys that do not go with them, and the file itself.

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
    counts = np.bincount(measured.heliostat, measured.weight > 0)
    value = block.parameters
    needed = int(max(value[:]) if isinstance(value, Sweep) else value)
    few = np.flatnonzero((counts > 0) & (2 * counts < needed))
    if few.size and few.size == np.count_nonzero(counts):
        message = f"{needed} errors need {needed // 2} spots of a heliostat, and none has so many"
        yield study.problem("calibration.parameters", message)
    elif few.size:
        listed = ", ".join(map(str, few[:6])) + (" and others" if few.size > 6 else "")
        notes.append(f"heliostat {listed}: fewer spots than {needed} errors need; nothing is estimated there")
