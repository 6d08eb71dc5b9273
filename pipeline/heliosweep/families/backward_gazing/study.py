"""Study file model of the `backward_gazing` family, with checks of its blocks and files."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from heliosweep.config import Choice, Fault, Flag, Quantity, Study, Sweep, ends, parameters, read_items
from heliosweep.errors import Problem, StudyError
from heliosweep.families.backward_gazing.blocks import (
    FIT_PROFILES,
    METHODS,
    PROFILES,
    REFERENTIALS,
    Cameras,
    Defects,
    Heliostat,
    HeliostatField,
    ImageEntry,
    ImageGeometry,
    Output,
    ProfileNoise,
    Sun,
    Target,
)
from heliosweep.kernels.gazing import geometry
from heliosweep.layouts.resolve import Layouts

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.images import Shots

MODES = {
    "simulated": "images are simulated for a heliostat with known defects",
    "measured": "images are read from four files",
}
#: Keys that are required for a single heliostat, but computed for the heliostats of a field.
PLACE = (("heliostat", "distance"), ("target", "azimuth"), ("target", "elevation"), ("sun", "azimuth"),
         ("sun", "elevation"))  # fmt: skip
#: Problems in a study, and notes (strings).
Found = Iterator[Problem | str]
#: Maximum number of pixels on a mirror.
MAX_PIXELS = 20_000_000
#: Maximum overlap of modules that is attributed to rounding. [m]
_SLACK = 1e-9
#: Prefixes of keys that only simulations use.
SIMULATED = (
    "defects.", "profile_noise.", "cameras.noise", "cameras.gain_error", "cameras.gain_noise", "cameras.bits",
    "cameras.images", "cameras.supersampling", "cameras.seed",
)  # fmt: skip


@dataclass(frozen=True)
class Names(Choice):
    """One or more names in the order of the study. The names always form a dimension, but cannot be swept."""

    sweep: bool = field(default=False, kw_only=True)

    def read(self, raw: Any) -> Any:
        """Return the names as a tuple. Raises Invalid."""
        return read_items(raw if isinstance(raw, list | tuple) else [raw], self._one)

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of a name or a list of names."""
        one = {"enum": list(self.options)}
        return {"anyOf": [one, {"type": "array", "items": one, "minItems": 1, "uniqueItems": True}]}


