"""Spiral and rows: the published formula, distances, exact counts, the nearest first."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from heliosweep.layouts.ground import Region
from heliosweep.layouts.patterns import rows, spiral


def test_the_spiral_of_the_paper():
    # Noone, Torrilhon and Mitsos 2012: theta = 2 pi k / phi^2 and r = a k^b; near their optimum for PS10, a = 4.5 and
    # b = 0.65. The golden angle is 137.507764 deg; the others are its multiples.
    layout = spiral(4.5, 0.65, 0.0, heliostats=100)
    assert layout.columns["turn"].tolist() == list(range(1, 101))
    radius, azimuth = np.hypot(layout.x, layout.y), np.degrees(np.arctan2(layout.x, layout.y)) % 360
    picked = [0, 1, 9, 99]
    np.testing.assert_allclose(azimuth[picked], [137.507764, 275.015528, 295.077641, 70.776405], rtol=0, atol=1e-6)
    np.testing.assert_allclose(radius[picked], [4.5, 7.061257, 20.100762, 89.786804], rtol=0, atol=1e-6)


@settings(max_examples=30)
@given(
    b=st.floats(0.4, 0.8), inner=st.floats(0, 80), number=st.integers(1, 400), width=st.floats(5, 360),
    middle=st.floats(-360, 360),
)  # fmt: skip
def test_a_spiral_has_the_first_heliostats_with_room(b, inner, number, width, middle):
    region = Region(((middle, width),))
    layout = spiral(5.0, b, inner, number, region)
    assert len(layout) == number
    last = int(layout.columns["turn"][-1])
    whole = spiral(5.0, b, 0.0, last)
    there = region.inside(whole.x, whole.y) & (np.hypot(whole.x, whole.y) >= inner)
    np.testing.assert_array_equal(layout.columns["turn"], whole.columns["turn"][there])
    np.testing.assert_array_equal(layout.x, whole.x[there])


@pytest.mark.parametrize(("pattern", "least"), [("straight", 12.0), ("staggered", 12.0)])
def test_rows(pattern, least):
    layout = rows(15.0, 12.0, 30.0, pattern=pattern, heliostats=300)
    row, x = layout.columns["row"], layout.x
    np.testing.assert_allclose(layout.y, 12.0 * row, atol=1e-12)
    offset = 7.5 * (row % 2) if pattern == "staggered" else 0.0
    np.testing.assert_allclose((x - offset) % 15.0 % 15.0, 0.0, atol=1e-9)
    points = np.column_stack([layout.x, layout.y])
    apart = KDTree(points).query(points, k=2)[0][:, 1].min()
    assert apart == pytest.approx(math.hypot(7.5, 12) if pattern == "staggered" else least)


@settings(max_examples=30)
@given(
    spacing=st.floats(3, 30), distance=st.floats(3, 30), inner=st.floats(0, 100), azimuth=st.floats(-360, 360),
    pattern=st.sampled_from(["straight", "staggered"]), number=st.integers(1, 500), width=st.floats(20, 360),
)  # fmt: skip
def test_rows_have_the_nearest_heliostats_with_room(spacing, distance, inner, azimuth, pattern, number, width):
    region = Region(((10.0, width),))
    layout = rows(spacing, distance, inner, azimuth, pattern, number, region)
    more = rows(spacing, distance, inner, azimuth, pattern, number + 50, region)
    assert len(layout) == number
    assert region.inside(layout.x, layout.y).all()
    far, there = np.hypot(layout.x, layout.y), set(zip(layout.x.tolist(), layout.y.tolist(), strict=True))
    assert far.min() >= inner
    left_out = [
        math.hypot(*place) for place in zip(more.x.tolist(), more.y.tolist(), strict=True) if place not in there
    ]
    assert len(left_out) == 50
    assert min(left_out) >= far.max() - 1e-8


def test_rows_turn_with_their_azimuth():
    north, east = (rows(15.0, 12.0, 0.0, azimuth, heliostats=200) for azimuth in (0.0, 90.0))
    np.testing.assert_allclose(east.x, north.y, atol=1e-9)
    np.testing.assert_allclose(east.y, -north.x, atol=1e-9)
