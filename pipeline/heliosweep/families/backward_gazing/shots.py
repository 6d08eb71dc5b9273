"""The four measured images of a study with cameras and levels, and the sun.

What the study says counts before what the metadata of a file say.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import shift

from heliosweep.config.profiles import SunProfile
from heliosweep.config.sweep import Sweep
from heliosweep.errors import Problem, StudyError
from heliosweep.families.backward_gazing.files import Picture, read_disc, read_picture
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.gazing.geometry import mirror_grid
from heliosweep.kernels.sun.profiles import EPS_MAX, falling_envelope
from heliosweep.kernels.sun.tables import SunDisc, disc_profile

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.study import BackwardGazingStudy


#: Keys of the study that metadata may give instead, all the same in the four images: name in `points.Point`.
GEOMETRY = {
    "SUNAZ": ("sun.azimuth", "sun_azimuth"),
    "SUNEL": ("sun.elevation", "sun_elevation"),
    "TARGETAZ": ("target.azimuth", "target_azimuth"),
    "TARGETEL": ("target.elevation", "target_elevation"),
    "DISTANCE": ("heliostat.distance", "distance"),
}
#: Where a level of white comes from; only the first two are those of each camera, with the mirror in between.
KNOWN_WHITE, SUN_IMAGE, BRIGHTEST = ("study", "metadata"), "sun_image", "brightest_pixels"
#: Pixels that may be brighter than what counts as the brightest level of an image: hot ones.
HOT_PIXELS = 30
#: Focal length in pixels that is taken where corners are marked and nothing is known: the homography has the scale.
ANY_FOCAL = 1000.0


class Shots(NamedTuple):
    """The four images, with cameras and levels."""

    images: Floats
    """Brightness relative to the sun's centre, upper row first, shape (4, rows, columns). [1]"""
    saturation: Floats
    """Brightness from which a pixel is saturated, shape (4,)."""
    rectified: bool
    """True where the images are on the grid of the mirror."""
    register: NDArray[np.bool_]
    """Images in which the heliostat is to be found by its edges, shape (4,)."""
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
    """Source of each: `KNOWN_WHITE`, `SUN_IMAGE` or `BRIGHTEST`."""
    noise: float
    """Standard deviation of a pixel relative to the sun's centre; NaN where it is to be found from the residuals."""
    metadata: tuple[dict[str, float], ...]
    """Metadata of the images, also those that do not count."""

    @property
    def needs_gain(self) -> bool:
        """True where slopes need a gain for each pixel: no level of white was measured through the mirror."""
        return not all(source in KNOWN_WHITE for source in self.white_from)


def read_shots(study: BackwardGazingStudy) -> Shots:
    """Read and put together the images that a study names.

    Raises
    ------
    StudyError
        With what is wrong with the files, or between them and the study.
    """
    entries = study.images or ()
    pictures = _pictures(study)
    said = [picture.metadata for picture in pictures]
    corners = np.array([np.full((4, 2), np.nan) if one.corners is None else one.corners for one in entries])
    marked = np.isfinite(corners).all(axis=(1, 2))
    focal = np.array([one.get("FOCALPIX", math.nan) for one in said])
    rectified, register = _stated(study, "rectified"), _stated(study, "registration")
    if rectified is None:
        told = np.any(marked) or np.any(np.isfinite(focal)) or register
        pixel, rectified = study.heliostat.pixel, False
        if not told and not isinstance(pixel, Sweep):
            rectified = pictures[0].levels.shape == mirror_grid(study.heliostat.rectangles, pixel).module.shape
    if register is None:
        register = ~np.isfinite(focal)
    found = ~marked & register & (not rectified)
    for number in [] if rectified else np.flatnonzero(~np.isfinite(focal) & ~marked & ~found):
        message = (
            f"nothing tells where {entries[number].file} shows the mirror: let the program find it "
            "(image_geometry.registration), mark its 'corners', or give FOCALPIX in its metadata"
        )
        raise StudyError(study.problem(f"images[{number}]", message))
    rows, columns = pictures[0].levels.shape
    middle = {"CENTREU": 0.5 * (columns - 1), "CENTREV": 0.5 * (rows - 1)}
    dark, limit, noise = (_stated(study, key) for key in ("dark", "saturation", "noise"))
    dark = np.array([one.get("DARK", 0.0) if dark is None else dark for one in said])
    white, white_from = _white(study, pictures, dark)
    scale = white - dark
    limits = np.array([one.metadata.get("SATURATE", one.saturation) if limit is None else limit for one in pictures])
    levels = np.stack([picture.levels for picture in pictures])
    return Shots(
        (levels - dark[:, np.newaxis, np.newaxis]) / scale[:, np.newaxis, np.newaxis],
        (limits - dark) / scale,
        rectified,
        found,
        np.where(np.isfinite(focal), focal, ANY_FOCAL),
        np.array([[one.get(key, value) for key, value in middle.items()] for one in said]),
        np.radians([one.get("ROLL", 0.0) for one in said]),
        corners,
        _positions(study, pictures),
        _geometry(study, pictures),
        white,
        white_from,
        math.nan if noise is None else noise,
        tuple(said),
    )


