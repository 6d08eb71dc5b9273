"""Values with unequal error bars over words: places, marks, floors and the legend."""

from __future__ import annotations

import numpy as np
import pytest

from heliosweep.report.intervals import Around, Beside, Interval, Strip, interval_figure
from heliosweep.report.style import image

METHODS = ("A", "O1", "O2", "LM")
NOTHING = np.full(4, np.nan)


def panel(scale=1.0, title="jose, module 2", marks=None):
    value = scale * np.array([14.0, 15.0, 0.5, 1e-9])
    series = {
        "none": Interval(value, value * 0.5, value * 1.5),
        "exact": Interval(np.array([0.1, 0.2, np.nan, np.nan])),
    }
    return Beside(METHODS, series, title, marks)


def lines(axes):
    """Ends of all lines of a panel: x and y."""
    return [(np.asarray(line.get_xdata()), np.asarray(line.get_ydata()), line) for line in axes.get_lines()]


def inside(figure):
    box = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    return box.x0 >= -1e-9 and box.y0 >= -1e-9 and box.x1 <= width + 1e-9 and box.y1 <= height + 1e-9


@pytest.mark.parametrize("columns", [1, 2, 4])
@pytest.mark.parametrize("floor", [None, 1e-3])
def test_nothing_is_cut_off(columns, floor):
    strips = [Strip("error of a slope\n(% of 1 mrad)", [panel(scale)] * columns) for scale in (1.0, 3.0)]
    figure = interval_figure(strips, Around("method", "published", "referential"), floor=floor)
    assert len(figure.axes) == 2 * columns
    assert inside(figure)
    assert image(figure) == image(interval_figure(strips, Around("method", "published", "referential"), floor=floor))


def test_bars_reach_from_low_to_high_and_those_at_one_word_stand_apart():
    (axes,) = interval_figure([Strip("error (%)", [panel()])], Around()).axes
    assert sum(list(y) == [7.0, 21.0] for _, y, _ in lines(axes)) == 1
    points = [float(x[0]) for x, _, _ in lines(axes) if x.size == 1]
    at_a = sorted(x for x in points if abs(x) < 0.5)
    assert len(at_a) == 2
    assert at_a[1] - at_a[0] > 0.1
    assert 2.0 in points  # alone in the middle


def test_values_below_the_floor_stand_on_it_without_a_filling():
    (axes,) = interval_figure([Strip("error (%)", [panel()])], Around(), floor=1e-3).axes
    assert axes.get_yscale() == "log"
    ((_, y, low),) = [one for one in lines(axes) if list(one[0]) == [3.0]]
    assert list(y) == [1e-3]
    assert low.get_markerfacecolor() == "white"
    assert axes.get_ylim()[0] == 1e-3


def test_marks_are_bars_across_the_place_and_named_once():
    marks = np.array([15.5, 14.7, 0.5, np.nan])
    figure = interval_figure([Strip("error (%)", [panel(marks=marks)])], Around(mark="published"), floor=1e-3)
    assert [y[0] for _, y, line in lines(figure.axes[0]) if line.get_color() == "black"] == [15.5, 14.7, 0.5]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["none", "exact", "published"]
    empty = interval_figure([Strip("error (%)", [panel(marks=NOTHING)])], Around(mark="published"))
    assert [text.get_text() for text in empty.legends[0].get_texts()] == ["none", "exact"]


def test_nothing_known_and_a_single_unnamed_series():
    figure = interval_figure([Strip("error (%)", [Beside(METHODS, {"": Interval(NOTHING)})])], Around(), floor=1e-3)
    assert not figure.legends
    assert inside(figure)
    assert interval_figure([Strip("error (%)", [Beside(METHODS, {"": Interval(NOTHING)})])], Around()).axes


def test_long_words_are_written_upwards():
    words = ["a heliostat with a long name"] * 6
    figure = interval_figure(
        [Strip("error (%)", [Beside(words, {"": Interval(np.arange(6.0))})] * 3)], Around("heliostat")
    )
    assert figure.axes[0].get_xticklabels()[0].get_rotation() == 90
    assert inside(figure)
