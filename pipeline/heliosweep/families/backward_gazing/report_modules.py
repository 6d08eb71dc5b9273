"""What a plant wants to know: canting of each module, pointing and focal length, with how well each is known."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr
from scipy.special import ndtri

from heliosweep.families.backward_gazing import report_views as views
from heliosweep.families.backward_gazing import report_words as wording
from heliosweep.families.backward_gazing.report_views import DIRECTIONS, METHOD, MODULE, REFERENTIAL, at, needs
from heliosweep.families.registry import NamedFigure
from heliosweep.report.intervals import Around, Beside, Interval, Strip, interval_figure
from heliosweep.report.labels import number_text

#: Half-width of a 95 % interval over the standard error.
WIDE = float(ndtri(0.975))

#: Least height of the axis. [mrad]
LEAST = 0.02

#: Modules of one figure.
MOST = 16


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Canting of the modules.

    Parameters
    ----------
    result : xarray.Dataset
        The result.

    Yields
    ------
    NamedFigure
    """
    yield from _canting(result)


@needs("canting_x", "canting_y")
def _canting(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Canting of each module by each method, with 95 % intervals; its error where the true one is known."""
    array = result["canting_x"]
    if MODULE not in array.dims:
        return
    stands = views.fixed(result, "canting_x", METHOD, REFERENTIAL, views.sort_of(result, "canting_x"), MODULE)
    profiles = views.sorts(result, "canting_x")
    places = np.unique(np.linspace(0, result.sizes[MODULE] - 1, min(result.sizes[MODULE], MOST)).round().astype(int))
    names = [text.removeprefix("module ") for text, _ in views.all_modules(result)]
    ways = views.best_ways(result, "canting_x")
    true = {end: _entered(result, end, stands) for end in DIRECTIONS}
    known = all(values is not None for values in true.values())
    entered = {end: np.zeros(result.sizes[MODULE]) if values is None else values for end, values in true.items()}
    strips = []
    for end, direction in DIRECTIONS.items():
        panels = []
        for profile, where in profiles:
            series = {
                way.name: Interval(*_interval(result, f"canting_{end}", places, entered[end], stands, where, way.point))
                for way in ways
            }
            panels.append(Beside([names[i] for i in places], series, profile if end == "x" else ""))
        label = f"error of {direction}\ncanting (mrad)" if known else f"{direction} canting\n(mrad)"
        strips.append(Strip(label, panels))
    parts = [one.value for strip in strips for panel in strip.panels for one in panel.series.values()]
    if not np.isfinite(np.concatenate(parts)).any():
        return
    less = ", less the one that was entered" if known else ""
    single = f" Method {ways[0].name}." if len(ways) == 1 and ways[0].name else ""
    caption = (
        "Canting: slope at the centre of each module less the pointing of the heliostat, which is the median over the "
        f"modules{less}; bars: 95 % intervals from the scatter of the pixels alone.{single}"
        f"{_whole(result, {**stands, **profiles[0][1], **ways[-1].point}, ways[-1].name)}"
        f"{wording.note(result, stands, (views.sort_of(result, 'canting_x'), profiles), (MODULE, list(places)))}"
    )
    colours = {way.name: str(way.look["color"]) for way in ways}
    if len(ways) == 1:
        strips = [
            Strip(s.label, [Beside(p.words, {"": one}, p.title) for p in s.panels for one in p.series.values()])
            for s in strips
        ]
        colours = {"": colours[ways[0].name]}
    figure = interval_figure(strips, Around("module", colours=colours), least_span=LEAST)
    yield NamedFigure("canting", caption, figure)


def _interval(
    result: xr.Dataset, name: str, places: np.ndarray, entered: np.ndarray, *points: views.Point
) -> list[np.ndarray]:
    """Estimate less what was entered, and both ends of its interval, at some modules. [mrad]"""
    value = (at(result[name], *points).to_numpy().astype(float) - entered)[places]
    error = f"{name}_standard_error"
    if error not in result:
        return [value]
    half = WIDE * at(result[error], *points).to_numpy().astype(float)[places]
    return [value, value - half, value + half]


def _entered(result: xr.Dataset, end: str, stands: views.Point) -> np.ndarray | None:
    """Canting that was entered less its median over the modules; none where the result does not tell. [mrad]"""
    given = views.canting(result)
    scale: object = views.study(result).get("defects", {}).get("canting_scale", 1.0)
    if "canting_scale" in result.coords:
        found = at(result["canting_scale"], stands)
        scale = None if found.ndim else float(found)
    true_focal = {"true_focal_length"} & set(result.coords)
    if not given or not isinstance(scale, int | float) or true_focal:
        return None
    numbers = [int(text.removeprefix("module ")) for text, _ in views.all_modules(result)]
    side = list(DIRECTIONS).index(end)
    values = float(scale) * np.array([given.get(number, (0.0, 0.0))[side] for number in numbers])
    return np.asarray(values - np.median(values))


def _whole(result: xr.Dataset, point: views.Point, method: str) -> str:
    """Pointing and focal length of the heliostat, as a sentence."""
    said = []
    for name, words, unit, decimals in (
        ("pointing_x", "horizontal pointing", "mrad", 3),
        ("pointing_y", "vertical pointing", "mrad", 3),
        ("focal_length_estimate", "focal length", "m", 2),
    ):
        error = f"{name.removesuffix('_estimate')}_standard_error"
        if name in result and error in result:
            value, half = (float(at(result[one], point)) for one in (name, error))
            if np.isfinite(value) and np.isfinite(half):
                said.append(f"{words} {number_text(value, decimals)} ± {number_text(WIDE * half, decimals)} {unit}")
    of = f" by {method}" if method else ""
    return f" Of the whole heliostat{of}: {', '.join(said)}." if said else ""
