"""What images cover of the test mirror, column by column, so that those behind them are left out.

With a low sun most images are behind others, and without them the union is the same. The square is cut into columns. Of
each a part from one height to another is known to be covered, the rest may be; an image that covers nothing outside
these parts is hidden. Candidates come by rows and cells of the grid from the test heliostat outward
(`neighbours.search`), so that images of the nearest hide most of the others before the areas of these are computed, and
many before they are projected.
"""

import numpy as np

from heliosweep.kernels.arrays import Floats
from heliosweep.kernels.compiled import inline, inner
from heliosweep.kernels.field.images import IMAGE_ROWS, Images, next_run
from heliosweep.kernels.field.polygons import larger, smaller
from heliosweep.kernels.vectors import ROW

_COLUMNS, _HALF = 4, 0.25
"""Columns of the square, and half the width of each."""
_LOW, _HIGH = 0, _COLUMNS * ROW
FLOOR = 2 * _COLUMNS * ROW
_REACH = FLOOR + ROW
COVER_ROWS = 2 * _COLUMNS + 3
"""Rows of a cover: lower and upper ends of what is covered of each column; the floor, up to which the square is covered
from side to side; and how far a sphere of radius 1 reaches from the middle of its image, along x and y. [1, 1/m]"""
_STEEP = 8.0
"""Slope from which on an edge crosses the square within the width of one column."""
_SHORT = 32
"""Lanes up to which a packet is done as a whole: to look for groups of lanes costs more than it saves."""
_FAR, _SLACK = 1e300, 1.0 + 1e-9


@inner
def uncover(cover: Floats, views: Floats, lanes: int) -> None:
    """Begin with nothing covered, on a test mirror with these axes from `images.axes`."""
    for k in range(lanes):
        cover[k], cover[ROW + k], cover[2 * ROW + k], cover[3 * ROW + k] = 1.0, 1.0, 1.0, 1.0
        cover[_HIGH + k], cover[_HIGH + ROW + k] = -1.0, -1.0
        cover[_HIGH + 2 * ROW + k], cover[_HIGH + 3 * ROW + k] = -1.0, -1.0
        cover[FLOOR + k] = -1.0
        ux, uy, uz = views[k], views[ROW + k], views[2 * ROW + k]
        vx, vy, vz = views[3 * ROW + k], views[4 * ROW + k], views[5 * ROW + k]
        cover[_REACH + k] = np.sqrt(ux * ux + uy * uy + uz * uz) * _SLACK
        cover[_REACH + ROW + k] = np.sqrt(vx * vx + vy * vy + vz * vz) * _SLACK


@inner
def in_view(cover: Floats, views: Floats, dx: float, dy: float, dz: float, radius: float, lanes: int) -> np.int64:
    """Lanes in which a mirror's bounding sphere may be in the way, its centre at (dx, dy, dz).

    That is, whether its image meets the square above the floor.
    """
    high = np.int64(0)
    for k in range(lanes):  # first along y: most of those that are far are below the floor in all lanes
        cy = dx * views[3 * ROW + k] + dy * views[4 * ROW + k] + dz * views[5 * ROW + k]
        rise = radius * cover[_REACH + ROW + k]
        high |= np.int64((cy - rise < 1.0) & (cy + rise > cover[FLOOR + k])) << k
    found = np.int64(0)
    for k in range(lanes if high != 0 else 0):
        cx = dx * views[k] + dy * views[ROW + k] + dz * views[2 * ROW + k]
        found |= np.int64(abs(cx) - radius * cover[_REACH + k] < 1.0) << k
    return high & found


@inner
def cover_by(images: Images, m: int, cover: Floats, floored: np.int64, lanes: int) -> None:
    """Add what image m covers; the floor is raised in some lanes only.

    Mirrors that may straddle the plane of the test mirror cover nothing for sure.
    """
    some = images.present[m] if images.apart[m] else np.int64(0)
    start, stop = _first_run(some, lanes)
    while start < stop:
        _cover_by(
            images.rows, m * IMAGE_ROWS * ROW + start, cover, start, some >> start, floored >> start, stop - start
        )
        start, stop = next_run(stop, some, lanes)


@inline
def _first_run(some, lanes):
    """Begin and end of the first run of groups of lanes that have some lanes, as `next_run`."""
    return next_run(0, some, lanes) if lanes > _SHORT else (np.int64(0), lanes)


