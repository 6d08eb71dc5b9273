"""Selection of the best heliostats: generate more heliostats than required, rank them by a result, and keep the best.

The field of the kept heliostats is then recomputed without the other heliostats.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

from heliosweep.config import Block, Choice, Fault, Quantity, SunDirections, Sweep, ends
from heliosweep.families.field_efficiency.heat import has_heat

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy

#: Results by which heliostats can be ranked, and their meaning.
BY = {
    "receiver_energy": "energy on the receiver; needs 'weather'",
    "energy_per_mirror_area": "energy on the receiver per mirror area; needs 'weather'",
    "total_efficiency": "mean over the period, from the sun to the receiver; needs 'optics'",
    "optical_efficiency": "mean over the period of cosine, shading and blocking together",
    "design_point_total_efficiency": "at the design point; needs 'optics' and 'design_point'",
    "design_point_optical_efficiency": "at the design point; needs 'design_point'",
}
#: Study blocks that each ranking result needs.
_NEEDS: dict[str, tuple[str, ...]] = {
    "receiver_energy": ("weather",),
    "energy_per_mirror_area": ("weather",),
    "total_efficiency": ("optics",),
    "design_point_total_efficiency": ("optics", "design_point"),
    "design_point_optical_efficiency": ("design_point",),
}


class Keep(Block):
    """Selection of the best heliostats of a layout, by number or by power."""

    heliostats: Annotated[
        int | Sweep | None,
        Quantity("Number of heliostats", "1", ge=1, integer=True, dimension="kept_heliostats",
                 title="number of kept heliostats"),
    ] = None  # fmt: skip
    field_power: Annotated[
        float | Sweep | None,
        Quantity("Required power of the field at the design point: keep the minimum number of best heliostats that "
                 "reaches it", "MW", gt=0,
                 dimension="kept_power", title="required power at the design point"),
    ] = None  # fmt: skip
    heat_power: Annotated[
        float | Sweep | None,
        Quantity("Required heat of the receiver at the design point: keep the minimum number of best heliostats "
                 "that reaches it", "MW", gt=0,
                 dimension="kept_heat", title="required heat at the design point"),
    ] = None  # fmt: skip
    by: Annotated[str | Sweep, Choice("Result by which heliostats are ranked, in descending order", BY,
                                      dimension="kept_by", title="result by which heliostats are ranked")]  # fmt: skip

    def rules(self) -> Iterator[Fault]:
        """Check that exactly one key sets the size of the selection."""
        if sum(size is not None for size in (self.heliostats, self.field_power, self.heat_power)) != 1:
            yield Fault("give exactly one of 'heliostats', 'field_power' and 'heat_power'", show_value=False)


def keep_faults(study: FieldEfficiencyStudy) -> Iterator[Fault]:
    """Yield faults of a study with `keep`: missing keys, and keys that cannot be used with it."""
    keep = study.keep
    if keep is None:
        return
    if isinstance(study.time, SunDirections):
        message = (
            "ranks heliostats over a period at a site: run such a study first; 'heliosweep table DIR' then "
            "uses the kept heliostats"
        )
        yield Fault(message, ("keep",), show_value=False)
        return
    for name in ends(keep.by):
        for key in (key for key in _NEEDS.get(name, ()) if getattr(study, key) is None):
            yield Fault(f"needs '{key}' for {name}: add it, or rank by another result", ("keep", "by"))
    for key in ("field_power", "heat_power"):
        if getattr(keep, key) is not None and study.design_point is None:
            yield Fault("needs a design point: add 'design_point'", ("keep", key))
    if keep.heat_power is not None and not has_heat(study):
        yield Fault("needs 'receiver.absorptance' or 'receiver.thermal_losses': add one", ("keep", "heat_power"))
    if study.output.outlines:
        yield Fault("cannot be used with 'keep': remove one of them", ("output", "outlines"))
