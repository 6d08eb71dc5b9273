"""Aim points under a flux limit: checks of the study, variables, and fields with these aim points."""

from __future__ import annotations

import json
import pickle
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from heliosweep.aiming import RAYS, VARIABLES, aim_grid, image_bytes, limited_aims, targets
from heliosweep.config import SunDirections
from heliosweep.errors import StudyError
from heliosweep.families.field_efficiency.flux import DIMS, IRRADIANCE, cells_of, has_instant, is_limited, varies
from heliosweep.families.field_efficiency.traced import TracedField
from heliosweep.grid.sun import instant_count
from heliosweep.kernels import rays
from heliosweep.kernels.compiled import Floats

if TYPE_CHECKING:
    import xarray as xr

    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
    from heliosweep.families.field_efficiency.values import Field, Hours
    from heliosweep.families.points import Point

#: Maximum number of instants for which aim points can be chosen separately.
MOST_INSTANTS = 100


def limit_rules(study: FieldEfficiencyStudy) -> Iterator[tuple[object, str, str]]:
    """Yield the rules for a flux limit: the condition for a fault, the key and the message."""
    instants, shown = instant_count(study.time), study.output.flux_map
    some = isinstance(study.time, SunDirections) or study.design_point or instants > MOST_INSTANTS
    yield (
        is_limited(study) and not varies(study) and not has_instant(study), "aim",
        "requires an instant at which the flux is limited: add 'design_point', or set 'at: instants'",
    )  # fmt: skip
    yield (
        varies(study) and some, "aim.at",
        f"is for times at a site without 'design_point', at most {MOST_INSTANTS} (got {instants:,}): remove it",
    )  # fmt: skip
    yield (
        is_limited(study) and shown and (shown.rows, shown.columns) != cells_of(study), "output.flux_map",
        f"must have the cells of the limit, {' x '.join(map(str, cells_of(study) or ()))}: set 'aim.flux_rows' and "
        "'aim.flux_columns' to its rows and columns",
    )  # fmt: skip


def images(study: FieldEfficiencyStudy, heliostats: int, instants: int) -> tuple[float, int]:
    """Return the number of rays per heliostat for images at all instants, and the memory for the images. [1, bytes]"""
    if study.aim is None or not is_limited(study):
        return 0.0, 0
    aims, kind = study.aim.rows * study.aim.columns, rays.CYLINDER if study.receiver.kind == "cylinder" else 0
    size = image_bytes(kind, heliostats, aims, (study.aim.flux_rows, study.aim.flux_columns), RAYS)
    return float(aims * RAYS * (instants if varies(study) else 1)), size


def limited(point: Point, field: Field | TracedField, sun: Floats, hours: Hours | None) -> Field | TracedField:
    """Return the field with aim points under its flux limit, if any, for the design point or for each instant.

    Raises
    ------
    StudyError
        If the flux of a single heliostat exceeds the limit.
    """
    study, aim, design = field.study, field.study.aim, field.study.design_point
    if not isinstance(field, TracedField) or aim is None or not is_limited(study):
        return field
    months = field.months
    dni = np.full(len(sun), IRRADIANCE)
    if design is not None and field.place[0] is not None:
        sun, dni, months = design.sun(field.place[0]), np.array([design.dni]), np.array([design.month()])
    elif hours is not None:
        dni, months = hours.dni, hours.month
    share = np.multiply.outer(1e-3 * dni * field.way.reflected(months, len(sun)), field.share)
    limit = np.full((aim.flux_rows, aim.flux_columns), point["aim.limit"])
    for row, value in aim.limits or ():
        limit[int(row)] = value
    scene, span = field.scene, np.radians(aim.azimuth_span)
    points = aim_grid(scene.receiver, scene.centre, aim.rows, aim.columns, span)
    seed = 0 if study.optics is None else study.optics.seed

    def chosen() -> dict[str, Floats]:
        found = dict[str, Any]()
        sizes = {"heliostat": len(scene.centre), "flux_row": aim.flux_rows, "flux_column": aim.flux_columns}
        for k in np.flatnonzero((sun[:, 2] > 0.0) & (dni > 0.0)):
            try:
                values = limited_aims(
                    scene, sun[k : k + 1], points, aim.safety * limit, share[k], seed=seed, threads=field.threads
                )
            except ValueError as error:
                raise StudyError(study.problem("aim.limit", f"{error}; increase it")) from None
            for name, (dims, *_) in VARIABLES.items():
                found.setdefault(name, np.full((len(sun), *(sizes[dim] for dim in dims)), np.nan))[k] = values[name]
        return found

    key = pickle.dumps((scene, sun, share, limit))
    return with_aims(field, field.way.inputs.last("aims", key, chosen))


def with_aims(field: TracedField, aims: Mapping[str, Floats]) -> TracedField:
    """Return a field with other aim points. `aims` contains the values of `VARIABLES`, for one or for all instants."""
    if not aims:
        return field
    field = field._replace(aims=aims)
    target = targets(field.scene, np.stack([aims[f"aim_{axis}"] for axis in "xyz"], axis=-1))
    if varies(field.study):
        return field._replace(targets=target)
    mirrors = (*field.mirrors[:5], target[0], field.mirrors[6])
    return field._replace(mirrors=mirrors, scene=field.scene._replace(target=target[0]))


def draw_aims(result: xr.Dataset) -> Any:
    """Draw flux maps with the aim points for some points of the sweep."""
    from matplotlib import colormaps
    from matplotlib.colors import Normalize

    from heliosweep.report.context import Context, at
    from heliosweep.report.draw import VALUES, colour_bar, panels

    context, flux = Context(result), result["aimed_flux_map"]
    if flux["flux_row"].attrs["units"] == "1" or flux["flux_column"].attrs["units"] == "1":
        return None
    dim = next((str(dim) for dim in flux.dims if dim not in DIMS and flux.sizes[dim] > 1), None)
    fixed, points = context.fixed(flux, *DIMS, dim), context.chosen(dim, 4)
    norm, aim = Normalize(0.0, float(flux.max())), json.loads(result.attrs["study"])["aim"]
    drawing, grid = panels(len(points), 2, 0.5, layout="compressed", sharex=True, sharey=True)
    for axes, point in zip(grid, points, strict=False):
        axes.pcolormesh(flux["flux_column"], flux["flux_row"], at(flux, fixed, point), norm=norm, cmap=VALUES)
        number, east, north = (at(result[name], fixed, point).to_numpy() for name in ("aim", "aim_x", "aim_y"))
        up = float(at(result["height_extent"], fixed, point)) * ((number // aim["columns"] + 0.5) / aim["rows"] - 0.5)
        across = np.degrees(np.arctan2(east, north)) % 360.0
        if "receiver_width" in result.coords:
            right = (number % aim["columns"] + 0.5) / aim["columns"] - 0.5
            across = float(at(result["receiver_width"], fixed, point)) * right
        axes.plot(np.where(number < 0.0, np.nan, across), up, ".", color="white", markersize=2)
        axes.set(title=context.fulls(point), xlabel=context.label("flux_column"), ylabel=context.label("flux_row"))
    colour_bar(drawing, grid, norm, colormaps[VALUES], "neither", "flux on the receiver (kW m-2)")
    return drawing, context.note(fixed)
