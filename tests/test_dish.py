"""Dishes without a study: labels, types, errors, and values of the closed form."""

import numpy as np
import pytest
import xarray as xr

import heliosweep

SUN = [0.0, 60.0, 180.0, 250.0], [70.0, 20.0, 45.0, 5.0]


def test_results_have_the_type_and_labels_of_the_arguments():
    azimuth = xr.DataArray(SUN[0], {"hour": [6, 8, 12, 16]}, ("hour",))
    tilt = xr.DataArray([0.0, 0.1], {"tilt": [0.0, 0.1]}, ("tilt",))
    error = heliosweep.tracking_error(azimuth, SUN[1], tilt)
    assert error.dims == ("tilt", "hour")
    assert error.hour.values.tolist() == [6, 8, 12, 16]
    assert error.attrs["units"] == "mrad"
    assert heliosweep.tracking_error(azimuth, SUN[1], 0.1).dims == ("hour",)
    np.testing.assert_array_equal(error.isel(tilt=1), heliosweep.tracking_error(*SUN, 0.1))
    assert isinstance(heliosweep.tracking_error(180.0, 45.0, 0.1), float)
    factor = heliosweep.tracking_factor(azimuth, SUN[1], tilt, tolerance=4.0)
    xr.testing.assert_allclose(factor, 1.0 - error.mean("hour") / 4.0)
    assert factor.sel(tilt=0.0) == 1.0


def test_clipped_errors_count_at_most_the_tolerance():
    error = heliosweep.tracking_error(*SUN, 0.3)
    clipped = heliosweep.tracking_factor(*SUN, 0.3, tolerance=2.0, clip=True)
    assert clipped == pytest.approx(1.0 - np.minimum(error, 2.0).mean() / 2.0, abs=1e-14)


def test_tolerable_tilt_gives_the_required_factor():
    required = xr.DataArray([0.5, 0.9], dims="required")
    tilt = heliosweep.tolerable_tilt(*SUN, required, 40.0, home_elevation_offset=0.01)
    factor = heliosweep.tracking_factor(*SUN, tilt, 40.0, home_elevation_offset=0.01)
    np.testing.assert_allclose(factor, required, rtol=0, atol=1e-12)
    assert heliosweep.tolerable_tilt(*SUN, 0.9, home_azimuth_offset=1.0) == 0.0


DISH = {"focal_length": 6.0, "diameter": 10.0, "aperture_radius": 0.08, "spread": 4.0}


@pytest.mark.parametrize("spread", [0.1, 0.5, 2.0, 20.0])
@pytest.mark.parametrize(("focal_length", "aperture"), [(6.0, 0.08), (3.0, 0.05)])
def test_the_intercept_of_a_dish_is_an_independent_integral(spread, focal_length, aperture):
    """An elliptic Gaussian over a circle for each point of the mirror, by Gauss-Legendre panels."""
    from scipy.special import ndtr

    errors = np.array([0.0, 0.5, 0.9, 1.0, 1.05]) * 1e3 * aperture / focal_length
    nodes, weights = np.polynomial.legendre.leggauss(8)

    def panels(low, high, count):
        edges = np.linspace(low, high, count + 1, axis=-1)[..., np.newaxis]
        half = 0.5 * np.diff(edges, axis=-2)
        at, by = edges[..., :-1, :] + half * (1.0 + nodes), half * weights
        return at.reshape(*at.shape[:-2], -1), by.reshape(*by.shape[:-2], -1)

    few = 3 if spread > 1.0 else 10
    (areas, by_area), (angles, by_angle) = panels(0.0, 1.0, few), panels(0.0, 0.5 * np.pi, few)
    theta = 2.0 * np.arctan(1.25 * np.sqrt(areas) / focal_length)
    along = 2.0 * focal_length / (1.0 + np.cos(theta))
    across, found = along / np.cos(theta), []
    for error in 1e-3 * errors:
        total = 0.0
        for one, other, weight in zip(across, along, by_area, strict=True):
            x0, y0 = error * one * np.cos(angles)[:, np.newaxis], error * other * np.sin(angles)[:, np.newaxis]
            sides = 1e-3 * spread * one, 1e-3 * spread * other
            ends = (np.clip(x0[:, 0] / aperture + sign * 7.0 * sides[0] / aperture, -1.0, 1.0) for sign in (-1, 1))
            low, high = map(np.arcsin, ends)
            turn, by_x = panels(low, high, 8)
            x, half, by_x = aperture * np.sin(turn), aperture * np.cos(turn), by_x * aperture * np.cos(turn)
            inside = ndtr((half - y0) / sides[1]) - ndtr((-half - y0) / sides[1])
            light = np.exp(-0.5 * ((x - x0) / sides[0]) ** 2) / (np.sqrt(2.0 * np.pi) * sides[0]) * inside * by_x
            total += weight * float(np.sum(light.sum(axis=1) * by_angle)) / (0.5 * np.pi)
        found.append(total)
    dish = {"focal_length": focal_length, "diameter": 5.0, "aperture_radius": aperture, "spread": spread}
    np.testing.assert_allclose(heliosweep.dish_intercept(errors, **dish), found, atol=1e-5)


def test_a_shallow_dish_has_the_closed_form_of_a_displaced_gaussian():
    """Marcum's Q: the light of all mirror points is one round Gaussian, of the focal length times the spread."""
    from scipy.stats import ncx2

    error = np.array([0.0, 1.0, 2.0, 4.0])
    found = heliosweep.dish_intercept(error, focal_length=50.0, diameter=0.1, aperture_radius=0.1, spread=1.0)
    np.testing.assert_allclose(found, ncx2.cdf(2.0**2, 2, np.maximum(error, 1e-9) ** 2), atol=2e-5)


def test_a_dish_without_light_changes_no_other_of_the_array():
    found = heliosweep.dish_intercept([4.0, 1000.0, np.nan], **DISH)
    assert found[0] == pytest.approx(heliosweep.dish_intercept(4.0, **DISH), abs=2e-5)
    assert found[1] == pytest.approx(0.0, abs=1e-12)
    assert np.isnan(found[2])


def test_the_intercept_of_a_dish_has_the_labels_of_the_error():
    error = xr.DataArray([[0.0, 2.0]], {"hour": [8, 9]}, ("mount", "hour"))
    found = heliosweep.dish_intercept(error, **DISH)
    assert found.dims == ("mount", "hour")
    assert found.units == "1"
    assert isinstance(heliosweep.dish_intercept(2.0, **DISH), float)
