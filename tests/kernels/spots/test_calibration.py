"""Calibration against an independent model of the mount, SciPy's least squares and Monte Carlo."""

from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares, root
from scipy.stats import t as student

from heliosweep.kernels.calibration import CAUCHY, ESTIMATED, HUBER, INDISTINCT, SQUARED, Mounts, Observed, fit
from tests.families.misalignment.mount_twin import Twin, solar_vector
from tests.kernels.mounts.normals import normal_and_centre

TRUE = np.array([1.5, -0.8, 0.9, -1.2, 0.6, -0.7]) * 1e-3
#: Equinox and solstices.
DAYS = (81, 172, 355)
HOURS = (8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 16.0)
NEAR = Twin((-16.0, 150.0, 0.0), 143.0, offsets=(0.5, 0.0, 0.0))


@cache
def aimed(twin, days, hours):
    """Suns of hours of days, and the angles that a mount without errors is sent to."""
    suns = [solar_vector(37.4, day, hour) for day in days for hour in hours]
    high = [sun for sun in suns if sun[2] > 0.02]
    return np.array(high), np.array([twin.aim(sun) for sun in high])


class Case:
    """Spots of one heliostat with known errors, again and again with other noise."""

    def __init__(self, twin=NEAR, days=DAYS, hours=HOURS, true=TRUE, noise=0.0, seeds=1):
        self.twin, (self.suns, self.angles) = twin, aimed(twin, days, hours)
        clean = self.predict(true)
        rng = np.random.default_rng(1)
        self.count, self.seeds = len(clean), seeds
        self.position = clean + noise * rng.standard_normal((seeds, *clean.shape))
        self.weight = np.ones((seeds, self.count))

    def predict(self, errors):
        """Spots for errors of shape (..., 6), by the independent model."""
        twin, each = self.twin, np.asarray(errors)[..., np.newaxis, :]
        normal, centre = normal_and_centre(twin.frame, self.angles, each, twin.offsets)
        return twin.spots(normal, np.array(twin.pivot) + centre, self.suns)[0]

    def spots(self):
        sun, angles = (np.broadcast_to(array, (self.seeds, *array.shape)) for array in (self.suns, self.angles))
        return Observed(sun, angles, self.position, self.weight)

    def calibrate(self, spots=None, **options):
        spots, twin = spots or self.spots(), self.twin
        frames, ways = (
            np.broadcast_to(each, (len(spots.weight), *each.shape)) for each in (twin.frame, twin.target - twin.pivot)
        )
        return fit(Mounts(frames, ways, twin.axes, np.array(twin.offsets)), spots, **options)


def truth(parameters):
    """Errors of which only those that are sought are not zero."""
    return np.where(np.arange(6) < parameters, TRUE, 0.0)


@pytest.mark.parametrize(("days", "condition"), [((81,), 1700), ((81, 172), 378), ((81, 172, 355), 185)])
def test_condition_numbers_of_one_two_and_three_days(days, condition):
    # Heliostat 16 m west and 150 m north of the tower, 143 m below the aim point; every hour from 8 to 16.
    found = Case(days=days).calibrate(parameters=6)
    assert found.condition[0] == pytest.approx(condition, abs=1)
    assert found.status[0] == (INDISTINCT if condition > 1000 else ESTIMATED)
    assert found.least_known[0] == 5  # collimation
    np.testing.assert_allclose(found.estimate[0], TRUE, rtol=0, atol=1e-12)  # 1e-9 mrad, however ill-conditioned
    four = Case(days=days, true=truth(4)).calibrate(parameters=4)
    assert four.condition[0] < 10


