"""Study file blocks of the `backward_gazing` family."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, create_model

from heliosweep.config import (
    MAX_SEED,
    Block,
    Choice,
    Fault,
    FileName,
    Flag,
    Layout,
    ListOfNumbers,
    Numbers,
    Quantity,
    Samples,
    Sweep,
)
from heliosweep.config import Output as StoredOutput
from heliosweep.kernels.gazing.geometry import Modules as Rectangles
from heliosweep.kernels.gazing.geometry import themis_8

METHODS = {
    "A": "analytic: wavefront slopes by linear least squares",
    "O1": "optimised: wavefront slopes by Nelder-Mead",
    "O2": "optimised with backward ray tracing: mirror slopes by Nelder-Mead",
    "LM": "the merit function of O2, minimised by Levenberg-Marquardt",
}
REFERENTIALS = {
    "none": "half the wavefront slopes, without field rotation; agrees with the table in the paper",
    "roll": "with the rotation between the mirror axes and the target axes",
    "exact": "with the exact Jacobian",
}
PROFILES = {
    "jose": "Jose's generalised formula",
    "noisy": "a table of Jose's formula with noise (see profile_noise)",
    "table": "the table in sun.profile",
}
FIT_PROFILES = {
    "table": "the table itself, as in the methods of the paper; the default of mode: simulated",
    "smooth": "a smooth curve fitted to the table to remove its noise; the default of mode: measured",
}

Two = tuple[float, float]


def _seed(description: str, dimension: str, title: str) -> Quantity:
    return Quantity(description, "1", ge=0, le=MAX_SEED, integer=True, dimension=dimension, title=title)


class Module(Block):
    """One module of a heliostat."""

    centre: Annotated[
        Two, Numbers("Centre of the module relative to the heliostat's centre: to the right as seen from the "
                     "target, and upwards",
                     "m", ("y", "z"))
    ]  # fmt: skip
    size: Annotated[Two, Numbers("Width and height of the module", "m", ("width", "height"), gt=0)]


Modules = Annotated[
    Annotated[
        str,
        Choice(
            "Predefined heliostat",
            {
                "themis_8": "8 modules of 3.6 m x 1.8 m in 2 columns with gaps of 5 cm; modules 1 to 4 form the "
                "left column from top to bottom, modules 5 to 8 the right column"
            },
            sweep=False,
        ),
        Tag("name"),
    ]
    | Annotated[tuple[Module, ...], Field(min_length=1, max_length=100), Tag("list")],
    Discriminator(lambda raw: "list" if isinstance(raw, list | tuple) else "name"),
    Field(description="Modules of the heliostat: a name, or a list of {centre: [y, z], size: [width, height]}"),
]


class Heliostat(Block):
    """Heliostat observed by the cameras."""

    focal_length: Annotated[
        float | Sweep | None,
        Quantity("Focal length of the ideal heliostat (default: the distance)", "m", gt=0, title="focal length"),
    ] = None
    distance: Annotated[
        float | Sweep | None,
        Quantity("Distance between the centres of the heliostat and the target; not used with a field", "m", gt=0,
                 title="distance between heliostat and target"),
    ] = None  # fmt: skip
    modules: Modules = "themis_8"
    pixel: Annotated[
        float | Sweep,
        Quantity("Side length of a pixel on the mirror", "m", gt=0, title="side of a pixel on the mirror"),
    ] = 0.05

    @property
    def rectangles(self) -> Rectangles:
        """Modules as arrays for the kernels. [m]"""
        if isinstance(self.modules, str):
            return themis_8()
        return Rectangles(*(np.array([getattr(one, key) for one in self.modules]) for key in ("centre", "size")))

    @property
    def reach(self) -> float:
        """Distance from the heliostat's centre to the farthest corner of its modules. [m]"""
        centre, size = self.rectangles
        return float(np.hypot(*(np.abs(centre) + 0.5 * size).T).max())


