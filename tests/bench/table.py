"""One table for all benchmarks: rates of kernels on one core, beside named baselines and the machine's arithmetic peak.

A benchmark yields rows, made by `measured`. Nothing is asserted: times depend on the machine and on its other work.
Times of one core are those of the processor, each the best of a few runs.
"""

from __future__ import annotations

import os
import platform
import re
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import date
from importlib import metadata
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.table import Table

__all__ = ["Line", "Row", "best", "measured", "peak", "show", "two_threads"]

WIDTH = 120
#: Around the table of a page.
BEGIN, END = "<!-- table of make bench -->", "<!-- end of the table -->"
#: A measurement lasts so long at least: shorter work is repeated. [s]
SHORTEST = 0.01
#: Of the chains that measure the peak: steps of each, values in the fast memory.
STEPS, VALUES = 16, 256

NOTES = """\
million/s   units of work per second on one core; faster than: how many times, in the same run
of peak     additions, multiplications, divisions, roots and library functions, one operation each, over the peak:
            counted in the sources for the work done. The kernels fuse no multiply-add, so that the same bits come from
            every processor: half of the peak is their ceiling, and less where they divide
2 threads   work per second of two threads that do the same at once, over that of one; needs two idle cores
field       operations of each stage times measured mean numbers of candidates, images and overlaps, all unions
"""


@dataclass(frozen=True)
class Row:
    """One kernel on one core."""

    kernel: str
    unit: str
    seconds: float
    """For each unit of work, on one core; 0 for a row that is a remark alone."""
    beside: dict[str, float] = field(default_factory=dict)
    """Seconds of baselines for each unit of the same work, by their names."""
    operations: float | None = None
    """Arithmetic operations of a unit, None where no honest count is possible."""
    threads: float | None = None
    """Rate of two threads over that of one."""
    remark: str = ""
    """Instead of a baseline."""


@dataclass(frozen=True)
class Line:
    """What ran, what was measured of it, and what there is to set beside that: of kernels and commands alike."""

    ran: str
    measured: str
    beside: str = ""


def best(work: Callable[[], object], times: int = 5) -> float:
    """Shortest time of a few runs after a first one, in seconds of this thread."""
    runs, seconds = _runs(work), []
    for _ in range(times):
        began = time.thread_time()
        for _ in range(runs):
            work()
        seconds.append(time.thread_time() - began)
    return min(seconds) / runs


def two_threads(work: Callable[[], object], times: int = 5) -> float:
    """Work per second of two threads that do the same at once, over that of one thread."""
    runs = _runs(work)

    def repeat(_: int) -> None:
        for _ in range(runs):
            work()

    seconds: dict[int, list[float]] = {1: [], 2: []}
    with ThreadPoolExecutor(2) as pool:
        for _ in range(times):
            for workers in seconds:
                began = time.perf_counter()
                list(pool.map(repeat, range(workers)))
                seconds[workers].append(time.perf_counter() - began)
    return 2.0 * min(seconds[1]) / min(seconds[2])


def _runs(work: Callable[[], object]) -> int:
    """Runs that make a measurement long enough; runs once or twice."""
    work()
    began = time.perf_counter()
    work()
    spent = time.perf_counter() - began
    return max(1, int(SHORTEST / max(spent, 1e-9)) + 1) if spent < SHORTEST else 1


def measured(
    kernel: str,
    unit: str,
    work: Callable[[], object],
    units: float,
    *,
    beside: dict[str, float] | None = None,
    operations: float | None = None,
    times: int = 5,
    threads: bool = True,
) -> Row:
    """Row of a kernel: `work` does so many units; baselines and operations as in `Row`."""
    seconds = best(work, times) / units
    return Row(kernel, unit, seconds, beside or {}, operations, two_threads(work, min(times, 3)) if threads else None)


@numba.njit(nogil=True, error_model="numpy", fastmath=True)
def _chains(values: NDArray[np.float64], rounds: int, shift: float) -> None:
    """Eight chains of x * x - shift for every value: independent, not to be simplified, in the registers."""
    for _ in range(rounds):
        for k in range(values.size):
            a, b, c, d = values[k], 0.9 * values[k], 0.8 * values[k], 0.7 * values[k]
            e, f, g, h = 0.6 * values[k], 0.5 * values[k], 0.4 * values[k], 0.3 * values[k]
            for _ in range(STEPS):
                a, b, c, d = a * a - shift, b * b - shift, c * c - shift, d * d - shift
                e, f, g, h = e * e - shift, f * f - shift, g * g - shift, h * h - shift
            values[k] = 0.125 * (((a + b) + (c + d)) + ((e + f) + (g + h)))


