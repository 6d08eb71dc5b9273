"""What must hold between the blocks of a study, its layouts and the sun; NumPy only, for quick validation."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.blocks import NamedSite, Site
from heliosweep.config.sites import site_table
from heliosweep.config.sweep import Sweep
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
#: Latitudes times days that are looked at here.
MAX_DAYS = 10**7

#: Names that columns of a layout must leave to the result.
RESERVED = frozenset(
    [*ANNUAL, *FIELD, *SERIES, "heliostat", "time", "site", "tracking", "latitude", "longitude", "altitude"]
    + ["pivot_height", "receiver_height", "heliostat_width", "heliostat_height", "layout", "solar_hour", "day", "utc"]
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
    problems = list(_clock(study))
    notes: list[str] = []
    try:
        problems += _sun(study, notes)
        problems += _field(study, notes)
    except StudyError as error:
        problems += error.problems
    return problems, notes


def _clock(study: FieldEfficiencyStudy) -> Iterator[Problem]:
    """The civil clock needs a longitude and a time zone."""
    if isinstance(study.time, SolarTime):
        return
    places: Sequence[Site | NamedSite | None] = site_table(study) or [study.site]
    for index, place in enumerate(places):
        assert place is not None
        key = "site" if study.sites is None else f"sites[{index}]"
        if place.longitude is None:
            yield study.problem(f"{key}.longitude", "is missing: the civil clock needs the longitude, in deg east")
        if place.timezone is None and study.time.timezone is None:
            yield study.problem("time.timezone", "is missing: the civil clock needs a time zone, such as '+08:00'")
            return


def _sun(study: FieldEfficiencyStudy, notes: list[str]) -> Iterator[Problem]:
    """The sun must rise at some site; where it does not at another, the result is missing there.

    Only the solar clock is looked at; on the civil clock this shows when the sun is computed.
    """
    if not isinstance(study.time, SolarTime):
        return
    latitude = study.site.latitude if study.site is not None else [site.latitude for site in site_table(study)]
    latitudes = np.atleast_1d(np.asarray(latitude[:] if isinstance(latitude, Sweep) else latitude, dtype=float))
    declinations = study.time.declinations()
    days = sun.declination_cooper(study.time.day_numbers()) if declinations is None else np.radians(declinations)
    if latitudes.size * days.size > MAX_DAYS:
        return
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
    pivots, receivers = _values(study.heliostat.pivot_height), _values(study.receiver.height)
    lowest, highest = receivers.min(), pivots.max()
    seen: set[str] = set()
    for layout in itertools.islice(layouts, MAX_LAYOUTS):
        sizes = {}
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
                sizes[side] = _values(given) if column is None else column
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


def _collisions(study: FieldEfficiencyStudy, layout: Layout, sizes: dict[str, NDArray]) -> Iterator[tuple[Problem, bool]]:
    """Yield what `check_layout` finds for the largest mirrors of the sweep, and whether it is only a warning."""
    swept = [side for side in SIZE_COLUMNS if isinstance(getattr(study.heliostat, side), Sweep)]
    if len(swept) == 2 and len({*map(_dimension(study).get, swept)}) == 1:
        largest = np.minimum(*sizes.values()).argmax()  # tied sizes: the pair with the longest shorter side
        width, height = (sizes[side][largest] for side in SIZE_COLUMNS)
    else:
        width, height = (sizes[side].max() if side in swept else sizes[side] for side in SIZE_COLUMNS)
    problems, warnings = check_layout(layout, width, height)
    for found, warning in ((problems, False), (warnings, True)):
        for problem in found:
            yield problem if layout.lines is not None else study.problem("layout", problem.message), warning


def _dimension(study: FieldEfficiencyStudy) -> dict[str, str]:
    """Dimension of each swept key of the ``heliostat`` block."""
    return {key.rpartition(".")[2]: dim.name for dim in study.dimensions() for key in dim.sweeps if "heliostat." in key}


def _values(value: float | Sweep | None) -> NDArray[np.float64]:
    return np.atleast_1d(np.asarray(value[:] if isinstance(value, Sweep) else value, dtype=float))


def _listed(values: NDArray[np.float64], most: int = 6) -> str:
    text = ", ".join(f"{value:g}" for value in values[:most])
    return text if values.size <= most else f"{text} and {values.size - most} more"
