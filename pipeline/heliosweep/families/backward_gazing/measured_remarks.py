"""What a user should be told of slopes from measured images."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr

from heliosweep.families.backward_gazing.measured_images import BRIGHTEST, SUN_IMAGE
from heliosweep.families.backward_gazing.variables import NOT_CONVERGED, NOT_SEEN, SEEN

__all__ = ["remarks"]

#: Parts below which a camera counts as dark and a module as hardly seen; residuals over the noise stated, of which they
#: are about 0.6 where all is right.
DARK, HARDLY, MUCH = 0.05, 0.5, 1.0


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Saturated and dark images, masked modules, levels that were guessed, residuals that are too large.

    Parameters
    ----------
    result : xarray.Dataset
        Of mode measured.
    """
    status = result["scene_status"].to_numpy()
    if unseen := int(np.count_nonzero(status == NOT_SEEN)):
        which = "" if status.size == 1 else f" at {unseen:,} of {status.size:,} points"
        yield (
            f"no slopes{which}: nowhere do three cameras see the reflected sun, and all pixels are masked; is the "
            "heliostat aimed at the target, and are geometry and levels right?"
        )
    if failed := int(np.count_nonzero((status != SEEN) & (status != NOT_SEEN))):
        yield f"no slopes at {failed:,} of {status.size:,} points: the cameras are in one line (scene_status)"
    files = [name for name in str(result.attrs.get("image_files", "")).split(", ") if name]
    yield from _of_cameras(result, files)
    yield from _of_levels(result)
    usable = result["usable_fraction"].where(result["scene_status"] == SEEN)
    least = usable.min([dim for dim in usable.dims if dim != "module"]).to_numpy()
    few = np.flatnonzero(least < HARDLY)
    if few.size:
        names = ", ".join(f"{result['module'].to_numpy()[row]} ({100 * least[row]:.0f} %)" for row in few)
        yield f"less than half of a module has slopes: module {names}; its estimates rest on few pixels"
    found = result["slope_x"].notnull().any(dim="referential")
    flagged = ((result["quality"] & NOT_CONVERGED) > 0) & found
    for method in result["method"].to_numpy():
        part = float(flagged.sel({"method": method}).sum()) / max(1.0, float(found.sel({"method": method}).sum()))
        if part > 0.01:
            yield f"{100 * part:.3g} % of the slopes of {method} did not converge (quality {NOT_CONVERGED})"


def _of_cameras(result: xr.Dataset, files: list[str]) -> Iterator[str]:
    """Images that are saturated or dark where they show the mirror."""
    for row, number in enumerate(result["camera"].to_numpy()):
        name = f"image {number}" + (f" ({files[row]})" if row < len(files) else "")
        saturated = float(result["saturated_fraction"].isel(camera=row).max())
        lit = float(result["lit_fraction"].isel(camera=row).min())
        if saturated > 0.0:
            yield f"{name}: {100 * saturated:.3g} % of the mirror is saturated and not used; expose it shorter"
        if lit < DARK:
            yield f"{name} is dark: it sees the sun in {100 * lit:.3g} % of the mirror; the others must do"
        elif lit < HARDLY:
            yield f"{name} sees the sun in only {100 * lit:.3g} % of the mirror"


def _of_levels(result: xr.Dataset) -> Iterator[str]:
    """Levels of white that were not measured through the mirror, and what the residuals say."""
    source = set(str(result.attrs.get("white_levels", "")).split())
    how = {
        SUN_IMAGE: "is that of the sun's image, without the mirror",
        BRIGHTEST: "is unknown, and the brightest pixels of all images stand for it",
    }
    for origin, what in how.items():
        if origin in source:
            yield (
                f"the level of white {what}: a gain is fitted at each pixel for O1, O2 and LM, but A has none, and one "
                "camera's level against another's is not known: at the paper's geometry 1 % of it shifts all slopes "
                "by 0.06 mrad, like a pointing error; give 'white', or WHITE in the metadata of each image"
            )
    gain = result["gain"].to_numpy()
    if np.any(np.abs(gain[np.isfinite(gain)] - 1.0) > 0.05) and not source & set(how):
        yield f"the gain that is fitted is {np.nanmedian(gain):.3f}: is the level of white right?"
    stated = result.attrs.get("pixel_noise_from")
    residual = float(result["residual_rms"].isel(method=-1).median())
    noise = float(result["pixel_noise"].median())
    if stated == "study" and residual > MUCH * noise:
        yield (
            f"the residuals, {residual:.2g} of the sun's centre, are well above the noise that the study states, "
            f"{noise:.2g}: the sun's profile, the geometry or a camera's gain are off, and uncertainties too small"
        )
