"""Studies made of others: the study file that one includes, and keys with other values."""

from __future__ import annotations

import copy
import glob
import os
import pathlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from pydantic import ValidationError

from heliosweep.config.block import blocks_at, translate
from heliosweep.config.execution import Execution
from heliosweep.config.faults import Path, in_short, shown
from heliosweep.config.layouts import GROUND, SOURCES
from heliosweep.config.source import Place, Source, from_python, parse, read, scalar
from heliosweep.config.study import Study
from heliosweep.config.values import FileName
from heliosweep.errors import Problem, StudyError
from heliosweep.files import PVLIB, named_in, seen_from

#: Key of the study file that a study builds on.
INCLUDE = "include"

#: Option of the command line that sets a key.
OPTION = "--set"


def with_base(source: Source, registry: Mapping[str, type[Study]]) -> Source:
    """Return a study on top of the study file that it includes, which may include another.

    Blocks are joined key by key, any other value replaces the value in the base, and ``null`` removes a key of the
    base. Names of files in the base count from its folder. Raises StudyError for a base that cannot be read.
    """
    layers = [source]
    while INCLUDE in layers[-1].data:
        layers.append(read(_base_path(layers)))
    families = [layer.data["family"] for layer in layers if "family" in layer.data]
    study_class = registry.get(families[0]) if families and isinstance(families[0], str) else None
    joined = layers.pop()
    while layers:
        joined = _joined(joined, layers.pop(), study_class)
    return joined


def changed(source: Source, changes: Mapping[str, Any], named: str = "") -> Source:
    """Return a study in which keys have other values.

    Parameters
    ----------
    source : Source
        The study as it was written.
    changes : mapping of str to object
        Value by dotted key, such as ``receiver.height`` or ``sites[0].latitude``; None removes the key.
    named : str
        Replaces the file name in messages on these values.

    Raises
    ------
    StudyError
        If a key is in a list that has no such entry.
    """
    data, places, place = copy.deepcopy(source.data), dict(source.places), Place(0, 0, named)
    for key, value in changes.items():
        path = replace(source, data=data).path_of(key)
        block: Any = data
        for depth, part in enumerate(path):
            if isinstance(block, list) and not (isinstance(part, int) and part < len(block)):
                raise StudyError(Problem(f"is a list of {len(block)}; name an entry of it, such as [0]", key, named))
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
    """Return the keys and values of texts such as ``receiver.height=90``. Raises StudyError."""
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
    """Return checked keys of the block `execution`; text is read as in a study file.

    Messages begin with `prefix` and the key. Raises StudyError with every problem.
    """
    values = {name: value for name, value in given.items() if value is not None}
    for name, value in values.items():
        if isinstance(value, str) and (read_value := scalar(value)) is not None:
            values[name] = read_value
    try:
        block = Execution.model_validate(values)
    except ValidationError as error:
        found = translate(error, Execution, Source(values))
        raise StudyError([Problem(problem.message, f"{prefix}{problem.key}") for problem in found]) from None
    return {name: getattr(block, name) for name in values}


def file_names(study_class: type[Study], data: Any, path: Path = ()) -> Iterator[tuple[Path, str]]:
    """Yield path and name of each file that the data of a study name."""
    blocks = blocks_at(study_class, path)
    if isinstance(data, dict):
        for key, value in data.items():
            declared = (block.parameter(key) for block in blocks if key in block.model_fields)
            if any(isinstance(parameter, FileName) for parameter in declared):
                names = [((*path, key), value)]
                if isinstance(value, list):
                    names = [((*path, key, position), name) for position, name in enumerate(value)]
                yield from ((place, name) for place, name in names if isinstance(name, str) and name.strip())
            else:
                yield from file_names(study_class, value, (*path, key))
    elif isinstance(data, list):
        for position, value in enumerate(data):
            yield from file_names(study_class, value, (*path, position))
    elif isinstance(data, str) and isinstance(path[-1], int):  # an entry of blocks that may be the name of its file
        listed = any(path[-2] in block.model_fields for block in blocks_at(study_class, path[:-2]))
        yield from ((path, data) for block in blocks[: int(listed)] if "file" in block.model_fields)


def with_patterns(source: Source, study_class: type[Study]) -> Source:
    """Return the study with lists of files instead of patterns such as ``layouts/*.csv`` and a folder of layouts."""
    source = replace(source, data=copy.deepcopy(source.data))
    for (*outer, key), name in list(file_names(study_class, source.data)):
        path = source.directory / name
        folder = (outer, key) == (["layout"], "file") and path.is_dir()
        pattern = f"{glob.escape(name)}/*.csv" if folder else name
        if glob.has_magic(pattern) and isinstance(key, str) and not path.is_file():
            found = sorted(glob.glob(pattern, root_dir=source.directory))  # noqa: PTH207
            source.value(tuple(outer))[key] = found or name
    return source


def _base_path(layers: list[Source]) -> pathlib.Path:
    """Return the path of the study file that the last of some studies includes. Raises StudyError."""
    last = layers[-1]
    name, message = last.data[INCLUDE], ""
    if not isinstance(name, str) or not name.strip():
        message = "must be the name of a study file, relative to this one"
    else:
        path = named_in(last.directory, name)
        if not os.path.isfile(path):  # noqa: PTH113 -- False for names that no file can have
            message = "no such file, looked for relative to the study file"
        elif path.resolve() in {layer.path.resolve() for layer in layers if layer.path}:
            message = "leads back to a file that includes this one"
    if message:
        raise StudyError(last.problem((INCLUDE,), f"{message} (got {shown(name)})"))
    return path


def _joined(base: Source, above: Source, study_class: type[Study] | None) -> Source:
    """Return the study `above` with the keys of `base` that it does not replace."""
    base = replace(base, data=copy.deepcopy(base.data))
    for path, name in list(file_names(study_class, base.data)) if study_class else ():
        if not name.startswith((PVLIB, "~")) and not pathlib.Path(name).is_absolute():
            base.value(path[:-1])[path[-1]] = seen_from(above.directory, base.directory / name)
    replaced: set[Path] = set()

    def joined(below: dict[str, Any], given: dict[str, Any], at: Path) -> dict[str, Any]:
        together = dict(below)
        if at == ("layout",) and {*SOURCES} & {*given}:  # another kind of layout
            together = {key: value for key, value in below.items() if key not in (*SOURCES, *GROUND) or key in given}
        for key, value in given.items():
            path: Path = (*at, key)
            blocks = isinstance(value, dict) and isinstance(below.get(key), dict)
            if blocks and study_class is not None and blocks_at(study_class, path):
                together[key] = joined(below[key], value, path)
                continue
            replaced.add(path)
            together[key] = value
            if value is None and key in below:
                del together[key]
        return together

    data = joined(base.data, {key: value for key, value in above.data.items() if key != INCLUDE}, ())
    kept = {
        path: tuple(place if place.file is not None else place._replace(file=str(base.path)) for place in both)
        for path, both in base.places.items()
        if not any(path[:length] in replaced for length in range(1, len(path) + 1))
    }
    problems, bases = (*above.problems, *base.problems), (*above.bases, *filter(None, [base.path]), *base.bases)
    return Source(data, above.path, {**kept, **above.places}, problems, bases)  # type: ignore[dict-item]
