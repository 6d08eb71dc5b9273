"""All shipped studies in one command, `python -m tests.bench studies`: computed, then found complete, as by `make`."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from tests.bench.bench_study import ROOT
from tests.bench.table import Line


def lines() -> Iterator[Line]:
    """What ran, and how long it took."""
    with tempfile.TemporaryDirectory() as name:
        shutil.copytree(ROOT / "studies", Path(name) / "studies")
        studies = sorted(str(path.relative_to(name)) for path in Path(name, "studies").glob("*.yaml"))
        written: dict[str, int] = {}
        for words in ("computed", "found complete"):
            command, start = [sys.executable, "-m", "heliosweep", "run", "-q", *studies], time.perf_counter()
            done = subprocess.run(command, check=True, capture_output=True, text=True, cwd=name)
            seconds, before = time.perf_counter() - start, written
            paths = [Path(name, path).with_name("manifest.json") for path in done.stdout.splitlines()]
            written = {path.parent.name: path.stat().st_mtime_ns for path in paths}
            assert len(written) == len(studies)
            assert not before or written == before, "some were computed anew"
            yield Line(f"run, all {len(studies)} shipped studies in one process: {words}", f"{seconds:.1f} s")
