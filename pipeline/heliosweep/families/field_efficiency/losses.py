"""Losses from the tower's shadow, the site's horizon and heliostat outages, and the error budget of a field.

The energy of a field is computed with all causes of the budget, without any cause, with each cause alone, and with all
causes except one. The loss due to a cause is the loss with this cause alone. The difference between the total loss and
the sum of these losses is the interaction of the causes. All these energies are computed with the same rays.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from heliosweep.config import (
    Block,
    Column,
    Fault,
    FileName,
    Invalid,
    ListOfNumbers,
    Parameter,
    Quantity,
    Site,
    Sweep,
    few_of,
    parse_timezone,
    read_table,
)
from heliosweep.energy import INTERACTION, availability, error_budget, exceedance
from heliosweep.errors import Problem
from heliosweep.families.field_efficiency.optics import KEYS
from heliosweep.files import read_once
from heliosweep.grid import CAUSES, Variable, quantity
from heliosweep.kernels.compiled import Floats
from heliosweep.layouts.layout import Layout
from heliosweep.layouts.resolve import Layouts
from heliosweep.sun import horizon_elevation

if TYPE_CHECKING:
    from heliosweep.families.family import Point
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
    from heliosweep.families.field_efficiency.values import Hours, Values

#: Minimum and maximum allowed elevation of a horizon. [deg]
LOWEST, HIGHEST = -30.0, 60.0
#: Columns of a horizon table, including the column titles of PVGIS files.
_HORIZON = {
    "azimuth": Column("azimuth, clockwise from north, in deg", True, -360, 360, "between -360 and 360 deg",
                      names=("a", "azimut")),
    "elevation": Column("elevation of the horizon, in deg", True, LOWEST, HIGHEST,
                        f"between {LOWEST:g} and {HIGHEST:g} deg", names=("h", "height", "h_hor", "horizon_elevation")),
}  # fmt: skip
#: Stages at which incident energy is lost, in order along the light path.
STAGES = ("horizon", "stow", "cosine", "tower", "shading", "blocking", "reflection", "attenuation", "spillage",
          "availability")  # fmt: skip
#: Annual energies with exceedance values, and the probability of each exceedance value.
_EXCEEDED, _PROBABILITIES = ("field_receiver_energy", "field_heat"), {"p50": 0.5, "p90": 0.9}


class Tower(Block):
    """Tower that shades the mirrors: an upright cylinder at x = y = 0."""

    radius: Annotated[
        float | Sweep,
        Quantity("Radius of the tower", "m", gt=0, le=100, dimension="tower_radius", title="radius of the tower"),
    ]
    top: Annotated[
        float | Sweep | None,
        Quantity("Height of the top of the tower (default: the lower end of the receiver, or 'receiver.height' for "
                 "a receiver without a size)", "m", gt=0, le=1000, dimension="tower_top", title=("height of the "
                                                                                              "tower's top")),
    ] = None  # fmt: skip


class Horizon(Block):
    """Horizon of the site, interpolated linearly between azimuths. The sun below this horizon is treated as set."""

    ONE_OF: ClassVar = ("table", "file")

    table: Annotated[
        tuple[tuple[float, ...], ...] | None,
        ListOfNumbers("Azimuth (clockwise from north) and elevation of each point on the horizon", "deg",
                      ("azimuth", "elevation"), ge=-360, le=360),
    ] = None  # fmt: skip
    file: Annotated[
        str | None, FileName("CSV table of the horizon with the columns azimuth and elevation, in deg", sweep=False)
    ] = None

    def rules(self) -> Iterator[Fault]:
        """Check that the table has one elevation for each azimuth."""
        for row, message in _wrong_rows(np.reshape(self.table or (), (-1, 2))):
            yield Fault(message, ("table", row))


class Availability(Block):
    """Availability of the heliostats. Energy lost while heliostats do not operate is a separate loss stage."""

    fraction: Annotated[
        float | Sweep | None,
        Quantity("Fraction of the time during which a heliostat operates (default: the column 'availability' of the "
                 "layout, otherwise 1)", "1", ge=0, le=1, dimension="availability", title=("availability of the "
                                                                                          "heliostats")),
    ] = None  # fmt: skip
    outages: Annotated[
        str | None,
        FileName("CSV table of outages with the columns heliostat (name, id, or number from 0), from and to. Times "
                 "are in the time zone of the site. Outages recur each year", sweep=False),
    ] = None  # fmt: skip


class FieldSite(Site):
    """Site of the plant, with its horizon."""

    horizon: Annotated[
        Horizon | None, Field(description="Horizon of the site; the sun is treated as set if it is below this line")
    ] = None


def _wrong_rows(table: Floats) -> Iterator[tuple[int, str]]:
    """Yield the index of each invalid horizon row with a message."""
    seen: dict[float, float] = {}
    for row, (azimuth, elevation) in enumerate(table.tolist()):
        if not LOWEST <= elevation <= HIGHEST:
            yield row, f"must have an elevation between {LOWEST:g} and {HIGHEST:g} deg"
        if seen.setdefault(azimuth % 360.0, elevation) != elevation:
            yield row, f"is a second elevation for the azimuth {azimuth:g} deg; keep one"


@read_once(4)
def read_horizon(path: Path, name: str) -> Floats:
    """Read the azimuths and elevations of a horizon, shape (points, 2) [deg]. Raises StudyError."""
    table = read_table(path, name, _HORIZON, rows="points of the horizon", most_rows=100_000)
    points = np.stack([table.column(key) for key in _HORIZON], axis=1)
    for row, message in _wrong_rows(points):
        table.add(message, row, "elevation")
    table.finish()
    return points


def horizon_of(study: Any) -> Floats | None:
    """Return the azimuths and elevations of a study's horizon, shape (points, 2), or None. [deg]"""
    if study.site is None or (horizon := study.site.horizon) is None:
        return None
    return np.array(horizon.table) if horizon.file is None else read_horizon(study.resolve(horizon.file), horizon.file)


