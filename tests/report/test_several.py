"""One page over several results: what went in, what came out, differences, curves on one axis."""

import copy
import json
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
import yaml

import heliosweep
from heliosweep.cli import main
from tests.conftest import SMALL
from tests.report.synthetic import BOTH, result
from tests.report.test_page import EVIL, Page

LATITUDES = [0.0, 20.0, 40.0]


def folder(place: Path, data: xr.Dataset, **blocks: Any) -> Path:
    """A result folder with a study, as a run leaves it."""
    place.mkdir()
    study = {**copy.deepcopy(SMALL), **blocks}
    data = data.assign_attrs(study=json.dumps(study))
    data.to_netcdf(place / "result.nc", engine="netcdf4")
    (place / "study.resolved.yaml").write_text(yaml.safe_dump(study), encoding="utf-8")
    (place / "report.html").touch()
    return place


def swept(shift: float = 0.0, latitudes: Any = LATITUDES, **more: Any) -> xr.Dataset:
    data = result({"latitude": latitudes, "tracking": BOTH}, heliostats=9, **more)
    return data.map(lambda one: one + shift, keep_attrs=True)


@pytest.fixture
def pair(tmp_path):
    return [
        folder(tmp_path / "low", swept(attrs={"title": EVIL, "study_id": "abc"})),
        folder(tmp_path / "high #1", swept(0.05), receiver={"height": 90}),
    ]


def rows_of(page: Page, text: str) -> list[list[str]]:
    """Cells of the rows of all tables of a page."""
    rows = []
    for row in text.split("<tr")[1:]:
        cells = [cell.partition(">")[2].partition("</td>")[0] for cell in row.split("</tr>")[0].split("<td")[1:]]
        rows.append([" ".join(cell.split()) for cell in cells])
    return rows


def test_a_page_over_two_results(pair, tmp_path):
    page = heliosweep.comparison_page(pair, tmp_path / "page.html")
    text = page.read_text(encoding="utf-8")
    shown = Page(text)
    assert shown.scripts == []
    assert all(words in shown.text for words in ("Results", "Inputs", "Figures"))
    links = [link["href"] for link in shown.all("a")]
    assert links[:2] == ["low/report.html", "high%20%231/report.html"]
    rows = [row for row in rows_of(shown, text) if row]
    assert next(row for row in rows if row[0] == "receiver.height")[1:3] == ["60", "90"]
    assert "other inputs are equal" in shown.text
    came = next(row for row in rows if row[0].startswith("mean optical efficiency"))
    first = 100 * swept()["field_optical_efficiency"].to_numpy()[0, 0]
    assert came[1] == "0\N{DEGREE SIGN}, spinning-elevation"
    assert [float(cell) for cell in came[2:4]] == pytest.approx([first, first + 5], abs=1e-3)
    assert came[4:] == ["+5", "%"]
    alts = [image["alt"] for image in shown.all("img")]
    assert any("Difference of the mean optical efficiency" in alt for alt in alts)
    assert any("against the latitude" in alt for alt in alts)
    assert heliosweep.comparison_page(pair, page, force=True).read_text(encoding="utf-8") == text


def test_the_command_writes_the_page_and_prints_its_path(pair, tmp_path, capsys):
    places = [str(place) for place in pair]
    page = str(tmp_path / "page.html")
    assert main(["compare", *places, places[0], "--page", page]) == 0
    assert capsys.readouterr().out.strip() == page
    assert "3 results" in Path(page).read_text(encoding="utf-8")
    assert main(["compare", *places, "--page", page]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["compare", *places, places[0]]) == 2
    assert "--page: is required to compare more than two" in capsys.readouterr().err
    assert main(["compare", *places]) == 1
    assert "differ; largest difference 0.05" in capsys.readouterr().out
