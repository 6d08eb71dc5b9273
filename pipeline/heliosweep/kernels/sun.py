"""Unit vectors to the sun from solar time, or from daily nodes of a precise ephemeris.

Apart from the Earth's rotation, the sun's apparent position changes smoothly over a day. The geocentric direction and
the parallax are therefore interpolated by cubic splines through daily nodes, which are computed by the SPA [1]_. The
sidereal time, the rotation to the site and the correction for parallax are computed at each instant from the SPA
formulas.

References
----------
.. [1] I. Reda and A. Andreas, "Solar position algorithm for solar radiation applications", Solar Energy 76 (2004)
   577-589, doi 10.1016/j.solener.2003.12.003
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import Floats, inline, kernel


def declination_cooper(day: ArrayLike) -> NDArray[np.float64]:
    """Return the declination of the sun by Cooper's formula, positive north of the equator. [rad]

    `day` is the day of the year, 1 on 1 January. The formula is from P. I. Cooper, "The absorption of radiation in
    solar stills", Solar Energy 12 (1969) 333-346, doi 10.1016/0038-092X(69)90047-4
    """
    angle = 2.0 * np.pi * (284.0 + np.asarray(day, dtype=np.float64)) / 365.0
    return np.radians(23.45) * np.sin(angle)


def solar_clock(latitude: ArrayLike, declination: ArrayLike, hour: ArrayLike) -> NDArray[np.float64]:
    """Return unit vectors to the sun (east, north, up) for solar times, shape (..., 3); z < 0 if the sun is down. [1]

    `latitude` and `declination` are positive north [rad]. `hour` is 12 when the sun crosses the meridian, and one hour
    is 15 degrees of hour angle [h]. The arguments are broadcast against each other.
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
    """Return apparent sun vectors, raised towards the zenith by atmospheric refraction, shape (..., 3). [1]

    `sun` contains geometric unit vectors (east, north, up). `pressure` [Pa] and `temperature` [deg C] describe the air
    at the site. Saemundsson's formula is applied as in the SPA: Reda, I. and Andreas, A. (2004). Solar position
    algorithm for solar radiation applications. Solar Energy 76, 577-589, section 3.14.2.
    doi:10.1016/j.solener.2003.12.003. Vectors with an elevation below -0.8333 deg are unchanged, because the whole disc
    has set.
    """
    vectors = np.asarray(sun, np.float64)
    level = np.hypot(vectors[..., 0], vectors[..., 1])
    geometric = np.degrees(np.arctan2(vectors[..., 2], level))
    shown = geometric >= -(0.26667 + 0.5667)  # radius of the disc, and refraction at the horizon
    bent = np.where(shown, geometric, 0.0)
    raised = 1.02 / (60.0 * np.tan(np.radians(bent + 10.3 / (bent + 5.11))))
    factor = (pressure / 101000.0) * (283.0 / (273.0 + temperature))
    apparent = np.radians(geometric + np.where(shown, factor * raised, 0.0))
    shrink = np.cos(apparent) / np.where(level > 0.0, level, 1.0)
    return np.stack((vectors[..., 0] * shrink, vectors[..., 1] * shrink, np.sin(apparent)), axis=-1)


#: Nanoseconds in a day.
DAY = 86_400_000_000_000
#: Number of quantities at each node: geocentric unit vector to the sun (x, y, z), and sine of its horizontal parallax.
QUANTITIES = 4
#: Ratio of the Earth's polar radius to its equatorial radius [1], and the Earth's equatorial radius [m].
_FLATTENING, _EQUATORIAL_RADIUS = 0.99664719, 6378140.0
_C2, _C4, _C6, _C8, _C10, _C12, _C14, _C16 = ((-1.0) ** k / math.factorial(2 * k) for k in range(1, 9))
_S3, _S5, _S7, _S9, _S11, _S13, _S15 = ((-1.0) ** k / math.factorial(2 * k + 1) for k in range(1, 8))


def sidereal_time(day: Any, fraction: Any) -> Any:
    """Return the mean sidereal time at Greenwich, including whole turns. [turn]

    `day` is the number of days since 1970-01-01 0 h UT and `fraction` is the elapsed fraction of the day; both are
    numbers or arrays.
    """
    days = (day - 10957.5) + fraction  # since 2000-01-01 12 h
    centuries = days / 36525.0
    # 360.98564736629 deg per day, minus one turn for each whole day
    turns = (280.46061837 / 360.0 - 0.5 + fraction) + (0.98564736629 / 360.0) * days
    return turns + centuries * centuries * (0.000387933 / 360.0 - centuries / (38710000.0 * 360.0))


_sidereal_time = inline(sidereal_time)


