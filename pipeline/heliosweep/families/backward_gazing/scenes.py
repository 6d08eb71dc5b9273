"""One simulated heliostat: images, slopes by all methods, and what they say of its modules.

A block of the grid is computed point by point. The images of a point are rendered once and shared by its methods and
referentials. What has no part in a point (the seed of a noise that is 0) is set to 0 first; so points that differ in it
alone are the same point, and the last few points are remembered.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from heliosweep.families.backward_gazing import labels, points
from heliosweep.families.backward_gazing.module_results import results
from heliosweep.families.backward_gazing.rows import Row
from heliosweep.families.backward_gazing.seeds import over_seeds, seed_dims
from heliosweep.families.backward_gazing.variables import DTYPES, MAPS, NOT_SEEN, OVER_SEEDS, SEEN, SIMULATED, Entry
from heliosweep.grid.axes import Grid
from heliosweep.grid.evaluate import evaluate
from heliosweep.grid.plan import Workload

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.config import BackwardGazingStudy


def workload(study: BackwardGazingStudy) -> Workload:
    """Sizes and cost, for the plan.

    Parameters
    ----------
    study : BackwardGazingStudy
        Checked study.

    Returns
    -------
    Workload
    """
    grid = Grid(study)
    entries, sizes = _entries(study), labels.sizes_of(study)
    seeds = seed_dims(study)
    pixels, row = labels.most_pixels(study), Row(entries, sizes).length
    variables = {name: (*grid.sizes, *dims) for name, (dims, _) in entries.items()}
    rest = tuple(dim for dim in grid.sizes if dim not in seeds)
    variables |= {name: (*rest, *dims) for name, (dims, _) in _statistics(study).items()}

    def block_bytes(number: int, _: int) -> int:
        return pixels * points.bytes_per_pixel(study) + 2 * 8 * row * number

    return Workload(
        parameters=grid.sizes,
        inner=sizes,
        evaluations=pixels,
        unit="pixels",
        seconds=points.seconds_per_pixel(study),
        splittable="",
        variables=variables,
        itemsize={name: np.dtype(dtype).itemsize for name, dtype in DTYPES.items()},
        block_bytes=block_bytes,
        whole=seeds,
        seconds_per_point=points.SECONDS_PER_POINT,
        coordinate_bytes=labels.coordinate_bytes(study),
        fixed_bytes=points.KERNEL_BYTES,
    )


def coordinates(study: BackwardGazingStudy, select: Mapping[str, slice] | None = None) -> xr.Dataset:
    """Coordinates of the result over a part of the parameter grid, all of it where `select` is left out."""
    return labels.coordinates(study, select)


def build(
    study: BackwardGazingStudy, chunks: Mapping[str, int], select: Mapping[str, slice] | None = None
) -> xr.Dataset:
    """Lazy result over a part of the parameter grid.

    Parameters
    ----------
    study : BackwardGazingStudy
        Checked study.
    chunks : mapping of str to int
        Block lengths, from the plan.
    select : mapping of str to slice, optional
        Part of the swept dimensions; all of them where left out.

    Returns
    -------
    xarray.Dataset
        The variables of `variables`, not yet computed.
    """
    grid = Grid(study, select)
    row = Row(_entries(study), labels.sizes_of(study))
    inputs = points.inputs(grid)
    result = evaluate(
        partial(_block, row=row, given=points.given(study), maps=study.output.maps),
        inputs,
        dims=tuple(grid.sizes),
        core=[()] * len(inputs),
        sizes=grid.sizes,
        chunks=chunks,
        outputs=row.outputs(),
        name="scenes",
    )
    result |= over_seeds(result, _statistics(study), seed_dims(study), chunks)
    found = coordinates(study, select)
    return xr.Dataset(result).assign_coords(found.coords).assign_attrs(found.attrs)


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Heliostats without slopes, modules that the cameras do not see whole."""
    status = result["scene_status"].to_numpy()
    missing = {
        int(code): int(np.count_nonzero(status == code)) for code in np.unique(status) if code not in (SEEN, NOT_SEEN)
    }
    unseen = int(np.count_nonzero(status == NOT_SEEN))
    if unseen:
        which = "the heliostat" if status.size == 1 else f"{unseen:,} of {status.size:,} heliostats"
        yield (
            f"no slopes of {which}: nowhere do three cameras see the reflected sun, and all of its pixels are masked; "
            "is it aimed at the target?"
        )
    for code, count in missing.items():
        meaning = labels.status_words(code)
        yield f"no slopes at {count:,} of {status.size:,} points: {meaning} (scene_status {code})"
    usable = result["usable_fraction"].where(result["scene_status"] == SEEN)
    partly = usable.where(usable < 1.0)
    if bool(partly.notnull().any()):
        least, at = float(partly.min()), int(partly.notnull().sum())
        yield (
            f"{at:,} of {int(usable.notnull().sum()):,} modules, counted for each method, are not seen whole by three "
            f"cameras; the least has slopes for {math.floor(1000.0 * least) / 10.0:g} % of its pixels"
        )


def _entries(study: BackwardGazingStudy) -> dict[str, Entry]:
    return {**SIMULATED, **(MAPS if study.output.maps else {})}


def _statistics(study: BackwardGazingStudy) -> dict[str, Entry]:
    return OVER_SEEDS if seed_dims(study) else {}


def _block(*arrays: np.ndarray, row: Row, given: points.Given, maps: bool) -> np.ndarray:
    """Rows of a block, shape (1, swept dimensions, row)."""
    lead = np.broadcast_shapes(*(array.shape for array in arrays))
    every = [np.broadcast_to(array, lead).ravel() for array in arrays]
    out = np.empty((math.prod(lead), row.length))
    for number, values in enumerate(zip(*every, strict=True)):
        out[number] = row.packed(results(points.Point.of(values), given, maps))
    return out.reshape(1, *lead, row.length)
