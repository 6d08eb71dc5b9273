"""Whatever stands in the file, it loads or is refused with located problems; and loading is quick."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from heliosweep.config.load import load
from heliosweep.errors import Problem, StudyError

from .conftest import LINES, REGISTRY

WORDS = [
    "1",
    "-3.5",
    "1e-3",
    ".nan",
    ".inf",
    "~",
    "true",
    "x",
    "3 m",
    "1 deg",
    "''",
    "12:30",
    "2021-02-29",
    "+08:00",
    "solar",
    "civil",
    "{}",
    "[]",
    "[[]]",
    "{start: 1, stop: 2, num: 3}",
    "{start: 2, stop: 1, step: 0.1}",
    "{logspace: 1}",
    "0x1",
    "!!str a",
    "&a b",
    "*a",
    "{: }",
    "{1: 2}",
    "[1, 1]",
    "9999999999999999999999",
    "a.csv",
]
KEYS = [
    "latitude",
    "longitude",
    "altitude",
    "timezone",
    "clock",
    "hours",
    "days",
    "declination",
    "dates",
    "window",
    "start",
    "stop",
    "step",
    "num",
    "file",
    "radial_stagger",
    "clearance",
    "inner_radius",
    "rings",
    "zones",
    "width",
    "height",
    "pivot_height",
    "sampling",
    "name",
    "pitch",
    "heliostats",
]

value = st.recursive(
    st.sampled_from(WORDS),
    lambda inner: (
        st.lists(inner, max_size=3).map(lambda items: f"[{', '.join(items)}]")
        | st.dictionaries(st.sampled_from(KEYS), inner, max_size=4).map(
            lambda items: "{" + ", ".join(f"{key}: {item}" for key, item in items.items()) + "}"
        )
    ),
    max_leaves=8,
)
block = st.sampled_from([*LINES, "sites", "zip", "execution", "output", "report", "title", "references"])
relaxed = settings(max_examples=100, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def loads_or_explains(path: Path) -> None:
    problems: tuple[Problem, ...] = ()
    try:
        load(path, REGISTRY)
    except StudyError as error:
        problems = error.problems
    assert all(problem.message and problem.file for problem in problems)


@given(content=st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode(errors="replace")))
@relaxed
def test_any_content(tmp_path_factory, content: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_bytes(content)
    loads_or_explains(path)


@given(changes=st.dictionaries(block, value, min_size=1, max_size=3))
@relaxed
def test_any_values(tmp_path_factory, changes: dict[str, str]) -> None:
    path = tmp_path_factory.getbasetemp() / "values.yaml"
    lines = LINES | {key: f"{key}: {text}" for key, text in changes.items()}
    path.write_text("\n".join(lines.values()), encoding="utf-8")
    loads_or_explains(path)


def test_large_files_are_refused_quickly(tmp_path: Path) -> None:
    path = tmp_path / "large.yaml"
    for text in ("x: " + "[" * 900_000, "x: [" + "a, " * 300_000 + "]", "? " * 400_000, "{" * 900_000, "- " * 400_000):
        path.write_text(text, encoding="utf-8")
        loads_or_explains(path)


def test_importing_needs_nothing_heavy() -> None:
    code = (
        "import sys, heliosweep.config.load, heliosweep.config.study, heliosweep.families.field_efficiency.study;"
        "print(*({'pandas', 'xarray', 'dask', 'numba', 'scipy', 'pvlib', 'pint', 'matplotlib'} & set(sys.modules)))"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    loaded = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert loaded.stdout.strip() == ""
