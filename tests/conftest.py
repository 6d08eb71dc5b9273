"""Fixtures that several test folders use."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock, Timeout
from hypothesis import settings

from heliosweep.api import build, family_of, load
from heliosweep.config.study import Study
from heliosweep.errors import HeliosweepError
from heliosweep.kernels import compiled
from tests.families.studies import study

settings.register_profile("heliosweep", deadline=None, derandomize=True)  # machines differ in speed
settings.load_profile("heliosweep")

ROOT = Path(__file__).parent.parent
STUDIES = ROOT / "studies"

SMALL: dict[str, Any] = {
    "family": "field_efficiency",
    "title": "a small field",
    "site": {"latitude": [0, 40]},
    "tracking": ["spinning_elevation", "azimuth_elevation"],
    "time": {
        "clock": "solar",
        "days": [80, 355],
        "hours": {"start": 7, "stop": 17, "step": 1},
        "sampling": "inclusive",
    },
    "layout": {"radial_stagger": {"clearance": 13, "inner_radius": 50, "rings": 2}},
    "heliostat": {"width": 9, "height": 8, "pivot_height": 5},
    "receiver": {"height": 60},
}


def pytest_sessionstart(session: pytest.Session) -> None:
    """Mind signals; where several processes share the tests, they compile the kernels together, before the first."""
    # Signals that were ignored when the tests began, as in the background or under nohup, would be in all they start.
    for number in {signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGINT)}:
        if signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
    alone = getattr(session.config, "workerinput", None) is None
    if alone or session.config.option.collectonly or compiled.PURE_PYTHON:
        return
    families: dict[str, list[Path]] = {}
    for path in sorted(STUDIES.glob("*.yaml")):
        found = re.search(r"^family: (\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
        families.setdefault(found[1] if found else "", []).append(path)
    shared = session.config._tmp_path_factory.getbasetemp().parent  # type: ignore[attr-defined]
    # First the families that no other process is at, those of many studies before others; then all have to be ready.
    for wait in (False, True):
        for name in sorted(families, key=lambda name: -len(families[name])):
            with suppress(Timeout), FileLock(shared / f"{name}.lock", blocking=wait):
                ready = shared / f"{name}.ready"
                if not ready.exists():
                    _prepare(families[name])
                    ready.touch()


def _prepare(studies: Iterable[Path]) -> None:
    """Compile what studies call."""
    for path in studies:
        with suppress(HeliosweepError):  # whatever is wrong with a study, its tests say so
            study = load(path)
            family_of(study).prepare(study)


@cache
def shipped(name: str) -> Any:
    """The result of a shipped study, computed once in each process."""
    return build(load(STUDIES / f"{name}.yaml")).compute()


@pytest.fixture(scope="session")
def small() -> Callable[..., Study]:
    """Make a small field study; keyword arguments replace whole blocks, None removes one."""
    return partial(study, SMALL)
