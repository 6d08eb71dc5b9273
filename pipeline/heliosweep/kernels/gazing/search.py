"""Methods O1 and O2: slopes by Nelder-Mead's simplex method, pixel by pixel [1]_.

O1 looks for the wavefront slope w that makes the sum over the lit cameras of (B(|m_i - w|) - I_i)^2 least; O2 for the
mirror slope p, with rays traced back, sum of (B(eps_i(p)) - I_i)^2. Both start at method A's result. The simplex and
the tolerances are fixed: the defaults of SciPy would stop after five evaluations at these magnitudes.

A search depends on its own values alone, so the company that it keeps changes no bit of it.

References
----------
.. [1] P.-H. Defieux, C. Caliot and F. Henault, "Hybrid optical method for characterizing a heliostat field in a
   concentrated solar power plant", AIP Conf. Proc. 2303 (2020) 100002, doi 10.1063/5.0029270
"""

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.gazing.geometry import Scene
from heliosweep.kernels.gazing.lanes import (
    GAIN,
    IDEAL_A,
    IDEAL_B,
    LANES,
    MERIT,
    NOT_CONVERGED,
    A,
    B,
    Flags,
    SlopeFit,
    begun,
    block_size,
    brighten,
    next_lit,
    place,
    project,
    rays_size,
    reflect,
    trace_back,
    weigh,
)
from heliosweep.kernels.gazing.simplex import (
    EVALUATIONS,
    GOES_ON,
    ITERATIONS,
    VALUES,
    VERTICES,
    advance,
    begin,
)
from heliosweep.kernels.sun.profiles import Profile

SIMPLEX = 0.5e-3
"""Side of the first simplex. [rad]"""
XATOL = 1e-7
"""Size of the last simplex. [rad]"""
FATOL = 1e-10
"""Range of the merit in the last simplex. [1]"""
LIMIT = 400
"""Most iterations, and most evaluations: SciPy's limits for two unknowns."""


def search_slopes(
    layout: Scene,
    profile: Profile,
    images: ArrayLike,
    start: ArrayLike,
    pixels: ArrayLike | None = None,
    *,
    threshold: float = 0.3,
    fit_gain: bool = False,
) -> SlopeFit:
    """Slopes of all pixels (y, z), shape (2, N) [m], by method O2 from the slopes p that method A finds.

    Without `pixels`, slopes w of the wavefront by method O1 from those of method A; mirror slopes are T (w - w_ideal)
    with T of `geometry.transfers` and w_ideal of `linear.ideal_wavefront`. Other parameters as in `lm.fit_slopes`.
    """
    seen, found, evaluations, flags = begun(images, start)
    places = np.zeros_like(found[:2]) if pixels is None else np.array(pixels, np.float64, order="C")
    search(pixels is None, layout, profile, seen, places, threshold, fit_gain, found, evaluations, flags)
    return SlopeFit(found[:2], found[2:4], found[4], found[5], evaluations, flags)


@kernel
def search(
    wavefront: bool,
    layout: Scene,
    profile: Profile,
    images: Floats,
    pixels: Floats,
    threshold: float,
    fit_gain: bool,
    found: Floats,
    evaluations: Integers,
    flags: Flags,
) -> None:
    """O1 (`wavefront`) or O2, at the pixels (y, z), shape (2, N) [m]; fills what `begun` makes."""
    cameras, number = images.shape[0], images.shape[1]
    lanes, pixel_of = np.zeros(block_size(cameras)), np.full(LANES, -1)
    rays, gaze = np.empty(rays_size(cameras)), layout.gaze
    following, first, end, busy = 0, 0, 0, 0
    while busy > 0 or following < number:
        if end < number and following + LANES > end:
            first, end = following, trace_back(rays, cameras, layout, pixels, following)
        for k in range(LANES):
            if pixel_of[k] < 0:
                following, pixel = next_lit(
                    lanes, k, wavefront, gaze, rays, first, images, threshold, following, end, found, flags
                )
                if pixel >= 0:
                    begin(lanes, k, found[0, pixel], found[1, pixel], SIMPLEX)
                    pixel_of[k] = pixel
                    busy += 1
        _evaluate(lanes, cameras, wavefront, layout, profile, fit_gain)
        advance(lanes, XATOL, FATOL, LIMIT, LIMIT)
        for k in range(LANES):
            if pixel_of[k] < 0 or lanes[GOES_ON * LANES + k] > 0.0:
                continue
            pixel = pixel_of[k]
            found[0, pixel], found[1, pixel] = lanes[VERTICES * LANES + k], lanes[(VERTICES + 1) * LANES + k]
            found[5, pixel] = lanes[VALUES * LANES + k]
            found[4, pixel] = lanes[GAIN * LANES + k]  # of the last simplex, which is as small as its tolerances
            evaluations[pixel] = int(lanes[EVALUATIONS * LANES + k])
            if max(lanes[ITERATIONS * LANES + k], lanes[EVALUATIONS * LANES + k]) >= LIMIT:
                flags[pixel] = NOT_CONVERGED
            pixel_of[k] = -1
            busy -= 1


@kernel
def merits(
    wavefront: bool,
    layout: Scene,
    profile: Profile,
    images: Floats,
    pixels: Floats,
    threshold: float,
    fit_gain: bool,
    slopes: Floats,
) -> Floats:
    """Sums of squares, shape (N,), of the slopes w of a wavefront, or p, shape (2, N) [rad]; else as `search`."""
    cameras, number = images.shape[0], images.shape[1]
    lanes, rays, out = np.zeros(block_size(cameras)), np.empty(rays_size(cameras)), np.empty(number)
    following, first, end = 0, 0, 0
    while following < number:
        if following >= end:
            first, end = following, trace_back(rays, cameras, layout, pixels, following)
        count = min(LANES, end - following)
        for k in range(count):
            pixel = following + k
            place(lanes, k, wavefront, layout.gaze, rays, pixel - first, images, pixel, threshold)
            lanes[A * LANES + k] = lanes[IDEAL_A * LANES + k] + slopes[0, pixel]
            lanes[B * LANES + k] = lanes[IDEAL_B * LANES + k] + slopes[1, pixel]
        _evaluate(lanes, cameras, wavefront, layout, profile, fit_gain)
        for k in range(count):
            out[following + k] = lanes[MERIT * LANES + k]
        following += count
    return out


@inline
def _evaluate(lanes, cameras, wavefront, layout, profile, fit_gain):
    """Merits at the trial slopes of all lanes."""
    if wavefront:
        project(lanes, cameras)
    else:
        reflect(lanes, cameras, layout, False)
    brighten(lanes, cameras, profile, False)
    weigh(lanes, cameras, fit_gain)