def bright_level(image: Floats) -> float:
    """Level of an image that all but `HOT_PIXELS` of its pixels stay below."""
    known = image[np.isfinite(image)]
    few = min(HOT_PIXELS, known.size - 1)
    return float(-np.partition(-known, few)[few])


def read_sun(study: BackwardGazingStudy) -> tuple[SunProfile | None, list[str]]:
    """Profile of the study's sun image or table: angles [rad] and brightness; None without either; and notes.

    Raises
    ------
    StudyError
        If the file cannot be used.
    """
    frames = sun_frames(study)
    if not frames:
        if study.sun.profile is None:
            return None, []
        return read_disc(study.resolve(study.sun.profile), study.sun.profile), []
    pictures = {key: _read(study, key, name) for key, name in frames.items()}
    for key, one in pictures.items():
        saturated = float(np.mean(one.levels >= one.metadata.get("SATURATE", one.saturation)))
        if saturated > 0.0:
            message = (
                f"{100 * saturated:.3g} % of its pixels are saturated: the profile would be flat; expose it shorter"
            )
            raise StudyError(Problem(message, key, frames[key]))
    disc = _disc(study)
    (key, name), picture = next(iter(frames.items())), next(iter(pictures.values()))
    pixel = study.sun.pixel_angle or picture.metadata.get("PIXANGLE")
    assert not isinstance(study.sun.angular_radius, Sweep)
    radius = 1e-3 * pixel * disc.radius if pixel is not None else 1e-3 * (study.sun.angular_radius or 1e3 * EPS_MAX)
    if not 3e-3 < radius < 7e-3:
        message = f"its disc of {disc.radius:.1f} pixels would have a radius of {1e3 * radius:.3g} mrad; a sun has 4.65"
        raise StudyError(Problem(f"{message}: correct sun.pixel_angle or PIXANGLE", key, name))
    rises = int(np.count_nonzero(np.diff(disc.brightness) > 0.0))
    note = (
        f"{name}: the brightness rises in {rises} of {len(disc.brightness) - 1} rings from the centre "
        "to the edge; the least falling curve above it is used"
    )
    angle = np.linspace(0.0, radius, len(disc.brightness))
    falling = falling_envelope(np.maximum(disc.brightness, 0.0))
    return SunProfile(tuple(angle.tolist()), tuple(falling.tolist())), [note] if rises else []


def _stated(study: BackwardGazingStudy, key: str) -> Any:
    """Value that the study gives for all images, or None."""
    return None if study.image_geometry is None else getattr(study.image_geometry, key)


def sun_frames(study: BackwardGazingStudy) -> dict[str, str]:
    """Names of the images of the sun by their keys in the study."""
    if study.sun.image is not None:
        return {"sun.image": study.sun.image}
    return {f"sun.frames[{number}].file": one.file for number, one in enumerate(study.sun.frames or ())}


def _disc(study: BackwardGazingStudy) -> SunDisc:
    """The disc in the image of the sun, or in the median of several. Raises StudyError."""
    moved: list[Floats] = []
    first: SunDisc | None = None
    for key, name in (frames := sun_frames(study)).items():
        picture = _read(study, key, name)
        levels = picture.levels - picture.metadata.get("DARK", _stated(study, "dark") or 0.0)
        if moved and levels.shape != moved[0].shape:
            message = "has another size than the first image of the sun; frames of one camera have the same"
            raise StudyError(Problem(message, key, name))
        try:
            disc = disc_profile(levels)
            first = first or disc
            if len(frames) > 1:
                by = first.centre[1] - disc.centre[1], first.centre[0] - disc.centre[0]
                moved.append(shift(levels, by, order=1, cval=math.nan))
                disc = disc_profile(np.median(moved, axis=0)) if len(moved) == len(frames) else disc
        except ValueError as error:
            raise StudyError(Problem(str(error), key, name)) from None
    return disc


