"""Sweeps: exact decimals, all forms."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heliosweep.config.faults import Invalid
from heliosweep.config.values import Quantity


def sweep(raw: Any) -> Any:
    return Quantity("", "1").read(raw)


def test_ranges_have_clean_decimals() -> None:
    hours = sweep({"start": 8, "stop": 16, "step": 0.2}).values()
    assert hours.tolist() == [float(f"{8 + i // 5}.{2 * (i % 5)}") for i in range(41)]
    assert sweep({"start": 0, "stop": 5, "num": 101}).values()[3] == 0.15
    assert sweep({"start": 0, "stop": -0.3, "step": -0.1}).values().tolist() == [0.0, -0.1, -0.2, -0.3]


@given(start=st.decimals(-1000, 1000, places=3), step=st.decimals("0.001", 10, places=3), num=st.integers(1, 300))
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
    assert sweep({"start": 0, "stop": 350, "step": 15})[-1] == 345
    assert sweep({"start": 0, "stop": 345, "step": 15})[-1] == 345
    assert sweep({"start": 0, "stop": 1, "step": 1 / 3}).values().tolist() == [0, 1 / 3, 2 / 3, 1]


def test_a_range_has_at_most_a_million_values() -> None:
    many = sweep({"start": 0, "stop": 1, "num": 10**6})
    assert many[10**5] == 100000 / 999999
    with pytest.raises(Invalid, match="must be between 1 and 1000000"):
        sweep({"start": 0, "stop": 1, "num": 10**6 + 1})
    with pytest.raises(Invalid, match="more than 1,000,000 values: check that the step"):
        sweep({"start": 0, "stop": 1, "step": 1e-7})
