"""Mode mount_errors: where the six errors of a mount send the beam, fixed, swept or drawn.

Fixed and swept errors give spots; as soon as one error is drawn, statistics over the draws take their place. Draws are
never stored: a block makes those of a few heliostats at a time, shares them among all its instants and parameters, and
keeps what the kernel sums up.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from heliosweep.config.distribution import NORMAL, Distribution
from heliosweep.families.misalignment import mount_errors_blocks as blocks
from heliosweep.families.misalignment.blocks import ERRORS, MountErrors
from heliosweep.families.misalignment.draws import errors_of, sample_count, seed_of
from heliosweep.families.misalignment.instants import instant_sizes
from heliosweep.families.misalignment.mount_errors_variables import MEANS, STATISTICS, STATUS, TOLERANCE, TOLERANCE_AXES
from heliosweep.families.misalignment.places import heliostat_count, place_bytes
from heliosweep.families.misalignment.remarks import status_remarks
from heliosweep.families.misalignment.scene import Scene
from heliosweep.families.misalignment.spots import flagged, hit_fractions
from heliosweep.families.misalignment.variables import FLAGS, HITS, SPOTS
from heliosweep.grid.axes import Grid
from heliosweep.grid.evaluate import Output, evaluate
from heliosweep.grid.plan import Workload

if TYPE_CHECKING:
    from heliosweep.families.misalignment.config import MisalignmentStudy

Floats = NDArray[np.float64]

#: Time of one spot on one core, alone or within statistics. [s]
SECONDS_PER_SPOT, SECONDS_WITHIN = 110e-9, 60e-9
#: Time of one draw of one error, and of what all instants share of a draw of all errors. [s]
SECONDS_PER_DRAW, SECONDS_PER_SAMPLE = 35e-9, 250e-9
#: What the kernel holds of one draw of one heliostat. [bytes]
KERNEL_BYTES = 640
#: Percentiles of the remaining tolerance where the study names none.
PERCENTILES = (5.0, 50.0, 95.0)


def is_drawn(study: MisalignmentStudy) -> bool:
    """Whether an error of the mounts is drawn."""
    return sample_count(_block(study)) > 0


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
    samples, instants = sample_count(_block(study)), instant_sizes(study)
    count, heliostats = math.prod(instants.values()), heliostat_count(grid)
    inner = {"heliostat": heliostats, **instants}
    if samples:
        inner |= {"percentile": len(_percentiles(study)), "tolerance_axis": len(TOLERANCE_AXES)}
    drawn = sum(isinstance(error, Distribution) for error in errors_of(_block(study)))
    shared = SECONDS_PER_SAMPLE + drawn * SECONDS_PER_DRAW
    stored = 8 * (blocks.row_count(inner["percentile"]) + 1 if samples else 6)

    def block_bytes(points: int, length: int) -> int:
        held = min(length, blocks.at_a_time(samples)) if samples else 0
        # Deviates, scaled ones, errors and the kernel's copy of them; the results are copied once.
        return held * samples * 8 * 4 * len(ERRORS) + samples * KERNEL_BYTES + 2 * points * length * count * stored

    return Workload(
        parameters=grid.sizes,
        inner=inner,
        evaluations=heliostats * count * max(samples, 1),
        unit="spots",
        seconds=SECONDS_WITHIN + shared / count if samples else SECONDS_PER_SPOT,
        splittable="heliostat",
        variables=_dims_of(study, tuple(grid.sizes)),
        itemsize=dict.fromkeys(FLAGS, 1),
        block_bytes=block_bytes,
        seconds_per_point=50e-6,
        coordinate_bytes=place_bytes(grid) + 16 * count,
        axes={"samples": samples} if samples else {},
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
        The variables of `variables` or, with draws, of `mount_errors_variables`, not yet computed.
    """
    scene = Scene(study, chunks, select)
    result = _statistics(scene) if is_drawn(study) else _spots(scene)
    labels = _coordinates(scene)
    ordered = {name: result[name].transpose(*dims) for name, dims in _dims_of(study, tuple(scene.grid.sizes)).items()}
    return xr.Dataset(ordered, attrs=labels.attrs).assign_coords(labels.coords)


def remarks(result: xr.Dataset) -> Iterator[str]:
    """What the user should be told of a finished result."""
    yield from status_remarks(result)
    if "real_fraction" in result:
        real = result["real_fraction"].to_numpy()
        some, none = int(np.count_nonzero((real > 0) & (real < 1))), int(np.count_nonzero(real == 0))
        if some:
            yield f"{some:,} of {real.size:,} statistics leave out draws whose ray does not reach the receiver's plane"
        if none:
            yield f"{none:,} of {real.size:,} statistics are missing: no draw's ray reaches the receiver's plane"


def _block(study: MisalignmentStudy) -> MountErrors:
    assert study.mount_errors is not None
    return study.mount_errors


def _percentiles(study: MisalignmentStudy) -> Floats:
    return np.array(PERCENTILES if study.statistics is None else study.statistics.percentiles.values(), np.float64)


