"""Plan a study, raise an error if it does not fit on the machine, and build its result as a lazy data set."""

from __future__ import annotations

import math
import os
import pickle
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import psutil

from heliosweep.config import Study, did_you_mean, with_inputs
from heliosweep.errors import PlanError, Problem, StudyError
from heliosweep.files import human_bytes, processors
from heliosweep.grid.regions import (
    Cut,
    Piece,
    Region,
    Variable,
    bytes_of,
    checked,
    chunks_by_block,
    in_result,
    index_of,
    of_kind,
    regions,
    shape_of,
    shortened,
)
from heliosweep.lazy import xr

#: Memory of a process with its libraries, additional memory for each worker process, and memory for the report. [bytes]
BASE_MEMORY, WORKER_PROCESS_MEMORY, REPORT_MEMORY = 296 * 2**20, 100 * 2**20, 144 * 2**20
#: Size of a NetCDF file without data. [bytes]
EMPTY_FILE = 56 * 2**10
#: Maximum size of the values in a block of each kind. [bytes]
BLOCK_BYTES = {"points": 16 * 2**20, "series": 32 * 2**20}
#: Minimum and maximum number of evaluations in a chunk. A killed run loses only the chunks being computed.
MIN_EVALUATIONS, MAX_EVALUATIONS = 20_000, 1_000_000
#: Target number of chunks (enough for all workers to finish at nearly the same time), and maximum number of chunks.
WANTED_CHUNKS, MAX_CHUNKS = 64, 10_000
#: Number of copies of a block in memory while it is written: chunks, joined, finished and written values.
BLOCK_COPIES = 4
#: Maximum size of the `passing` variables (not in the result) in one call of `Family.finish`. [bytes]
PASS_BYTES = 16 * 2**20
#: Location of the workers: this process, processes on this machine, or machines with separate memory.
Where: TypeAlias = Literal["here", "processes", "elsewhere"]


