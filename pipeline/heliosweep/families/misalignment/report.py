"""Figures, tables and warnings for results of all modes, based on Optics Express 27 (8), A257 (2019)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.calibration import (
    DISAGREE,
    DOUBTFUL,
    DOUBTFUL_APERTURES,
    DOUBTFUL_ERROR,
    EARLIER,
    KNOWN,
    LARGEST_DEVIATION,
    LATER,
    MIRRORED,
    NEITHER,
    NO_AZIMUTH,
    NO_ELEVATION,
    READINGS,
)
from heliosweep.grid import BEST_VALUE
from heliosweep.kernels import calibration as codes
from heliosweep.kernels.mounts import BEHIND_FACE, BLIND_CONE, ERRORS, MISSES, NO_SUN, TOO_NEAR
from heliosweep.layouts.layout import label_of
from heliosweep.mounts import CONDITION_LIMITS
from heliosweep.report.figures import (
    FIELD,
    HELIOSTAT,
    Context,
    Curves,
    Figure,
    Grids,
    Maps,
    Planes,
    Point,
    Special,
    at,
    evenly,
    is_ordered,
)
from heliosweep.report.tables import Table, numbers

DAYS = ("day", "declination", "date")
HOUR = "hour"
#: Colours of the error axes, as in Figure 4 of Optics Express 27 (8), A257.
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
#: Dimensions that do not belong to swept keys.
_OWN = (HELIOSTAT, HOUR, *DAYS, "sample", "spot", "parameter", "parameter_2", "round", "percentile", "detector",
        "crossing", "trace", "conic_coefficient", "outline", "edge", "tolerance_axis")  # fmt: skip
_SEEN = "Seen from the field. Grey: aperture."
#: Variables by which tables sort the heliostats, maximum first. The first variable in the result is used.
_RANKS = ("held_out_residual_rms", "beam_residual_rms")


def figures(result: xr.Dataset) -> Iterator[Figure]:
    """Yield the figures for a result of any mode. For a field, maps come first."""
    sizes = [dim for dim in ("error_size", *ERRORS) if result.sizes.get(dim, 0) > 2]
    measured = " Crosses: measured spots." if "measured_y" in result.coords else ""
    spots: list[Figure] = [
        *(
            Planes(
                "deviation_curves",
                f"Spot on the receiver plane for each {size.replace('_', ' ')}",
                ("spot_z",),
                over=sizes,
                lines=("axis", HOUR, *DAYS),
                at=_TYPICAL,
                notes=f"{_SEEN} Dotted lines: complete curves. Diamonds: foci.{measured}",
                looks=_AXES,
                against={"spot_z": "spot_y"},
                extra=_conics,
            )
            for size in sizes[:1]
        ),
        Planes(
            "spot_drift",
            "Drift of the spot over the day",
            ("spot_z",) if result.sizes.get(HOUR, 0) > 2 else (),
            over=(HOUR,),
            lines=sizes[:1],
            at={**_TYPICAL, "axis": ("elevation",)},
            notes=_SEEN,
            against={"spot_z": "spot_y"},
            colour=HOUR,
        ),
        Planes(
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
        ),
        Planes(
            "crossings",
            "Crossings of the traces with the detector arrays (grey lines)",
            ("crossing_z",) if "trace" in result.sizes else (),
            over=(HOUR, "detector", "crossing", "spot"),
            lines=("trace",),
            at=_TYPICAL,
            against={"crossing_z": "crossing_y"},
            colour=HOUR,
            dots=True,
            extra=_arrays,
        ),
    ]
    parts = [spots, _field(result)][:: -1 if result.sizes.get(HELIOSTAT, 0) >= FIELD else 1]
    yield from itertools.chain(*parts)
    moments, in_file = ("moment", "spot", *DAYS, HOUR), "spot" in result.sizes
    notes = (
        "Before: measured spots. After: leave-one-out residuals, relative to the aim point. Heliostats with the "
        "largest residuals come first."
        if in_file
        else "Centres of the beams before the calibration and with corrected commands."
    )
    runs = [dim for dim in ("days_used", "parameters", "noise", "detector_noise") if result.sizes.get(dim, 0) > 1]
    errors = [str(dim) for dim in result.sizes if dim in sizes]
    yield from [
        Planes(
            "before_after",
            "Spots before and after the calibration",
            ("spots_z",),
            over=moments,
            lines=("when",),
            at=_TYPICAL,
            notes=f"{notes} {_SEEN}",
            worst="residual_rms" if in_file else "",
            against={"spots_z": "spots_y"},
            dots=True,
            derive=_before_after,
        ),
        Planes("after", "Spots after the calibration, enlarged", ("spot_z_after",), over=moments, at=_TYPICAL,
               notes=_SEEN, against={"spot_z_after": "spot_y_after"}, dots=True, interactive=False),
        Special(
            "recovered_errors",
            "Estimated errors against true errors, with 95 % confidence intervals",
            ("estimated_error", "true_error", "standard_error"),
            draw=_recovered,
        ),
        *(
            Curves(
                f"knowledge_over_{dim}",
                "Standard errors of the mount errors and condition number of the least-squares problem",
                ("standard_error", "condition_number", "residual_rms"),
                over=(dim,),
                lines=("parameter",),
                reduce={HELIOSTAT: "median", "sample": "median"},
                at=_TYPICAL,
                logarithmic=True,
                notes="Medians over heliostats and draws.",
            )
            for dim in runs[:1]
        ),
        Curves("mount_errors", "Mount errors with standard errors", ("estimated_error",), over=("parameter",),
               bands={"estimated_error": ("standard_error",)}, lines=(HELIOSTAT, "loss", "parameters"), at=_TYPICAL),
        Curves("drift", "Mount errors in moving windows, with standard errors", ("period_error",),
               over=("period",), lines=(HELIOSTAT,), panels=("parameter",), at=_TYPICAL,
               bands={"period_error": ("period_standard_error",)}, derive=lambda data: (
                   # Errors that are not estimated are omitted.
                   data.dropna("parameter", how="all", subset=["period_error"]) if "period_error" in data else data
               )),
        Curves(
            "closed_loop",
            "Remaining error after each round of the closed loop",
            ("beam_error_rms", "spot_distance_rms"),
            over=("round",),
            lines=("statistic", "correction"),
            panels=("correction",),
            reduce={"sample": "median", HELIOSTAT: "field"},
            logarithmic=True,
            notes="Statistics over the heliostats. Round 0 is before any correction.",
        ),
        Grids(
            "hit_grid",
            "Hit fraction over both errors",
            ("hit_fraction",) if len(errors) > 1 else (),
            over=tuple(errors[:2]),
        ),
    ]  # fmt: skip


def _field(result: xr.Dataset) -> list[Figure]:
    swept = [str(dim) for dim in result.sizes if dim not in _OWN]
    numbers = [dim for dim in swept if is_ordered(result, dim)]
    words = tuple(dim for dim in swept if dim not in numbers)
    panels, lines = ("axis", *words, *numbers, *DAYS), ("statistic", HELIOSTAT)
    many = result.sizes.get(HELIOSTAT, 0) >= FIELD
    tolerance = "Minimum error of either sign at which the centre of the beam leaves the aperture"
    inside = "Fraction of the draws and hours with sun in which the centre of the beam is inside the aperture"
    of_field: dict[str, Any] = {"over": (HOUR,), "at": _TYPICAL, "reduce": {HELIOSTAT: "field"} if many else {}}
    return [
        Maps("tolerance_map", tolerance, ("minimum_tolerance", "tracking_tolerance"), panels=panels, at=_TYPICAL,
             notes="Minimum over all days and hours."),
        Maps("tolerance_hour_map", "Hour of the minimum tolerance", ("hour_of_minimum_tolerance",), panels=panels,
             interactive=False),
        Maps("hit_map", inside, ("day_hit_fraction", "hit_fraction"), panels=(*numbers, *words, *DAYS), at=_TYPICAL),
        Maps("beam_error_map", "Error of the beam after each round of the closed loop",
             ("beam_error_rms", "spot_distance_rms"), panels=(*numbers, *words), at=_TYPICAL),
        Maps("residual_map", "Spot residuals", (*_RANKS, "residual_rms"), panels=(*numbers, *words),
             at=_TYPICAL),
        Curves("tolerance_over_day", f"{tolerance}, over the hours", ("tracking_tolerance",), lines=lines,
               panels=panels, **of_field),
        Curves("hits_over_day", inside, ("field_hit_fraction", "hit_fraction"), lines=(*numbers, *DAYS, *lines),
               **of_field),
        *(
            Curves(
                f"hits_over_{dim}",
                f"Hit fraction and tolerance against {Context(result).title(dim)}",
                ("day_hit_fraction", "hit_fraction", "minimum_tolerance"),
                over=(dim,),
                lines=("axis", *words, *DAYS, HELIOSTAT),
                reduce={HELIOSTAT: "mean"} if many else {},
                at=_TYPICAL,
                looks=_AXES,
                notes="Mean over the heliostats." if many else "",
            )
            for dim in numbers
        ),
        Curves(
            "remaining_tolerance",
            "Additional error at which the centre of the beam leaves the aperture: percentiles over the draws",
            ("remaining_tolerance",),
            over=(HOUR,),
            lines=("percentile",),
            panels=("tolerance_axis",),
            at=_TYPICAL,
        ),
    ]  # fmt: skip


def _before_after(result: xr.Dataset) -> xr.Dataset:
    names = {side: [f"spot_{side}_{when}" for when in ("before", "after")] for side in "yz"}
    if not {name for pair in names.values() for name in pair} <= set(result):
        return result
    when = xr.IndexVariable("when", ["before", "after"])
    return result.assign(
        {f"spots_{side}": xr.concat([result[name] for name in pair], when) for side, pair in names.items()}
    )


def _conics(axes: Any, result: xr.Dataset, point: Point) -> None:
    """Draw complete deviation curves, foci, beam edges, measured spots and detector lines in one panel."""
    y, z = np.meshgrid(*(np.linspace(low, high, 201) for low, high in (axes.get_xlim(), axes.get_ylim())))
    look: dict[str, Any] = {"scalex": False, "scaley": False}
    names = np.atleast_1d(result["axis"].to_numpy()).tolist() if "axis" in result.coords else [""]
    hour = {HOUR: Context(result, _TYPICAL).position(HOUR)} if HOUR in result.sizes else {}
    for index, name in enumerate(names):
        here = {"axis": index, **point, **hour} if hour else point
        colour = _AXES.get(str(name).replace("_", "-"), {"color": "#333333"})["color"]
        if "conic" in result and (conic := at(result["conic"], here)).ndim == 1 and bool(conic.notnull().all()):
            shape = np.tensordot(conic.to_numpy(), [y * y, y * z, z * z, y, z, np.ones_like(y)], 1)
            axes.contour(y, z, shape, [0.0], colors=[colour], linewidths=0.8, linestyles="dotted")
            axes.plot(
                *(float(at(result[f"focus_{side}"], here)) for side in "yz"), "D", color=colour, markersize=4, **look
            )
        _beams(axes, result, here, {"color": colour, "linewidth": 0.6, **look})
    if "measured_y" in result.coords:
        pair = [at(result[f"measured_{side}"], point).to_numpy().ravel() for side in "yz"]
        axes.plot(*pair, "+", color="black", markersize=5, **look)
    for line in zip(*(np.atleast_1d(result.coords.get(name, [])) for name in ("l0", "l1", "l2")), strict=True):
        shape = line[0] * y + line[1] * z - line[2]
        axes.contour(y, z, shape, [0.0], colors="#777777", linewidths=0.9, linestyles="dashdot")


def _beams(axes: Any, result: xr.Dataset, here: Point, look: Mapping[str, Any]) -> None:
    for kind, style in (("edge", ":"), ("outline", "-")):
        if "error_size" in result.get(f"{kind}_y", xr.DataArray()).dims:
            sides = [at(result[f"{kind}_{side}"], here).transpose("error_size", kind).to_numpy() for side in "yz"]
            sides = [side[evenly(len(side), 7)] if kind == "outline" else side.T for side in sides]
            for across, up in zip(*sides, strict=True):
                axes.plot(across, up, style, **look)


def _ellipses(axes: Any, result: xr.Dataset, point: Point) -> None:
    from matplotlib import colormaps
    from matplotlib.patches import Ellipse

    from heliosweep.report.draw import frame_square
    from heliosweep.report.figures import aperture

    names, corners = ("spot_y_mean", "spot_z_mean", "spot_y_variance", "spot_z_variance", "spot_yz_covariance"), []
    rows = np.stack([np.atleast_1d(at(result[name], point)) for name in names], axis=-1)
    for place in np.flatnonzero(np.isfinite(rows).all(axis=1)):
        y, z, yy, zz, yz = rows[place]
        values, vectors = np.linalg.eigh([[yy, yz], [yz, zz]])
        short, long = 2 * np.sqrt(np.maximum(values, 0.0) * -2.0 * np.log(0.05))
        angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
        colour = colormaps["viridis"](place / max(len(rows) - 1, 1))
        axes.add_patch(Ellipse((y, z), long, short, angle=angle, facecolor="none", edgecolor=colour, linewidth=1.1))
        reach = np.sqrt(-2.0 * np.log(0.05) * np.maximum([yy, zz], 0.0))
        corners.append(np.array([y, z]) + reach * [(-1, -1), (1, 1)])
    frame_square(axes, corners, aperture(result, point))


def _arrays(axes: Any, result: xr.Dataset, point: Point) -> None:
    for piece in filter(None, str(result.attrs.get("detectors", "")).split("; ")):
        y, z, across, up, length = map(float, piece.partition(": ")[2].split())
        ends = np.array([0.0, length]) if np.isfinite(length) else np.array([-1e3, 1e3])
        look: dict[str, Any] = {"color": "#999999", "linewidth": 1.2, "zorder": 1}
        axes.plot(y + ends * across, z + ends * up, scalex=False, scaley=False, **look)


def _recovered(result: xr.Dataset) -> Any:
    from heliosweep.report.draw import panels

    context, found = Context(result, _TYPICAL), result["estimated_error"]
    fixed = context.fixed(found, "parameter", *(dim for dim in (HELIOSTAT, "sample") if dim in found.dims))
    drawing, grid = panels(result.sizes["parameter"], 3, 0.9)
    for index, axes in enumerate(grid):
        arrays = (
            at(result[f"{name}_error"], fixed, {"parameter": index}) for name in ("estimated", "true", "standard")
        )
        values, true, error = (np.ravel(one) for one in xr.broadcast(*arrays))
        few = evenly(values.size, 60)
        axes.errorbar(true[few], values[few], 1.96 * error[few], fmt="o", markersize=3, elinewidth=0.6, alpha=0.8)
        middle = np.nanmean(true) if np.isfinite(true).any() else 0.0
        axes.axline((middle, middle), slope=1, color="#888888", linewidth=0.7)
        axes.set(title=str(result["parameter"].to_numpy()[index]).replace("_", " "), xlabel="true error (mrad)")
        axes.set(ylabel="estimated error (mrad)" if index % 3 == 0 else "")
        axes.grid(True)
    return drawing, context.note(fixed)


#: Variables that describe the quality of a fit, with the headings of their table columns.
_QUALITY = {
    "spots_used": "spots",
    "crossings_used": "crossings",
    "condition_number": "condition number",
    "residual_rms": "residual rms",
    "leave_one_out_rms": "leave-one-out rms",
    "uncalibrated_beam_residual_rms": "beam residual without calibration",
    "beam_residual_rms": "beam residual with calibration",
    "held_out_spots": "spots held out",
    "uncalibrated_held_out_residual_rms": "held-out residual without calibration",
    "held_out_residual_rms": "held-out residual with calibration",
    "least_known_direction": "least accurately known error",
    "calibration_status": "status",
}


def tables(result: xr.Dataset) -> Iterator[Table]:
    """Yield a table of estimated errors, or of hit fractions for drawn mount errors.

    Other results have no tables.
    """
    if {"estimated_error", "standard_error"} <= set(result) and HELIOSTAT in result["estimated_error"].dims:
        yield _errors_found(result)
    if {"day_hit_fraction", "spot_y_variance", "spot_z_variance"} <= set(result.data_vars):
        yield _hits_of_draws(result)


def _errors_found(result: xr.Dataset) -> Table:
    rank = next((name for name in _RANKS if name in result), "")
    if rank:
        worst = result[rank].max([dim for dim in result[rank].dims if dim != HELIOSTAT])
        result = result.isel({HELIOSTAT: np.argsort(-worst.fillna(-1.0).to_numpy(), kind="stable")})
    context, found = Context(result, {"parameters": 99, "days_used": 99}), result["estimated_error"]
    swept = {dim: size for dim, size in found.sizes.items() if dim not in ("parameter", HELIOSTAT, "sample")}
    dims = [*(str(dim) for dim, size in swept.items() if size > 1), HELIOSTAT]
    dims = dims if math.prod(map(result.sizes.__getitem__, dims)) <= 60 else [HELIOSTAT]
    fixed = context.fixed(found, "parameter", *dims)
    here, names = result.isel(fixed), result["parameter"].astype(str).str.replace("_", " ").to_numpy().tolist()
    values, errors = ([here[name][{"parameter": i}].reset_coords(drop=True) for i in range(len(names))]
                      for name in ("estimated_error", "standard_error"))  # fmt: skip
    shown = [one.rename(name) for name, one in zip(names, values, strict=True) if bool(np.isfinite(one).any())] + [
        here[name].reset_coords(drop=True).rename(title).broadcast_like(values[0]).assign_attrs({BEST_VALUE: ""})
        for name, title in _QUALITY.items()
        if name in here and set(here[name].dims) <= set(dims) and ("held" not in name or rank.startswith("held"))
    ]
    here = here.assign({f"{name}_error": one for name, one in zip(names, errors, strict=True)})
    note = f"{context.note(fixed)} Largest {_QUALITY[rank]} first.".strip() if rank else context.note(fixed)
    return numbers(here, dims, shown, "Estimated mount errors, with standard errors", [note] * bool(note))


def _hits_of_draws(result: xr.Dataset) -> Table:
    """Tabulate the hit fraction, the worst heliostat and the spread of the spots on each day."""
    context, hits = Context(result), 100.0 * result["day_hit_fraction"].reset_coords(drop=True)
    dims, percent = [str(dim) for dim in hits.dims if dim != HELIOSTAT], {"units": "%"}
    hits = hits.where(np.isfinite(hits)).transpose(..., HELIOSTAT)
    names = np.array([context.value(HELIOSTAT, index) for index in range(result.sizes[HELIOSTAT])])
    worst, inner = (
        hits.fillna(200.0).argmin(HELIOSTAT),
        [dim for dim in result["spot_y_variance"].dims if dim not in dims],
    )
    shown = [
        hits.mean(HELIOSTAT).assign_attrs(percent).rename("spots inside, mean"),
        hits.min(HELIOSTAT).assign_attrs(percent).rename("spots inside, worst heliostat"),
        worst.copy(data=names[worst.to_numpy()]).rename("worst heliostat"),
    ]
    for side, word in (("y", "to the right"), ("z", "upwards")):
        spread = result[f"spot_{side}_variance"].reset_coords(drop=True).median(inner) ** 0.5
        shown.append(spread.assign_attrs(units="m").rename(f"spread {word}"))
    note = (
        "Spots inside: fraction of all draws and hours with sun in which the centre of the beam is inside the "
        "aperture. Spread: standard deviation over the draws, median over heliostats and hours."
    )
    return numbers(result, dims, shown, "Hit fractions of mounts with drawn errors", [note])


#: Maximum number of spots or heliostats that a warning lists.
_LISTED = 6
#: Warning for each flag code. Placeholders: {count} is the number of cases and the total number, {what} is "spots" or
#: "crossings", and {least} is the mount error that is determined least accurately.
_FLAGS = {
    "detector_status": {
        NO_ELEVATION: "at {count} instants the elevation trace crosses no array",
        NO_AZIMUTH: "at {count} instants the azimuth trace crosses no array",
        NEITHER: "at {count} instants neither trace crosses an array",
    },
    "calibration_status": {
        codes.TOO_FEW: "{count} calibrations have too few {what} to estimate the errors: add {what}, or estimate "
        "fewer errors",
        codes.NOT_CONVERGED: "{count} calibrations did not converge and give no commands: do not use their estimates",
        codes.EXACT: "{count} calibrations have no standard errors, because the numbers of equations and errors are "
        "equal: add {what}",
        codes.NO_OBSERVATIONS: "{count} calibrations have no usable {what}: no errors are estimated",
        codes.DEPENDENT: "{count} calibrations cannot distinguish between the errors, least of all for {least}: no "
        "errors are estimated; measure {what} at other hours and on other days",
        codes.INDISTINCT: "{count} calibrations have a condition number above {limits} (up to {largest:.4g}): the "
        "{what} hardly distinguish the errors, least of all {least}; measure {what} on more days, or estimate "
        "fewer errors",
    },
    "spot_status": {
        BEHIND_FACE: "{count} rays start on the receiver plane or behind it, because of the mirror offset: no spot",
        MISSES: "{count} rays point away from the receiver plane, or come from a mirror whose back is lit: no spot",
        BLIND_CONE: "{count} rays require a mount to point into its blind cone: no spot",
    },
}
#: Pairs of a count and a warning. The warning is shown if the count is not zero.
Remarks = Iterator[tuple[int, str]]


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Yield warnings about missing spots and statistics, doubtful estimates, and missed detector arrays."""
    parts: dict[str, Callable[[xr.Dataset], Remarks]] = {
        "spot_status": _of_spots,
        "real_fraction": _of_statistics,
        "misses_array": _of_arrays,
        "detector_status": lambda result: _of_flags(result, "detector_status"),
        "calibration_status": _of_calibrations,
        "spot_deviation": _of_measured,
        "drift": _of_drift,
        "instants_without_command": _of_commands,
    }
    return (words for name, part in parts.items() if name in result for count, words in part(result) if count)


