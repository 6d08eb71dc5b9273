"""The study as a whole: what all families have in common, its swept parameters, its identity and its JSON Schema."""

from __future__ import annotations

import os
import pathlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, ClassVar, get_args

from pydantic import Field, PrivateAttr
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from heliosweep.config import identity
from heliosweep.config.block import Block
from heliosweep.config.blocks import Dataset, Execution, Output, Report
from heliosweep.config.faults import printable
from heliosweep.config.source import Source
from heliosweep.config.sweep import Sweep
from heliosweep.config.values import FileName, Parameter, Samples, Text
from heliosweep.errors import Problem, StudyError
from heliosweep.files import user_path


@dataclass(frozen=True)
class Dimension:
    """A dimension of the result: one swept parameter, or several that `zip` ties together.

    Parameters
    ----------
    name : str
        Name of the dimension; of tied parameters, the name of the first.
    sweeps : mapping of str to Sweep
        The swept values by dotted key, all of one length.
    """

    name: str
    sweeps: Mapping[str, Sweep]

    def __len__(self) -> int:
        """Return the number of values along the dimension."""
        return len(next(iter(self.sweeps.values())))


class Study(Block):
    """A validated study. A family subclasses it, sets `family` to ``Literal["its name"]`` and adds its blocks."""

    DOES_NOT_MATTER: ClassVar = ("title", "description", "references", "dataset", "execution", "output", "report")
    """Keys that never change a number and so are no part of the study's identity."""

    family: Annotated[str, Text("Name of the study family")]
    title: Annotated[str, Text("Title of the study, shown in results and reports")] = ""
    description: Annotated[str, Text("What the study shows, in a few sentences")] = ""
    references: Annotated[
        tuple[Annotated[str, Text("Reference")], ...], Field(description="Publications the study rests on")
    ] = ()
    zip: Annotated[
        tuple[tuple[Annotated[str, Text("Key")], ...], ...],
        Field(description="Groups of swept keys that vary together on one dimension instead of as a product"),
    ] = ()
    dataset: Annotated[Dataset | None, Field(description="Who made the data set, and how it may be used")] = None
    execution: Annotated[Execution, Field(description="How the study is computed")] = Execution()
    output: Annotated[Output, Field(description="What is stored and how")] = Output()
    report: Annotated[Report, Field(description="What the report shows")] = Report()

    _source: Source = PrivateAttr(default_factory=lambda: Source({}))

    def __eq__(self, other: object) -> bool:
        """Tell whether both studies say the same, wherever they were read from."""
        if type(other) is not type(self):
            return NotImplemented
        return all(getattr(self, key) == getattr(other, key) for key in type(self).model_fields)

    def check(self) -> Iterable[Problem]:
        """Yield what is wrong between blocks or with named files; runs when every block is right by itself."""
        return ()

    def notes(self) -> Iterable[str]:
        """Yield what the user should be warned of in a study that is valid."""
        return ()

    @property
    def source(self) -> Source:
        """The study as it was written, with ``.path`` and ``.directory``."""
        return self._source

    def resolve(self, name: str) -> pathlib.Path:
        """Return the path of a file that the study names, relative to the study file."""
        return self._source.directory / user_path(name)

    def place_of(self, name: str) -> pathlib.Path:
        """Return where that file is: ``..`` after a link to a folder leads to where that folder is."""
        path = self.resolve(name)
        return pathlib.Path(os.path.realpath(path.parent)) / path.name

    def problem(self, key: str, message: str) -> Problem:
        """Return a problem with the value of a dotted key (``site.latitude``), located in the study file."""
        return self._source.problem(self._source.path_of(key), message)

    @classmethod
    def family_name(cls) -> str:
        """Return the name of the family, as study files have it."""
        return get_args(cls.model_fields["family"].annotation)[0]

    def sweeps(self) -> dict[str, Sweep]:
        """Return the swept parameters by dotted key, in the order in which the family declares them."""
        return {key: value for key, parameter, value in parameters(self) if _is_swept(parameter, value)}

    def dimension_names(self) -> dict[str, str]:
        """Return the name of the dimension that each swept parameter asks for, by dotted key, before `zip`."""
        return {
            key: parameter.dimension or key.rpartition(".")[2]
            for key, parameter, value in parameters(self)
            if _is_swept(parameter, value)
        }

    def dimensions(self) -> list[Dimension]:
        """Return the dimensions of the parameter grid, in the order of :meth:`sweeps`, `zip` applied."""
        sweeps, names = self.sweeps(), self.dimension_names()
        key_of = {name: key for key, name in names.items()} | {key: key for key in names}
        groups = [[key_of[entry] for entry in group] for group in self.zip]
        tied = {key: group for group in groups for key in group}
        dimensions: dict[str, Dimension] = {}
        for key in sweeps:
            group = tied.get(key, [key])
            name = names[group[0]]
            dimensions.setdefault(name, Dimension(name, {member: sweeps[member] for member in group}))
        return list(dimensions.values())

    def files(self) -> dict[str, tuple[str, ...]]:
        """Return the names of all files that the study names, by dotted key."""
        return {
            key: value.values() if isinstance(value, Sweep) else (value,)
            for key, parameter, value in parameters(self)
            if isinstance(parameter, FileName)
        }

    def canonical(self) -> dict[str, Any]:
        """Return what the numbers and labels of the result depend on, the same however it was written.

        Contents stand for named files; the names, without folders, only where files are swept, since they are then
        labels.

        Raises
        ------
        StudyError
            A named file cannot be read.
        """
        digests = {
            name: self._digest(key, name)
            for key, names in self.files().items()
            if key.partition(".")[0] not in self.DOES_NOT_MATTER
            for name in names
        }
        matters = self.model_copy(update=dict.fromkeys(self.DOES_NOT_MATTER))
        tied = [list(dimension.sweeps) for dimension in self.dimensions() if len(dimension.sweeps) > 1]
        return identity.canonical(matters, digests) | {"zip": tied}

    @property
    def study_id(self) -> str:
        """Twelve hexadecimal digits that stand for :meth:`canonical`."""
        return identity.fingerprint(self.canonical())

    def resolved(self, relative_to: pathlib.Path | None = None) -> dict[str, Any]:
        """Return the study with all defaults as plain data that loads to the same study.

        Parameters
        ----------
        relative_to : Path, optional
            Folder in which it will be saved: file names are written as seen from there. Without it they stay as they
            were given, relative to the folder of the original study file.
        """
        return identity.resolved(
            self, str if relative_to is None else partial(self._seen_from, pathlib.Path(relative_to))
        )

    def to_yaml(self, relative_to: pathlib.Path | None = None) -> str:
        """Return the study as the text of a study file, all defaults written out: see :meth:`resolved`."""
        return identity.yaml_text(self.resolved(relative_to))

    def _seen_from(self, folder: pathlib.Path, name: str) -> str:
        path = self.resolve(name)
        seen = os.path.relpath(path, folder)
        if os.path.realpath(folder / seen) != os.path.realpath(path):  # ".." after a link to a folder is elsewhere
            seen = os.path.relpath(self.place_of(name), os.path.realpath(folder))
        return pathlib.Path(seen).as_posix()

    def _digest(self, key: str, name: str) -> str:
        try:
            return identity.table_digest(self.resolve(name))
        except OSError as error:
            raise StudyError(self.problem(key, f"cannot read {printable(name)}: {error.strerror}")) from None
        except ValueError as error:
            raise StudyError(self.problem(key, f"{printable(name)} {error}")) from None


