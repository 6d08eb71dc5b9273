"""Ranking: best and worst, what a step away costs, and the table of all points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import xarray as xr
import yaml

from heliosweep.api import family_of, load
from heliosweep.config.load import load_mapping
from heliosweep.families.family import families, study_classes
from heliosweep.grid.regions import BEST_VALUE, LARGEST, SMALLEST
from heliosweep.report import ranking
from heliosweep.report.contents import Table
from heliosweep.report.ranking import MOST_CELLS, Ranking
from tests.conftest import SMALL

HEIGHTS, METHODS = [60.0, 80.0, 100.0], ["upright", "spinning"]
VALUES = np.array([[0.50, 0.60], [0.70, 0.65], [0.68, np.nan]])


def ranked(data: xr.Dataset, first: Sequence[str] = ()) -> Ranking:
    found = ranking.ranked(data, first)
    assert found is not None
    return found


def steps_of(found: Ranking) -> Table:
    assert found.steps is not None
    return found.steps


def swept(**more):
    share = {"units": "1", "valid_range": [0.0, 1.0], "long_name": "efficiency of the field", BEST_VALUE: LARGEST}
    error = {"units": "mrad", "long_name": "error", BEST_VALUE: SMALLEST}
    data = {
        "efficiency": (("height", "method"), VALUES, share),
        "mean_error": (("height", "method"), 1 - VALUES, error),
        "by_mirror": (("height", "method", "mirror"), np.ones((3, 2, 4)), share),
        **more,
    }
    labels = {"height": ("height", HEIGHTS, {"units": "m", "long_name": "height, of the receiver"}), "method": METHODS}
    return xr.Dataset(data, labels)


def test_best_and_worst_are_named_with_their_points():
    found = ranked(swept(), ("nothing", "efficiency"))
    assert found.ends.rows == [
        ["efficiency", "70 %", "height 80 m, method upright", "50 %", "height 60 m, method upright"],
        ["mean error", "0.3000 mrad", "height 80 m, method upright", "0.5000 mrad", "height 60 m, method upright"],
    ]
    assert found.count == 6


def test_what_a_step_away_costs():
    steps = steps_of(ranked(swept(), ["efficiency"]))
    assert steps.rows == [
        ["height", "80 m", "60 m", "\N{MINUS SIGN}20.00"],
        ["height", "80 m", "100 m", "\N{MINUS SIGN}2.00"],
        ["method", "upright", "spinning", "\N{MINUS SIGN}5.00"],
    ]
    assert steps.units[-1] == "percentage points"
    errors = steps_of(ranked(swept(), ["mean_error"]))
    assert [row[-1] for row in errors.rows] == ["+0.200", "+0.020", "+0.050"]


def test_all_points_stand_in_order_with_numbers_in_full():
    found = ranked(swept(), ["efficiency"])
    assert found.points.header == ["height", "method", "efficiency", "mean error"]
    assert found.points.units == ["m", "", "%", "mrad"]
    assert [row[2] for row in found.numbers[:-1]] == pytest.approx([70, 68, 65, 60, 50])
    assert [row[:2] for row in found.numbers] == [
        [80.0, "upright"], [100.0, "upright"], [80.0, "spinning"], [60.0, "spinning"], [60.0, "upright"],
        [100.0, "spinning"],
    ]  # fmt: skip
    assert found.numbers[-1][2] == ""
    assert found.points.rows[0] == ("80", "upright", "70", "0.3000")
    assert found.points.words == [1]


def test_keys_that_are_tied_are_told_too():
    data = xr.Dataset(
        {"efficiency": ("height", [0.4, 0.6], {BEST_VALUE: LARGEST})},
        {"height": ("height", [60.0, 80.0], {"units": "m"}), "width": ("height", [9.0, 11.0], {"units": "m"})},
    )
    found = ranked(data)
    assert found.ends.rows[0][2] == "height 80 m, width 11 m"
    assert found.points.header[:2] == ["height", "width"]


def test_heliostats_are_told_by_their_places():
    x, y = ("heliostat", [0.0, 40.04, 80.0]), ("heliostat", [61.26, 1e-15, 3.0])
    labels = {"heliostat": [0, 1, 2], "x": x, "y": y, "ring": ("heliostat", [1, 1, 2]), "scale": [0.5, 1.0]}
    hits = np.array([[0.9, 0.8, 0.7], [0.5, 0.4, 0.3]])
    found = ranked(xr.Dataset({"hits": (("scale", "heliostat"), hits, {BEST_VALUE: LARGEST})}, labels))
    assert [found.ends.rows[0][place] for place in (2, 4)] == [
        "scale 0.5, heliostat 0 at (0.0, 61.3) m",
        "scale 1, heliostat 2 at (80.0, 3.0) m",
    ]
    assert [row[0] for row in steps_of(found).rows] == ["scale"]
    assert found.points.rows[1][3] == "0"


def test_of_many_points_the_best_are_listed():
    data = xr.Dataset({"efficiency": ("n", np.random.default_rng(0).random(MOST_CELLS))})
    found = ranked(data)
    assert len(found.points.rows) == MOST_CELLS // 2
    assert found.numbers[0][1] == data.efficiency.max()
    assert "The 5,000 of 10,000 points with the largest efficiency" in found.points.notes[0]


@pytest.mark.parametrize(
    "data",
    [
        xr.Dataset(),
        xr.Dataset({"efficiency": ((), 0.5)}),
        xr.Dataset({"efficiency": ("n", [np.nan, np.nan])}),
        xr.Dataset({"name": ("n", ["a", "b"])}),
    ],
    ids=["nothing", "one point", "no value", "words"],
)
def test_nothing_to_rank(data):
    assert ranking.ranked(data) is None


def test_what_says_nothing_of_its_best_is_listed_and_not_judged():
    area = ("height", "method"), np.arange(6.0).reshape(3, 2), {"long_name": "error of the area"}
    found = ranked(swept(area=area), ["area"])
    assert [row[0] for row in found.ends.rows] == ["efficiency", "mean error"]
    assert found.steps is None
    assert [row[2] for row in found.numbers] == [5, 4, 3, 2, 1, 0]


@pytest.mark.parametrize("family", list(families()))
def test_families_say_which_values_are_best(family):
    """Of errors and losses the smallest, of efficiencies and energies the largest, of angles and areas none."""
    study = load_mapping(yaml.safe_load(families()[family].example()), study_classes())
    said = {name: one.attrs.get(BEST_VALUE) for name, one in families()[family].variables(study).items()}
    assert {*said.values()} <= {LARGEST, SMALLEST, None}
    assert any(said.values())
    for name, best in said.items():
        if name.endswith(("_rms", "_std", "standard_error", "tracking_error")):
            assert best == SMALLEST, name
        if name.endswith(("_efficiency", "hit_fraction", "tracking_factor")):
            assert best == LARGEST, name


def test_a_goal_of_a_search_says_what_was_sought():
    goal = {"maximise": ["optical_efficiency"], "over": {"receiver.height": [60, 100]}, "budget": 12}
    field = {**SMALL, "site": {"latitude": 40}, "tracking": "azimuth_elevation"}
    study: Any = load({**field, "search": goal})
    assert family_of(study).variables(study)["field_optical_efficiency"].attrs[BEST_VALUE] == LARGEST
    study = load({**field, "search": {**goal, "maximise": [], "minimise": ["optical_efficiency"]}})
    assert family_of(study).variables(study)["field_optical_efficiency"].attrs[BEST_VALUE] == SMALLEST
