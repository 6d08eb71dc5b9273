"""Checks of the weather of a study against its limits, its clock and its sites, and of its plausibility."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.faults import Fault
from heliosweep.config.sites import site_table
from heliosweep.config.study import Study
from heliosweep.config.sweep import Sweep
from heliosweep.config.times import CivilTime, WeatherTime
from heliosweep.config.weather_files import WeatherFile, weather_files
from heliosweep.errors import Problem
from heliosweep.grid.clock import MAX_INSTANTS, instant_count
from heliosweep.grid.parameters import Parameters

if TYPE_CHECKING:  # with the kernels, which other studies are checked without
    from heliosweep.grid.weather import Irradiance

#: Distance of a weather station from its site that is allowed, and radius of the Earth. [km]
FARTHEST, EARTH = 50.0, 6371.0
#: Part of the irradiation of a file that may fall at night, by rounding of the file and of the horizon.
MOST_AT_NIGHT = 0.01
#: Irradiance that no clear sky exceeds, and that a year exceeds at any place. [W/m2]
CLEAREST, CLOUDIEST = 1200.0, 300.0
#: Shifts of the sun that the closure GHI = DHI + DNI cos z is tested with. [min]
SHIFTS = np.arange(-60, 61)
#: Rows with DNI, error of the closure relative to GHI, and ratio to its minimum from which a shift is reported.
CLOSURE_ROWS, CLOSURE_ERROR, CLOSURE_RATIO = 50, 0.005, 1.6
#: Sine of the elevation below which an interval can be partly lit. [1]
LOW_SUN = 0.2
#: Points of a sweep that are looked at.
MAX_POINTS = 200


def weather_faults(study: Any) -> Iterator[Fault]:
    """Yield contradictions between ``weather``, ``limits`` and ``time`` of a study, before any file is read."""
    weather, on_its_clock = study.weather, isinstance(study.time, WeatherTime)
    if on_its_clock and (weather is None or weather.file is None):
        yield Fault("needs the weather file whose intervals it looks at: weather: {file: ...}", ("time", "clock"))
    elif weather is not None and weather.file is not None and not on_its_clock:
        yield Fault("has its own intervals: give time: {clock: weather}", ("weather", "file"), show_value=False)
    elif weather is not None and weather.clear_sky is not None and not isinstance(study.time, CivilTime):
        message = "is of real dates: give time: {clock: civil, ...}"
        yield Fault(message, ("weather", "clear_sky"), show_value=False)
    if study.limits is not None and weather is None:
        yield Fault("are used with 'weather' only: add it, or remove these", ("limits",), show_value=False)
    elif study.limits is not None and study.limits.wind_speed is not None and weather.clear_sky is not None:
        yield Fault("is not known of a clear sky; remove it", ("limits", "wind_speed"))


def check_weather(study: Any) -> Iterator[Problem | str]:
    """Yield problems of the weather files of a study and its limits, and warnings.

    Raises
    ------
    StudyError
        If a weather file is wrong.
    """
    if study.weather is None:
        return
    files, sites = weather_files(study), site_table(study)
    if sites and isinstance(study.weather.file, Sweep) and len(files) != len(sites):
        message = f"names {len(files)} files for {len(sites)} sites: give one for each, in their order, or one for all"
        yield study.problem("weather.file", message)
        return
    if study.limits is not None and study.limits.wind_speed is not None:
        for file in files:
            if np.all(np.isnan(file.wind)):
                yield study.problem("limits.wind_speed", f"{file.name} has no wind speed; remove this limit")
    from heliosweep.grid.sun import PLACE, Suns  # with the kernels, which other studies are checked without
    from heliosweep.grid.weather import LIMITS, Weathers, used

    if instant_count(study.time) > MAX_INSTANTS:
        return  # the plan tells what they would take
    parameters = _places(study)
    points = list(itertools.islice(parameters.points(*PLACE, *LIMITS), MAX_POINTS))
    if any(place[1] is None for _, place in points):
        return  # the missing longitude is told elsewhere
    suns, weathers = Suns(parameters), Weathers(parameters)
    idle, seen = [], set[object]()
    for index, (*place, dni, elevation, wind) in points:
        source, sun, irradiance = weathers.source(index), suns.at(index, place), weathers.at(index, place)
        works, _ = used(irradiance, sun, (dni, elevation, wind))
        idle.append(not np.any(works & (irradiance.dni > 0) & (irradiance.hours > 0)))
        if isinstance(source, WeatherFile) and (key := (source.name, *place)) not in seen:
            seen.add(key)
            if far := _elsewhere(source, place):
                yield study.problem("weather.file", far)
            yield from (note for note in _doubts(source, irradiance, sun, place[0]) if note not in seen)
        if (most := float(np.max(irradiance.dni, initial=0.0))) > CLEAREST and "most" not in seen:
            seen.add("most")
            yield f"the direct normal irradiance goes up to {most:,.0f} W/m2; no sky over land is that clear"
    if all(idle):
        if study.limits is None:
            yield study.problem("weather", "leaves no instant with direct irradiance and the sun above the horizon")
        else:
            yield study.problem("limits", "leave no instant at which the field works")
    elif any(idle):
        what = "there is" if study.limits is None else "the limits leave"
        yield f"at {sum(idle):,} of {len(idle):,} points {what} no instant at which the field works"


def _places(study: Study) -> Parameters:
    """The points of a study at the first value of everything that neither weather, limits nor sun depend on."""
    matters = ("site.", "time.", "weather.", "limits.")
    swept = {dim.name: any(key.startswith(matters) for key in dim.sweeps) for dim in study.dimensions()}
    return Parameters(study, {dim: slice(0, MAX_POINTS if kept else 1) for dim, kept in swept.items()})


def _doubts(file: WeatherFile, irradiance: Irradiance, sun: NDArray[np.float64], latitude: float) -> Iterator[str]:
    """Yield warnings about a file at a place: reader, irradiance at night, low DNI and closure."""
    name = Path(file.name).name
    yield from (f"{name}: {note}" for note in file.notes)
    energy = irradiance.dni * irradiance.hours
    part = float(energy[~(sun[:, 2] > 0)].sum() / (energy.sum() or 1.0))
    if part > MOST_AT_NIGHT:
        yield (
            f"{100 * part:.2g} % of the irradiation in {name} comes with the sun below the horizon, and does not "
            f"count: the times, their offset from universal time, or the place can be wrong"
        )
    if len(file) * file.hours > 8000 and 0 < (most := float(file.dni.max())) < CLOUDIEST:
        yield f"{name}: the DNI never exceeds {most:,.0f} W/m2: is it on the horizontal plane, or in another unit?"
    high = sun[: len(file), 2] > LOW_SUN  # a lower sun is that of the lit part of its interval
    rows = high & (file.dni > 0) & (file.ghi > 20) & np.isfinite(file.dhi)
    if np.count_nonzero(rows) < CLOSURE_ROWS:
        return
    dni, beam, mean = file.dni[rows], (file.ghi - file.dhi)[rows], float(file.ghi[rows].mean())
    heights = shifted_heights(sun[: len(file)][rows], latitude)
    errors = np.array([np.sqrt(np.mean((dni * height - beam) ** 2)) for height in heights]) / mean
    best, now = int(np.argmin(errors)), float(errors[SHIFTS == 0][0])
    minutes = int(SHIFTS[best])
    if float(np.sqrt(np.mean((dni - beam) ** 2))) / mean < errors[best] / CLOSURE_RATIO:
        yield f"{name}: GHI = DHI + DNI in nearly all rows: the column dni is the irradiance on the horizontal plane"
    elif now > CLOSURE_ERROR and now > CLOSURE_RATIO * errors[best] and abs(minutes) >= 3:
        target = file.shift + minutes / 60
        labels = {"start": file.hours / 2, "middle": 0.0, "end": -file.hours / 2}
        label = next((label for label, shift in labels.items() if abs(shift - target) < 0.05), "")
        other = f"give weather.{f'label: {label}' if label else f'offset: {target:.2f}'}, or check the time zone"
        remedy = "check the time zone and the place" if abs(minutes) == 60 and errors[best] > CLOSURE_ERROR else other
        yield (
            f"{name}: GHI = DHI + DNI cos z holds within {errors[best]:.1%} of GHI with the sun {abs(minutes)} min "
            f"{'later' if minutes > 0 else 'earlier'}, and within {now:.1%} with the times as they are read: {remedy}"
        )


def shifted_heights(sun: NDArray[np.float64], latitude: float) -> Iterator[NDArray[np.float64]]:
    """Yield cos z of suns, shape (T, 3), after each of `SHIFTS`: turned about the axis of the Earth."""
    north, up = np.cos(np.radians(latitude)), np.sin(np.radians(latitude))
    along = sun[:, 1] * north + sun[:, 2] * up
    for angle in np.radians(SHIFTS / 4):
        turned = sun[:, 2] * np.cos(angle) + north * sun[:, 0] * np.sin(angle) + up * along * (1 - np.cos(angle))
        yield np.maximum(turned, 0.0)


def _elsewhere(file: WeatherFile, place: list[float]) -> str:
    """Return a message if the station of a file is far from a place; empty also for a file without a place."""
    (lat, lon), (north, east) = np.radians([[file.latitude, file.longitude], place[:2]])
    half = np.sin((north - lat) / 2) ** 2 + np.cos(lat) * np.cos(north) * np.sin((east - lon) / 2) ** 2
    distance = 2 * EARTH * np.arcsin(np.sqrt(min(half, 1.0)))
    if not distance > FARTHEST:
        return ""
    return (
        f"{file.name} is of another place: latitude {file.latitude:g}, longitude {file.longitude:g} deg, "
        f"{distance:,.0f} km from the site at {place[0]:g}, {place[1]:g} deg, and {FARTHEST:g} km are allowed; "
        f"give the file of the site, or take the site from the file: site: {{file: ...}}"
    )
