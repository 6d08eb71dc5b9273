"""The plan's time of shipped studies is what they take, within a factor."""

from __future__ import annotations

import pytest

from heliosweep import api
from tests.conftest import STUDIES

FACTOR = 1.5


@pytest.mark.parametrize(
    ("name", "seconds"),
    [
        ("camera_radius", 3.05),
        ("chong2012_maps", 0.61),
        ("chong2012_motion", 2.9),  # angles
        ("clear_sky_sites", 1.17),
        ("defieux2020_table1", 5.1),
        ("dish_world", 0.89),
        ("draws_annual_energy", 60),
        ("draws_table2", 10.9),  # few instants
        ("draws_tolerable_tilt", 1.97),
        ("detectors_closed_loop", 0.72),
        ("field_cut_to_power", 4.3),  # half of the field is computed twice
        ("field_of_heliostats", 2.8),
        ("latitude_sweep", 3.1),
        ("mount_error_monte_carlo", 1.02),
        ("polar_cavity", 3.6),
        ("profile_error", 0.85),
        ("slope_and_receiver", 2.4),
        ("spiral_field", 0.8),  # mirrors stand far apart
        ("sun_azimuth_contamination", 1.16),
        ("surround_energy", 1.95),  # light beside the receiver takes large tables
    ],
)
def test_the_plan_foresees_the_time_of_shipped_studies(name, seconds):
    """Seconds as measured on one core, in those of the core that times are stated of by the pace of fields."""
    study = api.load(STUDIES / f"{name}.yaml")
    work = api.family_of(study).workload(study)
    assert 1 / FACTOR < work.points * work.point_seconds / seconds < FACTOR
