"""Kernels made ready before work is shared among workers: loaded from the cache on disk, or compiled once.

Each function calls the faces of some kernels with the smallest input that compiles what a study calls, and returns

    seconds : float, the time it took [s]
    fresh : bool, whether a kernel had to be compiled; False when all came from the cache or were ready
"""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from heliosweep.kernels.compiled import PURE_PYTHON

__all__ = ["warm_calibration", "warm_curves", "warm_dish", "warm_field", "warm_gazing", "warm_mount_errors"]


def warm_field() -> tuple[float, bool]:
    """Make the kernels of heliostat fields ready."""
    from heliosweep.kernels.field import field_sums, sweep
    from heliosweep.kernels.packets import packet_order

    place, side = np.array([10.0, 30.0]), np.ones(2)
    sun = np.array([[0.0, 0.0, 1.0]])
    return _timed(
        lambda: field_sums(place, place, side, side, side, 50.0, 0, sun, 0, 2),
        (packet_order, sweep),
    )


def warm_dish() -> tuple[float, bool]:
    """Make the kernels of dish tracking ready."""
    from heliosweep.kernels.ephemeris import QUANTITIES, daily_splines, sun_at_sites
    from heliosweep.kernels.tracking import RIGID, sweep, window_errors
    from heliosweep.kernels.windows import pack, pack_windows

    def work() -> None:
        pieces, sun = daily_splines(np.ones((3, QUANTITIES))), np.empty((1, 1, 3))
        sun_at_sites(np.zeros(1, np.int64), np.zeros(1), 0, pieces, 0, np.zeros((1, 3)), sun)
        window_errors(RIGID, pack_windows(sun[0], [0, 1]), 0.1, 0.0)

    return _timed(work, (daily_splines, sun_at_sites, pack, sweep))


def warm_curves(detectors: bool = False) -> tuple[float, bool]:
    """Make the kernels of deviation curves ready, those of detector lines too where they are asked for."""
    from heliosweep.kernels.conics import conics, fill_conics
    from heliosweep.kernels.detectors import crossings, fill_crossings
    from heliosweep.kernels.deviation import deviation_spots, fill_spots
    from heliosweep.kernels.tolerances import fill_tolerances, tolerances

    curve, sky = (_setting(), [0], [0]), _sky()

    def work() -> None:
        deviation_spots(*curve, [0.0], *sky)
        conics(*curve, *sky)
        tolerances(*curve, *sky)
        if detectors:
            crossings(*curve, [[1.0, 0.0, 1.0]], *sky)

    return _timed(work, (fill_spots, fill_conics, fill_tolerances, fill_crossings))


def warm_mount_errors(drawn: bool = True) -> tuple[float, bool]:
    """Make the kernels of mounts with errors ready: of their statistics where errors are drawn, or of their spots."""
    from heliosweep.kernels.mount_spots import fill_spots, mount_spots
    from heliosweep.kernels.spot_statistics import fill_statistics, spot_statistics

    mount = _setting(), np.zeros((1, 1, 1, 6)), np.zeros((1, 1, 6))
    face: Callable[..., object] = spot_statistics if drawn else mount_spots
    return _timed(lambda: face(*mount, *_sky()), (fill_spots, fill_statistics))


def warm_calibration() -> tuple[float, bool]:
    """Make the kernels of calibrations from spots ready."""
    from heliosweep.kernels.calibration import Spots, calibrate
    from heliosweep.kernels.mount_fit import fit_all
    from heliosweep.kernels.mount_spots import fill_spots, mount_spots
    from heliosweep.kernels.receiver import face_axes

    sun, pivot = _sky()
    spots = Spots(np.array([0, 1]), sun[0], np.zeros((1, 2)), np.zeros((1, 2)), np.ones(1))

    def work() -> None:
        mount_spots(_setting(), np.zeros((1, 1, 1, 6)), np.zeros((1, 1, 6)), sun, pivot)
        calibrate(spots, np.eye(3)[np.newaxis], pivot[0], face_axes(0.0, 0.0), np.zeros(3))

    return _timed(work, (fill_spots, fit_all))


