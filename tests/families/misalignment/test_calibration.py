"""Mode calibration: what comes out of studies with synthetic and with measured spots, cut in every way."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from heliosweep.families.misalignment.calibration import DISAGREE, DOUBTFUL
from heliosweep.families.misalignment.report import remarks
from heliosweep.kernels.calibration import ESTIMATED, EXACT, INDISTINCT, NO_OBSERVATIONS, TOO_FEW
from tests.conftest import shipped

from . import studies
from .mount_twin import Twin, solar_vector
from .studies import computed

POSITIONS = studies.CALIBRATION["heliostats"]["positions"]
DAYS, HOURS = studies.CALIBRATION["time"]["days"], studies.CALIBRATION["time"]["hours"]
TRUE = studies.CALIBRATION["mount_errors"]


def study(calibration: dict[str, Any] | None, **changes: Any) -> Any:
    return studies.study(studies.CALIBRATION, calibration=calibration, **changes)


@pytest.mark.parametrize("kind", ["azimuth_elevation", "target_aligned", "polar", "tilt_roll"])
def test_clean_spots_give_the_truth_and_commands_that_hit(kind):
    mount = {"kind": kind, "mirror_offset": 0.5, "axis_offset": 0.2, "pedestal_height": 4, "axis_azimuth": 20}
    result = computed(study({"parameters": 6}, mount=mount))
    assert (result.calibration_status == ESTIMATED).all()
    assert (result.spots_used == 27).all()
    assert float(np.abs(result.estimated_error - result.true_error).max()) < 1e-9
    assert np.array_equal(result.true_error[0], list(TRUE.values()))
    assert float(np.abs(result.residual_y).max()) < 1e-10
    assert float(np.abs(result.spot_y_before).min("heliostat").max()) > 0.05
    for side in "yz":
        assert float(np.abs(result[f"spot_{side}_after"]).max()) < 1e-9


def test_swept_parameters_days_and_losses():
    # A draw that leaves out the errors that four parameters do not know.
    result = computed(
        study(
            {"parameters": [2, 4, 6], "days_used": [1, 3], "noise": 0.01, "loss": ["squared", "cauchy"]},
            mount_errors={**TRUE, "non_orthogonality": 0, "collimation": 0, "seed": 3},
        )
    )
    assert result.estimated_error.dims == ("parameters", "days_used", "loss", "heliostat", "parameter")
    known = np.isfinite(result.estimated_error).all(["days_used", "loss", "heliostat"]).sum("parameter")
    assert known.to_numpy().tolist() == [2, 4, 6]
    used = result.isel(parameters=1, loss=0)
    assert used.spots_used.to_numpy().tolist() == [[9] * 3, [27] * 3]
    assert np.isfinite(used.residual_y).all("hour").all("heliostat").to_numpy().tolist() == [
        [True, False, False],
        [True, True, True],
    ]
    assert (used.standard_error.isel(days_used=1) < used.standard_error.isel(days_used=0))[:, :4].all()
    six = result.sel(parameters=6).isel(loss=0)
    assert (six.condition_number.isel(days_used=0) > 4 * six.condition_number.isel(days_used=1)).all()
    variances = np.diagonal(six.covariance, axis1=-2, axis2=-1)
    np.testing.assert_allclose(np.sqrt(variances), six.standard_error, rtol=1e-12)
    four = result.sel(parameters=4).isel(days_used=1)
    assert float(np.abs(four.estimated_error - four.true_error)[..., :4].max()) < 0.2
    # Without the tilts two parameters fit badly, with four the noise remains.
    assert (result.residual_rms.sel(parameters=2) > 3 * result.residual_rms.sel(parameters=4)).isel(days_used=1).all()
    np.testing.assert_allclose(four.residual_rms, 0.01, rtol=0.35)


def test_remarks_of_what_spots_cannot_tell():
    one = computed(study({"parameters": [4, 6], "days_used": 1, "noise": 0.001}))
    assert (one.calibration_status.sel(parameters=6).to_numpy() == [INDISTINCT, ESTIMATED, INDISTINCT]).all()
    (said,) = remarks(one)
    assert said.startswith("2 of 6 calibrations have a condition number above 1000 (up to 17")
    assert "least of all collimation" in said
    instant = {"clock": "solar", "days": [81], "hours": [12]}
    none = computed(study({"parameters": 6, "noise": 0.001}, time=instant))
    assert (none.calibration_status == TOO_FEW).all()
    again = computed(study({"parameters": 2, "noise": 0.001}, time=instant))
    assert (again.calibration_status == EXACT).all()
    assert np.isfinite(again.corrected_azimuth).all()
    assert np.isnan(again.standard_error).all()
    (said,) = remarks(again)
    assert said.startswith("3 of 3 calibrations have no standard errors")


def test_instants_without_a_command_are_counted():
    # Near the tower mirrors look up around noon, where a mount with a large collimation cannot point.
    noon = {"clock": "solar", "days": [81, 172], "hours": [6.5, *np.arange(9.0, 16.0, 0.25).tolist(), 23.0]}
    made = study(
        {"parameters": 6}, heliostats={"positions": [[0.0, 20.0, 0.0]]}, time=noon, mount={"mirror_offset": 0.5},
        mount_errors={**TRUE, "collimation": 300.0, "non_orthogonality": 0.0},
    )  # fmt: skip
    result = computed(made)
    assert result.calibration_status[0] in (ESTIMATED, INDISTINCT)
    sun = np.isfinite(result.nominal_azimuth).any("heliostat")
    lost = np.isnan(result.corrected_azimuth) & sun
    assert not sun.isel(hour=-1).any()
    assert (result.instants_without_command == lost.sum(["day", "hour"])).all()
    assert result.instants_without_command[0] > 0
    (said,) = (said for said in remarks(result) if "no command" in said)
    assert said.startswith(f"at {int(lost.sum())} of 60 instants of calibrated heliostats")


# Measured spots.

HEADER = "heliostat,y,z,sun_x,sun_y,sun_z"


def table(folder: Path, rows: list[str], header: str = HEADER) -> str:
    path = folder / "spots.csv"
    path.write_text("\n".join([header, *rows, ""]), encoding="utf-8")
    return str(path)


def spot_rows(heliostat: int, days: Any = (81, 172), hours: Any = HOURS, angles: bool = False) -> list[str]:
    """Rows of clean spots by the second model, with the suns of the solar clock."""
    x, y, z = POSITIONS[heliostat]
    twin = Twin((x, y, z), 143.0, offsets=(0.5, 0.2, 4.0), latitude=37.4)
    rows = []
    for day in days:
        for hour in hours:
            sun = solar_vector(37.4, day, hour)
            command = twin.aim(sun) + (np.array([2e-3, -1e-3]) if angles else 0.0)
            spot = twin.spots(*twin.mirror(command, np.array([*TRUE.values()]) * 1e-3), sun)[0][0]
            numbers = [*spot, *sun, *(np.degrees(command) if angles else ())]
            rows.append(",".join([str(heliostat), *map(repr, map(float, numbers))]))
    return rows


def measured(folder: Path, rows: list[str], header: str = HEADER, **options: Any) -> Any:
    return study(
        {"parameters": 6, **options, "spots": table(folder, rows, header)},
        mount_errors=None,
        time={"clock": "solar", "days": [200], "hours": [9, 12]},
    )


def test_measured_spots_give_the_truth(tmp_path):
    rows = [*spot_rows(2), *spot_rows(0, days=DAYS)]
    result = computed(measured(tmp_path, rows))
    assert result.calibration_status.to_numpy().tolist() == [ESTIMATED, NO_OBSERVATIONS, ESTIMATED]
    assert result.spots_used.to_numpy().tolist() == [27, 0, 18]
    truth = np.array([*TRUE.values()])
    np.testing.assert_allclose(result.estimated_error[[0, 2]], np.stack([truth, truth]), rtol=0, atol=1e-8)
    assert result.sizes["spot"] == 27
    assert np.isfinite(result.residual_y).sum("spot").to_numpy().tolist() == [27, 0, 18]
    first = float(rows[18].split(",")[1])
    assert float(result.spot_y_before[0, 0]) == first  # in the order of the file
    twin = Twin((-16.0, 150.0, 0.0), 143.0, offsets=(0.5, 0.2, 4.0), latitude=37.4)
    sun = solar_vector(37.4, 200, 12)
    one = result.isel(heliostat=0, day=0, hour=1)
    command = np.radians([one.corrected_azimuth, one.corrected_elevation])
    np.testing.assert_allclose(twin.spots(*twin.mirror(command, truth * 1e-3), sun)[0][0], 0.0, atol=1e-8)
    assert np.isnan(result.corrected_azimuth[1]).all()


def test_times_give_the_sun_of_the_site():
    result = shipped("calibration_measured")
    truth = np.array(
        [[1.8, -0.9, 0.6, -0.4], [-2.1, 0.7, -0.8, 0.5], [0.9, 1.6, 0.3, 0.9], [-0.6, -1.4, 1.1, -0.2]]
    )  # as the table says
    for loss in ("huber", "cauchy"):
        found = result.sel(loss=loss)
        away = np.abs(found.estimated_error[:, :4] - truth) / found.standard_error[:, :4]
        assert float(away.max()) < 3.5
    assert float(np.abs(result.sel(loss="squared").estimated_error[:, :4] - truth).max()) > 0.5  # outliers
    assert result.name.to_numpy().tolist() == ["A1", "A2", "B1", "B2"]


def test_a_calibration_doubts_itself(tmp_path):
    """Errors that no mount has, or spots that it does not send there, are a status and a warning with the heliostat."""
    header = f"{HEADER},azimuth,elevation"
    angles = spot_rows(0, days=DAYS, angles=True)
    centimetres = [",".join([n, *(str(1e2 * float(at)) for at in place), rest]) for n, *place, rest in
                   (row.split(",", 3) for row in spot_rows(2, days=DAYS, angles=True))]  # fmt: skip
    far = [",".join([*row.split(",")[:-1], str(float(row.split(",")[-1]) + 4.0)]) for row in
           spot_rows(1, days=DAYS, angles=True)]  # fmt: skip
    result = computed(measured(tmp_path, [*angles, *far, *centimetres], header))
    assert result.calibration_status.to_numpy().tolist() == [ESTIMATED, DOUBTFUL, DOUBTFUL]
    assert float(result.estimated_error[1, 1]) < -50  # an encoder that reads 4 deg too much
    said = " ".join(remarks(result))
    assert "heliostat 1, 2: the calibration is doubtful. An error exceeds 50 mrad, or a spot lies more than 3" in said
    assert np.isfinite(result.corrected_azimuth[1]).all()


def test_commanded_angles_count_spots_from_where_they_send_the_beam(tmp_path):
    """Before the calibration: the twin's spot of a mount without errors at the same angles."""
    rows = spot_rows(0, days=DAYS, angles=True)
    result = computed(measured(tmp_path, rows, f"{HEADER},azimuth,elevation"))
    twin = Twin((-16.0, 150.0, 0.0), 143.0, offsets=(0.5, 0.2, 4.0), latitude=37.4)
    angles = []
    for index, row in enumerate(rows):
        place, sun, command = (
            np.array(row.split(",")[part], float) for part in (slice(1, 3), slice(3, 6), slice(6, 8))
        )
        sent = twin.spots(*twin.mirror(np.radians(command), np.zeros(6)), sun)[0][0]
        before = np.array([result.spot_y_before[0, index], result.spot_z_before[0, index]])
        np.testing.assert_allclose(before, place - sent, atol=1e-7)
        seen, aimed = (twin.target + spot @ twin.axes[1:] - twin.pivot for spot in (place, sent))
        angles.append(np.arctan2(np.linalg.norm(np.cross(seen, aimed)), seen @ aimed))
    rms = 1e3 * np.sqrt(np.mean(np.square(angles)))
    assert float(result.uncalibrated_beam_residual_rms[0]) == pytest.approx(rms, rel=1e-6)
    assert float(result.beam_residual_rms[0]) < 1e-6


