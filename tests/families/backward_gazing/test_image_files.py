"""Image files: what is read, and what is said of files that cannot be."""

import numpy as np
import pytest
from PIL import Image, PngImagePlugin

from heliosweep.errors import StudyError
from heliosweep.families.backward_gazing.images import KEYS, MAX_PIXELS, read_picture

LEVELS = (np.arange(48).reshape(6, 8) * 53).astype(np.uint16)


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
    assert picture.saturation == {np.uint8: 255.0, np.uint16: 65535.0, np.float32: np.inf}[kind]


@pytest.mark.parametrize("kind", ["<u2", ">u2", "<i4", "<f4", ">f8", "|u1"])
def test_npy(tmp_path, kind):
    np.save(tmp_path / "a.npy", np.asfortranarray(LEVELS % 200).astype(kind))
    picture = read_picture(tmp_path / "a.npy", "image")
    np.testing.assert_array_equal(picture.levels, LEVELS % 200)
    assert picture.metadata == {}


def test_fits_from_the_top(tmp_path):
    picture = read_picture(write_fits(tmp_path / "a.fits", ROWORDER="TOP-DOWN"), "image")
    np.testing.assert_array_equal(picture.levels, LEVELS)


def test_fits_in_an_extension_and_compressed(tmp_path):
    from astropy.io import fits

    levels = np.tile(LEVELS, (4, 4))
    fits.HDUList([fits.PrimaryHDU(), fits.ImageHDU(LEVELS)]).writeto(tmp_path / "a.fits")
    fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(levels)]).writeto(tmp_path / "b.fits")
    np.testing.assert_array_equal(read_picture(tmp_path / "a.fits", "image").levels, LEVELS[::-1])
    np.testing.assert_array_equal(read_picture(tmp_path / "b.fits", "image").levels, levels[::-1])


def test_saturation_of_fewer_bits_than_the_file(tmp_path):
    full = LEVELS.copy()
    full[0, 0] = 4095
    assert read_picture(write_png(tmp_path / "a.png", full), "image").saturation == 4095.0
    assert read_picture(write_png(tmp_path / "b.png"), "image").saturation == 65535.0
    assert read_picture(write_tiff(tmp_path / "c.tif", LEVELS.astype(np.float32)), "image").saturation == np.inf


def test_metadata_that_are_no_numbers(tmp_path):
    message = said(write_png(tmp_path / "a.png", FOCALPIX="far", WHITE="nan", DISTANCE=-3, ROLL="1.5"))
    for words in ("FOCALPIX in the metadata must be between 10 and 1e+07", "WHITE", "DISTANCE", "'far'"):
        assert words in message
    assert "ROLL" not in message
    assert all(len(key) <= 8 for key in KEYS)  # as FITS wants


def test_damaged_files(tmp_path):
    for write, name in ((write_png, "a.png"), (write_tiff, "a.tif"), (write_fits, "a.fits")):
        rough = np.random.default_rng(1).integers(0, 65535, (64, 64), np.uint16)
        data = write(tmp_path / name, rough).read_bytes()
        (tmp_path / name).write_bytes(data[: len(data) // 2])
        assert "cannot be read as a grey image" in said(tmp_path / name)
    np.save(tmp_path / "a.npy", np.array([{"a": 1}, None], object), allow_pickle=True)
    assert "allow_pickle" in said(tmp_path / "a.npy")
    assert "No such file" in said(tmp_path / "missing.png")
    (tmp_path / "b.png").write_bytes(b"not an image at all")
    assert "cannot identify" in said(tmp_path / "b.png")


@pytest.mark.parametrize("mode", ["RGB", "P", "LA", "1"])
def test_only_grey_images_are_read(tmp_path, mode):
    Image.fromarray((LEVELS % 256).astype(np.uint8)).convert(mode).save(tmp_path / "a.png")
    assert "cannot be read as a grey image" in said(tmp_path / "a.png")


def test_sizes_and_kinds(tmp_path):
    for array, words in (
        (np.zeros((20, 30, 3)), "it has 3 axes of float64"),
        (np.ones((6, 8), complex), "complex128"),
        (np.full((6, 8), np.nan), "no pixel is a valid number"),
        (np.ones((2, 500)), "but must have at least 4 on each side"),
        (np.zeros((5001, 5000), np.uint8), f"at most {MAX_PIXELS:,}"),
    ):
        np.save(tmp_path / "a.npy", array)
        assert words in said(tmp_path / "a.npy")
    pages = [Image.fromarray((LEVELS % 256).astype(np.uint8)) for _ in range(3)]
    pages[0].save(tmp_path / "a.tif", save_all=True, append_images=pages[1:])
    assert "several pages" in said(tmp_path / "a.tif")
