"""Speed of backward gazing on one core: images and method A. Run it: `python -m tests.bench.bench_gazing`.

Prints millions of pixels per second, a pixel being what all four cameras see of it, beside plain NumPy. Nothing is
asserted: times depend on the machine and on its other work; each is the best of many runs.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from heliosweep.kernels.gazing_geometry import transfers
from heliosweep.kernels.gazing_grid import eroded, themis_8
from heliosweep.kernels.gazing_images import image_set, module_spheres, waviness
from heliosweep.kernels.gazing_linear import ideal_squares, method_a, slope_bound, solutions, wavefront_departures
from heliosweep.kernels.gazing_modules import module_estimates
from heliosweep.kernels.sun_profiles import jose
from heliosweep.kernels.sun_tables import noisy
from tests.kernels import gazing_twin as twin


def best(work: Callable[[], object], times: int = 30) -> float:
    """Shortest time of a few runs after a first one, in seconds."""
    seconds = []
    work()
    for _ in range(times):
        began = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - began)
    return min(seconds)


def row(name: str, seconds: float, pixels: int, baseline: float | None = None) -> None:
    """Print one line of the table; `baseline` is seconds for each pixel of the same."""
    ratio = "" if baseline is None else f"{baseline * pixels / seconds:>10.1f}"
    print(f"{name:<58} {1e-6 * pixels / seconds:>12.2f} {ratio}")


def plain_images() -> float:
    """Seconds for each pixel of the forward model in NumPy."""
    layout, modules, grid, canting = twin.paper_scene(), themis_8(), twin.paper_grid(), twin.paper_canting()

    def work() -> None:
        for number in range(8):
            here = grid.pixel_module == number
            y, z = grid.pixel_y[here], grid.pixel_z[here]
            twin.images(layout, *twin.surface(y, z, modules.centre[number], 120.0, canting[number], (0.0, 0.0)))

    return best(work) / len(grid.place)


def plain_method_a(images: np.ndarray) -> float:
    """Seconds for each pixel of method A in NumPy, one product of arrays where all cameras are lit."""
    layout, grid = twin.paper_scene(), twin.paper_grid()
    spread = layout.gaze - layout.gaze.mean(axis=0)
    solution = -0.5 * np.linalg.pinv(spread)

    def work() -> np.ndarray:
        points = twin.series(grid.pixel_y, grid.pixel_z, 120.0)
        ideal = np.stack([np.sum(twin.offsets(layout, i, *points) ** 2, axis=1) for i in range(4)])
        c = (np.maximum(images, twin.LIMB) - twin.LIMB) / (1.0 - twin.LIMB)
        square = twin.EPS_MAX**2 * np.maximum(1.0 - c**2, 0.0) ** (2.0 / twin.POWER)
        return 0.5 * (solution @ (square - ideal))

    return best(work) / len(grid.place)


def main() -> None:
    """Print the table."""
    layout, grid = twin.paper_scene(), twin.paper_grid()
    y, z, count = grid.pixel_y, grid.pixel_z, len(grid.place)
    spheres, wavy = module_spheres(themis_8(), 120.0, twin.paper_canting()), waviness(grid, 3e-4, 1.0, 0)
    one = np.ascontiguousarray(transfers(layout)[2:])
    ideal, rows = ideal_squares(layout, y, z), solutions(layout.gaze)
    print(f"{f'{count} pixels, 4 cameras':<58} {'million/s':>12} {'ratio':>10}")
    forward = plain_images()
    for name, profile in (("Jose", jose()), ("table of 120 nodes", noisy(jose(), 0.012))):
        images, slopes = image_set(layout, grid, profile, spheres)
        linear = plain_method_a(images)
        row(f"images, {name}", best(partial(image_set, layout, grid, profile, spheres)), count, forward)
        row(f"images with waviness, {name}", best(partial(image_set, layout, grid, profile, spheres, wavy)), count)
        whole = best(partial(method_a, images, layout, profile, y, z, one))
        row(f"method A, {name}", whole, count, linear)
        again = best(partial(wavefront_departures, images, ideal, rows, profile, 0.3))
        row(f"method A again at the same scene, {name}", again, count, linear)
        row(f"bound on noise, {name}", best(partial(slope_bound, layout, profile, y, z, slopes, 0.01, False)), count)
    use = eroded(grid, 2)
    row("estimates of modules", best(partial(module_estimates, slopes, grid, themis_8(), use, 120.0)), count)
    print("ratio: to the forward model and method A in plain NumPy, whole arrays at once (Jose)")


if __name__ == "__main__":
    main()
