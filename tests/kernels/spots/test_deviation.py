"""Deviation curves: spots of mirrors with an error of one axis."""

import numpy as np

from heliosweep.kernels.mounts import (
    AZIMUTH_ELEVATION,
    BEHIND_FACE,
    MISSES,
    NO_SUN,
    POLAR,
    REACHES,
    TARGET_ALIGNED,
    TILT_ROLL,
    TOO_NEAR,
)
from heliosweep.kernels.spots import AZIMUTH, CANTING, ELEVATION, ENCODER, ENCODER_AZIMUTH, TILT
from heliosweep.kernels.sun import solar_clock
from tests.kernels.spots.deviations import LATITUDE, deviation_spots, setting, unit

SOURCES = {"canting": CANTING, "encoder": ENCODER, "tilt": TILT}
KINDS = [AZIMUTH_ELEVATION, TARGET_ALIGNED, POLAR, TILT_ROLL]
PIVOT = np.array([[[-16.0, 150.0, 0.0]]])
MORNING = solar_clock(LATITUDE, np.radians(23.45), np.array([8.0]))[np.newaxis]


def field(rng, count):
    """Pivots north of the tower, and sun vectors at all heights above 0.1."""
    pivots = np.column_stack([rng.uniform(-200, 200, count), rng.uniform(40, 500, count), rng.uniform(0, 9, count)])
    sun = unit(np.column_stack([rng.normal(size=count), rng.normal(size=count), rng.uniform(0.2, 2.0, count)]))
    return pivots[np.newaxis], sun[np.newaxis]


def test_signs():
    """Elevation raises the beam; azimuth turns the normal clockwise, the beam to the right for someone in the field."""
    noon = solar_clock(LATITUDE, 0.0, np.array([12.0]))[np.newaxis]
    north = np.array([[[0.0, 200.0, 0.0]]])
    for source in SOURCES.values():
        up = deviation_spots(setting(), [source], [ELEVATION], [1e-3], noon, north)[:2, 0, 0, 0]
        assert up[1] > 0.1
        assert abs(up[0]) < 1e-10
        for axis in (AZIMUTH, ENCODER_AZIMUTH):
            across = deviation_spots(setting(), [source], [axis], [1e-3], noon, north)[:2, 0, 0, 0]
            assert across[0] > 0.1


def status(pivot=PIVOT[0, 0], sun=MORNING[0, 0], size=0.0, **values):
    spot = deviation_spots(setting(**values), [ENCODER], [ELEVATION], [size], [[sun]], [[pivot]]).ravel()
    assert np.isnan(spot[0]) == np.isnan(spot[1]) == (spot[2] != REACHES)
    return spot[2]


def test_bad_places_and_suns_are_flagged():
    assert status() == REACHES
    assert status(pivot=[30.0, 0.0, 0.0]) == BEHIND_FACE  # on the plane of the receiver
    assert status(pivot=[30.0, 0.0, 0.0], mirror_offset=0.5) == BEHIND_FACE  # the mirror alone is before it
    assert status(pivot=[30.0, -100.0, 0.0]) == BEHIND_FACE
    assert status(pivot=[30.0, 100.0, 0.0], face_azimuth=np.pi) == BEHIND_FACE
    assert status(mirror_offset=500.0) == TOO_NEAR
    assert status(pivot=[0.0, 0.0, 143.0]) == TOO_NEAR
    assert status(sun=MORNING[0, 0] * [1.0, 1.0, -1.0]) == NO_SUN
    assert status(sun=[1.0, 0.0, 0.0]) == NO_SUN
    for sun in ([np.nan, 0.0, 1.0], [0.0, np.nan, 1.0], [0.0, 0.0, np.nan]):
        assert status(sun=sun) == NO_SUN
    assert status(pivot=[np.nan, 100.0, 0.0]) != REACHES
    assert status(size=1.4) == MISSES
    assert status(size=np.nan) != REACHES
    opposite = -unit(np.array([0.0, -150.0, -43.0]))
    assert status(pivot=[0.0, 150.0, 186.0], sun=opposite) == MISSES  # no normal at all
