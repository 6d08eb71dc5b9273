"""Panels of curves and of points with unequal error bars over words: places, marks, floors and the legend."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

from heliosweep.report.labels import TICK_LETTERS, folded
from heliosweep.report.panels import Panel, curve_figure
from heliosweep.report.style import image, pixels
from tests.report.synthetic import is_inside

METHODS = ["A", "O1", "O2", "LM"]


def over(values, words=METHODS):
    return xr.DataArray(np.asarray(values, float), {"method": list(words)}, "method")


def panel(scale=1.0, title="jose, module 2", marks=None):
    value = over(scale * np.array([14.0, 15.0, 0.5, 1e-9]))
    lines = {"none": value, "exact": over([0.1, 0.2, np.nan, np.nan])}
    return Panel("error of a slope\n(% of 1 mrad)", lines, title, {"none": (value * 0.5, value * 1.5)}, marks)


def points(axes):
    """Places and values of all points of a panel, those with and without a filling."""
    return [(np.asarray(line.get_xdata()), np.asarray(line.get_ydata()), line) for line in axes.get_lines()]


@pytest.mark.parametrize("columns", [1, 2, 4])
@pytest.mark.parametrize("floor", [None, 1e-3])
def test_nothing_is_cut_off(columns, floor):
    panels = [panel(scale) for scale in (1.0, 3.0) for _ in range(columns)]
    options = {"columns": columns, "same_scale": "row", "floor": floor, "legend_title": "referential"}
    figure = curve_figure(panels, "method", **options)
    assert len(figure.axes) == 2 * columns
    assert is_inside(figure)
    assert columns != 2 or image(figure) == image(curve_figure(panels, "method", **options))


def test_titles_are_no_wider_than_their_panels_as_drawn():
    titles = ["e = 26.361 (elevation), 1.496 (azimuth) i"[:letters] for letters in range(30, 42)]
    figure = curve_figure([panel(title=title) for title in titles], "method", columns=3)
    pixels(figure)
    for axes in figure.axes:
        assert axes.title.get_window_extent().width <= 1.03 * axes.get_window_extent().width


def test_bars_reach_from_low_to_high_and_those_at_one_word_stand_apart():
    (axes,) = curve_figure([panel()], "method").axes
    drawn: list[Any] = list(axes.collections)
    bars = [segment for one in drawn for segment in one.get_segments() if len(segment) == 2]
    assert sum(list(segment[:, 1]) == [7.0, 21.0] for segment in bars) == 1
    places = np.concatenate([x[np.isfinite(y)] for x, y, line in points(axes) if line.get_marker() in "os"])
    at_a = np.sort(places[np.abs(places) < 0.5])
    assert at_a.size == 2
    assert at_a[1] - at_a[0] > 0.1
    assert 2.0 in places  # alone in the middle


def test_values_below_the_floor_stand_on_it_without_a_filling():
    (axes,) = curve_figure([panel()], "method", floor=1e-3).axes
    assert axes.get_yscale() == "log"
    ((x, y, _),) = [one for one in points(axes) if one[2].get_markerfacecolor() == "white"]
    assert (list(x), list(y)) == ([3.0], [1e-3])
    assert axes.get_ylim()[0] == 1e-3


def test_marks_are_bars_across_the_place_and_named_once():
    figure = curve_figure([panel(marks=over([15.5, 14.7, 0.5, np.nan]))], "method", floor=1e-3, mark="published")
    drawn: list[Any] = list(figure.axes[0].collections)
    black = [one for one in drawn if np.allclose(one.get_color(), [[0, 0, 0, 1]])]
    assert [segment[0, 1] for segment in black[0].get_segments() if len(segment)][:3] == [15.5, 14.7, 0.5]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["none", "exact", "published"]
    empty = curve_figure([panel(marks=over([np.nan] * 4))], "method", mark="published")
    assert [text.get_text() for text in empty.legends[0].get_texts()] == ["none", "exact"]


@pytest.mark.parametrize("floor", [None, 1e-3])
def test_nothing_known_and_a_single_unnamed_series(floor):
    figure = curve_figure([Panel("error (%)", {"": over([np.nan] * 4)})], "method", floor=floor)
    assert not figure.legends
    assert is_inside(figure)


def test_long_words_are_written_upwards():
    words = [f"heliostat {i} with a long name" for i in range(6)]
    figure = curve_figure([Panel("error (%)", {"": over(np.arange(6.0), words)})] * 3, "heliostat", columns=3)
    assert figure.axes[0].get_xticklabels()[0].get_rotation() == 90
    assert is_inside(figure)


def test_curves_run_in_the_order_of_their_numbers_and_long_texts_are_broken():
    line = xr.DataArray([3.0, 1.0, 2.0], {"tilt": [3.0, 1.0, 2.0]}, "tilt")
    label = "a label that is far too long for the axes that it belongs to, whatever its unit (mrad)"
    title = "a title that says where, when, how and why all of this was computed, and then goes on"
    figure = curve_figure([Panel(label, {"a": line, "b": 2 * line}, title)] * 4, label)
    np.testing.assert_array_equal(figure.axes[0].get_lines()[0].get_ydata(), [1.0, 2.0, 3.0])
    assert figure.axes[0].get_title().replace("\n", " ") == title
    boxes = [axes.title.get_window_extent() for axes in figure.axes[:2]]
    assert not boxes[0].overlaps(boxes[1])
    assert is_inside(figure)


def test_long_words_along_an_axis_stand_on_two_lines():
    assert folded("factor on the direct normal irradiance", 1) == "factor on the direct\nnormal irradiance"
    assert folded("reflectivity", 2) == "reflectivity"
    first, second = folded("direction in which the foot of the azimuth axis leans, clockwise", 3).split("\n")
    assert max(len(first), len(second)) <= TICK_LETTERS
    assert second.endswith("\N{HORIZONTAL ELLIPSIS} (3)")


def test_long_names_stand_whole_in_a_legend():
    names = [f"Plataforma Solar de Almería, Tabernas, Spain, field {number} of the year" for number in range(5)]
    line = xr.DataArray([3.0, 1.0], {"tilt": [3.0, 1.0]}, "tilt")
    figure = curve_figure([Panel("efficiency (%)", {name: number * line for number, name in enumerate(names)})], "tilt")
    assert [text.get_text().replace("\n", " ") for text in figure.legends[0].get_texts()] == names
    assert is_inside(figure)
