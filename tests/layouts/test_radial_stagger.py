"""The radial-stagger generator: the paper's field, the clearance everywhere, impossible parameters."""

import math
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from heliosweep.config.blocks import Zone
from heliosweep.errors import StudyError
from heliosweep.kernels.field import efficiency, packets
from heliosweep.layouts import Layout, radial_stagger, read_csv
from heliosweep.layouts.ground import Region
from heliosweep.layouts.patterns import Spacing, rows, spiral

CHONG = Path(__file__).parents[2] / "studies" / "layouts" / "chong2012.csv"


def least_distance(layout: Layout) -> float:
    """Return the least distance between two centres."""
    points = np.column_stack([layout.x, layout.y])
    return KDTree(points).query(points, k=2)[0][:, 1].min()


def counts(layout: Layout) -> list[int]:
    return np.bincount(layout.columns["ring"])[1:].tolist()


def test_field_of_the_paper():
    # Chong and Tan 2012, Table 1: counts as printed, radii as printed to the 0.1 m of the table.
    published = read_csv(CHONG)
    layout = radial_stagger(16, zones=[Zone(start=61.3, rings=4, pitch=15), Zone(start=114, rings=5)])
    assert counts(layout) == counts(published) == [24, 24, 24, 24, 44, 44, 44, 44, 45]
    np.testing.assert_array_equal(layout.columns["ring"], published.columns["ring"])
    np.testing.assert_allclose(layout.columns["azimuth"], published.columns["azimuth"], rtol=0, atol=1e-10)
    radius, printed = np.hypot(layout.x, layout.y), np.hypot(published.x, published.y)
    np.testing.assert_allclose(radius, printed, rtol=0, atol=0.1)


def test_automatic_zones_give_nearly_the_field_of_the_paper():
    layout = radial_stagger(16, 61.3, rings=9)
    assert counts(layout) == [24, 24, 24, 24, 44, 44, 44, 44, 44]
    radius = np.hypot(layout.x, layout.y)[np.unique(layout.columns["ring"], return_index=True)[1]]
    # The second zone starts at 113.3 m, one clearance outside the first, instead of the 114 m of the paper.
    printed = [61.3, 74.6, 86.6, 97.2, 114, 127.6, 140.5, 152.8, 164.3]
    np.testing.assert_allclose(radius, printed, rtol=0, atol=0.9)


@settings(deadline=None, max_examples=150)
@given(start=st.floats(0.5, 60), widening=st.floats(1, 1.8), rings=st.integers(1, 5), gap=st.floats(0, 3))
def test_clearance_holds_in_given_zones(start, widening, rings, gap):
    finest = 2 * math.degrees(math.asin(0.5 / start))
    zones = [
        Zone(start=start, rings=rings, pitch=min(finest * widening, 180)),
        Zone(start=start + rings + gap, rings=3),
    ]
    try:
        assert least_distance(radial_stagger(1, zones=zones)) >= 1 - 1e-12
    except StudyError as error:  # a very wide pitch leaves no room for its rings
        if "rings fit before" not in str(error):
            raise


def test_the_start_named_in_a_message_is_accepted():
    with pytest.raises(StudyError, match=r"at 113\.257 m or more \(got 113\.0\)"):
        radial_stagger(16, zones=[Zone(start=61.3, rings=4, pitch=15), Zone(start=113, rings=5)])
    found = radial_stagger(16, zones=[Zone(start=61.3, rings=4, pitch=15), Zone(start=113.257, rings=1)])
    assert counts(found) == [24, 24, 24, 24, 44]


TEN = partial(radial_stagger, 10)


