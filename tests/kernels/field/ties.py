"""Sets of parallelograms made of ties: edges and corners that coincide with each other and with the square's.

Each family gives shapes (m, n, 6), centre and half edges of m images in each of n sets; images of a set overlap
mutually, in most sets.
"""

import numpy as np

SIDES = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])


def tied_shapes(rng, count, size):
    """Sets of every family in random order, named in every way, turned and mirrored, disturbed by next to nothing."""
    part = -(-size // len(FAMILIES))
    shapes = np.concatenate([family(rng, count, part) for family in FAMILIES], axis=1)
    shapes = rng.permutation(shapes, axis=1)[:, :size]
    shapes = np.take_along_axis(shapes, rng.random((count, size, 1)).argsort(axis=0), axis=0)
    thin = rng.random((count, size)) < rng.choice([0.0, 0.5], size, p=[0.85, 0.15])
    width = rng.choice([0.0, 1.0], (thin.sum(), 1), p=[0.05, 0.95]) * _small(rng, (thin.sum(), 1), -16, -1)
    shapes[thin, :2] += rng.choice([-1, 0, 1], width.shape) * (1.0 - width) * shapes[thin, 4:]  # an edge may stay
    shapes[thin, 4:] *= width
    # The eight symmetries of the square for a set, and of a parallelogram for an image.
    mirror, swap = rng.choice([-1.0, 1.0], (1, size, 2)), rng.random((1, size, 1)) < 0.5
    shapes = np.concatenate([np.where(swap, v[..., ::-1], v) * mirror for v in np.split(shapes, 3, axis=2)], axis=2)
    c, a, b = np.split(shapes, 3, axis=2)
    swap = rng.random((count, size, 1)) < 0.5
    a, b = np.where(swap, b, a), np.where(swap, a, b)
    shapes = np.concatenate((c, a * _sign(rng, (count, size, 1)), b * _sign(rng, (count, size, 1))), axis=2)
    # A third of the sets stay as they are; in the others some images, or all.
    share = rng.choice([0.0, 0.5, 1.0], size)
    disturbed = (rng.random((count, size)) < share)[..., None]
    high = rng.choice([-13.0, -6.0], (1, size, 1), p=[0.8, 0.2])  # some are only just no ties
    return shapes + disturbed * rng.choice([-1, 0, 1], shapes.shape) * _small(rng, shapes.shape, -17, high)


def lattice(rng, count, size):
    """Parallelograms on a coarse lattice: identical, nested, with common edges and corners."""
    e, f = _basis(rng, size)
    low, high = rng.integers(-3, 1, (2, count, size, 1)), rng.integers(1, 4, (2, count, size, 1))
    aside = rng.random((count, size, 1)) < 0.1
    low = np.where(aside, rng.integers(-3, 3, low.shape), low)
    high = np.where(aside, low + rng.integers(1, 4, low.shape), high)
    (x, y), (p, q) = (low + high) / 2, (high - low) / 2
    return _shapes(_point(rng, size) + x * e + y * f, p * e, q * f)


def spoke(rng, count, size):
    """Equal parallelograms in a row, shifted along an edge, a diagonal or x."""
    e, f = _basis(rng, size)
    a, b = e * rng.choice([1.0, 2.0, 3.0], (size, 1)), f * rng.choice([1.0, 2.0, 3.0], (size, 1))
    along = _one_of(rng, a, b, a + b, np.broadcast_to([1.0, 0.0], a.shape))
    step = rng.choice(
        [0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 1.0 / 3.0], (count, size, 1), p=[0.2, 0.2, 0.2, 0.1, 0.05, 0.05, 0.2]
    )
    return _shapes(_point(rng, size) + step * along, a, b)


def nested(rng, count, size):
    """One inside the other, with a common corner or edge, or identical; factors that round."""
    c, (a, b) = _point(rng, size), _edges(rng, size)
    out = []
    for _ in range(count):
        out.append(_shapes(c, a, b))
        s, t = rng.choice([1.0, 1.0, 0.5, 0.7, 1.0 / 3.0, 0.9], (2, size, 1))
        p, q = rng.choice([-1.0, -1.0, 0.0, 1.0, 1.0], (2, size, 1))
        c, a, b = c + p * (1.0 - s) * a + q * (1.0 - t) * b, s * a, t * b
    return np.array(out)


def through_corners(rng, count, size):
    """Each with an edge, a corner or the centre on a corner of an earlier one or of the square."""
    out = [_shapes(_point(rng, size), *_edges(rng, size))]
    for _ in range(count - 1):
        c, a, b = np.split(_pick(rng, np.array(out)), 3, axis=-1)
        p, q = rng.choice([-1.0, 1.0], (2, size, 1))
        point = _one_of(rng, c + p * a + q * b, c + p * a + q * b, c + p * a, np.broadcast_to([1.0, 1.0], c.shape))
        one, other = _edges(rng, size)
        one = _one_of(rng, one, one, a, b, a + b, a - b)
        other = _one_of(rng, other, other, a, b, np.stack((-one[:, 1], one[:, 0]), axis=-1))
        # Towards the centre of the first, so that most overlap mutually.
        away = point - out[0][:, :2]
        p = np.clip(np.rint(2.0 * _dot(away, one) / (_dot(one, one) + 1e-9)) / 2.0, -1.0, 1.0)
        q = np.where(_dot(away, other) > 0.0, 1.0, -1.0)
        out.append(_shapes(point - p * one - q * other, one, other))
    return np.array(out)


def fan(rng, count, size):
    """All with one corner in common and edges along few directions from there, the middle one inside of all."""
    angle = rng.choice([0.0, np.pi / 4, 0.3], size) + rng.choice([np.pi / 4, 0.5, 0.1], size) * np.arange(4)[:, None]
    ways = np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    lane = np.arange(size)
    a = rng.choice([0.25, 0.5, 1.0], (count, size, 1)) * ways[rng.integers(0, 2, (count, size)), lane]
    b = rng.choice([0.25, 0.5, 1.0], (count, size, 1)) * ways[rng.integers(2, 4, (count, size)), lane]
    return _shapes(_point(rng, size) + a + b, a, b)


def collinear(rng, count, size):
    """All with an edge on one line, most on the same side of it."""
    point, along = _point(rng, size), _edges(rng, size)[0]
    a = along * rng.choice([1.0, 1.0, 0.5, 0.7], (count, size, 1))
    b = np.array([_edges(rng, size)[1] for _ in range(count)])
    b = _one_of(rng, b, np.broadcast_to(b[0], b.shape))
    side = np.stack((-along[:, 1], along[:, 0]), axis=-1)
    b = b * np.where(_dot(b, side) > 0.0, 1.0, -1.0) * rng.choice([1.0, -1.0], (count, size, 1), p=[0.95, 0.05])
    return _shapes(point + along * rng.choice(SIDES / 2, (count, size, 1)) + b, a, b)


def along_the_square(rng, count, size):
    """Each with an edge along a side or a diagonal of the square, or on one of its corners."""
    corner = rng.choice([-1.0, 1.0], (size, 2))
    steep, flat = np.sort(np.abs(rng.normal(0.0, 0.7, (2, count, size, 2))))
    flat = flat[..., ::-1]
    length = rng.choice([0.5, 1.0, 1.0, 2.0, 0.7], (count, size, 1))
    level, upright, diagonal = length * [1.0, 0.0], length * [0.0, 1.0], length * [1.0, 1.0]
    first = rng.random((size, 1)) < 0.5  # on one side of the diagonal all the images of a set may end
    a = _one_of(rng, level, level, flat, np.where(first, diagonal, flat))
    b = _one_of(rng, upright, upright, steep, np.where(first, steep, diagonal))
    p, q = rng.choice([1.0, 1.0, 1.0, 1.0, 0.5, 0.0], (2, count, size, 1))
    return _shapes(corner * (1.0 - p * a - q * b), a * corner, b * corner)


def turned(rng, count, size):
    """One image turned by right angles, and mirrored, about a common point within it."""
    a, b = _edges(rng, size)
    p, q = rng.choice(SIDES, (2, size, 1), p=[0.1, 0.25, 0.3, 0.25, 0.1])
    quarters = rng.integers(0, 4, (count, size, 1))
    mirror = np.stack((rng.choice([1.0, 1.0, -1.0], (count, size)), np.ones((count, size))), axis=-1)

    def turn(v):
        v = v * mirror
        v = np.where(quarters % 2 == 1, v[..., ::-1] * [-1.0, 1.0], v)
        return np.where(quarters > 1, -v, v)

    return _shapes(_point(rng, size) + turn(p * a + q * b), turn(a), turn(b))


FAMILIES = [lattice, spoke, nested, through_corners, fan, collinear, along_the_square, turned]


def _shapes(centre, a, b):
    return np.concatenate(np.broadcast_arrays(centre, a, b), axis=-1)


def _point(rng, size):
    """A point for each set: the origin, on the square's sides, on its corners, or anywhere."""
    tied = rng.choice(SIDES, (size, 2), p=[0.1, 0.2, 0.4, 0.2, 0.1])
    return np.where(rng.random((size, 1)) < 0.6, tied, rng.uniform(-0.8, 0.8, (size, 2)))


def _basis(rng, size):
    """Two directions for each set, about a quarter to a half long: exact and rounded, square and slanting."""
    whole = np.array(
        [[2, 0, 0, 2], [4, 0, 0, 4], [2, 2, -2, 2], [4, 4, -4, 4], [2, 1, -1, 2], [3, 1, 1, 3], [4, 0, 1, 2]]
    )
    angle = rng.choice([0.3, np.pi / 4, np.pi / 6, np.pi / 2, 1e-9, 1e-14], size)
    length = rng.choice([0.5, 1.0 / 3.0, 0.35], size)
    e = np.stack((np.cos(angle), np.sin(angle)), axis=-1) * length[:, None]
    rounded = np.concatenate((e, e[:, ::-1] * [-1.0, 1.0]), axis=-1)
    exact = whole[rng.integers(0, len(whole), size)] / 8.0
    both = np.where(rng.random((size, 1)) < 0.6, exact, rounded)
    return both[:, :2], both[:, 2:]


def _edges(rng, size):
    """Half edges for each set: of a basis, or any."""
    e, f = _basis(rng, size)
    free = rng.random((size, 1)) < 0.4
    a, b = rng.normal(0.0, 0.6, (2, size, 2))
    p, q = rng.choice([1.0, 1.5, 2.0], (2, size, 1))
    return np.where(free, a, p * e), np.where(free, b, q * f)


def _one_of(rng, *choices):
    """One of several arrays of vectors for each set, or for each image of each set."""
    return _pick(rng, np.array(np.broadcast_arrays(*choices)))


def _pick(rng, choices):
    """One along the first axis for each vector."""
    return np.take_along_axis(choices, rng.integers(0, len(choices), (1, *choices.shape[1:-1], 1)), axis=0)[0]


def _dot(one, other):
    return (one * other).sum(-1, keepdims=True)


def _sign(rng, shape):
    return rng.choice([-1.0, 1.0], shape)


def _small(rng, shape, low, high):
    return 10.0 ** rng.uniform(low, high, shape)
