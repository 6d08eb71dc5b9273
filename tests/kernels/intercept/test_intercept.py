"""Intercepts: a table of converged values, rays traced one by one, and what must hold for any receiver."""

from __future__ import annotations

import csv
import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import erf, ndtr
from scipy.stats import ncx2

from heliosweep.kernels import sunshapes
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION
from heliosweep.kernels.intercept import hflcal, tables
from heliosweep.kernels.intercept import light as lights
from heliosweep.kernels.intercept.course import course
from heliosweep.kernels.intercept.efficiency import ERROR, Scene, gauss_rules, intercepts, sun_tables
from heliosweep.kernels.intercept.mirror import Errors, Facets
from heliosweep.kernels.intercept.outline import SIGHT, STRAIGHT, WEIGHT, empty_outline, panels_of, within
from heliosweep.kernels.intercept.receivers import cylinder, rectangle
from heliosweep.kernels.sun import clock
from heliosweep.kernels.vectors import ROW
from tests.kernels.intercept.rays import traced

with (Path(__file__).parents[2] / "data" / "intercept_oracle.csv").open(encoding="utf-8") as _file:
    CASES = list(csv.DictReader(line for line in _file if not line.startswith("#")))
WHOLE = Facets(1, 1, 0.0)
SHAPES = {
    "pillbox": sunshapes.pillbox, "gaussian": sunshapes.gaussian, "jose": sunshapes.jose,
    "limb": sunshapes.limb_darkened,
}  # fmt: skip


@cache
def tables_of(radius: bytes, share: bytes, variance: float, *errors: float) -> Any:
    """Those of a sun and of errors, which are of many scenes."""
    sun = sunshapes.SunShape(np.frombuffer(radius), np.frombuffer(share), variance)
    return sun_tables(sun, Errors(*errors))


def scene(
    receiver: Any, sun: Any, place: Any = (80.0, 300.0, 5.0), aim: Any = None, errors: Any = (1.5e-3, 1.5e-3, 0.0),
    sides: Any = (10.0, 8.0), curve: float = 0.0, cant: float = 0.0, turn: Any = (0.0, 0.0),
    facets: Facets = WHOLE, tracking: int = AZIMUTH_ELEVATION,
) -> Scene:  # fmt: skip
    found, blurred = tables_of(sun.radius.tobytes(), sun.share.tobytes(), sun.variance, *errors)
    centre = np.atleast_2d(np.array(place, float))
    target = np.atleast_2d(np.array(receiver.centre if aim is None else aim, float)) + 0 * centre
    many = np.ones((len(centre), 1))
    return Scene(
        centre, target, many * sides, (many * curve)[:, 0], (many * cant)[:, 0], many * turn, facets, tracking, blurred,
        receiver, found,
    )  # fmt: skip


def direction(azimuth: float, elevation: float) -> np.ndarray:
    a, e = np.radians([azimuth, elevation])
    return np.array([[math.sin(a) * math.cos(e), math.cos(a) * math.cos(e), math.sin(e)]])


def oracle_case(row: dict[str, str]) -> tuple[Scene, np.ndarray]:
    number = {key: float(value) for key, value in row.items() if key not in ("facets", "shape", "receiver")}
    shape = row["shape"]
    sun = sunshapes.buie_formula(number["shape_parameter"]) if shape == "buie" else SHAPES[shape]()
    size, height = number["receiver_width_or_radius"], number["receiver_height"]
    centre = (0.0, 0.0, number["receiver_z"])
    azimuth, tilt = np.radians([number["receiver_azimuth"], number["receiver_tilt"]])
    flat = row["receiver"] == "rectangle"
    receiver = rectangle(centre, azimuth, tilt, size, height) if flat else cylinder(centre, size, height)
    curve = 0.5 / number["focal_length"] if number["focal_length"] else 0.0
    made = scene(
        receiver, sun, (number["x"], number["y"], number["z"]), (number["aim_x"], number["aim_y"], number["aim_z"]),
        (1e-3 * number["slope_u"], 1e-3 * number["slope_v"], 1e-3 * number["specularity"]),
        (number["width"], number["height"]), curve, curve if "on_axis" in row["facets"] else 0.0,
        (1e-3 * number["error_u"], 1e-3 * number["error_v"]),
        WHOLE if row["facets"] == "none" else Facets(5, 4, 0.05),
        SPINNING_ELEVATION if row["mount"] == "1" else AZIMUTH_ELEVATION,
    )  # fmt: skip
    return made, direction(number["sun_azimuth"], number["sun_elevation"])


