"""Direct normal irradiance (DNI) and wind at the instants of a study, and checks of weather files."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config import KEYS_OF, CivilTime, Fault, Sweep, WeatherFile, WeatherTime, site_table, weather_of
from heliosweep.errors import Problem
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.sun import MAX_INSTANTS, PLACE, Suns, civil_intervals, instant_count, instants_of, sun_at
from heliosweep.kernels.compiled import Floats, Integers
from heliosweep.kernels.sun import refracted
from heliosweep.lazy import pd, pvlib
from heliosweep.sun import direction

#: Operating limits of a field. A lost instant is attributed to the first violated limit in this order.
CAUSES = ("dni", "sun_elevation", "wind_speed")
#: Study keys that set the limits.
LIMITS = tuple(f"limits.{cause}" for cause in CAUSES)

#: Number of days in a year before each month.
_MONTHS = np.array([0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334])


class Irradiance(NamedTuple):
    """Irradiance and wind at one site, at the instants of the study.

    Parameters
    ----------
    dni : ndarray, shape (T,)
        Mean direct normal irradiance over each interval; for a clear sky, 0 if the sun is down. [W/m2]
    hours : ndarray, shape (T,)
        Length of the interval of each instant, including the time when the sun is down. [h]
    month : ndarray of int, shape (T,)
        Month (1 to 12) of the instant on the clock of the weather file, or of the civil date.
    wind : ndarray, shape (T,)
        Wind speed; NaN if unknown. [m/s]
    """

    dni: Floats
    hours: Floats
    month: Integers
    wind: Floats


class Weathers:
    """Irradiance at the points of a region, computed once for successive points with equal weather.

    If the region is limited along ``time``, only the instants within the region are included. If the time series of
    several sites or files have different lengths, the instants that pad the shorter series have a length of 0 h.
    """

    def __init__(self, parameters: Parameters) -> None:
        self._study: Any = parameters.study
        self._span, self._instants = parameters.part("time"), instants_of(parameters)
        dim = self._instants.dim
        self._axis = list(parameters.sizes).index(dim) if dim in parameters.sizes else None
        files = weather_of(parameters.study)
        each: Sequence[Any] = files or Parameters(parameters.study).timezones()
        self._each = each[parameters.part(dim)] if len(each) > 1 else each
        self._sky = [parameters.values(f"weather.clear_sky.{key}") for key in ("model", *KEYS_OF)]
        self._factor = parameters.values("weather.dni_factor")
        self._last: tuple[object, Any] = (None, None)

    def at(self, index: tuple[int, ...], place: Sequence[float | None]) -> Irradiance:
        """Return the irradiance at the point with the given index and values of `sun.PLACE`."""
        row = 0 if self._axis is None else index[self._axis]
        sky: tuple[Any, ...] = tuple(None if column is None else column[index] for column in self._sky)
        key = (row, tuple(place), sky)
        if self._last[0] != key:
            source, here = self.source(index), self._instants.isel({self._instants.dim: row})
            if isinstance(source, str):
                hours, month = civil_intervals(self._study.time, source)
                dni = clear_sky(here.labels["utc"].values, sun_at(here, place), place, *sky)
                made = dni, hours, month, np.empty(0)
            else:
                made = source.dni, np.full(len(source), source.hours), source.month, source.wind
            padded = (np.pad(one, (0, self._instants.size - one.size), constant_values=gap)
                      for one, gap in zip(made, (0.0, 0.0, 1, np.nan), strict=True))  # fmt: skip
            self._last = key, Irradiance(*(one[self._span] for one in padded))
        found: Irradiance = self._last[1]
        return found if self._factor is None else found._replace(dni=found.dni * self._factor[index])

    def source(self, index: tuple[int, ...]) -> WeatherFile | str:
        """Return the weather file at a point or, for a clear sky, the time zone."""
        return self._each[0 if len(self._each) == 1 or self._axis is None else index[self._axis]]


def clear_sky(
    utc: NDArray[np.datetime64],
    sun: Floats,
    place: Sequence[float | None],
    model: str,
    linke_turbidity: float | None = None,
    aerosol_optical_depth: float | None = None,
    precipitable_water: float | None = None,
) -> Floats:
    """Return the direct normal irradiance under a cloudless sky, shape (T,); 0 if the sun is down. [W/m2]

    Parameters
    ----------
    utc : ndarray of datetime64, shape (T,)
        Universal times. The irradiance is 0 at NaT.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun without refraction, which this function adds. [1]
    place : sequence
        Latitude and longitude [deg] and altitude [m]: the first three values of `sun.PLACE`.
    model : str
        ``ineichen`` or ``simplified_solis`` from pvlib, ``meinel`` or ``ashrae``. ``meinel`` is 1367 W/m2 *
        0.7^(AM^0.678), where AM is the relative air mass of Kasten and Young (1989). ``ashrae`` is A exp(-B /
        sin(elevation)), where A and B are values for the United States, interpolated between the 21st of each month.
    linke_turbidity : float, optional
        Turbidity for ``ineichen`` (default: from pvlib's global monthly table). [1]
    aerosol_optical_depth, precipitable_water : float, optional
        Optical depth at 700 nm (default: 0.1) [1] and precipitable water (default: 1) [cm], for ``simplified_solis``.
    """
    dni = np.zeros(utc.size)
    up = np.flatnonzero(sun[:, 2] > 0)  # NaN is excluded
    if not up.size:
        return dni
    atmosphere, clearsky = pvlib.atmosphere, pvlib.clearsky
    latitude, longitude, altitude = (float(value or 0.0) for value in place[:3])
    date, pressure = utc[up].astype("datetime64[D]"), float(atmosphere.alt2pres(altitude))
    day = (date - date.astype("datetime64[Y]")).astype(float) + 1.0  # day of the year, from 1
    sine = np.clip(refracted(sun[up], pressure, 12.0)[:, 2], -1.0, 1.0)
    elevation, extra = np.degrees(np.arcsin(sine)), pvlib.irradiance.get_extra_radiation(day)
    relative = atmosphere.get_relative_airmass(90.0 - elevation)
    if model == "ineichen":
        turbidity: Any = linke_turbidity
        if turbidity is None:  # pvlib's monthly table, interpolated to days of the year
            dates = pd.DatetimeIndex([f"2021-{month:02}-15" for month in range(1, 13)])
            monthly = clearsky.lookup_linke_turbidity(dates, latitude, longitude, interp_turbidity=False)
            middles = _MONTHS + np.diff([*_MONTHS, 365]) / 2
            turbidity = np.interp(day, middles, monthly.to_numpy(float), period=365.0)
        absolute = atmosphere.get_absolute_airmass(relative, pressure)
        found = clearsky.ineichen(90.0 - elevation, absolute, turbidity, altitude, extra)["dni"]
    elif model == "simplified_solis":
        aerosol = 0.1 if aerosol_optical_depth is None else aerosol_optical_depth
        water = 1.0 if precipitable_water is None else precipitable_water
        found = clearsky.simplified_solis(elevation, aerosol, water, pressure, extra)["dni"]
    elif model == "meinel":
        found = 1367.0 * 0.7 ** (relative**0.678)
    else:
        table = (  # A and B for the 21st of each month (ASHRAE Handbook of Fundamentals 1972, table 1 of chapter 26)
            (1230, 1215, 1186, 1136, 1104, 1088, 1085, 1107, 1151, 1192, 1221, 1233),
            (0.142, 0.144, 0.156, 0.180, 0.196, 0.205, 0.207, 0.201, 0.177, 0.160, 0.149, 0.142),
        )
        a, b = (np.interp(day, _MONTHS + 21.0, values, period=365.0) for values in table)
        found = a * np.exp(-b / sine)
    dni[up] = np.nan_to_num(np.asarray(found))
    return dni


def used(irradiance: Irradiance, sun: Floats, limits: Sequence[float | None]) -> tuple[NDArray[np.bool_], Integers]:
    """Select the instants at which the field operates, and determine the cause of each lost instant.

    Parameters
    ----------
    irradiance : Irradiance
        Irradiance and wind at the instants.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun. [1]
    limits : sequence of float or None
        Limits in the order of `CAUSES`: minimum irradiance [W/m2], minimum elevation of the sun [deg] and maximum wind
        speed [m/s]. None means no limit. An unknown wind speed is treated as within the limit.

    Returns
    -------
    works : ndarray of bool, shape (T,)
        True if the sun is up and all values are within the limits.
    cause : ndarray of int, shape (T,)
        Index of the first violated limit in `CAUSES` if the sun is up, otherwise -1.
    """
    up = sun[:, 2] > 0
    elevation = np.degrees(np.arcsin(np.clip(sun[:, 2], -1.0, 1.0)))
    tests = (irradiance.dni.__lt__, elevation.__lt__, irradiance.wind.__gt__)
    cause = np.full(up.size, -1)
    for number, (breaks, limit) in reversed(list(enumerate(zip(tests, limits, strict=True)))):
        if limit is not None:
            cause[up & breaks(limit)] = number
    return up & (cause < 0), cause


#: Maximum distance of a weather station from its site. [km]
FARTHEST = 50.0
#: Time shifts of the sun for which the closure GHI = DHI + DNI cos z is tested. [min]
SHIFTS = np.arange(-60, 61)
#: A time shift is reported if the closure error relative to GHI exceeds the first value, and if its ratio to the
#: smallest error exceeds the second value.
CLOSURE_ERROR, CLOSURE_RATIO = 0.005, 1.6
#: Maximum number of sweep points that are checked.
MAX_POINTS = 200


def weather_faults(study: Any) -> Iterator[Fault]:
    """Yield contradictions between the blocks ``weather``, ``limits`` and ``time``, without reading weather files."""
    weather, limits, on_its_clock = study.weather, study.limits, isinstance(study.time, WeatherTime)
    file, sky = (weather.file, weather.clear_sky) if weather is not None else (None, None)
    if on_its_clock and file is None:
        yield Fault("needs a weather file for its intervals: give weather: {file: ...}", ("time", "clock"))
    for wrong, message, key, show_value in (
        (file and not on_its_clock, "has its own intervals: give time: {clock: weather}", "weather.file", False),
        (sky is not None and file is None and not isinstance(study.time, CivilTime),
         "needs calendar dates: give time: {clock: civil, ...}", "weather.clear_sky", False),
        (limits is not None and weather is None,
         "need 'weather': add it, or remove the limits", "limits", False),
        (limits is not None and limits.wind_speed is not None and sky is not None,
         "is unknown for a clear sky: remove it", "limits.wind_speed", True),
    ):  # fmt: skip
        if wrong:
            yield Fault(message, tuple(key.split(".")), show_value=show_value)


def check_weather(study: Any) -> Iterator[Problem | str]:
    """Yield problems and warnings about a study's weather files and operating limits.

    Raises
    ------
    StudyError
        If a weather file is invalid.
    """
    if study.weather is None:
        return
    files, sites = weather_of(study), site_table(study)
    for file in files:
        if study.limits is not None and study.limits.wind_speed is not None and np.all(np.isnan(file.wind)):
            yield study.problem("limits.wind_speed", f"{file.name} has no wind speed: remove this limit")
    if sites and isinstance(study.weather.file, Sweep) and len(files) != len(sites):
        message = (
            f"lists {len(files)} files for {len(sites)} sites: give one file for each site, in the order of the "
            "sites, or one file for all"
        )
        yield study.problem("weather.file", message)
        return
    # Use only the first value of each key that does not affect weather, limits or sun.
    matters = ("site.", "time.", "weather.", "limits.")
    spans = {
        dim.name: slice(0, MAX_POINTS if any(key.startswith(matters) for key in dim.sweeps) else 1)
        for dim in study.dimensions()
    }
    parameters = Parameters(study, spans)
    points = list(itertools.islice(parameters.points(*PLACE, *LIMITS), MAX_POINTS))
    if instant_count(study.time) > MAX_INSTANTS or any(place[1] is None for _, place in points):
        return  # reported by the plan or another check
    suns, weathers = Suns(parameters), Weathers(parameters)
    idle, lines, most = list[bool](), dict[tuple[Any, ...], list[Problem | str]](), 0.0
    for index, (latitude, longitude, *place, dni, elevation, wind) in points:
        here = (latitude, longitude, *place)
        source, sun, irradiance = weathers.source(index), suns.at(index, here), weathers.at(index, here)
        works, _ = used(irradiance, sun, (dni, elevation, wind))
        idle.append(not np.any(works & (irradiance.dni > 0) & (irradiance.hours > 0)))
        most = max(most, float(np.max(irradiance.dni, initial=0.0)))
        if isinstance(source, WeatherFile) and (key := (source.name, *here)) not in lines:
            lines[key] = [*_elsewhere(study, source, latitude, longitude), *_doubts(source, irradiance, sun, latitude)]
    yield from dict.fromkeys(itertools.chain.from_iterable(lines.values()))
    if most > 1200.0:
        yield f"the direct normal irradiance reaches {most:,.0f} W/m2, more than under any clear sky over land"
    if idle and all(idle):
        block, message = "limits", "leave no instant at which the field operates"
        if study.limits is None:
            block, message = "weather", "leaves no instant with direct irradiance and the sun above the horizon"
        yield study.problem(block, message)
    elif any(idle):
        what = "there is" if study.limits is None else "the limits leave"
        yield f"at {sum(idle):,} of {len(idle):,} points {what} no instant at which the field operates"


def _doubts(file: WeatherFile, irradiance: Irradiance, sun: NDArray[np.float64], latitude: float) -> Iterator[str]:
    """Yield warnings about a weather file: notes from the reader, irradiance at night, low DNI and closure errors."""
    name = Path(file.name).name
    yield from (f"{name}: {note}" for note in file.notes)
    energy = irradiance.dni * irradiance.hours
    part = float(energy[~(sun[:, 2] > 0)].sum() / (energy.sum() or 1.0))
    if part > 0.01:  # tolerance for rounding in the file and near the horizon
        yield (
            f"{100 * part:.2g} % of the irradiation in {name} occurs with the sun below the horizon and is not "
            "used: check the times, their offset from universal time, and the site"
        )
    if len(file) * file.hours > 8000 and 0 < (most := float(file.dni.max())) < 300.0:
        yield (
            f"{name}: the DNI never exceeds {most:,.0f} W/m2: check that the column does not contain "
            "horizontal irradiance, and that its unit is correct"
        )
    high = sun[: len(file), 2] > 0.2  # a lower sun may belong to an interval with sunrise or sunset
    rows = high & (file.dni > 0) & (file.ghi > 20) & np.isfinite(file.dhi)
    if np.count_nonzero(rows) >= 50:
        yield from (f"{name}: {note}" for note in _closure(file, rows, sun[: len(file)], latitude))


def _closure(file: WeatherFile, rows: NDArray[np.bool_], sun: NDArray[np.float64], latitude: float) -> Iterator[str]:
    """Yield a warning if a time shift of the sun positions improves the closure GHI = DHI + DNI cos z."""
    dni, beam, mean = file.dni[rows], (file.ghi - file.dhi)[rows], float(file.ghi[rows].mean())
    # Rotate the sun positions about the Earth's axis.
    north, up, angle = np.cos(np.radians(latitude)), np.sin(np.radians(latitude)), np.radians(SHIFTS / 4)[:, np.newaxis]
    (x, _, z), along = sun[rows].T, (sun[rows] * (0.0, north, up)).sum(axis=1)
    heights = np.maximum(z * np.cos(angle) + north * x * np.sin(angle) + up * along * (1 - np.cos(angle)), 0.0)
    errors = np.array([np.sqrt(np.mean((dni * z - beam) ** 2)) for z in heights]) / mean
    best, now = int(np.argmin(errors)), float(errors[SHIFTS == 0][0])
    minutes = int(SHIFTS[best])
    if float(np.sqrt(np.mean((dni - beam) ** 2))) / mean < errors[best] / CLOSURE_RATIO:
        yield "GHI = DHI + DNI in nearly all rows: the column dni contains direct horizontal irradiance"
    elif now > max(CLOSURE_ERROR, CLOSURE_RATIO * errors[best]) and abs(minutes) >= 3:
        target, labels = file.shift + minutes / 60, {"start": file.hours / 2, "middle": 0.0, "end": -file.hours / 2}
        label = next((label for label, shift in labels.items() if abs(shift - target) < 0.05), "")
        remedy = f"give weather.{f'label: {label}' if label else f'offset: {target:.2f}'}, or check the time zone"
        if abs(minutes) == 60 and errors[best] > CLOSURE_ERROR:
            remedy = "check the time zone and the site"
        found, used = 100 * errors[best], 100 * now  # [%]
        yield (
            f"GHI = DHI + DNI cos z holds within {found:.1f} % of GHI with the sun {abs(minutes)} min "
            f"{'later' if minutes > 0 else 'earlier'}, and within {used:.1f} % with the times in the file: {remedy}"
        )


def _elsewhere(study: Any, file: WeatherFile, latitude: float, longitude: float) -> Iterator[Problem]:
    apart = np.linalg.norm(direction(file.longitude, file.latitude) - direction(longitude, latitude))  # chord [1]
    distance = 2 * 6371.0 * np.arcsin(np.minimum(apart / 2, 1.0))
    if distance > FARTHEST:
        yield study.problem("weather.file", (
            f"{file.name} is for another site: latitude {file.latitude:g}, longitude {file.longitude:g} deg, "
            f"{distance:,.0f} km from the site at {latitude:g}, {longitude:g} deg (maximum {FARTHEST:g} km); "
            f"give the file of the site, or take the site from the file: site: {{file: ...}}"
        ))  # fmt: skip
