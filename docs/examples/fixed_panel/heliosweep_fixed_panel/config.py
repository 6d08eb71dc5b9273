"""The study file of the family `fixed_panel`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from heliosweep.config.block import Block
from heliosweep.config.blocks import Site
from heliosweep.config.quantity import Quantity
from heliosweep.config.study import Study
from heliosweep.config.sweep import Sweep
from heliosweep.config.times import SolarTime


class Panel(Block):
    """How the panel stands."""

    tilt: Annotated[
        float | Sweep,
        Quantity("Angle between the panel and the ground", "deg", ge=0, le=180, title="tilt of the panel"),
    ]
    azimuth: Annotated[
        float | Sweep,
        Quantity(
            "Where the panel faces, from north, clockwise: 180 is south", "deg", ge=-360, le=360,
            dimension="panel_azimuth", title="azimuth of the panel",
        ),
    ] = 180.0  # fmt: skip


class FixedPanelStudy(Study):
    """How squarely the sun meets a panel that does not move."""

    family: Literal["fixed_panel"]
    site: Annotated[Site, Field(description="Where the panel stands")]
    time: Annotated[SolarTime, Field(description="The instants that are averaged over")]
    panel: Annotated[Panel, Field(description="How the panel stands")]
