"""The radial-stagger generator: the paper's field, the clearance everywhere, impossible parameters."""

import math
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from heliosweep.config.layouts import Zone
from heliosweep.errors import StudyError
from heliosweep.layouts import Layout, radial_stagger, read_csv
from heliosweep.layouts.patterns import rows, spiral

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
