"""The study file of the family `misalignment`, and checks across its blocks, its layouts and the sun."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, model_validator

from heliosweep.config.faults import Fault, one_of
from heliosweep.config.layouts import Layout
from heliosweep.config.sites import Site, Sites, civil_clock_problems, site_notes
from heliosweep.config.study import Study
from heliosweep.config.sweep import Sweep, ends
from heliosweep.config.times import CivilTime, SolarTime, Time
from heliosweep.config.values import Choice, FileName
from heliosweep.errors import Problem, StudyError
from heliosweep.families.misalignment.blocks import (
    BLOCKS_OF_MODES,
    ERRORS,
    NOT_DRAWN,
    Beam,
    Calibration,
    Detectors,
    Error,
    Heliostats,
    Mount,
    MountErrors,
    Receiver,
    Statistics,
    Sun,
)
from heliosweep.families.misalignment.measured import examine_table
from heliosweep.families.misalignment.spots_file import MeasuredSpots, spots_under_suns
from heliosweep.grid.sun import dark_places
from heliosweep.layouts.layout import Layout as Places
from heliosweep.layouts.resolve import Layouts

#: Written out, as the modules of the variables load the kernels, which validation has no time for; a test compares.
_NAMES_OF_RESULTS = """
    heliostat layout clearance inner_radius rings heliostat_count pivot_height site latitude longitude altitude
    sun_azimuth sun_elevation time day declination date hour utc sample percentile tolerance_axis spot receiver_height
    receiver_azimuth receiver_tilt receiver_width receiver_height_extent mount_kind mirror_offset axis_offset
    pedestal_height axis_azimuth source axis error_size conic_coefficient detector error_scale parameter parameter_2
    parameters noise days_used loss loss_scale l0 l1 l2
    spot_y spot_z spot_status is_real inside hit_fraction tracking_tolerance conic eccentricity focus_y focus_z
    minimum_tolerance day_of_minimum_tolerance hour_of_minimum_tolerance declination_of_minimum_tolerance
    date_of_minimum_tolerance crossing_y crossing_z crossing_error
    spot_y_mean spot_z_mean spot_y_variance spot_z_variance spot_yz_covariance real_fraction remaining_tolerance
    day_hit_fraction field_hit_fraction
    beam_residual_rms uncalibrated_beam_residual_rms spot_deviation spot_time better_reading
    estimated_error true_error standard_error covariance condition_number residual_rms leave_one_out_rms spots_used
    instants_without_command calibration_status least_known_direction residual_y residual_z
    beam_divergence detector_pitch detector_noise correction trace crossing round outline edge
    outline_y outline_z edge_y edge_z measured_y measured_z
    crossing_place crossing_angle detector_status crossed_fraction misses_array instant_azimuth_error
    instant_elevation_error instant_azimuth_standard_error instant_elevation_standard_error crossings_used
    crossing_residual beam_error_rms spot_distance_rms round_hit_fraction
    spot_y_before spot_z_before spot_y_after spot_z_after nominal_azimuth nominal_elevation corrected_azimuth
    corrected_elevation
