"""Electricity behind an efficiency table needs nrel-pysam, and grows with the efficiency."""

from __future__ import annotations

import sys

import numpy as np
import pytest
import xarray as xr

import heliosweep


def tables(efficiency: float) -> tuple[xr.DataArray, xr.DataArray]:
    labels = {"sun_elevation": np.arange(10, 91, 10.0), "sun_azimuth": np.arange(0, 361, 15.0)}
    table = xr.DataArray(np.full((9, 25), efficiency), labels, dims=("sun_elevation", "sun_azimuth"))
    return table, (table * 0 + 1 / 12).expand_dims(flux_column=12, axis=2)


def test_without_pysam(monkeypatch):
    monkeypatch.setitem(sys.modules, "PySAM", None)
    with pytest.raises(heliosweep.HeliosweepError, match="pip install nrel-pysam"):
        heliosweep.tower_electricity(*tables(0.5), "site.csv", [[0.0, 100.0]], 100.0)


def test_of_sam(tmp_path):
    pytest.importorskip("PySAM", reason="nrel-pysam is not installed")
    lines = ["Latitude,Longitude,Time Zone,Elevation", "35,-116.8,-8,500"]
    lines.append("Year,Month,Day,Hour,Minute,DNI,DHI,GHI,Tdry,Tdew,RH,Pres,Wspd,Wdir,Albedo")
    for day in np.arange("2001-01-01", "2002-01-01", dtype="datetime64[D]").tolist():
        for hour in range(24):
            beam = 900 if 7 <= hour < 17 else 0
            start = f"{day.year},{day.month},{day.day},{hour},30"
            lines.append(f"{start},{beam},{beam // 9},{beam * 8 // 9},20,5,30,950,1,0,0.2")
    (tmp_path / "weather.csv").write_text("\n".join([*lines, ""]))
    angle, radius = np.meshgrid(np.radians(np.arange(0, 360, 3.6)), np.arange(150, 1500, 15.0))
    place = np.stack([(radius * np.sin(angle)).ravel(), (radius * np.cos(angle)).ravel()], axis=1)
    low, high = (heliosweep.tower_electricity(*tables(e), tmp_path / "weather.csv", place, 1.2e6) for e in (0.3, 0.5))
    assert 0.0 < float(low.electricity) < float(high.electricity)
    np.testing.assert_allclose(high.capacity_factor, high.electricity / (103.5 * 8760), rtol=0.02)
    assert float(low.levelized_cost_of_electricity) > float(high.levelized_cost_of_electricity)
