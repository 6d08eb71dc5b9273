"""What must hold between the blocks of a study, its layouts and the sun; NumPy only, for quick validation."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.sites import civil_clock_problems, site_table
from heliosweep.config.sweep import Listed, Sweep
from heliosweep.config.times import SolarTime
from heliosweep.errors import Problem, StudyError
from heliosweep.families.field_efficiency.variables import ANNUAL, FIELD, SERIES
from heliosweep.kernels import sun
from heliosweep.layouts.checks import check_layout
from heliosweep.layouts.layout import Layout
from heliosweep.layouts.resolve import SIZE_COLUMNS, Layouts

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.config import FieldEfficiencyStudy

#: Layouts of a sweep that are looked at here; the kernels would be exact for any.
MAX_LAYOUTS = 2000
#: Latitudes times instants that are looked at here; of larger studies the plan says what it thinks.
MAX_INSTANTS = 10**8

#: One side of all mirrors, or of each. [m]
Size: TypeAlias = float | NDArray[np.float64]

#: Names that columns of a layout must leave to the result.
RESERVED = frozenset(
    (
        *ANNUAL,
        *FIELD,
        *SERIES,
        *("heliostat", "time", "utc", "day", "declination", "solar_hour"),
        *("site", "latitude", "longitude", "altitude", "tracking", "layout", "clearance", "inner_radius", "rings"),
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
    try:
        if not isinstance(study.time, SolarTime):
            problems += civil_clock_problems(study)
        problems += _sun(study, notes)
        problems += _field(study, notes)
    except StudyError as error:
        problems += error.problems
    return problems, notes


def _sun(study: FieldEfficiencyStudy, notes: list[str]) -> Iterator[Problem]:
    """The sun must rise at some site; where it does not at another, the result is missing there.

    Only the solar clock is looked at; on the civil clock this shows when the sun is computed.
    """
    if not isinstance(study.time, SolarTime):
        return
    latitude = study.site.latitude if study.site is not None else [site.latitude for site in site_table(study)]
    if study.time.count() * len(latitude if isinstance(latitude, Sweep) else np.atleast_1d(latitude)) > MAX_INSTANTS:
        return
    latitudes = _values(latitude)
    declinations = study.time.declinations()
    days = sun.declination_cooper(study.time.day_numbers()) if declinations is None else np.radians(declinations)
    # Of all hours the sun is highest at the one nearest to noon.
    hours = study.time.solar_hours()
    noon = hours[np.abs(hours - 12).argmin()]
    highest = sun.solar_clock(np.radians(latitudes)[:, np.newaxis], days, noon)[..., 2].max(axis=1)
    dark = latitudes[highest <= 0]
    if dark.size == latitudes.size:
        yield study.problem("time.hours", "the sun never rises at these latitudes, days and hours")
    elif dark.size:
        notes.append(f"the sun never rises at latitude {_listed(dark)} deg: the result is missing (NaN) there")


def _field(study: FieldEfficiencyStudy, notes: list[str]) -> Iterator[Problem]:
    """Layouts can stand, mirrors can turn and look up to the receiver."""
    layouts = Layouts(study, RESERVED)
    lowest, highest = _extremes(study.receiver.height)[0], _extremes(study.heliostat.pivot_height)[1]
    seen: set[str] = set()
    for layout in itertools.islice(layouts, MAX_LAYOUTS):
        sizes: dict[str, Size] = {}
        for side in SIZE_COLUMNS:
            given, column = getattr(study.heliostat, side), layout.columns.get(side)
            if given is None and column is None:
                missing = f"is missing: give it here in m, or as a column {side!r} of the layout"
                yield study.problem(f"heliostat.{side}", missing)
            elif given is not None and column is not None:
                yield study.problem(f"heliostat.{side}", f"is also a column of the layout {layout.name}; leave one out")
            elif column is not None and not (column.dtype.kind in "if" and np.all(column > 0)):
                yield Problem(f"column {side!r} must hold positive numbers, in m", file=layout.name)
            else:
                sizes[side] = _extremes(given)[1] if column is None else column
        if len(sizes) < len(SIZE_COLUMNS):
            return
        top = layout.z.max(initial=-np.inf) + highest
        if lowest <= top:
            yield study.problem(
                "receiver.height",
                f"must be above the mirrors, whose highest centre is at {top:g} m (got {lowest:g})",
            )
        for problem, warning in _collisions(study, layout, sizes):
            text = str(problem)
            if text not in seen:
                seen.add(text)
                if warning:
                    notes.append(text)
                else:
                    yield problem


def _collisions(study: FieldEfficiencyStudy, layout: Layout, sizes: dict[str, Size]) -> Iterator[tuple[Problem, bool]]:
    """Yield what `check_layout` finds for the largest mirrors of the sweep, and whether it is only a warning."""
    width, height = _tied_sizes(study) or (sizes[side] for side in SIZE_COLUMNS)
    for found, warning in zip(check_layout(layout, width, height), (False, True), strict=True):
        if layout.lines is None and found:  # of a generated layout the user cannot mend single rows
            more = f" (and {len(found) - 1:,} more)" if len(found) > 1 else ""
            yield study.problem("layout", found[0].message + more), warning
        else:
            yield from ((problem, warning) for problem in found)


def _tied_sizes(study: FieldEfficiencyStudy) -> tuple[float, float] | None:
    """Of widths and heights that `zip` ties together, the pair with the longest shorter side."""
    width, height = study.heliostat.width, study.heliostat.height
    keys = {f"heliostat.{side}" for side in SIZE_COLUMNS}
    if not (isinstance(width, Sweep) and isinstance(height, Sweep)) or len(width) > MAX_INSTANTS:
        return None
    if not any(keys <= set(dim.sweeps) for dim in study.dimensions()):
        return None
    widths, heights = width.values(), height.values()
    largest = int(np.minimum(widths, heights).argmax())
    return float(widths[largest]), float(heights[largest])


def _extremes(value: float | Sweep) -> tuple[float, float]:
    """Least and largest value; of a range without expanding it."""
    if not isinstance(value, Sweep):
        return value, value
    ends = value.values() if isinstance(value, Listed) else (value.first, value.last)
    return float(min(ends)), float(max(ends))


def _values(value: float | Sequence[float] | Sweep) -> NDArray[np.float64]:
    return np.atleast_1d(np.asarray(value[:] if isinstance(value, Sweep) else value, dtype=float))


def _listed(values: NDArray[np.float64], most: int = 6) -> str:
    text = ", ".join(f"{value:g}" for value in values[:most])
    return text if values.size <= most else f"{text} and {values.size - most} more"
