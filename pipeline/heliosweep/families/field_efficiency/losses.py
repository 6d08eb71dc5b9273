"""Shadow of the tower and horizon of the site: keys, tables and checks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from heliosweep.config.blocks import Block
from heliosweep.config.faults import Fault
from heliosweep.config.sites import Site
from heliosweep.config.tables import Column, read_table
from heliosweep.config.values import FileName, ListOfNumbers, Quantity, Sweep
from heliosweep.errors import Problem
from heliosweep.files import read_once
from heliosweep.grid.weather import CAUSES
from heliosweep.kernels.compiled import Floats
from heliosweep.layouts.layout import Layout
from heliosweep.layouts.resolve import Layouts
from heliosweep.sun import horizon_elevation

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy

#: Elevations of a horizon. [deg]
LOWEST, HIGHEST = -30.0, 60.0
#: Columns of a table of the horizon, also as PVGIS names them.
_HORIZON = {
    "azimuth": Column("azimuth, clockwise from north, in deg", True, -360, 360, "between -360 and 360 deg",
                      names=("a", "azimut")),
    "elevation": Column("elevation of the horizon, in deg", True, LOWEST, HIGHEST,
                        f"between {LOWEST:g} and {HIGHEST:g} deg", names=("h", "height", "h_hor", "horizon_elevation")),
}  # fmt: skip
#: Stages at which the incident energy is lost, in the order of the light.
STAGES = ("horizon", "stow", "cosine", "tower", "shading", "blocking", "reflection", "attenuation", "spillage")
#: Names of the dimensions of swept keys, which columns of a layout must leave to the result.
NAMES = ("tower_radius", "tower_top")


class Tower(Block):
    """Tower that shades the mirrors: an upright cylinder at x = y = 0."""

    radius: Annotated[
        float | Sweep,
        Quantity("Radius of the tower", "m", gt=0, le=100, dimension="tower_radius", title="radius of the tower"),
    ]
    top: Annotated[
        float | Sweep | None,
        Quantity("Height of the top of the tower (default: the lower end of the receiver, or 'receiver.height' if it "
                 "has no size)", "m", gt=0, le=1000, dimension="tower_top", title="height of the tower's top"),
    ] = None  # fmt: skip


class Horizon(Block):
    """Horizon of the site: the sun below it is down. Linear between the azimuths."""

    table: Annotated[
        tuple[tuple[float, ...], ...] | None,
        ListOfNumbers("Azimuth, clockwise from north, and elevation of points of the horizon", "deg",
                      ("azimuth", "elevation"), ge=-360, le=360),
    ] = None  # fmt: skip
    file: Annotated[
        str | None, FileName("CSV table of the horizon, columns azimuth and elevation in deg", sweep=False)
    ] = None

    def rules(self) -> Iterator[Fault]:
        """Check that there is one table, with one elevation at each azimuth."""
        if (self.table is None) == (self.file is None):
            yield Fault("give exactly one of 'table' and 'file'", show_value=False)
        for row, message in _wrong_rows(np.reshape(self.table or (), (-1, 2))):
            yield Fault(message, ("table", row))


class FieldSite(Site):
    """Place of the plant."""

    horizon: Annotated[Horizon | None, Field(description="Horizon of the site: the sun below it is down")] = None


def _wrong_rows(table: Floats) -> Iterator[tuple[int, str]]:
    """Yield rows of a horizon whose elevation is out of bounds, or differs from another row at this azimuth."""
    seen: dict[float, float] = {}
    for row, (azimuth, elevation) in enumerate(table.tolist()):
        if not LOWEST <= elevation <= HIGHEST:
            yield row, f"must have an elevation between {LOWEST:g} and {HIGHEST:g} deg"
        if seen.setdefault(azimuth % 360.0, elevation) != elevation:
            yield row, f"gives another elevation at the azimuth {azimuth:g} deg; give one"


@read_once(4)
def read_horizon(path: Path, name: str) -> Floats:
    """Read azimuths and elevations of a horizon, shape (points, 2). [deg] Raises StudyError."""
    table = read_table(path, name, _HORIZON, rows="points of the horizon", most_rows=100_000)
    points = np.stack([table.column(key) for key in _HORIZON], axis=1)
    for row, message in _wrong_rows(points):
        table.add(message, row, "elevation")
    table.finish()
    return points


def horizon_of(study: Any) -> Floats | None:
    """Return azimuths and elevations of the horizon of a study, shape (points, 2); None without. [deg]"""
    horizon = None if study.site is None else study.site.horizon
    if horizon is None:
        return None
    return np.array(horizon.table) if horizon.file is None else read_horizon(study.resolve(horizon.file), horizon.file)


def stages(study: FieldEfficiencyStudy) -> list[str]:
    """Return the stages at which the incident energy of a study is lost, in the order of the light."""
    optional = {"horizon": horizon_of(study), "tower": study.tower}
    return [stage for stage in STAGES if stage not in optional or optional[stage] is not None]


def causes(study: Any) -> tuple[str, ...]:
    """Return the causes for which the field does not work with the sun up."""
    return CAUSES if horizon_of(study) is None else (*CAUSES, "horizon")


def hidden(sun: Floats, horizon: Floats | None) -> NDArray[np.bool_]:
    """Return True at instants with the sun above the horizontal and below the horizon; `sun` has the shape (T, 3)."""
    up: NDArray[np.bool_] = sun[:, 2] > 0.0
    if horizon is None:
        return np.zeros_like(up)
    x, y, z = np.where(up[:, np.newaxis], sun, (0.0, 0.0, 1.0)).T
    return up & (np.degrees(np.arcsin(np.minimum(z, 1.0))) < horizon_elevation(np.degrees(np.arctan2(x, y)), horizon))


def tower_of(values: Mapping[str, Any] | Any, study: FieldEfficiencyStudy) -> tuple[float, float] | None:
    """Return radius and top of the tower from values of keys; None without a tower. [m]"""
    if study.tower is None:
        return None
    height, extent = (values[f"receiver.{key}"] for key in ("height", "height_extent"))
    top = values["tower.top"]
    return float(values["tower.radius"]), float(height - (extent or 0.0) / 2.0 if top is None else top)


def check_tower(study: FieldEfficiencyStudy) -> Iterator[Problem]:
    """Yield problems of a tower that covers the receiver or contains heliostats."""
    if study.tower is None:
        return
    worst = {"tower.radius": max, "tower.top": max, "receiver.height": min, "receiver.height_extent": max}
    for layout, given in Layouts(study).some(worst):
        values: dict[str, Any] = {**dict.fromkeys(worst), **given}
        radius, top = tower_of(values, study) or (0.0, 0.0)
        wide = given.get("receiver.radius") or (given.get("receiver.width") or 0.0) / 2.0
        bottom = values["receiver.height"] - (values["receiver.height_extent"] or 0.0) / 2.0
        if top <= 0.0:
            yield study.problem("tower.top", "is missing: the receiver reaches the ground; give the height of the top")
        if study.optics is not None and top > bottom and radius > wide:
            yield study.problem("tower.top", f"covers the receiver: must be at most {bottom:g} m (got {top:g})")
        yield from _within(study, layout, radius)


def _within(study: FieldEfficiencyStudy, layout: Layout, radius: float) -> Iterator[Problem]:
    within = np.flatnonzero(np.hypot(layout.x, layout.y) <= radius)
    if within.size:
        message = f"must be less than the distance of the mirrors: {within.size:,} are within the tower, first "
        yield study.problem("tower.radius", f"{message}{layout.where(within[0])} of {layout.name}; move or remove them")
