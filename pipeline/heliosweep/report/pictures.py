"""Pictures: maps of a heliostat field, rasters on a mirror, and grids over two swept numbers, coloured by a value."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Polygon, Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from heliosweep.report.colours import DIFFERENCES, NO_VALUE, VALUES
from heliosweep.report.ground import rings, rises
from heliosweep.report.labels import MINUS, is_signed
from heliosweep.report.layout import abreast, colour_bar, fit, label_outside, legend, sheet, tick
from heliosweep.report.style import styled

#: Pictures beside each other in one figure.
COLUMNS = 3

#: A mirror is drawn at least so large, as a part of the map's larger side, or it would vanish.
SMALLEST = 1 / 250

#: Side of a mirror whose size is not known over the root of the land that each has.
PACKING = 0.55

#: Height over width that the frame of a picture may have; longer things get empty room around them.
_ASPECTS = (0.4, 1.6)

#: More mirrors than this have no edges, which would darken all.
_CROWD = 3000

#: Part of the values that a colour scale holds; single wild ones have the colour of its end.
HELD = 0.995

#: How the edges of areas are drawn.
_AREAS: dict[str, dict[str, Any]] = {
    "boundary": {"facecolor": "none", "edgecolor": "#222222", "linewidth": 0.9, "linestyle": (0, (5, 2))},
    "no heliostats": {"facecolor": "none", "edgecolor": "#888888", "linewidth": 0.7, "hatch": "////"},
}
_OUTLINE: dict[str, Any] = {"facecolor": "none", "edgecolor": "#333333", "linewidth": 0.5}
Ends = tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class Shades:
    """Colours that follow a number.

    Parameters
    ----------
    label : str
        Of the colour bar, with the unit.
    low, high : float
        Ends; values beyond have the colour of the end.
    palette : str
        Name of the colour map.
    """

    label: str
    low: float
    high: float
    palette: str = VALUES

    @property
    def norm(self) -> Normalize:
        """From numbers to colours; a single number has the middle one."""
        return Normalize(self.low, self.high) if self.high > self.low else Normalize(self.low - 1, self.high + 1)

    @property
    def colours(self) -> Colormap:
        """Colour map, with grey for what has no value."""
        return colormaps[self.palette].with_extremes(bad=NO_VALUE)

    def beyond(self, maps: Sequence[np.ndarray]) -> str:
        """Ends beyond which there are values, as a colour bar tells them."""
        values, slack = _known(maps), 1e-9 * (self.high - self.low)
        below, above = bool((values < self.low - slack).any()), bool((values > self.high + slack).any())
        return {(True, True): "both", (True, False): "min", (False, True): "max"}.get((below, above), "neither")


@dataclass(frozen=True)
class Kinds:
    """Colours that stand for words.

    Parameters
    ----------
    looks : mapping of int to (word, colour)
        By the value; all other values are grey.
    """

    looks: Mapping[int, tuple[str, str]]

    @property
    def norm(self) -> Normalize:
        """From values to colours."""
        values = sorted(self.looks)
        return BoundaryNorm([values[0] - 0.5, *(value + 0.5 for value in values)], len(values))

    @property
    def colours(self) -> Colormap:
        """Colour map, with grey for what has no value."""
        return ListedColormap([self.looks[value][1] for value in sorted(self.looks)]).with_extremes(bad=NO_VALUE)


def about_zero(label: str, maps: Sequence[np.ndarray], least: float = 1e-12, held: float = HELD) -> Shades:
    """Scale that is symmetric about zero, for slopes and differences."""
    end = from_zero(label, [np.abs(one) for one in maps], least, held).high
    return Shades(label, -end, end, DIFFERENCES)


def from_zero(label: str, maps: Sequence[np.ndarray], least: float = 1e-12, held: float = HELD) -> Shades:
    """Scale from zero to what a part of the values does not exceed, rounded up to a quarter of its decade at most."""
    values = _known(maps)
    end = max(float(np.quantile(values, held)) if values.size else 1.0, least)
    step = 10.0 ** math.floor(math.log10(end)) / 4
    return Shades(label, 0.0, math.ceil(end / step - 1e-6) * step)


def within(label: str, maps: Sequence[np.ndarray], palette: str = VALUES, held: float = HELD) -> Shades:
    """Scale from the least to the largest value but single wild ones, rounded outwards; about zero if signs differ."""
    values = _known(maps)
    if not values.size:
        return Shades(label, 0.0, 1.0, palette)
    low, high = (float(end) for end in np.quantile(values, [1 - held, held]))
    if palette == VALUES and is_signed(low, high):
        return about_zero(label, maps, held=held)
    lacking = max(0.01 * max(abs(low), abs(high)), 1e-12) - (high - low)
    if lacking > 0:  # all nearly the same
        low, high = low - lacking / 2, high + lacking / 2
    step = 10.0 ** math.floor(math.log10(high - low)) / 2
    return Shades(label, math.floor(low / step + 1e-6) * step, math.ceil(high / step - 1e-6) * step, palette)


def _known(maps: Sequence[np.ndarray]) -> np.ndarray:
    """All values of some maps."""
    return np.concatenate([one[np.isfinite(one)] for one in maps] or [np.empty(0)])


@dataclass(frozen=True)
class FieldMap:
    """Every mirror of a field in its place.

    Parameters
    ----------
    title : str
        Above the map; may have two lines.
    x, y : ndarray, shape (n,)
        Places of the mirrors east and north of the tower; NaN is left out. [m]
    width, height : ndarray, shape (n,)
        Sides of the mirrors. [m]
    values : ndarray, shape (n,)
        What is shown; NaN is grey.
    z : ndarray, shape (n,), optional
        Height of the ground at the mirrors, of which lines are drawn where it is not level. [m]
    areas : mapping of str to sequence of ndarray, shape (corners, 2)
        Edges of what `heliosweep.report.ground.rings` tells. [m]
    """

    title: str
    x: np.ndarray
    y: np.ndarray
    width: np.ndarray
    height: np.ndarray
    values: np.ndarray
    z: np.ndarray | None = None
    areas: Mapping[str, Sequence[np.ndarray]] = field(default_factory=dict)
    sides = ("east (m)", "north (m)")

    def ends(self) -> Ends:
        """All mirrors and the tower, with a margin."""
        placed = np.isfinite(self.x) & np.isfinite(self.y)
        edges = [ring for rings in self.areas.values() for ring in rings]
        points = np.concatenate([[[0.0, 0.0]], np.stack([self.x, self.y], axis=-1)[placed], *edges])
        low, high = points.min(axis=0), points.max(axis=0)
        margin = max(0.04 * float((high - low).max()), 1.2 * float(np.nanmax(self.width[placed], initial=0.0)), 1.0)
        return (low[0] - margin, high[0] + margin), (low[1] - margin, high[1] + margin)

    def magnified(self) -> float:
        """How many times larger than to scale mirrors are drawn, at least 1."""
        smallest = SMALLEST * max(high - low for low, high in self.ends())
        sides = np.minimum(self.width, self.height)
        sides = sides[np.isfinite(sides) & (sides > 0)]
        return max(1.0, float(smallest / np.median(sides))) if sides.size else 1.0

    def draw(self, axes: Axes, colours: Colormap, norm: Normalize, first: bool) -> None:
        """Mirrors laid flat with one side towards the tower."""
        placed = np.isfinite(self.x) & np.isfinite(self.y)
        centre = np.stack([self.x, self.y], axis=-1)[placed]
        far = np.hypot(*centre.T)[:, np.newaxis]
        outwards = np.divide(centre, far, out=np.tile([0.0, 1.0], (len(centre), 1)), where=far > 0)
        along = np.stack([outwards[:, 1], -outwards[:, 0]], axis=-1)
        half, deep = (self.magnified() * side[placed, np.newaxis] / 2 for side in (self.width, self.height))
        corners: Any = np.stack(
            [centre + i * half * along + j * deep * outwards for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))], axis=1
        )
        # Without a hair-thin edge pale mirrors would vanish.
        edges = {"edgecolors": (0.0, 0.0, 0.0, 0.35), "linewidths": 0.3} if len(centre) <= _CROWD else {"linewidths": 0}
        values = np.ma.masked_invalid(self.values[placed])
        squares = PolyCollection(corners, array=values, cmap=colours, norm=norm, rasterized=True, **edges)
        axes.add_collection(squares, autolim=False)
        self._draw_ground(axes, placed)
        axes.plot(0, 0, "^", color="black", markersize=5, markeredgecolor="white", markeredgewidth=0.6)

    def _draw_ground(self, axes: Axes, placed: np.ndarray) -> None:
        """Edges of the areas, and lines of the same height."""
        for name, edges in self.areas.items():
            for number, ring in enumerate(edges):
                axes.add_patch(Polygon(ring, label="" if number else name, **_AREAS[name]))
        if self.z is not None and rises(self.z):
            with suppress(RuntimeError, ValueError):  # mirrors in one line have no ground between them
                at = placed & np.isfinite(self.z)
                steps = MaxNLocator(6).tick_values(self.z[at].min(), self.z[at].max())
                lines = axes.tricontour(self.x[at], self.y[at], self.z[at], steps, colors="#333333", linewidths=0.5)
                labels = axes.clabel(lines, fontsize=5.5, fmt=lambda height: f"{height:g} m".replace("-", MINUS))
                for label in labels:
                    label.set_path_effects([withStroke(linewidth=1.6, foreground="white")])


def field_map(here: xr.Dataset, values: np.ndarray, title: str) -> FieldMap | None:
    """Map of one number of each heliostat of a result at one point; none where that does not tell the places.

    Mirrors of unknown size are drawn as squares that are large enough to see and apart from each other.
    """
    if not {"x", "y"} <= set(here.coords) or any(here[name].dims != ("heliostat",) for name in "xy"):
        return None
    x, y = (here[name].to_numpy().astype(float) for name in "xy")
    spans = [float(np.ptp(side[np.isfinite(side)])) if np.isfinite(side).any() else 1.0 for side in (x, y)]
    count = max(int(np.isfinite(x).sum()), 1)
    usual = max(PACKING * math.sqrt(spans[0] * spans[1] / count), max(spans) / 60, 1.0)
    width, height = (
        np.broadcast_to(np.asarray(here[name] if name in here.coords else usual, dtype=float), x.shape)
        for name in ("heliostat_width", "heliostat_height")
    )
    z = here["z"].to_numpy().astype(float) if "z" in here.coords and here["z"].dims == ("heliostat",) else None
    return FieldMap(title, x, y, width, height, np.asarray(values, dtype=float), z, rings(here))


def symbols(maps: Sequence[FieldMap], sized: bool = False, high: float = np.inf, missing: str = "no value") -> str:
    """Sentences for a caption: what the symbols of all the maps of a figure mean.

    `sized` says whether the sizes of the mirrors are known, `high` where the colours end, `missing` what has no value.
    """
    known = np.concatenate([one.values[np.isfinite(one.x)] for one in maps])
    larger = max(one.magnified() for one in maps) > 1.0
    said = [
        f"Each square is a mirror, {'larger than ' if larger else ''}to scale, laid flat with a side towards the tower "
        "(triangle)."
        if sized
        else "Squares: heliostats, not to scale; triangle: tower."
    ]
    said += [] if np.isfinite(known).all() else [f"Grey: {missing}."]
    said += ["Dashed: boundary of the field; hatched: where no heliostat may stand."] if maps[0].areas else []
    said += (
        ["Lines: height of the ground above the tower's base."]
        if any(one.z is not None and rises(one.z) for one in maps)
        else []
    )
    over = int((known[np.isfinite(known)] > high * (1 + 1e-9)).sum())
    said += [f"{over} larger values have the colour of the scale's end."] if over else []
    return " ".join(said)


@dataclass(frozen=True)
class Raster:
    """A value of each pixel of a plane.

    Parameters
    ----------
    array : DataArray, shape (up, right)
        What is shown, with evenly spaced coordinates; NaN is grey. [coordinates in m]
    title : str
        Above it.
    outlines : sequence of (text, x, y, width, height)
        Rectangles that are drawn about their centres on every picture, and named on the first. [m]
    """

    array: xr.DataArray
    title: str = ""
    outlines: Sequence[tuple[str, float, float, float, float]] = ()
    sides = ("to the right (m)", "up (m)")

    @property
    def values(self) -> np.ndarray:
        """All pixels."""
        return self.array.to_numpy().astype(float)

    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top edge of the pixels. [m]"""
        sides = [np.sort(self.array[dim].to_numpy()) for dim in self.array.dims]
        alone = min((float(np.diff(side).mean()) for side in sides if side.size > 1), default=1.0)
        up, right = (edges(side, alone=alone) for side in sides)
        return float(right[0]), float(right[-1]), float(up[0]), float(up[-1])

    def ends(self) -> Ends:
        """Pixels and outlines, with a rim."""
        left, right, bottom, top = self.extent()
        for _, x, y, width, height in self.outlines:
            left, right = min(left, x - width / 2), max(right, x + width / 2)
            bottom, top = min(bottom, y - height / 2), max(top, y + height / 2)
        rim = 0.02 * max(right - left, top - bottom)
        return (left - rim, right + rim), (bottom - rim, top + rim)

    def draw(self, axes: Axes, colours: Colormap, norm: Normalize, first: bool) -> None:
        """Pixels and outlines."""
        values = self.array.sortby(list(self.array.dims)).to_numpy().astype(float)
        look: Any = {"cmap": colours, "norm": norm, "interpolation": "nearest", "rasterized": True, "aspect": "auto"}
        axes.imshow(np.ma.masked_invalid(values), extent=self.extent(), origin="lower", **look)
        halo = [withStroke(linewidth=1.6, foreground="white")]
        for text, x, y, width, height in self.outlines:
            axes.add_patch(Rectangle((x - width / 2, y - height / 2), width, height, **_OUTLINE))
            if first:
                axes.text(x, y, text, ha="center", va="center", fontsize=6.5, path_effects=halo)


