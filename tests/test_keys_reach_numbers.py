"""Every numeric key of every family reaches the numbers: two values, and the effect on a named result.

Each row of keys.txt is a study, a key, two values of it and an effect: a ratio, a closed form, a sign, another study
with the same result, or none. A numeric key without a row fails a test.
"""

import copy
import functools
import statistics
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import xarray as xr
import yaml

from heliosweep import api
from heliosweep.config.blocks import blocks_at
from heliosweep.config.study import keys_of
from heliosweep.config.values import Numbers, Quantity
from heliosweep.families.family import families

ROOT = Path(__file__).parent


class Row(NamedTuple):
    """A key of a study, two values of it, and the effect on a number of the result."""

    base: str
    key: str
    values: tuple[Any, Any]
    effect: str
    measure: str
    form: str
    within: float
    also: Mapping[str, Any]

    def result(self, value: Any, changes: Mapping[str, Any] | None = None) -> xr.Dataset:
        """Result with a value of the key, and perhaps with other changes."""
        return computed(self.base, {**self.also, self.key: value, **(changes or {})})

    def number(self, result: xr.Dataset) -> float:
        """Mean of a variable, or value of an expression in the result."""
        if self.measure in result:
            return float(result[self.measure].astype(float).mean())
        return float(value_of(self.measure, r=result))


def value_of(text: str, **names: Any) -> Any:
    """Value of an expression of the table."""
    return eval(text, {**globals(), **CHANGES, **names})


def computed(base: str, changes: Mapping[str, Any]) -> xr.Dataset:
    """Result of a base study with some dotted keys changed; None removes a key."""
    content = copy.deepcopy(BASES[base])
    for key, value in copy.deepcopy(dict(changes)).items():
        *outer, last = key.replace("[]", ".0").split(".")
        block: Any = content
        for part in outer:
            block = block[int(part)] if part.isdecimal() else block.setdefault(part, {})
        if value is None:
            block.pop(last, None)
        else:
            block[int(last) if last.isdecimal() else last] = value
    return _computed(repr(content))


@functools.lru_cache(maxsize=16)
def _computed(content: str) -> xr.Dataset:
    return api.build(eval(content)).compute(scheduler="synchronous")


# Oracles


def sun_vector(azimuth: float, elevation: float) -> np.ndarray:
    """Unit vector towards the sun: east, north, up."""
    across, up = np.radians(azimuth), np.radians(elevation)
    return np.array([np.cos(up) * np.sin(across), np.cos(up) * np.cos(across), np.sin(up)])


def solar_sun(latitude: float, hour: float, day: float | None = None, declination: float = 0.0) -> np.ndarray:
    """Unit vector towards the sun on the solar clock; declination by Cooper (1969) for a day."""
    if day is not None:
        declination = 23.45 * np.sin(np.radians(360 / 365 * (284 + day)))
    phi, delta, omega = np.radians([latitude, declination, 15 * (hour - 12)])
    east = -np.cos(delta) * np.sin(omega)
    north = np.sin(delta) * np.cos(phi) - np.cos(delta) * np.cos(omega) * np.sin(phi)
    up = np.sin(delta) * np.sin(phi) + np.cos(delta) * np.cos(omega) * np.cos(phi)
    return np.array([east, north, up])


def cosine(result: xr.Dataset, sun: np.ndarray) -> float:
    """Mean cosine of the incidence of a field: half of the angle between sun and target."""
    centre = np.stack([result.x, result.y, result.z + result.pivot_height], axis=-1)
    to_target = np.array([0, 0, float(result.receiver_height)]) - centre
    across = to_target @ sun / np.linalg.norm(to_target, axis=1)
    return float(np.sqrt((1 + across) / 2).mean())


def pvlib_sun(longitude: float, altitude: float = 0.0, delta_t: float | None = 67.0) -> np.ndarray:
    """Unit vector towards the sun by pvlib's SPA on 2021-03-21 at 9:00 UTC, 40 deg north."""
    import pandas as pd
    import pvlib

    times = pd.DatetimeIndex(["2021-03-21T09:00Z"])
    found = pvlib.solarposition.spa_python(times, 40.0, longitude, altitude, delta_t=delta_t)
    return sun_vector(float(found["azimuth"].iloc[0]), float(found["elevation"].iloc[0]))


def apparent(pressure: float = 1013.25, temperature: float = 12.0, delta_t: float = 67.0) -> float:
    """Mean apparent elevation of the sun by pvlib's SPA, 40 deg north, 5 deg east, hours 8 to 15 UTC of 2021-03-21."""
    import pandas as pd
    import pvlib

    times = pd.date_range("2021-03-21T08:00Z", periods=8, freq="h")
    return float(
        pvlib.solarposition.spa_python(times, 40.0, 5.0, 0.0, pressure * 100, temperature, delta_t)[
            "apparent_elevation"
        ].mean()
    )


