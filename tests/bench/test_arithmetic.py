"""Operations counted in sources."""

import math

import pytest

from heliosweep.kernels.vectors import cross, dot, unit
from tests.bench.arithmetic import operations

LANES = 8


def lanes(row, cameras, count):
    scale = 2.0 * row[0]
    for k in range(LANES):
        for camera in range(cameras):
            row[LANES * camera + k] += scale * math.sqrt(abs(row[k])) - 1.0 / 3.0
        if count > 3:
            continue
        row[k] = -row[k] / scale if scale > 0.0 else min(row[k], scale) + 1.0


@pytest.mark.parametrize(("kernel", "expected"), [(dot, 5), (cross, 9), (unit, 9)])
def test_functions(kernel, expected):
    assert operations(kernel) == expected


def test_loops_and_branches():
    assert operations(lanes) == 1 + 4 + 2
    assert operations(lanes, loops_only=True) == 4 + 2
    assert operations(lanes, loop=0) == 4 + 2
    assert operations(lanes, {"cameras": 4, "count > 3": 0.75}, loops_only=True) == 4 * 4 + 0.25 * 2
