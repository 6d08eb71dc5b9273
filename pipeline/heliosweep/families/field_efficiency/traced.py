"""Heliostat and field values for a field with optics, computed by ray tracing.

Each ray starts at a point on a mirror. Other mirrors may shade this point or block the reflected ray. An unblocked ray
hits or misses the receiver. See `heliosweep.kernels.rays`.
"""

from __future__ import annotations

import math
import pickle
import threading
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.aiming import VARIABLES, aim_grid, limited_aims, targets
from heliosweep.config import Distribution, WeatherTime, read_profile
from heliosweep.energy import transmittance
from heliosweep.errors import StudyError
from heliosweep.families.field_efficiency.heat import read_losses
from heliosweep.families.field_efficiency.light_files import TURN_COLUMNS, SlopeMap, read_calibration, read_slopes
from heliosweep.families.field_efficiency.losses import Available, budget_cases
from heliosweep.families.field_efficiency.optics import COLUMNS, IRRADIANCE, KEYS, flux_cells, is_limited, varies
from heliosweep.families.field_efficiency.values import Hours, Values, chain_of_energies
from heliosweep.families.field_efficiency.variables import EFFICIENCIES, LIGHT, MONTHS
from heliosweep.families.mount_errors import standard_deviates, widths_of
from heliosweep.grid.sun import Instants, instant_count
from heliosweep.kernels import rays, sunshapes
from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.field.packets import SPINNING_ELEVATION
from heliosweep.kernels.mounts import ERRORS

if TYPE_CHECKING:
    from heliosweep.families.family import Point
    from heliosweep.families.field_efficiency.study import DesignPoint, FieldEfficiencyStudy
    from heliosweep.layouts.layout import Layout

#: Default relative standard error of the field's energy without draws, and with draws. [1]
PRECISION, DRAWN_PRECISION = 1e-4, 2e-3
#: Number of rays per heliostat and instant in draws. Relative standard deviation of the light over heliostats and
#: instants. Fraction of instants with the sun up. [1]
DRAWN_RAYS, SCATTER, LIT = 16, 0.16, 0.3
#: Maximum number of heliostats times instant groups for which ray sums are cached for the next point.
SHARED = 2**13
#: Number of heliostat-instants whose ray sums are held in memory together. Maximum number of instants, and maximum
#: number of result points, for which ray sums at each instant are kept for time series.
PAIRS, KEPT_INSTANTS, KEPT = 2**15, 2**15, 4

#: Mirror centres (x, y, z), half widths, half heights and aim points, all in m, and the code of the tracking method.
Geometry = tuple[Floats, Floats, Floats, Floats, Floats, Any, int]


