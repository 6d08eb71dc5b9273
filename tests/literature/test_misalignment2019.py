"""Figures 4 and 7 of "Evaluation and measurement of heliostat misalignment in solar power plant using vector model".

Optics Express 27(8), A257 (2019), from the shipped studies: what tables of claims cannot ask; the rest is in
`studies/published`, see `test_index`.
"""

from __future__ import annotations

import numpy as np

from tests.conftest import shipped


def test_figure_7_spots_lie_on_the_hyperbolas():
    traces = shipped("figure7_hyperbolas")
    traces = traces.sel(error_size=traces["error_size"] != 0)  # that spot is the origin
    y, z = traces["spot_y"], traces["spot_z"]
    a, b, c, d, e, f = (traces["conic"].sel(conic_coefficient=name) for name in "ABCDEF")
    size = abs(a * y * y) + abs(b * y * z) + abs(c * z * z) + abs(d * y) + abs(e * z) + abs(f)
    assert float((abs(a * y * y + b * y * z + c * z * z + d * y + e * z + f) / size).max()) < 1e-12


def test_figure_4_curves_are_conics_that_turn_with_the_hour():
    curves = shipped("deviation_curves").sel(source="canting")
    assert bool((curves["eccentricity"] > 1).all())
    up = curves.sel(axis="elevation", error_size=12)
    lean = np.degrees(np.arctan2(up["spot_y"], up["spot_z"])).isel(day=0)
    assert bool((lean.sel(hour=8) > lean.sel(hour=12)).all())
    assert bool((lean.sel(hour=12) > lean.sel(hour=16)).all())
