"""Fused graphs: the same bits from few tasks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import dask
import numpy as np
import pytest
import xarray as xr
import yaml
from dask.base import tokenize

from heliosweep import workflow
from heliosweep.families.registry import families
from heliosweep.grid.evaluate import EMBEDDED, evaluate
from heliosweep.reduce.weighted import weighted_mean
from heliosweep.runtime.fused import _Fused, fused
from tests.conftest import SMALL

STUDIES = {
    "series": {**SMALL, "site": {"latitude": [0, 20, 40]}, "output": {"time_series": True}},
    **{name: yaml.safe_load(families()[name].example()) for name in families()},
}


@pytest.mark.parametrize("name", STUDIES)
def test_the_same_bits_from_fewer_tasks(name):
    study = workflow.load(STUDIES[name])
    family, plan = workflow.family_of(study), workflow.plan(study)
    splittable = plan.workload.splittable
    lazy = family.build(study, {**plan.chunks, **({splittable: 7} if splittable else {})}, {})
    graph = fused(lazy := lazy.drop_vars(lazy.coords), "part", "run")
    assert len(graph) < len(dict(lazy.__dask_graph__()))
    same(dask.get(graph, "part"), lazy.compute(scheduler="synchronous"))


class Secret:
    """A task that cannot be pickled."""

    def __reduce__(self) -> Any:
        raise AssertionError("was pickled")

    def __call__(self) -> None:
        """Nothing."""


def test_names_stand_for_what_is_fused():
    one, same, other = (_Fused({key: (Secret(),)}, key, ()) for key in ("a", "a", "b"))
    assert tokenize({"x": (one, [])}) == tokenize({"x": (same, [])}) != tokenize({"x": (other, [])})


def same(values: Mapping[str, np.ndarray], reference: xr.Dataset) -> None:
    assert list(values) == list(reference.data_vars)
    for name, array in reference.data_vars.items():
        assert values[str(name)].dtype == array.dtype
        assert values[str(name)].shape == array.shape
        assert values[str(name)].tobytes() == array.to_numpy().tobytes(), name


def made(name: str, *inputs: xr.DataArray, work: bool, core: int = 0) -> xr.DataArray:
    """Sum of some inputs over 12 places in blocks of 3, the last `core` of them whole."""

    def block(*arrays: np.ndarray) -> np.ndarray:
        total: np.ndarray = sum(array if array.ndim == 1 else array.sum(axis=-1) for array in arrays)  # type: ignore[assignment]
        return total[np.newaxis]

    whole: list[tuple[Any, ...]] = [()] * (len(inputs) - core) + [("of",)] * core
    settings: dict[str, Any] = {"dims": ("x",), "sizes": {"x": 12}, "chunks": {"x": 3}, "outputs": {name: {}}}
    return evaluate(block, inputs, core=whole, name=name, work=work, **settings)[name]


PLACES = xr.DataArray(np.arange(12.0), dims="x")


def test_one_task_for_each_block_and_one_for_the_rest():
    block = made("block", made("sun", PLACES, work=False), PLACES, work=True)
    lazy = xr.Dataset({"twice": 2 * block, "block": block, "mean": weighted_mean(block, PLACES, "x", {}, {})})
    graph = fused(lazy, "part", "run")
    assert len(graph) == 4 + 1
    same(dask.get(graph, "part"), lazy.compute(scheduler="synchronous"))


def test_large_constants_stay_tasks_that_blocks_share():
    large = xr.DataArray(np.random.default_rng(1).random(EMBEDDED), dims="of")
    lazy = xr.Dataset({"a": made("block", PLACES, large, work=True, core=1)})
    graph = fused(lazy, "part", "run")
    assert len(graph) == 4 + 1 + 1
    same(dask.get(graph, "part"), lazy.compute(scheduler="synchronous"))


def test_what_waits_for_no_block_is_shared_among_workers():
    alone = made("alone", PLACES, work=False)
    lazy = xr.Dataset({"block": made("block", PLACES, work=True), "after": made("after", alone, work=False)})
    graph = fused(lazy, "part", "run")
    assert len(graph) == 4 + 4 + 1
    same(dask.get(graph, "part"), lazy.compute(scheduler="synchronous"))


def test_blocks_that_wait_for_blocks():
    first = made("first", PLACES, work=True)
    lazy = xr.Dataset({"second": made("second", first, PLACES, work=True)})
    graph = fused(lazy, "part", "run")
    assert len(graph) == 4 + 4 + 1
    same(dask.get(graph, "part"), lazy.compute(scheduler="synchronous"))
