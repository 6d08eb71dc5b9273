"""Images that a study names: pictures of the heliostat and of the sun, with cameras, levels and metadata.

NPY, PNG, TIFF and FITS are read in grey levels. Metadata are numbers under the keys of `blocks.Metadata`: cards
of a FITS header, text chunks of a PNG, lines ``KEY = value`` of a TIFF's ImageDescription. Values of the study have
priority. The first row of a picture is the upper one; in FITS, whose rows count from the bottom, the last row of the
file, unless the card ROWORDER is TOP-DOWN.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.faults import Invalid
from heliosweep.config.tables import SunProfile, read_profile
from heliosweep.config.values import Quantity, Sweep
from heliosweep.errors import Problem, StudyError
from heliosweep.families.backward_gazing.blocks import Metadata
from heliosweep.files import read_once
from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.gazing.geometry import mirror_grid
from heliosweep.kernels.profiles import EPS_MAX, SunDisc, disc_profile, falling_envelope

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.study import BackwardGazingStudy

#: Maximum size of an image, and minimum length of its sides. [pixels]
MAX_PIXELS, MIN_SIDE = 25_000_000, 4
#: Metadata that are read.
KEYS: dict[str, Quantity] = {key: Metadata.parameter(key) for key in Metadata.model_fields}  # type: ignore[misc]
#: Keys of the study that metadata may give instead, the same in the four images.
GEOMETRY = {
    "SUNAZ": "sun.azimuth", "SUNEL": "sun.elevation", "TARGETAZ": "target.azimuth", "TARGETEL": "target.elevation",
    "DISTANCE": "heliostat.distance",
}  # fmt: skip
#: Sources of a level of white; only the first two are measured through the mirror.
KNOWN_WHITE, SUN_IMAGE, BRIGHTEST = ("study", "metadata"), "sun_image", "brightest_pixels"
#: Number of hot pixels that may exceed the brightest level of an image.
HOT_PIXELS = 30
#: Maximum brightness of a sun profile relative to the centre, and minimum relative fall towards its edge.
MAX_BRIGHTNESS, LEAST_FALL = 1.5, 0.05


class Picture(NamedTuple):
    """An image in grey levels.

    Attributes
    ----------
    levels : ndarray, shape (rows, columns)
        Upper row first; NaN for pixels without a number. [levels]
    saturation : float
        Level from which a pixel counts as saturated: the maximum of the type of number, or of fewer bits if that is the
        maximum of the image (a sensor of 12 bits in a file of 16).
    metadata : dict
        Values of `KEYS` that the file has.
    name : str
        Name of the file in the study.
    """

    levels: Floats
    saturation: float
    metadata: dict[str, float]
    name: str


@read_once(6)
def read_picture(path: Path, name: str) -> Picture:
    """Read an image.

    Parameters
    ----------
    path : pathlib.Path
        NPY (two dimensions, numbers), PNG or TIFF (one grey channel), or FITS (its first image).
    name : str
        Name of the file in messages.

    Raises
    ------
    StudyError
        If the file is not a readable grey image of at most `MAX_PIXELS` pixels.
    """
    try:
        levels, said, top = _contents(path)
        if levels.ndim != 2 or levels.dtype.kind not in "iuf":
            raise ValueError(f"it has {levels.ndim} axes of {levels.dtype}, expected rows and columns of grey levels")
        if levels.size > MAX_PIXELS or min(levels.shape) < MIN_SIDE:
            raise ValueError(f"it has {levels.shape[1]} x {levels.shape[0]} pixels, expected at least {MIN_SIDE} on "
                             f"each side and at most {MAX_PIXELS:,}; cut it to the heliostat")  # fmt: skip
        if top is None:
            top = float(np.iinfo(levels.dtype).max) if levels.dtype.kind in "iu" else math.inf
        values = np.array(levels, np.float64, order="C")
        values[~np.isfinite(values)] = math.nan
        if np.all(np.isnan(values)):
            raise ValueError("no pixel is a number")
    except ImportError:
        raise StudyError(Problem("needs the package astropy: pip install astropy", file=name)) from None
    except Exception as error:  # decoders raise many types
        raise StudyError(Problem(f"cannot be read as a grey image: {error}", file=name)) from None
    highest = float(np.nanmax(values))
    sensors = (2.0**bits - 1.0 for bits in (8, 10, 12, 14, 16) if math.isfinite(top))
    return Picture(values, next((each for each in sensors if each == highest), top), _metadata(said, name), name)


def _contents(path: Path) -> tuple[NDArray[Any], Mapping[str, Any], float | None]:
    """Return the levels of an image file, the upper row first, its metadata, and its highest level if it has one."""
    with path.open("rb") as file:
        start = file.read(6)
    if start == b"\x93NUMPY":
        return np.load(path, allow_pickle=False), {}, None
    if start == b"SIMPLE":
        from astropy.io import fits

        with path.open("rb") as file, fits.open(file, memmap=False) as units:
            unit = next(unit for unit in units if unit.is_image and unit.shape)
            header, bits = dict(unit.header), int(unit.header["BITPIX"])
            if math.prod(unit.shape) > MAX_PIXELS:
                raise ValueError(f"it has more than {MAX_PIXELS:,} pixels; cut it to the heliostat")
            highest = {8: 255.0, 16: 2.0**15 - 1.0, 32: 2.0**31 - 1.0, 64: 2.0**63 - 1.0}.get(bits, math.inf)
            down = str(header.get("ROWORDER", "")).strip().upper() == "TOP-DOWN"
            top = header.get("BZERO", 0.0) + header.get("BSCALE", 1.0) * highest
            return np.array(unit.data if down else unit.data[::-1]), header, top
    from PIL import Image

    with Image.open(path, formats=("PNG", "TIFF")) as image:
        if image.mode in ("1", "P", "PA"):
            raise ValueError(f"its pixels are {'black and white' if image.mode == '1' else 'a palette'}")
        if image.width * image.height > MAX_PIXELS or getattr(image, "n_frames", 1) > 1:
            raise ValueError(f"it has several pages, or more than {MAX_PIXELS:,} pixels; cut it to the heliostat")
        said: dict[Any, Any] = dict(image.info)
        if image.format == "TIFF":
            lines = str(image.tag_v2.get(270, "")).replace("\0", "\n").splitlines()  # type: ignore[attr-defined]
            said = {key.strip(): value for key, _, value in (line.partition("=") for line in lines)}
        return np.array(image), said, None


def _metadata(said: Mapping[str, Any], name: str) -> dict[str, float]:
    """Return the numbers under the known keys. Raises StudyError with all that are wrong."""
    found: dict[str, float] = {}
    problems = []
    for key, quantity in KEYS.items():
        try:
            if key in said:
                found[key] = float(quantity.read(float(str(said[key]))))
        except (ValueError, Invalid):
            bounds, meaning = quantity.bounds() or "a number", quantity.description
            problems.append(Problem(f"{key} in the metadata must be {bounds}, the {meaning[0].lower()}{meaning[1:]} "
                                    f"(got {str(said[key])[:40]!r}); correct or remove it", file=name))  # fmt: skip
    if problems:
        raise StudyError(problems)
    return found


@read_once(4)
def read_disc(path: Path, name: str) -> SunProfile:
    """Read the profile of the sun's disc, relative to its centre.

    Parameters
    ----------
    path, name
        As for `heliosweep.config.tables.read_profile`.

    Raises
    ------
    StudyError
        If the file cannot be read, or is not a profile from which slopes follow.
    """
    profile = read_profile(path, name)
    radius, brightness = 1e3 * profile.angle[-1], np.array(profile.brightness)
    few = max(2, brightness.size // 20)
    centre, edge = float(brightness[:few].mean()), float(brightness[-few:].mean())
    least, most = 100 * LEAST_FALL, MAX_BRIGHTNESS
    fall = f"must be darker at its edge than at its centre by at least {least:g} %: no slopes follow from it"
    faults = {
        "a sun profile needs 4 rows at least": brightness.size < 4,
        f"the brightness must be relative to the disc centre, and at most {most:g}": brightness.max() > most
        or not 0.8 <= centre <= 1.25,
        f"a sun profile {fall}": not edge <= (1.0 - LEAST_FALL) * centre,
        f"the last angle must be the disc's radius in mrad (got {radius:g})": not 1.0 <= radius <= 20.0,
    }
    if wrong := next((fault for fault, present in faults.items() if present), ""):
        raise StudyError(Problem(wrong, file=name))
    return profile


#: Images of a study with cameras and levels, as `read_shots` returns them.
Shots = SimpleNamespace


def read_shots(study: BackwardGazingStudy) -> Shots:
    """Read the images of a study with cameras and levels. Raises StudyError with all problems of the files.

    Returns
    -------
    images : ndarray, shape (4, rows, columns)
        Brightness relative to the sun's centre, upper row first. [1]
    saturation : ndarray, shape (4,)
        Brightness from which a pixel is saturated. [1]
    rectified : bool
        True if the images are on the grid of the mirror.
    focal, centre, roll : ndarray, shape (4,), (4, 2) and (4,)
        Focal lengths over the side of a pixel, column and row at which each camera looks, and rotation [rad].
    corners : ndarray, shape (4, 4, 2)
        Marked corners (column, row), NaN without.
    positions : tuple or None
        Cameras in the target's plane; None for arrangement and radius. [m]
    geometry : dict
        Values of keys of the study from metadata.
    white, white_from : ndarray, shape (4,), and tuple of str
        Levels of white, and the source of each: `KNOWN_WHITE`, `SUN_IMAGE` or `BRIGHTEST`.
    needs_gain : bool
        True if slopes need a gain for each pixel: a level of white was not measured through the mirror.
    noise : float
        Standard deviation of a pixel relative to the sun's centre; NaN to estimate it from the residuals. [1]
    metadata : list of dict
        Metadata of the images.
    """
    entries, pictures = study.images or (), _pictures(study)
    said = [picture.metadata for picture in pictures]
    rows, columns = pictures[0].levels.shape

    def each(key: str, others: Any, stated: float | None = None) -> Floats:
        """Return the value of the study, or those of the metadata, or else other ones."""
        found = [one.get(key, other) for one, other in zip(said, np.broadcast_to(others, len(said)), strict=True)]
        return np.array(found if stated is None else [stated] * len(said), np.float64)

    corners = np.array([one.corners or np.full((4, 2), np.nan) for one in entries])
    marked, focal = np.isfinite(corners).all(axis=(1, 2)), each("FOCALPIX", math.nan)
    rectified = _stated(study, "rectified")
    if rectified is None:
        told = np.any(marked) or np.any(np.isfinite(focal)) or isinstance(study.heliostat.pixel, Sweep)
        rectified = not told and (rows, columns) == mirror_grid(
            study.heliostat.rectangles, study.heliostat.pixel  # type: ignore[arg-type]  # not swept
        ).module.shape  # fmt: skip
    if not rectified and np.any(lost := ~np.isfinite(focal) & ~marked):
        number = int(np.argmax(lost))
        raise StudyError(study.problem(f"images[{number}]", (
            f"the position of the mirror in {entries[number].file} is unknown: mark its 'corners', or give FOCALPIX "
            "in its metadata"
        )))  # fmt: skip
    darks = each("DARK", 0.0, _stated(study, "dark"))
    white, white_from = _white(study, pictures, darks)
    limits = each("SATURATE", [picture.saturation for picture in pictures], _stated(study, "saturation"))
    levels = np.stack([picture.levels for picture in pictures])
    return Shots(
        images=(levels - darks[:, np.newaxis, np.newaxis]) / (white - darks)[:, np.newaxis, np.newaxis],
        saturation=(limits - darks) / (white - darks),
        rectified=bool(rectified),
        focal=np.where(np.isfinite(focal), focal, 1000.0),  # of marked images any: the homography has the scale
        centre=np.stack((each("CENTREU", 0.5 * (columns - 1)), each("CENTREV", 0.5 * (rows - 1))), axis=1),
        roll=np.radians(each("ROLL", 0.0)),
        corners=corners,
        positions=_positions(study, said),
        geometry=_geometry(study, pictures),
        white=white,
        white_from=white_from,
        needs_gain=not set(white_from) <= set(KNOWN_WHITE),
        noise=float(each("", math.nan, _stated(study, "noise"))[0]),
        metadata=said,
    )


def bright_level(image: Floats) -> float:
    """Return the level of an image that all but `HOT_PIXELS` of its pixels are below."""
    known = image[np.isfinite(image)]
    few = min(HOT_PIXELS, known.size - 1)
    return float(-np.partition(-known, few)[few])


def read_sun(study: BackwardGazingStudy) -> tuple[SunProfile | None, list[str]]:
    """Return the profile of the study's sun image or table, None without either, and notes. Raises StudyError."""
    key, name, table = "sun.image", study.sun.image, study.sun.profile
    if name is None:
        return None if table is None else read_disc(study.resolve(table), table), []
    picture, disc = _disc(study, name)
    pixel = study.sun.pixel_angle or picture.metadata.get("PIXANGLE")
    stated: Any = study.sun.angular_radius or 1e3 * EPS_MAX  # not swept
    radius = 1e-3 * (stated if pixel is None else pixel * disc.radius)
    if not 3e-3 < radius < 7e-3:
        message = f"its disc of {disc.radius:.1f} pixels would have a radius of {1e3 * radius:.3g} mrad; a sun has 4.65"
        raise StudyError(Problem(f"{message}: correct sun.pixel_angle or PIXANGLE", key, name))
    rises = int(np.count_nonzero(np.diff(disc.brightness) > 0.0))
    note = (
        f"{name}: the brightness rises in {rises} of {len(disc.brightness) - 1} rings from the centre "
        "to the edge; the lowest falling curve above it is used"
    )
    angle = np.linspace(0.0, radius, len(disc.brightness))
    falling = falling_envelope(np.maximum(disc.brightness, 0.0))
    return SunProfile(tuple(angle.tolist()), tuple(falling.tolist())), [note] if rises else []


