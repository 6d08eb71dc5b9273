"""Heat and costs of a field: receiver losses, capital cost by item and levelized cost of heat."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from heliosweep.config import Block, Column, Fault, FileName, Quantity, Sweep, Text, ends, read_table, when
from heliosweep.economics import ITEMS, capital_cost, levelized_cost
from heliosweep.energy import MEGA, monthly_sums, receiver_heat
from heliosweep.errors import Problem
from heliosweep.files import read_once
from heliosweep.kernels.compiled import Floats
from heliosweep.layouts.resolve import Layouts

if TYPE_CHECKING:
    from heliosweep.families.family import Points
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
    from heliosweep.families.field_efficiency.values import Hours, Values

#: Stages at which the receiver loses energy.
HEAT_STAGES = ("absorption", "thermal losses")
_LOSS_COLUMNS = {
    "power": Column("power of the light on the receiver, in MW", required=True, least=0, bounds="at least 0 MW"),
    "losses": Column("thermal losses at this power, in MW", required=True, least=0, bounds="at least 0 MW"),
}


class ThermalLosses(Block):
    """Thermal losses of a receiver in operation, by radiation and convection."""

    ONE_OF: ClassVar = ("constant", "per_area", "file")

    constant: Annotated[
        float | Sweep | None,
        Quantity("Thermal losses of the receiver", "MW", ge=0, dimension="thermal_losses", title="thermal losses"),
    ] = None
    per_area: Annotated[
        float | Sweep | None,
        Quantity("Thermal losses per receiver area; 30 kW/m2 for SAM's molten-salt tower", "kW/m2",
                 ge=0, dimension="thermal_losses_per_area", title="thermal losses per area"),
    ] = None  # fmt: skip
    file: Annotated[
        str | None,
        FileName("CSV table with the columns power (light on the receiver, in MW) and losses (thermal losses at "
                 "this power, in MW)", sweep=False),
    ] = None  # fmt: skip


def _cost(description: str, title: str = "", **more: Any) -> Quantity:
    return Quantity(description, "1", ge=0, title=title or description[0].lower() + description[1:], **more)


class Economics(Block):
    """Costs of field, tower and receiver. The defaults are the US-dollar costs of SAM's molten-salt tower model."""

    currency: Annotated[str | None, Text("Currency of all costs (default: USD)")] = None
    site_cost: Annotated[float | Sweep, _cost("Cost of site improvements per m2 of mirrors")] = 16.0
    heliostat_cost: Annotated[float | Sweep, _cost("Cost of heliostats per m2 of mirrors")] = 127.0
    land_cost: Annotated[float | Sweep, _cost("Cost of land per m2")] = 2.47105
    further_land: Annotated[
        float | Sweep, _cost("Land in addition to the heliostat field, in m2 (default: 45 acres)",
                             "land in addition to the heliostat field in m2")
    ] = 182_108.5  # fmt: skip
    tower_cost: Annotated[
        float | Sweep, _cost("Cost of a tower of zero height; the cost grows exponentially with the height")
    ] = 3e6
    tower_scale: Annotated[
        float | Sweep,
        _cost("Exponential growth rate of the tower cost with height, in 1/m", "growth of tower cost in 1/m"),
    ] = 0.0113
    receiver_cost: Annotated[float | Sweep, _cost("Cost of a receiver with the reference area")] = 103e6
    receiver_reference_area: Annotated[
        float | Sweep,
        Quantity("Reference area of the receiver, in m2", "1", gt=0, title="reference area of the receiver in m2"),
    ] = 1571.0
    receiver_exponent: Annotated[float | Sweep, _cost("Exponent of the receiver area in the receiver cost")] = 0.7
    other_cost: Annotated[float | Sweep, _cost("Further direct costs, such as storage")] = 0.0
    contingency: Annotated[float | Sweep, _cost("Contingency, as a fraction of the direct costs", le=1)] = 0.07
    indirect: Annotated[float | Sweep, _cost("Indirect costs, as a fraction of the direct costs", le=1)] = 0.13
    sales_tax: Annotated[float | Sweep, _cost("Sales tax, as a fraction of the direct costs", le=1)] = 0.04
    fixed_charge_rate: Annotated[
        float | Sweep, _cost("Fraction of the capital cost that is paid each year", "fixed charge rate", le=1)
    ] = 0.07
    operation_cost: Annotated[float | Sweep, _cost("Annual cost of operation and maintenance")] = 0.0

    def rules(self) -> Iterator[Fault]:
        """Check that custom costs have a currency, and that no cost in another currency has a default in USD."""
        fields, known = type(self).model_fields, self.currency in (None, "USD")
        costs = [key for key in fields if key.endswith("_cost")]
        own = [key for key in costs if getattr(self, key) != fields[key].default]
        needed = set(costs) - self.model_fields_set - {"other_cost", "operation_cost"}
        return when(
            *((self.currency is None,
               Fault(f"'currency' is missing: set the currency of '{key}', for example USD", show_value=False))
              for key in own[:1]),
            *((not known and key in needed,
               Fault(f"'{key}' is missing: its default is in USD; give it in {self.currency}", show_value=False))
              for key in costs),
        )  # fmt: skip


