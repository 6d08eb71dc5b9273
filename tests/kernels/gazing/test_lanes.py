"""Lanes: powers, rays and brightnesses are those of the plain kernels."""

import numpy as np
import pytest

from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.gazing.lanes import CHUNK, LANES
from heliosweep.kernels.gazing.search import merits
from heliosweep.kernels.sun.profiles import jose, power
from heliosweep.kernels.sun.tables import noisy, smooth_fit
from tests.kernels.gazing import twin
from tests.kernels.gazing.twin import sun_offsets
from tests.kernels.sun.curves import brightness

PROFILES = {"jose": jose(), "table": noisy(jose(), 0.012), "fit": smooth_fit(noisy(jose(), 0.012))}


@kernel
def powers(bases, exponent, out):
    for k in range(bases.size):
        out[k] = power(bases[k], exponent)


@kernel
def plain_merits(layout, profile, images, place, slopes, fit_gain, gaze, wavefront):
    out = np.zeros(images.shape[1])
    for k in range(images.shape[1]):
        values = np.zeros(images.shape[0])
        for i in range(images.shape[0]):
            if wavefront:
                v, w = gaze[i, 0] - slopes[0, k], gaze[i, 1] - slopes[1, k]
            else:
                v, w, _, _, _, _ = sun_offsets(layout, i, slopes[0, k], slopes[1, k], place[0, k], place[1, k])
            values[i], _ = brightness(profile, v * v + w * w)
        lit = images[:, k] >= 0.3
        gain = np.sum((values * images[:, k])[lit]) / np.sum((values * values)[lit]) if fit_gain else 1.0
        out[k] = np.sum((gain * values - images[:, k])[lit] ** 2)
    return out


@pytest.mark.parametrize("exponent", [1.111, 0.5, 2.0, 3.7, 0.9])
def test_power(exponent):
    rng = np.random.default_rng(0)
    bases = np.concatenate((rng.uniform(0.0, 1.0, 5000), 10.0 ** rng.uniform(-30.0, 3.0, 5000), [1.0, 0.5, 2.0]))
    out = np.empty_like(bases)
    powers(bases, exponent, out)
    doublings = np.abs(exponent * np.log2(bases))
    assert np.all(np.abs(out / bases**exponent - 1.0) < 4e-16 * (2.0 + doublings))
    assert np.max(np.abs(out - bases**exponent)[:5000]) < 4e-16


@pytest.mark.parametrize("name", PROFILES)
@pytest.mark.parametrize("fit_gain", [False, True])
@pytest.mark.parametrize("wavefront", [False, True])
def test_merits_are_those_of_the_plain_kernels(name, fit_gain, wavefront):
    layout, rng, count = twin.paper_scene(), np.random.default_rng(1), CHUNK + LANES + 5
    place = rng.uniform(-4.0, 4.0, (2, count))
    slopes = rng.normal(0.0, 1e-3, (2, count))  # a few rays end beside the disc, on the tangent
    images = rng.uniform(0.2, 1.0, (4, count))
    images[2, 7] = np.nan
    arguments = layout, PROFILES[name], images, place
    found = merits(wavefront, *arguments, 0.3, fit_gain, slopes)
    expected = plain_merits(*arguments, slopes, fit_gain, layout.gaze, wavefront)
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-15)


def test_merit_of_the_twin():
    layout, rng = twin.paper_scene(), np.random.default_rng(2)
    place, slopes = rng.uniform(-3.0, 3.0, (2, 50)), rng.normal(0.0, 2e-4, (2, 50))
    images = rng.uniform(0.8, 1.0, (4, 50))
    expected = np.sum((twin.modelled(layout, place[0], place[1], slopes) - images) ** 2, axis=0)
    np.testing.assert_allclose(merits(False, layout, jose(), images, place, 0.3, False, slopes), expected, rtol=1e-10)
