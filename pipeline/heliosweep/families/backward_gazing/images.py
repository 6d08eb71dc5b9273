"""Read images of the heliostat or the sun, with camera data, grey levels and metadata.

NPY, PNG, TIFF and FITS files are read as grey levels. Metadata are numbers with the keys in `blocks.METADATA`. They are
stored as FITS header cards, PNG text chunks, or lines ``KEY = value`` in a TIFF ImageDescription. Values in the study
have priority over metadata. The first row of an image is its top row. FITS files store the bottom row first, unless the
ROWORDER card is TOP-DOWN.

If neither the corners of the heliostat nor the pinhole geometry is known, the heliostat is located with scikit-image.
The rotation, scale and shift are found by phase correlation of the lit pixels with the silhouette of the modules in an
upright image. Each side of the heliostat is then located to a fraction of a pixel. Brightness profiles across a side
give its offset at many positions, and a line is fitted to the offsets by RANSAC. The corners are the intersections of
adjacent sides. A camera may be rotated by at most 40 deg, because the layout of the modules looks the same upside down.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config import Invalid, SunProfile, Sweep, read_profile
from heliosweep.errors import Problem, StudyError
from heliosweep.families.backward_gazing.blocks import METADATA, ImageGeometry
from heliosweep.files import read_once
from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.gazing.geometry import Modules, mirror_grid, outline
from heliosweep.kernels.profiles import EPS_MAX, SunDisc, disc_profile, falling_envelope

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.study import BackwardGazingStudy

#: Maximum number of pixels in an image, and minimum number of pixels on each side.
MAX_PIXELS, MIN_SIDE = 25_000_000, 4
#: Study keys that may be omitted if the metadata of the four images contain equal values.
GEOMETRY = {
    "SUNAZ": "sun.azimuth", "SUNEL": "sun.elevation", "TARGETAZ": "target.azimuth", "TARGETEL": "target.elevation",
    "DISTANCE": "heliostat.distance",
}  # fmt: skip
#: Sources of a white level. Only levels from the study or the metadata are measured through the mirror.
KNOWN_WHITE, SUN_IMAGE, BRIGHTEST = ("study", "metadata"), "sun_image", "brightest_pixels"
#: Focal length used if the focal length of a camera is unknown. The value is arbitrary, because the homography contains
#: the scale. [pixels]
ANY_FOCAL = 1000.0
#: Settings for locating a side [pixels]: maximum distance from its expected position in each round, half the width of
#: its blur, and width of the bands in which the bright and dark levels are measured.
REACH, BLUR, LEVEL = (6.0, 4.0, 1.0, 1.0, 1.0, 1.0), 1.75, 2.0
#: Settings for fitting a line to a side [pixels]: sample spacing along and across the side, and maximum distance of an
#: inlier from the line.
ALONG, ACROSS, NEAR = 0.8, 0.25, 0.15
#: Minimum brightness of a lit pixel relative to the sun's centre, and maximum fraction of the pixels at the image edge
#: with more than half the brightness of the sun's centre. [1]
LIT, MOST_CUT = 0.3, 0.05


class Picture(NamedTuple):
    """Image with grey levels.

    Attributes
    ----------
    levels : ndarray, shape (rows, columns)
        Grey levels, with the top row first and NaN for invalid pixels.
    saturation : float
        Minimum level of a saturated pixel. If the brightest pixel has the maximum level of a sensor with 8, 10, 12, 14
        or 16 bits, this level is used, and otherwise the maximum of the data type.
    metadata : dict
        Metadata values in the file, by key of `METADATA`.
    name : str
        File name in the study.
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
        NPY file (a two-dimensional array of numbers), PNG or TIFF file (one grey channel), or FITS file (first image).
    name : str
        File name in error messages.

    Raises
    ------
    StudyError
        If the file is not a readable grey image of at most `MAX_PIXELS` pixels.
    """
    try:
        levels, said, top = _contents(path)
        if levels.ndim != 2 or levels.dtype.kind not in "iuf":
            raise ValueError(
                f"it has {levels.ndim} dimensions of {levels.dtype}, but must be a two-dimensional array of grey levels"
            )
        if levels.size > MAX_PIXELS or min(levels.shape) < MIN_SIDE:
            raise ValueError(f"it has {levels.shape[1]} x {levels.shape[0]} pixels, but must have at least "
                             f"{MIN_SIDE} on each side and at most {MAX_PIXELS:,}: crop it")  # fmt: skip
        if top is None:
            top = float(np.iinfo(levels.dtype).max) if levels.dtype.kind in "iu" else math.inf
        values = np.array(levels, np.float64, order="C")
        values[~np.isfinite(values)] = math.nan
        if np.all(np.isnan(values)):
            raise ValueError("no pixel is a valid number")
    except ImportError:
        raise StudyError(Problem("needs the package astropy: pip install astropy", file=name)) from None
    except Exception as error:  # decoders raise many types of exceptions
        raise StudyError(Problem(f"cannot be read as a grey image: {error}", file=name)) from None
    highest = float(np.nanmax(values))
    sensors = (2.0**bits - 1.0 for bits in (8, 10, 12, 14, 16) if math.isfinite(top))
    return Picture(values, next((each for each in sensors if each == highest), top), _metadata(said, name), name)


def _contents(path: Path) -> tuple[NDArray[Any], Mapping[str, Any], float | None]:
    """Return the grey levels in an image file (top row first), the metadata, and the maximum level if defined."""
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
                raise ValueError(f"it has more than {MAX_PIXELS:,} pixels: crop it to the heliostat")
            highest = {8: 255.0, 16: 2.0**15 - 1.0, 32: 2.0**31 - 1.0, 64: 2.0**63 - 1.0}.get(bits, math.inf)
            down = str(header.get("ROWORDER", "")).strip().upper() == "TOP-DOWN"
            top = header.get("BZERO", 0.0) + header.get("BSCALE", 1.0) * highest
            return np.array(unit.data if down else unit.data[::-1]), header, top
    from PIL import Image

    with Image.open(path, formats=("PNG", "TIFF")) as image:
        if image.mode in ("1", "P", "PA"):
            raise ValueError(f"its pixels are {'black and white' if image.mode == '1' else 'a palette'}")
        if image.width * image.height > MAX_PIXELS or getattr(image, "n_frames", 1) > 1:
            raise ValueError(f"it has several pages, or more than {MAX_PIXELS:,} pixels: crop it to the heliostat")
        said: dict[Any, Any] = dict(image.info)
        if image.format == "TIFF":
            lines = str(image.tag_v2.get(270, "")).replace("\0", "\n").splitlines()  # type: ignore[attr-defined]
            said = {key.strip(): value for key, _, value in (line.partition("=") for line in lines)}
        return np.array(image), said, None


def _metadata(said: Mapping[str, Any], name: str) -> dict[str, float]:
    """Return the metadata values of the keys in `METADATA`. Raises a StudyError that lists all invalid values."""
    found, problems = dict[str, float](), []
    for key, quantity in METADATA.items():
        try:
            if key in said:
                found[key] = float(quantity.read(float(str(said[key]))))
        except (ValueError, Invalid):
            bounds, meaning = quantity.bounds() or "a number", quantity.description
            problems.append(Problem(f"{key} in the metadata must be {bounds}, the {meaning[0].lower()}{meaning[1:]} "
                                    f"(got {str(said[key])[:40]!r}): correct or remove it", file=name))  # fmt: skip
    if problems:
        raise StudyError(problems)
    return found


@read_once(4)
def read_disc(path: Path, name: str) -> SunProfile:
    """Read a sun profile: brightness relative to the centre of the disc.

    Parameters
    ----------
    path, name
        File to read, and file name in error messages.

    Raises
    ------
    StudyError
        If the file cannot be read or does not contain a usable profile.
    """
    profile = read_profile(path, name)
    radius, brightness = 1e3 * profile.angle[-1], np.array(profile.brightness)
    few = max(2, brightness.size // 20)
    centre, edge = float(brightness[:few].mean()), float(brightness[-few:].mean())
    faults = {
        "a sun profile needs at least 4 rows": brightness.size < 4,
        "the brightness must be relative to the disc centre, and at most 1.5": brightness.max() > 1.5
        or not 0.8 <= centre <= 1.25,
        "a sun profile must be at least 5 % darker at its edge than at its centre to determine slopes": (
            not edge <= 0.95 * centre
        ),
        f"the last angle must be the disc's radius in mrad (got {radius:g})": not 1.0 <= radius <= 20.0,
    }
    if wrong := next((fault for fault, present in faults.items() if present), ""):
        raise StudyError(Problem(wrong, file=name))
    return profile


#: Images of a study with camera data and grey levels, as returned by `read_shots`.
Shots = SimpleNamespace


def read_shots(study: BackwardGazingStudy) -> Shots:
    """Read the images of a study, with camera data and grey levels.

    Raises a StudyError that lists all problems in the files.

    Returns
    -------
    images : ndarray, shape (4, rows, columns)
        Brightness relative to the sun's centre, top row first. [1]
    saturation : ndarray, shape (4,)
        Minimum brightness of a saturated pixel. [1]
    rectified : bool
        True if the images are on the mirror grid.
    register : ndarray of bool, shape (4,)
        True for images in which the heliostat must be located.
    focal, centre, roll : ndarray, shape (4,), (4, 2) and (4,)
        Focal length [pixels], column and row of the line of sight [pixels], and rotation [rad] of each camera.
    corners : ndarray, shape (4, 4, 2)
        Marked corners (column, row); NaN if not marked. [pixels]
    positions : tuple or None
        Positions of the cameras in the target plane; None if arrangement and radius are used. [m]
    geometry : dict
        Values taken from the metadata, by study key.
    white, white_from : ndarray, shape (4,), and tuple of str
        White level of each image, and source of each level (`KNOWN_WHITE`, `SUN_IMAGE` or `BRIGHTEST`).
    needs_gain : bool
        True if a gain must be fitted for each pixel, because a white level was not measured through the mirror.
    noise : float
        Standard deviation of the pixel noise relative to the brightness of the sun's centre; NaN if the noise must be
        estimated from the residuals. [1]
    metadata : tuple of dict
        Metadata of the images.
    """
    entries, pictures, settings = study.images or (), _pictures(study), study.image_geometry or ImageGeometry()
    levels, tops, said, _ = zip(*pictures, strict=True)
    rows, columns = levels[0].shape

    def each(key: str, others: Any, stated: float | None = None) -> Floats:
        """Return the value in the study if there is one, otherwise the values in the metadata or in `others`."""
        found = [one.get(key, other) for one, other in zip(said, np.broadcast_to(others, len(said)), strict=True)]
        return np.array(found if stated is None else [stated] * len(said), np.float64)

    corners = np.array([one.corners or np.full((4, 2), np.nan) for one in entries])
    marked, focal = np.isfinite(corners).all(axis=(1, 2)), each("FOCALPIX", math.nan)
    rectified, register = settings.rectified, settings.registration
    if rectified is None:
        told = np.any(marked) or np.any(np.isfinite(focal)) or register or isinstance(study.heliostat.pixel, Sweep)
        rectified = not told and (rows, columns) == mirror_grid(
            study.heliostat.rectangles, study.heliostat.pixel  # type: ignore[arg-type]  # not swept
        ).module.shape  # fmt: skip
    search = ~marked & (~np.isfinite(focal) if register is None else np.full(4, register)) & (not rectified)
    if not rectified and np.any(lost := ~np.isfinite(focal) & ~marked & ~search):
        number = int(np.argmax(lost))
        raise StudyError(study.problem(f"images[{number}]", (
            f"the position of the mirror in {entries[number].file} is unknown: mark the 'corners', give FOCALPIX in "
            "the metadata, or set image_geometry.registration"
        )))  # fmt: skip
    darks = each("DARK", 0.0, settings.dark)
    white, white_from = _white(study, settings.white, pictures, darks)
    limits = each("SATURATE", tops, settings.saturation)
    return Shots(
        images=(np.stack(levels) - darks[:, np.newaxis, np.newaxis]) / (white - darks)[:, np.newaxis, np.newaxis],
        saturation=(limits - darks) / (white - darks),
        rectified=bool(rectified),
        register=search,
        focal=np.where(np.isfinite(focal), focal, ANY_FOCAL),
        centre=np.stack((each("CENTREU", 0.5 * (columns - 1)), each("CENTREV", 0.5 * (rows - 1))), axis=1),
        roll=np.radians(each("ROLL", 0.0)),
        corners=corners,
        positions=_positions(study, said),
        geometry=_geometry(study, pictures),
        white=white,
        white_from=white_from,
        needs_gain=not set(white_from) <= set(KNOWN_WHITE),
        noise=float(each("", math.nan, settings.noise)[0]),
        metadata=said,
    )


def bright_level(image: Floats) -> float:
    """Return the brightest level of an image, ignoring the 30 brightest pixels, which may be hot pixels."""
    known = image[np.isfinite(image)]
    few = min(30, known.size - 1)
    return float(-np.partition(-known, few)[few])


def read_sun(study: BackwardGazingStudy) -> tuple[SunProfile | None, list[str]]:
    """Return the sun profile from the study's sun image or table, or None, and notes. Raises StudyError."""
    key, name, table = "sun.image", study.sun.image, study.sun.profile
    if name is None:
        return None if table is None else read_disc(study.resolve(table), table), []
    picture, disc = _disc(study, name)
    pixel = study.sun.pixel_angle or picture.metadata.get("PIXANGLE")
    stated: Any = study.sun.angular_radius or 1e3 * EPS_MAX  # not swept
    radius = 1e-3 * (stated if pixel is None else pixel * disc.radius)
    if not 3e-3 < radius < 7e-3:
        message = f"its disc radius of {disc.radius:.1f} pixels would be {1e3 * radius:.3g} mrad (expected 4.65)"
        raise StudyError(Problem(f"{message}: correct sun.pixel_angle or PIXANGLE", key, name))
    rises = int(np.count_nonzero(np.diff(disc.brightness) > 0.0))
    note = (
        f"{name}: the brightness rises in {rises} of {len(disc.brightness) - 1} rings from the centre to the edge; "
        "the lowest decreasing curve above the profile is used"
    )
    angle = np.linspace(0.0, radius, len(disc.brightness))
    falling = falling_envelope(np.maximum(disc.brightness, 0.0))
    return SunProfile(tuple(angle.tolist()), tuple(falling.tolist())), [note] if rises else []


