"""Frames, the Jacobian and rays of backward gazing."""

import numpy as np
import pytest

from heliosweep.kernels.gazing.geometry import EXACT, camera_square, scene, transfers
from tests.kernels.gazing import twin


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
        found = np.sqrt(twin.ideal_squares(layout, np.zeros((2, 1)))[camera, 0])
        assert 1e3 * found == pytest.approx(angle, rel=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cameras": [[0.0, 0.1], [0.0, 0.2], [0.0, 0.3], [0.0, 0.4]]}, "collinear"),
        ({"cameras": [[0.1, 0.1], [0.2, 0.2], [0.3, 0.3], [0.4, 0.4]]}, "collinear"),
        ({"cameras": [[0.1, 0.1]] * 4}, "collinear"),
        ({"cameras": [[0.1, 0.1], [0.2, 0.3]]}, "at least 3"),
        ({"cameras": [[np.nan, 0.1], [0.2, 0.3], [0.3, 0.1]]}, "finite"),
        ({"target": (0.0, np.nan)}, "finite"),
        ({"distance": 0.0}, "positive"),
        ({"focal_length": -1.0}, "positive"),
        ({"sun": (np.pi, -0.5), "target": (0.0, 0.5)}, "opposite"),
        ({"target": (0.0, np.radians(-60.0))}, "collinear"),  # seen edge-on: gaze within the plane of the target
    ],
)
def test_scenes_that_are_none(change, message):
    given = {"sun": (0.5, 1.0), "target": (0.0, 0.8), "cameras": camera_square(0.24)} | change
    with pytest.raises(ValueError, match=message):
        scene(**given)
