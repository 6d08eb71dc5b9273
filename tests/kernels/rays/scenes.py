"""Scenes of tests: heliostats before a receiver."""

import math
from typing import Any

import numpy as np

from heliosweep.kernels import rays, sunshapes
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION

POINT_SUN = sunshapes.SunShape(np.zeros(1), np.ones(1), 0.0)


def scene(
    receiver: rays.Receiver, place: Any = (80.0, 300.0, 5.0), aim: Any = None, errors: Any = (1.5e-3, 1.5e-3, 0.0),
    sides: Any = (10.0, 8.0), curve: Any = 0.0, cant: Any = 0.0, turn: Any = (0.0, 0.0), facets: Any = (1, 1, 0.0),
    tracking: int = AZIMUTH_ELEVATION, sun: sunshapes.SunShape | None = None, **more: Any,
) -> rays.Scene:  # fmt: skip
    """Heliostats at some places, alike if one value is given for all."""
    centre = np.atleast_2d(np.array(place, float))
    many = np.ones((len(centre), 1))
    return rays.Scene(
        centre, many * (receiver.centre if aim is None else aim), many * sides, (many.T * curve)[0],
        (many.T * cant)[0], many * turn, rays.Facets(*facets), tracking, rays.Errors(*errors),
        sunshapes.pillbox() if sun is None else sun, receiver, **more,
    )  # fmt: skip


def direction(azimuth: float, elevation: float) -> np.ndarray:
    """Unit vector to the sun, shape (1, 3), from angles in degrees."""
    a, e = np.radians([azimuth, elevation])
    return np.array([[math.sin(a) * math.cos(e), math.cos(a) * math.cos(e), math.sin(e)]])


def random_field(rng: np.random.Generator, count: int, tall: float = 60.0, **more: Any) -> rays.Scene:
    """Heliostats of some sizes around a tower, no two closer than they may be."""
    places = np.empty((0, 3))
    while len(places) < count:
        x, y = rng.uniform(-1.0, 1.0, 2) * 8.0 * math.sqrt(count)
        if math.hypot(x, y) > 15.0 and (not len(places) or np.hypot(*(places[:, :2] - (x, y)).T).min() > 9.0):
            places = np.vstack((places, (x, y, rng.uniform(3.0, 6.0))))
    sides = rng.uniform(3.0, 6.0, (count, 2))
    receiver = more.pop("receiver", rays.cylinder((0.0, 0.0, tall), 3.0, 6.0))
    return scene(receiver, place=places, sides=sides, **more)
