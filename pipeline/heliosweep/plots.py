"""Plots of single variables of a result, as a notebook shows them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.errors import Problem, StudyError
from heliosweep.report.contents import NamedFigure
from heliosweep.share import sam

#: Lines of one plot at the most.
MOST_LINES = 12


def plot_map(result: xr.Dataset, variable: str = "optical_efficiency", **select: Any) -> NamedFigure:
    """Draw a map of a heliostat field, every mirror coloured by a value.

    Parameters
    ----------
    result : xarray.Dataset
        With heliostats at ``x`` and ``y``.
    variable : str
        A variable along ``heliostat``.
    **select
        Value of every other dimension of the variable.

    Returns
    -------
    NamedFigure

    Raises
    ------
    StudyError
        No such variable, or a dimension that no value is given for.
    """
    from heliosweep.report import pictures
    from heliosweep.report.labels import axis_label, coordinate_text, is_fraction, number_text, printed

    here = _selected(result, variable, select, keep=("heliostat",))
    if "heliostat" not in here[variable].dims:
        raise StudyError(Problem("is not known of each heliostat; a map needs values along 'heliostat'", variable))
    values = np.asarray(printed(here[variable].compute()), dtype=float)
    where = ", ".join(coordinate_text(here[name]) for name in select)
    percent = " %" if is_fraction(here[variable]) else ""
    mean = f"mean {number_text(float(np.nanmean(values)))}{percent}" if np.isfinite(values).any() else "no value"
    title = f"{where}\n{mean}" if where else mean
    one = pictures.field_map(here, values, title)
    if one is None:
        raise StudyError(Problem("its heliostats have no places 'x' and 'y'", variable))
    label = axis_label(here[variable])
    drawn = pictures.picture_figure([one], pictures.within(label, [values], held=1.0))
    return NamedFigure(f"map_{variable}", f"{label}{f' at {where}' if where else ''}", drawn)


def plot_curve(result: xr.Dataset, variable: str, along: str, **select: Any) -> NamedFigure:
    """Draw a variable along one dimension, a line for each value of another one at the most.

    Parameters
    ----------
    result : xarray.Dataset
        A result or a part of it.
    variable : str
        The variable.
    along : str
        Dimension with numbers or times.
    **select
        Values of other dimensions; all but one other dimension need one.

    Returns
    -------
    NamedFigure

    Raises
    ------
    StudyError
        No such variable or dimension, or too many of them left.
    """
    from heliosweep.report.labels import axis_label, coordinate_text, is_fraction
    from heliosweep.report.panels import Panel, curve_figure

    here = _selected(result, variable, select, keep=(along,), most_left=1)
    array = here[variable].compute()
    if along not in array.dims:
        raise StudyError(Problem(f"is no dimension of {variable}, which has {', '.join(map(str, array.dims))}", along))
    others = [dim for dim in array.dims if dim != along]
    lines = [array] if not others else [array.isel({others[0]: i}) for i in range(array.sizes[others[0]])]
    named = {coordinate_text(line[others[0]]) if others and len(lines) > 1 else "": line for line in lines[:MOST_LINES]}
    panel = Panel(axis_label(array), {name: (100 if is_fraction(array) else 1) * line for name, line in named.items()})
    figure = curve_figure([panel], axis_label(array[along]))
    where = ", ".join(coordinate_text(here[name]) for name in select)
    left_out = f", the first {MOST_LINES} of {len(lines)} lines" if len(lines) > MOST_LINES else ""
    caption = f"{axis_label(array)} along {along}{f' at {where}' if where else ''}{left_out}"
    return NamedFigure(f"curve_{variable}", caption, figure)


def _selected(
    result: xr.Dataset, variable: str, select: Mapping[str, Any], keep: Sequence[str], most_left: int = 0
) -> xr.Dataset:
    """Return a variable where it was selected, with at most so many dimensions left besides those to keep."""
    if variable not in result.data_vars:
        raise StudyError(Problem(f"no such variable; the result has {', '.join(map(str, result.data_vars))}", variable))
    here = result[[variable]]
    for name, value in select.items():
        here = here.sel({name: sam.label(here[variable], name, value)})
    left = [str(dim) for dim in here[variable].dims if dim not in keep and here.sizes[dim] > 1]
    if len(left) > most_left:
        told = "; ".join(f"{dim}: {', '.join(map(str, here[dim].to_numpy()[:6]))}" for dim in left)
        raise StudyError(Problem(f"choose one value of {' and '.join(left)} ({told})", variable))
    single = {dim: 0 for dim in here[variable].dims if dim not in keep and here.sizes[dim] == 1}
    return here.isel(single)
