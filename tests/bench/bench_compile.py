"""Processor time to compile the kernels of each family, with an empty cache: `python -m tests.bench compile`."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator

from tests.bench.table import Line

#: Shipped studies, one for each group of kernels.
STUDIES = (
    "chong2012_table2", "surround_energy", "deviation_curves", "calibration_synthetic", "detectors_closed_loop",
    "dish_world", "defieux2020_table1",
)  # fmt: skip

PROGRAM = """
import time, numba, numpy, xarray
import heliosweep
from heliosweep.families.lookup import family_of
from heliosweep.share.guide import shipped
study = heliosweep.load(shipped()["{0}"])
began = time.process_time(); family_of(study).prepare(study); print(time.process_time() - began)
"""


def lines() -> Iterator[Line]:
    """One family after the other, each in a new process."""
    for name in STUDIES:
        with tempfile.TemporaryDirectory() as cache:
            environment = {**os.environ, "NUMBA_CACHE_DIR": cache, "PYTHONPATH": os.pathsep.join(sys.path)}
            command = [sys.executable, "-c", PROGRAM.format(name)]
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        seconds = float(done.stdout)
        yield Line(f"prepare, {name}", f"{seconds:.1f} s")
