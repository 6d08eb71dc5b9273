"""The parameter grid of a study: keys of copies, of parts and of named sites."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from heliosweep.errors import StudyError
from heliosweep.grid.parameters import Parameters


def dimensions(study) -> dict[str, int]:
    return {dim.name: len(dim) for dim in study.dimensions()}


def test_a_copy_with_other_blocks_has_other_dimensions(small):
    study = small()
    assert dimensions(study) == {"latitude": 2, "tracking": 2}
    other = study.model_copy(update={"site": small(site={"latitude": 40}).site})
    assert dimensions(other) == {"tracking": 2}
    assert dimensions(study) == dimensions(pickle.loads(pickle.dumps(study))) == {"latitude": 2, "tracking": 2}
    assert other.study_id != study.study_id


def test_values_over_a_region(small):
    grid = Parameters(small(), {"latitude": slice(1, 2)})
    latitudes, heights = grid.values("site.latitude"), grid.values("receiver.height")
    assert latitudes is not None
    assert heights is not None
    assert (latitudes.tolist(), heights.tolist()) == ([[40, 40]], [[60, 60]])
    assert grid.values("tracking").tolist() == [["spinning_elevation", "azimuth_elevation"]]  # type: ignore[union-attr]
    assert grid.values("site.longitude") is None
    with pytest.raises(KeyError):
        grid.parameter("site.longitude")


def test_values_of_named_sites(small):
    sites = [{"name": "a", "latitude": 1, "longitude": 5}, {"name": "b", "latitude": 2}]
    grid = Parameters(small(site=None, sites=sites, tracking="azimuth_elevation"))
    np.testing.assert_array_equal(grid.values("site.longitude"), [5.0, np.nan])
    assert grid.parameter("site.latitude").dims == ("site",)
    assert grid.parameter("site.latitude").attrs["units"] == "degrees_north"


def test_points_refuse_keys_that_the_study_does_not_declare(small):
    grid = Parameters(small())
    assert next(grid.points("receiver.height", "receiver.radius")) == ((0, 0), (60, None))
    with pytest.raises(StudyError, match=r"receiver\.hight: is no key"):
        next(grid.points("receiver.hight"))


def test_suns_of_equal_azimuth_are_points_where_the_elevation_differs(small):
    time = {"clock": "sun", "azimuth": [120, 120, 240], "elevation": [30, 50, 50]}
    study = small(site=None, time=time, tracking="azimuth_elevation", zip=[["time.azimuth", "time.elevation"]])
    grid = Parameters(study)
    assert [values for _, values in grid.points("time.azimuth", "time.elevation")] == [(120, 30), (120, 50), (240, 50)]
    time = {"clock": "sun", "azimuth": [120, 240, 120], "elevation": [30, 50, 30]}
    with pytest.raises(StudyError, match=r"with the same time\.elevation"):
        small(site=None, time=time, tracking="azimuth_elevation", zip=[["time.azimuth", "time.elevation"]])
