"""Figures of the family `misalignment`: which there are, on which axes, with which words, whatever was swept."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from matplotlib.patches import Ellipse, Rectangle

from heliosweep.families.misalignment.curves.figures import conic_curve, other_focus
from heliosweep.families.misalignment.figures import MOST_FIGURES, figures
from tests.families.gallery import Gallery, nothing
from tests.families.misalignment import report_results as results

pytestmark = pytest.mark.usefixtures("unplaced")

HOURS = np.arange(6.0, 19)
SHUFFLED = {"axis": ["azimuth", "encoder_azimuth", "elevation"], "error_size": [4.0, -12.0, 0.0, 12.0, -4.0]}
FIELD = {"axis": ["azimuth", "elevation"], "error_size": [-4.0, 4.0]}


def shuffled(dataset):
    """The same with the sweep's, heliostats' and hours' order turned around."""
    return dataset.isel({dim: slice(None, None, -1) for dim in dataset.dims if dim not in ("parameter",)})


def gaps(dataset):
    """The same without a value at a third of the heliostats and hours."""
    here = xr.DataArray(np.arange(dataset.sizes["heliostat"]) % 3 != 1, dims="heliostat")
    floats = {name: array for name, array in dataset.data_vars.items() if array.dtype == float}
    return dataset.assign({name: array.where(here) for name, array in floats.items() if "heliostat" in array.dims})


def endless(dataset):
    """The same with no error that drives any spot out."""
    return dataset.assign({name: dataset[name] * 0 + np.inf for name in ("tracking_tolerance", "least_tolerance")})


def civil(dataset):
    dates = np.array(["2026-03-20", "2026-06-21", "2026-12-21"], "datetime64[ns]")[: dataset.sizes["day"]]
    return dataset.rename(day="date").assign_coords(date=("date", dates, {"long_name": "local date"}))


def standing():
    """Two suns that stand still, tied together, and no clock."""
    sweep = {"axis": ["elevation", "azimuth"], "error_size": 25 * results.SIZES}
    dataset = results.curves(hours=(8, 14), sweep=sweep)
    dataset = dataset.rename(hour="sun_azimuth").assign_coords(sun_azimuth=("sun_azimuth", [101.0, 260.0]))
    dataset["sun_azimuth"].attrs = {"units": "degree", "long_name": "azimuth of the sun, clockwise from north"}
    names = {"hour_of_least_tolerance"}
    dataset = dataset.drop_vars(["day", *names]).expand_dims("hour", axis=-1)
    return dataset.isel(heliostat=slice(0, 2))


def swept_errors(**sweep):
    dataset = results.curves(days=(80, 172), hours=HOURS, sweep={"error_size": results.SIZES})
    kept = ["spot_y", "spot_z", "spot_status", "is_real", "inside", "hit_fraction"]
    return dataset[kept].rename(error_size="tilt_about_north").assign_attrs(mode="mount_errors")


CASES = {
    "curves": results.curves,
    "drift": lambda: results.curves(hours=HOURS),
    "in any order": lambda: shuffled(results.curves(days=(80, 172), hours=HOURS, sweep=SHUFFLED)),
    "one size": lambda: results.curves(hours=HOURS, sweep={}),
    "one heliostat": lambda: results.curves(hours=(10,), pivots=results.POSITIONS[:1]),
    "one heliostat over a day": lambda: results.curves(hours=HOURS, pivots=results.POSITIONS[:1]),
    "gaps": lambda: gaps(results.curves(hours=HOURS)),
    "nothing": lambda: nothing(results.curves(hours=HOURS)),
    "endless": lambda: endless(results.curves(hours=HOURS, sweep=FIELD, pivots=results.field(30))),
    "field": lambda: results.curves(days=(80, 172, 355), hours=HOURS, sweep=FIELD, pivots=results.field()),
    "field with gaps": lambda: gaps(results.curves(hours=HOURS, sweep=FIELD, pivots=results.field(50))),
    "several places": lambda: results.curves(sweep={"receiver_height": [100.0, 143.0], **FIELD}, hours=HOURS),
    "dates": lambda: civil(results.curves(days=(80, 172), hours=HOURS)),
    "standing sun": standing,
    "bare": lambda: results.curves(hours=HOURS).drop_vars(["heliostat", "x", "receiver_width", "hour", "axis"]),
    "swept mount errors": swept_errors,
    "draws": results.draws,
    "draws at one instant": lambda: results.draws(days=(172,), hours=(12,), pivots=results.POSITIONS[:1]),
    "draws without a value": lambda: nothing(results.draws()),
    "draws of a field": lambda: results.draws({"error_scale": [2.0, 0.5, 1.0]}, results.field(), days=(172,)),
    "draws of a field on dates": lambda: civil(gaps(results.draws(pivots=results.field(40)))),
    "draws of two mounts": lambda: results.draws({"mount_kind": ["polar", "azimuth_elevation"]}),
    "calibration": lambda: results.calibration({"days_used": [3, 1, 2]}, samples=20, parameters=6),
    "calibration of one": lambda: results.calibration(pivots=results.POSITIONS[:1], parameters=2),
    "calibration of a field": lambda: results.calibration(pivots=results.field()),
    "calibration with gaps": lambda: gaps(results.calibration({"noise": [0.01, 0.05]}, pivots=results.field(9))),
    "calibration without a value": lambda: nothing(results.calibration({"days_used": [1, 2]})),
    "calibration of measured spots": lambda: results.calibration().drop_vars("true_error"),
}


