"""The field kernels against the spec in plain Python, identities, symmetries and published values."""

import csv
import itertools
from collections.abc import Sequence

import numpy as np
import pytest
import shapely
from shapely.geometry import Polygon

from heliosweep.kernels.field import packets as mounts
from heliosweep.kernels.field.efficiency import aimed, field_series, field_sums, sweep
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION, Mirrors, packet_order
from heliosweep.kernels.sun.clock import declination_cooper, solar_clock
from heliosweep.kernels.vectors import PACKET
from tests.kernels.field.fields import DATA, Field, Floats, chong2012, directions, scattered, suns
from tests.kernels.field.oracles import frame, instant

METHODS = pytest.mark.parametrize("tracking", [SPINNING_ELEVATION, AZIMUTH_ELEVATION])


def series_aimed(mirrors, tracking, sun):
    """Time series of mirrors with targets of their own."""
    out = np.full((4, len(sun), len(mirrors.x)), np.nan)
    sweep(mirrors, tracking, sun, *packet_order(sun), 0, len(mirrors.x), np.empty((0, 4)), out)
    return out


# --- against the plain twin ------------------------------------------------------------------------------------------


def random_field(spacing):
    rng = np.random.default_rng(1)
    return scattered(rng, 14, spacing), np.concatenate((suns(rng, 4, 1.0, 25.0), suns(rng, 4))), range(14)


def row():
    """Dozens of images overlap, with the sun at half a degree along a row."""
    x = np.arange(60.0) * 12.0 + 30.0
    field = (x, 0.003 * x, np.full(60, 5.0), np.full(60, 5.0), np.full(60, 5.0), 80.0)
    return (
        field,
        directions(np.array([90.0, 89.7, 91.0, 270.0, 180.0]), np.array([0.5, 0.5, 0.6, 0.5, 1.0])),
        [0, 1, 30, 59],
    )


def spoke():
    """Edges of mirror and images coincide: heliostats on one spoke, with the sun in its plane."""
    y = np.array([-60.0, -45.0, -30.0, 30.0, 45.0, 60.0, 75.0])
    field = (0.0 * y, y, np.full(7, 5.0), np.full(7, 5.0), np.full(7, 5.0), 60.0)
    return field, directions(np.array([180.0, 180.0, 0.0, 180.0]), np.array([5.0, 15.0, 10.0, 40.0])), range(7)


@METHODS
@pytest.mark.parametrize(
    "made",  # spacings below, about and above the limit of the bounding spheres
    [row(), spoke(), *(random_field(spacing) for spacing in (6.0, 9.0, 16.0))],
)
def test_fields_against_the_twin(tracking, made: tuple[Field, Floats, Sequence[int]]):
    field, sun, tests = made
    out = field_series(*field, tracking, sun, 0, len(field[0]))[:, :, tests]
    expected = [[instant(i, aimed(*field), tracking, s) for i in tests] for s in sun]
    np.testing.assert_allclose(out, np.transpose(expected, (2, 0, 1)), atol=1e-12, rtol=0)


# --- closed forms and identities -------------------------------------------------------------------------------------


def parallel(x, y, z, half_width, half_height, r):
    """Mirrors aimed at infinity along r."""
    count = len(x)
    radius = np.hypot(half_width, half_height)
    return Mirrors(x, y, z, half_width, half_height, radius, np.tile(r, (count, 1)), np.full(count, 1e30))


@METHODS
def test_two_heliostats_with_the_target_at_infinity(tracking):
    """Parallel mirrors: the images are squares, the loss is max(w - |qx|, 0) max(w - |qy|, 0) / w**2."""
    r, sun = directions(10.0, 40.0), directions(np.array([100.0, 130.0, 178.0]), np.array([20.0, 12.0, 8.0]))
    for s in sun:
        u, v, n = frame(r, s, tracking)
        for share in ((0.3, 0.2), (-0.9, 0.5), (0.0, 0.0), (1.2, 0.1)):
            # Place the occluder so that its image is shifted by these shares of the width.
            big_u, big_v = u - s @ u / (s @ n) * n, v - s @ v / (s @ n) * n
            offset = np.linalg.solve(np.stack((big_u, big_v, s)), [4.0 * share[0], 4.0 * share[1], 30.0])
            x, y, z = np.stack((np.array([50.0, 60.0, 9.0]), np.array([50.0, 60.0, 9.0]) + offset), axis=1)
            side = np.full(2, 2.0)
            out = series_aimed(parallel(x, y, z, side, side, r), tracking, s[None])
            loss = max(1.0 - abs(share[0]), 0.0) * max(1.0 - abs(share[1]), 0.0)
            np.testing.assert_allclose(out[1, 0], [1.0 - loss, 1.0], atol=1e-14, rtol=0)


