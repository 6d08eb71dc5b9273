"""The formula of the sun's brightness that is nearest to a profile."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray


class FormulaFit(NamedTuple):
    """The formula of Jose nearest to a table."""

    limb: float
    """A, relative to the centre of the fitted curve. [1]"""
    power: float
    """xi. [1]"""
    level: float
    """Brightness of the fitted curve at the disc centre. [1]"""
    residual: float
    """Root mean square of the table less the curve. [1]"""


def formula_fit(brightness: ArrayLike) -> FormulaFit:
    """The generalised formula of Jose nearest to a profile, in the sense of least squares.

    `brightness` is at equal steps from the centre to the edge of the disc, eps_max, shape (n,), n > 3. For an exponent
    xi the formula is a line in sqrt(1 - u^xi); the best xi between 0.5 and 10 is searched for.
    """
    from scipy.optimize import minimize_scalar

    table = np.asarray(brightness, np.float64)
    u = np.linspace(0.0, 1.0, len(table))

    def line(power: float) -> tuple[NDArray[np.float64], float]:
        columns = np.stack((np.ones_like(u), np.sqrt(1.0 - u**power)), axis=1)
        fit = np.asarray(np.linalg.lstsq(columns, table, rcond=None)[0], np.float64)
        return fit, float(np.sum((columns @ fit - table) ** 2))

    power = float(minimize_scalar(lambda trial: line(trial)[1], bounds=(0.5, 10.0), options={"xatol": 1e-6}).x)
    (low, rise), square = line(power)
    return FormulaFit(float(low / (low + rise)), power, float(low + rise), math.sqrt(square / len(table)))
