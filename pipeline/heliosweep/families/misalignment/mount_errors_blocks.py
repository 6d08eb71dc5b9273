"""What is computed in one block of the mode mount_errors: NumPy arrays over (swept dimensions, heliostat)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.distribution import Distribution
from heliosweep.families.misalignment.blocks import ERRORS
from heliosweep.families.misalignment.draws import means_and_widths, standard_deviates
from heliosweep.families.misalignment.mount_errors_variables import STATISTICS, TOLERANCE_AXES
from heliosweep.families.misalignment.scene import Block, block_result, points
from heliosweep.families.misalignment.variables import NO_HELIOSTAT
from heliosweep.kernels.mount_spots import mount_spots
from heliosweep.kernels.receiver import Setting
from heliosweep.kernels.spot_statistics import spot_statistics

Floats = NDArray[np.float64]

#: Draws that a block holds at a time. [bytes]
DRAWS_BYTES = 8 * 2**20


def spots_block(*arrays: np.ndarray, sizes: Mapping[str, int]) -> np.ndarray:
    """Spots and status of a block, shape (3, *swept dimensions, heliostat, day, hour)."""
    block = Block.of(*arrays)
    _, *errors = block.others
    actual = np.stack([points(error, block.lead) for error in errors], axis=-1) * 1e-3
    known = np.zeros((1, 1, len(ERRORS)))
    spots = mount_spots(block.setting, actual[:, np.newaxis, np.newaxis], known, block.sun, block.pivots)
    return block_result(spots[..., 0], block, sizes)


def mean_block(values: np.ndarray) -> np.ndarray:
    """Mean of the values that are there along the last dimension; NaN of none."""
    known = ~np.isnan(values)
    count = np.count_nonzero(known, axis=-1)
    # Added one after the other: padding at the end must not change the order of the sum.
    total = np.cumsum(np.where(known, values, 0.0), axis=-1)[..., -1]
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)[np.newaxis]


def at_a_time(samples: int) -> int:
    """Heliostats whose draws are held at a time."""
    return max(1, DRAWS_BYTES // (samples * 8 * len(ERRORS)))


def row_count(percentiles: int) -> int:
    """Rows of a block of statistics: `STATISTICS`, status, then percentiles about each axis."""
    return len(STATISTICS) + 1 + len(TOLERANCE_AXES) * percentiles


def status_block(status: np.ndarray) -> np.ndarray:
    """Status as int8, `NO_HELIOSTAT` where a shorter layout is padded."""
    return np.where(np.isnan(status), NO_HELIOSTAT, status).astype(np.int8)[np.newaxis]


def statistics_block(
    *arrays: np.ndarray,
    errors: tuple[Any, ...],
    samples: int,
    seed: int,
    percentiles: Floats,
    sizes: Mapping[str, int],
) -> np.ndarray:
    """Statistics of a block, shape (1, *swept dimensions, heliostat, statistics, day, hour).

    Parameters
    ----------
    *arrays : ndarray
        Of `_arguments`.
    errors : tuple of float, Sweep or Distribution
        The six errors.
    samples, seed : int
        Draws per heliostat, and the seed of distributions that give none.
    percentiles : ndarray
        Of the remaining tolerance.
    sizes : mapping of str to int
        Lengths of the days and the hours.
    """
    block = Block.of(*arrays)
    scale, *means = (points(array, block.lead) for array in block.others)
    mean = np.stack(means, axis=-1)
    _, width = means_and_widths([error if isinstance(error, Distribution) else 0.0 for error in errors])
    known = np.zeros((1, 1, len(ERRORS)))
    heliostats, instants = block.pivots.shape[1], block.sun.shape[1]
    rows = row_count(percentiles.size)
    result = np.empty((scale.size, heliostats, rows, instants))
    step = at_a_time(samples)
    for start in range(0, heliostats, step):
        part = slice(start, start + step)
        deviates = standard_deviates(errors, block.numbers[part], samples, seed)
        for point in range(scale.size):
            one = slice(point, point + 1)
            actual = (mean[point] + (scale[point] * width) * deviates) * 1e-3
            setting = Setting(*(values[one] for values in block.setting))  # type: ignore[arg-type]
            sun = block.sun if len(block.sun) == 1 else block.sun[one]
            pivots = block.pivots if len(block.pivots) == 1 else block.pivots[one]
            made = spot_statistics(
                setting, actual[np.newaxis], known, sun, np.ascontiguousarray(pivots[:, part]), percentiles
            )
            result[point, part] = _stacked(made)
            result[point, part][np.isnan(pivots[0, part, 0])] = np.nan  # a shorter layout, padded
    return result.reshape(1, *block.lead, heliostats, rows, *sizes.values())


_MOMENTS = ("mean_y", "mean_z", "variance_y", "variance_z", "covariance", "hit_fraction", "real_fraction", "status")


def _stacked(made: Any) -> Floats:
    """Statistics of one parameter point over (heliostat, row, instant), angles in mrad."""
    moments = [made[name][0] for name in _MOMENTS]
    tolerance = np.moveaxis(made["tolerance"][0] * 1e3, (-1, -2), (0, 1))
    return np.stack([*moments, *tolerance.reshape(-1, *tolerance.shape[2:])], axis=1)
