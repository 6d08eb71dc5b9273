"""Compute mirror slopes from simulated or measured images, for one heliostat or a field.

Measured images are first rectified to the mirror grid (`kernels.gazing.geometry`), and then treated like simulated
images. The slope uncertainties are computed from the image noise in the study. If the study does not specify the noise,
it is estimated from the median of the squared Levenberg-Marquardt residuals, which is insensitive to edges and dirt.

In a field, the direction to the sun is computed for each hour, and the direction to the target from the position of
each heliostat. The distance between a heliostat and the target is the slant range, which is also the default focal
length of the ideal heliostat. With ``facing: heliostat``, the target and its cameras are rotated about the vertical to
face each heliostat. This option represents a ring of cameras around a tower. With ``facing: fixed``, the target faces
the direction `target.face`. Waviness is drawn separately for each heliostat, and noise for each heliostat and hour.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache, partial
from pathlib import PurePath
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from heliosweep.config import SunProfile, ends
from heliosweep.families.backward_gazing import variables as names
from heliosweep.families.backward_gazing.images import (
    ANY_FOCAL,
    BRIGHTEST,
    SUN_IMAGE,
    Shots,
    read_shots,
    read_sun,
    register,
)
from heliosweep.families.backward_gazing.variables import CAMERAS, NEEDED, NOT_CONVERGED, NOT_SEEN, SEEN
from heliosweep.families.family import Computation, Point, Points, by_axis
from heliosweep.gazing import Found, find_slopes, gazing_scene
from heliosweep.grid.parameters import Parameters, coordinate_attributes, coordinate_name
from heliosweep.kernels.compiled import Floats, Integers
from heliosweep.kernels.gazing import geometry as views
from heliosweep.kernels.gazing.geometry import REFERENTIALS, MirrorGrid, Scene, eroded, maps, mirror_grid
from heliosweep.kernels.gazing.slopes import (
    graduated,
    look_back,
    module_estimates,
    module_statistics,
    residual_squares,
    slope_bound,
)
from heliosweep.kernels.profiles import (
    EPS_MAX,
    LIMB,
    POWER,
    Profile,
    jose,
    noisy,
    normal_draws,
    render,
    scaled,
    tabulated,
)
from heliosweep.kernels.sun import declination_cooper, solar_clock
from heliosweep.layouts.resolve import LayoutAxis

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.study import BackwardGazingStudy

#: Thresholds for warnings: lit fraction below which a camera is dark, lit or usable fraction below which a mirror or
#: module is poorly visible, and maximum ratio of the residuals to the noise in the study (about 0.6 in a correct
#: result). [1]
DARK, HARDLY, MUCH = 0.05, 0.5, 1.0
#: Study keys that affect the scene, its images or the slopes.
KEYS = (
    "heliostat.focal_length", "heliostat.distance", "heliostat.pixel", "target.azimuth", "target.elevation",
    "target.tilt", "target.face", "sun.azimuth", "sun.elevation", "sun.limb_brightness", "sun.limb_exponent",
    "sun.angular_radius", "cameras.arrangement", "cameras.radius", "cameras.noise", "cameras.gain_error",
    "cameras.gain_noise", "cameras.bits", "cameras.images", "cameras.supersampling", "cameras.threshold",
    "cameras.seed", "defects.canting_scale", "defects.waviness", "defects.waviness_length", "defects.focal_length",
    "defects.seed", "sun_profile", "profile_noise.noise", "profile_noise.nodes", "profile_noise.seed", "profile_error",
    "erosion",
)  # fmt: skip


class Failure(Exception):
    """Raised if no slopes can be estimated at a point; the argument is the value of `scene_status`."""


def values_of(point: Point, known: Mapping[str, float]) -> dict[str, Any]:
    """Return the values of `KEYS` at a point.

    Values in `known` have priority. Seeds that have no effect are set to 0.
    """
    values = {key: known[key] if key in known else point[key] for key in KEYS}
    values = {key: one.item() if isinstance(one, np.generic) else one for key, one in values.items()}
    values["heliostat.focal_length"] = values["heliostat.focal_length"] or values["heliostat.distance"]
    values["defects.focal_length"] = values["defects.focal_length"] or values["heliostat.focal_length"]
    unused = {
        "cameras.seed": values["cameras.noise"] == values["cameras.gain_noise"] == 0.0,
        "defects.seed": values["defects.waviness"] == 0.0,
        "profile_noise.seed": values["sun_profile"] != "noisy",
    }
    return values | {key: 0 for key, without in unused.items() if without}


def scene_of(values: dict[str, Any], positions: Iterable[tuple[float, float]] | None) -> Scene:
    """Return the scene at a point. Raises Failure if the geometry is impossible.

    `positions` contains the positions of the cameras in the target plane [m]. If `positions` is None, the arrangement
    in the study is used.
    """
    try:
        return gazing_scene(
            *(values[f"{block}.{key}"] for block in ("sun", "target") for key in ("azimuth", "elevation")),
            distance=values["heliostat.distance"],
            focal_length=values["heliostat.focal_length"],
            cameras=values["cameras.arrangement"] if positions is None else tuple(positions),
            radius=values["cameras.radius"],
            tilt=values["target.tilt"],
            face=values["target.face"],
        )
    except ValueError:
        raise Failure(names.NOT_IDENTIFIABLE) from None


def profile_of(values: dict[str, Any], table: SunProfile | None, error: float = 0.0) -> Profile:
    """Return the sun profile, widened by the relative error `error`.

    Raises Failure if the edge of the profile is not darker than its centre.
    """
    limb, power, radius = (values[f"sun.{key}"] for key in ("limb_brightness", "limb_exponent", "angular_radius"))
    eps_max = EPS_MAX if radius is None or radius == 1e3 * EPS_MAX else 1e-3 * radius
    profile = jose(LIMB if limb is None else limb, eps_max, power or POWER)
    try:
        if values["sun_profile"] == "table" and table is not None:
            profile = tabulated(table.brightness, angle=table.angle)
        elif values["sun_profile"] == "noisy":
            noise, nodes, seed = (values[f"profile_noise.{key}"] for key in ("noise", "nodes", "seed"))
            profile = noisy(profile, noise, int(nodes), int(seed))
            graduated(profile)  # raises ValueError if noise makes a smoothed table unusable
    except ValueError:
        raise Failure(names.NO_PROFILE) from None
    return scaled(profile, error) if error else profile


def formula_fit(brightness: ArrayLike) -> tuple[float, float, float, float]:
    """Fit Jose's generalised formula to a profile by least squares.

    Parameters
    ----------
    brightness : array_like, shape (n,)
        Brightness at equally spaced angles from the centre to the edge of the disc, n > 3. [1]

    Returns
    -------
    limb, power, level, residual : float
        Limb brightness A relative to the centre of the fitted curve, and exponent xi, between 0.5 and 10. `level` is
        the brightness of the curve at the disc centre, and `residual` is the root mean square residual. [1]
    """
    from scipy.optimize import minimize_scalar

    table = np.asarray(brightness, np.float64)
    u = np.linspace(0.0, 1.0, len(table))

    def line(power: float) -> tuple[Floats, float]:
        columns = np.stack((np.ones_like(u), np.sqrt(1.0 - u**power)), axis=1)
        fit = np.linalg.lstsq(columns, table, rcond=None)[0]
        return fit, float(np.sum((columns @ fit - table) ** 2))

    power = float(minimize_scalar(lambda trial: line(trial)[1], bounds=(0.5, 10.0), options={"xatol": 1e-6}).x)
    (low, rise), square = line(power)
    return float(low / (low + rise)), power, float(low + rise), math.sqrt(square / len(table))


def slopes_of(
    study: BackwardGazingStudy, values: dict[str, Any], seen: Any, *more: str, fit_gain: bool | None = None
) -> Found:
    """Estimate slopes from images with the study's methods and the additional methods `more`."""
    rows, methods = tuple(map(REFERENTIALS.index, study.referential)), (*study.method, *more)
    return find_slopes(
        seen.layout,
        seen.profile,
        seen.images,
        seen.mirror.pixels,
        values["cameras.threshold"],
        methods,
        rows,
        study.fit_gain if fit_gain is None else fit_gain,
        study.smooth,
    )


