"""Angles of the mounts: mirrors turned by them stand as the field kernel has them; ranges and rates by plain loops."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from heliosweep import api
from heliosweep.errors import StudyError
from heliosweep.families.field_efficiency.values import motion, tracking_angles
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION
from tests.kernels.field.fields import suns
from tests.kernels.field.oracles import frame, unit

METHODS = {"spinning_elevation": SPINNING_ELEVATION, "azimuth_elevation": AZIMUTH_ELEVATION}
MOTION = [
    f"{axis}_angle_{what}" for axis in ("primary", "secondary") for what in ("min", "max", "range", "rate", "travel")
]


def turned(r, angles, tracking):
    """Width axis and normal of a mirror that begins with its normal along the primary axis, by rotations alone."""
    primary, secondary = np.radians(angles)
    north = unit(np.array([r[0], r[1], 0.0]))
    if tracking == AZIMUTH_ELEVATION:  # lying flat, its upper edge to the south; raised about east-west, then clockwise
        width, normal = np.array([-1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
        tilt = Rotation.from_rotvec(-(np.pi / 2 - secondary) * np.array([1.0, 0.0, 0.0]))
        spin = Rotation.from_rotvec(-primary * np.array([0.0, 0.0, 1.0]))
    else:  # facing the target; tilted upwards about the level axis, then clockwise seen from behind
        right = np.array([north[1], -north[0], 0.0])
        width, normal = right, r
        tilt = Rotation.from_rotvec(secondary * right)
        spin = Rotation.from_rotvec(primary * r)
    both = spin * tilt
    return both.apply(width), both.apply(normal)


@pytest.mark.parametrize("tracking", METHODS.values(), ids=METHODS)
def test_a_mirror_turned_by_the_angles_stands_as_that_of_the_kernel(tracking):
    rng = np.random.default_rng(5)
    for r in suns(rng, 20, low=-20.0, high=80.0):
        sky = suns(rng, 50, low=1.0)
        found = tracking_angles(r, sky, tracking)
        for s, angles in zip(sky, found.T, strict=True):
            u, _, n = frame(r, s, tracking)
            width, normal = turned(r, angles, tracking)
            np.testing.assert_allclose(normal, n, atol=1e-12)
            np.testing.assert_allclose(width, u, atol=1e-10)


def by_loops(angle, days, hours):
    """Least, largest, range, rate and travel: instant by instant, then every day tried as that with the least angle."""
    tracks: dict[int, list[tuple[float, float]]] = {}
    rate, travel = math.nan, 0.0
    for value, day, hour in zip(angle, days, hours, strict=True):
        if math.isnan(value):
            continue
        track = tracks.setdefault(day, [])
        if track:
            last, when = track[-1]
            value = min((value + turns * 360 for turns in range(-9, 10)), key=lambda one: abs(one - last))
            travel += abs(value - last)
            rate = max(abs(value - last) / (hour - when), 0.0 if math.isnan(rate) else rate)
        track.append((value, hour))
    ends = [(min(values), max(values)) for values in ([value for value, _ in track] for track in tracks.values())]
    found = []
    for low, _ in ends:
        high = max(high - math.floor((one - low) / 360) * 360 for one, high in ends)
        found.append((high - low, (low + 180) % 360 - 180))
    span, low = min(found)
    return low, low + span, span, rate, travel


def test_ranges_and_rates_are_those_of_plain_loops():
    rng = np.random.default_rng(7)
    for _ in range(50):
        days, hours = np.repeat(np.arange(6), 9), np.tile(np.sort(rng.uniform(6, 18, 9)), 6)
        angle = np.cumsum(rng.normal(0, rng.choice([5, 20, 60]), days.size)) % 360
        angle[rng.random(days.size) < 0.2] = np.nan
        np.testing.assert_allclose(motion(angle, days, hours), by_loops(angle, days, hours), atol=1e-9)


def test_ranges_follow_from_the_series_and_change_no_other_number(small):
    plain, both = (small(output={"time_series": on, "tracking_angles": on}) for on in (False, True))
    assert plain.study_id == both.study_id
    efficiencies, result = (api.build(study).compute() for study in (plain, both))
    assert set(MOTION) < set(result.data_vars) - set(efficiencies.data_vars)
    for name in efficiencies.data_vars:
        np.testing.assert_array_equal(result[name], efficiencies[name])
    days, hours = result["day"].to_numpy(), result["solar_hour"].to_numpy()
    for axis in ("primary", "secondary"):
        series = result[f"instantaneous_{axis}_angle"]
        assert series.isnull().equals(result["instantaneous_cosine_efficiency"].isnull())
        for at in ({"latitude": 0, "tracking": 0, "heliostat": 3}, {"latitude": 1, "tracking": 1, "heliostat": 17}):
            expected = by_loops(series.isel(at).to_numpy(), days, hours)
            found = [float(result[name].isel(at)) for name in MOTION if name.startswith(axis)]
            np.testing.assert_allclose(found, expected, atol=1e-9)


def test_civil_days_are_courses_of_their_own_and_the_polar_night_has_none(small):
    window = {"start": "08:00", "stop": "16:00", "step": "1 h"}
    time = {"clock": "civil", "dates": ["2021-06-20", "2021-06-21"], "window": window}
    sites = [
        {"name": "Longyearbyen", "latitude": -78.2, "longitude": 15.6, "timezone": "+01:00"},
        {"name": "Sevilla", "latitude": 37.4, "longitude": -6.25, "timezone": "+00:00"},
    ]
    output = {"tracking_angles": True, "time_series": True}
    result = api.build(small(site=None, sites=sites, time=time, output=output)).compute()
    assert all(result[name].sel(site="Longyearbyen").isnull().all() for name in MOTION)
    here = result.sel(site="Sevilla").isel(heliostat=4, tracking=1)
    utc = here["utc"].to_numpy()
    hours = (utc - utc[0]) / np.timedelta64(1, "h")
    expected = by_loops(here["instantaneous_primary_angle"].to_numpy(), utc.astype("datetime64[D]").astype(int), hours)
    np.testing.assert_allclose([float(here[name]) for name in MOTION[:5]], expected, atol=1e-9)


def test_directions_of_the_sun_have_one_angle_each(small):
    time = {"clock": "sun", "azimuth": [90, 180], "elevation": 40}
    result = api.build(small(site=None, time=time, output={"tracking_angles": True})).compute()
    assert result["primary_angle"].dims == ("tracking", "sun_azimuth", "heliostat")
    north = int(np.argmin(result["azimuth"].to_numpy()))
    facing = result["primary_angle"].sel(tracking="azimuth_elevation", sun_azimuth=180).isel(heliostat=north)
    assert float(facing) == pytest.approx(180)
    assert not set(MOTION) & set(result.data_vars)


def test_outlines_are_of_one_instant(small):
    with pytest.raises(StudyError, match=r"output\.outlines: need one instant, but the study has 22"):
        small(output={"outlines": 3})
    time = {"clock": "solar", "days": [80], "hours": [9]}
    result = api.build(small(time=time, output={"outlines": 3})).compute()
    assert result["outline_u"].dims == ("latitude", "tracking", "heliostat", "effect", "image", "corner")
    assert result.sizes["image"] == 3
    assert result["effect"].values.tolist() == ["shading", "blocking"]
    shaded = result["outline_area"].sel(effect="shading").isel(image=0).fillna(0) > 1e-9
    np.testing.assert_array_equal(shaded, result["shading_efficiency"] < 1 - 1e-10)
