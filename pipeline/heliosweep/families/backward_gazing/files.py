"""Files that studies name: images (NPY, PNG, TIFF or FITS, told apart by their first bytes), and profiles of the sun.

Images are read in grey levels and with their metadata.

Metadata are numbers under the keys of `image_blocks.Metadata`: cards of a FITS header, text chunks of a PNG, lines
``KEY = value`` of a TIFF's ImageDescription. NPY has none. The first row of a picture is its upper one: in PNG, TIFF
and NPY the first row of the file; in FITS, whose rows count from the bottom, the last one, unless the card ROWORDER
says TOP-DOWN.
"""

from __future__ import annotations

import io
import math
import os
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.faults import Invalid
from heliosweep.config.profiles import SunProfile, read_profile
from heliosweep.config.values import Quantity
from heliosweep.errors import Problem, StudyError
from heliosweep.families.backward_gazing.image_blocks import Metadata
from heliosweep.files import read_once

#: Largest file, and pixels of an image. [bytes, 1]
MAX_BYTES, MAX_PIXELS = 512 * 2**20, 25_000_000
#: Fewest pixels along a side of an image.
MIN_SIDE = 4
#: Pixels from which a file must have a byte for each `EMPTIEST` of them: the noise of a sensor is not so compressible.
LARGE, EMPTIEST = 1_000_000, 200
#: Most that is read before the size of an image is known, portions in which a file is read, and tiles of a compressed
#: FITS. [bytes, 1, 1]
MAX_HEADER, MAX_READS, MAX_TILES = 2**20, 60_000, 100_000

#: Brightness relative to the centre above which it is no sun's, and least part by which a sun falls towards its edge.
MAX_BRIGHTNESS, LEAST_FALL = 1.5, 0.05

#: Metadata that are read.
KEYS: dict[str, Quantity] = {key: Metadata.parameter(key) for key in Metadata.model_fields}  # type: ignore[misc]


@dataclass(frozen=True, eq=False)
class Picture:
    """An image in grey levels."""

    levels: NDArray[np.float64]
    """Upper row first; NaN where the file has none, shape (rows, columns). [levels]"""
    top: float
    """Highest level of the file's type of number; infinite for floating point."""
    metadata: dict[str, float]
    """Those of `KEYS` that the file has."""
    name: str
    """Name of the file, as the user gave it."""

    @property
    def saturation(self) -> float:
        """Level from which a pixel counts as saturated, if nobody says it: the highest of the file's type, or of fewer
        bits where that is the image's highest level (a sensor of 12 bit in a file of 16).
        """
        if not math.isfinite(self.top):
            return math.inf
        highest = float(np.nanmax(self.levels))
        return next((2.0**bits - 1.0 for bits in (8, 10, 12, 14, 16) if highest == 2.0**bits - 1.0), self.top)


@read_once(6)
def read_picture(path: Path, name: str = "") -> Picture:
    """Read an image.

    Parameters
    ----------
    path : pathlib.Path
        NPY (two dimensions, numbers), PNG or TIFF (one grey channel of 8, 16 or 32 bit or floating point), or FITS
        (the first image in it).
    name : str
        Name of the file in messages; `path` by default.

    Raises
    ------
    StudyError
        If the file cannot be read, is damaged or is no such image; says what to do about it.
    """
    name = name or str(path)
    try:
        status = path.stat()
    except OSError as error:
        _fail(name, f"cannot be read: {error.strerror}")
    except ValueError as error:
        _fail(name, f"cannot be read: {error}")
    if not path.is_file():
        _fail(name, "is a folder, not an image" if path.is_dir() else "is not a regular file")
    if status.st_size > MAX_BYTES:
        _fail(name, f"is larger than {MAX_BYTES // 2**20} MiB; cut the image to the heliostat")
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError as error:
        _fail(name, f"cannot be read: {error.strerror}")
    for magic, read in _READERS.items():
        if head.startswith(magic):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of libraries about damage: what is wrong is said once, by us
                return read(path, name)
    unknown = "is not an image: NPY, PNG, TIFF or FITS can be read" if head else "is empty"
    return _fail(name, next((what for magic, what in _OTHERS.items() if head.startswith(magic)), unknown))


