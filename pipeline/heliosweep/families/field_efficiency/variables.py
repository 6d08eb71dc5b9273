"""Result variables: names, CF attributes and definitions, in the order of the result file.

Each row of the table `rows` describes one variable: its name, dimensions, units and descriptions, and the study
properties that the variable requires.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from heliosweep.aiming import VARIABLES
from heliosweep.config import SunDirections
from heliosweep.families.field_efficiency.heat import has_heat
from heliosweep.families.field_efficiency.losses import year_variables
from heliosweep.families.field_efficiency.optics import IRRADIANCE, has_instant, is_limited, varies
from heliosweep.grid import Variable, quantity, with_best

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy

_MEAN = "time: mean (over the instants with the sun above the horizon)"
_WEIGHTED = (
    "time: mean (weighted by direct normal irradiance times the length of the interval, over the instants with the "
    "sun above the horizon and the weather within the limits)"
)
_AREA = "area: mean (weighted by mirror area)"

_EXACT: dict[str, tuple[str, str]] = {
    "cosine_efficiency": (
        "cosine efficiency",
        "cosine of the incidence angle, which is half the angle between the directions to the sun and to the receiver",
    ),
    "shading_efficiency": (
        "shading efficiency",
        "one minus the fraction of the mirror in the union of all shadows of other mirrors",
    ),
    "blocking_efficiency": (
        "blocking efficiency",
        "one minus the fraction of the mirror whose reflected rays, parallel to the line from the mirror's centre "
        "to the receiver, hit the back of another mirror",
    ),
    "optical_efficiency": (
        "optical efficiency",
        "cosine efficiency times one minus the fraction of the mirror that is shaded, blocked or both "
        "(area of the union); over time the mean of this product",
    ),
}
#: Variables of studies with `optics`, computed as fractions of the rays that start on a mirror.
_TRACED: dict[str, tuple[str, str]] = {
    "shading_efficiency": ("shading efficiency", "fraction of the mirror's area that other mirrors do not shade"),
    "blocking_efficiency": (
        "blocking efficiency",
        "fraction of the mirror's area whose reflected light is not blocked by other mirrors",
    ),
    "optical_efficiency": (
        "optical efficiency",
        "cosine efficiency times the fraction of the mirror's area that is neither shaded nor blocked; over time "
        "the mean of this product",
    ),
    "intercept_efficiency": (
        "intercept efficiency",
        "fraction of the reflected light, excluding blocked light, that hits the receiver",
    ),
    "attenuation_efficiency": (
        "attenuation efficiency",
        "fraction of the light that the air transmits to the receiver",
    ),
    "reflection_efficiency": ("reflection efficiency", "reflectivity times cleanliness"),
    "total_efficiency": (
        "total efficiency",
        "product of optical, reflection, attenuation and intercept efficiency; over time the mean of this product",
    ),
}

#: Efficiencies in the order of the kernel's results, and additional efficiencies of studies with `optics`.
EFFICIENCIES, LIGHT = tuple(_EXACT), tuple(_TRACED)[len(_EXACT) - 1 :]
SERIES = tuple(f"instantaneous_{name}" for name in EFFICIENCIES)
DESIGN = tuple(f"design_point_{name}" for name in (*EFFICIENCIES, *LIGHT))
#: Products of cosine, shading and blocking efficiency: mean product of a heliostat, and product of the field means.
PRODUCT = "factored_efficiency"
FACTORED = "field_efficiency_factored"
#: Variables with random errors from ray tracing. Results with draws omit most standard errors, but include the standard
#: errors of flux maps.
_NOISY = (
    *(f"{of}{at}{name}_efficiency" for of in ("", "field_") for at in ("", "design_point_")
      for name in ("shading", "blocking", "optical", "intercept", "total")), "design_point_power", "field_power",
    *("receiver_energy", "field_receiver_energy", "heliostat_monthly_receiver_energy", "monthly_receiver_energy"),
    *("heliostat_loss", "loss", "instantaneous_total_efficiency", "field_instantaneous_total_efficiency"),
)  # fmt: skip
_DRAWN_NOISY = tuple(f"{of}{name}" for of in ("", "field_") for name in
                     ("optical_efficiency", "intercept_efficiency", "total_efficiency", "receiver_energy"))  # fmt: skip
_MAPS = ("flux_map", "peak_flux", "mean_flux", "energy_flux_map")
MONTHS = 12
#: Angles of the two axes of a mount.
ANGLES = ("primary_angle", "secondary_angle")
OUTLINES = ("outline_u", "outline_v", "outline_area", "outline_heliostat", "outline_count")

_INCIDENT = (
    "direct normal irradiation on the mirror area with the sun above the horizon, including instants outside the limits"
)
_HEAT = "absorbed light minus thermal losses; 0 at instants at which the losses exceed the absorbed light"
_WHOLE = "intervals in which the sun rises or sets are counted in full"
_LOSS = (
    "the sum over all stages is the incident energy minus the received energy; shading is the loss due to "
    "shadows, and blocking is the additional loss due to blocking outside the shadows"
)
_AXES = {
    "primary": "vertical axis: azimuth of the normal, clockwise from north; spinning axis: rotation about the line "
    "to the receiver, 0 with the sun above this line and positive with the sun to its right",
    "secondary": "vertical axis: elevation of the normal; spinning axis: tilt of the normal from the line to the "
    "receiver, which is the angle of incidence",
}
#: Quantities that describe the motion of an axis, as returned by `values.motion`: name, description, unit, comment.
_MOTION = (
    ("min", "minimum {} over the period", "degree"),
    ("max", "maximum {} over the period", "degree"),
    ("range", "range of motion: maximum minus minimum {} over the period", "degree"),
    ("rate", "maximum rate of the {} over the period", "degree h-1",
     "; change between two successive instants of a day divided by the time between them"),
    ("travel", "total travel of the {} over the period", "degree",
     "; sum of the absolute changes between successive instants of a day, excluding the overnight return"),
)  # fmt: skip
_COUNTED = (
    "; the axis moves by the smaller angle between successive instants, and its angle may exceed a full turn; "
    "overnight the axis may rotate back by whole turns, so the range is the smallest range that contains all days"
)
#: Variables that describe the motion of the mount axes over the period.
MOTION = tuple(f"{name}_{what}" for name in ANGLES for what, *_ in _MOTION)
_IMAGES = (
    "outlines of the shadows (shading) or of the areas hidden from the receiver (blocking) on a mirror, in descending "
    "order of area"
)


#: Row of the table: required study properties, name, dimensions, True if computed from complete fields, units, long
#: name, comment and cell methods.
Row = tuple[Any, ...]


#: Rows for mount angles, outlines, field sizes, kept heliostats, flux maps, aim points and the error budget.
_GEOMETRY: tuple[Row, ...] = (
    *(row for axis, comment in _AXES.items() for row in (
        ("angles directions", f"{axis}_angle", "heliostat", False, "degree", f"angle of the {axis} axis", comment),
        *(("angles period", f"{axis}_angle_{what}", "heliostat", False, units,
           words.format(f"angle of the {axis} axis"),
           comment + ("".join(more) or _COUNTED * (axis == "primary")))
          for what, words, units, *more in _MOTION),
    )),
    *(("outlines", f"outline_{name}", f"heliostat effect {dims}", False, units, words, comment)
      for name, dims, units, words, comment in (
        ("u", "image corner", "m", "corner position along the width, from the mirror's centre", _IMAGES),
        ("v", "image corner", "m", "corner position along the height, from the mirror's centre", _IMAGES),
        ("area", "image", "m2", "mirror area within an outline", _IMAGES),
        ("heliostat", "image", "1", "number of the heliostat that shades or blocks the mirror", _IMAGES),
        ("count", "", "1", "number of outlines, including outlines that are not stored", ""))),
    ("geometry", "tower_distance", "heliostat", True, "m", "horizontal distance of the heliostat from the tower"),
    ("geometry", "target_elevation", "heliostat", True, "degree",
     "elevation of the receiver seen from the mirror's centre"),
    ("sizes", "field_heliostats", "", True, "1", "number of heliostats"),
    ("sizes", "field_mirror_area", "", True, "m2", "area of all mirrors"),
    ("land", "field_land_area", "", True, "m2", "land area of the heliostats",
     "area of the convex hull of all heliostats, enlarged on all sides by half the largest mirror diagonal"),
    ("geometry", "field_packing_factor", "", True, "1", "area of all mirrors divided by the land area"),
    ("geometry", "field_mean_radius", "", True, "m", "mean distance of the heliostats from the tower",
     "weighted by mirror area"),
    ("kept", "kept", "heliostat", False, "1", "1 for a kept heliostat, 0 for a removed heliostat",
     "results are for the kept heliostats"),
    ("kept", "selection_rank", "heliostat", False, "1",
     "rank of the heliostat by 'keep.by' before the selection, 1 for the best",
     "heliostats with equal values are ranked in layout order"),
    ("mapped", "flux_map", "flux_row flux_column", False, "kW m-2", "flux on the receiver",
     "mean flux from all heliostats over each cell, {instant}"),
    ("mapped", "peak_flux", "", False, "kW m-2", "maximum flux on a receiver cell",
     "corrected for the bias caused by ray noise, {instant}"),
    ("mapped", "mean_flux", "", False, "kW m-2", "mean flux on the receiver",
     "power on the receiver divided by its whole surface area, {instant}"),
    ("mapped limit", "power_above_limit", "", False, "1",
     "fraction of the power on cells with a flux above the limit", "limit: {limit:g} kW/m2"),
    ("map weather", "energy_flux_map", "flux_row flux_column", False, "MWh m-2",
     "energy on the receiver over the period", "mean over each cell"),
    *((f"limited {when}", name, " ".join((*time, *dims)), False, units, words, "{aimed}")
      for when, time in (("once", ()), ("varies", ("time",))) for name, (dims, units, words) in VARIABLES.items()),
    ("budget", "budget_energy", "", False, "MWh",
     "field energy on the receiver without the causes in the budget"),
    ("budget", "budget_stage_loss", "stage", False, "MWh",
     "field energy lost at each stage without the causes in the budget",
     "the received energy is the incident energy minus the losses at all stages and in all parts of the budget"),
    ("budget", "budget_loss", "budget_part", False, "MWh", "field energy lost to each cause alone",
     "the last part is the interaction of the causes; the sum over all parts is the loss due to all causes together"),
    ("budget", "budget_gain", "budget_cause", False, "MWh",
     "field energy gained if only one cause is removed"),
)  # fmt: skip
_INSTANTS: tuple[Row, ...] = (
    ("series weather", "instantaneous_power", "time heliostat", False, "kW", "{power} at each instant",
     "0 if the field does not operate"),
    *(("series angles", f"instantaneous_{axis}_angle", "time heliostat", False, "degree",
       f"angle of the {axis} axis at each instant", f"{comment}; missing at night")
      for axis, comment in _AXES.items()),
)  # fmt: skip


def rows(optics: bool, directions: bool, mean: str, constant: frozenset[str] = frozenset()) -> list[Row]:
    """Return the table rows for all variables of a study, which depend on `optics` and `directions`.

    `mean` contains the cell methods of a mean over time. `constant` contains the quantities that do not vary with time.
    """
    quantities = _EXACT | (_TRACED if optics else {})
    period, methods = ("", _AREA) if directions else (" over the period", f"{mean} {_AREA}")
    over = {
        name: (words, definition.replace("; over time the mean of this product", ""), "")
        if directions or name in constant
        else (f"mean {words} over the period", definition, mean)
        for name, (words, definition) in quantities.items()
    }
    now = {name: (words, definition.split("; over")[0]) for name, (words, definition) in quantities.items()}
    series = {name: pair for name, pair in now.items() if name in (*EFFICIENCIES, LIGHT[0], LIGHT[-1])}
    return [
        *(("", name, "heliostat", False, "1", *three) for name, three in over.items()),
        *(("", f"field_{name}", "", True, "1", f"mean {quantities[name][0]} of the field{period}", comment, methods)
          for name, (_, comment, _) in over.items()),
        ("exact", PRODUCT, "heliostat", False, "1",
         f"{'' if directions else 'mean '}product of cosine, shading and blocking efficiency{period}",
         "product at each instant, as in Chong and Tan (2012); mirror area that is both shaded and blocked counts "
         "twice in this product, but only once in optical_efficiency", "" if directions else mean),
        ("", FACTORED, "", True, "1", "product of the field's mean cosine, shading and blocking efficiencies",
         "product of three means, as printed by Chong and Tan (2012); field_optical_efficiency is the mean of "
         "the product",
         methods),
        *_GEOMETRY,
        ("weather", "receiver_energy", "heliostat", False, "MWh", "{received}"),
        ("weather", "incident_energy", "heliostat", False, "MWh", "incident energy", _INCIDENT),
        ("weather", "heliostat_monthly_receiver_energy", "month heliostat", False, "MWh", "{received} in each month"),
        ("weather", "heliostat_loss", "stage heliostat", False, "MWh", "energy lost at each stage", _LOSS),
        ("weather", "energy_per_mirror_area", "heliostat", True, "MWh m-2", "{received} per mirror area"),
        ("weather", "rank", "heliostat", True, "1",
         "rank of the heliostat by energy per mirror area, 1 for the maximum",
         "missing if the field receives no energy"),
        ("weather", "field_receiver_energy", "", True, "MWh", "field {received}"),
        ("weather", "field_incident_energy", "", True, "MWh", "incident energy of the field", _INCIDENT),
        ("weather", "field_energy_per_mirror_area", "", True, "MWh m-2", "field {received} per mirror area"),
        ("weather", "monthly_receiver_energy", "month", True, "MWh", "field {received} in each month"),
        ("weather", "monthly_incident_energy", "month", True, "MWh", "incident energy of the field in each month",
         _INCIDENT),
        ("weather", "loss", "stage", True, "MWh", "field energy lost at each stage", _LOSS),
        ("weather", "hours_used", "", True, "h", "hours in which the field operates", _WHOLE),
        ("weather", "hours_lost", "cause", True, "h", "hours with the sun above the horizon in which the field does "
                                                      "not operate because of a limit",
         f"each hour counts for the first violated limit; {_WHOLE}"),
        *(("design", f"design_point_{name}", "heliostat", False, "1", f"{words} at the design point", comment)
          for name, (words, comment) in now.items()),
        *(("design", f"field_design_point_{name}", "", True, "1", f"mean {words} of the field at the design point",
           comment, _AREA) for name, (words, comment) in now.items()),
        ("design", "design_point_power", "", True, "MW", "{power} at the design point"),
        ("heat weather", "field_heat", "", False, "MWh", "heat of the receiver over the period", _HEAT),
        ("heat weather", "monthly_heat", "month", False, "MWh", "heat of the receiver in each month", _HEAT),
        ("heat design", "design_point_heat", "", True, "MW", "heat of the receiver at the design point", _HEAT),
        ("costs", "capital_cost", "item", True, "1", "capital cost in {currency}", "of field, tower and receiver"),
        ("costs", "total_capital_cost", "", True, "1", "capital cost of all items in {currency}",
         "of field, tower and receiver"),
        ("costs", "levelized_cost_of_heat", "", True, "MWh-1", "levelized cost of heat in {currency}",
         "annual fixed charges and operation costs divided by the energy of 365 days: the heat of the receiver, or the "
         "energy on the receiver if the study has neither absorptance nor losses"),
        *(("series", f"instantaneous_{name}", "time heliostat", False, "1", f"{words} at each instant",
           f"{comment}; missing at night") for name, (words, comment) in series.items()),
        *_INSTANTS,
        *(("field", f"field_instantaneous_{name}", "time", False, "1",
           f"mean {words} of the field at each instant", f"{comment}; missing at night", _AREA)
          for name, (words, comment) in series.items()),
        ("field weather", "dni", "time", False, "W m-2", "direct normal irradiance",
         "mean over each time interval; 0 with the sun down"),
        ("field", "sun_azimuth", "time", False, "degree", "azimuth of the sun, clockwise from north",
         "missing at night"),
        ("field", "sun_elevation", "time", False, "degree", "geometric elevation of the sun", "missing at night"),
        ("field weather", "field_power", "time", False, "MW", "{power} of the field",
         "0 if the field does not operate"),
        ("heat field weather", "field_heat_power", "time", False, "MW", "heat of the receiver at each instant", _HEAT),
    ]  # fmt: skip


#: Reserved names of the variables of all studies, which layout columns must not use. Names of aim point variables are
#: reserved only if aim points are chosen, because layouts may contain aim points.
NAMES = frozenset((
    *(name for directions in (False, True) for has, name, *_ in rows(True, directions, "") if "limited" not in has),
    *(f"{name}_error" for name in (*_NOISY, *_MAPS)),
))  # fmt: skip


def _declared(row: Row, words: Mapping[str, Any]) -> Variable:
    """Return the variable described by a table row, with `words` inserted into its long name and comment.

    In the cell methods of an intercept efficiency, means are weighted by the light that leaves the mirrors.
    """
    padded: Row = (*row, *[""] * (8 - len(row)))
    _, name, dims, finished, units, long_name, comment, methods = padded
    fraction = "efficiency" in name or name in ("power_above_limit", "limit_loss", "aim_gap")
    more: dict[str, Any] = {"valid_range": [0.0, 1.0]} if fraction else {}
    if "intercept" in name:
        light = r"\1: mean (weighted by the light that leaves the mirrors)"
        methods = re.sub(r"(time|area): mean \(.*?\)", light, methods)
    if methods or units == "MWh":
        more["cell_methods"] = methods or "time: sum"
    comment = comment.format(**words)
    return quantity(tuple(dims.split()), units, long_name.format(**words), comment, finished=finished, **more)


def _properties(study: FieldEfficiencyStudy) -> set[str]:
    output, weather, point, costs = study.output, study.weather is not None, study.design_point, study.economics
    directions, mapped = isinstance(study.time, SunDirections), study.output.flux_map
    return {name for name, has in {
        "exact": study.optics is None, "directions": directions, "period": not directions,
        "angles": output.tracking_angles, "outlines": output.outlines, "geometry": output.field_geometry,
        "weather": weather, "design": point, "sizes": output.field_geometry or weather or point, "costs": costs,
        "heat": has_heat(study), "land": output.field_geometry or costs, "kept": study.keep,
        "series": output.time_series, "field": output.field_series or (output.time_series and weather),
        "map": mapped, "mapped": mapped and has_instant(study), "limit": mapped and mapped.limit is not None,
        "limited": is_limited(study), "varies": varies(study), "once": not varies(study),
        "budget": study.budget is not None,
    }.items() if has}  # fmt: skip


def _words(study: FieldEfficiencyStudy) -> dict[str, Any]:
    """Return the replacements for the names in braces in the table rows."""
    costs, mapped, instant = study.economics, study.output.flux_map, f"direct normal irradiance {IRRADIANCE:g} W/m2"
    way = "sent towards" if study.optics is None else "on"
    return {
        "received": f"energy {way} the receiver",
        "power": f"power {way} the receiver",
        "currency": costs.currency or "USD" if costs else "",
        "instant": "at the design point" if study.design_point else instant,
        "aimed": "at the design point" if study.design_point else "at each instant" if study.weather else instant,
        "limit": mapped.limit if mapped else None,
    }


def variables(study: FieldEfficiencyStudy) -> dict[str, Variable]:
    """Return the variables with their inner dimensions. If sun directions are given, there are no means over time."""
    optics, properties, words = study.optics, _properties(study), _words(study)
    by_month = optics is not None and optics.cleanliness_by_month is not None
    constant = frozenset(("attenuation_efficiency", *["reflection_efficiency"] * (not by_month)))
    table = rows(
        optics is not None, "directions" in properties, _WEIGHTED if "weather" in properties else _MEAN, constant
    )  # fmt: skip
    found = {row[1]: _declared(row, words) for row in table if properties.issuperset(row[0].split())}
    for name in (*(_NOISY if study.sample is None else _DRAWN_NOISY), *_MAPS) if optics is not None else ():
        if name in found:
            long_name = f"standard error of the {found[name].attrs['long_name']}"
            attrs = {
                "units": found[name].attrs["units"], "long_name": long_name, "comment": "from independent sets of rays"
            }  # fmt: skip
            found[f"{name}_error"] = replace(found[name], attrs=attrs)
    found |= year_variables(study, found)
    best = ("receiver_energy", "energy_per_mirror_area", "hours_used", "power", "heat", "_efficiency", FACTORED)
    smallest = ["rank", "heliostat_loss", "loss", "hours_lost", "power_above_limit", "limit_loss", "total_capital_cost",
                "levelized_cost_of_heat"]  # fmt: skip
    if study.keep and study.keep.heliostats is None:  # `keep` minimises the number of heliostats for a required power
        smallest += ["field_heliostats", "field_mirror_area"]
    return with_best(found, [name for name in found if name.endswith(best)], smallest)
