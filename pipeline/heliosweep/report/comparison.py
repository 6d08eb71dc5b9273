"""Computed against published: the tables of both, the verdicts, and what a page, a file and figures say of them."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import xarray as xr

from heliosweep.config.faults import one_of
from heliosweep.config.tables import HEADER, Column, read_table
from heliosweep.errors import Problem, StudyError
from heliosweep.report.claims import PLACES, Asked, ask, day_number, expected, is_date, labelled
from heliosweep.report.contents import Table
from heliosweep.report.labels import MINUS, axis_label, number_text, unit_of

#: File of a result folder with the comparison, from which the page can be made again.
FILE = "comparison.csv"

#: Largest table of published numbers.
MAX_BYTES, MAX_ROWS = 2 * 2**20, 10_000

#: Letters of the head of a column.
LONGEST_HEAD = 18

#: Attribute with which a result tells its figures what was published.
_ATTRIBUTE = "comparison"

#: Columns of `FILE` after those of the published table; columns of the page after the quantity and its coordinates.
_COMPUTED = ("computed", "difference", "verdict")
_STATED = ("stated_computed", "stated_verdict")
_SHOWN = ("computed", "published", "difference", "tolerance", "unit", "verdict")
_NEEDED = ("quantity", "published", "unit", "tolerance")

#: Columns of a table that are no coordinates of the result. Cells may be empty where `_row` says so.
_COLUMNS = {
    "quantity": Column("variable of the result", required=True),
    "published": Column("the number as it was printed", required=True),
    "unit": Column("its unit, such as 1, percent, deg or m", required=True),
    "tolerance": Column("by how much a computed one may differ", required=True),
    "claim": Column("figure, table or sentence of the publication"),
    "reason": Column("reason of the tolerance, or why nothing can be compared"),
    "computed": Column("what was computed, as the table states it"),
    "verdict": Column("the verdict, as the table states it"),
}

#: The verdicts, in the words that a table states them with.
AGREES, DIFFERS, APART = VERDICTS = ("agrees", "does not agree", "cannot be compared")


@dataclass(frozen=True)
class Comparison:
    """One published number or claim and what was computed.

    Parameters
    ----------
    quantity : str
        Variable of the result, or the difference of two; empty where nothing can be compared.
    where : dict of str to str
        Coordinates, as the table of published numbers writes them; one without an entry is left out.
    computed : float or str
        Value, or the date that a claim looks at; nothing is computed before `compare`. [`unit`]
    published : float
        The number; NaN where `expected` is no single one. [`unit`]
    tolerance : float
        By how much the two may differ. [`unit`]
    unit : str
        Unit, as ``1``, ``percent``, ``deg``, ``days``.
    decimals : int
        Decimals that were published.
    expected : str
        What was published, as it was printed; by default the number.
    claim, reason : str
        Where it stands in the publication; reason of the tolerance, or why nothing can be compared.
    stated_computed, stated_verdict : str
        What was computed and the verdict as the table states them; empty where it does not.
    line : int
        Line of the table, counted from 1.
    """

    quantity: str
    where: dict[str, str]
    computed: float | str
    published: float
    tolerance: float
    unit: str
    decimals: int
    expected: str = ""
    claim: str = ""
    reason: str = ""
    stated_computed: str = ""
    stated_verdict: str = ""
    line: int = field(default=0, compare=False)

    @property
    def text(self) -> str:
        """What was published, as it was printed."""
        return self.expected or f"{self.published:.{self.decimals}f}"

    @property
    def turn(self) -> bool:
        """Whether it is a direction, where 359 and 0 deg are neighbours."""
        return self.unit == "deg" and any(place in cell for cell in self.where.values() for place in PLACES)

    @property
    def difference(self) -> float:
        """Computed minus published, in `unit`, or in days; 0 within a bound or range, NaN where nothing is compared."""
        if not self.quantity:
            return math.nan
        return expected(self.text).difference(day_number(self.computed), self.turn)

    @property
    def agrees(self) -> bool:
        """Whether the difference is within the tolerance; a missing value never agrees."""
        return bool(self.quantity) and expected(self.text).holds(day_number(self.computed), self.tolerance, self.turn)

    @property
    def verdict(self) -> str:
        """``agrees``, ``does not agree`` or ``cannot be compared``."""
        return APART if not self.quantity else AGREES if self.agrees else DIFFERS

    @property
    def found(self) -> str:
        """What was computed, for readers."""
        if isinstance(self.computed, str):
            return self.computed
        if not math.isfinite(self.published):  # a bound or a range: nobody says how many decimals count
            return f"{self.computed:.4g}".replace("-", MINUS) if self.quantity else ""
        counts = math.ceil(-math.log10(self.tolerance)) if self.tolerance else 0
        return number_text(self.computed, max(self.decimals, counts) + 1)

    @property
    def surprise(self) -> str:
        """How a claim differs from what its table states; empty where it does not."""
        computed, verdict = self.stated_computed, self.stated_verdict
        if verdict and verdict != self.verdict:
            return (
                f"the table states {verdict!r}, but it {self.verdict if self.verdict != APART else 'has no quantity'}"
            )
        if not computed or not self.quantity:
            return ""
        if isinstance(self.computed, str):
            same = computed == self.computed
        else:
            digits = len(computed.lower().partition("e")[0].partition(".")[2])
            exponent = int(computed.lower().partition("e")[2] or 0)
            known = float(computed) if _is_number(computed) else math.nan
            same = abs(known - self.computed) <= 1.01 * 10.0 ** (exponent - digits)
        return "" if same else f"the table states that {computed} is computed, but {self.found} is"


@dataclass(frozen=True)
class Compared:
    """Published numbers in the order of their table, where they come from, and the name of the file, for messages."""

    values: list[Comparison]
    source: str
    file: str = field(default="", compare=False)

    @property
    def agrees(self) -> bool:
        """Whether all agree that can be compared."""
        return all(one.verdict != DIFFERS for one in self.values)

    @property
    def summary(self) -> str:
        """One line: how many numbers agree, and the largest difference of each unit."""
        largest, known = [], [one for one in self.values if one.quantity]
        for unit in dict.fromkeys(one.unit for one in known):
            differences = [abs(one.difference) for one in known if one.unit == unit]
            most = max(filter(math.isfinite, differences), default=math.nan)
            suffix = "" if unit == "1" else f" {unit}"
            largest.append(f"{most:.3f} percentage points" if unit == "percent" else f"{most:.3g}{suffix}")
        text = f"{sum(one.agrees for one in known)} of {len(known)} published values agree"
        text += f", largest difference {' and '.join(largest)}" if largest else ""
        apart = len(self.values) - len(known)
        return f"{text}, {apart} cannot be compared" if apart else text

    @property
    def surprises(self) -> list[str]:
        """What differs from what the table states."""
        known = [(one, one.surprise) for one in self.values]
        return [f"{one.claim or ' '.join([one.quantity, *one.where.values()])}: {said}" for one, said in known if said]

    @property
    def coordinates(self) -> list[str]:
        """Names of all coordinates that the numbers are chosen by."""
        return list(dict.fromkeys(name for one in self.values for name in one.where))

    def table(self, result: xr.Dataset) -> Table:
        """The table a person reads: quantity and coordinates, computed, published and verdict."""
        names = self.coordinates
        claims = any(one.claim for one in self.values)
        rows = []
        for one in self.values:
            what = [one.quantity.replace("_", " "), *(one.where.get(name, "").replace("_", "-") for name in names)]
            numbers = [
                one.found,
                number_text(one.published, one.decimals) if math.isfinite(one.published) else one.expected,
                number_text(one.difference, one.decimals + 1, signed=True) if one.quantity else "",
                f"{one.tolerance:g}" if one.quantity else "",
                "%" if one.unit == "percent" else one.unit,
            ]
            chosen = [f"{_title(result, name)} {text}" for name, text in zip(names, what[1:], strict=True) if text]
            about = "; ".join(filter(None, [what[0], ", ".join(chosen)]))
            rows.append([*([one.claim, about] if claims else what), *numbers, *[one.reason] * claims, one.verdict])
        texts = [
            i for i, name in enumerate(names, 1) if not all(map(_is_number, (v.where.get(name) for v in self.values)))
        ]
        heads = ["quantity", *(_title(result, name) for name in names), *_SHOWN]
        words = [0, *texts, len(heads) - 2, len(heads) - 1]
        if claims:
            heads, words = ["claim", "quantity compared", *_SHOWN[:-1], "reason", _SHOWN[-1]], [0, 1, 6, 7, 8]
        begins = [bool(i) and one.quantity != self.values[i - 1].quantity for i, one in enumerate(self.values)]
        kinds = {AGREES: "agrees", DIFFERS: "differs", APART: "apart"}
        return Table(
            "Computed and published",
            heads,
            rows,
            words,
            [
                "The difference is computed minus published, in percentage points where the unit is %. "
                "A number agrees where the difference is within the tolerance."
            ],
            classes=[f"{kinds[one.verdict]}{' new' * new}" for one, new in zip(self.values, begins, strict=True)],
        )


def read_published(path: Path, source: str = "", name: str = "") -> Compared:
    """Read published numbers from a CSV table.

    Parameters
    ----------
    path : pathlib.Path
        The table: columns ``quantity``, ``published``, ``unit`` and ``tolerance`` (in the same unit), perhaps
        ``claim``, ``reason``, ``computed`` and ``verdict``; every other column is a coordinate of the result.
    source : str
        Where the numbers were published.
    name : str
        Name of the file in messages; `path` by default.

    Raises
    ------
    StudyError
        The file cannot be read or is no such table; every problem found, each at its line.
    """
    file = name or str(path)
    table = read_table(
        path,
        file,
        _COLUMNS,
        others=True,
        most_bytes=MAX_BYTES,
        rows="published numbers",
        most_rows=MAX_ROWS,
        needs="a header and numbers",
    )
    texts = {key: table.texts(key) for key in table.header}
    if "claim" in texts and "reason" not in texts:
        table.add(f"needs a column reason: {_COLUMNS['reason'].meaning}", HEADER)
    values = []
    for row, line in enumerate(table.lines.tolist()):
        cells = {key: column[row] for key, column in texts.items()}

        def wrong(key: str, message: str, row: int = row) -> None:
            table.add(f"{key} {message}", row, key if key in texts else None)

        values.append(_row(cells, line, wrong))
    table.finish()
    return Compared(values, source, file)


def _row(cells: dict[str, str], line: int, wrong: Callable[[str, str], None]) -> Comparison:
    """One row of a table, of which `wrong` is told what does not hold."""
    quantity, printed, unit, tolerance = (cells[key] for key in ("quantity", "published", "unit", "tolerance"))
    claim, reason, verdict = (cells.get(key, "") for key in ("claim", "reason", "verdict"))
    where = {key: cell for key, cell in cells.items() if key not in _COLUMNS and cell}
    number, decimals, allowed = math.nan, 0, 0.0
    if not quantity:
        if not claim or not reason:
            wrong("quantity", "is empty" + "; a claim that cannot be compared has a reason" * bool(claim))
        for key in ("unit", "tolerance"):
            if cells[key] and claim:
                wrong(key, "must be empty where there is no quantity")
    elif not printed:
        wrong("published", "is empty")
    else:
        if not unit:
            wrong("unit", "is empty")
        try:
            number = expected(printed).number
        except ValueError as error:
            wrong("published", str(error))
        else:
            decimals = len(printed.lower().partition("e")[0].split()[-1].partition(".")[2])
            if unit and not tolerance and math.isfinite(number):
                wrong("tolerance", "is empty")
    if tolerance and not (_is_number(tolerance) and math.isfinite(allowed := float(tolerance)) and allowed >= 0):
        wrong("tolerance", f"must be a finite number of at least 0 (got {tolerance[:40]!r})")
    if claim and allowed and not reason:
        wrong("reason", "is empty: a tolerance needs one")
    if verdict and verdict not in VERDICTS:
        wrong("verdict", f"must be {one_of(VERDICTS)} (got {verdict[:40]!r})")
    stated = cells.get("computed", ""), verdict
    return Comparison(
        quantity, where, math.nan, number, allowed, unit, decimals, printed, claim, reason, *stated, line=line
    )


def compare(result: xr.Dataset, table: Compared) -> Compared:
    """Set published numbers against those of a result. Raises StudyError as `locate` does."""
    found = zip(table.values, locate(result, table), strict=True)
    return replace(
        table, values=[replace(one, computed=asked.computed(result)) if asked else one for one, asked in found]
    )


def locate(result: xr.Dataset, table: Compared) -> list[Asked | None]:
    """Find what published numbers ask for in a result, of which only coordinates are read.

    Raises
    ------
    StudyError
        Numbers that the result, or the lazy one of a study that has not run, does not have: unknown quantity or
        coordinate, or one that is missing; each at its line of the table.
    """
    found: list[Asked | None] = []
    problems = []
    for one in table.values:
        try:
            found.append(ask(result, one) if one.quantity else None)
        except ValueError as error:
            problems.append(Problem(str(error), file=table.file, line=one.line))
    if problems:
        raise StudyError(problems)
    return found


def _title(result: xr.Dataset, name: str) -> str:
    """Head of a column: what a coordinate is called, or its name where that is long and without a unit."""
    if name not in result.coords:
        return name
    words = axis_label(result[name])
    return words if len(words) <= LONGEST_HEAD or unit_of(result[name]) else name.replace("_", " ")


def _is_number(cell: str | None) -> bool:
    try:
        float(cell or 0)
    except ValueError:
        return False
    return True


def told(result: xr.Dataset, comparisons: Iterable[Comparison]) -> xr.Dataset:
    """The same result, which also tells the published numbers; figures read them with `published_in`."""
    return result.assign_attrs({_ATTRIBUTE: json.dumps([asdict(one) for one in comparisons])})


def published_in(result: xr.Dataset, quantity: str) -> list[Comparison]:
    """Published numbers of one quantity that a result was compared with; none where it was not."""
    known = [Comparison(**one) for one in json.loads(result.attrs.get(_ATTRIBUTE, "[]"))]
    return [one for one in known if one.quantity == quantity and math.isfinite(one.published) and _point(result, one)]


def _point(result: xr.Dataset, one: Comparison) -> bool:
    """Whether a published number is that of one point, and of no statistic."""
    return all(name not in result.coords or labelled(result[name], text).any() for name, text in one.where.items())


def comparison_csv(compared: Compared) -> str:
    """The comparison as the text of `FILE`: columns of the published table, and what was computed, in full digits."""
    names = compared.coordinates
    used = [name for name in ("claim", "reason") if any(getattr(one, name) for one in compared.values)]
    stated = [name for name in _STATED if any(getattr(one, name) for one in compared.values)]
    buffer = io.StringIO()
    buffer.writelines(f"# {line}\n" for line in compared.source.splitlines())
    table = csv.writer(buffer, lineterminator="\n")
    table.writerow([*used, *names, *_NEEDED, *_COMPUTED, *stated])
    for one in compared.values:
        tolerance, computed, difference = repr(one.tolerance), one.computed, repr(one.difference)
        written = [
            one.quantity,
            one.text,
            one.unit,
            tolerance,
            computed if isinstance(computed, str) else repr(computed),
        ]
        if not one.quantity:
            written[3:], difference = ["", ""], ""
        coordinates = [one.where.get(name, "") for name in names]
        row = [*(getattr(one, name) for name in used), *coordinates, *written, difference, one.verdict]
        table.writerow([*row, *(getattr(one, name) for name in stated)])
    return buffer.getvalue()


def read_comparison(path: Path) -> Compared:
    """Read back what `comparison_csv` wrote. Raises StudyError where the file is not such a table."""
    table = read_published(path)
    values = []
    try:
        for one in table.values:
            computed: float | str = one.stated_computed or math.nan
            if one.quantity and not is_date(one.text):
                computed = float(computed)
            where = {name: cell for name, cell in one.where.items() if name not in (*_COMPUTED, *_STATED)}
            number, verdict = (one.where.get(name, "") for name in _STATED)
            values.append(replace(one, computed=computed, where=where, stated_computed=number, stated_verdict=verdict))
        if not all(one.stated_verdict for one in table.values):
            raise ValueError
    except ValueError:
        message = "is no comparison that heliosweep wrote; remove it, or run the study again"
        raise StudyError(Problem(message, file=str(path))) from None
    comments = [line[1:].strip() for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("#")]
    return Compared(values, "\n".join(comments))
