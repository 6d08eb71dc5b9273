"""Images of mirrors on a test mirror, for all lanes of a packet.

For the test mirror (u, v, n) and the direction d (sun, or the mirror's own target), a point P = C + q of the scene
projects along d to ((q.U), (q.V)) on the plane of the mirror, with U = (v x d) / (n.d) and V = (d x u) / (n.d). Here U
and V are divided by the half sides as well: the test mirror is the square [-1, 1] x [-1, 1], and the image of another
mirror a parallelogram given by its centre and two half edges. n.d is the cosine of the angle of incidence for both
directions, |r + s| / 2.
"""

import numpy as np
from numpy.typing import NDArray

from heliosweep.kernels.compiled import inline, kernel
from heliosweep.kernels.packets import PACKET
from heliosweep.kernels.polygons import edge_term, slope, square_area

__all__ = ["AREA", "IMAGE_ROWS", "axes", "cosines", "image", "larger", "outline", "straddles"]

IMAGE_ROWS = 10
"""Rows of an image: centre x, y; half edges a and b (x, y of each); area on the test mirror (0: none); and, only for
mirrors that may straddle the plane of the test mirror, the heights over it: of the centre, and along a and b."""
AREA = 6 * PACKET
"""Where the row of areas begins."""
_HEIGHT = 7 * PACKET


@kernel
def cosines(out: NDArray[np.float64], sun: NDArray[np.float64], target: NDArray[np.float64], lanes: int) -> None:
    """Cosine of the angle of incidence, |r + s| / 2 = sqrt((1 + r.s) / 2), for every lane."""
    for k in range(lanes):
        nx, ny, nz = (
            target[k] + sun[k],
            target[PACKET + k] + sun[PACKET + k],
            target[2 * PACKET + k] + sun[2 * PACKET + k],
        )
        out[k] = min(1.0, 0.5 * np.sqrt(nx * nx + ny * ny + nz * nz))


@kernel
def axes(
    out: NDArray[np.float64],
    frame: NDArray[np.float64],
    cosine: NDArray[np.float64],
    directions: NDArray[np.float64],
    area: float,
    lanes: int,
) -> None:
    """Write the rows U and V (x, y, z of each) of a test mirror for every lane.

    Parameters
    ----------
    out : ndarray, shape (FRAME_ROWS * PACKET,)
        Receives U and V. [1/m]
    frame : ndarray, shape (FRAME_ROWS * PACKET,)
        Half sides of the test mirror. [m]
    cosine : ndarray, shape (PACKET,)
        Cosine of the angle of incidence. [1]
    directions : ndarray, shape (3 * PACKET,)
        Rows of the direction d. [1]
    area : float
        Product of the half sides. [m2]
    lanes : int
        Lanes of the packet.
    """
    for k in range(lanes):
        ux, uy, uz = frame[k], frame[PACKET + k], frame[2 * PACKET + k]
        vx, vy, vz = frame[3 * PACKET + k], frame[4 * PACKET + k], frame[5 * PACKET + k]
        dx, dy, dz = directions[k], directions[PACKET + k], directions[2 * PACKET + k]
        scale = 1.0 / (area * cosine[k]) if cosine[k] > 0.0 else 0.0
        out[k] = scale * (vy * dz - vz * dy)
        out[PACKET + k] = scale * (vz * dx - vx * dz)
        out[2 * PACKET + k] = scale * (vx * dy - vy * dx)
        out[3 * PACKET + k] = scale * (dy * uz - dz * uy)
        out[4 * PACKET + k] = scale * (dz * ux - dx * uz)
        out[5 * PACKET + k] = scale * (dx * uy - dy * ux)


