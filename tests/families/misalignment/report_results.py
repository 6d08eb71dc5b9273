"""Results of the family `misalignment` for its figures: a plain model of spots, without its kernels."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.blocks import ERRORS
from tests.families import gallery

POSITIONS = ((-16, 150, 0), (-60, 300, 0), (-120, 600, 0), (45, 150, 0), (120, 300, 0), (200, 500, 0))
SIZES = np.arange(-12.0, 13.0)
CURVES = {"source": ["canting", "encoder"], "axis": ["elevation", "azimuth"], "error_size": SIZES}
Numbers = Sequence[float] | np.ndarray

UNITS = {"error_size": "mrad", "hour": "h", "declination": "degree", "latitude": "degrees_north", "days_used": "1"}
UNITS |= dict.fromkeys(ERRORS, "mrad") | {"receiver_height": "m", "noise": "m", "percentile": "1"}
UNITS |= {"sun_azimuth": "degree", "sun_elevation": "degree", "error_scale": "1"}
attributes = partial(gallery.attributes, units=UNITS)


def suns(latitude: float, days: Numbers, hours: Numbers) -> np.ndarray:
    """Unit vectors towards the sun, shape (days, hours, 3); NaN below the horizon."""
    d = np.radians(23.45) * np.sin(2 * np.pi * (284 + np.asarray(days, float)) / 365)[:, np.newaxis]
    w, turn = np.radians(15 * (np.asarray(hours, float) - 12)), np.radians(latitude)
    east = -np.cos(d) * np.sin(w)
    north = np.cos(turn) * np.sin(d) - np.sin(turn) * np.cos(d) * np.cos(w)
    up = np.sin(turn) * np.sin(d) + np.cos(turn) * np.cos(d) * np.cos(w)
    vectors = np.stack(np.broadcast_arrays(east, north, up), axis=-1)
    return np.where(vectors[..., 2:] > 0, vectors, np.nan)


def turned(n: np.ndarray, axis: str, angle: np.ndarray) -> np.ndarray:
    """Normals turned by an error about an axis in the mirror."""
    e = unit(np.cross(n, [0.0, 0.0, 1.0]))
    about = e if axis == "elevation" else -np.cross(e, n)
    return n * np.cos(angle) + np.cross(about, n) * np.sin(angle)


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def spots(sun: np.ndarray, pivots: np.ndarray, axis: str, mrad: np.ndarray, height: float = 143.0) -> tuple[Any, Any]:
    """Spots on a north face over (errors, heliostats, days, hours); NaN where the ray goes away from it."""
    to_aim = np.array([0.0, 0.0, height]) - pivots[:, np.newaxis, np.newaxis]
    n = turned(unit(sun + unit(to_aim)), axis, mrad[:, np.newaxis, np.newaxis, np.newaxis, np.newaxis] * 1e-3)
    ray = 2 * (n * sun).sum(axis=-1, keepdims=True) * n - sun
    with np.errstate(divide="ignore", invalid="ignore"):
        far = to_aim[..., 1] / ray[..., 1]
        hit = ray * far[..., np.newaxis] - to_aim
    real = far > 0
    return np.where(real, -hit[..., 0], np.nan), np.where(real, hit[..., 2], np.nan)


def labelled(
    data: Mapping[str, Any], axes: Mapping[str, Any], pivots: Any, mode: str, seed: int = 1, **scalars: Any
) -> xr.Dataset:
    """Data set over axes, in random order if so told by the caller; names alone are filled with their dimensions."""
    pivots = np.asarray(pivots, float)
    labels: dict[str, Any] = {
        name: (name, list(values) if name != "date" else values, attributes(name)) for name, values in axes.items()
    }
    labels["heliostat"] = ("heliostat", np.arange(len(pivots)))
    labels |= {axis: ("heliostat", pivots[:, i], {"units": "m", "long_name": axis}) for i, axis in enumerate("xyz")}
    sides = {"receiver_width": 9.0, "receiver_height_extent": 9.0, "receiver_height": 143.0, "latitude": 37.4}
    for name, value in {**sides, **scalars}.items():
        if name in axes:
            continue
        labels[name] = ((), value, {"units": UNITS.get(name, "m"), "long_name": name.replace("_", " ")})
    about = {"title": "Spots", "mode": mode, "study": json.dumps({"family": "misalignment", "mode": mode})}
    return xr.Dataset(dict(data), labels, about)


def curves(
    days: Numbers = (172,),
    hours: Numbers = (8, 12, 16),
    sweep: Mapping[str, Any] | None = None,
    pivots: Any = POSITIONS,
    **scalars: Any,
) -> xr.Dataset:
    """Result of the mode `curves`."""
    sweep = dict(CURVES if sweep is None else sweep)
    pivots = np.asarray(pivots, float)
    sun, mrad = suns(37.4, days, hours), np.asarray(sweep.get("error_size", [4.0]), float)
    axes = sweep.get("axis", ["elevation"])
    both = np.stack([np.stack(spots(sun, pivots, axis, mrad)) for axis in axes], axis=1)
    core = ("heliostat", "day", "hour")
    y, z = (xr.DataArray(part, dims=("axis", "error_size", *core)) for part in both)
    dims = (*sweep, *core)
    sizes = {
        **{name: len(values) for name, values in sweep.items()},
        **dict(zip(core, (len(pivots), len(days), len(hours)), strict=True)),
    }
    template = xr.DataArray(np.zeros([sizes[dim] for dim in dims]), dims=dims)
    drop = {dim: 0 for dim in ("axis", "error_size") if dim not in sweep}
    y, z = ((part.isel(drop) + template).transpose(*dims) for part in (y, z))
    inside = (abs(y) <= 4.5) & (abs(z) <= 4.5)
    fine = np.linspace(0, 60, 61)
    leave = []
    for axis in axes:
        out = [np.abs(np.stack(spots(sun, pivots, axis, sign * fine))).max(axis=0) > 4.5 for sign in (-1, 1)]
        first = np.min([np.where(one.any(axis=0), fine[one.argmax(axis=0)], np.inf) for one in out], axis=0)
        leave.append(np.where(np.isfinite(sun[..., 0]), first, np.nan))
    tolerance = xr.DataArray(np.stack(leave), dims=("axis", *core)).isel({dim: 0 for dim in drop if dim == "axis"})
    small = [dim for dim in dims if dim != "error_size"]
    tolerance = (tolerance + template.isel(error_size=0, missing_dims="ignore")).transpose(*small)
    least = tolerance.min(["day", "hour"])
    shape = tolerance.shape
    conic = np.broadcast_to([1.0, 0.3, -2.0, 4.0, 1.0, 0.2], (*shape, 6))
    known = tolerance.fillna(np.inf).stack(instant=["day", "hour"]).argmin("instant")
    data = {
        "spot_y": y.assign_attrs(units="m"),
        "spot_z": z.assign_attrs(units="m"),
        "spot_status": xr.where(np.isfinite(y), 0, 3).astype(np.int8),
        "is_real": np.isfinite(y).astype(np.int8),
        "inside": inside.astype(np.int8),
        "hit_fraction": (
            xr.where(inside, 1.0, 0.0).sum("hour") / xr.where(np.isfinite(y), 1.0, 0.0).sum("hour").clip(1)
        ).assign_attrs(units="1", valid_range=[0.0, 1.0]),
        "tracking_tolerance": tolerance.assign_attrs(units="mrad"),
        "conic": ((*small, "conic_coefficient"), conic),
        "eccentricity": (small, np.full(shape, 1.8)),
        "focus_y": (small, np.full(shape, 6.0)),
        "focus_z": (small, np.full(shape, -3.0)),
        "least_tolerance": least.assign_attrs(units="mrad"),
        "hour_of_least_tolerance": (least.dims, np.asarray(hours, float)[known.to_numpy() % len(hours)]),
    }
    axes_of = {**sweep, "day": days, "hour": hours}
    return labelled(data, axes_of, pivots, "curves", **scalars)


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
    **scalars: Any,
) -> xr.Dataset:
    """Result of the mode `mount_errors` with distributions."""
    sweep = dict(sweep or {})
    pivots = np.asarray(pivots, float)
    rng = np.random.default_rng(3)
    lead = [len(values) for values in sweep.values()]
    core = ("heliostat", "day", "hour")
    shape = (*lead, len(pivots), len(days), len(hours))
    night = np.isnan(suns(37.4, days, hours)[..., 0])
    slant = np.hypot(np.linalg.norm(pivots[:, :2], axis=1), 143)[:, np.newaxis, np.newaxis]
    spread = (slant * 4e-3) ** 2 * (0.5 + rng.uniform(0, 0.5, shape))
    lean = spread * 0.6 * np.sin(np.asarray(hours, float) / 4)
    hit = np.clip(1.2 - slant / 500 + rng.uniform(-0.1, 0.1, shape), 0, 1)
    dims = (*sweep, *core)

    def over(values: np.ndarray, units: str) -> xr.DataArray:
        return xr.DataArray(np.where(night, np.nan, values), dims=dims, attrs={"units": units})

    hits = over(hit, "1")
    left = rng.uniform(0, 3, (*shape, 3, 2)) + np.arange(3)[:, np.newaxis] * 3
    left[np.broadcast_to(night[..., np.newaxis, np.newaxis], left.shape)] = np.nan
    data = {
        "spot_y_mean": over(rng.normal(0, 0.3, shape), "m"),
        "spot_z_mean": over(rng.normal(0, 0.3, shape), "m"),
        "spot_y_variance": over(spread, "m2"),
        "spot_z_variance": over(spread * 1.3, "m2"),
        "spot_yz_covariance": over(lean, "m2"),
        "hit_fraction": hits,
        "real_fraction": hits * 0 + 1,
        "day_hit_fraction": hits.mean("hour"),
        "field_hit_fraction": hits.mean("heliostat"),
        "remaining_tolerance": ((*dims, "percentile", "tolerance_axis"), left, {"units": "mrad"}),
    }
    axes = {**sweep, "day": days, "hour": hours}
    axes |= {"percentile": [5.0, 50.0, 95.0], "tolerance_axis": ["elevation", "azimuth"]}
    return labelled(data, axes, pivots, "mount_errors", **scalars)


def calibration(
    sweep: Mapping[str, Any] | None = None,
    pivots: Any = POSITIONS,
    samples: int = 0,
    parameters: int = 4,
    **scalars: Any,
) -> xr.Dataset:
    """Result of the mode `calibration` with synthetic spots of three days."""
    sweep = dict(sweep or {})
    pivots = np.asarray(pivots, float)
    rng = np.random.default_rng(4)
    lead = {name: len(values) for name, values in sweep.items()} | ({"sample": samples} if samples else {})
    many = {**lead, "heliostat": len(pivots)}
    true = rng.normal(0, 1.5, (*many.values(), parameters))
    days = xr.DataArray(np.asarray(sweep.get("days_used", [3]), float), dims="days_used")
    if "days_used" not in sweep:
        days = days.isel(days_used=0)
    scale = xr.DataArray(np.linspace(0.02, 0.3, parameters), dims="parameter") / days
    template = xr.DataArray(np.zeros(true.shape), dims=(*many, "parameter"))
    error = (template + scale).transpose(*template.dims)
    spot = {**many, "day": 3, "hour": 5}
    before = (
        rng.normal([[[1.5]], [[-2.0]]], 0.7, (2, *spot.values()))
        if len(spot) == 2
        else rng.normal(1.5, 0.7, (2, *spot.values()))
    )
    after = rng.normal(0, 0.05, (2, *spot.values()))
    before[..., -1], after[..., -1] = np.nan, np.nan
    data: dict[str, Any] = {
        "estimated_error": (template.dims, rng.normal(true, error.to_numpy()), {"units": "mrad"}),
        "standard_error": error.assign_attrs(units="mrad"),
        "true_error": (template.dims, true, {"units": "mrad"}),
        "condition_number": (tuple(many), (template.isel(parameter=0) + 1700 / days**2).transpose(*many).to_numpy()),
        "residual_rms": (tuple(many), rng.uniform(0.04, 0.06, tuple(many.values())), {"units": "m"}),
    }
    for when, values in (("before", before), ("after", after)):
        for side, part in zip("yz", values, strict=True):
            data[f"spot_{side}_{when}"] = (tuple(spot), part, {"units": "m"})
    axes = {**sweep, "parameter": ERRORS[:parameters], "day": (80, 172, 355), "hour": (8, 10, 12, 14, 16)}
    return labelled(data, axes, pivots, "calibration", **scalars)
