"""The JSON Schema for editors takes what the loader takes: a search stands for the keys that it varies."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from heliosweep import StudyError, load
from heliosweep.config.schema import editor_schema
from heliosweep.families.family import families
from tests.conftest import SMALL

jsonschema = pytest.importorskip("jsonschema")
SCHEMA = editor_schema(families()["field_efficiency"].study_class())
CHECK = jsonschema.Draft202012Validator(SCHEMA)

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
    assert CHECK.is_valid(content)
    load(content)
    assert not CHECK.is_valid(content | {"search": {"over": {}}})


@pytest.mark.parametrize("family", families())
def test_it_is_a_schema(family):
    study_class = families()[family].study_class()
    schema = editor_schema(study_class)
    jsonschema.Draft202012Validator.check_schema(schema)


def test_a_changed_study_has_its_search_checked():
    study = load(searched("receiver.height", "receiver.height"))
    wrong = {"search.maximise": "field_optical_eficiency"}
    with pytest.raises(StudyError, match=r"search\.maximise: .*is no result of this study; did you mean"):
        study.with_(wrong)
    changed = study.with_({"search.budget": 20}).search
    assert changed is not None
    assert changed.budget == 20