def results(
    study: BackwardGazingStudy, values: dict[str, Any], seen: Any, slopes: Floats, counted: Floats,
    deviations: Iterable[Floats | None], least: Floats, quality: Integers,
) -> dict[str, Any]:  # fmt: skip
    """Return the variables that are common to simulated and measured images.

    `seen` contains the layout, mirror, sun, kept pixels, images and estimated slopes. `counted` contains the slopes
    that are used for the estimates, shape (M, T, 2, N) [rad], for M methods and T referentials; missing slopes are NaN.
    For each method, `deviations` contains the standard deviation of the slope noise, shape (2, N) [rad], or None.
    `least` contains the standard deviation of the slopes of each pixel, shape (2, N) [rad].
    """
    mirror, modules, cameras = seen.mirror, study.heliostat.rectangles, np.bitwise_count(seen.found.lit)
    focal = values["heliostat.focal_length"]
    found = [
        [module_estimates(one, mirror, modules, seen.keep, focal, deviation=noise) for one in frames]
        for frames, noise in zip(counted, deviations, strict=True)
    ]
    every = {name: np.array([[one[name] for one in row] for row in found]) for name in found[0][0]}
    inside = np.bincount(mirror.pixel_module[seen.keep], minlength=len(modules.size))
    with np.errstate(invalid="ignore"):
        usable = over_modules(seen, slopes[:, 0, 0])[2] / inside
    made = {
        "focal_length_estimate": every["focal_length"],
        "focal_length_standard_error": every["focal_length_error"],
        "focal_axis": np.degrees(every["axis"]),
        "focal_axis_standard_error": np.degrees(every["axis_error"]),
        **by_axis("waviness_%", 1e3 * every["waviness"]),
        "usable_fraction": usable,
        "lit_cameras": over_modules(seen, cameras / CAMERAS)[0],
        **by_axis("cramer_rao_bound_%", over_modules(seen, 1e3 * least)[1], 0),
        "evaluations": seen.found.evaluations[: len(study.method)],
        "incidence": math.degrees(seen.layout.incidence),
    }
    for name, ending in (("", ""), ("_error", "_standard_error")):
        made |= by_axis(f"focal_length_%{ending}", every[f"principal{name}"], ends=("long", "short"))
        made |= by_axis(f"canting_%{ending}", 1e3 * every[f"canting{name}"])
        made |= by_axis(f"pointing_%{ending}", 1e3 * every[f"pointing{name}"])
    if study.output.maps or study.mode == "measured":
        mask = np.where(~seen.keep, 1, np.where(cameras < NEEDED, 2, 3))
        nodes = np.linspace(0.0, 1.0, names.NODES)
        known = render(seen.sun, nodes * seen.sun.radius)
        limb, power, level, residual = formula_fit(seen.sun.table if seen.sun.table.size > 3 else known)
        made |= {
            "sun_brightness": known,
            "sun_formula": level * render(jose(limb, 1.0, power), nodes),
            "sun_limb_fit": limb,
            "sun_exponent_fit": power,
            "sun_radius_fit": 1e3 * seen.sun.radius,
            "sun_fit_rms": residual,
        }
        made |= by_axis("slope_%", maps(mirror, 1e3 * slopes)) | {"image": maps(mirror, seen.images)}
        made |= {"mask": np.nan_to_num(maps(mirror, mask)), "quality": np.nan_to_num(maps(mirror, quality))}
    return made


