"""Flux on the receiver of a field: power or energy on each cell, its peak and mean, and the share above a limit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from heliosweep.families.field_efficiency.chain import Light
from heliosweep.families.field_efficiency.energy import Hours
from heliosweep.families.field_efficiency.flux import IRRADIANCE, NODES, flux_sizes, has_instant
from heliosweep.families.field_efficiency.values import Field
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.field import efficiency
from heliosweep.kernels.intercept import flux, hflcal


class FluxSums:
    """Flux maps of a field at a point of the result, from its heliostats, block by block.

    Parameters
    ----------
    field : Field
        Of a study that may ask for flux maps.
    sun : ndarray, shape (T, 3), or Hours
        Unit vectors to the sun [1], or all that the instants bring.
    """

    def __init__(self, field: Field, sun: Floats | Hours) -> None:
        self._field = field
        self._sun: Any = sun
        self._sizes = tuple(flux_sizes(field.study).values())
        self._maps: dict[str, Floats] = {}

    def add(self, values: Mapping[str, Floats], lit: Light | None, start: int, stop: int) -> None:
        """Add heliostats start..stop, of which values at the design point or the only instant are known.

        With weather, `lit` is what is left of their light at all instants.
        """
        study, area = self._field.study, self._field.area[start:stop]
        if not self._sizes:
            return
        if has_instant(study):
            point, latitude = study.design_point, self._field.place[0]
            sun = self._sun if isinstance(self._sun, np.ndarray) else self._sun.sun
            if point is not None and latitude is not None:
                sun = point.sun(latitude)
            prefix, dni = ("", IRRADIANCE) if point is None else ("design_point_", point.dni)
            optical, intercept, air, mirror = (
                values[f"{prefix}{name}_efficiency"] for name in ("optical", "intercept", "attenuation", "reflection")
            )
            power = 1e-3 * dni * area * optical * air * mirror
            self._add("flux_map", sun, power[:, np.newaxis], intercept[:, np.newaxis], start, stop)
        if lit is not None:
            self._add("energy_flux_map", *self._energies(lit, start, stop), start, stop)

    def _add(self, name: str, sun: Floats, sent: Floats, intercept: Floats, start: int, stop: int) -> None:
        """Add the light on the cells to one of the maps."""
        way = self._field.way
        assert way is not None
        scene = way.scene(self._field.mirrors, start, stop)
        if way.values["method"] == "gaussian":
            made = hflcal.cells(scene, way.inputs.sun_of(way.values).spread, sun, sent, intercept, *self._sizes[::-1])
        else:
            made = flux.cells(scene, sun, sent, intercept, *self._sizes[::-1])
        if len(sun) == 1 and not sun[0, 2] > 0.0:
            made[:] = np.nan
        self._maps[name] = self._maps.get(name, 0.0) + made

    def _energies(self, lit: Light, start: int, stop: int) -> tuple[Floats, Floats, Floats]:
        """Directions of the sun, energies on the receiver from each, and ones: the arguments of `_add`. [MWh]

        Of many instants, each energy is shared among the nodes of an interpolation in the direction of the sun, with
        weights that add up to 1: the cells add up to the energy of the heliostat, and where it goes is interpolated.
        """
        field, hours = self._field, self._sun
        optical = efficiency.field_series(*field.sorted, hours.sun, start, stop)[3].T
        weight = np.outer(field.area[start:stop] * lit.transmitted, hours.weight * lit.reflected)
        energy = np.nan_to_num(weight * optical * lit.intercept)
        place = None if field.place[0] is None else math.radians(field.place[0])
        nodes = flux.sun_nodes(hours.sun, place, NODES)
        if nodes is None:
            return hours.sun, energy, np.ones_like(energy)
        directions, share = nodes
        return directions, energy @ share, np.ones((stop - start, len(directions)))

    def values(self) -> dict[str, Any]:
        """Maps and what is told of them, by the names of variables; NaN with the sun down."""
        study, way, found = self._field.study, self._field.way, dict[str, Any]()
        if way is None or not self._maps:
            return found
        values = way.values
        around = 2.0 * math.pi * values["radius"] if study.receiver.kind == "cylinder" else values["width"]
        for name, made in self._maps.items():
            found[name] = made * (made.size / (around * values["height_extent"]))
        cells, wanted = found.get("flux_map", np.empty(0)), study.output.flux_map
        if cells.size:
            found |= {"peak_flux": cells.max(), "mean_flux": cells.mean()}
            if wanted is not None and wanted.limit is not None:
                found["power_above_limit"] = cells[cells > wanted.limit].sum() / (cells.sum() or np.nan)
        return found
