"""Mounts without a study: SciPy's rotations, planted errors that come back, the shipped study, wrong arguments."""

from importlib import import_module

import numpy as np
import pytest
import xarray as xr
from scipy.optimize import brentq

import heliosweep
from tests.kernels.mounts.normals import normal_and_centre

mounts = import_module("heliosweep.mounts")

SUN = np.array([100.0, 150.0, 210.0, 255.0]), np.array([25.0, 50.0, 55.0, 20.0])
PIVOTS = np.array([(-20.0, 150.0, 4.0), (120.0, 300.0, 5.0), (10.0, 80.0, 3.0)])
AIM = np.array([1.0, -2.0, 100.0])
ERRORS = np.array([(1.0, -2, 3, 0.5, -1.5, 2.5), (-3.0, 1, -0.5, 2, 1, -0.7), (0.3, 0.2, 0.1, -2, 4, 1)])
OFFSETS = {"mirror_offset": 0.4, "axis_offset": 0.2, "pedestal_height": 3.0}
FACE = {"receiver_azimuth": 10.0, "receiver_tilt": -20.0}


def vectors(azimuth, elevation):
    """Unit vectors east, north, up. [deg]"""
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.stack([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)], axis=-1)


def frames(kind):
    """Rows x, y (zero of the primary angle) and z (primary axis) of each mount, by cross products."""
    to_aim = AIM - PIVOTS
    z = {
        "azimuth_elevation": np.tile([0.0, 0.0, 1.0], (3, 1)),
        "target_aligned": to_aim / np.linalg.norm(to_aim, axis=1, keepdims=True),
        "polar": np.tile(vectors(0.0, 37.0), (3, 1)),
        "tilt_roll": np.tile(vectors(20.0, 0.0), (3, 1)),
    }[kind]
    x = np.tile([1.0, 0.0, 0.0], (3, 1)) if kind in ("azimuth_elevation", "polar") else np.cross([0.0, 0.0, 1.0], z)
    x = {"target_aligned": x, "tilt_roll": -np.cross(z, [0.0, 0.0, 1.0])}.get(kind, x)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=1)


def twin(kind, errors, angles):
    """Normals and spots by SciPy's rotations."""
    pair = np.radians(np.stack([angles.primary_angle, angles.secondary_angle], axis=-1))
    normal, centre = normal_and_centre(frames(kind)[:, None], pair, 1e-3 * errors[:, None], tuple(OFFSETS.values()))
    return normal, *meet(normal, centre + (PIVOTS - AIM)[:, None], vectors(*SUN), vectors(10.0, -20.0))


def meet(normal, centre, sun, out):
    """Spots y, z of mirrors at centres relative to the aim point, on the plane of the outward normal `out`."""
    ray = 2.0 * np.sum(sun * normal, axis=-1, keepdims=True) * normal - sun
    right, up = face_axes(out)
    spot = centre - (centre @ out / (ray @ out))[..., None] * ray
    return spot @ right, spot @ up


def face_axes(out):
    """Axes to the right and up, for an observer who looks at the receiver along -out."""
    right = np.cross([0.0, 0.0, 1.0], out)
    right /= np.linalg.norm(right)
    return right, np.cross(out, right)


@pytest.mark.parametrize("kind", mounts.KINDS)
def test_angles_and_spots_are_those_of_rotation_matrices(kind):
    place = {"pivot": PIVOTS, "aim": AIM, "kind": kind, "latitude": 37.0, "axis_azimuth": 20.0, **OFFSETS, **FACE}
    for known in (np.zeros((3, 6)), ERRORS):
        angles = heliosweep.mount_angles(*SUN, errors=known, **place)
        _, y, z = twin(kind, known, angles)  # the known errors are corrected: on target
        np.testing.assert_allclose([y, z], 0.0, atol=1e-10)
        spots = heliosweep.mount_spots(*SUN, errors=ERRORS, corrected=known, **place)
        _, y, z = twin(kind, ERRORS, angles)
        np.testing.assert_allclose([spots.spot_y, spots.spot_z], [y, z], rtol=0, atol=1e-10)
        assert (spots.spot_status == 0).all()


@pytest.mark.parametrize(("kind", "parameters"), [("azimuth_elevation", 6), ("target_aligned", 6), ("polar", 4)])
@pytest.mark.parametrize("loss", mounts.LOSSES)
def test_planted_errors_come_back(kind, parameters, loss):
    sun = np.concatenate([SUN[0], [180.0, 130.0, 230.0]]), np.concatenate([SUN[1], [70.0, 40.0, 65.0]])
    place = {"pivot": PIVOTS, "aim": AIM, "kind": kind, "latitude": 37.0, **OFFSETS, **FACE}
    planted = ERRORS[:, :parameters]
    spots = heliosweep.mount_spots(*sun, errors=planted, **place)
    found = heliosweep.calibrate_mount(
        *sun, spots.spot_y.T, spots.spot_z, parameters=parameters, loss=loss, condition_limit=1e4, **place
    )
    np.testing.assert_allclose(found.estimated_error, planted, rtol=0, atol=1e-9)
    assert (found.calibration_status == 0).all()
    np.testing.assert_allclose([found.residual_y, found.residual_z], 0.0, atol=1e-10)
    on_target = heliosweep.mount_spots(*sun, errors=planted, corrected=found.estimated_error, **place)
    np.testing.assert_allclose([on_target.spot_y, on_target.spot_z], 0.0, atol=1e-9)


