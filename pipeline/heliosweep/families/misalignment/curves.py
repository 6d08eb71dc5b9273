"""Mode `curves`: deviation curves of single misalignments, their tolerances, conics and crossings with detectors.

What varies with the size of the error is computed for every point of the grid; what belongs to a whole curve once for
all sizes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from heliosweep.families.misalignment import variables
from heliosweep.families.misalignment.blocks import AXES, SOURCES
from heliosweep.families.misalignment.instants import instant_sizes
from heliosweep.families.misalignment.places import heliostat_count, place_bytes
from heliosweep.families.misalignment.remarks import status_remarks
from heliosweep.families.misalignment.scene import Block, Scene, block_result, coordinates_of, points
from heliosweep.families.misalignment.spots import flagged, hit_fractions
from heliosweep.grid.axes import Grid
from heliosweep.grid.evaluate import Output, evaluate
from heliosweep.grid.plan import Workload
from heliosweep.kernels.conics import conics
from heliosweep.kernels.detectors import crossings
from heliosweep.kernels.deviation import deviation_spots
from heliosweep.kernels.tolerances import tolerances

if TYPE_CHECKING:
    from heliosweep.families.misalignment.config import MisalignmentStudy

#: Time of a spot, and of what belongs to a whole curve at one instant, on one core. [s]
SECONDS_PER_SPOT, SECONDS_PER_CURVE, SECONDS_PER_CROSSING = 40e-9, 700e-9, 500e-9
#: Overhead of a parameter point. [s]
SECONDS_PER_POINT = 20e-6

_LABELS = ("error.source", "error.axis", "error.size")
_SOURCES = {name: code for code, name in enumerate(SOURCES)}
_AXES = {name: code for code, name in enumerate(AXES)}


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
    heliostats, instants = heliostat_count(grid), instant_sizes(study)
    lines = 0 if study.detectors is None else len(study.detectors.lines)
    number = math.prod(instants.values())
    sizes = math.prod(grid.sizes.values()) / max(1, math.prod(grid.sizes[dim] for dim in _curve_dims(grid)))
    per_curve = SECONDS_PER_CURVE + lines * SECONDS_PER_CROSSING

    def block_bytes(points: int, length: int) -> int:
        # Spots with their status as the kernel makes them, and as flags are made of them; curves, with a copy.
        return points * length * number * (2 * 3 * 8 + 3 + math.ceil(2 * 8 * (10 + 3 * lines) / sizes)) + 24 * number

    inner = {"heliostat": heliostats, **instants, "conic_coefficient": len(variables.COEFFICIENTS)}
    return Workload(
        parameters=grid.sizes,
        inner=inner | ({"detector": lines} if lines else {}),
        evaluations=heliostats * number,
        unit="spots",
        seconds=SECONDS_PER_SPOT + per_curve / sizes,
        splittable="heliostat",
        variables=_dims_of(study, grid, tuple(instants)),
        itemsize=dict.fromkeys(variables.FLAGS, 1),
        block_bytes=block_bytes,
        seconds_per_point=SECONDS_PER_POINT,
        coordinate_bytes=place_bytes(grid) + 8 * (2 * number + sum(instants.values())),
    )


def _curve_dims(grid: Grid) -> tuple[str, ...]:
    """Swept dimensions without the one along which only the size of the error varies."""
    alone = {dim.name for dim in grid.study.dimensions() if set(dim.sweeps) == {"error.size"}}
    return tuple(dim for dim in grid.sizes if dim not in alone)


def _dims_of(study: MisalignmentStudy, grid: Grid, instants: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Dimensions of every variable of the result, in the order of the file."""
    points, curve = (*grid.sizes, "heliostat"), (*_curve_dims(grid), "heliostat")
    dims = dict.fromkeys((*variables.SPOTS, *variables.FLAGS), (*points, *instants))
    dims |= dict.fromkeys(variables.HITS, (*points, instants[0]))
    dims |= dict.fromkeys((*variables.TOLERANCES, *variables.CONICS), (*curve, *instants))
    dims["conic"] = (*curve, *instants, "conic_coefficient")
    dims |= dict.fromkeys(variables.LEAST, curve)
    if study.time is not None:
        dims |= dict.fromkeys(variables.least_at(instants[0]), curve)
    if study.detectors is not None:
        dims |= dict.fromkeys(variables.CROSSINGS, (*curve, *instants, "detector"))
    return dims


