"""Directions of the sun as points of a study: the same values as at instants with the sun there."""

from __future__ import annotations

import numpy as np
import pytest

from heliosweep import StudyError
from heliosweep.api import build
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.sun import PLACE, Suns

SUN = {"clock": "sun", "azimuth": [0, 90, 225], "elevation": [-3, 0, 20, 90]}
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


def test_east_and_west_are_not_exchanged(small):
    layout = {"radial_stagger": {"clearance": 13, "inner_radius": 50, "heliostats": 5}}
    result = build(small(site=None, layout=layout, time={"clock": "sun", "azimuth": 90, "elevation": 30})).compute()
    cosine = result["cosine_efficiency"].isel(tracking=0)
    to_tower = -np.stack([result["x"], result["y"]])
    sunward = to_tower[0] / np.hypot(*to_tower)  # the sun in the east: who looks east has it behind the tower
    assert (np.argsort(cosine.to_numpy()) == np.argsort(sunward)).all()


@pytest.mark.parametrize(
    ("blocks", "said"),
    [
        ({}, "site: is not needed: 'time' gives the direction of the sun"),
        ({"site": None, "output": {"time_series": True}}, "output.time_series: needs instants"),
        ({"site": None, "time": {**SUN, "elevation": [-1, 0]}}, "time.elevation: the sun is never above the horizon"),
        ({"site": None, "time": {**SUN, "elevation": 91}}, "time.elevation: must be between -90 and 90 deg"),
        ({"site": None, "time": {"clock": "sun", "azimuth": 3}}, "time.elevation: is missing"),
        ({"site": None, "time": {**SUN, "hours": 3}}, "time.hours: unknown key"),
    ],
)
def test_what_does_not_go_together(small, blocks, said):
    with pytest.raises(StudyError) as caught:
        small(**{"time": SUN, **blocks})
    assert said in str(caught.value)
