"""`evaluate`: any dimensions, any chunks, same values; tasks counted and arrays never expanded."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

from heliosweep.grid.evaluate import TASK_MARK, evaluate


def face(a: np.ndarray, b: np.ndarray, t: np.ndarray) -> np.ndarray:
    total = np.sum(t, axis=-1)
    return np.stack(np.broadcast_arrays(a * b + total, a - b * total))


@pytest.mark.parametrize("chunks", [{}, {"a": 1}, {"a": 2, "b": 3}, {"b": 4}])
def test_values_do_not_depend_on_chunks(chunks):
    a = xr.DataArray(np.arange(5.0), dims="a")
    b = xr.DataArray(np.arange(4.0), dims="b")
    t = xr.DataArray(np.arange(12.0).reshape(3, 4), dims=("t", "b"))
    made = evaluate(
        face,
        [a, b, t],
        dims=("a", "b"),
        core=[(), (), ("t",)],
        sizes={"a": 5, "b": 4},
        chunks=chunks,
        outputs={"first": {"units": "1"}, "second": {"units": "m"}},
        name="test",
    )
    assert made["second"].dims == ("a", "b")
    assert made["second"].attrs == {"units": "m"}
    xr.testing.assert_equal(made["first"].compute(), (a * b + t.sum("t")).assign_attrs(units="1"))
    xr.testing.assert_equal(made["second"].compute(), a - b * t.sum("t"))


def test_no_dimensions_at_all_and_new_core_dimensions():
    made = evaluate(
        lambda value, t: (value * t[:, np.newaxis] ** np.arange(3))[np.newaxis],
        [xr.DataArray(2.0), xr.DataArray(np.arange(4.0), dims="t")],
        dims=(),
        core=[(), ("t",)],
        sizes={},
        chunks={},
        outputs={"powers": {}},
        name="test",
        output_core={"t": 4, "power": 3},
    )["powers"]
    assert made.dims == ("t", "power")
    np.testing.assert_array_equal(made, 2 * np.arange(4.0)[:, np.newaxis] ** np.arange(3))


def test_only_work_carries_the_prefix_that_progress_counts():
    value = xr.DataArray(np.arange(6.0), dims="a")
    arguments: dict[str, Any] = {
        "dims": ("a",),
        "core": [()],
        "sizes": {"a": 6},
        "chunks": {"a": 2},
        "outputs": {"same": {}},
    }
    for work, expected in ((True, 3), (False, 0)):
        made = evaluate(lambda a: a[np.newaxis], [value], name="test", work=work, **arguments)["same"]
        keys = [key for key in made.data.__dask_graph__().to_dict() if TASK_MARK in str(key[0])]
        assert len(keys) == expected
