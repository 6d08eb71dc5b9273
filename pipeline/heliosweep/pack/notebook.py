"""The notebook of an archive: the least that opens the data."""

from __future__ import annotations

import json
from typing import Any

from heliosweep.pack.described import Described


def notebook(described: Described) -> str:
    """open.ipynb, format 4.5, without outputs."""
    opening = "xr.open_zarr" if described.result.endswith(".zarr") else "xr.open_dataset"
    first = described.data[0].name
    cells = [
        _cell("markdown", f"# {described.title}\n\n{described.summary}\n\nNeeds xarray and "
              f"{'zarr' if described.result.endswith('.zarr') else 'netCDF4'}."),
        _cell("code", f'import xarray as xr\n\ndata = {opening}("{described.result}")\ndata'),
        _cell("markdown", "What each variable means:"),
        _cell("code", 'for name, values in data.data_vars.items():\n'
              '    units = values.attrs.get("units", "")\n'
              '    print(f"{name} [{units}] {tuple(values.dims)}: {values.attrs[\'long_name\']}")'),
        _cell("markdown", f"The values of `{first}`, as a table:"),
        _cell("code", f'data["{first}"].isel({{dim: slice(0, 5) for dim in data["{first}"].dims}}).to_series().head(20)'
              if described.data[0].dims else f'data["{first}"]'),
    ]  # fmt: skip
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"
    content = {
        "cells": cells,
        "metadata": {
            "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
            "language_info": {"name": "python"},
        },
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(content, indent=1, ensure_ascii=False, sort_keys=True) + "\n"


def _cell(kind: str, text: str) -> dict[str, Any]:
    cell: dict[str, Any] = {"cell_type": kind, "metadata": {}, "source": text.splitlines(keepends=True)}
    return cell | {"execution_count": None, "outputs": []} if kind == "code" else cell
