"""What a user looks up before writing a study: keys in words, a study to start from, studies to copy."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from heliosweep.config.faults import SYNONYMS, few_of, nearest, one_of
from heliosweep.config.keys import Key, keys_of
from heliosweep.config.load import load
from heliosweep.config.source import Source, parse, read
from heliosweep.errors import HeliosweepError, Problem, StudyError
from heliosweep.families.family import families, study_classes
from heliosweep.files import user_path, write_whole
from heliosweep.store.targets import sources_of, target_file

#: Folder of the studies that come along: in the installed package, else in the working copy.
_STUDIES = (Path(__file__).parents[1] / "studies", Path(__file__).parents[3] / "studies")
#: Longer examples are not shown. [characters]
_WIDTH = 100
#: Columns that the meaning of a key needs beside its name.
_LEAST_ROOM = 40


def explain(words: Iterable[str]) -> str:
    """Explain a key of study files or a variable of results.

    Parameters
    ----------
    words : sequence of str
        A family, a dotted key such as ``receiver.height`` or a variable such as ``field_receiver_energy``, or a family
        and one of both. A family alone lists its keys.

    Returns
    -------
    str
        Meaning, forms, unit, range, default and an example; of a block, also its keys.

    Raises
    ------
    StudyError
        If there is no such family, key or variable. The message lists keys and variables that are similar, or whose
        descriptions contain the word.
    """
    given = list(words)
    chosen = [given.pop(0)] if given and given[0] in families() else list(families())
    if len(given) > 1:
        raise StudyError(Problem(f"unknown family; use {one_of(families())}", given[0]))
    if not given:
        if len(chosen) > 1:
            raise StudyError(Problem(f"name a family, a key, or both; the families are {', '.join(families())}"))
        return "\n".join(_lines(_keys(chosen[0])))
    wanted = re.sub(r"\[\d*\]", "", given[0])
    texts: dict[tuple[str, str], dict[str, str]] = {}
    for name in chosen:
        found = [key for key in _keys(name) if _plain(key) == wanted]
        exact = [key for key in found if key.name == re.sub(r"\[\d+\]", "[]", given[0])]
        for key in exact or found:
            texts.setdefault((key.name, _explained(name, key)), {})[name] = _example(name, key)
    for name in () if texts else chosen:
        if (attrs := _variables(name).get(wanted)) is not None:
            comment, unit = (str(attrs.get(key, "")) for key in ("comment", "units"))
            rows = [
                attrs["long_name"],
                comment,
                f"variable of results{f', in {unit}' if unit not in ('', '1') else ''}",
            ]
            text = "\n".join(line for row in rows if row for line in _folded("  ", row))
            texts.setdefault((wanted, text), {})[name] = ""
    if not texts:
        raise StudyError(Problem(_unknown(wanted, chosen), given[0]))
    told = []
    for (called, text), of in texts.items():
        told.append("\n".join([f"{called}  ({', '.join(of)})", text, *filter(None, of.values())]))
    return "\n\n".join(told)


def new_study(family: str, target: str | os.PathLike[str] | None = None, *, force: bool = False) -> Path:
    """Write a commented study file of a family to start from, by default ``FAMILY.yaml``; returns its path.

    Raises
    ------
    StudyError
        There is no such family, or the file is there already.
    """
    if family not in families():
        near = nearest(family, families())
        hint = f"did you mean {near!r}?" if near else f"use {one_of(families())}"
        raise StudyError(Problem(f"unknown family; {hint}", family))
    file = target_file(target or f"{family}.yaml", force, endings=(".yaml", ".yml"))
    write_whole(file, families()[family].example())
    return file


def shipped() -> dict[str, Path]:
    """Study files that come with heliosweep, by name; none where it was installed without them."""
    folder = next((folder for folder in _STUDIES if folder.is_dir()), None)
    return {} if folder is None else {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def examples() -> str:
    """List the studies that come with heliosweep: name, family and title, one a line, by family."""
    told = sorted((str(source.data.get("family")), name, str(source.data.get("title"))) for name, source in _read())
    if not told:
        raise HeliosweepError("no studies came with this installation; they are in the folder studies/ of the sources")
    width, inner = (max(len(entry[i]) for entry in told) for i in (1, 0))
    return "\n".join(f"{name:{width}}  {family:{inner}}  {title}" for family, name, title in told)


def copy_examples(names: Iterable[str], folder: str | os.PathLike[str], *, force: bool = False) -> list[Path]:
    """Copy studies that come with heliosweep, and all files that they name, into a folder; returns the study files.

    Raises
    ------
    StudyError
        There is no such study, or a file of that name is there already; nothing is copied then.
    """
    known, place = shipped(), user_path(folder)
    wanted: dict[Path, Path] = {}
    for name in dict.fromkeys(name.removesuffix(".yaml") for name in names):
        if name not in known:
            near = nearest(name, known)
            hint = f"did you mean {near!r}?" if near else "heliosweep examples lists them"
            raise StudyError(Problem(f"no study of that name comes with heliosweep; {hint}", name))
        home = known[name].parent
        for file in sources_of(load(known[name], study_classes())):
            if file.is_relative_to(home):  # else of a package
                wanted[file] = place / file.relative_to(home)
    for file, target in wanted.items():
        if target.exists() and (file.suffix == ".yaml" or target.read_bytes() != file.read_bytes()):
            target_file(target, force, endings=())
    for file, target in wanted.items():
        target.parent.mkdir(parents=True, exist_ok=True)
        write_whole(target, file.read_bytes())
    return [target for file, target in wanted.items() if file in known.values()]


@cache
def _keys(family: str) -> list[Key]:
    return list(keys_of(families()[family].study_class()))


@cache
def _read() -> list[tuple[str, Source]]:
    """The studies that come along, as they are written."""
    return [(name, read(path)) for name, path in shipped().items()]


@cache
def _variables(family: str) -> dict[str, Mapping[str, Any]]:
    """Return the attributes of the variables in results of the studies that come with heliosweep, by name."""
    studies = (load(shipped()[name], study_classes()) for name, source in _read() if source.data["family"] == family)
    return {name: one.attrs for study in studies for name, one in families()[family].variables(study).items()}


def _plain(key: Key) -> str:
    """Name of a key without the mark of lists, which users may write or not."""
    return key.name.replace("[]", "")


def _lines(keys: Iterable[Key], indent: str = "") -> list[str]:
    """Name of each key, and what it is, beside it or below where that leaves no room."""
    told = [(one.name, f"{one.meaning or one.value}{f' [{one.unit}]' if one.unit else ''}") for one in keys]
    width = max((len(name) for name, _ in told), default=0)
    if len(indent) + width + _LEAST_ROOM <= _columns():
        return [line for name, what in told for line in _folded(f"{indent}{name:{width}}  ", what)]
    return [line for name, what in told for line in (f"{indent}{name}", *_folded(f"{indent}    ", what))]


def _folded(head: str, text: str) -> list[str]:
    """Lines that the terminal has room for: a head, and text beside it."""
    options: Any = {"break_long_words": False, "break_on_hyphens": False}
    return textwrap.wrap(text, _columns(), initial_indent=head, subsequent_indent=" " * len(head), **options)


def _columns() -> int:
    """Columns of the terminal; without one, lines are as long as they are."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else sys.maxsize


