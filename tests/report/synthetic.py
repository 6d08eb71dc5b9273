"""Small results of the family `field_efficiency` without computing anything."""

import json
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.api import load
from heliosweep.families.field_efficiency import variables
from heliosweep.grid.regions import Variable
from tests.conftest import SMALL

BOTH = ("spinning_elevation", "azimuth_elevation")
UNITS = {"latitude": "degrees_north", "receiver_height": "m", "clearance": "m"}


def result(
    sweep: Mapping[str, Sequence[Any] | np.ndarray] | None = None,
    heliostats: int = 7,
    attrs: Mapping[str, str] | None = None,
    **scalars: Any,
) -> xr.Dataset:
    """Data set with the variables of the family over any sweep; values are random, the same every time."""
    sweep = dict(sweep or {})
    rng = np.random.default_rng(1)
    shape = tuple(map(len, sweep.values()))
    labels: dict[str, Any] = {}
    for name, values in sweep.items():
        units = {"units": UNITS[name]} if name in UNITS else {}
        labels[name] = (name, list(values), {"long_name": name.replace("_", " "), **units})
    for name, value in scalars.items():
        labels[name] = ((), value, {"long_name": name.replace("_", " "), "units": UNITS.get(name, "m")})
    angle = 2 * np.pi * np.arange(heliostats) / heliostats
    for name, values in (("x", 100 * np.sin(angle)), ("y", 80 + 100 * np.cos(angle)), ("z", 0 * angle)):
        labels[name] = ("heliostat", values, {"units": "m", "long_name": name})
    for side in ("heliostat_width", "heliostat_height"):
        labels[side] = ((), 11.0, {"units": "m", "long_name": side.replace("_", " ")})
    data: dict[str, Any] = {
        name: ((*sweep, "heliostat"), rng.uniform(0.6, 0.9, (*shape, heliostats)), attrs)
        for name, attrs in _attributes(variables.EFFICIENCIES).items()
    }
    means = (*(f"field_{name}" for name in variables.EFFICIENCIES), variables.FACTORED)
    data |= {name: (tuple(sweep), rng.uniform(0.6, 0.9, shape), attrs) for name, attrs in _attributes(means).items()}
    about = {"title": "A field", "summary": "Some words.", "study": json.dumps({"family": "field_efficiency"})}
    return xr.Dataset(data, labels, {**about, **(attrs or {})})


@cache
def _stated() -> dict[str, Variable]:
    """Variables of a study with time series."""
    study: Any = load({**SMALL, "output": {"time_series": True}})
    return variables.variables(study)


def _attributes(names: Iterable[str]) -> dict[str, Mapping[str, Any]]:
    """Attributes of some variables of the family."""
    return {name: _stated()[name].attrs for name in names}