def test_converged_values():
    for row in CASES:
        made, sun = oracle_case(row)
        wanted = float(row["intercept"])
        assert intercepts(made, sun)[0, 0] == pytest.approx(wanted, abs=1e-4), row["case"]
        assert intercepts(made, sun, fine=2.0)[0, 0] == pytest.approx(wanted, abs=1e-5), row["case"]


@pytest.mark.parametrize("tracking", [SPINNING_ELEVATION, AZIMUTH_ELEVATION])
@pytest.mark.parametrize("kind", ["rectangle", "cylinder"])
@pytest.mark.parametrize("mirror", ["flat", "focused", "facets"])
def test_rays_traced_one_by_one(mirror, kind, tracking):
    centre = np.array([120.0, 260.0, 4.0])
    receiver = (
        rectangle((0.0, 0.0, 110.0), 0.4, -0.2, 7.0, 8.0) if kind == "rectangle" else cylinder((0, 0, 110.0), 3.5, 8.0)
    )
    away = centre[:2] / np.hypot(*centre[:2])
    aim = np.array([*(3.5 * away if kind == "cylinder" else (0.0, 0.0)), 110.0])
    curve, facets = (0.0 if mirror == "flat" else 0.5 / 310.0), (Facets(3, 2, 0.1) if mirror == "facets" else WHOLE)
    made = scene(
        receiver, sunshapes.pillbox(), centre, aim, (1.8e-3, 2.2e-3, 0.4e-3), curve=curve,
        cant=curve if mirror == "facets" else 0.0, turn=(0.7e-3, -0.4e-3), facets=facets, tracking=tracking,
    )  # fmt: skip
    sun = direction(230.0, 35.0)
    wanted = traced(made, 0, sun[0], 18)[1].mean()
    assert 0.3 < wanted < 0.99
    assert intercepts(made, sun)[0, 0] == pytest.approx(wanted, abs=5e-4)


@pytest.mark.parametrize("kind", ["rectangle", "cylinder"])
def test_the_usual_nodes_are_enough(kind):
    """Against three times the nodes, for random mirrors, errors and suns: the stated error is never exceeded."""
    rng = np.random.default_rng(7)
    for _ in range(12):
        sun = [sunshapes.pillbox(), sunshapes.limb_darkened(), sunshapes.buie(0.03)][rng.integers(3)]
        far, turn, size = rng.uniform(60, 900), rng.uniform(-1, 1), rng.uniform(2, 8)
        aim = (0.0, 0.0, 110.0)
        receiver = (
            rectangle(aim, 0.0, -0.2, 2 * size, 2 * size) if kind == "rectangle" else cylinder(aim, size, 2 * size)
        )
        errors = (*rng.uniform(0.3e-3, 2.5e-3, 2), rng.uniform(0, 1e-3))
        made = scene(
            receiver, sun, (far * math.sin(turn), far * math.cos(turn), 5.0), errors=errors,
            sides=rng.uniform(3, 12, 2),
            curve=rng.choice([0.0, 0.5 / far, 1e-3]), tracking=int(rng.integers(2)),
        )  # fmt: skip
        at = np.concatenate([direction(rng.uniform(60, 300), rng.uniform(5, 80)) for _ in range(3)])
        np.testing.assert_allclose(intercepts(made, at), intercepts(made, at, fine=3.0), atol=ERROR)


