"""Speed of the field kernels on one core: `python -m tests.bench field`.

Annual sums and time series with all unions beside the straightforward kernel and the shapely twin of the tests and,
where installed, PySAM; then the cost against the size of the field. Work is the grid of the specification: days 1 to
365, solar hours 8 to 16.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.field import efficiency as field_kernels
from heliosweep.kernels.field.efficiency import aimed, field_series, field_sums, sorted_field
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION, Mirrors
from heliosweep.kernels.field.sweep import blockers_of
from heliosweep.kernels.sun.clock import declination_cooper, solar_clock
from heliosweep.layouts import radial_stagger
from tests.bench import solarpilot
from tests.bench.table import Row, best, measured
from tests.kernels.field.fields import Field, chong2012
from tests.kernels.field.oracles import frame, image, lost
from tests.kernels.field.straightforward import straightforward_series

Floats = NDArray[np.float64]

UNIT = "heliostat-instant"
METHODS = {"spinning": SPINNING_ELEVATION, "azimuth": AZIMUTH_ELEVATION}
SIZES = (2_500, 11_000, 100_000)
#: Fields larger than all these are computed in so many blocks of so many heliostats, evenly spread over the field.
WHOLE, BLOCKS, BLOCK = 11_000, 8, 1_000


def year(latitude: float, step: float = 1.0, every: int = 1) -> Floats:
    """Sun vectors of days 1 to 365, or every few of them, solar hours 8 to 16."""
    day, hour = np.meshgrid(np.arange(1, 366, every), np.arange(8.0, 16.0 + step / 2, step), indexing="ij")
    return solar_clock(np.radians(latitude), declination_cooper(day.ravel()), hour.ravel())


def staggered(count: int) -> Field:
    """A radially staggered field of 11 m mirrors with 16 m clearance, under a tower that grows with it."""
    layout = radial_stagger(16.0, 61.3, heliostats=count)
    half = np.full(count, 5.5)
    return layout.x, layout.y, np.full(count, 7.0), half, half, 95.0 * max(1.0, np.sqrt(count / 317.0))


def twin(i: int, mirrors: Mirrors, tracking: int, s: Floats) -> list[float]:
    """Shading, blocking and both at one instant by shapely, of the pairs alone whose bounding spheres meet the beam."""
    centres = np.stack((mirrors.x, mirrors.y, mirrors.z), axis=1)
    sides = np.stack((mirrors.half_width, mirrors.half_height), axis=1)
    offset, reach = centres - centres[i], mirrors.radius + mirrors.radius[i]
    seen: list[list] = []
    for d in (s, mirrors.aim[i]):
        ahead = offset @ d
        near = (np.sum(offset**2, axis=1) - ahead**2 < reach**2) & (ahead > -reach) & (np.arange(len(reach)) != i)
        named = np.flatnonzero(near)
        frames = {j: frame(mirrors.aim[j], s, tracking) for j in (i, *named)}
        seen.append([image(i, j, d, centres, frames, sides) for j in named])
    return [1.0 - lost(seen[0]), 1.0 - lost(seen[1]), 1.0 - lost(seen[0] + seen[1])]


def shapely_twin(field: Field, tracking: int, sun: Floats) -> float:
    """Seconds of the twin for each heliostat-instant, by some of them."""
    mirrors = aimed(*field)
    sample = [(i, s) for s in sun[100::800] for i in range(0, len(field[0]), 40)]
    return best(lambda: [twin(i, mirrors, tracking, s) for i, s in sample], 1) / len(sample)


def straightforward(field: Field, tracking: int, sun: Floats) -> float:
    """Seconds of the straightforward kernel for each heliostat-instant."""
    return best(partial(straightforward_series, *field, tracking, sun, 0, len(field[0])), 3) / (
        len(field[0]) * len(sun)
    )


def pysam(field: Field) -> dict[str, float]:
    """Seconds of SolarPILOT for each heliostat-instant; empty where PySAM is not installed."""
    try:
        seconds, table, _ = solarpilot.measure(field[0], field[1], 11.0, field[5])
    except ImportError:
        return {}
    return {"PySAM (SolarPILOT)": seconds / (len(field[0]) * len(table))}


def small() -> Iterator[Row]:
    """The field of 317, sums and series."""
    field = chong2012()
    count, other = len(field[0]), pysam(field)
    for latitude in (0, 30):
        sun = year(latitude)
        for method, code in METHODS.items():
            beside = {
                "straightforward kernel": straightforward(field, code, sun),
                "shapely twin, culled": shapely_twin(field, code, sun),
            }
            yield measured(
                f"field sums, {count}, {latitude} deg, {method}",
                UNIT,
                partial(field_sums, sorted_field(*field), code, sun, 0, count),
                count * len(sun),
                beside=beside if method == "spinning" else beside | other,
            )
    series, instants = partial(field_series, sorted_field(*field), SPINNING_ELEVATION), len(sun)
    yield measured(
        f"field series, {count}, 30 deg, spinning",
        UNIT,
        partial(series, sun, 0, count),
        count * instants,
    )
    fine = year(30.0, 0.1)
    yield measured(
        "the same sums, every 6 min",
        UNIT,
        partial(field_sums, sorted_field(*field), SPINNING_ELEVATION, fine, 0, count),
        count * len(fine),
        times=2,
    )


def cost(field: Field) -> float:
    """Seconds for each heliostat-instant, mean of 0 and 30 deg and of both methods."""
    count = len(field[0])
    starts = np.linspace(0, count - BLOCK, BLOCKS).astype(int).tolist() if count > WHOLE else [0]
    length = BLOCK if count > WHOLE else count
    each = []
    for latitude in (0, 30):
        sun = year(latitude)
        for code in METHODS.values():

            def work(code: int = code, sun: Floats = sun) -> None:
                mirrors = sorted_field(*field)
                for start in starts:
                    field_sums(mirrors, code, sun, start, start + length)

            each.append(best(work, 3 if count < 1000 else 1) / (len(starts) * length * len(sun)))
    return float(np.mean(each))


def sizes() -> Iterator[Row]:
    """Cost against the size of the field."""
    first = cost(chong2012())
    yield Row("field of 317, mean of 0 and 30 deg, both", UNIT, first, remark=f"{first * 1e9:.1f} ns each")
    for count in SIZES:
        seconds = cost(staggered(count))
        remark = f"{seconds * 1e9:.1f} ns, 317's x {seconds / first:.2f}"
        yield Row(
            f"field of {count:,}" + (f", {BLOCKS} blocks of it" if count > WHOLE else ""),
            UNIT,
            seconds,
            {},
            remark=remark,
        )
    yield set_up(staggered(100_000))
    field, sun = staggered(30_000), year(30.0, every=40)
    for name, instants in (("90 instants of a year", sun), ("512 of a series", year(30.0, 0.2)[:512])):
        work = partial(field_sums, sorted_field(*field), SPINNING_ELEVATION, instants, 15_000, 16_000)
        seconds = best(work, 2) / (1_000 * len(instants))
        yield Row(f"block in 30,000, {name}", UNIT, seconds, remark=f"{seconds * 1e9:.1f} ns each")


def set_up(field: Field) -> Row:
    """All that comes before the first image: aims, grid, blockers of every heliostat, packets of a year."""
    sun, count = year(30.0), len(field[0])

    def work() -> None:
        mirrors = sorted_field(*field)
        blockers_of(np.arange(count), *mirrors)
        field_kernels._sorted(mirrors, sun, SPINNING_ELEVATION, 0, count)

    seconds = best(work, 3)
    return Row(f"set-up of {count:,}", "heliostat", seconds / count, remark=f"{seconds:.2f} s in all")


GROUPS = (small, sizes)
