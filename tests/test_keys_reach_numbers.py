"""Every numeric key of every family reaches the numbers: two values, and the effect on a named result.

Each row of the table is a study, a key, two values of it and an effect: a ratio, a closed form, a sign, another study
with the same result, or none. A numeric key without a row fails the last test.
"""

import copy
import functools
import statistics
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, SupportsFloat

import numpy as np
import pytest
import xarray as xr
import yaml

from heliosweep import api
from heliosweep.config.blocks import blocks_at
from heliosweep.config.schema import keys_of
from heliosweep.config.values import Numbers, Quantity
from heliosweep.families.family import families

ROOT = Path(__file__).parent
Measure = str | Callable[[xr.Dataset], SupportsFloat]
Effect = Callable[["Row"], None]


class Row(NamedTuple):
    """A key of a study, two values of it, and the effect on the result."""

    base: str
    key: str
    first: Any
    second: Any
    effect: Effect
    also: Mapping[str, Any] = {}

    def result(self, value: Any, changes: Mapping[str, Any] | None = None) -> xr.Dataset:
        """Result with a value of the key, and perhaps with other changes."""
        return computed(self.base, {**self.also, self.key: value, **(changes or {})})


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


def measured(result: xr.Dataset, measure: Measure) -> float:
    """A number of a result: the mean of a variable, or what a function returns."""
    return float(result[measure].astype(float).mean()) if isinstance(measure, str) else float(measure(result))


def ratio(measure: Measure, expected: float, rel: float = 1e-9) -> Effect:
    """Second over first number."""

    def check(row: Row) -> None:
        first, second = (measured(row.result(value), measure) for value in (row.first, row.second))
        assert second == pytest.approx(expected * first, rel=rel)
        assert first != 0

    return check


def closed(measure: Measure, form: Callable[[Any, xr.Dataset], float], rel: float = 1e-9) -> Effect:
    """Number that follows from each value, and from labels of the result."""

    def check(row: Row) -> None:
        found = []
        for value in (row.first, row.second):
            result = row.result(value)
            found.append(measured(result, measure))
            assert found[-1] == pytest.approx(form(value, result), rel=rel, abs=rel)
        assert found[0] != found[1]

    return check


def grows(measure: Measure, falls: bool = False) -> Effect:
    """The second number is larger, or smaller."""

    def check(row: Row) -> None:
        first, second = (measured(row.result(value), measure) for value in (row.first, row.second))
        assert (second < first * (1 - 1e-9)) if falls else (second > first * (1 + 1e-9))

    return check


def falls(measure: Measure) -> Effect:
    return grows(measure, falls=True)


def like(changes: Mapping[str, Any], measure: Measure, rel: float = 1e-9) -> Effect:
    """The second value gives the number of the first with other changes, which is another than that without."""

    def check(row: Row) -> None:
        plain, second = (measured(row.result(value), measure) for value in (row.first, row.second))
        other = measured(row.result(row.first, changes), measure)
        assert second == pytest.approx(other, rel=rel)
        assert abs(second - plain) > 3 * rel * abs(plain)

    return check


def moves(measure: Measure) -> Effect:
    """The numbers differ: keys without a simple law, such as seeds."""

    def check(row: Row) -> None:
        first, second = (row.result(value) for value in (row.first, row.second))
        if isinstance(measure, str):
            assert not np.array_equal(first[measure], second[measure], equal_nan=True)
        else:
            assert measured(first, measure) != measured(second, measure)

    return check


def same(row: Row) -> None:
    """No number differs."""
    xr.testing.assert_equal(row.result(row.first), row.result(row.second))


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


APPARENT = {"ephemeris.elevation": "apparent", "output.time_series": True, "time.dates": "2021-03-21"}


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

#: Concentrator of a dish.
DISH = {"weather": "pvlib:data/723170TYA.CSV", "focal_length": 6, "diameter": 8, "aperture_radius": 0.06, "spread": 4}
BASES: dict[str, dict[str, Any]] = {"dish_tracking": yaml.safe_load(families()["dish_tracking"].example())}
for name, own in yaml.safe_load((ROOT / "key_bases.yaml").read_text(encoding="utf-8")).items():
    whole = {**BASES.get(own.pop("base", ""), {}), **own}
    BASES[name] = {key: block for key, block in whole.items() if block is not None}
CIVIL, ENERGY = BASES["civil"], BASES["energy"]