class BackwardGazingStudy(Study):
    """Mirror slopes from four images of the reflected sun."""

    family: Literal["backward_gazing"]
    mode: Annotated[str, Choice("Source of the images", MODES, sweep=False)] = "simulated"
    heliostat: Annotated[Heliostat, Field(description="Observed heliostat")] = Heliostat()
    target: Annotated[Target, Field(description="Target with the cameras")] = Target()
    sun: Annotated[Sun, Field(description="Position and brightness profile of the sun")] = Sun()
    field: Annotated[
        HeliostatField | None, Field(description="Field of heliostats instead of a single one; mode: simulated only")
    ] = None
    cameras: Annotated[Cameras, Field(description="Four cameras")] = Cameras()
    images: Annotated[
        tuple[ImageEntry, ...] | None,
        Field(description="The four images, in the order of the cameras; mode: measured only"),
    ] = None
    image_geometry: Annotated[
        ImageGeometry | None, Field(description="Grey levels and grid of the images; mode: measured only")
    ] = None
    defects: Annotated[Defects, Field(description="Defects of the heliostat; mode: simulated only")] = Defects()
    sun_profile: Annotated[
        str | Sweep, Choice("Brightness profile of the sun", PROFILES, title="brightness profile of the sun")
    ] = "jose"
    profile_noise: Annotated[ProfileNoise, Field(description="Noisy table for sun_profile: noisy")] = ProfileNoise()
    profile_error: Annotated[
        float | Sweep,
        Quantity("Relative error of the solar radius assumed for estimating slopes, compared with the "
                 "radius in the images", "1", gt=-0.5, le=0.5,
                 title="relative error of the assumed solar radius"),
    ] = 0.0  # fmt: skip
    method: Annotated[tuple[str, ...], Names("Methods for estimating slopes", METHODS)] = tuple(METHODS)
    referential: Annotated[
        tuple[str, ...],
        Names("Conversion of wavefront slopes to mirror slopes, for methods A and O1", REFERENTIALS),
    ] = tuple(REFERENTIALS)
    fit_gain: Annotated[bool, Flag("True to fit a gain at each pixel, common to all cameras; not for method A")] = False
    fit_profile: Annotated[
        str | None, Choice("Sun profile for method LM if the profile is a table", FIT_PROFILES, sweep=False)
    ] = None
    erosion: Annotated[
        int | Sweep,
        Quantity("Number of pixels omitted along the edges of the modules", "1", ge=0, le=100, integer=True,
                 title="number of pixels omitted along the edges of the modules"),
    ] = 2  # fmt: skip
    output: Annotated[Output, Field(description="Stored variables and format")] = Output()

    def reserved_names(self) -> frozenset[str]:
        """Return the names of variables and coordinates, which layout columns must not use."""
        # the variables module imports xarray, which studies without a layout do not need
        from heliosweep.families.backward_gazing import variables as names

        keys = (
            getattr(parameter, "dimension", "") or key.rpartition(".")[2]
            for key, parameter, _ in parameters(self)
            if getattr(parameter, "sweep", True) and not key.startswith("field.layout.")
        )
        labels = (*names.COORDINATES, "heliostat", "heliostat_width", "heliostat_height")
        return frozenset((*names.FIELD, *names.SIMULATED, *names.MAPS, *names.over_seeds(()), *labels, *keys))

    def rules(self) -> Iterator[Fault]:
        """Check that the study contains all blocks that its mode requires, and no others."""
        yield from self.output.without_series()
        sun, output = self.sun, self.output
        only = "is only for mode: {}: remove it, or change 'mode'"
        faults: list[Any] = [
            (isinstance(getattr(self.cameras, key), Sweep) and self.cameras.positions is not None,
             "cannot be swept if 'positions' is set", ("cameras", key), False)
            for key in ("arrangement", "radius")
        ] + [
            ("table" in ends(self.sun_profile) and sun.profile is None and sun.image is None,
             "'sun.profile' is missing: give the table for 'sun_profile: table'", (), False),
        ]  # fmt: skip
        if self.mode == "measured":
            number = len(self.images or ())
            faults += [
                (self.field is not None, only.format("simulated"), ("field",), False),
                (not self.images, "'images' is missing: give the names of four image files", (), False),
                (number not in (0, 4), f"must contain four images, one for each camera (got {number})",
                 ("images",), False),
                (self.defects != Defects(), "describes a simulated heliostat: remove it", ("defects",), False),
                (None not in (sun.profile, sun.image),
                 "and sun.image both give the sun's profile: remove one of them", ("sun", "profile"), False),
                (isinstance(sun.angular_radius, Sweep) and sun.image is not None,
                 "must be a single value if sun.image is given", ("sun", "angular_radius"), True),
                (output.raw_slopes, "is only for mode: simulated", ("output", "raw_slopes"), True),
                (isinstance(self.sun_profile, Sweep), "must be a single profile in mode: measured",
                 ("sun_profile",), True),
            ]  # fmt: skip
        else:
            for block, key in PLACE:
                given, purpose = getattr(self, block), type(getattr(self, block)).parameter(key).purpose
                faults += [
                    (self.field is not None and getattr(given, key) is not None,
                     "is computed from 'field': remove it", (block, key), False),
                    (self.field is None and getattr(given, key) is None,
                     f"'{block}.{key}' is missing: {purpose}", (), False),
                ]  # fmt: skip
            layout = () if self.field is None else parameters(self.field.layout)
            faults += [
                (self.images is not None, only.format("measured"), ("images",), False),
                (self.image_geometry is not None, only.format("measured"), ("image_geometry",), False),
                (sun.image is not None, only.format("measured"), ("sun", "image"), False),
                (output.raw_slopes and not output.maps, "needs output.maps", ("output", "raw_slopes"), True),
                (any(isinstance(value, Sweep) for *_, value in layout), "cannot be swept here",
                 ("field", "layout"), False),
            ]  # fmt: skip
        yield from (Fault(*fault) for wrong, *fault in faults if wrong)

    @property
    def smooth(self) -> bool:
        """True if LM uses a smooth curve fitted to the table of the sun's profile."""
        return (self.fit_profile or ("smooth" if self.mode == "measured" else "table")) == "smooth"

    def examinations(self) -> Iterable[Callable[[BackwardGazingStudy], Iterable[Problem | str]]]:
        """Return the functions that check the blocks and the files."""
        return _modules, _pixels, _cameras, _profile, _layout, _measured


