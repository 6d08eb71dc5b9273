"""Planes with tracks: curves, points and ellipses with the same metre along both axes, the aperture drawn."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse as EllipsePatch
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from heliosweep.report.layout import abreast, colour_bar, fit, label_outside, legend, sheet
from heliosweep.report.pictures import Shades
from heliosweep.report.style import styled

#: Panels beside each other.
COLUMNS = 3

#: Largest panels over smallest up to which all have one scale.
SIMILAR = 1.6

#: Points farther from the origin than so many times the median, the 90 % point, and the aperture's half diagonal are
#: not framed.
FAR, FAR_90 = 8.0, 3.0

#: Empty rim, as a part of the side; least side. [m]
RIM, LEAST = 0.07, 1e-6

#: Name of the aperture in the legend.
APERTURE = "aperture"

#: Part of a normal distribution inside of an ellipse.
INSIDE = 0.95

#: Ends of both axes. [m]
Ends = tuple[tuple[float, float], tuple[float, float]]
Look = Mapping[str, Any]

_FACE: dict[str, Any] = {"facecolor": "#ededed", "edgecolor": "#333333", "linewidth": 0.9}
_AIM: Look = {"color": "black", "linestyle": "", "marker": "+", "markersize": 6, "markeredgewidth": 0.8}


@dataclass(frozen=True)
class Track:
    """Points in their order.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Where they are; a missing one interrupts the line. [m]
    look : mapping
        Properties of the line as matplotlib's.
    name : str
        In the legend, if any; the same name has the same look.
    numbers : ndarray, shape (n,), optional
        What colours the points, by the figure's scale.
    text : str
        Beside the last point that is seen.
    half : ndarray, shape (n,), optional
        Half-length of error bars along y.
    framed : bool
        Whether the panel is made large enough for it.
    """

    x: np.ndarray
    y: np.ndarray
    look: Look
    name: str = ""
    numbers: np.ndarray | None = None
    text: str = ""
    half: np.ndarray | None = None
    framed: bool = True

    def points(self) -> np.ndarray:
        """Points that are known, shape (n, 2)."""
        points = np.stack([self.x, self.y], axis=-1).astype(float)
        return points[np.isfinite(points).all(axis=1)]


def origin(name: str) -> Track:
    """Cross at the origin, such as the aim."""
    return Track(np.zeros(1), np.zeros(1), _AIM, name)


@dataclass(frozen=True)
class Ellipse:
    """Region that holds 95 % of a normal distribution.

    Parameters
    ----------
    x, y : float
        Mean. [m]
    covariance : ndarray, shape (2, 2)
        Of x and y. [m2]
    look : mapping
        Properties of the line as matplotlib's.
    name : str
        In the legend, if any.
    number : float, optional
        What colours it, by the figure's scale.
    """

    x: float
    y: float
    covariance: np.ndarray
    look: Look
    name: str = ""
    number: float | None = None

    @property
    def known(self) -> bool:
        """Whether nothing of it is missing."""
        return bool(np.isfinite([self.x, self.y, *np.ravel(self.covariance)]).all())

    def reach(self) -> np.ndarray:
        """How far it goes from its centre along x and y, shape (2,). [m]"""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0) * -2.0 * math.log1p(-INSIDE)))

    def patch(self, look: Look) -> EllipsePatch:
        """Patch of the region's edge."""
        values, vectors = np.linalg.eigh(self.covariance)
        short, long = 2 * np.sqrt(np.maximum(values, 0.0) * -2.0 * math.log1p(-INSIDE))
        angle = math.degrees(math.atan2(vectors[1, 1], vectors[0, 1]))
        shape: Any = {"facecolor": "none", "zorder": 2.5, "edgecolor": look["color"]}
        lines: Any = {key: look[key] for key in ("linewidth", "linestyle") if key in look}
        return EllipsePatch((self.x, self.y), long, short, angle=angle, **shape, **lines)


