"""The study file of the family `misalignment`."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator

from heliosweep.config.blocks import Layout, Site, Sites
from heliosweep.config.faults import Fault, one_of
from heliosweep.config.study import Study
from heliosweep.config.sweep import Listed, Sweep
from heliosweep.config.times import CivilTime, SolarTime, Time
from heliosweep.config.values import Choice
from heliosweep.errors import Problem
from heliosweep.families.misalignment import checks
from heliosweep.families.misalignment.blocks import (
    BLOCKS_OF_MODES,
    ERRORS,
    NOT_DRAWN,
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

MODES = {
    "curves": "where single misalignments send the beam, and how much of one the aperture tolerates",
    "mount_errors": "where the six errors of a mount send the beam, fixed, swept or drawn",
    "calibration": "the errors of mounts from spots",
}


class MisalignmentStudy(Study):
    """Where misaligned heliostats send their beams."""

    model_config = ConfigDict(
        json_schema_extra={
            "oneOf": [{"required": ["time"]}, {"required": ["sun"]}],
            "anyOf": [{"required": ["heliostats"]}, {"required": ["layout"]}],
        }
    )

    family: Literal["misalignment"]
    mode: Annotated[str, Choice("What is asked", MODES, sweep=False)] = "curves"
    site: Annotated[Site | None, Field(description="Where the plant stands; or several 'sites'")] = None
    sites: Annotated[Sites | None, Field(description="Several named sites: a list, or a CSV table")] = None
    time: Annotated[Time | None, Field(description="Days and hours that are looked at; or a 'sun'")] = None
    sun: Annotated[Sun | None, Field(description="A sun that stands still, instead of 'time'")] = None
    receiver: Annotated[Receiver, Field(description="The aim of all heliostats, and the aperture about it")]
    heliostats: Annotated[Heliostats, Field(description="The pivots of the heliostats")] = Heliostats()
    layout: Annotated[Layout | None, Field(description="Where the heliostats stand, instead of positions")] = None
    mount: Annotated[Mount, Field(description="The mount of every heliostat")] = Mount()
    error: Annotated[Error | None, Field(description="The misalignment; mode: curves only")] = None
    detectors: Annotated[Detectors | None, Field(description="Lines of detectors; mode: curves only")] = None
    mount_errors: Annotated[
        MountErrors | None, Field(description="Errors of the mounts; modes mount_errors and calibration only")
    ] = None
    statistics: Annotated[
        Statistics | None, Field(description="Statistics over the draws; mode: mount_errors only")
    ] = None
    calibration: Annotated[
        Calibration | None, Field(description="What is estimated, and from which spots; mode: calibration only")
    ] = None

    @model_validator(mode="before")
    @classmethod
    def _with_calibration(cls, given: Any) -> Any:
        """A calibration that says nothing of itself is the usual one."""
        if isinstance(given, Mapping) and given.get("mode") == "calibration" and given.get("calibration") is None:
            return {**given, "calibration": {}}
        return given

    def rules(self) -> Iterator[Fault]:
        """Check that there are heliostats, a sun and the blocks of the mode, and no others."""
        yield from self._place_faults()
        yield from self._sun_faults()
        yield from self._mode_faults()
        yield from self._idle_faults()

    @cached_property
    def _checked(self) -> tuple[list[Problem], list[str]]:
        return checks.check(self)

    def check(self) -> list[Problem]:
        """Return what is wrong between blocks, with the layout or with the sun."""
        return self._checked[0]

    def notes(self) -> list[str]:
        """Return warnings."""
        return self._checked[1]

    def _place_faults(self) -> Iterator[Fault]:
        if self.layout is None and self.heliostats.positions is None:
            yield Fault("give 'heliostats: {positions: [[x, y, z], ...]}' or a 'layout'", show_value=False)
        elif self.layout is not None and self.heliostats.positions is not None:
            yield Fault("give 'positions' or a 'layout', not both", ("heliostats", "positions"), show_value=False)

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
            elif "polar" in _values(self.mount.kind):
                yield Fault("give 'site' or 'sites': a polar mount depends on the latitude", show_value=False)
        if self.time is not None:
            yield from _unsorted(self.time)
        if self.mode == "calibration" and self.sun is not None:
            yield Fault("is for other modes: one sun cannot tell errors apart; give 'time'", ("sun",), show_value=False)

    def _idle_faults(self) -> Iterator[Fault]:
        """Keys that change nothing: what is drawn of errors that are not, and an axis that no mount has."""
        if isinstance(self.mount.axis_azimuth, Sweep) and "tilt_roll" not in _values(self.mount.kind):
            yield Fault("is only for 'kind: tilt_roll', which is not among the mounts", ("mount", "axis_azimuth"))
        errors = self.mount_errors
        if self.mode != "mount_errors" or errors is None:
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
            if any(offset != 0 for offset in _values(self.mount.axis_offset)):
                message = "must be 0 in mode: curves, whose mounts have both axes through the pivot"
                yield Fault(message, ("mount", "axis_offset"))
        elif self.mount_errors is None and (self.calibration is None or self.calibration.spots is None):
            what = "which errors the mounts have" if self.mode == "mount_errors" else "the truth of synthetic spots"
            names = one_of(key for key in MountErrors.model_fields if key not in ("scale", "samples", "seed"))
            yield Fault(f"'mount_errors' is missing: {what}, such as {names}, in mrad", show_value=False)


def _unsorted(time: SolarTime | CivilTime) -> Iterator[Fault]:
    """Days and hours are axes of the result, which must rise."""
    axes: dict[str, Sequence[Any]]
    if isinstance(time, CivilTime):
        axes = {"dates": time.date_list()}
    else:
        sweeps = {"days": time.days, "hours": time.hours, "declination": time.declination}
        # A range rises as its ends do, and may have more values than memory holds.
        axes = {
            key: sweep.items if isinstance(sweep, Listed) else [sweep.first, sweep.last][: len(sweep)]
            for key, sweep in sweeps.items()
            if sweep is not None
        }
    for key, values in axes.items():
        if any(later <= earlier for earlier, later in itertools.pairwise(values)):
            yield Fault("must rise", ("time", key), show_value=False)


def _values(value: object) -> tuple[object, ...]:
    """Values of a key: the one it has, or the ends and the names of its sweep."""
    if not isinstance(value, Sweep):
        return (value,)
    return tuple(value[:]) if len(value) <= 1000 else (value.first, value.last)


STUDY = MisalignmentStudy
