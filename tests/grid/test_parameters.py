"""The parameter grid of a study: keys of copies, of parts and of named sites."""

from __future__ import annotations

import pytest

from heliosweep.errors import StudyError
from heliosweep.grid.parameters import Parameters


def dimensions(study) -> dict[str, int]:
    return {dim.name: len(dim) for dim in study.dimensions()}


def test_suns_of_equal_azimuth_are_points_where_the_elevation_differs(small):
    time = {"clock": "sun", "azimuth": [120, 120, 240], "elevation": [30, 50, 50]}
    study = small(site=None, time=time, tracking="azimuth_elevation", zip=[["time.azimuth", "time.elevation"]])
    grid = Parameters(study)
    assert [values for _, values in grid.points("time.azimuth", "time.elevation")] == [(120, 30), (120, 50), (240, 50)]
    time = {"clock": "sun", "azimuth": [120, 240, 120], "elevation": [30, 50, 30]}
    with pytest.raises(StudyError, match=r"with the same time\.elevation"):
        small(site=None, time=time, tracking="azimuth_elevation", zip=[["time.azimuth", "time.elevation"]])
