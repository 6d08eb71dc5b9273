"""Names, definitions and CF attributes of variables, flags and coordinates, in the order of the result file.

X is the horizontal and Y is the vertical direction, as in Table 1 of Defieux et al. (2020). X is the y axis of the
mirror, to the right as seen from the target. Y is the z axis of the mirror, upwards.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.grid import Variable, flags, pair, quantity, with_best
from heliosweep.kernels.gazing.geometry import AT_EDGE, NOT_A_NUMBER, OUT_OF_FRAME, SATURATED, mirror_grid
from heliosweep.kernels.gazing.slopes import NOT_CONVERGED, OUTSIDE, UNLIT

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.study import BackwardGazingStudy

#: Number of cameras, and minimum number of lit cameras for which slopes can be estimated.
CAMERAS, NEEDED = 4, 3

#: Values of `scene_status`.
SEEN, NOT_SEEN, NO_SUN, BEHIND, NOT_IDENTIFIABLE, NO_PROFILE, NO_HELIOSTAT = 0, 1, 2, 3, 4, 5, -1
STATUS = {
    NO_HELIOSTAT: "no_heliostat",
    SEEN: "slopes_found",
    NOT_SEEN: "nowhere_three_cameras_see_the_sun",
    NO_SUN: "sun_below_the_horizon",
    BEHIND: "heliostat_behind_the_target",
    NOT_IDENTIFIABLE: "cameras_in_one_line_or_no_reflection_possible",
    NO_PROFILE: "noise_makes_the_sun_no_darker_at_its_edge",
}
#: Bits of `quality`. The slope search sets the first three bits. The last two bits are set only for measured images.
QUALITY = {
    NOT_CONVERGED: "not_converged",
    UNLIT: "fewer_than_three_cameras_lit",
    OUTSIDE: "beside_the_disc",
    AT_EDGE: "at_the_edge_of_a_module",
    SATURATED: "saturated",
    NOT_A_NUMBER: "not_a_number",
    OUT_OF_FRAME: "out_of_frame",
}

PLANE = ("z", "y")
#: Number of positions at which the sun profile is stored.
NODES = 101
OF_METHOD = ("slope_method", "referential")
OF_MODULE = (*OF_METHOD, "module")
_HOUR = ("heliostat", "hour")


def _both(name: str, dims: tuple[str, ...], long_name: str, comment: str = "", units: str = "mrad") -> dict[str, Any]:
    """Return the variables for the x and y components of a quantity.

    ``%`` is replaced by x or y in the name, and by the direction in the long name.
    """
    return pair(name, {"x": "horizontal", "y": "vertical"}, dims, units, long_name, comment)


def _part(dims: tuple[str, ...], long_name: str, comment: str = "") -> Variable:
    return quantity(dims, "1", long_name, comment, valid_range=[0.0, 1.0])


#: Estimates that are used to adjust heliostats, with standard errors.
_ESTIMATES = {
    **_both(
        "canting_%",
        OF_MODULE,
        "% slope at the centre of a module minus the pointing of the heliostat",
        "correction required at the adjustment screws, relative to the ideal heliostat; modules on a sphere with a "
        "different focal length therefore appear canted; from a plane fitted to the slopes of the eroded module",
    ),
    **_both(
        "canting_%_standard_error",
        OF_MODULE,
        "standard error of the % canting",
        "includes only the scatter of the slopes in the module and in the modules that determine the pointing",
    ),
    **_both("waviness_%", OF_MODULE, "root mean square of the % slopes of a module about a fitted plane"),
    **_both(
        "pointing_%",
        OF_METHOD,
        "% pointing error of the heliostat",
        "median over the modules of the slopes at their centres, relative to a sphere with focal_length_estimate",
    ),
    **_both(
        "pointing_%_standard_error",
        OF_METHOD,
        "standard error of the % pointing",
        "includes only the scatter of the module slopes and the uncertainty of the focal length",
    ),
    "focal_length_estimate": quantity(OF_METHOD, "m", "focal length of the modules"),
    "focal_length_standard_error": quantity(
        OF_METHOD, "m", "standard error of the focal length of the modules", "includes only the scatter of the slopes"
    ),
    **{
        f"focal_length_{end}{ending}": quantity(
            OF_MODULE, "m", f"{prefix}{end}er principal focal length of a module", comment
        )
        for end in ("long", "short")
        for ending, prefix, comment in (
            ("", "", "from the minimum and maximum curvature of the module; negative if convex"),
            ("_standard_error", "standard error of the ", "includes only the scatter of the slopes"),
        )
    },
    "focal_axis": quantity(
        OF_MODULE,
        "degree",
        "direction of the longer principal focal length of a module, measured upwards from horizontal",
        "as seen from the target; not meaningful if its standard error is large, as for a sphere",
    ),
    "focal_axis_standard_error": quantity(
        OF_MODULE, "degree", "standard error of focal_axis", "includes only the scatter of the slopes"
    ),
    "usable_fraction": _part(
        ("slope_method", "module"), "fraction of the pixels of the eroded module that have slopes"
    ),
    "lit_cameras": _part(
        ("module",),
        "fraction of the cameras that see the sun in the module",
        "mean over the pixels of the eroded module",
    ),
    "evaluations": quantity(
        ("slope_method",),
        "1",
        "number of merit function evaluations per pixel",
        "mean over the pixels that have slopes; method A does not evaluate the merit function",
    ),
}
#: Long name of the lower bound on pixel slope noise. The value for a module is the root mean square over its pixels.
_BOUND = "minimum standard deviation of the % slope of a pixel with these cameras"

#: Sun variables.
_SUN = {
    **{
        name: quantity(("disc_fraction",), "1", f"brightness {words}")
        for name, words in (
            ("sun_brightness", "of the sun's profile relative to the centre of the disc"),
            ("sun_formula", "of Jose's formula fitted to the sun's profile"),
        )
    },
    "sun_limb_fit": quantity((), "1", "brightness of the limb relative to the centre, A, in the fitted formula"),
    "sun_exponent_fit": quantity((), "1", "exponent xi of Jose's fitted formula"),
    "sun_radius_fit": quantity(
        (), "mrad", "angular radius eps_max of the fitted formula", "the angle at which the profile ends"
    ),
    "sun_fit_rms": quantity((), "1", "root mean square difference between the sun's profile and the fitted formula"),
}

#: Variables that describe the whole scene.
_SCENE = {
    "scene_status": flags((), "status of the slopes, with the reason for missing slopes", STATUS),
    "incidence": quantity((), "degree", "angle between the direction to the sun and the ideal heliostat normal"),
}
_NET = (
    "the error of a pixel is its estimated slope minus its true slope, minus the slope that the method estimates "
    "for the ideal heliostat without noise and gain error; computed over the pixels of the eroded module that have "
    "slopes"
)
_WAVEFRONT = "O2 and LM do not use the referential, so their values are identical for all referentials"

#: Variables of one simulated heliostat.
SIMULATED = {
    **_both("slope_bias_%", OF_MODULE, "mean error of the % slopes of a module", f"{_NET}; {_WAVEFRONT}"),
    **_both("slope_rms_%", OF_MODULE, "root mean square error of the % slopes of a module", _NET),
    **_both(
        "relative_error_%",
        OF_MODULE,
        "magnitude of the mean error of the % slopes relative to the canting of the module in the study",
        "as in Table 1 of Defieux et al. (2020); relative to 1 mrad for a module without canting in the study",
        "percent",
    ),
    **_ESTIMATES,
    **_both(
        "cramer_rao_bound_%",
        ("module",),
        _BOUND,
        "Cramer-Rao bound at the true slopes for camera noise and rounding to grey levels; root mean square over the "
        "pixels of the eroded module seen by at least three cameras; 0 without noise and rounding; for a tabulated "
        "profile, computed from its smooth fit; with fit_gain, the bound for methods that fit a gain (not A)",
    ),
    **_SCENE,
}
#: Additional variables if the study sets ``output: {maps: true}``.
MAPS = {
    "image": quantity(
        ("camera", *PLANE),
        "1",
        "brightness relative to the sun's centre",
        "input to the reconstruction, with camera noise; missing between the modules",
    ),
    **_both(
        "slope_%",
        (*OF_METHOD, *PLANE),
        "% slope of the mirror relative to the ideal heliostat",
        "estimated slope minus the slope that the method estimates for the ideal heliostat; missing if fewer than "
        f"three cameras are lit; {_WAVEFRONT}",
    ),
    **_both("true_slope_%", PLANE, "true % slope of the mirror relative to the ideal heliostat"),
    "mask": flags(
        PLANE,
        "status of each pixel",
        dict(enumerate(("between_modules", "at_the_edge_of_a_module", "fewer_than_three_cameras_lit", "counts"))),
    ),
    "quality": flags(
        ("slope_method", *PLANE),
        "quality flags of the slopes",
        {bit: name for bit, name in QUALITY.items() if bit <= SATURATED},
        kind="flag_masks",
    ),
    **_SUN,
}
#: Additional variables if the study sets ``output: {raw_slopes: true}``, as in Figure 7 of Defieux et al.
RAW = {
    **_both("raw_slope_%", (*OF_METHOD, *PLANE), "estimated % slope of the mirror, with the defects", _WAVEFRONT),
    **_both(
        "raw_ideal_slope_%",
        (*OF_METHOD, *PLANE),
        "estimated % slope of the ideal heliostat",
        f"effect of heliostat shape and referential; slope_% is raw_slope_% minus this value; {_WAVEFRONT}",
    ),
}

#: Variables of the heliostats in a field.
FIELD = {
    "slant_range": quantity(("heliostat",), "m", "distance between the centres of the heliostat and the target"),
    **{name: replace(one, dims=_HOUR) for name, one in _SCENE.items()},
    **_both(
        "slope_rms_%",
        (*_HOUR, *OF_METHOD),
        "root mean square error of the % slopes of a heliostat",
        _NET.replace("of the eroded module", "of all eroded modules"),
    ),
    **_both(
        "canting_rms_%",
        (*_HOUR, *OF_METHOD),
        "root mean square over the modules of their mean % slope error",
        "includes only modules with slopes",
    ),
    "usable_fraction": _part((*_HOUR, "slope_method"), "fraction of the pixels of the eroded modules that have slopes"),
    "lit_cameras": _part(
        _HOUR, "fraction of the cameras that see the sun in the heliostat", "mean over the pixels of the eroded modules"
    ),
    **{name: replace(SIMULATED[name], dims=_HOUR) for name in ("cramer_rao_bound_x", "cramer_rao_bound_y")},
}

#: Variables that locate the heliostat in an image, in the order used by `compute.registered`.
REGISTERED = {
    "registered_roll": quantity(
        ("camera",),
        "degree",
        "estimated rotation of the camera, clockwise for an observer behind the camera",
        "see the metadata key ROLL",
    ),
    "registered_column": quantity(
        ("camera",), "1", "estimated column of the heliostat's centre", "see the metadata key CENTREU"
    ),
    "registered_row": quantity(
        ("camera",), "1", "estimated row of the heliostat's centre", "see the metadata key CENTREV"
    ),
    "registered_focal_length": quantity(
        ("camera",),
        "1",
        "estimated focal length of the camera divided by the side of a pixel",
        "see the metadata key FOCALPIX",
    ),
    "registration_residual": quantity(
        ("camera",), "1", "root mean square distance of the heliostat's edges from the fitted lines, in pixels"
    ),
}
#: Variables of measured images. Variables that also occur in simulations have the same meaning.
MEASURED = {
    **_ESTIMATES,
    **_SUN,
    **_both(
        "cramer_rao_bound_%",
        ("module",),
        _BOUND,
        "root mean square of the slope uncertainty over the eroded module",
    ),
    "lit_fraction": _part(
        ("camera",),
        "fraction of the mirror's pixels at which a camera sees the sun",
        "excluding the pixels at the edges of the modules",
    ),
    "saturated_fraction": _part(
        ("camera",), "fraction of the mirror's pixels at which an image is saturated", "these pixels are not used"
    ),
    **REGISTERED,
    "white_level": quantity(("camera",), "1", "grey level of the sun's centre, including the dark level"),
    "pixel_noise": quantity(
        (),
        "1",
        "standard deviation of image noise relative to the brightness of the sun's centre",
        "from the study, or estimated from the median of the squared residuals of LM",
    ),
    "gain": quantity((), "1", "median over the pixels of the gain estimated by LM", "1 if no gain is fitted"),
    **_SCENE,
    "image": quantity(
        ("camera", *PLANE),
        "1",
        "brightness relative to the sun's centre",
        "on the mirror grid; missing between modules and for unusable pixels",
    ),
    **_both(
        "slope_%",
        (*OF_METHOD, *PLANE),
        "% slope of the mirror relative to the ideal heliostat",
        f"missing if fewer than three cameras are lit and usable; {_WAVEFRONT}",
    ),
    **_both(
        "slope_uncertainty_%",
        PLANE,
        "standard uncertainty of the % slope of a pixel",
        "for the LM slopes, even if the study selects other methods; includes only image noise, with the derivatives "
        "at the LM slopes; does not include errors in the sun profile, the geometry, or the gain of one camera "
        "relative to another (a relative gain error shifts all slopes equally, like a pointing error)",
    ),
    "residual_rms": quantity(
        (*OF_METHOD, *PLANE),
        "1",
        "root mean square over the lit cameras of the difference between observed and modelled brightness",
    ),
    "mask": MAPS["mask"],
    "quality": flags(
        ("slope_method", *PLANE),
        "quality flags of the slopes",
        QUALITY,
        "a camera is excluded at a pixel that is saturated, invalid, out of frame, at an edge of a module or at the "
        "limb of the disc in the image",
        "flag_masks",
    ),
}

#: Variables whose best value is the minimum: unsigned errors and their bounds.
_SMALLEST = tuple(
    name.replace("%", axis)
    for name in (
        *("slope_rms_%", "canting_rms_%", "waviness_%", "cramer_rao_bound_%", "slope_uncertainty_%", "residual_rms"),
        *("relative_error_%", "relative_error_%_median", "relative_error_%_low", "relative_error_%_high"),
        "sun_fit_rms",
    )
    for axis in "xy"
)

#: Keys that affect only the random numbers of a scene.
SEEDS = ("cameras.seed", "defects.seed", "profile_noise.seed")
#: Percentile over the seeds and its name, for each suffix of a variable name.
PERCENTILES = {"median": (50.0, "median"), "low": (5.0, "5th percentile"), "high": (95.0, "95th percentile")}


def seed_dims(study: BackwardGazingStudy) -> tuple[str, ...]:
    """Return the swept dimensions along which only seeds vary."""
    return tuple(dim.name for dim in study.dimensions() if set(dim.sweeps) <= set(SEEDS))


def variables(study: BackwardGazingStudy) -> dict[str, Variable]:
    """Return the variables of a study.

    If seeds are swept, a study of one simulated heliostat also has percentiles over the seeds.
    """
    maps = {name: replace(MAPS[name], dims=(*_HOUR, *MAPS[name].dims)) for name in ("slope_x", "slope_y")}
    seeds, found = seed_dims(study), FIELD | (maps if study.output.maps else {})
    if study.mode == "measured":
        found = MEASURED
    elif study.field is None:
        found = SIMULATED | (MAPS if study.output.maps else {}) | (RAW if study.output.raw_slopes else {})
        found = found | (over_seeds(seeds) if seeds else {})
    errors = (name for name in found if name.endswith("_standard_error"))
    return with_best(found, ("usable_fraction", "lit_cameras"), (*_SMALLEST, *errors))


def over_seeds(seeds: tuple[str, ...]) -> dict[str, Variable]:
    """Return the variables for percentiles of the relative errors over the seed dimensions."""
    found: dict[str, Variable] = {}
    for ending, (_, which) in PERCENTILES.items():
        long_name = f"{which}, over the seeds, of the relative error of the % slopes"
        found |= _both(f"relative_error_%_{ending}", OF_MODULE, long_name, units="percent")
    return {name: replace(one, finished=True, without=seeds) for name, one in found.items()}


#: Coordinates that are not study keys: long name, and unit if the coordinate is numerical.
COORDINATES = {
    "slope_method": ("method for estimating slopes",),
    "referential": ("conversion of wavefront slopes to mirror slopes",),
    "module": ("number of the module, counted from 1", "1"),
    "module_y": ("position of the module's centre, to the right as seen from the target", "m"),
    "module_z": ("height of the module's centre above the mirror's centre", "m"),
    "module_width": ("width of the module", "m"),
    "module_height": ("height of the module", "m"),
    "camera": ("number of the camera, counted from 1", "1"),
    "y": ("position on the mirror, to the right as seen from the target", "m"),
    "z": ("height on the mirror above its centre", "m"),
    "module_of_pixel": ("number of the module at the pixel, 0 between modules", "1"),
    "hour": ("solar hour", "h"),
    "disc_fraction": ("angle from the centre of the sun's disc divided by the angular radius of the disc", "1"),
    "sun_world_azimuth": ("azimuth of the sun, clockwise from north", "degree"),
    "target_world_azimuth": ("azimuth of the target seen from the heliostat, clockwise from north", "degree"),
}

#: Study keys that label the results of each mode.
_KEYS = (
    "heliostat.focal_length", "heliostat.distance", "heliostat.pixel",
    "target.azimuth", "target.elevation", "target.tilt", "target.face", "sun.azimuth", "sun.elevation",
    "cameras.arrangement", "cameras.radius", "cameras.threshold", "sun_profile", "profile_error",
)  # fmt: skip
_DEFECTS = "cameras.noise", "cameras.gain_error", "cameras.gain_noise", "defects.canting_scale", "defects.waviness"
LABELS = {
    "measured": _KEYS,
    "simulated": (*_KEYS, *_DEFECTS),
    "field": (
        *("field.latitude", "field.day", "field.receiver_height", "field.pivot_height", "field.facing"),
        *_KEYS,
        *_DEFECTS,
    ),
}


def label(name: str, values: Any) -> tuple[Any, dict[str, str]]:
    """Return the values and the attributes of a coordinate in `COORDINATES`."""
    return values, dict(zip(("long_name", "units"), COORDINATES[name], strict=False))


def dims(study: BackwardGazingStudy, maps: bool) -> dict[str, Any]:
    """Return the labels of the inner dimensions, including the map dimensions if `maps` is True."""
    values: dict[str, Any] = {} if study.field is None else {"hour": study.field.hours.values()}
    values |= {"slope_method": np.array(study.method, object), "referential": np.array(study.referential, object)}
    if maps:
        mirror = mirror_grid(study.heliostat.rectangles, study.heliostat.pixel)  # type: ignore[arg-type]  # not swept
        values |= {"z": mirror.z, "y": mirror.y}
    if study.field is None:
        values["module"] = np.arange(1, len(study.heliostat.rectangles.size) + 1)
        values |= {"camera": np.arange(1, CAMERAS + 1), "disc_fraction": np.linspace(0.0, 1.0, NODES)} if maps else {}
    return {name: label(name, one) for name, one in values.items()}
