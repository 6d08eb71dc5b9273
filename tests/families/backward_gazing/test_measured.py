"""Mode measured: the shipped images give back what was planted; what else images can be is said."""

import numpy as np
import pytest

import heliosweep
from heliosweep.errors import StudyError
from heliosweep.families.backward_gazing.compute import remarks
from heliosweep.kernels.gazing.geometry import (
    camera_set,
    eroded,
    heliostat,
    maps,
    outline,
    pinholes,
    places_of,
    themis_8,
)
from heliosweep.kernels.gazing.slopes import module_estimates
from heliosweep.kernels.profiles import jose
from tests.conftest import STUDIES
from tests.families.backward_gazing import make_images as made

SHIPPED = STUDIES / "gazing_measured.yaml"
LM = {"slope_method": "LM", "referential": "exact"}


PROFILE = str(STUDIES / "images" / "sun_profile.csv")
#: In the study instead of the metadata.
GEOMETRY = {
    "heliostat": {"focal_length": 120, "distance": 120, "pixel": 0.05}, "target": {"azimuth": 0, "elevation": 44},
    "sun": {"azimuth": 30, "elevation": 60, "profile": PROFILE},
}  # fmt: skip


def content(folder, names=None, **blocks):
    """The shipped study with files of a folder; None removes a block."""
    names = [f"{folder / name}.png" for name in made.NAMES] if names is None else names
    study = {
        "family": "backward_gazing", "mode": "measured", "heliostat": {"focal_length": 120, "pixel": 0.05},
        "images": [str(name) for name in names], "sun": {"profile": PROFILE}, "sun_profile": "table",
        "method": ["LM"], "referential": ["exact"],
    }  # fmt: skip
    return {key: value for key, value in {**study, **blocks}.items() if value is not None}


def result_of(study):
    return heliosweep.build(heliosweep.load(study)).load()


def notes_of(study):
    return heliosweep.load(study).notes()


def problems_of(study):
    with pytest.raises(StudyError) as caught:
        heliosweep.plan(heliosweep.load(study))
    return "; ".join(map(str, caught.value.problems))


@pytest.fixture(scope="module")
def levels():
    return made.camera_levels()


@pytest.fixture(scope="module")
def truth():
    return made.planted()


@pytest.fixture(scope="module")
def shipped():
    return result_of(SHIPPED)


@pytest.fixture
def write(tmp_path, levels):
    """Write the four images, changed by a function of level and number, and say them as a study."""

    def files(change=lambda image, number: image, say=lambda said, number: said, **blocks):
        for number, name in enumerate(made.NAMES):
            said = say(made.metadata(number), number)
            made.write_png(tmp_path / f"{name}.png", change(levels[number].copy(), number), said)
        return content(tmp_path, **blocks)

    return files


def errors(result, truth, direction, where=LM):
    """Errors of used pixels, and their standard uncertainties. [mrad]"""
    axis = "xy".index(direction)
    found = result[f"slope_{direction}"].sel(where).to_numpy()
    error = found - 1e3 * maps(truth.grid, truth.slopes[axis])
    use = np.isfinite(error) & (result["mask"].to_numpy() == 3)
    return error[use], result[f"slope_uncertainty_{direction}"].to_numpy()[use]


@pytest.mark.parametrize("direction", ["x", "y"])
def test_shipped_slopes_are_those_planted(shipped, truth, direction):
    """Of the pixels that count 68 % lie within one standard uncertainty, 95 % within two."""
    error, uncertainty = errors(shipped, truth, direction)
    assert error.size > 0.9 * np.count_nonzero(shipped["mask"] > 1)
    ratio = error / uncertainty
    assert np.mean(np.abs(ratio) < 1.0) == pytest.approx(0.683, abs=0.02)
    assert np.mean(np.abs(ratio) < 2.0) == pytest.approx(0.954, abs=0.01)
    assert ratio.std() == pytest.approx(1.0, abs=0.04)
    assert 0.02 < np.sqrt(np.mean(uncertainty**2)) < 0.035  # mrad
    assert abs(error.mean()) < 0.003
    assert np.abs(error).max() < 0.2


