"""Bad studies, each with all that is said of it, from text files: what users read, reviewed by eye.

A file with several good studies gives them itself: ``@ good`` with the lines of the study of the cases below, and
``@ table NAME`` with the text of a file in the folder of the studies. A case begins with ``@`` and the line of a good
study that it replaces, or ``file`` for the whole text. Below stand what becomes of the line, with ``\\a`` for a bell,
and behind ``=>`` what is said. Below ``@ each`` every line takes the place of that with its key, or is a new one;
``- key`` leaves one out.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from heliosweep import api
from heliosweep.config.load import load
from heliosweep.errors import StudyError

#: What pydantic would say.
PYDANTIC = ("Input should", "valid ", "Extra inputs", "Field required", "Value error", "pydantic", "type=")


class Bad(NamedTuple):
    """Line that is replaced, what it becomes, what is said."""

    block: str
    text: str
    said: list[str]


def read(path: Path) -> list[Any]:
    """Parameters of a test, from a file."""
    found = []
    for part in path.read_text(encoding="utf-8").split("\n@ ")[1:]:
        block, *lines = part.rstrip("\n").split("\n")
        said = [line.removeprefix("=> ") for line in lines if line.startswith("=> ")]
        text = "\n".join(lines[: len(lines) - len(said)]).replace(r"\a", "\a")
        name = said[0].partition(": ")[2][:80] if said else text[:60]  # key and message, without the place
        found.append(pytest.param(Bad(block, text, said), id=name))
    return found


def sections(path: Path) -> list[Any]:
    """Parameters of a test, from a file with its good studies and tables: case, good study and tables."""
    found = []
    good: dict[str, str] = {}
    tables: dict[str, str] = {}
    for case in read(path):
        (bad,) = case.values
        kind, _, name = bad.block.partition(" ")
        if kind == "good":
            good = {line.partition(":")[0]: line for line in bad.text.split("\n")}
        elif kind == "table":
            tables[name] = bad.text + "\n"
        else:
            found.append(pytest.param(bad, good, tables, id=f"{path.parent.name}-{case.id}"))
    return found


def _changed(case: Bad, good: Mapping[str, str]) -> list[str]:
    """Lines of the bad study."""
    if case.block == "file":
        return [case.text]
    if case.block != "each":
        return [*({**good, case.block: case.text}).values()]
    lines = dict(good)
    for line in case.text.split("\n"):
        if line.startswith("- "):
            del lines[line.removeprefix("- ")]
        else:
            lines[line.partition(":")[0]] = line
    return [*lines.values()]


def check(case: Bad, good: Mapping[str, str], registry: Mapping[str, Any] | None = None) -> None:
    """Hold a bad study against what is said of it when it is planned; it is written in the working folder."""
    Path("study.yaml").write_text("\n".join([*_changed(case, good), ""]), encoding="utf-8")
    with pytest.raises(StudyError) as error:
        api.plan(load("study.yaml", registry) if registry else api.load("study.yaml"))
    assert str(error.value).split("\n") == case.said
    assert error.value.exit_code == 2
    assert not any(phrase in str(error.value) for phrase in PYDANTIC if "not valid YAML" not in str(error.value))