def _stated(study: BackwardGazingStudy, key: str) -> Any:
    """Return the value of a study for all images, or None."""
    return None if study.image_geometry is None else getattr(study.image_geometry, key)


def _disc(study: BackwardGazingStudy, name: str) -> tuple[Picture, SunDisc]:
    """Return the image of the sun and the disc in it. Raises StudyError."""
    picture = _read(study, "sun.image", name)
    saturated = float(np.mean(picture.levels >= picture.metadata.get("SATURATE", picture.saturation)))
    try:
        if saturated > 0.0:
            raise ValueError(f"{100 * saturated:.3g} % of its pixels are saturated; use a shorter exposure")
        return picture, disc_profile(picture.levels - picture.metadata.get("DARK", _stated(study, "dark") or 0.0))
    except ValueError as error:
        raise StudyError(Problem(str(error), "sun.image", name)) from None


def _read(study: BackwardGazingStudy, key: str, name: str) -> Picture:
    """Read an image that a key of the study names; problems name the key too."""
    try:
        return read_picture(study.resolve(name), name)
    except StudyError as error:
        raise StudyError(replace(problem, key=problem.key or key) for problem in error.problems) from None


def _pictures(study: BackwardGazingStudy) -> list[Picture]:
    """Read the images, all of one size, with the metadata of the study. Raises StudyError with all problems."""
    pictures: list[Picture] = []
    problems: list[Problem] = []
    for number, entry in enumerate(study.images or ()):
        try:
            picture = _read(study, f"images[{number}]", entry.file)
            stated = {} if entry.metadata is None else entry.metadata.model_dump(exclude_none=True)
            pictures.append(picture._replace(metadata=picture.metadata | stated))
        except StudyError as error:
            problems += error.problems
    (rows, columns), _ = Counter(one.levels.shape for one in pictures).most_common(1)[0] if pictures else ((0, 0), 0)
    for number, one in enumerate(pictures):
        if not problems and one.levels.shape != (rows, columns):
            size = f"{one.levels.shape[1]} x {one.levels.shape[0]} pixels, and others have {columns} x {rows}"
            problems.append(study.problem(f"images[{number}]", f"{one.name} has {size}: all need the same size"))
    if problems:
        raise StudyError(problems)
    return pictures


