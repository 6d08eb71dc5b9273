"""The sun of measured images: its profile and level, from an image of it or a table."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from heliosweep.errors import Problem, StudyError
from heliosweep.families.backward_gazing.image_files import Picture, read_picture
from heliosweep.families.backward_gazing.profile_file import read_profile
from heliosweep.kernels.sun_discs import disc_profile
from heliosweep.kernels.sun_profiles import EPS_MAX, falling_envelope

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.config import BackwardGazingStudy

__all__ = ["Table", "read_named", "sun_level", "sun_table"]

Table = tuple[tuple[float, ...], tuple[float, ...]]


def sun_table(study: BackwardGazingStudy) -> tuple[Table | None, list[str]]:
    """Profile of the study's sun image or table: angles [rad] and brightness; None without either; and notes.

    Raises
    ------
    StudyError
        If the file cannot be used.
    """
    notes: list[str] = []
    if study.sun.image is None:
        if study.sun.profile is None:
            return None, notes
        read = read_profile(study.resolve(study.sun.profile), study.sun.profile)
        return (tuple(read.angle.tolist()), tuple(read.brightness.tolist())), notes
    picture = read_named(study, "sun.image", study.sun.image)
    saturated = float(np.mean(picture.levels >= picture.metadata.get("SATURATE", picture.saturation)))
    if saturated > 0.0:
        message = f"{100 * saturated:.3g} % of its pixels are saturated: the profile would be flat; expose it shorter"
        raise StudyError(Problem(message, "sun.image", study.sun.image))
    block = study.image_geometry
    dark = picture.metadata.get("DARK", 0.0 if block is None or block.dark is None else block.dark)
    try:
        disc = disc_profile(picture.levels - dark)
    except ValueError as error:
        raise StudyError(Problem(str(error), "sun.image", study.sun.image)) from None
    pixel = study.sun.pixel_angle or picture.metadata.get("PIXANGLE")
    radius = EPS_MAX if pixel is None else 1e-3 * pixel * disc.radius
    if not 3e-3 < radius < 7e-3:
        message = f"its disc of {disc.radius:.1f} pixels would have a radius of {1e3 * radius:.3g} mrad; a sun has 4.65"
        raise StudyError(Problem(f"{message}: correct sun.pixel_angle or PIXANGLE", "sun.image", study.sun.image))
    rises = int(np.count_nonzero(np.diff(disc.brightness) > 0.0))
    if rises:
        notes.append(
            f"{study.sun.image}: the brightness rises in {rises} of {len(disc.brightness) - 1} rings from the centre "
            "to the edge; the least falling curve above it is used"
        )
    angle = np.linspace(0.0, radius, len(disc.brightness))
    return (tuple(angle.tolist()), tuple(falling_envelope(np.maximum(disc.brightness, 0.0)).tolist())), notes


def sun_level(study: BackwardGazingStudy) -> float:
    """Level of the centre of the sun's image above the dark. Raises StudyError."""
    assert study.sun.image is not None
    picture = read_named(study, "sun.image", study.sun.image)
    block = study.image_geometry
    dark = picture.metadata.get("DARK", 0.0 if block is None or block.dark is None else block.dark)
    try:
        return disc_profile(picture.levels - dark).level
    except ValueError as error:
        raise StudyError(Problem(str(error), "sun.image", study.sun.image)) from None


def read_named(study: BackwardGazingStudy, key: str, name: str) -> Picture:
    """An image that a key of the study names, which problems name too."""
    try:
        return read_picture(study.resolve(name), name)
    except StudyError as error:
        raise StudyError(replace(problem, key=problem.key or key) for problem in error.problems) from None
