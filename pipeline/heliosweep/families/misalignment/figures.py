"""Figures and tables of a finished result, by what it holds; after Optics Express 27 (8), A257 (2019).

Each takes from the sweep what it can show, and its caption says at which values the rest stands; one that needs what
the result does not have is left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, islice

import xarray as xr

from heliosweep.families.misalignment import figures_calibration, figures_curves, figures_mount_errors
from heliosweep.families.misalignment.shown import FIELD, HELIOSTAT, Spots
from heliosweep.report.contents import NamedFigure, Table

#: Figures of one result.
MOST_FIGURES = 10


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Figures of a result, each drawn when it is asked for; values are read as they are needed."""
    spots, tolerances = figures_curves.SPOTS, figures_curves.TOLERANCES
    field = result.sizes.get(HELIOSTAT, 0) >= FIELD
    first = (*tolerances, *spots) if field else (*spots, *tolerances)
    shown = Spots(result)
    draws = (*first, *figures_mount_errors.FIGURES, *figures_calibration.FIGURES)
    return islice(chain.from_iterable(draw(shown) for draw in draws), MOST_FIGURES)


def tables(result: xr.Dataset) -> Iterator[Table]:
    """Tables of a result; none where its variables have numbers of the whole."""
    shown = Spots(result)
    return chain(figures_calibration.tables(shown), figures_mount_errors.tables(shown))
