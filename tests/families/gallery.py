"""Figures of made-up results of a family, one at a time."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from functools import cache
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.report.contents import NamedFigure


class Gallery:
    """What a family draws of its cases, with names of the figures that are expected of some of them."""

    def __init__(
        self,
        figures: Callable[[xr.Dataset], Iterable[NamedFigure]],
        most: int,
        cases: Mapping[str, Callable[[], xr.Dataset]],
        expected: Mapping[str, str],
        words: Collection[str] = (),
        shared: bool = False,
        crowd: tuple[int, int] = (99, 999),
    ) -> None:
        self.figures, self.most, self.cases, self.expected = figures, most, cases, expected
        self.words, self.shared = words, shared  # labels of axes without a unit; whether axes share their labels
        self.crowd = crowd  # most panels of a figure, and most lines of a panel
        self.result: Callable[[str], Any] = cache(lambda name: cases[name]())

    def names(self, dataset: xr.Dataset) -> list[str]:
        """Names of the figures, which are not laid out."""
        return [named.name for named in self.figures(dataset)]

    def find(self, dataset: xr.Dataset, name: str) -> Any:
        """One figure, which is not laid out; those behind it are not drawn."""
        return next(named for named in self.figures(dataset) if named.name == name)

    def one(self, dataset: xr.Dataset, name: str) -> Any:
        """One figure, laid out."""
        named = self.find(dataset, name)
        named.figure.draw_without_rendering()
        return named


def nothing(dataset: xr.Dataset) -> xr.Dataset:
    """The same without a value."""
    missing = {name: array * np.nan for name, array in dataset.data_vars.items() if array.dtype == float}
    return dataset.assign(missing).assign_attrs(dataset.attrs)
