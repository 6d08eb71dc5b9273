"""Figures of a finished result, after Figures 2 and 5 to 8 and Table 1 of Defieux et al. (2020), by what it holds.

Each figure takes from the sweep what it can show, and its caption says at which values the rest stands; one that needs
what the result does not have is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr

from heliosweep.families.backward_gazing import figures_errors, figures_images
from heliosweep.families.backward_gazing.shown import (
    DIRECT,
    DIRECTIONS,
    HELIOSTAT,
    HOUR,
    METHOD,
    METHOD_COLOURS,
    MODULE,
    REFERENTIAL,
    SEEDS,
    Gazing,
)
from heliosweep.families.backward_gazing.variables import PLANE
from heliosweep.report.contents import NamedFigure, one_by_one
from heliosweep.report.labels import number_text
from heliosweep.report.panels import Panel, curve_figure
from heliosweep.report.pictures import (
    FieldMap,
    Raster,
    Shades,
    about_zero,
    field_map,
    from_zero,
    picture_figure,
    symbols,
)
from heliosweep.report.selection import Point, at
from heliosweep.report.tracks import Plane, Track, plane_figure

#: Figures of one result.
MOST_FIGURES = 12
#: Hours of one figure.
MOST_HOURS = 6
#: Least end of a scale of errors. [mrad]
LEAST = 1e-4

DISC = "disc_fraction"
#: Pixels along the side of a drawn disc.
SIDE = 201

_ERRORS = ("slope_rms_x", "slope_rms_y")


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Figures of a result, each drawn when it is asked for; values are read as they are needed."""
    shown = Gazing(result)
    others = (sun, raw_slopes, effort, accuracy_map, usable_map, over_distance)
    return one_by_one((*figures_images.FIGURES, *figures_errors.FIGURES, *others), shown, MOST_FIGURES)


class _Disc(Raster):
    """A disc whose coordinates are angles."""

    sides = ("angle (mrad)", "angle (mrad)")


def sun(shown: Gazing) -> Iterator[NamedFigure]:
    """Brightness from the centre of the disc to its edge, and the disc itself."""
    names = ("sun_brightness", "sun_formula", "sun_radius_fit", "sun_limb_fit", "sun_exponent_fit", "sun_fit_rms")
    result = shown.result
    if not shown.has(*names) or DISC not in result.coords:
        return
    stands = shown.fixed("sun_brightness", shown.sort_dim("sun_brightness"), DISC)
    panels, discs, said = [], [], []
    for where in shown.sorts("sun_brightness"):
        profile, formula = (at(result[name], stands, where).astype(float) for name in names[:2])
        radius, limb, exponent, rms = (float(at(result[name], stands, where)) for name in names[2:])
        if not np.isfinite(radius):
            continue
        angle = xr.DataArray(radius * result[DISC].to_numpy(), dims=DISC)
        lines = {word: one.assign_coords(angle=angle).swap_dims({DISC: "angle"}) for word, one in
                 (("profile of the sun", profile), ("formula of Jose nearest to it", formula))}  # fmt: skip
        panels.append(Panel("brightness over the centre's (1)", lines, shown.values(where)))
        side = np.linspace(-1.02, 1.02, SIDE)
        far = np.hypot(side, side[:, np.newaxis])
        for word, one in zip(("profile", "formula"), (profile, formula), strict=True):
            values = np.where(far <= 1.0, np.interp(far, result[DISC], one), 0.0)
            place = {"z": radius * side, "y": radius * side}
            title = ", ".join(filter(None, [shown.values(where), word]))
            discs.append(_Disc(xr.DataArray(values, place, ("z", "y")), title))
        said.append(
            f"A = {number_text(limb, 3)}, xi = {number_text(exponent, 3)}, eps_max = {number_text(radius, 3)} mrad, "
            f"root mean square of the rest {number_text(100 * rms, 2)} %"
        )
    if panels:
        caption = (
            "Brightness of the sun's profile and by the formula of Jose nearest to it, A + (1 - A) sqrt(1 - "
            f"(eps/eps_max)^xi): {'; '.join(said)}.{shown.note(stands)}"
        )
        looks = {"profile of the sun": {"marker": ""}, "formula of Jose nearest to it": {"marker": ""}}
        label = "angle from the centre of the disc (mrad)"
        yield NamedFigure("sun_profile", caption, curve_figure(panels, label, same_scale=True, looks=looks))
        shades = Shades("brightness relative to the centre of the sun (1)", 0.0, 1.0, "inferno")
        caption = f"The disc of the sun, drawn from its profile and from the nearest formula.{shown.note(stands)}"
        yield NamedFigure("sun_disc", caption, picture_figure(discs, shades, 2))


