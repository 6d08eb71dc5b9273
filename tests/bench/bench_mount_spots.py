"""Speed of the spots of mounts with errors on one core: `python -m tests.bench mount_spots`.

Spots (general mount, six errors, mirror and axis offsets, exact aiming) of heliostats x instants x samples beside the
same computation in plain NumPy; statistics over samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.spots.mount_spots import mount_spots
from heliosweep.kernels.spots.receiver import face_axes
from heliosweep.kernels.spots.statistics import spot_statistics
from tests.bench.table import Row, best, measured
from tests.kernels.spots.deviations import setting

Floats = NDArray[np.float64]

OFFSET, AXIS_OFFSET, PEDESTAL, HEIGHT = 0.5, 0.2, 4.0, 143.0
ROUNDS = 6
"""Of the fixed point in plain NumPy: enough for all but mounts that look straight up."""
SETTING = setting(
    latitude=0.65, face_azimuth=0.1, face_tilt=-0.2, mirror_offset=OFFSET, axis_offset=AXIS_OFFSET,
    pedestal_height=PEDESTAL,
)  # fmt: skip


def scene(heliostats: int, instants: int, samples: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Errors of each heliostat, actual and known, sun vectors and pivots."""
    rng = np.random.default_rng(0)
    sun = rng.normal(size=(1, instants, 3)) + np.array([0.0, -1.0, 0.0])
    sun[..., 2] = np.abs(sun[..., 2]) + 0.2
    sun /= np.linalg.norm(sun, axis=-1, keepdims=True)
    places = (rng.uniform(-200, 200, heliostats), rng.uniform(80, 400, heliostats), np.full(heliostats, 5.0))
    actual = rng.normal(0.0, 1e-3, (1, heliostats, samples, 6))
    return actual, rng.normal(0.0, 1e-3, (1, heliostats, 6)), sun, np.stack(places, axis=1)[None]


def turned(x: Floats | float, y: Floats | float, angle: Floats) -> tuple[Floats, Floats]:
    """Two components turned from the first towards the second."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return cosine * x - sine * y, sine * x + cosine * y


def stand(angles: tuple[Floats, Floats], errors: Floats) -> tuple[Floats, Floats]:
    """Normals and centres of azimuth-elevation mounts in NumPy."""
    g0, a0, east, north, eta, mu = np.moveaxis(errors, -1, 0)
    g, a = np.broadcast_arrays(angles[0] + g0, angles[1] + a0)
    axis = np.stack((east, north, 0.0 * east), axis=-1)
    w = np.linalg.norm(axis, axis=-1, keepdims=True)
    made = []
    for x, along, q, h in ((np.sin(mu), np.cos(mu), 0.0, 0.0), (0.0 * mu, OFFSET, AXIS_OFFSET, PEDESTAL)):
        y, z = turned(along, 0.0, a)
        z, x = turned(z, x, eta)
        x, y = turned(x, y + q, -g)
        v = np.stack((x, y, z + h), axis=-1)
        # Rodrigues
        v = (
            v
            + np.sinc(w / np.pi) * np.cross(axis, v)
            + 0.5 * np.sinc(w / np.pi / 2) ** 2 * np.cross(axis, np.cross(axis, v))
        )
        made.append(v - np.array([0.0, 0.0, h]))
    return made[0], made[1]


def plain(actual: Floats, known: Floats, sun: Floats, pivots: Floats) -> tuple[Floats, Floats]:
    """Spots (H, T, K) in plain NumPy: fixed point of the mirror centre, then the spots of all samples."""
    to_target = (np.array([0.0, 0.0, HEIGHT]) - pivots[0])[:, None]
    known, actual, s = known[0][:, None], actual[0][:, None], sun[0]
    g0, a0, east, north, eta, mu = np.moveaxis(known, -1, 0)
    axis = np.stack((east, north, 0.0 * east), axis=-1)
    w = np.linalg.norm(axis, axis=-1, keepdims=True)
    centre, angles = np.zeros((1, 1, 3)), (g0, a0)
    for _ in range(ROUNDS):
        t = to_target - centre
        n = s + t / np.linalg.norm(t, axis=-1, keepdims=True)
        n /= np.linalg.norm(n, axis=-1, keepdims=True)
        n = (
            n
            - np.sinc(w / np.pi) * np.cross(axis, n)
            + 0.5 * np.sinc(w / np.pi / 2) ** 2 * np.cross(axis, np.cross(axis, n))
        )
        a = np.arcsin((n[..., 2] + np.sin(eta) * np.sin(mu)) / (np.cos(eta) * np.cos(mu)))
        x = np.sin(mu) * np.cos(eta) + np.cos(mu) * np.sin(a) * np.sin(eta)
        g = np.arctan2(n[..., 0], n[..., 1]) - np.arctan2(x, np.cos(mu) * np.cos(a))
        angles = (g - g0, a - a0)
        centre = stand(angles, known)[1]
    normal, centre = stand((angles[0][..., None], angles[1][..., None]), actual)
    s = s[:, None]
    ray = 2.0 * np.sum(normal * s, axis=-1, keepdims=True) * normal - s
    before = centre - to_target[:, None]
    out, right, up = face_axes(0.1, -0.2)
    point = before - (before @ out / (ray @ out))[..., None] * ray
    return point @ right, point @ up


def rows() -> Iterator[Row]:
    """Spots, then statistics of them."""
    for heliostats, instants in ((317, 1000), (3170, 15), (200_000, 1)):
        actual, known, sun, places = scene(heliostats, instants, 1)
        # In NumPy as many heliostats at a time as is best for its caches.
        part = max(1, 20_000 // instants)
        few = (actual[:, :part], known[:, :part], sun, places[:, :part])
        made, (y, z) = mount_spots(SETTING, few[0][:, :, 0], *few[1:]), plain(*few)
        apart = np.abs(np.where(np.hypot(y, z) < 20.0, made[:2, 0, ..., np.newaxis] - np.stack((y, z)), 0.0))
        assert np.nanquantile(apart, 0.99) < 1e-9
        yield measured(
            f"mount spots, {heliostats} x {instants}",
            "spot",
            partial(mount_spots, SETTING, actual[:, :, 0], known, sun, places),
            heliostats * instants,
            beside={"NumPy": best(partial(plain, *few), 3) / (part * instants)},
            times=3,
        )
    arguments, spots = scene(317, 15, 1000), 317 * 15 * 1000
    for chosen in ((), (5.0, 50.0, 95.0), tuple(range(1, 100))):
        yield measured(
            f"statistics, 1,000 draws, {len(chosen)} percentiles",
            "spot",
            partial(spot_statistics, SETTING, *arguments, chosen),
            spots,
            times=2,
        )


GROUPS = (rows,)
