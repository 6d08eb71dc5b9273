"""What a result holds, in a few lines: for the end of a run, and for whoever looks at one in Python."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import xarray as xr

from heliosweep.report.labels import SPEAKING, head_of, is_flag, printed, value_text
from heliosweep.report.sections import MOST_NUMBERS, headline


def summary(result: xr.Dataset, names: Iterable[str]) -> Iterator[str]:
    """Yield title and dimensions of a result, then the range of each of the variables `names` that it has.

    Of a variable with dimensions, where its largest value is; of a result without any of them, the range of the
    variable with the fewest dimensions.
    """
    yield str(result.attrs.get("title", ""))
    sizes = ", ".join(f"{name} {size:,}" for name, size in result.sizes.items())
    count = len(result.data_vars)
    yield f"{count:,} variable{'s' * (count != 1)}" + (f" over {sizes}" if sizes else "")
    known = [name for name in names if name in result.data_vars]
    for name in known or [""]:
        text = headline(result, [name])
        if text:
            yield text + (_largest(result[name]) if name else "")


def _largest(array: xr.DataArray) -> str:
    """Where the largest value is, as the end of a sentence; empty where that tells nothing."""
    if not array.ndim or array.size < 2 or array.size > MOST_NUMBERS or is_flag(array):
        return ""
    values = np.asarray(printed(array), dtype=float)
    if not np.isfinite(values).any() or np.nanmin(values) == np.nanmax(values):
        return ""
    place = np.unravel_index(int(np.nanargmax(values)), values.shape)
    words = []
    for dim, index in zip(array.dims, place, strict=True):
        if array.sizes[dim] > 1 and dim in array.coords:
            title = "" if dim in SPEAKING else head_of(array[dim])
            words.append(f"{title} {value_text(array[dim][index])}".strip())
    return f"; largest at {', '.join(words)}" if words else ""
