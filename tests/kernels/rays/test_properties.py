"""Properties of rays: bits of every split, exact polygons, standard errors, bodies in the way."""

import math
from typing import Any

import numpy as np
import pytest

from heliosweep.kernels import rays, sunshapes
from heliosweep.kernels.field import efficiency
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION
from tests.kernels.rays.scenes import POINT_SUN, direction, random_field, scene

_NONE = (0.0, 0.0, 0.0)


def suns(rng, count):
    """Unit vectors to the sun, down to 5 degrees above the horizon."""
    azimuth, elevation = rng.uniform(0.0, 2.0 * math.pi, count), np.radians(rng.uniform(5.0, 85.0, count))
    return np.stack((np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth), np.sin(elevation)), 1)


@pytest.mark.parametrize("kind", ["cylinder", "rectangle"])
def test_same_bits_however_split(kind):
    rng = np.random.default_rng(1)
    receiver = (
        rays.cylinder((0, 0, 60.0), 3.0, 6.0) if kind == "cylinder" else rays.rectangle((0, 0, 60.0), 0, -0.3, 6, 6)
    )
    made = random_field(rng, 40, receiver=receiver, errors=(1e-3, 2e-3, 5e-4), curve=0.004, tower=(2.0, 55.0))
    sun, weight = suns(rng, 30), rng.uniform(0.0, 1.0, 30)
    sun[[3, 17]] = (0.0, 1.0, -0.1)
    given: dict[str, Any] = {
        "weights": np.stack((weight, 0.9 * weight)), "group": np.arange(30) % 4, "groups": 4, "cells": (5, 8),
        "share": rng.uniform(10.0, 30.0, 40), "area": rng.uniform(20.0, 40.0, 40),
    }  # fmt: skip
    whole = rays.trace(made, sun, **given)
    for threads in (2, 5):
        found = rays.trace(made, sun, threads=threads, **given)
        assert found.sums.tobytes() == whole.sums.tobytes()
        assert found.flux.tobytes() == whole.flux.tobytes()
        assert found.field.tobytes() == whole.field.tobytes()
    sums, flux, field = np.zeros_like(whole.sums), np.zeros_like(whole.flux), np.zeros_like(whole.field)
    for start, stop in ((0, 7), (7, 8), (8, 40)):
        for first, last in ((13, 30), (0, 13)):
            found = rays.trace(made, sun, start=start, stop=stop, first=first, last=last, **given)
            sums[:, start:stop] += found.sums
            flux += found.flux
            field[:, first:last] += found.field
    assert sums.tobytes() == whole.sums.tobytes()
    assert flux.tobytes() == whole.flux.tobytes()
    assert field.tobytes() == whole.field.tobytes()


@pytest.mark.parametrize("tracking", [AZIMUTH_ELEVATION, SPINNING_ELEVATION])
@pytest.mark.parametrize("tall", [12.0, 60.0])
def test_no_body_in_the_way_is_missed(tracking, tall, monkeypatch):
    """Compare the candidates of the search with all pairs."""
    rng = np.random.default_rng(int(tall) + tracking)
    for sun_shape in (sunshapes.pillbox(), sunshapes.buie(0.1)):
        made = random_field(
            rng, 60, tall, errors=(4e-3, 1e-3, 2e-3), curve=rng.uniform(0.0, 0.02, 60), cant=rng.uniform(0.0, 0.02, 60),
            facets=(3, 2, 0.05), tracking=tracking, sun=sun_shape, turn=rng.uniform(-5e-3, 5e-3, 2),
        )  # fmt: skip
        sun = np.vstack((suns(rng, 40), direction(10.0, 1.5), direction(77.0, 89.9), [[0.0, 0.0, 1.0]]))
        found = rays.trace(made, sun, group=np.arange(len(sun)), groups=len(sun))

        with monkeypatch.context() as patched:
            patched.setattr(rays, "_spreads", lambda scene, *_: (np.inf, np.full(len(scene.centre), np.inf)))
            wanted = rays.trace(made, sun, group=np.arange(len(sun)), groups=len(sun))
        assert found.sums.tobytes() == wanted.sums.tobytes()
        assert wanted.sums[..., rays.UNSHADED].min() < 0.9
        assert tall > 20.0 or wanted.sums[..., rays.UNBLOCKED].min() < 0.9