def _modules(study: BackwardGazingStudy) -> Found:
    """Check the modules, the focal lengths, the distance, and the module numbers in the defects."""
    modules = study.heliostat.rectangles
    for one, other in itertools.combinations(range(len(modules.size)), 2):
        shared = 0.5 * (modules.size[one] + modules.size[other]) - np.abs(modules.centre[one] - modules.centre[other])
        if np.all(shared > _SLACK):
            message = f"overlaps module {one + 1} by {shared[0]:.4g} m x {shared[1]:.4g} m"
            yield study.problem(f"heliostat.modules[{other}]", message)
    count = len(modules.size)
    for block in ("canting", "curvature"):
        for key in set(getattr(study.defects, block) or ()) - set(map(str, range(1, count + 1))):
            yield study.problem(f"defects.{block}.{key}", f"is not a module: the heliostat has modules 1 to {count}")
    least = study.heliostat.reach
    for block, key in (("heliostat", "focal_length"), ("heliostat", "distance"), ("defects", "focal_length")):
        value = getattr(getattr(study, block), key)
        if value is not None and min(ends(value)) <= least:
            message = (
                f"must be more than {least:.3g} m, the distance from the heliostat's centre to its farthest corner"
            )
            yield study.problem(f"{block}.{key}", f"{message} (got {min(ends(value)):g})")


def _pixels(study: BackwardGazingStudy) -> Found:
    """Check that each module has pixels, and that there are not too many pixels."""
    modules = study.heliostat.rectangles
    largest, smallest = max(ends(study.heliostat.pixel)), min(ends(study.heliostat.pixel))
    side, number = float(modules.size.min()), int(np.argmin(modules.size.min(axis=1))) + 1
    with np.errstate(over="ignore"):
        count = float(np.prod(np.ceil(np.ptp(geometry.outline(modules), axis=0) / smallest)))
    lost = max(ends(study.erosion))
    faults: list[Any] = [
        (largest > side, "heliostat.pixel",
         f"must be at most {side:g} m, the shorter side of module {number} (got {largest:g})"),
        (count > MAX_PIXELS, "heliostat.pixel",
         f"is too small: the mirror has {count:.3g} pixels, more than {MAX_PIXELS:,} (got {smallest:g})"),
        (side / largest <= 2 * lost + 1, "erosion",
         f"leaves no pixels of {largest:g} m on the {side:g} m side of module {number}: reduce it, or reduce "
         f"heliostat.pixel (got {lost:g})"),
    ]  # fmt: skip
    yield from [study.problem(*fault) for wrong, *fault in faults if wrong][:1]
    if isinstance(study.heliostat.pixel, Sweep) and study.mode == "measured":
        yield study.problem("heliostat.pixel", "cannot be swept in mode: measured, because all maps share one grid")
    elif isinstance(study.heliostat.pixel, Sweep) and study.output.maps:
        yield study.problem(
            "output.maps", "must be false if heliostat.pixel is swept, because each pixel size has its own grid"
        )


def _cameras(study: BackwardGazingStudy) -> Found:
    """Check that the cameras are not collinear as seen from the heliostat."""
    cameras, target = study.cameras, study.target
    placed = [geometry.camera_square(1.0, str(name)) for name in ends(cameras.arrangement)]
    if cameras.positions is not None:
        placed = [np.array(cameras.positions)]
        if geometry.in_line(placed[0]):
            yield study.problem("cameras.positions", "are collinear and cannot determine two slopes")
            return
    if target.azimuth is None or target.elevation is None:
        return
    swept = [ends(getattr(target, key))[:20] for key in ("azimuth", "elevation", "tilt", "face")]
    angles = [np.radians(values) for values in itertools.product(*swept)]
    if all(
        geometry.in_line(geometry.product(geometry.basis(azimuth, up)[1:], geometry.in_space(places, tilt, face)))
        for places in placed
        for azimuth, up, tilt, face in angles
    ):
        message = "the target is seen edge-on, so its cameras are collinear and cannot determine two slopes"
        yield study.problem("target.elevation", message)