def over_modules(seen: Any, values: Floats) -> tuple[Floats, Floats, Integers]:
    """Return the mean, the root mean square and the number of values for each eroded module, shape (..., modules).

    `values` has the shape (..., N).
    """
    return module_statistics(values, seen.mirror.pixel_module, seen.keep, seen.count)


class Simulation:
    """Simulation of a study, with a cache for results that consecutive points share."""

    def __init__(self, study: BackwardGazingStudy, table: SunProfile | None) -> None:
        self.study, self.table = study, table
        self.modules, self.canting = study.heliostat.rectangles, np.zeros((len(study.heliostat.rectangles.size), 2))
        for number, pair in study.defects.canting.items():
            self.canting[int(number) - 1] = 1e-3 * np.array(pair)
        self.of_point, self.ideal = lru_cache(2)(self._of_point), lru_cache(2)(self._ideal)
        self.mirror = lru_cache(4)(lambda pixel: mirror_grid(self.modules, pixel))

    def observe(self, values: dict[str, Any]) -> Any:
        """Render the images at a point and estimate the slopes. Raises Failure if the images cannot determine slopes.

        The result is a namespace with these attributes: `layout`; `mirror`; `keep`, shape (N,), True for pixels that
        remain after erosion; `count`, the number of modules; `sun`, the profile for rendering the images; `profile`,
        the profile for estimating the slopes; `images`, shape (4, N); `share`, the standard deviation of the image
        values for camera noise with a standard deviation of 1 [1]; `true`, the true slopes relative to the ideal
        heliostat, shape (2, N); `found`, the estimated slopes; `ideal`, the slopes estimated for the ideal heliostat;
        and `net`, the difference between `found` and `ideal`, shape (M, T, 2, N) [rad].
        """
        seen = self._with(values)
        layout, sun, mirror, pixel = seen.layout, seen.sun, seen.mirror, values["heliostat.pixel"]
        pointing = 1e-3 * np.array(self.study.defects.pointing)
        wavy = self._wavy(mirror, values)
        truth = self.modules, values["defects.focal_length"], values["defects.canting_scale"] * self.canting, pointing
        images, true = views.image_set(layout, mirror, sun, views.module_spheres(*truth), wavy)
        seed, noise, bits = (values[f"cameras.{key}"] for key in ("seed", "noise", "bits"))
        own = 1.0 + values["cameras.gain_noise"] * normal_draws(int(seed), 4, CAMERAS)  # random stream 4 is for gains
        gains = (1.0 + values["cameras.gain_error"]) * np.maximum(own, 0.0)
        if (kind := values["cameras.images"]) != "mirror_grid":
            reach = np.abs(self.modules.centre) + 0.5 * self.modules.size
            # A tilted mirror appears foreshortened and rotated. Both sides of the image are therefore long enough for
            # the longer side of the mirror.
            side = 2 * math.ceil(float(reach.max()) / pixel) + 2 * 4  # with a margin
            cameras = views.pinholes(layout, (side, side), layout.distance / pixel)
            surface = views.heliostat(*truth, None if wavy is None else (mirror, wavy))
            rays = int(values["cameras.supersampling"])
            pictures = views.camera_set(layout, cameras, (side, side), sun, surface, rays) * gains[:, None, None]
            taken = views.expose(pictures, noise, int(bits), int(seed), pinhole=True)
            given = taken, cameras, layout.focal_length, self.modules, mirror
            if kind == "camera":
                seen.images, _, seen.share = views.rectify(*given)
            else:
                seen.images = views.align(*given)
        else:
            seen.images = views.expose(images * gains[:, np.newaxis], noise, int(bits), int(seed))
        seen.found = slopes_of(self.study, values, seen)
        ideal_keys = ("heliostat.", "target.", "sun", "cameras.arr", "cameras.rad", "cameras.thr", "profile_")
        seen.ideal, ideal_true = self.ideal(tuple(item for item in values.items() if item[0].startswith(ideal_keys)))
        seen.true, seen.net = true - ideal_true, seen.found.slopes - seen.ideal
        seen.keep = eroded(mirror, int(values["erosion"]))
        return seen

    def _with(self, values: dict[str, Any]) -> Any:
        return SimpleNamespace(
            layout=scene_of(values, self.study.cameras.positions), sun=profile_of(values, self.table),
            profile=profile_of(values, self.table, values["profile_error"]), share=np.ones((1, 1)),
            mirror=self.mirror(values["heliostat.pixel"]), count=len(self.canting),
        )  # fmt: skip

    def bound(self, seen: Any, values: dict[str, Any], method: str | None = None) -> Floats:
        """Return the Cramer-Rao bound of the slopes, shape (2, N); NaN if fewer than 3 cameras are lit. [rad]

        If the study sets `fit_gain`, the bound accounts for a fitted gain, unless `method` is A.
        """
        step = views.FULL_SCALE / (2.0 ** values["cameras.bits"] - 1.0) if values["cameras.bits"] else 0.0
        deviation = math.hypot(values["cameras.noise"], step / math.sqrt(12.0))  # noise, and rounding to levels
        least = np.zeros_like(seen.true)
        if deviation > 0.0:
            noise = deviation * seen.share / (1.0 + values["cameras.gain_error"])
            gain = self.study.fit_gain and method != "A"
            least = slope_bound(seen.layout, seen.profile, seen.mirror.pixels, seen.true, noise, gain, seen.found.lit)
        return np.where(np.bitwise_count(seen.found.lit) >= NEEDED, least, np.nan)

    def _of_point(self, items: tuple[tuple[str, Any], ...]) -> dict[str, Any]:
        values, study = dict(items), self.study
        seen = self.observe(values)
        least = self.bound(seen, values)
        mean, rms, _ = over_modules(seen, 1e3 * (seen.net - seen.true))
        entered = 1e3 * np.hypot(*np.transpose(values["defects.canting_scale"] * self.canting))
        relative = 100.0 * np.abs(mean) / np.where(entered > 0.0, entered, 1.0)  # mrad
        own = [self.bound(seen, values, "A") if study.fit_gain and method == "A" else least for method in study.method]
        deviations = [np.nan_to_num(each) if np.any(each > 0.0) else None for each in own]
        quality = seen.found.quality | views.AT_EDGE * ~seen.keep
        made = results(study, values, seen, seen.net, seen.net, deviations, least, quality)
        made["scene_status"] = SEEN if np.isfinite(seen.net[:, 0, 0, seen.keep]).any() else NOT_SEEN
        made |= by_axis("slope_bias_%", mean) | by_axis("slope_rms_%", rms) | by_axis("relative_error_%", relative)
        if study.output.maps:
            for name, slopes in (("raw_slope_%", seen.found.slopes), ("raw_ideal_slope_%", seen.ideal)):
                made |= by_axis(name, maps(seen.mirror, 1e3 * slopes))
            made |= by_axis("true_slope_%", maps(seen.mirror, 1e3 * seen.true), 0)
        return made

    def field(self, point: Point) -> dict[str, Any]:
        """Compute the variables of all heliostats in a field at all hours."""
        layout, span, hours = point.layout, point.part("heliostat"), point.study.field.hours.values()
        suns = solar_clock(np.radians(point["field.latitude"]), declination_cooper(point["field.day"]), hours)
        up = point["field.receiver_height"] - layout.z - point["field.pivot_height"]
        ways = np.stack((-layout.x, -layout.y, up), axis=1)
        inner, fields = names.dims(self.study, self.study.output.maps), ("heliostat", "hour")
        seen = {name: one.dims[2:] for name, one in names.variables(self.study).items() if one.dims[:2] == fields}
        missing = {name: np.full([len(inner[dim][0]) for dim in dims], np.nan) for name, dims in seen.items()}
        missing["usable_fraction"][...] = missing["lit_cameras"][...] = 0.0
        scenes = [
            [missing | self._scene(point, ways[row], sun, (row, hour)) for hour, sun in enumerate(suns)]
            for row in range(len(ways))[span]
        ]
        made = {name: np.array([[each[name] for each in row] for row in scenes]) for name in missing}
        return made | {"slant_range": np.sqrt(layout.x**2 + layout.y**2 + up**2)[span]}

    def _scene(self, point: Point, way: Floats, sun: Floats, number: tuple[int, int]) -> dict[str, Any]:
        """Compute the variables of one heliostat at one hour. The noise seed depends on the heliostat and the hour."""
        if not sun[2] > 0.0:
            return {"scene_status": names.NO_SUN}
        (sun_azimuth, sun_elevation), (azimuth, elevation) = _direction(sun), _direction(way)
        known = {
            "heliostat.distance": math.sqrt(float(np.sum(way**2))), "target.azimuth": azimuth,
            "target.elevation": elevation, "sun.azimuth": sun_azimuth, "sun.elevation": sun_elevation,
        }  # fmt: skip
        if point["field.facing"] == "heliostat":
            known["target.face"] = azimuth
        else:
            tilt, up, turn = np.radians((point["target.tilt"], elevation, azimuth - point["target.face"]))
            if not math.cos(tilt) * math.cos(up) * math.cos(turn) + math.sin(tilt) * math.sin(up) > 0.0:
                return {"scene_status": names.BEHIND}
        values = values_of(point, known)
        if values["cameras.noise"]:
            values["cameras.seed"] = mixed_seed(int(values["cameras.seed"]), *number)
        if values["defects.waviness"]:
            values["defects.seed"] = mixed_seed(int(values["defects.seed"]), number[0])
        try:
            seen = self.observe(values)
        except Failure as failure:
            return {"scene_status": failure.args[0]}
        mean, rms, count = over_modules(seen, 1e3 * (seen.net - seen.true))
        usable = count[:, 0, 0].sum(axis=-1) / int(np.count_nonzero(seen.keep))
        found: dict[str, Any] = {
            "scene_status": SEEN if usable.any() else NOT_SEEN,
            "incidence": math.degrees(seen.layout.incidence),
            "usable_fraction": usable,
            "lit_cameras": float(np.mean(np.bitwise_count(seen.found.lit)[seen.keep])) / CAMERAS,
        }
        if not usable.any():
            return found
        with np.errstate(invalid="ignore", divide="ignore"):
            total = np.sqrt(np.sum(np.where(count > 0, rms**2 * count, 0.0), axis=-1) / count.sum(axis=-1))
            canting = np.sqrt(np.sum(np.where(count > 0, mean**2, 0.0), axis=-1) / np.count_nonzero(count, axis=-1))
            bounds = np.sqrt(np.nanmean((1e3 * self.bound(seen, values)[:, seen.keep]) ** 2, axis=-1))
        if self.study.output.maps:
            found |= by_axis("slope_%", maps(seen.mirror, 1e3 * seen.net))
        found |= by_axis("slope_rms_%", total) | by_axis("canting_rms_%", canting)
        return found | by_axis("cramer_rao_bound_%", bounds, 0)

    def _wavy(self, mirror: MirrorGrid, values: dict[str, Any]) -> Floats | None:
        """Return the slopes due to waviness and to individual module curvatures, shape (2, N) [rad], or None."""
        rms, length, seed = (values[f"defects.{key}"] for key in ("waviness", "waviness_length", "seed"))
        wavy = views.waviness(mirror, 1e-3 * rms, length, int(seed)) if rms else None
        for number, (first, second, axis) in (self.study.defects.curvature or {}).items():
            here, angle = mirror.pixel_module == int(number) - 1, math.radians(axis)
            c, s, curved = math.cos(angle), math.sin(angle), np.array([0.5 / first, 0.5 / second])
            turn = np.array([[c, s], [-s, c]])
            bend = 0.5 / values["defects.focal_length"] * np.eye(2) - turn.T * curved @ turn
            wavy = np.zeros(mirror.pixels.shape) if wavy is None else wavy
            wavy[:, here] += bend @ (mirror.pixels[:, here] - self.modules.centre[int(number) - 1][:, np.newaxis])
        return wavy

    def _ideal(self, items: tuple[tuple[str, Any], ...]) -> tuple[Floats, Floats]:
        """Return the slopes estimated for the ideal heliostat with noise-free cameras, and its true slopes."""
        values = dict(items)
        seen = self._with(values)
        spheres = views.module_spheres(self.modules, values["heliostat.focal_length"], np.zeros_like(self.canting))
        seen.images, true = views.image_set(seen.layout, seen.mirror, seen.profile, spheres)
        return slopes_of(self.study, values, seen).slopes, true


