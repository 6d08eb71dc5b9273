"""Figures of the family `backward_gazing`: which there are, on which axes, with which words, whatever was swept."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from heliosweep.families.backward_gazing.figures import MOST_FIGURES, figures
from heliosweep.report.comparison import Comparison, told
from tests.families.backward_gazing import report_results as results
from tests.families.gallery import Gallery, nothing

pytestmark = pytest.mark.usefixtures("unplaced")

PROFILES = {"sun_profile": ["jose", "noisy"]}
SUNS = {"sun_azimuth": [60.0, 0.0, 30.0]}
NOISES = {"camera_noise": [0.001, 0.01, 0.1]}
SEEDS = {"profile_seed": np.arange(5)}
MAPS = {"maps": True}


def published(dataset, end=""):
    """The same with numbers that were published."""
    places = {"slope_method": "A", "module": "2", "sun_profile": "noisy", "referential": "none"}
    one = Comparison(f"relative_error_x{end}", places, 13.0, 14.6, 1.0, "percent", 1)
    return told(dataset, [one])


def shuffled(dataset):
    """The same with every dimension's order turned around."""
    return dataset.isel({dim: slice(None, None, -1) for dim in dataset.dims})


def measured(**others):
    """Result of the mode `measured`, of which some pixels are not lit."""
    dataset = results.measured(**others)
    unlit = (dataset["y"] > 2) & (dataset["mask"] > 0)
    dataset["mask"] = xr.where(unlit, 2, dataset["mask"]).astype(np.int8)
    return dataset


def zipped():
    """Azimuth and elevation of the sun tied together."""
    dataset = results.result({**SUNS, **SEEDS}).drop_vars("sun_elevation")
    return dataset.assign_coords(sun_elevation=("sun_azimuth", [40.0, 50.0, 60.0]))


CASES = {
    "maps": lambda: results.result(PROFILES, output=MAPS),
    "raw slopes": lambda: results.result(output={"maps": True, "raw_slopes": True}),
    "maps of seeds": lambda: results.result({**PROFILES, **SEEDS}, methods=["A", "LM"], output=MAPS),
    "one module, one method": lambda: results.result(methods=["LM"], referentials=["none"], output=MAPS, modules=1),
    "one method over suns": lambda: results.result(SUNS, methods=["A"], referentials=["exact"]),
    "table": lambda: published(results.result({**PROFILES, **SEEDS}), "_median"),
    "table of one profile": lambda: published(results.result()),
    "suns": lambda: results.result({**PROFILES, **SUNS}),
    "suns, shuffled": lambda: shuffled(results.result({**SUNS, **SEEDS}, methods=["A"], modules=3, output=MAPS)),
    "noises": lambda: results.result({**NOISES, "camera_seed": np.arange(3)}, methods=["A", "LM"]),
    "two numbers": lambda: results.result(
        {**NOISES, "camera_radius": [0.1, 0.2], "arrangement": ["square", "cross"]}, methods=["A", "LM"], modules=2
    ),
    "tied": zipped,
    "many modules": lambda: results.result({**PROFILES, **SEEDS}, canting={}),
    "bare": lambda: results.result(methods=["A", "LM"], modules=2, output=MAPS).drop_vars(
        ["module", "slope_method", "referential", "module_y", "camera"]
    ),
    "nothing": lambda: nothing(results.result({**PROFILES, **SUNS, **SEEDS}, output=MAPS)),
    "measured": measured,
    "measured by one method": lambda: measured(methods=["LM"], referentials=["exact"]),
    "measured, nothing": lambda: nothing(measured()),
    "field": results.field,
    "field at one hour": lambda: results.field(hours=(12,), count=1),
    "field over latitudes": lambda: results.field(count=30, sweep={"latitude": [10.0, 37.4, 50.0]}),
    "field without slopes": lambda: nothing(results.field(count=20)),
}
#: Names of the figures of some cases.
EXPECTED = {
    "maps": "images slope_maps slope_errors errors canting sun_profile sun_disc effort",
    "one module, one method": "images slope_maps slope_errors errors canting sun_profile sun_disc",
    "raw slopes": "images slope_maps slope_errors errors canting sun_profile sun_disc raw_slopes effort",
    "table": "errors canting effort",
    "suns": "errors canting errors_over_sun_azimuth rms_errors_over_sun_azimuth sight_over_sun_azimuth effort",
    "many modules": "errors_jose errors_noisy canting effort",
    "nothing": "",
    "measured": "images slope_maps slope_uncertainty residuals which_pixels_count quality canting sun_profile sun_disc",
    "measured, nothing": "which_pixels_count quality",
    "field": "accuracy_map usable_map accuracy_over_distance",
    "field without slopes": "",
}
GALLERY = Gallery(figures, MOST_FIGURES, CASES, EXPECTED, ("method", "module"), shared=True)
drawn, result_of = GALLERY.find, GALLERY.result


def bars_of(axes):
    """Lower and upper ends of all error bars, shape (n, 2)."""
    segments = [segment for bars in axes.containers for segment in bars.lines[2][0].get_segments()]
    return np.array([segment[:, 1] for segment in segments if len(segment) == 2])


