"""Exceptions raised by heliosweep, with a common base class and an exit code for each kind of error.

Every message states the position of the problem (file, line, column, key) and the remedy.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import import_module
from itertools import islice
from typing import Any

#: Name of the option that replaces or recomputes results, for use in messages.
FORCE = "--force (force=True in Python)"
#: Logger of the package.
log = logging.getLogger("heliosweep")


def printable(text: object) -> str:
    """Return text with control characters escaped, because names and titles may contain any character."""
    spaces = "\n\t\u00a0\u2007\u2009\u202f"  # shown unchanged
    return "".join(
        letter if letter.isprintable() or letter in spaces else letter.encode("unicode_escape").decode("ascii")
        for letter in str(text)
    )


@dataclass(frozen=True)
class Problem:
    """Problem in the input and its position.

    Parameters
    ----------
    message : str
        Description of the problem and its remedy.
    key : str
        Dotted key in the study file, for instance ``site.latitude``; an empty string if no key applies.
    file : str
        File name as given by the user.
    line, column : int, optional
        Line and column in the file, counted from 1.
    unlisted : int
        Number of unlisted problems that this entry summarizes; 0 for a single problem.
    """

    message: str
    key: str = ""
    file: str = ""
    line: int | None = None
    column: int | None = None
    unlisted: int = 0

    def __str__(self) -> str:
        place = ":".join(str(part) for part in (self.file, self.line, self.column) if part not in ("", None))
        return ": ".join(part for part in (place, self.key, self.message) if part)


def reason_of(error: BaseException | None) -> str:
    """Return the type and message of an error raised by another library."""
    return f"{type(error).__name__}: {error}".rstrip(": ")


def listed(problems: Iterable[Problem], most: int, count: int, words: str = "more problems") -> list[Problem]:
    """Return the first `most` of `count` problems in a file, and one entry that summarizes the rest."""
    first = list(islice(problems, most))
    rest = count - len(first)
    return [*first, Problem(f"and {rest:,} {words}", file=first[0].file, unlisted=rest)] if rest else first


class HeliosweepError(Exception):
    """Base class of all errors raised by heliosweep."""

    exit_code = 1

    def __str__(self) -> str:
        return printable(super().__str__())


def load_extra(module: str, package: str, extra: str) -> Any:
    """Import and return a module from an optional package.

    Raises
    ------
    HeliosweepError
        If the package is not installed. The message includes the command that installs the package.
    """
    try:
        return import_module(module)
    except ImportError as error:
        message = f"the package {package} is missing; run: pip install {package} (extra '{extra}' of heliosweep)"
        raise HeliosweepError(message) from error


class StudyError(HeliosweepError):
    """Error that lists all problems in an invalid study or input file."""

    exit_code = 2

    def __init__(self, problems: Problem | Iterable[Problem]) -> None:
        self.problems = (problems,) if isinstance(problems, Problem) else tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))

    @property
    def count(self) -> int:
        """Number of problems, including unlisted ones."""
        return sum(problem.unlisted or 1 for problem in self.problems)

    def __reduce__(self) -> tuple[type[StudyError], tuple[tuple[Problem, ...]]]:
        return type(self), (self.problems,)


class PlanError(HeliosweepError):
    """Error raised if a valid study is too large for this machine.

    The message names the dimension to reduce.
    """

    exit_code = 3


class RunInterrupted(HeliosweepError):
    """Error raised if a run is stopped before it finishes. No incomplete files remain."""

    exit_code = 4
