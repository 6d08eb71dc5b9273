"""One point of the parameter grid: its scene, the sun, slopes by all methods, and estimates of the modules."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, get_type_hints

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from heliosweep.families.backward_gazing.variables import NODES, NOT_IDENTIFIABLE, most_pixels
from heliosweep.grid.parameters import Parameters
from heliosweep.grid.plan import Workload
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.gazing import linear
from heliosweep.kernels.gazing.geometry import (
    EXACT,
    REFERENTIALS,
    MirrorGrid,
    Modules,
    Scene,
    camera_square,
    scene,
    transfers,
)
from heliosweep.kernels.gazing.modules import module_estimates
from heliosweep.kernels.gazing.slopes import UNLIT, SlopeFit, fit_slopes, graduated, search_slopes
from heliosweep.kernels.sun.profiles import EPS_MAX, LIMB, POWER, Profile, jose, render, tabulated
from heliosweep.kernels.sun.tables import noisy, scaled, smooth_fit

if TYPE_CHECKING:
    from heliosweep.config.profiles import SunProfile
    from heliosweep.families.backward_gazing.study import BackwardGazingStudy
    from heliosweep.grid.regions import Variable

#: Relative difference of focal lengths that is said, and over its standard error.
NO_SPHERE, SURE = 0.03, 4.0
#: The largest kernels of all families, and what is needed to load them. [bytes]
KERNEL_BYTES = 25 * 2**20

#: Keys of the study in the order of `Point`.
KEYS = (
    "heliostat.focal_length", "heliostat.distance", "heliostat.pixel", "target.azimuth", "target.elevation",
    "target.tilt", "target.face", "sun.azimuth", "sun.elevation", "cameras.arrangement", "cameras.radius",
    "cameras.noise", "cameras.gain_error", "cameras.gain_noise", "cameras.bits", "cameras.images",
    "cameras.supersampling", "cameras.threshold", "cameras.seed", "defects.canting_scale", "defects.waviness",
    "defects.waviness_length", "defects.focal_length", "defects.seed", "sun_profile", "profile_noise.noise",
    "profile_noise.nodes", "profile_noise.seed", "profile_error", "erosion", "sun.limb_brightness",
    "sun.limb_exponent", "sun.angular_radius",
)  # fmt: skip


class Point(NamedTuple):
    """Values of the study's keys at a point of its grid; see `KEYS`."""

    focal_length: float
    distance: float
    pixel: float
    target_azimuth: float
    target_elevation: float
    tilt: float
    face: float
    sun_azimuth: float
    sun_elevation: float
    arrangement: str
    radius: float
    noise: float
    gain_error: float
    gain_noise: float
    bits: int
    images: str
    supersampling: int
    threshold: float
    camera_seed: int
    canting_scale: float
    waviness: float
    waviness_length: float
    true_focal_length: float
    defect_seed: int
    sun_profile: str
    profile_noise: float
    nodes: int
    profile_seed: int
    profile_error: float
    erosion: int
    limb: float
    exponent: float
    angular_radius: float

    @classmethod
    def of(cls, values: Iterable[Any], **known: float) -> Point:
        """Values as the grid has them, None where the study gives none; what has no part in them becomes 0.

        Those that are `known` otherwise, by name, take their place.
        """
        given = {**dict(zip(cls._fields, values, strict=True)), **known}
        point = cls(**{name: _KINDS[name](math.nan if one is None else one) for name, one in given.items()})
        if math.isnan(point.focal_length):
            point = point._replace(focal_length=point.distance)
        if math.isnan(point.true_focal_length):
            point = point._replace(true_focal_length=point.focal_length)
        if point.noise == point.gain_noise == 0.0:
            point = point._replace(camera_seed=0)
        if point.waviness == 0.0:
            point = point._replace(defect_seed=0, waviness_length=1.0)
        if point.sun_profile != "noisy":
            point = point._replace(profile_noise=0.0, nodes=0, profile_seed=0)
        if math.isnan(point.limb) or point.sun_profile == "table":
            point = point._replace(limb=LIMB)
        if math.isnan(point.exponent) or point.sun_profile == "table":
            point = point._replace(exponent=POWER)
        if math.isnan(point.angular_radius) or point.sun_profile == "table":
            point = point._replace(angular_radius=1e3 * EPS_MAX)
        if point.images != "camera":
            point = point._replace(supersampling=1)
        return point

    @property
    def ideal(self) -> Point:
        """The ideal heliostat, seen by cameras without noise under the profile by which slopes are found."""
        return self._replace(
            noise=0.0, gain_error=0.0, gain_noise=0.0, bits=0, images="mirror_grid", supersampling=1, camera_seed=0,
            canting_scale=0.0, waviness=0.0, waviness_length=1.0, true_focal_length=self.focal_length, defect_seed=0,
            erosion=0,
        )  # fmt: skip

    def layout(self, positions: Iterable[tuple[float, float]] | None) -> Scene:
        """The scene, with cameras at places in the target's plane [m] or as they are arranged. Raises Failure."""
        try:
            return scene(
                (math.radians(self.sun_azimuth), math.radians(self.sun_elevation)),
                (math.radians(self.target_azimuth), math.radians(self.target_elevation)),
                camera_square(self.radius, self.arrangement) if positions is None else tuple(positions),
                self.distance,
                self.focal_length,
                math.radians(self.tilt),
                math.radians(self.face),
            )
        except ValueError:
            raise Failure(NOT_IDENTIFIABLE) from None

    def profile(self, table: SunProfile | None) -> Profile:
        """Profile of the sun. Raises ValueError where noise makes it no darker at its edge."""
        if self.sun_profile == "table" and table is not None:
            return tabulated(table.brightness, angle=table.angle)
        radius = EPS_MAX if self.angular_radius == 1e3 * EPS_MAX else 1e-3 * self.angular_radius
        formula = jose(self.limb, radius, self.exponent)
        if self.sun_profile == "noisy":
            return noisy(formula, self.profile_noise, self.nodes, self.profile_seed)
        return formula

    def known(self, profile: Profile) -> Profile:
        """The profile by which slopes are found, of the one that makes the images: wider by `profile_error`."""
        return scaled(profile, self.profile_error) if self.profile_error else profile


