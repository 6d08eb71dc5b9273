"""What a study will cost before it runs: points, parts, memory, disk, time; and a clear no where it cannot fit."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

from heliosweep.config.faults import did_you_mean
from heliosweep.errors import PlanError, Problem, StudyError
from heliosweep.files import human_bytes
from heliosweep.grid.machine import Limits, human_seconds
from heliosweep.grid.regions import (
    PASS_BYTES,
    Cut,
    Part,
    Variable,
    bytes_of,
    in_result,
    of_kind,
    parts_of,
    series_cut,
    slab_lengths,
)

#: A process that computes, besides its data: 220 to 230 MiB with the libraries loaded, and what is not given back of
#: data that it has freed; and a worker process beside it. [bytes]
BASE_MEMORY, WORKER_PROCESS_MEMORY = 296 * 2**20, 100 * 2**20
#: What the report takes more than that, to which data add nothing: they are freed. It was 318 MiB in all. [bytes]
REPORT_MEMORY = 56 * 2**20
#: A NetCDF file without any data. [bytes]
EMPTY_FILE = 56 * 2**10
#: Values of all variables that a slab holds. [bytes]
SLAB_BYTES = 16 * 2**20
#: Minimum and maximum number of kernel evaluations of one part: a kill loses at most the parts that are computed.
MIN_EVALUATIONS, MAX_EVALUATIONS = 20_000, 1_000_000
#: Wanted number of parts of a study of medium size, so that all workers end together; and the maximum number.
WANTED_PARTS, MAX_PARTS = 64, 10_000
#: Least length of a part along the dimension that points are cut along: kernels share what they prepare.
LEAST_SPLIT = 32
#: Slabs in memory while the result is written: its parts, the whole, what is finished from it and what is written.
SLABS_HELD = 4


@dataclass(frozen=True)
class Workload:
    """Sizes and memory of a study, for planning.

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
    working_bytes : callable
        (points, length along `splittable`) -> working memory of the computation of one part. [bytes]
    splittable : str
        Inner dimension along which one parameter point may be cut, or empty.
    whole : tuple of str
        Swept dimensions over which `Family.finish` takes statistics, or along which something costly does not vary: a
        slab holds them whole, and parts are cut along them last.
    uncut : tuple of str
        Swept dimensions along which no part is cut.
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
    working_bytes: Callable[[int, int], int]
    splittable: str = ""
    whole: tuple[str, ...] = ()
    uncut: tuple[str, ...] = ()
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


@dataclass(frozen=True, repr=False)
class Plan:
    """The cost of a study and how it will be cut; printed, a few lines.

    Parameters
    ----------
    workload : Workload
        What was planned.
    variables : mapping of str to Variable
        Variables of the result.
    cuts : dict of str to Cut
        How the variables of each kind, ``points`` and ``series``, are cut.
    storage : dict of str to int
        Lengths of a storage chunk of compressed time series.
    workers : int
        Parts that are computed at a time.
    peak_memory, output_bytes : int
        Estimates. [bytes]
    seconds : float, optional
        Time of the computation, extrapolated from a trial of one small region; None if it was not measured. [s]
    """

    workload: Workload
    variables: Mapping[str, Variable]
    cuts: dict[str, Cut]
    storage: dict[str, int]
    workers: int
    peak_memory: int
    output_bytes: int
    seconds: float | None = None

    def __repr__(self) -> str:
        words = self.in_words()
        cut = f"{self.part_count:,} parts; {self.workers} at a time"
        rows = {name: words.pop(name) for name in ("dimensions", "points", "evaluations")} | {"cut into": cut} | words
        return "\n".join(["Plan", *(f"  {name:11}  {value}" for name, value in rows.items())])

    def in_words(self) -> dict[str, str]:
        """Size and cost of the study in words, by the name of each quantity."""
        work = self.workload
        return {
            "dimensions": ", ".join(f"{dim} {length:,}" for dim, length in work.sizes.items()) or "none",
            "points": f"{work.points:,} parameter combinations",
            "evaluations": f"{work.points * work.evaluations:,} {work.unit}",
            "peak memory": f"about {human_bytes(self.peak_memory)}",
            "output": human_bytes(self.output_bytes),
            "time": self.time_text(),
        }

    def time_text(self) -> str:
        """Time of the computation in words."""
        if self.seconds is None:
            return "not known before parts are computed"
        return f"about {human_seconds(max(self.seconds, 0.1))}"

    @property
    def part_count(self) -> int:
        """Number of parts in the whole study."""
        return sum(cut.part_count for cut in self.cuts.values())

    def parts(self) -> Iterator[Part]:
        """All parts, slab by slab."""
        return parts_of(self.cuts)


