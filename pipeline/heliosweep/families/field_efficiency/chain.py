"""Light path from the mirrors to the receiver: ray tracing scene, losses in the air, and reflectivity."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from functools import partial
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config import Distribution, read_profile
from heliosweep.energy import transmittance
from heliosweep.families.field_efficiency.heat import read_losses
from heliosweep.families.field_efficiency.light_files import TURN_COLUMNS, SlopeMap, read_calibration, read_slopes
from heliosweep.families.field_efficiency.optics import KEYS
from heliosweep.families.mount_errors import standard_deviates, widths_of
from heliosweep.grid.sun import Instants
from heliosweep.kernels import rays, sunshapes
from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.field.packets import SPINNING_ELEVATION
from heliosweep.kernels.mounts import ERRORS

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
    from heliosweep.layouts.layout import Layout


#: Maximum number of result points for which ray sums at each instant are kept in memory.
KEPT = 4


class Inputs:
    """Contents of a study's optical input files. Each file is read once.

    Threads share this object. A thread may replace a cached value but must not modify it.
    """

    def __init__(self, study: FieldEfficiencyStudy) -> None:
        files = study.files()

        def read(key: str, reader: Callable[..., Any]) -> dict[str, Any]:
            return {name: reader(study.resolve(name), name) for name in files.get(f"optics.{key}", ())}

        self.sun: Any = next((sunshapes.table(*table) for table in read("sun_shape.file", read_profile).values()), None)
        self.maps: dict[str, SlopeMap] = {
            PurePath(name).name: found._replace(slope=rays.filled(found.slope))
            for name, found in read("slope_map", read_slopes).items()
        }
        self.mounts = next(iter(read("mount_errors.calibration", read_calibration).values()), None)
        self.losses = next(
            (read_losses(study.resolve(name), name) for name in files.get("receiver.thermal_losses.file", ())), None
        )
        self._last: dict[str, tuple[tuple[Any, Any], ...]] = {}
        self._series: dict[tuple[int, ...], Future[Any]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without cached values, which workers recompute."""
        return {**vars(self), "_last": {}, "_series": {}}

    @contextmanager
    def series_from(self, key: tuple[int, ...]) -> Iterator[Future[Any]]:
        """Yield a future that receives the ray sums of a field at each instant. `series_of` returns its result."""
        self._series[key] = future = Future[Any]()
        for old in list(self._series)[:-KEPT]:
            self._series.pop(old, None)  # another thread may have removed it
        try:
            yield future
        finally:
            if not future.done():
                future.set_result(None)

    def series_of(self, key: tuple[int, ...]) -> Any:
        """Return the ray sums at each instant if they were computed together with the means of a point, or None."""
        future = self._series.get(key)
        return None if future is None else future.result()

    def last(self, name: str, key: Any, make: Callable[[], Any], depth: int = 1) -> Any:
        """Return the value cached under a name and key. If no value is cached, compute it with `make` and cache it."""
        kept = self._last.get(name, ())
        value = next((pair for pair in kept if pair[0] == key), None) or (key, make())
        self._last[name] = (value, *(pair for pair in kept if pair[0] != key))[:depth]
        return value[1]

    def sun_of(self, values: Mapping[str, Any]) -> sunshapes.SunShape:
        """Return the sun shape at a result point. `values` maps the last part of each key to its value."""
        ratio = [values["circumsolar_ratio"]] * (values["kind"] == "buie")
        return self.sun if values["kind"] == "table" else getattr(sunshapes, values["kind"])(*ratio)


def _mount_errors(values: Mapping[str, Any], inputs: Inputs, layout: Layout) -> Floats:
    """Return the mount errors of all heliostats. The shape is (N, 6), or (0, 6) if all errors are zero. [rad]"""
    if inputs.mounts is not None:
        found = values["scale"] * inputs.mounts.of(layout)
        return found if found.any() else found[:0]
    given = [values[name] for name in ERRORS]
    if given[0] is None:
        return np.empty((0, len(ERRORS)))
    seed = int(values["mount_seed"] or 0)
    key = str(given), layout.numbers.tobytes(), seed
    make = partial(standard_deviates, given, layout.numbers, 1, seed)
    drawn = inputs.last(f"mounts of {threading.get_ident()}", key, make)[:, 0]
    mean = [error.mean if isinstance(error, Distribution) else error for error in given]
    errors: Floats = 1e-3 * (np.array(mean, np.float64) + values["scale"] * widths_of(given) * drawn)
    return errors if errors.any() else errors[:0]


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


