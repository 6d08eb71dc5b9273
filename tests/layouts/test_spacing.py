"""Spacing that grows with the distance: DELSOL's fit, and no blocking, by the exact kernel."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from heliosweep.kernels.field import efficiency, packets
from heliosweep.layouts import radial_stagger
from heliosweep.layouts.patterns import Spacing, delsol_azimuthal, delsol_radial, no_blocking_radius


def test_delsol_as_published():
    # Kistler 1986, as SolarPILOT has it from the code of DELSOL3; texts print it with four digits.
    for t in np.linspace(0.1, 1.4, 14):
        assert delsol_radial(t, 1.0) == pytest.approx(1.144 / math.tan(t) - 1.094 + 3.068 * t - 1.1256 * t**2, abs=4e-3)
        assert delsol_azimuthal(t, 10.0) == pytest.approx(10 * (1.749 + 0.6396 * t) + 0.2873 / (t - 0.04902), abs=1e-2)
    assert delsol_radial(0.5, 1.0) == pytest.approx(2.253786, abs=1e-6)
    assert delsol_azimuthal(0.5, 1.0) == pytest.approx(2.132606, abs=1e-6)


def test_no_blocking_is_just_met():
    """Two mirrors on one azimuth with the sun behind the tower, seen from the farther one at the same elevation."""
    receiver, side, near = 80.0, 8.0, 150.0
    for far, blocked in ((no_blocking_radius(near, receiver, side), False), (None, True)):
        radius = 0.98 * no_blocking_radius(near, receiver, side) + 0.02 * near if far is None else far
        y = np.array([near, radius])
        sun = np.array([[0.0, -radius, receiver]]) / math.hypot(radius, receiver)
        half, ground = np.full(2, side / 2), np.zeros(2)
        field = efficiency.sorted_field(ground, y, ground, half, half, receiver)
        values = efficiency.field_series(field, packets.AZIMUTH_ELEVATION, sun, 0, 2)
        blocking = values[2][0, 1]
        assert (blocking < 1) == blocked


@settings(max_examples=30)
@given(
    rule=st.sampled_from(["delsol", "no_blocking"]), clearance=st.floats(0.2, 30), inner=st.floats(0.6, 3),
    height=st.floats(2, 14), width=st.floats(2, 14), rings=st.integers(2, 30),
)  # fmt: skip
def test_rings_keep_clearance_and_spacing(rule, clearance, inner, height, width, rings):
    receiver = 100.0
    spacing = Spacing(rule, receiver, width, height)
    start = max(inner * receiver, clearance)
    layout = radial_stagger(clearance, start, rings=rings, spacing=spacing)
    points = np.column_stack([layout.x, layout.y])
    assert KDTree(points).query(points, k=2)[0][:, 1].min() >= clearance * (1 - 1e-9)
    ring = layout.columns["ring"]
    radius = np.array([np.hypot(*points[ring == number].T).mean() for number in np.unique(ring)])
    steps = np.array([spacing.step(one) for one in radius])
    assert (np.diff(radius) >= steps[:-1] * (1 - 1e-9)).all()
    if rule == "no_blocking":  # two rings on, on the same azimuth where the zone is the same
        free = np.array([no_blocking_radius(one, receiver, height) for one in radius])
        assert (radius[2:] >= free[:-2] * (1 - 1e-9)).all()
    else:
        for number in np.unique(ring):
            azimuth = np.sort(layout.columns["azimuth"][ring == number])
            zone = radius[radius >= 0.7 * radius[number - 1]]  # the ring in which its zone begins is one of these
            least = min(delsol_azimuthal(spacing.elevation(one), width) for one in zone[zone <= radius[number - 1]])
            if azimuth.size > 2:
                chord = 2 * radius[number - 1] * math.sin(math.radians(np.diff(azimuth).min()) / 2)
                assert chord >= least * (1 - 1e-6)