@pytest.mark.parametrize("tracking", [AZIMUTH_ELEVATION, SPINNING_ELEVATION])
def test_exact_polygons_with_a_point_sun_and_flat_mirrors(tracking):
    rng, far = np.random.default_rng(3), []
    for _ in range(12):
        count = int(rng.integers(2, 40))
        made = random_field(rng, count, rng.uniform(10.0, 60.0), errors=_NONE, sun=POINT_SUN, tracking=tracking)
        sun = suns(rng, 3)
        x, y, z, width, height = *made.centre.T, *made.sides.T
        exact_field = efficiency.sorted_field(x, y, z, width / 2, height / 2, made.target)
        wanted = efficiency.field_series(exact_field, tracking, sun, 0, count)
        mean, error = rays.mean_error(rays.trace(made, sun, group=np.arange(3), groups=3, rays=1024).sums)
        assert pytest.approx(wanted[0], abs=1e-12) == mean[..., rays.COSINE].T
        for name, exact in ((rays.UNSHADED, wanted[1]), (rays.UNBLOCKED, wanted[2]), (rays.OPTICAL, wanted[3])):
            far.append((np.abs(mean[..., name].T - exact) / (error[..., name].T + 1e-4)).ravel())
            assert pytest.approx(exact, abs=0.015) == mean[..., name].T
    assert np.mean(np.concatenate(far) > 3.0) < 0.01


def test_a_tower_shades():
    tower, sun = (4.0, 50.0), direction(180.0, 30.0)
    made = scene(
        rays.cylinder((0.0, 0.0, 55.0), 4.0, 6.0), place=[(0.0, 40.0, 5.0), (0.0, -40.0, 5.0), (4.0, 40.0, 5.0)],
        sides=(6.0, 6.0), sun=POINT_SUN, tower=tower, errors=_NONE,
    )  # fmt: skip
    shaded = 1.0 - rays.trace(made, sun, rays=4096).sums[:, :, 0, rays.UNSHADED].mean(axis=0)
    assert shaded[0] == 1.0
    assert shaded[1] == 0.0
    assert 0.3 < shaded[2] < 0.7
    low = made._replace(tower=(4.0, 20.0))  # the shadow of the top ends at y = (20 - 5) / tan 30 = 26 m
    assert rays.trace(low, sun).sums[0, 0, 0, rays.UNSHADED] == 1.0


def test_standard_errors_cover():
    rng = np.random.default_rng(8)
    made, sun = random_field(rng, 25), suns(rng, 12)
    truth = rays.trace(made, sun, rays=2**15).sums.mean(axis=0)
    inside = []
    for seed in range(1, 17):
        mean, error = rays.mean_error(rays.trace(made, sun, rays=128, seed=seed).sums)
        inside.append((np.abs(mean - truth) <= 2.0 * error + 1e-12)[..., [rays.OPTICAL, rays.HIT, rays.LIGHT]])
    assert np.mean(inside) == pytest.approx(0.95, abs=0.025)


def test_the_peak_is_not_the_peak_of_the_noise():
    rng = np.random.default_rng(9)
    flux = rng.poisson(1000, (400, rays.REPLICATES, 20, 36))
    peaks = np.array([rays.peak(each) for each in flux])
    bias = flux.mean(axis=1).max(axis=(1, 2)).mean() - 1000.0
    assert bias > 30.0
    assert peaks[:, 0].mean() - 1000.0 == pytest.approx(bias / 2.0, rel=0.1)
    assert peaks[:, 1].mean() > bias / 2.0
    sharp = flux + 1000 * (np.arange(720).reshape(20, 36) == 300)
    assert np.mean([rays.peak(each)[0] for each in sharp]) == pytest.approx(2000.0, abs=3.0)


@pytest.mark.parametrize("precision", [pytest.param(1e-4, marks=pytest.mark.long), 1e-3])
def test_the_number_of_rays_reaches_the_precision(precision):
    rng = np.random.default_rng(11)
    made, sun = random_field(rng, 60, curve=0.01), suns(rng, 200)
    each = rays.rays_for(made, sun, precision=precision, cells=(6, 9))
    found = rays.trace(made, sun, rays=each, cells=(6, 9))
    light, error = rays.mean_error(found.sums[..., 0, rays.LIGHT] * made.sides.prod(axis=1))
    assert math.sqrt(np.mean(error**2)) < 1.3 * 8.0 * precision * light.mean()
    whole, error = rays.mean_error((found.sums[..., 0, rays.LIGHT] * made.sides.prod(axis=1)).sum(axis=1))
    assert error < 1.3 * precision * whole
    mean, errors = rays.mean_error(found.flux)
    assert math.sqrt(np.mean(errors[mean > 0.5 * mean.max()] ** 2)) < 1.3 * 50.0 * precision * mean.max()
