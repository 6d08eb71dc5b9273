"""Speed of rays on an NVIDIA graphics processor beside one core: `python -m tests.bench device`, on such a machine.

A year of 2,440 hours of Chong's field with its flux map, 64 and 4,096 rays of each heliostat and hour; an instant with
1,048,576 rays of each. Without a device nothing is measured, and the reason is printed.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial

import numpy as np

from heliosweep.kernels.device import device_problem
from heliosweep.kernels.rays import trace
from tests.bench.table import Line, measured
from tests.kernels.rays.fields import CELLS, REFERENCE, SUNS, field


def lines() -> Iterator[Line]:
    """The same rays on a core and on the device."""
    problem = device_problem()
    if problem:
        print(f"device: cuda {problem}", file=sys.stderr)
        return
    sun, weight = REFERENCE["year_sun"], np.tile(REFERENCE["year_weight"], (2, 1))
    made, share = field("surround_azimuth")
    one = np.tile(np.eye(4)[1], (2, 1))
    for name, suns, weights, each in (
        ("year", sun, weight, 64), ("year", sun, weight, 4096), ("instant", SUNS, one, 2**20)
    ):  # fmt: skip
        for cuda in (True, False) if each < 4096 else (True,):
            work = partial(trace, made, suns, weights=weights, rays=each, cells=CELLS, share=share, cuda=cuda)
            label = f"rays, surround_azimuth, {name}, {each:,}, {'cuda' if cuda else 'one core'}"
            yield measured(label, "ray", work, len(made.centre) * int((weights[0] > 0).sum()) * each, times=2)
