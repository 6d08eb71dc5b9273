"""The page of a result: complete, harmless, self-contained, and the same every time."""

import itertools
import json
import platform
from html.parser import HTMLParser
from types import SimpleNamespace

import pytest

from heliosweep.cli import main
from heliosweep.families.lookup import family_of_result
from heliosweep.report import page
from heliosweep.store.folder import open_result, result_digest
from tests.report.synthetic import BOTH, result

_NONE = {"study_class": lambda: None, **dict.fromkeys(("figures", "tables", "answers"), lambda _: ())}
PLAIN = SimpleNamespace(name="plain", headlines=("field_optical_efficiency",), **_NONE)


def write_report(folder, study=None, family_of=lambda _: PLAIN, **how):
    """Write the page of a result without figures, which take long, unless `family_of` returns a family with some."""
    with open_result(folder) as data:
        return page.write_report(data, folder, family_of(data), study, **how)


EVIL = "<script>alert('&')</script>"
VOID = {"meta", "img", "br", "link", "input"}


class Page(HTMLParser):
    """Parses a page, checks that every element is closed, and gathers what matters."""

    def __init__(self, text):
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.scripts: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "script" in self.open:
            self.scripts[-1] += data
        elif "style" not in self.open:
            self.text += data

    def all(self, tag):
        return [attrs for name, attrs in self.elements if name == tag]


