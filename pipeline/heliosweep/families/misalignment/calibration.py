"""Mode calibration: the errors of mounts from measured or synthetic spots, and the commands that correct them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from heliosweep.config.distribution import Distribution
from heliosweep.families.misalignment import calibration_blocks as blocks
from heliosweep.families.misalignment.blocks import ERRORS, Calibration
from heliosweep.families.misalignment.calibration_remarks import remarks
from heliosweep.families.misalignment.calibration_variables import (
    CORRECTED,
    DTYPES,
    ESTIMATES,
    MEASURED,
    NOMINAL,
    SYNTHETIC,
    TRUE_ERROR,
)
from heliosweep.families.misalignment.draws import errors_of, sample_count, seed_of
from heliosweep.families.misalignment.instants import instant_sizes
from heliosweep.families.misalignment.measured import measured_spots, most_spots
from heliosweep.families.misalignment.places import heliostat_count, place_bytes
from heliosweep.families.misalignment.scene import Scene
from heliosweep.grid.axes import Grid
from heliosweep.grid.evaluate import Output, evaluate
from heliosweep.grid.plan import Workload

__all__ = ["build", "coordinates", "remarks", "workload"]

if TYPE_CHECKING:
    from heliosweep.families.misalignment.config import MisalignmentStudy

#: Time of a spot on one core: least squares with all its iterations, aiming twice, spots before and after. [s]
SECONDS_PER_SPOT = 6e-6
#: Working memory of a spot. [bytes]
BYTES_PER_SPOT = 200

_PARAMETERS = {"parameter": len(ERRORS), "parameter_2": len(ERRORS)}


def workload(study: MisalignmentStudy) -> Workload:
    """Sizes and cost, for the plan.

    Parameters
    ----------
    study : MisalignmentStudy
        Checked study.

    Returns
    -------
    Workload
    """
    grid = Grid(study)
    samples, instants, heliostats = _samples(study), instant_sizes(study), heliostat_count(grid)
    count = math.prod(instants.values())
    inner = {"heliostat": heliostats} | ({"sample": samples} if _drawn(study) else {}) | _PARAMETERS | instants
    measured = measured_spots(study)
    if measured is not None:
        inner["spot"] = most_spots(measured)
        count += inner["spot"]
    row = _row(study).length

    def block_bytes(points: int, length: int) -> int:
        return length * samples * (BYTES_PER_SPOT * count + 2 * 8 * row * points)

    return Workload(
        parameters=grid.sizes,
        inner=inner,
        evaluations=heliostats * samples * count,
        unit="spots",
        seconds=SECONDS_PER_SPOT,
        splittable="heliostat",
        variables=_dims_of(study, tuple(grid.sizes)),
        itemsize={name: np.dtype(dtype).itemsize for name, dtype in DTYPES.items()},
        block_bytes=block_bytes,
        seconds_per_point=100e-6,
        coordinate_bytes=place_bytes(grid) + 16 * count + 8 * samples,
    )


def coordinates(study: MisalignmentStudy, select: Mapping[str, slice] | None = None) -> xr.Dataset:
    """Coordinates of the result over a part of the parameter grid, all of it where `select` is left out."""
    return _coordinates(Scene(study, {}, select))


def build(study: MisalignmentStudy, chunks: Mapping[str, int], select: Mapping[str, slice] | None = None) -> xr.Dataset:
    """Lazy result over a part of the parameter grid.

    Parameters
    ----------
    study : MisalignmentStudy
        Checked study.
    chunks : mapping of str to int
        Block lengths, from the plan.
    select : mapping of str to slice, optional
        Part of the swept dimensions; all of them where left out.

    Returns
    -------
    xarray.Dataset
        The variables of `calibration_variables`, not yet computed.
    """
    scene, row = Scene(study, chunks, select), _row(study)
    common: dict[str, Any] = {"dims": scene.dims, "sizes": scene.sizes, "chunks": chunks}
    dims, attributes, labels = _dims_of(study, tuple(scene.grid.sizes)), _attributes(study), _coordinates(scene)
    measured = measured_spots(study)
    found = evaluate(
        _face(study, row),
        [*scene.arguments, *_arguments(scene)],
        core=[*scene.core, *([()] * len(_arguments(scene)))],
        outputs={name: _output(study, row, name, attributes[name]) for name in row.places},
        order=dims,
        shared={} if measured is None else {"measured": measured},
        name="calibration",
        **common,
    )
    nominal = evaluate(
        partial(blocks.nominal_block, sizes=scene.instants.sizes),
        scene.arguments,
        core=scene.core,
        outputs=NOMINAL,
        output_core=scene.instants.sizes,
        name="commands",
        work=False,
        **common,
    )
    result = xr.Dataset({name: (found | nominal)[name].transpose(*order) for name, order in dims.items()})
    return result.assign_coords(labels.coords).assign_attrs(labels.attrs)


def _block(study: MisalignmentStudy) -> Calibration:
    assert study.calibration is not None
    return study.calibration


def _drawn(study: MisalignmentStudy) -> bool:
    return _block(study).spots is None and study.mount_errors is not None and sample_count(study.mount_errors) > 0


def _samples(study: MisalignmentStudy) -> int:
    """Draws of a heliostat; 1 without."""
    return sample_count(study.mount_errors) if _drawn(study) and study.mount_errors is not None else 1


def _attributes(study: MisalignmentStudy) -> dict[str, Mapping[str, Any]]:
    """Attributes of every variable of a row."""
    limit = _block(study).condition_limit
    found: dict[str, Mapping[str, Any]] = {name: attrs for name, (attrs, _) in ESTIMATES.items()}
    if limit is not None:
        found["condition_number"] = {**found["condition_number"], "condition_limit": float(limit)}
    spots = SYNTHETIC if _block(study).spots is None else MEASURED
    true = {"true_error": TRUE_ERROR[0]} if _block(study).spots is None else {}
    return found | true | CORRECTED | spots


def _inner(study: MisalignmentStudy) -> dict[str, tuple[str, ...]]:
    """Dimensions of every variable of a row, beyond those of heliostats and draws."""
    instants = tuple(instant_sizes(study))
    found = {name: dims for name, (_, dims) in ESTIMATES.items()}
    if _block(study).spots is None:
        found |= {"true_error": TRUE_ERROR[1]} | dict.fromkeys((*SYNTHETIC, *CORRECTED), instants)
    else:
        found |= dict.fromkeys(MEASURED, ("spot",)) | dict.fromkeys(CORRECTED, instants)
    return found


def _row(study: MisalignmentStudy) -> blocks.Row:
    sizes = {**_PARAMETERS, **instant_sizes(study)}
    measured = measured_spots(study)
    if measured is not None:
        sizes["spot"] = most_spots(measured)
    return blocks.Row.of({name: tuple(sizes[dim] for dim in dims) for name, dims in _inner(study).items()})


def _dims_of(study: MisalignmentStudy, swept: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Dimensions of every variable of the result."""
    lead = (*swept, *(("sample",) if _drawn(study) else ()), "heliostat")
    dims = {name: (*lead, *inner) for name, inner in _inner(study).items()}
    return dims | dict.fromkeys(NOMINAL, (*swept, "heliostat", *instant_sizes(study)))


