"""Errors of mounts from measured spots: robust least squares for many heliostats at once.

Each heliostat has a list of spots, each taken at commanded encoder angles. The errors sought are those of
`kinematics.ERRORS`, the first 2, 4 or 6 of them; they minimise

    1/2 sum_i c^2 rho(w_i |r_i|^2 / c^2),    r_i = predicted - measured spot (y, z),

the weights w_i divided by their mean, with
rho(u) = u (squared), u up to 1 and then 2 sqrt(u) - 1 (Huber), or log(1 + u) (Cauchy). The loss is of the distance
between the spots, not of each coordinate: it does not depend on how the axes of the face lie. The Jacobian is analytic;
Levenberg-Marquardt steps [1]_ on iteratively reweighted rows come from singular values, never from normal equations.
The Cauchy loss, which may have several minima, starts from the solution for the Huber loss, and all start from zero.

Derivatives of a spot: an error rotates the normal n and the arm to the mirror centre P about an axis w, so that
dn = w x n and dP = w x arm. The ray R = 2 (s.n) n - s from P meets the plane of the face at y = Y.p and z = Z.p with
p = P + l R, and

    dy = u.dP + v.dn,   u = Y - (Y.R / X.R) X,   v = 2 l ((u.n) s + (s.n) u),   z likewise.

The factors are those of modified Gram-Schmidt with the right-hand side as a further column, which is as stable as
Householder's method for least squares [3]_. Singular values come from one-sided Jacobi rotations, to full relative
precision for a matrix of this size [4]_.

The covariance is that of M-estimators by Huber [2]_, section 7.6, for residuals in the plane: with the influence
psi = rho'(.) r and the eigenvalues a (across r) and b (along r) of its derivative,

    C = k^2 [sum |psi|^2 / (2 n - p)] / mean(a, b)^2 (J^T W J)^-1,    k = 1 + p / (2 n) var(a, b) / mean(a, b)^2,

which for the squared loss is the usual s^2 (J^T W J)^-1. Every heliostat is computed on its own: its estimate does
not depend on the others.

References
----------
.. [1] H. B. Nielsen, "Damping parameter in Marquardt's method", report IMM-REP-1999-05, DTU (1999)
.. [2] P. J. Huber and E. M. Ronchetti, "Robust Statistics", 2nd edition, Wiley (2009)
.. [3] A. Bjorck, "Numerical Methods for Least Squares Problems", SIAM (1996), section 2.4
.. [4] J. Demmel and K. Veselic, "Jacobi's method is more accurate than QR", SIAM J. Matrix Anal. Appl. 13 (1992) 1204
"""

import math
from typing import Any, NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.mounts.kinematics import bore, tilt_matrix, times, turn
from heliosweep.kernels.vectors import cross, dot, minus, mixed, scaled

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
"""Maximum number of evaluations of all spots, rejected steps included."""

PATIENCE = 15
"""Evaluations after which steps from first derivatives give way to steps from second derivatives."""

DIFFERENCE = 1e-6
"""Change of an error from which second derivatives are taken. [rad]"""

INDEPENDENT = 1e-11
"""Minimum ratio of singular values of the Jacobian: below, rounding distinguishes the parameters."""

STILL = 1e-14
"""Maximum change of the errors in a step that changes nothing. [rad]"""

ROUNDING = 4e-16
"""Rounding of a spot, relative to the distance between mirror and receiver."""

SQUARED, HUBER, CAUCHY = 0, 1, 2
"""Losses."""

PARAMETERS = 6
"""Errors of a mount; the first columns of predictions are derivatives by them."""
RESIDUAL = 6
"""Column of the predicted minus the measured spots."""

_SWEEPS = 30
"""Maximum number of sweeps of Jacobi rotations; a matrix of six columns needs about six."""