def _disc(study: BackwardGazingStudy, name: str) -> tuple[Picture, SunDisc]:
    picture = _read(study, "sun.image", name)
    saturated = float(np.mean(picture.levels >= picture.metadata.get("SATURATE", picture.saturation)))
    try:
        if saturated > 0.0:
            raise ValueError(f"{100 * saturated:.3g} % of its pixels are saturated; use a shorter exposure")
        return picture, disc_profile(
            picture.levels - picture.metadata.get("DARK", (study.image_geometry or ImageGeometry()).dark or 0.0)
        )
    except ValueError as error:
        raise StudyError(Problem(str(error), "sun.image", name)) from None


def _read(study: BackwardGazingStudy, key: str, name: str) -> Picture:
    """Read the image at a study key, and report any problems under this key."""
    try:
        return read_picture(study.resolve(name), name)
    except StudyError as error:
        raise StudyError(replace(problem, key=problem.key or key) for problem in error.problems) from None


def _pictures(study: BackwardGazingStudy) -> list[Picture]:
    """Read the images, which must have equal sizes, and merge their metadata with the metadata in the study.

    Raises a StudyError that lists all problems.
    """
    pictures, problems = list[Picture](), list[Problem]()
    for number, entry in enumerate(study.images or ()):
        try:
            picture = _read(study, f"images[{number}]", entry.file)
            stated = {} if entry.metadata is None else entry.metadata.model_dump(exclude_none=True)
            pictures.append(picture._replace(metadata=picture.metadata | stated))
        except StudyError as error:
            problems += error.problems
    (rows, columns), _ = Counter(one.levels.shape for one in pictures).most_common(1)[0] if pictures else ((0, 0), 0)
    for number, one in enumerate(pictures if not problems else ()):
        if one.levels.shape != (rows, columns):
            size = f"{one.levels.shape[1]} x {one.levels.shape[0]} pixels, but the others have {columns} x {rows}"
            message = f"{one.name} has {size}: all images must have the same size"
            problems.append(study.problem(f"images[{number}]", message))
    if problems:
        raise StudyError(problems)
    return pictures


