"""The plan: cuts cover the grid, estimates follow the sizes, and what cannot fit is refused."""

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

from heliosweep.errors import PlanError, StudyError
from heliosweep.files import human_bytes
from heliosweep.grid import plan as machine
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import (
    BASE_MEMORY,
    BLOCK_BYTES,
    BLOCK_COPIES,
    MAX_CHUNKS,
    MAX_EVALUATIONS,
    REPORT_MEMORY,
    Limits,
    Plan,
    Workload,
    human_seconds,
    make_plan,
)
from heliosweep.grid.regions import Variable, bytes_of, chunks_by_block

ROOMY = Limits(workers=2, memory=8 * 2**30, disk=2**40)


def workload(parameters: dict[str, int], heliostats: int = 300, times: int = 0, evaluations: int = 10**5) -> Workload:
    return Workload(
        parameters=parameters, inner={"time": times, "heliostat": heliostats} if times else {"heliostat": heliostats},
        evaluations=evaluations, unit="evaluations", splittable="heliostat",
        working_bytes=lambda points, length: 1000 * points * length,
    )  # fmt: skip


def planned(work: Workload, limits: Limits = ROOMY, chunks: dict[str, int] | None = None) -> Plan:
    swept = tuple(work.parameters)
    variables = {"efficiency": Variable((*swept, "heliostat"), {}), "field": Variable(swept, {}, finished=True)}
    if "time" in work.inner:
        variables["series"] = Variable((*swept, "time", "heliostat"), {})
    return make_plan(work, variables, limits, chunks)


CHUNKS = st.dictionaries(st.sampled_from(["a", "b", "heliostat"]), st.integers(1, 50), max_size=3)
SIZES = st.dictionaries(st.sampled_from("abcd"), st.integers(1, 12), max_size=4)


def covered(regions, shape: dict[str, int]) -> bool:
    """True where regions cover a grid, each cell once."""
    seen = np.zeros(tuple(shape.values()), int)
    for region in regions:
        seen[tuple(region[dim] for dim in shape)] += 1
    return bool(np.all(seen == 1))


@given(sizes=SIZES, evaluations=st.integers(1, 10**9), workers=st.integers(1, 64), chunks=CHUNKS)
def test_blocks_and_chunks_cover_the_grid_once(sizes, evaluations, workers, chunks):
    work = workload({"a": 2, "b": 3, **sizes}, 40, 0, evaluations)
    plan = planned(work, Limits(workers, 2**36, 2**50), chunks)
    pieces, blocks = list(plan.chunks()), [block for block, _ in chunks_by_block(plan.cuts)]
    cells = {**work.parameters, "heliostat": 40}
    assert covered((chunk.region for chunk in pieces), cells)
    assert covered((block.region for block in blocks), cells)
    assert [chunk.name for chunk in pieces] == [f"points-{number:05}" for number in range(plan.chunk_count)]
    for block, inside in chunks_by_block(plan.cuts):
        for chunk in inside:
            assert all(around.start <= chunk.region[d].start < chunk.region[d].stop <= around.stop
                       for d, around in block.region.items())  # fmt: skip
    plain = planned(work).cuts["points"]
    assert plan.cuts["points"].block == plain.block  # whatever the machine and the chunks
    assert chunks or plan.cuts["points"].chunk == plain.chunk
    assert all(plan.cuts["points"].chunk[dim] <= length for dim, length in chunks.items() if dim in cells)


