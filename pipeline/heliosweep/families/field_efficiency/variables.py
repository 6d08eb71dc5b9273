"""The variables of a result: names, CF attributes and what each means, in the order of the file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from heliosweep.config.times import SunDirections
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.regions import Variable

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy

_MEAN = "time: mean (over the instants with the sun above the horizon)"
_AREA = "area: mean (weighted by mirror area)"

_QUANTITIES: dict[str, tuple[str, str]] = {
    "cosine_efficiency": (
        "cosine efficiency",
        "cosine of the incidence angle, which is half the angle between the directions to the sun and to the receiver",
    ),
    "shading_efficiency": (
        "shading efficiency",
        "one minus the fraction of the mirror that lies in the union of all shadows of other mirrors",
    ),
    "blocking_efficiency": (
        "blocking efficiency",
        "one minus the fraction of the mirror whose reflected rays, parallel to the line from the mirror's centre "
        "to the receiver, meet the back of another mirror",
    ),
    "optical_efficiency": (
        "optical efficiency",
        "cosine efficiency times one minus the fraction of the mirror that is shaded, blocked or both "
        "(area of the union); over time the mean of this product",
    ),
}


def _attrs(long_name: str, comment: str, cell_methods: str = "") -> dict[str, Any]:
    attrs = {"units": "1", "long_name": long_name, "comment": comment, "valid_range": [0.0, 1.0]}
    if cell_methods:
        attrs["cell_methods"] = cell_methods
    return attrs


#: Names of the variables for each heliostat, the same in the order of the kernel.
EFFICIENCIES = tuple(_QUANTITIES)
#: Whole-field variable -> per-heliostat variable of which it is the mean.
FIELD_MEANS = {f"field_{name}": name for name in EFFICIENCIES}
#: Product of three field means.
FACTORED = "field_efficiency_factored"
#: Time series, in the order of the kernel.
SERIES = tuple(f"instantaneous_{name}" for name in EFFICIENCIES)


def variables(study: FieldEfficiencyStudy) -> dict[str, Variable]:
    """Variables of a study's result; where it gives directions of the sun, values at each and no means over time."""
    swept = tuple(Parameters(study).sizes)
    directions = isinstance(study.time, SunDirections)
    found = {}
    for name, (long_name, comment) in _QUANTITIES.items():
        if directions:
            attrs = _attrs(long_name, comment.replace("; over time the mean of this product", ""))
        else:
            attrs = _attrs(f"mean {long_name} over the period", comment, _MEAN)
        found[name] = Variable((*swept, "heliostat"), attrs)
    period, methods = ("", _AREA) if directions else (" over the period", f"{_MEAN} {_AREA}")
    for field_name, name in FIELD_MEANS.items():
        long_name = f"mean {_QUANTITIES[name][0]} of the field{period}"
        attrs = _attrs(long_name, found[name].attrs["comment"], methods)
        found[field_name] = Variable(swept, attrs, finished=True)
    found[FACTORED] = Variable(
        swept,
        _attrs(
            "product of the field's mean cosine, shading and blocking efficiencies",
            "product of three means, as Chong and Tan (2012) print it; field_optical_efficiency is the mean of the "
            "product",
            methods,
        ),
        finished=True,
    )
    if study.output.time_series:
        for name, (long_name, comment) in zip(SERIES, _QUANTITIES.values(), strict=True):
            attrs = _attrs(f"{long_name} at each instant", f"{comment.split('; over')[0]}; missing at night")
            found[name] = Variable((*swept, "time", "heliostat"), attrs)
    return found
