"""Efficiency over directions of the sun: the same values as a run, in the forms of SAM and SolarPILOT."""

import csv
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import heliosweep
from heliosweep import StudyError, build, efficiency_table, open_result, run, write_table
from heliosweep.api import save
from heliosweep.cli import main
from heliosweep.share import sam
from heliosweep.share.fields import kept_field
from heliosweep.share.sam import at_directions

AZIMUTH, ELEVATION = [0, 90, 180, 270, 360], [-5, 0, 20, 60]
AE = {"tracking": "azimuth_elevation"}
shares = sam.flux_maps


@pytest.fixture(scope="module")
def table(small) -> xr.DataArray:
    return efficiency_table(small(), AE, azimuth=AZIMUTH, elevation=ELEVATION)


def rows(path: Path) -> list[list[str]]:
    with path.open(newline="") as file:
        return list(csv.reader(file))


def test_values_are_those_of_the_study(small, table):
    directed = small(site=None, time={"clock": "sun", "azimuth": AZIMUTH, "elevation": ELEVATION})
    computed = build(directed)["field_optical_efficiency"].sel(AE).transpose("sun_elevation", "sun_azimuth").compute()
    np.testing.assert_array_equal(table, computed)
    assert table.sel(sun_elevation=[-5, 0]).isnull().all()
    np.testing.assert_allclose(table.sel(sun_azimuth=0), table.sel(sun_azimuth=360), rtol=1e-12)


def test_rows_for_the_tower(table, tmp_path):
    written = np.array(rows(write_table(table, tmp_path / "t.csv")), dtype=float)
    assert written.shape == (10, 3)  # nothing below the horizon
    assert written[:5, 0].tolist() == AZIMUTH
    assert set(written[:, 1]) == {70, 30}
    for azimuth, zenith, value in written:
        expected = table.sel(sun_azimuth=azimuth, sun_elevation=90 - zenith)
        assert value == pytest.approx(float(expected), abs=1e-9)


def test_matrix_for_the_generic_field(table, tmp_path):
    header, *body = rows(write_table(table, tmp_path / "t.csv", "generic"))
    assert header == ["", "-180", "-90", "0", "90", "180"]  # south is zero, east negative
    assert [row[0] for row in body] == ["30", "70", "90", "95"]
    assert float(body[0][2]) == pytest.approx(float(table.sel(sun_azimuth=90, sun_elevation=60)), abs=1e-9)
    assert float(body[1][3]) == pytest.approx(float(table.sel(sun_azimuth=180, sun_elevation=20)), abs=1e-9)
    assert set(body[2][1:] + body[3][1:]) == {"0"}


def test_matrix_of_solarpilot(table, tmp_path):
    header, *body = rows(write_table(table, tmp_path / "t.csv", "solarpilot"))
    assert header == ["0", "-5", "0", "20", "60"]
    assert [row[0] for row in body] == ["0", "90", "180", "270", "360"]
    assert body[1][1:3] == ["0", "0"]
    assert float(body[1][4]) == pytest.approx(float(table.sel(sun_azimuth=90, sun_elevation=60)), abs=1e-9)


def test_azimuths_turn_into_their_range(small, tmp_path):
    made = efficiency_table(small(), AE, azimuth=[-90, 0, 90], elevation=45)
    assert [row[0] for row in rows(write_table(made, tmp_path / "t.csv"))] == ["0", "90", "270", "360"]
    assert rows(write_table(made, tmp_path / "g.csv", "generic"))[0] == ["", "-180", "-90", "90", "180"]
    assert len(rows(write_table(made, tmp_path / "s.csv", "solarpilot"))) == 4  # as asked
    end = efficiency_table(small(), AE, azimuth=[90, 360], elevation=45)
    first, _, last = rows(write_table(end, tmp_path / "e.csv"))
    assert first[0] == "0"
    assert first[2] == last[2]
    twice = efficiency_table(small(), AE, azimuth=[-180, -90, 270], elevation=45)
    with pytest.raises(StudyError, match="two azimuths are the same direction"):
        write_table(twice, tmp_path / "n.csv")


