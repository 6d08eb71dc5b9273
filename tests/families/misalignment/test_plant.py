"""Calibration of a plant: intervals, held-out spots, drift in windows, campaigns, and tables of camera systems."""

from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import t as student

import heliosweep
from heliosweep import api
from heliosweep.errors import StudyError
from heliosweep.families.misalignment.report import remarks
from heliosweep.sun import sun_vectors
from tests.conftest import STUDIES

COUNT, AIM, NOISE = 100, 120.0, 0.03
SITE = {"latitude": 37.0, "longitude": -3.0, "altitude": 500}
RNG = np.random.default_rng(43)
PIVOTS = np.stack((RNG.uniform(-150, 150, COUNT), RNG.uniform(80, 300, COUNT), np.full(COUNT, 4.0)), axis=1)
TRUTH = RNG.normal(0.0, 1.5, (COUNT, 4))
NAMES = [f"H{number:03d}" for number in range(COUNT)]


def times_of(days: Any, hours: Any) -> np.ndarray:
    """Universal times of hours of days of 2024."""
    start = np.datetime64("2024-04-01", "ns")
    return np.array([start + np.timedelta64(day, "D") + np.timedelta64(round(60 * hour), "m")
                     for day in days for hour in hours])  # fmt: skip


def spots(times: np.ndarray, errors: np.ndarray, seed: int = 1, noise: float = NOISE) -> pd.DataFrame:
    """Measured spots with noise; `errors` of shape (heliostats, 4) or (times, heliostats, 4) in mrad."""
    sun = sun_vectors(times, SITE["latitude"], SITE["longitude"], SITE["altitude"])
    azimuth, elevation = np.degrees(np.arctan2(sun[:, 0], sun[:, 1])), np.degrees(np.arcsin(sun[:, 2]))
    errors = np.broadcast_to(errors, (len(times), *errors.shape[-2:]))
    rows = []
    for row, (time, east, up) in enumerate(zip(times, azimuth, elevation, strict=True)):
        made = heliosweep.mount_spots(east, up, PIVOTS, AIM, errors=errors[row])
        rows.append(pd.DataFrame({
            "heliostat": NAMES, "time": f"{np.datetime_as_string(time, 's')}Z",
            "y": made.spot_y.to_numpy(), "z": made.spot_z.to_numpy(),
        }))  # fmt: skip
    table = pd.concat(rows, ignore_index=True)
    table[["y", "z"]] += np.random.default_rng(seed).normal(0.0, noise, (len(table), 2))
    return table


@pytest.fixture
def plant(tmp_path):
    """Study of the plant from tables of spots; keyword arguments are keys of `calibration`."""
    columns = dict(zip("xyz", PIVOTS.T, strict=True))
    pd.DataFrame({"name": NAMES, **columns}).to_csv(tmp_path / "field.csv", index=False)

    def make(table: Any, **calibration: Any) -> Any:
        tables = table if isinstance(table, dict) else {"spots.csv": table}
        for name, each in tables.items():
            (tmp_path / name).parent.mkdir(exist_ok=True)
            each.to_csv(tmp_path / name, index=False)
        names = [str(tmp_path / name) for name in tables]
        return api.load({
            "family": "misalignment", "mode": "calibration", "site": SITE,
            "time": {"clock": "solar", "days": [80], "hours": [12]},
            "receiver": {"height": AIM, "azimuth": 0, "tilt": 0, "width": 10, "height_extent": 10},
            "layout": {"file": str(tmp_path / "field.csv")}, "heliostats": {"pivot_height": 0},
            "calibration": {"spots": names if len(names) > 1 else names[0], **calibration},
        })  # fmt: skip

    return make


