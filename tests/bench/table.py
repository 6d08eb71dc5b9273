"""Lines of a benchmark, and the table of them on a page of the documentation.

Nothing is asserted: times depend on the machine and on its other work. Times of one core are those of the processor,
each the best of a few runs.
"""

import os
import platform
import re
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from datetime import date
from importlib import metadata
from pathlib import Path

#: Lines that the README has.
README_LINES = (
    "field of 2,500, mean of 0 and 30 deg, both",
    "rays, surround_azimuth, year, 64",
    "run, Table 2 of Chong and Tan: computed",
)
#: Comments around the table of a page.
BEGIN, END = "<!-- table of make bench -->", "<!-- end of the table -->"
#: Minimum time of a measurement: shorter work is repeated. [s]
SHORTEST = 0.01


@dataclass(frozen=True)
class Line:
    """One measurement: what ran, the result, and values to compare it with."""

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


def two_threads(work: Callable[[], object], times: int = 3) -> float:
    """Work per second of two threads that do the same at once, divided by that of one thread."""
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
    """Number of runs that make a measurement long enough; runs once or twice."""
    work()
    began = time.perf_counter()
    work()
    spent = time.perf_counter() - began
    return max(1, int(SHORTEST / max(spent, 1e-9)) + 1) if spent < SHORTEST else 1


def rate(name: str, unit: str, seconds: float, beside: dict[str, float] | None = None, remark: str = "") -> Line:
    """Line with the units of work per second of one core, compared with the seconds of baselines for one unit."""
    faster = [f"{number(other / seconds)} times the speed of {baseline}" for baseline, other in (beside or {}).items()]
    return Line(name, f"{number(1e-6 / seconds)} million {unit}s/s", "; ".join(filter(None, [remark, *faster])))


def measured(
    name: str,
    unit: str,
    work: Callable[[], object],
    units: float,
    beside: dict[str, float] | None = None,
    times: int = 5,
) -> Line:
    """Line of a kernel: `work` does `units` units of work; also the gain of a second thread."""
    return rate(name, unit, best(work, times) / units, beside, f"2 threads {two_threads(work):.2f}")


def print_lines(lines: Iterable[Line]) -> list[Line]:
    """Print lines as they are measured, and return them."""
    printed = []
    for line in lines:
        printed.append(line)
        print(f"  {line.ran:56} {line.measured:>36}  {line.beside}", flush=True)
    return printed


def write_page(page: Path, lines: Iterable[Line]) -> None:
    """Replace the table between the two comments of a page, with machine and date."""
    text = page.read_text(encoding="utf-8")
    before, (_, after) = text.partition(BEGIN)[0], text.partition(BEGIN)[2].split(END)
    rows = "\n".join(f"| {line.ran} | {line.measured} | {line.beside} |" for line in lines)
    table = f"Measured on {_machine()}.\n\n| command or kernel | measured | note |\n|---|---|---|\n{rows}\n"
    page.write_text(f"{before}{BEGIN}\n{table}{END}{after}", encoding="utf-8")


def _machine() -> str:
    """Date, processor and versions, in words."""
    text = ""
    with suppress(OSError):
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    found = re.search(r"^model name\s*: (.*)$", text, re.MULTILINE)
    processor = found.group(1) if found else platform.processor() or platform.machine()
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("numba", "numpy", "xarray"))
    return (
        f"{date.today().isoformat()}, {processor}, {os.cpu_count()} cores, {platform.system()}, Python "
        f"{platform.python_version()}, {versions}"
    )


def number(value: float) -> str:
    """Three digits, and whole numbers above a hundred."""
    if value >= 100.0:
        return f"{float(f'{value:.3g}'):,.0f}"
    return f"{value:.{1 if value >= 10.0 else 2 if value >= 0.1 else 4}f}"
