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
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.gazing.geometry import Scene
from heliosweep.kernels.gazing.lanes import (
    CHUNK,
    GAIN,
    LANES,
    MERIT,
    OWN,
    A,
    B,
    block_size,
    brighten,
    place_pixel,
    place_wavefront,
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

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@kernel
def begin(state: Floats, counts: Integers, k: int, simplex: Floats) -> None:
    """Begin search k at a simplex.

    Parameters
    ----------
    state : ndarray, shape (K, STATE)
        Searches; row k is filled.
    counts : ndarray of int64, shape (K, COUNTS)
        Counters; row k is filled.
    k : int
        Row.
    simplex : ndarray, shape (3, 2)
        Three vertices.
    """
    for j in range(3):
        state[k, 2 * j], state[k, 2 * j + 1] = simplex[j, 0], simplex[j, 1]
    _reset(state, counts, k)


@inline
def corner_simplex(state, counts, k, x, y, size):
    """Begin search k at the simplex (x, y), (x + size, y), (x, y + size)."""
    state[k, 0], state[k, 1] = x, y
    state[k, 2], state[k, 3] = x + size, y
    state[k, 4], state[k, 5] = x, y + size
    _reset(state, counts, k)


@inline
def _reset(state, counts, k):
    """Ask for the first vertex."""
    for j in range(3):
        state[k, VALUE + j] = np.inf
    counts[k, 0], counts[k, ITERATIONS], counts[k, EVALUATIONS] = _FIRST, 1, 0
    state[k, POINT], state[k, POINT + 1] = state[k, 0], state[k, 1]


@kernel
def advance(
    state: Floats, counts: Integers, k: int, value: float, xatol: float, fatol: float, iterations: int, evaluations: int
) -> bool:
    """Tell search k the value at its point, and let it find the next.

    Parameters
    ----------
    state, counts, k
        As in `begin`.
    value : float
        The function at `state[k, POINT]`, `state[k, POINT + 1]`.
    xatol, fatol : float
        The search ends when no vertex is further than `xatol` from the best in either coordinate and no value further
        than `fatol` from the smallest.
    iterations, evaluations : int
        Limits of both. (SciPy's are 400 and 400 for two unknowns.)

    Returns
    -------
    bool
        True while the search goes on; afterwards columns 0 and 1 hold the minimum, `VALUE` its value, and the search
        has converged unless a limit is reached.
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


SIMPLEX = 0.5e-3
"""Side of the first simplex. [rad]"""
XATOL = 1e-7
"""Size of the last simplex. [rad]"""
FATOL = 1e-10
"""Range of the merit in the last simplex. [1]"""
LIMIT = 400
"""Most iterations, and most evaluations: SciPy's limits for two unknowns."""

_FROM_A, _FROM_B = OWN, OWN + 1
"""Rows of the slopes from which those of the search are counted: of the ideal mirror, or 0."""


class SlopeSearch(NamedTuple):
    """Slopes of N pixels found by the simplex method; NaN where fewer than 3 cameras are lit."""

    slopes: Floats
    """w of O1 or p of O2, horizontal and vertical, shape (2, N). [rad]"""
    merit: Floats
    """Sum of squares left. [1]"""
    gain: Floats
    """Gain, 1 where it is not fitted. [1]"""
    evaluations: NDArray[np.int64]
    """Evaluations of the merit; 0 where there was no search."""
    converged: NDArray[np.bool_]
    """False where a limit was reached or there was no search."""


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
) -> SlopeSearch:
    """Method O2.

    Parameters
    ----------
    layout : Scene
        K cameras.
    profile : Profile
        Of the sun.
    images : array_like, shape (K, N)
        Brightness relative to the disc centre. [1]
    y, z : array_like, shape (N,)
        Pixels, from the mirror centre. [m]
    start : array_like, shape (2, N)
        First guess of p, from method A; 0 where it is not finite. [rad]
    threshold : float
        Least brightness of a lit camera; darker ones, and NaN, do not count. [1]
    fit_gain : bool
        Whether the merit is that of the best gain of the pixel, common to its cameras.

    Returns
    -------
    SlopeSearch
    """
    return _searched(False, layout, profile, images, [y, z], start, threshold, fit_gain)


def search_wavefronts(
    layout: Scene,
    profile: Profile,
    images: ArrayLike,
    start: ArrayLike,
    *,
    threshold: float = 0.3,
    fit_gain: bool = False,
) -> SlopeSearch:
    """Method O1; parameters as in `search_slopes`, with the wavefront slopes w of method A as `start` [rad].

    Mirror slopes are T (w - w_ideal) with T of `gazing_geometry.transfers` and w_ideal of
    `gazing_linear.ideal_wavefront`.
    """
    return _searched(True, layout, profile, images, np.zeros_like(start), start, threshold, fit_gain)


def _searched(wavefront, layout, profile, images, place, start, threshold, fit_gain):
    seen, where = np.array(images, np.float64), np.array(place, np.float64)
    found, counts = np.empty((4, seen.shape[1])), np.zeros((2, seen.shape[1]), np.int64)
    found[:2] = np.where(np.isfinite(start), start, 0.0)
    search(wavefront, layout, profile, seen, where, threshold, fit_gain, found, counts)
    converged = (counts[1] > 0) & (counts[0] < LIMIT) & (counts[1] < LIMIT)
    return SlopeSearch(found[:2], found[2], found[3], counts[1], converged)


