# ruff: noqa: E501
"""Mutated study files: what typing errors, bad disks and bad intentions make of the studies that we ship.

Every mutation follows from a seed alone, so that a failing file can be made again: ``python -m tests.faults.mutations
SEED`` prints it.
"""

from __future__ import annotations

import copy
import os
import re
import shutil
import struct
import sys
import zlib
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import islice
from pathlib import Path
from random import Random
from typing import Any, TypeAlias

import yaml

from heliosweep.families.family import families
from tests.conftest import STUDIES

#: Folders of tables and images that the shipped studies name.
TABLES = ("images", "layouts", "published", "sites", "spots")

#: Names of files that are none, or that nobody should read whole; `hostile_folder` makes the relative ones.
FILES = [
    "../../x", "../../../../etc/passwd", "/etc/shadow", "/dev/zero", "/dev/stdin", "/proc/self/mem", "/proc/self/fd/0",
    "/proc/self/environ", "/proc/self/cmdline", "fifo", "folder", "loop", "sparse.csv", "sparse.png", "binary.csv",
    "empty.csv", "wide.csv", "long.csv", "quotes.csv", "nan.csv", "markup.csv", "bomb.png", "truncated.png",
    "utf16.csv", "nul.csv", "unreadable.csv", "layouts", "layouts/chong2012.csv", "sites/liu2022.csv",
    "images/sun.png", "images/sun_profile.csv", "spots/heliostats.csv", "published/liu2022_table2.csv",
    "'a\\0b'", '"a\\0b"', "~/x", "$HOME/x", "http://example.org/x.csv", "//server/share/x", "C:\\x", ".", "''", "n" * 300,
    "'" + "a/" * 3000 + "x'",
]  # fmt: skip

#: Scalars that are hard to read or hard to live with.
SCALARS = [
    ".nan", "-.nan", ".inf", "-.inf", "nan", "inf", "Infinity", "1e308", "-1e308", "1e309", "1e-308", "5e-324", "1e300",
    "9.99e299", "1" + "0" * 400, "-" + "9" * 60, "0." + "0" * 400 + "1", "1e" + "9" * 50, "1e-" + "9" * 50, "-0", "-0.0",
    "0", "1", "-1", "0x7fffffffffffffff", "0o777", "0b11", "1_000", "9007199254740993", "18446744073709551616",
    "2147483648", "", "~", "null", "true", "no", "''", '""', "' '", "'\t'", '"\\0"', '"\\e[2J\\e[31m"', '"\\a\\b\\x7f"',
    '"\\ud800"', '"\\uDC80"', '"\\u202e evil \\u202c"', "\u202e evil", "\u200b", "\ufeff", "\u0663", "\u00bd", "\u221e",
    "\u2212" "5", "\U0001f600", "e\u0301", "\u2028", "\u0085", '"\\r\\n"', '"a\\nb"', "A" * 5000, "'" + "\u00e9" * 3000 + "'",
    "1 m", "1 km", "5 kg", "3 dge", "1e400 deg", "1e308 km", "-1 mm", "38 ft", "1.2 mrad", "0.1 deg", "90 deg", "1 rad",
    "50 %", "2 h", "'1'", "'1 deg '", "1deg", "deg", "1 1 deg", "12:30", "24:00", "25:61", "'07:00'", "2021-02-29",
    "2021-06-21", "9999-12-31", "0000-00-00", "+08:00", "+99:99", "Asia/Shanghai", "../../etc/localtime", "/etc/localtime",
    "posixrules", "Factory", "<script>alert(1)</script>", "'\"><img src=x onerror=alert(1)>'", "'&lt;b&gt;'",
    "'{{7*7}}'", "'%s%n'", "'$(id)'", "'`id`'", "'; rm -rf .'", "[/red]", "solar", "civil", "none", "all",
    "spinning_elevation", "azimuth_elevation", "field_efficiency", "misalignment", "dish_tracking", "backward_gazing",
    "1e400", "0.1", "0.5", "2", "3", "7", "45", "100", "365", "366", "1000", "1000000", "1e15", "1000000000000000",
]  # fmt: skip

