"""Checks across the blocks of a study, its layouts and the sun; NumPy only, for quick validation."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.sites import civil_clock_problems
from heliosweep.config.sweep import Listed, Sweep
from heliosweep.config.times import SolarTime
from heliosweep.errors import Problem, StudyError
from heliosweep.families.misalignment.blocks import ERRORS
from heliosweep.families.misalignment.measured import spot_problems
from heliosweep.grid.daylight import dark_latitudes
from heliosweep.layouts.layout import Layout
from heliosweep.layouts.resolve import Layouts

if TYPE_CHECKING:
    from heliosweep.families.misalignment.study import MisalignmentStudy

#: Layouts of a sweep, and heliostats in all of them, that are looked at here; the kernels flag what is wrong in any.
MAX_LAYOUTS, MAX_HELIOSTATS = 50, 300_000

#: Written out, as the modules of the variables load the kernels, which validation has no time for; a test compares.
_NAMES_OF_RESULTS = """
    heliostat layout clearance inner_radius rings heliostat_count pivot_height site latitude longitude altitude
    sun_azimuth sun_elevation time day declination date hour utc sample percentile tolerance_axis spot receiver_height
    receiver_azimuth receiver_tilt receiver_width receiver_height_extent mount_kind mirror_offset axis_offset
    pedestal_height axis_azimuth source axis error_size conic_coefficient detector error_scale parameter parameter_2
    parameters noise days_used loss loss_scale l0 l1 l2
    spot_y spot_z spot_status is_real inside hit_fraction tracking_tolerance conic eccentricity focus_y focus_z
    least_tolerance day_of_least_tolerance hour_of_least_tolerance declination_of_least_tolerance
    date_of_least_tolerance crossing_y crossing_z crossing_error
    spot_y_mean spot_z_mean spot_y_variance spot_z_variance spot_yz_covariance real_fraction remaining_tolerance
    day_hit_fraction field_hit_fraction
    estimated_error true_error standard_error covariance condition_number residual_rms leave_one_out_rms spots_used
    instants_without_command calibration_status least_known_direction residual_y residual_z
    spot_y_before spot_z_before spot_y_after spot_z_after nominal_azimuth nominal_elevation corrected_azimuth
    corrected_elevation
"""
#: Names that columns of a layout must leave to the result.
RESERVED = frozenset((*ERRORS, *_NAMES_OF_RESULTS.split()))


def check(study: MisalignmentStudy) -> tuple[list[Problem], list[str]]:
    """Check a study whose blocks are right by themselves.

    Parameters
    ----------
    study : MisalignmentStudy
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
    for find in (_sun, _days_used, _distances, spot_problems):
        try:
            problems += find(study, notes)
        except StudyError as error:
            problems += (problem for problem in error.problems if problem not in problems)
    return problems, notes


def _sun(study: MisalignmentStudy, notes: list[str]) -> Iterator[Problem]:
    """The sun must rise at some site; where it does not at another, there are no spots there."""
    if study.time is None:
        return
    solar = isinstance(study.time, SolarTime)
    if not solar and (missing := list(civil_clock_problems(study))):
        yield from missing
        return
    dark, everywhere = dark_latitudes(study)
    if everywhere:
        key, what = ("time.hours", "latitudes, days and hours") if solar else ("time.window", "sites, dates and hours")
        yield study.problem(key, f"the sun never rises at these {what}")
    elif dark.size:
        listed = ", ".join(f"{value:g}" for value in dark[:6]) + (" and others" if dark.size > 6 else "")
        notes.append(f"the sun never rises at latitude {listed} deg: there are no spots (NaN) there")


def _days_used(study: MisalignmentStudy, _: list[str]) -> Iterator[Problem]:
    """Spots can be taken only on days that there are."""
    used = None if study.calibration is None else study.calibration.days_used
    if used is None or study.time is None:
        return
    time = study.time
    days: Any = time.declination or time.days if isinstance(time, SolarTime) else time.date_list()
    most = max(_ends(used))
    if most > len(days):
        message = f"must be at most {len(days)}, the number of days of 'time' (got {most:g})"
        yield study.problem("calibration.days_used", message)