@pytest.mark.parametrize("sun", [sunshapes.pillbox(), sunshapes.buie(0.05)])
def test_halves_make_the_whole_and_larger_receivers_take_more(sun):
    at = direction(150.0, 40.0)
    upward = np.array(rectangle((0.0, 0.0, 100.0), 0.1, -0.3, 4.0, 6.0).upward)
    parts = [
        rectangle(tuple(np.array([0.0, 0.0, 100.0]) + side * 1.5 * upward), 0.1, -0.3, 4.0, 3.0) for side in (-1, 1)
    ]
    aim = (0.0, 0.0, 100.0)
    whole = intercepts(scene(rectangle(aim, 0.1, -0.3, 4.0, 6.0), sun), at)[0, 0]
    assert sum(intercepts(scene(part, sun, aim=aim), at)[0, 0] for part in parts) == pytest.approx(whole, abs=3e-5)
    lower, upper = (cylinder((0.0, 0.0, z), 3.0, 4.0) for z in (98.0, 102.0))
    aim = (0.8, 2.9, 100.0)
    whole = intercepts(scene(cylinder((0.0, 0.0, 100.0), 3.0, 8.0), sun, aim=aim), at)[0, 0]
    assert sum(intercepts(scene(part, sun, aim=aim), at)[0, 0] for part in (lower, upper)) == pytest.approx(
        whole, abs=3e-5
    )
    sizes = [1.0, 2.0, 4.0, 8.0, 16.0]
    for make in (lambda w: rectangle((0, 0, 100.0), 0.1, 0.0, w, w), lambda w: cylinder((0, 0, 100.0), w / 2, w)):
        found = [intercepts(scene(make(size), sun), at)[0, 0] for size in sizes]
        assert np.all(np.diff(found) > 0)
        assert intercepts(scene(make(150.0), sun), at)[0, 0] == pytest.approx(1.0, abs=1e-6)


def test_a_gaussian_sun_on_a_face_square_to_the_ray_is_a_product_of_error_functions():
    """The mirror is small and looks back to the sun, so that the light is round."""
    place, aim = np.array([0.0, 400.0, 0.0]), np.array([0.0, 0.0, 100.0])
    back = (aim - place) / np.linalg.norm(aim - place)
    receiver = rectangle(tuple(aim), 0.0, -math.asin(back[2]), 3.0, 5.0)
    made = scene(receiver, sunshapes.gaussian(), place, errors=(1e-3, 1e-3, 0.5e-3), sides=(1e-3, 1e-3))
    sigma = math.sqrt(2.73e-3**2 + 4 * 1e-6 + 0.25e-6) * np.linalg.norm(aim - place)
    wanted = erf(1.5 / sigma / math.sqrt(2)) * erf(2.5 / sigma / math.sqrt(2))
    assert intercepts(made, back[None])[0, 0] == pytest.approx(wanted, abs=1e-5)
    plain = made._replace(errors=Errors(1e-3, 1e-3, 0.5e-3))
    quick = hflcal.intercepts(plain, sunshapes.gaussian().spread, back[None])
    assert quick[0, 0] == pytest.approx(wanted, abs=1e-5)


def test_a_receiver_seen_along_its_face_against_rays():
    """Some parts of the mirror are behind the face, and send it nothing."""
    receiver = rectangle((0.0, 0.0, 110.0), 0.0, math.radians(-10.0), 12.0, 12.0)
    for place in ((77.3, -18.3, 6.0), (58.4, -13.8, 6.0)):
        made = scene(receiver, sunshapes.pillbox(), place, curve=1 / 300, sides=(11.0, 11.0))
        for azimuth in (120.0, 180.0, 230.0):
            sun = direction(azimuth, 40.0)
            hits = traced(made, 0, sun[0], 15)[1]
            assert intercepts(made, sun)[0, 0] == pytest.approx(hits.mean(), abs=4e-3)


