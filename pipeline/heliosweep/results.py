"""Results: the folder that a study's result goes to, and what a run has left in one."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from heliosweep.config.study import Study
from heliosweep.errors import HeliosweepError, Problem, StudyError
from heliosweep.families.lookup import family_of_result
from heliosweep.files import user_path
from heliosweep.store.folder import OUTPUTS, page_head

if TYPE_CHECKING:
    import xarray as xr


def result_folder(study: Study, output: str | os.PathLike[str] | None = None) -> Path:
    """Folder of a study's result: `output`, or ``outputs/<name of the study file>-<study id>``.

    Raises
    ------
    StudyError
        Where `output` cannot be the name of a folder that the NetCDF library writes to.
    """
    if output is None:
        name = Path(study.source.path).stem if study.source.path else study.family
        # The NetCDF library takes a backslash for what parts folders.
        printable = "".join(letter if letter.isprintable() and letter != "\\" else "_" for letter in name)
        return Path(OUTPUTS) / f"{printable}-{study.study_id}"
    if not os.fspath(output):
        raise StudyError(Problem("the name of the result folder is empty"))
    folder = user_path(output)
    if "\\" in str(folder.absolute()) and os.name == "posix":
        problem = "the NetCDF library takes a backslash for what parts folders; name another folder with --output"
        raise StudyError(Problem(problem, file=str(folder.absolute())))
    try:
        str(folder.absolute()).encode()
    except UnicodeEncodeError:
        raise StudyError(Problem("the name of the result folder is no text", file=str(folder))) from None
    try:
        os.lstat(folder)
    except (FileNotFoundError, NotADirectoryError):
        pass
    except OSError as error:
        problem = f"cannot write there: {error.strerror}; name another folder with --output"
        raise StudyError(Problem(problem, file=str(folder))) from None
    return folder


@dataclass(frozen=True)
class Result:
    """What a run left behind.

    Parameters
    ----------
    path : pathlib.Path
        The data set, ``result.nc`` or ``result.zarr``, with ``manifest.json``, ``study.resolved.yaml``,
        ``report.html`` and ``figures/`` beside it.
    seconds : dict of str to float
        Time spent in each stage; empty where the result was there already. [s]
    """

    path: Path
    seconds: dict[str, float]

    @property
    def folder(self) -> Path:
        """The result folder."""
        return self.path.parent

    @property
    def page(self) -> Path | None:
        """The page with figures and tables; None where there is none."""
        page = self.folder / "report.html"
        return page if page.is_file() else None

    def open(self) -> xr.Dataset:
        """Open the data set."""
        return open_result(self.path)

    def summary(self) -> str:
        """What it holds, one thing a line: title, dimensions, headline numbers, the page."""
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
        """What the end of a run tells: `summary`; of a result that was there already the headline of its page alone."""
        return self.summary() if self.seconds else "\n".join(self._told())

    def _told(self) -> list[str]:
        """Title and headline of the page, and where it is."""
        page = self.page
        return [*filter(None, page_head(page)), f"page: {page}"] if page else []

    def __str__(self) -> str:
        try:
            text = self.summary().replace("\n", "\n  ")
        except (HeliosweepError, OSError, ValueError) as error:
            text = f"cannot be read: {error}"
        return f"<heliosweep.Result> {text}\n  data: {self.path}"

    def __repr__(self) -> str:  # debuggers ask for it at any time: it does not open the data set
        return "\n  ".join(["<heliosweep.Result>", *self._told(), f"data: {self.path}"])


def open_result(path: str | os.PathLike[str]) -> xr.Dataset:
    """Open a result; safe also while other threads run studies.

    Parameters
    ----------
    path : path
        A result folder, or its ``result.nc`` or ``result.zarr``.

    Returns
    -------
    xarray.Dataset
        Lazily read; close it, or use it as a context manager. Its values are not checked: where a file may be damaged,
        ask ``heliosweep verify`` first. Heliostats whose layout has a column ``name``, no name twice, are selected by
        it too: ``sel(name="A1")``, or ``heliosweep.sel(heliostat="A1")``.

    Raises
    ------
    StudyError
        A folder without a result.
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
