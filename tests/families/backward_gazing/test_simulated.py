"""Simulated heliostats: from the study file to the numbers, whatever the sweep, the chunks and the scheduler."""

from typing import Any

import numpy as np
import pytest

from heliosweep import api
from heliosweep.errors import StudyError
from heliosweep.families.backward_gazing import compute
from heliosweep.families.backward_gazing.variables import NOT_SEEN, SEEN
from heliosweep.kernels.gazing import geometry as g
from heliosweep.kernels.gazing.slopes import fit_slopes
from heliosweep.kernels.profiles import jose, normal_draws, render
from tests.families import studies

from .test_study import study


def computed(**blocks: Any) -> Any:
    return studies.computed(study(**blocks))


def test_results_are_those_of_the_kernels():
    result = computed(cameras={"noise": 0.004, "bits": 12, "seed": 5}, method="LM", output={"maps": True})
    layout = g.scene((np.radians(30), np.radians(60)), (0.0, np.radians(44)), g.camera_square(0.24))
    mirror = g.mirror_grid(g.themis_8(), 0.3)
    canting = np.zeros((8, 2))
    canting[1:3, 1] = -1e-3, 1e-3
    found = []
    for defects, noise in ((canting, 0.004), (0 * canting, 0.0)):
        images, true = g.image_set(layout, mirror, jose(), g.module_spheres(g.themis_8(), 120.0, defects))
        images = g.expose(images, noise, 12 if noise else 0, 5) if noise else images
        fit = fit_slopes("LM", layout, jose(), images, np.zeros(mirror.pixels.shape), mirror.pixels)
        found.append((fit.slopes, true, images))
    net = found[0][0] - found[1][0]
    error = 1e3 * (net - found[0][1] + found[1][1])
    keep = g.eroded(mirror, 1)
    for axis, name in enumerate("xy"):
        for module in (1, 2, 8):
            here = keep & (mirror.pixel_module == module - 1)
            one = result.isel({"slope_method": 0, "referential": 2}).sel(module=module)
            assert float(one[f"slope_bias_{name}"]) == pytest.approx(error[axis, here].mean(), abs=1e-8)
            assert float(one[f"slope_rms_{name}"]) == pytest.approx(np.sqrt(np.mean(error[axis, here] ** 2)), abs=1e-8)
            assert float(one[f"relative_error_{name}"]) == pytest.approx(100 * abs(error[axis, here].mean()), abs=1e-6)
        slopes = result[f"slope_{name}"].isel({"slope_method": 0, "referential": 0}).to_numpy()
        np.testing.assert_allclose(slopes.ravel()[mirror.place], 1e3 * net[axis], atol=1e-6)
    np.testing.assert_array_equal(result["image"].to_numpy().reshape(4, -1)[:, mirror.place], found[0][2])
    assert np.isnan(result["image"].to_numpy().reshape(4, -1)[:, mirror.module.ravel() == 0]).all()


def test_undefected_heliostat():
    """Fewer than 1e-7 mrad, clean; what noise leaves of a perfect mirror is subtracted too."""
    result = computed(defects=None, sun_profile=["jose", "noisy"])
    assert float(np.abs(result["slope_rms_x"]).max()) < 1e-12
    assert float(np.abs(result["canting_y"]).max()) < 1e-12
    assert (result["scene_status"] == SEEN).all()
    assert result["incidence"].to_numpy() == pytest.approx(scene_incidence())


def scene_incidence() -> float:
    layout = g.scene((np.radians(30), np.radians(60)), (0.0, np.radians(44)), g.camera_square(0.24))
    return float(np.degrees(layout.incidence))


def test_pointing_and_focal_length_come_back():
    defects = {"pointing": [0.2, -0.3], "focal_length": [119, 120], "canting": {"2": [0, -0.5]}}
    result = computed(defects=defects, method="LM").isel({"slope_method": 0, "referential": 0})
    for focal, near in ((119, 2e-3), (120, 1e-3)):
        one = result.sel(true_focal_length=focal)
        pointing = [float(one[f"pointing_{axis}"]) for axis in "xy"]
        assert pointing == pytest.approx([0.2, -0.3], abs=near)  # against the heliostat's own sphere
    assert float(result.sel(true_focal_length=119)["focal_length_estimate"]) == pytest.approx(119, rel=1e-3)
    assert float(one["canting_y"].sel(module=2)) == pytest.approx(-0.5, abs=1e-3)
    assert float(np.abs(one["canting_y"].drop_sel(module=2)).max()) < 1e-3


