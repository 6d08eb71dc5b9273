"""Figures of angles and of outlines are there where a result has them, and show what it holds."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.patches import Polygon

from heliosweep import api
from heliosweep.families.field_efficiency.figures import figures


def drawn(study):
    result = api.build(study).compute()
    return result, {one.name: one for one in figures(result)}


def test_outlines_are_drawn_of_the_mirror_that_loses_most(small):
    time = {"clock": "sun", "azimuth": 100, "elevation": [8, 30]}
    result, found = drawn(small(site=None, time=time, output={"outlines": 12}))
    panels = found["mirror_outlines"].figure.axes
    assert len(panels) == 4
    for axes, (method, elevation) in zip(panels, np.ndindex(2, 2), strict=True):
        index = int(axes.get_title().split("heliostat ")[1].split(":")[0])
        here = result.isel(tracking=method, sun_elevation=elevation, heliostat=index)
        patches = [patch for patch in axes.patches if isinstance(patch, Polygon)]
        assert len(patches) == here["outline_count"].sum() > 0
        areas = [_area(patch.get_xy()[:-1]) for patch in patches]
        np.testing.assert_allclose(sum(areas), here["outline_area"].sum(), rtol=1e-9)
        assert f"{100 * (1 - float(here['shading_efficiency'])):.1f} % shaded" in axes.get_title()


def _area(corners):
    x, y = corners.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def test_maps_of_motion_and_courses_of_angles(small):
    _, found = drawn(small(output={"tracking_angles": True, "time_series": True}))
    for axis in ("primary", "secondary"):
        titles = [axes.get_title() for axes in found[f"{axis}_motion_maps"].figure.axes if axes.get_title()]
        assert [title.split("\n")[0] for title in titles] == [
            f"{method}, latitude {place}\N{DEGREE SIGN}{side}"
            for method in ("spinning-elevation", "azimuth-elevation")
            for place, side in (("0", ""), ("40", " N"))
        ]
    assert len(found["angle_courses"].figure.axes) == 8
    for axes in found["angle_courses"].figure.axes:
        assert len(axes.lines) == 2
        assert all(np.nanmax(np.abs(np.diff(line.get_ydata()))) < 180 for line in axes.lines)


@pytest.mark.parametrize("output", [{}, {"field_geometry": True}])
def test_none_of_them_without_angles_and_outlines(small, output):
    _, found = drawn(small(output=output))
    assert not {"mirror_outlines", "primary_motion_maps", "secondary_motion_maps", "angle_courses"} & set(found)
