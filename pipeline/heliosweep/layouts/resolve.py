"""The layouts that a study names: one, or one for each value of what is swept in its ``layout`` block."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache, partial
from operator import attrgetter
from pathlib import Path
from typing import Any

from heliosweep.config.study import Dimension, Study
from heliosweep.errors import Problem, StudyError
from heliosweep.layouts.csv import read_csv
from heliosweep.layouts.layout import Layout
from heliosweep.layouts.radial_stagger import Zone, radial_stagger

#: Columns of a layout that are mirror sizes; they stand for ``heliostat.width`` and ``heliostat.height``.
SIZE_COLUMNS = ("width", "height")


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
        self._study, self._key, self._reserved = study, key, reserved
        self._block: Any = attrgetter(key)(study)
        self.dimensions: list[Dimension] = [
            dim for dim in study.dimensions() if any(name.startswith(f"{key}.") for name in dim.sweeps)
        ]

    def __len__(self) -> int:
        return math.prod(map(len, self.dimensions))

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
        file, block = values.get(f"{self._key}.file", self._block.file), self._block.radial_stagger
        try:
            if file is not None:
                path = self._study.resolve(file)
                return _read(path, self._reserved, path.stat().st_mtime_ns if path.exists() else None)
            keys = ("clearance", "inner_radius", "rings", "heliostats")
            given = {key: values.get(f"{self._key}.radial_stagger.{key}", getattr(block, key)) for key in keys}
            for key in ("rings", "heliostats"):
                given[key] = None if given[key] is None else int(given[key])  # a value of a sweep is a float
            zones = None if block.zones is None else tuple(Zone(z.start, z.rings, z.pitch) for z in block.zones)
            return _generated(**given, zones=zones)
        except StudyError as error:
            raise StudyError(map(partial(self._located, file), error.problems)) from None

    def _located(self, file: str | None, problem: Problem) -> Problem:
        """The problem where the study has what causes it, unless it has a line of a file."""
        if problem.line:
            return problem
        if file is not None:
            return self._study.problem(f"{self._key}.file", f"{file}: {problem.message}")
        return self._study.problem(f"{self._key}.radial_stagger.{problem.key}", problem.message)


def values_at(dimensions: Iterable[Dimension], index: Iterable[int]) -> dict[str, Any]:
    """Values of what is swept, by dotted key, at a position along each of the dimensions."""
    return {
        key: sweep[position]
        for dim, position in zip(dimensions, index, strict=True)
        for key, sweep in dim.sweeps.items()
    }


@lru_cache(maxsize=8)
def _read(path: Path, reserved: frozenset[str], stamp: int | None) -> Layout:
    """Read a file once while it does not change (`stamp`)."""
    return read_csv(path, reserved)


_generated = lru_cache(maxsize=8)(radial_stagger)