@METHODS
@pytest.mark.parametrize("spacing", [7.0, 13.0])
def test_silhouettes(tracking, spacing):
    """What the mirrors intercept is the area of the union of their silhouettes, seen from the sun."""
    rng = np.random.default_rng(3)
    field = scattered(rng, 40, spacing)
    mirrors = aimed(*field)
    for s in suns(rng, 6, 2.0, 60.0):
        cosine, unshaded, _, _ = field_series(*field, tracking, s[None], 0, 40)[:, 0]
        intercepted = np.sum(4.0 * mirrors.half_width * mirrors.half_height * cosine * unshaded)
        across = np.array([-s[1], s[0], 0.0]) / np.hypot(s[0], s[1])
        up = np.cross(s, across)
        shapes = []
        for j in range(40):
            u, v, _ = frame(mirrors.aim[j], s, tracking)
            c = np.array([mirrors.x[j], mirrors.y[j], mirrors.z[j]])
            a, b = mirrors.half_width[j] * u, mirrors.half_height[j] * v
            shapes.append(Polygon([((c + f) @ across, (c + f) @ up) for f in (-a - b, a - b, a + b, b - a)]))
        np.testing.assert_allclose(intercepted, shapely.union_all(shapes).area, rtol=1e-12)


@METHODS
def test_reciprocity(tracking):
    """With the target at infinity the sun and the target can change places: shading becomes blocking."""
    rng = np.random.default_rng(4)
    x, y, z, width, height, _ = scattered(rng, 50, 9.0)
    for s, r in zip(suns(rng, 5, 5.0, 50.0), suns(rng, 5, 5.0, 50.0), strict=True):
        forth = series_aimed(parallel(x, y, z, width, height, r), tracking, s[None])
        back = series_aimed(parallel(x, y, z, width, height, s), tracking, r[None])
        np.testing.assert_allclose(forth[1], back[2], atol=1e-13, rtol=0)
        np.testing.assert_allclose(forth[2], back[1], atol=1e-13, rtol=0)


def test_cosine_is_the_same_for_both_methods():
    rng = np.random.default_rng(5)
    field, sun = chong2012(), suns(rng, 20)
    one, other = (field_series(*field, m, sun, 0, 317)[0] for m in (SPINNING_ELEVATION, AZIMUTH_ELEVATION))
    np.testing.assert_array_equal(one, other)
    np.testing.assert_allclose(one, np.sqrt((1.0 + sun @ aimed(*field).aim.T) / 2.0), atol=1e-15, rtol=0)


@METHODS
@pytest.mark.parametrize("east", [1.0, -1.0], ids=["southern hemisphere", "east and west"])
def test_mirror_symmetry(tracking, east):
    """The other hemisphere turns north and south; hours after noon for hours before it turn east and west."""
    rng = np.random.default_rng(6)
    x, y, z, width, height, target = scattered(rng, 60, 11.0)
    hours = np.linspace(6.5, 17.5, 12)
    there = solar_clock(0.6, -0.2, hours)
    other = solar_clock(0.6 * -east, -0.2 * -east, hours if east > 0.0 else 24.0 - hours)
    np.testing.assert_allclose(
        field_series(x, y, z, width, height, target, tracking, there, 0, 60),
        field_series(east * x, -east * y, z, width, height, target, tracking, other, 0, 60),
        atol=1e-13,
        rtol=0,
    )


# --- splits, edges of the domain -------------------------------------------------------------------------------------