def _distances(study: MisalignmentStudy, notes: list[str]) -> Iterator[Problem]:
    """The mirror must turn about a pivot that is farther from the aim point than the mirror from the pivot."""
    offsets = [_sizes(value) for value in (study.mount.mirror_offset, study.mount.axis_offset)]
    least, most = (sum(ends) for ends in zip(*offsets, strict=True))
    heights = _ends(study.receiver.height)
    above = _ends(study.heliostats.pivot_height or 0.0)
    behind = near = count = 0
    for layout in _layouts(study):
        z = [layout.z + pivot - aim for pivot in above for aim in heights]
        farthest = np.sqrt(layout.x**2 + layout.y**2 + np.max(np.square(z), axis=0))
        nearest = np.sqrt(layout.x**2 + layout.y**2 + np.min(np.square(z), axis=0))
        never = np.flatnonzero(least >= farthest) if least > 0 else np.empty(0, int)
        if never.size:
            row = int(never[np.argmin(farthest[never])])
            where = layout.where(row) + (f" of {layout.name}" if layout.name else "")
            key, other = ("mirror_offset", "") if offsets[0][0] >= farthest[row] else ("axis_offset", "mirror_offset")
            together = f" together with {other}" if other and offsets[0][0] > 0 else ""
            message = (
                f"must{together} be smaller than the distance from {where} to the aim point, {farthest[row]:.6g} m"
            )
            yield study.problem(f"mount.{key}", f"{message} (got {offsets[0 if not other else 1][0]:g})")
            return
        count += len(layout)
        near += int(np.count_nonzero(most >= nearest)) if most > 0 else 0
        behind += int(np.count_nonzero(_always_behind(study, layout, z)))
    if near:
        notes.append(
            f"{near:,} of {count:,} heliostats are not farther from the aim point than the largest offsets of the "
            f"mirror, {most:g} m: there they have no spots"
        )
    if behind:
        notes.append(
            f"{behind:,} of {count:,} heliostats stand on the plane of the receiver or behind it: they have no spots"
        )


def _always_behind(study: MisalignmentStudy, layout: Layout, heights: list[NDArray[np.float64]]) -> NDArray[np.bool_]:
    """Heliostats on or behind the plane whatever the swept height; none told where the receiver turns."""
    azimuth, tilt = study.receiver.azimuth, study.receiver.tilt
    if isinstance(azimuth, Sweep) or isinstance(tilt, Sweep):
        return np.zeros(len(layout), bool)
    around, up = np.radians(azimuth), np.radians(tilt)
    out = np.cos(up) * (np.sin(around) * layout.x + np.cos(around) * layout.y)
    before: NDArray[np.bool_] = np.max([out + np.sin(up) * z for z in heights], axis=0) <= 0
    return before


def _layouts(study: MisalignmentStudy) -> Iterator[Layout]:
    """Yield the layouts to look at; the positions of the study as one."""
    if study.layout is None:
        positions = np.array(study.heliostats.positions)
        yield Layout(*positions.T)
        return
    layouts = Layouts(study, RESERVED)
    dims = layouts.dimensions
    evenly = (np.linspace(0, len(dim) - 1, min(len(dim), MAX_LAYOUTS)).round().astype(int).tolist() for dim in dims)
    looked_at = 0
    for index in itertools.islice(itertools.product(*evenly), MAX_LAYOUTS):
        layout = layouts[index]
        yield layout
        looked_at += len(layout)
        if looked_at > MAX_HELIOSTATS:
            return


def _ends(value: float | Sweep) -> tuple[float, ...]:
    """A value, all of a list, or both ends of a range, which is monotonic."""
    if not isinstance(value, Sweep):
        return (value,)
    return tuple(value[:]) if isinstance(value, Listed) else (value.first, value.last)


def _sizes(value: float | Sweep) -> tuple[float, float]:
    """Least and largest magnitude of a value or of a sweep."""
    ends = _ends(value)
    passes_zero = not isinstance(value, Listed) and min(ends) < 0 < max(ends)
    return 0.0 if passes_zero else min(map(abs, ends)), max(map(abs, ends))