def make_plan(
    workload: Workload,
    variables: Mapping[str, Variable],
    limits: Limits,
    chunks: Mapping[str, int] | None = None,
    *,
    where: Literal["here", "processes", "elsewhere"] = "here",
    copies: int = 1,
) -> Plan:
    """Cut a study into slabs and parts and estimate its cost.

    `chunks` are lengths of the parts that the user wants; the rest is chosen here. The workers are in this process,
    processes of this machine, or ``elsewhere``: others with memory of their own. The result is on the disk `copies`
    times at the end of a run.

    Raises StudyError where `chunks` names a dimension that the result does not have, and PlanError, which names the
    axis to shrink, where the result does not fit the disk or the work does not fit the memory.
    """
    asked, most = dict(chunks or {}), dict[str, int]()
    _check_chunks(workload, asked)
    asked |= {dim: workload.parameters[dim] for dim in workload.uncut}
    output_bytes = bytes_of(in_result(variables), workload.sizes) + workload.coordinate_bytes + EMPTY_FILE
    passing = bytes_of(variables, workload.sizes) - bytes_of(in_result(variables), workload.sizes)
    if copies * output_bytes + passing > limits.disk:
        what = "the result" if copies == 1 else "the result and the parts it is made of"
        raise PlanError(_refusal(workload, what, copies * output_bytes + passing, limits.disk, "of free disk"))
    fixed = BASE_MEMORY + workload.fixed_bytes
    fixed += 64 * sum(workload.parameters.values()) + 3 * workload.coordinate_bytes
    least = fixed + REPORT_MEMORY
    if least > limits.memory:
        raise PlanError(_refusal(workload, "the program and the axes", least, limits.memory, "of memory"))
    while True:
        cuts, storage = _cuts(workload, variables, asked, most)
        workers = min(limits.workers, max(cut.part_count for cut in cuts.values()))
        peak = max(least, *(fixed + _held(workload, variables, cut, workers, where) for cut in cuts.values()))
        if peak <= limits.memory:
            break
        if not _shorten(cuts, most, asked):
            raise PlanError(_refusal(workload, "the smallest part of the work", peak, limits.memory, "of memory"))
    return Plan(workload, variables, cuts, storage, workers, peak, output_bytes)


def _check_chunks(workload: Workload, asked: Mapping[str, int]) -> None:
    known = {*workload.sizes, "time"}
    has = ", ".join(workload.sizes)
    problems = [
        Problem(f"unknown dimension{did_you_mean(dim, known)}; the result has {has}", f"execution.chunks.{dim}")
        for dim in asked
        if dim not in known
    ]
    if problems:
        raise StudyError(problems)


