"""The four measured images of a study with what is known of cameras, sun and levels: read once, put together, checked.

What the study says counts before what the metadata of a file say.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.errors import Problem, StudyError
from heliosweep.families.backward_gazing.checks import modules_of
from heliosweep.families.backward_gazing.image_files import Picture
from heliosweep.families.backward_gazing.measured_sun import read_named, sun_level

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.config import BackwardGazingStudy

__all__ = ["BRIGHTEST", "GEOMETRY", "KNOWN_WHITE", "SUN_IMAGE", "Views", "bright_level", "views"]

Floats = NDArray[np.float64]

#: Keys of the study that metadata may give instead, all the same in the four images: name in `points.Point`.
GEOMETRY = {
    "SUNAZ": ("sun.azimuth", "sun_azimuth"),
    "SUNEL": ("sun.elevation", "sun_elevation"),
    "TARGETAZ": ("target.azimuth", "target_azimuth"),
    "TARGETEL": ("target.elevation", "target_elevation"),
    "DISTANCE": ("heliostat.distance", "distance"),
}
#: What metadata may say, as the study's keys: bounds, and the words for them.
_RANGES = {
    "SUNEL": (0.0, math.nextafter(90.0, 91.0), "greater than 0 and at most 90"),
    "TARGETEL": (-90.0, 90.0, "greater than -90 and less than 90"),
    "SUNAZ": (-360.1, 360.1, "between -360 and 360"),
    "TARGETAZ": (-360.1, 360.1, "between -360 and 360"),
}
#: Where a level of white comes from; only the first two are those of each camera, with the mirror in between.
KNOWN_WHITE, SUN_IMAGE, BRIGHTEST = ("study", "metadata"), "sun_image", "brightest_pixels"
#: Pixels that may be brighter than what counts as the brightest level of an image: hot ones.
HOT_PIXELS = 30
#: Focal length in pixels that is taken where corners are marked and nothing is known: the homography has the scale.
ANY_FOCAL = 1000.0


class Views(NamedTuple):
    """What the four cameras saw, as a block of the grid takes it."""

    images: Floats
    """Brightness relative to the sun's centre, upper row first, shape (4, rows, columns). [1]"""
    saturation: Floats
    """Brightness from which a pixel is saturated, shape (4,)."""
    rectified: bool
    """Whether the images are on the grid of the mirror."""
    focal: Floats
    """Focal lengths over the side of a pixel, shape (4,)."""
    centre: Floats
    """Column and row at which each camera looks, shape (4, 2)."""
    roll: Floats
    """Shape (4,). [rad]"""
    corners: Floats
    """Marked corners (column, row), NaN where there are none, shape (4, 4, 2)."""
    positions: tuple[tuple[float, float], ...] | None
    """Cameras in the target's plane; None for arrangement and radius. [m]"""
    geometry: dict[str, float]
    """Fields of `points.Point` that metadata give."""
    white: Floats
    """Levels of white, shape (4,)."""
    white_from: tuple[str, ...]
    """Where each comes from: `KNOWN_WHITE`, `SUN_IMAGE` or `BRIGHTEST`."""
    noise: float
    """Standard deviation of a pixel relative to the sun's centre; NaN where it is to be found from the residuals."""
    metadata: tuple[Mapping[str, float], ...]
    """What the files say, whether it counts or not."""

    @property
    def needs_gain(self) -> bool:
        """Whether slopes need a gain for each pixel, since no level of white was measured through the mirror."""
        return not all(source in KNOWN_WHITE for source in self.white_from)


def views(study: BackwardGazingStudy) -> Views:
    """Read and put together what a study names.

    Raises
    ------
    StudyError
        With what is wrong with the files, or between them and the study.
    """
    pictures = _pictures(study)
    said = [picture.metadata for picture in pictures]
    entries, block = study.images or (), study.image_geometry
    shapes = [picture.levels.shape for picture in pictures]
    usual = Counter(shapes).most_common(1)[0][0]
    if odd := [number for number, shape in enumerate(shapes) if shape != usual]:
        others = f"{usual[1]} x {usual[0]}"
        raise StudyError(
            study.problem(
                f"images[{number}]",
                f"{pictures[number].name} has {shapes[number][1]} x {shapes[number][0]} pixels, and others have "
                f"{others}: all four must have the same size",
            )
            for number in odd
        )
    corners = np.full((len(pictures), 4, 2), np.nan)
    for number, entry in enumerate(entries):
        if entry.corners is not None:
            corners[number] = entry.corners
    marked = np.all(np.isfinite(corners), axis=(1, 2))
    rectified = None if block is None else block.rectified
    if rectified is None:
        rectified = not (np.any(marked) or any("FOCALPIX" in one for one in said))
    focal = np.array([one.get("FOCALPIX", math.nan) for one in said])
    if not rectified:
        _check_focal(study, focal, marked)
    rows, columns = shapes[0]
    middle = 0.5 * (columns - 1), 0.5 * (rows - 1)
    dark = _chosen(None if block is None else block.dark, said, "DARK", 0.0)
    white, white_from = _white(study, pictures, dark)
    scale = (white - dark)[:, np.newaxis, np.newaxis]
    stated = None if block is None else block.saturation
    limits = np.array([one.metadata.get("SATURATE", one.saturation) if stated is None else stated for one in pictures])
    return Views(
        (np.stack([picture.levels for picture in pictures]) - dark[:, np.newaxis, np.newaxis]) / scale,
        (limits - dark) / scale[:, 0, 0],
        rectified,
        np.where(np.isfinite(focal), focal, ANY_FOCAL),
        np.array([[one.get(key, value) for key, value in zip(("CENTREU", "CENTREV"), middle, strict=True)]
                  for one in said]),
        np.radians([one.get("ROLL", 0.0) for one in said]),
        corners,
        _positions(study, pictures),
        _geometry(study, pictures),
        white,
        white_from,
        math.nan if block is None or block.noise is None else block.noise,
        tuple(said),
    )  # fmt: skip


