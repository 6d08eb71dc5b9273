"""Define the study model (blocks, swept parameters and study id), and describe its keys as JSON Schema or text."""

from __future__ import annotations

import codecs
import datetime as dt
import hashlib
import json
import os
import pathlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from importlib import import_module
from typing import Annotated, Any, ClassVar, Literal, Self, get_args, get_origin

import yaml
from pydantic import Field, PrivateAttr
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from heliosweep.config.blocks import Block, Dataset, Execution, Output, Report, blocks_in
from heliosweep.config.faults import in_short
from heliosweep.config.sample import SAMPLE, Sample, Search
from heliosweep.config.source import Source, scalar
from heliosweep.config.times import DateList
from heliosweep.config.values import (
    Distribution,
    Drawn,
    FileName,
    Numbers,
    Parameter,
    Samples,
    Schema,
    Sweep,
    Text,
    as_range,
    ends,
)
from heliosweep.errors import Problem, StudyError
from heliosweep.files import PVLIB, named_in, seen_from

#: Maximum size of an input file. [bytes]
MAX_BYTES = 512 * 2**20


@dataclass(frozen=True)
class Dimension:
    """A dimension of the result: one swept parameter, several parameters tied by `zip`, or all drawn parameters.

    Parameters
    ----------
    name : str
        Name of the dimension: the first of the tied parameters, or ``sample`` for drawn parameters.
    sweeps : mapping of str to Sweep
        Swept values by dotted key, all of equal length.
    """

    name: str
    sweeps: Mapping[str, Sweep]

    def __len__(self) -> int:
        return len(next(iter(self.sweeps.values())))


