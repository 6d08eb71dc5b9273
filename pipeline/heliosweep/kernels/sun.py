"""Sun position on the solar clock."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["declination_cooper", "solar_clock"]


def declination_cooper(day: ArrayLike) -> NDArray[np.float64]:
    """Declination of the sun by Cooper's formula [1]_.

    Parameters
    ----------
    day : array_like
        Day of the year, 1 on 1 January. [d]

    Returns
    -------
    ndarray
        Declination, positive north of the equator. [rad]

    References
    ----------
    .. [1] P. I. Cooper, "The absorption of radiation in solar stills", Solar Energy 12 (1969) 333-346,
       doi 10.1016/0038-092X(69)90047-4
    """
    angle = 2.0 * np.pi * (284.0 + np.asarray(day, dtype=np.float64)) / 365.0
    return np.radians(23.45) * np.sin(angle)


def solar_clock(latitude: ArrayLike, declination: ArrayLike, hour: ArrayLike) -> NDArray[np.float64]:
    """Unit vectors to the sun at given solar hours; the arguments broadcast.

    Parameters
    ----------
    latitude : array_like
        Geographic latitude, positive north. [rad]
    declination : array_like
        Declination of the sun, positive north. [rad]
    hour : array_like
        Solar hour: 12 when the sun crosses the meridian, 15 degrees of hour angle an hour. [h]

    Returns
    -------
    ndarray, shape (..., 3)
        Vectors from the ground to the sun, east, north, up; z < 0 when the sun is down. [1]
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
