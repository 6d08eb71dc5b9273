"""The study file of the family `field_efficiency`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal

from pydantic import Field

from heliosweep.config.blocks import Heliostat, Layout, Receiver, Site, Sites, Time
from heliosweep.config.faults import Fault
from heliosweep.config.fields import Choice
from heliosweep.config.study import Study
from heliosweep.config.sweep import Sweep

TRACKING = {
    "spinning_elevation": "turned about the line of sight to the target, then tilted",
    "azimuth_elevation": "turned about the vertical, then tilted",
}


class FieldEfficiencyStudy(Study):
    """Optical efficiency of a heliostat field over a period: cosine, shading, blocking and all three."""

    family: Literal["field_efficiency"]
    site: Annotated[Site | None, Field(description="Where the plant stands; or several 'sites'")] = None
    sites: Annotated[Sites | None, Field(description="Several named sites: a list, or a CSV table")] = None
    tracking: Annotated[
        str | Sweep, Choice("How the mirrors follow the sun", TRACKING, title="tracking method")
    ]
    time: Time
    layout: Annotated[Layout, Field(description="Where the heliostats stand")]
    heliostat: Annotated[Heliostat, Field(description="The mirror of every heliostat")]
    receiver: Annotated[Receiver, Field(description="The aim of all heliostats")]

    def rules(self) -> Iterable[Fault]:
        """One site or several."""
        if (self.site is None) == (self.sites is None):
            yield Fault(
                "give exactly one of 'site' and 'sites'", () if self.site is None else ("sites",), False
            )