@METHODS
def test_same_bits_for_any_split(tracking):
    rng = np.random.default_rng(8)
    field = scattered(rng, 80, 9.0)
    sun = np.concatenate((suns(rng, 150, -10.0, 80.0), suns(rng, 20, 0.1, 2.0)))
    sums, instants = field_sums(*field, tracking, sun, 0, 80)
    assert instants == np.count_nonzero(sun[:, 2] > 0.0)
    for edges in ([0, 1, 2, 50, 80], [0, 33, 80]):
        parts = [field_sums(*field, tracking, sun, a, b)[0] for a, b in itertools.pairwise(edges)]
        np.testing.assert_array_equal(np.concatenate(parts), sums)
    series = field_series(*field, tracking, sun, 0, 80)
    for edges in ([0, 1, 17, 170], [0, 100, 170]):
        parts = [field_series(*field, tracking, sun[a:b], 10, 40) for a, b in itertools.pairwise(edges)]
        np.testing.assert_array_equal(np.concatenate(parts, axis=1), series[:, :, 10:40])
    assert np.all(np.isnan(series[:, sun[:, 2] <= 0.0]))


@METHODS
def test_same_bits_in_a_packet_of_any_length(tracking):
    """Vector code and what is left over from it agree; low sun, close mirrors: every branch is taken."""
    rng = np.random.default_rng(12)
    mirrors, sun = aimed(*scattered(rng, 60, 6.0)), suns(rng, PACKET, 1.0, 20.0)
    whole = np.empty((4, PACKET, 60))
    sweep(mirrors, tracking, sun, np.arange(PACKET), np.array([0, PACKET]), 0, 60, np.empty((0, 4)), whole)
    for lanes in (1, 2, 3, 5, 7, 8, 15, 21, 63):
        part, first = np.empty_like(whole), np.append(np.arange(0, PACKET, lanes), PACKET)
        sweep(mirrors, tracking, sun, np.arange(PACKET), first, 0, 60, np.empty((0, 4)), part)
        np.testing.assert_array_equal(part, whole)


def in_eight_sums(values):
    """Sum along the second axis in the order of the kernel: eight sums side by side, and then what is left."""
    whole = values.shape[1] // 8 * 8
    a, b, c, d, e, f, g, h = np.zeros((8, 4, values.shape[2]))
    if whole:
        a, b, c, d, e, f, g, h = np.add.accumulate(values[:, :whole].reshape(4, -1, 8, values.shape[2]), 1)[
            :, -1
        ].swapaxes(0, 1)
    total = ((a + b) + (c + d)) + ((e + f) + (g + h))
    for k in range(whole, values.shape[1]):
        total = total + values[:, k]
    return total


def test_sums_are_sums_of_the_series_in_packet_order():
    rng = np.random.default_rng(9)
    field, sun = scattered(rng, 30, 9.0), suns(rng, 150, 1.0, 80.0)
    sums, _ = field_sums(*field, SPINNING_ELEVATION, sun, 0, 30)
    order, first = packet_order(sun)
    series = field_series(*field, SPINNING_ELEVATION, sun, 0, 30)[:, order]
    expected = np.zeros((4, 30))
    for a, b in itertools.pairwise(first):
        expected += in_eight_sums(series[:, a:b])
    np.testing.assert_array_equal(sums, expected.T)


def test_nothing_to_do():
    field, sun = chong2012(), directions(np.array([90.0]), np.array([-5.0]))
    assert field_sums(*field, 0, directions(np.array([90.0]), np.array([5.0])), 7, 7)[0].shape == (0, 4)
    sums, instants = field_sums(*field, 0, sun, 0, 5)
    assert instants == 0
    assert not sums.any()
    assert field_sums(*field, 0, np.empty((0, 3)), 0, 5)[1] == 0
    assert field_series(*field, 0, np.empty((0, 3)), 0, 5).shape == (4, 0, 5)
    assert np.isnan(field_series(*field, 0, sun, 0, 5)).all()


@pytest.mark.parametrize(("tracking", "start", "stop"), [(0, -1, 3), (0, 3, 2), (0, 0, 318), (2, 0, 3)])
def test_what_is_no_part_of_the_field_is_refused(tracking, start, stop):
    with pytest.raises(ValueError, match=r"part of a field|tracking"):
        field_sums(*chong2012(), tracking, directions(np.array([90.0]), np.array([5.0])), start, stop)


@pytest.mark.parametrize("number", range(6))
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_mirrors_that_are_not_finite_are_refused(number, bad):
    x, y, z, width, height, target = (np.array(each, float) for each in chong2012())
    (x, y, z, width, height, target)[number].flat[-1] = bad
    with pytest.raises(ValueError, match="finite"):
        field_sums(x, y, z, width, height, target.item(), SPINNING_ELEVATION, np.array([[0.0, 0.6, 0.8]]), 0, 317)


