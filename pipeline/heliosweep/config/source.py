"""Strict YAML: plain data, and the line and column of every key and value.

The text is read event by event, so nothing is built from it but mappings, lists and scalars. Scalars follow
the core schema of YAML 1.2: ``1e-3`` is a number; ``no``, ``12:30`` and ``2021-06-21`` are text.
"""

from __future__ import annotations

import os
import pathlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, NoReturn

import numpy as np
import yaml

from heliosweep.config.faults import Path, in_short
from heliosweep.errors import Problem, StudyError
from heliosweep.files import user_path

MAX_BYTES = 2**20
MAX_DEPTH = 50
MAX_DUPLICATES = 99  # that are listed beside what stops the reading
MAX_VALUES = 50_000  # with keys; pydantic takes kilobytes for each that is wrong

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_WORDS = {
    word: value
    for name, value in (("true", True), ("false", False), ("null", None))
    for word in (name, name.capitalize(), name.upper())
} | {"": None, "~": None}
_INTEGER = re.compile(r"[-+]?[0-9]{1,20}")
_BASED = re.compile(r"0o[0-7]{1,20}|0x[0-9a-fA-F]{1,15}")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_LINE_END = re.compile("\r\n|[\n\r\x85\u2028\u2029]")  # as YAML counts lines
_GLUED = re.compile(r"\s*(?:- +)?([A-Za-z_]\w*):[^\s/:]")
#: Hint for Windows paths in double quotes.
ESCAPED = "; in double quotes a backslash starts an escape: write folders with '/'"
_NOT_PRINTABLE = re.compile("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


class Place(NamedTuple):
    """Line and column in a file, from 1, or 0 for none; the name of the file where it is not the study file."""

    line: int
    column: int
    file: str | None = None


@dataclass(frozen=True)
class Source:
    """A study as it was written: plain data and where each piece of it stands.

    Attributes
    ----------
    data : dict
        Mappings, lists and scalars of the study; the keys of all mappings are text.
    path : pathlib.Path or None
        The study file; None for a study built in Python.
    keys, values : mapping of path to Place
        Where the key, and the value, of each path stand.
    problems : tuple of Problem
        What was wrong with the file itself but did not stop the reading (duplicate keys).
    bases : tuple of pathlib.Path
        Study files that it includes.
    """

    data: dict[str, Any]
    path: pathlib.Path | None = None
    keys: Mapping[Path, Place] = field(default_factory=dict, repr=False)
    values: Mapping[Path, Place] = field(default_factory=dict, repr=False)
    problems: tuple[Problem, ...] = ()
    bases: tuple[pathlib.Path, ...] = ()

    @property
    def directory(self) -> pathlib.Path:
        """Folder from which the file names of the study count; the working directory for a study without a file."""
        return self.path.parent if self.path else pathlib.Path()

    def value(self, path: Path) -> Any:
        """Return the piece of data at `path`; KeyError, IndexError or TypeError if there is none."""
        value: Any = self.data
        for part in path:
            value = value[part]
        return value

    def path_of(self, key: str) -> Path:
        """Return the path of a key as written in messages: ``sites[0].latitude``, or ``sites.0.latitude``."""
        path: list[str | int] = []
        value: Any = self.data
        for part in key.replace("[", ".").replace("]", "").split("."):
            in_list = isinstance(value, list | tuple) and part.isdecimal()
            path.append(int(part) if in_list else part)
            try:
                value = value[path[-1]]
            except (KeyError, IndexError, TypeError):
                value = None
        return tuple(path)

    def problem(self, path: Path, message: str, *, at_key: bool = False) -> Problem:
        """Return a problem located at the value of `path` or, with `at_key`, at its key.

        Where the path does not stand in the file, the nearest enclosing key gives the place.
        """
        places = self.keys if at_key else self.values
        place = places.get(path)
        outer = path
        while place is None and outer:
            outer = outer[:-1]
            place = self.keys.get(outer)
        if place is None:
            place = Place(1, 1) if self.path else Place(0, 0)
        name = str(self.path or "") if place.file is None else place.file
        return Problem(message, dotted(path), name, place.line or None, place.column or None)


def read(path: str | os.PathLike[str]) -> Source:
    """Read a study file.

    Raises
    ------
    StudyError
        The file cannot be read, is over 1 MiB, is not UTF-8 or not YAML, or uses what study files do not
        allow: anchors and aliases, tags, control characters, several documents, more than 50 levels or 50,000
        keys and values, a top level that is not a mapping.
    """
    try:
        path = user_path(path)
    except TypeError:
        raise TypeError(f"a study is the path of a study file or a mapping, not {type(path).__name__}") from None
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        whole = path.with_name(f"{path.name}.yaml") if isinstance(error, FileNotFoundError) and path.name else None
        hint = f"; did you mean {whole}?" if whole and whole.is_file() else ""
        raise StudyError(Problem(f"cannot be read: {reason}{hint}", file=str(path))) from None
    if len(content) > MAX_BYTES:
        raise StudyError(Problem("is larger than 1 MiB; is this a study file?", file=str(path)))
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise StudyError(Problem("is not UTF-8 text; save the file as UTF-8", file=str(path), line=line)) from None
    return parse(text, path)


def from_python(value: Any) -> Any:
    """Return what a study built in Python holds as plain data, as it would stand in a file.

    Arrays and numbers of NumPy, pandas and xarray, ranges and paths become lists, numbers, mappings and text; what is
    plain already, or unknown, stays.
    """
    if isinstance(value, Mapping):
        # As in a file, where {2: [0, -1]} has the key '2'.
        return {str(key) if type(key) is int else key: from_python(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [from_python(entry) for entry in value]
    if isinstance(value, range):  # not expanded: it may be long
        return {"start": value[0], "stop": value[-1], "num": len(value)} if value else []
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "columns") and hasattr(value, "iloc"):  # a table of pandas
        return {str(name): from_python(value[name]) for name in value.columns}
    if hasattr(value, "__array__"):
        array = np.asarray(value)
        # Nanoseconds would become whole numbers.
        return (array.astype("datetime64[us]") if array.dtype.kind == "M" else array).tolist()
    return value


def parse(text: str, path: pathlib.Path) -> Source:
    """Read the text of a study file; `path` names it in messages. Raises StudyError as :func:`read`."""
    return _Reader(text, path).source()


def dotted(path: Path) -> str:
    """Write a path as in messages: ``sites[0].latitude``."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{in_short(str(part))}" for part in path).lstrip(".")


class _Reader:
    """Turns the events of one YAML document into plain data, noting where each piece stands."""

    def __init__(self, text: str, path: pathlib.Path) -> None:
        self.text = text
        self.path = path
        self.keys: dict[Path, Place] = {}
        self.values: dict[Path, Place] = {}
        self.problems: list[Problem] = []
        self.count = 0

    def source(self) -> Source:
        if bad := _NOT_PRINTABLE.search(self.text):
            before = _LINE_END.split(self.text[: bad.start()])
            self.refuse(f"character U+{ord(bad[0]):04X} is not allowed", Place(len(before), len(before[-1]) + 1))
        try:
            data = self.document(yaml.parse(self.text, _LOADER))
        except yaml.MarkedYAMLError as error:
            place = _place(error.problem_mark) if error.problem_mark else Place(1, 1)
            line = self.text.split("\n")[place.line - 1 : place.line]
            at_tab = bool(line) and line[0][place.column - 1 : place.column] == "\t"
            reason = "tabs cannot indent; use spaces" if at_tab else error.problem or error.context or "unreadable"
            reason = f"{reason}{self.glued(place.line)}{ESCAPED * ('escape character' in reason)}"
            self.refuse(f"not valid YAML: {reason}", place)
        except yaml.YAMLError as error:
            self.refuse(f"not valid YAML: {' '.join(str(error).split())}", Place(1, 1))
        return Source(data, self.path, self.keys, self.values, tuple(self.problems))

    def glued(self, number: int) -> str:
        """Return a hint where a line, or the one before, has a colon without a space after it."""
        for line in (number - 1, number):
            found = _GLUED.match("".join(self.text.split("\n")[line - 1 : line]))
            if found:
                return f"; line {line} needs a space after the colon: '{found[1]}: ...'"
        return ""

    def refuse(self, message: str, place: Place, at: Path = ()) -> NoReturn:
        raise StudyError(
            [*self.problems[:MAX_DUPLICATES], Problem(message, dotted(at), str(self.path), place.line, place.column)]
        )

    def document(self, events: Iterator[Any]) -> dict[str, Any]:
        next(events)  # the stream starts
        if not isinstance(next(events), yaml.DocumentStartEvent):
            self.refuse("the file is empty; a study starts with 'family: ...'", Place(1, 1))
        first = next(events)
        data = self.node(first, events, ())
        if not isinstance(data, dict):
            self.refuse("a study is a mapping of keys to values, such as 'family: ...'", _place(first.start_mark))
        next(events)  # the document ends
        if isinstance(event := next(events), yaml.DocumentStartEvent):
            self.refuse("only one study per file: remove the second document ('---')", _place(event.start_mark))
        return data

    def node(self, event: Any, events: Iterator[Any], at: Path) -> Any:
        place = _place(event.start_mark)
        self.values[at] = place
        self.refuse_unwanted(event, place, at)
        if isinstance(event, yaml.ScalarEvent):
            return scalar(event.value) if event.implicit[0] else event.value
        if len(at) >= MAX_DEPTH:
            self.refuse(f"nested more than {MAX_DEPTH} levels deep", place)
        if isinstance(event, yaml.SequenceStartEvent):
            items: list[Any] = []
            while not isinstance(event := next(events), yaml.SequenceEndEvent):
                items.append(self.node(event, events, (*at, len(items))))
            return items
        return self.mapping(events, at)

    def refuse_unwanted(self, event: Any, place: Place, at: Path) -> None:
        """Refuse what study files do not allow, whether it stands for a key or for a value."""
        self.count += 1
        if self.count > MAX_VALUES:
            self.refuse(f"holds more than {MAX_VALUES:,} keys and values; put long lists into a CSV table", place)
        if isinstance(event, yaml.AliasEvent) or event.anchor is not None:
            self.refuse("anchors (&) and aliases (*) are not allowed; write the value out", place, at)
        if event.tag is not None:
            self.refuse(f"tags are not allowed (got {in_short(event.tag)}); write the plain value", place, at)
        if isinstance(event, yaml.ScalarEvent) and (bad := _NOT_PRINTABLE.search(event.value)):
            self.refuse(f"character U+{ord(bad[0]):04X} is not allowed, also not as an escape{ESCAPED}", place, at)

    def mapping(self, events: Iterator[Any], at: Path) -> dict[str, Any]:
        data: dict[str, Any] = {}
        while not isinstance(event := next(events), yaml.MappingEndEvent):
            place = _place(event.start_mark)
            self.refuse_unwanted(event, place, at)
            if not isinstance(event, yaml.ScalarEvent):
                self.refuse("a key must be plain text", place, at)
            key: str = event.value
            path = (*at, key)
            if key in data:
                message = f"duplicate key (first on line {self.keys[path].line})"
                self.problems.append(Problem(message, dotted(path), str(self.path), place.line, place.column))
                self.node(next(events), events, (*at, f"{key} (again)"))  # the first value counts
                continue
            self.keys[path] = place
            data[key] = self.node(next(events), events, path)
        return data


def _place(mark: Any) -> Place:
    return Place(mark.line + 1, mark.column + 1)


def scalar(text: str) -> Any:
    """Return the value of an unquoted scalar, as the core schema of YAML 1.2 has it (section 10.3.2)."""
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text):
        return int(text)
    if _BASED.fullmatch(text):
        return int(text, 0)
    if _FLOAT.fullmatch(text):
        return float(text)
    if _NOT_FINITE.fullmatch(text):
        return float(text.replace(".", ""))
    return text
