"""Blocks of the study file on the way of the light: mirrors, what is lost in them and in the air, and the receiver."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import Field

from heliosweep.config.block import Block
from heliosweep.config.blocks import Heliostat as HeliostatBlock
from heliosweep.config.blocks import Receiver as ReceiverPoint
from heliosweep.config.faults import Fault
from heliosweep.config.sweep import Listed, Sweep, read_items
from heliosweep.config.values import Choice, Quantity, list_schema

SUN_SHAPES = {
    "pillbox": "an even disc of 4.65 mrad",
    "gaussian": "a Gaussian of 2.73 mrad per axis",
    "limb_darkened": "a disc of 4.65 mrad, darker at its limb by 0.56",
    "jose": "the disc of Jose (1957) as in backward gazing",
    "buie": "disc and aureole of Buie et al. (2003), by circumsolar_ratio",
}
ATTENUATION = {
    "none": "nothing is lost in the air",
    "delsol_clear": "DELSOL3, visibility 23 km",
    "delsol_hazy": "DELSOL3, visibility 5 km",
    "leary_hankins": "Leary and Hankins (1979), MIRVAL",
    "ballestrin_clear": "Ballestrin and Marzo (2012), clear",
    "ballestrin_hazy": "Ballestrin and Marzo (2012), hazy",
}
METHODS = {
    "accurate": "sun shape and errors integrated over the mirror and the receiver",
    "gaussian": "one round Gaussian for each heliostat (HFLCAL), a hundredth of its work, up to some percent off",
}
RECEIVERS = {
    "rectangle": "a flat face, its centre the aim",
    "cavity": "the rectangular aperture of a cavity, its centre the aim",
    "cylinder": "the outside of an upright cylinder; each heliostat aims at the point of it that faces it",
}
CANTING = {"none": "all facets in one plane", "on_axis": "facets tilted for the slant range of each heliostat"}


@dataclass(frozen=True)
class Focus(Quantity):
    """A focal length in m, or one of two words."""

    words: tuple[str, ...] = field(default=("flat", "slant"), kw_only=True)

    def read(self, raw: Any) -> Any:
        """Return the word or the number. Raises Invalid."""
        several = raw.items if isinstance(raw, Listed) else raw
        if isinstance(several, list | tuple) and several and all(each in self.words for each in several):
            return Listed(read_items(several, lambda word: word))
        return raw if isinstance(raw, str) and raw in self.words else super().read(raw)

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of a word or a number."""
        word = {"enum": list(self.words)}
        return {"anyOf": [word, list_schema(word), super().json_schema()]}


class FacetGrid(Block):
    """Facets of a mirror, in columns and rows of equal size."""

    columns: Annotated[int, Quantity("Facets along the width", "1", ge=1, le=50, integer=True, sweep=False)]
    rows: Annotated[int, Quantity("Facets along the height", "1", ge=1, le=50, integer=True, sweep=False)]
    gap: Annotated[float, Quantity("Gap between facets", "m", ge=0, sweep=False)] = 0.0
    canting: Annotated[str, Choice("How facets are tilted", CANTING, sweep=False)] = "none"


class Heliostat(HeliostatBlock):
    """The mirror of every heliostat: a rectangle, in one piece or of facets; its focus only matters with 'optics'."""

    focus: Annotated[
        float | str | Sweep | None,
        Focus("Focal length of the mirror, or of its facets; 'flat', or 'slant' for the range of each heliostat", "m",
              gt=0, title="focal length of the mirror"),
    ] = None  # fmt: skip
    facets: Annotated[FacetGrid | None, Field(description="Facets of the mirror; without, it is one piece")] = None


class Receiver(ReceiverPoint):
    """The aim of all heliostats; with 'optics' the surface about it."""

    kind: Annotated[str | None, Choice("Shape of the receiver", RECEIVERS, sweep=False)] = None
    azimuth: Annotated[
        float | Sweep | None,
        Quantity("Azimuth that a rectangle or cavity faces, clockwise from north: 0 faces a field in the north", "deg",
                 ge=-360, le=360, dimension="receiver_azimuth", title="azimuth of the receiver's normal"),
    ] = None  # fmt: skip
    tilt: Annotated[
        float | Sweep | None,
        Quantity("Tilt of its normal above the horizontal; negative faces down", "deg", ge=-90, le=90,
                 dimension="receiver_tilt", title="tilt of the receiver's normal above the horizontal"),
    ] = None  # fmt: skip
    width: Annotated[
        float | Sweep | None,
        Quantity("Width of a rectangle or cavity", "m", gt=0, dimension="receiver_width", title="receiver width"),
    ] = None
    radius: Annotated[
        float | Sweep | None,
        Quantity("Radius of a cylinder", "m", gt=0, dimension="receiver_radius", title="receiver radius"),
    ] = None
    height_extent: Annotated[
        float | Sweep | None,
        Quantity("Height of the receiver itself, along its face", "m", gt=0, title="height of the receiver itself"),
    ] = None

    def rules(self) -> Iterator[Fault]:
        """Check that the keys are those of the kind."""
        wanted = {None: (), "cylinder": ("radius", "height_extent")}.get(self.kind, ("width", "height_extent"))
        known = wanted if self.kind in (None, "cylinder") else (*wanted, "azimuth", "tilt")
        for key in ("azimuth", "tilt", "width", "radius", "height_extent"):
            given = getattr(self, key) is not None
            if given and key not in known:
                of = f"is not for a receiver of kind {self.kind}" if self.kind else "needs 'kind' of the receiver"
                yield Fault(f"{of}; remove it", (key,))
            elif not given and key in wanted:
                yield Fault(f"'{key}' is missing: a receiver of kind {self.kind} has it, in m", show_value=False)


