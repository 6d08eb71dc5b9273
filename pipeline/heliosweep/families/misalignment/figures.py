"""Figures of misaligned heliostats, after Optics Express 27 (8), A257 (2019): spots, tolerances, calibrations."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.blocks import ERRORS
from heliosweep.report.context import Context, Point, at, evenly
from heliosweep.report.figures import FIELD, HELIOSTAT, Curves, Figure, Grids, Maps, Planes, Special, is_ordered

DAYS = ("day", "declination", "date")
HOUR = "hour"
#: Colours of the error axes, as in Figure 4 of the paper.
_AXES: dict[str, dict[str, Any]] = {
    "elevation": {"color": "#D55E00"},
    "azimuth": {"color": "#0072B2"},
    "encoder-azimuth": {"color": "#009E73", "linestyle": (0, (4, 1.4))},
}
_TYPICAL = {
    **dict.fromkeys(ERRORS, 0.0),
    HOUR: 12.0,
    "error_scale": 1.0,
    "parameters": 99,
    "days_used": 99,
    "round": 99,
}
#: Dimensions that are no sweep.
_OWN = (HELIOSTAT, HOUR, *DAYS, "sample", "spot", "parameter", "parameter_2", "round", "percentile", "detector",
        "crossing", "trace", "conic_coefficient", "outline", "edge", "tolerance_axis")  # fmt: skip
_SEEN = "As seen from the field; grey: aperture."
#: Points of each side of the grid on which a conic is drawn.
_GRID = 201
#: Half width of a 95 % interval over the standard error of many spots.
_WIDE = 1.96
_MOST_POINTS = 60


def figures(result: xr.Dataset) -> Iterator[Figure]:
    """Yield the figures of a result of any mode; a field begins with maps."""
    field = result.sizes.get(HELIOSTAT, 0) >= FIELD
    spots, maps = list(_spots(result)), list(_field(result))
    yield from [*maps, *spots] if field else [*spots, *maps]
    yield from _calibration(result)


def _spots(result: xr.Dataset) -> Iterator[Figure]:
    """Yield figures of spots on the receiver plane."""
    sizes = [dim for dim in ("error_size", *ERRORS) if result.sizes.get(dim, 0) > 2]
    if sizes:
        measured = " Crosses: measured spots." if "measured_y" in result.coords else ""
        yield Planes(
            "deviation_curves",
            f"Spot on the receiver plane for each {sizes[0].replace('_', ' ')}",
            ("spot_z",),
            over=sizes,
            lines=("axis", HOUR, *DAYS),
            at=_TYPICAL,
            notes=f"{_SEEN} Dotted: the whole curve; diamonds: its focus.{measured}",
            looks=_AXES,
            against={"spot_z": "spot_y"},
            extra=_conics,
        )
    yield Planes(
        "spot_drift",
        "Drift of the spot over the day",
        ("spot_z",) if result.sizes.get(HOUR, 0) > 2 else (),
        over=(HOUR,),
        lines=sizes[:1],
        at={**_TYPICAL, "axis": ("elevation",)},
        notes=_SEEN,
        against={"spot_z": "spot_y"},
        colour=HOUR,
    )
    yield Planes(
        "spot_spread",
        "Mean and 95 % ellipse of the spots over the draws of the mount errors, at each hour",
        ("spot_z_mean",),
        over=(HOUR,),
        at=_TYPICAL,
        notes=_SEEN,
        against={"spot_z_mean": "spot_y_mean"},
        colour=HOUR,
        dots=True,
        extra=_ellipses,
    )
    yield Planes(
        "crossings",
        "Crossings of the traces with the arrays of detectors (grey lines)",
        ("crossing_z",) if "trace" in result.sizes else (),
        over=(HOUR, "detector", "crossing", "spot"),
        lines=("trace",),
        at=_TYPICAL,
        against={"crossing_z": "crossing_y"},
        colour=HOUR,
        dots=True,
        extra=_arrays,
    )


def _field(result: xr.Dataset) -> Iterator[Figure]:
    """Yield tolerances and hits: maps, and curves over the hours and over what is swept."""
    swept = [str(dim) for dim in result.sizes if dim not in _OWN]
    numbers = [dim for dim in swept if is_ordered(result, dim)]
    words = tuple(dim for dim in swept if dim not in numbers)
    panels = ("axis", *words, *numbers, *DAYS)
    reduce = {HELIOSTAT: "field"} if result.sizes.get(HELIOSTAT, 0) >= FIELD else {}
    lines = ("statistic", HELIOSTAT)
    tolerance = "Smallest error, of either sign, with which the centre of the beam leaves the aperture"
    yield Maps("tolerance_map", tolerance, ("minimum_tolerance", "tracking_tolerance"), panels=panels, at=_TYPICAL,
               notes="Minimum over all days and hours.")  # fmt: skip
    yield Maps("tolerance_hour_map", "Hour of the minimum tolerance", ("hour_of_minimum_tolerance",), panels=panels,
               interactive=False)  # fmt: skip
    inside = "Part of the draws and hours with sun in which the centre of the beam is inside the aperture"
    yield Maps("hit_map", inside, ("day_hit_fraction", "hit_fraction", "residual_rms", "beam_error_rms",
                                   "spot_distance_rms"), panels=(*numbers, *words, *DAYS), at=_TYPICAL)  # fmt: skip
    yield Curves("tolerance_over_day", f"{tolerance}, over the hours", ("tracking_tolerance",), over=(HOUR,),
                 lines=lines, panels=panels, reduce=reduce, at=_TYPICAL)  # fmt: skip
    yield Curves("hits_over_day", inside, ("field_hit_fraction", "hit_fraction"), over=(HOUR,), reduce=reduce,
                 lines=(*numbers, *DAYS, *lines), at=_TYPICAL)  # fmt: skip
    mean = {HELIOSTAT: "mean"} if reduce else {}
    for dim in numbers:
        title = f"Hits and tolerance over {Context(result).title(dim)}"
        names = ("day_hit_fraction", "hit_fraction", "minimum_tolerance")
        first = ("axis", *words, *DAYS, HELIOSTAT)
        notes = "Mean over the heliostats." if mean else ""
        yield Curves(f"hits_over_{dim}", title, names, over=(dim,), lines=first, reduce=mean, at=_TYPICAL, looks=_AXES,
                     notes=notes)  # fmt: skip
    yield Curves(
        "remaining_tolerance",
        "Further error with which the centre of the beam leaves the aperture: percentiles over the draws",
        ("remaining_tolerance",),
        over=(HOUR,),
        lines=("percentile",),
        panels=("tolerance_axis",),
        at=_TYPICAL,
    )


def _calibration(result: xr.Dataset) -> Iterator[Figure]:
    """Yield figures of calibrations: spots, errors found, their standard errors, and closed loops."""
    moments = ("moment", "spot", *DAYS, HOUR)
    measured = "spot" in result.sizes
    notes = (
        "Before: measured spots. After: residuals of the calibration without this spot, about the aim. Heliostats with "
        "the largest residuals first."
        if measured
        else "Centres of the beams before the calibration and with corrected commands."
    )
    yield Planes(
        "before_after",
        "Spots before and after the calibration",
        ("spots_z",),
        over=moments,
        lines=("when",),
        at=_TYPICAL,
        notes=f"{notes} {_SEEN}",
        worst="residual_rms" if measured else "",
        against={"spots_z": "spots_y"},
        dots=True,
        derive=_before_after,
    )
    yield Planes("after", "Spots after the calibration, enlarged", ("spot_z_after",), over=moments, at=_TYPICAL,
                 notes=_SEEN, against={"spot_z_after": "spot_y_after"}, dots=True, interactive=False)  # fmt: skip
    yield Special(
        "recovered_errors",
        "Errors that the calibration finds against the true ones, with 95 % intervals",
        ("estimated_error", "true_error", "standard_error"),
        draw=_recovered,
    )
    many = {HELIOSTAT: "median", "sample": "median"}
    runs = [dim for dim in ("days_used", "parameters", "noise", "detector_noise") if result.sizes.get(dim, 0) > 1]
    for dim in runs[:1]:
        yield Curves(
            f"knowledge_over_{dim}",
            "Standard errors of the mount errors and condition number of the least-squares problem",
            ("standard_error", "condition_number", "residual_rms"),
            over=(dim,),
            lines=("parameter",),
            reduce=many,
            at=_TYPICAL,
            logarithmic=True,
            notes="Medians over heliostats and draws.",
        )
    yield Curves("mount_errors", "Errors of the mount with standard errors", ("estimated_error",), over=("parameter",),
                 bands={"estimated_error": ("standard_error",)}, lines=(HELIOSTAT, "loss", "parameters"),
                 at=_TYPICAL)  # fmt: skip
    yield Curves(
        "closed_loop",
        "Remaining error after each round of the closed loop",
        ("beam_error_rms", "spot_distance_rms"),
        over=("round",),
        lines=("statistic", "correction"),
        panels=("correction",),
        reduce={"sample": "median", HELIOSTAT: "field"},
        logarithmic=True,
        notes="Over the heliostats; round 0 is before any correction.",
    )
    run = [dim for dim in result.sizes if dim in ("error_size", *ERRORS) and result.sizes[dim] > 2]
    yield Grids(
        "hit_grid", "Hits over both errors", ("hit_fraction",) if len(run) > 1 else (), over=tuple(map(str, run[:2]))
    )


def _before_after(result: xr.Dataset) -> xr.Dataset:
    """Return the spots before and after the calibration along a dimension ``when``."""
    names = {side: [f"spot_{side}_{when}" for when in ("before", "after")] for side in "yz"}
    if not all(name in result for pair in names.values() for name in pair):
        return result
    when = xr.IndexVariable("when", ["before", "after"])
    joined = {f"spots_{side}": xr.concat([result[name] for name in pair], when) for side, pair in names.items()}
    return result.assign(joined)


def _conics(axes: Any, result: xr.Dataset, point: Point) -> None:
    """Draw whole curves, foci, detectors, crossings, measured spots, and edges of the beam on a panel."""
    sides = [np.linspace(low, high, _GRID) for low, high in (axes.get_xlim(), axes.get_ylim())]
    y, z = np.meshgrid(*sides)
    names = np.atleast_1d(result["axis"].to_numpy()).tolist() if "axis" in result.coords else [""]
    for index, name in enumerate(names):
        here = (
            {"axis": index, **point, HOUR: Context(result, _TYPICAL).position(HOUR)} if HOUR in result.sizes else point
        )
        colour = _AXES.get(str(name).replace("_", "-"), {"color": "#333333"})["color"]
        if "conic" in result and (conic := at(result["conic"], here)).ndim == 1 and bool(conic.notnull().all()):
            a, b, c, d, e, f = conic.to_numpy()
            shape = a * y * y + b * y * z + c * z * z + d * y + e * z + f
            axes.contour(y, z, shape, [0.0], colors=[colour], linewidths=0.8, linestyles="dotted")
            focus = [float(at(result[f"focus_{side}"], here)) for side in "yz"]
            axes.plot(*focus, "D", color=colour, markersize=4, scalex=False, scaley=False)
        for kind, look in (("edge", ":"), ("outline", "-")):
            if f"{kind}_y" in result and "error_size" in result[f"{kind}_y"].dims:
                pair = [at(result[f"{kind}_{side}"], here).transpose("error_size", kind).to_numpy() for side in "yz"]
                pair = [side[evenly(len(side), 7)] if kind == "outline" else side.T for side in pair]
                for across, up in zip(*pair, strict=True):
                    axes.plot(across, up, look, color=colour, linewidth=0.6, scalex=False, scaley=False)
    if "measured_y" in result.coords:
        pair = [at(result[f"measured_{side}"], point).to_numpy().ravel() for side in "yz"]
        axes.plot(*pair, "+", color="black", markersize=5, scalex=False, scaley=False)
    if {"l0", "l1", "l2"} <= set(result.coords):
        for across, up, offset in zip(*(np.atleast_1d(result[name]) for name in ("l0", "l1", "l2")), strict=True):
            axes.contour(
                y, z, across * y + up * z - offset, [0.0], colors="#777777", linewidths=0.9, linestyles="dashdot"
            )


def _ellipses(axes: Any, result: xr.Dataset, point: Point) -> None:
    """Draw the 95 % ellipse of the spots at each hour, and enlarge the axes for them."""
    from matplotlib import colormaps
    from matplotlib.patches import Ellipse

    from heliosweep.report.draw import frame_square
    from heliosweep.report.shapes import aperture

    names = ("spot_y_mean", "spot_z_mean", "spot_y_variance", "spot_z_variance", "spot_yz_covariance")
    if not set(names) <= set(result.data_vars):
        return
    rows = np.stack([np.atleast_1d(at(result[name], point)) for name in names], axis=-1)
    corners = []
    for place, (y, z, yy, zz, yz) in enumerate(rows):
        if not np.isfinite([y, z, yy, zz, yz]).all():
            continue
        values, vectors = np.linalg.eigh([[yy, yz], [yz, zz]])
        short, long = 2 * np.sqrt(np.maximum(values, 0.0) * -2.0 * np.log(0.05))
        angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
        colour = colormaps["viridis"](place / max(len(rows) - 1, 1))
        axes.add_patch(Ellipse((y, z), long, short, angle=angle, facecolor="none", edgecolor=colour, linewidth=1.1))
        reach = np.sqrt(-2.0 * np.log(0.05) * np.maximum([yy, zz], 0.0))
        corners.append(np.array([y, z]) + reach * [(-1, -1), (1, 1)])
    frame_square(axes, corners, aperture(result, point))


def _arrays(axes: Any, result: xr.Dataset, point: Point) -> None:
    """Draw the arrays of detectors that the attribute ``detectors`` describes."""
    for piece in str(result.attrs.get("detectors", "")).split("; "):
        if ": " in piece:
            y, z, across, up, length = map(float, piece.partition(": ")[2].split())
            ends = np.array([0.0, length]) if np.isfinite(length) else np.array([-1e3, 1e3])
            axes.plot(
                y + ends * across, z + ends * up, color="#999999", linewidth=1.2, scalex=False, scaley=False, zorder=1
            )


def _recovered(result: xr.Dataset) -> Any:
    """Draw estimated errors against true ones, a panel for each parameter."""
    from heliosweep.report.draw import panels

    context = Context(result, _TYPICAL)
    found, many = (
        result["estimated_error"],
        [dim for dim in (HELIOSTAT, "sample") if dim in result["estimated_error"].dims],
    )
    fixed = context.fixed(found, "parameter", *many)
    drawing, grid = panels(result.sizes["parameter"], 3, 0.9)
    for index, axes in enumerate(grid):
        arrays = [found, result["true_error"], result["standard_error"]]
        values, true, error = (
            np.ravel(one) for one in xr.broadcast(*(at(each, fixed, {"parameter": index}) for each in arrays))
        )
        few = evenly(values.size, _MOST_POINTS)
        axes.errorbar(true[few], values[few], _WIDE * error[few], fmt="o", markersize=3, elinewidth=0.6, alpha=0.8)
        axes.axline(
            (0.0, 0.0) if not np.isfinite(true).any() else (np.nanmean(true),) * 2,
            slope=1,
            color="#888888",
            linewidth=0.7,
        )
        axes.set(title=str(result["parameter"].to_numpy()[index]).replace("_", " "), xlabel="true error (mrad)")
        axes.set(ylabel="error found (mrad)" if index % 3 == 0 else "")
        axes.grid(True)
    return drawing, context.note(fixed)
