"""Read or generate the layouts of a study, one for each combination of swept keys in the block ``layout``."""

from __future__ import annotations

import csv
import io
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property, lru_cache
from operator import attrgetter
from typing import Any

import numpy as np

from heliosweep.config import GENERATORS, Dimension, Study, Sweep, drawn_keys
from heliosweep.errors import PlanError, Problem, StudyError
from heliosweep.files import read_once
from heliosweep.layouts.ground import AREAS, AT_TOWER, Region, heights_at, read_area, read_heights, slope_heights
from heliosweep.layouts.layout import LAYOUT, NAMED_BY_HELIOSTAT, PROPERTIES, Layout, read_csv, read_text
from heliosweep.layouts.patterns import PATTERNS, Spacing
from heliosweep.lazy import shapely, xr

#: Layout columns that contain mirror sizes.
SIZE_COLUMNS = ("width", "height")
#: Maximum number of sweep points that are checked, and maximum total number of heliostats in these points.
#: Faults of unchecked layouts are reported by the kernels, or do not affect the accuracy.
MAX_POINTS, MAX_HELIOSTATS = 200, 300_000
#: Maximum number of layouts in a sweep, and maximum number that the plan generates to count heliostats.
MAX_LAYOUTS, MAX_MADE = 100_000, 6_000
#: Plant keys that affect the spacing of heliostats if it increases with the distance from the tower.
SPACED_BY = ("receiver.height", "heliostat.pivot_height", "heliostat.width", "heliostat.height")


