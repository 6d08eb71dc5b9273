"""Levenberg-Marquardt steps on reweighted rows: how `calibration` fits a mount, packet by packet of spots."""

import math
from typing import Any, NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mounts.kinematics import TERMS, error_terms
from heliosweep.kernels.spots.derivatives import (
    CAUCHY,
    HUBER,
    PARAMETERS,
    RESIDUAL,
    ROOM,
    SEEN_ROWS,
    SQUARED,
    derivative_lanes,
    gradient,
    residuals,
    seen_rows,
    variance_factor,
    weigh,
)
from heliosweep.kernels.spots.least_squares import BLOCK, COLUMNS, inverted, orthogonalise, singular_values
from heliosweep.kernels.vectors import PACKET, whole

ESTIMATED = 0
"""The errors are estimated."""
TOO_FEW = 1
"""There are fewer spots than the errors need; nothing is estimated."""
INDISTINCT = 2
"""Estimated, but the condition number is above the limit: the spots can hardly tell the errors apart."""
NOT_CONVERGED = 3
"""The iteration did not come to rest; the estimate is its last point, NaN where that is no possible one."""
DEPENDENT = 4
"""The spots cannot tell the errors apart at all, as when all are of one instant; nothing is estimated."""

LARGEST = 0.5
"""Largest error of a mount that is believed. [rad]"""

MOST = 300
"""Evaluations of all spots at the most, rejected steps included."""

PATIENCE = 15
"""Evaluations after which steps from first derivatives give way to those from second ones."""

DIFFERENCE = 1e-6
"""Change of an error from which second derivatives are taken. [rad]"""

INDEPENDENT = 1e-11
"""Smallest ratio of singular values of the Jacobian: below, it is rounding that tells parameters apart."""

FAR_FROM_DEPENDENT = 1e10
"""Condition of the triangular factor up to which no singular value is looked at before a step without damping."""

STILL = 1e-14
"""A step of no error larger than this changes nothing. [rad]"""

ROUNDING = 4e-16
"""Rounding of a spot, in parts of the distance between mirror and receiver."""


class Fit(NamedTuple):
    """Spots of one heliostat, and the mount and receiver that they are predicted for."""

    seen: Floats
    """Packets of what is known of the spots, from `seen_rows`."""
    counted: Floats
    """Weight of each lane, 0 for those that are not used."""
    lanes: int
    """Spots, filled up to whole vectors."""
    frame: Floats
    """Rows of the mount's frame, shape (9,). [1]"""
    face: Floats
    """Rows of the receiver's face, shape (9,). [1]"""
    lengths: Floats
    """Offsets r, q and h, and from the pivot to the aim point, shape (6,). [m]"""
    parameters: int
    """Errors sought."""


class Work(NamedTuple):
    """Room for one heliostat after the other."""

    rows: Floats
    """Blocks of predictions at the estimate."""
    trial: Floats
    """The same elsewhere."""
    weighted: Floats
    """The same, weighted for a step, and orthogonalised."""
    terms: Floats
    """Terms of the errors, from `kinematics.error_terms`."""
    room: Floats
    """For sums, see `robust`."""
    upper: Floats
    """Triangular factor."""
    values: Floats
    """Singular values."""
    right: Floats
    """Right singular vectors."""
    projected: Floats
    """Right-hand side in terms of the left ones."""


