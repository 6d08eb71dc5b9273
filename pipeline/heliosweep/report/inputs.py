"""Table of the inputs of a result: searched, swept, drawn and fixed keys, and the instants of the study."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import PurePath
from typing import Any

from heliosweep.config.blocks import Block
from heliosweep.config.sites import NamedSite
from heliosweep.config.study import Study
from heliosweep.config.sweep import Drawn, Sweep
from heliosweep.config.times import CivilTime, SolarTime, WeatherTime
from heliosweep.config.values import Choice, Distribution, FileName, Flag, Parameter, Quantity
from heliosweep.report.labels import DEGREE, NO_BREAK_SPACE, number_text
from heliosweep.report.tables import Column, Table
from heliosweep.store import manifest as coverage

#: Maximum number of values that are listed; of more, the first and the last.
FEW = 6
#: Maximum number of rows of the table.
MOST_ROWS = 60
#: Blocks that the table omits: dates and hours replace the time, the others change no number.
_OMITTED = {"time", "family", "zip", "mode", *Study.DOES_NOT_MATTER}
_ORDER = ("searched", "swept", "drawn", "", "fixed")


def inputs(study: Study | None) -> Table | None:
    """Return the table of a study's inputs without keys at their defaults; None without a study."""
    if not isinstance(study, Study):
        return None
    rows = sorted(
        (row for row, is_set in entries(study) if is_set), key=lambda row: _ORDER.index(row[2].partition(",")[0])
    )
    notes = [f"The first {MOST_ROWS} of {len(rows):,}; the study file has all."] * (len(rows) > MOST_ROWS)
    header = ("", "value", "", "key of the study")
    columns = [Column(head, [row[i] for row in rows[:MOST_ROWS]]) for i, head in enumerate(header)]
    return Table("Inputs", columns, [*notes, "Keys at their defaults are omitted."])


def entries(study: Study) -> Iterator[tuple[list[str], bool]]:
    """Yield a row for each key of a study (name, value, kind, key), and whether it differs from its default."""
    time = getattr(study, "time", None)
    if isinstance(time, SolarTime | CivilTime):
        yield ["dates", coverage.dates(time), "", ""], True
        yield ["hours", coverage.hours(time), "", ""], True
    elif isinstance(time, WeatherTime):
        yield ["months", coverage.months(time), "", ""], True
    over: Mapping[str, Any] = study.search.over if study.search else {}
    declared = {key: parameter for key, parameter, _ in study.parameters()}
    for row, is_set in _rows(study):
        name, *_, key = row
        if key in over:
            ends = over[key]["choice"] if isinstance(over[key], dict) else over[key]
            text = (", " if isinstance(over[key], dict) else " to ").join(map(_text, ends))
            row = [name, f"{text}{_after(declared[key])}", "searched", key]
        yield row, is_set or key in over


def _rows(block: Block, prefix: str = "") -> Iterator[tuple[list[str], bool]]:
    for name, declared in type(block).model_fields.items():
        value, parameter, key = getattr(block, name), type(block).parameter(name), f"{prefix}{name}"
        words = key.replace("_", " ").replace(".", ": ")
        if value is None or key in _OMITTED:
            continue
        if isinstance(parameter, Quantity | Choice | FileName | Flag):
            yield [parameter.title or words, *_value(parameter, value), key], bool(value != declared.default)
        elif isinstance(value, Block):
            yield from _rows(value, f"{key}.")
        elif isinstance(value, tuple) and value and isinstance(value[0], Block):
            for number, item in enumerate(value[:FEW]):
                site = f", {item.name}" if isinstance(item, NamedSite) else ""
                for row, is_set in _rows(item, f"{key}[{number}]."):
                    yield [f"{row[0]}{site}", *row[1:]], is_set
        elif isinstance(value, tuple) and value:
            count = f"{len(value)} {'entry' if len(value) == 1 else 'entries'}"
            listed = len(value) <= FEW and not isinstance(value[0], tuple)
            yield [words, _text(value) if listed else count, "fixed", key], True


def _value(parameter: Parameter, value: Any) -> tuple[str, str]:
    """Return a value with its unit, and its kind: fixed, swept or drawn."""
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
        text = ", ".join(map(_text, value.values())) if count <= FEW else f"{_text(value[0])} to {_text(value[-1])}"
        return f"{text}{after}", f"swept, {count:,} {'value' if count == 1 else 'values'}"
    return f"{_text(value)}{'' if isinstance(value, str) else after}", "fixed"


def _after(parameter: Parameter) -> str:
    """Return the printed unit of a value."""
    unit = str(getattr(parameter, "unit", "1")).replace("m2", "m\N{SUPERSCRIPT TWO}")
    return DEGREE if unit == "deg" else "" if unit in ("1", "") else f"{NO_BREAK_SPACE}{unit}"


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{value:g}".replace("-", "\N{MINUS SIGN}") if abs(value) < 1e6 else number_text(float(value), 0)
    if isinstance(value, tuple | list):
        return ", ".join(map(_text, value))
    return PurePath(str(value)).name if "/" in str(value) else str(value).replace("_", " ")
