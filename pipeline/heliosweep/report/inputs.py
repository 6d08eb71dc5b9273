"""Table of the inputs of a result: swept, drawn and fixed keys, and the instants of the study."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePath
from typing import Any

from heliosweep.config.block import Block
from heliosweep.config.blocks import NamedSite
from heliosweep.config.distribution import Distribution
from heliosweep.config.drawn import Drawn
from heliosweep.config.study import Study
from heliosweep.config.sweep import Sweep
from heliosweep.config.values import Choice, FileName, Flag, Parameter, Quantity
from heliosweep.report.labels import DEGREE, number_text
from heliosweep.report.tables import Column, Table

#: Values that are listed one by one; of more the first and the last.
FEW = 6
#: Rows of the table.
MOST_ROWS = 60
#: Blocks that the table does not repeat: the time is in the dates and hours, the others change no number.
_ELSEWHERE = {"time", "family", "zip", "mode", *Study.DOES_NOT_MATTER}
_ORDER = ("searched", "swept", "drawn", "fixed")
_NO_UNIT = ("1", "")


def inputs(study: Study | None, covers: Sequence[tuple[str, str]]) -> Table | None:
    """Table of a study's inputs; None where nothing is known.

    Keys at their defaults are left out. `covers` are pairs of a name and what the result covers, from `coverage`.
    """
    rows = [[name, text, "", ""] for name, text in covers]
    if isinstance(study, Study):
        asked = (row for row, given in entries(study) if given)
        found = sorted(asked, key=lambda row: _ORDER.index(row[2].partition(",")[0]))
        rows = [row for row in found if not row[2].startswith("fixed")] + rows
        rows += [row for row in found if row[2].startswith("fixed")]
    if not rows:
        return None
    notes = [f"The first {MOST_ROWS} of {len(rows):,}; the study file has all."] * (len(rows) > MOST_ROWS)
    header = ("", "value", "", "key of the study")
    columns = [Column(head, [row[i] for row in rows[:MOST_ROWS]]) for i, head in enumerate(header)]
    return Table("Inputs", columns, [*notes, "Keys at their defaults are omitted."])


def entries(study: Study) -> Iterator[tuple[list[str], bool]]:
    """Row of each key of a study, and whether it is not at its default; searched keys with their bounds."""
    over: Mapping[str, Any] = study.search.over if study.search else {}
    for row, asked in _rows(study):
        *others, key = row
        if key in over:
            extent, declared = over[key], {name: one for name, one, _ in study.parameters()}[key]
            ends = (
                ", ".join(map(_text, extent["choice"])) if isinstance(extent, dict) else " to ".join(map(_text, extent))
            )
            others[1:] = f"{ends}{_after(declared)}", "searched"
        yield [*others, key], asked or key in over


def _rows(block: Block, prefix: str = "") -> Iterator[tuple[list[str], bool]]:
    for name, declared in type(block).model_fields.items():
        value, parameter, key = getattr(block, name), type(block).parameter(name), f"{prefix}{name}"
        if value is None or key in _ELSEWHERE:
            continue
        if isinstance(parameter, Quantity | Choice | FileName | Flag):
            text, how = _told(parameter, value)
            yield [parameter.title or _words(key), text, how, key], bool(value != declared.default)
        elif isinstance(value, Block):
            yield from _rows(value, f"{key}.")
        elif isinstance(value, tuple) and value and not isinstance(value[0], Block):
            count = f"{len(value)} {'entry' if len(value) == 1 else 'entries'}"
            one = _text(value) if len(value) <= FEW and not isinstance(value[0], tuple) else count
            yield [_words(key), one, "fixed", key], True
        elif isinstance(value, tuple):
            for number, item in enumerate(value[:FEW]):
                of = f", {item.name}" if isinstance(item, NamedSite) else ""
                yield from (([f"{row[0]}{of}", *row[1:]], given) for row, given in _rows(item, f"{key}[{number}]."))


def _words(key: str) -> str:
    return key.replace("_", " ").replace(".", ": ")


def _told(parameter: Parameter, value: Any) -> tuple[str, str]:
    """A value with its unit, and how it stands in the study."""
    after = _after(parameter)
    if isinstance(value, Distribution):
        first, second = map(_text, value.parts)
        spread = f"mean {first}, standard deviation {second}" if value.kind == "normal" else f"{first} to {second}"
        draws = f", {value.samples:,} draws" if value.samples else ""
        return f"{value.kind}, {spread}{after}", f"drawn{draws}"
    if isinstance(value, Drawn):
        return f"{value.words()}{after}", "drawn"
    if isinstance(value, Sweep):
        count = len(value)
        ends = [_text(one) for one in (value.values() if count <= FEW else (value.first, value.last))]
        text = ", ".join(ends) if count <= FEW else f"{ends[0]} to {ends[1]}"
        return f"{text}{after}", f"swept, {count:,} {'value' if count == 1 else 'values'}"
    return f"{_text(value)}{'' if isinstance(value, str) else after}", "fixed"


def _after(parameter: Parameter) -> str:
    """Unit of a value, as it is printed behind it."""
    unit = str(getattr(parameter, "unit", "1")).replace("m2", "m\N{SUPERSCRIPT TWO}")
    return DEGREE if unit == "deg" else "" if unit in _NO_UNIT else f"\N{NO-BREAK SPACE}{unit}"


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{value:g}".replace("-", "\N{MINUS SIGN}") if abs(value) < 1e6 else number_text(float(value), 0)
    if isinstance(value, tuple | list):
        return ", ".join(map(_text, value))
    return PurePath(str(value)).name if "/" in str(value) else str(value).replace("_", " ")
