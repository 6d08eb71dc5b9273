"""Mode curves: from the study file to the numbers, whatever the clock, the sweep, the chunks and the scheduler."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from heliosweep import api
from heliosweep.errors import StudyError
from heliosweep.families.misalignment.report import remarks
from heliosweep.kernels.mounts import BEHIND_FACE, NO_SUN, REACHES, TOO_NEAR

from . import studies

ORACLE = Path(__file__).parents[2] / "data" / "misalignment_oracle.csv"


def study(**blocks: Any) -> Any:
    return studies.study(studies.CURVES, **blocks)


def computed(**blocks: Any) -> Any:
    return studies.computed(study(**blocks))


def solar(*days: int, hours: Any = (8, 10, 12, 14, 16)) -> dict[str, Any]:
    return {"clock": "solar", "days": list(days), "hours": hours if isinstance(hours, dict) else list(hours)}


def error(**keys: Any) -> dict[str, Any]:
    return {"source": "canting", "axis": "elevation", "size": [-3, 0, 3], **keys}


def test_numbers_of_the_oracle():
    with ORACLE.open(newline="") as file:
        rows = [tuple(row) for row in csv.reader(file)][1:]
    oracle = {(case, quantity): float(value) for case, quantity, value in rows}
    result = computed(mount={"mirror_offset": [0, 0.5]}).isel(heliostat=0, hour=0, declination=0)
    cases = [(f"{axis} +12 mrad, r=0", 0.0, "canting", axis) for axis in ("elevation", "azimuth", "encoder_azimuth")]
    cases += [("elevation +12 mrad, r=0.5 about the pivot", 0.5, "encoder", "elevation")]
    for case, offset, source, axis in cases:
        spot = result.sel(mirror_offset=offset, source=source, axis=axis, error_size=12)
        for side in "yz":
            assert float(spot[f"spot_{side}"]) == pytest.approx(oracle[case, f"spot_{side}_m"], abs=1e-9)
    curve = result.sel(mirror_offset=0, source="canting", axis="elevation")
    for name in "CDE":
        assert float(curve["conic"].sel(conic_coefficient=name)) == pytest.approx(
            oracle["elevation curve conic, A=1", name], abs=1e-7
        )
    assert float(curve["eccentricity"]) == pytest.approx(oracle["elevation curve", "eccentricity"], abs=1e-9)


def test_a_changed_result_does_not_change_the_times_of_later_results():
    window = {"start": "08:00", "stop": "10:00", "step": "1 h"}
    time = {"clock": "civil", "dates": "2024-06-21", "window": window}
    site = {"latitude": 37.4, "longitude": 0.0, "timezone": "+02:00"}
    for _ in range(2):
        result = api.build(study(time=time, site=site))
        assert result["utc"].dt.hour.values.tolist() == [[6, 7, 8]]  # universal time is 2 h earlier
        result["utc"].values[...] = np.datetime64("NaT")


def test_hit_fractions_and_the_minimum_tolerance():
    result = computed(time=solar(80, 172, hours={"start": 4, "stop": 20, "step": 0.5}), error=error(size=[0, 8]))
    sun = (result["spot_status"] != NO_SUN).sel(error_size=0).isel(heliostat=0)
    assert sun.sum("hour").values.tolist() == [23, 29]
    expected = (result["inside"].sum("hour") / sun.sum("hour")).transpose(*result["hit_fraction"].dims)
    np.testing.assert_array_equal(result["hit_fraction"], expected)
    least = result["tracking_tolerance"].min(("day", "hour"))
    np.testing.assert_array_equal(result["minimum_tolerance"], least)
    for number in range(2):
        one = result.isel(heliostat=number)
        when = {"day": one["day_of_minimum_tolerance"], "hour": one["hour_of_minimum_tolerance"]}
        assert float(one["tracking_tolerance"].sel(when)) == float(one["minimum_tolerance"])


def test_days_without_sun_have_no_hits_and_no_minimum_tolerance():
    result = computed(site={"latitude": [70, 37.4]}, time=solar(355, hours=[10, 12]))
    dark = result.sel(latitude=70)
    assert (dark["spot_status"] == NO_SUN).all()
    missing = "hit_fraction tracking_tolerance minimum_tolerance day_of_minimum_tolerance conic spot_y"
    for name in missing.split():
        assert bool(dark[name].isnull().all()), name
    assert bool(result.sel(latitude=37.4)["minimum_tolerance"].notnull().all())
    assert list(remarks(result)) == ["the sun is down at 2 of 4 instants: no spot (spot_status 3)"]


def test_heliostats_that_cannot_hit_are_flagged_and_counted():
    positions = [[-16, 150, 0], [0, 0, 0], [30, -80, 0], [0, 0.2, 143], [5, 0, 143]]
    result = computed(
        time=solar(172), heliostats={"positions": positions}, mount={"mirror_offset": [0.1, 0.3]}, error=error(size=0)
    )
    status = result["spot_status"]
    assert (status.isel(heliostat=0) == REACHES).all()
    assert (status.isel(heliostat=2) == BEHIND_FACE).all()
    assert (status.sel(mirror_offset=0.3).isel(heliostat=3) == TOO_NEAR).all()
    flagged = status != REACHES
    assert bool(flagged.isel(heliostat=2).all())
    for name in ("inside", "is_real"):
        assert int(result[name].where(flagged, 0).sum()) == 0
    assert bool(result["spot_y"].isnull().where(flagged, True).all())
    assert bool(result["tracking_tolerance"].isnull().where(flagged, True).all())
    said = list(remarks(result))
    assert any("heliostats, counted at each point of the sweep, are on the receiver plane" in line for line in said)
    assert any("1 of 10 heliostats" in line and "closer to the aim point" in line for line in said)


def test_a_sun_that_stands_still():
    sun = {"azimuth": [101, 260], "elevation": [50, 48]}
    result = computed(
        time=None, site=None, sun=sun, zip=[["sun.azimuth", "sun.elevation"]], error=error(axis=["elevation"])
    )
    assert result["spot_y"].dims == ("sun_azimuth", "axis", "error_size", "heliostat", "day", "hour")
    assert result.sizes["day"] == result.sizes["hour"] == 1
    assert "day" not in result.coords
    assert "hour" not in result.coords
    assert "hour_of_minimum_tolerance" not in result
    np.testing.assert_array_equal(result["sun_elevation"], [50, 48])
    np.testing.assert_array_equal(result["minimum_tolerance"], result["tracking_tolerance"].squeeze(("day", "hour")))


def test_heliostats_of_a_layout_stand_above_its_ground(tmp_path):
    (tmp_path / "a.csv").write_text("x,y,z\n0,60,1\n20,90,2\n-30,80,0\n", encoding="utf-8")
    result = computed(layout={"file": str(tmp_path / "a.csv")}, heliostats={"pivot_height": [3, 5]}, error=error())
    same = computed(heliostats={"positions": [[0, 60, 6], [20, 90, 7], [-30, 80, 5]]}, error=error())
    np.testing.assert_array_equal(result["spot_y"].sel(pivot_height=5), same["spot_y"])


SMALL: dict[str, Any] = {
    "family": "misalignment", "site": {"latitude": 37.4}, "time": {"clock": "solar", "days": [172], "hours": [8, 12]},
    "receiver": {"height": 143, "width": 9, "height_extent": 9},
    "heliostats": {"positions": [[-16, 150, 0], [10, -20, 3]]},
    "error": {"axis": ["elevation", "azimuth"], "size": [0, 1]},
}  # fmt: skip


def config_study(**blocks: Any) -> Any:
    return studies.study(SMALL, **blocks)


def test_notes_of_dark_latitudes():
    dark = config_study(site={"latitude": [-80, 37.4]}, heliostats={"positions": [[0, 9, 0]]})
    assert dark.notes() == ["the sun never rises at latitude -80 deg: it has no spots (NaN)"]


@pytest.mark.parametrize("name", ["hour", "spot_y", "day_of_minimum_tolerance", "corrected_azimuth"])
def test_columns_of_layouts_do_not_hide_results(name, tmp_path):
    (tmp_path / "layout.csv").write_text(f"x,y,{name}\n1,60,3\n5,80,4\n", encoding="utf-8")
    file = {"heliostats": {"pivot_height": 3}, "layout": {"file": str(tmp_path / "layout.csv")}}
    result, plain = (
        api.build(config_study(**file)),
        api.build(config_study(heliostats={"positions": [[1, 60, 3], [5, 80, 3]]})),
    )
    assert result[f"layout_{name}"].to_numpy().tolist() == [3.0, 4.0]
    assert {*plain.variables} <= {*result.variables}
    for label in plain.variables:
        assert result[label].dims == plain[label].dims, label


def test_a_swept_offset_is_an_error_only_where_all_of_it_is_too_large():
    assert config_study(mount={"mirror_offset": [0.5, 300]}).dimensions()[0].name == "mirror_offset"
    with pytest.raises(StudyError, match="smaller than the distance"):
        config_study(mount={"mirror_offset": {"start": 300, "stop": 400, "num": 3}})
