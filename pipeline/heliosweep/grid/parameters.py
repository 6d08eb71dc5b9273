"""Parameter grid: each key of a study as a labelled array over the full grid or a region."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from heliosweep.config import SAMPLE, Drawn, FileName, NamedSite, Parameter, Study, declares, site_table
from heliosweep.errors import Problem, StudyError
from heliosweep.lazy import xr

#: CF (UDUNITS) spelling of units that study files spell differently, by unit or standard name.
CF_UNITS = {"deg": "degree", "latitude": "degrees_north", "longitude": "degrees_east"}


class Parameters:
    """Values of each study key over a region of the result.

    `select` contains the slices of the limited dimensions; other dimensions have their full length.

    `sizes` contains the length of each swept dimension within the region, in the order of the result.
    """

    def __init__(self, study: Study, select: Mapping[str, slice] | None = None) -> None:
        self.study = study
        self._select = dict(select or {})
        self._declared = {key: (parameter, value) for key, parameter, value in study.parameters()}
        dimensions = study.dimensions()
        self._dims = {key: dim.name for dim in dimensions for key in dim.sweeps}
        self._sites = site_table(study)
        lengths = {"site": len(self._sites)} if self._sites else {}
        lengths |= {dim.name: len(dim) for dim in dimensions}
        self.sizes = {dim: len(range(length)[self.part(dim)]) for dim, length in lengths.items()}

    @property
    def site_dims(self) -> tuple[str, ...]:
        """Swept dimensions that affect the site or the sun direction."""
        swept = {dim for key, dim in self._dims.items() if key.startswith(("site.", "time.", "weather.file"))}
        return tuple(dim for dim in self.sizes if dim in swept or dim == "site")

    def part(self, dim: str) -> slice:
        """Return the slice of a dimension within the region."""
        return self._select.get(dim, slice(None))

    def has(self, key: str) -> bool:
        """Return True if the study has a value for this key."""
        if key in self._declared:
            return True
        block, _, name = key.partition(".")
        return block == "site" and any(getattr(site, name) is not None for site in self._sites)

    def parameter(self, key: str) -> xr.DataArray:
        """Return the values of one key as a scalar array, or as an array along the dimension of a swept key.

        Parameters
        ----------
        key : str
            Dotted key, for instance ``receiver.height``.

        Returns
        -------
        xarray.DataArray
            Values in the canonical unit of the study file, with CF attributes.

        Raises
        ------
        KeyError
            If the key has no value in the study.
        """
        dims, values = self.column(key)
        known = self._declared.get(key)
        declaration = known[0] if known else NamedSite.parameter(key.removeprefix("site."))
        assert declaration is not None
        return xr.DataArray(values, dims=dims or None, attrs=coordinate_attributes(declaration, key))

    def column(self, key: str) -> tuple[tuple[str, ...], Any]:
        """Return the dimension of a key (if swept) and its values. Raises KeyError.

        If the study has several sites, the values of site keys are along the ``site`` dimension.
        """
        if key in self._dims:
            values = self._declared[key][1][self.part(self._dims[key])]
            if isinstance(self._declared[key][0], FileName):
                values = tuple(PurePath(name).name for name in values)  # results contain file names without folders
            return (self._dims[key],), np.array(values, dtype=object if isinstance(values, tuple) else float)
        if key in self._declared:
            return (), self._declared[key][1]
        block, _, name = key.partition(".")
        if block != "site" or not self._sites:
            raise KeyError(key)
        given = (getattr(site, name) for site in self._sites[self.part("site")])
        return ("site",), np.array([np.nan if value is None else value for value in given])

    def values(self, key: str) -> np.ndarray | None:
        """Return the values of one key over all swept dimensions of the region, or None if the key has no value."""
        if not self.has(key):
            return None
        dims, values = self.column(key)
        index = tuple(slice(None) if dim in dims else np.newaxis for dim in self.sizes)
        return np.broadcast_to(np.asarray(values)[(*index, ...)], tuple(self.sizes.values()))

    def points(self, *keys: str) -> Iterator[tuple[tuple[int, ...], tuple[Any, ...]]]:
        """Yield the index and the key values of each point in the region, in the order of the result.

        The index is counted from the start of the region. A value is None if the key has no value, or if it is a site
        or time key that the family does not have. Raises StudyError if the study model does not declare a key.
        """
        for key in keys:
            if not key.startswith(("site.", "time.")) and not declares(type(self.study), key):
                raise StudyError(Problem("is not a key of the study's model", key))
        columns = [self.values(key) for key in keys]
        for index in np.ndindex(tuple(self.sizes.values())):
            yield index, tuple(None if column is None else column[index] for column in columns)

    def position(self, index: tuple[int, ...]) -> dict[str, int]:
        """Return the index of a point along each swept dimension of the full result."""
        return {dim: (self.part(dim).start or 0) + at for dim, at in zip(self.sizes, index, strict=True)}

    def timezones(self) -> list[str]:
        """Return the time zone of each site in the region. A time zone in the ``time`` block applies to all sites."""
        shared: str | None = getattr(self.study, "time").timezone  # noqa: B009
        sites = self._sites[self.part("site")] or (getattr(self.study, "site"),)  # noqa: B009
        return [shared or site.timezone or "+00:00" for site in sites]

    def coordinates(self, keys: Sequence[str] = ()) -> dict[str, xr.DataArray]:
        """Return coordinates for all swept keys, and for each key in `keys` that has a value.

        Values of fixed keys become scalar coordinates.
        """
        wanted = [*(key for key in keys if self.has(key) and key not in self._dims), *self._dims]
        named = {}
        if self._sites:
            names = np.array([site.name for site in self._sites[self.part("site")]], dtype=object)
            named["site"] = xr.DataArray(names, dims="site", attrs={"long_name": "name of the site"})
        if SAMPLE in self.sizes:
            numbers = np.arange(len(self.study.dimensions()[-1]))[self.part(SAMPLE)]
            attrs = {"long_name": "number of the draw, counted from 0", "units": "1"}
            named[SAMPLE] = xr.DataArray(numbers, dims=SAMPLE, attrs=attrs)
        for key in wanted:
            declared, value = self._declared.get(key, (None, None))
            name = coordinate_name(declared, key) if declared else key.rpartition(".")[2]
            named[name] = self.parameter(key)
            if isinstance(value, Drawn):
                named[name] = named[name].assign_attrs(key=key, distribution=value.words())
        return named


def coordinate_name(declaration: Parameter, key: str) -> str:
    """Return the name of a key as a dimension or coordinate: the declared name, otherwise the last part of the key."""
    return declaration.dimension or key.rpartition(".")[2]


def coordinate_attributes(declaration: Parameter, key: str) -> dict[str, Any]:
    """Return the CF attributes of a key: long name, units and, if CF defines one, the standard name."""
    attrs = {"long_name": declaration.title or coordinate_name(declaration, key).replace("_", " ")}
    unit = getattr(declaration, "unit", None)
    if unit is not None:
        attrs["units"] = CF_UNITS.get(declaration.standard_name) or CF_UNITS.get(unit, unit)
    if declaration.standard_name:
        attrs["standard_name"] = declaration.standard_name
    else:
        # The comment explains named values. For numbers, the comment omits the unit, which is a separate attribute.
        meaning = declaration.description if unit else declaration.purpose
        if meaning.casefold() != attrs["long_name"].casefold():
            attrs["comment"] = meaning if meaning[:2].isupper() else meaning[:1].lower() + meaning[1:]
    return attrs
