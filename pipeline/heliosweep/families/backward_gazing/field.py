"""Heliostats of a field at some hours: one scene each, whole heliostats at a time.

Sun and target follow from the place of the heliostat, its distance is the slant range, and its ideal focal length the
same where the study gives none. With ``facing: heliostat`` the target with its cameras is turned about the vertical to
face each heliostat, as four cameras on a ring around a tower could be; with ``fixed`` it keeps `target.face`. Noise and
waviness are drawn anew for each heliostat, noise also for each hour.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from heliosweep.families.backward_gazing import labels, points
from heliosweep.families.backward_gazing.checks import field_layout, field_layouts
from heliosweep.families.backward_gazing.module_results import over_modules
from heliosweep.families.backward_gazing.points import KEYS, Failure, Given, Point
from heliosweep.families.backward_gazing.rows import Row
from heliosweep.families.backward_gazing.seeds import mixed_seed
from heliosweep.families.backward_gazing.variables import (
    BEHIND,
    COORDINATES,
    DTYPES,
    FIELD,
    NO_SUN,
    NOT_SEEN,
    SEEN,
    Entry,
)
from heliosweep.families.layout_axis import LayoutAxis
from heliosweep.grid.axes import Grid
from heliosweep.grid.evaluate import evaluate
from heliosweep.grid.plan import Workload
from heliosweep.kernels.sun import declination_cooper, solar_clock

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.config import BackwardGazingStudy

#: Keys of the field that a scene follows from, in the order of the arguments of a block.
_FIELD_KEYS = ("latitude", "day", "receiver_height", "pivot_height", "facing")
#: Keys that label a result also where they are not swept.
_LABELS = (*(f"field.{key}" for key in _FIELD_KEYS), *labels.LABELS)


def workload(study: BackwardGazingStudy) -> Workload:
    """Sizes and cost, for the plan."""
    assert study.field is not None
    grid, hours = Grid(study), len(study.field.hours)
    heliostats = len(field_layout(study))
    row, pixels = _row(study), labels.most_pixels(study)

    def block_bytes(number: int, length: int) -> int:
        return pixels * points.bytes_per_pixel(study) + 3 * 8 * row.length * number * length

    return Workload(
        parameters=grid.sizes,
        inner={"heliostat": heliostats, **_inner(study)},
        evaluations=heliostats * hours * pixels,
        unit="pixels",
        seconds=points.seconds_per_pixel(study) + points.SECONDS_PER_POINT / pixels,
        splittable="heliostat",
        variables={name: (*grid.sizes, *dims) for name, (dims, _) in FIELD.items()},
        itemsize={name: np.dtype(dtype).itemsize for name, dtype in DTYPES.items()},
        block_bytes=block_bytes,
        coordinate_bytes=8 * (10 * heliostats + hours + 200),
        fixed_bytes=points.KERNEL_BYTES,
    )


def coordinates(study: BackwardGazingStudy, select: Mapping[str, slice] | None = None) -> xr.Dataset:
    """Coordinates of the result over a part of the parameter grid, all of it where `select` is left out."""
    assert study.field is not None
    grid = Grid(study, select)
    found = grid.coordinates(_LABELS) | _layout(study).coordinates()
    found["hour"] = xr.DataArray(study.field.hours.values(), dims="hour", attrs=COORDINATES["hour"])
    for name, values in (("method", study.method), ("referential", study.referential)):
        found[name] = xr.DataArray(np.array(values, dtype=object), dims=name, attrs=COORDINATES[name])
    return xr.Dataset(coords=found, attrs={"profile_of_lm": labels.profile_of_lm(study)})


def build(
    study: BackwardGazingStudy, chunks: Mapping[str, int], select: Mapping[str, slice] | None = None
) -> xr.Dataset:
    """Lazy result over a part of the parameter grid; see `scenes.build`."""
    assert study.field is not None
    grid, layout, row = Grid(study, select), _layout(study), _row(study)
    places = [layout.numbers, *layout.inputs]
    own = [grid.parameter(f"field.{key}") for key in _FIELD_KEYS]
    common: dict[str, Any] = {
        "dims": (*grid.sizes, "heliostat"),
        "sizes": {**grid.sizes, "heliostat": layout.size},
        "chunks": chunks,
    }
    inputs = [*places, *own, *points.inputs(grid)]
    made = evaluate(
        partial(_block, row=row, given=points.given(study), hours=study.field.hours.values()),
        inputs,
        core=[()] * len(inputs),
        outputs=row.outputs(),
        name="field",
        **common,
    )
    ranges = evaluate(
        _ranges,
        [*places[1:], *own[2:4]],
        core=[()] * 5,
        outputs={"slant_range": FIELD["slant_range"][1]},
        name="ranges",
        work=False,
        **common,
    )
    result = ranges | made
    found = coordinates(study, select)
    return xr.Dataset({name: result[name] for name in FIELD}).assign_coords(found.coords).assign_attrs(found.attrs)


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Scenes without slopes and why, and heliostats that no camera sees at any hour."""
    status = result["scene_status"]
    values = status.to_numpy()
    for code in np.unique(values).tolist():
        if code != SEEN:
            words = labels.status_words(code)
            count = int(np.count_nonzero(values == code))
            yield f"no slopes in {count:,} of {values.size:,} scenes: {words} (scene_status {code})"
    never = (status == NOT_SEEN).all("hour")
    if bool(never.any()):
        yield f"{int(never.sum()):,} of {never.size:,} heliostats are all masked: no three cameras see them at any hour"


