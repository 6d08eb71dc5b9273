"""Power of strategies of aim points at equal peak flux, a table of the documentation: `python -m tests.bench.aims`.

`spread` has 3 and 5 levels. Image-size priority is the rule of SolarPILOT (Wagner and Wendelin, Solar Energy 171 (2018)
185-196): the heliostats with the largest images first, each at the aim point with the lowest flux among the points
that lose little light. The strategy `flux_limit` then has the peak flux of each of them as its limit.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import heliosweep
from heliosweep import aiming, light
from heliosweep.layouts.patterns import radial_stagger

#: Rows and columns of cells and of aim points.
CELLS, GRID = (20, 36), (7, 3)
OPTICS = {"sun_shape": {"kind": "pillbox"}, "slope_error": 1.5, "tracking_error": 0.6, "rays": 16384}
#: Parts of the best power that an image keeps at an aim point of image-size priority.
INSIDE = 0.99, 0.9


def fields() -> dict[str, tuple[np.ndarray, dict[str, Any]]]:
    """Return centres of mirrors of 11 x 11 m and receivers of three fields: small, polar and large."""

    def ring(count: int, clearance: float, inner: float) -> np.ndarray:
        made = radial_stagger(clearance=clearance, inner_radius=inner, heliostats=count)
        return np.column_stack((made.x, made.y, np.full(count, 6.0)))

    polar = ring(1600, 18.0, 90.0)
    polar = polar[np.abs(np.arctan2(polar[:, 0], polar[:, 1])) < np.radians(55.0)]
    return {
        "180, cylinder": (ring(180, 16.0, 75.0),
                          {"kind": "cylinder", "height": 100, "radius": 4.5, "height_extent": 12}),
        f"{len(polar)}, rectangle": (polar, {"kind": "rectangle", "height": 120, "azimuth": 0, "tilt": -20, "width": 13,
                                             "height_extent": 13}),
        "2,650, cylinder": (ring(2650, 18.0, 100.0),
                            {"kind": "cylinder", "height": 150, "radius": 6.5, "height_extent": 16}),
    }  # fmt: skip


def image_size_priority(centre: np.ndarray, receiver: dict[str, Any], part: float) -> np.ndarray:
    """Return the aim point of each heliostat by image-size priority, shape (N, 3). [m]"""
    made = {key: value for key, value in receiver.items() if key != "kind"}
    kind = heliosweep.Cylinder if receiver["kind"] == "cylinder" else heliosweep.Rectangle
    given: dict[str, Any] = {"width": 11, "height": 11, "slope_error": 1.5, "tracking_error": 0.6}
    scene = light.field_scene(centre, kind(**made), **given)
    points = aiming.aim_grid(scene.receiver, centre, *GRID, np.radians(40.0))
    sun, share = (
        light.sun_directions(180.0, 55.0)[0],
        light.mirror_area(scene.sides[:, 0], scene.sides[:, 1], scene.facets),
    )
    flux = aiming.aim_images(scene, sun, points, cells=CELLS, share=share, threads=2)
    power = aiming.image_powers(flux, scene.receiver, CELLS, len(points))
    size = np.linalg.norm(scene.target - centre, axis=1)  # images grow with the distance
    load, choice = np.zeros(flux.shape[1]), np.zeros(len(centre), int)
    for i in np.argsort(-size):
        inside = np.flatnonzero(power[:, i] >= part * power[:, i].max())
        images = flux[inside * len(centre) + i].toarray()
        peaks = [(load + image)[image > 0.1 * image.max()].max(initial=0.0) for image in images]
        best = int(np.argmin(peaks))
        choice[i], load = inside[best], load + images[best]
    return points[choice, np.arange(len(centre))]


def traced(layout: Path, receiver: dict[str, Any], aim: dict[str, Any]) -> xr.Dataset:
    """Return the result of a study of a field at one instant."""
    flux = {"rows": CELLS[0], "columns": CELLS[1]}
    content = {
        "family": "field_efficiency", "tracking": "azimuth_elevation", "optics": OPTICS, "aim": aim,
        "time": {"clock": "sun", "azimuth": 180, "elevation": 55}, "layout": {"file": str(layout)},
        "heliostat": {"width": 11, "height": 11, "pivot_height": 0, "focus": "slant"},
        "receiver": receiver, "output": {"flux_map": flux},
    }  # fmt: skip
    return heliosweep.build(content).compute()


def main() -> None:
    """Print the table."""
    print("| field | other strategy | its peak flux (kW/m²) | its power (MW) | power (MW) | peak flux | gain | gap |")
    print("|---|---|---|---|---|---|---|---|")
    for name, (centre, receiver) in fields().items():
        with tempfile.TemporaryDirectory() as folder:
            cases: list[tuple[str, dict[str, Any], float]] = [
                *((f"`spread`, {levels} levels", {"strategy": "spread", "levels": levels}, 1.0) for levels in (3, 5)),
                *((f"image-size priority, {100 * part:.0f} %", {"strategy": "layout"}, part) for part in INSIDE),
            ]
            for k, (label, aim, part) in enumerate(cases):
                layout = Path(folder) / f"{k}.csv"
                table = np.column_stack((centre, image_size_priority(centre, receiver, part) if part < 1.0 else centre))
                np.savetxt(layout, table, "%.9g", ",", header="x,y,z,aim_x,aim_y,aim_z", comments="")
                other, scale = traced(layout, receiver, aim), len(centre) * 121e-3
                limit = {"strategy": "flux_limit", "limit": float(other["peak_flux"]), "rows": GRID[0]}
                ours = traced(layout, receiver, limit)
                power = [scale * float(result["field_total_efficiency"]) for result in (other, ours)]
                values = f"{limit['limit']:.0f} | {power[0]:.2f} | {power[1]:.2f} | {float(ours['peak_flux']):.0f}"
                gain, gap = 100 * (power[1] / power[0] - 1), 100 * float(ours["aim_gap"])
                print(f"| {name} | {label} | {values} | {gain:+.1f} % | {gap:.2f} % |", flush=True)


if __name__ == "__main__":
    main()
