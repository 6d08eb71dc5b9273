"""From the light that a heliostat sends to the light that its receiver takes: intercept, air and mirrors."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.field.efficiency import targets
from heliosweep.kernels.intercept import hflcal, sunshapes
from heliosweep.kernels.intercept.course import course
from heliosweep.kernels.intercept.efficiency import Receiver, Scene, cylinder, rectangle, sun_tables
from heliosweep.kernels.intercept.mirror import Errors, Facets
from heliosweep.kernels.intercept.tables import Tables

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy

Floats = NDArray[np.float64]

#: Transmittance over a slant range in km, with the coefficients of each formula.
_FORMULAS: dict[str, Callable[[Floats], Floats]] = {
    "none": np.ones_like,
    "delsol_clear": lambda r: 1 - (0.006789 + 0.1046 * r - 0.017 * r**2 + 0.002845 * r**3),
    "delsol_hazy": lambda r: 1 - (0.01293 + 0.2748 * r - 0.03394 * r**2),
    "leary_hankins": lambda r: np.where(r <= 1, 0.99321 - 0.1176 * r + 0.0197 * r**2, np.exp(-0.1106 * r)),
    "ballestrin_clear": lambda r: 1 - (0.29544 + 15.22128 * r - 1.8598 * r**2 + 0.15182 * r**3) / 100,
    "ballestrin_hazy": lambda r: 1 - (0.77941 + 55.49083 * r - 14.78875 * r**2 + 1.53718 * r**3) / 100,
}
#: Slant range up to which these hold. [m]
FARTHEST = 3000.0


def transmittance(model: str, slant: Floats) -> Floats:
    """Part of the light that passes the air between mirror and receiver.

    Parameters
    ----------
    model : str
        One of `optics.ATTENUATION`: the polynomials of DELSOL3 (Kistler 1986), of Leary and Hankins (1979) and of
        Ballestrin and Marzo (2012).
    slant : ndarray
        Slant range. [m]

    Returns
    -------
    ndarray
        Between 0 and 1. [1]
    """
    return np.clip(_FORMULAS[model](slant / 1000), 0.0, 1.0)


def receiver_of(kind: str, height: float, values: Mapping[str, Any]) -> Receiver:
    """Receiver of the kernels at a point of the result."""
    centre = (0.0, 0.0, float(height))
    if kind == "cylinder":
        return cylinder(centre, float(values["radius"]), float(values["height_extent"]))
    azimuth, tilt = (math.radians(values[key] or 0.0) for key in ("azimuth", "tilt"))
    return rectangle(centre, azimuth, tilt, float(values["width"]), float(values["height_extent"]))


@lru_cache(16)
def _sun(kind: str, ratio: float | None) -> sunshapes.SunShape:
    if kind == "buie":
        assert ratio is not None
        return sunshapes.buie(ratio)
    made: sunshapes.SunShape = getattr(sunshapes, kind)()
    return made


@lru_cache(4)
def _tables(kind: str, ratio: float | None, errors: Errors) -> tuple[Tables, Errors]:
    return sun_tables(_sun(kind, ratio), errors)


def _errors(values: Mapping[str, Any]) -> Errors:
    both = values["slope_error"]
    slopes = (both if both is not None else values[f"slope_error_{axis}"] for axis in ("horizontal", "vertical"))
    u, v = (1e-3 * math.hypot(slope, values["tracking_error"]) for slope in slopes)
    return Errors(u, v, 1e-3 * float(values["specularity_error"]))


def light(
    study: FieldEfficiencyStudy,
    centre: Floats,
    sides: Floats,
    height: float,
    tracking: int,
    values: Mapping[str, Any],
    sun: Floats,
    latitude: float | None,
) -> tuple[Floats, Floats, float]:
    """Parts of the light that are left: at the receiver, by the air, and by the mirrors.

    Parameters
    ----------
    study : FieldEfficiencyStudy
        Study with `optics`.
    centre, sides : ndarray, shape (N, 3) and (N, 2)
        Centres of the mirrors; their width and height. [m]
    height : float
        Height of the receiver's centre. [m]
    tracking : int
        Code of the tracking method.
    values : mapping
        Values of `optics.KEYS`.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun. [1]
    latitude : float or None
        Of the place [deg]; None where the sun belongs to no place.

    Returns
    -------
    intercept : ndarray, shape (N, T)
        NaN with the sun down. [1]
    transmitted : ndarray, shape (N,)
        Of the air. [1]
    reflected : float
        Reflectivity times cleanliness. [1]
    """
    target = np.broadcast_to(targets(centre.T, height, values["radius"] or 0.0), centre.shape)
    slant = np.sqrt(np.sum((target - centre) ** 2, axis=1))
    receiver, grid = receiver_of(str(study.receiver.kind), height, values), study.heliostat.facets
    focus = values["focus"] if values["focus"] is not None else "flat"
    curve = np.zeros(len(slant)) if focus == "flat" else 0.5 / (slant if focus == "slant" else np.full(len(slant), focus))
    kind, ratio = values["kind"], values["circumsolar_ratio"] if values["kind"] == "buie" else None
    errors = _errors(values)
    if values["method"] == "gaussian":
        spread = _sun(kind, ratio).spread
        intercept = hflcal.intercepts(centre, target, sides, curve, spread, errors, receiver, sun)
    else:
        tables, blurred = _tables(kind, ratio, errors)
        cant = 0.5 / slant if grid is not None and grid.canting == "on_axis" else np.zeros(len(slant))
        facets = Facets(1, 1, 0.0) if grid is None else Facets(grid.columns, grid.rows, float(grid.gap))
        turn = np.zeros((len(slant), 2))
        scene = Scene(centre, target, sides, curve, cant, turn, facets, tracking, blurred, receiver, tables)
        intercept = course(scene, sun, None if latitude is None else math.radians(latitude))
    return intercept, transmittance(values["attenuation"], slant), values["reflectivity"] * values["cleanliness"]
