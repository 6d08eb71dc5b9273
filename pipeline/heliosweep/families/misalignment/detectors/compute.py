"""Crossings of detectors over a region, the misalignment from them, and what a closed loop leaves of it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from heliosweep.families.misalignment import estimates
from heliosweep.families.misalignment.blocks import CONDITION_LIMITS, ERRORS
from heliosweep.families.misalignment.calibration.fits import Mounts
from heliosweep.families.misalignment.detectors.arrays import Pieces, pieces_of
from heliosweep.families.misalignment.detectors.loop import Found, Options, Site, from_table, run_loop
from heliosweep.families.misalignment.detectors.variables import (
    NEITHER,
    NO_AZIMUTH,
    NO_ELEVATION,
    detectors_block,
    draw_count,
    variables,
)
from heliosweep.families.misalignment.draws import drawn_errors, noise_of_draws
from heliosweep.families.misalignment.estimates import Inputs, inputs, numbered, prepare
from heliosweep.families.misalignment.points import Points, coordinates_of, instant_sizes
from heliosweep.families.misalignment.spots_file import TRACES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.study import MisalignmentStudy
    from heliosweep.grid.plan import Workload
    from heliosweep.grid.regions import Region

#: Working memory of the crossings of both traces and one piece of an array at an instant. [bytes]
BYTES_PER_CROSSING = 3000
#: Stream of the noise of the first round, after those of spots.
NOISE_STREAM = 200
#: Values of keys that are left out.
DEFAULTS: dict[str, Any] = {"pitch": 0.0, "noise": 0.0, "parameters": 4, "correction": "mount"}

__all__ = ["inputs", "prepare"]


def workload(study: MisalignmentStudy) -> Workload:
    """Sizes and cost, for the plan."""
    block, pieces, draws, measured = detectors_block(study), _pieces(study), draw_count(study), study.measured_spots()
    inner, rounds = estimates.sizes_of(measured, draws) | _sizes(pieces), block.rounds or 1
    count = math.prod(instant_sizes(study).values()) * len(pieces.array)
    if measured is None:
        inner["round"] = rounds + 1
    else:
        count += measured.most
    each, stated = max(1, draws) * count * rounds, variables(study)
    return estimates.workload_of(study, stated, inner, each, "crossings", BYTES_PER_CROSSING)


def coordinates(study: MisalignmentStudy) -> xr.Dataset:
    """Coordinates of the whole result, in memory."""
    block, pieces, measured = detectors_block(study), _pieces(study), study.measured_spots()
    keys, sizes = [f"detectors.{key}" for key in ("parameters", "pitch", "noise")], _sizes(pieces)
    labels = estimates.labels_of(
        measured,
        draw_count(study),
        "crossing",
        trace=("trace", np.array(TRACES, object), {"long_name": "trace, by the axis of the cylinder that makes it"}),
        detector=numbered("detector", sizes["detector"], "number of the array of detectors, from 0, lines first"),
        crossing=numbered("crossing", sizes["crossing"], "number of the crossing of a trace and an array, from 0"),
    )
    if measured is None:
        keys += ["detectors.correction", *estimates.error_keys(study)]
        labels["round"] = numbered("round", (block.rounds or 1) + 1, "rounds of the closed loop that are done")
    if block.parameters is None:
        labels["parameters"] = (), DEFAULTS["parameters"], {"long_name": "number of estimated errors", "units": "1"}
    found = coordinates_of(study, keys).assign_coords(labels)
    return found.assign_attrs(crossings="synthetic" if measured is None else "measured", detectors=_described(pieces))


def compute(study: MisalignmentStudy, inputs: Inputs, region: Region) -> xr.Dataset:
    """Crossings, estimates and commands of a region along the swept dimensions and ``heliostat``.

    NaN, and a status that says so, where a shorter layout is padded.
    """
    points, pieces, measured = Points.of(study, inputs.places, region), _pieces(study), inputs.measured
    draws, sizes = draw_count(study), _sizes(pieces)
    sizes |= estimates.sizes_of(measured, draws) | {"round": (detectors_block(study).rounds or 1) + 1}

    def found() -> Iterator[tuple[Mounts, Found]]:
        count, samples = points.numbers.size, max(1, draws)
        seed = 0 if study.mount_errors is None else study.mount_errors.seed or 0
        shape = (count, samples, points.instants.count, *_sizes(pieces).values())

        def noise(number: int) -> NDArray[np.float64]:
            drawn = noise_of_draws(seed, NOISE_STREAM + number, points.numbers, samples, math.prod(shape[2:]))
            return drawn.reshape(shape)

        none = np.zeros((len(points.setting.kind), count, samples, len(ERRORS)))
        actual = none if study.mount_errors is None else drawn_errors(points, study.mount_errors, samples)
        for point, errors in enumerate(actual):
            options, site = _options(study, points, point), Site(Mounts.of(points, point), pieces, errors * 1e-3)
            if measured is not None:
                yield site.mounts, from_table(site, options, points.numbers, measured)
            else:
                yield site.mounts, run_loop(site, options, noise) | {"true_error": errors}

    return estimates.gathered(points, variables(study), found(), sizes)


def _options(study: MisalignmentStudy, points: Points, point: int) -> Options:
    """What the study says of its detectors at a point."""
    block = detectors_block(study)
    pitch, noise, parameters, correction = (
        points.values(f"detectors.{key}")[point] if points.parameters.has(f"detectors.{key}") else default
        for key, default in DEFAULTS.items()
    )
    limit = CONDITION_LIMITS[int(parameters)] if block.condition_limit is None else block.condition_limit
    return Options(float(pitch), float(noise), int(parameters), float(limit), str(correction), block.rounds or 1)


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
    yield from estimates.estimate_remarks(result, "crossings")
