"""Image files: what is read, and what is said of files that cannot be."""

import pickle
import struct
import zlib

import numpy as np
import pytest
from PIL import Image, PngImagePlugin

from heliosweep.errors import StudyError
from heliosweep.families.backward_gazing.files import KEYS, MAX_PIXELS, read_picture

LEVELS = (np.arange(48).reshape(6, 8) * 53).astype(np.uint16)


def chunk(kind: bytes, data: bytes = b"") -> bytes:
    """Return a chunk of a PNG."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width: int, height: int, *chunks: bytes, depth: int = 8) -> bytes:
    """Return a PNG that claims to be of that size, whatever its chunks hold."""
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + b"".join([header, *chunks, chunk(b"IEND")])


def write_png(path, levels=LEVELS, **metadata):
    texts = PngImagePlugin.PngInfo()
    for key, value in metadata.items():
        texts.add_text(key, str(value))
    Image.fromarray(levels).save(path, pnginfo=texts)
    return path


def write_tiff(path, levels=LEVELS, **metadata):
    lines = "\n".join(f"{key} = {value}" for key, value in metadata.items())
    Image.fromarray(levels).save(path, description=lines, compression="raw")
    return path


def write_fits(path, levels=LEVELS, **metadata):
    from astropy.io import fits

    unit = fits.PrimaryHDU(levels)
    unit.header.update(metadata)
    unit.writeto(path)
    return path


def said(path):
    with pytest.raises(StudyError) as caught:
        read_picture(path, path.name)
    assert all(problem.file == path.name for problem in caught.value.problems)
    return "; ".join(problem.message for problem in caught.value.problems)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("write", [write_png, write_tiff, write_fits])
def test_formats_and_kinds_of_numbers(tmp_path, write, kind):
    if write is write_png and kind is np.float32:
        pytest.skip("PNG has no floating point")
    levels = (LEVELS % 251).astype(kind)
    metadata = {"FOCALPIX": 2650.5, "CAMERAY": -0.17, "OTHER": "text"}
    picture = read_picture(write(tmp_path / "image", levels, **metadata) if write is write_fits else
                           write(tmp_path / f"image.{write.__name__[6:]}", levels, **metadata), "image")  # fmt: skip
    np.testing.assert_array_equal(picture.levels, levels[::-1] if write is write_fits else levels)
    assert picture.metadata == {"FOCALPIX": 2650.5, "CAMERAY": -0.17}
    assert picture.top == {np.uint8: 255.0, np.uint16: 65535.0, np.float32: np.inf}[kind]
    assert not picture.levels.flags.writeable


@pytest.mark.parametrize("kind", ["<u2", ">u2", "<i4", "<f4", ">f8", "|u1"])
def test_npy(tmp_path, kind):
    np.save(tmp_path / "a.npy", np.asfortranarray(LEVELS % 200).astype(kind))
    picture = read_picture(tmp_path / "a.npy")
    np.testing.assert_array_equal(picture.levels, LEVELS % 200)
    assert picture.metadata == {}


def test_fits_from_the_top(tmp_path):
    picture = read_picture(write_fits(tmp_path / "a.fits", ROWORDER="TOP-DOWN"))
    np.testing.assert_array_equal(picture.levels, LEVELS)


def test_fits_in_an_extension_and_compressed(tmp_path):
    from astropy.io import fits

    levels = np.tile(LEVELS, (4, 4))
    fits.HDUList([fits.PrimaryHDU(), fits.ImageHDU(LEVELS)]).writeto(tmp_path / "a.fits")
    fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(levels)]).writeto(tmp_path / "b.fits")
    np.testing.assert_array_equal(read_picture(tmp_path / "a.fits").levels, LEVELS[::-1])
    np.testing.assert_array_equal(read_picture(tmp_path / "b.fits").levels, levels[::-1])


def test_fits_without_values_is_nan(tmp_path):
    from astropy.io import fits

    levels = LEVELS.astype(np.float64)
    levels[2, 3] = np.nan
    write_fits(tmp_path / "a.fits", levels)
    assert np.isnan(read_picture(tmp_path / "a.fits").levels[3, 3])
    scaled = fits.PrimaryHDU(LEVELS.astype(np.int16))
    scaled.header["BLANK"] = int(LEVELS[2, 3])
    scaled.header["BSCALE"] = 2.0
    scaled.writeto(tmp_path / "b.fits")
    picture = read_picture(tmp_path / "b.fits")
    assert np.isnan(picture.levels[3, 3])
    assert picture.levels[0, 0] == 2.0 * LEVELS[-1, 0]
    assert picture.top == 2.0 * 32767.0


def test_saturation_of_fewer_bits_than_the_file(tmp_path):
    full = LEVELS.copy()
    full[0, 0] = 4095
    assert read_picture(write_png(tmp_path / "a.png", full)).saturation == 4095.0
    assert read_picture(write_png(tmp_path / "b.png")).saturation == 65535.0
    assert read_picture(write_tiff(tmp_path / "c.tif", LEVELS.astype(np.float32))).saturation == np.inf


@pytest.mark.parametrize(
    ("mode", "words"),
    [("RGB", "colour image"), ("RGBA", "colour"), ("P", "palette"), ("LA", "transparency"), ("1", "black and white")],
)
def test_colours(tmp_path, mode, words):
    Image.fromarray((LEVELS % 256).astype(np.uint8)).convert(mode).save(tmp_path / "a.png")
    message = said(tmp_path / "a.png")
    assert words in message
    assert "save one channel" in message


def test_colours_of_arrays(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((20, 30, 3)))
    assert "colour image" in said(tmp_path / "a.npy")
    write_fits(tmp_path / "a.fits", np.zeros((3, 20, 30), np.float32))
    assert "colour image" in said(tmp_path / "a.fits")
    np.save(tmp_path / "b.npy", np.zeros((20, 30, 30)))
    assert "two axes" in said(tmp_path / "b.npy")


@pytest.mark.parametrize("write", [write_png, write_tiff, write_fits])
@pytest.mark.parametrize("part", [0.3, 0.6, 0.95])
def test_truncated(tmp_path, write, part):
    path = tmp_path / f"a.{write.__name__[6:]}"
    rough = np.random.default_rng(1).integers(0, 65535, (64, 64), np.uint16)
    data = write(path, rough).read_bytes()
    path.write_bytes(data[: int(part * len(data))])
    message = said(path)
    assert "truncated" in message or "damaged" in message
    assert "copy it again" in message


def test_npy_truncated_and_pickled(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, LEVELS)
    path.write_bytes(path.read_bytes()[:-10])
    assert "truncated" in said(path)
    path.write_bytes(b"\x93NUMPY\x01\x00\x10")
    assert said(path)
    np.save(path, np.array([{"a": 1}, None], object), allow_pickle=True)
    assert "never loaded" in said(path)
    path.write_bytes(pickle.dumps(LEVELS))
    assert "never loaded" in said(path)
    np.save(path, np.ones((6, 8), complex))
    assert "complex128" in said(path)
    np.save(path, np.full((6, 8), np.nan))
    assert "no pixel that is a number" in said(path)


def test_huge_sizes_in_a_header_take_no_memory(tmp_path):
    header = str({"descr": "<f8", "fortran_order": False, "shape": (10**9, 10**9)}).encode()
    header += b" " * (117 - len(header)) + b"\n"
    (tmp_path / "a.npy").write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header)
    assert "truncated" in said(tmp_path / "a.npy")

    for side in (6000, 20_000, 2**30):
        (tmp_path / "a.png").write_bytes(png(side, side, chunk(b"IDAT", zlib.compress(bytes(1000))), depth=16))
        assert f"{MAX_PIXELS:,}" in said(tmp_path / "a.png")

    for side, words in ((6000, f"{MAX_PIXELS:,}"), (10**9, "copy it again")):
        cards = ["SIMPLE  = T", "BITPIX  = 16", "NAXIS   = 2", f"NAXIS1  = {side}", f"NAXIS2  = {side}", "END"]
        text = "".join(card.replace("= ", f"= {'':<{20 - len(card.partition('= ')[2])}}").ljust(80) for card in cards)
        (tmp_path / "a.fits").write_bytes(text.encode().ljust(2880))
        assert words in said(tmp_path / "a.fits")


def test_damage_is_told_once(tmp_path, capfd, recwarn):
    """Neither Python's libraries nor compiled ones say anything besides."""
    path = tmp_path / "a.tif"
    Image.fromarray(np.tile(LEVELS, (8, 8))).save(path, compression="tiff_deflate")
    data = bytearray(path.read_bytes())
    data[20:60] = bytes(40)
    path.write_bytes(data)
    assert "its pixels cannot be read; copy it again" in said(path)
    np.save(tmp_path / "a.npy", LEVELS)
    (tmp_path / "a.npy").write_bytes((tmp_path / "a.npy").read_bytes().replace(b"(6, 8)", b"(6L,8)"))
    read_picture(tmp_path / "a.npy")  # of Python 2, of which NumPy warns
    assert not recwarn.list
    assert capfd.readouterr().err == ""