def radius(result: xr.Dataset) -> xr.DataArray:
    return np.hypot(result.x, result.y)


def nearest(result: xr.Dataset) -> float:
    """Least distance of two heliostats."""
    places = np.stack([result.x, result.y], axis=-1)
    apart = np.linalg.norm(places[:, np.newaxis] - places, axis=-1)
    return float(apart[apart > 0].min())


def bearing(result: xr.Dataset) -> np.ndarray:
    """Azimuths of the heliostats from the tower, from north, clockwise, -180 to 180 deg."""
    return np.degrees(np.arctan2(result.x, result.y)).to_numpy()


# Base studies

BASES: dict[str, dict[str, Any]] = {"dish_tracking": yaml.safe_load(families()["dish_tracking"].example())}
bases, CHANGES = yaml.safe_load_all((ROOT / "key_bases.yaml").read_text(encoding="utf-8"))
for name, own in bases.items():
    whole = {**BASES.get(own.pop("base", ""), {}), **own}
    BASES[name] = {key: block for key, block in whole.items() if block is not None}


def east(result: xr.Dataset) -> xr.Dataset:
    """Eastern half of a field: the whole is symmetric, and has the same mean cosine in the afternoon."""
    return result.isel(heliostat=np.flatnonzero(result.x > 0))


def rings(result: xr.Dataset) -> int:
    return len(np.unique(np.round(radius(result), 3)))


def fall(result: xr.Dataset) -> float:
    """Slope of the ground in per cent, from its lowest and highest heliostat."""
    return float(np.degrees(np.arctan(np.max(np.abs(result.z) / radius(result)))))


def lowest(result: xr.Dataset) -> float:
    return float(np.round(bearing(result)[int(np.argmin((result.z / radius(result)).to_numpy()))], 0))


def spot_distance(result: xr.Dataset) -> float:
    return float(np.hypot(result.spot_y, result.spot_z).mean())


def angle_between(sun: tuple[float, float], target: tuple[float, float]) -> float:
    """Incidence that sends light from one direction to another: half of the angle between them. [deg]"""
    return float(np.degrees(np.arccos(sun_vector(*sun) @ sun_vector(*target))) / 2)


def item(result: xr.Dataset, name: str) -> float:
    return float(result.capital_cost.sel(item=name))


def direct(result: xr.Dataset) -> float:
    """Direct costs without contingency."""
    return sum(item(result, name) for name in ("site", "heliostats", "tower", "receiver", "other"))


def yearly_cost(result: xr.Dataset) -> float:
    """Capital cost over the energy of 365 days like those of June."""
    return float(result.total_capital_cost / result.field_receiver_energy) * 30 / 365


def aim_turn(result: xr.Dataset) -> float:
    """Maximum azimuth of an aim point relative to the heliostat, seen from the axis of the receiver. [deg]"""
    return float(np.abs(np.degrees(np.arctan2(result.aim_x, result.aim_y) - np.arctan2(result.x, result.y))).max())


def table() -> list[Row]:
    """Rows of keys.txt, which says their form."""
    rows = []
    for line in (ROOT / "keys.txt").read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            place, first, second, effect, *also = line.split(" | ")
            effect, _, within = effect.partition(" within ")
            effect, _, form = effect.partition(" = ")
            effect, _, measure = effect.partition(" ")
            if effect == "sun":
                effect, within = "closed", "1e-6"
                measure, form = "east(r).cosine_efficiency.mean()", f"cosine(east(r), {measure})"
            base, key = place.split(" ")
            changes = value_of(also[0]) if also else {}
            values = (value_of(first), value_of(second))
            rows.append(Row(base, key, values, effect, measure, form, float(within or 1e-9), changes))
    return rows


TABLE = table()

#: Keys, by how they begin, whose effect needs files, other machines or a run, and the tests that hold it.
HELD = {
    "calibration.window": "families/misalignment/test_plant.py",
    "cameras.supersampling": "families/backward_gazing/test_simulated.py",
    "images[]": "families/backward_gazing/test_measured.py",
    "image_geometry": "families/backward_gazing/test_measured.py",
    "sun.pixel_angle": "families/backward_gazing/test_measured.py",
    "layout.margin": "layouts/test_ground.py",
    "layout.origin": "layouts/test_ground.py",
    "search.": "search/test_search.py",
}
#: Blocks that all families share: a row of one family is enough.
SHARED = ("execution.", "layout.", "sample.", "output.compression_level")


