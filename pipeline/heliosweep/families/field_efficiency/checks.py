"""What must hold between the blocks of a study, its layouts and the sun; NumPy only, for quick validation."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.sites import civil_clock_problems
from heliosweep.config.study import Dimension, parameters
from heliosweep.config.sweep import Listed, Sweep
from heliosweep.config.times import SolarTime, SunDirections
from heliosweep.errors import Problem, StudyError
from heliosweep.families.daylight import dark_latitudes
from heliosweep.families.field_efficiency.variables import ANNUAL, FIELD, SERIES
from heliosweep.layouts.checks import check_layout
from heliosweep.layouts.layout import Layout
from heliosweep.layouts.resolve import SIZE_COLUMNS, Layouts, values_at

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.config import FieldEfficiencyStudy

#: Points of a sweep, and heliostats in all of them, that are looked at here; the kernels would be exact for any.
MAX_POINTS, MAX_HELIOSTATS = 200, 300_000

#: Picks the worst of several positions along a sweep: `min` or `max`.
Worst: TypeAlias = Callable[..., int]

#: Names that columns of a layout must leave to the result.
RESERVED = frozenset(
    (
        *ANNUAL,
        *FIELD,
        *SERIES,
        *("heliostat", "time", "utc", "day", "declination", "solar_hour"),
        *("site", "latitude", "longitude", "altitude", "tracking", "layout", "clearance", "inner_radius", "rings"),
        *("sun_azimuth", "sun_elevation"),
        *("pivot_height", "receiver_height", "heliostat_width", "heliostat_height", "heliostat_count"),
    )
)


def check(study: FieldEfficiencyStudy) -> tuple[list[Problem], list[str]]:
    """Check a study whose blocks are right by themselves.

    Parameters
    ----------
    study : FieldEfficiencyStudy
        The study.

    Returns
    -------
    problems : list of Problem
        What makes the study useless, located in the study or layout file.
    notes : list of str
        What the user should know, but may want.
    """
    problems: list[Problem] = []
    notes: list[str] = []
    for find in (_sun, _mirrors, _tower):
        try:
            problems += find(study, notes)
        except StudyError as error:
            problems += (problem for problem in error.problems if problem not in problems)
    return problems, notes


def _sun(study: FieldEfficiencyStudy, notes: list[str]) -> Iterator[Problem]:
    """The sun must rise at some site; where it does not at another, the result is missing there."""
    if isinstance(study.time, SunDirections):
        yield from _directions(study, study.time, notes)
        return
    solar = isinstance(study.time, SolarTime)
    if not solar and (missing := list(civil_clock_problems(study))):
        yield from missing
        return
    dark, everywhere = dark_latitudes(study)
    if everywhere and solar:
        yield study.problem("time.hours", "the sun never rises at these latitudes, days and hours")
    elif everywhere:
        yield study.problem("time.window", "the sun never rises at these sites on these dates in this window")
    elif dark.size:
        notes.append(f"the sun never rises at latitude {_listed(dark)} deg: the result is missing (NaN) there")


def _directions(study: FieldEfficiencyStudy, time: SunDirections, notes: list[str]) -> Iterator[Problem]:
    """The sun must be up in some direction."""
    given = time.elevation
    if isinstance(given, Sweep):  # lists are looked at whole, ranges are monotonic
        low, high = (min(given.values()), max(given.values())) if isinstance(given, Listed) else (given[0], given[-1])
        low, high = min(low, high), max(low, high)
    else:
        low = high = given
    if high <= 0:
        yield study.problem("time.elevation", "the sun is never above the horizon")
    elif low <= 0:
        notes.append("the result is missing (NaN) where the sun is not above the horizon")


def _mirrors(study: FieldEfficiencyStudy, notes: list[str]) -> Iterator[Problem]:
    """Mirrors must have a size, and room to turn."""
    seen: set[str] = set()
    for layout, values in _points(study, {f"heliostat.{side}": max for side in SIZE_COLUMNS}):
        problems = list(_sizes_missing(study, layout))
        if problems:
            yield from problems
            return
        width, height = (
            layout.columns[side] if side in layout.columns else values[f"heliostat.{side}"] for side in SIZE_COLUMNS
        )
        for found, warning in zip(check_layout(layout, width, height), (False, True), strict=True):
            for problem in _in_study(study, layout, found):
                if str(problem) in seen:
                    continue
                seen.add(str(problem))
                if warning:
                    notes.append(str(problem))
                else:
                    yield problem


def _tower(study: FieldEfficiencyStudy, notes: list[str]) -> Iterator[Problem]:
    """The receiver must be above the mirrors; it is the aim of all."""
    aimed: set[str] = set()
    for layout, values in _points(study, {"heliostat.pivot_height": max, "receiver.height": min}):
        if "aim_x" in layout.columns and layout.name not in aimed:
            aimed.add(layout.name)
            notes.append(f"the aim points of the layout {layout.name} are not used: all heliostats aim at the receiver")
        top = layout.z.max(initial=-np.inf) + values["heliostat.pivot_height"]
        receiver = values["receiver.height"]
        if receiver <= top:
            message = f"must be above the mirrors, whose highest centre is at {top:g} m (got {receiver:g})"
            yield study.problem("receiver.height", message)
            return


def _sizes_missing(study: FieldEfficiencyStudy, layout: Layout) -> Iterator[Problem]:
    """Each side of the mirrors must be given once, in the study or as a column of the layout."""
    for side in SIZE_COLUMNS:
        given, column = getattr(study.heliostat, side), layout.columns.get(side)
        if given is None and column is None:
            missing = f"is missing: give it here in m, or as a column {side!r} of the layout"
            yield study.problem(f"heliostat.{side}", missing)
        elif given is not None and column is not None:
            yield study.problem(f"heliostat.{side}", f"is also a column of the layout {layout.name}; leave one out")
        elif column is not None and not (column.dtype.kind in "if" and np.all(column > 0)):
            yield Problem(f"column {side!r} must hold positive numbers, in m", file=layout.name)


def _in_study(study: FieldEfficiencyStudy, layout: Layout, found: list[Problem]) -> list[Problem]:
    """Return one problem for all of a generated layout, of which the user cannot mend single rows."""
    if layout.lines is not None or not found:
        return found
    more = f" (and {len(found) - 1:,} more)" if len(found) > 1 else ""
    return [study.problem("layout", found[0].message + more)]


def _points(study: FieldEfficiencyStudy, worst: Mapping[str, Worst]) -> Iterator[tuple[Layout, dict[str, Any]]]:
    """Yield the layouts, each with the values of all keys that come together with it and matter.

    Parameters
    ----------
    study : FieldEfficiencyStudy
        The study.
    worst : mapping of str to callable
        The keys that matter beside those of the layout, and which of their values is the worst, `min` or `max`: the
        only one to look at where nothing that matters is tied to the key.
    """
    layouts = Layouts(study, RESERVED)
    given = {key: value for key, _, value in parameters(study)}
    dims = [dim for dim in study.dimensions() if any(_of_layout(key) or key in worst for key in dim.sweeps)]
    positions = (_positions(dim, worst) for dim in dims)
    looked_at = 0
    for index in itertools.islice(itertools.product(*positions), MAX_POINTS):
        values = given | values_at(dims, index)
        layout = layouts.at(values)
        yield layout, values
        looked_at += len(layout)
        if looked_at > MAX_HELIOSTATS:
            return


def _positions(dim: Dimension, worst: Mapping[str, Worst]) -> Sequence[int]:
    """Positions along a dimension to look at: the worst of a key that stands alone, many of those of tied keys."""
    keys = [key for key in dim.sweeps if _of_layout(key) or key in worst]
    if len(keys) > 1 or _of_layout(keys[0]):
        return np.linspace(0, len(dim) - 1, min(len(dim), MAX_POINTS)).round().astype(int).tolist()
    sweep = dim.sweeps[keys[0]]
    candidates = range(len(sweep)) if isinstance(sweep, Listed) else (0, len(sweep) - 1)  # ranges are monotonic
    return (worst[keys[0]](candidates, key=sweep.__getitem__),)


def _of_layout(key: str) -> bool:
    return key.startswith("layout.")


def _listed(values: NDArray[np.float64], most: int = 6) -> str:
    text = ", ".join(f"{value:g}" for value in values[:most])
    return text if values.size <= most else f"{text} and {values.size - most} more"
