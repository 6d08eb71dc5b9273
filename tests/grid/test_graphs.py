"""The graph of a part, for every family and for large studies: few tasks, few bytes, and the same bits anywhere."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import cloudpickle  # type: ignore[import-untyped]
import numpy as np
import pytest
import xarray as xr
import yaml

from heliosweep import workflow
from heliosweep.config.study import Study
from heliosweep.families.registry import families
from heliosweep.grid.evaluate import TASK_MARK, Made
from heliosweep.grid.limits import Limits
from heliosweep.grid.pieces import Constant, Embedded, Remade, View
from heliosweep.grid.plan import Plan, make_plan

STUDIES = Path(__file__).parent.parent.parent / "studies"
ROOMY = Limits(workers=2, memory=2**36, disk=2**60)

#: Bytes of a pickled graph at the most.
GRAPH_BYTES = 10**6
#: Tasks of a part beside one for each block and variable: sun, statistics, flags.
OTHERS_PER_BLOCK, OTHERS = 8, 60


def shipped(name: str) -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load((STUDIES / f"{name}.yaml").read_text(encoding="utf-8"))
    content.pop("report", None)
    return content


def stagger(heliostats: int) -> dict[str, Any]:
    return {"radial_stagger": {"clearance": 16, "inner_radius": 61.3, "heliostats": heliostats}}


HOURLY = {"clock": "solar", "days": {"start": 1, "stop": 365, "step": 1}, "hours": {"start": 0, "stop": 24, "step": 1}}


def large_field() -> dict[str, Any]:
    return shipped("latitude_sweep") | {"site": {"latitude": 30}, "layout": stagger(100_000)}


def hourly_series() -> dict[str, Any]:
    time = {**HOURLY, "sampling": "midpoint"}
    return large_field() | {"layout": stagger(10_000), "time": time, "output": {"time_series": True}}


def civil_year() -> dict[str, Any]:
    time = {
        "clock": "civil",
        "dates": {"start": "2023-01-01", "stop": "2023-12-31", "step": 1},
        "window": {"start": "00:00", "stop": "24:00", "step": "10 min"},
    }
    site = {"latitude": 37.1, "longitude": -2.4, "timezone": "Europe/Madrid"}
    return large_field() | {"layout": stagger(1000), "time": time, "site": site}


def many_latitudes() -> dict[str, Any]:
    latitude = {"start": -60, "stop": 60, "step": 0.012}
    return shipped("latitude_sweep") | {"site": {"latitude": latitude}, "layout": stagger(300)}


def many_layouts() -> dict[str, Any]:
    layout = stagger(1000)
    layout["radial_stagger"]["clearance"] = {"start": 14, "stop": 24, "step": 0.05}
    return large_field() | {"layout": layout, "time": {"clock": "solar", "days": [80], "hours": [12]}}


def many_sizes() -> dict[str, Any]:
    content = shipped("spot_drift")
    content["error"]["size"] = {"start": -12, "stop": 12, "step": 24 / 99_999}
    return content


def large_tolerance() -> dict[str, Any]:
    return shipped("field_tolerance") | {"layout": stagger(100_000)}


def large_draws() -> dict[str, Any]:
    return shipped("mount_error_monte_carlo") | {"layout": stagger(20_000)}


def world_of_dishes() -> dict[str, Any]:
    return shipped("dish_world") | {"site": {"latitude": {"start": -60, "stop": 60, "step": 0.012}, "longitude": 0}}


def many_cameras() -> dict[str, Any]:
    content = shipped("camera_radius")
    content["cameras"]["radius"] = {"start": 0.1, "stop": 0.4, "step": 0.0003}
    return content


LARGE = {
    function.__name__: function
    for function in (
        large_field, hourly_series, civil_year, many_latitudes, many_layouts, many_sizes, large_tolerance, large_draws,
        world_of_dishes, many_cameras,
    )
}  # fmt: skip


@pytest.fixture
def load(tmp_path):
    """Load a study that names its files as those in ``studies/`` do."""

    def loaded(content: dict[str, Any]) -> Study:
        for folder in STUDIES.iterdir():
            if folder.is_dir() and not (tmp_path / folder.name).exists():
                (tmp_path / folder.name).symlink_to(folder)
        path = tmp_path / "study.yaml"
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        return workflow.load(path)

    return loaded


def graphs(study: Study, chunks: dict[str, int] | None = None) -> list[tuple[str, dict[Any, Any], int, Plan]]:
    """Graph of the first part of each kind, and how many blocks it has."""
    family = workflow.family_of(study)
    plan = make_plan(family.workload(study), ROOMY, chunks)
    found, seen = [], set()
    for part in plan.parts():
        if part.kind not in seen:
            seen.add(part.kind)
            cut = plan.chunks if plan.series is None or part.kind == "points" else plan.series.chunks
            lazy = family.build(study, cut, part.region)
            lazy = lazy.drop_vars(lazy.coords)[list(plan.workload.of_kind(part.kind))]
            graph = lazy.__dask_graph__()
            found.append((part.kind, dict(graph), plan.blocks_of(part), plan))
        if len(seen) == 1 + (plan.series is not None):
            break
    return found


def check(study: Study, chunks: dict[str, int] | None = None) -> None:
    for kind, graph, blocks, plan in graphs(study, chunks):
        work = [key for key in graph if TASK_MARK in str(key[0] if isinstance(key, tuple) else key)]
        assert len(work) == blocks
        # The block itself, and one for each variable; what is done with these is bounded as well.
        assert len(graph) <= blocks * (len(plan.workload.of_kind(kind)) + OTHERS_PER_BLOCK) + OTHERS
        assert len(cloudpickle.dumps(graph)) < GRAPH_BYTES


@pytest.mark.parametrize("name", families())
def test_graph_of_a_family_s_example_is_small(name, tmp_path):
    path = tmp_path / "example.yaml"
    path.write_text(families()[name].example(), encoding="utf-8")
    check(workflow.load(path))


@pytest.mark.parametrize("path", sorted(STUDIES.glob("*.yaml")), ids=lambda path: path.stem)
def test_graph_of_a_shipped_study_is_small(path):
    check(workflow.load(path))


@pytest.mark.parametrize("name", LARGE)
def test_graph_of_a_large_study_is_small(name, load):
    check(load(LARGE[name]()))


def test_points_one_by_one_have_few_tasks_each(load):
    content = shipped("dish_world") | {"site": {"latitude": [10, 20], "longitude": 0}}
    check(load(content), {"latitude": 1, "axis_tilt": 1, "axis_tilt_direction": 1})


def test_part_of_a_time_series_is_that_part(load):
    time = {"clock": "solar", "days": [80, 172], "hours": {"start": 8, "stop": 16, "step": 1}}
    study = load(hourly_series() | {"layout": stagger(200), "time": time})
    family = workflow.family_of(study)
    chunks = {"time": 4, "heliostat": 50}
    part = {"time": slice(4, 12), "heliostat": slice(50, 200)}
    region = {"tracking": slice(1, 2), **part}
    whole = family.build(study, chunks, {"tracking": slice(1, 2)})
    alone = family.build(study, chunks, region)
    assert "time" in alone["instantaneous_optical_efficiency"].dims
    for name, array in alone.data_vars.items():
        xr.testing.assert_identical(array.compute(), whole[name].isel(part).compute())


def sent(value: Any) -> Any:
    return pickle.loads(cloudpickle.dumps(value))


@pytest.mark.parametrize(
    "array",
    [
        np.arange(5000.0).reshape(50, 100),
        np.arange(10, 5010),
        np.arange(5000)[::2],
        np.array(3.5),
        np.array("spinning_elevation", dtype=object),
        np.array(["a", "b"], dtype=object),
        np.arange(3000).astype("datetime64[s]").astype("datetime64[ns]"),
        np.broadcast_to(np.arange(1000.0)[:, np.newaxis], (1000, 70)),
        np.broadcast_to(np.arange(3)[np.newaxis], (7, 3)),
        np.random.default_rng(1).random((30, 40))[::2, ::3],
        np.array([], dtype=float),
        np.full((2, 3), np.nan),
    ],
    ids=str,
)
@pytest.mark.parametrize("kind", [Constant, Embedded])
def test_pieces_arrive_as_they_were(array, kind):
    arrived = sent(kind(array))()
    assert type(arrived) is np.ndarray
    assert arrived.dtype == array.dtype
    assert arrived.shape == array.shape
    assert arrived.tobytes() == array.tobytes() if not array.dtype.hasobject else np.array_equal(arrived, array)
    assert arrived.flags.writeable or 0 in arrived.strides


def table(rows: int, columns: int) -> np.ndarray:
    CALLS.append((rows, columns))
    return np.arange(rows * columns, dtype=float).reshape(rows, columns)


CALLS: list[tuple[int, int]] = []


def test_what_can_be_made_anew_is_not_sent():
    made = Made(xr.DataArray(table(100, 200), dims=("a", "b")), table, (100, 200))
    views = View((1, 0), (slice(None), None, slice(None), ...))
    pieces = [Remade(made, (slice(0, 50), slice(7, 9), ...), views), Remade(made, (slice(50, 100), slice(3, 4)), views)]
    CALLS.clear()
    arrived = [sent(piece) for piece in pieces]
    assert all(len(cloudpickle.dumps(piece)) < 1000 for piece in pieces)
    for piece, other in zip(pieces, arrived, strict=True):
        np.testing.assert_array_equal(piece(), other())
        assert other().flags.c_contiguous
    assert CALLS == [(100, 200)]
