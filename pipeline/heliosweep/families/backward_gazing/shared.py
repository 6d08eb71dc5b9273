"""Variables, flags and coordinates that results of all modes have, and data sets made of the values of points.

X is horizontal (y of the mirror: to the right as seen from the target), Y vertical (z, up), as in the paper's Table 1.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from heliosweep.grid.parameters import Parameters
from heliosweep.grid.regions import Variable
from heliosweep.kernels.gazing.mirror import mirror_grid

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.study import BackwardGazingStudy

#: Cameras, and those that must be lit for slopes.
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
#: Bits of `quality`; the first three are those of the kernels of Levenberg-Marquardt.
NOT_CONVERGED, UNLIT, OUTSIDE, EDGE, SATURATED = 1, 2, 4, 8, 16
QUALITY = {
    NOT_CONVERGED: "not_converged",
    UNLIT: "fewer_than_three_cameras_lit",
    OUTSIDE: "beside_the_disc",
    EDGE: "at_the_edge_of_a_module",
    SATURATED: "saturated",
}


def quantity(dims: tuple[str, ...], units: str, long_name: str, comment: str = "", **more: Any) -> Variable:
    """Variable of real numbers, without the swept dimensions."""
    said = {"comment": comment} if comment else {}
    return Variable(dims, {"units": units, "long_name": long_name, **said, **more})


def both(name: str, dims: tuple[str, ...], units: str, long_name: str, comment: str = "") -> dict[str, Variable]:
    """A quantity in both directions; ``%`` in the name stands for x or y, in the long name for the direction."""
    words = {"x": "horizontal", "y": "vertical"}
    return {
        name.replace("%", axis): quantity(dims, units, long_name.replace("%", word), comment)
        for axis, word in words.items()
    }


def part(dims: tuple[str, ...], long_name: str, comment: str = "") -> Variable:
    """A part of a whole, from 0 to 1."""
    return quantity(dims, "1", long_name, comment, valid_range=[0.0, 1.0])


def flags(dims: tuple[str, ...], long_name: str, meanings: Mapping[int, str], comment: str = "") -> Variable:
    """Numbers with meanings, of which each value has one."""
    attrs = {"flag_values": np.array(list(meanings), np.int8), "flag_meanings": " ".join(meanings.values())}
    return replace(quantity(dims, "1", long_name, comment, **attrs), dtype=np.dtype(np.int8))


def quality(bits: Mapping[int, str], comment: str = "") -> Variable:
    """Bits that tell what is doubtful about each slope."""
    attrs = {"flag_masks": np.array(list(bits), np.int8), "flag_meanings": " ".join(bits.values())}
    dims = ("slope_method", *PLANE)
    return replace(quantity(dims, "1", "what is doubtful about a slope", comment, **attrs), dtype=np.dtype(np.int8))


PLANE = ("z", "y")
OF_METHOD = ("slope_method", "referential")
OF_MODULE = (*OF_METHOD, "module")

#: What a plant wants to know, with standard errors.
ESTIMATES = {
    **both(
        "canting_%",
        OF_MODULE,
        "mrad",
        "% slope at the centre of a module, less the pointing of the heliostat",
        "what its screws would have to undo, against the ideal heliostat: modules on a sphere of another focal length "
        "are canted too; by a plane through the slopes of the eroded module",
    ),
    **both(
        "canting_%_standard_error",
        OF_MODULE,
        "mrad",
        "standard error of the % canting",
        "of the scatter of the module and of those that decide the pointing, alone",
    ),
    **both("waviness_%", OF_MODULE, "mrad", "root mean square of what a plane leaves of the % slopes of a module"),
    **both(
        "pointing_%",
        OF_METHOD,
        "mrad",
        "% pointing error of the heliostat",
        "median of the slopes at the centres of its modules, less those of a sphere of focal_length_estimate",
    ),
    **both(
        "pointing_%_standard_error",
        OF_METHOD,
        "mrad",
        "standard error of the % pointing",
        "of the scatter of the modules that decide the median, and of the focal length, alone",
    ),
    "focal_length_estimate": quantity(OF_METHOD, "m", "focal length of the modules"),
    "focal_length_standard_error": quantity(
        OF_METHOD, "m", "standard error of the focal length of the modules", "of scatter alone"
    ),
}

#: How much of a module is seen.
SIGHT = {
    "usable_fraction": part(("slope_method", "module"), "part of the eroded module for which there are slopes"),
    "lit_cameras": part(
        ("module",), "part of the cameras that see the sun in the module", "mean over the pixels of the eroded module"
    ),
}
#: What noise leaves of the slopes of a pixel; of a module it is a mean.
BOUND = "least standard deviation that the cameras leave to % slopes of a pixel"

#: Of the whole scene.
SCENE = {
    "scene_status": flags((), "whether there are slopes, and why not", STATUS),
    "incidence": quantity((), "degree", "angle of the sun from the ideal normal of the heliostat"),
}

MASK = flags(
    PLANE,
    "which pixels count",
    dict(enumerate(("between_modules", "at_the_edge_of_a_module", "fewer_than_three_cameras_lit", "counts"))),
)

#: Coordinates besides those of the study's keys.
COORDINATES: dict[str, dict[str, Any]] = {
    "slope_method": {"long_name": "how slopes are found"},
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

#: Keys of the study that label a result also where they are not swept, and those that label simulated ones.
LABELS = (
    "heliostat.focal_length", "heliostat.distance", "heliostat.pixel",
    "target.azimuth", "target.elevation", "target.tilt", "target.face", "sun.azimuth", "sun.elevation",
    "cameras.arrangement", "cameras.radius", "cameras.threshold", "sun_profile", "profile_error",
)  # fmt: skip
OF_SIMULATIONS = (
    *LABELS, "cameras.noise", "cameras.gain_error", "cameras.gain_noise", "defects.canting_scale", "defects.waviness"
)  # fmt: skip


def swept(study: BackwardGazingStudy, variables: Mapping[str, Variable]) -> dict[str, Variable]:
    """Variables of a point, over the swept dimensions of a study too."""
    dims = tuple(dim.name for dim in study.dimensions())
    return {name: replace(one, dims=(*dims, *one.dims)) for name, one in variables.items()}


def gathered(
    variables: Mapping[str, Variable],
    sizes: Mapping[str, int],
    points: Iterable[tuple[tuple[int, ...], Mapping[str, Any]]],
) -> xr.Dataset:
    """Put the values of points together.

    Parameters
    ----------
    variables : mapping of str to Variable
        With all their dimensions.
    sizes : mapping of str to int
        Lengths of the dimensions over the region that is computed.
    points : iterable of (tuple of int, mapping)
        Index along the first dimensions, and values by the name of the variable.

    Returns
    -------
    xarray.Dataset
        NaN, or 0 of whole numbers, where a point has no value.
    """
    arrays = {
        name: np.full([sizes[dim] for dim in one.dims], math.nan if one.dtype.kind == "f" else 0, one.dtype)
        for name, one in variables.items()
    }
    for index, values in points:
        for name, value in values.items():
            arrays[name][index] = value
    return xr.Dataset({name: (variables[name].dims, array) for name, array in arrays.items()})


def most_pixels(study: BackwardGazingStudy) -> int:
    """Pixels on the modules, for the smallest pixel of the study."""
    smallest = float(Parameters(study).parameter("heliostat.pixel").min())
    return math.ceil(float(np.prod(study.heliostat.rectangles.size, axis=1).sum()) / smallest**2)


def sizes_of(study: BackwardGazingStudy, maps: bool) -> dict[str, int]:
    """Lengths of the dimensions after the swept ones, those of maps too where they are wanted."""
    modules = study.heliostat.rectangles
    sizes = {
        "slope_method": len(study.method), "referential": len(study.referential), "module": len(modules.size)
    }  # fmt: skip
    if maps:
        span = (modules.centre + 0.5 * modules.size).max(axis=0) - (modules.centre - 0.5 * modules.size).min(axis=0)
        columns, rows = np.maximum(np.ceil(span / study.heliostat.pixel - 1e-6), 1.0)  # as mirror_grid has them
        sizes |= {"camera": CAMERAS, "z": int(rows), "y": int(columns)}
    return sizes


def coordinates(study: BackwardGazingStudy, maps: bool, keys: Sequence[str]) -> xr.Dataset:
    """Coordinates of the result of one heliostat; those of `keys` also where they are not swept."""
    parameters, modules = Parameters(study), study.heliostat.rectangles
    labels = parameters.coordinates(keys)
    for block in ("sun", "target"):
        if parameters.has(f"{block}.azimuth"):
            world = (180.0 - parameters.parameter(f"{block}.azimuth")) % 360.0
            labels[f"{block}_world_azimuth"] = world.drop_attrs().assign_attrs(COORDINATES[f"{block}_world_azimuth"])
    labels |= of_methods(study)
    labels["module"] = label("module", np.arange(1, len(modules.size) + 1))
    columns = {"y": modules.centre[:, 0], "z": modules.centre[:, 1], "width": modules.size[:, 0],
               "height": modules.size[:, 1]}  # fmt: skip
    labels |= {f"module_{name}": label(f"module_{name}", column, "module") for name, column in columns.items()}
    if maps:
        mirror = mirror_grid(modules, study.heliostat.pixel)  # type: ignore[arg-type]  # it is not swept with maps
        labels |= {"camera": label("camera", np.arange(1, CAMERAS + 1)), "z": label("z", mirror.z)}
        labels |= {"y": label("y", mirror.y), "module_of_pixel": label("module_of_pixel", mirror.module, *PLANE)}
    return xr.Dataset(coords=labels, attrs=attributes(study))


def of_methods(study: BackwardGazingStudy) -> dict[str, xr.DataArray]:
    """Methods and referentials as coordinates."""
    names = {"slope_method": study.method, "referential": study.referential}
    return {name: label(name, np.array(values, dtype=object)) for name, values in names.items()}


def label(name: str, values: np.ndarray, *dims: str) -> xr.DataArray:
    """One of `COORDINATES`, along itself or the dimensions that are named."""
    return xr.DataArray(values, dims=dims or name, attrs=COORDINATES[name])


def attributes(study: BackwardGazingStudy) -> dict[str, str]:
    """Global attribute on the use that LM makes of a tabulated profile of the sun."""
    return {"profile_of_lm": "smooth fit" if study.smooth else "as it is"}
