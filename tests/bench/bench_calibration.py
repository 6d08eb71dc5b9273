"""Speed of the calibration on one core: `python -m tests.bench calibration`.

1,000 heliostats with 60 spots each, by number of errors and loss function, beside SciPy's `least_squares`, heliostat by
heliostat, with derivatives by differences of the plain NumPy model.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from heliosweep.kernels.mounts.aiming import aim, mount_frames
from heliosweep.kernels.spots.calibration import CAUCHY, HUBER, SQUARED, Spots, calibrate
from heliosweep.kernels.spots.receiver import face_axes
from heliosweep.kernels.sun.clock import declination_cooper, solar_clock
from tests.bench.table import Row, best, measured
from tests.kernels.mounts.normals import normal_and_centre

Floats = NDArray[np.float64]

HELIOSTATS, SPOTS, SAMPLE = 1000, 60, 20
OFFSETS = (0.5, 0.1, 3.0)
FACE = face_axes(0.0, 0.0)


def field() -> tuple[Spots, Floats, Floats]:
    """Spots of three days with 2 cm of noise and 5 % outliers; frames and pivots."""
    rng = np.random.default_rng(3)
    around, far = rng.uniform(-1.0, 1.0, HELIOSTATS), rng.uniform(150.0, 600.0, HELIOSTATS)
    pivots = np.stack([far * np.sin(around), far * np.cos(around), np.full(HELIOSTATS, -143.0)], axis=1)
    days = np.repeat([81.0, 172.0, 355.0], SPOTS // 3)
    sun = solar_clock(np.radians(37.4), declination_cooper(days), np.tile(np.linspace(8.0, 16.0, SPOTS // 3), 3))
    frames = mount_frames(0, 0.0, 0.0, -pivots)
    angles = aim(frames[:, np.newaxis], sun, -pivots[:, np.newaxis], np.zeros(6), OFFSETS)
    errors = rng.normal(0.0, 1e-3, (HELIOSTATS, 1, 6))
    position = model(frames[:, np.newaxis], pivots[:, np.newaxis], angles, errors, sun)
    position += 0.02 * rng.standard_normal(position.shape)
    position[rng.random(position.shape[:2]) < 0.05] += 0.5
    first = np.arange(HELIOSTATS + 1) * SPOTS
    suns = np.tile(sun, (HELIOSTATS, 1))
    spots = Spots(first, suns, angles.reshape(-1, 2), position.reshape(-1, 2), np.ones(HELIOSTATS * SPOTS))
    return spots, frames, pivots


def model(frames: Floats, pivots: Floats, angles: Floats, errors: Floats, sun: Floats) -> Floats:
    """Spots in plain NumPy around the kernel's mirror."""
    normal, centre = normal_and_centre(frames, angles, errors, OFFSETS)
    point = pivots + centre
    ray = 2.0 * np.sum(normal * sun, axis=-1, keepdims=True) * normal - sun
    on_plane = point - (point @ FACE[0] / (ray @ FACE[0]))[..., np.newaxis] * ray
    return on_plane @ FACE[1:].T


def theirs(spots: Spots, frames: Floats, pivots: Floats, parameters: int) -> None:
    """SciPy on the first heliostats, with the squared loss; derivatives by differences of the NumPy model."""
    for h in range(SAMPLE):
        part = slice(spots.first[h], spots.first[h + 1])
        sun, angles, position = spots.sun[part], spots.angles[part], spots.position[part]

        def residuals(x: Floats) -> Floats:
            full = np.concatenate((x, np.zeros(6 - parameters)))
            return (model(frames[h], pivots[h], angles, full, sun) - position).ravel()  # noqa: B023

        least_squares(residuals, np.zeros(parameters), x_scale=1e-3)


def rows() -> Iterator[Row]:
    """Numbers of errors and loss functions."""
    spots, frames, pivots = field()
    names = {SQUARED: "linear", HUBER: "huber", CAUCHY: "cauchy"}
    for loss, name in names.items():
        for parameters in (2, 4, 6):
            options = {"parameters": parameters, "loss": loss, "loss_scale": 0.05}
            work = partial(calibrate, spots, frames, pivots, FACE, np.array(OFFSETS), **options)  # type: ignore[arg-type]
            beside = {}
            if loss == SQUARED:
                beside["SciPy, NumPy's spots"] = best(partial(theirs, spots, frames, pivots, parameters), 1) / SAMPLE
            label = f"calibration, {SPOTS} spots, {parameters} errors, {'squared' if name == 'linear' else name}"
            yield measured(label, "heliostat", work, HELIOSTATS, beside=beside, times=3)


GROUPS = (rows,)