def test_fourier_processing_adds_error_along_y_and_no_contamination_of_x():
    """The 15 % on X of the paper's A and O1 are the field rotation's, whatever puts the images on the mirror."""
    result = computed(
        heliostat={"distance": 120, "pixel": 0.1}, cameras={"images": ["mirror_grid", "fourier"]}, method="A",
        referential=["none", "exact"], erosion=1,
    )  # fmt: skip
    x, y = (result[f"relative_error_{axis}"].squeeze().sel(module=[2, 3]).mean("module") for axis in "xy")
    assert float(abs(x.sel(referential="none") - 14.3).max()) < 0.6
    assert float(x.sel(referential="exact").max()) < 0.6
    added = y.sel(image_level="fourier") - y.sel(image_level="mirror_grid")
    assert 2.0 < float(added.min()) < float(added.max()) < 4.0


def test_seeds_matter_only_where_something_is_random():
    blocks = {"sun_profile": ["jose", "noisy"], "profile_noise": {"seed": [0, 1, 2]}, "method": ["A", "O2"]}
    result = computed(**blocks)
    clean, noisy = (result["relative_error_y"].sel(sun_profile=name, module=2) for name in ("jose", "noisy"))
    assert (clean == clean.isel(profile_seed=0)).all()
    assert float(noisy.std("profile_seed").min()) > 0.1
    for ending, percent in (("median", 50), ("low", 5), ("high", 95)):
        values = result["relative_error_y"].quantile(0.01 * percent, "profile_seed")
        np.testing.assert_allclose(result[f"relative_error_y_{ending}"], values, rtol=1e-12)
    alone = computed(**blocks | {"sun_profile": "noisy", "profile_noise": {"seed": 2}})
    assert "relative_error_y_median" not in alone
    assert (alone["relative_error_y"] == result.sel(sun_profile="noisy", profile_seed=2)["relative_error_y"]).all()


def test_heliostat_that_no_camera_sees_is_masked_and_said_so():
    one = study(defects={"pointing": [8, 0]}, output={"maps": True})
    result = api.build(one).compute()
    assert int(result["scene_status"]) == NOT_SEEN
    assert np.isnan(result["slope_x"]).all()
    assert set(np.unique(result["mask"])) == {0, 1, 2}
    assert float(result["usable_fraction"].max()) == 0.0
    assert float(result["lit_cameras"].max()) == 0.0
    (said,) = compute.remarks(result)
    assert said.startswith("no slopes for the heliostat: all pixels are masked")


def test_modules_of_the_study():
    modules = [{"centre": [-1, 0], "size": [1.9, 1.9]}, {"centre": [1, 0], "size": [1.9, 1.9]}]
    result = computed(
        heliostat={"distance": 100, "modules": modules, "pixel": 0.2}, defects={"canting": {"2": [0.4, 0]}}, method="LM"
    )
    assert result.sizes["module"] == 2
    assert result["module_y"].values.tolist() == [-1, 1]
    assert float(result["relative_error_x"].max()) < 0.02
    assert float(result["distance"]) == 100


def test_profile_of_lm():
    """Simulations take the table unless asked otherwise, which changes LM alone; both results say it."""
    noisy = {"sun_profile": "noisy", "method": ["A", "LM"], "erosion": 0}
    table, same, smooth = (computed(**noisy, fit_profile=kind) for kind in (None, "table", "smooth"))
    assert table.drop_attrs(deep=False).identical(same.drop_attrs(deep=False))  # but for the study's id
    assert table.attrs["profile_of_lm"] == "as it is"
    assert smooth.attrs["profile_of_lm"] == "smooth fit"
    for method, equal in (("A", True), ("LM", False)):
        one, other = (result["slope_bias_y"].sel(slope_method=method).to_numpy() for result in (table, smooth))
        assert np.array_equal(one, other) == equal


@pytest.mark.parametrize("level", ["mirror_grid", pytest.param("camera", marks=pytest.mark.long)])
def test_levels_of_cameras(level):
    """Each camera has a level of its own, drawn by the seed: the same at both kinds of images, whatever is swept."""

    def seen(**cameras):
        more = {"defects": {}, "method": "LM", "erosion": 3, "heliostat": {"distance": 120, "pixel": 0.15}}
        return computed(cameras={"images": level, **cameras}, output={"maps": True}, **more)

    swept, plain = seen(gain_noise=[0.0, 0.01, 0.02], seed=[0, 1]), seen()
    gains = (swept["image"] / plain["image"]).median(("y", "z"))
    assert np.all(gains.sel(camera_gain_noise=0.0) == 1.0)
    drawn = 1.0 + 0.02 * normal_draws(1, 4, 4)
    np.testing.assert_allclose(gains.sel(camera_gain_noise=0.02, camera_seed=1), drawn, rtol=1e-12)
    both, alone = (
        seen(gain_noise=0.02, seed=1, gain_error=0.05),
        swept["image"].sel(camera_gain_noise=0.02, camera_seed=1),
    )
    np.testing.assert_allclose(both["image"], 1.05 * alone, rtol=1e-12)
    one, two = (swept["pointing_x"].squeeze().sel(camera_gain_noise=noise) for noise in (0.01, 0.02))
    np.testing.assert_allclose(two, 2.0 * one, rtol=0.2)
    assert np.all((np.abs(one) > 0.01) & (np.abs(one) < 0.3))  # 0.09 mrad for 1 %


