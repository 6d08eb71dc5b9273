"""The candidate search never drops a heliostat that could matter, and drops nearly all others."""

import numpy as np
import pytest

from heliosweep.kernels.field.efficiency import aimed
from heliosweep.kernels.field.neighbours import beam, bin_field, search
from tests.kernels.field.fields import scattered, suns


def found(i, bundle, limit, mirrors, grid):
    names, count = search(i, bundle, limit, mirrors, grid, np.empty(1, np.int64), 0)
    return names[:count]


@pytest.mark.parametrize("spread", [0.0, 0.05, 0.6, 3.0])
@pytest.mark.parametrize("low", [-80.0, 0.05, 20.0, 80.0])
def test_every_heliostat_in_reach_is_found(spread, low):
    rng = np.random.default_rng(1)
    x, y, z, width, height, target = scattered(rng, 150, 9.0)
    z *= 3.0  # hills
    mirrors = aimed(x, y, z, width, height, target)
    grid = bin_field(mirrors)
    centres = np.stack((x, y, z), axis=1)
    kept = 0
    for axis in suns(rng, 12, low, low + 10.0):
        d = axis + spread * rng.uniform(-0.5, 0.5, (20, 3))
        d /= np.linalg.norm(d, axis=1)[:, None]
        if low > 0.0:
            d = d[d[:, 2] > 0.0]
        bundle = beam(d.T.ravel(), len(d), len(d))
        for i in range(0, 150, 10):
            offset = centres - centres[i]
            reach = mirrors.radius + mirrors.radius[i]
            ahead = offset @ d.T
            across = np.linalg.norm(offset[:, None] - ahead[:, :, None] * d, axis=2)
            near = np.linalg.norm(offset, axis=1) <= reach
            needed = np.any((across < reach[:, None]) & ((ahead > 0.0) | near[:, None]), axis=1)
            needed[i] = False
            names = found(i, bundle, np.inf, mirrors, grid)
            assert set(np.flatnonzero(needed)) <= set(names)
            assert len(names) == len(set(names))
            kept += len(names)
            if spread == 0.0:
                assert len(names) <= needed.sum() + 1
    assert kept > 0


def test_blockers_stand_before_the_target():
    x, y, z = np.array([0.0, 0.0, 0.0]), np.array([30.0, 10.0, -20.0]), np.full(3, 5.0)
    side = np.full(3, 4.0)
    mirrors = aimed(x, y, z, side, side, 6.0)
    grid = bin_field(mirrors)
    assert list(found(0, beam(mirrors.aim[0], 1, 1), mirrors.throw[0], mirrors, grid)) == [1]


def test_order_does_not_depend_on_the_bundle():
    rng = np.random.default_rng(2)
    mirrors = aimed(*scattered(rng, 100, 9.0))
    grid = bin_field(mirrors)
    everywhere = beam(np.array([1.0, -1.0, 0.0, 0.0, 1e-6, 1e-6]), 2, 2)
    for i in range(0, 100, 9):
        order = found(i, everywhere, np.inf, mirrors, grid)
        assert sorted([*order, i]) == list(range(100))
        rank = np.argsort([*order, i])
        for d in suns(rng, 20, 1.0, 80.0):
            names = found(i, beam(d, 1, 1), np.inf, mirrors, grid)
            assert np.all(np.diff(rank[names]) > 0)


def test_what_is_near_comes_first():
    x, side = np.arange(-9.0, 10.0) * 20.0, np.full(19, 4.0)
    for east, north in ((x, np.full(19, 50.0)), (np.full(19, 50.0), x)):
        mirrors = aimed(east, north, np.full(19, 5.0), side, side, 60.0)
        for sign in (-1.0, 1.0):
            d = sign * np.array([east[1] - east[0], north[1] - north[0], 0.0]) / 20.0
            d[2] = 0.01
            ahead = 9 + int(sign) * np.arange(1, 10)
            assert list(found(9, beam(d / np.linalg.norm(d), 1, 1), np.inf, mirrors, bin_field(mirrors))) == list(ahead)


def test_bins_hold_every_heliostat_once():
    rng = np.random.default_rng(3)
    for count in (1, 2, 37, 500):
        grid = bin_field(aimed(*scattered(rng, count, 9.0)))
        assert sorted(grid.names) == list(range(count))
        assert grid.first[0] == 0
        assert grid.first[-1] == count
        assert len(grid.first) <= 8 * count + 16
