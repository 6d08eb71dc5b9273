"""Sun positions from daily nodes of a precise ephemeris: unit vectors for many sites at the same instants.

Everything in the sun's apparent place but the Earth's rotation is smooth over a day. Cubic splines on nodes a day apart
carry the geocentric direction and the parallax; the sidereal time, the turn to the site and the parallax are computed
at each instant by the formulas of the SPA [1]_, whose places the nodes hold.

References
----------
.. [1] I. Reda and A. Andreas, "Solar position algorithm for solar radiation applications", Solar Energy 76 (2004)
   577-589, doi 10.1016/j.solener.2003.12.003
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import kernel

__all__ = ["DAY", "QUANTITIES", "daily_splines", "geocentric", "sidereal_time", "topocentric"]

Floats = NDArray[np.float64]

DAY = 86_400_000_000_000
"""Nanoseconds in a day."""
QUANTITIES = 4
"""What a node holds: the geocentric unit vector to the sun (x, y, z) and the sine of its horizontal parallax."""

_NOT_A_TIME = np.iinfo(np.int64).min
_J2000 = 10957.5
"""Days from 1970-01-01 0 h to 2000-01-01 12 h, where sidereal time is counted from."""
_FLATTENING = 0.99664719
"""Polar over equatorial radius of the Earth."""
_EQUATORIAL_RADIUS = 6378140.0


def sidereal_time(day: Any, fraction: Any) -> Any:
    """Mean sidereal time at Greenwich.

    Parameters
    ----------
    day, fraction : int or ndarray, float or ndarray
        Days since 1970-01-01 0 h UT, and the fraction of the day past them. [d]

    Returns
    -------
    float or ndarray
        Whole turns not removed. [turn]
    """
    days = (day - _J2000) + fraction
    centuries = days / 36525.0
    # 360.98564736629 deg a day without the whole turns of the whole days
    turns = (280.46061837 / 360.0 - 0.5 + fraction) + (0.98564736629 / 360.0) * days
    return turns + centuries * centuries * (0.000387933 / 360.0 - centuries / (38710000.0 * 360.0))


_sidereal_time = kernel(sidereal_time)


@kernel
def daily_splines(nodes: Floats) -> Floats:
    """Cubic splines through nodes a day apart, straight (second derivative zero) at both ends.

    Parameters
    ----------
    nodes : ndarray, shape (N, QUANTITIES)
        Values at day 0, 1, ... N - 1.

    Returns
    -------
    ndarray, shape (N - 1, 4, QUANTITIES)
        Coefficients of the powers 0 to 3 of the fraction of the day, for each day.
    """
    count = len(nodes)
    bend = np.zeros((count, QUANTITIES))  # a sixth of the second derivative
    pivot = np.zeros(count)
    for i in range(1, count - 1):
        pivot[i] = 1.0 / (4.0 - pivot[i - 1])
        for k in range(QUANTITIES):
            bend[i, k] = pivot[i] * (nodes[i - 1, k] - 2.0 * nodes[i, k] + nodes[i + 1, k] - bend[i - 1, k])
    pieces = np.empty((count - 1, 4, QUANTITIES))
    for i in range(count - 2, -1, -1):
        for k in range(QUANTITIES):
            if i > 0:
                bend[i, k] -= pivot[i] * bend[i + 1, k]
            low, high = bend[i, k], bend[i + 1, k]
            pieces[i, 0, k] = nodes[i, k]
            pieces[i, 1, k] = nodes[i + 1, k] - nodes[i, k] - 2.0 * low - high
            pieces[i, 2, k] = 3.0 * low
            pieces[i, 3, k] = high - low
    return pieces


@kernel
def geocentric(
    utc: NDArray[np.int64], delta_t: Floats, first_day: int, pieces: Floats, first_piece: int, place: Floats
) -> None:
    """Direction and parallax of the sun in the frame that turns with the Earth.

    Parameters
    ----------
    utc : ndarray of int64, shape (T,)
        Nanoseconds since 1970-01-01 0 h UT; the smallest integer stands for no time.
    delta_t : ndarray
        Terrestrial minus universal time of each day from `first_day` on. [s]
    first_day : int
        Days since 1970.
    pieces : ndarray, shape (days, 4, QUANTITIES)
        From `daily_splines`, in days of terrestrial time, from day `first_piece` on; right ascensions less the
        equation of the equinoxes.
    first_piece : int
        Days since 1970.
    place : ndarray, shape (QUANTITIES, T)
        Receives x (towards the Greenwich meridian), y (90 deg east), z (north) [1] and the sine of the horizontal
        parallax [1]; NaN at no time.
    """
    for i in range(len(utc)):
        if utc[i] == _NOT_A_TIME:
            for k in range(QUANTITIES):
                place[k, i] = np.nan
            continue
        day = utc[i] // DAY
        fraction = (utc[i] - day * DAY) * (1.0 / DAY)
        late = fraction + delta_t[day - first_day] * (1.0 / 86400.0)
        whole = math.floor(late)
        late -= whole
        p = pieces[day + int(whole) - first_piece]
        x = p[0, 0] + late * (p[1, 0] + late * (p[2, 0] + late * p[3, 0]))
        y = p[0, 1] + late * (p[1, 1] + late * (p[2, 1] + late * p[3, 1]))
        turns = _sidereal_time(day, fraction)
        angle = 2.0 * math.pi * (turns - math.floor(turns))
        cosine, sine = math.cos(angle), math.sin(angle)
        place[0, i] = x * cosine + y * sine
        place[1, i] = y * cosine - x * sine
        place[2, i] = p[0, 2] + late * (p[1, 2] + late * (p[2, 2] + late * p[3, 2]))
        place[3, i] = p[0, 3] + late * (p[1, 3] + late * (p[2, 3] + late * p[3, 3]))


@kernel
def topocentric(place: Floats, latitude: float, longitude: float, altitude: float, sun: Floats) -> None:
    """Unit vectors to the sun at one site.

    Parameters
    ----------
    place : ndarray, shape (QUANTITIES, T)
        From `geocentric`.
    latitude, longitude : float
        Geographic, positive north and east. [rad]
    altitude : float
        Above the ellipsoid. [m]
    sun : ndarray, shape (T, 3)
        Receives east, north, up, without refraction. [1]
    """
    east, north = math.sin(longitude), math.sin(latitude)
    prime, level = math.cos(longitude), math.cos(latitude)
    reduced = math.atan(_FLATTENING * math.tan(latitude))
    from_axis = math.cos(reduced) + altitude / _EQUATORIAL_RADIUS * level
    from_equator = _FLATTENING * math.sin(reduced) + altitude / _EQUATORIAL_RADIUS * north
    site_north = level * from_equator - north * from_axis
    site_up = level * from_axis + north * from_equator
    for i in range(place.shape[1]):
        meridian = prime * place[0, i] + east * place[1, i]
        x = prime * place[1, i] - east * place[0, i]
        y = level * place[2, i] - north * meridian - site_north * place[3, i]
        z = level * meridian + north * place[2, i] - site_up * place[3, i]
        scale = 1.0 / math.sqrt(x * x + y * y + z * z)
        sun[i, 0], sun[i, 1], sun[i, 2] = x * scale, y * scale, z * scale
