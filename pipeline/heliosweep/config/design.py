"""Designs of draws: points of the unit cube, one row for each draw and one column for each drawn key.

Draw k of the designs `sobol` and `random` follows from the seed and from k alone, so that a longer sample begins with a
shorter one. Draw k of `sobol` belongs to sequence k modulo 8 of eight scrambled Sobol sequences [1]_, scrambled
independently: the spread of their means measures the error of a mean, which a single sequence cannot [2]_.

References
----------
.. [1] A. B. Owen, "Scrambling Sobol' and Niederreiter-Xing points", J. Complexity 14 (1998),
   doi 10.1006/jcom.1998.0487
.. [2] P. L'Ecuyer and C. Lemieux, "Recent advances in randomized quasi-Monte Carlo methods", in Modeling Uncertainty
   (2002), doi 10.1007/0-306-48102-2_20
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from heliosweep.errors import load_extra

if TYPE_CHECKING:  # it takes longer to import than reading a study
    from numpy.typing import NDArray

#: Number of Sobol sequences of a sample.
REPLICATES = 8
#: Minimum probability of a draw on either side: half a step of the sequences, of 30 bits. [1]
LEAST = 2.0**-31
#: Levels of an elementary effect, and the probabilities of the first and the last of them.
LEVELS, FIRST_LEVEL, LAST_LEVEL = 4, 0.125, 0.875

SOBOL, LATIN, RANDOM = "sobol", "latin_hypercube", "random"
MORRIS, LOCAL = "morris", "local"


@dataclass(frozen=True)
class Design:
    """Draws of a study, as probabilities.

    Parameters
    ----------
    kind : {"sobol", "latin_hypercube", "random"}
        Arrangement of the points in the unit cube.
    size : int
        Number of draws; for a sensitivity, of base points or of trajectories.
    seed : int
        Seed of all draws.
    groups : tuple of int
        For each drawn key, the number of its parameter of a sensitivity.
    sensitivity : {"", "sobol", "morris", "local"}
        Purpose of the draws: Saltelli's design, trajectories of elementary effects, or single steps.
    factor : tuple of tuple of float
        Lower triangle of the Cholesky factor of the keys' correlation, row by row; empty if they are independent.
    """

    kind: str
    size: int
    seed: int
    groups: tuple[int, ...]
    sensitivity: str = ""
    factor: tuple[tuple[float, ...], ...] = ()

    @property
    def parameters(self) -> int:
        """Number of parameters of a sensitivity: keys and groups of keys."""
        return max(self.groups) + 1

    @property
    def rows(self) -> int:
        """Number of draws of each base point or trajectory."""
        return {SOBOL: self.parameters + 2, MORRIS: self.parameters + 1}.get(self.sensitivity, 1)

    def __len__(self) -> int:
        return 2 * self.parameters + 1 if self.sensitivity == LOCAL else self.size * self.rows

    def at(self, index: NDArray[np.int64] | slice) -> NDArray[np.float64]:
        """Return the probabilities of some draws, shape (draws, keys), from `LEAST` to ``1 - LEAST``."""
        return _draws(self)[index]


@lru_cache(maxsize=4)
def _draws(design: Design) -> NDArray[np.float64]:
    """Return the probabilities of all draws, shape (draws, keys)."""
    from scipy.special import ndtr

    if design.sensitivity == LOCAL:  # the median of all keys, then each parameter one deviate down, and up
        steps = np.full((len(design), len(design.groups)), 0.5)
        for key, parameter in enumerate(design.groups):
            steps[2 * parameter + 1 : 2 * parameter + 3, key] = ndtr([-1.0, 1.0])
        return steps
    if design.sensitivity == MORRIS:
        return FIRST_LEVEL + (LAST_LEVEL - FIRST_LEVEL) * levels(design)
    points = np.clip(_points(design, len(design.groups) * (2 if design.sensitivity else 1)), LEAST, 1.0 - LEAST)
    if design.factor:
        points = _correlated(points, design.factor)
    if not design.sensitivity:
        return points
    # Rows of a base point: all keys of the first half; the keys of one parameter of the second half; all keys of the
    # second half.
    first, second = (np.repeat(half, design.rows, axis=0) for half in np.split(points, 2, axis=1))
    row = np.tile(np.arange(design.rows), design.size)[:, np.newaxis]
    return np.where((np.array(design.groups) == row - 1) | (row == design.rows - 1), second, first)


def _points(design: Design, columns: int) -> NDArray[np.float64]:
    """Return the points of the unit cube, shape (size, columns)."""
    from scipy.stats import qmc

    if design.kind == RANDOM:
        keys = [np.array([design.seed, column], np.uint64) for column in range(columns)]
        bits = np.stack([np.random.Philox(key=key, counter=0).random_raw(design.size) for key in keys], axis=1)
        return ((bits >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52
    if design.kind == LATIN:
        hypercube: NDArray[np.float64] = qmc.LatinHypercube(columns, rng=np.random.default_rng(design.seed)).random(
            design.size
        )
        return hypercube
    points = np.empty((design.size, columns))
    for sequence in range(REPLICATES):
        engine = qmc.Sobol(columns, rng=np.random.default_rng([design.seed, sequence]))
        points[sequence::REPLICATES] = engine.random(design.size // REPLICATES)
    return points + LEAST  # in the middle of the steps: never 0


def levels(design: Design) -> NDArray[np.float64]:
    """Return the trajectories of elementary effects, each level between 0 and 1, shape (draws, keys)."""
    morris = load_extra("SALib.sample.morris", "SALib", "sensitivity")
    sampled: NDArray[np.float64] = morris.sample(problem(design), design.size, LEVELS, seed=design.seed)
    return sampled


def problem(design: Design) -> dict[str, object]:
    """Return the problem dictionary of SALib."""
    names = [f"{number:05}" for number in range(len(design.groups))]
    groups = [f"{group:05}" for group in design.groups] if design.parameters < len(names) else None
    return {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names), "groups": groups}


def _correlated(points: NDArray[np.float64], factor: tuple[tuple[float, ...], ...]) -> NDArray[np.float64]:
    """Return the probabilities of correlated normal deviates: a Gaussian copula."""
    from scipy.special import ndtr, ndtri

    normals, mixed = ndtri(points), np.zeros_like(points)
    for column, row in enumerate(factor):
        for other, weight in enumerate(row):  # one after the other: the bits of a matrix product depend on its shape
            mixed[:, column] += weight * normals[:, other]
    return np.clip(ndtr(mixed), LEAST, 1.0 - LEAST)
