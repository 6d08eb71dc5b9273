"""The parameter points of a region as the kernels take them: receiver, mount, pivots, and the sun at days and hours.

Days and hours are two axes, on the solar or the civil clock.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from heliosweep.config.times import CivilTime, SolarTime
from heliosweep.config.zones import parse_timezone, to_utc
from heliosweep.families.misalignment.blocks import MOUNTS
from heliosweep.grid.clock import DATE, Instants, Label, solar_instants, window_count, window_positions
from heliosweep.grid.layout_axis import LayoutAxis, longest
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.sun import PLACE, sun_at, sun_attributes
from heliosweep.kernels.spots.receiver import Setting
from heliosweep.layouts.layout import Layout
from heliosweep.layouts.resolve import Layouts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.study import MisalignmentStudy
    from heliosweep.grid.regions import Region, Variable

#: Keys that label a result also where they are not swept.
LABELS = (
    *("site.latitude", "site.longitude", "sun.azimuth", "sun.elevation"),
    *(f"receiver.{key}" for key in ("azimuth", "tilt", "width", "height_extent", "height")),
    *(f"mount.{key}" for key in ("kind", "axis_azimuth", "mirror_offset", "axis_offset", "pedestal_height")),
    "heliostats.pivot_height",
)
_POSITIONS = {
    "x": "distance of the pivot east of the tower",
    "y": "distance of the pivot north of the tower",
    "z": "height of the pivot above the tower's base",
}
_DAY = {"long_name": "day of the year", "units": "1"}
_DECLINATION = {"long_name": "declination of the sun", "units": "degree"}
_SOLAR_HOUR = {"long_name": "solar time of day", "units": "h"}
_WALL_HOUR = {"long_name": "wall-clock time of day", "units": "h"}


@dataclass(frozen=True)
class DayHours:
    """The instants of a study: every hour of every day."""

    sizes: dict[str, int]
    """Lengths of ``day``, ``declination`` or ``date``, then of ``hour``: both 1 with a sun that stands still."""
    labels: dict[str, xr.DataArray]
    """Their coordinates, and on the civil clock ``utc`` over both and, where sites' clocks differ, ``site``; none with
    a sun that stands still."""
    flat: Instants | None
    """The same instants day by day along ``time``; None with a sun that stands still."""

    @property
    def count(self) -> int:
        """Number of instants."""
        days, hours = self.sizes.values()
        return days * hours


def swept_dims(study: MisalignmentStudy) -> tuple[str, ...]:
    """Swept dimensions of a study, in the order of its result."""
    return (*(() if study.sites is None else ("site",)), *(dim.name for dim in study.dimensions()))


def instant_sizes(study: MisalignmentStudy) -> dict[str, int]:
    """Lengths of the dimensions of the days and the hours, without making them."""
    time = study.time
    if time is None:
        return {"day": 1, "hour": 1}
    if isinstance(time, SolarTime):
        days = time.days if time.declination is None else time.declination
        assert days is not None
        name = "day" if time.declination is None else "declination"
        return {name: len(days), "hour": time.count() // len(days)}
    start, stop, step = time.window_seconds()
    return {"date": len(time.date_list()), "hour": window_count((stop - start) / step, time.sampling)}


def day_hours(parameters: Parameters) -> DayHours:
    """The instants of a study over a region of its result."""
    study: MisalignmentStudy = parameters.study  # type: ignore[assignment]
    sizes, time = instant_sizes(study), study.time
    if time is None:
        return DayHours(sizes, {}, None)
    if isinstance(time, SolarTime):
        declinations = time.declinations()
        outer = time.day_numbers() if declinations is None else declinations
        name = next(iter(sizes))
        labels = {
            name: xr.DataArray(outer, dims=name, attrs=_DAY if name == "day" else _DECLINATION),
            "hour": xr.DataArray(time.solar_hours(), dims="hour", attrs=_SOLAR_HOUR),
        }
        return DayHours(sizes, labels, solar_instants(time))
    # Made for all sites: whether sites share them must not depend on the region.
    tables = [wall_clock(time, zone) for zone in Parameters(study).timezones()]
    attrs = {"long_name": "universal time"}
    if all(np.array_equal(table, tables[0], equal_nan=True) for table in tables):
        utc = xr.DataArray(tables[0], dims=tuple(sizes), attrs=attrs)
    else:
        utc = xr.DataArray(np.stack(tables)[parameters.part("site")], dims=("site", *sizes), attrs=attrs)
    dates = np.array(time.date_list(), dtype="datetime64[ns]")
    labels = {
        "date": xr.DataArray(dates, dims="date", attrs=DATE),
        "hour": xr.DataArray(_wall_seconds(time) / 3600, dims="hour", attrs=_WALL_HOUR),
        "utc": utc,
    }
    flat = Label((*map(str, utc.dims[:-2]), "time"), utc.to_numpy().reshape(*utc.shape[:-2], -1), {})
    return DayHours(sizes, labels, Instants({"utc": flat}, "civil"))


def sun_of(parameters: Parameters, instants: DayHours) -> NDArray[np.float64]:
    """Unit vectors towards the sun at every point of a region, shape (P or 1, T, 3): east, north, up; day by day."""
    if instants.flat is None:
        azimuth, elevation = parameters.values("sun.azimuth"), parameters.values("sun.elevation")
        assert azimuth is not None
        assert elevation is not None
        around, up = np.radians(azimuth.ravel()), np.radians(elevation.ravel())
        vectors = np.stack((np.cos(up) * np.sin(around), np.cos(up) * np.cos(around), np.sin(up)), axis=-1)
        return vectors[:, np.newaxis]
    dims = parameters.site_dims
    shape = tuple(length if dim in dims else 1 for dim, length in parameters.sizes.items())
    columns = [parameters.values(key) for key in PLACE]
    found = np.empty((*shape, instants.count, 3))
    for index in np.ndindex(shape):
        here = instants.flat.at_sites(index[list(parameters.sizes).index("site")]) if "site" in dims else instants.flat
        found[index] = sun_at(here, [None if column is None else float(column[index]) for column in columns])
    if any(length > 1 for length in shape):
        found = np.array(np.broadcast_to(found, (*parameters.sizes.values(), instants.count, 3)))
    return found.reshape(-1, instants.count, 3)


@lru_cache(maxsize=16)
def wall_clock(time: CivilTime, timezone: str) -> NDArray[np.datetime64]:
    """Universal time of each hour of each date on a wall clock, shape (dates, hours).

    NaT where a change of the clock leaves out the hour; of an hour that occurs twice, the first. Time zones are offsets
    such as ``+08:00`` or IANA names.
    """
    zone = parse_timezone(timezone)
    seconds = _wall_seconds(time)
    table = np.empty((len(time.date_list()), seconds.size), "datetime64[ns]")
    for row, date in zip(table, time.date_list(), strict=True):
        ends = [to_utc(date, float(second), zone) for second in (seconds[0], seconds[-1])]
        offsets = {utc.astimezone(zone).utcoffset() if is_shown else None for utc, is_shown in ends}
        offset = offsets.pop() if len(offsets) == 1 else None
        if offset is not None:
            since = np.round((seconds - offset.total_seconds()) * 1e9).astype("timedelta64[ns]")
            row[:] = np.datetime64(date, "ns") + since
        else:
            each = (to_utc(date, float(second), zone) for second in seconds)
            row[:] = [np.datetime64(utc.replace(tzinfo=None) if is_shown else "NaT", "ns") for utc, is_shown in each]
    return table


def _wall_seconds(time: CivilTime) -> NDArray[np.float64]:
    """Hours of a date on the wall clock, in seconds from midnight."""
    start, stop, step = time.window_seconds()
    return start + step * window_positions((stop - start) / step, time.sampling)


class Positions(LayoutAxis):
    """Pivots at the positions of a study, east, north and up of the tower's base [m], as one layout."""

    def __init__(self, positions: Sequence[tuple[float, float, float]]) -> None:
        self.dims, self._shape, self.size = (), (), len(positions)
        self._layouts = [Layout(*np.array(positions, np.float64).T)]

    def coordinates(self) -> dict[str, xr.DataArray]:
        """``heliostat``, ``x``, ``y`` and ``z``."""
        number = "number of the heliostat: its place among the positions, from 0"
        labels = {"heliostat": self.numbers.assign_attrs(long_name=number)}
        for name, meaning in _POSITIONS.items():
            labels[name] = self.column(name).assign_attrs(long_name=meaning, units="m")
        return labels


