"""Figures of the mode `detectors`: crossings on the receiver's plane, and what each round of the closed loop leaves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.figures import FIELD, HELIOSTAT, HOUR, MOST_PANELS, Spots, aperture
from heliosweep.report.contents import NamedFigure
from heliosweep.report.panels import Panel, curve_figure
from heliosweep.report.pictures import Shades, from_zero, picture_figure, symbols
from heliosweep.report.selection import at
from heliosweep.report.tracks import Look, Plane, Track, origin, plane_figure

#: How far lines without ends are drawn. [m]
FAR = 1e3

_ARRAY: Look = {"color": "#999999", "linewidth": 1.2}
_CROSSINGS: dict[str, Look] = {
    trace: {"color": "#333333", "linestyle": "", "marker": marker, "markersize": 4}
    for trace, marker in (("elevation", "o"), ("azimuth", "s"))
}
_LEFT = ("beam_error_rms", "spot_distance_rms")


def crossings(shown: Spots) -> Iterator[NamedFigure]:
    """Where the traces of some heliostats cross the arrays, a point for each hour."""
    result, name = shown.result, "crossing_y"
    if not shown.of_heliostats(name) or "trace" not in result[name].dims or "detectors" not in result.attrs:
        return
    inner = ("trace", "detector", "crossing")
    stands = shown.fixed(name, HELIOSTAT, HOUR, *inner)
    planes: list[Plane] = []
    hours = result[HOUR] if HOUR in result.coords else xr.DataArray(np.arange(result.sizes[HOUR]), dims=HOUR)
    heliostats = shown.heliostats(name, stands, MOST_PANELS)
    for one in heliostats:
        tracks = [origin("aim"), *_arrays(result)]
        for index, trace in enumerate(result["trace"].to_numpy().astype(str)):
            found = at(result[name], stands, one, {"trace": index})
            y, z = (at(result[f"crossing_{side}"], stands, one, {"trace": index}).to_numpy().ravel() for side in "yz")
            numbers = hours.broadcast_like(found).transpose(*found.dims).to_numpy().ravel().astype(float)
            tracks.append(Track(y, z, _CROSSINGS[trace], f"{trace} trace", numbers=numbers))
        planes.append(Plane(shown.heliostat({**stands, **one}), tracks, (), aperture(result, stands)))
    if not planes:
        return
    scale = Shades(shown.label(HOUR), float(hours.min()), float(hours.max())) if shown.several(HOUR) else None
    whose = "of aligned heliostats" if result.attrs.get("crossings") == "measured" else "before any correction"
    caption = (
        f"Where the traces {whose} cross the arrays of detectors (grey), coloured by the hour: circles, the trace of "
        f"the cylinder along the elevation axis; squares, of the other; {shown.seen}.{shown.note(stands, heliostats)}"
    )
    yield NamedFigure("crossings", caption, plane_figure(planes, shown.plane, scale=scale))


def closed_loop(shown: Spots) -> Iterator[NamedFigure]:
    """What is left after each round: median, 95 % point and largest of the heliostats and draws."""
    result, name = shown.result, _LEFT[0]
    if not shown.has(*_LEFT) or "round" not in result[name].dims:
        return
    line = next((dim for dim in ("correction", *shown.numbers(name, "round", "sample")) if shown.several(dim)), None)
    stands = shown.fixed(name, "round", HELIOSTAT, "sample", line)
    panels = []
    for quantity, title in zip(_LEFT, ("beam off the aim (mrad, rms)", "spot off the aim (m, rms)"), strict=True):
        lines: dict[str, xr.DataArray] = {}
        for one in shown.chosen(line, 3):
            values = at(result[quantity], stands, one).compute()
            many = [dim for dim in values.dims if dim != "round"]
            known = values.notnull().any(many)
            values = values.where(known, 0.0)
            word = f"{shown.values(one)}: " if one else ""
            parts = (
                {"median": 0.5, "95 % point": 0.95, "largest": 1.0}
                if values.size > 3 * values.sizes["round"]
                else {"median": 0.5}
            )
            lines |= {f"{word}{part}": values.quantile(share, many).where(known) for part, share in parts.items()}
        panels.append(Panel(title, lines))
    if not any(bool((line > 0).any()) for panel in panels for line in panel.lines.values()):
        return
    caption = (
        "What is left after each round of the closed loop, over all instants; round 0 is before any correction; over "
        f"the heliostats and draws.{shown.note(stands)}"
    )
    yield NamedFigure("closed_loop", caption, curve_figure(panels, "rounds done", logarithmic_values=True))


def loop_map(shown: Spots) -> Iterator[NamedFigure]:
    """What the last round leaves of each heliostat of a field."""
    result, name = shown.result, _LEFT[0]
    if not shown.of_heliostats(name, FIELD) or "round" not in result[name].dims:
        return
    stands = {**shown.fixed(name, HELIOSTAT, "round"), "round": result.sizes["round"] - 1}
    one = shown.median_map(name, stands, "mrad")
    if one is None:
        return
    caption = (
        "Root mean square angle between the beam of each heliostat and the way to the aim point, after the last round. "
        f"{symbols([one])}{shown.note({dim: i for dim, i in stands.items() if dim != 'round'})}"
    )
    yield NamedFigure(
        "loop_map", caption, picture_figure([one], from_zero("beam off the aim (mrad)", [one.values], 1e-3, held=0.98))
    )


def _arrays(result: xr.Dataset) -> Iterator[Track]:
    """The arrays, from the attribute that describes their straight pieces."""
    for piece in str(result.attrs["detectors"]).split("; "):
        y, z, across, up, length = map(float, piece.partition(": ")[2].split())
        ends = np.array([0.0, length]) if np.isfinite(length) else np.array([-FAR, FAR])
        yield Track(y + ends * across, z + ends * up, _ARRAY, "array of detectors", framed=bool(np.isfinite(length)))


FIGURES = (crossings, closed_loop, loop_map)