def peak() -> float:
    """Operations per second of one core in double precision, a fused multiply-add counted as two."""
    rounds, values = 1000, np.linspace(0.1, 1.0, VALUES)
    return rounds * VALUES * (8 * 2 * STEPS + 15) / best(lambda: _chains(values, rounds, 0.5), 20)


def show(groups: Iterable[Iterable[Row]]) -> list[Line]:
    """Measure the peak and print the table of kernels, a line between groups; returned is the same in words."""
    sections = [list(group) for group in groups]
    limit = peak()
    table = Table(
        box=box.SIMPLE_HEAD,
        padding=(0, 0, 0, 0),
        show_edge=False,
        title_justify="left",
        title_style="bold",
        pad_edge=False,
    )
    table.title = (
        f"Kernels on one core; its arithmetic peak, measured with them: {limit / 1e9:.1f} Gflop/s in double precision"
    )
    for name in ("kernel", "unit of work"):
        table.add_column(name, no_wrap=True)
    for name in ("million/s", "faster"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("than", no_wrap=True)
    for name in ("of peak", "2 threads"):
        table.add_column(name, justify="right", no_wrap=True)
    for rows in sections:
        for row in rows:
            ratios = "\n".join(_number(seconds / row.seconds) for seconds in row.beside.values())
            table.add_row(
                row.kernel,
                row.unit,
                _number(1e-6 / row.seconds) if row.seconds else "",
                ratios,
                "\n".join(row.beside) or row.remark,
                "" if row.operations is None else f"{row.operations / row.seconds / limit:.0%}",
                "" if row.threads is None else f"{row.threads:.2f}",
            )
        table.add_section()
    console = Console(width=WIDTH)
    console.print(table)
    console.print()
    console.print(NOTES, highlight=False)
    peak_line = Line("additions and multiplications, fused", f"{limit / 1e9:.1f} Gflop/s", "one core's arithmetic peak")
    return [peak_line, *(_line(row, limit) for rows in sections for row in rows)]


def _line(row: Row, limit: float) -> Line:
    """A row in words."""
    beside = [f"{_number(seconds / row.seconds)} times the speed of {name}" for name, seconds in row.beside.items()]
    if row.operations is not None:
        beside.append(f"{row.operations / row.seconds / limit:.0%} of the peak")
    if row.threads is not None:
        beside.append(f"2 threads {row.threads:.2f}")
    rate = f"{_number(1e-6 / row.seconds)} million {row.unit}s/s" if row.seconds else ""
    return Line(row.kernel, rate, "; ".join(filter(None, [row.remark, *beside])))


def print_lines(lines: Iterable[Line]) -> list[Line]:
    """Print lines of commands as they come."""
    told = []
    for line in lines:
        told.append(line)
        print(f"  {line.ran:64} {line.measured:>16}  {line.beside}", flush=True)
    return told


def write_page(page: Path, lines: Iterable[Line]) -> None:
    """Put the lines as a table between the two comments of a page that hold the last one, with machine and date."""
    text = page.read_text(encoding="utf-8")
    before, (_, after) = text.partition(BEGIN)[0], text.partition(BEGIN)[2].split(END)
    rows = "\n".join(f"| {line.ran} | {line.measured} | {line.beside} |" for line in lines)
    table = f"Measured on {_machine()}.\n\n| command or kernel | measured | note |\n|---|---|---|\n{rows}\n"
    page.write_text(f"{before}{BEGIN}\n{table}{END}{after}", encoding="utf-8")


def _machine() -> str:
    """Date, processor and what computed, in words."""
    found = re.search(r"^model name\s*: (.*)$", _text("/proc/cpuinfo"), re.MULTILINE)
    processor = found.group(1) if found else platform.processor() or platform.machine()
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("numba", "numpy", "xarray"))
    return (
        f"{date.today().isoformat()}, {processor}, {os.cpu_count()} cores, {platform.system()}, Python "
        f"{platform.python_version()}, {versions}"
    )


def _text(path: str) -> str:
    with suppress(OSError):
        return Path(path).read_text(encoding="utf-8")
    return ""


def _number(value: float) -> str:
    """Three digits, and whole numbers above a hundred."""
    if value >= 100.0:
        return f"{float(f'{value:.3g}'):,.0f}"
    return f"{value:.{1 if value >= 10.0 else 2 if value >= 0.1 else 4}f}"