def places_of(study: MisalignmentStudy) -> LayoutAxis:
    """Layouts of a study, or its positions."""
    return LayoutAxis(study) if study.layout is not None else Positions(study.heliostats.positions or ())


def heliostat_count(study: MisalignmentStudy) -> int:
    """Heliostats of the longest layout of a study, without making more layouts than that takes."""
    return longest(study) if study.layout is not None else len(study.heliostats.positions or ())


def place_bytes(study: MisalignmentStudy) -> int:
    """Size of the coordinates of the heliostats. [bytes]."""
    return 8 * heliostat_count(study) * (4 if study.layout is None else 6 * len(Layouts(study)))


def coordinates_of(study: MisalignmentStudy, keys: Sequence[str] = ()) -> xr.Dataset:
    """Coordinates that the results of all modes have, and what a result says of its sun, as attributes.

    Dotted `keys` label the result besides `LABELS`.
    """
    parameters = Parameters(study)
    labels = {
        **parameters.coordinates((*LABELS, *keys)),
        **places_of(study).coordinates(),
        **day_hours(parameters).labels,
    }
    attrs = {"sun_position": "as given"} if study.time is None else sun_attributes(study.time)
    return xr.Dataset(coords=labels, attrs=attrs)


class Points(NamedTuple):
    """P parameter points, H heliostats and T instants of a region."""

    parameters: Parameters
    """The region."""
    setting: Setting
    """Receiver and mount, shape (P,)."""
    sun: NDArray[np.float64]
    """Unit vectors towards the sun, shape (P or 1, T, 3)."""
    pivots: NDArray[np.float64]
    """Pivots relative to the tower's base, shape (P, H, 3); NaN where a shorter layout is padded. [m]"""
    numbers: NDArray[np.int64]
    """Numbers of the heliostats in the whole result, shape (H,)."""
    instants: DayHours
    """The instants, day by day."""

    @classmethod
    def of(cls, study: MisalignmentStudy, places: LayoutAxis, region: Region) -> Points:
        """Points of a region along swept dimensions and ``heliostat``."""
        parameters = Parameters(study, region)
        instants = day_hours(parameters)
        span = range(places.size)[region.get("heliostat", slice(None))]
        sun, pivots = sun_of(parameters, instants), _pivots(parameters, places, span)
        return cls(parameters, _setting(parameters), sun, pivots, np.arange(span.start, span.stop), instants)

    def values(self, key: str) -> NDArray[Any]:
        """Values of a key that the study gives, shape (P,)."""
        return _values(self.parameters, key)

    def only(self, some: NDArray[np.int64]) -> Points:
        """Some of the points, by their numbers."""
        setting = Setting(*(values[some] for values in self.setting))  # type: ignore[arg-type]
        sun = self.sun if len(self.sun) == 1 else self.sun[some]
        return self._replace(setting=setting, sun=sun, pivots=self.pivots[some])

    @property
    def absent(self) -> NDArray[np.bool_]:
        """True where a shorter layout has no heliostat, shape (P, H)."""
        return np.isnan(self.pivots[..., 0])

    def labelled(
        self, variables: Mapping[str, Variable], values: Mapping[str, NDArray[Any]], **inner: int
    ) -> dict[str, tuple[tuple[str, ...], NDArray[Any]]]:
        """Arrays of the kernels as variables of the region.

        `values` are in the order of the dimensions that `variables` state; the swept ones and the instants may be
        joined. `inner` has the lengths of dimensions beside the swept ones, the heliostats and the instants.
        """
        lengths = {**self.parameters.sizes, "heliostat": self.numbers.size, **self.instants.sizes, **inner}
        found = {}
        for name, array in values.items():
            dims = variables[name].dims
            shape = [lengths[dim] for dim in dims]
            found[name] = dims, np.reshape(array, shape).astype(variables[name].dtype, copy=False)
        return found


