"""What becomes of spots, whichever errors they have: flags of every spot, and how many of a day hit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from heliosweep.families.misalignment import variables
from heliosweep.families.misalignment.scene import Scene
from heliosweep.grid.evaluate import evaluate
from heliosweep.kernels.receiver import NO_SUN, REACHES


def flagged(scene: Scene, spots: Mapping[str, xr.DataArray], chunks: Mapping[str, int]) -> dict[str, xr.DataArray]:
    """Status of the spots, whether they are on the plane, and whether in the aperture.

    Parameters
    ----------
    scene : Scene
        The part of the grid.
    spots : mapping of str to xarray.DataArray
        ``spot_y``, ``spot_z`` [m] and ``status``, over the dimensions of the scene, days and hours.
    chunks : mapping of str to int
        Block lengths.

    Returns
    -------
    dict of str to xarray.DataArray
        The variables of `variables.FLAGS`, of type int8.
    """
    instants = tuple(scene.instants.sizes)
    sides = [scene.grid.parameter(f"receiver.{side}") for side in ("width", "height_extent")]
    return evaluate(
        _flags,
        [*(spots[name] for name in ("spot_y", "spot_z", "status")), scene.places.inputs[0], *sides],
        dims=scene.dims,
        core=[instants] * 3 + [()] * 3,
        sizes=scene.sizes,
        chunks=chunks,
        outputs=variables.FLAGS,
        name="flags",
        output_core=scene.instants.sizes,
        work=False,
        dtype=np.int8,
    )


def hit_fractions(
    flags: Mapping[str, xr.DataArray], scene: Scene, chunks: Mapping[str, int]
) -> dict[str, xr.DataArray]:
    """Part of the hours with sun in which the spot lies in the aperture.

    Parameters
    ----------
    flags : mapping of str to xarray.DataArray
        ``spot_status`` and ``inside``.
    scene, chunks
        As for `flagged`.
    """
    day, hour = scene.instants.sizes
    return evaluate(
        _hits,
        [flags["spot_status"], flags["inside"]],
        dims=(*scene.dims, day),
        core=[(hour,)] * 2,
        sizes={**scene.sizes, day: scene.instants.sizes[day]},
        chunks=chunks,
        outputs=variables.HITS,
        name="hits",
        work=False,
    )


def _flags(
    y: np.ndarray, z: np.ndarray, status: np.ndarray, x: np.ndarray, width: np.ndarray, height: np.ndarray
) -> np.ndarray:
    """Status, whether real and whether inside, shape (3, *block, days, hours)."""
    x, width, height = (array[..., np.newaxis, np.newaxis] for array in (x, width, height))
    flags = np.empty((3, *y.shape), np.int8)
    flags[0] = np.where(np.isnan(x), variables.NO_HELIOSTAT, status)
    flags[1] = flags[0] == REACHES
    flags[2] = (np.abs(y) <= 0.5 * width) & (np.abs(z) <= 0.5 * height) & (flags[0] == REACHES)
    return flags


def _hits(status: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Fraction over the last dimension, shape (1, *block)."""
    counted = np.count_nonzero((status != NO_SUN) & (status != variables.NO_HELIOSTAT), axis=-1)
    hits = np.count_nonzero(inside, axis=-1)
    return np.divide(hits, counted, out=np.full(hits.shape, np.nan), where=counted > 0)[np.newaxis]