def measured(point: Point, shots: Shots, table: SunProfile | None) -> dict[str, Any]:
    """Compute the variables of measured images at a point of the parameter grid."""
    study, values = point.study, values_of(point, shots.geometry)
    count, fit_gain, modules = len(study.method), study.fit_gain or shots.needs_gain, study.heliostat.rectangles
    mirror, layout = mirror_grid(modules, values["heliostat.pixel"]), scene_of(values, shots.positions)
    seen = SimpleNamespace(
        mirror=mirror, layout=layout, count=len(modules.size), sun=profile_of(values, table),
        profile=profile_of(values, table, values["profile_error"]), keep=eroded(mirror, int(values["erosion"])),
    )  # fmt: skip
    threshold = values["cameras.threshold"]
    seen.images, flags, noises, placed = _on_mirror(point, seen, values["heliostat.focal_length"], threshold, shots)
    more = () if "LM" in study.method else ("LM",)  # uncertainties are computed with LM
    seen.found = slopes_of(study, values, seen, *more, fit_gain=fit_gain)
    fit, slopes, quality = seen.found.fit, seen.found.slopes[:count], seen.found.quality[:count]
    lit = (seen.found.lit >> np.arange(CAMERAS)[:, np.newaxis]) & 1 == 1
    usable, cameras = np.isfinite(fit.slopes[0]), lit.sum(axis=0)

    def residual(method: str, slopes: Floats) -> Floats:
        if method == "LM":
            return fit.merit
        brightness = look_back(layout, seen.profile, mirror.pixels, slopes)[1]
        return residual_squares(brightness, seen.images, threshold, fit_gain and method != "A")

    with np.errstate(all="ignore"):
        share = np.nansum(np.where(lit, noises**2, np.nan), axis=0) / cameras
        noise, freedom = shots.noise, cameras - 2 - fit_gain
        use = seen.keep & (freedom > 0) & np.isfinite(fit.merit) & (fit.flags == 0)
        if math.isnan(noise) and np.count_nonzero(use) >= 20:  # minimum number of pixels
            # Medians of the chi-squared distribution for 1 to 6 degrees of freedom.
            medians = np.array((0.454936, 1.386294, 2.365974, 3.356694, 4.351460, 5.348121))
            noise = math.sqrt(float(np.median(fit.merit[use] / (share[use] * medians[freedom[use] - 1]))))
        deviation = np.where(np.isfinite(fit.slopes), fit.deviation * noise * np.sqrt(share), np.nan)
        left = [[residual(method, one) for one in frames] for method, frames in zip(study.method, slopes, strict=True)]
        rms = np.where(np.isfinite(slopes[:, :, 0]), np.sqrt(np.array(left) / cameras), np.nan)
        inner = (flags & (views.AT_EDGE | views.OUT_OF_FRAME)) == 0
        lit_fraction = (lit & inner).sum(axis=1) / inner.sum(axis=1)
    # only converged slopes are used for the estimates
    counted = np.where((quality & NOT_CONVERGED > 0)[:, np.newaxis, np.newaxis], np.nan, slopes)
    known = [np.where(np.isfinite(deviation), deviation, 0.0)] * count
    used, doubts = seen.keep & usable, quality | np.bitwise_or.reduce(flags, axis=0)
    return {
        **results(study, values, seen, slopes, counted, known, deviation, doubts),
        "lit_fraction": lit_fraction,
        **by_axis("slope_uncertainty_%", maps(mirror, 1e3 * deviation), 0),
        "residual_rms": maps(mirror, rms),
        **placed,
        "saturated_fraction": np.mean(flags & views.SATURATED > 0, axis=1),
        "white_level": shots.white,
        "pixel_noise": noise,
        "gain": float(np.median(fit.gain[used])) if np.any(used) else math.nan,
        "scene_status": SEEN if np.any(usable) else NOT_SEEN,
    }


