"""The specification of the backward-gazing kernels in a few obvious lines: vectors in the frame R_F, NumPy, one camera
after another."""

import numpy as np

from heliosweep.kernels import profiles
from heliosweep.kernels.gazing import slopes as linear
from heliosweep.kernels.gazing.geometry import camera_square, mirror_grid, scene, themis_8
from heliosweep.kernels.gazing.slopes import look_back

LIMB, EPS_MAX, POWER = 0.679, 4.360e-3, 2.222


def paper_scene(sun=(30.0, 60.0), target=(0.0, 44.0), radius=0.24, arrangement="square", **more):
    """Scene of the study file of the paper; angles in degrees, azimuths from south towards east."""
    return scene(tuple(np.radians(sun)), tuple(np.radians(target)), camera_square(radius, arrangement), **more)


def ideal_squares(layout, pixels):
    """Squares of the angles at which K cameras see the ideal mirror at N pixels, shape (K, N). [rad^2]"""
    return look_back(layout, profiles.jose(), np.array(pixels), np.zeros_like(pixels))[0]


def by_kernels(images, layout, profile, pixels, matrices, threshold=0.3):
    """Slopes p of a mirror by method A of the kernels, shape (T, 2, N) [rad], and the bits of the lit cameras."""
    ideal, rows = ideal_squares(layout, pixels), linear.solutions(layout.gaze)
    departures, lit = linear.wavefront_departures(images, ideal, rows, profile, threshold)
    return linear.transferred(departures, matrices), lit


def paper_grid(pixel=0.05):
    return mirror_grid(themis_8(), pixel)


def paper_canting():
    """-1 and +1 mrad about the horizontal axis on modules 2 and 3."""
    canting = np.zeros((8, 2))
    canting[1, 1], canting[2, 1] = -1e-3, 1e-3
    return canting


def jose(eps, limb=LIMB, radius=EPS_MAX, power=POWER):
    u = np.minimum(np.asarray(eps) / radius, 1.0)
    return np.where(np.asarray(eps) > radius, 0.0, limb + (1.0 - limb) * np.sqrt(1.0 - u**power))


def unit(vector):
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def rodrigues(axis, angle):
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def turn(slopes):
    """Rotation that takes the x axis to (1, c_y, c_z)."""
    length = np.hypot(*slopes)
    return np.eye(3) if length == 0.0 else rodrigues(np.array([0.0, -slopes[1], slopes[0]]) / length, np.arctan(length))


def surface(y, z, centre, focal_length, canting, pointing):
    """Points and normals, in the mirror frame, of a module: a sphere turned about the module's centre, then whole."""
    radius, ball = 2.0 * focal_length, np.array([2.0 * focal_length, 0.0, 0.0])
    pivot = np.array([radius - np.sqrt(radius**2 - centre[0] ** 2 - centre[1] ** 2), *centre])
    ball = turn(pointing) @ (pivot + turn(canting) @ (ball - pivot))
    x = ball[0] - np.sqrt(radius**2 - (y - ball[1]) ** 2 - (z - ball[2]) ** 2)
    points = np.stack((x, y, z), axis=-1)
    return points, (ball - points) / radius


def series(y, z, f, p=(0.0, 0.0)):
    """Points and normals, in the mirror frame, of the ideal mirror with the slopes p (Eqs. 1 and 2)."""
    r2 = y**2 + z**2
    points = np.stack((r2 / (4 * f) + r2**2 / (64 * f**3), y, z), axis=-1)
    bend = (1 + r2 / (8 * f**2)) / (2 * f)
    return points, unit(np.stack((np.ones_like(r2), p[0] - y * bend, p[1] - z * bend), axis=-1))


def offsets(layout, camera, points, normals):
    """2nd and 3rd components of B_S S for the rays from a camera (Eqs. 4 and 5)."""
    origin = -layout.distance * layout.target_axes[0]
    place, normal = origin + points @ layout.mirror_axes, normals @ layout.mirror_axes
    ray = unit(layout.cameras[camera] - place)
    sun = 2.0 * np.sum(normal * ray, axis=-1, keepdims=True) * normal - ray
    return (sun @ layout.sun_axes.T)[..., 1:]


def images(layout, points, normals):
    """Brightness that each camera sees with the Jose profile of the paper."""
    return np.stack([jose(np.hypot(*offsets(layout, i, points, normals).T)) for i in range(len(layout.cameras))])


def modelled(layout, y, z, p):
    """Brightness of all cameras for slopes p, shape (2, n), at one pixel each; Jose profile."""
    return images(layout, *series(y, z, layout.focal_length, p))
