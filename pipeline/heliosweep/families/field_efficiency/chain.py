"""From the light that a heliostat sends to the light that its receiver takes: intercept, air and mirrors."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.families.field_efficiency.optics import KEYS
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


def _receiver(kind: str, height: float, values: Mapping[str, Any]) -> Receiver:
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


class Light(NamedTuple):
    """Parts of the light of each heliostat that are left."""

    intercept: Floats
    """At the receiver, shape (N, T); NaN with the sun down. [1]"""
    transmitted: Floats
    """By the air, shape (N,). [1]"""
    reflected: Floats
    """By the mirror: reflectivity times cleanliness, shape (N,). [1]"""


def light(
    study: FieldEfficiencyStudy,
    mirrors: tuple[Any, ...],
    radius: float,
    sun: Floats,
    latitude: float | None,
    given: Sequence[Any],
    start: int,
    stop: int,
) -> Light:
    """Parts of the light of heliostats start..stop that are left.

    Parameters
    ----------
    study : FieldEfficiencyStudy
        Study with `optics`.
    mirrors : tuple
        Centres x, y, z of all mirrors, half their width and height, height of the receiver's centre [m], and code of
        the tracking method: the first arguments of `field_sums`.
    radius : float
        Radius of a cylinder, else 0. [m]
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun. [1]
    latitude : float or None
        Of the place [deg]; None where the sun belongs to no place.
    given : sequence
        Values of `optics.KEYS`.
    start, stop : int
        First heliostat, and the one after the last.
    """
    values = {key.rpartition(".")[2]: value for key, value in zip(KEYS, given, strict=True)}
    centre = np.stack(mirrors[:3], axis=1)[start:stop]
    sides = 2.0 * np.stack(mirrors[3:5], axis=1)[start:stop]
    target = np.array(np.broadcast_to(targets(centre.T, mirrors[5], radius), centre.shape))
    slant = np.sqrt(np.sum((target - centre) ** 2, axis=1))
    receiver, grid = _receiver(str(study.receiver.kind), mirrors[5], values), study.heliostat.facets
    focus = values["focus"] if values["focus"] is not None else "flat"
    flat = np.zeros(len(slant))
    curve = flat if focus == "flat" else 0.5 / (slant if focus == "slant" else flat + float(focus))
    kind, ratio = values["kind"], values["circumsolar_ratio"] if values["kind"] == "buie" else None
    errors = _errors(values)
    if values["method"] == "gaussian":
        intercept = hflcal.intercepts(centre, target, sides, curve, _sun(kind, ratio).spread, errors, receiver, sun)
    else:
        tables, blurred = _tables(kind, ratio, errors)
        cant = 0.5 / slant if grid is not None and grid.canting == "on_axis" else flat
        facets = Facets(1, 1, 0.0) if grid is None else Facets(grid.columns, grid.rows, float(grid.gap))
        turn = np.zeros((len(slant), 2))
        scene = Scene(centre, target, sides, curve, cant, turn, facets, mirrors[6], blurred, receiver, tables)
        intercept = course(scene, sun, None if latitude is None else math.radians(latitude))
    reflected = flat + values["reflectivity"] * values["cleanliness"]
    return Light(intercept, transmittance(values["attenuation"], slant), reflected)
