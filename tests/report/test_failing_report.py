"""A run whose report fails: the result is there, and the user is told what to do."""

from __future__ import annotations

import sys

import pytest

from heliosweep.cli import main
from heliosweep.report import page

STUDY = """
family: misalignment
site: {latitude: 37.4}
time: {clock: solar, days: [172], hours: [12]}
receiver: {height: 143, width: 9, height_extent: 9}
heliostats: {positions: [[0, 150, 0]]}
error: {axis: elevation, size: 1}
"""


@pytest.mark.parametrize("error", [ValueError("no colour"), OSError(28, "No space left on device")])
def test_a_failing_report_leaves_the_result_and_says_so(tmp_path, monkeypatch, capsys, error):
    def fail(*_, **__):
        raise error

    (tmp_path / "study.yaml").write_text(STUDY, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(page, "write_report", fail)
    assert main(["run", "study.yaml", "--quiet", "--output", "a result"]) == 1
    told = capsys.readouterr().err
    assert "Traceback" not in told
    said = f"the result is complete, the report failed ({type(error).__name__}: {error}); run: "
    assert told.strip().splitlines()[-1] == f"{said}heliosweep report 'a result'"
    monkeypatch.undo()
    assert main(["report", str(tmp_path / "a result")]) == 0
    assert (tmp_path / "a result" / "report.html").is_file()


def test_a_report_that_cannot_be_imported_leaves_the_result_and_says_so(tmp_path, monkeypatch, capsys):
    (tmp_path / "study.yaml").write_text(STUDY, encoding="utf-8")
    monkeypatch.setitem(sys.modules, "heliosweep.report.page", None)
    assert main(["run", str(tmp_path / "study.yaml"), "--quiet", "--output", str(tmp_path / "out")]) == 1
    told = capsys.readouterr().err
    assert "Traceback" not in told
    assert "the result is complete, the report failed (ModuleNotFoundError: " in told.splitlines()[-1]
    assert (tmp_path / "out" / "result.nc").is_file()
