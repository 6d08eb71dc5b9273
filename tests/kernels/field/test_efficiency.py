"""The field kernels against the spec in plain Python, identities, symmetries and published values."""

import csv
import itertools
import tracemalloc
from collections.abc import Sequence

import numpy as np
import pytest

from heliosweep.kernels.field import packets as mounts
from heliosweep.kernels.field.efficiency import aimed, field_energies, field_series, field_sums, sorted_field
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION
from heliosweep.kernels.sun import declination_cooper, solar_clock
from heliosweep.kernels.vectors import PACKET
from heliosweep.layouts import radial_stagger
from tests.kernels.field.fields import DATA, Field, Floats, chong2012, directions, scattered, suns
from tests.kernels.field.oracles import instant

METHODS = pytest.mark.parametrize("tracking", [SPINNING_ELEVATION, AZIMUTH_ELEVATION])


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


@METHODS
@pytest.mark.parametrize(
    "made",  # spacings below, about and above the limit of the bounding spheres
    [row(), *(random_field(spacing) for spacing in (6.0, 9.0, 16.0))],
)
def test_fields_against_the_twin(tracking, made: tuple[Field, Floats, Sequence[int]]):
    field, sun, tests = made
    out = field_series(sorted_field(*field), tracking, sun, 0, len(field[0]))[:, :, tests]
    expected = [[instant(i, aimed(*field), tracking, s) for i in tests] for s in sun]
    np.testing.assert_allclose(out, np.transpose(expected, (2, 0, 1)), atol=1e-12, rtol=0)


@METHODS
def test_same_bits_for_any_split(tracking):
    rng = np.random.default_rng(8)
    field = scattered(rng, 80, 9.0)
    sun = np.concatenate((suns(rng, 150, -10.0, 80.0), suns(rng, 20, 0.1, 2.0)))
    sums, instants = field_sums(sorted_field(*field), tracking, sun, 0, 80)
    assert instants == np.count_nonzero(sun[:, 2] > 0.0)
    for edges in ([0, 1, 2, 50, 80], [0, 33, 80]):
        parts = [field_sums(sorted_field(*field), tracking, sun, a, b)[0] for a, b in itertools.pairwise(edges)]
        np.testing.assert_array_equal(np.concatenate(parts), sums)
    series = field_series(sorted_field(*field), tracking, sun, 0, 80)
    for edges in ([0, 1, 17, 170], [0, 100, 170]):
        parts = [field_series(sorted_field(*field), tracking, sun[a:b], 10, 40) for a, b in itertools.pairwise(edges)]
        np.testing.assert_array_equal(np.concatenate(parts, axis=1), series[:, :, 10:40])
    assert np.all(np.isnan(series[:, sun[:, 2] <= 0.0]))


@METHODS
def test_same_bits_where_frames_take_the_places_of_others(tracking):
    """Blocks of a large field, at the suns of one packet."""
    rng, layout = np.random.default_rng(3), radial_stagger(16.0, 61.3, heliostats=2_500)
    sun, half = directions(rng.uniform(119.0, 121.0, PACKET), rng.uniform(14.0, 15.0, PACKET)), np.full(2_500, 5.5)
    field = sorted_field(layout.x, layout.y, np.full(2_500, 7.0), half, half, 150.0)
    parts = [field_series(field, tracking, sun, start, start + 500) for start in range(0, 2_500, 500)]
    np.testing.assert_array_equal(np.concatenate(parts, axis=2), field_series(field, tracking, sun, 0, 2_500))


def test_memory_follows_the_images_and_not_the_candidates():
    """Two low suns in opposite directions over sloping ground: every heliostat may shade every other one."""
    x, y = (axis.ravel() for axis in np.meshgrid(15.0 * np.arange(40.0), 15.0 * np.arange(50.0)))
    half = np.full(2000, 5.0)
    field = sorted_field(x, y, 0.05 * x, half, half, 150.0)
    tracemalloc.start()
    try:
        series = field_series(field, AZIMUTH_ELEVATION, directions(np.array([90.0, 270.0]), np.ones(2)), 0, 40)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert np.isfinite(series).all()
    assert most < 50e6  # 2 GB with room for all candidates


@METHODS
def test_weighted_sums_over_periods_are_those_of_the_series(tracking):
    rng = np.random.default_rng(10)
    field, sun = scattered(rng, 40, 8.0), suns(rng, 200, -10.0, 80.0)
    weight, period = rng.random(200), rng.integers(0, 5, 200)
    sums = field_energies(sorted_field(*field), tracking, sun, 0, 40, weight, period, 5)
    cosine, shading, blocking, optical = np.nan_to_num(field_series(sorted_field(*field), tracking, sun, 0, 40))
    products = cosine * shading, cosine * shading * blocking, cosine
    rows = np.stack((cosine, shading, blocking, optical, *products)) * weight[:, np.newaxis]
    for each in range(5):
        np.testing.assert_allclose(sums[:, each], rows[:, period == each].sum(axis=1).T, rtol=1e-13)
    parts = [
        field_energies(sorted_field(*field), tracking, sun, a, b, weight, period, 5)
        for a, b in itertools.pairwise((0, 1, 17, 40))
    ]
    np.testing.assert_array_equal(np.concatenate(parts), sums)


