"""Peak memory of whole runs, each in a process of its own, beside what the plan says."""

import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from heliosweep import api
from heliosweep.errors import PlanError
from heliosweep.families.lookup import family_of
from heliosweep.grid.plan import BASE_MEMORY, REPORT_MEMORY
from tests.bench.memory import FACTOR, peak_memory, shipped

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="memory is read from /proc")


def draws(memory: int | None = None) -> dict[str, Any]:
    """Calibrations of 3,000 draws of each of six heliostats: blocks of 180 MB, where nothing bounds them."""
    content = shipped("calibration_synthetic", execution={"workers": 2})
    content["mount_errors"]["samples"] = 3000
    content["calibration"] = {"parameters": 4, "noise": content["calibration"]["noise"]}
    if memory is not None:
        content["execution"]["memory"] = f"{memory} B"
    return content


def written(content: dict[str, Any], folder: Path) -> Path:
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def test_plan_foresees_the_peak(tmp_path):
    path = written(shipped("figure7_hyperbolas", execution={"workers": 2}), tmp_path)
    study = api.load(path)
    family_of(study).prepare(study)  # the compiler takes more memory than these studies
    planned = api.plan(study, tmp_path / "result").peak_memory
    _, measured = peak_memory(path, tmp_path / "result")
    assert planned / FACTOR < measured < planned


def test_a_run_keeps_to_the_memory_it_is_given(tmp_path):
    given = BASE_MEMORY + 200 * 2**20
    path = written(draws(given), tmp_path)
    study = api.load(path)
    family_of(study).prepare(study)
    planned = api.plan(study, tmp_path / "result")
    free = api.plan(api.load(draws()), tmp_path / "result")
    assert planned.cuts["points"].chunk["heliostat"] < free.cuts["points"].chunk["heliostat"]
    assert planned.peak_memory <= given < free.peak_memory
    assert peak_memory(path, tmp_path / "result", "--no-report")[1] <= given


def test_a_run_that_cannot_keep_to_it_is_refused(tmp_path):
    with pytest.raises(PlanError, match=r"the program and the dimensions would need .* raise execution\.memory to"):
        api.plan(api.load(draws(BASE_MEMORY + REPORT_MEMORY - 2**20)), tmp_path / "result")
    content = draws(BASE_MEMORY + REPORT_MEMORY + 2**23)
    content["mount_errors"]["samples"] = 100_000
    with pytest.raises(
        PlanError, match=r"the smallest chunk of the computation would need .* raise execution\.memory to"
    ):
        api.plan(api.load(content), tmp_path / "result")