class Cost:
    """The cost of one heliostat for SciPy: pairs of residuals whose squares add up to it. Errors in mrad."""

    def __init__(self, case, parameters, loss=SQUARED, scale=1.0, root=1.0):
        self.case, self.parameters, self.loss, self.scale, self.root = case, parameters, loss, scale, root

    def raw(self, errors):
        full = np.zeros((*np.shape(errors)[:-1], 6))
        full[..., : self.parameters] = np.asarray(errors) * 1e-3
        return (self.case.predict(full) - self.case.position[0]) * np.reshape(self.root, (-1, 1))

    def __call__(self, errors):
        residuals = self.raw(errors)
        square = np.sum(residuals**2, axis=-1, keepdims=True) / self.scale**2
        value = {
            SQUARED: square,
            HUBER: np.where(square <= 1, square, 2 * np.sqrt(np.maximum(square, 1)) - 1),
            CAUCHY: np.log1p(square),
        }[self.loss]
        return (residuals * np.sqrt(value / square)).reshape(*residuals.shape[:-2], -1)

    def slope(self, errors):
        """Derivative of the cost, from residuals by differences of fourth order."""
        step = 0.2
        displaced = errors + step * np.multiply.outer([-2.0, -1.0, 1.0, 2.0], np.eye(self.parameters))
        change = np.tensordot(np.array([1.0, -8.0, 8.0, -1.0]) / (12 * step), self.raw(displaced), axes=1)
        residuals = self.raw(errors)
        square = np.sum(residuals**2, axis=-1, keepdims=True) / self.scale**2
        share = {
            SQUARED: np.ones_like(square),
            HUBER: np.where(square <= 1, 1.0, 1 / np.sqrt(square)),
            CAUCHY: 1 / (1 + square),
        }[self.loss]
        return np.sum(change * (share * residuals), axis=(1, 2))

    def solved(self, start):
        """SciPy's solution [rad]; where the costs of steps are all rounding, by the root of the slope."""
        near = least_squares(self, start, jac="3-point", method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        exact = root(self.slope, near, tol=1e-15).x
        np.testing.assert_allclose(exact, near, rtol=0, atol=1e-4)
        return exact * 1e-3


@pytest.mark.parametrize("parameters", [2, 4, 6])
def test_least_squares_equals_scipy(parameters):
    case = Case(hours=HOURS[::2], true=truth(parameters), noise=0.03)
    case.weight[:] = np.linspace(0.5, 2.0, case.count)
    found = case.calibrate(parameters=parameters)
    theirs = Cost(case, parameters, root=np.sqrt(case.weight[0])).solved(np.zeros(parameters))
    np.testing.assert_allclose(found.estimate[0, :parameters], theirs, rtol=0, atol=1e-12)


@pytest.mark.parametrize("loss", [HUBER, CAUCHY])
@pytest.mark.parametrize("parameters", [4, 6])
def test_robust_losses_equal_scipy(loss, parameters):
    case = Case(hours=HOURS[::2], true=truth(parameters), noise=0.03)
    case.position[0, ::9] += [1.5, -0.7]
    found = case.calibrate(parameters=parameters, loss=loss, loss_scale=0.08)
    theirs = Cost(case, parameters, loss, 0.08).solved(0.9e3 * found.estimate[0, :parameters])
    np.testing.assert_allclose(found.estimate[0, :parameters], theirs, rtol=0, atol=1e-12)


LONG = ((SQUARED, 4), (HUBER, 6), (CAUCHY, 4), (CAUCHY, 6))


@pytest.mark.parametrize(
    ("loss", "parameters"), [(SQUARED, 6), (HUBER, 4), *(pytest.param(*one, marks=pytest.mark.long) for one in LONG)]
)
def test_intervals_cover_the_truth_and_the_covariance_is_that_of_the_draws(loss, parameters):
    case = Case(true=truth(parameters), noise=0.02, seeds=1000)
    found = case.calibrate(parameters=parameters, loss=loss, loss_scale=0.05)
    assert (found.status == ESTIMATED).all()
    estimate, covariance = found.estimate[:, :parameters], found.covariance[:, :parameters, :parameters]
    error = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    most = student.ppf(0.975, 2 * case.count - parameters) * error
    covered = (np.abs(estimate - TRUE[:parameters]) <= most).mean(axis=0)
    assert ((covered >= 0.93) & (covered <= 0.97)).all()
    # 1,000 draws know a standard deviation to 2.2 %; correlations are far better known.
    drawn, stated = np.cov(estimate.T), covariance.mean(axis=0)
    np.testing.assert_allclose(np.sqrt(np.diag(drawn)), np.sqrt(np.diag(stated)), rtol=0.07)
    widths = np.sqrt(np.diag(stated))
    np.testing.assert_allclose(drawn / np.outer(widths, widths), stated / np.outer(widths, widths), rtol=0, atol=0.15)


@pytest.mark.parametrize("loss", [SQUARED, HUBER, CAUCHY])
def test_leave_one_out_of_every_spot_and_loss(loss):
    case = Case(true=truth(4), noise=0.03)
    case.position[0, ::9] += [0.3, -0.2]
    found = case.calibrate(loss=loss, loss_scale=0.08)
    for spot in range(case.count):
        case.weight[:] = 1.0
        case.weight[0, spot] = 0.0
        without = case.calibrate(loss=loss, loss_scale=0.08)
        assert without.used[0] == case.count - 1
        assert np.array_equal(without.left_out[0, spot], without.residual[0, spot])
        moved = without.residual[0, spot] - found.residual[0, spot]
        ours = found.left_out[0, spot] - found.residual[0, spot]
        tolerance = 0.02 if loss == SQUARED else 0.25
        assert np.hypot(*(ours - moved)) <= tolerance * np.hypot(*moved) + 1e-4
