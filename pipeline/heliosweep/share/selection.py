"""Selection of one point of a result by keys of the study and labels, which may be given as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, TypeVar

import numpy as np
import xarray as xr

from heliosweep.config.faults import did_you_mean, few_of
from heliosweep.errors import Problem, StudyError

T = TypeVar("T", xr.DataArray, xr.Dataset)


def chosen(data: T, select: Mapping[str, Any] | None, keep: Sequence[str] = (), *, left: int = 0, hint: str = "") -> T:
    """Select labels along dimensions.

    Parameters
    ----------
    data : DataArray or Dataset
        Result.
    select : mapping of str to value, optional
        Label by dimension or dotted key of the study.
    keep : sequence of str
        Dimensions that need no label.
    left : int
        Number of further dimensions that may remain.
    hint : str
        Words for the message about a missing label, with ``{}`` for a dimension.

    Returns
    -------
    DataArray or Dataset
        Dimensions of size 1 are dropped unless they are in `keep`.

    Raises
    ------
    StudyError
        If there is no such dimension or label, or too many dimensions remain.
    """
    for key, value in (select or {}).items():
        name = dimension_of(data, key)
        data = data.sel({name: label(data, name, value)})
    single = {dim: 0 for dim, size in data.sizes.items() if size == 1 and dim not in keep}
    data = data.isel(single)
    others = [str(dim) for dim in data.dims if dim not in keep]
    if len(others) > left:
        known = "; ".join(f"{dim}: {few_of(labels_of(data[dim]))}" for dim in others)
        message = f"choose one value of {' and '.join(others)}{hint.format(others[0])} ({known})"
        raise StudyError(Problem(message, "select"))
    return data


def dimension_of(data: xr.DataArray | xr.Dataset, key: str) -> str:
    """Return the dimension of a dotted key of the study: ``receiver.height`` is along ``receiver_height``."""
    parts = str(key).split(".")
    names = ["_".join(parts[start:]) for start in range(len(parts))]
    return next((name for name in names if name in data.dims), str(key))


def labels_of(coordinate: xr.DataArray) -> list[Any]:
    """Return the labels of a dimension for messages; dates are as short as possible."""
    values = coordinate.to_numpy()
    return list(np.datetime_as_string(values, unit="auto") if values.dtype.kind == "M" else values.tolist())


def label(data: xr.DataArray | xr.Dataset, name: str, value: Any) -> Any:
    """Return the label of a dimension that a value, such as text or the name of a heliostat, refers to.

    Raises StudyError if there is none, or more than one.
    """
    if name not in data.dims:
        dims = ", ".join(map(str, data.dims))
        raise StudyError(Problem(f"is no dimension of the result; it has {dims}", f"select.{name}"))
    labels, known = data[name].to_numpy(), list(map(str, labels_of(data[name])))
    if name == "heliostat" and "name" in data.coords and isinstance(value, str):
        known = list(map(str, data["name"].to_numpy()))
        named = [number for number, own in zip(labels.tolist(), known, strict=True) if own == value]
        if len(named) > 1:
            message = f"is the name of {len(named)} heliostats; choose a number: {few_of(named)} (got {value})"
            raise StudyError(Problem(message, "select.heliostat"))
        if named:
            return named[0]
    is_text = labels.dtype.kind in "OU"
    with suppress(ValueError, TypeError, OverflowError):
        same = labels.astype(str) == str(value) if is_text else labels == np.asarray(value).astype(labels.dtype)
        if same.any() and (is_text or labels.dtype.kind == "M" or float(value) == labels[same][0]):
            return (
                labels[same][0] if labels.dtype.kind == "M" else labels[same][0].item() if not is_text else str(value)
            )
    hint = did_you_mean(str(value), known) if is_text else ""
    message = f"is not in the result{hint or f'; choose from {few_of(known)}'} (got {value})"
    raise StudyError(Problem(message, f"select.{name}"))