def _of_statistics(result: xr.Dataset) -> Remarks:
    real = result["real_fraction"].to_numpy()
    some, none = int(np.count_nonzero((real > 0) & (real < 1))), int(np.count_nonzero(real == 0))
    yield some, f"{some:,} of {real.size:,} statistics omit draws whose ray does not reach the receiver's plane"
    yield none, f"{none:,} of {real.size:,} statistics are missing: no draw has a ray that reaches the receiver's plane"


def _of_arrays(result: xr.Dataset) -> Remarks:
    missed, advice = result["misses_array"].transpose("detector", ...), "(misses_array): move the array"
    for number, each in enumerate(missed.to_numpy() > 0):
        words = f"the traces of {each.sum():,} of {each.size:,} heliostats, counted at each point of the sweep,"
        yield (
            int(each.sum()),
            f"{words} never cross array {number} {advice}, or make it longer",
        )


def _of_calibrations(result: xr.Dataset) -> Remarks:
    yield from _of_flags(result, "calibration_status")
    doubtful = result["calibration_status"].to_numpy() == DOUBTFUL
    heliostats = result[label_of(result.coords)].to_numpy()[doubtful.reshape(-1, doubtful.shape[-1]).any(axis=0)]
    listed = ", ".join(map(str, heliostats[:_LISTED])) + ", ..." * int(heliostats.size > _LISTED)
    yield (
        heliostats.size,
        f"heliostat {listed}: the calibration is doubtful. An error exceeds {DOUBTFUL_ERROR:g} mrad, or a spot lies "
        f"more than {DOUBTFUL_APERTURES:g} apertures from the prediction for a mount without errors: check that "
        "spots are in metres, and that sun vectors, commanded angles and heliostats are correct (calibration_status "
        f"{DOUBTFUL})",
    )


