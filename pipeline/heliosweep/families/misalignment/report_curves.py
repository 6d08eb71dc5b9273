"""Figures of spots on the receiver plane, after Figures 4, 5, 7 and 8 of the paper."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import xarray as xr

from heliosweep.families.misalignment import report_views as views
from heliosweep.families.misalignment import report_words as wording
from heliosweep.families.misalignment.report_conics import conic_curve, other_focus
from heliosweep.families.misalignment.report_views import AXES, HELIOSTAT, HOUR, Point, at, needs
from heliosweep.families.registry import NamedFigure
from heliosweep.report.labels import MINUS, number_text
from heliosweep.report.planes import cut, plane_figure
from heliosweep.report.shapes import Look, Plane, Scale, Track

AXIS, SIZE = "axis", "error_size"

#: Dimensions of errors.
ERRORS = (SIZE, *views.MOUNT_ERRORS)

#: Hours of which curves are drawn; sizes of error of which drifts are drawn.
MOST_HOURS, MOST_SIZES = 3, 7

#: Letters of a title abreast, in two and in three columns.
TITLES = (52, 34)

#: Range of errors from which on a curve is more than a line. [mrad]
CURVED = 200.0

#: What is drawn of a conic.
PARTS = ("conic", "traced", "focus", "other focus")

#: Sizes of error from which on there are curves.
LEAST_SIZES = 3

#: Hours from which on there is a drift.
LEAST_HOURS = 3

NBSP = "\N{NO-BREAK SPACE}"

_AIM, _TARGET, _DETECTOR, _CROSSING = "no error", "aim", "line of detectors", "crossing"
_LOOKS = {
    _AIM: Look("#000000", "", "+", size=6),
    _TARGET: Look("#000000", "", "+", size=6),
    _DETECTOR: Look("#777777", (0, (6, 1.5, 1, 1.5)), width=0.9),
    _CROSSING: Look("#000000", "", "x", size=3.6),
}
_PATH, _ALONE = Look("#9a9a9a", "-", "o", width=0.7, size=3.4, text="#222222"), Look("#333333", "-", "o")
_ZERO = np.zeros(1)


def figures(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Figures of the spots of the mode `curves`.

    Parameters
    ----------
    result : xarray.Dataset
        The result.

    Yields
    ------
    NamedFigure
    """
    for draw in (deviation_curves, spot_drift, _conics):
        yield from draw(result)


def error_dim(result: xr.Dataset) -> str | None:
    """Dimension of the size of an error."""
    dims = views.numbers(result, views.swept(result, "spot_y"))
    return next((dim for dim in ERRORS if dim in dims), None)