#: Mirror centres (x, y, z), half widths, half heights and aim points, all in m, and the code of the tracking method.
Geometry = tuple[Floats, Floats, Floats, Floats, Floats, Any, int]


class Way(NamedTuple):
    """Optical path from the mirrors to the receiver at a point of the result."""

    #: Study with an `optics` block.
    study: Any
    #: Contents of the study's optical files.
    inputs: Inputs
    #: Layout with all heliostats of the field.
    layout: Layout
    #: Values of `optics.KEYS`, named by the last part of each key.
    values: Mapping[str, Any]

    def spot(self, slant: Floats, sides: Floats) -> Floats:
        """Return the standard deviation of each heliostat's on-axis image, shape (N,), from the HFLCAL model. [m]

        Measured slopes are treated as random slope errors. If measured slopes include focus and canting, only their
        deviations from a mirror focused at the slant range count as errors.
        """
        errors, blur = self.errors(), np.where(self._ideal, slant * self.curve(slant).sum(axis=1) - 1.0, 0.0)
        variance = self.inputs.sun_of(self.values).spread + errors.specularity**2
        variance = variance + 2.0 * (errors.slope_u**2 + errors.slope_v**2 + self._roughness(slant))
        return np.asarray(np.sqrt(slant**2 * variance + sides[:, 0] * sides[:, 1] * blur**2 / 16.0))

    def _roughness(self, slant: Floats) -> Floats:
        """Return the mean square of each heliostat's measured slopes, shape (N,). [rad^2]"""
        if (found := self.map) is None:
            return np.zeros(len(slant))
        place = np.stack(np.meshgrid(found.x, found.y), axis=-1) * found.plane
        square, turn, flat = (
            np.sum(product, axis=-1).mean(axis=(-2, -1)) for product in (found.slope**2, found.slope * place, place**2)
        )
        number, bend = found.numbers(self.layout), 0.5 / slant
        return np.where(number < 0, 0.0, square[number] + 2.0 * bend * turn[number] + bend**2 * flat)

    @property
    def receiver(self) -> rays.Receiver:
        """Receiver surface for the ray tracer."""
        values, centre = self.values, (0.0, 0.0, float(self.values["height"]))
        if self.study.receiver.kind == "cylinder":
            return rays.cylinder(centre, float(values["radius"]), float(values["height_extent"]))
        azimuth, tilt = (math.radians(values[key] or 0.0) for key in ("azimuth", "tilt"))
        return rays.rectangle(centre, azimuth, tilt, float(values["width"]), float(values["height_extent"]))

    def errors(self) -> rays.Errors:
        """Return the standard deviations of the random errors. Slope errors have the shape (N,). [rad]"""
        values, axes = self.values, [self.values[f"slope_error_{axis}"] for axis in ("horizontal", "vertical")]
        if axes[0] is None:
            axes = [values["slope_error"]] * 2
        slopes = [np.where(self.mapped, 0.0, self.layout.values("slope_error", slope)) for slope in axes]
        u, v = (1e-3 * np.hypot(slope, values["tracking_error"]) for slope in slopes)
        return rays.Errors(u, v, 1e-3 * float(values["specularity_error"]))

    @property
    def map(self) -> SlopeMap | None:
        """Slope maps at this result point; None if the study has none."""
        name = self.values["slope_map"]
        return None if name is None else self.inputs.maps[PurePath(name).name]

    @property
    def mapped(self) -> NDArray[np.bool_]:
        """True for heliostats with a slope map, shape (N,)."""
        return np.zeros(len(self.layout), bool) if self.map is None else self.map.numbers(self.layout) >= 0

    def curve(self, slant: Floats) -> Floats:
        """Return 1 / (2 f) along each mirror's width and height, where f is the focal length, shape (N, 2). [1/m]"""
        found: Floats = 0.5 / self.layout.focal_lengths(self.values["focus"], slant)
        return found * self._ideal[:, np.newaxis]

    @property
    def _ideal(self) -> NDArray[np.bool_]:
        """False for heliostats whose slope map includes focus and canting; shape (N,)."""
        return ~self.mapped | (self.map is None or not self.map.plane)

    def reflection(self) -> Floats:
        """Reflectivity times cleanliness of each heliostat, shape (N,). [1]"""
        names = ("reflectivity", "cleanliness")
        clear, clean = (self.layout.values(name, self.values[name], 1.0) for name in names)
        return clear * clean

    def scene(self, mirrors: Geometry) -> rays.Scene:
        """Return the heliostats and the receiver in the form that the ray tracer needs.

        Parameters
        ----------
        mirrors : tuple
            Mirror centres (x, y, z), half widths, half heights and aim points, all in m, and the code of the tracking
            method.
        """
        values, layout = self.values, self.layout
        centre, sides = np.stack(mirrors[:3], axis=1), 2.0 * np.stack(mirrors[3:5], axis=1)
        target, tracking, grid = mirrors[5], mirrors[6], self.study.heliostat.facets
        slant = slant_of(mirrors)
        facets = rays.Facets(1, 1, 0.0) if grid is None else rays.Facets(grid.columns, grid.rows, float(grid.gap))
        cant = self._ideal * 0.5 / slant if values["canting"] == "on_axis" else np.zeros(len(slant))
        turn = [layout.columns.get(name, np.zeros(len(layout))) for name in TURN_COLUMNS]
        return rays.Scene(
            centre, target, sides, self.curve(slant), cant,
            1e-3 * np.stack(turn, axis=1).astype(np.float64), facets, tracking, self.errors(),
            self.inputs.sun_of(values), self.receiver,
            _mount_errors(values, self.inputs, layout), self._slopes(sides[0], tracking), None,
        )  # fmt: skip

    def _slopes(self, sides: Floats, tracking: int) -> rays.SlopeMap | None:
        """Return the slope maps along the mirror axes u and v; None if the study has none.

        If some heliostats have no map, a map of zeros is appended for them.
        """
        found = self.map
        if found is None:
            return None
        x, y, slope, number = found.x, found.y, found.slope, found.numbers(self.layout)
        if tracking == SPINNING_ELEVATION:  # u points to the left and v down if the sun is above the target
            x, y, slope = -x[::-1], -y[::-1], -slope[:, ::-1, ::-1]
        x, y = (np.pad(at, 1, "reflect", reflect_type="odd") for at in (x, y))  # linear extrapolation beyond the edges
        slope = np.pad(slope, ((0, int((number < 0).any())), (0, 0), (0, 0), (0, 0)))
        slope = np.pad(slope, ((0, 0), (1, 1), (1, 1), (0, 0)), "reflect", reflect_type="odd")
        return rays.SlopeMap(x, y, slope, number % len(slope), not found.fits(*sides))

    def transmitted(self, mirrors: Geometry, place: Sequence[Any]) -> Floats:
        """Return the air transmittance for each heliostat, shape (N,). `place` contains the values of `PLACE`. [1]"""
        values = self.values
        given = {key: values[key] for key in ("visibility", "water_vapour") if values[key] is not None}
        altitude = place[2] if values["altitude"] is None else values["altitude"]
        given |= {"altitude": float(altitude or 0.0), "receiver_height": float(values["height"])}
        return transmittance(slant_of(mirrors), values["attenuation"], **given)

    def reflected(self, months: NDArray[np.int64] | None, count: int) -> Floats:
        """Return the factor for the month and the soiling by which `reflection` is multiplied, shape (count,). [1]"""
        values, monthly = self.values, self.study.optics.cleanliness_by_month
        clean = np.ones(1) if monthly is None else np.array(monthly)[months]
        if values["rate"] is not None:  # with staggered washing, the mean soiling is half the maximum
            clean = clean * (1.0 - values["rate"] * values["washing_interval"] / 2.0)
        return np.broadcast_to(clean, count)


def slant_of(mirrors: Geometry) -> Floats:
    """Return the distance from each mirror to its aim point. [m]"""
    return np.sqrt(np.sum((mirrors[5] - np.stack(mirrors[:3], axis=1)) ** 2, axis=1))


def values_of(given: Sequence[Any]) -> dict[str, Any]:
    """Map the last part of each key in `optics.KEYS` to its value. The mount error seed is named `mount_seed`."""
    names = ["mount_seed" if key == "optics.mount_errors.seed" else key.rpartition(".")[2] for key in KEYS]
    return dict(zip(names, given, strict=True))
