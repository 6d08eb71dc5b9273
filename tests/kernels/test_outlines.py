"""Outlines of shadows and blocked parts against shapely and against the areas that the field kernel measures."""

import numpy as np
import pytest
import shapely
from shapely.geometry import Polygon

from heliosweep.kernels.field.efficiency import aimed, mirror_outlines
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION
from tests.kernels.field.fields import Field, chong2012, directions, scattered
from tests.kernels.field.oracles import SQUARE, frame, image

METHODS = pytest.mark.parametrize("tracking", [SPINNING_ELEVATION, AZIMUTH_ELEVATION])
MANY = 40


def part(count: int) -> Field:
    """First heliostats of the paper's field."""
    x, y, z, half_width, half_height, target = chong2012()
    return x[:count], y[:count], z[:count], half_width[:count], half_height[:count], target


def polygons(found, i, e):
    """Outlines of one effect on one mirror, as shapely's polygons."""
    corners = (one[np.isfinite(one[:, 0])] for one in found.corners[i, e])
    return [Polygon(one) for one in corners if len(one)]


@METHODS
@pytest.mark.parametrize(
    "close", [False, True], ids=["paper's field", "mirrors that reach through each other's planes"]
)
def test_each_outline_is_shapely_s_image_within_the_mirror(tracking, close):
    rng = np.random.default_rng(3)
    field = scattered(rng, 25, 5.0) if close else part(80)
    mirrors, count = aimed(*field), len(field[0])
    centres = np.stack(field[:3], axis=1)
    sides = np.stack(field[3:5], axis=1)
    cut = 0
    for sun in directions(rng.uniform(0, 360, 3), [4.0, 11.0, 35.0]):
        found = mirror_outlines(*field, tracking, sun, 0, count, MANY)
        frames = [frame(r, sun, tracking) for r in mirrors.aim]
        for i in range(count):
            for e, direction in enumerate((sun, mirrors.aim[i])):
                near = mirrors.mounts[i, 5] if e else np.inf
                expected = {
                    j: shapely.affinity.scale(
                        image(i, j, direction, centres, frames, sides) & SQUARE, *sides[i], origin=(0, 0)
                    )
                    for j in range(count)
                    if j != i and (centres[j] - centres[i]) @ direction < near
                }
                expected = {j: one for j, one in expected.items() if one.area > 1e-9}
                drawn = polygons(found, i, e)
                names = found.heliostat[i, e, : len(drawn)].astype(int)
                seen = [one.area > 1e-9 for one in drawn]
                assert sorted(names[seen]) == sorted(expected)
                assert found.total[i, e] == len(drawn)
                for j, one, area in zip(names[seen], np.array(drawn)[seen], found.area[i, e], strict=False):
                    assert one.exterior.is_ccw
                    assert one.symmetric_difference(expected[j]).area < 1e-9
                    assert area == pytest.approx(one.area, abs=1e-9)
                    cut += len(one.exterior.coords) - 1 > 4
                assert (np.diff(found.area[i, e, : len(drawn)]) <= 0).all()
    assert cut > 0
