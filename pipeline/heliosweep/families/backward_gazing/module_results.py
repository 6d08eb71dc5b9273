"""What a point tells of the modules: errors of their slopes, estimates, sight, and maps."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.families.backward_gazing.labels import CAMERAS
from heliosweep.families.backward_gazing.points import (
    MOST_REMEMBERED,
    NEEDED,
    Failure,
    Given,
    Observation,
    Point,
    bound,
    observed,
)
from heliosweep.families.backward_gazing.variables import EDGE, NOT_SEEN, SEEN
from heliosweep.kernels.gazing_grid import maps
from heliosweep.kernels.gazing_modules import module_estimates, module_statistics

Floats = NDArray[np.float64]

#: What relative errors of modules are relative to where no canting is entered. [mrad]
NOT_CANTED = 1.0
_DEGREES = float(np.degrees(1.0))


def results(point: Point, given: Given, with_maps: bool) -> dict[str, Any]:
    """Values of the variables of a point, by name, in their units.

    Parameters
    ----------
    point : Point
        Values of the study's keys.
    given : Given
        What the study says once.
    with_maps : bool
        Whether to make maps.

    Returns
    -------
    dict
        Arrays over the dimensions of `variables`; only ``scene_status`` where there are no slopes whatever the images.
    """
    area = float(np.prod(given.sizes, axis=1).sum())
    made = _remembered if area / point.pixel**2 <= MOST_REMEMBERED else _results
    return made(point, given, with_maps)


def _results(point: Point, given: Given, with_maps: bool) -> dict[str, Any]:
    try:
        seen = observed(point, given)
    except Failure as failure:
        return {"scene_status": failure.status}
    least = bound(seen, point, given)
    values: dict[str, Any] = (
        _errors(seen, point, given) | _estimates(seen, point, given, least) | _sight(seen, given, least)
    )
    values["scene_status"] = SEEN if np.any(seen.keep & np.isfinite(seen.net[:, 0, 0]).any(axis=0)) else NOT_SEEN
    values["incidence"] = _DEGREES * seen.layout.incidence
    return values | (_maps(seen) if with_maps else {})


_remembered = lru_cache(maxsize=4)(_results)


def _errors(seen: Observation, point: Point, given: Given) -> dict[str, Floats]:
    """Errors of the slopes of each module, shape (M, T, modules). [mrad], [percent]"""
    mean, rms, _ = over_modules(1e3 * (seen.net - seen.true), seen, given)
    entered = 1e3 * np.hypot(*np.transpose(point.canting_scale * np.array(given.canting)))
    entered = np.where(entered > 0.0, entered, NOT_CANTED)
    made = {}
    for axis, name in enumerate("xy"):
        made[f"slope_bias_{name}"], made[f"slope_rms_{name}"] = mean[:, :, axis], rms[:, :, axis]
        made[f"relative_error_{name}"] = 100.0 * np.abs(mean[:, :, axis]) / entered
    return made


def _estimates(seen: Observation, point: Point, given: Given, least: Floats) -> dict[str, Floats]:
    """Canting, waviness, pointing and focal length with standard errors. [mrad], [m]"""
    methods, frames = seen.net.shape[:2]
    modules = given.modules
    lead, count = (methods, frames, 2), len(modules.size)
    pairs = {
        **{name: np.empty((*lead, count)) for name in ("canting_%", "canting_%_standard_error", "waviness_%")},
        **{name: np.empty(lead) for name in ("pointing_%", "pointing_%_standard_error")},
    }
    focal, focal_error = np.empty((methods, frames)), np.empty((methods, frames))
    for at in np.ndindex(methods, frames):
        slopes = np.ascontiguousarray(seen.net[at])
        own = bound(seen, point, given, "A") if given.fit_gain and given.methods[at[0]] == "A" else least
        noise = np.nan_to_num(own) if np.any(own > 0.0) else None
        found = module_estimates(slopes, seen.mirror, modules, seen.keep, point.focal_length, deviation=noise)
        pairs["canting_%"][at], pairs["canting_%_standard_error"][at] = found.canting, found.canting_error
        pairs["pointing_%"][at], pairs["pointing_%_standard_error"][at] = found.pointing, found.pointing_error
        pairs["waviness_%"][at] = found.waviness
        focal[at], focal_error[at] = found.focal_length, found.focal_length_error
    made = {"focal_length_estimate": focal, "focal_length_standard_error": focal_error}
    for name, both in pairs.items():
        for axis, letter in enumerate("xy"):
            made[name.replace("%", letter)] = 1e3 * both[:, :, axis]
    return made


def _sight(seen: Observation, given: Given, least: Floats) -> dict[str, Floats]:
    """Usable pixels, lit cameras and the bound. [1], [mrad]"""
    count = len(given.sizes)
    kept = np.bincount(seen.mirror.pixel_module[seen.keep], minlength=count)
    _, _, usable = over_modules(seen.net[:, 0, 0], seen, given)
    lit, _, _ = over_modules(seen.lit / CAMERAS, seen, given)
    _, square, _ = over_modules(1e3 * least, seen, given)
    with np.errstate(invalid="ignore"):
        made = {"usable_fraction": usable / kept, "lit_cameras": lit}
    return made | {f"cramer_rao_bound_{name}": square[axis] for axis, name in enumerate("xy")}


def _maps(seen: Observation) -> dict[str, Any]:
    """Images, slopes and what is known of each pixel, on the grid. [1], [mrad]"""
    mirror, lit = seen.mirror, seen.lit
    made: dict[str, Any] = {"image": maps(mirror, seen.images)}
    for axis, name in enumerate("xy"):
        made[f"slope_{name}"] = maps(mirror, 1e3 * seen.net[:, :, axis])
        made[f"true_slope_{name}"] = maps(mirror, 1e3 * seen.true[axis])
    mask = np.where(seen.keep, np.where(lit >= NEEDED, 3, 2), 1)
    made["mask"] = np.nan_to_num(maps(mirror, mask))
    made["quality"] = np.nan_to_num(maps(mirror, seen.found.quality | EDGE * ~seen.keep))
    return made


def over_modules(values: Floats, seen: Observation, given: Given) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Mean, root mean square and number of values (..., N) over the eroded modules; each (..., modules)."""
    lead, count = values.shape[:-1], len(given.sizes)
    flat = np.ascontiguousarray(values, np.float64).reshape(-1, values.shape[-1])
    mean, rms, number = module_statistics(flat, seen.mirror.pixel_module, seen.keep, count)
    return mean.reshape(*lead, count), rms.reshape(*lead, count), number.reshape(*lead, count)
