"""Figures and tables of random draws: the distribution of the results, and their sensitivity to each key."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
import xarray as xr

from heliosweep.report.figures import (
    Context,
    Curves,
    Figure,
    at,
    capital,
    default_figures,
    head_of,
    is_fraction,
    quantities,
    title_of,
    unit_of,
)
from heliosweep.report.tables import Table, columns_of, number_texts, numbers

SAMPLE, PARAMETER = "sample", "parameter"
#: Maximum number of dots in a figure and of rows in a table.
MOST_DOTS, MOST_ROWS = 4000, 60
#: Figure title, names of the statistics and table note for each sensitivity method.
_KINDS: dict[str, tuple[str, dict[str, str], str]] = {
    "sobol": (
        "Fraction of the variance of the {} due to each key, with 95 % confidence intervals",
        {"first_order_index": "first-order index", "total_index": "total index"},
        "Errors are half-widths of 95 % confidence intervals. If an interval is wider than 0.1, increase sample.size.",
    ),
    "morris": (
        "Elementary effects of each key on the {}",
        {"effect_mean_magnitude": "mean magnitude", "effect_standard_deviation": "standard deviation",
         "effect_mean": "mean effect"},
        "Change in the result when the key increases from its 12.5 % quantile to its 87.5 % quantile.",
    ),
    "local": (
        "Change in the {} if each key changes by one standard deviation",
        {"change_down": "one standard deviation less", "change_up": "one standard deviation more"},
        (
            "Change in the result if a key decreases or increases by one standard deviation; all other keys are at "
            "their medians."
        ),
    ),
}  # fmt: skip


def figures(result: xr.Dataset, headlines: Sequence[str] = ()) -> Iterator[Figure]:
    """Yield figures of the draws and their sensitivities.

    For the first headline number, the figures show the distribution, the sensitivities and the draws over the most
    influential key. Further figures show the sample means of all results.
    """
    names, sensitivity = _names(result, headlines), _sensitivity_of(result)
    if not names:
        return
    title = title_of(result[names[0]])
    if f"{names[0]}_sample_mean" in result:
        heading = f"{capital(title)}: value exceeded by a fraction of the draws"
        yield Curves(
            "distribution", heading, names[:1], over=["exceedance"], derive=partial(_exceeded, names[0]), most=1
        )
    if sensitivity in _KINDS:
        yield Curves("sensitivity", _KINDS[sensitivity][0].format(title), ["sensitivity"], over=[PARAMETER],
                     derive=partial(_sensitivities, names[0]), interactive=False)  # fmt: skip
    key = _leading_key(result, names[0])
    if key and f"{names[0]}_sample_mean" in result:
        heading = f"Draws of the {title} over the key with the highest rank correlation"
        yield Curves(
            "leading_key",
            heading,
            names[:1],
            over=[key],
            derive=lambda data: (
                _draws(data, names[0])[{SAMPLE: slice(MOST_DOTS)}].swap_dims({SAMPLE: key}).to_dataset(name=names[0])
            ),
            looks={"": {"linestyle": "", "marker": ".", "markersize": 2.5}},
            styled=True,
            interactive=False,
        )
    yield from default_figures(result[[name for name in result.data_vars if str(name).endswith("_sample_mean")]])


def tables(result: xr.Dataset, headlines: Sequence[str] = ()) -> Iterator[Table]:
    """Yield tables of result statistics, sensitivities of the first result, and drawn keys."""
    names, sensitivity = _names(result, headlines), _sensitivity_of(result)
    if not names:
        return
    if f"{names[0]}_sample_mean" in result:
        yield _statistics(result, names)
    if PARAMETER in result.sizes:
        data = _sensitivities(names[0], result)
        each = data["sensitivity"].to_dataset("statistic")
        arrays = [each[name].assign_attrs(data["sensitivity"].attrs) for name in each]
        if "sensitivity_error" in data:
            errors = data["sensitivity_error"].to_dataset("statistic")
            each = each.assign({f"{name}_error": array for name, array in errors.items()})
        dims = [*(str(dim) for dim in arrays[0].dims if dim != PARAMETER), PARAMETER]
        yield numbers(each, dims, arrays, f"Sensitivity of the {title_of(result[names[0]])}", [_KINDS[sensitivity][2]])
    keys = [(title_of(one), one.attrs["distribution"], one.attrs.get("units", "")) for one in _keys(result)]
    design = str(result.attrs.get("sample_design", ""))
    columns = columns_of(("key", "distribution", "unit"), keys)
    yield Table("Drawn keys", columns, notes=[f"{capital(design)}."] if design else [])


def _sensitivity_of(result: xr.Dataset) -> str:
    return str(json.loads(result.attrs["study"])["sample"].get("sensitivity", ""))


def _names(result: xr.Dataset, headlines: Sequence[str]) -> list[str]:
    each = {name: result.variables[name] for name in quantities(result)}
    drawn = {name: set(one.dims) for name, one in each.items() if SAMPLE in one.dims and one.dtype.kind == "f"}
    first = [*(name for name in headlines if name in drawn), *drawn][:1]
    return first + [
        name for name, dims in drawn.items() if dims == set.intersection(*drawn.values()) and name not in first
    ]


def _keys(result: xr.Dataset) -> list[xr.DataArray]:
    return [one for one in result.coords.values() if one.dims == (SAMPLE,) and "key" in one.attrs]


def _draws(result: xr.Dataset, name: str) -> xr.DataArray:
    """Return the draws of a result without the mixed samples of a Sobol design."""
    array = result[name]
    rows = result.sizes.get(PARAMETER, 0) + 2
    own = np.isin(np.arange(array.sizes[SAMPLE]) % rows, (0, rows - 1))
    return array[{SAMPLE: own}] if _sensitivity_of(result) == "sobol" else array


def _exceeded(name: str, result: xr.Dataset) -> xr.Dataset:
    percent = np.arange(1.0, 100.0)
    array = _draws(result, name).quantile(1 - percent / 100, SAMPLE, keep_attrs=True)
    attrs = {"units": "percent", "long_name": "fraction of the draws that exceed the value"}
    array = array.assign_coords(quantile=("quantile", percent, attrs)).rename(quantile="exceedance")
    return array.to_dataset(name=name)


def _leading_key(result: xr.Dataset, name: str) -> str:
    """Return the name of the key with the highest rank correlation with a result.

    Only the first point along all other dimensions is used.
    """
    array = _draws(result, name).isel({dim: 0 for dim in result[name].dims if dim != SAMPLE}, drop=True)
    keys = [str(one.name) for one in _keys(result) if one.dtype.kind == "f" and np.ptp(one.to_numpy()) > 0]
    frame = array.to_dataset(name="result").reset_coords()[["result", *keys]].to_dataframe()
    return str(frame.corr("spearman")["result"].drop("result").abs().fillna(0.0).idxmax()) if keys else ""


def _sensitivities(name: str, result: xr.Dataset) -> xr.Dataset:
    """Return the sensitivities of a result to each key, most important key first."""
    sensitivity = _sensitivity_of(result)
    pure, kinds = sensitivity == "sobol", _KINDS[sensitivity][1]
    along = xr.IndexVariable("statistic", list(kinds.values()))
    scale = 1.0 if pure or not is_fraction(result[name]) else 100.0

    def joined(ending: str) -> xr.DataArray:
        arrays = [result[f"{name}_{kind.replace('_index', ending)}"].reset_coords(drop=True) * scale for kind in kinds]
        return xr.concat(arrays, along)

    values = joined("_index")
    unit, words = unit_of(result[name]), f"change in the {title_of(result[name])}"
    unit, words = ("1", "fraction of the variance") if pure else (unit, words)
    data = {"sensitivity": values.assign_attrs(units=unit, long_name=words)}
    data |= {"sensitivity_error": joined("_interval")} if pure else {}
    largest = abs(values).max([dim for dim in values.dims if dim != PARAMETER]).fillna(-1.0)
    titles = {one.attrs["key"]: head_of(one) for one in _keys(result)}
    keys = [titles.get(key, key.replace("_", " ")) for key in map(str, result[PARAMETER].to_numpy())]
    order = np.argsort(-largest.to_numpy(), kind="stable")
    return xr.Dataset(data).assign_coords({PARAMETER: (PARAMETER, keys, {"long_name": "key"})})[{PARAMETER: order}]


def _statistics(result: xr.Dataset, names: Sequence[str]) -> Table:
    context, rows = Context(result), list[list[str]]()
    percentiles = [f"{value:g} %" for value in result["sample_percentile"].to_numpy()]
    kinds = ("sample_mean", "sample_standard_error", "sample_standard_deviation", "sample_percentile")
    for name in names:
        scale = 100.0 if is_fraction(result[name]) else 1.0
        heading = f"{title_of(result[name])} {unit_of(result[name])}".rstrip()
        sizes = {str(dim): size for dim, size in result[name].sizes.items() if dim != SAMPLE}
        for index in itertools.islice(np.ndindex(*sizes.values()), MOST_ROWS - len(rows)):
            point = dict(zip(sizes, index, strict=True))
            values = np.hstack([at(result[f"{name}_{kind}"], point) for kind in kinds]) * scale
            where = context.fulls({dim: index for dim, index in point.items() if dim in result.coords})
            rows.append([heading, where, *number_texts(values, 5)])
    heads = ["result", "at", "mean", "standard error", "standard deviation", *percentiles]
    return Table("Results over the draws", columns_of(heads, rows))
