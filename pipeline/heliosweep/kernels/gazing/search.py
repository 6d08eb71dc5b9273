"""Methods O1 and O2: slopes by Nelder-Mead's simplex method, pixel by pixel [1]_.

O1 looks for the wavefront slope w that makes the sum over the lit cameras of (B(|m_i - w|) - I_i)^2 least; O2 for the
mirror slope p, with rays traced back, sum of (B(eps_i(p)) - I_i)^2. Both start at method A's result. The simplex and
the tolerances are fixed: the defaults of SciPy would stop after five evaluations at these magnitudes.

A search is one row of an array. It states the point where it wants its function next, is told the value, and goes on;
whoever drives it evaluates the function for many searches at once. That is the costly part, and it becomes vector code.
A search depends on its own values alone, so the company that it keeps changes no bit of it.

The points are those of `scipy.optimize.minimize(method="Nelder-Mead")`, bit for bit: reflection 1, expansion 2,
contraction and shrinkage 1/2 (Nelder and Mead 1965 [2]_). Where two values are exactly equal, the older vertex comes
first; what SciPy does then depends on the processor.

References
----------
.. [1] P.-H. Defieux, C. Caliot and F. Henault, "Hybrid optical method for characterizing a heliostat field in a
   concentrated solar power plant", AIP Conf. Proc. 2303 (2020) 100002, doi 10.1063/5.0029270
.. [2] J. A. Nelder and R. Mead, "A simplex method for function minimization", Comput. J. 7 (1965) 308
"""

import math

import numpy as np
from numpy.typing import ArrayLike

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
    Floats,
    Integers,
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
from heliosweep.kernels.sun.profiles import Profile

STATE = 16
"""Numbers in the row of a search: the vertices (best first), their values, and what the current step needs."""
COUNTS = 3
"""Integers in the row of a search: its phase, iterations and evaluations."""

VALUE = 6
"""Column of the smallest value; the best vertex is in columns 0 and 1."""
POINT = 14
"""First of the two columns that hold the point where a search wants its function."""
ITERATIONS = 1
"""Column of the number of iterations, counted from 1 as SciPy does."""
EVALUATIONS = 2
"""Column of the number of values told."""

_CENTRE, _REFLECTED, _REFLECTED_VALUE = 9, 11, 13
_FIRST, _SECOND, _THIRD, _REFLECT, _EXPAND, _OUTSIDE, _INSIDE, _SHRINK, _SHRINK_LAST = range(9)

SIMPLEX = 0.5e-3
"""Side of the first simplex. [rad]"""
XATOL = 1e-7
"""Size of the last simplex. [rad]"""
FATOL = 1e-10
"""Range of the merit in the last simplex. [1]"""
LIMIT = 400
"""Most iterations, and most evaluations: SciPy's limits for two unknowns."""


@inline
def begin(state, counts, k):
    """Begin search k at the simplex whose three vertices are in its first six columns, and ask for the first."""
    for j in range(3):
        state[k, VALUE + j] = np.inf
    counts[k, 0], counts[k, ITERATIONS], counts[k, EVALUATIONS] = _FIRST, 1, 0
    state[k, POINT], state[k, POINT + 1] = state[k, 0], state[k, 1]


