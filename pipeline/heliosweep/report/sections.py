"""What the sections of a result's page say: words and tables, as the templates set them."""

from __future__ import annotations

import itertools
import math
import re
import shlex
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.report.contents import Table
from heliosweep.report.labels import (
    DEGREE,
    MINUS,
    coordinate_text,
    flag_text,
    is_flag,
    is_quantity,
    labels_along,
    number_text,
    printed,
    title_of,
    unit_of,
    value_text,
)

#: Rows of the table of headline numbers.
MOST_ROWS = 60

#: Variables in a table of ranges.
MOST_RANGES = 12

#: Numbers of a variable up to which all are looked through for its range.
MOST_NUMBERS = 8_000_000

#: A digital object identifier, with what announces it.
DOI = re.compile(r"\b(?:https?://(?:dx\.)?doi\.org/|doi:?\s*)(10\.\d{4,9}/[^\s,;]*[^\s,;.)])", re.IGNORECASE)


def results(result: xr.Dataset, tables: Iterable[Table], headlines: Collection[str] = ()) -> dict[str, Any]:
    """Tables that the family makes, else the numbers of the whole, else ranges; empty where there is nothing to tell.

    ``shared`` says what has one value for all, ``described`` holds pairs of a variable and what it is.
    """
    tables = list(tables)
    if tables:
        return {"shared": _shared(result), "tables": tables, "described": []}
    if not result.data_vars:
        return {}
    common = set.intersection(*(set(array.dims) for array in result.data_vars.values()))
    arrays = [array for array in result.data_vars.values() if set(array.dims) == common and array.dtype.kind in "fiu"]
    if all(map(is_flag, arrays)) and ranges(result, headlines).rows:
        arrays = []
    others = ranges(result.drop_vars([one.name for one in arrays]), headlines)
    made = [others] if others.rows else []
    if not arrays:
        return {"shared": _shared(result), "tables": made, "described": []} if made else {}
    dims = [str(dim) for dim in next(iter(result.data_vars.values())).dims if dim in common]
    return {
        "shared": _shared(result),
        "tables": [numbers(result, dims, arrays, "Results" if not made else "Numbers of the whole"), *made],
        "described": [
            (_name(one), "; ".join(str(one.attrs[key]) for key in ("long_name", "comment") if one.attrs.get(key)))
            for one in arrays
        ],
    }


def ranges(result: xr.Dataset, headlines: Collection[str] = ()) -> Table:
    """Table of the least, middle and greatest value of variables, those of `headlines` first."""
    known = [name for name in headlines if name in result.data_vars]
    arrays = [result[name] for name in dict.fromkeys((*known, *map(str, result.data_vars)))]
    rows: list[list[str]] = []
    left_out = 0
    for array in arrays:
        if not is_quantity(array):
            continue
        if array.size > MOST_NUMBERS or len(rows) == MOST_RANGES:
            left_out += 1
            continue
        # Of a copy, since what is read of a variable stays in memory with it, as a whole time series.
        values = np.asarray(printed(array.copy(deep=False)), dtype=float)
        values = values[np.isfinite(values)]
        if values.size:
            over = ", ".join(str(dim).replace("_", " ") for dim in array.dims)
            least, greatest = values.min(), values.max()
            ends = number_texts(np.array([least, np.median(values, overwrite_input=True), greatest]))
            rows.append([title_of(array), *ends, unit_of(array), over])
    notes = [f"{left_out} further {'variable is' if left_out == 1 else 'variables are'} in the data set."]
    header = ("", "least", "median", "greatest", "unit", "over")
    return Table("Ranges over the dimensions", header, rows, (0, 4, 5), notes * bool(left_out))


def numbers(
    result: xr.Dataset,
    dims: Sequence[str],
    arrays: Sequence[xr.DataArray],
    label: str,
    notes: Sequence[str] = (),
    digits: int = 3,
) -> Table:
    """Table of arrays over the swept dimensions alone, a row for each point of the sweep; names head the columns."""
    sizes = [result.sizes[dim] for dim in dims]
    points = math.prod(sizes)
    indices = list(itertools.islice(np.ndindex(*sizes), MOST_ROWS))
    known = [labels_along(result, dim) for dim in dims]
    labels = [[value_text(one[index[i]]) for index in indices] for i, one in enumerate(known)]
    columns = [_texts(array, _leading(array.transpose(*dims), indices), digits) for array in arrays]
    titles = [title_of(result[dim]) if dim in result.coords else dim.replace("_", " ") for dim in dims]
    return Table(
        label,
        [*titles, *map(_name, arrays)],
        list(zip(*labels, *columns, strict=True)),
        [*range(len(dims)), *(len(dims) + i for i, array in enumerate(arrays) if is_flag(array))],
        [f"The first {len(indices)} of {points:,} points; all are in the data set."] * (points > len(indices))
        + [*notes],
        [*("" for _ in dims), *map(unit_of, arrays)],
        ["new" if len(dims) > 1 and i and at[:-1] != indices[i - 1][:-1] else "" for i, at in enumerate(indices)],
    )


def _name(array: xr.DataArray) -> str:
    return str(array.name).replace("_", " ")


def _texts(array: xr.DataArray, values: np.ndarray, digits: int) -> list[str]:
    """Cells of one column: flags in words."""
    return [flag_text(array, value) for value in values] if is_flag(array) else number_texts(values, digits)


