"""The index of papers in `studies/README.md`, made of the tables of published numbers: ``make index``.

Each table states what its study computed and the verdict. ``make index`` takes both from the results in ``outputs/``,
where the study was run, and writes the index of all tables. The tests ask whether the statements still hold.
"""

from __future__ import annotations

import csv
import io
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import xarray as xr

from heliosweep import api
from heliosweep.config.study import Study
from heliosweep.errors import HeliosweepError
from heliosweep.report.comparison import AGREES, DIFFERS, Compared, Comparison, compare, read_published
from heliosweep.results import open_result, result_folder

ROOT = Path(__file__).resolve().parents[2]
STUDIES = ROOT / "studies"
README = STUDIES / "README.md"
BEGIN, END = "<!-- index of papers: written by `make index` -->\n", "<!-- end of the index -->\n"

#: Fewer rows of one claim are shown value by value.
FEW = 4

#: Units of a difference.
FAR = {"1": "", "percent": "percentage points"}


@dataclass(frozen=True)
class Claims:
    """The study of a table, and the table."""

    study: Study
    name: str
    table: Compared

    @property
    def path(self) -> Path:
        """File of the table."""
        return STUDIES / self.table.file

    @property
    def paper(self) -> str:
        """Authors and year."""
        return re.split(r"(?<=\(\d{4}\))", self.table.source)[0]

    def claim(self, one: Comparison) -> str:
        """What a row is of the paper; in a table without claims, what the study says of the whole table."""
        return one.claim or self.table.source.rpartition(", ")[2]

    def compared(self) -> Compared:
        """Compute what the table asks for, and set it against the table."""
        result = api.build(self.study)
        asked = {name for one in self.table.values if one.quantity for name in one.quantity.split(" - ")}
        return compare(result.assign(xr.Dataset({name: result[name] for name in asked}).compute()), self.table)


def claims() -> Iterator[Claims]:
    """All studies with a table of published numbers."""
    for path in sorted(STUDIES.glob("*.yaml")):
        study = api.load(path)
        if (published := study.report.published) is not None:
            yield Claims(
                study, path.stem, read_published(study.resolve(published.file), published.source, published.file)
            )


def stated(one: Comparison) -> Comparison:
    """The same, with what the table states as what was computed."""
    number = one.unit and not re.match(r"\d{4}-\d{2}", one.stated_computed)
    return replace(one, computed=float(one.stated_computed or "nan") if number else one.stated_computed)


def update(path: Path, found: Compared) -> None:
    """State in a table what was computed and the verdicts."""
    lines = path.read_text(encoding="utf-8").splitlines()
    header = next(number for number, line in enumerate(lines) if line and not line.startswith("#"))
    names = next(csv.reader([lines[header]]))
    names += [name for name in ("computed", "verdict") if name not in names]
    rows = {header: dict(zip(names, names, strict=True))}
    for one in found.values:
        cells = dict(zip(names, [*next(csv.reader([lines[one.line - 1]])), "", ""], strict=False))
        rows[one.line - 1] = cells | {"computed": one.found.replace("\N{MINUS SIGN}", "-"), "verdict": one.verdict}
    for number, cells in rows.items():
        buffer = io.StringIO()
        csv.writer(buffer, lineterminator="").writerow([cells[name] for name in names])
        lines[number] = buffer.getvalue()
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def index(found: list[Claims]) -> str:
    """The index: for each paper a table of its figures, tables and claims."""
    parts = []
    for paper in dict.fromkeys(one.paper for one in found):
        rows = [(of.claim(one), of, one) for of in found if of.paper == paper for one in of.table.values]
        rows.sort(key=lambda row: (_natural(row[0]), row[1].name))
        lines = [f"### {paper}\n", "| Claim | Study | Here | Published | Tolerance and reason | Verdict |"]
        lines.append("|---|---|---|---|---|---|")
        for (claim, name), group in groupby(rows, key=lambda row: (row[0], row[1].name)):
            ones = [stated(one) for _, _, one in group]
            cells = [claim, f"`{name}`", *(_single(ones[0]) if len(ones) == 1 else _several(ones))]
            lines.append(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |")
        parts.append("\n".join(lines))
    return "\n\n".join(parts) + "\n"


def _natural(text: str) -> list[tuple[int, str]]:
    return [(int(piece or 0), "") if piece.isdigit() else (0, piece) for piece in re.split(r"(\d+)", text)]


def _single(one: Comparison) -> list[str]:
    plain = one.unit in ("1", "") or re.match(r"\d{4}-\d{2}", one.stated_computed)
    unit = "" if plain else " %" if one.unit == "percent" else f" {one.unit}"
    allowed = f"{one.tolerance:g}" if one.tolerance else ""
    far = f" by {abs(one.difference):.3g} {FAR.get(one.unit, one.unit)}".rstrip() if one.unit else ""
    verdict = one.stated_verdict + far * (one.stated_verdict == DIFFERS)
    here, there = (f"{text}{unit}" if text and one.quantity else text for text in (one.stated_computed, one.text))
    return [here, there, "; ".join(filter(None, [allowed, one.reason])), verdict]


def _several(ones: list[Comparison]) -> list[str]:
    known = Compared([one for one in ones if one.quantity], "")
    agree, allowed = sum(one.stated_verdict == AGREES for one in ones), sorted({one.tolerance for one in known.values})
    tolerances = " to ".join(f"{end:g}" for end in dict.fromkeys([*allowed[:1], *allowed[-1:]]))
    reasons = dict.fromkeys(one.reason for one in ones if one.reason)
    verdict = (
        ones[0].stated_verdict if len({one.stated_verdict for one in ones}) == 1 else f"{agree} of {len(ones)} agree"
    )
    here, there = known.summary.partition(", ")[2], f"{len(ones)} values"
    if len(ones) < FEW:
        here, there = ("; ".join(dict.fromkeys(_single(one)[place] for one in ones)) for place in (0, 1))
    return [here, there, "; ".join(filter(None, [tolerances if any(allowed) else "", *reasons])), verdict]


def main() -> None:
    """State in the tables what the results in ``outputs/`` hold, and write the index."""
    for one in claims():
        try:
            with open_result(ROOT / result_folder(one.study)) as result:
                update(one.path, compare(result, one.table))
        except HeliosweepError as error:
            print(f"{one.name}: its table stays as it is: {error}", file=sys.stderr)
    before, _, rest = README.read_text(encoding="utf-8").partition(BEGIN)
    README.write_text(f"{before}{BEGIN}\n{index(list(claims()))}\n{END}{rest.partition(END)[2]}", encoding="utf-8")


if __name__ == "__main__":
    main()