def test_shipped_modules_are_those_planted(shipped, truth):
    """Canting, pointing and focal length within two standard errors, and far nearer: waviness makes most of these,
    and the images show it as it is."""
    true = module_estimates(truth.slopes, truth.grid, themis_8(), eroded(truth.grid, 2), 120.0)
    found = shipped.sel(LM)
    for axis, direction in enumerate("xy"):
        error = found[f"canting_{direction}"].to_numpy() - 1e3 * true["canting"][axis]
        stated = found[f"canting_{direction}_standard_error"].to_numpy()
        assert np.all(np.abs(error) < 2.0 * stated)
        assert np.all((stated > 0.005) & (stated < 0.025))
        assert np.abs(error).max() < 0.01  # what pointing is off by they share
        # Against the planted numbers themselves; the sphere of 119 m cants the modules too.
        centres = themis_8().centre[:, axis]
        planted = 1e3 * (made.CANTING[:, axis] + made.POINTING[axis] - centres * (1 / 238.0 - 1 / 240.0))
        whole = found[f"canting_{direction}"].to_numpy() + float(found[f"pointing_{direction}"])
        assert np.mean(np.abs(whole - planted) < 2.0 * stated) >= 7 / 8
        assert np.abs(whole - planted).max() < 0.05
        pointing = float(found[f"pointing_{direction}"]) - 1e3 * true["pointing"][axis]
        assert abs(pointing) < 2.0 * float(found[f"pointing_{direction}_standard_error"])
        assert float(found[f"pointing_{direction}"]) == pytest.approx(1e3 * made.POINTING[axis], abs=0.008)
        waves = found[f"waviness_{direction}"].to_numpy()
        np.testing.assert_allclose(waves, 1e3 * true["waviness"][axis], atol=0.008)
    focal, error = (float(found[f"focal_length_{name}"]) for name in ("estimate", "standard_error"))
    assert abs(focal - made.TRUE_FOCAL) < 2.0 * error < 1.0


def test_shipped_result_says_how_it_was_made(shipped):
    assert float(shipped["pixel_noise"]) == pytest.approx(made.NOISE, rel=0.03)
    assert shipped.attrs["white_levels"] == "metadata metadata metadata metadata"
    assert (shipped.attrs["rectification"], shipped.attrs["gain_of_each_pixel"]) == ("pinhole", "1")
    numbers = [float(shipped[name]) for name in ("sun_azimuth", "sun_world_azimuth", "distance")]
    assert numbers == [30.0, 150.0, 120.0]
    np.testing.assert_array_equal(shipped["white_level"], made.DARK + made.WHITE)
    assert np.all(shipped["lit_fraction"] > 0.97)
    assert np.all(shipped["saturated_fraction"] == 0.0)
    used = shipped["mask"].to_numpy() == 3
    assert np.mean(shipped["quality"].sel(slope_method="LM").to_numpy()[used] == 0) > 0.95
    residual = shipped["residual_rms"].sel(LM).to_numpy()[used]
    assert np.nanmean(residual**2) == pytest.approx(0.5 * 0.66 * made.NOISE**2, rel=0.2)  # 2 of 4 are free
    assert list(remarks(shipped)) == []


def test_corners_marked_in_images_put_these_on_the_mirror(tmp_path, levels, shipped):
    """Without metadata: geometry and levels in the study, corners of the heliostat in the images."""
    cameras = pinholes(made.layout(), made.SHAPE, made.FOCAL, roll=np.radians(made.ROLLS))
    marked, images = places_of(cameras, 120.0, outline(themis_8()).T), []
    for number, image in enumerate(levels):
        np.save(tmp_path / f"{number}.npy", image.astype(np.uint16))
        images.append({"file": str(tmp_path / f"{number}.npy"), "corners": np.round(marked[number].T, 2).tolist()})
    white = made.DARK + float(made.WHITE.mean())
    found = result_of(content(
        tmp_path, **GEOMETRY, images=images, fit_gain=True,
        image_geometry={"dark": made.DARK, "white": white, "saturation": 4095},
    ))  # fmt: skip
    assert found.attrs["rectification"] == "corners"
    # One white level for four sensors, whose own are up to 2 % apart: slopes are off by some tenths of a mrad.
    difference = (found["slope_x"].sel(LM) - shipped["slope_x"].sel(LM)).to_numpy()
    assert 0.01 < np.nanmedian(np.abs(difference)) < 0.5