def _profile(study: BackwardGazingStudy) -> Found:
    """Check that the profile table is readable.

    Yield a note if the brightness increases towards the edge, because a decreasing envelope of the table is then used.
    """
    from heliosweep.families.backward_gazing.images import read_disc

    name = study.sun.profile
    if name is None:
        return
    if "table" not in ends(study.sun_profile):
        yield "sun.profile is not used, because sun_profile is not 'table'"
    if note := read_disc(study.resolve(name), name).note(name):
        yield f"{note}; method A inverts the lowest decreasing curve above the profile"


def _layout(study: BackwardGazingStudy) -> Found:
    """Check that no heliostat of a field reaches the target."""
    if study.field is None or any(key.startswith("field.layout.") for key in study.sweeps()):
        return
    layout = Layouts(study, "field.layout")[()]
    above = [up - pivot for up in ends(study.field.receiver_height) for pivot in ends(study.field.pivot_height)]
    level = np.hypot(layout.x, layout.y)
    near = np.hypot(level, np.array(above)[:, np.newaxis] - layout.z).min(axis=0)
    for row in np.flatnonzero(near <= study.heliostat.reach)[:1].tolist():
        yield study.problem("field.layout", f"{layout.where(row)} reaches the target, which is {near[row]:.3g} m away")
    if "heliostat" in ends(study.field.facing):
        for row in np.flatnonzero((level < _SLACK) & (near > study.heliostat.reach)).tolist():
            yield (
                f"{layout.where(row)} is at the foot of the tower, so its azimuths and the direction of a target "
                "that faces it (facing: heliostat) are arbitrary"
            )


def _measured(study: BackwardGazingStudy) -> Found:
    """Check that the measured images show the heliostat, and that the sun data are consistent."""
    if study.mode != "measured" or isinstance(study.heliostat.pixel, Sweep):
        return
    from heliosweep.families.backward_gazing.images import read_shots, read_sun  # these imports load the kernels

    for key in study.sweeps():
        if key.startswith(SIMULATED):
            yield study.problem(key, "has no effect on measured images: give one value, or remove it")
    try:
        yield from read_sun(study)[1]
    except StudyError as error:
        yield from error.problems
    shots = read_shots(study)
    if shots.positions not in (None, study.cameras.positions) and geometry.in_line(np.array(shots.positions)):
        yield study.problem("images", "the cameras are collinear and cannot determine two slopes")
    rows, columns = shots.images.shape[1:]
    shape = geometry.mirror_grid(study.heliostat.rectangles, study.heliostat.pixel).module.shape
    if not shots.rectified:
        yield from _corner_problems(study, shots)
        if shots.register.any():
            yield from _registration_problems(study, shots)
    elif (rows, columns) != shape:
        yield study.problem("images", (
            f"have {columns} x {rows} pixels, but the mirror grid has {shape[1]} x {shape[0]} pixels of "
            f"{study.heliostat.pixel:g} m: use images on this grid, or mark the 'corners' of the heliostat"
        ))  # fmt: skip
    yield from _contradictions(study, shots)
    yield from _level_problems(study, shots)


def _corner_problems(study: BackwardGazingStudy, shots: Shots) -> Found:
    """Check that the marked corners are inside the image, are in clockwise order and enclose enough pixels."""
    rows, columns = shots.images.shape[1:]
    order = "mark the upper left, upper right, lower right and lower left corners of the heliostat"
    for number in np.flatnonzero(np.isfinite(shots.corners).all(axis=(1, 2))).tolist():
        key, corners = f"images[{number}].corners", shots.corners[number]
        ahead, before = np.roll(corners, -1, axis=0) - corners, corners - np.roll(corners, 1, axis=0)
        turns = 0.5 * (before[:, 0] * ahead[:, 1] - before[:, 1] * ahead[:, 0])  # positive if clockwise in the image
        middle = np.array([columns - 1.0, rows - 1.0]) / 2.0
        outside = np.count_nonzero(np.any(np.abs(corners - middle) > middle + 1.0, axis=1))
        message = f"{outside} of 4 corners are outside the image of {columns} x {rows} pixels"
        faults = {
            f"three of the corners are nearly collinear; {order}":
                np.abs(turns).min() <= 0.05 * np.abs(turns).max(),
            f"are not in clockwise order around the heliostat; {order}": turns.min() < 0.0,
            f"enclose {0.5 * turns.sum():.3g} pixels, which are too few to estimate slopes": 0.5 * turns.sum() < 16.0,
            message: outside > 2,
        }  # fmt: skip
        if wrong := next((text for text, holds in faults.items() if holds), ""):
            yield study.problem(key, wrong)
        elif outside:
            yield f"{(study.images or ())[number].file}: {message}"


