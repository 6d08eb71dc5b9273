"""Help for writing studies: explanations of keys, commented examples, and shipped studies."""

from __future__ import annotations

import os
import re
import shutil
import sys
import textwrap
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from heliosweep.config import SYNONYMS, Source, few_of, nearest, one_of, parse, read
from heliosweep.config.load import load
from heliosweep.config.study import Key, keys_of
from heliosweep.errors import HeliosweepError, Problem, StudyError
from heliosweep.families.family import families, study_classes
from heliosweep.files import user_path, write_whole
from heliosweep.store.folder import sources_of, target_file


def explain(words: Iterable[str]) -> str:
    """Explain a key of study files or a variable of results.

    Parameters
    ----------
    words : sequence of str
        A family, a dotted key such as ``receiver.height``, or a variable such as ``field_receiver_energy``. A family
        may precede a key or a variable. If only a family is given, all keys of the family are listed.

    Returns
    -------
    str
        Meaning, forms, unit, range, default and an example of the key, or meaning and unit of the variable. The text
        for a block also lists the keys of the block.

    Raises
    ------
    StudyError
        If the family, key or variable does not exist. The message lists keys and variables that have similar names, or
        whose descriptions contain the word.
    """
    given = list(words)
    chosen = [given.pop(0)] if {*given[:1]} & {*families()} else list(families())
    if len(given) > 1:
        raise StudyError(Problem(f"unknown family; use {one_of(families())}", given[0]))
    if not given:
        if len(chosen) > 1:
            raise StudyError(Problem(f"specify a family, a key, or both; the families are {', '.join(families())}"))
        return "\n".join(_lines(_keys(chosen[0])))
    wanted = re.sub(r"\[\d*\]", "", given[0])
    texts: dict[tuple[str, str], dict[str, str]] = {}
    for name in chosen:
        found = [key for key in _keys(name) if _plain(key) == wanted]
        exact = [key for key in found if key.name == re.sub(r"\[\d+\]", "[]", given[0])]
        for key in exact or found:
            texts.setdefault((key.name, _explained(name, key)), {})[name] = _example(name, key)
    for name in () if texts else chosen:
        if attrs := _variables(name).get(wanted):
            unit = str(attrs.get("units", "1")).removeprefix("1")
            kind = f"variable of results{', in ' * bool(unit)}{unit}"
            text = "\n".join(_folded("  ", attrs["long_name"], attrs.get("comment", ""), kind))
            texts.setdefault((wanted, text), {})[name] = ""
    if not texts:
        raise StudyError(Problem(f"unknown key; {_hint(wanted, chosen)}", given[0]))
    return "\n\n".join(
        "\n".join([f"{title}  ({', '.join(names)})", text, *filter(None, names.values())])
        for (title, text), names in texts.items()
    )


def new_study(family: str, target: str | os.PathLike[str] | None = None, *, force: bool = False) -> Path:
    """Write a commented example study of a family (default: ``FAMILY.yaml``), and return the path of the file.

    Raises
    ------
    StudyError
        If the family does not exist, or if the file exists.
    """
    if family not in families():
        near = nearest(family, families())
        hint = f"did you mean {near!r}?" if near else f"use {one_of(families())}"
        raise StudyError(Problem(f"unknown family; {hint}", family))
    file = target_file(target or f"{family}.yaml", force, endings=(".yaml", ".yml"))
    write_whole(file, families()[family].example())
    return file


def shipped() -> dict[str, Path]:
    """Return the shipped study files by name, or an empty mapping if no files are installed."""
    # folder in the installed package, and folder in the working copy
    folders = (Path(__file__).parents[1] / "studies", Path(__file__).parents[3] / "studies")
    folder = next(filter(Path.is_dir, folders), folders[0])
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def examples() -> str:
    """Return a list of shipped studies as text, sorted by family.

    Each line contains the name, family and title of a study.
    """
    told = sorted((str(source.data.get("family")), name, str(source.data.get("title"))) for name, source in _read())
    if not told:
        raise HeliosweepError("this installation has no studies; they are in the folder studies/ of the source code")
    width, inner = (max(len(entry[i]) for entry in told) for i in (1, 0))
    return "\n".join(f"{name:{width}}  {family:{inner}}  {title}" for family, name, title in told)


def copy_examples(names: Iterable[str], folder: str | os.PathLike[str], *, force: bool = False) -> list[Path]:
    """Copy shipped studies and their input files to a folder, and return the copied study files.

    Raises
    ------
    StudyError
        If a study does not exist, or if an existing file would be replaced. In both cases, no file is copied.
    """
    known, place = shipped(), user_path(folder)
    wanted: dict[Path, Path] = {}
    for name in dict.fromkeys(name.removesuffix(".yaml") for name in names):
        if name not in known:
            near = nearest(name, known)
            hint = f"did you mean {near!r}?" if near else "'heliosweep examples' lists all names"
            raise StudyError(Problem(f"no shipped study has this name; {hint}", name))
        home = known[name].parent
        for file in sources_of(load(known[name], study_classes())):
            if file.is_relative_to(home):  # files outside this folder are part of a package
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
    return [(name, read(path)) for name, path in shipped().items()]


