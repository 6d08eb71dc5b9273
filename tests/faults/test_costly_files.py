"""Files that would take long or much memory to read are refused before they are split into cells or unpacked."""

from __future__ import annotations

import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from astropy.io import fits

from tests.conftest import SMALL

#: Prints the memory that loading a study takes at most [kB], with Python and its libraries, and what was wrong.
PROGRAM = """
from pathlib import Path
from heliosweep import api
from heliosweep.errors import StudyError
try:
    api.load("study.yaml")
except StudyError as error:
    print(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
    print(error)
"""
MANY = 50_000_000
NAMES = ",".join(f"c{number}" for number in range(10_000))
TABLES = {
    "columns": (f"{NAMES}\n" * 2, "has 10,000 columns, more than 1,000"),
    "one column": ("x," * 40_000 + "\n1", "has 40,001 columns"),
    "wide": ("x," * 10**6 + "\n1", "holds a line of more than 100,000 letters"),
    "line ends": ("\n" * MANY, "has 50,000,000 lines, more than a table may have"),
    "old line ends": ("\r" * MANY, "has 50,000,000 lines"),
    "comments": ("#\n" * (MANY // 2), "has 25,000,000 lines"),
    "commas": ("," * MANY, "holds a line of more than 100,000 letters"),
    "tabs": ("\t1" * (MANY // 2), "holds a line of more than 100,000 letters"),
    "quotes": ('x,y\n"' + "1" * MANY, "holds a line of more than 100,000 letters"),
}


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="asks Linux for the memory")
@pytest.mark.parametrize("name", TABLES)
def test_tables(tmp_path: Path, name: str) -> None:
    text, message = TABLES[name]
    (tmp_path / "layout.csv").write_text(text)
    (tmp_path / "study.yaml").write_text(yaml.safe_dump({**SMALL, "layout": {"file": "layout.csv"}}))
    command = [sys.executable, "-c", PROGRAM]  # takes a second; without the limits some of these take minutes
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60)
    memory, said = done.stdout.split("\n", 1)
    assert message in said
    assert int(memory) < 250_000


#: Prints the time that reading an image takes [s], the memory that it takes besides that of the libraries [kB], and
#: what was wrong.
IMAGE = """
import sys, time
from pathlib import Path
import astropy.io.fits, PIL.PngImagePlugin, PIL.TiffImagePlugin
from heliosweep.errors import StudyError
from heliosweep.families.backward_gazing.files import read_picture
def memory(key): return int(Path("/proc/self/status").read_text().split(key)[1].split()[0])
before, start = memory("VmRSS:"), time.process_time()
try:
    read_picture(Path(sys.argv[1]), "image")
except StudyError as error:
    print(time.process_time() - start, memory("VmHWM:") - before)
    print(error)
"""


def chunk(kind: bytes, data: bytes = b"") -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(side: int, before: bytes = b"", after: bytes = b"", first: bytes = b"") -> bytes:
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0))
    pixels = first + chunk(b"IDAT", zlib.compress(bytes(side * (side + 1)), 9))
    return b"\x89PNG\r\n\x1a\n" + head + before + pixels + after + chunk(b"IEND")


def tiff(directories: int) -> bytes:
    """Pages of 64 x 64 levels, all the same."""
    values = ((256, 64), (257, 64), (258, 8), (259, 1), (262, 1), (273, 8), (278, 64), (279, 4096))
    page = struct.pack("<H", 8) + b"".join(struct.pack("<HHII", tag, 3, 1, value) for tag, value in values)
    places = range(8 + len(page) + 4, 8 + directories * (len(page) + 4), len(page) + 4)
    return b"II*\0\x08\0\0\0" + b"".join(page + struct.pack("<I", place) for place in (*places, 0)) + bytes(4096)


def big_tiff() -> bytes:
    return b"II+\0" + struct.pack("<HHQQ", 8, 0, 16, 2**40) + bytes(20 * 2_000_000)