_KINDS = get_type_hints(Point)


class Failure(Exception):
    """There are no slopes at a point; the argument is its scene_status."""

    @property
    def status(self) -> int:
        """The scene_status."""
        return int(self.args[0])


class Solver(NamedTuple):
    """Methods by which slopes are found, the same at all points of a study."""

    methods: tuple[str, ...]
    referentials: tuple[int, ...]
    """Rows of `geometry.transfers`; O2 and LM have the same slopes in each."""
    fit_gain: bool
    """True where O1, O2 and LM find a gain for each pixel."""
    smooth: bool
    """True where LM ends at the smooth fit of a tabulated profile instead of the table: better where the images are of
    the sun and the table has noise of its own."""

    @classmethod
    def of(cls, study: BackwardGazingStudy) -> Solver:
        """Those that a study asks for."""
        return cls(study.method, tuple(map(REFERENTIALS.index, study.referential)), study.fit_gain, study.smooth)


class Found(NamedTuple):
    """Slopes by M methods and T referentials."""

    slopes: Floats
    """p relative to the ideal mirror, shape (M, T, 2, N); NaN where fewer than 3 cameras are lit. [rad]"""
    lit: NDArray[np.int64]
    """Bit i is set where camera i is lit, shape (N,)."""
    quality: NDArray[np.int64]
    """Bits of `shared`: NOT_CONVERGED, UNLIT, OUTSIDE; shape (M, N)."""
    fit: SlopeFit | None
    """Result of LM; None where it is not among the methods."""
    evaluations: Floats
    """Mean number of evaluations of the merit at a pixel with slopes, 0 for A, shape (M,)."""


def reconstruct(
    layout: Scene, profile: Profile, images: Floats, mirror: MirrorGrid, threshold: float, solver: Solver
) -> Found:
    """Find slopes by all methods from one set of images, simulated or measured.

    Images (K, N) are NaN where a camera's pixel cannot be used. `threshold` is the least brightness of lit ones. [1]
    """
    y, z = mirror.pixel_y, mirror.pixel_z
    every = transfers(layout)
    matrices = np.ascontiguousarray(every[list(solver.referentials)])
    ideal = linear.ideal_squares(layout, y, z)
    rows = linear.solutions(layout.gaze)
    departures, lit = linear.wavefront_departures(images, ideal, rows, profile, threshold)
    start = linear.transferred(departures, every[EXACT:])[0]
    slopes = np.empty((len(solver.methods), len(matrices), 2, y.size))
    quality = np.zeros((len(solver.methods), y.size), np.int64)
    how: dict[str, Any] = {"threshold": threshold, "fit_gain": solver.fit_gain}
    evaluations, fit = np.zeros(len(solver.methods)), None
    for row, method in enumerate(solver.methods):
        if method == "A":
            slopes[row] = linear.transferred(departures, matrices)
            quality[row] = UNLIT * ~np.isfinite(departures[0])
            continue
        if method == "O1":
            wavefront = linear.ideal_wavefront(layout, ideal)
            found = search_slopes(layout, profile, images, wavefront + departures, **how)
            slopes[row] = linear.transferred(found.slopes - wavefront, matrices)
            quality[row] = found.flags
        elif method == "O2":
            found = search_slopes(layout, profile, images, start, [y, z], **how)
            slopes[row], quality[row] = found.slopes, found.flags
        else:
            smooth = solver.smooth and profile.table.size > 3
            stages = [smooth_fit(profile)] if smooth else graduated(profile)
            found = fit = fit_slopes(layout, stages, images, start, [y, z], **how)
            slopes[row], quality[row] = fit.slopes, fit.flags
        spent = found.evaluations[found.evaluations > 0]
        evaluations[row] = spent.mean() if spent.size else 0.0
    return Found(slopes, lit, quality, fit, evaluations)


