"""The example of "Add a family" is built, installed, found by its entry point, and does what every family must."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT

from .pages import DOCS

EXAMPLE = DOCS / "examples" / "fixed_panel"


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Install the package beside this environment, without the network."""
    target = tmp_path_factory.mktemp("installed")
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check", "-q"]
    pip = [sys.executable, "-m", "pip", "install", *options, "--target", str(target), str(EXAMPLE)]
    subprocess.run(pip, check=True, timeout=900)
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(target), os.environ.get("PYTHONPATH", "")])}


def run(environment: dict[str, str], folder: Path, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_it_passes_the_tests_of_all_families(environment: dict[str, str]) -> None:
    one = ("-p", "no:cacheprovider", "tests/families/test_contract.py", "-k", "fixed_panel")
    assert "....." in run(environment, ROOT, "-m", "pytest", *one)


def test_its_commands_and_its_numbers(environment: dict[str, str], tmp_path: Path) -> None:
    """A flat panel under a sun in the zenith, and the sun of an equinox seen from the equator all day long."""
    code = """
import heliosweep, numpy as np
from heliosweep.cli import main
assert main(["new", "fixed_panel", "panel.yaml"]) == main(["run", "panel.yaml", "-o", "result"]) == 0
hours = {"start": 6, "stop": 18, "num": 1441}
time = {"clock": "solar", "declination": 0, "hours": hours, "sampling": "midpoint"}
study = {"family": "fixed_panel", "site": {"latitude": 0}, "time": time, "panel": {"tilt": [0, 90, 180]}}
made = heliosweep.build(heliosweep.load(study)).compute()
np.testing.assert_allclose(made.mean_cosine, [2 / np.pi, 0, 0], atol=1e-6)
assert made.lit_fraction[0] == 1
"""
    run(environment, tmp_path, "-c", code)
    assert list((tmp_path / "result" / "figures").glob("tilts.*"))
