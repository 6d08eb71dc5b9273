"""Fixtures that several test folders use."""

import os
import signal
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock
from hypothesis import settings

from heliosweep.api import build, load
from heliosweep.config.study import Study
from tests.families.studies import study

settings.register_profile("heliosweep", deadline=None, derandomize=True)  # machines differ in speed
settings.load_profile("heliosweep")

ROOT = Path(__file__).parent.parent
STUDIES = ROOT / "studies"

_HOURS = {"start": 7, "stop": 17, "step": 1}
SMALL: dict[str, Any] = {
    "family": "field_efficiency",
    "title": "a small field",
    "site": {"latitude": [0, 40]},
    "tracking": ["spinning_elevation", "azimuth_elevation"],
    "time": {"clock": "solar", "days": [80, 355], "hours": _HOURS, "sampling": "inclusive"},
    "layout": {"radial_stagger": {"clearance": 13, "inner_radius": 50, "rings": 2}},
    "heliostat": {"width": 9, "height": 8, "pivot_height": 5},
    "receiver": {"height": 60},
}


#: Folders whose tests call hardly any kernel: they run while another process compiles.
NO_KERNELS = {"config", "layouts"}


def _of_main_thread(change: Callable[..., Any]) -> Callable[..., Any]:
    """Ignore changes of warning filters in other threads, which share them; numba expects a list of warnings."""

    def changed(*arguments: Any, **keywords: Any) -> Any:
        return change(*arguments, **keywords) if threading.current_thread() is threading.main_thread() else []

    return changed


for place, name in (
    (warnings, "filterwarnings"), (warnings, "simplefilter"),
    (warnings.catch_warnings, "__enter__"), (warnings.catch_warnings, "__exit__"),
):  # fmt: skip
    setattr(place, name, _of_main_thread(getattr(place, name)))


def pytest_sessionstart() -> None:
    """Handle signals that were ignored when the tests began, as under nohup, and reach this machine without a proxy."""
    os.environ["no_proxy"] = "*"
    for number in {signal.SIGINT, getattr(signal, "SIGHUP", signal.SIGINT)}:
        if signal.getsignal(number) == signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Compile all kernels in another process, which needs much memory, once for all processes that share the tests."""
    if hasattr(item.config, "workerinput") and item.path.relative_to(ROOT).parts[1] not in NO_KERNELS:
        _compile(item.config._tmp_path_factory.getbasetemp().parent)  # type: ignore[attr-defined]


@cache
def _compile(shared: Path) -> None:
    ready = shared / "compiled"
    with FileLock(shared / "compiled.lock"):
        if not ready.exists():
            subprocess.run([sys.executable, "-m", "heliosweep", "setup"], check=True, capture_output=True)
            ready.touch()


@cache
def shipped(name: str, **changes: Any) -> Any:
    """The result of a shipped study with other values of some keys, computed once in each process."""
    return build(load(STUDIES / f"{name}.yaml", {"execution.memory": "700 MB", **changes})).compute()


@pytest.fixture(scope="session")
def small() -> Callable[..., Study]:
    """Make a small field study; keyword arguments replace whole blocks, None removes one."""
    return partial(study, SMALL)
