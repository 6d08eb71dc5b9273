"""Figures of a result."""

from collections.abc import Iterator

import xarray as xr

from heliosweep.report.figures import Curves, Figure


def figures(result: xr.Dataset) -> Iterator[Figure]:
    """Yield the mean cosine over the tilt, with a line for each of the other points."""
    yield Curves("tilts", "Mean cosine of the incidence over the tilt of the panel", ["mean_cosine"], over=["tilt"])