#: Lists, ranges, distributions and what YAML offers beyond plain data.
STRUCTURES = [
    "[]", "{}", "[[]]", "[{}]", "{{}: {}}", "[[1, 2], [3]]", "{a: {b: {c: {d: 1}}}}", "[1, 1.0]", "[0, -0.0]", "[~]",
    "[1, x, ~, []]", "[0, 15, 30]", "[1, 2, 3]", "[0.1, 0.2]", "[.nan, .nan]", "[1e308, -1e308]", "{1: 2}", "{~: 1}",
    "{a: 1, a: 2}", "{? [a] : b}", "{? {a: b} : c}", "{true: 1}", "{'': 1}",
    "{start: 0, stop: 1e12, step: 1e-9}", "{start: 0, stop: 345, step: 15}", "{start: 0, stop: 5, num: 101}",
    "{start: 0, stop: 1, num: 1000000000}", "{start: 1, stop: 2, num: 1000000000000000}", "{start: 0, stop: 24, num: 100000000}",
    "{start: 1, stop: 365, step: 1}", "{start: 7, stop: 17, step: 1e-7}", "{start: 7, stop: 17, step: 1}",
    "{start: 10, stop: 0, step: -1}", "{start: 0, stop: 10, step: -1}", "{start: 0, stop: 10, step: 0}",
    "{start: .nan, stop: .inf, step: 1}", "{start: 1e308, stop: -1e308, num: 3}", "{start: 9e299, stop: -9e299, step: 1e299}",
    "{start: 1e-320, stop: 1, step: 1e-320}", "{start: 1, stop: 1.0000000000000002, num: 2}", "{start: 1, stop: 1, num: 1}",
    "{start: 0, stop: 0, step: 1}", "{start: 1, stop: 2, num: -1}", "{start: 1, stop: 2, num: .nan}", "{start: 1, stop: 2, num: .inf}",
    "{start: 1, stop: 2, num: 1" + "0" * 300 + "}", "{start: 1, stop: 2, num: 3, step: 1}", "{start: 1}", "{strat: 1, stop: 2, num: 2}",
    "{logspace: {start: 1, stop: 100, num: 3}}", "{logspace: {start: 1e-300, stop: 1e299, num: 1000000000}}",
    "{logspace: {start: -1, stop: 1, num: 3}}", "{logspace: 3}", "{logspace: {start: 5e-324, stop: 1, num: 7}}",
    "{start: 2021-01-01, stop: 2021-12-31}", "{start: 1700-01-01, stop: 2200-12-31, step: 1}", "{start: 2021-01-01, stop: 2020-01-01}",
    "[2021-06-21, 2021-12-21]", "{normal: [0, 1]}", "{normal: [0, 1], samples: 1000000000, seed: 7}", "{normal: [0, -1]}",
    "{normal: [.nan, .inf]}", "{normal: [1e299, 1e299]}", "{uniform: [-1, 1], samples: 5, seed: 9223372036854775807}",
    "{uniform: [1, -1]}", "{uniform: [0]}", "{lognormal: [0, 1]}", "{normal: [0, 1], uniform: [0, 1]}",
    "{normal: [[0, 1], 1]}", "{samples: 10}", "{normal: [0, 1], samples: 1.5, seed: -1}",
    "!!python/object/apply:os.system ['true']", "!!python/object:os.system x", "!!python/name:os.system", "!!python/tuple [1]",
    "!!binary aGVsbG8=", "!!set {a, b}", "!!omap [a: 1]", "!!str 1", "!!float 1", "!!timestamp 2021-01-01", "!local x", "! x",
    "!<tag:yaml.org,2002:str> x", "&a 1", "&a [*a]", "*a", "*unknown", "&a {b: *a}", "{<<: {a: 1}}", "{<<: *a}", "<<",
    "|", ">", "|+9", "@x", "`x", "%x", "[", "{", "]", "}", "'", '"', "? ", ": ", "- ", "#", "---", "...", "--- a",
    "[" * 40 + "]" * 40, "[" * 60 + "]" * 60, "{a: " * 45 + "1" + "}" * 45, "{a: " * 70 + "1" + "}" * 70, "[" * 3000,
    "[" + "1, " * 3000 + "2]", "[" + ", ".join(str(number) for number in range(3000)) + "]",
    "[" + ", ".join(f"x{number}" for number in range(500)) + "]", "{" + ", ".join(f"k{number}: 1" for number in range(1000)) + "}",
    "[" + "[1, 2], " * 1000 + "3]", "[" + "{a: 1}, " * 1000 + "3]", "[" + "{name: a, latitude: 1}, " * 1000 + "3]",
    "[" + "{name: a, latitude: 91, timezone: Nowhere/Land}, " * 300 + "3]",
]  # fmt: skip

