"""The list of all studies: what is told of each, that broken folders do not stop it, and that words stay words."""

import json

from heliosweep.families.lookup import family_of_result
from heliosweep.grid.regions import Cut
from heliosweep.report.page import digest, studies_in, write_index
from heliosweep.store.folder import ChunkStore
from tests.report.synthetic import BOTH, result
from tests.report.test_page import EVIL, Page, published, study, write_report


def filled(folder, title="A field", finished="2026-01-02T03:04:05Z"):
    folder.mkdir(parents=True)
    result({"latitude": [0.0, 15.0], "tracking": BOTH}).to_netcdf(folder / "result.nc", engine="netcdf4")
    identity = {"attributes": {"title": title}, "study": {"family": "field_efficiency"}}
    described = {"file": "result.nc", "bytes": 5, "sha256": ""}
    manifest = {"identity": identity, "finished": finished, "result": described}
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    return folder


def test_every_study_with_its_headline_and_verdict_the_latest_first(tmp_path):
    first = filled(tmp_path / "outputs" / "a b#1", EVIL)
    write_report(first, study(first, published(first, 100)), family_of_result)
    filled(tmp_path / "outputs" / "later", "Later", "2026-02-01T00:00:00Z")
    index = write_index(first.parent)
    assert index == tmp_path / "outputs" / "index.html"
    page = Page(index.read_text(encoding="utf-8"))
    assert len(page.scripts) == 1
    assert digest(page.scripts[0]) in page.all("meta")[1]["content"]
    assert [one["data-family"] for one in page.all("li")] == ["field efficiency"] * 2
    assert page.all("a") == [{"href": "./a%20b%231/report.html"}]
    assert page.text.index("Later") < page.text.index(EVIL)
    for words in ("field efficiency", "2026-01-02 03:04:05", "1 of 1 published values agree", "2 studies"):
        assert words in page.text
    assert "mean optical efficiency of the field over the period: " in page.text
    assert index.read_bytes() == write_index(index.parent).read_bytes()


def test_broken_and_unfinished_folders_are_told(tmp_path):
    broken = filled(tmp_path / "outputs" / "broken")
    (broken / "manifest.json").write_text('{"identity": [', encoding="utf-8")
    (broken / "report.html").write_bytes(b"\xff\xfe no page")
    (broken / "comparison.csv").write_text("what, is, this\n1,2\n", encoding="utf-8")
    unfinished = ChunkStore(tmp_path / "outputs" / "unfinished" / "chunks-0123-4567")
    unfinished.create({"points": Cut({}, {}, {})}, identity={"attributes": {"title": "Half a field"}})
    (tmp_path / "outputs" / "no result").mkdir()
    found = {one["about"].split()[-1]: one for one in studies_in(tmp_path / "outputs")}
    assert set(found) == {"broken", "unfinished"}
    assert found["broken"]["state"] == "damaged"
    assert found["unfinished"]["title"] == "Half a field"
    assert found["unfinished"]["state"] != "complete"
    text = Page(write_index(tmp_path / "outputs").read_text(encoding="utf-8")).text
    assert "damaged" in text
