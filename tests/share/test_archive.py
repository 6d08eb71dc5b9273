"""Archives of results: unpacked elsewhere they verify, and run again to the same bytes."""

import hashlib
import json
import re
import shutil
import zipfile
from pathlib import Path

import pytest

import heliosweep
from heliosweep import api
from heliosweep.cli import main
from heliosweep.errors import HeliosweepError, StudyError
from heliosweep.share.archive import pack_result
from heliosweep.store.folder import verify
from tests.conftest import STUDIES

#: Shipped studies that name files, by family and mode; and what archives of them must hold.
WITH_INPUTS = {
    "chong2012_table2": {"inputs/chong2012.csv", "inputs/chong2012_table2.csv"},
    "liu2022_table2": {"inputs/liu2022.csv", "inputs/liu2022_table2.csv"},
    "calibration_measured": {"inputs/heliostats.csv", "inputs/four_heliostats.csv"},
    "gazing_measured": {"inputs/upper_left.png", "inputs/lower_right.png", "inputs/sun_profile.csv"},
}
FILES = {
    "README.md", "LICENSE", "CITATION.cff", "study.yaml", "manifest.json", "SHA256SUMS", "result.nc",
    "requirements.txt",
}  # fmt: skip


def unpacked(archive: Path, folder: Path) -> Path:
    """Unpack an archive; its one folder."""
    with zipfile.ZipFile(archive) as zipped:
        zipped.extractall(folder)
    (top,) = folder.iterdir()
    return top