def stages(study: FieldEfficiencyStudy) -> list[str]:
    """Return the stages at which a study's incident energy is lost, in order along the light path."""
    optional = {"horizon": horizon_of(study), "tower": study.tower, "availability": study.availability}
    return [stage for stage in STAGES if stage not in optional or optional[stage] is not None]


def causes(study: Any) -> tuple[str, ...]:
    """Return the reasons why the field does not operate while the sun is up."""
    return CAUSES if horizon_of(study) is None else (*CAUSES, "horizon")


def years_of(study: Any) -> str | None:
    """Return the name of the dimension over the weather years of one site, or None."""
    for dim in study.dimensions() if study.weather is not None and study.sites is None else ():
        if [*dim.sweeps] == ["weather.file"] and len(dim) >= 3:
            return str(dim.name)
    return None


def year_variables(study: Any, found: Mapping[str, Variable]) -> dict[str, Variable]:
    """Return the variables for the P50 and P90 energies of a study with several weather years."""
    dim, made = years_of(study), dict[str, Variable]()
    for name in _EXCEEDED if dim else ():
        for label, part in _PROBABILITIES.items() if name in found else ():
            words = f"{label.upper()} of the {found[name].attrs['long_name']}"
            comment = (
                f"value that a year exceeds with a probability of {100 * part:g} %: quantile over the weather files"
            )
            made[f"{name}_{label}"] = quantity((), "MWh", words, comment, finished=True, without=(str(dim),))
    return made


def over_years(study: Any, dims: Sequence[str], values: Mapping[str, Any]) -> dict[str, Floats]:
    """Return the values of `year_variables`, computed from the energies of each weather year."""
    dim = years_of(study)
    return {
        f"{name}_{label}": exceedance(np.moveaxis(np.asarray(values[name]), [*dims].index(dim), -1), part)
        for name in _EXCEEDED if dim is not None and name in values
        for label, part in _PROBABILITIES.items()
    }  # fmt: skip


def hidden(sun: Floats, horizon: Floats | None) -> NDArray[np.bool_]:
    """Return True for each sun direction above the horizontal plane but below the site's horizon, shape (T,)."""
    up: NDArray[np.bool_] = sun[:, 2] > 0.0
    if horizon is None:
        return np.zeros_like(up)
    x, y, z = np.where(up[:, np.newaxis], sun, (0.0, 0.0, 1.0)).T
    return up & (np.degrees(np.arcsin(np.minimum(z, 1.0))) < horizon_elevation(np.degrees(np.arctan2(x, y)), horizon))


