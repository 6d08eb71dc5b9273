"""Every code block of the documentation and the README runs, and prints what the page says."""

import contextlib
import io
import logging
import re
import shlex
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib
import pytest
import yaml

import heliosweep
from heliosweep import api
from heliosweep.cli import main
from heliosweep.config.study import Study
from heliosweep.families.family import families
from tests.conftest import ROOT, STUDIES

from .pages import PAGES, CodeBlock, blocks

#: Blocks that no test runs, by page: one more needs a reason on the page and a number here.
NOT_RUN = {
    "README.md": 1,
    "docs/adding_a_family.md": 3,
    "docs/architecture.md": 1,
    "docs/design_a_plant.md": 4,
    "docs/results.md": 2,
    "docs/exchange.md": 2,
    "docs/tutorial.md": 5,
    "docs/weather_files.md": 1,
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder with the project's studies in it. Runs print no progress, as on a fast machine."""
    shutil.copytree(STUDIES, tmp_path / "studies")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("heliosweep.runs.run.LINE_SECONDS", float("inf"))
    matplotlib.use("agg")
    return tmp_path


#: Folders of results whose report was drawn.
drawn: list[Path] = []


@pytest.fixture
def first_report_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw a report for the first run only, later pages are empty; figures and pages have their own tests."""
    draw = api._report

    def once(folder: Path, study: Study | None = None, *others: Any, **named: Any) -> Path:
        if drawn and study:
            (folder / "report.html").touch()
            return folder
        drawn.append(folder)
        return draw(folder, study, *others, **named)

    monkeypatch.setattr(api, "_report", once)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
@pytest.mark.usefixtures("folder", "first_report_only")
def test_blocks_of_a_page(page: Path) -> None:
    printed, names = "", {"__name__": "__main__"}
    for block in blocks(page):
        if block.mark == "not run":
            assert len(block.said) > 10, f"{block}: why is it not run?"
        elif block.mark == "output":
            _is_like(printed, block)
        elif block.language == "yaml":
            _study(block)
        elif block.language == "shell":
            printed = _shell(block)
        elif block.language == "python":
            with contextlib.redirect_stdout(io.StringIO()) as out:
                exec(compile(block.text, str(block), "exec"), names)
            printed = out.getvalue()
        elif block.mark == "file":
            Path(block.said).write_text(block.text, encoding="utf-8")
        else:
            pytest.fail(f"{block}: nobody knows how to run {block.language or 'a block without a language'}")


def test_no_more_blocks_than_these_are_not_run() -> None:
    found = {str(page.relative_to(ROOT)): sum(block.mark == "not run" for block in blocks(page)) for page in PAGES}
    assert {page: count for page, count in found.items() if count} == NOT_RUN


def _study(block: CodeBlock) -> None:
    """Load a study and plan it; a part of one in the place where it belongs."""
    content: Any = yaml.safe_load(block.text)
    if block.mark == "part of":
        content = _merged(yaml.safe_load(families()[block.said].example()), content)
        heliosweep.plan(heliosweep.load(content))
        return
    path = Path(block.said if block.mark == "file" else "study.yaml")
    path.write_text(block.text, encoding="utf-8")
    assert {"family", "include"} & set(content), f"{block}: a part of a study needs a comment that says of which"
    with contextlib.suppress(heliosweep.StudyError) if "wrong" in path.name else contextlib.nullcontext():
        heliosweep.plan(heliosweep.load(path if block.mark == "file" else _beside_studies(path)))


def _beside_studies(path: Path) -> Path:
    """Studies on a page name files as those in studies/ do."""
    return path.replace(Path("studies") / path.name)


def _merged(whole: Mapping[str, Any], part: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(whole)
    for key, value in part.items():
        inner = merged.get(key)
        if isinstance(value, dict) and isinstance(inner, dict):
            merged[key] = _merged(inner, value)
        elif value is None:
            merged.pop(key, None)
        else:
            merged[key] = value
    return merged


def _shell(block: CodeBlock) -> str:
    """Run commands of ours and return what they print."""
    printed, code = "", 0
    for line in block.text.splitlines():
        words = [word for given in shlex.split(line, comments=True) for word in _expanded(given)]
        if not words:
            continue
        assert Path(words[0]).name == "heliosweep", f"{block}: {line}: only heliosweep is run; say why it is not"
        target = words.index(">") if ">" in words else len(words)
        out, both = io.StringIO(), io.StringIO()
        handler = logging.StreamHandler(both)
        # Printed by whichever command is the first on a machine.
        handler.addFilter(lambda record: not record.getMessage().startswith("compiling the kernels"))
        with contextlib.redirect_stdout(out if target < len(words) else both), contextlib.redirect_stderr(both):
            logging.getLogger("heliosweep").addHandler(handler)
            try:
                code = main(words[1:target])
            except SystemExit as stop:
                code = int(stop.code or 0)
            finally:
                logging.getLogger("heliosweep").removeHandler(handler)
        if target < len(words):
            Path(words[target + 1]).write_text(out.getvalue(), encoding="utf-8")
        printed += both.getvalue()
        expected = int(block.said) if block.mark == "exit" else 0
        assert code == expected, f"{block}: {line}: {printed}"
    return printed


def _expanded(word: str) -> list[str]:
    """Return the files that a pattern means, as a shell does."""
    return sorted(map(str, Path().glob(word))) if "*" in word else [word]


def _is_like(printed: str, block: CodeBlock) -> None:
    pattern = re.escape(block.text.rstrip()).replace(re.escape("..."), ".*?")
    assert re.fullmatch(pattern, printed.rstrip(), re.DOTALL), f"{block}: it says\n{printed}"