ZONES = {"layout": {"radial_stagger": {"clearance": 16, "zones": [{"start": 60, "rings": 2}]}}}
SPIRAL = {"layout": {"spiral": {"a": 5, "b": 0.6, "inner_radius": 5, "heliostats": 40}}}
LINES = {"layout": {"rows": {"spacing": 20, "distance": 30, "inner_radius": 50, "heliostats": 20}}}
ERRORS = (
    *("azimuth_reference", "elevation_reference", "tilt_about_east", "tilt_about_north"),
    *("non_orthogonality", "collimation"),
)
INTERCEPT = "intercept_efficiency"
SPOT = "spot_y"


def of_sun(sun: Callable[[Any], np.ndarray]) -> Effect:
    """Mean cosine of the eastern half of the field: the whole is symmetric, and has the same in the afternoon."""

    def east(result: xr.Dataset) -> xr.Dataset:
        return result.isel(heliostat=np.flatnonzero(result.x > 0))

    return closed(
        lambda result: float(east(result).cosine_efficiency.mean()),
        lambda value, result: cosine(east(result), sun(value)),
        1e-6,
    )


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


COST_OF_HEAT = "levelized_cost_of_heat"


def item(name: str) -> Callable[[xr.Dataset], float]:
    return lambda result: float(result.capital_cost.sel(item=name))


def direct(result: xr.Dataset) -> float:
    """Direct costs without contingency."""
    return sum(item(name)(result) for name in ("site", "heliostats", "tower", "receiver", "other"))


def yearly_cost(result: xr.Dataset) -> float:
    """Capital cost over the energy of 365 days like those of June."""
    return float(result.total_capital_cost / result.field_receiver_energy) * 30 / 365


AIMED = "aimed_power"
LIMITED = {"aim": {"strategy": "flux_limit", "limit": 12, "rows": 3, "columns": 3}}
ROUND = {"receiver": {"kind": "cylinder", "height": 60, "radius": 3, "height_extent": 4}}


def aim_turn(result: xr.Dataset) -> float:
    """Maximum azimuth of an aim point relative to the heliostat, seen from the axis of the receiver. [deg]"""
    return float(np.abs(np.degrees(np.arctan2(result.aim_x, result.aim_y) - np.arctan2(result.x, result.y))).max())