def tower_of(values: Mapping[str, Any] | Any, study: FieldEfficiencyStudy) -> tuple[float, float] | None:
    """Return the radius of the tower and the height of its top for given key values; None without a tower. [m]"""
    if study.tower is None:
        return None
    height, extent = (values[f"receiver.{key}"] for key in ("height", "height_extent"))
    top = values["tower.top"]
    return float(values["tower.radius"]), float(height - (extent or 0.0) / 2.0 if top is None else top)


def check_tower(study: FieldEfficiencyStudy) -> Iterator[Problem]:
    """Yield a problem if the tower covers the receiver or contains heliostats."""
    if study.tower is None:
        return
    worst = {"tower.radius": max, "tower.top": max, "receiver.height": min, "receiver.height_extent": max}
    for layout, given in Layouts(study).some(worst):
        values: dict[str, Any] = {**dict.fromkeys(worst), **given}
        radius, top = tower_of(values, study) or (0.0, 0.0)
        wide = given.get("receiver.radius") or (given.get("receiver.width") or 0.0) / 2.0
        bottom = values["receiver.height"] - (values["receiver.height_extent"] or 0.0) / 2.0
        if top <= 0.0:
            yield study.problem(
                "tower.top", "is missing, and the receiver reaches the ground: give the height of the top"
            )
        if study.optics is not None and top > bottom and radius > wide:
            yield study.problem("tower.top", f"covers the receiver: must be at most {bottom:g} m (got {top:g})")
        if (within := np.flatnonzero(np.hypot(layout.x, layout.y) <= radius)).size:
            message = (
                "must be less than the distance from the tower's axis to each mirror; number of mirrors inside the "
                f"tower: {within.size:,}, the first is "
            )
            first = f"{layout.where(within[0])} of {layout.name}"
            yield study.problem("tower.radius", f"{message}{first}; move or remove them")


#: Start and end times of the outages of each heliostat (name or number), in universal time.
Outages = Mapping[str, tuple[NDArray[np.datetime64], NDArray[np.datetime64]]]


@read_once(4)
def read_outages(path: Path, name: str, zone: str) -> Outages:
    """Read a table of outages. Times without a UTC offset are in the time zone `zone`. Raises StudyError."""

    def moment(text: str) -> np.datetime64:
        try:
            time = dt.datetime.fromisoformat(text)
            aware = time if time.tzinfo else time.replace(tzinfo=parse_timezone(zone))
            return np.datetime64(aware.astimezone(dt.UTC).replace(tzinfo=None), "s")
        except (ValueError, OverflowError):  # an overflow is a time in year 1 or 9999 that is in another year in UTC
            raise ValueError(f"must be a time such as 2023-05-31T12:00 (got {text[:40]!r})") from None

    time = partial(Column, required=True, read=moment, dtype="datetime64[s]", missing=np.datetime64("NaT"))
    columns = {
        "heliostat": Column("name, id or number of the heliostat", True, read=str, dtype=object, missing=""),
        "from": time("start of the outage", names=("begin", "start")),
        "to": time("end of the outage", names=("end", "stop", "until")),
    }
    table = read_table(path, name, columns, rows="outages", most_rows=1_000_000)
    names, begin, end = np.array(table.texts("heliostat")), table.column("from"), table.column("to")
    for row in np.flatnonzero(end <= begin).tolist():
        table.add(f"'to' must be later than 'from' (got {table.texts('to')[row]!r})", row, "to")
    found = dict[str, Any]()
    for heliostat in dict.fromkeys(names.tolist()):
        rows = np.flatnonzero(names == heliostat)
        found[heliostat] = begin[rows], end[rows]
        rows = rows[np.argsort(begin[rows])]
        for row in rows[1:][begin[rows[1:]] < end[rows[:-1]]].tolist():
            table.add(f"overlaps another outage of heliostat {heliostat}; join them", row, "from")
    table.finish()
    return found


def outages_of(study: FieldEfficiencyStudy) -> Outages:
    """Return the outages of a study; empty if the study has no outage table."""
    if study.availability is None or (name := study.availability.outages) is None:
        return {}
    return read_outages(study.resolve(name), name, _zone(study) or "+00:00")