ROLLS, SHIFTS = (12.0, -25.0, 7.0, -3.0), ((20.3, -10.7), (-30.1, 5.5), (11.0, 12.0), (0.5, -7.2))


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    """Files of images of cameras that are turned and look past the heliostat, and metadata that say all of it."""
    folder, shape, here = tmp_path_factory.mktemp("photographs"), (220, 260), made.layout()
    centre = np.array([[0.5 * (shape[1] - 1) + a, 0.5 * (shape[0] - 1) + b] for a, b in SHIFTS])
    cameras = pinholes(here, shape, made.FOCAL, centre, np.radians(ROLLS))
    mirror = heliostat(themis_8(), made.TRUE_FOCAL, made.CANTING, made.POINTING, made.fine_waves())
    seen = camera_set(here, cameras, shape, jose(), mirror, 4)
    gains = made.WHITE / made.WHITE[0] - 1.0
    taken = made.levels(seen, made.WHITE[0], made.NOISE, gains, 5)
    files, said = [], []
    for number, image in enumerate(taken):
        files.append(str(folder / f"{number}.npy"))
        np.save(files[-1], image.astype(np.uint16))
        place = {"CENTREU": centre[number, 0], "CENTREV": centre[number, 1], "ROLL": ROLLS[number]}
        said.append({**made.metadata(number), **{key: float(value) for key, value in place.items()}})
    return files, said


def test_photographs_are_registered_by_the_edges_of_the_modules(tmp_path, photographs, truth):
    """Shift, turn and scale within hundredths of a pixel; what that costs in slopes, against all of it known."""
    files, said = photographs
    unknown = ("FOCALPIX", "CENTREU", "CENTREV", "ROLL")
    results = []
    for known in (False, True):
        kept = [{key: value for key, value in one.items() if known or key not in unknown} for one in said]
        images = [{"file": file, "metadata": one} for file, one in zip(files, kept, strict=True)]
        results.append(result_of(content(tmp_path, images=images)))
    found, right = results
    assert found.attrs["rectification"] == "registered"
    assert right.attrs["rectification"] == "pinhole"
    np.testing.assert_allclose(found["registered_roll"], ROLLS, atol=0.01)
    np.testing.assert_allclose(found["registered_focal_length"], made.FOCAL, rtol=3e-4)
    centres = np.array([[one["CENTREU"], one["CENTREV"]] for one in said])
    away = np.stack((found["registered_column"], found["registered_row"]), axis=1) - centres
    assert np.abs(away).max() < 0.02
    assert found["registration_residual"].max() < 0.06
    assert np.isnan(right["registration_residual"]).all()
    for direction in "xy":
        assert float(abs(found[f"pointing_{direction}"] - right[f"pointing_{direction}"]).max()) < 0.0005
        assert float(abs(found[f"canting_{direction}"] - right[f"canting_{direction}"]).max()) < 0.001
        error, uncertainty = errors(found, truth, direction)
        assert np.mean(np.abs(error / uncertainty) < 2.0) > 0.93
    assert found["focal_length_estimate"].item() == pytest.approx(right["focal_length_estimate"].item(), abs=0.2)


def test_what_cannot_be_registered_is_said(tmp_path, photographs):
    files, said = photographs
    images = [{"file": file, "metadata": {**one}} for file, one in zip(files, said, strict=True)]
    rough = tmp_path / "rough.npy"
    np.save(rough, np.random.default_rng(0).integers(64, 3000, (220, 260)).astype(np.uint16))
    images[2] = {"file": str(rough), "metadata": {key: value for key, value in said[2].items() if key != "FOCALPIX"}}
    message = problems_of(content(tmp_path, images=images))
    assert "images[2]: the heliostat was not found in" in message
    assert "mark the 'corners', or give FOCALPIX" in message


