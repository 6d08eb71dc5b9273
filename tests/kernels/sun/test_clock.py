"""Solar clock."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from pvlib import spa

from heliosweep.kernels.sun import refracted, solar_clock

ANGLE = st.floats(-1.5, 1.5)


def test_noon_and_the_sense_of_the_day():
    south = solar_clock(np.radians(50.0), 0.0, 12.0)
    np.testing.assert_allclose(south, [0.0, -np.sin(np.radians(50.0)), np.cos(np.radians(50.0))], atol=1e-15)
    assert solar_clock(0.5, 0.1, 9.0)[0] > 0.0 > solar_clock(0.5, 0.1, 15.0)[0]


@given(ANGLE, ANGLE, st.floats(0.0, 24.0))
def test_unit_vectors_with_the_elevation_of_the_textbooks(latitude, declination, hour):
    s = solar_clock(latitude, declination, hour)
    assert abs(np.linalg.norm(s) - 1.0) < 1e-15 * 4
    angle = np.radians(15.0 * (hour - 12.0))
    sine = np.sin(latitude) * np.sin(declination) + np.cos(latitude) * np.cos(declination) * np.cos(angle)
    assert abs(s[2] - sine) < 1e-15


def test_refraction_is_that_of_spa():
    elevation = np.radians(np.concatenate([np.linspace(-3.0, 90.0, 400), [-0.8333, -0.8334]]))
    sun = np.stack([np.cos(elevation) * 0.6, np.cos(elevation) * 0.8, np.sin(elevation)], axis=-1)
    shown = refracted(sun, 90000.0, 30.0)
    degrees = np.degrees(elevation)
    expected = degrees + spa.atmospheric_refraction_correction(900.0, 30.0, degrees, 0.5667)
    np.testing.assert_allclose(
        np.degrees(np.arctan2(shown[:, 2], np.hypot(shown[:, 0], shown[:, 1]))), expected, atol=1e-6
    )
    np.testing.assert_allclose(np.linalg.norm(shown, axis=-1), 1.0, rtol=1e-14)
    below = degrees < 89.0
    np.testing.assert_allclose((shown[:, 0] / shown[:, 1])[below], 0.75, rtol=1e-12)
