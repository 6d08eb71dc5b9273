"""Energy on the receiver: against sums over the hours, in closed form, by stages and months; the design point."""

from pathlib import Path
from typing import Any

import numpy as np
import pvlib
import pytest
import xarray as xr

from heliosweep import api
from heliosweep.errors import StudyError
from heliosweep.kernels.sun import declination_cooper, solar_clock
from tests.families.studies import computed

TMY3 = Path(pvlib.__file__).parent / "data" / "723170TYA.CSV"
BLOCKS: dict[str, Any] = {
    "site": {"file": str(TMY3)}, "time": {"clock": "weather"}, "weather": {"file": str(TMY3)},
    "layout": {"radial_stagger": {"clearance": 13, "inner_radius": 25, "heliostats": 20}},
    "heliostat": {"width": 9, "height": 8, "pivot_height": 5, "focus": "slant"},
    "receiver": {"kind": "cylinder", "height": 30, "radius": 1, "height_extent": 3},
    "optics": {
        "sun_shape": {"kind": "pillbox"}, "slope_error": 2, "reflectivity": 0.9, "cleanliness": 0.95,
        "attenuation": "delsol_clear", "rays": 16,
    },
}  # fmt: skip
PLAIN = {"optics": None, "receiver": {"height": 30}, "heliostat": {"width": 9, "height": 8, "pivot_height": 5}}
LIMITS = {"dni": 200, "sun_elevation": 8, "wind_speed": 9}


@pytest.fixture(scope="session")
def year(small):
    def make(**blocks: Any) -> Any:
        return small(**{**BLOCKS, **blocks})

    return make


@pytest.fixture(scope="module")
def hourly(year) -> xr.Dataset:
    return computed(year(output={"time_series": True}, tracking="azimuth_elevation"))


@pytest.fixture(scope="module")
def limited(year) -> xr.Dataset:
    return computed(year(limits=LIMITS, tracking="azimuth_elevation"))


@pytest.mark.long
def test_standard_errors_of_energies_cover_the_differences_between_seeds(year):
    """Two standard errors hold 95 % of months, losses and powers."""

    def made(**optics: Any) -> xr.Dataset:
        blocks = {"optics": {**BLOCKS["optics"], **optics}, "output": {"field_series": True}}
        return computed(year(limits={"dni": 600}, tracking="azimuth_elevation", **blocks))

    exact, several = made(rays=512, seed=99), [made(seed=seed) for seed in range(10)]
    names = ("heliostat_monthly_receiver_energy", "monthly_receiver_energy", "heliostat_loss", "loss", "field_power",
             "receiver_energy", "shading_efficiency", "blocking_efficiency")  # fmt: skip
    for name in names:
        error = np.array([one[f"{name}_error"] for one in several])
        off = np.array([one[name] - exact[name] for one in several])[error > 1e-12] / error[error > 1e-12]
        assert off.size >= 50
        assert np.mean(np.abs(off) < 2) > 0.91, name
        assert np.sqrt(np.median(off**2)) > 0.25, name
    for one in (exact, *several):
        assert float(one["loss_error"].sel(stage=["stow", "cosine"]).max()) < 1e-12


def test_energies_are_sums_over_the_hours(hourly, limited):
    """All from the efficiencies of the hours, the irradiance of the file and limits that are written out here."""
    file, _ = pvlib.iotools.read_tmy3(TMY3, map_variables=True)
    up = hourly["sun_elevation"].notnull().to_numpy()
    dni, wind = np.where(up, file["dni"], 0.0), file["wind_speed"].to_numpy()
    np.testing.assert_array_equal(hourly["dni"], dni)
    tests = np.stack((dni < 200, hourly["sun_elevation"] < 8, wind > 9)) & up
    works = up & ~tests.any(axis=0)
    first = np.stack((tests[0], tests[1] & ~tests[0], tests[2] & ~tests[0] & ~tests[1]))
    assert limited["hours_lost"].values.tolist() == first.sum(axis=1).tolist()
    assert first.any(axis=1).all()
    assert float(limited["hours_used"]) == works.sum()
    area, weight = 72.0, 1e-6 * dni * works
    values = {name: hourly[f"instantaneous_{name}_efficiency"].fillna(0).to_numpy() for name in
              ("cosine", "shading", "blocking", "optical", "intercept")}  # fmt: skip
    passed = limited["attenuation_efficiency"].to_numpy()
    received = values["optical"] * 0.9 * 0.95 * passed * values["intercept"]
    np.testing.assert_allclose(limited["receiver_energy"], area * weight @ received, rtol=1e-10)
    np.testing.assert_allclose(limited["incident_energy"], area * 1e-6 * dni.sum(), rtol=1e-10)
    values["intercept"] = np.nan_to_num(values["intercept"])
    sent = weight @ values["optical"]
    np.testing.assert_allclose(
        limited["intercept_efficiency"], weight @ (values["optical"] * values["intercept"]) / sent, rtol=1e-10
    )
    for name, each in values.items():
        if name == "intercept":
            continue
        np.testing.assert_allclose(limited[f"{name}_efficiency"], weight @ each / weight.sum(), rtol=1e-10)
    np.testing.assert_allclose(limited["total_efficiency"], weight @ received / weight.sum(), rtol=1e-10)
    assert np.all(limited["reflection_efficiency"] == 0.9 * 0.95)
    left = [
        np.ones_like(received) * 1e-6 * dni[:, np.newaxis],
        np.ones_like(received) * weight[:, np.newaxis],
        *(each * weight[:, np.newaxis] for each in (
            values["cosine"], values["cosine"] * values["shading"], values["optical"],
            values["optical"] * 0.9 * 0.95, values["optical"] * 0.9 * 0.95 * passed, received,
        )),
    ]  # fmt: skip
    losses = -np.diff([area * each.sum() for each in left])
    assert limited["stage"].values.tolist() == [
        "stow", "cosine", "shading", "blocking", "reflection", "attenuation", "spillage"
    ]  # fmt: skip
    np.testing.assert_allclose(limited["loss"], losses, rtol=1e-9, atol=1e-9)
    assert np.all(losses > 0)
    month = file.index.month.to_numpy()
    # Rows have the times of their ends: the hour to midnight of the last day belongs to the month that ends.
    month = np.roll(month, 1)
    wanted = [area * (weight[month == each] @ received[month == each]).sum() for each in range(1, 13)]
    np.testing.assert_allclose(limited["monthly_receiver_energy"], wanted, rtol=1e-10)