@pytest.mark.parametrize(("x", "y", "part"), [(0, 0, 1.0), (1, 0, 0.5), (0, -1, 0.5), (-1, 0, 0.5), (1, 1, 0.25)])
def test_rays_that_meet_an_edge_or_a_corner(x, y, part):
    """Of a point of a mirror that looks back to the sun; the receiver is many times as large as the image."""
    centre = np.array([20.0 * x, 0.0, 20.0 * y])
    made = scene(
        rectangle(tuple(centre), 0.0, 0.0, 40.0, 40.0), sunshapes.pillbox(), (0.0, 300.0, 0.0), (0.0, 0.0, 0.0),
        sides=(1e-9, 1e-9),
    )  # fmt: skip
    for turn in [(0.0, 0.0), (1e-17, 0.0), (-1e-17, 1e-17)]:
        turned = made._replace(turn=np.array([turn]))
        found = intercepts(turned, np.array([[0.0, -1.0, 1e-12]]))[0, 0]
        assert found == pytest.approx(part, abs=1e-6), turn


def test_seen_from_behind_and_at_night():
    at = np.concatenate((direction(180.0, 40.0), direction(180.0, -5.0)))
    made = scene(rectangle((0.0, 0.0, 100.0), math.pi, 0.0, 9.0, 9.0), sunshapes.pillbox())
    found = intercepts(made, at)[0]
    assert found[0] == 0.0
    assert np.isnan(found[1])


@pytest.mark.parametrize("sun", [sunshapes.pillbox(), sunshapes.limb_darkened(), sunshapes.buie_formula(0.05)])
def test_light_beyond_a_line(sun):
    """Of light that is blurred more along one axis: its projection on the line's normal has one dimension."""
    made = tables.tables(sun, (1e-6, 16e-6), (9e-6, 16e-6))
    series, far, weights = (np.zeros(each) for each in (made.light.shape[2:], made.far.shape[2], made.reach.shape[1]))
    places, outline = np.zeros(lights.ROWS), empty_outline()
    outline.panel[:4] = STRAIGHT
    for row, ones in ((WEIGHT, 1), (SIGHT + ROW, 8), (SIGHT + 5 * ROW, 8), (SIGHT + 9 * ROW, 8)):  # x is c, y is s
        outline.lanes[row : row + ones] = 1.0
    turns, limit = np.pi * (np.arange(400) + 0.5) / 400, 1e-5 if sun.radius.max() < 0.01 else 3e-5  # of an aureole
    for small, large in ((1.1e-6, 9.1e-6), (4e-6, 12e-6), (15e-6, 15e-6)):
        band = lights.weigh(made, small, large, weights)
        reach, count = lights.extent(made, band, weights, 1e-6)
        lights.collapse(made, band, weights, count, series, far)
        shape = made.radius[band], made.bend[band], reach, 0.5 * math.sqrt(small), places
        light = lights.Light(series, far, made.blocks, band, count, *shape)
        assert small == large or count > 4
        along, across, _, _ = tables.stretched(small, large, made.core)
        panels = panels_of(light, outline.breaks)
        for turn in (0.0, 0.5, 1.2, math.pi / 2):
            normal = np.array([math.cos(turn), math.sin(turn)])
            sigma = math.sqrt(large * normal[0] ** 2 + small * normal[1] ** 2)
            for apart in (1e-4, 2e-3, 4.5e-3, 8e-3):
                side = 0.2 * np.array([-normal[1], normal[0]])
                ends = [apart * normal + side, apart * normal - side]
                ends += [ends[1] + 0.2 * normal, ends[0] + 0.2 * normal]
                outline.corners[:2, :4] = (np.array(ends) * (along, across)).T
                found = within(outline, 4, 0, panels, 8, light, gauss_rules(3.0))
                across_line = sun.radius[:, None] * np.cos(turns)
                wanted = np.sum(sun.share[:, None] * ndtr((across_line - apart) / sigma)) / len(turns)
                assert found == pytest.approx(wanted, abs=limit), (small, large, turn, apart)
        if small == large:
            at = np.linspace(1e-4, 0.99 * reach, 32)
            places[lights.X : lights.X + 32], places[lights.Y : lights.Y + 32] = at, 0.0
            places[lights.PART : lights.PART + 32] = at * at
            lights.look_up(light, 32)
            wanted = [np.sum(sun.share * ncx2.cdf(d * d / small, 2, sun.radius**2 / small)) for d in at]
            np.testing.assert_allclose(places[lights.RESULT : lights.RESULT + 32], wanted, atol=1e-6)