class _Reader(io.BufferedReader):
    """An image file that is refused where a library reads more than `left` bytes of it, or ever smaller portions."""

    def __init__(self, path: Path, name: str) -> None:
        super().__init__(io.FileIO(path))
        self.name_said, self.left, self.reads = name, MAX_HEADER, MAX_READS

    def read(self, size: int | None = -1, /) -> bytes:
        data = super().read(self.left + 1 if size is None or size < 0 else min(size, self.left + 1))
        self.left, self.reads = self.left - len(data), self.reads - 1
        if min(self.left, self.reads) < 0:
            _fail(self.name_said, "has a header or more pieces than any image needs; save the image alone again")
        return data

    def check(self, shape: tuple[int, ...]) -> None:
        """Refuse sizes that are no photograph's; else let its pixels be read."""
        _check_shape(shape, self.name_said)
        pixels, size = math.prod(shape), self.seek(0, io.SEEK_END)
        if pixels > max(LARGE, EMPTIEST * size):
            what = f"has {shape[1]:,} x {shape[0]:,} pixels in {size:,} bytes, which no photograph has"
            _fail(self.name_said, f"{what}; save it again, cut to the heliostat")
        self.left = MAX_HEADER + 16 * pixels


def _npy(path: Path, name: str) -> Picture:
    try:
        # Mapping needs a whole file of plain numbers, so neither a header's promises nor pickles are followed.
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # headers are read by tokenize, and what that may raise is documented nowhere
        said = str(error)
        if "Python objects" in said or "pickle" in said.lower():
            _fail(name, "holds a pickle, which could run code and is never loaded; save an array of numbers")
        if "mmap" in said or "file size" in said or "too large" in said.lower() or "out of range" in said:
            _fail(name, "is truncated: it ends before the array that its header tells of; copy it again")
        _fail(name, "is not a readable NPY file: its header is damaged; save the array again by numpy.save")
    if array.dtype.kind not in "iuf":
        _fail(name, f"holds {array.dtype.name[:40]}, not levels; save integers or floating point numbers")
    _check_shape(array.shape, name)
    return _picture(np.array(array), {}, name)


def _raster(path: Path, name: str) -> Picture:
    """PNG or TIFF."""
    from PIL import Image, UnidentifiedImageError

    try:
        with _Reader(path, name) as file:
            image = Image.open(file, formats=("PNG", "TIFF"))
            place = file.tell()
            file.check((image.height, image.width))
            file.seek(place)
            if getattr(image, "is_animated", False):  # counting the pages takes time
                _fail(name, "holds more than one page; save one image for each file")
            if image.mode not in _GREY:
                what = _MODES.get(image.mode, f"an image of mode {image.mode}")
                _fail(name, f"is {what}; save one channel of it as grey levels, 16 bit if possible")
            with _unheard():
                image.load()
            levels = np.array(image)
            said = _texts(image)
    except Image.DecompressionBombError:
        _fail(name, f"has more than {MAX_PIXELS:,} pixels; cut it to the heliostat")
    except UnidentifiedImageError:
        _fail(name, "is damaged: its beginning is that of an image, the rest is not; copy it again")
    except StudyError:
        raise
    except Exception as error:  # whatever its decoders meet
        cut = any(word in str(error).lower() for word in ("truncated", "not enough", "unexpected end", "end of file"))
        _fail(name, f"is {'truncated' if cut else 'damaged'}: its pixels cannot be read; copy it again")
    return _picture(levels, said, name)


@contextmanager
def _unheard() -> Iterator[None]:
    """Without what compiled libraries print by themselves, as that of TIFF does about damage."""
    try:
        kept = os.dup(2)
    except OSError:  # nothing is printed anywhere
        yield
        return
    with Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _texts(image: Any) -> dict[str, Any]:
    """Text of a PNG, or lines of the description of a TIFF."""
    if image.format == "PNG":
        return {str(key): value for key, value in image.info.items() if isinstance(value, str)}
    description = image.tag_v2.get(270, "")
    lines = str(description).replace("\0", "\n").splitlines()
    pairs = (line.partition("=") for line in lines if "=" in line)
    return {key.strip(): value.strip() for key, _, value in pairs}


