"""What a result, finished or not, belongs to, and how two such differ."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from heliosweep.config.study import Study
from heliosweep.store.fingerprint import code_versions

#: Global attributes that follow from the study and the code, which are compared by themselves.
_FOLLOWING = ("study", "study_id", "id", "history", "source")


def identity_of(study: Study, attributes: Mapping[str, Any]) -> dict[str, Any]:
    """What the bytes of a study's result depend on.

    Parameters
    ----------
    study : Study
        The study.
    attributes : mapping
        Global attributes of its result.

    Returns
    -------
    dict
        ``study_id`` and ``study``: its meaning; ``code``: versions of what computes it; ``output``: what is stored
        and how; ``attributes``: the words that go with it.
    """
    return {
        "study_id": study.study_id,
        "study": study.canonical(),
        "code": code_versions(),
        "output": study.output.model_dump(),
        "attributes": {name: value for name, value in attributes.items() if name not in _FOLLOWING},
    }


def changes(before: Any, after: Any, key: str = "") -> list[str]:
    """What is different between two pieces of plain data, one line for each key.

    Parameters
    ----------
    before, after : mapping, list or scalar
        As from JSON.
    key : str
        Dotted key of what is compared.

    Returns
    -------
    list of str
        As ``receiver.height: 60 -> 70``; empty where nothing is different.
    """
    if isinstance(before, Mapping) and isinstance(after, Mapping):
        keys = [*after, *(name for name in before if name not in after)]
        return [
            line
            for name in keys
            for line in changes(before.get(name), after.get(name), f"{key}.{name}" if key else str(name))
        ]
    if _plain(before) == _plain(after):
        return []
    return [f"{key}: {_words(before)} -> {_words(after)}"]


def listed(before: Any, after: Any, most: int = 3) -> str:
    """The first `changes`, in one line."""
    lines = changes(before, after)
    more = f", and {len(lines) - most} more" if len(lines) > most else ""
    return "; ".join(lines[:most]) + more


def _plain(value: Any) -> Any:
    """Tuples as lists, as JSON has them."""
    if isinstance(value, Mapping):
        return {str(name): _plain(entry) for name, entry in value.items()}
    return [_plain(entry) for entry in value] if isinstance(value, list | tuple) else value


def _words(value: Any) -> str:
    if value is None:
        return "not given"
    text = ", ".join(_flat(value)) if isinstance(value, Mapping) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _flat(value: Mapping[str, Any]) -> Iterator[str]:
    for name, entry in value.items():
        yield f"{name} {_words(entry)}"
