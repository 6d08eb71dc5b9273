"""Identity of studies: plain data, their canonical form, and digests of the files that they name."""

from __future__ import annotations

import codecs
import datetime as dt
import hashlib
import json
import os
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path, PurePath
from typing import Any

import yaml

from heliosweep.config.block import Block
from heliosweep.config.distribution import Distribution
from heliosweep.config.source import scalar
from heliosweep.config.sweep import Listed, Range, Sweep
from heliosweep.config.times import DateList, DateRange
from heliosweep.config.values import FileName, Parameter

MAX_BYTES = 512 * 2**20
"""Largest file that a study may name."""

Rewrite = Callable[[Parameter | None, Any], Any]
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


def canonical(block: Block, digests: Mapping[str, str]) -> dict[str, Any]:
    """Return a block as plain data that is the same however it was written.

    Parameters
    ----------
    block : Block
        Without what changes no number.
    digests : mapping of str to str
        By name of a file: what stands for it. Its name, without folders, stands beside it only where files are swept,
        since names are then labels.
    """

    def rewrite(parameter: Parameter | None, value: Any) -> Any:
        if isinstance(parameter, FileName):
            swept = isinstance(value, Sweep)
            return [[PurePath(name).name, digests[name]] for name in value.values()] if swept else digests[value]
        if isinstance(value, Listed):
            return _even(value)
        return _even_dates(value) if isinstance(value, DateList | DateRange) else value

    return plain(block, rewrite)


def fingerprint(content: Mapping[str, Any]) -> str:
    """Return twelve hexadecimal digits of the SHA-256 of plain data."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def resolved(block: Block, place_of: Callable[[str], str] = str) -> dict[str, Any]:
    """Return a block with all defaults as plain data that loads to the same block.

    Parameters
    ----------
    block : Block
        The block.
    place_of : callable
        Returns what stands for the name of a file.
    """

    def rewrite(parameter: Parameter | None, value: Any) -> Any:
        if not isinstance(parameter, FileName):
            return value
        return [place_of(name) for name in value.values()] if isinstance(value, Sweep) else place_of(value)

    return {key: entry for key, entry in plain(block, rewrite).items() if entry not in ("", [], {})}


def yaml_text(content: Mapping[str, Any]) -> str:
    """Return plain data as the text of a study file."""
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100)


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


def table_digest(path: Path) -> str:
    """Return the SHA-256 of what a table says: without line ends, empty lines and comments.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is too large.
    """
    with path.open("rb") as file:
        if os.fstat(file.fileno()).st_size > MAX_BYTES:  # checks of tables and images stop far below
            raise ValueError(f"is larger than {MAX_BYTES // 2**20} MiB")
        digest, separator = hashlib.sha256(), b""
        for number, part in enumerate(file):
            for line in (part if number else part.removeprefix(codecs.BOM_UTF8)).splitlines():
                if line.strip() and not line.startswith(b"#"):
                    digest.update(separator + line)
                    separator = b"\n"
    return digest.hexdigest()


class _Dumper(yaml.SafeDumper):
    """Writes what the strict reader accepts: no aliases, and quotes around text that looks like a number."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = None if isinstance(scalar(text), str) else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style)


_Dumper.add_representer(str, _text)
