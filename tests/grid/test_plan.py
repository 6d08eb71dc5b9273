"""The plan: cuts cover the grid, estimates follow the sizes, and what cannot fit is refused."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given, reject
from hypothesis import strategies as st

from heliosweep.errors import PlanError, StudyError
from heliosweep.grid.limits import Limits, human_bytes, human_seconds
from heliosweep.grid.plan import BASE_MEMORY, PART_BLOCKS, PART_BYTES, PART_SECONDS, Plan, Workload, make_plan
from heliosweep.grid.slabs import SERIES_PART_BYTES, STORAGE_BYTES, slabs

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


CHUNKS = st.dictionaries(st.sampled_from(["a", "b", "heliostat"]), st.integers(1, 50), max_size=3)
SIZES = st.dictionaries(st.sampled_from("abcd"), st.integers(1, 12), max_size=4)


def made(work: Workload, limits: Limits, chunks: dict[str, int]) -> Plan:
    """A plan, or no test where the chunks asked for are refused for being too many."""
    try:
        return make_plan(work, limits, chunks)
    except StudyError as error:
        if not re.search(rf"would cut one part of the work into [\d,]+ blocks, more than {PART_BLOCKS:,};", str(error)):
            raise
        reject()


def covered(regions, shape: dict[str, int]) -> bool:
    """Whether regions cover a grid, each point once."""
    seen = np.zeros(tuple(shape.values()), int)
    for region in regions:
        seen[tuple(region[dim] for dim in shape)] += 1
    return bool(np.all(seen == 1))


@given(sizes=SIZES, evaluations=st.integers(1, 10**9), workers=st.integers(1, 64), chunks=CHUNKS)
def test_parts_cover_the_grid_once(sizes, evaluations, workers, chunks):
    work = workload({"a": 2, "b": 3, **sizes}, 300, 0, evaluations)
    plan = made(work, Limits(workers, 2**36, 2**50), chunks)
    parts = list(plan.parts())
    assert covered((part.region for part in parts), dict(work.parameters))
    assert [part.name for part in parts] == [f"points-{number:05}" for number in range(plan.part_count)]
    assert max(map(plan.blocks_of, parts)) <= PART_BLOCKS
    assert plan.part == make_plan(work, ROOMY).part  # whatever the machine
    for dim, length in plan.chunks.items():
        assert 1 <= length <= work.sizes[dim]


@given(
    sizes=st.dictionaries(st.sampled_from("abc"), st.integers(1, 3), max_size=3),
    heliostats=st.sampled_from([1, 7, 300, 2048, 5000, 70_000]),
    times=st.sampled_from([1, 9, 511, 512, 513, 4000]),
    chunks=st.dictionaries(st.sampled_from(["time", "heliostat"]), st.integers(1, 5000), max_size=2),
)
def test_series_are_written_in_an_order_that_chunks_and_workers_do_not_change(sizes, heliostats, times, chunks):
    work = workload(sizes, heliostats, times)
    plan = made(work, Limits(2, 2**36, 2**50), chunks)
    other = make_plan(work, Limits(7, 2**37, 2**50))
    assert plan.series is not None
    assert other.series is not None
    assert (plan.series.part, plan.series.storage) == (other.series.part, other.series.storage)
    cells = {dim: work.sizes[dim] for dim in plan.series.part}
    # In units of storage chunks, so that the grid to cover stays small; parts hold whole ones.
    for dim, stored in plan.series.storage.items():
        assert plan.series.part[dim] in (work.sizes[dim],) or plan.series.part[dim] % stored == 0
        cells[dim] = -(-work.sizes[dim] // stored)
    in_cells = (
        {
            dim: slice(span.start // (n := plan.series.storage.get(dim, 1)), -(-span.stop // n))
            for dim, span in region.items()
        }
        for region in (part.region for part in plan.parts() if part.kind == "series")
    )
    assert covered(in_cells, cells)
    assert 8 * math.prod(plan.series.part.values()) <= SERIES_PART_BYTES
    assert 8 * math.prod(plan.series.storage.values()) <= max(STORAGE_BYTES, 8 * plan.series.part["heliostat"])
    for dim, length in plan.series.chunks.items():
        part = plan.series.part[dim]
        assert 1 <= length <= part
        assert part == work.sizes[dim] or part % length == 0


@given(sizes=st.dictionaries(st.sampled_from("abc"), st.integers(1, 5000), min_size=1, max_size=3))
def test_one_graph_stays_small(sizes):
    plan = make_plan(workload(sizes), Limits(2, 2**36, 2**60))
    blocks = math.prod(-(-plan.part[dim] // plan.chunks[dim]) for dim in sizes) * -(-300 // plan.chunks["heliostat"])
    assert blocks <= PART_BLOCKS
    assert math.prod(plan.part.values()) * 301 * 8 <= PART_BYTES
    assert math.prod(plan.part.values()) * plan.workload.point_seconds <= PART_SECONDS


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
    with pytest.raises(PlanError, match="the program and the axes would take"):
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
    with pytest.raises(PlanError, match=r"shrink 'time' first or leave out output\.time_series"):
        make_plan(workload({}, heliostats=1000, times=10**6), Limits(2, 2**33, 2**30))


def test_slabs_of_no_dimensions_are_one():
    assert list(slabs({}, {})) == [{}]


def test_words():
    assert [human_bytes(n) for n in (12, 1500, 2.5e9, 1e21)] == ["12 B", "1.5 kB", "2.5 GB", "1e+03 EB"]
    assert [human_seconds(s) for s in (4.21, 600, 7500)] == ["4.2 s", "10 min", "2 h 05 min"]


def test_unknown_dimensions_in_chunks_are_named():
    with pytest.raises(StudyError, match=r"execution\.chunks\.lattitude: unknown dimension; did you mean 'latitude'"):
        make_plan(workload({"latitude": 3}), ROOMY, {"lattitude": 1})


def test_workers_without_work_take_no_memory():
    few = make_plan(workload({"a": 2}), Limits(2, 2**33, 2**40))
    many = make_plan(workload({"a": 2}), Limits(60_000, 2**33, 2**40))
    assert many.workers == many.blocks
    assert many.peak_memory < 2 * few.peak_memory


def test_a_refusal_for_memory_says_how_much_to_give():
    with pytest.raises(PlanError, match=r"raise execution\.memory to \d+ MB"):
        make_plan(workload({"a": 1}), Limits(1, 10**7, 2**40))


def test_a_plan_is_printed_in_a_few_lines():
    text = str(make_plan(workload({"a": 1_200, "b": 3}), ROOMY))
    assert text.splitlines()[:3] == [
        "Plan",
        "  dimensions   a 1,200, b 3, heliostat 300",
        "  points       3,600 parameter combinations",
    ]
    assert len(text) < 400
    assert "peak memory" in text
