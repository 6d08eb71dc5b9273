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
from pathlib import Path

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


def main(arguments: list[str]) -> None:
    """Print one table; with a study and workers, only compute it in memory."""
    if arguments:
        compute_in_memory(Path(arguments[0]), int(arguments[1]))
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        in_memory(study_file(folder, 60), 1)  # fills the cache of compiled code
        study = study_file(folder, DAYS)
        baseline = {workers: in_memory(study, workers) for workers in (1, 2)}
        rows = [("in memory", workers, seconds) for workers, seconds in baseline.items()]
        for scheduler, workers in RUNS:
            rows.append((scheduler, workers, whole_run(study, scheduler, workers, folder / f"{scheduler}-{workers}")))
        same = {(folder / f"{scheduler}-{workers}" / "result.nc").read_bytes() for scheduler, workers in RUNS}
    print(
        f"\nengines on {os.cpu_count()} cores, latitude_sweep with every {DAYS} days; whole commands, from the start of"
        "\nthe interpreter on; in memory: load, ready the kernels, compute with dask's threads, write nothing"
    )
    print(f"  {'engine':12} {'workers':>7} {'seconds':>8} {'1 worker / this':>16} {'this / in memory':>17}")
    one = {engine: seconds for engine, workers, seconds in rows if workers == 1}
    for engine, workers, seconds in rows:
        gain, cost = one[engine] / seconds, seconds / baseline[workers]
        print(f"  {engine:12} {workers:7} {seconds:8.1f} {gain:16.2f} {cost:17.2f}")
    print(f"  result.nc of all runs: {'the same bytes' if len(same) == 1 else 'DIFFERENT BYTES'}")


if __name__ == "__main__":
    main(sys.argv[1:])
