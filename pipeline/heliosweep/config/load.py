"""From a study file to a validated study, or to every problem in it at its line and column."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain, islice
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from heliosweep.config.block import Block, block_at
from heliosweep.config.faults import Path, did_you_mean, one_of, shown
from heliosweep.config.source import Source, read
from heliosweep.config.study import Study
from heliosweep.errors import Problem, StudyError

MAX_PROBLEMS = 100

Registry = Mapping[str, type[Study]]
"""The study class of each family, by name."""

_MESSAGES = {
    "model_type": "must be a mapping of keys to values",
    "model_attributes_type": "must be a mapping of keys to values",
    "dict_type": "must be a mapping of keys to values",
    "tuple_type": "must be a list",
    "list_type": "must be a list",
    "too_short": "must not be empty",
    "invalid_key": "keys must be text",
    "string_type": "must be text",
    "bool_type": "must be true or false",
    "int_type": "must be a whole number",
    "float_type": "must be a number",
}


def load(path: str | os.PathLike[str], registry: Registry) -> Study:
    """Load a study file.

    Parameters
    ----------
    path : path
        The study file.
    registry : mapping of str to type of Study
        The families.

    Returns
    -------
    Study
        Validated and frozen, of the class of its family.

    Raises
    ------
    StudyError
        With every problem found, each at its line and column.
    """
    return _validated(read(path), registry)


def load_mapping(data: Mapping[str, Any], registry: Registry) -> Study:
    """Make a study of plain data, as :func:`load` does of a file; file names count from the working
    directory.

    Raises
    ------
    StudyError
        With every problem found, each at its key.
    """
    return _validated(Source(dict(data)), registry)


def _validated(source: Source, registry: Registry) -> Study:
    problems = list(source.problems)
    study_class = _study_class(source, registry, problems)
    nulls = set(islice(_nulls(source.data), MAX_PROBLEMS + 1))
    problems += [source.problem(path, "nothing is given; write a value or remove the key") for path in nulls]
    study = None
    if study_class is not None:
        try:
            study = study_class.model_validate(source.data)
        except ValidationError as error:
            located = (_located(details, study_class, source) for details in error.errors(include_url=False))
            found = (problem for path, problem in located if path not in nulls and problem is not None)
            problems += islice(found, MAX_PROBLEMS + 1)
    if problems or study is None:
        raise _refusal(problems)
    study._source = source
    for problems_found in (chain(_zip_problems(study), _missing_files(study)), study.check()):
        if problems := list(islice(problems_found, MAX_PROBLEMS + 1)):
            raise _refusal(problems)
    return study


def _study_class(source: Source, registry: Registry, problems: list[Problem]) -> type[Study] | None:
    """Return the study class of the family, or note what is wrong with it."""
    family = source.data.get("family")
    if isinstance(family, str) and family in registry:
        return registry[family]
    if "family" not in source.data:
        problems.append(source.problem(("family",), f"is missing: {one_of(registry)}"))
    elif family is None:
        pass  # reported with everything else that is not given
    elif not isinstance(family, str):
        problems.append(source.problem(("family",), f"must be {one_of(registry)} (got {shown(family)})"))
    else:
        hint = did_you_mean(family, registry) or f"; use {one_of(registry)}"
        problems.append(source.problem(("family",), f"unknown family{hint} (got {shown(family)})"))
    return None


def _located(details: ErrorDetails, study_class: type[Study], source: Source) -> tuple[Path, Problem | None]:
    """Return where an error of pydantic stands and what it says in the words of this project.

    None for an error that only follows from others.
    """
    kind, context = details["type"], details.get("ctx", {})
    path = _path(details["loc"], source.data, keep_last=kind in ("missing", "extra_forbidden"))
    if kind == "extra_forbidden":
        block = block_at(study_class, details["loc"][:-1])
        known = block.model_fields if block else ()
        return path, source.problem(path, f"unknown key{did_you_mean(str(path[-1]), known)}", at_key=True)
    if kind == "missing":
        block = block_at(study_class, details["loc"][:-1])
        return path, source.problem(path, f"is missing{_purpose(block, str(path[-1]))}")
    if kind == "union_tag_not_found":
        path = (*path, context["discriminator"].strip("'"))
        return path, source.problem(path, "is missing")
    if kind == "union_tag_invalid":
        path = (*path, context["discriminator"].strip("'"))
        tags = [tag.strip(" '") for tag in context["expected_tags"].split(",")]
        message = f"must be {one_of(tags)}"
    elif kind in ("fault", "rule"):
        message = details["msg"]
    elif kind == "literal_error":
        message = f"must be {context['expected']}"
    else:
        message = _MESSAGES.get(kind, "is not valid here")
    if kind == "rule":
        return path, source.problem(path, message)
    if kind == "too_short" and source.value(path):
        return path, None  # its entries are at fault
    try:
        got = f" (got {shown(source.value(path))})"
    except (KeyError, IndexError, TypeError):
        got = ""
    return path, source.problem(path, f"{message}{got}")


def _path(location: tuple[int | str, ...], data: Any, *, keep_last: bool) -> Path:
    """Return the path in the file for a location of pydantic, which also names the chosen member of a union."""
    path: list[str | int] = []
    for position, part in enumerate(location):
        in_list = isinstance(data, list | tuple) and isinstance(part, int)
        if in_list or (isinstance(data, dict) and part in data):
            data = data[part]
            path.append(part)
        elif keep_last and position == len(location) - 1:
            path.append(part)
    return tuple(path)


def _purpose(block: type[Block] | None, key: str) -> str:
    """Return ``: what the key is for``."""
    if block is None:
        return ""
    parameter = block.parameter(key)
    text = parameter.purpose if parameter is not None else block.model_fields[key].description
    return f": {text}" if text else ""


def _nulls(data: Any, path: Path = ()) -> Iterator[Path]:
    if data is None:
        yield path
    elif isinstance(data, dict):
        for key, value in data.items():
            yield from _nulls(value, (*path, key))
    elif isinstance(data, list | tuple):
        for position, value in enumerate(data):
            yield from _nulls(value, (*path, position))


def _zip_problems(study: Study) -> Iterator[Problem]:
    """Yield what is wrong with the dimensions of the study and the groups in `zip`."""
    sweeps, names = study.sweeps(), study.dimension_names()
    by_name: dict[str, str] = {}
    for key, name in names.items():
        if name in by_name:
            yield study.problem(key, f"would share the dimension '{name}' of the result with {by_name[name]}")
        by_name.setdefault(name, key)
    seen: set[str] = set()
    for i, group in enumerate(study.zip):
        members = []
        for j, entry in enumerate(group):
            key = entry if entry in sweeps else by_name.get(entry, "")
            if not key:
                hint = did_you_mean(entry, [*sweeps, *by_name]) or "; list swept keys, such as site.latitude"
                yield study.problem(f"zip[{i}][{j}]", f"is not a swept key{hint} (got {shown(entry)})")
            elif key in seen:
                yield study.problem(f"zip[{i}][{j}]", f"is tied twice (got {shown(entry)})")
            else:
                seen.add(key)
                members.append(key)
        if len(group) < 2:
            yield study.problem(f"zip[{i}]", "must name at least two swept keys to tie together")
        elif len({len(sweeps[key]) for key in members}) > 1:
            lengths = ", ".join(f"{key} has {len(sweeps[key])}" for key in members)
            yield study.problem(f"zip[{i}]", f"ties sweeps of different lengths: {lengths}")


def _missing_files(study: Study) -> Iterator[Problem]:
    for key, names in study.files().items():
        for position, name in enumerate(names):
            try:
                found = study.resolve(name).is_file()
            except (OSError, ValueError):
                found = False
            if not found:
                place = f"{key}[{position}]" if len(names) > 1 else key
                yield study.problem(place, f"no such file, looked for relative to the study file (got {shown(name)})")


def _refusal(problems: Iterable[Problem]) -> StudyError:
    """Return the error that lists the problems in the order of the file."""
    ordered = sorted(problems, key=lambda problem: (problem.line or 0, problem.column or 0, problem.key))
    if len(ordered) > MAX_PROBLEMS:
        more = Problem(f"and at least {len(ordered) - MAX_PROBLEMS} more problems", file=ordered[0].file)
        ordered = [*ordered[:MAX_PROBLEMS], more]
    return StudyError(ordered)
