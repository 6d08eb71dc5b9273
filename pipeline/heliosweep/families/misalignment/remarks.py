"""Warnings about finished results of all modes."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.calibration import (
    DOUBTFUL_APERTURES,
    DOUBTFUL_ERROR,
    EARLIER,
    LARGEST_DEVIATION,
    LATER,
    MIRRORED,
    READINGS,
)
from heliosweep.families.misalignment.detectors import NEITHER, NO_AZIMUTH, NO_ELEVATION
from heliosweep.families.misalignment.estimates import DISAGREE, DOUBTFUL, KNOWN
from heliosweep.kernels.spots import calibration as codes
from heliosweep.kernels.spots.receiver import BEHIND_FACE, BLIND_CONE, MISSES, NO_SUN, TOO_NEAR
from heliosweep.mounts import CONDITION_LIMITS

#: Dimensions of the instants.
_DAYS_AND_HOURS = ("day", "declination", "date", "hour")
#: Maximum number of listed spots and heliostats.
_LISTED = 6
_OF_HELIOSTATS = {
    BEHIND_FACE: "are on the plane of the receiver or behind it whenever the sun is up",
    TOO_NEAR: "are nearer to the aim point than the offsets of the mirror",
}
_OF_RAYS = {
    BEHIND_FACE: "start on the plane of the receiver or behind it, because of the mirror offset",
    MISSES: "go away from the plane of the receiver, or come from a mirror whose back is lit",
    BLIND_CONE: "would need a mount that points into its blind cone",
}
_SIGHTS = {
    NO_ELEVATION: "the elevation trace crosses",
    NO_AZIMUTH: "the azimuth trace crosses",
    NEITHER: "both traces cross",
}
#: Remedies if the spots fit much better in another reading.
_ADVICE = {
    MIRRORED: "y is positive to the right for someone in the field who looks at the receiver, z upwards",
    EARLIER: "check the offset from universal time, and summer time",
    LATER: "check the offset from universal time, and summer time",
}


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Yield warnings: missing spots and statistics, estimates that the data do not allow, missed arrays."""
    if "spot_status" in result:
        yield from _of_spots(result)
    if "real_fraction" in result:
        real = result["real_fraction"].to_numpy()
        some, none = int(np.count_nonzero((real > 0) & (real < 1))), int(np.count_nonzero(real == 0))
        if some:
            yield f"{some:,} of {real.size:,} statistics omit draws whose ray does not reach the receiver's plane"
        if none:
            yield f"{none:,} of {real.size:,} statistics are missing: no draw's ray reaches the receiver's plane"
    if "misses_array" in result:
        yield from _of_detectors(result)
    if "calibration_status" in result:
        yield from _of_estimates(result, "crossings" if "crossings_used" in result else "spots")
    if "spot_deviation" in result:
        yield from _of_measured(result)
    if "instants_without_command" in result and (count := int(result["instants_without_command"].sum())):
        nominal = result["nominal_azimuth"]
        instants = math.prod(size for dim, size in nominal.sizes.items() if dim in _DAYS_AND_HOURS)
        all_instants = int(np.isin(result["calibration_status"], KNOWN).sum()) * instants
        yield (
            f"at {count:,} of {all_instants:,} instants of calibrated heliostats no command brings the beam to the aim "
            "point, though the sun is up: they are in the mount's blind cone, or the offsets of the mirror are not "
            "smaller than the distance (instants_without_command)"
        )


def _of_spots(result: xr.Dataset) -> Iterator[str]:
    """Yield the numbers of heliostats and rays without a spot, and of instants without sun."""
    status = result["spot_status"]
    times = [dim for dim in status.dims if dim in _DAYS_AND_HOURS]
    points = status.size // math.prod(status.sizes[dim] for dim in times)
    counted = "" if points == status.sizes["heliostat"] else ", counted at every point of the sweep,"
    rays = {code: int((status == code).sum()) for code in _OF_RAYS}
    for code, words in _OF_HELIOSTATS.items():
        here = (status == code).any(times)
        if code == BEHIND_FACE:
            # The mirror of a pivot nearly on the plane may be behind it at some instants only.
            here &= status.isin([code, NO_SUN]).all(times)
            rays[code] -= int((status == code).where(here, False).sum())
        if count := int(here.sum()):
            yield f"{count:,} of {points:,} heliostats{counted} {words}: no spot (spot_status {code})"
    for code, count in rays.items():
        if count:
            yield f"{count:,} of {status.size:,} rays {_OF_RAYS[code]}: no spot (spot_status {code})"
    dark = (status == NO_SUN).any([dim for dim in status.dims if dim not in ("site", "latitude", *times)])
    if count := int(dark.sum()):
        yield f"the sun is down at {count:,} of {dark.size:,} instants: no spot (spot_status {NO_SUN})"


def _of_detectors(result: xr.Dataset) -> Iterator[str]:
    """Yield the numbers of heliostats and instants without crossings."""
    missed = result["misses_array"].transpose(..., "detector").to_numpy() > 0
    missed = missed.reshape(-1, missed.shape[-1])
    for number, count in enumerate(np.count_nonzero(missed, axis=0).tolist()):
        if count:
            yield (
                f"{count:,} of {len(missed):,} heliostats, counted at every point of the sweep, never cross array "
                f"{number} with any trace (misses_array): move the array, or make it longer"
            )
    status = result["detector_status"].to_numpy()
    for code, words in _SIGHTS.items():
        if count := int(np.count_nonzero(status == code)):
            yield f"at {count:,} of {status.size:,} instants {words} no array (detector_status {code})"


