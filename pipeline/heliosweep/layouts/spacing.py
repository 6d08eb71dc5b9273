"""Spacing of rings that grows with the distance from the tower: the rules of DELSOL and of no blocking.

References
----------
.. [1] Kistler, B. L. (1986). A user's manual for DELSOL3. SAND86-8018, Sandia National Laboratories.
.. [2] Siala, F. M. F. and Elayeb, M. E. (2001). Mathematical formulation of a graphical method for a no-blocking
   heliostat field layout. Renewable Energy 23, 77-92.
"""

from __future__ import annotations

import math
from typing import NamedTuple

#: Elevation of the receiver, seen from a heliostat, at which DELSOL's spacing ends: it has a pole at 0.049. [rad]
LEAST_ELEVATION = 0.06

#: Radius of the last ring of a zone over its first radius, and largest spacing within a ring over the first spacing.
_GROWTH, _WIDEST = 4 / 3, 1.7


class Spacing(NamedTuple):
    """Minimum distances of rings, and of neighbours of a ring.

    Parameters
    ----------
    rule : {"delsol", "no_blocking"}
        See the functions.
    receiver : float
        Height of the receiver above the mirrors' centres. [m]
    width, height : float
        Sides of the mirrors. [m]
    """

    rule: str
    receiver: float
    width: float
    height: float

    def step(self, radius: float) -> float:
        """Distance from a ring to the next: half of that to the one behind, on the same azimuths. [m]"""
        if self.rule == "delsol":
            return delsol_radial(self.elevation(radius), self.height) / 2
        return (no_blocking_radius(radius, self.receiver, self.height) - radius) / 2

    def slip(self, radius: float) -> float:
        """Distance from the last ring of a zone to the first of the next. [m]"""
        return self.step(radius) * (1 if self.rule == "delsol" else 2)

    def apart(self, radius: float) -> float:
        """Distance between neighbours of the first ring of a zone, in addition to the clearance. [m]"""
        return delsol_azimuthal(self.elevation(radius), self.width) if self.rule == "delsol" else 0.0

    def ends(self, radius: float, start: float) -> bool:
        """True if a zone that starts at one radius ends before another. [m]"""
        return radius > start * (_GROWTH if self.rule == "delsol" else _WIDEST)

    def reaches(self, radius: float) -> bool:
        """True if the spacing is defined at a radius. [m]"""
        return self.rule != "delsol" or self.elevation(radius) > LEAST_ELEVATION

    def elevation(self, radius: float) -> float:
        """Elevation of the receiver seen from a mirror. [rad]"""
        return math.atan2(self.receiver, radius)


def delsol_radial(elevation: float, height: float) -> float:
    """Distance to the heliostat behind on the same azimuth, two rings on.

    Parameters
    ----------
    elevation : float
        Elevation of the receiver seen from the heliostat. [rad]
    height : float
        Height of the mirror. [m]

    Returns
    -------
    float
        Distance. [m]

    Notes
    -----
    The fit of DELSOL3 (Kistler 1986) with the coefficients of its code; texts that print 1.44 for 1.144 have lost a
    digit: all others equal the code, rounded.
    """
    t = elevation
    return height * (1.1442399 / math.tan(t) - 1.093519 + 3.0683558 * t - 1.1255617 * t**2)


def delsol_azimuthal(elevation: float, width: float) -> float:
    """Distance between neighbours of a ring, by the fit of DELSOL3 for rectangular mirrors. [m]

    Parameters as for `delsol_radial`, with the width of the mirror. The last term is often printed as 0.2873 m, the
    value for mirrors of 10 m.
    """
    t = elevation
    return width * (1.7490871 + 0.63964099 * t + 0.028726279 / (t - 0.049023315))


def no_blocking_radius(radius: float, receiver: float, height: float) -> float:
    """Radius at which a mirror is just not blocked by one in front, of the same azimuth, on level ground.

    Parameters
    ----------
    radius : float
        Radius of the mirror in front. [m]
    receiver : float
        Height of the receiver above the mirrors' centres, more than `height`. [m]
    height : float
        Height of the mirrors, as high as one can be seen from the receiver. [m]

    Returns
    -------
    float
        Radius at which the line from the mirror's centre to the receiver passes the centre of the one in front at the
        distance `height`. [m]
    """
    h, up = height, receiver
    return (radius * up**2 + up * h * math.sqrt(radius**2 + up**2 - h**2)) / (up**2 - h**2)
