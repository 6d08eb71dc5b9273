"""Layouts along an axis of the grid: how long they are, when there are too many, and that each is as if alone."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from heliosweep import api
from heliosweep.errors import PlanError
from tests.conftest import SMALL
from tests.families.field_efficiency.test_energy import BLOCKS, LIMITS
from tests.families.misalignment import test_detectors as detectors
from tests.families.misalignment.studies import CALIBRATION, CURVES, MOUNT_ERRORS
from tests.families.misalignment.test_mount_errors import ALL_DRAWN


def rings(**keys: Any) -> dict[str, Any]:
    return {"radial_stagger": {"clearance": 13, "inner_radius": 50} | keys}


@pytest.mark.parametrize(
    ("layout", "axis"),
    [
        (rings(rings=2), ""),
        (rings(rings=2, clearance={"start": 13, "stop": 14, "num": 10**6}), "clearance"),
        (rings(rings=2, clearance={"start": 13, "stop": 14, "num": 5120}), ""),
        (rings(rings=2, clearance=[13, 14], inner_radius={"start": 50, "stop": 60, "num": 10**6}), "inner_radius"),
        (
            rings(
                rings=2,
                clearance={"start": 13, "stop": 14, "num": 10**5},
                inner_radius={"start": 50, "stop": 60, "num": 10**6},
            ),
            "inner_radius",
        ),
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


#: Studies whose layout is replaced.
CASES: dict[str, dict[str, Any]] = {
    "field": {**SMALL, "output": {"field_geometry": True, "tracking_angles": True}},
    "energy": {**SMALL, **BLOCKS, "limits": LIMITS},
    "curves": CURVES,
    "errors of mounts": MOUNT_ERRORS,
    "drawn errors": {**MOUNT_ERRORS, "mount_errors": {**ALL_DRAWN, "samples": 9, "seed": 7}},
    "calibration": {**CALIBRATION, "calibration": {"parameters": 4, "noise": 0.01}},
    "detectors": detectors.BASE,
}


@pytest.mark.parametrize("content", CASES.values(), ids=CASES)
def test_a_layout_beside_a_longer_one_gives_what_it_gives_alone(content):
    if content["family"] == "misalignment":
        content = {**content, "heliostats": {"pivot_height": 5}, "receiver": {**content["receiver"], "tilt": -60}}

    def result(count: Any) -> Any:
        layout = rings(inner_radius=60, heliostats=count)
        return api.build(api.load({**content, "layout": layout})).compute()

    both, alone = result([3, 5]), result(3)
    assert both.sizes["heliostat"] == 5
    first = both.sel(heliostat_count=3)
    for name, values in alone.data_vars.items():
        here = first[name]
        if "heliostat" in values.dims:
            padding = here.isel(heliostat=slice(3, None))
            missing = padding.isnull() if padding.dtype.kind in "fM" else padding <= 0
            assert bool(missing.all()) or name == "true_error", name  # which is told of every number
            here = here.isel(heliostat=slice(3))
        np.testing.assert_array_equal(here, values, err_msg=str(name))