def test_no_images(tmp_path):
    for content, words in (
        (b"", "is empty"),
        (b"not an image at all", "is not an image"),
        (b"\xff\xd8\xff\xe0" + bytes(100), "JPEG"),
        (b"PK\x03\x04" + bytes(100), "archive"),
        (b"\x1f\x8b" + bytes(100), "gzip"),
        (b"\x89PNG\r\n\x1a\n" + bytes(100), "copy it again"),
        (b"II*\0" + bytes(3), "copy it again"),
        (b"SIMPLE  = T", "copy it again"),
    ):
        (tmp_path / "a").write_bytes(content)
        assert words in said(tmp_path / "a"), content
    assert "No such file" in said(tmp_path / "missing.png")
    assert "is a folder" in said(tmp_path)
    np.save(tmp_path / "thin.npy", np.ones((2, 500)))
    assert "least" in said(tmp_path / "thin.npy")


def test_tables_of_fits_are_no_images(tmp_path):
    from astropy.io import fits

    column = fits.Column(name="a", format="D", array=np.arange(5.0))
    fits.HDUList([fits.PrimaryHDU(), fits.BinTableHDU.from_columns([column])]).writeto(tmp_path / "a.fits")
    assert "holds no image" in said(tmp_path / "a.fits")


def test_damage_that_only_the_libraries_know(tmp_path):
    """What tokenize and compiled decompression raise."""
    from astropy.io import fits

    header = b"{'descr': " + b"(" * 64 + b"\n"
    (tmp_path / "a.npy").write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header)
    assert "its header is damaged" in said(tmp_path / "a.npy")
    rough = np.random.default_rng(1).integers(0, 255, (64, 64)).astype(np.int16)
    fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(rough)]).writeto(tmp_path / "a.fits")
    data = bytearray((tmp_path / "a.fits").read_bytes())
    with fits.open(tmp_path / "a.fits", disable_image_compression=True) as units:
        start = units[1].fileinfo()["datLoc"]
    data[start + 600 :] = b"\xff" * len(data[start + 600 :])
    (tmp_path / "a.fits").write_bytes(data)
    assert "damaged or truncated" in said(tmp_path / "a.fits")


