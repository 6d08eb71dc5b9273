"""What stands on a plane: tracks of points, ellipses, and the panels, colours and words that hold them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Colormap, ListedColormap, Normalize

from heliosweep.report.style import VALUES

#: Words of the axes, as seen from the field looking at the receiver.
RIGHT, UP = "to the right (m)", "up (m)"


#: Signs of the corners of a rectangle.
CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))


@dataclass(frozen=True)
class Look:
    """How the tracks of one name look.

    Parameters
    ----------
    colour : str
        Of the line, and of points without numbers.
    line : str or tuple
        Dashes as matplotlib writes them; empty for none.
    marker : str
        Of the points; empty for none.
    width, size : float
        Of line and marker. [point]
    open : bool
        Whether markers are not filled.
    text : str
        Colour of texts, where it is not that of the line.
    """

    colour: str
    line: Any = "-"
    marker: str = ""
    width: float = 1.2
    size: float = 3.2
    open: bool = False
    text: str = ""


@dataclass(frozen=True)
class Track:
    """Points in their order.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Where they are; a missing one interrupts the line. [m]
    name : str
        Which look it has; in the legend where the look is to be explained.
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
    name: str
    numbers: np.ndarray | None = None
    text: str = ""
    half: np.ndarray | None = None
    framed: bool = True


@dataclass(frozen=True)
class Ellipse:
    """Region that holds a part of a normal distribution.

    Parameters
    ----------
    x, y : float
        Mean. [m]
    covariance : ndarray, shape (2, 2)
        Of x and y. [m2]
    name : str
        Which look it has.
    number : float, optional
        What colours it, by the figure's scale.
    part : float
        Probability inside.
    """

    x: float
    y: float
    covariance: np.ndarray
    name: str
    number: float | None = None
    part: float = 0.95

    def axes(self) -> tuple[float, float, float]:
        """Lengths of both axes, the longer one first, and the angle of that one from x. [m, m, deg]"""
        values, vectors = np.linalg.eigh(self.covariance)
        radii = np.sqrt(np.maximum(values, 0.0) * -2.0 * math.log1p(-self.part))
        return 2.0 * float(radii[1]), 2.0 * float(radii[0]), math.degrees(math.atan2(vectors[1, 1], vectors[0, 1]))

    @property
    def reach(self) -> tuple[float, float]:
        """How far it goes from its centre along x and y. [m]"""
        x, y = np.sqrt(np.maximum(np.diag(self.covariance), 0.0) * -2.0 * math.log1p(-self.part))
        return float(x), float(y)

    @property
    def known(self) -> bool:
        """Whether nothing of it is missing."""
        return bool(np.isfinite([self.x, self.y, *np.ravel(self.covariance)]).all())


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
        pieces: list[Any] = [np.empty((0, 2))]
        for track in self.tracks:
            if track.framed:
                pieces.append(np.stack([track.x, track.y], axis=-1))
                if track.half is not None:
                    pieces += [np.stack([track.x, track.y + sign * track.half], axis=-1) for sign in (-1, 1)]
        for one in self.ellipses:
            if one.known:
                wide, high = one.reach
                pieces += [[[one.x + i * wide, one.y + j * high] for i, j in ((0, 0), *CORNERS)]]
        points = np.concatenate(pieces)
        return points[np.isfinite(points).all(axis=1)]


@dataclass(frozen=True)
class Scale:
    """What the colours mean.

    Parameters
    ----------
    label : str
        With the unit.
    low, high : float
        Ends.
    """

    label: str
    low: float
    high: float

    @property
    def norm(self) -> Normalize:
        """From numbers to colours; a single number has the middle one."""
        return Normalize(self.low, self.high) if self.high > self.low else Normalize(self.low - 1, self.high + 1)

    @property
    def palette(self) -> Colormap:
        """Colours, without the palest ones, which points and lines on white would not show."""
        return ListedColormap(colormaps[VALUES](np.linspace(0.0, 0.93, 256)))


@dataclass(frozen=True)
class Words:
    """What stands around the panels.

    Parameters
    ----------
    x, y : str
        Labels of the axes, with the unit.
    legend : str
        Above the legend, if any.
    silent : sequence of str
        Names that the legend leaves out.
    """

    x: str = RIGHT
    y: str = UP
    legend: str = ""
    silent: Sequence[str] = ()