def filled(tmp_path):
    """Result folder as a run leaves it, with words that would like to be markup."""
    references = (
        "Chong and Tan (2012), doi 10.1155/2012/908364; Chong, K.-K. and Tan, M. H. (2012). doi:10.1155/2012/908364"
    )
    data = result({"latitude": [0.0, 15.0], "tracking": BOTH}, attrs={"title": EVIL, "references": references})
    data.to_netcdf(tmp_path / "result.nc", engine="netcdf4")
    (tmp_path / "study.resolved.yaml").write_text(f"title: {EVIL}\n", encoding="utf-8")
    path = tmp_path / "result.nc"
    manifest = {
        "command": ["heliosweep", "run", "other.yaml", f"./{EVIL}.yaml", "--quiet"],
        "study_file": f"{EVIL}.yaml",
        "study_id": "abc",
        "environment": {"packages": {"heliosweep": "0.1.0", "numpy": "2.0", "pvlib": None}, "commit": None},
        "result": {"file": "result.nc", "bytes": path.stat().st_size, "sha256": result_digest(path)},
        "seconds": {"compute": 1.5},
        "scheduler": "threads",
        "workers": 2,
    }
    (tmp_path / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    return tmp_path


@pytest.fixture
def folder(tmp_path):
    return filled(tmp_path)


def study(folder, published=None):
    """As much of a study as the report asks for."""
    return SimpleNamespace(report=SimpleNamespace(published=published), resolve=lambda name: folder / name)


def published(folder, tolerance):
    lines = ["latitude,tracking,quantity,published,unit,tolerance"]
    lines.append(f"15,azimuth_elevation,field_cosine_efficiency,75.0,percent,{tolerance}")
    (folder / "table.csv").write_text("\n".join(lines), encoding="utf-8")
    return SimpleNamespace(file="table.csv", source=f"A paper {EVIL}")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Page with everything: figures, plots, a comparison."""
    folder = filled(tmp_path_factory.mktemp("whole"))
    return write_report(folder, study(folder, published(folder, 100)), family_of_result)


def test_page_is_complete_and_well_formed(whole):
    folder, text = whole.parent, whole.read_text(encoding="utf-8")
    assert whole == folder / "report.html"
    assert text.startswith("<!doctype html>")
    page = Page(text)
    assert page.all("html") == [{"lang": "en"}]
    assert len(page.all("h1")) == 1
    headings = ("Results", "Figures", "Explore", "Inputs", "Provenance", "References")
    assert len(page.all("h2")) == len(headings)
    assert all(page.text.rindex(one) < page.text.rindex(other) for one, other in itertools.pairwise(headings))
    for words in (*headings, "Computed and published", f"{(folder / 'result.nc').stat().st_size:,} bytes", "numpy 2.0"):
        assert words in page.text
    images = page.all("img")
    assert len(images) == len(list((folder / "figures").glob("[!.]*"))) == 3
    assert [image["alt"][:9] for image in images] == ["Figure 1.", "Figure 2.", "Figure 3."]
    # The first screen has the headline numbers and the main picture; inputs and provenance are folded.
    first = text.partition("<main>")[0]
    assert first.count("<dt>") == 1
    assert first.count("<img") == 1
    best = 100 * float(result({"latitude": [0.0, 15.0], "tracking": BOTH})["field_optical_efficiency"].max())
    assert f"<b>{best:.2f}</b> %" in first
    for name in ("inputs", "provenance"):
        assert f'<section id="{name}"><details><summary>' in text
    # References are listed once.
    links = [link["href"] for link in page.all("a")]
    assert links.count("https://doi.org/10.1155/2012/908364") == 1
    # The contents lead to every section, and to the files beside the page.
    sections = [section["id"] for section in page.all("section")]
    assert [link[1:] for link in links if link.startswith("#")] == [*sections]
    beside = [link for link in links if not link.startswith(("#", "https:"))]
    assert beside == ["result.nc", "study.resolved.yaml", "figures/"]
    assert all((folder / link).exists() for link in beside)
    assert len(page.all("li")) == 1


def test_a_quoted_identifier_is_a_link_without_its_quotes():
    link = '<a href="https://doi.org/10.1000/a">doi:10.1000/a</a>'
    assert page.linked('"doi:10.1000/a" & more') == f"&#34;{link}&#34; &amp; more"


def test_words_never_become_markup_and_nothing_is_fetched(whole):
    text = whole.read_text(encoding="utf-8")
    page = Page(text)
    assert "other.yaml" not in page.text
    assert page.text.count(EVIL) == 4  # title, heading, source, study; the command has shell quotes in between
    for tag, attrs in page.elements:
        assert str(attrs.get("src", "data:")).startswith("data:")
        assert tag == "a" or "href" not in attrs
    style = text.split("</style>")[0]
    assert "url(" not in style
    assert "@import" not in style


@pytest.mark.parametrize(
    ("tolerance", "verdict", "kind"), [(100, "agrees", "agrees"), (0, "does not agree", "differs")]
)
def test_verdicts_are_said_in_words_and_kept_for_later(folder, tolerance, verdict, kind):
    first = write_report(folder, study(folder, published(folder, tolerance))).read_text(encoding="utf-8")
    page = Page(first)
    assert verdict in page.text
    assert {"class": f"verdict {kind}"} in page.all("p")
    (folder / "table.csv").unlink()
    assert write_report(folder).read_text(encoding="utf-8") == first


def test_page_is_the_same_every_time(whole):
    first, folder = whole.read_bytes(), whole.parent
    assert write_report(folder, study(folder, published(folder, 100)), family_of_result).read_bytes() == first


def test_figures_of_an_earlier_run_go_away_and_others_come_in_the_formats_of_the_command(folder, capsys):
    (folder / "figures").mkdir()
    torn = f".field_maps.png.{platform.node()}.999999999-0.part"  # by a process that was killed
    for name in ("old.png", "holiday.png", "notes.txt", torn):
        (folder / "figures" / name).touch()
    (folder / "figures" / ".drawn").write_text("old.png\ngone.png\n../report.html\n")
    with pytest.raises(SystemExit):
        main(["report", str(folder), "--format", "gif"])
    assert "png, svg, pdf" in capsys.readouterr().err
    assert main(["report", str(folder), "--format", "png, SVG"]) == 0
    assert capsys.readouterr().out.strip() == str(folder / "report.html")
    names = {path.name for path in (folder / "figures").iterdir()}
    drawn = {
        f"{name}.{kind}" for name in ("field_maps", "field_maps_differences", "efficiency_over_latitude")
        for kind in ("png", "svg")
    }  # fmt: skip
    assert names == {".drawn", "holiday.png", "notes.txt", *drawn}


def test_long_sweeps_are_cut_with_a_note_and_sorted(tmp_path):
    data = result({"receiver_height": [*range(80, 280)]}, heliostats=1)
    data.to_netcdf(tmp_path / "result.nc", engine="netcdf4")
    text = write_report(tmp_path).read_text(encoding="utf-8")
    page = Page(text)
    assert "Only the first 100 of 200 rows are shown" in page.text
    table = text.partition("<tbody>")[2].partition("</tbody>")[0]
    assert table.count("<tr>") == 100
    assert "best first" in page.text


def test_remarks_of_the_run_stand_before_the_results(folder):
    assert "Please note" not in Page(write_report(folder).read_text(encoding="utf-8")).text
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    (folder / "manifest.json").write_text(json.dumps({**manifest, "remarks": [f"2 of 3 {EVIL}"]}), encoding="utf-8")
    page = Page(write_report(folder).read_text(encoding="utf-8"))
    assert not any(EVIL in script for script in page.scripts)
    assert page.text.index("Please note") < page.text.index(f"2 of 3 {EVIL}") < page.text.rindex("Results")
    assert {"class": "remarks", "role": "note"} in page.all("aside")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x\n", "Expecting value"),
        ("[1]", "list indices"),
        ("{}", "'result'"),
        ('{"result": {"file": "other.nc", "sha256": ""}}', "it contains no result"),
        ("\udcff", "invalid start byte"),
    ],
)
def test_a_damaged_manifest_is_told_in_one_line(folder, caplog, text, said):
    (folder / "manifest.json").write_text(text, encoding="utf-8", errors="surrogateescape")
    page = Page(write_report(folder).read_text(encoding="utf-8"))
    assert f"{folder}: manifest.json: is damaged: " in caplog.text
    assert said in caplog.text.strip()
    assert len(caplog.messages) == 1
    assert "\n" not in caplog.messages[0]
    assert "manifest.json: is damaged: " in page.text
    assert "The provenance is missing" in page.text