def _of_commands(result: xr.Dataset) -> Remarks:
    count = int(result["instants_without_command"].sum())
    instants = math.prod(size for dim, size in result["nominal_azimuth"].sizes.items() if dim in (*DAYS, HOUR))
    all_instants = int(np.isin(result["calibration_status"], KNOWN).sum()) * instants
    yield (
        count,
        f"at {count:,} of {all_instants:,} instants of calibrated heliostats with the sun up, no command directs "
        "the beam to the aim point: the direction is in the mount's blind cone, or the mirror offsets are "
        "not smaller than the distance (instants_without_command)",
    )


def _of_flags(result: xr.Dataset, name: str, less: Mapping[int, int] = MappingProxyType({})) -> Remarks:
    """Yield a warning for each code that occurs in a flag variable.

    `less` contains the number of cases to subtract from the count of each code.
    """
    status = result[name].to_numpy()
    for code, words in _FLAGS[name].items():
        which = status == code
        if count := int(np.count_nonzero(which)) - less.get(code, 0):
            texts = {"count": f"{count:,} of {status.size:,}"}
            if name == "calibration_status":
                direction, condition = result["least_known_direction"], result["condition_number"]
                parameters = result["parameters"].broadcast_like(condition).transpose(*condition.dims).to_numpy()[which]
                given = {condition.attrs.get("condition_limit", CONDITION_LIMITS[each]) for each in parameters.tolist()}
                least = np.bincount(direction.to_numpy()[which] + 1).argmax()
                texts |= {
                    "what": "crossings" if "crossings_used" in result else "spots",
                    "least": str(direction.attrs["flag_meanings"]).split()[least],
                    "limits": " or ".join(f"{limit:g}" for limit in sorted(given)),
                    "largest": np.fmax.reduce(condition.to_numpy()[which]),
                }
            yield count, f"{words.format(**texts)} ({name} {code})"


