"""Shade of the tower and horizon: against exact polygons, rays and pvlib; refused input."""

from typing import Any

import numpy as np
import pandas as pd
import pvlib
import pytest

import heliosweep
from heliosweep import api
from heliosweep.errors import StudyError
from tests.families.field_efficiency.test_energy import BLOCKS, PLAIN, TMY3
from tests.families.studies import computed

HORIZON = [[0, 9], [90, 20], [180, 8], [270, 12], [300, 15]]
SHORT = {"clock": "weather", "months": [3, 12]}


@pytest.fixture(scope="session")
def year(small):
    def make(**blocks: Any) -> Any:
        return small(**{**BLOCKS, "tracking": "azimuth_elevation", "time": SHORT, **blocks})

    return make


def of_site(**keys: Any) -> dict[str, Any]:
    return {"site": {"file": str(TMY3), **keys}}


def test_the_tower_is_a_stage_of_the_energy(year):
    """Rays and polygons agree, and the stages are the incident less the received energy."""
    tower = {"tower": {"radius": 3, "top": 28}}
    blocks = {**PLAIN, "receiver": {"height": 30}}
    exact, bare = (computed(year(**blocks, **more)) for more in (tower, {}))
    traced = computed(
        year(**tower, receiver={**BLOCKS["receiver"], "radius": 3}, optics={**BLOCKS["optics"], "rays": 512})
    )
    for found in (exact, traced):
        lost = float(found["field_incident_energy"] - found["field_receiver_energy"])
        assert float(found["loss"].sum()) == pytest.approx(lost, rel=1e-12)
        assert (found["loss"] >= -1e-9).all()
    assert exact["stage"].values.tolist()[:4] == ["stow", "cosine", "tower", "shading"]
    assert float(exact["loss"].sel(stage="tower")) > 3.0
    assert float(traced["loss"].sel(stage="tower")) == pytest.approx(float(exact["loss"].sel(stage="tower")), rel=0.05)
    # Aim points on the cylinder turn the mirrors of the traced field a little.
    assert "tower" not in bare["stage"].values
    shade = [
        float(one["loss"].sel(stage=[s for s in ("tower", "shading") if s in one["stage"]]).sum())
        for one in (exact, bare)
    ]
    assert shade[0] > shade[1]


def test_the_sun_below_the_horizon_is_down(year, tmp_path):
    """Against pvlib's position of the sun and its way of interpolating a horizon."""
    file, meta = pvlib.iotools.read_tmy3(TMY3, map_variables=True)
    found = computed(year(**PLAIN, **of_site(horizon={"table": HORIZON}), limits={"dni": 200}))
    middles = file.index - pd.Timedelta("30min")
    some = np.isin(middles.month, (3, 12))
    sun = pvlib.solarposition.get_solarposition(middles, meta["latitude"], meta["longitude"], meta["altitude"])
    azimuth, elevation = zip(*HORIZON, (360, 9), strict=True)
    # In hours of sunrise and sunset the sun of the lit part is below 8 deg, as the sun of the whole hour.
    behind = (sun["elevation"] < np.interp(sun["azimuth"], azimuth, elevation)).to_numpy()
    lost = 1e-6 * 72.0 * 20 * file["dni"].to_numpy()[behind & some].sum()
    assert float(found["loss"].sel(stage="horizon")) == pytest.approx(lost, rel=1e-12)
    assert lost > 1.0
    free = computed(year(**PLAIN, limits={"dni": 200}))
    assert float(found["field_incident_energy"]) == float(free["field_incident_energy"])
    hours = float(found["hours_lost"].sum() + found["hours_used"])
    assert hours == float(free["hours_lost"].sum() + free["hours_used"])
    (tmp_path / "horizon.csv").write_text("azimuth,elevation\n" + "".join(f"{a},{e}\n" for a, e in HORIZON))
    read = computed(year(**PLAIN, **of_site(horizon={"file": str(tmp_path / "horizon.csv")}), limits={"dni": 200}))
    assert (read["loss"] == found["loss"]).all()


