"""Mode measured: slopes of a heliostat from four images of it, with masks, flags, uncertainties and module estimates.

Images are put on the grid of the mirror first (`kernels.rectification`), and then treated as simulated ones are.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from heliosweep.errors import StudyError
from heliosweep.families.backward_gazing import labels, points
from heliosweep.families.backward_gazing import measured_variables as named
from heliosweep.families.backward_gazing import variables as common
from heliosweep.families.backward_gazing.measured_checks import SIMULATED, view_problems
from heliosweep.families.backward_gazing.measured_images import GEOMETRY, views
from heliosweep.families.backward_gazing.measured_points import block, given
from heliosweep.families.backward_gazing.measured_remarks import remarks
from heliosweep.families.backward_gazing.rows import Row
from heliosweep.grid.axes import Grid
from heliosweep.grid.evaluate import evaluate
from heliosweep.grid.plan import Workload

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.config import BackwardGazingStudy

__all__ = ["build", "coordinates", "remarks", "workload"]

Floats = NDArray[np.float64]

#: Time of a pixel on one core besides the methods of the study: rectification, and LM for the uncertainty. [s]
SECONDS_PER_PIXEL = 4e-6
#: Keys that label a result; those of simulations say nothing of measured images.
LABELS = tuple(key for key in labels.LABELS if not key.startswith(SIMULATED))


def workload(study: BackwardGazingStudy) -> Workload:
    """Sizes and cost, for the plan.

    Parameters
    ----------
    study : BackwardGazingStudy
        Checked study.

    Returns
    -------
    Workload

    Raises
    ------
    StudyError
        If the images cannot be used.
    """
    if problems := list(view_problems(study, [])):
        raise StudyError(problems)
    grid, mapped = Grid(study), _mapped(study)
    sizes = labels.sizes_of(mapped)
    pixels, row = labels.most_pixels(study), Row(named.MEASURED, sizes).length
    held = views(study).images.nbytes

    def block_bytes(number: int, _: int) -> int:
        return 2 * held + pixels * points.bytes_per_pixel(study) + 3 * 8 * row * number

    return Workload(
        parameters=grid.sizes,
        inner=sizes,
        evaluations=pixels,
        unit="pixels",
        seconds=SECONDS_PER_PIXEL + sum(points.SECONDS_PER_METHOD[name] for name in study.method),
        splittable="",
        variables={name: (*grid.sizes, *dims) for name, (dims, _) in named.MEASURED.items()},
        itemsize={name: np.dtype(dtype).itemsize for name, dtype in named.DTYPES.items()},
        block_bytes=block_bytes,
        seconds_per_point=points.SECONDS_PER_POINT,
        coordinate_bytes=labels.coordinate_bytes(mapped),
        fixed_bytes=points.KERNEL_BYTES,
    )


def coordinates(study: BackwardGazingStudy, select: Mapping[str, slice] | None = None) -> xr.Dataset:
    """Coordinates of the result over a part of the parameter grid, all of it where `select` is left out."""
    found, seen = labels.coordinates(_mapped(study), select, LABELS), views(study)
    said = {
        name: xr.DataArray(seen.geometry[name], attrs=named.METADATA[name])
        for _, name in GEOMETRY.values()
        if name in seen.geometry
    }
    for name in ("sun", "target"):
        if f"{name}_azimuth" in said:
            world = (180.0 - said[f"{name}_azimuth"]) % 360.0
            said[f"{name}_world_azimuth"] = world.drop_attrs().assign_attrs(common.COORDINATES[f"{name}_world_azimuth"])
    return found.assign_coords(said).assign_attrs(
        image_files=", ".join(PurePath(entry.file).name for entry in study.images or ()),
        white_levels=" ".join(seen.white_from),
        pixel_noise_from="residuals" if np.isnan(seen.noise) else "study",
        gain_of_each_pixel="fitted" if study.fit_gain or seen.needs_gain else "1",
        rectification="none" if seen.rectified else "corners" if np.isfinite(seen.corners).any() else "pinhole",
    )


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
        The variables of `measured_variables`, not yet computed.
    """
    grid = Grid(study, select)
    row = Row(named.MEASURED, labels.sizes_of(_mapped(study)))
    inputs = points.inputs(grid)
    made = evaluate(
        partial(block, row=row),
        inputs,
        dims=tuple(grid.sizes),
        core=[()] * len(inputs),
        sizes=grid.sizes,
        chunks=chunks,
        outputs=row.outputs(),
        name="measured",
        shared={"given": given(study)},
    )
    found = coordinates(study, select)
    return xr.Dataset(made).assign_coords(found.coords).assign_attrs(found.attrs)


def _mapped(study: BackwardGazingStudy) -> BackwardGazingStudy:
    """The study with maps, which are what this mode is for."""
    return study.model_copy(update={"output": study.output.model_copy(update={"maps": True})})
