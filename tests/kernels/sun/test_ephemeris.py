"""Sun vectors from daily nodes, against pvlib's SPA at every instant."""

import numpy as np
import pytest
from pvlib import spa

from heliosweep.kernels.sun import sidereal_time
from heliosweep.sun import sun_vectors

ARCSECOND = np.radians(1.0 / 3600.0)


def by_spa(utc, latitude, longitude, altitude, delta_t):
    """Sun vectors by pvlib's SPA, geometric elevation."""
    if delta_t is None:
        months = utc.astype("datetime64[M]").astype(int)
        delta_t = spa.calculate_deltat(1970 + months // 12, months % 12 + 1)
    unix = utc.astype("datetime64[ns]").astype(np.int64) / 1e9
    place = spa.solar_position_numpy(unix, latitude, longitude, altitude, 1013.25, 12.0, delta_t, 0.5667, 1)
    elevation, azimuth = np.radians(place[3]), np.radians(place[4])
    return np.stack(
        (np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)), axis=-1
    )


def difference(a, b):
    """Angle between unit vectors, in arcseconds."""
    return 2.0 * np.arcsin(np.linalg.norm(a - b, axis=-1) / 2.0) / ARCSECOND


def at_random(count, seed, first="1950", last="2051"):
    """Instants spread over the years, in no order."""
    start, stop = (int(np.datetime64(year, "ns").astype(np.int64)) for year in (first, last))
    return np.random.default_rng(seed).integers(start, stop, count).view("datetime64[ns]")


@pytest.mark.parametrize("latitude", [-90.0, -89.999, -66.0, -23.4, 0.0, 1e-9, 40.13, 78.0, 90.0])
@pytest.mark.parametrize("delta_t", [None, 69.0])
def test_within_a_thousandth_of_an_arcsecond_of_the_spa(latitude, delta_t):
    rng = np.random.default_rng(int(abs(latitude) * 10))
    utc = at_random(1000, int(abs(latitude)))
    longitude, altitude = rng.uniform(-180.0, 180.0), rng.uniform(-400.0, 6000.0)
    vectors = sun_vectors(utc, latitude, longitude, altitude, delta_t)
    assert difference(vectors, by_spa(utc, latitude, longitude, altitude, delta_t)).max() < 1e-3
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=-1), 1.0, rtol=0, atol=5e-16)


def test_all_that_datetime64_can_hold():
    """Before 1950 and after 2050 too, where delta T leaves the minute."""
    utc = np.concatenate([at_random(300, year, str(year), str(year + 1)) for year in (1679, 1850, 1902, 2100, 2259)])
    for utc_of_year in utc.reshape(-1, 300):
        vectors = sun_vectors(utc_of_year, 31.29, 92.04, 4500.0)
        assert difference(vectors, by_spa(utc_of_year, 31.29, 92.04, 4500.0, None)).max() < 1e-3


def test_years_that_nanoseconds_cannot_count_are_refused():
    with pytest.raises(ValueError, match="1678"):
        sun_vectors(np.array(["3000-01-01"], "datetime64[D]"), 0.0, 0.0)


def test_sidereal_time_of_meeus():
    """Meeus, Astronomical Algorithms, examples 12.a and 12.b: 1987 April 10 at 0 h and 19 h 21 min UT."""
    day = int(np.datetime64("1987-04-10", "D").astype(int))
    assert sidereal_time(day, 0.0) % 1.0 * 86400 == pytest.approx(13 * 3600 + 10 * 60 + 46.3668, abs=1e-4)
    assert sidereal_time(day, (19 + 21 / 60) / 24) % 1.0 * 360 == pytest.approx(128.7378734, abs=2e-7)
