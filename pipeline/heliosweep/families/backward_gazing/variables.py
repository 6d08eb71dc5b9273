"""The variables of a result: names, CF attributes and what each means, in the order of the file.

X is horizontal (y of the mirror: to the right as seen from the target), Y vertical (z, up), as in the paper's Table 1.
Every entry is (dimensions after the swept ones, attributes).
"""

from __future__ import annotations

from typing import Any

import numpy as np

Entry = tuple[tuple[str, ...], dict[str, Any]]

#: What becomes of a scene.
SEEN, NOT_SEEN, NO_SUN, BEHIND, NOT_IDENTIFIABLE, NO_PROFILE, NO_HELIOSTAT = 0, 1, 2, 3, 4, 5, -1
_STATUS = {
    NO_HELIOSTAT: "no_heliostat",
    SEEN: "slopes_found",
    NOT_SEEN: "nowhere_three_cameras_see_the_sun",
    NO_SUN: "sun_below_the_horizon",
    BEHIND: "heliostat_behind_the_target",
    NOT_IDENTIFIABLE: "cameras_in_one_line_or_no_reflection_possible",
    NO_PROFILE: "noise_makes_the_sun_no_darker_at_its_edge",
}

#: Bits of `quality`; the first three are those of the kernels of Levenberg-Marquardt.
NOT_CONVERGED, UNLIT, OUTSIDE, EDGE, SATURATED = 1, 2, 4, 8, 16
_QUALITY = "not_converged fewer_than_three_cameras_lit beside_the_disc at_the_edge_of_a_module saturated"

_BOTH = {"x": "horizontal", "y": "vertical"}
_WAVEFRONT = "of O2 and LM the same for every referential, which they do not need"


def _flags(long_name: str, meanings: str, values: list[int], kind: str = "flag_values", **more: Any) -> dict[str, Any]:
    return {"units": "1", "long_name": long_name, kind: np.array(values, np.int8), "flag_meanings": meanings} | more


def _both(name: str, dims: tuple[str, ...], units: str, long_name: str, comment: str = "") -> dict[str, Entry]:
    """A quantity in both directions; ``%`` in the name stands for x or y, in the long name for the direction."""
    more = {"comment": comment} if comment else {}
    return {
        name.replace("%", axis): (dims, {"units": units, "long_name": long_name.replace("%", word), **more})
        for axis, word in _BOTH.items()
    }


_OF_METHOD = ("method", "referential")
_OF_MODULE = (*_OF_METHOD, "module")
_NET = (
    "error of a pixel: slope found, less the slope that the same method finds on images of the ideal heliostat without "
    "noise or error of gain, less the true slope; over the pixels of the eroded module that have slopes"
)

#: Errors of the modules' slopes, the truth being known.
ERRORS: dict[str, Entry] = {
    **_both("slope_bias_%", _OF_MODULE, "mrad", "mean error of the % slopes of a module", f"{_NET}; {_WAVEFRONT}"),
    **_both("slope_rms_%", _OF_MODULE, "mrad", "root mean square error of the % slopes of a module", _NET),
    **_both(
        "relative_error_%",
        _OF_MODULE,
        "percent",
        "magnitude of the mean error of the % slopes relative to the module's entered canting",
        "as in Table 1 of Defieux et al. (2020); relative to 1 mrad where no canting is entered",
    ),
}

#: What a plant wants to know, with standard errors.
ESTIMATES: dict[str, Entry] = {
    **_both(
        "canting_%",
        _OF_MODULE,
        "mrad",
        "% slope at the centre of a module, less the pointing of the heliostat",
        "what its screws would have to undo, against the ideal heliostat: modules on a sphere of another focal length "
        "are canted too; by a plane through the slopes of the eroded module",
    ),
    **_both(
        "canting_%_standard_error",
        _OF_MODULE,
        "mrad",
        "standard error of the % canting",
        "of the scatter of the module and of those that decide the pointing, alone",
    ),
    **_both("waviness_%", _OF_MODULE, "mrad", "root mean square of what a plane leaves of the % slopes of a module"),
    **_both(
        "pointing_%",
        _OF_METHOD,
        "mrad",
        "% pointing error of the heliostat",
        "median of the slopes at the centres of its modules, less those of a sphere of focal_length_estimate",
    ),
    **_both(
        "pointing_%_standard_error",
        _OF_METHOD,
        "mrad",
        "standard error of the % pointing",
        "of the scatter of the modules that decide the median, and of the focal length, alone",
    ),
    "focal_length_estimate": (_OF_METHOD, {"units": "m", "long_name": "focal length of the modules"}),
    "focal_length_standard_error": (
        _OF_METHOD,
        {"units": "m", "long_name": "standard error of the focal length of the modules", "comment": "of scatter alone"},
    ),
}

#: How well a module is seen.
SIGHT: dict[str, Entry] = {
    "usable_fraction": (
        ("method", "module"),
        {
            "units": "1",
            "long_name": "part of the eroded module for which there are slopes",
            "valid_range": [0.0, 1.0],
        },
    ),
    "lit_cameras": (
        ("module",),
        {
            "units": "1",
            "long_name": "part of the cameras that see the sun in the module",
            "comment": "mean over the pixels of the eroded module",
            "valid_range": [0.0, 1.0],
        },
    ),
    **_both(
        "cramer_rao_bound_%",
        ("module",),
        "mrad",
        "least standard deviation that the cameras leave to % slopes of a pixel",
        "Cramer-Rao bound for noise and levels of the cameras at the true slopes; root mean square over the pixels of "
        "the eroded module that three cameras see; 0 without noise and levels; for a tabulated profile that of its "
        "smooth fit, not of a search on the rough table; with fit_gain that of methods that find a gain, not of A",
    ),
}

