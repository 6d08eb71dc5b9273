"""The family: sweeps of every kind, sites, layouts, night, and what its means mean."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from pvlib import solarposition

from heliosweep import api
from heliosweep.kernels import sun
from heliosweep.kernels.field import efficiency as field
from heliosweep.kernels.field import packets as mounts
from tests.families.studies import computed

CIVIL = {
    "clock": "civil",
    "timezone": "+01:00",
    "dates": ["2021-06-21"],
    "window": {"start": "00:00", "stop": "24:00", "step": "2 h"},
    "sampling": "left",
}


def test_one_point_is_the_kernel_s_sum_over_the_instants(small):
    study = small(site={"latitude": 40}, tracking="azimuth_elevation")
    result = computed(study)
    assert result["optical_efficiency"].dims == ("heliostat",)
    x, y = result["x"].to_numpy(), result["y"].to_numpy()
    days, hours = np.repeat(study.time.day_numbers(), 11), np.tile(study.time.solar_hours(), 2)
    vectors = sun.solar_clock(np.radians(40), sun.declination_cooper(days), hours)
    z, half = np.full(x.size, 5.0), np.ones(x.size)
    mirrors = field.sorted_field(x, y, z, 4.5 * half, 4.0 * half, 60.0)
    sums, count = field.field_sums(mirrors, mounts.AZIMUTH_ELEVATION, vectors, 0, x.size)
    assert 0 < count < vectors.shape[0]  # the winter sun is down at 7 h
    names = ("cosine_efficiency", "shading_efficiency", "blocking_efficiency", "optical_efficiency")
    np.testing.assert_array_equal(result["factored_efficiency"], sums[:, 4] / count)
    for name, total in zip(names, sums[:, :4].T, strict=True):
        np.testing.assert_array_equal(result[name], total / count)
        assert float(result[f"field_{name}"]) == pytest.approx(float(np.mean(total / count)), rel=1e-14)


def test_every_scalar_can_be_swept_and_a_sweep_is_the_sum_of_its_points(small):
    swept = small(
        site={"latitude": [-20, 35]},
        heliostat={"width": [6, 9], "height": [5, 8], "pivot_height": [4, 5]},
        receiver={"height": [50, 60]},
    )
    whole = computed(swept)
    assert dict(whole.sizes) == {
        "latitude": 2, "tracking": 2, "heliostat_width": 2, "heliostat_height": 2, "pivot_height": 2,
        "receiver_height": 2, "heliostat": whole.sizes["heliostat"],
    }  # fmt: skip
    point = {"latitude": 35, "heliostat_width": 6, "heliostat_height": 8, "pivot_height": 4, "receiver_height": 50}
    single = computed(
        small(
            site={"latitude": 35},
            tracking="spinning_elevation",
            heliostat={"width": 6, "height": 8, "pivot_height": 4},
            receiver={"height": 50},
        )
    )
    for name in single.data_vars:
        np.testing.assert_array_equal(whole[name].sel(tracking="spinning_elevation", **point), single[name])


def test_layout_files_can_be_swept_and_keep_their_columns(small, tmp_path):
    (tmp_path / "a.csv").write_text("x,y,row,name\n0,50,1,first\n20,50,1,second\n")
    (tmp_path / "b.csv").write_text("x,y,row,name\n0,60,2,third\n")
    result = computed(small(layout={"file": [str(tmp_path / "a.csv"), str(tmp_path / "b.csv")]}))
    assert result["optical_efficiency"].dims == ("latitude", "tracking", "layout", "heliostat")
    assert result["name"].values.tolist() == [["first", "second"], ["third", ""]]


def test_civil_clock_follows_pvlib(small):
    site = {"latitude": 37.4, "longitude": -6.25, "altitude": 20}
    result = computed(small(site=site, time=CIVIL, output={"time_series": True}))
    stamps = result["time"].to_index().tz_localize("UTC")
    expected = solarposition.spa_python(stamps, 37.4, -6.25, altitude=20, delta_t=None)
    up = expected["elevation"].to_numpy() > 0
    night = result["instantaneous_cosine_efficiency"].isnull().all(["tracking", "heliostat"])
    np.testing.assert_array_equal(~night, up)
    elevation, azimuth = np.radians(expected["elevation"]), np.radians(expected["azimuth"])
    s = np.column_stack([np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)])
    to_target = np.column_stack([-result["x"], -result["y"], np.full(result.sizes["heliostat"], 55.0)])
    r = to_target / np.linalg.norm(to_target, axis=1, keepdims=True)
    cosine = np.sqrt((1 + s @ r.T) / 2)
    shown = result["instantaneous_cosine_efficiency"].sel(tracking="spinning_elevation")
    np.testing.assert_allclose(shown.values[up], cosine[up], atol=1e-12)


def test_named_sites_are_a_dimension(small, tmp_path):
    sites = [
        {"name": "Sevilla", "latitude": 37.4, "longitude": -6.25, "timezone": "Europe/Madrid"},
        {"name": "Dunhuang", "latitude": 40.1, "longitude": 94.7, "timezone": "Asia/Shanghai"},
    ]
    time = {key: value for key, value in CIVIL.items() if key != "timezone"}
    result = computed(small(site=None, sites=sites, time=time))
    assert result["field_optical_efficiency"].dims == ("site", "tracking")
    assert result["site"].values.tolist() == ["Sevilla", "Dunhuang"]
    assert result["latitude"].values.tolist() == [37.4, 40.1]
    (tmp_path / "sites.csv").write_text(
        "name,latitude,longitude,timezone\nSevilla,37.4,-6.25,Europe/Madrid\nDunhuang,40.1,94.7,Asia/Shanghai\n"
    )
    table = computed(small(site=None, sites={"file": str(tmp_path / "sites.csv")}, time=time))
    np.testing.assert_array_equal(table["field_optical_efficiency"], result["field_optical_efficiency"])


def test_series_of_a_shorter_site_are_padded_with_nan(small, tmp_path):
    """Two sites of 8,760 and 8,784 hours: a mean over the instants must not count zeros for hours that do not exist."""
    for letter, year in (("a", 2021), ("b", 2020)):
        hours = pd.date_range(f"{year}-01-01 00:30", f"{year}-12-31 23:30", freq="h")
        lines = [f"{hour.isoformat()}-07:00,{800 if 8 <= hour.hour < 16 else 0}" for hour in hours]
        text = "# latitude: 33.45\n# longitude: -111.98\n# timezone: -07:00\ntime,dni\n" + "\n".join(lines)
        (tmp_path / f"{letter}.csv").write_text(text, encoding="utf-8")
    files = [str(tmp_path / f"{name}.csv") for name in "ab"]
    site = {"latitude": 33.45, "longitude": -111.98}
    study = small(
        site=site, tracking="azimuth_elevation", time={"clock": "weather"}, weather={"file": files, "label": "middle"},
        layout={"radial_stagger": {"clearance": 13, "inner_radius": 50, "heliostats": 2}},
        output={"field_series": True},
    )  # fmt: skip
    with api.run(study, tmp_path / "out", report=False).open() as result:
        shorter = result.isel(weather=0)
        padded = shorter["utc"].isnull().to_numpy()
        assert padded.sum() == 24
        for name, item in shorter.data_vars.items():
            if "time" in item.dims and item.dtype.kind == "f":
                assert np.isnan(item.to_numpy()[padded]).all(), name
        assert float(shorter["dni"].mean("time")) == pytest.approx(800 / 3)