Picture = FieldMap | Raster


@styled
def picture_figure(
    pictures: Sequence[Picture], colours: Shades | Kinds, columns: int = 0, names: Sequence[str] = ()
) -> Figure:
    """Draw pictures of the same plane on one colour scale, with its bar or legend below.

    Parameters
    ----------
    pictures : sequence of Picture
        In reading order.
    colours : Shades or Kinds
        What the colours of all of them mean.
    columns : int
        Pictures beside each other; as even as can be where left out.
    names : sequence of str
        Of the rows, beside them.

    Returns
    -------
    matplotlib.figure.Figure
    """
    columns = columns or abreast(len(pictures), COLUMNS)
    lows, highs = zip(*(np.transpose(one.ends()) for one in pictures), strict=True)
    low, high = np.min(lows, axis=0), np.max(highs, axis=0)
    spans = high - low
    spans = np.maximum(spans, [spans[1] / _ASPECTS[1], spans[0] * _ASPECTS[0]])
    low, high = (low + high - spans) / 2, (low + high + spans) / 2
    figure, grid = sheet(len(pictures), columns)
    for index, (axes, one) in enumerate(zip(grid, pictures, strict=True)):
        one.draw(axes, colours.colours, colours.norm, index == 0)
        axes.set(title=one.title, xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(5 if columns < 3 else 4, steps=[1, 2, 5, 10]))
    right, up = pictures[0].sides
    rows = [f"{names[index // columns]}\n{up}" if names else up for index in range(len(pictures))]
    label_outside(grid, columns, right, rows)
    if isinstance(colours, Shades):
        beyond = colours.beyond([one.values for one in pictures])
        colour_bar(figure, ScalarMappable(colours.norm, colours.colours), grid, colours.label, beyond)
        legend(figure, dict(zip(*grid[0].get_legend_handles_labels()[::-1], strict=True)))
    else:
        drawn = np.unique(_known([one.values for one in pictures]))
        entries = {
            word: Patch(facecolor=colour, edgecolor="#666666", linewidth=0.5)
            for value, (word, colour) in colours.looks.items()
            if value in drawn
        }
        legend(figure, entries, loc="lower center")
    return fit(figure, float(spans[1] / spans[0]))


