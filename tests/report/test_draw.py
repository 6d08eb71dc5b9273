"""The forms of figures: values, words and colours that they show, against values computed here."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
import xarray as xr
from matplotlib import rcParams

from heliosweep.report.draw import draw, image
from heliosweep.report.figures import Curves, Maps, Rasters
from tests.report.synthetic import BOTH, result

RNG = np.random.default_rng(5)


def array(**sizes):
    values = RNG.uniform(1.0, 2.0, tuple(sizes.values()))
    return xr.DataArray(values, dims=list(sizes), attrs={"units": "m", "long_name": "reach"})


def one(data, figure):
    (named,) = draw(data, [figure])
    return named


def test_maps_and_their_differences():
    data = result({"tracking": BOTH}, heliostats=9)
    maps, differences = draw(data, [Maps("map", "Map", ["optical_efficiency"], lines=["tracking"], less="tracking")])
    shown = [np.asarray(axes.collections[0].get_array()) for axes in maps.figure.axes[:2]]
    for values, method in zip(shown, BOTH, strict=True):
        assert values == pytest.approx(100 * data["optical_efficiency"].sel(tracking=method).to_numpy())
    assert np.asarray(differences.figure.axes[0].collections[0].get_array()) == pytest.approx(shown[0] - shown[1])
    low, high = differences.figure.axes[0].collections[0].get_clim()
    assert high is not None
    assert low == -high


def test_rasters_show_every_pixel_upright():
    z, y = np.linspace(1.0, -1.0, 5), np.linspace(-2.0, 2.0, 7)
    data = xr.Dataset({"slope": (("z", "y"), np.outer(z, y), {"units": "mrad"})},
                      {"z": ("z", z, {"units": "m"}), "y": ("y", y, {"units": "m"})})  # fmt: skip
    mesh = one(data, Rasters("slope", "Slope", ["slope"])).figure.axes[0].collections[0]
    assert np.asarray(mesh.get_array()).reshape(5, 7)[0] == pytest.approx(-y)


@pytest.mark.parametrize("kind", ["png", "svg", "pdf"])
def test_the_same_figure_has_the_same_bytes_in_each_thread(kind):
    data = xr.Dataset({"reach": array(tilt=3)}, {"tilt": [0.0, 1.0, 2.0], "height": 3.0})
    style, figures = dict(rcParams), [one(data, Curves("reach", "Reach $x$", ["reach"])).figure for _ in range(4)]
    with ThreadPoolExecutor(4) as pool:
        assert len(set(pool.map(partial(image, kind=kind), figures))) == 1
    assert dict(rcParams) == style
