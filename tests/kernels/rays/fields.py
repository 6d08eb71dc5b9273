"""Fields traced with 5e9 to 7e10 rays on a GPU, and this tracer beside them: ``python -m tests.kernels.rays.fields``.

`tests/data/field_rays.npz` has, at four suns and over a typical year of 2,440 hours (pvlib's copy of Greensboro, DNI of
at least 200 W/m2, sun 5 degrees up, wind up to 15 m/s), the cosine, unshaded, unblocked, both (of a year optical =
cosine x both), intercept and light of each heliostat, and the power [m2] or energy [MWh] on 20 x 36 cells. Mirrors
shade and block as planes; intercept, light and map are of curved mirrors. Totals are exact to 1e-6, single heliostats
to 1e-5 at an instant and 1e-6 over a year.
"""

import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from heliosweep.kernels import rays, sunshapes
from heliosweep.kernels.field.packets import AZIMUTH_ELEVATION, SPINNING_ELEVATION
from tests.kernels.rays.scenes import scene

REFERENCE = np.load(Path(__file__).parents[2] / "data" / "field_rays.npz")
INSTANTS = ("canted_focused", "flat_polar", "focused_spinning", "focused_stagger")
YEARS = ("canted_focused", "flat_polar", "surround_azimuth", "surround_spinning")
CELLS = (20, 36)
_ANGLES = np.radians([[180.0, 55.0], [120.0, 22.0], [265.0, 12.0], [5.0, 75.0]]).T
SUNS = np.stack(
    (np.cos(_ANGLES[1]) * np.sin(_ANGLES[0]), np.cos(_ANGLES[1]) * np.cos(_ANGLES[0]), np.sin(_ANGLES[1])), axis=1
)


def field(name: str) -> tuple[rays.Scene, np.ndarray]:
    """Scene of a field, and the factor of each heliostat in the map of a year."""
    azimuth = {"focused_spinning": "focused_stagger", "surround_spinning": "surround_azimuth"}.get(name, name)
    place = REFERENCE[f"{azimuth}_place"]
    tracking = SPINNING_ELEVATION if name.endswith("spinning") else AZIMUTH_ELEVATION
    given: dict[str, Any] = {"place": place, "sun": sunshapes.limb_darkened(), "tracking": tracking}
    outward = place[:, :2] / np.hypot(*place[:, :2].T)[:, np.newaxis]
    if name == "flat_polar":
        receiver = rays.rectangle((0.0, 0.0, 45.0), 0.0, math.radians(-10.0), 9.0, 9.0)
        given |= {"sides": (7.0, 7.0), "errors": (0.8e-3, 0.8e-3, 0.0), "sun": sunshapes.pillbox()}
        return scene(receiver, **given), np.full(len(place), 49.0)
    if name == "canted_focused":
        receiver = rays.rectangle((0.0, 0.0, 60.0), 0.0, math.radians(-20.0), 7.0, 7.0)
        curve = 0.5 / np.linalg.norm(place - receiver.centre, axis=1)
        given |= {"sides": (9.0, 7.0), "errors": (1.2e-3, 1.2e-3, 0.3e-3), "curve": curve, "cant": curve}
        return scene(receiver, facets=(3, 2, 0.0), **given), np.full(len(place), 63.0)
    surround = name.startswith("surround")
    radius, height, side = (3.5, 95.0, 11.0) if surround else (3.0, 38.0, 6.0)
    aim = np.column_stack((radius * outward, np.full(len(place), height)))
    far = np.linalg.norm(place - aim, axis=1)
    slope = 1e-3 * math.hypot(1.5, 0.6 if surround else 0.0)
    receiver = rays.cylinder((0.0, 0.0, height), radius, 8.0 if surround else 6.0)
    errors = (slope, slope, 0.2e-3 if surround else 0.0)
    given |= {"aim": aim, "sides": (side, side), "errors": errors, "curve": 0.5 / far}
    km = far / 1000.0
    air = 1.0 - (0.006789 + 0.1046 * km - 0.017 * km**2 + 0.002845 * km**3) if surround else np.ones(len(place))
    return scene(receiver, **given), side**2 * air * (0.94 * 0.95 if surround else 1.0)


