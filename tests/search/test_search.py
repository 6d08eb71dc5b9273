"""A search through the public face: the best point, killed and resumed, engines, what it leaves, what it refuses."""

from __future__ import annotations

import shutil
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import heliosweep
from heliosweep import api
from heliosweep.config.study import Study
from heliosweep.errors import HeliosweepError, StudyError
from heliosweep.runs.search import SearchRun
from heliosweep.search.result import best_of, remarks
from heliosweep.share.archive import pack_result
from heliosweep.store.folder import status_of
from heliosweep.store.read import verify
from tests.conftest import SMALL

CLEARANCE, HEIGHT = "layout.radial_stagger.clearance", "receiver.height"
SEARCH: dict[str, Any] = {
    "maximise": "field_optical_efficiency",
    "over": {HEIGHT: [30, 90], CLEARANCE: [13, 30]},
    "budget": 60,
    "seed": 1,
}
ONE: dict[str, Any] = {
    **SMALL,
    "site": {"latitude": 35},
    "tracking": "azimuth_elevation",
    "layout": {"radial_stagger": {"inner_radius": 50, "heliostats": 30}},
    "receiver": {"height": 60},
}


def study(**search: Any) -> Study:
    said = {key: value for key, value in {**SEARCH, **search}.items() if value is not None}
    return heliosweep.load({**ONE, "search": said})


def run(folder: Path, **search: Any) -> api.Result:
    return api.run(study(**search), folder, report=False)


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    return run(tmp_path_factory.mktemp("search") / "result")


@pytest.fixture
def result(ran):
    with ran.open() as data:
        yield data


def test_the_best_of_a_coarse_sweep_is_no_better(result, tmp_path):
    swept = {**ONE, "receiver": {"height": [30, 50, 70, 90]}}
    swept["layout"] = {"radial_stagger": {"inner_radius": 50, "heliostats": 30, "clearance": [13, 16, 20, 25, 30]}}
    coarse = api.build(swept).field_optical_efficiency.max().compute().item()
    found = result.field_optical_efficiency.to_numpy()
    assert found[best_of(result)] == found.max() >= coarse
    assert found.max() - np.median(found[:20]) > 0.01


def test_each_evaluation_is_what_the_study_gives_there(result):
    for place in (0, 7, best_of(result)):
        at = result.isel(evaluation=place)
        one = {**ONE, "receiver": {"height": at.receiver_height.item()}}
        one["layout"] = {"radial_stagger": {"inner_radius": 50, "heliostats": 30, "clearance": at.clearance.item()}}
        alone = api.build({**one, "output": {"field_geometry": True}}).compute()
        for name in ("field_optical_efficiency", "field_land_area", "field_heliostats"):
            assert at[name].item() == alone[name].item()
    assert result.evaluation.to_numpy().tolist() == [*range(1, result.sizes["evaluation"] + 1)]
    assert result.receiver_height[0] == 60.0  # where the study stood
    assert result.clearance[0] == 21.5  # the middle
    assert result.generation.to_numpy()[:10].tolist() == 10 * [0]
    assert result.receiver_height.attrs["key"] == HEIGHT


def test_best_yaml_runs_by_itself(ran, result):
    best = best_of(result)
    assert best is not None
    again = api.build(api.load(ran.folder / "best.yaml")).field_optical_efficiency.compute().item()
    assert again == result.field_optical_efficiency[best].item()
    assert f"Evaluation {best + 1} of the search" in (ran.folder / "best.yaml").read_text()
    assert "search" not in yaml.safe_load((ran.folder / "best.yaml").read_text())


def test_a_best_value_on_a_bound_is_said(result):
    assert result.receiver_height[best_of(result)] == 90
    (said,) = remarks(result)
    assert said == f"the best {HEIGHT} is on the upper bound of the search, 90; a better point may lie beyond"


