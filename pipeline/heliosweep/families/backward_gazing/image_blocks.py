"""Blocks of the study file on images: metadata, levels and grid."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from heliosweep.config.blocks import Block
from heliosweep.config.values import FileName, Flag, ListOfNumbers, Numbers, Quantity

Two = tuple[float, float]


class Frame(Block):
    """One of several images of the sun."""

    file: Annotated[str, FileName("Image of the sun, NPY, TIFF, PNG or FITS", sweep=False)]


def _with_file(raw: Any) -> Any:
    """An image that is written as the name of its file alone, in full: ``a.npy`` is ``{file: a.npy}``."""
    return {"file": raw} if isinstance(raw, str) else raw


FrameEntry = Annotated[Frame, BeforeValidator(_with_file, json_schema_input_type=str | Frame)]


def _said(description: str, unit: str = "1", **bounds: float) -> Quantity:
    return Quantity(description, unit, sweep=False, **bounds)  # type: ignore[arg-type]  # bounds are none of its flags


class Metadata(Block):
    """Numbers of the metadata of an image, under their keys; values in the study have priority."""

    FOCALPIX: Annotated[
        float | None, _said("Focal length of the camera over the side of a pixel", ge=10, le=1e7)
    ] = None  # fmt: skip
    CENTREU: Annotated[
        float | None,
        _said("Column at which the camera looks, from 0 at the centre of the left pixels", ge=-1e5, le=1e5),
    ] = None
    CENTREV: Annotated[
        float | None, _said("Row at which the camera looks, from 0 at the centre of the upper pixels", ge=-1e5, le=1e5)
    ] = None
    ROLL: Annotated[
        float | None,
        _said("Turn of the camera about its line of sight, clockwise for someone behind it", "deg", ge=-360, le=360),
    ] = None
    CAMERAY: Annotated[
        float | None,
        _said("Place of the camera in the target's plane, to the east of a target that faces north", "m",
              ge=-1e3, le=1e3),
    ] = None  # fmt: skip
    CAMERAZ: Annotated[float | None, _said("Place of the camera in the target's plane, up", "m", ge=-1e3, le=1e3)] = (
        None
    )
    DARK: Annotated[float | None, _said("Level of a pixel without light")] = None
    WHITE: Annotated[
        float | None, _said("Level of the sun's centre seen in the mirror, the dark level included")
    ] = None  # fmt: skip
    SATURATE: Annotated[float | None, _said("Level from which a pixel counts as saturated", gt=0)] = None
    SUNAZ: Annotated[
        float | None, _said("Azimuth of the sun, from south towards east", "deg", ge=-360, le=360)
    ] = None  # fmt: skip
    SUNEL: Annotated[float | None, _said("Elevation of the sun", "deg", gt=0, le=90)] = None
    TARGETAZ: Annotated[
        float | None,
        _said("Azimuth of the target seen from the heliostat, from south towards east", "deg", ge=-360, le=360),
    ] = None
    TARGETEL: Annotated[
        float | None, _said("Elevation of the target seen from the heliostat", "deg", gt=-90, lt=90)
    ] = None  # fmt: skip
    DISTANCE: Annotated[
        float | None, _said("Distance of the heliostat's centre from the target's", "m", gt=0)
    ] = None  # fmt: skip
    PIXANGLE: Annotated[float | None, _said("Angle of a pixel of an image of the sun", "mrad", gt=0)] = None


class Image(Block):
    """One of the four measured images."""

    file: Annotated[str, FileName("Image of the heliostat, NPY, TIFF, PNG or FITS", sweep=False)]
    camera: Annotated[
        Two | None,
        Numbers("Place of the camera in the target's plane; from the image's metadata or 'cameras' where left out",
                "m", ("y", "z")),
    ] = None  # fmt: skip
    corners: Annotated[
        tuple[Two, ...] | None,
        ListOfNumbers("Upper left, upper right, lower right and lower left corner of the heliostat in the image, pixel "
                      "centres at whole numbers from the first pixel of the file", "1", ("column", "row"), entries=4),
    ] = None  # fmt: skip
    metadata: Annotated[
        Metadata | None,
        Field(description="Metadata of the file: FITS cards, PNG text chunks, or lines 'KEY = value' in the "
                          "ImageDescription of a TIFF; values in the study have priority. NPY has none"),
    ] = None  # fmt: skip


ImageEntry = Annotated[Image, BeforeValidator(_with_file, json_schema_input_type=str | Image)]


class ImageGeometry(Block):
    """Levels and grid of measured images."""

    rectified: Annotated[
        bool | None,
        Flag("True if the images are on the grid of the mirror, top row first "
             "(default: if they have its size, without corners and FOCALPIX)"),
    ] = None  # fmt: skip
    registration: Annotated[
        bool | None,
        Flag("True to find shift, rotation and scale of the images from the edges of the "
             "modules (default: without corners and FOCALPIX); corners have priority"),
    ] = None  # fmt: skip
    dark: Annotated[float | None, Quantity("Level of a pixel without light; from metadata, or 0", "1", sweep=False)] = (
        None
    )
    white: Annotated[
        float | None,
        Quantity("Level of the sun's centre seen in the mirror; from metadata, or the highest of the sun's image",
                 "1", gt=0, sweep=False),
    ] = None  # fmt: skip
    saturation: Annotated[
        float | None,
        Quantity("Level from which a pixel counts as saturated; from metadata, or the highest of the file's type",
                 "1", gt=0, sweep=False),
    ] = None  # fmt: skip
    noise: Annotated[
        float | None,
        Quantity("Standard deviation of a pixel relative to the sun's centre; from the residuals where left out",
                 "1", ge=0, sweep=False),
    ] = None  # fmt: skip