def coordinates(study: MisalignmentStudy, select: Mapping[str, slice] | None = None) -> xr.Dataset:
    """Coordinates of the result over a part of the parameter grid, all of it where `select` is left out."""
    return _labelled(study, coordinates_of(study, select, _LABELS))


def _labelled(study: MisalignmentStudy, labels: xr.Dataset) -> xr.Dataset:
    """Add the coordinates that only this mode has."""
    names = xr.DataArray(
        np.array(variables.COEFFICIENTS, dtype=object),
        dims="conic_coefficient",
        attrs={"long_name": "coefficient of the deviation curve"},
    )
    added = {"conic_coefficient": names}
    if study.detectors is not None:
        lines = np.array(study.detectors.lines, np.float64)
        added["detector"] = xr.DataArray(np.arange(len(lines)), dims="detector", attrs=variables.DETECTOR)
        for column, (name, attrs) in zip(lines.T, variables.DETECTOR_COEFFICIENTS.items(), strict=True):
            added[name] = xr.DataArray(column, dims="detector", attrs=attrs)
    return labels.assign_coords(added)


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
        The variables of `variables`, not yet computed.
    """
    made = _Evaluation(Scene(study, chunks, select))
    result = made.spots()
    result |= flagged(made.scene, result, chunks)
    result |= hit_fractions(result, made.scene, chunks)
    result |= made.curves()
    result |= made.least(result["tolerance"])
    if study.detectors is not None:
        result |= made.crossings(np.array(study.detectors.lines, np.float64))
    order = _dims_of(study, made.scene.grid, tuple(made.scene.instants.sizes))
    return xr.Dataset({name: result[name].transpose(*dims) for name, dims in order.items()}).assign_coords(
        _labelled(study, made.scene.coordinates(_LABELS)).coords
    )


def remarks(result: xr.Dataset) -> Iterable[str]:
    """How many heliostats and rays have no spot, and why."""
    return status_remarks(result)


class _Evaluation:
    """Hands the kernels to dask, over one part of the grid."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        parameter = scene.grid.parameter
        self._error = [parameter("error.source"), parameter("error.axis")]
        self._instants = scene.instants.sizes
        self._curve_dims = (*_curve_dims(scene.grid), "heliostat")

    def spots(self) -> dict[str, xr.DataArray]:
        """Where the spots are, and `spot_status` as it comes from the kernel."""
        return evaluate(
            partial(_spots, instants=self._instants),
            [*self.scene.arguments, *self._error, self.scene.grid.parameter("error.size")],
            dims=self.scene.dims,
            core=[*self.scene.core, (), (), ()],
            sizes=self.scene.sizes,
            chunks=self.scene.chunks,
            outputs={**variables.SPOTS, "status": {}},
            name="spots",
            output_core=self._instants,
        )

    def curves(self) -> dict[str, xr.DataArray]:
        """Tolerances and conics."""
        result = self._of_curve(_tolerances, variables.TOLERANCES, "tolerances", {})
        count = len(variables.COEFFICIENTS)
        cuts: dict[str, int | slice] = {"conic": slice(0, count), "eccentricity": count}
        cuts |= {"focus_y": count + 1, "focus_z": count + 2}
        outputs = {
            name: Output(
                variables.CONICS[name],
                partial(_of_last, place=place),
                {**self._instants, **({"conic_coefficient": count} if name == "conic" else {})},
            )
            for name, place in cuts.items()
        }
        return result | self._of_curve(_conics, outputs, "conics", {})

    def crossings(self, lines: np.ndarray) -> dict[str, xr.DataArray]:
        """Crossings with the lines of detectors."""
        face = partial(_crossings, lines=lines)
        return self._of_curve(face, variables.CROSSINGS, "crossings", {"detector": len(lines)})

    def _of_curve(
        self, face: Any, outputs: Mapping[str, Mapping[str, Any] | Output], name: str, inner: Mapping[str, int]
    ) -> dict[str, xr.DataArray]:
        """What does not depend on the size of the error."""
        return evaluate(
            partial(face, instants=self._instants),
            [*self.scene.arguments, *self._error],
            dims=self._curve_dims,
            core=[*self.scene.core, (), ()],
            sizes=self.scene.sizes,
            chunks=self.scene.chunks,
            outputs=outputs,
            name=name,
            output_core={**self._instants, **inner},
            work=False,
        )

    def least(self, tolerance: xr.DataArray) -> dict[str, xr.DataArray]:
        """Least tolerance of all instants, and when it is."""
        labels, (day, hour) = self.scene.instants.labels, self._instants
        result = self._least([tolerance], variables.LEAST, 0)
        if not labels:
            return result
        attrs = variables.least_at(day)
        for dim, position in ((day, 1), (hour, 2)):
            name = f"{dim}_of_least_tolerance"
            label = xr.DataArray(labels[dim].to_numpy(), dims=dim)
            result |= self._least([tolerance, label], {name: attrs[name]}, position)
        return result

    def _least(
        self, inputs: list[xr.DataArray], outputs: Mapping[str, Mapping[str, Any]], position: int
    ) -> dict[str, xr.DataArray]:
        day_and_hour = tuple(self._instants)
        dated = inputs[-1].dtype.kind == "M"
        return evaluate(
            partial(_least, position=position),
            inputs,
            dims=self._curve_dims,
            core=[day_and_hour, *(tuple(map(str, label.dims)) for label in inputs[1:])],
            sizes=self.scene.sizes,
            chunks=self.scene.chunks,
            outputs=outputs,
            name="least",
            work=False,
            dtype=np.dtype("datetime64[ns]") if dated else np.float64,
        )


