"""The variables of a field: names, CF attributes and what each means, in the order of the file."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from heliosweep.families.backward_gazing.shared import OF_METHOD, SCENE, both, part, quantity, swept
from heliosweep.families.backward_gazing.simulated.variables import NET, SIMULATED

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.study import BackwardGazingStudy
    from heliosweep.grid.regions import Variable

_HOUR = ("heliostat", "hour")

FIELD = {
    "slant_range": quantity(("heliostat",), "m", "distance from the heliostat's centre to the target's"),
    **{name: replace(one, dims=_HOUR) for name, one in SCENE.items()},
    **both(
        "slope_rms_%",
        (*_HOUR, *OF_METHOD),
        "mrad",
        "root mean square error of the % slopes of a heliostat",
        NET.replace("of the eroded module", "of all eroded modules"),
    ),
    **both(
        "canting_rms_%",
        (*_HOUR, *OF_METHOD),
        "mrad",
        "root mean square over the modules of the mean error of their % slopes",
        "of the modules that have slopes",
    ),
    "usable_fraction": part((*_HOUR, "slope_method"), "part of the eroded modules for which there are slopes"),
    "lit_cameras": part(
        _HOUR, "part of the cameras that see the sun in the heliostat", "mean over the pixels of the eroded modules"
    ),
    **{name: replace(SIMULATED[name], dims=_HOUR) for name in ("cramer_rao_bound_x", "cramer_rao_bound_y")},
}


def variables(study: BackwardGazingStudy) -> dict[str, Variable]:
    """Variables of a study's result."""
    return swept(study, FIELD)