def _white(study: BackwardGazingStudy, pictures: list[Picture], dark: Floats) -> tuple[Floats, tuple[str, ...]]:
    """Return the levels of white and their sources."""
    stated, said = _stated(study, "white"), [one.metadata.get("WHITE") for one in pictures]
    known = stated is not None or None not in said or study.sun.image is None
    level = math.nan if known else _disc(study, str(study.sun.image))[1].level
    # One level for all: the brightness that each camera happens to see must not scale the cameras.
    highest = max(bright_level(picture.levels) - each for picture, each in zip(pictures, dark, strict=True))
    pairs = [
        (stated, "study") if stated is not None else
        (one, "metadata") if one is not None else
        (each + level, SUN_IMAGE) if math.isfinite(level) else
        (each + highest, BRIGHTEST)
        for one, each in zip(said, dark, strict=True)
    ]  # fmt: skip
    for number, ((white, _), each) in enumerate(zip(pairs, dark, strict=True)):
        if not white > each:
            message = f"the level of white, {white:g}, is not above the dark level, {each:g}: correct white and dark"
            raise StudyError(Problem(message, f"images[{number}]", pictures[number].name))
    return np.array([white for white, _ in pairs]), tuple(source for _, source in pairs)


def _positions(study: BackwardGazingStudy, said: list[dict[str, float]]) -> tuple[tuple[float, float], ...] | None:
    """Return the positions of the cameras from the images, their metadata, or the study."""
    found = tuple(
        entry.camera or (one["CAMERAY"], one["CAMERAZ"])
        for entry, one in zip(study.images or (), said, strict=True)
        if entry.camera is not None or {"CAMERAY", "CAMERAZ"} <= one.keys()
    )
    if 0 < len(found) < len(said):
        message = f"the position of the camera is known for {len(found)} images of {len(said)}; give it for all or none"
        raise StudyError(study.problem("images", message))
    return found or study.cameras.positions


def _geometry(study: BackwardGazingStudy, pictures: list[Picture]) -> dict[str, float]:
    """Return sun, target and distance from metadata if the study does not have them."""
    found: dict[str, float] = {}
    least = study.heliostat.reach
    for key, dotted in GEOMETRY.items():
        block, name = dotted.split(".")
        if getattr(getattr(study, block), name) is not None:
            continue
        values = {number: one.metadata[key] for number, one in enumerate(pictures) if key in one.metadata}
        if not values:
            message = f"is missing, in the study and as {key} in the metadata of the images"
            raise StudyError(study.problem(dotted, message))
        found[dotted] = first = next(iter(values.values()))
        for number, value in values.items():
            near = key == "DISTANCE" and not value > least
            if near or abs(value - first) > 1e-6 * max(1.0, abs(first)):
                words = (
                    f"more than {least:.3g} m, the reach of the heliostat" if near else f"{first:g} as in another image"
                )
                message = f"{key} in the metadata must be {words} (got {value:g}); correct it, or set {dotted}"
                raise StudyError(Problem(message, f"images[{number}]", pictures[number].name))
    return found
