"""The layouts that a study names: one, or one for each value of what is swept in its ``layout`` block."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

from heliosweep.config.blocks import RadialStagger
from heliosweep.config.study import Dimension, Study
from heliosweep.errors import StudyError
from heliosweep.layouts.csv import read_csv
from heliosweep.layouts.layout import Layout
from heliosweep.layouts.radial_stagger import Zone, radial_stagger

#: Columns of a layout that are mirror sizes; they stand for ``heliostat.width`` and ``heliostat.height``.
SIZE_COLUMNS = ("width", "height")


class Recipe(NamedTuple):
    """Parameters of `radial_stagger`."""

    clearance: float
    inner_radius: float
    rings: int | None
    heliostats: int | None
    zones: tuple[Zone, ...] | None


class Layouts:
    """All layouts of a study, made when they are asked for.

    Parameters
    ----------
    study : Study
        Study with a block that names layouts.
    reserved : frozenset of str
        Names that columns of a layout file must not have, because the result uses them.
    key : str
        Key of the block.
    """

    def __init__(self, study: Study, reserved: frozenset[str] = frozenset(), key: str = "layout") -> None:
        self._study, self._key = study, key
        self._block: Any = attrgetter(key)(study)
        self._reserved = reserved
        self.dimensions: list[Dimension] = [
            dim for dim in study.dimensions() if any(name.startswith(f"{key}.") for name in dim.sweeps)
        ]

    def __len__(self) -> int:
        count = 1
        for dim in self.dimensions:
            count *= len(dim)
        return count

    def __getitem__(self, index: tuple[int, ...]) -> Layout:
        """Layout at a position along each of `dimensions`.

        Raises
        ------
        StudyError
            Where the file or the generator's parameters are wrong, located in the study or layout file.
        """
        return self.at(values_at(self.dimensions, index))

    def __iter__(self) -> Iterator[Layout]:
        return (self[index] for index in itertools.product(*(range(len(dim)) for dim in self.dimensions)))

    def at(self, values: Mapping[str, Any]) -> Layout:
        """Layout for the values of what is swept, by dotted key; other keys are passed over. Raises StudyError."""
        if self._block.file is not None:
            return self._read(values.get(f"{self._key}.file", self._block.file))
        return self._generate(values)

    def _read(self, name: str) -> Layout:
        path = self._study.resolve(name)
        try:
            stamp = path.stat().st_mtime_ns
        except OSError:
            stamp = None
        try:
            return _read_cached(path, self._reserved, stamp)
        except StudyError as error:
            raise StudyError(
                [
                    problem if problem.line else self._study.problem(f"{self._key}.file", f"{name}: {problem.message}")
                    for problem in error.problems
                ]
            ) from None

    def recipe(self, index: tuple[int, ...]) -> Recipe | None:
        """Parameters from which `generated` makes the layout at a position anew; None for one from a file."""
        if self._block.file is not None:
            return None
        return self._recipe(values_at(self.dimensions, index))

    def _recipe(self, swept: Mapping[str, Any]) -> Recipe:
        block: RadialStagger = self._block.radial_stagger
        given = {
            key: swept.get(f"{self._key}.radial_stagger.{key}", getattr(block, key))
            for key in ("clearance", "inner_radius", "rings", "heliostats")
        }
        rings, heliostats = (None if given[key] is None else int(given[key]) for key in ("rings", "heliostats"))
        zones = None if block.zones is None else tuple(Zone(z.start, z.rings, z.pitch) for z in block.zones)
        return Recipe(given["clearance"], given["inner_radius"], rings, heliostats, zones)

    def _generate(self, swept: Mapping[str, Any]) -> Layout:
        try:
            return generated(self._recipe(swept))
        except StudyError as error:
            raise StudyError(
                [
                    self._study.problem(f"{self._key}.radial_stagger.{problem.key}", problem.message)
                    for problem in error.problems
                ]
            ) from None


def values_at(dimensions: Iterable[Dimension], index: Iterable[int]) -> dict[str, Any]:
    """Values of what is swept, by dotted key, at a position along each of the dimensions."""
    return {
        key: sweep[position]
        for dim, position in zip(dimensions, index, strict=True)
        for key, sweep in dim.sweeps.items()
    }


@lru_cache(maxsize=8)
def _read_cached(path: Path, reserved: frozenset[str], stamp: int | None) -> Layout:
    """Read a file once while it does not change (`stamp`)."""
    return read_csv(path, reserved)


@lru_cache(maxsize=8)
def generated(recipe: Recipe) -> Layout:
    """The layout that a generator makes of its parameters, the same in every process."""
    clearance, inner_radius, rings, heliostats, zones = recipe
    return radial_stagger(clearance, inner_radius, rings=rings, heliostats=heliostats, zones=zones)