def number_texts(values: np.ndarray, digits: int = 3) -> list[str]:
    """Numbers of one column with the same decimals: none where all are whole or large, else so many digits.

    All below a thousandth have so many digits each, those below a ten-thousandth with powers of ten.
    """
    finite = values[np.isfinite(values)]
    largest = float(np.abs(finite).max()) if finite.size else 0.0
    if 0.0 < largest < 1e-3:
        return [f"{one:.{digits}g}".replace("-", MINUS) if math.isfinite(one) else number_text(one) for one in values]
    least = 0 if largest >= 10_000 else 1 if largest >= 1_000 else 2
    decimals = least if largest == 0.0 else min(8, max(least, digits - 1 - math.floor(math.log10(largest))))
    whole = finite.size > 0 and largest >= 1.0 and bool(np.all(finite == np.round(finite)))
    return [number_text(value, 0 if whole else decimals) for value in values]


def decimals_of(values: Sequence[float]) -> int:
    """Decimals by which the smallest of several changes has two digits."""
    finite = [abs(value) for value in values if math.isfinite(value) and value != 0]
    return min(8, max(2, 1 - math.floor(math.log10(min(finite))))) if finite else 2


def _leading(array: xr.DataArray, indices: Sequence[tuple[int, ...]]) -> np.ndarray:
    """Values at the first points, of which only the leading part of the array is read."""
    if not array.ndim:
        return np.atleast_1d(printed(array))
    part = array.isel({array.dims[0]: slice(0, indices[-1][0] + 1)})
    return printed(part).reshape(-1)[: len(indices)]


def _shared(result: xr.Dataset) -> str:
    """Coordinates that have one value, in words."""
    texts = [
        f"{title_of(one)} {value_text(one)}" if one.dtype.kind in "OU" else coordinate_text(one)
        for one in result.coords.values()
        if not one.ndim
    ]
    return f"Fixed: {', '.join(texts)}." if texts else ""


def headline(result: xr.Dataset, names: Collection[str]) -> str:
    """Range of one variable, in words, for the list of all studies; empty where the result has no numbers.

    It is the first of `names` that the result has; without any, the first variable with the fewest dimensions.
    """
    numbers = list(filter(is_quantity, result.data_vars.values()))
    known = [result[name] for name in names if name in result.data_vars]
    array = next(iter(known), min(numbers, key=lambda array: array.ndim, default=None))
    if array is None or array.size > MOST_NUMBERS:
        return ""
    values = np.asarray(printed(array), dtype=float)
    values = values[np.isfinite(values)]
    if not values.size:
        return f"{title_of(array)}: no value"
    unit = unit_of(array)
    space = "" if unit.startswith(DEGREE) else " "
    ends = dict.fromkeys(number_texts(np.array([values.min(), values.max()])))
    return f"{title_of(array)}: {' to '.join(ends)}{space}{unit}".rstrip()


def made(manifest: Mapping[str, Any]) -> list[tuple[str, str]]:
    """How the result was made and how long it took: pairs of a name and what it is."""
    if not manifest:
        return []
    result, environment = manifest["result"], manifest.get("environment", {})
    packages, commit = environment.get("packages", {}), environment.get("commit")
    others = [f"{name} {packages[name]}" for name in sorted(packages) if name != "heliosweep" and packages[name]]
    scheduler, workers = manifest.get("scheduler"), manifest.get("workers")
    evaluations = manifest.get("plan", {}).get("evaluations")
    pairs = [
        ("finished", manifest.get("finished")),
        ("study", manifest.get("study_id")),
        ("heliosweep", " ".join(filter(None, [packages.get("heliosweep"), commit and f"(commit {commit})"]))),
        ("Python", environment.get("python")),
        ("packages", ", ".join(others)),
        ("platform", environment.get("platform")),
        ("scheduler", f"{scheduler}, {workers} workers" if scheduler and workers else scheduler),
        ("evaluations", None if evaluations is None else f"{evaluations:,}"),
        ("time", ", ".join(f"{name} {seconds:.2f} s" for name, seconds in manifest.get("seconds", {}).items())),
        (result["file"], f"{result['bytes']:,} bytes" if "bytes" in result else None),
        ("sha256 of the file", result.get("sha256")),
        ("digest of the content", result.get("content_digest")),
    ]
    return [(name, what) for name, what in pairs if what]


def command(manifest: Mapping[str, Any]) -> str:
    """The command that makes the result again, without other studies that it ran; empty where nobody knows."""
    words, own = list(map(str, manifest.get("command", []))), PurePath(manifest.get("study_file", ""))
    studies = [word for word in words if word.endswith((".yaml", ".yml"))]
    others = [word for word in studies if PurePath(word) != own]  # which has no "./" in front
    return shlex.join(word for word in words if word not in others or len(others) == len(studies))


def references(result: xr.Dataset) -> list[str]:
    """Sources, each once: of two entries with the same DOI the longer one."""
    entries: dict[str, str] = {}
    for text in filter(None, (entry.strip() for entry in str(result.attrs.get("references", "")).split(";"))):
        found = DOI.search(text)
        key = found.group(1).lower() if found else text
        entries[key] = max(entries.get(key, ""), text, key=len)
    return list(entries.values())
