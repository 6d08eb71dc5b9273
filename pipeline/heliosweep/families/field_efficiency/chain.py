"""From the light that a heliostat sends to the light that its receiver takes: intercept, air and mirrors."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heliosweep.config.distribution import Distribution
from heliosweep.config.profiles import read_profile
from heliosweep.families.field_efficiency import known
from heliosweep.families.field_efficiency.light_files import TURN_COLUMNS, read_calibration, read_slopes
from heliosweep.families.field_efficiency.optics import KEYS
from heliosweep.families.misalignment.blocks import ERRORS
from heliosweep.families.misalignment.draws import standard_deviates, widths_of
from heliosweep.grid.layout_axis import LayoutAxis
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.sun import instants_of
from heliosweep.kernels import sunshapes
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.field.packets import SPINNING_ELEVATION
from heliosweep.kernels.intercept import hflcal
from heliosweep.kernels.intercept.course import course, table_of
from heliosweep.kernels.intercept.efficiency import Scene, sun_tables
from heliosweep.kernels.intercept.field_table import FieldTable
from heliosweep.kernels.intercept.mirror import Errors, Facets
from heliosweep.kernels.intercept.receivers import Receiver, cylinder, rectangle
from heliosweep.kernels.intercept.tables import Tables

if TYPE_CHECKING:
    from heliosweep.families.field_efficiency.study import FieldEfficiencyStudy
    from heliosweep.layouts.layout import Layout


_NO_TABLES = Tables._make((0.0, *(np.zeros((1,) * dimensions) for dimensions in (1, 1, 1, 1, 2, 4, 3, 3, 2, 2, 2))))

#: Transmittance over a slant range in km, with the coefficients of each formula.
_FORMULAS: dict[str, Callable[[Floats], Floats]] = {
    "none": np.ones_like,
    "delsol_clear": lambda r: 1 - (0.006789 + 0.1046 * r - 0.017 * r**2 + 0.002845 * r**3),
    "delsol_hazy": lambda r: 1 - (0.01293 + 0.2748 * r - 0.03394 * r**2),
    "leary_hankins": lambda r: np.where(r <= 1, 0.99321 - 0.1176 * r + 0.0197 * r**2, np.exp(-0.1106 * r)),
    "ballestrin_clear": lambda r: 1 - (0.29544 + 15.22128 * r - 1.8598 * r**2 + 0.15182 * r**3) / 100,
    "ballestrin_hazy": lambda r: 1 - (0.77941 + 55.49083 * r - 14.78875 * r**2 + 1.53718 * r**3) / 100,
}


class Air(NamedTuple):
    """Air of the model vant_hull."""

    visibility: float = 23e3
    """Visibility. [m]"""
    water_vapour: float = 5.9
    """Density of water vapour. [g/m3]"""
    altitude: float = 0.0
    """Altitude of the site. [m]"""
    tower: float = 100.0
    """Height of the receiver above the ground. [m]"""


def transmittance(model: str, slant: Floats, air: Air) -> Floats:
    """Part of the light that passes the air between mirror and receiver.

    Parameters
    ----------
    model : str
        One of `optics.ATTENUATION`: the polynomials of DELSOL3 (Kistler 1986), of Leary and Hankins (1979) and of
        Ballestrin and Marzo (2012), or the model of Vant-Hull as open ray tracers have it.
    slant : ndarray
        Slant range. [m]
    air : Air
        Air of the model vant_hull.

    Returns
    -------
    ndarray
        Between 0 and 1. [1]
    """
    far = slant / 1000
    return np.clip(_vant_hull(far, air) if model == "vant_hull" else _FORMULAS[model](far), 0.0, 1.0)


def _vant_hull(far: Floats, air: Air) -> Floats:
    """Transmittance over a slant range in km: extinction by dust, which thins out upwards, and by water vapour."""
    extinction, vapour = 3.912 / (air.visibility / 1000), air.water_vapour
    thinning = (0.0112 * air.altitude / 1000 + 0.0822) * math.log((extinction + 0.0003 * vapour) / 0.00455)
    power = 1 - (0.00101 * vapour + 0.0507) / math.sqrt(extinction + 0.0091)
    strength = (0.0105 * vapour + 0.724) * (extinction - 0.0037) ** power * math.exp(-thinning * air.tower / 1000)
    transmitted: Floats = np.exp(-strength * far**power)
    return transmitted


#: Fields whose tables are kept: one for each of many threads.
FIELDS = 16

#: Last parts of the keys that the intercept does not depend on.
_AFTER_INTERCEPT = (
    *("reflectivity", "cleanliness", "rate", "washing_interval"),
    *("attenuation", "visibility", "water_vapour", "altitude"),
)


class Inputs(LayoutAxis):
    """The layouts of a study, and what its files tell of the way of the light: read once.

    Threads share it: they replace what is kept, and change nothing of it.
    """

    def __init__(self, study: FieldEfficiencyStudy) -> None:
        super().__init__(study)
        files = study.files()

        def read(key: str, reader: Callable[..., Any]) -> dict[str, Any]:
            return {name: reader(study.resolve(name), name) for name in files.get(f"optics.{key}", ())}

        self.sun = next((sunshapes.table(*table) for table in read("sun_shape.file", read_profile).values()), None)
        self.maps = {PurePath(name).name: slopes for name, slopes in read("slope_map", read_slopes).items()}
        self.mounts = next(iter(read("mount_errors.calibration", read_calibration).values()), None)
        self._fields: list[tuple[tuple[Any, ...], tuple[Any, ...], FieldTable | None]] = []
        self._last: dict[str, tuple[Any, Any]] = {}
        self._shared: known.SharedField | None = None

    def last(self, what: str, key: Any, make: Callable[[], Any]) -> Any:
        """What was made last under a name, if it was for this key; else it is made."""
        known = self._last.get(what)
        if known is None or known[0] != key:
            self._last[what] = known = key, make()
        return known[1]

    def shared_field(self, layout: Layout, mirrors: known.Mirrors) -> known.SharedField:
        """What is kept of a field from other points; nothing yet of another than the last."""
        key, last = b"".join(np.asarray(each).tobytes() for each in mirrors), self._shared
        if last is None or last.layout is not layout or last.mirrors != key:
            self._shared = last = known.SharedField(layout, key, {}, {})
        return last

    def slopes_of(self, name: str, width: float, height: float, facets: Facets, turned: bool) -> tuple[Floats, Floats]:
        """Slopes of a map at the nodes of a mirror, and what is finer: `SlopeMap.at_nodes`; the last ones are kept."""
        key = (PurePath(name).name, width, height, facets, turned)
        found: tuple[Floats, Floats] = self.last("slopes", key, lambda: self.maps[key[0]].at_nodes(*key[1:]))
        return found

    def sun_of(self, values: Mapping[str, Any]) -> sunshapes.SunShape:
        """Sun shape at a point of the result, from the values of `optics.KEYS` by their last part."""
        if values["kind"] == "table":
            assert self.sun is not None
            return self.sun
        return _sun(values["kind"], values["circumsolar_ratio"] if values["kind"] == "buie" else None)

    def tables_of(self, values: Mapping[str, Any], errors: Errors) -> tuple[Tables, Errors]:
        """Tables of that sun for some errors; the last ones are kept."""
        if values["kind"] != "table":
            return _tables(values["kind"], values["circumsolar_ratio"] if values["kind"] == "buie" else None, errors)
        found: tuple[Tables, Errors] = self.last("tables", errors, lambda: sun_tables(self.sun_of(values), errors))
        return found

    def field_table(self, way: Way, mirrors: tuple[Any, ...], sun: Floats, latitude: float | None) -> FieldTable | None:
        """Table of all mirrors of a field at instants, if it has one; those of the last fields are kept."""
        given, field = (latitude, *intercept_values(way.values)), (*mirrors, way.turns(), sun)
        for others, there, found in self._fields:
            if others == given and all(map(_equal, there, field)):
                return found
        found = table_of(way.scene(mirrors, 0, len(mirrors[0])), sun, latitude)
        self._fields = [(given, field, found), *self._fields][:FIELDS]
        return found


def _equal(a: Any, b: Any) -> bool:
    """Whether arguments are the same; the sun of instants that are padded is NaN."""
    return a is b or np.array_equal(a, b, equal_nan=True)


def intercept_values(values: Mapping[str, Any]) -> tuple[Any, ...]:
    """Those of the values of `optics.KEYS`, by their last part, that the intercept depends on."""
    return tuple(value for name, value in values.items() if name not in _AFTER_INTERCEPT)


def receiver_of(kind: str, values: Mapping[str, Any]) -> Receiver:
    """Receiver of the kernels at a point of the result, from the values of `optics.KEYS` by their last part."""
    centre = (0.0, 0.0, float(values["height"]))
    if kind == "cylinder":
        return cylinder(centre, float(values["radius"]), float(values["height_extent"]))
    azimuth, tilt = (math.radians(values[key] or 0.0) for key in ("azimuth", "tilt"))
    return rectangle(centre, azimuth, tilt, float(values["width"]), float(values["height_extent"]))


@lru_cache(16)
def _sun(kind: str, ratio: float | None) -> sunshapes.SunShape:
    if kind == "buie":
        assert ratio is not None
        return sunshapes.buie(ratio)
    made: sunshapes.SunShape = getattr(sunshapes, kind)()
    return made


@lru_cache(4)
def _tables(kind: str, ratio: float | None, errors: Errors) -> tuple[Tables, Errors]:
    return sun_tables(_sun(kind, ratio), errors)


def _errors(values: Mapping[str, Any], rest: Floats) -> Errors:
    """Random errors; of slopes also the `rest` that a map leaves. [rad]"""
    both = values["slope_error"]
    given = (both if both is not None else values[f"slope_error_{axis}"] for axis in ("horizontal", "vertical"))
    slopes = (1e-3 * math.hypot(slope or 0.0, values["tracking_error"]) for slope in given)
    u, v = (math.hypot(slope, float(more)) for slope, more in zip(slopes, rest, strict=True))
    return Errors(u, v, 1e-3 * float(values["specularity_error"]))


def _mount_errors(values: Mapping[str, Any], inputs: Inputs, layout: Layout, start: int, stop: int) -> Floats:
    """Errors of the mounts of heliostats start..stop, shape (N, 6); (0, 6) where none are given. [rad]"""
    if inputs.mounts is not None:
        return inputs.mounts.of(layout)[start:stop]
    given = [values[name] for name in ERRORS]
    if given[0] is None:
        return np.empty((0, len(ERRORS)))
    drawn = standard_deviates(given, layout.numbers[start:stop], 1, int(values["seed"] or 0))[:, 0]
    mean = [error.mean if isinstance(error, Distribution) else error for error in given]
    return 1e-3 * (np.array(mean, np.float64) + values["scale"] * widths_of(given) * drawn)


def months_of(parameters: Parameters, index: tuple[int, ...], longitude: float | None) -> NDArray[np.int64] | None:
    """Month, 0 to 11, of each instant at a point, by mean solar time; None where instants have no dates."""
    instants, sizes = instants_of(parameters), list(parameters.sizes)
    here = instants.at_sites(index[sizes.index(instants.dim)]) if instants.dim in sizes else instants
    labels = here.labels
    if "day" in labels:
        days: NDArray[Any] = (labels["day"].values.astype(np.int64) - 1).astype("timedelta64[D]")
        stamps: NDArray[Any] = np.datetime64("2001-01-01") + days
    elif "utc" in labels:
        stamps = labels["utc"].values + np.timedelta64(round(240 * (longitude or 0.0)), "s")
    else:
        return None
    found: NDArray[np.int64] = stamps.astype("datetime64[M]").astype(np.int64) % 12
    return found


def _cleanliness(study: FieldEfficiencyStudy, values: Mapping[str, Any], months: NDArray[np.int64] | None) -> Floats:
    """Part of the light that dirt leaves, of each instant or of all, shape (T,) or (1,)."""
    assert study.optics is not None
    monthly = study.optics.cleanliness_by_month
    clean = np.array([float(values["cleanliness"])]) if monthly is None else np.array(monthly)[months]
    if values["rate"] is not None:  # of mirrors that are washed in turn, half the dirt of an interval
        clean = clean * (1.0 - values["rate"] * values["washing_interval"] / 2.0)
    return clean


def curve_of(focus: float | str | None, slant: Floats) -> Floats:
    """One over twice the focal length of each mirror, 0 for a flat one. [1/m]"""
    flat = np.zeros(len(slant))
    return flat if focus in (None, "flat") else 0.5 / (slant if focus == "slant" else flat + float(focus))


class Light(NamedTuple):
    """Parts of the light of each heliostat that are left."""

    intercept: Floats
    """At the receiver, shape (N, T); NaN with the sun down. [1]"""
    transmitted: Floats
    """By the air, shape (N,). [1]"""
    reflected: Floats
    """By the mirrors: reflectivity times cleanliness, shape (1,), or (T,) where it changes. [1]"""
    error: Floats
    """Largest error of interpolated intercepts at their checks, shape (N,); 0 where all are computed. [1]"""


class Way(NamedTuple):
    """The way of the light at a point of the result, of which more than the study is known."""

    study: FieldEfficiencyStudy
    """Study with `optics`."""
    inputs: Inputs
    """What its files tell."""
    layout: Layout
    """All heliostats."""
    values: Mapping[str, Any]
    """Values of `optics.KEYS` by the last part of each."""

    def deviation(self) -> float:
        """Variance per axis of rays about that of a perfect mirror and a point sun, at normal incidence. [rad^2]"""
        errors = _errors(self.values, np.zeros(2))
        spread = self.inputs.sun_of(self.values).spread
        return spread + 2.0 * (errors.slope_u**2 + errors.slope_v**2) + errors.specularity**2

    def turns(self) -> Floats:
        """Fixed pointing errors of all heliostats, shape (N, 2). [mrad]"""
        columns = [self.layout.columns.get(name, np.zeros(len(self.layout))) for name in TURN_COLUMNS]
        return np.stack(columns, axis=1).astype(np.float64)

    def scene(self, mirrors: tuple[Any, ...], start: int, stop: int) -> Scene:
        """Heliostats start..stop and their receiver, as the kernels of the intercept take them.

        `mirrors` are those of `light`. For the method `gaussian` it is without tables, and has the
        errors alone.
        """
        study, values = self.study, self.values
        centre = np.stack(mirrors[:3], axis=1)[start:stop]
        sides = 2.0 * np.stack(mirrors[3:5], axis=1)[start:stop]
        target, grid = mirrors[5][start:stop], study.heliostat.facets
        slant = np.sqrt(np.sum((target - centre) ** 2, axis=1))
        facets = Facets(1, 1, 0.0) if grid is None else Facets(grid.columns, grid.rows, float(grid.gap))
        slopes, rest = np.empty((0, 0, 2)), np.zeros(2)
        if values["slope_map"] is not None:
            size = float(sides[0, 0]), float(sides[0, 1])
            slopes, rest = self.inputs.slopes_of(values["slope_map"], *size, facets, mirrors[6] == SPINNING_ELEVATION)
        errors = _errors(values, rest)
        gaussian = values["method"] == "gaussian"
        tables, blurred = (_NO_TABLES, errors) if gaussian else self.inputs.tables_of(values, errors)
        cant = 0.5 / slant if values["canting"] == "on_axis" else np.zeros(len(slant))
        turn = 1e-3 * self.turns()[start:stop]
        mounts = _mount_errors(values, self.inputs, self.layout, start, stop)
        return Scene(
            centre, target, sides, curve_of(values["focus"], slant), cant, turn, facets, mirrors[6], blurred,
            receiver_of(str(study.receiver.kind), values), tables, mounts, slopes,
        )  # fmt: skip


def light(
    way: Way,
    mirrors: tuple[Any, ...],
    sun: Floats,
    place: Sequence[Any],
    months: NDArray[np.int64] | None,
    start: int,
    stop: int,
    shared: known.SharedField | None = None,
) -> Light:
    """Parts of the light of heliostats start..stop that are left.

    Parameters
    ----------
    way : Way
        The way of the light at a point of the result.
    mirrors : tuple
        Centres x, y, z of all mirrors, half their width and height, points that they aim at [m], and code of the
        tracking method.
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun. [1]
    place : sequence
        Values of `grid.sun.PLACE`; None where the sun belongs to no place.
    months : ndarray or None
        Month of each instant, 0 to 11, for cleanliness by month.
    start, stop : int
        First heliostat, and the one after the last.
    shared : SharedField, optional
        What is known of the field from other points.
    """
    values = way.values
    scene = way.scene(mirrors, start, stop)
    slant = np.sqrt(np.sum((scene.target - scene.centre) ** 2, axis=1))

    def intercepted() -> tuple[Floats, Floats]:
        if values["method"] != "gaussian":
            latitude = None if place[0] is None else math.radians(place[0])
            table = way.inputs.field_table(way, mirrors, sun, latitude)
            return course(scene, sun, latitude, table=table)
        return hflcal.intercepts(scene, way.inputs.sun_of(values).spread, sun), np.zeros(stop - start)

    if shared is None:
        intercept, error = intercepted()
    else:
        given = (place[0], *intercept_values(values))
        intercept, error = known.intercept(shared, sun, start, stop, given, intercepted)
    known_air = {key: values[key] for key in ("visibility", "water_vapour") if values[key] is not None}
    altitude = place[2] if values["altitude"] is None else values["altitude"]
    air = Air(**known_air, altitude=float(altitude or 0.0), tower=float(values["height"]))
    reflected = values["reflectivity"] * _cleanliness(way.study, values, months)
    return Light(intercept, transmittance(values["attenuation"], slant, air), reflected, error)


def values_of(given: Sequence[Any]) -> dict[str, Any]:
    """Values of `optics.KEYS`, given in their order, by the last part of each."""
    values = {key.rpartition(".")[2]: value for key, value in zip(KEYS, given, strict=True)}
    return values | {key: 1.0 for key in ("reflectivity", "cleanliness") if values[key] is None}
