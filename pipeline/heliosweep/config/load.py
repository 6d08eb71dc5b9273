"""Load study files, and report all problems with line and column numbers.

A study may include another study. Keys may be changed on the command line or in Python.
"""

from __future__ import annotations

import copy
import glob
import os
import pathlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import islice
from typing import Any, TypeVar

from pydantic import ValidationError

from heliosweep.config.blocks import GROUND, SOURCES, UNKNOWN_KEY, Execution, blocks_at, translate
from heliosweep.config.faults import Path, did_you_mean, in_short, one_of, shown
from heliosweep.config.sample import bind_draws, sample_problems, search_problems, with_search
from heliosweep.config.sites import with_weather_sites
from heliosweep.config.source import ESCAPED, Place, Source, from_python, parse, read, scalar
from heliosweep.config.study import Study
from heliosweep.config.values import TWICE, Drawn, FileName
from heliosweep.errors import Problem, StudyError
from heliosweep.files import PVLIB, named_in, seen_from

#: Key that specifies the included study file.
INCLUDE = "include"
#: Command-line option that sets a key.
OPTION = "--set"


def with_base(source: Source, registry: Mapping[str, type[Study]]) -> Source:
    """Return a study merged with the study files that it includes, directly or indirectly.

    Blocks are merged key by key. Any other value replaces the value in the included file, and ``null`` removes a key of
    the included file. File names in an included file are relative to its folder. Raises StudyError if an included file
    cannot be read.
    """
    layers = [source]
    while INCLUDE in layers[-1].data:
        last, path = layers[-1], pathlib.Path()
        name, message = last.data[INCLUDE], "must be the name of a study file, relative to this file"
        if isinstance(name, str) and name.strip():
            path, message = named_in(last.directory, name), ""
            if not os.path.isfile(path):  # noqa: PTH113 -- False for invalid file names
                message = "no such file, relative to the study file"
            elif path.resolve() in {layer.path.resolve() for layer in layers if layer.path}:
                message = "refers to a file that already includes this file"
        if message:
            raise StudyError(last.problem((INCLUDE,), f"{message} (got {shown(name)})"))
        layers.append(read(path))
    families = [layer.data["family"] for layer in layers if "family" in layer.data]
    study_class = registry.get(families[0]) if families and isinstance(families[0], str) else None
    joined = layers.pop()
    while layers:
        joined = _joined(joined, layers.pop(), study_class)
    return joined


def changed(source: Source, changes: Mapping[str, Any], named: str = "") -> Source:
    """Return a study with changed values.

    Parameters
    ----------
    source : Source
        Original study.
    changes : mapping of str to object
        Values by dotted key, such as ``receiver.height`` or ``sites[0].latitude``; None removes the key.
    named : str
        Text that replaces the file name in messages about changed values.

    Raises
    ------
    StudyError
        If a key contains an index that is out of range for its list.
    """
    data, places, place = copy.deepcopy(source.data), dict(source.places), Place(0, 0, named)
    for key, value in changes.items():
        path = replace(source, data=data).path_of(key)
        block: Any = data
        for depth, part in enumerate(path):
            if isinstance(block, list) and not (isinstance(part, int) and part < len(block)):
                raise StudyError(Problem(f"is a list of {len(block)} entries: specify one, such as [0]", key, named))
            if depth == len(path) - 1:
                break
            if isinstance(block, dict) and not isinstance(block.get(part), dict | list):
                block[part] = {}
                places[path[: depth + 1]] = (place, place)
            block = block[part]
        places = {old: where for old, where in places.items() if old[: len(path)] != path}
        if value is None and isinstance(block, dict) and path[-1] in block:
            del block[path[-1]]
        else:
            places[path] = (place, place)
            block[path[-1]] = from_python(value)
    return replace(source, data=data, places=places)


