"""What a family gives to the page of a result, besides views: figures and tables."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class NamedFigure:
    """A figure, the file name it gets and the sentence below it."""

    name: str
    caption: str
    figure: Figure


@dataclass(frozen=True)
class Table:
    """A table of a page.

    A family that makes tables of headline numbers has a method ``tables(result)``, which returns several; without it,
    the page shows the variables over the dimensions that all have.

    Parameters
    ----------
    label : str
        What the table holds, in few words.
    header : sequence of str
        Names of the columns, with the unit in brackets.
    rows : sequence of sequences of str
        Cells.
    words : collection of int
        Columns of text; the others are numbers, set to the right.
    notes : sequence of str
        Sentences below it.
    units : sequence of str
        Units of the columns, below their names.
    classes : sequence of str
        Class of each row, for its colours and lines.
    """

    label: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: Collection[int] = frozenset()
    notes: Sequence[str] = ()
    units: Sequence[str] = ()
    classes: Sequence[str] = ()