@kernel
def image(
    out: NDArray[np.float64],
    views: NDArray[np.float64],
    frame: NDArray[np.float64],
    directions: NDArray[np.float64],
    dx: float,
    dy: float,
    dz: float,
    apart: bool,
    test: NDArray[np.float64],
    lanes: int,
) -> bool:
    """Write the image of one mirror on the test mirror for every lane; False if no lane has one.

    Parameters
    ----------
    out : ndarray, shape (IMAGE_ROWS * PACKET,)
        Receives the image.
    views : ndarray, shape (FRAME_ROWS * PACKET,)
        U and V of the test mirror. [1/m]
    frame : ndarray, shape (FRAME_ROWS * PACKET,)
        Half sides of the other mirror. [m]
    directions : ndarray, shape (3 * PACKET,)
        Rows of the direction d. [1]
    dx, dy, dz : float
        D, from the centre of the test mirror to that of the other. [m]
    apart : bool
        Whether the bounding spheres are disjoint: then D.d > 0 tells exactly which mirror is in front.
    test : ndarray, shape (FRAME_ROWS * PACKET,)
        Half sides of the test mirror. [m]
    lanes : int
        Lanes of the packet.
    """
    behind = 0.0 if apart else -np.inf
    hits = 0
    for k in range(lanes):
        ux, uy, uz = views[k], views[PACKET + k], views[2 * PACKET + k]
        vx, vy, vz = views[3 * PACKET + k], views[4 * PACKET + k], views[5 * PACKET + k]
        px, py, pz = frame[k], frame[PACKET + k], frame[2 * PACKET + k]
        qx, qy, qz = frame[3 * PACKET + k], frame[4 * PACKET + k], frame[5 * PACKET + k]
        cx, cy = dx * ux + dy * uy + dz * uz, dx * vx + dy * vy + dz * vz
        ax, ay = px * ux + py * uy + pz * uz, px * vx + py * vy + pz * vz
        bx, by = qx * ux + qy * uy + qz * uz, qx * vx + qy * vy + qz * vz
        ahead = dx * directions[k] + dy * directions[PACKET + k] + dz * directions[2 * PACKET + k]
        out[k], out[PACKET + k] = cx, cy
        out[2 * PACKET + k], out[3 * PACKET + k] = ax, ay
        out[4 * PACKET + k], out[5 * PACKET + k] = bx, by
        # Separating axes: the normals of the square's edges and of the image's.
        turn = abs(ax * by - ay * bx)
        gap = larger(abs(cx) - abs(ax) - abs(bx), abs(cy) - abs(ay) - abs(by)) - 1.0
        gap = larger(gap, abs(cx * ay - cy * ax) - turn - abs(ax) - abs(ay))
        gap = larger(gap, abs(cx * by - cy * bx) - turn - abs(bx) - abs(by))
        hit = (gap < 0.0) & (ahead > behind)
        out[AREA + k] = 1.0 if hit else 0.0
        hits += hit
    if hits == 0:
        return False
    for k in range(lanes):
        cx, cy = out[k], out[PACKET + k]
        ax, ay, bx, by = out[2 * PACKET + k], out[3 * PACKET + k], out[4 * PACKET + k], out[5 * PACKET + k]
        a_rise, a_run, b_rise, b_run = slope(ay, ax), slope(ax, ay), slope(by, bx), slope(bx, by)
        x0, y0, x1, y1 = cx - ax - bx, cy - ay - by, cx + ax - bx, cy + ay - by
        x2, y2, x3, y3 = cx + ax + bx, cy + ay + by, cx - ax + bx, cy - ay + by
        total = (edge_term(x0, y0, x1, y1, a_rise, a_run) + edge_term(x2, y2, x3, y3, a_rise, a_run)) + (
            edge_term(x1, y1, x2, y2, b_rise, b_run) + edge_term(x3, y3, x0, y0, b_rise, b_run)
        )
        out[AREA + k] *= abs(total)
    if not apart:
        _cut_by_plane(out, frame, dx, dy, dz, apart, test, lanes)
    return True


@inline
def larger(a: float, b: float) -> float:
    """Larger of two numbers, in the form that becomes one vector instruction."""
    return a if a > b else b


@kernel
def _cut_by_plane(out, frame, dx, dy, dz, apart, test, lanes):
    """Heights of a near mirror over the plane of the test mirror, and the area of the part in front of it."""
    for k in range(lanes):
        ux, uy, uz = test[k], test[PACKET + k], test[2 * PACKET + k]
        vx, vy, vz = test[3 * PACKET + k], test[4 * PACKET + k], test[5 * PACKET + k]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        out[_HEIGHT + k] = dx * nx + dy * ny + dz * nz
        out[_HEIGHT + PACKET + k] = frame[k] * nx + frame[PACKET + k] * ny + frame[2 * PACKET + k] * nz
        out[_HEIGHT + 2 * PACKET + k] = (
            frame[3 * PACKET + k] * nx + frame[4 * PACKET + k] * ny + frame[5 * PACKET + k] * nz
        )
    polygon = np.empty((5, 2))
    for k in range(lanes):
        if out[AREA + k] > 0.0 and straddles(out, k):
            corners = outline(out, k, apart, polygon)
            out[AREA + k] = square_area(polygon, corners) if corners > 2 else 0.0


@inline
def straddles(out, k):
    """Whether some corner lies behind the plane of the test mirror."""
    return out[_HEIGHT + k] < abs(out[_HEIGHT + PACKET + k]) + abs(out[_HEIGHT + 2 * PACKET + k])


@kernel
def outline(out, k, apart, polygon):
    """Corners of an image in lane k, counter-clockwise, cut by the plane of the test mirror; returns their number."""
    cx, cy = out[k], out[PACKET + k]
    ax, ay, bx, by = out[2 * PACKET + k], out[3 * PACKET + k], out[4 * PACKET + k], out[5 * PACKET + k]
    along_a, along_b = (0.0, 0.0) if apart else (out[_HEIGHT + PACKET + k], out[_HEIGHT + 2 * PACKET + k])
    height = 1.0 if apart else out[_HEIGHT + k]
    if ax * by - ay * bx < 0.0:
        ax, ay, along_a, bx, by, along_b = bx, by, along_b, ax, ay, along_a
    corners = 0
    qx, qy, q = cx - ax + bx, cy - ay + by, height - along_a + along_b
    for e in range(4):
        f = 1.0 if e == 1 or e == 2 else -1.0
        g = 1.0 if e > 1 else -1.0
        px, py, p = cx + f * ax + g * bx, cy + f * ay + g * by, height + f * along_a + g * along_b
        if (p > 0.0 and q < 0.0) or (p < 0.0 and q > 0.0):
            share = q / (q - p)
            polygon[corners, 0], polygon[corners, 1] = qx + share * (px - qx), qy + share * (py - qy)
            corners += 1
        if p >= 0.0:
            polygon[corners, 0], polygon[corners, 1] = px, py
            corners += 1
        qx, qy, q = px, py, p
    return corners
