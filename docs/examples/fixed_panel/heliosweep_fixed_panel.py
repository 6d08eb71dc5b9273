"""Family `fixed_panel`: mean cosine of the incidence angle on a fixed panel."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from heliosweep.config import Block, Quantity, Site, SolarTime, Study, Sweep
from heliosweep.families.family import Computation, Family
from heliosweep.grid.regions import quantity
from heliosweep.report.figures import Curves

EXAMPLE = """\
# A study of the family fixed_panel. To sweep a number, use a list [0, 30] or a range {start: 0, stop: 90, step: 15}.
family: fixed_panel
title: Best tilt for each latitude
site: {latitude: [0, 30, 60]}             # deg, positive north
time:
  clock: solar
  days: {start: 1, stop: 365, step: 7}
  hours: {start: 6, stop: 18, step: 0.5}
  sampling: midpoint
panel:
  tilt: {start: 0, stop: 90, step: 10}    # deg, 0 is horizontal
  azimuth: 180                            # deg from north, clockwise
"""


class Panel(Block):
    """Orientation of the panel."""

    tilt: Annotated[float | Sweep, Quantity("Angle between the panel and the ground", "deg", ge=0, le=180)]
    azimuth: Annotated[float | Sweep, Quantity("Azimuth of the panel normal", "deg", dimension="panel_azimuth")] = 180.0


class FixedPanelStudy(Study):
    """Mean cosine of the incidence angle on a fixed panel."""

    family: Literal["fixed_panel"]
    site: Annotated[Site, Field(description="Site of the panel")]
    time: Annotated[SolarTime, Field(description="Instants over which the cosine is averaged")]
    panel: Annotated[Panel, Field(description="Orientation of the panel")]


def mean_cosine(point):
    """Compute means over the daylight hours. Values are missing (NaN) if the sun does not rise."""
    tilt, azimuth = np.radians(point["panel.tilt"]), np.radians(point["panel.azimuth"])
    normal = np.sin(tilt) * np.sin(azimuth), np.sin(tilt) * np.cos(azimuth), np.cos(tilt)
    day = point.sun[point.sun[:, 2] > 0]
    cosine = np.maximum(normal[0] * day[:, 0] + normal[1] * day[:, 1] + normal[2] * day[:, 2], 0)
    return {"mean_cosine": np.mean(cosine), "lit_fraction": np.mean(cosine > 0)} if len(day) else {}


MEAN = "time: mean (over the instants with the sun above the horizon)"
VARIABLES = {
    "mean_cosine": quantity((), "1", "mean cosine of the incidence angle", "0 if lit from behind", cell_methods=MEAN),
    "lit_fraction": quantity((), "1", "fraction of daylight hours with the sun in front", cell_methods=MEAN),
}
WORK = Computation(mean_cosine, VARIABLES, labels=("site.latitude", "panel.tilt", "panel.azimuth"))
FIGURES = [Curves("tilts", "Mean cosine versus panel tilt", ["mean_cosine"], over=["tilt"])]
FAMILY = Family("fixed_panel", FixedPanelStudy.__doc__, FixedPanelStudy, WORK, example=EXAMPLE, figures=FIGURES)