class Spots(NamedTuple):
    """Spots of F heliostats, those of each one after the other, S in all."""

    first: Integers
    """First spot of each heliostat, and behind them the number of spots, shape (F + 1,)."""
    sun: Floats
    """Unit vector to the sun: east, north, up, shape (S, 3). [1]"""
    angles: Floats
    """Commanded encoder angles: primary (azimuth), secondary (elevation), shape (S, 2). [rad]"""
    position: Floats
    """Measured spots y, z on the plane of the receiver, shape (S, 2); NaN where there is none. [m]"""
    weight: Floats
    """Weights, inverse variances in any unit, shape (S,): only their ratios within a heliostat
    count; spots of weight 0 are predicted but not used. [1]"""


class Calibration(NamedTuple):
    """Estimates for F heliostats from S spots; NaN where nothing is estimated."""

    estimate: Floats
    """Errors in the order of `kinematics.ERRORS`, shape (F, 6); NaN for those not sought. [rad]"""
    covariance: Floats
    """Their covariance, shape (F, 6, 6); NaN where there are as many equations as errors. [rad2]"""
    condition: Floats
    """Condition number of the weighted Jacobian at the estimate, shape (F,); infinite where `DEPENDENT`. [1]"""
    residual: Floats
    """Measured minus predicted spots, shape (S, 2). [m]"""
    uncalibrated: Floats
    """Measured minus predicted spots of mounts without errors, shape (S, 2); NaN where they have none. [m]"""
    left_out: Floats
    """Residuals of predictions that leave out the spot itself, to first order, shape (S, 2). [m]"""
    used: Integers
    """Spots used, shape (F,): of positive weight, measured, and reaching the receiver without errors."""
    status: Integers
    """`ESTIMATED`, `TOO_FEW`, `INDISTINCT`, `NOT_CONVERGED` or `DEPENDENT`, shape (F,)."""
    least_known: Integers
    """Error with the largest part in the least known direction, shape (F,); -1 where there are too few spots."""
    evaluations: Integers
    """Evaluations of the spots, shape (F,)."""


def calibrate(
    spots: Spots,
    frames: Floats,
    pivots: Floats,
    face: Floats,
    offsets: Floats,
    *,
    parameters: int = 4,
    loss: int = SQUARED,
    loss_scale: float = 0.1,
    condition_limit: float = 1000.0,
) -> Calibration:
    """Estimate the errors of the mounts of many heliostats.

    Parameters
    ----------
    spots : Spots
        The measured spots.
    frames : ndarray, shape (F, 3, 3)
        Rows of each mount's frame: x, y (zero bore), z (primary axis), as `aiming.mount_frames` returns. [1]
    pivots : ndarray, shape (F, 3)
        Pivots relative to the aim point: east, north, up. [m]
    face : ndarray, shape (3, 3)
        Axes of the receiver's face, from `receiver.face_axes`. [1]
    offsets : ndarray, shape (3,)
        Mirror offset, axis offset and pedestal height. [m]
    parameters : {2, 4, 6}
        How many errors are sought, the first ones of `kinematics.ERRORS`.
    loss : int
        `SQUARED`, `HUBER` or `CAUCHY`.
    loss_scale : float
        Distance c from which the robust losses grow less than its square, for a spot of mean weight. [m]
    condition_limit : float
        Condition number above which an estimate is `INDISTINCT`. [1]

    Returns
    -------
    Calibration

    Raises
    ------
    ValueError
        If a number of parameters or loss is unknown, the scale not positive, or shapes do not fit.
    """
    if parameters not in (2, 4, 6) or loss not in (SQUARED, HUBER, CAUCHY) or not loss_scale > 0.0:
        raise ValueError(f"cannot seek {parameters} parameters with loss {loss} of scale {loss_scale}")
    number, total = len(spots.first) - 1, len(spots.weight)
    first = np.ascontiguousarray(spots.first, np.int64)
    if first[0] != 0 or first[-1] != total or np.any(np.diff(first) < 0):
        raise ValueError("the first spots of the heliostats must rise from 0 to the number of spots")
    arrays: list[tuple[Floats, tuple[int, ...]]]
    arrays = [(spots.sun, (total, 3)), (spots.angles, (total, 2)), (spots.position, (total, 2))]
    arrays += [(spots.weight, (total,)), (frames, (number, 3, 3)), (pivots, (number, 3))]
    arrays += [(face, (3, 3)), (offsets, (3,))]
    for array, shape in arrays:
        if np.shape(array) != shape:
            raise ValueError(f"expected an array of shape {shape}, not {np.shape(array)}")
    sun, angles, position, weight, rows, places, axes, lengths = (
        np.array(array, np.float64, order="C") for array, _ in arrays
    )
    result = Calibration(
        estimate=np.full((number, PARAMETERS), np.nan),
        covariance=np.full((number, PARAMETERS, PARAMETERS), np.nan),
        condition=np.full(number, np.nan),
        residual=np.full((total, 2), np.nan),
        uncalibrated=np.full((total, 2), np.nan),
        left_out=np.full((total, 2), np.nan),
        used=np.zeros(number, np.int64),
        status=np.zeros(number, np.int64),
        least_known=np.full(number, -1),
        evaluations=np.zeros(number, np.int64),
    )
    seen = np.column_stack((sun, np.cos(angles), np.sin(angles), position))
    fit_all(first, seen, weight, rows, places, axes, lengths, parameters, loss, loss_scale, condition_limit, result)
    return result


