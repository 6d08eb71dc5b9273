"""Random draws that depend only on seed, stream, heliostat and sample.

A counter-based generator, Philox 4x64 [1]_, has the key (seed, stream) and a separate counter for each heliostat. A
draw is therefore independent of chunks, scheduler, numbers of heliostats and samples, and all other draws: 10 samples
are the first 10 of 1000.

References
----------
.. [1] J. K. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC11 (2011), doi 10.1145/2063384.2063405
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import Philox
from numpy.typing import ArrayLike, NDArray

from heliosweep.config.sweep import NORMAL
from heliosweep.config.values import Distribution
from heliosweep.families.misalignment.blocks import ERRORS
from heliosweep.families.misalignment.points import values_of

if TYPE_CHECKING:
    from heliosweep.families.points import Point

#: Streams of the noise of synthetic spots along y and z; those below are the errors of a mount in their order.
NOISE_STREAMS = (100, 101)
#: Numbers of noise of one draw that have room among the counts of the generator.
MOST_NUMBERS = 2**24
#: Numbers that the generator makes at one count.
_BATCH = 4


def standard_uniforms(
    seed: int, stream: int, heliostats: ArrayLike, samples: int, first: int = 0
) -> NDArray[np.float64]:
    """Uniform draws between 0 and 1, both excluded, symmetric about 1/2: multiples of 2^-53, shape (H, samples).

    They follow from a seed and a stream, for instance the number of an error of the mount, both from 0 to 2^63 - 1, and
    from the numbers of the heliostats, from 0; `first` is the first sample.
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
    """Draws from the normal distribution of mean 0 and standard deviation 1, by inversion, between -8.3 and 8.3.

    Arguments and shape as for `standard_uniforms`.
    """
    from scipy.special import ndtri  # a fifth of a second, that a study without draws need not wait

    normals: NDArray[np.float64] = ndtri(standard_uniforms(seed, stream, heliostats, samples, first))
    return normals


def standard_deviates(errors: Sequence[object], heliostats: ArrayLike, samples: int, seed: int) -> NDArray[np.float64]:
    """Standard normal draws of E errors, or uniform ones between -1 and 1; 0 for others, shape (H, samples, E).

    Draws of an error are ``error.mean + error.width * deviate``. The position of an error is the stream of its draws;
    `seed` is for distributions that give none themselves, `samples` counts whatever these say.
    """
    numbers = np.asarray(heliostats, np.int64).ravel()
    result = np.zeros((numbers.size, samples, len(errors)))
    for stream, error in enumerate(errors):
        if isinstance(error, Distribution):
            which = seed if error.seed is None else error.seed, stream, numbers, samples
            normal = error.kind == NORMAL
            result[..., stream] = standard_normals(*which) if normal else 2.0 * standard_uniforms(*which) - 1.0
    return result


def mean_errors(point: Point, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
    """Return the six errors of a group of points (or of a shape, see `values_of`), means if drawn, (P, 6). [mrad]"""
    columns = []
    for name in ERRORS:
        error = getattr(point.study.mount_errors, name, None)
        mean = error.mean if isinstance(error, Distribution) else None
        column = values_of(point, f"mount_errors.{name}" if mean is None else "mount.mirror_offset", shape)
        columns.append(column if mean is None else np.full(column.shape, mean))
    return np.stack(columns, axis=-1)


def widths_of(errors: Sequence[object]) -> NDArray[np.float64]:
    """Factors on the deviates of `standard_deviates`, 0 for errors that are not drawn, shape (E,)."""
    return np.array([error.width if isinstance(error, Distribution) else 0.0 for error in errors])


def drawn_errors(point: Point, numbers: NDArray[np.int64], samples: int) -> Iterator[NDArray[np.float64]]:
    """Yield the six errors at each point of a group, of heliostats and draws, shape (H, samples, 6). [mrad]"""
    block = point.study.mount_errors
    first = int(numbers[0]) if numbers.size else 0
    deviates = _deviates(block.errors(), first, numbers.size, samples, block.seed or 0)
    scale = values_of(point, "mount_errors.scale")
    for mean, spread in zip(mean_errors(point), np.outer(scale, widths_of(block.errors())), strict=True):
        yield mean + spread * deviates


@lru_cache(maxsize=2)
def _deviates(errors: tuple[object, ...], first: int, count: int, samples: int, seed: int) -> NDArray[np.float64]:
    """Return deviates of following heliostats, kept for the next point."""
    return standard_deviates(errors, range(first, first + count), samples, seed)


@lru_cache(maxsize=4)
def noise_of_draws(
    seed: int, stream: int, first: int, heliostats: int, samples: int, count: int
) -> NDArray[np.float64]:
    """Standard normal numbers of each draw of following heliostats, shape (H, samples, count)."""
    numbers = range(first, first + heliostats)
    each = [standard_normals(seed, stream, numbers, count, sample * MOST_NUMBERS) for sample in range(samples)]
    return np.stack(each, axis=1)