@kernel
def advance(
    state: Floats, counts: Integers, k: int, value: float, xatol: float, fatol: float, iterations: int, evaluations: int
) -> bool:
    """Tell search k the value at its point, and let it find the next; True while it goes on.

    A search ends when no vertex is further than `xatol` from the best in either coordinate and no value further than
    `fatol` from the smallest, or at the limits of iterations and evaluations. Afterwards columns 0 and 1 hold the
    minimum, `VALUE` its value, and the search has converged unless a limit is reached.
    """
    counts[k, EVALUATIONS] += 1
    spent = counts[k, EVALUATIONS] >= evaluations
    phase = counts[k, 0]
    if phase <= _THIRD:
        state[k, VALUE + phase] = value
        if phase < _THIRD and not spent:
            _ask(state, counts, k, phase + 1, state[k, 2 * phase + 2], state[k, 2 * phase + 3])
            return True
    elif phase == _REFLECT:
        if value < state[k, VALUE]:
            if not spent:
                state[k, _REFLECTED_VALUE] = value
                _ask_on_line(state, counts, k, _EXPAND, 3.0, -2.0)
                return True
        elif value < state[k, VALUE + 1]:
            _replace(state, counts, k, state[k, _REFLECTED], state[k, _REFLECTED + 1], value)
        elif not spent:
            state[k, _REFLECTED_VALUE] = value
            if value < state[k, VALUE + 2]:
                _ask_on_line(state, counts, k, _OUTSIDE, 1.5, -0.5)
            else:
                _ask_on_line(state, counts, k, _INSIDE, 0.5, 0.5)
            return True
    elif phase == _EXPAND:
        if value < state[k, _REFLECTED_VALUE]:
            _replace(state, counts, k, state[k, POINT], state[k, POINT + 1], value)
        else:
            x, y = state[k, _REFLECTED], state[k, _REFLECTED + 1]
            _replace(state, counts, k, x, y, state[k, _REFLECTED_VALUE])
    elif phase in (_OUTSIDE, _INSIDE):
        if (phase == _OUTSIDE and value <= state[k, _REFLECTED_VALUE]) or (
            phase == _INSIDE and value < state[k, VALUE + 2]
        ):
            _replace(state, counts, k, state[k, POINT], state[k, POINT + 1], value)
        else:
            _pull(state, k, 1)
            if not spent:
                _ask(state, counts, k, _SHRINK, state[k, 2], state[k, 3])
                return True
    elif phase == _SHRINK:
        state[k, VALUE + 1] = value
        _pull(state, k, 2)
        if not spent:
            _ask(state, counts, k, _SHRINK_LAST, state[k, 4], state[k, 5])
            return True
    else:
        state[k, VALUE + 2] = value
        counts[k, ITERATIONS] += 1
    _sort(state, k)
    if spent or counts[k, ITERATIONS] >= iterations or _small(state, k, xatol, fatol):
        return False
    for j in range(2):
        centre = (state[k, j] + state[k, 2 + j]) / 2.0
        state[k, _CENTRE + j] = centre
        state[k, _REFLECTED + j] = 2.0 * centre - state[k, 4 + j]
    _ask(state, counts, k, _REFLECT, state[k, _REFLECTED], state[k, _REFLECTED + 1])
    return True


@inline
def _ask(state, counts, k, phase, x, y):
    """Want the value at (x, y)."""
    counts[k, 0] = phase
    state[k, POINT], state[k, POINT + 1] = x, y


@inline
def _ask_on_line(state, counts, k, phase, a, b):
    """Want the value at a x centre + b x worst vertex; with b = -2 as -(2 x), which has the same bits."""
    x = a * state[k, _CENTRE] + b * state[k, 4]
    _ask(state, counts, k, phase, x, a * state[k, _CENTRE + 1] + b * state[k, 5])


@inline
def _replace(state, counts, k, x, y, value):
    """Put a vertex in the place of the worst: the end of an iteration."""
    state[k, 4], state[k, 5], state[k, VALUE + 2] = x, y, value
    counts[k, ITERATIONS] += 1


@inline
def _pull(state, k, j):
    """Halve the distance of vertex j from the best."""
    for c in range(2):
        state[k, 2 * j + c] = state[k, c] + 0.5 * (state[k, 2 * j + c] - state[k, c])


@inline
def _sort(state, k):
    """Order the vertices by their values, NaN last; the order of equal values stays."""
    _order(state, k, 0)
    _order(state, k, 1)
    _order(state, k, 0)