def test_the_result_folder_is_that_of_any_study(ran, tmp_path):
    assert verify(ran.folder).ok
    assert status_of(ran.folder).state == "complete"
    assert api.run(study(), ran.folder, report=False).seconds == {}  # found
    planned = api.plan(study())
    assert planned.chunk_count == SEARCH["budget"]
    assert "evaluation 60" in planned.in_words()["dimensions"]
    again = api.load(ran.folder / "study.resolved.yaml")
    assert again.study_id == study().study_id


def test_the_page_tells_of_the_best(ran):
    page = api.report(ran.folder).read_text()
    assert "The best evaluations" in page or "evaluation</th>" in page
    assert {path.name for path in (ran.folder / "figures").glob("*.png")} == {
        "course.png",
        "over_clearance.png",
        "over_receiver_height.png",
    }
    assert "is on the upper bound" in page


def test_a_notebook_shows_the_figures_and_the_archive_has_the_study(ran, result, tmp_path):
    assert [one.name for one in result.heliosweep.figures()] == ["over_clearance", "over_receiver_height", "course"]
    assert result.heliosweep.study.study_id == study().study_id
    archive = pack_result(ran.folder, tmp_path / "packed.zip", draft=True)
    assert any(name.endswith("study.yaml") for name in zipfile.ZipFile(archive).namelist())


class Stop(BaseException):
    """What kills a run."""


def test_killed_and_resumed_to_the_same_bytes(ran, tmp_path, monkeypatch):
    evaluated, asked, at = SearchRun._evaluated, list[int](), 4

    def counted(self: SearchRun, points: np.ndarray, *rest: Any) -> Any:
        asked.append(len(points))
        if len(asked) == at + 1:
            shutil.copytree(tmp_path / "first", tmp_path / "killed")  # as the disk is then
            raise Stop
        return evaluated(self, points, *rest)

    monkeypatch.setattr(SearchRun, "_evaluated", counted)
    with pytest.raises(Stop):
        run(tmp_path / "first")
    before = sum(asked[:at])
    assert status_of(tmp_path / "first").done == before
    assert "are done" in str(verify(tmp_path / "first"))
    asked.clear()
    asked += [0] * (at + 1)  # lets all through
    again = run(tmp_path / "killed")
    assert again.path.read_bytes() == ran.path.read_bytes()
    assert (again.folder / "best.yaml").read_text() == (ran.folder / "best.yaml").read_text()
    with again.open() as data:
        assert sum(asked) == data.sizes["evaluation"] - before


@pytest.mark.parametrize(
    "scheduler", ["synchronous", *(pytest.param(name, marks=pytest.mark.long) for name in ("processes", "distributed"))]
)
def test_the_same_bytes_by_any_engine(ran, tmp_path, scheduler):
    said = {**ONE, "search": SEARCH, "execution": {"scheduler": scheduler, "workers": 2, "chunks": {"heliostat": 9}}}
    assert api.run(said, tmp_path / "other", report=False).path.read_bytes() == ran.path.read_bytes()


def test_two_goals_names_and_bounds(tmp_path):
    found = run(
        tmp_path / "front",
        minimise=["land_area"],
        over={**SEARCH["over"], "tracking": {"choice": ["azimuth_elevation", "spinning_elevation"]}},
        subject_to={"heliostats": {"at_least": 20}, "field_land_area": {"at_most": 20000}},
        budget=90,
    )
    with found.open() as data:
        best, land = data.best.to_numpy() == 1, data.field_land_area.to_numpy()
        assert best.sum() > 3
        assert np.array_equal(data.feasible == 1, (land <= 20000))
        assert not (best & (land > 20000)).any()
        efficiency = data.field_optical_efficiency.to_numpy()
        order = np.argsort(land[best])
        assert np.all(np.diff(efficiency[best][order]) > 0)
        assert {*data.tracking.to_numpy().tolist()} == {"azimuth_elevation", "spinning_elevation"}
        assert data.attrs["study_id"] == json_id(found.folder)
    page = api.report(found.folder).read_text()
    assert "Along the front" in page or "on the front" in page


def json_id(folder: Path) -> str:
    return api.load(folder / "study.resolved.yaml").study_id


