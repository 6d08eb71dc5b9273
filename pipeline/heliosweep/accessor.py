"""The accessor ``result.heliosweep`` of notebooks.

`build`, `open_result` and importing heliosweep after xarray register the accessor.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from heliosweep.errors import HeliosweepError, Problem, StudyError
from heliosweep.files import user_path
from heliosweep.plots import Drawing, plot_curve, plot_map
from heliosweep.share import frames, sam

if TYPE_CHECKING:
    import pandas as pd

    from heliosweep.config.study import Study
    from heliosweep.families.family import Family


class Plots:
    """Plots of a result: ``result.heliosweep.plot.map("optical_efficiency", latitude=30, tracking=...)``."""

    def __init__(self, result: xr.Dataset) -> None:
        self._result = result

    def map(self, variable: str = "optical_efficiency", **select: Any) -> Drawing:
        """Draw a map of the field: see `plot_map`."""
        return plot_map(self._result, variable, **select)

    def curve(self, variable: str, along: str, **select: Any) -> Drawing:
        """Draw a variable along a dimension: see `plot_curve`."""
        return plot_curve(self._result, variable, along, **select)


class HeliosweepAccessor:
    """Figures, tables, comparison and study of a result.

    Parameters
    ----------
    result : xarray.Dataset
        From `open_result` or `build`; or a part of it.
    """

    def __init__(self, result: xr.Dataset) -> None:
        self._result = result

    def __repr__(self) -> str:
        names = "study, figures(), tables(), to_frame(), plot.map(), plot.curve(), compare(), efficiency_table()"
        return f"<heliosweep: {self._result.attrs.get('title', 'a data set')}; {names}>"

    @property
    def study(self) -> Study:
        """The study that the result is of.

        It is read from ``study.resolved.yaml`` beside the result where that is of the same study; else from what the
        result says of itself, which does not hold the files that a study names.

        Raises
        ------
        HeliosweepError
            The result tells of no study, or of one that names files.
        """
        from heliosweep.config.load import load, load_mapping
        from heliosweep.families.family import study_classes

        if "study" not in self._result.attrs:
            raise HeliosweepError("the data set does not say of which study it is")
        source = self._result.encoding.get("source")
        beside = Path(source).parent / "study.resolved.yaml" if isinstance(source, str) else None
        if beside is not None and beside.is_file():
            study = load(beside, study_classes())
            if study.study_id == self._result.attrs.get("study_id"):
                return study
        said: dict[str, Any] = json.loads(self._result.attrs["study"])
        said["zip"] = said.get("zip", [])
        try:
            return load_mapping({key: value for key, value in said.items() if value != []}, study_classes())
        except StudyError as error:
            message = "the study cannot be made from the data set alone; load its study.resolved.yaml"
            raise HeliosweepError(f"{message} ({error})") from error

    @property
    def plot(self) -> Plots:
        """Plots of single variables."""
        return Plots(self._result)

    def figures(self) -> list[Drawing]:
        """Draw the figures that the report of the result has.

        Returns
        -------
        list of Drawing
            Shown as images in a notebook.

        Raises
        ------
        StudyError
            The family needs more than this part of its result; says what is missing.
        """
        family = self._family()
        with self._lacking(family, "figures"):
            return [Drawing(one.name, one.caption, one.figure) for one in family.figures(self._result)]

    def tables(self) -> dict[str, pd.DataFrame]:
        """Headline numbers of the result, as its report has them.

        Returns
        -------
        dict of str to pandas.DataFrame
            By what each table holds; where the family makes none, the variables with the fewest dimensions.

        Raises
        ------
        StudyError
            The result has no variables, or the family needs more than this part of its result; says what is missing.
        """
        import pandas as pd

        family, result = self._family(), self._result
        if not result.data_vars:
            raise StudyError(Problem("the result has no variables"))
        with self._lacking(family, "tables"):
            tables = list(family.tables(result))
        if not tables:
            dims, names = min(frames.groups(result).items(), key=lambda group: len(group[0]))
            return {f"over {', '.join(dims)}" if dims else "values": frames.to_frame(result, names, units=True)}
        made = {}
        for table in tables:
            frame = pd.DataFrame([list(row) for row in table.rows], columns=list(table.header))
            for place, name in enumerate(table.header):
                if place not in table.words:
                    numbers = pd.to_numeric(frame.iloc[:, place], errors="coerce")
                    if numbers.notna().all():
                        frame[name] = numbers
            made[table.label] = frame
        return made

    def compare(self, published: str | os.PathLike[str]) -> pd.DataFrame:
        """Set published numbers against those of the result.

        Parameters
        ----------
        published : path
            CSV table: columns ``quantity``, ``published``, ``unit``, ``tolerance``, all others coordinates of the
            result.

        Returns
        -------
        pandas.DataFrame
            A row for each number, with what was computed, the difference and whether it is within the tolerance.

        Raises
        ------
        StudyError
            The table is wrong or does not fit the result, at its lines.
        """
        import pandas as pd

        from heliosweep.report.comparison import compare
        from heliosweep.report.published import read_published

        table, result = read_published(user_path(published)), self._result
        asked = {value.quantity for value in table.values} & set(map(str, result.data_vars))
        compared = compare(result.assign({name: result[name].compute() for name in asked}), table)
        rows = [
            {
                "quantity": one.quantity,
                **one.where,
                "computed": one.computed,
                "published": one.published,
                "difference": one.difference,
                "tolerance": one.tolerance,
                "unit": one.unit,
                "agrees": one.agrees,
            }
            for one in compared
        ]
        return pd.DataFrame(rows)

    def to_frame(self, variables: str | Sequence[str] | None = None, *, units: bool = False) -> pd.DataFrame:
        """Put variables in a table: see `share.frames.to_frame`."""
        return frames.to_frame(self._result, variables, units=units)

    def to_csv(
        self, path: str | os.PathLike[str], variables: str | Sequence[str] | None = None, *, force: bool = False
    ) -> Path:
        """Write variables as CSV: see `share.frames.write_csv`."""
        return frames.write_csv(self._result, path, variables, force=force)

    def efficiency_table(self, select: Mapping[str, Any] | None = None, *, factor: float = 1.0) -> xr.DataArray:
        """Efficiency over directions of the sun: see `share.sam.efficiency_table`."""
        return sam.efficiency_table(self._result, select, factor=factor)

    def _family(self) -> Family:
        from heliosweep.families.family import families

        name = json.loads(self._result.attrs.get("study", "{}")).get("family")
        if name not in families():
            raise HeliosweepError("the data set does not say of which study it is, or its family is not installed")
        return families()[name]

    @contextmanager
    def _lacking(self, family: Family, what: str) -> Iterator[None]:
        """Say what is missing where a family fails on a part of its result; errors on the whole pass."""
        try:
            yield
        except (KeyError, ValueError, TypeError, IndexError, AttributeError) as error:
            try:
                study = self.study
                stated, labels = family.variables(study), family.coordinates(study).coords
                sizes = family.workload(study).sizes
            except HeliosweepError:  # the study names files that are not here
                message = f"the {what} of {family.name} cannot be made of this result, if it is a part use the whole"
                raise StudyError(Problem(f"{message} ({type(error).__name__}: {error})")) from error
            variables = [str(name) for name in (*labels, *stated) if name not in self._result.variables]
            named = [name for name in variables if f"'{name}'" in str(error).partition("Did you")[0]]
            missing = named or [
                *(f"dimension {name}" for name in sizes if name not in self._result.dims),
                *(name for name in variables if name not in sizes),
            ]
            if missing:
                message = f"this part of the result lacks {', '.join(missing)}, which the {what} of {family.name} need"
                raise StudyError(Problem(message)) from error
            cut = [dim for dim, size in sizes.items() if size != self._result.sizes[dim]]
            if cut:
                message = f"the {what} of {family.name} cannot be made of a part along {', '.join(cut)}"
                raise StudyError(Problem(message)) from error
            raise


if not hasattr(xr.Dataset, "heliosweep"):
    xr.register_dataset_accessor("heliosweep")(HeliosweepAccessor)