class Layouts:
    """All layouts of a study, generated or read on demand.

    Parameters
    ----------
    study : Study
        Study with a layout block.
    key : str
        Study key of the layout block.
    """

    def __init__(self, study: Study, key: str = "layout") -> None:
        self._study, self._key, self._reserved = study, key, study.reserved_names()
        self.block: Any = attrgetter(key)(study)
        self._kind = next(kind for kind in (*GENERATORS, "table", "file") if getattr(self.block, kind) is not None)
        self._spaced = self._kind == "radial_stagger" and self.block.radial_stagger.spacing is not None
        self.dimensions: list[Dimension] = [
            dim for dim in study.dimensions() if any(self.depend_on(name) for name in dim.sweeps)
        ]

    def depend_on(self, key: str) -> bool:
        """Return True if the layouts depend on a study key, either in the layout block or through the spacing."""
        return key.startswith(f"{self._key}.") or (self._spaced and key in SPACED_BY)

    @property
    def heliostats(self) -> int | Sweep | None:
        """Number of heliostats specified in the study, or None."""
        return getattr(self.block, self._kind).heliostats if self._kind in GENERATORS else None

    def __getitem__(self, index: tuple[int, ...]) -> Layout:
        """Return the layout at an index along each of `dimensions`.

        Raises
        ------
        StudyError
            If the layout file or the generator parameters are invalid. Each problem refers to a line in the study or
            layout file.
        """
        sweeps = [{key: sweep for key, sweep in dim.sweeps.items() if self.depend_on(key)} for dim in self.dimensions]
        return self.at(values_at(sweeps, index))

    def __iter__(self) -> Iterator[Layout]:
        return map(self.__getitem__, itertools.product(*(range(len(dim)) for dim in self.dimensions)))

    def at(self, values: Mapping[str, Any]) -> Layout:
        """Return the layout for given values of the swept keys; other keys are ignored. Raises StudyError."""

        def of(key: str) -> Any:
            return values.get(f"{self._key}.{key}", attrgetter(key)(self.block))

        file = of("file")
        try:
            if self._kind == "file":
                return self._moved(_read(self._study.resolve(file), self._reserved))
            if self._kind == "table":
                text, columns = io.StringIO(), self.block.table
                csv.writer(text).writerows([columns, *zip(*columns.values(), strict=True)])
                return self._moved(read_text(text.getvalue(), f"{self._key}.table", self._reserved))
            given = {key: of(f"{self._kind}.{key}") for key in type(getattr(self.block, self._kind)).model_fields}
            # Sweeps contain floats.
            given |= {key: int(given[key]) for key in ("rings", "heliostats") if given.get(key) is not None}
            if self._spaced:
                given["spacing"] = self._spacing(given["spacing"], given["inner_radius"], values)
            return self._raised(_generated(self._kind, self._region(values, of), **given), of)
        except StudyError as error:
            raise StudyError([self._located(file, problem) for problem in error.problems]) from None

    def some(self, worst: Mapping[str, Callable[..., Any]] | None = None) -> Iterator[tuple[Layout, dict[str, Any]]]:
        """Yield the layouts to be checked, each with the values of all relevant keys.

        `worst` contains the relevant keys that are not layout keys. Each key has a function (`min` or `max`) that
        selects its worst value. Only the worst value is checked, unless the key is tied to another relevant key. For a
        drawn key, the worst value is the worst possible draw.
        """
        study, worst = self._study, worst or {}
        given = {key: value for key, _, value in study.parameters()}
        drawn = {key: worst[key](value.ends()) for key, value in drawn_keys(study).items() if key in worst}
        sweeps, places = list[Mapping[str, Sweep]](), list[list[int]]()
        for dim in study.dimensions():
            keys = [key for key in dim.sweeps if self.depend_on(key) or (key in worst and key not in drawn)]
            if not keys:
                continue
            sweeps.append(dim.sweeps)
            places.append(np.linspace(0, len(dim) - 1, min(len(dim), MAX_POINTS)).round().astype(int).tolist())
            if len(keys) == 1 and not self.depend_on(keys[0]):
                swept = list(dim.sweeps[keys[0]].values())
                places[-1] = [swept.index(worst[keys[0]](swept))]
        checked = 0
        for index in itertools.islice(itertools.product(*places), MAX_POINTS):
            values = given | values_at(sweeps, index) | drawn
            layout = self.at(values)
            yield layout, values
            checked += len(layout)
            if checked > MAX_HELIOSTATS:
                return

    def _region(self, values: Mapping[str, Any], of: Callable[[str], Any]) -> Region | None:
        sectors = tuple(
            tuple(
                values.get(f"{self._key}.sectors[{number}].{key}", getattr(sector, key)) for key in ("azimuth", "width")
            )
            for number, sector in enumerate(self.block.sectors or ())
        )
        boundary, exclude = (self._area(key, of(key)) for key in AREAS)
        if not sectors and boundary is None and exclude is None:
            return None
        return Region(sectors, boundary, exclude, of("margin") or 0.0)

    def areas(self) -> dict[str, str]:
        """Return the polygons common to all layouts, as WKT in metres, by result attribute."""
        names = {key: getattr(self.block, key) for key in AREAS}
        return {AREAS[key]: self._area(key, name).wkt for key, name in names.items() if isinstance(name, str)}

    def _area(self, key: str, name: str | None) -> Any:
        return None if name is None else read_area(self._study.resolve(name), key, self.block.origin or AT_TOWER)

    def _moved(self, layout: Layout) -> Layout:
        """Return the layout with positions and aim points relative to the tower."""
        if self.block.origin is None:
            return layout
        east, north = self.block.origin
        numbers = {key: values for key, values in layout.columns.items() if values.dtype.kind in "if"}
        aims = {key: numbers[key] - shift for key, shift in (("aim_x", east), ("aim_y", north)) if key in numbers}
        return replace(layout, x=layout.x - east, y=layout.y - north, columns={**layout.columns, **aims})

    def uses(self, layout: Layout) -> list[str]:
        """Return the layout columns that the study uses: properties for which the study has no value."""
        return [name for name in PROPERTIES if name in layout.columns and self._use(name) is None]

    def _use(self, name: str) -> str | None:
        """Return the reason why the study does not use a layout property, or None if the study uses it."""
        wanted = PROPERTIES[name]
        block, _, key = wanted.key.partition(".")
        if "optics" not in type(self._study).model_fields:
            return f"the family {self._study.family_name()} has no such key"
        if wanted.optical and getattr(self._study, "optics", None) is None:
            return "'optics' is not set"
        parent: Any = getattr(self._study, block or "optics")
        given = getattr(parent, key, None) if key else None
        if given == LAYOUT:
            return None
        if block == "aim":
            return "'aim.strategy' is not 'layout'"
        if block and parent is None:
            return f"'{block}' is not set"
        if given is not None:
            return f"'{wanted.key}' applies to all heliostats: remove it to use the column"
        instead = {
            "slope_error": ("slope_map", "slope_error_horizontal", "slope_error_vertical"),
            "cleanliness": ("cleanliness_by_month",),
        }
        others = (other for other in instead.get(name, ()) if getattr(parent, other) is not None)
        return next((f"'optics.{other}' applies to all heliostats" for other in others), None)

    def remarks(self) -> Iterator[str]:
        """Yield warnings about columns that do not affect results, and about ground keys that exclude no heliostat."""
        seen: set[str] = set()
        for layout, values in self.some():
            remarks = list[str]()
            if layout.labels:
                labels = ", ".join(layout.labels)
                remarks.append(f"{layout.name}: results do not depend on the columns {labels}, which are labels")
            if isinstance(name := self.block.exclude, str):
                away = float(shapely.distance(self._area("exclude", name), shapely.points(layout.x, layout.y)).min())
                if away > 1000.0:
                    remarks.append(
                        f"{self._key}.exclude: {name} is {away:,.0f} m from the nearest heliostat and has no effect; "
                        f"for map coordinates set '{self._key}.origin: [east, north]' of the tower"
                    )
            unused: dict[str, list[str]] = {}
            for name in (name for name in PROPERTIES if name in layout.columns):
                given = values.get(PROPERTIES[name].key)
                same = isinstance(given, int | float) and (layout.columns[name] == given).all()
                if (reason := self._use(name)) is not None and not same:
                    unused.setdefault(reason, []).append(name)
            for reason, names in unused.items():
                columns = f"column {names[0]} is" if len(names) == 1 else f"columns {', '.join(names)} are"
                remarks.append(f"{layout.name}: the {columns} not used: {reason}")
            yield from (remark for remark in remarks if remark not in seen)
            seen.update(remarks)

    def _spacing(self, rule: str, inner_radius: float, values: Mapping[str, Any]) -> Spacing:
        given = {key: value for key, _, value in self._study.parameters()} | dict(values)
        missing = [key for key in SPACED_BY if given.get(key) is None]
        receiver, pivot, width, height = (np.nan if missing else float(given[key]) for key in SPACED_BY)
        spacing = Spacing(rule, receiver - pivot, width, height)
        for wrong, key, message in (
            (missing, "spacing",
             f"needs {' and '.join(missing)}, which this study does not set: set them, or remove this key"),
            (spacing.receiver <= height, "spacing",
             f"needs a receiver higher than {pivot + height:g} m, one mirror height above the mirrors' centres"),
            (not spacing.reaches(inner_radius), "inner_radius",
             f"is so large that '{rule}' defines no spacing: move the field closer, or raise the receiver"),
        ):  # fmt: skip
            if wrong:
                raise StudyError(Problem(message, f"radial_stagger.{key}"))
        return spacing

    def _raised(self, layout: Layout, of: Callable[[str], Any]) -> Layout:
        terrain = self.block.terrain
        if terrain is None:
            return layout
        if terrain.file is None:
            z = slope_heights(layout.x, layout.y, of("terrain.slope"), of("terrain.azimuth"))
        else:
            heights = read_heights(self._study.resolve(terrain.file), self.block.origin or AT_TOWER)
            z = heights_at(heights, terrain.file, layout.x, layout.y)
        return replace(layout, z=z + 0.0)

    def _located(self, file: str | None, problem: Problem) -> Problem:
        """Add the study key to a problem, unless the problem refers to a line or only counts other problems."""
        if problem.line or problem.unlisted:
            return problem
        key, start = ("file", f"{file}: ") if file is not None else (problem.key, "")
        return self._study.problem(f"{self._key}.{key}", f"{start}{problem.message}")


