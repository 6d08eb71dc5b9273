"""Texts at the ends of tracks, placed where they cover little."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from heliosweep.report.shapes import Look, Plane

#: Left, bottom, right, top from the panel's corner. [point]
Box = tuple[float, float, float, float]

_HALO = [withStroke(linewidth=1.8, foreground="white")]


def write_texts(axes: Axes, plane: Plane, looks: Mapping[str, Look], points: float) -> None:
    """Write the texts at the ends of tracks, where each covers no other one and as few points as can be.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        With its ends as they stay.
    plane : Plane
        What it shows.
    looks : mapping of str to Look
        By the names of tracks.
    points : float
        Length of a side. [point]
    """
    if not plane.tracks:
        return
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    corner, grow = np.array([left, bottom]), points / np.array([right - left, top - bottom])
    everything = (np.concatenate([[track.x, track.y] for track in plane.tracks], axis=1).T - corner) * grow
    taken: list[Box] = []
    for track in plane.tracks:
        inside = (track.x > left) & (track.x < right) & (track.y > bottom) & (track.y < top)
        seen = np.flatnonzero(inside)
        if not track.text or not seen.size:
            continue
        last, before = seen[-1], seen[-2] if seen.size > 1 else seen[-1]
        at, way = ((np.array([track.x[i], track.y[i]]) - corner) * grow for i in (last, before))
        onward = math.atan2(*(at - way)[::-1])
        boxes = [
            box
            for box in _around(at, onward, 4.0 * len(track.text), 7.0)
            if min(box) > 1 and max(box) < points - 1 and not any(_overlap(box, other) for other in taken)
        ]
        if not boxes:
            continue
        box = min(boxes, key=lambda box: _covered(box, everything))
        taken.append(box)
        x, y = corner + np.array([box[0] + box[2], box[1] + box[3]]) / 2 / grow
        axes.text(
            x,
            y,
            track.text,
            ha="center",
            va="center_baseline",
            fontsize=6.5,
            color=looks[track.name].text or looks[track.name].colour,
            path_effects=_HALO,
            zorder=4,
        )


def _around(at: np.ndarray, onward: float, wide: float, high: float) -> list[Box]:
    """Boxes about a point, those in a direction and near it first."""
    boxes = []
    for far in (1.0, 1.6, 2.6):
        for turn in (0, 0.6, -0.6, 1.2, -1.2, 1.8, -1.8, 2.4, -2.4, math.pi):
            way = np.array([math.cos(onward + turn) * (wide / 2 + 4), math.sin(onward + turn) * (high / 2 + 4)])
            x, y = at + far * way
            boxes.append((x - wide / 2, y - high / 2, x + wide / 2, y + high / 2))
    return boxes


def _covered(box: Box, points: np.ndarray) -> int:
    x, y = points[:, 0], points[:, 1]
    return int(((x > box[0] - 2) & (x < box[2] + 2) & (y > box[1] - 2) & (y < box[3] + 2)).sum())


def _overlap(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
