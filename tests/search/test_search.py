"""A search through the public face: the best point, killed and resumed, engines, what it leaves, what it refuses."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import heliosweep
from heliosweep import api
from heliosweep.config.study import Study
from heliosweep.errors import HeliosweepError
from heliosweep.runs.search import SearchRun
from heliosweep.search.result import best_of, remarks
from heliosweep.store.folder import status_of, verify
from tests import bad_studies
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
            monkeypatch.setattr("heliosweep.families.family.Family.compute", broken)
        return evaluated(self, points, *rest)

    def broken(*_: Any) -> None:
        raise ArithmeticError("broken")

    monkeypatch.setattr(SearchRun, "_evaluated", failing)
    with pytest.raises(HeliosweepError, match=r"evaluations 11 to \d+ failed \(ArithmeticError: broken\)"):
        run(tmp_path / "result")
    assert status_of(tmp_path / "result").done == 10


def test_the_table_of_the_best_evaluations_begins_with_the_best(result):
    table = result.heliosweep.tables()["The best evaluations"]
    places = table["evaluation"].astype(int) - 1
    values = result.field_optical_efficiency.to_numpy()[places]
    assert places[0] == best_of(result)
    assert (np.diff(values) <= 0).all()
    assert len(table) == 10


@pytest.mark.parametrize(("case", "good", "_"), bad_studies.sections(Path(__file__).with_name("bad_studies.txt")))
def test_bad_search(case, good, _, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bad_studies.check(case, good)
