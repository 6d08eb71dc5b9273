"""The radial-stagger generator: the paper's field, the clearance everywhere, impossible parameters."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from heliosweep.config.layouts import Zone
from heliosweep.errors import StudyError
from heliosweep.layouts import Layout, radial_stagger, read_csv

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
    layout = generated(zones)
    assert layout is None or least_distance(layout) >= 1 - 1e-12


def generated(zones: list[Zone]) -> Layout | None:
    """Return the layout, or None where a very wide pitch leaves no room for its rings."""
    try:
        return radial_stagger(1, zones=zones)
    except StudyError as error:
        if "rings fit before" in str(error):
            return None
        raise


def test_the_start_named_in_a_message_is_accepted():
    with pytest.raises(StudyError, match=r"at 113\.257 m or more \(got 113\.0\)"):
        radial_stagger(16, zones=[Zone(start=61.3, rings=4, pitch=15), Zone(start=113, rings=5)])
    assert counts(radial_stagger(16, zones=[Zone(start=61.3, rings=4, pitch=15), Zone(start=113.257, rings=1)])) == [
        24,
        24,
        24,
        24,
        44,
    ]


@pytest.mark.parametrize(
    ("parameters", "key", "words"),
    [
        ({"clearance": 10, "inner_radius": 4.9, "rings": 3}, "inner_radius", "half the clearance"),
        ({"clearance": 1e-6, "inner_radius": 50, "rings": 3}, "inner_radius", "more than 1,000,000"),
        ({"clearance": 10, "inner_radius": 50, "heliostats": 10**9}, "heliostats", "at most 1,000,000"),
        ({"clearance": 10, "inner_radius": 50, "rings": 10**5}, "rings", "more than 1,000,000"),
        ({"clearance": 10, "inner_radius": 40, "zones": [Zone(start=50, rings=2)]}, "inner_radius", "first zone"),
        ({"clearance": 10, "zones": [Zone(start=3, rings=2)]}, "zones.0.start", "half the clearance"),
        ({"clearance": 10, "zones": [Zone(start=50, rings=2), Zone(start=60, rings=2)]}, "zones.1.start", "at 68."),
        ({"clearance": 10, "zones": [Zone(start=50, rings=2, pitch=11.4)]}, "zones.0.pitch", "11.478"),
        ({"clearance": 10, "zones": [Zone(start=50, rings=40)]}, "zones.0.rings", "only"),
    ],
)
def test_impossible_parameters(parameters, key, words):
    with pytest.raises(StudyError) as caught:
        radial_stagger(**parameters)
    (problem,) = caught.value.problems
    assert problem.key == key
    assert words in problem.message
