"""Results of the family `misalignment` for its figures: small studies of each mode, computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from heliosweep import api
from tests.families.misalignment import studies

POSITIONS = ((-16, 150, 0), (-60, 300, 0), (-120, 600, 0), (45, 150, 0), (120, 300, 0), (200, 500, 0))
SIZES = np.arange(-12.0, 13.0)
CURVES = {"source": ["canting", "encoder"], "axis": ["elevation", "azimuth"], "error_size": SIZES}
Numbers = Sequence[float] | np.ndarray

#: Keys of swept dimensions.
KEYS = {
    **{"source": "error.source", "axis": "error.axis", "error_size": "error.size", "error_scale": "mount_errors.scale"},
    **{"tilt_about_north": "mount_errors.tilt_about_north", "receiver_height": "receiver.height"},
    **{"mount_kind": "mount.kind", "days_used": "calibration.days_used", "noise": "calibration.noise"},
}
PLANT = {key: studies.CURVES[key] for key in ("family", "site", "receiver")}
DRAWN = {name: {"normal": [0, width]} for name, width in zip(studies.ERRORS, (1.5, 1.5, 1, 1, 0.5, 0.5), strict=True)}


def result(
    blocks: Mapping[str, Any], sweep: Mapping[str, Any], pivots: Any, days: Numbers, hours: Numbers
) -> xr.Dataset:
    """What is computed of some blocks of a study, with other keys swept."""
    time = {"clock": "solar", "days": list(days), "hours": list(hours)}
    plant = {**PLANT, "time": time, "heliostats": {"positions": np.asarray(pivots, float).tolist()}}
    return studies.computed(api.load({**plant, **blocks}, {KEYS[dim]: values for dim, values in sweep.items()}))


def curves(
    days: Numbers = (172,),
    hours: Numbers = (8, 12, 16),
    sweep: Mapping[str, Any] | None = None,
    pivots: Any = POSITIONS,
) -> xr.Dataset:
    """Result of the mode `curves`."""
    return result({"error": {"size": 4}}, CURVES if sweep is None else sweep, pivots, days, hours)


def field(count: int = 317) -> np.ndarray:
    """Pivots of a field north of the tower. [m]"""
    golden = np.arange(count) * 2.399963
    far = 60 + 9.5 * np.sqrt(np.arange(count)) * 2
    turn = (golden % np.pi) - np.pi / 2
    return np.stack([far * np.sin(turn), far * np.cos(turn), np.full(count, 7.0)], axis=-1)


def draws(
    sweep: Mapping[str, Any] | None = None,
    pivots: Any = POSITIONS,
    days: Numbers = (80, 172, 355),
    hours: Numbers = tuple(range(5, 20)),
) -> xr.Dataset:
    """Result of the mode `mount_errors` with distributions."""
    blocks = {"mode": "mount_errors", "mount_errors": {**DRAWN, "samples": 20}}
    return result({**blocks, "statistics": {"percentiles": [5, 50, 95]}}, sweep or {}, pivots, days, hours)


def calibration(
    sweep: Mapping[str, Any] | None = None,
    pivots: Any = POSITIONS,
    samples: int = 0,
    parameters: int = 4,
) -> xr.Dataset:
    """Result of the mode `calibration` with synthetic spots of three days."""
    errors = {**DRAWN, "samples": samples} if samples else studies.CALIBRATION["mount_errors"]
    blocks = {"mode": "calibration", "mount_errors": errors, "calibration": {"parameters": parameters, "noise": 0.05}}
    return result(blocks, sweep or {}, pivots, (80, 172, 355), (8, 10, 12, 14, 16))
