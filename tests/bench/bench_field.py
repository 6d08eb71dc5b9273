"""Speed of the field kernels on one core. Run it: `python -m tests.bench.bench_field`.

Prints nanoseconds for each heliostat and instant (both tracking methods, all unions), the ratio to the shapely twin of
the tests, the gain from two threads, and the cost against the size of the field and for few instants. Nothing is
asserted: times depend on the machine and on its other work; each is the best of a few runs.
"""

import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

from heliosweep.kernels.field import aimed, field_sums
from heliosweep.kernels.mounts import AZIMUTH_ELEVATION, SPINNING_ELEVATION, Mirrors
from heliosweep.kernels.sun import declination_cooper, solar_clock
from heliosweep.kernels.warm import warm_field
from heliosweep.layouts import radial_stagger
from tests.bench import solarpilot
from tests.kernels.fields import Field, chong2012
from tests.kernels.oracles import frame, image, lost

METHODS = {"spinning_elevation": SPINNING_ELEVATION, "azimuth_elevation": AZIMUTH_ELEVATION}


def year(latitude, step, every=1):
    """Sun vectors of days 1 to 365, or every few of them, solar hours 8 to 16."""
    day, hour = np.meshgrid(np.arange(1, 366, every), np.arange(8.0, 16.0 + step / 2, step), indexing="ij")
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
    """A radially staggered field of 11 m mirrors with 16 m clearance, under a tower that grows with it."""
    layout = radial_stagger(16.0, 61.3, heliostats=count)
    half = np.full(count, 5.5)
    return layout.x, layout.y, np.full(count, 7.0), half, half, 95.0 * max(1.0, np.sqrt(count / 317.0))


def twin(i: int, mirrors: Mirrors, tracking: int, s: np.ndarray) -> list[float]:
    """Shading, blocking and both at one instant by shapely, of the pairs alone whose bounding spheres meet the beam."""
    centres = np.stack((mirrors.x, mirrors.y, mirrors.z), axis=1)
    sides = np.stack((mirrors.half_width, mirrors.half_height), axis=1)
    offset, reach = centres - centres[i], mirrors.radius + mirrors.radius[i]
    images: list[list] = []
    for d in (s, mirrors.aim[i]):
        ahead = offset @ d
        near = (np.sum(offset**2, axis=1) - ahead**2 < reach**2) & (ahead > -reach) & (np.arange(len(reach)) != i)
        named = np.flatnonzero(near)
        frames = {j: frame(mirrors.aim[j], s, tracking) for j in (i, *named)}
        images.append([image(i, j, d, centres, frames, sides) for j in named])
    return [1.0 - lost(images[0]), 1.0 - lost(images[1]), 1.0 - lost(images[0] + images[1])]


def row(name, seconds, work, note=""):
    """Print one line of the table."""
    print(f"{name:<58} {seconds / work * 1e9:>10.1f} {work / seconds / 1e6:>10.2f}  {note}")


def main():
    """Print the table."""
    seconds, fresh = warm_field()
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
    fast = best(lambda: field_sums(*field, 0, sun, 0, 317)) / (317 * len(sun))
    sample = [(i, s) for s in sun[100::800] for i in range(0, 317, 20)]
    slow = best(lambda: [twin(i, mirrors, 0, s) for i, s in sample], 1)
    row("shapely twin, culled", slow, len(sample), f"{slow / len(sample) / fast:,.0f} times slower")
    try:
        spent, positions = solarpilot.measure(field[0], field[1], 11.0, 95.0)
        ratio = spent / (317 * positions) / fast
        row("PySAM (SolarPILOT), one total per sun position", spent, 317 * positions, f"{ratio:,.0f} times slower")
    except ImportError:
        print("PySAM is not installed: no comparison with SolarPILOT")

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
        spent = best(partial(field_sums, *big, 0, sun, start, stop), 2)
        row(f"block of {stop - start} in {count} heliostats", spent, (stop - start) * len(sun))

    big = staggered(30_000)
    few = {"90 instants of a year": year(30.0, 1.0, 40), "a series, 512 instants of it": year(30.0, 0.2)[:512]}
    for name, sun in few.items():
        spent = best(partial(field_sums, *big, 0, sun, 15_000, 16_000))
        row(f"block of 1000 in 30000 heliostats, {name}", spent, 1000 * len(sun))


if __name__ == "__main__":
    main()