KEYS = [
    "", "'../../x'", "a/b", "'a.b'", "'a[0]'", "1", "true", "~", "'\\n'", '"\\n\\e[2J"', "<b>", "__class__", "__init__",
    "model_config", "_source", "self", "family", "zip", "k" * 500, "\u202e", "\u00e9", "'<<'", "<<", "? [a]", "*a", "&a b",
]  # fmt: skip

#: What a file may be filled with to its largest size, and where.
FLOODS = [
    "[", "{a: ", "1, ", "[], ", "{}, ", "- ", "? ", "a: 1\n", "- - - 1\n", "# \n", "\n", " ", "'", "[1, [2, ", "&a ", "!!x ",
    "{name: a, latitude: 91}, ", "{x: y}, ", "{latitude: 1, name: b, timezone: x}, ", "~, ", "0.1, ", "xyz, ", "''", "\\", "<<: ",
    "? a\n", "a,", ".nan, ", "\u00e9", "1 m, ", "1e308, ", "-", "|\n", "%", "---\n", "\t", "\r",
]  # fmt: skip
FLOOD_HEADS = [
    "x: [", "zip: [", "zip: [[", "sites: [", "references: [", "title: ", "title: '", "", "x:\n  ", "execution: {chunks: {",
    "x: " + "[" * 45, "{" * 45, "site: {latitude: [", "time: {clock: solar, hours: [",
]  # fmt: skip

_TOKEN = "HOSTILE{}VALUE"

Change = Callable[[str, Random], str]


@cache
def corpus() -> tuple[str, ...]:
    """Return the text of every study that we ship, and of the example of every family."""
    shipped = (path.read_text(encoding="utf-8") for path in sorted(STUDIES.glob("*.yaml")))
    return (*shipped, *(family.example() for _, family in sorted(families().items())))


def mutated(seed: int) -> bytes:
    """Return the content of the mutated study file of a seed."""
    random = Random(seed)
    text = random.choice(corpus())
    gentle = random.random() < 0.35  # few changes that keep the form: some of these can run
    for _ in range(1 if gentle else random.choice((1, 1, 2, 3, 6))):
        if len(text) > 2**21:
            break
        text = random.choice(_GENTLE if gentle else _CHANGES)(text, random)
    content = text.encode("utf-8", errors="surrogatepass")
    return content if gentle or random.random() < 0.85 else random.choice(_ENCODINGS)(content, random)


def hostile_folder(folder: Path) -> Path:
    """Fill a folder with the tables of the shipped studies and with files that should not be read; return it."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in TABLES:
        shutil.copytree(STUDIES / name, folder / name)
    os.mkfifo(folder / "fifo")
    (folder / "folder").mkdir()
    (folder / "loop").symlink_to("loop")
    for name in ("sparse.csv", "sparse.png"):
        with (folder / name).open("wb") as file:
            file.truncate(20 * 2**30)
    (folder / "binary.csv").write_bytes(Random(1).randbytes(5000))
    (folder / "empty.csv").touch()
    (folder / "wide.csv").write_text(",".join(["x", "y", *map(str, range(5000))]) + "\n" + "1," * 5002)
    (folder / "long.csv").write_text("name,latitude\n" + "".join(f"n{number},91\n" for number in range(20_000)))
    (folder / "quotes.csv").write_text('name,latitude\n"' + "a" * 200_000)
    (folder / "nan.csv").write_text("name,x,y,latitude,width,height\na,nan,inf,nan,1e308,-1\nb,1e309,,-inf,0,nan\n")
    (folder / "markup.csv").write_text("name,x,y,<script>,latitude\n<b>a</b>,10,20,<i>,1\n../../x,30,40,1,2\n")
    (folder / "utf16.csv").write_bytes("x,y\n1,2\n".encode("utf-16"))
    (folder / "nul.csv").write_bytes(b"x,y\n1,\0\n")
    (folder / "unreadable.csv").write_text("x,y\n1,2\n")
    (folder / "unreadable.csv").chmod(0)
    (folder / "bomb.png").write_bytes(png(50_000, 50_000, chunk(b"IDAT", zlib.compress(bytes(100_000), 9))))
    (folder / "truncated.png").write_bytes((STUDIES / "images/sun.png").read_bytes()[:200])
    return folder


def chunk(kind: bytes, data: bytes = b"") -> bytes:
    """Return a chunk of a PNG."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width: int, height: int, *chunks: bytes, depth: int = 8) -> bytes:
    """Return a PNG that claims to be of that size, whatever its chunks hold."""
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + b"".join([header, *chunks, chunk(b"IEND")])


