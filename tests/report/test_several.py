"""One page over several results: what went in, what came out, differences, curves on one axis."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
import yaml

import heliosweep
from heliosweep.cli import main
from heliosweep.errors import StudyError
from heliosweep.report.several import RESULT, together
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
    assert "further inputs are equal" in shown.text
    came = next(row for row in rows if row[0].startswith("mean optical efficiency"))
    first = 100 * swept()["field_optical_efficiency"].to_numpy()[0, 0]
    assert came[1] == "0\N{DEGREE SIGN}, spinning-elevation"
    assert [float(cell) for cell in came[2:4]] == pytest.approx([first, first + 5], abs=1e-3)
    assert came[4:] == ["+5", "%"]
    alts = [image["alt"] for image in shown.all("img")]
    assert any("Difference of the mean optical efficiency" in alt for alt in alts)
    assert any("over the latitude" in alt for alt in alts)
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


def test_no_page_over_a_result_or_of_nothing(pair, tmp_path):
    with pytest.raises(StudyError, match="belongs to a result"):
        heliosweep.comparison_page(pair, pair[0] / "report.html", force=True)
    with pytest.raises(StudyError, match=r"must end in \.html"):
        heliosweep.comparison_page(pair, tmp_path / "page.txt")
    with pytest.raises(StudyError, match="no such file or folder"):
        heliosweep.comparison_page([pair[0], tmp_path / "none"], tmp_path / "page.html")


def test_points_that_all_have_are_set_beside_each_other():
    joined = together({"A": swept(), "B": swept(0.1, latitudes=[40.0, 0.1 + 0.2, 20.0 + 1e-12])})
    assert joined["latitude"].to_numpy().tolist() == [20.0, 40.0]
    expected = [swept().sel(latitude=20.0), swept(0.1, latitudes=[40.0, 0.3, 20.0]).sel(latitude=20.0)]
    for place, one in enumerate(expected):
        found = joined["field_cosine_efficiency"].sel(latitude=20.0).isel({RESULT: place})
        assert found.to_numpy() == pytest.approx(one["field_cosine_efficiency"].to_numpy())


def test_results_without_common_points_are_told_by_their_ranges(tmp_path):
    places = [folder(tmp_path / "a", swept()), folder(tmp_path / "b", swept(latitudes=[1.0, 2.0]))]
    assert together({"A": swept(), "B": swept(latitudes=[1.0, 2.0])}).sizes.get("latitude", 0) == 0
    text = heliosweep.comparison_page(places, tmp_path / "page.html").read_text(encoding="utf-8")
    shown = Page(text)
    assert "no points in common" in shown.text
    assert "Ranges of result A." in shown.text
    assert "Ranges of result B." in shown.text
    assert any(row and row[0].startswith("mean optical") for row in rows_of(shown, text))
    assert shown.all("img") == []


def test_other_layouts_have_no_differences_of_mirrors(tmp_path):
    data = swept()
    moved = data.assign_coords(x=data["x"] + 1).isel(heliostat=slice(0, 8))
    places = [folder(tmp_path / "a", data), folder(tmp_path / "b", moved)]
    shown = Page(heliosweep.comparison_page(places, tmp_path / "page.html").read_text(encoding="utf-8"))
    assert "no difference maps" in shown.text
    assert not any("Difference" in str(image["alt"]) for image in shown.all("img"))
    assert together({"A": data, "B": moved})["optical_efficiency"].sizes["heliostat"] == 9