class FormulaFit(NamedTuple):
    """The formula of Jose nearest to a table."""

    limb: float
    """A, relative to the centre of the fitted curve. [1]"""
    power: float
    """xi. [1]"""
    level: float
    """Brightness of the fitted curve at the disc centre. [1]"""
    residual: float
    """Root mean square of the table less the curve. [1]"""


def formula_fit(brightness: ArrayLike) -> FormulaFit:
    """The generalised formula of Jose nearest to a profile, in the sense of least squares.

    `brightness` is at equal steps from the centre to the edge of the disc, eps_max, shape (n,), n > 3. For an exponent
    xi the formula is a line in sqrt(1 - u^xi); the best xi between 0.5 and 10 is searched for.
    """
    from scipy.optimize import minimize_scalar

    table = np.asarray(brightness, np.float64)
    u = np.linspace(0.0, 1.0, len(table))

    def line(power: float) -> tuple[Floats, float]:
        columns = np.stack((np.ones_like(u), np.sqrt(1.0 - u**power)), axis=1)
        fit = np.asarray(np.linalg.lstsq(columns, table, rcond=None)[0], np.float64)
        return fit, float(np.sum((columns @ fit - table) ** 2))

    power = float(minimize_scalar(lambda trial: line(trial)[1], bounds=(0.5, 10.0), options={"xatol": 1e-6}).x)
    (low, rise), square = line(power)
    return FormulaFit(float(low / (low + rise)), power, float(low + rise), math.sqrt(square / len(table)))


def sun_of(profile: Profile) -> dict[str, Any]:
    """A profile at `variables.NODES` places of the disc, and the formula of Jose nearest to it. [1], [mrad]"""
    nodes = np.linspace(0.0, 1.0, NODES)
    known = render(profile, nodes * profile.radius)
    fit = formula_fit(profile.table if profile.table.size > 3 else known)
    return {
        "sun_brightness": known,
        "sun_formula": fit.level * render(jose(fit.limb, 1.0, fit.power), nodes),
        "sun_limb_fit": fit.limb,
        "sun_exponent_fit": fit.power,
        "sun_radius_fit": 1e3 * profile.radius,
        "sun_fit_rms": fit.residual,
    }


def estimates(
    slopes: Floats,
    deviations: Iterable[Floats | None],
    mirror: MirrorGrid,
    modules: Modules,
    keep: NDArray[np.bool_],
    focal_length: float,
) -> dict[str, Floats]:
    """Canting, waviness, pointing and focal length, with standard errors, by the names of their variables. [mrad], [m]

    Of slopes (M, T, 2, N) [rad] by M methods and T referentials, NaN where unknown, whose noise is known for each
    method as a standard deviation (2, N) [rad] or not at all; the rest as for `module_estimates`.
    """
    found = [
        [module_estimates(one, mirror, modules, keep, focal_length, deviation=noise) for one in frames]
        for frames, noise in zip(slopes, deviations, strict=True)
    ]

    def all_of(name: str) -> Floats:
        return np.array([[getattr(one, name) for one in row] for row in found])

    made = {"focal_length_estimate": all_of("focal_length")}
    made["focal_length_standard_error"] = all_of("focal_length_error")
    for name, values in (("focal_length_%", "principal"), ("focal_length_%_standard_error", "principal_error")):
        for end, one in zip(("long", "short"), np.moveaxis(all_of(values), 2, 0), strict=True):
            made[name.replace("%", end)] = one
    made["focal_axis"], made["focal_axis_standard_error"] = (np.degrees(all_of(key)) for key in ("axis", "axis_error"))
    for name in ("canting", "canting_error", "waviness", "pointing", "pointing_error"):
        made |= by_axis(name.replace("_error", "_%_standard_error") if "_" in name else f"{name}_%", 1e3 * all_of(name))
    return made