def _white(
    study: BackwardGazingStudy, stated: float | None, pictures: list[Picture], dark: Floats
) -> tuple[Floats, tuple[str, ...]]:
    said = [one.metadata.get("WHITE") for one in pictures]
    known = stated is not None or None not in said or study.sun.image is None
    level = math.nan if known else _disc(study, str(study.sun.image))[1].level
    # All cameras share one level, because otherwise the brightest pixel of each camera would determine its scale.
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
            message = f"the white level, {white:g}, is not above the dark level, {each:g}: correct white or dark"
            raise StudyError(Problem(message, f"images[{number}]", pictures[number].name))
    return np.array([white for white, _ in pairs]), tuple(source for _, source in pairs)


def _positions(study: BackwardGazingStudy, said: Sequence[dict[str, float]]) -> tuple[tuple[float, float], ...] | None:
    """Return the camera positions from the study's images or their metadata, otherwise from `study.cameras`."""
    found = tuple(
        entry.camera or (one["CAMERAY"], one["CAMERAZ"])
        for entry, one in zip(study.images or (), said, strict=True)
        if entry.camera is not None or {"CAMERAY", "CAMERAZ"} <= one.keys()
    )
    if 0 < len(found) < len(said):
        message = (
            f"the camera position is known for only {len(found)} of {len(said)} images: give it for all images or for "
            "none"
        )
        raise StudyError(study.problem("images", message))
    return found or study.cameras.positions


