"""The parameter points of a region as the kernels take them: receiver, mount, pivots and sun."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from heliosweep.families.misalignment.blocks import MOUNTS
from heliosweep.families.misalignment.instants import DayHours, day_hours, instant_attributes, sun_of
from heliosweep.grid.layout_axis import LayoutAxis, longest
from heliosweep.grid.parameters import Parameters
from heliosweep.kernels.spots.receiver import Setting
from heliosweep.layouts.layout import Layout
from heliosweep.layouts.resolve import Layouts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from heliosweep.families.misalignment.study import MisalignmentStudy
    from heliosweep.grid.regions import Region, Variable

#: Keys that label a result also where they are not swept.
LABELS = (
    *("site.latitude", "site.longitude", "sun.azimuth", "sun.elevation"),
    *(f"receiver.{key}" for key in ("azimuth", "tilt", "width", "height_extent", "height")),
    *(f"mount.{key}" for key in ("kind", "axis_azimuth", "mirror_offset", "axis_offset", "pedestal_height")),
    "heliostats.pivot_height",
)
_POSITIONS = {
    "x": "distance of the pivot east of the tower",
    "y": "distance of the pivot north of the tower",
    "z": "height of the pivot above the tower's base",
}


class Positions(LayoutAxis):
    """Pivots at the positions of a study, as one layout.

    Parameters
    ----------
    positions : sequence of three floats each
        East, north and up of the tower's base. [m]
    """

    def __init__(self, positions: Sequence[tuple[float, float, float]]) -> None:
        self.dims, self._shape, self.size = (), (), len(positions)
        self._layouts = [Layout(*np.array(positions, np.float64).T)]

    def coordinates(self) -> dict[str, xr.DataArray]:
        """``heliostat``, ``x``, ``y`` and ``z``."""
        number = "number of the heliostat: its place among the positions, from 0"
        labels = {"heliostat": self.numbers.assign_attrs(long_name=number)}
        for name, meaning in _POSITIONS.items():
            labels[name] = self.column(name).assign_attrs(long_name=meaning, units="m")
        return labels


def places_of(study: MisalignmentStudy) -> LayoutAxis:
    """Layouts of a study, or its positions."""
    return LayoutAxis(study) if study.layout is not None else Positions(study.heliostats.positions or ())


def heliostat_count(study: MisalignmentStudy) -> int:
    """Heliostats of the longest layout of a study, without making more layouts than that takes."""
    return longest(study) if study.layout is not None else len(study.heliostats.positions or ())


def place_bytes(study: MisalignmentStudy) -> int:
    """Size of the coordinates of the heliostats. [bytes]."""
    return 8 * heliostat_count(study) * (4 if study.layout is None else 6 * len(Layouts(study)))


def coordinates_of(study: MisalignmentStudy, keys: Sequence[str] = ()) -> xr.Dataset:
    """Coordinates that the results of all modes have, and what a result says of its sun, as attributes.

    Parameters
    ----------
    study : MisalignmentStudy
        Checked study.
    keys : sequence of str
        Dotted keys that label the result besides `LABELS`.
    """
    parameters = Parameters(study)
    labels = {
        **parameters.coordinates((*LABELS, *keys)),
        **places_of(study).coordinates(),
        **day_hours(parameters).labels,
    }
    return xr.Dataset(coords=labels, attrs=instant_attributes(study))


class Points(NamedTuple):
    """P parameter points, H heliostats and T instants of a region."""

    parameters: Parameters
    """The region."""
    setting: Setting
    """Receiver and mount, shape (P,)."""
    sun: NDArray[np.float64]
    """Unit vectors towards the sun, shape (P or 1, T, 3)."""
    pivots: NDArray[np.float64]
    """Pivots relative to the tower's base, shape (P, H, 3); NaN where a shorter layout is padded. [m]"""
    numbers: NDArray[np.int64]
    """Numbers of the heliostats in the whole result, shape (H,)."""
    instants: DayHours
    """The instants, day by day."""

    @classmethod
    def of(cls, study: MisalignmentStudy, places: LayoutAxis, region: Region) -> Points:
        """Points of a region along swept dimensions and ``heliostat``."""
        parameters = Parameters(study, region)
        instants = day_hours(parameters)
        span = range(places.size)[region.get("heliostat", slice(None))]
        sun, pivots = sun_of(parameters, instants), _pivots(parameters, places, span)
        return cls(parameters, _setting(parameters), sun, pivots, np.arange(span.start, span.stop), instants)

    def values(self, key: str) -> NDArray[Any]:
        """Values of a key that the study gives, shape (P,)."""
        return _values(self.parameters, key)

    def only(self, some: NDArray[np.int64]) -> Points:
        """Some of the points, by their numbers."""
        setting = Setting(*(values[some] for values in self.setting))  # type: ignore[arg-type]
        sun = self.sun if len(self.sun) == 1 else self.sun[some]
        return self._replace(setting=setting, sun=sun, pivots=self.pivots[some])

    @property
    def absent(self) -> NDArray[np.bool_]:
        """True where a shorter layout has no heliostat, shape (P, H)."""
        return np.isnan(self.pivots[..., 0])

    def labelled(
        self, variables: Mapping[str, Variable], values: Mapping[str, NDArray[Any]], **inner: int
    ) -> dict[str, tuple[tuple[str, ...], NDArray[Any]]]:
        """Arrays of the kernels as variables of the region.

        Parameters
        ----------
        variables : mapping of str to Variable
            Variables of the result.
        values : mapping of str to ndarray
            Numbers of some of them, in the order of their dimensions; the swept ones and the instants may be joined.
        **inner : int
            Lengths of the dimensions beside the swept ones, the heliostats and the instants.
        """
        lengths = {**self.parameters.sizes, "heliostat": self.numbers.size, **self.instants.sizes, **inner}
        found = {}
        for name, array in values.items():
            dims = variables[name].dims
            shape = [lengths[dim] for dim in dims]
            found[name] = dims, np.reshape(array, shape).astype(variables[name].dtype, copy=False)
        return found


