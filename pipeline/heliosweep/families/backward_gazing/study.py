"""The study file of the family `backward_gazing`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import Field

from heliosweep.config.faults import Fault
from heliosweep.config.study import Study, parameters
from heliosweep.config.sweep import Sweep, ends, read_items
from heliosweep.config.values import Choice, Flag, Quantity
from heliosweep.errors import Problem
from heliosweep.families.backward_gazing import checks
from heliosweep.families.backward_gazing.blocks import (
    FIT_PROFILES,
    METHODS,
    PROFILES,
    REFERENTIALS,
    Cameras,
    Defects,
    Heliostat,
    HeliostatField,
    Output,
    ProfileNoise,
    Sun,
    Target,
    positions_rules,
)
from heliosweep.families.backward_gazing.image_blocks import ImageEntry, ImageGeometry

MODES = {
    "simulated": "images are made of a heliostat with known defects",
    "measured": "images are read from four files",
}
#: Required keys of a single heliostat; a field computes them.
PLACE = (("heliostat", "distance"), ("target", "azimuth"), ("target", "elevation"), ("sun", "azimuth"),
         ("sun", "elevation"))  # fmt: skip


@dataclass(frozen=True)
class Names(Choice):
    """One or several of some names, in the order in which they are written; a dimension in any case, never a sweep."""

    sweep: bool = field(default=False, kw_only=True)

    def read(self, raw: Any) -> Any:
        """Return the names as a tuple. Raises Invalid."""
        if isinstance(raw, Sweep):
            raw = raw.items()
        return read_items(raw if isinstance(raw, list | tuple) else [raw], self._one)

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of a name or a list of them."""
        one = {"enum": list(self.options)}
        return {"anyOf": [one, {"type": "array", "items": one, "minItems": 1, "uniqueItems": True}]}


