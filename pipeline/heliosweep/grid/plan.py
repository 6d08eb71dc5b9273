"""What a study will cost before it runs: points, blocks, memory, disk, time; and a clear no where it cannot fit.

A study is computed in *parts*, one after the other, each a slab of the parameter grid with a graph of bounded size;
a part is cut into *blocks*, the tasks that run side by side. Neither changes a number.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from heliosweep.errors import PlanError
from heliosweep.grid.limits import Limits, human_bytes

#: A process with the libraries loaded and figures drawn, before any data. [bytes]
BASE_MEMORY = 270 * 2**20
#: Work that a block should hold: long against a task's overhead of 0.2 ms, short against the run. [s]
BLOCK_SECONDS = 0.25
#: Below this a block is not worth its overhead. [s]
LEAST_SECONDS = 0.005
#: Blocks per worker that keep all workers busy to the end of a part.
BLOCKS_PER_WORKER = 8
#: Tasks in one graph at the most.
PART_BLOCKS = 4000
#: Results of one part that may be held in memory. [bytes]
PART_BYTES = 64 * 2**20
#: Time series that one block returns, and that one part holds. [bytes]
SERIES_BLOCK_BYTES = 8 * 2**20
SERIES_PART_BYTES = 32 * 2**20
#: One storage chunk of one time series; a fixed property of the file, whatever the blocks. [bytes]
STORAGE_BYTES = 2**20


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

    @property
    def sizes(self) -> dict[str, int]:
        """All dimensions of the result."""
        return {**self.parameters, **self.inner}

    @property
    def points(self) -> int:
        """Parameter combinations."""
        return math.prod(self.parameters.values())

    def bytes_of(self, sizes: Mapping[str, int]) -> int:
        """Size of the stored variables for the given lengths of dimensions. [bytes]."""
        return sum(
            self.itemsize.get(name, 8) * math.prod(sizes[dim] for dim in dims) for name, dims in self.variables.items()
        )


@dataclass(frozen=True)
class Plan:
    """The cost of a study and how it will be cut.

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
    storage : dict of str to int
        Lengths of a storage chunk of a time series along ``time`` and the split dimension; empty without series.
    series_part : dict of str to int
        Part lengths of the time series, along the swept dimensions and ``time``.
    notes : tuple of str
        Warnings about the study, for the user.
    """

    workload: Workload
    workers: int
    chunks: dict[str, int]
    part: dict[str, int]
    peak_memory: int
    output_bytes: int
    seconds: float
    storage: dict[str, int] = field(default_factory=dict)
    series_part: dict[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def blocks(self) -> int:
        """Number of blocks in the whole study."""
        sizes = self.workload.sizes
        return math.prod(-(-sizes[dim] // length) for dim, length in self.chunks.items())

    def parts(self) -> Iterator[dict[str, slice]]:
        """Slabs of the swept dimensions, in the order in which they are computed and written."""
        return slabs(self.workload.parameters, self.part)

    def series_parts(self) -> Iterator[dict[str, slice]]:
        """Slabs of the swept dimensions and ``time`` in which a time series is computed and written."""
        sizes = {**self.workload.parameters, "time": self.workload.inner["time"]}
        return slabs(sizes, self.series_part)


def slabs(sizes: Mapping[str, int], lengths: Mapping[str, int]) -> Iterator[dict[str, slice]]:
    """Cut a grid into slabs, last dimension fastest.

    Parameters
    ----------
    sizes, lengths : mapping of str to int
        Length of each dimension, and of a slab along it.

    Yields
    ------
    dict of str to slice
    """
    starts = [range(0, size, lengths[dim]) for dim, size in sizes.items()]
    for corner in itertools.product(*starts):
        yield {
            dim: slice(start, min(start + lengths[dim], size))
            for (dim, size), start in zip(sizes.items(), corner, strict=True)
        }


def make_plan(
    workload: Workload,
    limits: Limits,
    chunks: Mapping[str, int] | None = None,
    notes: tuple[str, ...] = (),
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
    notes : tuple of str, optional
        Warnings to carry along.

    Returns
    -------
    Plan

    Raises
    ------
    PlanError
        Where the result does not fit the disk or the work does not fit the memory; names the axis to shrink.
    """
    output_bytes = workload.bytes_of(workload.sizes)
    if output_bytes > limits.disk:
        raise PlanError(_refusal(workload, "the result", output_bytes, limits.disk, "of free disk"))
    axes_bytes = 64 * sum(workload.parameters.values())
    if BASE_MEMORY + axes_bytes > limits.memory:
        raise PlanError(_refusal(workload, "its axes", axes_bytes, limits.memory, "of memory"))

    asked = dict(chunks or {})
    blocks = _blocks(workload, limits.workers, asked)
    series = _series(workload, asked) if "time" in workload.inner else None
    while True:
        whole = {dim: workload.parameters[dim] for dim in workload.whole}
        free = {dim: size for dim, size in workload.parameters.items() if dim not in whole}
        slab = _slab(free, lambda slab, blocks=blocks, whole=whole: _part_fits(workload, blocks, {**slab, **whole}))
        part = {dim: {**slab, **whole}[dim] for dim in workload.parameters}
        blocks = {dim: min(length, part.get(dim, length)) for dim, length in blocks.items()}
        points = math.prod(blocks[dim] for dim in workload.parameters)
        held = 2 * workload.bytes_of({**workload.inner, **part, "time": 0})
        work = limits.workers * workload.block_bytes(points, blocks.get(workload.splittable, 1))
        if series:
            # One part being written, one being computed in blocks and put together, and what the allocator keeps.
            held += 4 * workload.bytes_of({**workload.inner, **series.part})
            work += limits.workers * SERIES_BLOCK_BYTES
        peak = BASE_MEMORY + axes_bytes + work + held
        if peak <= limits.memory:
            break
        if not _halve(blocks, workload, asked):
            raise PlanError(_refusal(workload, "the smallest block of work", peak, limits.memory, "of memory"))
    seconds = workload.points * workload.evaluations * workload.seconds / limits.workers
    return Plan(
        workload=workload,
        workers=limits.workers,
        chunks={**blocks, "time": series.block} if series else blocks,
        part=part,
        peak_memory=peak,
        output_bytes=output_bytes,
        seconds=seconds,
        storage=series.storage if series else {},
        series_part=series.part if series else {},
        notes=notes,
    )


