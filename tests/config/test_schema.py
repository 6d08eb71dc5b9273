"""The JSON Schema that editors use."""

from __future__ import annotations

import copy
from typing import Any

import pytest
import yaml

from heliosweep import StudyError, load
from heliosweep.config.schema import json_schema
from heliosweep.families.family import families
from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
from tests.conftest import SMALL

from .conftest import LINES

jsonschema = pytest.importorskip("jsonschema")
SCHEMA = json_schema(FieldEfficiencyStudy)
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
CHONG = yaml.safe_load("\n".join(LINES.values()))


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
        ("tracking", "spinning"),
        ("time", {"clock": "lunar"}),
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


ONE: dict[str, Any] = {**SMALL, "site": {"latitude": 35}, "tracking": "azimuth_elevation"}


def searched(without: str, *over: str) -> dict[str, Any]:
    """A study that lacks a key, and searches over some."""
    content = copy.deepcopy(ONE)
    *outer, last = without.split(".")
    block = content
    for name in outer:
        block = block[name]
    del block[last]
    bounds = {
        "heliostat.pivot_height": [4, 6],
        "receiver.height": [60, 90],
        "tracking": {"choice": ["azimuth_elevation", "spinning_elevation"]},
        "layout.radial_stagger.clearance": [13, 20],
    }
    search = {"maximise": "field_optical_efficiency", "over": {key: bounds[key] for key in over}, "budget": 80}
    return {**content, "search": search}


@pytest.mark.parametrize(
    ("without", "over"),
    [
        ("receiver.height", ("receiver.height",)),
        ("receiver", ("receiver.height",)),
        ("tracking", ("tracking",)),
        ("layout.radial_stagger.clearance", ("layout.radial_stagger.clearance",)),
        ("receiver.height", ("heliostat.pivot_height", "receiver.height")),
    ],
)
def test_keys_that_a_search_varies_may_be_missing(without, over):
    content = searched(without, *over)
    assert VALIDATOR.is_valid(content)
    load(content)


@pytest.mark.parametrize("family", families())
def test_it_is_a_schema(family):
    study_class = families()[family].study_class()
    schema = json_schema(study_class)
    jsonschema.Draft202012Validator.check_schema(schema)


def test_a_changed_study_has_its_search_checked():
    study = load(searched("receiver.height", "receiver.height"))
    wrong = {"search.maximise": "field_optical_eficiency"}
    with pytest.raises(StudyError, match=r"search\.maximise: .*is no result of this study; did you mean"):
        study.with_(wrong)
    changed = study.with_({"search.budget": 20}).search
    assert changed is not None
    assert changed.budget == 20
