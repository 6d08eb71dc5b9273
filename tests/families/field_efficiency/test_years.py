"""A year of a field against 5e10 rays of another tracer, at the default precision."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from heliosweep import api
from tests.families.studies import computed

DATA = Path(__file__).parents[2] / "data" / "field_rays"


def column(name: str, key: str) -> np.ndarray:
    with (DATA / name).open(encoding="utf-8") as file:
        return np.array([float(row[key]) for row in csv.DictReader(file)])


def test_canted_heliostats_before_a_rectangle():
    # 82 heliostats of 3 x 2 facets, hours of a typical year; traced with double precision on a GPU, exact to 1e-6.
    result = computed(api.load(DATA / "canted_focused_year.yaml"))
    light = (result["optical_efficiency"] * result["intercept_efficiency"]).to_numpy()
    wanted, map_wanted = column("canted_focused_year_heliostats.csv", "light"), np.zeros((20, 36))
    rows, columns = (column("canted_focused_year_map.csv", key).astype(int) for key in ("row", "column"))
    map_wanted[rows, columns] = column("canted_focused_year_map.csv", "energy")
    assert abs(light.mean() / wanted.mean() - 1) < 2e-4
    np.testing.assert_allclose(light, wanted, rtol=2e-3)
    assert 0 < float(result["field_total_efficiency_error"] / result["field_total_efficiency"]) < 1e-4
    energy = result["energy_flux_map"].to_numpy() * 49 / 720
    assert abs(energy - map_wanted).max() < 0.015 * map_wanted.max()
    assert abs(energy.max() / map_wanted.max() - 1) < 0.01
    assert abs(energy.sum() / float(result["field_receiver_energy"]) - 1) < 1e-12


def test_draws_with_fewer_rays_are_near():
    """Draws that hardly differ, of some of the heliostats and instants, against the result with all."""
    study = api.load(DATA / "canted_focused_year.yaml").with_({"output": None})
    narrow = {"optics.reflectivity": {"uniform": [0.899999, 0.900001]}, "optics.cleanliness": {"uniform": [0.95, 0.96]}}
    drawn = computed(study.with_({**narrow, "sample": {"size": 4, "design": "random"}}))
    whole = float(computed(study)["field_receiver_energy"])
    shares = drawn["field_receiver_energy"] / (0.9 * drawn["cleanliness"] * whole)
    assert float(abs(shares - 1).max()) < 4e-3
    np.testing.assert_allclose(shares, shares[0], rtol=1e-5)
