"""Heliostat and field values for a field with optics, computed by ray tracing.

Every ray starts at a point on a mirror. Other mirrors may shade this point, or block the reflected ray. The reflected
ray then hits or misses the receiver. See `heliosweep.kernels.rays`.
"""

from __future__ import annotations

import pickle
import threading
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config import WeatherTime
from heliosweep.families.field_efficiency.chain import Geometry, Way
from heliosweep.families.field_efficiency.flux import IRRADIANCE, flux_cells
from heliosweep.families.field_efficiency.heat import has_heat
from heliosweep.families.field_efficiency.losses import Available, budget_cases
from heliosweep.families.field_efficiency.values import Hours, Values, chain_of_energies, powers
from heliosweep.families.field_efficiency.variables import (
    EFFICIENCIES,
    LIGHT,
    MONTHS,
)
from heliosweep.grid.sun import instant_count
from heliosweep.kernels import rays
from heliosweep.kernels.compiled import Floats

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy

#: Default relative standard error of the field's energy for ordinary results and for draws. [1]
PRECISION, DRAWN_PRECISION = 1e-4, 2e-3
#: Number of rays per heliostat and instant in draws. Relative standard deviation of the light among all heliostats
#: and instants. Fraction of instants with the sun up. [1]
DRAWN_RAYS, SCATTER, LIT = 16, 0.16, 0.3
#: Efficiencies that vary with time.
_OF_INSTANTS = (*EFFICIENCIES, LIGHT[0], LIGHT[-1])
#: Maximum number of heliostats times groups of instants for which the next point reuses ray sums.
SHARED = 2**13
#: Number of heliostats times instants for which ray sums are held in memory together. Maximum number of instants for
#: which ray sums are kept for time series.
PAIRS, KEPT_INSTANTS = 2**15, 2**15


def usual_rays(study: FieldEfficiencyStudy, heliostats: int, instants: int) -> float:
    """Return the expected mean number of rays per heliostat and instant, including night instants without rays."""
    optics: Any = study.optics
    lit = LIT if isinstance(study.time, WeatherTime) else 1.0
    if optics.rays is not None:
        return lit * optics.rays
    if study.sample is not None and not flux_cells(study) and (step := drawn_step(optics, heliostats * instants)) > 1:
        return lit * DRAWN_RAYS / step
    finer = (PRECISION / (optics.precision or PRECISION)) ** (1.0 / 0.7)
    # A year usually needs 64 rays. Fewer than 2440 instants need more rays, and a flux map needs twice as many.
    wanted = 64 * max(1.0, 2440 / (lit * instants)) ** 0.8 * (2 if flux_cells(study) else 1) * finer
    return lit * min(max(DRAWN_RAYS, wanted), rays.MOST)


def is_series_traced(study: FieldEfficiencyStudy) -> bool:
    """Return True if the time series and the means of the field use the same rays."""
    output, few = study.output, instant_count(study.time) <= KEPT_INSTANTS
    return few and study.optics is not None and output.field_series and not output.time_series


def drawn_step(optics: Any, pairs: int) -> int:
    """Return the step between the traced instants of a heliostat in a draw.

    With each possible step, all hours of the day are sampled.
    """
    if optics.rays is not None:
        return 1
    wanted = pairs * LIT * ((optics.precision or DRAWN_PRECISION) / SCATTER) ** 2
    return max(step for step in (1, 5, 7, 11, 23, 47, 71) if step <= max(1.0, wanted))