def _of_spots(result: xr.Dataset) -> Remarks:
    status = result["spot_status"]
    times = [dim for dim in status.dims if dim in (*DAYS, HOUR)]
    points = status.size // math.prod(status.sizes[dim] for dim in times)
    counted = "" if points == status.sizes["heliostat"] else ", counted at each point of the sweep,"
    # If the pivot is close to the plane, the mirror may be behind the plane only at some instants.
    behind = (status == BEHIND_FACE).any(times) & status.isin([BEHIND_FACE, NO_SUN]).all(times)
    for code, here, words in (
        (BEHIND_FACE, behind, "are on the receiver plane or behind it whenever the sun is up"),
        (TOO_NEAR, (status == TOO_NEAR).any(times), "are closer to the aim point than the mirror offsets"),
    ):
        subject = f"{int(here.sum()):,} of {points:,} heliostats{counted}"
        yield int(here.sum()), f"{subject} {words}: no spot (spot_status {code})"
    yield from _of_flags(result, "spot_status", {BEHIND_FACE: int(((status == BEHIND_FACE) & behind).sum())})
    dark = (status == NO_SUN).any([dim for dim in status.dims if dim not in ("site", "latitude", *times)])
    words = f"the sun is down at {int(dark.sum()):,} of {dark.size:,} instants"
    yield int(dark.sum()), f"{words}: no spot (spot_status {NO_SUN})"