def _registration_problems(study: BackwardGazingStudy, shots: Shots) -> Found:
    """Check that the heliostat is found in images without marked corners."""
    from heliosweep.families.backward_gazing.compute import Failure, computation, registered, scene_of, values_of
    from heliosweep.families.family import Inputs, Points

    region = {dim.name: slice(0, 1) for dim in study.dimensions()}
    point = next(iter(Points(study, computation(study), Inputs(None, None), region)))
    try:
        values = values_of(point, shots.geometry)
        registered(point, scene_of(values, shots.positions), values["heliostat.focal_length"], shots)
    except Failure:
        return
    except ValueError as error:
        if len(error.args) == 2:
            message = f"the heliostat was not found in {study.images[error.args[0]].file}: {error.args[1]}"  # type: ignore[index]  # four
            yield study.problem(
                f"images[{error.args[0]}]", f"{message}: mark the 'corners', or give FOCALPIX in the metadata"
            )


def _contradictions(study: BackwardGazingStudy, shots: Shots) -> Iterator[str]:
    """Yield a note for each sun, target or distance value that differs between the study and the metadata."""
    from heliosweep.families.backward_gazing.images import GEOMETRY

    for key, dotted in GEOMETRY.items():
        block, name = dotted.split(".")
        stated = getattr(getattr(study, block), name)
        for value in {one[key]: None for one in shots.metadata if key in one and not isinstance(stated, Sweep | None)}:
            away = abs((value - stated + 180.0) % 360.0 - 180.0), abs(value / (stated or 1.0) - 1.0)
            if away[key == "DISTANCE"] > (0.05, 1e-3)[key == "DISTANCE"]:  # deg, or relative
                other = f"{key} is {value:g} in the metadata of images"
                yield f"{dotted} is {stated:g} in the study, but {other}: the study is used"


def _level_problems(study: BackwardGazingStudy, shots: Shots) -> Found:
    """Yield problems and notes about dark, saturated and uniform images."""
    from heliosweep.families.backward_gazing.images import bright_level

    least, dark = float(min(ends(study.cameras.threshold))), []
    for number, (image, limit) in enumerate(zip(shots.images, shots.saturation, strict=True)):
        name, key = (study.images or ())[number].file, f"images[{number}]"
        known = image[np.isfinite(image)]
        lit = int(np.count_nonzero(known >= min(least, float(limit))))
        over = int(np.count_nonzero(known >= limit)) / max(1, lit)
        message = f"{name}: {100 * over:.3g} % of its lit pixels are saturated"
        if float(np.ptp(known)) == 0.0:
            yield study.problem(key, f"{name} has the same level everywhere: check whether it is dark or saturated")
        elif over > 0.5:
            yield study.problem(key, f"{message}; use a shorter exposure")
        elif over > 0.0:
            yield f"{message} and not used; use a shorter exposure"
        if image.size > known.size:
            yield f"{name}: {image.size - known.size:,} of its pixels are not valid numbers and are not used"
        if bright_level(known) < least:
            dark.append(name)
    message = f"their brightest pixels are below {least:g} of the white level"
    if len(dark) > 1:
        message = f"{' and '.join(dark)} are dark: {message}, and slopes need three cameras"
        yield study.problem("images", f"{message}; use a longer exposure, or correct 'white'")
    elif dark:
        yield f"{dark[0]} is dark: {message.replace('their', 'its')}; this camera is omitted"