@pytest.mark.parametrize("number", range(6))
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_mirrors_that_are_not_finite_are_refused(number, bad):
    x, y, z, width, height, target = (np.array(each, float) for each in chong2012())
    (x, y, z, width, height, target)[number].flat[-1] = bad
    with pytest.raises(ValueError, match="finite"):
        sorted_field(x, y, z, width, height, target.item())


@METHODS
def test_sun_at_the_zenith_and_behind_the_target(tracking):
    """Degenerate frames: the sun along r, a vertical normal, a mirror under the target."""
    x, y, z = np.array([[0.0, 1.0, 0.5], [0.0, 2.0, 1.0], [5.0, 9.0, 13.0]])
    field = x, y, z, np.full(3, 3.0), np.full(3, 2.0), 60.0
    sun = np.stack((np.array([0.0, 0.0, 1.0]), aimed(*field).aim[1]))
    out = field_series(sorted_field(*field), tracking, sun, 0, 3)
    expected = [[instant(i, aimed(*field), tracking, s) for i in range(3)] for s in sun]
    np.testing.assert_allclose(out, np.transpose(expected, (2, 0, 1)), atol=1e-12, rtol=0)
    np.testing.assert_allclose([out[0, 0, 0], out[0, 1, 1]], 1.0, atol=1e-15)
    assert (out[1] < 0.9).any(axis=1).all()  # at both instants one of them is shaded


@METHODS
def test_a_tower_shades_as_one_more_polygon(tracking):
    """Low and high suns, towers lower than mirrors to high above them, and mirrors in their shadows' sides and ends."""
    rng = np.random.default_rng(42)
    touched = np.int64(0)
    for radius, top in ((0.5, 40.0), (3.0, 12.0), (6.0, 60.0), (2.0, 4.0)):
        field = scattered(rng, 24, 9.0)
        away = np.arctan2(-field[0][:5], -field[1][:5]) + rng.normal(0.0, 0.02, 5)  # suns behind the tower
        sun = np.concatenate((directions(np.degrees(away), rng.uniform(2.0, 75.0, 5)), suns(rng, 3, 1.0, 80.0)))
        mirrors = sorted_field(*field, tower=(radius, top))
        out, bare = (field_series(made, tracking, sun, 0, 24) for made in (mirrors, sorted_field(*field)))
        plain = aimed(*field)
        expected = [[instant(i, plain, tracking, s, (radius, top)) for i in range(24)] for s in sun]
        np.testing.assert_allclose(out, np.transpose(expected, (2, 0, 1)), atol=1e-12, rtol=0)
        touched += np.count_nonzero(out[1] < bare[1] - 1e-3)
        sums = field_energies(mirrors, tracking, sun, 0, 24, np.ones(len(sun)), np.arange(len(sun)) % 3, 3)
        for i in range(0, 24, 4):  # the tower alone
            alone = sorted_field(*(each[i : i + 1] for each in field[:5]), field[5], (radius, top))  # type: ignore
            cosine, shading = field_series(alone, tracking, sun, 0, 1)[:2, :, 0]
            np.testing.assert_allclose(sums[i, :, 6].sum(), (cosine * shading).sum(), rtol=1e-12)
    assert touched > 20


def test_the_shadow_of_a_tower_has_the_area_of_a_cylinder():
    """One small mirror after another along the shadow: mean shade as of rays against the cylinder x^2 + y^2 < r^2."""
    radius, top, sun = 5.0, 50.0, directions(np.array([180.0]), np.array([35.0]))
    x, y = (each.ravel() for each in np.meshgrid(np.arange(-5.95, 6.0, 0.1), np.arange(20.0, 90.0, 0.2)))
    away = np.sqrt(np.maximum(radius**2 - x**2, 0.0))  # the ray to the sun enters the cylinder at y = away
    inside = (np.abs(x) < radius) & (1.0 + (y - away) * np.tan(np.radians(35.0)) < top)
    place = x, y, np.ones_like(x), np.full_like(x, 1e-3), np.full_like(x, 1e-3), 60.0
    shaded = 1.0 - field_series(sorted_field(*place, (radius, top)), AZIMUTH_ELEVATION, sun, 0, x.size)[1, 0]
    assert shaded.sum() == pytest.approx(inside.sum(), rel=2e-3)


def test_instants_of_an_independent_implementation():
    with (DATA / "chong2012_instants.csv").open() as file:
        for row in csv.DictReader(file):
            i, tracking = int(row["layout_id"]), getattr(mounts, row["tracking"].upper())
            day, hour, latitude = float(row["day"]), float(row["solar_hour"]), np.radians(float(row["latitude_deg"]))
            sun = solar_clock(latitude, declination_cooper(day), hour)
            cosine, unshaded, unblocked, optical = field_series(
                sorted_field(*chong2012()), tracking, sun[None], i, i + 1
            )[:, 0, 0]
            columns = ("cosine", "shaded_fraction", "blocked_fraction", "shaded_or_blocked_fraction")
            expected = [float(row[c]) for c in columns]
            np.testing.assert_allclose(
                [cosine, 1.0 - unshaded, 1.0 - unblocked, 1.0 - optical / cosine], expected, atol=1e-10, rtol=0
            )