class Target(Block):
    """Target with cameras around its centre."""

    azimuth: Annotated[
        float | Sweep | None,
        Quantity("Azimuth of the target seen from the heliostat, from south towards east; not used with a field",
                 "deg", ge=-360, le=360, dimension="target_azimuth",
                 title="azimuth of the target seen from the heliostat, from south towards east"),
    ] = None  # fmt: skip
    elevation: Annotated[
        float | Sweep | None,
        Quantity("Elevation of the target seen from the heliostat; not used with a field", "deg", gt=-90, lt=90,
                 dimension="target_elevation", title="elevation of the target seen from the heliostat"),
    ] = None  # fmt: skip
    tilt: Annotated[
        float | Sweep,
        Quantity("Tilt of the target from the vertical; positive values face down", "deg", gt=-90, lt=90,
                 dimension="target_tilt", title="tilt of the target from the vertical"),
    ] = 30.0  # fmt: skip
    face: Annotated[
        float | Sweep,
        Quantity("Rotation of the target about the vertical, from south towards east; a target at 0 faces north",
                 "deg", ge=-360, le=360, dimension="target_face", title="rotation of the target about the vertical"),
    ] = 0.0  # fmt: skip


class Sun(Block):
    """Position and brightness profile of the sun."""

    azimuth: Annotated[
        float | Sweep | None,
        Quantity("Azimuth of the sun, from south towards east; not used with a field", "deg", ge=-360, le=360,
                 dimension="sun_azimuth", title="azimuth of the sun, from south towards east"),
    ] = None  # fmt: skip
    elevation: Annotated[
        float | Sweep | None,
        Quantity("Elevation of the sun; not used with a field", "deg", gt=0, le=90, dimension="sun_elevation",
                 title="elevation of the sun", standard_name="solar_elevation_angle"),
    ] = None  # fmt: skip
    profile: Annotated[
        str | None,
        FileName("CSV table of the sun profile with the columns angle [mrad] and brightness, for sun_profile: table",
                 sweep=False),
    ] = None  # fmt: skip
    image: Annotated[
        str | None, FileName("Sun image file (NPY, TIFF, PNG or FITS); mode: measured only", sweep=False)
    ] = None
    pixel_angle: Annotated[
        float | None,
        Quantity("Angular size of a pixel in the sun's image (default: computed from the angular radius)",
                 "mrad", gt=0, sweep=False),
    ] = None  # fmt: skip
    limb_brightness: Annotated[
        float | Sweep | None,
        Quantity("Parameter A of Jose's formula: brightness of the limb relative to the centre (default: 0.679)", "1",
                 ge=0, lt=1, title="brightness of the sun's limb relative to the centre, A"),
    ] = None  # fmt: skip
    limb_exponent: Annotated[
        float | Sweep | None,
        Quantity("Exponent xi of Jose's formula (default: 2.222)", "1", gt=0, le=20,
                 title="exponent xi of Jose's formula"),
    ] = None  # fmt: skip
    angular_radius: Annotated[
        float | Sweep | None,
        Quantity("Parameter eps_max of Jose's formula, the angular radius of the disc (default: 4.36)", "mrad", gt=1,
                 le=20, title="angular radius of the sun's disc, eps_max"),
    ] = None  # fmt: skip


