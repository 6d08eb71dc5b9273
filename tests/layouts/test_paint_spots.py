"""Measured spots of PAINT: actuators and the fit computed a second time, and what bad files are told."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import brentq, least_squares
from scipy.spatial.transform import Rotation

from heliosweep import StudyError, api, read_paint_spots, write_corrections, write_paint_study
from heliosweep.cli import main
from heliosweep.layouts.paint import local_positions
from tests.layouts.test_paint import change

ROOT = Path(__file__).parents[2]
SAMPLE = ROOT / "tests" / "data" / "paint"
STUDY = ROOT / "studies" / "calibration_juelich.yaml"
SPOT, PROPERTIES = "AA39/270398-calibration-properties.json", "AA39/heliostat-properties.json"
ACTUATOR = ("kinematics_properties", "actuators", 0)


@pytest.fixture
def folder(tmp_path):
    """The sample with one heliostat."""
    place = tmp_path / "paint"
    shutil.copytree(SAMPLE / "AA39", place / "AA39")
    shutil.copy(SAMPLE / "tower-measurements.json", place)
    return place


def joint_angle(actuator, counts):
    """Angle of a joint: where a head on a circle about the joint is one stroke away from the foot, by a root finder."""
    foot, radius = np.array([actuator["offset"], 0.0]), actuator["pivot_radius"]

    def opening(stroke):
        def miss(angle):
            return np.hypot(*(radius * np.array([np.cos(angle), np.sin(angle)]) - foot)) - stroke

        return brentq(miss, 0.0, np.pi, xtol=1e-15)

    first = actuator["initial_stroke_length"]
    turned = opening(first + counts / actuator["increment"]) - opening(first)
    return actuator["initial_angle"] + (-turned if actuator["clockwise_axis_movement"] else turned)


def measurements(name, evaluation):
    """Sun, joint angles, spot and pivot of each measurement, east, north and up of the plant, from the files."""
    tower = json.loads((SAMPLE / "tower-measurements.json").read_text())
    origin = tower["power_plant_properties"]["coordinates"]
    heliostat = json.loads((SAMPLE / name / "heliostat-properties.json").read_text())
    actuators = heliostat["kinematics_properties"]["actuators"]
    pivot = local_positions(heliostat["heliostat_position"], origin)
    for path in sorted((SAMPLE / name).glob("*-calibration-properties.json")):
        said = json.loads(path.read_text())
        motors = [said["motor_position"][f"axis_{axis}_motor_position"] for axis in (1, 2)]
        # From the south about the axis up, counterclockwise, then up from the horizon.
        place = Rotation.from_euler("ZX", [said["sun_azimuth"], -said["sun_elevation"]], degrees=True)
        angles = [joint_angle(*both) for both in zip(actuators, motors, strict=True)]
        yield place.apply([0.0, -1.0, 0.0]), angles, local_positions(said["focal_spot"][evaluation], origin), pivot


def misses(errors, seen, offset):
    """Measured minus predicted spots on the plane of each target: east and up; and the angle between the beams."""
    for sun, (first, second), spot, pivot in seen:
        turned = Rotation.from_euler(
            "XY", [first + errors[0], second + errors[1]]
        )  # about east, then about its own north
        normal = (Rotation.from_rotvec([0.0, errors[2], errors[3]]) * turned).apply([0.0, 0.0, 1.0])
        centre = pivot + offset * normal
        ray = 2 * (sun @ normal) * normal - sun
        way = spot - centre
        place = centre + (spot[1] - centre[1]) / ray[1] * ray
        yield (spot - place)[[0, 2]], np.arctan2(np.linalg.norm(np.cross(ray, way)), ray @ way)


def test_actuators_are_triangles():
    spots = read_paint_spots(SAMPLE, "multi_focus_tower")
    assert spots.columns["heliostat"].tolist() == ["AA31"] * 2 + ["AA39"] * 6
    seen = [*measurements("AA31", "UTIS"), *measurements("AA39", "UTIS")]
    first, second = np.degrees([angles for _, angles, _, _ in seen]).T
    np.testing.assert_allclose(spots.columns["azimuth"], -first, atol=1e-8)
    np.testing.assert_allclose(spots.columns["elevation"], second, atol=1e-8)
    for axis, name in enumerate(("sun_x", "sun_y", "sun_z")):
        np.testing.assert_allclose(spots.columns[name], [sun[axis] for sun, *_ in seen], atol=1e-9)
    assert spots.notes[-1] == "Omitted, because their actuators are not linear: AC43."
    # With the motor at its upper end the mirror stands upright, 90 deg, as the file says.
    data = json.loads((SAMPLE / "AA39" / "heliostat-properties.json").read_text())["kinematics_properties"]["actuators"]
    assert joint_angle(data[0], data[0]["max_increment"]) == pytest.approx(data[0]["max_movement_angle"], abs=0.03)


def test_the_shipped_study_is_the_fit_of_the_files(tmp_path):
    """Four errors take the residuals of AA39 from 28.8 to 2.6 mrad; so does SciPy on the planes of the targets."""
    result = api.build(api.load(STUDY)).compute()
    assert result["calibration_status"].to_numpy().ravel().tolist() == [0, 0]
    four = result.sel(parameters=4).isel(heliostat=0)
    assert str(four["id"].item()) == "AA39"
    seen = list(measurements("AA39", "UTIS"))

    def apart(errors):
        return np.concatenate([miss for miss, _ in misses(errors, seen, 0.2152)])

    def rms(errors):
        return 1e3 * np.sqrt(np.mean([angle**2 for _, angle in misses(errors, seen, 0.2152)]))

    found = least_squares(apart, np.zeros(4), x_scale=1e-2, xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    # In the frame of the mount, north, up and east, the first axis turns the other way round.
    first, second, about_north, about_up = 1e3 * found
    expected = [-first, second, about_north, about_up]
    np.testing.assert_allclose(four["estimated_error"][:4], expected, atol=0.06)  # two spots are moved by 0.5 m
    assert float(four["uncalibrated_beam_residual_rms"]) == pytest.approx(rms(np.zeros(4)), rel=5e-3)
    assert float(four["beam_residual_rms"]) == pytest.approx(rms(found), rel=5e-3)
    assert rms(np.zeros(4)) == pytest.approx(28.87, abs=0.01)
    assert rms(found) == pytest.approx(2.567, abs=0.001)
    assert float(result["beam_residual_rms"].sel(parameters=2).item()) == pytest.approx(10.85, abs=0.01)


@pytest.fixture
def plant(tmp_path):
    """The sample with all heliostats; AC43 has the parameters of linear actuators, which its file calls ideal."""
    place = tmp_path / "paint"
    shutil.copytree(SAMPLE, place)
    path = place / "AC43" / "heliostat-properties.json"
    path.write_text(path.read_text().replace('"type_axis": "ideal"', '"type_axis": "linear"'))
    return place


def test_a_folder_is_one_consistent_study(plant, tmp_path, monkeypatch, capsys):
    """Layout and spots count from the same target; the shipped tables of the plant are those of the command."""
    monkeypatch.chdir(tmp_path)
    assert main(["convert", "paint", "juelich.yaml", "--aim", "multi_focus_tower"]) == 0
    assert capsys.readouterr().out == "juelich.yaml\n"
    for name, shipped in (("layout", "layouts"), ("spots", "spots")):
        made = (tmp_path / f"juelich_{name}.csv").read_text(encoding="utf-8")
        assert made == (ROOT / "studies" / shipped / "juelich.csv").read_text(encoding="utf-8")
    study: Any = api.load("juelich.yaml")
    own = api.load(ROOT / "studies" / "calibration_plant.yaml")
    for block in ("site", "receiver", "mount"):
        assert getattr(study, block) == getattr(own, block)
    assert study.calibration.parameters == 2  # two spots do not give four errors with a standard error
    result = api.build(study).compute()
    assert result["calibration_status"].to_numpy().tolist() == [0, 0, 0]
    with pytest.raises(StudyError, match="exists"):
        write_paint_study(read_paint_spots(plant, "multi_focus_tower"), "juelich.yaml")


def test_held_out_spots_of_the_plant():
    """As docs/families/misalignment.md states them."""
    result = api.build(api.load(ROOT / "studies" / "calibration_plant.yaml")).compute()
    assert result["id"].to_numpy().tolist() == ["AA31", "AA39", "AC43"]
    before, after = result["uncalibrated_held_out_residual_rms"], result["held_out_residual_rms"]
    np.testing.assert_allclose(before.sel(parameters=2), [18.8, 27.8, 34.3], atol=0.05)
    np.testing.assert_allclose(after.sel(parameters=2), [16.9, 13.3, 23.9], atol=0.05)
    np.testing.assert_allclose(after.sel(parameters=4), [np.nan, 2.1, np.nan], atol=0.05)
    seen = list(measurements("AA39", "UTIS"))[-1:]  # the held-out spot of a mount without errors, by rotation matrices
    assert before[0, 1] == pytest.approx(1e3 * next(angle for _, angle in misses(np.zeros(4), seen, 0.2152)), rel=2e-3)


def test_corrections_are_in_degrees_and_steps(plant, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["convert", "paint", "juelich.yaml", "--aim", "multi_focus_tower"]) == 0
    assert main(["run", "juelich.yaml", "-o", "out", "--no-report"]) == 0
    assert main(["convert", "out", "corrections.csv", "--to", "corrections"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "corrections.csv"
    table = pd.read_csv("corrections.csv", comment="#").set_index("heliostat")
    assert table.index.tolist() == ["AA31", "AA39", "AC43"]
    result = api.open_result("out")
    error = np.degrees(1e-3 * result["estimated_error"][:, :2].to_numpy())
    np.testing.assert_allclose(table[["azimuth_reference [deg]", "elevation_reference [deg]"]], error, atol=6e-6)
    # Steps that turn the joints by the errors from the mean positions of the motors, by a root finder.
    data = json.loads((SAMPLE / "AA39" / "heliostat-properties.json").read_text())["kinematics_properties"]["actuators"]
    positions = [json.loads(path.read_text())["motor_position"] for path in (SAMPLE / "AA39").glob("*-calibration-*")]
    for axis, (name, sign) in enumerate((("azimuth", -1.0), ("elevation", 1.0))):
        mean = np.mean([position[f"axis_{axis + 1}_motor_position"] for position in positions])
        steps = table.loc["AA39", f"{name}_reference [steps]"]
        turned = joint_angle(data[axis], mean + steps) - joint_angle(data[axis], mean)
        assert sign * np.degrees(turned) == pytest.approx(table.loc["AA39", f"{name}_reference [deg]"], rel=0.02)
    assert table.loc["AA39", "status"] == "estimated"
    assert table.loc["AA39", "beam_residual_rms [mrad]"] == pytest.approx(10.85, abs=0.01)
    with pytest.raises(StudyError, match="choose one value of parameters"):
        write_corrections(api.build(api.load(STUDY)).compute(), "two.csv")
    with pytest.raises(StudyError, match="is not a calibration"):
        write_corrections(result.drop_vars("estimated_error"), "none.csv")


@pytest.mark.parametrize(
    ("name", "keys", "value", "said"),
    [
        (SPOT, ("motor_position", "axis_1_motor_position"), 900_000,
         f"{SPOT}:3:30: motor_position.axis_1_motor_position: corresponds to a stroke at which the actuator"),
        (SPOT, ("focal_spot",), {}, "focal_spot: has no 'UTIS'"),
        (SPOT, ("sun_elevation",), "high", "sun_elevation: must be an angle in deg"),
        (PROPERTIES, (*ACTUATOR, "offset"), 2.0,
         "actuators[0]: initial_stroke_length, offset and pivot_radius do not form a triangle"),
        (PROPERTIES, (*ACTUATOR, "type_axis"), "ideal", "the actuators of AA39 are not linear"),
    ],
)  # fmt: skip
def test_bad_files_are_told_at_their_lines(folder, name, keys, value, said):
    change(folder / name, *keys, to=value)
    with pytest.raises(StudyError) as caught:
        read_paint_spots(folder, "multi_focus_tower")
    assert said in str(caught.value)


def test_an_unknown_evaluation():
    with pytest.raises(StudyError, match="unknown evaluation 'eye'; use UTIS or HeliOS"):
        read_paint_spots(SAMPLE, "receiver", "eye")


# Middles of the spots of the files, from their latitudes and longitudes, moved along their beams (bug report).
AA39_SPOTS = [(0.0359, -1.2700), (-18.162, -17.067), (-0.4686, -0.6480)]


@pytest.mark.parametrize(
    "form",
    [
        "AA39-calibration-properties_{}.json", "AA39-{}-calibration-properties.json", "{}-calibration-properties.json",
        "AA39/Calibration/{}-calibration-properties.json",
    ],
)  # fmt: skip
def test_one_folder_and_the_names_of_artist(tmp_path, form):
    shutil.copy(SAMPLE / "tower-measurements.json", tmp_path)
    shutil.copy(SAMPLE / "AA39" / "heliostat-properties.json", tmp_path / "AA39-heliostat-properties.json")
    (tmp_path / "AA39" / "Calibration").mkdir(parents=True)
    for number in (1, 2, 3):
        shutil.copy(SAMPLE / "AA39" / f"test_{number}-calibration-properties.json", tmp_path / form.format(number))
    spots = read_paint_spots(tmp_path, "multi_focus_tower").columns
    np.testing.assert_allclose(np.column_stack((spots["y"][:3], spots["z"][:3])), AA39_SPOTS, atol=5e-4)
    assert set(spots["heliostat"]) == {"AA39"}