def registered(point: Point, layout: Scene, focal_length: float, shots: Shots) -> tuple[Floats, dict[str, Floats]]:
    """Return the corners in all images, shape (4, 4, 2), and the registration variables.

    Corners are NaN for images that need no corners, because their pinhole geometry is known. Raises a ValueError with
    the index of the image and the reason if the heliostat is not found.
    """
    corners, found = shots.corners.copy(), np.full((len(names.REGISTERED), CAMERAS), math.nan)
    upright = views.pinholes(layout, shots.images.shape[1:], ANY_FOCAL) if shots.register.any() else None
    for number in np.flatnonzero(shots.register).tolist():

        def see(points: Floats, number: int = number) -> Floats:
            return views.places_of(upright, focal_length, points)[number]  # type: ignore[arg-type]  # some are searched

        image = shots.images[number]
        key = f"{number} {layout.eyes.tobytes()!r} {layout.mirror_axes.tobytes()!r} {focal_length}"
        try:
            place = point.points.once(key, partial(register, image, see, point.study.heliostat.rectangles))
        except ValueError as error:
            raise ValueError(number, str(error)) from None
        corners[number], turn, scale, centre, residual = place
        found[:, number] = -math.degrees(turn), *centre, ANY_FOCAL * scale, residual
    return corners, dict(zip(names.REGISTERED, found, strict=True))