@kernel
def merits(
    wavefront: bool,
    layout: Scene,
    profile: Profile,
    images: Floats,
    place: Floats,
    threshold: float,
    fit_gain: bool,
    slopes: Floats,
) -> Floats:
    """Sums of squares, shape (N,), of the slopes w of a wavefront, or p, shape (2, N) [rad]; else as `search`."""
    cameras, pixels = images.shape[0], images.shape[1]
    lanes, rays, out = np.zeros(block_size(cameras)), np.empty(rays_size(cameras)), np.empty(pixels)
    following, first, end = 0, 0, 0
    while following < pixels:
        if following >= end:
            first, end = following, trace_back(rays, cameras, layout, place, following)
        count = min(LANES, end - following)
        for k in range(count):
            pixel = following + k
            _place(lanes, k, wavefront, layout.gaze, rays, pixel - first, images, pixel, threshold)
            lanes[A * LANES + k] = lanes[_FROM_A * LANES + k] + slopes[0, pixel]
            lanes[B * LANES + k] = lanes[_FROM_B * LANES + k] + slopes[1, pixel]
        _evaluate(lanes, cameras, wavefront, layout, profile, fit_gain)
        for k in range(count):
            out[following + k] = lanes[MERIT * LANES + k]
        following += count
    return out


@kernel
def search(
    wavefront: bool,
    layout: Scene,
    profile: Profile,
    images: Floats,
    place: Floats,
    threshold: float,
    fit_gain: bool,
    found: Floats,
    numbers: NDArray[np.int64],
) -> None:
    """O1 (`wavefront`) or O2.

    Parameters
    ----------
    wavefront : bool
        Whether the unknowns are the slopes w of a wavefront, or p of the mirror.
    layout, profile, images, threshold, fit_gain
        As in `search_slopes`.
    place : ndarray, shape (2, N)
        Pixels (y, z); not used for a wavefront. [m]
    found : ndarray, shape (4, N)
        On entry the first guess in rows 0 and 1; on return slopes [rad], merit and gain.
    numbers : ndarray of int64, shape (2, N)
        0 on entry; filled with iterations and evaluations.
    """
    cameras, pixels = images.shape[0], images.shape[1]
    lanes, pixel_of = np.zeros(block_size(cameras)), np.full(LANES, -1)
    state, counts = np.zeros((LANES, STATE)), np.zeros((LANES, COUNTS), np.int64)
    rays, gaze = np.empty(rays_size(cameras)), layout.gaze
    following, first, end, busy = 0, 0, 0, 0
    while busy > 0 or following < pixels:
        if end < pixels and following + LANES > end:
            first, end = following, trace_back(rays, cameras, layout, place, following)
        for k in range(LANES):
            while pixel_of[k] < 0 and following < end:
                pixel = following
                following += 1
                if _place(lanes, k, wavefront, gaze, rays, pixel - first, images, pixel, threshold) >= 3:
                    corner_simplex(state, counts, k, found[0, pixel], found[1, pixel], SIMPLEX)
                    pixel_of[k] = pixel
                    busy += 1
                    continue
                found[0, pixel], found[1, pixel], found[2, pixel], found[3, pixel] = np.nan, np.nan, np.nan, np.nan
            lanes[A * LANES + k] = lanes[_FROM_A * LANES + k] + state[k, POINT]
            lanes[B * LANES + k] = lanes[_FROM_B * LANES + k] + state[k, POINT + 1]
        _evaluate(lanes, cameras, wavefront, layout, profile, fit_gain)
        for k in range(LANES):
            if pixel_of[k] < 0 or advance(state, counts, k, lanes[MERIT * LANES + k], XATOL, FATOL, LIMIT, LIMIT):
                continue
            pixel = pixel_of[k]
            found[0, pixel], found[1, pixel], found[2, pixel] = state[k, 0], state[k, 1], state[k, VALUE]
            found[3, pixel] = lanes[GAIN * LANES + k]  # of the last simplex, which is as small as its tolerances
            numbers[0, pixel], numbers[1, pixel] = counts[k, ITERATIONS], counts[k, EVALUATIONS]
            pixel_of[k] = -1
            busy -= 1


@inline
def _place(lanes, k, wavefront, gaze, rays, n, images, pixel, threshold):
    """Put a pixel, the nth of its chunk, into a lane; returns the number of lit cameras."""
    if wavefront:
        return place_wavefront(lanes, k, gaze, images, pixel, threshold)
    lanes[_FROM_A * LANES + k], lanes[_FROM_B * LANES + k] = rays[n], rays[CHUNK + n]
    return place_pixel(lanes, k, rays, n, images, pixel, threshold)


@inline
def _evaluate(lanes, cameras, wavefront, layout, profile, fit_gain):
    """Merits at the trial slopes of all lanes."""
    if wavefront:
        project(lanes, cameras)
    else:
        reflect(lanes, cameras, layout)
    brighten(lanes, cameras, profile)
    weigh(lanes, cameras, fit_gain)