def test_a_curve_has_the_spots_of_an_encoder_error_and_its_tolerance_ends_at_the_edge():
    place, one = {"pivot": PIVOTS[1], "aim": AIM, **FACE}, (SUN[0][0], SUN[1][0])
    curve = heliosweep.deviation_curve(
        *one, size=[-20.0, 0.0, 5.0], source="encoder", width=3.0, height_extent=2.5, mirror_offset=0.4, **place
    )
    spots = [heliosweep.mount_spots(*one, errors=[0.0, size], mirror_offset=0.4, **place) for size in (-20, 0, 5)]
    for side in "yz":
        np.testing.assert_allclose(curve[f"spot_{side}"], [spot[f"spot_{side}"] for spot in spots], atol=1e-9)
    least = float(curve.tracking_tolerance)
    ends = [heliosweep.mount_spots(*one, errors=[0.0, size], mirror_offset=0.4, **place) for size in (-least, least)]
    assert max(max(abs(end.spot_y) / 1.5, abs(end.spot_z) / 1.25) for end in ends) == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("kind", mounts.KINDS)
def test_the_inversion_recovers_encoder_references(kind):
    """Crossings: roots of the traces' equation along a level or an upright line, 0.3 m from the aim point."""
    place = {"pivot": PIVOTS, "aim": AIM, "kind": kind, "latitude": 37.0, "axis_azimuth": 20.0, **FACE}
    commanded, planted = heliosweep.mount_angles(*SUN, **place), np.radians([0.2, -0.15])
    angles = np.radians(np.stack([commanded.primary_angle, commanded.secondary_angle], axis=-1)) + planted
    right, up = face_axes(vectors(10.0, -20.0))
    normal = normal_and_centre(frames(kind)[:, None], angles, np.zeros(6))[0]
    level = normal_and_centre(frames(kind)[:, None], angles, np.array([0, 0, 0, 0, 0, np.pi / 2]))[0]
    points = np.empty((2, 3, 4, 2))
    for h, t in np.ndindex(3, 4):
        for k, cylinder in enumerate((level[h, t], np.cross(level[h, t], normal[h, t]))):

            def trace(y, z, cylinder=cylinder, h=h, t=t):
                way = AIM + y * right + z * up - PIVOTS[h]
                return cylinder @ (vectors(*SUN)[t] + way / np.linalg.norm(way))

            lines = [lambda s: (s, 0.3), lambda s: (0.3, s)]
            for line in lines:
                if trace(*line(-40.0)) * trace(*line(40.0)) < 0.0:
                    points[k, h, t] = line(brentq(lambda s, line=line: trace(*line(s)), -40.0, 40.0, xtol=1e-13))
                    break
            else:
                pytest.fail("no crossing")
    found = heliosweep.detector_inversion(*SUN, *points, **place)
    turned = np.stack(
        [found.primary_angle - commanded.primary_angle, found.secondary_angle - commanded.secondary_angle]
    )
    np.testing.assert_allclose((turned + 180.0) % 360.0 - 180.0, np.broadcast_to([[[0.2]], [[-0.15]]], turned.shape),
                               atol=1e-9)  # fmt: skip


def test_results_have_the_labels_of_the_arguments():
    azimuth = xr.DataArray(SUN[0], {"hour": [8, 10, 14, 17]}, ("hour",))
    field = {"x": PIVOTS[:, 0], "y": PIVOTS[:, 1], "z": PIVOTS[:, 2]}
    spots = heliosweep.mount_spots(azimuth, SUN[1], field, 100.0, ERRORS[:, :4])
    assert spots.spot_y.dims == ("heliostat", "hour")
    assert spots.hour.values.tolist() == [8, 10, 14, 17]
    assert spots.y.values.tolist() == PIVOTS[:, 1].tolist()
    named = dict(zip(mounts.ERRORS, ERRORS[:, :4].T, strict=False))
    xr.testing.assert_identical(heliosweep.mount_spots(azimuth, SUN[1], field, 100.0, named), spots)
    alone = heliosweep.mount_spots(SUN[0][1], SUN[1][1], PIVOTS[2], (0.0, 0.0, 100.0), ERRORS[2, :4])
    assert alone.spot_y.dims == ()
    assert float(alone.spot_y) == float(spots.spot_y[2, 1])
    night = heliosweep.mount_spots(180.0, -1.0, PIVOTS[0], 100.0)
    assert night.spot_y.isnull()
    assert night.spot_status.flag_meanings.split()[int(night.spot_status)] == "sun_below_the_horizon"
    curve = heliosweep.deviation_curve(180.0, 40.0, PIVOTS[0], 100.0, 1.0, width=5.0, height_extent=5.0)
    assert curve.spot_y.dims == curve.tracking_tolerance.dims == ()


def test_changes_of_errors_have_the_dimensions_of_the_errors():
    """The change of 1.0 has the standard error 0.5 and 40 degrees of freedom: 3.55 standard errors are needed."""
    error = xr.DataArray([[0.0, 1.0], [0.0, 2.0], [0.0, np.nan]], dims=("heliostat", "period"))
    spread, freedom = np.full((3, 2), 0.5 / np.sqrt(2.0)), xr.DataArray([20, 20], dims="period")
    found = heliosweep.error_changes(error, spread, freedom)
    assert found.changed.dims == ("heliostat", "period")
    assert found.changed.values.tolist() == [[-1, 0], [-1, 1], [-1, -1]]
    np.testing.assert_allclose(found.change_error[:2, 1], 0.5, rtol=1e-12)
    for wrong in (error.rename(period="campaign"), 1.0):
        with pytest.raises(ValueError, match="must have the dimension 'period'"):
            heliosweep.error_changes(wrong, 0.1, 20)
