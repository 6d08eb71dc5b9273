"""The number of a result that is told first: in the list of all studies and to search engines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from heliosweep.report.labels import DEGREE, is_flag, printed, title_of, unit_of
from heliosweep.report.payload import WHOLE
from heliosweep.report.sections import number_texts


def headline(result: xr.Dataset, names: Sequence[str]) -> str:
    """Range of one variable, in words.

    Parameters
    ----------
    result : xarray.Dataset
        The result.
    names : sequence of str
        Variables of which the first that the result has is told; without any, the first with the fewest dimensions.

    Returns
    -------
    str
        Empty where the result has no numbers.
    """
    numbers = [array for array in result.data_vars.values() if array.dtype.kind in "fiu" and not is_flag(array)]
    known = [result[name] for name in names if name in result.data_vars]
    array = next(iter(known), min(numbers, key=lambda array: array.ndim, default=None))
    if array is None or array.size > WHOLE:
        return ""
    values = np.asarray(printed(array), dtype=float)
    values = values[np.isfinite(values)]
    if not values.size:
        return f"{title_of(array)}: no value"
    unit = unit_of(array)
    space = "" if unit.startswith(DEGREE) else " "
    ends = dict.fromkeys(number_texts(np.array([values.min(), values.max()])))
    return f"{title_of(array)}: {' to '.join(f'{text}{space}{unit}'.rstrip() for text in ends)}"