@kernel
def fit_all(
    first: Integers,
    sun: Floats,
    turns: Floats,
    position: Floats,
    weight: Floats,
    frames: Floats,
    pivots: Floats,
    face: Floats,
    offsets: Floats,
    parameters: int,
    loss: int,
    loss_scale: float,
    condition_limit: float,
    result: Any,
) -> None:
    """Fit heliostat after heliostat into a `calibration.Calibration`.

    Arguments as `calibration.calibrate` has them, but `turns`, shape (S, 4): cosine and sine of the primary encoder
    angle, then of the secondary; frames of shape (F, 9) and the face of shape (9,), by rows.
    """
    longest = 0
    for f in range(len(frames)):
        longest = max(longest, first[f + 1] - first[f])
    most = whole(longest, PACKET)
    blocks = most // PACKET * BLOCK
    work = Work(
        np.empty(blocks), np.empty(blocks), np.empty(blocks), np.empty(TERMS), np.empty(ROOM),
        np.empty((COLUMNS, COLUMNS)), np.empty(COLUMNS), np.empty((COLUMNS, COLUMNS)), np.empty(COLUMNS),
    )  # fmt: skip
    seen, counted, lengths, x = np.empty(most * SEEN_ROWS), np.empty(most), np.empty(6), np.empty(PARAMETERS)
    for f in range(len(frames)):
        a, b = first[f], first[f + 1]
        seen_rows(sun[a:b], turns[a:b], position[a:b], seen)
        for m in range(3):
            lengths[m], lengths[3 + m] = offsets[m], -pivots[f, m]
        scene = Fit(seen, counted, whole(b - a), frames[f], face, lengths, parameters)
        x[:] = 0.0
        predict(scene, x, work.terms, work.rows)
        for i in range(b - a):
            at = i // PACKET * BLOCK + RESIDUAL * PACKET + i % PACKET
            result.uncalibrated[a + i, 0], result.uncalibrated[a + i, 1] = (
                -work.rows[at],
                -work.rows[at + COLUMNS * PACKET],
            )
        used = _count(work.rows, weight[a:b], counted)
        result.used[f] = used
        if 2 * used < parameters:
            result.status[f] = TOO_FEW
            continue
        status, evaluations = _fitted(scene, loss, loss_scale, used, x, work)
        result.evaluations[f], result.status[f] = evaluations, status
        least = 0
        for j in range(parameters):
            if abs(work.right[j, parameters - 1]) > abs(work.right[least, parameters - 1]):
                least = j
        result.least_known[f] = least
        if status == DEPENDENT:
            result.condition[f] = np.inf
            continue
        variance = variance_factor(work.rows, b - a, parameters, used, counted, loss, loss_scale)
        known = math.isfinite(variance) or 2 * used == parameters
        if not (known and np.abs(x).max() <= LARGEST):
            result.status[f] = NOT_CONVERGED
            continue
        values = work.values
        result.condition[f] = values[0] / values[parameters - 1]
        if status == ESTIMATED and result.condition[f] > condition_limit:
            result.status[f] = INDISTINCT
        _covariance(variance, work, parameters, x, result.estimate[f], result.covariance[f])
        if loss != SQUARED:
            _curvature(scene, x, loss, loss_scale, work)
        residuals(
            work.rows, parameters, counted, loss, loss_scale, values, work.right,
            result.residual[a:b], result.left_out[a:b],
        )  # fmt: skip


@kernel
def _count(rows: Floats, weight: Floats, counted: Floats) -> int:
    """Write the weights of the spots that can be used, divided by their mean, and 0 for the others; returns how many.

    So the unit of weights does not matter.
    """
    spots, largest, total, used = len(weight), 0.0, 0.0, 0
    counted[:] = 0.0
    for i in range(spots):
        at = i // PACKET * BLOCK + RESIDUAL * PACKET + i % PACKET
        real = math.isfinite(rows[at]) and math.isfinite(rows[at + COLUMNS * PACKET])
        counted[i] = weight[i] if (real and weight[i] > 0.0) else 0.0
        largest = max(largest, counted[i])
    if not largest > 0.0:
        return 0
    for i in range(spots):
        counted[i] /= largest
        total += counted[i]
        used += 1 if counted[i] > 0.0 else 0
    mean = total / used
    for i in range(spots):
        counted[i] /= mean
    return used


