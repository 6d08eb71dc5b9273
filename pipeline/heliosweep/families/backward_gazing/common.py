"""Scene, sun and estimates of one point of the parameter grid, for simulated and measured images."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from heliosweep.families.backward_gazing.variables import NODES, NOT_IDENTIFIABLE
from heliosweep.gazing import gazing_scene
from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.gazing.geometry import MirrorGrid, Modules, Scene
from heliosweep.kernels.gazing.modules import module_estimates
from heliosweep.kernels.sun.profiles import EPS_MAX, LIMB, POWER, Profile, jose, render, tabulated
from heliosweep.kernels.sun.tables import noisy, scaled

if TYPE_CHECKING:
    from heliosweep.config.tables import SunProfile
    from heliosweep.families.points import Point

#: Minimum relative difference of focal lengths that is reported, and over its standard error.
NO_SPHERE, SURE = 0.03, 4.0
#: Keys that a scene, its images and slopes depend on.
KEYS = (
    "heliostat.focal_length", "heliostat.distance", "heliostat.pixel", "target.azimuth", "target.elevation",
    "target.tilt", "target.face", "sun.azimuth", "sun.elevation", "sun.limb_brightness", "sun.limb_exponent",
    "sun.angular_radius", "cameras.arrangement", "cameras.radius", "cameras.noise", "cameras.gain_error",
    "cameras.gain_noise", "cameras.bits", "cameras.images", "cameras.supersampling", "cameras.threshold",
    "cameras.seed", "defects.canting_scale", "defects.waviness", "defects.waviness_length", "defects.focal_length",
    "defects.seed", "sun_profile", "profile_noise.noise", "profile_noise.nodes", "profile_noise.seed", "profile_error",
    "erosion",
)  # fmt: skip

Values = dict[str, Any]


class Failure(Exception):
    """There are no slopes at a point; the argument is its scene_status."""


def values_of(point: Point, known: Mapping[str, float]) -> Values:
    """Return the values of `KEYS` at a point; `known` values replace them, seeds without effect are 0."""
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


def scene_of(values: Values, positions: Iterable[tuple[float, float]] | None) -> Scene:
    """Return the scene, with cameras at `positions` in the target's plane [m] or as arranged. Raises Failure."""
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
        raise Failure(NOT_IDENTIFIABLE) from None


def profile_of(values: Values, table: SunProfile | None) -> Profile:
    """Return the profile of the sun. Raises ValueError if noise makes it no darker at its edge."""
    if values["sun_profile"] == "table" and table is not None:
        return tabulated(table.brightness, angle=table.angle)
    limb, power, radius = (values[f"sun.{key}"] for key in ("limb_brightness", "limb_exponent", "angular_radius"))
    eps_max = EPS_MAX if radius is None or radius == 1e3 * EPS_MAX else 1e-3 * radius
    formula = jose(LIMB if limb is None else limb, eps_max, power or POWER)
    if values["sun_profile"] != "noisy":
        return formula
    noise, nodes, seed = (values[f"profile_noise.{key}"] for key in ("noise", "nodes", "seed"))
    return noisy(formula, noise, int(nodes), int(seed))


def assumed(values: Values, profile: Profile) -> Profile:
    """Return the profile of the reconstruction, wider than the true one by `profile_error`."""
    return scaled(profile, values["profile_error"]) if values["profile_error"] else profile


