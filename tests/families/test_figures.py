"""Figures of one study of each family and mode: all are drawn, complete and legible; a missing variable omits some."""

import numpy as np
import pytest
import xarray as xr

from heliosweep.families.lookup import family_of_result
from heliosweep.report.draw import draw
from heliosweep.report.interactive import explore
from tests.conftest import SMALL, shipped
from tests.families.studies import computed, study

#: Names of the figures of a small study of each mode, the main picture first.
EXPECTED = {
    "small field": "field_maps field_maps_differences",
    "chong2012_table1": "field_maps field_maps_differences efficiency_over_sun_elevation primary_motion_maps "
    "secondary_motion_maps mirror_outlines",
    "liu2022_table2": "factor_over_axis_tilt_direction directions_over_site path_of_the_sun error_over_day",
    "field_tolerance": "tolerance_map tolerance_hour_map hit_map tolerance_over_day hits_over_error_size spot_drift",
    "calibration_synthetic": "before_after after recovered_errors knowledge_over_days_used mount_errors",
    "detectors_closed_loop": "beam_error_map residual_map crossings before_after after recovered_errors mount_errors "
    "closed_loop",
    "detectors_measured": "crossings knowledge_over_parameters mount_errors",
    "gazing_measured": "slope_maps images slope_uncertainty residuals quality canting sun_profile",
    "defieux2020_figures": "slope_maps slope_errors images errors canting sun_profile",
}


def result_of(name: str) -> xr.Dataset:
    """Result of a shipped study, or of a small field."""
    changes = {"heliostat.pixel": 0.2} if name == "defieux2020_figures" else {}
    small = name == "small field"
    found: xr.Dataset = computed(study(SMALL, site={"latitude": 0})) if small else shipped(name, **changes)
    return found


@pytest.mark.parametrize("name", EXPECTED)
def test_figures_are_complete_and_legible(name):
    result = result_of(name)
    found_family = family_of_result(result)
    assert found_family is not None
    found = list(draw(result, found_family.figures(result)))
    assert [one.name for one in found] == EXPECTED[name].split()
    for named in found:
        assert named.caption.endswith((".", ".)"))
        assert "(1)" not in named.caption
        figure = named.figure
        figure.draw_without_rendering()
        box, size = figure.get_tightbbox(), figure.get_size_inches()
        assert min(*box.min, *(size - box.max)) >= -0.15, named.name
        for axes in figure.axes:
            assert "(1)" not in axes.get_xlabel() + axes.get_ylabel()
            assert axes.get_title().count("\n") < 5


@pytest.mark.parametrize("name", ["small field", "spot_drift"])
def test_missing_variables_omit_figures(name):
    result = result_of(name)
    found_family = family_of_result(result)
    assert found_family is not None
    every = {one.name for one in draw(result, found_family.figures(result))}
    for start in range(2):
        part = result.drop_vars([str(one) for one in result.data_vars][start::2])
        assert {one.name for one in draw(part, found_family.figures(part))} <= every | {"angles"}


def test_interactive_plots_follow_from_the_same_declarations():
    result = shipped("spot_drift")
    found_family = family_of_result(result)
    assert found_family is not None
    script, plots = explore(result, found_family.figures(result))
    assert len(plots) == 4
    assert "<script" not in script
    assert all("<div" in one["html"] for one in plots)


def test_a_family_without_figures_has_default_figures():
    values = xr.DataArray([1.0, 3.0, 2.0], {"tilt": [0.0, 1.0, 2.0]}, attrs={"units": "m", "long_name": "reach"})
    from heliosweep.report.figures import default_figures

    (one,) = draw(xr.Dataset({"reach": values}), default_figures(xr.Dataset({"reach": values})))
    (line,) = one.figure.axes[0].get_lines()
    assert np.asarray(line.get_ydata()).tolist() == [1.0, 3.0, 2.0]
    assert one.figure.axes[0].get_ylabel() == "reach (m)"
