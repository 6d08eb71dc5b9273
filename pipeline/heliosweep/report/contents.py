"""What a family gives to the page of a result, besides views: figures and tables."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class NamedFigure:
    """A figure, the file name it gets and the sentence below it; a notebook shows it.

    Parameters
    ----------
    name : str
        Short name, that of its file in a report.
    caption : str
        What it shows.
    figure : matplotlib.figure.Figure
        To change or to save.
    """

    name: str
    caption: str
    figure: Figure

    def __repr__(self) -> str:
        return f"<figure {self.name}: {self.caption}>"

    def _repr_png_(self) -> bytes:
        from heliosweep.report.style import image

        return image(self.figure, "png")

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> Path:
        """Save as PNG, SVG or PDF, after the ending of the path.

        Parameters
        ----------
        path : path
            File to write; appears under its name when it is complete.
        force : bool
            Whether a file that is there is replaced.

        Returns
        -------
        pathlib.Path
            The file.

        Raises
        ------
        StudyError
            The file is there already, ends in something else, or its folder is not there.
        HeliosweepError
            The file cannot be written.
        """
        from heliosweep.files import write_whole
        from heliosweep.report.style import image
        from heliosweep.store.targets import target_file

        file = target_file(path, force, endings=(".png", ".svg", ".pdf"))
        write_whole(file, image(self.figure, file.suffix[1:].lower()))
        return file


def one_by_one(draws: Iterable[Callable[[Any], Iterable[NamedFigure]]], shown: Any, most: int) -> Iterator[NamedFigure]:
    """Figures of several functions of `shown`, at most so many in all.

    Where one of the functions raises, the error has a note that names it, and who asks for the next figure gets that
    of the next function.
    """

    def drawn(draw: Callable[[Any], Iterable[NamedFigure]]) -> Iterator[NamedFigure]:
        try:
            yield from draw(shown)
        except Exception as error:
            name = str(getattr(getattr(draw, "func", draw), "__name__", draw)).strip("_")
            error.add_note(f"The figure {name.replace('_', ' ')}")
            raise

    return map(lambda figure, _: figure, chain.from_iterable(map(drawn, draws)), range(most))


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
