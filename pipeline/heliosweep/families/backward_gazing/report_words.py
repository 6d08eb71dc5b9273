"""How the figures of the family call what they show: titles, labels and the words of captions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import xarray as xr

from heliosweep.families.backward_gazing.report_views import (
    DIRECT,
    METHOD,
    MODULE,
    PROFILE,
    REFERENTIAL,
    Point,
    short,
)
from heliosweep.report.labels import axis_label, is_latitude, title_of, unit_of, value_text

#: Scalar coordinates that captions tell, but for these values.
_TOLD = {
    PROFILE: "",
    "sun_azimuth": None,
    "sun_elevation": None,
    "camera_radius": None,
    "camera_noise": 0.0,
    "gain_error": 0.0,
    "profile_error": 0.0,
    "waviness": 0.0,
    "canting_scale": 1.0,
    "latitude": None,
    "day": None,
}

#: Dimensions in few words; titles of more letters are not for captions.
_TITLES = {
    PROFILE: "profile",
    METHOD: "method",
    REFERENTIAL: "referential",
    "sun_azimuth": "azimuth of the sun",
    "sun_elevation": "elevation of the sun",
    "camera_radius": "radius of the cameras",
    "camera_noise": "noise of the cameras",
    "camera_seed": "seed of the cameras",
    "profile_noise": "noise of the profile",
    "profile_seed": "seed of the profile",
    "profile_error": "error of the profile",
    "defect_seed": "seed of the waviness",
    "canting_scale": "factor on the canting",
    "waviness": "waviness",
    "gain_error": "error of gain",
    "image_level": "images",
}
_LONG = 30


def title(result: xr.Dataset, dim: str) -> str:
    """What a dimension is called in captions, in few words."""
    if dim in _TITLES:
        return _TITLES[dim]
    words = title_of(result[dim]) if dim in result.coords else dim.replace("_", " ")
    return words if len(words) <= _LONG else dim.replace("_", " ")


def label(result: xr.Dataset, dim: str) -> str:
    """Label of an axis, always with a unit."""
    if is_latitude(result[dim]):
        return axis_label(result[dim])
    words = axis_label(result[dim])
    return words if words.endswith(")") else f"{words} (1)"


def short_label(result: xr.Dataset, dim: str) -> str:
    """Label of an axis in few words, with the unit."""
    unit = unit_of(result[dim])
    return f"{title(result, dim)} ({unit or '1'})"


def note(result: xr.Dataset, stands: Point, *shown: tuple[str, Sequence[Any]]) -> str:
    """Sentences for a caption: which of many values are shown, and where the rest stands."""
    parts = [
        f"{len(points)} of {result.sizes[dim]} {'modules' if dim == MODULE else f'values of {title(result, dim)}'}"
        for dim, points in shown
        if dim in result.sizes and len(points) < result.sizes[dim]
    ]
    said = [f"Shown are {' and '.join(parts)}."] if parts else []
    direct = METHOD in stands and short(result, METHOD, stands[METHOD]) in DIRECT
    held = [
        f"{title(result, dim)} {short(result, dim, index)} (one of {result.sizes[dim]})"
        for dim, index in stands.items()
        if result.sizes[dim] > 1 and not (dim == REFERENTIAL and direct)
    ]
    for name, plain in _TOLD.items():
        if name in result.coords and not result[name].ndim and result[name].item() != plain:
            held.append(f"{title(result, name)} {value_text(result[name]).replace('_', ' ')}")
    said += [f"Fixed: {', '.join(held)}."] if held else []
    return "".join(f" {sentence}" for sentence in said)
