"""Errors of the mounts from spots over a region, with the commands that correct them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.blocks import CONDITION_LIMITS, ERRORS, LOSSES
from heliosweep.families.misalignment.calibration import fits
from heliosweep.families.misalignment.calibration.variables import (
    DOUBTFUL,
    DOUBTFUL_APERTURES,
    DOUBTFUL_ERROR,
    EXACT,
    KNOWN,
    NO_SPOTS,
    calibration_block,
    draw_count,
    variables,
)
from heliosweep.families.misalignment.draws import (
    NOISE_STREAMS,
    mean_errors,
    standard_deviates,
    standard_normals,
    widths_of,
)
from heliosweep.families.misalignment.points import (
    Points,
    codes_of,
    coordinates_of,
    heliostat_count,
    instant_sizes,
    place_bytes,
    places_of,
)
from heliosweep.families.misalignment.spots_file import MeasuredSpots
from heliosweep.grid.layout_axis import LayoutAxis
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Workload
from heliosweep.grid.regions import bytes_of
from heliosweep.kernels.spots.fit import DEPENDENT, INDISTINCT, NOT_CONVERGED, TOO_FEW
from heliosweep.kernels.warm import warm_calibration

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.study import MisalignmentStudy
    from heliosweep.grid.regions import Region

#: Time of a spot on one core: least squares with all its iterations, aiming twice, spots before and after. [s]
SECONDS_PER_SPOT = 6e-6
#: Working memory of a spot. [bytes]
BYTES_PER_SPOT = 200
#: Instants of one draw whose noise has room among the counts of the generator.
MOST_INSTANTS = 2**24


class Inputs(NamedTuple):
    """Heliostats and measured spots of a study."""

    places: LayoutAxis
    measured: MeasuredSpots | None
    """With their suns; None where spots are synthetic."""


def workload(study: MisalignmentStudy) -> Workload:
    """Sizes and cost, for the plan."""
    parameters, instants, heliostats = Parameters(study), instant_sizes(study), heliostat_count(study)
    samples = draw_count(study)
    count = math.prod(instants.values())
    inner = {"heliostat": heliostats} | ({"sample": samples} if samples else {})
    inner |= {"parameter": len(ERRORS), "parameter_2": len(ERRORS), **instants}
    measured = study.measured_spots()
    if measured is not None:
        inner["spot"] = measured.most
        count += inner["spot"]
    draws = max(1, samples)
    values = bytes_of(variables(study), {**dict.fromkeys(parameters.sizes, 1), **inner, "heliostat": 1})

    def working_bytes(points: int, length: int) -> int:
        return length * (draws * BYTES_PER_SPOT * count + 2 * values * points)

    return Workload(
        parameters=parameters.sizes,
        inner=inner,
        evaluations=heliostats * draws * count,
        unit="spots",
        seconds=SECONDS_PER_SPOT,
        splittable="heliostat",
        working_bytes=working_bytes,
        seconds_per_point=100e-6,
        coordinate_bytes=place_bytes(study) + 16 * count + 8 * draws,
    )


def coordinates(study: MisalignmentStudy) -> xr.Dataset:
    """Coordinates of the whole result, in memory."""
    keys = [f"calibration.{key}" for key in ("parameters", "loss", "loss_scale")]
    samples, measured = draw_count(study), study.measured_spots()
    if measured is None:
        assert study.mount_errors is not None
        drawn = study.mount_errors.drawn()
        keys += ["calibration.noise", "calibration.days_used"]
        keys += [f"mount_errors.{name}" for name in (*ERRORS, *(["scale"] if samples else [])) if name not in drawn]
    error = np.array(ERRORS, dtype=object), {"long_name": "error of the mount"}
    labels = {dim: (dim, *error) for dim in ("parameter", "parameter_2")}
    if samples:
        labels["sample"] = numbered("sample", samples, "number of the draw, from 0")
    if measured is not None:
        meaning = "number of the spot of a heliostat, from 0, in the order of the file"
        labels["spot"] = numbered("spot", measured.most, meaning)
    found = coordinates_of(study, keys).assign_coords(labels)
    return found.assign_attrs(spots="synthetic" if measured is None else "measured")


def prepare(study: MisalignmentStudy) -> tuple[float, bool]:
    """Load or compile the kernels; seconds it took, and whether something was compiled."""
    return warm_calibration()


def inputs(study: MisalignmentStudy) -> Inputs:
    """Layouts or positions of the study, and its measured spots."""
    return Inputs(places_of(study), study.measured_spots())


def compute(study: MisalignmentStudy, inputs: Inputs, region: Region) -> xr.Dataset:
    """Estimated errors and commands of a region along the swept dimensions and ``heliostat``.

    NaN, and a status that says so, where a shorter layout is padded.
    """
    points = Points.of(study, inputs.places, region)
    made: dict[str, list[NDArray[Any]]] = {}
    found = _measured(study, points, inputs.measured) if inputs.measured else _synthetic(study, points)
    for point, values in enumerate(found):
        for name, array in values.items():
            made.setdefault(name, []).append(array.swapaxes(0, 1))
        nominal = np.degrees(fits.Mounts.of(points, point).ideal())
        for name, array in zip(("nominal_azimuth", "nominal_elevation"), np.moveaxis(nominal, -1, 0), strict=True):
            made.setdefault(name, []).append(array)
    inner = {"parameter": len(ERRORS), "parameter_2": len(ERRORS), "sample": draw_count(study)}
    inner["spot"] = inputs.measured.most if inputs.measured else 0
    return xr.Dataset(
        points.labelled(variables(study), {name: np.stack(arrays) for name, arrays in made.items()}, **inner)
    )


def _synthetic(study: MisalignmentStudy, points: Points) -> Iterator[fits.Found]:
    """Calibration from synthetic spots at each point."""
    block, samples = study.mount_errors, max(1, draw_count(study))
    assert block is not None
    errors, seed, numbers = block.errors(), block.seed or 0, points.numbers
    mean, width, scale = mean_errors(points, block), widths_of(errors), points.values("mount_errors.scale")
    noise = points.values("calibration.noise")
    days, hours = points.instants.sizes.values()
    used = hours * np.full(len(mean), days)
    if points.parameters.has("calibration.days_used"):
        used = hours * points.values("calibration.days_used").astype(int)
    deviates = standard_deviates(errors, numbers, samples, seed)
    noises = _noise(numbers, samples, points.instants.count, seed) if np.any(noise > 0) else None
    for point, options in enumerate(_options(study, points)):
        added = 0.0 if noises is None else noise[point] * noises[:, :, : used[point]]
        drawn = mean[point] + (scale[point] * width) * deviates
        yield fits.from_synthetic(fits.Mounts.of(points, point), drawn, added, int(used[point]), **options)


def _measured(study: MisalignmentStudy, points: Points, measured: MeasuredSpots) -> Iterator[fits.Found]:
    """Calibration from measured spots at each point."""
    for point, options in enumerate(_options(study, points)):
        yield fits.from_measured(fits.Mounts.of(points, point), points.numbers, measured, **options)


def _options(study: MisalignmentStudy, points: Points) -> Iterator[dict[str, Any]]:
    """Options of the kernel at each point."""
    limit = calibration_block(study).condition_limit
    losses = codes_of(points.values("calibration.loss"), LOSSES)
    scales, counts = points.values("calibration.loss_scale"), points.values("calibration.parameters")
    for count, loss, scale in zip(counts, losses, scales, strict=True):
        yield {
            "parameters": int(count),
            "loss": int(loss),
            "loss_scale": float(scale),
            "condition_limit": CONDITION_LIMITS[int(count)] if limit is None else limit,
        }


def _noise(numbers: NDArray[np.int64], samples: int, instants: int, seed: int) -> NDArray[np.float64]:
    """Standard normal noise of y and z over (heliostat, draw, instant, 2); of one draw whatever the others."""
    noise = np.empty((numbers.size, samples, instants, 2))
    for side, stream in enumerate(NOISE_STREAMS):
        for sample in range(samples):
            first = sample * MOST_INSTANTS
            noise[:, sample, :, side] = standard_normals(seed, stream, numbers, instants, first)
    return noise


def numbered(dim: str, count: int, meaning: str) -> tuple[str, NDArray[np.int64], dict[str, str]]:
    """Coordinate 0, 1, ... along a dimension."""
    return dim, np.arange(count), {"long_name": meaning, "units": "1"}


def estimate_remarks(result: xr.Dataset, what: str) -> Iterator[str]:
    """Numbers of calibrations that the spots, or what else they are from, do not allow, and why."""
    status, condition = result["calibration_status"].to_numpy(), result["condition_number"].to_numpy()
    meant = np.asarray(result["calibration_status"].attrs["flag_values"]).tolist()
    said = {
        TOO_FEW: f"have fewer {what} than the errors need: nothing is estimated; add {what} or estimate fewer errors",
        NOT_CONVERGED: "did not converge: their estimates are not to be trusted, and no commands are made of them",
        EXACT: f"have as many equations as errors: estimated, but without standard errors; add {what}",
        NO_SPOTS: f"have no {what} that could be used: nothing is estimated",
    }
    for code in (code for code in said if code in meant):
        if count := int(np.count_nonzero(status == code)):
            yield f"{count:,} of {status.size:,} calibrations {said[code]} (calibration_status {code})"
    directions = result["least_known_direction"].to_numpy()
    names = str(result["least_known_direction"].attrs["flag_meanings"]).split()

    def least(code: int) -> str:
        """The error that most of these calibrations know least."""
        return names[int(np.bincount(directions[status == code] + 1).argmax())]

    if count := int(np.count_nonzero(status == DEPENDENT)):
        yield (
            f"{count:,} of {status.size:,} calibrations cannot tell the errors apart at all, {least(DEPENDENT)} the "
            f"least: nothing is estimated; take {what} at other hours and on other days "
            f"(calibration_status {DEPENDENT})"
        )
    if count := int(np.count_nonzero(status == INDISTINCT)):
        parameters = result["parameters"].broadcast_like(result["calibration_status"])
        parameters = parameters.transpose(*result["calibration_status"].dims).to_numpy()[status == INDISTINCT]
        largest = np.nanmax(condition[status == INDISTINCT])
        given = result["condition_number"].attrs.get("condition_limit")
        limits = sorted({CONDITION_LIMITS[number] if given is None else float(given) for number in parameters.tolist()})
        yield (
            f"{count:,} of {status.size:,} calibrations have a condition number above "
            f"{' or '.join(f'{limit:g}' for limit in limits)} (up to {largest:.4g}): "
            f"the {what} can hardly tell the errors apart, {least(INDISTINCT)} the least; "
            f"take {what} on more days, or estimate fewer errors (calibration_status {INDISTINCT})"
        )


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Remarks on a finished result: numbers of calibrations that the spots do not allow, and of missing commands."""
    yield from estimate_remarks(result, "spots")
    status = result["calibration_status"].to_numpy()
    if np.any(status == DOUBTFUL):
        doubted = (status == DOUBTFUL).any(axis=tuple(range(status.ndim - 1)))
        names = next(result[key].to_numpy() for key in ("name", "id", "heliostat") if key in result.coords)
        listed = ", ".join(map(str, names[doubted][:6])) + ", ..." * int(names[doubted].size > 6)
        yield (
            f"heliostat {listed}: the calibration is doubtful. An error is beyond {DOUBTFUL_ERROR:g} mrad, or a spot "
            f"lies more than {DOUBTFUL_APERTURES:g} apertures from where a mount without errors sends it: are the "
            f"spots in metres, are suns, commanded angles and heliostats right? (calibration_status {DOUBTFUL})"
        )
    if count := int(result["instants_without_command"].sum()):
        instants = result["nominal_azimuth"].size // math.prod(result["nominal_azimuth"].shape[:-2])
        all_instants = int(np.isin(status, KNOWN).sum()) * instants
        yield (
            f"at {count:,} of {all_instants:,} instants of calibrated heliostats no command brings the beam to the aim "
            "point, though the sun is up: they are in the mount's blind cone, or the offsets of the mirror are not "
            "smaller than the distance (instants_without_command)"
        )
