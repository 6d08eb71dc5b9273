"""What a study will cost before it runs: points, blocks, memory, disk, time; and a clear no where it cannot fit.

A study is computed in *parts*, slabs of the grid with stable names: they follow from the study alone, whatever machine
it runs on, so that a run can go on where another one ended. A part is cut into *blocks*, the tasks that run side by
side, to suit the machine. Neither changes a number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal

from heliosweep.config.faults import did_you_mean
from heliosweep.errors import PlanError, Problem, StudyError
from heliosweep.grid.limits import Limits, human_bytes, human_lengths, human_seconds
from heliosweep.grid.slabs import Part, Series, series_lengths, slab_lengths, slabs

#: A process with the libraries loaded and figures drawn, before any data; and a worker process beside it. [bytes]
BASE_MEMORY, WORKER_PROCESS_MEMORY = 388 * 2**20, 100 * 2**20
#: A NetCDF file without any data. [bytes]
EMPTY_FILE = 56 * 2**10
#: Work that a block should hold: long against a task's overhead of 0.2 ms, short against the run. [s]
BLOCK_SECONDS = 0.25
#: Below this a block is not worth its overhead. [s]
LEAST_SECONDS = 0.005
#: Blocks per worker that keep all workers busy to the end of a part.
BLOCKS_PER_WORKER = 8
#: Blocks of one part at the most: a block is up to 33 tasks, and two parts are in flight with 20,000 tasks at the most.
PART_BLOCKS = 300
#: What one part may hold, so that some of them fit any memory, and take on one core, so that a kill costs little.
PART_BYTES, PART_SECONDS = 64 * 2**20, 5.0
#: Parts that are in memory at a time: two computed and one written.
PARTS_HELD = 3
#: The same of time series, with what the allocator keeps and, from process to process, what is sent.
SERIES_HELD = {"here": 4, "processes": 12, "elsewhere": 4}


@dataclass(frozen=True)
class Workload:
    """What a family says of a study, for planning only.

    Parameters
    ----------
    parameters : mapping of str to int
        Lengths of the swept dimensions, in the order of the result.
    inner : mapping of str to int
        Lengths of the other dimensions of the result, for instance ``heliostat`` and ``time``.
    evaluations : int
        Kernel evaluations of one parameter point.
    unit : str
        What one evaluation is, for instance ``heliostat-instants``.
    seconds : float
        Time of one evaluation on one core, roughly. [s]
    splittable : str
        Inner dimension along which one parameter point may be cut, or empty.
    variables : mapping of str to tuple of str
        Stored variables and their dimensions.
    block_bytes : callable
        (points, length along `splittable`) -> working memory of one block. [bytes]
    whole : tuple of str
        Swept dimensions over which the family takes statistics: a part always holds them whole.
    itemsize : mapping of str to int
        Bytes of a value of those variables that are not of 8 bytes.
    seconds_per_point : float
        Overhead of a parameter point, whatever its evaluations. [s]
    coordinate_bytes : int
        Size of the coordinates. [bytes]
    axes : mapping of str to int
        Lengths of what is evaluated but not stored, for messages: study key, length.
    fixed_bytes : int
        What the family takes besides, whatever the study. [bytes]
    """

    parameters: Mapping[str, int]
    inner: Mapping[str, int]
    evaluations: int
    unit: str
    seconds: float
    splittable: str
    variables: Mapping[str, tuple[str, ...]]
    block_bytes: Callable[[int, int], int]
    whole: tuple[str, ...] = ()
    itemsize: Mapping[str, int] = field(default_factory=dict)
    seconds_per_point: float = 0.0
    coordinate_bytes: int = 0
    axes: Mapping[str, int] = field(default_factory=dict)
    fixed_bytes: int = 0

    @property
    def sizes(self) -> dict[str, int]:
        """All dimensions of the result."""
        return {**self.parameters, **self.inner}

    @property
    def points(self) -> int:
        """Parameter combinations."""
        return math.prod(self.parameters.values())

    @property
    def point_seconds(self) -> float:
        """Time of one parameter point on one core. [s]"""
        return self.evaluations * self.seconds + self.seconds_per_point

    def of_kind(self, kind: str) -> tuple[str, ...]:
        """Names of the variables that parts of one kind hold: ``series`` those over ``time``, ``points`` all others."""
        return tuple(name for name, dims in self.variables.items() if ("time" in dims) == (kind == "series"))

    def bytes_of(self, sizes: Mapping[str, int]) -> int:
        """Size of the stored variables for the given lengths of dimensions. [bytes]."""
        return sum(
            self.itemsize.get(name, 8) * math.prod(sizes[dim] for dim in dims) for name, dims in self.variables.items()
        )


@dataclass(frozen=True, repr=False)
class Plan:
    """The cost of a study and how it will be cut; printed, a few lines.

    Parameters
    ----------
    workload : Workload
        What was planned.
    workers : int
        Blocks that run at a time.
    chunks : dict of str to int
        Block lengths along the dimensions that are cut.
    part : dict of str to int
        Part lengths along the swept dimensions.
    peak_memory, output_bytes : int
        Estimates. [bytes]
    seconds : float
        Estimate of the time in the kernels. [s]
    series : Series, optional
        How time series are cut; None without them.
    """

    workload: Workload
    workers: int
    chunks: dict[str, int]
    part: dict[str, int]
    peak_memory: int
    output_bytes: int
    seconds: float
    series: Series | None = None

    def __repr__(self) -> str:
        words = self.in_words()
        cut = f"{self.part_count:,} parts, {self.blocks:,} blocks; {self.workers} at a time"
        rows = {name: words.pop(name) for name in ("dimensions", "points", "evaluations")} | {"cut into": cut} | words
        return "\n".join(["Plan", *(f"  {name:11}  {value}" for name, value in rows.items())])

    def in_words(self) -> dict[str, str]:
        """Say what the study is and costs, by the name of each quantity."""
        work = self.workload
        return {
            "dimensions": human_lengths(work.sizes) or "none",
            "points": f"{work.points:,} parameter combinations",
            "evaluations": f"{work.points * work.evaluations:,} {work.unit}",
            "peak memory": f"about {human_bytes(self.peak_memory)}",
            "output": human_bytes(self.output_bytes),
            "time": f"about {human_seconds(self.seconds)} in the kernels",
        }

    @property
    def blocks(self) -> int:
        """Number of blocks in the whole study, those of time series included."""
        return sum(_pieces(self.workload.sizes, chunks) for _, chunks in self._kinds.values())

    @property
    def cut(self) -> dict[str, dict[str, int]]:
        """Lengths of the parts of each kind, and of the storage chunks of time series, by dimension."""
        storage = {"storage": self.series.storage} if self.series else {}
        return {**{kind: part for kind, (part, _) in self._kinds.items()}, **storage}

    @property
    def part_count(self) -> int:
        """Number of parts in the whole study."""
        return sum(_pieces(self.workload.sizes, part) for part, _ in self._kinds.values())

    def parts(self) -> Iterator[Part]:
        """Parts in the order of the file: of all that has no ``time`` first, then of the time series."""
        for kind, (lengths, _) in self._kinds.items():
            for number, region in enumerate(slabs({dim: self.workload.sizes[dim] for dim in lengths}, lengths)):
                yield Part(f"{kind}-{number:05}", kind, region)

    def blocks_of(self, part: Part) -> int:
        """Number of blocks of one part."""
        _, chunks = self._kinds[part.kind]
        sizes = self.workload.sizes
        return _pieces({dim: len(range(sizes[dim])[part.region.get(dim, slice(None))]) for dim in chunks}, chunks)

    @property
    def _kinds(self) -> dict[str, tuple[dict[str, int], dict[str, int]]]:
        """Part and block lengths of each kind of part that the study has."""
        kinds = {"points": (self.part, self.chunks)}
        if self.series:
            kinds["series"] = (self.series.part, self.series.chunks)
        return {kind: lengths for kind, lengths in kinds.items() if self.workload.of_kind(kind)}


def _pieces(sizes: Mapping[str, int], lengths: Mapping[str, int]) -> int:
    """Into how many pieces of the given lengths a grid is cut."""
    return math.prod(-(-sizes[dim] // length) for dim, length in lengths.items())


def make_plan(
    workload: Workload,
    limits: Limits,
    chunks: Mapping[str, int] | None = None,
    *,
    where: Literal["here", "processes", "elsewhere"] = "here",
    copies: int = 1,
) -> Plan:
    """Cut a study into blocks and parts and estimate its cost.

    Parameters
    ----------
    workload : Workload
        From the family.
    limits : Limits
        Workers, memory and disk.
    chunks : mapping of str to int, optional
        Block lengths asked for by the user; the rest is chosen here.
    where : {"here", "processes", "elsewhere"}
        Whether the workers are in this process, processes of this machine, or others with memory of their own.
    copies : int
        How often the result is on the disk at the end of a run.

    Returns
    -------
    Plan

    Raises
    ------
    StudyError
        Where `chunks` names a dimension that the result does not have.
    PlanError
        Where the result does not fit the disk or the work does not fit the memory; names the axis to shrink.
    """
    asked = dict(chunks or {})
    _check_chunks(workload, asked)
    output_bytes = workload.bytes_of(workload.sizes) + workload.coordinate_bytes + EMPTY_FILE
    if copies * output_bytes > limits.disk:
        what = "the result" if copies == 1 else "the result and the parts it is made of"
        raise PlanError(_refusal(workload, what, copies * output_bytes, limits.disk, "of free disk"))
    fixed = BASE_MEMORY + workload.fixed_bytes
    fixed += 64 * sum(workload.parameters.values()) + 3 * workload.coordinate_bytes
    if fixed > limits.memory:
        raise PlanError(_refusal(workload, "the program and the axes", fixed, limits.memory, "of memory"))

    series = _series(workload, asked) if "time" in workload.inner else None
    if series:
        fixed += SERIES_HELD[where] * workload.bytes_of({**workload.inner, **series.part})
        _check_blocks(series.part, series.chunks, asked)
    whole = {dim: workload.parameters[dim] for dim in workload.whole}
    free = {dim: size for dim, size in workload.parameters.items() if dim not in whole}
    lengths = {**slab_lengths(free, partial(_part_fits, workload, whole)), **whole}
    part = {dim: lengths[dim] for dim in workload.parameters}
    sizes = {**workload.inner, **part}
    fixed += PARTS_HELD * workload.bytes_of({**sizes, "time": 0})
    blocks = {dim: min(length, sizes[dim]) for dim, length in _blocks(workload, limits.workers, asked).items()}
    _check_blocks(sizes, blocks, asked)
    while True:
        plan = Plan(workload, limits.workers, blocks, part, 0, output_bytes, 0.0, series)
        workers = min(limits.workers, plan.blocks)
        points = math.prod(blocks[dim] for dim in workload.parameters)
        work = workers * workload.block_bytes(points, blocks.get(workload.splittable, 1))
        processes = workers * WORKER_PROCESS_MEMORY if where == "processes" else 0
        peak = fixed + (0 if where == "elsewhere" else work + processes)
        if peak <= limits.memory:
            break
        if not _halve(blocks, workload, asked) or _pieces(sizes, blocks) > PART_BLOCKS:
            raise PlanError(_refusal(workload, "the smallest block of work", peak, limits.memory, "of memory"))
    seconds = workload.points * workload.point_seconds / workers
    return replace(plan, workers=workers, peak_memory=peak, seconds=seconds)


def _check_chunks(workload: Workload, asked: Mapping[str, int]) -> None:
    known = {*workload.sizes, "time"}
    problems = [
        Problem(f"unknown dimension{did_you_mean(dim, known)}; the result has {', '.join(workload.sizes)}", key)
        for dim in asked
        if dim not in known and (key := f"execution.chunks.{dim}")
    ]
    if problems:
        raise StudyError(problems)


def _series(workload: Workload, asked: Mapping[str, int]) -> Series:
    names = [name for name, dims in workload.variables.items() if "time" in dims]
    split = {workload.splittable: workload.inner[workload.splittable]}
    return series_lengths(workload.parameters, workload.inner["time"], split, 8 * len(names), asked)


def _part_fits(workload: Workload, whole: Mapping[str, int], slab: Mapping[str, int]) -> bool:
    sizes = {**slab, **whole}
    seconds = math.prod(sizes.values()) * workload.point_seconds
    return seconds <= PART_SECONDS and workload.bytes_of({**workload.inner, **sizes, "time": 0}) <= PART_BYTES


def _check_blocks(sizes: Mapping[str, int], blocks: Mapping[str, int], asked: Mapping[str, int]) -> None:
    """Refuse chunks so small that the graph of one part would be large."""
    count = _pieces(sizes, blocks)
    if count > PART_BLOCKS and asked:
        dim = min((dim for dim in blocks if dim in asked), key=lambda dim: blocks[dim] / sizes[dim])
        enough = min(sizes[dim], -(-blocks[dim] * count // PART_BLOCKS))
        problem = (
            f"would cut one part of the work into {count:,} blocks, more than {PART_BLOCKS:,}; {enough:,} is enough"
        )
        raise StudyError(Problem(f"{problem} (got {asked[dim]})", f"execution.chunks.{dim}"))


def _blocks(workload: Workload, workers: int, asked: Mapping[str, int]) -> dict[str, int]:
    """Block lengths: whole points grouped while they are quick, one point cut along `splittable` while it is slow."""
    point_seconds = workload.point_seconds
    total = workload.points * point_seconds
    pieces = min(BLOCKS_PER_WORKER * workers, PART_BLOCKS // 2)
    target = max(LEAST_SECONDS, min(BLOCK_SECONDS, total / pieces))
    room = max(1, int(target / point_seconds)) if point_seconds > 0 else workload.points
    lengths: dict[str, int] = {}
    for dim, size in reversed(list(workload.parameters.items())):
        lengths[dim] = min(asked.get(dim, room), size)
        room = max(1, room // size)
    blocks = dict(reversed(lengths.items()))
    if workload.splittable:
        size = workload.inner[workload.splittable]
        pieces = max(1, min(math.ceil(point_seconds / target), size // 32))
        blocks[workload.splittable] = min(asked.get(workload.splittable, -(-size // pieces)), size)
    return blocks


def _halve(blocks: dict[str, int], workload: Workload, asked: Mapping[str, int]) -> bool:
    """Halve the longest block that the user did not fix; false where nothing is left to halve."""
    choice = max((dim for dim in blocks if dim not in asked and blocks[dim] > 1), key=blocks.__getitem__, default=None)
    if choice is None:
        return False
    blocks[choice] = -(-blocks[choice] // 2)
    return True


def _refusal(workload: Workload, what: str, need: int, have: int, kind: str) -> str:
    lengths = {**workload.sizes, **workload.axes}
    longest = max(lengths, key=lambda dim: lengths[dim])
    remedies = [f"shrink {longest!r} first"]
    if "time" in workload.inner and kind == "of free disk":
        remedies.append("leave out output.time_series")
    if kind == "of memory":
        remedies.insert(0, f"raise execution.memory to {human_bytes(1.05 * need)}")
    shape = " x ".join(f"{dim} {size:,}" for dim, size in lengths.items())
    return (
        f"refused: {what} would take {human_bytes(need)}, and there are {human_bytes(have)} {kind}. "
        f"The grid is {shape}; {' or '.join(remedies)}."
    )
