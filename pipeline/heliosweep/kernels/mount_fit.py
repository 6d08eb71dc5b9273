"""Levenberg-Marquardt steps on reweighted rows: how `calibration` fits the errors of a mount, spot by spot."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.least_squares import LANES, orthogonalise, singular_values
from heliosweep.kernels.robust import CAUCHY, HUBER, SQUARED, gradient, residuals, variance_factor, weigh
from heliosweep.kernels.two_axis import TERMS, error_terms, spot_and_jacobian

__all__ = [
    "DEPENDENT",
    "ESTIMATED",
    "INDISTINCT",
    "NOT_CONVERGED",
    "PARAMETERS",
    "TOO_FEW",
    "fit_all",
    "predict",
]

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

PARAMETERS = 6
"""Errors of a mount."""

MOST = 300
"""Evaluations of all spots at the most, rejected steps included."""

PATIENCE = 15
"""Evaluations after which steps from first derivatives give way to those from second ones."""

DIFFERENCE = 1e-6
"""Change of an error from which second derivatives are taken. [rad]"""

INDEPENDENT = 1e-11
"""Smallest ratio of singular values of the Jacobian: below, it is rounding that tells parameters apart."""

STILL = 1e-14
"""A step of no error larger than this changes nothing. [rad]"""

ROUNDING = 4e-16
"""Rounding of a spot, in parts of the distance between mirror and receiver."""

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


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
    now, trial = np.empty((longest, 2, LANES)), np.empty((longest, 2, LANES))
    weighted, counted = np.empty((2 * longest, LANES)), np.empty(longest)
    upper, right = np.empty((LANES, LANES)), np.empty((LANES, LANES))
    values, projected = np.empty(LANES), np.empty(LANES)
    x = np.empty(PARAMETERS)
    for f in range(len(frames)):
        a, b = first[f], first[f + 1]
        n = b - a
        scene = (sun[a:b], turns[a:b], position[a:b], frames[f], pivots[f], face, offsets)
        rows, other, w = now[:n], trial[:n], weighted[: 2 * n]
        x[:] = 0.0
        predict(scene, x, parameters, rows)
        for i in range(n):
            seen = math.isfinite(rows[i, 0, parameters]) and math.isfinite(rows[i, 1, parameters])
            usable = seen and weight[a + i] > 0.0
            counted[i] = weight[a + i] if usable else 0.0
        used = _normalise(counted[:n])
        result.used[f] = used
        if 2 * used < parameters:
            result.status[f] = TOO_FEW
            continue
        # Rounding of all spots: what the step below which they do not move comes to, and a cost that is none.
        throw = pivots[f, 0] ** 2 + pivots[f, 1] ** 2 + pivots[f, 2] ** 2
        floor = ROUNDING**2 * throw * 2.0 * used
        status, evaluations = ESTIMATED, 1
        for stage in range(2 if loss == CAUCHY else 1):
            stage_loss = HUBER if loss == CAUCHY and stage == 0 else loss
            status, evaluations = _minimise(
                scene, parameters, counted, stage_loss, loss_scale, floor, evaluations,
                x, rows, other, w, upper, values, right, projected,
            )  # fmt: skip
            if status == DEPENDENT:
                break
        if status != DEPENDENT:
            weigh(rows, parameters, counted, SQUARED, loss_scale, w)
            orthogonalise(w, parameters, upper)
            singular_values(upper, parameters, values, right, projected)
            if not values[parameters - 1] > INDEPENDENT * values[0]:
                status = DEPENDENT
        result.evaluations[f], result.status[f] = evaluations, status
        least = 0
        for j in range(parameters):
            if abs(right[j, parameters - 1]) > abs(right[least, parameters - 1]):
                least = j
        result.least_known[f] = least
        if status == DEPENDENT:
            result.condition[f] = np.inf
            continue
        variance = variance_factor(rows, parameters, used, counted, loss, loss_scale)
        known = math.isfinite(variance) or 2 * used == parameters
        if not (known and np.abs(x).max() <= LARGEST):
            result.status[f] = NOT_CONVERGED
            continue
        result.condition[f] = values[0] / values[parameters - 1]
        if status == ESTIMATED and result.condition[f] > condition_limit:
            result.status[f] = INDISTINCT
        for j in range(parameters):
            result.estimate[f, j] = x[j]
            for k in range(parameters):
                total = 0.0
                for i in range(parameters):
                    total += right[j, i] * right[k, i] / (values[i] * values[i])
                result.covariance[f, j, k] = variance * total
        if loss != SQUARED:
            _curvature(scene, x, parameters, counted, loss, loss_scale, rows, other, values, right, projected)
        residuals(
            rows, parameters, counted, loss, loss_scale, values, right, result.residual[a:b], result.left_out[a:b]
        )


@kernel
def _normalise(counted: Floats) -> int:
    """Divide weights by the mean of those that are not 0, so that their unit does not matter; returns their number."""
    largest, total, used = 0.0, 0.0, 0
    for weight in counted:
        largest = max(largest, weight)
    if not largest > 0.0:
        return 0
    for i in range(len(counted)):
        counted[i] /= largest
        total += counted[i]
        used += 1 if counted[i] > 0.0 else 0
    mean = total / used
    for i in range(len(counted)):
        counted[i] /= mean
    return used


@kernel
def _minimise(
    scene: Any,
    parameters: int,
    counted: Floats,
    loss: int,
    loss_scale: float,
    floor: float,
    evaluations: int,
    x: Floats,
    rows: Floats,
    trial: Floats,
    weighted: Floats,
    upper: Floats,
    values: Floats,
    right: Floats,
    projected: Floats,
) -> tuple[int, int]:
    """Go from `x` to the least cost; `rows` are those of `x`, before and after.

    The damping is none until a step fails, and none again as soon as a step does what it promises: near the end the
    steps are Gauss-Newton's. Where these creep, since the spots hardly tell the errors apart or the loss is robust, the
    whole second derivative takes over. Where the cost is so near to its least that its differences are rounding, steps
    are taken until they are rounding themselves.
    """
    damping, growth, fresh = 0.0, 2.0, True
    cost = weigh(rows, parameters, counted, loss, loss_scale, weighted)
    tried = np.empty(PARAMETERS)
    evaluation, patience, last = evaluations, evaluations + PATIENCE, np.inf
    while evaluation < MOST:
        if fresh and evaluation < patience:
            orthogonalise(weighted, parameters, upper)
            singular_values(upper, parameters, values, right, projected)
            if not values[parameters - 1] > INDEPENDENT * values[0]:
                return DEPENDENT, evaluation
        elif fresh:
            _curvature(scene, x, parameters, counted, loss, loss_scale, rows, trial, values, right, projected)
            evaluation += parameters
        fresh = False
        tried[:] = x
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
        # What rounding of the spots does to the cost: steps that gain less are not judged by it.
        noise = 100.0 * floor + 2.0 * math.sqrt(2.0 * cost * floor) + 1e-15 * cost
        dull = gain <= noise
        still = damping == 0.0 and (largest <= STILL or shift <= floor)
        if dull and not still and shift > 0.01 * last:
            still, patience, last = evaluation >= patience, min(patience, evaluation), np.inf
        else:
            last = shift if dull else np.inf
        predict(scene, tried, parameters, trial)
        evaluation += 1
        new_cost = weigh(trial, parameters, counted, loss, loss_scale, weighted)
        accepted = new_cost < cost or (dull and new_cost <= cost + noise)
        if accepted:
            x[:] = tried
            rows[:] = trial
            damping = 0.0 if dull or cost - new_cost > 0.5 * gain else damping / 3.0
            cost, growth, fresh = new_cost, 2.0, True
        else:
            damping = max(damping, values[parameters - 1] ** 2) * growth
            growth *= 2.0
        if still:
            return ESTIMATED, evaluation
    return NOT_CONVERGED, evaluation


@kernel
def _curvature(
    scene: Any,
    x: Floats,
    parameters: int,
    counted: Floats,
    loss: int,
    loss_scale: float,
    rows: Floats,
    trial: Floats,
    values: Floats,
    right: Floats,
    projected: Floats,
) -> None:
    """Second derivative of the cost, from differences of its gradient, in the form that steps are made of.

    Of a curvature that is negative the magnitude is taken, so that every step goes down.
    """
    here, there = np.empty(PARAMETERS), np.empty(PARAMETERS)
    hessian = np.zeros((LANES, LANES))
    gradient(rows, parameters, counted, loss, loss_scale, here)
    near = np.empty(PARAMETERS)
    for k in range(parameters):
        near[:] = x
        near[k] += DIFFERENCE
        predict(scene, near, parameters, trial)
        gradient(trial, parameters, counted, loss, loss_scale, there)
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
def predict(scene: Any, x: Floats, parameters: int, rows: Floats) -> None:
    """Fill the rows of every spot: derivatives of y and of z by the errors, behind them predicted - measured."""
    sun, turns, position, frame, pivot, face, offsets = scene
    terms, jacobian = np.empty(TERMS), np.empty(2 * PARAMETERS)
    error_terms(x, terms)
    for i in range(len(rows)):
        y, z, _ = spot_and_jacobian(
            frame, turns[i, 0], turns[i, 1], turns[i, 2], turns[i, 3], terms, offsets[0], offsets[1], offsets[2],
            sun[i, 0], sun[i, 1], sun[i, 2], -pivot[0], -pivot[1], -pivot[2], face, jacobian,
        )  # fmt: skip
        for k in range(LANES):
            rows[i, 0, k] = jacobian[k] if k < parameters else 0.0
            rows[i, 1, k] = jacobian[PARAMETERS + k] if k < parameters else 0.0
        rows[i, 0, parameters] = y - position[i, 0]
        rows[i, 1, parameters] = z - position[i, 1]