FIELD_ROWS = [
    Row("solar", "site.latitude", 30, 35, of_sun(lambda v: solar_sun(v, 9, 80))),
    Row("sites", "sites[].latitude", 30, 35, of_sun(lambda v: solar_sun(v, 9, 80))),
    Row("civil", "site.longitude", 5, 25, of_sun(pvlib_sun)),
    Row("civil_sites", "sites[].longitude", 5, 25, of_sun(pvlib_sun)),
    Row("clear", "site.altitude", 0, 2000, grows("field_incident_energy")),
    Row("clear_sites", "sites[].altitude", 0, 2000, grows("field_incident_energy")),
    Row("solar", "time.days", [80], [172], of_sun(lambda v: solar_sun(30, 9, v[0]))),
    Row("solar", "time.hours", [9], [10.5], of_sun(lambda v: solar_sun(30, v[0], 80))),
    Row("solar", "time.declination", [0], [20], of_sun(lambda v: solar_sun(30, 9, None, v[0])), {"time.days": None}),
    Row("civil", "time.window.step", 1, 0.25, closed(lambda r: r.sizes["time"], lambda v, _: 1 / v),
        {"output.time_series": True}),
    Row("field", "time.azimuth", 150, 100, of_sun(lambda v: sun_vector(v, 50))),
    Row("field", "time.elevation", 50, 20, of_sun(lambda v: sun_vector(150, v))),
    Row("energy", "time.months", [6], [6, 7], grows("hours_used")),
    Row("field", "layout.radial_stagger.clearance", 16, 20, closed(nearest, lambda v, _: v, 0.05)),
    Row("field", "layout.radial_stagger.inner_radius", 60, 80, closed(lambda r: radius(r).min(), lambda v, _: v)),
    Row("field", "layout.radial_stagger.rings", 2, 4, closed(rings, lambda v, _: v)),
    Row("field", "layout.radial_stagger.heliostats", 30, 40, closed("field_heliostats", lambda v, _: v),
        {"layout.radial_stagger.rings": None}),
    Row("field", "layout.radial_stagger.zones[].start", 60, 70,
        closed(lambda r: radius(r).min(), lambda v, _: v), ZONES),
    Row("field", "layout.radial_stagger.zones[].rings", 2, 3, closed(rings, lambda v, _: v), ZONES),
    Row("field", "layout.radial_stagger.zones[].pitch", 20, 24,
        closed(lambda r: 360 / int((np.abs(radius(r) - radius(r).min()) < 1e-6).sum()), lambda v, _: v), ZONES),
    Row("field", "layout.spiral.a", 5, 7, closed(lambda r: radius(r).min(), lambda v, _: v), SPIRAL),
    Row("field", "layout.spiral.b", 0.6, 0.7, closed(lambda r: radius(r).max(), lambda v, _: 5 * 40**v), SPIRAL),
    Row("field", "layout.spiral.inner_radius", 10, 30, grows(lambda r: radius(r).min()), SPIRAL),
    Row("field", "layout.spiral.heliostats", 40, 50, closed("field_heliostats", lambda v, _: v), SPIRAL),
    Row("field", "layout.rows.spacing", 20, 24, closed(nearest, lambda v, _: v), LINES),
    Row("field", "layout.rows.distance", 30, 34,
        closed(lambda r: np.diff(np.unique(np.round(r.y, 6))).min(), lambda v, _: v), LINES),
    Row("field", "layout.rows.inner_radius", 50, 80, grows(lambda r: radius(r).min()), LINES),
    Row("field", "layout.rows.azimuth", 0, 30, moves("x"), LINES),
    Row("field", "layout.rows.heliostats", 20, 25, closed("field_heliostats", lambda v, _: v), LINES),
    Row("light", "layout.sectors[].azimuth", 0, 90, closed(lambda r: np.mean(bearing(r)), lambda v, _: v, 8)),
    Row("light", "layout.sectors[].width", 20, 60, closed(lambda r: np.abs(bearing(r)).max(), lambda v, _: v / 2, 8),
        {"layout.rows.heliostats": 40}),
    Row("field", "layout.terrain.slope", 2, 5, closed(fall, lambda v, _: v, 0.01), {"layout.terrain.azimuth": 0}),
    Row("field", "layout.terrain.azimuth", 0, 90, closed(lowest, lambda v, _: v, 4), {"layout.terrain.slope": 3}),
    Row("field", "heliostat.width", 8, 10, ratio("field_mirror_area", 1.25)),
    Row("field", "heliostat.height", 7, 14, ratio("field_mirror_area", 2)),
    Row("field", "heliostat.pivot_height", 6, 16, of_sun(lambda _: sun_vector(150, 50))),
    Row("light", "heliostat.focus", 30, 110, grows(INTERCEPT)),
    Row("light", "heliostat.facets.columns", 1, 3, moves(INTERCEPT),
        {"heliostat.facets": {"rows": 1, "gap": 0}, "heliostat.focus": 120}),
    Row("light", "heliostat.facets.rows", 1, 3, moves(INTERCEPT),
        {"heliostat.facets": {"columns": 1, "gap": 0}, "heliostat.focus": 120}),
    Row("light", "heliostat.facets.gap", 0, 0.5, moves(INTERCEPT), {"heliostat.facets": {"columns": 2, "rows": 2}}),
    Row("field", "tower.radius", 3, 6, falls("field_shading_efficiency"), {"time.elevation": 30}),
    Row("field", "tower.top", 30, 90, falls("field_shading_efficiency"), {"time.elevation": 30, "tower.radius": 6}),
    Row("energy", "availability.fraction", 0.45, 0.9, ratio("field_receiver_energy", 2)),
    Row("energy", "site.horizon.table", [[0, 0]], [[0, 15]], falls("field_receiver_energy")),
    Row("field", "receiver.height", 95, 60, of_sun(lambda _: sun_vector(150, 50))),
    Row("light", "receiver.azimuth", 0, 70, falls(INTERCEPT)),
    Row("light", "receiver.tilt", -20, 90, ratio(INTERCEPT, 0.0)),  # above all mirrors it faces the sky
    Row("light", "receiver.width", 1, 2, grows(INTERCEPT)),
    Row("light", "receiver.height_extent", 1, 2, grows(INTERCEPT)),
    Row("light", "receiver.radius", 0.5, 1, grows(INTERCEPT),
        {"receiver": {"kind": "cylinder", "height": 60, "height_extent": 4}}),
    Row("energy", "receiver.absorptance", 0.45, 0.9, ratio("field_heat", 2)),
    Row("energy", "receiver.thermal_losses.constant", 0.001, 0.002,
        closed("design_point_heat", lambda v, r: float(r.design_point_power) - v)),
    Row("energy", "receiver.thermal_losses.per_area", 0.1, 0.2,
        closed("design_point_heat", lambda v, r: float(r.design_point_power) - 1e-3 * v * 16)),
    *(Row("energy", f"economics.{key}", 10, 20, closed(item(name), form), {"economics.currency": "USD"})
      for key, name, form in (
        ("site_cost", "site", lambda v, r: v * float(r.field_mirror_area)),
        ("heliostat_cost", "heliostats", lambda v, r: v * float(r.field_mirror_area)),
        ("land_cost", "land", lambda v, r: v * (float(r.field_land_area) + 182_108.5)),
        ("further_land", "land", lambda v, r: 2.47105 * (float(r.field_land_area) + v)),
        ("tower_cost", "tower", lambda v, _: v * np.exp(0.0113 * (60 - 2 + 1.5))),
        ("receiver_cost", "receiver", lambda v, _: v * (16 / 1571) ** 0.7),
        ("receiver_reference_area", "receiver", lambda v, _: 103e6 * (16 / v) ** 0.7),
        ("other_cost", "other", lambda v, _: v))),
    *(Row("energy", f"economics.{key}", first, second, closed(measure, form), {"economics": {}})
      for key, first, second, measure, form in (
        ("tower_scale", 0.01, 0.02, item("tower"), lambda v, _: 3e6 * np.exp(v * 59.5)),
        ("receiver_exponent", 0.5, 1, item("receiver"), lambda v, _: 103e6 * (16 / 1571) ** v),
        ("contingency", 0.1, 0.2, item("contingency"), lambda v, r: v * direct(r)),
        ("indirect", 0.1, 0.2, item("indirect"), lambda v, r: v * 1.07 * direct(r)),
        ("sales_tax", 0.1, 0.2, item("sales_tax"), lambda v, r: v * 1.07 * direct(r)),
        ("fixed_charge_rate", 0.1, 0.2, COST_OF_HEAT, lambda v, r: v * yearly_cost(r)))),
    Row("energy", "economics.operation_cost", 1e4, 1e5,
        closed(COST_OF_HEAT, lambda v, r: (0.07 + v / float(r.total_capital_cost)) * yearly_cost(r)),
        {"economics.currency": "USD"}),
    Row("light", "optics.sun_shape.circumsolar_ratio", 0.01, 0.4, falls(INTERCEPT), {"optics.sun_shape.kind": "buie"}),
    Row("light", "optics.reflectivity", 0.45, 0.9, ratio("field_total_efficiency", 2)),
    Row("light", "optics.cleanliness", 0.45, 0.9, ratio("field_total_efficiency", 2)),
    Row("energy", "optics.cleanliness_by_month", [0.8] * 12, [0.8] * 5 + [0.4] + [0.8] * 6,
        ratio("field_receiver_energy", 0.5)),
    Row("energy", "optics.soiling.rate", 0.002, 0.01, falls("field_receiver_energy"),
        {"optics.soiling.washing_interval": 14}),
    Row("energy", "optics.soiling.washing_interval", 7, 28, falls("field_receiver_energy"),
        {"optics.soiling.rate": 0.01}),
    Row("light", "optics.visibility", 10000, 40000, grows("attenuation_efficiency"),
        {"optics.attenuation": "vant_hull"}),
    Row("light", "optics.water_vapour", 3, 10, falls("attenuation_efficiency"), {"optics.attenuation": "vant_hull"}),
    Row("light", "optics.altitude", 0, 1500, moves("attenuation_efficiency"), {"optics.attenuation": "vant_hull"}),
    Row("light", "optics.slope_error", 1, 3, falls(INTERCEPT)),
    Row("light", "optics.slope_error_horizontal", 1, 4, falls(INTERCEPT),
        {"optics.slope_error": None, "optics.slope_error_vertical": 1}),
    Row("light", "optics.slope_error_vertical", 1, 4, falls(INTERCEPT),
        {"optics.slope_error": None, "optics.slope_error_horizontal": 1}),
    # Errors of the normal add in squares; an error of the reflected ray is one of half of it of the normal.
    Row("light", "optics.tracking_error", 0, 4, like({"optics.slope_error": 5}, INTERCEPT, 1e-3),
        {"optics.slope_error": 3}),
    Row("light", "optics.specularity_error", 0, 8, like({"optics.slope_error": 5}, INTERCEPT, 0.02),
        {"optics.slope_error": 3}),
    *(Row("light", f"optics.mount_errors.{name}", 0, 20, falls(INTERCEPT), {"optics.mount_errors": {}}) for name in
      ERRORS),
    Row("light", "optics.mount_errors.scale", 1, 3,
        like({"optics.mount_errors.collimation": {"normal": [0, 3]}}, INTERCEPT),
        {"optics.mount_errors": {"collimation": {"normal": [0, 1]}}}),
    Row("light", "optics.mount_errors.seed", 1, 2, moves(INTERCEPT),
        {"optics.mount_errors": {"collimation": {"normal": [0, 3]}}}),
    Row("light", "optics.rays", 64, 4096, falls("intercept_efficiency_error"), {"receiver.width": 1.5}),
    Row("light", "optics.precision", 1e-2, 1e-4, falls("intercept_efficiency_error"), {"receiver.width": 1.5}),
    Row("light", "optics.seed", 1, 2, moves(INTERCEPT), {"receiver.width": 1.5}),
    Row("light", "aim.levels", 1, 3, moves(INTERCEPT), {"aim": {"strategy": "spread"}, "receiver.height_extent": 12}),
    Row("light", "aim.limit", 10, 50, grows(AIMED), LIMITED),
    Row("light", "aim.limits", [[0, 1]], [[0, 50]], grows(lambda r: r.aimed_flux_map[0].max()), LIMITED),
    Row("light", "aim.safety", 0.85, 1, grows(AIMED), LIMITED),
    Row("light", "aim.rows", 1, 3, closed(lambda r: np.ptp(r.aim_z.values) > 0, lambda v, _: float(v > 1)), LIMITED),
    Row("light", "aim.columns", 1, 3, closed(lambda r: np.ptp(r.aim_x.values) > 0, lambda v, _: float(v > 1)), LIMITED),
    Row("light", "aim.azimuth_span", 20, 40, closed(aim_turn, lambda v, _: v / 3),
        {**LIMITED, **ROUND}),
    Row("light", "aim.flux_rows", 4, 6, closed(lambda r: r.sizes["flux_row"], lambda v, _: v), LIMITED),
    Row("light", "aim.flux_columns", 4, 6, closed(lambda r: r.sizes["flux_column"], lambda v, _: v), LIMITED),
    Row("energy", "weather.dni_factor", 1, 1.1, ratio("field_incident_energy", 1.1)),
    Row("energy", "weather.offset", 0.5, -0.5,
        like({"weather.offset": None, "weather.label": "end"}, "field_receiver_energy")),
    Row("clear", "weather.clear_sky.linke_turbidity", 2, 5, falls("field_incident_energy")),
    Row("clear", "weather.clear_sky.aerosol_optical_depth", 0.05, 0.3, falls("field_incident_energy"),
        {"weather.clear_sky.model": "simplified_solis"}),
    Row("clear", "weather.clear_sky.precipitable_water", 0.5, 4, falls("field_incident_energy"),
        {"weather.clear_sky.model": "simplified_solis"}),
    Row("energy", "limits.dni", 100, 600, falls("hours_used")),
    Row("energy", "limits.sun_elevation", 5, 30, falls("hours_used")),
    Row("energy", "limits.wind_speed", 2, 10, grows("hours_used")),
    Row("energy", "design_point.day", 80, 172,
        closed("field_design_point_cosine_efficiency", lambda v, r: cosine(r, solar_sun(float(r.latitude), 10, v)))),
    Row("energy", "design_point.solar_hour", 10, 14.5,
        closed("field_design_point_cosine_efficiency", lambda v, r: cosine(r, solar_sun(float(r.latitude), v, 80)))),
    Row("energy", "design_point.dni", 950, 475, ratio("design_point_power", 0.5)),
    Row("solar", "keep.heliostats", 10, 20, closed("field_heliostats", lambda v, _: v),
        {"keep.by": "optical_efficiency"}),
    Row("energy", "keep.heat_power", 0.02, 0.03, grows("field_heliostats"),
        {"keep.by": "receiver_energy", "receiver.absorptance": 0.9}),
    Row("energy", "keep.field_power", 0.02, 0.03, grows("field_heliostats"), {"keep.by": "receiver_energy"}),
    Row("field", "output.outlines", 1, 3, closed(lambda r: r.sizes["image"], lambda v, _: v)),
    Row("energy", "output.flux_map.columns", 4, 6, closed(lambda r: r.sizes["flux_column"], lambda v, _: v),
        {"output.flux_map.rows": 4}),
    Row("energy", "output.flux_map.rows", 4, 6, closed(lambda r: r.sizes["flux_row"], lambda v, _: v),
        {"output.flux_map.columns": 4}),
    Row("energy", "output.flux_map.limit", 1, 8, falls("power_above_limit"),
        {"output.flux_map.columns": 4, "output.flux_map.rows": 4}),
    Row("drawn", "sample.size", 32, 64, closed(lambda r: r.sizes["sample"], lambda v, _: v)),
    Row("drawn", "sample.seed", 1, 2, moves("heliostat_width")),
    Row("drawn", "sample.statistics.percentiles", [5, 95], [10, 90], moves("sample_percentile")),
    Row("field", "execution.workers", 1, 2, same),
    Row("field", "execution.memory", "500 MB", "1 GB", same),
    Row("field", "output.compression_level", 1, 9, same),
]  # fmt: skip

