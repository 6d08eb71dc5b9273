"""Mutated tables and images that studies name: which file it is, and who reads it, follow from a seed alone."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random

import numpy as np
import yaml
from PIL import Image

from heliosweep import api
from heliosweep.families.backward_gazing.files import read_disc, read_picture
from heliosweep.families.misalignment.spots_file import read_spots
from heliosweep.layouts import read_csv
from heliosweep.report.comparison import read_published
from tests.conftest import SMALL, STUDIES
from tests.faults.mutations import KEYS, SCALARS, TEXT_CHANGES, flip
from tests.share.test_solarpilot import EXPORT

EPW = "LOCATION,Dunhuang,Gansu,CHN,CSWD,524180,40.15,94.68,8.0,1139.0\nDESIGN CONDITIONS,0\n"
TMY3 = '723815,"DAGGETT BARSTOW",CA,-8.0,34.850,-116.800,586\nDate (MM/DD/YYYY),Time (HH:MM),ETR (W/m^2)\n'
WEATHER = "1999,1,1,1,60,?9?9,-13.0,-17.4,69,87100,0,0,252,0,0,0,0,0,0,0,40,1.6,0,0,20.2,77777,9\n"


def _through_a_study(key: str) -> Callable[[Path], object]:
    """What loads a study that names the file under a key."""

    def read(path: Path) -> object:
        study = path.with_name(f"with_{key}.yaml")
        if not study.exists():
            kept = {name: value for name, value in SMALL.items() if name != "site"}
            study.write_text(yaml.safe_dump({**kept, key: {"file": path.name}}))
        return api.plan(api.load(study))

    return read


#: From here on a file is mutated no further, and a change repeats no more than that: columns and lines would multiply.
LARGEST, MOST_REPEATED = 4 * 2**20, 16 * 2**20

#: Who reads a file of each kind.
READERS: dict[str, Callable[[Path], object]] = {
    "layout": read_csv,
    "sites": _through_a_study("sites"),
    "weather": _through_a_study("site"),
    "spots": lambda path: read_spots(path, 4, ("A1", "A2", "B1", "B2")),
    "profile": lambda path: read_disc(path, path.name),
    "published": read_published,
    "image": read_picture,
}


@cache
def originals() -> tuple[tuple[str, bytes], ...]:
    """Return the files that are mutated, each with its kind."""
    from astropy.io import fits

    shipped = {"layouts/chong2012": "layout", "spots/heliostats": "layout", "sites/liu2022": "sites"}
    shipped |= {"spots/four_heliostats": "spots", "images/sun_profile": "profile"}
    shipped |= {f"published/{path.stem}": "published" for path in sorted((STUDIES / "published").glob("*.csv"))}
    found = [(kind, (STUDIES / f"{name}.csv").read_bytes()) for name, kind in shipped.items()]
    found += [("layout", EXPORT.encode()), ("layout", b"0,1126.85,1362.1,0\n0,36.59,879.35,-1.5\n")]
    found += [("weather", (head + 9 * WEATHER).encode()) for head in (EPW, TMY3)]
    levels = (np.add.outer(np.arange(24), np.arange(32)) * 53).astype(np.uint16)
    for form, options in (("PNG", {}), ("TIFF", {}), ("TIFF", {"compression": "tiff_deflate"})):
        Image.fromarray(levels).save(file := io.BytesIO(), form, **options)
        found.append(("image", file.getvalue()))
    unit, rows = fits.PrimaryHDU(levels.astype(np.int16)), np.tile(levels, (3, 3)).astype(np.int16)
    unit.header["FOCALPIX"] = 2650.5
    for units in ([unit], [fits.PrimaryHDU(), fits.CompImageHDU(rows)]):
        fits.HDUList(units).writeto(file := io.BytesIO())
        found.append(("image", file.getvalue()))
    np.save(file := io.BytesIO(), levels)
    return *found, ("image", file.getvalue())


def mutated(seed: int) -> tuple[str, bytes]:
    """Return the kind and the content of the file of a seed."""
    random = Random(seed)
    kinds = list(READERS)
    kind = random.choice([*kinds, *["image"] * len(kinds)])
    content = random.choice([content for other, content in originals() if other == kind])
    for _ in range(random.choice((1, 1, 2, 5))):
        if len(content) > LARGEST:
            break
        if kind == "image":
            content = random.choice(_BYTES)(content, random)
        else:
            text = content.decode("utf-8", errors="surrogateescape")
            content = random.choice(_TEXT)(text, random).encode("utf-8", errors="surrogatepass")
    return kind, content if random.random() < 0.9 else flip(content, random)


def _cells(text: str, random: Random) -> str:
    """Other words in the place of some cells, of the header too."""
    lines = text.split("\n")
    for _ in range(random.choice((1, 1, 3))):
        at = random.choice((random.randrange(len(lines)), 0, 1)) % len(lines)
        cells = lines[at].split(",")
        cells[random.randrange(len(cells))] = random.choice((random.choice(SCALARS), random.choice(KEYS)))
        lines[at] = ",".join(cells)
    return "\n".join(lines)


def _columns(text: str, random: Random) -> str:
    """A column removed, repeated, or more often than anyone has columns."""
    rows = [line.split(",") for line in text.split("\n")]
    at, times = random.randrange(4), random.choice((0, 0, 2, 2, 2000 if len(rows) < 1000 else 2))
    times = min(times, _room(sum(len(cell) for cells in rows for cell in cells[at : at + 1])))
    return "\n".join(",".join([*cells[:at], *cells[at : at + 1] * times, *cells[at + 1 :]]) for cells in rows)


def _room(size: int) -> int:
    """How often so many characters may be repeated."""
    return MOST_REPEATED // (size + 1) + 1


def _many(text: str, random: Random) -> str:
    """A line again and again."""
    lines = text.split("\n")
    at, times = random.randrange(len(lines)), 10 ** random.choice((2, 2, 3, 5))
    times = min(times, _room(len(lines[at])))
    return "\n".join([*lines[:at], *lines[at : at + 1] * times, *lines[at:]])


def _numbers(content: bytes, random: Random) -> bytes:
    """A number of the file, or of what its numbers tell, that is as large or small as can be."""
    form = random.choice((">H", "<H", ">I", "<I"))
    number = struct.pack(form, random.choice((0, 1, 2**15, 2**16 - 1)))
    at = random.randrange(min(len(content), random.choice((64, 10**9))) or 1)
    return content[:at] + number + content[at + len(number) :]


def _card(content: bytes, random: Random) -> bytes:
    """Another word in the text of a header."""
    head = content[:2880].decode("latin-1")
    words = [word for word in head.split() if word.isalnum()] or ["0"]
    new = random.choice([*words, "0", "-1", "1E400", "99999999999", "T", "'x", "NAN", "2"])
    old = random.choice(words)
    return head.replace(old, new.ljust(len(old)), 1).encode("latin-1") + content[2880:]


def _chunk(content: bytes, random: Random) -> bytes:
    """A chunk of a PNG that is changed, repeated or left out, with the right sum of its bytes."""
    if not content.startswith(b"\x89PNG"):
        return _numbers(content, random)
    chunks, at = [], 8
    while at + 12 <= len(content):
        (size,) = struct.unpack(">I", content[at : at + 4])
        chunks.append((content[at + 4 : at + 8], content[at + 8 : at + 8 + size]))
        at += 12 + size
    if chunks:
        which = random.randrange(len(chunks))
        kind, data = chunks[which]
        packed = zlib.compress(bytes(10 ** random.choice((3, 7))))
        kind = random.choice((kind, kind, kind, b"zTXt", b"tEXt", b"iCCP", b"PLTE", b"acTL"))
        data = random.choice((flip(data, random), data, b"", packed, b"x\0\0" + packed))
        chunks[which : which + 1] = [(kind, data)] * random.choice((0, 1, 1, 1, 2, 5000))
    packs = (
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )
    return content[:8] + b"".join(packs)


def _part(content: bytes, random: Random) -> bytes:
    """The file without a part, with a part twice, or with zeros or the part of another in its place."""
    start, size = random.randrange(len(content) or 1), random.choice((1, 16, 1000))
    other = random.choice([other for kind, other in originals() if kind == "image"])
    new = random.choice(
        (b"", content[start : start + size] * 2, bytes(size), other[start : start + size], other[start:])
    )
    return content[:start] + new + content[start + size :]


_TEXT: list[Callable[[str, Random], str]] = [*TEXT_CHANGES, *[_cells] * 12, _columns, _columns, _many]
_BYTES: list[Callable[[bytes, Random], bytes]] = [
    flip, _numbers, _numbers, _card, _card, _chunk, _part, _part,
    lambda content, random: content[: random.randrange(len(content) + 1)],
]  # fmt: skip