class TracedField(NamedTuple):
    """A field with optics at a point of the result, with the methods of `values.Field`."""

    study: Any
    #: Mirror centres (x, y, z), half widths, half heights and aim points, all in m, and the code of the tracking
    #: method.
    mirrors: Geometry
    way: Way
    scene: rays.Scene
    #: Area of each mirror. [m2]
    area: Floats
    #: Transmittance of the air for each heliostat. [1]
    transmitted: Floats
    #: Reflectivity times cleanliness of each heliostat. [1]
    reflection: Floats
    #: Values of `grid.sun.PLACE`.
    place: Sequence[Any]
    #: Month of each instant, counted from 0, if cleanliness depends on the month.
    months: NDArray[np.int64] | None
    #: Index of the point in the result.
    key: tuple[int, ...]
    threads: int = 1
    #: Factor by which the standard error may exceed the requested value; a larger factor needs fewer rays.
    coarse: float = 1.0
    #: Availability of the heliostats; None if they always operate.
    available: Available | None = None
    #: Number of rays per heliostat and instant; 0 if the precision determines this number.
    number: int = 0
    #: Values of `aiming.VARIABLES` at the design point or at each instant; empty without a flux limit.
    aims: Mapping[str, Any] = {}
    #: Aim points at each instant, shape (T, N, 3); None if the aim points of the scene are used. [m]
    targets: Floats | None = None

    def means(self, sun: Floats, start: int, stop: int, light: LightSums | None = None) -> Values:
        """Return means over the instants with the sun up, with equal weights."""
        mapped = light if self._is_mapped(len(sun)) else None
        return self._means(sun, self.months, start, stop, mapped, IRRADIANCE, light)

    def design(self, start: int, stop: int, light: LightSums | None = None) -> Values:
        """Return values at the design point. [1]"""
        point = self.study.design_point
        values = self._means(point.sun(self.place[0]), np.array([point.month()]), start, stop, light, point.dni)
        return {f"design_point_{name}": each for name, each in values.items()}

    def energies(self, hours: Hours, start: int, stop: int, light: LightSums | None = None) -> Values:
        """Return irradiation-weighted means, and energies. [1, MWh]"""
        clean, reflected = self._reflected(hours)
        weight = hours.weight
        made = self._trace(hours.sun, weight, weight * reflected, start, stop, hours.month, MONTHS, light, light)
        if light is not None:
            light.add("energy_flux_map", made, clean)
        months, passed, mirror = _quantities(made), self.transmitted[start:stop], clean * self.reflection[start:stop]
        sums, received = months.sum(axis=1), passed * mirror * months[rays.RECEIVED]
        sent = mirror * sums[rays.REFLECTED]
        tower = [rays.COSINE_PAST_TOWER] if self.scene.tower else []
        passed_on = sums[[rays.COSINE, *tower, rays.COSINE_UNSHADED, rays.OPTICAL]]
        left = (*passed_on, sent, passed * sent, received.sum(axis=0))
        values = self._efficiencies(sums / (weight.sum() or np.nan), passed, mirror, _mean(reflected, weight))
        found = _with_errors(values | chain_of_energies(hours, self.area[start:stop], left, received))
        return found if self.available is None else self.available.apply(self, hours, found, start, stop)

    def series(
        self, sun: Floats, part: slice, hours: Hours | None, start: int, stop: int, whole: Floats | None
    ) -> Values:
        """Return the values of the field, and of the heliostats if these are stored, at the instants of `part`. [1, kW]

        If `hours` is given, the values include power. `whole` contains the sums over the heliostats at all instants. If
        `whole` is None, rays are traced.
        """
        weight = (sun[:, 2] > 0).astype(float) if hours is None else hours.weight
        reflected = self.way.reflected(self.months if hours is None else hours.month, len(sun))
        up, area = np.where(sun[:, 2] > 0, 1.0, np.nan), self.area[start:stop]
        first, last, _ = part.indices(len(sun))
        blocks, parts = list[Values](), list[Floats]()
        if whole is None:
            cells = flux_cells(self.study) if self._is_mapped(len(sun)) else None
            number, each = self._rays(sun, weight, weight * reflected, cells), self.study.output.time_series
            length = max(1, PAIRS // len(area)) if each else last - first
            for begin in range(first, last, length):
                end = min(begin + length, last)
                made = self._traced(
                    sun, begin, end, weights=np.stack((np.ones(len(sun)), reflected)),
                    group=np.arange(len(sun)) - begin if each else None, groups=end - begin if each else 1, start=start,
                    stop=stop, rays=number, share=self.share, area=self.area,
                )  # fmt: skip
                parts.append(made.field)
                if each:
                    quantities = _quantities(made) * up[begin:end, np.newaxis, np.newaxis]
                    values = self._efficiencies(
                        quantities, self.transmitted[start:stop], self.reflection[start:stop], 1.0
                    )
                    blocks.append(_with_errors({name: values[name] for name in _OF_INSTANTS}))
        fields = np.concatenate(parts, axis=1) if whole is None else whole[:, first:last]
        found = {f"instantaneous_{name}": np.concatenate([block[name] for block in blocks])
                 for name in (*_OF_INSTANTS, "total_efficiency_error") if blocks}  # fmt: skip
        for label in ("", "_error") if blocks else ():
            power = powers(found[f"instantaneous_total_efficiency{label}"], hours, part, area)
            found |= {f"{name}{label}": each for name, each in power.items()}
        mean = fields.transpose(2, 0, 1) * up[first:last] / area.sum()
        mean[[rays.REFLECTED, rays.RECEIVED]] *= reflected[first:last]
        values = self._efficiencies(mean, 1.0, 1.0, 1.0)
        values = _with_errors({name: values[name] for name in _OF_INSTANTS})
        found |= {f"field_instantaneous_{name}": values[name] for name in (*_OF_INSTANTS, "total_efficiency_error")}
        if hours is not None:
            for label in ("", "_error"):
                power = np.nan_to_num(values[f"total_efficiency{label}"]) * hours.dni[part] * area.sum()
                found[f"field_power{label}"] = 1e-6 * power
        return found

    def _means(
        self, sun: Floats, months: NDArray[np.int64] | None, start: int, stop: int, light: LightSums | None, dni: float,
        series: LightSums | None = None,
    ) -> Values:  # fmt: skip
        """Return means over the instants with the sun up, and add a flux map to `light` if given."""
        up, reflected = (sun[:, 2] > 0).astype(float), self.way.reflected(months, len(sun))
        made = self._trace(sun, up, up * reflected, start, stop, light=light, series=series)
        if light is not None:
            light.add("flux_map", made, 1e-3 * dni if up[0] else np.nan)
        part = _quantities(made)[:, 0] / (up.sum() or np.nan)
        passed, mirror = self.transmitted[start:stop], self.reflection[start:stop]
        return _with_errors(self._efficiencies(part, passed, mirror, _mean(reflected, up)))

    def number_of_rays(self, hours: Hours) -> int:
        """Return the number of rays per heliostat and instant for energies; 0 for draws with a fixed number of rays."""
        if self._stride(len(hours.sun)) > 1:
            return 0
        weight = hours.weight
        return self._rays(hours.sun, weight, weight * self._reflected(hours)[1], flux_cells(self.study))

    def _reflected(self, hours: Hours) -> tuple[float, Floats]:
        """Return the factors by which dirt reduces the reflectivity: a constant, and a relative value per instant.

        Points of the result that differ only in the constant factor use the same rays.
        """
        reflected = self.way.reflected(hours.month, len(hours.sun))
        even = reflected.size and reflected[0] > 0.0 and np.all(reflected == reflected[0])
        clean = float(reflected[0]) if even else 1.0
        return clean, reflected / clean

    @property
    def share(self) -> Floats:
        """Weight of each heliostat in the flux map: area times transmittance times reflectivity. [m2]"""
        return self.area * self.transmitted * self.reflection

    def _stride(self, instants: int) -> int:
        """Return the step between traced instants; 1 except in draws without a flux map."""
        drawn = self.study.sample is not None and not flux_cells(self.study)
        return drawn_step(self.study.optics, len(self.area) * instants) if drawn else 1

    def _is_mapped(self, instants: int) -> bool:
        """Return True if the result contains a flux map for a period with this number of instants."""
        return self.study.weather is not None or (instants == 1 and self.study.design_point is None)

    def _trace(
        self, sun: Floats, weight: Floats, reflected: Floats, start: int, stop: int,
        group: NDArray[np.int64] | None = None, groups: int = 1, light: LightSums | None = None,
        series: LightSums | None = None,
    ) -> rays.Traced:  # fmt: skip
        """Trace the heliostats `start` to `stop` - 1, and add the light to `light` and `series` if given."""
        cells = flux_cells(self.study) if light is not None else None
        instants = series is not None and series.wanted
        share, area = self.share if cells or instants else None, self.area if instants else None
        stride = self._stride(len(sun))

        def traced() -> rays.Traced:
            made = self._traced(
                sun, 0, len(sun), weights=np.stack((weight, reflected)), group=group, groups=groups, start=start,
                stop=stop, rays=DRAWN_RAYS if stride > 1 else self._rays(sun, weight, reflected, cells),
                cells=cells, share=share, area=area, stride=stride,
            )  # fmt: skip
            if stride == 1:
                return made
            return self._raked(made, sun, np.stack((weight, reflected)), group, slice(start, stop))

        if not self.key or (stop - start) * groups > SHARED:
            found = traced()
        else:  # points that differ only in reflectivity, soiling or attenuation use the same rays
            key = pickle.dumps(
                (self.scene, self.targets, sun, weight, reflected, group, start, stop, share, self.number)
            )
            name = f"rays of {threading.get_ident()}, {len(sun)}"
            found = self.way.inputs.last(name, key, traced, 1 + budget_cases(self.study))
        if series is not None and instants:
            series.series = series.series + found.field
        return found

    def _traced(self, sun: Floats, first: int, last: int, **given: Any) -> rays.Traced:
        """Trace rays at the instants `first` to `last` - 1, with aim points for each instant if `targets` is given."""
        given |= {
            "seed": self.study.optics.seed,
            "threads": self.threads,
            "cuda": self.study.execution.device == "cuda",
        }
        if self.targets is None or len(self.targets) != len(sun):
            return rays.trace(self.scene, sun, first=first, last=last, **given)
        parts = [
            rays.trace(self.scene._replace(target=self.targets[k]), sun, first=k, last=k + 1, **given)
            for k in range(first, last)
        ]
        sums, flux = (sum(getattr(part, name) for part in parts) for name in ("sums", "flux"))
        return parts[0]._replace(sums=sums, flux=flux, field=np.concatenate([part.field for part in parts], axis=1))

    def _raked(
        self, made: rays.Traced, sun: Floats, weights: Floats, group: NDArray[np.int64] | None, rows: slice,
    ) -> rays.Traced:  # fmt: skip
        """Scale the sums over the traced instants to all instants, first for each heliostat, then for each group.

        The scale factors are ratios of the sums of cosines over all instants and over the traced instants.

        The sums over the heliostats at each instant assume that the light on the receiver is proportional to the cosine
        within a group of instants.
        """
        sums, (weight, reflected) = made.sums, weights
        used = np.flatnonzero(weight)
        away = (self.scene.target - self.scene.centre)[rows]
        away /= 2.0 * np.linalg.norm(away, axis=1)[:, np.newaxis]

        def cosines() -> NDArray[np.float32]:
            return np.sqrt(np.float32(0.5) + away.astype(np.float32) @ sun[used].T.astype(np.float32))

        # All draws use the same mirrors and sun positions.
        key = away.tobytes(), sun[used].tobytes()
        cosine = self.way.inputs.last(f"cosines of {threading.get_ident()}", key, cosines)
        parts = np.zeros(used.size, np.int64) if group is None else group[used]
        traced = sums[..., rays.COSINE].mean(axis=0)
        wanted = np.bincount(parts, weight[used] * cosine.sum(axis=0), traced.shape[1])
        with np.errstate(invalid="ignore", divide="ignore"):
            each = np.nan_to_num((cosine @ weight[used].astype(np.float32)) / traced.sum(axis=1))[:, np.newaxis]
            part = np.nan_to_num(wanted / (each * traced).sum(axis=0))
        scaled: Floats = sums * (each * part)[..., np.newaxis]
        field, course = made.field.copy(), cosine.sum(axis=0)
        if field.size:
            light = (scaled[..., rays.RECEIVED].mean(axis=0) * self.share[rows, np.newaxis]).sum(axis=0)
            level = light / np.maximum(np.bincount(parts, reflected[used] * course, light.size), 1e-300)
            field[:, used, rays.RECEIVED] = course * level[parts]
        return made._replace(sums=scaled, field=field)

    def _rays(self, sun: Floats, weight: Floats, reflected: Floats, cells: tuple[int, int] | None) -> int:
        """Return the number of rays per heliostat and instant for energies and a flux map of the given cells."""
        optics = self.study.optics
        if self.number:
            return self.number
        if optics.rays is not None:
            return max(1, int(optics.rays / self.coarse))
        precision = self.coarse * (optics.precision or PRECISION)

        def needed() -> int:
            return rays.rays_for(
                self.scene, sun, np.stack((weight, reflected)), precision=precision, cells=cells, share=self.share,
                seed=optics.seed,
            )  # fmt: skip

        key = (self.key, len(sun), self.coarse, len(self.area), cells)
        return self.way.inputs.last(f"rays {len(sun) > 1}", key, needed)

    @staticmethod
    def _efficiencies(part: Floats, passed: Any, mirror: Any, reflected: float) -> Values:
        """Return the efficiencies of each set of rays, from means of shape (quantities, ..., replicates, n).

        `passed` is the transmittance of the air for each heliostat, and `mirror` is the reflectance of each heliostat.
        """
        values = dict(zip(EFFICIENCIES, part[[rays.COSINE, rays.UNSHADED, rays.UNBLOCKED, rays.OPTICAL]], strict=True))
        optical, light = (np.moveaxis(part[at], -2, 0) for at in (rays.OPTICAL, rays.LIGHT))
        intercept = np.moveaxis(rays.intercept(optical, light), 0, -2)
        total = passed * mirror * part[rays.RECEIVED]
        return values | dict(zip(LIGHT, (intercept, passed, mirror * reflected, total), strict=True))


class LightSums:
    """Sums over a field's heliostats at a point of the result: flux maps, and the light at each instant.

    The sums are integers. Results are therefore bitwise equal for any order of heliostat blocks.
    """

    def __init__(self, way: Way) -> None:
        self._study, self._way = way.study, way
        self._maps: dict[str, tuple[NDArray[np.int64], float]] = {}
        #: True if ray sums at each instant are kept for time series or heat. `series` contains these sums.
        self.wanted = is_series_traced(way.study) or (has_heat(way.study) and way.study.weather is not None)
        self.series: Any = 0.0

    def received(self, hours: Hours) -> Floats:
        """Return the field's power on the receiver divided by the irradiance at each instant, shape (T,). [m2]"""
        light: Floats = np.mean(self.series[..., rays.RECEIVED], axis=0)
        return light * self._way.reflected(hours.month, len(hours.sun))

    def add(self, name: str, made: rays.Traced, scale: float = 1.0) -> None:
        """Add the light on each receiver cell, multiplied by `scale`, to the flux map `name`. [kW or MWh]"""
        if flux_cells(self._study):
            flux, _ = self._maps.get(name, (0, scale))
            self._maps[name] = flux + made.flux, scale * made.unit

    def values(self) -> dict[str, Any]:
        """Return flux maps, peak and mean flux, and standard errors by variable name; NaN if the sun is down."""
        found = dict[str, Any]()
        if not self._maps:
            return found
        values, wanted = self._way.values, self._study.output.flux_map
        around = 2.0 * np.pi * values["radius"] if self._study.receiver.kind == "cylinder" else values["width"]
        for name, (flux, unit) in self._maps.items():
            scale = unit * flux[0].size / (around * values["height_extent"])
            mean, error = rays.mean_error(flux)
            found |= {name: mean * scale, f"{name}_error": error * scale}
            if name == "flux_map":
                peak, noise = rays.peak(flux)
                level, wave = rays.mean_error(flux.mean(axis=(1, 2)))
                found |= {"peak_flux": peak * scale, "peak_flux_error": noise * scale}
                found |= {"mean_flux": level * scale, "mean_flux_error": wave * scale}
        if wanted is not None and wanted.limit is not None and "flux_map" in found:
            cells = found["flux_map"]
            found["power_above_limit"] = cells[cells > wanted.limit].sum() / (cells.sum() or np.nan)
        return found


def _quantities(made: rays.Traced) -> Floats:
    """Return the ray sums, shape (quantities, groups, replicates, heliostats)."""
    return made.sums.transpose(3, 2, 0, 1)


def _with_errors(values: Values) -> Values:
    """Return means over the ray sets and their standard errors. Values common to all ray sets have one dimension."""
    found = {name: each for name, each in values.items() if each.ndim == 1}
    for name in values.keys() - found.keys():
        found[name], found[f"{name}_error"] = rays.mean_error(np.moveaxis(values[name], -2, 0))
    return found


def _mean(values: Floats, weights: Floats) -> float:
    """Return the weighted mean over the instants. The mean of equal values is exact."""
    if not values.size or np.all(values == values[0]):
        return float(values[0]) if values.size else np.nan
    return float(np.sum(values * weights) / (np.sum(weights) or np.nan))
