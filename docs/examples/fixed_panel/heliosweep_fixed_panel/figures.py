"""Figures of a result."""

from collections.abc import Iterator

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from heliosweep.report.contents import NamedFigure


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Mean cosine against the tilt, a line for each of the other points."""
    if "tilt" not in result.dims:
        return
    figure, lines = Figure(layout="constrained"), result.mean_cosine.transpose("tilt", ...)
    axes = figure.subplots()
    for point in np.ndindex(lines.shape[1:]):
        line = lines[:, *point]
        axes.plot(line.tilt, line, label=", ".join(f"{dim} {line[dim]:g}" for dim in lines.dims[1:]) or "all")
    axes.set(xlabel="tilt of the panel (deg)", ylabel="mean cosine of the incidence (1)")
    axes.legend()
    yield NamedFigure("tilts", "Mean cosine of the incidence against the tilt of the panel.", figure)
