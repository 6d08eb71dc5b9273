"""The square of a test mirror where light is low: turned by right angles, until it stands upright."""

import numpy as np
import pytest

from heliosweep.kernels.field.efficiency import aimed
from heliosweep.kernels.field.images import AXES_ROWS, LOW_RISE, axes, turn_upright
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, FRAME_ROWS, SPINNING_ELEVATION, half_sides
from heliosweep.kernels.vectors import PACKET, ROW, rows
from tests.kernels.field.fields import suns


@pytest.mark.parametrize("tracking", [SPINNING_ELEVATION, AZIMUTH_ELEVATION])
@pytest.mark.parametrize("height", [30.0, 300.0])
def test_what_rises_most_is_above_where_light_is_low(tracking, height):
    rng = np.random.default_rng(4)
    turned = 0
    for _ in range(20):
        x, y = rng.uniform(-300.0, 300.0, (2, 1))
        mirror = aimed(x, y, np.zeros(1), np.full(1, 6.0), np.full(1, 5.0), height)
        sun = suns(rng, PACKET, 1.0, 40.0)
        to_sun, frame, views = rows(3), rows(FRAME_ROWS), rows(AXES_ROWS)
        to_sun.reshape(3, ROW)[:, :PACKET] = sun.T
        half_sides(frame, 0, to_sun, 0, mirror, 0, tracking, PACKET)
        axes(views, frame, 0, to_sun, PACKET)
        before = views.copy()
        turn_upright(views, frame, 0, to_sun, mirror.aim[0, 2], PACKET)
        low = np.minimum(sun[:, 2], mirror.aim[0, 2]) < LOW_RISE
        lanes = np.arange(PACKET)
        np.testing.assert_array_equal(views.reshape(-1, ROW)[:, lanes[~low]], before.reshape(-1, ROW)[:, lanes[~low]])
        sides = frame[: 6 * ROW].reshape(2, 3, ROW)[:, :, lanes[low]]
        seen = np.einsum("ack,bck->abk", sides, views.reshape(2, 3, ROW)[:, :, lanes[low]])  # of each side, its x and y
        np.testing.assert_allclose(np.abs(seen).round(), np.abs(seen), atol=1e-9)
        np.testing.assert_allclose(seen[0, 0] * seen[1, 1] - seen[0, 1] * seen[1, 0], 1.0, atol=1e-9)
        rise = sides[:, 2]
        above = np.abs(rise).argmax(axis=0)
        there, of_rise = seen[above, 1, np.arange(len(above))], rise[above, np.arange(len(above))]
        np.testing.assert_allclose(there, np.sign(of_rise), atol=1e-9)
        turned += int((above == 0).sum())
    assert (turned > 0) == (tracking == SPINNING_ELEVATION)