class Cameras(Block):
    """Four cameras around the target's centre."""

    arrangement: Annotated[
        str | Sweep,
        Choice(
            "Arrangement of the cameras",
            {
                "square": "cameras at the upper left, upper right, lower left and lower right corners of a square",
                "cross": "cameras above, left of, right of and below the centre",
            },
            title="arrangement of the cameras",
        ),
    ] = "square"
    radius: Annotated[
        float | Sweep,
        Quantity("Distance of each camera from the target's centre", "m", gt=0, dimension="camera_radius",
                 title="distance of the cameras from the target's centre"),
    ] = 0.24  # fmt: skip
    positions: Annotated[
        tuple[Two, ...] | None,
        ListOfNumbers("Positions of the four cameras in the target plane, instead of arrangement and radius: [y, "
                      "z], with z upwards, and y to the east for a target that faces north", "m", ("y", "z"),
                      entries=4),
    ] = None  # fmt: skip
    noise: Annotated[
        float | Sweep,
        Quantity("Standard deviation of the pixel noise, relative to the brightness of the sun's centre", "1", ge=0,
                 le=1, dimension="camera_noise", title="camera noise relative to the brightness of the sun's centre"),
    ] = 0.0  # fmt: skip
    gain_error: Annotated[
        float | Sweep,
        Quantity("Relative gain error, common to all cameras", "1", gt=-1, le=1,
                 title="relative gain error of all cameras"),
    ] = 0.0  # fmt: skip
    gain_noise: Annotated[
        float | Sweep,
        Quantity("Relative standard deviation of the random camera gains", "1",
                 ge=0, le=1, dimension="camera_gain_noise", title=(
                     "relative standard deviation of the camera gains"
                 )),
    ] = 0.0  # fmt: skip
    bits: Annotated[
        int | Sweep,
        Quantity("Bits per pixel: 2^bits levels up to 1.25 times the brightness of the sun's centre; 0 for no "
                 "rounding", "1", ge=0, le=24, integer=True,
                 title="bits per pixel"),
    ] = 0  # fmt: skip
    images: Annotated[
        str | Sweep,
        Choice(
            "Type of camera images",
            {
                "mirror_grid": "brightness on the mirror grid, as seen by a perfect camera",
                "camera": "images of pinhole cameras, rectified to the mirror grid",
                "fourier": "images of pinhole cameras, rotated and centred by Fourier transforms, as for methods A "
                "and O1 in the paper",
            },
            dimension="image_level",
            title="type of images",
        ),
    ] = "mirror_grid"
    supersampling: Annotated[
        int | Sweep,
        Quantity("Number of rays along each side of a camera pixel; not used with images: mirror_grid", "1", ge=1,
                 le=15, integer=True, title="rays along each side of a camera pixel"),
    ] = 3  # fmt: skip
    threshold: Annotated[
        float | Sweep,
        Quantity("Minimum brightness of a lit camera, relative to the sun's centre", "1", gt=0, lt=1,
                 title="minimum brightness of a lit camera"),
    ] = 0.3  # fmt: skip
    seed: Annotated[
        int | Sweep,
        _seed(
            "Seed of the camera noise and camera gains",
            "camera_seed",
            "seed of the camera noise",
        ),
    ] = 0


class Defects(Block):
    """Defects of a simulated heliostat."""

    canting: Annotated[
        dict[str, Annotated[Two, Numbers("Canting", "mrad", ("horizontal", "vertical"), ge=-100, le=100)]],
        Field(
            description=("Canting of modules, by module number (counted from 1): [horizontal, vertical] slope in mrad")
        ),
    ] = Field(default_factory=dict)
    canting_scale: Annotated[
        float | Sweep,
        Quantity("Factor applied to the canting of all modules", "1", ge=-100, le=100, title="canting factor"),
    ] = 1.0
    waviness: Annotated[
        float | Sweep,
        Quantity("Root mean square slope of a random waviness", "mrad", ge=0, le=50,
                 title="root mean square slope of the simulated waviness"),
    ] = 0.0  # fmt: skip
    waviness_length: Annotated[
        float | Sweep, Quantity("Wavelength of the waviness", "m", gt=0, title="wavelength of the simulated waviness")
    ] = 1.0
    pointing: Annotated[
        Two, Numbers("Pointing error of the whole heliostat", "mrad", ("horizontal", "vertical"), ge=-100, le=100)
    ] = (0.0, 0.0)
    focal_length: Annotated[
        float | Sweep | None,
        Quantity("Actual focal length of the heliostat (default: the ideal focal length)", "m", gt=0,
                 dimension="true_focal_length", title="actual focal length of the heliostat"),
    ] = None  # fmt: skip
    curvature: Annotated[
        dict[str, Annotated[tuple[float, float, float],
                            Numbers("Curvature", ("m", "m", "deg"), ("first focal length", "second", "axis"))]] | None,
        Field(description=("Curvature of modules, by module number (counted from 1): two principal focal lengths in m, "
                          "and the direction of the first in deg, upwards from horizontal as seen from the target; "
                          "modules without an entry have focal_length in both directions")),
    ] = None  # fmt: skip
    seed: Annotated[int | Sweep, _seed("Seed of the waviness", "defect_seed", "seed of the simulated waviness")] = 0

    def rules(self) -> Iterator[Fault]:
        """Check the magnitude of each focal length. Convex mirrors have negative focal lengths."""
        for number, (*lengths, _) in (self.curvature or {}).items():
            if min(map(abs, lengths)) < 10.0:
                yield Fault("focal lengths must be at least 10 m, or at most -10 m", ("curvature", number))


