"""The JSON Schema that editors use."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from heliosweep.config.schema import json_schema
from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy

CHONG = {
    "family": "field_efficiency",
    "title": "AE against SE sun tracking (Chong and Tan 2012, Table 2)",
    "site": {"latitude": [0, 15, 30]},
    "tracking": ["spinning_elevation", "azimuth_elevation"],
    "time": {
        "clock": "solar",
        "days": {"start": 1, "stop": 365, "step": 1},
        "hours": {"start": 8, "stop": 16, "step": 0.2},
        "sampling": "inclusive",
    },
    "layout": {"radial_stagger": {"clearance": 16, "zones": [{"start": 61.3, "rings": 4}]}},
    "heliostat": {"width": 11.1, "height": 11.1, "pivot_height": 7},
    "receiver": {"height": 95},
    "output": {"time_series": False},
}

jsonschema = pytest.importorskip("jsonschema")
SCHEMA = json_schema(FieldEfficiencyStudy)
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)


def test_is_a_valid_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert SCHEMA["$schema"] == "https://json-schema.org/draft/2020-12/schema"


def test_accepts_the_example() -> None:
    assert not list(VALIDATOR.iter_errors(CHONG))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("trakcing", "x"),
        ("receiver", {"height": 95, "hieght": 3}),
        ("receiver", {"height": 0}),
        ("receiver", {"height": None}),
        ("receiver", {"height": {}}),
        ("receiver", {"height": []}),
        ("receiver", {"height": "95"}),
        ("site", {"latitude": 91}),
        ("site", {"latitude": [0, 91]}),
        ("sites", [{"name": "a", "latitude": 1}]),
        ("tracking", "spinning"),
        ("time", {"clock": "lunar"}),
        ("layout", {}),
        ("family", "optics"),
    ],
)
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


def test_every_field_is_described_with_its_unit() -> None:
    blocks = [SCHEMA, *SCHEMA["$defs"].values()]
    fields = {name: field for block in blocks for name, field in block["properties"].items()}
    undescribed = [name for name, field in fields.items() if not field.get("description")]
    assert undescribed == ["family", "clock"]  # constants: the name says all
    assert fields["latitude"]["description"].endswith("[deg]")
    assert fields["memory"]["description"].endswith("[B]")
    assert "null" not in str(SCHEMA)
