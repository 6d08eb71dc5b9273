"""Errors of mounts from measured spots: robust least squares for many heliostats at once.

Each heliostat has a list of spots, each taken at commanded encoder angles. The errors sought are those of
`kinematics.ERRORS`, the first 2, 4 or 6 of them; they minimise

    1/2 sum_i c^2 rho(w_i |r_i|^2 / c^2),    r_i = predicted - measured spot (y, z),

the weights w_i divided by their mean, with
rho(u) = u (squared), u up to 1 and then 2 sqrt(u) - 1 (Huber), or log(1 + u) (Cauchy). The loss is of the distance
between the spots, not of each coordinate: it does not depend on how the axes of the face lie. The Jacobian is analytic;
Levenberg-Marquardt steps [1]_ on iteratively reweighted rows come from singular values, never from normal equations.
The Cauchy loss, which may have several minima, starts from the solution for the Huber loss, and all start from zero.

The covariance is that of M-estimators by Huber [2]_, section 7.6, for residuals in the plane: with the influence
psi = rho'(.) r and the eigenvalues a (across r) and b (along r) of its derivative,

    C = k^2 [sum |psi|^2 / (2 n - p)] / mean(a, b)^2 (J^T W J)^-1,    k = 1 + p / (2 n) var(a, b) / mean(a, b)^2,

which for the squared loss is the usual s^2 (J^T W J)^-1. Every heliostat is computed on its own: the bits of its
estimate do not depend on the others.

References
----------
.. [1] H. B. Nielsen, "Damping parameter in Marquardt's method", report IMM-REP-1999-05, DTU (1999)
.. [2] P. J. Huber and E. M. Ronchetti, "Robust Statistics", 2nd edition, Wiley (2009)
"""

from typing import NamedTuple

import numpy as np

from heliosweep.kernels.arrays import Floats, Integers
from heliosweep.kernels.spots.derivatives import CAUCHY, HUBER, SQUARED
from heliosweep.kernels.spots.fit import PARAMETERS, fit_all


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
    turns = np.stack([np.cos(angles), np.sin(angles)], axis=-1).reshape(total, 4)
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
    geometry = (rows.reshape(number, 9), places, axes.reshape(9), lengths)
    spots_seen = first, sun, turns, position, weight
    fit_all(*spots_seen, *geometry, parameters, loss, float(loss_scale), float(condition_limit), result)
    return result
