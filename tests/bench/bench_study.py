"""Whole commands as a user gives them: `python -m tests.bench study`.

Each runs in a process of its own, from the start of the interpreter to its end, the best of three. A run that was to
compute and found its result, or the other way round, fails the benchmark.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from operator import itemgetter
from pathlib import Path
from typing import Any

import psutil

from tests.bench.table import Line

ROOT = Path(__file__).parent.parent.parent
TABLE_2 = ROOT / "studies" / "chong2012_table2.yaml"
TIMES = 3
#: A study whose kernels take a hundredth of a second: what is left is waiting.
TINY = """\
family: field_efficiency
site: {latitude: [0, 30]}
tracking: [spinning_elevation, azimuth_elevation]
time: {clock: solar, days: {start: 1, stop: 365, step: 28}, hours: {start: 8, stop: 16, step: 1}, sampling: midpoint}
layout: {radial_stagger: {clearance: 16, inner_radius: 61.3, rings: 3}}
heliostat: {width: "36 ft", height: "36 ft", pivot_height: 7}
receiver: {height: {start: 80, stop: 120, step: 20}}
"""


def timed(*arguments: str, **environment: str) -> tuple[float, float]:
    """Run the command line; wall time [s] and peak memory [MB] of the process."""
    start, most = time.perf_counter(), 0
    process = psutil.Popen(
        [sys.executable, "-m", "heliosweep", *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, **environment},
    )
    while process.poll() is None:  # what the system states at the end has the size of this process in it
        with suppress(psutil.Error):
            most = max(most, process.memory_info().rss)
        time.sleep(0.01)
    seconds = time.perf_counter() - start
    if process.returncode:
        raise SystemExit(f"heliosweep {' '.join(arguments)} failed")
    return seconds, most / 1e6


def run(
    study: Path, folder: Path, *options: str, found: bool = False, cache: str = ""
) -> tuple[float, float, dict[str, Any]]:
    """Run a study that is to compute, or to find its result; wall time [s], peak memory [MB] and its manifest.

    `cache` is the folder of compiled code, where it is to be another one.
    """
    manifest = folder / "manifest.json"
    before = manifest.stat().st_mtime_ns if manifest.exists() else 0
    seconds, memory = timed(
        "run", str(study), "--output", str(folder), "-q", *options, **{"NUMBA_CACHE_DIR": cache} if cache else {}
    )
    if (manifest.stat().st_mtime_ns == before) != found:
        raise SystemExit(f"the run of {study.name} {'computed' if found else 'found'} its result: no line says that")
    return seconds, memory, json.loads(manifest.read_text())


def lines() -> Iterator[Line]:
    """What ran, and how long it took."""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        tiny = place / "tiny.yaml"
        tiny.write_text(TINY)
        first, _, manifest = run(tiny, place / "cold", cache=str(place / "cache"))
        compiling = manifest["seconds"]["prepare"]
        yield Line("run, tiny field study, nothing compiled yet", f"{first:.1f} s", f"compiling {compiling:.1f} s")
        for words, study in (("tiny field study", tiny), ("Table 2 of Chong and Tan", TABLE_2)):
            run(study, place / study.stem)  # fills the caches
            for more, options in (("", ()), (", no report", ("--no-report",))):
                folders = [place / f"{study.stem}{len(options)}{number}" for number in range(TIMES)]
                seconds, memory, manifest = min((run(study, each, *options) for each in folders), key=itemgetter(0))
                kernels, evaluations = manifest["seconds"]["compute"], manifest["plan"]["evaluations"]
                beside = f"{evaluations / 1e6:.1f} million heliostat-instants in {kernels:.2f} s of it"
                yield Line(f"run, {words}{more}: computed", f"{seconds:.2f} s, {memory:.0f} MB", beside)
            again = (run(study, place / study.stem, found=True) for _ in range(TIMES))
            seconds, memory, _ = min(again, key=itemgetter(0))
            yield Line(f"run, {words}: found complete", f"{seconds:.2f} s, {memory:.0f} MB")
    for verb in ("plan", "validate", "--help"):
        seconds, memory = min(timed(verb, str(TABLE_2)) for _ in range(TIMES))
        yield Line(f"{verb}, Table 2 of Chong and Tan", f"{seconds:.2f} s, {memory:.0f} MB")