def test_stages_months_and_heliostats_sum_to_the_year(year):
    for result in (computed(year(limits=LIMITS)), computed(year(**PLAIN))):
        received, incident = result["field_receiver_energy"], result["field_incident_energy"]
        for name in ("receiver", "incident"):
            total = result[f"field_{name}_energy"]
            np.testing.assert_allclose(result[f"monthly_{name}_energy"].sum("month"), total, rtol=1e-12)
            np.testing.assert_allclose(result[f"{name}_energy"].sum("heliostat"), total, rtol=1e-12)
        lost = result["loss"].sum("stage")
        assert float((abs(lost - (incident - received)) / incident).max()) < 1e-12
        each = result["heliostat_loss"].sum("stage").transpose(..., "heliostat")
        np.testing.assert_allclose(each, result["incident_energy"] - result["receiver_energy"], rtol=1e-12)
        by_area = result["energy_per_mirror_area"]
        np.testing.assert_allclose(by_area * 72, result["receiver_energy"], rtol=1e-14)
        for rank, energy in zip(result["rank"].values, by_area.values, strict=True):
            np.testing.assert_array_equal(np.sort(rank), np.arange(1, 21))
            assert np.all(np.diff(energy[np.argsort(rank)]) <= 0)
        np.testing.assert_allclose(result["field_energy_per_mirror_area"] * result["field_mirror_area"], received)
    assert not result["loss"].sel(stage=["stow", "reflection", "attenuation", "spillage"]).any()
    assert "weighted by direct normal irradiance" in result["field_cosine_efficiency"].attrs["cell_methods"]


def test_one_heliostat_without_losses_in_closed_form(year, tmp_path):
    """Energy is the area times the sum of DNI times the cosine; the cosine is that of half an angle."""
    (tmp_path / "one.csv").write_text("x,y\n30,80\n")
    result = computed(year(**PLAIN, layout={"file": str(tmp_path / "one.csv")}, output={"field_series": True}))
    azimuth, elevation = (np.radians(result[name]) for name in ("sun_azimuth", "sun_elevation"))
    to_target = np.array([-30.0, -80.0, 25.0]) / np.sqrt(30**2 + 80**2 + 25**2)
    sun = (np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation))
    cosine = np.sqrt((1 + sum(s * r for s, r in zip(sun, to_target, strict=True))) / 2)
    energy = 72 * (result["dni"] * cosine).sum("time") * 1e-6
    np.testing.assert_allclose(result["receiver_energy"].isel(heliostat=0), energy, rtol=1e-12)
    np.testing.assert_allclose(result["field_power"].sum("time"), energy, rtol=1e-12)
    assert not result["loss"].sel(stage=["shading", "blocking"]).any()


def test_series_sum_to_the_energies(year, hourly):
    means = computed(year(tracking="azimuth_elevation", output={"field_series": True}))
    for name in ("field_power", "dni", "sun_azimuth", "field_instantaneous_total_efficiency"):
        np.testing.assert_array_equal(means[name], hourly[name])
    assert "instantaneous_power" not in means
    np.testing.assert_allclose(means["field_power"].sum("time"), means["field_receiver_energy"], rtol=1e-12)
    power = hourly["instantaneous_power"]  # sums of the field are integers of the tracer, with a resolution
    np.testing.assert_allclose(power.sum("heliostat") * 1e-3, hourly["field_power"], rtol=1e-11)
    np.testing.assert_allclose(power.sum("time") * 1e-3, hourly["receiver_energy"], rtol=1e-12)
    total = hourly["instantaneous_total_efficiency"].mean("heliostat")
    np.testing.assert_allclose(hourly["field_instantaneous_total_efficiency"], total, rtol=1e-11)