def test_images_on_the_grid_of_the_mirror(tmp_path, truth):
    names = []
    for number, image in enumerate(maps(truth.grid, truth.images)):
        names.append(tmp_path / f"{number}.npy")
        np.save(names[-1], np.nan_to_num(image[::-1]))
    sunless = {**GEOMETRY, "sun": {"azimuth": 30, "elevation": 60}, "sun_profile": None}
    found = result_of(content(tmp_path, names, image_geometry={"white": 1.0}, **sunless))
    assert found.attrs["rectification"] == "none"
    for direction in "xy":
        error, _ = errors(found, truth, direction)
        assert np.percentile(np.abs(error), 99) < 1e-3  # a surface that is 1 mm off is seen from elsewhere
        assert error.size > 0.99 * np.count_nonzero(found["mask"] > 1)
    coarse = sunless | {"heliostat": {"distance": 120, "pixel": 0.1}}
    said = problems_of(content(tmp_path, names, image_geometry={"rectified": True}, **coarse))
    assert "145 x 147 pixels, but the mirror grid has 73 x 74 pixels" in said


def test_the_sun_may_be_an_image(write, truth):
    study = write(sun={"image": str(STUDIES / "images" / "sun.png")})
    assert any("lowest decreasing curve" in note for note in notes_of(study))
    error, uncertainty = errors(result_of(study), truth, "y")
    assert np.sqrt(np.mean(error**2)) < 1.1 * np.sqrt(np.mean(uncertainty**2))


def test_without_a_level_of_white_gains_are_fitted(write, truth):
    """The brightest pixels stand for white, the same for all cameras: right where these are alike."""

    def same(image, number):
        return np.rint(made.DARK + (image - made.DARK) * made.WHITE[0] / made.WHITE[number])

    result = result_of(write(same, lambda said, _: {key: said[key] for key in said if key != "WHITE"}))
    assert result.attrs["gain_of_each_pixel"] == "fitted"
    assert set(result.attrs["white_levels"].split()) == {"brightest_pixels"}
    error, uncertainty = errors(result, truth, "x")
    assert np.mean(np.abs(error / uncertainty) < 2.0) > 0.93
    assert any("a gain is fitted" in remark for remark in remarks(result))


def test_saturated_parts_are_masked_and_said(write, truth):
    def glare(image, number):
        if number == 1:
            image[60:100, 60:100] = 4095.0
        return image

    study = write(glare)
    assert any("upper_right.png" in note and "saturated" in note for note in notes_of(study))
    result = result_of(study)
    flagged = (result["quality"].sel(slope_method="LM").to_numpy() & 16) > 0
    assert 500 < flagged.sum() < 4000
    assert np.all(np.isnan(result["image"].to_numpy()[1][flagged]))
    error, uncertainty = errors(result, truth, "x")  # three cameras do
    assert np.mean(np.abs(error / uncertainty) < 2.0) > 0.93
    saturated = result["saturated_fraction"].to_numpy()
    assert saturated[1] > 0.02
    assert np.all(saturated[[0, 2, 3]] == 0.0)
    assert any("image 2" in remark and "saturated" in remark for remark in remarks(result))


def without(*keys, camera=None):
    """Metadata without keys, of one camera or of all."""
    return lambda said, n: {key: said[key] for key in said if camera not in (None, n) or key not in keys}


def level(value, camera):
    """Images of which some have another level."""
    return {"change": lambda image, n: value(image) if n in camera else image}


DIM, CUT = (lambda image: 64.0 + 0.1 * (image - 64.0)), (lambda image: image[:-4])
BOTH = {"image": str(STUDIES / "images" / "sun.png"), "profile": PROFILE}


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (level(DIM, (2, 3)), "are dark"),
        (level(lambda image: np.full_like(image, 64.0), (1,)), "same level everywhere"),
        (level(lambda image: np.where(image > 1000.0, 4095.0, image), (3,)), "are saturated"),
        (level(CUT, (2,)), "176 x 172 pixels, but the others have 176 x 176"),
        (level(CUT, (0,)), "images[0]: "),  # the odd one
        ({"say": without("SUNAZ")}, "SUNAZ"),
        ({"say": without("FOCALPIX", camera=1), "image_geometry": {"registration": False}},
         "mark the 'corners', give FOCALPIX"),
        ({"say": lambda said, n: {**said, "SUNEL": 60.0 + n}}, "in another image"),
        ({"say": without("CAMERAY", camera=0)}, "for only 3 of 4 images"),
        ({"say": lambda said, n: {**said, "CAMERAZ": 0.0, "CAMERAY": 0.1 * n}}, "collinear"),
        ({"sun": BOTH}, "both give the sun's profile"),
        ({"say": lambda said, _: {**said, "WHITE": 50.0}}, "is not above the dark level"),
        *(({"say": lambda said, _, key=key, value=value: {**said, key: value}}, words) for key, value, words in (
            ("SUNEL", 95.0, ": images[0]: SUNEL in the metadata must be greater than 0 and at most 90 deg"),
            ("TARGETEL", 90.0, "must be greater than -90 and less than 90 deg"),
            ("DISTANCE", 1.0, "must be more than 5.16 m, the reach of the heliostat (got 1)"),
            ("FOCALPIX", 1e-9, "must be between 10 and 1e+07"),
        )),
    ],
)  # fmt: skip
def test_images_and_metadata_that_cannot_be_used(write, keys, words):
    assert words in problems_of(write(**keys))


