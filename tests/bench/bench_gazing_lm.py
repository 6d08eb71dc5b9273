"""Speed of O1, O2 and Levenberg-Marquardt on one core. Run it: `python -m tests.bench.bench_gazing_lm`.

Prints millions of pixels per second, a pixel being what all four cameras see of it, and the ratio to SciPy's
Nelder-Mead on O2's merit, pixel after pixel in the same run: with the merit in plain Python, which is faster than NumPy
for four numbers. SciPy's least_squares stands beside it, and its Nelder-Mead on the compiled merit. Nothing is
asserted. Times are those of the processor, each the best of a few runs.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize

from heliosweep.kernels.gazing_geometry import EXACT, Scene, ideal_mirror, transfers
from heliosweep.kernels.gazing_grid import MirrorGrid, themis_8
from heliosweep.kernels.gazing_images import expose, image_set, module_spheres, waviness
from heliosweep.kernels.gazing_linear import ideal_squares, ideal_wavefront, method_a
from heliosweep.kernels.gazing_lm import fit_slopes, graduated
from heliosweep.kernels.gazing_search import FATOL, SIMPLEX, XATOL, merits, search_slopes, search_wavefronts
from heliosweep.kernels.sun_profiles import Profile, jose
from heliosweep.kernels.sun_tables import noisy
from tests.kernels import gazing_twin as twin

Floats = NDArray[np.float64]

SAMPLE = 40
"""Pixels that SciPy works on."""


JOSE = jose()


def best(work: Callable[[], object], times: int = 9) -> float:
    """Shortest time of a few runs after a first one, in seconds of this thread."""
    seconds = []
    work()
    for _ in range(times):
        began = time.thread_time()
        work()
        seconds.append(time.thread_time() - began)
    return min(seconds)


def row(name: str, seconds: float, baseline: float, evaluations: float = math.nan) -> None:
    """Print one line of the table; seconds for each pixel."""
    steps = "" if math.isnan(evaluations) else f"{evaluations:>8.1f}"
    print(f"{name:<60} {1e-6 / seconds:>10.5f} {baseline / seconds:>10.1f} {steps}")


def plain_rests(layout: Scene, image: list[float], y: float, z: float) -> Callable[[Floats], list[float]]:
    """B(eps_i(p)) - I_i of one pixel in plain Python; Jose profile."""
    x, ideal_a, ideal_b = (float(f) for f in ideal_mirror(layout.focal_length, y, z))
    rays = []
    for eye in layout.eyes.tolist():
        way = (eye[0] - x, eye[1] - y, eye[2] - z)
        length = math.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
        rays.append(tuple(f / length for f in way))
    sun_y, sun_z = layout.sun_y.tolist(), layout.sun_z.tolist()
    limb, radius, half = twin.LIMB, twin.EPS_MAX, 0.5 * twin.POWER

    def rests(p: Floats) -> list[float]:
        a, b = ideal_a + float(p[0]), ideal_b + float(p[1])
        scale = 2.0 / (1.0 + a * a + b * b)
        gy = scale * (sun_y[0] + a * sun_y[1] + b * sun_y[2])
        gz = scale * (sun_z[0] + a * sun_z[1] + b * sun_z[2])
        out = []
        for (rx, ry, rz), seen in zip(rays, image, strict=True):
            along = rx + a * ry + b * rz
            v = along * gy - (rx * sun_y[0] + ry * sun_y[1] + rz * sun_y[2])
            w = along * gz - (rx * sun_z[0] + ry * sun_z[1] + rz * sun_z[2])
            u = min((v * v + w * w) / (radius * radius), 0.999)
            out.append(limb + (1.0 - limb) * math.sqrt(1.0 - u**half) - seen)
        return out

    return rests


def scipy_searches(
    layout: Scene, grid: MirrorGrid, images: Floats, start: Floats, compiled: bool, profile: Profile = JOSE
) -> None:
    """SciPy's Nelder-Mead on some pixels; a merit that is not compiled is that of the Jose profile."""
    place = np.array([grid.pixel_y, grid.pixel_z])
    for k in range(0, len(grid.place), len(grid.place) // SAMPLE):
        rests = plain_rests(layout, images[:, k].tolist(), *place[:, k].tolist())
        image, where = images[:, k : k + 1].copy(), place[:, k : k + 1].copy()

        def plain(p: Floats, rests: Callable[[Floats], list[float]] = rests) -> float:
            return sum(rest * rest for rest in rests(p))

        def quick(p: Floats, image: Floats = image, where: Floats = where) -> float:
            return float(merits(False, layout, profile, image, where, 0.3, False, p.reshape(2, 1))[0])

        x, y = start[:, k]
        options = {"initial_simplex": [[x, y], [x + SIMPLEX, y], [x, y + SIMPLEX]], "xatol": XATOL, "fatol": FATOL}
        minimize(quick if compiled else plain, start[:, k], method="Nelder-Mead", options=options)


def scipy_least_squares(layout: Scene, grid: MirrorGrid, images: Floats, start: Floats) -> None:
    """SciPy's Levenberg-Marquardt on some pixels."""
    for k in range(0, len(grid.place), len(grid.place) // SAMPLE):
        rests = plain_rests(layout, images[:, k].tolist(), grid.pixel_y[k], grid.pixel_z[k])
        least_squares(rests, start[:, k], method="lm", x_scale=1e-3)


def main() -> None:
    """All methods."""
    layout, grid, canting = twin.paper_scene(), twin.paper_grid(), twin.paper_canting()
    spheres, wavy = module_spheres(themis_8(), 120.0, 0.8 * canting), waviness(grid, 0.2e-3, 1.0, 0)
    table, place = noisy(jose(), 0.012), (grid.pixel_y, grid.pixel_z)
    count, done = len(grid.place), len(range(0, len(grid.place), len(grid.place) // SAMPLE))

    def first(images: Floats, profile: Profile) -> Floats:
        return method_a(images, layout, profile, *place, transfers(layout))[0][EXACT]

    images, _ = image_set(layout, grid, jose(), spheres)
    start = first(images, jose())
    slow = best(partial(scipy_searches, layout, grid, images, start, False), 3) / done
    print(f"{'Jose profile, cantings of 0.8 mrad':<60} {'million/s':>10} {'ratio':>10} {'steps':>8}")
    row("SciPy's Nelder-Mead, O2", slow, slow)
    row(
        "the same on the compiled merit",
        best(partial(scipy_searches, layout, grid, images, start, True), 3) / done,
        slow,
    )
    row("SciPy's least_squares, O2", best(partial(scipy_least_squares, layout, grid, images, start), 3) / done, slow)
    wave = ideal_wavefront(layout, ideal_squares(layout, *place)) + 2.0 * start
    o1 = partial(search_wavefronts, layout, jose(), images, wave)
    row("O1", best(o1, 3) / count, slow, o1().evaluations.mean())
    o2 = partial(search_slopes, layout, jose(), images, *place, start)
    row("O2", best(o2, 3) / count, slow, o2().evaluations.mean())
    print("Levenberg-Marquardt:")
    rough, _ = image_set(layout, grid, jose(), spheres, wavy)
    cases: list[tuple[str, Profile, Floats, bool]] = [
        ("cantings alone", jose(), images, False),
        ("cantings and waviness of 0.2 mrad", jose(), rough, False),
        ("the same, gain fitted", jose(), rough, True),
        ("the same, camera noise of 0.3 %", jose(), expose(rough, noise=0.003), False),
        ("table with noise of 1.2 %, 120 nodes", table, image_set(layout, grid, table, spheres)[0], False),
        ("the same, gain fitted", table, image_set(layout, grid, table, spheres)[0], True),
    ]
    for name, profile, pictures, gain in cases:
        begin = first(pictures, profile)
        lm = partial(fit_slopes, layout, graduated(profile), pictures, *place, begin, fit_gain=gain)
        row(name, best(lm) / count, slow, lm().evaluations.mean())
    pictures = cases[4][2]
    o2 = partial(search_slopes, layout, table, pictures, *place, begin)
    row("O2 on that table", best(o2, 3) / count, slow, o2().evaluations.mean())
    search = partial(scipy_searches, layout, grid, pictures, begin, True, table)
    row("SciPy's Nelder-Mead on that table, compiled merit", best(search, 3) / done, slow)
    print("ratio: to SciPy's Nelder-Mead, Jose profile; steps: evaluations for each pixel, over all stages")


if __name__ == "__main__":
    main()