def test_facets_have_no_gaps_in_their_area(year):
    facets = {"columns": 4, "rows": 2, "gap": 0.1}
    heliostat = {"width": 9, "height": 8, "pivot_height": 5, "focus": "slant", "facets": facets}
    result = computed(year(heliostat=heliostat))
    np.testing.assert_allclose(result["field_mirror_area"], 20 * (9 - 0.3) * (8 - 0.1), rtol=1e-14)
    ratio = result["incident_energy"] / (1e-6 * (9 - 0.3) * (8 - 0.1))
    np.testing.assert_allclose(ratio, ratio.values[0, 0], rtol=1e-14)


def test_a_site_in_the_polar_night_is_missing_and_told(small):
    """Its design point too; a study of nothing else is refused."""
    dark = {
        "weather": {"clear_sky": {"model": "meinel"}},
        "time": {
            "clock": "civil", "timezone": "+00:00", "dates": ["2021-01-05"],
            "window": {"start": "10:00", "stop": "14:00", "step": 1},
        },
        "design_point": {"day": 5, "solar_hour": 12, "dni": 900},
    }  # fmt: skip
    study = small(**dark, site={"latitude": [20, 80], "longitude": 0})
    assert study.notes() == [
        "the sun is down at the design point at latitude 80 deg: results for this site are missing (NaN)",
        "the sun never rises at latitude 80 deg: its efficiencies are missing (NaN), and its energies are 0",
        "at 1 of 2 points there is no instant at which the field operates",
    ]
    result = computed(study)
    lit, night = result.isel(latitude=0), result.isel(latitude=1)
    assert (lit["design_point_power"] > 0).all()
    assert (lit["field_receiver_energy"] > 0).all()
    assert night["design_point_power"].isnull().all()
    assert night["field_optical_efficiency"].isnull().all()
    np.testing.assert_array_equal(night["field_receiver_energy"], 0.0)
    with pytest.raises(StudyError, match="design_point: the sun is down at this instant at latitude 80 deg"):
        api.plan(small(**dark, site={"latitude": [80, 85], "longitude": 0}))


def test_the_design_point_is_the_instant(year):
    """The same as a study of this one instant on the solar clock; power is its efficiency times area and irradiance."""
    point = {"day": 172, "solar_hour": 9.5, "dni": 900}
    result = computed(year(design_point=point))
    once = computed(
        year(
            weather=None, site={"latitude": float(result["latitude"])},
            time={"clock": "solar", "days": [172], "hours": [9.5]},
        )
    )  # fmt: skip
    for name in ("cosine", "shading", "blocking", "optical", "intercept", "attenuation", "reflection", "total"):
        for of in ("", "field_"):
            np.testing.assert_allclose(
                result[f"{of}design_point_{name}_efficiency"], once[f"{of}{name}_efficiency"], rtol=1e-13
            )
    power = result["field_design_point_total_efficiency"] * result["field_mirror_area"] * 900e-6
    np.testing.assert_allclose(result["design_point_power"], power, rtol=1e-14)
    without = computed(year(**PLAIN, weather=None, time={"clock": "solar", "days": [80], "hours": [12]},
                            site={"latitude": 35}, design_point=point))  # fmt: skip
    sun = solar_clock(np.radians(35), declination_cooper(172), 9.5)
    assert float(sun @ np.array([0, 0, 1.0])) > 0
    power = without["field_design_point_optical_efficiency"] * 1440 * 900e-6
    np.testing.assert_allclose(without["design_point_power"], power, rtol=1e-13)


def test_cleanliness_of_each_month(year):
    clean = [0.80 + 0.01 * month for month in range(12)]
    optics = {**BLOCKS["optics"], "cleanliness": None, "cleanliness_by_month": clean}
    optics = {key: value for key, value in optics.items() if value is not None}
    point = {"day": 200, "solar_hour": 12, "dni": 900}
    result, fixed = computed(year(optics=optics, design_point=point)), computed(year())
    expected = fixed["monthly_receiver_energy"] * np.array(clean) / 0.95
    np.testing.assert_allclose(result["monthly_receiver_energy"], expected, rtol=1e-12)
    lost = result["field_incident_energy"] - result["field_receiver_energy"]
    np.testing.assert_allclose(result["loss"].sum("stage"), lost, rtol=1e-12)
    np.testing.assert_allclose(result["field_design_point_reflection_efficiency"], 0.9 * 0.86, rtol=1e-14)
    assert "weighted by direct normal irradiance" in result["reflection_efficiency"].attrs["cell_methods"]
    assert "cell_methods" not in fixed["reflection_efficiency"].attrs
    by_hour = computed(year(optics=optics, output={"field_series": True}))
    np.testing.assert_allclose(by_hour["field_power"].sum("time"), by_hour["field_receiver_energy"], rtol=1e-12)