class ProfileNoise(Block):
    """Noisy table of the sun profile, used if ``sun_profile`` is ``noisy``."""

    noise: Annotated[
        float | Sweep,
        Quantity((
            "Standard deviation of the noise at each node, relative to the brightness of the sun's centre"
        ), "1", ge=0, le=1,
                 dimension="profile_noise", title="noise of the sun profile relative to its central brightness"),
    ] = 0.012  # fmt: skip
    nodes: Annotated[
        int | Sweep,
        Quantity((
            "Number of nodes in the profile table, equally spaced from the centre to the edge"
        ), "1", ge=4, le=4096, integer=True,
                 title="number of nodes in the sun's profile"),
    ] = 120  # fmt: skip
    seed: Annotated[
        int | Sweep, _seed("Seed of the noise", "profile_seed", "seed of the noise of the sun's profile")
    ] = 0


class HeliostatField(Block):
    """Field of heliostats that cameras on a tower observe during one day."""

    latitude: Annotated[
        float | Sweep,
        Quantity("Geographic latitude, positive north", "deg", ge=-90, le=90, title="latitude",
                 standard_name="latitude"),
    ]  # fmt: skip
    day: Annotated[
        int | Sweep, Quantity("Day of the year, used for the declination by Cooper's formula", "1", ge=1, le=366,
                              integer=True, title="day of the year")
    ]  # fmt: skip
    hours: Annotated[Sweep, Samples("Solar hours; 12 is solar noon", "h", ge=0, le=24, title="solar hour")]
    layout: Annotated[Layout, Field(description="Layout of the field")]
    receiver_height: Annotated[
        float | Sweep, Quantity("Height of the target's centre above the tower's base", "m", gt=0,
                                title="height of the target's centre")
    ]  # fmt: skip
    pivot_height: Annotated[
        float | Sweep, Quantity("Height of the mirror centres above the heliostat bases", "m", ge=0,
                                title="height of the mirror centres above the heliostat bases")
    ] = 0.0  # fmt: skip
    facing: Annotated[
        str | Sweep,
        Choice(
            "Direction that the target faces",
            {
                "heliostat": "the target is rotated about the vertical to face each heliostat",
                "fixed": "the target has a fixed direction; heliostats behind it are not visible",
            },
            title="direction that the target faces",
        ),
    ] = "heliostat"


class Output(StoredOutput):
    """Stored variables and their format. These settings do not affect the identity of a study."""

    maps: Annotated[bool, Flag("Also store the images, the slope maps and the sun profile")] = False
    raw_slopes: Annotated[
        bool, Flag("Also store maps of the estimated slopes with and without the defects; requires maps")
    ] = False


def _said(description: str, unit: str = "1", **bounds: float) -> Quantity:
    return Quantity(description, unit, sweep=False, **bounds)  # type: ignore[arg-type]  # the bounds are numbers


