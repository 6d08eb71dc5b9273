"""Speed of O1, O2 and Levenberg-Marquardt on one core: `python -m tests.bench gazing_lm`.

A pixel is what all four cameras see of it. Beside SciPy's Nelder-Mead on O2's merit, pixel after pixel: with the merit
in plain Python, which is faster than NumPy for four numbers, and with the compiled one; SciPy's least_squares stands
beside Levenberg-Marquardt. Steps are evaluations for each pixel, over all stages.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize

from heliosweep.kernels.gazing.geometry import EXACT, MirrorGrid, Scene, themis_8, transfers
from heliosweep.kernels.gazing.linear import ideal_squares, ideal_wavefront
from heliosweep.kernels.gazing.rays import ideal_mirror
from heliosweep.kernels.gazing.rendering import expose, image_set, module_spheres, waviness
from heliosweep.kernels.gazing.slopes import FATOL, SIMPLEX, XATOL, fit_slopes, graduated, merits, search_slopes
from heliosweep.kernels.sun.profiles import Profile, jose
from heliosweep.kernels.sun.tables import noisy
from tests.bench.table import Row, best, measured
from tests.kernels.gazing import twin

Floats = NDArray[np.float64]

SAMPLE = 40
"""Pixels that SciPy works on."""
CAMERAS = 4
JOSE = jose()


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


def rows() -> Iterator[Row]:
    """O1, O2 and Levenberg-Marquardt."""
    layout, grid, canting = twin.paper_scene(), twin.paper_grid(), twin.paper_canting()
    spheres, wavy = module_spheres(themis_8(), 120.0, 0.8 * canting), waviness(grid, 0.2e-3, 1.0, 0)
    table, place = noisy(jose(), 0.012), (grid.pixel_y, grid.pixel_z)
    count, done = len(grid.place), len(range(0, len(grid.place), len(grid.place) // SAMPLE))

    def first(images: Floats, profile: Profile) -> Floats:
        return twin.by_kernels(images, layout, profile, *place, transfers(layout))[0][EXACT]

    def row(name: str, work: Callable[[], Any], beside: dict[str, float]) -> Row:
        steps = float(work().evaluations.mean())
        label = f"{name}: {steps:.1f} steps"
        return measured(label, f"pixel, {CAMERAS} cameras", work, count, beside=beside, times=3)

    images, _ = image_set(layout, grid, jose(), spheres)
    start = first(images, jose())
    search = partial(scipy_searches, layout, grid, images, start)
    simplex = {"SciPy's Nelder-Mead": best(partial(search, False), 1) / done}
    levenberg = {"SciPy's least_squares": best(partial(scipy_least_squares, layout, grid, images, start), 1) / done}
    compiled = {"  its merit compiled": best(partial(search, True), 1) / done}
    wave = ideal_wavefront(layout, ideal_squares(layout, *place)) + 2.0 * start
    o1 = partial(search_slopes, layout, jose(), images, wave)
    yield row("O1", o1, simplex)
    o2 = partial(search_slopes, layout, jose(), images, start, place)
    yield row("O2", o2, simplex | compiled)
    rough, _ = image_set(layout, grid, jose(), spheres, wavy)
    tabled = image_set(layout, grid, table, spheres)[0]
    begin = first(tabled, table)
    search = partial(scipy_searches, layout, grid, tabled, begin, True, table)
    merit = {"SciPy's Nelder-Mead,\n  its merit compiled": best(search, 1) / done}
    cases: list[tuple[str, Profile, Floats, bool, dict[str, float]]] = [
        ("LM, cantings alone", jose(), images, False, simplex | levenberg),
        ("LM, and waviness", jose(), rough, False, simplex),
        ("LM, and gain fitted", jose(), rough, True, simplex),
        ("LM, and camera noise", jose(), expose(rough, noise=0.003), False, simplex),
        ("LM, noisy table", table, tabled, False, merit),
        ("LM, noisy table, gain", table, tabled, True, merit),
    ]
    for name, profile, pictures, gain, beside in cases:
        lm = partial(fit_slopes, layout, graduated(profile), pictures, first(pictures, profile), place, fit_gain=gain)
        yield row(name, lm, beside)
    yield row("O2, noisy table", partial(search_slopes, layout, table, tabled, begin, place), merit)


GROUPS = (rows,)
