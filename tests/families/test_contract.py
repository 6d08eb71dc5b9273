"""What every family must do, for each registered one."""

import inspect
import logging
import pickle
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import xarray as xr
import yaml

from heliosweep import api
from heliosweep.config.study import json_schema
from heliosweep.families import family as registry
from heliosweep.families.family import families, study_classes
from heliosweep.grid.plan import EMPTY_FILE, Limits, Work, make_plan
from heliosweep.grid.regions import bytes_of
from tests import bad_studies
from tests.conftest import STUDIES

SHIPPED = sorted(STUDIES.glob("*.yaml"))
#: Program that computes the parts on standard input and prints their variables.
COMPUTE = "import pickle, sys; print(*(sorted(work.compute(part)) for work, part in pickle.load(sys.stdin.buffer)))"


@pytest.fixture(params=list(families().values()), ids=lambda family: family.name, scope="module")
def family(request):
    return request.param


@pytest.fixture(scope="module")
def example(family, tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "example.yaml"
    path.write_text(family.example(), encoding="utf-8")
    return api.load(path)


@pytest.fixture(scope="module")
def ran(example, tmp_path_factory):
    """Result of the example."""
    return api.run(example, tmp_path_factory.mktemp("result"), report=False)


@pytest.fixture
def result(ran):
    with ran.open() as dataset:
        yield dataset


def smallest(workload):
    """The shortest parts that a study can be cut into, but of seven along the dimension that cuts points."""
    return dict.fromkeys(workload.parameters, 1) | ({workload.splittable: 7} if workload.splittable else {})


def test_the_plan_foresees_the_size(family, example, ran, result, tmp_path):
    plan = api.plan(example, tmp_path)
    assert dict(result.sizes) == plan.workload.sizes
    assert result.nbytes - sum(label.nbytes for label in result.coords.values()) == bytes_of(
        family.variables(example), plan.workload.sizes
    )
    # The plan takes the attributes of a large family for an empty file.
    assert (plan.output_bytes - EMPTY_FILE) / 1.5 < ran.path.stat().st_size < plan.output_bytes * 1.5


def test_variables_are_as_stated(family, example, result):
    lazy, stated = api.build(example), family.variables(example)
    assert list(lazy.data_vars) == list(result.data_vars) == list(stated)
    for name, variable in stated.items():
        for array in (lazy[name], result[name]):
            assert array.dims == variable.dims
            assert array.dtype == variable.dtype
            told = {key: value for key, value in array.attrs.items() if key in variable.attrs}
            np.testing.assert_equal(told, dict(variable.attrs))
    assert set(lazy.coords) == set(result.coords)


def test_no_number_depends_on_the_cut(family, example, result):
    chunks = smallest(family.workload(example))
    cut = example.model_copy(update={"execution": example.execution.model_copy(update={"chunks": chunks})})
    for study in (example, cut):
        lazy = api.build(study)
        assert all(array.chunks is not None for array in lazy.data_vars.values())
        for name, array in lazy.compute().data_vars.items():
            assert array.to_numpy().tobytes() == result[name].to_numpy().tobytes(), name


def test_computations_read_no_file(tmp_path):
    """Compute a part of a study for each kind of file in another process, after all files are removed."""
    folder = tmp_path / "studies"
    shutil.copytree(STUDIES, folder)
    given, names, seen = [], [], set[tuple[str, str]]()
    for path in sorted(folder.glob("*.yaml")):
        text = path.read_text(encoding="utf-8")
        of, kinds = re.findall(r"^family: .*", text, re.MULTILINE), re.findall(r"(\w+)/\w+\.(?:csv|CSV|png)", text)
        new = {(one, kind) for one in of for kind in kinds if kind != "published"} - seen
        if not new:
            continue
        seen |= new
        study = api.load(path)
        family = families()[study.family]
        workload, variables = family.workload(study), family.variables(study)
        plan = make_plan(workload, variables, Limits(1, 2**34, 2**40), smallest(workload))
        work = Work(family, study, plan.variables, plan.workload.sizes)
        part = next(plan.chunks())
        given.append((work, part))
        names.append(sorted(name for name, one in plan.variables.items() if one.kind == part.kind and not one.finished))
    packed = pickle.dumps(given)
    shutil.rmtree(folder)
    done = subprocess.run([sys.executable, "-c", COMPUTE], input=packed, capture_output=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr.decode()
    assert done.stdout.decode().strip() == " ".join(map(str, names))
    assert len(names) > 6


def test_every_variable_says_what_it_is(result):
    for name, array in result.data_vars.items():
        assert "long_name" in array.attrs, name
        assert "units" in array.attrs or array.dtype.kind == "M", name  # the units of dates are read off
    for name, coordinate in result.coords.items():
        assert "long_name" in coordinate.attrs, name
        assert "units" in coordinate.attrs or coordinate.dtype.kind not in "fi", name
    needed = {"Conventions", "title", "summary", "source", "history", "references", "study_id", "study"}
    assert needed <= set(result.attrs)


def test_schema_takes_the_example_and_refuses_unknown_keys(family):
    schema = json_schema(family.study_class())
    jsonschema.Draft202012Validator.check_schema(schema)
    content = yaml.safe_load(family.example())
    validator = jsonschema.Draft202012Validator(schema)
    validator.validate(content)
    assert not validator.is_valid({**content, "unknown": 1})


def check_names(study):
    """No name is an argument of `sel`, and columns of a layout file cannot have it."""
    family = api.family_of(study)
    arguments = set(inspect.signature(xr.Dataset.sel).parameters)
    coordinates = family.coordinates(study)
    names = {*family.variables(study), *map(str, coordinates.variables), *map(str, coordinates.sizes)}
    assert arguments.isdisjoint(names)
    if any(key.endswith("layout.file") for key in study.files()):
        columns = {str(name) for name, label in coordinates.variables.items() if label.dims[-1:] == ("heliostat",)}
        assert names - columns <= study.reserved_names()


def test_labels_of_an_example_can_be_selected(example):
    check_names(example)


def check_resolved(study, folder):
    """Check that the study file that a run writes loads to the same study."""
    file = folder / "study.resolved.yaml"
    file.write_text(study.to_yaml(folder), encoding="utf-8")
    again = api.load(file)
    assert again.study_id == study.study_id
    assert again.to_yaml(folder) == study.to_yaml(folder)


def test_a_resolved_example_is_the_same(example, tmp_path):
    check_resolved(example, tmp_path)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_study_has_labels_to_select_and_is_the_same_when_resolved(path, tmp_path):
    study = api.load(path)
    check_names(study)
    check_resolved(study, tmp_path)


ENTRIES = [
    ("toy", "heliosweep.families.field_efficiency:FAMILY"),
    ("broken", "there_is_no_such_package:FAMILY"),
    ("dish_tracking", "another_package:FAMILY"),
]
CACHED = (registry.families, registry.study_classes, registry._entries)


@pytest.fixture
def with_others(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Other packages add families."""
    entries = [metadata.EntryPoint(name, value, registry.GROUP) for name, value in ENTRIES]
    monkeypatch.setattr(metadata, "entry_points", lambda group: entries if group == registry.GROUP else [])
    for function in CACHED:
        function.cache_clear()
    yield
    for function in CACHED:
        function.cache_clear()


@pytest.mark.usefixtures("with_others")
@pytest.mark.parametrize("found", [registry.families, registry.study_classes])
def test_a_broken_family_leaves_the_others_alone(found: Any, caplog: pytest.LogCaptureFixture) -> None:
    known: Mapping[str, Any] = found()
    assert known["toy"]
    assert "broken" not in caplog.text
    assert known.get("broken") is None
    assert (
        "the family 'broken' cannot be loaded from there_is_no_such_package:FAMILY: ModuleNotFoundError" in caplog.text
    )
    *ours, other = known
    assert other == "toy"
    assert ours == sorted(ours)
    assert {"dish_tracking", "field_efficiency", "misalignment"} <= set(ours)
    assert len(known) == len(ours) + 1
    assert caplog.text.count("cannot be loaded") == 1
    with pytest.raises(KeyError, match="nothing"):
        known["nothing"]


@pytest.mark.usefixtures("with_others")
def test_of_two_families_of_one_name_ours_is_used(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        assert registry.families()["dish_tracking"].name == "dish_tracking"
    assert caplog.messages == [
        "two families are named 'dish_tracking': heliosweep.families.dish_tracking:FAMILY is used, "
        "another_package:FAMILY is not"
    ]


FILES = sorted(Path(__file__).parent.glob("*/bad_studies.txt"))


@pytest.mark.parametrize(("case", "good", "tables"), [case for path in FILES for case in bad_studies.sections(path)])
def test_bad_study(case, good, tables, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in tables.items():
        Path(name).write_text(text, encoding="utf-8")
    bad_studies.check(case, good, study_classes())