@needs("spot_y", "spot_z")
def deviation_curves(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Curves on the receiver plane over the error, a panel for each heliostat, a line for each hour."""
    error = error_dim(result)
    if error is None or HELIOSTAT not in result["spot_y"].dims or result.sizes[error] < LEAST_SIZES:
        return
    day = views.day_of(result)
    axis = AXIS if AXIS in result["spot_y"].dims else None
    others = views.numbers(result, views.swept(result, "spot_y", axis, *ERRORS))
    line = next((dim for dim in (HOUR, day, *others) if views.several(result, dim)), None)
    stands = views.fixed(result, "spot_y", error, line, axis, HELIOSTAT)
    shown, lines, axes = (
        views.heliostats(result, "spot_y", stands),
        views.chosen(result, line, MOST_HOURS, at(result["spot_y"], stands)),
        axes_of(result, axis),
    )
    order = views.ordered(result, error)
    planes = []
    for one in shown:
        tracks = [_aim(result), *_detectors(result)]
        for name, axis_point in axes:
            for hour in lines:
                y, z = _spots(result, stands, one, axis_point, hour)
                text = wording.short(result, line, hour[line]) if line and views.several(result, line) else ""
                tracks.append(Track(y[order], z[order], name, text=text))
                tracks += _crossings(result, stands, one, axis_point, hour)
        planes.append(
            Plane(wording.heliostat_text(result, {**stands, **one}), tracks, (), views.aperture(result, stands))
        )
    if not _any(planes):
        return
    values = np.sort(result[error].to_numpy())
    unit = wording.label(result, error)
    ends = " to ".join(number_text(float(value), 1).removesuffix(".0") for value in (values[0], values[-1]))
    what = f"each line for the {wording.title(result, line)} at its positive end" if line else "each line one instant"
    caption = (
        f"Where the beam meets the receiver plane while the {unit} runs from {ends}: {what}; "
        f"{wording.seen(result)}. {_seen(planes)}"
    )
    held = {dim: index for dim, index in stands.items() if dim != SIZE}
    caption += wording.note(result, held, (HELIOSTAT, shown), (line, lines))
    looks = {**{name: _look(name) for name, _ in axes}, **_LOOKS}
    words = wording.around(result, legend="axis of the error" if axis else "", silent=("",))
    yield NamedFigure("deviation_curves", caption.replace("  ", " "), plane_figure(planes, looks, words=words))


@needs("spot_y", "spot_z")
def spot_drift(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Spots over the day, coloured by the hour, for some sizes of the error; a figure for each axis of it."""
    if HELIOSTAT not in result["spot_y"].dims or result.sizes.get(HOUR, 1) < LEAST_HOURS:
        return
    error, axis = error_dim(result), AXIS if AXIS in result["spot_y"].dims else None
    stands = views.fixed(result, "spot_y", error, HOUR, axis, HELIOSTAT)
    shown, sizes = views.heliostats(result, "spot_y", stands), views.chosen(result, error, MOST_SIZES)
    if error == SIZE:
        sizes = [size for size in sizes if float(result[error].isel(size))] or sizes  # without error: the aim
    order = views.ordered(result, HOUR)
    hours = result[HOUR].to_numpy().astype(float)[order]
    for name, axis_point in axes_of(result, axis):
        planes = []
        for one in shown:
            tracks = [_aim(result)]
            for size in sizes:
                y, z = (values[order] for values in _spots(result, stands, one, axis_point, size))
                text = _size_text(result, error, size)
                tracks.append(Track(y, z, "", numbers=hours, text=text))
            title = wording.heliostat_text(result, {**stands, **one})
            planes.append(Plane(title, tracks, (), views.aperture(result, stands)))
        if not _any(planes):
            continue
        of = f"an error about the {name} axis" if axis else "the errors"
        written = f", each line for the {wording.label(result, error)} at its end" if error else ""
        caption = f"Drift of the spot with {of} over the day{written}; {wording.seen(result)}. {_seen(planes)}"
        caption += wording.note(result, {**stands, **axis_point}, (HELIOSTAT, shown), (error, sizes))
        scale = Scale(wording.label(result, HOUR), *_ends(planes))
        figure = plane_figure(planes, {"": _PATH, **_LOOKS}, words=wording.around(result, silent=("",)), scale=scale)
        suffix = f"_{name.replace('-', '_')}" if axis and result.sizes[axis] > 1 else ""
        yield NamedFigure(f"spot_drift{suffix}", caption.replace("  ", " "), figure)


@needs("conic", "eccentricity", "focus_y", "focus_z")
def _conics(result: xr.Dataset) -> Iterator[NamedFigure]:
    """Whole conics with their foci, and the part that was traced; a panel for each heliostat and sun."""
    spots = {"spot_y", "spot_z"} <= set(result.data_vars) and SIZE in result["spot_y"].dims
    axis = AXIS if AXIS in result["conic"].dims else None
    suns = [
        dim for dim in (*views.swept(result, "conic", axis), views.day_of(result), HOUR) if dim in result["conic"].dims
    ]
    run = next((dim for dim in suns if dim.startswith("sun_") and views.several(result, dim)), None)
    if HELIOSTAT not in result["conic"].dims or result.sizes[HELIOSTAT] > views.MOST_PANELS:
        return
    if SIZE in result.coords and result[SIZE].ndim and np.ptp(result[SIZE].to_numpy()) < CURVED:
        return
    stands = views.fixed(result, "conic", run, axis, HELIOSTAT, "conic_coefficient")
    each = views.heliostats(result, "conic", stands)
    if not each:
        return
    moments = views.chosen(result, run, max(1, views.MOST_PANELS // len(each)))
    axes = axes_of(result, axis)
    looks = {_part_name(name, part): _part(name, part) for name, _ in axes for part in PARTS}
    planes = []
    for one in each:
        for moment in moments:
            tracks, shapes = [], []
            for name, axis_point in axes:
                points = (stands, one, moment, axis_point)
                about = f" ({name})" if name else ""
                coefficients = at(result["conic"], *points).to_numpy()
                if coefficients.shape != (6,) or not np.isfinite(coefficients).all():
                    continue
                focus = np.array([float(at(result[which], *points)) for which in ("focus_y", "focus_z")])
                other = other_focus(coefficients, focus)
                tracks.append(Track(*conic_curve(coefficients), _part_name(name, "conic"), framed=False))
                if spots:
                    order = views.ordered(result, SIZE)
                    y, z = (at(result[f"spot_{side}"], *points).to_numpy()[order] for side in "yz")
                    tracks.append(Track(y, z, _part_name(name, "traced")))
                tracks.append(Track(focus[:1], focus[1:], _part_name(name, "focus")))
                tracks.append(Track(other[:1], other[1:], _part_name(name, "other focus"), framed=False))
                shapes.append(f"{float(at(result['eccentricity'], *points)):.5g}{about}".replace(" ", NBSP))
            if tracks:
                where = wording.heliostat_text(result, {**stands, **one})
                sun = f"{run.replace('_', ' ')} {wording.short(result, run, moment[run])}" if run else ""
                wide = TITLES[len(each) * len(moments) > 4]
                shape = textwrap.wrap(f"e = {', '.join(shapes)}".replace("= ", f"={NBSP}"), wide)
                title = "\n".join(filter(None, [where, sun, *shape]))
                planes.append(Plane(title, [*tracks, _aim(result)], (), views.aperture(result, stands)))
    if not planes:
        return
    caption = (
        "Conics that a mirror's rays trace on the receiver plane as it turns about each axis: thick where the errors "
        "of the study are, dotted beyond, on both branches; full diamonds: focus of the branch of the "
        "rays; e: eccentricity. "
        f"{wording.seen(result).capitalize()}. {_seen(planes)}"
    )
    caption += wording.note(result, stands, (run, moments))
    said = [_part_name(name, "traced" if spots else "conic") for name, _ in axes]
    words = wording.around(result, silent=[name for name in looks if name not in said])
    figure = plane_figure(planes, {**looks, **_LOOKS}, words=words, columns=3 if len(each) * len(moments) > 4 else 2)
    yield NamedFigure("conics", caption.replace("  ", " "), figure)


def axes_of(result: xr.Dataset, axis: str | None) -> list[tuple[str, Point]]:
    """Axes of the error by name, in the order of their looks; one without a name where there are none."""
    if axis is None:
        name = _hyphened(result[AXIS].item()) if AXIS in result.coords and not result[AXIS].ndim else ""
        return [(name, {})]
    names = [_hyphened(name) for name in result[axis].to_numpy()]
    known = {name: {axis: index} for index, name in enumerate(names)}
    return sorted(known.items(), key=lambda item: list(AXES).index(item[0]) if item[0] in AXES else len(AXES))


def _hyphened(name: object) -> str:
    return str(name).replace("_", "-")


def _look(name: str) -> Look:
    return AXES.get(name, _ALONE if name else Look("#0072B2"))


def _part_name(name: str, part: str) -> str:
    axis = f"{name} axis".strip() if name else "curve"
    return axis if part == "traced" else f"{axis}: {part}"


def _part(name: str, part: str) -> Look:
    colour = _look(name).colour
    parts = {
        "conic": Look(colour, (0, (1, 1.4)), width=0.9),
        "traced": Look(colour, "-", width=2.0),
        "focus": Look(colour, "", "D", size=4.2),
        "other focus": Look(colour, "", "D", size=4.2, open=True),
    }
    return parts[part]


def _spots(result: xr.Dataset, *points: Point) -> tuple[np.ndarray, np.ndarray]:
    """Spots along the one dimension that the points leave. [m]"""
    y, z = (at(result[f"spot_{side}"], *points).to_numpy().astype(float) for side in "yz")
    return np.atleast_1d(y), np.atleast_1d(z)


def _aim(result: xr.Dataset) -> Track:
    return Track(_ZERO, _ZERO, _AIM if "tolerance" in result or SIZE in result.coords else _TARGET)


def _detectors(result: xr.Dataset) -> Iterator[Track]:
    """Lines of detectors, longer than any panel."""
    if not {"l0", "l1", "l2"} <= set(result.coords):
        return
    for across, up, offset in zip(
        *(np.atleast_1d(result[name].to_numpy()) for name in ("l0", "l1", "l2")), strict=True
    ):
        normal = np.array([across, up]) / np.hypot(across, up)
        foot, along = normal * offset / np.hypot(across, up), normal[::-1] * [-1e3, 1e3]
        ends = np.stack([foot - along, foot + along])
        yield Track(ends[:, 0], ends[:, 1], _DETECTOR, framed=False)


def _crossings(result: xr.Dataset, *points: Point) -> Iterable[Track]:
    if {"crossing_y", "crossing_z"} <= set(result.data_vars):
        y, z = (at(result[f"crossing_{side}"], *points) for side in "yz")
        if y.ndim == 1:
            yield Track(y.to_numpy(), z.to_numpy(), _CROSSING, framed=False)


def _size_text(result: xr.Dataset, error: str | None, point: Point) -> str:
    if error is None or not views.several(result, error):
        return ""
    value = float(result[error].isel(point))
    return f"{value:+g}".replace("-", MINUS) if value else "0"


def _any(planes: Sequence[Plane]) -> bool:
    """Whether there is anything but the aim."""
    return any(
        np.isfinite(track.x).any()
        for plane in planes
        for track in plane.tracks
        if track.framed and track.name not in (_AIM, _TARGET)
    )


def _seen(planes: Sequence[Plane]) -> str:
    out = cut(planes)
    return f"{out} far points lie outside of the panels." if out else ""


def _ends(planes: Sequence[Plane]) -> tuple[float, float]:
    """First and last hour of all spots."""
    tracks = [track for plane in planes for track in plane.tracks if track.numbers is not None]
    hours = np.concatenate([track.numbers[np.isfinite(track.x)] for track in tracks if track.numbers is not None])
    return float(hours.min()), float(hours.max())
