"""The study file of the family `field_efficiency`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import ConfigDict, Field

from heliosweep.config.blocks import Heliostat, Layout, Receiver, Site, Sites
from heliosweep.config.faults import Fault
from heliosweep.config.names import Choice
from heliosweep.config.study import Study
from heliosweep.config.sweep import Sweep
from heliosweep.config.times import SolarTime, Time
from heliosweep.errors import Problem

TRACKING = {
    "spinning_elevation": "turned about the line of sight to the target, then tilted",
    "azimuth_elevation": "turned about the vertical, then tilted",
}

MAX_CHECKED = 10**7
"""Studies of more latitudes times instants than this are left to the plan."""


class FieldEfficiencyStudy(Study):
    """Optical efficiency of a heliostat field over a period: cosine, shading, blocking, and all together."""

    model_config = ConfigDict(json_schema_extra={"oneOf": [{"required": ["site"]}, {"required": ["sites"]}]})

    family: Literal["field_efficiency"]
    site: Annotated[Site | None, Field(description="Where the plant stands; or several 'sites'")] = None
    sites: Annotated[Sites | None, Field(description="Several named sites: a list, or a CSV table")] = None
    tracking: Annotated[str | Sweep, Choice("How the mirrors follow the sun", TRACKING, title="sun-tracking method")]
    time: Annotated[Time, Field(description="The instants over which efficiencies are averaged")]
    layout: Annotated[Layout, Field(description="Where the heliostats stand")]
    heliostat: Annotated[Heliostat, Field(description="The mirror of every heliostat")]
    receiver: Annotated[Receiver, Field(description="The aim of all heliostats")]

    def rules(self) -> Iterator[Fault]:
        """Check that there is one site, or several."""
        if self.site is None and self.sites is None:
            yield Fault("give 'site' or 'sites'", show_value=False)
        elif self.site is not None and self.sites is not None:
            yield Fault("give 'site' or 'sites', not both", ("sites",), show_value=False)

    def check(self) -> Iterator[Problem]:
        """Check that the sun is up at some instant, where that depends on the study alone."""
        if self.site is not None and isinstance(self.time, SolarTime) and never_up(self.site.latitude, self.time):
            yield self.problem("time.hours", "the sun never rises at these latitudes, days and hours")


def never_up(latitude: float | Sweep, time: SolarTime) -> bool:
    """Return whether the sun stays at or below the horizon at every latitude and instant on the solar clock.

    Parameters
    ----------
    latitude : float or Sweep
        Positive north. [deg]
    time : SolarTime
        Days or declinations, and hours. False where there are too many instants to look at here.
    """
    latitudes = latitude if isinstance(latitude, Sweep) else [latitude]
    if len(latitudes) * time.count() > MAX_CHECKED:
        return False
    declinations = time.declinations()
    if declinations is None:
        declinations = 23.45 * np.sin(2 * np.pi * (284 + time.day_numbers()) / 365)
    # Of all hours, the sun is highest at the one nearest to noon.
    hour_angle = np.radians(15.0 * np.abs(time.solar_hours() - 12.0).min())
    lat, dec = np.radians(latitudes[:])[:, np.newaxis], np.radians(declinations)
    sine = np.sin(lat) * np.sin(dec) + np.cos(lat) * np.cos(dec) * np.cos(hour_angle)
    return bool(np.all(sine <= 0))
