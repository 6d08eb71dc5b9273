"""Speed of the calibration on one core: `python -m tests.bench calibration`.

1,000 heliostats with 60 spots each, by number of errors and loss function, beside SciPy's `least_squares`, heliostat by
heliostat, with the same spots and derivatives by the same kernel (so that SciPy pays for its steps and not for the
model), and by differences of the plain NumPy model.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from heliosweep.kernels.mounts.aiming import aim, mount_frames
from heliosweep.kernels.mounts.kinematics import TERMS, error_terms
from heliosweep.kernels.spots.calibration import CAUCHY, HUBER, SQUARED, Spots, calibrate
from heliosweep.kernels.spots.derivatives import RESIDUAL, SEEN_ROWS, derivative_lanes, seen_rows, weigh
from heliosweep.kernels.spots.least_squares import BLOCK, COLUMNS, SIDES
from heliosweep.kernels.spots.receiver import face_axes
from heliosweep.kernels.sun.clock import declination_cooper, solar_clock
from heliosweep.kernels.vectors import PACKET
from tests.bench.arithmetic import operations
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


def theirs(spots: Spots, frames: Floats, pivots: Floats, parameters: int, loss: str, exact: bool) -> None:
    """SciPy on the first heliostats; derivatives by the kernel, or by differences of the NumPy model."""
    for h in range(SAMPLE):
        part = slice(spots.first[h], spots.first[h + 1])
        sun, angles, position = spots.sun[part], spots.angles[part], spots.position[part]
        turns = np.stack([np.cos(angles), np.sin(angles)], axis=-1).reshape(-1, 4)
        seen, rows, terms, full = np.empty(SEEN_ROWS * PACKET), np.empty(BLOCK), np.empty(TERMS), np.zeros(6)
        fixed = (frames[h].ravel(), FACE.ravel(), np.array([*OFFSETS, *-pivots[h]]))
        seen_rows(sun, turns, position, seen)

        def filled(x: Floats) -> Floats:
            full[:parameters] = x  # noqa: B023
            error_terms(full, terms)  # noqa: B023
            derivative_lanes(seen, 0, terms, *fixed, rows, SPOTS)  # noqa: B023
            return rows.reshape(SIDES, COLUMNS, PACKET)[:, :, :SPOTS]  # noqa: B023

        def residuals(x: Floats) -> Floats:
            if exact:
                return filled(x)[:, RESIDUAL].ravel()
            full[:parameters] = x  # noqa: B023
            return (model(frames[h], pivots[h], angles, full, sun) - position).ravel()  # noqa: B023

        def jacobian(x: Floats) -> Floats:
            return filled(x)[:, :parameters].transpose(0, 2, 1).reshape(-1, parameters)

        options = {"jac": jacobian if exact else "2-point", "loss": loss, "f_scale": 0.05}
        least_squares(residuals, np.zeros(parameters), x_scale=1e-3, **options)


def operations_of(parameters: int) -> float:
    """Operations of one evaluation of a spot, two rows: prediction, weights, orthogonalisation of p + 1 columns."""
    factors = 2.0 * 2.0 * (parameters + 1) * (parameters + 2)  # products and differences of columns and those behind
    weights = operations(weigh, {"parameters + 1": parameters + 1, "loss == HUBER": 0.0, "loss == CAUCHY": 0.0})
    return operations(derivative_lanes, loops_only=True) + weights + factors


def rows() -> Iterator[Row]:
    """Numbers of errors and loss functions."""
    spots, frames, pivots = field()
    names = {SQUARED: "linear", HUBER: "huber", CAUCHY: "cauchy"}
    for loss, name in names.items():
        for parameters in (2, 4, 6):
            options = {"parameters": parameters, "loss": loss, "loss_scale": 0.05}
            work = partial(calibrate, spots, frames, pivots, FACE, np.array(OFFSETS), **options)  # type: ignore[arg-type]
            beside = {}
            for baseline, exact in (("SciPy, our derivatives", True), ("SciPy, NumPy's spots", False)):
                scipy = partial(theirs, spots, frames, pivots, parameters, name, exact)
                if exact or loss == SQUARED:
                    beside[baseline] = best(scipy, 1) / SAMPLE
            count = None  # the steps of the robust losses are of several kinds
            if loss == SQUARED:
                count = float(work().evaluations.mean()) * SPOTS * operations_of(parameters)
            label = f"calibration, {SPOTS} spots, {parameters} errors, {'squared' if name == 'linear' else name}"
            yield measured(label, "heliostat", work, HELIOSTATS, beside=beside, operations=count, times=3)


GROUPS = (rows,)
