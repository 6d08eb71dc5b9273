"""The intercept of a field's mirrors from one table, against that of each mirror."""

import numpy as np
import pytest

from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION
from heliosweep.kernels.intercept import course, sunshapes
from heliosweep.kernels.intercept.efficiency import Scene, intercepts, sun_tables
from heliosweep.kernels.intercept.field_table import _reach, field_tables
from heliosweep.kernels.intercept.mirror import Errors, Facets
from heliosweep.kernels.intercept.receivers import cylinder, rectangle
from heliosweep.kernels.sun import clock

TOWER, RADIUS = 100.0, 6.0


def field(tracking, count=90, facets=None, canted=False, drop=0.0, levels=0.0, width=8.0, radius=RADIUS):
    """Mirrors all around a cylinder, on a slope or aimed at levels of its height where asked for."""
    turn, far = 2.4 * np.arange(count), np.linspace(60.0, 320.0, count)
    centre = np.stack((far * np.sin(turn), far * np.cos(turn), 5.0 + drop * np.cos(turn)), axis=1)
    target = np.full((count, 3), TOWER)
    target[:, :2] = radius * centre[:, :2] / far[:, np.newaxis]
    target[:, 2] += levels * (np.arange(count) % 3 - 1)
    slant, zero = np.sqrt(np.sum((target - centre) ** 2, axis=1)), np.zeros(count)
    found, errors = sun_tables(sunshapes.limb_darkened(), Errors(1.5e-3, 1.5e-3, 0.0))
    return Scene(
        centre, target, np.tile([width, 8.0], (count, 1)), 0.5 / slant, 0.5 / slant if canted else zero,
        np.zeros((count, 2)), facets or Facets(1, 1, 0.0), tracking, errors,
        cylinder((0.0, 0.0, TOWER), radius, 14.0), found,
    )  # fmt: skip


def year(step=3):
    days, hours = (each.ravel() for each in np.meshgrid(np.arange(1, 366, step), np.arange(0.5, 24), indexing="ij"))
    return clock.solar_clock(0.6, clock.declination_cooper(days), hours)


def truth(scene, sun, found, every=23):
    """Largest error at some instants, the lowest suns among them."""
    up = np.flatnonzero(sun[:, 2] > 0)
    some = np.union1d(up[::every], up[np.argsort(sun[up, 2])[:10]])
    return np.abs(found[:, some] - intercepts(scene, sun[some])).max(axis=1)


@pytest.mark.parametrize(
    ("tracking", "more"),
    [
        (SPINNING_ELEVATION, {}),
        (AZIMUTH_ELEVATION, {"count": 150}),
        (SPINNING_ELEVATION, {"width": 11.0, "facets": Facets(1, 2, 0.1), "canted": True}),
        (SPINNING_ELEVATION, {"count": 400, "drop": 8.0}),
        (SPINNING_ELEVATION, {"count": 400, "levels": 1.5}),
        (SPINNING_ELEVATION, {"count": 300, "radius": 3.0}),
    ],
)  # fmt: skip
def test_a_table_tells_of_all_mirrors(tracking, more):
    made, sun = field(tracking, **more), year()
    table = course.table_of(made, sun, 0.6)
    found, error = course.course(made, sun, 0.6, table=table)
    assert table is not None
    missed = course._looked_up(table, made, sun[sun[:, 2] > 0])[2]
    assert np.count_nonzero(missed) <= 0.1 * len(error)
    assert 0 < error.max() <= 1e-4
    some = np.linspace(0, len(error) - 1, 60).astype(int)
    assert truth(made.some(some), sun, found[some])[~missed[some]].max() < 1e-4
    assert np.ptp(found[:, sun[:, 2] > 0]) > 1e-3  # it has something to tell
    np.testing.assert_array_equal(np.isnan(found), np.repeat([sun[:, 2] <= 0], len(error), axis=0))


def test_no_mirror_depends_on_those_beside_it():
    made, sun = field(SPINNING_ELEVATION), year(7)
    table = course.table_of(made, sun, 0.6)
    whole = course.course(made, sun, 0.6, table=table)
    for start, stop in ((0, 1), (3, 70), (89, 90)):
        alone = course.course(made.some(np.arange(start, stop)), sun, 0.6, table=table)
        for n in range(2):
            np.testing.assert_array_equal(alone[n], whole[n][start:stop])


@pytest.mark.parametrize("other", ["sides", "turn"])
def test_no_mirror_depends_on_others_of_another_kind(other):
    made, sun = field(AZIMUTH_ELEVATION, count=12), year(7)
    getattr(made, other)[::8, 0] += 1e-4  # one that looks the same after fewer turns
    whole = course.course(made, sun, 0.6)
    for n in range(12):
        values, error = course.course(made.some(np.array([n])), sun, 0.6)
        np.testing.assert_array_equal(values[0], whole[0][n])
        assert error[0] == whole[1][n]


