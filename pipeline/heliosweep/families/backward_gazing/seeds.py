"""Medians and percentiles over the seeds of a study."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from heliosweep.families.backward_gazing.variables import PERCENTILES, Entry
from heliosweep.grid.evaluate import evaluate

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.config import BackwardGazingStudy

#: Keys along which scenes differ by their random numbers alone.
SEEDS = ("cameras.seed", "defects.seed", "profile_noise.seed")


def seed_dims(study: BackwardGazingStudy) -> tuple[str, ...]:
    """Swept dimensions along which nothing but seeds varies."""
    return tuple(dim.name for dim in study.dimensions() if set(dim.sweeps) <= set(SEEDS))


def over_seeds(
    result: Mapping[str, xr.DataArray],
    entries: Mapping[str, Entry],
    seeds: tuple[str, ...],
    chunks: Mapping[str, int],
) -> dict[str, xr.DataArray]:
    """Lazy statistics over the seeds.

    Parameters
    ----------
    result : mapping of str to xarray.DataArray
        Of every point.
    entries : mapping of str to Entry
        Statistics: the name of a variable of `result`, ``_`` and a key of `PERCENTILES`.
    seeds : tuple of str
        Dimensions of the seeds.
    chunks : mapping of str to int
        Block lengths.
    """
    made: dict[str, xr.DataArray] = {}
    for name in dict.fromkeys(name.rpartition("_")[0] for name in entries):
        array = result[name]
        dims = tuple(str(dim) for dim in array.dims if dim not in seeds)
        outputs = {f"{name}_{ending}": entries[f"{name}_{ending}"][1] for ending in PERCENTILES}
        made |= evaluate(
            partial(_percentiles, number=len(seeds)),
            [array],
            dims=dims,
            core=[seeds],
            sizes={dim: array.sizes[dim] for dim in dims},
            chunks=chunks,
            outputs=outputs,
            name="seeds",
            work=False,
        )
    return made


def _percentiles(values: np.ndarray, number: int) -> np.ndarray:
    """Percentiles over the last `number` dimensions, NaN left out, stacked in front; linear between values."""
    flat = np.sort(values.reshape(*values.shape[: values.ndim - number], -1), axis=-1)  # NaN last
    count = np.count_nonzero(np.isfinite(flat), axis=-1)
    made = []
    for percent in PERCENTILES.values():
        place = 0.01 * percent * np.maximum(count - 1, 0)
        below = np.floor(place).astype(np.int64)
        above = np.minimum(below + 1, np.maximum(count - 1, 0))
        low = np.take_along_axis(flat, below[..., np.newaxis], -1)[..., 0]
        high = np.take_along_axis(flat, above[..., np.newaxis], -1)[..., 0]
        made.append(low + (place - below) * (high - low))
    return np.stack(made)


def mixed_seed(seed: int, *numbers: int) -> int:
    """A seed of its own for each of some numbers, whatever the others are: by the finaliser of SplitMix64."""
    state = seed
    for number in numbers:
        state = (state + (number + 1) * 0x9E3779B97F4A7C15) % 2**64
        state = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) % 2**64
        state = ((state ^ (state >> 27)) * 0x94D049BB133111EB) % 2**64
        state ^= state >> 31
    return state % 2**63