@given(
    sizes=st.dictionaries(st.sampled_from("abc"), st.integers(1, 3), max_size=3),
    heliostats=st.sampled_from([1, 7, 300, 2048, 5000, 70_000]),
    times=st.sampled_from([1, 9, 511, 512, 513, 4000]),
    chunks=st.dictionaries(st.sampled_from(["time", "heliostat"]), st.integers(1, 5000), max_size=2),
)
def test_blocks_of_series_are_bounded_and_no_machine_changes_them(sizes, heliostats, times, chunks):
    work = workload(sizes, heliostats, times)
    plan, other = planned(work, Limits(2, 2**36, 2**50), chunks), planned(work, Limits(7, 2**37, 2**50))
    cut = plan.cuts["series"]
    assert cut.block == other.cuts["series"].block
    assert 8 * math.prod(cut.block.values()) <= BLOCK_BYTES["series"]
    assert all(1 <= cut.chunk[dim] <= min(cut.block[dim], chunks.get(dim, cut.block[dim])) for dim in cut.sizes)
    shape = {dim: -(-size // cut.block[dim]) for dim, size in cut.sizes.items()}
    blocks = ({dim: slice(s.start // cut.block[dim], -(-s.stop // cut.block[dim])) for dim, s in region.items()}
              for region in cut.blocks())  # fmt: skip
    assert covered(blocks, shape)


def test_a_large_point_is_cut_and_small_points_are_grouped():
    slow = planned(workload({"a": 1}, heliostats=100_000, evaluations=10**9)).cuts["points"]
    assert slow.chunk["heliostat"] * 10**9 / 100_000 <= MAX_EVALUATIONS
    quick = planned(workload({"a": 100_000}, heliostats=1, evaluations=10))
    assert quick.cuts["points"].chunk["a"] > 1000
    assert 2 * ROOMY.workers <= quick.chunk_count <= MAX_CHUNKS
    assert bytes_of(quick.variables, {**quick.workload.inner, **quick.cuts["points"].block}) <= BLOCK_BYTES["points"]


def test_chunks_shrink_to_the_memory_or_are_refused():
    work = workload({"a": 1}, heliostats=2_500_000, evaluations=10**6)
    roomy = planned(work, Limits(8, ROOMY.memory, ROOMY.disk))
    memory = BASE_MEMORY + REPORT_MEMORY + (BLOCK_COPIES + 1) * 8 * 250_000
    tight = planned(work, Limits(8, memory, 2**40))
    assert tight.cuts["points"].chunk["heliostat"] < roomy.cuts["points"].chunk["heliostat"]
    assert tight.peak_memory <= memory
    with pytest.raises(PlanError, match="smallest chunk"):
        planned(workload({"a": 1}, heliostats=25_000_000), Limits(2, memory, 2**40))


def test_what_cannot_fit_is_refused_by_the_name_of_its_longest_axis():
    with pytest.raises(PlanError, match=r"shrink 'time' first or omit output\.time_series"):
        planned(workload({}, heliostats=1000, times=10**6), Limits(2, 2**33, 2**30))
    for sizes, word in (({"latitude": 10**12}, "latitude"), ({"latitude": 10**4, "width": 10**8}, "width")):
        with pytest.raises(PlanError, match=f"shrink '{word}' first"):
            planned(workload(sizes))


def test_words():
    assert [human_bytes(n) for n in (12, 1500, 2.5e9, 1e21)] == ["12 B", "1.5 kB", "2.5 GB", "1e+03 EB"]
    assert [human_seconds(s) for s in (4.21, 600, 7500)] == ["4.2 s", "10 min", "2 h 05 min"]


def test_unknown_dimensions_in_chunks_are_named():
    with pytest.raises(StudyError, match=r"execution\.chunks\.lattitude: unknown dimension; did you mean 'latitude'"):
        planned(workload({"latitude": 3}), ROOMY, {"lattitude": 1})


@pytest.fixture
def groups(tmp_path, monkeypatch) -> Path:
    """A machine with 8 GB of free memory and this process of 100 MB; returns the folder of control groups."""
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=8_000_000_000))
    monkeypatch.setattr(psutil.Process, "memory_info", lambda self: SimpleNamespace(rss=100_000_000))
    monkeypatch.setattr(machine, "_CGROUPS", tmp_path / "groups")
    monkeypatch.setattr(machine, "_OWN_GROUP", tmp_path / "cgroup")
    return tmp_path / "groups"


def limit(folder: Path, size: str, used: int = 0, cached: int = 0) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    values = {"max": size, "current": used, "stat": f"anon 1\ninactive_file {cached}"}
    for name, value in values.items():
        (folder / f"memory.{name}").write_text(f"{value}\n")


def memory(tmp_path: Path) -> int:
    return machine.machine_limits(2, None, tmp_path).memory


def test_the_tightest_control_group_counts_with_what_others_in_it_hold(groups, tmp_path):
    (tmp_path / "cgroup").write_text("1:cpu:/old\n0::/outer/inner\n")
    limit(groups / "outer" / "inner", "max")
    assert memory(tmp_path) == 6_400_000_000
    limit(groups / "outer", "2000000000", 900_000_000, 300_000_000)
    assert memory(tmp_path) == int(0.8 * (2_000_000_000 - 900_000_000 + 300_000_000 + 100_000_000))


def test_the_study_has_the_last_word(groups, tmp_path):
    limits = machine.machine_limits(5, 10**10, tmp_path)
    assert (limits.workers, limits.memory) == (5, 10**10)
    assert machine.machine_limits(None, None, tmp_path).workers >= 1


@pytest.mark.parametrize("name", ["a/b/c", "n" * 300, "nul\0"])
def test_free_disk_of_the_nearest_parent_that_can_be_read(tmp_path, name):
    assert machine.machine_limits(1, 1, tmp_path / name).disk > 0


def test_suns_of_equal_azimuth_are_points_where_the_elevation_differs(small):
    def study(azimuth, elevation):
        time = {"clock": "sun", "azimuth": azimuth, "elevation": elevation}
        return small(site=None, time=time, tracking="azimuth_elevation", zip=[["time.azimuth", "time.elevation"]])

    grid = Parameters(study([120, 120, 240], [30, 50, 50]))
    assert [values for _, values in grid.points("time.azimuth", "time.elevation")] == [(120, 30), (120, 50), (240, 50)]
    with pytest.raises(StudyError, match=r"with the same time\.elevation"):
        study([120, 240, 120], [30, 50, 30])