def _dims_of(study: MisalignmentStudy, swept: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Dimensions of every variable of the result."""
    instants = tuple(instant_sizes(study))
    day, _ = instants
    if not is_drawn(study):
        dims = dict.fromkeys((*SPOTS, *FLAGS), (*swept, "heliostat", *instants))
        return dims | dict.fromkeys(HITS, (*swept, "heliostat", day))
    dims = dict.fromkeys((*STATISTICS, *STATUS), (*swept, "heliostat", *instants))
    dims |= dict.fromkeys(TOLERANCE, (*swept, "heliostat", *instants, "percentile", "tolerance_axis"))
    return dims | {"day_hit_fraction": (*swept, "heliostat", day), "field_hit_fraction": (*swept, *instants)}


def _coordinates(scene: Scene) -> xr.Dataset:
    block = _block(scene.study)
    fixed = [name for name in ERRORS if not isinstance(getattr(block, name), Distribution)]
    drawn = is_drawn(scene.study)
    labels = scene.coordinates([f"mount_errors.{name}" for name in (*fixed, *(["scale"] if drawn else []))])
    if not drawn:
        return labels
    percentile = {"long_name": "percentile over the draws", "units": "1"}
    axis = {"long_name": "in-mirror axis about which the mirror turns"}
    return labels.assign_coords(
        percentile=("percentile", _percentiles(scene.study), percentile),
        tolerance_axis=("tolerance_axis", np.array(TOLERANCE_AXES, dtype=object), axis),
    ).assign_attrs(mount_errors=_described(block))


def _described(block: MountErrors) -> str:
    """The distributions in words."""
    parts = []
    for name in ERRORS:
        error = getattr(block, name)
        if isinstance(error, Distribution):
            first, second = error.parts
            values = (
                f"mean {first:g}, standard deviation {second:g}" if error.kind == NORMAL else f"{first:g} to {second:g}"
            )
            seed = "" if error.seed is None else f", seed {error.seed}"
            parts.append(f"{name} {error.kind} ({values} mrad{seed})")
    drawn = f"{sample_count(block)} draws of Philox 4x64, seed {seed_of(block)}, keyed by error and heliostat"
    return f"{'; '.join(parts)}; {drawn}"


def _arguments(scene: Scene) -> dict[str, Any]:
    """Arguments of `evaluate` for a block of every heliostat and parameter: the scene's, the scale, the six errors."""
    block = _block(scene.study)
    errors = [
        xr.DataArray(error.mean) if isinstance(error, Distribution) else scene.grid.parameter(f"mount_errors.{name}")
        for name, error in zip(ERRORS, errors_of(block), strict=True)
    ]
    inputs = [*scene.arguments, scene.grid.parameter("mount_errors.scale"), *errors]
    return {
        "inputs": inputs,
        "core": [*scene.core, *([()] * (1 + len(ERRORS)))],
        "dims": scene.dims,
        "sizes": scene.sizes,
        "chunks": scene.chunks,
    }


def _spots(scene: Scene) -> dict[str, xr.DataArray]:
    """Spots, flags and the hit fraction of each day, of fixed and swept errors."""
    instants = scene.instants.sizes
    made = evaluate(
        partial(blocks.spots_block, sizes=instants),
        **_arguments(scene),
        outputs=SPOTS | {"status": {}},
        output_core=instants,
        name="spots",
    )
    flags = flagged(scene, made, scene.chunks)
    return {name: made[name] for name in SPOTS} | flags | hit_fractions(flags, scene, scene.chunks)


def _statistics(scene: Scene) -> dict[str, xr.DataArray]:
    """Statistics over the draws, and what follows from the hit fraction."""
    study, instants = scene.study, scene.instants.sizes
    block, percentiles = _block(study), _percentiles(study)
    outputs = {
        name: Output(attrs, partial(_row, place=place), instants)
        for place, (name, attrs) in enumerate(STATISTICS.items())
    }
    ((status, status_attrs),) = STATUS.items()
    outputs[status] = Output(status_attrs, partial(_status, place=len(STATISTICS)), instants, np.int8)
    ((tolerance, tolerance_attrs),) = TOLERANCE.items()
    axes = {"tolerance_axis": len(TOLERANCE_AXES), "percentile": percentiles.size}
    outputs[tolerance] = Output(
        tolerance_attrs, partial(_tolerances, first=len(STATISTICS) + 1, shape=tuple(axes.values())), axes | instants
    )
    result = evaluate(
        partial(
            blocks.statistics_block,
            errors=errors_of(block),
            samples=sample_count(block),
            seed=seed_of(block),
            percentiles=percentiles,
            sizes=instants,
        ),
        **_arguments(scene),
        outputs=outputs,
        order=_dims_of(study, tuple(scene.grid.sizes)),
        name="mount-statistics",
    )
    means = {
        "day_hit_fraction": ("hour", (*scene.dims, scene.instants.day)),
        "field_hit_fraction": ("heliostat", (*scene.grid.sizes, *instants)),
    }
    for name, (over, dims) in means.items():
        result |= evaluate(
            blocks.mean_block,
            [result["hit_fraction"]],
            dims=dims,
            core=[(over,)],
            sizes={**scene.sizes, **instants},
            chunks=scene.chunks,
            outputs={name: MEANS[name]},
            name="hit-fraction",
            work=False,
        )
    return result


def _row(rows: Floats, place: int) -> Floats:
    """One statistic out of rows over (dimensions of a block, row, day, hour)."""
    return rows[..., place, :, :]


def _status(rows: Floats, place: int) -> NDArray[np.int8]:
    status: NDArray[np.int8] = blocks.status_block(_row(rows, place))[0]
    return status


def _tolerances(rows: Floats, first: int, shape: tuple[int, ...]) -> Floats:
    """Percentiles about each axis."""
    return rows[..., first:, :, :].reshape((*rows.shape[:-3], *shape, *rows.shape[-2:]))