class BackwardGazingStudy(Study):
    """Mirror slopes from four images of the reflected sun."""

    family: Literal["backward_gazing"]
    mode: Annotated[str, Choice("Source of the images", MODES, sweep=False)] = "simulated"
    heliostat: Annotated[Heliostat, Field(description="Observed heliostat")] = Heliostat()
    target: Annotated[Target, Field(description="The target with the cameras")] = Target()
    sun: Annotated[Sun, Field(description="The sun")] = Sun()
    field: Annotated[
        HeliostatField | None, Field(description="Heliostats of a field instead of one; mode: simulated only")
    ] = None
    cameras: Annotated[Cameras, Field(description="Four cameras")] = Cameras()
    images: Annotated[
        tuple[ImageEntry, ...] | None,
        Field(description="The four images, in the order of the cameras; mode: measured only"),
    ] = None
    image_geometry: Annotated[
        ImageGeometry | None, Field(description="Levels and grid of the images; mode: measured only")
    ] = None
    defects: Annotated[Defects, Field(description="Defects of the heliostat; mode: simulated only")] = Defects()
    sun_profile: Annotated[
        str | Sweep, Choice("Profile of the sun's brightness", PROFILES, title="profile of the sun's brightness")
    ] = "jose"
    profile_noise: Annotated[ProfileNoise, Field(description="Table of sun_profile: noisy")] = ProfileNoise()
    profile_error: Annotated[
        float | Sweep,
        Quantity("Relative error of the angular radius of the profile used for the "
                 "slopes, compared with the profile of the images", "1", gt=-0.5, le=0.5,
                 title="relative error of the angular radius of the sun's profile"),
    ] = 0.0  # fmt: skip
    method: Annotated[tuple[str, ...], Names("Methods that find slopes", METHODS)] = tuple(METHODS)
    referential: Annotated[
        tuple[str, ...],
        Names("Conversion of slopes of the wavefront to slopes of the mirror; for A and O1", REFERENTIALS),
    ] = tuple(REFERENTIALS)
    fit_gain: Annotated[bool, Flag("True to fit a gain for each pixel, common to its cameras; not for A")] = False
    fit_profile: Annotated[
        str | None, Choice("Profile that LM uses for a tabulated profile of the sun", FIT_PROFILES, sweep=False)
    ] = None
    erosion: Annotated[
        int | Sweep,
        Quantity("Pixels omitted along the edges of the modules", "1", ge=0, le=100, integer=True,
                 title="pixels omitted along the edges of the modules"),
    ] = 2  # fmt: skip
    output: Annotated[Output, Field(description="Stored variables and format")] = Output()

    def reserved_names(self) -> frozenset[str]:
        """Return the names of the result that columns of a layout do not take."""
        from heliosweep.families.backward_gazing.checks import reserved

        return reserved(self)

    def rules(self) -> Iterator[Fault]:
        """Check that the blocks go with the mode."""
        yield from self.output.without_series()
        yield from positions_rules(self.cameras)
        if self.mode == "measured":
            yield from self._measured_faults()
        else:
            yield from self._simulated_faults()
        if "table" in ends(self.sun_profile) and self.sun.profile is self.sun.image is self.sun.frames is None:
            yield Fault("'sun.profile' is missing: the table that 'sun_profile: table' means", show_value=False)

    @property
    def smooth(self) -> bool:
        """True where LM finds slopes by the smooth curve nearest to a table."""
        return (self.fit_profile or ("smooth" if self.mode == "measured" else "table")) == "smooth"

    def examinations(self) -> Iterable[Callable[[BackwardGazingStudy], Iterable[Problem | str]]]:
        """Return what looks for problems between blocks or with named files."""
        return checks.EXAMINATIONS

    def _simulated_faults(self) -> Iterator[Fault]:
        measured = {
            ("images",): self.images,
            ("image_geometry",): self.image_geometry,
            ("sun", "image"): self.sun.image,
            ("sun", "frames"): self.sun.frames,
        }
        for where, value in measured.items():
            if value is not None:
                yield Fault("is only for mode: measured; remove it or change 'mode'", where, show_value=False)
        for block, key in PLACE:
            given = getattr(getattr(self, block), key) is not None
            if self.field is not None and given:
                yield Fault("follows from 'field'; remove it", (block, key), show_value=False)
            elif self.field is None and not given:
                purpose = type(getattr(self, block)).parameter(key).purpose
                yield Fault(f"'{block}.{key}' is missing: {purpose}", show_value=False)
        if self.output.raw_slopes and not self.output.maps:
            yield Fault("needs output.maps", ("output", "raw_slopes"))
        if self.field is not None:
            if self.output.maps:
                yield Fault("must be false with a 'field'", ("output", "maps"))
            if any(isinstance(value, Sweep) for _, _, value in parameters(self.field.layout)):
                yield Fault("cannot be swept here", ("field", "layout"), show_value=False)

    def _measured_faults(self) -> Iterator[Fault]:
        if self.field is not None:
            yield Fault("is only for mode: simulated; remove it or change 'mode'", ("field",), show_value=False)
        if self.images is None:
            yield Fault("'images' is missing: the names of four image files", show_value=False)
        elif len(self.images) != 4:
            message = f"must be four images, one of each camera; these are {len(self.images)}"
            yield Fault(message, ("images",), show_value=False)
        if self.defects != Defects():
            yield Fault("is the truth of a simulation; remove it", ("defects",), show_value=False)
        given = [key for key in ("image", "frames", "profile") if getattr(self.sun, key) is not None]
        for key in given[1:]:
            message = f"is the sun's profile, and so is sun.{given[0]}; give one of the two"
            yield Fault(message, ("sun", key), show_value=False)
        if isinstance(self.sun.angular_radius, Sweep) and {"image", "frames"} & set(given):
            yield Fault("must be one value with an image of the sun", ("sun", "angular_radius"))
        if self.output.raw_slopes:
            yield Fault("is only for mode: simulated", ("output", "raw_slopes"))
        if isinstance(self.sun_profile, Sweep):
            yield Fault("must be one profile in mode: measured", ("sun_profile",))


STUDY = BackwardGazingStudy
