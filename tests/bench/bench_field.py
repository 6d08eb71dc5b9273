"""Speed of the field kernels on one core. Run it: `python tests/bench/bench_field.py`.

Prints nanoseconds for each heliostat and instant (both tracking methods, all unions), the ratio to the shapely twin of
the tests, the gain from two threads, and the cost against the size of the field. Nothing is asserted: times depend on
the machine and on its other work; each is the best of a few runs.
"""

import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "kernels"), str(HERE.parent.parent / "pipeline")]

from fields import Field, chong2012  # noqa: E402
from oracles import instant  # noqa: E402

from heliosweep.kernels.compiled import warm  # noqa: E402
from heliosweep.kernels.field import aimed, field_sums  # noqa: E402
from heliosweep.kernels.mounts import AZIMUTH_ELEVATION, SPINNING_ELEVATION  # noqa: E402
from heliosweep.kernels.sun import declination_cooper, solar_clock  # noqa: E402

METHODS = {"spinning_elevation": SPINNING_ELEVATION, "azimuth_elevation": AZIMUTH_ELEVATION}


def year(latitude, step):
    """Sun vectors of days 1 to 365, solar hours 8 to 16."""
    day, hour = np.meshgrid(np.arange(1, 366), np.arange(8.0, 16.0 + step / 2, step), indexing="ij")
    return solar_clock(np.radians(latitude), declination_cooper(day.ravel()), hour.ravel())


def best(work, times=3):
    """Shortest time of a few runs, in seconds."""
    seconds = []
    for _ in range(times):
        began = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - began)
    return min(seconds)


def staggered(count: int) -> Field:
    """A radially staggered field of 11 m mirrors with 16 m clearance, like the one of Chong and Tan 2012."""
    radius, places, ring, around = 61.3, np.empty((0, 2)), 0, 0
    while len(places) < count:
        if around == 0 or 2 * np.pi * radius / around > 26.0:  # a new zone
            around, ring = int(np.pi / np.arcsin(8.0 / radius)), 0
        half = np.pi / around
        angle = (2.0 * np.arange(around) + ring % 2) * half
        places = np.vstack((places, radius * np.stack((np.sin(angle), np.cos(angle)), axis=1)))
        radius = radius * np.cos(half) + np.sqrt(max(256.0 - (radius * np.sin(half)) ** 2, 64.0))
        ring += 1
    x, y = places[:count].T.copy()
    height = 95.0 * max(1.0, np.sqrt(count / 317.0))
    return x, y, np.full(count, 7.0), np.full(count, 5.5), np.full(count, 5.5), height


def row(name, seconds, work, note=""):
    """Print one line of the table."""
    print(f"{name:<58} {seconds / work * 1e9:>10.1f} {work / seconds / 1e6:>10.2f}  {note}")


def main():
    """Print the table."""
    seconds, fresh = warm()
    print(f"kernels ready in {seconds:.2f} s ({'compiled' if fresh else 'from the cache'})\n")
    print(f"{'':<58} {'ns each':>10} {'million/s':>10}")
    field = chong2012()
    for step in (1.0, 0.2):
        for latitude in (0.0, 30.0):
            sun = year(latitude, step)
            for name, code in METHODS.items():
                spent = best(lambda sun=sun, code=code: field_sums(*field, code, sun, 0, 317))
                row(f"317 heliostats, {len(sun)} instants, {latitude:.0f} deg, {name}", spent, 317 * len(sun))

    sun, mirrors = year(30.0, 1.0), aimed(*field)
    sample = [(i, s) for s in sun[100::800] for i in range(0, 317, 40)]
    slow = best(lambda: [instant(i, mirrors, 0, s) for i, s in sample], 1)
    fast = best(lambda: field_sums(*field, 0, sun, 0, 317))
    row(
        "shapely twin, every pair", slow, len(sample), f"{slow / len(sample) * 317 * len(sun) / fast:,.0f} times slower"
    )

    def halves(workers):
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(lambda a: field_sums(*field, 0, sun, a, min(a + 80, 317)), range(0, 317, 80)))

    one, two = best(lambda: halves(1)), best(lambda: halves(2))
    row("4 blocks, 1 thread", one, 317 * len(sun))
    row("4 blocks, 2 threads", two, 317 * len(sun), f"{one / two:.2f} times faster")

    sun = year(30.0, 1.0)
    for count in (317, 3_000, 30_000, 100_000):
        big = staggered(count)
        start, stop = (count // 2, count // 2 + 1000) if count > 2000 else (0, count)
        spent = best(lambda big=big, start=start, stop=stop: field_sums(*big, 0, sun, start, stop), 2)
        row(f"block of {stop - start} in {count} heliostats", spent, (stop - start) * len(sun))
    pysam(field)


def pysam(field):
    """SolarPILOT's engine on the same field and as many sun positions, if PySAM is installed."""
    try:
        from PySAM import Solarpilot
    except ImportError:
        print("PySAM is not installed: no comparison with SolarPILOT")
        return
    x, y, _, half, _, target = field
    model = Solarpilot.default("MSPTSingleOwner")
    model.SolarPILOT.helio_positions_in = np.stack((x, y), axis=1).tolist()
    model.SolarPILOT.helio_width = model.SolarPILOT.helio_height = 2.0 * float(half[0])
    model.SolarPILOT.h_tower = float(target)
    model.SolarPILOT.calc_fluxmaps = 0
    spent = best(model.execute, 1)
    positions = max(1, len(model.Outputs.opteff_table))
    row("PySAM, SolarPILOT engine, one total per sun position", spent, len(x) * positions)


if __name__ == "__main__":
    main()