def compare(name: str, rays_each: int, instant: int | None = None, seed: int = 0, threads: int = 2) -> dict[str, float]:
    """Differences from the reference at one of the four suns, or over the year: field, heliostats, cells, peak."""
    made, share = field(name)
    if instant is None:
        sun, weight, kind, at = REFERENCE["year_sun"], REFERENCE["year_weight"], "_year", 0
    else:
        sun, weight, kind, at = SUNS, np.eye(4)[instant], "", instant
        share = made.sides.prod(axis=1) * rays_area(made)
    wanted, cells = REFERENCE[f"{name}{kind}_heliostats"][at], REFERENCE[f"{name}{kind}_map"][at]
    first, last = (0, len(sun)) if instant is None else (at, at + 1)
    used, clock = time.process_time(), time.perf_counter()
    found = rays.trace(
        made, sun, weights=np.stack((weight, weight)), first=first, last=last, rays=rays_each, seed=seed, cells=CELLS,
        share=share, threads=threads,
    )  # fmt: skip
    used, clock = time.process_time() - used, time.perf_counter() - clock
    mean, error = rays.mean_error(found.sums[:, :, 0] / weight.sum())
    cosine, area = mean[:, rays.COSINE], made.sides.prod(axis=1)
    parts = (
        mean[:, rays.COSINE_UNSHADED] / cosine, mean[:, rays.COSINE_UNBLOCKED] / cosine,
        mean[:, rays.OPTICAL] / (cosine if instant is not None else 1.0), mean[:, rays.HIT] / cosine,
    )  # fmt: skip
    light, peak = mean[:, rays.LIGHT], rays.peak(found.flux)[0] * found.unit
    flux = found.flux.mean(axis=0) * found.unit
    totals = (found.sums[:, :, 0, rays.LIGHT] * area).sum(axis=1) / (wanted[:, 5] @ area) / weight.sum()
    return {
        "cosine": float(np.abs(cosine - wanted[:, 0]).max()),
        **{key: float(np.abs(part - wanted[:, k + 1]).max())
           for k, (key, part) in enumerate(zip(("unshaded", "unblocked", "both", "intercept"), parts, strict=True))},
        "field": float(totals.mean()) - 1.0,
        "field_error": float(rays.mean_error(totals)[1]),
        "heliostat": float(np.abs(light - wanted[:, 5]).max()),
        "heliostat_rms": float(np.sqrt(np.mean((light - wanted[:, 5]) ** 2))),
        "covered": float(np.mean(np.abs(light - wanted[:, 5]) <= 2.0 * error[:, rays.LIGHT] + 2e-5)),
        "cell": float(np.abs(flux - cells).max() / cells.max()),
        "cell_rms": float(np.sqrt(np.mean((flux - cells) ** 2)) / cells.max()),
        "peak": peak / float(cells.max()) - 1.0,
        "rays": float(len(made.centre) * (last - first) * rays_each),
        "seconds": used,
        "clock": clock,
    }  # fmt: skip


def rays_area(made: rays.Scene) -> float:
    """Part of the mirror within facets."""
    facets = made.facets
    width, height = made.sides[0]
    return float((1 - (facets.columns - 1) * facets.gap / width) * (1 - (facets.rows - 1) * facets.gap / height))


def main(rays_of_years: int = 64, rays_of_instants: int = 65_536) -> None:
    """Print the comparison as a table."""
    print("| field | rays | field | std. error | heliostat, worst (rms) | cell, worst (rms) | peak | M rays/s a core |")
    print("|---|---|---|---|---|---|---|---|")
    cases: list[tuple[str, int, int | None]] = [(name, rays_of_years, None) for name in YEARS]
    cases += [(name, rays_of_instants, sun) for name in INSTANTS for sun in range(4)]
    compare("flat_polar", 16)  # compiles
    for name, each, sun in cases:
        row = compare(name, each, sun)
        label = f"{name}, {'year' if sun is None else f'sun {sun + 1}'}"
        print(f"| {label} | {row['rays'] / 1e6:.0f} M | {row['field']:+.1e} | {row['field_error']:.1e} | "
              f"{row['heliostat']:.1e} ({row['heliostat_rms']:.1e}) | {100 * row['cell']:.2f} % "
              f"({100 * row['cell_rms']:.2f} %) | {100 * row['peak']:+.2f} % | "
              f"{row['rays'] / row['seconds'] / 1e6:.0f} |")  # fmt: skip


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
