"""What can be wrong between the blocks of a study, or with the files it names."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.config.study import parameters
from heliosweep.config.sweep import Listed, Sweep
from heliosweep.errors import Problem, StudyError
from heliosweep.families.backward_gazing import variables
from heliosweep.families.backward_gazing.profile_file import read_profile
from heliosweep.families.backward_gazing.values import module_number
from heliosweep.kernels.gazing_grid import Modules, themis_8
from heliosweep.layouts.layout import Layout
from heliosweep.layouts.resolve import Layouts

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.config import BackwardGazingStudy

#: Pixels of a mirror that any machine could hold.
MAX_PIXELS = 20_000_000
#: Two modules may share so much of a side by rounding. [m]
_SLACK = 1e-9
#: Names of the family's variables and labels, which columns of a layout must leave to the result.
_NAMES = frozenset((*variables.FIELD, *variables.SIMULATED, *variables.MAPS, *variables.OVER_SEEDS))
_LABELS = frozenset((*variables.COORDINATES, "heliostat", "heliostat_width", "heliostat_height"))


def check(study: BackwardGazingStudy) -> tuple[list[Problem], list[str]]:
    """Check a study whose blocks are right by themselves.

    Parameters
    ----------
    study : BackwardGazingStudy
        The study.

    Returns
    -------
    problems : list of Problem
        What makes the study useless, located in the study file or a file that it names.
    notes : list of str
        What the user should know, but may want.
    """
    problems: list[Problem] = []
    notes: list[str] = []
    for find in (_modules, _pixels, _canting, _cameras, _focal_length, _maps, _profile, _layout, _views):
        try:
            problems += find(study, notes)
        except StudyError as error:
            problems += error.problems
    # A file that two checks read is wrong once.
    return list(dict.fromkeys(problems)), list(dict.fromkeys(notes))


def modules_of(study: BackwardGazingStudy) -> Modules:
    """Modules of the heliostat. [m]"""
    given = study.heliostat.modules
    if isinstance(given, str):
        return themis_8()
    return Modules(np.array([one.centre for one in given]), np.array([one.size for one in given]))


def camera_places(arrangement: str, radius: float) -> np.ndarray:
    """Cameras in the plane of the target, shape (4, 2), in the order of `gazing_geometry.camera_square`. [m]"""
    if arrangement == "square":
        return radius / math.sqrt(2.0) * np.array([[-1.0, 1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    return radius * np.array([[0.0, 1.0], [-1.0, 0.0], [1.0, 0.0], [0.0, -1.0]])


def field_layouts(study: BackwardGazingStudy) -> Any:
    """The study as `Layouts` and `LayoutAxis` take it: their ``layout`` block stands in ``field``."""
    assert study.field is not None
    return SimpleNamespace(
        layout=study.field.layout,
        dimensions=list,
        resolve=study.resolve,
        problem=lambda key, message: study.problem(f"field.{key}", message),
        study_id=study.study_id,
    )


def field_layout(study: BackwardGazingStudy) -> Layout:
    """The heliostats of the field. Raises StudyError."""
    return Layouts(field_layouts(study), reserved(study))[()]


def reserved(study: BackwardGazingStudy) -> frozenset[str]:
    """Names that columns of a layout must leave to the result: its variables, labels and dimensions."""
    keys = frozenset(
        getattr(parameter, "dimension", "") or key.rpartition(".")[2]
        for key, parameter, _ in parameters(study)
        if getattr(parameter, "sweep", True) and not key.startswith("field.layout.")
    )
    return _NAMES | _LABELS | keys


def _modules(study: BackwardGazingStudy, _: list[str]) -> Iterator[Problem]:
    """No two modules may share a part of the mirror."""
    modules = modules_of(study)
    for one, other in itertools.combinations(range(len(modules.size)), 2):
        shared = 0.5 * (modules.size[one] + modules.size[other]) - np.abs(modules.centre[one] - modules.centre[other])
        if np.all(shared > _SLACK):
            message = f"overlaps module {one + 1} by {shared[0]:.4g} m x {shared[1]:.4g} m"
            yield study.problem(f"heliostat.modules[{other}]", message)


def _pixels(study: BackwardGazingStudy, notes: list[str]) -> Iterator[Problem]:
    """Every module needs pixels, and the machine room for them."""
    modules = modules_of(study)
    largest, smallest = max(_ends(study.heliostat.pixel)), min(_ends(study.heliostat.pixel))
    side, number = float(modules.size.min()), int(np.argmin(modules.size.min(axis=1))) + 1
    span = (modules.centre + 0.5 * modules.size).max(axis=0) - (modules.centre - 0.5 * modules.size).min(axis=0)
    count = float(np.prod(np.ceil(span / smallest)))
    if largest > side:
        message = f"must be at most {side:g} m, the shorter side of module {number}"
        yield study.problem("heliostat.pixel", f"{message} (got {largest:g})")
    elif count > MAX_PIXELS:
        message = f"is too small: {count:.3g} pixels are more than {MAX_PIXELS:,}"
        yield study.problem("heliostat.pixel", f"{message} (got {smallest:g})")
    else:
        lost = max(_ends(study.erosion))
        if side / largest <= 2 * lost + 1:
            message = f"leaves no pixels of {largest:g} m of module {number}, {side:g} m wide"
            hint = "lower it, or make heliostat.pixel smaller"
            yield study.problem("erosion", f"{message}; {hint} (got {lost:g})")


def _canting(study: BackwardGazingStudy, _: list[str]) -> Iterator[Problem]:
    """Canting is of modules that there are."""
    count = len(modules_of(study).size)
    for key in study.defects.canting:
        number = module_number(key)
        if number is None or not 1 <= number <= count:
            yield study.problem(f"defects.canting.{key}", f"no such module: the heliostat has modules 1 to {count}")


def _cameras(study: BackwardGazingStudy, _: list[str]) -> Iterator[Problem]:
    """Seen from the heliostat, the cameras must not stand in one line."""
    cameras, target = study.cameras, study.target
    names = cameras.arrangement
    arrangements = [str(name) for name in (names.values() if isinstance(names, Sweep) else (names,))]
    placed = [camera_places(name, min(_ends(cameras.radius))) for name in arrangements]
    if cameras.positions is not None:
        placed = [np.array(cameras.positions)]
        if _in_line(placed[0]):
            message = "stand in one line: two slopes cannot be found from them"
            yield study.problem("cameras.positions", message)
            return
    if target.azimuth is None or target.elevation is None:
        return
    swept = [_ends(getattr(target, key)) for key in ("azimuth", "elevation", "tilt", "face")]
    seen = [
        _in_line(_seen(places, *np.radians(values)))
        for places in placed
        for values in itertools.product(*(ends[:20] for ends in swept))
    ]
    if all(seen):
        message = "the target is seen edge-on: its cameras stand in one line and cannot tell two slopes"
        yield study.problem("target.elevation", message)


def _seen(places: np.ndarray, azimuth: float, elevation: float, tilt: float, face: float) -> np.ndarray:
    """Cameras across the line of sight, as the kernels have them: E M."""
    leaning = np.stack((-math.sin(tilt) * places[:, 1], places[:, 0], math.cos(tilt) * places[:, 1]), axis=1)
    turn = np.array([[math.cos(face), -math.sin(face), 0.0], [math.sin(face), math.cos(face), 0.0], [0.0, 0.0, 1.0]])
    ca, sa, ch, sh = math.cos(azimuth), math.sin(azimuth), math.cos(elevation), math.sin(elevation)
    return leaning @ turn.T @ np.array([[-sa, ca, 0.0], [-ca * sh, -sa * sh, ch]]).T


def _in_line(places: np.ndarray) -> bool:
    spread = places - places.mean(axis=0)
    spread /= np.abs(spread).max() or 1.0  # squares of far places overflow
    yy, yz, zz = np.sum(spread[:, 0] ** 2), np.sum(spread[:, 0] * spread[:, 1]), np.sum(spread[:, 1] ** 2)
    return not yy * zz - yz * yz > 1e-12 * (yy + zz) ** 2


def _focal_length(study: BackwardGazingStudy, _: list[str]) -> Iterator[Problem]:
    """Half the radius of a sphere that holds the whole heliostat."""
    modules = modules_of(study)
    reach = float(np.hypot(*(np.abs(modules.centre) + 0.5 * modules.size).T).max())
    for block, key in (("heliostat", "focal_length"), ("heliostat", "distance"), ("defects", "focal_length")):
        value = getattr(getattr(study, block), key)
        if value is not None and min(_ends(value)) <= reach:
            message = f"must be more than {reach:.3g} m, the reach of the heliostat from its centre"
            yield study.problem(f"{block}.{key}", f"{message} (got {min(_ends(value)):g})")


def _maps(study: BackwardGazingStudy, _: list[str]) -> Iterator[Problem]:
    """Maps of a study have one grid."""
    if study.output.maps and isinstance(study.heliostat.pixel, Sweep):
        yield study.problem("output.maps", "must be false where heliostat.pixel is swept: each pixel has its own grid")


def _profile(study: BackwardGazingStudy, notes: list[str]) -> Iterator[Problem]:
    """A table must be readable; one that rises is used through its envelope."""
    name, profiles = study.sun.profile, study.sun_profile
    names = profiles.values() if isinstance(profiles, Sweep) else (profiles,)
    if name is None:
        return
    if "table" not in names:
        notes.append("sun.profile is not used: sun_profile does not name 'table'")
    table = read_profile(study.resolve(name), name)
    if table.rises:
        notes.append(
            f"{name}: the brightness rises in {table.rises} of {len(table.angle) - 1} steps from the centre to the "
            "edge; method A inverts it through the least falling curve above it"
        )
    yield from ()


def _layout(study: BackwardGazingStudy, notes: list[str]) -> Iterator[Problem]:
    """A field needs heliostats that are nowhere at the target."""
    if study.field is None or any(key.startswith("field.layout.") for key in study.sweeps()):
        return
    layout = field_layout(study)
    above = [up - pivot for up in _ends(study.field.receiver_height) for pivot in _ends(study.field.pivot_height)]
    reach = float(np.hypot(*(np.abs(modules_of(study).centre) + 0.5 * modules_of(study).size).T).max())
    for row in range(len(layout)):
        near = min(math.hypot(layout.x[row], layout.y[row], up - layout.z[row]) for up in above)
        if near <= reach:
            yield study.problem("field.layout", f"{layout.where(row)} reaches to the target, {near:.3g} m away")
            return
    if "heliostat" in _ends(study.field.facing):
        for row in np.flatnonzero(np.hypot(layout.x, layout.y) < _SLACK).tolist():
            notes.append(
                f"{layout.where(row)} stands at the foot of the tower: a target that turns to face it "
                "(facing: heliostat) has no direction to turn to, and its azimuths are arbitrary"
            )


def _views(study: BackwardGazingStudy, notes: list[str]) -> Iterator[Problem]:
    """Measured images must be images of the heliostat."""
    if study.mode == "measured":
        from heliosweep.families.backward_gazing.measured_checks import view_problems  # it needs the kernels

        yield from view_problems(study, notes)


def _ends(value: Any) -> tuple[Any, ...]:
    """A value, all of a list, or both ends of a range, which is monotonic."""
    if not isinstance(value, Sweep):
        return (value,)
    return tuple(value[:]) if isinstance(value, Listed) else (value.first, value.last)