def test_intervals_of_a_plant_hold_the_truth_and_held_out_spots_the_noise(plant):
    times = times_of((0, 7, 20, 40), (8, 10.5, 13, 16))
    result = api.build(plant(spots(times, TRUTH), held_out=4)).compute()
    error, spread = result["estimated_error"][:, :4].to_numpy(), result["standard_error"][:, :4].to_numpy()
    inside = np.abs(error - TRUTH) <= student.ppf(0.975, 2 * 12 - 4) * spread
    assert 0.92 <= inside.mean() <= 0.98
    assert (result["spots_used"] == 12).all()
    assert (result["held_out_spots"] == 4).all()
    last = np.sort(result["spot_time"].to_numpy(), axis=1)[:, -4:].min(axis=1)
    np.testing.assert_array_equal(result["held_out"], result["spot_time"].to_numpy() >= last[:, np.newaxis])
    # Noise of both coordinates seen from the pivot, and a little from the errors that the estimates have.
    way = PIVOTS - (0.0, 0.0, AIM)
    away = np.linalg.norm(way, axis=1)
    noise = 1e3 * NOISE * np.sqrt(2.0 - (way[:, [0, 2]] ** 2).sum(axis=1) / away**2) / away
    ratio = result["held_out_residual_rms"].to_numpy() / noise
    assert 1.0 < np.sqrt(np.mean(ratio**2)) < 1.3
    assert np.median(result["uncalibrated_held_out_residual_rms"]) > 10 * np.median(result["held_out_residual_rms"])


def test_a_drift_of_a_milliradian_a_month_is_found_within_two_windows(plant):
    times = times_of(range(0, 150, 6), (8, 11, 14, 16.5))
    months = (times - times[0]) / np.timedelta64(30, "D")
    errors = np.broadcast_to(TRUTH, (len(times), *TRUTH.shape)).copy()
    errors[:, :20, 0] += months[:, np.newaxis]  # azimuth references of twenty heliostats
    result = api.build(plant(spots(times, errors), window="30 days")).compute()
    assert result.sizes["period"] == 5
    assert str(result["period"].to_numpy()[1])[:10] == "2024-05-01"
    drift = result["drift"].to_numpy()[..., :4]
    assert (drift[:, 0] == -1).all()
    assert (drift[:20, 2:, 0] == 1).all()  # within two windows after the first
    others = np.concatenate((drift[20:, 1:].ravel(), drift[:20, 1:, 1:].ravel()))  # errors without drift
    assert (others == 1).mean() < 0.01
    assert (others >= 0).all()
    changes = result["period_change"].to_numpy()[:20, -1, 0]
    np.testing.assert_allclose(changes, 4.0, atol=0.3)
    moving = api.build(plant(spots(times, errors), window="30 d", window_step="15 d")).compute()
    assert moving.sizes["period"] == 9
    np.testing.assert_array_equal(moving["period_error"][:, ::2], result["period_error"])


def test_campaigns_are_a_dimension(plant):
    days = {"june.csv": (60, 61), "september.csv": (150, 152)}
    moved = TRUTH + np.array([0.0, 0.8, 0.0, 0.0])
    tables = {
        name: spots(times_of(when, (8, 10, 12, 14, 16)), errors, seed)
        for seed, ((name, when), errors) in enumerate(zip(days.items(), (TRUTH, moved), strict=True))
    }
    tables["june.csv"] = tables["june.csv"][:900]  # fewer spots than the other
    result = api.build(plant(tables)).compute()
    assert result["estimated_error"].dims == ("campaign", "heliostat", "parameter")
    assert result["campaign"].to_numpy().tolist() == ["june.csv", "september.csv"]
    assert result.sizes["spot"] == 10
    assert result["spots_used"].to_numpy().min(axis=1).tolist() == [9, 10]
    change = result["estimated_error"].diff("campaign")[0, :, 1].to_numpy()
    np.testing.assert_allclose(np.median(change), 0.8, atol=0.05)
    changes = heliosweep.error_changes(
        result.estimated_error, result.standard_error, 2 * result.spots_used - 4, dim="campaign"
    )
    assert changes.changed.dims == result.estimated_error.dims
    assert float((changes.changed.isel(campaign=1, parameter=1) == 1).mean()) > 0.9
    assert float((changes.changed.isel(campaign=1, parameter=[0, 2, 3]) == 1).mean()) < 0.01


