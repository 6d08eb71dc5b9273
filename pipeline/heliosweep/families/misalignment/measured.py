"""Checks of tables of measured spots and crossings against the study that names them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.faults import few_of
from heliosweep.config.sweep import ends
from heliosweep.config.tables import MAX_LISTED
from heliosweep.errors import Problem, StudyError, listed
from heliosweep.families.misalignment.spots_file import WHOLE, MeasuredSpots
from heliosweep.layouts.resolve import Layouts

if TYPE_CHECKING:
    from heliosweep.families.misalignment.study import MisalignmentStudy

#: Farthest spot from the aim point, as a share of its heliostat's distance: four times the errors of a poor mount. [1]
FARTHEST_SPOT = 0.2
#: Farthest crossing from an array of detectors: beyond, one of them must be wrong. [m]
FARTHEST_CROSSING = 0.1


def examine_table(study: MisalignmentStudy) -> Iterator[Problem | str]:
    """Problems and warnings of measured spots or crossings: keys that do not go with them, and the file itself."""
    table = study.table_of_spots()
    if table is None:
        return
    key, crossings = table[0], table[0] == "detectors.crossings"
    what = "crossings" if crossings else "spots"
    for other in ("days_used", "noise") if key == "calibration.spots" else ():
        if getattr(study.calibration, other) not in (None, 0.0):
            yield study.problem(f"calibration.{other}", "is for synthetic spots; remove it, or 'spots'")
    if study.mount_errors is not None and key != "measured":
        yield study.problem("mount_errors", f"is the truth of synthetic {what}; remove it, or '{key}'")
    one_place = study.sites is None and not any(each.startswith(("site.", "layout.")) for each in study.sweeps())
    if not one_place:
        yield study.problem(key, "belong to one site and one layout; leave out what sweeps them")
        return
    try:
        measured = study.measured_spots()
    except StudyError as error:
        yield from (replace(problem, key=problem.key or key) for problem in error.problems)
        return
    assert measured is not None
    if measured.unused:
        yield f"{measured.name}: columns that are not used: {few_of(measured.unused)}"
    layout = None if study.layout is None else Layouts(study)[()]
    aimed = set() if layout is None else set(layout.columns.get("target", measured.targets))
    if layout is not None and measured.targets and aimed != set(measured.targets):
        spots, field = ", ".join(measured.targets), ", ".join(map(str, aimed))
        message = f"are on the target {spots}, and {layout.name} counts from the target {field}"
        yield study.problem(key, f"{message}: convert both with the same --aim")
        return
    if key == "measured":
        return
    yield from _off_the_arrays(study, measured) if crossings else _far_spots(study, measured)
    counts = np.bincount(measured.heliostat, measured.weight > 0, study.heliostat_names()[0])
    if not counts.any():
        yield study.problem(key, f"no {what[:-1]} has a weight above 0: nothing can be estimated")
        return
    block = study.detectors if crossings else study.calibration
    assert block is not None
    needed = int(max(ends(block.parameters or 4)))
    equations = counts if crossings else 2 * counts
    few = np.flatnonzero((counts > 0) & (equations < needed))
    if few.size and few.size == np.count_nonzero(counts):
        least = needed if crossings else needed // 2
        message = f"{needed} errors need {least} {what} of a heliostat, and none has so many"
        yield study.problem(key.replace(what, "parameters"), message)
    elif few.size:
        yield f"heliostat {_listed(study, few)}: fewer {what} than {needed} errors need; nothing is estimated there"
    none = np.flatnonzero(counts == 0)
    if none.size:
        missing = f"no {what} in the file, or none with a weight above 0"
        yield f"heliostat {_listed(study, none)}: {missing}; nothing is estimated there"
    still = np.flatnonzero((equations >= needed) & (counts > 0) & ~measured.moved(len(counts)))
    if still.size and needed > 2:
        message = f"all {what} are of one sun; more than two errors cannot be told apart there"
        yield f"heliostat {_listed(study, still)}: {message}"
    yield from _names_as_numbers(study)


def _far_spots(study: MisalignmentStudy, measured: MeasuredSpots) -> list[Problem]:
    """Problems of spots that lie so far from the aim point that they must be in another unit."""
    if study.layout is None:
        x, y = np.array(study.heliostats.positions or (), float).reshape(-1, 3)[:, :2].T
    else:
        layout = Layouts(study)[()]
        x, y = layout.x, layout.y
    away = np.hypot(np.hypot(x, y), max(ends(study.receiver.height)))[measured.heliostat]
    off = np.hypot(*measured.position.T)
    # With commanded angles the mount need not have been sent to the aim point.
    far = np.flatnonzero((off > FARTHEST_SPOT * away) & np.isnan(measured.angles).any(axis=1))
    return _problems(
        measured,
        far,
        lambda row: (
            f"the spot lies {off[row]:.4g} m from the aim point, its heliostat {away[row]:.4g} m: is it in metres?"
        ),
    )


def _off_the_arrays(study: MisalignmentStudy, measured: MeasuredSpots) -> list[Problem]:
    """Problems of crossings that lie on no array of detectors."""
    from heliosweep.families.misalignment.segments import segments_of

    assert study.detectors is not None
    distance, _ = segments_of(study.detectors).nearest(measured.position)
    off = np.flatnonzero(distance > FARTHEST_CROSSING)
    return _problems(
        measured,
        off,
        lambda row: f"the crossing lies {distance[row]:.4g} m from the nearest array of detectors: are both in metres?",
    )


def _problems(measured: MeasuredSpots, rows: NDArray[np.int64], message: Callable[[np.int64], str]) -> list[Problem]:
    """Problems of some rows of a table, each at its line, as many as are listed."""
    found = (Problem(message(row), file=measured.name, line=int(measured.lines[row])) for row in rows)
    return list(listed(found, MAX_LISTED, rows.size))


def _listed(study: MisalignmentStudy, numbers: NDArray[np.int64]) -> str:
    """Names, or numbers from 0 without names, of some heliostats of a study, for a message."""
    names = study.heliostat_names()[1]
    return ", ".join(names[number] if names else str(number) for number in numbers[:6].tolist()) + (
        f" and {numbers.size - 6:,} others" if numbers.size > 6 else ""
    )


def _names_as_numbers(study: MisalignmentStudy) -> Iterator[str]:
    """A name counts before a row: names that are other rows' numbers are easily meant as rows."""
    _, names = study.heliostat_names()
    other = [row for row, name in enumerate(names) if WHOLE.fullmatch(name) and int(name) != row]
    if other:
        yield (
            f"{len(other):,} names of heliostats are whole numbers but not their rows, as {names[other[0]]!r} of row "
            f"{other[0]}: the file of the spots is read as if it gave names"
        )