def _on_mirror(
    point: Point, seen: Any, focal_length: float, threshold: float, shots: Shots
) -> tuple[Floats, Integers, Floats, dict[str, Floats]]:
    """Return the images, flags and noise factors on the mirror grid, and the registration variables.

    Raises Failure if the geometry is impossible.
    """
    if shots.rectified:
        images = shots.images[:, ::-1].reshape(CAMERAS, -1)[:, seen.mirror.place]  # grid rows start at the bottom
        flags = views.SATURATED * (images >= shots.saturation[:, np.newaxis])
        flags = flags + views.NOT_A_NUMBER * ~np.isfinite(images)
        return np.where(flags == 0, images, np.nan), flags, np.where(flags == 0, 1.0, np.nan), {}
    try:
        cameras = views.pinholes(seen.layout, shots.images.shape[1:], shots.focal, shots.centre, shots.roll)
        corners, placed = registered(point, seen.layout, focal_length, shots)
        return *views.rectify(
            shots.images, cameras, focal_length, point.study.heliostat.rectangles, seen.mirror, corners=corners,
            saturation=shots.saturation, threshold=threshold,
        ), placed  # fmt: skip
    except ValueError:  # a camera looks straight up or down, or the corners are impossible
        raise Failure(names.NOT_IDENTIFIABLE) from None


def computation(study: BackwardGazingStudy) -> Computation:
    """Return the variables of a study and the function that computes them."""
    simulation, area = lru_cache(1)(partial(Simulation, study)), study.heliostat.rectangles.size.prod(axis=1).sum()
    pixels = math.ceil(area / min(ends(study.heliostat.pixel)) ** 2)
    # bytes per pixel, including results that are common to several points
    each = 8 * (4 * 2 * len(study.method) * len(study.referential) + 80)
    kind = "measured" if study.mode == "measured" else "field" if study.field else "simulated"
    hours, layouts = len(study.field.hours) if study.field else 1, partial(LayoutAxis, key="field.layout")
    with_maps = kind == "measured" or study.output.maps

    def of_point(point: Point) -> dict[str, Any]:
        try:
            if kind == "measured":
                return measured(point, *point.inputs)
            own = simulation(point.inputs[1])
            return own.field(point) if kind == "field" else own.of_point(tuple(values_of(point, {}).items()))
        except Failure as failure:
            return {"scene_status": failure.args[0]}

    one: dict[str, Any] = {
        "layouts": layouts, "split": "heliostat", "evaluations": lambda: hours * pixels * layouts(study).size
    }  # fmt: skip
    if kind != "field":
        one = {"coordinates": partial(coordinates, study, with_maps), "evaluations": pixels}
    if kind == "simulated":
        one |= {"finish": partial(percentiles, study), "whole": names.seed_dims(study)}
    return Computation(
        function=of_point,
        variables=names.variables(study),
        labels=names.LABELS[kind],
        dims=names.dims(study, with_maps),
        attrs=partial(attributes, study),
        inputs=lambda: (read_shots(study) if kind == "measured" else None, read_sun(study)[0]),
        unit="pixels",
        memory=lambda: pixels * each + (2 * read_shots(study).images.nbytes if kind == "measured" else 0),
        mode=kind,
        **one,
    )