def test_a_table_of_a_camera_system(plant):
    """Titles and pixels of its own, further columns, and local times over the end of summer time."""
    times = times_of((205, 208, 211), (9, 10, 11, 13, 15))  # 23, 26 and 29 October: CEST, CEST, CET
    table = spots(times, TRUTH)
    plain = api.build(plant(table)).compute()
    local = pd.to_datetime(table["time"], utc=True).dt.tz_convert("Europe/Madrid")
    camera = pd.DataFrame({
        "Heliostato": table["heliostat"], "Hora": local.dt.strftime("%d.%m.%Y %H:%M:%S"),
        "dx_px": (table["y"] + 6.0) / 0.012, "y": -table["z"] / 0.012, "exposure": 3,
    })  # fmt: skip
    columns = {
        "heliostat": "Heliostato", "time": "Hora", "y": {"from": "dx_px", "scale": 0.012, "offset": -6.0},
        "z": {"from": "y", "scale": -0.012},
    }  # fmt: skip
    study = plant(camera, columns=columns, timezone="Europe/Madrid")
    assert any("ignored columns: exposure" in note for note in study.notes())
    result = api.build(study).compute()
    np.testing.assert_allclose(result["estimated_error"], plain["estimated_error"], atol=1e-9)
    np.testing.assert_array_equal(result["spot_time"], plain["spot_time"])
    again = api.load(study.resolved())
    assert again.study_id == study.study_id


def test_spots_are_held_out_by_name(plant):
    table = spots(times_of((0, 30), (8, 11, 14)), TRUTH)
    table["spot"] = np.repeat([f"s{number}" for number in range(6)], COUNT)
    result = api.build(plant(table, held_out=["s1", "s4"])).compute()
    assert result["held_out"].to_numpy().tolist() == [[0, 1, 0, 0, 1, 0]] * COUNT
    assert (result["spots_used"] == 4).all()
    with pytest.raises(StudyError, match=r"calibration\.held_out: no spot s9 in the column 'spot' of .*spots\.csv"):
        plant(table, held_out=["s1", "s9"])
    other = table.assign(spot=table["spot"].str.replace("s", "t"))  # each campaign has spots of its own
    with pytest.raises(StudyError, match=r"calibration\.spots: files have the same name, .*: rename one"):
        plant({"spots.csv": table, "again/spots.csv": table})
    both = plant({"june.csv": table, "july.csv": other}, held_out=["s1", "t4", "t5"])
    held = api.build(both).compute()["held_out_spots"]
    assert held.sel(campaign="june.csv").to_numpy().tolist() == [1] * COUNT
    assert held.sel(campaign="july.csv").to_numpy().tolist() == [2] * COUNT


def test_the_shipped_table_of_a_camera_system_shows_the_drift_of_its_header():
    """Errors of spots/camera.csv, made with `mount_spots`: B1 drifts by 1 mrad each 30 days from 4 March."""
    result = api.build(api.load(STUDIES / "calibration_drift.yaml")).compute()
    assert result["name"].to_numpy().tolist() == ["A1", "A2", "B1", "B2"]
    truth = np.array([[1.2, -0.6, 0.4, 0.2], [-0.8, 1.5, -0.3, 0.6], [0.5, 0.9, 0.8, -0.4], [-1.4, -0.7, 0.1, 0.9]])
    truth = np.repeat(truth[:, np.newaxis], 4, axis=1)
    truth[2, :, 0] += np.arange(4) + 13.5 / 30.0  # mean day of the spots of each window
    found, spread = (result[f"period_{name}error"][..., :4].to_numpy() for name in ("", "standard_"))
    assert (np.abs(found - truth) < 4.0 * spread).all()
    assert np.argwhere(result["drift"].to_numpy() == 1).tolist() == [[2, 1, 0], [2, 2, 0], [2, 3, 0]]
    assert int(np.argmax(result["held_out_residual_rms"].to_numpy())) == 2


def test_warnings_name_the_campaign(plant):
    """A mirrored table, and a spot that disagrees, are found in any of several campaigns."""
    tables = {f"{name}.csv": spots(times_of((0, 9), (8, 10, 12, 14, 16)), TRUTH, k) for k, name in enumerate("abc")}
    tables["b.csv"]["z"] *= -1.0
    tables["c.csv"]["y"] += 2.0 * (np.arange(len(tables["c.csv"])) == 7)  # of H007
    study = plant(tables)
    result = api.build(study).compute()
    found = list(remarks(result))
    assert any(words.startswith("b.csv: the spots of ") and "mirrored" in words for words in found)
    assert any(words.startswith("c.csv: 1 spots of 1 heliostats") and "H007 2024-04-01" in words for words in found)
    assert not any("mirrored" in words for words in found if not words.startswith("b.csv"))
