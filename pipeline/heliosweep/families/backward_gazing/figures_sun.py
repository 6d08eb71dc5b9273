"""The sun's profile beside the formula of Jose, after Figures 5 and 6; slopes with and without defects, after Figure 7;
and what each method costs beside its error.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr

from heliosweep.families.backward_gazing.shown import (
    DIRECTIONS,
    METHOD,
    METHOD_COLOURS,
    MODULE,
    REFERENTIAL,
    SEEDS,
    Gazing,
)
from heliosweep.families.backward_gazing.variables import PLANE
from heliosweep.report.contents import NamedFigure
from heliosweep.report.labels import number_text
from heliosweep.report.panels import Panel, curve_figure
from heliosweep.report.pictures import Raster, Shades, about_zero, picture_figure
from heliosweep.report.selection import at

DISC = "disc_fraction"
#: Pixels along the side of a drawn disc.
SIDE = 201


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


FIGURES = (sun, raw_slopes, effort)