def test_metadata_that_no_camera_has(tmp_path):
    message = said(write_png(tmp_path / "a.png", FOCALPIX=1e-9, ROLL=1e300, CENTREU=1e18, CAMERAY=-0.2))
    for words in ("FOCALPIX in the metadata", "between -360 and 360 deg, the turn", "CENTREU"):
        assert words in message
    assert "CAMERAY" not in message


def test_several_pages(tmp_path):
    pages = [Image.fromarray((LEVELS % 256).astype(np.uint8)) for _ in range(3)]
    pages[0].save(tmp_path / "a.tif", save_all=True, append_images=pages[1:])
    assert "holds more than one page" in said(tmp_path / "a.tif")


def test_metadata_that_are_no_numbers(tmp_path):
    message = said(write_png(tmp_path / "a.png", FOCALPIX="far", WHITE="nan", DISTANCE=-3, ROLL="1.5"))
    for words in ("FOCALPIX in the metadata must be between 10 and 1e+07", "WHITE", "DISTANCE", "'far'"):
        assert words in message
    assert "ROLL" not in message
    assert all(len(key) <= 8 for key in KEYS)  # as FITS wants


def test_a_file_is_read_again_when_it_changes(tmp_path):
    first = read_picture(write_png(tmp_path / "a.png"))
    assert read_picture(tmp_path / "a.png") is first
    second = read_picture(write_png(tmp_path / "a.png", np.tile(LEVELS + 1, (2, 2))))
    assert second.levels.shape == (12, 16)