class Study(Block):
    """A validated study. Each family derives a class that sets `family` to ``Literal["its name"]`` and adds blocks."""

    #: Keys that do not affect the numerical results and therefore do not affect the study id.
    DOES_NOT_MATTER: ClassVar = ("title", "description", "references", "dataset", "execution", "output", "report")

    family: Annotated[str, Text("Name of the study family")]
    include: Annotated[
        str | None,
        FileName("Study file to include; keys in this file are merged with its keys and take precedence", sweep=False),
    ] = None
    title: Annotated[str, Text("Title of the study, shown in results and reports")] = ""
    description: Annotated[str, Text("Purpose of the study, in a few sentences")] = ""
    references: Annotated[
        tuple[Annotated[str, Text("Reference")], ...], Field(description="Publications on which the study is based")
    ] = ()
    zip: Annotated[
        tuple[tuple[Annotated[str, Text("Key")], ...], ...],
        Field(description="Groups of swept keys that vary together along one dimension instead of forming a product"),
    ] = ()
    sample: Annotated[
        Sample | None,
        Field(description="Draws of the keys whose values are distributions, along the dimension 'sample'"),
    ] = None
    search: Annotated[
        Search | None, Field(description="Search for the best point instead of a sweep: objectives and searched keys")
    ] = None
    dataset: Annotated[Dataset | None, Field(description="Authors and licence of the data set")] = None
    execution: Annotated[Execution, Field(description="Scheduler, workers and memory of the run")] = Execution()
    output: Annotated[Output, Field(description="Stored results and their format")] = Output()
    report: Annotated[Report, Field(description="Contents of the report")] = Report()

    _source: Source = PrivateAttr(default_factory=lambda: Source({}))
    _weather: tuple[Any, ...] = PrivateAttr(())

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(getattr(self, key) == getattr(other, key) for key in type(self).model_fields)

    def __copy__(self) -> Self:
        """Return a copy without cached results, so that `model_copy` may change its blocks."""
        copied = super().__copy__()
        for name in copied.__dict__.keys() - type(self).model_fields.keys():  # cached results of the old study
            del copied.__dict__[name]
        return copied

    def examinations(self) -> Iterable[Callable[[Any], Iterable[Problem | str]]]:
        """Return functions that check the study and yield problems and warnings.

        Each function is called once, regardless of the results of the other functions. Warnings are strings.
        """
        return ()

    @cached_property
    def _findings(self) -> tuple[Problem | str, ...]:
        found: dict[Problem | str, None] = {}  # report a problem found by two checks only once
        for key, _, value in self.parameters():
            if isinstance(value, Drawn) and value.cut:
                ends = " to ".join(f"{end:.6g}" if abs(end) > 1e-300 else "0" for end in value.parts[2:])
                found[
                    f"{key}: a fraction of {value.cut:.1g} of the normal draws would be out of bounds; the "
                    f"distribution is truncated to {ends}"
                ] = None
        if self.execution.device == "cuda" and getattr(self, "optics", None) is None:
            found[self.problem("execution.device", "requires a field with 'optics': remove it")] = None
        for examine in self.examinations():
            try:
                for one in examine(self):
                    found[one] = None
            except StudyError as error:
                found |= dict.fromkeys(error.problems)
        return tuple(found)

    def check(self) -> Iterable[Problem]:
        """Return the conflicts between blocks and the problems with files. Every block must be valid."""
        return [one for one in self._findings if isinstance(one, Problem)]

    def notes(self) -> Iterable[str]:
        """Return the warnings for a valid study."""
        return [one for one in self._findings if isinstance(one, str)]

    @property
    def source(self) -> Source:
        """Contents of the study file, with the path of the file."""
        return self._source

    def resolve(self, name: str) -> pathlib.Path:
        """Return the path of a file of the study. The name may be relative to the folder of the study file."""
        return named_in(self._source.directory, name)

    def problem(self, key: str, message: str) -> Problem:
        """Return a problem at the position of the value of a dotted key, such as ``site.latitude``."""
        return self._source.problem(self._source.path_of(key), message)

    def with_(self, changes: Mapping[str, Any] | None = None, /, **keys: Any) -> Self:
        """Return a validated copy of the study with changed values.

        Parameters
        ----------
        changes : mapping of str to object
            Values by dotted key, such as ``{"receiver.height": 90}``; None removes a key.
        **keys
            Values of top-level keys, such as ``tracking="spinning_elevation"``. A block is replaced completely.

        Returns
        -------
        Study
            New study with its own id. File names are relative to the folder of the original study file.

        Raises
        ------
        StudyError
            If the study is invalid. The message lists all problems with their keys.
        """
        # Import the API by name, because import statements in this module affect the identity of the numerical code.
        changed: Self = import_module("heliosweep.api").load(self, {**(changes or {}), **keys})
        return changed

    @classmethod
    def family_name(cls) -> str:
        """Return the name of the family in study files."""
        return get_args(cls.model_fields["family"].annotation)[0]

    def parameters(self) -> tuple[tuple[str, Parameter, Any], ...]:
        """Return the dotted key, declaration and value of each specified parameter, in the order of declaration."""
        given: tuple[tuple[str, Parameter, Any], ...] = self.__dict__.get("_given") or tuple(parameters(self))
        self.__dict__["_given"] = given  # cache the parameters, because each chunk needs them; copies drop the cache
        return given

    def sweeps(self) -> dict[str, Sweep]:
        """Return the swept parameters by dotted key, in the order in which the family declares them."""
        return {
            key: value
            for key, parameter, value in self.parameters()
            if isinstance(value, Sweep) and not isinstance(parameter, Samples)
        }

    def dimension_names(self) -> dict[str, str]:
        """Return the dimension name of each swept parameter by dotted key, without regard to `zip`."""
        declared = {key: parameter for key, parameter, _ in self.parameters()}
        return {key: declared[key].dimension or key.rpartition(".")[2] for key in self.sweeps()}

    def tied_keys(self) -> list[list[str]]:
        """Return the groups of dotted keys that `zip` ties together."""
        names = self.dimension_names()
        key_of = {name: key for key, name in names.items()} | {key: key for key in names}
        return [[key_of[entry] for entry in group] for group in self.zip]

    def dimensions(self) -> list[Dimension]:
        """Return the grid dimensions in the order of :meth:`sweeps`, with tied keys combined and `sample` last."""
        sweeps, names = self.sweeps(), self.dimension_names()
        tied = {key: group for group in self.tied_keys() for key in group}
        groups: dict[str, list[str]] = {}
        for key in sorted(sweeps, key=lambda key: isinstance(sweeps[key], Drawn)):
            group = tied.get(key, [key])
            name = SAMPLE if isinstance(sweeps[key], Drawn) else names[group[0]]
            groups[name] = [*groups.get(name, []), key] if name == SAMPLE else group
        return [Dimension(name, {key: sweeps[key] for key in keys}) for name, keys in groups.items()]

    def files(self) -> dict[str, tuple[str, ...]]:
        """Return the names of all files of the study by dotted key."""
        return {key: ends(value) for key, parameter, value in self.parameters() if isinstance(parameter, FileName)}

    def reserved_names(self) -> frozenset[str]:
        """Return the names reserved in the result. A layout column with a reserved name becomes ``layout_NAME``."""
        return frozenset()

    def canonical(self) -> dict[str, Any]:
        """Return the inputs that determine the numbers and labels of the result, independent of their notation.

        Each file name is replaced with a digest of the file contents. If files are swept, the file names without
        folders are also included, because they label the result.

        Raises
        ------
        StudyError
            If a file cannot be read.
        """
        digests = {
            name: self._digest(key, name)
            for key, names in self.files().items()
            if key.partition(".")[0] not in self.DOES_NOT_MATTER
            for name in names
        }

        def rewrite(parameter: Parameter | None, value: Any) -> Any:
            if isinstance(parameter, FileName):
                if isinstance(value, Sweep):
                    return [[pathlib.PurePath(name).name, digests[name]] for name in value.values()]
                return digests[value]
            return as_range(value) if isinstance(value, Sweep) else value

        matters = self.model_copy(update=dict.fromkeys(self.DOES_NOT_MATTER))
        tied = [list(dim.sweeps) for dim in self.dimensions() if len(dim.sweeps) > 1 and dim.name != SAMPLE]
        sweeps = self.sweeps()
        tied += [group for group in self.tied_keys() if isinstance(sweeps[group[0]], Drawn)]
        return plain(matters, rewrite) | {"zip": tied}

    @property
    def study_id(self) -> str:
        """First twelve hexadecimal digits of the SHA-256 digest of :meth:`canonical`."""
        return id_of(self.canonical())

    def resolved(self, place_of: Callable[[str], str] = str) -> dict[str, Any]:
        """Return the study as plain data with all defaults filled in. Loading this data gives the same study.

        Parameters
        ----------
        place_of : callable
            Function that returns the replacement for a file name (default: the name, relative to the folder of the
            original study file).
        """

        def rewrite(parameter: Parameter | None, value: Any) -> Any:
            if not isinstance(parameter, FileName):
                return value
            return [place_of(name) for name in value.values()] if isinstance(value, Sweep) else place_of(value)

        return {key: entry for key, entry in plain(self, rewrite).items() if entry not in ("", [], {})}

    def to_yaml(self, relative_to: pathlib.Path | None = None) -> str:
        """Return the study as the text of a study file with all defaults.

        Parameters
        ----------
        relative_to : Path, optional
            Folder in which the text will be saved. File names are written relative to this folder (default: unchanged).
        """
        place_of = str if relative_to is None else partial(self.seen_from, pathlib.Path(relative_to))
        return yaml_text(self.resolved(place_of))

    def seen_from(self, folder: pathlib.Path, name: str) -> str:
        """Return the name of a file of the study relative to a folder. Names of pvlib files are not changed."""
        if name.startswith(PVLIB):
            return name
        return seen_from(folder, self.resolve(name))

    def _digest(self, key: str, name: str) -> str:
        """Return the SHA-256 digest of a binary file, or of a table without line endings, empty lines and comments."""
        try:
            path, digest, separator = self.resolve(name), hashlib.sha256(), b""
            with path.open("rb") as file:
                if os.fstat(file.fileno()).st_size > MAX_BYTES:  # the limits for tables and images are much lower
                    raise ValueError(f"{in_short(path.name)} is larger than {MAX_BYTES // 2**20} MiB")
                binary = b"\0" in file.read(8192)
                file.seek(0)
                if binary:
                    return hashlib.file_digest(file, "sha256").hexdigest()
                for number, part in enumerate(file):
                    for line in (part if number else part.removeprefix(codecs.BOM_UTF8)).splitlines():
                        if line.strip() and not line.startswith(b"#"):
                            digest.update(separator + line)
                            separator = b"\n"
            return digest.hexdigest()
        except (OSError, ValueError) as error:
            reason = f"cannot read {in_short(name)}: {error.strerror}" if isinstance(error, OSError) else error
            raise StudyError(self.problem(key, str(reason))) from None


