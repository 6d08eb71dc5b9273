"""What a newcomer meets in the first hour: an example is edited wrongly, and the answer says what to do."""

from __future__ import annotations

from pathlib import Path

import pytest

import heliosweep
from heliosweep.cli import main
from heliosweep.families.family import families

EDITS = {  # what is replaced, by what, and what must be said
    "a space forgotten": ("{height: 95}", "{height:95}", "write 'height: 95', with a colon and a space"),
    "a space forgotten in a block": ("  width: 11 ", "  width:11 ", "needs a space after the colon: 'width: ...'"),
    "a typo": ("latitude:", "lattitude:", "did you mean 'latitude'?"),
    "an abbreviation": ("latitude:", "lat:", "did you mean 'latitude'?"),
    "a comma for a point": ("95}", "'95,5'}", "decimals need a point, not a comma"),
    "a list without brackets": ("95}", "95, 105}", "write several values in brackets"),
    "a range of another language": ("95}", "'60:120:20'}", "a range is {start, stop, step}"),
    "a range without a step": (
        "95}",
        "{start: 60, stop: 120}}",
        "'step' or 'num' is missing: a range is {start, stop, step}",
    ),
    "a time for a number": ("start: 8,", "start: '08:00',", "'08:00' is 8 h"),
    "another unit": ("width: 11 ", "width: 11 deg ", "'deg' is the unit of an angle"),
    "out of range": ("[0, 30]", "[0, 95]", "must be between -90 and 90 deg (got 95)"),
    "a word that is none": ("sampling: midpoint", "sampling: mid", "did you mean 'midpoint'?"),
    "a tab": ("  clock: solar", "\tclock: solar", "tabs cannot be used for indentation: use spaces"),
    "mirrors that collide": ("clearance: 16", "clearance: 8", "they collide"),
    "zip without blocks": (
        "width: 11 ",
        "width: [10, 11] #",
        "zip[0][0]: is not a swept key; did you mean 'heliostat.width'?",
    ),
}


@pytest.fixture
def field(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = Path("my_field.yaml")
    path.write_text(families()["field_efficiency"].example(), encoding="utf-8")
    return path


@pytest.mark.parametrize("edit", EDITS)
def test_a_wrong_edit_is_answered(edit: str, field: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before, after, said = EDITS[edit]
    text = field.read_text(encoding="utf-8")
    assert before in text
    more = "zip: [[width, height]]\n" if "zip" in edit else ""
    field.write_text(text.replace(before, after, 1) + more, encoding="utf-8")
    assert main(["validate", str(field)]) == 2
    assert said in capsys.readouterr().err


def test_a_name_without_its_ending(field: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", "my_field"]) == 2
    assert "my_field: cannot be read" in (said := capsys.readouterr().err)
    assert "did you mean my_field.yaml?" in said


def test_a_study_where_a_result_is_wanted(field: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(field)]) == 2
    assert capsys.readouterr().err.strip() == "my_field.yaml: has not been run; run: heliosweep run my_field.yaml"


def test_a_path_in_place_of_a_study(field: Path) -> None:
    """Nobody should need to know that a study is loaded first."""
    assert heliosweep.plan("my_field.yaml").output_bytes == heliosweep.plan(heliosweep.load(field)).output_bytes
    assert heliosweep.build(field).sizes["latitude"] == 2
    with pytest.raises(heliosweep.StudyError, match=r"did you mean my_field\.yaml"):
        heliosweep.run("my_field")


def test_the_name_alone_says_what_it_can_do(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    assert "validate" in capsys.readouterr().err
