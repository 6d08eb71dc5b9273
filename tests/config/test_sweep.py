"""Sweeps: exact decimals, lazy, all forms."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heliosweep.config.faults import Invalid
from heliosweep.config.sweep import Geometric, Listed, Range, read_sweep


def sweep(raw: Any) -> Any:
    return read_sweep(raw, float)


def test_ranges_have_clean_decimals() -> None:
    hours = sweep({"start": 8, "stop": 16, "step": 0.2}).values()
    assert hours.tolist() == [float(f"{8 + i // 5}.{2 * (i % 5)}") for i in range(41)]
    assert sweep({"start": 0, "stop": 5, "num": 101}).values()[3] == 0.15
    assert sweep({"start": 0, "stop": -0.3, "step": -0.1}).values().tolist() == [0.0, -0.1, -0.2, -0.3]


@given(
    start=st.decimals(-1000, 1000, places=3),
    step=st.decimals("0.001", 10, places=3),
    num=st.integers(1, 300),
)
@settings(max_examples=50, derandomize=True, deadline=None)
def test_each_value_is_the_float_nearest_to_the_decimal(start: Any, step: Any, num: int) -> None:
    stop = start + step * (num - 1)
    exact = [float(start + i * step) for i in range(num)]
    by_step = sweep({"start": float(start), "stop": float(stop), "step": float(step)})
    by_num = sweep({"start": float(start), "stop": float(stop), "num": num})
    assert by_step.values().tolist() == exact
    assert by_step == by_num
    assert [by_num[i] for i in range(num)] == exact


def test_both_ends_only_where_they_fall_on_the_step() -> None:
    assert sweep({"start": 0, "stop": 350, "step": 15}).last == 345
    assert sweep({"start": 0, "stop": 345, "step": 15}).last == 345
    assert sweep({"start": 0, "stop": 1, "step": 1 / 3}).values().tolist() == [0, 1 / 3, 2 / 3, 1]


def test_a_stop_within_rounding_of_the_step_counts() -> None:
    assert len(sweep({"start": 0, "stop": 1, "step": 0.1 * (1 + 1e-12)})) == 11


def test_huge_ranges_are_not_expanded() -> None:
    many = sweep({"start": 0, "stop": 1, "num": 10**12})
    assert len(many) == 10**12
    assert (many.first, many.last) == (0.0, 1.0)
    assert many[10**11] == float(Fraction(10**11, 10**12 - 1))
    assert many[-3:].shape == (3,)


def test_values_slices_and_items_agree() -> None:
    for one in (
        Range(0.1, 0.7, 4),
        Range(1 / 3, 2.0, 7),
        Range(-1e-300, 1e300, 5),
        Geometric(0.001, 1000.0, 7),
        Geometric(-1.0, -8.0, 4),
        Listed((3.0, 1.0, 2.0)),
    ):
        values = one.values()
        assert values.dtype == np.float64
        assert [one[i] for i in range(len(one))] == values.tolist()
        assert one[1:3].tolist() == values[1:3].tolist()
        assert one[-1] == one.last == values[-1]
        with pytest.raises(IndexError):
            one[len(one)]


def test_names() -> None:
    names = Listed(("a", "b"))
    assert names.values() == ("a", "b")
    assert names[1] == "b"


def test_decades_are_clean() -> None:
    assert Geometric(0.001, 1000.0, 7).values().tolist() == [0.001, 0.01, 0.1, 1.0, 10.0, 100.0, 1000.0]


def test_midpoints() -> None:
    assert Range(8.0, 16.0, 41).midpoints().values().tolist() == [float(f"{(81 + 2 * i) / 10:.1f}") for i in range(40)]


def test_the_compact_form_reads_back() -> None:
    for raw in ([3.0, 1.0], {"start": 8, "stop": 16, "step": 0.2}, {"logspace": {"start": 1, "stop": 100, "num": 3}}):
        assert sweep(sweep(raw).spec()) == sweep(raw)


@pytest.mark.parametrize(
    "raw",
    [
        {"start": 1e-200, "stop": 0, "step": 1e-201},
        {"start": -1e299, "stop": 1e299, "step": -1e298},
        {"logspace": {"start": 1e-200, "stop": -1e-200, "num": 3}},
        {"logspace": {"start": 1, "stop": 1.0001, "num": 10**14}},
        {"start": 1, "stop": 1.0001, "num": 10**14},
    ],
)
def test_extremes_are_refused(raw: Any) -> None:
    with pytest.raises(Invalid):
        sweep(raw)


def test_a_tiny_range() -> None:
    assert sweep({"start": 0, "stop": 3e-200, "step": 1e-200}).values().tolist() == [0.0, 1e-200, 2e-200, 3e-200]
