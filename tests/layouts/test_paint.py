"""Folders of PAINT: places on the Earth, facets, targets, and what each bad file is told."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from astropy import units
from astropy.coordinates import EarthLocation

from heliosweep import StudyError, read_layout, read_paint, study
from heliosweep.cli import main
from heliosweep.layouts.paint import local_positions

SAMPLE = Path(__file__).parents[1] / "data" / "paint"
AA31 = "AA31/heliostat-properties.json"
TOWER = "tower-measurements.json"


@pytest.fixture
def folder(tmp_path) -> Path:
    """A copy of the sample, to damage."""
    return Path(shutil.copytree(SAMPLE, tmp_path / "paint"))


def change(path: Path, *keys: str | int, to: object) -> None:
    data = value = json.loads(path.read_text())
    for key in keys[:-1]:
        value = value[key]
    value[keys[-1]] = to
    path.write_text(json.dumps(data, indent=2))


def told(folder: Path, **options) -> list[str]:
    with pytest.raises(StudyError) as caught:
        read_paint(folder, **options)
    assert caught.value.exit_code == 2
    return [str(problem).replace(f"{folder}/", "") for problem in caught.value.problems]


def geocentric(place: np.ndarray) -> np.ndarray:
    """By ERFA."""
    made = EarthLocation.from_geodetic(place[1] * units.deg, place[0] * units.deg, place[2] * units.m, "WGS84")
    return np.array([axis.to_value(units.m) for axis in made.geocentric])


def test_places_on_the_earth():
    """Against geocentric positions of ERFA and axes by finite differences, over 1 km, at several places."""
    rng = np.random.default_rng(1)
    for origin in ((50.913421, 6.387825, 87.0), (-34.0, 151.0, 500.0), (0.1, -179.999, 0.0), (80.0, 0.001, 3000.0)):
        away = rng.uniform(-1, 1, (20, 3)) * (0.009, 0.009 / np.cos(np.radians(origin[0])), 200.0)
        found = local_positions(np.array(origin) + away, origin)
        axes = []
        for axis, step in ((1, 1e-3), (0, 1e-3), (2, 1.0)):
            ahead, behind = np.array(origin), np.array(origin)
            ahead[axis], behind[axis] = ahead[axis] + step, behind[axis] - step
            along = geocentric(ahead) - geocentric(behind)
            axes.append(along / np.sqrt(np.sum(along**2)))
        expected = [np.array(axes) @ (geocentric(place) - geocentric(np.array(origin))) for place in origin + away]
        np.testing.assert_allclose(found, expected, atol=2e-6)


def test_positions_and_mirrors():
    """Distances in the files: 24.7 m north is 2.22e-4 deg of a meridian of 111.25 km."""
    layout = read_paint(SAMPLE, "multi_focus_tower").layout
    assert layout.columns["id"].tolist() == ["AA31", "AA39", "AC43"]
    east, north = layout.x - 17.6049, layout.y - 2.7447  # the target's centre is this far west and south
    np.testing.assert_allclose(east, [-21.8997, 13.2580, 30.9440], atol=1e-4)
    np.testing.assert_allclose(north, [24.9007, 24.7166, 33.8225], atol=1e-4)
    np.testing.assert_allclose(layout.z, np.array([88.67166, 88.68894, 88.73835]) - 87, atol=3e-4)  # the Earth is round
    np.testing.assert_allclose(layout.columns["width"], 3.22, atol=1e-6)
    np.testing.assert_allclose(layout.columns["height"], 2.56, atol=1e-6)


def test_canting_is_on_axis():
    """Slopes of the facets' long and short sides in the files, rise over run, give the same distance."""
    layout = read_paint(SAMPLE).layout
    rise = np.array([0.004984567873179913, 0.004984567873179913, 0.004643493639490212]) / 0.80248
    np.testing.assert_allclose(layout.columns["canting_distance"], 0.8075 / (2 * rise), rtol=1e-4)
    short = np.array([0.0031505227, 0.0031505227, 0.0029349547]) / 0.63749
    np.testing.assert_allclose(layout.columns["canting_distance"], 0.6425 / (2 * short), rtol=1e-4)


