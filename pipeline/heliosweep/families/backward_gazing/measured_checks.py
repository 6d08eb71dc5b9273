"""What can be wrong with measured images, and what a user should know of them before they are used."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from heliosweep.config.sweep import Sweep
from heliosweep.errors import Problem, StudyError
from heliosweep.families.backward_gazing.checks import modules_of
from heliosweep.families.backward_gazing.measured_images import Views, bright_level, sun_table, views
from heliosweep.kernels.gazing_grid import mirror_grid

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.config import BackwardGazingStudy

__all__ = ["view_problems"]

#: Part of an image's lit pixels that may be saturated before it is refused.
MOST_SATURATED = 0.5
#: Keys of simulations, by their beginning.
_SIMULATED = (
    "defects.", "profile_noise.", "cameras.noise", "cameras.gain_error", "cameras.bits", "cameras.images",
    "cameras.supersampling", "cameras.seed",
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
        if key.startswith(_SIMULATED):
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


def _level_problems(study: BackwardGazingStudy, seen: Views, notes: list[str]) -> Iterator[Problem]:
    """Images that are dark, saturated or have one level only."""
    threshold = study.cameras.threshold
    least = float(min(threshold[:])) if isinstance(threshold, Sweep) else threshold
    assert study.images is not None
    dark = []
    for number, (image, limit) in enumerate(zip(seen.images, seen.saturation, strict=True)):
        name, key = study.images[number].file, f"images[{number}].file"
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