def test_the_ratio_of_buie_is_the_one_asked_for():
    for parameter, ratio in ((0.02, 0.0058), (0.05, 0.0431), (0.1, 0.1003)):
        shape = sunshapes.buie_formula(parameter)
        assert np.sum(shape.share[shape.radius > sunshapes.DISC]) == pytest.approx(ratio, abs=5e-5)
    for ratio in (0.001, 0.05, 0.4, 0.8):
        shape = sunshapes.buie(ratio)
        assert np.sum(shape.share[shape.radius > sunshapes.DISC]) == pytest.approx(ratio, rel=1e-6)
    with pytest.raises(ValueError, match=r"0\.001"):
        sunshapes.buie(0.0)


def test_a_course_is_near_the_intercepts_themselves(monkeypatch):
    days, hours = (each.ravel() for each in np.meshgrid(np.arange(1, 366, 7), np.arange(0.5, 24), indexing="ij"))
    sun = clock.solar_clock(0.6, clock.declination_cooper(days), hours)
    places = [(150.0, 200.0, 5.0), (-300.0, 200.0, 5.0)]
    made = scene(rectangle((0, 0, 110.0), 0.0, -0.2, 6.0, 6.0), sunshapes.pillbox(), places, curve=1 / 600)
    exact = intercepts(made, sun)
    found, error = course(made, sun, 0.6)
    assert np.all((error > 0) & (error <= 1e-4))
    assert not np.array_equal(found, exact, equal_nan=True)
    np.testing.assert_allclose(found, exact, atol=3e-4)
    alone = course(made.some(np.array([1])), sun, 0.6)[0]
    np.testing.assert_array_equal(alone, found[1:2])  # no mirror depends on the others
    np.testing.assert_array_equal(course(made, sun, None)[0], exact)
    monkeypatch.setattr("heliosweep.kernels.intercept.course.TOLERANCE", 0.0)
    found, error = course(made, sun, 0.6)
    np.testing.assert_array_equal(found, exact)
    assert np.all(error == 0)


@pytest.mark.parametrize(("sides", "turn"), [((4.0, 4.0), 0.0), ((5.0, 3.0), 0.0), ((4.0, 4.0), 5e-4)])
def test_a_mirror_that_turns_fast_near_the_zenith(sides, turn):
    days, hours = (each.ravel() for each in np.meshgrid(np.arange(1, 366), np.arange(0.5, 24), indexing="ij"))
    sun = clock.solar_clock(0.6, clock.declination_cooper(days), hours)
    made = scene(
        cylinder((0.0, 0.0, 110.0), 7.0, 14.0), sunshapes.limb_darkened(), (-300.0, 60.0, 5.0), sides=sides,
        curve=1 / 600, turn=(turn, -turn),
    )  # fmt: skip
    aim = np.array([0.0, 0.0, 110.0]) - made.centre[0]
    normal = sun[sun[:, 2] > 0] + aim / np.linalg.norm(aim)
    assert (np.hypot(*normal.T[:2]) / normal[:, 2]).min() < 0.1
    found, error = course(made, sun, 0.6)
    assert 0 < error[0] <= 1e-4
    np.testing.assert_allclose(found, intercepts(made, sun), atol=3e-4)