@kernel
def _fitted(scene: Any, loss: int, loss_scale: float, used: int, x: Floats, work: Any) -> tuple[int, int]:
    """Minimise, and decompose the Jacobian at the estimate; returns the status and the evaluations."""
    # Rounding of all spots: what the step below which they do not move comes to, and a cost that is none.
    throw = scene.lengths[3] ** 2 + scene.lengths[4] ** 2 + scene.lengths[5] ** 2
    floor = ROUNDING**2 * throw * 2.0 * used
    status, evaluations = ESTIMATED, 1
    for stage in range(2 if loss == CAUCHY else 1):
        stage_loss = HUBER if loss == CAUCHY and stage == 0 else loss
        status, evaluations = _minimise(scene, stage_loss, loss_scale, floor, evaluations, x, work)
        if status == DEPENDENT:
            return status, evaluations
    weigh(work.rows, scene.lanes, scene.parameters, scene.counted, SQUARED, loss_scale, work.weighted, work.room)
    orthogonalise(work.weighted, scene.lanes, scene.parameters, work.upper, work.room)
    return (status if _decomposed(scene.parameters, work) else DEPENDENT), evaluations


@inline
def _decomposed(parameters, work):
    """Decompose the triangular factor; returns whether the spots can tell the errors apart."""
    singular_values(work.upper, parameters, work.values, work.right, work.projected)
    return work.values[parameters - 1] > INDEPENDENT * work.values[0]


@inline
def _covariance(variance, work, parameters, x, estimate, covariance):
    """Write the estimate and its covariance."""
    values, right = work.values, work.right
    for j in range(parameters):
        estimate[j] = x[j]
        for k in range(parameters):
            total = 0.0
            for i in range(parameters):
                total += right[j, i] * right[k, i] / (values[i] * values[i])
            covariance[j, k] = variance * total


@kernel
def _minimise(
    scene: Any, loss: int, loss_scale: float, floor: float, evaluations: int, x: Floats, work: Any
) -> tuple[int, int]:
    """Go from `x` to the least cost; the rows are those of `x`, before and after.

    The damping is none until a step fails, and none again as soon as a step does what it promises: near the end the
    steps are Gauss-Newton's. Where these creep, since the spots hardly tell the errors apart or the loss is robust, the
    whole second derivative takes over. Where the cost is so near to its least that its differences are rounding, steps
    are taken until they are rounding themselves.
    """
    parameters, lanes, counted, values = scene.parameters, scene.lanes, scene.counted, work.values
    rows, trial, weighted, room = work.rows, work.trial, work.weighted, work.room
    damping, growth, fresh, plain = 0.0, 2.0, True, False
    cost = weigh(rows, lanes, parameters, counted, loss, loss_scale, weighted, room)
    tried = np.empty(PARAMETERS)
    evaluation, patience, last = evaluations, evaluations + PATIENCE, np.inf
    while evaluation < MOST:
        if fresh and evaluation < patience:
            orthogonalise(weighted, lanes, parameters, work.upper, room)
            plain = damping == 0.0 and inverted(work.upper, parameters, work.right) < FAR_FROM_DEPENDENT
            if not plain and not _decomposed(parameters, work):
                return DEPENDENT, evaluation
        elif fresh:
            _curvature(scene, x, loss, loss_scale, work)
            evaluation += parameters
            plain = False
        fresh = False
        if plain:
            gain, shift, largest = _full_step(work, parameters, x, tried)
        else:
            gain, shift, largest = _step(work, parameters, damping, x, tried)
        # What rounding of the spots does to the cost: steps that gain less are not judged by it.
        noise = 100.0 * floor + 2.0 * math.sqrt(2.0 * cost * floor) + 1e-15 * cost
        dull = gain <= noise
        still = damping == 0.0 and (largest <= STILL or shift <= floor)
        if dull and not still and shift > 0.01 * last:
            still, patience, last = evaluation >= patience, min(patience, evaluation), np.inf
        else:
            last = shift if dull else np.inf
        predict(scene, tried, work.terms, trial)
        evaluation += 1
        new_cost = weigh(trial, lanes, parameters, counted, loss, loss_scale, weighted, room)
        accepted = new_cost < cost or (dull and new_cost <= cost + noise)
        if accepted:
            x[:] = tried
            rows[:] = trial
            damping = 0.0 if dull or cost - new_cost > 0.5 * gain else damping / 3.0
            cost, growth, fresh = new_cost, 2.0, True
        else:
            if plain:
                _decomposed(parameters, work)
                plain = False
            damping = max(damping, values[parameters - 1] ** 2) * growth
            growth *= 2.0
        if still:
            return ESTIMATED, evaluation
    return NOT_CONVERGED, evaluation


