"""The chain from mirrors to receiver beside SolarPILOT: `python -m tests.bench chain`.

Field of 317, cylinder, errors and air the same. SolarPILOT tells one efficiency: its factors are quotients of runs that
differ in one thing, with mirrors too small to shade and a receiver too high to miss. Its optical error is a slope error
and its sun is darkened at the limb. Differences are SolarPILOT's less ours, of the means over its positions of the sun
above 10 deg (and the least and the largest), by the slope error in mrad; ours are quotients of the same means. Its
intercept is a truncated series, above 1 where nothing misses. Then the command of a whole year: 2,650 heliostats by
both methods on the hours of a TMY3 file.
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
from tests.bench import bench_study, solarpilot
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
YEAR = """\
family: field_efficiency
site: {file: "pvlib:data/723170TYA.CSV"}
tracking: [spinning_elevation, azimuth_elevation]
time: {clock: weather}
layout: {radial_stagger: {clearance: 16, inner_radius: 61.3, heliostats: 2650}}
heliostat: {width: 11, height: 11, pivot_height: 7, focus: slant}
receiver: {kind: cylinder, height: 275, radius: 7, height_extent: 16}
optics:
  sun_shape: {kind: limb_darkened}
  slope_error: 1.5
  tracking_error: 0.6
  reflectivity: 0.94
  attenuation: delsol_clear
weather: {file: "pvlib:data/723170TYA.CSV"}
"""
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
    """The whole chain over a year, and its differences."""
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


def command() -> Iterator[Line]:
    """A year from the command to its files, after a run that compiles what is not compiled."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "year.yaml"
        file.write_text(YEAR)
        bench_study.run(file, Path(folder) / "first", "--set", "time.months=[6]")
        seconds, memory, _ = bench_study.run(file, Path(folder) / "year")
        yield Line("chain, 2,650, command", f"{seconds:.1f} s, {memory:.0f} MB")


def lines() -> Iterator[Line]:
    """Compare the chain with SolarPILOT, then run a whole year."""
    yield from chain()
    yield from command()
