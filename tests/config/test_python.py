"""Studies built in Python: what NumPy, pandas and xarray hold reads as it would stand in a file."""

import copy
import datetime as dt
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
import yaml

from heliosweep.config.load import load_mapping
from heliosweep.config.values import even_range

from .conftest import LINES, REGISTRY

STUDY: dict[str, Any] = yaml.safe_load("\n".join(LINES.values()))


def made(key: str, value: Any) -> Any:
    data = copy.deepcopy(STUDY)
    block, _, name = key.partition(".")
    if name:
        data[block][name] = value
    else:
        data[block] = value
    return load_mapping(data, REGISTRY)


FOUR = {"start": np.int64(0), "stop": np.float64(9), "num": np.int64(4)}


@pytest.mark.parametrize(
    ("key", "plain", "values"),
    [
        ("site.latitude", 30, [np.float64(30), np.int8(30), np.array(30), xr.DataArray(30.0), np.str_("30 deg")]),
        ("site.latitude", [0, 15, 30], [range(0, 31, 15), np.array([0, 15, 30]), pd.Series([0, 15, 30])]),
        ("site.latitude", [0, 15], [pd.Index([0, 15]), xr.DataArray([0, 15]), (0, 15), [np.float32(0), np.int64(15)]]),
        ("site.latitude", [3], [range(3, 4)]),
        ("site.latitude", {"start": 0, "stop": 9, "num": 4}, [FOUR, even_range(0.0, 9.0, 4)]),
        ("tracking", ["spinning_elevation"], [np.array(["spinning_elevation"]), pd.Series(["spinning_elevation"])]),
        ("tracking", "spinning_elevation", [np.str_("spinning_elevation")]),
        ("output", {"time_series": True}, [{"time_series": np.True_}]),
    ],
)
def test_values(key: str, plain: Any, values: list[Any]) -> None:
    reference = made(key, plain).study_id
    assert [made(key, value).study_id for value in values] == [reference] * len(values)


@pytest.mark.parametrize(
    "dates",
    [
        dt.date(2021, 6, 21), dt.datetime(2021, 6, 21), pd.Timestamp("2021-06-21"), np.datetime64("2021-06-21"),
        np.datetime64("2021-06-21", "ns"), pd.date_range("2021-06-21", periods=1),
        {"start": pd.Timestamp("2021-06-21"), "stop": dt.date(2021, 6, 21)},
    ],
    ids=str,
)  # fmt: skip
def test_dates(dates: Any) -> None:
    data = copy.deepcopy(STUDY)
    data["site"] = {"latitude": 30, "longitude": 0}
    window = {"start": "08:00", "stop": "16:00", "step": 1}
    data["time"] = {"clock": "civil", "timezone": "UTC", "dates": dates, "window": window}
    assert load_mapping(data, REGISTRY).time.date_list() == [dt.date(2021, 6, 21)]  # type: ignore[union-attr]


@pytest.mark.parametrize("name", [Path, str, np.str_])
def test_paths(name: Callable[[Path], Any], tmp_path: Path) -> None:
    table = tmp_path / "a.csv"
    table.write_text("x,y\n0,50\n")
    assert made("layout", {"file": name(table)}).layout.file == str(table)
    assert made("layout", {"file": [name(table)]}).layout.file.values() == (str(table),)