def _of_drift(result: xr.Dataset) -> Remarks:
    order = (HELIOSTAT, "parameter", "period")
    drift = result["drift"].transpose(..., *order).to_numpy().reshape(-1, *(result.sizes[dim] for dim in order))[0] == 1
    change, error = (
        result[name].transpose(..., *order).to_numpy().reshape(-1, *drift.shape)[0]
        for name in ("period_change", "period_change_error")
    )
    rows, errors = np.nonzero(drift.any(axis=-1))
    last = drift.shape[-1] - 1 - np.argmax(drift[rows, errors, ::-1], axis=-1)
    size, spread, names = (
        change[rows, errors, last],
        error[rows, errors, last],
        result[label_of(result.coords)].to_numpy(),
    )
    listed = "; ".join(
        f"{names[rows[k]]} {result['parameter'].to_numpy()[errors[k]].replace('_', ' ')} {size[k]:+.2f} "
        f"+- {spread[k]:.2f} mrad by {result['period'].to_numpy()[last[k]]:.10}"
        for k in np.argsort(-np.abs(size), kind="stable")[:_LISTED]
    )
    yield (
        rows.size,
        f"{rows.size:,} errors of {len(set(rows.tolist())):,} heliostats have changed since the first window, "
        f"outside the 99.9 % confidence intervals: {listed}{'; ...' * (rows.size > _LISTED)} (drift 1)",
    )