@dataclass(frozen=True)
class Plane:
    """One panel.

    Parameters
    ----------
    title : str
        Above it.
    tracks : sequence of Track
        From bottom to top.
    ellipses : sequence of Ellipse
        Above the tracks; one that misses a number is left out.
    aperture : tuple of float, optional
        Width and height of the rectangle about the origin. [m]
    alone : bool
        Whether it has a frame of its own whatever the others are like.
    square : bool
        Whether a metre is as long along both axes; else it has a frame of its own.
    """

    title: str
    tracks: Sequence[Track]
    ellipses: Sequence[Ellipse] = ()
    aperture: tuple[float, float] | None = None
    alone: bool = False
    square: bool = True

    def points(self) -> np.ndarray:
        """Everything that the frame is made for, shape (n, 2). [m]"""
        pieces = [np.empty((0, 2)), *(track.points() for track in self.tracks if track.framed)]
        for track in self.tracks:
            if track.framed and track.half is not None:
                ends = [np.stack([track.x, track.y + sign * track.half], axis=-1) for sign in (-1, 1)]
                pieces += [end[np.isfinite(end).all(axis=1)] for end in ends]
        for one in self.ellipses:
            if one.known:
                corners = one.reach() * [(-1, -1), (1, -1), (1, 1), (-1, 1)]
                pieces.append(np.array([one.x, one.y]) + corners)
        return np.concatenate(pieces)

    def ends(self) -> Ends:
        """Frame with a rim about all points but single far ones."""
        points, corner = self.points(), np.array(self.aperture or (0.0, 0.0)) / 2
        far = np.hypot(*points.T)
        middle, most = np.quantile(far, [0.5, 0.9]) if far.size else (0.0, 0.0)
        near = points[far <= max(FAR * float(np.hypot(*corner)), FAR * float(middle), FAR_90 * float(most))]
        kept = np.concatenate([near, [-corner, corner]]) if self.aperture else near
        if not kept.size:
            kept = np.array([[-1.0, -1.0], [1.0, 1.0]])
        return _frame(kept.min(axis=0), kept.max(axis=0), RIM, self.square)


def _frame(low: np.ndarray, high: np.ndarray, rim: float, square: bool) -> Ends:
    middle = (low + high) / 2
    least = np.maximum(LEAST, 1e-3 * (np.abs(middle).max() if square else np.abs(middle)))
    sides = np.maximum(high - low, least)
    half = (np.full(2, sides.max()) if square else sides) / 2 * (1 + 2 * rim)
    (left, bottom), (right, top) = middle - half, middle + half
    return (float(left), float(right)), (float(bottom), float(top))


def frames(planes: Sequence[Plane]) -> list[Ends]:
    """Ends of the axes of each panel: the same for all where their sizes are similar. [m]

    They are squares, but for panels that need not be.
    """
    ends = [plane.ends() for plane in planes]
    alike = [index for index, plane in enumerate(planes) if plane.square and not plane.alone]
    sizes = [ends[index][0][1] - ends[index][0][0] for index in alike]
    if alike and max(sizes) <= SIMILAR * min(sizes):
        corners = np.array([ends[index] for index in alike])
        one = _frame(corners[:, :, 0].min(axis=0), corners[:, :, 1].max(axis=0), 0.0, True)
        for index in alike:
            ends[index] = one
    return ends


def cut(planes: Sequence[Plane]) -> int:
    """Count the points of tracks that lie outside of the panels."""
    return sum(
        int(((points < [left, bottom]) | (points > [right, top])).any(axis=1).sum())
        for plane, ((left, right), (bottom, top)) in zip(planes, frames(planes), strict=True)
        for points in (track.points() for track in plane.tracks if track.framed)
    )


@styled
def plane_figure(
    planes: Sequence[Plane],
    labels: tuple[str, str],
    *,
    scale: Shades | None = None,
    columns: int = COLUMNS,
    legend_title: str = "",
    entries: Mapping[str, Look] | None = None,
) -> Figure:
    """Draw panels in rows, the legend above, the scale of the colours below.

    Parameters
    ----------
    planes : sequence of Plane
        In reading order.
    labels : (str, str)
        Of the axes, with the unit.
    scale : Shades, optional
        What the numbers are that colour points; without it, points have the colour of their look.
    columns : int
        Panels beside each other at most.
    legend_title : str
        What the names of the tracks are.
    entries : mapping of str to look, optional
        Further lines of the legend.

    Returns
    -------
    matplotlib.figure.Figure
    """
    columns = abreast(len(planes), 2 if len(planes) == 4 else columns)
    ends = frames(planes)
    figure, grid = sheet(len(planes), columns)
    for axes, plane, (x, y) in zip(grid, planes, ends, strict=True):
        axes.set(title=plane.title, xlim=x, ylim=y)
        axes.grid(True)
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(6 if columns < 3 else 5, steps=[1, 2, 5, 10], min_n_ticks=3))
        _draw(axes, plane, scale)
    label_outside(grid, columns, labels[0], [labels[1]] * len(grid))
    if len(set(ends)) > 1:
        for axes in grid:
            axes.tick_params(labelleft=True, labelbottom=True)
    if scale:
        colour_bar(figure, ScalarMappable(scale.norm, _bright(scale)), grid, scale.label, "neither")
    named: dict[str, Artist] = {}
    for plane in planes:
        shapes: list[Track | Ellipse] = [*plane.tracks, *plane.ellipses]
        for one in shapes:
            if one.name:
                named.setdefault(one.name, Line2D([], [], **one.look))
    named |= {name: Line2D([], [], **look) for name, look in (entries or {}).items()}
    if any(plane.aperture for plane in planes):
        named[APERTURE] = Patch(**_FACE)
    legend(figure, named, legend_title)
    fit(figure, 1.0)
    for axes in grid:
        _part_ticks(axes)
    for axes, plane in zip(grid, planes, strict=True):
        _write_texts(axes, plane.tracks)
    return figure