def has_heat(study: FieldEfficiencyStudy) -> bool:
    """Return True if the study specifies the absorptance or the thermal losses of the receiver."""
    return study.receiver.absorptance is not None or study.receiver.thermal_losses is not None


def heat_rules(study: FieldEfficiencyStudy) -> tuple[tuple[object, str, str], ...]:
    """Return the rules for heat and cost keys as tuples (condition of a fault, key, message)."""
    given = [f"receiver.{key}" for key in ("absorptance", "thermal_losses") if getattr(study.receiver, key) is not None]
    return (
        *((study.optics is None, key, "needs 'optics': add 'optics', or remove this key") for key in given),
        *((study.design_point is None and study.weather is None, key,
           "needs 'weather' or 'design_point': add one of them") for key in given),
        *((study.economics and getattr(study, key) is None, "economics",
           f"needs '{key}' for the energy on the receiver: add it, or remove this block")
          for key in ("optics", "weather")),
    )  # fmt: skip


def check_losses(study: FieldEfficiencyStudy) -> Iterator[Problem]:
    """Check that the thermal losses are less than the maximum power that the receiver can absorb."""
    losses, point = study.receiver.thermal_losses, study.design_point
    if losses is None:
        return
    if losses.file is not None:
        read_losses(study.resolve(losses.file), losses.file)
        return
    dni = 1000.0 if point is None else point.dni
    keys = dict.fromkeys(("heliostat.width", "heliostat.height"), max)
    areas = (
        float(np.sum(math.prod(layout.values(key.rpartition(".")[2], values.get(key)) for key in keys)))
        for layout, values in Layouts(study).some(keys)
    )
    most = max(ends(study.receiver.absorptance or 1.0)) * dni * MEGA * max(areas)
    size = {key: min(ends(getattr(study.receiver, key) or 0.0)) for key in ("radius", "width", "height_extent")}
    least = {key: None if (value := getattr(losses, key)) is None else min(ends(value)) for key in LOSSES}
    lost = _losses(size | least)
    if lost >= most:
        key = next(key for key in LOSSES if least[key] is not None)
        message = f"gives losses of {lost:.4g} MW, but the receiver absorbs at most {most:.4g} MW of the light on all "
        yield study.problem(f"receiver.thermal_losses.{key}", f"{message}mirrors: lower it")


@read_once(4)
def read_losses(path: Path, name: str) -> Floats:
    """Read a table of thermal losses against power on the receiver, shape (2, n). [MW]

    Raises
    ------
    StudyError
        If the file cannot be read or contains no valid loss table. The message lists each problem with its line number.
    """
    table = read_table(path, name, _LOSS_COLUMNS, rows="powers")
    power, lost = (table.column(key) for key in _LOSS_COLUMNS)
    for row in np.flatnonzero(np.diff(power) <= 0.0) + 1:
        table.add(f"the powers must increase (got {power[row]:g})", int(row))
    if len(table) and lost[-1] >= power[-1]:
        table.add(f"losses of {lost[-1]:g} MW must be less than the power of {power[-1]:g} MW", len(table) - 1)
    table.finish()
    return np.stack((power, lost))


