"""Time of parts of a field study, for the plan: how loosely mirrors stand, and the intercept on a cylinder."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from heliosweep.config.sweep import Sweep, ends
from heliosweep.grid.layout_axis import mirror_size
from heliosweep.kernels.intercept import course

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
    from heliosweep.layouts.layout import Layout

#: Part of the ground that mirrors cover in the fields that times were fitted to. [1]
DENSE = 0.45
#: Mirrors around which that is looked at, and the number of neighbours by which.
SAMPLED_MIRRORS, NEIGHBOURS = 12, 6
#: Time of the intercept of one heliostat and direction of the sun on a cylinder whose light is all blur; it grows with
#: the size of the image over the blur. [s]
SECONDS_ON_CYLINDER = 3e-6
#: Half of a focused image over half of the mirror, about; standard deviations that the blur reaches; and the reach of
#: the light over half of the receiver beyond which no interpolation is right. [1]
ASTIGMATISM, REACH, BESIDE = 0.3, 3.0, 2.0
#: Intercepts computed for the table that heliostats around a cylinder share, and for those that are tried where some of
#: the light falls beside it: by the tracking; and for the checks of each heliostat.
OF_TABLE = {"spinning_elevation": (2e3, 15e3), "azimuth_elevation": (9.6e3, 138e3)}
OF_CHECKS = 5
#: Part of the instants at which mirrors with no table are computed because interpolation misses them, likewise. [1]
MISSED = {"spinning_elevation": (0.03, 0.03), "azimuth_elevation": (0.03, 0.15)}
#: Standard deviation of a ray about that of a perfect mirror that the sun brings. [rad]
SUN_SPREAD = 2.3e-3


def sides(study: FieldEfficiencyStudy, layout: Layout) -> tuple[float, float]:
    """Mean width and height of the mirrors of a layout. [m]"""
    given = (("width", study.heliostat.width), ("height", study.heliostat.height))
    width, height = (float(np.mean(mirror_size(layout, name, _mean(side)))) for name, side in given)
    return width, height


def loose(layout: Layout, mirror_area: float) -> float:
    """How densely the mirrors of a layout stand beside those that times were fitted to, at most 1. [1]

    By the neighbours of some of them. The fewer there are, the fewer stand in the way.
    """
    if len(layout) <= NEIGHBOURS:
        return 1.0
    some = slice(None, None, 1 + len(layout) // SAMPLED_MIRRORS)
    squares = (layout.x[some, np.newaxis] - layout.x) ** 2 + (layout.y[some, np.newaxis] - layout.y) ** 2
    square = float(np.median(np.partition(squares, NEIGHBOURS, axis=1)[:, NEIGHBOURS]))
    return min(1.0, NEIGHBOURS * mirror_area / (math.pi * square * DENSE)) if square > 0.0 else 1.0


def seconds_on_cylinder(study: FieldEfficiencyStudy, layout: Layout, instants: int, lit: float) -> float:
    """Time of the intercepts computed for one heliostat and instant before a cylinder, beside interpolation. [s]

    With the number of instants and the share of them that is lit.
    """
    optics, receiver = study.optics, study.receiver
    assert optics is not None
    slant = float(np.hypot(np.hypot(layout.x, layout.y), _mean(receiver.height)).mean())
    axes = (optics.slope_error, optics.slope_error_horizontal, optics.slope_error_vertical)
    slopes = [_mean(slope) for slope in axes if slope is not None]
    blurred = 1e-3 * math.hypot(2.0 * max(slopes, default=0.0), 2.0 * _mean(optics.tracking_error))
    blur = slant * math.hypot(SUN_SPREAD, blurred)
    image = max(sides(study, layout)) / 2 * (1.0 if study.heliostat.focus in (None, "flat") else ASTIGMATISM)
    half = min(_mean(receiver.radius), _mean(receiver.height_extent) / 2)
    beside = (image + REACH * blur) / half
    shares = []
    for tracking in ends(study.tracking):
        spills = beside > 1.0
        computed = course.COMPUTED / instants + MISSED[tracking][spills] * lit
        if optics.mount_errors is None and optics.slope_map is None:
            computed = min(computed, (OF_TABLE[tracking][spills] / len(layout) + OF_CHECKS) / instants)
        few = instants * lit < 2 * course.COMPUTED
        shares.append(lit if few or beside > BESIDE else min(lit, computed))
    return SECONDS_ON_CYLINDER * (1.0 + image / max(blur, 1e-9)) * sum(shares) / len(shares)


def _mean(value: float | Sweep | None) -> float:
    """A value, or the mean of its `ends` where it is swept or drawn; 0 where it is left out."""
    if value is None:
        return 0.0
    return sum(map(float, ends(value))) / len(ends(value))
