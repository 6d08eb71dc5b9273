"""Load a study file: a validated study, or every problem at its line and column."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from typing import Any, TypeVar

from pydantic import ValidationError

from heliosweep.config.block import UNKNOWN_KEY, translate
from heliosweep.config.drawn import Drawn
from heliosweep.config.faults import Path, did_you_mean, one_of, shown
from heliosweep.config.layers import changed, file_names, with_base, with_patterns
from heliosweep.config.sample import bind_draws, sample_problems
from heliosweep.config.search import search_problems, with_search
from heliosweep.config.sites import with_weather_sites
from heliosweep.config.source import ESCAPED, Source, from_python, read
from heliosweep.config.study import Study
from heliosweep.config.sweep import TWICE
from heliosweep.errors import Problem, StudyError
from heliosweep.files import named_in

MAX_PROBLEMS = 100

StudyT = TypeVar("StudyT", bound=Study)


def load(
    path: str | os.PathLike[str],
    registry: Mapping[str, type[StudyT]],
    changes: Mapping[str, Any] | None = None,
    named: str = "",
) -> StudyT:
    """Load a study file.

    Parameters
    ----------
    path : path
        The study file.
    registry : mapping of str to type of Study
        The study class of each family, by name.
    changes, named
        Changed keys, as for `layers.changed`.

    Returns
    -------
    Study
        Validated and frozen, of the class of its family.

    Raises
    ------
    StudyError
        If the study is wrong: every problem found, at its line and column.
    """
    return validated(with_base(read(path), registry), registry, changes, named)


def load_mapping(
    data: Mapping[str, Any], registry: Mapping[str, type[StudyT]], changes: Mapping[str, Any] | None = None
) -> StudyT:
    """Make a study of a mapping, as :func:`load` does of a file; its file names count from the working directory.

    Values may also be arrays and numbers of NumPy, pandas or xarray, ranges, dates and paths.

    Raises
    ------
    StudyError
        If the study is wrong: every problem found, at its key.
    TypeError
        If `data` is not a mapping.
    """
    if not isinstance(data, Mapping):
        raise TypeError(f"a study is a mapping of keys to values, not {type(data).__name__}")
    return validated(with_base(Source(from_python(data)), registry), registry, changes)


def validated(
    source: Source,
    registry: Mapping[str, type[StudyT]],
    changes: Mapping[str, Any] | None = None,
    named: str = "",
) -> StudyT:
    """Return the validated study, with some keys changed. Raises StudyError with every problem found."""
    source = changed(source, changes, named) if changes else source
    problems = list(source.problems)
    study_class = _study_class(source, registry)
    source = with_patterns(source, study_class)
    if {"site", "sites"} & set(study_class.model_fields):
        source = with_weather_sites(source, problems)
    source = with_search(source, study_class, problems)
    found: list[Problem] = []
    try:
        study = study_class.model_validate(source.data)
    except ValidationError as error:
        found = list(islice(translate(error, study_class, source), MAX_PROBLEMS + 1))
    unknown = {problem.key for problem in found if problem.message.startswith(UNKNOWN_KEY)}
    empty = (source.problem(path, "is empty; write a value or remove the key") for path in _nulls(source.data))
    problems += [*found, *(problem for problem in islice(empty, MAX_PROBLEMS + 1) if problem.key not in unknown)]
    problems += islice(_missing_files(study_class, source), MAX_PROBLEMS + 1)
    if problems:
        raise _refusal(problems)
    study._source = source
    # Later checks may rely on earlier ones.
    for find in (search_problems, _shared_dimensions, _zip_problems, _repeats, sample_problems, _same_files):
        if problems := list(islice(find(study), MAX_PROBLEMS + 1)):
            raise _refusal(problems)
    bind_draws(study)
    if problems := list(study.check()):
        raise _refusal(problems)
    return study


def _study_class(source: Source, registry: Mapping[str, type[StudyT]]) -> type[StudyT]:
    """Return the study class of the family. Raises StudyError with the problems of the file."""
    family = source.data.get("family")
    if isinstance(family, str) and family in registry:
        return registry[family]
    if family is None:
        message = f"is missing: {one_of(registry)}"
    elif not isinstance(family, str):
        message = f"must be {one_of(registry)} (got {shown(family)})"
    else:
        hint = did_you_mean(family, registry) or f"; use {one_of(registry)}"
        message = f"unknown family{hint} (got {shown(family)})"
    raise _refusal([*source.problems, source.problem(("family",), message)])


def _nulls(data: Any, path: Path = ()) -> Iterator[Path]:
    if data is None:
        yield path
    elif isinstance(data, dict | list | tuple):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield from _nulls(value, (*path, key))


def _shared_dimensions(study: Study) -> Iterator[Problem]:
    """Yield the swept keys whose dimensions have the same name."""
    first: dict[str, str] = {}
    for key, name in study.dimension_names().items():
        if first.setdefault(name, key) != key:
            yield study.problem(key, f"would share the dimension '{name}' of the result with {first[name]}")


def _zip_problems(study: Study) -> Iterator[Problem]:
    """Yield the problems of the groups in `zip`."""
    sweeps, by_name = study.sweeps(), {name: key for key, name in reversed(study.dimension_names().items())}
    seen: set[str] = set()
    for i, group in enumerate(study.zip):
        keys = [entry if entry in sweeps else by_name.get(entry, "") for entry in group]
        for j, (entry, key) in enumerate(zip(group, keys, strict=True)):
            if not key:
                ends = [name for name in sweeps if name.endswith(f".{entry}")]
                hint = did_you_mean(ends[0] if ends else entry, [*sweeps, *by_name])
                hint = hint or "; list swept keys, such as site.latitude"
                yield study.problem(f"zip[{i}][{j}]", f"is not a swept key{hint} (got {shown(entry)})")
            elif key in seen:
                yield study.problem(f"zip[{i}][{j}]", f"is tied twice (got {shown(entry)})")
            seen.add(key)
        members = [key for key in keys if key]
        if len(group) < 2:
            yield study.problem(f"zip[{i}]", "must name at least two swept keys to tie together")
        elif len({isinstance(sweeps[key], Drawn) for key in members}) > 1:
            yield study.problem(f"zip[{i}]", "ties drawn keys to swept ones; tie drawn keys to each other")
        elif len({len(sweeps[key]) for key in members}) > 1:
            lengths = ", ".join(f"{key} has {len(sweeps[key])}" for key in members)
            yield study.problem(f"zip[{i}]", f"ties sweeps of different lengths: {lengths}")


def _repeats(study: Study) -> Iterator[Problem]:
    """Yield values that a list contains twice with the same values of the keys tied to it by `zip`."""
    for dim in study.dimensions():
        lists = {key: sweep.items() for key, sweep in dim.sweeps.items() if sweep.form is None}
        if len(lists) < len(dim.sweeps):
            continue  # ranges and draws contain no value twice
        first: dict[tuple[Any, ...], int] = {}
        rows = enumerate(zip(*lists.values(), strict=True))
        if again := next((row for row, values in rows if first.setdefault(values, row) != row), None):
            key, tied = next(iter(lists)), f" with the same {' and '.join([*lists][1:])}" * (len(lists) > 1)
            remedy = "" if tied else "; tie it to a key that differs by 'zip'"
            yield study.problem(f"{key}[{again}]", f"{TWICE}{tied}{remedy} (got {shown(lists[key][again])})")


def _same_files(study: Study) -> Iterator[Problem]:
    """Yield names of a list that mean the same file: saved elsewhere, both would be one name."""
    for key, names in study.files().items():
        paths = list(map(study.resolve, names))
        places = [(os.path.realpath(path.parent), path.name) for path in paths]
        for position, place in enumerate(places):
            if (first := places.index(place)) != position:
                message = f"is the same file as {shown(names[first])}; name each file once"
                yield study.problem(f"{key}[{position}]", f"{message} (got {shown(names[position])})")


def _missing_files(study_class: type[Study], source: Source) -> Iterator[Problem]:
    """Yield the named files that do not exist."""
    for path, name in file_names(study_class, source.data):
        try:
            if not os.path.isfile(named_in(source.directory, name)):  # noqa: PTH113 -- False for impossible names
                hint = "; write folders with '/'" if "\\" in name else ESCAPED if set("\n\t\r") & set(name) else ""
                message = f"no such file, looked for relative to the study file{hint} (got {shown(name)})"
                yield source.problem(path, message)
        except StudyError as error:  # a home folder that is not there
            yield source.problem(path, error.problems[0].message)


def _refusal(problems: Iterable[Problem]) -> StudyError:
    """Return the error that lists the problems by file and line, with the number of further problems last."""
    ordered = sorted(problems, key=lambda one: (one.unlisted > 0, one.file, one.line or 0, one.column or 0, one.key))
    if len(ordered) > MAX_PROBLEMS:
        rest = sum(problem.unlisted or 1 for problem in ordered[MAX_PROBLEMS:])
        more = Problem(f"and at least {rest} more problems", file=ordered[0].file, unlisted=rest)
        ordered = [*ordered[:MAX_PROBLEMS], more]
    return StudyError(ordered)
