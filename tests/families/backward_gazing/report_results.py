"""Results of the family `backward_gazing` for its figures: its variables over any sweep, with made-up numbers."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.families.backward_gazing.variables import FIELD, MAPS, NODES, SIMULATED, over_seeds
from heliosweep.grid.regions import Variable
from heliosweep.kernels.gazing.geometry import mirror_grid, themis_8
from tests.families import gallery

METHODS = ("A", "O1", "O2", "LM")
REFERENTIALS = ("none", "roll", "exact")
CANTING = {"2": [0, -1], "3": [0, 1]}
UNITS = {"sun_azimuth": "degree", "camera_radius": "m", "latitude": "degrees_north", "camera_noise": "1"}
attributes = partial(gallery.attributes, units=UNITS)
#: Error of each method by referential. [mrad]
ERRORS = {"A": (0.15, 0.03, 2e-4), "O1": (0.14, 0.02, 3e-4), "O2": (1e-4,) * 3, "LM": (3e-6,) * 3}


def result(
    sweep: Mapping[str, Sequence[Any] | np.ndarray] | None = None,
    methods: Sequence[str] = METHODS,
    referentials: Sequence[str] = REFERENTIALS,
    maps: bool = False,
    pixel: float = 0.3,
    modules: int = 8,
    entries: Mapping[str, Variable] | None = None,
    **study: Any,
) -> xr.Dataset:
    """Data set with the variables of a simulated heliostat; those of seeds have medians too."""
    sweep = dict(sweep or {})
    heliostat = themis_8()
    heliostat = heliostat._replace(centre=heliostat.centre[:modules], size=heliostat.size[:modules])
    grid = mirror_grid(heliostat, pixel)
    inner: dict[str, Any] = {
        "slope_method": list(methods),
        "referential": list(referentials),
        "module": np.arange(1, modules + 1),
        "camera": np.arange(1, 5),
        "y": grid.y,
        "z": grid.z,
        "disc_fraction": np.linspace(0.0, 1.0, NODES),
    }
    wanted = dict(entries or {**SIMULATED, **(MAPS if maps else {})})
    seeds = [dim for dim in sweep if dim.endswith("_seed")]
    data = {name: _made(sweep, inner, name, one, grid) for name, one in wanted.items()}
    if seeds and entries is None:
        rest = {dim: values for dim, values in sweep.items() if dim not in seeds}
        data |= {name: _made(rest, inner, name, one, grid) for name, one in over_seeds(()).items()}
    used = {dim for array in data.values() for dim in array.dims}
    labels: dict[str, Any] = {
        name: (name, values, attributes(name)) for name, values in {**sweep, **inner}.items() if name in used
    }
    sides = {"y": heliostat.centre[:, 0], "z": heliostat.centre[:, 1]}
    sides |= {"width": heliostat.size[:, 0], "height": heliostat.size[:, 1]}
    if "module" in used:
        labels |= {f"module_{side}": ("module", values, {"units": "m"}) for side, values in sides.items()}
    told = {"family": "backward_gazing", "mode": "simulated", "defects": {"canting": CANTING, "canting_scale": 1.0}}
    about = {"title": "Slopes", "mode": "simulated", "study": json.dumps({**told, **study})}
    return xr.Dataset(data, labels, about)


def field(hours: Sequence[float] = (9, 12, 15), count: int = 317, sweep: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Data set of a field north of a tower."""
    turn = np.arange(count) * 2.399963
    far = 60 + 19 * np.sqrt(np.arange(count))
    place = np.stack([far * np.sin((turn % np.pi) - np.pi / 2), far * np.cos((turn % np.pi) - np.pi / 2)])
    sweep = dict(sweep or {})
    inner = {"heliostat": np.arange(count), "hour": list(hours), "slope_method": list(METHODS)}
    inner["referential"] = list(REFERENTIALS)
    data = {name: _made(sweep, inner, name, one) for name, one in FIELD.items()}
    for end in "xy":
        data[f"slope_rms_{end}"] = data[f"slope_rms_{end}"] * xr.DataArray(0.2 + far / 100, dims="heliostat")
    data["slant_range"] = xr.DataArray(far, dims="heliostat", attrs={"units": "m"})
    data["usable_fraction"] = (data["usable_fraction"] * xr.DataArray(300 / far, dims="heliostat")).clip(0, 1)
    labels: dict[str, Any] = {name: (name, values, attributes(name)) for name, values in {**sweep, **inner}.items()}
    labels |= {axis: ("heliostat", values, {"units": "m"}) for axis, values in zip("xy", place, strict=True)}
    about = {"title": "Field", "mode": "field", "study": json.dumps({"family": "backward_gazing"})}
    return xr.Dataset(data, labels, about)


def _made(
    sweep: Mapping[str, Any], inner: Mapping[str, Any], name: str, variable: Variable, grid: Any = None
) -> xr.DataArray:
    """Values of one variable."""
    dims = variable.dims
    sizes = {**{dim: len(values) for dim, values in sweep.items()}, **{dim: len(inner[dim]) for dim in dims}}
    rng = np.random.default_rng(len(name))
    template = xr.DataArray(np.zeros(list(sizes.values())), dims=list(sizes))
    values = template + rng.uniform(0.9, 1.1, template.shape)
    if {"slope_method", "referential"} <= set(dims):
        errors = [
            [ERRORS[method][REFERENTIALS.index(r)] for r in inner["referential"]] for method in inner["slope_method"]
        ]
        values = values * xr.DataArray(errors, dims=("slope_method", "referential"))
    if name.startswith("relative_error"):
        values = 100 * values
    values = values * {"low": 0.6, "high": 1.5}.get(name.rpartition("_")[2], 1.0)
    if name.startswith("cramer_rao"):
        values = values * 0.004
    if name.startswith("slope_rms"):
        values = values + 0.004
    if name.startswith("canting") and "module" in dims and "standard" not in name:
        true = [CANTING.get(str(number), [0, 0])[name.endswith("y")] for number in inner["module"]]
        values = values * 0.1 + xr.DataArray(true, dims="module")
    if "z" in dims and grid is not None:
        on = xr.DataArray(grid.module > 0, dims=("z", "y"))
        values = values.where(on)
        if name.startswith(("slope", "true_slope")):
            up = xr.DataArray(grid.module == 2, dims=("z", "y"))
            values = values - up if name.endswith("y") else values
    if name == "mask":
        values = xr.where(values.isnull(), 0, 3)
    if name == "quality":
        values = xr.where(values > 1.08, 1, 0)
    return values.transpose(*sizes).assign_attrs(variable.attrs).astype(variable.dtype)
