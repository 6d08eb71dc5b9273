"""Studies made of others: the study file that one includes, and keys that are given anew."""

from __future__ import annotations

import copy
import glob
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

INCLUDE = "include"
"""Key of the study file that a study builds on."""

OPTION = "--set"
"""Option of the command line that gives a key anew."""


def with_base(source: Source, registry: Mapping[str, type[Study]]) -> Source:
    """Return a study on top of the study file that it includes, which may include another.

    Blocks are joined key by key, any other value replaces that of the base, and ``null`` takes a key of the base away.
    Names of files in the base count from its folder. Raises StudyError for a base that cannot be read.
    """
    layers = [source]
    while INCLUDE in layers[-1].data:
        layers.append(_base_of(layers))
    families = [layer.data["family"] for layer in layers if "family" in layer.data]
    study_class = registry.get(families[0]) if families and isinstance(families[0], str) else None
    joined = layers.pop()
    while layers:
        above = layers.pop()
        moved = joined if study_class is None else _seen_from(above.directory, joined, study_class)
        joined = _joined(moved, above, study_class)
    return joined


def changed(source: Source, changes: Mapping[str, Any], named: str = "") -> Source:
    """Return a study in which keys have other values.

    Parameters
    ----------
    source : Source
        The study as it was written.
    changes : mapping of str to object
        Value by dotted key, such as ``receiver.height`` or ``sites[0].latitude``; None takes the key away.
    named : str
        What stands for the file in messages on these values.

    Raises
    ------
    StudyError
        A key lies in a list that has no such entry.
    """
    data, place = copy.deepcopy(source.data), Place(0, 0, named)
    keys, values = dict(source.keys), dict(source.values)
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
                keys[path[: depth + 1]] = place
            block = block[part]
        for places in (keys, values):
            for old in [old for old in places if old[: len(path)] == path]:
                del places[old]
        if value is None and isinstance(block, dict) and path[-1] in block:
            del block[path[-1]]
            continue
        keys[path] = values[path] = place
        block[path[-1]] = from_python(value)
    return replace(source, data=data, keys=keys, values=values)


def settings(texts: Iterable[str]) -> dict[str, Any]:
    """Return what texts like ``receiver.height=90`` give, values as in a study file. Raises StudyError."""
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
    """Return keys of the block `execution` as they are checked there; text is read as in a study file.

    Messages begin with `prefix` and the key. Raises StudyError with all that is wrong.
    """
    values = {name: _read(value) for name, value in given.items() if value is not None}
    try:
        asked = Execution.model_validate(values)
    except ValidationError as error:
        found = translate(error, Execution, Source(values))
        raise StudyError([Problem(problem.message, f"{prefix}{problem.key}") for problem in found]) from None
    return {name: getattr(asked, name) for name in values}


def file_names(study_class: type[Study], data: Any, path: Path = ()) -> Iterator[tuple[Path, str]]:
    """Yield place and name of each file that the data of a study name."""
    if isinstance(data, dict):
        blocks = blocks_at(study_class, path)
        for key, value in data.items():
            declared = (block.parameter(key) for block in blocks if key in block.model_fields)
            of_site = key == "file" and path[:1] in (("site",), ("sites",))  # a weather file may stand for a site
            if of_site or any(isinstance(parameter, FileName) for parameter in declared):
                places = [((*path, key), value)]
                if isinstance(value, list):
                    places = [((*path, key, position), name) for position, name in enumerate(value)]
                yield from ((place, name) for place, name in places if isinstance(name, str) and name.strip())
            else:
                yield from file_names(study_class, value, (*path, key))
    elif isinstance(data, list):
        for position, value in enumerate(data):
            yield from file_names(study_class, value, (*path, position))
    elif isinstance(data, str) and isinstance(path[-1], int):  # an entry of blocks that may be the name of its file
        listed = any(path[-2] in block.model_fields for block in blocks_at(study_class, path[:-2]))
        blocks = blocks_at(study_class, path)[: int(listed)]
        yield from ((path, data) for block in blocks if "file" in block.model_fields)