#: Of the whole scene.
SCENE: dict[str, Entry] = {
    "scene_status": (
        (),
        _flags("whether there are slopes, and why not", " ".join(_STATUS.values()), list(_STATUS)),
    ),
    "incidence": ((), {"units": "degree", "long_name": "angle of the sun from the ideal normal of the heliostat"}),
}

#: Over the seeds, where one is swept.
OVER_SEEDS: dict[str, Entry] = {
    **_both(
        "relative_error_%_median", _OF_MODULE, "percent", "median over the seeds of the relative error of the % slopes"
    ),
    **_both(
        "relative_error_%_low",
        _OF_MODULE,
        "percent",
        "5th percentile over the seeds of the relative error of the % slopes",
    ),
    **_both(
        "relative_error_%_high",
        _OF_MODULE,
        "percent",
        "95th percentile over the seeds of the relative error of the % slopes",
    ),
}
#: Percentiles behind them, by ending.
PERCENTILES = {"median": 50.0, "low": 5.0, "high": 95.0}

_PLANE = ("z", "y")
#: With ``output: {maps: true}``.
MAPS: dict[str, Entry] = {
    "image": (
        ("camera", *_PLANE),
        {
            "units": "1",
            "long_name": "brightness relative to the sun's centre",
            "comment": "as the reconstruction gets it, with the noise of the cameras; missing between the modules",
        },
    ),
    **_both(
        "slope_%",
        (*_OF_METHOD, *_PLANE),
        "mrad",
        "% slope of the mirror relative to the ideal heliostat",
        "less the slope that the same method finds on the ideal heliostat; missing where fewer than three cameras are "
        f"lit; {_WAVEFRONT}",
    ),
    **_both("true_slope_%", _PLANE, "mrad", "true % slope of the mirror relative to the ideal heliostat"),
    "mask": (
        _PLANE,
        _flags(
            "which pixels count",
            "between_modules at_the_edge_of_a_module fewer_than_three_cameras_lit counts",
            [0, 1, 2, 3],
        ),
    ),
    "quality": (
        ("method", *_PLANE),
        _flags("what is doubtful about a slope", _QUALITY, [1, 2, 4, 8, 16], "flag_masks"),
    ),
}

#: Of a simulated scene, without and with maps.
SIMULATED: dict[str, Entry] = {**ERRORS, **ESTIMATES, **SIGHT, **SCENE}

_HOUR = ("heliostat", "hour")
#: Of a field: over heliostat and hour, whole heliostats at a time.
FIELD: dict[str, Entry] = {
    "slant_range": (
        ("heliostat",),
        {"units": "m", "long_name": "distance from the heliostat's centre to the target's"},
    ),
    **{name: ((*_HOUR, *dims), attrs) for name, (dims, attrs) in SCENE.items()},
    **_both(
        "slope_rms_%",
        (*_HOUR, *_OF_METHOD),
        "mrad",
        "root mean square error of the % slopes of a heliostat",
        _NET.replace("of the eroded module", "of all eroded modules"),
    ),
    **_both(
        "canting_rms_%",
        (*_HOUR, *_OF_METHOD),
        "mrad",
        "root mean square over the modules of the mean error of their % slopes",
        "of the modules that have slopes",
    ),
    "usable_fraction": (
        (*_HOUR, "method"),
        {"units": "1", "long_name": "part of the eroded modules for which there are slopes", "valid_range": [0.0, 1.0]},
    ),
    "lit_cameras": (
        _HOUR,
        {
            "units": "1",
            "long_name": "part of the cameras that see the sun in the heliostat",
            "comment": "mean over the pixels of the eroded modules",
            "valid_range": [0.0, 1.0],
        },
    ),
    **{name: (_HOUR, attrs) for name, (_, attrs) in SIGHT.items() if name.startswith("cramer_rao")},
}

#: Variables that are not float64.
DTYPES: dict[str, type] = {"scene_status": np.int8, "mask": np.int8, "quality": np.int8}

#: Coordinates besides those of the study's keys.
COORDINATES: dict[str, dict[str, Any]] = {
    "method": {"long_name": "how slopes are found"},
    "referential": {"long_name": "how slopes of the wavefront become slopes of the mirror"},
    "module": {"long_name": "number of the module, from 1", "units": "1"},
    "module_y": {"long_name": "centre of the module, to the right as seen from the target", "units": "m"},
    "module_z": {"long_name": "centre of the module, up", "units": "m"},
    "module_width": {"long_name": "width of the module", "units": "m"},
    "module_height": {"long_name": "height of the module", "units": "m"},
    "camera": {"long_name": "number of the camera, from 1", "units": "1"},
    "y": {"long_name": "place on the mirror, to the right as seen from the target", "units": "m"},
    "z": {"long_name": "place on the mirror, up", "units": "m"},
    "module_of_pixel": {"long_name": "number of the module that holds the pixel, 0 for none", "units": "1"},
    "hour": {"long_name": "solar hour", "units": "h"},
    "sun_world_azimuth": {"long_name": "azimuth of the sun, clockwise from north", "units": "degree"},
    "target_world_azimuth": {
        "long_name": "azimuth of the target seen from the heliostat, clockwise from north",
        "units": "degree",
    },
}
