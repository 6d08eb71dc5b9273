"""A run whose report fails: the result is there, and the user is told what to do."""

import pytest

from heliosweep.cli import main
from heliosweep.families.misalignment import report as figures
from heliosweep.report import page
from heliosweep.report.figures import Special

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
    said = f"the result is complete, but the report failed ({type(error).__name__}: {error}); "
    advice = {OSError: "fix this, then run: heliosweep report 'a result'"}
    blame = "please report this error and include the output of --verbose; --no-report omits the page"
    last = advice.get(type(error), blame)
    assert told.strip().splitlines()[-1] == said + last
    assert main(["report", "a result"]) == 1
    assert capsys.readouterr().err.strip() == said + last
    monkeypatch.undo()
    assert main(["report", str(tmp_path / "a result")]) == 0
    assert (tmp_path / "a result" / "report.html").is_file()


def test_what_cannot_be_drawn_is_named_and_all_else_is_drawn(tmp_path, monkeypatch, caplog):
    def beyond_drawing(_):
        raise ValueError("no colour")

    declare = figures.figures
    broken = Special("beyond_drawing", "A figure", draw=beyond_drawing)

    def no_view(*_):
        raise KeyError("nothing to see")

    (tmp_path / "study.yaml").write_text(STUDY.replace("size: 1}", "size: [-1, 0, 1]}"), encoding="utf-8")
    out = tmp_path / "out"
    monkeypatch.setattr(figures, "figures", lambda result: [broken, *declare(result), broken])
    monkeypatch.setattr("heliosweep.report.interactive.explore", no_view)
    for command in (["run", str(tmp_path / "study.yaml"), "--quiet", "--output", str(out)], ["report", str(out)]):
        assert main(command) == 0
        told = caplog.text
        caplog.clear()
        assert told.count("The figure beyond_drawing could not be drawn (ValueError: no colour).") == 2
        assert "The interactive plots could not be drawn (KeyError: 'nothing to see')." in told
        text = (out / "report.html").read_text(encoding="utf-8")
        assert "<li>The figure beyond_drawing could not be drawn (ValueError: no colour).</li>" in text
        assert "<h2>Results</h2>" in text
        assert "<h2>Explore</h2>" not in text
        drawn = {path.name for path in (out / "figures").glob("*.png")}
        (out / "report.html").unlink()
    monkeypatch.undo()
    assert main(["report", str(out)]) == 0
    assert {path.name for path in (out / "figures").glob("*.png")} == drawn != set()
