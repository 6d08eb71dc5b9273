"""The simplex method of Nelder and Mead for two unknowns, many searches side by side.

A search is a lane of a block (see `lanes`), its vertices and values rows. It states the point where it wants its
function next, is told the value, and goes on; whoever drives it evaluates the function for all lanes at once. What a
lane does with a value depends on where it stands, but all lanes take the same way through the code and choose by
selection: vector code, where branches would be guessed wrongly at every second value.

The points are those of `scipy.optimize.minimize(method="Nelder-Mead")`, bit for bit: reflection 1, expansion 2,
contraction and shrinkage 1/2 (Nelder and Mead 1965 [1]_). Where two values are exactly equal, the older vertex comes
first; what SciPy does then depends on the processor.

References
----------
.. [1] J. A. Nelder and R. Mead, "A simplex method for function minimization", Comput. J. 7 (1965) 308
"""

import math

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.gazing.lanes import IDEAL_A, IDEAL_B, LANES, MERIT, OWN, A, B

VERTICES, VALUES, _CENTRE, _REFLECTED, POINT = OWN, OWN + 6, OWN + 9, OWN + 11, OWN + 13
"""First rows of the three vertices, best first, two of each; of their values; of the centre of the better two, the
reflected worst and the point where a search wants its function."""
_REFLECTED_VALUE, _PHASE, ITERATIONS, EVALUATIONS, GOES_ON = range(OWN + 15, OWN + 20)
"""Rows of the value at the reflected vertex, of what the value is for, of the number of iterations, counted from 1 as
SciPy does, and of values told, and of whether the search goes on, 1 or 0."""

_FIRST, _SECOND, _THIRD, _REFLECT, _EXPAND, _OUTSIDE, _INSIDE, _SHRINK, _SHRINK_LAST = range(9)


@inline
def begin(lanes, k, x, y, side):
    """Begin a search in lane k at the simplex with two sides along the axes from (x, y), and ask for that vertex."""
    for j in range(3):
        lanes[(VERTICES + 2 * j) * LANES + k] = x + side if j == 1 else x
        lanes[(VERTICES + 2 * j + 1) * LANES + k] = y + side if j == 2 else y
    restart(lanes, k)


@inline
def restart(lanes, k):
    """Begin a search in lane k at the vertices that are in their rows, and ask for the first."""
    for j in range(3):
        lanes[(VALUES + j) * LANES + k] = math.inf
    for j in range(2):
        lanes[(POINT + j) * LANES + k] = lanes[(VERTICES + j) * LANES + k]
    lanes[A * LANES + k] = lanes[IDEAL_A * LANES + k] + lanes[POINT * LANES + k]
    lanes[B * LANES + k] = lanes[IDEAL_B * LANES + k] + lanes[(POINT + 1) * LANES + k]
    lanes[_PHASE * LANES + k], lanes[ITERATIONS * LANES + k], lanes[EVALUATIONS * LANES + k] = _FIRST, 1.0, 0.0