@styled
def grid_figure(
    arrays: Mapping[str, xr.DataArray], labels: tuple[str, str], logarithmic: tuple[bool, bool] = (False, False)
) -> Figure:
    """Draw maps over two swept numbers beside each other, each with a colour scale and its bar below.

    Parameters
    ----------
    arrays : mapping of str to DataArray, shape (y, x)
        By the label of the colour bar, with the unit; the values of the coordinates need not be evenly spaced.
    labels : (str, str)
        Of the horizontal and the vertical axis.
    logarithmic : (bool, bool)
        Which of them are logarithmic; their values must be positive.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, grid = sheet(len(arrays), len(arrays))
    for axes, (label, array) in zip(grid, arrays.items(), strict=True):
        array = array.sortby(list(array.dims))
        y, x = (array[dim] for dim in array.dims)
        values = np.ma.masked_invalid(array.to_numpy().astype(float))
        shades = within(label, [values.compressed()], held=1.0)
        sides = [edges(side.to_numpy(), log) for side, log in zip((x, y), logarithmic, strict=True)]
        mesh = axes.pcolormesh(*sides, values, cmap=shades.colours, norm=shades.norm, rasterized=True)
        axes.set_facecolor(NO_VALUE)
        axes.set(xscale="log" if logarithmic[0] else "linear", yscale="log" if logarithmic[1] else "linear")
        tick(axes.xaxis, x, logarithmic[0], 8 - len(arrays))
        tick(axes.yaxis, y, logarithmic[1])
        colour_bar(figure, mesh, [axes], label, "neither")
    label_outside(grid, len(grid), labels[0], [labels[1]] * len(grid))
    return fit(figure, 0.85)


def edges(values: np.ndarray, logarithmic: bool = False, alone: float = 1.0) -> np.ndarray:
    """Numbers between which each of some rising values stands, in the middle of its neighbours, a single one alone."""
    values = np.log(values) if logarithmic else np.asarray(values, dtype=float)
    half = np.diff(values) / 2 if values.size > 1 else np.array([alone / 2])
    ends = np.concatenate([[values[0] - half[0]], values[:-1] + half[: values.size - 1], [values[-1] + half[-1]]])
    return np.exp(ends) if logarithmic else ends
