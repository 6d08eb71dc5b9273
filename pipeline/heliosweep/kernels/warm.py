"""Kernels made ready before work is shared among workers: loaded from the cache on disk, or compiled once.

Each function calls some kernels with the smallest input that compiles what a study calls, and returns

    seconds : float, the time it took [s]
    fresh : bool, whether a kernel had to be compiled; False when all came from the cache or were ready
"""

import functools
import time
from collections.abc import Callable
from typing import ParamSpec

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
def warm_mounts() -> None:
    """Make the kernels of mounts, spots and calibrations ready."""
    from heliosweep.kernels.mounts.aiming import aim, stand
    from heliosweep.kernels.spots.calibration import Mounts, Observed, fit
    from heliosweep.kernels.spots.curves import deviation_curves
    from heliosweep.kernels.spots.receiver import Setting, face_axes
    from heliosweep.kernels.spots.statistics import spot_statistics

    one, none, frame = np.ones(1), np.zeros((1, 1, 6)), np.eye(3)
    setting = Setting(*(one,) * 5, np.zeros(1, np.int64), *(one,) * 3, np.zeros(1), one)
    sun, pivot, aim_point = np.array([[[0.0, 0.0, 1.0]]]), np.array([[[0.0, 9.0, 0.0]]]), np.array([[0.0, -9.0, 9.0]])
    angles = stand(frame, aim(frame, sun, aim_point, none), none, aim_point).normal[..., :2]
    deviation_curves(setting, [0], [0], sun, pivot)
    spot_statistics(setting, none[:, :, np.newaxis], none, sun, pivot)
    mounts = Mounts(frame[np.newaxis], aim_point, face_axes(0.0, 0.0), np.zeros(3))
    fit(mounts, Observed(sun, angles, angles, np.ones((1, 1))), parameters=2)


@_timed
def warm_all() -> None:
    """Make all kernels ready."""
    for work in (warm_field, warm_rays, warm_mounts):
        work()
    warm_field(outlines=True)