def _layout(study: BackwardGazingStudy) -> LayoutAxis:
    stand_in: Any = SimpleNamespace(study=field_layouts(study), part=lambda dim: slice(None))
    return LayoutAxis(stand_in)


def _inner(study: BackwardGazingStudy) -> dict[str, int]:
    assert study.field is not None
    return {"hour": len(study.field.hours), "method": len(study.method), "referential": len(study.referential)}


def _row(study: BackwardGazingStudy) -> Row:
    """Row of one heliostat: all its hours."""
    entries: dict[str, Entry] = {
        name: (dims[1:], attrs) for name, (dims, attrs) in FIELD.items() if name != "slant_range"
    }
    return Row(entries, _inner(study))


def _ranges(*arrays: np.ndarray) -> np.ndarray:
    x, y, z, target, pivot = arrays
    return np.sqrt(x**2 + y**2 + (target - z - pivot) ** 2)[np.newaxis]


def _block(*arrays: np.ndarray, row: Row, given: Given, hours: np.ndarray) -> np.ndarray:
    """Rows of a block, shape (1, swept dimensions, heliostat, row)."""
    lead = np.broadcast_shapes(*(array.shape for array in arrays))
    every = [np.broadcast_to(array, lead).ravel() for array in arrays]
    out = np.empty((math.prod(lead), row.length))
    for number, (heliostat, x, y, z, latitude, day, target, pivot, facing, *values) in enumerate(
        zip(*every, strict=True)
    ):
        suns = solar_clock(np.radians(float(latitude)), declination_cooper(float(day)), hours)
        to_target = np.array([-float(x), -float(y), float(target) - float(z) - float(pivot)])
        scenes = [
            _scene(to_target, sun, str(facing), values, given, (int(heliostat), hour)) for hour, sun in enumerate(suns)
        ]
        every_hour = {
            name: np.stack([np.broadcast_to(one.get(name, _missing(name)), row.shape(name)[1:]) for one in scenes])
            for name in row.entries
        }
        out[number] = row.packed(every_hour)
    return out.reshape(1, *lead, row.length)


def _missing(name: str) -> float:
    return 0.0 if name in ("lit_cameras", "usable_fraction") else math.nan


def _scene(
    to_target: np.ndarray, sun: np.ndarray, facing: str, values: list[Any], given: Given, number: tuple[int, int]
) -> dict[str, Any]:
    """Values of the variables of one heliostat at one hour."""
    if not sun[2] > 0.0:
        return {"scene_status": NO_SUN}
    sun_azimuth, sun_elevation = _direction(sun)
    azimuth, elevation = _direction(to_target)
    placed = dict(zip(KEYS, values, strict=True)) | {
        "heliostat.distance": math.sqrt(float(np.sum(to_target**2))),
        "target.azimuth": azimuth,
        "target.elevation": elevation,
        "sun.azimuth": sun_azimuth,
        "sun.elevation": sun_elevation,
    }
    point = Point.of(placed[key] for key in KEYS)
    if facing == "heliostat":
        point = point._replace(face=azimuth)
    elif not _before(point):
        return {"scene_status": BEHIND}
    heliostat, _ = number
    if point.noise:
        point = point._replace(camera_seed=mixed_seed(point.camera_seed, *number))
    if point.waviness:
        point = point._replace(defect_seed=mixed_seed(point.defect_seed, heliostat))
    try:
        seen = points.observed(point, given)
    except Failure as failure:
        return {"scene_status": failure.status}
    return _whole(seen, point, given)


def _direction(vector: np.ndarray) -> tuple[float, float]:
    """Azimuth from south towards east, and elevation, of a vector east, north, up. [deg]"""
    east, north, up = map(float, vector)
    return math.degrees(math.atan2(east, -north)), math.degrees(math.atan2(up, math.hypot(east, north)))


def _before(point: Point) -> bool:
    """Whether the heliostat stands before the face of the target."""
    up, turn = math.radians(point.target_elevation), math.radians(point.target_azimuth - point.face)
    tilt = math.radians(point.tilt)
    return math.cos(tilt) * math.cos(up) * math.cos(turn) + math.sin(tilt) * math.sin(up) > 0.0


def _whole(seen: points.Observation, point: Point, given: Given) -> dict[str, Any]:
    """Values of a heliostat that was seen."""
    error = 1e3 * (seen.net - seen.true)
    mean, rms, number = over_modules(error, seen, given)
    least = points.bound(seen, point, given)
    kept = int(np.count_nonzero(seen.keep))
    with np.errstate(invalid="ignore", divide="ignore"):
        total = np.sqrt(np.sum(np.where(number > 0, rms**2 * number, 0.0), axis=-1) / number.sum(axis=-1))
        some = np.count_nonzero(number, axis=-1)
        canting = np.sqrt(np.sum(np.where(number > 0, mean**2, 0.0), axis=-1) / some)
        bound = (
            np.sqrt(np.nanmean(np.where(seen.keep, 1e3 * least, np.nan) ** 2, axis=-1)) if some.any() else least[:, 0]
        )
    usable = number[:, 0, 0].sum(axis=-1) / kept
    values: dict[str, Any] = {
        "scene_status": SEEN if usable.any() else NOT_SEEN,
        "incidence": math.degrees(seen.layout.incidence),
        "usable_fraction": usable,
        "lit_cameras": float(np.mean(seen.lit[seen.keep])) / labels.CAMERAS,
    }
    for axis, name in enumerate("xy"):
        values[f"slope_rms_{name}"], values[f"canting_rms_{name}"] = total[:, :, axis], canting[:, :, axis]
        values[f"cramer_rao_bound_{name}"] = bound[axis] if usable.any() else math.nan
    return values
