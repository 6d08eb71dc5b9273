"""The parameter grid of a study: keys of copies, of parts and of named sites."""

from __future__ import annotations

import pytest

from heliosweep.errors import StudyError
from heliosweep.grid.parameters import Parameters


def test_suns_of_equal_azimuth_are_points_where_the_elevation_differs(small):
    def study(azimuth, elevation):
        time = {"clock": "sun", "azimuth": azimuth, "elevation": elevation}
        return small(site=None, time=time, tracking="azimuth_elevation", zip=[["time.azimuth", "time.elevation"]])

    grid = Parameters(study([120, 120, 240], [30, 50, 50]))
    assert [values for _, values in grid.points("time.azimuth", "time.elevation")] == [(120, 30), (120, 50), (240, 50)]
    with pytest.raises(StudyError, match=r"with the same time\.elevation"):
        study([120, 240, 120], [30, 50, 30])
