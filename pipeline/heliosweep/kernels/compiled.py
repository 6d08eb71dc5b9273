"""The one place for compiler options.

Every kernel releases the interpreter lock and is cached on disk, where there is a place for that. None is parallel: a
`prange` kernel called from two threads aborts the process, and the caller decides where work runs. None uses
fastmath: the same bits are wanted from every split of the work.
"""

import hashlib
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ["PURE_PYTHON", "UNCACHED", "inline", "kernel", "warm", "warm_dish", "warm_misalignment"]

PURE_PYTHON = os.environ.get("HELIOSWEEP_PURE_PYTHON", "") not in ("", "0")
"""True when kernels run as plain Python: slow, but a debugger can step through them."""

UNCACHED: list[str] = []
"""Kernels that every process compiles anew, because no folder for compiled code can be written."""


def _fingerprint() -> str:
    """Digest of the kernel sources.

    The compiler's cache notices a change of the file that holds a kernel, but not of the kernels that this one calls;
    with the digest in the name, no kernel outlives an edit of any other.
    """
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:12]


_FINGERPRINT = _fingerprint()


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function on its first call."""
    return _compiled(function)


def inline(function: Callable[..., Any]) -> Any:
    """Compile a function into each of its callers.

    For the small bodies of lane loops: a call would keep a loop from becoming vector code.
    """
    return _compiled(function, forceinline=True)


def _compiled(function: Callable[..., Any], **options: Any) -> Any:
    if PURE_PYTHON:
        return function
    import numba

    function.__qualname__ += f"-{_FINGERPRINT}"
    options |= {"nogil": True, "error_model": "numpy"}
    try:
        return numba.njit(function, cache=True, **options)
    except RuntimeError:  # there is no folder that numba could write compiled code to
        UNCACHED.append(function.__name__)
        return numba.njit(function, **options)


def warm() -> tuple[float, bool]:
    """Make the kernels of heliostat fields ready: load them from the cache on disk, or compile them.

    Returns
    -------
    seconds : float
        Time it took. [s]
    fresh : bool
        Whether a kernel had to be compiled; False when all came from the cache or were ready.
    """
    # Imported here because every kernel imports this module.
    import numpy as np

    from heliosweep.kernels.field import field_sums, sweep
    from heliosweep.kernels.packets import packet_order

    place, side = np.array([10.0, 30.0]), np.ones(2)
    sun = np.array([[0.0, 0.0, 1.0]])
    return _timed(
        lambda: field_sums(place, place, side, side, side, 50.0, 0, sun, 0, 2),
        (packet_order, sweep),
    )


def warm_dish() -> tuple[float, bool]:
    """Make the kernels of dish tracking ready; returns what `warm` does."""
    import numpy as np

    from heliosweep.kernels.ephemeris import QUANTITIES, daily_splines, sun_at_sites
    from heliosweep.kernels.tracking import RIGID, sweep, window_errors
    from heliosweep.kernels.windows import pack, pack_windows

    def work() -> None:
        pieces, sun = daily_splines(np.ones((3, QUANTITIES))), np.empty((1, 1, 3))
        sun_at_sites(np.zeros(1, np.int64), np.zeros(1), 0, pieces, 0, np.zeros((1, 3)), sun)
        window_errors(RIGID, pack_windows(sun[0], [0, 1]), 0.1, 0.0)

    return _timed(work, (daily_splines, sun_at_sites, pack, sweep))


def warm_misalignment() -> tuple[float, bool]:
    """Make the kernels of misaligned heliostats ready; returns what `warm` does."""
    import numpy as np

    from heliosweep.kernels import conics, detectors, deviation, mount_fit, mount_spots, spot_statistics, tolerances
    from heliosweep.kernels.calibration import Spots, calibrate
    from heliosweep.kernels.receiver import Setting, face_axes

    number = np.ones(1)
    setting = Setting(*(number,) * 5, np.zeros(1, np.int64), *(number,) * 3, np.zeros(1), number)
    curve = setting, [0], [0]
    mount = setting, np.zeros((1, 1, 1, 6)), np.zeros((1, 1, 6))
    sky = np.array([[[0.0, 0.0, 1.0]]]), np.array([[[0.0, 9.0, 0.0]]])
    spots = Spots(np.array([0, 1]), sky[0][0], np.zeros((1, 2)), np.zeros((1, 2)), number)

    def work() -> None:
        deviation.deviation_spots(*curve, [0.0], *sky)
        conics.conics(*curve, *sky)
        tolerances.tolerances(*curve, *sky)
        detectors.crossings(*curve, [[1.0, 0.0, 1.0]], *sky)
        mount_spots.mount_spots(*mount, *sky)
        spot_statistics.spot_statistics(*mount, *sky)
        calibrate(spots, np.eye(3)[np.newaxis], sky[1][0], face_axes(0.0, 0.0), np.zeros(3))

    curves = (deviation.fill_spots, conics._fill_conics, tolerances._fill_tolerances, detectors._fill_crossings)
    return _timed(work, (*curves, mount_spots._sweep, spot_statistics._sweep, mount_fit.fit_all))


def _timed(work: Callable[[], object], kernels: tuple[Any, ...]) -> tuple[float, bool]:
    """Seconds that `work` takes, and whether any of `kernels` was compiled in it."""

    def compiled() -> int:
        return 0 if PURE_PYTHON else sum(sum(f.stats.cache_misses.values()) for f in kernels)

    began, before = time.perf_counter(), compiled()
    work()
    return time.perf_counter() - began, compiled() > before