@cache
def _variables(family: str) -> dict[str, Mapping[str, Any]]:
    """Return the attributes of each variable in the results of shipped studies."""
    studies = (
        load(shipped()[name], study_classes()) for name, source in _read() if source.data.get("family") == family
    )
    return {name: one.attrs for study in studies for name, one in families()[family].variables(study).items()}


def _plain(key: Key) -> str:
    """Return the name of a key without the suffix ``[]`` of lists."""
    return key.name.replace("[]", "")


def _lines(keys: Iterable[Key], indent: str = "") -> list[str]:
    texts = {one.name: f"{one.meaning or one.value}{f' [{one.unit}]' if one.unit else ''}" for one in keys}
    width = max(map(len, texts), default=0)
    return [line for name, text in texts.items() for line in _folded(indent, f"{name:{width}}  {text}")]


def _folded(indent: str, *texts: str) -> list[str]:
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else sys.maxsize
    further: Any = {"subsequent_indent": f"{indent}    ", "break_long_words": False, "break_on_hyphens": False}
    return [line for text in texts for line in textwrap.wrap(text, width, initial_indent=indent, **further)]


def _explained(family: str, key: Key) -> str:
    inner = [one for one in _keys(family) if one.name.startswith((f"{key.name}.", f"{key.name}[]."))]
    lines = _folded("  ", f"{key.meaning}{f' (only with {key.only})' if key.only else ''}".replace("`", ""))
    lines += _folded("    ", *(f"{name}: {meaning}" for name, meaning in key.options))
    other = {"m": "ft", "deg": "rad", "mrad": "deg", "h": "min", "B": "GB", "s": "min"}
    swept = "averaged over" if key.sampled else "a dimension of the result"
    rows = {
        "value": key.value.replace("`", "") * (not inner),
        "unit": f'{key.unit}; other units must be written out, such as "1 {other.get(key.unit, key.unit)}"'
        * (bool(key.unit) and not inner),
        "sweep": f"[A, B, C], {{start: A, stop: B, step: C}} or {{start: A, stop: B, num: N}}; {swept}" * key.swept,
        "default": key.default.strip("`") or ("none; the key is required" if key.required else "not given"),
    }
    lines += _folded("  ", *(f"{name:9}{text}" for name, text in rows.items() if text))
    return "\n".join([*lines, *_lines(inner, "    ")])


def _example(family: str, key: Key) -> str:
    own = parse(families()[family].example(), Path(f"{family}.yaml"))
    others = [(name, source) for name, source in _read() if source.data.get("family") == family]
    for name, source in [(f"heliosweep new {family}", own), *others]:
        value: Any = source.data
        for part in _plain(key).split("."):
            value = value[0] if isinstance(value, list) and value and isinstance(value[0], dict) else value
            value = value.get(part) if isinstance(value, dict) else None
        if value is not None:
            for part in reversed(_plain(key).split(".")):
                value = {part: value}
            text = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=1000, allow_unicode=True)
            if len(text) <= 100:  # longer examples are not shown
                return f"  {'example':9}{text.strip()[1:-1]}    # {name}"
    return ""


def _hint(wanted: str, chosen: list[str]) -> str:
    known = {_plain(key): key.meaning for name in chosen for key in _keys(name)}
    word, block, keys = wanted.casefold(), wanted.rpartition(".")[0], list(known)
    for name in chosen:
        known |= {variable: attrs["long_name"] for variable, attrs in _variables(name).items()}
    if alike := [name for name in keys if word in name.rpartition(".")[2]]:
        return f"keys with this word are {few_of(sorted(alike, key=lambda name: not str(name).endswith(f'.{word}')))}"
    if remedy := SYNONYMS.get(word):
        return remedy
    words = word.replace("_", " ")
    if meant := [name for name, meaning in known.items() if word in name or words in meaning.casefold()]:
        return f"this word is in the descriptions of {few_of(meant)}"
    siblings = [name for name in keys if name.rpartition(".")[0] == block]
    near = nearest(wanted, siblings) or nearest(wanted, known)
    hint = f"did you mean '{near}'? " * bool(near)
    if siblings and (block or len(chosen) == 1):
        hint += f"{block or f'a study of {chosen[0]}'} has {', '.join(siblings)}"
    return hint.strip() or "heliosweep explain FAMILY lists the keys of a family"
