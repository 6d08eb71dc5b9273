"""Index of papers in `studies/README.md`, from the tables of published numbers and the claims: ``make index``.

``make index`` writes computed values and verdicts of the tables from the results in ``outputs/``, and the index.
"""

import csv
import io
import re
import sys
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from heliosweep import api
from heliosweep.api import open_result, result_folder
from heliosweep.config.study import Study
from heliosweep.errors import HeliosweepError
from heliosweep.report.comparison import AGREES, DIFFERS, Compared, compare, judged, read_published
from tests.literature.claims import Claim, chong2012, defieux2020, liu2022, misalignment2019

ROOT = Path(__file__).resolve().parents[2]
STUDIES = ROOT / "studies"
README = STUDIES / "README.md"
BEGIN, END = "<!-- index of papers: written by `make index` -->\n", "<!-- end of the index -->\n"
#: Keys that keep a test worker small.
SMALL = {"execution.memory": "700 MB"}
#: Number of rows of one claim from which on they are summarised.
FEW = 4
#: Units of a difference.
FAR = {"1": "", "percent": "percentage points"}
#: Claims by paper.
CLAIMS: dict[str, list[Claim]] = {one.PAPER: one.CLAIMS for one in (chong2012, defieux2020, liu2022, misalignment2019)}


@dataclass(frozen=True)
class Table:
    """A study and its table of published numbers."""

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

    def stated(self) -> pd.DataFrame:
        """Return the table as if its stated values were computed; claims are ends of the source if there are none."""
        values = self.table.values
        values = judged(values, values["stated_computed"].replace("", "nan").astype(float))
        return values.assign(claim=values["claim"].replace("", self.table.source.rpartition(", ")[2]))

    def compared(self) -> Compared:
        """Compute the values of the table, and compare."""
        result = api.build(self.study)
        used = {*self.table.values["quantity"]}
        return compare(result.assign(xr.Dataset({name: result[name] for name in used}).compute()), self.table)


@dataclass(frozen=True)
class Row:
    """Row of the index."""

    claim: str
    study: str
    cells: list[str]
    verdict: str


def names() -> list[str]:
    """Return the names of all studies with a table of published numbers."""
    return [path.stem for path in sorted(STUDIES.glob("*.yaml")) if re.search(r"\bpublished:", path.read_text("utf-8"))]


def table(name: str) -> Table:
    """Return a study and its table of published numbers."""
    study = api.load(STUDIES / f"{name}.yaml", SMALL)
    published = study.report.published
    assert published is not None
    return Table(study, name, read_published(study.resolve(published.file), published.source, published.file))


def stale(study: str) -> list[str]:
    """Return the claims of a study whose statement no longer holds."""
    claims = [one for every in CLAIMS.values() for one in every if one.study == study]
    result = api.build(api.load(STUDIES / f"{study}.yaml", SMALL))
    used = set.union(*(one.variables() for one in claims)) & set(map(str, result.data_vars))
    result = result.assign(xr.Dataset({name: result[name] for name in used}).compute())
    return [text for one in claims if (text := one.stale(result))]