def _fits(path: Path, name: str) -> Picture:
    try:
        from astropy.io import fits
    except ImportError:
        _fail(name, "is a FITS image, which needs the package astropy; to install it: pip install astropy")
    try:
        with _Reader(path, name) as file, fits.open(file, memmap=False, lazy_load_hdus=True) as units:
            number, unit = next(((at, one) for at, one in enumerate(units) if one.is_image and one.shape), (0, None))
            if unit is None:
                _fail(name, "holds no image: no unit of it has two axes of pixels")
            header = unit.header
            file.check(unit.shape)
            if isinstance(unit, fits.CompImageHDU):
                _check_tiles(path, number, math.prod(unit.shape), name)
            needed = math.prod(unit.shape) * abs(int(header["BITPIX"])) // 8
            place = unit.fileinfo()
            if not isinstance(unit, fits.CompImageHDU) and place["datLoc"] + needed > path.stat().st_size:
                _fail(name, "is truncated: it ends before the pixels that its header tells of; copy it again")
            top = _fits_top(header)  # before the data are read, which changes the header
            levels = np.array(unit.data)
            said = {key: header[key] for key in KEYS if key in header}
            down = str(header.get("ROWORDER", "")).strip().upper() == "TOP-DOWN"
    except StudyError:
        raise
    except Exception:  # compiled decompression has exceptions of its own
        _fail(name, "is damaged or truncated: its header or pixels cannot be read; copy it again")
    if levels.ndim != 2:
        _fail(name, "is damaged or truncated: its pixels cannot be read; copy it again")
    return _picture(levels if down else levels[::-1], said, name, top)


def _check_tiles(path: Path, number: int, pixels: int, name: str) -> None:
    """Refuse a compressed image of FITS whose tiles would unpack to more than its pixels."""
    from astropy.io import fits

    with fits.open(path, memmap=False, disable_image_compression=True) as units:
        header, most = units[number].header, 8 * pixels
        kind = str(header["ZCMPTYPE"])
        if kind not in ("RICE_1", "RICE_ONE", "GZIP_1", "GZIP_2"):
            _fail(name, f"is compressed by {kind[:20]}, which is not read; unpack it with funpack")
        if (
            header["NAXIS2"] > MAX_TILES
            or header["NAXIS1"] * header["NAXIS2"] + header["PCOUNT"] > MAX_HEADER + 2 * most
        ):
            _fail(name, "has more or larger tiles than its pixels need; save the image again")
        for column in ("COMPRESSED_DATA",) * kind.startswith("GZIP") + ("GZIP_COMPRESSED_DATA",):
            for cell in units[number].data[column] if column in units[number].columns.names else ():
                unpacker = zlib.decompressobj(31)
                most -= len(unpacker.decompress(cell.tobytes(), most + 1))
                if most < 0 or unpacker.unused_data:
                    _fail(name, "has tiles that unpack to more than its pixels; save the image again")


def _fits_top(header: Any) -> float:
    """Highest level of whole numbers, scaled or not; infinite for floating point."""
    bits = int(header["BITPIX"])
    if bits < 0:
        return math.inf
    highest = 2.0 ** (bits if bits == 8 else bits - 1) - 1.0
    return float(header.get("BZERO", 0.0)) + float(header.get("BSCALE", 1.0)) * highest


def _picture(levels: NDArray[Any], said: Mapping[str, Any], name: str, top: float | None = None) -> Picture:
    """Levels as numbers, metadata checked."""
    if top is None:
        top = float(np.iinfo(levels.dtype).max) if levels.dtype.kind in "iu" else math.inf
    values = np.array(levels, np.float64, order="C")
    values[~np.isfinite(values)] = math.nan
    if np.all(np.isnan(values)):
        _fail(name, "has no pixel that is a number")
    values.flags.writeable = False
    return Picture(values, top, _metadata(said, name), name)


def _metadata(said: Mapping[str, Any], name: str) -> dict[str, float]:
    """Numbers under the known keys. Raises StudyError with all that are wrong."""
    found: dict[str, float] = {}
    problems: list[Problem] = []
    for key, quantity in KEYS.items():
        if key not in said:
            continue
        text = str(said[key]).strip()
        try:
            found[key] = float(quantity.read(math.nan if isinstance(said[key], bool) else float(text)))  # type: ignore[arg-type]
        except (ValueError, Invalid):
            what = f"must be {quantity.bounds() or 'a number'}, the {quantity.description[0].lower()}"
            message = (
                f"{key} in the metadata {what}{quantity.description[1:]} (got {text[:40]!r}); correct or remove it"
            )
            problems.append(Problem(message, file=name))
    if problems:
        raise StudyError(problems)
    return found


