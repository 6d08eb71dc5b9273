"""Spots of a mount with errors, written a second time: whole rotation matrices, and aiming by a root finder.

Nothing here is shared with the kernels. World frame: x east, y north, z up of the tower's base; aim point above it.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from tests.kernels.mounts.normals import normal_and_centre

Floats = NDArray[np.float64]


def solar_vector(latitude: float, day: int, hour: float) -> Floats:
    """Unit vector towards the sun; Cooper's declination, 15 degrees an hour."""
    declination = np.radians(23.45) * np.sin(2 * np.pi * (284 + day) / 365)
    turn = np.radians(15.0 * (hour - 12.0))
    # In the frame of the equator: towards the meridian's point on it, east, pole.
    equatorial = np.array(
        [np.cos(declination) * np.cos(turn), -np.cos(declination) * np.sin(turn), np.sin(declination)]
    )
    phi = np.radians(latitude)
    east, up = np.array([0.0, 1.0, 0.0]), np.array([np.cos(phi), 0.0, np.sin(phi)])
    return np.array([equatorial @ east, equatorial @ np.cross(up, east), equatorial @ up])


@dataclass(frozen=True)
class Twin:
    """One heliostat: receiver, mount, pivot."""

    pivot: tuple[float, float, float]
    target_height: float = 100.0
    face: tuple[float, float] = (0.0, 0.0)
    """Azimuth and tilt of the receiver's normal. [deg]"""
    half: tuple[float, float] = (2.0, 2.0)
    kind: str = "azimuth_elevation"
    latitude: float = 37.4
    axis_azimuth: float = 0.0
    offsets: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0))
    """Mirror offset, axis offset, pedestal height. [m]"""

    @property
    def target(self) -> Floats:
        return np.array([0.0, 0.0, self.target_height])

    @property
    def axes(self) -> Floats:
        """Rows X, Y, Z of the receiver's face."""
        azimuth, tilt = np.radians(self.face)
        out = np.array([np.cos(tilt) * np.sin(azimuth), np.cos(tilt) * np.cos(azimuth), np.sin(tilt)])
        across = np.array([-np.cos(azimuth), np.sin(azimuth), 0.0])
        return np.array([out, across, np.cross(out, across)])

    @property
    def frame(self) -> Floats:
        """Rows x, y (zero bore), z (primary axis) of the mount."""
        up = np.array([0.0, 0.0, 1.0])
        if self.kind == "azimuth_elevation":
            return np.eye(3)
        if self.kind == "polar":
            phi = np.radians(self.latitude)
            primary, first = np.array([0.0, np.cos(phi), np.sin(phi)]), np.array([1.0, 0.0, 0.0])
            return np.array([first, np.cross(primary, first), primary])
        if self.kind == "tilt_roll":
            azimuth = np.radians(self.axis_azimuth)
            primary = np.array([np.sin(azimuth), np.cos(azimuth), 0.0])
            return np.array([np.cross(up, primary), up, primary])
        primary = self.target - self.pivot
        primary /= np.linalg.norm(primary)
        second = up - (up @ primary) * primary
        second /= np.linalg.norm(second)
        return np.array([np.cross(second, primary), second, primary])

    def mirror(self, angles: Floats, errors: Floats) -> tuple[Floats, Floats]:
        """Normals and centres for encoder angles (primary, secondary) and errors of shape (K, 6). [rad]"""
        normal, centre = normal_and_centre(self.frame, angles, np.atleast_2d(errors), self.offsets)
        return normal, np.array(self.pivot) + centre

    def spots(self, normal: Floats, centre: Floats, sun: Floats) -> tuple[Floats, Floats]:
        """Spots (..., 2) on the receiver's plane, NaN where there is none, and whether there is one."""
        lit = np.sum(normal * sun, axis=-1)
        ray = 2 * lit[..., np.newaxis] * normal - sun
        out, *across = self.axes
        before, towards = (centre - self.target) @ out, -(ray @ out)
        real = (before > 0) & (towards > 0) & (lit > 0)
        length = np.where(real, before, np.nan) / np.where(real, towards, 1.0)
        point = centre + length[..., np.newaxis] * ray - self.target
        return point @ np.array(across).T, real

    def aim(self, sun: Floats) -> Floats:
        """Encoder angles at which a mount without errors sends the beam to the aim point."""
        to_target = self.target - self.pivot
        middle = sun + to_target / np.linalg.norm(to_target)
        x, y, z = self.frame @ (middle / np.linalg.norm(middle))

        def miss(angles: Floats) -> Floats:
            # Rays that meet the aim point are parallel to the way there: the cross product's two largest parts vanish.
            normal, centre = self.mirror(angles, np.zeros(6))
            ray = 2 * (normal[0] @ sun) * normal[0] - sun
            way = self.target - centre[0]
            way /= np.linalg.norm(way)
            side = np.cross(way, [0.6, -0.48, 0.64])
            side /= np.linalg.norm(side)
            return np.array([ray @ side, ray @ np.cross(way, side)])

        found = root(miss, np.array([np.arctan2(x, y), np.arcsin(z)]), tol=1e-15)
        assert np.abs(miss(found.x)).max() < 1e-13
        return found.x

    def actual(self, sun: Floats, errors: Floats) -> tuple[Floats, Floats]:
        """Normals and centres of a mount that is told the angles of one without errors."""
        return self.mirror(self.aim(sun), errors)

    def inside(self, spots: Floats) -> NDArray[np.bool_]:
        """True for spots that lie in the aperture."""
        return np.asarray((np.abs(spots) <= np.array(self.half)).all(axis=-1))

    def remaining(self, normal: Floats, centre: Floats, sun: Floats, axis: int, most: float = 0.1) -> float:
        """Least angle by which one mirror must turn in place about an in-mirror axis for its spot to leave. [rad]

        Axis 0 is the elevation axis, perpendicular to the primary axis of the mount; 1 is across it. Zero where the
        spot is outside, infinite where it stays inside up to `most`.
        """
        elevation = np.cross(normal, self.frame[2])
        elevation /= np.linalg.norm(elevation)
        about = elevation if axis == 0 else np.cross(elevation, normal)

        def within(angles: Floats) -> NDArray[np.bool_]:
            normals = Rotation.from_rotvec(np.multiply.outer(angles, about)).apply(normal)
            return self.inside(self.spots(normals, np.broadcast_to(centre, normals.shape), sun)[0])

        least = np.inf
        for sign in (1.0, -1.0):
            low, high = 0.0, most
            for _ in range(6):  # the first of a fine grid that is outside, then the grid between it and the one before
                grid = np.linspace(low, high, 401)
                out = np.flatnonzero(~within(sign * grid))
                if not out.size:
                    break
                low, high = grid[max(out[0] - 1, 0)], grid[out[0]]
            else:
                least = min(least, high)
        return least
