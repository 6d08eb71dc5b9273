"""Results of the family `backward_gazing` for its figures: small studies of each mode, computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from heliosweep import api
from heliosweep.kernels.gazing.geometry import themis_8
from tests.conftest import STUDIES
from tests.families.studies import computed

METHODS = ("A", "O1", "O2", "LM")
REFERENTIALS = ("none", "roll", "exact")
CANTING = {"2": [0, -1], "3": [0, 1]}
#: Keys of swept dimensions.
KEYS = {
    **{"sun_profile": "sun_profile", "sun_azimuth": "sun.azimuth", "latitude": "field.latitude"},
    **{"camera_noise": "cameras.noise", "camera_radius": "cameras.radius", "arrangement": "cameras.arrangement"},
    **{"camera_seed": "cameras.seed", "profile_seed": "profile_noise.seed"},
}


def result(
    sweep: Mapping[str, Sequence[Any] | np.ndarray] | None = None,
    methods: Sequence[str] = METHODS,
    referentials: Sequence[str] = REFERENTIALS,
    modules: int = 8,
    pixel: float = 0.3,
    canting: Mapping[str, Any] = CANTING,
    **blocks: Any,
) -> xr.Dataset:
    """Result of one simulated heliostat with so many of the modules of THEMIS, with other keys swept."""
    every = zip(themis_8().centre[:modules].tolist(), themis_8().size.tolist(), strict=False)
    there = {
        "heliostat": {"modules": [{"centre": c, "size": s} for c, s in every], "distance": 120},
        "target": {"azimuth": 0, "elevation": 44},
        "sun": {"azimuth": 30, "elevation": 60},
        "defects": {"canting": {number: one for number, one in canting.items() if int(number) <= modules}},
    }
    return _made({**there, **blocks}, sweep or {}, methods, referentials, pixel)


def field(hours: Sequence[float] = (9, 12, 15), count: int = 60, sweep: Mapping[str, Any] | None = None) -> xr.Dataset:
    """Result of a field about a tower."""
    layout = {"radial_stagger": {"clearance": 16, "inner_radius": 60, "heliostats": count}}
    place = {"latitude": 37.4, "day": 81, "hours": list(hours), "receiver_height": 95, "pivot_height": 7}
    blocks = {"field": {**place, "layout": layout}, "defects": {"canting": CANTING}}
    return _made(blocks, sweep or {}, METHODS, REFERENTIALS, 0.4)


def measured(methods: Sequence[str] = METHODS, referentials: Sequence[str] = REFERENTIALS) -> xr.Dataset:
    """Result of the images that come along, on few pixels."""
    changes = {"heliostat.pixel": 0.3, "method": list(methods), "referential": list(referentials), "erosion": 1}
    return computed(api.load(STUDIES / "gazing_measured.yaml", changes))


def _made(
    blocks: Mapping[str, Any],
    sweep: Mapping[str, Any],
    methods: Sequence[str],
    referentials: Sequence[str],
    pixel: float,
) -> xr.Dataset:
    study = {"family": "backward_gazing", "cameras": {"noise": 0.01}, "erosion": 1, **blocks}
    changes = {"heliostat.pixel": pixel, "method": list(methods), "referential": list(referentials)}
    return computed(api.load(study, changes | {KEYS[dim]: values for dim, values in sweep.items()}))
