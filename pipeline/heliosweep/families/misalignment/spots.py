"""Spots on the receiver's plane, whichever errors they have: variables, flags, and what the user is told of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.points import Points, instant_sizes, swept_dims
from heliosweep.grid.regions import Variable, flags, quantity, with_best
from heliosweep.kernels.spots.receiver import BEHIND_FACE, BLIND_CONE, MISSES, NO_SUN, REACHES, TOO_NEAR

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.study import MisalignmentStudy

#: Status of heliostats that there are not, where a shorter layout is padded.
NO_HELIOSTAT = -1
#: Values of the status that are read at a time.
MOST_VALUES = 2**24
#: Dimensions of the instants.
DAYS_AND_HOURS = ("day", "declination", "date", "hour")

#: Axes of the receiver's plane.
SIDES = {"y": "to the right of the aim point", "z": "above the aim point"}

_STATUS = {
    NO_HELIOSTAT: "no_heliostat",
    REACHES: "reaches_the_plane",
    MISSES: "ray_misses_the_plane_or_back_of_the_mirror_is_lit",
    BEHIND_FACE: "mirror_on_or_behind_the_plane",
    NO_SUN: "sun_below_the_horizon",
    BLIND_CONE: "mount_cannot_point_there",
    TOO_NEAR: "offsets_not_smaller_than_the_distance",
}
_SEEN = "for someone in the field who looks at the receiver; missing where spot_status is not 0"


def spot_variables(study: MisalignmentStudy) -> dict[str, Variable]:
    """Spots, flags and the hit fraction of each day."""
    day, hour = instant_sizes(study)
    dims = (*swept_dims(study), "heliostat", day, hour)
    found = {
        "spot_y": quantity(dims, "m", f"spot on the receiver's plane, {SIDES['y']}", f"to the right {_SEEN}"),
        "spot_z": quantity(dims, "m", f"spot on the receiver's plane, {SIDES['z']}", f"up along the face {_SEEN}"),
        "spot_status": flags(dims, "whether there is a spot, and why not", _STATUS),
        "is_real": flags(dims, "whether the reflected ray reaches the receiver's plane", {0: "no_spot", 1: "spot"}),
        "inside": flags(dims, "whether the spot lies in the aperture", {0: "outside_or_no_spot", 1: "inside"}),
        "hit_fraction": quantity(
            dims[:-1],
            "1",
            "part of the hours with sun in which the spot lies in the aperture",
            "missing on days without sun and where there is no heliostat",
            cell_methods="time: mean (over the hours with sun)",
            valid_range=[0.0, 1.0],
        ),
    }
    return with_best(found, ("hit_fraction",))


def spot_values(points: Points, spots: NDArray[np.float64]) -> dict[str, NDArray[Any]]:
    """Values of `spot_variables` from spots y, z [m] and status, shape (3, P, H, T).

    The hit fraction is the part of the hours with sun in which the spot lies in the aperture.
    """
    y, z, found = spots
    status = np.where(points.absent[..., np.newaxis], NO_HELIOSTAT, found).astype(np.int8)
    half = [side[:, np.newaxis, np.newaxis] for side in (points.setting.half_width, points.setting.half_height)]
    real = status == REACHES
    inside = (np.abs(y) <= half[0]) & (np.abs(z) <= half[1]) & real
    _, hours = points.instants.sizes.values()
    hits, counted = (
        np.count_nonzero(here.reshape(*y.shape[:-1], -1, hours), axis=-1)
        for here in (inside, (status != NO_SUN) & (status != NO_HELIOSTAT))
    )
    fraction = np.divide(hits, counted, out=np.full(hits.shape, np.nan), where=counted > 0)
    flags = {"spot_status": status, "is_real": real, "inside": inside}
    return {"spot_y": y, "spot_z": z} | flags | {"hit_fraction": fraction}


_OF_HELIOSTATS = {
    BEHIND_FACE: "stand on the plane of the receiver or behind it whenever the sun is up",
    TOO_NEAR: "are nearer to the aim point than the offsets of the mirror",
}
_OF_RAYS = {
    BEHIND_FACE: "start on the plane of the receiver or behind it, where their mirrors turn at times",
    MISSES: "go away from the plane of the receiver, or come from a mirror whose back is lit",
    BLIND_CONE: "would need a mount that points into its blind cone",
}


def status_remarks(result: xr.Dataset) -> Iterator[str]:
    """Yield how many heliostats and rays have no spot and why, and at how many instants the sun is down.

    ``spot_status`` is read part by part.
    """
    status = result["spot_status"]
    instants = [dim for dim in status.dims if dim in ("site", "latitude", *DAYS_AND_HOURS)]
    heliostats = dict.fromkeys(_OF_HELIOSTATS, 0)
    rays = dict.fromkeys(_OF_RAYS, 0)
    dark: list[np.ndarray] = []
    for part in _parts(status):
        values = part.to_numpy()
        times = tuple(axis for axis, dim in enumerate(part.dims) if dim in DAYS_AND_HOURS)
        for code in heliostats:
            here = (values == code).any(axis=times, keepdims=True)
            if code == BEHIND_FACE:
                # A mirror before a pivot that is all but on the plane may turn behind it at some instants.
                always = here & ((values == code) | (values == NO_SUN)).all(axis=times, keepdims=True)
                rays[code] += int(np.count_nonzero((values == code) & ~always))
                here = always
            heliostats[code] += int(np.count_nonzero(here))
        for code in (MISSES, BLIND_CONE):
            rays[code] += int(np.count_nonzero(values == code))
        others = tuple(axis for axis, dim in enumerate(part.dims) if dim not in instants)
        dark.append((values == NO_SUN).any(axis=others))
    points = status.size // math.prod(status.sizes[dim] for dim in status.dims if dim in DAYS_AND_HOURS)
    counted = "" if points == status.sizes["heliostat"] else ", counted at every point of the sweep,"
    for code, count in heliostats.items():
        if count:
            yield f"{count:,} of {points:,} heliostats{counted} {_OF_HELIOSTATS[code]}: no spot (spot_status {code})"
    for code, count in rays.items():
        if count:
            yield f"{count:,} of {status.size:,} rays {_OF_RAYS[code]}: no spot (spot_status {code})"
    down, all_instants = _instants_down(dark, status, instants)
    if down:
        yield f"the sun is down at {down:,} of {all_instants:,} instants: no spot (spot_status {NO_SUN})"


def _parts(array: xr.DataArray) -> Iterator[xr.DataArray]:
    """Yield slices along the first dimension that can be held in memory."""
    first = array.dims[0]
    length = max(1, MOST_VALUES * array.sizes[first] // max(array.size, 1))
    for start in range(0, array.sizes[first], length):
        yield array.isel({first: slice(start, start + length)})


def _instants_down(dark: list[np.ndarray], status: xr.DataArray, instants: Sequence[object]) -> tuple[int, int]:
    """Number of instants without sun, and of all."""
    if status.dims[0] in instants:
        down = np.concatenate(dark)
    else:
        down = np.logical_or.reduce(dark)
    return int(down.sum()), down.size
