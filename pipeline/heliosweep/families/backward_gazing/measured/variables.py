"""The variables of measured images: names, CF attributes and what each means, in the order of the file.

Those that simulations have too are called as there, and mean the same.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from heliosweep.families.backward_gazing.shared import (
    BOUND,
    ESTIMATES,
    MASK,
    OF_METHOD,
    PLANE,
    QUALITY,
    SCENE,
    SIGHT,
    both,
    part,
    quality,
    quantity,
    swept,
)

if TYPE_CHECKING:
    from heliosweep.families.backward_gazing.study import BackwardGazingStudy
    from heliosweep.grid.regions import Variable

#: Bits of `quality` beyond those of simulations.
NOT_A_NUMBER, OUT_OF_FRAME = 32, 64

MEASURED = {
    **ESTIMATES,
    **SIGHT,
    **both(
        "cramer_rao_bound_%",
        ("module",),
        "mrad",
        BOUND,
        "root mean square of the slope uncertainty over the eroded module",
    ),
    "lit_fraction": part(
        ("camera",),
        "part of the mirror's pixels in which a camera sees the sun",
        "of those that are not at the edge of a module",
    ),
    "saturated_fraction": part(
        ("camera",), "part of the mirror's pixels in which an image is saturated", "these are not used"
    ),
    "white_level": quantity(("camera",), "1", "level of the sun's centre, the dark level included"),
    "pixel_noise": quantity(
        (),
        "1",
        "standard deviation of a pixel of the images relative to the sun's centre",
        "as the study states it, or from the median of the squared residuals of LM",
    ),
    "gain": quantity((), "1", "median over the pixels of the gain that LM finds", "1 where no gain is fitted"),
    **SCENE,
    "image": quantity(
        ("camera", *PLANE),
        "1",
        "brightness relative to the sun's centre",
        "put on the grid of the mirror; missing between modules, and where a pixel cannot be used",
    ),
    **both(
        "slope_%",
        (*OF_METHOD, *PLANE),
        "mrad",
        "% slope of the mirror relative to the ideal heliostat",
        "missing where fewer than three cameras are lit and usable; of O2 and LM the same for every referential, which "
        "they do not need",
    ),
    **both(
        "slope_uncertainty_%",
        PLANE,
        "mrad",
        "standard uncertainty of the % slope of a pixel",
        "of the slopes of LM, also where other methods are asked for: from the noise of the images alone, by the "
        "derivatives at the slopes that LM finds; an error of the sun's "
        "profile, of the geometry, or of one camera's gain against another's does not show in it (the last shifts all "
        "slopes alike, as a pointing error would)",
    ),
    "residual_rms": quantity(
        (*OF_METHOD, *PLANE),
        "1",
        "root mean square over the lit cameras of the brightness seen less that of the slopes found",
    ),
    "mask": MASK,
    "quality": quality(
        {**QUALITY, NOT_A_NUMBER: "not_a_number", OUT_OF_FRAME: "out_of_frame"},
        "a camera that is saturated, not a number, out of frame, at an edge or at the limb of the disc is left out at "
        "the pixel",
    ),
}


def variables(study: BackwardGazingStudy) -> dict[str, Variable]:
    """Variables of a study's result."""
    return swept(study, MEASURED)