def test_study_and_metadata_that_disagree_are_said_and_the_study_is_used(write):
    target, sun = {"azimuth": 360.0, "elevation": 44.0}, {"azimuth": 160.0, "profile": PROFILE}
    study = write(sun=sun, target=target, heliostat={"focal_length": 120, "distance": 121, "pixel": 0.1})
    assert notes_of(study) == [
        "sun.azimuth is 160 in the study, but SUNAZ is 30 in the metadata of images: the study is used",
        "heliostat.distance is 121 in the study, but DISTANCE is 120 in the metadata of images: the study is used",
    ]
    assert float(result_of(study | {"sun": {"profile": PROFILE}})["distance"]) == 121.0


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        ([[10, 10], [60, 10], [110, 10], [160, 10]], "nearly collinear"),
        ([[10, 10], [150, 150], [150, 10], [10, 150]], "are not in clockwise order"),
        ([[1000, 1000], [1100, 1000], [1100, 1100], [1000, 1100]], "4 of 4 corners are outside"),
        ([[10, 10], [12, 10], [12, 12], [10, 12]], "enclose 4 pixels, which are too few to estimate slopes"),
    ],
)
def test_corners_that_are_none_of_a_heliostat(write, corners, words):
    study = write()
    study["images"][1] = {"file": study["images"][1], "corners": corners}
    said = problems_of(study)
    assert words in said
    assert "images[1].corners" in said


def test_metadata_of_the_study_count_before_those_of_files(tmp_path, levels, shipped):
    """NPY files have none; a PNG with a wrong one is corrected."""
    images = []
    for number, image in enumerate(levels):
        path = tmp_path / f"{number}.npy"
        np.save(path, image.astype(np.uint16))
        images.append({"file": str(path), "metadata": made.metadata(number)})
    found = result_of(content(tmp_path, images=images))
    np.testing.assert_array_equal(found["slope_x"].sel(LM), shipped["slope_x"].sel(LM))
    for wrong, words in (
        ({**made.metadata(1), "SUNEL": "95 deg"}, "images[1].metadata.SUNEL: must be greater than 0 and at most 90"),
        ({"FOCALPIXEL": 2000}, "FOCALPIX"),
    ):
        images[1]["metadata"] = wrong
        assert words in problems_of(content(tmp_path, images=images))


def test_noise_that_the_study_states(write):
    result = result_of(write(image_geometry={"noise": 0.001}))
    assert float(result["pixel_noise"]) == 0.001
    assert any("much larger than the noise in the study" in remark for remark in remarks(result))


def test_parameters_may_be_swept(write):
    study = heliosweep.load(write(cameras={"threshold": [0.3, 0.9]}, profile_error=[0.0, 0.01]))
    planned = heliosweep.plan(study)
    assert planned.workload.sizes["threshold"] == 2
    result = heliosweep.build(study).load()
    whole, bright = result["usable_fraction"].mean(["slope_method", "module", "profile_error"]).to_numpy()
    assert bright < whole
    # Each 1 % of profile error costs some percent of slope.
    right, wrong = (
        result["canting_y"].sel({**LM, "threshold": 0.3, "module": 2}).isel(profile_error=k).item() for k in (0, 1)
    )
    assert 0.005 < abs(wrong - right) < 0.08
    assert "has no effect" in problems_of(write(cameras={"noise": [0.0, 0.1]}))
    assert "cannot be swept" in problems_of(write(heliostat={"focal_length": 120, "pixel": [0.05, 0.1]}))