@inline
def _order(state, k, j):
    """Exchange vertices j and j + 1 if they are in the wrong order."""
    a, b = state[k, VALUE + j], state[k, VALUE + j + 1]
    if b < a or (math.isnan(a) and not math.isnan(b)):
        state[k, VALUE + j], state[k, VALUE + j + 1] = b, a
        for c in range(2):
            p, q = state[k, 2 * j + c], state[k, 2 * j + 2 + c]
            state[k, 2 * j + c], state[k, 2 * j + 2 + c] = q, p


@inline
def _small(state, k, xatol, fatol):
    """Test whether the simplex and the range of its values have become small."""
    size = max(
        max(abs(state[k, 2] - state[k, 0]), abs(state[k, 3] - state[k, 1])),
        max(abs(state[k, 4] - state[k, 0]), abs(state[k, 5] - state[k, 1])),
    )
    spread = max(abs(state[k, VALUE] - state[k, VALUE + 1]), abs(state[k, VALUE] - state[k, VALUE + 2]))
    return size <= xatol and spread <= fatol


def search_slopes(
    layout: Scene,
    profile: Profile,
    images: ArrayLike,
    y: ArrayLike,
    z: ArrayLike,
    start: ArrayLike,
    *,
    threshold: float = 0.3,
    fit_gain: bool = False,
) -> SlopeFit:
    """Slopes of all pixels by method O2, from the slopes p that method A finds; parameters as in `lm.fit_slopes`."""
    return _searched(False, layout, profile, images, [y, z], start, threshold, fit_gain)


def search_wavefronts(
    layout: Scene,
    profile: Profile,
    images: ArrayLike,
    start: ArrayLike,
    *,
    threshold: float = 0.3,
    fit_gain: bool = False,
) -> SlopeFit:
    """Wavefront slopes w of all pixels by method O1, from those of method A; parameters as in `lm.fit_slopes`.

    Mirror slopes are T (w - w_ideal) with T of `geometry.transfers` and w_ideal of `linear.ideal_wavefront`.
    """
    return _searched(True, layout, profile, images, np.zeros_like(start), start, threshold, fit_gain)


def _searched(wavefront, layout, profile, images, pixels, start, threshold, fit_gain):
    seen, found, evaluations, flags = begun(images, start)
    search(
        wavefront, layout, profile, seen, np.array(pixels, np.float64), threshold, fit_gain, found, evaluations, flags
    )
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
    state, counts = np.zeros((LANES, STATE)), np.zeros((LANES, COUNTS), np.int64)
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
                    x, y = found[0, pixel], found[1, pixel]
                    state[k, 0], state[k, 1], state[k, 2], state[k, 3] = x, y, x + SIMPLEX, y
                    state[k, 4], state[k, 5] = x, y + SIMPLEX
                    begin(state, counts, k)
                    pixel_of[k] = pixel
                    busy += 1
            lanes[A * LANES + k] = lanes[IDEAL_A * LANES + k] + state[k, POINT]
            lanes[B * LANES + k] = lanes[IDEAL_B * LANES + k] + state[k, POINT + 1]
        _evaluate(lanes, cameras, wavefront, layout, profile, fit_gain)
        for k in range(LANES):
            if pixel_of[k] < 0 or advance(state, counts, k, lanes[MERIT * LANES + k], XATOL, FATOL, LIMIT, LIMIT):
                continue
            pixel = pixel_of[k]
            found[0, pixel], found[1, pixel], found[5, pixel] = state[k, 0], state[k, 1], state[k, VALUE]
            found[4, pixel] = lanes[GAIN * LANES + k]  # of the last simplex, which is as small as its tolerances
            evaluations[pixel] = counts[k, EVALUATIONS]
            if counts[k, ITERATIONS] >= LIMIT or counts[k, EVALUATIONS] >= LIMIT:
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
        reflect(lanes, cameras, layout)
    brighten(lanes, cameras, profile)
    weigh(lanes, cameras, fit_gain)
