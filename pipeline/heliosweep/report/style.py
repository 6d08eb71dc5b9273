"""One look for all figures: sizes and type for a paper's page.

Figures are made without pyplot and without touching matplotlib's global settings for longer than a drawing takes.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatterSciNotation
from PIL import Image

P = ParamSpec("P")
T = TypeVar("T")

#: Resolution of pixel images. [1/inch]
DPI = 180

_RC: Any = {
    "text.parse_math": False,  # titles and names of sites are words, whatever dollars they hold; see `PlainPowers`
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
    """Use the common look while the context lasts; do not yield from a generator inside it."""
    with matplotlib.rc_context(_RC):
        yield


def styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Give a function that draws a figure the common look."""

    @wraps(draw)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> T:
        with style():
            return draw(*args, **kwargs)

    return wrapper


_FORMULA, _POWER = re.compile(r"\$\\mathdefault\{(.*)\}\$"), re.compile(r"\^\{([-0-9]+)\}")
_RAISED = str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")


class PlainPowers(LogFormatterSciNotation):
    """Ticks of logarithmic axes as text: formulas are not set, since titles and names may hold dollars."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Text of a tick."""
        text = _FORMULA.sub(r"\1", super().__call__(x, pos)).replace(r"\times", "\N{MULTIPLICATION SIGN}")
        return _POWER.sub(lambda found: found.group(1).translate(_RAISED), text)


def pixels(figure: Figure) -> Image.Image:
    """Figure as pixels; not by savefig, which draws everything twice."""
    with style():
        figure.set_dpi(DPI)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def png(picture: Image.Image) -> bytes:
    """The bytes of a PNG file of some pixels."""
    buffer = io.BytesIO()
    picture.save(buffer, "PNG", dpi=(DPI, DPI))
    return buffer.getvalue()


def image(figure: Figure, kind: str = "png") -> bytes:
    """Figure as the bytes of an image file; the same figure gives the same bytes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        From `heliosweep.report.layout.sheet`.
    kind : {"png", "svg", "pdf"}
        File format. In the vector formats only the many small shapes of maps are pixels.

    Returns
    -------
    bytes
    """
    if kind == "png":
        return png(pixels(figure))
    buffer = io.BytesIO()
    with style():
        figure.savefig(buffer, format=kind, dpi=DPI, metadata={{"svg": "Date", "pdf": "CreationDate"}[kind]: None})
    return buffer.getvalue()


def small(picture: Image.Image, scale: float = 1.0) -> bytes:
    """PNG with 256 colours and perhaps fewer pixels, for a page: about a quarter of the bytes."""
    if scale != 1.0:
        size = round(scale * picture.width), round(scale * picture.height)
        picture = picture.resize(size, Image.Resampling.LANCZOS)
    return png(picture.quantize(256, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE))