def _of_estimates(result: xr.Dataset, what: str) -> Iterator[str]:
    """Yield the numbers of calibrations that the spots or crossings do not allow, and why."""
    status, condition = result["calibration_status"].to_numpy(), result["condition_number"].to_numpy()
    causes = {
        codes.TOO_FEW: f"have fewer {what} than the errors need: nothing is estimated; add {what} or estimate fewer "
        "errors",
        codes.NOT_CONVERGED: "did not converge: do not use their estimates; they give no commands",
        codes.EXACT: f"have as many equations as errors: estimated, but without standard errors; add {what}",
        codes.NO_OBSERVATIONS: f"have no {what} that could be used: nothing is estimated",
    }
    for code, cause in causes.items():
        if count := int(np.count_nonzero(status == code)):
            yield f"{count:,} of {status.size:,} calibrations {cause} (calibration_status {code})"
    directions = result["least_known_direction"].to_numpy()
    names = str(result["least_known_direction"].attrs["flag_meanings"]).split()

    def least(code: int) -> str:
        """Return the error that most of these calibrations determine least."""
        return names[int(np.bincount(directions[status == code] + 1).argmax())]

    if count := int(np.count_nonzero(status == codes.DEPENDENT)):
        yield (
            f"{count:,} of {status.size:,} calibrations cannot tell the errors apart at all, {least(codes.DEPENDENT)} "
            f"the least: nothing is estimated; take {what} at other hours and on other days "
            f"(calibration_status {codes.DEPENDENT})"
        )
    if count := int(np.count_nonzero(status == codes.INDISTINCT)):
        parameters = result["parameters"].broadcast_like(result["calibration_status"])
        parameters = parameters.transpose(*result["calibration_status"].dims).to_numpy()[status == codes.INDISTINCT]
        largest = np.nanmax(condition[status == codes.INDISTINCT])
        given = result["condition_number"].attrs.get("condition_limit")
        limits = sorted({CONDITION_LIMITS[number] if given is None else float(given) for number in parameters.tolist()})
        yield (
            f"{count:,} of {status.size:,} calibrations have a condition number above "
            f"{' or '.join(f'{limit:g}' for limit in limits)} (up to {largest:.4g}): "
            f"the {what} can hardly tell the errors apart, {least(codes.INDISTINCT)} the least; "
            f"take {what} on more days, or estimate fewer errors (calibration_status {codes.INDISTINCT})"
        )
    if np.any(status == DOUBTFUL):
        doubted = (status == DOUBTFUL).any(axis=tuple(range(status.ndim - 1)))
        heliostats = _names(result)[doubted]
        listed = ", ".join(map(str, heliostats[:_LISTED])) + ", ..." * int(heliostats.size > _LISTED)
        yield (
            f"heliostat {listed}: the calibration is doubtful. An error is beyond {DOUBTFUL_ERROR:g} mrad, or a spot "
            f"lies more than {DOUBTFUL_APERTURES:g} apertures from the prediction of a mount without errors: are the "
            f"spots in metres, are suns, commanded angles and heliostats right? (calibration_status {DOUBTFUL})"
        )


def _names(result: xr.Dataset) -> np.ndarray:
    """Return names, or numbers, of the heliostats."""
    return next(result[key].to_numpy() for key in ("name", "id", "heliostat") if key in result.coords)


def _of_measured(result: xr.Dataset) -> Iterator[str]:
    """Yield readings of the table that fit much better, and spots that disagree."""
    point = result.isel({dim: 0 for dim in result["better_reading"].dims if dim != "heliostat"})
    reading, known = point["better_reading"].to_numpy(), np.isin(point["calibration_status"], KNOWN)
    for code, advice in _ADVICE.items():
        if (count := np.count_nonzero(reading == code)) > known.sum() / 2:
            fitted = f"the spots of {count:,} of {known.sum():,} heliostats"
            yield f"{fitted} fit much better {READINGS[code].replace('_', ' ')}: {advice} (better_reading)"
    names, time = _names(point), point["spot_time"].to_numpy()
    deviation, residual = (
        point["spot_deviation"].to_numpy(),
        np.hypot(point["residual_y"].to_numpy(), point["residual_z"].to_numpy()),
    )
    rows, spots = np.nonzero(deviation > LARGEST_DEVIATION)
    if not rows.size:
        return
    worst = np.argsort(-deviation[rows, spots], kind="stable")[:_LISTED]
    listed = [
        f"{names[row]} {f'spot {spot}' if np.isnat(time[row, spot]) else f'{time[row, spot]:.16}Z'} "
        f"({residual[row, spot]:.2g} m)".replace("T", " ")
        for row, spot in zip(rows[worst], spots[worst], strict=True)
    ]
    yield (
        f"{rows.size:,} spots of {len(set(rows.tolist())):,} heliostats are more than {LARGEST_DEVIATION:g} robust "
        f"standard deviations from the others' prediction: {', '.join(listed)}{', ...' * (rows.size > _LISTED)}. Check "
        f"them, give them the weight 0 or set 'calibration.loss: huber' (spot_deviation, calibration_status {DISAGREE})"
    )
