"""Figures of a finished result, by what it holds; after Optics Express 27 (8), A257 (2019).

Each takes from the sweep what it can show, and its caption says at which values the rest stands; one that needs what
the result does not have is left out. Those of each mode are in its package; here is what they share.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.blocks import ERRORS
from heliosweep.report.contents import NamedFigure, one_by_one
from heliosweep.report.labels import number_text
from heliosweep.report.selection import Point, Shown, at, evenly

if TYPE_CHECKING:
    from heliosweep.report.panels import Panel
    from heliosweep.report.pictures import FieldMap
    from heliosweep.report.tracks import Look

#: Dimensions of the instants: one of the days, and the hour.
DAYS = ("day", "declination", "date")
HOUR, HELIOSTAT, AXIS, PARAMETER = "hour", "heliostat", "axis", "parameter"

#: Dimensions that are neither swept nor instants.
NOT_SWEPT = {*DAYS, HOUR, HELIOSTAT, PARAMETER, "parameter_2", "spot", "percentile", "tolerance_axis", "detector"}
NOT_SWEPT |= {"conic_coefficient", "sample", "trace", "crossing", "round", "outline", "edge"}

#: Panels of one figure, lines of one panel, maps of one figure.
MOST_PANELS, MOST_LINES, MOST_MAPS = 6, 6, 6

#: Figures of one result.
MOST_FIGURES = 10

#: Rows of one table.
MOST_ROWS = 40

#: From so many heliostats on they are a field, of which there are maps.
FIELD = 7

#: Colours of the error axes, red and blue as in Figure 4 of the paper, of Okabe and Ito.
AXES: dict[str, Look] = {
    "elevation": {"color": "#D55E00"},
    "azimuth": {"color": "#0072B2"},
    "encoder-azimuth": {"color": "#009E73", "linestyle": (0, (4, 1.4))},
}


class Spots(Shown):
    """A result of the family, of which figures show heliostats, hours and errors."""

    titles: ClassVar = {
        HOUR: "hour",
        "day": "day",
        "declination": "declination",
        AXIS: "axis",
        "source": "source",
        "error_size": "error",
        "error_scale": "scale of the errors",
        "mount_kind": "mount",
        "days_used": "days used",
        "parameters": "parameters",
        "noise": "noise",
        "detector_pitch": "pitch",
        "detector_noise": "noise",
        "receiver_width": "aperture width",
        "receiver_height_extent": "height",
    }
    typical: ClassVar = {**dict.fromkeys(ERRORS, 0.0), HOUR: 12.0, "error_scale": 1.0}
    not_swept = frozenset(NOT_SWEPT)
    told: ClassVar = dict.fromkeys(("latitude", "mount_kind", "receiver_width", "receiver_height_extent"))
    longest = 24

    def __init__(self, result: xr.Dataset) -> None:
        super().__init__(result)
        self.day = next((dim for dim in DAYS if dim in result.sizes), DAYS[0])
        upright = "receiver_tilt" not in result.coords or not np.any(result["receiver_tilt"].to_numpy())
        #: Labels of the receiver's plane, of which only what stands upright has an up, and where it is seen from.
        self.plane = ("to the right (m)", "up (m)" if upright else "up along the face (m)")
        self.seen = "seen from the field" if upright else "seen from in front of the receiver"

    def label(self, dim: str) -> str:
        """Label of an axis; hours by what the days are told by."""
        if dim == HOUR:
            return "time of day (h)" if self.day == "date" else "solar time (h)"
        return super().label(dim)

    def heading(self, dim: str | None) -> str:
        """What distinguishes lines, above a legend."""
        return "solar hour" if dim == HOUR and self.day != "date" else super().heading(dim)

    def full(self, dim: str, index: int) -> str:
        """One value with what it is; heliostats by name and place."""
        return self.heliostat({dim: index}) if dim == HELIOSTAT else super().full(dim, index)

    def heliostat(self, point: Point) -> str:
        """A heliostat by its name and place; empty where the point has none."""
        result = self.result
        if HELIOSTAT not in point:
            return ""
        label = self.coordinate(HELIOSTAT).to_numpy()[point[HELIOSTAT]] if HELIOSTAT in result.coords else None
        name = label if isinstance(label, str) else f"heliostat {point[HELIOSTAT] if label is None else label}"
        named = next((key for key in ("name", "id") if key in result.coords and result[key].dtype.kind in "OU"), None)
        if named is not None:
            given = at(result[named], point)
            name = name if given.ndim else str(given.item())
        parts = [at(result[axis], point) for axis in "xyz" if axis in result.coords]
        if len(parts) == 3 and not any(part.ndim for part in parts):
            where = ", ".join(f"{round(float(part), 1) + 0.0:g}" for part in parts).replace("-", "\N{MINUS SIGN}")
            return f"{name}: ({where}) m"
        return name

    def heliostats(
        self, quantity: str, stands: Point, most: int = MOST_PANELS, worst: str = ""
    ) -> list[dict[str, int]]:
        """Heliostats that are shown: of those with values all of a few, of a field some from the tower outwards.

        With the name of a variable as `worst`, those with its largest values.
        """
        fixed = {dim: index for dim, index in stands.items() if dim not in (*DAYS, HOUR)}
        array = at(self.result[quantity], fixed)
        order = np.flatnonzero(array.notnull().any([dim for dim in array.dims if dim != HELIOSTAT]).to_numpy())
        if worst in self.result:
            value = at(self.result[worst], fixed).to_numpy()
            return [{HELIOSTAT: int(row)} for row in order[np.argsort(-value[order], kind="stable")][:most]]
        if order.size > most and {"x", "y"} <= set(self.result.coords):
            x, y = (at(self.result[name], stands) for name in "xy")
            if x.dims == y.dims == (HELIOSTAT,):
                far = np.hypot(x.to_numpy(), y.to_numpy())
                order = order[np.argsort(far[order], kind="stable")]
        return [{HELIOSTAT: int(order[index])} for index in evenly(order.size, most)] if order.size else []

    def axes(self, quantity: str) -> list[tuple[str, dict[str, int]]]:
        """Axes of the error by name, in the order of their looks; one without a place where it is not swept."""
        result = self.result
        if AXIS not in result[quantity].dims:
            single = AXIS in result.coords and not result[AXIS].ndim
            return [(str(result[AXIS].item()).replace("_", "-") if single else "", {})]
        known = {str(name).replace("_", "-"): {AXIS: i} for i, name in enumerate(self.coordinate(AXIS).to_numpy())}
        return sorted(known.items(), key=lambda item: list(AXES).index(item[0]) if item[0] in AXES else len(AXES))

    def of_heliostats(self, name: str, least: int = 1) -> bool:
        """Test whether there is a variable along the heliostats, of which there are so many at least."""
        return self.has(name) and HELIOSTAT in self.result[name].dims and self.result.sizes[HELIOSTAT] >= least

    def panels_of_axes(
        self, name: str, title: str, stands: Point, lines: Callable[[xr.DataArray], dict[str, xr.DataArray]]
    ) -> list[Panel]:
        """A panel for each axis of the error in which a line of a variable has a value."""
        from heliosweep.report.panels import Panel

        panels = []
        for axis, point in self.axes(name):
            drawn = lines(at(self.result[name], stands, point).compute())
            if any_known(list(drawn.values())):
                panels.append(Panel(title, drawn, f"{axis} axis" if point else ""))
        return panels

    def error(self) -> str | None:
        """Dimension of the size of an error."""
        dims = self.numbers("spot_y") if "spot_y" in self.result else []
        return next((dim for dim in ("error_size", *ERRORS) if dim in dims), None)

    def map(self, values: np.ndarray, stands: Point, title: str) -> FieldMap | None:
        """Map of one number of each heliostat; none where the result does not tell the places."""
        from heliosweep.report.pictures import field_map

        coords = [name for name in ("x", "y") if name in self.result.coords]
        here = self.result[coords].isel({dim: i for dim, i in stands.items() if dim in self.result[coords].dims})
        return field_map(here, values, title)

    def median_map(self, quantity: str, stands: Point, unit: str) -> FieldMap | None:
        """Map of a variable, titled with its median; none without a value or the places."""
        values = at(self.result[quantity], stands).to_numpy()
        finite = values[np.isfinite(values)]
        if not finite.size:
            return None
        return self.map(values, stands, f"median {number_text(float(np.median(finite)), 3)} {unit}")

    def parameter(self, index: int) -> str:
        """Name of an error of the mount."""
        if PARAMETER in self.result.coords:
            name = str(self.result[PARAMETER].to_numpy()[index])
        else:
            name = ERRORS[index] if index < len(ERRORS) else f"parameter {index + 1}"
        return name.replace("non_", "non-").replace("_", " ")

    def best(self, quantity: str, *shown: str | None) -> dict[str, int]:
        """The most days and the most parameters, where they are swept and not shown."""
        result = self.result
        dims = [dim for dim in ("days_used", "parameters") if dim in result[quantity].dims and dim in result.coords]
        return {dim: int(np.argmax(result[dim].to_numpy())) for dim in dims if dim not in shown}


def aperture(result: xr.Dataset, *points: Point) -> tuple[float, float] | None:
    """Width and height of the receiver's aperture at one point of the sweep. [m]"""
    sides = []
    for name in ("receiver_width", "receiver_height_extent"):
        side = at(result[name], *points) if name in result.coords else None
        if side is None or side.ndim or not 0 < side < np.inf:
            return None
        sides.append(float(side))
    return sides[0], sides[1]


