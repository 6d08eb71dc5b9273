"""Figures 4 and 7 of "Evaluation and measurement of heliostat misalignment in solar power plant using vector model".

Optics Express 27(8), A257 (2019), from the shipped studies: what tables of claims cannot ask; the rest is in
`studies/published`, see `test_index`.
"""

from __future__ import annotations

import numpy as np

from heliosweep.kernels.sun import solar_clock
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


def test_the_aim_of_equations_16_and_17_misses_by_what_the_table_says():
    """Section 3, in plain NumPy: the mirror 0.5 m before the pivot is left out of the aim, then put in step by step."""
    curves = shipped("deviation_curves")
    pivots = np.stack([curves[axis] for axis in "xyz"], axis=-1)[:, None] - [0.0, 0.0, 143.0]
    sun = solar_clock(np.radians(37.4), np.radians(23.45), curves["hour"].to_numpy())
    centre, missed = pivots + 0.0 * sun, []
    for _ in range(3):
        normal = sun - centre / np.linalg.norm(centre, axis=-1, keepdims=True)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        centre = pivots + 0.5 * normal
        ray = 2 * np.sum(normal * sun, axis=-1, keepdims=True) * normal - sun
        spot = centre - centre[..., 1:2] / ray[..., 1:2] * ray
        missed.append(float(np.linalg.norm(spot, axis=-1).max()))
    np.testing.assert_allclose(missed, [0.41, 0.31e-3, 0.3e-6], rtol=0.1)
