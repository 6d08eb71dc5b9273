"""The plan: cuts cover the grid, estimates follow the sizes, and what cannot fit is refused."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heliosweep.errors import PlanError
from heliosweep.grid.limits import Limits, human_bytes, human_seconds
from heliosweep.grid.plan import BASE_MEMORY, PART_BLOCKS, PART_BYTES, Workload, make_plan, slabs

ROOMY = Limits(workers=2, memory=8 * 2**30, disk=2**40)


def workload(
    parameters: dict[str, int], heliostats: int = 300, times: int = 0, evaluations: int = 10**5, seconds: float = 1e-7
) -> Workload:
    variables = {"efficiency": (*parameters, "heliostat"), "field": tuple(parameters)}
    inner = {"heliostat": heliostats}
    if times:
        variables["series"] = (*parameters, "time", "heliostat")
        inner = {"time": times, "heliostat": heliostats}
    return Workload(
        parameters=parameters,
        inner=inner,
        evaluations=evaluations,
        unit="evaluations",
        seconds=seconds,
        splittable="heliostat",
        variables=variables,
        block_bytes=lambda points, length: 1000 * points * length,
    )


@given(
    sizes=st.dictionaries(st.sampled_from("abcd"), st.integers(1, 12), max_size=4),
    heliostats=st.integers(1, 2000),
    times=st.integers(0, 500),
    evaluations=st.integers(1, 10**9),
    workers=st.integers(1, 64),
    chunks=st.dictionaries(st.sampled_from(["a", "b", "time", "heliostat"]), st.integers(1, 50), max_size=3),
)
def test_parts_cover_the_grid_once_in_the_order_of_the_file(sizes, heliostats, times, evaluations, workers, chunks):
    work = workload(sizes, heliostats, times, evaluations)
    plan = make_plan(work, Limits(workers, 2**36, 2**50), chunks)
    cuts = [(plan.parts(), dict(sizes))]
    if times:
        cuts.append((plan.series_parts(), {**sizes, "time": times}))
    for regions, shape in cuts:
        position = 0
        strides = {dim: math.prod(list(shape.values())[i + 1 :]) for i, dim in enumerate(shape)}
        for region in regions:
            assert sum(region[dim].start * strides[dim] for dim in shape) == position
            position += math.prod(region[dim].stop - region[dim].start for dim in shape)
        assert position == math.prod(shape.values())
    for dim, length in plan.chunks.items():
        assert 1 <= length <= max(1, work.sizes[dim])
    if times:
        assert plan.series_part["time"] == times or plan.series_part["time"] % plan.chunks["time"] == 0
        assert plan.chunks["time"] == times or plan.chunks["time"] % plan.storage["time"] == 0


@given(sizes=st.dictionaries(st.sampled_from("abc"), st.integers(1, 5000), min_size=1, max_size=3))
def test_one_graph_stays_small(sizes):
    plan = make_plan(workload(sizes), Limits(2, 2**36, 2**60))
    blocks = math.prod(-(-plan.part[dim] // plan.chunks[dim]) for dim in sizes) * -(-300 // plan.chunks["heliostat"])
    assert blocks <= PART_BLOCKS
    assert math.prod(plan.part.values()) * 301 * 8 <= PART_BYTES


def test_a_large_point_is_cut_and_small_points_are_grouped():
    slow = make_plan(workload({"a": 1}, heliostats=10_000, evaluations=10**9), ROOMY)
    assert slow.chunks["heliostat"] < 10_000
    quick = make_plan(workload({"a": 100_000}, heliostats=1, evaluations=10), ROOMY)
    assert quick.chunks["a"] > 1000
    assert quick.blocks >= 2 * ROOMY.workers


def test_asked_chunks_are_kept():
    plan = make_plan(workload({"a": 10, "b": 10}), ROOMY, {"a": 2, "b": 5, "heliostat": 77})
    assert (plan.chunks["b"], plan.chunks["heliostat"]) == (5, 77)


@pytest.mark.parametrize(
    ("sizes", "word"),
    [({"latitude": 10**12}, "latitude"), ({"latitude": 10**4, "width": 10**8}, "width")],
)
def test_a_sweep_of_a_million_million_points_is_refused_by_its_longest_axis(sizes, word):
    with pytest.raises(PlanError, match=f"shrink '{word}' first"):
        make_plan(workload(sizes), ROOMY)


def test_axes_alone_may_not_fit_the_memory():
    with pytest.raises(PlanError, match="its axes would take"):
        make_plan(workload({"a": 10**9}, heliostats=1), Limits(1, 2**30, 2**60))


def test_blocks_shrink_to_the_memory_or_are_refused():
    work = workload({"a": 1}, heliostats=100_000, evaluations=10**7)
    roomy = make_plan(work, ROOMY)
    tight = make_plan(work, Limits(2, BASE_MEMORY + 10 * 2**20, 2**40))
    assert tight.chunks["heliostat"] < roomy.chunks["heliostat"]
    assert tight.peak_memory <= BASE_MEMORY + 10 * 2**20
    with pytest.raises(PlanError, match="smallest block"):
        make_plan(work, Limits(2, BASE_MEMORY + 1000, 2**40))


def test_time_series_that_fill_the_disk_are_refused_by_name():
    with pytest.raises(PlanError, match=r"leave out output\.time_series"):
        make_plan(workload({}, heliostats=1000, times=10**6), Limits(2, 2**33, 2**30))


def test_slabs_of_no_dimensions_are_one():
    assert list(slabs({}, {})) == [{}]


def test_words():
    assert [human_bytes(n) for n in (12, 1500, 2.5e9, 1e21)] == ["12 B", "1.5 kB", "2.5 GB", "1e+03 EB"]
    assert [human_seconds(s) for s in (4.21, 600, 7500)] == ["4.2 s", "10 min", "2 h 05 min"]
