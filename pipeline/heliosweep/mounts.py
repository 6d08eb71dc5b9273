"""Encoder angles, spots, deviation curves and calibration of heliostat mounts, without a study file.

Coordinates are x east, y north and z up [m]. Azimuths run clockwise from north [deg]. Spots lie in the plane of a flat
receiver through the aim point. Seen from the field, the spot coordinate y points to the right, and z points up along
the receiver face [m].

A mount has a primary axis, and a secondary axis perpendicular to the primary axis. If the primary axis is vertical and
the mount has no errors, the two axes are the azimuth and elevation axes. The mount errors [mrad], in the order of
`ERRORS`, are:

- ``azimuth_reference``: zero offset of the primary encoder, positive clockwise as seen from the end of the axis;
- ``elevation_reference``: zero offset of the secondary encoder, positive up;
- ``tilt_about_east``, ``tilt_about_north``: tilts of the primary axis about the first and second axes of the mount
  frame, which are east and north for a vertical primary axis;
- ``non_orthogonality``: angle between the secondary axis and the plane perpendicular to the primary axis;
- ``collimation``: angle between the mirror normal and the plane perpendicular to the secondary axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels import calibration, spots, traces
from heliosweep.kernels import mounts as aiming
from heliosweep.kernels.compiled import Floats
from heliosweep.kernels.mounts import ERRORS, POLAR
from heliosweep.lazy import xr
from heliosweep.light import heliostat_coordinates, mirror_centres, per_item, sun_directions

#: Mount kinds, error sources, error axes and loss functions, each in the order of their codes in the kernels.
KINDS = ("azimuth_elevation", "target_aligned", "polar", "tilt_roll")
SOURCES, AXES = ("canting", "encoder", "tilt"), ("elevation", "azimuth", "encoder_azimuth")
LOSSES = ("squared", "huber", "cauchy")
_ANGLES = {"primary_angle": "angle of the primary axis", "secondary_angle": "angle of the secondary axis"}
CONDITION_LIMITS = calibration.CONDITION_LIMITS
#: Meanings of `spot_status`.
SPOT_STATUS = {
    aiming.REACHES: "reaches_the_plane",
    aiming.MISSES: "ray_misses_the_plane_or_back_of_the_mirror_is_lit",
    aiming.BEHIND_FACE: "mirror_on_or_behind_the_plane",
    aiming.NO_SUN: "sun_below_the_horizon",
    aiming.BLIND_CONE: "mount_cannot_point_there",
    aiming.TOO_NEAR: "offsets_not_smaller_than_the_distance",
}
#: Meanings of `calibration_status`, in which % is replaced by "spot" or "crossing".
CALIBRATION_STATUS = {
    calibration.ESTIMATED: "estimated",
    calibration.TOO_FEW: "fewer_%s_than_the_errors_need",
    calibration.INDISTINCT: "estimated_but_the_condition_number_is_above_the_limit",
    calibration.NOT_CONVERGED: "not_converged",
    calibration.DEPENDENT: "%s_cannot_tell_the_errors_apart",
    calibration.EXACT: "estimated_but_no_%_is_left_for_standard_errors",
    calibration.NO_OBSERVATIONS: "no_%s",
}


def mount_angles(
    sun_azimuth: ArrayLike, sun_elevation: ArrayLike, pivot: Any, aim: ArrayLike, *, kind: str = "azimuth_elevation",
    errors: Any = None, **mount: Any,
) -> xr.Dataset:  # fmt: skip
    """Compute the encoder angles at which mounts reflect sunlight to their aim points.

    Parameters
    ----------
    sun_azimuth, sun_elevation : float, array or DataArray, shape (T,)
        Azimuth and elevation of the sun. [deg]
    pivot : array, DataFrame, Dataset or mapping
        Pivots of the mounts, as an array of shape (3,) or (N, 3) or a table with columns x, y and z. [m]
    aim : float or array, shape (3,) or (N, 3)
        Aim points, or the height of an aim point at x = y = 0. [m]
    kind : {'azimuth_elevation', 'target_aligned', 'polar', 'tilt_roll'}
        Kind of mount. The primary axis is vertical ('azimuth_elevation'), points to the aim point ('target_aligned'),
        points to the celestial north pole ('polar'), or is horizontal ('tilt_roll').
    errors : mapping or array, shape (K,) or (N, K), optional
        Mount errors for which the encoder angles compensate, as a mapping of names to values or as an array of the
        first K errors in `ERRORS` (default: no errors). [mrad]
    **mount : float
        Other properties of the mount and the receiver:

        - ``latitude`` of a polar mount, or ``axis_azimuth`` of the primary axis of a tilt-roll mount [deg];
        - ``mirror_offset``, the distance of the mirror centre in front of the secondary axis [m];
        - ``axis_offset``, the distance of the secondary axis in front of the primary axis [m];
        - ``pedestal_height``, the height of the pivot above the point about which the mount tilts [m];
        - ``receiver_azimuth`` and ``receiver_tilt``, the azimuth of the receiver normal (0 for a field to the north)
          and its tilt above the horizontal, which do not affect the angles [deg].

    Returns
    -------
    xarray.Dataset
        The variable `primary_angle` is measured from the zero direction of the mount frame (north for a vertical axis),
        positive clockwise as seen from the end of the axis. The variable `secondary_angle` is measured from the plane
        perpendicular to the primary axis. The dimensions are ``heliostat`` (omitted for a single pivot) and ``time``
        (omitted for a single instant). Angles are NaN if the sun is below the horizon, or if the mount cannot point in
        the required direction. [deg]

    Raises
    ------
    ValueError
        If the shapes do not match, the kind or an error is unknown, a pivot is at its aim point, or a polar mount has
        no latitude.

    References
    ----------
    Optics Express 27(8), A257 (2019), extended to all six errors and the offsets.

    Examples
    --------
    >>> import heliosweep
    >>> angles = heliosweep.mount_angles(180.0, 40.0, pivot=(0.0, 100.0, 4.0), aim=104.0)
    >>> float(angles.primary_angle.round(6)) % 360.0, float(angles.secondary_angle.round(6))
    (180.0, 42.5)
    """
    scene = _scene(sun_azimuth, sun_elevation, pivot, aim, kind, **mount)
    return _angles(scene, scene.mounts.aim(scene.sun, _errors(errors, len(scene.pivots))[:, np.newaxis]))


def mount_spots(
    sun_azimuth: ArrayLike, sun_elevation: ArrayLike, pivot: Any, aim: ArrayLike, errors: Any = None, *,
    corrected: Any = None, kind: str = "azimuth_elevation", **mount: Any,
) -> xr.Dataset:  # fmt: skip
    """Compute the positions of heliostat spots on the receiver plane for given mount errors.

    Parameters
    ----------
    sun_azimuth, sun_elevation, pivot, aim, kind, **mount
        As in `mount_angles`.
    errors : mapping or array, shape (K,) or (N, K), optional
        Mount errors, as a mapping of names to values or as an array of the first K errors in `ERRORS` (default: no
        errors). [mrad]
    corrected : mapping or array, optional
        Mount errors for which the commanded angles compensate (default: no errors). [mrad]

    Returns
    -------
    xarray.Dataset
        The variables `spot_y` and `spot_z` are the coordinates of the spots; NaN if the ray from the mirror centre does
        not reach the plane [m]. The variable `spot_status` gives the reason. The dimensions are ``heliostat`` (omitted
        for a single pivot) and ``time`` (omitted for a single instant).

    Raises
    ------
    ValueError
        As in `mount_angles`.

    References
    ----------
    Optics Express 27(8), A257 (2019), Sect. 3.

    Examples
    --------
    >>> import heliosweep
    >>> spot = heliosweep.mount_spots(180.0, 40.0, (0.0, 100.0, 50.0), 50.0, {"elevation_reference": 1.0})
    >>> float(spot.spot_y.round(6)), float(spot.spot_z.round(6))
    (0.0, 0.2)
    """
    scene = _scene(sun_azimuth, sun_elevation, pivot, aim, kind, **mount)
    actual, known = (_errors(each, len(scene.pivots))[:, np.newaxis] for each in (errors, corrected))
    found = spots.mount_spots(scene.setting, actual, known, scene.sun[np.newaxis], scene.pivots[:, np.newaxis])
    return scene.dataset(_spots(found[:, :, 0]))


def deviation_curve(
    sun_azimuth: ArrayLike, sun_elevation: ArrayLike, pivot: Any, aim: ArrayLike, size: ArrayLike = (), *,
    source: str = "canting", axis: str = "elevation", width: float, height_extent: float, errors: Any = None,
    kind: str = "azimuth_elevation", **mount: Any,
) -> xr.Dataset:  # fmt: skip
    """Compute spots as a function of the size of one error, and the tracking tolerance.

    Parameters
    ----------
    sun_azimuth, sun_elevation, pivot, aim, kind, **mount
        As in `mount_angles`, but without ``axis_offset``.
    size : array, shape (E,), optional
        Sizes of the error. [mrad]
    source : {'canting', 'encoder', 'tilt'}
        Source of the error. The mirror rotates about its centre ('canting') or about the pivot ('encoder'), or the
        whole mount rotates about its base ('tilt').
    axis : {'elevation', 'azimuth', 'encoder_azimuth'}
        Axis of rotation: the horizontal axis in the mirror ('elevation'), the axis up the slope of the mirror
        ('azimuth'), or the primary axis ('encoder_azimuth'). A positive error about the horizontal axis raises the
        mirror normal. A positive error about either of the other axes is clockwise as seen from the end of the primary
        axis.
    width, height_extent : float
        Width of the aperture, and its height along the receiver face. The aim point is the centre of the aperture. [m]
    errors : mapping or array, shape (K,) or (N, K), optional
        Other mount errors, as in `mount_spots`. [mrad]

    Returns
    -------
    xarray.Dataset
        Variables `spot_y`, `spot_z` and `spot_status` as in `mount_spots`, with the additional dimension ``size``. The
        variable `tracking_tolerance` is the minimum magnitude of the error at which the spot leaves the aperture
        [mrad]. The tolerance is infinite if the spot never leaves the aperture, 0 if the spot is outside the aperture
        even without the error, and NaN if there is no spot. The variable `eccentricity` is the eccentricity of the
        deviation curve, or NaN if the curve is not a conic section [1].

    Raises
    ------
    ValueError
        As in `mount_angles`, or if the source or axis is unknown, if a side of the aperture is not above 0 m, or if an
        axis offset is given.

    References
    ----------
    Optics Express 27(8), A257 (2019), Sect. 3.

    Examples
    --------
    >>> import heliosweep
    >>> curve = heliosweep.deviation_curve(180.0, 40.0, (0.0, 100.0, 50.0), 50.0, [1.0], width=5.0, height_extent=4.0)
    >>> curve.spot_z.round(3).values.tolist(), float(curve.tracking_tolerance.round(3))
    ([0.2], 9.999)
    """
    sizes, over = np.asarray(size, np.float64), ("size",) * np.ndim(size)
    if not (min(width, height_extent) > 0.0 and sizes.ndim < 2):
        raise ValueError("`width` and `height_extent` must be above 0 m, and `size` must have one dimension")
    scene = _scene(sun_azimuth, sun_elevation, pivot, aim, kind, width=width, height_extent=height_extent, **mount)
    if scene.mounts.offsets[1] != 0.0:
        raise ValueError("deviation curves require an axis offset of 0")
    found = spots.deviation_curves(
        scene.setting,
        np.full(len(scene.pivots), _code("source", source, SOURCES)),
        np.full(len(scene.pivots), _code("axis", axis, AXES)),
        scene.sun[np.newaxis],
        scene.pivots[:, np.newaxis],
        sizes=np.tile(1e-3 * sizes, (len(scene.pivots), 1)),
        errors=_errors(errors, len(scene.pivots)),
    )
    variables = _spots(found.spots[:, :, 0] if over else found.spots[:, :, 0, :, 0], over) | {
        "tracking_tolerance": (
            (),
            1e3 * found.tolerance[:, 0],
            {"units": "mrad", "long_name": "minimum magnitude of the error at which the spot leaves the aperture"},
        ),
        "eccentricity": ((), found.conic[6, :, 0], {"units": "1", "long_name": "eccentricity of the deviation curve"}),
    }
    return scene.dataset(variables, size=(over, sizes, {"units": "mrad", "long_name": "size of the error"}))


def calibrate_mount(
    sun_azimuth: ArrayLike, sun_elevation: ArrayLike, spot_y: ArrayLike, spot_z: ArrayLike, pivot: Any,
    aim: ArrayLike, *, angles: Any = None, weight: ArrayLike = 1.0, parameters: int = 4,
    loss: str = "squared", loss_scale: float = 0.1, condition_limit: float | None = None,
    kind: str = "azimuth_elevation", **mount: Any,
) -> xr.Dataset:  # fmt: skip
    """Estimate the errors of mounts from measured spots by robust least squares.

    Parameters
    ----------
    sun_azimuth, sun_elevation, pivot, aim, kind, **mount
        As in `mount_angles`.
    spot_y, spot_z : array or DataArray, shape (T,) or (N, T)
        Coordinates of the measured spots; NaN for missing spots. [m]
    angles : Dataset or mapping, optional
        Commanded angles `primary_angle` and `secondary_angle`, each of shape (T,) or (N, T) (default: angles from
        `mount_angles` without errors). [deg]
    weight : float or array, shape (T,) or (N, T)
        Weights of the spots, as inverse variances in any unit; 0 for spots to ignore.
    parameters : {2, 4, 6}
        Number of errors to estimate: 2 (encoder references), 4 (encoder references and tilts) or 6 (all errors).
    loss : {'squared', 'huber', 'cauchy'}
        Loss function applied to each residual.
    loss_scale : float
        Residual above which the robust loss functions increase more slowly than the squared residual. [m]
    condition_limit : float, optional
        Condition number above which `calibration_status` is 2 (default: 100, or 1000 for six errors). [1]

    Returns
    -------
    xarray.Dataset
        Variables `estimated_error` and `standard_error` with the ``parameter`` dimension [mrad]. The estimated errors
        can be passed as `errors` or `corrected` to other functions. The variables `residual_y` and `residual_z` are the
        measured minus the predicted spot coordinates [m]. The variable `condition_number` is the condition number of
        the Jacobian [1]. The variable `calibration_status` is 0 (errors estimated), 1 (too few spots), 2 (condition
        number above the limit), 3 (not converged), 4 (spots do not distinguish the errors), 5 (too few spots for
        standard errors) or 6 (no spots). Values are NaN if there is no estimate. The other dimensions are as in
        `mount_spots`.

    Raises
    ------
    ValueError
        As in `mount_angles`, or if the number of parameters or the loss function is invalid, or if `loss_scale` is not
        above 0 m.

    References
    ----------
    Optics Express 27(8), A257 (2019). Standard errors: Huber and Ronchetti (2009), Robust Statistics, Sect. 7.6.

    Examples
    --------
    >>> import heliosweep
    >>> sun, place = ([120.0, 180.0, 240.0], [40.0, 70.0, 40.0]), {"pivot": (30.0, 100.0, 4.0), "aim": 50.0}
    >>> spots = heliosweep.mount_spots(*sun, errors=[1.0, -2.0, 0.5, 0.3], **place)
    >>> found = heliosweep.calibrate_mount(*sun, spots.spot_y, spots.spot_z, **place)
    >>> found.estimated_error.round(6).values.tolist()
    [1.0, -2.0, 0.5, 0.3]
    """
    if parameters not in CONDITION_LIMITS or not loss_scale > 0.0:
        raise ValueError(f"`parameters` must be 2, 4 or 6, and `loss_scale` above 0 m (got {parameters}, {loss_scale})")
    scene = _scene(sun_azimuth, sun_elevation, pivot, aim, kind, **mount)
    count, instants = len(scene.pivots), (len(scene.sun),)

    def pairs(**values: ArrayLike) -> Floats:
        return np.stack([per_item(name, _leading(each), instants, count) for name, each in values.items()], axis=-1)

    found = calibration.fit(
        scene.mounts,
        calibration.Observed(
            np.broadcast_to(scene.sun, (count, *scene.sun.shape)),
            scene.mounts.aim(scene.sun)
            if angles is None
            else np.radians(pairs(**{name: angles[name] for name in _ANGLES})),
            pairs(spot_y=spot_y, spot_z=spot_z),
            per_item("weight", _leading(weight), instants, count, np.inf),
        ),
        parameters=parameters,
        loss=_code("loss", loss, LOSSES),
        loss_scale=loss_scale,
        condition_limit=condition_limit,
    )
    return scene.dataset(
        {
            f"residual_{side}": (
                (),
                found.residual[..., k],
                {"units": "m", "long_name": "measured minus predicted spot coordinate"},
            )
            for k, side in enumerate("yz")
        },
        {
            "estimated_error": (("parameter",), 1e3 * found.estimate[:, :parameters], {"units": "mrad"}),
            "standard_error": (
                ("parameter",),
                1e3 * np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))[:, :parameters],
                {"units": "mrad"},
            ),
            "condition_number": ((), found.condition, {"units": "1"}),
            "calibration_status": ((), found.status.astype(np.int8), _flags(CALIBRATION_STATUS, "spot")),
        },
        parameter=("parameter", list(ERRORS[:parameters])),
    )


def error_changes(
    estimated_error: ArrayLike, standard_error: ArrayLike, freedom: ArrayLike, *, dim: str = "period",
    confidence: float = 0.999,
) -> xr.Dataset:  # fmt: skip
    """Compare estimated mount errors with the first estimate, and flag significant changes.

    Parameters
    ----------
    estimated_error, standard_error : array, shape (P, ...), or DataArray with `dim`
        Errors estimated by `calibrate_mount` in P periods, and their standard errors; NaN for missing estimates. [mrad]
    freedom : array, shape (P, ...), or DataArray
        Degrees of freedom of the estimates: twice the number of spots minus the number of estimated errors.
    dim : str
        Name of the period dimension.
    confidence : float
        Probability that an unchanged error is not flagged as changed.

    Returns
    -------
    xarray.Dataset
        The variable `change` is the change since the first estimate, and `change_error` is its standard error [mrad].
        The variable `changed` is 1 if the confidence interval of the change (t distribution) excludes 0, 0 if the
        interval includes 0, and -1 if there is no change to test.

    Raises
    ------
    ValueError
        If the confidence is not between 0 and 1, or if the dimensions do not match.

    References
    ----------
    Degrees of freedom of a difference: B. L. Welch (1947), Biometrika 34, 28.

    Examples
    --------
    >>> import heliosweep
    >>> found = heliosweep.error_changes([0.1, 0.12, 1.2], [0.05, 0.06, 0.05], 20)
    >>> found.changed.values.tolist()
    [-1, 0, 1]
    """
    from scipy.special import stdtrit

    if not 0.0 < confidence < 1.0:
        raise ValueError(f"`confidence` must be between 0 and 1 (got {confidence:g})")
    numbered = [dim, *(f"dim_{number}" for number in range(1, np.ndim(estimated_error)))]
    inner = list(getattr(estimated_error, "dims", numbered))
    given: Any = (estimated_error, standard_error, freedom)
    value, error, free = xr.broadcast(
        *(each if hasattr(each, "dims") else xr.DataArray(each, dims=inner[: np.ndim(each)]) for each in given)
    )
    if dim not in value.dims or value.ndim > max(np.ndim(estimated_error), 1):
        raise ValueError(
            f"`estimated_error` must have the dimension {dim!r}, and the other arrays only dimensions of this array"
        )
    known = value.notnull() & error.notnull() & (free > 0)
    first = {dim: known.argmax(dim)}
    later = known & (xr.DataArray(np.arange(value.sizes[dim]), dims=dim) > first[dim])
    square, start = error**2, error.isel(first) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        welch = (square + start) ** 2 / (square**2 / free + start**2 / free.isel(first))
        limit = stdtrit(welch, 0.5 + 0.5 * confidence) * np.sqrt(square + start)
    change, words = value - value.isel(first), {"units": "mrad", "long_name": "change of the mount error"}
    flags = {"flag_values": np.array([-1, 0, 1], np.int8), "flag_meanings": "no_change unchanged changed"}
    return xr.Dataset({
        "change": change.where(later).assign_attrs(words),
        "change_error": ((square + start) ** 0.5).where(later).assign_attrs(words),
        "changed": (change**2 > limit**2).where(later, -1).astype(np.int8).assign_attrs(flags),
    }).transpose(*value.dims)  # fmt: skip


def detector_inversion(
    sun_azimuth: ArrayLike, sun_elevation: ArrayLike, elevation_crossing: ArrayLike, azimuth_crossing: ArrayLike,
    pivot: Any, aim: ArrayLike, *, kind: str = "azimuth_elevation", **mount: Any,
) -> xr.Dataset:  # fmt: skip
    """Compute mount angles from the points at which two light traces cross detectors.

    A reflecting cylinder along the elevation axis of the mirror casts the elevation trace on the receiver plane. A
    cylinder up the slope of the mirror casts the azimuth trace. The primary and secondary angles are computed in closed
    form from one point on each trace. The inversion is exact for mounts without offsets if the encoder references are
    the only errors.

    Parameters
    ----------
    sun_azimuth, sun_elevation, pivot, aim, kind, **mount
        As in `mount_angles`, but without ``mirror_offset`` and ``axis_offset``.
    elevation_crossing, azimuth_crossing : array, shape (2,), (T, 2) or (N, T, 2)
        Coordinates y and z of one point on the elevation trace and one point on the azimuth trace, in the receiver
        plane. [m]

    Returns
    -------
    xarray.Dataset
        Mirror angles `primary_angle` and `secondary_angle` as in `mount_angles`. Subtract the commanded angles to get
        the encoder reference errors. [deg]

    Raises
    ------
    ValueError
        As in `mount_angles`, or if an offset is given.

    References
    ----------
    Optics Express 27(8), A257 (2019), Sect. 4.3.

    Examples
    --------
    >>> import heliosweep
    >>> on_target = {"elevation_crossing": (0.0, 0.0), "azimuth_crossing": (0.0, 0.0)}
    >>> angles = heliosweep.detector_inversion(180.0, 40.0, pivot=(0.0, 100.0, 50.0), aim=50.0, **on_target)
    >>> float(angles.secondary_angle.round(6))
    20.0
    """
    scene = _scene(sun_azimuth, sun_elevation, pivot, aim, kind, **mount)
    if scene.mounts.offsets[:2].any():
        raise ValueError(
            "the inversion requires mounts without `mirror_offset` and `axis_offset`; use `calibrate_mount` instead"
        )
    crossings = {"elevation_crossing": elevation_crossing, "azimuth_crossing": azimuth_crossing}
    ways = [
        scene.mounts.to_target[:, np.newaxis]
        + per_item(name, points, (len(scene.sun), 2), len(scene.pivots)) @ scene.mounts.face[1:]
        for name, points in crossings.items()
    ]
    found = traces.mirror_angles(scene.mounts.frames[:, np.newaxis], scene.sun, *ways)
    return _angles(scene, np.where(scene.sun[:, 2:] > 0.0, found, np.nan))


class _Scene(NamedTuple):
    """Scene of N mounts at T instants.

    Attributes
    ----------
    setting : aiming.Setting
        Settings of the receiver and of the mounts, each of shape (N,).
    sun : ndarray, shape (T, 3)
        Unit vectors to the sun. [1]
    pivots : ndarray, shape (N, 3)
        Pivots relative to the aim points. [m]
    dims : tuple
        Names of the mount dimension and the time dimension. Each is empty for a single pivot or instant.
    """

    setting: aiming.Setting
    mounts: aiming.Mounts
    sun: Floats
    pivots: Floats
    dims: tuple[tuple[str, ...], tuple[str, ...]]
    coordinates: dict[str, Any]

    def dataset(
        self, variables: Mapping[str, Any], mounts: Mapping[str, Any] | None = None, **coordinates: Any
    ) -> xr.Dataset:
        """Return a data set with `variables` of shape (N, T, ...) and mount variables `mounts` of shape (N, ...).

        Each entry contains the additional dimensions, the values and the attributes of a variable. The mount dimension
        is omitted for a single pivot, and the time dimension for a single instant.
        """
        (each, time), every = self.dims, slice(None)
        first, instant = every if each else 0, every if time else 0
        made: dict[str, Any] = {
            name: ((*each, *time, *dims), values[first, instant], attrs)
            for name, (dims, values, attrs) in variables.items()
        }
        for name, (dims, values, attrs) in (mounts or {}).items():
            made[name] = (*each, *dims), values[first], attrs
        return xr.Dataset(made, self.coordinates | coordinates)


def _scene(
    sun_azimuth: ArrayLike, sun_elevation: ArrayLike, pivot: Any, aim: ArrayLike, kind: str, *,
    latitude: float | None = None, axis_azimuth: float = 0.0, mirror_offset: float = 0.0, axis_offset: float = 0.0,
    pedestal_height: float = 0.0, receiver_azimuth: float = 0.0, receiver_tilt: float = 0.0, width: float = 1.0,
    height_extent: float = 1.0,
) -> _Scene:  # fmt: skip
    pivots = mirror_centres(pivot, "pivot")
    target = np.array([0.0, 0.0, float(np.asarray(aim))]) if np.ndim(aim) == 0 else aim
    relative = pivots - per_item("aim", target, (3,), len(pivots))
    if not (np.isfinite(relative).all() and relative.any(axis=1).all()):
        raise ValueError("`aim` must be finite, and no `pivot` may be at its aim point")
    code = _code("kind", kind, KINDS)
    if latitude is None and code == POLAR:
        raise ValueError("`latitude` is missing; a polar mount requires a latitude")
    angles = np.radians([receiver_azimuth, receiver_tilt, latitude or 0.0, axis_azimuth])
    half, offsets = (0.5 * width, 0.5 * height_extent), (mirror_offset, axis_offset, pedestal_height)
    values = *angles[:2], *half, 0.0, code, *angles[2:], *offsets
    setting = aiming.Setting._make(np.full(len(pivots), each) for each in values)
    sun, time, coordinates = sun_directions(sun_azimuth, sun_elevation)
    single = not hasattr(pivot, "keys") and np.ndim(pivot) == 1
    labels = {} if single else heliostat_coordinates(pivot, pivots, "pivot")
    dims: tuple[str, ...] = () if single else ("heliostat",)
    return _Scene(setting, mounts_of(setting, relative), sun, relative, (dims, time), labels | coordinates)


def mounts_of(setting: aiming.Setting, pivots: Floats, point: int = 0) -> aiming.Mounts:
    """Return the mounts at pivots of shape (N, 3), with the properties in entry `point` of a setting."""
    one = {name: values[point].item() for name, values in setting._asdict().items()}
    to_target = np.array([0.0, 0.0, one["target_height"]]) - pivots
    return aiming.Mounts(
        aiming.mount_frames(one["kind"], one["latitude"], one["axis_azimuth"], to_target),
        to_target,
        np.array(aiming.face_vectors(one["face_azimuth"], one["face_tilt"])),
        np.array([one["mirror_offset"], one["axis_offset"], one["pedestal_height"]]),
    )


def _leading(values: Any) -> Any:
    """Transpose values so that the ``heliostat`` dimension, if present, comes first."""
    return values.transpose("heliostat", ...) if "heliostat" in getattr(values, "dims", ()) else values


def _errors(errors: Any, count: int) -> Floats:
    """Return mount errors [rad], shape (count, 6), from errors in mrad."""
    if isinstance(errors, Mapping):
        if unknown := [name for name in errors if name not in ERRORS]:
            raise ValueError(f"unknown mount error {unknown[0]!r}: use {', '.join(ERRORS)}")
        errors = np.stack(np.broadcast_arrays(*(errors.get(name, 0.0) for name in ERRORS)), axis=-1)
    array = np.atleast_1d(np.asarray(() if errors is None else _leading(errors), np.float64))
    wide = [(0, 0)] * (array.ndim - 1) + [(0, max(0, len(ERRORS) - array.shape[-1]))]
    return 1e-3 * per_item("errors", np.pad(array, wide), (len(ERRORS),), count)


def _code(name: str, value: str, options: tuple[str, ...]) -> int:
    if value not in options:
        raise ValueError(f"`{name}` must be one of {', '.join(options)} (got {value!r})")
    return options.index(value)


def _angles(scene: _Scene, angles: Floats) -> xr.Dataset:
    """Return a data set with mount angles [deg] from an array of shape (N, T, 2) [rad]."""
    return scene.dataset({
        name: ((), np.degrees(angles[..., k]), {"units": "degree", "long_name": words})
        for k, (name, words) in enumerate(_ANGLES.items())
    })  # fmt: skip


def _spots(values: Floats, dims: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return spot variables from an array of shape (3, N, T, ...) that contains y, z and the status."""
    y, z, status = values
    return {
        "spot_y": (dims, y, {"units": "m", "long_name": "spot on the receiver plane, to the right of the aim point"}),
        "spot_z": (dims, z, {"units": "m", "long_name": "spot on the receiver plane, above the aim point"}),
        "spot_status": (dims, status.astype(np.int8), _flags(SPOT_STATUS)),
    }


def _flags(meanings: Mapping[int, str], measured: str = "") -> dict[str, Any]:
    words = [each.replace("%", measured) for each in meanings.values()]
    return {"flag_values": np.array(list(meanings), np.int8), "flag_meanings": " ".join(words)}