def bright_level(image: Floats) -> float:
    """Level of an image that all but `HOT_PIXELS` of its pixels stay below."""
    known = image[np.isfinite(image)]
    few = min(HOT_PIXELS, known.size - 1)
    return float(-np.partition(-known, few)[few])


def _pictures(study: BackwardGazingStudy) -> list[Picture]:
    """The images; raises StudyError with what is wrong with all of them."""
    pictures: list[Picture] = []
    problems: list[Problem] = []
    for number, entry in enumerate(study.images or ()):
        try:
            pictures.append(read_named(study, f"images[{number}]", entry.file))
        except StudyError as error:
            problems += error.problems
    if problems:
        raise StudyError(problems)
    return pictures


def _check_focal(study: BackwardGazingStudy, focal: Floats, marked: NDArray[np.bool_]) -> None:
    """Every image needs a focal length or corners."""
    for number in np.flatnonzero(~np.isfinite(focal) & ~marked):
        assert study.images is not None
        message = (
            f"nothing tells where {study.images[number].file} shows the mirror: mark its 'corners', or give FOCALPIX, "
            "the focal length over the side of a pixel, in its metadata"
        )
        raise StudyError(study.problem(f"images[{number}]", message))


def _chosen(stated: float | None, said: Sequence[object], key: str, default: float) -> Floats:
    """A number of each image: from the study, its metadata, or a default."""
    return np.array([one.get(key, default) if stated is None else stated for one in said])  # type: ignore[attr-defined]


def _white(study: BackwardGazingStudy, pictures: list[Picture], dark: Floats) -> tuple[Floats, tuple[str, ...]]:
    """Levels of white and where they come from."""
    block = study.image_geometry
    white, source = np.empty(len(pictures)), []
    for number, picture in enumerate(pictures):
        if block is not None and block.white is not None:
            white[number], origin = block.white, "study"
        elif "WHITE" in picture.metadata:
            white[number], origin = picture.metadata["WHITE"], "metadata"
        elif study.sun.image is not None:
            white[number], origin = dark[number] + sun_level(study), SUN_IMAGE
        else:
            white[number], origin = math.nan, BRIGHTEST
        source.append(origin)
    if BRIGHTEST in source:  # one for all: the cameras must not be scaled apart by what each happens to see
        highest = max(bright_level(picture.levels) - level for picture, level in zip(pictures, dark, strict=True))
        white = np.where(np.isnan(white), dark + highest, white)
    for number in np.flatnonzero(~(white > dark)).tolist():
        message = f"the level of white, {white[number]:g}, is not above that of the dark, {dark[number]:g}"
        hint = "is the image dark? correct white and dark"
        raise StudyError(Problem(f"{message}; {hint}", f"images[{number}]", pictures[number].name))
    return white, tuple(source)


def _positions(study: BackwardGazingStudy, pictures: list[Picture]) -> tuple[tuple[float, float], ...] | None:
    """Places of the cameras: of the images, their metadata, or the study; all from one of them."""
    entries = study.images or ()
    found = []
    for entry, picture in zip(entries, pictures, strict=True):
        own = picture.metadata.get("CAMERAY"), picture.metadata.get("CAMERAZ")
        if entry.camera is not None:
            found.append(entry.camera)
        elif own[0] is not None and own[1] is not None:
            found.append((own[0], own[1]))
    if found and len(found) < len(entries):
        message = f"the place of the camera is known for {len(found)} images of {len(entries)}; give it for all or none"
        raise StudyError(study.problem("images", message))
    if not found:
        return study.cameras.positions
    spread = np.array(found) - np.mean(found, axis=0)
    if np.linalg.matrix_rank(spread, tol=1e-6 * float(np.abs(spread).max() or 1.0)) < 2:
        raise StudyError(study.problem("images", "the cameras stand in one line: two slopes cannot be found from them"))
    return tuple(found)


def _geometry(study: BackwardGazingStudy, pictures: list[Picture]) -> dict[str, float]:
    """Sun, target and distance from metadata, where the study has none."""
    found: dict[str, float] = {}
    for key, (dotted, name) in GEOMETRY.items():
        block, field = dotted.split(".")
        if getattr(getattr(study, block), field) is not None:
            continue
        values = [picture.metadata.get(key) for picture in pictures]
        given = [value for value in values if value is not None]
        if not given:
            message = f"is missing, in the study and as {key} in the metadata of the images"
            raise StudyError(study.problem(dotted, message))
        modules = modules_of(study)
        reach = float(np.hypot(*(np.abs(modules.centre) + 0.5 * modules.size).T).max())
        words = f"more than {reach:.3g} m, the reach of the heliostat from its centre"
        low, high, words = _RANGES.get(key, (reach, math.inf, words))
        for number, (picture, value) in enumerate(zip(pictures, values, strict=True)):
            if value is None:
                continue
            if not low < value < high:
                message = f"{key} in the metadata must be {words} (got {value:g})"
                raise StudyError(Problem(message, f"images[{number}]", picture.name))
            if abs(value - given[0]) > 1e-6 * max(1.0, abs(given[0])):
                message = f"{key} in the metadata is {value:g} here and {given[0]:g} in another image"
                hint = "the four must be taken at one time; say in the study what counts"
                raise StudyError(Problem(f"{message}: {hint}", f"images[{number}]", picture.name))
        found[name] = given[0]
    return found
