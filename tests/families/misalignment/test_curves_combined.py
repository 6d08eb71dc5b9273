"""Mode curves with errors that the mount has already, beams that open, and measured spots."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from heliosweep.families.family import families
from heliosweep.families.misalignment.study import ERRORS, MOUNTS
from heliosweep.report.draw import draw

from . import studies
from .mount_twin import Twin, solar_vector

TRUE = dict(zip(ERRORS, (1.5, -0.8, 0.9, -1.2, 0.6, -0.7), strict=True))
BASE: dict[str, Any] = {
    "family": "misalignment",
    "site": {"latitude": -33.4},
    "time": {"clock": "solar", "days": [172], "hours": [9, 12, 14.5]},
    "receiver": {"height": 143, "azimuth": 180, "width": 9, "height_extent": 9},
    "heliostats": {"positions": [[-16, -150, 3], [120, -300, 0], [-60, -90, 5]]},
    "mount": {"mirror_offset": 0.5, "pedestal_height": 6, "axis_azimuth": 20},
}
ERROR: dict[str, Any] = {
    "source": ["canting", "encoder", "tilt"], "axis": ["elevation", "azimuth"], "size": [-12, 0, 4, 12],
}  # fmt: skip


def computed(mode: str = "curves", **blocks: Any) -> Any:
    return studies.computed(studies.study({**BASE, "mode": mode}, **blocks))


def spots(result: Any) -> np.ndarray:
    return np.stack([result["spot_y"], result["spot_z"]], axis=-1)


def twin(heliostat: int, kind: str) -> Twin:
    x, y, z = map(float, BASE["heliostats"]["positions"][heliostat])
    return Twin((x, y, z), 143.0, (180.0, 0.0), (4.5, 4.5), kind, -33.4, 20.0, (0.5, 0.0, 6.0))


@pytest.mark.parametrize("kind", MOUNTS)
def test_an_error_on_top_of_others_against_the_twin(kind):
    result = computed(error=ERROR, mount={**BASE["mount"], "kind": kind}, mount_errors=TRUE)
    actual = np.array(list(TRUE.values())) * 1e-3
    pole, seen = np.array([0.0, 0.0, 6.0]), 0
    for h in range(3):
        one = twin(h, kind)
        pivot = np.array(one.pivot)
        tilt = Rotation.from_rotvec([actual[2], actual[3], 0.0]).as_matrix()
        lean = one.frame.T @ tilt @ one.frame
        stood = pivot - pole + lean @ pole
        for hour in BASE["time"]["hours"]:
            sun = solar_vector(-33.4, 172, hour)
            angles = one.aim(sun)
            normal, centre = (vector[0] for vector in one.mirror(angles, actual))
            right = one.mirror(angles, actual + np.array([0, 0, 0, 0, 0, np.pi / 2]))[0][0]
            for axis, about in (("elevation", right), ("azimuth", -np.cross(right, normal))):
                for size in ERROR["size"]:
                    turn = Rotation.from_rotvec(about * size * 1e-3)
                    places = {"canting": centre, "encoder": stood + turn.apply(centre - stood)}
                    places["tilt"] = pivot - pole + turn.apply(centre - pivot + pole)
                    for source, place in places.items():
                        expected, real = one.spots(turn.apply(normal), place, sun)
                        here = result.isel(heliostat=h, day=0).sel(hour=hour, source=source, axis=axis, error_size=size)
                        if real and np.abs(expected).max() < 50:
                            np.testing.assert_allclose(spots(here), expected, atol=2e-12, rtol=1e-12)
                            seen += 1
    assert seen > 150


def test_the_tolerance_that_other_errors_leave():
    alone = computed(error=ERROR, mount_errors={"azimuth_reference": 0})
    errors = computed(error=ERROR, mount_errors=TRUE)
    assert float((errors.tracking_tolerance < alone.tracking_tolerance).mean()) > 0.8
    # A step beyond, on one side or the other, the spot is outside; a step before it is inside.
    point = {"heliostat": 0, "hour": 1, "day": 0}
    for source in ERROR["source"]:
        for axis in ERROR["axis"]:
            at = float(errors.tracking_tolerance.isel(point).sel(source=source, axis=axis))
            sizes = sorted([-at * 1.001, -at * 0.999, at * 0.999, at * 1.001])
            around = computed(error={"source": source, "axis": axis, "size": sizes}, mount_errors=TRUE)
            inside = around.inside.isel(point).to_numpy().tolist()
            assert inside[1:3] == [1, 1]
            assert not all(inside)
    outside = computed(error=ERROR, mount_errors={"azimuth_reference": 60})
    assert (outside.tracking_tolerance == 0).all()
    assert (outside.hit_fraction.sel(error_size=0) == 0).all()
    crossed = computed(error=ERROR, mount_errors=TRUE, detectors={"lines": [[1, 0, 0]]})
    assert float(np.abs(crossed.crossing_error).min()) > 1e-3  # the curve no longer starts at the aim point
    assert float(np.abs(crossed.crossing_y).max()) < 1e-10


def test_a_wide_beam_opens_from_a_disc_at_the_mirror():
    """Rims and edges are half the width, and 2 mrad times the way, from the central ray."""
    error = {"source": "canting", "axis": ["elevation", "azimuth"], "size": [-12, 0, 12]}
    result = computed(error=error, beam={"divergence": 4, "width": [0, 0.5]}, mount={})
    np.testing.assert_array_equal(
        result.outline_y.sel(beam_width=0), computed(error=error, beam={"divergence": 4}, mount={}).outline_y
    )
    one, here = Twin(twin(0, "azimuth_elevation").pivot, 143.0, (180.0, 0.0)), result.isel(heliostat=0, day=0, hour=1)
    _, right, up = one.axes
    seen = 0
    for kind in ("outline", "edge"):
        for _, point in here.stack(point=["axis", "error_size", "beam_width"]).groupby("point"):
            spot, *rim = (
                np.multiply.outer(np.asarray(y), right) + np.multiply.outer(np.asarray(z), up) - one.pivot + one.target
                for y, z in ((point.spot_y, point.spot_z), (point[f"{kind}_y"], point[f"{kind}_z"]))
            )
            ray = spot.squeeze() / np.linalg.norm(spot)
            off = np.linalg.norm(np.cross(np.squeeze(rim), ray), axis=-1)
            width = float(point.beam_width.squeeze())
            np.testing.assert_allclose(off, 0.5 * width + np.tan(2e-3) * (np.squeeze(rim) @ ray), rtol=1e-9)
            seen += 1
    assert seen == 2 * 2 * 3 * 2


def test_measured_spots_are_kept_beside_the_curves(tmp_path):
    path = tmp_path / "spots.csv"
    rows = "\n".join(f"{h},{y},{z},0,0.6,0.8" for h, y, z in ((1, 0.5, -1), (0, 2, 3), (1, 0.7, -2)))
    path.write_text("heliostat,y,z,sun_x,sun_y,sun_z\n" + rows + "\n", encoding="utf-8")
    result = computed(error=ERROR, measured=str(path))
    np.testing.assert_array_equal(result.measured_y, [[2, np.nan], [0.5, 0.7], [np.nan, np.nan]])
    np.testing.assert_array_equal(result.measured_z, [[3, np.nan], [-1, -2], [np.nan, np.nan]])
    shown = {one.name: one for one in draw(result, families()["misalignment"].figures(result))}["deviation_curves"]
    assert "Crosses: measured spots" in shown.caption
    lines = [line for axes in shown.figure.axes for line in axes.get_lines() if line.get_marker() == "+"]
    drawn = [np.asarray(line.get_xdata()).tolist() for line in lines]
    for measured in (2.0, 0.5, 0.7):
        assert any(measured in line for line in drawn)
