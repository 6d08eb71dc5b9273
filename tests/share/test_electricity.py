"""Electricity behind an efficiency table: SAM gets the plant and the weather of the study."""

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
import yaml

import heliosweep
from heliosweep import cli
from tests.weather import write_sam_year

#: A plant of 40 heliostats, and a year of clear days, 6 to 18 h in local time at 120 deg west, in universal time.
PLANT: dict[str, Any] = {
    "family": "field_efficiency",
    "title": "A plant",
    "site": {"latitude": 35.0, "longitude": -120.0, "altitude": 500.0},
    "weather": {"file": "year.csv", "label": "middle", "dni_factor": 0.5},
    "time": {"clock": "weather"},
    "tracking": "azimuth_elevation",
    "layout": {"radial_stagger": {"clearance": 16, "inner_radius": 40, "heliostats": 40}},
    "heliostat": {"width": 11, "height": 10, "pivot_height": 7, "focus": "slant"},
    "receiver": {"kind": "cylinder", "height": [60, 70], "radius": 2, "height_extent": 5, "absorptance": 0.9,
                 "thermal_losses": {"constant": 0.1}},
    "optics": {"sun_shape": {"kind": "limb_darkened"}, "slope_error": 1.5, "rays": 16},
    "availability": {"fraction": 0.9},
    "design_point": {"day": 80, "solar_hour": 12, "dni": 900},
    "economics": {"currency": "USD", "heliostat_cost": 100.0, "land_cost": 1.0, "sales_tax": 0.08,
                  "fixed_charge_rate": 0.1, "operation_cost": 5000.0},
}  # fmt: skip


def write_year(folder: Any, hours: int = 8760) -> None:
    times = np.arange(np.datetime64("2019-01-01T00:20"), np.timedelta64(60 * hours, "m"), np.timedelta64(60, "m"))
    local = (times - np.timedelta64(8, "h")).astype("datetime64[h]").astype(int) % 24
    rows = [f"{time}Z,{700 + 10 * (hour == 12) if 6 <= hour < 18 else 0},{hour}"
            for time, hour in zip(times, local, strict=True)]  # fmt: skip
    (folder / "year.csv").write_text("\n".join(["time,dni,temp_air", *rows, ""]))


class Fake:
    """SAM without its model: keeps its inputs."""

    last: dict[str, Any]

    @staticmethod
    def default(_: str) -> "Fake":
        Fake.last = {"helio_height": 12.2, "design_eff": 0.4, "solarm": 2.0}
        return Fake()

    def value(self, name: str, *value: Any) -> Any:
        if name == "wrong":
            raise AttributeError('"value" error, could not find attribute by that name')
        return Fake.last.__setitem__(name, *value) if value else Fake.last[name]

    def execute(self, _: int) -> None:
        names = ("P_out_net", "q_dot_rec_inc", "q_thermal_loss", "Q_thermal", "e_ch_tes", "beam")
        series: dict[str, Any] = {name: np.full(8760, 2.0) for name in names}
        self.Outputs = SimpleNamespace(
            **series, time_hr=np.arange(1, 8761.0), annual_energy=5e6, total_installed_cost=2e6, capacity_factor=25.0
        )


