"""Speed of backward gazing on one core, images and method A: `python -m tests.bench gazing`.

A pixel is what all four cameras see of it; beside the forward model and method A in plain NumPy, whole arrays at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from heliosweep.kernels.gazing.geometry import eroded, themis_8, transfers
from heliosweep.kernels.gazing.linear import (
    ideal_squares,
    slope_bound,
    solutions,
    wavefront_departures,
)
from heliosweep.kernels.gazing.modules import module_estimates
from heliosweep.kernels.gazing.rendering import image_set, module_spheres, waviness
from heliosweep.kernels.sun.profiles import jose
from heliosweep.kernels.sun.tables import noisy
from tests.bench.table import Row, best, measured
from tests.kernels.gazing import twin

CAMERAS = 4


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


def rows() -> Iterator[Row]:
    """Images, method A and what is made of its slopes."""
    layout, grid = twin.paper_scene(), twin.paper_grid()
    y, z, count = grid.pixel_y, grid.pixel_z, len(grid.place)
    unit = f"pixel, {CAMERAS} cameras"
    spheres, wavy = module_spheres(themis_8(), 120.0, twin.paper_canting()), waviness(grid, 3e-4, 1.0, 0)
    one = np.ascontiguousarray(transfers(layout)[2:])
    ideal, solution = ideal_squares(layout, y, z), solutions(layout.gaze)
    forward = {"NumPy": plain_images()}
    for name, profile in (("Jose", jose()), ("table of 120", noisy(jose(), 0.012))):
        beside = forward if name == "Jose" else {}
        images, slopes = image_set(layout, grid, profile, spheres)
        linear = {"NumPy": plain_method_a(images)} if name == "Jose" else {}
        work: Callable[[], object] = partial(image_set, layout, grid, profile, spheres)
        yield measured(f"images, {name}", unit, work, count, beside=beside)
        work = partial(image_set, layout, grid, profile, spheres, wavy)
        yield measured(f"images with waviness, {name}", unit, work, count)
        work = partial(twin.by_kernels, images, layout, profile, y, z, one)
        yield measured(f"method A, {name}", unit, work, count, beside=linear)
        work = partial(wavefront_departures, images, ideal, solution, profile, 0.3)
        yield measured(f"method A, same scene, {name}", unit, work, count)
        work = partial(slope_bound, layout, profile, y, z, slopes, 0.01, False)
        yield measured(f"bound on noise, {name}", unit, work, count)
    use = eroded(grid, 2)
    yield measured(
        "estimates of modules", "pixel", partial(module_estimates, slopes, grid, themis_8(), use, 120.0), count
    )


GROUPS = (rows,)