def _raw(random: Random) -> str:
    return random.choice(random.choice((SCALARS, SCALARS, STRUCTURES, STRUCTURES, FILES)))


# Changes of the text.


def _lines(change: Callable[[list[str], int, Random], None]) -> Change:
    def changed(text: str, random: Random) -> str:
        lines = text.split("\n")
        change(lines, random.randrange(len(lines)), random)
        return "\n".join(lines)

    return changed


def _delete(lines: list[str], at: int, random: Random) -> None:
    del lines[at : at + random.choice((1, 1, 2, 5))]


def _duplicate(lines: list[str], at: int, random: Random) -> None:
    lines[at:at] = [lines[at]] * random.choice((1, 1, 2, 50))


def _swap(lines: list[str], at: int, random: Random) -> None:
    other = random.randrange(len(lines))
    lines[at], lines[other] = lines[other], lines[at]


def _indent(lines: list[str], at: int, random: Random) -> None:
    indent = random.choice((" ", "  ", "\t", " " * 200, "- ", "\u00a0", ""))
    lines[at] = indent + lines[at].lstrip(random.choice((" ", "")))


def _replace_after_colon(lines: list[str], at: int, random: Random) -> None:
    key, colon, _ = lines[at].partition(":")
    lines[at] = f"{key}{colon or ':'} {_raw(random)}"


def _insert(lines: list[str], at: int, random: Random) -> None:
    lines.insert(at, f"{random.choice((random.choice(KEYS), random.choice(_known_keys())))}: {_raw(random)}")


def _block_scalar(lines: list[str], at: int, random: Random) -> None:
    lines[at] = lines[at].partition(":")[0] + random.choice((": |", ": >", ": |-", ": >+9", ":"))


def _word(text: str, random: Random) -> str:
    words = text.split(" ")
    words[random.randrange(len(words))] = _raw(random)
    return " ".join(words)


def _characters(text: str, random: Random) -> str:
    characters, odd = list(text), "\t\r\n\x00\x07\x1b\x7f\u202e\ufeff\u2028{}[]:,&*!|>'\"%@`#?- 0"
    for _ in range(random.choice((1, 2, 5))):
        at = random.randrange(len(characters) or 1)
        characters[at : at + random.choice((0, 1))] = random.choice(odd)
    return "".join(characters)


def _splice(text: str, random: Random) -> str:
    other = random.choice(corpus())
    return text[: random.randrange(len(text) + 1)] + other[random.randrange(len(other)) :]


def _interleave(text: str, random: Random) -> str:
    lines = [*text.split("\n"), *random.choice(corpus()).split("\n")]
    random.shuffle(lines)
    return "\n".join(lines[: random.randrange(5, len(lines))])


def _bomb(text: str, random: Random) -> str:
    bomb = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    bomb += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, random.choice((3, 9, 30)))]
    return random.choice(("\n".join(bomb) + "\n" + text, text + "\n" + "\n".join(bomb)))


def _flood(text: str, random: Random) -> str:
    return flooded(text, random.choice(FLOODS), random.choice(FLOOD_HEADS), random.choice((10_000, 300_000, 1_040_000)))


def flooded(text: str, piece: str, head: str, length: int) -> str:
    """Return a study with as much as that of something small at its end."""
    return f"{text}\n{head}{piece * ((length - len(text)) // len(piece))}"


# Changes of the structure, and of numbers, that keep the rest readable.


def places_of(data: Any) -> Iterator[tuple[Any, Any]]:
    """Container and key of every value."""
    if isinstance(data, dict | list):
        for key, value in list(data.items() if isinstance(data, dict) else enumerate(data)):
            yield data, key
            yield from places_of(value)


Places: TypeAlias = list[tuple[Any, Any]]


