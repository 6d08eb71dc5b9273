"""What can be wrong with measured images, and what a user should know of them before they are used."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from heliosweep.config.sweep import Sweep
from heliosweep.errors import Problem, StudyError
from heliosweep.families.backward_gazing.checks import modules_of
from heliosweep.families.backward_gazing.measured_images import GEOMETRY, Views, bright_level, views
from heliosweep.families.backward_gazing.measured_sun import sun_table
from heliosweep.kernels.gazing_grid import mirror_grid
from heliosweep.kernels.rectification import homography, outline

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.config import BackwardGazingStudy

__all__ = ["SIMULATED", "view_problems"]

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


def view_problems(study: BackwardGazingStudy, notes: list[str]) -> Iterator[Problem]:
    """What is wrong with measured images, or should be known of them.

    Parameters
    ----------
    study : BackwardGazingStudy
        Study whose blocks are right by themselves.
    notes : list of str
        Gets what the user should know, but may want.
    """
    if study.mode != "measured":
        return
    for key in study.sweeps():
        if key.startswith(SIMULATED):
            yield study.problem(key, "has no part in measured images; give one value, or leave it out")
    if isinstance(study.heliostat.pixel, Sweep):
        yield study.problem("heliostat.pixel", "cannot be swept in mode: measured, as its maps have one grid")
        return
    try:
        _, more = sun_table(study)
        notes += more
    except StudyError as error:
        yield from error.problems
    try:
        seen = views(study)
    except StudyError as error:
        yield from error.problems
        return
    if seen.rectified:
        yield from _grid_problems(study, seen)
    else:
        yield from _corner_problems(study, seen, notes)
    notes += _contradictions(study, seen)
    yield from _level_problems(study, seen, notes)


def _grid_problems(study: BackwardGazingStudy, seen: Views) -> Iterator[Problem]:
    """Images on the grid of the mirror have its size."""
    assert not isinstance(study.heliostat.pixel, Sweep)
    shape = mirror_grid(modules_of(study), study.heliostat.pixel).module.shape
    here = seen.images.shape[1:]
    if here != shape:
        message = (
            f"have {here[1]} x {here[0]} pixels, and the mirror has {shape[1]} x {shape[0]} of "
            f"{study.heliostat.pixel:g} m; put them on its grid, or mark 'corners' of the heliostat in them"
        )
        yield study.problem("images", message)


def _corner_problems(study: BackwardGazingStudy, seen: Views, notes: list[str]) -> Iterator[Problem]:
    """Marked corners are those of a heliostat in the picture, in their order."""
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
            homography(outline(modules_of(study)) * [1.0, -1.0], corners)
        except ValueError as error:
            yield study.problem(key, f"{error}; mark {order} of the heliostat")
            continue
        middle = np.array([columns - 1.0, rows - 1.0]) / 2.0
        outside = np.any(np.abs(corners - middle) > middle + 1.0, axis=1)
        name, size = study.images[number].file, f"{columns} x {rows} pixels"
        if np.count_nonzero(outside) > 2:
            yield study.problem(key, f"{np.count_nonzero(outside)} of 4 corners are outside of the image of {size}")
        elif np.any(outside):
            notes.append(f"{name}: {np.count_nonzero(outside)} of 4 corners are outside of the image of {size}")


def _contradictions(study: BackwardGazingStudy, seen: Views) -> Iterator[str]:
    """Sun, target and distance of the study that are not those of the metadata."""
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


def _level_problems(study: BackwardGazingStudy, seen: Views, notes: list[str]) -> Iterator[Problem]:
    """Images that are dark, saturated or have one level only."""
    threshold = study.cameras.threshold
    least = float(min(threshold[:])) if isinstance(threshold, Sweep) else threshold
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
            notes.append(f"{name}: {100 * over:.3g} % of its lit pixels are saturated and not used; expose it shorter")
        missing = image.size - known.size
        if missing:
            notes.append(f"{name}: {missing:,} of its pixels are not numbers and are not used")
        if bright_level(known) < least:
            dark.append(name)
    if len(dark) > 1:
        message = f"{' and '.join(dark)} are dark: their brightest pixels are below {least:g} of the level of white"
        yield study.problem("images", f"{message}, and slopes need three cameras; expose longer, or correct 'white'")
    elif dark:
        notes.append(
            f"{dark[0]} is dark: its brightest pixels are below {least:g} of the level of white; it is left out"
        )
