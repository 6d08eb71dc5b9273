"""What a result belongs to, and how two such differ."""

from __future__ import annotations

import json

from heliosweep.store.identity import changes, identity_of, listed


def test_changes():
    before = {"a": {"b": 1, "c": [1, 2]}, "d": "x", "gone": None}
    assert changes(before, json.loads(json.dumps(before))) == []
    after = {"a": {"b": 2, "c": [1, 2]}, "d": "x", "e": {"f": 1}, "gone": None}
    assert changes(before, after) == ["a.b: 1 -> 2", "e: not given -> f 1"]
    assert changes(after, before) == ["a.b: 2 -> 1", "e: f 1 -> not given"]
    assert changes(1, 2, "a") == ["a: 1 -> 2"]
    assert changes({"a": (1, 2)}, {"a": [1, 2]}) == []
    assert changes({"a": "x" * 100}, {}) == [f"a: {'x' * 57}... -> not given"]


def test_listed():
    after = {str(number): number for number in range(5)}
    assert listed({}, after) == "0: not given -> 0; 1: not given -> 1; 2: not given -> 2, and 2 more"
    assert listed(after, after) == ""


def test_the_identity_is_that_of_the_bytes(small):
    """Execution is none of it; what follows from the study is not told twice."""
    attributes = {"title": "t", "study": "{}", "history": "now", "references": "r"}
    identity = identity_of(small(), attributes)
    other = identity_of(small(execution={"workers": 1, "scheduler": "synchronous"}), attributes)
    assert identity == other
    assert json.loads(json.dumps(identity)) is not None
    assert identity["attributes"] == {"title": "t", "references": "r"}
    assert identity["study_id"] == small().study_id
    changed = identity_of(small(receiver={"height": 61}), attributes)
    assert listed(identity["study"], changed["study"]) == "receiver.height: 60.0 -> 61.0"