@inner
def _cover_by(images, o, cover, at, some, floored, lanes):
    """The same in a run of lanes that begins at lane number `at`."""
    o, at = max(o, 0), max(at, 0)
    for k in range(lanes):
        cx, cy = images[o + k], images[o + ROW + k]
        ax, ay = images[o + 2 * ROW + k], images[o + 3 * ROW + k]
        bx, by = images[o + 4 * ROW + k], images[o + 5 * ROW + k]
        turn = abs(ax * by - ay * bx)
        a, b = _strip(cy, ax, ay, turn), _strip(cy, bx, by, turn)
        here = some >> k & 1 == 1
        zero = _more(cover, at + k, -0.75 - cx, cy, a, b, here)
        one = _more(cover, at + ROW + k, -0.25 - cx, cy, a, b, here)
        two = _more(cover, at + 2 * ROW + k, 0.25 - cx, cy, a, b, here)
        three = _more(cover, at + 3 * ROW + k, 0.75 - cx, cy, a, b, here)
        floor = smaller(smaller(zero, one), smaller(two, three))
        cover[at + FLOOR + k] = floor if floored >> k & 1 == 1 else -1.0


@inline
def _strip(cy, ex, ey, turn):
    """Strip between two edges along e: slope; half its height all over a column, and anywhere in it; half its width."""
    steep = abs(ex) * _STEEP < abs(ey)
    run = ey if steep else ex
    inverse = 1.0 / (run if abs(run) > 1e-290 else 1e-290)
    rise = 0.0 if steep else ey * inverse
    height, slant = turn * abs(inverse), abs(rise) * _HALF
    least, most = _FAR if steep else height - slant, _FAR if steep else height + slant
    # Of steep edges: how far from the middle of the image a column is that lies between them up to its corners.
    width = (turn - (1.0 + abs(cy)) * abs(ex)) * abs(inverse) - _HALF if steep else _FAR
    return rise, least, most, width


@inline
def _more(cover, at, x, cy, a, b, here):
    """Add what the image whose centre is x left of that of a column covers there; returns a column's floor."""
    (rise_a, least_a, _, width_a), (rise_b, least_b, _, width_b) = a, b
    middle_a, middle_b = cy + x * rise_a, cy + x * rise_b
    low = larger(larger(middle_a - least_a, middle_b - least_b), -1.0)
    high = smaller(smaller(middle_a + least_a, middle_b + least_b), 1.0)
    begin, end = cover[_LOW + at], cover[_HIGH + at]
    some = here & (low < high) & (abs(x) <= smaller(width_a, width_b))
    joined = some & (low <= end) & (high >= begin)
    better = some & (begin > -1.0) & (high - low > end - begin)  # a floor never sinks
    begin, end = (
        (smaller(low, begin) if joined else low if better else begin),
        (larger(high, end) if joined else high if better else end),
    )
    cover[_LOW + at], cover[_HIGH + at] = begin, end
    return end if begin <= -1.0 else -1.0


@inner
def take_out_hidden(images: Images, m: int, cover: Floats, some: np.int64, lanes: int) -> np.int64:
    """Take an image that `images.project` has made out of those of some lanes where it is hidden; returns these."""
    hidden = np.int64(0)
    start, stop = _first_run(some, lanes)
    while start < stop:
        hidden |= _hidden(images.rows, m * IMAGE_ROWS * ROW + start, cover, start, stop - start) << start
        start, stop = next_run(stop, some, lanes)
    hidden &= some
    images.present[m] &= ~hidden
    return hidden


@inner
def _hidden(images, o, cover, at, lanes):
    """Lanes in which an image covers nothing but what is covered."""
    o, at, found = max(o, 0), max(at, 0), np.int64(0)
    for k in range(lanes):
        cx, cy = images[o + k], images[o + ROW + k]
        ax, ay = images[o + 2 * ROW + k], images[o + 3 * ROW + k]
        bx, by = images[o + 4 * ROW + k], images[o + 5 * ROW + k]
        reach, rise = abs(ax) + abs(bx) + _HALF, abs(ay) + abs(by)
        low, high = larger(cy - rise, -1.0), smaller(cy + rise, 1.0)
        turn = abs(ax * by - ay * bx)
        a, b = _strip(cy, ax, ay, turn), _strip(cy, bx, by, turn)
        zero = _within(cover, at + k, -0.75 - cx, cy, a, b, low, high, reach)
        one = _within(cover, at + ROW + k, -0.25 - cx, cy, a, b, low, high, reach)
        two = _within(cover, at + 2 * ROW + k, 0.25 - cx, cy, a, b, low, high, reach)
        three = _within(cover, at + 3 * ROW + k, 0.75 - cx, cy, a, b, low, high, reach)
        found |= np.int64(zero & one & two & three) << k
    return found


@inline
def _within(cover, at, x, cy, a, b, low, high, reach):
    """Whether an image covers nothing of a column but what is covered; it lies from low to high, and so far aside."""
    (rise_a, _, most_a, _), (rise_b, _, most_b, _) = a, b
    middle_a, middle_b = cy + x * rise_a, cy + x * rise_b
    low = larger(low, larger(middle_a - most_a, middle_b - most_b))
    high = smaller(high, smaller(middle_a + most_a, middle_b + most_b))
    return ((low >= cover[_LOW + at]) & (high <= cover[_HIGH + at])) | (low >= high) | (abs(x) >= reach)
