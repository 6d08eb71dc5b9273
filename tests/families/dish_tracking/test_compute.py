"""The family: windows on real clocks, the polar night, statistics, the tolerable tilt."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from pvlib import solarposition

import heliosweep
from heliosweep.families.dish_tracking.compute import windows_of
from heliosweep.families.dish_tracking.study import Ephemeris
from heliosweep.kernels import dish
from heliosweep.kernels.dish import pack_windows
from tests.families import studies

SMALL: dict[str, Any] = {
    "family": "dish_tracking", "site": {"latitude": 40.13, "longitude": 94.67},
    "time": {
        "clock": "civil", "timezone": "+08:00", "dates": ["2021-03-20", "2021-06-21", "2021-06-22", "2021-12-21"],
        "window": {"start": "07:00", "stop": "21:00", "step": "1 h"}, "sampling": "left",
    },
    "mount": {"model": "rigid"},
    "errors": {"axis_tilt": [0.05, 0.1], "axis_tilt_direction": {"start": 0, "stop": 270, "step": 90}}, "tolerance": 4,
}  # fmt: skip


study = partial(studies.study, SMALL)
CONCENTRATOR: dict[str, Any] = {
    "weather": "pvlib:data/723170TYA.CSV", "focal_length": 6, "diameter": 10, "aperture_radius": [0.08, 0.06],
    "spread": 4,
}  # fmt: skip


def computed(**blocks: Any) -> Any:
    return studies.computed(study(**blocks))


def time(**changes: Any) -> dict[str, Any]:
    return {**SMALL["time"], **changes}


def pvlib_sun(latitude: float, longitude: float, stamps: np.ndarray) -> np.ndarray:
    import pandas as pd

    position = solarposition.spa_python(pd.DatetimeIndex(stamps, tz="UTC"), latitude, longitude, delta_t=None)
    elevation, azimuth = np.radians(position["elevation"]), np.radians(position["azimuth"])
    return np.column_stack(
        [np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)]
    )


def test_time_series_are_the_errors_of_the_window_and_the_sun_of_pvlib():
    zones: dict[str, Any] = {
        "sites": [{"name": "a", "latitude": 40, "longitude": 95, "timezone": "+08:00"}],
        "site": None,
    }
    zones["sites"].append({"name": "b", "latitude": -20, "longitude": 10, "timezone": "Europe/Berlin"})
    local = {key: value for key, value in time().items() if key != "timezone"}
    for blocks, clocks in (({}, "time"), (zones | {"time": local}, "utc")):
        result = computed(output={"time_series": True}, **blocks)
        assert result["tracking_error"].dims[-3:] == ("axis_tilt", "axis_tilt_direction", "time")
        day = result["tracking_error"].isel(time=slice(14, 28))  # the windows of 14 steps follow each other
        np.testing.assert_allclose(day.mean("time"), result["mean_tracking_error"].isel(date=1), rtol=1e-12)
        np.testing.assert_allclose(day.max("time"), result["max_tracking_error"].isel(date=1), rtol=1e-12)
        place = result.isel(site=1) if clocks == "utc" else result
        stamps = place[clocks].to_numpy()
        east, north, up = pvlib_sun(float(place["latitude"]), float(place["longitude"]), stamps).T
        np.testing.assert_allclose(place["solar_elevation"], np.degrees(np.arcsin(up)), rtol=0, atol=1e-6)
        turn = place["solar_azimuth"] - np.degrees(np.arctan2(east, north))
        np.testing.assert_allclose((turn + 180) % 360 - 180, 0.0, rtol=0, atol=1e-5)
    light = computed(output={"time_series": True}, time=time(daylight_only=True))
    night = light["solar_elevation"] <= 0
    assert night.any()
    np.testing.assert_array_equal(light["tracking_error"].isnull().any(["axis_tilt", "axis_tilt_direction"]), night)


def test_further_errors_of_the_mount_are_swept():
    """Against the kernel; a collimation error is the home offset in azimuth with the other sign."""
    further = {"azimuth_reference": [0, 0.1], "non_orthogonality": [-0.2, 0.1], "collimation": [0, 0.3]}
    result = computed(errors={"axis_tilt": 0.1, "axis_tilt_direction": 30, "home_azimuth_offset": 0.1, **further})
    factor = result["effective_tracking_factor"]
    assert factor.dims == (*further, "date")
    stamps = np.datetime64("2021-06-20T23:00") + np.arange(14) * np.timedelta64(1, "h")
    windows = pack_windows(pvlib_sun(40.13, 94.67, stamps), [0, stamps.size])
    angles = dict(zip(further, np.radians([0.1, -0.2, 0.3]), strict=True))
    errors = dish.window_errors(dish.RIGID, windows, *np.radians([0.1, 30.0, 0.1]), **angles)
    found = factor.sel(date="2021-06-21", azimuth_reference=0.1, non_orthogonality=-0.2, collimation=0.3)
    assert float(found) == pytest.approx(1 - float(errors[0][0]) / 4e-3, abs=1e-7)
    assert "collimation" not in computed().coords


def test_statistics_are_those_of_pandas():
    result, point = computed(), {"axis_tilt": 0.1, "axis_tilt_direction": 90}
    factor, at = result["effective_tracking_factor"], result.sel(point)
    series = factor.sel(point).to_series()
    for name, expected in (("mean_over_dates", series.mean()), ("std_over_dates", series.std()),
                           ("min", series.min()), ("max", series.max())):  # fmt: skip
        assert float(at[f"effective_tracking_factor_{name}"]) == pytest.approx(expected, rel=1e-12)
    assert at["date_of_min"].values == series.idxmin()
    assert at["date_of_max"].values == series.idxmax()
    monthly = series.groupby(series.index.strftime("%Y-%m"))
    assert result["month"].values.tolist() == ["2021-03", "2021-06", "2021-12"]
    np.testing.assert_allclose(at["monthly_effective_tracking_factor_mean"], monthly.mean(), rtol=1e-12)
    np.testing.assert_allclose(at["monthly_effective_tracking_factor_std"], monthly.std(), rtol=1e-9)
    tilted = result.sel(axis_tilt=0.1)
    means = tilted["monthly_effective_tracking_factor_mean"].transpose("month", ...).to_pandas()
    day = factor.sel(date="2021-06-21", axis_tilt=0.1).to_series()
    for word in ("mean", "std"):
        over = tilted[f"monthly_effective_tracking_factor_{word}_over_directions"]
        np.testing.assert_allclose(over, getattr(means, word)(axis=1), rtol=1e-12)
        over = tilted.sel(date="2021-06-21")[f"effective_tracking_factor_{word}_over_directions"]
        assert float(over) == pytest.approx(getattr(day, word)(), rel=1e-12)
    annual = tilted["effective_tracking_factor_mean_over_dates"].to_series()
    worst = annual.index[annual < annual.min() + 1e-12][0]
    assert float(tilted["worst_axis_tilt_direction"]) == worst


def test_polar_night_is_missing_and_flagged():
    result = computed(
        site={"latitude": [40, 80], "longitude": 0},
        time=time(timezone="+00:00", daylight_only=True, window={"start": "00:00", "stop": "24:00", "step": "1 h"}),
    )
    flags = result["window_is_empty"]
    assert flags.dtype == np.int8
    assert flags.sel(latitude=80, date="2021-12-21") == 1
    assert flags.sum() == 1
    factor = result["effective_tracking_factor"]
    assert factor.sel(latitude=80, date="2021-12-21").isnull().all()
    assert factor.isnull().sum() == factor.sel(latitude=80, date="2021-12-21").size
    assert result["effective_tracking_factor_mean_over_dates"].notnull().all()


def test_sunrise_to_sunset_is_the_sun_s_own_window():
    window = {"start": "sunrise", "stop": "sunset", "step": "10 min"}
    block = study(time=time(window=window, sampling="inclusive")).time
    windows = windows_of(block, Ephemeris(), "+08:00", (40.13, 94.67, 0.0))
    ends = windows.rows[3]
    assert ends.min() > -1e-9  # rises and sets at the geometric horizon, to nanoseconds
    assert np.sum(np.abs(ends) < 1e-9) == 8
    daylight = computed(
        time=time(window={"start": "00:00", "stop": "24:00", "step": "1 min"}, sampling="midpoint", daylight_only=True)
    )
    sunlit = computed(time=time(window=window, sampling="midpoint"))
    np.testing.assert_allclose(sunlit["effective_tracking_factor"], daylight["effective_tracking_factor"], atol=2e-3)


def test_tolerable_tilt_meets_the_required_factor():
    required = [0.5, 0.8]
    result = computed(
        statistics={"required_factor": required}, errors={"axis_tilt": 0.1, "axis_tilt_direction": [0, 90]}
    )
    assert result["tolerable_axis_tilt"].dims == ("axis_tilt_direction", "required_factor")
    for direction in (0, 90):
        for factor in required:
            tilt = float(result["tolerable_axis_tilt"].sel(required_factor=factor, axis_tilt_direction=direction))
            there = computed(errors={"axis_tilt": tilt, "axis_tilt_direction": direction})
            assert float(there["effective_tracking_factor_min"]) == pytest.approx(factor, abs=1e-10)


@pytest.mark.parametrize(
    ("window", "share"),
    [(("00:00", "24:00"), 50), (("09:00", "15:00"), 0), (("20:00", "24:00"), 100), ("sunrise_to_sunset", 0)],
)
def test_a_window_into_the_night_is_warned_of(window, share):
    """At the equinox on the equator, where the sun is up from 6 to 18 h."""
    if isinstance(window, tuple):
        window = dict(zip(("start", "stop"), window, strict=True)) | {"step": "10 min"}
    blocks = {"site": {"latitude": 0, "longitude": 0}}
    time_of = {"clock": "civil", "timezone": "+00:00", "dates": ["2021-03-20"], "window": window}
    notes = list(study(time=time_of, **blocks).notes())
    assert len(notes) == (share > 0)
    assert all(f"about {share} % of the instants" in note and "daylight_only" in note for note in notes)
    assert not list(study(time={**time_of, "daylight_only": True}, **blocks).notes())


def test_the_energy_of_a_year_counts_the_hours_of_the_weather_file():
    """Against sums of the public functions over pvlib's reading of the file; nothing is lost without errors."""
    import pvlib

    site = {"latitude": 36.1, "longitude": -79.95}
    errors = {"axis_tilt": [0, 0.2], "axis_tilt_direction": [0, 90]}
    result = computed(site=site, errors=errors, concentrator=CONCENTRATOR)
    assert result["energy_loss"].dims == ("axis_tilt", "axis_tilt_direction", "aperture_radius")
    assert not result["energy_loss"].sel(axis_tilt=0).any()
    assert (result["energy_loss"].sel(axis_tilt=0.2) > 0.02).all()
    path = Path(pvlib.__file__).parent / "data" / "723170TYA.CSV"
    file, _ = pvlib.iotools.read_tmy3(path, map_variables=True)
    middle = file.index - pd.Timedelta("30min")
    sun = pvlib.solarposition.get_solarposition(middle, site["latitude"], site["longitude"])
    lit = (sun["elevation"] > 0).to_numpy()
    error = heliosweep.tracking_error(sun["azimuth"].to_numpy()[lit], sun["elevation"].to_numpy()[lit], 0.2, 90)
    dni = file["dni"].to_numpy()[lit]
    for radius in CONCENTRATOR["aperture_radius"]:
        dish = {key: value for key, value in CONCENTRATOR.items() if key != "weather"} | {"aperture_radius": radius}
        intercept = heliosweep.dish_intercept(error, **dish)
        here = result.sel(axis_tilt=0.2, axis_tilt_direction=90, aperture_radius=radius)
        assert float(here["intercept_efficiency"]) == pytest.approx(np.average(intercept, weights=dni), abs=1e-4)
        lost = 1 - np.average(intercept, weights=dni) / heliosweep.dish_intercept(0.0, **dish)
        assert float(here["energy_loss"]) == pytest.approx(lost, abs=1e-4)
        energy = 1e-6 * np.sum(intercept * dni) * np.pi * 25
        assert float(here["aperture_energy"]) == pytest.approx(energy, rel=1e-3)
