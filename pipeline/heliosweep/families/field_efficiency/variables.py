"""Variables of a result: names, CF attributes and definitions, in the order of the file."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from heliosweep.config.times import SunDirections
from heliosweep.families.field_efficiency.flux import flux_variables
from heliosweep.families.field_efficiency.keep import keep_variables
from heliosweep.grid.regions import Variable, quantity, with_best

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy

_MEAN = "time: mean (over the instants with the sun above the horizon)"
_WEIGHTED = (
    "time: mean (weighted by direct normal irradiance times the length of the interval, over the instants with the sun "
    "above the horizon and all values within the limits)"
)
_AREA = "area: mean (weighted by mirror area)"
_LEAVING = re.compile(r"(time|area): mean \(.*?\)")

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
#: With `optics`: parts of the rays that start on a mirror.
_TRACED: dict[str, tuple[str, str]] = {
    "shading_efficiency": ("shading efficiency", "part of the mirror's area that no other mirror hides from the sun"),
    "blocking_efficiency": (
        "blocking efficiency",
        "part of the mirror's area whose reflected light meets no other mirror before the receiver",
    ),
    "optical_efficiency": (
        "optical efficiency",
        "cosine efficiency times the part of the mirror's area that is neither shaded nor blocked; over time the mean "
        "of this product",
    ),
}
_LIGHT: dict[str, tuple[str, str]] = {
    "intercept_efficiency": (
        "intercept efficiency",
        "part of the light that leaves the mirror, neither shaded nor blocked, that meets the receiver",
    ),
    "attenuation_efficiency": ("attenuation efficiency", "part of the light that passes the air to the receiver"),
    "reflection_efficiency": ("reflection efficiency", "reflectivity times cleanliness"),
    "total_efficiency": (
        "total efficiency",
        "optical times reflection, attenuation and intercept efficiency; over time the mean of this product",
    ),
}
#: Variables for each heliostat that `optics` adds, and the subset in time series.
LIGHT = tuple(_LIGHT)
LIGHT_SERIES = tuple(f"instantaneous_{name}" for name in ("intercept_efficiency", "total_efficiency"))
#: The same at the design point.
DESIGN = tuple(f"design_point_{name}" for name in (*EFFICIENCIES, *LIGHT))
#: Efficiencies of heliostats that are random by rays, also at the design point, and all variables that are.
NOISY = tuple(f"{of}{name}_efficiency" for of in ("", "design_point_")
              for name in ("shading", "blocking", "optical", "intercept", "total"))  # fmt: skip
_NOISY = (
    *NOISY, *(f"field_{name}" for name in NOISY), "design_point_power", "field_power",
    *("receiver_energy", "field_receiver_energy", "heliostat_monthly_receiver_energy", "monthly_receiver_energy"),
    *("heliostat_loss", "loss", "instantaneous_total_efficiency", "field_instantaneous_total_efficiency"),
)  # fmt: skip
#: Variables of draws: each draw is a point, and the spread of draws is the result.
_DRAWN_NOISY = tuple(f"{of}{name}" for of in ("", "field_") for name in
                     ("optical_efficiency", "intercept_efficiency", "total_efficiency", "receiver_energy"))  # fmt: skip
#: Sum over the field -> values of heliostats, whose standard errors add in squares.
FIELD_SUMS = {
    "field_receiver_energy": "receiver_energy", "loss": "heliostat_loss",
    "monthly_receiver_energy": "heliostat_monthly_receiver_energy",
}  # fmt: skip
#: Whole-field variable -> per-heliostat variable of which it is the mean.
FIELD_MEANS = {f"field_{name}": name for name in (*EFFICIENCIES, *LIGHT, *DESIGN)}
#: Product of three field means.
FACTORED = "field_efficiency_factored"
#: Time series, in the order of the kernel.
SERIES = tuple(f"instantaneous_{name}" for name in EFFICIENCIES)


#: Months of a year.
MONTHS = 12
#: Stages at which the incident energy is lost, in the order of the light.
STAGES = ("stow", "cosine", "shading", "blocking", "reflection", "attenuation", "spillage")

_RECEIVED = "energy that meets the receiver"
_TOWARDS = "energy sent towards the receiver"
_INCIDENT = "direct normal irradiation of the mirror area, with the sun above the horizon, also beyond the limits"
_WHOLE = "intervals in which the sun rises or sets count whole"
#: Of energies: dimensions, finished from whole fields, unit, words.
_ENERGIES: dict[str, tuple[tuple[str, ...], bool, str, str, str]] = {
    "receiver_energy": (("heliostat",), False, "MWh", "{}", ""),
    "incident_energy": (("heliostat",), False, "MWh", "incident energy", _INCIDENT),
    "heliostat_monthly_receiver_energy": (("month", "heliostat"), False, "MWh", "{} in each month", ""),
    "heliostat_loss": (("stage", "heliostat"), False, "MWh", "energy that each stage takes", "{loss}"),
    "energy_per_mirror_area": (("heliostat",), True, "MWh m-2", "{} per mirror area", ""),
    "rank": (
        ("heliostat",),
        True,
        "1",
        "rank of the heliostat by energy per mirror area, 1 for the most",
        "missing where the field receives no energy",
    ),
    "field_receiver_energy": ((), True, "MWh", "{}, of the field", ""),
    "field_incident_energy": ((), True, "MWh", "incident energy of the field", _INCIDENT),
    "field_energy_per_mirror_area": ((), True, "MWh m-2", "{} per mirror area, of the field", ""),
    "monthly_receiver_energy": (("month",), True, "MWh", "{} in each month, of the field", ""),
    "monthly_incident_energy": (("month",), True, "MWh", "incident energy of the field in each month", _INCIDENT),
    "loss": (("stage",), True, "MWh", "energy of the field that each stage takes", "{loss}"),
    "hours_used": ((), True, "h", "hours in which the field works", _WHOLE),
    "hours_lost": (
        ("cause",),
        True,
        "h",
        "hours with the sun above the horizon that a limit takes",
        f"each counts for the first limit that it misses; {_WHOLE}",
    ),
}
_LOSS = (
    "the sum over all stages is incident minus received energy; shading is the shaded part of "
    "the light on the mirrors, blocking the remainder of the shaded or blocked part"
)
#: At each instant of the study: unit and words.
_INSTANTS = {
    "dni": ("W m-2", "direct normal irradiance", "mean over the interval of the instant; 0 with the sun down"),
    "sun_azimuth": ("degree", "azimuth of the sun, clockwise from north", "missing at night"),
    "sun_elevation": ("degree", "geometric elevation of the sun", "missing at night"),
    "field_power": ("MW", "{power} of the field", "0 where the field does not work"),
}

_AXES = {
    "primary": "vertical axis: azimuth of the normal, from north, clockwise; spinning axis: turn about the line to the "
    "receiver, 0 with the sun above it and positive with the sun to its right",
    "secondary": "vertical axis: elevation of the normal; spinning axis: tilt of the normal from the line to the "
    "receiver, which is the angle of incidence",
}
#: Quantities of the course of an angle, in the order of `angles.motion`: name, words, unit.
_MOTION = (
    ("min", "least {} over the period", "degree"),
    ("max", "largest {} over the period", "degree"),
    ("range", "range of motion: largest minus least {} over the period", "degree"),
    ("rate", "largest rate of the {} over the period", "degree h-1"),
)
_COUNTED = (
    "; counted on beyond a full turn, the shorter way from instant to instant of a day; overnight the axis may turn "
    "back by whole turns, so that the range is the smallest that holds all days"
)
_RATE = "; change between two successive instants of a day over the time between them"
#: Angles of the mount at a direction of the sun, at each instant, and over the period.
ANGLES = ("primary_angle", "secondary_angle")
ANGLE_SERIES = tuple(f"instantaneous_{name}" for name in ANGLES)
MOTION = tuple(f"{name}_{what}" for name in ANGLES for what, _, _ in _MOTION)

#: Names of results and dimensions that energies, design point and series add, which columns of layouts must leave.
ENERGY_NAMES = (
    *(*_ENERGIES, *_INSTANTS, *DESIGN, *(f"{name}_error" for name in _NOISY)),
    *(f"field_{name}" for name in (*DESIGN, *SERIES, *LIGHT_SERIES)),
    *("design_point_power", "instantaneous_power", "month", "stage", "cause"),
)

#: Variables with the maximum as the best value, also for the field, and with the minimum; sizes and angles have no
#: best.
_LARGEST = (
    *("receiver_energy", "heliostat_monthly_receiver_energy", "energy_per_mirror_area", "field_receiver_energy"),
    *("field_energy_per_mirror_area", "monthly_receiver_energy", "hours_used", "design_point_power", "field_power"),
    *("instantaneous_power", FACTORED, *EFFICIENCIES, *LIGHT, *DESIGN, *SERIES, *LIGHT_SERIES),
)
_SMALLEST = ("rank", "heliostat_loss", "loss", "hours_lost", "power_above_limit")

#: Variables of each heliostat, and of the field.
PLACES = {
    "tower_distance": ("m", "horizontal distance of the heliostat from the tower", ""),
    "target_elevation": ("degree", "elevation of the receiver seen from the mirror's centre", ""),
}
SIZES = {
    "field_heliostats": ("1", "number of heliostats", ""),
    "field_mirror_area": ("m2", "area of all mirrors", ""),
    "field_land_area": (
        "m2",
        "land that the heliostats take",
        "within a line around the convex hull of all heliostats, half the largest diagonal of a mirror outside of it",
    ),
    "field_packing_factor": ("1", "area of all mirrors over the land that they take", ""),
    "field_mean_radius": ("m", "mean distance of the heliostats from the tower", "weighted by mirror area"),
}

_IMAGES = "of the shadows (shading) or of the parts hidden from the receiver (blocking) on a mirror, the largest first"
#: Further dimensions, units and words.
OUTLINES: dict[str, tuple[tuple[str, ...], str, str, str]] = {
    "outline_u": (("image", "corner"), "m", "corner along the width, from the mirror's centre", _IMAGES),
    "outline_v": (("image", "corner"), "m", "corner along the height, from the mirror's centre", _IMAGES),
    "outline_area": (("image",), "m2", "area of the part of the mirror within an outline", _IMAGES),
    "outline_heliostat": (("image",), "1", "number of the heliostat that shades or blocks", _IMAGES),
    "outline_count": ((), "1", "number of outlines, including outlines that are not stored", ""),
}


def _quantities(study: FieldEfficiencyStudy) -> dict[str, tuple[str, str]]:
    """Return long names and comments of the efficiencies of a study."""
    return _QUANTITIES if study.optics is None else _QUANTITIES | _TRACED | _LIGHT


def _weighting(name: str, methods: str) -> str:
    """Return the cell methods of an efficiency: an intercept is a part of the light that leaves the mirrors."""
    return (
        _LEAVING.sub(r"\1: mean (weighted by the light that leaves the mirrors)", methods)
        if "intercept" in name
        else methods
    )


def _of_axes(directions: bool) -> dict[str, Variable]:
    """Angles of both axes of each heliostat, at directions of the sun or over the period."""
    found, dims = {}, ("heliostat",)
    for axis, comment in _AXES.items():
        name = f"{axis}_angle"
        if directions:
            found[name] = quantity(dims, "degree", f"angle of the {axis} axis", comment)
            continue
        for what, words, units in _MOTION:
            more = _RATE if what == "rate" else _COUNTED if axis == "primary" else ""
            found[f"{name}_{what}"] = quantity(dims, units, words.format(f"angle of the {axis} axis"), comment + more)
    return found


def _of_energy(study: FieldEfficiencyStudy) -> dict[str, Variable]:
    """Return variables of energies, and of the irradiance at the design point."""
    found = {}
    received = _TOWARDS if study.optics is None else _RECEIVED
    for name, (dims, finished, units, long_name, comment) in _ENERGIES.items() if study.weather is not None else ():
        more: dict[str, Any] = {"cell_methods": "time: sum"} if units == "MWh" else {}
        words = long_name.format(received)
        comment = comment.format(loss=_LOSS)
        found[name] = quantity(dims, units, words, comment, finished=finished, **more)
    return found


def _of_design_point(study: FieldEfficiencyStudy) -> dict[str, Variable]:
    """Efficiencies of the heliostats and of the field at the design point, and its power."""
    if study.design_point is None:
        return {}
    quantities = _quantities(study)
    found = {}
    for name, (long_name, comment) in quantities.items():
        attrs = _attrs(f"{long_name} at the design point", comment.split("; over")[0])
        found[f"design_point_{name}"] = Variable(("heliostat",), attrs)
    for name, one in list(found.items()):
        attrs = {
            **one.attrs,
            "long_name": f"mean {one.attrs['long_name']} of the field",
            "cell_methods": _weighting(name, _AREA),
        }
        found[f"field_{name}"] = Variable((), attrs, finished=True)
    power = "power on the receiver" if study.optics is not None else "power sent towards the receiver"
    found["design_point_power"] = quantity((), "MW", f"{power} at the design point", finished=True)
    return found


def _at_instants(study: FieldEfficiencyStudy) -> dict[str, Variable]:
    """Values of heliostats and of the field at each instant."""
    found: dict[str, Variable] = {}
    quantities = _quantities(study)
    of_field = study.output.field_series or (study.output.time_series and study.weather is not None)
    power = "power on the receiver" if study.optics is not None else "power sent towards the receiver"
    series = {}
    for name in (*SERIES, *(LIGHT_SERIES if study.optics is not None else ())):
        long_name, comment = quantities[name.removeprefix("instantaneous_")]
        series[name] = f"{long_name} at each instant", f"{comment.split('; over')[0]}; missing at night"
    if study.output.time_series:
        for name, words in series.items():
            found[name] = Variable(("time", "heliostat"), _attrs(*words))
        if study.weather is not None:
            words = f"{power} at each instant", "0 where the field does not work"
            found["instantaneous_power"] = quantity(("time", "heliostat"), "kW", *words)
        if study.output.tracking_angles:
            for name, comment in zip(ANGLE_SERIES, _AXES.values(), strict=True):
                words = f"angle of the {name.split('_')[1]} axis at each instant", f"{comment}; missing at night"
                found[name] = quantity(("time", "heliostat"), "degree", *words)
    for name, (long_name, comment) in series.items() if of_field else ():
        found[f"field_{name}"] = Variable(
            ("time",), _attrs(f"mean {long_name}, of the field", comment, _weighting(name, _AREA))
        )
    for name, (units, long_name, comment) in _INSTANTS.items() if of_field else ():
        if study.weather is not None or name.startswith("sun"):
            found[name] = quantity(("time",), units, long_name.format(power=power), comment)
    return found


def _error_attributes(one: Variable) -> dict[str, str]:
    """Attributes of the standard error of a variable."""
    words = f"standard error of the {one.attrs['long_name']}"
    return {"units": one.attrs["units"], "long_name": words, "comment": "by independent sets of rays"}


def variables(study: FieldEfficiencyStudy) -> dict[str, Variable]:
    """Return the variables with their inner dimensions; with directions of the sun, values at each and no means."""
    directions = isinstance(study.time, SunDirections)
    mean = _MEAN if study.weather is None else _WEIGHTED
    found = {}
    quantities = _quantities(study)
    by_month = study.optics is not None and study.optics.cleanliness_by_month is not None
    constant = {"attenuation_efficiency"} | (set() if by_month else {"reflection_efficiency"})
    for name, (long_name, comment) in quantities.items():
        if directions or name in constant:
            attrs = _attrs(long_name, comment.replace("; over time the mean of this product", ""))
        else:
            attrs = _attrs(f"mean {long_name} over the period", comment, _weighting(name, mean))
        found[name] = Variable(("heliostat",), attrs)
    period, methods = ("", _AREA) if directions else (" over the period", f"{mean} {_AREA}")
    for name in quantities:
        field_name, long_name = f"field_{name}", f"mean {quantities[name][0]} of the field{period}"
        attrs = _attrs(long_name, found[name].attrs["comment"], _weighting(name, methods))
        found[field_name] = Variable((), attrs, finished=True)
    found[FACTORED] = Variable(
        (),
        _attrs(
            "product of the field's mean cosine, shading and blocking efficiencies",
            "product of three means, as Chong and Tan (2012) print it; field_optical_efficiency is the mean of the "
            "product",
            methods,
        ),
        finished=True,
    )
    if study.output.tracking_angles:
        found |= _of_axes(directions)
    if study.output.outlines:
        for name, (dims, units, *told) in OUTLINES.items():
            found[name] = quantity(("heliostat", "effect", *dims), units, *told)
    if study.output.field_geometry:
        for known, dims in ((PLACES, ("heliostat",)), (SIZES, ())):
            found |= {name: quantity(dims, *told, finished=True) for name, told in known.items()}
    elif study.weather is not None or study.design_point is not None:
        for name in ("field_heliostats", "field_mirror_area"):
            found[name] = quantity((), *SIZES[name], finished=True)
    found |= keep_variables(study) | flux_variables(study) | _of_energy(study)
    found |= _of_design_point(study) | _at_instants(study)
    if study.optics is not None:
        noisy = [name for name in (_NOISY if study.sample is None else _DRAWN_NOISY) if name in found]
        found |= {f"{name}_error": replace(found[name], attrs=_error_attributes(found[name])) for name in noisy}
    fewest = ("field_heliostats", "field_mirror_area") if study.keep and study.keep.field_power is not None else ()
    return with_best(found, (*_LARGEST, *(f"field_{name}" for name in _LARGEST)), (*_SMALLEST, *fewest))
