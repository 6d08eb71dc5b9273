"""Checks between the blocks of a study and of the files that it names; NumPy only, for quick validation."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from heliosweep.config.study import parameters
from heliosweep.config.sweep import Sweep, ends
from heliosweep.errors import Problem, StudyError
from heliosweep.families.backward_gazing.files import read_disc
from heliosweep.kernels.gazing import geometry
from heliosweep.layouts.resolve import Layouts

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.shots import Shots
    from heliosweep.families.backward_gazing.study import BackwardGazingStudy

#: Problems, and notes as text.
Found = Iterator[Problem | str]
#: Pixels of a mirror that any machine could hold.
MAX_PIXELS = 20_000_000
#: Two modules may share so much of a side by rounding. [m]
_SLACK = 1e-9
#: Part of an image's lit pixels that may be saturated before it is refused.
MOST_SATURATED = 0.5
#: Difference of study and metadata that is said: of angles and, relatively, of the distance. [deg, 1]
DIFFERENT = 0.05, 1e-3
#: Least area of a marked heliostat, and of the triangle of any three of its corners over the whole. [pixels, 1]
LEAST_AREA, LEAST_TRIANGLE = 16.0, 0.05
#: Keys of simulations, by their beginning.
SIMULATED = (
    "defects.", "profile_noise.", "cameras.noise", "cameras.gain_error", "cameras.gain_noise", "cameras.bits",
    "cameras.images", "cameras.supersampling", "cameras.seed",
)  # fmt: skip


def reserved(study: BackwardGazingStudy) -> frozenset[str]:
    """Names that columns of a layout must leave to the result: its variables, labels and dimensions."""
    from heliosweep.families.backward_gazing import variables as told  # xarray is not for studies without a layout

    keys = (
        getattr(parameter, "dimension", "") or key.rpartition(".")[2]
        for key, parameter, _ in parameters(study)
        if getattr(parameter, "sweep", True) and not key.startswith("field.layout.")
    )
    labels = (*told.COORDINATES, "heliostat", "heliostat_width", "heliostat_height")
    return frozenset((*told.FIELD, *told.SIMULATED, *told.MAPS, *told.over_seeds(()), *labels, *keys))


def _modules(study: BackwardGazingStudy) -> Found:
    """No two modules may share a part of the mirror."""
    modules = study.heliostat.rectangles
    for one, other in itertools.combinations(range(len(modules.size)), 2):
        shared = 0.5 * (modules.size[one] + modules.size[other]) - np.abs(modules.centre[one] - modules.centre[other])
        if np.all(shared > _SLACK):
            message = f"overlaps module {one + 1} by {shared[0]:.4g} m x {shared[1]:.4g} m"
            yield study.problem(f"heliostat.modules[{other}]", message)


def _pixels(study: BackwardGazingStudy) -> Found:
    """Every module needs pixels, and the machine room for them."""
    modules = study.heliostat.rectangles
    largest, smallest = max(ends(study.heliostat.pixel)), min(ends(study.heliostat.pixel))
    side, number = float(modules.size.min()), int(np.argmin(modules.size.min(axis=1))) + 1
    span = (modules.centre + 0.5 * modules.size).max(axis=0) - (modules.centre - 0.5 * modules.size).min(axis=0)
    with np.errstate(over="ignore"):  # pixels of 1e-310 m are too many, too
        count = float(np.prod(np.ceil(span / smallest)))
    if largest > side:
        message = f"must be at most {side:g} m, the shorter side of module {number}"
        yield study.problem("heliostat.pixel", f"{message} (got {largest:g})")
    elif count > MAX_PIXELS:
        message = f"is too small: {count:.3g} pixels are more than {MAX_PIXELS:,}"
        yield study.problem("heliostat.pixel", f"{message} (got {smallest:g})")
    else:
        lost = max(ends(study.erosion))
        if side / largest <= 2 * lost + 1:
            message = f"leaves no pixels of {largest:g} m of module {number}, {side:g} m wide"
            hint = "lower it, or make heliostat.pixel smaller"
            yield study.problem("erosion", f"{message}; {hint} (got {lost:g})")
    if study.output.maps and isinstance(study.heliostat.pixel, Sweep):
        yield study.problem("output.maps", "must be false where heliostat.pixel is swept: each pixel has its own grid")


def _canting(study: BackwardGazingStudy) -> Found:
    """Canting and curvature are of modules that there are."""
    count = len(study.heliostat.rectangles.size)
    numbers = set(map(str, range(1, count + 1)))
    for block in ("canting", "curvature"):
        for key in getattr(study.defects, block) or ():
            if key not in numbers:
                yield study.problem(f"defects.{block}.{key}", f"no such module: the heliostat has modules 1 to {count}")


def _cameras(study: BackwardGazingStudy) -> Found:
    """Seen from the heliostat, the cameras must not stand in one line."""
    cameras, target = study.cameras, study.target
    arrangements = map(str, ends(cameras.arrangement))
    placed = [geometry.camera_square(min(ends(cameras.radius)), name) for name in arrangements]
    if cameras.positions is not None:
        placed = [np.array(cameras.positions)]
        if geometry.in_line(placed[0]):
            message = "stand in one line: two slopes cannot be found from them"
            yield study.problem("cameras.positions", message)
            return
    if target.azimuth is None or target.elevation is None:
        return
    swept = [ends(getattr(target, key)) for key in ("azimuth", "elevation", "tilt", "face")]
    seen = [
        geometry.in_line(_seen(places, *np.radians(values)))
        for places in placed
        for values in itertools.product(*(ends[:20] for ends in swept))
    ]
    if all(seen):
        message = "the target is seen edge-on: its cameras stand in one line and cannot tell two slopes"
        yield study.problem("target.elevation", message)


def _seen(places: np.ndarray, azimuth: float, elevation: float, tilt: float, face: float) -> np.ndarray:
    """Cameras across the line of sight from the heliostat, shape (4, 2). [m]"""
    return geometry.product(geometry.basis(azimuth, elevation)[1:], geometry.in_space(places, tilt, face))


def _focal_length(study: BackwardGazingStudy) -> Found:
    """Half the radius of a sphere that holds the whole heliostat."""
    least = study.heliostat.reach
    for block, key in (("heliostat", "focal_length"), ("heliostat", "distance"), ("defects", "focal_length")):
        value = getattr(getattr(study, block), key)
        if value is not None and min(ends(value)) <= least:
            message = f"must be more than {least:.3g} m, the reach of the heliostat from its centre"
            yield study.problem(f"{block}.{key}", f"{message} (got {min(ends(value)):g})")


def _profile(study: BackwardGazingStudy) -> Found:
    """A table must be readable; one that rises is used through its envelope."""
    name = study.sun.profile
    if name is None:
        return
    if "table" not in ends(study.sun_profile):
        yield "sun.profile is not used: sun_profile does not name 'table'"
    table = read_disc(study.resolve(name), name)
    if note := table.note(name):
        yield f"{note} method A inverts it through the least falling curve above it"


def _layout(study: BackwardGazingStudy) -> Found:
    """A field needs heliostats that are nowhere at the target."""
    if study.field is None or any(key.startswith("field.layout.") for key in study.sweeps()):
        return
    layout = Layouts(study, "field.layout")[()]
    above = [up - pivot for up in ends(study.field.receiver_height) for pivot in ends(study.field.pivot_height)]
    least = study.heliostat.reach
    for row in range(len(layout)):
        near = min(math.hypot(layout.x[row], layout.y[row], up - layout.z[row]) for up in above)
        if near <= least:
            yield study.problem("field.layout", f"{layout.where(row)} reaches to the target, {near:.3g} m away")
            return
    if "heliostat" in ends(study.field.facing):
        for row in np.flatnonzero(np.hypot(layout.x, layout.y) < _SLACK).tolist():
            yield (
                f"{layout.where(row)} stands at the foot of the tower: a target that turns to face it "
                "(facing: heliostat) has no direction to turn to, and its azimuths are arbitrary"
            )


def _measured(study: BackwardGazingStudy) -> Found:
    """Measured images must be images of the heliostat, with its sun."""
    if study.mode != "measured":
        return
    from heliosweep.families.backward_gazing.shots import read_shots, read_sun  # they need the kernels

    for key in study.sweeps():
        if key.startswith(SIMULATED):
            yield study.problem(key, "has no part in measured images; give one value, or leave it out")
    if isinstance(study.heliostat.pixel, Sweep):
        yield study.problem("heliostat.pixel", "cannot be swept in mode: measured, as its maps have one grid")
        return
    try:
        yield from read_sun(study)[1]
    except StudyError as error:
        yield from error.problems
    seen = read_shots(study)
    places = seen.positions
    if places not in (None, study.cameras.positions) and geometry.in_line(np.array(places)):
        yield study.problem("images", "the cameras stand in one line: two slopes cannot be found from them")
    if seen.rectified:
        yield from _grid_problems(study, seen)
    else:
        yield from _corner_problems(study, seen)
        yield from _registration_problems(study, seen)
    yield from _contradictions(study, seen)
    yield from _level_problems(study, seen)


def _grid_problems(study: BackwardGazingStudy, seen: Shots) -> Found:
    """Images on the grid of the mirror have its size."""
    assert not isinstance(study.heliostat.pixel, Sweep)
    shape = geometry.mirror_grid(study.heliostat.rectangles, study.heliostat.pixel).module.shape
    here = seen.images.shape[1:]
    if here != shape:
        message = (
            f"have {here[1]} x {here[0]} pixels, and the mirror has {shape[1]} x {shape[0]} of "
            f"{study.heliostat.pixel:g} m; put them on its grid, or mark 'corners' of the heliostat in them"
        )
        yield study.problem("images", message)


def _corner_problems(study: BackwardGazingStudy, seen: Shots) -> Found:
    """Marked corners are those of a heliostat in the picture, in their order."""
    from heliosweep.kernels.gazing.rectification import homography

    assert study.images is not None
    rows, columns = seen.images.shape[1:]
    for number, corners in enumerate(seen.corners):
        if not np.all(np.isfinite(corners)):
            continue
        key = f"images[{number}].corners"
        ahead, before = np.roll(corners, -1, axis=0) - corners, corners - np.roll(corners, 1, axis=0)
        turns = 0.5 * (before[:, 0] * ahead[:, 1] - before[:, 1] * ahead[:, 0])  # positive is clockwise on the screen
        area = 0.5 * float(turns.sum())
        order = "upper left, upper right, lower right, lower left"
        if np.abs(turns).min() <= LEAST_TRIANGLE * np.abs(turns).max():
            yield study.problem(key, f"three of the corners stand nearly in one line; mark {order} of the heliostat")
            continue
        if turns.min() < 0.0:
            yield study.problem(key, f"do not follow each other clockwise around the heliostat; mark {order}")
            continue
        if area < LEAST_AREA:
            yield study.problem(key, f"hold {area:.3g} pixels only: too few to tell slopes from")
            continue
        try:
            homography(geometry.outline(study.heliostat.rectangles) * [1.0, -1.0], corners)
        except ValueError as error:
            yield study.problem(key, f"{error}; mark {order} of the heliostat")
            continue
        middle = np.array([columns - 1.0, rows - 1.0]) / 2.0
        outside = np.any(np.abs(corners - middle) > middle + 1.0, axis=1)
        name, size = study.images[number].file, f"{columns} x {rows} pixels"
        if np.count_nonzero(outside) > 2:
            yield study.problem(key, f"{np.count_nonzero(outside)} of 4 corners are outside of the image of {size}")
        elif np.any(outside):
            yield f"{name}: {np.count_nonzero(outside)} of 4 corners are outside of the image of {size}"


def _registration_problems(study: BackwardGazingStudy, seen: Shots) -> Found:
    """Where no corners are marked, the program must find the heliostat."""
    if not seen.register.any() or isinstance(study.heliostat.pixel, Sweep):
        return
    from heliosweep.families.backward_gazing.measured import registered
    from heliosweep.families.backward_gazing.points import KEYS, Failure, Point
    from heliosweep.grid.parameters import Parameters

    assert study.images is not None
    _, values = next(iter(Parameters(study).points(*KEYS)))
    point = Point.of(values, **seen.geometry)
    try:
        registered(point.layout(seen.positions), point.focal_length, seen, study.heliostat.rectangles)
    except Failure:
        return
    except ValueError as error:
        if len(error.args) == 2:
            number, what = error.args
            message = f"the heliostat is not found in {study.images[number].file}: {what}"
            yield study.problem(f"images[{number}]", f"{message}; mark its 'corners', or give FOCALPIX in its metadata")


def _contradictions(study: BackwardGazingStudy, seen: Shots) -> Iterator[str]:
    """Sun, target and distance of the study that are not those of the metadata."""
    from heliosweep.families.backward_gazing.shots import GEOMETRY

    for key, (dotted, _) in GEOMETRY.items():
        block, field = dotted.split(".")
        stated = getattr(getattr(study, block), field)
        said = [one[key] for one in seen.metadata if key in one]
        if stated is None or isinstance(stated, Sweep) or not said:
            continue
        away = [abs((value - stated + 180.0) % 360.0 - 180.0) for value in said]
        if key == "DISTANCE":
            away = [abs(value / stated - 1.0) for value in said]
        if max(away) > DIFFERENT[key == "DISTANCE"]:
            other = said[int(np.argmax(away))]
            yield f"{dotted} is {stated:g} in the study and {key} {other:g} in the metadata of images; the study counts"


def _level_problems(study: BackwardGazingStudy, seen: Shots) -> Found:
    """Images that are dark, saturated or have one level only."""
    from heliosweep.families.backward_gazing.shots import bright_level

    least = float(min(ends(study.cameras.threshold)))
    assert study.images is not None
    dark = []
    for number, (image, limit) in enumerate(zip(seen.images, seen.saturation, strict=True)):
        name, key = study.images[number].file, f"images[{number}]"
        known = image[np.isfinite(image)]
        lit = int(np.count_nonzero(known >= min(least, float(limit))))
        over = int(np.count_nonzero(known >= limit)) / max(1, lit)
        if float(np.ptp(known)) == 0.0:
            yield study.problem(key, f"{name} has one level everywhere: is it dark, or saturated?")
        elif over > MOST_SATURATED:
            yield study.problem(key, f"{name}: {100 * over:.3g} % of its lit pixels are saturated; expose it shorter")
        elif over > 0.0:
            yield f"{name}: {100 * over:.3g} % of its lit pixels are saturated and not used; expose it shorter"
        missing = image.size - known.size
        if missing:
            yield f"{name}: {missing:,} of its pixels are not numbers and are not used"
        if bright_level(known) < least:
            dark.append(name)
    if len(dark) > 1:
        message = f"{' and '.join(dark)} are dark: their brightest pixels are below {least:g} of the level of white"
        yield study.problem("images", f"{message}, and slopes need three cameras; expose longer, or correct 'white'")
    elif dark:
        yield (f"{dark[0]} is dark: its brightest pixels are below {least:g} of the level of white; it is left out")


EXAMINATIONS = (_modules, _pixels, _canting, _cameras, _focal_length, _profile, _layout, _measured)
