"""SAM's default molten-salt tower with its own field and with ours: `python -m tests.bench electricity`.

The 9,339 heliostats, receiver, errors and air are those of PySAM's `MSPTSingleOwner`, with the weather of Greensboro.
SAM's own field comes from SolarPILOT. Our field is traced, aims at levels of the receiver, and is passed to
`tower_electricity`. Factors are means over sun positions above 10 deg. SAM's factors are quotients of SolarPILOT runs
with one aim that differ in one input (see `bench_chain`). Receiver losses are means over the hours in which SAM's
receiver operates without start-up or defocusing.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heliosweep import build, efficiency_table, flux_maps, study, tower_electricity
from heliosweep.files import named_in
from tests.bench import solarpilot
from tests.bench.bench_chain import CLEAR, FACTORS, HIGH, LOWEST, SMALL
from tests.bench.table import Line

WEATHER = named_in(Path(), "pvlib:data/723170TYA.CSV")
#: Side of the default mirrors, and the part of it that reflects. [m, 1]
SIDE, DENSITY = 12.2, 0.97
#: Slope error with which no light misses the wide receiver. [rad]
NARROW = 0.5e-3


def own() -> tuple[Any, Any]:
    """SAM's default plant, and its year. ImportError without PySAM."""
    from PySAM import TcsmoltenSalt

    model = TcsmoltenSalt.default("MSPTSingleOwner")
    model.SolarResource.solar_resource_file = str(WEATHER)
    model.execute(0)
    return model, model.Outputs


def field(model: Any, positions: NDArray, **more: Any) -> Any:
    """Return our study of the same field with directions of the sun or other blocks."""
    tower, half = model.TowerAndReceiver, np.sqrt(DENSITY)
    layout = {"table": {"x": positions[:, 0].tolist(), "y": positions[:, 1].tolist()}}
    return study(
        "field_efficiency",
        tracking="azimuth_elevation",
        layout=layout,
        heliostat={"width": SIDE * half, "height": SIDE * half, "pivot_height": 0, "focus": "slant"},
        receiver={
            "kind": "cylinder", "height": tower.h_tower, "radius": tower.D_rec / 2, "height_extent": tower.rec_height,
        },
        optics={
            "sun_shape": {"kind": "limb_darkened"}, "slope_error": model.HeliostatField.helio_optical_error_mrad,
            "reflectivity": model.HeliostatField.helio_reflectance, "attenuation": "delsol_clear", "rays": 32,
        },
        **more,
    )  # fmt: skip


def theirs(model: Any, positions: NDArray) -> tuple[NDArray, NDArray]:
    """Positions of the sun, azimuth from south and zenith [deg], and SolarPILOT's factors at each."""
    tower, error = model.TowerAndReceiver, 1e-3 * model.HeliostatField.helio_optical_error_mrad

    def run(side: float = SIDE, is_wide: bool = False, **air: Any) -> tuple[NDArray, NDArray]:
        height, width = (HIGH, 2 * tower.D_rec) if is_wide else (tower.rec_height, tower.D_rec)
        optics = {"helio_optical_error": NARROW if is_wide else error, "cant_type": 1, "n_flux_x": 12, "n_flux_y": 10,
                  "dens_mirror": DENSITY, "n_flux_days": 4, "delta_flux_hrs": 2}  # fmt: skip
        receiver, (x, y) = {"rec_height": height, "rec_aspect": height / width}, positions.T
        _, table, _ = solarpilot.measure(x, y, side, tower.h_tower, **optics, **receiver, **air)
        return table[:, :2], table[:, 2]

    (sun, whole), (_, bare) = run(SIDE, False, **CLEAR), run()
    (_, high), (_, cosine) = run(is_wide=True), run(SMALL, True)
    return sun, np.array([cosine, high / cosine, whole / bare, bare / high, whole])


def ours(model: Any, positions: NDArray, sun: NDArray) -> NDArray:
    """Our factors at positions of the sun, with one aim."""
    angles = {"azimuth": (sun[:, 0] + 180.0).tolist(), "elevation": (90.0 - sun[:, 1]).tolist()}
    tied = {"time": {"clock": "sun", **angles}, "zip": [["time.azimuth", "time.elevation"]]}
    found = build(field(model, positions, **tied)).compute()
    names = ("cosine", "optical", "intercept", "attenuation")
    cosine, optical, intercept, air = (found[f"{name}_efficiency"].to_numpy() for name in names)
    means = [np.mean(each, axis=-1) for each in (cosine, optical, optical * intercept, optical * intercept * air)]
    return np.array([means[0], means[1] / means[0], means[3] / means[2], means[2] / means[1], means[3]])


def lines() -> Iterator[Line]:
    """Compare factors, energies and losses of the receiver; nothing without PySAM."""
    try:
        model, sam = own()
    except ImportError:
        return
    positions = np.array(sam.helio_positions_calc)
    yield from losses(model, sam)
    clock = {"clock": "sun", "azimuth": {"start": 0, "stop": 360, "step": 30},
             "elevation": {"start": 5, "stop": 85, "step": 10}}  # fmt: skip
    area = SIDE**2 * DENSITY * len(positions)
    for levels in (1, 3):
        aim = {"aim": {"strategy": "spread", "levels": levels}} if levels > 1 else {}
        made = field(model, positions, time=clock, output={"flux_map": {"columns": 20, "rows": 1}}, **aim)
        tables = efficiency_table(made, factor=model.TowerAndReceiver.rec_absorptance), flux_maps(made)
        year = tower_electricity(*tables, WEATHER, positions, area)
        light, heat = float(year.absorbed_power.sum()), float(year.receiver_heat.sum())
        yield Line(
            f"ours over SAM, {levels} aims",
            f"absorbed {light / sam.annual_q_rec_inc:.4f}, heat {heat / np.sum(sam.Q_thermal):.4f}, "
            f"electricity {float(year.electricity) * 1e3 / sam.annual_energy:.4f}",
        )
    sun, factors = theirs(model, positions)
    apart = (factors - ours(model, positions, sun))[:, 90.0 - sun[:, 1] > LOWEST]
    for name, each in zip(FACTORS, apart, strict=True):
        yield Line(f"SAM less ours, {name}", f"{each.mean():+.4f} ({each.min():+.4f}, {each.max():+.4f})")


def losses(model: Any, sam: Any) -> Iterator[Line]:
    """Losses of SAM's receiver against constant losses per area; its power is absorbed light."""
    power, lost, heat = (np.array(getattr(sam, name)) for name in ("q_dot_rec_inc", "q_thermal_loss", "Q_thermal"))
    works = (np.array(sam.q_startup) == 0) & (heat > 0) & (np.array(sam.defocus) == 1)
    for low, high in ((0.0, 0.4), (0.4, 0.7), (0.7, 1.0), (1.0, 2.0)):
        part = works & (power / sam.q_dot_rec_des >= low) & (power / sam.q_dot_rec_des < high)
        each = 1e3 * lost[part] / sam.A_rec
        yield Line(f"losses, {low:g} to {high:g} of design", f"{np.count_nonzero(part)} h, {each.mean():.1f} kW/m2")
    found = power - 1e-3 * model.TowerAndReceiver.rec_hl_perm2 * sam.A_rec
    yield Line("heat, ours over SAM", f"{found[works].sum() / heat[works].sum():.4f}")
