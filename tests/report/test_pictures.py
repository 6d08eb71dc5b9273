"""Pictures of maps: one scale, equal metres, outlines, grey for no value; nothing cut off whatever the shape."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import to_rgba
from matplotlib.contour import ContourSet
from matplotlib.patches import Polygon, Rectangle

from heliosweep.report.colours import DIFFERENCES, NO_VALUE, VALUES
from heliosweep.report.pictures import (
    Kinds,
    Raster,
    Shades,
    about_zero,
    field_map,
    from_zero,
    picture_figure,
    symbols,
    within,
)
from heliosweep.report.style import image
from tests.report.synthetic import is_inside, result

SHAPES = {"square": (7.0, 7.0), "tall": (1.0, 9.0), "flat": (15.0, 0.5), "single pixel": (0.05, 0.05)}


def raster(wide=7.0, high=7.0, pixel=0.05, scale=1.0, title="", outlined=True):
    """A slope of the values over a plane with two modules beside each other."""
    x, y = ((np.arange(n) - (n - 1) / 2) * pixel for n in (max(1, round(side / pixel)) for side in (wide, high)))
    outlines = [(text, side * wide / 4, 0.0, 0.49 * wide, high) for side, text in ((-1, "1"), (1, "2"))]
    array = xr.DataArray(scale * (x + 2 * y[:, np.newaxis]), {"z": y, "y": x}, ("z", "y"))
    return Raster(array, title, outlines if outlined else ())


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 4), (2, 2), (4, 4), (4, 1)])
def test_metres_are_equal_and_nothing_is_cut_off(shape, rows, columns):
    pictures = [raster(*SHAPES[shape], title="LM")] * (rows * columns)
    shades = about_zero("slope (mrad)", [one.values for one in pictures])
    figure = picture_figure(pictures, shades, columns, ["noisy\nhorizontal"] * rows)
    assert len(figure.axes) == rows * columns + 1
    width, height = figure.get_size_inches()
    for axes in figure.axes[:-1]:
        box = axes.get_position()
        x, y = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
        assert box.width * width / x == pytest.approx(box.height * height / y)
    assert is_inside(figure)
    assert image(figure).startswith(b"\x89PNG")


def test_all_pictures_have_one_scale_about_zero():
    pictures = [raster(scale=scale) for scale in (0.1, -0.1)]
    shades = about_zero("slope (mrad)", [one.values for one in pictures])
    assert shades.low == -shades.high
    assert 1.0 <= shades.high <= 1.05
    figure = picture_figure(pictures, shades)
    assert {axes.images[0].get_clim() for axes in figure.axes[:2]} == {(shades.low, shades.high)}
    assert figure.axes[-1].get_xlabel() == "slope (mrad)"
    assert from_zero("error (mrad)", [one.values for one in pictures]).low == 0.0


def test_a_scale_within_the_values_is_rounded_outwards():
    shades = within("brightness (1)", [np.linspace(0.613, 0.998, 1000)])
    assert (shades.low, shades.high) == pytest.approx((0.6, 1.0))
    same = within("brightness (1)", [np.full(9, 0.7)])
    assert same.low <= 0.7 <= same.high
    assert same.low < same.high


def test_values_of_both_signs_have_a_scale_about_zero_and_others_none():
    both, hardly = (within("slope (mrad)", [np.array([low, 10.0])], held=1.0) for low in (-3.0, -1e-9))
    assert (both.low, both.high, both.palette) == (-10, 10, DIFFERENCES)
    assert (hardly.high, hardly.palette) == (10, VALUES)


def test_wild_values_do_not_stretch_the_scale_and_the_bar_points_to_them():
    wild = raster()
    wild.array[0, 0] = 1e6
    shades = from_zero("error (mrad)", [wild.values])
    assert shades.high < 12
    bars = {}
    for name, high in (("within", 2e6), ("beyond", shades.high)):
        figure = picture_figure([Raster(abs(wild.array))], Shades("error (mrad)", 0.0, high))
        bars[name] = figure.axes[-1].get_children()
    assert len(bars["beyond"]) > len(bars["within"])


def test_pixels_lie_where_they_are_whichever_way_the_sides_run():
    one = raster(2.0, 1.0, 0.5)
    turned = Raster(one.array[::-1, ::-1], outlines=one.outlines)
    assert one.extent() == turned.extent() == pytest.approx((-1.0, 1.0, -0.5, 0.5))
    shades = Shades("slope (mrad)", -2.0, 2.0)
    first, second = (picture_figure([part], shades).axes[0].images[0] for part in (one, turned))
    np.testing.assert_array_equal(first.get_array(), second.get_array())
    np.testing.assert_array_equal(first.get_array(), one.array)
    assert first.origin == "lower"
    assert tuple(first.get_extent()) == pytest.approx(one.extent())


def test_no_value_is_grey_also_everywhere():
    nothing = Raster(raster().array * np.nan)
    for scale in (about_zero, from_zero, within):
        figure = picture_figure([nothing], scale("slope (mrad)", [nothing.values]))
        drawn = figure.axes[0].images[0]
        assert np.ma.getmaskarray(np.ma.asarray(drawn.get_array())).all()
        assert tuple(drawn.get_cmap().get_bad()) == to_rgba(NO_VALUE)
        assert is_inside(figure)


def test_outlines_are_on_every_picture_and_named_on_the_first():
    figure = picture_figure([raster()] * 2, Shades("slope (mrad)", -1.0, 1.0))
    for axes in figure.axes[:2]:
        boxes = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
        assert [box.get_x() for box in boxes] == pytest.approx([-3.465, 0.035])
        assert [box.get_width() for box in boxes] == pytest.approx([3.43, 3.43])
    assert [[text.get_text() for text in axes.texts] for axes in figure.axes[:2]] == [["1", "2"], []]


def test_kinds_have_a_legend_of_those_that_there_are():
    plane = raster(outlined=False)
    kinds = Kinds({0: ("usable", "#ffffff"), 1: ("dark", "#000000"), 4: ("saturated", "#D55E00")})
    flags = xr.where(plane.array["y"] > 0, 4.0, 0.0 * plane.array).transpose("z", "y")
    figure = picture_figure([Raster(flags)], kinds)
    (drawn,) = figure.axes[0].images
    colours = np.asarray(drawn.cmap(drawn.norm(np.ma.asarray(drawn.get_array()))))
    assert tuple(colours[0, -1]) == to_rgba("#D55E00")
    assert tuple(colours[0, 0]) == to_rgba("#ffffff")
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["usable", "saturated"]
    assert is_inside(figure)
    assert not picture_figure([Raster(flags * np.nan)], kinds).legends


SITE = "POLYGON ((-200 -80, 200 -80, 200 300, -200 300, -200 -80), (-10 -10, 10 -10, 10 10, -10 -10))"
ROAD = "MULTIPOLYGON (((20 0, 40 0, 40 90, 20 90, 20 0)), ((-40 0, -20 0, -20 90, -40 90, -40 0)))"


def test_fields_have_their_boundary_and_lines_of_their_ground():
    plain = result(heliostats=40)
    data = plain.assign_attrs(layout_boundary=SITE, layout_exclude=ROAD).assign_coords(z=0.05 * plain["x"])
    values = plain["optical_efficiency"].to_numpy()
    shades = within("efficiency (1)", [values])
    maps = [field_map(one, values, "") for one in (plain, data)]
    assert all(maps)
    level, ground = (picture_figure([one], shades) for one in maps if one)
    assert not [patch for patch in level.axes[0].patches if isinstance(patch, Polygon)]
    assert not level.legends
    shapes = [patch for patch in ground.axes[0].patches if isinstance(patch, Polygon)]
    assert len(shapes) == 4  # the boundary and its hole, two roads
    assert shapes[0].get_xy().max(axis=0).tolist() == [200, 300]
    assert [text.get_text() for text in ground.legends[0].get_texts()] == ["boundary", "no heliostats"]
    assert [isinstance(one, ContourSet) for one in ground.axes[0].collections].count(True) == 1
    assert is_inside(ground)
    said = [symbols([one]) for one in maps if one]
    assert "boundary" not in said[0]
    assert "Dashed: boundary" in said[1]
    assert "height of the ground" in said[1]


def test_a_row_of_mirrors_has_no_lines_of_the_ground():
    data = result(heliostats=8)
    row = np.arange(8.0)
    data = data.assign_coords(x=("heliostat", 10 * row), y=("heliostat", 10 * row), z=("heliostat", row))
    one = field_map(data, row, "")
    assert one is not None
    assert not any(
        isinstance(each, ContourSet) for each in picture_figure([one], within("", [row])).axes[0].collections
    )