def _geometry(study: BackwardGazingStudy, pictures: list[Picture]) -> dict[str, float]:
    """Return the values of sun, target and distance keys that the study omits, from the metadata of the images."""
    found, least = dict[str, float](), study.heliostat.reach
    for key, dotted in GEOMETRY.items():
        block, name = dotted.split(".")
        if getattr(getattr(study, block), name) is not None:
            continue
        values = {number: one.metadata[key] for number, one in enumerate(pictures) if key in one.metadata}
        if not values:
            message = f"is missing from the study, and {key} from the metadata of the images"
            raise StudyError(study.problem(dotted, message))
        found[dotted] = first = next(iter(values.values()))
        for number, value in values.items():
            near = key == "DISTANCE" and not value > least
            if near or abs(value - first) > 1e-6 * max(1.0, abs(first)):
                words = (
                    f"more than {least:.3g} m, the reach of the heliostat" if near else f"{first:g} as in another image"
                )
                message = f"{key} in the metadata must be {words} (got {value:g}): correct it, or set {dotted}"
                raise StudyError(Problem(message, f"images[{number}]", pictures[number].name))
    return found


def register(
    image: Floats, upright: Callable[[Floats], Floats], modules: Modules
) -> tuple[Floats, float, float, Floats, float]:
    """Find a heliostat in an image.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Brightness relative to the sun's centre; NaN counts as dark. [1]
    upright : callable
        Function that projects mirror points (y, z), shape (2, n) [m], into the image of an upright camera, shape (2, n)
        [pixels]. The focal length of this camera is arbitrary.
    modules : Modules
        Modules of the heliostat.

    Returns
    -------
    corners : ndarray, shape (4, 2)
        Upper left, upper right, lower right and lower left corners (column, row). [pixels]
    turn, scale : float
        Clockwise rotation [rad], and scale relative to the image of the upright camera.
    centre : ndarray, shape (2,)
        Column and row of the heliostat's centre. [pixels]
    residual : float
        Root mean square distance of the measured offsets from the fitted sides. [pixels]

    Raises
    ------
    ValueError
        If the heliostat is not found in the image, or scikit-image is not installed.
    """
    try:
        from skimage.transform import ProjectiveTransform
    except ImportError:
        raise ValueError("registration needs scikit-image: pip install 'heliosweep[images]'") from None
    seen = np.nan_to_num(image, posinf=0.0, neginf=0.0)
    if np.mean(np.concatenate((seen[0], seen[-1], seen[1:-1, 0], seen[1:-1, -1])) > 0.5) > MOST_CUT:
        raise ValueError("it is lit up to the edge of the image, so the heliostat is probably cut off")
    ends = outline(modules).T
    predicted = upright(ends).T
    whole: Any = _coarse(seen, upright, modules)
    for reach in REACH:
        corners, residual = _corners(seen, upright, whole, ends, reach)
        whole = ProjectiveTransform.from_estimate(predicted, corners)
        if not whole or not residual <= 0.5:  # pixels
            raise ValueError(f"the edges of the modules do not fit: they are {residual:.2g} pixels off")
    middle = predicted.mean(axis=0)
    across, down = whole(middle + np.eye(2)) - whole(middle)
    long, short = np.linalg.svd(np.stack((across, down)), compute_uv=False)
    if long > 1.02 * short:  # ratio 1.002 for a correct result, 1.056 if THEMIS is rotated by 90 deg
        raise ValueError(f"its image is stretched by {100 * (long / short - 1):.0f} %, as if rotated by > 40 deg")
    centre = whole(upright(np.zeros((2, 1))).T)[0]
    return corners, math.atan2(across[1], across[0]), float(np.hypot(*across)), centre, residual


