"""Backward gazing without a study: slopes that are rendered come back; labels and wrong arguments."""

import numpy as np
import pytest
import xarray as xr

import heliosweep
from tests.kernels.gazing import twin

SCENE = heliosweep.gazing_scene(30.0, 60.0, 0.0, 44.0)
Y, Z = np.linspace(-3.0, 3.0, 5), np.linspace(-2.0, 2.0, 4)
X_SLOPES = xr.DataArray(0.2 * np.sin(Y + Z[:, np.newaxis]), {"z": Z, "y": Y}, ("z", "y"))
Y_SLOPES = 0.1 - 0.5 * X_SLOPES


def test_images_are_those_of_the_specification():
    images = heliosweep.render_images(SCENE, X_SLOPES, Y_SLOPES)
    assert images.dims == ("camera", "z", "y")
    y, z = np.tile(Y, 4), np.repeat(Z, 5)
    slopes = 1e-3 * np.array([X_SLOPES.values.ravel(), Y_SLOPES.values.ravel()])
    expected = twin.modelled(twin.paper_scene(), y, z, slopes)
    np.testing.assert_allclose(images.values.reshape(4, -1), expected, atol=1e-9)
    far = heliosweep.render_images(SCENE, X_SLOPES + 5.0, Y_SLOPES)
    assert (far == 0.0).all()  # beside the disc


@pytest.mark.parametrize(("method", "error"), [("LM", 1e-8), ("O2", 1e-4), ("O1", 0.01), ("A", 0.01)])
def test_slopes_come_back(method, error):
    holes = X_SLOPES.where(X_SLOPES.y < 3.0)
    found = heliosweep.reconstruct_slopes(SCENE, heliosweep.render_images(SCENE, holes, Y_SLOPES), method=method)
    known = holes.notnull()
    assert (found.slope_x.notnull() == known).all()
    assert float(abs(found.slope_x - holes).max()) < error
    assert float(abs(found.slope_y - Y_SLOPES).max()) < error
    assert (found.lit_cameras.where(known, 4) == 4).all()
    assert (found.quality == xr.where(known, 0, 2)).all()
    assert found.slope_x.attrs["units"] == "mrad"


def test_arrays_a_profile_and_a_gain():
    angles = np.linspace(0.0, 4.36, 60)
    profile = angles, twin.jose(1e-3 * angles)
    images = heliosweep.render_images(SCENE, X_SLOPES.values, Y_SLOPES.values, Y, Z, sun_profile=profile)
    found = heliosweep.reconstruct_slopes(SCENE, 1.02 * images.values, Y, Z, fit_gain=True, sun_profile=profile)
    np.testing.assert_allclose(found.slope_x, X_SLOPES, atol=1e-3)
