"""The JSON Schema that editors use."""

import copy
from typing import Any

import pytest
import yaml

from heliosweep.config.study import json_schema
from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy

from .conftest import LINES

jsonschema = pytest.importorskip("jsonschema")
SCHEMA = json_schema(FieldEfficiencyStudy)
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
CHONG = yaml.safe_load("\n".join(LINES.values()))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("trakcing", "x"), ("receiver", {"height": 95, "hieght": 3}), ("receiver", {"height": 0}), ("family", "optics"),
        ("receiver", {"height": None}), ("receiver", {"height": {}}), ("receiver", {"height": []}),
        ("receiver", {"height": "95"}), ("site", {"latitude": 91}), ("site", {"latitude": [0, 91]}),
        ("tracking", "spinning"), ("time", {"clock": "lunar"}),
    ],
)  # fmt: skip
def test_rejects(key: str, value: Any) -> None:
    assert list(VALIDATOR.iter_errors(copy.deepcopy(CHONG) | {key: value}))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("receiver", {"height": "312 ft"}),
        ("receiver", {"height": {"start": "90 m", "stop": 100, "step": 5}}),
        ("receiver", {"height": {"logspace": {"start": 50, "stop": 200, "num": 5}}}),
        ("time", {"clock": "solar", "hours": 12, "declination": "0.1 rad"}),
        ("time", {"clock": "civil", "dates": ["2021-06-21"], "window": {"start": "07:00", "stop": "21:00", "step": 1}}),
        ("layout", {"file": ["a.csv", "b.csv"]}),
    ],
)
def test_accepts(key: str, value: Any) -> None:
    assert not list(VALIDATOR.iter_errors(CHONG | {key: value}))