def coordinates(study: BackwardGazingStudy, with_maps: bool) -> dict[str, Any]:
    """Return the additional coordinates for one heliostat, including coordinates from metadata."""
    parameters, modules, found = Parameters(study), study.heliostat.rectangles, dict[str, Any]()
    for block in ("sun", "target"):
        if parameters.has(f"{block}.azimuth"):
            azimuth, name = parameters.parameter(f"{block}.azimuth"), f"{block}_world_azimuth"
            found[name] = (azimuth.dims, *names.label(name, (180.0 - azimuth.to_numpy()) % 360.0))
    for name, column in zip(("y", "z", "width", "height"), (*modules.centre.T, *modules.size.T), strict=True):
        found[f"module_{name}"] = ("module", *names.label(f"module_{name}", column))
    if with_maps:
        mirror = mirror_grid(modules, study.heliostat.pixel)  # type: ignore[arg-type]  # not swept with maps
        found["module_of_pixel"] = (names.PLANE, *names.label("module_of_pixel", mirror.module))
    for key, value in read_shots(study).geometry.items() if study.mode == "measured" else ():
        block, field = key.split(".")
        parameter = type(getattr(study, block)).parameter(field)
        name, attrs = coordinate_name(parameter, key), coordinate_attributes(parameter, key)
        attrs.pop("comment", None)  # this comment describes the key
        found[name] = ((), value, attrs)
        if field == "azimuth":
            found[f"{block}_world_azimuth"] = ((), *names.label(f"{block}_world_azimuth", (180.0 - value) % 360.0))
    return found


def attributes(study: BackwardGazingStudy) -> dict[str, str]:
    """Return the global attributes that describe the LM profile and the images."""
    found = {"profile_of_lm": "smooth fit" if study.smooth else "as it is"}
    if study.mode != "measured":
        return found
    shots = read_shots(study)
    ways = {"none": shots.rectified, "registered": shots.register.any(), "corners": np.isfinite(shots.corners).any()}
    return found | {
        "image_files": ", ".join(PurePath(entry.file).name for entry in study.images or ()),
        "white_levels": " ".join(shots.white_from),
        "pixel_noise_from": "residuals" if np.isnan(shots.noise) else "study",
        "gain_of_each_pixel": "fitted" if study.fit_gain or shots.needs_gain else "1",
        "rectification": next((name for name, holds in ways.items() if holds), "pinhole"),
    }


def percentiles(study: BackwardGazingStudy, points: Points, computed: xr.Dataset) -> dict[str, Any]:
    """Compute percentiles of the relative errors over the seeds, ignoring NaN."""
    seeds, percents = names.seed_dims(study), [percent for percent, _ in names.PERCENTILES.values()]
    made: dict[str, Any] = {}
    for name in ("relative_error_x", "relative_error_y"):
        array = computed[name].transpose(..., *seeds).to_numpy()
        flat = array.reshape(*array.shape[: array.ndim - len(seeds)], -1)
        empty = np.isnan(flat).all(axis=-1, keepdims=True)  # points without slopes
        found = np.where(empty[..., 0], np.nan, np.nanpercentile(np.where(empty, 0.0, flat), percents, axis=-1))
        made |= {f"{name}_{ending}": one for ending, one in zip(names.PERCENTILES, found, strict=True)}
    return made


def mixed_seed(seed: int, *numbers: int) -> int:
    """Derive a different seed for each combination of numbers with the SplitMix64 finaliser."""
    for number in numbers:
        seed = (seed + (number + 1) * 0x9E3779B97F4A7C15) % 2**64
        seed = ((seed ^ (seed >> 30)) * 0xBF58476D1CE4E5B9) % 2**64
        seed = ((seed ^ (seed >> 27)) * 0x94D049BB133111EB) % 2**64
        seed ^= seed >> 31
    return seed % 2**63


def _direction(vector: Floats) -> tuple[float, float]:
    """Return the azimuth (from south towards east) and the elevation of a vector (east, north, up). [deg]"""
    east, north, up = map(float, vector)
    return math.degrees(math.atan2(east, -north)), math.degrees(math.atan2(up, math.hypot(east, north)))


def remarks(result: xr.Dataset) -> Iterator[str]:
    """Yield warnings about missing slopes, partly visible modules, images, grey levels and module shapes."""
    status, mode = result["scene_status"], result.attrs["mode"]
    what = "scenes" if mode == "field" else "points"
    for code, count in zip(*np.unique(status, return_counts=True), strict=True):
        if code == NOT_SEEN and mode != "field":
            which = "the heliostat" if status.size == 1 else f"{count:,} of {status.size:,} points"
            yield (
                f"no slopes for {which}: all pixels are masked, because no pixel reflects the sun to three cameras; "
                "check the aim, the geometry and the grey levels"
            )
        elif code != SEEN:
            words = names.STATUS[int(code)].replace("_", " ")
            yield f"no slopes in {count:,} of {status.size:,} {what}: {words} (scene_status {code})"
    if mode == "field":
        never = (status == NOT_SEEN).all("hour")
        if bool(never.any()):
            count = f"{int(never.sum()):,} of {never.size:,}"
            yield f"{count} heliostats are completely masked, because they never reflect the sun to three cameras"
        return
    usable = result["usable_fraction"].where(status == SEEN)
    if mode == "measured":
        yield from _of_images(result, usable)
    elif bool((partly := usable.where(usable < 1.0)).notnull().any()):
        least, at = float(partly.min()), int(partly.notnull().sum())
        yield (
            f"{at:,} of {int(usable.notnull().sum()):,} modules, counted for each method, are only partly visible "
            f"to three cameras; the minimum is {math.floor(1000.0 * least) / 10.0:g} % of the pixels"
        )
    yield from _of_shapes(result)


