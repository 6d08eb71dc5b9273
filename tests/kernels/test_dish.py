"""Pointing error of a dish on tilted axes."""

import csv
import itertools
from pathlib import Path

import numpy as np
import pytest

from heliosweep.kernels.dish import RIGID, UNTILTED_HOME_AXES, pack_windows, window_errors
from heliosweep.sun import sun_vectors

DATA = Path(__file__).parents[1] / "data"
MODELS = {"rigid": RIGID, "untilted_home_axes": UNTILTED_HOME_AXES}
both = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS.keys())


def pointing_errors(model, sun, *parameters, **offsets):
    """Error at each instant, one window for each, for parameters as of `window_errors`."""
    return window_errors(model, pack_windows(sun, np.arange(len(sun) + 1)), *parameters, **offsets)[0]


def published(name):
    with (DATA / name).open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def vector(azimuth, elevation):
    """Sun vector east, north, up; azimuth from south, positive to the west."""
    return np.stack(
        (-np.sin(azimuth) * np.cos(elevation), -np.cos(azimuth) * np.cos(elevation), np.sin(elevation)), axis=-1
    )


def suns(count, seed=0):
    """Sun vectors spread evenly over the upper hemisphere."""
    rng = np.random.default_rng(seed)
    return vector(rng.uniform(-np.pi, np.pi, count), np.arcsin(rng.uniform(0.0, 1.0, count)))


def turned(vectors, axis, angle):
    """Vectors turned about a unit vector, right-handed."""
    parallel = np.sum(vectors * axis, axis=-1, keepdims=True) * axis
    angle = np.asarray(angle)[..., np.newaxis]
    return vectors * np.cos(angle) + np.cross(axis, vectors) * np.sin(angle) + parallel * (1.0 - np.cos(angle))


@pytest.mark.parametrize("row", published("dish_tracking_oracle.csv"))
def test_single_errors_of_an_independent_implementation(row):
    sun = vector(*np.radians([float(row["sun_azimuth_from_south_positive_west_deg"]), float(row["sun_elevation_deg"])]))
    tilt, direction = np.radians([float(row["axis_tilt_deg"]), float(row["axis_tilt_direction_deg"])])
    for name, model in MODELS.items():
        error = 1e3 * pointing_errors(model, sun[np.newaxis], tilt, direction)
        assert abs(error[0] - float(row[f"{name}_error_mrad"])) < 1e-9


@pytest.mark.parametrize("row", published("dish_tracking_daily_oracle.csv"))
def test_daily_factors_of_an_independent_implementation(row):
    minutes = np.arange(24 * 60) + 0.5
    midnight = np.datetime64(f"2021-{row['month_day_2021']}", "ns") - np.timedelta64(8, "h")
    sun = sun_vectors(midnight + (minutes * 60e9).astype("timedelta64[ns]"), 40.13, 94.67, 0.0, 69.0)
    direction = np.radians(float(row["axis_tilt_direction_deg"]))
    masks = {"daylight": sun[:, 2] > 0.0, "window_7_21": (minutes > 7 * 60) & (minutes < 21 * 60)}
    for label, mask in masks.items():
        windows = pack_windows(sun, [0, len(sun)], mask)
        for name, model in MODELS.items():
            mean = window_errors(model, windows, np.radians(0.1), direction)[0]
            assert abs(1.0 - mean[0] / 4e-3 - float(row[f"{label}_{name}"])) < 1e-8


def about(axis, angle):
    """Matrix that turns about axis 0, 1 or 2, right-handed."""
    matrix, (a, b) = np.eye(3), ((1, 2), (2, 0), (0, 1))[axis]
    matrix[a, a] = matrix[b, b] = np.cos(angle)
    matrix[b, a] = np.sin(angle)
    matrix[a, b] = -np.sin(angle)
    return matrix


@pytest.mark.parametrize("reference", [0.0, 0.004])
@pytest.mark.parametrize("elevation_offset", [0.0, -0.003])
@pytest.mark.parametrize("askew", [0.0, -0.005, 0.1])
@pytest.mark.parametrize("collimation", [0.0, 0.002])
def test_all_six_errors_of_a_rigid_mount_by_matrices(reference, elevation_offset, askew, collimation):
    """Guo et al. (2012), as the family `misalignment` has it, in the frame east, north, up."""
    sun, tilt, direction = suns(300), 0.002, 0.7
    east, north, up = sun.T
    turn, lift = np.arctan2(east, north) + reference, np.arctan2(up, np.hypot(east, north)) + elevation_offset
    normal = np.array([np.sin(collimation), np.cos(collimation), 0.0])
    untilted = np.array(
        [about(2, -g) @ about(1, askew) @ about(0, a) @ normal for g, a in zip(turn, lift, strict=True)]
    )
    focus = turned(untilted, np.array([-np.cos(direction), np.sin(direction), 0.0]), tilt)
    expected = 2.0 * np.arcsin(np.linalg.norm(focus - sun, axis=1) / 2.0)
    further = {"azimuth_reference": reference, "non_orthogonality": askew, "collimation": collimation}
    error = pointing_errors(RIGID, sun, tilt, direction, home_elevation=elevation_offset, **further)
    np.testing.assert_allclose(error, expected, rtol=0, atol=2e-15)


def plain(model, sun, starts, weights, tilt, direction, offsets, tolerance):
    """Means, maxima and clipped means of single instants, window by window."""
    error = pointing_errors(model, sun, tilt, direction, *offsets)
    out = []
    for first, last in itertools.pairwise(starts):
        e, w = error[first:last], weights[first:last]
        if not w.any():
            out.append((np.nan,) * 3)
            continue
        out.append((np.average(e, weights=w), e[w > 0].max(), np.average(np.minimum(e, tolerance), weights=w)))
    return np.transpose(out)


@both
@pytest.mark.parametrize("count", [1, 3, 9, 150])
def test_windows_of_any_length_and_weight(model, count):
    rng = np.random.default_rng(count)
    starts = np.concatenate(([3], 3 + np.cumsum(rng.integers(0, 13, count))))
    sun = suns(starts[-1] + 5, count)
    weights = rng.integers(0, 3, len(sun)) * rng.uniform(0.5, 2.0, len(sun))
    sun[weights == 0.0] = np.nan  # left out, whatever it is
    windows = pack_windows(sun, starts, weights)
    tilt, direction = np.array([[0.001], [0.004]]), np.array([0.3, 2.0, 5.0])
    for offsets in ((0.0, 0.0), (0.002, -0.001)):
        errors = window_errors(model, windows, tilt, direction, *offsets, tolerance=0.003)
        assert errors[0].shape == (2, 3, count)
        for i, j in np.ndindex(2, 3):
            expected = plain(model, np.nan_to_num(sun), starts, weights, tilt[i, 0], direction[j], offsets, 0.003)
            got = [*(each[i, j] for each in errors)]
            np.testing.assert_allclose(got, expected, rtol=0, atol=1e-15)