def _structure(change: Callable[[Any, Places, dict[str, str], Random], None]) -> Change:
    def changed(text: str, random: Random) -> str:
        if len(text) > 50_000:  # PyYAML's composer overflows the stack where nesting is deep
            return _word(text, random)
        try:
            data = yaml.load(text, Loader=getattr(yaml, "CBaseLoader", yaml.BaseLoader))
        except (yaml.YAMLError, ValueError, RecursionError):
            return _word(text, random)
        found = list(islice(places_of(data), 5001))  # an alias bomb has more than anyone can list
        if not found or len(found) > 5000:
            return _word(text, random)
        raw: dict[str, str] = {}
        change(data, found, raw, random)
        try:
            flow = random.random() < 0.2
            text = yaml.dump(data, sort_keys=False, allow_unicode=True, width=120, default_flow_style=flow)
        except (yaml.YAMLError, RecursionError):
            return text
        for token, words in raw.items():
            text = text.replace(token, words)
        return re.sub(r"'([-+.0-9eE]+|true|false)'", r"\1", text)  # which the loader read as text

    return changed


@_structure
def _replace_values(data: Any, places: Places, raw: dict[str, str], random: Random) -> None:
    for number in range(random.choice((1, 1, 2, 5))):
        where, key = random.choice(places)
        token = _TOKEN.format(number)
        raw[token] = _raw(random)
        where[key] = token


@_structure
def _add_keys(data: Any, places: Places, raw: dict[str, str], random: Random) -> None:
    mappings = [data, *(where[key] for where, key in places if isinstance(where[key], dict))]
    for number in range(random.choice((1, 1, 3))):
        token = _TOKEN.format(number)
        raw[token] = _raw(random)
        random.choice(mappings)[random.choice(_known_keys())] = token


@_structure
def _graft(data: Any, places: Places, raw: dict[str, str], random: Random) -> None:
    """Put a block of another study in place of the block of that name, or of any."""
    other = yaml.load(random.choice(corpus()), Loader=yaml.BaseLoader)
    source, name = random.choice(list(places_of(other)))
    same = [(where, key) for where, key in places if key == name]
    where, key = random.choice(same or places)
    where[key] = copy.deepcopy(source[name])


@_structure
def _wrap(data: Any, places: Places, raw: dict[str, str], random: Random) -> None:
    where, key = random.choice(places)
    value = where[key]
    swept = {"start": value, "stop": value, "num": 1}
    where[key] = random.choice(([value], [value, value], {"file": value}, swept, {key: value}))


@_structure
def _remove(data: Any, places: Places, raw: dict[str, str], random: Random) -> None:
    where, key = random.choice(places)
    del where[key]


def _numbers(places: Places, random: Random, counts: tuple[int, ...]) -> Places:
    """Some of the places of numbers: so many as one of `counts`, or two."""
    numbers = [(where, key) for where, key in places if isinstance(where[key], str) and _is_number(where[key])]
    return random.sample(numbers, min(len(numbers), random.choice(counts) if counts else 2))


def _changed_numbers(factors: Sequence[float], offsets: Sequence[float], digits: int, *counts: int) -> Change:
    @_structure
    def change(data: Any, places: Places, raw: dict[str, str], random: Random) -> None:
        for where, key in _numbers(places, random, counts):
            changed = float(where[key]) * random.choice(factors) + random.choice(offsets)
            where[key] = f"{changed:.{digits}g}"

    return change


_FACTORS = (0, -1, 0.5, 2, 3, 10, 0.1, 1e-3, 1e3, 1e6, 1e-6, 1e9, 1e15, 1e-12, 1e150, 1e-150)
_scale_numbers = _changed_numbers(_FACTORS, (0, 0, 0, 1, -1, 0.37), 12, 1, 1, 2, 4)
_nudge_numbers = _changed_numbers((0.5, 0.9, 1, 1.1, 2), (-1, 0, 0, 1), 6)


@_structure
def _sweep_numbers(data: Any, places: Places, raw: dict[str, str], random: Random) -> None:
    for number, (where, key) in enumerate(_numbers(places, random, (1, 2, 4))):
        value = float(where[key])
        raw[token := _TOKEN.format(number)] = random.choice((
            f"[{value:.12g}, {value * 1.5 + 1:.12g}]",
            f"{{start: {value:.12g}, stop: {value + 2:.12g}, num: {random.choice((2, 3, 1000, 10**6, 10**9, 10**14))}}}",
            f"{{start: {value:.12g}, stop: {value * 2 + 1:.12g}, step: {random.choice(('1', '0.25', '1e-6', '1e-12'))}}}",
            f"{{logspace: {{start: {value:.12g}, stop: {value * 2:.12g}, num: 3}}}}",
            f"{{normal: [{value:.12g}, 0.1]}}",
        ))  # fmt: skip
        where[key] = token