def id_of(canonical: Mapping[str, Any]) -> str:
    """Compute the study id from the inputs that `Study.canonical` returns."""
    text = json.dumps(canonical, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def parameters(block: Block, prefix: str = "") -> Iterator[tuple[str, Parameter, Any]]:
    """Yield the dotted key, declaration and value of each specified parameter, in the order of declaration."""
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


def replaced(block: Any, key: str, value: Any) -> Any:
    """Return a copy of a block with a new value for a dotted key. The value is not checked."""
    name, _, rest = key.partition(".")
    return block.model_copy(update={name: replaced(getattr(block, name), rest, value) if rest else value})


def plain(value: Any, rewrite: Callable[[Parameter | None, Any], Any] = lambda _, entry: entry) -> Any:
    """Return a block or value as plain data for a study file. Unset keys are omitted.

    `rewrite` maps the declaration of a field and its value to the value to write.
    """
    if isinstance(value, Block):
        declared = type(value)
        given = ((name, getattr(value, name)) for name in declared.model_fields)
        return {
            name: plain(rewrite(declared.parameter(name), entry), rewrite) for name, entry in given if entry is not None
        }
    if isinstance(value, Sweep | DateList | Distribution):
        return plain(value.spec(), rewrite)
    if isinstance(value, dict):
        return {key: plain(entry, rewrite) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry, rewrite) for entry in value]
    return value.isoformat() if isinstance(value, dt.date) else value


