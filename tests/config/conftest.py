from collections.abc import Callable
from pathlib import Path

import pytest

from heliosweep.config.load import load
from heliosweep.errors import Problem, StudyError
from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy

REGISTRY = {"field_efficiency": FieldEfficiencyStudy}

#: A good study, one line a block: a test replaces single lines.
LINES = {
    "family": "family: field_efficiency",
    "site": "site: {latitude: 30}",
    "tracking": "tracking: spinning_elevation",
    "time": "time: {clock: solar, hours: {start: 8, stop: 16, step: 0.2}}",
    "layout": "layout: {radial_stagger: {clearance: 16, inner_radius: 60, rings: 4}}",
    "heliostat": "heliostat: {width: 11.1, height: 11.1, pivot_height: 7}",
    "receiver": "receiver: {height: 95}",
}

Load = Callable[..., FieldEfficiencyStudy]


@pytest.fixture
def study_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Write the good study with some of its lines replaced; the file is named study.yaml in the working directory."""
    monkeypatch.chdir(tmp_path)

    def write(extra: str = "", **lines: str) -> Path:
        path = Path("study.yaml")
        path.write_text("\n".join([*(LINES | lines).values(), extra]) + "\n", encoding="utf-8")
        return path

    return write


@pytest.fixture
def load_study(study_file: Callable[..., Path]) -> Load:
    """Load the good study with some of its lines replaced."""
    return lambda extra="", **lines: load(study_file(extra, **lines), REGISTRY)


@pytest.fixture
def refused(load_study: Load) -> Callable[..., tuple[Problem, ...]]:
    """Tell why the good study is refused with some of its lines replaced."""

    def problems(extra: str = "", **lines: str) -> tuple[Problem, ...]:
        with pytest.raises(StudyError) as error:
            load_study(extra, **lines)
        return error.value.problems

    return problems