def test_a_horizon_counts_without_weather(small):
    """The mean is over the instants with the sun above the horizon alone; below it the series is missing."""
    place = {"latitude": 37, "longitude": -2}
    time = {"clock": "solar", "days": [80], "hours": {"start": 6, "stop": 18, "step": 1}, "sampling": "inclusive"}
    blocks = {"time": time, "tracking": "azimuth_elevation", "output": {"time_series": True}}
    free, walled = (
        computed(small(**blocks, site=place | more))
        for more in ({}, {"horizon": {"table": [[0, 0], [90, 30], [180, 0]]}})
    )
    each = free["instantaneous_cosine_efficiency"]
    sun = heliosweep.sun_position_solar(37.0, np.arange(6.0, 19.0), day=80)
    wall = np.interp(sun.sun_azimuth, [0, 90, 180, 360], [0, 30, 0, 0])
    seen = ((sun.sun_elevation > wall) & (sun.sun_elevation > 0)).to_numpy()
    assert 3 < seen.sum() < each.notnull().any("heliostat").sum()
    np.testing.assert_array_equal(walled["instantaneous_cosine_efficiency"].notnull().all("heliostat"), seen)
    np.testing.assert_allclose(walled["cosine_efficiency"], each[seen].mean("time"), rtol=1e-12)


# --- availability ----------------------------------------------------------------------------------------------------


OPTICS = {"optics": {**BLOCKS["optics"], "rays": 16}}


@pytest.mark.parametrize("blocks", [PLAIN, OPTICS])
def test_a_fraction_scales_the_energy_on_the_receiver(year, blocks):
    free, found = (computed(year(**blocks, **more)) for more in ({}, {"availability": {"fraction": [0.9, 0.5]}}))
    for part in (0.9, 0.5):
        one = found.sel(availability=part)
        for name in ("receiver_energy", "field_receiver_energy", "monthly_receiver_energy"):
            np.testing.assert_allclose(one[name], part * free[name], rtol=1e-12)
        lost = (1.0 - part) * float(free["field_receiver_energy"])
        assert float(one["loss"].sel(stage="availability")) == pytest.approx(lost, rel=1e-12)
        total = float(one["field_incident_energy"] - one["field_receiver_energy"])
        assert float(one["loss"].sum()) == pytest.approx(total, rel=1e-12)
        np.testing.assert_array_equal(one["loss"][:-1], free["loss"])
        np.testing.assert_array_equal(one["optical_efficiency"], free["optical_efficiency"])
    if "receiver_energy_error" in free:
        error = found["receiver_energy_error"].sel(availability=0.5)
        np.testing.assert_allclose(error, 0.5 * free["receiver_energy_error"], rtol=1e-12)


def layout(tmp_path, **columns):
    table = pd.DataFrame({"x": [-30.0, 0.0, 30.0], "y": [60.0, 70.0, 60.0], "name": ["A1", "A2", "A3"], **columns})
    table.to_csv(tmp_path / "field.csv", index=False)
    return {"file": str(tmp_path / "field.csv")}


def test_each_heliostat_has_its_availability(year, tmp_path):
    column = {"layout": layout(tmp_path, availability=[1.0, 0.5, 0.0])}
    free, found = computed(year(**PLAIN, **column)), computed(year(**PLAIN, **column, availability={}))
    np.testing.assert_allclose(found["receiver_energy"], [1.0, 0.5, 0.0] * free["receiver_energy"], rtol=1e-12)
    with pytest.raises(StudyError, match="availability: has no value"):
        api.plan(year(**PLAIN, layout=layout(tmp_path), availability={}))


@pytest.mark.parametrize("blocks", [PLAIN, OPTICS])
def test_outages_take_the_energy_of_their_hours(year, tmp_path, blocks):
    """The power at each instant over its outage; the year does not count, and a table may use other zones."""
    (tmp_path / "out.csv").write_text(
        "heliostat,from,to\nA1,2023-03-05T10:15,2023-03-05T13:00\nA1,2023-12-20,2024-01-03\n2,2023-03-01,2023-04-01\n"
        "A2,2023-03-09T15:00+00:00,2023-03-12T16:00Z\n"
    )
    flux = {"flux_map": {"columns": 4, "rows": 3}} if blocks.get("optics") else {}
    base = {**blocks, "layout": layout(tmp_path), "output": {"time_series": True, **flux}}
    out = {"availability": {"outages": str(tmp_path / "out.csv")}}
    free, found = (computed(year(**base, **more)) for more in ({}, out))
    if flux:  # a map shows all heliostats
        np.testing.assert_array_equal(found["energy_flux_map"], free["energy_flux_map"])
    power = free["instantaneous_power"].to_numpy()
    local = (free["utc" if "utc" in free.coords else "time"].to_pandas() - pd.Timedelta("5h")).to_numpy()
    local = pd.DatetimeIndex(local)  # middles of hours on the clock of the file, of several years
    day, hour = (local.month * 100 + local.day).to_numpy(), local.hour.to_numpy()
    first = (day == 305) * np.select([hour == 10, (hour > 10) & (hour < 13)], [0.75, 1.0], 0.0) + (day >= 1220)
    second = (100 * day + hour >= 30910) & (100 * day + hour < 31211)  # 15:00 and 16:00 in universal time
    lost = 1e-3 * np.array([power[:, 0] @ first, power[:, 1] @ second, power[day < 401, 2].sum()])
    assert (lost > 0.05).all()
    np.testing.assert_allclose(free["receiver_energy"] - found["receiver_energy"], lost, rtol=1e-9)
    np.testing.assert_allclose(found["heliostat_loss"].sel(stage="availability"), lost, rtol=1e-9)
    np.testing.assert_allclose(found["monthly_receiver_energy"].sum(), found["field_receiver_energy"], rtol=1e-12)
    assert float(found["heliostat_monthly_receiver_energy"].sel(month=3)[2]) == pytest.approx(0.0, abs=1e-9)


