"""What is accepted before a run: tied sizes and heights that fit together, and a sun that rises somewhere."""

from __future__ import annotations

import pytest

SIZES = ["heliostat.width", "heliostat.height", "layout.radial_stagger.clearance"]
HEIGHTS = ["receiver.height", "heliostat.pivot_height"]
PLACE = {"latitude": 45, "longitude": 15}
SITES = [{**PLACE, "name": zone, "timezone": zone} for zone in ("Europe/Vienna", "Pacific/Auckland")]


def civil(start, stop, **keys):
    window = {"start": start, "stop": stop, "step": "30 min"}
    return {"clock": "civil", "timezone": "+01:00", "dates": ["2021-01-01", "2021-06-21"], "window": window} | keys


@pytest.mark.parametrize(
    "blocks",
    [
        {"layout": {"radial_stagger": {"clearance": [5, 9, 18], "inner_radius": 61.3, "rings": 2}}, "zip": [SIZES],
         "heliostat": {"width": [3, 6, 12], "height": [3, 6, 12], "pivot_height": 2}},
        {"heliostat": {"width": 5, "height": 5, "pivot_height": [2, 30]}, "receiver": {"height": [20, 120]},
         "zip": [HEIGHTS]},
        {"site": PLACE, "time": civil("02:00", "05:00")},  # the sun of June is up at 5 h
        {"site": PLACE | {"latitude": [45, 80]}, "time": civil("00:00", "02:00")},  # midnight sun
        {"site": PLACE | {"longitude": [15, 165]}, "time": civil("00:00", "02:00")},  # noon there
        {"site": None, "sites": SITES, "time": civil("22:00", "23:00", timezone=None)},  # day by the clock of Auckland
    ],
)  # fmt: skip
def test_sweeps_of_which_each_point_is_possible(small, blocks):
    """Each fails with one change, see bad_studies.txt."""
    if "time" in blocks:
        blocks["time"] = {key: value for key, value in blocks["time"].items() if value is not None}
    small(**blocks)