#: Names of the figures of some cases.
EXPECTED = {
    "curves": "deviation_curves spot_drift_elevation spot_drift_azimuth tolerance_over_day hits_over_error",
    "one size": "spot_drift conics tolerance_over_day",
    "one heliostat": "deviation_curves",
    "nothing": "",
    "standing sun": "deviation_curves conics",
    "field": "tolerance_map tolerance_hour_map tolerance_over_day spot_drift_elevation spot_drift_azimuth",
    "swept mount errors": "deviation_curves spot_drift hits_over_error",
    "draws": "spot_spread hits_over_day remaining_tolerance",
    "draws at one instant": "spot_spread",
    "draws without a value": "",
    "draws of a field": "spot_spread hits_over_day hits_over_error_scale hit_map remaining_tolerance",
    "calibration": "before_after recovered_errors knowledge_over_days_used",
    "calibration of a field": "before_after recovered_errors residual_map",
    "calibration without a value": "",
    "calibration of measured spots": "before_after",
}
GALLERY = Gallery(figures, MOST_FIGURES, CASES, EXPECTED, shared=True)
one_of = GALLERY.find


def test_curves_pass_through_the_aim_and_show_the_spots_in_the_order_of_the_error():
    dataset = results.curves().assign_coords(receiver_height_extent=8.0)
    figure = one_of(shuffled(dataset), "deviation_curves").figure
    panels = figure.axes
    assert len(panels) == 6
    titles = [axes.get_title() for axes in panels]
    assert titles[-1] == "heliostat 0: (\N{MINUS SIGN}16, 150, 0) m"
    lines = [line for line in panels[-1].get_lines() if len(line.get_xdata()) == results.SIZES.size]
    assert len(lines) == 2 * 3
    here = dataset.isel(heliostat=0, source=1, day=0).sel(axis="elevation", hour=8)
    np.testing.assert_array_equal(lines[0].get_xdata(), here["spot_y"])
    np.testing.assert_array_equal(lines[0].get_ydata(), here["spot_z"])
    assert lines[0].get_color() == "#D55E00"
    (box,) = [patch for patch in panels[0].patches if isinstance(patch, Rectangle)]
    assert (box.get_x(), box.get_y(), box.get_width(), box.get_height()) == (-4.5, -4.0, 9.0, 8.0)
    assert (panels[-1].get_xlabel(), panels[0].get_ylabel()) == ("to the right (m)", "up (m)")


def test_drift_has_a_colour_for_each_hour_and_a_line_for_each_error():
    dataset = results.curves(hours=HOURS)
    named = one_of(dataset, "spot_drift_azimuth")
    axes = named.figure.axes[2]
    assert len(axes.collections) == 6  # of seven errors that of zero is the aim
    assert {text.get_text() for text in axes.texts} == {"+12", "+8", "+4"} | {f"\N{MINUS SIGN}{n}" for n in (4, 8, 12)}
    np.testing.assert_array_equal(axes.collections[0].get_array(), HOURS)
    spots = dataset.isel(heliostat=2, source=0, day=0).sel(axis="azimuth", error_size=-12)
    np.testing.assert_array_equal(axes.collections[0].get_offsets()[:, 0], spots["spot_y"])
    assert "Shown are 6 of 25" in named.caption


def test_field_maps_show_the_least_tolerance_of_every_heliostat_and_its_hour():
    dataset = CASES["field"]()
    named, hours = one_of(dataset, "tolerance_map"), one_of(dataset, "tolerance_hour_map").figure.axes
    for axes, when, axis in zip(named.figure.axes, hours, ("elevation", "azimuth"), strict=False):
        (squares,), (moments,) = axes.collections, when.collections
        here = dataset.sel(axis=axis)
        np.testing.assert_array_equal(squares.get_array(), here["least_tolerance"])
        known = np.isfinite(here["least_tolerance"])
        np.testing.assert_array_equal(moments.get_array()[known], here["hour_of_least_tolerance"][known])
        assert f"least {float(here['least_tolerance'].min()):.2f}, median" in axes.get_title()
        corners = squares.get_paths()[0].vertices
        assert np.ptp(corners[:, 0]) > 1
    assert "least" in named.caption.lower()


