"""The variables of a result: names, CF attributes and what each means, in the order of the file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

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


#: Per heliostat, means over the period.
ANNUAL: dict[str, dict[str, Any]] = {
    name: _attrs(f"mean {long_name} over the period", comment, _MEAN)
    for name, (long_name, comment) in _QUANTITIES.items()
}

#: Whole-field variable -> per-heliostat variable of which it is the mean.
FIELD_MEANS: dict[str, str] = {f"field_{name}": name for name in _QUANTITIES}

#: Of the whole field.
FIELD: dict[str, dict[str, Any]] = {
    field_name: _attrs(
        f"mean {_QUANTITIES[name][0]} of the field over the period", _QUANTITIES[name][1], f"{_MEAN} {_AREA}"
    )
    for field_name, name in FIELD_MEANS.items()
}
FIELD["field_efficiency_factored"] = _attrs(
    "product of the field's mean cosine, shading and blocking efficiencies",
    "product of three means, as Chong and Tan (2012) print it; field_optical_efficiency is the mean of the product",
)


def named(table: Mapping[str, dict[str, Any]], *, directions: bool) -> dict[str, dict[str, Any]]:
    """`ANNUAL` or `FIELD`; of a study of sun directions, as values at each of them and no means over time.

    Parameters
    ----------
    table : mapping of str to dict
        Names and attributes.
    directions : bool
        Whether the study gives directions of the sun.

    Returns
    -------
    dict of str to dict
    """
    if not directions:
        return dict(table)
    made: dict[str, dict[str, Any]] = {}
    for name, attributes in table.items():
        text = attributes["long_name"].replace(" over the period", "")
        if not name.startswith("field_"):
            text = text.removeprefix("mean ")
        comment = attributes["comment"].replace("; over time the mean of this product", "")
        made[name] = attributes | {"long_name": text, "comment": comment}
        methods = made[name].pop("cell_methods", "").replace(_MEAN, "").strip()
        if methods:
            made[name]["cell_methods"] = methods
    return made


#: Per heliostat and instant.
SERIES: dict[str, dict[str, Any]] = {
    f"instantaneous_{name}": _attrs(f"{long_name} at each instant", f"{comment.split('; over')[0]}; missing at night")
    for name, (long_name, comment) in _QUANTITIES.items()
}
