"""Check the optics of a study against its input files and mirrors."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.aiming import SLACK, aim_grid, off_receiver
from heliosweep.config import SolarTime, SunDirections, Sweep, ends, few_of, read_profile
from heliosweep.errors import Problem, listed
from heliosweep.families.field_efficiency.light_files import read_calibration, read_slopes
from heliosweep.families.field_efficiency.optics import COLUMNS, KEYS
from heliosweep.families.field_efficiency.traced import Geometry, Inputs, Way, usual_rays
from heliosweep.grid.sun import instant_count
from heliosweep.kernels.device import device_problem
from heliosweep.kernels.rays import MOST_RAYS, RAYS_PER_SECOND, rectangle
from heliosweep.layouts.layout import MAX_LISTED, Layout
from heliosweep.layouts.resolve import SIZE_COLUMNS, Layouts, longest

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy

#: Polynomial attenuation models, and the maximum slant range of these models [m].
POLYNOMIALS, FARTHEST = ("delsol_clear", "delsol_hazy", "ballestrin_clear", "ballestrin_hazy"), 3000.0


def light_faults(study: FieldEfficiencyStudy) -> Iterator[Problem | str]:
    """Check that light reaches the receiver and that the optics match the input files and the mirrors."""
    warned: set[str] = set()
    if study.optics is None:
        return
    for layout, values in Layouts(study).some({"heliostat.pivot_height": min, "receiver.height": max}):
        for found in (*_receiver(study, layout, values), *_errors(study, layout), *mapped(study, layout)):
            if isinstance(found, Problem):
                yield found
                return
            if (kind := found.split(" ", 1)[1]) not in warned:  # warnings that differ only in numbers appear once
                warned.add(kind)
                yield found
    yield from _facets(study)
    yield from _files(study)
    yield from _rays(study)


def _rays(study: Any) -> Iterator[Problem | str]:
    """Check the number of rays and the compute device, and warn if the obsolete key `optics.method` is set."""
    if study.optics.method is not None:
        yield "optics.method is no longer used, because all light is traced with rays: remove it"
    if study.execution.device == "cuda" and (problem := device_problem()):
        yield study.problem("execution.device", problem)
    instants, points = instant_count(study.time), math.prod(map(len, study.dimensions()))
    total = usual_rays(study, longest(study), instants) * longest(study) * instants * points
    if total > MOST_RAYS:
        key, remedy = ("precision", "increase it") if study.optics.rays is None else ("rays", "lower it")
        message = f"requires {total:.2g} rays, {total / RAYS_PER_SECOND / 3600:,.0f} h on one core; the maximum is "
        yield study.problem(f"optics.{key}", f"{message}{MOST_RAYS:.0e}: {remedy}, or compute fewer points")


def _receiver(study: Any, layout: Layout, values: Mapping[str, Any]) -> Iterator[Problem | str]:
    """Check that mirrors are outside the receiver, in front of its face, and within the attenuation range."""
    receiver = study.receiver
    level = np.hypot(layout.x, layout.y)
    radius = max(ends(receiver.radius)) if receiver.radius is not None else 0.0
    if (inside := np.flatnonzero(level <= radius)).size:
        first = f"{layout.where(inside[0])} of {layout.name}"
        if receiver.radius is None:
            yield study.problem("layout", f"{first} is at the centre of the tower; move or remove it")
        else:
            message = (
                "must be less than the distance from the tower to each mirror; mirrors inside the receiver: "
                f"{inside.size:,}, first "
            )
            yield study.problem("receiver.radius", f"{message}{first}; move or remove them")
    lowest = min(ends(receiver.height)) - max(ends(receiver.height_extent)) / 2
    if lowest < min(0.0, layout.z.min(initial=0.0)) and not np.any(np.asarray(ends(receiver.tilt or 0.0))):
        message = f"is too low: the receiver extends {-lowest:g} m below the base of the tower; raise it, or reduce "
        yield study.problem("receiver.height", f"{message}receiver.height_extent")
    down = values["receiver.height"] - layout.z - layout.values("pivot_height", values.get("heliostat.pivot_height"))
    far = np.hypot(level, down)
    if set(POLYNOMIALS) & set(ends(study.optics.attenuation)) and (beyond := int(np.sum(far > FARTHEST))) > 0:
        yield (
            f"{_heliostats(beyond)} farther than {FARTHEST / 1000:g} km from the receiver, beyond the range of "
            f"optics.attenuation"
        )
    yield from _face(study, layout, values, down)


def _face(study: Any, layout: Layout, values: Mapping[str, Any], down: Any) -> Iterator[Problem | str]:
    """Check that no mirror intersects the face of a flat receiver, and warn about mirrors behind the face."""
    receiver = study.receiver
    face = {key: values.get(f"receiver.{key}", getattr(receiver, key)) for key in ("azimuth", "tilt", "width")}
    if face["width"] is None or any(isinstance(value, Sweep) for value in face.values()):
        return
    azimuth, tilt = (np.radians(face[key] or 0.0) for key in ("azimuth", "tilt"))
    made = rectangle((0.0, 0.0, 0.0), azimuth, tilt, face["width"], max(ends(receiver.height_extent)))
    off = np.stack((layout.x, layout.y, -down), axis=1)
    before = off @ np.cross(made.across, made.upward)
    largest = {name: None if (side := getattr(study.heliostat, name)) is None else max(ends(side))
               for name in SIZE_COLUMNS}  # fmt: skip
    reach = np.hypot(*(layout.values(name, side).max() for name, side in largest.items())) / 2
    axes = (made.across, made.half_width), (made.upward, made.half_height)
    beside = [np.maximum(0.0, np.abs(off @ axis) - half) for axis, half in axes]
    if (among := np.flatnonzero(np.hypot(np.hypot(*beside), before) <= reach)).size:
        message = f"intersects mirrors: {among.size:,} in total, first {layout.where(among[0])} of {layout.name}"
        yield study.problem("receiver", f"{message}; raise the receiver, or move the mirrors")
    if (behind := int(np.sum(before <= 0.0))) > 0:
        yield f"light from {_heliostats(behind)} behind the receiver's face is lost"


def _heliostats(count: int) -> str:
    return "1 heliostat" if count == 1 else f"{count:,} heliostats"


def _errors(study: Any, layout: Layout) -> Iterator[Problem]:
    """Check that a calibration is for the mount kind of the study and contains all heliostats of the layout."""
    errors = study.optics.mount_errors
    if errors is None or errors.calibration is None:
        return
    calibrated = read_calibration(study.resolve(errors.calibration), errors.calibration)
    wanted = {"target_aligned" if kind == "spinning_elevation" else kind for kind in ends(study.tracking)}
    if calibrated.mount and wanted != {calibrated.mount}:
        message = f"is for {calibrated.mount} mounts, but 'tracking' is for {' and '.join(sorted(wanted))}"
        yield study.problem("optics.mount_errors.calibration", message)
    calibrated.of(layout)


def _facets(study: FieldEfficiencyStudy) -> Iterator[Problem]:
    """Check that each mirror is larger than the sum of the gaps between its facets."""
    facets = study.heliostat.facets
    for side, count in (("width", facets.columns), ("height", facets.rows)) if facets is not None else ():
        value = getattr(study.heliostat, side)
        least = np.inf if value is None else min(ends(value))
        if facets is not None and least <= (count - 1) * facets.gap:
            yield study.problem("heliostat.facets.gap", f"leaves no {side} for {count} facets on a side of {least:g} m")


def _files(study: Any) -> Iterator[Problem | str]:
    """Check the measured sun shape, the size of each slope map, and the dates for monthly cleanliness."""
    profile = study.optics.sun_shape.file
    if profile is not None and (note := read_profile(study.resolve(profile), profile).note(profile)):
        yield note
    undated = isinstance(study.time, SunDirections) or (
        isinstance(study.time, SolarTime) and study.time.declination is not None
    )
    if study.optics.cleanliness_by_month is not None and undated:
        message = "needs dates: use 'time' with days or dates, or replace the key by 'cleanliness'"
        yield study.problem("optics.cleanliness_by_month", message)
    for name in study.files().get("optics.slope_map", ()):
        found = read_slopes(study.resolve(name), name)
        if (rms := 1e3 * float(np.sqrt(np.nanmean(found.slope**2)))) < 0.01:
            yield (
                f"{name}: the RMS slope is {rms:.2g} mrad, less than for any real mirror. If the file is in rad, "
                "convert it to mrad"
            )
        sides = [ends(getattr(study.heliostat, side)) for side in ("width", "height")]
        if None in (sides[0][0], sides[1][0]):
            message = "needs mirrors of one size: set heliostat.width and height in the study, not in the layout"
            yield study.problem("optics.slope_map", message)
            return
        facets = study.heliostat.facets
        for width, height in itertools.product(*sides):
            if not found.fits(width, height, facets):
                span = (f"{at[0]:g} to {at[-1]:g} m" for at in (found.x, found.y))
                message = (
                    f"{name}: positions along x and y, from {' and '.join(span)}, do not fit a mirror of {width:g} m x "
                )
                facet = "" if facets is None else " or its facets"
                yield study.problem("optics.slope_map", f"{message}{height:g} m{facet}")
                return


def mapped(study: Any, layout: Layout) -> Iterator[Problem | str]:
    """Check the slope maps for a layout, and report the number of heliostats with a map.

    If the study has no slope error, each heliostat must have a map. Otherwise, the slope error applies to heliostats
    without a map.
    """
    key, errors = "optics.slope_map", (study.optics.slope_error, study.optics.slope_error_horizontal)
    for name in study.files().get(key, ()):
        found = read_slopes(study.resolve(name), name)
        if errors != (None, None) and not found.names:
            yield study.problem(
                key, "has one map for all heliostats, but there is also a slope error: remove one of them"
            )
        elif found.names:
            of_map = np.count_nonzero(found.numbers(layout) >= 0)
            others = len(layout) - of_map
            given = errors != (None, None) or "slope_error" in layout.columns
            if not of_map:
                first = f"{layout.name or 'the layout'} by name, id or number: its maps are for {few_of(found.names)}"
                yield study.problem(key, f"{name} has no map that matches a heliostat of {first}")
            elif others and not given:
                yield study.problem(key, f"{name} has no map for {others:,} heliostats: set 'slope_error' for them")
            else:
                yield f"{of_map:,} heliostats have a map in {name}, {others:,} use the slope error of the study"


def aim_faults(study: Any) -> Iterator[Problem | str]:
    """Check that aim points and levels fit on the receiver. Stop at the first point with a problem or warning."""
    if study.aim is None or study.aim.strategy == "centre":
        return
    keys, inputs = (*KEYS, "heliostat.pivot_height", *(f"heliostat.{side}" for side in SIZE_COLUMNS)), Inputs(study)
    extremes: list[dict[str, Callable[..., float]]] = [dict.fromkeys(keys, end) for end in (min, max)]
    if study.aim.strategy == "spread":  # the levels must fit on the receiver for at least one heliostat
        extremes = [extremes[0] | {"receiver.height_extent": max}]
    for layout, values in (point for extreme in extremes for point in Layouts(study).some(extreme)):
        pivot, width, height = (
            layout.values(name, values.get(f"heliostat.{name}")) for name in ("pivot_height", *SIZE_COLUMNS)
        )
        if not np.isfinite(pivot + width + height).all():
            return
        mirrors = (layout.x, layout.y, layout.z + pivot, width / 2, height / 2, None, 0)
        if found := list(_aims_of(Way.at(study, inputs, layout, values.get), mirrors)):
            yield from found
            return


def _aims_of(way: Way, mirrors: Geometry) -> Iterator[Problem | str]:
    study, layout, receiver, aim = way.study, way.layout, way.receiver, way.study.aim
    centre = np.stack(mirrors[:3], axis=1)
    if aim.strategy == "layout":
        if all(key in layout.columns and layout.columns[key].dtype.kind in "if" for key in COLUMNS):
            yield from _off(way, centre)
        else:
            message = f"needs the numeric columns {', '.join(COLUMNS)} in the layout {layout.name}, in m"
            yield study.problem("aim.strategy", message)
    elif aim.strategy == "flux_limit":
        points = aim_grid(receiver, centre, aim.rows, aim.columns, np.radians(aim.azimuth_span))
        if (unseen := np.flatnonzero((off_receiver(receiver, centre, points) > SLACK).any(axis=0))).size:
            if study.receiver.kind == "cylinder":
                message = f"{layout.where(unseen[0])} of {layout.name} does not see the outer aim points; reduce it"
                yield study.problem("aim.azimuth_span", message)
            else:
                yield f"heliostats behind the receiver's face are stowed: {unseen.size:,} of {len(layout):,}"
    elif without := int(np.sum(way.room((*mirrors[:5], way.aims(mirrors, 1), 0)) <= 0)):
        if without == len(layout) and aim.levels != 1:
            message = "leaves no space for levels: the spots of all heliostats are at least as high as the receiver"
            yield study.problem("aim.levels" if aim.levels is not None else "aim", message)
        else:
            spots = f"the spots of {without:,} of {len(layout):,} heliostats"
            yield f"{spots} are at least as high as the receiver: these heliostats aim at its centre"


def _off(way: Way, centre: Any) -> Iterator[Problem]:
    """Yield a problem for each aim point that is off the receiver, or on a side that faces away from the heliostat."""
    layout, points = way.layout, way.aims((*centre.T,), None)
    away = off_receiver(way.receiver, centre, points)
    bad = np.flatnonzero(~(away <= SLACK))

    def problem(row: int) -> Problem:
        far = "nowhere" if np.isnan(away[row]) else f"{away[row]:.4g} m off the receiver"
        what = "on a side of the receiver that faces away from it" if np.isinf(away[row]) else far
        place = ", ".join(f"{key} {value:.6g}" for key, value in zip(COLUMNS, points[row], strict=True))
        line = None if layout.lines is None else int(layout.lines[row])
        return Problem(f"heliostat {row} aims {what}: {place}", file=layout.name, line=line)

    yield from listed(map(problem, bad.tolist()), MAX_LISTED, len(bad), "more problems of this kind")
