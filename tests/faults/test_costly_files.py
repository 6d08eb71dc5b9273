"""Files that would take long or much memory to read are refused before they are split into cells or unpacked."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from astropy.io import fits

from heliosweep import api
from heliosweep.errors import StudyError
from heliosweep.families.backward_gazing.files import read_picture
from tests.conftest import SMALL
from tests.faults.judge import judge
from tests.faults.mutations import chunk, png

pytestmark = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="asks Linux for the memory")


def refusal(read: Callable[[Path], object], path: Path) -> str:
    """Why a file is refused, in little time and memory; without the limits some of these take minutes."""
    said = []

    def reading(path: Path) -> None:
        try:
            read(path)
        except StudyError as error:
            said.append(str(error))
            raise

    verdict = judge(path, "", "a file", read=reading)
    assert verdict.outcome == "refused", verdict.defect
    return said[0]


MANY = 50_000_000
LONG_LINE = "holds a line of more than 100,000 letters"
TABLES: dict[str, tuple[Callable[[], str], str]] = {
    "columns": (lambda: (",".join(map("c{}".format, range(10_000))) + "\n") * 2, "has 10,000 columns, more than 1,000"),
    "one column": (lambda: "x," * 40_000 + "\n1", "has 40,000 columns"),
    "wide": (lambda: "x," * 10**6 + "\n1", LONG_LINE),
    "line ends": (lambda: "\n" * MANY, "has 50,000,000 lines, more than a table may have"),
    "old line ends": (lambda: "\r" * MANY, "has 50,000,000 lines"),
    "comments": (lambda: "#\n" * (MANY // 2), "has 25,000,000 lines"),
    "commas": (lambda: "," * MANY, LONG_LINE),
    "tabs": (lambda: "\t1" * (MANY // 2), LONG_LINE),
    "quotes": (lambda: 'x,y\n"' + "1" * MANY, LONG_LINE),
}


@pytest.mark.parametrize("name", TABLES)
def test_tables(tmp_path: Path, name: str) -> None:
    text, message = TABLES[name]
    (tmp_path / "layout.csv").write_text(text())
    (tmp_path / "study.yaml").write_text(yaml.safe_dump({**SMALL, "layout": {"file": "layout.csv"}}))
    assert message in refusal(api.load, tmp_path / "study.yaml")


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


def pixels(side: int) -> bytes:
    return chunk(b"IDAT", zlib.compress(bytes(side * (side + 1)), 9))


def chunks() -> bytes:
    return chunk(b"teSt") * 3_000_000


IMAGES: dict[str, tuple[Callable[[Path], bytes], str]] = {
    "chunks before the pixels": (lambda _: png(64, 64, chunks(), pixels(64)), "more pieces than any image needs"),
    "chunks behind the pixels": (lambda _: png(64, 64, pixels(64), chunks()), "more pieces than any image needs"),
    "chunks without pixels": (
        lambda _: png(64, 64, chunk(b"IDAT") * 10**6, pixels(64)),
        "more pieces than any image needs",
    ),
    "chunks of a large image": (
        lambda _: png(900, 900, chunk(b"IDAT") * 10**6, pixels(900)),
        "more pieces than any image needs",
    ),
    "empty image": (
        lambda _: png(5000, 5000, pixels(5000)),
        "has 5,000 x 5,000 pixels in 24,372 bytes, which no photograph has",
    ),
    "pages": (lambda _: tiff(20_000), "holds more than one page; save one image for each file"),
    "tags": (lambda _: big_tiff(), "more pieces than any image needs"),
    "header without end": (lambda _: endless(), "has a header or more pieces than any image needs"),
    "units": (lambda _: units(), "has a header or more pieces than any image needs"),
    "tile": (lambda path: tiles(path, "GZIP_1", zeros()), "has tiles that unpack to more than its pixels"),
    "members": (lambda path: tiles(path, "GZIP_2", 2 * zlib.compress(b"1", wbits=31)), "has tiles that unpack to more"),
    "plates": (lambda path: tiles(path, "HCOMPRESS_1", b"1"), "is compressed by HCOMPRESS_1, which is not read"),
}


@pytest.mark.parametrize("name", IMAGES)
def test_images(tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    content, message = IMAGES[name]
    path = tmp_path / "image"
    path.write_bytes(content(tmp_path / "made"))
    assert message in refusal(lambda path: read_picture(path, "image"), path)
    assert capfd.readouterr().err == ""
