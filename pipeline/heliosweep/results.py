"""Results: the folder of a study's result, and the files that a run writes there."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from heliosweep.config.study import Study
from heliosweep.errors import Problem, StudyError
from heliosweep.families.lookup import family_of_result
from heliosweep.files import user_path
from heliosweep.store.folder import OUTPUTS, page_head

if TYPE_CHECKING:
    import xarray as xr


def result_folder(study: Study, output: str | os.PathLike[str] | None = None) -> Path:
    """Return the result folder of a study: `output`, or ``outputs/<name of the study file>-<study id>``.

    Raises
    ------
    StudyError
        If `output` is empty or cannot be accessed.
    """
    if output is None:
        name = Path(study.source.path).stem if study.source.path else study.family
        printable = "".join(letter if letter.isprintable() and letter != "\\" else "_" for letter in name)
        return Path(OUTPUTS) / f"{printable}-{study.study_id}"
    if not os.fspath(output):
        raise StudyError(Problem("the name of the result folder is empty"))
    folder = user_path(output)
    try:
        folder.exists()
    except OSError as error:
        problem = f"cannot write there: {error.strerror}; name another folder with --output"
        raise StudyError(Problem(problem, file=str(folder))) from None
    return folder


@dataclass(frozen=True)
class Result:
    """Result folder of a finished run.

    Parameters
    ----------
    path : pathlib.Path
        The data set, ``result.nc`` or ``result.zarr``, with ``manifest.json``, ``study.resolved.yaml``,
        ``report.html`` and ``figures/`` in the same folder.
    seconds : dict of str to float
        Time spent in each stage; empty if the result existed. [s]
    """

    path: Path
    seconds: dict[str, float]

    @property
    def folder(self) -> Path:
        """Result folder."""
        return self.path.parent

    @property
    def page(self) -> Path | None:
        """The page with figures and tables, or None."""
        page = self.folder / "report.html"
        return page if page.is_file() else None

    def open(self) -> xr.Dataset:
        """Open the data set."""
        return open_result(self.path)

    def summary(self) -> str:
        """Return title, dimensions, headline numbers and page, one a line."""
        from heliosweep.report.tables import summary

        with self.open() as data:
            family = family_of_result(data)
            lines = [*summary(data, family.headlines if family else ()), *(family.answers(data) if family else ())]
        return "\n".join([*lines, *([f"page: {self.page}"] if self.page else [])])

    def headline(self) -> str:
        """Return the first headline number, or the dimensions of a result without one."""
        lines = self.summary().splitlines()
        return lines[2 if len(lines) > 2 and not lines[2].startswith("page: ") else 1]

    def ending(self) -> str:
        """Return the summary of a new result, or the headline of the page of an existing one."""
        page = self.page
        if self.seconds or not page:
            return self.summary() if self.seconds else ""
        return "\n".join([*filter(None, page_head(page)), f"page: {page}"])

    def __str__(self) -> str:
        return f"{self.summary()}\ndata: {self.path}"


def open_result(path: str | os.PathLike[str]) -> xr.Dataset:
    """Open a result; safe also while other threads run studies.

    Parameters
    ----------
    path : path
        A result folder, or its ``result.nc`` or ``result.zarr``.

    Returns
    -------
    xarray.Dataset
        Lazily read; close it, or use it as a context manager. Values are not checked: run ``heliosweep verify`` if the
        file may be damaged. Heliostats with unique names in the layout can be selected by name: ``sel(name="A1")`` or
        ``heliosweep.sel(heliostat="A1")``.

    Raises
    ------
    StudyError
        If the folder has no result.
    """
    import heliosweep.accessor  # noqa: F401  (registers with xarray)
    from heliosweep.store import read

    result = read.open_result(path)
    names = result.coords.get("name")
    if names is not None and names.ndim == 1 and len(set(names.to_numpy().tolist())) == names.size:
        named = result.set_xindex("name")
        named.set_close(result.close)  # else it would close nothing
        return named
    return result