def values_at(dimensions: Iterable[Mapping[str, Sweep]], index: Iterable[int]) -> dict[str, Any]:
    """Return the values of the swept keys at an index along each dimension."""
    return {key: sweep[position] for dim, position in zip(dimensions, index, strict=True) for key, sweep in dim.items()}


_read = read_once(8)(read_csv)


@lru_cache(maxsize=8)
def _generated(kind: str, region: Region | None, **given: Any) -> Layout:
    """Generate a layout. Raises StudyError, in which each problem contains its key in the block ``layout``."""
    try:
        return PATTERNS[kind](**given, region=region)
    except StudyError as error:
        raise StudyError(
            problem if problem.key in ("sectors", *AREAS) else replace(problem, key=f"{kind}.{problem.key}")
            for problem in error.problems
        ) from None


_POSITIONS = {
    "x": ("distance of the heliostat east of the tower", "projection_x_coordinate"),
    "y": ("distance of the heliostat north of the tower", "projection_y_coordinate"),
    "z": ("height of the heliostat's base above the tower's base", ""),
}
_COLUMNS = {
    "ring": {"long_name": "ring of the layout, from the tower outwards", "units": "1"},
    "azimuth": {"long_name": "azimuth of the heliostat seen from the tower, clockwise from north", "units": "degree"},
    "width": {"long_name": "mirror width", "units": "m"},
    "height": {"long_name": "mirror height", "units": "m"},
}


