"""What SAM makes of the tables: the efficiency is that of the direction that its sun has. Needs nrel-pysam."""

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from heliosweep import build, study, tower_electricity, write_table
from heliosweep.files import named_in
from heliosweep.share import sam as sam_tables
from tests.bench import solarpilot
from tests.weather import write_sam_year

pytest.importorskip("PySAM", reason="nrel-pysam is not installed")

#: Hours of 22 June at which both models run.
HOURS = [24 * 172 + hour for hour in range(7, 17)]


def efficiency(azimuth):
    """Best with the sun in the east, so that east and west, north and south are told apart."""
    return 0.5 + 0.2 * np.sin(np.radians(azimuth)) + 0.1 * np.cos(np.radians(azimuth))


@pytest.fixture
def table() -> xr.DataArray:
    azimuth, elevation = np.arange(0, 361, 15.0), np.arange(0, 91, 10.0)
    values = np.broadcast_to(efficiency(azimuth), (elevation.size, azimuth.size))
    labels = {"sun_elevation": elevation, "sun_azimuth": azimuth}
    return xr.DataArray(values, labels, dims=("sun_elevation", "sun_azimuth")).where(lambda a: a["sun_elevation"] > 0)


def shares(table: xr.DataArray) -> xr.DataArray:
    """Even flux maps for the rows of a table."""
    return (table * 0 + 1 / 12).expand_dims(flux_column=12, axis=2)


@pytest.fixture
def weather(tmp_path) -> Path:
    return write_sam_year(tmp_path / "weather.csv", 5, 19)


def matrix(path: Path) -> list[list[float]]:
    with path.open(newline="") as file:
        return [[float(cell or 0) for cell in row] for row in csv.reader(file)]


def test_power_tower(table, weather, tmp_path):
    from PySAM import TcsmoltenSalt

    model = TcsmoltenSalt.default("MSPTSingleOwner")
    model.SolarResource.solar_resource_file = str(weather)
    field = model.HeliostatField
    field.field_model_type = 3
    field.eta_map_aod_format = 0
    field.eta_map = matrix(write_table(table, tmp_path / "t.csv", "tower"))
    field.flux_maps = matrix(write_table(shares(table), tmp_path / "f.csv"))
    assert len(field.flux_maps) == len(field.eta_map)
    field.helio_reflectance, field.c_atm_0, model.TowerAndReceiver.rec_absorptance = 0.5, 0.5, 0.5  # are not used
    angles = [math.radians(3.6 * step) for step in range(100)]
    field.helio_positions = [[r * math.sin(a), r * math.cos(a)] for r in range(150, 1500, 15) for a in angles]
    field.N_hel, field.A_sf_in = 9000, 1.2e6
    model.execute(0)
    out = model.Outputs
    computed = [out.eta_field[hour] / out.sf_adjust_out[hour] for hour in HOURS]
    np.testing.assert_allclose(computed, [efficiency(out.solaz[hour]) for hour in HOURS], atol=0.02)
    early = HOURS[:5]  # before the storage is full and mirrors turn away
    received = [out.q_dot_rec_inc[hour] / out.q_sf_inc[hour] for hour in early]
    np.testing.assert_allclose(received, [out.eta_field[hour] for hour in early], rtol=1e-5)


def test_columns_of_flux_maps():
    """SolarPILOT's maps of mirrors in the east, north and west are hot where ours would be."""
    around = (180 - 360 * (np.arange(8) + 0.5) / 8) % 360  # azimuths of our columns
    for azimuth in (90, 0, 270):
        place = np.radians(azimuth) + np.array([-0.01, 0.0, 0.01])
        _, _, maps = solarpilot.measure(200 * np.sin(place), 200 * np.cos(place), 10, 100, n_flux_x=8, rec_aspect=1)
        power = np.sum(maps.reshape(-1, 4, 8), axis=(0, 1))
        mean = np.sum(power * np.exp(1j * np.radians(around)))
        assert np.degrees(np.angle(mean * np.exp(-1j * np.radians(azimuth)))) == pytest.approx(0, abs=15)


def test_generic_field(table, weather, tmp_path):
    from PySAM import TcsgenericSolar

    model = TcsgenericSolar.default("GenericCSPSystemSingleOwner")
    model.Weather.file_name = str(weather)
    model.Type260.istableunsorted, model.Type260.interp_arr = 0, 1
    model.Type260.OpticalTable = matrix(write_table(table, tmp_path / "t.csv", "generic"))
    model.execute(0)
    out, losses = model.Outputs, model.Type260.eta_opt_soil * model.Type260.eta_opt_gen
    computed = [out.eta_opt_sf[hour] / losses for hour in HOURS]
    np.testing.assert_allclose(computed, [efficiency(out.solazi[hour]) for hour in HOURS], atol=0.04)


def default_field(model: Any, place: np.ndarray, **more: Any) -> Any:
    """Return our study of the heliostats of SAM's default plant, 12.2 m wide, with 97 % of their area."""
    tower, side = model.TowerAndReceiver, 12.2 * np.sqrt(0.97)
    receiver = {"height": tower.h_tower, "radius": tower.D_rec / 2, "height_extent": tower.rec_height}
    mirror = {
        "slope_error": model.HeliostatField.helio_optical_error_mrad,
        "reflectivity": model.HeliostatField.helio_reflectance,
    }
    optics = {**mirror, "attenuation": "delsol_clear", "sun_shape": {"kind": "limb_darkened"}, "rays": 16}
    heliostat = {"width": side, "height": side, "pivot_height": 0, "focus": "slant"}
    layout = {"table": {"x": place[:, 0].tolist(), "y": place[:, 1].tolist()}}
    given = {"layout": layout, "heliostat": heliostat, "receiver": {"kind": "cylinder", **receiver}, "optics": optics}
    return study("field_efficiency", tracking="azimuth_elevation", **given, **more)


def test_default_plant():
    """SAM's default plant has the same year with its heliostats traced by us: 1 % with one aim and all directions."""
    from PySAM import TcsmoltenSalt

    model, weather = TcsmoltenSalt.default("MSPTSingleOwner"), named_in(Path(), "pvlib:data/723170TYA.CSV")
    model.SolarResource.solar_resource_file = str(weather)
    model.execute(0)
    sam, place = model.Outputs, np.array(model.Outputs.helio_positions_calc)
    sun = {"clock": "sun", "azimuth": {"start": 0, "stop": 360, "step": 60}, "elevation": [10, 30, 50, 75]}
    made = default_field(model, place, time=sun, output={"flux_map": {"columns": 20, "rows": 1}})
    directed = build(made)[["field_total_efficiency", "flux_map"]].compute()
    tables = (
        sam_tables.efficiency_table(directed, factor=model.TowerAndReceiver.rec_absorptance),
        sam_tables.flux_maps(directed),
    )
    year = tower_electricity(*tables, weather, place, sam.A_sf)
    assert float(year.absorbed_power.sum()) == pytest.approx(sam.annual_q_rec_inc, rel=0.02)
    assert float(year.electricity) * 1e3 == pytest.approx(sam.annual_energy, rel=0.02)
    assert float(year.installed_cost) == pytest.approx(sam.total_installed_cost, rel=1e-6)