def _of_images(result: xr.Dataset, usable: xr.DataArray) -> Iterator[str]:
    for name, row in zip(str(result.attrs.get("image_files", "")).split(", "), range(CAMERAS), strict=False):
        name = f"image {row + 1}" + f" ({name})" * bool(name)
        saturated = float(result["saturated_fraction"].isel(camera=row).max())
        lit = float(result["lit_fraction"].isel(camera=row).min())
        if saturated > 0.0:
            yield f"{name}: {100 * saturated:.3g} % of the mirror is saturated and not used; use a shorter exposure"
        if lit < HARDLY:
            seen = f"it sees the sun in only {100 * lit:.3g} % of the mirror"
            yield (f"{name} is dark: {seen}; slopes depend on the other cameras", f"{name}: {seen}")[lit >= DARK]
    source = set(str(result.attrs.get("white_levels", "")).split())
    how = {
        SUN_IMAGE: "is from the sun's image, which does not show the mirror",
        BRIGHTEST: "is unknown and is replaced by the level of the brightest pixels in all images",
    }
    for origin in how.keys() & source:
        yield (
            f"the white level {how[origin]}: a gain is fitted at each pixel for O1, O2 and LM, but not for A. The "
            "ratios between the white levels of the cameras are unknown; in the paper's geometry, an error of 1 % "
            "shifts all slopes by 0.06 mrad, like a pointing error. Set 'white', or WHITE in the metadata of each "
            "image"
        )
    gain = result["gain"].to_numpy()
    if np.any(np.abs(gain[np.isfinite(gain)] - 1.0) > 0.05) and not source & set(how):
        yield f"the fitted gain is {np.nanmedian(gain):.3f}: check the white level"
    residual = float(result["residual_rms"].isel(slope_method=-1).median())
    noise = float(result["pixel_noise"].median())
    if result.attrs.get("pixel_noise_from") == "study" and residual > MUCH * noise:
        yield (
            f"the residuals ({residual:.2g} of the brightness of the sun's centre) are much larger than the noise in "
            f"the study ({noise:.2g}): the sun profile, the geometry or the gain of a camera is probably wrong, so the "
            "uncertainties are too small"
        )
    least = usable.min([dim for dim in usable.dims if dim != "module"]).to_numpy()
    if (few := np.flatnonzero(least < HARDLY)).size:
        modules = ", ".join(f"{result['module'].to_numpy()[row]} ({100 * least[row]:.0f} %)" for row in few)
        yield f"fewer than half of the pixels have slopes in module {modules}: estimates depend on only a few pixels"
    known = result["slope_x"].notnull().any(dim="referential")
    for method in result["slope_method"].to_numpy():
        flagged = ((result["quality"] & NOT_CONVERGED) > 0) & known
        lost, all_ = (int(one.sel(slope_method=method).sum()) for one in (flagged, known))
        if lost > 0.01 * max(1, all_):
            yield f"{100 * lost / all_:.3g} % of the {method} slopes did not converge (quality {NOT_CONVERGED})"


def _of_shapes(result: xr.Dataset) -> Iterator[str]:
    # A difference counts if it exceeds both 3 % and four standard errors.
    method = next((name for name in ("LM", "O2") if name in result["slope_method"].to_numpy()), "")
    if not method:
        return
    best = result.sel(slope_method=method).isel(referential=0)
    long, short, estimate = (best[f"focal_length_{end}"] for end in ("long", "short", "estimate"))
    with np.errstate(all="ignore"):
        bend, error = 0.5 / short - 0.5 / long, 0.5 * best["focal_length_short_standard_error"] / short**2
        odd = (bend > 4.0 * error) & (bend > 0.03 * abs(0.5 / estimate))
    numbers = result["module"].to_numpy()[odd.any([dim for dim in odd.dims if dim != "module"]).to_numpy()]
    if numbers.size:
        worst = best.isel(bend.where(odd).fillna(0.0).argmax(...))
        yield (
            f"not spherical: module{'s' * (numbers.size > 1)} {', '.join(map(str, numbers))}; module "
            f"{int(worst['module'])} has focal lengths of {float(worst['focal_length_long']):.4g} m along "
            f"{float(worst['focal_axis']):.0f} deg from horizontal and {float(worst['focal_length_short']):.4g} m "
            f"across ({method}); focal_length_estimate is based on the mean curvature of all modules"
        )
    ideal = best["focal_length" if "focal_length" in best.coords else "distance"]
    away = abs(estimate / ideal - 1.0)
    off = (away > 0.03) & (abs(estimate - ideal) > 4.0 * best["focal_length_standard_error"])
    if bool(off.any()):
        far, there = (each.isel(away.where(off).fillna(0.0).argmax(...)) for each in xr.broadcast(estimate, ideal))
        yield (
            f"the estimated focal length is {float(far):.4g} m, but the ideal heliostat has a focal length of "
            f"{float(there):.4g} m: canting is relative to the ideal heliostat, so the canting of modules away from "
            "the centre includes the difference"
        )
