"""One look for all figures: sizes and type for a paper's page.

Figures are made without pyplot and without touching matplotlib's global settings for longer than a drawing takes.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image, ImageChops

#: Resolution of images [1/inch], and white rim around a figure [pixel].
DPI, RIM = 180, 8

_RC: Any = {
    "text.parse_math": False,  # titles and names of sites are words, whatever dollars they hold
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 8,
    "axes.titlesize": 7.5,
    "axes.labelsize": 8,
    "axes.linewidth": 0.6,
    "axes.edgecolor": "#444444",
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "xtick.labelcolor": "black",
    "ytick.labelcolor": "black",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "grid.color": "#e2e2e2",
    "grid.linewidth": 0.5,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "lines.markersize": 3.2,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.fonttype": "none",
    "svg.hashsalt": "heliosweep",
    "pdf.fonttype": 42,
}


@contextmanager
def style() -> Iterator[None]:
    """Use the common look in a context."""
    with matplotlib.rc_context(_RC):
        yield


def pixels(figure: Figure) -> Image.Image:
    """Return a figure as pixels, without white margins."""
    with style():
        figure.set_dpi(DPI)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    figure.set_canvas(FigureCanvasBase(figure))  # frees the buffer of the other canvas
    left, top, right, bottom = ImageChops.invert(picture).getbbox() or (0, 0, *picture.size)
    size = picture.size
    rim = (max(left - RIM, 0), max(top - RIM, 0), min(right + RIM, size[0]), min(bottom + RIM, size[1]))
    return picture.crop(rim)


def png(picture: Image.Image) -> bytes:
    """The bytes of a PNG file of some pixels."""
    buffer = io.BytesIO()
    picture.save(buffer, "PNG", dpi=(DPI, DPI))
    return buffer.getvalue()


def image(figure: Figure, kind: str = "png") -> bytes:
    """Return a figure as the bytes of an image file; the same figure gives the same bytes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Figure.
    kind : {"png", "svg", "pdf"}
        File format. In the vector formats, only maps with many small shapes are pixels.
    """
    if kind == "png":
        return png(pixels(figure))
    buffer = io.BytesIO()
    date = {"svg": "Date", "pdf": "CreationDate"}[kind]
    with style():
        figure.savefig(buffer, format=kind, dpi=DPI, bbox_inches="tight", metadata={date: None})
    return buffer.getvalue()


def small(picture: Image.Image) -> bytes:
    """Return a PNG with 256 colours for a page, a quarter of the bytes."""
    return png(picture.quantize(256, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE))