def formula_fit(brightness: ArrayLike) -> tuple[float, float, float, float]:
    """Fit the generalised formula of Jose to a profile by least squares.

    Parameters
    ----------
    brightness : array_like, shape (n,)
        At equal steps from the centre to the edge of the disc, n > 3. [1]

    Returns
    -------
    limb, power, level, residual : float
        A relative to the centre of the fitted curve, the exponent xi between 0.5 and 10, brightness of the curve at
        the disc centre, and the root mean square of the residuals. [1]
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


def sun_of(profile: Profile) -> dict[str, Any]:
    """Return a profile at `NODES` positions on the disc, and the nearest formula of Jose."""
    nodes = np.linspace(0.0, 1.0, NODES)
    known = render(profile, nodes * profile.radius)
    limb, power, level, residual = formula_fit(profile.table if profile.table.size > 3 else known)
    return {
        "sun_brightness": known,
        "sun_formula": level * render(jose(limb, 1.0, power), nodes),
        "sun_limb_fit": limb,
        "sun_exponent_fit": power,
        "sun_radius_fit": 1e3 * profile.radius,
        "sun_fit_rms": residual,
    }


def estimates(
    slopes: Floats,
    deviations: Iterable[Floats | None],
    mirror: MirrorGrid,
    modules: Modules,
    keep: NDArray[np.bool_],
    focal_length: float,
) -> dict[str, Floats]:
    """Return canting, waviness, pointing and focal length with standard errors, by variable. [mrad], [m]

    Of slopes (M, T, 2, N) [rad] by M methods and T referentials, NaN if unknown, with the standard deviation (2, N)
    [rad] of their noise for each method, or None; other arguments as for `module_estimates`.
    """
    found = [
        [module_estimates(one, mirror, modules, keep, focal_length, deviation=noise) for one in frames]
        for frames, noise in zip(slopes, deviations, strict=True)
    ]
    every = {name: np.array([[one[name] for one in row] for row in found]) for name in found[0][0]}
    made = {"focal_length_estimate": every["focal_length"], "focal_length_standard_error": every["focal_length_error"]}
    made |= by_axis("focal_length_%", every["principal"], ends=("long", "short"))
    made |= by_axis("focal_length_%_standard_error", every["principal_error"], ends=("long", "short"))
    made["focal_axis"], made["focal_axis_standard_error"] = np.degrees((every["axis"], every["axis_error"]))
    for name in ("canting", "waviness", "pointing"):
        made |= by_axis(f"{name}_%", 1e3 * every[name])
    for name in ("canting", "pointing"):
        made |= by_axis(f"{name}_%_standard_error", 1e3 * every[f"{name}_error"])
    return made


def shape_remarks(result: xr.Dataset) -> Iterator[str]:
    """Yield warnings about modules that are no parts of spheres and about an unexpected focal length."""
    methods = [name for name in ("LM", "O2") if name in result["slope_method"].to_numpy()]
    if not methods:
        return
    best = result.sel({"slope_method": methods[0]}).isel(referential=0)
    long, short, estimate = (best[f"focal_length_{end}"] for end in ("long", "short", "estimate"))
    with np.errstate(all="ignore"):
        bend, error = 0.5 / short - 0.5 / long, 0.5 * best["focal_length_short_standard_error"] / short**2
        odd = (bend > SURE * error) & (bend > NO_SPHERE * abs(0.5 / estimate))
    numbers = result["module"].to_numpy()[odd.any([dim for dim in odd.dims if dim != "module"]).to_numpy()]
    if numbers.size:
        worst = best.isel(bend.where(odd).fillna(0.0).argmax(...))
        yield (
            f"no part of a sphere: module{'s' * (numbers.size > 1)} {', '.join(map(str, numbers))}; module "
            f"{int(worst['module'])} has focal lengths of {float(worst['focal_length_long']):.4g} m along "
            f"{float(worst['focal_axis']):.0f} deg from horizontal and {float(worst['focal_length_short']):.4g} m "
            f"across ({methods[0]}); focal_length_estimate is a mean of both"
        )
    ideal = best["focal_length" if "focal_length" in best.coords else "distance"]
    away = abs(estimate / ideal - 1.0)
    off = (away > NO_SPHERE) & (abs(estimate - ideal) > SURE * best["focal_length_standard_error"])
    if bool(off.any()):
        far, there = (each.isel(away.where(off).fillna(0.0).argmax(...)) for each in xr.broadcast(estimate, ideal))
        yield (
            f"the focal length found is {float(far):.4g} m, and the focal length of the ideal heliostat "
            f"{float(there):.4g} m: canting is relative to the ideal one, so modules away from the centre are canted "
            "by the difference"
        )


def by_axis(name: str, values: Floats, axis: int = 2, ends: Iterable[str] = "xy") -> dict[str, Floats]:
    """Return values along one axis by name, in which ``%`` is replaced by x and y."""
    return {name.replace("%", end): one for end, one in zip(ends, np.moveaxis(values, axis, 0), strict=True)}