def files_of(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def assert_sums(folder: Path) -> None:
    """As ``sha256sum -c`` does, and that nothing is left out."""
    listed = dict(line.split("  ", 1)[::-1] for line in (folder / "SHA256SUMS").read_text("utf-8").splitlines())
    assert set(listed) == files_of(folder) - {"SHA256SUMS"}
    for name, digest in listed.items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest, name


def assert_reruns(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In another folder, from there."""
    monkeypatch.chdir(folder)
    again = heliosweep.run(heliosweep.load("study.yaml"), "again", report=False)
    assert again.path.read_bytes() == Path("result.nc").read_bytes()
    shutil.rmtree("again")


@pytest.fixture(scope="module")
def computed(small, tmp_path_factory):
    dataset = {"creators": [{"name": "Doe, Jane"}], "license": "CC-BY-4.0"}
    return heliosweep.run(small(dataset=dataset), tmp_path_factory.mktemp("computed") / "result", report=False).folder


@pytest.fixture
def result(computed, tmp_path):
    """Folder of a small result, with spaces and more in its name."""
    return shutil.copytree(computed, tmp_path / "ein Ergebnis é")


@pytest.mark.parametrize("name", ["liu2022_table2", "calibration_measured"])
def test_verifies_and_reruns_elsewhere(name, tmp_path, monkeypatch):
    # The study and its inputs are gone when the archive is unpacked.
    shutil.copytree(STUDIES, tmp_path / "home" / "studies")
    path = tmp_path / "home" / "studies" / f"{name}.yaml"
    study = heliosweep.load(path)
    heliosweep.run(study, tmp_path / "home" / "result", report=False)
    archive = pack_result(tmp_path / "home" / "result", tmp_path / "archive.zip", draft=True)
    study_id = study.study_id
    shutil.rmtree(tmp_path / "home")

    folder = unpacked(archive, tmp_path / "elsewhere")
    assert folder.name == f"{study.family}-{study_id}"
    assert WITH_INPUTS[name] <= files_of(folder)
    assert_sums(folder)
    found = verify(folder)
    assert found.ok, found
    assert heliosweep.load(folder / "study.yaml").study_id == study_id
    assert_reruns(folder, monkeypatch)


def test_holds_what_it_should_and_nothing_of_the_machine(result, tmp_path, monkeypatch):
    folder = unpacked(pack_result(result), tmp_path / "elsewhere")
    assert files_of(folder) == FILES
    assert_sums(folder)
    for name in FILES - {"result.nc"}:
        text = (folder / name).read_text("utf-8")
        assert str(tmp_path) not in text, name
        assert "ein Ergebnis" not in text, name
    manifest = json.loads((folder / "manifest.json").read_text("utf-8"))
    assert not {"command", "scheduler", "workers"} & set(manifest)
    assert set(manifest["environment"]) == {"commit", "lock", "packages", "python"}
    assert_reruns(folder, monkeypatch)


def test_the_page_and_its_figures_are_inside_without_the_machine(result, tmp_path):
    api.report(result)
    page = (result / "report.html").read_text("utf-8")
    folder = unpacked(pack_result(result), tmp_path / "elsewhere")
    assert_sums(folder)
    figures = {f"figures/{path.name}" for path in (result / "figures").glob("*.png")}
    assert figures
    assert files_of(folder) == FILES | {"report.html"} | figures
    packed = (folder / "report.html").read_text("utf-8")
    assert "heliosweep run study.yaml" in packed  # the study of the archive
    for tells in ("Provenance", "<dt>platform</dt>"):
        assert tells in page
        assert tells not in packed
    assert packed.count("<section") == packed.count("</section") == page.count("<section") - 1
    assert pack_result(folder, tmp_path / "again.zip").read_bytes() == (tmp_path / f"{result.name}.zip").read_bytes()


def test_titles_are_text_in_markdown(small, tmp_path):
    evil = "<script>alert(1)</script> [click](javascript:x) `a` $b$ *c* | d"
    heliosweep.run(small(title=evil, description=evil), tmp_path / "result", report=False)
    folder = unpacked(pack_result(tmp_path / "result", draft=True), tmp_path / "elsewhere")
    text = (folder / "README.md").read_text("utf-8")
    assert r"\<script\>alert(1)\</script\> \[click\](javascript:x) \`a\` \$b\$ \*c\* \| d" in text
    assert not re.search(r"(?<!\\)<script|(?<!\\)\[click", text)


LAYOUT = "x,y\n0,50\n10,60\n-10,70\n"


def test_names_of_inputs(small, tmp_path, monkeypatch):
    """Spaces, other alphabets, two files of one name, and paths that lead out of the folder."""
    home = tmp_path / "home"
    places = [home / "ein Feld für Ωλ.csv", home / "a" / "field.csv", tmp_path / "b" / "Field.csv"]
    for number, place in enumerate(places):
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(f"{LAYOUT}{number + 20},80\n", encoding="utf-8")
    monkeypatch.chdir(home)
    study = small(layout={"file": ["ein Feld für Ωλ.csv", "a/field.csv", str(places[2])]})
    heliosweep.run(study, "result", report=False)
    archive = pack_result("result", draft=True)
    with zipfile.ZipFile(archive) as zipped:
        names = zipped.namelist()
    assert all(not name.startswith("/") and ".." not in name.split("/") for name in names)
    top = f"{study.family}-{study.study_id}/inputs"
    assert {f"{top}/ein Feld für Ωλ.csv", f"{top}/field.csv", f"{top}/2/Field.csv"} <= set(names)
    shutil.move(archive, tmp_path / "moved.zip")
    shutil.rmtree(home)
    folder = unpacked(tmp_path / "moved.zip", tmp_path / "elsewhere")
    assert_sums(folder)
    assert verify(folder).ok
    assert_reruns(folder, monkeypatch)


def test_damaged_and_unfinished(result):
    path = result / "result.nc"
    content = bytearray(path.read_bytes())
    content[-100] ^= 1
    path.write_bytes(content)
    with pytest.raises(HeliosweepError, match="NOT intact"):
        pack_result(result)
    path.unlink()
    with pytest.raises(HeliosweepError, match="must be finished and undamaged"):
        pack_result(result)
    assert [place.name for place in result.parent.iterdir()] == [result.name]


def test_inputs_that_are_gone_or_changed(small, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("field.csv").write_text(LAYOUT, encoding="utf-8")
    heliosweep.run(small(layout={"file": "field.csv"}), "result", report=False)
    Path("field.csv").write_text(f"{LAYOUT}30,30\n", encoding="utf-8")
    with pytest.raises(HeliosweepError, match="an input of the study was changed"):
        pack_result("result", draft=True)
    Path("field.csv").unlink()
    with pytest.raises(HeliosweepError, match=r"field\.csv"):
        pack_result("result", draft=True)


def test_the_archive_is_not_replaced_unasked(result):
    archive = pack_result(result)
    before = archive.read_bytes()
    archive.write_bytes(b"precious")
    with pytest.raises(StudyError, match="--force"):
        pack_result(result)
    assert archive.read_bytes() == b"precious"
    assert pack_result(result, force=True).read_bytes() == before


def test_command_line(result, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(result)
    target = tmp_path / "archive.zip"
    assert main(["pack", ".", "-o", str(target), "--license", "CC0-1.0"]) == 0
    captured = capsys.readouterr()
    assert captured.out == f"{target}\n"
    folder = unpacked(target, tmp_path / "elsewhere")
    assert "CC0-1.0" in (folder / "LICENSE").read_text("utf-8")
    assert "license: CC0-1.0" in (folder / "CITATION.cff").read_text("utf-8")
    assert main(["pack", ".", "-o", str(target)]) == 2
    assert main(["pack", str(tmp_path / "nothing")]) == 1
    assert main(["pack", "."]) == 0  # named like the folder, beside it
    assert (tmp_path / "ein Ergebnis é.zip").exists()
