"""Cosine, shading and blocking efficiencies of a heliostat field with flat rectangular mirrors.

Coordinates are x east, y north and z up [m]. Azimuths run clockwise from north [deg].
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from heliosweep.kernels.field.efficiency import field_series, sorted_field
from heliosweep.lazy import xr
from heliosweep.light import (
    TRACKING,
    check_tower,
    heliostat_coordinates,
    mirror_centres,
    per_item,
    sun_directions,
)

_NAMES = {
    "cosine_efficiency": "cosine of the angle of incidence",
    "shading_efficiency": "fraction of the mirror that is not shaded",
    "blocking_efficiency": "fraction of the mirror that is not blocked",
    "optical_efficiency": "cosine times the fraction that is neither shaded nor blocked",
}


def field_efficiency(
    layout: Any, sun_azimuth: ArrayLike, sun_elevation: ArrayLike, *, width: ArrayLike, height: ArrayLike,
    aim: ArrayLike, tracking: str = "azimuth_elevation", tower: tuple[float, float] | None = None,
) -> xr.Dataset:  # fmt: skip
    """Compute the cosine, shading and blocking efficiencies of each heliostat in a field.

    Shaded and blocked areas are computed exactly. All other mirrors are projected onto each mirror, along the sun's
    rays for shading and along the ray to the aim point for blocking. The lost area is the area of the union of all
    projections. If a tower is given, its shadow is added to the union as another polygon.

    Parameters
    ----------
    layout : array, DataFrame, Dataset or mapping
        Mirror centres, as an array of shape (N, 3) or a table with columns x, y and z. [m]
    sun_azimuth, sun_elevation : float, array or DataArray, shape (T,)
        Azimuth and elevation of the sun. [deg]
    width, height : float or array, shape (N,)
        Width and height of the mirrors. [m]
    aim : float or array, shape (3,) or (N, 3)
        Aim points, or the height of a common aim point at x = y = 0. [m]
    tracking : {'azimuth_elevation', 'spinning_elevation'}
        Tracking method. The width of each mirror is horizontal ('azimuth_elevation'), or perpendicular to the plane
        through the mirror centre, the sun and the aim point ('spinning_elevation').
    tower : (float, float), optional
        Radius and top height of a tower that stands at x = y = 0 and casts a shadow. The shadow has a straight end and
        the same area as the shadow of a cylinder. [m]

    Returns
    -------
    xarray.Dataset
        Variables `cosine_efficiency`, `shading_efficiency`, `blocking_efficiency` and `optical_efficiency` with the
        dimensions ``time`` (omitted for a single instant) and ``heliostat``; NaN if the sun is below the horizon. [1]

    Raises
    ------
    ValueError
        If the shapes do not match, the tracking method is unknown, a width or height is not above 0 m, a mirror is at
        its aim point or within the tower, or the radius or top height of the tower is not above 0 m.

    References
    ----------
    Chong and Tan (2012), International Journal of Photoenergy 2012, 908364, doi 10.1155/2012/908364. The page
    docs/families/field_efficiency.md describes how the unions are computed.

    Examples
    --------
    >>> import heliosweep
    >>> field = [(0.0, 60.0, 4.0), (0.0, 70.0, 4.0)]
    >>> found = heliosweep.field_efficiency(field, 180.0, 20.0, width=6.0, height=5.0, aim=30.0)
    >>> found.shading_efficiency.round(3).values.tolist()
    [1.0, 0.684]
    """
    centre = mirror_centres(layout)
    if tracking not in TRACKING:
        raise ValueError(f"`tracking` must be one of {', '.join(TRACKING)} (got {tracking!r})")
    sides = {"width": width, "height": height}
    half = [0.5 * per_item(name, values, (), len(centre)) for name, values in sides.items()]
    if not all((values > 0.0).all() for values in half):
        raise ValueError("`width` and `height` must be above 0 m")
    target = np.array([0.0, 0.0, float(np.asarray(aim))]) if np.ndim(aim) == 0 else aim
    x, y, z = centre.T
    if tower is not None:
        check_tower(tower, centre)
    field = sorted_field(x, y, z, half[0], half[1], per_item("aim", target, (3,), len(centre)), tower)
    sun, dims, coordinates = sun_directions(sun_azimuth, sun_elevation)
    series = field_series(field, TRACKING[tracking], sun, 0, len(centre))

    variables = {
        name: ((*dims, "heliostat"), values if dims else values[0], {"units": "1", "long_name": words})
        for (name, words), values in zip(_NAMES.items(), series, strict=True)
    }
    return xr.Dataset(variables, {**heliostat_coordinates(layout, centre), **coordinates})
