"""Peak memory of whole runs, each in a process of its own, beside what the plan says; more in `tests.bench`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from heliosweep import api
from heliosweep.errors import PlanError
from heliosweep.families.lookup import family_of
from heliosweep.grid.plan import BASE_MEMORY, REPORT_MEMORY
from tests.bench.bench_memory import FACTOR, peak_memory, shipped

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="memory is read from /proc")


TWO: dict[str, Any] = {"execution": {"workers": 2}}


def field_series(clearance: int, heliostats: int, days: dict[str, int], step: float, **output: str) -> dict[str, Any]:
    return shipped(
        "latitude_sweep",
        **TWO,
        site={"latitude": 30},
        tracking="azimuth_elevation",
        layout={"radial_stagger": {"clearance": clearance, "inner_radius": 61.3, "heliostats": heliostats}},
        time={"clock": "solar", "days": days, "hours": {"start": 6, "stop": 18, "step": step}, "sampling": "midpoint"},
        output={"time_series": True, **output},
    )


def series() -> dict[str, Any]:
    """Time series of 70 MB: of two parts."""
    return field_series(16, 500, {"start": 1, "stop": 365, "step": 4}, 0.25)


def wide_series() -> dict[str, Any]:
    """Time series of 10,000 heliostats.

    They stand far apart, which is quick to compute and takes the same memory.
    """
    return field_series(40, 10_000, {"start": 1, "stop": 30, "step": 1}, 0.6)


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


@pytest.mark.parametrize(
    ("content", "arguments"),
    [
        (shipped("figure7_hyperbolas", **TWO), []),
        pytest.param(series(), [], marks=pytest.mark.long),
        pytest.param(wide_series(), ["--no-report"], marks=pytest.mark.long),
    ],
    ids=["little", "time series", "wide time series"],
)
def test_plan_foresees_the_peak(content, arguments, tmp_path):
    path = written(content, tmp_path)
    study = api.load(path)
    family_of(study).prepare(study)  # the compiler takes more memory than these studies
    planned = api.plan(study, tmp_path / "result").peak_memory
    _, measured = peak_memory(path, tmp_path / "result", *arguments)
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
