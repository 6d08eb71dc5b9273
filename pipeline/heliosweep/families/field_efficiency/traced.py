"""Values of some heliostats of a field with optics, by rays: everything after the cosine.

Every ray starts on a mirror, is shaded along the ray to the sun and blocked along the reflected ray by the real
mirrors, and meets the receiver or passes it. See `heliosweep.kernels.rays`.
"""

from __future__ import annotations

import pickle
import threading
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.times import WeatherTime
from heliosweep.families.field_efficiency.chain import Geometry, Way
from heliosweep.families.field_efficiency.energy import Hours
from heliosweep.families.field_efficiency.flux import IRRADIANCE, flux_sizes
from heliosweep.families.field_efficiency.values import Values, chain_of_energies, powers
from heliosweep.families.field_efficiency.variables import (
    EFFICIENCIES,
    LIGHT,
    LIGHT_SERIES,
    MONTHS,
    NOISY,
    SERIES,
)
from heliosweep.kernels import rays
from heliosweep.kernels.arrays import Floats

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy

#: Standard error of the field's energy over the energy, by default: of results, and of draws. [1]
PRECISION, DRAWN_PRECISION = 1e-4, 2e-3
#: Precision of the pass that ranks heliostats, over the precision of the result. [1]
RANKING = 8.0
#: Draws: rays of a pair of heliostat and instant, standard deviation of the light between pairs over its mean, share of
#: instants with the sun up, and steps between traced instants, which visit all hours of the day. [1]
DRAWN_RAYS, SCATTER, LIT = 16, 0.16, 0.3
#: Usual number of rays of a year, and the number of instants of which fewer take more; factor with a flux map.
USUAL_RAYS, MANY_INSTANTS, MAPPED = 64, 2440, 2
STRIDES = (1, 5, 7, 11, 23, 47, 71)
#: Maximum number of heliostats and groups whose sums are shared with the next point.
SHARED = 2**13
#: Pairs whose sums are held at a time.
PAIRS = 2**15


def usual_rays(study: FieldEfficiencyStudy, heliostats: int, instants: int) -> float:
    """Return the usual number of rays of each heliostat and instant, for the plan; those at night have none."""
    optics = study.optics
    assert optics is not None
    lit = LIT if isinstance(study.time, WeatherTime) else 1.0
    if optics.rays is not None:
        return lit * optics.rays
    if study.sample is not None and not flux_sizes(study) and (step := drawn_step(optics, heliostats * instants)) > 1:
        return lit * DRAWN_RAYS / step
    finer = (PRECISION / (optics.precision or PRECISION)) ** (1.0 / 0.7)
    wanted = (
        USUAL_RAYS * max(1.0, MANY_INSTANTS / (lit * instants)) ** 0.8 * (MAPPED if flux_sizes(study) else 1) * finer
    )
    return lit * min(max(DRAWN_RAYS, wanted), rays.MOST)


def drawn_step(optics: Any, pairs: int) -> int:
    """Return the step between the traced instants of a heliostat in a draw, for pairs of heliostat and instant."""
    if optics.rays is not None:
        return 1
    wanted = pairs * LIT * ((optics.precision or DRAWN_PRECISION) / SCATTER) ** 2
    return max(step for step in STRIDES if step <= max(1.0, wanted))