def _part_ticks(axes: Axes) -> None:
    """Leave out ticks along x where their numbers would touch each other."""
    boxes = [label.get_window_extent() for label in axes.get_xticklabels() if label.get_text()]
    if sum(box.width for box in boxes) > 0.8 * axes.get_window_extent().width:
        axes.xaxis.set_major_locator(MaxNLocator(2, steps=[1, 2, 5, 10]))


def _bright(scale: Shades) -> Colormap:
    """Colours without the palest ones, which points and lines on white would not show."""
    return ListedColormap(colormaps[scale.palette](np.linspace(0.0, 0.93, 256)))


def _draw(axes: Axes, plane: Plane, scale: Shades | None) -> None:
    """All of one panel but its texts."""
    if plane.aperture:
        wide, high = plane.aperture
        axes.add_patch(Rectangle((-wide / 2, -high / 2), wide, high, zorder=0.6, **_FACE))
    for track in plane.tracks:
        if track.half is not None:
            bars: Any = {"fmt": "none", "ecolor": track.look["color"], "elinewidth": 0.6, "capsize": 1.2, "alpha": 0.7}
            axes.errorbar(track.x, track.y, track.half, **bars)
        if track.numbers is None or scale is None:
            axes.plot(track.x, track.y, **track.look)
            continue
        axes.plot(track.x, track.y, **{**track.look, "marker": ""})
        seen = np.isfinite(track.x) & np.isfinite(track.y)
        dots: Any = {"cmap": _bright(scale), "norm": scale.norm, "marker": track.look.get("marker", "o"), "zorder": 3}
        size = track.look.get("markersize", 3.2) ** 2
        axes.scatter(track.x[seen], track.y[seen], size, track.numbers[seen], linewidths=0, **dots)
    for one in plane.ellipses:
        if one.known:
            look = dict(one.look)
            if one.number is not None and scale is not None:
                look["color"] = _bright(scale)(scale.norm(one.number))
            axes.add_patch(one.patch(look))


def _write_texts(axes: Axes, tracks: Iterable[Track]) -> None:
    """Write the texts at the ends of tracks: onwards from the last point, or beside it, where none is written yet."""
    taken: list[Any] = []
    frame = axes.get_window_extent()
    for track in tracks:
        pixels = axes.transData.transform(track.points())
        pixels = pixels[[frame.contains(*one) for one in pixels]]
        if not track.text or not len(pixels):
            continue
        way = pixels[-1] - pixels[max(-2, -len(pixels))]
        onward = math.atan2(way[1], way[0])
        for turn in (0.0, 0.7, -0.7, 1.4, -1.4, 2.1, -2.1, math.pi):
            shift = 9 * math.cos(onward + turn), 7 * math.sin(onward + turn)
            text = axes.annotate(
                track.text,
                tuple(axes.transData.inverted().transform(pixels[-1])),
                shift,
                textcoords="offset points",
                ha="center",
                va="center_baseline",
                fontsize=6.5,
                color=track.look["color"],
                path_effects=[withStroke(linewidth=1.8, foreground="white")],
                zorder=4,
            )
            box = text.get_window_extent()
            if frame.contains(*box.min) and frame.contains(*box.max) and not box.count_overlaps(taken):
                taken.append(box)
                break
            text.remove()
