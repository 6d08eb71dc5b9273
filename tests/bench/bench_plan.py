"""Time of studies beside what the plan said: `python -m tests.bench plan`.

Shipped studies, and larger ones for each part of the estimate. All are computed in this process, one part after the
other, and timed by its processor. Names as arguments of this module measure these alone.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from heliosweep import api
from tests.bench.bench_memory import STUDIES, stagger, written
from tests.bench.table import Line

#: How far the plan may be from what is measured, of runs that take longer than a time. [1, s]
FACTOR, LEAST = 1.5, 0.5


def field(heliostats: int, **blocks: Any) -> dict[str, Any]:
    """A field of square mirrors before a tower, at 30 degrees of latitude."""
    return {
        "family": "field_efficiency",
        "site": {"latitude": 30},
        "tracking": "spinning_elevation",
        "layout": stagger(heliostats),
        "heliostat": {"width": 11, "height": 11, "pivot_height": 7},
        "receiver": {"height": 150},
        "time": {"clock": "solar", "days": {"start": 1, "stop": 365, "step": 28},
                 "hours": {"start": 6, "stop": 18, "step": 1}, "sampling": "midpoint"},
    } | blocks  # fmt: skip


def at_suns(heliostats: int, elevation: dict[str, int], **blocks: Any) -> dict[str, Any]:
    """The same with the sun between two elevations, from all sides."""
    clock = {"clock": "sun", "azimuth": {"start": -180, "stop": 170, "step": 10}, "elevation": elevation}
    content = field(heliostats, time=clock, **blocks)
    del content["site"]
    return content


def light(heliostats: int, receiver: dict[str, Any], focus: str = "slant", **blocks: Any) -> dict[str, Any]:
    """The same with the way of the light."""
    optics = {"sun_shape": {"kind": "limb_darkened"}, "slope_error": 1.5}
    hours = {"clock": "solar", "days": {"start": 1, "stop": 365, "step": 7},
             "hours": {"start": 6, "stop": 18, "step": 1}, "sampling": "midpoint"}  # fmt: skip
    given = {"receiver": {"height": 150, **receiver}, "optics": optics, "time": hours}
    content = field(heliostats, **(given | blocks))
    content["heliostat"] = content["heliostat"] | {"focus": focus}
    return content


def larger_studies() -> dict[str, dict[str, Any]]:
    """Studies whose time is that of one part of the estimate."""
    low, high = {"start": 1, "stop": 5, "step": 1}, {"start": 20, "stop": 80, "step": 20}
    cylinder, face = {"kind": "cylinder", "radius": 7, "height_extent": 16}, {"width": 14, "height_extent": 14}
    small = {"kind": "cylinder", "radius": 2, "height_extent": 5, "height": 100}
    return {
        "field_2500_low": at_suns(2500, low),
        "field_2500_high": at_suns(2500, high),
        "field_11000_low": at_suns(11_000, low),
        "field_11000_high": at_suns(11_000, high),
        "field_11000_year": field(11_000),
        "field_100k_tower_300": field(100_000, receiver={"height": 300}, time={
            "clock": "solar", "days": [80, 172, 355], "hours": {"start": 8, "stop": 16, "step": 1},
            "sampling": "inclusive"}),
        "light_cylinder": light(600, cylinder),
        "light_cylinder_azimuth": light(600, cylinder, tracking="azimuth_elevation"),
        "light_small_cylinder_flat": light(150, small, "flat"),
        "light_small_cylinder_flat_azimuth": light(150, small, "flat", tracking="azimuth_elevation"),
        "light_rectangle": light(300, {"kind": "rectangle", **face}),
        "light_rectangle_azimuth": light(300, {"kind": "rectangle", **face}, tracking="azimuth_elevation"),
        "light_suns": at_suns(100, high, receiver={"height": 150, **cylinder}, optics={
            "sun_shape": {"kind": "buie", "circumsolar_ratio": 0.05}, "slope_error": 0.2}),
        "light_gaussian": light(600, cylinder, optics={
            "sun_shape": {"kind": "gaussian"}, "slope_error": 1.5, "method": "gaussian"}),
    }  # fmt: skip


def spent(path: Path, output: Path) -> tuple[float, float]:
    """What the plan says and what a study takes, after a first run that imports and compiles. [s]"""
    study = api.load(path, {"execution.workers": 1, "execution.scheduler": "synchronous"})
    api.run(study, output, report=False)
    began = time.process_time()
    api.run(study, output, report=False, force=True)
    return api.plan(study, output).seconds, time.process_time() - began


def lines(names: Sequence[str] = ()) -> Iterator[Line]:
    """All studies together, and each of which the plan was far off; all of them one by one on standard error."""
    larger, ratios = larger_studies(), list[float]()
    wanted = names or [*(path.stem for path in sorted(STUDIES.glob("*.yaml"))), *larger]
    with tempfile.TemporaryDirectory() as folder:
        for name in wanted:
            plan, seconds = spent(written(name, larger.get(name), Path(folder)), Path(folder) / f"{name}-result")
            ratio = plan / seconds
            line = Line(f"run, {name}: processor", f"{seconds:.2f} s", f"plan: {plan:.2f} s, {ratio:.2f} times it")
            print(f"  {line.ran:60} {line.measured:>10}  {line.beside}", file=sys.stderr, flush=True)
            if seconds < LEAST:
                continue
            ratios.append(ratio)
            if not 1 / FACTOR <= ratio <= FACTOR:
                yield line
    low, middle, high = np.quantile(ratios, [0.0, 0.5, 1.0])
    told = f"plan: {middle:.2f} times it ({low:.2f} to {high:.2f})"
    yield Line(f"run, {len(ratios)} studies of {LEAST:g} s or more", "time", told)


if __name__ == "__main__":
    for each in lines(sys.argv[1:]):
        print(each)
