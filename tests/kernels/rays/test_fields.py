"""Whole fields against references of 5e9 to 7e10 rays; see `fields`."""

import numpy as np
import pytest

from heliosweep.kernels import rays
from tests.kernels.rays.fields import INSTANTS, REFERENCE, YEARS, compare, field


@pytest.mark.parametrize("name", YEARS[1:])  # the first: families/field_efficiency/test_compute.py
def test_years_at_the_default_precision(name):
    made, share = field(name)
    weight = REFERENCE["year_weight"]
    each = rays.rays_for(
        made, REFERENCE["year_sun"], np.stack((weight, weight)), cells=(20, 36), share=share
    )  # fmt: skip
    row = compare(name, each)
    assert row["cosine"] < 1e-7
    assert abs(row["field"]) < 2e-4
    assert row["heliostat"] < 2e-3
    assert row["cell"] < 0.015
    assert abs(row["peak"]) < 0.01


@pytest.mark.parametrize("instant", [1, *(pytest.param(k, marks=pytest.mark.long) for k in (0, 2, 3))])
@pytest.mark.parametrize("name", INSTANTS)
def test_instants(name, instant):
    # The worst of 700 cells that share the light of flat mirrors takes more rays.
    row = compare(name, 262_144 if name == "flat_polar" else 65_536, instant, seed=1)
    assert abs(row["field"]) < 1e-4
    assert row["heliostat"] < 1e-3
    assert row["cell"] < 0.02
    for key in ("unshaded", "unblocked", "both"):
        assert row[key] < 1e-3