def codes_of(names: NDArray[Any], known: Mapping[str, str]) -> NDArray[np.int64]:
    """Numbers by which the kernels know names: their places in a table of `blocks`."""
    codes = {name: code for code, name in enumerate(known)}
    return np.array([codes[str(name)] for name in names], np.int64)


def _values(parameters: Parameters, key: str, default: float | None = None) -> NDArray[Any]:
    """Values of a key at every point, shape (P,), contiguous; a default where the study gives it no value."""
    values = parameters.values(key)
    if values is None:
        if default is None:
            raise KeyError(key)
        values = np.broadcast_to(default, tuple(parameters.sizes.values()))
    return np.array(values).reshape(-1)


def _setting(parameters: Parameters) -> Setting:
    """Receiver and mount of every point."""

    def each(key: str) -> NDArray[np.float64]:
        return _values(parameters, key)

    return Setting(
        np.radians(each("receiver.azimuth")),
        np.radians(each("receiver.tilt")),
        0.5 * each("receiver.width"),
        0.5 * each("receiver.height_extent"),
        each("receiver.height"),
        codes_of(each("mount.kind"), MOUNTS),
        np.radians(_values(parameters, "site.latitude", 0.0)),
        np.radians(each("mount.axis_azimuth")),
        *(each(f"mount.{key}") for key in ("mirror_offset", "axis_offset", "pedestal_height")),
    )


def _pivots(parameters: Parameters, places: LayoutAxis, span: range) -> NDArray[np.float64]:
    """Pivots of some of the heliostats at every point, shape (P, H, 3). [m]"""
    shape = tuple(length if dim in places.dims else 1 for dim, length in parameters.sizes.items())
    bases = np.full((*shape, len(span), 3), np.nan)
    for index in np.ndindex(shape):
        layout = places.at(parameters.position(index))
        here = slice(span.start, min(span.stop, len(layout)))
        if here.start < here.stop:
            columns = [column[here] for column in (layout.x, layout.y, layout.z)]
            bases[index][: here.stop - here.start] = np.stack(columns, axis=-1)
    height = _values(parameters, "heliostats.pivot_height", 0.0)
    pivots = np.array(np.broadcast_to(bases, (*parameters.sizes.values(), len(span), 3))).reshape(-1, len(span), 3)
    pivots[..., 2] += height[:, np.newaxis]
    return pivots