def _cuts(
    workload: Workload, variables: Mapping[str, Variable], asked: Mapping[str, int], most: Mapping[str, int]
) -> tuple[dict[str, Cut], dict[str, int]]:
    """Cuts of both kinds, parts as long as `asked` and at most as `most`, and the storage chunks of time series."""
    cuts: dict[str, Cut] = {}
    storage: dict[str, int] = {}
    if any(one.kind == "points" for one in variables.values()):
        cuts["points"] = _points_cut(workload, variables, asked, most)
    if series := of_kind(variables, "series"):
        along = [workload.splittable in one.dims for one in series.values()]
        split = (workload.splittable, workload.inner[workload.splittable]) if any(along) else ("", 1)
        times, longest = workload.inner["time"], {**most, **asked}
        value_bytes = bytes_of(series, {**dict.fromkeys(workload.sizes, 1), split[0]: split[1]}) // split[1]
        if workload.splittable and not any(along):  # sums over what else would be cut: no more than a point in a part
            longest = {**dict.fromkeys(workload.parameters, 1), **longest}
        cuts["series"], storage = series_cut(
            workload.parameters, times, split, value_bytes, longest, whole=any(along) and not all(along)
        )
    return cuts, storage


def _points_cut(
    workload: Workload, variables: Mapping[str, Variable], asked: Mapping[str, int], most: Mapping[str, int]
) -> Cut:
    """Slabs of bounded size, parts with a bounded number of evaluations."""
    split, parameters = workload.splittable, workload.parameters
    whole = {dim: parameters[dim] for dim in workload.whole}
    free = {dim: size for dim, size in parameters.items() if dim not in whole}
    stored = {name: one for name, one in in_result(variables).items() if one.kind == "points"}

    def slab_fits(slab: Mapping[str, int]) -> bool:
        return bytes_of(stored, {**workload.inner, **slab, **whole}) <= SLAB_BYTES

    lengths = {**slab_lengths(free, slab_fits), **whole}
    slab = {dim: lengths[dim] for dim in parameters}
    total = workload.points * workload.evaluations
    target = max(MIN_EVALUATIONS, min(MAX_EVALUATIONS, total // WANTED_PARTS), total // MAX_PARTS)

    fixed = {dim: min(length, slab[dim]) for dim, length in asked.items() if dim in slab}

    def part_fits(part: Mapping[str, int]) -> bool:
        return math.prod({**part, **fixed}.values()) * workload.evaluations <= target

    cut_last = {dim: slab[dim] for dim in (*free, *whole)}
    part = {**slab_lengths(cut_last, part_fits, {**most, **fixed}), **fixed}
    sizes = dict(parameters)
    if split:
        size = sizes[split] = slab[split] = workload.inner[split]
        pieces = max(1, min(math.ceil(workload.evaluations / target), size // LEAST_SPLIT))
        part[split] = min(asked.get(split, -(-size // pieces)), most.get(split, size), size)
    return Cut(sizes, slab, part)


def _held(workload: Workload, variables: Mapping[str, Variable], cut: Cut, workers: int, where: str) -> int:
    """Memory for parts that are computed and on their way, and for a slab that is written. [bytes]"""
    kind = "series" if "time" in cut.sizes else "points"
    stored = {name: one for name, one in variables.items() if one.kind == kind}
    slab, part = ({**workload.inner, **lengths} for lengths in (cut.slab, cut.part))
    values, points = bytes_of(stored, part), math.prod(cut.part[dim] for dim in workload.parameters)
    written = SLABS_HELD * bytes_of(in_result(stored), slab)
    if len(in_result(stored)) < len(stored):
        written += 3 * PASS_BYTES
    if where == "elsewhere":
        return max(written, (workers + 2) * values)
    length = cut.part.get(workload.splittable, workload.inner.get(workload.splittable, 1))
    each = workload.working_bytes(points, length) + 2 * values
    return max(written, workers * (each + (WORKER_PROCESS_MEMORY if where == "processes" else 0)) + 2 * values)


def _shorten(cuts: Mapping[str, Cut], most: dict[str, int], asked: Mapping[str, int]) -> bool:
    """Halve the longest dimension of a part that the user did not fix; false where nothing is left to halve."""
    lengths = {dim: length for cut in cuts.values() for dim, length in cut.part.items() if dim not in asked}
    dim = max(lengths, key=lengths.__getitem__, default="")
    if not dim or lengths[dim] == 1:
        return False
    most[dim] = -(-lengths[dim] // 2)
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
