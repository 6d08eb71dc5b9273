"""Layouts along an axis of the grid: how long they are, and when there are too many."""

from __future__ import annotations

import time
from typing import Any

import pytest

from heliosweep import api
from heliosweep.errors import PlanError
from heliosweep.grid.layout_axis import longest


def rings(**keys: Any) -> dict[str, Any]:
    return {"radial_stagger": {"clearance": 13, "inner_radius": 50} | keys}


@pytest.mark.parametrize(
    ("layout", "axis"),
    [
        (rings(rings=2), ""),
        (rings(rings=2, clearance={"start": 13, "stop": 14, "num": 10**12}), "clearance"),
        (rings(rings=2, clearance=[13, 14], inner_radius={"start": 50, "stop": 60, "num": 10**13}), "inner_radius"),
        (rings(heliostats={"start": 1, "stop": 10**6, "step": 1}), "heliostat_count"),
    ],
)
def test_too_many_layouts_are_refused_at_once(small, layout, axis):
    study = small(layout=layout, heliostat={"width": 5, "height": 5, "pivot_height": 4})
    start = time.process_time()
    if axis:
        with pytest.raises(PlanError, match=f"layouts are more than .*; shrink '{axis}' first"):
            api.plan(study)
    else:
        api.plan(study)
    assert time.process_time() - start < 2


def test_the_longest_layout(small):
    assert longest(small(layout=rings(heliostats=31))) == 31
    start = time.process_time()
    many = {"start": 50, "stop": 50_000, "step": 10}
    assert longest(small(layout=rings(heliostats=many))) == 50_000
    assert time.process_time() - start < 3
    two = longest(small(layout=rings(rings=2)))
    assert longest(small(layout=rings(rings=[2, 1]))) == two