@pytest.mark.parametrize("row", TABLE, ids=lambda row: f"{row.base}-{row.key}")
def test_a_key_has_its_effect(row: Row) -> None:
    results = [row.result(value) for value in row.values]
    if row.effect == "same":
        xr.testing.assert_equal(*results)
        return
    if row.effect == "moves" and row.measure in results[0]:
        before, after = (result[row.measure] for result in results)
        assert not np.array_equal(before, after, equal_nan=True)
        return
    first, second = map(row.number, results)
    match row.effect:
        case "moves":
            assert first != second
        case "grows":
            assert second > first * (1 + 1e-9)
        case "falls":
            assert second < first * (1 - 1e-9)
        case "ratio":
            assert second == pytest.approx(value_of(row.form) * first, rel=row.within)
            assert first != 0
        case "closed":
            forms = [value_of(row.form, v=value, r=result) for value, result in zip(row.values, results, strict=True)]
            assert [first, second] == pytest.approx([*map(float, forms)], rel=row.within, abs=row.within)
            assert first != second
        case "like":
            other = row.number(row.result(row.values[0], value_of(row.form)))
            assert second == pytest.approx(other, rel=row.within)
            assert abs(second - first) > 3 * row.within * abs(first)
        case _:
            pytest.fail(f"{row.effect} is no effect")


@pytest.mark.parametrize("family", families())
def test_every_numeric_key_is_in_the_table(family: str) -> None:
    study = families()[family].study_class()
    own = {row.key for row in TABLE if BASES[row.base]["family"] == family}
    shared = {row.key for row in TABLE if row.key.startswith(SHARED)}
    missing = []
    for key in keys_of(study):
        *outer, last = key.name.replace("[]", "").split(".")
        blocks = [block for block in blocks_at(study, outer) if last in block.model_fields]
        if not any(isinstance(block.parameter(last), Quantity | Numbers) for block in blocks):
            continue
        name = key.name.removeprefix("field.") if key.name.startswith("field.layout.") else key.name
        if name not in own | shared and key.name not in own and not name.startswith(tuple(HELD)):
            missing.append(name)
    assert not missing, "write a row for each"
    for file in HELD.values():
        assert (ROOT / file).is_file()


def dni_file(folder: Path, minutes: int) -> str:
    """Weather of 600 W/m2 from 6 to 15 h and of 200 W/m2 from 15 to 18 h, in intervals of so many minutes."""
    start = np.arange(
        np.datetime64("2021-01-01T00:00"), np.datetime64("2022-01-01T00:00"), np.timedelta64(minutes, "m")
    )
    hour = (start - start.astype("datetime64[D]")) / np.timedelta64(1, "h")
    dni = np.select([(hour >= 6) & (hour < 15), (hour >= 15) & (hour < 18)], [600.0, 200.0], 0.0)
    rows = [f"{time}+00:00,{value}" for time, value in zip(start, dni, strict=True)]
    (folder / f"{minutes}.csv").write_text("\n".join(["time,dni", *rows, ""]))
    return str(folder / f"{minutes}.csv")


@pytest.mark.parametrize("minutes", [60, 30])
def test_energy_and_hours_are_sums_over_time_and_not_over_intervals(tmp_path: Path, minutes: int) -> None:
    """June near the equator, where the sun is up from about 5:45 to 18:20: the same for hours and half-hours."""
    content = copy.deepcopy(BASES["energy"]) | {"site": {"latitude": 10, "longitude": 0}, "limits": {"dni": 300}}
    content |= {"weather": {"file": dni_file(tmp_path, minutes), "label": "start"}}
    result = api.build(content).compute(scheduler="synchronous")
    energy = 30 * (9 * 600e-6 + 3 * 200e-6) * float(result.field_mirror_area)
    assert float(result.field_incident_energy) == pytest.approx(energy, rel=1e-9)
    assert float(result.hours_used) == 30 * 9
    # Three hours a day below the limit, and one dark interval each at sunrise and sunset.
    assert float(result.hours_lost.sum()) == 30 * (3 + 2 * minutes / 60)


def test_the_standard_error_of_a_mean_is_that_of_eight_sequences() -> None:
    """Draw k is of sequence k modulo 8; eight means of deviation s (n - 1) have a mean with the error s / sqrt(8)."""
    result = computed("drawn", {})
    draws = result.field_mirror_area.to_numpy()
    means = [statistics.fmean(draws[number::8]) for number in range(8)]
    expected = statistics.stdev(means) / 8**0.5
    assert float(result.field_mirror_area_sample_standard_error) == pytest.approx(expected, rel=1e-9)