def settings(texts: Iterable[str]) -> dict[str, Any]:
    """Parse strings such as ``receiver.height=90`` into keys and values. Raises StudyError for other strings."""
    changes = {}
    for text in texts:
        key, _, value = (part.strip() for part in text.partition("="))
        if not key or not value:
            wanted = "must be KEY=VALUE, such as receiver.height=90"
            raise StudyError(Problem(f"{wanted} (got {shown(text)})", file=OPTION))
        try:
            found = parse(f"value: {value}", pathlib.Path(OPTION)).data
        except StudyError as error:
            raise StudyError(Problem(error.problems[0].message, in_short(key), OPTION)) from None
        if list(found) != ["value"]:
            raise StudyError(Problem("must be one value", in_short(key), OPTION))
        changes[key] = found["value"]
    return changes


def execution_keys(given: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Check and return keys of the `execution` block. Strings are parsed like values in a study file.

    Messages begin with `prefix` and the key. Raises a StudyError that lists all problems.
    """
    given = {name: value for name, value in given.items() if value is not None}
    read_values = {name: scalar(value) for name, value in given.items() if isinstance(value, str)}
    values = {**given, **{name: value for name, value in read_values.items() if value is not None}}
    try:
        block = Execution.model_validate(values)
    except ValidationError as error:
        found = translate(error, Execution, Source(values))
        raise StudyError([Problem(problem.message, f"{prefix}{problem.key}") for problem in found]) from None
    return {name: getattr(block, name) for name in values}


def file_names(study_class: type[Study], data: Any) -> Iterator[tuple[Path, str]]:
    """Yield the key path and the name of each file in the data of a study."""
    for path, name in _leaves(data):
        if not isinstance(name, str) or not name.strip():
            continue
        *outer, key = path[:-1] if isinstance(path[-1], int) else path
        blocks = [block for block in blocks_at(study_class, outer) if key in block.model_fields]
        # an entry of a list may be a file name instead of a block
        entries = blocks_at(study_class, path)[:1] if blocks and isinstance(path[-1], int) else []
        listed = any("file" in block.model_fields for block in entries)
        if listed or any(isinstance(block.parameter(str(key)), FileName) for block in blocks):
            yield path, name


def _leaves(data: Any, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    """Yield the path and the value of each entry of nested mappings and lists."""
    if not isinstance(data, dict | list | tuple):
        yield path, data
    else:
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield from _leaves(value, (*path, key))


def with_patterns(source: Source, study_class: type[Study]) -> Source:
    """Replace file patterns, such as ``layouts/*.csv``, and layout folders with lists of files."""
    source = replace(source, data=copy.deepcopy(source.data))
    for (*outer, key), name in list(file_names(study_class, source.data)):
        path = source.directory / name
        folder = (outer, key) == (["layout"], "file") and path.is_dir()
        pattern = f"{glob.escape(name)}/*.csv" if folder else name
        if glob.has_magic(pattern) and isinstance(key, str) and not path.is_file():
            found = sorted(glob.glob(pattern, root_dir=source.directory))  # noqa: PTH207
            source.value(tuple(outer))[key] = found or name
    return source


def _joined(base: Source, above: Source, study_class: type[Study] | None) -> Source:
    """Merge the study `above` with the study `base`. Values in `above` replace values in `base`."""
    base = replace(base, data=copy.deepcopy(base.data))
    for path, name in list(file_names(study_class, base.data)) if study_class else ():
        if not name.startswith((PVLIB, "~")) and not pathlib.Path(name).is_absolute():
            base.value(path[:-1])[path[-1]] = seen_from(above.directory, base.directory / name)
    replaced: set[Path] = set()
    given = {key: value for key, value in above.data.items() if key != INCLUDE}
    data = _merged(base.data, given, (), lambda path: bool(study_class and blocks_at(study_class, path)), replaced)
    kept = {
        path: tuple(place if place.file is not None else place._replace(file=str(base.path)) for place in both)
        for path, both in base.places.items()
        if not any(path[:length] in replaced for length in range(1, len(path) + 1))
    }
    problems, bases = (*above.problems, *base.problems), (*above.bases, *filter(None, [base.path]), *base.bases)
    return Source(data, above.path, {**kept, **above.places}, problems, bases)  # type: ignore[dict-item]


MAX_PROBLEMS = 100
StudyT = TypeVar("StudyT", bound=Study)


def load(
    path: str | os.PathLike[str],
    registry: Mapping[str, type[StudyT]],
    changes: Mapping[str, Any] | None = None,
    named: str = "",
    check: bool = True,
) -> StudyT:
    """Load a study file.

    Parameters
    ----------
    path : path
        The study file.
    registry : mapping of str to Study class
        Study classes by family name.
    changes, named
        Values by dotted key, and the text for messages about these values; see `changed`.
    check : bool
        If True, also check the files of the study and the relations between blocks.

    Returns
    -------
    Study
        Validated, immutable instance of the family's study class.

    Raises
    ------
    StudyError
        If the study is invalid. The message lists all problems with their lines and columns.
    """
    return validated(with_base(read(path), registry), registry, changes, named, check)


def load_mapping(
    data: Mapping[str, Any], registry: Mapping[str, type[StudyT]], changes: Mapping[str, Any] | None = None
) -> StudyT:
    """Create a study from a mapping.

    The mapping has the structure of a study file (see :func:`load`). Values may also be ranges, dates, paths, and
    arrays or numbers from NumPy, pandas and xarray. File names are relative to the working directory.

    Raises
    ------
    StudyError
        If the study is invalid. The message lists all problems with their keys.
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
    check: bool = True,
) -> StudyT:
    """Apply changes to a study, and return the validated study. Raises a StudyError that lists all problems."""
    source = changed(source, changes, named) if changes else source
    problems, family = list(source.problems), source.data.get("family")
    if not isinstance(family, str) or family not in registry:
        names = [*registry]  # imports all families
        message = f"unknown family{did_you_mean(str(family), names) or f'; use {one_of(names)}'} (got {shown(family)})"
        message = f"is missing: {one_of(names)}" if family is None else message
        _refuse([*problems, source.problem(("family",), message)])
    study_class = registry[str(family)]
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
    empty = (
        source.problem(path, "is empty: write a value, or remove the key")
        for path, value in _leaves(source.data)
        if value is None
    )
    problems += [*found, *(problem for problem in islice(empty, MAX_PROBLEMS + 1) if problem.key not in unknown)]
    problems += islice(_missing_files(study_class, source), MAX_PROBLEMS + 1)
    _refuse(problems)
    study._source = source
    # Later checks may depend on earlier checks.
    for find in (search_problems, _shared_dimensions, _zip_problems, _repeats, sample_problems, _same_files):
        _refuse(islice(find(study), MAX_PROBLEMS + 1))
    bind_draws(study)
    _refuse(study.check() if check else ())
    return study


def _merged(
    below: dict[str, Any], given: dict[str, Any], at: Path, is_block: Callable[[Path], bool], replaced: set[Path]
) -> dict[str, Any]:
    """Merge keys into a block. A null value removes a key. The paths of replaced values are added to `replaced`."""
    together = dict(below)
    if at == ("layout",) and {*SOURCES} & {*given}:  # the source of the layout changes
        together = {key: value for key, value in below.items() if key not in (*SOURCES, *GROUND) or key in given}
    for key, value in given.items():
        path: Path = (*at, key)
        if isinstance(value, dict) and isinstance(below.get(key), dict) and is_block(path):
            together[key] = _merged(below[key], value, path, is_block, replaced)
        else:
            replaced.add(path)
            together[key] = value
    removed = {key for key, value in given.items() if value is None and key in below}
    return {key: value for key, value in together.items() if key not in removed}


def _shared_dimensions(study: Study) -> Iterator[Problem]:
    first: dict[str, str] = {}
    for key, name in study.dimension_names().items():
        if first.setdefault(name, key) != key:
            yield study.problem(key, f"would share the result dimension '{name}' with {first[name]}")


def _zip_problems(study: Study) -> Iterator[Problem]:
    sweeps, names = study.sweeps(), study.dimension_names()
    by_name = dict(zip((*names.values(), *sweeps), (*names, *sweeps), strict=True))
    seen: set[str] = set()
    for i, group in enumerate(study.zip):
        keys = [by_name.get(entry, "") for entry in group]
        for j, (entry, key) in enumerate(zip(group, keys, strict=True)):
            if not key:
                meant = next((name for name in sweeps if name.endswith(f".{entry}")), entry)
                hint = did_you_mean(meant, [*sweeps, *by_name]) or ": list swept keys, such as site.latitude"
                yield study.problem(f"zip[{i}][{j}]", f"is not a swept key{hint} (got {shown(entry)})")
            elif key in seen:
                yield study.problem(f"zip[{i}][{j}]", f"is listed twice (got {shown(entry)})")
            seen.add(key)
        members = [key for key in keys if key]
        if len(group) < 2:
            yield study.problem(f"zip[{i}]", "must contain at least two swept keys to tie together")
        elif len({isinstance(sweeps[key], Drawn) for key in members}) > 1:
            yield study.problem(f"zip[{i}]", "ties drawn keys to swept keys: tie drawn keys only to each other")
        elif len({len(sweeps[key]) for key in members}) > 1:
            lengths = ", ".join(f"{key} has {len(sweeps[key])}" for key in members)
            yield study.problem(f"zip[{i}]", f"ties sweeps of different lengths: {lengths}")


def _repeats(study: Study) -> Iterator[Problem]:
    """Yield a problem for each dimension that has two points at which all swept keys are equal."""
    for dim in study.dimensions():
        lists = {key: sweep.items() for key, sweep in dim.sweeps.items() if sweep.form is None}
        if len(lists) < len(dim.sweeps):
            continue  # ranges contain no repeated values, and draws may repeat values
        first: dict[tuple[Any, ...], int] = {}
        rows = enumerate(zip(*lists.values(), strict=True))
        if again := next((row for row, values in rows if first.setdefault(values, row) != row), None):
            key, tied = next(iter(lists)), f" with the same {' and '.join([*lists][1:])}" * (len(lists) > 1)
            remedy = "" if tied else ": use 'zip' to tie it to a key with different values"
            yield study.problem(f"{key}[{again}]", f"{TWICE}{tied}{remedy} (got {shown(lists[key][again])})")


def _same_files(study: Study) -> Iterator[Problem]:
    """Yield a problem for each file that is listed twice, because a saved study contains one name for each file."""
    for key, names in study.files().items():
        places = [(os.path.realpath(path.parent), path.name) for path in map(study.resolve, names)]
        for position, place in enumerate(places):
            if (first := places.index(place)) != position:
                message = f"is the same file as {shown(names[first])}: list each file once"
                yield study.problem(f"{key}[{position}]", f"{message} (got {shown(names[position])})")


def _missing_files(study_class: type[Study], source: Source) -> Iterator[Problem]:
    for path, name in file_names(study_class, source.data):
        try:
            if not os.path.isfile(named_in(source.directory, name)):  # noqa: PTH113 -- False for invalid names
                hint = "; use '/' between folders" if "\\" in name else ESCAPED if set("\n\t\r") & set(name) else ""
                yield source.problem(path, f"no such file, relative to the study file{hint} (got {shown(name)})")
        except StudyError as error:  # the name contains an unknown home folder
            yield source.problem(path, error.problems[0].message)


def _refuse(problems: Iterable[Problem]) -> None:
    """Raise a StudyError with the first `MAX_PROBLEMS` problems, sorted by position, if there are problems."""
    ordered = sorted(problems, key=lambda one: (one.unlisted > 0, one.file, one.line or 0, one.column or 0, one.key))
    if len(ordered) > MAX_PROBLEMS:
        rest = sum(problem.unlisted or 1 for problem in ordered[MAX_PROBLEMS:])
        more = Problem(f"and at least {rest} more problems", file=ordered[0].file, unlisted=rest)
        ordered = [*ordered[:MAX_PROBLEMS], more]
    if ordered:
        raise StudyError(ordered)
