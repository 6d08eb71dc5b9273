"""Sun shapes against integrals of their brightness."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from heliosweep.kernels import sunshapes


def aureole(parameter: float) -> float:
    """Part of the light beyond the disc, of Buie's formula, angles in mrad."""
    k = 0.9 * math.log(13.5 * parameter) * parameter**-0.3
    g = 2.2 * math.log(0.52 * parameter) * parameter**0.43 - 0.1
    disc = quad(lambda r: r * math.cos(0.326 * r) / math.cos(0.308 * r), 0.0, 4.65)[0]
    beyond = quad(lambda r: math.exp(k) * r ** (g + 1.0), 4.65, 43.6)[0]
    return beyond / (disc + beyond)


@pytest.mark.parametrize("ratio", [0.001, 0.02, 0.05, 0.3, 0.8])
def test_the_circumsolar_ratio_is_the_one_asked_for(ratio):
    parameter = brentq(lambda x: aureole(x) - ratio, 1e-3, 0.99, xtol=1e-12)
    made, wanted = sunshapes.buie(ratio), sunshapes.buie_formula(parameter)
    assert np.sum(made.share[made.radius > sunshapes.DISC]) == pytest.approx(ratio, rel=1e-6)
    assert made.spread == pytest.approx(wanted.spread, rel=1e-5)


def test_a_table_is_straight_between_its_rows():
    angle, brightness = np.array([0.0, 2e-3, 4e-3, 30e-3]), np.array([5.0, 4.0, 0.2, 0.0])
    made = sunshapes.table(angle, brightness)

    def moment(power: int) -> float:
        each = itertools.pairwise(angle)
        return sum(quad(lambda r: r**power * np.interp(r, angle, brightness), *ends)[0] for ends in each)

    assert made.spread == pytest.approx(moment(3) / moment(1) / 2, rel=1e-12)
    assert np.sum(made.share) == pytest.approx(1.0, rel=1e-12)
    assert np.sum(made.share[made.radius < 4e-3]) == pytest.approx(
        quad(lambda r: r * np.interp(r, angle, brightness), 0, 4e-3, points=[2e-3])[0] / moment(1), rel=1e-9
    )