def _check_shape(shape: tuple[int, ...], name: str) -> None:
    """Refuse what is no grey image, or too large for memory, before any pixel is read."""
    if len(shape) == 3 and (shape[-1] in (2, 3, 4) or shape[0] in (3, 4)):
        _fail(name, f"is a colour image or a stack of images (shape {shape}); save one of them as grey levels")
    if len(shape) != 2:
        _fail(name, f"must have two axes, rows and columns, and has {len(shape)} (shape {shape})")
    if math.prod(shape) > MAX_PIXELS:
        size = f"{shape[1]:,} x {shape[0]:,} pixels"
        _fail(name, f"has {size}, more than {MAX_PIXELS:,} in all; cut it to the heliostat")
    if min(shape) < MIN_SIDE:
        _fail(name, f"has {shape[1]} x {shape[0]} pixels; {MIN_SIDE} along each side are the least")


def _fail(name: str, message: str) -> NoReturn:
    raise StudyError(Problem(message, file=name))


_READERS: dict[bytes, Callable[[Path, str], Picture]] = {
    b"\x93NUMPY": _npy,
    **dict.fromkeys((b"\x89PNG\r\n\x1a\n", b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), _raster),
    b"SIMPLE  =": _fits,
}
#: What else people name as an image, and what to do then.
_OTHERS = {
    b"\xff\xd8\xff": "is a JPEG, whose levels are neither linear nor exact; save it as PNG, TIFF or FITS",
    b"PK\x03\x04": "is an archive (NPZ or ZIP); save one array as NPY",
    b"\x80": "is a pickle, which could run code and is never loaded; save the array with numpy.save",
    b"\x1f\x8b": "is compressed by gzip; unpack it first",
    b"GIF8": "is a GIF, which has no grey levels but a palette; save it as PNG, TIFF or FITS",
    b"BM": "is a bitmap; save it as PNG, TIFF or FITS",
}
_GREY = ("L", "I;16", "I;16B", "I;16L", "I;16N", "I", "F")
_MODES = {
    "1": "an image in black and white",
    **dict.fromkeys(("P", "PA"), "an image with a palette"),
    "LA": "an image with transparency",
    **dict.fromkeys(("RGB", "RGBA", "CMYK", "YCbCr", "LAB"), "a colour image"),
}


@read_once(4)
def read_disc(path: Path, name: str) -> SunProfile:
    """Read the profile of the sun's disc, relative to its centre.

    Parameters
    ----------
    path, name
        As for `heliosweep.config.profiles.read_profile`.

    Raises
    ------
    StudyError
        If the file cannot be read, or is no profile from which slopes follow.
    """
    profile = read_profile(path, name)
    if fault := _shape_fault(1e3 * np.array(profile.angle), np.array(profile.brightness)):
        raise StudyError(Problem(fault, file=name))
    return profile


def _shape_fault(angles: NDArray[np.float64], brightness: NDArray[np.float64]) -> str:
    """Fault of a profile as a whole, in words; empty where there is none."""
    if brightness.size < 4:
        return "a sun profile needs 4 rows at least"
    if brightness.max() > MAX_BRIGHTNESS:
        return f"the brightness must be relative to the disc centre, at most {MAX_BRIGHTNESS:g}"
    few = max(2, brightness.size // 20)
    centre, edge = float(brightness[:few].mean()), float(brightness[-few:].mean())
    if not edge < centre:
        return "a sun profile must be darker at its edge than at its centre"
    if edge > (1.0 - LEAST_FALL) * centre:
        fall = 100.0 * (1.0 - edge / centre)
        message = f"the brightness falls by only {fall:.2g} % from the centre to the edge: no slopes follow from it"
        return f"{message}; {100 * LEAST_FALL:g} % are the least"
    if not 0.8 <= centre <= 1.25:
        return f"the brightness must be relative to the disc centre, where it is {centre:.4g} instead of 1"
    if not 1.0 <= angles[-1] <= 20.0:
        return f"the last angle must be the disc's radius in mrad (got {angles[-1]:g})"
    return ""
