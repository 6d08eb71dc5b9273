"""Public functions on energy: the chain, sums of months, and the air."""

from typing import Any

import numpy as np
import pytest
import xarray as xr

import heliosweep


def test_a_chain_by_hand():
    """Two heliostats at three hours, the last of which the field does not work."""
    chain: dict[str, Any] = {
        "cosine": [[0.8, 0.6], [0.9, 0.7], [1.0, 1.0]],
        "attenuation": [[0.95, 0.9]],
        "intercept": [0.9, 0.8, 1.0],
    }
    found = heliosweep.annual_energy(
        [1000.0, 500.0, 800.0], [1.0, 2.0, 1.0], chain, [100.0, 50.0], month=[1, 1, 2], works=[True, True, False]
    )
    first = 1e-6 * 100 * 0.95 * (1000 * 0.8 * 0.9 + 1000 * 0.9 * 0.8)
    second = 1e-6 * 50 * 0.9 * (1000 * 0.6 * 0.9 + 1000 * 0.7 * 0.8)
    assert found.receiver_energy.values == pytest.approx([first, second], rel=1e-14)
    assert float(found.field_energy) == pytest.approx(first + second)
    assert found.incident_energy.values == pytest.approx([0.28, 0.14])
    assert found.loss.sel(stage="stow").values == pytest.approx([0.08, 0.04])
    assert found.loss.sum("stage").values == pytest.approx((found.incident_energy - found.receiver_energy).values)
    assert found.monthly_receiver_energy.sel(month=1).values == pytest.approx([first, second])
    assert not found.monthly_receiver_energy.sel(month=slice(2, None)).any()
    assert all(each.attrs["units"] == "MWh" for each in found.values())


def test_a_year_of_traced_instants_is_a_traced_year():
    receiver = heliosweep.Cylinder(50.0, 3.0, 5.0)
    given: dict[str, Any] = {"width": 6.0, "height": 5.0, "slope_error": 2.0, "rays": 256, "seed": 3}
    places = [(0.0, 60.0, 4.0), (10.0, 60.0, 4.0), (0.0, 70.0, 4.0)]
    azimuth, elevation, dni = [120.0, 180.0, 240.0], [30.0, 50.0, 30.0], np.array([600.0, 900.0, 700.0])
    light = heliosweep.trace_field(places, receiver, azimuth, elevation, **given)
    chain = {"optical": light.optical_efficiency, "intercept": light.intercept_efficiency}
    found = heliosweep.annual_energy(dni, 1.0, chain, 30.0)
    wanted = heliosweep.trace_year(places, receiver, azimuth, elevation, 1e-6 * dni, **given)
    assert found.receiver_energy.values == pytest.approx(wanted.receiver_energy.values, rel=1e-12)


def test_transmittance():
    # At 1 km; published coefficients of Kistler (1986), Leary and Hankins (1979), Ballestrin and Marzo (2012).
    wanted = {
        "delsol_clear": 0.902766, "delsol_hazy": 0.746210, "leary_hankins": 0.895310, "ballestrin_clear": 0.861913,
        "ballestrin_hazy": 0.569813, "none": 1.0, "vant_hull": 0.850984,
    }  # fmt: skip
    for model, value in wanted.items():
        assert heliosweep.transmittance(1000.0, model) == pytest.approx(value, abs=1e-6)
    slant = xr.DataArray([500.0, 1500.0, 5000.0], {"heliostat": [3, 4, 5]}, "heliostat")
    found = heliosweep.transmittance(slant, "leary_hankins")
    assert found.heliostat.values.tolist() == [3, 4, 5]
    assert found.values[2] == pytest.approx(np.exp(-0.1106 * 5.0))
    assert heliosweep.transmittance(np.array([1e5]), "delsol_hazy")[0] == 1.0


def test_heat_of_a_receiver():
    """Absorbed light less losses; a table is interpolated; a receiver that loses more is not in operation."""
    power = xr.DataArray([0.0, 1.0, 10.0, np.nan], dims="time")
    heat = heliosweep.receiver_heat(power, 0.9, 2.0)
    assert heat.dims == ("time",)
    np.testing.assert_allclose(heat, [0.0, 0.0, 7.0, np.nan])
    found = heliosweep.receiver_heat([5.0, 20.0], 0.9, table=[[0.0, 10.0], [1.0, 3.0]])
    np.testing.assert_allclose(found, [4.5 - 2.0, 18.0 - 3.0])
    assert heliosweep.receiver_heat(10.0) == 10.0


def test_error_budgets_need_the_same_causes_in_any_order():
    with pytest.raises(ValueError, match="at least one"):
        heliosweep.error_budget(100.0, 90.0, {})
    with pytest.raises(ValueError, match="must have the same causes"):
        heliosweep.error_budget(100.0, 90.0, {"dirt": 95.0}, without={"air": 95.0})
    alone: dict[str, Any] = {"dirt": np.array([95.0, 96.0]), "air": 97.0}
    found = heliosweep.error_budget([100.0, 100.0], [91.0, 93.0], alone, without={"air": 94.0, "dirt": 96.5})
    assert found.loss.values.tolist() == [[5.0, 3.0, 1.0], [4.0, 3.0, 0.0]]
    assert found.gain.sel(cause="dirt").values.tolist() == [5.5, 3.5]