@pytest.fixture
def sam(monkeypatch: pytest.MonkeyPatch) -> type[Fake]:
    module, package = ModuleType("PySAM.TcsmoltenSalt"), ModuleType("PySAM")
    module.default = Fake.default  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "PySAM", package)
    monkeypatch.setitem(sys.modules, "PySAM.TcsmoltenSalt", module)
    return Fake


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A plant that has been run."""
    made = tmp_path_factory.mktemp("plant")
    write_year(made)
    (made / "losses.csv").write_text("power,losses\n0,0.1\n2,0.2\n")
    (made / "plant.yaml").write_text(yaml.safe_dump(PLANT))
    heliosweep.run(made / "plant.yaml", made / "out", report=False)
    return made


def test_sam_gets_the_plant_of_the_study(folder, sam, capsys):
    target = folder / "electricity.nc"
    arguments = ["electricity", str(folder / "out"), "--select", "receiver.height=70", "--sam", "tshours=6"]
    assert cli.main([*arguments, "-o", str(target)]) == 0
    with heliosweep.open_result(folder / "out") as result:
        here = result.sel(receiver_height=70).compute()
    expected = {
        "h_tower": 70.0, "D_rec": 4.0, "rec_height": 5.0, "rec_absorptance": 0.9, "helio_height": 10.0, "N_hel": 40,
        "helio_width": 11.0, "dens_mirror": 1.0, "tshours": 6, "heliostat_spec_cost": 100.0, "sales_tax_rate": 10.0,
        "land_spec_cost": 4046.8564, "sf_adjust_constant": 10.0, "dni_des": 900.0,
        "rec_hl_perm2": 100.0 / (np.pi * 4.0 * 5.0),
        "P_ref": float(here["design_point_heat"]) * 0.4 / 2.0,
    }  # fmt: skip
    assert {key: sam.last[key] for key in expected} == pytest.approx(expected, rel=1e-6)
    table = np.array(sam.last["eta_map"])
    assert table.shape == (13 * 9, 3)
    assert len(sam.last["flux_maps"]) == len(table)
    high = here["field_design_point_total_efficiency"] * 0.9  # the sun at 53 deg in the south, and the absorptance
    south = table[table[:, 0] == 180.0]
    assert np.interp(37.0, *south[np.argsort(south[:, 1])].T[1:]) == pytest.approx(float(high), rel=0.02)
    assert np.sum(sam.last["flux_maps"], axis=1) == pytest.approx(1.0)
    with xr.open_dataset(target) as year:
        assert float(year.levelized_cost_of_electricity) == pytest.approx((0.1 * 2e6 + 5000) / 5000)
        assert float(year.field_receiver_energy) == pytest.approx(float(here["field_receiver_energy"]))
        assert year.time.dt.minute.values.tolist() == [20] * 8760
        assert year.electric_power.sizes == {"time": 8760}
        assert year.attrs["study_id"] == here.attrs["study_id"]
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == "electricity: 5,000 MWh, 41.0 USD/MWh"
    assert printed[-2].startswith("receiver heat: 17,520 MWh with start-up and full storage, ")
    assert printed[-1] == str(target)


def test_sam_gets_the_weather_in_local_time(folder, sam):
    heliosweep.plant_electricity(folder / "out", {"receiver.height": 60})
    data = {key: np.array(value) for key, value in sam.last["solar_resource_data"].items()}
    assert (data["lat"], data["lon"], data["tz"], data["elev"]) == (35.0, -120.0, -8.0, 500.0)
    clock = (data["month"][[0, -1]], data["day"][[0, -1]], data["hour"][[0, -1]])
    assert np.array(clock).tolist() == [[1, 12], [1, 31], [0, 23]]
    assert sorted(set(data["hour"][data["dn"] == 355.0])) == [12.0]
    assert data["dn"].sum() == pytest.approx(0.5 * 365 * (700 * 12 + 10))
    assert (data["tdry"] == data["hour"]).all()


def test_without_pysam(monkeypatch, folder, capsys):
    monkeypatch.setitem(sys.modules, "PySAM", None)
    with pytest.raises(heliosweep.HeliosweepError, match="pip install nrel-pysam"):
        heliosweep.tower_electricity(*tables(0.5), "site.csv", [[0.0, 100.0]], 100.0)
    assert cli.main(["electricity", str(folder / "out")]) == 1
    assert capsys.readouterr().err == (
        "the package nrel-pysam is missing; run: pip install nrel-pysam (extra 'sam' of heliosweep)\n"
    )


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"receiver": {"kind": "rectangle", "height": 60, "width": 5, "height_extent": 5, "absorptance": 0.9}},
         r"receiver.kind: must be cylinder, SAM's external receiver \(got rectangle\)"),
        ({"receiver": {**PLANT["receiver"], "height": 60, "thermal_losses": {"file": "losses.csv"}}},
         "receiver.thermal_losses.file: is not supported by SAM: use 'per_area'"),
        ({"site": {**PLANT["site"], "horizon": {"table": [[0, 5], [90, 12]]}}}, "site.horizon: is not supported"),
        ({"economics": dict.fromkeys(("site_cost", "heliostat_cost", "land_cost", "tower_cost", "receiver_cost"), 1.0)
          | {"currency": "EUR"}}, r"economics.currency: must be USD, because SAM's other costs are in USD \(got EUR\)"),
        ({"time": {"clock": "weather", "months": [6]}}, r"weather.file: must have all hours of a year \(got 720 rows"),
        ({"design_point": None}, "design_point: is needed for the turbine power"),
        ({"receiver": PLANT["receiver"]}, "select: choose one value of receiver_height"),
    ],
)  # fmt: skip
def test_plants_without_a_model(folder, sam, changes, said, monkeypatch, tmp_path):
    monkeypatch.chdir(folder)
    content = {key: value for key, value in {**PLANT, **changes}.items() if value is not None}
    (folder / "other.yaml").write_text(yaml.safe_dump(content))
    heliosweep.run(folder / "other.yaml", tmp_path / "out", report=False)
    with pytest.raises(heliosweep.StudyError, match=said):
        heliosweep.plant_electricity(tmp_path / "out", {} if "receiver" in changes else {"receiver.height": 60})


def test_wrong_inputs_of_sam_are_named(folder, sam):
    with pytest.raises(heliosweep.HeliosweepError, match=r"SAM: wrong: .*could not find"):
        heliosweep.plant_electricity(folder / "out", {"receiver.height": 60}, {"wrong": 1})


def tables(efficiency: float) -> tuple[xr.DataArray, xr.DataArray]:
    labels = {"sun_elevation": np.arange(10, 91, 10.0), "sun_azimuth": np.arange(0, 361, 15.0)}
    table = xr.DataArray(np.full((9, 25), efficiency), labels, dims=("sun_elevation", "sun_azimuth"))
    return table, (table * 0 + 1 / 12).expand_dims(flux_column=12, axis=2)


def test_of_sam(tmp_path):
    """The energy on the receiver while nothing limits it is irradiance x area x efficiency."""
    pytest.importorskip("PySAM", reason="nrel-pysam is not installed")
    weather = write_sam_year(tmp_path / "weather.csv", 7, 17)
    place = np.random.default_rng(0).uniform(-1000, 1000, (9000, 2))
    working = {"sf_adjust_constant": 0.0, "tshours": 14}
    low, high = (heliosweep.tower_electricity(*tables(e), weather, place, 1.2e6, inputs=working) for e in (0.3, 0.5))
    assert 0.0 < float(low.electricity) < float(high.electricity)
    np.testing.assert_allclose(high.capacity_factor, high.electricity / (103.5 * 8760), rtol=0.02)
    noon = np.arange(8760) % 24 == 11
    assert float(low.absorbed_power[noon].median()) == pytest.approx(900e-6 * 1.2e6 * 0.3, rel=1e-3)
    assert float(low.levelized_cost_of_electricity) > float(high.levelized_cost_of_electricity)