def _of_last(values: np.ndarray, place: int | slice) -> np.ndarray:
    return values[..., place]


def _misaligned(block: Block) -> tuple[np.ndarray, np.ndarray]:
    """Codes of source and axis of the error over P points."""
    source, axis = (
        np.array([codes[str(name)] for name in points(names, block.lead)], np.int64)
        for codes, names in zip((_SOURCES, _AXES), block.others, strict=False)
    )
    return source, axis


def _spots(*arrays: np.ndarray, instants: Mapping[str, int]) -> np.ndarray:
    """y, z [m] and status for a block."""
    block = Block.of(*arrays)
    size = 1e-3 * points(block.others[2], block.lead).astype(np.float64)
    found = deviation_spots(block.setting, *_misaligned(block), size, block.sun, block.pivots)
    return block_result(found, block, instants)


def _tolerances(*arrays: np.ndarray, instants: Mapping[str, int]) -> np.ndarray:
    """Tolerance for a block. [mrad]."""
    block = Block.of(*arrays)
    found = tolerances(block.setting, *_misaligned(block), block.sun, block.pivots)
    return block_result(1e3 * found[np.newaxis], block, instants)


def _conics(*arrays: np.ndarray, instants: Mapping[str, int]) -> np.ndarray:
    """Coefficients, eccentricity and focus of a block's curves along the last dimension."""
    block = Block.of(*arrays)
    found = conics(block.setting, *_misaligned(block), block.sun, block.pivots)
    return block_result(np.moveaxis(found, 0, -1)[np.newaxis], block, instants)


def _crossings(*arrays: np.ndarray, instants: Mapping[str, int], lines: np.ndarray) -> np.ndarray:
    """y, z [m] and error [mrad] of a block's crossings with each line."""
    block = Block.of(*arrays)
    found = crossings(block.setting, *_misaligned(block), lines, block.sun, block.pivots)
    return block_result(found * np.array([1.0, 1.0, 1e3]).reshape(3, 1, 1, 1, 1), block, instants)


def _least(tolerance: np.ndarray, *label: np.ndarray, position: int) -> np.ndarray:
    """Least of the tolerances over the last two dimensions, or the label of its day (1) or hour (2)."""
    flat = tolerance.reshape(*tolerance.shape[:-2], -1)
    first = np.where(np.isnan(flat), np.inf, flat).argmin(axis=-1)  # the first of several
    least = np.take_along_axis(flat, first[..., np.newaxis], axis=-1)[..., 0]
    least = np.where(np.isnan(flat).all(axis=-1), np.nan, least)
    if position == 0:
        return least[np.newaxis]
    index = np.unravel_index(first, tolerance.shape[-2:])[position - 1]
    values = label[0].ravel()[index]
    missing = np.datetime64("NaT", "ns") if values.dtype.kind == "M" else np.nan
    return np.where(np.isfinite(least), values, missing)[np.newaxis]
