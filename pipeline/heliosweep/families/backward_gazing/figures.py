"""Figures of a finished result, after Figures 2, 7 and 8 and Table 1 of Defieux et al. (2020), by what it holds.

Each figure takes from the sweep what it can show, and its caption says at which values the rest stands; one that needs
what the result does not have is left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, islice

import xarray as xr

from heliosweep.families.backward_gazing import figures_errors, figures_field, figures_images
from heliosweep.families.backward_gazing.shown import Gazing
from heliosweep.report.contents import NamedFigure

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
    shown = Gazing(result)
    draws = (*figures_images.FIGURES, *figures_errors.FIGURES, *figures_field.FIGURES)
    return islice(chain.from_iterable(draw(shown) for draw in draws), MOST_FIGURES)