def test_plants_that_cannot_be_built_are_passed_over(tmp_path):
    """Mirrors of 9 x 8 m whose centres are nearer than 8 m are in each other, however they turn."""
    found = run(tmp_path / "result", maximise=None, minimise="field_land_area", over={CLEARANCE: [5, 30]}, budget=40)
    with found.open() as data:
        lost = np.isnan(data.field_land_area.to_numpy())
        assert np.array_equal(lost, data.clearance.to_numpy() < 8)
        assert lost.any()
        assert 8 <= data.clearance[best_of(data)] < 8.1
        assert "the plant is infeasible" in " ".join(remarks(data))


def test_a_failing_generation_is_told_and_the_others_are_kept(tmp_path, monkeypatch):
    evaluated, calls = SearchRun._evaluated, list[int]()

    def failing(self: SearchRun, points: np.ndarray, *rest: Any) -> Any:
        calls.append(1)
        if len(calls) == 2:
            monkeypatch.setattr("heliosweep.families.points.compute", broken)
        return evaluated(self, points, *rest)

    def broken(*_: Any) -> None:
        raise ArithmeticError("broken")

    monkeypatch.setattr(SearchRun, "_evaluated", failing)
    with pytest.raises(HeliosweepError, match=r"evaluations 11 to \d+ failed \(ArithmeticError: broken\)"):
        run(tmp_path / "result")
    assert status_of(tmp_path / "result").done == 10


BAD = [
    ({"maximise": "field_optcal_efficiency"}, "search.maximise: field_optcal_efficiency is no result of this study; "
     "did you mean 'field_optical_efficiency'?; results of one number are field_cosine_efficiency, "),
    ({"minimise": "field_optical_efficiency"}, "search.minimise: is also maximised: remove one of them"),
    ({"maximise": None}, "search: give one result to 'maximise' or 'minimise', or two results for a front"),
    ({"maximise": 3}, "search.maximise: must be the name of a result, or a list of two (got 3)"),
    ({"subject_to": {"gold": {"at_least": 1}}}, "search.subject_to.gold: gold is no result of this study; "
     "results of one number are "),
    ({"maximise": "field_optical_efficiency", "minimise": "optical_efficiency"},
     "search.minimise: optical_efficiency is the same result as field_optical_efficiency: list it once"),
    ({"subject_to": {"heliostats": {"at_least": 3}, "field_heliostats": {"at_most": 9}}},
     "subject_to.field_heliostats: field_heliostats is the same result as heliostats: list it once"),
    ({"subject_to": {"heliostats": {}}}, "search.subject_to.heliostats: give 'at_least', 'at_most' or both"),
    ({"subject_to": {"heliostats": {"at_least": 3, "at_most": 2}}}, "at_least: must not exceed 'at_most'"),
    ({"over": {}}, "search.over: must not be empty"),
    ({"over": {"receiver.hight": [30, 90]}}, "search.over.receiver.hight: is not a key that can be searched; did "
     "you mean "
     "'receiver.height'?"),
    ({"over": {"layout.file": {"choice": ["a.csv", "b.csv"]}}}, "search.over.layout.file: is not a key that can"),
    ({"over": {HEIGHT: [90, 30]}}, "search.over.receiver.height: the first number must be smaller than the second"),
    ({"over": {HEIGHT: [60, 60.00000001]}}, "search.over.receiver.height: the numbers are too close to search"),
    ({"over": {HEIGHT: [-3, 90]}}, "search.over.receiver.height[0]: must be greater than 0 m"),
    ({"over": {HEIGHT: ["30 kg", 90]}}, "search.over.receiver.height[0]: unknown unit 'kg'; use 'm'"),
    ({"over": {HEIGHT: [60]}}, "search.over.receiver.height: must be the minimum and the maximum: write"),
    ({"over": {HEIGHT: [60, float("nan")]}}, "search.over.receiver.height[1]: must be a finite number"),
    ({"over": {HEIGHT: [70, 90]}}, "receiver.height: is the start of the search and must be between 70 and 90, its"),
    ({"over": {"tracking": ["a", "b"]}}, "search.over.tracking: is a name: write {choice: [...]}"),
    ({"over": {"tracking": {"choice": ["azimuth_elevation", "sideways"]}}}, "tracking.choice[1]: unknown choice"),
    ({"over": {"tracking": {"choice": ["azimuth_elevation"]}}}, "choice: must be a list of at least two values"),
    ({"over": {"tracking": {"choices": ["azimuth_elevation"]}}}, "unknown key; did you mean 'choice'?"),
    ({"budget": 9}, "search.budget: must be at least 10, one generation of a search over 2 keys (got 9)"),
    ({"budget": 2.5}, "search.budget: must be a whole number (got 2.5)"),
    ({"seed": -1}, "search.seed: must be between 0 and"),
]  # fmt: skip