@_structure
def _options(data: Any, places: Places, raw: dict[str, str], random: Random) -> None:
    """Change what never changes a number."""
    lengths = random.choice(("1", "7", "1000000000000", "0", "x", "18446744073709551616"))
    names = random.choice(("time", "hour", "heliostat", "site", "nowhere", "latitude", "seed", "'../../x'", "''"))
    raw["OPTIONS"] = random.choice((
        f"{{chunks: {{{names}: {lengths}}}}}", f"{{workers: {lengths}}}", f"{{memory: {lengths}}}", "{memory: 1 GB}",
        f"{{scheduler: {random.choice(('threads', 'processes', 'synchronous', 'tcp://0.0.0.0:1', 'dask'))}}}",
        "{time_series: true}", "{time_series: true, compression: zlib, compression_level: 9}", "{compression: pickle}",
        f"{{published: {{file: {random.choice(FILES)}, source: x}}}}",
    ))  # fmt: skip
    if isinstance(data, dict):
        data[random.choice(("execution", "execution", "output", "report"))] = "OPTIONS"


@_structure
def _title(data: Any, places: Places, raw: dict[str, str], random: Random) -> None:
    raw[token := _TOKEN.format(0)] = random.choice(SCALARS)
    key = random.choice(("title", "description", "references"))
    if isinstance(data, dict):
        data[key] = [token] if key == "references" else token


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


@cache
def _known_keys() -> tuple[str, ...]:
    """Return every key of the shipped studies and of the schemas of all families."""
    from heliosweep.config.study import json_schema

    keys = {str(key) for text in corpus() for where, key in places_of(yaml.safe_load(text)) if isinstance(where, dict)}
    for _, family in sorted(families().items()):
        found = (where[key] for where, key in places_of(json_schema(family.study_class())) if key == "properties")
        keys |= {name for properties in found if isinstance(properties, dict) for name in properties}
    return tuple(sorted(keys))


# Changes of the bytes.


def flip(content: bytes, random: Random) -> bytes:
    """Change some bytes."""
    data = bytearray(content)
    for _ in range(random.choice((1, 3, 30))):
        if data:
            data[random.randrange(len(data))] = random.randrange(256)
    return bytes(data)


def _recode(codec: str) -> Callable[[bytes, Random], bytes]:
    return lambda content, random: content.decode("utf-8", errors="replace").encode(codec, errors="replace")


#: Of any text, lines of which mean something.
TEXT_CHANGES: list[Change] = [
    *map(_lines, (_delete, _duplicate, _swap, _indent)), _characters,
    lambda text, random: text[: random.randrange(len(text) + 1)],
]  # fmt: skip
_CHANGES: list[Change] = [
    *TEXT_CHANGES, *map(_lines, (*[_replace_after_colon] * 2, _insert, _insert, _block_scalar)),
    _word, _splice, _interleave,
    lambda text, random: text + random.choice(("\n---\n", "\n...\n", "\n", "")) + text,
    _bomb, _replace_values, _replace_values, _replace_values,
    _add_keys, _add_keys, _graft, _wrap, _remove, _scale_numbers, _sweep_numbers,
    lambda text, random: _flood(text, random) if random.random() < 0.15 else _word(text, random),
]  # fmt: skip
_GENTLE: list[Change] = [
    _nudge_numbers, _nudge_numbers, _nudge_numbers, _options, _options, _title, _scale_numbers, _scale_numbers,
    _sweep_numbers, _replace_values, _add_keys, _graft, _remove, _wrap, _title,
]  # fmt: skip
_ENCODINGS: list[Callable[[bytes, Random], bytes]] = [
    flip, flip, _recode("utf-16"), _recode("utf-32"), _recode("latin-1"), _recode("utf-8-sig"),
    lambda content, random: b"\xef\xbb\xbf" * 2 + content,
    lambda content, random: content.replace(b"\n", b"\r\n"),
    lambda content, random: content.replace(b"\n", b"\r"),
    lambda content, random: content.replace(b"  ", b"\t"),
    lambda content, random: content[: random.randrange(len(content) + 1)],
    lambda content, random: b"\0" * random.choice((1, 512)) + content,
    lambda content, random: b"\xed\xa0\x80" + content,
]  # fmt: skip

if __name__ == "__main__":
    sys.stdout.buffer.write(mutated(int(sys.argv[1])))