def test_curvature_of_modules_comes_back():
    """Two principal focal lengths and their axis, within their standard errors; what is no sphere is said."""
    blocks = {
        "heliostat": {"distance": 120, "pixel": 0.15}, "method": "LM", "referential": "exact",
        "defects": {"curvature": {"3": [125, 115, 20], "6": [110, 110, 0]}, "canting": {"3": [0, 0.5]}},
    }  # fmt: skip
    noisy = computed(**blocks, cameras={"noise": 0.004, "seed": {"start": 0, "stop": 19, "step": 1}})
    for name, planted in (("focal_length_long", 125), ("focal_length_short", 115), ("focal_axis", 20)):
        values = noisy[name].sel(module=3).squeeze(drop=True)
        error = float(noisy[f"{name}_standard_error"].sel(module=3).mean())
        assert float(values.mean()) == pytest.approx(planted, abs=0.01 * planted)
        assert float(values.std()) == pytest.approx(error, rel=0.4)  # of 20 seeds
    assert noisy["focal_length_long"].sel(module=6).to_numpy() == pytest.approx(110, abs=0.6)
    assert noisy["focal_length_long"].sel(module=1).to_numpy() == pytest.approx(120, abs=0.6)
    (said,) = (one for one in compute.remarks(noisy) if "spherical" in one)
    assert said.startswith("not spherical: module 3; module 3 has focal lengths of 12")
    seen = computed(**blocks, cameras={"images": "camera"}).sel(module=3).squeeze()
    found = [float(seen[name]) for name in ("focal_length_long", "focal_length_short", "focal_axis")]
    assert found == pytest.approx([125, 115, 20], rel=3e-3)


def test_a_focal_length_that_is_not_the_ideal_one_is_said():
    result = computed(defects={"focal_length": 126}, method="LM", referential="exact")
    assert any("estimated focal length is 126" in one for one in compute.remarks(result))
    assert not list(compute.remarks(computed(method="LM")))


def test_formula_of_the_sun():
    """A, xi and eps_max of the study make the images and are found again by the fit; the defaults are the paper's."""
    keys = {"limb_brightness": 0.5, "limb_exponent": 2.0, "angular_radius": [4.36, 4.65]}
    result = computed(sun={"azimuth": 30, "elevation": 60, **keys}, method="LM", output={"maps": True})
    assert result["angular_radius"].to_numpy().tolist() == [4.36, 4.65]
    for name, planted in (("sun_limb_fit", 0.5), ("sun_exponent_fit", 2.0), ("sun_radius_fit", [4.36, 4.65])):
        assert result[name].to_numpy() == pytest.approx(np.broadcast_to(planted, 2), rel=1e-5)
    wide = jose(0.5, 4.65e-3, 2.0)
    np.testing.assert_allclose(
        result["sun_brightness"].isel(angular_radius=1), render(wide, np.linspace(0.0, 4.65e-3, 101)), rtol=1e-12
    )
    assert float(result["slope_rms_x"].max()) < 1e-3  # the same sun makes the images and finds the slopes
    usual = computed(sun={"azimuth": 30, "elevation": 60, "limb_brightness": 0.679}, method="LM")
    np.testing.assert_array_equal(usual["slope_bias_x"], computed(method="LM")["slope_bias_x"])
    noisy = computed(sun_profile="noisy", method="LM", output={"maps": True})
    assert float(noisy["sun_fit_rms"]) == pytest.approx(0.012, rel=0.15)
    assert float(noisy["sun_limb_fit"]) == pytest.approx(0.679, abs=0.02)


def test_raw_slopes_and_evaluations():
    result = computed(output={"maps": True, "raw_slopes": True})
    np.testing.assert_allclose(result["slope_x"], result["raw_slope_x"] - result["raw_ideal_slope_x"], atol=1e-15)
    spent = dict(zip(result["slope_method"].to_numpy(), result["evaluations"].to_numpy(), strict=True))
    assert spent["A"] == 0.0 < spent["LM"] < 10.0 < spent["O2"] < 100.0
    with pytest.raises(StudyError, match=r"needs output\.maps"):
        study(output={"raw_slopes": True})