@pytest.mark.parametrize(
    ("make", "key", "words"),
    [
        (partial(TEN, 4.9, rings=3), "inner_radius", "half the clearance"),
        (partial(radial_stagger, 1e-6, 50, rings=3), "inner_radius", "more than 1,000,000"),
        (partial(TEN, 50, heliostats=10**9), "heliostats", "at most 1,000,000"),
        (partial(TEN, 50, rings=10**5), "rings", "more than 1,000,000"),
        (partial(TEN, 40, zones=[Zone(start=50, rings=2)]), "inner_radius", "first zone"),
        (partial(TEN, zones=[Zone(start=3, rings=2)]), "zones.0.start", "half the clearance"),
        (partial(TEN, zones=[Zone(start=50, rings=2), Zone(start=60, rings=2)]), "zones.1.start", "at 68."),
        (partial(TEN, zones=[Zone(start=50, rings=2, pitch=11.4)]), "zones.0.pitch", "11.478"),
        (partial(TEN, zones=[Zone(start=50, rings=40)]), "zones.0.rings", "only"),
        (partial(spiral, 4.5, 2.0, 60.0, 10**6), "heliostats", "only 146 fit"),
        (partial(spiral, 4.5, 0.1, 60.0, 10**6), "b", "more than 4,000,000 positions"),
        (partial(spiral, 1e-3, 0.5, 1e3, 10), "b", "more than 4,000,000 positions"),
        (partial(rows, 0.001, 0.001, 50.0, heliostats=10), "spacing", "more than 4,000,000 positions"),
        (partial(rows, 5.0, 5.0, 0.0, heliostats=2 * 10**6), "heliostats", "at most 1,000,000"),
    ],
)
def test_impossible_parameters_of_generators(make, key, words):
    with pytest.raises(StudyError) as caught:
        make()
    (problem,) = caught.value.problems
    assert problem.key == key
    assert words in problem.message


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


def test_delsol_as_published():
    # Kistler 1986, as SolarPILOT has it from the code of DELSOL3; texts print it with four digits.
    for t in np.linspace(0.1, 1.4, 14):
        fit = Spacing("delsol", math.tan(t), 10.0, 1.0)
        assert 2 * fit.step(1.0) == pytest.approx(1.144 / math.tan(t) - 1.094 + 3.068 * t - 1.1256 * t**2, abs=4e-3)
        assert fit.apart(1.0) == pytest.approx(10 * (1.749 + 0.6396 * t) + 0.2873 / (t - 0.04902), abs=1e-2)
    fit = Spacing("delsol", math.tan(0.5), 1.0, 1.0)
    assert 2 * fit.step(1.0) == pytest.approx(2.253786, abs=1e-6)
    assert fit.apart(1.0) == pytest.approx(2.132606, abs=1e-6)


def test_no_blocking_is_just_met():
    """Two mirrors on one azimuth with the sun behind the tower, seen from the farther one at the same elevation."""
    receiver, side, near = 80.0, 8.0, 150.0
    step = Spacing("no_blocking", receiver, side, side).step(near)
    for radius, blocked in ((near + 2 * step, False), (near + 1.96 * step, True)):
        y = np.array([near, radius])
        sun = np.array([[0.0, -radius, receiver]]) / math.hypot(radius, receiver)
        half, ground = np.full(2, side / 2), np.zeros(2)
        field = efficiency.sorted_field(ground, y, ground, half, half, receiver)
        values = efficiency.field_series(field, packets.AZIMUTH_ELEVATION, sun, 0, 2)
        blocking = values[2][0, 1]
        assert (blocking < 1) == blocked


@settings(max_examples=30)
@given(
    rule=st.sampled_from(["delsol", "no_blocking"]), clearance=st.floats(0.2, 30), inner=st.floats(0.6, 3),
    height=st.floats(2, 14), width=st.floats(2, 14), rings=st.integers(2, 30),
)  # fmt: skip
def test_rings_keep_clearance_and_spacing(rule, clearance, inner, height, width, rings):
    receiver = 100.0
    spacing = Spacing(rule, receiver, width, height)
    start = max(inner * receiver, clearance)
    layout = radial_stagger(clearance, start, rings=rings, spacing=spacing)
    points = np.column_stack([layout.x, layout.y])
    assert KDTree(points).query(points, k=2)[0][:, 1].min() >= clearance * (1 - 1e-9)
    ring = layout.columns["ring"]
    radius = np.array([np.hypot(*points[ring == number].T).mean() for number in np.unique(ring)])
    steps = np.array([spacing.step(one) for one in radius])
    assert (np.diff(radius) >= steps[:-1] * (1 - 1e-9)).all()
    if rule == "no_blocking":  # two rings on, on the same azimuth where the zone is the same
        free = radius + 2 * steps
        assert (radius[2:] >= free[:-2] * (1 - 1e-9)).all()
    else:
        for number in np.unique(ring):
            azimuth = np.sort(layout.columns["azimuth"][ring == number])
            zone = radius[radius >= 0.7 * radius[number - 1]]  # the ring in which its zone begins is one of these
            least = min(spacing.apart(one) for one in zone[zone <= radius[number - 1]])
            if azimuth.size > 2:
                chord = 2 * radius[number - 1] * math.sin(math.radians(np.diff(azimuth).min()) / 2)
                assert chord >= least * (1 - 1e-6)
