"""Image files: what is read, and what is said of files that cannot be."""

import numpy as np
import pytest
from PIL import Image, PngImagePlugin

from heliosweep.errors import StudyError
from heliosweep.families.backward_gazing.images import MAX_PIXELS, METADATA, read_picture, register
from heliosweep.kernels.gazing.geometry import camera_set, expose, heliostat, outline, pinholes, places_of, themis_8
from heliosweep.kernels.profiles import jose
from tests.families.backward_gazing import make_images as made

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


@pytest.mark.parametrize("kind", ["<u2", ">f8", "|u1"])
def test_npy(tmp_path, kind):
    np.save(tmp_path / "a.npy", np.asfortranarray(LEVELS % 200).astype(kind))
    picture = read_picture(tmp_path / "a.npy", "image")
    np.testing.assert_array_equal(picture.levels, LEVELS % 200)
    assert picture.metadata == {}


def test_fits_in_an_extension_and_compressed(tmp_path):
    from astropy.io import fits

    levels = np.tile(LEVELS, (4, 4))
    fits.HDUList([fits.PrimaryHDU(), fits.ImageHDU(LEVELS)]).writeto(tmp_path / "a.fits")
    fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(levels)]).writeto(tmp_path / "b.fits")
    np.testing.assert_array_equal(read_picture(tmp_path / "a.fits", "image").levels, LEVELS[::-1])
    np.testing.assert_array_equal(read_picture(tmp_path / "b.fits", "image").levels, levels[::-1])
    top = write_fits(tmp_path / "c.fits", ROWORDER="TOP-DOWN")
    np.testing.assert_array_equal(read_picture(top, "image").levels, LEVELS)


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
    assert all(len(key) <= 8 for key in METADATA)  # as FITS wants


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


def test_sizes_and_kinds(tmp_path):
    for array, words in (
        (np.zeros((20, 30, 3)), "it has 3 dimensions of float64"),
        (np.ones((6, 8), complex), "complex128"),
        (np.full((6, 8), np.nan), "no pixel is a valid number"),
        (np.ones((2, 500)), "but must have at least 4 on each side"),
        (np.zeros((5001, 5000), np.uint8), f"at most {MAX_PIXELS:,}"),
    ):
        np.save(tmp_path / "a.npy", array)
        assert words in said(tmp_path / "a.npy")
    for mode in ("RGB", "P", "LA", "1"):
        Image.fromarray((LEVELS % 256).astype(np.uint8)).convert(mode).save(tmp_path / "a.png")
        assert "cannot be read as a grey image" in said(tmp_path / "a.png")
    pages = [Image.fromarray((LEVELS % 256).astype(np.uint8)) for _ in range(3)]
    pages[0].save(tmp_path / "a.tif", save_all=True, append_images=pages[1:])
    assert "several pages" in said(tmp_path / "a.tif")


def upright(points):
    camera = pinholes(made.layout(), (100, 100), 1000.0)
    return places_of(camera, 120.0, points)[0]


def taken(shape, focal, roll, shift, noise, canting):
    """Image of the first camera, and where it shows the corners of the heliostat."""
    here, ends = made.layout(), outline(themis_8())
    centre = 0.5 * (np.array(shape[::-1]) - 1.0) + shift
    cameras = pinholes(here, shape, focal, centre, np.radians(roll))
    one = here._replace(eyes=here.eyes[:1], cameras=here.cameras[:1], gaze=here.gaze[:1])
    first = cameras._replace(eyes=cameras.eyes[:1], axes=cameras.axes[:1], focal=cameras.focal[:1])
    seen = camera_set(one, first, shape, jose(), heliostat(themis_8(), 120.0, canting), 4)
    image = expose(seen, noise=noise, bits=12, seed=3, pinhole=True)[0]
    return image, places_of(cameras, 120.0, ends.T)[0].T, centre


@pytest.mark.parametrize(
    ("shape", "focal", "roll", "shift", "noise", "most"),
    [
        ((176, 176), 2350.0, 0.0, (0.0, 0.0), 0.0, 0.01),
        ((220, 260), 2350.0, -25.0, (-30.1, 5.5), 0.004, 0.03),
        ((300, 400), 3300.0, 38.0, (20.3, -10.7), 0.01, 0.05),
    ],
)
def test_corners_come_back(shape, focal, roll, shift, noise, most):
    image, corners, centre = taken(shape, focal, roll, shift, noise, made.CANTING)
    found, turn, scale, middle, _ = register(image, upright, themis_8())
    assert np.abs(found - corners).max() < most
    assert np.degrees(turn) == pytest.approx(-roll, abs=0.02)
    assert scale == pytest.approx(focal / 1000.0, rel=5e-4)
    assert middle == pytest.approx(centre, abs=0.5 * most)


def test_dark_modules_and_dirt_do_no_harm():
    canting = made.CANTING.copy()
    canting[[0, 6]] = 0.006  # these send the sun elsewhere
    image, corners, _ = taken((220, 260), 2350.0, 10.0, (5.0, -8.0), 0.004, canting)
    image[100:104, :] *= 0.7
    image[30, 200], image[31:33, 40] = 1.2, np.nan
    found = register(image, upright, themis_8())[0]
    away = np.abs(found - corners)
    assert away.max() < 0.2  # at the corner of a dark module
    assert away[1:].max() < 0.05


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.zeros((60, 80)), "it has no lit pixel"),
        (np.full((60, 80), np.nan), "it has no lit pixel"),
        (np.ones((120, 120)), "up to the edge of the image"),
        (np.pad(np.ones((60, 60)), 40), "stretched by 3 %"),
    ],
)
def test_images_of_something_else(image, words):
    with pytest.raises(ValueError, match=words):
        register(image, upright, themis_8())


@pytest.mark.parametrize(
    ("roll", "shift", "words"),
    [(90.0, (0.0, 0.0), "stretched by 6 %"), (0.0, (90.0, 0.0), "up to the edge of the image")],
)
def test_a_heliostat_on_its_side_or_cut_by_the_frame_is_refused(roll, shift, words):
    image, _, _ = taken((220, 260), 2350.0, roll, shift, 0.004, made.CANTING)
    with pytest.raises(ValueError, match=words):
        register(image, upright, themis_8())
