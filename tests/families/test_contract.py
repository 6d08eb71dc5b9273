"""What every family must do, for each registered one."""

from __future__ import annotations

import jsonschema
import numpy as np
import pytest
import yaml

from heliosweep import workflow
from heliosweep.config.schema import json_schema
from heliosweep.families.registry import families
from heliosweep.grid.plan import EMPTY_FILE

FAMILIES = list(families().values())


@pytest.fixture(params=FAMILIES, ids=lambda family: family.name)
def family(request):
    return request.param


@pytest.fixture
def example(family, tmp_path):
    path = tmp_path / "example.yaml"
    path.write_text(family.example(), encoding="utf-8")
    return workflow.load(path)


def test_example_runs_and_the_plan_foresees_its_size(family, example, tmp_path):
    planned = workflow.plan(example, tmp_path)
    result = workflow.run(example, tmp_path / "result", report=False)
    with result.open() as dataset:
        assert dict(dataset.sizes) == planned.workload.sizes
        assert sum(array.nbytes for array in dataset.data_vars.values()) == planned.workload.bytes_of(
            planned.workload.sizes
        )
        # The plan takes the attributes of a large family for an empty file.
        assert (planned.output_bytes - EMPTY_FILE) / 1.5 < result.path.stat().st_size < planned.output_bytes * 1.5
        for name, array in dataset.data_vars.items():
            assert array.dims == planned.workload.variables[str(name)]


def test_lazy_build_equals_the_run(example, tmp_path):
    lazy = workflow.build(example)
    assert all(array.chunks is not None for array in lazy.data_vars.values())
    with workflow.run(example, tmp_path / "result", report=False).open() as dataset:
        computed = lazy.compute()
        for name in dataset.data_vars:
            np.testing.assert_array_equal(computed[name], dataset[name])
        assert set(computed.coords) == set(dataset.coords)


def test_keywords_are_those_of_the_family(family, example):
    words = workflow.build(example).attrs["keywords"].split(", ")
    assert {"concentrating solar power", *getattr(family, "keywords", ())} <= set(words)
    assert len(words) == len(set(words))
    assert family.name != "dish_tracking" or not any("heliostat" in word for word in words)


def test_every_variable_says_what_it_is(example, tmp_path):
    with workflow.run(example, tmp_path / "result", report=False).open() as dataset:
        for name, array in dataset.data_vars.items():
            assert "long_name" in array.attrs, name
            assert "units" in array.attrs or array.dtype.kind == "M", name  # the units of dates are read off
        for name, coordinate in dataset.coords.items():
            assert "long_name" in coordinate.attrs, name
            assert "units" in coordinate.attrs or coordinate.dtype.kind not in "fi", name
        needed = {"Conventions", "title", "summary", "source", "history", "references", "study_id", "study"}
        assert needed <= set(dataset.attrs)


def test_schema_takes_the_example_and_refuses_unknown_keys(family):
    schema = json_schema(family.study_class())
    jsonschema.Draft202012Validator.check_schema(schema)
    content = yaml.safe_load(family.example())
    validator = jsonschema.Draft202012Validator(schema)
    validator.validate(content)
    assert not validator.is_valid({**content, "unknown": 1})


def test_figures_can_be_drawn(family, example, tmp_path):
    with workflow.run(example, tmp_path / "result", report=False).open() as dataset:
        assert list(family.figures(dataset))
