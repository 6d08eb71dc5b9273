"""Rays against converged intercepts of single heliostats, published powers and closed forms."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from heliosweep.kernels import rays, sunshapes
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION
from tests.kernels.rays.scenes import direction, scene

_DATA = Path(__file__).parents[2] / "data"
with (_DATA / "intercept_oracle.csv").open(encoding="utf-8") as _file:
    CASES = list(csv.DictReader(line for line in _file if not line.startswith("#")))
SHAPES = {
    "pillbox": sunshapes.pillbox, "gaussian": sunshapes.gaussian, "jose": sunshapes.jose,
    "limb": sunshapes.limb_darkened,
}  # fmt: skip
_MOST = 2**19


def intercept(made, sun, rays_each=_MOST, seed=0):
    """Part of the light of one mirror that meets the receiver, and its standard error."""
    mean, error = rays.mean_error(rays.trace(made, sun, rays=rays_each, seed=seed).sums[:, 0, 0])
    return mean[rays.HIT] / mean[rays.COSINE], error[rays.HIT] / mean[rays.COSINE]


@pytest.mark.parametrize("row", CASES, ids=lambda row: row["case"])
def test_converged_values(row):
    number = {key: float(value) for key, value in row.items() if key not in ("facets", "shape", "receiver")}
    sun = sunshapes.buie_formula(number["shape_parameter"]) if row["shape"] == "buie" else SHAPES[row["shape"]]()
    size, height = number["receiver_width_or_radius"], number["receiver_height"]
    centre = (0.0, 0.0, number["receiver_z"])
    azimuth, tilt = np.radians([number["receiver_azimuth"], number["receiver_tilt"]])
    flat = row["receiver"] == "rectangle"
    curve = 0.5 / number["focal_length"] if number["focal_length"] else 0.0
    made = scene(
        rays.rectangle(centre, azimuth, tilt, size, height) if flat else rays.cylinder(centre, size, height),
        place=(number["x"], number["y"], number["z"]), aim=(number["aim_x"], number["aim_y"], number["aim_z"]),
        errors=1e-3 * np.array([number["slope_u"], number["slope_v"], number["specularity"]]), sun=sun,
        sides=(number["width"], number["height"]), curve=curve, cant=curve if "on_axis" in row["facets"] else 0.0,
        turn=(1e-3 * number["error_u"], 1e-3 * number["error_v"]),
        facets=(1, 1, 0.0) if row["facets"] == "none" else (5, 4, 0.05),
        tracking=SPINNING_ELEVATION if row["mount"] == "1" else AZIMUTH_ELEVATION,
    )  # fmt: skip
    found, error = intercept(made, direction(number["sun_azimuth"], number["sun_elevation"]))
    assert found == pytest.approx(float(row["intercept"]), abs=3.0 * error + 1e-4)
    assert error < 6e-4


def test_round_robin():
    # Round robin of SolTrace, Solstice and TieSOL, phase I: doi 10.1016/j.solener.2025.113785, data doi
    # 10.5281/zenodo.15580027. Task, position, focal length in m, converged intercept, power in kW.
    cases = [
        ("1a", "N", 0, 0.849936, 84.9788), ("1b", "N", 526.007, 0.990732, 99.0560), ("2", "N", 0, 0.849158, 82.6000),
        ("3", "N", 0, 0.989071, 96.2096), ("4", "N", 526.007, 0.990729, 96.3710), ("1a", "SE", 0, 0.929927, 74.7098),
        ("1b", "SE", 333.333, 0.999980, 80.3377), ("2", "SE", 0, 0.929242, 72.6314), ("3", "SE", 0, 0.999951, 78.1580),
        ("4", "SE", 526.007, 0.999978, 78.1602),
    ]  # fmt: skip
    for task, position, focal, wanted, power in cases:
        x, y = (0.0, 500.0) if position == "N" else (200.0, -200.0)
        far = math.dist((x, y, 5.65), (0.0, 0.0, 169.0))
        receiver = rays.rectangle((0.0, 0.0, 169.0), math.atan2(x, y), 0.0, 12.0, 18.0)
        made = scene(
            receiver, place=(x, y, 5.65), errors=(2e-3, 2e-3, 0.0), sun=sunshapes.pillbox(), sides=(11.415, 10.42),
            curve=0.5 / focal if focal else 0.0, cant=0.5 / far if task in "34" else 0.0,
            facets=(1, 1, 0.0) if task[0] == "1" else (7, 5, 0.03),
        )  # fmt: skip
        sun = np.array([[0.0, -0.500548, 0.865709]])
        found, error = intercept(made, sun / np.linalg.norm(sun))
        assert found == pytest.approx(wanted, abs=3.0 * error + 1e-4), (task, position)
        area = 11.415 * 10.42 if task[0] == "1" else 35 * 1.605 * 2.06
        cosine = rays.trace(made, sun / np.linalg.norm(sun), rays=16).sums[0, 0, 0, rays.COSINE]
        assert 0.9 * area * cosine * found == pytest.approx(power, rel=3.0 * error + 3e-4), (task, position)