def _zone(study: FieldEfficiencyStudy) -> str | None:
    zone: str | None = getattr(study.time, "timezone", None)
    return zone or (None if study.site is None else study.site.timezone)


class Available(NamedTuple):
    """Availability of a layout's heliostats at a result point."""

    #: Fraction of time during which each heliostat operates. [1]
    fraction: Floats
    #: Start and end times of the outages, by heliostat row.
    outages: Mapping[int, tuple[Any, Any]]
    #: Midpoint of each time interval, in universal time.
    utc: NDArray[np.datetime64]

    @classmethod
    def at(cls, point: Point, layout: Layout) -> Available | None:
        """Return the availability of a layout's heliostats; None if the study has no `availability` block."""
        if point.study.availability is None:
            return None
        outages = outages_of(point.study)
        times, matches = [*outages.values()], layout.matches([*outages]).tolist()
        of_rows = {row: times[at] for row, at in enumerate(matches) if at >= 0}
        fraction = layout.values("availability", point["availability.fraction"], 1.0)
        return cls(fraction, of_rows, point.all_instants.labels["utc"].values)

    def apply(self, field: Any, hours: Hours, values: Values, start: int, stop: int) -> Values:
        """Reduce the energies of heliostats `start` to `stop` - 1 to their availability. `field` ignores outages."""
        months, length = values["heliostat_monthly_receiver_energy"], hours.length
        part = np.broadcast_to(self.fraction[start:stop], months.shape).copy()
        begin = self.utc - (1.8e12 * length).astype("timedelta64[ns]")
        for row in self.outages.keys() & range(start, stop):
            out = hours.weight * (1.0 - availability(begin, length, *self.outages[row], yearly=True))
            dark = np.where((out > 0.0)[:, np.newaxis], hours.sun, (0.0, 0.0, -1.0))
            alone = field.energies(hours._replace(sun=dark, weight=out), row, row + 1)
            lost = alone["heliostat_monthly_receiver_energy"][:, 0]
            part[:, row - start] *= 1.0 - lost / np.where(lost > 0.0, months[:, row - start], 1.0)
        year = months.sum(axis=0)
        whole = 1.0 - ((1.0 - part) * months).sum(axis=0) / np.where(year > 0.0, year, 1.0)
        found = dict(values)
        for label in ("", "_error") if "receiver_energy_error" in values else ("",):
            scaled = ("receiver_energy", "heliostat_monthly_receiver_energy", "heliostat_loss")
            energy, monthly, losses = (f"{name}{label}" for name in scaled)
            found[energy], found[monthly] = whole * values[energy], part * values[monthly]
            found[losses] = np.concatenate([values[losses], [values[energy] - found[energy]]])
        return found


def check_availability(study: FieldEfficiencyStudy) -> Iterator[Problem | str]:
    """Yield a problem if outages refer to unknown heliostats, or if the availability has no value."""
    if study.availability is None:
        return
    if study.weather is None:
        yield study.problem("availability", "applies to annual energies: add 'weather', or remove this block")
        return
    if study.availability.outages is not None and _zone(study) is None:
        yield study.problem("availability.outages", "needs a single 'site' with a 'timezone' for the outage times")
        return
    outages = outages_of(study)
    for layout, _ in Layouts(study).some():
        if not outages and study.availability.fraction is None and "availability" not in layout.columns:
            yield study.problem(
                "availability", "has no value: give 'fraction', 'outages', or a layout column 'availability'"
            )
            return
        labels = sorted(outages)
        missing = np.setdiff1d(np.arange(len(labels)), layout.matches(labels))
        if unknown := [labels[at] for at in missing.tolist()]:
            message = f"lists heliostats that are not in {layout.name}: {few_of(unknown)}"
            yield study.problem("availability.outages", message)
            return


#: Keys that a cause in the error budget may contain.
ALLOWED = (*(key for key in KEYS if not key.endswith((".seed", ".rays", ".precision"))), "tracking",
           "availability.fraction")  # fmt: skip


