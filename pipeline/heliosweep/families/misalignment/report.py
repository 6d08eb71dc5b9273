"""Figures of a finished result, by what it holds; after Figures 4, 5, 7 and 8 of Optics Express 27 (8), A257 (2019).

Each figure takes from the sweep what it can show, and its caption says at which values the rest stands; one that needs
what the result does not have is left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, islice

import xarray as xr

from heliosweep.families.misalignment import report_calibration, report_curves, report_mount_errors, report_tolerances
from heliosweep.families.misalignment.report_views import FIELD, HELIOSTAT
from heliosweep.families.registry import NamedFigure

#: Figures of one result.
MOST_FIGURES = 10


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
    parts = [report_curves, report_tolerances, report_mount_errors, report_calibration]
    if result.sizes.get(HELIOSTAT, 0) >= FIELD:
        parts[:2] = reversed(parts[:2])
    return islice(chain.from_iterable(part.figures(result) for part in parts), MOST_FIGURES)