def update(path: Path, found: Compared) -> None:
    """Write computed values and verdicts into a table."""
    lines = path.read_text(encoding="utf-8").splitlines()
    header = next(number for number, line in enumerate(lines) if line and not line.startswith("#"))
    names = next(csv.reader([lines[header]]))
    names += [name for name in ("computed", "verdict") if name not in names]
    rows = {header: dict(zip(names, names, strict=True))}
    for number, row in zip(found.values.index, found.values.to_dict("records"), strict=True):
        cells = dict(zip(names, [*next(csv.reader([lines[number - 1]])), "", ""], strict=False))
        computed = row["found"].replace("\N{MINUS SIGN}", "-").replace(",", "")
        rows[number - 1] = cells | {"computed": computed, "verdict": row["verdict"]}
    for number, cells in rows.items():
        buffer = io.StringIO()
        csv.writer(buffer, lineterminator="").writerow([cells[name] for name in names])
        lines[number] = buffer.getvalue()
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def index(found: list[Table]) -> str:
    """Return the index: for each paper a table of its figures, tables and claims."""
    parts = []
    for paper in dict.fromkeys([*(one.paper for one in found), *CLAIMS]):
        ours = {of.name: of.stated() for of in found if of.paper == paper}
        rows = [
            Row(str(one.claim), name, *_single(one)) for name, values in ours.items() for one in values.itertuples()
        ]
        rows += [
            Row(one.text, one.study, [one.computed, one.printed, one.reason], one.verdict)
            for one in CLAIMS.get(paper, ())
        ]
        rows.sort(key=lambda row: (_natural(row.claim), row.study))
        lines = [f"### {paper}\n", "| Claim | Study | Here | Published | Tolerance and reason | Verdict |"]
        lines.append("|---|---|---|---|---|---|")
        for (claim, name), group in groupby(rows, key=lambda row: (row.claim, row.study)):
            ones = list(group)
            plain = ours[name][ours[name]["claim"] == claim] if name in ours else pd.DataFrame()
            cells = [claim, f"`{name}`", *(_row(ones) if len(ones) == 1 else _several(ones, plain))]
            lines.append(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |")
        parts.append("\n".join(lines))
    return "\n\n".join(parts) + "\n"


def _natural(text: str) -> list[tuple[int, str]]:
    return [(int(piece or 0), "") if piece.isdigit() else (0, piece) for piece in re.split(r"(\d+)", text)]


def _single(one: Any) -> tuple[list[str], str]:
    unit = "" if one.unit in ("1", "") else " %" if one.unit == "percent" else f" {one.unit}"
    allowed = f"{one.tolerance:g}" if one.tolerance else ""
    far = f" by {abs(one.difference):.3g} {FAR.get(one.unit, one.unit)}".rstrip()
    verdict = one.stated_verdict + far * (one.stated_verdict == DIFFERS)
    reason = "; ".join(filter(None, [allowed, one.reason]))
    return [f"{one.stated_computed}{unit}", f"{one.published}{unit}", reason], verdict


def _row(ones: list[Row]) -> list[str]:
    return [*ones[0].cells, ones[0].verdict]


def _several(ones: list[Row], plain: pd.DataFrame) -> list[str]:
    """Return the cells of several rows of one claim."""
    verdicts = [one.verdict.partition(" by ")[0] for one in ones]
    agree = sum(verdict == AGREES for verdict in verdicts)
    verdict = verdicts[0] if len(set(verdicts)) == 1 else f"{agree} of {len(ones)} agree"
    here, there, reasons = ("; ".join(dict.fromkeys(filter(None, (one.cells[i] for one in ones)))) for i in range(3))
    if len(ones) >= FEW:
        there = f"{len(ones)} values"
        here = Compared(plain, "").summary.rpartition("; ")[2] if len(plain) == len(ones) else f"{agree} agree"
    if len(plain):
        allowed = sorted({*plain["tolerance"]} - {0.0})
        ends = " to ".join(f"{end:g}" for end in dict.fromkeys([*allowed[:1], *allowed[-1:]]))
        reasons = "; ".join(dict.fromkeys(filter(None, [ends, *plain["reason"]])))
    return [here, there, reasons, verdict]


def main() -> None:
    """Write the results in ``outputs/`` into the tables, list stale claims, and write the index."""
    for one in map(table, names()):
        try:
            with open_result(ROOT / result_folder(one.study)) as result:
                update(one.path, compare(result, one.table))
        except HeliosweepError as error:
            print(f"{one.name}: the table is unchanged: {error}", file=sys.stderr)
    for name in sorted({one.study for every in CLAIMS.values() for one in every}):
        for text in stale(name):
            print(f"{name}: {text}", file=sys.stderr)
    before, _, rest = README.read_text(encoding="utf-8").partition(BEGIN)
    README.write_text(
        f"{before}{BEGIN}\n{index([*map(table, names())])}\n{END}{rest.partition(END)[2]}", encoding="utf-8"
    )


if __name__ == "__main__":
    main()