class Inputs:
    """Contents of a study's optical input files. Each file is read once.

    Threads share this object. A thread may replace a cached value but must not modify it.
    """

    def __init__(self, study: FieldEfficiencyStudy) -> None:
        def read(key: str, reader: Callable[..., Any]) -> dict[str, Any]:
            return {name: reader(study.resolve(name), name) for name in study.files().get(key, ())}

        profiles = read("optics.sun_shape.file", read_profile).values()
        self.sun: Any = next((sunshapes.table(*table) for table in profiles), None)
        self.maps: dict[str, SlopeMap] = {
            PurePath(name).name: found._replace(slope=rays.filled(found.slope))
            for name, found in read("optics.slope_map", read_slopes).items()
        }
        self.mounts = next(iter(read("optics.mount_errors.calibration", read_calibration).values()), None)
        self.losses = next(iter(read("receiver.thermal_losses.file", read_losses).values()), None)
        self._last: dict[str, tuple[tuple[Any, Any], ...]] = {}
        #: Lock for each point whose means and time series use the same rays.
        self.locks: Mapping[Any, threading.Lock] = defaultdict(threading.Lock)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for a worker process, with an empty cache and new locks."""
        return {**vars(self), "_last": {}, "locks": defaultdict(threading.Lock)}

    def last(self, name: str, key: Any, make: Callable[[], Any], depth: int = 1) -> Any:
        """Return the value cached under a name and key, or compute it with `make` and cache it."""
        value = next((pair for pair in self._last.get(name, ()) if pair[0] == key), None) or (key, make())
        kept = self._last.get(name, ())  # another thread may have added its value during `make`
        self._last[name] = (value, *(pair for pair in kept if pair[0] != key))[:depth]
        return value[1]


class Way(NamedTuple):
    """Optical path from the mirrors to the receiver at a result point."""

    #: Study with an `optics` block.
    study: Any
    #: Contents of the study's optical files.
    inputs: Inputs
    #: Layout with all heliostats of the field.
    layout: Layout
    #: Values of `optics.KEYS`, by the last part of each key; the seed of the mount errors is `mount_seed`.
    values: Mapping[str, Any]

    @classmethod
    def at(cls, study: Any, inputs: Inputs, layout: Layout, value: Callable[[str], Any]) -> Way:
        """Return the optical path of a layout. `value` returns the value of a key."""
        names = ["mount_seed" if key == "optics.mount_errors.seed" else key.rpartition(".")[2] for key in KEYS]
        return cls(study, inputs, layout, dict(zip(names, map(value, KEYS), strict=True)))

    @property
    def map(self) -> SlopeMap | None:
        """Slope maps at this result point; None if the study has none."""
        name = self.values["slope_map"]
        return None if name is None else self.inputs.maps[PurePath(name).name]

    @property
    def number(self) -> NDArray[np.int64]:
        """Index of the slope map of each heliostat, shape (N,); -1 without a map."""
        return np.full(len(self.layout), -1) if self.map is None else self.map.numbers(self.layout)

    @property
    def receiver(self) -> rays.Receiver:
        """Receiver surface for the ray tracer."""
        values, centre = self.values, (0.0, 0.0, float(self.values["height"]))
        if self.study.receiver.kind == "cylinder":
            return rays.cylinder(centre, float(values["radius"]), float(values["height_extent"]))
        azimuth, tilt = (math.radians(values[key] or 0.0) for key in ("azimuth", "tilt"))
        return rays.rectangle(centre, azimuth, tilt, float(values["width"]), float(values["height_extent"]))

    @property
    def _ideal(self) -> NDArray[np.bool_]:
        """False for heliostats whose slope map includes focus and canting; shape (N,)."""
        return (self.number < 0) | (self.map is None or not self.map.plane)

    def _image(self, slant: Floats) -> tuple[rays.Errors, sunshapes.SunShape, Floats]:
        """Return the random errors, the sun shape, and 1 / (2 focal length) along u and v, shape (N, 2) [1/m]."""
        values, layout, number = self.values, self.layout, self.number
        axes = [values[f"slope_error_{axis}"] for axis in ("horizontal", "vertical")]
        axes = [values["slope_error"]] * 2 if axes[0] is None else axes
        slopes = [np.where(number >= 0, 0.0, layout.values("slope_error", slope)) for slope in axes]
        u, v = (1e-3 * np.hypot(slope, values["tracking_error"]) for slope in slopes)
        ratio = [values["circumsolar_ratio"]] * (values["kind"] == "buie")
        sun = self.inputs.sun if values["kind"] == "table" else getattr(sunshapes, values["kind"])(*ratio)
        curve = 0.5 / layout.focal_lengths(values["focus"], slant) * self._ideal[:, np.newaxis]
        return rays.Errors(u, v, 1e-3 * float(values["specularity_error"])), sun, curve

    def _mounts(self) -> Floats:
        """Return the mount errors of all heliostats, shape (N, 6), or (0, 6) if all errors are zero. [rad]"""
        values, numbers, errors = self.values, self.layout.numbers, np.zeros((1, len(ERRORS)))
        given, seed = [values[name] for name in ERRORS], int(values["mount_seed"] or 0)
        if self.inputs.mounts is not None:
            errors = values["scale"] * self.inputs.mounts.of(self.layout)
        elif given[0] is not None:
            make = partial(standard_deviates, given, numbers, 1, seed)
            key = str(given), numbers.tobytes(), seed
            drawn = self.inputs.last(f"mounts of {threading.get_ident()}", key, make)[:, 0]
            mean = [error.mean if isinstance(error, Distribution) else error for error in given]
            errors = 1e-3 * (np.array(mean, np.float64) + values["scale"] * widths_of(given) * drawn)
        return errors if errors.any() else errors[:0]

    def _slopes(self, sides: Floats, tracking: int) -> rays.SlopeMap | None:
        """Return the slope maps along the mirror axes u and v; None if the study has none.

        If some heliostats have no map, a map of zeros is appended for these heliostats.
        """
        if (found := self.map) is None:
            return None
        x, y, slope, number = found.x, found.y, found.slope, self.number
        if tracking == SPINNING_ELEVATION:  # u points to the left and v down if the sun is above the target
            x, y, slope = -x[::-1], -y[::-1], -slope[:, ::-1, ::-1]
        x, y = (np.pad(at, 1, "reflect", reflect_type="odd") for at in (x, y))  # linear extrapolation beyond the edges
        slope = np.pad(slope, ((0, int((number < 0).any())), (0, 0), (0, 0), (0, 0)))
        slope = np.pad(slope, ((0, 0), (1, 1), (1, 1), (0, 0)), "reflect", reflect_type="odd")
        return rays.SlopeMap(x, y, slope, number % len(slope), not found.fits(*sides))

    def scene(self, mirrors: Geometry, tower: tuple[float, float] | None = None) -> rays.Scene:
        """Return the scene for the ray tracer. `tower` contains the radius and the top height of the tower. [m]"""
        values, layout, grid, slant = self.values, self.layout, self.study.heliostat.facets, slant_of(mirrors)
        centre, sides, tracking = np.stack(mirrors[:3], axis=1), 2.0 * np.stack(mirrors[3:5], axis=1), mirrors[6]
        facets = rays.Facets(1, 1, 0.0) if grid is None else rays.Facets(grid.columns, grid.rows, float(grid.gap))
        turn = [layout.columns.get(name, np.zeros(len(layout))) for name in TURN_COLUMNS]
        errors, sun, curve = self._image(slant)
        cant = self._ideal * 0.5 / slant if values["canting"] == "on_axis" else np.zeros(len(slant))
        return rays.Scene(
            centre, mirrors[5], sides, curve, cant, 1e-3 * np.stack(turn, axis=1).astype(np.float64), facets, tracking,
            errors, sun, self.receiver, self._mounts(), self._slopes(sides[0], tracking), tower,
        )  # fmt: skip

    def room(self, mirrors: Geometry) -> Floats:
        """Return each aim point's maximum height above the receiver's centre; negative if the spot is too large. [m]

        The radius of a spot is two standard deviations of the on-axis image in the HFLCAL model. Measured slopes are
        treated as random slope errors. If measured slopes include focus and canting, only their deviations from a
        mirror focused at the slant range count as errors.
        """
        slant, rough, receiver = slant_of(mirrors), np.zeros(len(mirrors[0])), self.receiver
        errors, sun, curve = self._image(slant)
        if (found := self.map) is not None:  # mean square of the measured slopes [rad^2]
            place = np.stack(np.meshgrid(found.x, found.y), axis=-1) * found.plane
            square, turn, flat = (
                np.sum(product, axis=-1).mean(axis=(-2, -1))
                for product in (found.slope**2, found.slope * place, place**2)
            )
            number, bend = self.number, 0.5 / slant
            rough = np.where(number < 0, 0.0, square[number] + 2.0 * bend * turn[number] + bend**2 * flat)
        blur = np.where(self._ideal, slant * curve.sum(axis=1) - 1.0, 0.0)
        variance = sun.spread + errors.specularity**2
        variance = variance + 2.0 * (errors.slope_u**2 + errors.slope_v**2 + rough)
        spot = np.sqrt(slant**2 * variance + 2.0 * mirrors[3] * (2.0 * mirrors[4]) * blur**2 / 16.0)
        away = mirrors[5] - np.stack(mirrors[:3], axis=1)
        along, aside = away @ receiver.upward / slant, away @ receiver.across / slant
        if receiver.kind == rays.CYLINDER:
            aside = np.zeros_like(along)
        square = np.maximum(1.0 - along**2 - aside**2, 1e-9)  # squared cosine of the angle of incidence on the receiver
        return 0.5 * float(self.values["height_extent"]) - 2.0 * spot * np.sqrt((1.0 - aside**2) / square)

    def aims(self, mirrors: Geometry, levels: int | None) -> Floats:
        """Return the aim points of the mirrors.

        Without `aim`, with `centre`, and before `flux_limit` selects aim points, heliostats aim at the centre of the
        receiver. If the receiver is a cylinder, heliostats aim at the nearest surface point at mid-height.

        For `spread`, the levels are evenly spaced over the height of the receiver, less the radius of the heliostat's
        spot at each end. Heliostats are ordered by azimuth, clockwise from north, then by distance from the tower.
        Levels are assigned cyclically in this order, starting at the lowest level. A heliostat with a spot larger than
        the receiver aims at the centre.

        Parameters
        ----------
        mirrors : tuple
            Mirror centres (x, y, z), half widths and half heights; other entries are not used. [m]
        levels : int or None
            Number of levels for `spread` (default: 3).

        Returns
        -------
        ndarray, shape (N, 3)
            Coordinates of the aim points: east, north and up from the base of the tower. [m]
        """
        strategy = self.study.aim.strategy if self.study.aim is not None else "centre"
        if strategy == "layout":
            return np.stack([self.layout.columns[key].astype(float) for key in COLUMNS], axis=1)
        middle, radius = np.stack(mirrors[:3], axis=1), self.values["radius"] or 0.0
        factor = radius / np.sqrt(middle[:, 0] ** 2 + middle[:, 1] ** 2) if radius else np.zeros(len(middle))
        middle[:, :2] = factor[:, np.newaxis] * middle[:, :2] + 0.0  # no negative zeros
        middle[:, 2] = self.values["height"]
        if strategy == "spread" and (count := 3 if levels is None else int(levels)) > 1:
            height = np.maximum(0.0, self.room((*mirrors[:5], middle, 0)))
            level = 2.0 * (turns(np.stack(mirrors[:2], axis=1)) % count) / (count - 1) - 1.0
            middle += (level * height)[:, np.newaxis] * self.receiver.upward
        return middle

    def transmitted(self, mirrors: Geometry, place: Sequence[Any]) -> Floats:
        """Return the air transmittance for each heliostat [1], shape (N,). `place` contains the values of `PLACE`."""
        values = self.values
        given = {key: values[key] for key in ("visibility", "water_vapour") if values[key] is not None}
        altitude = place[2] if values["altitude"] is None else values["altitude"]
        given |= {"altitude": float(altitude or 0.0), "receiver_height": float(values["height"])}
        return transmittance(slant_of(mirrors), values["attenuation"], **given)

    def reflected(self, months: NDArray[np.int64] | None, count: int) -> Floats:
        """Return the reflectivity factor for monthly cleanliness and soiling at `count` instants. [1]"""
        values, monthly = self.values, self.study.optics.cleanliness_by_month
        clean = np.ones(1) if monthly is None else np.array(monthly)[months]
        if values["rate"] is not None:  # with staggered washing, the mean soiling is half the maximum
            clean = clean * (1.0 - values["rate"] * values["washing_interval"] / 2.0)
        return np.broadcast_to(clean, count)


def slant_of(mirrors: Geometry) -> Floats:
    """Return the distance from each mirror to its aim point. [m]"""
    return np.sqrt(np.sum((mirrors[5] - np.stack(mirrors[:3], axis=1)) ** 2, axis=1))


def turns(centre: Floats) -> NDArray[np.int64]:
    """Return the rank of each heliostat by azimuth, then by distance from the tower, counted from 0."""
    azimuth = np.round(np.arctan2(centre[:, 0], centre[:, 1]) % (2.0 * np.pi), 9) % np.round(2.0 * np.pi, 9)
    return np.argsort(np.lexsort((np.hypot(centre[:, 0], centre[:, 1]), azimuth)))


def months_of(instants: Instants, longitude: float | None) -> NDArray[np.int64] | None:
    """Return the month (0 to 11) of each instant in mean solar time at a site; None if the instants have no dates."""
    if "day" in instants.labels:
        days: NDArray[Any] = (instants.labels["day"].values.astype(np.int64) - 1).astype("timedelta64[D]")
        stamps: NDArray[Any] = np.datetime64("2001-01-01") + days
    elif "utc" in instants.labels:
        stamps = instants.labels["utc"].values + np.timedelta64(round(240 * (longitude or 0.0)), "s")
    else:
        return None
    return stamps.astype("datetime64[M]").astype(np.int64) % 12


def usual_rays(study: FieldEfficiencyStudy, heliostats: int, instants: int) -> float:
    """Return the expected mean number of rays per heliostat and instant, including night instants without rays."""
    optics: Any = study.optics
    lit = LIT if isinstance(study.time, WeatherTime) else 1.0
    if optics.rays is not None:
        return lit * optics.rays
    if (step := drawn_step(study, heliostats * instants)) > 1:
        return lit * DRAWN_RAYS / step
    finer = (PRECISION / (optics.precision or PRECISION)) ** (1.0 / 0.7)
    # A year usually needs 64 rays. Fewer than 2440 instants need more rays, and a flux map needs twice as many.
    wanted = 64 * max(1.0, 2440 / (lit * instants)) ** 0.8 * (2 if flux_cells(study) else 1) * finer
    return lit * min(max(DRAWN_RAYS, wanted), rays.MOST)


def is_series_traced(study: FieldEfficiencyStudy) -> bool:
    """Return True if the time series and the means of the field use the same rays."""
    output, few = study.output, instant_count(study.time) <= KEPT_INSTANTS
    return few and study.optics is not None and output.field_series and not output.time_series


def drawn_step(study: FieldEfficiencyStudy, pairs: int) -> int:
    """Return the step between the traced instants of a heliostat; 1 except in draws without a flux map.

    Each possible step samples all hours of the day.
    """
    optics: Any = study.optics
    if study.sample is None or flux_cells(study) or optics.rays is not None:
        return 1
    wanted = pairs * LIT * ((optics.precision or DRAWN_PRECISION) / SCATTER) ** 2
    return max(step for step in (1, 5, 7, 11, 23, 47, 71) if step <= max(1.0, wanted))


class TracedField(NamedTuple):
    """Field with optics at a result point, with the methods of `values.Field`."""

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
    #: Sums over all traced heliostats: each flux map with its unit [kW or MWh], and `sums` at each instant if time
    #: series or heat need these sums. None if no sums are needed. Each sum is an integer multiple of a power of two.
    #: Results are therefore bitwise equal for any order of heliostat blocks.
    light: dict[str, Any] | None = None

    def means(self, sun: Floats, start: int, stop: int, point: DesignPoint | None = None) -> Values:
        """Return unweighted means over the instants with the sun up, or the values at a design point."""
        months = self.months if point is None else np.array([point.month()])
        up, reflected = (sun[:, 2] > 0).astype(float), self.way.reflected(months, len(sun))
        scale = 1e-3 * (IRRADIANCE if point is None else point.dni) if up[0] else np.nan
        name = "flux_map" if point is not None or self._is_mapped(len(sun)) else ""
        made = self._trace(sun, up, up * reflected, start, stop, name, scale, summed=point is None)
        part = made.sums.transpose(3, 2, 0, 1)[:, 0] / (up.sum() or np.nan)
        return _efficiencies(part, self.transmitted[start:stop], self.reflection[start:stop], _mean(reflected, up))

    def energies(self, hours: Hours, start: int, stop: int) -> Values:
        """Return irradiation-weighted means [1] and energies [MWh]."""
        clean, reflected = self._reflected(hours)
        weight, name = hours.weight, "energy_flux_map"
        made = self._trace(hours.sun, weight, weight * reflected, start, stop, name, clean, hours.month, MONTHS)
        months, passed, mirror = (
            made.sums.transpose(3, 2, 0, 1),
            self.transmitted[start:stop],
            clean * self.reflection[start:stop],
        )
        sums, received = months.sum(axis=1), passed * mirror * months[rays.RECEIVED]
        sent = mirror * sums[rays.REFLECTED]
        tower = [rays.COSINE_PAST_TOWER] if self.scene.tower else []
        passed_on = sums[[rays.COSINE, *tower, rays.COSINE_UNSHADED, rays.OPTICAL]]
        left = (*passed_on, sent, passed * sent, received.sum(axis=0))
        energies = chain_of_energies(hours, self.area[start:stop], left, received)
        part = sums / (weight.sum() or np.nan)
        found = _efficiencies(part, passed, mirror, _mean(reflected, weight), energies)
        if self.available is None:
            return found
        return self.available.apply(self._replace(available=None, light=None), hours, found, start, stop)

    def series(
        self, sun: Floats, part: slice, hours: Hours | None, start: int, stop: int, sums: Floats | None
    ) -> Values:
        """Return field values, and heliostat values if rays are traced, at the instants in `part`. [1, kW, MW]

        If `hours` is given, the values include power. `sums` contains the sums over the heliostats at all instants. If
        `sums` is None, rays are traced.
        """
        weight = (sun[:, 2] > 0).astype(float) if hours is None else hours.weight
        reflected = self.way.reflected(self.months if hours is None else hours.month, len(sun))
        up, area = np.where(sun[:, 2] > 0, 1.0, np.nan), self.area[start:stop]
        first, last, _ = part.indices(len(sun))
        blocks, fields = list[Values](), [] if sums is None else [sums[:, first:last]]
        if sums is None:
            cells = flux_cells(self.study) if self._is_mapped(len(sun)) else None
            number, length = self._rays(sun, weight, weight * reflected, cells), max(1, PAIRS // len(area))
            for begin in range(first, last, length):
                end = min(begin + length, last)
                weights, group = np.stack((np.ones(len(sun)), reflected)), np.arange(len(sun)) - begin
                made = self._traced(
                    sun, begin, end, weights=weights, group=group, groups=end - begin, start=start, stop=stop,
                    rays=number, share=self.share, area=self.area,
                )  # fmt: skip
                fields.append(made.field)
                lit = made.sums.transpose(3, 2, 0, 1) * up[begin:end, np.newaxis, np.newaxis]
                blocks.append(_efficiencies(lit, self.transmitted[start:stop], self.reflection[start:stop]))
        found = {f"instantaneous_{name}": np.concatenate([block[name] for block in blocks])
                 for name, one in (blocks[0].items() if blocks else ()) if one.ndim > 1}  # fmt: skip
        mean = np.concatenate(fields, axis=1).transpose(2, 0, 1) * up[first:last] / area.sum()
        mean[[rays.REFLECTED, rays.RECEIVED]] *= reflected[first:last]
        found |= {f"field_instantaneous_{name}": each for name, each in _efficiencies(mean, 1.0, 1.0).items()}
        if hours is not None:
            for label in ("", "_error"):
                if blocks:
                    each = np.nan_to_num(found[f"instantaneous_total_efficiency{label}"])
                    found[f"instantaneous_power{label}"] = each * (hours.dni[part, np.newaxis] * 1e-3) * area
                total = np.nan_to_num(found[f"field_instantaneous_total_efficiency{label}"])
                found[f"field_power{label}"] = 1e-6 * (total * hours.dni[part] * area.sum())
        return found

    def maps(self) -> dict[str, Any]:
        """Return flux maps, peak and mean flux, and standard errors by variable name; NaN if the sun is down."""
        found, values, wanted = dict[str, Any](), self.way.values, self.study.output.flux_map
        for name, light in (self.light or {}).items():
            if name == "sums":
                continue
            flux, unit = light
            around = 2.0 * np.pi * values["radius"] if self.study.receiver.kind == "cylinder" else values["width"]
            pairs: dict[str, Any] = {name: rays.mean_error(flux)}
            if name == "flux_map":
                pairs |= {"peak_flux": rays.peak(flux), "mean_flux": rays.mean_error(flux.mean(axis=(1, 2)))}
            scale = unit * flux[0].size / (around * values["height_extent"])
            for of, (mean, error) in pairs.items():
                found |= {of: mean * scale, f"{of}_error": error * scale}
        if wanted is not None and wanted.limit is not None and "flux_map" in found:
            cells = found["flux_map"]
            found["power_above_limit"] = cells[cells > wanted.limit].sum() / (cells.sum() or np.nan)
        return found

    def limited(self, point: Point, sun: Floats, hours: Hours | None) -> TracedField:
        """Return the field with aim points that respect the flux limit.

        Aim points are chosen for the design point, or separately for each instant. Without a flux limit, the field is
        returned unchanged.

        Raises
        ------
        StudyError
            If the flux of a single heliostat exceeds the limit.
        """
        study, aim, design, scene = point.study, point.study.aim, point.study.design_point, self.scene
        if not is_limited(study):
            return self
        dni, months = np.full(len(sun), IRRADIANCE), self.months
        if design is not None and self.place[0] is not None:
            sun, dni, months = design.sun(self.place[0]), np.array([design.dni]), np.array([design.month()])
        elif hours is not None:
            sun, dni, months = hours.sun, hours.dni, hours.month
        share = np.multiply.outer(1e-3 * dni * self.way.reflected(months, len(sun)), self.share)
        limit = np.full((aim.flux_rows, aim.flux_columns), point["aim.limit"])
        for row, value in aim.limits or ():
            limit[int(row)] = value
        points = aim_grid(scene.receiver, scene.centre, aim.rows, aim.columns, np.radians(aim.azimuth_span))

        def chosen() -> dict[str, Floats]:
            found = dict[str, Any]()
            sizes = {"heliostat": len(scene.centre), "flux_row": aim.flux_rows, "flux_column": aim.flux_columns}
            for k in np.flatnonzero((sun[:, 2] > 0.0) & (dni > 0.0)):
                given = {"seed": study.optics.seed, "threads": self.threads}
                try:
                    values = limited_aims(scene, sun[k : k + 1], points, aim.safety * limit, share[k], **given)
                except ValueError as error:
                    raise StudyError(study.problem("aim.limit", f"{error}; increase it")) from None
                for name, (dims, *_) in VARIABLES.items():
                    found.setdefault(name, np.full((len(sun), *(sizes[dim] for dim in dims)), np.nan))[k] = values[name]
            return found

        return self.with_aims(self.way.inputs.last("aims", pickle.dumps((scene, sun, share, limit)), chosen))

    def with_aims(self, aims: Mapping[str, Floats]) -> TracedField:
        """Return the field with new aim points. `aims` contains the values of `VARIABLES` at one or all instants."""
        if not aims:
            return self
        target = targets(self.scene, np.stack([aims[f"aim_{axis}"] for axis in "xyz"], axis=-1))
        if varies(self.study):
            return self._replace(aims=aims, targets=target)
        mirrors = (*self.mirrors[:5], target[0], self.mirrors[6])
        return self._replace(aims=aims, mirrors=mirrors, scene=self.scene._replace(target=target[0]))

    def number_of_rays(self, hours: Hours) -> int:
        """Return the number of rays per heliostat and instant for energies; 0 for draws with a fixed number of rays."""
        weight, cells = hours.weight, flux_cells(self.study)
        if drawn_step(self.study, len(self.area) * len(hours.sun)) > 1:
            return 0
        return self._rays(hours.sun, weight, weight * self._reflected(hours)[1], cells)

    def _reflected(self, hours: Hours) -> tuple[float, Floats]:
        """Return the factors by which dirt reduces the reflectivity: a constant, and a relative value per instant.

        Result points that differ only in the constant factor use the same rays.
        """
        reflected = self.way.reflected(hours.month, len(hours.sun))
        even = reflected.size and reflected[0] > 0.0 and np.all(reflected == reflected[0])
        clean = float(reflected[0]) if even else 1.0
        return clean, reflected / clean

    @property
    def share(self) -> Floats:
        """Weight of each heliostat in the flux map: area times transmittance times reflectivity. [m2]"""
        return self.area * self.transmitted * self.reflection

    def _is_mapped(self, instants: int) -> bool:
        """Return True if the result contains a flux map for a period with this number of instants."""
        return self.study.weather is not None or (instants == 1 and self.study.design_point is None)

    def _trace(
        self, sun: Floats, weight: Floats, reflected: Floats, start: int, stop: int, name: str, scale: float,
        month: NDArray[np.int64] | None = None, groups: int = 1, summed: bool = True,
    ) -> rays.Traced:  # fmt: skip
        """Trace heliostats `start` to `stop` - 1, in one group or by month, and add their light to `light`.

        The flux map `name` is multiplied by `scale`. If `summed` is False, sums at each instant are omitted.
        """
        light: Any = self.light
        stride = drawn_step(self.study, len(self.area) * len(sun))
        cells = flux_cells(self.study) if light is not None and name else None
        summed = summed and "sums" in (light or {})
        share, area = self.share if cells or summed else None, self.area if summed else None

        def traced() -> rays.Traced:
            number = DRAWN_RAYS if stride > 1 else self._rays(sun, weight, reflected, cells)
            made = self._traced(
                sun, 0, len(sun), weights=np.stack((weight, reflected)), group=month, groups=groups, start=start,
                stop=stop, rays=number, cells=cells, share=share, area=area, stride=stride,
            )  # fmt: skip
            return made if stride == 1 else self._raked(made, sun, weight, reflected, month, slice(start, stop))

        if not self.key or (stop - start) * groups > SHARED:
            made = traced()
        else:  # points that differ only in reflectivity, soiling or attenuation use the same rays
            given = sun, weight, reflected, month, start, stop, share, self.number, self.coarse
            key, cache = (
                pickle.dumps((self.scene, self.targets, *given)),
                f"rays of {threading.get_ident()}, {len(sun)}",
            )
            made = self.way.inputs.last(cache, key, traced, 1 + budget_cases(self.study))
        if cells:
            light[name] = light.get(name, (0, 0.0))[0] + made.flux, scale * made.unit
        if summed:
            light["sums"] = light["sums"] + made.field
        return made

    def _traced(self, sun: Floats, first: int, last: int, **given: Any) -> rays.Traced:
        """Trace rays at the instants `first` to `last` - 1, with aim points for each instant if `targets` is given."""
        cuda = self.study.execution.device == "cuda"
        given |= {"seed": self.study.optics.seed, "threads": self.threads, "cuda": cuda}
        if self.targets is None or len(self.targets) != len(sun):
            return rays.trace(self.scene, sun, first=first, last=last, **given)
        parts = [
            rays.trace(self.scene._replace(target=self.targets[k]), sun, first=k, last=k + 1, **given)
            for k in range(first, last)
        ]
        sums, flux = (sum(getattr(part, name) for part in parts) for name in ("sums", "flux"))
        return parts[0]._replace(sums=sums, flux=flux, field=np.concatenate([part.field for part in parts], axis=1))

    def _raked(
        self, made: rays.Traced, sun: Floats, weight: Floats, reflected: Floats, group: NDArray[np.int64] | None,
        rows: slice,
    ) -> rays.Traced:  # fmt: skip
        """Scale the sums over the traced instants to all instants, first for each heliostat, then for each group.

        Each scale factor is the sum of cosines over all instants divided by the sum over the traced instants. The field
        sums at each instant assume that, within a group, the light on the receiver is proportional to the cosine.
        """
        sums, used = made.sums, np.flatnonzero(weight)
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
        """Return the number of rays per heliostat and instant for energies and for a flux map with `cells`."""
        optics = self.study.optics
        if self.number or optics.rays is not None:
            return self.number or max(1, int(optics.rays / self.coarse))
        precision, weights = self.coarse * (optics.precision or PRECISION), np.stack((weight, reflected))
        needed = partial(rays.rays_for, self.scene, sun, weights, precision=precision, cells=cells, share=self.share,
                         seed=optics.seed)  # fmt: skip
        key = (self.key, len(sun), self.coarse, len(self.area), cells)
        return self.way.inputs.last(f"rays {len(sun) > 1}", key, needed)


def _efficiencies(
    part: Floats, passed: Any, mirror: Any, reflected: float = 1.0, energies: Values | None = None
) -> Values:
    """Return efficiencies and `energies` with their standard errors, from sums with shape (quantities, ..., sets, n).

    `passed` is the transmittance of the air for each heliostat, and `mirror` is the reflectance of each heliostat.
    The second-to-last dimension of the energies is the ray set; energies common to all sets lack this dimension.
    """
    optical, light = (np.moveaxis(part[at], -2, 0) for at in (rays.OPTICAL, rays.LIGHT))
    exact = part[[rays.COSINE, rays.UNSHADED, rays.UNBLOCKED, rays.OPTICAL]]
    intercept, total = np.moveaxis(rays.intercept(optical, light), 0, -2), passed * mirror * part[rays.RECEIVED]
    values = (*exact, intercept, passed, mirror * reflected, total)
    found = dict(zip((*EFFICIENCIES, *LIGHT), values, strict=True)) | (energies or {})
    for name in [name for name, each in found.items() if np.ndim(each) > 1]:
        found[name], found[f"{name}_error"] = rays.mean_error(np.moveaxis(found[name], -2, 0))
    return found


def _mean(values: Floats, weights: Floats) -> float:
    """Return the weighted mean over the instants. The mean of equal values is exact."""
    if not values.size or np.all(values == values[0]):
        return float(values[0]) if values.size else np.nan
    return float(np.sum(values * weights) / (np.sum(weights) or np.nan))
