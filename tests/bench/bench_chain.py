"""Efficiencies of a field from mirrors to receiver, compared with SolarPILOT: `python -m tests.bench chain`.

Both programs compute the same field of 317 heliostats, cylinder, errors and air. SolarPILOT returns one efficiency, so
its factors are quotients of runs that differ in one input, with mirrors too small to shade and a receiver too high to
miss. Its optical error is a slope error, and its sun is limb-darkened. Differences are SolarPILOT minus heliosweep, of
the means over the sun positions above 10 deg (with minimum and maximum), for each slope error. SolarPILOT's intercept
is a truncated series and exceeds 1 if all light hits.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep import build, study, write_layout
from heliosweep.layouts import Layout
from tests.bench import solarpilot
from tests.bench.table import Line, rate
from tests.kernels.field.fields import chong2012

SIDE, HEIGHT, RADIUS, TARGET = 11.0, 12.0, 5.0, 88.0
#: Slope errors that are compared. [mrad]
SLOPES = (1.0, 1.5, 3.0)
#: Receivers so high that nothing misses them, and mirrors that do not shade. [m]
HIGH, SMALL = 40.0, 0.5
#: Lowest sun of the comparison. [deg]
LOWEST = 10.0
CLEAR = {"c_atm_0": 0.006789, "c_atm_1": 0.1046, "c_atm_2": -0.017, "c_atm_3": 0.002845}
FACTORS = ("cosine", "shading, blocking", "attenuation", "intercept", "all")


def theirs(x: NDArray, y: NDArray, slope: float) -> tuple[float, NDArray, NDArray]:
    """Seconds of the whole chain, positions of the sun as `solarpilot.measure`, and the factors at each."""

    def run(side: float = SIDE, height: float = HEIGHT, **air: float) -> tuple[float, NDArray, NDArray]:
        receiver = {"rec_height": height, "rec_aspect": height / (2.0 * RADIUS)}
        optics = {"helio_optical_error": 1e-3 * slope, "cant_type": 1, "n_flux_x": 12, "n_flux_y": 10}
        return solarpilot.measure(x, y, side, TARGET, **receiver, **optics, **air)

    seconds, whole, _ = run(**CLEAR)
    bare, high, cosine = (run(**given)[1][:, 2] for given in ({}, {"height": HIGH}, {"height": HIGH, "side": SMALL}))
    return seconds, whole[:, :2], np.array([cosine, high / cosine, whole[:, 2] / bare, bare / high, whole[:, 2]])


def field(file: Path, slope: float, sun: dict[str, Any]) -> Any:
    """The same field, computed."""
    return build(
        study(
            "field_efficiency",
            tracking="azimuth_elevation",
            layout={"file": str(file)},
            heliostat={"width": SIDE, "height": SIDE, "pivot_height": 0, "focus": "slant"},
            receiver={"kind": "cylinder", "height": TARGET, "radius": RADIUS, "height_extent": HEIGHT},
            optics={"sun_shape": {"kind": "limb_darkened"}, "slope_error": slope, "attenuation": "delsol_clear"},
            **sun,
        )
    ).compute()


def ours(file: Path, slope: float, positions: NDArray) -> NDArray:
    """Factors at positions of the sun."""
    angles = {"azimuth": (positions[:, 0] + 180.0).tolist(), "elevation": (90.0 - positions[:, 1]).tolist()}
    tied = {"time": {"clock": "sun", **angles}, "zip": [["time.azimuth", "time.elevation"]]}
    found = field(file, slope, tied)
    names = ("cosine", "optical", "intercept", "attenuation")
    cosine, optical, intercept, air = (found[f"{name}_efficiency"].to_numpy() for name in names)
    means = [np.mean(values, axis=-1) for values in (cosine, optical, optical * intercept, optical * intercept * air)]
    return np.array([means[0], means[1] / means[0], means[3] / means[2], means[2] / means[1], means[3]])


def year(file: Path, step: int = 1) -> float:
    """Seconds of the processor for each heliostat-instant of the chain, over a year or every few days of it."""
    days, hours = {"start": 1, "stop": 365, "step": step}, {"start": 8, "stop": 16, "step": 1}
    clock = {"clock": "solar", "days": days, "hours": hours, "sampling": "inclusive"}
    began = time.process_time()
    found = field(file, SLOPES[1], {"site": {"latitude": 30}, "time": clock})
    return (time.process_time() - began) / (found.sizes["heliostat"] * len(range(1, 366, step)) * 9)


def chain() -> Iterator[Line]:
    """Compute the efficiencies over a year and their differences from SolarPILOT."""
    x, y = chong2012()[:2]
    with TemporaryDirectory() as folder:
        file = write_layout(Layout(x, y, np.zeros(len(x))), Path(folder) / "field.csv")
        year(file, 7)  # loads the kernels, with those that interpolate
        seconds, beside, rows = year(file), {}, []
        for slope in SLOPES:
            try:
                spent, positions, factors = theirs(x, y, slope)
            except ImportError:
                break
            beside = {"PySAM (SolarPILOT)": spent / (len(x) * len(positions))}
            high = 90.0 - positions[:, 1] > LOWEST
            apart = (factors - ours(file, slope, positions))[:, high]
            for name, each in zip(FACTORS, apart, strict=True):
                told = f"{name} {each.mean():+.4f} ({each.min():+.4f}, {each.max():+.4f})"
                rows.append(Line(f"PySAM less ours, {slope:g}", told))
        yield rate("chain, 317, azimuth", "heliostat-instant", seconds, beside)
        yield from rows


def lines() -> Iterator[Line]:
    """Compare the field with SolarPILOT's."""
    yield from chain()
