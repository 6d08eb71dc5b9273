"""Kernels made ready before work is shared among workers: loaded from the cache on disk, or compiled once.

Each function calls some kernels with the smallest input that compiles what a study calls, and returns

    seconds : float, the time it took [s]
    fresh : bool, whether a kernel had to be compiled; False when all came from the cache or were ready
"""

import functools
import time
from collections.abc import Callable
from typing import Any, ParamSpec

import numpy as np

from heliosweep.kernels.compiled import compilations

P = ParamSpec("P")


def _timed(work: Callable[P, None]) -> Callable[P, tuple[float, bool]]:
    @functools.wraps(work)
    def timed(*args: P.args, **kwargs: P.kwargs) -> tuple[float, bool]:
        began, before = time.perf_counter(), compilations()
        work(*args, **kwargs)
        return time.perf_counter() - began, compilations() > before

    return timed


@_timed
def warm_field(outlines: bool = False) -> None:
    """Make the kernels of heliostat fields ready, and optionally of outlines of shadows."""
    from heliosweep.kernels.field.efficiency import field_sums, sorted_field
    from heliosweep.kernels.outlines import mirror_outlines

    place, side = np.array([10.0, 30.0]), np.ones(2)
    sun = np.array([[0.0, 0.0, 1.0]])
    field = sorted_field(place, place, side, side, side, 50.0)
    field_sums(field, 0, sun, 0, 2)
    if outlines:
        mirror_outlines(place, place, side, side, side, 50.0, 0, sun[0], 0, 2, 1)


@_timed
def warm_rays() -> None:
    """Make the tracer of a field with optics ready."""
    from heliosweep.kernels.rays import Errors, Facets, Scene, rectangle, trace
    from heliosweep.kernels.sunshapes import pillbox

    place, aim, none = np.array([[0.0, 100.0, 5.0]]), np.array([[0.0, 0.0, 60.0]]), np.zeros(1)
    errors, receiver = Errors(1e-3, 1e-3, 0.0), rectangle((0.0, 0.0, 60.0), 0.0, 0.0, 5.0, 5.0)
    scene = Scene(
        place,
        aim,
        np.ones((1, 2)),
        none,
        none,
        np.zeros((1, 2)),
        Facets(1, 1, 0.0),
        0,
        errors,
        pillbox(),
        receiver,
    )
    trace(scene, np.array([[0.0, -0.6, 0.8]]))


@_timed
def warm_curves() -> None:
    """Make the kernels of deviation curves ready, also of mounts with errors."""
    from heliosweep.kernels.mounts.aiming import aim
    from heliosweep.kernels.spots.curves import deviation_curves
    from heliosweep.kernels.spots.deviation import deviation_spots

    curve, sky = (_setting(), [0], [0]), _sky()
    deviation_spots(*curve, [0.0], *sky)
    deviation_curves(*curve, *sky)
    aim(np.eye(3), [0.0, 0.0, 1.0], [0.0, -9.0, 9.0], np.zeros(6))


@_timed
def warm_mount_errors(drawn: bool = True) -> None:
    """Make the kernels of mounts with errors ready: of their statistics where errors are drawn, or of their spots."""
    from heliosweep.kernels.spots.mount_spots import mount_spots
    from heliosweep.kernels.spots.statistics import spot_statistics

    known = np.zeros((1, 1, 6))
    if drawn:
        spot_statistics(_setting(), known[:, :, np.newaxis], known, *_sky())
    else:
        mount_spots(_setting(), known, known, *_sky())


@_timed
def warm_calibration() -> None:
    """Make the kernels of calibrations from spots ready."""
    from heliosweep.kernels.mounts.aiming import aim
    from heliosweep.kernels.spots.calibration import Spots, calibrate
    from heliosweep.kernels.spots.mount_spots import mount_spots
    from heliosweep.kernels.spots.receiver import face_axes

    sun, pivot = _sky()
    spots = Spots(np.array([0, 1]), sun[0], np.zeros((1, 2)), np.zeros((1, 2)), np.ones(1))

    calibrate(spots, np.eye(3)[np.newaxis], pivot[0], face_axes(0.0, 0.0), np.zeros(3))
    mount_spots(_setting(), np.zeros((1, 1, 6)), np.zeros((1, 1, 6)), sun, pivot)
    aim(np.eye(3), [0.0, 0.0, 1.0], [0.0, -9.0, 9.0], np.zeros(6))


def _setting() -> Any:
    from heliosweep.kernels.spots.receiver import Setting

    number = np.ones(1)
    return Setting(*(number,) * 5, np.zeros(1, np.int64), *(number,) * 3, np.zeros(1), number)


def _sky() -> tuple[np.ndarray, np.ndarray]:
    """A sun in the zenith and a pivot."""
    return np.array([[[0.0, 0.0, 1.0]]]), np.array([[[0.0, 9.0, 0.0]]])


@_timed
def warm_all() -> None:
    """Make all kernels ready."""
    for work in (warm_field, warm_rays, warm_curves, warm_mount_errors, warm_calibration):
        work()
    warm_field(outlines=True)
    warm_mount_errors(drawn=False)