#: Image metadata, by key. Values in the study have priority over metadata.
METADATA = {
    "FOCALPIX": _said("Focal length of the camera divided by the side of a pixel", ge=10, le=1e7),
    "CENTREU": _said("Column of the line of sight, 0 at the centre of the leftmost pixels", ge=-1e5, le=1e5),
    "CENTREV": _said("Row of the line of sight, 0 at the centre of the top pixels", ge=-1e5, le=1e5),
    "ROLL": _said(
        "Rotation of the camera about its line of sight, clockwise for an observer behind the camera",
        "deg",
        ge=-360,
        le=360,
    ),
    "CAMERAY": _said(
        "Position of the camera in the target plane, positive to the east for a target that faces north",
        "m",
        ge=-1e3,
        le=1e3,
    ),
    "CAMERAZ": _said("Position of the camera in the target plane, positive upwards", "m", ge=-1e3, le=1e3),
    "DARK": _said("Level of an unlit pixel"),
    "WHITE": _said("Level of the sun's centre seen in the mirror, including the dark level"),
    "SATURATE": _said("Level from which a pixel counts as saturated", gt=0),
    "SUNAZ": _said("Azimuth of the sun, from south towards east", "deg", ge=-360, le=360),
    "SUNEL": _said("Elevation of the sun", "deg", gt=0, le=90),
    "TARGETAZ": _said("Azimuth of the target seen from the heliostat, from south towards east", "deg", ge=-360, le=360),
    "TARGETEL": _said("Elevation of the target seen from the heliostat", "deg", gt=-90, lt=90),
    "DISTANCE": _said("Distance between the centres of the heliostat and the target", "m", gt=0),
    "PIXANGLE": _said("Angular size of a pixel in an image of the sun", "mrad", gt=0),
}
Metadata: Any = create_model(  # type: ignore[call-overload]  # the types of fields are expressions
    "Metadata", __base__=Block, __doc__="Image metadata. Values in the study have priority over metadata.",
    **{key: (Annotated[float | None, quantity], None) for key, quantity in METADATA.items()},
)  # fmt: skip


class Image(Block):
    """One of the four measured images."""

    file: Annotated[str, FileName("Heliostat image file (NPY, TIFF, PNG or FITS)", sweep=False)]
    camera: Annotated[
        Two | None,
        Numbers("Position of the camera in the target plane (default: from the image's metadata or 'cameras')",
                "m", ("y", "z")),
    ] = None  # fmt: skip
    corners: Annotated[
        tuple[Two, ...] | None,
        ListOfNumbers("Upper left, upper right, lower right and lower left corners of the heliostat in the image; "
                      "the centre of the first pixel in the file is [0, 0]", "1", ("column", "row"), entries=4),
    ] = None  # fmt: skip
    metadata: Annotated[
        Metadata | None,
        Field(description=("Metadata of the file: FITS cards, PNG text chunks, or lines 'KEY = value' in the "
                          "ImageDescription of a TIFF; NPY has no metadata. Values in the study have priority")),
    ] = None  # fmt: skip


ImageEntry = Annotated[
    Image,
    BeforeValidator(lambda raw: {"file": raw} if isinstance(raw, str) else raw, json_schema_input_type=str | Image),
]


class ImageGeometry(Block):
    """Settings for the grey levels and the grid of measured images."""

    rectified: Annotated[
        bool | None,
        Flag("True if the images are on the mirror grid, top row first (default: true if the images have the "
             "size of this grid and neither corners nor FOCALPIX is given)"),
    ] = None  # fmt: skip
    registration: Annotated[
        bool | None,
        Flag("True to determine the shift, rotation and scale of the images from the module edges (default: "
             "true if neither corners nor FOCALPIX is given); corners have priority"),
    ] = None  # fmt: skip
    dark: Annotated[
        float | None, Quantity("Level of an unlit pixel (default: from metadata, otherwise 0)", "1", sweep=False)
    ] = None
    white: Annotated[
        float | None,
        Quantity("Level of the sun's centre seen in the mirror (default: from metadata, otherwise from the sun's "
                 "image or the brightest pixels)",
                 "1", gt=0, sweep=False),
    ] = None  # fmt: skip
    saturation: Annotated[
        float | None,
        Quantity("Level from which a pixel counts as saturated (default: from metadata, otherwise the maximum of "
                 "the file's data type)",
                 "1", gt=0, sweep=False),
    ] = None  # fmt: skip
    noise: Annotated[
        float | None,
        Quantity((
            "Standard deviation of the pixel noise, relative to the brightness of the sun's centre (default: "
            "estimated from the residuals)"
        ),
                 "1", ge=0, sweep=False),
    ] = None  # fmt: skip