def test_maps_of_two_numbers_and_curves_over_each():
    found = {named.name: named for named in figures(result_of("two numbers"))}
    assert "accuracy_over_camera_radius_and_camera_noise" in found
    titles = [axes.get_title() for axes in found["errors_over_camera_radius"].figure.axes]
    assert titles == [f"{shape}, {way}" for shape in ("square", "cross") for way in ("horizontal", "vertical")]
    assert found["errors_over_camera_noise"].figure.axes[0].get_xscale() == "log"


def test_slopes_of_all_methods_have_one_scale_and_stand_in_their_column():
    dataset = result_of("maps")
    pictures = drawn(dataset, "slope_maps").figure.axes[:-1]
    assert len(pictures) == 4 * 4
    assert [axes.get_title() for axes in pictures[:5]] == ["A, none", "O1, none", "O2", "LM", ""]
    assert len({axes.images[0].get_clim() for axes in pictures}) == 1
    here = dataset["slope_y"].isel(sun_profile=1, slope_method=3, referential=0)
    np.testing.assert_array_equal(np.ma.filled(pictures[15].images[0].get_array(), np.nan), here)
    errors = drawn(dataset, "slope_errors").figure.axes[0].images[0].get_array()
    here = dataset.isel(sun_profile=0, slope_method=0, referential=0)
    np.testing.assert_array_equal(np.ma.filled(errors, np.nan), here["slope_x"] - here["true_slope_x"])


def test_error_bars_reach_from_5_to_95_percent_about_the_median_and_published_numbers_are_marked():
    dataset, named = result_of("table"), drawn(result_of("table"), "errors")
    assert [axes.get_title() for axes in named.figure.axes] == ["jose, module 2", "noisy, module 2", "", ""]
    here = dataset.sel({"sun_profile": "noisy", "module": 2, "slope_method": "A", "referential": "none"})
    ends = [float(here["relative_error_x_low"]), float(here["relative_error_x_high"])]
    assert any(np.allclose(bar, ends) for bar in bars_of(named.figure.axes[1]))
    shown = np.concatenate([np.asarray(line.get_ydata()) for line in named.figure.axes[1].get_lines()])
    assert np.isclose(shown, float(here["relative_error_x_median"])).any()
    black = [marks for axes in named.figure.axes for marks in axes.collections if marks.get_linewidth()[0] == 1.8]
    assert [segment[0, 1] for marks in black for segment in marks.get_segments() if len(segment)] == [14.6]
    assert "median over 5 seeds" in named.caption
    assert "Black: published." in named.caption
    assert "published" not in drawn(results.result({**PROFILES, **SEEDS}), "errors").caption


def test_curves_have_the_colour_of_the_method_and_the_dashes_of_the_referential():
    dataset, figure = result_of("suns"), drawn(result_of("suns"), "errors_over_sun_azimuth").figure
    lines = {line.get_label(): line for line in figure.axes[0].get_lines()}
    assert list(lines) == [f"{m}, {r}" for m in ("A", "O1") for r in results.REFERENTIALS] + ["O2", "LM"]
    assert lines["A, none"].get_color() == lines["A, exact"].get_color() != lines["O2"].get_color()
    assert lines["A, none"].get_linestyle() == lines["LM"].get_linestyle() != lines["A, roll"].get_linestyle()
    np.testing.assert_array_equal(lines["A, none"].get_xdata(), [0.0, 30.0, 60.0])
    here = (
        dataset["relative_error_x"].isel(sun_profile=0).sel({"slope_method": "A", "referential": "none", "module": 2})
    )
    np.testing.assert_allclose(lines["A, none"].get_ydata(), here.sortby("sun_azimuth"))


def test_scatter_is_that_of_all_seeds_beside_the_bound():
    dataset, named = result_of("noises"), drawn(result_of("noises"), "rms_errors_over_camera_noise")
    lines = {line.get_label(): line.get_ydata() for line in named.figure.axes[0].get_lines()}
    here = dataset.sel({"slope_method": "LM", "referential": "none", "module": 2})
    np.testing.assert_allclose(lines["LM"], np.sqrt((here["slope_rms_x"] ** 2).mean("camera_seed")))
    bound = np.sqrt((here["cramer_rao_bound_x"] ** 2).mean("camera_seed"))
    np.testing.assert_allclose(lines["Cramér-Rao bound"], bound)
    assert "Over 3 seeds." in named.caption


def test_canting_is_told_less_the_entered_one_with_95_percent_intervals():
    dataset = results.result(methods=["LM"], referentials=["exact"])
    figure = drawn(dataset, "canting").figure
    bars = bars_of(figure.axes[1])
    true = np.array([0, -1, 1, 0, 0, 0, 0, 0])
    one = dataset.isel(slope_method=0, referential=0)
    np.testing.assert_allclose(bars.mean(axis=1), one["canting_y"] - true, atol=1e-15)
    np.testing.assert_allclose(np.ptp(bars, axis=1) / 2, 1.959964 * one["canting_y_standard_error"], rtol=1e-6)
    assert figure.axes[1].get_ylabel().startswith("error of vertical")
    assert drawn(result_of("measured"), "canting").figure.axes[1].get_ylabel().startswith("vertical")


