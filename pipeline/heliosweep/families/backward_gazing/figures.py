"""Figures for slope measurements, based on Figures 2 and 5 to 8 and Table 1 of Defieux et al. (2020)."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.families.backward_gazing.variables import QUALITY
from heliosweep.report.figures import (
    COLOURS,
    HELIOSTAT,
    PIXELS,
    Context,
    Curves,
    Figure,
    Grids,
    Maps,
    Rasters,
    is_ordered,
)

METHOD, REFERENTIAL, MODULE, PROFILE, HOUR = "slope_method", "referential", "module", "sun_profile", "hour"
#: Dimensions along which random seeds vary.
SEEDS = ("profile_seed", "camera_seed", "defect_seed")
_LOOKS = {name: {"color": colour} for name, colour in zip(("A", "O1", "O2", "LM"), COLOURS, strict=False)}
_TYPICAL = {
    METHOD: ("LM", "O2", "O1", "A"),
    REFERENTIAL: ("exact", "roll", "none"),
    "sun_azimuth": 30.0,
    "sun_elevation": 60.0,
    "camera_radius": 0.24,
    "canting_scale": 1.0,
    "profile_error": 0.0,
    "gain_error": 0.0,
    HOUR: 12.0,
}
_OWN = (*PIXELS, METHOD, REFERENTIAL, MODULE, HELIOSTAT, HOUR, "camera", "disc_fraction", *SEEDS)
#: Colour of each bit in `quality`, from the most to the least severe.
_COLOURS = {16: "#000000", 32: "#0072B2", 64: "#009E73", 1: "#CC79A7", 4: "#E69F00", 8: "#56B4E9", 2: "#D55E00"}
_RANKS = dict(
    enumerate([(QUALITY[bit].replace("_", " "), _COLOURS[bit]) for bit in _COLOURS] + [("no quality flag", "#e8e4c9")])
)
_SEEN = "Seen from the target. The numbers are module numbers."


def figures(result: xr.Dataset) -> Iterator[Figure]:
    """Yield the figures for a result of any mode, with the main figure first."""
    slopes = ("slope_x", "slope_y")
    methods: dict[str, Any] = {"panels": (METHOD, PROFILE), "at": _TYPICAL}
    true = tuple(f"true_{name}" for name in slopes)
    yield Rasters("slope_maps", "Mirror slopes by method", (*slopes, *true), notes=_SEEN, **methods)
    yield Rasters("slope_errors", "Estimated slopes minus true slopes", ("slope_error_x", "slope_error_y"), notes=_SEEN,
                  derive=_slope_errors, interactive=False, **methods)  # fmt: skip
    yield Rasters("images", "Camera images", ("image",), panels=("camera",), at=_TYPICAL, palette="inferno",
                  notes=f"Brightness relative to the centre of the sun. {_SEEN}")  # fmt: skip
    uncertainty = ("slope_uncertainty_x", "slope_uncertainty_y")
    yield Rasters("slope_uncertainty", "Standard uncertainty of the slopes", uncertainty, at=_TYPICAL, notes=_SEEN)
    yield Rasters("residuals", "Root mean square difference between observed and modelled brightness",
                  ("residual_rms",), notes=_SEEN, **methods)  # fmt: skip
    study = json.loads(str(result.attrs.get("study", "{}")))
    doubtful = ("quality_rank",) if study.get("mode") == "measured" else ()
    yield Rasters("quality", "Most severe quality flag of each pixel", doubtful,
                  panels=(METHOD,), kinds=_RANKS, derive=_ranks, interactive=False)  # fmt: skip
    canting = study.get("defects", {}).get("canting", {})
    swept = [str(dim) for dim in result.sizes if dim not in _OWN and result.sizes[dim] > 1]
    numbers = [dim for dim in swept if is_ordered(result, dim)]
    seeds = dict.fromkeys(SEEDS, "rms")
    median = "_median" if "relative_error_x_median" in result else ""
    relative = tuple(f"relative_error_{side}{median}" for side in "xy")
    bands = {name: (name.replace(median, "_low"), name.replace(median, "_high")) for name in relative if median}
    spread = "Median over the seeds; bars and bands show the 5th to 95th percentiles." if median else ""
    canted = next((name for name, pair in canting.items() if any(pair)), None)
    at = {**_TYPICAL, MODULE: float(canted)} if canted else _TYPICAL
    yield Curves("errors", "Mean slope error of a canted module, by method", relative, over=(METHOD,),
                 lines=(REFERENTIAL,), panels=(PROFILE,), bands=bands, at=at, notes=spread)  # fmt: skip
    yield Curves("canting", "Canting of each module, with standard errors", ("canting_x", "canting_y"), over=(MODULE,),
                 lines=(METHOD,), panels=(PROFILE,), at=at, looks=_LOOKS)  # fmt: skip
    rms = ("slope_rms_x", "slope_rms_y", "cramer_rao_bound_x", "cramer_rao_bound_y")
    lines = (METHOD, REFERENTIAL)
    for dim in numbers:
        words = Context(result).title(dim)
        yield Curves(f"errors_over_{dim}", f"Mean slope error of a module against {words}", relative, over=(dim,),
                     lines=lines, panels=(PROFILE,), bands=bands, at=at, looks=_LOOKS, notes=spread)  # fmt: skip
        yield Curves(f"rms_errors_over_{dim}", f"Scatter of the pixel slopes against {words}, and its lower bound",
                     rms, over=(dim,), lines=lines, at=at, looks=_LOOKS, reduce=seeds)  # fmt: skip
        names = ("usable_fraction", "lit_cameras")
        yield Curves(f"sight_over_{dim}",
                     f"Fractions of pixels with slopes and of cameras that see the sun, against {words}", names,
                     over=(dim,), lines=(MODULE,), at=at, reduce=dict.fromkeys(SEEDS, "mean"))  # fmt: skip
    if len(numbers) > 1:
        chosen = (*rms[:2], "usable_fraction")
        yield Grids("accuracy", "Slope scatter of a module, and fraction of pixels with slopes", chosen,
                    over=numbers[:2], at=at, reduce=seeds)  # fmt: skip
    yield Curves("sun_profile", "Brightness of the sun against the distance from the disc centre, with the "
                                "fit of Jose's formula",
                 ("sun_brightness", "sun_formula"), over=("disc_fraction",), lines=(PROFILE,))  # fmt: skip
    error = ("slope_rms_x", "slope_rms_y", "canting_rms_x", "canting_rms_y", "cramer_rao_bound_x", "incidence")
    yield Maps("accuracy_map", "Root mean square slope error of each heliostat", error, panels=(HOUR,),
               lines=(METHOD,), at=_TYPICAL)  # fmt: skip
    yield Maps("usable_map", "Fraction of the pixels of each heliostat that are lit in at least three cameras",
               ("usable_fraction", "lit_cameras"), panels=(HOUR,), at=_TYPICAL, interactive=False)  # fmt: skip


def _slope_errors(result: xr.Dataset) -> xr.Dataset:
    for side, word in (("x", "horizontal"), ("y", "vertical")):
        if {f"slope_{side}", f"true_slope_{side}"} <= set(result.data_vars):
            error = (result[f"slope_{side}"] - result[f"true_slope_{side}"]).transpose(*result[f"slope_{side}"].dims)
            attrs = {"units": "mrad", "long_name": f"error of the {word} slope"}
            result = result.assign({f"slope_error_{side}": error.assign_attrs(attrs)})
    return result


def _ranks(result: xr.Dataset) -> xr.Dataset:
    if not {"quality", "mask"} <= set(result.data_vars):
        return result
    bits = result["quality"].fillna(0).astype(int)
    ranks = np.select([(bits.to_numpy() & bit) > 0 for bit in _COLOURS], list(range(len(_COLOURS))), len(_COLOURS))
    return result.assign(quality_rank=bits.copy(data=ranks.astype(float)).where(result["mask"] > 0))