def test_factor(small, table):
    less = efficiency_table(small(), AE, azimuth=AZIMUTH, elevation=ELEVATION, factor=0.5)
    np.testing.assert_allclose(less, table * 0.5)
    with pytest.raises(StudyError, match="more than 0 and at most 1"):
        efficiency_table(small(), AE, factor=1.5)


def test_blocks_of_the_year_change_no_table(small):
    """Losses of the receiver, costs and availability need a year; a table has none of them."""
    optics = {"sun_shape": {"kind": "pillbox"}, "slope_error": 1, "rays": 16}
    receiver = {"kind": "cylinder", "height": 70, "radius": 3, "height_extent": 6}
    plain = small(optics=optics, receiver=receiver, heliostat={"width": 11, "height": 11, "pivot_height": 7})
    weather = {"clear_sky": {"model": "meinel"}}
    year = {
        "site": {"latitude": 30, "longitude": 0}, "weather": weather, "economics": {},
        "availability": {"fraction": 0.9},
        "receiver": {**receiver, "absorptance": 0.9, "thermal_losses": {"per_area": 30}},
        "time": {"clock": "civil", "timezone": "+00:00", "dates": ["2021-03-21"],
                 "window": {"start": "08:00", "stop": "16:00", "step": 4}},
    }  # fmt: skip
    blocks = {"optics": optics, "heliostat": {"width": 11, "height": 11, "pivot_height": 7}}
    one, other = (
        efficiency_table(each, AE, azimuth=[0, 90], elevation=[45]) for each in (plain, small(**blocks, **year))
    )
    np.testing.assert_array_equal(one, other)


def test_chosen_aims_stay_for_all_directions(small, tmp_path):
    """A table of a result with chosen aims has these aims, and its value at the design point is that of the result."""
    optics = {"sun_shape": {"kind": "pillbox"}, "slope_error": 1, "rays": 256}
    receiver = {"kind": "cylinder", "height": 70, "radius": 2, "height_extent": 5}
    aim = {"strategy": "flux_limit", "limit": 150, "flux_rows": 6, "flux_columns": 12}
    heliostat = {"width": 11, "height": 11, "pivot_height": 7, "focus": "slant"}
    point = {"day": 80, "solar_hour": 12, "dni": 900}
    blocks = {"optics": optics, "receiver": receiver, "heliostat": heliostat, "aim": aim, "design_point": point}
    study = small(**blocks, tracking="azimuth_elevation", site={"latitude": 30})
    with run(study, tmp_path / "aims", report=False).open() as result:
        limited = float(result["field_design_point_total_efficiency"])
        working = 1 - float(result["stowed_heliostats"]) / result.sizes["heliostat"]
    height = 60.0 + 23.45 * np.sin(2 * np.pi * 364 / 365)
    table = efficiency_table(tmp_path / "aims", azimuth=[180], elevation=[height])
    assert table.item() * working == pytest.approx(limited, rel=0.003)


def test_results(small, tmp_path):
    normal = run(small(), tmp_path / "normal", report=False)
    with normal.open() as result, pytest.raises(StudyError, match="the result has no directions of the sun"):
        result.heliosweep.efficiency_table(AE)
    computed = efficiency_table(normal.folder, AE, azimuth=[0, 90], elevation=[30, 60])
    directed = run(at_directions(small(), [0, 90], [30, 60]), tmp_path / "directed", report=False)
    read = efficiency_table(directed.folder, AE)
    np.testing.assert_array_equal(read, computed)
    with open_result(directed.folder) as result:
        np.testing.assert_array_equal(result.heliosweep.efficiency_table(AE), read)


