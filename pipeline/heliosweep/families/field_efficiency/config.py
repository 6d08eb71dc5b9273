"""The study file of the family `field_efficiency`."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Annotated, Literal

from pydantic import ConfigDict, Field
from pydantic.config import JsonDict, JsonValue

from heliosweep.config.blocks import Heliostat, Layout, Receiver, Site, Sites
from heliosweep.config.faults import Fault
from heliosweep.config.names import Choice
from heliosweep.config.study import Study
from heliosweep.config.sweep import Sweep
from heliosweep.config.times import SunDirections, TimeOrDirections
from heliosweep.errors import Problem
from heliosweep.families.field_efficiency import checks

TRACKING = {
    "spinning_elevation": "turned about the line of sight to the target, then tilted",
    "azimuth_elevation": "turned about the vertical, then tilted",
}


_SITE: list[JsonValue] = [{"required": ["site"]}, {"required": ["sites"]}]
#: Studies of sun directions have no site, all others have one, or several.
_SITE_OR_DIRECTIONS: JsonDict = {
    "if": {"properties": {"time": {"properties": {"clock": {"const": "sun"}}}}, "required": ["time"]},
    "then": {"not": {"anyOf": _SITE}},
    "else": {"oneOf": _SITE},
}


class FieldEfficiencyStudy(Study):
    """Optical efficiency of a heliostat field over a period: cosine, shading, blocking, and all together."""

    model_config = ConfigDict(json_schema_extra=_SITE_OR_DIRECTIONS)

    family: Literal["field_efficiency"]
    site: Annotated[Site | None, Field(description="Where the plant stands; or several 'sites'")] = None
    sites: Annotated[Sites | None, Field(description="Several named sites: a list, or a CSV table")] = None
    tracking: Annotated[str | Sweep, Choice("How the mirrors follow the sun", TRACKING, title="sun-tracking method")]
    time: Annotated[
        TimeOrDirections,
        Field(description="The instants over which efficiencies are averaged, or directions of the sun"),
    ]
    layout: Annotated[Layout, Field(description="Where the heliostats stand")]
    heliostat: Annotated[Heliostat, Field(description="The mirror of every heliostat")]
    receiver: Annotated[Receiver, Field(description="The aim of all heliostats")]

    def rules(self) -> Iterator[Fault]:
        """Check that there is one site, or several; none where directions of the sun are given."""
        if isinstance(self.time, SunDirections):
            given = [name for name in ("site", "sites") if getattr(self, name) is not None]
            for name in given:
                yield Fault("is not needed: 'time' gives the direction of the sun", (name,), show_value=False)
            if self.output.time_series:
                message = "is for instants; with 'clock: sun' each direction is a point of the result"
                yield Fault(message, ("output", "time_series"), show_value=False)
            return
        if self.site is None and self.sites is None:
            yield Fault("give 'site' or 'sites'", show_value=False)
        elif self.site is not None and self.sites is not None:
            yield Fault("give 'site' or 'sites', not both", ("sites",), show_value=False)

    @cached_property
    def _checked(self) -> tuple[list[Problem], list[str]]:
        return checks.check(self)

    def check(self) -> list[Problem]:
        """Return what is wrong between blocks, with the layout or with the sun."""
        return self._checked[0]

    def notes(self) -> list[str]:
        """Return warnings: mirrors that may touch, latitudes without sun."""
        return self._checked[1]
