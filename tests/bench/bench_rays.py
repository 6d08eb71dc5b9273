"""Speed of rays on one core: `python -m tests.bench rays`.

A year of 2,440 hours of Chong's field with its flux map, 16 and 64 rays of each heliostat and hour; an instant of 82
canted heliostats before a cavity with 65,536 rays of each. Points and the search of neighbours are included. With an
NVIDIA graphics processor, the same year there, and an instant of Chong's field with 1,048,576 rays of each.
"""

from collections.abc import Iterator
from functools import partial

import numpy as np

from heliosweep.kernels.device import device_problem
from heliosweep.kernels.rays import trace
from tests.bench.table import Line, measured
from tests.kernels.rays.fields import CELLS, REFERENCE, SUNS, field


def lines() -> Iterator[Line]:
    """A year of each tracking method, and one instant."""
    sun, weight = REFERENCE["year_sun"], np.tile(REFERENCE["year_weight"], (2, 1))
    for name, each in (("surround_azimuth", 64), ("surround_azimuth", 16), ("surround_spinning", 64)):
        made, share = field(name)
        work = partial(trace, made, sun, weights=weight, rays=each, cells=CELLS, share=share)
        yield measured(f"rays, {name}, year, {each}", "ray", work, len(made.centre) * len(sun) * each, times=2)
    made, share = field("canted_focused")
    work = partial(trace, made, SUNS[1:2], rays=65_536, cells=CELLS, share=share)
    yield measured("rays, canted_focused, instant, 65,536", "ray", work, len(made.centre) * 65_536, times=2)
    if device_problem() is None:
        made, share = field("surround_azimuth")
        for name, suns, weights, each in (
            ("year", sun, weight, 64), ("year", sun, weight, 4096), ("instant", SUNS[1:2], None, 2**20)
        ):  # fmt: skip
            work = partial(trace, made, suns, weights=weights, rays=each, cells=CELLS, share=share, cuda=True)
            label = f"rays, surround_azimuth, {name}, {each:,}, cuda"
            yield measured(label, "ray", work, len(made.centre) * len(suns) * each, times=2)
