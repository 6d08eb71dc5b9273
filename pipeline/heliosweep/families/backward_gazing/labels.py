"""Coordinates and sizes of a result."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from heliosweep.config.sweep import Listed, Sweep
from heliosweep.families.backward_gazing.checks import modules_of
from heliosweep.families.backward_gazing.variables import COORDINATES, SCENE
from heliosweep.grid.axes import Grid
from heliosweep.kernels.gazing_grid import Modules, mirror_grid

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.config import BackwardGazingStudy

#: Keys of the study that label a result also where they are not swept.
LABELS = (
    "heliostat.focal_length", "heliostat.distance", "heliostat.pixel",
    "target.azimuth", "target.elevation", "target.tilt", "target.face", "sun.azimuth", "sun.elevation",
    "cameras.arrangement", "cameras.radius", "cameras.noise", "cameras.gain_error", "cameras.gain_noise",
    "cameras.threshold", "sun_profile", "profile_error", "defects.canting_scale", "defects.waviness",
)  # fmt: skip
CAMERAS = 4


def shape_of(modules: Modules, pixel: float) -> tuple[int, int]:
    """Rows and columns of the grid that `mirror_grid` makes."""
    half = 0.5 * modules.size
    span = (modules.centre + half).max(axis=0) - (modules.centre - half).min(axis=0)
    columns, rows = np.maximum(np.ceil(span / pixel - 1e-6), 1.0)
    return int(rows), int(columns)


def most_pixels(study: BackwardGazingStudy) -> int:
    """Pixels on the modules, for the smallest pixel of the study."""
    pixel = study.heliostat.pixel
    values = (
        (pixel,) if not isinstance(pixel, Sweep) else pixel[:] if isinstance(pixel, Listed) else (pixel[0], pixel[-1])
    )
    smallest = float(min(values))
    return math.ceil(float(np.prod(modules_of(study).size, axis=1).sum()) / smallest**2)


def sizes_of(study: BackwardGazingStudy) -> dict[str, int]:
    """Dimensions after the swept ones."""
    modules = modules_of(study)
    sizes = {"method": len(study.method), "referential": len(study.referential), "module": len(modules.size)}
    if study.output.maps:
        assert not isinstance(study.heliostat.pixel, Sweep)
        rows, columns = shape_of(modules, study.heliostat.pixel)
        sizes |= {"camera": CAMERAS, "z": rows, "y": columns}
    return sizes


def coordinate_bytes(study: BackwardGazingStudy) -> int:
    """Size of the coordinates. [bytes]"""
    sizes = sizes_of(study)
    return 8 * (200 + 6 * sizes["module"] + sizes.get("z", 0) * sizes.get("y", 0))


def coordinates(
    study: BackwardGazingStudy, select: Mapping[str, slice] | None = None, keys: Sequence[str] = LABELS
) -> xr.Dataset:
    """Coordinates of the result over a part of the parameter grid, all of it where `select` is left out.

    Those of `keys` are there also where they are not swept.
    """
    grid, modules = Grid(study, select), modules_of(study)
    labels = grid.coordinates(keys)
    for block in ("sun", "target"):
        if grid.has(f"{block}.azimuth"):
            world = (180.0 - grid.parameter(f"{block}.azimuth")) % 360.0
            name = f"{block}_world_azimuth"
            labels[name] = world.drop_attrs().assign_attrs(COORDINATES[name])
    labels |= {
        "method": _named("method", np.array(study.method, dtype=object)),
        "referential": _named("referential", np.array(study.referential, dtype=object)),
        "module": _named("module", np.arange(1, len(modules.size) + 1)),
    }
    columns = {"y": modules.centre[:, 0], "z": modules.centre[:, 1], "width": modules.size[:, 0],
               "height": modules.size[:, 1]}  # fmt: skip
    for name, column in columns.items():
        labels[f"module_{name}"] = xr.DataArray(column, dims="module", attrs=COORDINATES[f"module_{name}"])
    if study.output.maps:
        assert not isinstance(study.heliostat.pixel, Sweep)
        mirror = mirror_grid(modules, study.heliostat.pixel)
        labels |= {
            "camera": _named("camera", np.arange(1, CAMERAS + 1)),
            "z": _named("z", mirror.z),
            "y": _named("y", mirror.y),
            "module_of_pixel": xr.DataArray(mirror.module, dims=("z", "y"), attrs=COORDINATES["module_of_pixel"]),
        }
    return xr.Dataset(coords=labels, attrs={"profile_of_lm": profile_of_lm(study)})


def profile_of_lm(study: BackwardGazingStudy) -> str:
    """What LM does with a tabulated profile of the sun, as results say it."""
    return "smooth fit" if study.smooth else "as it is"


def _named(name: str, values: np.ndarray) -> xr.DataArray:
    return xr.DataArray(values, dims=name, attrs=COORDINATES[name])


def status_words(code: int) -> str:
    """What a scene_status means, in words."""
    attrs = SCENE["scene_status"][1]
    meanings = dict(zip(attrs["flag_values"].tolist(), attrs["flag_meanings"].split(), strict=True))
    return str(meanings[code]).replace("_", " ")