def test_targets():
    receiver = read_paint(SAMPLE).receiver
    assert receiver["azimuth"] == 0
    assert receiver["tilt"] == pytest.approx(-25, abs=1e-4)
    assert receiver["height"] == pytest.approx(142.22675 - 87, abs=1e-4)
    assert receiver["width"] == pytest.approx(4.14, abs=0.02)  # the chord of 60 deg of a radius of 4.14 m
    other = read_paint(SAMPLE, "solar_tower_juelich_lower").receiver
    assert (other["azimuth"], other["tilt"]) == (0, 0)
    assert other["height_extent"] == pytest.approx(39.491 - 32.2735, abs=1e-3)
    assert told(SAMPLE, target="moon")[0].endswith(
        "tower-measurements.json: has no target 'moon'; it has solar_tower_juelich_upper, solar_tower_juelich_lower, "
        "multi_focus_tower, receiver"
    )


def test_command_and_study(tmp_path, monkeypatch, capsys):
    """What the table says stands in a study as it is."""
    monkeypatch.chdir(tmp_path)
    assert main(["convert", str(SAMPLE), "juelich.csv"]) == 0
    assert capsys.readouterr().out == "juelich.csv\n"
    plant, layout = read_paint(SAMPLE), read_layout("juelich.csv")
    np.testing.assert_array_equal(layout.x, plant.layout.x)
    assert set(layout.columns) == set(plant.layout.columns)
    text = Path("juelich.csv").read_text().replace("# ", "")
    assert "for the slant range, and normals differ by up to 0.57 mrad" in text
    blocks = [line for line in text.splitlines() if line.startswith(("site:", "heliostat:", "receiver:"))]
    rest = "family: field_efficiency\ntracking: azimuth_elevation\nlayout: {file: juelich.csv}\n"
    rest += "time: {clock: solar, days: [80], hours: [12]}\noptics: {sun_shape: {kind: pillbox}, slope_error: 1}\n"
    Path("study.yaml").write_text("\n".join([rest, *blocks]))
    assert main(["validate", "study.yaml"]) == 0
    made = study(
        "field_efficiency", site=plant.site, tracking="azimuth_elevation",
        time={"clock": "solar", "days": [80], "hours": [12]}, layout={"file": "juelich.csv"}, heliostat=plant.heliostat,
        receiver=plant.receiver, optics={"sun_shape": {"kind": "pillbox"}, "slope_error": 1},
    )  # fmt: skip
    assert made.study_id in capsys.readouterr().out
    assert main(["convert", str(SAMPLE), "pilot.csv", "--to", "solarpilot", "--aim", "multi_focus_tower"]) == 0
    assert len(read_layout("pilot.csv")) == 3


def test_folders_that_are_none(folder, tmp_path):
    (tmp_path / "empty").mkdir()
    for place, said in (("empty", "it contains no *heliostat-properties.json"), ("gone", "there is no such folder")):
        assert told(tmp_path / place) == [f"{tmp_path / place}: is not a PAINT folder: {said}"]
    shutil.copy(folder / TOWER, folder / "AA31" / TOWER)
    assert "it contains 2 files *tower-measurements.json, but must contain one" in told(folder)[0]
    shutil.copytree(folder / "AA31", folder / "more" / "AA31")
    (said,) = told(folder)
    assert said.startswith(f"more/{AA31}: is the second file of heliostat AA31; the first is ")


@pytest.mark.parametrize(
    ("keys", "value", "said"),
    [
        (("heliostat_position", 0), 95.0, "3:5: heliostat_position[0]: must be between -90 and 90 deg (got 95.0)"),
        (("heliostat_position", 2), True, "heliostat_position[2]: must be a length in m"),
        (("heliostat_position", 1), 7.9, "106 km from the tower"),
        (("width",), float("nan"), "width: must be a length in m, a number or text such as '1.5 m' (got 'NaN')"),
        (("height",), "2.5", "height: must be a number without quotes"),
        (("height",), None, "height: is empty"),
        (("facet_properties", "facets"), [], "facet_properties.facets: must not be empty"),
        (("facet_properties", "facets"), 5, "facet_properties.facets: must be a list (got 5)"),
        (("facet_properties", "facets", 1), {}, "facet_properties.facets[1].translation_vector: is missing"),
        (("facet_properties", "facets", 2, "canting_e"), [-1, 0, 0], "must span a facet that faces up"),
        (("facet_properties", "facets", 3, "translation_vector", 0), 0.9, "must be a grid of equal facets"),
        (("width",), 3.4, "must be a grid of equal facets with equal gaps, on 3.4 m x 2.56 m, within 5 mm"),
    ],
)
def test_values(folder, keys, value, said):
    change(folder / AA31, *keys, to=value)
    problems = told(folder)
    assert all(problem.startswith(f"{AA31}:") for problem in problems)
    assert said in problems[0]
