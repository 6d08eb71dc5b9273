"""What a study file of the family may say, and what is said of a bad one."""

from functools import partial
from typing import Any

import pytest

from heliosweep import api
from heliosweep.errors import PlanError
from tests.families import studies

SMALL: dict[str, Any] = {
    "family": "backward_gazing", "heliostat": {"distance": 120, "pixel": 0.3},
    "target": {"azimuth": 0, "elevation": 44}, "sun": {"azimuth": 30, "elevation": 60},
    "defects": {"canting": {"2": [0, -1], "3": [0, 1]}}, "erosion": 1,
}  # fmt: skip
study = partial(studies.study, SMALL)


def test_profile_that_rises_is_used_with_a_warning(tmp_path):
    path = tmp_path / "rising.csv"
    path.write_text("# measured\nangle,brightness\n0,1\n1,0.95\n2,0.97\n3,0.9\n4.36,0.7\n", encoding="utf-8")
    sun = {**SMALL["sun"], "profile": str(path)}
    said = study(sun=sun, sun_profile="table").notes()
    assert len(said) == 1
    assert said[0].endswith(
        "the brightness rises in 1 of 4 steps from the centre to the edge, which may be noise; method A inverts the "
        "lowest decreasing curve above the profile"
    )
    before = study(sun=sun, sun_profile="table").study_id
    assert "is not used" in study(sun=sun).notes()[0]
    path.write_text("angle,brightness\n0,1\n1,0.96\n2,0.95\n3,0.9\n4.36,0.7\n", encoding="utf-8")
    assert study(sun=sun, sun_profile="table").notes() == []
    assert study(sun=sun, sun_profile="table").study_id != before  # the contents count


def test_a_heliostat_at_the_foot_of_the_tower_has_a_note(tmp_path):
    path = tmp_path / "foot.csv"
    path.write_text("x,y\n0,100\n0,0\n", encoding="utf-8")
    field = {"latitude": 37, "day": 81, "hours": 12, "layout": {"file": str(path)}, "receiver_height": 95}
    blocks: dict[str, Any] = {"heliostat": {"pixel": 0.3}, "target": None, "sun": None}
    assert [note.partition(",")[0] for note in study(field=field, **blocks).notes()] == [
        "heliostat 1 (line 3) is at the foot of the tower"
    ]
    assert study(field={**field, "facing": "fixed"}, **blocks).notes() == []


def test_pixels_that_do_not_fit_the_memory_are_refused_by_the_plan():
    with pytest.raises(PlanError, match="refused: the smallest chunk of the computation would need"):
        api.plan(study(heliostat={"distance": 120, "pixel": 0.005}, execution={"memory": "1 GB"}))
