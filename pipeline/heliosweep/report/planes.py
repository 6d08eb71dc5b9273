"""Panels with the same metre along both axes: curves, points and ellipses on a plane, its aperture drawn."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse as EllipsePatch
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator

from heliosweep.report.endings import write_texts
from heliosweep.report.frames import Ends, beyond, common, span
from heliosweep.report.shapes import Look, Plane, Scale, Words
from heliosweep.report.style import PAGE_WIDTH, new_figure, styled

#: Panels beside each other.
COLUMNS = 3

#: Largest panels over smallest up to which all have one scale.
SIMILAR = 1.6

#: More points than this have no edges.
CROWD = 20

#: Name of the aperture in the legend.
APERTURE = "aperture"

_LEFT, _RIGHT, _FOOT, _BAR, _GAP, _OWN_GAP, _BETWEEN = 0.55, 0.1, 0.45, 0.52, 0.1, 0.45, 0.28
_WIDEST = {1: 4.0, 2: 3.1}
_LETTER, _DIGIT, _SHORT = 0.068, 0.06, 4
_APERTURE_LOOK: dict[str, Any] = {"facecolor": "#ededed", "edgecolor": "#333333", "linewidth": 0.9}


def frames(planes: Sequence[Plane]) -> list[Ends]:
    """Ends of the axes of each panel: the same for all where their sizes are similar.

    Parameters
    ----------
    planes : sequence of Plane
        In reading order.

    Returns
    -------
    list of ((left, right), (bottom, top))
        Squares. [m]
    """
    ends = [span(plane.points(), plane.aperture, plane.square) for plane in planes]
    together = [end for end, plane in zip(ends, planes, strict=True) if plane.square and not plane.alone]
    if together:
        sizes = [end[0][1] - end[0][0] for end in together]
        if max(sizes) <= SIMILAR * min(sizes):
            one = common(together)
            ends = [one if plane.square and not plane.alone else end for end, plane in zip(ends, planes, strict=True)]
    return ends


def cut(planes: Sequence[Plane]) -> int:
    """How many points of tracks lie outside of the panels."""
    bare = [Plane("", [replace(track, half=None) for track in plane.tracks]) for plane in planes]
    return sum(beyond(plane.points(), ends) for plane, ends in zip(bare, frames(planes), strict=True))


@styled
def plane_figure(
    planes: Sequence[Plane],
    looks: Mapping[str, Look],
    *,
    words: Words | None = None,
    scale: Scale | None = None,
    columns: int = COLUMNS,
) -> Figure:
    """Draw panels in rows, the legend above, the scale of the colours below.

    Parameters
    ----------
    planes : sequence of Plane
        In reading order.
    looks : mapping of str to Look
        By the names of tracks and ellipses, in the order of the legend.
    words : Words, optional
        Labels; those of a receiver plane where left out.
    scale : Scale, optional
        What the numbers are that colour points; without it, points have the colour of their look.
    columns : int
        Panels beside each other at most.

    Returns
    -------
    matplotlib.figure.Figure
    """
    words = words or Words()
    columns = 2 if len(planes) == 4 else min(columns, len(planes))
    rows = -(-len(planes) // columns)
    ends = frames(planes)
    shared = len(set(ends)) == 1
    gap, between = (_GAP, _BETWEEN) if shared else (_OWN_GAP, _BETWEEN + 0.15)
    room = max(map(_room, ends))
    start, gap = _LEFT + room, gap + (0.0 if shared else room)
    side = (PAGE_WIDTH - start - _RIGHT - gap * (columns - 1)) / columns
    side = min(side, _WIDEST.get(max(rows, columns), side))
    width = start + columns * side + (columns - 1) * gap + _RIGHT
    handles = _handles(planes, looks, words.silent)
    width = max(width, min(PAGE_WIDTH, 0.3 + _LETTER * max(map(len, [*handles, words.legend]), default=0)))
    abreast = _abreast(list(handles), width)
    lines = -(-len(handles) // abreast) + bool(words.legend)
    titles = max(1 + plane.title.count("\n") if plane.title else 0 for plane in planes)
    head = 0.08 + 0.165 * lines + (0.06 if lines else 0) + 0.14 * titles
    between += 0.14 * (titles - 1)
    foot = _FOOT + (_BAR if scale else 0.0)
    height = head + rows * side + (rows - 1) * between + foot
    figure = new_figure(width, height)
    for index, (plane, end) in enumerate(zip(planes, ends, strict=True)):
        i, j = divmod(index, columns)
        left, bottom = start + j * (side + gap), foot + (rows - 1 - i) * (side + between)
        axes = figure.add_axes((left / width, bottom / height, side / width, side / height))
        axes.set(xlim=end[0], ylim=end[1])
        axes.set_title(plane.title, pad=3)
        _label_sides(
            axes, left=j == 0 or not shared, bottom=index + columns >= len(planes) or not shared, own=not shared
        )
        if j == 0:
            axes.set_ylabel(words.y, labelpad=1)
        if index + columns >= len(planes):
            axes.set_xlabel(words.x, labelpad=2)
        _draw(axes, plane, looks, scale, 72 * side)
    if scale:
        bar = figure.add_axes((0.2, 0.38 / height, 0.6, 0.1 / height))
        mappable = ScalarMappable(scale.norm, scale.palette)
        figure.colorbar(mappable, cax=bar, orientation="horizontal").outline.set_linewidth(0.5)
        bar.set_xlabel(scale.label, labelpad=2)
        bar.xaxis.set_major_locator(MaxNLocator(9, steps=[1, 2, 3, 5, 10]))
    if handles:
        figure.legend(
            list(handles.values()),
            list(handles),
            loc="upper center",
            ncols=abreast,
            borderaxespad=0.3,
            title=words.legend or None,
        )
    return figure


def _abreast(names: Sequence[str], width: float) -> int:
    """Names beside each other in the legend, in rows that are as even as can be."""
    if not names:
        return 1
    fit = max(1, int(width / (0.5 + _LETTER * max(map(len, names)))))
    return -(-len(names) // -(-len(names) // fit))


def _handles(planes: Sequence[Plane], looks: Mapping[str, Look], silent: Sequence[str]) -> dict[str, Line2D | Patch]:
    """Legend: every look that is used, and the aperture."""
    outlined = {one.name for plane in planes for one in plane.ellipses}
    used = {track.name for plane in planes for track in plane.tracks} | outlined
    handles: dict[str, Line2D | Patch] = {
        name: Line2D([], [], **_style(look)) for name, look in looks.items() if name in used and name not in silent
    }
    if any(plane.aperture for plane in planes):
        handles[APERTURE] = Patch(**_APERTURE_LOOK)
    return handles


def _style(look: Look) -> dict[str, Any]:
    filled = {"markerfacecolor": "none"} if look.open else {}
    thin = look.open or look.marker in "+x"
    return {
        "color": look.colour,
        "linestyle": look.line or "none",
        "linewidth": look.width,
        "marker": look.marker,
        "markersize": look.size,
        "markeredgewidth": 0.8 if thin else 0.0,
        **filled,
    }


def _label_sides(axes: Axes, left: bool, bottom: bool, own: bool) -> None:
    """Round numbers; away from the corners, where those of the next panel would touch."""
    axes.grid(True)
    for axis, ends in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        axis.set_ticks(_ticks(ends, 0.02 if own else 0.06))
    axes.tick_params(labelbottom=bottom, labelleft=left)


def _ticks(ends: tuple[float, float], rim: float) -> np.ndarray:
    """At least four ticks, or three or two where their numbers are long."""
    low, high = ends
    margin = rim * (high - low)
    for most in range(3, 10):
        ticks = np.asarray(MaxNLocator(most, steps=[1, 2, 5, 10]).tick_values(low, high))
        ticks = ticks[(ticks > low + margin) & (ticks < high - margin)]
        if ticks.size >= max(2, min(4, 8 - _digits(ticks))):
            break
    return ticks


def _digits(ticks: np.ndarray) -> int:
    """Letters of the longest number beside ticks."""
    step = float(np.diff(ticks).min()) if ticks.size > 1 else 1.0
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    return max((len(f"{tick:.{decimals}f}") for tick in ticks), default=0)


def _room(ends: Ends) -> float:
    """Room that the ticks of the vertical axis need beyond that of short ones. [inch]"""
    return _DIGIT * max(0, _digits(_ticks(ends[1], 0.02)) - _SHORT)


def _draw(axes: Axes, plane: Plane, looks: Mapping[str, Look], scale: Scale | None, points: float) -> None:
    """All of one panel, whose side is so many `points` long."""
    if plane.aperture:
        wide, high = plane.aperture
        axes.add_patch(Rectangle((-wide / 2, -high / 2), wide, high, zorder=0.6, **_APERTURE_LOOK))
    for track in plane.tracks:
        look = looks[track.name]
        if track.half is not None:
            axes.errorbar(
                track.x, track.y, track.half, fmt="none", ecolor=look.colour, elinewidth=0.6, capsize=1.2, alpha=0.7
            )
        if track.numbers is None or scale is None:
            axes.plot(track.x, track.y, **_style(look))
            continue
        if look.line:
            axes.plot(track.x, track.y, color=look.colour, linestyle=look.line, linewidth=look.width)
        dots: dict[str, Any] = {
            "cmap": scale.palette,
            "norm": scale.norm,
            "linewidths": 0.3 if track.x.size <= CROWD else 0.0,
            "edgecolors": "#444444",
        }
        seen = np.isfinite(track.x) & np.isfinite(track.y)
        axes.scatter(
            track.x[seen], track.y[seen], look.size**2, track.numbers[seen], marker=look.marker or "o", zorder=3, **dots
        )
    for one in plane.ellipses:
        if one.known:
            long, short, angle = one.axes()
            look = looks[one.name]
            colour = look.colour if one.number is None or scale is None else scale.palette(scale.norm(one.number))
            shape = {"facecolor": "none", "edgecolor": colour, "linewidth": look.width, "linestyle": look.line or "-"}
            axes.add_patch(EllipsePatch((one.x, one.y), long, short, angle=angle, zorder=2.5, **shape))
    write_texts(axes, plane, looks, points)
