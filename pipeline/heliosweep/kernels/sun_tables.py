"""Tabulated sun profiles: planted noise, planted errors, smoothing, and the analytic curve nearest to a table."""

import math

import numpy as np
from numpy.random import Philox
from numpy.typing import NDArray

from heliosweep.kernels.sun_profiles import POWER, Profile, analytic, falling_envelope, render, table_profile

__all__ = ["noisy", "normal_draws", "scaled", "smooth_fit", "smoothed"]

Floats = NDArray[np.float64]


def noisy(profile: Profile, noise: float, nodes: int = 120, seed: int = 0) -> Profile:
    """A profile tabulated at uniform nodes, both ends included, with normal noise on each.

    Parameters
    ----------
    profile : Profile
    noise : float
        Standard deviation relative to the disc centre. [1]
    nodes : int
        Number of nodes, 3 at least.
    seed : int
        Key of the counter-based generator: node k of a seed has the same noise whatever their number.

    Returns
    -------
    Profile
        Negative values, which noise may cause, are 0.
    """
    if nodes < 3:
        raise ValueError("a table needs 3 nodes at least")
    clean = render(profile, np.linspace(0.0, profile.radius, nodes))
    return table_profile(np.maximum(clean + noise * normal_draws(seed, 1, nodes), 0.0), profile.radius)


def scaled(profile: Profile, error: float) -> Profile:
    """The same profile, narrower or wider by a relative error of its angular radius; for planted profile errors."""
    if not error > -1.0:
        raise ValueError("the radius must remain positive")
    factor = 1.0 + error
    return profile._replace(
        radius=profile.radius * factor,
        edge=profile.edge * factor,
        edge_slope=profile.edge_slope / factor,
        step=profile.step * factor,
    )


def smoothed(profile: Profile, nodes: float) -> Profile:
    """A table smoothed by a Gaussian.

    Parameters
    ----------
    profile : Profile
        Tabulated.
    nodes : float
        Standard deviation of the Gaussian, in nodes. [1]

    Returns
    -------
    Profile
        Reflected at the disc centre, continued by its tangent beyond the edge.
    """
    table = profile.table
    if table.size == 0:
        raise ValueError("only a table can be smoothed")
    if nodes <= 0.0:
        return profile
    reach = math.ceil(5.0 * nodes)
    offsets = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (offsets / nodes) ** 2)
    weights /= weights.sum()
    place = np.abs(np.arange(table.size)[:, np.newaxis] + offsets)
    beyond = np.maximum(place - (table.size - 1), 0)
    wide = table[np.minimum(place, table.size - 1)] + beyond * (profile.edge_slope * profile.step)
    return table_profile(np.sum(wide * weights, axis=1), profile.radius)


def smooth_fit(profile: Profile, power: float = POWER) -> Profile:
    """The cubic in sqrt(1 - u^xi) nearest to a table in the sense of least squares over its nodes.

    Parameters
    ----------
    profile : Profile
        Tabulated.
    power : float
        xi. [1]

    Returns
    -------
    Profile
        Analytic.
    """
    table = profile.table
    if table.size < 4:
        raise ValueError("the fit needs a table of 4 nodes at least")
    c = _limb_cosine(np.linspace(0.0, 1.0, table.size), power)
    fit, *_ = np.linalg.lstsq(np.stack((np.ones_like(c), c, c**2, c**3), axis=1), table, rcond=None)
    u = np.linspace(0.0, 1.0, 1025)
    c = _limb_cosine(u, power)
    curve = fit[0] + c * (fit[1] + c * (fit[2] + c * fit[3]))
    c0, c1, c2, c3 = (float(f) for f in fit)
    return analytic((c0, c1, c2, c3), profile.radius, power, falling_envelope(curve))


def normal_draws(seed: int, stream: int, count: int) -> Floats:
    """Standard normal numbers from a counter-based generator, Philox 4x64: number k depends on its key and k alone.

    Parameters
    ----------
    seed, stream : int
        The key; streams keep what is drawn for different purposes apart. Not negative.
    count : int
        How many.

    Returns
    -------
    ndarray, shape (count,)
        Pairs by the transform of Box and Muller.
    """
    pairs = (count + 1) // 2
    raw = Philox(key=np.array([seed, stream], np.uint64)).random_raw(2 * pairs)
    uniform = ((raw >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52  # exact: neither 0 nor 1
    length, turn = np.sqrt(-2.0 * np.log(uniform[0::2])), 2.0 * np.pi * uniform[1::2]
    return np.stack((length * np.cos(turn), length * np.sin(turn)), axis=1).ravel()[:count]


def _limb_cosine(u: Floats, power: float) -> Floats:
    return np.sqrt(1.0 - u**power)
