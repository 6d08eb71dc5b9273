"""The variables of a simulated heliostat: names, CF attributes and what each means, in the order of the file."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from heliosweep.families.backward_gazing.shared import (
    BOUND,
    ESTIMATES,
    MASK,
    OF_METHOD,
    OF_MODULE,
    PLANE,
    QUALITY,
    SCENE,
    SIGHT,
    both,
    quality,
    quantity,
    swept,
)
from heliosweep.grid.regions import Variable

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.study import BackwardGazingStudy

#: Keys along which scenes differ by their random numbers alone.
SEEDS = ("cameras.seed", "defects.seed", "profile_noise.seed")
#: Percentiles over the seeds, by ending.
PERCENTILES = {"median": 50.0, "low": 5.0, "high": 95.0}

#: What the error of a pixel is, the truth being known.
NET = (
    "error of a pixel: slope found, less the slope that the same method finds on images of the ideal heliostat without "
    "noise or error of gain, less the true slope; over the pixels of the eroded module that have slopes"
)
_WAVEFRONT = "of O2 and LM the same for every referential, which they do not need"

SIMULATED = {
    **both("slope_bias_%", OF_MODULE, "mrad", "mean error of the % slopes of a module", f"{NET}; {_WAVEFRONT}"),
    **both("slope_rms_%", OF_MODULE, "mrad", "root mean square error of the % slopes of a module", NET),
    **both(
        "relative_error_%",
        OF_MODULE,
        "percent",
        "magnitude of the mean error of the % slopes relative to the module's entered canting",
        "as in Table 1 of Defieux et al. (2020); relative to 1 mrad where no canting is entered",
    ),
    **ESTIMATES,
    **SIGHT,
    **both(
        "cramer_rao_bound_%",
        ("module",),
        "mrad",
        BOUND,
        "Cramer-Rao bound for noise and levels of the cameras at the true slopes; root mean square over the pixels of "
        "the eroded module that three cameras see; 0 without noise and levels; for a tabulated profile that of its "
        "smooth fit, not of a search on the rough table; with fit_gain that of methods that find a gain, not of A",
    ),
    **SCENE,
}

#: With ``output: {maps: true}``.
MAPS = {
    "image": quantity(
        ("camera", *PLANE),
        "1",
        "brightness relative to the sun's centre",
        "as the reconstruction gets it, with the noise of the cameras; missing between the modules",
    ),
    **both(
        "slope_%",
        (*OF_METHOD, *PLANE),
        "mrad",
        "% slope of the mirror relative to the ideal heliostat",
        "less the slope that the same method finds on the ideal heliostat; missing where fewer than three cameras are "
        f"lit; {_WAVEFRONT}",
    ),
    **both("true_slope_%", PLANE, "mrad", "true % slope of the mirror relative to the ideal heliostat"),
    "mask": MASK,
    "quality": quality(QUALITY),
}


def seed_dims(study: BackwardGazingStudy) -> tuple[str, ...]:
    """Swept dimensions along which nothing but seeds varies."""
    return tuple(dim.name for dim in study.dimensions() if set(dim.sweeps) <= set(SEEDS))


def variables(study: BackwardGazingStudy) -> dict[str, Variable]:
    """Variables of a study's result; where seeds are swept, percentiles over them too."""
    found = swept(study, SIMULATED | (MAPS if study.output.maps else {}))
    if seeds := seed_dims(study):
        found |= over_seeds(tuple(dim.name for dim in study.dimensions() if dim.name not in seeds))
    return found


def over_seeds(dims: tuple[str, ...]) -> dict[str, Variable]:
    """Percentiles of the relative errors over all dimensions but those of the seeds."""
    words = {"median": "median", "low": "5th percentile", "high": "95th percentile"}
    found: dict[str, Variable] = {}
    for ending, which in words.items():
        long_name = f"{which} over the seeds of the relative error of the % slopes"
        found |= both(f"relative_error_%_{ending}", (*dims, *OF_MODULE), "percent", long_name)
    return {name: replace(one, finished=True) for name, one in found.items()}
