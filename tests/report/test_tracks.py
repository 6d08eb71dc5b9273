"""Panels on a plane: equal metres, apertures, frames that hold what is drawn, colours by a number, texts at ends."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.patches import Ellipse as EllipsePatch
from matplotlib.patches import Rectangle

from heliosweep.report.pictures import Shades
from heliosweep.report.style import image
from heliosweep.report.tracks import APERTURE, RIM, Ellipse, Plane, Track, cut, frames, plane_figure
from tests.report.synthetic import is_inside

CURVE = {"color": "#D55E00"}
POINTS = {"color": "#0072B2", "linestyle": "", "marker": "o"}
LABELS = ("to the right (m)", "up (m)")
ROUND = np.linspace(0, 2 * np.pi, 30)


def circle(radius, look=CURVE, **others):
    return Track(radius * np.cos(ROUND), radius * np.sin(ROUND), look, **others)


@pytest.mark.parametrize("panels", [1, 2, 3, 4, 7])
@pytest.mark.parametrize("scale", [None, Shades("hour (h)", 6.0, 18.0)])
def test_a_metre_is_as_long_along_both_axes_and_nothing_is_cut_off(panels, scale):
    planes = [Plane(f"panel {i}", [circle(3.0 + 8 * i, text="12 h")], (), (9.0, 4.0)) for i in range(panels)]
    figure = plane_figure(planes, LABELS, scale=scale)
    width, height = figure.get_size_inches()
    assert len(figure.axes) == panels + (scale is not None)
    for axes in figure.axes[:panels]:
        box = axes.get_position()
        x, y = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
        assert box.width * width / x == pytest.approx(box.height * height / y)
        (aperture,) = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
        assert (aperture.get_width(), aperture.get_height()) == (9.0, 4.0)
    assert is_inside(figure)
    assert panels != 3 or image(figure) == image(plane_figure(planes, LABELS, scale=scale))


def test_panels_share_their_ends_where_they_are_alike_only():
    alike = [Plane("", [circle(radius)]) for radius in (10.0, 12.0)]
    first, second = frames(alike)
    assert first == second
    small, large = frames([Plane("", [circle(radius)]) for radius in (1.0, 10.0)])
    assert np.ptp(small[0]) < np.ptp(large[0])
    near, alone = frames([alike[0], Plane("", [circle(9.5)], alone=True)])
    assert near != alone
    ((left, right), (bottom, top)) = frames([Plane("", [Track(np.array([0.0, 10]), np.array([0, 1.0]), CURVE)])])[0]
    assert (right - left, top - bottom) == pytest.approx((10 * (1 + 2 * RIM), 10 * (1 + 2 * RIM)))
    flat = Plane("", [Track(np.array([0.0, 10]), np.array([0, 1.0]), CURVE)], square=False)
    ((left, right), (bottom, top)) = frames([flat])[0]
    assert (right - left, top - bottom) == pytest.approx((10 * (1 + 2 * RIM), 1 + 2 * RIM))


def test_frames_leave_far_points_out_and_count_them():
    points = np.concatenate([np.random.default_rng(1).normal(0, 1, (100, 2)), [[1e6, 0.0], [0.0, -1e5]]])
    plane = Plane("", [Track(points[:, 0], points[:, 1], POINTS)])
    assert np.ptp(plane.ends()[0]) < 20
    assert cut([plane]) == 2


@pytest.mark.parametrize(
    "points",
    [np.empty((0, 2)), np.zeros((1, 2)), np.full((3, 2), 7.5), np.array([[1e-9, 0.0], [0.0, 1e-9]])],
)
def test_frames_of_little_have_a_size(points):
    for aperture in (None, (9.0, 4.0)):
        plane = Plane("", [Track(points[:, 0], points[:, 1], POINTS)], (), aperture)
        (left, right), (bottom, top) = plane.ends()
        assert right > left
        assert top > bottom
        assert cut([plane]) == 0


def test_missing_points_interrupt_lines_and_frame_nothing():
    x, y = np.array([0.0, np.nan, 2.0]), np.array([0.0, 1.0, np.inf])
    plane = Plane("", [Track(x, y, CURVE), Track(np.array([1e3]), np.array([0.0]), POINTS, framed=False)])
    assert np.array_equal(plane.points(), np.zeros((1, 2)))
    nothing = Plane("", [Track(np.full(3, np.nan), np.full(3, np.nan), CURVE, numbers=np.arange(3.0), text="a")])
    assert is_inside(plane_figure([nothing], LABELS, scale=Shades("hour (h)", 12.0, 12.0)))


def test_ellipses_of_a_covariance():
    turn = np.radians(30)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    covariance = rotation @ np.diag([9.0, 1.0]) @ rotation.T
    one = Ellipse(1.0, 2.0, covariance, CURVE)
    draws = np.random.default_rng(2).multivariate_normal([1, 2], covariance, 100_000)
    (axes,) = plane_figure([Plane("", [], [one, Ellipse(0.0, np.nan, covariance, CURVE)])], LABELS).axes
    (patch,) = [patch for patch in axes.patches if isinstance(patch, EllipsePatch)]
    assert (patch.width, patch.height) == pytest.approx((2 * 3 * 2.4477468306808166, 2 * 2.4477468306808166))  # chi2
    assert patch.angle % 180 == pytest.approx(30)
    inner = patch.get_path().contains_points(patch.get_patch_transform().inverted().transform(draws))
    assert inner.mean() == pytest.approx(0.95, abs=3e-3)
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    wide, high = one.reach()
    assert (wide, high) == pytest.approx(2.4477468306808166 * np.sqrt(np.diag(covariance)))
    assert left < 1 - wide < 1 + wide < right
    assert bottom < 2 - high < 2 + high < top


def test_numbers_colour_points_and_ellipses_by_the_scale():
    scale = Shades("hour (h)", 6.0, 18.0)
    ellipses = [Ellipse(0.0, 0.0, np.eye(2), CURVE, number=number) for number in (6.0, 18.0)]
    track = circle(2.0, POINTS, numbers=np.linspace(6, 18, ROUND.size))
    axes, bar = plane_figure([Plane("", [track], ellipses)], LABELS, scale=scale).axes
    (dots,) = axes.collections
    assert dots.get_clim() == (6.0, 18.0)
    np.testing.assert_array_equal(dots.get_array(), track.numbers)
    colours = dots.cmap([0.0, 1.0])
    edges: list[Any] = [patch.get_edgecolor() for patch in axes.patches]
    np.testing.assert_allclose(edges, colours)
    assert bar.get_xlabel() == "hour (h)"
    (plain,) = plane_figure([Plane("", [track], ellipses)], LABELS).axes
    assert plain.patches[0].get_edgecolor() == pytest.approx(to_rgba("#D55E00"))


def test_legend_names_what_is_drawn_but_for_what_has_no_name():
    plane = Plane("", [circle(1.0, name="curve"), circle(2.0, POINTS)], (), (1.0, 1.0))
    figure = plane_figure([plane], ("x (m)", "y (m)"), legend_title="which")
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["curve", APERTURE]
    assert legend.get_title().get_text() == "which"
    assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == ("x (m)", "y (m)")
    assert not plane_figure([Plane("", [circle(1.0)])], LABELS).legends


def test_texts_stand_at_the_ends_apart_from_each_other():
    turns = np.radians([0, 10, 20, 90, 180])
    tracks = [
        Track(np.array([0, np.cos(turn)]), np.array([0, np.sin(turn)]), CURVE, text=f"{i} h")
        for i, turn in enumerate(turns)
    ]
    figure = plane_figure([Plane("", tracks)], LABELS)
    texts = figure.axes[0].texts
    assert [text.get_text() for text in texts] == [track.text for track in tracks]
    boxes = [text.get_window_extent() for text in texts]
    assert not any(one.overlaps(other) for i, one in enumerate(boxes) for other in boxes[:i])
    to_data = figure.axes[0].transData.inverted()
    for box, turn in zip(boxes, turns, strict=True):
        x, y = to_data.transform(box.get_points().mean(axis=0))
        assert np.hypot(x - np.cos(turn), y - np.sin(turn)) < 0.5


def test_error_bars_are_framed():
    x = np.array([0.0, 1.0])
    track = Track(x, x, POINTS, half=np.array([3.0, np.nan]))
    (axes,) = plane_figure([Plane("", [track])], LABELS).axes
    assert len(axes.containers) == 1
    assert axes.get_ylim()[0] < -3
    assert axes.get_ylim()[1] > 3