def test_field_maps_show_the_larger_direction_of_every_heliostat():
    dataset, figure = result_of("field"), drawn(result_of("field"), "accuracy_map").figure
    (squares,) = figure.axes[1].collections
    here = dataset.sel({"hour": 12, "slope_method": "LM", "referential": "exact"})
    np.testing.assert_array_equal(squares.get_array(), np.maximum(here["slope_rms_x"], here["slope_rms_y"]))
    (squares,) = drawn(dataset, "usable_map").figure.axes[1].collections
    np.testing.assert_array_equal(squares.get_array(), 100 * here["usable_fraction"])


def test_a_field_is_drawn_over_distance_with_a_colour_for_each_hour():
    dataset = result_of("field")
    spots = drawn(dataset, "accuracy_over_distance").figure.axes[3].collections[1]
    here = dataset.sel({"hour": 12, "slope_method": "LM", "referential": "exact"})
    errors = np.maximum(here["slope_rms_x"], here["slope_rms_y"])
    known = np.isfinite(errors)
    np.testing.assert_array_equal(spots.get_offsets()[known], np.stack([here["slant_range"], errors], 1)[known])
    assert set(spots.get_array()) == {12.0}


def test_effort_stands_above_the_error_that_it_leaves():
    dataset, axes = result_of("maps"), drawn(result_of("maps"), "effort").figure.axes
    here = dataset.sel({"sun_profile": "noisy", "module": 2})
    np.testing.assert_allclose(axes[1].get_lines()[0].get_ydata(), here["evaluations"])
    for line, end in zip(axes[3].get_lines()[:2], "xy", strict=True):
        np.testing.assert_allclose(line.get_ydata(), here[f"slope_rms_{end}"].sel(referential="exact"))


def test_sight_is_in_percent_of_each_module():
    dataset = result_of("suns").isel(sun_profile=0).sortby("sun_azimuth")
    here = dataset.sel({"slope_method": "LM", "module": 3})
    for axes, name in zip(
        drawn(result_of("suns"), "sight_over_sun_azimuth").figure.axes, ("usable_fraction", "lit_cameras"), strict=True
    ):
        np.testing.assert_allclose(axes.get_lines()[1].get_ydata(), 100 * here[name])


def test_errors_over_two_numbers_are_those_of_the_best_method():
    dataset = (
        result_of("two numbers").isel(arrangement=0).sel({"slope_method": "LM", "referential": "exact", "module": 2})
    )
    figure = drawn(result_of("two numbers"), "accuracy_over_camera_radius_and_camera_noise").figure
    for axes, end in zip(figure.axes[:2], "xy", strict=True):
        shown = axes.collections[0].get_array()
        np.testing.assert_array_equal(shown, dataset[f"slope_rms_{end}"].transpose("camera_noise", "camera_radius"))


def test_captions_say_where_the_rest_stands():
    dataset = results.result({**SUNS, **NOISES}, methods=["LM"], modules=1).assign_coords(camera_radius=0.24)
    dataset["camera_radius"].attrs["units"] = "m"
    caption = drawn(dataset, "errors_over_sun_azimuth").caption
    assert "noise of the cameras 0.01 (one of 3)" in caption
    assert "radius of the cameras 0.24 m" in caption


def test_raw_slopes_and_their_difference_stand_beside_each_other():
    """Figure 7: rows horizontal and vertical, the third picture the first less the second."""
    dataset = result_of("raw slopes")
    exact = dataset.assign(
        {f"slope_{end}": dataset[f"raw_slope_{end}"] - dataset[f"raw_ideal_slope_{end}"] for end in "xy"}
    )
    axes = drawn(exact, "raw_slopes").figure.axes[:6]
    assert [one.get_title() for one in axes[:3]] == ["with the defects", "without", "difference"]
    for row in (0, 3):
        first, second, third = (np.ma.filled(one.images[0].get_array(), np.nan) for one in axes[row : row + 3])
        np.testing.assert_allclose(third, first - second)


def test_the_sun_is_drawn_over_angles_beside_the_formula_with_the_fit_in_the_caption():
    dataset = result_of("maps")
    named, discs = drawn(dataset, "sun_profile"), drawn(dataset, "sun_disc").figure.axes[2:4]
    here = dataset.sel(sun_profile="noisy")
    limb, exponent, radius, rest = (
        float(here[f"sun_{name}"]) for name in ("limb_fit", "exponent_fit", "radius_fit", "fit_rms")
    )
    for line, disc, name in zip(named.figure.axes[1].lines, discs, ("sun_brightness", "sun_formula"), strict=True):
        np.testing.assert_allclose(line.get_xdata(), radius * here["disc_fraction"])
        np.testing.assert_array_equal(line.get_ydata(), here[name])
        assert disc.images[0].get_array()[100, 100] == here[name][0]
    assert f"A = {limb:.3f}, xi = {exponent:.3f}, eps_max = {radius:.3f} mrad" in named.caption
    assert f"root mean square of the rest {100 * rest:.2f} %" in named.caption