def cards(**values: str) -> bytes:
    return b"".join(f"{key:8}= {value:>20}".ljust(80).encode() for key, value in values.items())


def endless() -> bytes:
    return cards(SIMPLE="T", BITPIX="16", NAXIS="2", NAXIS1="64", NAXIS2="64") + b"COMMENT more".ljust(80) * 2_000_000


def units() -> bytes:
    first, more = cards(SIMPLE="T", BITPIX="8", NAXIS="0"), cards(XTENSION="'IMAGE   '", BITPIX="8", NAXIS="0")
    return (first + b"END").ljust(2880) + (more + b"END").ljust(2880) * 20_000


def tiles(path: Path, kind: str, first: bytes) -> bytes:
    """Compressed levels of 512 x 512 pixels of which one tile is another."""
    levels = np.random.default_rng(1).integers(0, 255, (512, 512)).astype(np.int16)
    fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(levels, compression_type="GZIP_1")]).writeto(path)
    with fits.open(path, disable_image_compression=True) as parts:
        known = parts[1].header
        cells = np.array([np.frombuffer(first, np.uint8), *parts[1].data["COMPRESSED_DATA"][1:]], object)
        table = fits.BinTableHDU.from_columns([fits.Column("COMPRESSED_DATA", "1PB()", array=cells)])
        table.header.update({key: known[key] for key in known if key.startswith("Z")})
        table.header["ZCMPTYPE"] = kind
        fits.HDUList([fits.PrimaryHDU(), table]).writeto(path, overwrite=True)
    return path.read_bytes()


def zeros() -> bytes:
    """512 MB of zeros, compressed by gzip."""
    packer, block = zlib.compressobj(9, wbits=31), bytes(2**24)
    return b"".join(packer.compress(block) for _ in range(32)) + packer.flush()


MANY_CHUNKS = chunk(b"teSt") * 3_000_000
IMAGES: dict[str, tuple[Callable[[Path], bytes], str]] = {
    "chunks before the pixels": (lambda _: png(64, before=MANY_CHUNKS), "more pieces than any image needs"),
    "chunks behind the pixels": (lambda _: png(64, after=MANY_CHUNKS), "more pieces than any image needs"),
    "chunks without pixels": (lambda _: png(64, first=chunk(b"IDAT") * 10**6), "more pieces than any image needs"),
    "empty image": (lambda _: png(5000), "has 5,000 x 5,000 pixels in 24,372 bytes, which no photograph has"),
    "pages": (lambda _: tiff(20_000), "holds more than one page; save one image for each file"),
    "tags": (lambda _: big_tiff(), "more pieces than any image needs"),
    "header without end": (lambda _: endless(), "has a header or more pieces than any image needs"),
    "units": (lambda _: units(), "has a header or more pieces than any image needs"),
    "tile": (lambda path: tiles(path, "GZIP_1", zeros()), "has tiles that unpack to more than its pixels"),
    "members": (lambda path: tiles(path, "GZIP_2", 2 * zlib.compress(b"1", wbits=31)), "has tiles that unpack to more"),
    "plates": (lambda path: tiles(path, "HCOMPRESS_1", b"1"), "is compressed by HCOMPRESS_1, which is not read"),
}


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="asks Linux for the memory")
@pytest.mark.parametrize("name", IMAGES)
def test_images(tmp_path: Path, name: str) -> None:
    content, message = IMAGES[name]
    path = tmp_path / "image"
    path.write_bytes(content(tmp_path / "made"))
    done = subprocess.run(
        [sys.executable, "-c", IMAGE, str(path)], capture_output=True, text=True, check=True, timeout=100
    )
    numbers, said = done.stdout.split("\n", 1)
    seconds, memory = map(float, numbers.split())
    assert message in said
    assert done.stderr == ""
    assert seconds < 2
    assert memory < 200_000
