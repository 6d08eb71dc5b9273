"""Families are found without being imported, and one that is broken leaves the others alone."""

from __future__ import annotations

import logging
import subprocess
import sys
from collections.abc import Iterator, Mapping
from importlib import metadata
from threading import Thread
from typing import Any

import pytest

from heliosweep.config.study import Study
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


OddStudy = type("OddStudy", (Study,), {"__annotations__": {"odd": Thread}})
#: A family with a key of a type that no study file can hold.
ODD = registry.Family("odd", "", OddStudy, None, example="")


def test_a_family_whose_blocks_cannot_be_built_is_left_out(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    entry = metadata.EntryPoint("odd", f"{__name__}:ODD", registry.GROUP)
    monkeypatch.setattr(registry, "_entries", lambda: {"odd": entry})
    assert registry.study_classes.__wrapped__().get("odd") is None
    assert "the family 'odd' cannot be loaded" in caplog.text


@pytest.mark.usefixtures("with_others")
def test_of_two_families_of_one_name_ours_is_used(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        assert registry.families()["dish_tracking"].name == "dish_tracking"
    assert caplog.messages == [
        "two families are named 'dish_tracking': heliosweep.families.dish_tracking:FAMILY is used, "
        "another_package:FAMILY is not"
    ]


def test_only_the_family_asked_for_is_imported() -> None:
    code = (
        "import sys\n"
        "from heliosweep.families.family import study_classes\n"
        "study_classes()['field_efficiency']\n"
        "assert 'heliosweep.families.dish_tracking' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_folders_are_named_like_their_families() -> None:
    assert all(family.name == name for name, family in registry.families().items())
