"""Fields of heliostats: each scene is that of a single heliostat, and what becomes of those without sun or sight."""

import copy
from typing import Any

import numpy as np
import pytest

from heliosweep import api
from heliosweep.families.backward_gazing.compute import remarks
from heliosweep.families.backward_gazing.variables import BEHIND, NO_SUN, SEEN
from heliosweep.kernels.sun import declination_cooper, solar_clock

LAYOUT = "x,y,z,row\n0,150,0,1\n-40,140,1,1\n120,90,0,2\n20,-130,0,3\n"
SMALL: dict[str, Any] = {
    "family": "backward_gazing", "heliostat": {"pixel": 0.3}, "cameras": {"radius": 0.3},
    "defects": {"canting": {"2": [0, -1]}, "waviness": 0.1}, "method": ["A", "LM"], "referential": ["none", "exact"],
    "erosion": 1,
}  # fmt: skip


@pytest.fixture
def make(tmp_path):
    path = tmp_path / "field.csv"
    path.write_text(LAYOUT, encoding="utf-8")

    def study(field: dict[str, Any] | None = None, **blocks: Any) -> Any:
        own = {
            "latitude": 37.4, "day": 81, "hours": [10, 12, 19], "layout": {"file": str(path)}, "receiver_height": 95,
            "pivot_height": 7, **(field or {}),
        }  # fmt: skip
        return api.load({**copy.deepcopy(SMALL), "field": own, **blocks})

    return study


def test_a_scene_of_a_field_is_that_of_one_heliostat(make):
    field = api.build(make(defects={"canting": {"2": [0, -1]}})).compute()
    x, y, z = -40.0, 140.0, 95.0 - 8.0
    sun = solar_clock(np.radians(37.4), declination_cooper(81), 10.0)
    to_target = np.array([-x, -y, z])
    (sun_azimuth, sun_elevation), (target_azimuth, elevation) = (  # from south towards east, as the study has it
        np.degrees([np.arctan2(v[0], -v[1]), np.arctan2(v[2], np.hypot(v[0], v[1]))]) for v in (sun, to_target)
    )
    assert float(field["slant_range"].sel(heliostat=1)) == pytest.approx(np.linalg.norm(to_target))
    blocks = copy.deepcopy(SMALL)
    blocks["defects"].pop("waviness")
    alone: dict[str, Any] = {
        "heliostat": {"distance": float(np.linalg.norm(to_target)), "pixel": 0.3},
        "target": {"azimuth": target_azimuth, "elevation": elevation, "face": target_azimuth},
        "sun": {"azimuth": sun_azimuth, "elevation": sun_elevation},
    }  # fmt: skip
    one = api.build(api.load({**blocks, **alone})).compute()
    scene = field.sel(heliostat=1, hour=10)
    assert float(scene["incidence"]) == pytest.approx(float(one["incidence"]), abs=1e-9)
    bias = one["slope_bias_y"]
    np.testing.assert_allclose(scene["canting_rms_y"], np.sqrt((bias**2).mean("module")), atol=1e-9)
    np.testing.assert_allclose(scene["lit_cameras"], one["lit_cameras"].mean(), rtol=0.02)


def test_sun_below_the_horizon(make):
    result = api.build(make()).compute()
    assert (result["scene_status"].sel(hour=19) == NO_SUN).all()
    assert (result["scene_status"].sel(hour=[10, 12]) == SEEN).all()
    assert np.isnan(result["slope_rms_x"].sel(hour=19)).all()
    assert list(remarks(result)) == ["no slopes in 4 of 12 scenes: sun below the horizon (scene_status 2)"]


def test_fixed_face_is_not_seen_from_behind(make):
    result = api.build(make({"facing": ["heliostat", "fixed"], "hours": 12})).compute()
    fixed = result["scene_status"].sel(facing="fixed").to_numpy().ravel()
    assert fixed.tolist() == [SEEN, SEEN, SEEN, BEHIND]
    steep = api.build(make({"facing": "fixed", "hours": 12}, target={"tilt": 60})).compute()
    assert steep["scene_status"].to_numpy().ravel().tolist() == [SEEN, SEEN, SEEN, SEEN]  # it faces down
    north = {name: float(result["lit_cameras"].sel(facing=name, heliostat=0).item()) for name in ("heliostat", "fixed")}
    assert north["heliostat"] == pytest.approx(north["fixed"], abs=1e-9)  # it stands before the face


def test_noise_is_drawn_for_each_heliostat_and_hour(make):
    """Two heliostats at the same place, and two suns that are mirror images, do not share their noise."""
    result = api.build(make({"hours": [11, 13]}, cameras={"radius": 0.3, "noise": 0.01})).compute()
    rms = result["slope_rms_x"].sel({"slope_method": "LM", "referential": "exact", "heliostat": 0}).to_numpy()
    assert rms[0] != rms[1]
    assert rms[0] == pytest.approx(rms[1], rel=0.2)