def test_command(small, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    save(small(), "study.yaml")
    angles = ["--azimuth", "0:360:90", "--elevation", "20,60"]
    asked = ["table", "study.yaml", "-o", "t.csv", *angles, "--select", "tracking=azimuth_elevation"]
    assert main(asked) == 0
    assert capsys.readouterr().out == "t.csv\n"
    assert len(rows(Path("t.csv"))) == 10
    assert main(asked) == 2
    assert "t.csv: exists already; --force (force=True in Python) replaces it" in capsys.readouterr().err
    assert main([*asked, "--force", "--form", "generic", "--factor", "0.9"]) == 0
    assert main(["table", "study.yaml", "-o", "u.csv", *angles]) == 2
    assert "choose one value of tracking" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["table", "study.yaml", "-o", "u.csv", "--azimuth", "0:b"])
    assert not Path("u.csv").exists()


def test_all_factors_of_a_study_with_optics(small):
    """One factor each, none twice: half the reflectivity is half the efficiency."""
    receiver = {"kind": "cylinder", "height": 60, "radius": 3, "height_extent": 6}
    optics = {"sun_shape": {"kind": "pillbox"}, "slope_error": 2, "attenuation": "delsol_clear", "method": "gaussian"}
    study = small(receiver=receiver, optics={**optics, "reflectivity": 0.9, "cleanliness": 0.95})
    table = efficiency_table(study, AE, azimuth=[0, 180], elevation=[30, 60])
    result = build(at_directions(study, [0, 180], [30, 60])).sel(AE).compute()
    names = ("optical", "reflection", "attenuation", "intercept")
    expected = np.prod([result[f"{name}_efficiency"].broadcast_like(result["total_efficiency"]) for name in names], 0)
    np.testing.assert_allclose(table.transpose("sun_azimuth", ...), expected.mean(axis=-1), rtol=1e-12)
    assert table.attrs["long_name"].endswith("cosine, shading, blocking, reflection, attenuation and intercept")
    other = small(receiver=receiver, optics={**optics, "reflectivity": 0.45, "cleanliness": 0.95})
    np.testing.assert_allclose(efficiency_table(other, AE, azimuth=[0, 180], elevation=[30, 60]), table / 2)


@pytest.mark.parametrize("place", ["site", "sites"])
def test_the_air_stays_at_the_altitude_of_the_site(small, place):
    optics = {"sun_shape": {"kind": "pillbox"}, "slope_error": 2, "attenuation": "vant_hull", "method": "gaussian"}
    receiver = {"kind": "cylinder", "height": 60, "radius": 3, "height_extent": 6}
    high = {"latitude": 40, "altitude": 3000}
    where = {"site": high} if place == "site" else {"site": None, "sites": [{"name": name, **high} for name in "ab"]}
    study = small(receiver=receiver, optics=optics, **where)
    at_sites = build(study)["attenuation_efficiency"].isel(tracking=0).transpose(..., "heliostat").compute()
    directed = build(at_directions(study, 180, 60))["attenuation_efficiency"].isel(tracking=0).compute()
    np.testing.assert_array_equal(directed.squeeze(), at_sites.isel(site=0) if place == "sites" else at_sites)
    low = build(at_directions(small(receiver=receiver, optics=optics), 180, 60))["attenuation_efficiency"]
    assert float(abs(low.isel(tracking=0).compute() - directed).min()) > 1e-6


def flux(columns: int, units: str = "degree") -> xr.Dataset:
    """A receiver of two rows that is hot in the northeast, more so with the sun in the west; no values at night."""
    azimuth, around = np.array(AZIMUTH[:-1]), 360 * (np.arange(columns) + 0.5) / columns
    hot = 1 + np.cos(np.radians(around - 60)) * np.where(azimuth == 270, 0.9, 0.1)[:, np.newaxis]
    elevation = np.array(ELEVATION)
    up = np.where(elevation > 0, elevation / 90, np.nan)
    values = up[:, np.newaxis, np.newaxis, np.newaxis] * hot[:, np.newaxis] * np.array([1.0, 3.0])[:, np.newaxis]
    dims = ("sun_elevation", "sun_azimuth", "flux_row", "flux_column")
    labels = {
        "sun_elevation": elevation,
        "sun_azimuth": azimuth,
        "flux_column": ("flux_column", around, {"units": units}),
    }
    return xr.Dataset({"flux_map": (dims, values)}, labels)