def raw_slopes(shown: Gazing) -> Iterator[NamedFigure]:
    """Slopes with and without the defects as the first method finds them, and their difference."""
    names = [f"{name}_{end}" for end in DIRECTIONS for name in ("raw_slope", "raw_ideal_slope", "slope")]
    if not shown.has(*names) or not shown.has_plane(names[0]):
        return
    way, where = shown.ways("raw_slope_x", every=False)[0], shown.sorts("raw_slope_x")[0]
    stands = shown.fixed("raw_slope_x", METHOD, REFERENTIAL, shown.sort_dim("raw_slope_x"), *PLANE)
    titles = ["with the defects", "without", "difference"]
    pictures = [
        shown.raster(at(shown.result[name], stands, where, way.point), titles[i] if i < len(titles) else "")
        for i, name in enumerate(names)
    ]
    if any(np.isfinite(one.values).any() for one in pictures):
        shades = about_zero("slope against the ideal heliostat (mrad)", [one.values for one in pictures])
        caption = (
            f"Slopes found by {way.name or 'the method'} with and without the defects, and their difference, which is "
            f"what isolates the defects; seen from the target.{shown.note(stands, [where])}"
        )
        yield NamedFigure("raw_slopes", caption, picture_figure(pictures, shades, 3, list(DIRECTIONS.values())))


def effort(shown: Gazing) -> Iterator[NamedFigure]:
    """Evaluations of each method beside the error of the slopes of a pixel."""
    result, error = shown.result, "slope_rms_x"
    if not shown.has("evaluations", error, "slope_rms_y") or result["evaluations"].dims[-1:] != (METHOD,):
        return
    if MODULE not in result[error].dims or result.sizes[METHOD] < 2:
        return
    (module,), best = shown.modules(error, most=1), shown.best_ways(error)
    methods = [way.method for way in best]
    stands = shown.fixed(error, METHOD, REFERENTIAL, MODULE, shown.sort_dim(error), *SEEDS)
    panels: list[list[Panel]] = [[], []]
    for where in shown.sorts(error):
        spent = at(result["evaluations"], stands, where)
        spent = spent.mean([dim for dim in spent.dims if dim != METHOD]).astype(float)
        found = {
            word: [
                float((at(result[f"slope_rms_{end}"], stands, where, module, way.point) ** 2).mean()) ** 0.5
                for way in best
            ]
            for end, word in DIRECTIONS.items()
        }  # fmt: skip
        words = {METHOD: methods}
        panels[0].append(Panel("evaluations of a pixel (1)", {"": spent.assign_coords(words)}, shown.values(where)))
        lines = {word: xr.DataArray(values, words, METHOD) for word, values in found.items()}
        panels[1].append(Panel("rms error of the slope (mrad)", lines))
    drawn = [*panels[0], *panels[1]]
    if not all(np.isfinite(line).any() for panel in drawn for line in panel.lines.values()):
        return
    caption = (
        f"Evaluations of the merit that each method needs for a pixel, and root mean square error of the slopes of "
        f"{shown.fulls(module) or 'the module'} that is left; A searches nothing.{shown.note(stands, [module])}"
    )
    figure = curve_figure(drawn, "method", columns=len(panels[0]), same_scale="row", least_span=1e-3,
                          looks={"": {"color": METHOD_COLOURS["LM"]}})  # fmt: skip
    yield NamedFigure("effort", caption, figure)


def accuracy_map(shown: Gazing) -> Iterator[NamedFigure]:
    """Error of the slopes of each heliostat by the best method, both directions together."""
    if not shown.has(*_ERRORS) or HELIOSTAT not in shown.result[_ERRORS[0]].dims:
        return
    stands = shown.fixed(_ERRORS[0], HELIOSTAT, HOUR)
    hours = shown.chosen(HOUR if HOUR in shown.result[_ERRORS[0]].dims else None, MOST_HOURS)
    values = [_both(shown, stands, one) for one in hours]
    method = shown.value(METHOD, stands[METHOD]) if METHOD in stands else "the method"
    if REFERENTIAL in stands and method not in DIRECT:
        method += f", referential {shown.value(REFERENTIAL, stands[REFERENTIAL])}"
    said = (
        f"Root mean square error of the slopes of each heliostat by {method}, larger direction, over the pixels that "
        "have slopes."
    )
    shades = from_zero("rms error of the slopes (mrad)", values, LEAST, held=0.98)
    yield from _maps(shown, "accuracy_map", said, stands, hours, values, shades, "mrad")


