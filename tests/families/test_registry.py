"""Families are found without being imported, and one that is broken leaves the others alone."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from importlib import metadata
from typing import Any

import pytest

from heliosweep.families import family as registry

ENTRIES = [
    ("toy", "heliosweep.families.field_efficiency:FAMILY"),
    ("broken", "there_is_no_such_package:FAMILY"),
    ("dish_tracking", "another_package:FAMILY"),
]
CACHED = (registry.families, registry.study_classes, registry._entries)


@pytest.fixture
def with_others(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Other packages add families."""
    entries = [metadata.EntryPoint(name, value, registry.GROUP) for name, value in ENTRIES]
    monkeypatch.setattr(metadata, "entry_points", lambda group: entries if group == registry.GROUP else [])
    for function in CACHED:
        function.cache_clear()
    yield
    for function in CACHED:
        function.cache_clear()


@pytest.mark.usefixtures("with_others")
@pytest.mark.parametrize("found", [registry.families, registry.study_classes])
def test_a_broken_family_leaves_the_others_alone(found: Any, caplog: pytest.LogCaptureFixture) -> None:
    known: Mapping[str, Any] = found()
    assert known["toy"]
    assert "broken" not in caplog.text
    assert known.get("broken") is None
    assert (
        "the family 'broken' cannot be loaded from there_is_no_such_package:FAMILY: ModuleNotFoundError" in caplog.text
    )
    *ours, other = known
    assert other == "toy"
    assert ours == sorted(ours)
    assert {"dish_tracking", "field_efficiency", "misalignment"} <= set(ours)
    assert len(known) == len(ours) + 1
    assert caplog.text.count("cannot be loaded") == 1
    with pytest.raises(KeyError, match="nothing"):
        known["nothing"]


@pytest.mark.usefixtures("with_others")
def test_of_two_families_of_one_name_ours_is_used(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        assert registry.families()["dish_tracking"].name == "dish_tracking"
    assert caplog.messages == [
        "two families are named 'dish_tracking': heliosweep.families.dish_tracking:FAMILY is used, "
        "another_package:FAMILY is not"
    ]
