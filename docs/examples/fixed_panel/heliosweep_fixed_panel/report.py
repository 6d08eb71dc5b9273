"""Figures of a result."""

from __future__ import annotations

from collections.abc import Iterator

import xarray as xr
from matplotlib.figure import Figure

from heliosweep.families.registry import NamedFigure


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Mean cosine against the tilt, a line for each of the other points."""
    if "tilt" not in result.dims:
        return
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    lines = result.mean_cosine.stack(line=[dim for dim in result.mean_cosine.dims if dim != "tilt"])
    for values in lines.transpose("line", "tilt"):
        label = ", ".join(
            f"{name} {value:g}" for name, value in zip(lines.indexes["line"].names, values.line.item(), strict=True)
        )
        axes.plot(result.tilt, values, label=label)
    axes.set(xlabel="tilt of the panel (deg)", ylabel="mean cosine of the incidence (1)")
    axes.legend()
    yield NamedFigure("tilts", "Mean cosine of the incidence against the tilt of the panel.", figure)
