"""The variables of the mode measured: names, CF attributes and what each means, in the order of the file.

Those that simulations have too are called as there, and mean the same.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from heliosweep.families.backward_gazing import variables as common
from heliosweep.families.backward_gazing.variables import Entry

__all__ = ["DTYPES", "MEASURED", "METADATA", "NOT_A_NUMBER", "OUT_OF_FRAME"]

#: Bits of `quality` beyond those of simulations.
NOT_A_NUMBER, OUT_OF_FRAME = 32, 64
_QUALITY = {
    common.NOT_CONVERGED: "not_converged",
    common.UNLIT: "fewer_than_three_cameras_lit",
    common.OUTSIDE: "beside_the_disc",
    common.EDGE: "at_the_edge_of_a_module",
    common.SATURATED: "saturated",
    NOT_A_NUMBER: "not_a_number",
    OUT_OF_FRAME: "out_of_frame",
}

_OF_METHOD, _PLANE = ("method", "referential"), ("z", "y")
_SLOPE = (
    "missing where fewer than three cameras are lit and usable; of O2 and LM the same for every referential, which "
    "they do not need"
)


def _both(name: str, dims: tuple[str, ...], long_name: str, comment: str) -> dict[str, Entry]:
    return {
        name.replace("%", axis): (
            dims,
            {"units": "mrad", "long_name": long_name.replace("%", word), "comment": comment},
        )
        for axis, word in (("x", "horizontal"), ("y", "vertical"))
    }


_ESTIMATES = {
    name: (dims, {**attrs, "comment": f"{attrs['comment']}; the slopes' noise is taken out of it"})
    if name.startswith("waviness") and "comment" in attrs
    else (dims, attrs)
    for name, (dims, attrs) in common.ESTIMATES.items()
}

#: Of the cameras.
CAMERAS: dict[str, Entry] = {
    "lit_fraction": (
        ("camera",),
        {
            "units": "1",
            "long_name": "part of the mirror's pixels in which a camera sees the sun",
            "comment": "of those that are not at the edge of a module",
            "valid_range": [0.0, 1.0],
        },
    ),
    "saturated_fraction": (
        ("camera",),
        {
            "units": "1",
            "long_name": "part of the mirror's pixels in which an image is saturated",
            "comment": "these are not used",
            "valid_range": [0.0, 1.0],
        },
    ),
    "white_level": (
        ("camera",),
        {"units": "1", "long_name": "level of the sun's centre, the dark level included"},
    ),
    "pixel_noise": (
        (),
        {
            "units": "1",
            "long_name": "standard deviation of a pixel of the images relative to the sun's centre",
            "comment": "as the study states it, or from the median of the squared residuals of LM",
        },
    ),
    "gain": (
        (),
        {
            "units": "1",
            "long_name": "median over the pixels of the gain that LM finds",
            "comment": "1 where no gain is fitted",
        },
    ),
}

_MAPS: dict[str, Entry] = {
    "image": (
        ("camera", *_PLANE),
        {
            "units": "1",
            "long_name": "brightness relative to the sun's centre",
            "comment": "put on the grid of the mirror; missing between modules, and where a pixel cannot be used",
        },
    ),
    **_both("slope_%", (*_OF_METHOD, *_PLANE), "% slope of the mirror relative to the ideal heliostat", _SLOPE),
    **_both(
        "slope_uncertainty_%",
        _PLANE,
        "standard uncertainty of the % slope of a pixel",
        "of the slopes of LM, also where other methods are asked for: from the noise of the images alone, by the "
        "derivatives at the slopes that LM finds; an error of the sun's "
        "profile, of the geometry, or of one camera's gain against another's does not show in it (the last shifts all "
        "slopes alike, as a pointing error would)",
    ),
    "residual_rms": (
        (*_OF_METHOD, *_PLANE),
        {
            "units": "1",
            "long_name": "root mean square over the lit cameras of the brightness seen less that of the slopes found",
        },
    ),
    "mask": common.MAPS["mask"],
    "quality": (
        ("method", *_PLANE),
        {
            "units": "1",
            "long_name": "what is doubtful about a slope",
            "comment": "a camera that is saturated, not a number, out of frame, at an edge or at the limb of the disc "
            "is left out at the pixel",
            "flag_masks": np.array(list(_QUALITY), np.int8),
            "flag_meanings": " ".join(_QUALITY.values()),
        },
    ),
}

#: All of them.
MEASURED: dict[str, Entry] = {
    **_ESTIMATES,
    "usable_fraction": common.SIGHT["usable_fraction"],
    "lit_cameras": common.SIGHT["lit_cameras"],
    **_both(
        "cramer_rao_bound_%",
        ("module",),
        "least standard deviation that the cameras leave to % slopes of a pixel",
        "root mean square of the slope uncertainty over the eroded module",
    ),
    **CAMERAS,
    **common.SCENE,
    **_MAPS,
}

#: Variables that are not float64.
DTYPES: dict[str, type] = dict.fromkeys(("scene_status", "mask", "quality"), np.int8)

#: Coordinates that metadata of the images may give.
METADATA: dict[str, dict[str, Any]] = {
    "sun_azimuth": {"units": "degree", "long_name": "azimuth of the sun, from south towards east"},
    "sun_elevation": {"units": "degree", "long_name": "elevation of the sun", "standard_name": "solar_elevation_angle"},
    "target_azimuth": {
        "units": "degree",
        "long_name": "azimuth of the target seen from the heliostat, from south towards east",
    },
    "target_elevation": {"units": "degree", "long_name": "elevation of the target seen from the heliostat"},
    "distance": {"units": "m", "long_name": "distance of heliostat and target"},
}
