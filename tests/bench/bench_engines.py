"""Engines side by side, `python -m tests.bench engines`: what the working store costs, what a second worker gains.

Each time is that of a whole command in a process of its own, from the start of the interpreter on, compiled code
cached: `in memory` loads the study, readies the kernels and computes with dask's threads alone, nothing written; the
others are runs without report. Commands that are compared take turns, so that other work on the machine befalls all.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import product
from pathlib import Path

from tests.bench.table import Line

ROOT = Path(__file__).parent.parent.parent
STUDY = ROOT / "studies" / "latitude_sweep.yaml"
#: How often each command on the study has its turn.
TURNS = 3
#: Engines with a store.
ENGINES = ("threads", "processes", "distributed")
#: What makes the study compute for about a minute on one core: every day, and latitudes 3 degrees apart.
LONGER = {"stop: 365, step: 7": "stop: 365, step: 1", "stop: 60, step: 5": "stop: 60, step: 3"}


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
    assert not folder.exists(), "it would find its result"
    engine = ("--scheduler", scheduler, "--workers", str(workers))
    return timed("heliosweep", "run", str(study), "--output", str(folder), "--no-report", "-q", *engine)


def lines() -> Iterator[Line]:
    """What ran, and how long it took."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        in_memory(STUDY, 2)  # fills the caches
        seconds: dict[str, list[float]] = {engine: [] for engine in ("in memory", *ENGINES)}
        for turn in range(TURNS):
            seconds["in memory"].append(in_memory(STUDY, 2))
            for engine in ENGINES:
                seconds[engine].append(whole_run(STUDY, engine, 2, folder / f"short-{engine}-{turn}"))
        baseline = min(seconds["in memory"])
        for engine, found in seconds.items():
            beside = f"takes {min(found) / baseline:.2f} times as long as in memory"
            verb = "compute" if engine == "in memory" else "run"
            yield Line(f"{verb}, latitude_sweep, {engine}, 2 workers", f"{min(found):.1f} s", beside)
        longer = folder / "longer.yaml"
        text = STUDY.read_text(encoding="utf-8")
        for old, new in LONGER.items():
            assert old in text
            text = text.replace(old, new)
        longer.write_text(text, encoding="utf-8")
        for workers, engine in product((1, 2), ("threads", "distributed")):
            took = whole_run(longer, engine, workers, folder / f"longer-{engine}-{workers}")
            seconds[f"{engine} {workers}"] = [took]
            words = f"run, latitude_sweep of all days, {engine}, {workers} worker{'s' if workers > 1 else ''}"
            gain = seconds[f"{engine} 1"][0] / took
            yield Line(words, f"{took:.1f} s", f"{gain:.2f} times faster than 1 worker" if workers > 1 else "")
        for study in ("short", "longer"):
            if len({path.read_bytes() for path in folder.glob(f"{study}-*/result.nc")}) != 1:
                raise SystemExit("result.nc of the engines are not the same bytes")


if __name__ == "__main__":
    compute_in_memory(Path(sys.argv[1]), int(sys.argv[2]))
