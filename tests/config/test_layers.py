"""Studies on top of others: ``include``, keys given anew, and where messages say that something is wrong."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from heliosweep import api
from heliosweep.config.load import settings
from heliosweep.errors import StudyError
from tests.conftest import SMALL


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A base study in a folder of its own, beside its layout, seen from another folder."""
    (tmp_path / "plant").mkdir()
    (tmp_path / "plant" / "field.csv").write_text("x,y\n0,50\n15,50\n-15,50\n")
    (tmp_path / "plant" / "base.yaml").write_text(yaml.safe_dump({**SMALL, "layout": {"file": "field.csv"}}))
    (tmp_path / "mine").mkdir()
    monkeypatch.chdir(tmp_path / "mine")
    return tmp_path / "plant" / "base.yaml"


def written(name: str = "mine.yaml", **content: Any) -> str:
    Path(name).write_text(yaml.safe_dump({"include": "../plant/base.yaml", **content}, sort_keys=False))
    return name


def test_what_is_written_counts_and_the_rest_is_that_of_the_base(base):
    whole: Any = api.load(base)
    assert api.load(written()).study_id == whole.study_id
    study: Any = api.load(written(receiver={"height": 77}, title="higher"))
    assert (study.receiver.height, study.heliostat, study.title) == (77, whole.heliostat, "higher")
    assert study.resolve(study.layout.file).resolve() == (base.parent / "field.csv").resolve()
    assert "include" not in study.resolved()
    assert api.load({**SMALL, "layout": {"file": str(base.parent / "field.csv")}}).study_id == whole.study_id


def test_another_kind_of_layout_replaces_that_of_the_base(base):
    rings = {"radial_stagger": {"clearance": 16, "inner_radius": 60, "rings": 1}}
    study: Any = api.load(written(layout=rings))
    assert (study.layout.file, study.layout.radial_stagger.rings) == (None, 1)
    Path("ground.wkt").write_text("POLYGON ((0 0, 90 0, 90 90, 0 90, 0 0))")
    written("middle.yaml", layout={**rings, "exclude": "ground.wkt"})
    Path("field.csv").write_text("x,y\n0,70\n")
    Path("top.yaml").write_text("include: middle.yaml\nlayout: {file: field.csv}\n")
    study = api.load("top.yaml")
    assert (study.layout.file, study.layout.radial_stagger, study.layout.exclude) == ("field.csv", None, None)


def test_an_empty_key_of_the_base_is_told_and_not_removed(base):
    base.write_text(base.read_text().replace("receiver:", "receiver:\n  kind:"))
    with pytest.raises(StudyError, match=r"plant/base.yaml:\d+:8: receiver.kind: is empty: write a value"):
        api.load(written(receiver={"height": 77}))
    study: Any = api.load(written(receiver={"kind": None}))
    assert study.receiver.height == 60


def test_mistakes_are_told_in_the_file_in_which_they_are(base):
    base.write_text(base.read_text().replace("pivot_height", "pivot_hight"))
    with pytest.raises(StudyError) as caught:
        api.load(written(receiver={"height": "3 deg"}))
    said = sorted(map(str, caught.value.problems))
    assert any(one.startswith("../plant/base.yaml:") and "did you mean 'pivot_height'" in one for one in said)
    assert any(one.startswith("mine.yaml:3:11: receiver.height: must be a length") for one in said)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("nowhere.yaml", "no such file"),
        ("mine.yaml", "refers to a file that already"),
        (3, "must be the name of"),
        ("", "must"),
    ],
)
def test_a_base_that_is_none_is_told_at_its_line(base, name, said):
    with pytest.raises(StudyError, match=f"mine.yaml:1:10: include: {said}"):
        api.load(written(include=name))


def test_keys_are_given_anew_and_checked(base):
    study = api.load(base)
    other: Any = study.with_({"receiver.height": 77}, tracking="azimuth_elevation")
    assert (other.receiver.height, other.tracking) == (77, "azimuth_elevation")
    assert other.study_id != study.study_id
    assert api.load(base, {"receiver.height": 77, "tracking": "azimuth_elevation"}).study_id == other.study_id
    assert other.with_({"receiver.height": study.receiver.height}, tracking=SMALL["tracking"]) == study  # type: ignore[attr-defined]
    with pytest.raises(StudyError) as caught:
        study.with_({"receiver.hight": 77, "site.latitude": 91, "heliostat.width": None, "zip": None})
    said = "\n".join(str(problem).rpartition("base.yaml")[2] for problem in caught.value.problems)
    assert "receiver.hight: unknown key; did you mean 'height'?" in said
    assert "site.latitude: must be between -90 and 90 deg (got 91)" in said
    assert "zip: is empty" in said


@pytest.mark.parametrize("text", ["receiver.height", "=3", "a=", "a=[1", "a=1\nb: 2", "a=b: c", "a=&x 1", "a=!t 1"])
def test_settings_that_are_none_are_refused_by_name(text):
    with pytest.raises(StudyError, match=r"^--set: "):
        settings([text])


def test_entries_of_lists_are_named(base):
    sites = [{"name": "a", "latitude": 1}, {"name": "b", "latitude": 2}]
    both = api.load(base, {"site": None, "sites": sites})
    other: Any = both.with_({"sites[1].latitude": 30})
    assert [site.latitude for site in other.sites] == [1, 30]
    with pytest.raises(StudyError, match="is a list of 2 entries: specify one"):
        both.with_({"sites[2].latitude": 3})