def daily_splines(nodes: Floats) -> Floats:
    """Return natural cubic splines (zero second derivative at both ends) through daily nodes.

    `nodes` contains the values at days 0 to N - 1, shape (N, QUANTITIES). For each day, the result contains the
    coefficients of a cubic polynomial in the elapsed fraction of the day, constant term first, shape (N - 1, 4,
    QUANTITIES).
    """
    bend, pivot = np.zeros_like(nodes), np.zeros(len(nodes))  # a sixth of the second derivative
    for i in range(1, len(nodes) - 1):
        pivot[i] = 1.0 / (4.0 - pivot[i - 1])
        bend[i] = pivot[i] * (nodes[i - 1] - 2.0 * nodes[i] + nodes[i + 1] - bend[i - 1])
    for i in range(len(nodes) - 2, 0, -1):
        bend[i] -= pivot[i] * bend[i + 1]
    low, high = bend[:-1], bend[1:]
    return np.stack((nodes[:-1], np.diff(nodes, axis=0) - 2.0 * low - high, 3.0 * low, high - low), axis=1)


@inline
def _cosine_and_sine(turns: float) -> tuple[float, float]:
    """Return the cosine and sine of an angle [turn] from Taylor series, which the compiler vectorises."""
    quarters = np.floor(4.0 * turns + 0.5)
    x = 2.0 * math.pi * (turns - 0.25 * quarters)
    q = x * x  # at most (pi / 4)^2, so the omitted terms are below 5e-17
    s = _S9 + q * (_S11 + q * (_S13 + q * _S15))
    c = _C8 + q * (_C10 + q * (_C12 + q * (_C14 + q * _C16)))
    s = x + x * q * (_S3 + q * (_S5 + q * (_S7 + q * s)))
    c = 1.0 + q * (_C2 + q * (_C4 + q * (_C6 + q * c)))
    odd = quarters - 2.0 * np.floor(0.5 * quarters)
    half = 0.5 * (quarters - odd)
    sign = 1.0 - 2.0 * (half - 2.0 * np.floor(0.5 * half))
    return (-s * sign, c * sign) if odd > 0.0 else (c * sign, s * sign)


@kernel
def sun_at_sites(
    utc: NDArray[np.int64],
    delta_t: Floats,
    first_day: int,
    pieces: Floats,
    first_piece: int,
    sites: Floats,
    sun: Floats,
) -> None:
    """Write the unit vectors to the sun, without refraction, for all sites and instants to `sun`.

    `utc` contains nanoseconds since 1970-01-01 0 h UT, shape (T,). `delta_t` is terrestrial time minus universal time
    on each day from `first_day` on (days since 1970) [s]. `pieces` contains splines from `daily_splines` for the days
    of terrestrial time from `first_piece` on (days since 1970); their right ascensions exclude the equation of the
    equinoxes. `sites` contains geographic latitude and longitude, positive north and east [rad], and altitude [m],
    shape (S, 3). The results in `sun`, shape (S, T, 3), have the components east, north, up [1].
    """
    latitude, longitude, altitude = sites[:, 0], sites[:, 1], sites[:, 2] / _EQUATORIAL_RADIUS
    north, level, east, prime = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    reduced = np.arctan(_FLATTENING * np.tan(latitude))
    from_axis, from_equator = np.cos(reduced) + altitude * level, _FLATTENING * np.sin(reduced) + altitude * north
    site_north, site_up = level * from_equator - north * from_axis, level * from_axis + north * from_equator
    nodes = np.empty(QUANTITIES)
    for i in range(len(utc)):
        day = utc[i] // DAY
        fraction = (utc[i] - day * DAY) * (1.0 / DAY)
        late = fraction + delta_t[day - first_day] * (1.0 / 86400.0)
        whole = math.floor(late)
        late -= whole
        c = pieces[day + int(whole) - first_piece]
        for q in range(QUANTITIES):
            nodes[q] = c[0, q] + late * (c[1, q] + late * (c[2, q] + late * c[3, q]))
        px, py, pz, parallax = nodes[0], nodes[1], nodes[2], nodes[3]
        cosine, sine = _cosine_and_sine(_sidereal_time(day, fraction))
        px, py = px * cosine + py * sine, py * cosine - px * sine  # the x axis points to the Greenwich meridian
        for k in range(len(sites)):
            meridian = prime[k] * px + east[k] * py
            x = prime[k] * py - east[k] * px
            y = level[k] * pz - north[k] * meridian - site_north[k] * parallax
            z = level[k] * meridian + north[k] * pz - site_up[k] * parallax
            scale = 1.0 / math.sqrt(x * x + y * y + z * z)
            sun[k, i, 0], sun[k, i, 1], sun[k, i, 2] = x * scale, y * scale, z * scale