@pytest.mark.parametrize("count", [3, 30])
def test_tolerances_and_hits_are_those_of_each_heliostat_or_of_the_field(count):
    sweep = {"axis": ["elevation", "azimuth"], "error_size": [-9.0, 0.0, 4.0]}
    dataset = results.curves(hours=HOURS, sweep=sweep, pivots=results.field(count))
    here = dataset.isel(day=0).sel(axis="azimuth")
    tolerance = here["tracking_tolerance"].where(np.isfinite(here["tracking_tolerance"]))
    tolerances, hits = list(tolerance), list(100 * here["hit_fraction"].T)
    if count == 30:
        tolerances, hits = [tolerance.quantile(part, "heliostat") for part in (0, 0.05, 0.5)], [sum(hits) / count]
    for name, expected in (("tolerance_over_day", tolerances), ("hits_over_error", hits)):
        lines = one_of(dataset, name).figure.axes[1].get_lines()
        for line, values in zip(lines, expected, strict=True):
            np.testing.assert_allclose(line.get_ydata(), values, rtol=1e-12)


def test_conics_have_their_foci_and_eccentricity():
    dataset = standing()
    axes, here = one_of(dataset, "conics").figure.axes[0], dataset.isel(heliostat=0, sun_azimuth=0).squeeze()
    full, hollow = [line for line in axes.get_lines() if line.get_marker() == "D"][:2]
    one = here.sel(axis="elevation")
    focus = np.array([one["focus_y"], one["focus_z"]])
    np.testing.assert_array_equal(np.ravel(full.get_data()), focus)
    np.testing.assert_allclose(np.ravel(hollow.get_data()), other_focus(one["conic"].to_numpy(), focus))
    assert f"e = {float(one['eccentricity']):.5g} (elevation), " in axes.get_title()


def test_hits_of_draws_are_those_of_the_field_the_mean_and_the_worst():
    dataset = results.draws({"error_scale": [2.0, 0.5, 1.0]}, results.field(9), days=(172,))
    names = [axes.get_title().split(":")[0] for axes in one_of(dataset, "spot_spread").figure.axes[:6]]
    far = np.hypot(dataset["x"].to_numpy(), dataset["y"].to_numpy())
    assert list(np.diff([far[int(name.removeprefix("heliostat "))] for name in names]) >= -1e-9) == [True] * 5
    of_day = 100 * dataset["day_hit_fraction"].isel(day=0).sortby("error_scale")
    for name, expected in (
        ("hits_over_day", list(100 * dataset["field_hit_fraction"].isel(day=0).sortby("error_scale"))),
        ("hits_over_error_scale", [of_day.mean("heliostat"), of_day.min("heliostat")]),
        ("remaining_tolerance", list(dataset["remaining_tolerance"][2, 4, 0, :, :, 0].T)),
    ):
        axes = one_of(dataset, name).figure.axes[0]
        for line, values in zip(axes.get_lines(), expected, strict=True):
            np.testing.assert_allclose(line.get_ydata(), values.where(np.isfinite(values)), rtol=1e-12)
    for axes, values in zip(one_of(dataset, "hit_map").figure.axes, of_day, strict=False):
        np.testing.assert_allclose(axes.collections[0].get_array(), values)


def test_ellipses_hold_95_percent_of_the_draws():
    dataset = results.draws(pivots=results.POSITIONS[:1], days=(172,), hours=(12,))
    axes = one_of(dataset, "spot_spread").figure.axes[0]
    (ellipse,) = [patch for patch in axes.patches if isinstance(patch, Ellipse)]
    here = dataset.isel(heliostat=0, day=0, hour=0)
    mean = [float(here["spot_y_mean"]), float(here["spot_z_mean"])]
    yy, zz, yz = (float(here[f"spot_{name}"]) for name in ("y_variance", "z_variance", "yz_covariance"))
    draws = np.random.default_rng(5).multivariate_normal(mean, [[yy, yz], [yz, zz]], 200_000)
    inside = ellipse.get_path().contains_points(ellipse.get_patch_transform().inverted().transform(draws))
    assert inside.mean() == pytest.approx(0.95, abs=2e-3)