def _explained(family: str, key: Key) -> str:
    """Meaning, forms, unit, default and an example of a key, or the keys of a block."""
    inner = [one for one in _keys(family) if one.name.startswith((f"{key.name}.", f"{key.name}[]."))]
    meaning = f"{key.meaning}{f' (where {key.only})' if key.only else ''}".replace("`", "")
    rows = [("", meaning)] if meaning else []
    rows += [("  ", f"{name}: {meaning}") for name, meaning in key.options]
    if not inner:
        value = key.value.replace("`", "")
        rows += [("value", value)] if value else []
        if key.unit:
            rows.append(
                ("unit", f'{key.unit}; another unit may be written out, as "1 {_OTHER.get(key.unit, key.unit)}"')
            )
    if key.swept:
        rows.append(("sweep", f"{_SWEEP}; {'averaged over' if key.sampled else 'a dimension of the result'}"))
    rows.append(("default", key.default.strip("`") or ("none: it must be given" if key.required else "not given")))
    lines = [line for name, what in rows for line in _folded(f"  {name:9}" if name.strip() else f"  {name}", what)]
    return "\n".join([*lines, *_lines(inner, "    ")])


#: A unit that is written out, for that of a key.
_OTHER = {"m": "ft", "deg": "rad", "mrad": "deg", "h": "min", "B": "GB", "s": "min"}
_SWEEP = "[A, B, C], {start: A, stop: B, step: C} or {start: A, stop: B, num: N}"


