"""Figures of a finished result, after Figures 2, 7 and 8 and Table 1 of Defieux et al. (2020), by what it holds.

Each figure takes from the sweep what it can show, and its caption says at which values the rest stands; one that needs
what the result does not have is left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, islice

import xarray as xr

from heliosweep.families.backward_gazing import (
    report_errors,
    report_field,
    report_images,
    report_modules,
    report_sweeps,
)
from heliosweep.families.registry import NamedFigure

#: Figures of one result.
MOST_FIGURES = 12


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Figures of a result, each drawn when it is asked for.

    Parameters
    ----------
    result : xarray.Dataset
        From `heliosweep.open_result`; values are read as they are needed.

    Yields
    ------
    NamedFigure
    """
    parts = (report_images, report_errors, report_modules, report_sweeps, report_field)
    return islice(chain.from_iterable(part.figures(result) for part in parts), MOST_FIGURES)
