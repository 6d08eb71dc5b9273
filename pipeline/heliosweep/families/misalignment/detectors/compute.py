"""Crossings of detectors over a region, the misalignment from them, and what a closed loop leaves of it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.blocks import CONDITION_LIMITS, ERRORS
from heliosweep.families.misalignment.calibration.compute import Inputs, estimate_remarks, inputs, numbered
from heliosweep.families.misalignment.calibration.fits import Mounts
from heliosweep.families.misalignment.detectors.arrays import Pieces, pieces_of
from heliosweep.families.misalignment.detectors.loop import Options, Site, from_table, run_loop
from heliosweep.families.misalignment.detectors.variables import (
    NEITHER,
    NO_AZIMUTH,
    NO_ELEVATION,
    detectors_block,
    draw_count,
    variables,
)
from heliosweep.families.misalignment.draws import mean_errors, standard_deviates, standard_normals, widths_of
from heliosweep.families.misalignment.points import Points, coordinates_of, heliostat_count, instant_sizes, place_bytes
from heliosweep.families.misalignment.spots_file import TRACES
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Workload
from heliosweep.grid.regions import bytes_of
from heliosweep.kernels.warm import warm_calibration

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.study import MisalignmentStudy
    from heliosweep.grid.regions import Region

#: Time of the crossings of both traces and one piece of an array at an instant, in one round, on one core. [s]
SECONDS_PER_CROSSING = 12e-6
#: Working memory of the same. [bytes]
BYTES_PER_CROSSING = 3000
#: Stream of the noise of the first round, after those of spots; numbers of one draw that have room in a stream.
NOISE_STREAM, MOST_NUMBERS = 200, 2**24
#: Values of keys that are left out.
DEFAULTS: dict[str, Any] = {"pitch": 0.0, "noise": 0.0, "parameters": 4, "correction": "mount"}

__all__ = ["inputs"]


def workload(study: MisalignmentStudy) -> Workload:
    """Sizes and cost, for the plan."""
    parameters, instants, heliostats = Parameters(study), instant_sizes(study), heliostat_count(study)
    block, pieces, draws, measured = detectors_block(study), _pieces(study), draw_count(study), study.measured_spots()
    inner = {"heliostat": heliostats} | ({"sample": draws} if draws else {})
    inner |= {"parameter": len(ERRORS), "parameter_2": len(ERRORS), **instants, **_sizes(pieces)}
    count = math.prod(instants.values()) * len(pieces.array)
    if measured is None:
        inner["round"] = (block.rounds or 1) + 1
    else:
        inner["spot"] = measured.most
        count += measured.most
    each = max(1, draws) * count * (block.rounds or 1)
    values = bytes_of(variables(study), {**dict.fromkeys(parameters.sizes, 1), **inner, "heliostat": 1})

    def working_bytes(points: int, length: int) -> int:
        return length * (each * BYTES_PER_CROSSING + 2 * values * points)

    return Workload(
        parameters=parameters.sizes,
        inner=inner,
        evaluations=heliostats * each,
        unit="crossings",
        seconds=SECONDS_PER_CROSSING,
        splittable="heliostat",
        working_bytes=working_bytes,
        seconds_per_point=2e-3,
        coordinate_bytes=place_bytes(study) + 16 * count + 8 * draws,
    )


def coordinates(study: MisalignmentStudy) -> xr.Dataset:
    """Coordinates of the whole result, in memory."""
    block, pieces, draws, measured = detectors_block(study), _pieces(study), draw_count(study), study.measured_spots()
    keys = [f"detectors.{key}" for key in ("parameters", "pitch", "noise")]
    if measured is None:
        assert study.mount_errors is not None
        drawn = study.mount_errors.drawn()
        keys += ["detectors.correction"]
        keys += [f"mount_errors.{name}" for name in (*ERRORS, *(["scale"] if draws else [])) if name not in drawn]
    error = np.array(ERRORS, dtype=object), {"long_name": "error of the mount"}
    labels: dict[str, Any] = {dim: (dim, *error) for dim in ("parameter", "parameter_2")}
    trace = {"long_name": "trace, by the axis of the cylinder that makes it"}
    labels["trace"] = "trace", np.array(TRACES, dtype=object), trace
    sizes = _sizes(pieces)
    labels["detector"] = numbered(
        "detector", sizes["detector"], "number of the array of detectors, from 0, lines first"
    )
    labels["crossing"] = numbered(
        "crossing", sizes["crossing"], "number of the crossing of a trace and an array, from 0"
    )
    if draws:
        labels["sample"] = numbered("sample", draws, "number of the draw, from 0")
    if measured is None:
        labels["round"] = numbered("round", (block.rounds or 1) + 1, "rounds of the closed loop that are done")
    else:
        meaning = "number of the crossing of a heliostat, from 0, in the order of the file"
        labels["spot"] = numbered("spot", measured.most, meaning)
    if block.parameters is None:
        labels["parameters"] = (), DEFAULTS["parameters"], {"long_name": "number of estimated errors", "units": "1"}
    found = coordinates_of(study, keys).assign_coords(labels)
    return found.assign_attrs(crossings="synthetic" if measured is None else "measured", detectors=_described(pieces))


def prepare(study: MisalignmentStudy) -> tuple[float, bool]:
    """Load or compile the kernels; seconds it took, and whether something was compiled."""
    return warm_calibration()


def compute(study: MisalignmentStudy, inputs: Inputs, region: Region) -> xr.Dataset:
    """Crossings, estimates and commands of a region along the swept dimensions and ``heliostat``.

    NaN, and a status that says so, where a shorter layout is padded.
    """
    points, stated, pieces = Points.of(study, inputs.places, region), variables(study), _pieces(study)
    block, draws, measured = detectors_block(study), draw_count(study), inputs.measured
    samples, count = max(1, draws), points.numbers.size
    shape = (count, samples, points.instants.count, *_sizes(pieces).values())
    actual = np.zeros((len(points.setting.kind), count, samples, len(ERRORS)))
    if study.mount_errors is not None:
        errors, seed = study.mount_errors.errors(), study.mount_errors.seed or 0
        deviates = standard_deviates(errors, points.numbers, samples, seed)
        scale = points.values("mount_errors.scale")[:, np.newaxis, np.newaxis, np.newaxis]
        actual += mean_errors(points, study.mount_errors)[:, np.newaxis, np.newaxis]
        actual += scale * widths_of(errors) * deviates
    made: dict[str, list[NDArray[Any]]] = {}
    for point in range(len(actual)):
        options = _options(study, points, point)
        site = Site(Mounts.of(points, point), pieces, actual[point] * 1e-3)
        if measured is not None:
            found = from_table(site, options, points.numbers, measured)
        else:
            found = run_loop(site, options, lambda number: _noise(study, points.numbers, number, shape))
            found["true_error"] = actual[point]
        for name, array in found.items():
            if name in stated:
                made.setdefault(name, []).append(array.swapaxes(0, 1))
        nominal = np.degrees(site.mounts.ideal())
        for index, name in enumerate(("nominal_azimuth", "nominal_elevation")):
            made.setdefault(name, []).append(nominal[..., index])
    inner = {"parameter": len(ERRORS), "parameter_2": len(ERRORS), "sample": draws}
    inner |= _sizes(pieces) | {"round": (block.rounds or 1) + 1, "spot": measured.most if measured is not None else 0}
    return xr.Dataset(points.labelled(stated, {name: np.stack(arrays) for name, arrays in made.items()}, **inner))


def _options(study: MisalignmentStudy, points: Points, point: int) -> Options:
    """What the study says of its detectors at a point."""
    block = detectors_block(study)
    pitch, noise, parameters, correction = (
        points.values(f"detectors.{key}")[point] if points.parameters.has(f"detectors.{key}") else default
        for key, default in DEFAULTS.items()
    )
    limit = CONDITION_LIMITS[int(parameters)] if block.condition_limit is None else block.condition_limit
    return Options(float(pitch), float(noise), int(parameters), float(limit), str(correction), block.rounds or 1)


def _noise(
    study: MisalignmentStudy, numbers: NDArray[np.int64], number: int, shape: tuple[int, ...]
) -> NDArray[np.float64]:
    """Standard normal numbers of one round, of one draw whatever the others."""
    seed = 0 if study.mount_errors is None else study.mount_errors.seed or 0
    each = math.prod(shape[2:])
    noise = np.empty((shape[0], shape[1], each))
    for sample in range(shape[1]):
        noise[:, sample] = standard_normals(seed, NOISE_STREAM + number, numbers, each, sample * MOST_NUMBERS)
    return noise.reshape(shape)


def _pieces(study: MisalignmentStudy) -> Pieces:
    return pieces_of(detectors_block(study))


def _sizes(pieces: Pieces) -> dict[str, int]:
    """Lengths of the dimensions of the arrays and of their crossings."""
    return {"trace": len(TRACES), "detector": pieces.arrays, "crossing": pieces.most}


def _described(pieces: Pieces) -> str:
    """The straight pieces in numbers, one after the other: array, start y and z, direction y and z, length."""
    numbers = zip(pieces.array, pieces.start, pieces.along, pieces.last - pieces.first, strict=True)
    return "; ".join(
        f"{array}: {start[0]:.12g} {start[1]:.12g} {along[0]:.12g} {along[1]:.12g} {length:.12g}"
        for array, start, along, length in numbers
    )


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Remarks on a finished result: what misses the arrays, and which estimates the crossings do not allow."""
    missed = result["misses_array"].to_numpy() > 0
    where = missed.reshape(-1, missed.shape[-1])
    for number, count in enumerate(np.count_nonzero(where, axis=0).tolist()):
        if count:
            yield (
                f"{count:,} of {len(where):,} heliostats, counted at every point of the sweep, never cross array "
                f"{number} with any trace (misses_array): move the array, or make it longer"
            )
    status = result["detector_status"].to_numpy()
    said = {
        NO_ELEVATION: "the elevation trace crosses",
        NO_AZIMUTH: "the azimuth trace crosses",
        NEITHER: "both traces cross",
    }
    for code, what in said.items():
        if count := int(np.count_nonzero(status == code)):
            yield f"at {count:,} of {status.size:,} instants {what} no array (detector_status {code})"
    yield from estimate_remarks(result, "crossings")