def test_flux_maps_begin_in_the_south_and_go_east(tmp_path):
    maps = shares(flux(4))
    written = np.array(rows(write_table(maps, tmp_path / "f.csv")), dtype=float)
    assert written.shape == (10, 4)  # as many as rows of efficiency: two elevations, five azimuths with 360
    np.testing.assert_allclose(written.sum(axis=1), 1, rtol=1e-8)
    for row, strength in zip(written, [0.1, 0.1, 0.1, 0.9, 0.1] * 2, strict=True):
        expected = (1 + strength * np.cos(np.radians(np.array([135, 45, 315, 225]) - 60))) / 4
        np.testing.assert_allclose(row, expected, atol=1e-9)


def test_flux_maps_that_are_none(small, tmp_path):
    with pytest.raises(
        StudyError, match=r"output\.flux_map\.columns: must be even, because SAM's columns have edges at south"
    ):
        shares(flux(3))
    with pytest.raises(StudyError, match="no light reaches the receiver for some sun directions"):
        shares(flux(4) * 0)
    with pytest.raises(StudyError, match="unknown form 'generic'; use 'tower' for flux maps"):
        write_table(shares(flux(4)), tmp_path / "f.csv", "generic")
    with pytest.raises(StudyError, match="the result has no flux map: add 'output"):
        heliosweep.flux_maps(small(), AE, azimuth=0, elevation=45)


def test_a_table_of_a_cut_field_is_of_the_heliostats_that_are_kept(small, tmp_path, monkeypatch, capsys):
    """The table of the result, of its study file, and that of a layout with these heliostats are the same."""
    monkeypatch.chdir(tmp_path)
    cut = small(keep={"heliostats": [20, 30], "by": "optical_efficiency"}, tracking="azimuth_elevation",
                layout={"radial_stagger": {"clearance": [13, 15], "inner_radius": 50, "rings": 2}},
                site={"latitude": 40})  # fmt: skip
    folder = run(cut, "cut", report=False).folder
    point = {"kept_heliostats": 20, "clearance": 15}
    table = efficiency_table(folder, point, azimuth=[180, 270], elevation=[30, 60])
    with open_result(folder) as result:
        kept = result.sel(kept_heliostats=20, clearance=15)
        places = {axis: kept[axis].to_numpy()[kept.kept.to_numpy() == 1].tolist() for axis in "xyz"}
    assert len(places["x"]) == 20
    with open_result(folder) as result:
        table_of_kept = kept_field(result, point)["layout"]
    assert table_of_kept["x"] == places["x"]
    assert set(table_of_kept["width"]) == {small().heliostat.width}
    alone = small(layout=places, site=None, tracking="azimuth_elevation",
                  time={"clock": "sun", "azimuth": [180, 270], "elevation": [30, 60]})  # fmt: skip
    expected = build(alone).field_optical_efficiency.transpose("sun_elevation", "sun_azimuth")
    np.testing.assert_allclose(table, expected, rtol=1e-12)
    arguments = ["table", "cut", "-o", "t.csv", "--azimuth", "180", "--elevation", "30"]
    assert main(arguments) == 2
    assert "choose one value of" in capsys.readouterr().err
    selected = [word for key, value in point.items() for word in ("--select", f"{key}={value}")]
    assert main([*arguments, *selected]) == 0
    assert float(rows(tmp_path / "t.csv")[0][2]) == pytest.approx(float(table[0, 0]), abs=1e-9)
