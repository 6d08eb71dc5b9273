"""Nelder-Mead's simplex method for two unknowns, by question and answer: many searches share the lanes of a processor.

A search is one row of an array. It states the point where it wants its function next, is told the value, and goes on;
whoever drives it evaluates the function for many searches at once. That is the costly part, and it becomes vector code.
A search depends on its own values alone, so the company that it keeps changes no bit of it.

The points are those of `scipy.optimize.minimize(method="Nelder-Mead")`, bit for bit: reflection 1, expansion 2,
contraction and shrinkage 1/2 (Nelder and Mead 1965 [1]_). Where two values are exactly equal, the older vertex comes
first; what SciPy does then depends on the processor.

References
----------
.. [1] J. A. Nelder and R. Mead, "A simplex method for function minimization", Comput. J. 7 (1965) 308
"""

import math

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel

__all__ = ["COUNTS", "EVALUATIONS", "ITERATIONS", "POINT", "STATE", "VALUE", "advance", "begin", "corner_simplex"]

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
    """Whether the simplex and the range of its values have become small."""
    size = max(
        max(abs(state[k, 2] - state[k, 0]), abs(state[k, 3] - state[k, 1])),
        max(abs(state[k, 4] - state[k, 0]), abs(state[k, 5] - state[k, 1])),
    )
    spread = max(abs(state[k, VALUE] - state[k, VALUE + 1]), abs(state[k, VALUE] - state[k, VALUE + 2]))
    return size <= xatol and spread <= fatol
