"""What is found before a run: mirrors that collide, a receiver too low, and a sun that never rises."""

from __future__ import annotations

from typing import Any

import pytest

from heliosweep.errors import StudyError

SIZES = ["heliostat.width", "heliostat.height", "layout.radial_stagger.clearance"]


def rings(clearance: Any) -> dict[str, Any]:
    return {"radial_stagger": {"clearance": clearance, "inner_radius": 61.3, "rings": 2}}


def mirrors(side: Any, pivot_height: Any = 7) -> dict[str, Any]:
    return {"width": side, "height": side, "pivot_height": pivot_height}


def test_tied_sizes_are_looked_at_together(small):
    small(layout=rings([5, 9, 18]), heliostat=mirrors([3, 6, 12], 2), zip=[SIZES])
    with pytest.raises(StudyError, match="they collide"):
        small(layout=rings([5, 18, 9]), heliostat=mirrors([3, 6, 12], 2), zip=[SIZES])
    with pytest.raises(StudyError, match=r"less than the shorter side of the mirrors, 12 m: they collide"):
        small(layout=rings([5, 9, 18]), heliostat={"width": [3, 6, 12], "height": 12, "pivot_height": 2})


def test_tied_heights_are_looked_at_together(small):
    tied = [["receiver.height", "heliostat.pivot_height"]]
    small(heliostat=mirrors(5, [2, 30]), receiver={"height": [20, 120]}, zip=tied)
    with pytest.raises(StudyError, match=r"highest centre is at 30 m \(got 20\)"):
        small(heliostat=mirrors(5, [30, 2]), receiver={"height": [20, 120]}, zip=tied)
    with pytest.raises(StudyError, match=r"highest centre is at 30 m \(got 20\)"):
        small(heliostat=mirrors(5, [2, 30]), receiver={"height": {"start": 120, "stop": 20, "num": 10**6}})


def test_all_faults_of_a_field_at_once(small):
    with pytest.raises(StudyError) as error:
        small(
            heliostat=mirrors(20),
            receiver={"height": 6},
            time={"clock": "solar", "hours": 0, "days": [80, 355]},
        )
    assert [problem.key for problem in error.value.problems] == ["layout", "receiver.height", "time.hours"]


def civil(start: str, stop: str, **keys: Any) -> dict[str, Any]:
    window = {"start": start, "stop": stop, "step": "30 min"}
    return {"clock": "civil", "timezone": "+01:00", "dates": ["2021-01-01", "2021-06-21"], "window": window} | keys


def test_the_sun_must_rise_somewhere_on_the_civil_clock(small):
    site = {"latitude": 45, "longitude": 15}
    with pytest.raises(StudyError, match=r"time.window: the sun never rises at these sites"):
        small(site=site, time=civil("00:00", "02:00"))
    small(site=site, time=civil("02:00", "05:00"))  # the sun of June is up at 5 h
    small(site=site | {"latitude": [45, 80]}, time=civil("00:00", "02:00"))  # midnight sun
    small(site=site | {"longitude": [15, 165]}, time=civil("00:00", "02:00"))  # noon there
    with pytest.raises(StudyError, match="the sun never rises"):
        small(site=site | {"latitude": 85}, time=civil("00:00", "24:00", dates="2021-12-21"))
    sites = [{"name": name, "latitude": 45, "longitude": 15, "timezone": zone} for name, zone in _ZONES.items()]
    evening = civil("22:00", "23:00")
    del evening["timezone"]
    small(site=None, sites=sites, time=evening)  # day by the clock of Auckland
    with pytest.raises(StudyError, match="the sun never rises"):
        small(site=None, sites=sites[:1], time=evening)


_ZONES = {"Vienna": "Europe/Vienna", "a clock of elsewhere": "Pacific/Auckland"}