@inline
def _full_step(work, parameters, x, tried):
    """The same as `_step` without damping, by the inverse of the triangular factor in place of singular vectors."""
    upper, inverse = work.upper, work.right
    for j in range(x.shape[0]):  # also the errors that are not sought
        tried[j] = x[j]
    square, largest = 0.0, 0.0
    for j in range(parameters):
        change = 0.0
        for k in range(j, parameters):
            change += inverse[j, k] * upper[k, parameters]
        tried[j] -= change
        square += upper[j, parameters] ** 2
        largest = max(largest, abs(tried[j] - x[j]))
    return 0.5 * square, square, largest


@inline
def _step(work, parameters, damping, x, tried):
    """Write a damped step from `x`; returns what it promises, the square by which spots move, the largest change."""
    values, right, projected = work.values, work.right, work.projected
    for j in range(x.shape[0]):
        tried[j] = x[j]
    gain, shift, largest = 0.0, 0.0, 0.0
    for k in range(parameters):
        square = values[k] * values[k]
        part = square / (square + damping)
        gain += 0.5 * projected[k] ** 2 * part * (2.0 - part)
        shift += (projected[k] * part) ** 2
        for j in range(parameters):
            tried[j] -= right[j, k] * projected[k] * part / values[k]
    for j in range(parameters):
        largest = max(largest, abs(tried[j] - x[j]))
    return gain, shift, largest


@kernel
def _curvature(scene: Any, x: Floats, loss: int, loss_scale: float, work: Any) -> None:
    """Second derivative of the cost, from differences of its gradient, in the form that steps are made of.

    Of a curvature that is negative the magnitude is taken, so that every step goes down.
    """
    parameters, lanes, counted, room = scene.parameters, scene.lanes, scene.counted, work.room
    values, right, projected = work.values, work.right, work.projected
    here, there, near = np.empty(PARAMETERS), np.empty(PARAMETERS), np.empty(PARAMETERS)
    hessian = np.zeros((COLUMNS, COLUMNS))
    gradient(work.rows, lanes, parameters, counted, loss, loss_scale, here, room)
    for k in range(parameters):
        near[:] = x
        near[k] += DIFFERENCE
        predict(scene, near, work.terms, work.trial)
        gradient(work.trial, lanes, parameters, counted, loss, loss_scale, there, room)
        for j in range(parameters):
            change = 0.5 * (there[j] - here[j]) / (near[k] - x[k])
            hessian[j, k] += change
            hessian[k, j] += change
    singular_values(hessian, parameters, values, right, projected)
    for k in range(parameters):
        slope = 0.0
        for j in range(parameters):
            slope += right[j, k] * here[j]
        values[k] = math.sqrt(max(values[k], 1e-12 * values[0]))
        projected[k] = slope / values[k]


@kernel
def predict(scene: Any, x: Floats, terms: Floats, rows: Floats) -> None:
    """Fill the blocks of all spots: derivatives of y and of z by the errors, and predicted - measured."""
    error_terms(x, terms)
    for first in range(0, scene.lanes, PACKET):
        lanes = min(PACKET, scene.lanes - first)
        derivative_lanes(scene.seen, first, terms, scene.frame, scene.face, scene.lengths, rows, lanes)
