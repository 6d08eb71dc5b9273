"""Generate fields as parts of infinite patterns: staggered rings, the phyllotaxis spiral and parallel rows.

A field of staggered rings consists of zones. All rings of a zone have the same angular pitch, and each ring is rotated
by half a pitch relative to the previous ring. Heliostats in every second ring therefore have equal azimuths, and each
heliostat sees the tower between two heliostats of the previous ring. The distance between neighbours increases outwards
until a new zone with a smaller pitch starts. Neighbours in the first ring of a zone, and neighbours in successive
rings, are one clearance apart, as in the field of Chong and Tan [1]_. The spacing can also increase with the distance
from the tower, according to the DELSOL rule [2]_ or the no-blocking rule [3]_. These rules reduce blocking but require
a larger land area.

References
----------
.. [1] Chong, K. K. and Tan, M. H. (2012). Comparison study of two different sun-tracking methods in optical
   efficiency of heliostat field. International Journal of Photoenergy 2012, 908364. doi:10.1155/2012/908364
.. [2] Kistler, B. L. (1986). A user's manual for DELSOL3. SAND86-8018, Sandia National Laboratories.
.. [3] Siala, F. M. F. and Elayeb, M. E. (2001). Mathematical formulation of a graphical method for a no-blocking
   heliostat field layout. Renewable Energy 23, 77-92.
.. [4] Noone, C. J., Torrilhon, M. and Mitsos, A. (2012). Heliostat field optimization: A new computationally efficient
   model and biomimetic layout. Solar Energy 86, 792-803. doi:10.1016/j.solener.2011.12.007
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from heliosweep.config import Zone
from heliosweep.errors import Problem, StudyError
from heliosweep.kernels.compiled import Floats
from heliosweep.layouts.ground import Region
from heliosweep.layouts.layout import MAX_HELIOSTATS, Layout

#: Maximum number of pattern positions that are examined.
MOST_PLACES = 4 * MAX_HELIOSTATS

#: Spacing within a ring at which an automatic zone ends, as a multiple of the clearance.
#: Maximum relative shortfall of a distance that is treated as a rounding error.
WIDEST_SPACING, ROUNDING = 1.7, 1e-12

#: Radius of a ring [m], and azimuths of its heliostats, clockwise from north and negative in the west. [deg]
Ring: TypeAlias = tuple[float, Floats]
#: Pattern positions x and y within a radius [m], values by which the positions are sorted, and layout columns.
Places: TypeAlias = tuple[Floats, Floats, NDArray[Any], dict[str, NDArray[Any]]]


class Spacing(NamedTuple):
    """Minimum distances between rings and between neighbours within a ring.

    Parameters
    ----------
    rule : {"delsol", "no_blocking"}
        Spacing rule: the fits of DELSOL3 [2]_, or the minimum radius at which a mirror is not blocked by the mirror in
        front of it, at the same azimuth on level ground [3]_.
    receiver : float
        Height of the receiver above the mirrors' centres. [m]
    width, height : float
        Width and height of the mirrors. [m]
    """

    rule: str
    receiver: float
    width: float
    height: float

    def step(self, radius: float) -> float:
        """Return the distance to the next ring: half the distance to the next ring with equal azimuths. [m]

        The coefficients of the fit are those in the source code of DELSOL3. Some publications misprint the coefficient
        1.144 as 1.44, and round the other coefficients. The no-blocking rule requires that the line from a mirror's
        centre to the receiver passes one mirror height from the centre of the mirror in front.
        """
        if self.rule == "delsol":
            t = self.elevation(radius)
            return self.height * (1.1442399 / math.tan(t) - 1.093519 + 3.0683558 * t - 1.1255617 * t**2) / 2
        h, up = self.height, self.receiver
        further = (radius * up**2 + up * h * math.sqrt(radius**2 + up**2 - h**2)) / (up**2 - h**2)
        return (further - radius) / 2

    def apart(self, radius: float) -> float:
        """Return the minimum distance between neighbours in the first ring of a zone, or 0 without a minimum. [m]

        The last term of the fit is often printed as 0.2873 m, which applies only to mirrors 10 m wide.
        """
        if self.rule != "delsol":
            return 0.0
        t = self.elevation(radius)
        return self.width * (1.7490871 + 0.63964099 * t + 0.028726279 / (t - 0.049023315))

    def reaches(self, radius: float) -> bool:
        """Return True if the spacing rule is defined at a radius [m]."""
        return self.rule != "delsol" or self.elevation(radius) > 0.06  # the fit has a pole at 0.049

    def elevation(self, radius: float) -> float:
        """Return the elevation of the receiver seen from a mirror. [rad]"""
        return math.atan2(self.receiver, radius)


def radial_stagger(
    clearance: float,
    inner_radius: float | None = None,
    rings: int | None = None,
    heliostats: int | None = None,
    zones: Sequence[Zone] | None = None,
    spacing: Spacing | None = None,
    region: Region | None = None,
) -> Layout:
    """Generate a radial-staggered layout on level ground.

    The layout is symmetric about the north-south line unless the region is asymmetric. The extent of the field is
    specified by exactly one of `rings`, `heliostats` and `zones`, or by the region. Simple bounds, such as positive
    lengths, are checked when a study file is read, and are not checked again here.

    Parameters
    ----------
    clearance : float
        Minimum distance between the centres of any two heliostats. [m]
    inner_radius : float, optional
        Radius of the first ring, at least half a clearance. The radius may be omitted if `zones` is given. If
        `inner_radius` and `zones` are given, the radius must equal the start of the first zone. [m]
    rings : int, optional
        Number of rings in automatic zones.
    heliostats : int, optional
        Number of heliostats in automatic zones. Surplus heliostats of the last ring are removed in east-west
        pairs, starting from the south. If only one heliostat of a pair is kept, the western heliostat is removed.
    zones : sequence of Zone, optional
        Zones from the tower outwards, as in a study. Each zone starts at least one clearance beyond the last ring of
        the previous zone.
    spacing : Spacing, optional
        Spacing rule that increases the distances between rings and between neighbours in automatic zones.
    region : Region, optional
        Ground on which heliostats may be placed. The ring numbers do not depend on the region.

    Returns
    -------
    Layout
        Layout ordered by rings outwards, and clockwise from north within each ring. z is 0. The columns are ``ring``,
        counted from 1, and ``azimuth``, clockwise from north [deg].

    Raises
    ------
    StudyError
        If the parameters do not define a field. Each problem names the parameter, such as ``zones.1.pitch`` for the
        second zone.

    Notes
    -----
    Let c be the clearance, p the pitch of a zone, and r(k) the radius of its ring k. The radii follow from

        r(k+1) = r(k) cos(p/2) + sqrt(c^2 - r(k)^2 sin^2(p/2)),  at least r(k-1) + c,

    so that heliostats in ring k+1 are one clearance from their neighbours in ring k, and at least one clearance from
    ring k-1 at the same azimuths. The pitch of a zone with the first ring at radius r is 2 asin(c / 2r).

    A pitch within 0.1 % of 360 deg / n is rounded to 360 deg / n to close the rings, unless heliostats would be too
    close together. Otherwise, the rings are filled from the north on both sides, at 0, p, 2p, ... or p/2, 3p/2, ..., as
    long as heliostats are one clearance apart across the gap in the south. An additional heliostat is placed due south
    if this position is at least one clearance from all other heliostats.

    An automatic zone ends before the spacing within a ring exceeds 1.7 clearances, and the next zone starts one
    clearance further out. If `spacing` is given, the spacing rule determines the minimum distances and the ends of
    zones, and all rings are closed.

    Examples
    --------
    >>> import heliosweep
    >>> layout = heliosweep.radial_stagger(clearance=14.0, inner_radius=60.0, heliostats=100)
    >>> layout.x.size, float(round(layout.y[0], 1))
    (100, 60.0)
    """
    start = zones[0].start if zones else inner_radius or 0.0
    _check_rings(clearance, start if inner_radius is None else inner_radius, zones)
    most = MAX_HELIOSTATS if region is None and heliostats is None else MOST_PLACES
    extent = next((key for key, value in (("zones", zones), ("rings", rings)) if value), "clearance")

    def places(radius: float) -> Places:
        field, count = list[Ring](), 0
        sequence = _given_zones(clearance, zones) if zones else _automatic_zones(clearance, start, spacing)
        for ring in islice(sequence, rings):
            if ring[0] > radius:
                break
            field.append(ring)
            count += ring[1].size
            _check_count(count, extent, most)
        sizes = np.array([azimuths.size for _, azimuths in field], np.int64)
        azimuth = np.concatenate([np.empty(0), *(azimuths for _, azimuths in field)])
        number = np.repeat(np.arange(1, len(field) + 1), sizes)
        distance = np.repeat([far for far, _ in field], sizes)
        # The east and west sides are exactly symmetric. The eastern heliostat of a pair comes first.
        x, y = distance * np.sin(np.radians(azimuth)), distance * np.cos(np.radians(azimuth))
        return x, y, 360.0 * number + abs(azimuth), {"ring": number, "azimuth": azimuth % 360}

    reach = math.sqrt(start**2 + 0.4 * (heliostats or 0) * clearance**2) + 2 * clearance
    return _cut("radial_stagger", places, reach, 0.0, heliostats, region)


def _check_rings(clearance: float, inner_radius: float, zones: Sequence[Zone] | None) -> None:
    least, most = clearance / 2, clearance * MAX_HELIOSTATS / (2 * math.pi)
    radii = {f"zones.{index}.start": zone.start for index, zone in enumerate(zones or ())}
    problems = list[Problem]()
    if zones and inner_radius != zones[0].start:
        message = f"must be the start of the first zone, {zones[0].start:.6g}, or be omitted"
        problems.append(Problem(message, "inner_radius"))
    for key, radius in (radii or {"inner_radius": inner_radius}).items():
        if not least * (1 - ROUNDING) <= radius <= most:
            rule = f"must be from {least:.6g} m, half the clearance, to {most:.6g} m, because a larger ring has more "
            problems.append(Problem(f"{rule}than {MAX_HELIOSTATS:,} heliostats (got {radius:.6g})", key))
    for index, zone in enumerate(zones or ()):
        finest = _angle_apart(zone.start, zone.start, clearance)
        if zone.pitch is not None and zone.pitch < finest * (1 - ROUNDING):
            rule = f"must be from {finest:.6g}, which is one clearance at this radius, to 180 (got {zone.pitch:.6g})"
            problems.append(Problem(rule, f"zones.{index}.pitch"))
    if problems:
        raise StudyError(problems)


def _given_zones(clearance: float, zones: Sequence[Zone]) -> Iterator[Ring]:
    nearest = -math.inf
    for index, zone in enumerate(zones):
        if zone.start < nearest * (1 - ROUNDING):
            message = "the zone must start at least one clearance outside the last ring of the previous zone, at "
            message += f"{math.ceil(nearest * 1000) / 1000} m or more (got {zone.start})"
            raise StudyError(Problem(message, f"zones.{index}.start"))
        count, rings = 0, _zone(clearance, zone.start, *_pitch(clearance, zone.start, zone.pitch))
        for ring in islice(rings, zone.rings):
            nearest, count = ring[0] + clearance, count + 1
            yield ring
        if count < zone.rings:
            message = f"only {count} of {zone.rings} rings fit before another heliostat would fit between neighbours; "
            message += f"start a new zone at {math.ceil(nearest * 1000) / 1000} m or more"
            raise StudyError(Problem(message, f"zones.{index}.rings"))


def _automatic_zones(clearance: float, start: float, spacing: Spacing | None) -> Iterator[Ring]:
    """Yield rings until the spacing rule, if any, is undefined. A new zone starts when gaps become too wide."""
    delsol = spacing is not None and spacing.rule == "delsol"
    while spacing is None or spacing.reaches(start):
        pitch, closed = _pitch(clearance, start)
        widest = start * (4 / 3 if delsol else WIDEST_SPACING)
        if spacing is not None:  # rings are closed
            finest = _angle_apart(start, start, max(clearance, spacing.apart(start)))
            closed = max(1, math.floor(360 / finest * (1 + ROUNDING)))
            pitch = 360 / closed
        outermost = start
        for radius, azimuths in _zone(clearance, start, pitch, closed, spacing):
            if spacing is None:
                wide = 2 * radius * math.sin(math.radians(pitch) / 2) > WIDEST_SPACING * clearance
            else:
                wide = radius > widest or not spacing.reaches(radius)
            if wide:
                break
            outermost = radius
            yield radius, azimuths
        slip = 0.0 if spacing is None else spacing.step(outermost) * (1 if delsol else 2)
        start = outermost + max(clearance, slip)


def _pitch(clearance: float, start: float, given: float | None = None) -> tuple[float, int | None]:
    """Return the pitch of a zone [deg], and the number of heliostats in each ring if the rings are closed."""
    finest = _angle_apart(start, start, clearance)
    pitch = finest if given is None else given
    count = round(360 / pitch)
    if 360 / count < finest * (1 - ROUNDING):
        count -= 1  # with this number of heliostats, neighbours would be too close together
    if abs(360 / count - pitch) <= 1e-3 * pitch:
        return 360 / count, count
    return pitch, None


def _zone(
    clearance: float, start: float, pitch: float, closed: int | None, spacing: Spacing | None = None
) -> Iterator[Ring]:
    """Yield the rings of a zone until another heliostat fits between neighbours, or endlessly if `spacing` is given.

    Each ring is filled from the north on both sides. A closed ring has equal angular steps. An open ring has a gap in
    the south that may contain one heliostat. Only the previous ring can be too close, because earlier rings are at
    least one clearance further in. Staggering ensures a sufficient distance to the previous ring, even across the gap,
    except for a heliostat due south in either ring.
    """
    half, radius, azimuths = math.radians(pitch) / 2, start, np.empty(0)
    before, staggered = -math.inf, False
    while True:
        first = 0.5 if staggered else 1.0
        if closed is not None:
            sides = (np.arange(closed // 2 if staggered else (closed - 1) // 2) + first) * pitch
            south = staggered == (closed % 2 == 1)
        else:
            apart, last = _angle_apart(radius, radius, clearance), azimuths.max(initial=0.0)
            from_previous = _angle_apart(radius, before, clearance) if azimuths.size else 0.0
            gap = max(apart / 2, from_previous if last == 180.0 else 0.0)
            sides = (np.arange(math.floor((180 - gap) / pitch + 1 - first)) + first) * pitch
            south = 180 - sides.max(initial=0.0) >= apart and 180 - last >= from_previous
        azimuths = np.concatenate([[0.0] * (not staggered), sides, [180.0] * int(south), -sides[::-1]])
        yield radius, azimuths
        if spacing is None and 2 * radius * math.sin(half / 2) >= clearance:
            return
        touching = radius * math.cos(half) + math.sqrt(max(clearance**2 - (radius * math.sin(half)) ** 2, 0.0))
        further = -math.inf if spacing is None else radius + spacing.step(radius)
        radius, before, staggered = max(touching, before + clearance, further), radius, not staggered


def _angle_apart(radius: float, other: float, distance: float) -> float:
    """Return the azimuth difference [deg] at which points at the two radii are `distance` apart."""
    sine_squared = (distance**2 - (radius - other) ** 2) / (4 * radius * other)
    return math.degrees(2 * math.asin(math.sqrt(min(max(sine_squared, 0.0), 1.0))))


def spiral(
    a: float, b: float, inner_radius: float, heliostats: int | None = None, region: Region | None = None
) -> Layout:
    """Generate a phyllotaxis spiral [4]_.

    Heliostat k, counted from 1, has the azimuth 360 k / phi^2 deg and the radius a k^b, where phi is the golden ratio.

    Parameters
    ----------
    a : float
        Radius of heliostat 1. [m]
    b : float
        Exponent of the radius.
    inner_radius : float
        Radius of the circle around the tower that contains no heliostats. [m]
    heliostats : int, optional
        Number of heliostats. The heliostats nearest to the tower are selected. The number may be omitted if the region
        is bounded.
    region : Region, optional
        Ground on which heliostats may be placed.

    Returns
    -------
    Layout
        Layout ordered from the tower outwards. z is 0, and the ``turn`` column contains the number k. Azimuths are
        clockwise from north.

    Raises
    ------
    StudyError
        If the parameters do not define a field. Each problem names the parameter.
    """

    def places(radius: float) -> Places:
        # Use logarithms to avoid overflow; too many positions are rejected below.
        count = 0.0 if radius < a else math.exp(min(math.log(radius / a) / b, 50.0))
        _check_count(count, "b")
        k = np.arange(1, int(count) + 1)
        turn = k / ((1 + math.sqrt(5)) / 2) ** 2
        azimuth = 2 * math.pi * (turn - np.floor(turn))
        distance = a * k.astype(float) ** b
        return distance * np.sin(azimuth), distance * np.cos(azimuth), k, {"turn": k}

    first = (inner_radius / a) ** (1 / b) if inner_radius > a else 0.0
    return _cut("spiral", places, a * (first + (heliostats or 1) + 2) ** b, inner_radius, heliostats, region)


def rows(
    spacing: float,
    distance: float,
    inner_radius: float,
    azimuth: float = 0.0,
    pattern: str = "staggered",
    heliostats: int | None = None,
    region: Region | None = None,
) -> Layout:
    """Generate parallel rows of heliostats. Row 0 passes through the tower.

    Parameters
    ----------
    spacing : float
        Distance between neighbours in a row. [m]
    distance : float
        Distance between rows. [m]
    inner_radius : float
        Radius of the circle around the tower that contains no heliostats. [m]
    azimuth : float
        Azimuth perpendicular to the rows, clockwise from north. [deg]
    pattern : {"staggered", "straight"}
        In the staggered pattern, odd rows are shifted to the right by half a spacing, as seen along `azimuth`.
    heliostats : int, optional
        Number of heliostats. The heliostats nearest to the tower are selected. Heliostats at equal distances (within
        rounding) are selected by row, and from the left within a row. The number may be omitted if the region is
        bounded.
    region : Region, optional
        Ground on which heliostats may be placed.

    Returns
    -------
    Layout
        Layout ordered by rows along `azimuth`, and from the left within each row. z is 0, and the ``row`` column
        contains the row number.

    Raises
    ------
    StudyError
        If the parameters do not define a field. Each problem names the parameter.
    """
    turn = math.radians(azimuth)

    def places(radius: float) -> Places:
        _check_count(math.pi * (radius / spacing + 1) * (radius / distance + 1), "spacing")
        most, deep = math.ceil(radius / spacing) + 1, math.ceil(radius / distance)
        row, number = np.meshgrid(np.arange(-deep, deep + 1), np.arange(-most, most + 1), indexing="ij")
        right = ((number + (row % 2) * 0.5 * (pattern == "staggered")) * spacing).ravel()
        ahead = (row * distance).ravel().astype(float)
        far = np.hypot(right, ahead)
        near = far <= radius
        x = right * math.cos(turn) + ahead * math.sin(turn)
        y = ahead * math.cos(turn) - right * math.sin(turn)
        # Round to 1 nm, so that mirror-symmetric positions are at equal distances.
        return x[near], y[near], np.round(far, 9)[near], {"row": row.ravel()[near]}

    wanted = (heliostats or 1) * spacing * distance / math.pi
    reach = math.sqrt(inner_radius**2 + wanted) + spacing + distance
    return _cut("rows", places, reach, inner_radius, heliostats, region)


#: Generators for each key of the ``layout`` block.
PATTERNS: Mapping[str, Callable[..., Layout]] = {"radial_stagger": radial_stagger, "spiral": spiral, "rows": rows}


def _check_count(count: float, key: str, most: int = MOST_PLACES) -> None:
    if count > most:
        message = f"the field would have more than {most:,} positions: reduce its area or the number of heliostats"
        raise StudyError(Problem(message, key))


def _cut(
    name: str,
    places: Callable[[float], Places],
    reach: float,
    inner_radius: float,
    heliostats: int | None,
    region: Region | None,
) -> Layout:
    """Select the heliostats of a field from a pattern.

    The function `places` returns the pattern positions within a radius. The radius starts at `reach` [m] and is
    increased until there are enough positions.
    """
    region = region or Region()
    if heliostats is not None and heliostats > MAX_HELIOSTATS:
        raise StudyError(Problem(f"must be at most {MAX_HELIOSTATS:,} (got {heliostats})", "heliostats"))
    most = region.reach
    radius, wanted = (most, 0) if heliostats is None else (min(reach, most), heliostats)
    while True:
        x, y, order, columns = places(radius)
        rows = np.flatnonzero((np.hypot(x, y) >= inner_radius) & region.inside(x, y))
        if radius >= most or rows.size >= wanted:
            break
        radius = min(1.4 * radius, most)
    if not rows.size:
        raise region.no_room()
    if rows.size < wanted:
        message = f"only {rows.size:,} fit (got {heliostats:,}): use fewer, or a larger area"
        raise StudyError(Problem(message, "heliostats"))
    if heliostats is not None:
        rows = np.sort(rows[np.argsort(order[rows], kind="stable")[:heliostats]])
    _check_count(rows.size, region.key, MAX_HELIOSTATS)
    return Layout(x[rows], y[rows], np.zeros(rows.size), {key: of[rows] for key, of in columns.items()}, name)