SUN = {"time": None, "sun": {"azimuth": 150, "elevation": 50}}
TILT_ROLL = {"mount.kind": "tilt_roll"}
DRAWS = {"mount_errors": {"azimuth_reference": {"normal": [0, 1]}, "samples": 50, "seed": 1}}
#: Bits that the model of a noisy profile of the sun, or of noisy cameras, draws.
NOISY = {"sun_profile": "noisy", "profile_noise": {"noise": 0.01, "nodes": 60}}

DISH_ROWS = [
    Row("dish", "site.latitude", 40, 20, moves("mean_tracking_error")),
    Row("dish", "site.longitude", 5, 25, moves("mean_tracking_error")),
    Row("dish", "site.altitude", 0, 5000, moves("mean_tracking_error")),
    Row("dish_sites", "sites[].latitude", 40, 20, moves("mean_tracking_error")),
    Row("dish_sites", "sites[].longitude", 5, 25, moves("mean_tracking_error")),
    Row("dish_sites", "sites[].altitude", 0, 5000, moves("mean_tracking_error")),
    Row("dish", "time.window.step", 1, 0.5, closed(lambda r: r.sizes["time"], lambda v, _: 16 / v),
        {"output.time_series": True}),
    # A small tilt alone: the error is proportional to it.
    Row("dish", "errors.axis_tilt", 0.1, 0.2, ratio("mean_tracking_error", 2, 1e-4)),
    Row("dish", "errors.axis_tilt_direction", 0, 60, moves("mean_tracking_error")),
    Row("dish", "errors.home_azimuth_offset", 0, 0.1, grows("mean_tracking_error"), {"errors.axis_tilt": 0}),
    # Without other errors an offset in elevation is the tracking error.
    Row("dish", "errors.home_elevation_offset", 0.1, 0.2,
        closed("mean_tracking_error", lambda v, _: np.radians(v) * 1e3, 1e-6), {"errors.axis_tilt": 0}),
    Row("dish", "errors.azimuth_reference", 0, 0.1, grows("mean_tracking_error"), {"errors.axis_tilt": 0}),
    Row("dish", "errors.non_orthogonality", 0, 0.1, grows("mean_tracking_error"), {"errors.axis_tilt": 0}),
    Row("dish", "errors.collimation", 0, 0.1, like({"errors.home_azimuth_offset": -0.1}, "mean_tracking_error", 1e-6)),
    Row("dish", "tolerance", 4, 8,
        closed("effective_tracking_factor", lambda v, r: float((1 - r.mean_tracking_error / v).mean()))),
    *(Row("dish", f"concentrator.{key}", first, second, effect("intercept_efficiency"), {"concentrator": DISH})
      for key, first, second, effect in (
        ("focal_length", 8, 6, grows), ("aperture_radius", 0.05, 0.08, grows), ("spread", 5, 3, grows))),
    Row("dish", "concentrator.diameter", 5, 8, grows("aperture_energy"), {"concentrator": DISH}),
    Row("dish", "statistics.required_factor", 0.5, 0.75, ratio("tolerable_axis_tilt", 0.5, 1e-3)),
    Row("dish", "ephemeris.pressure", 1013.25, 500,
        closed("solar_elevation", lambda v, _: apparent(pressure=v), 1e-4), APPARENT),
    Row("dish", "ephemeris.temperature", 12, 40,
        closed("solar_elevation", lambda v, _: apparent(temperature=v), 1e-4), APPARENT),
    Row("dish", "ephemeris.delta_t", 67, 6000,
        closed("solar_elevation", lambda v, _: apparent(delta_t=v), 1e-4), APPARENT),
]  # fmt: skip
MISALIGNMENT_ROWS = [
    Row("curves", "site.latitude", 37.4, 20, moves(SPOT)),
    Row("curves_sites", "sites[].latitude", 37.4, 20, moves(SPOT)),
    Row("curves", "time.days", [172], [80], moves(SPOT)),
    Row("curves", "time.hours", [9], [14], moves(SPOT)),
    Row("curves", "time.declination", [0], [20], moves(SPOT), {"time.days": None}),
    Row("curves", "site.longitude", 5, 25, moves(SPOT), {"time": CIVIL["time"]}),
    Row("curves", "site.altitude", 0, 5000, moves(SPOT), {"time": CIVIL["time"], "site.longitude": 5}),
    Row("curves_sites", "sites[].longitude", 5, 25, moves(SPOT), {"time": CIVIL["time"]}),
    Row("curves_sites", "sites[].altitude", 0, 5000, moves(SPOT), {"time": CIVIL["time"], "sites[].longitude": 5}),
    Row("curves", "time.window.step", 1, 0.5, closed(lambda r: r.sizes["hour"], lambda v, _: 1 / v),
        {"time": CIVIL["time"], "site.longitude": 5}),
    Row("curves", "sun.azimuth", 150, 200, moves(SPOT), SUN),
    Row("curves", "sun.elevation", 50, 20, moves(SPOT), SUN),
    Row("curves", "receiver.height", 143, 100, moves(SPOT)),
    Row("curves", "receiver.azimuth", 0, 20, moves(SPOT)),
    Row("curves", "receiver.tilt", 0, -20, moves(SPOT)),
    Row("curves", "receiver.width", 1, 2, grows("tracking_tolerance")),
    Row("curves", "receiver.height_extent", 4, 8, grows("tracking_tolerance")),
    Row("curves", "heliostats.positions", [[-16, 150, 0]], [[-16, 300, 0]], grows(spot_distance)),
    Row("curves", "heliostats.pivot_height", 0, 10, moves(SPOT),
        {"heliostats": {}, "layout": {"rows": {"spacing": 30, "distance": 40, "inner_radius": 100, "heliostats": 6}}}),
    Row("curves", "error.size", 3, 6, ratio(spot_distance, 2, 0.03)),
    Row("curves", "beam.divergence", 4, 9.3, grows(lambda r: np.ptp(r.outline_y.to_numpy()[0, 0, 0])), {"beam": {}}),
    Row("curves", "beam.width", 0.0, 2.0, grows(lambda r: np.ptp(r.outline_y.to_numpy()[0, 0, 0])),
        {"beam": {"divergence": 4}}),
    Row("curves", "detectors.lines", [[0, 1, 1]], [[0, 1, 4]], moves("crossing_z"), {"detectors": {}}),
    *(Row("mounts", f"mount_errors.{name}", 0.5, 1, ratio(spot_distance, 2, 0.02),
        {"mount_errors": {}, "mount.mirror_offset": 0, "mount.axis_offset": 0})
      for name in ERRORS),
    Row("mounts", "mount.mirror_offset", 0, 0.5, moves(SPOT)),
    Row("mounts", "mount.axis_offset", 0, 0.5, moves(SPOT)),
    Row("mounts", "mount.pedestal_height", 0, 8, moves(SPOT)),
    Row("mounts", "mount.axis_azimuth", 0, 90, moves(SPOT), TILT_ROLL),
    Row("mounts", "mount_errors.scale", 1, 3,
        like({"mount_errors.azimuth_reference": {"normal": [0, 3]}}, "spot_y_variance"), DRAWS),
    Row("mounts", "mount_errors.samples", 50, 60, moves("spot_y_variance"), DRAWS),
    Row("mounts", "mount_errors.seed", 1, 2, moves("spot_y_variance"), DRAWS),
    Row("mounts", "statistics.percentiles", [5, 95], [10, 90], moves("remaining_tolerance"), DRAWS),
    Row("calibration", "calibration.parameters", 2, 4, falls("residual_rms")),
    Row("calibration", "calibration.noise", 0.01, 0.02, ratio("residual_rms", 2, 0.01), {"calibration.parameters": 4}),
    Row("calibration", "calibration.days_used", 1, 2, closed("spots_used", lambda v, _: 3 * v)),
    Row("calibration", "calibration.loss_scale", 0.005, 1, moves("estimated_error"), {"calibration.loss": "huber"}),
    Row("calibration", "calibration.condition_limit", 1, 1000, falls("calibration_status")),
    Row("detectors", "detectors.arrays[].points", [[-15, -8], [15, -8]], [[-15, -6], [15, -6]], moves("crossing_z")),
    Row("detectors", "detectors.pitch", 0.01, 0.5, grows(lambda r: np.abs(r.estimated_error - r.true_error).mean())),
    Row("detectors", "detectors.noise", 0, 0.1, grows(lambda r: np.abs(r.estimated_error - r.true_error).mean())),
    Row("detectors", "detectors.parameters", 2, 4, moves("estimated_error")),
    Row("detectors", "detectors.rounds", 2, 3, closed(lambda r: r.sizes["round"], lambda v, _: v + 1)),
    Row("detectors", "detectors.condition_limit", 1, 1000, moves("calibration_status")),
]  # fmt: skip
MODULE = {"heliostat.modules": [{"centre": [0, 0], "size": [4, 4]}], "defects": {}}
FIELD_OF_GAZING = {
    "output.maps": False,
    "target": {"tilt": 30},
    "sun": {},
    "heliostat.distance": None,
    "field": {"latitude": 42.5, "day": 80, "hours": [10], "receiver_height": 80, "pivot_height": 5,
              "layout": {"rows": {"spacing": 30, "distance": 40, "inner_radius": 100, "heliostats": 2}}},
}  # fmt: skip
GAZING_ROWS = [
    Row("gazing", "heliostat.focal_length", 100, 140, closed("focal_length_estimate", lambda v, _: v, 0.02)),
    Row("gazing", "heliostat.distance", 100, 140, moves("image")),
    Row("gazing", "heliostat.modules[].centre", [0, 0], [1, 0], closed("module_y", lambda v, _: v[0]), MODULE),
    Row("gazing", "heliostat.modules[].size", [1, 1], [2, 1], closed("module_width", lambda v, _: v[0]), MODULE),
    Row("gazing", "heliostat.pixel", 0.25, 0.5, ratio(lambda r: r.sizes["y"], 0.5, 0.05)),
    Row("gazing", "target.azimuth", 0, 20, closed("incidence", lambda v, _: angle_between((30, 60), (v, 44)), 1e-6)),
    Row("gazing", "target.elevation", 44, 20, closed("incidence", lambda v, _: angle_between((30, 60), (0, v)), 1e-6)),
    Row("gazing", "sun.azimuth", 30, 60, closed("incidence", lambda v, _: angle_between((v, 60), (0, 44)), 1e-6)),
    Row("gazing", "sun.elevation", 60, 30, closed("incidence", lambda v, _: angle_between((30, v), (0, 44)), 1e-6)),
    Row("gazing", "target.tilt", 0, 30, moves("image")),
    Row("gazing", "target.face", 0, 20, moves("image")),
    Row("gazing", "sun.limb_brightness", 0.6, 0.8, moves("sun_brightness")),
    Row("gazing", "sun.limb_exponent", 2, 3, moves("sun_brightness")),
    Row("gazing", "sun.angular_radius", 4.36, 4.6, moves("image")),
    Row("gazing", "cameras.radius", 0.2, 0.3, moves("image")),
    Row("gazing", "cameras.positions", [[0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.2, -0.2]],
        [[0.25, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.2, -0.2]], moves("image"), {"cameras": {}}),
    Row("gazing", "cameras.noise", 0, 0.01, grows("slope_rms_x")),
    Row("gazing", "cameras.gain_error", 0, 0.05, ratio("image", 1.05, 0.02)),
    Row("gazing", "cameras.gain_noise", 0, 0.05, moves("image")),
    Row("gazing", "cameras.bits", 4, 12, moves("image")),
    Row("gazing", "cameras.threshold", 0.2, 0.9, falls("lit_cameras")),
    Row("gazing", "cameras.seed", 1, 2, moves("image"), {"cameras.noise": 0.01}),
    Row("gazing", "defects.canting_scale", 1, 2,
        ratio(lambda r: np.abs(r.true_slope_y).max() + np.abs(r.true_slope_x).max(), 2, 1e-3)),
    Row("gazing", "defects.waviness", 0.1, 0.2, ratio(lambda r: r.true_slope_x.std(), 2, 1e-6), {"defects": {}}),
    Row("gazing", "defects.waviness_length", 1, 2, moves("true_slope_x"), {"defects": {"waviness": 0.1}}),
    Row("gazing", "defects.seed", 1, 2, moves("true_slope_x"), {"defects": {"waviness": 0.1}}),
    Row("gazing", "defects.pointing", [0, 0], [0.5, 0], moves("pointing_x"), {"defects": {}}),
    Row("gazing", "defects.focal_length", 120, 130, closed("focal_length_estimate", lambda v, _: v, 0.02),
        {"defects": {}}),
    Row("gazing", "profile_noise.noise", 0.001, 0.02, grows("sun_fit_rms"), NOISY),
    Row("gazing", "profile_noise.nodes", 60, 90, moves("sun_brightness"), NOISY),
    Row("gazing", "profile_noise.seed", 1, 2, moves("sun_brightness"), NOISY),
    Row("gazing", "profile_error", 0, 0.05, moves("slope_x")),
    Row("gazing", "erosion", 0, 1, falls(lambda r: (r["mask"] == 3).sum())),
    Row("gazing", "field.latitude", 42.5, 30, moves("incidence"), FIELD_OF_GAZING),
    Row("gazing", "field.day", 80, 172, moves("incidence"), FIELD_OF_GAZING),
    Row("gazing", "field.hours", [10], [11], moves("incidence"), FIELD_OF_GAZING),
    Row("gazing", "field.receiver_height", 80, 120, moves("incidence"), FIELD_OF_GAZING),
    Row("gazing", "field.pivot_height", 5, 20, moves("incidence"), FIELD_OF_GAZING),
    Row("gazing", "field.layout.rows.spacing", 30, 40, moves("incidence"), FIELD_OF_GAZING),
]  # fmt: skip

TABLE = [*FIELD_ROWS, *DISH_ROWS, *MISALIGNMENT_ROWS, *GAZING_ROWS]

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
    row.effect(row)


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
    content = copy.deepcopy(ENERGY) | {"site": {"latitude": 10, "longitude": 0}, "limits": {"dni": 300}}
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
