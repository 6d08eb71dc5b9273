"""Packets of similar sun directions."""

import numpy as np
import pytest

from heliosweep.kernels.packets import PACKET, packet_order
from heliosweep.kernels.sun import declination_cooper, solar_clock
from tests.kernels.fields import suns


@pytest.mark.parametrize("count", [0, 1, 63, 64, 65, 128, 1000, 4097])
def test_a_permutation(count):
    order = packet_order(suns(np.random.default_rng(0), count))
    np.testing.assert_array_equal(np.sort(order), np.arange(count))


def test_packets_are_compact():
    day, hour = np.meshgrid(np.arange(1, 366), np.linspace(8.0, 16.0, 41), indexing="ij")
    sun = solar_clock(0.5, declination_cooper(day.ravel()), hour.ravel())
    order = packet_order(sun)
    angles = []
    for first in range(0, len(sun), PACKET):
        packet = sun[order[first : first + PACKET]]
        axis = packet.sum(axis=0) / np.linalg.norm(packet.sum(axis=0))
        angles.append(np.degrees(np.arccos(np.min(packet @ axis))))
    assert np.mean(angles) < 6.0


def test_equal_directions_are_ordered_by_index():
    sun = np.repeat(suns(np.random.default_rng(0), 1), 1000, axis=0)
    np.testing.assert_array_equal(packet_order(sun), np.arange(1000))
