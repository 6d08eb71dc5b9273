"""Read strict YAML as plain data, with the line and column of every key and value.

The YAML text is parsed event by event into mappings, lists and scalars only. Scalars follow the core schema of YAML
1.2, in which ``1e-3`` is a number, while ``no``, ``12:30`` and ``2021-06-21`` are strings.
"""

from __future__ import annotations

import codecs
import os
import pathlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import reduce
from operator import getitem
from typing import Any, NamedTuple, NoReturn

import numpy as np
import yaml

from heliosweep.config.faults import Path, in_short
from heliosweep.errors import Problem, StudyError
from heliosweep.files import user_path

#: Maximum nesting depth of a study file.
MAX_DEPTH = 50

_WORDS = {
    word: value
    for name, value in (("true", True), ("false", False), ("null", None))
    for word in (name, name.capitalize(), name.upper())
} | {"": None, "~": None}
#: Patterns of numbers in the core schema of YAML 1.2 (section 10.3.2), each with its conversion function.
_NUMBERS: tuple[tuple[re.Pattern[str], Any], ...] = (
    (re.compile(r"[-+]?[0-9]{1,20}"), int),
    (re.compile(r"0o[0-7]{1,20}|0x[0-9a-fA-F]{1,15}"), lambda text: int(text, 0)),
    (re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?"), float),
    (re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"), lambda text: float(text.replace(".", ""))),
)
#: Hint for Windows paths in double quotes.
ESCAPED = "; in double quotes, a backslash starts an escape sequence: in paths, use '/'"


class Place(NamedTuple):
    """Line and column, counted from 1 (0 if unknown), and the file name if the file is not the study file."""

    line: int
    column: int
    file: str | None = None


@dataclass(frozen=True)
class Source:
    """Contents of a study file as plain data, with the position of each part.

    Attributes
    ----------
    data : dict
        Mappings, lists and scalars of the study. Keys of mappings are strings.
    path : pathlib.Path or None
        The study file; None for a study built in Python.
    places : mapping of path to two Place
        Positions of the key and the value at each path. The two positions are equal for list entries.
    problems : tuple of Problem
        Problems that did not prevent the file from being read, such as duplicate keys.
    bases : tuple of pathlib.Path
        Included study files.
    """

    data: dict[str, Any]
    path: pathlib.Path | None = None
    places: Mapping[Path, tuple[Place, Place]] = field(default_factory=dict, repr=False)
    problems: tuple[Problem, ...] = ()
    bases: tuple[pathlib.Path, ...] = ()

    @property
    def directory(self) -> pathlib.Path:
        """Folder of the study file (default: working directory). File names are relative to this folder."""
        return self.path.parent if self.path else pathlib.Path()

    def value(self, path: Path) -> Any:
        """Return the data at `path`. Raises KeyError, IndexError or TypeError if the path does not exist."""
        data: Any = self.data
        return reduce(getitem, path, data)

    def path_of(self, key: str) -> Path:
        """Return the path of a key written as ``sites[0].latitude`` or ``sites.0.latitude``."""
        path: list[str | int] = []
        value: Any = self.data
        for part in key.replace("[", ".").replace("]", "").split("."):
            path.append(int(part) if isinstance(value, list | tuple) and part.isdecimal() else part)
            try:
                value = value[path[-1]]
            except (KeyError, IndexError, TypeError):
                value = None
        return tuple(path)

    def problem(self, path: Path, message: str, *, at_key: bool = False) -> Problem:
        """Return a problem at the position of the value at `path`, or of its key if `at_key` is True.

        If the file has no such path, the problem is located at the nearest enclosing key.
        """
        inner = path
        while inner and inner not in self.places:
            inner = inner[:-1]
        place = Place(1, 1) if self.path else Place(0, 0)
        if inner in self.places and (inner or not path):
            place = self.places[inner][0 if at_key or inner != path else 1]
        name = str(self.path or "") if place.file is None else place.file
        return Problem(message, dotted(path), name, place.line or None, place.column or None)


def read(path: str | os.PathLike[str]) -> Source:
    """Read a study file.

    Raises
    ------
    StudyError
        If the file cannot be read, is larger than 1 MiB, or is not YAML in UTF-8. The error is also raised for
        anchors, aliases, tags, control characters, multiple documents, and a top level that is not a mapping.
    """
    try:
        path = user_path(path)
    except TypeError:
        raise TypeError(f"a study must be the path of a study file or a mapping, not {type(path).__name__}") from None
    return parse(text_of(path, str(path), 2**20), path)


def text_of(path: pathlib.Path, name: str, most_bytes: int = 64 * 2**20, *, old: bool = False) -> str:
    """Return the text of a study file or a table. Messages refer to `name`.

    If `old` is True, text that is not UTF-8 is read as Latin-1. Raises StudyError if the file cannot be read, is larger
    than `most_bytes`, or is not UTF-8.
    """
    line, data, text, problem = None, b"", "", ""
    try:
        if path.exists() and not path.is_file():
            problem = "is a folder, not a file" if path.is_dir() else "is not a regular file"
        elif path.stat().st_size > most_bytes:
            problem = f"is larger than {most_bytes // 2**20} MiB: check that it is the right file"
        else:
            data = path.read_bytes()
            wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))  # the "Unicode text" format of Excel
            text = data.decode("utf-16" if wide else "utf-8-sig")
    except FileNotFoundError:
        whole = path.with_name(f"{path.name}.yaml")
        problem = f"there is no such file{f'; did you mean {whole}?' if whole.is_file() else ''}"
    except UnicodeDecodeError as error:
        text = data.decode("latin-1") if old else ""
        line = data[: error.start].count(b"\n") + 1
        problem = "" if old else "is not UTF-8 text: save it as UTF-8"
    except (OSError, ValueError) as error:
        problem = f"cannot be read: {getattr(error, 'strerror', error)}"
    if data.startswith(b"PK\x03\x04"):
        line, problem = None, "is a spreadsheet or an archive, not text: save the sheet as CSV (UTF-8)"
    elif "\0" in text:
        line, problem = text[: text.index("\0")].count("\n") + 1, "is a binary file, not text"
    if problem:
        raise StudyError(Problem(problem, file=name, line=line))
    return text


