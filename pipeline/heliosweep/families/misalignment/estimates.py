"""Errors of mounts estimated from spots or from crossings of detectors: what both modes have in common."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.blocks import CONDITION_LIMITS, ERRORS
from heliosweep.families.misalignment.calibration.fits import Found, Mounts
from heliosweep.families.misalignment.calibration.variables import EXACT, NO_SPOTS
from heliosweep.families.misalignment.points import Points, heliostat_count, instant_sizes, place_bytes, places_of
from heliosweep.families.misalignment.spots_file import MeasuredSpots
from heliosweep.grid.layout_axis import LayoutAxis
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Workload
from heliosweep.grid.regions import bytes_of
from heliosweep.kernels.spots.calibration import DEPENDENT, INDISTINCT, NOT_CONVERGED, TOO_FEW
from heliosweep.kernels.warm import warm_calibration

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.study import MisalignmentStudy
    from heliosweep.grid.regions import Variable


class Inputs(NamedTuple):
    """Heliostats of a study, and its measured spots or crossings."""

    places: LayoutAxis
    measured: MeasuredSpots | None
    """With their suns; None where they are synthetic."""


def inputs(study: MisalignmentStudy) -> Inputs:
    """Layouts or positions of the study, and what it has measured."""
    return Inputs(places_of(study), study.measured_spots())


def prepare(study: MisalignmentStudy) -> tuple[float, bool]:
    """Load or compile the kernels; seconds it took, and whether something was compiled."""
    return warm_calibration()


def sizes_of(measured: MeasuredSpots | None, draws: int) -> dict[str, int]:
    """Lengths of the dimensions of estimates: the errors, draws, and the measured spots of a heliostat."""
    sizes = {"sample": draws} if draws else {}
    sizes |= {"parameter": len(ERRORS), "parameter_2": len(ERRORS)}
    return sizes if measured is None else sizes | {"spot": measured.most}


def workload_of(
    study: MisalignmentStudy,
    variables: Mapping[str, Variable],
    inner: Mapping[str, int],
    each: int,
    unit: str,
    memory: int,
) -> Workload:
    """Sizes and cost, for the plan, of so many evaluations for `each` heliostat, each with its memory."""
    parameters, heliostats, instants = Parameters(study).sizes, heliostat_count(study), instant_sizes(study)
    inner = {"heliostat": heliostats, **instants, **inner}
    labels = math.prod(instants.values()) + inner.get("spot", 0)
    values = bytes_of(variables, {**dict.fromkeys(parameters, 1), **inner, "heliostat": 1})
    return Workload(
        parameters=parameters,
        inner=inner,
        evaluations=heliostats * each,
        unit=unit,
        splittable="heliostat",
        working_bytes=lambda points, length: length * (each * memory + 2 * values * points),
        coordinate_bytes=place_bytes(study) + 8 * (2 * labels + inner.get("sample", 1)),
    )


def error_keys(study: MisalignmentStudy) -> list[str]:
    """Keys of the errors of mounts that label a result: those that are not drawn, and the scale of those that are."""
    assert study.mount_errors is not None
    drawn = study.mount_errors.drawn()
    names = (*(name for name in ERRORS if name not in drawn), *(["scale"] if drawn else []))
    return [f"mount_errors.{name}" for name in names]


def labels_of(measured: MeasuredSpots | None, draws: int, what: str, **more: Any) -> dict[str, Any]:
    """Coordinates of estimates, with `more` of them after the errors; `what` was measured, spots or crossings."""
    error = np.array(ERRORS, dtype=object), {"long_name": "error of the mount"}
    labels: dict[str, Any] = {dim: (dim, *error) for dim in ("parameter", "parameter_2")} | more
    if draws:
        labels["sample"] = numbered("sample", draws, "number of the draw, from 0")
    if measured is not None:
        meaning = f"number of the {what} of a heliostat, from 0, in the order of the file"
        labels["spot"] = numbered("spot", measured.most, meaning)
    return labels


def numbered(dim: str, count: int, meaning: str) -> tuple[str, NDArray[np.int64], dict[str, str]]:
    """Coordinate 0, 1, ... along a dimension."""
    return dim, np.arange(count), {"long_name": meaning, "units": "1"}


def gathered(
    points: Points, variables: Mapping[str, Variable], found: Iterable[tuple[Mounts, Found]], sizes: Mapping[str, int]
) -> xr.Dataset:
    """Data set of the mounts and the estimates, shape (H, K, ...), of each point, with commands without correction."""
    made: dict[str, list[NDArray[Any]]] = {}
    for mounts, values in found:
        for name in values.keys() & variables.keys():
            made.setdefault(name, []).append(values[name].swapaxes(0, 1))
        nominal = np.degrees(mounts.ideal())
        for index, name in enumerate(("nominal_azimuth", "nominal_elevation")):
            made.setdefault(name, []).append(nominal[..., index])
    stacked = {name: np.stack(made[name]) for name in variables}
    return xr.Dataset(points.labelled(variables, stacked, **sizes))


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
