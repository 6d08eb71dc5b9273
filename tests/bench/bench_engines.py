"""Engines on one study: what the working store and each engine cost, and what a second worker gains.

The study is `latitude_sweep` with more days, so that one worker computes for about a minute. Each run is a whole run
without report, in a process of its own; `in memory` is the same work by dask's threads alone, nothing written.
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


def study_file(folder: Path) -> Path:
    """The study of the benchmark."""
    text = (ROOT / "studies" / "latitude_sweep.yaml").read_text()
    path = folder / "study.yaml"
    path.write_text(text.replace("stop: 365, step: 7", f"stop: 365, step: {DAYS}"))
    return path


def in_memory(study: Path, workers: int) -> float:
    """Seconds of the same work by dask's threads, in this process."""
    from heliosweep import workflow

    loaded = workflow.load(study)
    execution = loaded.execution.model_copy(update={"workers": workers})
    loaded = loaded.model_copy(update={"execution": execution})
    workflow.family_of(loaded).prepare(loaded)
    start = time.perf_counter()
    workflow.build(loaded).compute(scheduler="threads", num_workers=workers)
    return time.perf_counter() - start


def whole_run(study: Path, scheduler: str, workers: int, folder: Path) -> float:
    """Seconds of a whole run in a process of its own."""
    command = [sys.executable, "-m", "heliosweep", "run", str(study), "--output", str(folder), "--no-report", "-q"]
    start = time.perf_counter()
    subprocess.run([*command, "--scheduler", scheduler, "--workers", str(workers)], check=True, capture_output=True)
    return time.perf_counter() - start


def main() -> None:
    """Print one table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        study = study_file(folder)
        baseline = {workers: in_memory(study, workers) for workers in (1, 2)}
        rows = [("in memory", workers, seconds) for workers, seconds in baseline.items()]
        for scheduler, workers in RUNS:
            rows.append((scheduler, workers, whole_run(study, scheduler, workers, folder / f"{scheduler}-{workers}")))
        same = {(folder / f"{scheduler}-{workers}" / "result.nc").read_bytes() for scheduler, workers in RUNS}
    print(
        f"\nengines on {os.cpu_count()} cores, latitude_sweep with every {DAYS} days; whole commands but the first two"
    )
    print(f"  {'engine':12} {'workers':>7} {'seconds':>8} {'1 worker / this':>16} {'this / in memory':>17}")
    one = {engine: seconds for engine, workers, seconds in rows if workers == 1}
    for engine, workers, seconds in rows:
        gain, cost = one[engine] / seconds, seconds / baseline[workers]
        print(f"  {engine:12} {workers:7} {seconds:8.1f} {gain:16.2f} {cost:17.2f}")
    print(f"  result.nc of all runs: {'the same bytes' if len(same) == 1 else 'DIFFERENT BYTES'}")


if __name__ == "__main__":
    main()