def noisy(heliostat: int, signs: tuple[int, int] = (1, 1), late: float = 0.0, **changes: Any) -> list[str]:
    """Rows of spots with 3 cm of noise, perhaps mirrored, or with the suns of other hours than those of the spots."""
    noise, rows = np.random.default_rng(heliostat), []
    hours = [8, 9, 10, 11, 13, 14, 15, 16]
    for row, sunned in zip(
        spot_rows(heliostat, hours=hours, **changes),
        spot_rows(heliostat, hours=[hour + late for hour in hours], **changes),
        strict=True,
    ):
        number, y, z, _, _, _, *angles = row.split(",")
        place = np.array([float(y), float(z)]) * signs + noise.normal(0, 0.03, 2)
        rows.append(",".join([number, *map(repr, map(float, place)), *sunned.split(",")[3:6], *angles]))
    return rows


def test_spots_that_disagree_are_flagged_with_their_heliostat_and_robust_losses_bear_them(tmp_path):
    """Two spots of 16 are 2.9 m off: least squares is wrong by more than a milliradian, and says so."""
    rows = [*noisy(0), *noisy(1), *noisy(2)]
    for bad in (16 + 0, 16 + 1):
        number, y, z, rest = rows[bad].split(",", 3)
        rows[bad] = f"{number},{y},{float(z) + 2.9},{rest}"
    result = computed(measured(tmp_path, rows, parameters=4, loss=["squared", "huber"], loss_scale=0.06))
    status = result.calibration_status.transpose("loss", "heliostat").to_numpy().tolist()
    assert status == [[ESTIMATED, DISAGREE, ESTIMATED], [ESTIMATED] * 3]
    for loss in ("squared", "huber"):
        flagged = np.argwhere((result.spot_deviation.sel(loss=loss) > 5).transpose("heliostat", "spot").to_numpy())
        assert flagged.tolist() == [[1, 0], [1, 1]]
    others = computed(measured(tmp_path, noisy(1)[2:], parameters=4)).estimated_error[1]
    squared, huber = (float(np.abs(result.estimated_error.sel(loss=loss)[1] - others).max()) for loss in result.loss)
    assert squared > 1.0
    assert huber < 0.1
    said = " ".join(remarks(result))
    assert "2 spots of 1 heliostats are more than 5 robust standard deviations from the prediction by the other" in said
    assert "'calibration.loss: huber'" in said
    assert "'calibration.loss: huber'" not in " ".join(remarks(result.sel(loss=["huber"])))


@pytest.mark.parametrize(
    ("changes", "reading", "words"),
    [
        ({"signs": (-1, 1)}, 1, "mirrored: y is positive to the right"),
        ({"signs": (1, -1)}, 1, "mirrored: y is positive to the right"),
        ({"late": 1.0, "angles": True}, 2, "an hour earlier: check the offset from universal time"),
        ({"late": -1.0, "angles": True}, 3, "an hour later: check the offset from universal time"),
        ({"angles": True}, 0, ""),
    ],
)
def test_a_table_that_fits_much_better_in_another_reading_is_a_warning(tmp_path, changes, reading, words):
    header = f"{HEADER},azimuth,elevation" if "angles" in changes else HEADER
    rows = [row for heliostat in range(3) for row in noisy(heliostat, **changes)]
    result = computed(measured(tmp_path, rows, header, parameters=4))
    assert result.better_reading.to_numpy().tolist() == [reading] * 3
    said = " ".join(remarks(result))
    assert (words in said) if words else not said