def usable_map(shown: Gazing) -> Iterator[NamedFigure]:
    """Part of each heliostat for which there are slopes."""
    name = "usable_fraction"
    if not shown.has(name) or HELIOSTAT not in shown.result[name].dims:
        return
    stands = shown.fixed(name, HELIOSTAT, HOUR)
    hours = shown.chosen(HOUR if HOUR in shown.result[name].dims else None, MOST_HOURS)
    values = [100 * at(shown.result[name], stands, one).to_numpy().astype(float) for one in hours]
    said = "Part of the pixels of each heliostat that at least three cameras see lit."
    shades = Shades("pixels with slopes (%)", 0.0, 100.0)
    yield from _maps(shown, "usable_map", said, stands, hours, values, shades, "%")


def over_distance(shown: Gazing) -> Iterator[NamedFigure]:
    """Error of each heliostat over its distance, by method, coloured by the hour."""
    result = shown.result
    if not shown.has(*_ERRORS, "slant_range"):
        return
    if HELIOSTAT not in result[_ERRORS[0]].dims or HELIOSTAT not in result["slant_range"].dims:
        return
    stands = shown.fixed(_ERRORS[0], HELIOSTAT, HOUR, METHOD, REFERENTIAL)
    hours = shown.chosen(HOUR if HOUR in result[_ERRORS[0]].dims else None, MOST_HOURS)
    far = at(result["slant_range"], stands).to_numpy().astype(float)
    look = {"color": "#0072B2", "linestyle": "", "marker": "o", "markersize": 2.4, "markeredgewidth": 0}
    planes, known = [], []
    for way in shown.best_ways(_ERRORS[0]):
        tracks = []
        for one in hours:
            values = _both(shown, stands, one, way.point)
            number = float(shown.coordinate(HOUR).isel(one)) if one else 0.0
            if np.isfinite(values).any() and far.shape == values.shape:
                tracks.append(Track(far, values, look, numbers=np.full(values.size, number)))
                known.append(number)
        if tracks:
            planes.append(Plane(way.name, tracks, square=False))
    if not planes:
        return
    scale = Shades("solar time (h)", min(known), max(known)) if max(known) > min(known) else None
    caption = (
        "Root mean square error of the slopes of each heliostat, larger direction, against its distance from the "
        f"target, by each method.{shown.note(stands, hours)}"
    )
    labels = ("distance from the target (m)", "rms error (mrad)")
    yield NamedFigure("accuracy_over_distance", caption, plane_figure(planes, labels, scale=scale))


def _maps(
    shown: Gazing,
    name: str,
    said: str,
    stands: Point,
    hours: Sequence[Point],
    values: Sequence[np.ndarray],
    shades: Shades,
    unit: str,
) -> Iterator[NamedFigure]:
    """Maps of the field at some hours; none where the result does not tell the places or has no value."""
    names = [one for one in ("x", "y") if one in shown.result.coords]
    here = shown.result[names].isel({dim: i for dim, i in stands.items() if dim in shown.result[names].dims})
    maps: list[FieldMap] = []
    for one, numbers in zip(hours, values, strict=True):
        finite = numbers[np.isfinite(numbers)]
        decimals = 0 if unit == "%" else 4
        middle = f"median {number_text(float(np.median(finite)), decimals)} {unit}" if finite.size else "no slopes"
        title = "\n".join(filter(None, [shown.fulls(one), middle]))
        found = field_map(here, numbers, title)
        maps += [found] if found else []
    if any(np.isfinite(one.values).any() for one in maps):
        words = symbols(maps, high=shades.high, missing="no slopes")
        yield NamedFigure(name, f"{said} {words}{shown.note(stands, hours)}", picture_figure(maps, shades))


def _both(shown: Gazing, *points: Point) -> np.ndarray:
    """Larger of the errors of both directions."""
    return np.maximum(*(at(shown.result[f"slope_rms_{end}"], *points).to_numpy().astype(float) for end in DIRECTIONS))
