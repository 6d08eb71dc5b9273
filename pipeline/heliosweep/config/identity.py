"""What makes two studies the same: their canonical content and the files they name."""

from __future__ import annotations

import codecs
import datetime as dt
import hashlib
import json
import os
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import yaml

from heliosweep.config.block import Block
from heliosweep.config.distribution import Distribution
from heliosweep.config.faults import printable
from heliosweep.config.names import FileName
from heliosweep.config.source import scalar
from heliosweep.config.sweep import Listed, Range, Sweep
from heliosweep.config.times import DateList, DateRange
from heliosweep.errors import StudyError

if TYPE_CHECKING:
    from heliosweep.config.fields import Parameter
    from heliosweep.config.study import Study

MAX_BYTES = 512 * 2**20
"""Largest file that a study may name."""

Rewrite = Callable[["Parameter | None", Any], Any]
"""Returns what is to stand for the value of a field with this declaration."""


def plain(value: Any, rewrite: Rewrite = lambda _, entry: entry) -> Any:
    """Return a block or value as plain data that a study file may hold; keys that are not given are left out."""
    if isinstance(value, Block):
        declared = type(value)
        given = ((name, getattr(value, name)) for name in declared.model_fields)
        return {
            name: plain(rewrite(declared.parameter(name), entry), rewrite) for name, entry in given if entry is not None
        }
    if isinstance(value, Sweep | DateList | DateRange | Distribution):
        return plain(value.spec(), rewrite)
    if isinstance(value, dict):
        return {key: plain(entry, rewrite) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry, rewrite) for entry in value]
    return value.isoformat() if isinstance(value, dt.date) else value


def canonical(study: Study) -> dict[str, Any]:
    """Return what the numbers and labels of the result depend on, the same however it was written.

    Contents stand for named files; the names, without folders, only where files are swept, since they are then
    labels.

    Raises
    ------
    StudyError
        A named file cannot be read.
    """
    digests = {
        name: _digest(study, key, name)
        for key, names in study.files().items()
        if key.partition(".")[0] not in study.DOES_NOT_MATTER
        for name in names
    }

    def rewrite(parameter: Parameter | None, value: Any) -> Any:
        if isinstance(parameter, FileName):
            swept = isinstance(value, Sweep)
            return [[PurePath(name).name, digests[name]] for name in value.values()] if swept else digests[value]
        if isinstance(value, Listed):
            return _even(value)
        return _even_dates(value) if isinstance(value, DateList | DateRange) else value

    content = plain(study.model_copy(update=dict.fromkeys(study.DOES_NOT_MATTER)), rewrite)
    return content | {"zip": [list(dim.sweeps) for dim in study.dimensions() if len(dim.sweeps) > 1]}


def study_id(study: Study) -> str:
    """Return twelve hexadecimal digits of the SHA-256 of the canonical study.

    Raises
    ------
    StudyError
        A named file cannot be read.
    """
    text = json.dumps(canonical(study), sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def resolved_yaml(study: Study, relative_to: Path | None = None) -> str:
    """Return the study with all defaults as the text of a study file that loads to the same study.

    Parameters
    ----------
    study : Study
        The study.
    relative_to : Path, optional
        As for `resolved`.
    """
    return yaml.dump(resolved(study, relative_to), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100)


def resolved(study: Study, relative_to: Path | None = None) -> dict[str, Any]:
    """Return the study with all defaults as plain data that loads to the same study.

    Parameters
    ----------
    study : Study
        The study.
    relative_to : Path, optional
        Folder in which the text will be saved: file names are written as seen from there. Without it they stay as
        they were given, relative to the folder of the original study file.
    """

    def seen_from(folder: Path, name: str) -> str:
        path = study.resolve(name)
        seen = os.path.relpath(path, folder)
        if os.path.realpath(folder / seen) != os.path.realpath(path):  # ".." after a link to a folder is elsewhere
            seen = os.path.relpath(study.place_of(name), os.path.realpath(folder))
        return Path(seen).as_posix()

    def rewrite(parameter: Parameter | None, value: Any) -> Any:
        if relative_to is None or not isinstance(parameter, FileName):
            return value
        names = value.values() if isinstance(value, Sweep) else [value]
        seen = [seen_from(Path(relative_to), name) for name in names]
        return seen if isinstance(value, Sweep) else seen[0]

    return {key: entry for key, entry in plain(study, rewrite).items() if entry not in ("", [], {})}


def _even(values: Listed) -> Sweep:
    """Return a list of evenly spaced numbers as the range that it equals; any other list as it is."""
    if values.holds_names:
        return values
    same = Range(values.first, values.last, len(values))
    return same if same.values().tolist() == list(values.items) else values


def _even_dates(dates: DateList | DateRange) -> DateList | DateRange:
    """Return evenly spaced dates as a range, any others as a list."""
    days = dates.dates()
    steps = {(after - before).days for before, after in pairwise(days)}
    if len(steps) == 1 and min(steps) > 0:
        return DateRange(days[0], days[-1], steps.pop())
    return DateList(tuple(days))


def _digest(study: Study, key: str, name: str) -> str:
    """Return the SHA-256 of what a table says: without line ends, empty lines and comments."""
    try:
        with study.resolve(name).open("rb") as file:
            if os.fstat(file.fileno()).st_size > MAX_BYTES:  # checks of tables and images stop far below
                raise StudyError(study.problem(key, f"{printable(name)} is larger than {MAX_BYTES // 2**20} MiB"))
            digest, separator = hashlib.sha256(), b""
            for number, part in enumerate(file):
                for line in (part if number else part.removeprefix(codecs.BOM_UTF8)).splitlines():
                    if line.strip() and not line.startswith(b"#"):
                        digest.update(separator + line)
                        separator = b"\n"
    except OSError as error:
        raise StudyError(study.problem(key, f"cannot read {printable(name)}: {error.strerror}")) from None
    return digest.hexdigest()


class _Dumper(yaml.SafeDumper):
    """Writes what the strict reader accepts: no aliases, and quotes around text that looks like a number."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = None if isinstance(scalar(text), str) else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style)


_Dumper.add_representer(str, _text)
