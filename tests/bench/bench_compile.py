"""Processor time to compile the kernels of each family, with an empty cache: `python -m tests.bench compile`."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator

from tests.bench.table import Line

WORK = ("warm_field", "warm_rays", "warm_mounts")

PROGRAM = """
import time, numba, numpy, xarray
from heliosweep.kernels import warm
began = time.process_time(); warm.{0}(); print(time.process_time() - began)
"""


def lines() -> Iterator[Line]:
    """One family after the other, each in a new process."""
    for name in WORK:
        with tempfile.TemporaryDirectory() as cache:
            environment = {**os.environ, "NUMBA_CACHE_DIR": cache, "PYTHONPATH": os.pathsep.join(sys.path)}
            command = [sys.executable, "-c", PROGRAM.format(name)]
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        seconds = float(done.stdout)
        yield Line(f"compile, {name.removeprefix('warm_')}", f"{seconds:.1f} s")