class Work(NamedTuple):
    """Arrays for the fit of one heliostat."""

    seen: Floats
    """Unit vector to the sun, cosines and sines of the encoder angles g and a (cos g, cos a, sin g, sin a), measured y
    and z, in the frame of the mount, shape (S, 9)."""
    counted: Floats
    """Weight of each spot, 0 for those not used, shape (S,)."""
    scene: Floats
    """Axes X, Y, Z of the face (0 to 8), from the pivot to the aim point (9 to 11) and from the base to the pivot (12
    to 14) in the frame of the mount, offsets r and q (15, 16)."""
    rows: Floats
    """Predictions at the estimate: derivatives and residuals of y, then of z, shape (7, 2 S)."""
    trial: Floats
    """Predictions at a trial point."""
    weighted: Floats
    """Predictions weighted for a step, and orthogonalised; the residuals follow the derivatives."""
    upper: Floats
    """Triangular factor, and the right-hand side in terms of the orthonormal columns."""
    values: Floats
    """Singular values, falling."""
    right: Floats
    """Right singular vectors."""
    projected: Floats
    """Right-hand side in terms of the left ones."""


@kernel
def fit_all(
    first: Integers,
    seen: Floats,
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
    """Fit each heliostat into a `Calibration`; arguments as in `calibrate`, `seen` as in `Work` in the world frame."""
    x = np.empty(PARAMETERS)
    for f in range(len(frames)):
        a, b = first[f], first[f + 1]
        n = b - a
        work = Work(
            seen[a:b].copy(), np.zeros(n), np.empty(17), np.empty((7, 2 * n)), np.empty((7, 2 * n)),
            np.empty((7, 2 * n)), np.zeros((7, 7)), np.zeros(6), np.zeros((6, 6)), np.zeros(6),
        )  # fmt: skip
        _to_frame(frames[f], face, pivots[f], offsets, work)
        x[:] = 0.0
        predict(work, x, work.rows)
        for i in range(n):
            result.uncalibrated[a + i, 0] = -work.rows[RESIDUAL, i]
            result.uncalibrated[a + i, 1] = -work.rows[RESIDUAL, n + i]
        used = _count(work.rows, weight[a:b], work.counted)
        result.used[f] = used
        if 2 * used < parameters:
            result.status[f] = TOO_FEW
            continue
        status, evaluations = _fitted(work, parameters, loss, loss_scale, used, x)
        result.evaluations[f], result.status[f] = evaluations, status
        least = 0
        for j in range(parameters):
            if abs(work.right[j, parameters - 1]) > abs(work.right[least, parameters - 1]):
                least = j
        result.least_known[f] = least
        if status == DEPENDENT:
            result.condition[f] = np.inf
            continue
        variance = variance_factor(work.rows, parameters, used, work.counted, loss, loss_scale)
        known = math.isfinite(variance) or 2 * used == parameters
        if not (known and np.abs(x).max() <= LARGEST):
            result.status[f] = NOT_CONVERGED
            continue
        values, right = work.values, work.right
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
            _curvature(work, x, parameters, loss, loss_scale)
        residuals(work, parameters, loss, loss_scale, result.residual[a:b], result.left_out[a:b])


@kernel
def _to_frame(frame: Floats, face: Floats, pivot: Floats, offsets: Floats, work: Any) -> None:
    """Bring suns, face and aim point into the frame of the mount."""
    rows = (
        (frame[0, 0], frame[0, 1], frame[0, 2]),
        (frame[1, 0], frame[1, 1], frame[1, 2]),
        (frame[2, 0], frame[2, 1], frame[2, 2]),
    )
    seen, scene = work.seen, work.scene
    for i in range(len(seen)):
        up = 1.0 if seen[i, 2] > 0.0 else math.nan
        seen[i, 0], seen[i, 1], seen[i, 2] = times(rows, (up * seen[i, 0], up * seen[i, 1], seen[i, 2]))
    for m in range(3):
        scene[3 * m], scene[3 * m + 1], scene[3 * m + 2] = times(rows, (face[m, 0], face[m, 1], face[m, 2]))
        scene[12 + m] = offsets[2] * frame[m, 2]
    scene[9], scene[10], scene[11] = times(rows, (-pivot[0], -pivot[1], -pivot[2]))
    scene[15], scene[16] = offsets[0], offsets[1]


@kernel
def predict(work: Any, x: Floats, rows: Floats) -> None:
    """Fill derivatives of the spots y and z by the errors, and predicted - measured spots, NaN without a spot."""
    scene, count = work.scene, len(work.seen)
    face = (scene[0], scene[1], scene[2]), (scene[3], scene[4], scene[5]), (scene[6], scene[7], scene[8])
    aim, up, offset, axis_offset = (
        (scene[9], scene[10], scene[11]),
        (scene[12], scene[13], scene[14]),
        scene[15],
        scene[16],
    )
    (c0, s0), (c1, s1) = (math.cos(x[0]), math.sin(x[0])), (math.cos(x[1]), math.sin(x[1]))
    (ce, se), (cm, sm) = (math.cos(x[4]), math.sin(x[4])), (math.cos(x[5]), math.sin(x[5]))
    tilt, (east, north) = tilt_matrix(x[2], x[3]), _tilt_axes(x[2], x[3])
    primary = times(tilt, (0.0, 0.0, 1.0))
    for i in range(count):
        seen = work.seen[i]
        s, cg, ca, sg, sa = (seen[0], seen[1], seen[2]), seen[3], seen[4], seen[5], seen[6]
        cg, sg, ca, sa = cg * c0 - sg * s0, sg * c0 + cg * s0, ca * c1 - sa * s1, sa * c1 + ca * s1
        normal = _leaned(tilt, cg, sg, bore(ca, sa, ce, se, sm, cm))
        by_collimation = _leaned(tilt, cg, sg, bore(ca, sa, ce, se, cm, -sm))
        secondary, askew = _leaned(tilt, cg, sg, (ce, 0.0, -se)), _leaned(tilt, cg, sg, (0.0, 1.0, 0.0))
        along_bore = _leaned(tilt, cg, sg, bore(ca, sa, ce, se, 0.0, offset))
        arm = mixed(1.0, along_bore, axis_offset, askew)
        lever = mixed(1.0, arm, 1.0, times(tilt, up))
        p = minus(minus(lever, up), aim)
        lit, before = dot(s, normal), dot(face[0], p)
        ray = mixed(2.0 * lit, normal, -1.0, s)
        ahead = dot(face[0], ray)
        length = -before / ahead
        real = lit > 0.0 and before > 0.0 and ahead < 0.0  # False for NaN
        spot = mixed(1.0, p, length, ray)
        for m in range(2):
            side = face[1] if m == 0 else face[2]
            u = mixed(1.0, side, -dot(side, ray) / ahead, face[0])
            v = scaled(2.0 * length, mixed(dot(u, normal), s, lit, u))
            # u.(w x arm) + v.(w x n) = w.(arm x u + n x v)
            swing = cross(normal, v)
            by_arm, by_bore = mixed(1.0, cross(arm, u), 1.0, swing), mixed(1.0, cross(along_bore, u), 1.0, swing)
            by_lever, at = mixed(1.0, cross(lever, u), 1.0, swing), m * count + i
            rows[RESIDUAL, at] = dot(side, spot) - seen[7 + m] if real else math.nan
            rows[0, at], rows[1, at] = -dot(primary, by_arm), dot(secondary, by_bore)
            rows[2, at], rows[3, at] = dot(east, by_lever), dot(north, by_lever)
            rows[4, at], rows[5, at] = dot(askew, by_bore), dot(by_collimation, v)


@inline
def _leaned(tilt, cg, sg, v):
    """Rtilt Rz(-g) v."""
    x, y = turn(cg, sg, v[0], v[1])
    return times(tilt, (x, y, v[2]))


@inline
def _tilt_axes(east, north):
    """Axes about which the tilt rotates when its components change: columns of the left Jacobian of the rotation."""
    square = east * east + north * north
    if square < 1e-4:
        v = 0.5 + square * (-1 / 24 + square * (1 / 720 - square / 40320))
        third = 1 / 6 + square * (-1 / 120 + square * (1 / 5040 - square / 362880))
    else:
        angle = math.sqrt(square)
        v, third = (1.0 - math.cos(angle)) / square, (1.0 - math.sin(angle) / angle) / square
    across = third * east * north
    return (1.0 - third * north * north, across, -v * north), (across, 1.0 - third * east * east, v * east)


@kernel
def _count(rows: Floats, weight: Floats, counted: Floats) -> int:
    """Store the weights of usable spots, divided by their mean, and 0 for others; returns the number of usable spots.

    So the unit of weights does not matter.
    """
    spots, used = len(weight), 0
    for i in range(spots):
        real = math.isfinite(rows[RESIDUAL, i]) and math.isfinite(rows[RESIDUAL, spots + i])
        counted[i] = weight[i] if (real and weight[i] > 0.0) else 0.0
        used += 1 if counted[i] > 0.0 else 0
    if used > 0:
        counted /= counted.max()
        counted /= counted.sum() / used
    return used


@kernel
def _fitted(work: Any, parameters: int, loss: int, loss_scale: float, used: int, x: Floats) -> tuple[int, int]:
    """Minimise, and decompose the Jacobian at the estimate; returns the status and the evaluations."""
    # the squared change of all spots by rounding
    throw = work.scene[9] ** 2 + work.scene[10] ** 2 + work.scene[11] ** 2
    floor = ROUNDING**2 * throw * 2.0 * used
    status, evaluations = ESTIMATED, 1
    for stage in range(2 if loss == CAUCHY else 1):
        stage_loss = HUBER if loss == CAUCHY and stage == 0 else loss
        status, evaluations = _minimise(work, parameters, stage_loss, loss_scale, floor, evaluations, x)
        if status == DEPENDENT:
            return status, evaluations
    weigh(work.rows, parameters, work.counted, SQUARED, loss_scale, work.weighted)
    return (status if _decomposed(work, parameters) else DEPENDENT), evaluations


@kernel
def _decomposed(work: Any, parameters: int) -> bool:
    """Decompose the weighted rows; returns True if the spots can distinguish the errors."""
    orthogonalise(work.weighted, parameters, work.upper)
    singular_values(work.upper, parameters, work.values, work.right, work.projected)
    return work.values[parameters - 1] > INDEPENDENT * work.values[0]


@kernel
def _minimise(
    work: Any, parameters: int, loss: int, loss_scale: float, floor: float, evaluations: int, x: Floats
) -> tuple[int, int]:
    """Go from `x` to the minimum cost; the rows belong to `x`, before and after.

    The damping is zero until a step fails, and zero again as soon as a step gains what it promises: near the end the
    steps are Gauss-Newton's. If these creep, since the spots hardly distinguish the errors or the loss is robust, the
    whole second derivative is used. If differences of the cost are rounding, steps are taken until they are rounding.
    """
    counted, values = work.counted, work.values
    damping, growth, fresh = 0.0, 2.0, True
    cost, tried = weigh(work.rows, parameters, counted, loss, loss_scale, work.weighted), np.empty(PARAMETERS)
    evaluation, patience, last = evaluations, evaluations + PATIENCE, np.inf
    while evaluation < MOST:
        if fresh and evaluation < patience:
            if not _decomposed(work, parameters):
                return DEPENDENT, evaluation
        elif fresh:
            _curvature(work, x, parameters, loss, loss_scale)
            evaluation += parameters
        gain, shift, largest = _step(work, parameters, damping, x, tried)
        # the change of the cost by rounding of the spots: steps that gain less are not judged by it
        noise = 100.0 * floor + 2.0 * math.sqrt(2.0 * cost * floor) + 1e-15 * cost
        dull = gain <= noise
        still = damping == 0.0 and (largest <= STILL or shift <= floor)
        if dull and not still and shift > 0.01 * last:
            still, patience, last = evaluation >= patience, min(patience, evaluation), np.inf
        else:
            last = shift if dull else np.inf
        predict(work, tried, work.trial)
        evaluation += 1
        new_cost = weigh(work.trial, parameters, counted, loss, loss_scale, work.weighted)
        fresh = new_cost < cost or (dull and new_cost <= cost + noise)
        if fresh:
            x[:], work.rows[:] = tried, work.trial
            damping = 0.0 if dull or cost - new_cost > 0.5 * gain else damping / 3.0
            cost, growth = new_cost, 2.0
        else:
            damping = max(damping, values[parameters - 1] ** 2) * growth
            growth *= 2.0
        if still:
            return ESTIMATED, evaluation
    return NOT_CONVERGED, evaluation


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
def _curvature(work: Any, x: Floats, parameters: int, loss: int, loss_scale: float) -> None:
    """Second derivative of the cost, from differences of its gradient, in the form that steps are made of.

    Negative curvatures count by magnitude, so that every step goes down.
    """
    values, right, projected = work.values, work.right, work.projected
    near, hessian = np.empty(PARAMETERS), np.zeros((7, 7))
    here = gradient(work.rows, parameters, work.counted, loss, loss_scale)
    for k in range(parameters):
        near[:] = x
        near[k] += DIFFERENCE
        predict(work, near, work.trial)
        there = gradient(work.trial, parameters, work.counted, loss, loss_scale)
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


@inline
def bend(square, loss):
    """rho, its derivative rho' and rho' + 2 u rho'' at u = `square`: loss, weight and stiffness along a residual."""
    if loss == SQUARED or (loss == HUBER and square <= 1.0):
        return square, 1.0, 1.0
    if loss == HUBER:
        root = math.sqrt(square)
        return 2.0 * root - 1.0, 1.0 / root, 0.0
    return math.log1p(square), 1.0 / (1.0 + square), (1.0 - square) / (1.0 + square) ** 2


@kernel
def weigh(rows: Floats, parameters: int, counted: Floats, loss: int, loss_scale: float, weighted: Floats) -> float:
    """Fill the weighted rows of the next step; returns the cost, infinite if a spot misses the receiver."""
    spots, cost = len(counted), 0.0
    for i in range(spots):
        root = 0.0
        if counted[i] > 0.0:
            square = rows[RESIDUAL, i] ** 2 + rows[RESIDUAL, spots + i] ** 2
            rho, slope, _ = bend(counted[i] * square / loss_scale**2, loss)
            cost += rho
            root = math.sqrt(counted[i] * slope)
        for m in range(parameters + 1):
            column = RESIDUAL if m == parameters else m
            weighted[m, i] = root * rows[column, i] if root > 0.0 else 0.0
            weighted[m, spots + i] = root * rows[column, spots + i] if root > 0.0 else 0.0
    cost *= 0.5 * loss_scale**2
    return cost if math.isfinite(cost) else np.inf


@kernel
def gradient(rows: Floats, parameters: int, counted: Floats, loss: int, loss_scale: float) -> Floats:
    """Derivative of the cost by the errors."""
    spots, slope = len(counted), np.zeros(PARAMETERS)
    for i in range(spots):
        if counted[i] > 0.0:
            y, z = rows[RESIDUAL, i], rows[RESIDUAL, spots + i]
            _, share, _ = bend(counted[i] * (y * y + z * z) / loss_scale**2, loss)
            for m in range(parameters):
                slope[m] += counted[i] * share * (rows[m, i] * y + rows[m, spots + i] * z)
    return slope


@kernel
def variance_factor(rows: Floats, parameters: int, used: int, counted: Floats, loss: int, loss_scale: float) -> float:
    """Factor of (J^T W J)^-1 in the covariance, W without the weights of the loss; NaN without a degree of freedom."""
    equations, spots = 2.0 * used, len(counted)
    influence, stiffness, stiffness_square = 0.0, 0.0, 0.0
    for i in range(spots):
        if counted[i] == 0.0:
            continue
        square = counted[i] * (rows[RESIDUAL, i] ** 2 + rows[RESIDUAL, spots + i] ** 2)
        _, across, along = bend(square / loss_scale**2, loss)
        influence += across * across * square
        stiffness += across + along
        stiffness_square += across * across + along * along
    mean = stiffness / equations
    spread = stiffness_square / equations - mean * mean
    if equations <= parameters or mean <= 0.0:
        return np.nan
    correction = 1.0 + parameters / equations * spread / (mean * mean)
    return correction * correction * influence / (equations - parameters) / (mean * mean)


@kernel
def residuals(work: Any, parameters: int, loss: int, loss_scale: float, residual: Floats, left_out: Floats) -> None:
    """Residuals (measured - predicted), and those where each prediction leaves its spot out, by one Newton step.

    With A = J H^-1 J^T, H the second derivative of the cost from its roots `values` and vectors `right`, and D the
    spot's own derivative of the influence, w rho' across its residual r and w (rho' + 2 u rho'') along it, it is
    r + A (I - D A)^-1 w rho' r: for the squared loss (I - w A)^-1 r.
    """
    rows, counted, values, right, half = work.rows, work.counted, work.values, work.right, np.empty((2, 6))
    for i in range(len(residual)):
        y, z = -rows[RESIDUAL, i], -rows[RESIDUAL, len(residual) + i]
        residual[i, 0], residual[i, 1] = y, z
        square = y * y + z * z
        _, slope, stiff = bend(counted[i] * square / loss_scale**2, loss)
        for m in range(2):
            for k in range(parameters):
                product = 0.0
                for j in range(parameters):
                    product += rows[j, m * len(residual) + i] * right[j, k]
                half[m, k] = product / values[k]
        a, b, c = 0.0, 0.0, 0.0
        for k in range(parameters):
            a += half[0, k] * half[0, k]
            b += half[0, k] * half[1, k]
            c += half[1, k] * half[1, k]
        share = counted[i] * slope
        turn = counted[i] * (stiff - slope) / square if square > 0.0 else 0.0
        d, e, f = share + turn * y * y, turn * y * z, share + turn * z * z
        p, q, r, s = 1.0 - d * a - e * b, -d * b - e * c, -e * a - f * b, 1.0 - e * b - f * c
        determinant = p * s - q * r
        larger = max(p, s)
        known = larger > 1e-9 and determinant > 1e-9 * larger  # else the spot alone determines a direction
        g, h = share * (s * y - q * z) / determinant, share * (p * z - r * y) / determinant
        left_out[i, 0] = y + a * g + b * h if known else np.nan
        left_out[i, 1] = z + b * g + c * h if known else np.nan


@kernel
def orthogonalise(rows: Floats, columns: int, upper: Floats) -> None:
    """Factor the first columns of a matrix and project the following right-hand side.

    `rows`, shape (7, n), are columns of the matrix and the right-hand side; they are replaced by orthogonal columns and
    the part of the right-hand side that is orthogonal to them. `upper` gets the triangular factor, and in column
    `columns` the right-hand side in terms of the orthonormal columns; row j is zero if column j depends on others.
    """
    upper[:] = 0.0
    for j in range(columns):
        square = _product(rows, j, j)
        if square > 0.0:
            length = math.sqrt(square)
            upper[j, j] = length
            for m in range(j + 1, columns + 1):
                product = _product(rows, j, m)
                upper[j, m] = product / length
                for k in range(rows.shape[1]):
                    rows[m, k] -= product / square * rows[j, k]


@inline
def _product(rows, a, b):
    """Scalar product of two rows, in four sums."""
    one = two = three = four = 0.0
    whole = rows.shape[1] // 4 * 4
    for k in range(0, whole, 4):
        one += rows[a, k] * rows[b, k]
        two += rows[a, k + 1] * rows[b, k + 1]
        three += rows[a, k + 2] * rows[b, k + 2]
        four += rows[a, k + 3] * rows[b, k + 3]
    for k in range(whole, rows.shape[1]):
        one += rows[a, k] * rows[b, k]
    return (one + two) + (three + four)


@kernel
def singular_values(upper: Floats, columns: int, values: Floats, right: Floats, projected: Floats) -> None:
    """Singular value decomposition of the triangular factor of `orthogonalise`, which is overwritten.

    Gives the singular values, falling; the right singular vectors as columns, the largest element of each positive; and
    the right-hand side in terms of the left singular vectors, 0 for a singular value of 0.
    """
    for a in range(columns):
        for b in range(columns):
            right[a, b] = 1.0 if a == b else 0.0
    rotated, sweeps = True, 0
    while rotated and sweeps < _SWEEPS:
        rotated, sweeps = False, sweeps + 1
        for a in range(columns - 1):
            for b in range(a + 1, columns):
                rotated |= _rotated(upper, right, a, b, columns)
    for a in range(columns):
        square, product = 0.0, 0.0
        for k in range(columns):
            square += upper[k, a] * upper[k, a]
            product += upper[k, a] * upper[k, columns]
        values[a] = math.sqrt(square)
        projected[a] = product / values[a] if square > 0.0 else 0.0
    _sort(columns, values, right, projected)


@inline
def _rotated(upper, right, a, b, columns):
    """Make columns a and b orthogonal; returns whether they were not."""
    alpha, beta, gamma = 0.0, 0.0, 0.0
    for k in range(columns):
        alpha += upper[k, a] * upper[k, a]
        beta += upper[k, b] * upper[k, b]
        gamma += upper[k, a] * upper[k, b]
    if abs(gamma) <= 1e-15 * math.sqrt(alpha * beta):
        return False
    zeta = (beta - alpha) / (2.0 * gamma)
    tangent = math.copysign(1.0, zeta) / (abs(zeta) + math.sqrt(1.0 + zeta * zeta))
    cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
    sine = cosine * tangent
    for k in range(columns):
        p, q = upper[k, a], upper[k, b]
        upper[k, a], upper[k, b] = cosine * p - sine * q, sine * p + cosine * q
        p, q = right[k, a], right[k, b]
        right[k, a], right[k, b] = cosine * p - sine * q, sine * p + cosine * q
    return True


@kernel
def _sort(columns: int, values: Floats, right: Floats, projected: Floats) -> None:
    """Bring singular values into falling order, and make the largest element of each vector positive."""
    for a in range(columns):
        best = a
        for b in range(a + 1, columns):
            if values[b] > values[best]:
                best = b
        values[a], values[best] = values[best], values[a]
        projected[a], projected[best] = projected[best], projected[a]
        largest = 0
        for k in range(columns):
            right[k, a], right[k, best] = right[k, best], right[k, a]
            if abs(right[k, a]) > abs(right[largest, a]):
                largest = k
        if right[largest, a] < 0.0:
            projected[a] = -projected[a]
            for k in range(columns):
                right[k, a] = -right[k, a]