def warm_gazing(methods: Sequence[str] = ("A", "O1", "O2", "LM"), cameras: bool = False) -> tuple[float, bool]:
    """Make the kernels of backward gazing ready: of O1, O2 and LM, and of images of cameras, what is asked for."""
    from heliosweep.kernels.camera_images import camera_set, heliostat, render_cameras
    from heliosweep.kernels.gazing_descent import levenberg_marquardt
    from heliosweep.kernels.gazing_geometry import camera_square, scene, transfers
    from heliosweep.kernels.gazing_grid import Modules, mirror_grid
    from heliosweep.kernels.gazing_images import image_set, module_spheres, trace
    from heliosweep.kernels.gazing_linear import (
        ideal_squares,
        least_deviations,
        method_a,
        slope_bound,
        transferred,
        wavefront_departures,
    )
    from heliosweep.kernels.gazing_lm import fit_slopes
    from heliosweep.kernels.gazing_modules import _fitted, module_estimates, module_statistics
    from heliosweep.kernels.gazing_search import merits, search, search_slopes, search_wavefronts
    from heliosweep.kernels.pinholes import pinholes
    from heliosweep.kernels.rectification import _places, _rectified, rectify
    from heliosweep.kernels.sun_profiles import jose, render

    layout = scene((0.5, 1.0), (0.0, 0.8), camera_square(0.24))
    modules, profile = Modules(np.zeros((1, 2)), np.ones((1, 2))), jose()
    grid = mirror_grid(modules, 0.5)
    y, z = grid.pixel_y, grid.pixel_z

    def work() -> None:
        render(profile, 0.0)  # of the nodes of noisy tables
        images, true = image_set(layout, grid, profile, module_spheres(modules, 120.0, np.zeros((1, 2))))
        slopes, _ = method_a(images, layout, profile, y, z, transfers(layout))
        slope_bound(layout, profile, y, z, true, 0.01)
        module_estimates(slopes[0], grid, modules, y > -9.0, 120.0)
        module_statistics(slopes[0], grid.pixel_module, y > -9.0, 1)
        if "O1" in methods:
            search_wavefronts(layout, profile, images, true)
        if "O2" in methods:
            search_slopes(layout, profile, images, y, z, true)
        if "LM" in methods:
            fit_slopes(layout, profile, images, y, z, true)
            merits(False, layout, profile, images, np.array([y, z]), 0.3, False, true)  # of what measured images leave
        if cameras:
            pictures = pinholes(layout, (8, 8), 240.0)
            mirror = heliostat(modules, 120.0, np.zeros((1, 2)))
            rectify(camera_set(layout, pictures, (8, 8), profile, mirror), pictures, 120.0, modules, grid)

    kernels = (
        render_cameras, trace, ideal_squares, wavefront_departures, transferred, least_deviations, module_statistics,
        _fitted, search, levenberg_marquardt, merits, _places, _rectified,
    )  # fmt: skip
    return _timed(work, kernels)


def _setting() -> Any:
    from heliosweep.kernels.receiver import Setting

    number = np.ones(1)
    return Setting(*(number,) * 5, np.zeros(1, np.int64), *(number,) * 3, np.zeros(1), number)


def _sky() -> tuple[np.ndarray, np.ndarray]:
    """A sun in the zenith and a pivot."""
    return np.array([[[0.0, 0.0, 1.0]]]), np.array([[[0.0, 9.0, 0.0]]])


def _timed(work: Callable[[], object], kernels: tuple[Any, ...]) -> tuple[float, bool]:
    """Seconds that `work` takes, and whether any of `kernels` was compiled in it."""

    def compiled() -> int:
        return 0 if PURE_PYTHON else sum(sum(f.stats.cache_misses.values()) for f in kernels)

    began, before = time.perf_counter(), compiled()
    work()
    return time.perf_counter() - began, compiled() > before
