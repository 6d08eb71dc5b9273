"""The study file of the family `fixed_panel`."""

from typing import Annotated, Literal

from pydantic import Field

from heliosweep.config.block import Block
from heliosweep.config.blocks import Site
from heliosweep.config.study import Study
from heliosweep.config.sweep import Sweep
from heliosweep.config.times import SolarTime
from heliosweep.config.values import Quantity


class Panel(Block):
    """How the panel stands."""

    tilt: Annotated[float | Sweep, Quantity("Angle between the panel and the ground", "deg", ge=0, le=180)]
    azimuth: Annotated[
        float | Sweep, Quantity("Where the panel faces, from north, clockwise", "deg", dimension="panel_azimuth")
    ] = 180.0


class FixedPanelStudy(Study):
    """How squarely the sun meets a panel that does not move."""

    family: Literal["fixed_panel"]
    site: Annotated[Site, Field(description="Where the panel stands")]
    time: Annotated[SolarTime, Field(description="The instants that are averaged over")]
    panel: Annotated[Panel, Field(description="How the panel stands")]


STUDY = FixedPanelStudy
