"""Figures of every family can be read, whatever was swept, and need no more of a result than they show."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from heliosweep.report.style import image
from tests.families.backward_gazing import report_results as gazing
from tests.families.backward_gazing import test_report as of_gazing
from tests.families.dish_tracking import test_report as of_dishes
from tests.families.misalignment import report_results as misalignment
from tests.families.misalignment import test_report as of_misalignment
from tests.report.synthetic import assert_readable

GALLERIES = {
    "backward_gazing": of_gazing.GALLERY,
    "dish_tracking": of_dishes.GALLERY,
    "misalignment": of_misalignment.GALLERY,
}


@pytest.mark.parametrize(
    ("family", "name"), [(family, name) for family in GALLERIES for name in GALLERIES[family].cases]
)
def test_figures_are_few_and_can_be_read(family, name):
    gallery = GALLERIES[family]
    found = list(gallery.figures(gallery.result(name)))
    names = " ".join(named.name for named in found)
    assert names == gallery.expected.get(name, names)
    assert len(found) <= gallery.most
    panels, lines = gallery.crowd
    for number, named in enumerate(found):
        if number:
            named.figure.draw_without_rendering()
        else:
            assert image(named.figure).startswith(b"\x89PNG")
        assert_readable(named, gallery.words, gallery.shared)
        assert named.figure.get_size_inches()[1] <= 10, named.name
        assert len(named.figure.axes) <= panels, named.name
        assert all(len(axes.get_lines()) <= lines for axes in named.figure.axes), named.name


@pytest.mark.usefixtures("unplaced")
@pytest.mark.parametrize(
    ("family", "name", "dim"),
    [
        ("backward_gazing", "one method over suns", "module"),
        ("dish_tracking", "two directions", "date"),
        ("misalignment", "drift", "heliostat"),
    ],
)
def test_values_are_read_only_where_they_are_drawn(family, name, dim):
    gallery = GALLERIES[family]
    lazy = gallery.result(name).chunk({dim: 1})
    assert gallery.names(lazy) == gallery.names(gallery.result(name)) != []
    assert not any(isinstance(array.data, np.ndarray) for array in lazy.data_vars.values() if array.ndim)


#: Few points of each dimension: all the figures of many, sooner. And how many sets of variables are left out in turn.
FEW = {
    "simulated": (of_gazing.GALLERY, lambda: gazing.result(methods=["LM"], modules=1, pixel=0.4), 3),
    "measured": (of_gazing.GALLERY, lambda: of_gazing.measured(methods=["LM"]), 3),
    "field": (of_gazing.GALLERY, lambda: gazing.field(count=9), 3),
    "curves": (
        of_misalignment.GALLERY,
        lambda: misalignment.curves(
            hours=(8, 12, 16),
            sweep={"axis": ["elevation", "azimuth"], "error_size": [-4.0, 0.0, 4.0]},
            pivots=misalignment.POSITIONS[:1],
        ),
        99,
    ),
}


@pytest.mark.usefixtures("unplaced")
@pytest.mark.parametrize("name", FEW)
def test_missing_variables_leave_figures_out(name):
    gallery, make, count = FEW[name]
    dataset = make()
    every, variables = set(gallery.names(dataset)), list(map(str, dataset.data_vars))
    assert every
    for start in range(min(count, len(variables))):
        assert set(gallery.names(dataset.drop_vars(variables[start::count]))) <= every
    assert not gallery.names(xr.Dataset())
