"""Flux on the cells of a receiver: sums, halves, rays traced one by one, products of error functions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import erf

from heliosweep.kernels import sunshapes
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION
from heliosweep.kernels.intercept import hflcal
from heliosweep.kernels.intercept.efficiency import intercepts
from heliosweep.kernels.intercept.flux import cells, sun_nodes
from heliosweep.kernels.intercept.mirror import Errors
from heliosweep.kernels.intercept.receivers import cylinder, rectangle
from heliosweep.kernels.sun import clock
from tests.kernels.intercept.rays import traced
from tests.kernels.intercept.test_intercept import CASES, direction, oracle_case, scene

ONE = np.ones((1, 1))


def test_cells_add_up_to_the_intercept():
    """As they are integrated to 4e-5, a tenth of that in all but a few cases; scaled, to rounding."""
    differences = []
    for row in CASES:
        if row["facets"] != "none":
            continue
        made, sun = oracle_case(row)
        intercept = intercepts(made, sun)
        for columns, rows in ((1, 1), (9, 7)):
            free = cells(made, sun, ONE, None, columns, rows).sum()
            differences.append(abs(free - float(row["intercept"])))
            assert differences[-1] < 4e-5, row["case"]
            held = cells(made, sun, 3.0 * ONE, intercept, columns, rows)
            assert held.sum() == pytest.approx(3.0 * intercept[0, 0], rel=1e-12), row["case"]
            assert held.min() >= 0.0
    assert np.median(differences) < 1e-6


def test_cells_of_a_mirror_with_fixed_errors_add_up_to_its_intercept():
    """Errors of the mount and a map of slopes, in cells that are not scaled."""
    random = np.random.default_rng(3)
    made = scene(rectangle((0, 0, 60), 0.0, 0.0, 2.5, 2.0), sunshapes.pillbox(), (30.0, 90.0, 5.0), curve=1 / 200)
    made = made._replace(mounts=1e-3 * random.normal(size=(1, 6)), slopes=3e-4 * random.normal(size=(8, 8, 2)))
    suns = np.concatenate([direction(azimuth, 50.0) for azimuth in (100.0, 200.0)])
    for tracking in (SPINNING_ELEVATION, AZIMUTH_ELEVATION):
        there = made._replace(tracking=tracking)
        whole = intercepts(there, suns)[0]
        assert np.all(np.abs(whole - intercepts(there._replace(mounts=np.empty((0, 6))), suns)[0]) > 1e-3)
        found = [cells(there, one[None], ONE, None, 4, 3).sum() for one in suns]
        np.testing.assert_allclose(found, whole, atol=1e-4)


def test_cells_are_sums_of_smaller_ones_and_of_heliostats():
    places, sun = np.array([(80.0, 300.0, 5.0), (-150.0, 90.0, 5.0)]), direction(170.0, 50.0)
    for receiver in (rectangle((0, 0, 100.0), 0.1, -0.2, 5.0, 6.0), cylinder((0, 0, 100.0), 3.0, 6.0)):
        made = scene(receiver, sunshapes.buie(0.05), places, curve=1 / 600)
        sent = np.array([[2.0], [3.0]])
        small = cells(made, sun, sent, None, 12, 10)
        np.testing.assert_allclose(cells(made, sun, sent, None, 4, 5), small.reshape(5, 2, 4, 3).sum((1, 3)), atol=1e-6)
        each = [
            cells(scene(receiver, sunshapes.buie(0.05), place, curve=1 / 600), sun, sent[i : i + 1], None, 12, 10)
            for i, place in enumerate(places)
        ]
        np.testing.assert_allclose(small, sum(each), atol=1e-12)


def test_rows_are_what_receivers_of_their_height_take():
    sun, aim = direction(150.0, 40.0), (0.3, 2.9, 100.0)
    upward = np.array(rectangle((0.0, 0.0, 100.0), 0.1, -0.3, 4.0, 6.0).upward)
    middle = np.array([0.0, 0.0, 100.0])
    for make, axis in (
        (lambda at, h: rectangle(tuple(at), 0.1, -0.3, 4.0, h), upward),
        (lambda at, h: cylinder(tuple(at), 3.0, h), np.array([0.0, 0.0, 1.0])),
    ):
        found = cells(scene(make(middle, 6.0), sunshapes.pillbox(), aim=aim), sun, ONE, None, 7, 3).sum(1)
        wanted = [
            intercepts(scene(make(middle + 2.0 * k * axis, 2.0), sunshapes.pillbox(), aim=aim), sun)[0, 0]
            for k in (-1, 0, 1)
        ]
        np.testing.assert_allclose(found, wanted, atol=3e-5)


@pytest.mark.parametrize("tracking", [SPINNING_ELEVATION, AZIMUTH_ELEVATION])
@pytest.mark.parametrize("kind", ["rectangle", "cylinder"])
def test_a_histogram_of_rays(kind, tracking):
    centre, sun, slope, curve = np.array([120.0, 260.0, 4.0]), direction(230.0, 35.0), 1.8e-3, 0.5 / 310.0
    flat = kind == "rectangle"
    receiver = rectangle((0.0, 0.0, 110.0), 0.4, -0.2, 5.0, 6.0) if flat else cylinder((0, 0, 110.0), 2.5, 6.0)
    aim = np.array([0.7, -0.3, 111.0]) if flat else np.array([1.5, 2.0, 109.0])
    made = scene(receiver, sunshapes.pillbox(), centre, aim, (slope, slope, 0.4e-3), curve=curve, tracking=tracking)
    places, met = traced(made, 0, sun[0], 18)
    across = (-2.5, 2.5) if flat else (0.0, 2 * math.pi)
    counts = np.histogramdd(places[:, met].T, (10, 8), (across, (-3.0, 3.0)))[0].T / met.size
    found = cells(made, sun, ONE, None, 10, 8)
    assert counts.max() > 0.03
    apart = (found - counts) / np.sqrt(np.maximum(counts, 1e-5) / met.size)  # in standard deviations of counting
    assert np.max(np.abs(apart)) < 4.0
    assert np.mean(apart**2) < 1.4


def test_a_gaussian_sun_on_a_face_square_to_the_ray_is_a_product_of_error_functions():
    place, aim = np.array([0.0, 400.0, 0.0]), np.array([0.0, 0.0, 100.0])
    back = (aim - place) / np.linalg.norm(aim - place)
    receiver = rectangle(tuple(aim), 0.0, -math.asin(back[2]), 3.0, 5.0)
    made = scene(receiver, sunshapes.gaussian(), place, errors=(1e-3, 1e-3, 0.5e-3), sides=(1e-3, 1e-3))
    sigma = math.sqrt(2.73e-3**2 + 4 * 1e-6 + 0.25e-6) * np.linalg.norm(aim - place) * math.sqrt(2)
    across, up = (np.diff(erf(np.linspace(-half, half, n + 1) / sigma)) / 2 for half, n in ((1.5, 6), (2.5, 5)))
    np.testing.assert_allclose(cells(made, back[None], ONE, None, 6, 5), np.outer(up, across), atol=1e-6)
    plain = made._replace(errors=Errors(1e-3, 1e-3, 0.5e-3))
    quick = hflcal.cells(plain, sunshapes.gaussian().spread, back[None], ONE, np.full((1, 1), 0.5), 6, 5)
    np.testing.assert_allclose(quick, 0.5 * np.outer(up, across) / (across.sum() * up.sum()), atol=1e-6)


@pytest.mark.parametrize("columns", [1, 2, 3, 16])
def test_gaussian_cells_of_a_cylinder(columns):
    """On the side that the heliostat sees, with a sum that is the intercept."""
    made = scene(cylinder((0, 0, 100.0), 3.0, 8.0), sunshapes.pillbox(), aim=(0.8, 2.9, 101.0), curve=1 / 600)
    sun, spread, kept = direction(150.0, 40.0), sunshapes.pillbox().spread, np.full((1, 1), 0.8)
    quick = hflcal.cells(made, spread, sun, ONE, kept, columns, 4)
    assert quick.sum() == pytest.approx(0.8, rel=1e-12)
    near = 0.8 * cells(made, sun, ONE, ONE, columns, 4)
    np.testing.assert_allclose(quick.sum(0), near.sum(0), atol=5e-3)
    np.testing.assert_allclose(quick, near, atol=0.04)


def test_nothing_comes_at_night_or_from_behind():
    sun = np.concatenate((direction(180.0, 40.0), direction(180.0, -5.0)))
    made = scene(rectangle((0.0, 0.0, 100.0), math.pi, 0.0, 9.0, 9.0), sunshapes.pillbox())
    assert not cells(made, sun, np.ones((1, 2)), None, 3, 3).any()
    assert not cells(made._replace(centre=made.centre[:0]), sun, np.ones((0, 2)), None, 3, 3).any()


def test_large_cells_take_as_many_nodes_as_they_need():
    made = scene(rectangle((0.0, 0.0, 60.0), 0.0, 0.0, 40.0, 40.0), sunshapes.pillbox(), (0, 60.0, 5.0),
                 errors=(2e-4, 2e-4, 0.0), sides=(0.5, 0.5))  # fmt: skip
    sun = direction(180.0, 50.0)
    assert cells(made, sun, ONE, None, 3, 3)[1, 1] == pytest.approx(1.0, abs=1e-6)
    quarters = cells(made, sun, ONE, None, 2, 2)
    assert quarters.sum() == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(quarters[:, 0], quarters[:, 1], atol=1e-9)  # east and west


def test_a_year_from_few_directions():
    days, hours = (each.ravel() for each in np.meshgrid(np.arange(1, 366, 30), np.arange(0.5, 24), indexing="ij"))
    sun = clock.solar_clock(0.6, clock.declination_cooper(days), hours)
    made = scene(cylinder((0, 0, 110.0), 4.0, 9.0), sunshapes.pillbox(), (150.0, 200.0, 5.0), curve=1 / 530)
    up = sun[:, 2] > 0
    weight = np.where(up, np.maximum(sun[:, 2], 0), 0.0)[None]
    found = sun_nodes(sun, 0.6, (4, 9))
    assert found is not None
    directions, share = found
    np.testing.assert_allclose(share.sum(1), up, atol=1e-12)
    exact = cells(made, sun, weight, np.ones_like(weight), 12, 8)
    near = cells(made, directions, weight @ share, np.ones((1, 36)), 12, 8)
    assert near.sum() == pytest.approx(exact.sum(), rel=1e-12)
    assert np.abs(near - exact).max() < 5e-3 * exact.max()
    assert sun_nodes(sun[:40], 0.6, (4, 9)) is None
    assert sun_nodes(sun, None, (4, 9)) is None
