"""The named sites of a study: written in the study file, or in a CSV table beside it."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from typing import Any

from pydantic import ValidationError

from heliosweep.config.blocks import NamedSite, SiteFile
from heliosweep.config.faults import did_you_mean
from heliosweep.config.source import Source
from heliosweep.config.study import Study
from heliosweep.config.tables import table_text
from heliosweep.config.translate import translate
from heliosweep.errors import Problem, StudyError

MAX_BYTES, MAX_PROBLEMS = 2**20, 100
_NUMBERS = ("latitude", "longitude", "altitude")


def site_table(study: Study) -> tuple[NamedSite, ...]:
    """Return the sites of a study in order; none where it has a single ``site``.

    Raises
    ------
    StudyError
        The table cannot be read; every wrong cell at its line.
    """
    sites: Any = getattr(study, "sites", None)
    if sites is None:
        return ()
    if not isinstance(sites, SiteFile):
        return sites
    path = study.resolve(sites.file)
    text = table_text(path, str(path), MAX_BYTES)
    table: list[NamedSite] = []
    problems: list[Problem] = []
    lines: dict[str, int] = {}
    for line, row in _rows(text, str(path)):
        if len(problems) > MAX_PROBLEMS:
            break
        try:
            site = NamedSite.model_validate(row)
        except ValidationError as error:
            found = translate(error, NamedSite, Source(row))
            problems += [Problem(problem.message, problem.key, str(path), line) for problem in found]
            continue
        table.append(site)
        if lines.setdefault(site.name, line) != line:
            problems.append(Problem(f"another site has this name (got {site.name!r})", "name", str(path), line))
    if not table and not problems:
        problems.append(Problem("holds no sites", file=str(path)))
    if problems:
        raise StudyError(problems)
    return tuple(table)


def civil_clock_problems(study: Study) -> Iterator[Problem]:
    """Yield what the civil clock misses: the longitude of a site, or a time zone where the ``time`` block has none."""
    single: Any = getattr(study, "site", None)
    places = [("site", single)] if single is not None else []
    places += [(f"sites[{number}]", site) for number, site in enumerate(site_table(study))]
    for key, place in places:
        if place.longitude is None:
            yield study.problem(f"{key}.longitude", "is missing: the civil clock needs the longitude, in deg east")
    if any(place.timezone is None for _, place in places) and study.time.timezone is None:  # type: ignore[attr-defined]
        yield study.problem("time.timezone", "is missing: the civil clock needs a time zone, such as '+08:00'")


def _rows(text: str, file: str) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield line number and cells of each row, numbers read and empty cells left out."""
    reader = csv.reader(text.splitlines())
    header: list[str] | None = None
    for cells in reader:
        cells = [cell.strip() for cell in cells]
        if not any(cells) or cells[0].startswith("#"):
            continue
        if header is None:
            header = cells
            known = tuple(NamedSite.model_fields)
            for name in header:
                if name not in known:
                    message = f"unknown column {name!r}{did_you_mean(name, known)}"
                elif header.count(name) > 1:
                    message = f"column {name!r} is there twice"
                else:
                    continue
                raise StudyError(Problem(message, file=file, line=reader.line_num))
            continue
        if len(cells) != len(header):
            message = f"has {len(cells)} cells where the header has {len(header)}"
            raise StudyError(Problem(message, file=file, line=reader.line_num))
        yield (
            reader.line_num,
            {name: _cell(name, cell) for name, cell in zip(header, cells, strict=True) if cell},
        )


def _cell(name: str, cell: str) -> Any:
    if name not in _NUMBERS:
        return cell
    try:
        return float(cell)
    except ValueError:
        return cell