class TracedField(NamedTuple):
    """A field with optics at a point of the result; methods as of `values.Field`."""

    study: FieldEfficiencyStudy
    mirrors: Geometry
    """Centres x, y, z, half width and height, points that the mirrors aim at [m], and code of the tracking."""
    way: Way
    scene: rays.Scene
    area: Floats
    """Of each mirror. [m2]"""
    transmitted: Floats
    """Part of the light of each heliostat that the air lets pass. [1]"""
    reflection: Floats
    """Reflectivity times cleanliness of each heliostat. [1]"""
    place: Sequence[float | None]
    """Values of `grid.sun.PLACE`."""
    months: NDArray[np.int64] | None
    """Month of each instant, from 0, if cleanliness depends on it."""
    key: tuple[int, ...]
    """Position of the point in the result."""
    threads: int = 1
    coarse: float = 1.0
    """Factor on the precision."""

    def means(self, sun: Floats, start: int, stop: int, flux: FluxSums | None = None) -> Values:
        """Means over the instants with the sun up, all of the same weight."""
        up = (sun[:, 2] > 0).astype(float)
        reflected = self.way.reflected(self.months, len(sun))
        mapped = flux if len(sun) == 1 and self.study.design_point is None else None
        made = self._trace(sun, up, up * reflected, start, stop, flux=mapped)
        if mapped is not None:
            mapped.add("flux_map", made, 1e-3 * IRRADIANCE if up[0] else np.nan)
        return self._efficiencies(made.sums[:, :, 0], up.sum(), _mean(reflected, up), start, stop)

    def energies(self, hours: Hours, start: int, stop: int, flux: FluxSums | None = None) -> Values:
        """Means weighted by the irradiation, and energies. [1, MWh]"""
        reflected, weight = self.way.reflected(hours.month, len(hours.sun)), hours.weight
        made = self._trace(
            hours.sun, weight, weight * reflected, start, stop, hours.month, MONTHS, flux
        )  # fmt: skip
        if flux is not None:
            flux.add("energy_flux_map", made)
        sums, passed, area = made.sums.sum(axis=2), self.transmitted[start:stop], self.area[start:stop]
        mirror = self.reflection[start:stop]
        values = self._efficiencies(sums, weight.sum(), _mean(reflected, weight), start, stop)
        mean = sums.mean(axis=0)
        sent = mirror * mean[:, rays.REFLECTED]
        passed_on = passed * mirror
        received = passed_on * mean[:, rays.RECEIVED]
        first = (mean[:, at] for at in (rays.COSINE, rays.COSINE_UNSHADED, rays.OPTICAL))
        left = (*first, sent, passed * sent, received)
        monthly = passed_on * made.sums[..., rays.RECEIVED].mean(axis=0).T
        values["receiver_energy_error"] = area * passed_on * rays.mean_error(sums[:, :, rays.RECEIVED])[1]
        return values | chain_of_energies(hours, area, left, monthly)

    def series(self, sun: Floats, part: slice, hours: Hours | None, start: int, stop: int) -> Values:
        """Values at a part of the instants along `sun`; with `hours` also the power. [1, kW]"""
        weight = (sun[:, 2] > 0).astype(float) if hours is None else hours.weight
        reflected = self.way.reflected(self.months if hours is None else hours.month, len(sun))
        number = self._rays(sun, weight, weight * reflected, flux_sizes(self.study))
        up = np.where(sun[:, 2] > 0, 1.0, np.nan)
        first, last, _ = part.indices(len(sun))
        found = np.full((6, last - first, stop - start), np.nan)
        length = max(1, PAIRS // (stop - start))
        for begin in range(first, last, length):
            end = min(begin + length, last)
            made = rays.trace(
                self.scene, sun, weights=np.ones((2, len(sun))), group=np.arange(len(sun)) - begin, groups=end - begin,
                start=start, stop=stop, first=begin, last=end, rays=number, seed=self._optics.seed,
                threads=self.threads, cuda=self._cuda,
            )  # fmt: skip
            mean = made.sums.mean(axis=0).T * up[begin:end, np.newaxis]
            found[:, begin - first : end - first] = _factors(mean)
        found[5] *= np.outer(reflected[part], (self.transmitted * self.reflection)[start:stop])
        named = dict(zip((*SERIES, *LIGHT_SERIES), found, strict=True))
        return named | powers(found[5], hours, part, self.area[start:stop])

    def design(self, start: int, stop: int, flux: FluxSums | None = None) -> Values:
        """Values at the design point. [1]"""
        point = self.study.design_point
        assert point is not None
        assert self.place[0] is not None
        sun = point.sun(self.place[0])
        up, reflected = (sun[:, 2] > 0).astype(float), self.way.reflected(np.array([point.month()]), 1)
        made = self._trace(sun, up, up * reflected, start, stop, flux=flux)
        if flux is not None:
            flux.add("flux_map", made, 1e-3 * point.dni if up[0] else np.nan)
        values = self._efficiencies(made.sums[:, :, 0], up.sum(), float(reflected[0]), start, stop)
        return {f"design_point_{name}": each for name, each in values.items()}

    @property
    def _optics(self) -> Any:
        return self.study.optics

    @property
    def _cuda(self) -> bool:
        """True if a graphics processor traces."""
        return self.study.execution.device == "cuda"

    @property
    def _share(self) -> Floats:
        """Factor of each heliostat on the flux map. [m2]"""
        return self.area * self.transmitted * self.reflection

    def _trace(
        self, sun: Floats, weight: Floats, reflected: Floats, start: int, stop: int,
        group: NDArray[np.int64] | None = None, groups: int = 1, flux: FluxSums | None = None,
    ) -> rays.Traced:  # fmt: skip
        """Trace heliostats start..stop at some instants, with a flux map if `flux` is given."""
        sizes = flux_sizes(self.study) if flux is not None else {}
        share = self._share if sizes else None
        drawn = self.study.sample is not None and not sizes
        stride = drawn_step(self._optics, len(self.area) * len(sun)) if drawn else 1

        def traced() -> rays.Traced:
            made = rays.trace(
                self.scene, sun, weights=np.stack((weight, reflected)), group=group, groups=groups, start=start,
                stop=stop, rays=DRAWN_RAYS if stride > 1 else self._rays(sun, weight, reflected, sizes),
                seed=self._optics.seed, cells=_cells(sizes), share=share, stride=stride,
                threads=self.threads, cuda=self._cuda,
            )  # fmt: skip
            if stride == 1:
                return made
            return made._replace(sums=self._raked(made.sums, sun, weight, group, slice(start, stop)))

        if not self.key or (stop - start) * groups > SHARED:
            return traced()
        # Points that differ in reflectivity, dirt or air alone have the same rays.
        key = pickle.dumps((self.scene, sun, weight, reflected, group, start, stop, share))
        found: rays.Traced = self.way.inputs.last(f"rays of {threading.get_ident()}, {len(sun)}", key, traced)
        return found

    def _raked(self, sums: Floats, sun: Floats, weight: Floats, group: NDArray[np.int64] | None, rows: slice) -> Floats:
        """Scale sums over some instants to all, by sums of the cosine: of each heliostat, then of each group."""
        used = np.flatnonzero(weight)
        away = (self.scene.target - self.scene.centre)[rows]
        away /= 2.0 * np.linalg.norm(away, axis=1)[:, np.newaxis]
        cosine = np.sqrt(np.float32(0.5) + away.astype(np.float32) @ sun[used].T.astype(np.float32))
        parts = np.zeros(used.size, np.int64) if group is None else group[used]
        traced = sums[..., rays.COSINE].mean(axis=0)
        wanted = np.bincount(parts, weight[used] * cosine.sum(axis=0), traced.shape[1])
        with np.errstate(invalid="ignore", divide="ignore"):
            each = np.nan_to_num((cosine @ weight[used].astype(np.float32)) / traced.sum(axis=1))[:, np.newaxis]
            part = np.nan_to_num(wanted / (each * traced).sum(axis=0))
        scaled: Floats = sums * (each * part)[..., np.newaxis]
        return scaled

    def _rays(self, sun: Floats, weight: Floats, reflected: Floats, sizes: Mapping[str, int]) -> int:
        """Number of rays for each heliostat and instant, with a flux map of some sizes."""
        optics, cells = self._optics, _cells(sizes)
        if optics.rays is not None:
            return max(1, int(optics.rays / self.coarse))
        precision = self.coarse * (optics.precision or PRECISION)

        def needed() -> int:
            return rays.rays_for(
                self.scene, sun, np.stack((weight, reflected)), precision=precision, cells=cells, share=self._share,
                seed=optics.seed,
            )  # fmt: skip

        key = (self.key, len(sun), self.coarse, len(self.area), cells)
        found: int = self.way.inputs.last(f"rays {len(sun) > 1}", key, needed)
        return found

    def _efficiencies(self, sums: Floats, total: float, reflected: float, start: int, stop: int) -> Values:
        """Efficiencies, and standard errors of those of rays, from sums of shape (replicates, n, quantities)."""
        passed, mirror, divisor = self.transmitted[start:stop], self.reflection[start:stop], total or np.nan
        mean = sums.mean(axis=0) / divisor
        *four, intercept, _ = _factors(mean.T)
        received = passed * mirror * mean[:, rays.RECEIVED]
        values = dict(zip(EFFICIENCIES, four, strict=True))
        values |= dict(zip(LIGHT, (intercept, passed, mirror * reflected, received), strict=True))
        light, optical = sums[:, :, rays.LIGHT] / divisor, sums[:, :, rays.OPTICAL] / divisor
        noisy = (
            optical,
            (light - intercept * optical) / four[3],
            passed * mirror * sums[:, :, rays.RECEIVED] / divisor,
        )
        return values | {name: rays.mean_error(each)[1] for name, each in zip(NOISY, noisy, strict=True)}


class FluxSums:
    """Flux maps of a field at a point of the result, of all its heliostats.

    Whole numbers of rays are added, so that blocks of heliostats give the same bits in any order.
    """

    def __init__(self, study: FieldEfficiencyStudy, way: Way | None) -> None:
        self._study, self._way = study, way
        self.wanted = bool(flux_sizes(study))
        self._maps: dict[str, tuple[NDArray[np.int64], float]] = {}

    def add(self, name: str, made: rays.Traced, scale: float = 1.0) -> None:
        """Add the light on each cell, times `scale` in kW or MWh."""
        if self.wanted:
            flux, _ = self._maps.get(name, (0, scale))
            self._maps[name] = flux + made.flux, scale * made.unit

    def values(self) -> dict[str, Any]:
        """Maps, peak and mean with their standard errors, by the names of variables; NaN with the sun down."""
        found = dict[str, Any]()
        if self._way is None or not self._maps:
            return found
        values, wanted = self._way.values, self._study.output.flux_map
        around = 2.0 * np.pi * values["radius"] if self._study.receiver.kind == "cylinder" else values["width"]
        for name, (flux, unit) in self._maps.items():
            scale = unit * flux[0].size / (around * values["height_extent"])
            mean, error = rays.mean_error(flux)
            found |= {name: mean * scale, f"{name}_error": error * scale}
            if name == "flux_map":
                peak, noise = rays.peak(flux)
                found |= {"peak_flux": peak * scale, "peak_flux_error": noise * scale}
        if (cells := found.get("flux_map")) is not None:
            found["mean_flux"] = cells.mean()
            if wanted is not None and wanted.limit is not None:
                found["power_above_limit"] = cells[cells > wanted.limit].sum() / (cells.sum() or np.nan)
        return found


def _cells(sizes: Mapping[str, int]) -> tuple[int, int] | None:
    """Rows and columns of a flux map; None without one."""
    return (sizes["flux_row"], sizes["flux_column"]) if sizes else None


def _factors(mean: Floats) -> Floats:
    """Cosine, shading, blocking, optical and intercept efficiency, and the received light, from means of quantities.

    `mean` has the quantities first. The intercept is missing (NaN) if no light leaves the mirror.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        intercept = mean[rays.LIGHT] / mean[rays.OPTICAL]
    return np.stack((*(mean[at] for at in (rays.COSINE, rays.UNSHADED, rays.UNBLOCKED, rays.OPTICAL)), intercept,
                     mean[rays.LIGHT]))  # fmt: skip


def _mean(values: Floats, weights: Floats) -> float:
    """Weighted mean over the instants; of equal values their value, to the last bit."""
    if not values.size or np.all(values == values[0]):
        return float(values[0]) if values.size else np.nan
    return float(np.sum(values * weights) / (np.sum(weights) or np.nan))