def from_python(value: Any) -> Any:
    """Convert the values of a study built in Python to plain data, as read from a study file.

    Arrays become lists, NumPy numbers become Python numbers, ranges and pandas tables become mappings, and paths become
    strings. Other values are returned unchanged.
    """
    if isinstance(value, Mapping):
        # Keys in a file are strings: {2: [0, -1]} has the key '2'.
        return {str(key) if type(key) is int else key: from_python(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [from_python(entry) for entry in value]
    if isinstance(value, range):  # do not expand a range, because it may be long
        return {"start": value[0], "stop": value[-1], "num": len(value)} if value else []
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "columns") and hasattr(value, "iloc"):  # a pandas table
        return {str(name): from_python(value[name]) for name in value.columns}
    if hasattr(value, "__array__"):
        array = np.asarray(value)
        # Nanosecond timestamps would be converted to integers.
        return (array.astype("datetime64[us]") if array.dtype.kind == "M" else array).tolist()
    # a sweep, a distribution or dates from another study
    return value.spec() if hasattr(value, "spec") else value


def parse(text: str, path: pathlib.Path) -> Source:
    """Parse the text of a study file. Messages refer to `path`. Raises StudyError like :func:`read`."""
    reader = _Reader(str(path))
    try:
        data = reader.document(yaml.parse(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader)))
    except yaml.MarkedYAMLError as error:
        place = _place(error.problem_mark) if error.problem_mark else Place(1, 1)
        lines = text.split("\n")
        reason = f"{error.problem or error.context}{ESCAPED * ('escape character' in str(error.problem))}"
        if lines[place.line - 1 : place.line] and lines[place.line - 1][place.column - 1 : place.column] == "\t":
            reason = "tabs cannot be used for indentation: use spaces"
        for number in (place.line - 1, place.line):
            glued = re.match(r"\s*(?:- +)?([A-Za-z_]\w*):[^\s/:]", "".join(lines[number - 1 : number]))
            if glued and "colon" not in reason:
                reason += f"; line {number} needs a space after the colon: '{glued[1]}: ...'"
        reader.refuse(f"not valid YAML: {reason}", place)
    except yaml.YAMLError as error:
        line = text.count("\n", 0, getattr(error, "position", 0)) + 1
        reader.refuse(f"not valid YAML: {getattr(error, 'reason', error)}", Place(line, 1))
    return Source(data, path, reader.places, tuple(reader.problems))


def dotted(path: Path) -> str:
    """Format a path for messages, as in ``sites[0].latitude``."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{in_short(str(part))}" for part in path).lstrip(".")


class _Reader:
    def __init__(self, name: str) -> None:
        self.name = name
        self.places: dict[Path, tuple[Place, Place]] = {}
        self.problems: list[Problem] = []

    def refuse(self, message: str, place: Place, at: Path = ()) -> NoReturn:
        raise StudyError([*self.problems, Problem(message, dotted(at), self.name, place.line, place.column)])

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

    def node(self, event: Any, events: Iterator[Any], at: Path, key: Place | None = None) -> Any:
        place = _place(event.start_mark)
        self.places[at] = (key or place, place)
        self.check(event, at)
        if isinstance(event, yaml.ScalarEvent):
            return scalar(event.value) if event.implicit[0] else event.value
        if len(at) >= MAX_DEPTH:
            self.refuse(f"nested more than {MAX_DEPTH} levels deep", place)
        if isinstance(event, yaml.SequenceStartEvent):
            items: list[Any] = []
            while not isinstance(event := next(events), yaml.SequenceEndEvent):
                items.append(self.node(event, events, (*at, len(items))))
            return items
        data: dict[str, Any] = {}
        while not isinstance(event := next(events), yaml.MappingEndEvent):
            self.check(event, at)
            place = _place(event.start_mark)
            if not isinstance(event, yaml.ScalarEvent):
                self.refuse("a key must be plain text", place, at)
            path: Path = (*at, event.value)
            if event.value in data:
                message = f"duplicate key (first on line {self.places[path][0].line})"
                self.problems.append(Problem(message, dotted(path), self.name, place.line, place.column))
                self.node(next(events), events, (*at, f"{event.value} (again)"))  # the first value is used
            else:
                data[event.value] = self.node(next(events), events, path, place)
        return data

    def check(self, event: Any, at: Path) -> None:
        place = _place(event.start_mark)
        if isinstance(event, yaml.AliasEvent) or event.anchor is not None:
            self.refuse("anchors (&) and aliases (*) are not allowed: write out the value", place, at)
        if event.tag is not None:
            self.refuse(f"tags are not allowed (got {in_short(event.tag)}): write the plain value", place, at)
        printable = "\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff"
        if isinstance(event, yaml.ScalarEvent) and (bad := re.search(f"[^{printable}]", event.value)):
            self.refuse(
                f"character U+{ord(bad[0]):04X} is not allowed, not even as an escape sequence{ESCAPED}", place, at
            )


def _place(mark: Any) -> Place:
    return Place(mark.line + 1, mark.column + 1)


def scalar(text: str) -> Any:
    """Return the value of an unquoted scalar according to the core schema of YAML 1.2."""
    if text in _WORDS:
        return _WORDS[text]
    return next((read(text) for form, read in _NUMBERS if form.fullmatch(text)), text)
