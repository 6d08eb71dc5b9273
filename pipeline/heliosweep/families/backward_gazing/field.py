"""Heliostats of a field at some hours, one scene each, over a region of a study's grid.

Sun and target follow from the place of the heliostat, its distance is the slant range, and its ideal focal length the
same where the study gives none. With ``facing: heliostat`` the target with its cameras is turned about the vertical to
face each heliostat, as four cameras on a ring around a tower could be; with ``fixed`` it keeps `target.face`. Noise and
waviness are drawn anew for each heliostat, noise also for each hour.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from heliosweep.families.backward_gazing import simulated
from heliosweep.families.backward_gazing import variables as told
from heliosweep.families.backward_gazing.points import (
    KERNEL_BYTES,
    KEYS,
    Failure,
    Point,
    by_axis,
    bytes_per_pixel,
    gathered,
)
from heliosweep.families.backward_gazing.simulated import Given, Observation, bound, observed
from heliosweep.families.backward_gazing.variables import BEHIND, CAMERAS, NO_SUN, NOT_SEEN, SEEN, STATUS
from heliosweep.grid.layout_axis import LayoutAxis, longest
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Workload
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.sun.clock import declination_cooper, solar_clock

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.study import BackwardGazingStudy
    from heliosweep.grid.regions import Region

#: Key of the layouts in the study, and keys that a scene follows from.
LAYOUT = "field.layout"
_FIELD_KEYS = ("field.latitude", "field.day", "field.receiver_height", "field.pivot_height", "field.facing")
#: What is none where a heliostat is not seen.
_NOTHING = {"usable_fraction": 0.0, "lit_cameras": 0.0}


def workload(study: BackwardGazingStudy) -> Workload:
    """Sizes and cost, for the plan."""
    heliostats, pixels, inner = longest(study, LAYOUT), told.most_pixels(study), _inner(study)
    return Workload(
        parameters=Parameters(study).sizes,
        inner={"heliostat": heliostats, **inner},
        evaluations=heliostats * inner["hour"] * pixels,
        unit="pixels",
        splittable="heliostat",
        working_bytes=lambda points, length: pixels * bytes_per_pixel(study),
        coordinate_bytes=8 * (10 * heliostats + inner["hour"] + 200),
        fixed_bytes=KERNEL_BYTES,
    )


def coordinates(study: BackwardGazingStudy) -> xr.Dataset:
    """Coordinates of the whole result, in memory."""
    labels = Parameters(study).coordinates((*_FIELD_KEYS, *told.OF_SIMULATIONS))
    labels |= LayoutAxis(study, LAYOUT).coordinates() | told.of_methods(study)
    labels["hour"] = told.label("hour", _hours(study))
    return xr.Dataset(coords=labels, attrs=told.attributes(study))


def inputs(study: BackwardGazingStudy) -> tuple[Given, LayoutAxis]:
    """Heliostat, cameras, methods and table of the sun, the same for all points, and the layout. Raises StudyError."""
    return simulated.inputs(study), LayoutAxis(study, LAYOUT)


def compute(study: BackwardGazingStudy, inputs: tuple[Given, LayoutAxis], region: Region) -> xr.Dataset:
    """Values of every heliostat of a region at all hours, NaN where there are no slopes."""
    parameters, (given, layouts) = Parameters(study, region), inputs
    span, hours = range(layouts.size)[region.get("heliostat", slice(None))], _hours(study)
    layout = layouts.at({})

    def points() -> Iterator[tuple[tuple[int, ...], dict[str, Any]]]:
        for index, (latitude, day, target, pivot, facing, *values) in parameters.points(*_FIELD_KEYS, *KEYS):
            x, y, z = (column[span.start : span.stop] for column in (layout.x, layout.y, layout.z))
            yield index, {"slant_range": np.sqrt(x**2 + y**2 + (target - z - pivot) ** 2)}
            suns = solar_clock(np.radians(float(latitude)), declination_cooper(float(day)), hours)
            for row, to_target in enumerate(np.stack((-x, -y, target - z - pivot), axis=1)):
                for hour, sun in enumerate(suns):
                    number = span.start + row, hour
                    yield (*index, row, hour), _NOTHING | _scene(to_target, sun, facing, values, given, number)

    sizes = {**parameters.sizes, "heliostat": len(span), **_inner(study)}
    return gathered(told.variables(study), sizes, points())


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Scenes without slopes and why, and heliostats that no camera sees at any hour."""
    status = result["scene_status"]
    for code, count in zip(*np.unique(status, return_counts=True), strict=True):
        if code != SEEN:
            words = STATUS[int(code)].replace("_", " ")
            yield f"no slopes in {count:,} of {status.size:,} scenes: {words} (scene_status {code})"
    never = (status == NOT_SEEN).all("hour")
    if bool(never.any()):
        yield f"{int(never.sum()):,} of {never.size:,} heliostats are all masked: no three cameras see them at any hour"