class SunShape(Block):
    """Brightness of the sun against the angle from its centre."""

    kind: Annotated[str | Sweep, Choice("Sun shape", SUN_SHAPES, dimension="sun_shape", title="sun shape")]
    circumsolar_ratio: Annotated[
        float | Sweep | None,
        Quantity("Part of the light that comes from the aureole, for buie", "1", ge=0.001, le=0.8,
                 title="circumsolar ratio"),
    ] = None  # fmt: skip

    def rules(self) -> Iterator[Fault]:
        """Check that the circumsolar ratio stands with the sun shape that has one."""
        kinds = self.kind.values() if isinstance(self.kind, Sweep) else (self.kind,)
        if "buie" in kinds and self.circumsolar_ratio is None:
            yield Fault("'circumsolar_ratio' is missing: buie has it, from 0.001 to 0.8", show_value=False)
        if "buie" not in kinds and self.circumsolar_ratio is not None:
            yield Fault("is only for the sun shape buie; remove it", ("circumsolar_ratio",))


def _error(description: str, title: str) -> Quantity:
    return Quantity(description, "mrad", ge=0, le=50, title=title)


class Optics(Block):
    """What happens to the light between mirror and receiver."""

    sun_shape: Annotated[SunShape, Field(description="Brightness of the sun against the angle from its centre")]
    reflectivity: Annotated[
        float | Sweep,
        Quantity("Part of the light that a clean mirror reflects", "1", ge=0, le=1, title="reflectivity"),
    ] = 1.0
    cleanliness: Annotated[
        float | Sweep,
        Quantity("Part of that which dirt leaves", "1", ge=0, le=1, title="cleanliness"),
    ] = 1.0
    attenuation: Annotated[
        str | Sweep, Choice("What the air between mirror and receiver takes", ATTENUATION, title="attenuation in air")
    ] = "none"
    slope_error: Annotated[
        float | Sweep | None,
        _error("Standard deviation of the mirror's normal, per axis", "slope error"),
    ] = None
    slope_error_horizontal: Annotated[
        float | Sweep | None,
        _error("The same of turns along the mirror's width alone", "slope error along the width"),
    ] = None
    slope_error_vertical: Annotated[
        float | Sweep | None,
        _error("The same of turns along the mirror's height alone", "slope error along the height"),
    ] = None
    specularity_error: Annotated[
        float | Sweep,
        _error("Standard deviation of the reflected ray, per axis", "specularity error"),
    ] = 0.0
    tracking_error: Annotated[
        float | Sweep,
        _error("Standard deviation of the normal by random errors of tracking, per axis", "tracking error"),
    ] = 0.0
    method: Annotated[str | Sweep, Choice("How the intercept is found", METHODS, dimension="intercept_method",
                                          title="method of the intercept")] = "accurate"  # fmt: skip

    def rules(self) -> Iterator[Fault]:
        """Check that the slope error is given once: for both axes, or for each."""
        axes = [f"slope_error_{axis}" for axis in ("horizontal", "vertical")]
        given = [key for key in axes if getattr(self, key) is not None]
        if self.slope_error is not None:
            for key in given:
                yield Fault("is given by 'slope_error' too; leave one out", (key,))
        elif len(given) < 2:
            yield Fault("give 'slope_error', or both 'slope_error_horizontal' and 'slope_error_vertical', in mrad",
                        show_value=False)  # fmt: skip


#: Keys that the light on the receiver depends on, beside those of the mirrors and of the sun.
KEYS = (
    *("heliostat.focus", "receiver.azimuth", "receiver.tilt", "receiver.width", "receiver.radius"),
    *("receiver.height_extent", "optics.sun_shape.kind", "optics.sun_shape.circumsolar_ratio", "optics.reflectivity"),
    *("optics.cleanliness", "optics.attenuation", "optics.slope_error", "optics.slope_error_horizontal"),
    *("optics.slope_error_vertical", "optics.specularity_error", "optics.tracking_error", "optics.method"),
)
#: Names of swept keys among them and of results, which columns of a layout must leave to these.
NAMES = (
    *("focus", "receiver_azimuth", "receiver_tilt", "receiver_width", "receiver_radius", "height_extent", "sun_shape"),
    *("circumsolar_ratio", "reflectivity", "cleanliness", "attenuation", "slope_error", "slope_error_horizontal"),
    *("slope_error_vertical", "specularity_error", "tracking_error", "intercept_method"),
    *(f"{of}{name}_efficiency" for of in ("", "field_", "instantaneous_")
      for name in ("intercept", "attenuation", "reflection", "total")),
)  # fmt: skip