def yaml_text(content: Mapping[str, Any]) -> str:
    """Convert plain data to the text of a study file."""
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100)


class _Dumper(yaml.SafeDumper):
    """YAML writer that uses no aliases and quotes strings that the strict reader would convert to other types."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = None if isinstance(scalar(text), str) else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style)


_Dumper.add_representer(str, _text)


def json_schema(study_class: type[Study]) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a family's study files, with units and descriptions, for text editors.

    No key is required in the schema, because searches and included files may supply keys. `load` reports missing keys.
    """
    schema = study_class.model_json_schema(schema_generator=_StudySchema)
    for block in (schema, *schema["$defs"].values()):
        block.pop("required", None)
    title = f"heliosweep study of the family {study_class.family_name()}"
    return {"$schema": GenerateJsonSchema.schema_dialect} | schema | {"title": title}


class _StudySchema(GenerateJsonSchema):
    """Schema generator that omits null values and null defaults, because study files do not contain them."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        inner = self.generate_inner(schema["schema"])
        default = plain(schema.get("default"))
        return inner if default is None else inner | {"default": default}


@dataclass(frozen=True)
class Key:
    """Description of a study key.

    Parameters
    ----------
    name : str
        Dotted key, with ``[]`` instead of the index of a list entry.
    meaning, unit : str
        Meaning of the key, and the unit of numbers written without a unit.
    options : tuple of (str, str)
        Allowed names with their meanings.
    value, default : str
        Description of the allowed values, and the default in YAML (empty if there is no default).
    required : bool
        True if the key is required in its block.
    swept : bool
        True if the value can be swept.
    sampled : bool
        True if the values are instants over which results are averaged.
    only : str
        Kinds of the block that contain this key; empty if all kinds contain the key.
    """

    name: str
    meaning: str
    unit: str
    options: tuple[tuple[str, str], ...]
    value: str
    default: str
    required: bool
    swept: bool
    sampled: bool
    only: str = ""


def keys_of(block: type[Block], prefix: str = "") -> Iterator[Key]:
    """Yield each key of a block, followed by the keys of its nested blocks."""
    for name, field in block.model_fields.items():
        blocks = [pair for pair in dict.fromkeys(blocks_in(field.annotation)) if pair[0] != "{}"]
        parameter, default = block.parameter(name), None if field.default_factory else field.get_default()
        options, unit = getattr(parameter, "options", ()), getattr(parameter, "unit", "1").removeprefix("1")
        meaning = getattr(parameter, "purpose" if isinstance(parameter, Numbers) else "description", "")
        yield Key(
            f"{prefix}{name}",
            meaning or field.description or "",
            unit,
            tuple(options.items()) if isinstance(options, Mapping) else (),
            _value(block, name, parameter, blocks, unit),
            "" if field.is_required() else _default(default, unit),
            field.is_required(),
            bool(parameter and parameter.sweep),
            isinstance(parameter, Samples),
        )
        found: dict[str, list[tuple[str, Key]]] = {}
        for suffix, inner in blocks:
            tags = [f"`{key}: {one}`" for key in inner.model_fields for one in inner.literals(key)]
            for key in keys_of(inner, f"{prefix}{name}{suffix}."):
                found.setdefault(key.name, []).append(("".join(tags[:1]), key))
        for same in found.values():
            yield _merged(same, len(blocks))


def _merged(tagged: list[tuple[str, Key]], blocks: int) -> Key:
    tags, keys = zip(*tagged, strict=True)
    key: Key = keys[0]
    # the key selects the kind of the block
    if blocks > 1 and all(one.value[:1] == "`" and not one.options for one in keys):
        key = replace(key, value=", ".join(dict.fromkeys(one.value for one in keys)))
    some = len(keys) < blocks and all(tags)
    return replace(key, only=", ".join(dict.fromkeys(tags))) if some else key


def _value(block: type[Block], name: str, parameter: Parameter | None, blocks: list[Any], unit: str) -> str:
    if parameter is not None:
        return "; ".join(
            dict.fromkeys(filter(None, (_form_text(form, unit) for form in _forms(parameter.json_schema()))))
        )
    annotation = block.model_fields[name].annotation
    parts = [annotation, *get_args(annotation)]
    words = [", ".join(f"`{word}`" for word in get_args(part)) for part in parts if get_origin(part) is Literal]
    words += [f"{'list of ' * bool(suffix)}{{{', '.join(inner.model_fields)}}}" for suffix, inner in blocks]
    return "; ".join(words) or ("list" if get_origin(annotation) is tuple else "mapping")


def _forms(schema: Schema) -> Iterator[Schema]:
    for form in schema.get("anyOf", ()):
        yield from _forms(form)
    if "anyOf" not in schema and not str(schema.get("description")).startswith("Swept"):
        yield schema


def _default(default: Any, unit: str) -> str:
    value = plain(default)
    if value is None or isinstance(value, dict) or value in ([], ""):
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f"`{_number(value, unit) if isinstance(value, int | float) else value}`"


def _number(value: float, unit: str = "") -> str:
    for factor, name in ((2**40, "TiB"), (2**30, "GiB"), (2**20, "MiB")):
        if unit == "B" and value % factor == 0 and value:
            return f"{value // factor:,g} {name}"
    return f"{value:,.{15 if isinstance(value, float) else 16}g}"


def _form_text(form: Schema, unit: str = "") -> str:
    """Describe part of a JSON Schema in words. Returns an empty string for a number with a unit."""
    kind = form.get("type")
    if names := form.get("enum", [form["const"]] if "const" in form else []):
        return ", ".join(f"`{name}`" for name in names)
    if kind == "string":
        return "" if "[eE]" in form.get("pattern", "") else "date" if form.get("format") == "date" else "text"
    if kind == "array":
        items = _form_text(form.get("items", {}))
        return f"list of {items}" if items else "list"
    if kind == "object":
        return f"{{{', '.join(form['properties'])}}}" if "properties" in form else "mapping"
    words = {"boolean": "`true`, `false`", "number": "number", "integer": "whole number"}.get(str(kind), "")
    if kind not in ("number", "integer"):
        return words
    if "minimum" in form and "maximum" in form:
        return f"{words}, {_number(form['minimum'], unit)} to {_number(form['maximum'], unit)}"
    bounds = {"at least": "minimum", "above": "exclusiveMinimum", "at most": "maximum", "below": "exclusiveMaximum"}
    return ", ".join([words, *(f"{word} {_number(form[key], unit)}" for word, key in bounds.items() if key in form)])