class LayoutAxis:
    """All layouts of a study's layout block. Shorter layouts are padded at the end.

    `dims` are the swept dimensions that select a layout. `size` is the number of heliostats in the longest layout.
    """

    def __init__(self, study: Study, key: str = "layout") -> None:
        layouts = _counted(study, key)
        self.dims = tuple(dim.name for dim in layouts.dimensions)
        self._shape = tuple(len(dim) for dim in layouts.dimensions)
        self._layouts = list(layouts)
        self.size = max(map(len, self._layouts))

    def at(self, position: Mapping[str, int]) -> Layout:
        """Return the layout at a point of the result, given the index of the point along each dimension."""
        place = tuple(position[dim] for dim in self.dims)
        return self._layouts[int(np.ravel_multi_index(place, self._shape)) if place else 0]

    def column(self, name: str, padding: object = np.nan) -> xr.DataArray:
        """Return a column of all layouts over `dims` and ``heliostat``."""
        columns = [getattr(one, name) if name in _POSITIONS else one.columns[name] for one in self._layouts]
        is_text = any(column.dtype.kind == "U" for column in columns)
        table = np.array(columns[:1], object if is_text else None)
        if len(columns) > 1:
            table = np.full((len(columns), self.size), padding, object if is_text else float)
            for row, column in zip(table, columns, strict=True):
                row[: len(column)] = column
        return xr.DataArray(table.reshape(*self._shape, self.size), dims=(*self.dims, "heliostat"))

    @cached_property
    def numbers(self) -> xr.DataArray:
        """Heliostat numbers 0, 1, ... along ``heliostat``."""
        attrs = {"long_name": "number of the heliostat: its row in the layout, counted from 0", "units": "1"}
        return xr.DataArray(np.arange(self.size), dims="heliostat", attrs=attrs)

    def coordinates(self) -> dict[str, xr.DataArray]:
        """Return the coordinates ``heliostat``, ``x``, ``y``, ``z`` and the columns common to all layouts."""
        coordinates = {"heliostat": self.numbers}
        for name, (long_name, standard_name) in _POSITIONS.items():
            known = {"standard_name": standard_name} if standard_name else {}
            coordinates[name] = self.column(name).assign_attrs(units="m", long_name=long_name, **known)
        for name in self._layouts[0].columns:
            columns = [layout.columns.get(name) for layout in self._layouts]
            kinds = {None if column is None else column.dtype.kind == "U" for column in columns}
            if len(kinds) == 1 and None not in kinds:
                known = (
                    {"long_name": f"{name.replace('_', ' ')} of the heliostat", "units": PROPERTIES[name].unit}
                    if name in PROPERTIES
                    else {"long_name": f"column {name} of the layout"}
                )
                label = self.column(name, "" if True in kinds else np.nan).assign_attrs(_COLUMNS.get(name, known))
                coordinates[f"heliostat_{name}" if name in NAMED_BY_HELIOSTAT else name] = label
        return coordinates


def longest(study: Study, key: str = "layout") -> int:
    """Return the number of heliostats in the longest layout of a study.

    Raises PlanError if the study sweeps over too many layouts. The message names the longest dimension.
    """
    layouts = _counted(study, key)
    heliostats = layouts.heliostats
    if heliostats is not None:
        return int(max(heliostats.values()) if isinstance(heliostats, Sweep) else heliostats)
    found: dict[str, int] = study.__dict__.setdefault("_longest", {})  # copies of the study do not share this cache
    most = found.get(key) or max(map(len, layouts))
    if all(getattr(layouts.block, name) is None for name in ("file", *AREAS)):  # files may change between calls
        found[key] = most
    return most


def _counted(study: Study, key: str) -> Layouts:
    layouts = Layouts(study, key)
    most = MAX_MADE if layouts.heliostats is None else MAX_LAYOUTS
    number = math.prod(map(len, layouts.dimensions))  # may exceed the maximum of `len`
    if number > most:
        axis = max(layouts.dimensions, key=len)
        remedy = " or give the layout's 'heliostats'" if most == MAX_MADE else ""
        raise PlanError(f"refused: {number:,} layouts are more than {most:,}; shrink '{axis.name}' first{remedy}")
    return layouts


def weighted_mean(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the weighted mean over the last dimension, with a rounding error that does not depend on chunks.

    Values with zero weight, including NaN, are omitted. The mean is NaN if all weights are zero.
    """
    means = np.full(values.shape[:-1], np.nan)
    for index in np.ndindex(means.shape):
        used = weights[index] > 0  # omit zero weights, so that padding does not change the summation order
        if used.any():
            means[index] = np.sum(values[index][used] * weights[index][used]) / np.sum(weights[index][used])
    return means
