"""Rays on a GPU: refusals, and the device's code on a device or in numba's simulator."""

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

import heliosweep
from heliosweep.errors import StudyError
from heliosweep.kernels import device, rays
from tests.kernels.rays.scenes import random_field

_PLACES = [(0.0, 60.0, 4.0), (0.0, 66.0, 4.0)]
_STUDY: dict[str, Any] = {
    "family": "field_efficiency", "tracking": "azimuth_elevation",
    "time": {"clock": "sun", "azimuth": 200, "elevation": 15},
    "layout": {"radial_stagger": {"clearance": 9, "inner_radius": 40, "heliostats": 4}},
    "heliostat": {"width": 6, "height": 5, "pivot_height": 4},
    "receiver": {"kind": "cylinder", "height": 50, "radius": 3, "height_extent": 5},
    "optics": {"sun_shape": {"kind": "pillbox"}, "slope_error": 2, "rays": 64},
    "execution": {"device": "cuda", "scheduler": "synchronous"},
}  # fmt: skip
simulated = os.environ.get("NUMBA_ENABLE_CUDASIM", "0") == "1"
#: A device multiplies and adds in one step, in single precision.
TOLERANCE = 1e-12 if simulated else 1e-5
found_device = device.device_problem() is None
needs_device = pytest.mark.skipif(not found_device, reason="needs a device or the simulator")
without_device = pytest.mark.skipif(found_device, reason="this machine has a device")


@pytest.mark.parametrize(("package", "message"), [(None, "needs the package numba-cuda"), (1, "finds no NVIDIA")])
@without_device
def test_refused_without_a_device(package, message, monkeypatch):
    monkeypatch.setattr(device, "find_spec", lambda name: package)
    receiver = heliosweep.Cylinder(50.0, 3.0, 5.0)
    with pytest.raises(ValueError, match=f"`device` 'cuda' {message}"):
        heliosweep.trace_field(_PLACES, receiver, rays=16, width=6.0, height=5.0, device="cuda")


def test_unknown_devices_are_refused():
    receiver = heliosweep.Cylinder(50.0, 3.0, 5.0)
    with pytest.raises(ValueError, match="`device` must be 'cpu' or 'cuda'"):
        heliosweep.trace_field(_PLACES, receiver, rays=16, width=6.0, height=5.0, device="gpu")


@without_device
def test_studies_are_refused_without_a_device_or_rays(small):
    with pytest.raises(StudyError, match=r"execution.device: (needs the package numba-cuda|finds no NVIDIA)"):
        small(**{key: value for key, value in _STUDY.items() if key != "family"}, site=None)
    with pytest.raises(StudyError, match=r"execution.device: requires a field with 'optics'"):
        small(execution={"device": "cuda"})


@pytest.mark.long
@pytest.mark.skipif(simulated, reason="runs itself in the simulator")
def test_the_code_of_the_device_in_the_simulator():
    """All of this module in the simulator, whose threads are those of Python."""
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-m", "", __file__]
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stdout[-4000:]
    assert "4 passed" in done.stdout


def _suns() -> np.ndarray:
    sun = np.array([[0.0, -0.9, 0.2], [0.5, -0.5, 0.6], [0.0, 0.0, -1.0], [-0.8, 0.1, 0.4]])
    return sun / np.linalg.norm(sun, axis=1)[:, np.newaxis]


@pytest.mark.long
@needs_device
@pytest.mark.parametrize("case", ["cylinder", "rectangle", "strides"])
def test_a_device_traces_the_rays_of_the_processor(case):
    """Threads share their rays, blocks of threads the pairs; the simulator has the arithmetic of the processor."""
    receiver = rays.rectangle((0, 0, 12.0), 0, -0.3, 4, 4) if case == "rectangle" else rays.cylinder((0, 0, 12.0), 3, 4)
    errors = {"errors": (1e-3, 2e-3, 5e-4), "curve": 0.01, "receiver": receiver}
    made = random_field(np.random.default_rng(1), 5, 12.0, tower=(2.0, 9.0), **errors)
    if case == "rectangle":
        grid = np.linspace(-3.0, 3.0, 4)
        slope = 1e-3 * np.random.default_rng(2).normal(size=(1, 4, 4, 2))
        made = made._replace(
            facets=rays.Facets(2, 2, 0.1), cant=np.full(5, 0.01), mounts=np.full((5, 6), 1e-3),
            slopes=rays.SlopeMap(grid, grid, slope, np.zeros(5, np.int64), False),
        )  # fmt: skip
    given: dict[str, Any] = {
        "weights": np.linspace(0.5, 1.5, 8).reshape(2, 4), "group": np.arange(4) % 2, "groups": 2, "cells": (3, 4),
        "share": np.linspace(1.0, 2.0, 5), "rays": 128 if case == "cylinder" else 16,
        "stride": 3 if case == "strides" else 1,
    }  # fmt: skip
    wanted, found = (rays.trace(made, _suns(), cuda=cuda, **given) for cuda in (False, True))
    assert wanted.sums[..., rays.UNBLOCKED].min() < wanted.sums[..., rays.UNBLOCKED].max()
    assert found.sums == pytest.approx(wanted.sums, rel=TOLERANCE)
    assert found.flux == pytest.approx(wanted.flux, rel=TOLERANCE)