def _of_measured(result: xr.Dataset) -> Remarks:
    if "campaign" in result["better_reading"].dims:
        tables = {str(name): result.sel(campaign=name) for name in result["campaign"].to_numpy()}
        yield from ((count, f"{name}: {words}") for name, one in tables.items() for count, words in _of_measured(one))
        return
    point = result.isel({dim: 0 for dim in result["better_reading"].dims if dim != "heliostat"})
    known = int(np.isin(point["calibration_status"], KNOWN).sum())
    mirrored = (
        "y is positive to the right for an observer in the field who faces the receiver, and z is positive upwards"
    )
    clock = "check the offset from universal time and whether summer time applies"
    for code, advice in ((MIRRORED, mirrored), (EARLIER, clock), (LATER, clock)):
        count = int((point["better_reading"] == code).sum())
        fitted = f"the spots of {count:,} of {known:,} heliostats fit much better {READINGS[code].replace('_', ' ')}"
        yield int(count > (known / 4 if count > 1 else known / 2)), f"{fitted}: {advice} (better_reading)"
    names, time, deviation = (
        point[name].to_numpy() for name in (label_of(point.coords), "spot_time", "spot_deviation")
    )
    distance = np.hypot(point["residual_y"].to_numpy(), point["residual_z"].to_numpy())
    rows, spots = np.nonzero(deviation > LARGEST_DEVIATION)
    worst = np.argsort(-deviation[rows, spots], kind="stable")[:_LISTED]
    advice = "Check them; the robust loss reduces their effect on the estimates (spot_deviation)"
    if (result["loss"] == "squared").any():
        remedy = "Check them, give them the weight 0 or set 'calibration.loss: huber'"
        advice = f"{remedy} (spot_deviation, calibration_status {DISAGREE})"
    listed = [
        f"{names[row]} {f'spot {spot}' if np.isnat(time[row, spot]) else f'{time[row, spot]:.16}Z'} "
        f"({distance[row, spot]:.2g} m)".replace("T", " ")
        for row, spot in zip(rows[worst], spots[worst], strict=True)
    ]
    yield (
        rows.size,
        f"{rows.size:,} spots of {len(set(rows.tolist())):,} heliostats are more than {LARGEST_DEVIATION:g} robust "
        "standard deviations from the prediction by the other spots: "
        f"{', '.join(listed)}{', ...' * (rows.size > _LISTED)}. {advice}",
    )
