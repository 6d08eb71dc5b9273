"""xarray accessor ``result.heliosweep``, for use in notebooks.

Calling `build` or `open_result`, or importing heliosweep after xarray, registers the accessor.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from heliosweep.errors import HeliosweepError, Problem, StudyError
from heliosweep.files import user_path
from heliosweep.lazy import pd
from heliosweep.report.comparison import FILE as COMPARISON
from heliosweep.report.figures import Context, Curves, Figure, Maps, axis_label
from heliosweep.share import fields, sam
from heliosweep.share.fields import chosen, label

if TYPE_CHECKING:
    from heliosweep.config.study import Study
    from heliosweep.families.family import Family
    from heliosweep.report.draw import NamedFigure


class Plots:
    """Plots of a result: ``result.heliosweep.plot.map("optical_efficiency", latitude=30, tracking=...)``."""

    def __init__(self, result: xr.Dataset) -> None:
        self._result = result

    def map(self, variable: str = "optical_efficiency", **select: Any) -> NamedFigure:
        """Draw a map of a heliostat field in which each mirror is coloured by its value.

        Parameters
        ----------
        variable : str
            Variable with the ``heliostat`` dimension. The result must contain the positions ``x`` and ``y``.
        **select
            Coordinate value along every other dimension of the variable.

        Returns
        -------
        NamedFigure

        Raises
        ------
        StudyError
            If the variable does not exist, or if `select` lacks a value for one of the dimensions of the variable.
        """
        here = chosen(self._result[fields.names_of(self._result, variable)], select, ("heliostat",))
        if "heliostat" not in here[variable].dims:
            raise StudyError(Problem("has no dimension 'heliostat', which a map requires", variable))
        if not {"x", "y"} <= set(here.coords):
            raise StudyError(Problem("has no positions 'x' and 'y' of its heliostats", variable))
        return _drawn(here, lambda title: Maps(f"map_{variable}", title, (variable,)), variable, select)

    def curve(self, variable: str, along: str, **select: Any) -> NamedFigure:
        """Draw a variable along one dimension, with one line for each value of another dimension.

        Parameters
        ----------
        variable : str
            Variable to draw.
        along : str
            Dimension along the horizontal axis, with numbers or times as coordinates.
        **select
            Coordinate values along the other dimensions. At most one dimension may be omitted. The figure has one line
            for each value of the omitted dimension.

        Returns
        -------
        NamedFigure

        Raises
        ------
        StudyError
            If the variable or dimension does not exist, or if `select` omits more than one dimension.
        """
        here = chosen(self._result[fields.names_of(self._result, variable)], select, (along,), left=1)
        if along not in here[variable].dims:
            dims = ", ".join(map(str, here[variable].dims))
            raise StudyError(Problem(f"is not a dimension of {variable}, which has {dims}", along))
        lines = [str(dim) for dim in here[variable].dims if dim != along]
        return _drawn(
            here,
            lambda title: Curves(f"curve_{variable}", title, (variable,), over=(along,), lines=lines),
            variable,
            select,
        )


def _drawn(here: xr.Dataset, figure: Callable[[str], Figure], variable: str, select: Mapping[str, Any]) -> NamedFigure:
    from heliosweep.report.draw import draw

    where = Context(here.expand_dims(list(select))).fulls(dict.fromkeys(select, 0)) if select else ""
    drawn = next(draw(here, [figure(f"{axis_label(here[variable])}{f' at {where}' if where else ''}")]), None)
    if drawn is None:
        raise StudyError(Problem("has no values to draw", variable))
    return drawn


class HeliosweepAccessor:
    """Provide access to the figures, tables, comparison and study of a result.

    Parameters
    ----------
    result : xarray.Dataset
        Result from `open_result` or `build`, or a selection from such a result.
    """

    def __init__(self, result: xr.Dataset) -> None:
        self._result = result

    def __repr__(self) -> str:
        names = (
            "study, figures(), tables(), sel(), to_frame(), to_csv(), to_xlsx(), plot.map(), plot.curve(), compare()"
        )
        return f"<heliosweep: {self._result.attrs.get('title', 'a data set')}; {names}>"

    @property
    def study(self) -> Study:
        """Study that produced the result.

        The study is read from ``study.resolved.yaml`` in the result folder if that file describes the same study.
        Otherwise, the study is read from the attributes of the result, which do not contain the input files.

        Raises
        ------
        HeliosweepError
            If the result contains no study, or if the input files of the study are not available.
        """
        from heliosweep.config.load import load, load_mapping
        from heliosweep.families.family import study_classes

        if "study" not in self._result.attrs:
            raise HeliosweepError("the data set contains no study")
        if (beside := self._beside("study.resolved.yaml")) is not None:
            study = load(beside, study_classes())
            if study.study_id == self._result.attrs.get("study_id"):
                return study
        content: dict[str, Any] = {"zip": [], **json.loads(self._result.attrs["study"])}
        try:
            return load_mapping({key: value for key, value in content.items() if value != []}, study_classes())
        except StudyError as error:
            message = "the study cannot be restored from the data set alone; load its study.resolved.yaml"
            raise HeliosweepError(f"{message} ({error})") from error

    @property
    def plot(self) -> Plots:
        """Plots of single variables."""
        return Plots(self._result)

    def sel(self, **labels: Any) -> xr.Dataset:
        """Select data by label as with `xarray.Dataset.sel`, or heliostats by name.

        For example, ``sel(heliostat="A1", latitude=30)`` selects one heliostat.

        Parameters
        ----------
        **labels
            Label, list of labels or slice for each dimension. Heliostats are labelled by numbers from 0, and also by
            names if the layout has a ``name`` column.

        Raises
        ------
        StudyError
            If no heliostat has the given name, or if several heliostats have this name.
        """
        given = labels.get("heliostat")
        wanted = np.asarray(given)
        if wanted.dtype.kind in "UO" and not isinstance(given, slice) and given is not None:
            numbers = [label(self._result, "heliostat", name) for name in wanted.ravel()]
            labels["heliostat"] = numbers if wanted.ndim else numbers[0]
        return self._result.sel(labels)

    def figures(self) -> list[NamedFigure]:
        """Draw the figures of the report.

        Returns
        -------
        list of NamedFigure
            Figures of the report, which notebooks show as images.

        Raises
        ------
        StudyError
            If the dataset lacks variables that the family needs.
        """
        from heliosweep.report.draw import draw

        with self._part("figures") as family:
            return list(draw(self._result, family.figures(self._result)))

    def tables(self) -> dict[str, pd.DataFrame]:
        """Return the tables of the report.

        Returns
        -------
        dict of str to pandas.DataFrame
            Tables, keyed by title. If the family declares no tables, a single table contains the variables with the
            fewest dimensions.

        Raises
        ------
        StudyError
            If the dataset has no variables, or lacks variables that the family needs.
        """
        result = self._result
        if not result.data_vars:
            raise StudyError(Problem("the result has no variables"))
        if tables := self._tables():
            return tables
        dims, names = min(fields.groups(result).items(), key=lambda group: len(group[0]))
        return {f"over {', '.join(dims)}" if dims else "values": fields.to_frame(result, names, units=True)}

    def _tables(self) -> dict[str, pd.DataFrame]:
        with self._part("tables") as family:
            return {table.label: table.frame() for table in family.tables(self._result)}

    def compare(self, published: str | os.PathLike[str]) -> pd.DataFrame:
        """Compare the result with published numbers.

        Parameters
        ----------
        published : path
            CSV file in the format required by the study key `report.published`.

        Returns
        -------
        pandas.DataFrame
            Table with one row for each published number, and columns for computed value, difference and verdict.

        Raises
        ------
        StudyError
            If the table is invalid or does not match the result. The message lists all problems with their line
            numbers.
        """
        from heliosweep.report.comparison import compare, read_published

        table, result = read_published(user_path(published)), self._result
        asked = {*table.values["quantity"]} & set(map(str, result.data_vars))
        compared = compare(result.assign({name: result[name].compute() for name in asked}), table)
        columns = ("computed", "published", "difference", "tolerance", "unit", "agrees", "verdict")
        values = compared.values[["claim", "quantity", *compared.coordinates, *columns]]
        return values.astype({"published": float}).reset_index(drop=True)

    def to_frame(self, variables: str | Sequence[str] | None = None, *, units: bool = False) -> pd.DataFrame:
        """Return variables as a table; see `share.fields.to_frame`."""
        return fields.to_frame(self._result, variables, units=units)

    def to_csv(
        self, path: str | os.PathLike[str], variables: str | Sequence[str] | None = None, *, force: bool = False
    ) -> Path:
        """Write variables as a CSV file; see `share.fields.write_csv`."""
        return fields.write_csv(self._result, path, variables, force=force)

    def to_xlsx(
        self, path: str | os.PathLike[str], variables: str | Sequence[str] | None = None, *, force: bool = False
    ) -> Path:
        """Write variables as an Excel workbook; see `share.fields.write_xlsx`.

        If `variables` is None, the workbook begins with the tables of the report and the comparison with published
        numbers.
        """
        tables: dict[str, pd.DataFrame] = {}
        if variables is None:
            with suppress(HeliosweepError):  # a selection from a result may lack these tables
                tables = self._tables()
            if (compared := self._beside(COMPARISON)) is not None:
                tables["published numbers"] = pd.read_csv(compared)
        return fields.write_xlsx(self._result, path, variables, tables=tables, force=force)

    def efficiency_table(self, select: Mapping[str, Any] | None = None, *, factor: float = 1.0) -> xr.DataArray:
        """Return the efficiency as a function of the sun's direction; see `share.sam.efficiency_table`."""
        return sam.efficiency_table(self._result, select, factor=factor)

    def _beside(self, name: str) -> Path | None:
        source = self._result.encoding.get("source")
        file = Path(source).parent / name if isinstance(source, str) else None
        return file if file is not None and file.is_file() else None

    @contextmanager
    def _part(self, what: str) -> Iterator[Family]:
        """Yield the family of the result, and convert the KeyError for a missing variable to a StudyError."""
        from heliosweep.families.lookup import family_of_result

        family = family_of_result(self._result)
        if family is None:
            raise HeliosweepError("the data set contains no study, or its family is not installed")
        try:
            yield family
        except KeyError as error:
            message = f"the {what} of {family.name} require the whole result ({error.args[0]})"
            raise StudyError(Problem(message)) from error


if not hasattr(xr.Dataset, "heliosweep"):
    xr.register_dataset_accessor("heliosweep")(HeliosweepAccessor)