@kernel
def advance(lanes: Floats, xatol: float, fatol: float, iterations: float, evaluations: float) -> None:
    """Tell every lane the value at its point, row `MERIT`, and let it find the next: `POINT`, and the trial slopes.

    A search ends when no vertex is further than `xatol` from the best in either coordinate and no value further than
    `fatol` from the smallest, or at the limits of iterations and evaluations. Afterwards the first vertex is the
    minimum, and the search has converged unless a limit is reached.
    """
    for k in range(LANES):
        value, phase = lanes[MERIT * LANES + k], lanes[_PHASE * LANES + k]
        x0, y0 = lanes[VERTICES * LANES + k], lanes[(VERTICES + 1) * LANES + k]
        x1, y1 = lanes[(VERTICES + 2) * LANES + k], lanes[(VERTICES + 3) * LANES + k]
        x2, y2 = lanes[(VERTICES + 4) * LANES + k], lanes[(VERTICES + 5) * LANES + k]
        v0, v1, v2 = lanes[VALUES * LANES + k], lanes[(VALUES + 1) * LANES + k], lanes[(VALUES + 2) * LANES + k]
        cx, cy = lanes[_CENTRE * LANES + k], lanes[(_CENTRE + 1) * LANES + k]
        rx, ry = lanes[_REFLECTED * LANES + k], lanes[(_REFLECTED + 1) * LANES + k]
        px, py = lanes[POINT * LANES + k], lanes[(POINT + 1) * LANES + k]
        reflected_value = lanes[_REFLECTED_VALUE * LANES + k]
        told = lanes[EVALUATIONS * LANES + k] + 1.0
        spent = told >= evaluations
        starts, reflects = phase < _THIRD, phase == _REFLECT
        outside, inside, shrinks, last = phase == _OUTSIDE, phase == _INSIDE, phase == _SHRINK, phase == _SHRINK_LAST
        best, good, bad = value < v0, value < v1, value < v2
        below = value < reflected_value
        contracts = (outside & (value <= reflected_value)) | (inside & bad)
        fails = (outside | inside) & (not contracts)
        # the worst vertex gives way to the point or to the reflected one
        by_point = contracts | ((phase == _EXPAND) & below)
        by_reflected = ((phase == _EXPAND) & (not below)) | (reflects & (not best) & good)
        wx, wy = x2, y2
        x2, y2 = px if by_point else rx if by_reflected else x2, py if by_point else ry if by_reflected else y2
        x2, y2 = x0 + 0.5 * (x2 - x0) if shrinks else x2, y0 + 0.5 * (y2 - y0) if shrinks else y2
        x1, y1 = x0 + 0.5 * (x1 - x0) if fails else x1, y0 + 0.5 * (y1 - y0) if fails else y1
        told_last = (phase == _THIRD) | last | by_point | (by_reflected & reflects)
        v2 = value if told_last else reflected_value if by_reflected else v2
        v1 = value if (phase == _SECOND) | shrinks else v1
        v0 = value if phase == _FIRST else v0
        done = lanes[ITERATIONS * LANES + k] + (1.0 if by_point | by_reflected | last else 0.0)
        # an iteration that is not over wants one more value
        wants = (starts | (reflects & (best | (not good))) | fails | shrinks) & (not spent)
        far, near = 3.0 if best else 1.5 if bad else 0.5, -2.0 if best else -0.5 if bad else 0.5
        ax, ay = far * cx + near * wx, far * cy + near * wy  # with -2 as -(2 x), which has the same bits
        after = _EXPAND if best else _OUTSIDE if bad else _INSIDE
        after = after if reflects else _SHRINK if fails else phase + 1.0
        first = fails | (phase == _FIRST)
        ax, ay = ax if reflects else x1 if first else x2, ay if reflects else y1 if first else y2
        # vertices in the order of their values, NaN last; the order of equal values stays
        sorts = not wants
        swaps = sorts & ((v1 < v0) | ((v0 != v0) & (v1 == v1)))
        x0, x1, y0, y1 = x1 if swaps else x0, x0 if swaps else x1, y1 if swaps else y0, y0 if swaps else y1
        v0, v1 = v1 if swaps else v0, v0 if swaps else v1
        swaps = sorts & ((v2 < v1) | ((v1 != v1) & (v2 == v2)))
        x1, x2, y1, y2 = x2 if swaps else x1, x1 if swaps else x2, y2 if swaps else y1, y1 if swaps else y2
        v1, v2 = v2 if swaps else v1, v1 if swaps else v2
        swaps = sorts & ((v1 < v0) | ((v0 != v0) & (v1 == v1)))
        x0, x1, y0, y1 = x1 if swaps else x0, x0 if swaps else x1, y1 if swaps else y0, y0 if swaps else y1
        v0, v1 = v1 if swaps else v0, v0 if swaps else v1
        size = max(max(abs(x1 - x0), abs(y1 - y0)), max(abs(x2 - x0), abs(y2 - y0)))
        small = (size <= xatol) & (abs(v0 - v1) <= fatol) & (abs(v0 - v2) <= fatol)
        goes_on = wants | (not (spent | (done >= iterations) | small))
        cx, cy = (x0 + x1) / 2.0 if sorts else cx, (y0 + y1) / 2.0 if sorts else cy
        rx, ry = 2.0 * cx - x2 if sorts else rx, 2.0 * cy - y2 if sorts else ry
        px, py = ax if wants else rx, ay if wants else ry
        lanes[VERTICES * LANES + k], lanes[(VERTICES + 1) * LANES + k] = x0, y0
        lanes[(VERTICES + 2) * LANES + k], lanes[(VERTICES + 3) * LANES + k] = x1, y1
        lanes[(VERTICES + 4) * LANES + k], lanes[(VERTICES + 5) * LANES + k] = x2, y2
        lanes[VALUES * LANES + k], lanes[(VALUES + 1) * LANES + k], lanes[(VALUES + 2) * LANES + k] = v0, v1, v2
        lanes[_CENTRE * LANES + k], lanes[(_CENTRE + 1) * LANES + k] = cx, cy
        lanes[_REFLECTED * LANES + k], lanes[(_REFLECTED + 1) * LANES + k] = rx, ry
        lanes[POINT * LANES + k], lanes[(POINT + 1) * LANES + k] = px, py
        lanes[A * LANES + k] = lanes[IDEAL_A * LANES + k] + px
        lanes[B * LANES + k] = lanes[IDEAL_B * LANES + k] + py
        lanes[_REFLECTED_VALUE * LANES + k] = value if reflects else reflected_value
        lanes[_PHASE * LANES + k] = after if wants else _REFLECT
        lanes[ITERATIONS * LANES + k], lanes[EVALUATIONS * LANES + k] = done, told
        lanes[GOES_ON * LANES + k] = 1.0 if goes_on else 0.0
