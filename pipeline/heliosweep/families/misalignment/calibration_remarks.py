"""What a user should be told of calibrations: what the spots cannot tell, and what the mounts cannot do."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.blocks import CONDITION_LIMITS
from heliosweep.families.misalignment.calibration_variables import EXACT, KNOWN, NO_SPOTS
from heliosweep.kernels.calibration import DEPENDENT, INDISTINCT, NOT_CONVERGED, TOO_FEW


def remarks(result: xr.Dataset) -> Iterator[str]:
    """What the user should be told of a finished result: what the spots cannot tell."""
    status, condition = result["calibration_status"].to_numpy(), result["condition_number"].to_numpy()
    meanings = dict(
        zip(
            np.asarray(result["calibration_status"].attrs["flag_values"]).tolist(),
            str(result["calibration_status"].attrs["flag_meanings"]).split(),
            strict=True,
        )
    )
    said = {
        TOO_FEW: "have fewer spots than the errors need: nothing is estimated; add spots or estimate fewer errors",
        NOT_CONVERGED: "did not converge: their estimates are not to be trusted, and no commands are made of them",
        EXACT: "have as many equations as errors: estimated, but without standard errors; add spots",
        NO_SPOTS: "have no spots that could be used: nothing is estimated",
    }
    for code in (code for code in said if code in meanings):
        if count := int(np.count_nonzero(status == code)):
            yield f"{count:,} of {status.size:,} calibrations {said[code]} (calibration_status {code})"
    directions = result["least_known_direction"].to_numpy()
    names = str(result["least_known_direction"].attrs["flag_meanings"]).split()

    def least(code: int) -> str:
        """The error that the spots of most of these calibrations know least."""
        return names[int(np.bincount(directions[status == code] + 1).argmax())]

    if count := int(np.count_nonzero(status == DEPENDENT)):
        yield (
            f"{count:,} of {status.size:,} calibrations cannot tell the errors apart at all, {least(DEPENDENT)} the "
            f"least: nothing is estimated; take spots at other hours and on other days (calibration_status {DEPENDENT})"
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
            f"the spots can hardly tell the errors apart, {least(INDISTINCT)} the least; "
            f"take spots on more days, or estimate fewer errors (calibration_status {INDISTINCT})"
        )
    if count := int(result["instants_without_command"].sum()):
        instants = result["nominal_azimuth"].size // math.prod(result["nominal_azimuth"].shape[:-2])
        all_instants = int(np.isin(status, KNOWN).sum()) * instants
        yield (
            f"at {count:,} of {all_instants:,} instants of calibrated heliostats no command brings the beam to the aim "
            "point, though the sun is up: they are in the mount's blind cone, or the offsets of the mirror are not "
            "smaller than the distance (instants_without_command)"
        )