@dataclass(frozen=True)
class Workload:
    """Dimension lengths and memory requirements of a study.

    Parameters
    ----------
    parameters : mapping of str to int
        Lengths of the swept dimensions, in the order of the result.
    inner : mapping of str to int
        Lengths of the dimensions that are not swept, such as ``heliostat`` and ``time``.
    evaluations : int
        Number of kernel evaluations for one parameter point.
    unit : str
        Unit of one evaluation, such as ``heliostat-instants``.
    working_bytes : callable
        Function that computes the working memory [bytes] of a chunk from its number of points and its length along
        `splittable`.
    splittable : str
        Inner dimension along which one parameter point may be split; empty if there is none.
    whole : tuple of str
        Swept dimensions over which `Family.finish` computes statistics. These dimensions are not divided into blocks,
        and are the last to be divided into chunks.
    uncut : tuple of str
        Dimensions that are not divided into chunks.
    coordinate_bytes : int
        Size of the coordinates. [bytes]
    axes : mapping of str to int
        Lengths of dimensions that are evaluated but not stored. Messages list these lengths.
    fixed_bytes : int
        Memory that the family needs in addition to the chunks. [bytes]
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
        """Length of each dimension of the result."""
        return {**self.parameters, **self.inner}

    @property
    def points(self) -> int:
        """Number of parameter points."""
        return math.prod(self.parameters.values())


@dataclass(frozen=True, repr=False)
class Plan:
    """Cost of a study, and division of its result into blocks and chunks.

    Parameters
    ----------
    workload : Workload
        Sizes of the study.
    variables : mapping of str to Variable
        Variables of the result.
    cuts : dict of str to Cut
        Blocks and chunks of the variables of each kind, ``points`` and ``series``.
    workers : int
        Number of chunks that are computed at the same time.
    peak_memory, output_bytes : int
        Estimated peak memory and size of the result. [bytes]
    seconds : float, optional
        Computing time extrapolated from a small region, or None if it was not measured. [s]
    """

    workload: Workload
    variables: Mapping[str, Variable]
    cuts: dict[str, Cut]
    workers: int
    peak_memory: int
    output_bytes: int
    seconds: float | None = None

    def __repr__(self) -> str:
        return "\n".join(["Plan", *(f"  {name:11}  {value}" for name, value in self.in_words().items())])

    def in_words(self) -> dict[str, str]:
        """Return descriptions of the size and cost of the study, by the name of the quantity."""
        work, seconds = self.workload, self.seconds
        time = "unknown before chunks are computed" if seconds is None else f"about {human_seconds(max(seconds, 0.1))}"
        return {
            "dimensions": ", ".join(f"{dim} {length:,}" for dim, length in work.sizes.items()) or "none",
            "points": f"{work.points:,} parameter combinations",
            "evaluations": f"{work.points * work.evaluations:,} {work.unit}",
            "chunks": f"{self.chunk_count:,}, each stored when it is complete",
            "workers": str(self.workers),
            "peak memory": f"about {human_bytes(self.peak_memory)}",
            "output": human_bytes(self.output_bytes),
            "time": time,
        }

    @property
    def chunk_count(self) -> int:
        """Number of chunks."""
        return sum(cut.chunk_count for cut in self.cuts.values())

    def chunks(self) -> Iterator[Piece]:
        """Yield all chunks, block by block."""
        return (chunk for _, chunks in chunks_by_block(self.cuts) for chunk in chunks)


def make_plan(
    workload: Workload,
    variables: Mapping[str, Variable],
    limits: Limits,
    chunks: Mapping[str, int] | None = None,
    *,
    where: Where = "here",
) -> Plan:
    """Choose the blocks and chunks of a study and estimate its cost.

    Parameters
    ----------
    workload : Workload
        Sizes of the study.
    variables : mapping of str to Variable
        Variables of the result.
    limits : Limits
        Limits on workers, memory and disk space.
    chunks : mapping of str to int, optional
        Chunk lengths set by the user.
    where : {"here", "processes", "elsewhere"}
        Location of the workers.

    Raises
    ------
    StudyError
        If `chunks` contains an unknown dimension.
    PlanError
        If the result does not fit on the disk, or if the computation does not fit in memory. The message names the
        dimension to reduce.
    """
    asked, sizes = dict(chunks or {}), workload.sizes
    if problems := [
        Problem(
            f"unknown dimension{did_you_mean(dim, sizes)}; the result has {', '.join(sizes)}", f"execution.chunks.{dim}"
        )
        for dim in asked
        if dim not in sizes and dim != "time"
    ]:
        raise StudyError(problems)
    asked |= {dim: sizes[dim] for dim in workload.uncut if dim in sizes}
    stored = bytes_of(in_result(variables), sizes)
    output_bytes, passing = stored + workload.coordinate_bytes + EMPTY_FILE, bytes_of(variables, sizes) - stored
    if (disk := 2 * output_bytes + passing) > limits.disk:  # chunks are kept until the result is written
        raise PlanError(_refusal(workload, "the result and its chunks", disk, limits.disk, "of free disk"))
    axes = 64 * sum(workload.parameters.values()) + 3 * workload.coordinate_bytes
    fixed = BASE_MEMORY + workload.fixed_bytes + axes
    least = fixed + REPORT_MEMORY
    if least > limits.memory:
        raise PlanError(_refusal(workload, "the program and the dimensions", least, limits.memory, "of memory"))
    free, peak = limits.memory - fixed, least
    cuts: dict[str, Cut] = {}
    for kind in sorted({one.kind for one in variables.values()}):
        own = {name: one for name, one in variables.items() if one.kind == kind}
        cuts[kind] = cut = _cut(workload, own, kind, asked, limits.workers, free, where)
        peak = max(peak, fixed + _held(workload, own, cut, limits.workers, where))
    if peak > limits.memory:
        raise PlanError(_refusal(workload, "the smallest chunk of the computation", peak, limits.memory, "of memory"))
    workers = min(limits.workers, max(cut.chunk_count for cut in cuts.values()))
    return Plan(workload, variables, cuts, workers, peak, output_bytes)


def _cut(
    workload: Workload,
    variables: Mapping[str, Variable],
    kind: str,
    asked: Mapping[str, int],
    workers: int,
    free: int,
    where: Where,
) -> Cut:
    """Choose blocks of limited size, and chunks with limited memory and a limited number of evaluations."""
    split, parameters = workload.splittable, workload.parameters
    whole = [dim for dim in parameters if dim in workload.whole]
    swept = [(dim, 1) for dim in parameters if dim not in whole]
    sizes = dict(parameters)
    if kind == "series":
        sizes["time"] = workload.inner["time"]
        if split and not all(split in one.dims for one in of_kind(variables, kind).values()):
            split = ""  # some variables are sums over this dimension
    if split:
        sizes[split] = workload.inner[split]
    # In a large field, the sun directions within a block of 512 instants are similar.
    inner = [("time", 512), *([(split, 1)] if split else []), ("time", 1)] if kind == "series" else []
    stored = in_result(variables)
    block = shortened(
        sizes, [*swept, *inner], lambda part: bytes_of(stored, {**workload.inner, **part}) <= BLOCK_BYTES[kind]
    )
    total = workload.points * workload.evaluations
    target = max(MIN_EVALUATIONS, min(MAX_EVALUATIONS, total // WANTED_CHUNKS), 4 * total // MAX_CHUNKS)
    cells = math.prod(sizes.values())
    order = [*swept, *((dim, 1) for dim in whole), *([(split, 32)] if split else [])]  # kernels reuse prepared data
    order = [(dim, least) for dim, least in [*order, *inner[-1:]] if dim not in asked]
    chunk = {dim: min(asked.get(dim, length), length) for dim, length in block.items()}
    chunk = shortened(chunk, order, lambda part: total * math.prod(part.values()) <= target * cells)
    return Cut(sizes, block, shortened(
        chunk, [(dim, 1) for dim, _ in order],
        lambda part: _held(workload, variables, Cut(sizes, block, part), workers, where) <= free,
    ))  # fmt: skip


def _held(workload: Workload, variables: Mapping[str, Variable], cut: Cut, workers: int, where: Where) -> int:
    """Return the memory needed for the chunks being computed and the block being written. [bytes]"""
    block, chunk = ({**workload.inner, **lengths} for lengths in (cut.block, cut.chunk))
    stored, values = in_result(variables), bytes_of(variables, chunk)
    written = BLOCK_COPIES * bytes_of(stored, block) + 3 * PASS_BYTES * (len(stored) < len(variables))
    workers = min(workers, cut.chunk_count)
    if where == "elsewhere":
        return max(written, (workers + 2) * values)
    points = math.prod(cut.chunk[dim] for dim in workload.parameters)
    length = cut.chunk.get(workload.splittable, workload.inner.get(workload.splittable, 1))
    each = workload.working_bytes(points, length) + 2 * values
    return max(written, workers * (each + (WORKER_PROCESS_MEMORY if where == "processes" else 0)) + 2 * values)


def _refusal(workload: Workload, what: str, need: int, have: int, kind: str) -> str:
    lengths = {**workload.sizes, **workload.axes}
    remedies = [f"shrink {max(lengths, key=lambda dim: lengths[dim])!r} first"]
    if "time" in workload.inner and kind == "of free disk":
        remedies.append("omit output.time_series")
    if kind == "of memory":
        remedies.insert(0, f"raise execution.memory to {human_bytes(1.05 * need)}")
    shape = " x ".join(f"{dim} {size:,}" for dim, size in lengths.items())
    return (
        f"refused: {what} would need {human_bytes(need)}, with {human_bytes(have)} {kind}. "
        f"The grid is {shape}; {' or '.join(remedies)}."
    )


#: Folder of the Linux control groups, and file with the control group of this process.
_CGROUPS, _OWN_GROUP = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")


@dataclass(frozen=True)
class Limits:
    """Limits on the number of workers, memory [bytes] and disk space [bytes], from the machine or the study."""

    workers: int
    memory: int
    disk: int


def machine_limits(workers: int | None, memory: int | None, folder: str | os.PathLike[str]) -> Limits:
    """Return the limits on workers, memory and disk: given values, otherwise the limits of this machine.

    Parameters
    ----------
    workers : int, optional
        Number of workers (default: all processors available to this process).
    memory : int, optional
        Memory limit (default: 80 % of the memory available within the control groups of this process). [bytes]
    folder : path
        Result folder. Free disk space is measured at the nearest existing parent folder.
    """
    memory = memory or int(0.8 * max(0, min([psutil.virtual_memory().available, *_group_memory()])))
    return Limits(workers or processors(), memory, _free_disk(Path(folder).absolute()))


def _group_memory() -> Iterator[int]:
    """Yield the available memory of the control groups (version 2) of this process. [bytes]"""
    with suppress(OSError, StopIteration):
        own = next(line for line in _OWN_GROUP.read_text(encoding="utf-8").splitlines() if line.startswith("0::"))
        place = _CGROUPS / own[3:].strip("/")
        for folder in (place, *place.relative_to(_CGROUPS).parents):
            with suppress(OSError, ValueError):
                limit, used = (int((_CGROUPS / folder / name).read_text()) for name in ("memory.max", "memory.current"))
                statistics = (_CGROUPS / folder / "memory.stat").read_text().split()
                cached = dict(zip(statistics[::2], statistics[1::2], strict=True)).get("inactive_file", 0)
                yield limit - used + int(cached) + psutil.Process().memory_info().rss


def _free_disk(folder: Path) -> int:
    for place in (folder, *folder.parents):
        with suppress(OSError, ValueError):
            return shutil.disk_usage(place).free
    return 0


def human_seconds(seconds: float) -> str:
    """Return a duration as text, for instance ``4.2 s`` or ``2 h 05 min``."""
    if seconds < 90:
        return f"{seconds:.1f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"


def trial_seconds(work: Work, plan: Plan) -> float | None:
    """Return the estimated computing time of a plan on its workers, excluding reading and writing.

    Parameters
    ----------
    work : Work
        Study with all data needed for the computation.
    plan : Plan
        Plan of the study.

    Returns
    -------
    float or None
        Extrapolated time [s], or None if the trial fails or takes too long, for instance because the kernels must first
        be compiled.
    """
    try:
        sent = pickle.dumps((work, plan.cuts))
        command = [sys.executable, "-c", f"from {__name__} import _measure; _measure()"]
        answer = subprocess.run(command, input=sent, capture_output=True, timeout=10, check=True)
        return float(answer.stdout) / plan.workers
    except (OSError, ValueError, TypeError, AttributeError, pickle.PicklingError, subprocess.SubprocessError):
        return None


def _measure() -> None:
    """Read a study from standard input and print its computing time, extrapolated from parts of a chunk. [s]"""
    work, cuts = pickle.load(sys.stdin.buffer)
    work.family.prepare(work.study)
    total = 0.0
    for kind, cut in cuts.items():
        cells = math.prod(cut.chunk.values())
        for share in (512, 256, 32, 4, 1):  # the first part is a warm-up
            few: Any = lambda lengths, most=cells // share: math.prod(lengths.values()) <= most  # noqa: E731
            lengths = shortened(cut.chunk, [(dim, 1) for dim in cut.chunk], few)
            starts = {dim: (cut.sizes[dim] - length) // 3 for dim, length in lengths.items()}
            region = {dim: slice(start, start + lengths[dim]) for dim, start in starts.items()}
            began = time.perf_counter()
            work.compute(Piece("trial", kind, region))
            seconds = time.perf_counter() - began
            if seconds > 0.25 and share < 512:  # otherwise time the next part, which has about 8 times as many cells
                break
        total += cut.chunk_count * seconds * cells / math.prod(lengths.values())
    print(total)


#: Chunks with the values of their variables.
Chunks: TypeAlias = Iterable[tuple[Piece, Mapping[str, np.ndarray]]]


class Work:
    """Study with all data needed to compute any region of its result. The study is sent to each worker once.

    Parameters
    ----------
    family : Family
        Family of the study.
    study : Study
        The study.
    variables : mapping of str to Variable
        Variables of the result.
    sizes : mapping of str to int
        Lengths of the dimensions of the result.
    """

    def __init__(self, family: Any, study: Study, variables: Mapping[str, Variable], sizes: Mapping[str, int]) -> None:
        self.family, self.variables, self.sizes = family, dict(variables), dict(sizes)
        self.study = with_inputs(study)
        self.inputs = family.inputs(study)

    def compute(self, chunk: Piece) -> dict[str, np.ndarray]:
        """Return the values of a chunk by variable name."""
        made = self.family.compute(self.study, self.inputs, chunk.region)
        return checked(made, of_kind(self.variables, chunk.kind), chunk.region, self.sizes)

    def finish(self, block: Piece, chunks: Callable[[list[str]], Chunks]) -> xr.Dataset:
        """Return all variables of a block in the order of the result file.

        Parameters
        ----------
        block : Piece
            The block.
        chunks : callable
            Function that returns the chunks with the values of the named variables. The function is called once for the
            variables of the result, and once for each group of passing variables.
        """
        own = {name: one for name, one in self.variables.items() if one.kind == block.kind}
        later = {name: one for name, one in own.items() if one.finished}
        computed = of_kind(self.variables, block.kind)
        made: dict[str, np.ndarray] = {}
        for names, region in self._groups(computed, block):
            joined = self._joined(chunks(names), {name: computed[name] for name in names}, region)
            made |= {name: array for name, array in joined.items() if not computed[name].passing}
            if not later:
                break
            some = xr.Dataset({name: (computed[name].dims, array) for name, array in joined.items()})
            finished = self.family.finish(self.study, self.inputs, block.region, some)
            for name, one in later.items():
                if name in finished:
                    if name not in made:
                        made[name] = np.empty(shape_of(one, block.region, self.sizes), one.dtype)
                    array = finished[name].transpose(*one.dims).values
                    made[name][index_of(one.dims, region, block.region)] = array
        if missing := later.keys() - made.keys():
            raise ValueError(f"the family did not compute {', '.join(sorted(missing))}")
        return xr.Dataset({name: (one.dims, made[name]) for name, one in in_result(own).items()})

    def _groups(self, computed: Mapping[str, Variable], block: Piece) -> Iterator[tuple[list[str], Region]]:
        """Yield the names and region of variables that `Family.finish` processes together.

        Each variable with `passing` set is finished separately. A large variable is divided along its longest inner
        dimension.
        """
        yield [name for name, one in computed.items() if not one.passing], block.region
        for name, one in computed.items():
            if one.passing:
                shape = dict(zip(one.dims, shape_of(one, block.region, self.sizes), strict=True))
                inner = {dim: size for dim, size in shape.items() if dim not in block.region} or {"": 1}
                dim = max(inner, key=inner.__getitem__)
                length = max(1, PASS_BYTES * inner[dim] // max(bytes_of({name: one}, shape), 1))
                for piece in regions({dim: slice(0, inner[dim])}, {dim: length}):
                    yield [name], {**block.region, **piece}

    def _joined(self, chunks: Chunks, variables: Mapping[str, Variable], region: Region) -> dict[str, np.ndarray]:
        whole = {name: np.empty(shape_of(one, region, self.sizes), one.dtype) for name, one in variables.items()}
        for chunk, values in chunks:
            inner = {dim: span for dim, span in region.items() if dim not in chunk.region}
            for name, one in variables.items():
                within = index_of(one.dims, chunk.region, region)
                whole[name][within] = values[name][index_of(one.dims, inner)]
        return whole


def build(work: Work, plan: Plan, coordinates: xr.Dataset) -> xr.Dataset:
    """Return the result of a study as a lazy data set, with one point or several small points per chunk."""
    lazy = [_mapped(work, kind, cut, plan) for kind, cut in plan.cuts.items()]
    return xr.merge(lazy)[list(in_result(work.variables))].assign_coords(coordinates.coords)


def _mapped(work: Work, kind: str, cut: Cut, plan: Plan) -> xr.Dataset:
    import dask.array as da

    load, sizes = plan.workload, plan.workload.sizes
    free = [dim for dim in load.parameters if dim not in load.whole]
    single = math.prod(sizes[dim] for dim in free) <= 1000
    chunks = {dim: 1 if single else cut.chunk[dim] for dim in free} | {dim: sizes[dim] for dim in load.whole}
    chunks |= {dim: cut.block[dim] for dim in cut.sizes if kind == "series" and dim not in load.parameters}
    chunks = {_POINT: 1} | {dim: chunks[dim] for dim in cut.sizes if dim in chunks}
    index = {f"position in {dim}": (dim, np.arange(sizes.get(dim, 1))) for dim in chunks}
    template = {}
    for name, one in in_result(work.variables).items():
        if one.kind == kind:
            lengths = [1, *(chunks.get(dim, sizes[dim]) for dim in one.dims)]
            # Without a name, dask computes a name from the arguments, which takes most of the time of this function.
            zeros = da.zeros((1, *shape_of(one, {}, sizes)), dtype=one.dtype, chunks=lengths, name=f"template-{name}")
            template[name] = ((_POINT, *one.dims), zeros, dict(one.attrs))
    arguments = {"work": work, "kind": kind}
    mapped = xr.map_blocks(_block, xr.Dataset(index).chunk(chunks), kwargs=arguments, template=xr.Dataset(template))
    return mapped.isel({_POINT: 0})


#: Additional dimension of length 1, for studies without swept dimensions.
_POINT = "point"


def _block(index: xr.Dataset, work: Work, kind: str) -> xr.Dataset:
    spans = {str(array.dims[0]): array.values for array in index.data_vars.values()}
    region = {dim: slice(int(at[0]), int(at[-1]) + 1) for dim, at in spans.items() if dim != _POINT}
    piece = Piece("lazy", kind, region)
    values = [(piece, work.compute(piece))]
    return work.finish(piece, lambda _: values).expand_dims(_POINT)
