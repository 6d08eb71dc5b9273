"""Estimate the errors of many mounts at once from spots or detector crossings by robust least squares.

Each mount has a list of observations at commanded encoder angles. A spot has two coordinates (y, z) on the receiver
plane. A crossing of a trace with a detector array has one coordinate, the position along the array. The fit
estimates the first 2, 4 or 6 errors of `mounts.ERRORS` by minimising

    1/2 sum_i c^2 rho(w_i |r_i|^2 / c^2),    r_i = predicted - measured observation,

where the weights w_i are divided by their mean. The loss rho(u) is u for the squared loss, and log(1 + u) for the
Cauchy loss. The Huber loss is u up to u = 1, and 2 sqrt(u) - 1 above. The loss of a spot depends on the distance |r_i|,
not on each coordinate separately. The Levenberg-Marquardt steps use iteratively reweighted rows of the Jacobian [1]_.
After `PATIENCE` steps, the method uses second derivatives of the cost. The Cauchy loss may have several minima, so its
fit starts from the solution for the Huber loss. All other fits start from zero errors.

Derivatives: an error rotates the mirror about an axis w. A unit vector a of the mirror (the normal n for spots, the
axis of the reflecting cylinder for crossings) moves by w x a, and the mirror centre p by w x arm, where arm is the
vector from the axis to p. If an observation has the derivatives g_a and g_p with respect to a and p, the observation
moves by

    g_a.(w x a) + g_p.(w x arm) = w.(a x g_a + arm x g_p).

Spots: the ray R = 2 (s.n) n - s meets the plane at y = Y.(p + l R). The derivatives are g_p = u = Y - (Y.R / X.R) X and
g_a = v = 2 l ((u.n) s + (s.n) u); the derivatives of z are analogous. Crossings: `traces` defines F; the error of a
position is F / F', where F' is the derivative of F along the array.

The covariance follows Huber's formula for M-estimators [2]_, section 7.6, applied to residuals in the plane. With the
influence psi = rho'(.) r and the eigenvalues a (across r) and b (along r) of its derivative, the covariance is

    C = k^2 [sum |psi|^2 / (d n - p)] / mean(a, b)^2 (J^T W J)^-1,    k = 1 + p / (d n) var(a, b) / mean(a, b)^2,

for n observations of d coordinates. For the squared loss, C is the usual s^2 (J^T W J)^-1. The estimate of a mount does
not depend on other mounts.

References
----------
.. [1] H. B. Nielsen, "Damping parameter in Marquardt's method", report IMM-REP-1999-05, DTU (1999)
.. [2] P. J. Huber and E. M. Ronchetti, "Robust Statistics", 2nd edition, Wiley (2009)
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import Floats, Integers, inline, kernel
from heliosweep.kernels.mounts import ERRORS, Mounts, mirror_at, mount_of, six, tilt_axes, times
from heliosweep.kernels.vectors import cross, dot, minus, mixed, scaled, unit

#: Statuses of estimates. `ESTIMATED`: The errors are estimated.
#: `TOO_FEW`: There are too few observations to estimate the errors.
#: `INDISTINCT`: The errors are estimated, but the observations hardly distinguish between the errors.
#: An estimate is `INDISTINCT` if its condition number is above the limit.
#: `NOT_CONVERGED`: The iteration did not converge. The estimate is the last point, or NaN if this point is not valid.
#: `DEPENDENT`: The observations do not distinguish between the errors, for example at a single instant.
#: No errors are estimated if the status is `DEPENDENT`.
#: `EXACT`: The number of equations equals the number of errors, so the estimate has no covariance.
#: `NO_OBSERVATIONS`: The mount has no usable observation, and no errors are estimated.
ESTIMATED, TOO_FEW, INDISTINCT, NOT_CONVERGED, DEPENDENT, EXACT, NO_OBSERVATIONS = range(7)

#: Number of steps that use only first derivatives. Later steps use second derivatives.
PATIENCE = 12
#: Rounding error of a prediction, relative to the distance between mirror and receiver.
ROUNDING = 4e-16

#: Codes of the loss functions.
SQUARED, HUBER, CAUCHY = 0, 1, 2
#: Codes of the traces: cylinder along the elevation axis, and cylinder up the slope of the mirror.
TRACE_ELEVATION, TRACE_AZIMUTH = 0, 1

#: Condition number above which a calibration is doubtful, for 2, 4 and 6 estimated errors.
#: With spots measured over several hours, the condition number is about 10 for four errors.
#: For six errors, the condition number is several hundred.
CONDITION_LIMITS = {2: 100.0, 4: 100.0, 6: 1000.0}


class Observed(NamedTuple):
    """M spots or M crossings for each of N mounts. Shorter lists are padded with observations of weight 0."""

    #: Unit vectors to the sun: east, north, up, shape (N, M, 3). [1]
    sun: Floats
    #: Commanded encoder angles: primary (azimuth), secondary (elevation), shape (N, M, 2). [rad]
    angles: Floats
    #: Coordinates y, z of spots on the receiver plane, shape (N, M, 2). [m]
    #: For crossings, positions relative to the aim point in the world frame, shape (N, M, 3). [m]
    #: Missing observations are NaN.
    position: Floats
    #: Inverse variances in any unit, shape (N, M). Only the ratios between the weights of a mount matter. [1]
    #: Observations of weight 0 are predicted but not fitted.
    weight: Floats
    #: Trace of each crossing, `TRACE_ELEVATION` or `TRACE_AZIMUTH`, shape (N, M).
    trace: Integers | None = None
    #: Direction of the detector array at each crossing, in the world frame, shape (N, M, 3). [1]
    along: Floats | None = None


class Fit(NamedTuple):
    """Estimates for N mounts from M observations of D coordinates; NaN if there is no estimate."""

    #: Errors in the order of `mounts.ERRORS`, shape (N, 6); NaN for errors that are not estimated. [rad]
    estimate: Floats
    #: (J^T W J)^-1, shape (N, 6, 6). The covariance is this matrix times `variance`. [rad2/m2]
    inverse: Floats
    #: Variance of an observed coordinate of mean weight, shape (N,); NaN if there are no degrees of freedom. [m2]
    variance: Floats
    #: Condition number of the weighted Jacobian at the estimate, shape (N,); infinite if `DEPENDENT`. [1]
    condition: Floats
    #: Measured minus predicted observation, shape (N, M, D). [m]
    residual: Floats
    #: Measured observation minus the prediction for mounts without errors, shape (N, M, D). [m]
    uncalibrated: Floats
    #: Leave-one-out residuals to first order, shape (N, M, D). [m]
    left_out: Floats
    #: True for observations that the fit uses, shape (N, M).
    #: A used observation has a positive weight, a measured value, and a prediction for the mount without errors.
    counted: NDArray[np.bool_]
    #: Status code of each mount, `ESTIMATED` to `NO_OBSERVATIONS`, shape (N,).
    status: Integers
    #: Index of the error with the largest component in the direction of maximum variance, shape (N,).
    #: The index is -1 if there are too few observations.
    least_known: Integers

    @property
    def used(self) -> Integers:
        """Number of observations that the fit of each mount uses, shape (N,)."""
        return np.count_nonzero(self.counted, axis=1)

    @property
    def covariance(self) -> Floats:
        """Covariance of the errors, shape (N, 6, 6). [rad2]"""
        return self.inverse * self.variance[:, np.newaxis, np.newaxis]


def fit(
    mounts: Mounts,
    observed: Observed,
    *,
    parameters: int = 4,
    loss: int = SQUARED,
    loss_scale: float = 0.1,
    condition_limit: float | None = None,
    spread: float = 0.0,
) -> Fit:
    """Estimate the errors of mounts.

    Parameters
    ----------
    mounts : Mounts
        Mounts and receiver.
    observed : Observed
        Spots or crossings of each mount.
    parameters : {2, 4, 6}
        Number of errors to estimate, counted from the start of `mounts.ERRORS`.
    loss : int
        `SQUARED`, `HUBER` or `CAUCHY`.
    loss_scale : float
        Distance c beyond which a robust loss grows more slowly than the square of the distance, for an observation of
        mean weight. [m]
    condition_limit : float, optional
        Condition number above which an estimate is `INDISTINCT` (default: `CONDITION_LIMITS`). [1]
    spread : float
        Standard deviation of an observed coordinate of mean weight. If `spread` is 0, the deviation is estimated from
        the residuals. [m]

    Returns
    -------
    Fit
    """
    limit = CONDITION_LIMITS[parameters] if condition_limit is None else condition_limit
    count, spots = observed.weight.shape
    step, found = max(1, 20_000 // max(1, spots)), []  # number of mounts per batch, to limit memory use
    with np.errstate(all="ignore"):
        for first in range(0, max(count, 1), step):
            part = slice(first, first + step)
            seen = Observed(*(None if each is None else each[part] for each in observed))  # type: ignore[arg-type]
            found.append(_Problem(mounts.of(part), seen, parameters, loss_scale).fit(loss, limit, spread))
    return Fit(*(np.concatenate(each) for each in zip(*found, strict=True)))


class _Problem:
    """Least-squares problem of N mounts. The first axis of each array contains the mounts to evaluate."""

    def __init__(self, mounts: Mounts, observed: Observed, parameters: int, scale: float) -> None:
        self.mounts, self.parameters, self.square_scale = mounts, parameters, scale**2
        angles = observed.angles
        columns = [observed.sun, np.cos(angles), np.sin(angles), observed.position]
        self.coordinates = 2
        if observed.trace is not None and observed.along is not None:
            self.coordinates = 1
            columns += [observed.along, observed.trace[..., np.newaxis]]
        self.seen = np.ascontiguousarray(np.concatenate(columns, axis=-1))
        self.start, _, sines = self.predicted(np.arange(len(angles)), np.zeros((len(angles), len(ERRORS))))
        # Crossings are not used if the trace and the array are nearly parallel, as seen from the mirror.
        usable = np.isfinite(self.start).all(axis=-1) & (observed.weight > 0) & ~(np.abs(sines) <= 0.05)
        self.used = np.count_nonzero(usable, axis=1)
        # Two divisions avoid overflow, because weights may have any unit.
        weight = np.where(usable, observed.weight, 0.0)
        weight /= np.maximum(weight.max(axis=1, initial=0.0), 1e-320)[:, np.newaxis]
        self.weight = weight * (self.used / np.maximum(weight.sum(axis=1), 1e-320))[:, np.newaxis]

    def predicted(self, some: NDArray[np.int64], errors: Floats) -> tuple[Floats, Floats, Floats]:
        """Return residuals, derivatives of the residuals, and sines of the angles between traces and arrays.

        The residuals have shape (n, M, D), and the derivatives have shape (n, M, D, p).
        """
        seen = self.seen if len(some) == len(self.seen) else self.seen[some]
        rows = np.empty((*seen.shape[:2], self.coordinates, len(ERRORS) + 1))
        sines = np.ones(rows.shape[:2])
        frames, to_target, face, offsets = self.mounts.of(some)
        arrays = (np.ascontiguousarray(each, np.float64) for each in (frames, to_target, face, offsets, errors))
        predict(*arrays, seen, rows, sines)
        return rows[..., len(ERRORS)], rows[..., : self.parameters], sines

    def cost(self, some: NDArray[np.int64], residual: Floats, loss: int) -> Floats:
        """Return the cost of each mount, infinite if a used observation has no prediction."""
        rho, _, _ = bend(self.squares(some, residual), loss)
        cost = 0.5 * self.square_scale * np.sum(np.where(self.weight[some] > 0, rho, 0.0), axis=1)
        return np.where(np.isfinite(cost), cost, np.inf)

    def squares(self, some: NDArray[np.int64], residual: Floats) -> Floats:
        """Return the weighted squared residuals relative to the squared scale of the loss, shape (n, M)."""
        return self.weight[some] * np.sum(residual**2, axis=-1) / self.square_scale

    def system(self, some: NDArray[np.int64], residual: Floats, rows: Floats, loss: int) -> tuple[Floats, Floats]:
        """Return the gradient, shape (n, p), and an approximate second derivative, shape (n, p, p), of the cost."""
        weight = self.weight[some]
        _, slope, _ = bend(self.squares(some, residual), loss)
        root = np.sqrt(np.where(weight > 0, weight * slope, 0.0))[..., np.newaxis]
        shape = len(some), -1
        right = np.where(root > 0, root * residual, 0.0).reshape(*shape, 1)
        left = np.where(root[..., np.newaxis] > 0, root[..., np.newaxis] * rows, 0.0)
        left = left.reshape(*shape, self.parameters).swapaxes(1, 2)
        return (left @ right)[..., 0], left @ left.swapaxes(1, 2)

    def curvature(self, some: NDArray[np.int64], errors: Floats, gradient: Floats, loss: int, change: float) -> Floats:
        """Return the second derivative of the cost from differences of its gradient, shape (n, p, p)."""
        columns = []
        for k in range(self.parameters):
            near = errors.copy()
            near[:, k] += change
            there, _ = self.system(some, *self.predicted(some, near)[:2], loss)
            columns.append((there - gradient) / (near[:, k] - errors[:, k])[:, np.newaxis])
        hessian = np.stack(columns, axis=-1)
        return 0.5 * (hessian + hessian.swapaxes(1, 2))

    def minimise(self, loss: int, errors: Floats, here: NDArray[np.int64]) -> NDArray[np.int64]:
        """Minimise the cost of the mounts `here`, and return the mounts that did not converge.

        `errors` is updated in place. The damping is zero until a step fails, and decreases when steps succeed. Negative
        curvatures are replaced by their magnitudes, so that every step descends.
        """
        throw = np.sqrt(np.sum(self.mounts.to_target**2, axis=1))
        residual, rows, _ = self.predicted(here, errors[here])
        cost = self.cost(here, residual, loss)
        damping, growth, last = np.zeros(len(here)), np.full(len(here), 2.0), np.full(len(here), np.inf)
        for number in range(200):  # including rejected steps
            if not here.size:
                break
            gradient, hessian = self.system(here, residual, rows, loss)
            if number >= PATIENCE:
                hessian = self.curvature(here, errors[here], gradient, loss, 1e-8)
            finite = np.isfinite(hessian).all(axis=(1, 2), keepdims=True)
            values, vectors = np.linalg.eigh(np.where(finite, hessian, np.eye(self.parameters)))
            values = np.abs(values)
            most, least = values.max(axis=1), np.maximum(values.min(axis=1), 1e-14 * values.max(axis=1))
            values = np.maximum(values, least[:, np.newaxis])
            along = (vectors.swapaxes(1, 2) @ gradient[..., np.newaxis])[..., 0] / (values + damping[:, np.newaxis])
            step = (vectors @ along[..., np.newaxis])[..., 0]
            if number >= 3 * PATIENCE:  # full steps may oscillate across a kink of Huber's loss
                step *= 0.5
            tried = errors[here]
            tried[:, : self.parameters] -= step
            new_residual, new_rows, _ = self.predicted(here, tried)
            new_cost = self.cost(here, new_residual, loss)
            # Near the minimum, changes in the cost and in the steps are only rounding errors.
            floor = ROUNDING * throw[here]
            slack = 1e-9 * cost + 100.0 * self.used[here] * floor**2
            better = new_cost <= cost + slack
            noise = floor * np.sqrt(self.used[here] / least) + ROUNDING * np.sqrt(2.0 * cost * most) / least
            size = np.abs(step).max(axis=1)
            # Steps from first derivatives may converge slowly.
            # A small step ends the iteration only if the step is much smaller than the preceding step.
            still = better & (damping == 0.0) & (size <= np.maximum(1e-13, noise))
            still &= (size <= 0.1 * last) | (number > PATIENCE)
            errors[here[better]] = tried[better]
            residual[better], rows[better], cost[better] = new_residual[better], new_rows[better], new_cost[better]
            damping = np.where(
                better, np.where(damping < 1e-3 * least, 0.0, damping / 9.0), np.maximum(damping, least) * growth
            )
            growth = np.where(better, 2.0, 2.0 * growth)
            going = ~still
            here, residual, rows, cost = here[going], residual[going], rows[going], cost[going]
            damping, growth, last = damping[going], growth[going], size[going]
        return here

    def fit(self, loss: int, condition_limit: float, spread: float) -> Fit:
        count, p = len(self.seen), self.parameters
        errors, equations = np.zeros((count, len(ERRORS))), self.coordinates * self.used
        enough = equations >= p
        for stage in (HUBER, CAUCHY) if loss == CAUCHY else (loss,):
            failed = self.minimise(stage, errors, np.flatnonzero(enough))
        residual, rows, _ = self.predicted(np.arange(count), errors)
        root = np.sqrt(self.weight)[..., np.newaxis, np.newaxis]
        left = np.where(root > 0, root * rows, 0.0).reshape(count, -1, p)
        left = np.where(np.isfinite(left).all(axis=(1, 2), keepdims=True), left, 0.0)
        left = np.pad(left, ((0, 0), (0, max(p - left.shape[1], 0)), (0, 0)))
        _, values, vectors = np.linalg.svd(left, full_matrices=False)  # of the weighted Jacobian
        # below this ratio of singular values, only rounding errors distinguish between the mount errors
        distinct, condition = enough & (values[:, -1] > 1e-11 * values[:, 0]), values[:, 0] / values[:, -1]
        variance = self.variance(residual, loss, equations)
        status = np.where(enough, np.where(distinct, ESTIMATED, DEPENDENT), TOO_FEW)
        status[distinct & (condition > condition_limit)] = INDISTINCT
        status[failed] = np.where(distinct[failed], NOT_CONVERGED, DEPENDENT)
        plausible = np.abs(errors).max(axis=1) <= 0.5  # rad
        possible = distinct & (np.isfinite(variance) | (equations == p)) & plausible
        variance = np.where(enough, spread**2, np.nan) if spread > 0 else variance
        status[possible & np.isin(status, (ESTIMATED, INDISTINCT)) & np.isnan(variance)] = EXACT
        status[distinct & ~possible] = NOT_CONVERGED
        status[self.used == 0] = NO_OBSERVATIONS
        estimate, inverse = np.full((count, len(ERRORS)), np.nan), np.full((count, len(ERRORS), len(ERRORS)), np.nan)
        estimate[possible, :p] = errors[possible, :p]
        shares = vectors.swapaxes(1, 2) / values[:, np.newaxis, :]
        inverse[possible, :p, :p] = (shares @ shares.swapaxes(1, 2))[possible]
        left_out = np.full(residual.shape, np.nan)
        if possible.any():
            left_out[possible] = self.left_out(np.flatnonzero(possible), errors, residual, rows, shares, loss)
        return Fit(
            estimate,
            inverse,
            variance,
            np.where(enough, np.where(distinct, condition, np.inf), np.nan),
            np.where(possible[:, np.newaxis, np.newaxis], -residual, np.nan),
            -self.start,
            left_out,
            self.weight > 0,
            status,
            np.where(enough, np.argmax(np.abs(vectors[:, -1]), axis=-1), -1),
        )

    def variance(self, residual: Floats, loss: int, equations: Integers) -> Floats:
        """Return the factor of (J^T W J)^-1 in the covariance; NaN without degrees of freedom.

        W does not include the weights from the loss function.
        """
        squares, counted = self.squares(np.arange(len(residual)), residual), self.weight > 0
        _, slope, along = bend(squares, loss)
        influence = self.square_scale * np.sum(np.where(counted, slope**2 * squares, 0.0), axis=1)
        stiffness = np.where(counted, (slope, along)[2 - self.coordinates :], 0.0)
        mean = np.sum(stiffness, axis=(0, 2)) / equations
        spread = np.sum(stiffness**2, axis=(0, 2)) / equations - mean * mean
        correction = 1.0 + self.parameters / equations * spread / (mean * mean)
        variance = correction**2 * influence / (equations - self.parameters) / (mean * mean)
        return np.where((equations > self.parameters) & (mean > 0), variance, np.nan)

    def left_out(
        self, some: NDArray[np.int64], errors: Floats, residual: Floats, rows: Floats, shares: Floats, loss: int
    ) -> Floats:
        """Return leave-one-out residuals, approximated by one Newton step.

        Let A = J H^-1 J^T, where J is the Jacobian and H the second derivative of the cost. The influence w rho' r of
        the omitted observation depends on its residual r. Let D be the derivative of the influence with respect to r.
        The eigenvalues of D are w rho' perpendicular to r, and w (rho' + 2 u rho'') along r. The leave-one-out residual
        is r + A (I - D A)^-1 w rho' r. For the squared loss, the residual is (I - w A)^-1 r.
        """
        r, j, weight, identity = -residual[some], rows[some], self.weight[some], np.eye(self.coordinates)
        half = shares[some]
        if loss != SQUARED:
            gradient, _ = self.system(some, residual[some], j, loss)
            values, vectors = np.linalg.eigh(self.curvature(some, errors[some], gradient, loss, 1e-6))
            values = np.abs(values)
            half = vectors / np.sqrt(np.maximum(values, 1e-12 * values.max(axis=1, keepdims=True)))[:, np.newaxis, :]
        half = j @ half[:, np.newaxis]
        square = np.sum(r**2, axis=-1)
        _, slope, stiff = bend(weight * square / self.square_scale, loss)
        share, turn = weight * slope, np.where(square > 0, weight * (stiff - slope) / square, 0.0)
        own = share[..., np.newaxis, np.newaxis] * identity
        own = own + turn[..., np.newaxis, np.newaxis] * r[..., :, np.newaxis] * r[..., np.newaxis, :]
        a = half @ half.swapaxes(-1, -2)
        system = identity - own @ a
        # If the determinant is near zero, only this observation determines one direction of the errors.
        larger = np.max(np.diagonal(system, axis1=-2, axis2=-1), axis=-1)
        known = (larger > 1e-9) & (np.linalg.det(system) > 1e-9 * larger)
        system = np.where(known[..., np.newaxis, np.newaxis], system, identity)
        moved = (a @ np.linalg.solve(system, (share[..., np.newaxis] * r)[..., np.newaxis]))[..., 0]
        return np.where(known[..., np.newaxis], r + moved, np.nan)


def bend(square: Floats, loss: int) -> tuple[Floats, Floats, Floats]:
    """Return the loss rho, the weight rho', and the stiffness rho' + 2 u rho'' along a residual, at u = `square`."""
    if loss == SQUARED:
        return square, np.ones_like(square), np.ones_like(square)
    if loss == CAUCHY:
        return np.log1p(square), 1.0 / (1.0 + square), (1.0 - square) / (1.0 + square) ** 2
    near, root = square <= 1.0, np.sqrt(square)
    return np.where(near, square, 2.0 * root - 1.0), np.where(near, 1.0, 1.0 / root), np.where(near, 1.0, 0.0)


@kernel
def predict(
    frames: Floats,
    to_target: Floats,
    face: Floats,
    offsets: Floats,
    errors: Floats,
    seen: Floats,
    rows: Floats,
    sines: Floats,
) -> None:
    """Write derivatives with respect to six errors, and predicted minus measured observations, to `rows`.

    `rows` has shape (N, M, D, 7), and undefined values are NaN. `seen` contains the direction to the sun, and the
    cosines and sines of the encoder angles. For a spot, `seen` also contains y and z. For a crossing, `seen` also
    contains the position, the direction of the array and the trace.
    """
    for i in range(len(rows)):
        f, x, d = frames[i], errors[i], to_target[i]
        frame = (f[0, 0], f[0, 1], f[0, 2]), (f[1, 0], f[1, 1], f[1, 2]), (f[2, 0], f[2, 1], f[2, 2])
        mount = mount_of(
            six(x),
            frame,
            (d[0], d[1], d[2]),
            (offsets[0], offsets[1], offsets[2]),
        )
        tilts = tilt_axes(x[2], x[3])
        out, side, up = (
            times(mount.matrix, (face[0, 0], face[0, 1], face[0, 2])),
            times(mount.matrix, (face[1, 0], face[1, 1], face[1, 2])),
            times(mount.matrix, (face[2, 0], face[2, 1], face[2, 2])),
        )
        for k in range(rows.shape[1]):
            o = seen[i, k]
            s = times(mount.matrix, (o[0], o[1], o[2]))
            mirror = mirror_at(mount, (o[3], o[5]), (o[4], o[6]))
            p, n = minus(mirror.arm, mount.target), mirror.normal
            if rows.shape[2] == 2:
                lit, before = dot(s, n), dot(out, p)
                ray = mixed(2.0 * lit, n, -1.0, s)
                ahead = dot(out, ray)
                length = -before / ahead
                real = lit > 0.0 and before > 0.0 and ahead < 0.0 and o[2] > 0.0  # False for NaN
                spot = mixed(1.0, p, length, ray)
                for m in range(2):
                    axis = side if m == 0 else up
                    u = mixed(1.0, axis, -dot(axis, ray) / ahead, out)
                    v = scaled(2.0 * length, mixed(dot(u, n), s, lit, u))
                    _derive(mount, mirror, tilts, cross(n, v), u, rows[i, k, m])
                    rows[i, k, m, 6] = dot(axis, spot) - o[7 + m] if real else math.nan
            else:
                axis = mirror.right if o[13] == TRACE_ELEVATION else cross(mirror.right, n)
                v = minus(times(mount.matrix, (o[7], o[8], o[9])), p)
                along, square = times(mount.matrix, (o[10], o[11], o[12])), dot(v, v)
                distance, lean = math.sqrt(square), dot(axis, v)
                middle = mixed(1.0, s, 1.0, unit(v))
                sine = dot(axis, along) - lean * dot(v, along) / square
                slope = -sine / distance  # F / slope is the predicted minus measured position
                by_centre = scaled(-1.0 / (distance * slope), mixed(1.0, axis, -lean / square, v))
                _derive(mount, mirror, tilts, scaled(1.0 / slope, cross(axis, middle)), by_centre, rows[i, k, 0])
                rows[i, k, 0, 6], sines[i, k] = dot(axis, middle) / slope, sine


@inline
def _derive(mount, mirror, tilts, swing, by_centre, row):
    """Store the derivatives of a coordinate with respect to the six errors in `row`."""
    lever = mixed(1.0, mirror.arm, 1.0, mount.pole)
    by_lever = mixed(1.0, cross(lever, by_centre), 1.0, swing)
    by_bore = mixed(1.0, cross(mirror.bore, by_centre), 1.0, swing)
    row[0] = -cross(mirror.arm, by_centre)[2] - swing[2]
    row[1] = dot(mirror.secondary, by_bore)
    row[2], row[3] = dot(tilts[0], by_lever), dot(tilts[1], by_lever)
    row[4] = dot(mirror.askew, by_bore)
    row[5] = -dot(cross(mirror.right, mirror.normal), swing)