def _part_fits(workload: Workload, blocks: Mapping[str, int], slab: Mapping[str, int]) -> bool:
    inner = math.prod(-(-size // blocks.get(dim, size)) for dim, size in workload.inner.items())
    tasks = inner * math.prod(-(-length // blocks[dim]) for dim, length in slab.items())
    return tasks <= PART_BLOCKS and workload.bytes_of({**workload.inner, **slab, "time": 0}) <= PART_BYTES


def _blocks(workload: Workload, workers: int, asked: Mapping[str, int]) -> dict[str, int]:
    """Block lengths: whole points grouped while they are quick, one point cut along `splittable` while it is slow."""
    point_seconds = workload.evaluations * workload.seconds
    total = workload.points * point_seconds
    target = max(LEAST_SECONDS, min(BLOCK_SECONDS, total / (BLOCKS_PER_WORKER * workers)))
    room = max(1, int(target / point_seconds)) if point_seconds > 0 else workload.points
    lengths: dict[str, int] = {}
    for dim, size in reversed(workload.parameters.items()):
        lengths[dim] = min(asked.get(dim, room), size)
        room = max(1, room // size)
    blocks = dict(reversed(lengths.items()))
    if workload.splittable:
        size = workload.inner[workload.splittable]
        pieces = max(1, min(math.ceil(point_seconds / target), size // 32))
        blocks[workload.splittable] = min(asked.get(workload.splittable, -(-size // pieces)), size)
    return blocks


def _slab(sizes: Mapping[str, int], fits: Callable[[Mapping[str, int]], bool], grain: int = 1) -> dict[str, int]:
    """Largest slab that is contiguous in the order of the result, whole from the last dimension on.

    The last dimension is cut in multiples of `grain`.
    """
    slab = dict.fromkeys(sizes, 1)
    last = next(reversed(slab), None)
    if last is not None:
        slab[last] = min(grain, sizes[last])
    for dim, size in reversed(sizes.items()):
        if fits({**slab, dim: size}):
            slab[dim] = size
            continue
        while fits({**slab, dim: slab[dim] * 2}) and slab[dim] * 2 < size:
            slab[dim] *= 2
        break
    return slab


class _Series(NamedTuple):
    storage: dict[str, int]
    block: int
    part: dict[str, int]


def _series(workload: Workload, asked: Mapping[str, int]) -> _Series:
    """How the time series are stored, computed and written: whole storage chunks only, each written once."""
    times, split = workload.inner["time"], workload.inner.get(workload.splittable, 1)
    stored = min(split, STORAGE_BYTES // 8)
    row = max(1, min(times, STORAGE_BYTES // 8 // stored))
    names = [name for name, dims in workload.variables.items() if "time" in dims]
    rows = max(1, asked.get("time", SERIES_BLOCK_BYTES // (8 * split * len(names))) // row)

    def fits(slab: Mapping[str, int]) -> bool:
        return 8 * len(names) * split * math.prod(slab.values()) <= SERIES_PART_BYTES

    block = min(rows * row, times)
    part = _slab({**workload.parameters, "time": times}, fits, grain=block)
    return _Series({"time": row, workload.splittable: stored}, block, part)


def _halve(blocks: dict[str, int], workload: Workload, asked: Mapping[str, int]) -> bool:
    """Halve the longest block that the user did not fix; false where nothing is left to halve."""
    choice = max((dim for dim in blocks if dim not in asked and blocks[dim] > 1), key=blocks.__getitem__, default=None)
    if choice is None:
        return False
    blocks[choice] = -(-blocks[choice] // 2)
    return True


def _refusal(workload: Workload, what: str, need: int, have: int, kind: str) -> str:
    longest = max(workload.sizes, key=lambda dim: workload.sizes[dim])
    shape = " x ".join(f"{dim} {size:,}" for dim, size in workload.sizes.items())
    return (
        f"refused: {what} would take {human_bytes(need)}, and there are {human_bytes(have)} {kind}. "
        f"The grid is {shape}; shrink {longest!r} first"
        + (", or leave out output.time_series" if "time" in workload.inner and longest == "time" else "")
        + "."
    )
