"""Engines on one study, `python -m tests.bench engines`: what the working store costs, what a second worker gains.

The study is `latitude_sweep` with more days, so that one worker computes for about a minute. Each time is that of a
whole command in a process of its own, from the start of the interpreter on, compiled code cached: `in memory` loads the
study, readies the kernels and computes with dask's threads alone, nothing written; the others are runs without report.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from tests.bench.table import Line

ROOT = Path(__file__).parent.parent.parent
#: Days between those that are computed, of the year; the study has 7.
DAYS = int(os.environ.get("BENCH_DAYS", "1"))
RUNS = [("threads", 1), ("threads", 2), ("processes", 1), ("processes", 2), ("distributed", 1), ("distributed", 2)]


def study_file(folder: Path, days: int) -> Path:
    """The study with every few days."""
    text = (ROOT / "studies" / "latitude_sweep.yaml").read_text()
    path = folder / f"study-{days}.yaml"
    path.write_text(text.replace("stop: 365, step: 7", f"stop: 365, step: {days}"))
    return path


def compute_in_memory(study: Path, workers: int) -> None:
    """The whole work by dask's threads, in this process."""
    from heliosweep import api

    loaded = api.load(study)
    execution = loaded.execution.model_copy(update={"workers": workers})
    loaded = loaded.model_copy(update={"execution": execution})
    api.family_of(loaded).prepare(loaded)
    api.build(loaded).compute(scheduler="threads", num_workers=workers)


def timed(*arguments: str) -> float:
    """Seconds of a Python command in a process of its own."""
    start = time.perf_counter()
    subprocess.run([sys.executable, "-m", *arguments], check=True, capture_output=True, cwd=ROOT)
    return time.perf_counter() - start


def in_memory(study: Path, workers: int) -> float:
    """Seconds of the work by dask's threads alone."""
    return timed("tests.bench.bench_engines", str(study), str(workers))


def whole_run(study: Path, scheduler: str, workers: int, folder: Path) -> float:
    """Seconds of a whole run."""
    engine = ("--scheduler", scheduler, "--workers", str(workers))
    return timed("heliosweep", "run", str(study), "--output", str(folder), "--no-report", "-q", *engine)


def lines() -> Iterator[Line]:
    """What ran, and how long it took."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        in_memory(study_file(folder, 60), 1)  # fills the cache of compiled code
        study = study_file(folder, DAYS)
        baseline = {workers: in_memory(study, workers) for workers in (1, 2)}
        rows = [("in memory", workers, seconds) for workers, seconds in baseline.items()]
        for scheduler, workers in RUNS:
            output = folder / f"{scheduler}-{workers}"
            assert not output.exists(), "it would find its result"
            rows.append((scheduler, workers, whole_run(study, scheduler, workers, output)))
        same = {(folder / f"{scheduler}-{workers}" / "result.nc").read_bytes() for scheduler, workers in RUNS}
    one = {engine: seconds for engine, workers, seconds in rows if workers == 1}
    for engine, workers, seconds in rows:
        words = f"latitude_sweep every {DAYS} days, {engine}, {workers} {'worker' if workers == 1 else 'workers'}"
        gain, cost = one[engine] / seconds, seconds / baseline[workers]
        beside = f"{gain:.2f} times faster than 1 worker, takes {cost:.2f} times as long as in memory"
        yield Line(f"compute, {words}" if engine == "in memory" else f"run, {words}", f"{seconds:.1f} s", beside)
    if len(same) > 1:
        raise SystemExit("result.nc of the engines are not the same bytes")


if __name__ == "__main__":
    compute_in_memory(Path(sys.argv[1]), int(sys.argv[2]))