def _example(family: str, key: Key) -> str:
    """The key with a value, from the study to start from, else from one that comes along; empty where none has it."""
    own = parse(families()[family].example(), Path(f"{family}.yaml"))
    others = [(name, source) for name, source in _read() if source.data.get("family") == family]
    for name, source in [(f"heliosweep new {family}", own), *others]:
        value: Any = source.data
        for part in _plain(key).split("."):
            value = value[0] if isinstance(value, list) and value and isinstance(value[0], dict) else value
            value = value.get(part) if isinstance(value, dict) else None
        if value is not None:
            *outer, last = _plain(key).split(".")
            text = f"{last}: {_flow(value)}"
            for block in reversed(outer):
                text = f"{block}: {{{text}}}"
            if len(text) <= _WIDTH:
                return f"  {'example':9}{text}    # {name}"
    return ""


def _flow(value: Any) -> str:
    """A value as YAML on one line."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key}: {_flow(entry)}' for key, entry in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_flow, value))}]"
    if isinstance(value, str):
        plain = re.fullmatch(r"[A-Za-z_][\w./-]*", value) and value.lower() not in ("true", "false", "null")
        return value if plain else json.dumps(value, ensure_ascii=False)
    return json.dumps(value)


def _unknown(wanted: str, chosen: list[str]) -> str:
    """What to say of a key that is not there: those of its block, the nearest first."""
    known = {_plain(key): key for name in chosen for key in _keys(name)}
    ends = [name for name in known if name.endswith(f".{wanted}")]
    others = [name for name in known if wanted.casefold() in name.rpartition(".")[2] and name not in ends]
    told = [f"keys of that name are {', '.join(ends)}"] * bool(ends)
    told += [f"{'others' if ends else 'keys'} with that word are {few_of(others)}"] * bool(others)
    if told:
        return f"unknown key; {'; '.join(told)}"
    if remedy := SYNONYMS.get(wanted.casefold()):
        return f"unknown key; {remedy}"
    word = wanted.casefold().replace("_", " ")
    meant = [name for name, key in known.items() if word in key.meaning.casefold()]
    meant += [
        variable
        for name in chosen
        for variable, attrs in _variables(name).items()
        if wanted.casefold() in variable or word in str(attrs["long_name"]).casefold()
    ]
    if meant:
        return f"unknown key; described with that word are {few_of(dict.fromkeys(meant))}"
    block = wanted.rpartition(".")[0]
    while block and block not in known:
        block = block.rpartition(".")[0]
    beside = [name for name in known if name.rpartition(".")[0] == block]
    results = [variable for name in chosen for variable in _variables(name)]
    near = nearest(wanted, beside) or nearest(wanted, known if "." in wanted else [*known, *results])
    hint = f"did you mean '{near}'? " if near else ""
    if not block and len(chosen) > 1:
        return f"unknown key; {hint or 'heliosweep explain FAMILY lists the keys of a family'}".rstrip()
    where = block or f"a study of {chosen[0]}"
    return f"unknown key; {hint}{where} has {', '.join(beside) or 'no keys of its own'}"
