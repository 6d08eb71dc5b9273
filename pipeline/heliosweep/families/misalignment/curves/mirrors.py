"""Mirrors of mounts with errors, from which the curves of a further error start, and the beams on these curves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from heliosweep.families.misalignment.blocks import ERRORS
from heliosweep.families.misalignment.calibration.fits import Mounts
from heliosweep.families.misalignment.draws import mean_errors
from heliosweep.families.misalignment.points import Points
from heliosweep.kernels.spots import traces
from heliosweep.kernels.spots.deviation import AZIMUTH, CANTING, ELEVATION, TILT

if TYPE_CHECKING:
    from heliosweep.families.misalignment.study import MisalignmentStudy

Floats = NDArray[np.float64]

#: Points of the outline of a spot.
OUTLINE = 36


def mirrors(study: MisalignmentStudy, points: Points, some: NDArray[np.int64]) -> list[traces.Stand]:
    """How the mirrors of some points stand, of shape (H, T), at the commands of mounts without errors."""
    errors = np.zeros((len(points.setting.kind), len(ERRORS)))
    if study.mount_errors is not None:
        errors = mean_errors(points, study.mount_errors) * 1e-3
    found = []
    for point in some.tolist():
        actual = errors[point]
        mounts = Mounts.of(points, point)
        frames, towards = mounts.frames[:, np.newaxis], mounts.towards[:, np.newaxis]
        found.append(traces.stand(frames, mounts.ideal(), actual, towards, mounts.offsets))
    return found


def beams(
    points: Points,
    stands: list[traces.Stand],
    errors: tuple[NDArray[np.int64], NDArray[np.int64], Floats],
    real: NDArray[np.bool_],
) -> dict[str, NDArray[Any]]:
    """Outlines of the spots and edges of the traces of beams that open as cones, shape (P, H, T, ...).

    Of the mirrors of each point, codes of source and axis of the error and its sizes [rad], and where there is a spot.

    The edges are those of the rays that come from the points of the sun nearest to and farthest from the axis of the
    error: while the mirror turns about an axis in it each draws a conic, and the beam all that lies between.
    """
    divergence, made = points.values("beam.divergence"), np.full((*real.shape, OUTLINE + 2, 2), np.nan)
    for point, (stand, source, axis, size) in enumerate(zip(stands, *errors, strict=True)):
        half, mounts = 0.5e-3 * float(divergence[point]), Mounts.of(points, point)
        about = {ELEVATION: stand.right, AZIMUTH: -stand.up}.get(int(axis), -stand.primary)
        arm = {CANTING: 0.0 * stand.arm, TILT: stand.pole + stand.arm}.get(int(source), stand.arm)
        normal, centre = _turned(about, stand.normal, size), stand.centre - arm + _turned(about, arm, size)
        ray = traces.reflected(normal, mounts.sun)
        outline = traces.beam_outline(centre, ray, mounts.face, half, OUTLINE)
        side = about - traces.dot(about, mounts.sun)[..., np.newaxis] * mounts.sun
        with np.errstate(divide="ignore", invalid="ignore"):
            side = side / np.sqrt(traces.dot(side, side))[..., np.newaxis]
        suns = (np.cos(half) * mounts.sun + sign * np.sin(half) * side for sign in (1.0, -1.0))
        edges = [traces.spots(centre, traces.reflected(normal, sun), mounts.face) for sun in suns]
        made[point] = np.concatenate([outline, np.stack(edges, axis=-2)], axis=-2)
    made[~real] = np.nan
    names = {"outline": made[..., :OUTLINE, :], "edge": made[..., OUTLINE:, :]}
    return {f"{name}_{side}": array[..., i] for name, array in names.items() for i, side in enumerate("yz")}


def _turned(axis: Floats, vector: Floats, angle: float) -> Floats:
    """Vectors turned about unit axes. [rad]"""
    still = traces.dot(axis, vector)[..., np.newaxis] * axis
    turned: Floats = still + np.cos(angle) * (vector - still) + np.sin(angle) * np.cross(axis, vector)
    return turned
