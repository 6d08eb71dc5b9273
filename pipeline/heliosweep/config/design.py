"""Designs of draws: points of the unit cube, one row a draw and one column a drawn key, made when they are asked for.

Draw k of the designs `sobol` and `random` follows from the seed and from k alone, so that a longer sample begins with a
shorter one. Draw k of `sobol` belongs to sequence k modulo 8 of eight scrambled Sobol sequences [1]_, scrambled
independently of each other: the spread of their means tells how sure a mean is, which a single sequence cannot [2]_.

References
----------
.. [1] A. B. Owen, "Scrambling Sobol' and Niederreiter-Xing points", J. Complexity 14 (1998),
   doi 10.1006/jcom.1998.0487
.. [2] P. L'Ecuyer and C. Lemieux, "Recent advances in randomized quasi-Monte Carlo methods", in Modeling Uncertainty
   (2002), doi 10.1007/0-306-48102-2_20
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from heliosweep.errors import load_extra

if TYPE_CHECKING:  # it takes longer to import than reading a study
    from numpy.typing import NDArray

#: Sobol sequences that a sample is made of.
REPLICATES = 8
#: No draw has a smaller probability on either side: half a step of the sequences, of 30 bits. [1]
LEAST = 2.0**-31
#: Levels of an elementary effect, and the probabilities of the first and the last of them.
LEVELS, FIRST_LEVEL, LAST_LEVEL = 4, 0.125, 0.875
#: Draws that are made together.
_BLOCK = 2**14
#: Numbers that the generator makes at one count.
_BATCH = 4

SOBOL, LATIN, RANDOM = "sobol", "latin_hypercube", "random"
MORRIS, LOCAL = "morris", "local"


@dataclass(frozen=True)
class Design:
    """Draws of a study, as probabilities.

    Parameters
    ----------
    kind : {"sobol", "latin_hypercube", "random"}
        How points fill the unit cube.
    size : int
        Number of points: of draws; of base points and of trajectories for a sensitivity.
    seed : int
        What all draws follow from.
    groups : tuple of int
        For each drawn key, which of the parameters of a sensitivity it belongs to.
    sensitivity : {"", "sobol", "morris", "local"}
        What the draws are arranged for: Saltelli's design, trajectories of elementary effects, or single steps.
    factor : tuple of tuple of float
        Lower triangle of the Cholesky factor of the keys' correlation, row by row; empty where they are independent.
    """

    kind: str
    size: int
    seed: int
    groups: tuple[int, ...]
    sensitivity: str = ""
    factor: tuple[tuple[float, ...], ...] = ()

    @cached_property
    def parameters(self) -> int:
        """Number of parameters of a sensitivity: keys and groups of keys."""
        return max(self.groups) + 1

    @cached_property
    def rows(self) -> int:
        """Draws that belong together: of a base point, of a trajectory, or of all."""
        return {SOBOL: self.parameters + 2, MORRIS: self.parameters + 1}.get(self.sensitivity, 1)

    def __len__(self) -> int:
        """Return the number of draws."""
        return 2 * self.parameters + 1 if self.sensitivity == LOCAL else self.size * self.rows

    def at(self, index: NDArray[np.int64]) -> NDArray[np.float64]:
        """Probabilities of some draws, shape (draws, keys), from `LEAST` to ``1 - LEAST``."""
        if self.sensitivity == LOCAL:
            return self._steps()[index]
        if self.sensitivity == MORRIS:
            return _trajectories(self)[index]
        if index.size < len(self) <= _BLOCK:  # single ones are asked for again and again
            return _all(self)[index]
        point, row = np.divmod(index, self.rows)
        found = np.empty((index.size, len(self.groups) * (2 if self.sensitivity else 1)))
        for number in np.unique(point // _BLOCK):
            here = point // _BLOCK == number
            found[here] = _block(self, int(number))[point[here] % _BLOCK]
        if self.sensitivity:
            first, second = np.split(found, 2, axis=1)
            # Rows of a base point: all keys of the first half, those of one parameter of the second, all of the second.
            swapped = np.array(self.groups) == row[:, np.newaxis] - 1
            return np.where(swapped | (row == self.rows - 1)[:, np.newaxis], second, first)
        return found

    def _steps(self) -> NDArray[np.float64]:
        """The median of all keys, and for each parameter its keys one standard normal deviate down, and up."""
        from scipy.special import ndtr

        steps = np.full((len(self), len(self.groups)), 0.5)
        for key, parameter in enumerate(self.groups):
            steps[2 * parameter + 1 : 2 * parameter + 3, key] = ndtr([-1.0, 1.0])
        return steps


@lru_cache(maxsize=4)
def _all(design: Design) -> NDArray[np.float64]:
    """All draws of a small design."""
    return design.at(np.arange(len(design)))


@lru_cache(maxsize=16)
def _block(design: Design, number: int) -> NDArray[np.float64]:
    """Points `number` x _BLOCK and following, correlated."""
    first, columns = number * _BLOCK, len(design.groups) * (2 if design.sensitivity else 1)
    count = min(_BLOCK, design.size - first)
    if design.kind == RANDOM:
        points = np.stack([_uniforms(design.seed, column, first, count) for column in range(columns)], axis=1)
    elif design.kind == LATIN:
        points = _hypercube(design.size, columns, design.seed)[first : first + count]
    else:
        points = np.empty((count, columns))
        for sequence in range(min(REPLICATES, count)):
            places = points[sequence::REPLICATES]
            places[:] = _sobol(design.seed, sequence, columns, first // REPLICATES, len(places))
    points = np.clip(points, LEAST, 1.0 - LEAST)
    return _correlated(points, design.factor) if design.factor else points


def _sobol(seed: int, sequence: int, columns: int, first: int, count: int) -> NDArray[np.float64]:
    from scipy.stats import qmc

    engine = qmc.Sobol(columns, rng=np.random.default_rng([seed, sequence]))
    if first:
        engine.fast_forward(first)
    even = engine.random(count + count % 2)[:count]  # a single first point brings a warning
    return even + LEAST  # in the middle of the steps: never 0


def _uniforms(seed: int, column: int, first: int, count: int) -> NDArray[np.float64]:
    """Uniform draws by counters, as those of single mounts (`families.misalignment.draws`)."""
    batch, skip = divmod(first, _BATCH)
    counter = np.array([batch, 0, 0, 0], np.uint64)
    bits = np.random.Philox(key=np.array([seed, column], np.uint64), counter=counter).random_raw(skip + count)[skip:]
    return ((bits >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52


@lru_cache(maxsize=2)
def _hypercube(size: int, columns: int, seed: int) -> NDArray[np.float64]:
    from scipy.stats import qmc

    points: NDArray[np.float64] = qmc.LatinHypercube(columns, rng=np.random.default_rng(seed)).random(size)
    return points


@lru_cache(maxsize=2)
def _trajectories(design: Design) -> NDArray[np.float64]:
    return FIRST_LEVEL + (LAST_LEVEL - FIRST_LEVEL) * levels(design)


def levels(design: Design) -> NDArray[np.float64]:
    """Trajectories of elementary effects, each level between 0 and 1, shape (draws, keys)."""
    morris = load_extra("SALib.sample.morris", "SALib", "sensitivity")
    sampled: NDArray[np.float64] = morris.sample(problem(design), design.size, LEVELS, seed=design.seed)
    return sampled


def problem(design: Design) -> dict[str, object]:
    """What SALib takes a design for."""
    names = [f"{number:05}" for number in range(len(design.groups))]
    grouped = [f"{group:05}" for group in design.groups]
    several = design.parameters < len(design.groups)
    return {
        "num_vars": len(names),
        "names": names,
        "bounds": [[0.0, 1.0]] * len(names),
        "groups": grouped if several else None,
    }


def _correlated(points: NDArray[np.float64], factor: tuple[tuple[float, ...], ...]) -> NDArray[np.float64]:
    """Probabilities of correlated normal deviates: a Gaussian copula."""
    from scipy.special import ndtr, ndtri

    normals, mixed = ndtri(points), np.zeros_like(points)
    for column, row in enumerate(factor):
        for other, weight in enumerate(row):  # one after the other: the bits of a matrix product depend on its shape
            mixed[:, column] += weight * normals[:, other]
    return np.clip(ndtr(mixed), LEAST, 1.0 - LEAST)