def _coarse(seen: Floats, upright: Callable[[Floats], Floats], modules: Modules) -> Any:
    """Return the rotation, scale and shift that best fit the silhouette of the modules to the lit pixels."""
    from scipy.ndimage import map_coordinates, uniform_filter
    from skimage.draw import polygon
    from skimage.registration import phase_cross_correlation
    from skimage.transform import SimilarityTransform

    step = max(max(seen.shape) / 96, 1.0)  # pixel size of the correlated images
    size = np.array(seen.shape) // step
    places = [(np.arange(side) + 0.5) * step - 0.5 for side in size]
    lit = uniform_filter(np.clip(seen / LIT, 0.0, 1.0), max(round(step), 1))
    small = map_coordinates(lit, np.meshgrid(*places, indexing="ij"), order=1)
    if not small.sum() > 0.0:
        raise ValueError("it has no lit pixel")
    signs = np.array([[-0.5, 0.5, 0.5, -0.5], [0.5, 0.5, -0.5, -0.5]])
    corners = modules.centre.T[:, :, np.newaxis] + modules.size.T[:, :, np.newaxis] * signs[:, np.newaxis]
    quads, ends = upright(corners.reshape(2, -1)).T, upright(outline(modules).T)
    area = abs(np.linalg.det(np.diff(ends[:, :3], axis=1)))
    about, best = math.sqrt(small.sum() * step**2 / area), (-1.0, None)
    # The initial scale is estimated from the lit area. This estimate is too small if modules are dark.
    for scale in about * np.exp(np.arange(-0.16, 0.53, 0.06)):
        for turn in np.radians(np.arange(-40.0, 41.0, 4.0)):
            map_ = SimilarityTransform(translation=-ends.mean(axis=1)) + SimilarityTransform(scale=scale, rotation=turn)
            mask = np.zeros(small.shape)
            for quad in (map_(quads) / step + 0.5 * size[::-1]).reshape(-1, 4, 2):
                mask[polygon(quad[:, 1], quad[:, 0], mask.shape)] = 1.0
            shift, _, _ = phase_cross_correlation(small, mask, normalization=None)
            overlap = float(np.sum(np.roll(mask, shift.astype(int), axis=(0, 1)) * small))
            score = overlap / (small.sum() + 0.3 * (mask.sum() - overlap))
            if score > best[0]:
                best = score, map_ + SimilarityTransform(translation=step * (0.5 * size + shift + 0.5)[::-1] - 0.5)
    return best[1]


