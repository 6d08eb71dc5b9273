"""Spots of mounts with errors: against the chain of rotations, by theory, and packed in every way."""

import numpy as np

from heliosweep.kernels.mounts import AZIMUTH_ELEVATION, BLIND_CONE, REACHES, TARGET_ALIGNED
from heliosweep.kernels.spots import mount_spots
from heliosweep.kernels.sun import solar_clock
from tests.kernels.spots import deviations


def setting(kinds=(AZIMUTH_ELEVATION,), offset=0.5, axis_offset=0.3, pedestal=4.0, face=(0.1, -0.2)):
    """One parameter combination for each kind of mount."""
    return deviations.setting(
        len(kinds), kind=kinds, half_width=2.0, half_height=1.5, latitude=0.65, axis_azimuth=0.3, mirror_offset=offset,
        axis_offset=axis_offset, pedestal_height=pedestal, face_azimuth=face[0], face_tilt=face[1],
    )  # fmt: skip


def test_against_numbers_of_the_reference():
    """An elevation reference error is the paper's elevation error (latitude 37.4, declination 23.45 deg, hour 8)."""
    sun = solar_clock(np.radians(37.4), np.radians(23.45), np.array(8.0)).reshape(1, 1, 3)
    place, error = np.array([[[-16.0, 150.0, 0.0]]]), np.zeros((1, 1, 6))
    error[..., 1] = 12e-3
    for offset, expected in ((0.0, (2.5311936204, 4.5868508447)), (0.5, (2.5288478833, 4.5825571973))):
        one = setting(offset=offset, axis_offset=0.0, pedestal=0.0, face=(0.0, 0.0))
        spots = mount_spots(one, error, np.zeros((1, 1, 6)), sun, place)
        np.testing.assert_allclose(spots[:2].ravel(), expected, atol=1e-9, rtol=0)
    error[..., 1], error[..., 0] = 0.0, 12e-3
    one = setting(offset=0.0, axis_offset=0.0, pedestal=0.0, face=(0.0, 0.0))
    spots = mount_spots(one, error, np.zeros((1, 1, 6)), sun, place)
    np.testing.assert_allclose(spots[:2].ravel(), (2.7106249805, -2.6666225745), atol=1e-9, rtol=0)


def test_blind_cone():
    """The sun stands behind the receiver, right on the primary axis, which the mount cannot reach."""
    place = np.array([[[0.0, 100.0, 43.0]]])
    sun = np.array([[[0.0, -1.0, 1.0]]]) / np.sqrt(2.0)
    known = np.array([[[0.0, 0.0, 0.0, 0.0, 1e-3, 3e-3]]])
    one = setting([TARGET_ALIGNED], axis_offset=0.0)
    spots = mount_spots(one, np.zeros((1, 1, 6)), known, sun, place)
    np.testing.assert_array_equal(spots[2], BLIND_CONE)
    assert np.isnan(spots[:2]).all()
    spots = mount_spots(one, np.zeros((1, 1, 6)), np.zeros((1, 1, 6)), sun, place)
    np.testing.assert_array_equal(spots[2], REACHES)
    assert np.max(np.abs(spots[:2])) < 1e-12
