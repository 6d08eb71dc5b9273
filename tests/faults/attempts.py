"""Attempts to break runs, counted: ``make faults`` makes all of them, ``make test`` a tenth.

A test that is marked ``attempts(line, count)`` asks the fixture of that name which of its `count` attempts to make, and
makes each in the context `Attempts.at`. The sums are printed, and written to the page that ``--attempts-page`` names.
"""

from __future__ import annotations

import os
import platform
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

#: What is attempted, in the words of the page and in its order, and how often at least.
LINES = {
    "signals": ("signals to a run, to one of its workers, to its whole group of processes", 300),
    "kills": ("kills just before a run touches a file, at one touch after the other", 100),
    "disks": ("disks that are full from some touch of a file on, or from some size on", 100),
    "corruptions": ("damaged files of results and of unfinished runs", 500),
    "studies": ("mutated study files", 10_000),
    "tables": ("mutated tables and images that studies name", 5_000),
    "kernels": ("damaged files of compiled kernels", 36),
}
#: What stands above the table that is written.
MARK = "<!-- from here on written by make faults -->"


class Attempts:
    """The attempts of one test: the numbers of those to make, and what came of those that were made."""

    def __init__(self, count: int, share: float) -> None:
        self.whole = count
        self.numbers = range(0, count, max(1, round(1.0 / share)))
        self.made = 0
        self.failed: list[str] = []

    @contextmanager
    def at(self, what: str, made: int = 1) -> Iterator[None]:
        """Make one attempt, or some that are judged together; what is raised in the context is kept for the end."""
        self.made += made
        try:
            yield
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            self.failed += [f"{what}: {type(error).__name__}: {error} ({place.line})"] * made


@pytest.fixture
def attempts(request: pytest.FixtureRequest) -> Iterator[Attempts]:
    line, count = request.node.get_closest_marker("attempts").args
    assert line in LINES
    found = Attempts(count, request.config.getoption("share"))
    yield found
    said = (line, found.made, found.made - len(found.failed))
    request.node.user_properties.append(("attempts", said))
    several = list(dict.fromkeys(found.failed))
    assert not several, "\n".join([f"{len(found.failed)} of {found.made} attempts were not survived", *several[:20]])


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("attempts", "attempts to break runs")
    group.addoption("--share", type=float, default=0.1, help="share of the attempts to make (default: a tenth)")
    group.addoption("--attempts-page", type=Path, help="page of the documentation to write the counts to")


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_SUMS] = {}
    config.pluginmanager.register(_Sums(config))


_SUMS = pytest.StashKey[dict[str, tuple[int, int]]]()


class _Sums:
    """Adds up what came of the attempts of all tests, also of those that other processes ran."""

    def __init__(self, config: pytest.Config) -> None:
        self._sums = config.stash[_SUMS]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        for name, value in report.user_properties if report.when == "teardown" else ():
            if name == "attempts":
                said: Any = value
                line, made, survived = said
                before = self._sums.get(line, (0, 0))
                self._sums[line] = before[0] + made, before[1] + survived

    def pytest_terminal_summary(self, terminalreporter: Any, config: pytest.Config) -> None:
        if not self._sums:
            return
        text = table(self._sums)
        terminalreporter.write_line(text)
        page: Path | None = config.getoption("attempts_page")
        if page:
            head, _, tail = page.read_text(encoding="utf-8").partition(MARK)
            where = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
            text = table(self._sums, f"{time.strftime('%Y-%m-%d')}, {where}", tail)
            page.write_text(f"{head}{MARK}\n\n{text}\n", encoding="utf-8")


def table(sums: dict[str, tuple[int, int]], when: str = "", before: str = "") -> str:
    """Table of the page, from the attempts made and survived of each line; other lines stay as they were `before`."""
    known = {row.split(" | ")[0].removeprefix("| "): row for row in before.splitlines()}
    rows = [
        f"| {words} | {sums[line][1]:,} / {sums[line][0]:,} | {when} |" if line in sums else known[words]
        for line, (words, _) in LINES.items()
        if line in sums or words in known
    ]
    return "\n".join(["| attempts | survived / made | when and where |", "|---|---|---|", *rows])
