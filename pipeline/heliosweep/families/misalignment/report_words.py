"""How the figures of the family call what they show: titles, labels and the words of captions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.report_views import DAYS, HELIOSTAT, HOUR, Point, at, day_of
from heliosweep.report.labels import DEGREE, axis_label, is_latitude, title_of, value_text
from heliosweep.report.shapes import UP, Words

#: Dimensions in few words; titles of more letters are not for panels.
TITLES = {
    "day": "day",
    "declination": "declination",
    HOUR: "hour",
    "axis": "axis",
    "source": "source",
    "error_size": "error",
    "error_scale": "scale of the errors",
    "mount_kind": "mount",
    "days_used": "days used",
    "parameters": "parameters",
    "noise": "noise",
    "receiver_width": "aperture width",
    "receiver_height_extent": "height",
}
LONG = 24

#: What the hour is called on an axis.
HOURS = {"day": "solar time (h)", "declination": "solar time (h)", "date": "time of day (h)"}


def heliostat_text(result: xr.Dataset, point: Point) -> str:
    """A heliostat by its name and place."""
    if HELIOSTAT not in point:
        return ""
    index = point[HELIOSTAT]
    label = result[HELIOSTAT].to_numpy()[index] if HELIOSTAT in result.coords else index
    name = str(label) if isinstance(label, str) else f"heliostat {label}"
    if "name" in result.coords and result["name"].dtype.kind in "OU":
        given = at(result["name"], point)
        name = name if given.ndim else str(given.item())
    parts = [at(result[axis], point) for axis in "xyz" if axis in result.coords]
    if len(parts) == 3 and not any(part.ndim for part in parts):
        where = ", ".join(f"{round(float(part), 1) + 0.0:g}" for part in parts).replace("-", "\N{MINUS SIGN}")
        return f"{name}: ({where}) m"
    return name


def short(result: xr.Dataset, dim: str, index: int) -> str:
    """One value with its unit."""
    if dim not in result.coords:
        return f"{dim.replace('_', ' ')} {index + 1}"
    value = result[dim].isel({dim: index})
    if value.dtype.kind == "M":
        return str(value.to_numpy().astype("datetime64[D]"))
    return value_text(value).replace("_", " ")


def title(result: xr.Dataset, dim: str) -> str:
    """What a dimension is called in titles and captions, in few words."""
    if dim in TITLES:
        return TITLES[dim]
    words = title_of(result[dim]) if dim in result.coords else dim.replace("_", " ")
    return words if len(words) <= LONG else dim.replace("_", " ")


def full(result: xr.Dataset, dim: str, index: int) -> str:
    """One value with what it is."""
    if dim == HELIOSTAT:
        return heliostat_text(result, {dim: index})
    if dim not in result.coords or result[dim].dtype.kind == "M" or dim == "site":
        return short(result, dim, index)
    return f"{title(result, dim)} {short(result, dim, index)}"


def note(result: xr.Dataset, stands: Point, *shown: tuple[str | None, Sequence[Point]]) -> str:
    """Sentences for a caption: which of many values are shown, and where the rest stands."""
    parts = [
        f"{len(points)} of {result.sizes[dim]} {plural(result, dim)}"
        for dim, points in shown
        if dim and dim in result.sizes and len(points) < result.sizes[dim]
    ]
    said = [f"Shown are {' and '.join(parts)}."] if parts else []
    held = [
        full(result, dim, index) + (f" (one of {result.sizes[dim]})" if result.sizes[dim] > 1 else "")
        for dim, index in stands.items()
        if result.sizes[dim] > 1 or dim in result.coords
    ]
    for name in ("latitude", "mount_kind", "receiver_width", "receiver_height_extent"):
        if name in result.coords and not result[name].ndim:
            value = value_text(result[name]).replace("_", "-")
            held.append(f"{TITLES.get(name, name)} {value}")
    said += [f"Fixed: {', '.join(held)}."] if held else []
    return "".join(f" {sentence}" for sentence in said)


def plural(result: xr.Dataset, dim: str) -> str:
    """What several values of a dimension are called."""
    if dim in (HELIOSTAT, HOUR, *DAYS):
        return f"{dim}s"
    return f"values of {title(result, dim)}"


def label(result: xr.Dataset, dim: str) -> str:
    """Label of an axis, always with a unit."""
    if dim == HOUR:
        return HOURS[day_of(result)]
    if is_latitude(result[dim]):
        return f"{title_of(result[dim])} ({DEGREE})"
    words = axis_label(result[dim])
    return words if words.endswith(")") else f"{words} (1)"


def heading(result: xr.Dataset, dim: str | None) -> str:
    """What distinguishes lines, above a legend; empty for words."""
    if dim is None or dim not in result.coords or result[dim].dtype.kind not in "fiu":
        return ""
    return "solar hour" if dim == HOUR and day_of(result) != "date" else title(result, dim)


def hour_step(result: xr.Dataset) -> float | None:
    """Distance of ticks along the hours. [h]"""
    span = float(np.ptp(result[HOUR].to_numpy()))
    return next((step for step in (0.25, 0.5, 1.0, 2.0, 3.0) if span <= 8 * step), 4.0) if span else None


def around(result: xr.Dataset, legend: str = "", silent: Sequence[str] = ()) -> Words:
    """Labels of a receiver plane; only what stands upright has an up."""
    return Words(y=UP if _upright(result) else "up along the face (m)", legend=legend, silent=silent)


def seen(result: xr.Dataset) -> str:
    """Where a receiver plane is seen from."""
    return "seen from the field" if _upright(result) else "seen from in front of the receiver"


def _upright(result: xr.Dataset) -> bool:
    return "receiver_tilt" not in result.coords or not np.any(result["receiver_tilt"].to_numpy())
