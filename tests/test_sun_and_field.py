"""Public functions on the sun and on fields without optics, against pvlib, closed forms and traced rays."""

import numpy as np
import pandas as pd
import pvlib
import pytest

import heliosweep

FIELD = [(x, y, 4.0) for y in (60.0, 68.0, 76.0) for x in (-9.0, 0.0, 9.0)]


def test_position_agrees_with_pvlib():
    times = pd.date_range("2026-03-01", periods=40, freq="7h31min", tz="Etc/GMT+3")
    found = heliosweep.sun_position(times, 37.09, -2.36, 500.0)
    wanted = pvlib.solarposition.spa_python(times, 37.09, -2.36, 500.0, delta_t=None)
    assert found.sun_elevation.values == pytest.approx(wanted.elevation.to_numpy(), abs=1e-6)
    assert found.sun_azimuth.values == pytest.approx(wanted.azimuth.to_numpy(), abs=2e-6)
    assert found.time.values[0] == np.datetime64("2026-03-01T03:00")


def test_solar_time():
    found = heliosweep.sun_position_solar(30.0, [6.0, 12.0, 18.0], declination=[-23.45, 0.0, 23.45])
    assert found.sun_elevation.dims == ("declination", "solar_hour")
    assert found.sun_elevation.sel(solar_hour=12.0).values == pytest.approx([36.55, 60.0, 83.45], abs=1e-9)
    assert found.sun_azimuth.sel(declination=0.0).values == pytest.approx([90.0, 180.0, 270.0], abs=1e-9)
    spring = heliosweep.sun_position_solar(30.0, 12.0, day=81)  # Cooper: declination 0
    assert spring.sun_elevation.ndim == 0
    assert float(spring.sun_elevation) == pytest.approx(60.0, abs=1e-9)


@pytest.mark.parametrize("tracking", ["azimuth_elevation", "spinning_elevation"])
def test_field_agrees_with_rays(tracking):
    sides = {"width": 6.0, "height": 5.0, "tracking": tracking}
    azimuth, elevation = [100.0, 180.0, 250.0], [12.0, 18.0, 35.0]
    exact = heliosweep.field_efficiency(FIELD, azimuth, elevation, aim=25.0, **sides)
    receiver = heliosweep.Rectangle(25.0, 8.0, 8.0)
    rays = heliosweep.trace_field(FIELD, receiver, azimuth, elevation, focus="flat", rays=16_384, **sides)
    assert exact.optical_efficiency.min() < 0.5  # some mirrors are shaded
    for name in ("cosine_efficiency", "shading_efficiency", "blocking_efficiency", "optical_efficiency"):
        # The disc of the sun softens the edges of shadows.
        assert exact[name].values == pytest.approx(rays[name].values, abs=5e-3)


def test_labels_and_night():
    table = pd.DataFrame(FIELD, columns=list("xyz"), index=[f"A{i}" for i in range(9)])
    found = heliosweep.field_efficiency(table, [180.0, 180.0], [30.0, -1.0], width=6.0, height=5.0, aim=25.0)
    assert found.heliostat.values[0] == "A0"
    assert found.cosine_efficiency.isel(time=1).isnull().all()
    single = heliosweep.field_efficiency(table, 180.0, 30.0, width=6.0, height=5.0, aim=(0.0, 0.0, 25.0))
    assert single.identical(found.isel(time=0))
