"""The numbers of a region of the result."""

import numpy as np
import xarray as xr

from heliosweep.grid.clock import instant_count
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Workload
from heliosweep.grid.regions import Region
from heliosweep.grid.sun import PLACE, Suns, sun_attributes
from heliosweep_fixed_panel.kernel import mean_cosine
from heliosweep_fixed_panel.study import FixedPanelStudy
from heliosweep_fixed_panel.variables import ATTRIBUTES


def workload(study: FixedPanelStudy) -> Workload:
    """Sizes and cost, for the plan."""
    instants = instant_count(study.time)
    return Workload(
        parameters=Parameters(study).sizes,
        inner={},
        evaluations=instants,
        unit="panel-instants",
        working_bytes=lambda points, _: 16 * points + 80 * instants,
    )


def coordinates(study: FixedPanelStudy) -> xr.Dataset:
    """Coordinates of the whole result: what is swept, and these keys also where they are not."""
    keys = ("site.latitude", "panel.tilt", "panel.azimuth")
    return xr.Dataset(coords=Parameters(study).coordinates(keys), attrs=sun_attributes(study.time))


def compute(study: FixedPanelStudy, inputs: None, region: Region) -> xr.Dataset:
    """Means over the daylight at every point of a region."""
    parameters = Parameters(study, region)
    suns = Suns(parameters)
    values = np.empty((2, *parameters.sizes.values()))
    for index, (tilt, azimuth, *place) in parameters.points("panel.tilt", "panel.azimuth", *PLACE):
        values[:, *index] = mean_cosine(tilt, azimuth, suns.at(index, place))
    return xr.Dataset({name: (tuple(parameters.sizes), one) for name, one in zip(ATTRIBUTES, values, strict=True)})
