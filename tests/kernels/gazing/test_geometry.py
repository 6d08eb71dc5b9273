"""Frames, the Jacobian and rays of backward gazing."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from heliosweep.kernels.compiled import kernel
from heliosweep.kernels.gazing.geometry import EXACT, camera_square, ideal_mirror, mirror_offsets, scene, transfers
from tests.kernels.gazing import twin
from tests.kernels.gazing.twin import camera_ray, sun_offsets

AZIMUTH, ELEVATION = st.floats(-170.0, 170.0), st.floats(5.0, 85.0)


@kernel
def offsets_at(layout, camera, p_y, p_z, y, z):
    return sun_offsets(layout, camera, p_y, p_z, y, z)


@kernel
def parts_at(layout, camera, p_y, p_z, y, z):
    x, a, b = ideal_mirror(layout.focal_length, y, z)
    rx, ry, rz = camera_ray(layout.eyes, camera, x, y, z)
    return mirror_offsets(a + p_y, b + p_z, rx, ry, rz, layout.sun_y, layout.sun_z)


def some_scene(sun, target):
    layout = twin.paper_scene(sun, target)
    assume(layout.incidence < 1.4)
    return layout


def jacobian(layout):
    """Change of the wavefront slopes with the mirror slopes."""
    return np.linalg.inv(transfers(layout)[EXACT])


def test_oracle():
    """backward_gazing_oracle.csv of the reference data: geometry of the paper's study."""
    layout = twin.paper_scene()
    normal = layout.mirror_axes[0]
    assert np.degrees(layout.incidence) == pytest.approx(12.033088403, rel=1e-9)
    assert np.degrees(np.arctan2(normal[1], normal[0])) == pytest.approx(12.240491117, rel=1e-9)
    assert np.degrees(np.arcsin(normal[2])) == pytest.approx(52.92749111, rel=1e-9)
    expected = [[1.9505707713, -0.294556665], [0.3383229761, 1.9545326126]]
    np.testing.assert_allclose(jacobian(layout), expected, rtol=1e-9)
    assert np.linalg.det(jacobian(layout)) == pytest.approx(3.912109473, rel=1e-9)
    np.testing.assert_allclose(1e3 * layout.gaze[0], [-1.4142135624, 1.3722053756], rtol=1e-9)
    for camera, angle in ((0, 1.9698418615), (3, 1.9711901985)):
        v, w = offsets_at(layout, camera, 0.0, 0.0, 0.0, 0.0)[:2]
        assert 1e3 * np.hypot(v, w) == pytest.approx(angle, rel=1e-9)


@given(
    AZIMUTH, ELEVATION, AZIMUTH, ELEVATION,
    st.floats(-3e-3, 3e-3), st.floats(-3e-3, 3e-3), st.floats(-5.0, 5.0), st.floats(-5.0, 5.0),
)  # fmt: skip
def test_offsets_are_those_of_vectors_in_space(sa, sh, ta, th, p_y, p_z, y, z):
    layout = some_scene((sa, sh), (ta, th))
    points, normals = twin.series(np.array([y]), np.array([z]), 120.0, (p_y, p_z))
    for camera in range(4):
        found = np.array(offsets_at(layout, camera, p_y, p_z, y, z))
        np.testing.assert_allclose(found[:2], twin.offsets(layout, camera, points, normals)[0], atol=3e-15)
        np.testing.assert_array_equal(found, parts_at(layout, camera, p_y, p_z, y, z))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cameras": [[0.0, 0.1], [0.0, 0.2], [0.0, 0.3], [0.0, 0.4]]}, "in one line"),
        ({"cameras": [[0.1, 0.1], [0.2, 0.2], [0.3, 0.3], [0.4, 0.4]]}, "in one line"),
        ({"cameras": [[0.1, 0.1]] * 4}, "in one line"),
        ({"cameras": [[0.1, 0.1], [0.2, 0.3]]}, "at least 3"),
        ({"distance": 0.0}, "positive"),
        ({"focal_length": -1.0}, "positive"),
        ({"sun": (np.pi, -0.5), "target": (0.0, 0.5)}, "opposite"),
        ({"target": (0.0, np.radians(-60.0))}, "in one line"),  # seen edge-on: gaze within the plane of the target
    ],
)
def test_scenes_that_are_none(change, message):
    given = {"sun": (0.5, 1.0), "target": (0.0, 0.8), "cameras": camera_square(0.24)} | change
    with pytest.raises(ValueError, match=message):
        scene(**given)
