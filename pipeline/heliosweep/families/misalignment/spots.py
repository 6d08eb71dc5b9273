"""Spots on the receiver's plane of fixed errors: variables, hits and flags that modes share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.families.misalignment.points import SIDES, coded, instant_sizes
from heliosweep.grid.regions import Variable, quantity, with_best
from heliosweep.kernels.spots.receiver import NO_SUN, REACHES
from heliosweep.mounts import SPOT_STATUS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.study import MisalignmentStudy
    from heliosweep.families.points import Point
    from heliosweep.kernels.arrays import Floats

_SEEN = "for someone in the field who looks at the receiver; missing unless spot_status is 0"


def spot_variables(study: MisalignmentStudy) -> dict[str, Variable]:
    """Spots, flags and the hit fraction of each day."""
    day, hour = instant_sizes(study)
    dims = ("heliostat", day, hour)
    found = {
        "spot_y": quantity(dims, "m", f"spot on the receiver's plane, {SIDES['y']}", f"to the right {_SEEN}"),
        "spot_z": quantity(dims, "m", f"spot on the receiver's plane, {SIDES['z']}", f"up along the face {_SEEN}"),
        "spot_status": coded(dims, "reason for a missing spot", SPOT_STATUS),
        "is_real": _yes(dims, "flag for reflected rays that reach the receiver's plane", "no_spot", "spot"),
        "inside": _yes(dims, "flag for spots in the aperture", "outside_or_no_spot", "inside"),
        "hit_fraction": quantity(
            dims[:-1],
            "1",
            "fraction of the hours with sun in which the spot lies in the aperture",
            "missing on days without sun and for padding entries",
            cell_methods="time: mean (over the hours with sun)",
            valid_range=[0.0, 1.0],
        ),
    }
    return with_best(found, ("hit_fraction",))


def _yes(dims: tuple[str, ...], long_name: str, no: str, yes: str) -> Variable:
    attrs: dict[str, Any] = {"flag_values": np.array([0, 1], np.int8), "flag_meanings": f"{no} {yes}"}
    return quantity(dims, "1", long_name, dtype="int8", **attrs)


def spot_values(point: Point, y: Floats, z: Floats, status: Floats) -> dict[str, NDArray[Any]]:
    """Values of `spot_variables` from spots [m] and their status, shape (*group, heliostats, days, hours)."""
    sides = (0.5 * np.broadcast_to(point[f"receiver.{key}"], point.group) for key in ("width", "height_extent"))
    width, height = (side[..., np.newaxis, np.newaxis, np.newaxis] for side in sides)
    inside = (np.abs(y) <= width) & (np.abs(z) <= height)
    hits, counted = (np.count_nonzero(here, axis=-1) for here in (inside, status != NO_SUN))
    fraction = np.divide(hits, counted, out=np.full(hits.shape, np.nan), where=counted > 0)
    flags = {"spot_status": status, "is_real": status == REACHES, "inside": inside}
    return {"spot_y": y, "spot_z": z, "hit_fraction": fraction} | flags