def shape_remarks(result: xr.Dataset) -> Iterator[str]:
    """Modules that are no parts of spheres, and a focal length that is not the ideal one, by the best method."""
    methods = [name for name in ("LM", "O2") if name in result["slope_method"].to_numpy()]
    if not methods:
        return
    best = result.sel({"slope_method": methods[0]}).isel(referential=0)
    long, short = best["focal_length_long"], best["focal_length_short"]
    with np.errstate(all="ignore"):
        bend, error = 0.5 / short - 0.5 / long, 0.5 * best["focal_length_short_standard_error"] / short**2
        odd = (bend > SURE * error) & (bend > NO_SPHERE * abs(0.5 / best["focal_length_estimate"]))
    numbers = result["module"].to_numpy()[odd.any([dim for dim in odd.dims if dim != "module"]).to_numpy()]
    if numbers.size:
        index = {dim: int(at) for dim, at in bend.where(odd).fillna(0.0).argmax(...).items()}
        f1, f2, axis = (
            float(best[name].isel(index)) for name in ("focal_length_long", "focal_length_short", "focal_axis")
        )
        yield (
            f"no part of a sphere: module{'s' * (numbers.size > 1)} {', '.join(map(str, numbers))}; module "
            f"{int(result['module'][index['module']])} has focal lengths of {f1:.4g} m along {axis:.0f} deg from "
            f"horizontal and {f2:.4g} m across ({methods[0]}); focal_length_estimate is a mean that none of them has"
        )
    found, ideal = best["focal_length_estimate"], best["focal_length" if "focal_length" in best.coords else "distance"]
    away = abs(found / ideal - 1.0)
    off = (away > NO_SPHERE) & (abs(found - ideal) > SURE * best["focal_length_standard_error"])
    if bool(off.any()):
        index = {dim: int(at) for dim, at in away.where(off).fillna(0.0).argmax(...).items()}
        here = found.isel(index)
        there = float(ideal.isel({dim: at for dim, at in index.items() if dim in ideal.dims}))
        yield (
            f"the focal length found is {float(here):.4g} m, and that of the ideal heliostat {there:.4g} m: canting is "
            "against the ideal one, so modules away from the centre are canted by the difference"
        )


def by_axis(name: str, values: Floats, axis: int = 2) -> dict[str, Floats]:
    """Values of both directions, which are along one axis, by name: ``%`` stands for x and y."""
    return {name.replace("%", end): one for end, one in zip("xy", np.moveaxis(values, axis, 0), strict=True)}


def gathered(
    variables: Mapping[str, Variable],
    sizes: Mapping[str, int],
    points: Iterable[tuple[tuple[int, ...], Mapping[str, Any]]],
) -> xr.Dataset:
    """Data set of the values of points, each with its index along the first dimensions; NaN or 0 where there are none.

    `variables` have all their dimensions, and `sizes` are those of the region that is computed.
    """
    arrays = {
        name: np.full([sizes[dim] for dim in one.dims], math.nan if one.dtype.kind == "f" else 0, one.dtype)
        for name, one in variables.items()
    }
    for index, values in points:
        for name, value in values.items():
            arrays[name][index] = value
    return xr.Dataset({name: (variables[name].dims, array) for name, array in arrays.items()})


def workload_of_points(
    study: BackwardGazingStudy, inner: Mapping[str, int], held: int = 0, whole: tuple[str, ...] = ()
) -> Workload:
    """Sizes and cost of a study of one heliostat, for the plan.

    With the lengths of the dimensions after the swept ones, the memory of a part in addition to its pixels [bytes], and
    the swept dimensions of statistics.
    """
    pixels = most_pixels(study)
    return Workload(
        parameters=Parameters(study).sizes,
        inner=inner,
        evaluations=pixels,
        unit="pixels",
        splittable="",
        working_bytes=lambda points, length: held + pixels * bytes_per_pixel(study),
        whole=whole,
        coordinate_bytes=8 * (200 + 6 * inner["module"] + inner.get("z", 0) * inner.get("y", 0)),
        fixed_bytes=KERNEL_BYTES,
    )


def bytes_per_pixel(study: BackwardGazingStudy) -> int:
    """Working memory of a part for each pixel, what is remembered included. [bytes]"""
    return 8 * (4 * 2 * len(study.method) * len(study.referential) + 45)
