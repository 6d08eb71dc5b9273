"""Public functions on the light of a field: shapes, labels, refusals, examples."""

from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import heliosweep
from heliosweep import light
from heliosweep.kernels import rays
from tests.kernels.rays.fields import REFERENCE, SUNS, field

PLACES = [(0.0, 60.0, 4.0), (10.0, 60.0, 4.0), (0.0, 70.0, 4.0)]
RECEIVER = heliosweep.Cylinder(height=50.0, radius=3.0, height_extent=5.0)
FACE = heliosweep.Rectangle(height=50.0, width=6.0, height_extent=5.0)
SIDES: dict[str, Any] = {"width": 6.0, "height": 5.0}


def test_an_instant_of_a_reference_field():
    made, _ = field("canted_focused")
    receiver = heliosweep.Rectangle(60.0, 7.0, 7.0, azimuth=0.0, tilt=-20.0)
    found = heliosweep.trace_field(
        pd.DataFrame(REFERENCE["canted_focused_place"], columns=list("xyz"), index=np.arange(100, 182)), receiver,
        [180.0, 120.0], [55.0, 22.0], width=9.0, height=7.0, facets=(3, 2, 0.0), canting="on_axis", slope_error=1.2,
        specularity_error=0.3, sun_shape="limb_darkened", rays=16_384, flux_map=(20, 36),
    )  # fmt: skip
    wanted, cells = REFERENCE["canted_focused_heliostats"], REFERENCE["canted_focused_map"]
    assert found.heliostat.values.tolist() == list(range(100, 182))
    for k, name in enumerate(("cosine", "shading", "blocking")):
        assert found[f"{name}_efficiency"].values == pytest.approx(wanted[:2, :, k], abs=3e-3)
    assert found.receiver_efficiency.values == pytest.approx(wanted[:2, :, 5], abs=3e-3)
    product = found.optical_efficiency * found.intercept_efficiency
    assert found.receiver_efficiency.values == pytest.approx(product.values, rel=1e-12)
    area = 49.0 / 720
    assert found.flux_map.values == pytest.approx(cells[:2] / area, abs=0.02 * float(cells[:2].max()) / area)
    assert found.peak_flux.values == pytest.approx(cells[:2].max(axis=(1, 2)) / area, rel=0.01)
    power = (found.receiver_efficiency * 63.0).sum("heliostat")
    assert (found.flux_map.sum(("flux_row", "flux_column")) * area).values == pytest.approx(power.values, rel=1e-12)
    assert np.array_equal(light.mirror_area(made.sides[:, 0], made.sides[:, 1], made.facets), np.full(82, 63.0))
    assert not rays.trace(made, SUNS[:0]).sums.any()


def test_a_year_of_a_reference_field():
    sun, weight = REFERENCE["year_sun"], REFERENCE["year_weight"]
    receiver = heliosweep.Rectangle(45.0, 9.0, 9.0, tilt=-10.0)
    found = heliosweep.trace_year(
        REFERENCE["flat_polar_place"], receiver, np.degrees(np.arctan2(sun[:, 0], sun[:, 1])),
        np.degrees(np.arcsin(sun[:, 2])), weight, width=7.0, height=7.0, focus="flat", slope_error=0.8,
        reflectivity=0.9, transmittance=0.95, flux_map=(20, 36),
    )  # fmt: skip
    wanted, cells = REFERENCE["flat_polar_year_heliostats"][0], REFERENCE["flat_polar_year_map"][0]
    energy = 49.0 * wanted[:, 5].sum() * weight.sum() * 0.9 * 0.95
    assert float(found.field_energy) == pytest.approx(energy, rel=2e-4)
    assert found.attrs["rays"] == 256
    assert found.optical_efficiency.values == pytest.approx(wanted[:, 3], abs=2e-3)
    assert found.flux_map.values == pytest.approx(
        cells * 720 / 81 * 0.9 * 0.95, abs=0.015 * float(cells.max()) * 720 / 81
    )
    assert float(found.field_energy_error) < 2e-4 * energy


def test_labels_of_data_arrays_and_series():
    times = pd.date_range("2025-06-21T08:00", periods=3, freq="3h")
    azimuth = xr.DataArray([100.0, 160.0, 250.0], {"time": times}, "time")
    found = heliosweep.trace_field(PLACES, RECEIVER, azimuth, [30.0, 60.0, -5.0], rays=64, **SIDES)
    assert found.optical_efficiency.dims == ("time", "heliostat")
    assert np.array_equal(found.time.values, times.values)
    assert found.optical_efficiency.isnull().any("heliostat").values.tolist() == [False, False, True]
    assert all({"units", "long_name"} <= set(each.attrs) for each in found.values())
    series = pd.Series([100.0, 160.0, 250.0], times)
    again = heliosweep.trace_field({"x": [0.0], "y": [60.0], "z": [4.0]}, RECEIVER, series, 30.0, rays=64, **SIDES)
    assert np.array_equal(again.time.values, times.values)
    single = heliosweep.trace_field(PLACES, RECEIVER, 180.0, 40.0, rays=64, **SIDES)
    assert single.optical_efficiency.dims == ("heliostat",)


def test_holes_of_a_slope_map_keep_the_blockers():
    close, at = [(0.0, 60.0, 4.0), (0.0, 66.0, 4.0)], np.linspace(-3.0, 3.0, 5)
    slope = np.full((5, 5, 2), 0.5)
    holes = slope.copy()
    holes[2, 2] = np.nan
    a, b = (
        heliosweep.trace_field(close, RECEIVER, 180.0, 20.0, rays=256, slope_map=(at, at, each), **SIDES)
        for each in (slope, holes)
    )
    assert a.blocking_efficiency.values[1] < 0.9
    assert a.equals(b)


def test_the_image_of_a_sphere_is_the_mirror_times_one_minus_the_cosine():
    """A point sun at 35 deg of incidence: astigmatism is the same along both axes, for both tracking methods."""
    receiver = heliosweep.Rectangle(4.0, 8.0, 8.0)
    given: dict[str, Any] = {"width": 10.0, "height": 10.0, "sun_shape": ("table", [0.0, 0.01], [1.0, 1.0])}
    cell = 0.05 * np.arange(160)
    blur = 10.0 * (1.0 - np.cos(np.radians(35.0))) / np.sqrt(6.0)
    for tracking in ("spinning_elevation", "azimuth_elevation"):
        found = heliosweep.trace_field(
            [(0.0, 100.0, 4.0)], receiver, 180.0, 70.0, tracking=tracking, rays=2**16, flux_map=(160, 160), **given
        )
        radius = heliosweep.image_radius(found.flux_map.assign_coords(flux_row=cell, flux_column=cell))
        assert float(radius) == pytest.approx(blur, rel=0.01)
        assert radius.units == "m"


def test_hflcal_is_exact_for_a_point_mirror():
    from scipy.stats import norm

    receiver = heliosweep.Rectangle(50.0, 3.0, 2.0)
    given: dict[str, Any] = {"width": 1e-3, "height": 1e-3, "specularity_error": 2.0, "sun_shape": "gaussian"}
    found = heliosweep.hflcal([(0.0, 400.0, 50.0)], receiver, 180.0, 1e-6, **given)
    spread = 400.0 * np.hypot(2e-3, 2.73e-3)
    wanted = np.prod([2.0 * norm.cdf(half / spread) - 1.0 for half in (1.5, 1.0)])
    assert found[0, 0] == pytest.approx(wanted, rel=1e-9)