def mean(array: xr.DataArray) -> xr.DataArray:
    """Mean over the heliostats that have a value."""
    return array.where(np.isfinite(array)).mean(HELIOSTAT)


def any_known(arrays: Sequence[xr.DataArray]) -> bool:
    """Whether any number is finite."""
    return any(bool(np.isfinite(array).any()) for array in arrays)


def rows_of(shown: Spots, dims: Sequence[str]) -> tuple[list[Point], str]:
    """At most so many points along dimensions, and the sentence that says of how many."""
    sizes = [shown.result.sizes[dim] for dim in dims]
    total = int(np.prod(sizes, dtype=np.int64))
    kept = evenly(total, MOST_ROWS) if total > MOST_ROWS else range(total)
    indices = [np.unravel_index(index, sizes) if dims else () for index in kept]
    points: list[Point] = [dict(zip(dims, map(int, index), strict=True)) for index in indices]
    few = len(points) < total
    return points, f" Shown are {len(points)} of {total:,} rows; all are in the data set." if few else ""


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Figures of a result, each drawn when it is asked for; values are read as they are needed."""
    curves, mount_errors, calibration, detectors = _modes()
    field = result.sizes.get(HELIOSTAT, 0) >= FIELD
    first = (*curves.TOLERANCES, *curves.SPOTS) if field else (*curves.SPOTS, *curves.TOLERANCES)
    shown = Spots(result)
    draws = (*detectors.FIGURES, *first, *mount_errors.FIGURES, *calibration.FIGURES)
    return one_by_one(draws, shown, MOST_FIGURES)


def _modes() -> list[Any]:
    """Modules with the figures of the modes, which import this one."""
    modes = ("curves", "mount_errors", "calibration", "detectors")
    return [import_module(f"{__package__}.{mode}.figures") for mode in modes]