#: Keys of `ThermalLosses` that specify the losses as a number.
LOSSES = ("constant", "per_area")


def _losses(values: Mapping[str, Any]) -> float:
    """Return the thermal losses of a receiver without a loss table. [MW]

    `values` maps the last part of each key to its value.
    """
    area = (2.0 * np.pi * values["radius"] if values["radius"] else values["width"]) * values["height_extent"]
    return float((values["constant"] or 0.0) + 1e-3 * (values["per_area"] or 0.0) * area)


def heat_power(power: Any, values: Mapping[str, Any], table: Floats | None) -> Any:
    """Return the heat output of a receiver for a given power on the receiver. [MW]

    `values` maps the last part of each key to its value.
    """
    absorptance = 1.0 if values["absorptance"] is None else values["absorptance"]
    return receiver_heat(power, absorptance, _losses(values), table=table)


def heat_of_year(
    light: Floats, values: Mapping[str, Any], table: Floats | None, hours: Hours, found: Values
) -> dict[str, Any]:
    """Return the total and monthly heat of a field, and add the receiver losses to the heliostat losses in `found`.

    `light`, shape (T,), is proportional to the field's power on the receiver divided by the irradiance. The receiver
    losses are distributed over the heliostats in proportion to the energy of each heliostat on the receiver.
    """
    length, power, energy = hours.length, np.nan_to_num(light * hours.dni), found["receiver_energy"]
    heat = heat_power(power * (energy.sum() / (power @ length or np.inf)), values, table)
    monthly = monthly_sums(heat * length, hours.month)
    reflected = 0.0 if values["absorptance"] is None else 1.0 - values["absorptance"]
    part = monthly.sum() / (energy.sum() or np.inf)
    for label, lost in (("", 1.0 - reflected - part), ("_error", 0.0)):
        each = found[f"receiver_energy{label}"]
        found[f"heliostat_loss{label}"] = np.concatenate(
            [found[f"heliostat_loss{label}"], [reflected * each, lost * each]]
        )
    return {"field_heat": monthly.sum(), "monthly_heat": monthly}


def costs_of(points: Points, made: Mapping[str, Floats], energy: Floats) -> dict[str, Floats]:
    """Return the costs at the points of a region.

    `made` contains field sizes [m, m2] and the number of days. `energy` is the energy over the period [MWh].
    """

    def column(key: str) -> Any:
        values = points.column(key)[1]
        return None if values is None else np.ravel(values).astype(np.float64)

    study, shape = points.study, energy.shape
    receiver = {key: column(f"receiver.{key}") for key in ("radius", "width", "height_extent")}
    if study.receiver.kind == "cylinder":
        receiver["width"] = 2.0 * np.pi * receiver["radius"]
    given = {key: column(f"economics.{key}") for key in Economics.model_fields if key != "currency"}
    rate, operation, land = (given.pop(key) for key in ("fixed_charge_rate", "operation_cost", "further_land"))
    cost = capital_cost(
        made["field_mirror_area"].ravel(), column("receiver.height"), receiver["width"] * receiver["height_extent"],
        receiver["height_extent"], made["mirror_height"].ravel(), made["field_land_area"].ravel() + land, **given,
    )  # fmt: skip
    total, yearly = cost["total_capital_cost"].to_numpy(), (energy * (365.0 / made["days"])).ravel()
    level, some = np.full(yearly.shape, np.nan), yearly > 0.0
    level[some] = levelized_cost(total[some], yearly[some], fixed_charge_rate=rate[some], operation=operation[some])
    items = cost["capital_cost"].transpose(..., "item").to_numpy().reshape(*shape, len(ITEMS))
    named = {"total_capital_cost": total, "levelized_cost_of_heat": level}
    return {"capital_cost": items} | {name: values.reshape(shape) for name, values in named.items()}
