"""Study files of the family that are right, and the messages of those that are not."""

from __future__ import annotations

from typing import Any

import pytest

from heliosweep import api
from heliosweep.errors import StudyError

from . import studies

SMALL: dict[str, Any] = {
    "family": "misalignment",
    "site": {"latitude": 37.4},
    "time": {"clock": "solar", "days": [172], "hours": [8, 12]},
    "receiver": {"height": 143, "width": 9, "height_extent": 9},
    "heliostats": {"positions": [[-16, 150, 0], [10, -20, 3]]},
    "error": {"axis": ["elevation", "azimuth"], "size": [0, 1]},
}


def study(**blocks: Any) -> Any:
    return studies.study(SMALL, **blocks)


def test_notes_of_dark_latitudes():
    dark = study(site={"latitude": [-80, 37.4]}, heliostats={"positions": [[0, 9, 0]]})
    assert dark.notes() == ["the sun never rises at latitude -80 deg: it has no spots (NaN)"]


@pytest.mark.parametrize("name", ["hour", "spot_y", "day_of_minimum_tolerance", "corrected_azimuth"])
def test_columns_of_layouts_do_not_hide_results(name, tmp_path):
    (tmp_path / "layout.csv").write_text(f"x,y,{name}\n1,60,3\n5,80,4\n", encoding="utf-8")
    file = {"heliostats": {"pivot_height": 3}, "layout": {"file": str(tmp_path / "layout.csv")}}
    result, plain = api.build(study(**file)), api.build(study(heliostats={"positions": [[1, 60, 3], [5, 80, 3]]}))
    assert result[f"layout_{name}"].to_numpy().tolist() == [3.0, 4.0]
    assert {*plain.variables} <= {*result.variables}
    for label in plain.variables:
        assert result[label].dims == plain[label].dims, label


def test_a_swept_offset_is_an_error_only_where_all_of_it_is_too_large():
    assert study(mount={"mirror_offset": [0.5, 300]}).dimensions()[0].name == "mirror_offset"
    with pytest.raises(StudyError, match="smaller than the distance"):
        study(mount={"mirror_offset": {"start": 300, "stop": 400, "num": 3}})