def mixed_seed(seed: int, *numbers: int) -> int:
    """A seed of its own for each of some numbers, whatever the others are: by the finaliser of SplitMix64."""
    state = seed
    for number in numbers:
        state = (state + (number + 1) * 0x9E3779B97F4A7C15) % 2**64
        state = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) % 2**64
        state = ((state ^ (state >> 27)) * 0x94D049BB133111EB) % 2**64
        state ^= state >> 31
    return state % 2**63


def _hours(study: BackwardGazingStudy) -> Floats:
    assert study.field is not None
    return study.field.hours.values()


def _inner(study: BackwardGazingStudy) -> dict[str, int]:
    return {"hour": len(_hours(study)), "slope_method": len(study.method), "referential": len(study.referential)}


def _scene(
    to_target: Floats, sun: Floats, facing: str, values: list[Any], given: Given, number: tuple[int, int]
) -> dict[str, Any]:
    """Values of the variables of one heliostat at one hour, whose numbers make the seeds."""
    if not sun[2] > 0.0:
        return {"scene_status": NO_SUN}
    (sun_azimuth, sun_elevation), (azimuth, elevation) = _direction(sun), _direction(to_target)
    point = Point.of(
        values,
        distance=math.sqrt(float(np.sum(to_target**2))),
        target_azimuth=azimuth,
        target_elevation=elevation,
        sun_azimuth=sun_azimuth,
        sun_elevation=sun_elevation,
    )
    if facing == "heliostat":
        point = point._replace(face=azimuth)
    elif not _before(point):
        return {"scene_status": BEHIND}
    if point.noise:
        point = point._replace(camera_seed=mixed_seed(point.camera_seed, *number))
    if point.waviness:
        point = point._replace(defect_seed=mixed_seed(point.defect_seed, number[0]))
    try:
        return _whole(observed(point, given), point, given)
    except Failure as failure:
        return {"scene_status": failure.status}


def _direction(vector: Floats) -> tuple[float, float]:
    """Azimuth from south towards east, and elevation, of a vector east, north, up. [deg]"""
    east, north, up = map(float, vector)
    return math.degrees(math.atan2(east, -north)), math.degrees(math.atan2(up, math.hypot(east, north)))


def _before(point: Point) -> bool:
    """True where the heliostat stands before the face of the target."""
    up, turn = math.radians(point.target_elevation), math.radians(point.target_azimuth - point.face)
    tilt = math.radians(point.tilt)
    return math.cos(tilt) * math.cos(up) * math.cos(turn) + math.sin(tilt) * math.sin(up) > 0.0


def _whole(seen: Observation, point: Point, given: Given) -> dict[str, Any]:
    """Values of a heliostat that was seen."""
    mean, rms, number = seen.over_modules(1e3 * (seen.net - seen.true))
    least = bound(seen, point, given)
    with np.errstate(invalid="ignore", divide="ignore"):
        total = np.sqrt(np.sum(np.where(number > 0, rms**2 * number, 0.0), axis=-1) / number.sum(axis=-1))
        some = np.count_nonzero(number, axis=-1)
        canting = np.sqrt(np.sum(np.where(number > 0, mean**2, 0.0), axis=-1) / some)
        squares = np.where(seen.keep, 1e3 * least, np.nan) ** 2
        bounds = np.sqrt(np.nanmean(squares, axis=-1)) if some.any() else least[:, 0]
    usable = number[:, 0, 0].sum(axis=-1) / int(np.count_nonzero(seen.keep))
    values: dict[str, Any] = {
        "scene_status": SEEN if usable.any() else NOT_SEEN,
        "incidence": math.degrees(seen.layout.incidence),
        "usable_fraction": usable,
        "lit_cameras": float(np.mean(seen.lit[seen.keep])) / CAMERAS,
    }
    bounds = bounds if usable.any() else np.full(2, math.nan)
    values |= by_axis("slope_rms_%", total) | by_axis("canting_rms_%", canting)
    return values | by_axis("cramer_rao_bound_%", bounds, 0)
