"""Random draws that depend on nothing but what they are for: seed, stream, heliostat, sample.

A counter-based generator, Philox 4x64 [1]_, is keyed by (seed, stream) and counts from a place of its own for every
heliostat. So a draw is the same whatever the chunks, the scheduler, the number of heliostats and of samples, and
whatever else is drawn: 10 samples are the first 10 of 1000.

References
----------
.. [1] J. K. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC11 (2011), doi 10.1145/2063384.2063405
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Philox
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from heliosweep.config.distribution import NORMAL, Distribution
from heliosweep.families.misalignment.blocks import ERRORS

if TYPE_CHECKING:
    from heliosweep.config.sweep import Sweep
    from heliosweep.families.misalignment.blocks import MountErrors

__all__ = [
    "NOISE_STREAMS",
    "drawn_errors",
    "errors_of",
    "means_and_widths",
    "sample_count",
    "seed_of",
    "standard_deviates",
    "standard_normals",
    "standard_uniforms",
]

#: Streams of the noise of synthetic spots along y and z; those below are the errors of a mount in their order.
NOISE_STREAMS = (100, 101)
#: Numbers that the generator makes at one count.
_BATCH = 4


def standard_uniforms(
    seed: int, stream: int, heliostats: ArrayLike, samples: int, first: int = 0
) -> NDArray[np.float64]:
    """Uniform draws between 0 and 1, both excluded, symmetric about 1/2.

    Parameters
    ----------
    seed, stream : int
        What the draws follow from, and what they are for: the number of an error of the mount, for instance. Both
        from 0 to 2^63 - 1.
    heliostats : array_like of int, shape (H,)
        Numbers of the heliostats, from 0.
    samples : int
        Draws per heliostat.
    first : int
        Sample to begin with.

    Returns
    -------
    ndarray, shape (H, samples)
        Multiples of 2^-53. [1]
    """
    numbers = np.asarray(heliostats, np.int64).ravel()
    key = np.array([seed, stream], np.uint64)
    batch, skip = divmod(first, _BATCH)
    bits = np.empty((numbers.size, samples), np.uint64)
    for row, number in zip(bits, numbers, strict=True):
        counter = np.array([batch, 0, number, 0], np.uint64)
        row[:] = Philox(key=key, counter=counter).random_raw(skip + samples)[skip:]
    # 52 bits and a half: exact, never 0 or 1, and 1 - u as likely as u.
    return ((bits >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52


def standard_normals(
    seed: int, stream: int, heliostats: ArrayLike, samples: int, first: int = 0
) -> NDArray[np.float64]:
    """Draws from the normal distribution of mean 0 and standard deviation 1, by inversion.

    Parameters
    ----------
    seed, stream, heliostats, samples, first
        As for `standard_uniforms`.

    Returns
    -------
    ndarray, shape (H, samples)
        Between -8.3 and 8.3. [1]
    """
    normals: NDArray[np.float64] = ndtri(standard_uniforms(seed, stream, heliostats, samples, first))
    return normals


def errors_of(block: MountErrors) -> tuple[float | Sweep | Distribution, ...]:
    """The six errors of a study, in the order of the kernels. [mrad]"""
    return tuple(getattr(block, name) for name in ERRORS)


def sample_count(block: MountErrors) -> int:
    """Number of draws of a study, the largest that it says anywhere; 0 where no error is drawn."""
    drawn = [error for error in errors_of(block) if isinstance(error, Distribution)]
    said = [error.samples for error in drawn if error.samples is not None]
    return max([*said, *([block.samples] if block.samples else [])], default=1) if drawn else 0


def seed_of(block: MountErrors) -> int:
    """Seed of the distributions that give none themselves; 0 where the study says none."""
    return block.seed or 0


def standard_deviates(
    errors: Sequence[object], heliostats: ArrayLike, samples: int, seed: int, first: int = 0
) -> NDArray[np.float64]:
    """What errors are drawn from: standard normal draws, or uniform ones between -1 and 1; 0 for what is not drawn.

    Parameters
    ----------
    errors : sequence, length E
        A Distribution for each error that is drawn; the position of an error is the stream of its draws.
    heliostats : array_like of int, shape (H,)
        Numbers of the heliostats, from 0.
    samples : int
        Draws per heliostat, whatever the distributions say.
    seed : int
        Seed of the distributions that give none themselves.
    first : int
        Sample to begin with.

    Returns
    -------
    ndarray, shape (H, samples, E)
        Draws of an error are ``error.mean + error.width * deviate``.
    """
    numbers = np.asarray(heliostats, np.int64).ravel()
    result = np.zeros((numbers.size, samples, len(errors)))
    for stream, error in enumerate(errors):
        if isinstance(error, Distribution):
            draw = standard_normals if error.kind == NORMAL else _between_ones
            own = seed if error.seed is None else error.seed
            result[..., stream] = draw(own, stream, numbers, samples, first)
    return result


def drawn_errors(
    errors: Sequence[float | Distribution],
    heliostats: ArrayLike,
    samples: int,
    seed: int,
    scale: float = 1.0,
    first: int = 0,
) -> NDArray[np.float64]:
    """Errors of every heliostat and sample, fixed ones among them.

    Parameters
    ----------
    errors : sequence of float or Distribution, length E
        What each error is, in any unit.
    heliostats, samples, seed, first
        As for `standard_deviates`.
    scale : float
        Factor on the deviations of drawn errors from their mean. [1]

    Returns
    -------
    ndarray, shape (H, samples, E)
        In the unit of `errors`.
    """
    means, widths = means_and_widths(errors)
    return means + (scale * widths) * standard_deviates(errors, heliostats, samples, seed, first)


def means_and_widths(errors: Sequence[float | Distribution]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean of each error and factor on its deviates, 0 for fixed ones; each of shape (E,)."""
    drawn = [error if isinstance(error, Distribution) else None for error in errors]
    means = [own.mean if own else error for own, error in zip(drawn, errors, strict=True)]
    return np.array(means, np.float64), np.array([own.width if own else 0.0 for own in drawn])


def _between_ones(seed: int, stream: int, heliostats: ArrayLike, samples: int, first: int) -> NDArray[np.float64]:
    return 2.0 * standard_uniforms(seed, stream, heliostats, samples, first) - 1.0
