"""Packets of similar sun directions."""

import itertools

import numpy as np
import pytest

from heliosweep.kernels.field.packets import packet_order
from heliosweep.kernels.sun import declination_cooper, solar_clock
from heliosweep.kernels.vectors import GROUP, PACKET
from tests.kernels.field.fields import suns


def over_days(days, hours):
    """Sun vectors at a latitude of 0.5 rad, day after day, with the sun up."""
    day, hour = np.meshgrid(days, hours, indexing="ij")
    sun = solar_clock(0.5, declination_cooper(day.ravel()), hour.ravel())
    return sun[sun[:, 2] > 0.0]


@pytest.mark.parametrize("low", [0.0, 3.0])
@pytest.mark.parametrize("count", [0, 1, 2, 3, 63, 64, 65, 128, 1000, 4097])
def test_a_permutation_cut_into_packets(count, low):
    order, first = packet_order(suns(np.random.default_rng(0), count, low))
    np.testing.assert_array_equal(np.sort(order), np.arange(count))
    assert (first[0], first[-1]) == (0, count)
    lanes = np.diff(first)
    assert np.all((lanes > 0) & (lanes <= PACKET))
    groups = [order[k : min(k + GROUP, b)] for a, b in itertools.pairwise(first) for k in range(a, b, GROUP)]
    assert all(np.all(np.diff(group) > 0) for group in groups)


def test_packets_are_compact():
    sun = over_days(np.arange(1, 366), np.linspace(8.0, 16.0, 41))
    order, first = packet_order(sun)
    np.testing.assert_array_equal(np.diff(first), [PACKET] * (len(sun) // PACKET) + [len(sun) % PACKET])
    angles = []
    for a, b in itertools.pairwise(first):
        packet = sun[order[a:b]]
        axis = packet.sum(axis=0) / np.linalg.norm(packet.sum(axis=0))
        angles.append(np.degrees(np.arccos(np.min(packet @ axis))))
    assert np.mean(angles) < 6.0


def test_equal_directions_are_ordered_by_index():
    sun = np.repeat(suns(np.random.default_rng(0), 1), 1000, axis=0)
    np.testing.assert_array_equal(packet_order(sun)[0], np.arange(1000))