"""
#: Names that columns of a layout must leave to the result.
RESERVED = frozenset((*ERRORS, *_NAMES_OF_RESULTS.split()))

MODES = {
    "curves": "where single misalignments send the beam, and how much of one the aperture tolerates",
    "mount_errors": "where the six errors of a mount send the beam, fixed, swept or drawn",
    "calibration": "the errors of mounts from spots",
    "detectors": "where arrays of detectors see the traces of heliostats, and their misalignment from that",
}


class MisalignmentStudy(Study):
    """Beams of misaligned heliostats."""

    model_config = ConfigDict(
        json_schema_extra={
            "oneOf": [{"required": ["time"]}, {"required": ["sun"]}],
            "anyOf": [{"required": ["heliostats"]}, {"required": ["layout"]}],
        }
    )

    family: Literal["misalignment"]
    mode: Annotated[str, Choice("What is asked", MODES, sweep=False)] = "curves"
    site: Annotated[Site | None, Field(description="Site of the plant; or several 'sites'")] = None
    sites: Annotated[Sites | None, Field(description="Several named sites: a list, or a CSV table")] = None
    time: Annotated[Time | None, Field(description="Days and hours that are looked at; or a 'sun'")] = None
    sun: Annotated[Sun | None, Field(description="Fixed sun, instead of 'time'")] = None
    receiver: Annotated[Receiver, Field(description="The aim of all heliostats, and the aperture about it")]
    heliostats: Annotated[Heliostats, Field(description="The pivots of the heliostats")] = Heliostats()
    layout: Annotated[Layout | None, Field(description="Layout of the field, instead of positions")] = None
    mount: Annotated[Mount, Field(description="The mount of every heliostat")] = Mount()
    error: Annotated[Error | None, Field(description="The misalignment; mode: curves only")] = None
    beam: Annotated[Beam | None, Field(description="Beam whose outlines are traced; mode: curves only")] = None
    measured: Annotated[
        str | None,
        FileName("CSV table of measured spots, drawn over the curves; columns as of calibration.spots", sweep=False),
    ] = None
    detectors: Annotated[Detectors | None, Field(description="Detectors; modes curves and detectors only")] = None
    mount_errors: Annotated[MountErrors | None, Field(description="Errors that the mounts have")] = None
    statistics: Annotated[
        Statistics | None, Field(description="Statistics over the draws; mode: mount_errors only")
    ] = None
    calibration: Annotated[
        Calibration | None, Field(description="Estimated errors and their spots; mode: calibration only")
    ] = None

    @model_validator(mode="before")
    @classmethod
    def _with_calibration(cls, given: Any) -> Any:
        """Use the default calibration if the study does not describe one."""
        if isinstance(given, Mapping) and given.get("mode") == "calibration" and given.get("calibration") is None:
            return {**given, "calibration": {}}
        return given

    def reserved_names(self) -> frozenset[str]:
        """Return the names of the result that columns of a layout do not take."""
        return RESERVED

    def rules(self) -> Iterator[Fault]:
        """Check that there are heliostats, a sun and the blocks of the mode, and no others."""
        yield from self.output.without_series()
        if self.layout is None and self.heliostats.positions is None:
            yield Fault("give 'heliostats: {positions: [[x, y, z], ...]}' or a 'layout'", show_value=False)
        elif self.layout is not None and self.heliostats.positions is not None:
            yield Fault("give 'positions' or a 'layout', not both", ("heliostats", "positions"), show_value=False)
        yield from self._sun_faults()
        yield from self._mode_faults()
        yield from self._idle_faults()

    def examinations(self) -> Iterable[Callable[[MisalignmentStudy], Iterable[Problem | str]]]:
        """Return what looks for problems between blocks, with the layout or with the sun."""
        return _sun, site_notes, _days_used, _distances, examine_table

    def heliostat_names(self) -> tuple[int, tuple[str, ...]]:
        """Return the number of heliostats of the first layout, and their names, if any."""
        if self.layout is None:
            return len(self.heliostats.positions or ()), ()
        layout = Layouts(self)[()]
        column = layout.columns.get("name")
        if column is None and (given := layout.columns.get("id")) is not None and given.dtype.kind in "OU":
            column = given  # numbers in it would be taken for rows
        return len(layout), tuple(map(str, column)) if column is not None else ()

    def table_of_spots(self) -> tuple[str, str] | None:
        """Key and file of a table of measured spots or crossings."""
        given = {
            "calibration.spots": self.calibration and self.calibration.spots,
            "detectors.crossings": self.detectors and self.detectors.crossings,
            "measured": self.measured,
        }
        return next(((key, name) for key, name in given.items() if name), None)

    def measured_spots(self) -> MeasuredSpots | None:
        """Return measured spots or crossings with their suns, or None. Raises StudyError."""
        if (table := self.table_of_spots()) is None:
            return None
        place: tuple[float, float | None, float] = 0.0, None, 0.0
        if self.site is not None:
            latitude, longitude, altitude = self.site.latitude, self.site.longitude, self.site.altitude
            assert not isinstance(latitude, Sweep)
            assert not isinstance(longitude, Sweep)
            assert not isinstance(altitude, Sweep)
            place = latitude, longitude, altitude
        key, name = table
        zone = (self.calibration.timezone if key == "calibration.spots" and self.calibration else None) or ""
        crossings = key == "detectors.crossings"
        measured = spots_under_suns(self.resolve(name), *self.heliostat_names(), place, crossings, zone)
        if measured.timed:
            message = "is missing: the sun at the times of the spots depends on it; or give their sun vectors"
            raise StudyError(self.problem("site.longitude", message))
        return measured

    def _sun_faults(self) -> Iterator[Fault]:
        if self.site is not None and self.sites is not None:
            yield Fault("give 'site' or 'sites', not both", ("sites",), show_value=False)
        if self.time is not None and self.sun is not None:
            yield Fault("give 'time' or 'sun', not both", ("sun",), show_value=False)
        elif self.time is None and self.sun is None:
            yield Fault("give 'time', with days and hours, or 'sun', with azimuth and elevation", show_value=False)
        elif self.site is None and self.sites is None:
            if self.time is not None:
                yield Fault("give 'site' or 'sites': the sun depends on the latitude", show_value=False)
            elif "polar" in ends(self.mount.kind):
                yield Fault("give 'site' or 'sites': a polar mount depends on the latitude", show_value=False)
        if self.time is not None:
            yield from _unsorted(self.time)
        if self.mode == "calibration" and self.sun is not None:
            yield Fault("is for other modes: one sun cannot separate errors; give 'time'", ("sun",), show_value=False)

    def _idle_faults(self) -> Iterator[Fault]:
        """Yield keys without an effect: keys of draws without drawn errors, and of an axis that no mount has."""
        if isinstance(self.mount.axis_azimuth, Sweep) and "tilt_roll" not in ends(self.mount.kind):
            yield Fault("is only for 'kind: tilt_roll', which is not among the mounts", ("mount", "axis_azimuth"))
        errors = self.mount_errors
        if self.mode not in ("curves", "mount_errors") or errors is None:
            return
        if not errors.model_fields_set & set(ERRORS):
            yield Fault(f"names no error: give {one_of(ERRORS)}, in mrad", ("mount_errors",), show_value=False)
        elif not errors.drawn():
            if errors.seed is not None:
                yield Fault(NOT_DRAWN, ("mount_errors", "seed"), show_value=False)
            if self.statistics is not None:
                yield Fault(NOT_DRAWN, ("statistics",), show_value=False)

    def _mode_faults(self) -> Iterator[Fault]:
        for block, modes in BLOCKS_OF_MODES.items():
            if getattr(self, block) is not None and self.mode not in modes:
                meant = " or ".join(modes)
                yield Fault(f"is only for mode: {meant}; remove it or change 'mode'", (block,), show_value=False)
        if self.mode == "curves":
            if self.error is None:
                message = "'error' is missing: {source, axis, size}, the misalignment whose curves are traced"
                yield Fault(message, show_value=False)
            if any(offset != 0 for offset in ends(self.mount.axis_offset)):
                message = "must be 0 in mode: curves, whose mounts have both axes through the pivot"
                yield Fault(message, ("mount", "axis_offset"))
            if self.mount_errors is not None and self.mount_errors.drawn():
                message = "draws are for other modes: in mode: curves give numbers or sweeps"
                yield Fault(message, ("mount_errors",), show_value=False)
            for key in () if self.detectors is None else sorted(set(Detectors.model_fields) - {"lines"}):
                if getattr(self.detectors, key) is not None:
                    message = "is only for mode: detectors; in mode: curves give 'lines'"
                    yield Fault(message, ("detectors", key), show_value=False)
        elif self.mode == "detectors" and self.detectors is None:
            yield Fault("'detectors' is missing: {arrays, ...}, where the detectors are", show_value=False)
        elif self.mount_errors is None and self.table_of_spots() is None:
            known = {"mount_errors": "which errors the mounts have", "detectors": "the truth of synthetic crossings"}
            what = known.get(self.mode, "the truth of synthetic spots")
            names = one_of(key for key in MountErrors.model_fields if key not in ("scale", "samples", "seed"))
            yield Fault(f"'mount_errors' is missing: {what}, such as {names}, in mrad", show_value=False)


def _unsorted(time: SolarTime | CivilTime) -> Iterator[Fault]:
    """Days and hours are axes of the result, which must rise."""
    axes: dict[str, Sequence[Any]]
    if isinstance(time, CivilTime):
        axes = {"dates": time.date_list()}
    else:
        sweeps = {"days": time.days, "hours": time.hours, "declination": time.declination}
        axes = {key: sweep.items() for key, sweep in sweeps.items() if sweep is not None}
    for key, values in axes.items():
        if any(later <= earlier for earlier, later in itertools.pairwise(values)):
            yield Fault("must rise", ("time", key), show_value=False)


def _sun(study: MisalignmentStudy) -> Iterator[Problem | str]:
    """Check that the sun rises at a site; sites without a sunrise have no spots."""
    if study.time is None:
        return
    if isinstance(study.time, CivilTime) and (missing := list(civil_clock_problems(study))):
        yield from missing
    else:
        yield from dark_places(study, "there are no spots (NaN) there")


def _days_used(study: MisalignmentStudy) -> Iterator[Problem]:
    """Spots can be taken only on days that there are."""
    used = None if study.calibration is None else study.calibration.days_used
    if used is None or study.time is None:
        return
    time = study.time
    days: Any = time.declination or time.days if isinstance(time, SolarTime) else time.date_list()
    most = max(ends(used))
    if most > len(days):
        message = f"must be at most {len(days)}, the number of days of 'time' (got {most:g})"
        yield study.problem("calibration.days_used", message)


def _distances(study: MisalignmentStudy) -> Iterator[Problem | str]:
    """The mirror must turn about a pivot that is farther from the aim point than the mirror from the pivot."""
    offsets = [_sizes(value) for value in (study.mount.mirror_offset, study.mount.axis_offset)]
    least, most = (sum(ends) for ends in zip(*offsets, strict=True))
    heights = ends(study.receiver.height)
    above = ends(study.heliostats.pivot_height or 0.0)
    behind = near = count = 0
    if study.layout is not None:
        yield from Layouts(study).remarks()
    pivots = Places(*np.array(study.heliostats.positions or np.empty((0, 3))).T)
    for layout in [pivots] if study.layout is None else (each for each, _ in Layouts(study).some()):
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
        yield (
            f"{near:,} of {count:,} heliostats are not farther from the aim point than the largest offsets of the "
            f"mirror, {most:g} m: there they have no spots"
        )
    if behind:
        yield (f"{behind:,} of {count:,} heliostats are on the plane of the receiver or behind it: they have no spots")


def _always_behind(study: MisalignmentStudy, layout: Places, heights: list[NDArray[np.float64]]) -> NDArray[np.bool_]:
    """Return heliostats on or behind the plane at each swept height; none if the receiver rotates."""
    azimuth, tilt = study.receiver.azimuth, study.receiver.tilt
    if isinstance(azimuth, Sweep) or isinstance(tilt, Sweep):
        return np.zeros(len(layout), bool)
    around, up = np.radians(azimuth), np.radians(tilt)
    out = np.cos(up) * (np.sin(around) * layout.x + np.cos(around) * layout.y)
    before: NDArray[np.bool_] = np.max([out + np.sin(up) * z for z in heights], axis=0) <= 0
    return before


def _sizes(value: float | Sweep) -> tuple[float, float]:
    """Least and largest magnitude of a value or of a sweep."""
    both = ends(value)
    passes_zero = isinstance(value, Sweep) and value.form is not None and min(both) < 0 < max(both)
    return 0.0 if passes_zero else min(map(abs, both)), max(map(abs, both))


STUDY = MisalignmentStudy