def _output(study: MisalignmentStudy, row: blocks.Row, name: str, attrs: Mapping[str, Any]) -> Output:
    """How a variable is cut out of the rows."""
    _, shape = row.places[name]
    dtype, drawn = DTYPES.get(name, np.float64), _drawn(study)
    sizes = ({"sample": _samples(study)} if drawn else {}) | dict(zip(_inner(study)[name], shape, strict=True))
    return Output(attrs, partial(_cut, span=row.span(name), shape=shape, drawn=drawn, dtype=dtype), sizes, dtype)


def _cut(rows: np.ndarray, span: slice, shape: tuple[int, ...], drawn: bool, dtype: type) -> np.ndarray:
    """A variable out of rows over (dimensions of a block, draw, row)."""
    values: np.ndarray = rows[..., span].reshape((*rows.shape[:-1], *shape)).astype(dtype, copy=False)
    return values if drawn else values.take(0, axis=rows.ndim - 2)


def _arguments(scene: Scene) -> list[xr.DataArray]:
    """What a block needs beside the scene."""
    study, grid = scene.study, scene.grid
    loss = [grid.parameter(f"calibration.{key}") for key in ("loss", "loss_scale")]
    parameters = grid.parameter("calibration.parameters")
    if _block(study).spots is not None:
        return [parameters, *loss]
    assert study.mount_errors is not None
    means = [
        xr.DataArray(error.mean) if isinstance(error, Distribution) else grid.parameter(f"mount_errors.{name}")
        for name, error in zip(ERRORS, errors_of(study.mount_errors), strict=True)
    ]
    days, _ = instant_sizes(study).values()
    key = "calibration.days_used"
    used = grid.parameter(key) if grid.has(key) else xr.DataArray(days)
    return [
        grid.parameter("mount_errors.scale"), *means, parameters, used, grid.parameter("calibration.noise"), *loss,
    ]  # fmt: skip


def _face(study: MisalignmentStudy, row: blocks.Row) -> Any:
    """What computes a block."""
    limit = _block(study).condition_limit
    if _block(study).spots is not None:
        return partial(blocks.measured_block, row=row, limit=limit)
    assert study.mount_errors is not None
    _, hours = instant_sizes(study).values()
    return partial(
        blocks.synthetic_block,
        row=row,
        errors=errors_of(study.mount_errors),
        samples=_samples(study),
        seed=seed_of(study.mount_errors),
        hours=hours,
        limit=limit,
    )


def _coordinates(scene: Scene) -> xr.Dataset:
    study = scene.study
    keys = [f"calibration.{key}" for key in ("parameters", "loss", "loss_scale")]
    if _block(study).spots is None:
        keys += ["calibration.noise", "calibration.days_used"]
        assert study.mount_errors is not None
        errors = zip(ERRORS, errors_of(study.mount_errors), strict=True)
        keys += [f"mount_errors.{name}" for name, error in errors if not isinstance(error, Distribution)]
        keys += ["mount_errors.scale"] * _drawn(study)
    labels = scene.coordinates(keys)
    names = np.array(ERRORS, dtype=object)
    labels = labels.assign_coords(
        parameter=("parameter", names, {"long_name": "error of the mount"}),
        parameter_2=("parameter_2", names, {"long_name": "error of the mount"}),
    )
    if _drawn(study):
        sample = {"long_name": "number of the draw, from 0", "units": "1"}
        labels = labels.assign_coords(sample=("sample", np.arange(_samples(study)), sample))
    measured = measured_spots(study)
    if measured is not None:
        spot = {"long_name": "number of the spot of a heliostat, from 0, in the order of the file", "units": "1"}
        labels = labels.assign_coords(spot=("spot", np.arange(most_spots(measured)), spot))
    return labels.assign_attrs(spots="synthetic" if measured is None else "measured")
