"""Speed of the field kernels on one core: `python -m tests.bench field`.

Annual sums and time series, compared with PySAM if it is installed; then the cost by the size of the field. The
instants are days 1 to 365, solar hours 8 to 16.
"""

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.field.efficiency import field_series, field_sums, sorted_field
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION
from heliosweep.kernels.sun import declination_cooper, solar_clock
from heliosweep.layouts import radial_stagger
from tests.bench import solarpilot
from tests.bench.table import Line, best, measured, rate
from tests.kernels.field.fields import Field, chong2012

Floats = NDArray[np.float64]

UNIT = "heliostat-instant"
METHODS = {"spinning": SPINNING_ELEVATION, "azimuth": AZIMUTH_ELEVATION}
SIZES = (317, 2_500, 11_000)


def year(latitude: float, step: float = 1.0) -> Floats:
    """Sun vectors of days 1 to 365, solar hours 8 to 16."""
    day, hour = np.meshgrid(np.arange(1, 366), np.arange(8.0, 16.0 + step / 2, step), indexing="ij")
    return solar_clock(np.radians(latitude), declination_cooper(day.ravel()), hour.ravel())


def staggered(count: int) -> Field:
    """A radially staggered field of 11 m mirrors with 16 m clearance, under a tower that grows with it."""
    layout = radial_stagger(16.0, 61.3, heliostats=count)
    half = np.full(count, 5.5)
    return layout.x, layout.y, np.full(count, 7.0), half, half, 95.0 * max(1.0, np.sqrt(count / 317.0))


def pysam(field: Field) -> dict[str, float]:
    """Seconds of SolarPILOT for each heliostat-instant; empty where PySAM is not installed."""
    try:
        seconds, table, _ = solarpilot.measure(field[0], field[1], 11.0, field[5])
    except ImportError:
        return {}
    return {"PySAM (SolarPILOT)": seconds / (len(field[0]) * len(table))}


def lines() -> Iterator[Line]:
    """Measure the field of 317, then larger ones."""
    field = chong2012()
    count, sun, mirrors = len(field[0]), year(30.0), sorted_field(*field)
    for method, code in METHODS.items():
        beside = pysam(field) if method == "azimuth" else {}
        sums = partial(field_sums, mirrors, code, sun, 0, count)
        yield measured(f"field sums, {count}, 30 deg, {method}", UNIT, sums, count * len(sun), beside)
    work = partial(field_series, mirrors, SPINNING_ELEVATION, sun, 0, count)
    yield measured(f"field series, {count}, 30 deg, spinning", UNIT, work, count * len(sun))
    fine = year(30.0, 0.1)
    sums = partial(field_sums, mirrors, SPINNING_ELEVATION, fine, 0, count)
    yield measured("the same sums, every 6 min", UNIT, sums, count * len(fine), times=2)
    for size in SIZES:
        mirrors = sorted_field(*staggered(size))
        seconds = [
            best(partial(field_sums, mirrors, code, year(latitude), 0, size), 1) / (size * len(sun))
            for latitude in (0.0, 30.0)
            for code in METHODS.values()
        ]
        mean = float(np.mean(seconds))
        yield rate(f"field of {size:,}, mean of 0 and 30 deg, both", UNIT, mean, remark=f"{mean * 1e9:.1f} ns each")