def test_spots_of_a_calibration_stand_before_and_after_it():
    dataset = results.calibration(pivots=results.POSITIONS[:2])
    above, _, below, _ = one_of(dataset, "before_after").figure.axes
    for axes, words in ((above, ("before", "after")), (below, ("after",))):
        ellipses = [one for one in axes.patches if isinstance(one, Ellipse)]
        for word, line, ellipse in zip(words, axes.get_lines(), ellipses, strict=False):
            y, z = (dataset[f"spot_{side}_{word}"].isel(heliostat=0).to_numpy().ravel() for side in "yz")
            np.testing.assert_array_equal(line.get_xdata(), y)
            np.testing.assert_array_equal(line.get_ydata(), z)
            far = np.sqrt(5.991465 * np.linalg.eigvalsh(np.cov(y[np.isfinite(y)], z[np.isfinite(z)])))
            np.testing.assert_allclose(sorted([ellipse.width, ellipse.height]), 2 * far, rtol=1e-6)


def test_how_well_errors_are_known_is_the_median_over_draws_and_heliostats():
    dataset = results.calibration({"days_used": [3, 1, 2]}, samples=3, parameters=2)
    errors, condition = one_of(dataset, "knowledge_over_days_used").figure.axes
    many = ["heliostat", "sample"]
    known = dataset["standard_error"].median(many).sortby("days_used").isel(parameter=slice(2))
    for line, values in zip(errors.get_lines(), known.T, strict=True):
        np.testing.assert_allclose(line.get_ydata(), values)
    (line,) = condition.get_lines()
    np.testing.assert_allclose(line.get_ydata(), dataset["condition_number"].median(many).sortby("days_used"))


def test_the_map_of_residuals_shows_those_of_every_heliostat():
    dataset = results.calibration(pivots=results.field(9))
    (squares,) = one_of(dataset, "residual_map").figure.axes[0].collections
    np.testing.assert_array_equal(squares.get_array(), dataset["residual_rms"])


def test_recovered_errors_have_95_percent_bars_about_the_estimate():
    dataset = results.calibration(pivots=results.POSITIONS[:2], parameters=2).drop_vars("spots_used")
    axes = one_of(dataset, "recovered_errors").figure.axes[1]
    (bars,) = axes.containers
    ends = np.array(bars.lines[2][0].get_segments())[:, :, 1]
    one = dataset.isel(parameter=1)
    np.testing.assert_allclose(ends.mean(axis=1), one["estimated_error"])
    np.testing.assert_allclose(np.ptp(ends, axis=1) / 2, 1.959964 * one["standard_error"], rtol=1e-6)


def test_bars_of_few_spots_are_those_of_the_t_distribution():
    dataset = results.calibration(pivots=results.POSITIONS[:2], parameters=2).assign(spots_used=("heliostat", [3, 4]))
    (bars,) = one_of(dataset, "recovered_errors").figure.axes[0].containers
    ends = np.array(bars.lines[2][0].get_segments())[:, :, 1]
    quantiles = np.array([2.776445, 2.446912])  # of 4 and 6 degrees of freedom
    np.testing.assert_allclose(np.ptp(ends, axis=1) / 2, quantiles * dataset["standard_error"][:, 0], rtol=1e-6)


def test_captions_say_where_the_rest_stands():
    dataset = results.curves(days=(80, 172, 355), hours=HOURS)
    caption = one_of(dataset, "deviation_curves").caption
    assert "Shown are 3 of 13 hours." in caption
    assert "source canting (one of 2), day 172 (one of 3)" in caption
    assert "latitude 37.4\N{DEGREE SIGN} N" in caption


@pytest.mark.parametrize("coefficients", [[1.0, 0.3, -2.0, 4.0, 1.0, 0.2], [1.0, 0.3, 2.0, 4.0, 1.0, 0.2]])
def test_conic_curves_fulfil_their_equation(coefficients):
    y, z = conic_curve(np.array(coefficients))
    near = np.abs(y) < 50
    terms = np.stack([y * y, y * z, z * z, y, z, np.ones_like(y)])[:, near] * np.array(coefficients)[:, np.newaxis]
    assert near.sum() > 100
    assert np.abs(terms.sum(axis=0)).max() < 1e-10 * np.abs(terms).max()


def test_distances_from_the_foci_of_a_hyperbola_differ_by_the_same():
    coefficients = np.array([1.0, 0.0, -1.0, 0.0, 0.0, -1.0])  # y2 - z2 = 1
    focus = np.array([np.sqrt(2.0), 0.0])
    np.testing.assert_allclose(other_focus(coefficients, focus), -focus, atol=1e-15)
    assert all(np.isnan(part).all() for part in conic_curve(np.array([1.0, 0.0, 0.0, 0.0, 1.0, 0.0])))