def test_other_mirrors_and_suns_that_mean_nothing_are_refused():
    x, y, z, half, _, height = chong2012()
    sun = np.array([[0.0, 0.6, 0.8]])
    at_target = np.zeros(317), np.zeros(317), np.full(317, height), half, half, height
    for field, suns_given in [
        ((x, y, z, half[1:], half[1:], height), sun),
        (at_target, sun),
        ((x, y, z, half, half, height), [[np.nan, 0.6, 0.8]]),
        ((x, y, z, half, half, height), sun[0]),
    ]:
        with pytest.raises(ValueError, match="finite"):
            field_sums(*field, SPINNING_ELEVATION, np.asarray(suns_given), 0, 317)


def test_efficiencies_stay_between_0_and_1():
    rng = np.random.default_rng(11)
    field, sun = scattered(rng, 60, 6.0), np.concatenate((suns(rng, 60, 0.1, 3.0), suns(rng, 60)))
    out = field_series(*field, AZIMUTH_ELEVATION, sun, 0, 60)
    assert out.min() >= 0.0
    assert out.max() <= 1.0
    assert np.all(out[3] <= out[0] * np.minimum(out[1], out[2]) + 1e-15)


@METHODS
def test_one_heliostat(tracking):
    one = np.array([30.0]), np.array([-40.0]), np.array([5.0]), np.array([4.0]), np.array([3.0]), 50.0
    out = field_series(*one, tracking, directions(np.array([0.0, 90.0]), np.array([30.0, 1e-9])), 0, 1)
    np.testing.assert_array_equal(out[1:3], 1.0)
    np.testing.assert_array_equal(out[0], out[3])


@METHODS
def test_sun_at_the_zenith_and_behind_the_target(tracking):
    """Degenerate frames: the sun along r, a vertical normal, a mirror under the target."""
    x, y, z = np.array([0.0, 0.0, 10.0]), np.array([0.0, 12.0, 12.0]), np.full(3, 5.0)
    side = np.full(3, 3.0)
    sun = np.stack((np.array([0.0, 0.0, 1.0]), aimed(x, y, z, side, side, 60.0).aim[1]))
    out = field_series(x, y, z, side, side, 60.0, tracking, sun, 0, 3)
    assert np.all(np.isfinite(out))
    np.testing.assert_allclose([out[0, 0, 0], out[0, 1, 1]], 1.0, atol=1e-15)
    assert np.all((out >= 0.0) & (out <= 1.0 + 1e-15))


@pytest.mark.parametrize("stray", [1e3, 1e6])
def test_field_with_a_stray_heliostat(stray):
    """The grid stays small and nothing changes for the others."""
    rng = np.random.default_rng(10)
    x, y, z, width, height, target = scattered(rng, 40, 9.0)
    sun = suns(rng, 10, 1.0, 30.0)
    x1, y1, z1 = np.append(x, stray), np.append(y, stray), np.append(z, 5.0)
    out = field_series(x, y, z, width, height, target, 0, sun, 0, 40)
    more = field_series(x1, y1, z1, np.append(width, 1.0), np.append(height, 1.0), target, 0, sun, 0, 40)
    np.testing.assert_allclose(more, out, atol=1e-13, rtol=0)


# --- published -------------------------------------------------------------------------------------------------------


def test_instants_of_an_independent_implementation():
    with (DATA / "chong2012_instants.csv").open() as file:
        for row in csv.DictReader(file):
            i, tracking = int(row["layout_id"]), getattr(mounts, row["tracking"].upper())
            day, hour, latitude = float(row["day"]), float(row["solar_hour"]), np.radians(float(row["latitude_deg"]))
            sun = solar_clock(latitude, declination_cooper(day), hour)
            cosine, unshaded, unblocked, optical = field_series(*chong2012(), tracking, sun[None], i, i + 1)[:, 0, 0]
            columns = ("cosine", "shaded_fraction", "blocked_fraction", "shaded_or_blocked_fraction")
            expected = [float(row[c]) for c in columns]
            np.testing.assert_allclose(
                [cosine, 1.0 - unshaded, 1.0 - unblocked, 1.0 - optical / cosine], expected, atol=1e-10, rtol=0
            )