def _corners(
    seen: Floats, upright: Callable[[Floats], Floats], whole: Any, ends: Floats, reach: float
) -> tuple[Floats, float]:
    """Locate the sides of the heliostat within the distance `reach` of their expected positions. [pixels]

    Returns the corners, shape (4, 2), and the root mean square residual.
    """
    from scipy.ndimage import map_coordinates
    from skimage.measure import LineModelND, ransac

    lines, squares = [], []
    t = np.arange(-BLUR - LEVEL - reach, BLUR + LEVEL + reach + 1e-9, ACROSS)
    inside, outside = t <= -BLUR - reach + 1e-9, t >= BLUR + reach - 1e-9
    between = slice(np.count_nonzero(inside) - 1, 1 - np.count_nonzero(outside))
    for first, last in zip(ends.T, np.roll(ends, -1, axis=1).T, strict=True):
        chord = np.diff(whole(upright(np.stack((first, last), axis=1)).T), axis=0)
        count = max(int(np.hypot(*chord[0]) / ALONG), 2)
        share = np.linspace(0.0, 1.0, count)
        points = whole(upright(first[:, np.newaxis] * (1.0 - share) + last[:, np.newaxis] * share).T)
        along = np.gradient(points, axis=0)
        normal = np.stack((along[:, 1], -along[:, 0]), axis=1) / np.hypot(*along.T)[:, np.newaxis]  # outwards
        u, v = (points[:, np.newaxis] + t[:, np.newaxis] * normal[:, np.newaxis]).transpose(2, 0, 1)
        values = map_coordinates(seen, [v, u], order=1, cval=0.0)
        level, slope = np.polynomial.polynomial.polyfit(t[inside], values[:, inside].T, 1)
        base = values[:, outside].mean(axis=1, keepdims=True)
        with np.errstate(all="ignore"):
            part = (values - base) / (level[:, np.newaxis] + slope[:, np.newaxis] * t - base)
        offset = np.trapezoid(part[:, between], dx=ACROSS, axis=1) - BLUR - reach
        good = (values[:, inside].min(axis=1) > LIT) & (base[:, 0] < 0.5 * level) & (np.abs(offset) <= reach)
        if np.count_nonzero(good) < 12:
            raise ValueError("too few edges of its modules are visible")
        data = np.stack((ALONG * np.arange(count), offset), axis=1)[good]
        _, kept = ransac(data, LineModelND, min_samples=2, residual_threshold=NEAR, max_trials=200, rng=0)
        fit = np.polyfit(data[kept, 0], data[kept, 1], 1)
        squares.append((data[kept, 1] - np.polyval(fit, data[kept, 0])) ** 2)
        moved = points[[0, -1]] + np.polyval(fit, [[0.0], [ALONG * (count - 1)]]) * normal[[0, -1]]
        lines.append(np.cross(*np.column_stack((moved, np.ones(2)))))
    corners = np.cross(np.roll(lines, 1, axis=0), lines)
    return corners[:, :2] / corners[:, 2:], math.sqrt(np.mean(np.concatenate(squares)))
