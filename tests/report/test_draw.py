"""The forms of figures: values, words and colours that they show, against values computed here."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from heliosweep.report.context import aperture
from heliosweep.report.draw import draw, image
from heliosweep.report.figures import Curves, Grids, Maps, Planes, Rasters, with_heat_map
from tests.report.synthetic import BOTH, result

RNG = np.random.default_rng(5)


def array(**sizes):
    values = RNG.uniform(1.0, 2.0, tuple(sizes.values()))
    return xr.DataArray(values, dims=list(sizes), attrs={"units": "m", "long_name": "reach"})


def one(data, figure):
    (named,) = draw(data, [figure])
    return named


def test_curves_have_a_line_for_each_word_and_a_panel_for_each_variable():
    data = xr.Dataset(
        {"reach": array(kind=2, tilt=5), "width": array(kind=2, tilt=5)},
        {"kind": ["a", "b"], "tilt": ("tilt", [5.0, 1.0, 2.0, 3.0, 4.0], {"units": "degree", "long_name": "tilt"})},
    )
    named = one(data, Curves("reach", "Reach", ["reach", "unknown", "width"], over=["tilt"]))
    assert len(named.figure.axes) == 2
    first, second = named.figure.axes[0].get_lines()
    order = [1, 2, 3, 4, 0]
    assert first.get_xdata().tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert first.get_ydata().tolist() == data["reach"].isel(kind=0).to_numpy()[order].tolist()
    assert second.get_ydata().tolist() == data["reach"].isel(kind=1).to_numpy()[order].tolist()
    assert named.figure.axes[1].get_xlabel() == "tilt (\N{DEGREE SIGN})"
    assert [text.get_text() for text in named.figure.legends[0].get_texts()] == ["a", "b"]


def test_a_standard_error_is_a_band():
    data = xr.Dataset({"reach": ("tilt", [1.0, 2.0]), "reach_error": ("tilt", [0.25, 0.5])}, {"tilt": [0.0, 1.0]})
    axes = one(data, Curves("reach", "Reach", ["reach"])).figure.axes[0]
    band = axes.collections[0].get_paths()[0].vertices
    assert {tuple(point) for point in band.tolist()} >= {(0.0, 0.75), (0.0, 1.25), (1.0, 1.5), (1.0, 2.5)}


def test_statistics_of_a_field_are_lines():
    data = xr.Dataset({"reach": array(hour=4, heliostat=50)}, {"hour": [8.0, 10.0, 12.0, 14.0]})
    lines = one(data, Curves("reach", "Reach", ["reach"], reduce={"heliostat": "field"})).figure.axes[0].get_lines()
    assert lines[0].get_ydata() == pytest.approx(data["reach"].min("heliostat").to_numpy())
    assert lines[2].get_ydata() == pytest.approx(np.median(data["reach"], axis=1))


def test_fractions_are_percentages_and_constant_variables_have_no_panel():
    share = {"units": "1", "valid_range": [0.0, 1.0], "long_name": "share"}
    data = xr.Dataset({"share": ("tilt", [0.5, 0.25], share), "same": ("tilt", [1.0, 1.0])}, {"tilt": [0.0, 1.0]})
    (axes,) = one(data, Curves("share", "Share", ["share", "same"])).figure.axes
    assert axes.get_lines()[0].get_ydata().tolist() == [50.0, 25.0]
    assert axes.get_ylabel() == "share (%)"


def test_maps_and_their_differences():
    data = result({"tracking": BOTH}, heliostats=9)
    maps, differences = draw(data, [Maps("map", "Map", ["optical_efficiency"], lines=["tracking"], less="tracking")])
    shown = [np.asarray(axes.collections[0].get_array()) for axes in maps.figure.axes[:2]]
    for values, method in zip(shown, BOTH, strict=True):
        assert values == pytest.approx(100 * data["optical_efficiency"].sel(tracking=method).to_numpy())
    assert np.asarray(differences.figure.axes[0].collections[0].get_array()) == pytest.approx(shown[0] - shown[1])
    low, high = differences.figure.axes[0].collections[0].get_clim()
    assert high is not None
    assert low == -high


def test_rasters_show_every_pixel_upright():
    z, y = np.linspace(1.0, -1.0, 5), np.linspace(-2.0, 2.0, 7)
    data = xr.Dataset({"slope": (("z", "y"), np.outer(z, y), {"units": "mrad"})},
                      {"z": ("z", z, {"units": "m"}), "y": ("y", y, {"units": "m"})})  # fmt: skip
    mesh = one(data, Rasters("slope", "Slope", ["slope"])).figure.axes[0].collections[0]
    assert np.asarray(mesh.get_array()).reshape(5, 7)[0] == pytest.approx(-y)


def test_a_heat_map_comes_first_if_two_dimensions_are_swept():
    sweep = {"receiver_height": [80.0, 90.0, 100.0], "clearance": [10.0, 12.0, 14.0, 16.0]}
    data = result(sweep, heliostats=1)
    figures = with_heat_map(data, [Curves("a", "A", ["field_optical_efficiency"])], ["field_optical_efficiency"])
    assert isinstance(figures[0], Grids)
    mesh = one(data, figures[0]).figure.axes[0].collections[0]
    expected = 100 * data["field_optical_efficiency"].transpose("receiver_height", "clearance").to_numpy()
    assert np.asarray(mesh.get_array()).reshape(3, 4) == pytest.approx(expected)
    assert len(with_heat_map(data.isel(clearance=[0]), figures[1:], ["field_optical_efficiency"])) == 1


def test_planes_have_equal_axes_about_the_aperture():
    data = xr.Dataset({"spot_y": array(hour=5, heliostat=2), "spot_z": array(hour=5, heliostat=2)},
                      {"hour": range(5), "receiver_width": 6.0, "receiver_height_extent": 8.0})  # fmt: skip
    named = one(data, Planes("spots", "Spots", ["spot_z"], over=["hour"], against={"spot_z": "spot_y"}))
    assert len(named.figure.axes) == 2
    for axes in named.figure.axes:
        left, right = axes.get_xlim()
        bottom, top = axes.get_ylim()
        assert right - left == pytest.approx(top - bottom)
        assert min(-left, right) > 3
        assert min(-bottom, top) > 4
    assert aperture(data, {}) == (6.0, 8.0)


@pytest.mark.parametrize("kind", ["png", "svg", "pdf"])
def test_the_same_figure_has_the_same_bytes(kind):
    data = xr.Dataset({"reach": array(tilt=3)}, {"tilt": [0.0, 1.0, 2.0], "height": 3.0})
    figures = [one(data, Curves("reach", "Reach $x$", ["reach"])).figure for _ in range(2)]
    assert image(figures[0], kind) == image(figures[1], kind)
