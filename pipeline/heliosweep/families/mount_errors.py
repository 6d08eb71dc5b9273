"""Study keys and random draws of the six mount errors, shared by several families.

A draw depends only on the seed, the stream, the heliostat and the sample. The counter-based generator Philox 4x64 [1]_
uses the key (seed, stream) and a separate counter for each heliostat. A draw therefore does not depend on the chunks,
the scheduler, or the numbers of heliostats and samples. For example, 10 samples equal the first 10 of 1000 samples.

References
----------
.. [1] J. K. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC11 (2011), doi 10.1145/2063384.2063405
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, TypeAlias

import numpy as np
from numpy.random import Philox
from numpy.typing import ArrayLike, NDArray

from heliosweep.config import NORMAL, Block, Distribution, Quantity, Sweep, Uncertain
from heliosweep.kernels.mounts import ERRORS

#: Message for a key that has an effect only if errors are drawn.
NOT_DRAWN = "needs drawn errors: remove it, or draw an error, such as {normal: [0, 1]}"


def _angle(description: str, title: str) -> Uncertain:
    return Uncertain(description, "mrad", ge=-500, le=500, title=title)


Angle: TypeAlias = float | Sweep | Distribution


class MountAngles(Block):
    """The six errors of a mount. Each error is fixed, swept, or drawn from a distribution."""

    azimuth_reference: Annotated[
        Angle,
        _angle(
            "Offset of the primary encoder's zero, positive clockwise seen from the end of the primary axis",
            "azimuth reference error",
        ),
    ] = 0.0
    elevation_reference: Annotated[
        Angle, _angle("Offset of the secondary encoder's zero, positive upwards", "elevation reference error")
    ] = 0.0
    tilt_about_east: Annotated[
        Angle, _angle("Tilt of the primary axis about the first axis of the mount's frame (east)", "tilt about east")
    ] = 0.0
    tilt_about_north: Annotated[
        Angle, _angle("Tilt of the primary axis about the second axis of the mount's frame (north)", "tilt about north")
    ] = 0.0
    non_orthogonality: Annotated[
        Angle, _angle("Angle between the secondary axis and the plane normal to the primary axis", "non-orthogonality")
    ] = 0.0
    collimation: Annotated[
        Angle,
        _angle("Angle between the mirror's normal and the plane normal to the secondary axis", "collimation error"),
    ] = 0.0
    scale: Annotated[
        float | Sweep,
        Quantity(
            "Factor applied to the deviations of all drawn errors from their means",
            "1", ge=0, dimension="error_scale", title="factor for the deviations of drawn errors from their means",
        ),
    ] = 1.0  # fmt: skip

    def errors(self) -> tuple[float | Sweep | Distribution, ...]:
        """Return the six errors in the order that the kernels expect. [mrad]"""
        return tuple(getattr(self, name) for name in ERRORS)

    def drawn(self) -> dict[str, Distribution]:
        """Return a mapping of names to distributions for the drawn errors."""
        return {name: error for name in ERRORS if isinstance(error := getattr(self, name), Distribution)}


def standard_uniforms(
    seed: int, stream: int, heliostats: ArrayLike, samples: int, first: int = 0
) -> NDArray[np.float64]:
    """Return uniform draws from the open interval (0, 1), shape (H, samples).

    Draws are odd multiples of 2^-53 and symmetric about 1/2. The draws depend on `seed` and `stream`, both from 0 to
    2^63 - 1, and on the heliostat numbers, counted from 0. For mount errors, the stream is the index of the error.
    `first` is the index of the first sample.
    """
    batch, skip = divmod(first, 4)  # the generator returns four numbers for each counter value
    key, numbers = np.array([seed, stream], np.uint64), np.asarray(heliostats, np.int64).ravel()
    counters = (np.array([batch, 0, number, 0], np.uint64) for number in numbers)
    bits = [Philox(key=key, counter=counter).random_raw(skip + samples)[skip:] for counter in counters]
    # Adding one half to 52 random bits gives exact values that are symmetric about 1/2 and never 0 or 1.
    return ((np.reshape(bits, (-1, samples)).astype(np.uint64) >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52


def standard_normals(
    seed: int, stream: int, heliostats: ArrayLike, samples: int, first: int = 0
) -> NDArray[np.float64]:
    """Return standard normal draws between -8.3 and 8.3, computed by inversion.

    The arguments and the shape of the result are the same as for `standard_uniforms`.
    """
    from scipy.special import ndtri  # slow import (0.2 s), needed only for draws

    return np.asarray(ndtri(standard_uniforms(seed, stream, heliostats, samples, first)))


def standard_deviates(errors: Sequence[object], heliostats: ArrayLike, samples: int, seed: int) -> NDArray[np.float64]:
    """Return standard normal or uniform (-1 to 1) deviates of E errors, shape (H, samples, E).

    The value of an error is ``error.mean + error.width * deviate``. Deviates are 0 for errors that are not drawn. Draws
    of error i use stream i. `seed` applies to distributions without a seed, and `samples` overrides the number of
    samples of each distribution.
    """
    result = np.zeros((np.size(heliostats), samples, len(errors)))
    for stream, error in enumerate(errors):
        if isinstance(error, Distribution):
            which = seed if error.seed is None else error.seed, stream, heliostats, samples
            result[..., stream] = (
                standard_normals(*which) if error.kind == NORMAL else 2.0 * standard_uniforms(*which) - 1.0
            )
    return result


def widths_of(errors: Sequence[object]) -> NDArray[np.float64]:
    """Return the factor that scales the deviates of each error, shape (E,); 0 for errors that are not drawn."""
    return np.array([getattr(error, "width", 0.0) for error in errors])