def causes_of(study: FieldEfficiencyStudy) -> dict[str, dict[str, Any]]:
    """Return the causes in an error budget, with undisturbed values of their keys in the units of the study file.

    The value of a key that refers to a file is None. Raises Invalid for an invalid value.
    """
    declared = {key: parameter for key, parameter, _ in study.parameters()}
    causes = {
        cause: {key: None if isinstance(declared[key], FileName) else declared[key].read(raw)
                for key, raw in values.items()}
        for cause, values in (study.budget or {}).items()
    }  # fmt: skip
    for values in causes.values():  # a mirror without its slope map has no slope error
        if "optics.slope_map" in values and study.optics is not None and study.optics.slope_error is None:
            values.setdefault("optics.slope_error", 0.0)
    return causes


def budget_problems(study: FieldEfficiencyStudy) -> Iterator[Problem]:
    """Yield the problems in a budget: unknown keys, invalid values and missing blocks."""
    if study.budget is None:
        return
    if study.weather is None:
        yield study.problem("budget", "needs energies: add 'weather'")
    declared, owner = {key: parameter for key, parameter, _ in study.parameters()}, dict[str, str]()
    if not study.budget:
        yield study.problem("budget", "has no cause: give {cause: {key: undisturbed value}}")
    for cause, values in study.budget.items():
        if not values or cause == INTERACTION:
            message = (
                "is reserved for the remaining loss; use another name" if values else "has no key: give {key: value}"
            )
            yield study.source.problem(("budget", cause), message)
        for key, raw in values.items():
            if owner.setdefault(key, cause) != cause:
                wrong = f"also belongs to the cause {owner[key]!r}; remove one of them"
            else:
                wrong = _check_key(key, raw, declared.get(key))
            if wrong:
                yield study.source.problem(("budget", cause, key), wrong)


def _check_key(key: str, raw: Any, parameter: Parameter | None) -> str:
    """Return a message if a key of a cause or its undisturbed value is invalid, otherwise an empty string."""
    if key not in ALLOWED:
        names = "tracking, availability.fraction, heliostat.focus, and keys of optics and receiver"
        return f"cannot be a key of a cause: use {names}"
    if parameter is None:
        return "is not set in this study: a cause can only contain keys that have a value"
    if isinstance(parameter, FileName):
        return "" if raw == "none" else "must be none: a field without the cause has no such file"
    try:
        return "must be one value" if isinstance(parameter.read(raw), Sweep) else ""
    except Invalid as error:
        return str(error)


def budget_cases(study: FieldEfficiencyStudy) -> int:
    """Return the number of additional energy computations for the error budget of one point."""
    return 1 + 2 * len(study.budget) if study.budget else 0


def budget_labels(study: FieldEfficiencyStudy) -> dict[str, Any]:
    """Return the labels of the budget parts (causes and interaction), with their attributes."""
    causes = tuple(study.budget or ())
    words = {"long_name": "cause of an energy loss"}
    parts = (
        np.array([*causes, INTERACTION], object),
        words | {"comment": f"{INTERACTION}: loss due to all causes together minus the sum of their separate losses"},
    )
    return {"budget_part": parts, "budget_cause": (np.array(causes, object), words)} if causes else {}


def budget_values(
    study: FieldEfficiencyStudy, energies: Callable[[Mapping[str, Any]], tuple[Floats, Floats]], actual: float
) -> dict[str, Floats]:
    """Return the values of the budget variables at one point.

    Parameters
    ----------
    study : FieldEfficiencyStudy
        Study with a `budget`.
    energies : callable
        Function that computes the energy on the receiver and the energy lost at each stage for given key values. [MWh]
    actual : float
        Energy on the receiver with all causes. [MWh]
    """
    causes = causes_of(study)
    every = {key: value for values in causes.values() for key, value in values.items()}
    undisturbed, stages = energies(every)
    others = [{key: every[key] for key in every if key not in values} for values in causes.values()]
    alone, without = (
        {cause: energies(values)[0] for cause, values in zip(causes, cases, strict=True)}
        for cases in (others, causes.values())
    )
    budget = error_budget(undisturbed, actual, alone, without)
    return {
        "budget_energy": np.asarray(undisturbed),
        "budget_stage_loss": stages,
        "budget_loss": budget["loss"].to_numpy(),
        "budget_gain": budget["gain"].to_numpy(),
    }
