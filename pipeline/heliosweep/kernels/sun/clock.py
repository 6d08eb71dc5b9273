"""Sun position on the solar clock."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def declination_cooper(day: ArrayLike) -> NDArray[np.float64]:
    """Declination of the sun, positive north of the equator, by Cooper's formula. [rad]

    `day` is the day of the year, 1 on 1 January. P. I. Cooper, "The absorption of radiation in solar stills", Solar
    Energy 12 (1969) 333-346, doi 10.1016/0038-092X(69)90047-4
    """
    angle = 2.0 * np.pi * (284.0 + np.asarray(day, dtype=np.float64)) / 365.0
    return np.radians(23.45) * np.sin(angle)


def solar_clock(latitude: ArrayLike, declination: ArrayLike, hour: ArrayLike) -> NDArray[np.float64]:
    """Unit vectors to the sun at given solar hours, east, north, up, shape (..., 3); z < 0 when the sun is down. [1]

    `latitude` and `declination` are positive north [rad]; `hour` is 12 when the sun crosses the meridian, 15 degrees of
    hour angle an hour [h]. The arguments broadcast.
    """
    lat, dec, time = np.broadcast_arrays(*(np.asarray(a, np.float64) for a in (latitude, declination, hour)))
    angle = np.radians(15.0) * (time - 12.0)
    equatorial = np.cos(dec) * np.cos(angle)
    return np.stack(
        (
            -np.cos(dec) * np.sin(angle),
            np.cos(lat) * np.sin(dec) - np.sin(lat) * equatorial,
            np.sin(lat) * np.sin(dec) + np.cos(lat) * equatorial,
        ),
        axis=-1,
    )


def refracted(sun: ArrayLike, pressure: float, temperature: float) -> NDArray[np.float64]:
    """Sun vectors as refraction in the atmosphere shows them, raised towards the zenith, shape (..., 3). [1]

    `sun` are geometric unit vectors, east, north, up; `pressure` is that of the air at the site [Pa], `temperature` its
    temperature [deg C]. The formula of Saemundsson as SPA takes it: Reda, I. and Andreas, A. (2004). Solar position
    algorithm for solar radiation applications. Solar Energy 76, 577-589, section 3.14.2.
    doi:10.1016/j.solener.2003.12.003. Below -0.8333 deg, where the whole disc has set, nothing is raised.
    """
    vectors = np.asarray(sun, np.float64)
    level = np.hypot(vectors[..., 0], vectors[..., 1])
    geometric = np.degrees(np.arctan2(vectors[..., 2], level))
    shown = geometric >= -(_SUN_RADIUS + _HORIZON_REFRACTION)
    bent = np.where(shown, geometric, 0.0)
    raised = 1.02 / (60.0 * np.tan(np.radians(bent + 10.3 / (bent + 5.11))))
    factor = (pressure / 101000.0) * (283.0 / (273.0 + temperature))
    apparent = np.radians(geometric + np.where(shown, factor * raised, 0.0))
    shrink = np.cos(apparent) / np.where(level > 0.0, level, 1.0)
    return np.stack((vectors[..., 0] * shrink, vectors[..., 1] * shrink, np.sin(apparent)), axis=-1)


#: Of the sun's disc, and of refraction at the horizon. [deg]
_SUN_RADIUS, _HORIZON_REFRACTION = 0.26667, 0.5667