def with_patterns(source: Source, study_class: type[Study]) -> Source:
    """Return the study with lists of files for patterns such as ``layouts/*.csv``, and for a folder of layouts."""
    data = copy.deepcopy(source.data)
    for (*outer, key), name in file_names(study_class, source.data):
        path = source.directory / name
        folder = (outer, key) == (["layout"], "file") and path.is_dir()
        pattern = f"{glob.escape(name)}/*.csv" if folder else name
        if glob.has_magic(pattern) and isinstance(key, str) and not path.is_file():
            found = sorted(glob.glob(pattern, root_dir=source.directory))  # noqa: PTH207
            block: Any = data
            for part in outer:
                block = block[part]
            block[key] = found or name
    return replace(source, data=data)


def _read(value: Any) -> Any:
    """Value of text as in a study file; text that reads as null stays, for nobody asks for that."""
    found = scalar(value) if isinstance(value, str) else value
    return value if found is None else found


def _base_of(layers: list[Source]) -> Source:
    """Read the study file that the last of some studies includes."""
    last = layers[-1]
    name = last.data[INCLUDE]
    if not isinstance(name, str) or not name.strip():
        wanted = "must be the name of a study file, relative to this one"
        raise StudyError(last.problem((INCLUDE,), f"{wanted} (got {shown(name)})"))
    path = named_in(last.directory, name)
    try:
        found, before = path.is_file(), {layer.path.resolve() for layer in layers if layer.path}
        again = found and path.resolve() in before
    except (OSError, ValueError):
        found = again = False
    if not found:
        missing = "no such file, looked for relative to the study file"
        raise StudyError(last.problem((INCLUDE,), f"{missing} (got {shown(name)})"))
    if again:
        raise StudyError(last.problem((INCLUDE,), f"leads back to a file that includes this one (got {shown(name)})"))
    return read(path)


def _seen_from(folder: pathlib.Path, base: Source, study_class: type[Study]) -> Source:
    """Return a study whose names of files count from another folder."""
    data = copy.deepcopy(base.data)
    for path, name in file_names(study_class, data):
        if name.startswith((PVLIB, "~")) or pathlib.Path(name).is_absolute():
            continue
        inner: Any = data
        for part in path[:-1]:
            inner = inner[part]
        inner[path[-1]] = seen_from(folder, base.directory / name)
    return replace(base, data=data)


def _joined(base: Source, above: Source, study_class: type[Study] | None) -> Source:
    """Return a study with what stands in `above` in place of what stands in `base`."""
    replaced: set[Path] = set()

    def joined(below: dict[str, Any], given: dict[str, Any], at: Path) -> dict[str, Any]:
        together = dict(below)
        if at == ("layout",) and set(SOURCES) & set(given):  # another kind of layout
            together = {key: value for key, value in below.items() if key not in (*SOURCES, *GROUND) or key in given}
        for key, value in given.items():
            path: Path = (*at, key)
            old: Any = below.get(key)
            is_block = isinstance(value, dict) and isinstance(old, dict)
            if is_block and study_class is not None and blocks_at(study_class, path):
                together[key] = joined(old, value, path)
                continue
            replaced.add(path)
            if value is None and key in below:
                del together[key]
            else:
                together[key] = value
        return together

    data = joined(base.data, {key: value for key, value in above.data.items() if key != INCLUDE}, ())

    def places(below: Mapping[Path, Place], given: Mapping[Path, Place]) -> dict[Path, Place]:
        kept = {
            path: place if place.file is not None else place._replace(file=str(base.path))
            for path, place in below.items()
            if not any(path[:length] in replaced for length in range(1, len(path) + 1))
        }
        return kept | dict(given)

    assert base.path is not None
    return Source(
        data,
        above.path,
        places(base.keys, above.keys),
        places(base.values, above.values),
        (*above.problems, *base.problems),
        (*above.bases, base.path, *base.bases),
    )