def _read(study: BackwardGazingStudy, key: str, name: str) -> Picture:
    """An image that a key of the study names, which problems name too."""
    try:
        return read_picture(study.resolve(name), name)
    except StudyError as error:
        raise StudyError(replace(problem, key=problem.key or key) for problem in error.problems) from None


def _pictures(study: BackwardGazingStudy) -> list[Picture]:
    """The images, all of one size; raises StudyError with what is wrong with all of them."""
    pictures: list[Picture] = []
    problems: list[Problem] = []
    for number, entry in enumerate(study.images or ()):
        try:
            picture = _read(study, f"images[{number}]", entry.file)
            stated = {} if entry.metadata is None else entry.metadata.model_dump(exclude_none=True)
            pictures.append(replace(picture, metadata=picture.metadata | stated))
        except StudyError as error:
            problems += error.problems
    if problems:
        raise StudyError(problems)
    usual = Counter(picture.levels.shape for picture in pictures).most_common(1)[0][0]
    odd = [
        study.problem(
            f"images[{number}]",
            f"{picture.name} has {picture.levels.shape[1]} x {picture.levels.shape[0]} pixels, and others have "
            f"{usual[1]} x {usual[0]}: all four must have the same size",
        )
        for number, picture in enumerate(pictures)
        if picture.levels.shape != usual
    ]
    if odd:
        raise StudyError(odd)
    return pictures


def _white(study: BackwardGazingStudy, pictures: list[Picture], dark: Floats) -> tuple[Floats, tuple[str, ...]]:
    """Levels of white and where they come from."""
    stated = _stated(study, "white")
    white, source = np.empty(len(pictures)), []
    known = stated is not None or all("WHITE" in one.metadata for one in pictures)
    level = math.nan if known or not sun_frames(study) else _disc(study).level
    for number, picture in enumerate(pictures):
        if stated is not None:
            white[number], origin = stated, "study"
        elif "WHITE" in picture.metadata:
            white[number], origin = picture.metadata["WHITE"], "metadata"
        elif math.isfinite(level):
            white[number], origin = dark[number] + level, SUN_IMAGE
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
        if entry.camera is not None:
            found.append(entry.camera)
        elif {"CAMERAY", "CAMERAZ"} <= picture.metadata.keys():
            found.append((picture.metadata["CAMERAY"], picture.metadata["CAMERAZ"]))
    if not found:
        return study.cameras.positions
    if len(found) < len(entries):
        message = f"the place of the camera is known for {len(found)} images of {len(entries)}; give it for all or none"
        raise StudyError(study.problem("images", message))
    return tuple(found)


def _geometry(study: BackwardGazingStudy, pictures: list[Picture]) -> dict[str, float]:
    """Sun, target and distance from metadata, where the study has none."""
    found: dict[str, float] = {}
    least = study.heliostat.reach
    for key, (dotted, name) in GEOMETRY.items():
        block, field = dotted.split(".")
        if getattr(getattr(study, block), field) is not None:
            continue
        values = {number: one.metadata[key] for number, one in enumerate(pictures) if key in one.metadata}
        if not values:
            message = f"is missing, in the study and as {key} in the metadata of the images"
            raise StudyError(study.problem(dotted, message))
        found[name] = first = next(iter(values.values()))
        for number, value in values.items():
            message = ""
            if key == "DISTANCE" and not value > least:
                words = f"more than {least:.3g} m, the reach of the heliostat from its centre"
                message = f"{key} in the metadata must be {words} (got {value:g})"
            elif abs(value - first) > 1e-6 * max(1.0, abs(first)):
                message = f"{key} in the metadata is {value:g} here and {first:g} in another image: "
                message += "the four must be taken at one time; say in the study what counts"
            if message:
                raise StudyError(Problem(message, f"images[{number}]", pictures[number].name))
    return found
