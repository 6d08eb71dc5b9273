"""What a user should be told of spots that are missing."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr

from heliosweep.kernels.receiver import BEHIND_FACE, BLIND_CONE, MISSES, NO_SUN, TOO_NEAR

#: Values of the status that are read at a time.
MOST_VALUES = 2**24
#: Dimensions of the instants.
DAYS_AND_HOURS = ("day", "declination", "date", "hour")

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

    Parameters
    ----------
    result : xarray.Dataset
        With ``spot_status``; read part by part.
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