def codes_of(names: NDArray[Any], known: Mapping[str, str]) -> NDArray[np.int64]:
    """Numbers by which the kernels know names: their places in a table of `blocks`."""
    codes = {name: code for code, name in enumerate(known)}
    return np.array([codes[str(name)] for name in names], np.int64)


def _values(parameters: Parameters, key: str, default: float | None = None) -> NDArray[Any]:
    """Values of a key at every point, shape (P,), contiguous; a default where the study gives it no value."""
    values = parameters.values(key)
    if values is None:
        if default is None:
            raise KeyError(key)
        values = np.broadcast_to(default, tuple(parameters.sizes.values()))
    return np.array(values).reshape(-1)


def _setting(parameters: Parameters) -> Setting:
    """Receiver and mount of every point."""

    def each(key: str) -> NDArray[np.float64]:
        return _values(parameters, key)

    return Setting(
        np.radians(each("receiver.azimuth")),
        np.radians(each("receiver.tilt")),
        0.5 * each("receiver.width"),
        0.5 * each("receiver.height_extent"),
        each("receiver.height"),
        codes_of(each("mount.kind"), MOUNTS),
        np.radians(_values(parameters, "site.latitude", 0.0)),
        np.radians(each("mount.axis_azimuth")),
        *(each(f"mount.{key}") for key in ("mirror_offset", "axis_offset", "pedestal_height")),
    )


def _pivots(parameters: Parameters, places: LayoutAxis, span: range) -> NDArray[np.float64]:
    """Pivots of some of the heliostats at every point, shape (P, H, 3). [m]"""
    shape = tuple(length if dim in places.dims else 1 for dim, length in parameters.sizes.items())
    bases = np.full((*shape, len(span), 3), np.nan)
    for index in np.ndindex(shape):
        layout = places.at(parameters.position(index))
        here = slice(span.start, min(span.stop, len(layout)))
        if here.start < here.stop:
            columns = [column[here] for column in (layout.x, layout.y, layout.z)]
            bases[index][: here.stop - here.start] = np.stack(columns, axis=-1)
    height = _values(parameters, "heliostats.pivot_height", 0.0)
    pivots = np.array(np.broadcast_to(bases, (*parameters.sizes.values(), len(span), 3))).reshape(-1, len(span), 3)
    pivots[..., 2] += height[:, np.newaxis]
    return pivots
