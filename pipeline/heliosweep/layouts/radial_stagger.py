"""Radial-staggered fields: rings about the tower, each turned by half a pitch against the one before.

The field is made of zones. All rings of a zone have the same angular pitch, so that every second ring is on the same
spokes and each heliostat looks at the tower between two of the ring before. Going outwards the
heliostats of a ring drift apart; a new zone with a finer pitch then starts.

The rule is the one that the field of Chong and Tan [1]_ follows: neighbours are one clearance apart, in the
first ring of a zone and from each ring to the next. If blocking matters more than land, a spacing that grows
with the distance from the tower keeps them farther apart.

References
----------
.. [1] Chong, K. K. and Tan, M. H. (2012). Comparison study of two different sun-tracking methods in optical
   efficiency of heliostat field. International Journal of Photoenergy 2012, 908364. doi:10.1155/2012/908364
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from heliosweep.config.layouts import Zone
from heliosweep.errors import Problem, StudyError
from heliosweep.kernels.arrays import Floats
from heliosweep.layouts.ground import Region
from heliosweep.layouts.layout import MAX_HELIOSTATS, Layout
from heliosweep.layouts.patterns import MOST_PLACES, check_count
from heliosweep.layouts.spacing import Spacing

#: Spacing within a ring, in clearances, beyond which an automatic zone ends.
WIDEST_SPACING = 1.7

#: A pitch this near to a whole fraction of the circle, relatively, is taken as that fraction.
CLOSING_TOLERANCE = 1e-3

#: Relative shortfall of a distance that is put down to rounding.
ROUNDING = 1e-12


def radial_stagger(
    clearance: float,
    inner_radius: float | None = None,
    rings: int | None = None,
    heliostats: int | None = None,
    zones: Sequence[Zone] | None = None,
    spacing: Spacing | None = None,
    region: Region | None = None,
) -> Layout:
    """Generate a radial-staggered layout on level ground, symmetric about the north-south line but for its region.

    Exactly one of `rings`, `heliostats` and `zones` specifies the extent of the field, or the reach of the region.
    Bounds of the keys of a study file, such as positive numbers, are not checked.

    Parameters
    ----------
    clearance : float
        Least distance between the centres of any two heliostats. [m]
    inner_radius : float, optional
        Radius of the first ring, at least half a clearance. Optional with `zones`, or the start of the first one. [m]
    rings : int, optional
        Number of rings, in automatic zones.
    heliostats : int, optional
        Number of heliostats, in automatic zones. The surplus of the last ring is left out from the south
        towards the north on both sides; if one heliostat has to go without its mirror image, the eastern
        one of the pair stays.
    zones : sequence of Zone, optional
        The zones outwards, as a study has them, each at least one clearance outside the last ring of the one before.
    spacing : Spacing, optional
        Rule for larger distances of rings and neighbours, in automatic zones.
    region : Region, optional
        Ground for heliostats; the rings keep their numbers in the whole field.

    Returns
    -------
    Layout
        Ring by ring outwards, each ring clockwise from north, with z = 0 and the columns ``ring``, counted
        from 1, and ``azimuth``, from north clockwise [deg].

    Raises
    ------
    StudyError
        If the parameters cannot be met; each problem carries the parameter as its key, a zone's as
        ``zones.1.pitch``, counted from 0.

    Notes
    -----
    With clearance c, pitch p and radius r(k) of ring k of a zone,

        r(k+1) = r(k) cos(p/2) + sqrt(c^2 - r(k)^2 sin^2(p/2)),  at least r(k-1) + c,

    which puts ring k+1 one clearance from its neighbours in ring k, and clear of ring k-1 on the same spokes.
    The pitch of a zone that starts at radius r is 2 asin(c / 2r). If it is within 0.1 % of 360 deg / n it
    becomes that, unless heliostats would come too close, and the rings close. Otherwise the rings are filled
    from north, at 0, p, 2p, ... or p/2, 3p/2, ... on both sides, as far as all stay clear across the gap in
    the south; and one more heliostat is due south if it is clear of all others.

    An automatic zone ends before the spacing within a ring exceeds 1.7 clearances; the next one starts one
    clearance further out. If `spacing` is given, it sets the minimum of these steps and the ends of zones, and all
    rings close.
    """
    _check(clearance, inner_radius, heliostats, zones)
    region = region or Region()
    assert zones is not None or inner_radius is not None
    sequence = _given_zones(clearance, zones) if zones else _automatic_zones(clearance, inner_radius or 0.0, spacing)
    field: list[_Ring] = []
    cut = bool(region.sectors) or region.boundary is not None or bool(region.exclude)
    count = candidates = 0
    for ring in islice(sequence, rings):
        if ring.radius > region.reach or (heliostats is not None and count >= heliostats):
            break
        field.append(ring)
        candidates += len(ring)
        count += int(region.inside(*_places(ring.radius, ring.clockwise())).sum()) if cut else len(ring)
        if (heliostats is None or count < heliostats) and (count > MAX_HELIOSTATS or candidates > MOST_PLACES):
            key = "zones" if zones is not None else "rings" if rings is not None else "clearance"
            raise StudyError(Problem(f"the field would have more than {MAX_HELIOSTATS:,} heliostats", key))
    check_count(count, heliostats, region)
    return _layout(field, region, heliostats)


@dataclass(frozen=True)
class _Ring:
    """One ring: heliostats due north and south, and the azimuths of the others.

    Azimuths count from north on both sides, increase, and lie strictly between 0 and 180. [deg]
    """

    radius: float
    north: bool
    sides: Floats
    south: bool

    def __len__(self) -> int:
        """Return the number of heliostats."""
        return self.north + 2 * self.sides.size + self.south

    @property
    def last(self) -> float:
        """Azimuth of the southernmost heliostat on the eastern side, in degrees."""
        if self.south:
            return 180.0
        return float(self.sides[-1]) if self.sides.size else 0.0

    def clockwise(self) -> Floats:
        """Return the azimuths clockwise from north, those in the west negative, in degrees."""
        return np.concatenate([[0.0] * self.north, self.sides, [180.0] * self.south, -self.sides[::-1]])


def _places(radius: float | Floats, clockwise: Floats) -> tuple[Floats, Floats]:
    """Return x and y at some azimuths [m]; east and west mirror each other to the last bit."""
    azimuth = np.radians(clockwise)
    return radius * np.sin(azimuth), radius * np.cos(azimuth)


def _layout(field: list[_Ring], region: Region, heliostats: int | None) -> Layout:
    """Place the heliostats, ring by ring and clockwise; of the last ring those in the north, of a pair the eastern."""
    signed = np.concatenate([ring.clockwise() for ring in field])
    number = np.repeat(np.arange(1, len(field) + 1), [len(ring) for ring in field])
    x, y = _places(np.array([ring.radius for ring in field])[number - 1], signed)
    there = np.flatnonzero(region.inside(x, y))
    if heliostats is not None:
        last = there[number[there] == len(field)]
        last = last[np.lexsort((signed[last] < 0, abs(signed[last])))]
        surplus = there.size - heliostats
        there = np.sort(np.concatenate([there[number[there] < len(field)], last[: last.size - surplus]]))
    columns = {"ring": number[there], "azimuth": signed[there] % 360}
    return Layout(x[there], y[there], np.zeros(there.size), columns, "radial_stagger")


def _given_zones(clearance: float, zones: Sequence[Zone]) -> Iterator[_Ring]:
    """Yield the rings of the zones that the user gave."""
    outermost = -math.inf
    for index, zone in enumerate(zones):
        nearest = f"{math.ceil((outermost + clearance) * 1000) / 1000} m or more" if index else ""
        if zone.start < (outermost + clearance) * (1 - ROUNDING):
            message = "the zone must start at least one clearance outside the last ring of the one before, at "
            raise StudyError(Problem(f"{message}{nearest} (got {zone.start})", f"zones.{index}.start"))
        count = 0
        for ring in islice(_zone(clearance, zone.start, *_pitch(clearance, zone.start, zone.pitch)), zone.rings):
            outermost, count = ring.radius, count + 1
            yield ring
        if count < zone.rings:
            nearest = f"{math.ceil((outermost + clearance) * 1000) / 1000} m or more"
            message = f"only {count} of {zone.rings} rings fit before the next heliostats would fit between them; "
            raise StudyError(Problem(f"{message}start a new zone at {nearest}", f"zones.{index}.rings"))


def _automatic_zones(clearance: float, start: float, spacing: Spacing | None) -> Iterator[_Ring]:
    """Yield rings without end, or as far as the spacing goes; a new zone starts if neighbours are too far apart."""
    while spacing is None or spacing.reaches(start):
        pitch, closed = _pitch(clearance, start)
        if spacing is not None:  # rings close
            finest = _angle_apart(start, start, max(clearance, spacing.apart(start)))
            closed = max(1, math.floor(360 / finest * (1 + ROUNDING)))
            pitch = 360 / closed
        outermost = start
        for ring in _zone(clearance, start, pitch, closed, spacing):
            if spacing is None:
                wide = 2 * ring.radius * math.sin(math.radians(pitch) / 2) > WIDEST_SPACING * clearance
            else:
                wide = spacing.ends(ring.radius, start) or not spacing.reaches(ring.radius)
            if wide:
                break
            outermost = ring.radius
            yield ring
        start = outermost + (clearance if spacing is None else max(clearance, spacing.slip(outermost)))


def _pitch(clearance: float, start: float, given: float | None = None) -> tuple[float, int | None]:
    """Return the pitch of a zone [deg], and the number of heliostats of its rings if they close."""
    finest = _angle_apart(start, start, clearance)
    pitch = finest if given is None else given
    count = round(360 / pitch)
    if 360 / count < finest * (1 - ROUNDING):
        count -= 1  # closed in these steps, neighbours would be too close
    if abs(360 / count - pitch) <= CLOSING_TOLERANCE * pitch:
        return 360 / count, count
    return pitch, None


def _zone(
    clearance: float, start: float, pitch: float, closed: int | None, spacing: Spacing | None = None
) -> Iterator[_Ring]:
    """Yield the rings of one zone until a ring has room for the staggered heliostats among its own; else no end."""
    half = math.radians(pitch) / 2
    before, radius = -math.inf, start
    staggered = False
    ring: _Ring | None = None
    while True:
        if closed is not None:
            ring = _closed_ring(radius, closed, staggered)
        else:
            ring = _open_ring(radius, pitch, staggered, clearance, ring)
        yield ring
        if spacing is None and 2 * radius * math.sin(half / 2) >= clearance:
            return
        touching = radius * math.cos(half) + math.sqrt(max(clearance**2 - (radius * math.sin(half)) ** 2, 0.0))
        further = -math.inf if spacing is None else radius + spacing.step(radius)
        before, radius = radius, max(touching, before + clearance, further)
        staggered = not staggered


def _closed_ring(radius: float, count: int, staggered: bool) -> _Ring:
    """Return a ring of equal steps all round, from north or, staggered, from half a step next to it."""
    first, number = (0.5, count // 2) if staggered else (1.0, (count - 1) // 2)
    half = (np.arange(number, dtype=np.float64) + first) * (360 / count)
    return _Ring(radius, not staggered, half, staggered == (count % 2 == 1))


def _open_ring(radius: float, pitch: float, staggered: bool, clearance: float, previous: _Ring | None) -> _Ring:
    """Return a ring filled from north on both sides, with a gap in the south and perhaps one heliostat in it.

    Only the ring before can be too near: those before it are at least one clearance further in. The stagger keeps the
    distance to it, also across the gap, except for a heliostat due south of either ring.
    """
    apart = _angle_apart(radius, radius, clearance)
    from_previous = _angle_apart(radius, previous.radius, clearance) if previous else 0.0
    gap = max(apart / 2, from_previous if previous and previous.south else 0.0)
    first = 0.5 if staggered else 1.0
    half = (np.arange(math.floor((180 - gap) / pitch + 1 - first), dtype=np.float64) + first) * pitch
    last = float(half[-1]) if half.size else 0.0
    clear = 180 - last >= apart and (previous is None or 180 - previous.last >= from_previous)
    return _Ring(radius, not staggered, half, clear)


def _angle_apart(radius: float, other: float, distance: float) -> float:
    """Return the least difference in azimuth [deg] of two points at these radii that keeps the distance."""
    sine_squared = (distance**2 - (radius - other) ** 2) / (4 * radius * other)
    return math.degrees(2 * math.asin(math.sqrt(min(max(sine_squared, 0.0), 1.0))))


def _check(clearance: float, inner_radius: float | None, heliostats: int | None, zones: Sequence[Zone] | None) -> None:
    """Raise StudyError with everything that is wrong with single parameters."""
    problems: dict[str, str] = {}
    least, most = clearance / 2, clearance * MAX_HELIOSTATS / (2 * math.pi)
    radii = {f"zones.{index}.start": zone.start for index, zone in enumerate(zones or ())}
    for key, radius in ({"inner_radius": inner_radius} | radii).items():
        if radius is not None and radius < least * (1 - ROUNDING):
            problems[key] = f"must be at least half the clearance, {least:.6g} m (got {radius:.6g})"
        elif radius is not None and radius > most:
            problems[key] = f"a ring of {radius:.6g} m has more than {MAX_HELIOSTATS:,} heliostats at this clearance"
    if heliostats is not None and heliostats > MAX_HELIOSTATS:
        problems["heliostats"] = f"must be at most {MAX_HELIOSTATS:,} (got {heliostats})"
    if zones and inner_radius not in (None, zones[0].start):
        problems.setdefault("inner_radius", f"must be the start of the first zone, {zones[0].start:.6g}, or be omitted")
    for index, zone in enumerate(zones or ()):
        if zone.pitch is not None and f"zones.{index}.start" not in problems:
            finest = _angle_apart(zone.start, zone.start, clearance)
            if zone.pitch < finest * (1 - ROUNDING):
                rule = f"must be from {finest:.6g}, one clearance at this radius, to 180"
                problems[f"zones.{index}.pitch"] = f"{rule} (got {zone.pitch:.6g})"
    if problems:
        raise StudyError(Problem(message, key) for key, message in problems.items())