@pytest.mark.parametrize(("said", "message"), BAD, ids=[message[:40] for _, message in BAD])
def test_what_is_wrong_is_said_where_it_stands(said, message):
    content = {**ONE, "search": {key: value for key, value in {**SEARCH, **said}.items() if value is not None}}
    content["layout"] = {"radial_stagger": {"inner_radius": 50, "heliostats": 30, "clearance": 20}}
    with pytest.raises(StudyError) as caught:
        heliosweep.load(content)
    assert message in str(caught.value)
    assert len(caught.value.problems) == 1


@pytest.mark.parametrize(
    ("blocks", "message"),
    [
        (
            {"site": {"latitude": [0, 30]}},
            "site.latitude: has 2 values, but a search has one result for each evaluation",
        ),
        ({"receiver": {"height": [40, 60]}}, "receiver.height: has 2 values, but a search has one result"),
        (
            {"receiver": {"height": {"normal": [40, 1]}}},
            "receiver.height: is drawn from a distribution",
        ),
        (
            {"report": {"published": {"file": "README.md", "source": "x"}}},
            "report.published: is for sweeps",
        ),
    ],
    ids=["swept", "swept and searched", "drawn", "published"],
)
def test_what_cannot_stand_beside_a_search(blocks, message, monkeypatch):
    monkeypatch.chdir(Path(__file__).parents[2])
    with pytest.raises(StudyError) as caught:
        heliosweep.load({**ONE, **blocks, "search": SEARCH})
    assert message in str(caught.value)


def test_the_table_of_the_best_evaluations_begins_with_the_best(result):
    table = result.heliosweep.tables()["The best evaluations"]
    places = table["evaluation"].astype(int) - 1
    values = result.field_optical_efficiency.to_numpy()[places]
    assert places[0] == best_of(result)
    assert (np.diff(values) <= 0).all()
    assert len(table) == 10


def test_a_search_ends_with_its_optimum_its_place_and_how_flat_it_is(ran, result):
    values = 100 * result.field_optical_efficiency.to_numpy()
    best = best_of(result)
    assert best is not None
    near = values >= values.max() - 0.1
    text = ran.summary()
    (line,) = [line for line in text.splitlines() if line.startswith("maximum ")]
    assert line.startswith(f"maximum {values[best]:.5g} % at ")
    assert f"(evaluation {best + 1} of {values.size}); within 0.1 points: " in line
    for name in ("receiver_height", "clearance"):
        ends = result[name].to_numpy()[near]
        assert f"{ends.min():.4g} to {ends.max():.4g} m" in line


@pytest.mark.parametrize(
    ("goal", "hint"),
    [
        ("peak_flux", "peak_flux is no result of this study; with 'output.flux_map' it is"),
        ("total_efficiency", "total_efficiency is no result of this study; with 'optics' it is"),
        ("shading", "shading is no result of this study; with 'shading' in their names are field_shading_efficiency"),
    ],
)
def test_a_goal_that_is_no_result_leads_to_the_key_or_the_name(goal, hint):
    with pytest.raises(StudyError, match=hint):
        study(maximise=goal)