def test_directions_that_belong_to_no_place_are_looked_up_too():
    made, sun = field(SPINNING_ELEVATION), year(7)
    table = course.table_of(made, sun, 0.6)
    np.testing.assert_array_equal(
        course.course(made, sun, None, table=table)[0], course.course(made, sun, 0.6, table=table)[0]
    )


def test_what_a_table_misses_is_found_without():
    made, sun = field(SPINNING_ELEVATION), year(7)
    table = next(field_tables(made, sun[sun[:, 2] > 0]))[1]()
    wrong = table._replace(terms=table.terms * 0.99)
    for latitude in (0.6, None):
        some = made.some(np.arange(9))
        found, error = course.course(some, sun, latitude, wrong)
        without = course.course(some, sun, latitude)
        np.testing.assert_array_equal(found, without[0])
        np.testing.assert_array_equal(error, without[1])


def test_mirrors_that_differ_have_no_table():
    sun = year(7)
    up, made = sun[sun[:, 2] > 0], field(SPINNING_ELEVATION)
    sides, turn, target, curve = (each.copy() for each in (made.sides, made.turn, made.target, made.curve))
    sides[3, 0] += 0.1
    turn[3, 0] = 1e-4
    target[3, :2] *= -1.0
    target[4, 0] += 0.1
    curve[3] *= 1.1
    others = {"sides": sides, "turn": turn, "target": target, "curve": curve, "mounts": np.zeros((len(sides), 6))}
    others["receiver"] = rectangle((0.0, 0.0, TOWER), 0.0, 0.0, 9.0, 9.0)
    assert not list(field_tables(made.some(np.arange(4))._replace(slopes=np.zeros((4, 4, 2))), up))
    for name, value in others.items():
        assert not list(field_tables(made._replace(**{name: value}), up)), name
    assert list(field_tables(made, up))


def test_a_table_that_many_mirrors_miss_is_not_taken():
    # The edges of spots are at those of the receiver.
    made, sun = field(SPINNING_ELEVATION, count=1000, levels=6.5), year(14)
    assert list(field_tables(made, sun[sun[:, 2] > 0]))
    assert course.table_of(made, sun, 0.6) is None


def test_the_nodes_of_a_table_reach_to_the_horizon():
    """Beyond the nodes terms of Chebyshev grow fast: no sun may be there."""
    for rise in np.array([0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.8, 1.1, 1.4, 1.55]):
        for lowest in np.array([1e-6, 0.1, 0.25, 0.5]) * rise:
            aim = np.array([[0.0, np.cos(rise), np.sin(rise)]])
            middle, more = _reach(aim, lowest)[0]
            phi = np.linspace(0.0, np.pi, 2001)
            up, level = np.sin(rise), np.cos(rise) * np.cos(phi)
            theta = np.arctan2(level, up) + np.arccos(np.clip(np.sin(lowest) / np.hypot(up, level), -1.0, 1.0))
            assert np.all(np.tan(theta / 4) <= (middle + more * np.cos(phi)) * (1 + 1e-9)), (rise, lowest)


@pytest.mark.filterwarnings("error")
def test_fields_beside_a_target_that_is_not_above_them_have_no_table():
    """The farthest mirror, the highest and the lowest aim meet at one node of a table, if not in the field."""
    made, up = field(SPINNING_ELEVATION, count=200)._replace(curve=np.zeros(200)), year(7)
    made.centre[0, 2], made.target[100, 2] = 98.0, 94.0
    assert not list(field_tables(made, up[up[:, 2] > 0.35]))
    made.centre[0, 2], made.target[100, 2] = 80.0, 100.0
    some = next(field_tables(made, up[up[:, 2] > 0.35]))[1]()
    assert 0 < some.lowest < np.arctan2(20.0, 314.0)  # of that node


def test_a_receiver_that_no_light_meets():
    made = field(SPINNING_ELEVATION, count=200)
    made = made._replace(receiver=cylinder((0.0, 0.0, TOWER), 1e-6, 1e-6), curve=np.zeros(200))
    made.target[:, :2] *= 1e-6 / RADIUS
    table = course.table_of(made, year(7), 0.6)
    assert table is not None
    assert course.course(made, year(7), 0.6, table=table)[0][0, 12] < 1e-6


def test_few_mirrors_or_instants_have_no_table():
    made, sun = field(SPINNING_ELEVATION), year(7)
    assert course.table_of(made, sun[:200], 0.6) is not None
    assert course.table_of(made.some(np.arange(5)), sun, 0.6) is None
    assert course.table_of(made, sun[10:14], 0.6) is None
    many = field(SPINNING_ELEVATION, count=5000)
    assert course.table_of(many, sun[12:13], 0.6) is None  # an instant at which each mirror is checked
    assert course.table_of(made, -np.abs(sun), 0.6) is None
