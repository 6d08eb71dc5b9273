"""Every message that a bad study file can meet, word for word."""

from pathlib import Path

import pytest

from heliosweep.config.load import load, load_mapping
from heliosweep.errors import StudyError
from tests import bad_studies

from .conftest import LINES, REGISTRY


@pytest.mark.parametrize("case", bad_studies.read(Path(__file__).with_name("bad_studies.txt")))
def test_bad_study(case: bad_studies.Bad, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    bad_studies.check(case, LINES, REGISTRY)


def test_all_problems_at_once(refused) -> None:
    found = refused(site="site: {latitude: 91, altitude: 3 deg}", time="tiem: {}", receiver="receiver: {height: 0}")
    assert [(problem.line, problem.key) for problem in found] == [
        (2, "site.latitude"),
        (2, "site.altitude"),
        (4, "tiem"),
        (7, "receiver.height"),
    ]


def test_missing_files_are_found_whatever_else_is_wrong(refused) -> None:
    found = refused(
        "report: {published: {file: none.csv}}",
        site="sites: {file: sites.csv}",
        layout="layout: {file: [a.csv, 3, study.yaml]}",
        receiver="receiver: {height: 0}",
    )
    assert [(problem.key, problem.message.partition(",")[0]) for problem in found] == [
        ("sites.file", "no such file"),
        ("layout.file[0]", "no such file"),
        ("layout.file[1]", "must be the name of a file"),
        ("receiver.height", "must be greater than 0 m (got 0)"),
        ("report.published.source", "is missing: Publication that contains the values"),
        ("report.published.file", "no such file"),
    ]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"a: " + b" " * 2**20, "study.yaml: is larger than 1 MiB: check that it is the right file"),
        (b"title: \xff", "study.yaml:1: is not UTF-8 text: save it as UTF-8"),
    ],
)
def test_unreadable_content(content: bytes, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("study.yaml").write_bytes(content)
    with pytest.raises(StudyError) as error:
        load("study.yaml", REGISTRY)
    assert str(error.value) == said


def test_unreadable_files(tmp_path: Path) -> None:
    for path in (tmp_path / "missing.yaml", tmp_path, "nul\0.yaml"):
        with pytest.raises(StudyError, match=r"there is no such file|is a folder|cannot be read: "):
            load(path, REGISTRY)


def test_study_built_in_python_is_located_by_key_alone() -> None:
    with pytest.raises(StudyError) as error:
        load_mapping({"family": "field_efficiency", "site": {"latitude": 91, 3: 4}}, REGISTRY)
    assert "site.latitude: must be between -90 and 90 deg (got 91)" in str(error.value).split("\n")
    assert all(problem.line is None for problem in error.value.problems)