def test_outages_of_array_functions():
    """Outages over the new year, over leap days and of whole years; the real dates count by default."""
    hours = pd.date_range("2021-01-01", "2022-01-01", freq="h", inclusive="left").to_numpy()
    part = heliosweep.availability(hours, 1.0, ["2019-12-31T12:00"], ["2020-01-01T06:30"], yearly=True)
    assert (1 - part).sum() == 18.5
    np.testing.assert_array_equal(part[:8], [0, 0, 0, 0, 0, 0, 0.5, 1])
    assert heliosweep.availability(hours, 1.0, ["2020-02-28"], ["2020-03-01"], yearly=True).sum() == 8760 - 24
    assert not heliosweep.availability(hours, 1.0, ["2020-02-28"], ["2021-02-28"], yearly=True).any()
    assert heliosweep.availability(hours, 1.0, ["2020-12-01"], ["2021-02-01"]).sum() == 8760 - 31 * 24
    with pytest.raises(ValueError, match="overlap"):
        heliosweep.availability(hours, 1.0, ["2020-12-01", "2021-01-03"], ["2021-02-01", "2021-01-05"], yearly=True)
    with pytest.raises(ValueError, match="must end after its start"):
        heliosweep.availability(hours, 1.0, ["2020-12-02"], ["2020-12-01"])


# --- several years ---------------------------------------------------------------------------------------------------


def test_years_have_p50_and_p90(year, tmp_path):
    """Against sorted energies of the years, interpolated by hand; on the page and in the summary."""
    text = TMY3.read_text().splitlines()
    factors = (1.0, 0.8, 1.1, 0.9)
    for number, factor in enumerate(factors):
        rows = [row.split(",") for row in text[2:]]
        dni = [f"{float(row[7]) * factor:.3f}" for row in rows]
        lines = [",".join((*row[:7], value, *row[8:])) for row, value in zip(rows, dni, strict=True)]
        (tmp_path / f"year{number}.csv").write_text("\n".join([*text[:2], *lines]))
    files = [str(tmp_path / f"year{number}.csv") for number in range(4)]
    study = year(**PLAIN, weather={"file": files}, availability={"fraction": [0.5, 1.0]})
    found = computed(study)
    assert found["field_receiver_energy_p50"].dims == ("availability",)
    energy = np.sort(found["field_receiver_energy"].transpose("availability", "weather"), axis=1)
    np.testing.assert_allclose(energy, np.outer([0.5 * energy[1, 3], energy[1, 3]], sorted(factors)) / 1.1, rtol=1e-3)
    p90 = 0.7 * energy[:, 0] + 0.3 * energy[:, 1]  # 10 % of three steps from the lowest
    np.testing.assert_allclose(found["field_receiver_energy_p90"], p90, rtol=1e-12)
    np.testing.assert_allclose(found["field_receiver_energy_p50"], energy[:, 1:3].mean(axis=1), rtol=1e-12)
    labelled = heliosweep.exceedance(found["field_receiver_energy"], [0.5, 0.9])
    np.testing.assert_allclose(labelled.sel(exceedance=0.9), p90, rtol=1e-12)
    result = api.run(year(**PLAIN, weather={"file": files}, time={"clock": "weather", "months": [6]}), tmp_path / "out")
    assert "P90 of the" in result.summary()
    assert "P90 of the" in (tmp_path / "out" / "report.html").read_text()
    few = computed(year(**PLAIN, weather={"file": files[:2]}))
    assert "field_receiver_energy_p50" not in few
