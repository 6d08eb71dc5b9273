"""Directions of the sun as points of a study: the same values as at instants with the sun there."""

import numpy as np

from heliosweep.api import build
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.sun import PLACE, Suns

VALUES = ("cosine_efficiency", "shading_efficiency", "blocking_efficiency", "optical_efficiency")


def test_the_same_as_a_normal_run_at_these_directions(small):
    instants = small(
        site={"latitude": 40},
        time={"clock": "solar", "days": [80, 355], "hours": [8, 10.5, 15]},
        output={"time_series": True},
    )
    normal = build(instants).compute()
    parameters = Parameters(instants)
    index, place = next(parameters.points(*PLACE))
    vectors = Suns(parameters).at(index, place)
    azimuth, elevation = np.degrees(np.arctan2(vectors[:, 0], vectors[:, 1])), np.degrees(np.arcsin(vectors[:, 2]))
    time = {"clock": "sun", "azimuth": azimuth, "elevation": elevation}
    directed = small(site=None, time=time, zip=[["time.azimuth", "time.elevation"]])
    given = build(directed).compute()
    assert given.sizes["sun_azimuth"] == 6
    for name in VALUES:
        expected = normal[f"instantaneous_{name}"].transpose("tracking", "time", "heliostat")
        np.testing.assert_allclose(given[name], expected, rtol=0, atol=1e-12, err_msg=name)