def parameters(block: Block, prefix: str = "") -> Iterator[tuple[str, Parameter, Any]]:
    """Yield dotted key, declaration and value of every parameter that is given, in the order of declaration."""
    for name in type(block).model_fields:
        value, parameter = getattr(block, name), type(block).parameter(name)
        if value is None:
            continue
        if parameter is not None:
            yield f"{prefix}{name}", parameter, value
        elif isinstance(value, Block):
            yield from parameters(value, f"{prefix}{name}.")
        elif isinstance(value, tuple):
            for position, item in enumerate(value):
                if isinstance(item, Block):
                    yield from parameters(item, f"{prefix}{name}[{position}].")


def _is_swept(parameter: Parameter, value: Any) -> bool:
    return isinstance(value, Sweep) and not isinstance(parameter, Samples)


def json_schema(study_class: type[Study]) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of the study files of a family, units and descriptions included."""
    schema = study_class.model_json_schema(schema_generator=_StudySchema)
    title = f"heliosweep study of the family {study_class.family_name()}"
    return {"$schema": GenerateJsonSchema.schema_dialect} | schema | {"title": title}


class _StudySchema(GenerateJsonSchema):
    """Leaves out what does not exist in study files: null, and defaults that are none."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        inner = self.generate_inner(schema["schema"])
        default = identity.plain(schema.get("default"))
        return inner if default is None else inner | {"default": default}
